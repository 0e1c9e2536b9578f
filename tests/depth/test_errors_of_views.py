"""Errors of disparities whose noise only views tell: against their scatter, where noise is alike and surfaces bend."""

import numpy as np
import pytest
from scipy import ndimage

from roslf_design import _jit
from roslf_design.depth.estimate import PixelNoise, estimate_disparity
from roslf_design.depth.geometry import GridGeometry
from tests.depth.made import Texture, field_of, sharp

ACROSS, SIZE, NOISE = 7, (64, 120), 0.004
INNER = slice(8, -8)


def estimate(values, believed, weight=None):
    """Disparities of a grid of views, with noise only views tell."""
    field = field_of(values, np.ones(values.shape, np.float32) if weight is None else weight)
    views = GridGeometry(ACROSS, window=7).viewing(field).prepared(field)
    noise = PixelNoise(1e8, 1e8 * believed, measured=True)
    return estimate_disparity(views.field, views.pupil, noise, search=(-2.0, 4.0), window=7, edges=True)


def seen(disparity, seed):
    """Views of a surface without noise."""
    side = (np.arange(ACROSS) - (ACROSS - 1) / 2) / ACROSS
    pupil = np.stack(np.broadcast_arrays(-side[None, :], -side[:, None]))
    return sharp(Texture.of(seed, 0.25), disparity, pupil, np.ones((ACROSS, ACROSS), bool), SIZE)


@pytest.mark.parametrize("believed", [1.0, 2.0])
def test_noise_that_neighbours_share_widens_the_errors_where_it_is_and_not_elsewhere(believed):
    left, right = (slice(INNER.start, 52), slice(68, SIZE[1] - 8))
    views, scores, told, off = seen(1.2, 3), [], [], []
    for seed in range(4):
        white = np.random.default_rng(seed).normal(0, NOISE, views.shape)
        shared = ndimage.uniform_filter(white, (0, 0, 3, 3)) * 3  # the same rms, alike over 3 x 3 pixels
        noise = np.where(np.arange(SIZE[1]) < SIZE[1] / 2, white, shared)
        found = estimate(views + noise.astype(np.float32), believed * NOISE)
        assert found.measured[INNER, INNER].mean() > 0.95
        scores.append((found.disparity - 1.2) / found.sigma)
        told.append(found.sigma)
        off.append(found.disparity - 1.2)
    sides = [np.array(scores)[:, INNER, side] for side in (left, right)]
    # 4 x 7 x 6 windows of 7 x 7 without common pixels a side: 68 % to 4 %, and as much for what errors are told by.
    for side in sides:
        assert 0.6 < np.mean(np.abs(side[np.isfinite(side)]) < 1) < 0.76
    # One factor for the whole picture would make both sides alike.
    wider = np.median(np.array(told)[:, INNER, right]) / np.median(np.array(told)[:, INNER, left])
    scatter = [np.nanstd(np.array(off)[:, INNER, side]) for side in (left, right)]
    assert wider > 1.4
    assert wider == pytest.approx(scatter[1] / scatter[0], rel=0.2)


def test_a_bend_within_a_window_is_taken_off_and_half_of_it_counts_as_an_error():
    middle, radius, noise = SIZE[1] / 2, 400.0, 3e-3

    def bent(u):
        return 0.5 + (u - middle) ** 2 / (2 * radius)

    views = seen(bent, 4)
    views = views + np.random.default_rng(1).normal(0, noise, views.shape).astype(np.float32)
    inner = INNER, slice(38, 82)
    found = estimate(views, noise)
    error = (found.disparity - bent(np.arange(SIZE[1])))[inner]
    assert np.isfinite(error).mean() > 0.95
    # The mean of u^2/(2 r) over 7 samples is 4/(2 r), as much as noise makes; 30 windows of unlike texture.
    assert abs(np.nanmedian(error)) < 0.3 * 4 / (2 * radius)
    ratio = np.abs(error / found.sigma[inner])
    assert 0.55 < np.mean(ratio < 1) < 0.8
    assert np.mean(ratio < 2) > 0.9


def test_answers_are_the_same_bytes_on_any_number_of_threads_and_with_weights_that_take_no_room(monkeypatch):
    step = np.where(np.arange(SIZE[1]) < SIZE[1] / 2, seen(1.2, 3), seen(-0.8, 4))  # which is looked past
    views = step + np.random.default_rng(0).normal(0, NOISE, step.shape).astype(np.float32)
    runs = []
    for threads in (1, 3):
        monkeypatch.setattr(_jit, "threads", lambda threads=threads: threads)
        runs += [estimate(views, NOISE), estimate(views, NOISE, np.broadcast_to(np.float32(1), views.shape))]
    assert runs[0].measured.mean() > 0.9
    for other in runs[1:]:
        for name in ("disparity", "sigma", "status", "chi2", "views", "picture"):
            assert getattr(runs[0], name).tobytes() == getattr(other, name).tobytes()
