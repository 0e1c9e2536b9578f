"""Views of real light fields: what they differ by, and how far depths in them repeat.

Each function takes the folder of the data, which lie beside the project and are no part of it; `published.py` makes the
page.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from roslf_design.calibration.centres import find_centres
from roslf_design.calibration.corners import observe_pictures
from roslf_design.calibration.decoding import LightField
from roslf_design.calibration.epilines import fit_lines
from roslf_design.calibration.fit import _step_one
from roslf_design.calibration.frames import grey_frame, read_image
from roslf_design.calibration.model import Board, project_boards, rotation_matrix
from roslf_design.depth.captured import QUIET, disagreement, measured_noise, measured_with_noise, scaled, searched
from roslf_design.depth.estimate import DisparityMap, PixelNoise, estimate_disparity
from roslf_design.depth.geometry import GridGeometry
from roslf_design.depth.view_files import read_views
from roslf_design.depth.view_order import in_order

Floats = NDArray[np.float64]
EVEN, ODD, ALL = slice(0, None, 2), slice(1, None, 2), slice(None)
FIRST, SECOND = slice(0, 5), slice(5, 10)
TRIED, ROOM, CLOSE, ROUNDS = 0.1, 1.35, 0.03, 5
"""Mismatch that errors are first computed for, and how many times the one fitted it is to be, to within how much, in so
many tries: with less, errors are widened by what views say, with much more depths are smoothed."""
WITHIN = 0.6827
"""Share of errors within one standard error."""
GAMMA = 2.2
"""Exponent by which 8-bit brightness is made linear, about."""


class Halves(NamedTuple):
    """Two sets of views without a common one, by their rows and columns."""

    words: str
    first: tuple[slice, slice]
    second: tuple[slice, slice]


SETS = (
    Halves("even and odd columns", (ALL, EVEN), (ALL, ODD)),
    Halves("even and odd rows", (EVEN, ALL), (ODD, ALL)),
    Halves("every fourth view, along a diagonal", (EVEN, EVEN), (ODD, ODD)),
    Halves("every fourth view, along the other", (EVEN, ODD), (ODD, EVEN)),
    Halves("left and right half of the pupil", (ALL, FIRST), (ALL, SECOND)),
    Halves("upper and lower half of the pupil", (FIRST, ALL), (SECOND, ALL)),
)


def quantile(errors: Floats, sigma: Floats | float = 1.0) -> float:
    """Number of `sigma` within which 68 % of errors lie; NaN where there are none."""
    return float(np.quantile(np.abs(errors / sigma), WITHIN)) if errors.size else float("nan")


@dataclass(frozen=True, eq=False)
class LytroViews:
    """Real light field of a grid of views, put in order, in units of its median brightness."""

    field: LightField
    search: tuple[float, float]
    window: int = 5

    @classmethod
    def of(cls, folder: Path, gamma: float = 1.0) -> LytroViews:
        """Read a folder; `gamma` makes brightness linear."""
        named = read_views(folder).field
        field = in_order(named, partial(disagreement, across=len(named.s))).field
        values = field.values ** np.float32(gamma)
        field = scaled(replace(field, values=values), float(np.median(values)))
        return cls(field, searched(field, float(len(field.s))))

    @property
    def geometry(self) -> GridGeometry:
        """Of the whole grid: sets of its views stay where they stood."""
        return GridGeometry(len(self.field.s), window=self.window)

    def some(self, rows: slice, columns: slice) -> LightField:
        """Some of its views."""
        values, weight = (np.ascontiguousarray(part[rows, columns]) for part in (self.field.values, self.field.weight))
        return replace(self.field, values=values, weight=weight, s=self.field.s[columns], t=self.field.t[rows])

    def map_of(self, views: LightField, share: float = TRIED) -> DisparityMap:
        """Disparities, with the errors that a mismatch of this share of the median brightness makes."""
        prepared, noise = self.geometry.viewing(views).prepared(views), PixelNoise(QUIET, QUIET * share)
        return estimate_disparity(prepared.field, prepared.pupil, noise, search=self.search, window=self.window)


@dataclass(frozen=True, eq=False)
class Repeated:
    """Disparities of two sets of views against each other; arrays of the pixels that both know, errors of one set."""

    words: str
    views: int
    known: float
    difference: Floats
    """Over sqrt(2) [pitches over the pupil]: error of one set, where those of both have nothing in common."""
    reported: Floats
    """Standard errors that `roslf depth` tells, rms of both sets."""
    share: float
    """Rms mismatch that it finds, against brightness."""

    def to_dict(self) -> dict[str, float | str]:
        """Row of the table."""
        score = self.difference / self.reported
        return {
            "views": self.views, "words": self.words, "known": self.known, "share": self.share,
            "reported": float(np.median(self.reported)), "error": quantile(self.difference), "ratio": quantile(score),
            "rms_ratio": float(np.sqrt(np.mean(score**2))), "inside": float(np.mean(np.abs(score) < 1)),
            "beyond_5": float(np.mean(np.abs(score) > 5)),
        }  # fmt: skip


def repeated(views: LytroViews, sets: Sequence[Halves] = SETS) -> Iterator[Repeated]:
    """How far disparities of disjoint sets of views differ, beside the errors that `roslf depth` tells."""
    for halves in sets:
        runs = []
        for rows, columns in (halves.first, halves.second):
            some = views.some(rows, columns)
            noise, first, some = measured_noise(views.geometry, some, views.search)
            runs.append(measured_with_noise(views.geometry, some, noise, first.search, True))
        (one, noise), (two, _) = runs
        known = one.measured & two.measured
        told = np.sqrt(np.mean([np.square(run.disparities.sigma[known]) for run, _ in runs], axis=0))
        difference = (one.disparities.disparity - two.disparities.disparity)[known] / np.sqrt(2)
        share = noise.pixel.read_noise / noise.pixel.electrons
        yield Repeated(halves.words, some.values[..., 0, 0].size, float(known.mean()), difference, told, share)


class Scatter(NamedTuple):
    """Errors, and what they would be for a mismatch of all of the brightness: their ratio is the mismatch."""

    error: Floats
    unit: Floats

    @classmethod
    def of(cls, views: LytroViews, halves: Halves, columns: slice = ALL) -> Scatter:
        """Of two sets of views, in some columns of the picture."""
        tried = TRIED
        for _ in range(ROUNDS):
            one, two = (views.map_of(views.some(*part), tried) for part in (halves.first, halves.second))
            known = (one.measured & two.measured)[:, columns]
            error = (one.disparity - two.disparity)[:, columns][known]
            found = cls(error, np.hypot(one.sigma, two.sigma)[:, columns][known] / tried)
            if not abs(ROOM * found.share / tried - 1) > CLOSE:
                break
            tried = ROOM * found.share
        return found

    @property
    def share(self) -> float:
        """Mismatch within which 68 % of the errors lie."""
        return quantile(self.error, self.unit)

    def inside(self, share: float) -> float:
        """Share of the errors within those predicted for a mismatch."""
        return float(np.mean(np.abs(self.error) < share * self.unit))


class HeldOut(NamedTuple):
    """Mismatch fitted on one part and used to predict another."""

    fitted_on: str
    share: float
    predicted: str
    ratio: float
    """Errors predicted over measured."""
    inside: float
    """Share of the errors within those predicted: 68 % where the prediction is right."""


def held_out(views: LytroViews, linear: LytroViews, board: Scatter) -> list[HeldOut]:
    """Mismatch fitted on one half of the picture and of the views, against others."""
    columns = views.field.values.shape[-1]
    left, right = slice(0, columns // 2), slice(columns // 2, None)
    one, other, half = SETS[2], SETS[3], SETS[0]
    both = {name: (Scatter.of(each, one, left), Scatter.of(each, other, right)) for name, each in
            (("", views), (f", brightness to the power of {GAMMA}", linear))}  # fmt: skip
    rows = []

    def row(words: str, fit: Scatter, what: str, seen: Scatter) -> None:
        rows.append(HeldOut(words, fit.share, what, fit.share / seen.share, seen.inside(fit.share)))

    for words, (a, b) in both.items():
        row(f"25 views, left half of the picture{words}", a, "25 other views, right half", b)
        row(f"25 views, right half of the picture{words}", b, "25 other views, left half", a)
    fit = both[""][0]
    row("25 views, left half of the picture", fit, "50 views, right half", Scatter.of(views, half, right))
    row("25 views, left half of the picture", fit, "nine views of a flat board, about its plane", board)
    return rows


class Level(NamedTuple):
    """What is left between views, at one brightness of the 8-bit pictures against their median."""

    brightness: float
    even: float
    """Rms where the picture is even: the fifth of its pixels with least slope."""
    steep: float
    """Rms in the fifth with most."""
    all: float


def left_between(views: LytroViews, parts: int = 6, middle: slice = slice(2, 8)) -> list[Level]:
    """Rms by which the inner views differ from their mean once they lie on each other, by brightness; last row: all."""
    found = views.map_of(views.field)
    pupil = views.geometry.viewing(views.field).prepared(views.field).pupil
    known = found.measured
    disparity = np.where(known, found.disparity, np.median(found.disparity[known]))
    rows, columns = np.indices(known.shape, dtype=float)
    moved = np.stack([
        ndimage.map_coordinates(view.astype(float), [rows + disparity * y, columns + disparity * x], order=5)
        for view, x, y in zip(
            views.field.values[middle, middle].reshape(-1, *known.shape), *(p[middle, middle].ravel() for p in pupil),
            strict=True,
        )
    ])  # fmt: skip
    inner = ndimage.binary_erosion(known, np.ones((3, 3), bool))
    inner[:12] = inner[-12:] = inner[:, :12] = inner[:, -12:] = False
    mean = moved.mean(axis=0)
    count = len(moved)
    square = ((moved - mean) ** 2).sum(axis=0)[inner] / (count - 1)
    level, slope = mean[inner], np.hypot(*np.gradient(mean))[inner]
    flat, steep = slope < np.quantile(slope, 0.2), slope > np.quantile(slope, 0.8)
    cuts = np.quantile(level, np.linspace(0, 1, parts + 1))

    def rms(some: NDArray[np.bool_]) -> float:
        return float(np.sqrt(square[some].mean()))

    bins = [(level >= low) & (level <= high) for low, high in pairwise(cuts)]
    return [
        Level(float(level[some].mean()), rms(some & flat), rms(some & steep), rms(some))
        for some in (*bins, np.ones_like(flat))
    ]


class WhiteFrame(NamedTuple):
    """What pixels at the same place behind neighbouring microlenses differ by as read, rms share of brightness."""

    lenses: float
    """From microlens to microlens."""
    typical: float
    """The same, of half of them within 0.67 times so much: without those that are dirty."""
    pixels: float
    """From pixel to pixel beside that, shot noise included."""


def white_frame(folder: Path, around: float = 0.3, margin: int = 50) -> WhiteFrame:
    """Raw white frame of a light-field microscope: second differences between a microlens and its neighbours."""
    white, dark = (
        grey_frame(read_image(folder / f"{name}_GUVExperim1.tif")).astype(float) for name in ("Radiometry", "DarkFrame")
    )
    lattice, frame = find_centres(white, dark).lattice, white - dark
    rows, columns = np.indices(frame.shape, dtype=float)
    index = lattice.indices(np.stack([columns, rows], -1))
    nearest = np.rint(index)
    some = np.hypot(*np.moveaxis(index - nearest, -1, 0)) < around
    some[:margin] = some[-margin:] = some[:, :margin] = some[:, -margin:] = False
    keys = (nearest @ (10_000, 1))[some]
    own = np.unique(keys, return_inverse=True)[1]
    count = np.bincount(own)
    noise = np.random.default_rng(0).standard_normal(frame.shape)
    between, typical, within = [], [], []
    for step in (lattice.nodes(1, 0) - lattice.nodes(0, 0), lattice.nodes(0, 1) - lattice.nodes(0, 0)):
        bent, quiet = (
            sum(ndimage.shift(one, sign * step[::-1], order=5, mode="nearest") for sign in (1, -1)) - 2 * one
            for one in (frame, noise)
        )
        share = bent[some] / frame[some]
        mean = np.bincount(own, share) / count
        whole = count > 0.5 * count.max()
        between.append(mean[whole].std() / np.sqrt(6))
        typical.append(1.4826 * np.median(np.abs(mean[whole])) / np.sqrt(6))
        left = (share - mean[own])[whole[own]]
        within.append(np.sqrt(np.mean(left**2) / (1 - 1 / count.mean())) / quiet[some].std())
    return WhiteFrame(*(float(np.sqrt(np.mean(np.square(each)))) for each in (between, typical, within)))


def flat_board(folder: Path, step: float = 0.5, before: float = 3.0, window: int = 7, tried: float = 0.3) -> Scatter:
    """Depths of a flat board [mm] about the best plane, seen from nine places of a camera that corners tell.

    One view of each capture, laid on a plane `before` the board [mm], by pixels of `step`.
    """
    pictures = {path.name: grey_frame(read_image(path)) for path in sorted(folder.glob("*.png"))}
    eight_bit = {name: np.rint(picture).astype(np.uint8) for name, picture in pictures.items()}
    observations = observe_pictures(eight_bit, Board(23, 20, 4.0))
    found = _step_one(observations, fit_lines(observations), 1.0, 1.0, distortion=2)
    turn, away = rotation_matrix(found.poses.rotation), found.poses.translation
    x, y = np.meshgrid(np.arange(-40, 40.1, step), np.arange(-34, 34.1, step))
    plane = np.stack([x, y, np.full_like(x, before)], -1).reshape(-1, 3)
    at = project_boards(found.camera.vector(), found.poses.vector, plane, np.zeros((1, 2))).values[:, 0]
    places = at.reshape(len(pictures), *x.shape, 2)
    views = np.stack([
        ndimage.map_coordinates(picture.astype(float), [one[..., 1], one[..., 0]], order=3)
        for picture, one in zip(pictures.values(), places, strict=True)
    ])  # fmt: skip
    views /= ndimage.uniform_filter(views, (0, 33, 33))  # the light on the board, over four cells
    cameras = -np.einsum("bji,bj->bi", turn, away)
    pupil = np.stack([(cameras[:, k, None, None] - axis) / cameras[:, 2, None, None] for k, axis in ((0, x), (1, y))])
    wide = float(np.ptp(pupil.mean(axis=(2, 3)), axis=1).max())
    v, u = (np.arange(float(n)) for n in x.shape)
    grid = np.arange(-1.0, 2.0)
    values = views.reshape(3, 3, *x.shape).astype(np.float32)
    field = LightField(values, np.ones_like(values), grid, grid, u, v, 3.0)
    unit = wide / step  # pitches over all cameras per mm
    places_of = (pupil / wide).reshape(2, 3, 3, *x.shape)
    seen = estimate_disparity(
        field,
        places_of,
        PixelNoise(QUIET, QUIET * tried),
        search=((before - 6) * unit, (before + 6) * unit),
        window=window,
    )
    known = seen.measured
    depth, columns = seen.disparity[known] / unit, np.stack([np.ones(known.sum()), x[known], y[known]], -1)
    off = depth - columns @ np.linalg.lstsq(columns, depth, rcond=None)[0]
    return Scatter(off, seen.sigma[known] / (unit * tried))
