"""Microlenses whose images are worked out, and the way from these to all others."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ..calibration.decoding import LightField
from ..camera import Camera
from ..theory.image_parts import STEPS, ImageParts
from ..theory.stop_images import MicrolensImages

STEP = 0.05
"""Cut microlens images are worked out wherever their cut moved by so much of their diameter, others lie between."""
LEAST_NODES, MOST, HELD = 400, 2000, 40_000_000
"""Places up to which that is done anyway, and at most; light of samples that is held where there are more."""
WIDER = 0.02
"""Share by which images behind a real lens grow that counts as such a step."""
BENT = 5e-4
"""Share of their size by which images between such places may differ along an axis from what is interpolated: light at
their rims goes over from one microlens to the next within a few hundredths of it, and looks a pitch aside."""
ASIDE, RIM, SAME = 0.005, 0.5 * np.eye(2), 4.0
"""Pitches by which what views from places on the FAP's rim see aside may differ likewise, as phases of waves go with
that; times either by which whole images may differ where one stands for all."""
COARSE = 9
"""Places along each axis at which is looked whether any is cut."""


class TracedLens(Protocol):
    """Lens and elements, by what they make of microlens images and of where these look."""

    def cut(self, images: MicrolensImages) -> MicrolensImages:
        """Images cut as rays have it."""

    def images(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """Images at places on the array (n, 2) [mm] against those of an ideal lens, as `image_parts` takes them."""

    def apart(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """How far neighbours' images lie apart there, against first order, row by column (n, 2, 2)."""

    def parts(self, camera: Camera, field: LightField, places: NDArray[np.float64]) -> ImageParts | None:
        """`ImageParts` where images are cut at some places (n, 2), neighbours' where they lie; None of whole ones.

        Of microlenses as the camera has them, and the sensor behind them.
        """

    def aside(self, places: NDArray[np.float64], pupil: NDArray[np.float64]) -> NDArray[np.float64]:
        """How far to the side views from points on the FAP (2, n, ...) [diameters] see there [pitches]; likewise."""

    def shown(
        self, field: LightField, places: NDArray[np.float64], waves: NDArray[np.float64],
        disparities: NDArray[np.float64],
    ) -> Iterator[tuple[NDArray[np.complex128], NDArray[np.float64]]]:  # fmt: skip
        """For each disparity, waves as `waves_shown` has them (W, n, T, S), and where samples look (2, n, T, S).

        That by their own light, on average [pitches].
        """


