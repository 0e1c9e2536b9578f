"""Boards, a camera's parameters, its data sheet, and where it sees the boards' corners in each view.

A view is a pinhole at S' on the flexible angular plane (Eqs. 2 and 10); the slope of the ray from it to a corner is
distorted radially, then scaled to the array:

    S' = -(q A / d_2) (1 + b_1 |X/Z_F|^2) s',    xi = (X - S')/Z_F,    xi_d = xi (1 + k_1 |xi|^2 + k_2 |xi|^4),
    u - u_0 = -(A xi_d + m (1 + c_1 |xi|^2) S')/d.

Without distortion this is the light-field projection of `roslf_design.theory`. s'_0 is 0 by choice of origin: another
would move u_0 and the boards, nothing else.

A lens that distorts does more to third order. Its field is curved: where views agree is a bowl, c_1, of which the mean
of tangential and sagittal foci counts, as slopes are means over both. And the same pixels see more or less of the pupil
towards the edge, b_1: whatever the lens, Lagrange's invariant makes it 2 k_1 + 1 - (A/L)^2, L the exit pupil's distance
from the array. Left out, m takes up the bowl (1 to 4 % of m behind catalogue lenses on the paper's bench), d_2 the
rest.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..camera import Camera
from ..design import Design
from ..theory.light_field import back_substitute
from ..units import FARTHEST, read_quantity
from .frames import Array, CalibrationError
from .space import ApparentCamera, SceneSide, as_shown

GLOBALS = ("A", "m", "inverse_d_2", "x_0", "y_0", "k_1", "k_2", "q", "d", "c_1", "b_1")
"""Parameters all boards share, in the order of the Jacobian's columns."""
MOST_RADIAL = 2
"""Radial coefficients of distortion that a fit can find."""
QUANTITIES = ("H", "d_3", "d_1", "d_f", "d_2", "A", "m")
"""Lengths [mm] and ratios derived from a calibration, in the order in which they are told."""
UNITS = {name: "" if name in ("m", "H") else "mm" for name in QUANTITIES}
_UNIT = np.eye(3)
_TURNS = np.cross(_UNIT[:, None], _UNIT).swapaxes(1, 2).reshape(3, 9)
"""Cross products with the unit vectors, their matrices row after row."""
_LENGTH = r"\s+(\d+\.?\d*|\.\d+)\s*(um|mm|cm|m)"
_CELLS = r"(\d{1,9})\s*[x×]\s*(\d{1,9})" + _LENGTH
_BOARD = re.compile(rf"\s*{_CELLS}\s*")
_CHARUCO = re.compile(rf"\s*(?i:charuco)\s+{_CELLS}{_LENGTH}\s+(\w+)\s*")
_DICTIONARY = re.compile(r"DICT_([4-7])X\1_(50|100|250|1000)")
_RIM = 0.7
"""Least bright rim of a marker, in its bits, for OpenCV to read it and corners to be placed beside it."""
_UNITS = {"um": 1e-3, "mm": 1.0, "cm": 10.0, "m": 1000.0}

MOST_CELLS = 50
"""Largest number of cells along a side of a board."""


class Markers(NamedTuple):
    """ArUco markers in the middle of a ChArUco board's bright cells."""

    width: float
    """[mm]"""
    dictionary: str
    """As OpenCV calls it: "DICT_4X4_50" is the first 50 markers of 4 x 4 bits."""


LEAST_CELLS, LEAST_MARKED = 4, 3
"""Cells along a side of a checkerboard, below which OpenCV looks for none; and of one with markers."""


