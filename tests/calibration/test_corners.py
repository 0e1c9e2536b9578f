"""Checkerboard corners in real and drawn views, and the calibration that follows from them."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import erf

from roslf_design.calibration import (
    Board,
    CalibrationError,
    Captures,
    DataSheet,
    Intrinsics,
    LightField,
    calibrate,
    derived,
    find_corners,
    observe,
    observe_pictures,
    random_poses,
)
from roslf_design.calibration.corners import _checked_grid, _RowGrid, _solve, fit_saddles
from roslf_design.calibration.model import project_boards, rotation_matrix
from roslf_design.theory.lens_shapes import LENS_SHAPES
from tests.oracles.calibration import board_view

BOARD = Board(4, 5, 6.0)
CAMERA = {"A": 92.0, "m": 0.4, "d_2": 2.0, "x_0": 80.0, "y_0": 75.0, "q": 0.004847826, "d": 0.12}


def drawn_field(pose, offsets, noise, rng, cells=(4, 5), print_=None):
    u, v = np.arange(12.0, 152.0), np.arange(8.0, 142.0)
    turn, shift = rotation_matrix(pose[:3]), pose[3:]
    at = (turn, shift, cells, 6.0)
    values = np.array([[board_view(CAMERA, *at, (s, t), u, v, print_=print_) for s in offsets] for t in offsets])
    values = (values + rng.normal(0, noise, values.shape)).astype(np.float32)
    return LightField(values, np.ones_like(values), offsets, offsets.copy(), u, v, 13.0)


@pytest.fixture(scope="module")
def drawn():
    """Light fields of four boards, and the boards' poses."""
    rng = np.random.default_rng(11)
    poses = random_poses(Captures(boards=4, tilt=0.35, offset=4.0), 120.0, rng)
    offsets = np.array([-5.0, 0.0, 5.0])
    fields = {f"board-{k}": drawn_field(pose, offsets, 0.01, rng) for k, pose in enumerate(poses.vector)}
    return fields, poses


@pytest.fixture(scope="module")
def observations(drawn):
    return observe(drawn[0], BOARD)


def test_drawn_boards_are_measured_to_a_few_hundredths_of_a_sample(drawn, observations):
    assert observations.missing == ()
    assert observations.seen.all()
    assert len(observations.views) == 9
    camera = Intrinsics(92.0, 0.4, 0.5, 80.0, 75.0, q=CAMERA["q"], d=CAMERA["d"])
    truth = project_boards(camera.vector(), drawn[1].vector, BOARD.points, observations.views).values
    error = observations.uv - truth  # a board of 4 x 5 cells knows its way round by its colours
    assert np.sqrt(np.mean(error**2)) < 0.02
    assert np.abs(error).max() < 0.1


def test_calibration_from_drawn_boards_finds_the_camera(observations):
    sheet = DataSheet(100.0, CAMERA["q"], CAMERA["d"], 1.0)
    found = calibrate(observations, sheet)
    sigma = found.fit.covariance.sigma
    for name, true in (("A", 92.0), ("m", 0.4), ("inverse_d_2", 0.5), ("x_0", 80.0), ("y_0", 75.0)):
        assert getattr(found.fit.camera, name) == pytest.approx(true, abs=3.5 * sigma[name]), name
    assert found.joint.rms < 0.08
    assert derived(found.joint.camera.vector(), sheet)["d_3"] == pytest.approx(120.0, abs=3.5 * sigma["A"] / 0.4)


def test_a_board_of_cells_too_small_to_place_is_missing():
    """Cells of three microlenses: OpenCV finds the grid, but hardly a corner settles."""
    pose = random_poses(Captures(boards=1, tilt=0.35, distance=1650.0), 120.0, np.random.default_rng(3)).vector[0]
    field = drawn_field(pose, np.array([-1.0, 0.0, 1.0]), 0.01, np.random.default_rng(4))
    with pytest.raises(CalibrationError, match="no board of 4 x 5 cells"):
        observe({"far": field}, BOARD)


