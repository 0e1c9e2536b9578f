"""Before anyone captures an image: how well a calibration will do, and which change would help most."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .board import Board
from .consequences import variance_shares
from .corner_statistics import corner_statistics
from .datasheet import DataSheet
from .errors import CalibrationError
from .fisher import undetermined
from .model import Camera
from .refine import shared_names
from .statistics_fit import StatisticsFit, fit_at
from .synthetic import Captures, ideal_observations, random_poses

if TYPE_CHECKING:
    from ..design.design import Design

_STEEPEST = math.radians(40.0)
"""Beyond this tilt corners are no longer found well."""


class Expected(NamedTuple):
    """Standard deviations that a plan promises."""

    sigma: dict[str, float]
    """Of A, m, d_2, d_1, d_f, H, d_3 [mm or 1]: medians over random sets of poses."""
    shares: dict[str, dict[str, float]]
    """For each, what share of its variance comes from images, f, q, d and the board."""
    condition: float
    """Of the fit."""
    correlation: float
    """Between A and 1/d_2, the ridge along which calibrations err."""


class Change(NamedTuple):
    """One way to do better."""

    what: str
    captures: Captures
    sheet: DataSheet
    expected: Expected

    def gain(self, before: Expected, name: str = "d_3") -> float:
        """Standard deviation before over after."""
        return before.sigma[name] / self.expected.sigma[name]


class Plan(NamedTuple):
    """What a set of captures promises, and the changes ranked."""

    captures: Captures
    expected: Expected
    changes: tuple[Change, ...]
    """Best first, by d_3."""

    @property
    def advice(self) -> str:
        """What to change first, in one sentence."""
        best = self.changes[0]
        before, after = self.expected.sigma, best.expected.sigma
        return (
            f"{best.what}: d_3 to ±{after['d_3']:.2g} mm instead of ±{before['d_3']:.2g} mm,"
            f" H to ±{after['H']:.2g} instead of ±{before['H']:.2g}"
        )


def camera_of(design: Design) -> Camera:
    """The calibration's parameters of a design, the axis at the middle of its array."""
    m = design.d_1 / design.d_f
    width, height = (size / design.d for size in design.sensor_size)
    return Camera(design.d_1 - m * design.d_3, m, 1 / design.d_2, width / 2, height / 2, q=design.q, d=design.d)


def sheet_of(design: Design, f_relative: float = 0.01, d_relative: float = 1e-3, cell_sigma: float = 1e-3) -> DataSheet:
    """Data-sheet values of a design with relative standard deviations of f, d and the board's cell."""
    return DataSheet(
        design.f, design.q, design.d, f_relative * design.f, d_sigma=d_relative * design.d, cell_sigma=cell_sigma
    )


