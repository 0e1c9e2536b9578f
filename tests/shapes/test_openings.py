"""Common parts of discs and rectangles, against polygon clipping, circle segments and rows of brute force."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roslf_design.bore.opening import ClearAperture, inside
from roslf_design.fates import ImageFate
from roslf_design.shapes.ellipses import _ellipse_shapes
from roslf_design.shapes.openings import Openings
from tests.shapes.blocks import area_in_rectangle

TOLERANCE = 1e-9
"""Of the first opening's area, half width and its square: what the issue asks for; the forms are good to 1e-12."""


def rectangle(x, y, a, b, turn):
    return np.array([[x + p, y + q] for p, q in ClearAperture(math.inf, (a, b), turn).corners])


def row_of(things):
    """Openings of (x, y, r) discs and (x, y, a, b, turn) rectangles, in order."""
    straight = tuple(k for k, thing in enumerate(things) if len(thing) == 5)
    centres = np.array([thing[:2] for thing in things], float)
    radii = np.array([math.inf if len(thing) == 5 else thing[2] for thing in things], float)
    corners = np.array([rectangle(*things[k]) for k in straight]).reshape(-1, 4, 2)
    return Openings(centres, radii, corners, straight)


def clipped(polygon, other):
    """Sutherland and Hodgman: a polygon inside a convex one, both counterclockwise."""
    for (x0, y0), (x1, y1) in zip(other, np.roll(other, -1, 0), strict=True):
        kept = []
        side = [(x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) for x, y in polygon]
        for k, point in enumerate(polygon):
            before, s, t = polygon[k - 1], side[k - 1], side[k]
            if s * t < 0:
                kept.append(np.asarray(before) + (np.asarray(point) - before) * (s / (s - t)))
            if t >= 0:
                kept.append(np.asarray(point))
        polygon = kept
        if not polygon:
            return []
    return polygon


def shoelace(polygon):
    """Area, centroid and central moments per area of a polygon: from triangles with its first corner."""
    first = np.asarray(polygon[0])
    total, moment, second = 0.0, np.zeros(2), np.zeros((2, 2))
    for p, q in pairwise(polygon[1:]):
        u, v = np.asarray(p) - first, np.asarray(q) - first
        area = (u[0] * v[1] - u[1] * v[0]) / 2
        total += area
        moment += area * (u + v) / 3
        second += area / 12 * (np.outer(u, u) + np.outer(v, v) + np.outer(u + v, u + v))
    middle = moment / total
    return total, first + middle, second / total - np.outer(middle, middle)


def circle_and_polygon(x, y, r, polygon):
    """Area common to a disc and a convex polygon: signed triangles and segments, edge by edge."""
    total = 0.0
    for p, q in zip(polygon, [*polygon[1:], polygon[0]], strict=True):
        u, v = np.asarray(p) - (x, y), np.asarray(q) - (x, y)
        way = v - u
        a, b, c = way @ way, u @ way, u @ u - r * r
        cuts = [0.0, 1.0]
        if b * b > a * c:
            cuts += [t for s in (-1, 1) if 0 < (t := (-b + s * math.sqrt(b * b - a * c)) / a) < 1]
        cuts.sort()
        for s, t in pairwise(cuts):
            g, h, middle = u + s * way, u + t * way, u + (s + t) / 2 * way
            cross, dot = g[0] * h[1] - g[1] * h[0], g @ h
            total += cross / 2 if middle @ middle < r * r else r * r / 2 * math.atan2(cross, dot)
    return total


