"""Backward rays against a trace at 60 digits, against one another, and on rims."""

from __future__ import annotations

from dataclasses import replace

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roslf_design.rays import Array, Ends, Lens, Sensor, Status, Stop, System, ends, trace
from roslf_design.rays.backward import compiled_ends
from tests.oracles.rays import backward
from tests.rays.systems import PAPER, random_points, random_system

EPS = np.finfo(float).eps


def error_scale(system, points, distance):
    """What one unit of rounding in the coordinates amounts to at the end of a ray."""
    f, d_1, d_2 = float(system.lens.focal_length), float(system.array.distance), float(system.sensor.distance)
    size = sum(np.abs(x).max() for x in points) + d_2
    slope = size / d_2
    height = slope * d_1
    return (height + (slope + height / f) * distance) if np.isfinite(distance) else slope + height / f


@pytest.mark.parametrize("tilted", [False, True])
def test_end_points_and_fates_are_those_of_a_trace_at_60_digits(tilted):
    rng = np.random.default_rng(5)
    distances = (0.0, 350.0, np.inf)
    seen = set()
    for _ in range(25):
        system = random_system(rng, stops=3, tilted=tilted)
        points = random_points(system, rng, 14)
        got = [ends(system, *points, distance=z) for z in distances]
        farthest = max(stop.distance for stop in system.stops)
        for i in range(14):
            exact = backward(system, *(x[:, i] for x in points))
            for z, end in zip(distances, got, strict=True):
                # 16 roundings of the largest terms; the oracle's own error is nil.
                tolerance = 16 * EPS * error_scale(system, points, z)
                x, y = exact.at(mp.mpf(z))
                assert abs(end.x[i] - x) < tolerance
                assert abs(end.y[i] - y) < tolerance
            if exact.clearance > 16 * EPS * error_scale(system, points, farthest):
                assert got[0].status[i] == exact.status
                seen.add(exact.status)
    assert seen == {Status.KEPT, Status.MICROLENS, Status.MAIN_LENS, *(Status.APERTURE + k for k in range(3))}


def test_general_path_at_no_tilt_is_the_aligned_one():
    rng = np.random.default_rng(6)
    for _ in range(40):
        system = random_system(rng, stops=3, tilted=False)
        # A tilt too small to turn anything sends the rays down the general path.
        posed = replace(system, sensor=replace(system.sensor, tilt=(1e-200, 0.0)))
        assert system.aligned
        assert not posed.aligned
        points = random_points(system, rng, 50)
        one, other = trace(system, *points), trace(posed, *points)
        np.testing.assert_array_equal(one.status, other.status)
        for a, b in zip((*one.height, *one.slope), (*other.height, *other.slope), strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-13, atol=1e-13 * np.abs(b).max())


@pytest.mark.parametrize("tilted", [False, True])
def test_compiled_loop_and_numpy_give_the_same_bits(tilted):
    rng = np.random.default_rng(7)
    system = random_system(rng, stops=3, tilted=tilted)
    p, c, v = (x.reshape(2, 3, 700) for x in random_points(system, rng, 2100))
    layouts = [
        (p, c, v),
        (p, c[..., :1], (0.0, 0.0)),
        (p[:, 0], (0.1, 0.2), v[:, 0]),
        ((p[0], p[1, :1]), c[..., :1], v[:, :1]),
    ]
    for points in layouts:
        for distance in (123.0, np.inf, np.array([[10.0], [np.inf], [30.0]])):
            slow, fast = ends(system, *points, distance=distance), compiled_ends(system, *points, distance=distance)
            for a, b in zip(slow, fast, strict=True):
                np.testing.assert_array_equal(a, b)


def test_compiled_loop_takes_trials_in_front_of_the_rays():
    rng = np.random.default_rng(8)
    lengths = rng.uniform(0, 300, (4, 1, 1))
    stops = (Stop(2.9, lengths, (rng.normal(size=(4, 1, 1)), 0.0)), Stop(4.0, 150.0))
    for tilt in (0.0, rng.normal(0, 0.1, (1, 3, 1))):
        system = System(Lens(100.0, 20.0, tilt=(tilt, 0.0)), stops, PAPER.array, PAPER.sensor)
        points = rng.uniform(-0.1, 0.1, (2, 600)) + 3.0, (3.0, 3.0)
        slow, fast = ends(system, *points, distance=350.0), compiled_ends(system, *points, distance=350.0)
        assert fast.status.shape == np.broadcast_shapes((4, 1, 600), np.shape(tilt))
        for a, b in zip(slow, fast, strict=True):
            np.testing.assert_array_equal(a, b)
        one = ends(system.trial((2, 0, 0)), *points, distance=350.0)
        np.testing.assert_array_equal(one.x, fast.x[2, 0])
        np.testing.assert_array_equal(one.status, fast.status[2, 0])


