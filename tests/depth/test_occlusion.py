"""Depth steps in decoded views: both sides known up to the edge, against two surfaces whose disparities are exact."""

from dataclasses import replace

import numpy as np
import pytest

from roslf_design.calibration.decoding import LightField
from roslf_design.depth.estimate import PixelNoise, estimate_disparity
from roslf_design.depth.geometry import GridGeometry

ACROSS, SIDE, NEAR, FAR, EDGE = 7, 56, 0.9, -0.6, 8.0


def texture(x, y, seed):
    """Mean 1, waves of 4 to 16 px in all directions: finer detail would alias."""
    waves = np.random.default_rng(seed)
    total = np.ones_like(x)
    for _ in range(24):
        period, angle, phase = waves.uniform(4, 16), waves.uniform(0, np.pi), waves.uniform(0, 2 * np.pi)
        total += 0.04 * np.cos(2 * np.pi * (x * np.cos(angle) + y * np.sin(angle)) / period + phase)
    return total


def bar(turned=False):
    """Views of an upright bar before a wall, with noise of 0.2 %, and the middle one's disparities.

    What is near moves left from view to view, so that views on the other side see past each edge.
    """
    places = np.arange(ACROSS) - (ACROSS - 1) / 2
    y, x = np.mgrid[:SIDE, :SIDE] - (SIDE - 1) / 2
    values = np.zeros((ACROSS, ACROSS, SIDE, SIDE))
    for row, t in enumerate(places):
        for column, s in enumerate(places):
            near = np.clip(EDGE - np.abs(x + NEAR * s) + 0.5, 0, 1)  # share of the pixel that the bar covers
            wall, front = texture(x + FAR * s, y + FAR * t, 1), texture(x + NEAR * s, y + NEAR * t, 2)
            values[row, column] = near * front + (1 - near) * wall
    values += np.random.default_rng(3).normal(0, 0.002, values.shape)
    if turned:
        values = values[::-1, ::-1]
    samples = np.ascontiguousarray(values, np.float32)
    axis = np.arange(SIDE, dtype=float)
    field = LightField(samples, np.ones_like(samples), places, places, axis, axis, float(ACROSS))
    true = np.where(np.abs(x) < EDGE, NEAR, FAR)
    return field, -true if turned else true


@pytest.mark.parametrize("turned", [False, True])
def test_both_sides_of_an_edge_are_known_with_their_errors_even_where_near_and_far_are_swapped(turned):
    field, true = bar(turned)
    geometry = GridGeometry(ACROSS)
    views = geometry.viewing(field).prepared(field)
    noise = PixelNoise(1e8, 2e5, measured=True)
    plain, edges = (
        estimate_disparity(views.field, views.pupil, noise, search=(-8.0, 8.0), window=7, edges=edges)
        for edges in (False, True)
    )
    # An edge hides the wall over (NEAR - FAR) 3 px; windows reach 3 px on.
    beside = np.abs(np.abs(np.arange(SIDE) - (SIDE - 1) / 2) - EDGE) < 8
    inner = np.ix_(range(8, SIDE - 8), np.flatnonzero(beside))
    assert plain.measured[inner].mean() < 0.6
    assert edges.measured[inner].mean() > 0.85
    known = edges.measured[inner]
    error = np.abs(edges.disparity / ACROSS - true)[inner][known]
    assert (error > 0.07).mean() < 0.03
    told = edges.sigma[inner][known] / ACROSS
    # Few windows are independent here: 60 to 76 % of many light fields lie within, this one may be 10 % off.
    assert 0.5 < (error < told).mean() < 0.86
    same = plain.measured
    np.testing.assert_array_equal(edges.disparity[same], plain.disparity[same])


def test_windows_that_answer_beside_a_step_tell_their_own_error(monkeypatch):
    """The pixel's own window sees both sides, and its views pull it apart: 20 times the error of that beside it."""
    monkeypatch.setattr(f"{__name__}.NEAR", 0.3)
    monkeypatch.setattr(f"{__name__}.FAR", 0.0)
    field, true = bar()
    views = GridGeometry(ACROSS).viewing(field).prepared(field)
    noise = PixelNoise(1e8, 2e5, measured=True)
    found = estimate_disparity(views.field, views.pupil, noise, search=(-8.0, 8.0), window=7)
    beside = np.abs(np.abs(np.arange(SIDE) - (SIDE - 1) / 2) - EDGE) < 4
    inner = np.ix_(range(8, SIDE - 8), np.flatnonzero(beside))
    known = found.measured[inner]
    assert known.sum() > 200
    ratio = np.abs(found.disparity / ACROSS - true)[inner][known] / found.sigma[inner][known] * ACROSS
    assert 0.4 < np.median(ratio) < 1.2  # 0.67 of errors that are right


@pytest.mark.parametrize("across", [(1, 2), (2, 2), (3, 3)])
def test_few_views_are_an_answer_too(across):
    field, true = bar()
    rows, columns = across
    middle = field.values[3 - rows // 2 : 3 - rows // 2 + rows, 3 - columns // 2 : 3 - columns // 2 + columns]
    places = [np.arange(n) - (n - 1) / 2 for n in across]
    few = replace(field, values=middle, weight=np.ones_like(middle), t=places[0], s=places[1], pitch=float(max(across)))
    pupil = np.stack(np.meshgrid(places[1], places[0])) / max(across)
    found = estimate_disparity(
        few, pupil, PixelNoise(1e8, 2e5, measured=True), search=(-4.0, 4.0), window=7, edges=True
    )
    assert found.measured.mean() > 0.6
    error = np.abs(-found.disparity / max(across) - true)[found.measured]
    assert np.median(error) < 0.07


@pytest.mark.parametrize("dark", [0.03, 0.06])
def test_samples_without_light_here_and_there_leave_depth_beside_steps(dark):
    field, _ = bar()
    places = np.stack(np.meshgrid(np.arange(ACROSS) - 3.0, np.arange(ACROSS) - 3.0)) / ACROSS
    lit = (np.random.default_rng(0).random(field.weight.shape) >= dark).astype(np.float32)
    noise = PixelNoise(1e8, 2e5, measured=True)
    whole, holed = (
        estimate_disparity(replace(field, weight=light), places, noise, search=(-8.0, 8.0), window=7, edges=True)
        for light in (field.weight, lit)
    )
    assert holed.measured.mean() > whole.measured.mean() - 0.01
