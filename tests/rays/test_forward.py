"""Forward rays: the pupil's points, the microlens's and the sensor's lie on one ray of the 60-digit trace."""

from __future__ import annotations

from dataclasses import replace

import mpmath as mp
import numpy as np
import pytest

from roslf_design.rays import Array, Lens, Sensor, Status, Stop, System, trace, trace_pupil
from roslf_design.rays.forward import cells
from tests.oracles.rays import backward, forward
from tests.rays.systems import PAPER, random_points, random_system

EPS = np.finfo(float).eps


def test_the_oracle_goes_back_the_way_it_came():
    rng = np.random.default_rng(1)
    for _ in range(5):
        system = random_system(rng)
        p, c, v = (x[:, 0] for x in random_points(system, rng, 1))
        ray = backward(system, p, c, v)
        where, landing = forward(system, ray.point, ray.direction, c)
        with mp.workdps(60):
            exact = [mp.mpf(float(x)) for x in (*p, *(a for a in c))]
            offsets = [mp.mpf(float(a)) + mp.mpf(float(b)) for a, b in zip(c, v, strict=True)]
            assert max(abs(a - b) for a, b in zip(landing, exact, strict=False)) < mp.mpf(10) ** -55
            assert max(abs(a - b) for a, b in zip(where, offsets, strict=True)) < mp.mpf(10) ** -50


@pytest.mark.parametrize("tilted", [False, True])
def test_landing_points_lie_on_rays_through_the_pupil_point_and_the_microlens(tilted):
    rng = np.random.default_rng(2)
    checked = 0
    for _ in range(25):
        system = random_system(rng, tilted=tilted)
        _, c, v = random_points(system, rng, 6)
        pupil = rng.uniform(-1, 1, (2, 6))
        rays = trace_pupil(system, pupil, c, v)
        radius = float(system.stops[0].diameter) / 2
        for i in np.flatnonzero(rays.status != Status.UNTRACEABLE):
            # The landing point is rounded to a double; the way back multiplies that by d_1/d_2 and what follows.
            landing = np.array([x[i] for x in rays.sensor])
            exact = backward(system, landing, c[:, i], v[:, i])
            steep = 1 + max(abs(x[i]) for x in rays.slope) ** 2
            size = np.abs(landing).max() + np.abs(c).max() + np.abs(v).max() + radius
            height = size * system.array.distance / system.sensor.distance * steep
            slope = height / system.lens.focal_length + height / system.array.distance
            for got, want in zip(exact.crossings[0], pupil[:, i] * radius, strict=True):
                assert abs(got - want) < 16 * EPS * (height + slope * system.stops[0].distance)
            for z in (0.0, 77.0):
                for got, want in zip(rays.at(z), exact.at(mp.mpf(z)), strict=True):
                    assert abs(got[i] - want) < 16 * EPS * (height + slope * z)
            checked += 1
    assert checked > 140


def test_fates_agree_with_the_backward_engine():
    rng = np.random.default_rng(3)
    compared = set()
    for _ in range(40):
        system = random_system(rng, stops=3)
        _, c, v = random_points(system, rng, 60)
        ahead = trace_pupil(system, rng.uniform(-1.1, 1.1, (2, 60)), c, v)
        back = trace(system, ahead.sensor, c, v)
        landed = np.where(np.isin(ahead.status, [Status.NEIGHBOUR, Status.OFF_SENSOR]), Status.KEPT, ahead.status)
        lit = ahead.status != Status.UNTRACEABLE
        # Random rays, none within rounding of a rim.
        np.testing.assert_array_equal(landed[lit], back.status[lit])
        compared |= set(back.status[lit].tolist())
    assert compared == {Status.KEPT, Status.MICROLENS, Status.MAIN_LENS, *(Status.APERTURE + k for k in range(3))}


def test_a_pupil_point_beyond_the_rim_is_clipped_by_the_pupil_and_one_on_it_is_not():
    assert trace_pupil(PAPER, (1.0, 0.0), (3.0, 0.0)).status in (Status.KEPT, Status.NEIGHBOUR)
    assert trace_pupil(PAPER, (np.nextafter(1.0, 2.0) + EPS, 0.0), (3.0, 0.0)).status == Status.APERTURE


def test_fates_after_the_last_opening():
    # P1's image of 1.005 pitches reaches into the neighbours' cells.
    assert trace_pupil(PAPER, (0.0, 0.0), (11.0, 0.0)).status == Status.KEPT
    assert trace_pupil(PAPER, (0.9999, 0.0), (11.0, 0.0)).status == Status.NEIGHBOUR
    assert trace_pupil(PAPER, (0.0, 0.9999), (11.0, 0.0)).status == Status.NEIGHBOUR
    assert trace_pupil(PAPER, (0.7, 0.7), (11.0, 0.0)).status == Status.KEPT
    assert trace_pupil(PAPER, (0.0, 0.0), (11.3, 0.0)).status == Status.OFF_SENSOR
    assert trace_pupil(PAPER, (0.0, 0.0), (0.0, -7.6)).status == Status.OFF_SENSOR


@pytest.mark.parametrize("distance", [0.0, 100.0, 120.0, 349.0, 349.999999])
def test_microlens_image_pitch_follows_from_chief_rays(distance):
    system = replace(PAPER, stops=(Stop(2.9, distance),))
    with mp.workdps(60):
        f, d_1, d_2, z = (mp.mpf(x) for x in (100.0, 140.0, 2.0, distance))
        pitch = mp.mpf(0.063) * (1 + d_2 * (z - f) / (d_1 * (z - f) - f * z))
        condition = 1 + d_1 * z / abs(d_1 * (z - f) - f * z)
        landing = 2 * (1 + abs(pitch) / mp.mpf(0.063))
    cell = cells(system, (2.0, -1.0))
    # The pitch is a difference of landing points, which carry their own roundings times the condition of 1/L.
    assert abs(1 / cell[2] - pitch) < 8 * EPS * landing * condition
    assert abs(cell[3]) < 8 * EPS * landing * condition / pitch**2


def test_telecentric_images_repeat_with_the_pitch_of_the_array():
    system = replace(PAPER, stops=(Stop(2.9, 100.0),))
    c = np.linspace(-11, 11, 41)
    np.testing.assert_allclose(trace_pupil(system, (0.0, 0.0), (c, 0.0)).sensor[0], c, rtol=2 * EPS, atol=1e-16)


def test_a_pupil_whose_image_lies_on_the_array_sends_no_traceable_rays():
    # Binary fractions: f = 64, d_1 = d_f = d_3 = 128.
    system = System(Lens(64.0, 50.0), (Stop(2.0, 128.0),), Array(128.0, 2.0, 0.0625), Sensor(2.0))
    rays = trace_pupil(system, (np.linspace(-1, 1, 5), 0.0), (1.0, 0.0))
    np.testing.assert_array_equal(rays.status, Status.UNTRACEABLE)
    np.testing.assert_array_equal(rays.sensor, 0.0)
    # Backward there is nothing special: the object point in focus is the one the microlens sees.
    assert trace(system, (1.0, 0.0), (1.0, 0.0)).at(128.0)[0] == -1.0
