"""Eqs. 10 and 11: matrices against traced rays, each other, the signs stated, and their limits."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roslf_design import theory
from studies.accuracy.oracles.closed_forms import judge, microlens_of, pixel_of, ray_of

P1 = {"A": 92.0, "m": 0.4, "d": 0.063, "q": 0.004847826, "d_2": 2.0}
BUDGET = 4.0  # ulps per (1 + condition), as everywhere


def camera_arguments(camera):
    return camera["A"], camera["m"], camera["d"], camera["q"], camera["d_2"]


def random_cameras(count, seed=10):
    rng = np.random.default_rng(seed)
    for _ in range(count):
        size = 10 ** rng.uniform(-1, 1)
        yield (
            {
                "A": 92 * size * rng.uniform(0.1, 3),
                "m": 10 ** rng.uniform(-1.5, 0.5),
                "d": 0.063 * size,
                "q": 0.0048 * size,
                "d_2": 2 * size,
            },
            rng,
        )


def test_view_sees_a_scene_point_where_its_ray_meets_the_array():
    for camera, rng in random_cameras(60):
        s, s_0, u_0 = (float(v) for v in rng.uniform(-8, 8, 3))
        X, Z_F = float(rng.normal() * 50), float(10 ** rng.uniform(0, 4))
        matrix = theory.view_projection((s, 0.0), *camera_arguments(camera), (s_0, 0.0), (u_0, 0.0))
        got = theory.from_homogeneous(theory.project(matrix, (X, 0.0, Z_F, 1.0)))
        arguments = {"X": X, "Z_F": Z_F, "pixel": s, "centre": s_0, "u_0": u_0, **camera}
        (judged,) = judge(microlens_of, [got[0]], arguments)
        assert judged.ulps <= BUDGET * (1 + judged.condition)
        assert abs(got[0] - judged.exact) < 1e-12 * (1 + abs(judged.exact))


def test_microlens_sees_a_scene_point_on_the_pixel_that_its_ray_reaches():
    for camera, rng in random_cameras(60):
        u, s_0, u_0 = (float(v) for v in rng.uniform(-8, 8, 3))
        X, Z_F = float(rng.normal() * 50), float(10 ** rng.uniform(0, 4))
        matrix = theory.microlens_projection((0.0, u), *camera_arguments(camera), (0.0, s_0), (0.0, u_0))
        got = theory.from_homogeneous(theory.project(matrix, (0.0, X, Z_F, 1.0)))
        arguments = {"X": X, "Z_F": Z_F, "microlens": u, "centre": s_0, "u_0": u_0, **camera}
        (judged,) = judge(pixel_of, [got[1]], arguments)
        assert judged.ulps <= BUDGET * (1 + judged.condition)


def test_decoded_coordinates_give_the_traced_ray():
    for camera, rng in random_cameras(60):
        s, u, s_0, u_0 = (float(v) for v in rng.uniform(-8, 8, 4))
        matrix = theory.ray_matrix(*camera_arguments(camera), (s_0, 1.0), (u_0, 1.0))
        got = theory.project(matrix, (s, 1.0, u, 1.0, 1.0))
        arguments = {"pixel": s, "microlens": u, "centre": s_0, "u_0": u_0, **camera}
        for judged in judge(ray_of, [got[0], got[2]], arguments):
            assert judged.ulps <= BUDGET * (1 + judged.condition)
        assert np.all(got[[1, 3]] == 0)  # the centre of the axial microlens's image looks along the axis
        assert got[4] == 1


offset = st.floats(-20, 20)
length = st.floats(0.01, 100)


@given(offset, offset, offset, offset, length, st.floats(0.01, 10), length, length, length)
def test_ray_and_decoding_matrices_are_inverse(s, t, u, v, A, m, d, q, d_2):
    parameters = (A, m, d, q, d_2, (0.3, -1.2), (7.0, 2.0))
    there, back = theory.ray_matrix(*parameters), theory.decoding_matrix(*parameters)
    scale = np.abs(back) @ np.abs(there) @ np.array([abs(s), abs(t), abs(u), abs(v), 1.0])
    decoded = np.array([s, t, u, v, 1.0])
    assert np.all(np.abs(theory.project(back, theory.project(there, decoded)) - decoded) <= 2e-15 * scale)


@given(offset, offset, st.floats(0, 1e4), st.sampled_from([0.0, 1.0]), length, st.floats(0.01, 10), length)
def test_projection_and_reconstruction_are_inverse(X, Y, Z_F, W, A, m, d):
    point = np.array([X, Y, Z_F, W])
    parameters = (A, m, d, 0.005, 2.0, (3.0, -4.0))
    there, back = theory.light_field_projection(*parameters), theory.light_field_reconstruction(*parameters)
    scale = np.abs(back) @ np.abs(there) @ np.abs(point)
    assert np.all(np.abs(theory.project(back, theory.project(there, point)) - point) <= 2e-15 * scale)


def test_all_matrices_tell_one_story():
    """Central view plus slope is every view; a microlens's pixel is where that view shows the point on it."""
    point = np.array([3.0, -2.0, 150.0, 1.0])
    parameters, centres = camera_arguments(P1), ((0.5, -0.5), (180.0, 120.0))
    u, v, slope = theory.from_homogeneous(theory.project(theory.light_field_projection(*parameters, centres[1]), point))
    assert slope == pytest.approx(theory.calibrated_epi_slope(150.0, *parameters), rel=1e-14)
    for s, t in [(-5.0, 3.0), (0.5, -0.5), (6.5, 6.0)]:
        seen = theory.from_homogeneous(theory.project(theory.view_projection((s, t), *parameters, *centres), point))
        np.testing.assert_allclose(seen, [u + slope * (s - 0.5), v + slope * (t + 0.5)], rtol=1e-14)
        pixel = theory.from_homogeneous(theory.project(theory.microlens_projection(seen, *parameters, *centres), point))
        np.testing.assert_allclose(pixel, [s, t], rtol=0, atol=1e-10)  # u = 180 over a slope of 0.76 per pixel
        ray = theory.project(theory.ray_matrix(*parameters, *centres), [s, t, *seen, 1.0])
        np.testing.assert_allclose(ray[:2] + 150.0 * ray[2:4], point[:2], atol=1e-11)


