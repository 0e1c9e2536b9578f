"""Microlens diffraction taken off the corners: its size read from the white image, its effect computed view by view.

A sample of the view s' gets light from all over the pupil's blurred image and from neighbouring microlenses. Towards
the image's rim ever more of it comes from further inside and from next door, so corners move less from view to view
than Eq. 12 says: left alone, this shortens the baseline and makes d_2 too large (13 % in the paper's camera). The
white image shows the same blur on an even scene: its cell gives the pupil's radius and the blur, and with them the
displacement of every corner follows (`_apparent_shifts`), which is subtracted.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .._arrays import sunflower
from .._jit import WHOLE, Band, kernel, prange
from ..camera import Camera
from ..design import Design
from ..theory.lens_shapes import LENS_SHAPES
from ..theory.light import diffraction_width
from .aberrations import aberration_error
from .corners import fit_saddles, fit_window
from .epilines import fit_lines
from .fit import Calibration, calibrate
from .frames import Array, CalibrationError, grey_frame
from .lattice import CentreLattice
from .model import GLOBALS, Board, DataSheet, Intrinsics, Observations, derived
from .pupil_image import RINGS, PupilImage
from .white_profile import ImageFit, ImageSamples

DiffractionMode = Literal["auto", "on", "off"]
_SMALL = 0.1
"""Blur [px] below which diffraction is left alone: the budget of rendered images."""
_SHARE = 0.05
"""Standard deviation of the correction, relative to itself: what the incoherent model and the fit of one corner to a
sum of many leave open. Against rendered boards it errs by 2 to 5 %."""
_UNLIKE = 0.05
"""RMS difference between a white image's cell and a blurred pupil above which it is something else."""
_FAINT = 0.3
"""Share of the design's blur below which the white image's is not taken for diffraction."""
_ROUNDS = 4
_STEP = 0.25
"""Grid on which the blur is tabulated [px]."""
_HALF = 24
"""Microlenses to each side of the middle of the white image that are averaged."""
_INNER = 0.75
"""Views within this share of the outermost one's distance from the centre count as inner."""
_FINE = 8
"""Bins per pitch in which shifted corners are counted."""
_PER_BLUR = 4.0
"""Places on the pupil per width of the blur, along a line: fewer, and a view's light comes from beside the view."""
_PHASES = np.array([[0.25, 0.25], [-0.25, 0.25], [0.25, -0.25], [-0.25, -0.25]])
"""Places between samples [samples] at which a corner is looked at: it comes to lie otherwise at each, and between these
that cancels, by symmetry and to second order."""
_SLOPES = 5
"""Slopes over a board's range at which displacements are computed."""
_DIM = 1e-7
"""Share of a view's light from one place that is passed over."""
_PARTS = 5
"""Places across a microlens's aperture, per axis."""
_NAMES = GLOBALS[:3]


@dataclass(frozen=True, eq=False)
class DiffractionCheck:
    """Result of looking for microlens diffraction in the white image, and what was taken off the corners."""

    corrected: bool
    reason: str
    """Reason why it was taken off, or not, as a sentence."""
    expected_blur: float
    """Blur of the design, lambda d_2/d [px]."""
    image: PupilImage | None = None
    """As the white image has it; None where it was not looked at."""
    misfit: float = 0.0
    """RMS difference between the white image's cell and `image`, relative to the mean."""
    largest: float = 0.0
    """Longest displacement taken off a corner [pitches]."""
    baseline: float | None = None
    """Length of the views' baseline over what pixels say, by the d_2 fitted with and without; None as `before`."""
    before: Intrinsics | None = None
    """The joint fit without the correction; None where there was none to make, or it fails."""
    rms_before: float = 0.0
    """Reprojection RMS of the fit before [pitches]."""
    shifts: Array | None = None
    """Displacements taken off the corners [pitches], shape (b, v, n, 2)."""
    warning: str = ""
    """Where the design and the white image do not agree; empty where they do."""


class WhiteImage(NamedTuple):
    """An image of an even surface, and the lattice of microlens images in it."""

    pixels: ArrayLike
    dark: ArrayLike | None
    """Frame without light."""
    lattice: CentreLattice

    def samples(self) -> ImageSamples:
        """Pixels of the microlens images in its middle; at least three."""
        frame, lattice = grey_frame(self.pixels, self.dark, "white image"), self.lattice
        middle = np.round(lattice.indices((np.array(frame.shape[::-1]) - 1) / 2))
        inside = lattice.inside((frame.shape[0], frame.shape[1]), margin=lattice.pitch)
        near = inside[(np.abs(inside - middle) <= _HALF).all(axis=1)]
        if len(near) < 3:
            raise CalibrationError("the middle of the white image holds too few whole microlens images")
        return ImageSamples.of(frame, lattice, lattice.nodes(*near.T))


