"""Nine pictures of a flat board by a first-generation Lytro: its corners, its camera, and depth between the corners."""

import json

import numpy as np
import pytest
from PIL import Image
from scipy import ndimage

from roslf_design.calibration import Board, observe_pictures
from roslf_design.calibration.epilines import fit_lines
from roslf_design.calibration.fit import _step_one
from roslf_design.calibration.model import project_boards, rotation_matrix
from roslf_design.depth.estimate import PixelNoise, estimate_disparity
from tests.depth.made import field_of


@pytest.fixture(scope="module")
def board(shared_data):
    """The pictures, the corners found in them, and the camera that fits these."""
    folder = shared_data / "lytro-checkerboard"
    pictures = {path.name: np.asarray(Image.open(path).convert("L")) for path in sorted(folder.glob("*.png"))}
    observations = observe_pictures(pictures, Board(23, 20, 4.0))
    return pictures, observations, _step_one(observations, fit_lines(observations), 1.0, 1.0, distortion=2)


def test_real_views_of_a_first_generation_lytro(board, shared_data):
    pictures, observations, found = board
    assert len(observations.names) == len(pictures) == 9
    assert observations.missing == ()
    assert found.rms <= 0.15
    assert abs(found.camera.A - 539.0) < 0.02 * 539.0
    poses = json.loads((shared_data / "lytro-checkerboard" / "CalInfo.json").read_text())["EstCamPosesV"]
    theirs = 1000 * np.array(poses)[:, 2]  # of one of the board's outer corners, from another origin on the axis
    outer = observations.points[[0, 21, -22, -1]]
    ours = np.einsum("bj,nj->bn", rotation_matrix(found.poses.rotation)[:, 2], outer) + found.poses.translation[:, 2:]
    shift = np.linspace(0, 60, 601)
    off = np.abs(theirs[:, None, None] - ours[:, :, None] - shift).min(axis=1).max(axis=0)
    assert off.min() < 2.0  # their square is 4.1 x 4.0 mm


def test_a_plane_in_real_views_comes_out_plane(board):
    """A flat board before a Lytro, from nine sides: its central views laid on a plane 3 mm before the board.

    Each capture is one view only: the board moved and the camera stood, which is as good as a camera that moved. Where
    it stood follows from corners; that the board is flat between them, nobody told the estimator.
    """
    pictures, _, found = board
    turn, away = rotation_matrix(found.poses.rotation), found.poses.translation
    cameras = -np.einsum("bji,bj->bi", turn, away)
    step, before = 0.5, 3.0  # mm
    x, y = np.meshgrid(np.arange(-40, 40.1, step), np.arange(-12, 12.1, step))
    plane = np.stack([x, y, np.full_like(x, before)], -1).reshape(-1, 3)
    at = project_boards(found.camera.vector(), found.poses.vector, plane, np.zeros((1, 2))).values[:, 0]
    at = at.reshape(9, *x.shape, 2)
    views = np.stack([
        ndimage.map_coordinates(picture.astype(float), [places[..., 1], places[..., 0]], order=3)
        for picture, places in zip(pictures.values(), at, strict=True)
    ])  # fmt: skip
    views /= ndimage.uniform_filter(views, (0, 33, 33))  # the light on the board, over four cells
    # What is `before` behind the plane moves by so much of it from the middle to each camera.
    pupil = np.stack([(cameras[:, k, None, None] - axis) / cameras[:, 2, None, None] for k, axis in ((0, x), (1, y))])
    wide = np.ptp(pupil.mean(axis=(2, 3)), axis=1).max()
    field = field_of(views.reshape(3, 3, *x.shape), np.ones((3, 3, *x.shape), np.float32))
    unit = wide / step  # pitches over all cameras per mm
    where, noise = (pupil / wide).reshape(2, 3, 3, *x.shape), 0.1
    measured = estimate_disparity(
        field, where, PixelNoise(1e8, 1e8 * noise, measured=True), search=((before - 6) * unit, (before + 6) * unit),
        window=7,
    )  # fmt: skip
    known = measured.measured
    assert known.mean() > 0.9
    depth = measured.disparity[known] / unit
    columns = np.stack([np.ones(depth.size), x[known], y[known]], -1)
    level, along, down = np.linalg.lstsq(columns, depth, rcond=None)[0]
    off = depth - columns @ (level, along, down)
    # Views of this Lytro are interpolated: their noise is alike in neighbours, which makes errors larger.
    inside = np.abs(off) < measured.sigma[known] / unit
    assert 0.5 < inside.mean() < 0.75
    # At 132 to 189 mm, with pixels of 0.3 mm there: residual 0.05 mm, tilt below 0.1 degrees, 0.06 mm nearer.
    assert np.sqrt(np.mean(off**2)) < 0.08
    assert np.hypot(along, down) < np.radians(0.15)
    assert abs(level - before) < 0.1
