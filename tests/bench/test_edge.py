"""Slanted edges drawn by closed forms: what they are blurred by is known, and so is their contrast."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import erf

from roslf_design.bench.edge import KNOT, EdgeResponse, edges_in_view, edges_refocused, limit_of
from roslf_design.calibration.decoding import LightField, cubic_taps
from roslf_design.calibration.frames import CalibrationError


def edge_field(rng, *, sigma=0.5, angle=0.1, slope=0.0, noise=0.0, views=5, size=(48, 56), uneven=0.0, falls=False):
    """Views of an edge between 0.1 and 0.9, blurred by a Gaussian [pitches]."""
    s = np.arange(views) - (views - 1) / 2
    u, v = (np.arange(n) - (n - 1) / 2 for n in size[::-1])
    t_, s_, v_, u_ = np.meshgrid(s, s, v, u, indexing="ij")
    away = math.cos(angle) * (u_ - slope * s_ - 0.37) + math.sin(angle) * (v_ - slope * t_)
    values = 0.5 + 0.4 * (-1 if falls else 1) * erf(away / (math.sqrt(2) * sigma))
    values *= 1 + uneven * rng.standard_normal(values.shape)
    values += noise * rng.standard_normal(values.shape)
    weight = np.ones(values.shape, np.float32)
    return LightField(values.astype(np.float32), weight, s, s.copy(), u, v, 10.0)


def gaussian(level, sigma):
    return math.sqrt(-2 * math.log(level)) / (2 * math.pi * sigma)


@pytest.mark.parametrize(
    ("sigma", "angle"), [(0.35, 0.1), (0.35, -0.09), (0.35, 1.45), (0.35, 1.67), (0.5, 0.1), (1.2, 1.45)]
)
def test_gaussian_edge_has_its_contrast(sigma, angle):
    (response,) = edges_in_view(edge_field(np.random.default_rng(0), sigma=sigma, angle=angle))
    for level in (0.5, 0.1):
        assert limit_of([response], level)[0] == pytest.approx(gaussian(level, sigma), rel=3e-3)
    assert math.tan(response.angle) == pytest.approx(math.tan(angle), rel=1e-3)


def test_views_refocused_to_the_edge_are_as_sharp_as_one():
    field = edge_field(np.random.default_rng(1), slope=0.31, falls=True)
    (response,) = edges_refocused(field, 0.25)
    assert response.slope == pytest.approx(0.31, abs=1e-5)
    assert limit_of([response], 0.5)[0] == pytest.approx(gaussian(0.5, 0.5), rel=3e-3)


@pytest.mark.parametrize("look", [edges_in_view, lambda field: edges_refocused(field, 0.2)])
def test_errors_hold_the_truth(look):
    truth, off = gaussian(0.5, 0.6), []
    for seed in range(30):
        field = edge_field(np.random.default_rng(seed), sigma=0.6, slope=0.2, noise=0.02, uneven=0.01, views=3)
        value, sigma = limit_of(look(field), 0.5)
        off.append((value - truth) / sigma)
    assert np.sum(np.abs(off) < 2) >= 26  # 28.6 of 30 expected; 26 or more in 96 of 100
    assert 0.65 < np.std(off) < 1.4
    assert abs(np.mean(off)) < 0.5


def square_field(rng, side=24.0, noise=0.01, sigma=0.6, size=(56, 74)):
    """View of a dark square turned by 5 degrees."""
    field = edge_field(rng, views=1, size=size)
    u, v = np.meshgrid(field.u, field.v)
    cos, sin = math.cos(math.radians(5)), math.sin(math.radians(5))
    rise = [
        0.5 * (1 + erf((side / 2 - np.abs(a)) / (math.sqrt(2) * sigma))) for a in (cos * u + sin * v, cos * v - sin * u)
    ]
    values = 0.9 - 0.8 * rise[0] * rise[1] + noise * rng.standard_normal(u.shape)
    return replace(field, values=values[None, None].astype(np.float32))


def test_square_has_four_edges_and_their_mean_is_its_contrast():
    off = []
    for seed in range(10):
        responses = edges_in_view(square_field(np.random.default_rng(seed)))
        assert len(responses) == 4
        value, sigma = limit_of(responses, 0.5)
        off.append((value - gaussian(0.5, 0.6)) / sigma)
    assert np.abs(off).max() < 3.5
    assert np.sqrt(np.mean(np.square(off))) < 1.5


def test_a_border_along_the_rows_is_no_slanted_edge():
    """A sheet's own border, longer and as strong as the square's lowest edge, which it takes the place of."""
    field = square_field(np.random.default_rng(0))
    values = field.values.copy()
    values[..., field.v < -22, :] -= 0.45
    responses = edges_in_view(replace(field, values=values))
    assert len(responses) == 3
    for level in (0.5, 0.1):
        assert limit_of(responses, level)[0] == pytest.approx(gaussian(level, 0.6), rel=0.06)


def test_picture_without_an_edge_is_refused():
    field = edge_field(np.random.default_rng(0), views=1)
    flat = replace(
        field, values=(0.5 + np.random.default_rng(2).normal(0, 0.01, field.values.shape)).astype(np.float32)
    )
    with pytest.raises(CalibrationError, match="no edge"):
        edges_in_view(flat)


def test_noise_does_not_lengthen_what_is_left_of_the_contrast():
    rng, sigma, noise, nu = np.random.default_rng(3), 0.6, 0.02, np.array([gaussian(0.2, 0.6)])
    places = KNOT * (np.arange(80) - 39.5)
    steps = np.exp(-((places / sigma) ** 2) / 2)
    steps /= steps.sum()
    covariance = noise**2 * np.eye(80)
    drawn = steps + noise * (rng.standard_normal((400, 80)))
    off = [float(EdgeResponse(places, one, covariance, 0.0, 0.0).transfer(nu)[0][0]) for one in drawn]
    still = float(EdgeResponse(places, steps, 0 * covariance, 0.0, 0.0).transfer(nu)[0][0])
    assert np.std(off) > 0.04  # by which the modulus of a noisy wave would be too long by a twentieth
    assert np.mean(off) == pytest.approx(still, abs=3 * np.std(off) / 20)


def test_light_of_neighbours_in_outer_views_is_no_blur():
    field = edge_field(np.random.default_rng(4), slope=0.1, views=9)
    values = field.values.copy()
    for k, away in ((0, -1), (-1, 1)):
        values[:, k] += 0.3 * (np.roll(field.values[:, k], -away, axis=-1) - values[:, k])
        values[k] += 0.3 * (np.roll(field.values[k], -away, axis=-2) - values[k])
    (response,) = edges_refocused(replace(field, values=values), 0.1)
    assert limit_of([response], 0.5)[0] == pytest.approx(gaussian(0.5, 0.5), rel=3e-3)
    (response,) = edges_refocused(replace(field, values=values, pitch=14.0), 0.1)
    assert limit_of([response], 0.5)[0] < 0.97 * gaussian(0.5, 0.5)


@pytest.mark.parametrize("refocus", [False, True])
def test_what_reading_between_pixels_blurs_out_of_focus_is_allowed_for(refocus):
    rng, slope, sigma, angle = np.random.default_rng(5), 0.4, 0.35, 0.1
    field = edge_field(rng, slope=slope, sigma=sigma, views=5)
    between = np.broadcast_to(rng.uniform(size=field.values.shape[3]), (2, *field.values.shape[2:]))
    t, s, v, u = np.meshgrid(field.t, field.s, field.v, field.u, indexing="ij")
    values = np.zeros(t.shape)
    for a, right in enumerate(cubic_taps(between[0])):
        for b, down in enumerate(cubic_taps(between[1])):
            away = math.cos(angle) * (u - slope * (s - between[0] + a - 1) - 0.37)
            away += math.sin(angle) * (v - slope * (t - between[1] + b - 1))
            values += right * down * (0.5 + 0.4 * erf(away / (math.sqrt(2) * sigma)))
    read = replace(field, values=values.astype(np.float32), between=between)
    alone, allowed = (
        limit_of(edges_refocused(view, slope) if refocus else edges_in_view(view, slope), 0.5)[0]
        for view in (replace(read, between=None), read)
    )
    assert alone < 0.985 * gaussian(0.5, sigma)
    assert allowed == pytest.approx(gaussian(0.5, sigma), rel=5e-3)
