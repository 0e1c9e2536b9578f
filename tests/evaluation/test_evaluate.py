import dataclasses
import json
import math
import pickle
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.catalogue import load_catalogue
from roslf_design.catalogue.entries import other_focal_length
from roslf_design.cli import main
from roslf_design.commands.report import maker
from roslf_design.design import DesignError
from roslf_design.errors import InputError
from roslf_design.evaluation.fields import evaluate_fields, rays_for
from roslf_design.evaluation.groups import RayBudget, Share
from roslf_design.evaluation.part_verdicts import FASTEST_ARRAY, lens_speed
from roslf_design.evaluation.result import budget_table, seen_table
from roslf_design.evaluation.verdicts import _field_remedy, _thin
from roslf_design.reporting.blocks import Table
from roslf_design.reporting.design.pages import _accuracy_section
from roslf_design.reporting.design.parts_list import parts_section
from roslf_design.theory.light import sensor_field
from roslf_design.theory.photometry import eye_response
from roslf_design.theory.stop_images import MicrolensImages
from roslf_design.theory.vignetting import field_limit, lit_radius
from tests.laws import DEAR
from tests.pictures.designs import UNLIKE

PAPER = roslf.load("paper")

CONTRACT = {
    "aperture_constant": 1.52174,
    "inverse_aperture_constant": 0.657143,
    "exit_pupil": {"distance_from_lens_mm": 600.0, "vergence_at_mla_per_mm": -0.0021739, "telecentric": False},
    "f_number": {
        "microlens": 31.746,
        "pupil": 31.724,
        "main_lens": 2.7559,
        "fill_factor": 1.00506,
        "mismatch_px": 0.0655,
    },
    "non_distortion": {
        "x0_max_mm": 44.4542,
        "x_ml_max_mm": 17.7817,
        "field_half_width_mm": 27.997,
        "field_half_diagonal_mm": 33.693,
        "undistorted_in_field": True,
    },
    "microlens_image": {
        "diameter_mm": 0.0630435,
        "diameter_px": 13.0044,
        "pitch_mm": 0.0627261,
        "centre_shift_px_per_microlens": 0.242152,
    },
    "fields": [
        {
            "x_ml_mm": [11.15, 0.0],
            "area_mm2": 0.0031215,
            "kept_fraction": 1.0,
            "centroid_mm": [-0.0484783, 0.0],
            "ray_budget": {"fap": 1.0, "main_lens": 1.0, "own_cell": 0.9991},
        }
    ],
    "sampling": {
        "views_geometric": 13.0,
        "views_independent": 3.6,
        "lateral_samples": 355,
        "object_sample_mm": 0.1575,
        "view_baseline_mm": 0.223000,
    },
    "depth": {"disparity_pitches_per_mm": 0.080056, "sigma_z_mm": 1.2491, "sigma_disparity_pitches": 0.1},
    "diffraction": {"fresnel_number": 0.902, "airy_radius_px": 4.394},
}
"""The public contract's own example, to the digits that it prints."""


def assert_matches(ours, printed, place=""):
    """Compare with printed numbers: off by less than a unit in the last digit, for some are cut rather than rounded."""
    if isinstance(printed, dict):
        for key, value in printed.items():
            assert_matches(ours[key], value, f"{place}.{key}")
    elif isinstance(printed, list):
        assert len(ours) == len(printed), place
        for index, value in enumerate(printed):
            assert_matches(ours[index], value, f"{place}.{index}")
    elif isinstance(printed, float):
        digits = len(repr(printed).split(".")[1])
        assert abs(ours - printed) < 10.0**-digits, f"{place}: {ours} against {printed}"
    else:
        assert ours == printed, place


@pytest.fixture(scope="module")
def paper():
    return PAPER


def test_the_contracts_example(paper):
    # Its depth is told for a given disparity error.
    ours = roslf.evaluate(paper.replace({"depth.disparity_error": 0.1}), [11.15]).to_dict()
    assert_matches(ours, CONTRACT)
    effects = {effect["name"]: effect for effect in ours["effects"]}
    diffraction = effects["microlens_diffraction"]
    assert (round(diffraction["estimate"], 1), diffraction["unit"], diffraction["budget"]) == (3.6, "px", 0.1)
    assert diffraction["on"] is True
    assert diffraction["reason"]


def test_default_fields_are_centre_edge_corner(paper):
    places = [field.x_ml_mm for field in roslf.evaluate(paper).fields]
    grow = 1 - 2 * 0.00217391304347826  # 1 + d_2/L
    edge, corner = (side / 2 / grow - 0.063 / 2 for side in (22.3, 14.932))
    assert_allclose(places, [(0, 0), (edge, 0), (edge, corner)], rtol=1e-12)


@st.composite
def decentred(draw):
    """Cameras with array, sensor, lens and pupil aside; the rest of the light's way is centred on the lens or it."""
    aside = st.tuples(*[st.floats(-8, 8)] * 2)
    lens = draw(aside)
    moved = {"main_lens.decentre": lens, "aperture.decentre": lens}
    moved |= {f"{part}.decentre": draw(aside) for part in ("microlens_array", "sensor")}
    side = draw(st.floats(5, 20)), draw(st.floats(5, 20))
    return PAPER.replace(
        {**moved, "microlens_array.size": side, "sensor.size": (draw(st.floats(5, 20)), draw(st.floats(5, 20)))},
        d_3=draw(st.floats(20, 320)), D=draw(st.floats(10, 60)), d_2=draw(st.floats(0.5, 4)),
    )  # fmt: skip