def test_signs_are_as_stated():
    parameters = camera_arguments(P1)
    central = theory.view_projection((0.0, 0.0), *parameters)
    chief = theory.from_homogeneous(theory.project(central, (5.0, 0.0, 230.0, 1.0)))
    assert chief[0] * 0.063 == pytest.approx(-92.0 * 5.0 / 230.0)  # the lens turns the picture round
    ray = theory.project(theory.ray_matrix(*parameters), (1.0, 0.0, 0.0, 0.0, 1.0))
    assert ray[0] == theory.pixel_to_pupil(1.0, 0.004847826, 2.0, 92.0) < 0  # and so do the microlenses


def test_pupil_frame_moves_the_origin_and_back():
    there, back = theory.pupil_frame(120.0), theory.pupil_frame(-120.0)
    np.testing.assert_array_equal(theory.project(there, (1.0, 2.0, 350.0, 1.0)), (1.0, 2.0, 230.0, 1.0))
    np.testing.assert_array_equal(theory.project(there, (1.0, 2.0, 350.0, 0.0)), (1.0, 2.0, 350.0, 0.0))
    np.testing.assert_array_equal(there @ back, np.eye(4))


def test_points_at_infinity_are_the_limit_of_far_points():
    matrix = theory.view_projection((4.0, -3.0), *camera_arguments(P1))
    at_infinity = theory.from_homogeneous(theory.project(matrix, (0.1, -0.2, 1.0, 0.0)))
    with mp.workdps(60):
        far = mp.mpf(10) ** 25
        for i, (tangent, s) in enumerate([(0.1, 4.0), (-0.2, -3.0)]):
            traced = microlens_of(X=mp.mpf(tangent) * far, Z_F=far, pixel=s, centre=0.0, u_0=0.0, **P1)
            assert abs(at_infinity[i] - traced) < 1e-13 * abs(traced)


def test_focal_plane_points_are_infinitely_far_for_a_microlens_and_one_point_for_all_views():
    on_focal_plane = (10.0, 5.0, 92.0 / 0.4, 1.0)
    views = theory.view_projection(np.stack(np.meshgrid(range(-6, 7), range(-6, 7)), -1), *camera_arguments(P1))
    seen = theory.from_homogeneous(theory.project(views, on_focal_plane))
    np.testing.assert_allclose(seen, np.broadcast_to(seen[6, 6], seen.shape), rtol=1e-13)
    pixel = theory.project(theory.microlens_projection((0.0, 0.0), *camera_arguments(P1)), on_focal_plane)
    assert abs(pixel[2]) <= 1e-13 * 92
    assert np.all(theory.from_homogeneous((*pixel[:2], 0.0)) == np.inf)


def test_pupil_at_the_lens_is_the_traditional_light_field():
    """Eq. 11: the same matrices, in the lens's own frame, with d_1 for A."""
    d_1, m = 140.0, 0.4
    parameters = (theory.effective_image_distance(100.0, 350.0, 0.0), m, 0.063, 0.0048, 2.0)
    assert parameters[0] == d_1
    np.testing.assert_array_equal(theory.pupil_frame(0.0), np.eye(4))
    ray = theory.project(theory.ray_matrix(*parameters), (3.0, 0.0, 40.0, 0.0, 1.0))
    assert ray[0] == theory.pixel_to_lens(3.0, 0.0048, 2.0, d_1)
    lens, slope = ray[0], -ray[2]  # slope by depth runs against the light
    arrival = lens + (slope - lens / 100.0) * d_1
    assert arrival == pytest.approx(40.0 * 0.063, rel=1e-14)


def test_matrices_are_batched():
    reach = np.array([80.0, 92.0, 100.0])
    views = np.zeros((5, 1, 2))
    matrix = theory.view_projection(views, reach, 0.4, 0.063, 0.0048, 2.0)
    assert matrix.shape == (5, 3, 3, 4)
    one = theory.view_projection((0.0, 0.0), 92.0, 0.4, 0.063, 0.0048, 2.0)
    np.testing.assert_array_equal(matrix[2, 1], one)
    assert theory.project(matrix, np.ones((3, 4))).shape == (5, 3, 3)
    for function in (theory.light_field_projection, theory.light_field_reconstruction):
        assert function(reach, 0.4, 0.063, 0.0048, 2.0).shape == (3, 4, 4)
    for function in (theory.ray_matrix, theory.decoding_matrix):
        assert function(reach, 0.4, 0.063, 0.0048, 2.0).shape == (3, 5, 5)
    assert theory.microlens_projection((0.0, 0.0), reach, 0.4, 0.063, 0.0048, 2.0).shape == (3, 3, 4)


def test_from_homogeneous_names_its_infinities():
    np.testing.assert_array_equal(theory.from_homogeneous((1.0, -1.0, 0.0, 0.0)), (np.inf, -np.inf, 0.0))
