"""A whole calibration as one value: what was found, how sure it is, and how it is written."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..accuracy.statement import Accuracy
from ..design import Design
from .board import Board
from .calibrate import Calibration
from .centres import MicrolensCentres
from .consequences import depth_errors, variance_shares
from .datasheet import QUANTITIES, DataSheet, derived
from .diffraction import Diffraction
from .draws import Draws, laplace_draws
from .lattice import Array
from .posterior import Posterior
from .precision import posterior_accuracy

SCHEMA = "roslf.calibration/1"
UNITS = {"A": "mm", "m": "", "d_2": "mm", "d_1": "mm", "d_f": "mm", "H": "", "d_3": "mm"}
SHOWN = ("H", "d_3", "d_1", "d_f", "d_2", "A", "m")
"""Quantities in the order in which they are told."""
LAPLACE = "Fisher matrix (Laplace)"
ONE_DEPTH = 0.02
"""Spread of the boards' depths, relative to their mean, below which they stand at one depth."""
_DRAWS = 20_000
_GAUSS = {"68": 0.994458, "95": 1.959964}


@dataclass(frozen=True, eq=False)
class Estimate:
    """One quantity."""

    value: float
    """Of the best fit."""
    sigma: float
    low_68: float
    high_68: float
    low_95: float
    high_95: float
    r_hat: float | None
    """None where nothing was sampled."""
    ess: float | None
    """The smaller of bulk and tail."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """What `roslf calibrate` found."""

    design: Design
    """That the camera was built to."""
    board: Board
    sheet: DataSheet
    centres: MicrolensCentres
    calibration: Calibration
    diffraction: Diffraction | None
    """None where nobody looked for it."""
    undistorted_radius: float | None
    """Of the design, Eq. 6 on the sensor [px]; None where it was not used."""
    posterior: Posterior | None
    """None where it was not asked for: intervals are then the Fisher matrix's."""
    draws: Draws
    """The posterior's; without one, of Laplace's approximation."""
    depths: Mapping[str, Array]
    """`depth_errors` over the boards' range."""
    shares: Mapping[str, Mapping[str, float]]
    """`variance_shares`."""
    estimates: Mapping[str, Estimate]
    warnings: tuple[str, ...]
    seed: int
    distortion: int
    accuracy: Accuracy
    """What the draws are worth."""

    @property
    def converged(self) -> bool | None:
        """None where nothing was sampled."""
        return None if self.posterior is None else self.posterior.converged

    @property
    def intervals_from(self) -> str:
        """What intervals, depth errors and the corner plot come from."""
        return LAPLACE if self.posterior is None else "posterior"

    @property
    def calibrated(self) -> Design:
        """The design with d_3, d_1 and d_2 as calibrated, f as on its data sheet, and the errors in its source.

        Raises
        ------
        DesignError
            The values make no design.
        """
        found = {name: self.estimates[name] for name in ("d_3", "d_1", "d_2", "H")}
        said = ", ".join(f"{n} = {e.value:.6g} ± {e.sigma:.2g} {UNITS[n]}".strip() for n, e in found.items())
        images = len(self.calibration.observations.names)
        source = (
            f"roslf calibrate, {images} images of a board, f = {self.sheet.f:.6g} ± {self.sheet.f_sigma:.2g} mm"
            f" from the data sheet: {said} (standard deviations); before: {self.design.name}"
        )
        lengths = {name: found[name].value for name in ("d_3", "d_1", "d_2")}
        return self.design.replace({"name": f"{self.design.name}, calibrated", "source": source}, **lengths)

    def to_dict(self) -> dict[str, object]:
        """Everything as JSON's types."""
        found, fit = self.calibration, self.calibration.fit
        names = list(fit.covariance.names)
        rows = {}
        for name in SHOWN:
            e = self.estimates[name]
            rows[name] = {
                "estimate": e.value,
                "unit": UNITS[name],
                "sigma": e.sigma,
                "interval_68": [e.low_68, e.high_68],
                "interval_95": [e.low_95, e.high_95],
                "r_hat": e.r_hat,
                "ess": e.ess,
                "variance_shares": {s: v for s, v in self.shares[name].items() if s != "sigma"},
            }
        steps = {
            way: dict(zip(("d_1", "d_f", "H", "d_3"), (float(x) for x in lengths[:4]), strict=True))
            for way, lengths in (("steps_one_and_two", found.stepwise), ("joint", found.refined))
        }
        camera, sigma = fit.camera, fit.covariance.sigma
        p = self.posterior
        sampling = None
        if p is not None:
            sampling = {
                "message": p.message,
                "acceptance": p.acceptance,
                "steps": p.steps,
                "walkers": p.walkers,
                "r_hat": dict(p.r_hat),
                "bulk_ess": dict(p.bulk_ess),
                "tail_ess": dict(p.tail_ess),
            }
        lattice, used = self.centres.lattice, self.centres.used
        systematic = np.sqrt(np.square(fit.systematic).sum(axis=0))
        radius = self.undistorted_radius
        return {
            "schema": SCHEMA,
            "design": self.design.name,
            "board": {"columns": self.board.columns, "rows": self.board.rows, "cell_mm": self.board.cell},
            "intervals_from": self.intervals_from,
            "quantities": rows,
            "converged": self.converged,
            "accuracy": self.accuracy.to_dict(),
            "posterior": sampling,
            "fit": {
                name: {"value": float(getattr(camera, name)), "sigma": sigma[name]} for name in names
            },
            "condition_number": fit.covariance.condition,
            "correlations": {"names": names, "matrix": fit.covariance.correlation.tolist()},
            "other_ways": steps,
            "diffraction": None if self.diffraction is None else _told(self.diffraction, self.sheet),
            "systematic_sigma": dict(zip(("A", "m", "inverse_d_2"), map(float, systematic), strict=True)),
            "data_sheet": {
                "f_mm": self.sheet.f,
                "f_sigma_mm": self.sheet.f_sigma,
                "q_mm": self.sheet.q,
                "d_mm": self.sheet.d,
                "d_sigma_mm": self.sheet.d_sigma,
                "cell_sigma_relative": self.sheet.cell_sigma,
            },
            "reprojection_rms_pitches": found.joint.rms,
            "step_one_rms_pitches": found.first.rms,
            "noise_pitches": found.lines.sigma,
            "images_used": list(found.observations.names),
            "images_missing": list(found.missing),
            "views": len(found.observations.views),
            "coordinates": found.observations.count,
            "white_image": {
                "pitch_px": lattice.pitch,
                "rotation_rad": lattice.rotation,
                "layout": lattice.layout,
                "rms_px": self.centres.rms,
                "microlenses": self.centres.counts(),
                "used": int(used.sum()),
                "undistorted_radius_px": radius if radius is not None and np.isfinite(radius) else None,
            },
            "depth_errors_mm": {name: values.tolist() for name, values in self.depths.items()},
            "distortion_coefficients": self.distortion,
            "seed": self.seed,
            "warnings": list(self.warnings),
        }  # fmt: skip


