"""Pitch, rotation, layout and phase of a microlens lattice without knowing anything: from the spectrum of its image."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .errors import CalibrationError
from .lattice import Array, CentreLattice, Layout

_PERIODS = (4.5, 110.0)
"""Shortest and longest lattice period searched [px]."""
_CROP = 1024
_SIGNIFICANT = 0.1
"""Amplitude of a lattice peak against the strongest: touching images leave 0.77 of a hexagonal array's first order."""
_BINS = 24


def estimate_lattice(
    image: NDArray[np.floating], pitch: float | None = None, layout: Layout | None = None
) -> CentreLattice:
    """Find the lattice in the middle of an image to a fraction of a pixel.

    The shortest significant peaks of the power spectrum span the reciprocal lattice; its inverse, reduced to the
    shortest vectors, is the lattice; folding the image into one cell finds where the bright images sit in it.

    Parameters
    ----------
    image : ndarray
        White image, shape (rows, columns).
    pitch : float, optional
        Expected pitch [px], to within 25 %; without it any period from 4.5 to 110 px is considered.
    layout : {"square", "hexagonal"}, optional
        Expected layout; without it the angle between the two shortest vectors decides.

    Returns
    -------
    CentreLattice
        Good near the middle of the image; its (0, 0) is the node nearest to the middle.

    Raises
    ------
    CalibrationError
        If no lattice is seen, or not the one expected.
    """
    rows, columns = (min(n, _CROP) for n in image.shape)
    top, left = (image.shape[0] - rows) // 2, (image.shape[1] - columns) // 2
    crop = np.asarray(image[top : top + rows, left : left + columns], float)
    basis = _direct_basis(_spectral_peaks(crop, pitch))
    found = _layout_of(basis)
    if layout is not None and found != layout:
        raise CalibrationError(f"the white image shows a {found} lattice, not a {layout} one")
    oriented = _oriented(basis, found)
    lattice = CentreLattice((0.0, 0.0), (oriented[0, 0], oriented[1, 0]), (oriented[0, 1], oriented[1, 1]), found)
    if pitch is not None and not 0.75 < lattice.pitch / pitch < 1.25:
        raise CalibrationError(
            f"the white image's pitch is {lattice.pitch:.2f} px, not near the expected {pitch:.2f} px"
        )
    phase = _phase(crop, lattice)
    x, y = lattice.nodes(*phase) + np.array([left, top])
    lattice = CentreLattice((float(x), float(y)), lattice.first, lattice.second, found)
    middle = lattice.indices([(image.shape[1] - 1) / 2, (image.shape[0] - 1) / 2])
    return lattice.recentred(round(middle[0]), round(middle[1]))


def _spectral_peaks(crop: Array, pitch: float | None) -> Array:
    """Frequencies [1/px] of the two shortest significant, independent peaks, shape (2, 2)."""
    rows, columns = crop.shape
    y, x = np.linspace(-1, 1, rows)[:, None], np.linspace(-1, 1, columns)[None, :]
    flat = crop - _smooth_background(crop, x, y)
    window = np.cos(x * (math.pi / 2)) ** 2 * np.cos(y * (math.pi / 2)) ** 2
    amplitude = np.abs(np.fft.fft2(flat * window))
    fy, fx = np.fft.fftfreq(rows)[:, None], np.fft.fftfreq(columns)[None, :]
    radius = np.hypot(fy, fx)
    low, high = (1 / _PERIODS[1], 1 / _PERIODS[0]) if pitch is None else (0.75 / pitch, 1.25 * 2 / math.sqrt(3) / pitch)
    anywhere = np.where((radius >= 1 / _PERIODS[1]) & (radius <= 1 / _PERIODS[0]), amplitude, 0.0)
    amplitude = np.where((radius >= low) & (radius <= high), amplitude, 0.0)
    if pitch is not None and amplitude.max() < _SIGNIFICANT * anywhere.max():
        period = 1 / float(radius.ravel()[int(np.argmax(anywhere))])
        raise CalibrationError(
            f"no lattice near the expected pitch of {pitch:.2f} px: the image's strongest period is {period:.1f} px"
        )
    strongest = float(amplitude.max())
    noise = float(np.median(amplitude[amplitude > 0])) if strongest > 0 else 0.0
    if strongest < 8 * noise or np.ptp(crop) <= 1e-6 * np.abs(crop).max():
        raise CalibrationError("the white image shows no periodic lattice of microlenses with a pitch of 5 to 100 px")
    peak = amplitude > max(_SIGNIFICANT * strongest, 4 * noise)
    for axis, step in ((0, 1), (0, -1), (1, 1), (1, -1)):
        peak &= amplitude >= np.roll(amplitude, step, axis)
    at = np.argwhere(peak)
    at = at[np.argsort(radius[at[:, 0], at[:, 1]], kind="stable")]
    frequencies = np.array([_refined(amplitude, int(r), int(c)) for r, c in at]) / (columns, rows)
    first = frequencies[0]
    for second in frequencies[1:]:
        cross = abs(first[0] * second[1] - first[1] * second[0])
        if cross > 0.4 * np.hypot(*first) * np.hypot(*second):
            return np.array([first, second])
    raise CalibrationError("the white image is periodic along one direction only: no lattice of microlenses")


