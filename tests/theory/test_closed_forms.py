"""Every closed form against rays traced at 60 digits, in ulps next to its condition number; limits, laws, the paper."""

from __future__ import annotations

import itertools
from typing import Any

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.optimization import Constraint
from roslf_design.theory import exit_pupil, f_number, light, light_field, vignetting
from roslf_design.theory.quantities import QUANTITIES
from studies.accuracy.forms import CLOSED, left_out
from studies.accuracy.oracles.closed_forms import ORACLES, flat, judge, keywords, microlens_of
from tests.theory.designs import P1, arguments, random_designs
from tests.theory.walks import WALKS, walk

BUDGET = 4.0
"""Ulps per (1 + condition number): a chain of up to a dozen roundings, each counted in its own argument's condition."""
DESIGNS = tuple(random_designs(60))
BASE: dict[str, Any] = DESIGNS[0] | P1 | {"stop_diameter": 5.0, "stop_distance": 50.0, "exact": True}
BASE |= {"depth": 90.0, "mla_distance": 140.0}
PAPER = roslf.load("paper")


def numbers(result):
    """Numbers of a closed form's result, as its oracle orders them."""
    if isinstance(result, tuple):
        return [part for item in result for part in numbers(item)]
    return list(np.ravel(result))


def paper(**changes):
    return Camera.of(PAPER, changes)


def test_every_form_has_an_oracle_and_every_oracle_a_form():
    assert set(CLOSED) == set(ORACLES)


@pytest.mark.parametrize("name", sorted(ORACLES))
def test_random_designs_within_budget(name):
    for design in DESIGNS:
        given_ = arguments(name, design)
        for judged in judge(ORACLES[name], numbers(CLOSED[name](**given_)), given_, BUDGET):
            assert judged.ulps <= BUDGET * (1 + judged.condition), (given_, judged)


@pytest.mark.parametrize("kind", WALKS)
def test_budget_holds_up_to_the_last_ulp_before_the_singular_point(kind):
    for name in ORACLES:
        seen = set()
        for design in walk(kind):
            given_ = arguments(name, design)
            if tuple(given_.items()) in seen or left_out(name, given_):
                continue
            seen.add(tuple(given_.items()))
            for judged in judge(ORACLES[name], numbers(CLOSED[name](**given_)), given_, BUDGET):
                assert judged.ulps <= BUDGET * (1 + judged.condition), (name, given_, judged)


FACTORED = (
    *("gap", "aperture_constant", "inverse_aperture_constant", "effective_image_distance", "pupil_angle"),
    *("f_number_pupil", "mla_distance", "magnification", "inverse_magnification", "focal_plane_distance"),
    *("exit_pupil_distance", "vergence_at_mla_per_mm", "exit_pupil_diameter", "image_diameter_mm"),
    *("centre_shift_px_per_microlens", "views_geometric", "object_sample_mm"),
)


@pytest.mark.parametrize("kind", ["d_3 -> d_f", "d_3 -> f", "d_f -> f", "d_1 -> f", "d_f -> inf", "scale"])
def test_factored_forms_lose_nothing_however_ill_conditioned(kind):
    """Products of exactly taken differences: a dozen half ulps at most, whatever the condition number."""
    for name in FACTORED:
        for design in walk(kind):
            given_ = arguments(name, design)
            for judged in judge(ORACLES[name], numbers(CLOSED[name](**given_)), given_, enough=8.0):
                assert judged.ulps <= 8, (name, given_, judged)


with mp.workdps(60):
    TINY, HUGE = mp.mpf(10) ** -30, mp.mpf(10) ** 30
    LIMITS = {
        "d_3 = f": ("pupil_distance", 100.0, [100 - TINY, 100 + TINY]),
        "d_3 = 0": ("pupil_distance", 0.0, [TINY]),
        "d_3 = d_f": ("pupil_distance", 350.0, [350 - TINY]),
        "d_f = f": ("focal_plane_distance", 100.0, [100 + TINY]),
        "d_f = inf": ("focal_plane_distance", np.inf, [HUGE]),
        "D_F = 0": ("pupil_diameter", 0.0, [TINY]),
        "d_2 = 0": ("sensor_distance", 0.0, [TINY]),
        "Z_F = g": ("depth", 230.0, [230 - TINY, 230 + TINY]),
        "Z_F = 0": ("depth", 0.0, [TINY]),
        "Z_F = inf": ("depth", np.inf, [HUGE]),
        "f_ml = inf": ("microlens_focal_length", np.inf, [HUGE]),
        "X = 0": ("radius", 0.0, [-TINY, TINY]),
    }


