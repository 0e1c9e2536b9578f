"""What is said to cut the field is what takes rays in its corners: verdicts against exact areas of the ray budget."""

import re

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.evaluation.fields import judged_field
from roslf_design.theory.light import on_array, sensor_field
from roslf_design.theory.quantities import QUANTITIES
from roslf_design.theory.vignetting import field_limit

FOLDED = """
name = "folded"
[main_lens]
diameter = "4.5 mm"
focal_length = "7.5 mm"
focal_plane = "25.3 mm"
[aperture]
diameter = "1.73 mm"
distance = "1 mm"
[[elements]]
kind = "mirror"
distance = "6.4 mm"
angle = "45 deg"
azimuth = "90 deg"
diameter = "8 mm"
[[elements]]
kind = "plate"
distance = "9.8 mm"
thickness = "0.5 mm"
material = "sapphire"
diameter = "6.2 mm"
[microlens_array]
pitch = "20 um"
focal_length = "120 um"
size = ["5.4 mm", "4 mm"]
[sensor]
part = "IMX335"
distance = "120 um"
"""


def limit_of(design):
    """Undistorted field of what the sensor sees, as an evaluation has it."""
    return field_limit(Camera.of(design), judged_field(design))


@pytest.mark.parametrize(
    ("mirror", "plate", "azimuth"),
    [(8, 6.2, 90), (8, 7.5, 90), (8, 6.2, 0), (7, 7.5, 0), (6, 6.2, 90), (6.4, 7.5, 90), (14, 6.2, 90), (7, 6.4, 45)],
)
def test_what_cuts_the_field_is_what_takes_rays_in_its_corners(mirror, plate, azimuth):
    design = roslf.loads(FOLDED).replace(
        {
            "elements.0.diameter": float(mirror),
            "elements.1.diameter": float(plate),
            "elements.0.azimuth": np.deg2rad(azimuth),
        }
    )
    camera = Camera.of(design)
    corners = [tuple(corner) for corner in on_array(camera, sensor_field(camera).corners).tolist()]
    result = roslf.evaluate(design, corners)
    lost = {}
    for field in result.fields:
        before = 1.0
        for share in field.ray_budget.by_name:  # in the order of light
            lost[share.name] = max(lost.get(share.name, 0.0), before - share.kept)
            before = share.kept
    lost = {rim.opening: lost[rim.opening] for rim in camera.rims}
    told = result.non_distortion
    assert told.undistorted_in_field == (max(lost.values()) < 1e-12)
    verdict = next(one for one in result.verdicts if one.name == "field_undistorted")
    assert verdict.ok == told.undistorted_in_field
    cuts = [cut["rim"] for cut in told.cut_by]
    assert {name for name, share in lost.items() if share > 1e-12} <= {*cuts}
    assert told.room_at_corner_mm == pytest.approx(float(QUANTITIES["non_distortion_room_mm"](camera)), rel=1e-12)
    if not verdict.ok:
        assert lost[told.limited_by] > 0
        assert f"cut by {told.limited_by}" in verdict.text
        wider = dict(re.findall(r"(mirror 1|plate 2|main lens) by ([\d.]+) mm", verdict.remedy))
        keys = {"mirror 1": "elements.0.diameter", "plate 2": "elements.1.diameter", "main lens": "main_lens.diameter"}
        assert {*wider} == {name.partition(",")[0] for name in cuts}
        changes = {keys[name]: float(camera[keys[name]]) + float(by) for name, by in wider.items()}
        assert not limit_of(design.replace(changes)).cuts
    for cut in told.cut_by:  # what each cuts by itself, the others far away
        key = f"elements.{int('plate' in cut['rim'])}.diameter"
        alone = {"elements.0.diameter": 60.0, "elements.1.diameter": 60.0, key: float(camera[key])}
        bound = limit_of(design.replace(alone))
        assert cut["beyond_mm"] >= bound.radius * (1 - 1e-12)
        assert cut["rim"] != bound.rim or cut["beyond_mm"] == pytest.approx(bound.radius, rel=1e-12)


def test_a_rim_that_just_leaves_the_field_whole_leans_only_where_it_does():
    """Where an optimiser ends: rounding puts the bound below the corner."""
    design = roslf.load("rigid-scope")
    for beside in np.linspace(-3e-13, 3e-13, 7):
        least = 2 * float(-QUANTITIES["non_distortion_room_mm"](Camera.of(design)))
        result = roslf.evaluate(design.replace(D=design.D + least + beside), [])
        verdict = next(one for one in result.verdicts if one.name == "field_undistorted")
        assert verdict.ok
        assert "out to" in verdict.text
        assert "leans" not in verdict.text


def test_builds_of_a_leaning_mirror_are_their_single_cameras():
    design = roslf.loads(FOLDED)
    wide = np.array([6.4, 7.0, 8.0])
    many = QUANTITIES["non_distortion_room_mm"](Camera.of(design, {"elements.0.diameter": wide}))
    alone = [QUANTITIES["non_distortion_room_mm"](Camera.of(design, {"elements.0.diameter": one})) for one in wide]
    np.testing.assert_allclose(many, [float(one) for one in alone], rtol=1e-9)
