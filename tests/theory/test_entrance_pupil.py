"""Entrance pupil, the aperture stop as the scene sees it, against the lens equation and the lens maker's plate."""

import pytest

import roslf_design as roslf
from roslf_design.design import loads

BENCH = """
name = "pupil"
[main_lens]
diameter = "10 mm"
focal_length = "20 mm"
focal_plane = "400 mm"
[aperture]
diameter = "1.5 mm"
distance = "30 mm"
[microlens_array]
pitch = "63 um"
focal_length = "1 mm"
size = ["5 mm", "4 mm"]
[sensor]
distance = "1 mm"
pixel = "5 um"
size = ["5 mm", "4 mm"]
[light]
wavelength = "587.5618 nm"
"""
F, AHEAD = 12.0, 5.0
LENS = f'[[elements]]\nkind = "lens"\nfocal_length = "{F} mm"\ndiameter = "8 mm"\ndistance = "{30 + AHEAD} mm"\n'
THICK, INDEX = 3.0, 1.5  # of the d line, the light of the bench
PLATE = f"""[[elements]]
kind = "plate"
thickness = "{THICK} mm"
material = {{index = {INDEX}, abbe = 60}}
diameter = "8 mm"
distance = "31 mm"
"""


@pytest.mark.parametrize(
    ("elements", "diameter", "ahead"),
    [
        ("", 1.5, 0.0),  # the stop itself, which is the tip
        # 1/image = 1/f - 1/object: the stop 5 mm behind a lens of 12 mm is seen 60/7 mm behind it, 12/7 as large.
        (LENS, 1.5 * F / (F - AHEAD), -AHEAD * F / (F - AHEAD)),
        # A plate moves an image by t (1 - 1/n) towards who looks, and leaves its size; its front face is the tip.
        (PLATE, 1.5, -(1 + THICK) + THICK * (1 - 1 / INDEX)),
    ],
)
def test_it_is_the_stop_as_the_scene_sees_it(elements, diameter, ahead):
    result = roslf.evaluate(loads(BENCH + elements))
    assert result.entrance_pupil.diameter_mm == pytest.approx(diameter, rel=1e-12)
    assert result.entrance_pupil.ahead_of_tip_mm == pytest.approx(ahead, rel=1e-12, abs=1e-12)
    assert result.value("entrance_pupil_diameter_mm") == result.entrance_pupil.diameter_mm
    away = result.answer.working_distance_mm - ahead
    assert result.entrance_pupil.vergence_at_focus_per_mm == pytest.approx(1 / away, rel=1e-12)
    assert result.entrance_pupil.diameter_over_distance == pytest.approx(diameter / away, rel=1e-12)


def test_at_infinity_its_twins_are_finite():
    """A stop in the back focal plane of a thin lens: cones of all points of the scene are as wide as it, over f."""
    result = roslf.evaluate(loads(BENCH + LENS.replace(str(30 + AHEAD), str(30 + F))))
    pupil = result.entrance_pupil
    assert abs(pupil.ahead_of_tip_mm) > 1e12
    assert pupil.vergence_at_focus_per_mm == pytest.approx(0.0, abs=1e-15)
    assert pupil.diameter_over_distance == pytest.approx(1.5 / F, rel=1e-12)