def by_rows(things, count=32):
    """Area, centroid, central moments per area: Gauss rows between all heights at which sides may bend."""

    def ends(y):
        low, high = -math.inf, math.inf
        for thing in things:
            if len(thing) == 3:
                x0, y0, r = thing
                reach = math.sqrt(max((r - y + y0) * (r + y - y0), 0.0))
                low, high = max(low, x0 - reach), min(high, x0 + reach)
                if abs(y - y0) >= r:
                    return 0.0, 0.0
                continue
            x0, y0, a, b, turn = thing
            c, s = math.cos(turn), math.sin(turn)
            for n, m, half in ((c, s, a), (-s, c, b)):  # |n (x - x0) + m (y - y0)| <= half
                rest = m * (y - y0)
                if abs(n) < 1e-12:
                    if abs(rest) > half:
                        return 0.0, 0.0
                    continue
                edges = sorted(x0 + (sign * half - rest) / n for sign in (-1, 1))
                low, high = max(low, edges[0]), min(high, edges[1])
        return (low, high) if high > low else (0.0, 0.0)

    heights = set()
    lines, circles = [], [thing for thing in things if len(thing) == 3]
    for thing in things:
        if len(thing) == 5:
            polygon = rectangle(*thing)
            lines += [*zip(polygon, np.roll(polygon, -1, 0), strict=True)]
            heights |= {*polygon[:, 1]}
    for x, y, r in circles:
        heights |= {y - r, y, y + r}
        for p, q in lines:
            way, off = q - p, p - (x, y)
            a, b, c = way @ way, off @ way, off @ off - r * r
            if b * b > a * c:
                heights |= {float(p[1] + (-b + s * math.sqrt(b * b - a * c)) / a * way[1]) for s in (-1, 1)}
        for u, v, w in circles:
            d = math.hypot(u - x, v - y)
            if 0 < d < r + w and d > abs(r - w):
                foot = (d * d + r * r - w * w) / (2 * d)
                h = math.sqrt(max(r * r - foot * foot, 0.0))
                heights |= {y + foot * (v - y) / d + s * h * (u - x) / d for s in (-1, 1)}
    for p, q in lines:
        for u, v in lines:
            way, other, off = q - p, v - u, u - p
            det = way[0] * other[1] - way[1] * other[0]
            if abs(det) > 1e-15:
                heights.add(float(p[1] + (off[0] * other[1] - off[1] * other[0]) / det * way[1]))
    nodes, weights = np.polynomial.legendre.leggauss(count)
    steps, sums = sorted(heights), np.zeros(6)
    for low, high in pairwise(steps):
        for node, weight in zip(nodes, weights, strict=True):
            angle = node * math.pi / 2
            y = (low + high) / 2 + (high - low) / 2 * math.sin(angle)
            left, right = ends(y)
            share = weight * math.pi / 2 * math.cos(angle) * (high - low) / 2 * (right - left)
            middle, square = (left + right) / 2, (left * left + left * right + right * right) / 3
            sums += share * np.array([1.0, middle, y, square, middle * y, y * y])
    area, (mx, my) = sums[0], sums[1:3] / sums[0] if sums[0] > 0 else (0.0, 0.0)
    xx, xy, yy = sums[3:] / sums[0] if sums[0] > 0 else (0.0, 0.0, 0.0)
    return area, np.array([mx, my]), np.array([xx - mx * mx, xy - mx * my, yy - my * my])


def whole(thing):
    return math.pi * thing[2] ** 2 if len(thing) == 3 else 4 * thing[2] * thing[3]


def check(things):
    part = row_of(things).common()
    area, middle, moments = by_rows(things)
    size = whole(things[0])
    assert float(part.kept_fraction) == pytest.approx(area / size, abs=TOLERANCE)
    assert float(part.kept_fraction + part.lost_fraction) == 1
    assert float(part.area) == pytest.approx(area, abs=TOLERANCE * size)
    if area > 1e-4 * size:  # of a sliver no place has as many digits
        reach = math.sqrt(size)
        np.testing.assert_allclose(part.centroid, middle, rtol=0, atol=TOLERANCE * reach)
        np.testing.assert_allclose(part.second_moments, moments, rtol=0, atol=TOLERANCE * size)


places = st.floats(-0.8, 0.8)
sizes = st.floats(0.2, 1.5)
discs = st.tuples(places, places, sizes)
rectangles = st.tuples(places, places, sizes, sizes, st.floats(-3.2, 3.2))


@settings(max_examples=25, deadline=None)
@given(rectangles, rectangles)
def test_two_rectangles_as_clipped_polygons(first, second):
    part = row_of([first, second]).common()
    polygon = clipped([*rectangle(*first)], rectangle(*second))
    if len(polygon) < 3:
        assert float(part.kept_fraction) == pytest.approx(0, abs=TOLERANCE)
        return
    area, middle, moments = shoelace(polygon)
    assert float(part.area) == pytest.approx(area, abs=1e-12)
    if area > 1e-4:
        np.testing.assert_allclose(part.centroid, middle, rtol=0, atol=TOLERANCE)
        xx, xy, yy = part.second_moments
        np.testing.assert_allclose([[xx, xy], [xy, yy]], moments, rtol=0, atol=TOLERANCE)


@settings(max_examples=25, deadline=None)
@given(rectangles, discs)
def test_rectangle_and_disc_as_circle_segments(box, disc):
    area = circle_and_polygon(*disc, rectangle(*box))
    for things in ([box, disc], [disc, box]):
        assert float(row_of(things).common().area) == pytest.approx(area, abs=1e-12)