@dataclass(frozen=True)
class Board:
    """A flat checkerboard of `columns` x `rows` cells, each `cell` mm wide.

    With markers, as OpenCV 4.6 and later draw them, its first cell is dark, and its corners are told apart where only
    part of the board is seen.
    """

    columns: int
    rows: int
    cell: float
    markers: Markers | None = None

    def __post_init__(self) -> None:
        least = LEAST_CELLS if self.markers is None else LEAST_MARKED
        if min(self.columns, self.rows) < least:
            raise CalibrationError(
                f"a board of {self.columns} x {self.rows} cells has too few inner corners: {least} x {least} cells or"
                " more"
            )
        if max(self.columns, self.rows) > MOST_CELLS:
            raise CalibrationError(
                f"a board of {self.columns} x {self.rows} cells has too many inner corners: at most {MOST_CELLS} cells"
                " a side"
            )
        if not 0 < self.cell <= FARTHEST["length"]:
            raise CalibrationError(f"the board's cell must be a positive length of a board, got {self.cell:g} mm")
        if self.markers is not None:
            self._check(self.markers)

    def _check(self, markers: Markers) -> None:
        if self.columns == self.rows == 3:
            raise CalibrationError("a ChArUco board of 3 x 3 cells has too few inner corners: 4 x 3 cells or more")
        if not 0 < markers.width < self.cell:
            raise CalibrationError(
                f"markers of {markers.width:g} mm do not fit into cells of {self.cell:g} mm: give the cell's size"
                " first, then the marker's, which is smaller"
            )
        known, needed = _DICTIONARY.fullmatch(markers.dictionary), self.columns * self.rows // 2
        if known is None:
            raise CalibrationError(
                f'markers "{markers.dictionary}" are not known: write DICT_4X4_50 or such, of 4X4 to 7X7 bits and 50,'
                " 100, 250 or 1000 markers"
            )
        bit, rim = markers.width / (int(known[1]) + 2), (self.cell - markers.width) / 2
        if rim < _RIM * bit:
            raise CalibrationError(
                f"markers of {markers.width:g} mm in cells of {self.cell:g} mm leave a rim of {rim:.3g} mm, and less"
                f" than {_RIM * bit:.3g} mm ({_RIM:g} of a bit) spoils markers and corners: make a board with smaller"
                " markers"
            )
        if needed > int(known[2]):
            raise CalibrationError(
                f"a board of {self.columns} x {self.rows} cells has {needed} markers, {markers.dictionary} only"
                f" {known[2]}: name the larger dictionary it was made with"
            )

    @classmethod
    def parse(cls, text: str) -> Board:
        """Read a board from text such as "4x5 6 mm": cells across, cells down, size of a cell.

        Of a ChArUco board the markers' size and dictionary too: "charuco 8x6 6 mm 4.5 mm DICT_4X4_50".
        """
        match, charuco = _BOARD.fullmatch(text), _CHARUCO.fullmatch(text)
        parts = match or charuco
        if parts is None:
            raise CalibrationError(
                f'board "{text}" is not understood: write cells and their size, such as "4x5 6 mm"; of a ChArUco board'
                ' also its markers, such as "charuco 8x6 6 mm 4.5 mm DICT_4X4_50"'
            )
        markers = charuco and Markers(float(charuco[5]) * _UNITS[charuco[6]], charuco[7].upper())
        return cls(int(parts[1]), int(parts[2]), float(parts[3]) * _UNITS[parts[4]], markers)

    @property
    def text(self) -> str:
        """Text that `parse` reads."""
        cells = f"{self.columns}x{self.rows} {self.cell:g} mm"
        return cells if self.markers is None else f"charuco {cells} {self.markers.width:g} mm {self.markers.dictionary}"

    def to_dict(self) -> dict[str, float | str]:
        """JSON-ready."""
        cells: dict[str, float | str] = {"columns": self.columns, "rows": self.rows, "cell_mm": self.cell}
        if self.markers is None:
            return cells
        return cells | {"marker_mm": self.markers.width, "dictionary": self.markers.dictionary}

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
        return np.asarray(plane.reshape(-1, 3) * self.cell)


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
    """Names of the boards' images."""
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
        return observed(self.uv)

    @property
    def count(self) -> int:
        """Coordinates measured."""
        return 2 * int(self.seen.sum())


def observed(uv: Array) -> NDArray[np.bool_]:
    """True where points (..., 2) have both coordinates."""
    return np.asarray(np.isfinite(uv).all(axis=-1), bool)


