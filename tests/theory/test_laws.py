"""Laws that hold for every design: dimensions, mirror images, reductions, inverses, monotone limits."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roslf_design import theory
from studies.accuracy.oracles.closed_forms import ORACLES, keywords
from tests.theory.designs import P1, arguments, random_designs
from tests.theory.test_against_rays import numbers

DIMENSIONLESS = {"magnification", "index", "pixel", "centre", "slope", "disparity_sigma", "exact"}
PER_LENGTH = {"exit_pupil_vergence"}

POWERS = {
    "aperture_constant inverse_aperture_constant magnification inverse_magnification conjugate_residual pupil_angle "
    "centre_shift_per_microlens centre_deviation microlens_f_number microlens_angle pupil_f_number main_lens_f_number "
    "fill_factor approximate_fill_factor traditional_fill_factor matching_mismatch matching_residual pupil_to_pixel "
    "pupil_shear epi_slope epi_inverse_slope calibrated_epi_slope rim_disparity defocus_blur geometric_views "
    "lateral_samples phase_space_limit fresnel_number independent_views microlens_defocus_waves": 0,
    "mla_distance focal_plane_distance focal_length mla_excess gap effective_image_distance "
    "effective_image_distance_from_magnification exit_pupil_distance exit_pupil_diameter microlens_image_pitch "
    "microlens_image_diameter matched_sensor_distance matched_pupil_diameter matched_microlens_pitch "
    "matched_pupil_distance nondistortion_bound stop_disc pixel_to_pupil pixel_to_lens view_baseline depth_sigma "
    "object_sample diffraction_width airy_radius pupil_airy_radius microlens_defocus_blur": 1,
    "nondistortion_margin stop_margin": 2,
    "exit_pupil_vergence inverse_depth_from_epi_slope disparity_rate inverse_depth_sigma": -1,
}
DIMENSION = {name: power for names, power in POWERS.items() for name in names.split()}
DIMENSION |= {
    "back_substitute": (1, 1, 0, 1, 0),
    "back_substitution_jacobian": (0, 0, 1, 0, 0, 1, -1, -1, 0, 0, 0, 1),
}


def scaled(name, value, factor):
    if name in DIMENSIONLESS:
        return value
    by = 1 / factor if name in PER_LENGTH else factor
    return tuple(part * by for part in value) if isinstance(value, tuple) else value * by


@pytest.mark.parametrize("name", sorted(ORACLES))
def test_all_lengths_doubled_scale_the_result_to_the_last_bit(name):
    function = getattr(theory, name)
    for design in random_designs(40, seed=3):
        given_ = arguments(name, design)
        once = numbers(function(**given_))
        powers = DIMENSION[name] if isinstance(DIMENSION[name], tuple) else (DIMENSION[name],) * len(once)
        for factor in (2.0, 2.0**-9, 2.0**20):
            grown = numbers(function(**{key: scaled(key, value, factor) for key, value in given_.items()}))
            for before, after, power in zip(once, grown, powers, strict=True):
                if not isinstance(before, np.bool_):
                    assert after == before * factor**power


@pytest.mark.parametrize("name", ["centre_deviation", "pixel_to_pupil", "pupil_to_pixel", "pixel_to_lens"])
def test_mirrored_side_mirrors_the_result(name):
    for design in random_designs(40, seed=4):
        given_ = arguments(name, design)
        turned = {key: -given_[key] for key in ("index", "pixel", "coordinate", "centre") if key in given_}
        assert getattr(theory, name)(**given_ | turned) == -getattr(theory, name)(**given_)


@pytest.mark.parametrize("name", ["stop_margin", "stop_disc"])
def test_mirrored_and_turned_stops(name):
    function = getattr(theory, name)
    turn = {"point", "stop_decentre", "pupil_decentre", "microlens_centre"}
    for design in random_designs(40, seed=6):
        given_ = arguments(name, design)
        swapped = function(**{key: value[::-1] if key in turn else value for key, value in given_.items()})
        flipped = function(**{key: (-value[0], -value[1]) if key in turn else value for key, value in given_.items()})
        once = function(**given_)
        if name == "stop_margin":
            assert once == swapped == flipped
        else:
            assert once.radius == swapped.radius == flipped.radius
            np.testing.assert_array_equal(once.centre, swapped.centre[::-1])
            np.testing.assert_array_equal(once.centre, -flipped.centre)


lengths = st.floats(1e-2, 1e3)


@given(lengths, st.floats(1.001, 100), lengths, lengths, lengths, lengths, st.floats(-50, 50))
def test_pupil_at_the_lens_is_the_traditional_light_field(f, reduced, D_F, d, d_2, q, s):
    """d_3 = 0: Eqs. 1 and 9, no centre deviation, H = 1, exit pupil at the lens."""
    d_f = f * reduced
    d_1 = theory.mla_distance(f, d_f)
    near = {"rel": 1e-14 * (1 + 1 / (reduced - 1))}
    assert theory.aperture_constant(d_f, 0.0) == theory.inverse_aperture_constant(d_f, 0.0) == 1
    assert theory.effective_image_distance(f, d_f, 0.0) == pytest.approx(d_1, rel=1e-15)
    assert theory.exit_pupil_distance(f, 0.0) == 0
    assert theory.exit_pupil_vergence(f, d_f, 0.0) == pytest.approx(1 / d_1, rel=1e-15)
    assert theory.centre_shift_per_microlens(d, q, d_2, f, d_f, 0.0) == 0
    assert theory.microlens_image_pitch(d, d_2, f, d_f, 0.0) == pytest.approx(d * (1 + d_2 / d_1), rel=1e-15)
    assert theory.microlens_image_diameter(D_F, d_2, f, d_f, 0.0) == pytest.approx(D_F * d_2 / d_1, rel=2e-15)
    assert theory.pupil_f_number(D_F, f, d_f, 0.0) == pytest.approx(theory.main_lens_f_number(D_F, d_1), rel=1e-15)
    assert theory.pixel_to_pupil(s, q, d_2, d_1) == theory.pixel_to_lens(s, q, d_2, d_1)
    assert theory.calibrated_epi_slope(2 * d_f, d_1, d_1 / d_f, d, q, d_2) == pytest.approx(
        theory.epi_slope(2 * d_f, d, q, d_2, f, d_f, 0.0), **near
    )


@given(lengths, st.floats(1.001, 100), lengths, lengths, lengths)
def test_pupil_in_the_front_focal_plane_is_telecentric(f, reduced, D_F, d, d_2):
    d_f = f * reduced
    assert theory.is_telecentric(f, f)
    assert not theory.is_telecentric(f, f * (1 + 1e-8))
    assert theory.is_telecentric(f, f * (1 + 1e-8), tolerance=1e-7)
    assert theory.exit_pupil_vergence(f, d_f, f) == 0
    assert theory.exit_pupil_distance(f, f) == theory.exit_pupil_diameter(D_F, f, f) == np.inf
    assert theory.microlens_image_pitch(d, d_2, f, d_f, f) == d
    assert theory.effective_image_distance(f, d_f, f) == f
    assert theory.pupil_f_number(D_F, f, d_f, f) == f / D_F


@given(st.floats(0, 0.999), lengths, lengths, st.floats(-1e3, 1e3))
def test_the_main_lens_is_one_stop_of_many(where, D, D_F, X):
    Z = 300.0
    as_stop = theory.stop_margin(D, 0.0, D_F, where * Z, Z, (X, 0.0))
    alone = theory.nondistortion_margin(D, D_F, where * Z, Z, X)
    assert as_stop == pytest.approx(alone, abs=1e-15 * Z * (D + D_F + 2 * abs(X)) * 4)


def test_pupil_is_a_stop_that_takes_nothing_of_itself():
    assert theory.stop_margin(2.9, 120.0, 2.9, 120.0, 350.0, (20.0, 5.0)) == 0
    assert theory.stop_margin(3.0, 120.0, 2.9, 120.0, 350.0, (20.0, 5.0), (0.05, 0.0)) == pytest.approx(0, abs=1e-13)


@given(lengths, lengths, lengths, st.floats(0, 1e3))
def test_margin_falls_with_pupil_and_field_and_grows_with_the_lens(D, D_F, d_3, X):
    margin = theory.nondistortion_margin(D, D_F, d_3, 2 * d_3, X)
    assert theory.nondistortion_margin(1.01 * D, D_F, d_3, 2 * d_3, X) >= margin
    assert theory.nondistortion_margin(D, 1.01 * D_F, d_3, 2 * d_3, X) <= margin
    assert theory.nondistortion_margin(D, D_F, d_3, 2 * d_3, X + 1) <= margin


def test_margin_vanishes_at_its_bound_for_any_object_distance():
    for Z in (130.0, 350.0, 1e4):
        bound = theory.nondistortion_bound(50.8, 2.9, 120.0, Z, 100.0, 350.0)
        room = theory.nondistortion_margin(50.8, 2.9, 120.0, Z, bound.object_radius)
        assert abs(room) <= 1e-14 * 50.8 * Z


def test_bound_beyond_any_field_is_told_on_both_sides_of_the_lens():
    assert theory.nondistortion_bound(50.8, 2.9, 0.0, 350.0, 100.0, 350.0) == (np.inf, np.inf)
    assert theory.nondistortion_bound(2.0, 2.9, 10.0, 350.0, 100.0, 350.0) == (0, 0)
    far = theory.nondistortion_bound(50.8, 2.9, 120.0, np.inf, 100.0, 350.0)
    assert far.object_radius == np.inf
    assert far.mla_radius == pytest.approx(92.0 * (50.8 - 2.9) / 240.0, rel=1e-15)


def test_margin_of_a_point_at_infinity_is_the_limit_of_far_points():
    tangent = 0.15
    at_infinity = theory.nondistortion_margin(50.8, 2.9, 120.0, 1.0, tangent, weight=0.0)
    for Z in (1e9, 1e12):
        assert theory.nondistortion_margin(50.8, 2.9, 120.0, Z, tangent * Z) / Z == pytest.approx(
            at_infinity, rel=1e3 / Z
        )
    stop = (25.0, 60.0, 2.9, 120.0)
    through = theory.stop_margin(*stop, 1.0, (tangent, 0.0), (0.1, 0.2), (0.3, 0.1), weight=0.0)
    Z = 1e12
    far = theory.stop_margin(*stop, Z, (tangent * Z, 0.0), (0.1, 0.2), (0.3, 0.1)) / Z
    assert far == pytest.approx(through, rel=1e-9)
    for infinite in (theory.nondistortion_margin, lambda *a: theory.stop_margin(*stop[:2], *a[1:4], (a[4], 0.0))):
        with pytest.raises(ValueError, match="weight=0"):
            infinite(50.8, 2.9, 120.0, np.inf, tangent)


def test_discs_are_batched_over_stops_and_microlenses():
    centres = np.stack(np.meshgrid(np.linspace(-11, 11, 5), np.linspace(-7, 7, 3)), -1)
    discs = theory.stop_disc([[[2.9]], [[50.8]]], [[[120.0]], [[0.0]]], centres, 2.0, 100.0, 350.0)
    assert np.broadcast_shapes(discs.radius.shape, discs.centre.shape[:-1]) == (2, 3, 5)
    np.testing.assert_allclose(discs.centre[0, 0, -1], centres[0, -1] * (1 - 2 / 460), rtol=1e-15)


@given(st.floats(-20, 20), st.floats(-5, 5), lengths, lengths, lengths)
def test_pixels_and_pupil_coordinates_are_inverse(s, s_0, q, d_2, A):
    there = theory.pixel_to_pupil(s, q, d_2, A, s_0)
    assert theory.pupil_to_pixel(there, q, d_2, A, s_0) == pytest.approx(s, abs=1e-14 * (abs(s) + abs(s_0)) + 1e-300)
    assert theory.pixel_to_pupil(s_0 + 1, q, d_2, A, s_0) == pytest.approx(
        -theory.view_baseline(q, d_2, A), rel=1e-14 * (1 + abs(s_0))
    )


@given(st.floats(1, 1e4), st.floats(0.02, 5), lengths)
def test_epi_slope_tells_the_depth_it_came_from(Z_F, m, A):
    rest = (A, m, 0.063, 0.0048, 2.0)
    slope = theory.calibrated_epi_slope(Z_F, *rest)
    back = theory.inverse_depth_from_epi_slope(slope, *rest)
    assert back == pytest.approx(1 / Z_F, abs=2e-15 * (m / A + 1 / Z_F))


def test_depth_error_is_the_disparity_error_over_its_rate():
    names = ("depth_sigma", "disparity_rate", "inverse_depth_sigma")
    for design in random_designs(30, seed=8):
        sigma, rate, inverse = (getattr(theory, name)(**arguments(name, design)) for name in names)
        if np.isfinite(sigma) and rate > 0:
            assert sigma * rate == pytest.approx(design["disparity_sigma"], rel=1e-14)
            assert inverse * design["depth"] ** 2 == pytest.approx(sigma, rel=1e-14)


def test_rim_disparity_is_that_many_views_slopes():
    """B is the slope of Eq. 12 over all the pixels of a microlens image."""
    triple = (100.0, 350.0, 120.0)
    views = theory.geometric_views(2.9, P1["pixel_pitch"], 2.0, *triple)
    slope = theory.epi_slope(80.0, 0.063, P1["pixel_pitch"], 2.0, *triple)
    assert theory.rim_disparity(80.0, 2.9, 0.063, *triple) == pytest.approx(-slope * views, rel=1e-14)


def test_light_carries_no_more_than_its_limit_but_for_the_paraxial_tangent():
    """Matched, with the field filled: samples times views is 2 D_F tan/lambda, above 2 D_F sin/lambda by 1/cos."""
    D_F, d, wavelength, half_field = 2.9, 0.063, 550e-6, 11.15
    d_2 = theory.matched_sensor_distance(D_F, d, 100.0, 350.0, 120.0, exact=False).value
    samples = theory.lateral_samples(2 * half_field, d) * theory.independent_views(d, d_2, wavelength)
    limit = theory.phase_space_limit(D_F, half_field / 0.4, 230.0, wavelength)
    cosine = 230.0 / np.hypot(half_field / 0.4, 230.0)
    assert samples * cosine == pytest.approx(limit, rel=1e-14)


def test_keywords_are_the_vocabulary_of_one_field():
    """The same thing has the same name everywhere."""
    known = set(next(iter(random_designs(1))))
    for name in ORACLES:
        assert set(keywords(name)) <= known
