"""Rays against planes followed at 60 digits; their fates; closed forms and rays tell the same."""

from __future__ import annotations

from typing import Any

import mpmath as mp
import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.design import Design
from roslf_design.fates import FATES, RayFate, state_at
from roslf_design.rays import PASSED, fans, trace_pupil
from roslf_design.rays.backward import aligned_ray, crossing, lay_out, posed_ray
from roslf_design.theory.exit_pupil import microlens_image_diameter, microlens_image_pitch
from roslf_design.theory.object_space import FAP, MAIN_LENS
from roslf_design.theory.stop_images import stop_discs
from roslf_design.theory.vignetting import room_at
from tests.oracles.object_space import object_side
from tests.oracles.rays import backward, forward, planes
from tests.pictures.designs import THROUGH

EPS = np.finfo(float).eps
PAPER = roslf.load("paper")


def random_design(rng: np.random.Generator, *, stops: int = 2, tilted: bool = True) -> Design:
    """A camera of any size with every element somewhat out of place."""
    f, m = 10 ** rng.uniform(0, 2.3), 10 ** rng.uniform(-1.3, 0.3)
    d_1, d_f = f * (1 + m), f * (1 + m) / m
    d = 10 ** rng.uniform(-2, -1)
    d_2 = d * rng.uniform(3, 40)
    width = d * d_1 / d_2  # as large as suits the microlenses, so that rays come near every rim

    def pose(size: float, tilt: float = 0.1) -> dict[str, Any]:
        turned = tuple(rng.uniform(-tilt, tilt, 2)) if tilted else (0.0, 0.0)
        return {"decentre": tuple(rng.normal(0, 0.1 * size, 2)), "tilt": turned}

    rims = [
        {"diameter": width * rng.uniform(0.4, 1.5), "distance": d_f * rng.uniform(0, 0.8), **pose(width, 0.3)}
        for _ in range(stops)
    ]
    return Design.make(
        {
            "name": "random",
            "main_lens": {"diameter": width * rng.uniform(1, 3), "focal_length": f, **pose(width)},
            "aperture": rims[0],
            "stops": rims[1:],
            "microlens_array": {
                "pitch": d,
                "focal_length": d_2 * rng.uniform(0.8, 1.2),
                "distance": d_1,
                "size": (40 * d, 40 * d),
                "lens_shape": ("square", "circular")[rng.integers(2)],
                "rotation": rng.uniform(-0.1, 0.1) if tilted else 0.0,
                **pose(d),
            },
            "sensor": {"distance": d_2, "pixel": d / 10, "size": (1e3 * d, 1e3 * d), **pose(d)},
        }
    )


def test_the_oracle_goes_back_the_way_it_came():
    rng = np.random.default_rng(1)
    for _ in range(5):
        design = random_design(rng)
        c = rng.uniform(-10, 10, 2) * design.d
        p, v = c + rng.uniform(-0.7, 0.7, 2) * design.d, rng.uniform(-0.5, 0.5, 2) * design.d
        ray = backward(design, p, c, v)
        where, landing = forward(design, ray.point, ray.direction, c)
        with mp.workdps(60):
            offsets = [mp.mpf(float(a)) + mp.mpf(float(b)) for a, b in zip(c, v, strict=True)]
            assert max(abs(a - mp.mpf(float(b))) for a, b in zip(landing, p, strict=True)) < mp.mpf(10) ** -50
            assert max(abs(a - b) for a, b in zip(where, offsets, strict=True)) < mp.mpf(10) ** -50


@pytest.mark.parametrize("tilted", [False, True])
def test_backward_rays_are_those_of_the_oracle(tilted):
    rng = np.random.default_rng(7)
    for _ in range(25):
        design = random_design(rng, stops=3, tilted=tilted)
        k, maps, rims, *_ = lay_out(Camera.of(design))
        c = rng.uniform(-10, 10, 2) * design.d
        p, v = c + rng.uniform(-0.7, 0.7, 2) * design.d, rng.uniform(-0.5, 0.5, 2) * design.d
        exact = backward(design, p, c, v)
        size = np.abs([*p, *c, *v]).max() + np.abs(k[4:10]).max() + design.D / 2
        height = size * design.d_1 / design.d_2
        lx, ly, ox, oy, good = posed_ray(k, maps, *p, *c, *v)
        assert good
        if not tilted:
            flat = [aligned_ray(*k[:4], k[4 + i], k[6 + i], p[i], c[i], v[i]) for i in (0, 1)]
            # The same ray by the short way; roundings of d_1/d_2 times the places.
            np.testing.assert_allclose([*flat[0], *flat[1]], [lx, ox, ly, oy], rtol=0, atol=32 * EPS * height)
        hx, hy, sx, sy, front = crossing(maps[2], lx, ly, ox, oy)
        assert front
        steep = (1 + max(abs(sx), abs(sy))) ** 2
        for z in (0.0, 77.0):
            for got, want in zip((hx - sx * z, hy - sy * z), exact.at(mp.mpf(z)), strict=True):
                assert abs(got - want) < 64 * EPS * steep * height * (1 + z / design.f)
        for stop, (rim, want) in enumerate(zip(rims, exact.crossings, strict=True)):
            got = crossing(maps[3 + stop], lx, ly, ox, oy)[:2]
            assert rim[3] == pytest.approx((design.all_stops[stop].diameter / 2) ** 2, rel=1e-15)
            for a, b in zip(got, want, strict=True):
                assert abs(a - b) < 64 * EPS * steep * height * (1 + rim[2] / design.f)


