"""Openings of stops side by side on one plane, as one microlens sees them: convex regions of arcs and straight edges.

Discs alone keep their own forms (`discs`), which lose no digit; with straight edges among them the common part is
followed piece by piece along its boundary (`pieces`, `ellipses`). Leaning discs are ellipses.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._arrays import Array, ratio
from ..bore.opening import ClearAperture
from .coverage import Image, coverage_image
from .discs import Chords, DiscIntersection, chords, heights, intersect, rows_between
from .ellipses import intersect_ellipses
from .pieces import ARC, EDGE, PIECE, area_inside, boundary, break_heights, most_pieces

INTERPRETED_BELOW = 64
"""Common parts up to which compiling, or even loading compiled code, takes longer than it saves."""
LEAST_ROWS = 12
"""Gauss-Legendre rows between two heights at which a side bends, at least."""
NEAR, AWAY = 48, 16
"""Sides of the polygons that stand for ellipses where pixels are covered: where they may cut the first opening, and
elsewhere. They take no more than they leave, and lie within 5e-4 of that opening's width of the ellipse."""
TRIALS, CLOSER, ROUNDS = 64, 0.55, 32
"""Directions tried at first; share of their step that each further trial of three has; how many of those."""
ROUNDING = 1e-9
"""Share of a half width that is no room."""
LEVELS, FINE = 6, 64
"""Times that a height is closed in on, and steps of each."""


