"""The parts list: what a design is made of, and the catalogue's parts that are the same."""

import pytest

from roslf_design.design import load
from roslf_design.optimize.parts import Catalogue, load_catalogue
from roslf_design.report.parts_list import (
    array_match,
    length,
    lens_match,
    parts_section,
    sensor_match,
)
from tests.report.test_figures import DESIGNS


def rows(design, catalogue=None):
    return {row[1]: row for row in parts_section(design, catalogue).blocks[0].rows}


def test_every_part_of_a_design_is_listed_once_and_numbered():
    found = rows(DESIGNS["strange"])
    assert list(found) == ["main lens", "FAP, front stop", "stop 1", "stop 2", "microlens array", "image sensor"]
    assert [row[0] for row in found.values()] == list("123456")
    assert found["stop 2"][2] == "opening 14 mm"


def test_parts_of_the_catalogue_are_found_again():
    """A design made of catalogue parts lists just these."""
    known = load_catalogue()
    for array in known.microlens_arrays:
        for sensor in known.sensors:
            changed = load("paper").replace(
                {
                    "microlens_array.pitch": array.pitch,
                    "microlens_array.focal_length": array.focal,
                    "microlens_array.size": array.size,
                    "microlens_array.layout": array.layout,
                    "microlens_array.lens_shape": array.lens_shape,
                    "sensor.pixel": sensor.pixel,
                    "sensor.size": sensor.size,
                }
            )
            assert array_match(changed, known)[1] == array
            assert sensor_match(changed, known)[1] == sensor
            assert "the same as" in array_match(changed, known)[0]


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"microlens_array.pitch": 0.07}, "pitch 63 um"),
        ({"microlens_array.focal_length": 2.1}, "focal length 2 mm"),
        ({"microlens_array.lens_shape": "circular"}, "square, square lenses"),
        ({"microlens_array.size": (40.0, 30.0), "sensor.size": (30.0, 20.0)}, "only 23 mm x 23 mm"),
    ],
)
def test_what_differs_is_named(changes, said):
    text, nearest = array_match(load("paper").replace(changes), load_catalogue())
    assert text.startswith("to be made; nearest is paper 63 um / 2 mm: ")
    assert said in text
    assert nearest.part == "paper 63 um / 2 mm"


def test_a_larger_sensor_read_out_in_part_is_the_same_and_a_smaller_one_is_not():
    known = load_catalogue()
    design = load("mismatched-borescope")  # IMX250
    half = design.replace({"sensor.size": (4.0, 3.0)})
    assert sensor_match(half, known)[0] == "the same as Sony IMX250"
    larger = design.replace({"sensor.size": (8.6, 7.2)})
    assert "only 2448 x 2048 px" in sensor_match(larger, known)[0]


def test_far_parts_and_real_lenses_are_told():
    assert lens_match(load("rigid-scope"), load_catalogue()) == ("to be made; the catalogue has nothing near", None)
    assert lens_match(load("paper-singlet"), load_catalogue()) == ("LA1050-A reversed, as prescribed", None)
    assert lens_match(load("paper"), Catalogue()) == ("the catalogue has none", None)


def test_lengths_are_written_for_readers():
    assert [length(value) for value in (0.0, 0.063, 0.00155, 0.1, 140.0, 22.272000000000002)] == [
        "0 mm",
        "63 um",
        "1.55 um",
        "0.1 mm",
        "140 mm",
        "22.272 mm",
    ]