@pytest.mark.parametrize("tilted", [False, True])
def test_rays_of_the_pupil_run_through_the_pupil_point_the_microlens_and_the_sensor(tilted):
    rng = np.random.default_rng(2)
    fates = set()
    for _ in range(25):
        design = random_design(rng, tilted=tilted, stops=3)
        camera = Camera.of(design)
        c, pupil = rng.uniform(-10, 10, (2, 6)) * design.d, rng.uniform(-1.1, 1.1, (2, 6))
        rays = trace_pupil(camera, (pupil[0], pupil[1]), (c[0], c[1]))
        for i in np.flatnonzero(rays.status != RayFate.MISSED):
            landing = np.array([x[i] for x in rays.sensor])
            exact = backward(design, landing, c[:, i])
            steep = (1 + max(abs(x[i]) for x in rays.slope)) ** 2
            # The landing point is rounded to a double; the way back multiplies that by d_1/d_2 and what follows.
            size = np.abs(landing).max() + np.abs(c).max() + design.D_F / 2 + np.hypot(*design.main_lens.decentre)
            height = size * design.d_1 / design.d_2 * steep
            reach = 64 * EPS * height * (1 + design.d_3 / design.f)
            for got, want in zip(exact.crossings[0], pupil[:, i] * design.D_F / 2, strict=True):
                assert abs(got - want) < reach
            for z in (0.0, 77.0):
                for got, want in zip(rays.at(z), exact.at(mp.mpf(z)), strict=True):
                    assert abs(got[i] - want) < 64 * EPS * height * (1 + z / design.f)
            passed = rays.status[i] in PASSED
            assert (RayFate.KEPT if passed else rays.status[i]) == exact.status
            fates.add(int(exact.status))
    assert fates == {RayFate.KEPT, state_at(MAIN_LENS), *(state_at(FAP + k) for k in range(3))}


def test_fates_after_the_last_opening():
    # P1's image of 1.005 pitches reaches into the neighbours' cells.
    expected = {
        ((0.0, 0.0), (11.0, 0.0)): RayFate.KEPT,
        ((0.9999, 0.0), (11.0, 0.0)): RayFate.NEIGHBOUR,
        ((0.0, 0.9999), (11.0, 0.0)): RayFate.NEIGHBOUR,
        ((0.7, 0.7), (11.0, 0.0)): RayFate.KEPT,
        ((0.0, 0.0), (11.3, 0.0)): RayFate.OFF_SENSOR,
        ((0.0, 0.0), (0.0, -7.6)): RayFate.OFF_SENSOR,
        ((1.0 + 2 * EPS, 0.0), (3.0, 0.0)): state_at(FAP),
    }
    camera = Camera.of(PAPER)
    for (pupil, microlens), status in expected.items():
        assert trace_pupil(camera, pupil, microlens).status == status


def test_a_pupil_whose_image_lies_on_the_array_sends_no_traceable_rays():
    # Binary fractions: f = 64, d_1 = d_f = d_3 = 128.
    camera = Camera.of(PAPER, {"f": 64.0, "d_1": 128.0, "d_3": 128.0})
    rays = trace_pupil(camera, (np.linspace(-1, 1, 5), 0.0), (1.0, 0.0))
    np.testing.assert_array_equal(rays.status, RayFate.MISSED)
    np.testing.assert_array_equal(rays.sensor, 0.0)


