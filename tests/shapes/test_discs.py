"""Common parts of discs: against mpmath near every seam, and the laws of area."""

import math

import mpmath as mp
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from roslf_design.fates import ImageFate
from roslf_design.shapes.discs import _boundary_arcs, intersect
from roslf_design.shapes.openings import Openings
from studies.accuracy.oracles import discs as oracle

log_gap = st.floats(-12, 0)
log_radius = st.floats(-1.5, 1.5)
angle = st.floats(0, 2 * math.pi)


def pair(first, second, distance, direction, at=(0.0, 0.0)):
    c = [list(at), [at[0] + distance * math.cos(direction), at[1] + distance * math.sin(direction)]]
    return np.array(c), np.array([first, second])


def relative_error(value, reference):
    with mp.workdps(60):
        return float(abs(mp.mpf(float(value)) - reference) / abs(reference))


def check_pair(centres, radii):
    """Area and lost fraction of two discs, each relative to itself: 16 roundings' worth."""
    shape = intersect(centres, radii)
    with mp.workdps(60):
        area = oracle.lens_area(centres, radii)
        smallest = mp.pi * mp.mpf(float(radii.min())) ** 2
        lost = 1 - area / (mp.pi * mp.mpf(float(radii[0])) ** 2)
        assert abs(float(shape.area) - area) <= 1e-15 * smallest
        if area > 0:
            assert relative_error(shape.area, area) < 16 * 2.2e-16
        if lost > 0:
            assert relative_error(shape.lost_fraction, lost) < 16 * 2.2e-16
        assert shape.lit == (area > 0)
        assert (shape.status == ImageFate.FULL) == (lost == 0)


@given(log_radius, log_radius, log_gap, angle, st.sampled_from([-1, 1]), st.booleans())
def test_two_discs_near_tangency(first, second, gap, direction, side, shifted):
    r = 10.0**first, 10.0**second
    at = (0.3, -1.7) if shifted else (0.0, 0.0)
    check_pair(*pair(*r, r[0] + r[1] - side * 10.0**gap * min(r), direction, at))


@given(log_radius, log_radius, log_gap, angle, st.sampled_from([-1, 1]), st.booleans())
def test_two_discs_near_containment(first, second, gap, direction, side, shifted):
    r = 10.0**first, 10.0**second
    at = (0.3, -1.7) if shifted else (0.0, 0.0)
    check_pair(*pair(*r, max(abs(r[0] - r[1]) + side * 10.0**gap * min(r), 0.0), direction, at))


@given(log_radius, log_radius, st.floats(0.01, 0.99), angle)
def test_two_discs_anywhere_between_tangency_and_containment(first, second, share, direction):
    r = 10.0**first, 10.0**second
    check_pair(*pair(*r, abs(r[0] - r[1]) + share * 2 * min(r), direction))


@given(log_gap, log_gap, st.booleans(), angle)
def test_two_discs_of_almost_the_same_radius(gap, difference, swapped, direction):
    r = (1.0, 1.0 + 10.0**difference)[:: -1 if swapped else 1]
    check_pair(*pair(*r, abs(r[0] - r[1]) + 10.0**gap, direction))
    check_pair(*pair(*r, r[0] + r[1] - 10.0**gap, direction))
    check_pair(*pair(1.0, 1.0, 10.0**gap, direction))


