"""Tilted stops: against brute-force backward rays, against discs at no tilt, against an ellipse's own formula."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roslf_design.microlens.discs import ClipStatus, intersect
from roslf_design.microlens.images import stop_images
from roslf_design.microlens.rims import rim_maps, tilted_microlens_images

P1 = {"focal_length": 100.0, "focal_plane": 350.0, "mla_distance": 140.0, "sensor_distance": 2.0}
FAP_AND_LENS = ([2.9, 50.8], [120.0, 0.0])


def rotation(tilt):
    """R_y R_x, written out as a product."""
    (sx, sy), (cx, cy) = np.sin(tilt), np.cos(tilt)
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    return about_y @ about_x


def kept_by_ray(points, axis, diameters, distances, decentres, tilts, system):
    """Whether backward rays from sensor points (n, 2), relative to the microlens axis, pass every stop."""
    slope = np.asarray(points) / system["sensor_distance"]
    lens = np.asarray(axis) - slope * system["mla_distance"]
    outward = slope + lens / system["focal_length"]
    kept = np.ones(len(slope), bool)
    for diameter, distance, decentre, tilt in zip(diameters, distances, decentres, tilts, strict=True):
        turn = rotation(np.asarray(tilt))
        # The ray is (lens, 0) + t (-outward, -1); where it meets the stop's plane, in the stop's own coordinates.
        origin = np.column_stack([lens - decentre, np.full(len(lens), distance)]) @ turn
        direction = np.column_stack([-outward, np.full(len(lens), -1.0)]) @ turn
        hit = origin - direction * (origin[:, 2:] / direction[:, 2:])
        kept &= np.hypot(hit[:, 0], hit[:, 1]) <= diameter / 2
    return kept


@pytest.mark.parametrize("seed", range(8))
def test_area_and_moments_by_rays_alone(seed):
    """How far the light reaches in each of 4096 directions from a lit point, by bisection with backward rays; the sums
    over directions miss the corners of the outline by (2 pi / 4096)^2, 2e-6."""
    rng = np.random.default_rng(seed)
    stops = [2.9, 3.1, 50.8], [120.0, 90.0, 0.0]
    decentres, tilts = rng.normal(size=(3, 2)) * 0.2, rng.normal(size=(3, 2)) * 0.4
    axis = rng.uniform(-2, 2, 2)
    shape = tilted_microlens_images(axis, *stops, decentres, tilts, **P1)
    assert shape.status == ClipStatus.CLIPPED
    angles = 2 * math.pi * np.arange(4096) / 4096
    u = np.column_stack([np.cos(angles), np.sin(angles)])
    low, high = np.zeros(4096), np.full(4096, 0.1)
    for _ in range(40):
        middle = 0.5 * (low + high)
        lit = kept_by_ray(shape.centroid + middle[:, None] * u, axis, *stops, decentres, tilts, P1)
        low, high = np.where(lit, middle, low), np.where(lit, high, middle)
    area = math.pi * np.mean(low**2)
    np.testing.assert_allclose(shape.area, area, rtol=2e-6)
    drift = 2 * math.pi * np.mean(low[:, None] ** 3 * u, axis=0) / 3 / area
    np.testing.assert_allclose(drift, 0, atol=2e-6 * math.sqrt(area))
    xx, xy, yy = (2 * math.pi * np.mean(low**4 * u[:, i] * u[:, j]) / 4 / area for i, j in ((0, 0), (0, 1), (1, 1)))
    np.testing.assert_allclose(shape.second_moments, [xx, xy, yy], atol=2e-6 * area)


@given(
    st.tuples(*[st.floats(-25, 25)] * 2),
    st.tuples(*[st.floats(-1, 1)] * 4),
    st.floats(0.5, 4),
    st.sampled_from([119.0, 60.0, -30.0]),
)
def test_no_tilt_is_the_disc(axis, decentres, second, distance):
    stops = ([2.9, second, 40.0], [120.0, distance, 0.0], [decentres[:2], decentres[2:], (0.0, 0.0)])
    discs = intersect(*stop_images(axis, *stops, **P1))
    rims = tilted_microlens_images(axis, *stops, (0.0, 0.0), **P1)
    size = math.pi * 0.0315**2
    np.testing.assert_allclose(rims.area, discs.area, rtol=0, atol=1e-13 * size)
    np.testing.assert_allclose(rims.kept_fraction, discs.kept_fraction, rtol=0, atol=1e-13)
    np.testing.assert_allclose(rims.lost_fraction, discs.lost_fraction, rtol=0, atol=1e-13)
    if discs.kept_fraction > 1e-3:
        assert rims.status == discs.status
        np.testing.assert_array_equal(rims.clipping, discs.clipping)
        np.testing.assert_allclose(rims.centroid, discs.centroid, rtol=0, atol=1e-10 * 0.03)
        np.testing.assert_allclose(rims.second_moments, discs.second_moments, rtol=0, atol=1e-10 * size)


@given(st.floats(-1, 1), st.floats(-1, 1), st.tuples(*[st.floats(-10, 10)] * 2), st.floats(0, 2 * math.pi))
def test_rim_points_graze_the_stop(t_x, t_y, axis, angle):
    maps = rim_maps(axis, [2.9], [120.0], [0.3, -0.2], [t_x, t_y], **P1)[0]
    u, v = math.cos(angle), math.sin(angle)
    for share, kept in ((1 - 1e-9, True), (1 + 1e-9, False)):
        x, y, w = maps @ [share * u, share * v, 1]
        rays = kept_by_ray([(x / w, y / w)], axis, [2.9], [120.0], [(0.3, -0.2)], [(t_x, t_y)], P1)
        assert rays[0] == kept


def test_area_of_one_tilted_stop():
    """Image of a circle under (A, b; g, w): area pi |det| / (w^2 - |g|^2)^(3/2)."""
    maps = rim_maps([3.0, -4.0], [2.9], [120.0], (0.1, 0.2), (0.5, -0.7), **P1)[0]
    expected = math.pi * np.linalg.det(maps) / (maps[2, 2] ** 2 - maps[2, 0] ** 2 - maps[2, 1] ** 2) ** 1.5
    shape = tilted_microlens_images([3.0, -4.0], [2.9], [120.0], (0.1, 0.2), (0.5, -0.7), **P1)
    np.testing.assert_allclose(shape.area, expected, rtol=1e-13)
    assert (shape.status, shape.kept_fraction, shape.lost_fraction) == (ClipStatus.FULL, 1, 0)


def test_the_same_rim_twice_clips_nothing():
    shape = tilted_microlens_images([3.0, 1.0], [2.9, 2.9], [120.0] * 2, (0.0, 0.1), (0.2, 0.3), **P1)
    assert shape.status == ClipStatus.FULL
    np.testing.assert_array_equal(shape.clipping, False)


def test_shortest_cut_is_seen():
    """A chord of a thousandth of the rim, far shorter than any sampling of the rims would show."""
    axis = 17.781666666666666 * (1 + 1e-8)
    shape = tilted_microlens_images([axis, 0.0], *FAP_AND_LENS, (0.0, 0.0), (0.0, 0.0), **P1)
    assert shape.status == ClipStatus.CLIPPED
    assert shape.clipping.tolist() == [False, True]


def test_a_tilted_iris_narrows_along_the_tilt():
    upright, tilted = (
        tilted_microlens_images([0.0, 0.0], [2.9], [120.0], (0.0, 0.0), (0.0, t), **P1) for t in (0.0, 0.5)
    )
    np.testing.assert_allclose(upright.axis_ratio, 1, rtol=1e-12)
    np.testing.assert_allclose(tilted.axis_ratio, math.cos(0.5), rtol=2e-3)
    np.testing.assert_allclose(abs(tilted.orientation), math.pi / 2, rtol=1e-9)


def test_large_and_small_batches_agree():
    rng = np.random.default_rng(2)
    axes = rng.uniform(-25, 25, (256, 2))
    arguments = (*FAP_AND_LENS, rng.normal(size=(2, 2)) * 0.3, rng.normal(size=(2, 2)) * 0.2)
    many = tilted_microlens_images(axes, *arguments, **P1)
    for field in (0, 17, 200):
        few = tilted_microlens_images(axes[field], *arguments, **P1)
        for one, other in zip(few, many, strict=True):
            np.testing.assert_allclose(other[field], one, rtol=1e-13, atol=1e-15)


def test_no_light_has_finite_numbers():
    shape = tilted_microlens_images([0.0, 0.0], [2.9, 2.9], [120.0, 60.0], [(0.0, 0.0), (9.0, 0.0)], (0.1, 0.0), **P1)
    assert shape.status == ClipStatus.EMPTY
    assert (shape.area, shape.kept_fraction, shape.lost_fraction) == (0, 0, 1)
    assert shape.clipping.tolist() == [False, True]
    assert np.isfinite(shape.centroid).all()


def test_bad_stops_are_named():
    with pytest.raises(ValueError, match="not in front of the object plane"):
        rim_maps([0.0, 0.0], [20.0], [349.0], (0.0, 0.0), (0.5, 0.0), **P1)
    with pytest.raises(ValueError, match="above 0 mm"):
        rim_maps([0.0, 0.0], [0.0], [120.0], (0.0, 0.0), (0.5, 0.0), **P1)
