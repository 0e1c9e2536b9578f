"""Fill of places without a depth: between planes that are known exactly, and at the edges of rendered scenes."""

import numpy as np

from roslf_design.depth.dense import FARTHEST, HARDER, DenseMap, _joined
from roslf_design.depth.estimate import PixelNoise, estimate_disparity
from roslf_design.depth.geometry import GridGeometry
from tests.depth.test_occlusion import ACROSS, bar

NEAR, FAR, NOISE = 1.0, -1.0, 0.01


def two_planes(bright, dark):
    """Two planes that meet in the middle of 48 columns, six of them unknown: fill, what was measured, truth, known."""
    true = np.where(np.arange(48) < 24, NEAR, FAR) * np.ones((32, 1))
    known = np.ones(true.shape, bool)
    known[:, 21:27] = False
    measured = np.where(known, true + np.random.default_rng(0).normal(0, NOISE, true.shape), np.nan)
    sigma = np.where(known, NOISE, np.inf)
    return DenseMap.of(measured, sigma, known, np.where(true > 0, bright, dark)), measured, true, known


def test_an_edge_of_the_picture_is_followed_and_known_ones_stay():
    dense, measured, true, known = two_planes(0.8, 0.4)
    np.testing.assert_array_equal(dense.disparity[known], measured[known])
    np.testing.assert_array_equal(dense.sigma[known], NOISE)
    # Neighbours across this edge hold together by 1/(1 + 33^2); 3 % of the step is more than that over three pixels.
    assert (np.abs(dense.disparity - true)[~known] < 0.03 * (NEAR - FAR)).all()
    assert (dense.sigma[~known] >= NOISE).all()


def test_where_the_picture_has_no_edge_the_error_told_grows_to_the_step():
    dense, _, true, known = two_planes(0.5, 0.5)
    # A straight line from plane to plane, by the mean value of harmonic functions: 3 of 7 steps at the edge.
    line = NEAR + (FAR - NEAR) * np.arange(1, 7) / 7
    np.testing.assert_allclose(dense.disparity[8:-8, 21:27], np.tile(line, (16, 1)), atol=3 * NOISE)
    share = np.arange(1, 7) / 7
    likelier = (NEAR - FAR) * np.minimum(share, 1 - share)
    ratio = dense.sigma[8:-8, 21:27] / likelier
    # One factor everywhere, by the places held out; noise of the ends adds a hundredth.
    assert np.ptp(ratio) < 0.05
    # The likelier plane is the true one here, so that each error is told: a share within it would be none or all.
    np.testing.assert_allclose(dense.sigma[~known], HARDER * np.abs(dense.disparity - true)[~known], rtol=0.1)


def test_errors_told_hold_beside_a_bar_that_views_were_measured_of():
    field, true = bar()
    views = GridGeometry(ACROSS).viewing(field).prepared(field)
    noise = PixelNoise(1e8, 2e5, measured=True)
    found = estimate_disparity(views.field, views.pupil, noise, search=(-8.0, 8.0), window=7, edges=False)
    dense = DenseMap.of(found.disparity, found.sigma, found.measured, found.picture)
    some = ~found.measured & np.isfinite(dense.disparity)
    assert some.mean() > 0.2
    # Between two planes each error is told, but for `HARDER`: what is left here was looked at by no edges.
    times = (np.abs(dense.disparity / ACROSS - true) / (dense.sigma / ACROSS))[some] * HARDER
    assert 0.95 < np.quantile(times, 0.1) < np.quantile(times, 0.68) < np.quantile(times, 0.84) < 1.05


def test_nothing_is_filled_in_far_from_all_that_is_known():
    known = np.zeros((8, 60), bool)
    known[:, :10] = True
    dense = DenseMap.of(np.where(known, 1.0, np.nan), np.where(known, 0.01, np.inf), known, np.ones(known.shape))
    some = np.isfinite(dense.disparity)
    assert some[:, : 10 + FARTHEST].all()
    assert not some[:, 10 + FARTHEST :].any()
    assert (np.isfinite(dense.sigma) == some).all()
    none = DenseMap.of(np.full((4, 4), np.nan), np.full((4, 4), np.inf), np.zeros((4, 4), bool), np.ones((4, 4)))
    assert np.isnan(none.disparity).all()
    assert np.isinf(none.sigma).all()


def test_places_hold_together_alike_in_a_picture_that_is_mostly_dark():
    picture = np.zeros((6, 8), np.float32)
    picture[:2] = 1.0
    with np.errstate(all="raise"):
        joined = _joined(picture).toarray()
    assert joined[0, 1] == joined[40, 41] == 1.0
    assert 0 < joined[8, 16] < 0.5
