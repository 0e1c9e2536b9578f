"""First answers: a buyer's numbers against their definitions."""

import math
from dataclasses import replace

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.errors import InputError
from roslf_design.evaluation.field_images import FieldImages
from roslf_design.evaluation.stations import FOCUS
from roslf_design.evaluation.verdicts import lit
from roslf_design.theory.depth_budget import depth_budget

PAPER = roslf.load("paper")


def test_the_paper_s_bench_in_a_buyer_s_words():
    """All through the FAP's centre: similar triangles from there to the edges of what the sensor sees."""
    answer = roslf.evaluate(PAPER, at=(100.0,)).answer
    half = roslf.evaluate(PAPER).non_distortion.field_half_width_mm
    focus = PAPER.d_f - PAPER.d_3
    assert answer.working_distance_mm == pytest.approx(focus, rel=1e-12)
    assert answer.field_of_view_deg.width == pytest.approx(2 * math.degrees(math.atan(half / focus)), rel=1e-9)
    assert [plane.at_mm for plane in answer.at] == [pytest.approx(focus), 100.0]
    assert [plane.width_mm for plane in answer.at] == pytest.approx([2 * half, 2 * half * 100.0 / focus], rel=1e-9)
    assert answer.outer_diameter_mm == pytest.approx(PAPER.D)


def test_uncertainty_of_depth_grows_as_disparity_flattens():
    """Disparity per millimetre falls as 1/Z^2: what photons and views leave open grows by that at least, from focus."""
    focus = PAPER.d_f - PAPER.d_3
    near, there = roslf.evaluate(PAPER, at=(2 * focus,)).answer.at
    assert there.u_z_mm > 3.9 * near.u_z_mm
    assert (near.expanded_mm, there.expanded_mm) == (2 * near.u_z_mm, 2 * there.u_z_mm)


def test_a_working_range_ends_where_depth_is_of_little_use():
    """Brute force: U against a tenth of the distance; where that is passed wherever views are sharp there is none."""
    scope = roslf.load("cystoscope")
    answer = roslf.evaluate(scope).answer
    near, far = answer.working_range_mm
    assert answer.sharp_views_mm == (near, math.inf)
    at = np.array([*np.geomspace(near, 0.999 * far, 30), *np.geomspace(1.003 * far, 100 * far, 30)])
    useful = depth_budget(roslf.Camera.of(scope), at).expanded_mm <= 0.1 * at
    assert (useful == (at < far)).all()
    shaky = roslf.evaluate(scope.replace({"depth.disparity_error": 5.0})).answer
    assert (shaky.working_range_mm, shaky.useful_to_mm, shaky.sharp_views_mm) == (None, None, answer.sharp_views_mm)
    told = {name: (value, remark) for name, value, remark in shaky.rows}
    assert told["working range, as drawn"][0] == "none"
    assert "but U is 10 % of the distance or more there" in told["working range, as drawn"][1]


def test_a_darker_corner_is_told_with_its_stops():
    """Cos^4 of the field's angle alone, nothing cut."""
    scope = roslf.load("cystoscope")
    result = roslf.evaluate(scope)
    light = result.answer.corner_light
    assert light == pytest.approx(roslf.specification(scope).relative_illumination, rel=1e-12)
    assert light == pytest.approx(result.answer.corner_slant, rel=1e-9)  # every image is whole
    (verdict,) = [verdict for verdict in result.verdicts if verdict.name == "corner_lit"]
    assert (verdict.ok, verdict.level) == (False, "limit")
    assert f"{-math.log2(light):.2g} stops darker" in verdict.text
    assert ", 1 stop darker: " in lit(replace(result.answer, corner_light=0.49)).text
    assert "no place of the exit pupil evens it" in verdict.remedy


TIP = """
name = "tip"
main_lens = {diameter = "6 mm", focal_length = "1.15 mm", focal_plane = "11 mm"}
aperture = {diameter = "0.41 mm", distance = "0.25 mm"}
microlens_array = {pitch = "30 um", focal_length = "92.5 um", size = ["2 mm", "1.4 mm"]}
sensor = {distance = "92.5 um", pixel = "1.4 um", size = ["1.792 mm", "1.12 mm"]}
"""


def etendue(design, place, direction):
    """Light of a Lambertian scene on an area of the array: sum over the FAP of its rays' direction cosines' area.

    `direction` gives the tangent of a ray's angle in the scene from where it goes through the FAP and where on the
    array it arrives; nothing of the exit pupil, or of cos^4, goes into it.
    """
    spots = design.D_F / 2 * np.array([r * np.array([np.cos(t), np.sin(t)]) for r in (0.3, 0.6, 0.9) for t in range(7)])

    def cosines(at):
        tangent = direction(design, spots, at)
        return tangent / np.hypot(1.0, np.hypot(*tangent.T))[:, np.newaxis]

    step = 1e-5 * np.eye(2)
    along, across = ((cosines(place + one) - cosines(place - one)) / 2e-5 for one in step)
    return float(np.mean(abs(np.linalg.det(np.stack([along, across], -1)))))


def straight(design, spots, at):
    """By similar triangles, to the array's image in the focal plane."""
    return (-at * design.d_f / design.d_1 - spots) / (design.d_f - design.d_3)


def barrel(design, spots, at):
    """The same angles as drawn by f theta: tan(h/f) in place of h/f."""
    slope = straight(design, spots, at)
    height = np.hypot(*slope.T)[:, np.newaxis]
    return slope / height * np.tan(height)