def outcome_of(
    design: Design,
    board: Board,
    sheet: DataSheet,
    centres: MicrolensCentres,
    calibration: Calibration,
    posterior: Posterior | None,
    *,
    seed: int,
    distortion: int = 0,
    warnings: tuple[str, ...] = (),
    diffraction: Diffraction | None = None,
    undistorted_radius: float | None = None,
    accuracy: float | None = None,
) -> Outcome:
    """Bring together what was found; `warnings` come before those that follow from it; `accuracy` was asked for."""
    shares = variance_shares(calibration.fit, sheet)
    best = derived(calibration.fit.camera.vector(), sheet, np.asarray(sheet.f))
    values = {name: float(best[name]) for name in QUANTITIES}
    estimates = {name: _estimate(name, values[name], shares[name]["sigma"], posterior) for name in QUANTITIES}
    draws = posterior or laplace_draws(calibration.fit, sheet, _DRAWS, np.random.default_rng(seed))
    depths = depth_errors(draws, calibration.fit, sheet, working_range(calibration, values["d_3"]))
    notes = [*warnings]
    if diffraction is not None and diffraction.warning:
        notes.append(diffraction.warning)
    if calibration.missing:
        notes.append(f"no board found in {', '.join(calibration.missing)}: calibrated from the others")
    depth = calibration.fit.poses.translation[:, 2]
    if np.ptp(depth) < ONE_DEPTH * depth.mean():
        notes.append(
            f"the boards stand at one depth, within {np.ptp(depth):.2g} mm of {depth.mean():.4g} mm from the FAP: d_2"
            " and m rest on their tilts alone; spread their distances"
        )
    if posterior is not None and not posterior.converged:
        notes.append(f"the posterior has {posterior.message}; do not trust its intervals")
    return Outcome(
        design, board, sheet, centres, calibration, diffraction, undistorted_radius, posterior, draws, depths, shares,
        estimates, tuple(notes), seed, distortion, posterior_accuracy(posterior, draws, accuracy),
    )  # fmt: skip


def _told(found: Diffraction, sheet: DataSheet) -> dict[str, object]:
    """The correction as JSON's types, with what would have come out without it."""
    without = None
    if found.before is not None:
        best = derived(found.before.vector(), sheet, np.asarray(sheet.f))
        without = {name: float(best[name]) for name in SHOWN}
    return {
        "corrected": found.corrected,
        "reason": found.reason,
        "expected_blur_px": found.expected_blur,
        "seen_blur_px": None if found.image is None else found.image.blur,
        "seen_radius_px": None if found.image is None else found.image.radius,
        "white_image_misfit": found.misfit,
        "largest_shift_pitches": found.largest,
        "baseline": found.baseline,
        "without": without,
    }


def working_range(calibration: Calibration, d_3: float, count: int = 61) -> Array:
    """Distances from the lens [mm], as far as the boards reach and a fifth more of their depth, shape (count,)."""
    depth = calibration.fit.poses.translation[:, 2]
    result: Array = d_3 + np.linspace(0.8 * float(depth.min()), 1.2 * float(depth.max()), count)
    return result


def _estimate(name: str, value: float, sigma: float, posterior: Posterior | None) -> Estimate:
    if posterior is None:
        near, far = _GAUSS["68"] * sigma, _GAUSS["95"] * sigma
        return Estimate(value, sigma, value - near, value + near, value - far, value + far, None, None)
    row = posterior.summary()[name]
    key = "inverse_d_2" if name == "d_2" else name
    ends = (row["low_68"], row["high_68"], row["low_95"], row["high_95"])
    return Estimate(
        value, row["sigma"], *ends, posterior.r_hat[key], min(posterior.bulk_ess[key], posterior.tail_ess[key])
    )