@settings(max_examples=15, deadline=None)
@given(st.lists(st.one_of(discs, rectangles), min_size=2, max_size=4))
def test_areas_centroids_and_moments_as_rows_add_up(things):
    check(things)


@pytest.mark.parametrize(
    "things",
    [
        [(0, 0, 1.0, 0.5, 0.0), (0, 0, 0.5, 1.0, 0.0)],  # sides on one line with each other
        [(0, 0, 1.0, 0.5, 0.0), (0.5, 0, 1.0, 0.5, 0.0)],
        [(0, 0, 1.0, 0.5, 0.3), (0, 0, 1.0, 0.5, 0.3), (0.2, 0, 1.0)],  # the same twice
        [(0, 0, 1.0, 1.0, 0.0), (0, 0, 1.0)],  # inscribed: touches four sides
        [(0, 0, 1.0), (0, 0, 1.0, 1.0, 0.0)],
        [(0, 0, math.sqrt(0.5), math.sqrt(0.5), 0.4), (0, 0, 1.0)],  # circumscribed: through four corners
        [(0, 0, 1.0, 1.0, 0.0), (1.0, 1.0, 0.5)],  # about a corner
        [(0, 0, 1.0, 1.0, 0.0), (0, 0, 1.0, 1.0, math.pi / 4)],  # an octagon
    ],
)
def test_sides_that_touch(things):
    check(things)


def test_whole_cut_and_dark():
    box, disc = (0.1, 0, 0.5, 0.2, 0.7), (0, 0, 2.0)
    part = row_of([box, disc]).common()
    assert part.status == ImageFate.FULL
    assert part.kept_fraction == 1
    assert part.lost_fraction == 0
    assert not part.clipping.any()
    np.testing.assert_allclose(part.second_moments[[0, 2]].sum(), (0.5**2 + 0.2**2) / 3, rtol=1e-14)
    part = row_of([disc, box]).common()
    assert part.status == ImageFate.CLIPPED
    assert part.clipping.tolist() == [False, True]
    assert part.kept_fraction == pytest.approx(0.4 / (4 * math.pi), rel=1e-12)
    part = row_of([box, (3, 0, 0.5)]).common()
    assert part.status == ImageFate.DARK
    assert part.clipping.tolist() == [False, True]
    assert part.area == 0


@settings(max_examples=15, deadline=None)
@given(st.lists(st.one_of(discs, rectangles), min_size=2, max_size=3), st.floats(1e-3, 1e3), st.integers(0, 3))
def test_scale_and_quarter_turns_change_no_share(things, scale, quarters):
    def moved(thing):
        x, y, *size = thing
        for _ in range(quarters):
            x, y = -y, x
        turn = [size[2] + quarters * math.pi / 2] if len(size) == 3 else []
        return (scale * x, scale * y, *(scale * length for length in size[:2]), *turn)

    kept, other = (row_of(some).common().kept_fraction for some in (things, [moved(thing) for thing in things]))
    assert float(other) == pytest.approx(float(kept), abs=1e-11)


@settings(max_examples=15, deadline=None)
@given(discs, discs, st.floats(-3.2, 3.2))
def test_a_disc_keeps_between_what_inscribed_and_circumscribed_squares_leave(first, second, turn):
    x, y, r = second
    inner, outer = (x, y, r / math.sqrt(2), r / math.sqrt(2), turn), (x, y, r, r, turn)
    shares = [float(row_of([first, other]).common().kept_fraction) for other in (inner, second, outer)]
    assert shares[0] - 1e-12 <= shares[1] <= shares[2] + 1e-12
    assert float(row_of([first, (x, y, 1e3, 1e3, turn)]).common().lost_fraction) == 0


def test_a_thin_slit_keeps_its_chord():
    for width in (1e-2, 1e-4, 1e-6):
        area = float(row_of([(0.0, 0.0, 1.0), (0.3, 0.0, width / 2, 5.0, 0.0)]).common().area)
        assert area / width == pytest.approx(2 * math.sqrt(1 - 0.3**2), rel=width + 1e-9)