@dataclass(frozen=True)
class Intrinsics:
    """Parameters of a camera that a calibration finds, in the paper's symbols."""

    A: float
    """d_1/H [mm]."""
    m: float
    """d_1/d_f."""
    inverse_d_2: float
    """1/d_2 [1/mm]."""
    x_0: float
    """Microlens on the axis [pitches]."""
    y_0: float
    """[pitches]"""
    k_1: float = 0.0
    """Radial distortion of ray slopes at the FAP."""
    k_2: float = 0.0
    q: float = 1.0
    """Pixel pitch [mm]: from the data sheet."""
    d: float = 1.0
    """Microlens pitch [mm]: from the data sheet."""
    c_1: float = 0.0
    """Curvature of the field: growth of m with the square of the ray's slope."""
    b_1: float = 0.0
    """Growth of the views' baseline with the square of the ray's slope."""

    def vector(self, names: tuple[str, ...] = GLOBALS) -> Array:
        """The parameters named, in order."""
        return np.array([getattr(self, name) for name in names])

    def with_values(self, names: tuple[str, ...], values: Array) -> Intrinsics:
        """Camera with the values of the named parameters changed."""
        return replace(self, **{name: float(value) for name, value in zip(names, values, strict=True)})


class Poses(NamedTuple):
    """Boards in the frame of the FAP (X, Y along the array, Z_F into the scene)."""

    rotation: Array
    """Rotation vectors [rad], shape (b, 3)."""
    translation: Array
    """Position of the board's origin [mm], shape (b, 3)."""

    @property
    def vector(self) -> Array:
        """Six numbers a board, shape (b, 6)."""
        return np.concatenate([self.rotation, self.translation], axis=-1)

    @classmethod
    def from_vector(cls, vector: NDArray[Any]) -> Poses:
        """Poses from six numbers a board, shape (b, 6) or flat."""
        six = vector.reshape(-1, 6)
        return cls(six[:, :3], six[:, 3:])


# --- where corners are seen -------------------------------------------------------------------------------------------


class ProjectedCorners(NamedTuple):
    """Model values of boards b in views v at corners n, and their derivatives where asked for."""

    values: NDArray[Any]
    """u, v [pitches] and, with a share, the slope Du/Ds' [pitches/px], shape (b, v, n, 2 or 3)."""
    by_globals: NDArray[Any]
    """Derivatives by `GLOBALS`, shape (b, v, n, 2 or 3, 11)."""
    by_pose: NDArray[Any]
    """By the board's own pose, shape (b, v, n, 2 or 3, 6)."""