@given(decentred())
@DEAR
def test_verdict_of_the_field_is_that_of_the_microlenses_on_the_sensor(design):
    """Of all microlenses whose images' centres lie on the sensor, those at the border the camera's worst."""
    camera = Camera.of(design)
    x, y = (np.linspace(-side / 2, side / 2, 161) for side in design.microlens_array.size)
    images = MicrolensImages(camera, np.stack(np.meshgrid(x, y), -1).reshape(-1, 2))
    at = np.abs(np.stack([np.ravel(p) for p in images.chief]))
    on_sensor = np.all(at <= np.reshape(design.sensor_size, (2, 1)) / 2, axis=0)
    if not on_sensor.any():
        return
    least = float(np.ravel(images.clearance)[on_sensor].min())
    field = roslf.evaluate(design.replace({"depth.disparity_error": 0.1}), []).non_distortion  # depth is most of it
    step = 2 * max(x[1] - x[0], y[1] - y[0]) * float(camera.inverse_m) * design.d_3 / float(camera.gap)
    assert least - step <= field.room_at_corner_mm <= least + 1e-9
    shown, room = images.fields[on_sensor], 2 * (x[1] - x[0])
    width = 2 * field.field_half_width_mm / float(camera.inverse_m)
    if float(lit_radius(camera)) >= float(sensor_field(camera).radius):
        assert_allclose(width, np.ptp(shown[:, 0]), atol=room)
    else:  # as far as it is lit
        assert width <= np.ptp(shown[:, 0]) + room


def test_array_and_sensor_aside_see_past_the_undistorted_field():
    """8 mm aside on the paper's bench: the corner is dark but for 12 %, and the field is called distorted."""
    aside = PAPER.replace({"microlens_array.decentre": (8.0, 0.0), "sensor.decentre": (8.0, 0.0)})
    result = roslf.evaluate(aside)
    assert [field.kept_fraction for field in result.fields] == pytest.approx([1.0, 0.6, 0.1], abs=0.03)
    assert not result.non_distortion.undistorted_in_field
    assert not result.verdicts[1].ok
    other = {f"{part}.decentre": (-8.0, 0.0) for part in ("microlens_array", "sensor")}
    mirrored = roslf.evaluate(PAPER.replace(other))
    assert [field.kept_fraction for field in mirrored.fields] == pytest.approx(
        [field.kept_fraction for field in result.fields], rel=1e-12
    )


@pytest.mark.parametrize("name", [*UNLIKE, "mismatched-borescope"])
def test_a_preset_gives_json_without_nan(name):
    result = roslf.evaluate(roslf.load(name))
    text = json.dumps(result.to_dict(), allow_nan=False)
    assert json.loads(text)["schema"] == "roslf.evaluation/1"
    assert pickle.loads(pickle.dumps(result)) == result
    assert result.design in result.everything
    assert "<table>" in result._repr_html_()


def test_telecentric_design_says_null_and_its_finite_twin(paper):
    result = roslf.evaluate(paper.replace(d_3=100.0))
    pupil = result.to_dict()["exit_pupil"]
    assert pupil["distance_from_lens_mm"] is None
    assert pupil["vergence_at_mla_per_mm"] == 0.0
    assert pupil["telecentric"] is True
    assert_allclose(result.microlens_image.pitch_mm, paper.d, rtol=3e-16)


def test_stop_at_the_lens_has_no_bound_but_a_room(paper):
    result = roslf.evaluate(paper.replace(d_3=0.0))
    field = result.to_dict()["non_distortion"]
    assert field["x0_max_mm"] is None
    assert_allclose(field["room_at_corner_mm"], (50.8 - 2.9) / 2, rtol=1e-14)


@pytest.mark.parametrize("name", [*UNLIKE, "paper-mismatched", "telecentric"])
def test_default_fields_image_onto_the_sensor(paper, name):
    design = paper.replace(d_3=100.0) if name == "telecentric" else roslf.load(name)
    for field in roslf.evaluate(design).fields:
        budget = field.ray_budget
        # A matched image lies in its cell but for the overlap, of one twice as wide a quarter; at the sensor's edge
        # half of that would be missing.
        assert budget.own_cell > (0.26 if "mismatched-" in name else 0.97 * field.kept_fraction)


def test_what_misses_the_sensor_is_not_in_its_cell():
    design = roslf.load("paper-mismatched")
    off, half, on = roslf.evaluate(design, [11.15, 11.15 / (1 + 2 * 0.0060606060606), 10.9]).fields
    assert off.kept_fraction == 1.0
    assert off.ray_budget.own_cell == 0.0
    assert_allclose(half.ray_budget.own_cell, 0.5, atol=1e-6)
    assert on.ray_budget.own_cell == pytest.approx(1.0, abs=1e-12)


def test_a_dark_field_is_told_not_hidden(paper):
    field = roslf.evaluate(paper, [40.0]).to_dict()["fields"][0]
    assert field["kept_fraction"] == 0.0
    assert field["area_mm2"] == 0.0
    assert field["centroid_mm"] is None
    assert field["ray_budget"]["own_cell"] == 0.0
    assert any("no light" in warning for warning in roslf.evaluate(paper, [40.0]).warnings)


def kept_by_counting(design, axis, rays=400):
    """Share of FAP points whose ray to the microlens passes lens and stops: forward, point by point."""
    grid = (np.arange(rays) + 0.5) / rays * 2 - 1
    x, y = np.meshgrid(grid, grid)
    inside = x * x + y * y <= 1
    start = np.stack([x[inside], y[inside]], -1) * design.D_F / 2 + design.aperture.decentre
    lens = np.asarray(design.main_lens.decentre)
    # From FAP point a with slope o the ray meets the lens at a + o d_3, bends by -(l - e)/f, and must end at c.
    gain = design.d_3 + design.d_1 - design.d_1 * design.d_3 / design.f
    slope = (np.asarray(axis) - lens - (start - lens) * (1 - design.d_1 / design.f)) / gain
    past = np.hypot(*(start + slope * design.d_3 - lens).T) <= design.D / 2
    passed = [past.mean()]
    for stop in design.stops:
        at = start + slope * (design.d_3 - stop.distance) - stop.decentre
        past &= np.hypot(*at.T) <= stop.diameter / 2
        passed.append(past.mean())
    return passed