@pytest.mark.parametrize("limit", LIMITS)
def test_value_at_a_singular_point_is_the_limit_there(limit):
    key, point, neighbours = LIMITS[limit]
    base = BASE | ({"pupil_distance": 20.0} if limit == "d_f = f" else {})
    for name in ORACLES:
        # Nothing matches without pupil or image, though something does up to there.
        if key not in keywords(name) or (name.startswith("matched") and limit in {"D_F = 0", "d_2 = 0"}):
            continue
        given_ = arguments(name, base)
        if left_out(name, given_ | {key: point}):
            continue
        values = numbers(CLOSED[name](**given_ | {key: point}))
        for neighbour in neighbours:
            for value, nearby in zip(values, flat(ORACLES[name](**given_ | {key: neighbour})), strict=True):
                check_limit(name, value, nearby)


def check_limit(name, value, nearby):
    where = (name, value, nearby)
    if isinstance(nearby, bool):
        return  # its length is judged
    if name.startswith("matched") and np.isinf(value):
        assert nearby > 1e20 or nearby < 1e-20, where  # none, or one that vanishes or runs off
    elif abs(nearby) > 1e20:
        assert abs(value) == np.inf, where
    elif abs(nearby) < 1e-20:
        assert abs(value) <= 1e-20, where
    else:
        assert abs(value - nearby) <= 1e-13 * abs(nearby), where


SPECIAL: dict[str, list[Any]] = {
    "focal_plane_distance": [100.0, float(np.nextafter(100, 200)), 350.0, 1e300, np.inf],
    "pupil_distance": [0.0, 5e-324, 100.0, float(np.nextafter(350, 0)), 350.0],
    "pupil_diameter": [0.0, 1e-300, 2.9],
    "sensor_distance": [0.0, 1e-300, 2.0],
    "depth": [0.0, 1e-300, 230.0, 1e300, np.inf],
    "mla_distance": [100.0, 140.0, np.inf],
    "radius": [0.0, -1e6, 27.0],
    "microlens_focal_length": [2.0, np.inf],
    "exact": [True, False],
    "disparity_sigma": [0.0, 0.1],
}


@pytest.mark.parametrize("name", sorted(set(ORACLES) - {"back_substitute"}))
def test_never_nan_and_inf_only_where_documented(name):
    """Every combination of singular points, and no warning from numpy either (warnings are errors here)."""
    keys = keywords(name)
    for combination in itertools.product(*[SPECIAL.get(key, [BASE[key]]) for key in keys]):
        given_ = dict(zip(keys, combination, strict=True))
        if left_out(name, given_):
            continue
        values = np.array(numbers(CLOSED[name](**given_)), dtype=float)
        assert not np.isnan(values).any(), given_
        if np.isinf(values).any():
            assert "inf" in str(CLOSED[name].__doc__), given_


@pytest.mark.parametrize("name", sorted(set(ORACLES) - {"stop_disc"}))
def test_builds_are_their_single_cameras_to_the_last_bit(name):
    several = [arguments(name, design) | {"exact": True} for design in DESIGNS[:20]]
    several = [{key: one[key] for key in keywords(name)} for one in several]
    batch = {key: True if key == "exact" else np.array([one[key] for one in several]) for key in several[0]}
    together = CLOSED[name](**batch)
    fields = together if isinstance(together, tuple) else (together,)
    for i, one in enumerate(several):
        assert numbers(CLOSED[name](**one)) == numbers(tuple(np.asarray(field)[i] for field in fields))


