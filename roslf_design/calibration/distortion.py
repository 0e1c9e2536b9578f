"""How much distortion a calibration fits: as asked, as the design's main lens is real, or as residuals ask for it."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from .diffraction import Corrected
from .fit import VISIBLE, Calibration
from .frames import CalibrationError
from .misfit import Misfit, misfit_of
from .model import MOST_RADIAL


class Distortion(NamedTuple):
    """Distortion of the main lens that was fitted, and why."""

    coefficients: int
    """Radial ones; the field's curvature and the growth of the views' baseline go with them."""
    reason: str
    """As a clause that begins with "as"."""
    automatic: bool = True
    """False where it was asked for."""
    without: Misfit | None = None
    """Misfit of a fit without distortion; None where none was fitted, or asked for, or without it there is no camera.
    """


def with_distortion(
    fit: Callable[[int], Corrected], plain: Callable[[Corrected], Calibration], lens: str | None, asked: int | None
) -> tuple[Corrected, Distortion]:
    """A calibration with as much distortion as is called for.

    Parameters
    ----------
    fit : callable
        The calibration with so many radial coefficients.
    plain : callable
        The fit of the same corners without distortion.
    lens : str, optional
        What the design's main lens is called; None where it is ideal.
    asked : int, optional
        Radial coefficients, whatever residuals say; None leaves the choice to lens and residuals.

    Raises
    ------
    CalibrationError
        As of `fit`, with the fewest coefficients that were tried.
    """
    if asked is not None:
        return fit(asked), Distortion(asked, "as asked for", automatic=False)
    count, reason, without = 0, "as residuals ask for it", None
    if lens is not None:
        count, reason = 1, f"as the design's main lens is real ({lens})"
    try:
        found = fit(count)
    except CalibrationError as error:
        if count == MOST_RADIAL:
            raise
        try:  # distortion that is left out can hide how boards are tilted
            count, found = count + 1, fit(count + 1)
        except CalibrationError:
            raise error from None
    else:
        without = _without(found, plain, count)
    misfit = misfit_of(found.calibration)
    # To first order alone strong distortion can look like none.
    while count < MOST_RADIAL and misfit.scale > VISIBLE and (misfit.remedy is None or misfit.remedy.distortion):
        more = count + 1 if misfit.remedy is None else misfit.remedy.distortion
        try:
            other = fit(more)
        except CalibrationError:
            break
        left = misfit_of(other.calibration)
        if left.scale >= max(VISIBLE, misfit.scale / 2):
            break
        found, count, misfit = other, more, left
    if count == 0:
        return found, Distortion(0, "as the design's main lens is ideal and residuals do not ask for it")
    return found, Distortion(count, reason, without=without)


def _without(found: Corrected, plain: Callable[[Corrected], Calibration], count: int) -> Misfit | None:
    try:
        return misfit_of(plain(found) if count else found.calibration)
    except CalibrationError:
        return None
