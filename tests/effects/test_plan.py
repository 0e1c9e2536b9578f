import dataclasses
import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar

from roslf_design.camera import Camera
from roslf_design.design import load
from roslf_design.effects import EFFECTS, Budget, PlanError, SceneBrief, plan
from roslf_design.effects.effect import Subject
from roslf_design.effects.lens import RADII, lens_aberrations
from roslf_design.effects.waves import footprint
from roslf_design.theory.f_number import matched
from roslf_design.theory.light import fresnel_number, microlens_defocus_waves
from roslf_design.theory.vignetting import room_at
from roslf_design.traced.images import real_field

PAPER = load("paper")
EDGE = SceneBrief(field_radius=11.15)
TEXTURE = SceneBrief(field_radius=11.15, smallest_period=1.0, distances=(320.0, 320.0))


@pytest.mark.parametrize(
    ("name", "expected", "unit", "brief"),
    [
        ("pupil_geometry", -10.0, "px", EDGE),
        ("vignetting", 0.0, "px", EDGE),
        ("microlens_diffraction", 3.6017, "px", EDGE),
        ("fap_diffraction", 0.33788, "pitch", TEXTURE),
        ("microlens_defocus", 0.056502**2 / (0.056502 + 36.017), "px", EDGE),
        ("microlens_defocus", 0.056502, "px", SceneBrief(field_radius=11.15, wavelengths=(1e-12,))),
        ("pixel_integration", 0.0861, "intensity", EDGE),
        ("overlap", 0.0655, "px", EDGE),
        ("object_defocus", 2.762, "pitch", TEXTURE),
        ("cos4", 0.02874, "intensity", EDGE),
    ],
)
def test_paper_design_magnitudes(name, expected, unit, brief):
    line = plan(PAPER, brief)[name]
    assert line.estimate == pytest.approx(expected, rel=6e-4)  # the table's own digits
    assert line.unit == unit


def test_paper_design_side_magnitudes():
    assert microlens_defocus_waves(Camera.of(PAPER)) == pytest.approx(0.00196, rel=5e-3)
    assert fresnel_number(Camera.of(PAPER)) == pytest.approx(0.902, rel=5e-4)
    assert footprint(Camera.of(PAPER), PAPER.d_f) == pytest.approx(0.1575, rel=1e-12)


def test_rotation_moves_the_edge_by_2_3_pixels_per_milliradian():
    turned = PAPER.replace({"microlens_array.rotation": 1e-3})
    assert plan(turned, EDGE)["mla_rotation"].estimate == pytest.approx(2.3, rel=1e-3)


def test_default_scene_is_white_in_focus_and_noiseless():
    lines = plan(PAPER)
    assert [line.name for line in lines] == [effect.name for effect in EFFECTS]
    off = {line.name for line in lines if not line.on}
    assert {"noise", "object_defocus", "finite_microlens_aperture", "fap_diffraction", "lens_colour"} <= off
    assert lines.on("microlens_diffraction")
    assert lines.on("pupil_geometry")


def test_overlap_is_needed_where_blur_reaches_neighbours():
    assert plan(PAPER).on("overlap")
    assert not plan(PAPER, overrides=["-microlens_diffraction", "-overlap"]).on("overlap")
    sharp = PAPER.replace(wavelength=1e-9)
    assert not plan(sharp).on("overlap")


def test_rounding_is_no_gap_and_no_blur():
    """Lengths that Eq. 7 and the microlenses' image equation were solved for; half a pixel more is told."""
    camera = Camera.of(PAPER)
    exact = PAPER.replace(D_F=float(matched(camera, "D_F").value))
    for width in (-3e-14, -0.0, 2e-15):
        reason = plan(exact.replace(D_F=exact.D_F + width))["overlap"].reason
        assert reason.startswith("images just touch")
    assert "short of each other" in plan(exact.replace(D_F=0.96 * exact.D_F))["overlap"].reason
    focused = PAPER.replace(f_ml=1 / (1 / camera.d_2 + camera.seen.vergence) * (1 + 4e-16))
    assert plan(focused)["microlens_defocus"].reason.startswith("ray blur 0 px, 0 waves")


