"""Rings drawn by a projection of the test's own: a pinhole, a tilted sheet off the axis, lines of known width."""

import math

import numpy as np
import pytest

from roslf_design.bench.field import FieldAngles, Rings, RingView
from roslf_design.calibration.frames import CalibrationError

RADII = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 5.0, 10.0, 15.0, 20.0, 25.0)
LINE = 0.2
SAMPLE_ANGLE = 0.0105
"""Slope from microlens to microlens."""
ENDS = np.array([[-38.0, 38.0], [-28.5, 28.5]])


def drawn(away, rng, tilt=(0.0, 0.0), centre=(0.0, 0.0), noise=0.01, fine=5):
    """Picture of the rings by a pinhole so far away, each microlens averaged over itself."""
    u, v = np.arange(-37, 38.0), np.arange(-28, 29.0)
    step = (np.arange(fine) + 0.5) / fine - 0.5
    x, y = (SAMPLE_ANGLE * (axis[:, None] + step).ravel() for axis in (u, v))
    way = np.stack(np.broadcast_arrays(x, y[:, None], 1.0))
    # The sheet: through (centre, away), spanned by its own unit vectors.
    ax, ay = tilt
    one = np.array([math.cos(ax), 0.0, math.sin(ax)])
    other = np.cross([-math.sin(ax), 0.0, math.cos(ax)], one)
    other = other / np.linalg.norm(other)
    turned = math.cos(ay) * other + math.sin(ay) * np.cross(one, other)
    normal = np.cross(one, turned)
    origin = np.array([*centre, away])
    t = normal @ origin / np.einsum("i,ijk->jk", normal, way)
    at = t * way - origin[:, None, None]
    radius = np.hypot(np.einsum("i,ijk->jk", one, at), np.einsum("i,ijk->jk", turned, at))
    gaps = np.diff([0.0, *RADII])
    dark = sum(np.abs(radius - r) < LINE * gap / 2 for r, gap in zip(RADII, gaps, strict=True))
    picture = 0.9 - 0.8 * dark
    picture = picture.reshape(v.size, fine, u.size, fine).mean((1, 3))
    picture = picture * (1 - 0.1 * ((u / 38) ** 2 + (v[:, None] / 38) ** 2)) + noise * rng.standard_normal(
        picture.shape
    )
    return picture, (u, v)


def seen(away, ahead, seed, **look):
    picture, axes = drawn(away, np.random.default_rng(seed), **look)
    sample = 1.04 * SAMPLE_ANGLE * away
    return RingView.of(picture, np.ones(picture.shape, bool), axes, ENDS, Rings.of(RADII, LINE), ahead, sample, away)


@pytest.mark.parametrize(("away", "centre"), [(6.0, (0.1, -0.2)), (50.0, (1.5, 1.0))])
def test_field_on_a_tilted_sheet_is_that_of_the_pinhole(away, centre):
    view = seen(away, away - 1, 0, tilt=(0.05, -0.03), centre=centre)
    width, height = 76 * SAMPLE_ANGLE * away, 57 * SAMPLE_ANGLE * away
    truth = np.array([width, height, math.hypot(width, height)])
    assert view.sizes_mm == pytest.approx(truth, rel=2e-3)
    assert (view.sigma < 2e-3 * truth).all()


def test_angle_from_two_distances_holds_the_truth():
    truth = np.rad2deg(2 * np.arctan(SAMPLE_ANGLE * np.array([76, 57, 95]) / 2))
    off, pupils = [], []
    for seed in range(4):
        rng = np.random.default_rng(100 + seed)
        looks = [
            seen(
                away + rng.normal(0, 0.02),
                away - 1,
                seed,
                tilt=rng.normal(0, 0.02, 2),
                centre=rng.normal(0, 0.01 * away, 2),
            )
            for away in (6.0, 50.0)
        ]
        angles = FieldAngles.of(*looks, placed=(0.02, 0.02), printed=1e-4)
        off.append((angles.degrees - truth) / angles.sigma)
        pupils.append((angles.pupil_behind_tip - 1.0) / angles.pupil_sigma)
    assert np.abs(off).max() < 4
    assert np.sqrt(np.mean(np.square(off))) < 1.6
    assert np.sqrt(np.mean(np.square(pupils))) < 1.6


def test_other_picture_is_refused():
    rng = np.random.default_rng(0)
    picture = (
        0.5
        + 0.2 * np.sign(np.sin(np.arange(75) / 3) * np.sin(np.arange(57)[:, None] / 3))
        + rng.normal(0, 0.01, (57, 75))
    )
    with pytest.raises(CalibrationError, match="no rings"):
        RingView.of(
            picture, np.ones((57, 75), bool), (np.arange(-37, 38.0), np.arange(-28, 29.0)), ENDS,
            Rings.of(RADII, LINE), 49.0, SAMPLE_ANGLE * 50, 50.0,
        )  # fmt: skip
