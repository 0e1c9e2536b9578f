"""Slopes, roughness and extremes of pictures against scipy's filters."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from roslf_design.depth.occlusion import sides_about
from roslf_design.depth.windows import extreme, gradient, roughness

SHAPES = (6, 5), (9, 31), (60, 40)


@pytest.mark.parametrize("shape", SHAPES)
def test_slopes_are_those_of_a_quintic_spline(shape: tuple[int, int]) -> None:
    picture = np.random.default_rng(1).uniform(0.2, 1, shape)
    along, down, known = gradient(picture, np.ones(shape, np.bool_), (1.0, 0.8))
    for found, axis, step in ((along, 1, 1.0), (down, 0, 0.8)):
        spline = ndimage.spline_filter1d(picture, 5, axis=axis, mode="mirror")
        slope = ndimage.correlate1d(spline, np.array([-1, -10, 0, 10, 1]) / (24 * step), axis, mode="mirror")
        np.testing.assert_allclose(found, slope, atol=1e-5)  # single precision
    assert known.all()


def test_slopes_are_known_where_the_neighbour_on_each_side_is_lit() -> None:
    lit = np.random.default_rng(2).uniform(size=(40, 30)) < 0.9
    known = gradient(np.ones(lit.shape), lit, (1.0, 1.0))[2]
    np.testing.assert_array_equal(known, ndimage.binary_erosion(lit, border_value=1))


@pytest.mark.parametrize("shape", SHAPES)
def test_roughness_is_the_mean_square_of_second_differences(shape: tuple[int, int]) -> None:
    picture = np.random.default_rng(3).uniform(size=shape)
    bent = [ndimage.correlate1d(picture, [1, -2, 1], axis) for axis in (1, 0)]
    np.testing.assert_allclose(roughness(picture), [ndimage.uniform_filter(part**2, 9) for part in bent], rtol=1e-6)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("window", [3, 7, 11])
def test_extremes_are_of_the_window_in_the_picture(shape: tuple[int, int], window: int) -> None:
    values = np.random.default_rng(4).uniform(size=shape)
    np.testing.assert_array_equal(extreme(np.maximum, values, window), ndimage.maximum_filter(values, window))
    np.testing.assert_array_equal(
        extreme(np.minimum, values > 0.2, window), ndimage.minimum_filter(values > 0.2, window)
    )


def test_surfaces_beside_are_weighted_means_of_every_other_known_disparity() -> None:
    rng, reach = np.random.default_rng(5), 6
    disparity = np.where(np.arange(30) < 13, 0.0, 2.0) + rng.normal(0, 0.1, (21, 30))
    disparity[rng.uniform(size=disparity.shape) < 0.2] = np.nan
    wanted = rng.uniform(size=disparity.shape) < 0.3
    found = sides_about(disparity, wanted, reach, 0.5)
    for v, u in np.ndindex(wanted.shape):
        v, u = v // 2 * 2, u // 2 * 2
        if not wanted[v : v + 2, u : u + 2].any():
            assert np.isnan(found[:, v, u]).all()
            continue
        b, a = (np.arange(at % 2, size, 2) for at, size in ((v, 21), (u, 30)))
        b, a = b[np.abs(b - v) <= reach], a[np.abs(a - u) <= reach]
        known = disparity[np.ix_(b, a)]
        weight = (np.add.outer((b - v) ** 2, (a - u) ** 2) + 0.1) ** -2.0
        middle = (np.nanmin(known) + np.nanmax(known)) / 2
        far, near = known <= middle, known > middle
        assert found[0, v, u] == pytest.approx((weight * known)[far].sum() / weight[far].sum())
        if np.nanmax(known) - np.nanmin(known) > 0.5:
            assert found[1, v, u] == pytest.approx((weight * known)[near].sum() / weight[near].sum())
        else:
            assert np.isnan(found[1, v, u])