def project_boards(
    camera: NDArray[Any],
    pose: NDArray[Any],
    points: Array,
    views: Array,
    share: Array | None = None,
    derivatives: bool = False,
) -> ProjectedCorners:
    """Corners of boards in views, and how fast they move from view to view.

    Parameters
    ----------
    camera : ndarray
        All `GLOBALS`, shape (11,); without derivatives also of many cameras, shape (w, 11).
    pose : ndarray
        Rotation vector and translation of each board, shape (b, 6) or (w, b, 6).
    points : ndarray
        Corners in the board's frame [mm], shape (n, 3).
    views : ndarray
        (s', t') [px], shape (v, 2), or another for each board and corner, shape (b, v, n, 2).
    share : ndarray, optional
        Share of the squared baseline along s, shape (b, v, n): the slope Du/Ds' = Dv/Dt' that views of this baseline
        show is modelled too (the derivative of the place by the view, weighted so).
    derivatives : bool
        Ask for the Jacobian; without it those of the result are empty.

    For complex arguments the result is complex, so that a complex step checks the derivatives.
    """
    parts = np.moveaxis(camera, -1, 0)[..., None, None, None, None]
    A, m, inverse_d_2, x_0, y_0, k_1, k_2, q, d, c_1, b_1 = parts
    at = views[None, :, None, :] if views.ndim == 2 else views
    step = q * A * inverse_d_2
    turn = rotation_matrix(pose[..., :3])
    scene = (points @ np.swapaxes(turn, -1, -2) + pose[..., None, 3:])[..., None, :, :]
    z = scene[..., 2:]
    chief = scene[..., :2] / z
    aside = (chief * chief).sum(axis=-1, keepdims=True)
    base = 1 + b_1 * aside
    pupil = -step * base * at
    slope = chief - pupil / z
    square = slope * slope
    r2 = square[..., :1] + square[..., 1:]
    gain, bend, curl = 1 + r2 * (k_1 + k_2 * r2), k_1 + 2 * k_2 * r2, 2 * k_2
    bent, bowl = gain * slope, m * (1 + c_1 * r2)
    values = np.concatenate([x_0, y_0], axis=-1) - (A * bent + bowl * pupil) / d
    if share is not None:
        weights = np.stack([share, 1 - share], axis=-1)
        tilted = weights[..., :1] * square[..., :1] + weights[..., 1:] * square[..., 1:]
        stretch, along = gain + 2 * bend * tilted, (weights * slope * pupil).sum(axis=-1, keepdims=True)
        moves = bowl - (A * stretch + 2 * m * c_1 * along) / z
        values = np.concatenate([values, step * base / d * moves], axis=-1)
    if not derivatives:
        return ProjectedCorners(values, np.empty(0), np.empty(0))

    tensor = gain[..., None] * np.eye(2) + 2 * bend[..., None] * slope[..., :, None] * slope[..., None, :]
    by_slope = A * tensor + 2 * (m * c_1)[..., None] * pupil[..., :, None] * slope[..., None, :]
    by_pupil = (by_slope / z[..., None] - bowl[..., None] * np.eye(2)) / d
    by_globals = np.zeros((*values.shape, len(GLOBALS)), values.dtype)
    # The pupil moves with A, 1/d_2 and q through `step`, with b_1 and the corner through `base`.
    by_step = ((0, q * inverse_d_2), (2, q * A), (7, A * inverse_d_2))
    pulled = -(by_pupil @ at[..., None])[..., 0]
    for column, rate in by_step:
        by_globals[..., :2, column] = rate * base * pulled
    by_globals[..., :2, 0] -= bent / d
    by_globals[..., :2, 1] = -(1 + c_1 * r2) * pupil / d
    by_globals[..., 0, 3] = by_globals[..., 1, 4] = 1.0
    by_globals[..., :2, 5] = -(A / d) * r2 * slope
    by_globals[..., :2, 6] = -(A / d) * r2 * r2 * slope
    by_globals[..., :2, 8] = (A * bent + bowl * pupil) / (d * d)
    by_globals[..., :2, 9] = -(m / d) * r2 * pupil
    by_globals[..., :2, 10] = step * aside * pulled
    slope_by_scene = np.concatenate([np.broadcast_to(np.eye(2), tensor.shape), -slope[..., None]], axis=-1)
    slope_by_scene = slope_by_scene / z[..., None]
    base_by_scene = 2 * b_1 / z * np.concatenate([chief, -aside], axis=-1)
    by_scene = -by_slope @ slope_by_scene / d[..., None]
    by_scene = by_scene + step[..., None] * pulled[..., :, None] * base_by_scene[..., None, :]
    if share is not None:
        stretch_by_slope = (2 * bend + 4 * curl * tilted + 4 * bend * weights) * slope
        moves_by_slope = 2 * m * c_1 * (slope - weights * pupil / z) - A / z * stretch_by_slope
        moves_by_pupil = -(2 * m * c_1 * weights * slope + moves_by_slope) / z
        # Of step * base * moves, by step over base and by base over step alike.
        grown = moves - step * base * (moves_by_pupil * at).sum(axis=-1, keepdims=True)
        for column, rate in by_step:
            by_globals[..., 2:, column] = rate * base / d * grown
        whole = step * base / d
        by_globals[..., 2:, 0] -= whole * stretch / z
        by_globals[..., 2:, 1] = whole * (1 + c_1 * r2 - 2 * c_1 * along / z)
        by_globals[..., 2:, 5] = -whole * A / z * (r2 + 2 * tilted)
        by_globals[..., 2:, 6] = -whole * A / z * (r2 * r2 + 4 * r2 * tilted)
        by_globals[..., 2:, 8] = -values[..., 2:] / d
        by_globals[..., 2:, 9] = whole * m * (r2 - 2 * along / z)
        by_globals[..., 2:, 10] = step * aside / d * grown
        row = whole * (moves_by_slope[..., None, :] @ slope_by_scene)[..., 0, :]
        row[..., 2:] += whole * (A * stretch + 2 * m * c_1 * along) / (z * z)
        row = row + step / d * grown * base_by_scene
        by_scene = np.concatenate([by_scene, row[..., None, :]], axis=-2)
    twist = (-turn[:, None] @ _cross_matrix(points) @ _right_jacobian(pose[:, None, :3]))[:, None]
    return ProjectedCorners(values, by_globals, np.concatenate([by_scene @ twist, by_scene], axis=-1))


