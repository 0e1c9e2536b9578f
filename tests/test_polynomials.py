"""Polynomials over a box against functions with known Chebyshev series and derivatives, and in exact arithmetic."""

from fractions import Fraction

import numpy as np
import pytest
from numpy.testing import assert_allclose

from roslf_design.polynomials import Polynomials, nodes_between, products

MIDDLE, HALF = np.array([0.5, -1.0]), np.array([2.0, 0.25])


def smooth(x, y):
    return np.stack([np.sin(x + 2 * y), np.exp(0.3 * x * y)])


def gradient(x, y):
    wave, rise = np.cos(x + 2 * y), np.exp(0.3 * x * y)
    return np.stack([[wave, 0.3 * y * rise], [2 * wave, 0.3 * x * rise]])


def places(count, seed):
    unit = np.random.default_rng(seed).uniform(-1, 1, (2, count))
    return MIDDLE[:, None] + HALF[:, None] * unit


def test_products_are_those_of_the_recurrence_in_fractions():
    x, y = Fraction(3, 8), Fraction(-7, 16)  # exact in binary, and so are the products
    powers = [[Fraction(1), v, *(0,) * 4] for v in (x, y)]
    for row, v in zip(powers, (x, y), strict=True):
        for k in range(2, 6):
            row[k] = 2 * v * row[k - 1] - row[k - 2]
    for each, pairs in ((False, [(i, j) for i in range(6) for j in range(6 - i)]),
                        (True, [(i, j) for i in range(6) for j in range(6)])):  # fmt: skip
        found = products(np.array(float(x)), np.array(float(y)), 5, each=each)
        assert found.tolist() == [float(powers[0][i] * powers[1][j]) for i, j in pairs]


def test_a_fit_has_the_values_and_the_gradient_of_a_smooth_function():
    """Degree 16 of sin and exp with arguments up to 4: what is left out is below 4^17/17! / 2^16 = 1e-9 / 1.4."""
    fit = Polynomials.fitted(MIDDLE, HALF, 16, places(800, 1), smooth(*places(800, 1)))
    x, y = places(200, 2)
    assert_allclose(fit.at(x, y), smooth(x, y), rtol=0, atol=1e-9)
    assert_allclose(fit.gradient.at(x, y), gradient(x, y), rtol=0, atol=1e-7)  # of degree^2 times as much, over HALF
    assert (np.abs(fit.at(x, y)).max(-1) <= fit.bound).all()


def test_nodes_of_as_many_as_terms_are_met_exactly():
    x, y = (part.ravel() for part in np.meshgrid(*(nodes_between(m - h, m + h, 9)
                                                   for m, h in zip(MIDDLE, HALF, strict=True))))  # fmt: skip
    fit = Polynomials.fitted(MIDDLE, HALF, 8, np.stack([x, y]), smooth(x, y), each=True)
    assert_allclose(fit.at(x, y), smooth(x, y), rtol=0, atol=1e-14)
    u, v = places(50, 3)
    assert_allclose(fit.at(u, v), smooth(u, v), rtol=0, atol=1e-5)  # 2 * 2.5^9/9! / 2^8, twice for two axes


def test_a_gradient_gives_the_function_back_but_for_a_constant():
    x, y = places(500, 4)
    fit = Polynomials.with_gradient(MIDDLE, HALF, 16, np.stack([x, y]), gradient(x, y)[:, 0])
    assert np.ptp(fit.at(x, y) - smooth(x, y)[0]) < 1e-8


@pytest.mark.parametrize("shape", [(), (2,), (2, 3)])
def test_a_grid_is_all_its_places_and_functions_lead(shape):
    terms = np.random.default_rng(5).normal(size=(*shape, 4, 4))
    fit = Polynomials(MIDDLE, HALF, terms)
    x, y = np.linspace(-1, 2, 5), np.linspace(-1.2, -0.8, 7)
    grid = fit.on_grid(x, y)
    assert grid.shape == (*shape, 7, 5)
    assert_allclose(fit.at(x[None], y[:, None]), grid, rtol=0, atol=1e-13)
    unit_x, unit_y = (x[3] - 0.5) / 2.0, (y[2] + 1.0) / 0.25
    want = np.polynomial.chebyshev.chebval2d(unit_x, unit_y, np.moveaxis(terms, (-2, -1), (0, 1)))
    assert_allclose(grid[..., 2, 3], want, rtol=0, atol=1e-13)
