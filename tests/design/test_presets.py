"""Presets with something in the bore: what their sources say, and ray matrices multiplied from scene to sensor."""

import math

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.design import load
from roslf_design.design.files import preset_path
from roslf_design.evaluation.required import load_beside
from roslf_design.theory.light import sensor_field

NATURES_LIMITS = ("views_resolved", "corner_lit", "lens_speed")
"""Verdicts on what diffraction, the light's slant and an ideal lens leave, which no focus or match mends."""
IN_THE_BORE = ("arthroscope", "cystoscope", "grin-needle", "video-otoscope")


def gap(length, index=1.0):
    return np.array([[1, length / index], [0, 1]])


def lens(focal_length):
    return np.array([[1, 0], [-1 / focal_length, 1]])


def through(design):
    """From the plane in focus to the microlenses, heights and index times slope; and from there to the FAP."""
    wave = design.wavelength
    elements = sorted(design.elements, key=lambda e: -e.distance)
    index = float(design.object_space.medium.index(wave))
    place = elements[0].distance + elements[0].length
    matrix, at_fap = gap(design.d_f - place, index), None
    for element in elements:
        if at_fap is None and element.distance + element.length <= design.d_3:
            at_fap = gap(place - design.d_3) @ matrix
        matrix = gap(place - element.distance - element.length) @ matrix
        if element.kind == "lens":
            matrix = lens(element.focal_length) @ matrix
        elif element.kind == "grin":
            n, turn = element.index, element.gradient * element.thickness
            bent = n * element.gradient
            matrix = (
                np.array([[math.cos(turn), math.sin(turn) / bent], [-math.sin(turn) * bent, math.cos(turn)]]) @ matrix
            )
        else:
            matrix = gap(element.thickness, float(element.material.index(wave))) @ matrix
        place = element.distance
    if at_fap is None:
        at_fap = gap(place - design.d_3) @ matrix
    return gap(design.d_1) @ lens(design.f) @ gap(place) @ matrix, at_fap


@pytest.mark.parametrize("name", IN_THE_BORE)
def test_presets_focus_match_and_see_whole_images(name):
    design = load(name)
    result = roslf.evaluate(design)
    matrix, _ = through(design)
    sharp = abs(matrix[0, 1]) / np.abs(matrix).max()
    assert sharp < 1e-9
    assert result.sampling.object_sample_mm == pytest.approx(design.d / abs(matrix[0, 0]), rel=1e-9)
    assert all(verdict.ok for verdict in result.verdicts if verdict.name not in NATURES_LIMITS)
    assert 0.94 < result.f_number.fill_factor <= 1
    assert "archetype" in design.name and "chosen" in design.source  # noqa: PT018


@pytest.mark.parametrize(
    ("name", "working_distance", "half_field_in_air"),
    [
        ("arthroscope", 12.5, 27.5),  # 55 degrees over all: K133941
        ("cystoscope", 25.0, 40.0),  # Acta Optica Sinica 38, 0222002
        ("video-otoscope", 15.0, 20.0),
        ("grin-needle", 5.0, 19.0),  # what the barrels of its rods leave
    ],
)
def test_working_distance_and_field_are_those_of_their_kind(name, working_distance, half_field_in_air):
    """The chief ray through the middle of the FAP to the field's corner; in air its angle is by index times slope."""
    design = load(name)
    front = max(element.distance + element.length for element in design.elements)
    assert design.d_f - front == pytest.approx(working_distance, abs=0.1)
    half = sensor_field(Camera.of(design)).half_diagonal
    corner = float(half) * roslf.evaluate(design).sampling.object_sample_mm / design.d  # to first order
    _, at_fap = through(design)
    slope = -at_fap[0, 0] * corner / at_fap[0, 1]  # index times slope in the medium of what crosses the FAP's middle
    assert math.degrees(math.atan(abs(slope))) == pytest.approx(half_field_in_air, abs=2)


def test_gradients_of_the_needle_are_those_of_its_rods_apertures():
    relay, objective = (element for element in load("grin-needle").elements if element.kind == "grin")
    for rod, aperture in ((relay, 0.1), (objective, 0.5)):
        assert rod.index * math.tanh(rod.gradient * 0.7 / 2) == pytest.approx(aperture, rel=1e-3)


def test_a_folder_called_as_a_preset_does_not_hide_it(tmp_path, monkeypatch):
    """`roslf report paper -o paper` makes one; a file of that name is what is asked for."""
    (tmp_path / "paper").mkdir()
    monkeypatch.chdir(tmp_path)
    assert roslf.load("paper") == load_beside("paper", tmp_path) == roslf.load(preset_path("paper"))
    (tmp_path / "rigid-scope").write_text(preset_path("paper").read_text())
    assert roslf.load("rigid-scope").name == roslf.load(preset_path("paper")).name
