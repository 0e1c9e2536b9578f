"""Doubts about what is bought: windows' clear apertures and prisms' reflecting faces, against arithmetic by hand."""

import math

import pytest

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.catalogue.entries import named_window
from roslf_design.errors import InputError
from roslf_design.evaluation.doubts import full_well_doubt
from roslf_design.reporting.blocks import Table
from roslf_design.reporting.sheet.lines import basis, datasheet_section
from roslf_design.theory.light import sensor_field
from tests.reporting.made import rough_resolution, views_as_refocused

HEAD = """
name = "head"
[main_lens]
diameter = "4.5 mm"
focal_length = "7.5 mm"
focal_plane = "26.8 mm"
[aperture]
diameter = "1.73 mm"
distance = "1 mm"
[[elements]]
%s
[microlens_array]
pitch = "20 um"
focal_length = "120 um"
size = ["5.4 mm", "4 mm"]
[sensor]
part = "IMX335"
distance = "120 um"
"""
PRISM = """
kind = "prism"
distance = "2.5 mm"
thickness = "7 mm"
material = "N-BK7"
deviation = "90 deg"
azimuth = "90 deg"
reflections = 1
diameter = "7 mm"
"""


def verdicts(design, name):
    return [one for one in roslf.evaluate(design).verdicts if one.name == name]


def test_a_prism_whose_field_is_too_wide_for_total_reflection_needs_a_coating():
    """In the fold's plane: 45 degrees less the steepest ray's angle in the glass."""
    design = roslf.loads(HEAD % PRISM)
    camera = Camera.of(design)
    (told,) = verdicts(design, "reflecting_face")
    glass = float(design.elements[0].material.index(design.wavelength))
    top = float(camera.seen.inverse_m * sensor_field(camera).half[1])
    steepest = math.atan((top + float(camera.seen.D_F) / 2) / float(camera.seen.d_f - camera.seen.d_3))
    least = 45 - math.degrees(math.asin(math.sin(steepest) / glass))
    assert f"from {least:.3g} degrees" in told.text
    assert f"beyond {math.degrees(math.asin(1 / glass)):.3g} degrees" in told.text
    assert "coating" in told.remedy


@pytest.mark.parametrize("turned", [1, -1])
def test_light_from_where_the_axis_does_not_turn_meets_a_prism_s_face_straightest(turned):
    """Face with the normal (turned, -1) along y and z: a ray (s, 1) from the lens meets it at 45 + turned atan s."""
    changes = {"elements.0.azimuth": turned * math.pi / 2, "sensor.decentre": [0.0, 0.4]}
    design = roslf.loads(HEAD % PRISM).replace(changes)
    camera = Camera.of(design)
    (told,) = verdicts(design, "reflecting_face")
    ends = -turned * sensor_field(camera).corners[:, 1] * float(camera.seen.inverse_m)
    slope = (ends.min() - float(camera.seen.D_F) / 2) / float(camera.seen.d_f - camera.seen.d_3)
    index = float(design.elements[0].material.index(design.wavelength))
    least = 45 + math.degrees(math.asin(math.sin(math.atan(slope)) / index))
    assert f"from {least:.3g} degrees" in told.text


@pytest.mark.parametrize(
    "changes",
    [
        {"elements.0.material": {"index": 1.8}},
        {"elements.0.reflections": 2},
        {"elements.0.deviation": math.radians(60)},
        {"microlens_array.size": [0.4, 0.4], "aperture.diameter": 0.5},
    ],
)
def test_other_prisms_reflect_all_of_it_or_are_not_judged(changes):
    assert not verdicts(roslf.loads(HEAD % PRISM).replace(changes), "reflecting_face")


def test_a_window_counts_no_more_than_is_clear_where_the_field_needs_it():
    window = 'kind = "plate"\ndistance = "9.3 mm"\npart = "sapphire 6 x 1 mm"\ndiameter = "6 mm"'
    known = named_window("sapphire 6 x 1 mm")
    assert known.aperture == pytest.approx(5.4)
    (told,) = verdicts(roslf.loads(HEAD % window), "clear_aperture")
    assert "all 6 mm of plate 1 (sapphire 6 x 1 mm) count, of which 5.4 mm, 90 %, are taken as clear" in told.text
    near = window.replace("9.3 mm", "1.2 mm")  # where pencils are together
    assert not verdicts(roslf.loads(HEAD % near), "clear_aperture")
    assert not verdicts(roslf.loads(HEAD % window.replace('"6 mm"', '"5.4 mm"')), "clear_aperture")


def test_a_stop_of_no_place_is_told_which_it_may_have():
    with pytest.raises(InputError, match="is missing, and so is distance; give one of them"):
        roslf.loads((HEAD % PRISM).replace('distance = "1 mm"', ""))


def test_a_temperature_to_be_swept_asks_for_an_environment():
    with pytest.raises(InputError, match=r"add \[environment\] with a housing"):
        roslf.sweep("paper", {"environment.temperature": [20.0, 40.0]}, "fill_factor")


def test_a_named_sensor_whose_pixels_are_not_those_of_the_assumed_full_well_says_so():
    plate = 'kind = "plate"\ndistance = "9.3 mm"\nthickness = "1 mm"\nmaterial = "sapphire"'
    text = HEAD % plate

    def told(text):
        return [one for one in roslf.evaluate(roslf.loads(text)).warnings if one.startswith("full well assumed")]

    (doubt,) = told(text)
    assert "10500 electrons: of a pixel of 3.45 um, and those of the sensor are of 2 um; state full_well" in doubt
    assert not told(text.replace('part = "IMX335"', 'part = "IMX335"\nfull_well = 8000'))
    assert not told(text.replace('part = "IMX335"', 'part = "IMX335"\npixel = "2.5 um"'))  # 0.53 of the area


@pytest.mark.parametrize("name", roslf.preset_names())
def test_a_preset_s_small_pixels_hold_what_such_pixels_do_or_its_sheet_says_that_it_is_assumed_otherwise(
    name, monkeypatch
):
    """Half to twice 1000 electrons per um^2 of small pixels; rigid-scope keeps its numbers, pipe-bore's are larger."""
    design = roslf.load(name)
    doubt, micrometres = full_well_doubt(design), 1e3 * design.sensor.pixel
    assert bool(doubt) == (name in ("rigid-scope", "pipe-bore"))
    if 1 <= micrometres <= 3 and not doubt:
        assert 500 <= design.sensor.full_well / micrometres**2 <= 2000
        assert "full well assumed" in design.source
    if name not in ("rigid-scope", "pipe-bore", "paper"):  # sheets print the doubt, or there is none
        return
    rough_resolution(monkeypatch)
    views_as_refocused(monkeypatch)
    captions = [block.caption for block in datasheet_section(basis(design)).blocks if isinstance(block, Table)]
    assert any("Caution: full well assumed, 10500 electrons" in caption for caption in captions) == bool(doubt)
