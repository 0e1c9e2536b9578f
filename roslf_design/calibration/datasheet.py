"""What no image of a board can tell, lengths taken from data sheets, and what follows from both with its errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..design import Design
from ..theory.light_field import back_substitute
from ..units import parse_quantity
from .frames import Array, CalibrationError

if TYPE_CHECKING:
    from .calibrate import StatisticsFit

QUANTITIES = ("A", "m", "d_2", "d_1", "d_f", "H", "d_3")
"""Lengths [mm] and ratios derived from a calibration."""
SHOWN = ("H", "d_3", "d_1", "d_f", "d_2", "A", "m")
"""The same in the order in which they are told."""
UNITS = {name: "" if name in ("m", "H") else "mm" for name in QUANTITIES}


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

    def __post_init__(self) -> None:
        for name in ("f", "q", "d"):
            if not 0 < getattr(self, name) < float("inf"):
                raise CalibrationError(f"{name} must be a positive length, got {getattr(self, name)} mm")
        for name in ("f_sigma", "q_sigma", "d_sigma", "cell_sigma"):
            if not 0 <= getattr(self, name) < float("inf"):
                raise CalibrationError(f"{name} must be zero or positive, got {getattr(self, name)}")
        if self.f_sigma > 0.2 * self.f:
            raise CalibrationError(f"f_sigma = {self.f_sigma} mm says hardly anything of f = {self.f} mm: 20 % at most")

    @property
    def mean(self) -> Array:
        """f, q, d and the board's relative scale."""
        return np.array([self.f, self.q, self.d, 1.0])

    @property
    def sigma(self) -> Array:
        """Their standard deviations."""
        return np.array([self.f_sigma, self.q_sigma, self.d_sigma, self.cell_sigma])

    def draws(self, count: int, rng: np.random.Generator) -> Array:
        """Independent draws of f, q, d and the board's relative scale, shape (4, count)."""
        return np.asarray(self.mean[:, None] + self.sigma[:, None] * rng.normal(size=(4, count)))


def sheet_of(design: Design, f_relative: float = 0.01, d_relative: float = 1e-3, cell_sigma: float = 1e-3) -> DataSheet:
    """Data-sheet values of a design with relative standard deviations of f, d and the board's cell."""
    return DataSheet(
        design.f, design.q, design.d, f_relative * design.f, d_sigma=d_relative * design.d, cell_sigma=cell_sigma
    )


def relative_sigma(text: str, f: float) -> float:
    """Relative standard deviation of f from text such as "1 %" or "0.5 mm".

    Raises
    ------
    ValueError
        Not understood; the message says what to give.
    """
    text = text.strip()
    if not text.endswith("%"):
        return parse_quantity(text, "length") / f
    try:
        return float(text[:-1]) / 100
    except ValueError:
        raise ValueError(f'"{text}" is not understood; give "1 mm" or "1%"') from None


def derived(camera: Array, sheet: DataSheet, focal_length: Array, scales: Array | None = None) -> dict[str, Array]:
    """Lengths of the camera from fitted parameters and drawn data-sheet values.

    Parameters
    ----------
    camera : ndarray
        A, m, 1/d_2 (and more, unused) as fitted with the sheet's q and d, shape (..., 3 or more).
    sheet : DataSheet
    focal_length : ndarray
        f [mm], shape (...).
    scales : ndarray, optional
        Drawn q [mm], d [mm] and relative size of the board, shape (3, ...); the sheet's where not given.

    Returns
    -------
    dict
        `QUANTITIES`, each of shape (...).

    Notes
    -----
    A change of d, q or of the board's scale leaves every modelled corner where it is when A and m grow with d, d_2
    with q d, and m and d_2 shrink with the board's scale: the posterior follows exactly, without fitting again.
    """
    A, m, inverse_d_2 = np.moveaxis(np.asarray(camera, float)[..., :3], -1, 0)
    q, d, board = (np.asarray(v, float) for v in (sheet.mean[1:] if scales is None else scales))
    A, m = A * (d / sheet.d), m * (d / sheet.d) / board
    d_2 = (q / sheet.q) * (d / sheet.d) / (inverse_d_2 * board)
    lengths = back_substitute(focal_length, A, m)[:4]  # d_1, d_f, H, d_3
    return {name: np.asarray(value, float) for name, value in zip(QUANTITIES, (A, m, d_2, *lengths), strict=True)}


@dataclass(frozen=True, eq=False)
class CameraDraws:
    """Draws of what was fitted and of what follows from it: of a posterior, or of the normal law in its place."""

    names: tuple[str, ...]
    """Parameters: those of the fit, then f."""
    parameters: Array
    """Draws of them, shape (n, p)."""
    quantities: Mapping[str, Array]
    """Draws of `QUANTITIES`, data-sheet values drawn along, each of shape (n,)."""

    def draws(self, name: str) -> Array:
        """Draws of a quantity (data-sheet errors included) or, where there is none of that name, of a parameter."""
        if name in self.quantities:
            return self.quantities[name]
        if name not in self.names:
            known = ", ".join([*self.quantities, *self.names])
            raise ValueError(f"no quantity {name!r} in the posterior: it holds {known}")
        return np.asarray(self.parameters[:, self.names.index(name)])


