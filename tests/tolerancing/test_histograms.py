"""Streamed histograms against the arrays they stand for."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from roslf_design.reporting.tolerance.pictures import distributions, ranked_correlations, ranked_moves
from roslf_design.tolerancing import summaries, tally


def count(values):
    """Bin counts of one column."""
    row = np.array(values, dtype=float)[None]
    counts, (total, square, low, high) = np.zeros((1, tally.BINS), np.int64), np.zeros((4, 1))
    tally.add_up.compiled(row, row.view(np.int64), counts, total, square, low, high, np.zeros(1, np.int64))
    assert total[0] == pytest.approx(row.sum(), rel=1e-9, abs=1e-6)
    assert (low[0], high[0]) == (row.min(initial=np.inf), row.max(initial=-np.inf))
    return counts[0]


@given(arrays(float, st.integers(2, 300), elements=st.floats(-1e6, 1e6)), st.floats(0.01, 0.99))
def test_quantiles_lie_between_the_order_statistics_around_them(values, p):
    counts = count(values)
    assert counts.sum() == len(values)
    (found,) = tally.quantiles(counts, [p], values.min(), values.max())
    ordered = np.sort(values)
    rank = p * len(values)
    low, high = ordered[max(int(np.floor(rank)) - 1, 0)], ordered[min(int(np.ceil(rank)), len(values) - 1)]
    slack = 2.0 / tally.SPLIT

    def wider(value, way):
        return value + way * (abs(value) * slack + 2.0**-49)

    assert wider(low, -1) <= found <= wider(high, 1)


@given(arrays(float, 200, elements=st.floats(-1e3, 1e3)), st.integers(0, 200))
def test_counts_add_up(values, cut):
    np.testing.assert_array_equal(count(values), count(values[:cut]) + count(values[cut:]))


def test_every_value_lies_in_its_bin():
    values = np.concatenate([10.0 ** np.linspace(-14, 8, 3001), -(10.0 ** np.linspace(-14, 8, 3001)), [0.0]])
    bounds = tally.EDGES
    for value in values:
        (index,) = np.flatnonzero(count(np.array([value])))
        assert bounds[index] <= value <= bounds[index + 1]


def test_a_million_normals_have_the_quantiles_of_the_normal():
    x = np.random.default_rng(0).normal(size=1_000_000)
    found = tally.quantiles(count(x), [0.01, 0.25, 0.75, 0.99], x.min(), x.max())
    np.testing.assert_allclose(found, np.quantile(x, [0.01, 0.25, 0.75, 0.99]), rtol=1 / tally.SPLIT)


def test_values_at_nominal_are_an_atom():
    x = np.concatenate([np.zeros(900), -np.ones(100)])
    counts = count(x)
    assert tally.quantiles(counts, [0.05, 0.5, 0.99], -1, 0).tolist() == [pytest.approx(-1, rel=0.01), 0, 0]


def test_undefined_trials_rank_worst():
    counts = count(np.linspace(1, 2, 90))
    assert tally.quantiles(counts, [0.05, 0.95], 1, 2, above=10)[1] == np.inf
    assert tally.quantiles(counts, [0.05, 0.95], 1, 2, below=10)[0] == -np.inf
    assert tally.quantiles(counts, [0.5], 1, 2, above=10)[0] == pytest.approx(1.55, abs=0.02)


@given(arrays(float, 100, elements=st.floats(-50, 50)))
def test_rebinning_keeps_every_trial(values):
    cuts = np.concatenate([[-np.inf], np.linspace(-50, 50, 21)[1:-1], [np.inf]])
    bars = tally.rebin(count(values), cuts)
    assert bars.sum() == pytest.approx(100)
    assert (bars >= 0).all()


def test_one_build_far_off_does_not_take_the_axis_from_the_others():
    values = 0.3 * np.random.default_rng(3).standard_normal(10_000)
    values[:2] = 2e10, -7e9
    tallied = SimpleNamespace(
        counts=count(values)[None, None], trials=len(values), low=np.array([[values.min()]]),
        high=np.array([[values.max()]]), moments=np.array([[[values.sum(), (values**2).sum()]]]),
        undefined=np.zeros((1, 1)), infinite=np.zeros((1, 1)), impossible=np.zeros(1),
    )  # fmt: skip
    plan = SimpleNamespace(nominal=[5.0], limits=(), quantiles=(0.5,), columns=("u_Z",))
    column = summaries._summary(plan, tallied, 0, 0)
    assert (column.low, column.high) == (5 - 7e9, 5 + 2e10)
    assert sum(column.histogram) == pytest.approx(len(values))
    cuts, heights = np.array(column.cuts), np.array(column.histogram)
    first, last = 5 + np.quantile(values, (0.01, 0.99))
    assert (cuts[1], cuts[-2]) == pytest.approx((first, last), abs=0.02)
    picture = distributions([("as built", cuts, heights)], 5.0, [5.5], "u_Z [mm]")
    axis = picture.panels[0].x
    assert axis.low < first < last < axis.high
    assert axis.high - axis.low < 2 * (last - first)
    # Those of the picture's ends are spread evenly up to the farthest: none but these lie near.
    assert re.search(r"as built, 10,000 builds, (19\d|20\d) of them beyond the axis", picture.keys[0].text)


@pytest.mark.parametrize(
    ("picture", "words"),
    [
        (
            ranked_correlations(["d_3", "d_2"], np.array([0.01, -0.02]), 0.03, "u_Z"),
            "No single tolerance goes with u_Z",
        ),
        (ranked_moves(["d_3"], np.zeros(1), np.zeros(1), [1.0], "u_Z"), "No tolerance alone moves u_Z"),
        (distributions([("as built", np.empty(0), np.empty(0))], 5.0, [6.0], "u_Z"), "No build differs"),
    ],
)
def test_a_picture_of_nothing_is_a_sentence(picture, words):
    assert picture.panels == ()
    assert picture.title.startswith(words)
