"""A whole calibration as one value: what was found, how sure it is, and how it is written."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from ..accuracy.statement import Accuracy
from ..camera import Camera
from ..design import PATHS, Design
from ..tables import BriefValue
from ..theory.length_covariance import CalibratedLengths
from .centres import MicrolensCentres
from .designed import image_pitch, undistorted_radius
from .diffraction import Corrected, DiffractionCheck
from .distortion import Distortion
from .fit import Calibration
from .frames import Array
from .lengths import ImageShare, calibrated_lengths
from .misfit import DISAGREE, Misfit, misfit_of
from .model import QUANTITIES, UNITS, Board, DataSheet, derived
from .noise import MeasuredSensor
from .options import CalibrateOptions
from .planning import camera_of
from .posterior import CameraDraws, Posterior, depth_errors, posterior_accuracy, variance_shares
from .sidedata import Combined, SideDatum, combine
from .space import MediumChange, used_in
from .white_profile import WhiteProfile

SCHEMA = "roslf.calibration/1"
LAPLACE = "Fisher matrix (Laplace)"
LAPLACE_DRAWS = 20_000
_ONE_DEPTH = 0.02
"""Spread of the boards' depths, relative to their mean, below which they stand at one depth."""
_GAUSS = (-1.959964, -0.994458, 0.994458, 1.959964)
"""Ends of a normal law's 95 and 68 % intervals, in standard deviations."""


@dataclass(frozen=True, eq=False)
class _QuantityEstimate:
    """Estimate of one quantity."""

    value: float
    """Value of the best fit."""
    sigma: float
    interval_68: tuple[float, float]
    interval_95: tuple[float, float]
    r_hat: float | None
    """Convergence R-hat of the ensembles; None where nothing was sampled."""
    ess: float | None
    """The smaller of bulk and tail."""
    design: float
    """Value in the design."""
    built_sigma: float
    """Standard deviation of calibrated less design, over cameras that were built as designed: `sigma`, with what a
    main lens of another focal length than the data sheet's does to the camera itself."""

    @property
    def off(self) -> float | None:
        """Calibrated less design [`built_sigma`]; None where nothing is uncertain."""
        return (self.value - self.design) / self.built_sigma if self.built_sigma > 0 else None


