"""Microlens diffraction taken off the corners: its size read from the white image, its effect computed view by view.

A sample of the view s' gets light from all over the pupil's blurred image and from neighbouring microlenses. Towards
the image's rim ever more of it comes from further inside and from next door, so corners move less from view to view
than Eq. 12 says: left alone, this shortens the baseline and makes d_2 too large (13 % in the paper's camera). The
white image shows the same blur on an even scene: its cell gives the pupil's radius and the blur, and with them the
displacement of every corner follows (`apparent_shifts`), which is subtracted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..design import Design
from ..effects.field import blur_width, image_diameter
from .apparent_corners import apparent_shifts
from .board import Board, Observations
from .calibrate import Calibration, calibrate
from .corners import fit_window
from .datasheet import DataSheet
from .errors import CalibrationError
from .lattice import Array, CentreLattice
from .lines import fit_lines
from .model import Camera
from .pupil_image import PupilImage, ViewWeights, view_weights
from .view_agreement import camera_vector, view_disagreement
from .white_cell import fit_cell, white_cell

Wish = Literal["auto", "on", "off"]
SMALL = 0.1
"""Blur [px] below which diffraction is left alone: the budget of rendered images."""
SHARE = 0.05
"""Standard deviation of the correction, relative to itself: what the incoherent model and the fit of one corner to a
sum of many leave open. Against rendered boards it errs by 2 to 5 %."""
UNLIKE = 0.05
"""RMS difference between a white image's cell and a blurred disc above which it is something else."""
FAINT = 0.3
"""Share of the design's blur below which the white image's is not taken for diffraction."""
_ROUNDS = 4


@dataclass(frozen=True, eq=False)
class Diffraction:
    """What was found out about microlens diffraction, and done."""

    corrected: bool
    reason: str
    """Why, or why not, as a sentence."""
    expected_blur: float
    """Of the design, lambda d_2/d [px]."""
    image: PupilImage | None = None
    """As the white image has it; None where it was not looked at."""
    misfit: float = 0.0
    """RMS difference between the white image's cell and `image`, relative to the mean."""
    largest: float = 0.0
    """Longest displacement taken off a corner [pitches]."""
    baseline: float | None = None
    """Length of the views' baseline over what pixels say, by the d_2 fitted with and without; None as `before`."""
    before: Camera | None = None
    """The joint fit without the correction; None where there was none to make, or it fails."""
    rms_before: float = 0.0
    """Its reprojection RMS [pitches]."""
    shifts: Array | None = None
    """What was taken off the corners [pitches], shape (b, v, n, 2)."""
    warning: str = ""
    """Where the design and the white image do not agree; empty where they do."""


class Corrected(NamedTuple):
    """A calibration with diffraction taken off."""

    calibration: Calibration
    diffraction: Diffraction


def calibrate_corrected(
    observations: Observations,
    board: Board,
    sheet: DataSheet,
    design: Design,
    white: ArrayLike,
    lattice: CentreLattice,
    *,
    dark: ArrayLike | None = None,
    distortion: int = 0,
    guess: float | None = None,
    wish: Wish = "auto",
) -> Corrected:
    """Calibrate, with microlens diffraction taken off where it matters.

    Parameters
    ----------
    observations : Observations
        Corners as measured.
    board : Board
    sheet : DataSheet
    design : Design
        That the camera was built to: lambda, D_F, shape of the microlenses.
    white, dark : array_like
        White image, frame without light.
    lattice : CentreLattice
        Of the microlens images.
    distortion, guess
        As in `calibrate`.
    wish : {"auto", "on", "off"}
        "auto" corrects where the design's blur exceeds 0.1 px and the white image shows it.

    Returns
    -------
    Corrected
        The fit's `systematic` holds the correction's own uncertainty (5 % of what it changed, and the difference
        between the white image's pupil image and the one that the design and the calibration predict) and what inner
        and outer views disagree on (`view_disagreement`).

    Raises
    ------
    CalibrationError
        As `calibrate`.
    """
    seen = _looked_at(design, white, dark, lattice, wish)
    if not seen.corrected or seen.image is None:
        plain = calibrate(observations, sheet, distortion=distortion, guess=guess)
        return Corrected(_with_systematic(plain, view_disagreement(observations, plain, sheet, distortion)), seen)
    straight = _straightened(observations, board, seen.image)
    shifts = observations.uv - straight.uv
    found = calibrate(straight, sheet, distortion=distortion, guess=guess)
    predicted = _predicted(design, found.joint.camera, seen.image)
    others = (
        replace(straight, uv=straight.uv + SHARE * shifts),
        _straightened(observations, board, predicted, start=straight),
    )
    moved = [calibrate(other, sheet, distortion=distortion, guess=found.fit.camera.A) for other in others]
    own = np.stack([camera_vector(other) - camera_vector(found) for other in moved])
    systematic = np.concatenate([own, view_disagreement(straight, found, sheet, distortion)])
    said = replace(seen, largest=float(np.nanmax(np.hypot(*np.moveaxis(shifts, -1, 0)))), shifts=shifts)
    try:
        plain = calibrate(observations, sheet, distortion=distortion, guess=found.fit.camera.A)
    except CalibrationError:  # left in, diffraction can spoil a fit that without it stands
        return Corrected(_with_systematic(found, systematic), said)
    said = replace(
        said,
        baseline=plain.joint.camera.inverse_d_2 / found.joint.camera.inverse_d_2,
        before=plain.joint.camera,
        rms_before=plain.joint.rms,
    )
    return Corrected(_with_systematic(found, systematic), said)


