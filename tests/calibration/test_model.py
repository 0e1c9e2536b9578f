"""The model of corners in views against traced rays, the theory's matrices and complex steps."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roslf_design.calibration.calibrate import corner_statistics
from roslf_design.calibration.model import GLOBALS, Board, Intrinsics, Poses, project_boards, rotation_matrix
from roslf_design.calibration.planning import Captures, random_poses, synthetic_observations
from roslf_design.theory import from_homogeneous, project, view_projection
from tests.oracles.calibration import traced_view

CAMERA = Intrinsics(92.0, 0.4, 0.5, 180.0, 120.0, 0.4, -3.0, q=0.004847826, d=0.063)
VIEWS = np.array([[0.0, 0.0], [3.0, -2.0], [-5.0, 6.0]])


def some_poses(rng):
    pose = np.concatenate([rng.normal(0, 0.3, (4, 3)), rng.normal(0, 20, (4, 3)) + np.array([0, 0, 230])], axis=1)
    pose[0, :3] = 1e-9  # the series at no rotation
    pose[1, :3] += [0, 0, 3.1]  # near half a turn
    return pose


def test_model_agrees_with_traced_rays():
    optics = {"f": 100.0, "d_1": 140.0, "d_2": 2.0, "d_3": 120.0, "d": 0.063, "q": 0.004847826}
    camera = replace(CAMERA, x_0=0.0, y_0=0.0, k_1=0.0, k_2=0.0)
    rng = np.random.default_rng(1)
    points = np.array([[0.0, 0, 0], [6, 0, 0], [-12, 9, 0]])
    pose = some_poses(rng)
    uv = project_boards(camera.vector(), pose, points, VIEWS).values
    scene = np.einsum("bij,nj->bni", rotation_matrix(pose[:, :3]), points) + pose[:, None, 3:]
    for b, v, n in np.ndindex(4, 3, 3):
        x, y, z = scene[b, n]
        expected = traced_view(optics, (x, y, z + 120.0), VIEWS[v])
        np.testing.assert_allclose(uv[b, v, n], expected, rtol=1e-11, atol=1e-11)  # float64 against 60 digits


@given(st.floats(50, 150), st.floats(0.05, 2), st.floats(0.5, 20), st.integers(0, 100))
def test_model_without_distortion_is_the_theory_s_projection(A, m, d_2, seed):
    camera = Intrinsics(A, m, 1 / d_2, 31.0, -7.0, q=0.005, d=0.07)
    pose, points = some_poses(np.random.default_rng(seed)), Board(4, 5, 6.0).points
    uv = project_boards(camera.vector(), pose, points, VIEWS).values
    scene = np.einsum("bij,nj->bni", rotation_matrix(pose[:, :3]), points) + pose[:, None, 3:]
    matrix = view_projection(VIEWS, A, m, 0.07, 0.005, d_2, (0, 0), (31.0, -7.0))
    whole = np.concatenate([scene, np.ones((*scene.shape[:-1], 1))], axis=-1)
    expected = from_homogeneous(project(matrix[None, :, None], whole[:, None]))
    np.testing.assert_allclose(uv, expected, rtol=1e-11, atol=1e-9)


def test_derivatives_agree_with_complex_steps():
    pose, points = some_poses(np.random.default_rng(0)), Board(4, 5, 6.0).points
    found = project_boards(CAMERA.vector(), pose, points, VIEWS, derivatives=True)
    step = 1e-200
    for k in range(len(GLOBALS)):
        moved = CAMERA.vector().astype(complex)
        moved[k] += 1j * step
        exact = project_boards(moved, pose, points, VIEWS).values.imag / step
        np.testing.assert_allclose(found.by_globals[..., k], exact, rtol=1e-11, atol=1e-11 * np.abs(exact).max())
    for k in range(6):
        moved = pose.astype(complex)
        moved[:, k] += 1j * step
        exact = project_boards(CAMERA.vector(), moved, points, VIEWS).values.imag / step
        np.testing.assert_allclose(found.by_pose[..., k], exact, rtol=1e-11, atol=1e-11 * np.abs(exact).max())


def test_statistics_are_the_least_squares_lines_of_the_model_s_views():
    captures = Captures(boards=3, views=5)
    poses = random_poses(captures, 120.0, np.random.default_rng(2))
    plain = replace(CAMERA, k_1=0.0, k_2=0.0)
    for camera, tolerance in ((plain, 1e-11), (CAMERA, 2e-3)):  # distortion to second order in the baseline
        statistics = corner_statistics(synthetic_observations(camera, poses, captures), 0.06)
        model = statistics.model(camera.vector(), poses.vector)
        np.testing.assert_allclose(model.values, statistics.values, rtol=1e-11, atol=tolerance)


def test_derivatives_of_statistics_agree_with_complex_steps():
    rng = np.random.default_rng(3)
    captures = Captures(boards=4, views=3)
    pose = some_poses(rng)
    seen = synthetic_observations(CAMERA, Poses.from_vector(pose), captures)
    statistics = replace(
        corner_statistics(seen, 0.06), at=rng.normal(0, 2, (4, 12, 2)), share=rng.uniform(0.2, 0.8, (4, 12))
    )
    found = statistics.model(CAMERA.vector(), pose)
    step = 1e-200
    for k in range(len(GLOBALS)):
        moved = CAMERA.vector() + 1j * step * np.eye(len(GLOBALS))[k]
        exact = statistics.model(moved, pose).values.imag / step
        np.testing.assert_allclose(found.by_globals[..., k], exact, rtol=1e-11, atol=1e-11 * np.abs(exact).max())
    for k in range(6):
        exact = statistics.model(CAMERA.vector(), pose + 1j * step * np.eye(6)[k]).values.imag / step
        np.testing.assert_allclose(found.by_pose[..., k], exact, rtol=1e-11, atol=1e-11 * np.abs(exact).max())


def test_camera_names_its_parameters():
    assert CAMERA.vector(("m", "x_0")).tolist() == [0.4, 180.0]
    assert CAMERA.with_values(("m",), np.array([0.5])) == replace(CAMERA, m=0.5)
    with pytest.raises(TypeError, match="nonsense"):
        CAMERA.with_values(("nonsense",), np.array([0.5]))