def test_overrides_apply_in_order():
    there = {effect.name for effect in EFFECTS if effect.available(PAPER)}
    assert {line.name for line in plan(PAPER, overrides=["all"]) if line.on} == there
    bare = plan(PAPER, overrides=["none", "+cos4"])
    assert {line.name for line in bare if line.on} == {"pupil_geometry", "pixel_integration", "cos4"}


@pytest.mark.parametrize(
    ("override", "part"),
    [
        ("+cos5", "did you mean 'cos4'"),
        ("-microlens_difraction", "did you mean 'microlens_diffraction'"),
        ("cos4", "+name or -name"),
        ("-pupil_geometry", "never left out"),
        ("+lens_distortion", "ideal"),
        ("+qqqq", "known are pupil_geometry"),
    ],
)
def test_bad_overrides_name_the_remedy(override, part):
    with pytest.raises(PlanError) as error:
        plan(PAPER, overrides=[override])
    assert part in str(error.value)


def test_budgets_must_be_numbers():
    with pytest.raises(PlanError, match=r"budget\.px"):
        Budget(px=math.nan)
    with pytest.raises(PlanError, match=r"budget\.intensity"):
        Budget(intensity=-0.01)


@pytest.mark.parametrize(
    "fault",
    [
        {"smallest_period": -1.0},
        {"exposure": 0.0},
        {"exposure": math.inf},
        {"read_noise": -1.0},
        {"wavelengths": (0.0,)},
    ],
)
def test_briefs_must_make_sense(fault):
    with pytest.raises(ValueError, match=next(iter(fault))):
        SceneBrief(**fault)


def test_object_inside_the_bore_is_refused():
    with pytest.raises(ValueError, match="not beyond the aperture"):
        plan(PAPER, SceneBrief(smallest_period=1.0, distances=(100.0, 300.0)))


def test_plan_is_a_value():
    assert plan(PAPER) == plan(PAPER)
    assert hash(plan(PAPER)) == hash(plan(PAPER))
    with pytest.raises(dataclasses.FrozenInstanceError):
        plan(PAPER)[0].on = False
    with pytest.raises(KeyError, match="cos4"):
        plan(PAPER)["cos"]


@given(st.floats(1e-3, 1e3))
def test_scaling_every_length_changes_no_estimate(scale):
    """Pixels, pitches and fractions are ratios of lengths, so a camera twice as large has the same plan."""
    keys = ("D", "f", "d_f", "D_F", "d_3", "d", "f_ml", "d_2", "q", "wavelength")
    size = {"sensor.size": [22.3 * scale, 14.932 * scale], "microlens_array.size": [23 * scale, 23 * scale]}
    scaled = PAPER.replace(size, **{key: getattr(PAPER, key) * scale for key in keys})
    brief = SceneBrief(smallest_period=2.0, distances=(300.0, 400.0))
    twin = SceneBrief(smallest_period=2.0 * scale, distances=(300.0 * scale, 400.0 * scale))
    for one, other in zip(plan(PAPER, brief), plan(scaled, twin), strict=True):
        assert other.estimate == pytest.approx(one.estimate, rel=1e-9, abs=1e-9)


@given(st.floats(0, 30), st.floats(0, 30))
def test_vignetting_grows_with_the_field_and_starts_at_the_margin(one, other):
    small = PAPER.replace(D=20.0)
    near, far = sorted((one, other))
    cuts = [plan(small, SceneBrief(field_radius=radius))["vignetting"].estimate for radius in (near, far)]
    assert cuts[0] <= cuts[1] + 1e-9
    margin = 20.0 * 230 - 2.9 * 350 - 2 * far * 350 / 140 * 120
    assert (cuts[1] > 1e-9) == (margin < -1e-6)