def _smooth_background(crop: Array, x: Array, y: Array) -> Array:
    """Quadratic surface of least squares: vignetting that would leak into the lowest frequencies."""
    px, py = np.polynomial.legendre.legvander(x[0], 2), np.polynomial.legendre.legvander(y[:, 0], 2)
    qx, qy = np.linalg.qr(px)[0], np.linalg.qr(py)[0]
    surface: Array = qy @ (qy.T @ crop @ qx) @ qx.T
    return surface


def _refined(amplitude: Array, row: int, column: int) -> tuple[float, float]:
    """Signed frequency in bins (x, y) of a peak, by a parabola through the logarithms along each axis."""
    rows, columns = amplitude.shape

    def vertex(before: float, at: float, after: float) -> float:
        if min(before, after) <= 0:
            return 0.0
        a, b, c = math.log(before), math.log(at), math.log(after)
        curvature = a - 2 * b + c
        return 0.0 if curvature >= 0 else 0.5 * (a - c) / curvature

    at = float(amplitude[row, column])
    dy = vertex(float(amplitude[row - 1, column]), at, float(amplitude[(row + 1) % rows, column]))
    dx = vertex(float(amplitude[row, column - 1]), at, float(amplitude[row, (column + 1) % columns]))
    signed = (column if column <= columns // 2 else column - columns), (row if row <= rows // 2 else row - rows)
    return signed[0] + dx, signed[1] + dy


def _direct_basis(frequencies: Array) -> Array:
    """Shortest lattice vectors (columns) dual to two reciprocal vectors (rows): Gauss's reduction."""
    a, b = np.linalg.inv(frequencies).T
    while True:
        if np.hypot(*b) < np.hypot(*a):
            a, b = b, a
        shear = round(float(a @ b) / float(a @ a))
        if shear == 0:
            return np.array([a, b]).T
        b = b - shear * a


def _layout_of(basis: Array) -> Layout:
    a, b = basis.T
    lengths = np.hypot(*a), np.hypot(*b)
    angle = math.degrees(math.acos(abs(float(a @ b)) / float(lengths[0] * lengths[1])))
    ratio = float(lengths[1] / lengths[0])
    if ratio < 1.2 and angle > 78:
        return "square"
    if ratio < 1.2 and angle < 72:
        return "hexagonal"
    raise CalibrationError(
        f"the lattice in the white image is neither square nor hexagonal: vectors of {lengths[0]:.2f} and"
        f" {lengths[1]:.2f} px at {angle:.1f} degrees"
    )


def _oriented(basis: Array, layout: Layout) -> Array:
    """Equivalent basis with `first` nearest to +x and `second` 90 or 60 degrees further, towards +y."""
    a, b = basis.T
    star = [a, b] if layout == "square" else [a, b, a - b if a @ b > 0 else a + b]
    star += [-v for v in star]
    first = max(star, key=lambda v: v[0] / np.hypot(*v))
    turn = math.pi / 2 if layout == "square" else math.pi / 3
    ahead = math.atan2(first[1], first[0]) + turn
    second = max(star, key=lambda v: float(v @ (math.cos(ahead), math.sin(ahead))) / float(np.hypot(*v)))
    return np.array([first, second]).T


def _phase(crop: Array, lattice: CentreLattice) -> Array:
    """Indices (fractional) of the bright spot of the cell, from the crop's middle folded into one cell."""
    rows, columns = crop.shape
    half = int(min(max(12 * lattice.pitch, 48), rows / 2, columns / 2))
    y0, x0 = rows // 2, columns // 2
    y, x = np.mgrid[y0 - half : y0 + half, x0 - half : x0 + half]
    local = lattice.indices(np.stack([x, y], axis=-1))
    cell = np.floor((local % 1.0) * _BINS).astype(int) % _BINS
    flat = cell[..., 1] * _BINS + cell[..., 0]
    light = np.bincount(flat.ravel(), crop[y, x].ravel(), _BINS**2)
    count = np.bincount(flat.ravel(), minlength=_BINS**2)
    folded = np.where(count > 0, light / np.maximum(count, 1), light.sum() / count.sum()).reshape(_BINS, _BINS)
    frequency = np.fft.fftfreq(_BINS, 1 / _BINS)
    blur = np.exp(-(frequency[:, None] ** 2 + frequency[None, :] ** 2) * 2 * (math.pi * 0.2) ** 2)
    smooth = np.fft.ifft2(np.fft.fft2(folded) * blur).real
    j, i = np.unravel_index(int(np.argmax(smooth)), smooth.shape)
    nearest = np.round(lattice.indices([x0, y0]) - (i / _BINS, j / _BINS))
    result: Array = nearest + np.array([(i + 0.5) / _BINS, (j + 0.5) / _BINS])
    return result