@pytest.mark.parametrize("axis", [(0.0, 0.0), (11.0, 0.0), (18.5, 3.0), (20.0, 0.0)])
def test_kept_fractions_equal_counted_rays_with_stops_and_decentres(paper, axis):
    design = paper.replace(
        {
            "stops": [
                {"diameter": 12.0, "distance": 60.0, "decentre": (0.4, -0.2)},
                {"diameter": 9.0, "distance": 150.0},
            ],
            "main_lens.decentre": (0.3, 0.5),
            "aperture.decentre": (-0.2, 0.1),
        }
    )
    field = roslf.evaluate(design, [axis]).fields[0]
    counted = kept_by_counting(design, axis)
    # A grid of n x n points misses a curve's area by about n^-1.5: 1.3e-4 for 400.
    assert_allclose([field.ray_budget.main_lens, *field.ray_budget.stops], counted, atol=1e-3)
    assert_allclose(field.kept_fraction + field.lost_fraction, 1.0, atol=1e-15)


@pytest.mark.parametrize("changes", [{"d_3": 40.0}, {"D": 40.0}, {"D_F": 3.5}])
def test_the_bound_with_stops_is_where_the_first_image_is_cut(paper, changes):
    rim = {"diameter": 14.0, "distance": 60.0, "decentre": (0.4, 0.0)}
    design = paper.replace({"stops": [rim]}, **changes)
    bound = roslf.evaluate(design).non_distortion
    assert 0 < bound.x_ml_max_mm < math.inf
    around = [
        (bound.x_ml_max_mm * scale * math.cos(angle), bound.x_ml_max_mm * scale * math.sin(angle))
        for scale in (1 - 1e-9, 1 + 1e-9)
        for angle in (0.0, math.pi / 2, math.pi, 1.0)
    ]
    fields = roslf.evaluate(design, around).fields
    assert all(field.status == "full" for field in fields[:4])
    assert any(field.status == "clipped" for field in fields[4:])


def test_warnings_name_what_is_odd(paper):
    wide = paper.replace({"sensor.size": (30.0, 14.0)})
    assert any("sensor is 30 mm wide" in warning for warning in roslf.evaluate(wide).warnings)
    assert roslf.evaluate(wide).fields[1].x_ml_mm == (11.5, 0.0)
    packed = paper.replace({"microlens_array.layout": "hexagonal"})
    assert any("overlap in a hexagonal layout" in warning for warning in roslf.evaluate(packed).warnings)
    assert any("beyond the MLA" in warning for warning in roslf.evaluate(paper, [13.0]).warnings)
    coarse = roslf.evaluate(paper.replace({"sensor.pixel": 2.4})).warnings
    assert any("wider than a microlens" in warning and "2.4 um meant?" in warning for warning in coarse)
    wide = roslf.evaluate(paper.replace({"sensor.pixel": 0.06})).warnings
    assert any("60 um" in warning and "check sensor.pixel" in warning for warning in wide)
    assert len(wide) == 1
    overlapping = roslf.evaluate(paper.replace({"aperture.diameter": 1.6 * paper.D_F})).warnings
    assert any("% of the pixels saturate, where light of neighbouring images adds up" in text for text in overlapping)
    assert not roslf.evaluate(paper).warnings
    (full,) = roslf.evaluate(paper.replace({"light.exposure": 1.0})).warnings
    (fits,) = re.findall(r"light.exposure of ([\d.]+) ms or less", full)
    assert not roslf.evaluate(paper.replace({"light.exposure": 1e-3 * float(fits)})).warnings
    apart = paper.replace({"aperture.diameter": 0.95 * paper.D_F})
    for changes in ({"light.exposure": 1.8e-3 * float(fits)}, {"light.veil": 0.45}):  # no neighbour's light
        (full,) = roslf.evaluate(apart.replace(changes)).warnings
        assert "neighbouring" not in full
        assert "light.exposure" in full


@pytest.mark.parametrize(
    ("nanometres", "seen"), [(450, 0.038), (490, 0.208), (507, 0.444), (530, 0.862), (650, 0.107), (690, 0.0082)]
)
def test_lux_of_light_that_the_eye_hardly_sees_are_told_as_the_watts_they_would_be(paper, nanometres, seen):
    """By the CIE's V of 1924 (ISO 23539): 1e5 lx on 30 % are 1e5 * 0.3 / (683 pi V) W/m2/sr of that light alone."""
    design = paper.replace({"light.wavelength": 1e-6 * nanometres})
    assert float(eye_response(1e-6 * nanometres)) == pytest.approx(seen, rel=0.06)
    said = [one for one in roslf.evaluate(design).warnings if "lx count as light of 555 nm" in one]
    assert len(said) == (seen < 0.5)
    if said:
        (value,) = re.findall(r'radiance = "(\S+) W/m2/sr"', said[0])
        assert float(value) == pytest.approx(1e5 * 0.3 / (683 * math.pi * seen), rel=0.1)
        stated = design.replace({"light.radiance": 4.0})
        assert not any("555 nm" in one for one in roslf.evaluate(stated).warnings)


def test_lux_of_light_that_nobody_sees_have_no_radiance(paper):
    (said,) = [one for one in roslf.evaluate(paper.replace({"light.wavelength": 850e-6})).warnings if "555 nm" in one]
    assert "sees next to nothing" in said
    assert said.endswith("State light.radiance")


def test_a_focal_length_beside_a_part_that_has_another_is_told(paper):
    for part, told in (("AC050-010-A", True), ("quote 118", False)):
        own = {"main_lens.focal_length": paper.f, "main_lens.diameter": paper.D}
        design = paper.replace({"main_lens.part": part, **own})
        first = roslf.evaluate(design).verdicts[0]  # before all that it makes the verdicts of another camera
        assert (first.name == "main_lens_as_named" and "AC050-010-A of 10 mm" in first.text) is told
    assert other_focal_length("AC050-010-A", 9.9) is None