LENGTHS = """
non_distortion_room undistorted_field
matched_sensor_distance matched_pupil_diameter matched_microlens_pitch matched_pupil_distance
mla_distance focal_plane_distance focal_length gap effective_image_distance exit_pupil_distance exit_pupil_diameter
image_pitch_mm image_diameter_mm view_baseline_mm depth_sigma object_sample_mm diffraction_width pupil_airy_radius
microlens_defocus_blur stop_disc
"""
DIMENSION = dict.fromkeys(LENGTHS.split(), 1) | {"vergence_at_mla_per_mm": -1, "disparity_rate": -1}
"""Power of length; 0 for all others."""
NO_LENGTHS = {"disparity_sigma", "exact"}


@pytest.mark.parametrize("name", sorted(set(ORACLES) - {"back_substitute"}))
def test_all_lengths_doubled_scale_the_result_to_the_last_bit(name):
    for design in random_designs(20, seed=3):
        given_ = arguments(name, design)
        once = numbers(CLOSED[name](**given_))
        for factor in (2.0, 2.0**-9):
            grown = {
                key: value
                if key in NO_LENGTHS
                else tuple(np.multiply(value, factor))
                if np.ndim(value)
                else value * factor
                for key, value in given_.items()
            }
            for before, after in zip(once, numbers(CLOSED[name](**grown)), strict=True):
                if not isinstance(before, np.bool_):
                    assert after == before * factor ** DIMENSION.get(name, 0)


def test_oracle_traces_the_papers_camera():
    """The oracles themselves, against numbers computed by hand from the paper's lengths."""
    by_hand = {
        "mla_distance": (140, 1),
        "aperture_constant": (35, 23),
        "exit_pupil_distance": (600, 1),
        "vergence_at_mla_per_mm": (-1, 460),
        "effective_image_distance": (92, 1),
    }
    with mp.workdps(60):
        for name, (numerator, denominator) in by_hand.items():
            (traced,) = flat(ORACLES[name](**arguments(name, BASE)))
            assert abs(traced * denominator - numerator) < mp.mpf(10) ** -50


@pytest.mark.parametrize("d", [0.063, 0.127, 1 / 3])
@pytest.mark.parametrize("d_2", [0.5, 2.0, 2.81])
def test_telecentric_image_pitch_is_the_microlens_pitch_to_the_last_bit(d, d_2):
    for f, d_f in [(100.0, 350.0), (1.8, 25.0), (20.1, 20.3), (0.7, np.inf)]:
        camera = paper(f=f, d_f=d_f, d_3=f, d=d, d_2=d_2)
        assert exit_pupil.microlens_image_pitch(camera) == d
        assert exit_pupil.is_telecentric(camera)


def test_pitch_crosses_the_telecentric_point_without_a_step():
    camera = paper(d_3=np.array([np.nextafter(100.0, 0), 100.0, np.nextafter(100.0, 200)]))
    assert np.all(np.abs(exit_pupil.microlens_image_pitch(camera) - 0.063) <= np.spacing(0.063))
    assert np.all(np.diff(camera.vergence) < 0)


PRINTED = {
    "aperture constant": (paper().H, "1.52174"),
    "inverse aperture constant": (paper().inverse_H, "0.657143"),
    "exit pupil distance": (exit_pupil.exit_pupil_distance(paper()), "600.0"),
    "exit pupil vergence": (paper().vergence, "-0.0021739"),
    "f-number, microlens": (f_number.microlens_f_number(paper()), "31.746"),
    "f-number, pupil": (f_number.pupil_f_number(paper()), "31.724"),
    "f-number, main lens": (f_number.main_lens_f_number(paper()), "2.7559"),
    "f-number, pupil at 20 mm": (f_number.pupil_f_number(paper(d_3=20.0)), "45.517"),
    "image fill": (f_number.fill_factor(paper()), "1.00506"),
    "mismatch": (f_number.mismatch_px(paper()), "0.0655"),
    "x0_max": (vignetting.field_limit(paper()).radius, "44.4542"),
    "x_ml_max": (vignetting.field_limit(paper()).mla_radius, "17.7817"),
    "image diameter": (exit_pupil.microlens_image_diameter(paper()), "0.0630435"),
    "image diameter in pixels": (light.geometric_views(paper()), "13.0045"),
    "image pitch": (exit_pupil.microlens_image_pitch(paper()), "0.0627261"),
    "centre shift": (exit_pupil.centre_shift_per_microlens(paper()), "0.242152"),
    "independent views": (light.independent_views(paper()), "3.6"),
    "lateral samples": (QUANTITIES["lateral_samples"](paper()), "355.51"),
    "object sample": (light.object_sample(paper()), "0.1575"),
    "view baseline": (light.view_baseline(paper()), "0.223000"),
    "disparity rate": (light_field.disparity_rate(paper(), 230.0), "0.080055"),
    "depth sigma": (light_field.depth_sigma(paper(), 230.0, 0.1), "1.2491"),
    "Fresnel number": (light.fresnel_number(paper()), "0.902"),
    "Airy radius in pixels": (light.airy_radius(paper()) / PAPER.q, "4.394"),
    "blur width in pixels": (light.diffraction_width(paper()) / PAPER.q, "3.6"),
    "FAP diffraction in pitches": (light.pupil_airy_radius(paper()) / PAPER.d, "0.34"),
    "microlens defocus": (light.microlens_defocus_waves(paper()), "0.002"),
    "disparity at Z_F = 200 mm": (light_field.rim_disparity(paper(), 200.0), "2.8"),
}