class Corrected(NamedTuple):
    """A calibration with diffraction taken off."""

    calibration: Calibration
    diffraction: DiffractionCheck


class Corners(NamedTuple):
    """Corners of boards and what diffraction did to them, to be calibrated with little distortion or much."""

    measured: Observations
    straight: Observations
    """Without diffraction where it matters; else as measured."""
    board: Board
    design: Design
    bent: bool
    """Whether the lattice of microlens images is."""
    check: DiffractionCheck

    @classmethod
    def of(
        cls, observations: Observations, board: Board, design: Design, white: WhiteImage, wish: DiffractionMode
    ) -> Corners:
        """Corners of a camera that was built to a design, whose white image tells what its microlenses diffract.

        Parameters
        ----------
        observations : Observations
            Corners as measured.
        design : Design
            That the camera was built to: lambda, D_F, shape of the microlenses.
        wish : {"auto", "on", "off"}
            "auto" corrects where the design's blur exceeds 0.1 px and the white image shows it.
        """
        check, straight = _looked_at(design, white, wish), observations
        if check.corrected and check.image is not None:
            straight = _straightened(observations, board, check.image)
        return cls(observations, straight, board, design, white.lattice.bend is not None, check)

    def calibrated(self, sheet: DataSheet, distortion: int = 0, guess: float | None = None) -> Corrected:
        """Calibration with microlens diffraction taken off where it matters; arguments and errors as of `calibrate`.

        The fit's `systematic` holds the correction's own uncertainty (5 % of what it changed, and the difference
        between the white image's pupil image and the one that the design and the calibration predict), what inner and
        outer views disagree on (`_view_disagreement`) and what a real main lens does beyond the model
        (`aberration_error`).
        """
        observations, straight, board, design, bent, check = self
        if not check.corrected or check.image is None:
            plain = calibrate(observations, sheet, distortion=distortion, guess=guess)
            left = _view_disagreement(observations, plain, sheet, distortion)
            systematic = np.concatenate([left, aberration_error(plain, sheet, design, distortion, bent)])
            return Corrected(replace(plain, fit=plain.fit._replace(systematic=systematic)), check)
        shifts = observations.uv - straight.uv
        result = calibrate(straight, sheet, distortion=distortion, guess=guess)
        camera, lengths = result.fit.camera, derived(result.joint.camera.vector(), sheet)
        # The pupil image that the FAP, lambda and the calibrated d_2 and A make.
        d_2 = float(lengths["d_2"])
        radius = abs(float(Camera.of(design).fap.radius)) * d_2 / (abs(float(lengths["A"])) * design.q)
        predicted = replace(check.image, radius=radius, blur=design.wavelength * d_2 / (design.d * design.q))
        others = (
            replace(straight, uv=straight.uv + _SHARE * shifts),
            _straightened(observations, board, predicted, start=straight),
        )
        moved = [calibrate(other, sheet, distortion=distortion, guess=camera.A).fit.camera for other in others]
        own = np.stack([other.vector(_NAMES) - camera.vector(_NAMES) for other in moved])
        left = _view_disagreement(straight, result, sheet, distortion)
        systematic = np.concatenate([own, left, aberration_error(result, sheet, design, distortion, bent)])
        result = replace(result, fit=result.fit._replace(systematic=systematic))
        check = replace(check, largest=float(np.nanmax(np.hypot(*np.moveaxis(shifts, -1, 0)))), shifts=shifts)
        try:
            plain = calibrate(observations, sheet, distortion=distortion, guess=camera.A)
        except CalibrationError:  # left in, diffraction can spoil a fit that without it stands
            return Corrected(result, check)
        baseline = plain.joint.camera.inverse_d_2 / result.joint.camera.inverse_d_2
        return Corrected(
            result, replace(check, baseline=baseline, before=plain.joint.camera, rms_before=plain.joint.rms)
        )