def test_depth_that_overlapping_images_cannot_tell_is_none_and_says_why(paper):
    """Images of the mismatched borescope are 2.08 pitches wide: by its own light pixels of 3.4 microlenses are full."""
    design = roslf.load("mismatched-borescope")
    result = roslf.evaluate(design)
    assert math.isinf(result.depth_budget.u_z_mm)
    assert math.isfinite(result.depth.sigma_z_mm)
    assert re.search(r"none +pixels are full", result.everything)
    term = next(term for term in result.to_dict()["depth"]["expected"]["terms"] if term["name"] == "image overlap")
    assert term["u_mm"] is None
    assert "light of 3.4 microlenses adds up" in term["remark"]
    dim = roslf.evaluate(design.replace({"light.exposure": 0.3 * result.depth.assumes.exposure_s}))
    assert math.isfinite(dim.depth_budget.u_z_mm)
    assert "image overlap" not in dim.everything
    given = roslf.evaluate(design.replace({"depth.disparity_error": 0.05}))
    assert math.isfinite(given.depth_budget.u_z_mm)
    assert "image overlap" not in roslf.evaluate(paper).everything
    packed = paper.replace({"microlens_array.layout": "hexagonal", "aperture.diameter": 1.4 * paper.D_F})
    assert math.isinf(roslf.evaluate(packed).depth_budget.u_z_mm)


@pytest.mark.parametrize(("name", "wider"), [("paper", 2.2), ("paper-singlet", 1.6)])
def test_no_depth_is_told_where_nothing_tells_texture_and_views_apart(name, wider):
    """Images wider than any that were measured; behind a real lens all that have to be told apart one by one."""
    design = roslf.load(name)
    design = design.replace({"aperture.diameter": wider * design.aperture.diameter, "light.exposure": 1e-4})
    budget = roslf.evaluate(design).depth_budget
    assert math.isinf(budget.u_z_mm)
    assert "cannot be told apart" in budget.largest.remark


def test_an_ideal_lens_beyond_a_double_gauss_of_f_1_4_over_46_degrees_says_so():
    """Smith, Modern Lens Design, p. 335: aperture by field, (D/d_1) (h/d_1), is there tan(23 deg)/1.4."""
    scope = roslf.load("rigid-scope")
    tangent = roslf.evaluate(scope).non_distortion.field_half_diagonal_mm / scope.d_f
    bound = math.tan(math.radians(23)) / 1.4 * scope.d_1 / tangent

    def told(scale):
        result = roslf.evaluate(scope.replace({"main_lens.diameter": scale * bound}))
        return [verdict for verdict in result.verdicts if verdict.name == "lens_speed"]

    assert told(0.999) == []
    (beyond,) = told(1.001)
    assert (beyond.ok, beyond.level) == (False, "limit")
    assert f"ideal lens: f/{scope.d_1 / (1.001 * bound):.3g} over " in beyond.text
    assert "1 times the aperture by field of a double Gauss" in beyond.text.partition("; ")[0]  # in brief
    assert not any(verdict.name == "lens_speed" for verdict in roslf.evaluate("paper-singlet").verdicts)


@pytest.mark.parametrize(("f_number", "told"), [(0.899, True), (0.901, False)])
def test_a_lens_faster_than_any_that_is_sold_is_an_idealisation_however_small_its_field(f_number, told):
    design = roslf.load("paper").replace({"sensor.size": (2.0, 2.0)})
    fast = design.replace({"main_lens.diameter": design.d_1 / f_number})
    verdicts = [verdict for verdict in roslf.evaluate(fast).verdicts if verdict.name == "lens_speed"]
    assert ["idealisation: hardly any lens faster than f/0.9" in verdict.text for verdict in verdicts] == [True] * told
    scope = {verdict.name: verdict for verdict in roslf.evaluate("rigid-scope").verdicts}["lens_speed"]
    assert "an idealisation" in scope.text.partition("; ")[0]  # in brief


def test_a_round_field_s_ideal_lens_is_judged_at_its_rim():
    """The chief ray of half the angle meets the lens at h = d_3 tan(w), and the array d_1 behind it."""
    scope = roslf.load("rigid-scope")
    asked = roslf.dumps(scope).partition("[required]")[0] + "[required]\nround_field_of_view_deg = {min = 30}\n"
    design = roslf.loads(asked)
    slope = math.tan(math.radians(15))
    rim = design.d_3 * slope / design.d_1 + slope * (1 - design.d_3 / design.f)
    (told,) = lens_speed(design, Camera.of(design))
    assert f"over {2 * math.degrees(math.atan(rim)):.3g} degrees as the lens's own middle sees the rim" in told.text
    beyond = rim * design.D / design.d_1 / (math.tan(math.radians(23)) / 1.4)
    assert f"{beyond:.3g} times the aperture" in told.text


@pytest.mark.parametrize(("radius", "told"), [(4.27, True), (4.7, True), (4.25, False)])
def test_an_ideal_lens_that_chief_rays_meet_far_off_its_axis_is_an_idealisation(radius, told):
    """Similar triangles: a point 23 mm before the FAP, which stands 45 mm before a lens of f = 30 mm."""
    lens = {"diameter": 22.86, "focal_length": 30.0, "focal_plane": 67.5}
    changes = {"main_lens": lens, "microlens_array.distance": None, "aperture": {"diameter": 0.5, "distance": 45.0}}
    limit = {"round_field_radius_mm": {"at": 23.0, "min": radius}}
    design = roslf.load("paper").replace({**changes, "required": limit})
    verdicts = lens_speed(design, Camera.of(design))
    height = radius * 45.0 / 23.0
    assert [one.name for one in verdicts] == ["lens_speed"] * told
    assert told == (30.0 / (2 * height) < 1.8 * (1 + 1e-3))
    for one in verdicts:
        assert f"meet the lens {height:.3g} mm off its axis" in one.text
        assert f"of its radius, where it is f/{30.0 / (2 * height):.3g}" in one.text


def test_microlenses_faster_than_any_in_the_catalogue_say_so():
    arrays = load_catalogue([], shipped=True).microlens_arrays
    fastest = min(one.focal_length / one.pitch for one in arrays)
    assert math.floor(fastest) == FASTEST_ARRAY
    scope = roslf.load("rigid-scope")

    def told(f_number):
        focal = f_number * scope.microlens_array.pitch
        result = roslf.evaluate(scope.replace(f_ml=focal))
        return [verdict for verdict in result.verdicts if verdict.name == "microlens_speed"]

    assert told(3.0) == []
    (fast,) = told(1.5)
    assert (fast.ok, fast.level) == (False, "limit")
    assert fast.text.startswith("microlenses of f/1.5 (f_ml = 30 um, pitch 20 um)")
    assert 'quantity = "f_number_microlens_lens", min = 3' in fast.remedy


