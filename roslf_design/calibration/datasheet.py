"""What no image of a board can tell: lengths taken from data sheets, each with its standard deviation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..theory.calibration import back_substitute
from .errors import CalibrationError
from .lattice import Array


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

    def draws(self, count: int, rng: np.random.Generator) -> Array:
        """Independent draws of f, q, d and the board's relative scale, shape (4, count)."""
        mean = np.array([self.f, self.q, self.d, 1.0])[:, None]
        sigma = np.array([self.f_sigma, self.q_sigma, self.d_sigma, self.cell_sigma])[:, None]
        result: Array = mean + sigma * rng.normal(size=(4, count))
        return result


QUANTITIES = ("A", "m", "d_2", "d_1", "d_f", "H", "d_3")
"""Lengths [mm] and ratios derived from a calibration."""


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
    q, d, board = (np.asarray(v, float) for v in ((sheet.q, sheet.d, 1.0) if scales is None else scales))
    A, m = A * (d / sheet.d), m * (d / sheet.d) / board
    d_2 = (q / sheet.q) * (d / sheet.d) / (inverse_d_2 * board)
    lengths = back_substitute(focal_length, A, m)
    values = (
        A,
        m,
        d_2,
        lengths.mla_distance,
        lengths.focal_plane_distance,
        lengths.aperture_constant,
        lengths.pupil_distance,
    )
    return {name: np.asarray(value, float) for name, value in zip(QUANTITIES, values, strict=True)}