@pytest.mark.parametrize("quantity", PRINTED)
def test_number_to_its_last_printed_digit(quantity):
    """What users of the evaluation may rely on, as the paper and the public contract print it."""
    value, printed = PRINTED[quantity]
    assert f"{value:.{len(printed.partition('.')[2])}f}" == printed


def test_equations_as_printed():
    """Eqs. 2, 4, 6 and 12 in the paper's own symbols."""
    D, D_F, d_f, d_1, d_2, d_3, d, q = 50.8, 2.9, 350.0, 140.0, 2.0, 120.0, 0.063, PAPER.q
    H = d_f / (d_f - d_3)
    A, m = d_1 / H, d_1 / d_f
    assert light_field.pixel_to_pupil(paper(), 3.0) == pytest.approx(-(1 / H) * (q * d_1 / d_2) * 3, rel=1e-14)
    printed = d * d_2 * d_3 * d_f / (q * d_1**2 * (d_f - d_3))
    assert exit_pupil.centre_shift_per_microlens(paper()) == pytest.approx(printed, rel=1e-14)
    bound = vignetting.field_limit(paper()).radius
    assert bound / d_f == pytest.approx(((D - D_F) / d_3 - D / d_f) / 2, rel=1e-14)
    slope = q * A / (d * d_2) * (m - A / 80.0)
    assert light_field.epi_slope(paper(), 80.0) == pytest.approx(slope, rel=1e-13)
    views = light.geometric_views(paper())
    assert light_field.rim_disparity(paper(), 80.0) == pytest.approx(-slope * views, rel=1e-13)


def test_a_view_shows_a_scene_point_where_a_traced_ray_arrives():
    rng = np.random.default_rng(5)
    for _ in range(20):
        camera = paper(d_3=rng.uniform(0, 300), d_2=rng.uniform(0.5, 4))
        X, Z_F, pixel = rng.uniform(-20, 20), rng.uniform(50, 500), rng.uniform(-6, 6)
        u, _, w = light_field.view_projection(camera, (pixel, 0.0)) @ (X, 0.0, Z_F, 1.0)
        lengths = {"A": camera.A, "m": camera.m, "d": camera.d, "q": camera.q, "d_2": camera.d_2}
        exact = microlens_of(
            X=X, Z_F=Z_F, pixel=pixel, centre=0.0, u_0=0.0, **{k: float(v) for k, v in lengths.items()}
        )
        assert float(exact) == pytest.approx(u / w, rel=1e-12)


lengths = st.floats(1e-2, 1e3)


@given(lengths, st.floats(1.001, 100), lengths, lengths, lengths)
def test_pupil_at_the_lens_is_the_traditional_light_field(f, reduced, D_F, d, d_2):
    """d_3 = 0: Eqs. 1 and 9, no centre deviation, H = 1, exit pupil at the lens."""
    camera = paper(f=f, d_f=f * reduced, d_3=0.0, D_F=D_F, D=D_F, d=d, d_2=d_2)
    assert camera.H == camera.inverse_H == 1
    assert pytest.approx(camera.d_1, rel=1e-15) == camera.A
    assert exit_pupil.exit_pupil_distance(camera) == exit_pupil.centre_shift_per_microlens(camera) == 0
    assert exit_pupil.microlens_image_pitch(camera) == pytest.approx(d * (1 + d_2 / camera.d_1), rel=1e-14)
    assert f_number.pupil_f_number(camera) == pytest.approx(f_number.main_lens_f_number(camera), rel=1e-14)