def _looked_at(design: Design, white: WhiteImage, wish: DiffractionMode) -> DiffractionCheck:
    """Whether to correct, and with what pupil image."""
    c = Camera.of(design)
    expected = float(diffraction_width(c) / c.q)
    if wish == "off":
        return DiffractionCheck(False, "Microlens diffraction was left alone, as asked", expected)
    if wish == "auto" and expected < _SMALL:
        return DiffractionCheck(
            False, f"The design's microlens diffraction, {expected:.2g} px, is too small to matter", expected
        )
    pupil = c.fap.outline
    start = PupilImage.designed(design, white.lattice)
    start = replace(start, blur=max(expected, _SMALL), spread=0.0)
    samples, starts = white.samples(), [start, replace(start, radius=0.45 * start.pitch)]
    waves = ImageFit.best(samples, white.lattice, starts)
    rays = ImageFit.best(samples, white.lattice, [replace(one, blur=0.0) for one in starts], ("radius",))
    blurred = waves.image.blur > max(_SMALL, _FAINT * expected) and waves.misfit < rays.misfit
    best, warning = waves if blurred or wish == "on" else rays, ""
    if best.misfit > _UNLIKE:
        warning = (
            f"the white image's microlens images differ by {100 * best.misfit:.0f} % RMS from evenly lit {pupil.kind}s,"
            " blurred or not: what diffraction does to the corners cannot be determined from it"
        )
    if wish == "auto" and (best is rays or warning):
        why = "The design" if warning else "The white image shows no microlens diffraction where the design"
        why += f" has {expected:.2g} px of {'microlens diffraction' if warning else 'it'}: none was taken off"
        return DiffractionCheck(False, why, expected, best.image, best.misfit, warning=warning)
    if not warning and abs(waves.image.blur / expected - 1) > 0.2:
        warning = (
            f"the white image is blurred by {waves.image.blur:.2f} px where the design's diffraction makes"
            f" {expected:.2f} px: are its wavelength, its d_2 and its pixel those of this camera?"
        )
    why = f"Microlens diffraction blurs by {waves.image.blur:.2f} px, as the white image shows, and was taken off"
    return DiffractionCheck(True, why, expected, waves.image, waves.misfit, warning=warning)


def _straightened(
    observations: Observations, board: Board, image: PupilImage, start: Observations | None = None
) -> Observations:
    """Corners where they would be without diffraction; their slopes are found along, from those of `start`."""
    weights = _view_weights(image, observations.views)
    slopes = fit_lines(observations if start is None else start).slope
    central = fit_lines(observations).central
    tables = [_shifts_of_board(weights, *one, board, image.lens_shape) for one in zip(slopes, central, strict=True)]
    for _ in range(_ROUNDS):
        shift = np.stack([table.at(own) for table, own in zip(tables, slopes, strict=True)])
        straight = replace(observations, uv=observations.uv - shift)
        before, slopes = slopes, fit_lines(straight).slope
        if np.nanmax(np.abs(slopes - before)) < 1e-4:
            break
    return straight


class _ShiftTable(NamedTuple):
    """Displacements of a board's corners at some slopes, equally far apart."""

    slopes: Array
    """[pitches/px], shape (k,)."""
    shifts: Array
    """[pitches], shape (v, k, 2)."""

    def at(self, slopes: Array) -> Array:
        """Displacement of corners in all views by straight lines, shape (v, n, 2); the middle one's without slope."""
        x = (slopes - self.slopes[0]) / (self.slopes[1] - self.slopes[0])
        x = np.where(np.isfinite(x), x, 0.5 * (len(self.slopes) - 1))
        before = np.clip(x.astype(int), 0, len(self.slopes) - 2)
        part = (x - before)[None, :, None]
        return np.asarray((1 - part) * self.shifts[:, before] + part * self.shifts[:, before + 1])


def _shifts_of_board(
    weights: _ViewWeights, slopes: Array, central: Array, board: Board, lens_shape: str
) -> _ShiftTable:
    """Displacements over the range of a board's slopes and a little beyond, as taking them off changes slopes."""
    low, high = float(np.nanmin(slopes)), float(np.nanmax(slopes))
    middle, half = 0.5 * (low + high), max(0.55 * (high - low), 5e-3)
    at = middle + half * np.linspace(-1.0, 1.0, _SLOPES)
    edges, window = fit_window(central, board)
    return _ShiftTable(at, _apparent_shifts(weights, at, edges, window, lens_shape))


# --- the pupil's image behind a microlens, and what the white image says of it ----------------------------------------


class _ViewWeights(NamedTuple):
    """Where the light in the samples of each view came from."""

    views: Array
    """(s', t') that the samples are read at [px], shape (v, 2)."""
    shares: Array
    """From each neighbour and place of the pupil, shape (v, m, n); they add up to 1 for each view."""
    neighbours: Array
    """[pitches], shape (m, 2)."""
    places: Array
    """(s', t') on the pupil's geometric image [px], shape (n, 2)."""