def laplace_draws(fit: StatisticsFit, sheet: DataSheet, count: int, rng: np.random.Generator) -> CameraDraws:
    """Draws from Laplace's approximation: the normal law of the Fisher matrix about the best fit, and the data sheet.

    Systematic errors of the fit are drawn along.
    """
    names = fit.covariance.names
    root = np.linalg.cholesky(fit.covariance.matrix)
    cameras = fit.camera.vector(names) + rng.normal(size=(count, len(root))) @ root.T
    cameras[:, :3] += rng.normal(size=(count, len(fit.systematic))) @ fit.systematic
    f, *scales = sheet.draws(count, rng)
    return CameraDraws((*names, "f"), np.column_stack([cameras, f]), derived(cameras, sheet, f, np.stack(scales)))


def depth_errors(draws: CameraDraws, fit: StatisticsFit, sheet: DataSheet, distances: Array) -> dict[str, Array]:
    """What the calibration's uncertainty does to depths measured with it.

    Parameters
    ----------
    draws : CameraDraws
    fit : StatisticsFit
        Whose camera makes the slope of a point at each distance.
    sheet : DataSheet
    distances : ndarray
        From the main lens [mm], beyond the FAP, shape (k,).

    Returns
    -------
    dict
        ``distance``; ``from_lens`` and ``from_pupil``: standard deviation of Z and of Z_F [mm]; ``low_95`` and
        ``high_95``: interval of the error of Z [mm]; each of shape (k,).

    Notes
    -----
    Eq. 12 solved for depth. The images' errors of d_3 and of A cancel in distances from the lens near the focal plane
    (d_f = f (1 + m)/m knows nothing of A), where the error of f alone is left; in distances from the pupil f drops out
    and the error of A stays.
    """
    distances = np.asarray(distances, float)
    best = derived(fit.camera.vector(), sheet, np.asarray(sheet.f))
    depth = distances - best["d_3"]
    if not (depth > 0).all():
        raise CalibrationError(f"distances must lie beyond the FAP at {float(best['d_3']):.2f} mm from the lens")
    # (m - A/Z_F) A/d_2 is what the views measure; d and q scale with it.
    measured = (best["m"] - best["A"] / depth) * best["A"] / best["d_2"]
    m, A, d_2, d_3 = (draws.quantities[name][:, None] for name in ("m", "A", "d_2", "d_3"))
    with np.errstate(divide="ignore"):
        z_f = A / (m - measured * d_2 / A)
    z = z_f + d_3
    low, high = np.quantile(z - distances, [0.025, 0.975], axis=0)
    return {
        "distance": distances,
        "from_lens": z.std(axis=0, ddof=1),
        "from_pupil": z_f.std(axis=0, ddof=1),
        "low_95": low,
        "high_95": high,
    }


def variance_shares(fit: StatisticsFit, sheet: DataSheet) -> dict[str, dict[str, float]]:
    """To first order, what share of each quantity's variance comes from the images and from each data-sheet value.

    Returns
    -------
    dict
        For each of `QUANTITIES`, shares of ``images``, ``f``, ``q``, ``d``, ``board`` and ``systematic`` (what
        scatter does not show) that add up to 1, and ``sigma``, the standard deviation of all.
    """
    names = [name for name in ("A", "m", "inverse_d_2") if name in fit.covariance.names]
    images = np.linalg.cholesky(fit.covariance.part(names)).T
    # Steps of one standard deviation in (A, m, 1/d_2, f, q, d, board), by their source.
    steps = {"images": np.pad(images, ((0, 0), (0, 4)))}
    by_sheet = np.eye(4, 7, 3) * sheet.sigma[:, None]
    steps |= {name: row[None] for name, row in zip(("f", "q", "d", "board"), by_sheet, strict=True)}
    steps["systematic"] = np.pad(fit.systematic, ((0, 0), (0, 4)))
    best = np.concatenate([fit.camera.vector()[:3], sheet.mean])

    def variance(step: Array) -> dict[str, float]:
        ahead, behind = (
            derived(at[:, :3], sheet, at[:, 3], at[:, 4:].T) for at in (best + 0.01 * step, best - 0.01 * step)
        )
        return {name: float(np.square((ahead[name] - behind[name]) / 0.02).sum()) for name in QUANTITIES}

    parts = {source: variance(step) for source, step in steps.items()}
    shares = {}
    for name in QUANTITIES:
        total = sum(part[name] for part in parts.values())
        shares[name] = {source: part[name] / total if total > 0 else 0.0 for source, part in parts.items()}
        shares[name]["sigma"] = float(np.sqrt(total))
    return shares