def expected_errors(
    camera: Camera, sheet: DataSheet, captures: Captures, *, distortion: int = 0, seed: int = 0, samples: int = 8
) -> Expected:
    """Standard deviations from the Fisher matrix, poses eliminated, data-sheet errors added.

    Parameters
    ----------
    camera : Camera
        The design's.
    sheet : DataSheet
    captures : Captures
        Boards, tilts, distances, noise.
    distortion : int
        Radial coefficients that the calibration will fit.
    seed : int
        Of the random poses.
    samples : int
        Sets of poses; the median is reported.

    Raises
    ------
    CalibrationError
        The captures do not determine A, m or d_2, and says why.
    """
    names = shared_names(distortion)
    d_3 = sheet.f + (sheet.f - camera.A) / camera.m
    if captures.distance - captures.distance_range / 2 <= d_3:
        raise CalibrationError(
            f"boards at {captures.distance:g} ± {captures.distance_range / 2:g} mm reach into the bore: the FAP is at"
            f" {d_3:.1f} mm from the lens"
        )
    if captures.views == 1 or captures.boards == 1:
        raise CalibrationError(f"these captures do not determine A, m and d_2: {reason(captures)}")
    found, fits = [], []
    for k in range(samples):
        rng = np.random.default_rng([seed, k])
        poses = random_poses(captures, d_3, rng)
        statistics = corner_statistics(ideal_observations(camera, poses, captures), captures.noise)
        fit = fit_at(statistics, camera, poses, names)
        lost = undetermined(fit.covariance, {"A": camera.A, "m": camera.m, "inverse_d_2": camera.inverse_d_2})
        if lost:
            raise CalibrationError(f"these captures do not determine {', '.join(lost)}: {reason(captures)}")
        fits.append(fit)
        found.append(variance_shares(fit, sheet))
    middle = {n: float(np.median([f[n]["sigma"] for f in found])) for n in found[0]}
    order = int(np.argsort([f["d_3"]["sigma"] for f in found])[len(found) // 2])
    shares = {n: {s: v for s, v in part.items() if s != "sigma"} for n, part in found[order].items()}
    typical: StatisticsFit = fits[order]
    correlation = float(typical.covariance.correlation[0, 2])
    return Expected(middle, shares, typical.covariance.condition, correlation)


def plan(
    camera: Camera, sheet: DataSheet, captures: Captures, *, distortion: int = 0, seed: int = 0, samples: int = 8
) -> Plan:
    """Expected errors of a set of captures, and of those that differ from it by one change, best first.

    Parameters and errors as in `expected_errors`; a change that cannot be made (a tilt beyond 40 degrees, boards in
    the bore) is left out.
    """
    before = expected_errors(camera, sheet, captures, distortion=distortion, seed=seed, samples=samples)
    changes = []
    for what, other, known in _alternatives(captures, sheet):
        try:
            after = expected_errors(camera, known, other, distortion=distortion, seed=seed, samples=samples)
        except CalibrationError:
            continue
        changes.append(Change(what, other, known, after))
    changes.sort(key=lambda change: change.expected.sigma["d_3"])
    return Plan(captures, before, tuple(changes))


def reason(captures: Captures) -> str:
    """Why captures leave a parameter open."""
    if captures.tilt < math.radians(3.0):
        tilts = f"tilts up to {math.degrees(captures.tilt):.1f} degrees"
        return f"the boards are all parallel ({tilts}); tilt them by up to 20 degrees"
    if captures.boards == 1:
        return "one image of the board cannot tell its distance from A; show two or more, tilted differently"
    if captures.views == 1:
        return "there is one view only, and d_2 and m need a baseline"
    if captures.distance_range < 0.02 * captures.distance:
        return "the boards stand at one depth; spread their distances"
    return "too few boards, too small tilts or too much noise"


def _alternatives(captures: Captures, sheet: DataSheet) -> Sequence[tuple[str, Captures, DataSheet]]:
    board = captures.board
    tilt = min(max(1.5 * captures.tilt, math.radians(10.0)), _STEEPEST)
    finer = Board(2 * board.columns, 2 * board.rows, board.cell / 2)
    larger = Board(2 * board.columns - 1, 2 * board.rows - 1, board.cell)
    options = [
        (
            f"show {2 * captures.boards} boards instead of {captures.boards}",
            replace(captures, boards=2 * captures.boards),
            sheet,
        ),
        (
            f"spread the distances over {2 * captures.distance_range:g} mm",
            replace(captures, distance_range=2 * captures.distance_range),
            sheet,
        ),
        ("halve the corner noise", replace(captures, noise=captures.noise / 2), sheet),
        (
            f"use a board of {larger.columns} x {larger.rows} cells of the same size",
            replace(captures, board=larger),
            sheet,
        ),
        (f"use cells of {finer.cell:g} mm on the same board", replace(captures, board=finer), sheet),
        ("know f twice as well", captures, replace(sheet, f_sigma=sheet.f_sigma / 2)),
        ("know the microlens pitch twice as well", captures, replace(sheet, d_sigma=sheet.d_sigma / 2)),
        ("know the board's scale twice as well", captures, replace(sheet, cell_sigma=sheet.cell_sigma / 2)),
    ]
    if tilt > 1.01 * captures.tilt:
        said = f"tilt the boards by up to {math.degrees(tilt):.0f} degrees instead of {math.degrees(captures.tilt):.0f}"
        options.append((said, replace(captures, tilt=tilt), sheet))
    return options
