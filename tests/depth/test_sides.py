"""Depth steps of the microlens camera: windows parted by the surface that each microlens sees, with their errors."""

import numpy as np
import pytest

from roslf_design.depth.estimate import DisparityStatus, PixelNoise, estimate_disparity
from tests.depth.made import Texture, disc, exposed, sharp

SHAPE, EDGE, NEAR, FAR, ELECTRONS = (40, 40), 19.5, 0.25, -0.25, 20_000.0
PUPIL, LIT = disc(9)


def views_of(near, far):
    """Views of a surface right of an edge, which moves with it, before another one, with light."""
    front, behind = (
        sharp(Texture.of(seed, 0.2), b, PUPIL, LIT, SHAPE).astype(float) for seed, b in ((1, near), (2, far))
    )
    at = np.arange(SHAPE[1]) - EDGE - near * PUPIL[0][..., None, None]  # (t, s, 1, u)
    return np.clip(at + 0.5, 0, 1) * front + (1 - np.clip(at + 0.5, 0, 1)) * behind


def found(views, turned=False):
    field = exposed(np.swapaxes(views, 2, 3) if turned else views, 1.0 * LIT[..., None, None], ELECTRONS, 2.0, 5)
    pupil = PUPIL[::-1] if turned else PUPIL
    return estimate_disparity(field, pupil, PixelNoise(ELECTRONS, 2.0), search=(-1.0, 1.0))


@pytest.mark.parametrize("turned", [False, True])
def test_both_sides_of_a_step_are_known_up_to_its_edge_with_their_errors(turned):
    step = found(views_of(NEAR, FAR), turned)
    parts = [part.T if turned else part for part in (step.disparity, step.sigma, step.measured)]
    disparity, sigma, known = (part[4:-4] for part in parts)
    beside = np.arange(SHAPE[1]) - EDGE
    true = np.where(beside > 0, NEAR, FAR)
    # The edge moves with the nearer surface: on its side two or three microlenses are not told.
    for side in ((beside < -2) & (beside > -8), (beside > 4) & (beside < 8)):
        assert known[:, side].mean() > 0.95
        off = np.abs(disparity - true)[:, side][known[:, side]]
        assert (off < sigma[:, side][known[:, side]]).mean() > 0.6
    near = np.abs(beside) < 8
    assert (np.abs(disparity - true) > 5 * sigma)[:, near][known[:, near]].mean() < 0.01
    assert (step.status[~step.measured] == DisparityStatus.INCONSISTENT).mean() > 0.9


def test_a_slanted_wall_and_a_bent_one_have_no_step(monkeypatch):
    """Windows of both are as they were."""
    walls = (lambda u: 0.02 * (u - 20.0)), (lambda u: 0.25 - 0.0015 * (u - 20.0) ** 2)
    views = [sharp(Texture.of(3, 0.2), wall, PUPIL, LIT, SHAPE) for wall in walls]
    parted = [found(each) for each in views]
    monkeypatch.setattr("roslf_design.depth.estimate.parted", lambda *_: None)
    for each, before in zip(views, parted, strict=True):
        np.testing.assert_array_equal(found(each).disparity, before.disparity)
