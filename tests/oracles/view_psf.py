"""What one pixel behind a microlens sees of object points: the wave through FAP and microlens, sample by sample.

Written from the diffraction integrals, with sampled openings and pixels; shares no code with the package.
"""

import numpy as np


def responses(design, rate, places, pixels, opening, samples=96, nodes=3, neighbours=0):
    """Light of pixels from points whose images lie at `places` on the array, in both directions.

    Parameters
    ----------
    design : Design
        Of square or round microlenses, in air.
    rate : float
        Millimetres that the image moves on the array per millimetre on the sensor, 0 in focus.
    places : ndarray, shape (N,)
        Against the microlens's axis [mm].
    pixels : sequence of (x, y)
        Middles, against the image's middle [mm].
    opening : callable
        Whether light passes at (x, y) of the microlens image [mm].
    neighbours : int
        Square microlenses on each side whose light adds up with its own, field by field.

    Returns
    -------
    ndarray, shape (pixels, N, N)
        Rows are y.
    """
    wave, d, d_2, q = design.wavelength, design.d, design.d_2, design.q
    gap, m = design.d_f - design.d_3, design.d_1 / design.d_f
    reach = m * gap
    vergence = (design.f - design.d_3) * (design.d_f - design.f) / design.f**2 / gap
    beta = 1 / design.f_ml - 1 / d_2 - vergence
    radius = design.D_F / 2
    # Midpoints over the FAP; the sensor sees place s at -s d_2/reach.
    s = (np.arange(samples) + 0.5) / samples * 2 * radius - radius
    -s * d_2 / reach
    subs = 8
    fine = (np.arange(samples * subs) + 0.5) / (samples * subs) * 2 * radius - radius
    seen = -fine * d_2 / reach
    lit = (opening(seen[None, :], seen[:, None]) & (np.hypot(fine[None, :], fine[:, None]) <= radius)).astype(float)
    lit = lit.reshape(samples, subs, samples, subs).mean((1, 3))
    shear = rate * d_2 / reach
    # A ray from s meets the array at the image's place minus shear s.
    phase = np.exp(-1j * np.pi * shear * (s[None, :] ** 2 + s[:, None] ** 2) / (wave * reach))
    w = (np.arange(240) + 0.5) / 240 * d - d / 2
    lens = np.exp(-1j * np.pi * beta * w**2 / wave) * (d / 240)
    carry = np.exp(2j * np.pi * np.outer(s, places) / (wave * reach))
    node, weight = np.polynomial.legendre.leggauss(nodes)
    square = design.microlens_array.lens_shape == "square"
    inside = np.hypot(w[None, :], w[:, None]) <= d / 2

    def lenses(at):
        """What microlenses along one axis make of a wave from each s, at a place on the sensor."""
        total = 0.0
        for k in range(-neighbours, neighbours + 1):
            away = at - k * d * (1 + d_2 * vergence)
            turn = np.exp(-2j * np.pi * np.outer(s / (wave * reach) + away / (wave * d_2), w)) * lens
            phase = np.pi / wave * ((at - k * d) ** 2 / d_2 + (k * d) ** 2 * vergence)
            turn = turn * np.exp(1j * phase - 2j * np.pi * k * d * s[:, None] / (wave * reach))
            total = total + (turn.sum(1) if square else turn)
        return total

    axis = {at: [lenses(at + a * q / 2) for a in node] for at in {float(v) for pixel in pixels for v in pixel}}
    found = []
    for x, y in pixels:
        total = 0.0
        for kernel_x, wa in zip(axis[float(x)], weight, strict=False):
            if square:
                half = (lit * phase) @ (carry * kernel_x[:, None])
            for kernel_y, wb in zip(axis[float(y)], weight, strict=False):
                if square:
                    field = (carry * kernel_y[:, None]).T @ half
                else:
                    field = carry.T @ (lit * phase * (kernel_y @ inside @ kernel_x.T)) @ carry
                total = total + wa * wb / 4 * np.abs(field) ** 2
        found.append(total)
    return np.array(found)


def line_transfer(spread, places, frequency, axis):
    """MTF at frequencies [1/mm] of a sampled spread, rows y; axis 0 along x."""
    line = spread.sum(axis)
    wave = np.exp(-2j * np.pi * np.outer(frequency, places))
    return np.abs(wave @ line) / line.sum()


def transfer(design, rate, pixel, discs, frequency, way, neighbours, samples=200, lens=80, pixels=3):
    """Transfer of a square microlens's pixel for waves over the array, by plain sums over all that light goes through.

    Parameters
    ----------
    design : Design
        Of a square array of square microlenses, in air.
    rate : float
        As of `responses`.
    pixel : pair of float
        Its middle, against the image's middle [mm].
    discs : sequence of ((x, y), radius)
        Whose common part is lit [mm].
    frequency : sequence of float
        On the array, along the unit vector `way` [1/mm].
    neighbours : int
        Microlenses on each side whose light adds up with its own, field by field.
    samples, lens, pixels : int
        Of the lit image's width, of the microlens's and of the pixel's.

    Returns
    -------
    ndarray of complex
    """
    wave, d, d_2, q = design.wavelength, design.d, design.d_2, design.q
    gap = design.d_f - design.d_3
    vergence = (design.f - design.d_3) * (design.d_f - design.f) / design.f**2 / gap
    beta = 1 / design.f_ml - 1 / d_2 - vergence
    (middle, radius), *_ = discs
    edges = (np.arange(samples) + 0.5) / samples * 2 * radius - radius
    w = (np.arange(lens) + 0.5) / lens * d - d / 2
    curved = np.exp(-1j * np.pi * beta * w**2 / wave) / lens

    def fields(place, seen):
        """Of light from places of the image in places of the pixel, (pixels, places)."""
        total = 0.0
        for k in range(-neighbours, neighbours + 1):
            off = place - seen[:, None] + k * d * (1 + d_2 * vergence)
            at, back = np.unique(off.round(12), return_inverse=True)
            each = np.exp(2j * np.pi / (wave * d_2) * np.outer(at, w)) @ curved
            path = ((seen - k * d) ** 2 / d_2 + (k * d) ** 2 * vergence)[:, None] + 2 * k * d * place / d_2
            total = total + each[back].reshape(off.shape) * np.exp(1j * np.pi / wave * path)
        return total

    sums = []
    for nu in (0.0, *frequency):
        apart = wave * d_2 * nu / 2 * np.asarray(way)
        lit, parts = True, []
        for axis in (0, 1):
            place = middle[axis] + edges
            seen = pixel[axis] + ((np.arange(pixels) + 0.5) / pixels - 0.5) * q
            pair = fields(place - apart[axis], seen) * fields(place + apart[axis], seen).conj()
            parts.append(pair.sum(0) * np.exp(2j * np.pi * nu * rate * way[axis] * place))
        x, y = middle[0] + edges, middle[1] + edges[:, None]
        for (u, v), r in discs:
            for sign in (-1, 1):
                lit = lit & (np.hypot(x - u + sign * apart[0], y - v + sign * apart[1]) <= r)
        sums.append(parts[1] @ lit @ parts[0])
    return np.array(sums[1:]) / sums[0]