class Openings(NamedTuple):
    """K openings, the first of them the FAP's; leading axes (...) are those of microlenses and builds."""

    centres: Array
    """Their centres [mm], shape (..., K, 2)."""
    radii: Array
    """Radii of discs [mm], inf of polygons and ellipses, shape (..., K)."""
    corners: Array
    """Corners of polygons [mm], counterclockwise, shape (..., P, M, 2); of fewer than M the last one is repeated."""
    polygons: tuple[int, ...] = ()
    """Which are polygons."""
    forms: Array | None = None
    """Matrices (xx, xy, yy) of ellipses, S of `ellipses.intersect_ellipses` [mm^2], shape (..., E, 3); None of none."""
    ellipses: tuple[int, ...] = ()
    """Which are ellipses; not the first."""

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
        return bool((self.least_rooms[..., 1:] >= 0).all())

    def contain(self, points: Array) -> NDArray[np.bool_]:
        """True for points (N, 2) that lie in all of one row of them, or on a rim but for rounding."""
        some, slack = self.discs, 1 + 1e-12
        off = np.hypot(*(points[:, None] - self.centres[some]).transpose(2, 0, 1))
        held = (off <= self.radii[some] * slack).all(1)
        for polygon in self.corners:
            for (x, y), (dx, dy) in zip(polygon, np.roll(polygon, -1, 0) - polygon, strict=True):
                held &= dx * (points[:, 1] - y) - dy * (points[:, 0] - x) >= -1e-12 * (dx * dx + dy * dy)
        for k, (xx, xy, yy) in zip(self.ellipses, self.matrices, strict=True):
            x, y = (points - self.centres[k]).T
            held &= yy * x * x - 2 * xy * x * y + xx * y * y <= (xx * yy - xy * xy) * slack
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
    def matrices(self) -> Array:
        """Matrices of ellipses, of none as well (..., 0, 3)."""
        return np.empty((*self.radii.shape[:-1], 0, 3)) if self.forms is None else self.forms

    @property
    def discs(self) -> list[int]:
        """Which are discs."""
        return [k for k in range(self.total) if k not in self.polygons and k not in self.ellipses]

    def at(
        self, index: int | NDArray[np.bool_] | NDArray[np.intp] | tuple[slice | int | NDArray[np.intp], ...]
    ) -> Openings:
        """Openings of some microlenses."""
        centres, radii, corners, forms = (
            part[index] for part in (self.centres, self.radii, self.corners, self.matrices)
        )
        return Openings(centres, radii, corners, self.polygons, forms, self.ellipses)

    def some(self, order: Sequence[int]) -> Openings:
        """Some of the K, in another order."""
        rows, leaning = ([kind.index(k) for k in order if k in kind] for kind in (self.polygons, self.ellipses))
        straight, bent = (tuple(n for n, k in enumerate(order) if k in kind) for kind in (self.polygons, self.ellipses))
        few, corners, forms = list(order), self.corners[..., rows, :, :], self.matrices[..., leaning, :]
        return Openings(self.centres[..., few, :], self.radii[..., few], corners, straight, forms, bent)

    def moved(self, by: Array) -> Openings:
        """Moved by (..., 2) [mm]."""
        return self._replace(centres=self.centres + by[..., None, :], corners=self.corners + by[..., None, None, :])

    def overlap(self, by: Array) -> Array:
        """Share of their common part that is left of its overlap with itself, moved by (..., 2) [mm]."""
        return ratio(self.moved(-by / 2).beside(self.moved(by / 2)).common().area, self.common().area)

    def beside(self, other: Openings) -> Openings:
        """These and others, which follow them."""
        return Openings(
            np.concatenate([self.centres, other.centres], -2),
            np.concatenate([self.radii, other.radii], -1),
            _more_corners(self.corners, other.corners),
            self.polygons + tuple(self.total + k for k in other.polygons),
            np.concatenate([self.matrices, other.matrices], -2),
            self.ellipses + tuple(self.total + k for k in other.ellipses),
        )

    @property
    def rooms(self) -> Array:
        """Room that each leaves around the first, shape (..., K) [mm]: below 0 where it cuts it."""
        return self._rooms(self._room_in_ellipse)

    @property
    def least_rooms(self) -> Array:
        """Room that each leaves at least, shape (..., K) [mm]: below 0 where `rooms` are, sooner."""
        return self._rooms(self._least_room_in_ellipse)

    def _rooms(self, in_ellipse: Callable[[int, Array], Array]) -> Array:
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
        for n, k in enumerate(self.ellipses):
            room[..., k] = in_ellipse(n, self.centres[..., k, :] - first[..., 0, :])
        return np.asarray(room)

    def _least_room_in_ellipse(self, number: int, off: Array) -> Array:
        """Room that an ellipse leaves at least: by its least half width where that is enough, else its own."""
        xx, xy, yy = np.moveaxis(self.matrices[..., number, :], -1, 0)
        narrow = np.sqrt(np.maximum((xx + yy - np.hypot(xx - yy, 2 * xy)) / 2, 0.0))
        least = narrow - np.hypot(off[..., 0], off[..., 1]) - self.spans[..., 0] / 2
        if (tight := ~(least > ROUNDING * narrow)).any():
            few = self.at(tight)
            least[tight] = few._room_in_ellipse(number, off[tight])
        return np.asarray(least)

    def _room_in_ellipse(self, number: int, off: Array) -> Array:
        """Room that an ellipse leaves around the first, whose centre lies `-off` from its own: least of all ways."""
        (xx, xy, yy), (x, y) = (np.moveaxis(part[..., None], -2, 0) for part in (self.matrices[..., number, :], off))
        own = None
        if 0 in self.polygons:
            own = self.corners[..., self.polygons.index(0), :, :] - self.centres[..., :1, :]

        def room(turn: Array) -> Array:
            c, s = np.cos(turn), np.sin(turn)
            reach = c * x + s * y + np.sqrt(c * c * xx + 2 * c * s * xy + s * s * yy)
            if own is None:
                return np.asarray(reach - self.radii[..., :1])
            return np.asarray(reach - (own[..., :1] * c[..., None, :] + own[..., 1:] * s[..., None, :]).max(-2))

        return _least_of_a_turn(room, off.shape[:-1])

    @property
    def spans(self) -> Array:
        """Diameter of the circle about each one's centre that holds it [mm], shape (..., K)."""
        spans = 2 * self.radii
        for n, k in enumerate(self.polygons):
            off = self.corners[..., n, :, :] - self.centres[..., k, None, :]
            spans[..., k] = 2 * np.hypot(off[..., 0], off[..., 1]).max(-1)
        for n, k in enumerate(self.ellipses):
            xx, xy, yy = np.moveaxis(self.matrices[..., n, :], -1, 0)
            spans[..., k] = 2 * np.sqrt((xx + yy + np.hypot(xx - yy, 2 * xy)) / 2)
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
        if not self.polygons and not self.ellipses:
            return intersect(self.centres, self.radii)
        order, part = [*self._conics[0], *self.polygons], self._within(self.corners)
        clips = np.empty_like(part.clipping)
        clips[..., order] = part.clipping
        return part._replace(clipping=clips)

    @property
    def _conics(self) -> tuple[list[int], Array]:
        """Discs, then ellipses, and the matrices of both (..., K - P, 3)."""
        square = np.square(self.radii[..., self.discs])
        matrices = np.stack([square, np.zeros_like(square), square], -1)
        return [*self.discs, *self.ellipses], np.concatenate([matrices, self.matrices], -2)

    def _within(self, corners: Array) -> DiscIntersection:
        """Common part of discs, ellipses and such polygons; `clipping` in that order."""
        order, matrices = self._conics
        # About the first one's centre, where the digits are.
        first = self.centres[..., :1, :]
        part = intersect_ellipses(
            self.centres[..., order, :] - first, matrices, corners - first[..., None, :],
            [*order, *self.polygons].index(0),
        )  # fmt: skip
        return part._replace(centroid=part.centroid + first[..., 0, :])

    def area_in(self, polygon: Array) -> Array:
        """Area of their common part in a convex polygon (M, 2), counterclockwise [mm^2]; leading axes as theirs."""
        lead, round_ones = self.radii.shape[:-1], self.discs
        if self.ellipses:
            return self._within(_more_corners(self.corners, np.broadcast_to(polygon, (*lead, 1, *polygon.shape)))).area
        centres, radii = self.centres[..., round_ones, :], self.radii[..., round_ones]
        areas = [area_inside(centres[at], radii[at], [*self.corners[at], polygon]) for at in np.ndindex(lead)]
        return np.array(areas).reshape(lead)

    def coverage(self, axes: ArrayLike, **keywords: Any) -> Image:
        """Share of each pixel that they cover, relative to microlens axes [mm]; the rest as of `coverage_image`."""
        some, corners = self.discs, self.corners
        if self.ellipses:
            corners = _more_corners(corners, self._sides_of_ellipses())
        return coverage_image(axes, self.centres[..., some, :], self.radii[..., some], corners=corners, **keywords)

    def _sides_of_ellipses(self) -> Array:
        """Corners of polygons in place of the ellipses (..., E, NEAR + AWAY, 2), most near the first opening."""
        some = list(self.ellipses)
        xx, xy, yy = np.moveaxis(self.matrices, -1, 0)
        wide = np.sqrt(xx)
        high = np.sqrt(yy - xy * xy / xx)
        u, v = np.moveaxis(self.centres[..., :1, :] - self.centres[..., some, :], -1, 0)
        u = u / wide  # where the ellipse is the unit circle
        v = (v - xy / wide * u) / high
        narrow = wide * high / np.sqrt((xx + yy + np.hypot(xx - yy, 2 * xy)) / 2)  # the lesser half axis
        away, reach = np.hypot(u, v), self.spans[..., :1] / (2 * narrow)
        least = (1 + away * away - reach * reach) / np.maximum(2 * away, 1e-300)
        most = math.pi * (NEAR - 1) / (NEAR + AWAY)  # all steps are alike there
        half = np.clip(np.arccos(np.clip(least, -1.0, 1.0)), 1e-3, most)[..., None]
        close, wide_apart = 2 * half / (NEAR - 1), 2 * (math.pi - half) / (AWAY + 1)
        turn = (
            np.concatenate([close * np.arange(NEAR) - half, half + wide_apart * np.arange(1, AWAY + 1)], -1)
            + np.arctan2(v, u)[..., None]
        )
        step = np.where(np.arange(NEAR + AWAY) < NEAR, close, wide_apart)
        size = np.sqrt(step / np.sin(step))
        x, y = size * np.cos(turn), size * np.sin(turn)
        corners = np.stack([wide[..., None] * x, (xy / wide)[..., None] * x + high[..., None] * y], -1)
        return np.asarray(self.centres[..., some, None, :] + corners)

    def outline(self, step: float = math.pi / 90) -> Array:
        """Points along the boundary of one common part, for drawing: shape (N, 2) [mm], counterclockwise, not closed.

        `step` is the largest angle between neighbouring points of an arc [rad].
        """
        if self.ellipses:
            return self._around(math.ceil(2 * math.pi / step))
        discs, edges, pieces = boundary(self.centres[self.discs], self.radii[self.discs], self.corners)
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

    def _around(self, count: int) -> Array:
        """Points of one boundary in directions from its middle, and where one opening's rim follows another's."""
        part = self.common()
        if not part.lit:
            return np.empty((0, 2))
        ways: Array = np.arange(count + 1, dtype=float) * (2 * math.pi / count)
        reach = self._reach(part.centroid, ways)
        owner = reach.argmin(0)
        change = np.flatnonzero(owner[1:] != owner[:-1])
        low, high = ways[change], ways[change + 1]
        row = np.arange(change.size)
        for _ in range(50):
            middle = (low + high) / 2
            there = self._reach(part.centroid, middle)
            before = there[owner[change], row] <= there[owner[change + 1], row]
            low, high = np.where(before, middle, low), np.where(before, high, middle)
        ways = np.sort(np.append(ways[:-1], low))
        far = self._reach(part.centroid, ways).min(0)
        return np.asarray(part.centroid + far[:, None] * np.stack([np.cos(ways), np.sin(ways)], -1))

    def _reach(self, point: Array, ways: Array) -> Array:
        """Way from a point inside to each rim, edge by edge, in directions (N,) [rad]: shape (R, N) [mm]."""
        x, y = np.cos(ways), np.sin(ways)
        order, matrices = self._conics
        rows = []
        for (u, v), (xx, xy, yy) in zip(point - self.centres[order], matrices, strict=True):
            a = yy * x * x - 2 * xy * x * y + xx * y * y
            b = yy * u * x - xy * (u * y + v * x) + xx * v * y
            e = yy * u * u - 2 * xy * u * v + xx * v * v - (xx * yy - xy * xy)
            rows.append((np.sqrt(np.maximum(b * b - a * e, 0.0)) - b) / a)
        for polygon in self.corners:
            for (u, v), (dx, dy) in zip(polygon, np.roll(polygon, -1, 0) - polygon, strict=True):
                outward, room = dy * x - dx * y, dx * (point[1] - v) - dy * (point[0] - u)
                rows.append(np.where(outward > 0, room / np.where(outward > 0, outward, 1.0), np.inf))
        return np.array(rows)

    def chords(self, rows: int) -> Chords:
        """Gauss-Legendre rows across one common part, as `discs.chords`: between heights at which sides bend."""
        if not self.polygons and not self.ellipses:
            return chords(self.centres, self.radii, rows)
        lead = self._replace(
            centres=self.centres[None], radii=self.radii[None], corners=self.corners[None], forms=self.matrices[None]
        )
        return Chords(*(part[0] for part in lead.strips(rows)))

    def strips(self, rows: int) -> Chords:
        """Rows across each common part (N, ...), at least `rows` in its height: of width 0 where it is empty."""
        if self.ellipses:
            y, weight = heights(*self._height(), rows)
            left, right = self._ends(y)
            return Chords(y, weight, left, np.maximum(left, right))
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

    def _height(self) -> tuple[Array, Array]:
        """Lowest and highest place of each common part (N,), in steps that close in on them."""
        order, matrices = self._conics
        middle, half = self.centres[:, order, 1], np.sqrt(matrices[..., 2])
        flat = self.corners[..., 1]
        low = np.concatenate([middle - half, flat.min(-1)], -1).max(-1)
        high = np.maximum(np.concatenate([middle + half, flat.max(-1)], -1).min(-1), low)
        widest, step, row = (low + high) / 2, (high - low) / FINE, np.arange(len(low))
        steps = np.arange(-FINE // 2, FINE // 2 + 1)
        for _ in range(LEVELS):  # widths rise to one place and fall from there
            places = np.clip(widest[:, None] + step[:, None] * steps, low[:, None], high[:, None])
            left, right = self._ends(places)
            widest, step = places[row, (right - left).argmax(-1)], step * (2.0 / FINE)
        ends = []
        for far in (low, high):
            near = widest
            for _ in range(LEVELS):
                places = near[:, None] + (far - near)[:, None] * (np.arange(FINE + 1) / FINE)
                left, right = self._ends(places)
                last = (right > left).cumprod(-1).sum(-1) - 1
                near, far = places[row, last.clip(0)], places[row, np.minimum(last + 1, FINE).clip(0)]
            ends.append(near)
        return ends[0], ends[1]

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
        for n, k in enumerate(self.ellipses):
            xx, xy, yy = (part[:, None] for part in self.matrices[:, n].T)
            off = y - self.centres[:, k, 1, None]
            middle = self.centres[:, k, 0, None] + xy / yy * off
            reach = np.sqrt((xx * yy - xy * xy) * np.maximum(yy - off * off, 0.0)) / yy
            left, right = np.maximum(left, middle - reach), np.minimum(right, middle + reach)
        ways = np.roll(self.corners, -1, -2) - self.corners
        for n in range(self.corners.shape[1]):
            for e in range(self.corners.shape[2]):
                (x0, y0), (dx, dy) = self.corners[:, n, e].T, ways[:, n, e].T
                slope = np.divide(dx, dy, out=np.zeros_like(dx), where=dy != 0)
                x = x0[:, None] + (y - y0[:, None]) * slope[:, None]
                right = np.where(dy[:, None] > 0, np.minimum(right, x), right)
                left = np.where(dy[:, None] < 0, np.maximum(left, x), left)
        return left, right


def _least_of_a_turn(value: Callable[[Array], Array], lead: tuple[int, ...]) -> Array:
    """Least value of a smooth function of a direction (..., N), of each row of it."""
    at, step = np.zeros((*lead, 1)), 2 * math.pi / TRIALS
    offsets = np.arange(TRIALS) * step
    for _ in range(ROUNDS):
        values = value(at + offsets)
        best = values.argmin(-1)[..., None]
        at, step = at + offsets[best], step * CLOSER
        offsets = step * np.array([-1.0, 0.0, 1.0])
    return np.asarray(values.min(-1))


def _inward(corners: Array, points: Array) -> Array:
    """How far points (..., N, 2) lie inwards of the sides of polygons (..., M, 2), (..., N, M); inf of no side."""
    way = np.roll(corners, -1, -2) - corners
    length = np.hypot(way[..., :1], way[..., 1:])
    way = (way / np.where(length == 0, 1.0, length))[..., None, :, :]
    off = points[..., None, :] - corners[..., None, :, :]
    inward = way[..., 0] * off[..., 1] - way[..., 1] * off[..., 0]
    return np.where(length[..., None, :, 0] == 0, np.inf, inward)


def _more_corners(one: Array, other: Array) -> Array:
    """Polygons (..., P, M, 2) side by side: of fewer corners, the last repeated."""
    most = max(one.shape[-2], other.shape[-2])
    padded = [np.concatenate([p, np.repeat(p[..., -1:, :], most - p.shape[-2], -2)], -2) for p in (one, other)]
    return np.concatenate(padded, -3)