def eq_8(camera):
    """Microlens-image diameter over the microlens's own pitch."""
    return f_number.microlens_f_number(camera) / f_number.pupil_f_number(camera)


@given(lengths, st.floats(1.01, 50), st.floats(0.0, 0.95), lengths, lengths, lengths)
def test_a_matched_length_matches(f, reduced, where, D_F, d, d_2):
    camera = paper(f=f, d_f=f * reduced, d_3=where * f * reduced, D_F=D_F, d=d, d_2=d_2)
    for symbol in ("d_2", "D_F", "d", "d_3"):
        for exact, fill in ((True, f_number.fill_factor), (False, eq_8)):
            matched = f_number.matched(camera, symbol, exact=exact)
            if matched.exists:
                # A matched d_3 near d_f, or a pitch of images near 0, magnifies its own rounding.
                changed = camera.replace({symbol: matched.value})
                near = abs(changed.gap / changed.d_f) * min(1.0, abs(1 + changed.d_2 * changed.vergence))
                assert fill(changed) == pytest.approx(1, abs=1e-12 / max(float(near), 1e-10))
            else:
                assert matched.value == np.inf


@pytest.mark.parametrize("D_F", [0.02, 0.06], ids=["gap", "overlap"])
def test_images_in_reversed_order_are_apart_by_the_magnitude_of_their_pitch(D_F):
    """An exit pupil between array and sensor; two neighbours' images by rays from the FAP's rim and centre."""
    c = Camera.of(PAPER.replace(d_3=342.0, D_F=D_F))

    def lands(place, axis):
        """On the sensor, the ray from a place on the FAP through the middle of a microlens."""
        B, D = c.d_3 + c.d_1 * (1 - c.d_3 / c.f), 1 - c.d_3 / c.f
        return axis + (D * axis - place) / B * c.d_2  # slope behind the lens, from the ray matrix

    ends = [sorted(lands(side * D_F / 2, axis) for side in (-1, 1)) for axis in (0.0, c.d)]
    assert lands(0.0, c.d) < 0  # reversed
    overlap = ends[1][1] - ends[0][0]
    apart = abs(lands(0.0, c.d) - lands(0.0, 0.0))
    assert f_number.mismatch_px(c) == pytest.approx(overlap / c.q, rel=1e-12)
    assert f_number.fill_factor(c) == pytest.approx((ends[0][1] - ends[0][0]) / apart, rel=1e-12)
    assert (f_number.mismatch_px(c) > 0) == (D_F == 0.06)
    result = roslf.evaluate(PAPER.replace(d_3=342.0, D_F=D_F))
    word = "overlap by" if D_F == 0.06 else "leave gaps of"
    verdict = next(verdict for verdict in result.verdicts if verdict.name == "f_number_matched")
    assert f"{word} {abs(overlap) / c.q:.3g} px" in verdict.text
    for symbol in ("D_F", "d", "d_2", "d_3"):
        way = f_number.matched(c, symbol)
        assert way.exists
        assert f_number.fill_factor(c.replace({symbol: float(way.value)})) == pytest.approx(1, abs=1e-12)
    slope = np.imag(f_number.fill_factor(c.replace({"d_3": np.array(342.0 + 1e-20j)}))) / 1e-20
    near, far = (f_number.fill_factor(c.replace({"d_3": 342.0 + step})) for step in (-1e-5, 1e-5))
    assert slope == pytest.approx((far - near) / 2e-5, rel=1e-6)
    limit = Constraint(quantity="fill_factor", min=0.99, max=1.01)
    of_limits = [limit.row(value, sign, 1.0)[0](limit.measured(c)) for value, sign in ((0.99, -1), (1.01, 1))]
    assert [bool(row > 0) for row in of_limits] == [D_F == 0.02, D_F == 0.06]
