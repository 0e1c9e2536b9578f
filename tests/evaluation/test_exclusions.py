"""Requirements that exclude each other: where they begin to, by closed forms and by trying light."""

import re

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.design import PATHS
from roslf_design.evaluation.required import SHARP, required_of
from roslf_design.theory.depth_of_field import finest_detail

SCOPE = roslf.load("rigid-scope")
WELL = 4000.0


def asked(design, *required):
    """Requirements, with limits as (name, distance ahead or None, limits)."""
    tables = {}
    for name, at, ends in required:
        tables.setdefault(name, []).append(ends | ({} if at is None else {"at": f"{at} mm"}))
    return required_of(design.replace({"required": tables}))


@pytest.fixture(scope="module")
def lamp():
    """A source in the tip: of its light there is (z/z')^2 as much at z'; so much that it fills a pixel at 12 mm."""
    design = SCOPE.replace({"sensor.full_well": WELL, "light.measured_at": 20.0})
    here = float(roslf.quantity("pixel_electrons")(Camera.of(design), 12.0))
    longer = float(roslf.evaluate(design).depth.assumes.exposure_s) * 1.5 * WELL / here
    return design.replace({"light.exposure": longer})


@pytest.mark.parametrize(("share", "excluded"), [(0.97, False), (1.03, True)])
def test_electrons_at_two_distances_exclude_each_other_where_light_that_does_for_one_fills_pixels_at_the_other(
    lamp, share, excluded
):
    least = share * WELL * (12 / 30) ** 2
    near, far = asked(lamp, ("pixel_electrons", 12.0, {"min": 100}), ("pixel_electrons", 30.0, {"min": least}))
    assert not near.met
    assert ("excludes" in near.remedy) == excluded
    if excluded:
        there = f"{WELL * (12 / 30) ** 2:.4g}"
        assert f"with over {there} e- there pixels here are full; require less of one" in near.remedy
        assert f"excludes {far.label}, at least" in near.remedy


@pytest.mark.parametrize("share", [0.7, 1.4])
def test_depth_noise_and_few_electrons_exclude_each_other(share):
    """By trying: sigma in the light in which a pixel has as many electrons as are allowed."""
    camera = Camera.of(SCOPE)
    sigma, charge = (roslf.quantity(name) for name in ("sigma_z_mm", "pixel_electrons"))
    most = 0.2 * float(charge(camera))
    times = SCOPE.replace({"light.exposure": 0.2 * float(roslf.evaluate(SCOPE).depth.assumes.exposure_s)})
    assert float(charge(Camera.of(times))) == pytest.approx(most)
    limit = float(sigma(Camera.of(times))) * share
    _, few = asked(SCOPE, ("sigma_z_mm", None, {"max": f"{limit!r} mm"}), ("pixel_electrons", None, {"max": most}))
    assert not few.met
    assert ("excludes depth noise" in few.remedy) == (share < 1)


def test_noise_that_no_light_ends_is_said_with_what_a_full_well_leaves():
    sigma = roslf.quantity("sigma_z_mm")
    exposure, charge = (float(v) for v in (roslf.evaluate(SCOPE).depth.assumes.exposure_s,
                                           roslf.quantity("pixel_electrons")(Camera.of(SCOPE))))  # fmt: skip
    full = exposure * SCOPE.sensor.full_well / charge
    tried = [float(sigma(Camera.of(SCOPE.replace({"light.exposure": t * full})))) for t in np.linspace(0.05, 0.99, 48)]
    best = min(tried)
    for share, never in ((0.9, True), (1.05, False)):
        (one,) = asked(
            SCOPE.replace({"light.exposure": 0.1 * exposure}), ("sigma_z_mm", None, {"max": f"{share * best!r} mm"})
        )
        assert not one.met
        assert ("no light reaches it" in one.remedy) == never


@pytest.mark.parametrize("share", [0.98, 1.02])
def test_detail_beyond_diffraction_at_the_f_number_required(share):
    """The incoherent limit of the FAP as the object sees it, D_F/(z lambda), at its own f-number."""
    own = float(roslf.quantity("f_number_pupil")(Camera.of(SCOPE)))
    limit = SCOPE.D_F / ((SCOPE.d_f - SCOPE.d_3) * SCOPE.wavelength)
    detail, slow = asked(
        SCOPE, ("mtf10_lp_per_mm", None, {"min": share * limit}), ("f_number_pupil", None, {"min": own * (1 - 1e-9)})
    )
    assert not detail.met
    assert slow.met
    assert ("excludes" in detail.remedy) == (share > 1)
    if share > 1:
        assert f"shows no detail above {limit:.4g} lp/mm there; require less of one" in detail.remedy


@pytest.mark.parametrize("layout", ["square", "hexagonal"])
@pytest.mark.parametrize("name", ["rigid-scope", "cystoscope"])
def test_no_camera_tried_shows_more_detail_than_diffraction_leaves_one_that_is_sharp_so_far(name, layout):
    """By brute force: cameras of all openings, lengths, microlenses and pixels, in air and behind a relay in water."""
    draw, count = np.random.default_rng(4), 48
    own = Camera.of(roslf.load(name).replace({"microlens_array.layout": layout}))
    spans = {"D_F": (-1, 1), "d_2": (-1, 1), "d": (-0.7, 0.7), "q": (-5, -3), "d_3": (-0.7, 0)}
    tried = own.replace({key: own[PATHS[key]] * np.exp(draw.uniform(*span, count)) for key, span in spans.items()})
    kinds = {kind: [roslf.quantity(f"{kind}{end}_mm")(tried) for end in ("near", "far")] for kind in SHARP}
    focus, nearest = float(roslf.quantity("working_distance_mm")(own)), 0.0
    for at in (0.8 * focus, focus):
        shown = roslf.quantity("detail_lp_per_mm")(tried, at)
        for near, far in kinds.values():
            within = tried.valid & (near < at) & (at < far) & np.isfinite(shown)
            ends = zip(shown[within], near[within], np.minimum(far[within], 1e9), strict=True)
            nearest = max([nearest, *(value / finest_detail(own, at, *both) for value, *both in ends)])
    assert 0.5 < nearest <= 1


@pytest.mark.parametrize("share", [0.97, 1.03])
@pytest.mark.parametrize("kind", SHARP)
def test_detail_and_a_range_that_is_sharp_exclude_each_other_beyond_diffraction(kind, share):
    ends = 8.0, 40.0
    most = finest_detail(Camera.of(SCOPE), 12.0, *ends)
    near, far, detail = asked(
        SCOPE,
        (f"{kind}near_mm", None, {"max": f"{ends[0]} mm"}),
        (f"{kind}far_mm", None, {"min": f"{ends[1]} mm"}),
        ("detail_lp_per_mm", 12.0, {"min": share * most}),
    )
    missed = [one for one in (near, far, detail) if not one.met]
    assert missed
    assert all(("excludes" in one.remedy) == (share > 1) for one in missed)
    if share > 1:  # what is left to it is told: as much detail as is asked for, to a nearer end
        told = re.search(r"sharp from 8 to beyond ([\d.]+) mm", missed[0].remedy)
        assert finest_detail(Camera.of(SCOPE), 12.0, 8.0, float(told[1])) == pytest.approx(share * most, rel=1e-3)
