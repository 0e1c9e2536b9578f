"""Shift and sum against light fields and cameras of which everything is known."""

import math

import numpy as np
import pytest

from roslf_design.calibration.decoding import LightField
from roslf_design.calibration.refocusing import CameraDistances, focus_stack, sharp_disparities
from roslf_design.camera import Camera
from roslf_design.design import load
from roslf_design.theory.light_field import depth_of_slope, view_projection

STEPS = {"square": 1.0, "hexagonal": math.sqrt(3) / 2}


def field_of(look, views=7, size=(30, 40), step=1.0, weight=None):
    """What every sample shows is `look(s, t, u, v)`."""
    s = np.arange(views) - (views - 1) / 2
    v, u = (step * (np.arange(n) - n // 2) for n in size)
    t4, s4, v4, u4 = np.meshgrid(s, s, v, u, indexing="ij")
    values = look(s4, t4, u4, v4).astype(np.float32)
    light = np.ones(values.shape, np.float32) if weight is None else weight.astype(np.float32)
    return LightField(np.where(light > 0, values, np.float32(0)), light, s, s.copy(), u, v, 7.0)


@pytest.mark.parametrize("step", STEPS.values(), ids=STEPS)
@pytest.mark.parametrize("slope", [0.0, 0.37, -1.0])
def test_a_plane_comes_back_sharp_at_its_slope(slope, step):
    def texture(u, v):
        return 3 + 0.2 * u - 0.1 * v + 0.01 * u * u - 0.02 * u * v + 0.015 * v * v

    # A point at (u, v) of the middle view stands at (u + slope s, v + slope t) of another.
    field = field_of(lambda s, t, u, v: texture(u - slope * s, v - slope * t), step=step)
    picture, weight = field.refocused(slope)
    v, u = np.meshgrid(field.v, field.u, indexing="ij")
    inside = weight == 49
    assert inside[8:-8, 8:-8].all()
    edge = 0.02 * step**2  # read linearly, at the edge, a quadratic is off by an eighth of its curvature
    np.testing.assert_allclose(picture[inside], texture(u, v)[inside], atol=edge)
    np.testing.assert_allclose(picture[8:-8, 8:-8], texture(u, v)[8:-8, 8:-8], rtol=1e-5)  # cubic: exact


def test_views_count_by_their_weight_and_not_at_all_where_nothing_was_measured():
    rng = np.random.default_rng(2)
    light = np.where(rng.random((5, 5, 12, 14)) < 0.3, 0.0, rng.random((5, 5, 12, 14)))
    light[:, :, 3, 4] = 0.0
    values = rng.random((5, 5, 12, 14))
    field = field_of(lambda s, t, u, v: values, views=5, size=(12, 14), weight=light)
    for slope in (0.0, 1.0, -2.0):  # whole microlenses: what is summed can be counted by hand
        picture, weight = field.refocused(slope)
        for v in range(12):
            for u in range(14):
                held = total = 0.0
                for j in range(5):
                    for i in range(5):
                        row, column = v + int(slope) * (j - 2), u + int(slope) * (i - 2)
                        if 0 <= row < 12 and 0 <= column < 14:
                            held += field.weight[j, i, row, column]
                            total += field.weight[j, i, row, column] * field.values[j, i, row, column]
                assert weight[v, u] == pytest.approx(held, rel=1e-5)
                assert picture[v, u] == pytest.approx(total / held if held else 0.0, rel=1e-5)
    assert field.refocused(0.0)[1][3, 4] == 0


def test_the_stack_spans_what_is_sharp_somewhere_near_planes_last():
    rng = np.random.default_rng(3)
    waves = rng.normal(size=(40, 2)) * 1.2, rng.random(40) * 7

    def texture(u, v):
        return sum(np.sin(a * u + b * v + c) for (a, b), c in zip(*waves, strict=True))

    def look(s, t, u, v):  # disparities -5 on the left and 7 on the right, 7 px across
        slope = np.where(u < 0, 5 / 7, -7 / 7)
        return texture(u - slope * s, v - slope * t)

    found = sharp_disparities(field_of(look, size=(60, 80)))
    assert found[0] == pytest.approx(-5, abs=2.3)  # half a step of the search, and one step more
    assert found[-1] == pytest.approx(7, abs=2.3)
    assert found[0] < -5 < 7 < found[-1]
    stack = focus_stack(field_of(look, size=(60, 80)))
    assert [plane.disparity for plane in stack] == found.tolist()
    assert all(plane.slope == pytest.approx(-plane.disparity / 7) for plane in stack)


@pytest.mark.parametrize(("level", "shading"), [(0.0, 0.0), (5.0, 0.0), (5.0, 1e-3)])
def test_without_texture_the_stack_lies_about_the_focal_plane(level, shading):
    found = sharp_disparities(field_of(lambda s, t, u, v: level * (1 + shading * s * t * np.sin(u + v)), size=(60, 80)))
    np.testing.assert_allclose(found, -found[::-1])
    assert np.isfinite(found).all()


@pytest.mark.parametrize("size", [(1, 1), (2, 40)])
def test_one_microlens_is_a_light_field_too(size):
    field = field_of(lambda s, t, u, v: 1.0 + 0 * u, size=size)
    assert all(np.isfinite(plane.values).all() for plane in focus_stack(field))


@pytest.mark.parametrize("preset", ["paper", "rigid-scope", "paper-mismatched"])
def test_slopes_and_depths_agree_with_projected_points(preset):
    camera = Camera.of(load(preset))
    for depth in float(camera.d_f - camera.d_3) * np.array([0.4, 0.9, 1.0, 1.3, 4.0]):
        point = np.array([1.3, -0.4, depth, 1.0])
        near, far = (view_projection(camera, (s, 0.0)) @ point for s in (-2.0, 3.0))
        slope = (far[0] - near[0]) / depth / 5.0
        assert float(depth_of_slope(camera, slope)) == pytest.approx(depth, rel=1e-9)
    endless = float(depth_of_slope(camera, camera.m * camera.q * camera.A / (camera.d * camera.d_2)))
    assert abs(1 / endless) < 1e-12  # nothing at infinity moves by this


@pytest.mark.parametrize("preset", ["paper", "cystoscope", "arthroscope", "grin-needle"])
def test_distances_go_both_ways_also_through_what_lies_in_the_bore(preset):
    camera = Camera.of(load(preset))
    distances = CameraDistances(camera)
    front = float(np.asarray(camera.front[0]))
    focus = float(load(preset).d_f)
    for share in (0.5, 1.0, 1.7):
        place = front + share * (focus - front)
        assert distances.distance(distances.slope(place)) == pytest.approx(place, rel=1e-9)
    assert distances.slope(focus) == pytest.approx(0.0, abs=1e-12)
    assert math.isnan(distances.distance(1e3))