def test_interpreted_kernel_is_the_compiled_one():
    from roslf_design.rays import backward as module
    from roslf_design.rays import kernels

    class Plain:
        """A kernel whose compiled twin is its source as it stands."""

        def __init__(self, kernel):
            self.compiled = kernel.interpreted

    rng = np.random.default_rng(9)
    for tilted, name in ((False, "aligned_ends"), (True, "posed_ends")):
        system = random_system(rng, tilted=tilted)
        points = random_points(system, rng, 40)
        fast = compiled_ends(system, *points, distance=9.0)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(module.kn, name, Plain(getattr(kernels, name)))
            slow = compiled_ends(system, *points, distance=9.0)
        for a, b in zip(slow, fast, strict=True):
            np.testing.assert_array_equal(a, b)


def test_trials_on_the_last_axis_are_refused_by_the_compiled_loop():
    system = replace(PAPER, lens=Lens(100.0, np.array([1.0, 2.0])))
    with pytest.raises(ValueError, match="rays last"):
        compiled_ends(system, (0.0, 0.0), (0.0, 0.0), distance=1.0)
    assert ends(system, (0.0, 0.0), (0.0, 0.0), distance=1.0).x.shape == (2,)


@pytest.mark.parametrize("way", [ends, compiled_ends])
def test_results_go_where_they_are_wanted(way):
    room = Ends(np.empty((2, 3), np.uint8), np.empty((2, 3)), np.empty((2, 3)))
    points = (np.linspace(0, 0.1, 3), np.array([[0.0], [0.01]])), (0.0, 0.0)
    got = way(PAPER, *points, distance=350.0, out=room)
    assert got is room
    for a, b in zip(room, way(PAPER, *points, distance=350.0), strict=True):
        np.testing.assert_array_equal(a, b)
    for wrong in (room._replace(x=np.empty((3, 2))), room._replace(status=np.empty((2, 3), np.int64))):
        with pytest.raises(ValueError, match=r"out\.(x|status): needs a contiguous array"):
            way(PAPER, *points, distance=350.0, out=wrong)


def test_no_rays():
    assert ends(PAPER, (np.empty(0), 0.0), (0.0, 0.0), distance=1.0).x.shape == (0,)
    with pytest.raises(ValueError, match="no rays"):
        compiled_ends(PAPER, (np.empty(0), 0.0), (0.0, 0.0), distance=1.0)


def exactly_placed_ray(height):
    """A camera in binary fractions whose ray crosses the stop, and the lens, at exactly `height`."""
    system = System(Lens(64.0, 2.0), (Stop(2.0, 0.0),), Array(128.0, 2.0, 2.0, lens_shape="circular"), Sensor(2.0))
    return system, -height / 64.0


@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.0, -1.0), (0.6, 0.8)])
def test_a_ray_on_the_rim_is_kept_and_the_next_number_is_not(direction):
    system, p = exactly_placed_ray(1.0)
    if direction == (0.6, 0.8):  # 3-4-5 in binary fractions
        system = replace(system, lens=Lens(64.0, 10.0), stops=(Stop(10.0, 0.0),))
        p, direction = -1 / 64, (3.0, 4.0)
    on = trace(system, (p * direction[0], p * direction[1]), (0.0, 0.0))
    assert on.status == Status.KEPT
    # Two units beyond the rim: the comparison squares, which may hide one.
    out = 1 + 4 * EPS
    beyond = trace(system, (out * p * direction[0], out * p * direction[1]), (0.0, 0.0))
    assert beyond.status == Status.APERTURE
    no_stop = replace(system, stops=(Stop(100.0, 0.0),))
    assert trace(no_stop, (out * p * direction[0], out * p * direction[1]), (0.0, 0.0)).status == Status.MAIN_LENS


def test_microlens_rims_belong_to_the_microlens():
    wide = replace(PAPER, lens=Lens(100.0, 1e6), stops=(Stop(1e6, 120.0),))
    for shape, corner in (("square", Status.KEPT), ("circular", Status.MICROLENS)):
        system = replace(wide, array=Array(140.0, 2.0, 0.0625, lens_shape=shape))
        half = 0.03125
        assert trace(system, (0.0, 0.0), (0.0, 0.0), (half, 0.0)).status == Status.KEPT
        assert trace(system, (0.0, 0.0), (0.0, 0.0), (half, half)).status == corner
        assert trace(system, (0.0, 0.0), (0.0, 0.0), (0.0, np.nextafter(half, 1))).status == Status.MICROLENS


def test_of_several_takers_the_first_that_light_meets_is_named():
    far, near = Stop(0.1, 200.0), Stop(0.1, 50.0)
    ray = ((1.0, 0.0), (0.0, 0.0))
    for stops, first in (((far, near), 0), ((near, far), 1), ((near, near), 0)):
        system = replace(PAPER, lens=Lens(100.0, 0.1), stops=stops)
        assert trace(system, *ray).status == Status.APERTURE + first
    both = replace(PAPER, lens=Lens(100.0, 0.1), stops=(Stop(1e9, 10.0),))
    assert trace(both, *ray, (1.0, 0.0)).status == Status.MAIN_LENS