@dataclass(frozen=True, eq=False)
class Outcome(BriefValue):
    """Outcome of `roslf calibrate`."""

    design: Design
    """Design that the camera was built to."""
    board: Board
    sheet: DataSheet
    centres: MicrolensCentres
    calibration: Calibration
    diffraction: DiffractionCheck | None
    """Check for microlens diffraction; None where nobody looked for it."""
    undistorted_radius: float | None
    """Radius of undistorted images by the design, Eq. 6 on the sensor [px]; None where it was not used."""
    draws: CameraDraws
    """The posterior's; without one, of Laplace's approximation."""
    depths: Mapping[str, Array]
    """`depth_errors` over the boards' range."""
    shares: Mapping[str, Mapping[str, float]]
    """`variance_shares`."""
    estimates: Mapping[str, _QuantityEstimate]
    """As the main lens sees lengths through what stands before it."""
    ruler: Mapping[str, _QuantityEstimate]
    """H, d_3, d_1, d_f and d_2 as mechanical distances, where elements or glass make them others; else empty."""
    misfit: Misfit
    """Misfit of the joint fit."""
    combined: Combined
    """Combination of the fit with side data, where there are any."""
    warnings: tuple[str, ...]
    seed: int
    distortion: Distortion
    accuracy: Accuracy
    medium: str | None = None
    """Medium that the camera is to be used in, where it is another than that of its boards."""
    sensor: MeasuredSensor = field(default_factory=MeasuredSensor)
    """Sensor as white images and dark frames tell it."""
    white: WhiteProfile | None = None
    """Microlens images of the white image; None where nothing fits."""

    @property
    def used_in(self) -> MediumChange | None:
        """Depths measured in that medium, from the nearest to the farthest board; None for the boards' own.

        Raises
        ------
        DesignError
            The values make no design, or none in that medium.
        """
        if self.medium is None:
            return None
        low, high = self.depths["distance"][[0, -1]]
        return used_in(self.calibrated, self.medium, np.linspace(low, high, 5))

    @property
    def posterior(self) -> Posterior | None:
        """None where it was not asked for: intervals are then the Fisher matrix's."""
        return self.draws if isinstance(self.draws, Posterior) else None

    @property
    def converged(self) -> bool | None:
        """True where the ensembles converged; None where nothing was sampled."""
        return None if self.posterior is None else self.posterior.converged

    @property
    def lengths(self) -> CalibratedLengths:
        """How sure the lengths are that `calibrated` has from here, those of elements before the lens included."""
        return calibrated_lengths(
            self.design, self.draws, self.calibration.fit, self.sheet, self.combined.data, self._images
        )

    @property
    def _images(self) -> ImageShare | None:
        return None if self.white is None or self.white.untold else ImageShare(self.white.share, self.white.sigma[0])

    @cached_property
    def pupil(self) -> tuple[float, float] | None:
        """Effective diameter of the flexible angular plane, of others their width, and its standard error [mm].

        None where the white image does not tell it.
        """
        if self._images is None:
            return None
        lengths = {PATHS[name]: np.asarray(value) for name, value in self._lengths.items()}
        seen = self._images.pupil(self.design, lengths)
        place = next(iter(seen))
        known = self.lengths.covariance
        share = math.sqrt(known.matrix[known.places.index(place), known.places.index(place)]) / float(seen[place])
        value = self.design.D_F * float(seen[place]) / float(Camera.of(self.design)[place])
        return value, share * value

    @property
    def veil(self) -> tuple[float, float] | None:
        """Veil as a share of full scale, and its standard error; None where the white image does not tell it."""
        white = self.white
        if white is None or white.untold or white.full is None or not white.dark:
            return None
        return white.veil / white.full, white.sigma[1] / white.full

    @property
    def _lengths(self) -> dict[str, float]:
        """Lengths that `calibrated` has, with a ruler, but for the pupil's."""
        lengths = {name: (self.ruler or self.estimates)[name].value for name in ("d_3", "d_1", "d_2")}
        return lengths | ({"f": self.combined.f} if self.combined.data else {})

    @property
    def calibrated(self) -> Design:
        """The design with d_3, d_1, d_2, D_F, veil and sensor as measured, f as data sheet and side data have it.

        Errors are in its source.

        Raises
        ------
        DesignError
            The values make no design.
        """
        values = {name: self.estimates[name] for name in ("d_3", "d_1", "d_2", "H")}
        said = ", ".join(f"{n} = {e.value:.6g} ± {e.sigma:.2g} {UNITS[n]}".strip() for n, e in values.items())
        images = len(self.calibration.observations.names)
        known = f"f = {self.sheet.f:.6g} ± {self.sheet.f_sigma:.2g} mm from the data sheet"
        known = ", ".join([known, *(datum.what for datum in self.combined.data)])
        if self.pupil is not None:
            known += ", D_F = {:.6g} ± {:.2g} mm from the white image".format(*self.pupil)
        source = (
            f"roslf calibrate, {images} images of a board, {known}: {said} (standard deviations);"
            f" before: {self.design.name}"
        )
        lengths, pupil, veil = self._lengths, self.pupil, self.veil
        if pupil is not None:
            lengths["D_F"] = pupil[0]
        changes: dict[str, Any] = {"name": f"{self.design.name}, calibrated", "source": source}
        changes |= {f"sensor.{name}": value for name, value in self.sensor.known(self.design.sensor).items()}
        if veil is not None:
            changes["light.veil"] = max(veil[0], 0.0)
        return self.design.replace(changes, **lengths)

    def to_dict(self) -> dict[str, object]:
        """Everything as JSON's types."""
        result, fit = self.calibration, self.calibration.fit
        names = list(fit.covariance.names)
        ways = {"steps_one_and_two": result.second.camera, "joint": result.joint.camera}
        lengths = {way: derived(intrinsics.vector(), self.sheet) for way, intrinsics in ways.items()}
        camera, sigma = fit.camera, fit.covariance.sigma
        posterior_keys = ("message", "acceptance", "steps", "walkers", "r_hat", "bulk_ess", "tail_ess")
        p = self.posterior
        lattice = self.centres.lattice
        systematic = np.sqrt(np.square(fit.systematic).sum(axis=0))
        radius, used, together = self.undistorted_radius, self.used_in, self.lengths
        return {
            "schema": SCHEMA,
            "design": self.design.name,
            "board": self.board.to_dict(),
            "intervals_from": LAPLACE if p is None else "posterior",
            "quantities": {
                name: {
                    "estimate": e.value,
                    "unit": UNITS[name],
                    **{key: value for key, value in asdict(e).items() if key != "value"},
                    "off_design_sigma": e.off,
                    "variance_shares": {s: v for s, v in self.shares[name].items() if s != "sigma"},
                }
                for name, e in self.estimates.items()
            },
            "ruler": {
                name: {"estimate": e.value, "unit": UNITS[name], "sigma": e.sigma, "interval_95": e.interval_95}
                for name, e in self.ruler.items()
            },
            "covariance": together.to_dict(),
            "used_in": None if used is None else used.to_dict(),
            "converged": self.converged,
            "accuracy": self.accuracy.to_dict(),
            "posterior": None if p is None else {name: getattr(p, name) for name in posterior_keys},
            "fit": {name: {"value": float(getattr(camera, name)), "sigma": sigma[name]} for name in names},
            "condition_number": fit.covariance.condition,
            "correlations": {"names": names, "matrix": fit.covariance.correlation.tolist()},
            "other_ways": {
                way: {name: float(by[name]) for name in ("d_1", "d_f", "H", "d_3")} for way, by in lengths.items()
            },
            "diffraction": None if self.diffraction is None else _diffraction_dict(self.diffraction, self.sheet),
            "systematic_sigma": dict(zip(("A", "m", "inverse_d_2"), map(float, systematic), strict=True)),
            "data_sheet": {
                **{f"{name}_mm": getattr(self.sheet, name) for name in ("f", "f_sigma", "q", "d", "d_sigma")},
                "cell_sigma_relative": self.sheet.cell_sigma,
                "elements": {at: {"value": value, "sigma": sigma} for at, value, sigma in self.sheet.uncertain},
            },
            "sensor": self.sensor.to_dict(),
            "pupil": self._pupil_dict(),
            "veil": None if self.veil is None else dict(zip(("share", "sigma"), self.veil, strict=True)),
            "side_data": _side_dict(self.combined, self.draws),
            "reprojection_rms_pitches": result.joint.rms,
            "step_one_rms_pitches": result.first.rms,
            "noise_pitches": result.lines.sigma,
            **_misfit_dict(self.misfit),
            "images_used": list(result.observations.names),
            "images_missing": list(result.observations.missing),
            "views": len(result.observations.views),
            "coordinates": result.observations.count,
            "white_image": {
                "pitch_px": lattice.pitch,
                "rotation_rad": lattice.rotation,
                "layout": lattice.layout,
                "rms_px": self.centres.rms,
                "microlenses": self.centres.counts(),
                "used": int(self.centres.used.sum()),
                "undistorted_radius_px": radius if radius is not None and np.isfinite(radius) else None,
                "profile": None if self.white is None else self.white.to_dict(),
            },
            "depth_errors_mm": {name: values.tolist() for name, values in self.depths.items()},
            "distortion_coefficients": self.distortion.coefficients,
            "distortion": _distortion_dict(self.distortion),
            "seed": self.seed,
            "warnings": list(self.warnings),
        }  # fmt: skip

    def _pupil_dict(self) -> dict[str, object]:
        """Pupil as JSON's types, and why it is not told."""
        value, sigma = self.pupil or (None, None)
        untold = "no microlens images fit" if self.white is None else self.white.untold
        told = {"diameter_mm": value, "sigma_mm": sigma, "design_mm": self.design.D_F, "untold": untold or None}
        return told | {"sigma_of_rim_mm": value and self.white and value * self.white.of_rim}