def rotation_matrix(vector: NDArray[Any]) -> NDArray[Any]:
    """Rotation matrices of rotation vectors, shape (..., 3) -> (..., 3, 3); also for complex vectors."""
    half = np.sqrt((vector * vector).sum(axis=-1))[..., None, None] / (2 * np.pi)
    cross = _cross_matrix(vector)
    return np.asarray(_UNIT + np.sinc(2 * half) * cross + np.sinc(half) ** 2 / 2 * (cross @ cross))


def _cross_matrix(vector: NDArray[Any]) -> NDArray[Any]:
    """Matrix of the cross product with a vector from the left, shape (..., 3) -> (..., 3, 3)."""
    return (vector @ _TURNS).reshape(*vector.shape, 3)


_GAUSS = np.polynomial.legendre.leggauss(12)


def _right_jacobian(vector: NDArray[Any]) -> NDArray[Any]:
    """Right Jacobian J of the rotation vector: ``R(r + dr) = R(r) R(J dr)``; the mean of R(-s r) for s from 0 to 1."""
    half = np.sqrt((vector * vector).sum(axis=-1))[..., None, None] / (2 * np.pi)
    cross, (nodes, weights) = _cross_matrix(vector), _GAUSS
    share = 0.5 + nodes / 2  # the mean of the square's factor has a closed form that cancels near no rotation
    squares = ((share * np.sinc(half * share)) ** 2 @ weights)[..., None] / 4
    return np.asarray(_UNIT - np.sinc(half) ** 2 / 2 * cross + squares * (cross @ cross))


# --- the data sheet ---------------------------------------------------------------------------------------------------


class _KnownNumber(NamedTuple):
    """A number of what stands before the main lens or about the array."""

    place: str
    """Place in a design: "elements.1.thickness"."""
    value: float
    """[mm; 1/mm of a gradient]"""
    sigma: float
    """Standard deviation."""


@dataclass(frozen=True)
class DataSheet:
    """Normal priors. Images fix A/d, m/d, and q A/d_2; these priors turn that into lengths."""

    f: float
    """Focal length of the main lens [mm]."""
    q: float
    """Pixel pitch on the sensor's conjugate [mm]."""
    d: float
    """Microlens pitch [mm]."""
    f_sigma: float
    """[mm]"""
    q_sigma: float = 0.0
    """[mm]"""
    d_sigma: float = 0.0
    """[mm]"""
    cell_sigma: float = 0.0
    """Relative error of the board's cell."""
    space: SceneSide | None = None
    """Space between boards and main lens, and about the array; None: air."""
    uncertain: tuple[_KnownNumber, ...] = ()
    """Numbers of `space` that are known with an error."""

    def __post_init__(self) -> None:
        for name in ("f", "q", "d"):
            if not 0 < getattr(self, name) < float("inf"):
                raise CalibrationError(f"{name} must be a positive length, got {getattr(self, name)} mm")
        for name in ("f_sigma", "q_sigma", "d_sigma", "cell_sigma"):
            if not 0 <= getattr(self, name) < float("inf"):
                raise CalibrationError(f"{name} must be zero or positive, got {getattr(self, name)}")
        for known in self.uncertain:
            if known.sigma > 0.2 * abs(known.value):
                raise CalibrationError(
                    f"{known.place} = {known.value:g} with a standard deviation of {known.sigma:g} is hardly known:"
                    " 20 % at most"
                )
        if self.f_sigma > 0.2 * self.f:
            raise CalibrationError(f"f_sigma = {self.f_sigma} mm says hardly anything of f = {self.f} mm: 20 % at most")

    @property
    def mean(self) -> Array:
        """f, q, d and the board's relative scale, then the `uncertain` numbers."""
        return np.array([self.f, self.q, self.d, 1.0, *(known.value for known in self.uncertain)])

    @property
    def sigma(self) -> Array:
        """Standard deviations of these numbers."""
        own = self.f_sigma, self.q_sigma, self.d_sigma, self.cell_sigma
        return np.array([*own, *(known.sigma for known in self.uncertain)])

    def draws(self, count: int, rng: np.random.Generator) -> Array:
        """Independent draws of `mean`, shape (4 or more, count)."""
        return np.asarray(self.mean[:, None] + self.sigma[:, None] * rng.normal(size=(len(self.mean), count)))

    def space_at(self, lengths: Mapping[str, Array]) -> SceneSide | None:
        """`space` with its `uncertain` numbers as `lengths` have them, by their places."""
        if self.space is None or not self.uncertain:
            return self.space
        return SceneSide.of(self.space.design, {known.place: lengths[known.place] for known in self.uncertain})

    def apparent(self, lengths: Mapping[str, Array]) -> ApparentCamera:
        """The camera of `derived` lengths, as the boards' medium has it."""
        return as_shown(lengths, self.space_at(lengths))