def _with_systematic(found: Calibration, systematic: Array) -> Calibration:
    return replace(found, fit=found.fit._replace(systematic=systematic))


def _looked_at(
    design: Design, white: ArrayLike, dark: ArrayLike | None, lattice: CentreLattice, wish: Wish
) -> Diffraction:
    """Whether to correct, and with what pupil image."""
    expected = blur_width(design, design.wavelength) / design.q
    if wish == "off":
        return Diffraction(False, "Microlens diffraction was left alone, as asked", expected)
    if wish == "auto" and expected < SMALL:
        return Diffraction(
            False, f"The design's microlens diffraction, {expected:.2g} px, is too small to matter", expected
        )
    start = PupilImage(
        image_diameter(design) / (2 * design.q),
        max(expected, SMALL),
        lattice.pitch,
        lattice.layout,
        design.microlens_array.lens_shape == "circular",
    )
    cell = white_cell(white, lattice, dark)
    waves, rays = fit_cell(cell, start, blurred=True), fit_cell(cell, start, blurred=False)
    blurred = waves.image.blur > max(SMALL, FAINT * expected) and waves.misfit < rays.misfit
    best, warning = waves if blurred or wish == "on" else rays, ""
    if best.misfit > UNLIKE:
        warning = (
            f"the white image's microlens images differ by {100 * best.misfit:.0f} % RMS from evenly lit discs, blurred"
            " or not: what diffraction does to the corners cannot be told from it"
        )
    if wish == "auto" and (best is rays or warning):
        why = f"The white image shows no microlens diffraction where the design has {expected:.2g} px of it"
        if warning:
            why = f"The design has {expected:.2g} px of microlens diffraction"
        return Diffraction(False, f"{why}: none was taken off", expected, best.image, best.misfit, warning=warning)
    if not warning and abs(waves.image.blur / expected - 1) > 0.2:
        warning = (
            f"the white image is blurred by {waves.image.blur:.2f} px where the design's diffraction makes"
            f" {expected:.2f} px: are its wavelength, its d_2 and its pixel those of this camera?"
        )
    why = f"Microlens diffraction blurs by {waves.image.blur:.2f} px, as the white image shows, and was taken off"
    return Diffraction(True, why, expected, waves.image, waves.misfit, warning=warning)


def _straightened(
    observations: Observations, board: Board, image: PupilImage, start: Observations | None = None
) -> Observations:
    """Corners where they would be without diffraction; their slopes are found along, from those of `start`."""
    weights = view_weights(image, observations.views)
    slopes = fit_lines(observations if start is None else start).slope
    central = fit_lines(observations).central
    uv = observations.uv
    for _ in range(_ROUNDS):
        shift = np.stack(
            [_shift_of_board(weights, slopes[b], central[b], board, image.circular) for b in range(len(slopes))]
        )
        uv = observations.uv - shift
        now = fit_lines(replace(observations, uv=uv)).slope
        change = float(np.nanmax(np.abs(now - slopes)))
        slopes = now
        if change < 1e-4:
            break
    return replace(observations, uv=uv)


def _shift_of_board(weights: ViewWeights, slopes: Array, central: Array, board: Board, circular: bool) -> Array:
    """Displacement of a board's corners in all views, shape (v, n, 2): at three slopes, and a parabola between."""
    low, high = float(np.nanmin(slopes)), float(np.nanmax(slopes))
    middle, half = 0.5 * (low + high), max(0.5 * (high - low), 5e-3)
    at = middle + half * np.array([-1.0, 0.0, 1.0])
    edges, window = fit_window(central, board)
    shift = apparent_shifts(weights, at, edges, window, circular)
    x = ((np.where(np.isfinite(slopes), slopes, middle) - middle) / half)[None, :, None]
    before, centre, after = (shift[:, k, None] for k in range(3))
    return np.asarray(centre + 0.5 * x * (after - before) + 0.5 * x * x * (before + after - 2 * centre))


def _predicted(design: Design, camera: Camera, seen: PupilImage) -> PupilImage:
    """The pupil image that D_F, lambda and the calibrated d_2 and A make."""
    d_2 = 1 / camera.inverse_d_2
    radius = design.D_F / 2 * d_2 / (camera.A * design.q)
    blur = design.wavelength * d_2 / (design.d * design.q)
    return replace(seen, radius=radius, blur=blur)