def outcome_of(
    design: Design,
    sheet: DataSheet,
    centres: MicrolensCentres,
    corrected: Corrected,
    distortion: Distortion,
    draws: CameraDraws,
    options: CalibrateOptions,
    data: Sequence[SideDatum] = (),
) -> Outcome:
    """Put together what came out, with the warnings that follow."""
    calibration, diffraction = corrected
    board, fit = options.checkerboard, calibration.fit
    posterior = draws if isinstance(draws, Posterior) else None
    combined = combine(fit, sheet, data)
    shares = variance_shares(fit, sheet, data)
    best = combined.lengths(sheet)
    designed = derived(camera_of(design).vector(), sheet)
    pulled = _pulled(design, sheet, combined)
    estimates = {
        name: _estimate(
            name, float(best[name]), shares[name]["sigma"], posterior, float(designed[name]),
            shares[name].get("f", 0.0), float(pulled[name]),
        )
        for name in QUANTITIES
    }  # fmt: skip
    ruler = {}
    if sheet.space is not None:
        values, drawn, planned = (
            space.ruler(lengths)
            for lengths in (best, draws.quantities, designed)
            if (space := sheet.space_at(lengths)) is not None
        )
        for name, value in values.items():
            sigma = float(drawn[name].std(ddof=1))
            intervals = _intervals(drawn[name])
            ruler[name] = _QuantityEstimate(float(value), sigma, *intervals, None, None, float(planned[name]), sigma)
    misfit = misfit_of(calibration)
    depth = fit.poses.translation[:, 2]
    # As far as the boards reach, and a fifth more of their depth.
    pupil = float(sheet.apparent(best).pupil)
    distances = pupil + np.linspace(0.8 * float(depth.min()), 1.2 * float(depth.max()), 61)
    depths = depth_errors(draws, fit, sheet, distances, data)
    notes = []
    expected, shown = image_pitch(design), centres.lattice.pitch
    if abs(shown / expected - 1) >= 0.02:
        notes.append(
            f"the microlens images are {shown:.3f} px apart, and the design says {expected:.3f} px: are the design, its"
            " pixel and its microlens pitch those of this camera?"
        )
    elif away := _off_design(estimates, board):
        notes.append(away)
    notes += [*misfit.warnings, *combined.warnings]
    notes += centres.warnings
    if diffraction.warning:
        notes.append(diffraction.warning)
    if calibration.observations.missing:
        notes.append(f"no board found in {', '.join(calibration.observations.missing)}: calibrated from the others")
    if np.ptp(depth) < _ONE_DEPTH * depth.mean():
        notes.append(
            f"the boards stand at one depth, within {np.ptp(depth):.2g} mm of {depth.mean():.4g} mm from the FAP: d_2"
            " and m depend on their tilts alone; spread their distances"
        )
    if posterior is not None and not posterior.converged:
        notes.append(f"the posterior has {posterior.message}; do not trust its intervals")
    return Outcome(
        design, board, sheet, centres, calibration, diffraction, undistorted_radius(design) or None, draws, depths,
        shares, estimates, ruler, misfit, combined, tuple(notes), options.seed, distortion,
        posterior_accuracy(draws, options.accuracy), options.use_in,
    )  # fmt: skip