def test_images_without_a_board_are_named_and_the_others_used(drawn):
    fields = dict(list(drawn[0].items())[:2])
    some = next(iter(fields.values()))
    fields["lens cap"] = LightField(some.values * 0, some.weight, some.s, some.t, some.u, some.v, some.pitch)
    observations = observe(fields, BOARD)
    assert observations.missing == ("lens cap",)
    assert observations.names == ("board-0", "board-1")
    with pytest.raises(
        CalibrationError, match=r"no board of 4 x 5 cells \(3 x 4 inner corners\) was found .* lens cap"
    ):
        observe({"lens cap": fields["lens cap"]}, BOARD)
    with pytest.raises(CalibrationError, match="no images of the board"):
        observe({}, BOARD)
    small = LightField(some.values[..., :60], some.weight[..., :60], some.s, some.t, some.u[:60], some.v, some.pitch)
    with pytest.raises(CalibrationError, match="light field of small differs in size"):
        observe({"board-0": some, "small": small}, BOARD)


def test_dark_views_are_left_out_and_gaps_filled(drawn):
    field = next(iter(drawn[0].values()))
    weight = field.weight.copy()
    weight[0, 0] = 0.0
    weight[:, :, 62, 48:51] = 0.0
    values = np.where(weight > 0, field.values, np.nan).astype(np.float32)
    holed = LightField(values, weight, field.s, field.t, field.u, field.v, field.pitch)
    observations = observe({"holed": holed}, BOARD)
    assert len(observations.views) == 8
    assert observations.seen.any(axis=(0, 2)).all()
    assert len(observe({"holed": holed}, BOARD, most_views=1).views) == 1


def test_overlap_of_images_at_the_pupils_rim_is_not_what_views_are_judged_by():
    """Light of the guide's practice camera built with d_3 = 42 mm for 40: images 6.7 px wide, 6.4 px apart."""
    quarter = [[0.8, 0.8, 0.8, 0.98], [0.8, 0.8, 0.8, 0.77], [0.8, 0.8, 0.68, 0.25], [0.98, 0.77, 0.25, 0.0]]
    light = np.pad(quarter, ((3, 0), (3, 0)), mode="reflect")
    offsets, rng = np.arange(-3.0, 4.0), np.random.default_rng(3)
    pose = random_poses(Captures(boards=1, tilt=0.35, offset=4.0), 120.0, rng).vector[0]
    field = replace(drawn_field(pose, offsets, 0.01, rng), pitch=6.4)

    def seen_in(light):
        return observe({"board": replace(field, weight=field.weight * np.float32(light[..., None, None]))}, BOARD)

    assert {tuple(view) for view in seen_in(light).views} >= {(0, 0), (1, 0), (0, 1), (-1, 0), (0, -1)}
    assert np.abs(seen_in(light).views).max() == 1
    closer = np.where(np.hypot(*np.meshgrid(offsets, offsets)) > 1.5, 1.0, 0.5)
    with pytest.raises(CalibrationError, match=r"one view alone .* 6\.4 px apart, overlap; narrow the aperture"):
        seen_in(closer)
    smaller = np.where(np.hypot(*np.meshgrid(offsets, offsets)) > 1.5, 0.1, 0.5)
    with pytest.raises(CalibrationError, match=r"one view alone .* are too small; open the aperture"):
        seen_in(smaller)