@pytest.mark.parametrize("d_3", [0.25, 0.7, 1.15, 2.0])
def test_the_corner_s_light_is_the_scene_s_whatever_the_exit_pupil_and_remedies_keep_their_word(d_3):
    """A sum over rays for the figure; the camera with the smaller sensor, and rays of f theta, for its remedies."""
    tip = roslf.loads(TIP).replace(d_3=d_3)  # from an exit pupil before the lens over none at all to one behind it
    grown = roslf.evaluate(tip).answer
    share = math.tan(math.radians(40)) / math.tan(math.radians(grown.field_of_view_deg.diagonal / 2))
    tip = tip.replace({"sensor.size": [share * side for side in tip.sensor.size], "microlens_array.size": [3.0, 3.0]})
    answer = roslf.evaluate(tip).answer
    assert answer.field_of_view_deg.diagonal == pytest.approx(80, abs=0.2)
    corner = FieldImages.of(tip).points[-1]
    place = np.array(corner.x_ml_mm)
    by_rays = etendue(tip, place, straight) / etendue(tip, np.array([1e-4, 1e-4]), straight)
    assert answer.corner_light == pytest.approx(by_rays, rel=0.01)
    assert answer.corner_light == pytest.approx(math.cos(math.radians(corner.angle_deg)) ** 4, rel=1e-6)
    assert "no place of the exit pupil evens it" in answer.corner_evened_by
    narrow = float(answer.corner_evened_by.partition("a field of ")[2].split()[0])
    less = math.tan(math.radians(narrow / 2)) / math.tan(math.radians(answer.field_of_view_deg.diagonal / 2))
    smaller = tip.replace({"sensor.size": [less * side for side in tip.sensor.size]})
    assert 0.5 <= roslf.evaluate(smaller).answer.corner_light < 0.52
    theta = math.radians(corner.angle_deg)
    place *= theta / math.tan(theta)
    by_rays = etendue(tip, place, barrel) / etendue(tip, np.array([1e-4, 1e-4]), barrel)
    assert f"f theta leaves {100 * by_rays:.2g}" in answer.corner_evened_by
    required = f'required = {{field_of_view_deg = {{min = "{narrow + 1} deg"}}}}'
    held = roslf.evaluate(roslf.loads(roslf.dumps(tip).replace("\n", f"\n{required}\n", 1))).answer
    assert "allows no smaller sensor; an objective" in held.corner_evened_by


def test_a_corner_lighter_than_the_middle_is_told_with_where_its_light_comes_from(without_views):
    """Etendue: light is cos^4 times the scene's area over the array's, a microlens's share of what is drawn smaller."""
    bench = roslf.load("paper-singlet")
    result, (middle, edge, corner) = roslf.evaluate(bench), FieldImages.of(bench).points
    area = middle.local_magnification / edge.local_magnification / (1 + edge.distortion_percent / 100)
    slant = math.cos(math.radians(edge.angle_deg)) ** 4
    assert edge.relative_illumination == pytest.approx(area * slant, rel=0.03)  # of the chief ray alone
    assert corner.relative_illumination == pytest.approx(result.answer.corner_light, rel=1e-12)
    assert result.answer.corner_light > 2
    (verdict,) = [verdict for verdict in result.verdicts if verdict.name == "corner_lit"]
    assert "stops brighter" in verdict.text
    assert "draws the scene smaller there" in verdict.text
    (words,) = (words for name, _, words in result.answer.rows if name == "light in the corner")
    assert "draws the scene smaller there" in words


@pytest.mark.parametrize("at", [0.0, -3.0, math.nan, math.inf])
def test_distances_behind_the_tip_are_refused(at):
    for function in (roslf.evaluate, roslf.specification):
        with pytest.raises(InputError, match="ahead of the bore's tip"):
            function(PAPER, at=(at,))


def test_a_lens_that_is_not_sharp_in_the_corner_is_told_by_the_data_sheet_s_figures(without_views):
    singlet = roslf.load("paper-singlet")
    result, sheet = roslf.evaluate(singlet), roslf.specification(singlet)
    rows = [row for row in sheet.resolution if (row.plane, row.image) == (FOCUS, "refocused")]
    assert result.answer.at[0].usable_lp_per_mm == rows[0].usable_lp_per_mm
    assert result.answer.corner_lp_per_mm == min(row.usable_lp_per_mm for row in rows) < rows[0].usable_lp_per_mm / 2
    (verdict,) = [verdict for verdict in result.verdicts if verdict.name == "sharp_over_field"]
    assert verdict.level == "limit"
    assert f"{result.answer.corner_lp_per_mm:.3g} lp/mm in the corner" in verdict.text
    thin = roslf.evaluate(singlet.thin_twin)
    assert thin.answer.corner_lp_per_mm == pytest.approx(thin.answer.at[0].usable_lp_per_mm)
    assert not [verdict for verdict in thin.verdicts if verdict.name == "sharp_over_field"]


def test_a_stop_that_cuts_the_middle_too_is_named_there_and_dims_it():
    """Light in the corner counts against what the middle gets, and verdicts say whose light, depth and MTF are."""
    result = roslf.evaluate(roslf.load("rigid-scope").replace({"stops": [{"diameter": 0.21, "distance": 0.9}]}))
    middle, _, corner = (field.kept_fraction for field in result.fields)
    assert result.answer.corner_light == pytest.approx(result.answer.corner_slant * corner / middle, rel=1e-6)
    (verdict,) = (one for one in result.verdicts if one.name == "field_undistorted")
    assert f". Even in the middle stop 1 leaves {100 * middle:.0f} % of an image." in verdict.text
    assert "Even in the middle" not in roslf.evaluate("rigid-scope").everything


def test_a_distance_that_prints_as_the_focal_plane_s_has_one_row():
    plane = roslf.evaluate("video-otoscope").answer.working_distance_mm
    for asked, rows in ((plane * (1 + 1e-6), 1), (plane * 1.01, 2)):
        assert len(roslf.evaluate("video-otoscope", at=asked).answer.at) == rows
