"""Distributions and draws, against quadrature, exact moments and scipy's own distributions."""

from typing import get_args

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate, stats
from scipy.stats import qmc

from roslf_design.tolerancing.draws import (
    Distribution,
    Draws,
    Perturbation,
    deviation,
    sobol_points,
    standard_deviation,
)

DISTRIBUTIONS = get_args(Distribution)
DENSITIES = {
    "uniform": lambda x: 0.5 + 0 * x,
    "parabolic": lambda x: 1.5 * x * x,
    "normal": lambda x: stats.truncnorm.pdf(x, -2.0, 2.0, scale=0.5),
}


@pytest.mark.parametrize("name", DENSITIES)
def test_inverse_cdf_inverts_the_integral_of_the_density(name):
    u = np.linspace(0.002, 0.998, 41)
    x = deviation(name, u)
    found = [integrate.quad(DENSITIES[name], -1, end, epsabs=1e-13)[0] for end in x]
    np.testing.assert_allclose(found, u, atol=1e-10)


@pytest.mark.parametrize("name", DISTRIBUTIONS)
def test_standard_deviation_is_that_of_the_quantile_function(name):
    u = (np.arange(2_000_000) + 0.5) / 2_000_000
    assert standard_deviation(name) == pytest.approx(np.sqrt(np.mean(deviation(name, u) ** 2)), rel=1e-5)


@given(st.floats(1e-4, 30.0))
def test_truncated_normal_variance_against_60_digits(k):
    with mp.workdps(60):
        z = mp.mpf(k)
        variance = 1 - 2 * z * mp.npdf(z) / mp.erf(z / mp.sqrt(2))
        expected = float(mp.sqrt(variance) / z)
    assert standard_deviation("normal", k) == pytest.approx(expected, rel=1e-10)


@given(st.sampled_from(DISTRIBUTIONS), st.floats(0, 1), st.floats(0.1, 9))
def test_deviations_are_odd_bounded_and_finite(name, u, truncation):
    x = float(deviation(name, u, truncation))
    assert -1 <= x <= 1
    if u != 0.5:
        assert float(deviation(name, 1 - u, truncation)) == pytest.approx(-x, abs=1e-9)


def two(rho, opposed=False, distribution="normal", truncation=8.0):
    members = [
        Perturbation("a", 1.0, 0.1, distribution, truncation, "g"),
        Perturbation("b", 2.0, 0.4, distribution, truncation, "g", opposed),
        Perturbation("c", 3.0, 0.2, "uniform"),
    ]
    return Draws(tuple(members), (("g", rho),), "random", 5)


@pytest.mark.parametrize("rho", [0.3, 0.8, 1.0])
@pytest.mark.parametrize("opposed", [False, True])
def test_groups_have_the_wanted_correlation_and_covariance(rho, opposed):
    draws = two(rho, opposed)
    x = draws.deviations(draws.uniforms(0, 200_000))
    sign = -1 if opposed else 1
    # Standard error of a correlation over 200,000 draws: 0.0022.
    assert np.corrcoef(x)[0, 1] == pytest.approx(sign * rho, abs=0.008)
    assert np.corrcoef(x)[0, 2] == pytest.approx(0, abs=0.008)
    values = draws.values(x)
    measured = np.cov([values[name] for name in "abc"])
    np.testing.assert_allclose(measured, draws.covariance(), atol=0.02 * 0.05**2 + 3e-4 * 0.4**2)
    if rho == 1:
        np.testing.assert_allclose(x[0], sign * x[1])


def test_uniform_members_tied_in_part_are_still_uniform():
    draws = two(0.5, distribution="uniform")
    x = draws.deviations(draws.uniforms(0, 100_000))
    assert stats.kstest(x[0], "uniform", (-1, 2)).pvalue > 1e-3
    # Normal scores with correlation rho give uniforms with (6/pi) asin(rho/2).
    assert np.corrcoef(x)[0, 1] == pytest.approx(6 / np.pi * np.arcsin(0.25), abs=0.012)


def test_every_chunk_has_its_own_draws_and_always_the_same():
    draws = two(0.5)
    first, second = draws.uniforms(0, 1000), draws.uniforms(1, 1000)
    assert not np.any(first == second)
    np.testing.assert_array_equal(second, two(0.5).uniforms(1, 1000))


def test_sobol_chunks_are_pieces_of_one_sequence_and_fill_space_evenly():
    whole = sobol_points(5, 0, 4096, 3)
    for start, count in ((1, 7), (1000, 1024), (1024, 1024), (4095, 1)):
        np.testing.assert_array_equal(whole[:, start : start + count], sobol_points(5, start, count, 3))
    assert (whole > 0).all()
    assert (whole < 1).all()
    for row in whole:
        assert np.array_equal(np.bincount((row * 4096).astype(int), minlength=4096), np.ones(4096, int))


@pytest.mark.parametrize("start", [2**24, 10**9 // 2**20 * 2**20, 2**32 - 2**10])
def test_sobol_points_far_on_come_at_once_and_are_those_of_the_sequence(start):
    """In the order of the Gray code, 2^k points from a multiple of 2^k on are the first, their bits turned alike."""

    def digits(points):
        return ((points - 2.0**-33) * 2.0**32).astype(np.int64)

    first, there = digits(sobol_points(19, 0, 2**10, 3)), digits(sobol_points(19, start, 2**10, 3))
    turned = first ^ there
    np.testing.assert_array_equal(turned, np.broadcast_to(turned[:, :1], turned.shape))
    assert (turned[:, 0] > 0).all()


def test_sobol_points_far_on_are_those_of_a_walk():
    engine = qmc.Sobol(3, scramble=True, bits=32, rng=np.random.default_rng(7))
    engine.fast_forward(10**6 + 12345)
    np.testing.assert_array_equal(sobol_points(3, 10**6 + 12345, 64, 7), engine.random(64).T + 2.0**-33)
