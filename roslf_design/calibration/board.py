"""Checkerboards and where their corners were seen."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .errors import CalibrationError
from .lattice import Array

_BOARD = re.compile(r"\s*(\d+)\s*[x×]\s*(\d+)\s+([0-9.]+)\s*(um|mm|cm|m)\s*")
_UNITS = {"um": 1e-3, "mm": 1.0, "cm": 10.0, "m": 1000.0}


@dataclass(frozen=True)
class Board:
    """A flat checkerboard of `columns` x `rows` cells, each `cell` mm wide."""

    columns: int
    rows: int
    cell: float

    def __post_init__(self) -> None:
        if self.columns < 3 or self.rows < 3:
            raise CalibrationError(
                f"a board of {self.columns} x {self.rows} cells has too few inner corners: 3 x 3 cells or more"
            )
        if not 0 < self.cell < float("inf"):
            raise CalibrationError(f"the board's cell must be a positive length, got {self.cell} mm")

    @classmethod
    def parse(cls, text: str) -> Board:
        """Read a board from text such as "4x5 6 mm": cells across, cells down, size of a cell.

        Raises
        ------
        CalibrationError
            With an example, where the text says something else.
        """
        match = _BOARD.fullmatch(text)
        if match is None:
            raise CalibrationError(f'board "{text}" is not understood: write cells and their size, such as "4x5 6 mm"')
        return cls(int(match[1]), int(match[2]), float(match[3]) * _UNITS[match[4]])

    @property
    def inner(self) -> tuple[int, int]:
        """Inner corners across and down."""
        return self.columns - 1, self.rows - 1

    @property
    def points(self) -> Array:
        """Inner corners in the board's frame [mm], shape (n, 3), row by row; z = 0, the middle of the board at 0."""
        across, down = self.inner
        y, x = np.mgrid[0:down, 0:across].astype(float)
        plane = np.stack([x - (across - 1) / 2, y - (down - 1) / 2, np.zeros_like(x)], axis=-1)
        result: Array = plane.reshape(-1, 3) * self.cell
        return result


@dataclass(frozen=True, eq=False)
class Observations:
    """Corners of several boards seen in several views of the light field."""

    points: Array
    """Corners in the board's frame [mm], shape (n, 3)."""
    views: Array
    """(s', t') of each view [px], shape (v, 2)."""
    uv: Array
    """Microlens coordinates of board b's corner n in view v [pitches], shape (b, v, n, 2); NaN where not seen."""
    names: tuple[str, ...] = ()
    """What each board's image is called."""
    missing: tuple[str, ...] = ()
    """Images in which no board was found."""

    def __post_init__(self) -> None:
        b, v, n = self.uv.shape[:3]
        if self.uv.ndim != 4 or self.uv.shape[3] != 2 or len(self.points) != n or len(self.views) != v:
            raise ValueError(
                f"uv of shape {self.uv.shape} does not fit {len(self.views)} views of {len(self.points)} corners"
            )
        if not self.names:
            object.__setattr__(self, "names", tuple(f"board {k + 1}" for k in range(b)))

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Corners that were seen, shape (b, v, n)."""
        both: NDArray[np.bool_] = np.isfinite(self.uv[..., 0]) & np.isfinite(self.uv[..., 1])
        return both

    @property
    def count(self) -> int:
        """Coordinates measured."""
        return 2 * int(self.seen.sum())

    def select(self, boards: Sequence[int] | None = None, views: Sequence[int] | None = None) -> Observations:
        """Some of the boards and views."""
        b = list(range(self.uv.shape[0])) if boards is None else list(boards)
        v = list(range(self.uv.shape[1])) if views is None else list(views)
        names = tuple(self.names[k] for k in b)
        return Observations(self.points, self.views[v], self.uv[np.ix_(b, v)], names, self.missing)