def _off_design(estimates: Mapping[str, _QuantityEstimate], board: Board) -> str:
    """Which quantities lie far from the design's, and what would explain it; "" where none does."""
    far = {name: e.off for name, e in estimates.items() if e.off is not None and abs(e.off) > DISAGREE}
    if not far:
        return ""
    said = ", ".join(f"{name} {abs(off):.0f} sigma" for name, off in sorted(far.items(), key=lambda one: -abs(one[1])))
    # A board of other cells scales m and d_2 alike and leaves A, all by images alone.
    m, d_2 = (estimates[name] for name in ("m", "d_2"))
    ratio = math.log(m.value / m.design) - math.log(d_2.value / d_2.design)
    apart = {name for name, e in estimates.items() if abs(e.value - e.design) > DISAGREE * e.sigma}
    if (
        {"m", "d_2"} <= apart
        and "A" not in apart
        and abs(ratio) < 2 * math.hypot(*(e.sigma / e.value for e in (m, d_2)))
    ):
        cell = board.cell * m.value / m.design
        return (
            f"far from the design: {said}; m and d_2 would agree with it if the board's cells measured {cell:.4g} mm,"
            f" not {board.cell:g} mm: measure them"
        )
    return (
        f"far from the design: {said}; the camera was built otherwise, or the board's cell, f, pixel or microlens pitch"
        " are not as stated: measure them"
    )


