"""Coherent Fresnel field of one object point: FAP, main lens, a patch of microlenses, sensor; by FFT, step by step.

The package evaluates one diffraction integral a microlens in closed coordinates; here a sampled wave is carried through
every gap of air and multiplied by what it meets. Phases are exact, fields have single precision: 1e-6 of the light.
"""

import numpy as np
from scipy import fft


def propagate(field, step, distance, wavelength):
    """A sampled field after `distance` of air, paraxial transfer function, periodic boundaries."""
    f = np.fft.fftfreq(field.shape[0], step)
    turn = np.exp(-1j * np.pi * wavelength * distance * f**2).astype(np.complex64)
    return fft.ifft2(fft.fft2(field) * (turn[:, None] * turn), overwrite_x=True)


def disc_share(x, y, radius, step):
    """Share of each sample inside a disc, its edge one sample wide."""
    return np.clip((radius - np.hypot(x, y)) / step + 0.5, 0, 1)


def box_share(x, y, sides, step):
    """Share of each sample inside an upright rectangle, to its edge."""
    across, along = (
        np.clip((side / 2 - np.abs(at)) / step + 0.5, 0, 1) for at, side in zip((x, y), sides, strict=True)
    )
    return across * along


def sensor_intensity(design, point, *, path=None, lenses=5, coarse=(1024, 6e-3), fine=(2048, 5e-4)):
    """Intensity on the sensor behind `lenses` x `lenses` microlenses about the axis.

    Parameters
    ----------
    design : Design
        Straight and centred, square microlenses; a rectangular FAP is not turned.
    point : (x, y, Z)
    path : callable, optional
        Optical path from the point to places (x, y) of the FAP [mm], where it is not that of air.
    coarse, fine : (samples, step [mm])
        Grids of the bore and of the patch.

    Returns
    -------
    axis, intensity : arrays
        Coordinates of the fine grid [mm] and power per area [1/mm^2]; the FAP takes in 1.
    """
    x0, y0, distance = point
    wave = design.wavelength
    n, step = coarse
    x = (np.arange(n) - n // 2) * step
    reach = distance - design.d_3
    along, across = (np.exp(1j * np.pi / (wave * reach) * (x - at) ** 2) for at in (y0, x0))
    field = along[:, None] * across
    if path is not None:  # behind the FAP's rim it does not matter
        near = np.abs(x) < design.D_F / 2 + step  # the wider extent of a rectangle
        field = np.zeros((n, n), complex)
        field[np.ix_(near, near)] = np.exp(2j * np.pi / wave * path(x[near], x[near][:, None]))
    if design.aperture.sides is None:
        opening = disc_share(x, x[:, None], design.D_F / 2, step)
    else:
        opening = box_share(x, x[:, None], design.aperture.sides, step)
    field = np.complex64(field * opening / np.sqrt((opening**2).sum() * step**2))
    field = propagate(field, step, design.d_3, wave)
    bend = np.complex64(np.exp(-1j * np.pi / (wave * design.f) * x**2))
    field = field * (bend[:, None] * bend)
    field = propagate(field, step, design.d_1, wave)
    # Band-limited: read between the samples exactly, from the spectrum.
    m, small = fine
    v = (np.arange(m) - m // 2) * small
    f = np.fft.fftfreq(n, step)
    spectrum = fft.fft2(np.fft.ifftshift(field))
    half = (lenses * design.d) / 2
    inside = np.abs(v) < half + small
    read = np.complex64(np.exp(2j * np.pi * v[inside][:, None] * f) / n)
    patch = np.zeros((m, m), np.complex64)
    patch[np.ix_(inside, inside)] = read @ spectrum @ read.T
    local = v - np.round(v / design.d) * design.d
    bend = np.exp(-1j * np.pi / (wave * design.f_ml) * local**2)
    window = np.clip((half - np.abs(v)) / small + 0.5, 0, 1)
    lens = np.complex64(bend * window)
    patch *= lens[:, None] * lens
    return v, np.abs(propagate(patch, small, design.d_2, wave)) ** 2


def pixel_sums(axis, intensity, edges):
    """Power in pixels between consecutive `edges` [mm], along both axes."""
    step = axis[1] - axis[0]

    def cumulate(values):
        total = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, 0)]) * step
        at = (edges - (axis[0] - step / 2)) / step
        low = np.floor(at).astype(int)
        part = (at - low)[(...,) + (None,) * (values.ndim - 1)]
        return np.diff(total[low] * (1 - part) + total[low + 1] * part, axis=0)

    return cumulate(cumulate(intensity).T).T