def sheet_of(
    design: Design,
    f_relative: float = 0.01,
    d_relative: float = 1e-3,
    cell_sigma: float = 1e-3,
    uncertain: Mapping[str, float] | None = None,
) -> DataSheet:
    """Data-sheet values of a design with relative standard deviations of f, d and the board's cell.

    `uncertain` are standard deviations of what stands before the lens and about the array, by the places of `Camera`.
    """
    numbers = Camera.of(design).numbers
    known = tuple(_KnownNumber(place, float(numbers[place]), sigma) for place, sigma in (uncertain or {}).items())
    return DataSheet(
        design.f, design.q, design.d, f_relative * design.f, d_sigma=d_relative * design.d, cell_sigma=cell_sigma,
        space=SceneSide.of(design), uncertain=known,
    )  # fmt: skip


def relative_sigma(text: str, f: float) -> float:
    """Relative standard deviation of f from text such as "1 %" or "0.5 mm".

    Raises
    ------
    ValueError
        Not understood; the message says what to give.
    """
    text = text.strip()
    if not text.endswith("%"):
        return read_quantity(text, "length") / f
    try:
        return float(text[:-1]) / 100
    except ValueError:
        raise ValueError(f'"{text}" is not understood; give "1 mm" or "1%"') from None


def derived(camera: Array, sheet: DataSheet, drawn: Sequence[ArrayLike] | Array | None = None) -> dict[str, Array]:
    """Lengths of the camera from fitted parameters and data-sheet values.

    Parameters
    ----------
    camera : ndarray
        A, m, 1/d_2 (and more, unused) as fitted with the sheet's q and d, shape (..., 3 or more).
    drawn : sequence of array_like, optional
        f, q, d [mm], relative size of the board and the sheet's `uncertain` numbers, each of shape (...) or one; the
        sheet's where not given.

    Returns
    -------
    dict
        `QUANTITIES`, each of shape (...), as the main lens sees them through what stands before it; ``q``, ``d`` and
        the sheet's `uncertain` numbers by their places, as drawn.

    Raises
    ------
    CalibrationError
        f or m is not positive, so that d_3 and d_f have no value.

    Notes
    -----
    A change of d, q or of the board's scale leaves every modelled corner where it is when A and m grow with d, d_2
    with q d, and m and d_2 shrink with the board's scale: the posterior follows exactly, without fitting again.
    """
    A, m, inverse_d_2 = np.moveaxis(np.asarray(camera, float)[..., :3], -1, 0)
    values = (np.asarray(value, float) for value in (sheet.mean if drawn is None else drawn))
    f, q, d, board, *others = values
    elements = dict(zip((known.place for known in sheet.uncertain), others, strict=True))
    A, m = A * (d / sheet.d), m * (d / sheet.d) / board
    d_2 = (q / sheet.q) * (d / sheet.d) / (inverse_d_2 * board)
    space = sheet.space_at(elements)
    try:
        if space is not None:
            lengths = space.seen(f, A, m, d_2)
        else:
            d_1, d_f, H, d_3 = back_substitute(f, A, m)[:4]
            lengths = dict(zip(QUANTITIES, (H, d_3, d_1, d_f, d_2, A, m), strict=True))
    except ValueError:
        raise CalibrationError(
            "within what is known of it the camera may be focused at infinity or beyond, where d_3 and d_f have no"
            " value: focus it nearer, or know it better"
        ) from None
    return {name: np.asarray(value) for name, value in lengths.items()} | {"q": q, "d": d} | elements