def test_light_that_cannot_be_is_untraceable_and_holds_no_numbers():
    overturned = replace(PAPER, array=replace(PAPER.array, tilt=(np.pi, 0.0)))
    steep = replace(PAPER, sensor=replace(PAPER.sensor, tilt=(0.0, np.pi / 2)))
    cases = [
        (overturned, (0.0, 0.0)),
        (steep, (3.0, 0.0)),
        (PAPER, (np.nan, 0.0)),
        (PAPER, (1e308, 1e308)),
        (replace(PAPER, lens=replace(PAPER.lens, tilt=(0.0, 1e-9))), (0.0, np.inf)),
    ]
    for system, p in cases:
        for rays in (trace(system, p, (0.0, 0.0)), compiled_ends(system, p, (0.0, 0.0), distance=1.0)):
            assert rays.status == Status.UNTRACEABLE
        assert trace(system, p, (0.0, 0.0)).height == (0.0, 0.0)
        assert compiled_ends(system, p, (0.0, 0.0), distance=1.0).x == 0.0


@given(st.integers(0, 10**6), st.floats(1e-3, 1e3))
def test_scaling_every_length_scales_the_rays(seed, scale):
    rng = np.random.default_rng(seed)
    # A power of two changes no digit, so not even a fate on a rim.
    scale = 2.0 ** np.round(np.log2(scale))
    system = random_system(rng)
    points = random_points(system, rng, 30)
    larger = scaled(system, scale)
    one, other = trace(system, *points), trace(larger, *(scale * x for x in points))
    np.testing.assert_array_equal(one.status, other.status)
    np.testing.assert_array_equal(np.multiply(one.height, scale), other.height)
    np.testing.assert_array_equal(one.slope, other.slope)


def scaled(system, scale):
    def moved(part, **lengths):
        decentre = (part.decentre[0] * scale, part.decentre[1] * scale)
        return replace(part, decentre=decentre, **{name: getattr(part, name) * scale for name in lengths})

    return System(
        moved(system.lens, focal_length=1, diameter=1),
        tuple(moved(stop, diameter=1, distance=1) for stop in system.stops),
        moved(system.array, distance=1, focal_length=1, pitch=1),
        moved(system.sensor, distance=1),
    )


@given(st.integers(0, 10**6))
def test_a_mirrored_camera_mirrors_its_rays(seed):
    rng = np.random.default_rng(seed)
    system = random_system(rng)
    p, c, v = random_points(system, rng, 30)
    flip = np.array([[1.0], [-1.0]])
    one, other = trace(system, p, c, v), trace(mirrored(system), p * flip, c * flip, v * flip)
    np.testing.assert_array_equal(one.status, other.status)
    np.testing.assert_allclose(np.multiply(one.height, flip), other.height, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(np.multiply(one.slope, flip), other.slope, rtol=1e-12, atol=1e-13)


def mirrored(system):
    """In the plane y = 0: y decentres, tilts about x and rotations change sign."""

    def flip(part):
        return replace(part, decentre=(part.decentre[0], -part.decentre[1]), tilt=(-part.tilt[0], part.tilt[1]))

    array = replace(flip(system.array), rotation=-system.array.rotation)
    return System(flip(system.lens), tuple(map(flip, system.stops)), array, flip(system.sensor))


@given(st.integers(0, 10**6), st.floats(1.0, 3.0), st.integers(0, 2))
def test_a_wider_stop_keeps_every_ray_that_a_narrower_one_kept(seed, growth, which):
    rng = np.random.default_rng(seed)
    system = random_system(rng)
    points = random_points(system, rng, 60)
    kept = trace(system, *points).status == Status.KEPT
    if which == 2:
        wider = replace(system, lens=replace(system.lens, diameter=system.lens.diameter * growth))
    else:
        stops = list(system.stops)
        stops[which] = replace(stops[which], diameter=stops[which].diameter * growth)
        wider = replace(system, stops=tuple(stops))
    assert np.all((trace(wider, *points).status == Status.KEPT)[kept])


def test_huge_fields_and_far_objects_do_not_overflow():
    far = trace(PAPER, (1e12, -1e12), (1e12, -1e12))
    np.testing.assert_allclose(far.slope, [1e10, -1e10], rtol=1e-12)
    assert far.status == Status.APERTURE
    end = far.at(np.array([1e200, np.inf]))
    np.testing.assert_allclose(end, [[-1e210, -1e10], [1e210, 1e10]], rtol=1e-12)


def test_directions_are_the_limit_of_far_end_points():
    rng = np.random.default_rng(3)
    system = random_system(rng)
    points = random_points(system, rng, 20)
    at_infinity = ends(system, *points, distance=np.inf)
    far = ends(system, *points, distance=1e12)
    np.testing.assert_allclose(far.x / 1e12, at_infinity.x, rtol=1e-9)
    np.testing.assert_allclose(far.y / 1e12, at_infinity.y, rtol=1e-9)