@given(st.floats(5, 60), st.floats(0, 15), st.floats(10, 200), st.floats(0, 2), st.floats(0, 2))
def test_vignetting_has_a_size_exactly_where_equation_6_has_no_room(D, x_ml, d_3, lens, pupil):
    """Two forms of one condition: discs on the sensor here, the pencil on each rim there; decentres at their worst."""
    moved = {"main_lens.decentre": (lens, 0.0), "aperture.decentre": (0.0, pupil)}
    camera = Camera.of(PAPER.replace(moved, D=D, d_3=d_3))
    room = float(room_at(camera, (x_ml + lens) * camera.inverse_m).min())
    assume(abs(room) > 1e-9)
    cut = plan(PAPER.replace(moved, D=D, d_3=d_3), SceneBrief(field_radius=x_ml))["vignetting"].estimate
    assert (cut > 0) == (room < 0)


def test_field_curvature_is_told_before_and_after_refocusing():
    """Against the best focus of each place, by search: refocusing cannot bring both foci of astigmatism together."""
    design = load("paper-singlet")
    corner = Subject(design).lens_field
    field = real_field(design, [(share * corner, 0.0) for share in RADII])
    cone = design.D_F / abs(float(Camera.of(design).A)) / design.d
    pairs = np.stack([field.maps.tangential_focus, field.maps.sagittal_focus], -1)
    blur = [
        minimize_scalar(lambda z, pair=pair: np.abs(pair - z).max(), (pair.min(), pair.max())).fun for pair in pairs
    ]
    before, after = np.abs(pairs).max() * cone, max(blur) * cone
    reason = next(line.reason for line in plan(design) if line.name == "field_curvature")
    assert f"{before:.3g} pitches, {after:.3g} after refocusing" in reason
    assert after < before / 3


def matrix_to(design, plane):
    """Ray matrix of height and index times slope, outwards from the main lens to a plane; elements to first order."""
    whole, at = np.eye(2), 0.0
    for e in sorted(design.elements, key=lambda e: e.distance):
        if e.distance > plane:
            break
        whole = np.array([[1, -(e.distance - at)], [0, 1]]) @ whole
        if e.kind == "lens":
            whole = np.array([[1, 0], [1 / e.focal_length, 1]]) @ whole
        else:
            whole = np.array([[1, -e.length / float(e.material.index(design.wavelength))], [0, 1]]) @ whole
        at = e.distance + e.length
    return np.array([[1, -(plane - at)], [0, 1]]) @ whole


def test_light_falls_off_by_the_angle_before_the_objective():
    """The cystoscope's stop is in its relay, where chief rays are flat; before the objective they are not."""
    scope = load("cystoscope")
    line = plan(scope, SceneBrief(field_radius=2.0))["cos4"]
    # The ray through the FAP's middle that comes, behind the lens, to 2 mm on the array.
    (a, b), _ = matrix_to(scope, scope.d_3)
    height, slope = np.linalg.solve([[a, b], [1 - scope.d_1 / scope.f, scope.d_1]], [0.0, 2.0])
    outside = (matrix_to(scope, 95.0) @ [height, slope])[1]  # between objective and window, in air
    assert line.estimate == pytest.approx(1 - math.cos(math.atan(outside)) ** 4, rel=1e-9)
    assert 20 < math.degrees(math.atan(abs(outside))) < 40


def test_a_stop_is_looked_at_across_its_longer_side_as_well():
    """A slot that cuts along y alone, and the same turned by a right angle: fields are asked in all directions."""
    slot = {"shape": "rectangle", "sides": (60.0, 8.0), "distance": 60.0}
    found = [
        lens_aberrations(load("paper-singlet").replace({"stops": [{**slot, "turn": turn}]}), 8.0)
        for turn in (0.0, math.pi / 2)
    ]
    assert found[0].cut > 0
    assert found[0].whole_to < 8.0
    assert found[1].cut == pytest.approx(found[0].cut, rel=1e-6)
    assert found[1].whole_to == found[0].whole_to