@pytest.mark.parametrize(("diameter", "told"), [(None, True), (46.0, True), (45.72, False), (40.0, False)])
def test_a_real_lens_that_counts_to_its_mechanical_rim_is_remarked_on(diameter, told):
    singlet = roslf.load("paper-singlet").replace({"main_lens.diameter": diameter})
    verdicts = [one for one in roslf.evaluate(singlet).verdicts if one.name == "clear_aperture"]
    assert [one.level for one in verdicts] == ["limit"] * told
    assert all(one.remedy.startswith('main_lens.diameter = "45.72 mm"') for one in verdicts)
    table = next(block for block in parts_section(singlet).blocks if isinstance(block, Table))
    assert ("of which 45.72 mm is guaranteed" in table.rows[0][2]) == told


def test_behind_a_real_lens_the_f_number_s_verdict_says_which_fill_is_traced():
    """An optimum whose traced image fill is at its limit of 0.9 stood beside a fill of 0.88."""
    result = roslf.evaluate(roslf.load("paper-singlet"))
    verdict = next(one for one in result.verdicts if one.name == "f_number_matched")
    traced = result.f_number.fill_factor * (1 + result.real_lens.fields[0].widening_percent / 100)
    assert f"(thin-lens model; traced through {result.real_lens.lens} at 0, 0 mm: {traced:.4g})" in verdict.text


def test_a_lens_that_makes_images_smaller_narrows_them():
    result = roslf.evaluate(roslf.load("paper-singlet"))
    small = [dataclasses.replace(field, widening_percent=-12.4) for field in result.real_lens.fields]
    text = _thin(result.f_number, dataclasses.replace(result.real_lens, fields=tuple(small))).text
    assert "px and narrows it by 12.4 % (image fill" in text


def test_behind_a_real_lens_images_are_said_to_be_shifted_as_the_thin_twin_has_it():
    """By 12.7 px in the corner of the paper's singlet, where rays have 20."""
    texts = {one.name: one.text for one in roslf.evaluate("paper-singlet").verdicts}
    assert texts["field_undistorted"].endswith(
        ". Images are shifted by 12.7 px there by the thin-lens model, no fault once calibrated"
    )


def test_verdicts_and_remedies(paper):
    by_name = {verdict.name: verdict for verdict in roslf.evaluate(paper).verdicts}
    assert by_name["f_number_matched"].ok
    assert by_name["field_undistorted"].ok
    assert (by_name["views_resolved"].ok, by_name["views_resolved"].level) == (False, "limit")
    # 63^2/(4 x 0.55 x 2000) = 0.902 = N_F; 13.0 px/(8 N_F) = 1.80
    assert (
        "pixels up to 1.8 times as large sample all that passes, too (8 N_F = 7.22" in by_name["views_resolved"].remedy
    )
    coarse = {v.name: v for v in roslf.evaluate(paper.replace(q=0.0126)).verdicts}["views_resolved"]
    # 5.0 px across: more than the 3.6 views, fewer than the 7.2 samples that hold the band
    assert (coarse.level, "larger" in coarse.remedy.removeprefix("larger microlenses")) == ("limit", False)
    assert "finer pixels add no views, but detail, up to 8 N_F = 7.22" in coarse.remedy
    # A slip of units: 63 um across a microlens image are 0.01 pixels of 4.85 mm, so overlap is no half pixel's matter.
    slip = {v.name: v for v in roslf.evaluate(paper.replace(q=4.85, D_F=4.0)).verdicts}
    assert (slip["views_resolved"].level, slip["f_number_matched"].level) == ("fault", "fault")
    assert "check sensor.pixel: pixels are 4850 um wide, a microlens image " in slip["views_resolved"].remedy
    # It comes first, nothing that needs views has a value, and gaps far below a pixel are no match.
    asked = roslf.loads(roslf.dumps(paper.replace(q=4.85)) + '\n[required]\nu_z_mm = {max = "9 mm"}\n')
    result = roslf.evaluate(asked)
    told = {v.name: v for v in result.verdicts}
    assert (result.verdicts[0].name, result.has_views, result.matched) == ("views_resolved", False, False)
    assert (told["f_number_matched"].level, " px" in told["f_number_matched"].text) == ("limit", False)
    assert (result.required[0].value, result.answer.at[0].expanded_mm, result.to_dict()["depth"]["sigma_z_mm"]) == (
        None, None, None,
    )  # fmt: skip
    assert str(result).splitlines()[1].startswith("✗ no light-field camera")
    mismatched = {v.name: v for v in roslf.evaluate(roslf.load("paper-mismatched")).verdicts}
    assert not mismatched["f_number_matched"].ok


def test_remedies_do_mend(paper):
    import re

    mismatched = roslf.load("paper-mismatched")
    remedy = roslf.evaluate(mismatched).verdicts[0].remedy
    for symbol, value in re.findall(r"(d_2|D_F|d_3) = ([\d.]+) mm", remedy):
        mended = roslf.evaluate(mismatched.replace({}, **{symbol: float(value)}))
        assert abs(mended.f_number.fill_factor - 1) < 2e-4, symbol  # the remedy prints five digits
    narrow = paper.replace(D=14.0)
    verdict = roslf.evaluate(narrow).verdicts[1]
    assert not verdict.ok
    wider = float(re.search(r"main lens of ([\d.]+) mm", verdict.remedy)[1])
    assert roslf.evaluate(paper.replace(D=wider)).non_distortion.undistorted_in_field
    bore = roslf.load("mismatched-borescope")  # needs 30.023 mm, which four digits must not make less of
    wider = float(re.search(r"main lens of ([\d.]+) mm", roslf.evaluate(bore).verdicts[1].remedy)[1])
    assert roslf.evaluate(bore.replace(D=wider)).non_distortion.undistorted_in_field