def test_closed_forms_and_rays_agree_on_200_random_cameras():
    rng = np.random.default_rng(2024)
    angle = np.linspace(0, 2 * np.pi, 13)
    rim, along = np.stack([np.cos(angle), np.sin(angle)]), np.array([np.cos(0.7), np.sin(0.7)])
    rooms = []
    for _ in range(200):
        f, m = 10 ** rng.uniform(0, 2.5), 10 ** rng.uniform(-1.5, 0.5)
        d_f, d = f * (1 + m) / m, 10 ** rng.uniform(-2, -0.5)
        D = f / 10 ** rng.uniform(0, 1)
        numbers = {"f": f, "d_f": d_f, "d_3": d_f * rng.uniform(0, 0.95), "D": D, "d": d}
        numbers |= {"D_F": f / 10 ** rng.uniform(0.3, 2), "d_2": d * 10 ** rng.uniform(0.3, 2)}
        sizes = {"sensor.size.0": 1e9, "sensor.size.1": 1e9}
        camera, c = Camera.of(PAPER, {**numbers, **sizes}), D * rng.uniform(-0.5, 0.5)
        # d_3 <= 0.95 d_f, H <= 20: some hundreds of roundings of the largest term at most.
        (fap, _), radii = (values for values in stop_discs(camera, c * along[0], c * along[1]))
        size = abs(c) + radii[0] + np.abs(fap).max()
        landing = np.stack(trace_pupil(camera, (rim[0], rim[1]), c * along).sensor)
        wanted = (c * along + fap)[:, None] - radii[0] * rim
        np.testing.assert_allclose(landing, wanted, rtol=0, atol=1e-12 * size)
        assert abs(2 * radii[0] - microlens_image_diameter(camera)) < 1e-12 * size
        ends = [trace_pupil(camera, (0.0, 0.0), (x, 0.0)).sensor[0] for x in (c, c + d)]
        assert abs(ends[1] - ends[0] - microlens_image_pitch(camera)) < 1e-12 * size
        # Room left in the main lens (Eq. 6): its radius less the highest ray of the pencil.
        outermost = trace_pupil(camera, np.stack([along, -along], -1), c * along)
        highest = np.hypot(*outermost.height).max()
        (room,) = room_at(camera, abs(c) * camera.inverse_m)
        gap = 2 * (d_f - numbers["d_3"]) * (D / 2 - highest - room)
        assert abs(gap) < 1e-12 * d_f * (D + numbers["D_F"] + abs(c) * camera.inverse_m)
        if abs(room) > 1e-9 * D / (1 - numbers["d_3"] / d_f):
            assert np.all(np.isin(outermost.status, PASSED)) == (room >= 0)
        rooms.append(room)
    assert 20 < np.sum(np.array(rooms) > 0) < 180


def test_telecentric_images_repeat_with_the_pitch_of_the_array():
    chief = trace_pupil(Camera.of(PAPER, {"d_3": 100.0}), (0.0, 0.0), (0.063 * np.arange(-170, 171), 0.0)).sensor[0]
    np.testing.assert_allclose(np.diff(chief), 0.063, rtol=0, atol=4 * EPS * 11)


def test_a_fan_runs_from_the_focal_plane_to_the_image():
    fan = fans(Camera.of(PAPER), [0.0, 11.15], rays=5)
    np.testing.assert_allclose(fan.z, np.broadcast_to([-350.0, 0.0, 140.0, 142.0], (2, 5, 4)), rtol=1e-14)
    np.testing.assert_allclose(fan.x[1, :, 0], -11.15 * 350 / 140, rtol=1e-12)
    np.testing.assert_array_equal(fan.x[1, :, 2], 11.15)
    np.testing.assert_array_equal(fan.y, 0.0)
    on_pupil = fan.x[..., 0] + (fan.x[..., 1] - fan.x[..., 0]) * (350 - 120) / 350
    np.testing.assert_allclose(on_pupil, np.broadcast_to(1.45 * np.linspace(-1, 1, 5), (2, 5)), atol=1e-12)


def test_a_stopped_ray_ends_where_it_is_stopped():
    fan = fans(Camera.of(PAPER), 3.0, rays=7, fill=1.5)
    clipped = fan.status == state_at(FAP)
    np.testing.assert_array_equal(clipped, [True, False, False, False, False, False, True])
    np.testing.assert_allclose(fan.z[clipped][:, 1:], -120.0)
    np.testing.assert_allclose(np.abs(fan.x[clipped][:, 1:]), 1.45 * 1.5)
    fan = fans(Camera.of(PAPER, {"D": 12.0}), 4.0, rays=9)
    clipped = fan.status == state_at(MAIN_LENS)
    assert 0 < clipped.sum() < 9
    np.testing.assert_array_equal(fan.z[clipped][:, 1:], 0.0)
    assert np.all(np.abs(fan.x[clipped][:, 1:]) > 6.0)


