"""How sure the lengths of a calibrated camera are, and what its measurements alone tell of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..bore.part import TEMPERATURE
from ..camera import BESIDE, VIEWING_CONDITIONS, Camera
from ..design import PATHS, Design
from ..theory.exit_pupil import microlens_image_diameter, microlens_image_pitch
from ..theory.length_covariance import CalibratedLengths, LengthCovariance
from .corner_statistics import StatisticsFit
from .frames import Array
from .model import DataSheet
from .posterior import CameraDraws
from .sidedata import NUDGE, SideDatum, combine
from .space import shown_by

KEPT = ("d_3", "d_1", "d_2", "d", "q")
"""Lengths of a design that a calibration tells, before f."""
BOARD = "board"
"""Stands for the board's scale among places."""
UNMOVED = 1e-12
"""Relative change of what corners show that is rounding."""


class ImageShare(NamedTuple):
    """Width of microlens images over their pitch, as a white image shows it."""

    value: float
    sigma: float
    """Standard error, relative to itself."""

    def pupil(self, design: Design, lengths: Mapping[str, Array]) -> dict[str, Array]:
        """Lengths of the flexible angular plane, of which a camera with certain lengths shows such images, by place."""
        camera = Camera.of(design, {**lengths})
        times = self.value / np.exp(_log_share(camera))
        return {f"aperture.{key}": camera[f"aperture.{key}"] * times for key in camera.fap.outline.keys}


def _log_share(camera: Camera) -> Array:
    """Logarithm of the width of microlens images over their pitch."""
    return np.asarray(np.log(np.abs(microlens_image_diameter(camera) / microlens_image_pitch(camera))))


def calibrated_lengths(
    design: Design,
    draws: CameraDraws,
    fit: StatisticsFit,
    sheet: DataSheet,
    data: Sequence[SideDatum] = (),
    images: ImageShare | None = None,
    *,
    planned: bool = False,
) -> CalibratedLengths:
    """A design's calibrated lengths, elements before the lens included: their covariance, and what stands behind it.

    Parameters
    ----------
    design : Design
        That the camera was built to.
    draws : CameraDraws
        Of the camera, data sheet included.
    fit : StatisticsFit
        Whose corners tell A/d, m/d and q A/d_2 of a board of a given scale: carried to lengths by their Jacobian.
    data : sequence of SideDatum
        Measurements beside the corners.
    images : ImageShare, optional
        Of a white image: tells the pupil, too.
    planned : bool
        Whether the calibration is yet to be made.
    """
    drawn = _lengths(draws.quantities, draws.draws("f"), sheet)
    seen = {} if images is None else images.pupil(design, drawn)
    drawn |= seen
    mean = {place: float(np.mean(values)) for place, values in drawn.items()}
    matrix = np.atleast_2d(np.cov(np.stack([*drawn.values()])))
    if images is not None:
        own = images.sigma * np.array([mean[place] * (place in seen) for place in drawn])
        matrix = matrix + np.outer(own, own)
    covariance = LengthCovariance(tuple(drawn), matrix)
    information = _information(design, mean, fit, sheet, data, images)
    told = {PATHS["f"]: sheet.f_sigma, PATHS["d"]: sheet.d_sigma, PATHS["q"]: sheet.q_sigma or np.inf}
    told |= {known.place: known.sigma for known in sheet.uncertain}
    known = np.array([told.get(place, np.inf) for place in information.places])
    return CalibratedLengths(covariance, information, known, planned)


def _lengths(quantities: Mapping[str, Array], f: Array, sheet: DataSheet) -> dict[str, Array]:
    """Lengths with a ruler, by their places in a design."""
    lengths = dict(quantities)
    if (space := sheet.space_at(lengths)) is not None:
        lengths |= space.ruler(lengths)
    own = {PATHS[name]: lengths[name] for name in KEPT} | {PATHS["f"]: f}
    return own | {known.place: lengths[known.place] for known in sheet.uncertain}