def test_remedies_of_the_match_leave_microlenses_on_the_pupil():
    import re

    small = roslf.load("video-otoscope").replace(D_F=0.4 * roslf.load("video-otoscope").D_F)
    remedy = next(one.remedy for one in roslf.evaluate(small).verdicts if one.name == "f_number_matched")
    ways = re.findall(r"(d_2|D_F|d_3) = ([\d.]+) mm(?: with (f_ml) = ([\d.]+) mm)?", remedy)
    assert {symbol for symbol, *_ in ways} == {"d_2", "D_F"}  # d_3 would put the iris ahead of the window
    assert any(also for _, _, also, _ in ways)
    for symbol, value, also, focal in ways:
        alone = roslf.evaluate(small.replace(**{symbol: float(value)}))
        assert (alone.focused is not None) == bool(also), symbol  # f_ml is named where it has to follow
        mended = roslf.evaluate(small.replace(**{symbol: float(value)}, **({also: float(focal)} if also else {})))
        assert mended.focused is None, symbol
        assert abs(mended.f_number.fill_factor - 1) < 2e-4, symbol


def test_parts_of_which_there_are_several_have_no_article():
    told = [roslf.evaluate(name).verdicts for name in ("paper", "cystoscope")]
    texts = [one.text for verdicts in told for one in verdicts if one.name == "field_undistorted"]
    assert "limited by the main lens;" in texts[0]
    assert "limited by lens 2;" in texts[1]


def test_a_field_that_is_no_number_is_refused(paper):
    with pytest.raises(ValueError, match="not finite"):
        roslf.evaluate(paper, [math.nan])


TILTS = {
    "aperture.tilt": (0.02, -0.03),
    "main_lens.tilt": (0.01, 0.0),
    "microlens_array.tilt": (0.0, 0.002),
    "sensor.tilt": (0.001, 0.0),
}


@pytest.mark.parametrize("axis", [(0.0, 0.0), (11.15, 0.0), (19.0, 2.0), (60.0, 0.0)])
def test_counted_rays_of_a_hardly_tilted_design_give_the_exact_areas(paper, axis):
    rim = {"diameter": 12.0, "distance": 60.0, "decentre": (0.4, -0.2)}
    straight = paper.replace({"stops": [rim], "microlens_array.decentre": (0.1, 0.2), "microlens_array.rotation": 0.01})
    exact = roslf.evaluate(straight, [axis]).fields[0]
    counted = roslf.evaluate(straight.replace({"sensor.tilt": (1e-12, 0.0)}), [axis]).fields[0]
    assert exact.rays is None
    assert counted.rays == 65_536
    # Even samples of a disc miss a share by about N^-0.75, here 2.4e-4; thrice that is allowed.
    shares = [
        (f.kept_fraction, f.ray_budget.main_lens, *f.ray_budget.stops, f.ray_budget.own_cell) for f in (counted, exact)
    ]
    assert_allclose(*shares, atol=8e-4)
    assert (counted.status, counted.centroid_mm is None) == (exact.status, exact.centroid_mm is None)
    assert_allclose(counted.area_mm2, exact.area_mm2, atol=8e-4 * 0.0032)
    if exact.centroid_mm is not None:
        assert_allclose(counted.centroid_mm, exact.centroid_mm, atol=1e-5)
        assert_allclose(counted.axis_ratio, exact.axis_ratio, atol=1e-3)


def test_tilts_change_the_shape_as_perspective_says(paper):
    field = roslf.evaluate(paper.replace({"aperture.tilt": (0.0, 0.5)}), [0.0]).fields[0]
    # A FAP turned by 0.5 rad is narrowed by cos 0.5 seen from afar; depth over distance adds (0.7/230)^2.
    assert_allclose(field.axis_ratio, math.cos(0.5), rtol=1e-3)
    assert_allclose(field.area_mm2, math.pi / 4 * 0.0630435**2 * math.cos(0.5), rtol=1e-3)


def test_every_tilt_at_once_is_evaluated(paper):
    result = roslf.evaluate(paper.replace(TILTS))
    assert "counted from 65536 rays" in result.method
    json.dumps(result.to_dict(), allow_nan=False)


@pytest.mark.parametrize("tilt", [0.0, 0.01])
def test_the_budget_names_who_takes_what_and_adds_to_one(paper, tilt):
    design = paper.replace(
        {
            "stops": [{"diameter": 5.0, "distance": 200.0}, {"diameter": 12.0, "distance": 60.0}],
            "aperture.tilt": (tilt, 0.0),
        }
    )
    axis = (14.0, 3.0)
    budget = roslf.evaluate(design, [axis]).fields[0].ray_budget
    assert [share.name for share in budget.by_name] == [
        *("stop 1", "FAP", "stop 2", "main lens"),
        *("sensor", "own cell", "neighbours"),
    ]
    taken = dict(budget.taken())
    assert min(taken.values()) >= 0
    assert sum(taken.values()) == pytest.approx(1.0, abs=5e-16)  # a rounding or two
    past = {share.name: share.kept for share in budget.by_name}
    assert past["main lens"] == pytest.approx(budget.stops[-1], abs=1e-12)  # the last of either order passed them all
    alone = roslf.evaluate(
        design.replace({"stops": [{"diameter": 5.0, "distance": 200.0}], "main_lens.diameter": 1e3}), [axis]
    )
    assert past["stop 1"] == pytest.approx(alone.fields[0].ray_budget.stops[0], abs=1e-3)


# To an accuracy: more rays where they are counted, and shares within what was asked for.


@pytest.mark.parametrize("accuracy", [1e-1, 1e-2, 1e-3])
def test_counted_shares_are_within_the_accuracy_of_exact_ones(accuracy):
    rng = np.random.default_rng(8)
    for _ in range(6):
        tilt = (float(rng.normal(0, 0.03)), float(rng.normal(0, 0.03)))
        design = PAPER.replace({"main_lens.diameter": float(rng.uniform(14, 30)), "aperture.tilt": tilt})
        axis = (float(rng.uniform(2, 7)), float(rng.uniform(-3, 3)))
        exact = MicrolensImages(Camera.of(design), [axis]).shapes
        (field,) = evaluate_fields(design, [axis], rays_for(accuracy))
        # Rays fill the FAP evenly, areas are those on the sensor: they differ by the perspective of the tilt, 1e-3.
        assert abs(field.kept_fraction - exact.kept_fraction.item()) <= accuracy + 2e-3