@settings(max_examples=15, deadline=None)
@given(st.lists(st.one_of(discs, rectangles), min_size=2, max_size=4))
def test_room_is_what_cuts(things):
    """Below 0 where some point of the first opening's rim lies outside another, by as much as it does."""
    row = row_of(things)
    rooms = row.rooms
    first = row.some([0]).outline(1e-3)
    for k, thing in enumerate(things[1:], 1):
        x, y, *size = thing
        if len(size) == 1:
            inward = size[0] - np.hypot(*(first - (x, y)).T)
        else:
            c, s = math.cos(size[2]), math.sin(size[2])
            u, v = (first - (x, y)) @ [c, s], (first - (x, y)) @ [-s, c]
            inward = np.minimum(size[0] - np.abs(u), size[1] - np.abs(v))
        assert rooms[k] == pytest.approx(inward.min(), abs=2e-6)


@settings(max_examples=12, deadline=None)
@given(st.lists(st.one_of(discs, rectangles), min_size=2, max_size=3).filter(lambda some: len(some[-1]) == 5))
def test_rows_outline_and_cells_have_the_area(things):
    row = row_of(things)
    area = float(row.common().area)
    rows = row.chords(48)
    assert float((rows.weight * (rows.right - rows.left)).sum()) == pytest.approx(area, abs=1e-9)
    points = row.outline(1e-3)
    x, y = points.T if len(points) else np.zeros((2, 1))
    assert (x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2 == pytest.approx(area, abs=2e-6)
    box = np.array([[-9.0, -9], [0.1, -9], [0.1, 9], [-9, 9]]), np.array([[0.1, -9], [9.0, -9], [9, 9], [0.1, 9]])
    assert sum(float(row.area_in(half)) for half in box) == pytest.approx(area, abs=1e-12)


@settings(max_examples=8, deadline=None)
@given(st.lists(st.one_of(discs, rectangles), min_size=1, max_size=3).filter(lambda some: len(some[0]) == 5))
def test_pixels_hold_what_polygons_leave(things):
    row = row_of(things)
    image = row.coverage([0.03, -0.02], pixel=0.11, size=(60, 60))
    assert image.sum() * 0.11**2 == pytest.approx(float(row.common().area), abs=1e-11)
    assert image.min() >= 0
    low = -0.11 * 30 - np.array([0.03, -0.02])
    for j, i in ((30, 30), (25, 33), (38, 28), (31, 24)):
        corner = low + 0.11 * np.array([i, j])
        cell = corner + 0.11 * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
        assert image[j, i] * 0.11**2 == pytest.approx(float(row.area_in(cell)), abs=1e-13)


def test_discs_alone_are_as_without_polygons():
    row = Openings.of_discs(np.array([[0.0, 0.0], [0.4, 0.3]]), np.array([1.0, 0.9]))
    assert row.area_in(np.array([[-9.0, -9], [9, -9], [9, 9], [-9, 9]])) == area_in_rectangle(
        row.centres, row.radii, [-9, -9], [9, 9]
    )
    assert float(row.common().area) == pytest.approx(by_rows([(0, 0, 1.0), (0.4, 0.3, 0.9)])[0], abs=1e-12)


def test_compiled_and_interpreted_agree():
    rng = np.random.default_rng(5)
    things = [[(0, 0, 1.0), (*rng.uniform(-0.5, 0.5, 2), *rng.uniform(0.3, 1.2, 3))] for _ in range(200)]
    rows = [row_of(some) for some in things]
    row = Openings(*(np.stack([getattr(one, name) for one in rows]) for name in ("centres", "radii", "corners")), (1,))
    _ = _ellipse_shapes.compiled
    many = row.common()
    for k in (0, 50, 199):
        area, middle, moments = by_rows(things[k])
        assert many.area[k] == pytest.approx(area, abs=1e-11)
        np.testing.assert_allclose(many.centroid[k], middle, atol=1e-10)
        np.testing.assert_allclose(many.second_moments[k], moments, atol=1e-10)
    strips = row.strips(32)
    np.testing.assert_allclose((strips.weight * (strips.right - strips.left)).sum(-1), many.area, atol=1e-8)


# The opening alone

openings = st.one_of(
    sizes.map(lambda radius: ClearAperture(radius)),
    st.builds(lambda a, b, turn: ClearAperture(math.inf, (a, b), turn), sizes, sizes, st.floats(-3.2, 3.2)),
)


@settings(max_examples=25, deadline=None)
@given(openings, st.floats(0, 2 * math.pi), st.floats(0, 1.6))
def test_an_opening_holds_its_own_rim(opening, angle, share):
    x, y = math.cos(angle), math.sin(angle)
    rim = opening.rim(x, y)
    assert opening.contains(0.999999 * rim[0], 0.999999 * rim[1])
    assert not opening.contains(1.000001 * rim[0], 1.000001 * rim[1])
    row, point = opening.row(), (share * rim[0], share * rim[1])
    assert bool(inside(row, 0, *point)) == bool(opening.contains(*point))
    outline = opening.outline(1e-3)
    assert float(opening.support(x, y)) == pytest.approx((outline @ [x, y]).max(), abs=2e-6)
    assert float(opening.reach) == pytest.approx(np.hypot(*outline.T).max(), abs=2e-6)
    # Points of the disc lie as evenly: shares of it, and its rim, are those of the opening.
    u, v = opening.places(share * x, share * y)
    assert bool(opening.contains(u, v)) == (share <= 1) or share == pytest.approx(1, abs=1e-9)
    along, across = opening.places(*opening.across(share))
    assert float(across) == pytest.approx(0, abs=1e-12)
    assert float(along) == pytest.approx(share * float(opening.rim(1.0, 0.0)[0]), abs=1e-12)


@settings(max_examples=12, deadline=None)
@given(openings)
def test_sums_over_an_opening(opening):
    """Area, transform and the rule of the fifth degree, against points that fill it evenly."""
    rows = row_of([(0, 0, float(opening.radius)) if opening.half is None else (0, 0, *opening.half, opening.turn)])
    part = rows.common()
    assert float(opening.area) == pytest.approx(float(part.area), rel=1e-12)
    points = np.array([[x, y] for x, y, _ in opening.rule], float)
    weights = np.array([weight for *_, weight in opening.rule])
    np.testing.assert_allclose(np.einsum("k,ki,kj->ij", weights, points, points)[[0, 0, 1], [0, 1, 1]],
                               part.second_moments, atol=1e-12)  # fmt: skip
    strips = rows.chords(64)
    fx, fy = 0.31, -0.47
    half = (strips.right - strips.left) / 2
    wave = (
        2
        * half
        * np.sinc(2 * fx * half)
        * np.cos(2 * math.pi * (fx * (strips.left + strips.right) / 2 + fy * strips.height))
    )
    assert float(opening.spectrum(np.array(fx), np.array(fy))) == pytest.approx(
        float((wave * strips.weight).sum()), abs=1e-9
    )
    shift = 0.2
    pair = rows.beside(rows.moved(np.array([shift * 0.6, shift * 0.8]))).common()
    assert float(opening.overlap(np.array(shift), 0.6, 0.8)) == pytest.approx(float(pair.kept_fraction), abs=1e-12)


def test_polygons_of_more_and_of_fewer_corners_are_followed_together():
    """A hexagon in front of a rectangle and of a disc, and the other way round: areas, rooms, rows across."""
    turn = 0.2 + np.arange(6) * math.pi / 3
    hexagon = np.stack([np.cos(turn), np.sin(turn)], -1) + np.array([0.1, -0.2])
    box = rectangle(0.3, 0.1, 0.9, 0.5, 0.4)

    def alone(corners):
        return Openings(corners.mean(0)[None], np.array([math.inf]), corners[None], (0,))

    disc = Openings.of_discs(np.array([[0.0, 0.0]]), np.array([9.0]))
    for one, other in ((hexagon, box), (box, hexagon)):
        both = alone(one).beside(alone(other)).beside(disc)
        area, centroid, _ = shoelace(clipped(list(one), other))
        part = both.common()
        assert float(part.area) == pytest.approx(area, rel=TOLERANCE)
        np.testing.assert_allclose(part.centroid, centroid, rtol=0, atol=TOLERANCE)
        assert float(part.kept_fraction) == pytest.approx(area / shoelace(one)[0], rel=TOLERANCE)
        rows = both.chords(40)
        assert rows.weight @ (rows.right - rows.left) == pytest.approx(area, rel=TOLERANCE)
        assert float(both.area_in(rectangle(0, 0, 9, 9, 0))) == pytest.approx(area, rel=TOLERANCE)
        inward = [
            ((b - a)[0] * (p - a)[1] - (b - a)[1] * (p - a)[0]) / math.hypot(*(b - a))
            for a, b in zip(other, np.roll(other, -1, 0), strict=True)
            for p in one
        ]
        assert both.rooms[1] == pytest.approx(min(inward), rel=1e-12)
        assert both.rooms[2] == pytest.approx(9 - np.hypot(*one.T).max(), rel=1e-12)
        assert both.off_rim(1, other.mean(0)[None])[0] == pytest.approx(alone(other).off_rim(0, other.mean(0)[None])[0])