def test_a_wrong_grid_is_not_taken_for_the_board():
    picture = (np.add.outer(np.arange(60) // 10, np.arange(50) // 10) % 2).astype(float)  # 5 x 6 cells of 10 px
    across, down = np.meshgrid([9.5, 19.5, 29.5, 39.5], [9.5, 19.5, 29.5, 39.5, 49.5])
    true = np.stack([across, down], axis=-1).reshape(-1, 2)
    board = Board(5, 6, 1.0)
    np.testing.assert_array_equal(_checked_grid(true, board, picture), true)
    np.testing.assert_array_equal(_checked_grid(true[::-1].copy(), board, picture), true)  # half a turn
    mirrored = true.reshape(5, 4, 2)[:, ::-1].reshape(-1, 2)
    np.testing.assert_array_equal(_checked_grid(mirrored, board, picture), true)
    skipping = true.copy().reshape(5, 4, 2)
    skipping[2:, :, 1] += 10.0
    assert _checked_grid(skipping.reshape(-1, 2), board, np.pad(picture, (0, 20))) is None
    assert _checked_grid(true + np.array([10.0, 0.0]), board, np.pad(picture, (0, 20), constant_values=1.0)) is None
    assert _checked_grid(true * 0.1, board, picture) is None


def test_saddles_are_exact_on_exact_pictures():
    half = 6
    y, x = np.mgrid[-20:21, -20:21].astype(float)
    for angle, other, blur, at in ((0.0, math.pi / 2, 0.3, (0.31, -0.42)), (0.4, 1.7, 0.8, (-0.2, 0.1))):
        picture = np.zeros_like(x)
        for i, j in _square_rule(12):
            a = math.cos(angle) * (y + j - at[1]) - math.sin(angle) * (x + i - at[0])
            b = math.cos(other) * (y + j - at[1]) - math.sin(other) * (x + i - at[0])
            picture += erf(a / (blur * math.sqrt(2))) * erf(b / (blur * math.sqrt(2))) / 144
        found = fit_saddles(
            5 - 2 * picture + 0.01 * x,
            np.ones(x.shape, bool),
            np.array([[20.6, 19.5]]),
            np.array([[angle, other]]),
            half,
        )
        assert found.settled.all()
        np.testing.assert_allclose(found.corners[0] - 20, at, atol=2e-3)  # three nodes a sample for an edge of 0.3 px
        assert found.contrast[0] == pytest.approx(-2.0, rel=0.02)


def test_saddles_of_round_microlenses_in_a_hexagonal_array():
    """Sharp edges averaged over round apertures, by brute force; interpolated to a square grid, corners err by 0.03."""
    rng, step, rows = np.random.default_rng(0), math.sqrt(3) / 2, np.arange(-14, 15)
    turn = math.pi * (3 - math.sqrt(5)) * np.arange(400)
    aperture = 0.5 * np.sqrt((np.arange(400) + 0.5) / 400) * np.array([np.cos(turn), np.sin(turn)])
    starts = -16 + 0.5 * (rows % 2)
    u, v = np.broadcast_arrays(starts[:, None] + np.arange(33), step * rows[:, None])
    off = []
    for _ in range(60):
        first = rng.uniform(-0.5, 0.5)
        second, at = first + math.pi / 2 + rng.uniform(-0.2, 0.2), rng.uniform(-0.5, 0.5, 2)
        x, y = u[..., None] + aperture[0] - at[0], v[..., None] + aperture[1] - at[1]
        sides = [math.cos(angle) * y - math.sin(angle) * x for angle in (first, second)]
        picture = np.sign(sides[0] * sides[1]).mean(axis=-1)
        start = 14 + at[None] / step + rng.normal(0, 0.2, (1, 2))
        edges, grid = np.array([[first, second]]), _RowGrid(starts / step + 14, 1 / step)
        known = np.ones(picture.shape, bool)
        found = fit_saddles(picture, known, start, edges, 4, LENS_SHAPES["circular"].rule(1 / step), grid)
        assert found.settled.all()
        off.append((found.corners[0] - 14) * step - at)
    assert np.std(off) < 0.009


def _square_rule(n):
    middle = (np.arange(n) + 0.5) / n - 0.5
    return np.stack(np.meshgrid(middle, middle), axis=-1).reshape(-1, 2)


def test_nothing_in_a_blank_picture():
    assert find_corners(np.zeros((60, 60)), BOARD) is None
    assert find_corners(np.full((60, 60), np.nan), BOARD) is None
    with pytest.raises(CalibrationError, match=r"no board of 4 x 5 cells was found in: picture 1"):
        observe_pictures([np.zeros((60, 60))], BOARD)


# --- boards of which part is seen -------------------------------------------------------------------------------------

CHARUCO = Board.parse("charuco 7x6 6 mm 4.5 mm DICT_4X4_50")
ASIDE = [(14.0, 2.0), (-13.0, 3.0), (2.0, 13.0), (-3.0, -14.0), (11.0, 10.0)]
"""Middles of the boards [mm]: each sticks out of a field of about 42 x 40 mm on one side, the last on two."""


@pytest.fixture(scope="module")
def partly():
    """Light fields of ChArUco boards that stick out of the field, one half in the dark, and where their corners are."""
    import cv2

    rng = np.random.default_rng(5)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    printed = cv2.aruco.CharucoBoard((7, 6), 6.0, 4.5, dictionary).generateImage((7 * 96, 6 * 96))
    poses = random_poses(Captures(boards=len(ASIDE), tilt=0.35), 120.0, rng).vector
    poses[:, 3:5] = ASIDE
    offsets = np.array([-5.0, 0.0, 5.0])
    fields = {f"board-{k}": drawn_field(pose, offsets, 0.01, rng, (7, 6), printed) for k, pose in enumerate(poses)}
    fields["board-1"].values[..., 90:, :] *= 0.02
    observations = observe(fields, CHARUCO)
    camera = Intrinsics(92.0, 0.4, 0.5, 80.0, 75.0, q=CAMERA["q"], d=CAMERA["d"])
    truth = project_boards(camera.vector(), poses, CHARUCO.points, observations.views).values
    return fields, observations, truth


def test_corners_in_sight_of_a_board_that_sticks_out_of_the_field(partly):
    _, observations, truth = partly
    assert observations.missing == ()
    error = np.where(observations.seen[..., None], observations.uv - truth, 0.0)  # a wrong id is 20 pitches off
    assert np.abs(error).max() < 0.05
    inside = (np.abs(truth - (81.5, 74.5)) < (60.0, 57.0)).all(axis=-1)  # whole windows, and some margin
    inside[1] &= truth[1, ..., 1] < 88.0
    assert (inside & observations.seen).sum() >= 0.98 * inside.sum()
    assert not inside.all(axis=(1, 2)).any()
    assert not observations.seen[1][truth[1, ..., 1] > 95.0].any()  # in the dark, from 98 on


def test_calibration_from_boards_partly_seen_finds_the_camera(partly):
    found = calibrate(partly[1], DataSheet(100.0, CAMERA["q"], CAMERA["d"], 1.0))
    sigma = found.fit.covariance.sigma
    for name, true in (("A", 92.0), ("m", 0.4), ("inverse_d_2", 0.5)):
        assert getattr(found.fit.camera, name) == pytest.approx(true, abs=3 * sigma[name]), name
        assert sigma[name] < 0.02 * true


def test_markers_of_another_board_are_not_taken_for_it(partly):
    field = partly[0]["board-0"]
    assert find_corners(field.view(), CHARUCO) is not None
    assert find_corners(field.view(), Board.parse("charuco 7x6 6 mm 4.5 mm DICT_5X5_50")) is None
    assert find_corners(np.zeros((60, 60)), CHARUCO) is None
    assert find_corners(field.view()[:40, :40], CHARUCO) is None  # too few corners


def test_steps_of_the_fit_are_those_of_a_general_solver():
    rng = np.random.default_rng(4)
    root, step = np.full((9, 9), np.nan), np.full(9, np.nan)
    for scales in (np.ones(9), 10.0 ** rng.uniform(-3, 3, 9)):
        lines = rng.normal(size=(40, 9)) * scales
        normal, right = lines.T @ lines, rng.normal(size=9)
        _solve(normal, right, root, step)
        np.testing.assert_allclose(step, np.linalg.solve(normal, right), rtol=1e-9)  # condition 10 without its scales
    # Two parameters that stand for the same: one of many solutions, and finite.
    same = lines[:, [0, 1, 2, 3, 4, 5, 6, 7, 7]]
    right = same.T @ rng.normal(size=40)
    _solve(same.T @ same, right, root, step)
    np.testing.assert_allclose(same.T @ same @ step, right, rtol=1e-6, atol=1e-6 * np.abs(right).max())