def test_more_digits_take_more_rays():
    assert rays_for(1e-2) < rays_for(1e-3) < rays_for(1e-4)
    with pytest.raises(ValueError, match="straight designs are exact"):
        rays_for(1e-9)


def test_straight_designs_are_exact_whatever_is_asked():
    assert roslf.evaluate(PAPER, accuracy=1e-12).to_dict() == roslf.evaluate(PAPER).to_dict()


def test_result_tells_how_many_rays_and_how_far_off(tmp_path, capsys):
    tilted = PAPER.replace({"aperture.tilt": (0.02, 0.0)})
    path = tmp_path / "tilted.toml"
    roslf.save(tilted, path)
    result = roslf.evaluate(tilted, accuracy=5e-3)
    assert f"{rays_for(5e-3)} rays" in result.method
    assert "0.005" in result.method
    assert {field.rays for field in result.fields} == {rays_for(5e-3)}
    assert main(["evaluate", str(path), "--accuracy", "1e-9"]) == 2
    assert "--accuracy" in capsys.readouterr().err


@pytest.mark.parametrize("value", ["-1", "nan", "fine"])
def test_no_accuracy_is_one_line(value, capsys):
    assert main(["evaluate", "paper", "--accuracy", value]) == 2
    told = capsys.readouterr()
    assert "--accuracy" in told.err
    assert len(told.err.strip().splitlines()) == 1
    assert told.out == ""