def _information(
    design: Design,
    best: Mapping[str, float],
    fit: StatisticsFit,
    sheet: DataSheet,
    data: Sequence[SideDatum],
    images: ImageShare | None,
) -> LengthCovariance:
    """F of corners, side data and microlens images, without the data sheet, about the best lengths [1/mm^2].

    Of all lengths that move what corners show, and all that are calibrated. What else corners depend on (axis,
    distortion, the board's scale, which its maker knows) is eliminated.
    """
    known, count = combine(fit, sheet, data), len(fit.covariance.names)
    spread = fit.covariance.matrix.copy()
    spread[:3, :3] += fit.systematic.T @ fit.systematic
    # States in units of standard deviations, or of themselves.
    unit = np.concatenate([np.sqrt(np.diag(spread)), known.best[count:]])
    jacobian = known.jacobian * unit
    information = jacobian.T @ jacobian
    information[:count, :count] += np.linalg.inv(spread / np.outer(unit[:count], unit[:count]))
    if sheet.cell_sigma > 0:
        information[count + 3, count + 3] += (unit[count + 3] / sheet.cell_sigma) ** 2
    kept, lost = [*range(3), *range(count, len(unit))], range(3, count)
    mixed = information[np.ix_(kept, lost)]
    alone = information[np.ix_(kept, kept)] - mixed @ np.linalg.solve(information[np.ix_(lost, lost)], mixed.T)
    places, rates = _rates(design, best, sheet, images is not None)
    # The states of lengths, and of the board's scale, the last: m as fitted grows with it, 1/d_2 falls.
    known_places = [PATHS["f"], PATHS["q"], PATHS["d"], BOARD, *(number.place for number in sheet.uncertain)]
    own = np.array([[float(place == row) for place in (*places, BOARD)] for row in known_places])
    by_board = np.array([0.0, known.best[1], -known.best[2]])
    carried = np.concatenate([np.column_stack([rates[:3], by_board]), own]) / unit[kept, None]
    whole = carried.T @ alone @ carried
    told = whole[:-1, :-1]
    if sheet.cell_sigma > 0:
        told = told - np.outer(whole[:-1, -1], whole[-1, :-1]) / whole[-1, -1]
    if images is not None:
        told = told + np.outer(rates[3], rates[3]) / images.sigma**2
    return LengthCovariance(places, (told + told.T) / 2)


def _rates(design: Design, best: Mapping[str, float], sheet: DataSheet, pupil: bool) -> tuple[tuple[str, ...], Array]:
    """Lengths that move A, m and 1/d_2 as corners show them, with all calibrated ones, and how fast, shape (3, n).

    With the `pupil` also what moves the logarithm of its images' share of the pitch, in a fourth row.
    """
    numbers = {**Camera.of(design).numbers, **best}
    left_out = {PATHS["d_f"], PATHS["wavelength"], TEMPERATURE, *BESIDE, *VIEWING_CONDITIONS}
    values = {place: float(number) for place, number in numbers.items() if place not in left_out}
    steps = NUDGE * np.maximum(np.abs([*values.values()]), 1e-3)
    offsets = np.concatenate([np.diag(steps), -np.diag(steps)], axis=1)
    changes = {place: value + row for (place, value), row in zip(values.items(), offsets, strict=True)}
    shown, camera = shown_by(design, changes), Camera.of(design, changes)
    d, q = camera.d / sheet.d, camera.q / sheet.q
    told = np.stack(
        np.broadcast_arrays(shown.A / d, shown.m / d, q * d / shown.d_2, *([_log_share(camera)] if pupil else []))
    )
    ahead, behind = np.split(told, 2, axis=1)
    scale = np.append(told[:3].mean(axis=1), np.ones(len(told) - 3))
    moves = np.abs((ahead - behind) / scale[:, None]).max(axis=0) > UNMOVED
    moves |= np.isin([*values], [*best])
    return tuple(np.array([*values])[moves].tolist()), ((ahead - behind) / (2 * steps))[:, moves]
