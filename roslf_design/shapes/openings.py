"""Openings of stops side by side on one plane, as one microlens sees them: convex regions of arcs and straight edges.

Discs alone keep their own forms (`discs`), which lose no digit; with straight edges among them the common part is
followed piece by piece along its boundary (`pieces`, `ellipses`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._arrays import Array
from ..bore.opening import ClearAperture
from .cells import area_inside
from .coverage import Image, coverage_image
from .discs import Chords, DiscIntersection, chords, heights, intersect, outline, rows_between
from .ellipses import intersect_ellipses
from .pieces import ARC, EDGE, PIECE, bound, break_heights, lay_edges, most_pieces

INTERPRETED_BELOW = 64
"""Common parts up to which compiling, or even loading compiled code, takes longer than it saves."""
LEAST_ROWS = 12
"""Gauss-Legendre rows between two heights at which a side bends, at least."""


class Openings(NamedTuple):
    """K openings, the first of them the FAP's; leading axes (...) are those of microlenses and builds."""

    centres: Array
    """Their centres [mm], shape (..., K, 2)."""
    radii: Array
    """Radii of discs [mm], inf of polygons, shape (..., K)."""
    corners: Array
    """Corners of polygons [mm], counterclockwise, shape (..., P, M, 2); of fewer than M the last one is repeated."""
    polygons: tuple[int, ...] = ()
    """Which are polygons."""

    @classmethod
    def of_discs(cls, centres: Array, radii: Array) -> Openings:
        """Discs, centres (..., K, 2) and radii (..., K) [mm]."""
        return cls(centres, radii, np.empty((*radii.shape[:-1], 0, 4, 2)))

    @classmethod
    def of(cls, opening: ClearAperture, shape: tuple[int, ...]) -> Openings:
        """One opening about the origin, its numbers broadcast to a shape."""
        radii = np.broadcast_to(np.asarray(opening.radius, float), shape)[..., None]
        corners = np.empty((*shape, 1 if opening.straight else 0, len(opening.corners) or 4, 2))
        for m, corner in enumerate(opening.corners):
            corners[..., 0, m, 0], corners[..., 0, m, 1] = corner
        return cls(np.zeros((*shape, 1, 2)), radii, corners, (0,) if opening.straight else ())

    @property
    def unclipped(self) -> bool:
        """Whether the first lies inside all others, everywhere."""
        return bool((self.rooms[..., 1:] >= 0).all())

    def contain(self, points: Array) -> NDArray[np.bool_]:
        """True for points (N, 2) that lie in all of one row of them, or on a rim but for rounding."""
        some, slack = self.discs, 1 + 1e-12
        off = np.hypot(*(points[:, None] - self.centres[some]).transpose(2, 0, 1))
        held = (off <= self.radii[some] * slack).all(1)
        for polygon in self.corners:
            for (x, y), (dx, dy) in zip(polygon, np.roll(polygon, -1, 0) - polygon, strict=True):
                held &= dx * (points[:, 1] - y) - dy * (points[:, 0] - x) >= -1e-12 * (dx * dx + dy * dy)
        return np.asarray(held)

    def off_rim(self, k: int, points: Array) -> Array:
        """Distances of points (..., N, 2) from the rim of one, whose sides go on beyond their corners."""
        if k not in self.polygons:
            off = points - self.centres[..., k, None, :]
            return np.abs(np.hypot(off[..., 0], off[..., 1]) - self.radii[..., k, None])
        corners = self.corners[..., self.polygons.index(k), :, :]
        return np.asarray(np.abs(_inward(corners, points)).min(-1))

    @property
    def first_is_disc(self) -> bool:
        """Whether the first is a disc."""
        return 0 not in self.polygons

    @property
    def total(self) -> int:
        """K."""
        return int(self.radii.shape[-1])

    @property
    def discs(self) -> list[int]:
        """Which are discs."""
        return [k for k in range(self.total) if k not in self.polygons]

    def at(self, index: int | NDArray[np.bool_] | NDArray[np.intp] | tuple[slice | int, ...]) -> Openings:
        """Openings of some microlenses."""
        return self._replace(centres=self.centres[index], radii=self.radii[index], corners=self.corners[index])

    def some(self, order: Sequence[int]) -> Openings:
        """Some of the K, in another order."""
        rows = [self.polygons.index(k) for k in order if k in self.polygons]
        straight = tuple(n for n, k in enumerate(order) if k in self.polygons)
        few = list(order)
        return Openings(self.centres[..., few, :], self.radii[..., few], self.corners[..., rows, :, :], straight)

    def moved(self, by: Array) -> Openings:
        """Moved by (..., 2) [mm]."""
        return self._replace(centres=self.centres + by[..., None, :], corners=self.corners + by[..., None, None, :])

    def beside(self, other: Openings) -> Openings:
        """These and others, which follow them."""
        return Openings(
            np.concatenate([self.centres, other.centres], -2),
            np.concatenate([self.radii, other.radii], -1),
            np.concatenate([_filled(self.corners, other), _filled(other.corners, self)], -3),
            self.polygons + tuple(self.total + k for k in other.polygons),
        )

    @property
    def rooms(self) -> Array:
        """Room that each leaves around the first, shape (..., K) [mm]: below 0 where it cuts it."""
        first = self.centres[..., :1, :]
        if 0 in self.polygons:
            own = self.corners[..., self.polygons.index(0), :, :]
            off = own[..., None, :, :] - self.centres[..., :, None, :]
            room = self.radii - np.hypot(off[..., 0], off[..., 1]).max(-1)
        else:
            apart = np.hypot(*np.moveaxis(self.centres - first, -1, 0))
            room = self.radii - (apart + self.radii[..., :1])
            own = first
        for n, k in enumerate(self.polygons):
            inward = _inward(self.corners[..., n, :, :], own)
            reach = 0.0 if 0 in self.polygons else self.radii[..., 0]
            room[..., k] = inward.min((-2, -1)) - reach
        return np.asarray(room)

    @property
    def spans(self) -> Array:
        """Diameter of the circle about each one's centre that holds it [mm], shape (..., K)."""
        spans = 2 * self.radii
        for n, k in enumerate(self.polygons):
            off = self.corners[..., n, :, :] - self.centres[..., k, None, :]
            spans[..., k] = 2 * np.hypot(off[..., 0], off[..., 1]).max(-1)
        return np.asarray(spans)

    @property
    def area(self) -> Array:
        """Area of the first [mm^2], shape (...)."""
        if 0 not in self.polygons:
            return math.pi * self.radii[..., 0] ** 2
        x, y = np.moveaxis(self.corners[..., self.polygons.index(0), :, :] - self.centres[..., :1, :], -1, 0)
        return np.asarray(np.sum(x * np.roll(y, -1, -1) - y * np.roll(x, -1, -1), -1) / 2)

    def common(self) -> DiscIntersection:
        """Their common part, against the first one whole; the last axis of `clipping` is K."""
        if not self.polygons:
            return intersect(self.centres, self.radii)
        round_ones = self.discs
        radius = self.radii[..., round_ones]
        square = radius * radius
        matrices = np.stack([square, np.zeros_like(square), square], -1)
        order = [*round_ones, *self.polygons]
        # About the first one's centre, where the digits are.
        first = self.centres[..., :1, :]
        part = intersect_ellipses(
            self.centres[..., round_ones, :] - first, matrices, self.corners - first[..., None, :], order.index(0)
        )
        clips = np.empty_like(part.clipping)
        clips[..., order] = part.clipping
        return part._replace(centroid=part.centroid + first[..., 0, :], clipping=clips)

    def area_in(self, polygon: Array) -> Array:
        """Area of their common part in a convex polygon (M, 2), counterclockwise [mm^2]; leading axes as theirs."""
        lead, round_ones = self.radii.shape[:-1], self.discs
        centres, radii = self.centres[..., round_ones, :], self.radii[..., round_ones]
        areas = [area_inside(centres[at], radii[at], [*self.corners[at], polygon]) for at in np.ndindex(lead)]
        return np.array(areas).reshape(lead)

    def coverage(self, axes: ArrayLike, **keywords: Any) -> Image:
        """Share of each pixel that they cover, relative to microlens axes [mm]; the rest as of `coverage_image`."""
        some = self.discs
        return coverage_image(axes, self.centres[..., some, :], self.radii[..., some], corners=self.corners, **keywords)

    def outline(self, step: float = math.pi / 90) -> Array:
        """Points along the boundary of one common part, as `discs.outline`."""
        if not self.polygons:
            return outline(self.centres, self.radii, step)
        discs, edges, pieces = self._boundary()
        lines: list[tuple[float, Array]] = []
        for kind, index, start, end in pieces:
            if kind == ARC:
                x, y, r = discs[int(index), :3]
                angles = np.linspace(start, end, math.ceil((end - start) / step) + 1)[:-1]
                lines.append((start, np.stack([x + r * np.cos(angles), y + r * np.sin(angles)], -1)))
            else:
                x, y, dx, dy = edges[int(index), :4]
                lines.append((math.atan2(-dx, dy), np.array([[x + start * dx, y + start * dy]])))
        lines.sort(key=lambda line: line[0] % (2 * math.pi))  # outward normals turn one way only
        return np.concatenate([np.empty((0, 2)), *(points for _, points in lines)])

    def _boundary(self) -> tuple[Array, Array, list[list[float]]]:
        """Discs, edges and pieces of one boundary (`pieces.bound`)."""
        round_ones, most = self.discs, self.corners.shape[-3] * self.corners.shape[-2]
        k = len(round_ones)
        discs = np.column_stack([self.centres[round_ones], self.radii[round_ones], np.empty(k)])
        edges, pieces = np.empty((most, EDGE)), np.empty((most_pieces(k, most), PIECE))
        sides = 0
        for number, polygon in enumerate(self.corners):
            sides = lay_edges.interpreted(polygon, number, edges, sides)
        work = np.empty((k + 2 * most + 3, 2))
        count = bound.interpreted(discs, np.empty((k * k, 5)), edges, sides, work, pieces)
        return discs, edges, pieces[:count].tolist()

    def chords(self, rows: int) -> Chords:
        """Gauss-Legendre rows across one common part, as `discs.chords`: between heights at which sides bend."""
        if not self.polygons:
            return chords(self.centres, self.radii, rows)
        lead = Openings(self.centres[None], self.radii[None], self.corners[None], self.polygons)
        return Chords(*(part[0] for part in lead.strips(rows)))

    def strips(self, rows: int) -> Chords:
        """Rows across each common part (N, ...), at least `rows` in its height: of width 0 where it is empty."""
        if not self.polygons:
            bottoms, tops = (self.centres[..., 1] + sign * self.radii for sign in (-1, 1))
            return rows_between(self.centres, self.radii, bottoms.max(-1), tops.min(-1), rows)
        bends = self._bends()
        low, high = bends[:, :-1], bends[:, 1:]
        # Where several heights are all but one, none is between; the others share the rows by their heights.
        tall = (high - low) / np.maximum(np.ptp(bends, axis=1), 1e-300)[:, None]
        apart = np.flatnonzero((tall > 1e-14).any(0))
        if not apart.size:
            apart = np.arange(1)
        parts = [heights(low[:, k], high[:, k], LEAST_ROWS + math.ceil(rows * float(tall[:, k].max()))) for k in apart]
        y, weight = (np.concatenate(values, -1) for values in zip(*parts, strict=True))
        left, right = self._ends(y)
        return Chords(y, weight, left, np.maximum(left, right))

    def _bends(self) -> Array:
        """Heights at which the sides of each common part bend, (N, B)."""
        round_ones, (n, p, corners, _) = self.discs, self.corners.shape
        k, most = len(round_ones), p * corners
        pieces = np.empty((most_pieces(k, most), PIECE))
        out = np.empty((n, 4 * len(pieces)))
        run = break_heights.interpreted if n < INTERPRETED_BELOW and not break_heights.ready else break_heights.compiled
        centres, radii, polygons = (
            np.ascontiguousarray(v)
            for v in (self.centres[..., round_ones, :], self.radii[..., round_ones], self.corners)
        )
        run(centres, radii, polygons, np.empty((most, EDGE)), pieces, np.empty((k + 2 * most + 3, 2)), out)
        used = int(np.flatnonzero(np.any(out[:, 1:] > out[:, :-1], axis=0)).max(initial=0)) + 2
        return out[:, :used]

    def _ends(self, y: Array) -> tuple[Array, Array]:
        """Where rows (N, R) begin and end along x within all of them."""
        left, right = np.full(y.shape, -np.inf), np.full(y.shape, np.inf)
        for k in self.discs:
            off, r = y - self.centres[:, k, 1, None], self.radii[:, k, None]
            reach = np.sqrt(np.maximum((r - off) * (r + off), 0.0))
            left = np.maximum(left, self.centres[:, k, 0, None] - reach)
            right = np.minimum(right, self.centres[:, k, 0, None] + reach)
        ways = np.roll(self.corners, -1, -2) - self.corners
        for n in range(self.corners.shape[1]):
            for e in range(self.corners.shape[2]):
                (x0, y0), (dx, dy) = self.corners[:, n, e].T, ways[:, n, e].T
                slope = np.divide(dx, dy, out=np.zeros_like(dx), where=dy != 0)
                x = x0[:, None] + (y - y0[:, None]) * slope[:, None]
                right = np.where(dy[:, None] > 0, np.minimum(right, x), right)
                left = np.where(dy[:, None] < 0, np.maximum(left, x), left)
        return left, right


def _filled(corners: Array, other: Openings) -> Array:
    """Corners (..., P, M, 2) with the last repeated where others have more."""
    missing = max(other.corners.shape[-2] - corners.shape[-2], 0)
    return np.concatenate([corners, np.repeat(corners[..., -1:, :], missing, -2)], -2)


def _inward(corners: Array, points: Array) -> Array:
    """How far points (..., N, 2) lie inwards of the sides of polygons (..., M, 2), (..., N, M); inf of no side."""
    way = np.roll(corners, -1, -2) - corners
    length = np.hypot(way[..., :1], way[..., 1:])
    way = (way / np.where(length == 0, 1.0, length))[..., None, :, :]
    off = points[..., None, :] - corners[..., None, :, :]
    inward = way[..., 0] * off[..., 1] - way[..., 1] * off[..., 0]
    return np.where(length[..., None, :, 0] == 0, np.inf, inward)