def test_corners_of_fans_lie_on_tilted_elements():
    rng = np.random.default_rng(12)
    ended = set()
    for _ in range(30):
        design = random_design(rng, stops=3)
        sensor, array, lens, stops = planes(design)
        fan = fans(Camera.of(design), rng.uniform(-10, 10) * design.d, rays=5)
        points = np.stack([fan.x, fan.y, fan.z], -1)
        for ray, status in zip(points, fan.status, strict=True):
            if status == RayFate.MISSED:
                continue
            ended.add(int(status))
            corners = list(zip((lens, array, sensor), ray[1:], strict=True))
            if status not in PASSED:
                np.testing.assert_array_equal(ray[1], ray[3])
                corners = [(lens if status == state_at(MAIN_LENS) else stops[status // FATES - FAP], ray[1])]
            for plane, at in corners:
                offset = [mp.mpf(float(x)) - v for x, v in zip(at, plane.vertex, strict=True)]
                off = mp.fsum(n * x for n, x in zip(plane.normal, offset, strict=True))
                assert abs(off) < 1e-11 * (1 + np.abs(at).max())  # rounding of coordinates far from the vertex
    assert ended >= {state_at(MAIN_LENS), state_at(FAP + 1), state_at(FAP + 2)}


def test_a_camera_focused_at_infinity_is_drawn_from_beyond_its_stops():
    camera = Camera.of(PAPER, {"f": 100.0, "d_1": 100.0})
    np.testing.assert_array_equal(fans(camera, 0.0).z[:, 0], -180.0)
    np.testing.assert_array_equal(fans(camera.replace({"d_3": 0.0}), 0.0).z[:, 0], -100.0)


@pytest.mark.parametrize("name", ["window in water", "relay", "objective"])
def test_corners_of_a_fan_are_where_a_ray_bends_with_a_ruler(name):
    """Every vertex before the main lens against the same ray through every face in mpmath."""
    design = THROUGH[name]
    kinds = {"plate": lambda e: (e.thickness, e.material.index(design.wavelength)), "lens": lambda e: (e.focal_length,)}
    elements = [(e.kind, e.distance, *kinds[e.kind](e)) for e in design.elements]
    fan = fans(Camera.of(design), [0.0, 1.0], rays=5, fill=0.9)
    assert -fan.z[..., 0] == pytest.approx(np.full((2, 5), design.d_f))
    faces = sorted({z for e in design.elements for z in (e.distance, e.distance + e.length)}, reverse=True)
    kept = np.isin(fan.status, PASSED)
    assert kept[0].all()
    for z, x in zip(fan.z[kept], fan.x[kept], strict=True):
        np.testing.assert_allclose(-z[1:-3], faces)
        slope = (x[-3] - x[-4]) / (z[-3] - z[-4])  # in the air before the main lens
        with mp.workdps(30):
            wanted = object_side(x[-3], slope, elements, design.object_space.medium.index(design.wavelength), -z[:-3])
        np.testing.assert_allclose(x[:-3], np.array(wanted, float), rtol=0, atol=1e-9)


def test_a_ray_swings_through_a_gradient_rod():
    """``x'' = -g^2 x`` inside, index times slope the same on both sides of its ends."""
    design = THROUGH["needle"]
    rod = design.elements[0]
    fan = fans(Camera.of(design), 0.5, rays=3)
    z, x = fan.z[1], fan.x[1]
    inside = (-z >= rod.distance) & (-z <= rod.distance + rod.length + 1e-9)
    h = np.diff(z[inside])
    np.testing.assert_allclose(h, h[0], rtol=1e-9)
    y = x[inside]
    np.testing.assert_allclose(y[2:] + y[:-2], 2 * np.cos(rod.gradient * h[0]) * y[1:-1], atol=1e-12)
    last = np.flatnonzero(inside)[-1]
    leaves = (x[last + 1] - x[last]) / (z[last + 1] - z[last])
    g = rod.gradient
    entering = g * (y[-1] * np.cos(g * h[0]) - y[-2]) / np.sin(g * h[0])  # x' at the end of the last stretch
    assert rod.index * entering == pytest.approx(leaves, rel=1e-9)


def test_glass_about_the_array_bends_rays_by_its_index():
    design = THROUGH["prism and cover"]
    fan = fans(Camera.of(design), 0.0, rays=3)
    z, x = fan.z[0, -5:] - design.d_1, fan.x[0, -5:]
    np.testing.assert_allclose(z[1:], [0.0, 1.2, 1.6, 2.0], atol=1e-9)
    substrate, air, cover = np.diff(x[1:]) / np.diff(z[1:])
    assert 1.46 * substrate == pytest.approx(air)
    assert float(design.sensor.cover.material.index(design.wavelength)) * cover == pytest.approx(air)