class Nodes(NamedTuple):
    """Microlenses whose images are worked out, by rows and columns of views: one of each where all are alike."""

    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    few: tuple[int, int]
    """As many along each axis as do for what goes slowly from one microlens to the next, as phases of waves."""

    @classmethod
    def of(cls, camera: Camera, places: NDArray[np.float64], real: TracedLens | None, samples: int) -> Nodes:
        """Nodes of places on the array, shape (v, u, 2) [mm], for so many samples of each."""
        size = places.shape[:2]

        def spread(counts: Iterable[int]) -> list[NDArray[np.intp]]:
            return [
                np.linspace(0, n - 1, min(n, count)).round().astype(np.intp)
                for n, count in zip(size, counts, strict=True)
            ]

        rows, columns = spread((COARSE, COARSE))
        some = places[np.ix_(rows, columns)].reshape(-1, 2)
        images = cut_images(camera, some, real)
        shapes = image_shapes(some, real).reshape(rows.size, columns.size, -1)
        rim = np.broadcast_to(RIM[:, None], (2, len(some), 2))
        beside = np.zeros_like(rim) if real is None else real.aside(some, rim)
        curves = np.concatenate([shapes / BENT, np.moveaxis(beside, 1, 0).reshape(*shapes.shape) / ASIDE], -1)
        apart = shapes * (STEP / WIDER)
        if (images.shapes.kept_fraction < 1 - 1e-9).any():
            centres, spans = images.openings.centres, images.openings.spans
            cuts = ((centres - centres[..., :1, :]) / spans[..., :1, None]).reshape(rows.size, columns.size, -1)
            apart = np.concatenate([apart, cuts], -1)
        elif np.ptp(curves, axis=(0, 1)).max() < SAME:
            return cls(rows[rows.size // 2, None], columns[columns.size // 2, None], (1, 1))
        counts = []
        for axis, at in enumerate((rows, columns)):
            moved = float(np.ptp(apart, axis=axis).max(initial=0.0))
            ahead, line = (at / max(at[-1], 1))[:, None, None], np.moveaxis(curves, axis, 0)
            bent = float(np.abs(line - line[0] - ahead * (line[-1] - line[0])).max())  # a quarter with a node between
            counts.append([max(2, math.ceil(far) + 1) for far in (moved / STEP, math.sqrt(bent))])
        few, fine = np.transpose(counts)
        every = np.maximum(few, fine)
        most = max(LEAST_NODES, min(MOST, HELD // (len(STEPS) * samples)))
        less = [min(1.0, math.sqrt(most / math.prod(each.tolist()))) for each in (few, every)]
        few, every = (np.maximum(2, (each * part).astype(int)) for each, part in zip((few, every), less, strict=True))
        rows, columns = spread(every)
        return cls(rows, columns, (int(few[0]), int(few[1])))


class NodeMap(NamedTuple):
    """For each lens, shape (v, u), the node before it in rows and columns of nodes, and how far the next ones are."""

    node: NDArray[np.int64]
    down: NDArray[np.float32]
    along: NDArray[np.float32]
    across: int
    """Nodes in a row of them."""

    @classmethod
    def of(cls, rows: NDArray[np.intp], columns: NDArray[np.intp], row: NDArray[Any], column: NDArray[Any]) -> NodeMap:
        """For nodes at some `rows` and `columns` of views, over which lenses lie at a `row` and `column`, (v, u)."""
        befores, parts = [], []
        for places, lenses in ((rows, row), (columns, column)):
            at = np.interp(lenses, places, np.arange(places.size))
            befores.append(np.clip(np.floor(at), 0, max(places.size - 2, 0)).astype(np.int64))
            parts.append((at - befores[-1]).astype(np.float32))
        down, along = (np.ascontiguousarray(part) for part in np.broadcast_arrays(*parts))
        return cls(befores[0] * columns.size + befores[1], down, along, columns.size)

    @classmethod
    def of_views(cls, rows: NDArray[np.intp], columns: NDArray[np.intp], size: tuple[int, int]) -> NodeMap:
        """For views' own rows and columns, so many of them."""
        return cls.of(rows, columns, *np.ogrid[: size[0], : size[1]])

    @classmethod
    def of_lenses(cls, rows: NDArray[np.intp], columns: NDArray[np.intp], field: LightField) -> NodeMap:
        """For the lenses of a light field where they stand, in a hexagonal array between its views' columns."""
        (row, _), column = on_grid(field)
        return cls.of(rows, columns, row, column)

    def __call__(self, values: NDArray[np.float64]) -> NDArray[np.float32]:
        """From the nodes, shape (..., nodes), to all lenses, shape (..., v, u); (..., 1, 1) of a single node."""
        if values.shape[-1] == 1:
            return values[..., None].astype(np.float32)
        table = values.astype(np.float32)
        left, right = (
            low + self.down * (table[..., self.node + self.across + k] - low)
            for k, low in ((k, table[..., self.node + k]) for k in (0, 1))
        )
        return np.asarray(left + self.along * (right - left))


def on_grid(field: LightField) -> tuple[tuple[NDArray[np.intp], NDArray[np.intp]], NDArray[np.float64]]:
    """Rows and columns of views nearest to each lens, to index them by, and the place of each among the columns."""
    rows, count = (field if field.hexagonal is None else field.hexagonal).values.shape[2:]
    row, column = np.arange(rows)[:, None], np.arange(count)[None, :] + np.zeros((rows, 1))
    if field.hexagonal is not None:
        column = (field.hexagonal.starts[:, None] + column - field.u[0]) / float(field.u[1] - field.u[0])
    return (row, np.clip(np.rint(column).astype(int), 0, len(field.u) - 1)), column


def cut_images(camera: Camera, places: NDArray[np.float64], real: TracedLens | None) -> MicrolensImages:
    """Images at places on the array, cut by stops and, of a real lens, as rays have it."""
    images = MicrolensImages(camera, places)
    return images if real is None else real.cut(images)


def image_shapes(places: NDArray[np.float64], real: TracedLens | None) -> NDArray[np.float64]:
    """`TracedLens.images` at places on the array, of an ideal lens as well."""
    return np.broadcast_to(np.eye(2), (len(places), 2, 2)) if real is None else real.images(places)
