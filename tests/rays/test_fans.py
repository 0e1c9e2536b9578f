"""Fans for drawing: their corners lie on the elements, and a stopped ray ends where it is stopped."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from roslf_design.rays import Array, Lens, Status, Stop, fans, trace_pupil
from roslf_design.rays.frames import poses
from tests.rays.systems import PAPER, random_points, random_system


def test_paper_fan_runs_from_the_focal_plane_to_the_image():
    fan = fans(PAPER, [0.0, 11.15], rays=5)
    assert fan.x.shape == (2, 5, 4)
    np.testing.assert_allclose(fan.z, np.broadcast_to([-350.0, 0.0, 140.0, 142.0], (2, 5, 4)), rtol=1e-14)
    np.testing.assert_allclose(fan.x[1, :, 0], -11.15 * 350 / 140, rtol=1e-12)
    np.testing.assert_array_equal(fan.x[1, :, 2], 11.15)
    np.testing.assert_array_equal(fan.y, 0.0)
    np.testing.assert_array_equal(fan.status[:, 1:4], Status.KEPT)
    on_pupil = fan.x[..., 0] + (fan.x[..., 1] - fan.x[..., 0]) * (350 - 120) / 350
    np.testing.assert_allclose(on_pupil, np.broadcast_to(1.45 * np.linspace(-1, 1, 5), (2, 5)), atol=1e-12)


def test_overfilled_fan_ends_at_the_pupil():
    fan = fans(PAPER, 3.0, rays=7, fill=1.5)
    clipped = fan.status == Status.APERTURE
    np.testing.assert_array_equal(clipped, [True, False, False, False, False, False, True])
    np.testing.assert_allclose(fan.z[clipped][:, 1:], -120.0)
    np.testing.assert_allclose(np.abs(fan.x[clipped][:, 1:]), 1.45 * 1.5)


def test_small_main_lens_ends_rays_at_the_lens():
    fan = fans(replace(PAPER, lens=Lens(100.0, 12.0)), 4.0, rays=9)
    clipped = fan.status == Status.MAIN_LENS
    assert 0 < clipped.sum() < 9
    np.testing.assert_array_equal(fan.z[clipped][:, 1:], 0.0)
    assert np.all(np.abs(fan.x[clipped][:, 1:]) > 6.0)
    assert np.all(np.abs(fan.x[~clipped][:, 1]) <= 6.0)


def test_corners_lie_on_tilted_elements():
    rng = np.random.default_rng(12)
    ended = set()
    for _ in range(30):
        system = random_system(rng, stops=3)
        c = float(random_points(system, rng, 1)[1][0, 0])
        fan = fans(system, c, rays=5, distance=200.0)
        points = np.stack([fan.x, fan.y, fan.z], -1)
        sensor, array, lens, *stops = poses(system)

        def off(pose, at):
            return np.dot(at - np.array(pose.vertex), pose.axes[:, 2]) / (1 + np.abs(at).max())

        for ray, status in zip(points, fan.status, strict=True):
            assert ray[0, 2] == -200.0
            if status == Status.UNTRACEABLE:
                continue
            ended.add(int(status))
            if status in (Status.KEPT, Status.NEIGHBOUR, Status.OFF_SENSOR):
                corners = zip((lens, array, sensor), ray[1:], strict=True)
            else:
                np.testing.assert_array_equal(ray[1], ray[3])
                corners = [(lens if status == Status.MAIN_LENS else stops[status - Status.APERTURE], ray[1])]
            for pose, at in corners:
                assert abs(off(pose, at)) < 1e-11  # rounding of coordinates far from the vertex
    assert ended >= {Status.NEIGHBOUR, Status.MAIN_LENS, Status.APERTURE + 1, Status.APERTURE + 2}


def test_a_camera_focused_at_infinity_is_drawn_from_beyond_its_stops():
    system = replace(PAPER, array=Array(100.0, 2.0, 0.063))
    np.testing.assert_array_equal(fans(system, 0.0).z[:, 0], -180.0)
    at_lens = replace(system, stops=(Stop(2.9, 0.0),))
    np.testing.assert_array_equal(fans(at_lens, 0.0).z[:, 0], -100.0)


def test_trials_come_first():
    system = replace(PAPER, lens=Lens(100.0, np.array([[50.8], [12.0]])))
    fan = fans(system, [0.0, 4.0, 8.0])
    assert fan.x.shape == (2, 3, 9, 4)
    one = fans(system.trial((1, 0)), 4.0)
    np.testing.assert_array_equal(fan.x[1, 1], one.x)
    assert np.array_equal(
        one.status, trace_pupil(system.trial((1, 0)), (np.linspace(-1, 1, 9), 0.0), (4.0, 0.0)).status
    )


def test_infinite_drawing_distance_is_refused():
    with pytest.raises(ValueError, match="finite"):
        fans(PAPER, 0.0, distance=np.inf)