def test_every_evaluation_carries_what_it_is_worth(tmp_path, capsys):
    assert main(["evaluate", "paper", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["accuracy"]
    assert told["expected_error"] <= 1e-12
    assert "seconds" not in told  # the same bytes every time
    path = tmp_path / "tilted.toml"
    roslf.save(PAPER.replace({"aperture.tilt": (0.02, 0.0), "main_lens.diameter": 9.0}), path)
    assert main(["evaluate", str(path), "--accuracy", "5e-3", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["accuracy"]
    assert told["kept"]
    assert 0 <= told["measured_error"] <= 5e-3
    assert told["seconds"] > 0
    assert main(["evaluate", "paper", "--accuracy", "5e-3"]) == 0
    known = "Arithmetic alone: rounding is below 1e-12 of each number; it says nothing of the camera built (asked"
    assert known in capsys.readouterr().out


def test_a_report_passes_it_on(tmp_path):
    tilted = PAPER.replace({"aperture.tilt": (0.02, 0.0)})
    path = tmp_path / "tilted.toml"
    roslf.save(tilted, path)
    for names, compare in (((str(path),), False), ((str(path), "paper"), True)):
        assert maker(names, compare, None, 0.01)[1].keywords["accuracy"] == 0.01
    section = _accuracy_section(tilted, roslf.evaluate(tilted, accuracy=0.01), 0.01)
    assert f"{rays_for(0.01)} rays" in str(section)
    assert "asked for 1 % of the light" in str(section)


@pytest.mark.parametrize("value", ["-1", "nan", "fine"])
def test_a_report_to_no_accuracy_is_refused(value, tmp_path, capsys):
    for line in (["report", "paper"], ["report", "--compare", "paper", "paper-mismatched"]):
        assert main([*line, "-o", str(tmp_path / "out"), "--accuracy", value]) == 2
        told = capsys.readouterr().err
        assert "--accuracy" in told
        assert len(told.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "fields",
    [[np.int64(3)], [np.float32(3)], [np.array(3.0)], np.array([3.0]), np.array(3.0), np.float64(3), 3, [(3, 0)]],
)
def test_fields_are_numbers_of_any_kind(fields):
    (field,) = roslf.evaluate("paper", fields).fields
    assert field.x_ml_mm == (3.0, 0.0)
    assert all(type(number) is float for number in field.x_ml_mm)


@pytest.mark.parametrize("field", ["a", None, (1, 2, 3), ()])
def test_what_is_no_field_is_told(field):
    with pytest.raises(ValueError, match=r"is no position; give x or \(x, y\) in mm on the MLA"):
        roslf.evaluate("paper", [field])


@pytest.mark.parametrize("symbol", ["D", "D_F", "d", "q", "d_2", "f_ml", "wavelength"])
def test_lengths_of_no_camera_are_told_and_extreme_ones_are_computed(symbol):
    """Products of lengths leave floating point: D_F = 1e-160 mm gave images of no number."""
    design = roslf.load("paper")
    for value in (1e-160, 1e160):
        with pytest.raises(DesignError, match="; write what the camera has"):
            design.replace(**{symbol: value})
    for value in (1e-12, 1.0 if symbol == "d" else 1e15):  # no pitch is wider than the array
        size = {"sensor.size": (value, value)} if (symbol, value) == ("q", 1e15) else {}
        roslf.evaluate(design.replace(size, **{symbol: value})).to_dict()


def test_a_real_lenss_faults_are_never_told_as_nothing():
    # Traced: object points spread over tens of pitches; only the uniform scene of the plan hides it.
    printed = " ".join(roslf.evaluate(roslf.load("paper-singlet")).everything.split())
    assert "nothing comes from" in printed
    absent = printed.split("nothing comes from: ")[1].split(".")[0]
    assert [name for name in ("aberrations", "distortion", "curvature", "colour") if name in absent] == []
    assert "field curvature 0 pitch" in printed
    ideal = " ".join(roslf.evaluate(roslf.load("paper")).everything.split()).split("nothing comes from: ")[1]
    assert "lens aberrations" not in ideal.split(".")[0]
    assert "Not modelled, lenses being ideal: lens aberrations" in ideal


def test_what_stands_before_the_lens_is_told_with_a_ruler_and_as_it_is_seen():
    """By hand: a plate of 1 mm, index 1.5, in front of it water: each length over its index."""
    design = PAPER.replace(
        {
            "elements": [
                {"kind": "plate", "distance": 122.0, "thickness": 1.0, "material": {"index": 1.5}, "diameter": 8.0}
            ],
            "object_space.medium": {"index": 1.333},
            "main_lens.focal_plane": 423.0,
            "sensor.cover": {"thickness": 0.4, "material": {"index": 1.5}},
        }
    )
    result = roslf.evaluate(design)
    parts = {part["name"]: part for part in result.to_dict()["object_space"]["parts"]}
    assert list(parts) == ["focal plane", "plate 1", "FAP", "MLA", "sensor"]
    assert parts["focal plane"]["distance_mm"] == 423
    assert parts["focal plane"]["seen_distance_mm"] == pytest.approx(122 + 1 / 1.5 + 300 / 1.333)
    assert parts["plate 1"]["seen_distance_mm"] == 122
    assert (parts["FAP"]["diameter_mm"], parts["FAP"]["seen_diameter_mm"]) == pytest.approx((2.9, 2.9))
    assert parts["sensor"]["seen_distance_mm"] == pytest.approx(2 - 0.4 * (1 - 1 / 1.5))
    rows = {row[0]: row for row in seen_table(result).rows}
    assert rows["plate 1"][1:] == ("1 mm of n = 1.5", "122 mm", "8 mm", "")
    assert rows["focal plane"][4] == "347.72 mm"
    assert rows["FAP"][2:] == ("120 mm", "2.9 mm", "")
    budget = budget_table(result)  # of four rims, which take no light here
    assert [row[0] for row in budget.rows] == ["lost at all others (4)", "own cell", "neighbours"]
    assert "in n = 1.333" in result.everything
    assert "object_space" not in roslf.evaluate("paper").to_dict()


def test_what_an_element_takes_is_never_less_than_nothing_in_words():
    """Shares past two elements are counted each for itself and may differ in their last digit, either way."""
    result = roslf.evaluate("paper")
    kept = (("FAP", 1.0), ("main lens", 0.9), ("stop 1", 0.9 + 2e-16), ("sensor", 0.9), ("own cell", 0.9))
    budget = RayBudget(1.0, 0.9, (0.9,), 0.9, tuple(Share(*one) for one in (*kept, ("neighbours", 0.0))))
    edge = dataclasses.replace(result.fields[0], ray_budget=budget)
    told = budget_table(dataclasses.replace(result, fields=(edge,)))
    assert told.rows[0][1:] == ("10.00 %", "0.00 %", "0.00 %", "90.00 %", "0.00 %")


@pytest.mark.parametrize(("across", "enough"), [(2.9, False), (3.1, True)])
def test_microlenses_without_neighbours_make_no_light_field_camera(across, enough):
    """Nothing is matched between microlenses that the sensor does not see."""
    paper = roslf.load("paper")
    side = across * float(roslf.evaluate(paper).microlens_image["pitch_mm"])
    result = roslf.evaluate(paper.replace({"sensor.size": (5 * side, side)}))
    (verdict,) = (verdict for verdict in result.verdicts if verdict.name == "views_resolved")
    assert result.has_views == enough
    assert ("microlens_array.pitch, 63 um" in verdict.remedy) != enough


def test_an_evaluation_s_values_at_a_distance_are_those_of_the_quantities_there():
    result, camera = roslf.evaluate("paper", at=200.0), Camera.of(roslf.load("paper"))
    for name in ("u_z_mm", "detail_lp_per_mm", "field_half_width_mm", "field_half_diagonal_mm"):
        expected = float(roslf.quantity(name, at=200.0)(camera))
        assert result.value(name, at="200 mm") == pytest.approx(expected, rel=1e-6)  # detail is searched for twice
    assert result.value("u_z_mm", at=result.answer.at[0].at_mm) == result.value("u_z_mm")
    with pytest.raises(ValueError, match=r"was not evaluated at 210 mm; give it to roslf.evaluate\(design, at=210\)"):
        result.value("u_z_mm", at=210.0)
    with pytest.raises(
        ValueError, match=r"holds no sigma_z_mm at 200 mm .*; ask roslf.quantity\('sigma_z_mm', at=200\)"
    ):
        result.value("sigma_z_mm", at=200.0)
    with pytest.raises(InputError, match="not ahead of the bore's tip"):
        result.value("u_z_mm", at=-1.0)


def test_a_distance_asked_for_twice_or_in_focus_stands_once():
    answer = roslf.evaluate("paper", at=[230.0, 200.0, 200.0]).answer
    assert [row.at_mm for row in answer.at] == pytest.approx([230.0, 200.0])
    assert roslf.evaluate("paper").value("u_z_mm") == answer.at[0].u_z_mm


def test_parts_of_a_warm_camera_are_told_at_one_temperature():
    """Distances as well as diameters are the file's own, at 20 degrees C, as drawings have them."""
    plate = {"kind": "plate", "distance": 122.0, "thickness": 1.0, "material": "sapphire", "diameter": 8.0}
    design = PAPER.replace({"elements": [plate], "main_lens.focal_plane": 423.0})
    text = '[environment]\ntemperature = "60 degC"\nhousing = "titanium"\n'
    result = roslf.evaluate(roslf.loads(f"{roslf.dumps(design)}\n{text}"))
    rows = {row[0]: row for row in seen_table(result).rows}
    assert (rows["plate 1"][2], *rows["FAP"][2:4]) == ("122 mm", "120 mm", "2.9 mm")
    assert rows["focal plane"][2] == "423 mm"


def test_a_field_beyond_a_bought_lens_s_clear_aperture_asks_for_another_lens():
    lens = roslf.load("paper-singlet").replace({"main_lens.prescription": "AC508-100-A"})
    for diameter, pupil, another in ((14.0, 2.9, False), (40.0, 30.0, True)):
        camera = Camera.of(lens.replace(D=diameter, D_F=pupil))
        limit = field_limit(camera)
        remedy = _field_remedy(camera, limit.cuts)
        assert ("another main lens (this one's is 45.72 mm), of " in remedy) == another
