"""Medians, ratios and slopes against distributions and laws that are known."""

import math

import numpy as np
import pytest

from benchmarks.harness.samples import LEAST, Spread, paired_ratio, slope


def pairs(rng, true_ratio, rounds, drift=0.5, noise=0.1):
    """Times of two sides: a common state of the machine for each round, and noise of their own."""
    state = np.exp(rng.normal(0, drift, rounds))
    ours = state * np.exp(rng.normal(0, noise, rounds))
    return ours, true_ratio * state * np.exp(rng.normal(0, noise, rounds))


def test_interval_holds_the_true_ratio_as_often_as_it_says():
    rng = np.random.default_rng(0)
    held = 0
    trials = 400
    for _ in range(trials):
        ours, theirs = pairs(rng, 7.0, 15)
        found = paired_ratio(ours, theirs)
        held += found.low <= 7.0 <= found.high
    # 95 % wanted; a percentile bootstrap of the median of 15 is known to run from 92 to 97 %, and 400 trials scatter
    # by 1.1 % (one standard deviation): three of them on either side
    assert 0.89 <= held / trials <= 0.995


def test_the_machines_drift_cancels_in_pairs():
    rng = np.random.default_rng(1)
    ours, theirs = pairs(rng, 3.0, 31, drift=2.0, noise=0.01)  # times scatter by e^2, pairs by 1.4 %
    found = paired_ratio(ours, theirs)
    assert 2.95 < found.low <= found.value <= found.high < 3.05
    assert np.ptp(np.log(ours)) > 2


def test_equal_pairs_give_the_ratio_exactly():
    found = paired_ratio([1.0, 2.0, 4.0, 8.0, 16.0], [3.0, 6.0, 12.0, 24.0, 48.0])
    assert (found.low, found.value, found.high) == pytest.approx((3, 3, 3), rel=1e-15)
    assert found.pairs == 5


def test_swapped_sides_give_the_inverse():
    ours, theirs = pairs(np.random.default_rng(2), 5.0, 15)
    there, back = paired_ratio(ours, theirs), paired_ratio(theirs, ours)
    assert back.value == pytest.approx(1 / there.value, rel=1e-12)  # the same pairs are drawn, logarithms change sign
    assert back.low == pytest.approx(1 / there.high, rel=0.05)
    assert back.high == pytest.approx(1 / there.low, rel=0.05)


def test_same_times_same_interval():
    ours, theirs = pairs(np.random.default_rng(3), 2.0, 9)
    assert paired_ratio(ours, theirs) == paired_ratio(ours, theirs)


@pytest.mark.parametrize(
    ("ours", "theirs", "words"),
    [
        ([1.0] * (LEAST - 1), [1.0] * (LEAST - 1), "at least"),
        ([1.0] * 6, [1.0] * 7, "6 and 7"),
        ([1.0] * 4 + [0.0], [1.0] * 5, "above zero"),
        ([1.0] * 5, [1.0] * 4 + [math.nan], "above zero"),
    ],
)
def test_times_that_make_no_ratio_are_refused(ours, theirs, words):
    with pytest.raises(ValueError, match=words):
        paired_ratio(ours, theirs)


def test_spread_is_median_and_quartiles():
    found = Spread.of([5.0, 1.0, 4.0, 2.0, 3.0])
    assert (found.low, found.median, found.high, found.best, found.count) == (2, 3, 4, 1, 5)


@pytest.mark.parametrize("power", [-1.0, 0.0, 0.5, 1.0, 3.0])
def test_slope_of_a_power_law_is_its_power(power):
    sizes = np.array([1e3, 1e4, 1e5, 1e6])
    value, error = slope(sizes, 0.3 * sizes**power)
    assert value == pytest.approx(power, abs=1e-12)
    assert error < 1e-12


def test_slopes_error_is_that_of_many_repeated_fits():
    rng, sizes = np.random.default_rng(4), np.logspace(3, 8, 12)
    fits = [slope(sizes, sizes * np.exp(rng.normal(0, 0.2, sizes.size))) for _ in range(400)]
    values, errors = np.array(fits).T
    # the root mean square of the errors told estimates the scatter of the values, itself known to 1/sqrt(800)
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(values.std(), rel=0.15)


def test_one_point_has_no_slope():
    with pytest.raises(ValueError, match="two points"):
        slope([1.0], [1.0])