@pytest.mark.parametrize("gap", [1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize("seam", [25.4 - 2.2, 25.4 + 2.2])
@pytest.mark.parametrize("side", [-1, 1])
def test_paper_sized_discs_to_16_ulp(gap, seam, side):
    """Where the triangle's area by Heron's formula is wrong in the first digit."""
    check_pair(np.array([[0.0, 0.0], [seam + side * gap, 0.0]]), np.array([2.2, 25.4]))


@pytest.mark.parametrize("exponent", [6, 10, 14])
def test_straight_edge_limit(exponent):
    """A disc of enormous radius is a half-plane: half of disc 0 is left."""
    far = 10.0**exponent
    shape = intersect([[0, 0], [far, 0]], [1, far])
    np.testing.assert_allclose(shape.area, math.pi / 2, rtol=1.0 / far)


@pytest.mark.parametrize(
    ("radii", "distance"),
    [
        ((1, 2), 1.5),
        ((2, 1), 1.5),
        ((1, 1), 1e-3),
        ((1, 1.1), 0.1001),
        ((1, 3), 3.999),
        ((1, 1), 1.99),
        ((1, 40), 39.5),
    ],
)
def test_centroid_and_moments_of_two_discs(radii, distance):
    centres, radii = pair(*map(float, radii), distance, 0.7, (0.2, 0.1))
    shape = intersect(centres, radii)
    area, centroid, moments = oracle.shape(centres, radii, digits=40)
    spread = float(moments[0] + moments[2])
    np.testing.assert_allclose(shape.area, float(area), rtol=2e-15)
    np.testing.assert_allclose(shape.centroid, [float(v) for v in centroid], rtol=0, atol=1e-15)
    np.testing.assert_allclose(shape.second_moments, [float(v) for v in moments], rtol=0, atol=4e-15 * spread)


@pytest.mark.parametrize(("count", "seed"), [(3, 1), (5, 0), (5, 1)])
def test_shape_of_many_discs(count, seed):
    rng = np.random.default_rng(seed)
    centres, radii = rng.normal(size=(count, 2)) * 0.3, rng.uniform(0.8, 1.3, count)
    shape = intersect(centres, radii)
    area, centroid, moments = oracle.shape(centres, radii, digits=25)
    np.testing.assert_allclose(shape.area, float(area), rtol=1e-14)
    np.testing.assert_allclose(shape.centroid, [float(v) for v in centroid], rtol=0, atol=3e-15)
    np.testing.assert_allclose(shape.second_moments, [float(v) for v in moments], rtol=0, atol=3e-15)


@pytest.mark.parametrize("exponent", [-1, -8])
@pytest.mark.parametrize("spread", [0.0, 3.0])
def test_loss_to_several_discs_is_right_relative_to_itself(exponent, spread):
    """Overlapping and separate notches in a disc that keeps almost everything."""
    rng = np.random.default_rng(5)
    gap = 10.0**exponent
    radii = rng.uniform(1.05, 8, 4)
    directions = 0.4 + spread * np.arange(4) / 2 + rng.normal(size=4) * math.sqrt(gap)
    reach = radii - 1 + gap * rng.uniform(0.5, 1.5, 4)
    centres = np.vstack([[0, 0], np.stack([reach * np.cos(directions), reach * np.sin(directions)], -1)])
    radii = np.r_[1.0, radii]
    with mp.workdps(50):
        lost = 1 - oracle.area(centres, radii, digits=50) / mp.pi
    assert relative_error(intersect(centres, radii).lost_fraction, lost) < 1e-14 / math.sqrt(gap)


grid = st.integers(-8, 8).map(lambda n: n / 4)
disc = st.tuples(grid, grid, st.integers(1, 8).map(lambda n: n / 4))


@given(st.lists(disc, min_size=3, max_size=6))
def test_tangent_concentric_and_equal_discs_by_brute_force(discs):
    """On a coarse lattice most sets have circles that touch, coincide or share a point. Grid of step h: each column's
    slice is exact, so the error is that of the midpoint rule at square-root ends, below 2 h^1.5 per disc."""
    values = np.array(discs)
    centres, radii = values[:, :2], values[:, 2]
    h = 4e-4
    x = np.arange(-4 + h / 2, 4, h)[:, None]
    inside = np.abs(x - centres[:, 0]) < radii
    half = np.sqrt(np.maximum(radii**2 - (x - centres[:, 0]) ** 2, 0))
    slices = np.min(centres[:, 1] + half, axis=1) - np.max(centres[:, 1] - half, axis=1)
    area = h * np.maximum(slices, 0)[inside.all(axis=1)].sum()
    shape = intersect(centres, radii)
    np.testing.assert_allclose(shape.area, area, atol=2 * h**1.5 * len(radii))
    assert np.isfinite(shape.centroid).all()
    order = np.r_[0, 1 + np.random.default_rng(0).permutation(len(radii) - 1)]
    shuffled = intersect(centres[order], radii[order])
    np.testing.assert_allclose(shuffled.area, shape.area, atol=1e-14)
    np.testing.assert_allclose(shuffled.lost_fraction, shape.lost_fraction, atol=1e-14)


place = st.floats(-1, 1).map(lambda x: x if abs(x) > 1e-60 else 0.0)
any_disc = st.tuples(place, place, st.floats(1e-9, 2) | st.just(0.0))
sets = st.lists(any_disc, min_size=1, max_size=6).map(np.array)


@given(sets)
def test_kept_and_lost_add_up(discs):
    shape = intersect(discs[:, :2], discs[:, 2])
    assert shape.kept_fraction + shape.lost_fraction == pytest.approx(1, abs=2.3e-16)
    assert 0 <= shape.kept_fraction <= 1
    np.testing.assert_allclose(shape.area, shape.kept_fraction * math.pi * discs[0, 2] ** 2, rtol=1e-15, atol=1e-300)


@given(sets, st.integers(-40, 40))
def test_scaling(discs, power):
    scale = 2.0**power
    one, other = intersect(discs[:, :2], discs[:, 2]), intersect(discs[:, :2] * scale, discs[:, 2] * scale)
    np.testing.assert_array_equal(other.kept_fraction, one.kept_fraction)
    np.testing.assert_array_equal(other.area, one.area * scale**2)
    np.testing.assert_allclose(other.second_moments, one.second_moments * scale**2, rtol=0, atol=1e-290)  # subnormals


@given(sets)
def test_mirror(discs):
    one, other = intersect(discs[:, :2], discs[:, 2]), intersect(discs[:, :2] * [-1, 1], discs[:, 2])
    np.testing.assert_allclose(other.area, one.area, rtol=1e-14, atol=1e-15)
    if one.area > 1e-6:
        np.testing.assert_allclose(other.centroid, one.centroid * [-1, 1], atol=1e-13)
        np.testing.assert_allclose(other.second_moments, one.second_moments * [1, -1, 1], atol=1e-13)


@given(sets, st.integers(0, 5), st.floats(0, 0.5))
def test_area_grows_with_each_radius(discs, which, growth):
    assume(which < len(discs))
    more = discs.copy()
    more[which, 2] += growth
    one, other = intersect(discs[:, :2], discs[:, 2]), intersect(more[:, :2], more[:, 2])
    assert other.area >= one.area * (1 - 1e-14) - 1e-15


@given(sets)
def test_large_and_small_batches_agree(discs):
    """Compiled and interpreted kernels do the same arithmetic; sines and arc tangents may differ by an ulp."""
    one = intersect(discs[:, :2], discs[:, 2])
    many = intersect(np.broadcast_to(discs[:, :2], (4096, len(discs), 2)), discs[:, 2])
    for few, much in zip(one, many, strict=True):
        np.testing.assert_array_equal(much, np.broadcast_to(much[0], much.shape))
        np.testing.assert_allclose(much[0], few, rtol=4.5e-16, atol=1e-15)


def test_which_disc_clips():
    shape = intersect([[[0, 0], [0.5, 0], [0, 9]], [[0, 0], [5, 0], [0, 9]]], [1, 1, 10])
    np.testing.assert_array_equal(shape.status, [ImageFate.CLIPPED, ImageFate.DARK])
    np.testing.assert_array_equal(shape.clipping, [[False, True, False], [False, True, False]])
    np.testing.assert_array_equal(shape.lit, [True, False])
    assert intersect([[0, 0], [0.5, 0]], [1, 2]).status == ImageFate.FULL
    assert intersect([[0, 0], [0.5, 0]], [2, 1]).clipping.tolist() == [False, True]


def test_empty_part_has_finite_numbers():
    shape = intersect([[3.0, 4.0], [30, 4]], [1, 1])
    np.testing.assert_array_equal(shape.centroid, [3, 4])
    np.testing.assert_array_equal(shape.second_moments, 0)
    assert (shape.area, shape.kept_fraction, shape.lost_fraction, shape.axis_ratio) == (0, 0, 1, 0)
    assert intersect([[0, 0]], [0]).status == ImageFate.DARK


def test_three_discs_that_meet_in_pairs_only():
    corners = np.stack([np.cos([0.5, 2.6, 4.7]), np.sin([0.5, 2.6, 4.7])], -1)
    shape = intersect(corners, [0.9, 0.9, 0.9])
    assert shape.status == ImageFate.DARK
    np.testing.assert_array_equal(shape.clipping, [False, True, True])


def test_axes_of_a_cats_eye():
    """Two equal discs: symmetric about both axes, long across the line of centres."""
    shape = intersect(*pair(1.0, 1.0, 1.0, 0.4))
    _, _, (xx, _, yy) = oracle.shape([[0, 0], [1, 0]], [1, 1], digits=30)
    np.testing.assert_allclose(shape.axis_ratio, float(mp.sqrt(xx / yy)), rtol=1e-14)
    assert intersect([[0, 0]], [2]).axis_ratio == 1


@given(sets)
def test_arcs_close_and_bound_the_part(discs):
    centres, radii = discs[:, :2], discs[:, 2]
    shape, arcs = intersect(centres, radii), _boundary_arcs(centres, radii)
    assert bool(arcs) == shape.lit
    ends = [
        [centres[a.disc] + radii[a.disc] * np.array([math.cos(t), math.sin(t)]) for t in (a.start, a.end)] for a in arcs
    ]
    for k in range(len(arcs)):
        np.testing.assert_allclose(ends[k][1], ends[(k + 1) % len(arcs)][0], atol=1e-7 if shape.area < 1e-9 else 1e-12)
    green = sum(
        0.5
        * radii[a.disc]
        * (
            radii[a.disc] * (a.end - a.start)
            + centres[a.disc] @ np.array([math.sin(a.end) - math.sin(a.start), math.cos(a.start) - math.cos(a.end)])
        )
        for a in arcs
    )
    np.testing.assert_allclose(green, shape.area, atol=1e-13)
    points = Openings.of_discs(centres, radii).outline()
    distance = np.hypot(*(points[:, None] - centres).T).T - radii
    assert (distance < 1e-12).all()


@pytest.mark.parametrize(
    ("centres", "radii", "message"),
    [
        ([0.0, 0.0], [1.0], "centres must have shape"),
        ([[0.0, 0.0]], 1.0, "radii must have shape"),
        ([[0.0, 0.0]] * 2, [1.0] * 3, "do not fit"),
        ([[0.0, 0.0]], [-1.0], "must not be negative"),
        ([[0.0, np.nan]], [1.0], "must be numbers"),
        ([[0.0, 0.0]], [np.inf], "leave out a stop that never clips"),
        (np.empty((3, 0, 2)), np.empty((3, 0)), "at least one disc"),
    ],
)
def test_bad_input_is_named(centres, radii, message):
    with pytest.raises(ValueError, match=message):
        intersect(centres, radii)