def _view_weights(image: PupilImage, views: Array, points: int | None = None) -> _ViewWeights:
    """Where the light of the samples of `views`, (s', t') [px], shape (v, 2), came from; `points` on the pupil.

    By default as many as the blur, or a pixel, calls for.
    """
    from scipy.ndimage import map_coordinates

    opening = image.opening
    reach = (RINGS + 1.5) * image.pitch + float(opening.reach)
    step = max(_STEP, image.blur / 12)
    count = 2 ** math.ceil(math.log2(2 * reach / step))
    frequency, half = (np.asarray(f(count, step), float) for f in (np.fft.fftfreq, np.fft.rfftfreq))
    # The transfer is real and even along either axis; beyond the microlens's cutoff nothing passes.
    rows, columns = (np.flatnonzero(np.abs(axis) < image.lens.cutoff) for axis in (frequency, half))
    passed = np.zeros((count, len(columns)))
    passed[rows] = image.transfer(half[None, columns], frequency[rows, None])
    spread = np.fft.fftshift(np.fft.irfft(np.fft.ifft(passed, axis=0), count))
    if points is None:
        width = math.hypot(image.blur, 1.0)
        points = max(400, math.ceil(float(opening.area) * (_PER_BLUR / width) ** 2))
    places = np.stack(opening.places(*sunflower(points, 0.5)), -1)
    around, shares = image.neighbours(), []
    for neighbour in around:
        away = views[:, None] - image.pitch * neighbour - places
        at = [away[..., 1] / step + count // 2, away[..., 0] / step + count // 2]
        shares.append(map_coordinates(spread, at, order=1))
    light = np.stack(shares, axis=1)
    light /= light.sum(axis=(1, 2), keepdims=True)
    return _ViewWeights(np.asarray(views, float), light, around, places)


# --- where fitted corners come to lie ---------------------------------------------------------------------------------


def _apparent_shifts(
    weights: _ViewWeights, slopes: Array, edges: tuple[float, float], half: int, lens_shape: str = "square"
) -> Array:
    """Displacement of fitted corners against where their views should have them [pitches], shape (v, k, 2).

    In the view (s', t') a corner of slope k stands at k (s', t'). The light of a neighbour n pitches away that passed
    the pupil at (s'', t'') has it at k (s'', t'') - n instead: the view shows the sum of all, each microlens averaging
    over its aperture, and `fit_saddles` fits that with one corner. What it finds is computed here by running it: the
    mean of the displacements would be twice as large, as a far neighbour's light moves the mean but not the fit.

    `slopes` are Du/Ds' of corners [pitches/px], shape (k,); `edges` the directions of a corner's two edges in the view
    [rad]; the window that it is fitted in reaches `half` pitches; `lens_shape` is that of the microlenses. NaN where no
    corner could be fitted.
    """
    views, count = len(weights.shares), len(slopes)
    size = 2 * half + 3
    normals = np.array([[-math.sin(a), math.cos(a)] for a in edges])
    aperture = LENS_SHAPES[lens_shape].sample(_PARTS)
    # Of one layout: kernels are compiled once more for another.
    aperture = np.ascontiguousarray(aperture - aperture.mean(axis=0))
    alike = _ViewWeights(*map(np.ascontiguousarray, weights))
    out = np.empty((size, views * count * len(_PHASES) * size))
    _patches.compiled(*alike, np.asarray(slopes, float), normals, _PHASES, aperture, half, out)
    patches = views * count * len(_PHASES)
    start = np.stack([np.arange(patches) * size + half + 1.0, np.full(patches, half + 1.0)], axis=-1)
    start += np.tile(_PHASES, (views * count, 1))
    saddles = fit_saddles(out, np.ones(out.shape, bool), start, np.tile(edges, (patches, 1)), half)
    settled = saddles.settled.reshape(-1, len(_PHASES))
    shift = np.where(settled[..., None], (saddles.corners - start).reshape(-1, len(_PHASES), 2), 0.0).sum(axis=1)
    with np.errstate(invalid="ignore"):
        shift /= settled.sum(axis=1)[:, None]
    return np.asarray(shift.reshape(views, count, 2))


@kernel(parallel=True)
def _patches(
    views: Array,
    shares: Array,
    neighbours: Array,
    places: Array,
    slopes: Array,
    normals: Array,
    phases: Array,
    aperture: Array,
    half: int,
    out: Array,
    band: Band = WHOLE,
) -> None:
    count, size = slopes.shape[0], 2 * half + 3
    reach = math.ceil(1.5 * (half + 3))
    bins = 2 * reach * _FINE
    for k in prange(views.shape[0] * count, band):
        v, q = k // count, k % count
        # Light by distance from the two edges, of which the sums along both axes are then taken.
        held = np.zeros((bins + 1, bins + 1))
        for m in range(neighbours.shape[0]):
            for n in range(places.shape[0]):
                if shares[v, m, n] < _DIM and shares[v, m, n] > -_DIM:
                    continue
                x = slopes[q] * (places[n, 0] - views[v, 0]) - neighbours[m, 0]
                y = slopes[q] * (places[n, 1] - views[v, 1]) - neighbours[m, 1]
                # Shared among the four nearest bins, so that the mean stays where it is.
                a = min(max((normals[0, 0] * x + normals[0, 1] * y + reach) * _FINE - 0.5, 0.0), bins - 1.001)
                b = min(max((normals[1, 0] * x + normals[1, 1] * y + reach) * _FINE - 0.5, 0.0), bins - 1.001)
                column, row = math.floor(a), math.floor(b)
                fa, fb = a - column, b - row
                held[row + 1, column + 1] += shares[v, m, n] * (1 - fa) * (1 - fb)
                held[row + 1, column + 2] += shares[v, m, n] * fa * (1 - fb)
                held[row + 2, column + 1] += shares[v, m, n] * (1 - fa) * fb
                held[row + 2, column + 2] += shares[v, m, n] * fa * fb
        for row in range(1, bins + 1):
            along = 0.0
            for column in range(1, bins + 1):
                along += held[row, column]
                held[row, column] = held[row - 1, column] + along
        for f in range(phases.shape[0]):
            for row in range(size):
                for column in range(size):
                    total = 0.0
                    for p in range(aperture.shape[0]):
                        x = column - half - 1 + aperture[p, 0] - phases[f, 0]
                        y = row - half - 1 + aperture[p, 1] - phases[f, 1]
                        a = (normals[0, 0] * x + normals[0, 1] * y + reach) * _FINE
                        b = (normals[1, 0] * x + normals[1, 1] * y + reach) * _FINE
                        i, j = math.floor(a), math.floor(b)
                        fa, fb = a - i, b - j
                        # Light of corners on each side of both edges: sums of the cumulative table.
                        below_a = held[bins, i] * (1 - fa) + held[bins, i + 1] * fa
                        below_b = held[j, bins] * (1 - fb) + held[j + 1, bins] * fb
                        both = (held[j, i] * (1 - fa) + held[j, i + 1] * fa) * (1 - fb)
                        both += (held[j + 1, i] * (1 - fa) + held[j + 1, i + 1] * fa) * fb
                        total += 4.0 * both - 2.0 * below_a - 2.0 * below_b + 1.0
                    out[row, (k * phases.shape[0] + f) * size + column] = total / aperture.shape[0]


# --- what views disagree on -------------------------------------------------------------------------------------------


def _view_disagreement(observations: Observations, result: Calibration, sheet: DataSheet, distortion: int = 0) -> Array:
    """Difference of (A, m, 1/d_2) between inner views and all, beyond what noise explains.

    Corners read between microlenses and pixels are off by up to a hundredth of a pitch in ways that repeat from board
    to board and change from view to view. Their scatter is small, the slopes' common error is not: it shows when the
    outer views are left out.

    Returns
    -------
    ndarray
        As one independent standard deviation, shape (1, 3); (0, 3) where there are too few inner views to tell.
    """
    away = np.hypot(*observations.views.T)
    inner = np.flatnonzero(away <= _INNER * away.max() + 1e-9)
    if len(inner) < 5 or len(inner) == len(away):
        return np.zeros((0, 3))
    some = replace(observations, views=observations.views[inner], uv=observations.uv[:, inner])
    try:
        other = calibrate(some, sheet, distortion=distortion, guess=result.fit.camera.A)
    except CalibrationError:
        return np.zeros((0, 3))
    difference = other.fit.camera.vector(_NAMES) - result.fit.camera.vector(_NAMES)
    # All views hold the inner ones: the difference of the estimates has the difference of their variances.
    variance = [fit.covariance.part(_NAMES)[2, 2] for fit in (other.fit, result.fit)]
    noise = max(float(variance[0] - variance[1]), 0.0)
    beyond = max(1.0 - noise / max(float(difference[2]) ** 2, 1e-300), 0.0)
    return np.asarray(np.sqrt(beyond) * difference[None])