def _pulled(design: Design, sheet: DataSheet, combined: Combined) -> dict[str, Array]:
    """Errors of the estimates where the camera is as designed but f is one `f_sigma` off the data sheet.

    The camera itself is another: m = d_1/f - 1 and A follow its focal length. Estimates count from the data sheet's f,
    or from as much of the true one as side data tell.
    """
    count, nudge = len(combined.names), 0.01 * sheet.f_sigma

    def estimated(step: float) -> dict[str, Array]:
        true = np.concatenate([camera_of(design, sheet.f + step).vector(combined.names), sheet.mean])
        true[count] += step
        state = true - step * combined.keeps[:, count]
        return derived(state[:count], sheet, state[count:])

    ahead, behind = (estimated(step) for step in (nudge, -nudge))
    return {name: (ahead[name] - behind[name]) / 0.02 for name in QUANTITIES}


def _distortion_dict(fitted: Distortion) -> dict[str, object] | None:
    """Distortion as JSON's types; None where none was fitted."""
    if not fitted.coefficients:
        return None
    without = fitted.without
    return {
        "automatic": fitted.automatic,
        "reason": fitted.reason,
        "residual_scales_without": None if without is None else _scales(without),
    }


def _side_dict(combined: Combined, draws: CameraDraws) -> dict[str, object] | None:
    """Estimate of f with side data, as JSON's types; None where there are none."""
    if not combined.data:
        return None
    return {
        "used": [datum.name for datum in combined.data],
        "off_sigma": dict(combined.apart),
        "f_mm": combined.f,
        "f_sigma_mm": float(draws.draws("f").std(ddof=1)),
    }


def _scales(misfit: Misfit) -> dict[str, float]:
    return {"places": misfit.places, "slopes": misfit.slopes, "views": misfit.views}


def _misfit_dict(misfit: Misfit) -> dict[str, object]:
    """Misfit as JSON's types."""
    return {
        "residual_scales": _scales(misfit),
        "remedy": None if misfit.remedy is None else {"what": misfit.remedy.what, "scale": misfit.remedy.scale},
        "ways_apart_sigma": misfit.apart,
        "boards": [
            {
                "image": board.name,
                "corners": board.corners,
                "rms_pitches": board.rms,
                "scale_places": _finite(board.places),
                "scale_slopes": _finite(board.slopes),
                "strays": board.strays,
            }
            for board in misfit.boards
        ],
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _estimate(
    name: str, value: float, sigma: float, posterior: Posterior | None, design: float, share: float, pulled: float
) -> _QuantityEstimate:
    """One quantity; `share` of its variance is the data sheet's f, which pulls it off the design by `pulled`."""
    if posterior is None:
        low, lower, higher, high = (value + end * sigma for end in _GAUSS)
        built = _built_sigma(sigma, share, pulled)
        return _QuantityEstimate(value, sigma, (lower, higher), (low, high), None, None, design, built)
    draws = posterior.quantities[name]
    key = "inverse_d_2" if name == "d_2" else name
    ess = min(posterior.bulk_ess[key], posterior.tail_ess[key])
    spread = float(draws.std(ddof=1))
    built = _built_sigma(spread, share, pulled)
    return _QuantityEstimate(value, spread, *_intervals(draws), posterior.r_hat[key], ess, design, built)


def _built_sigma(sigma: float, share: float, pulled: float) -> float:
    return math.hypot(sigma * math.sqrt(max(1 - share, 0.0)), pulled)


def _intervals(draws: Array) -> tuple[tuple[float, float], tuple[float, float]]:
    """Intervals that hold 68 % and 95 % of the draws."""
    low, lower, higher, high = (float(x) for x in np.quantile(draws, [0.025, 0.16, 0.84, 0.975]))
    return (lower, higher), (low, high)


def _diffraction_dict(check: DiffractionCheck, sheet: DataSheet) -> dict[str, object]:
    """The correction as JSON's types, with what would have come out without it."""
    without = None
    if check.before is not None:
        without = {name: float(value) for name, value in derived(check.before.vector(), sheet).items()}
    return {
        "corrected": check.corrected,
        "reason": check.reason,
        "expected_blur_px": check.expected_blur,
        "seen_blur_px": None if check.image is None else check.image.blur,
        "seen_radius_px": None if check.image is None else check.image.radius,
        "white_image_misfit": check.misfit,
        "largest_shift_pitches": check.largest,
        "baseline": check.baseline,
        "without": without,
    }
