"""Direct Huygens quadrature of microlens images: field over the aperture, intensities over pupil points.

Shares nothing with the package's transfer functions: the aperture is integrated in real space, the pupil is a cloud of
mutually incoherent points on the FAP, and every phase is a path length to second order.
"""

import numpy as np


def sheet(design, sensor, a, c, v):
    """Field kernel along one axis: pupil point a, microlens axis c, aperture points c + v, sensor points c + sensor."""
    # From the FAP through d_3 of air, the lens and d_1 of air: path (A a^2 - 2 a w + D w^2) / 2B, ray matrix A B C D.
    B = design.d_3 + design.d_1 - design.d_1 * design.d_3 / design.f
    D = 1 - design.d_3 / design.f
    w = c + v
    path = (-2 * a * w + D * w**2) / (2 * B) - v**2 / (2 * design.f_ml)
    path = path + (sensor[:, None] - v) ** 2 / (2 * design.d_2)
    return np.exp(2j * np.pi / design.wavelength * path)


def aperture(design, samples):
    """Gauss-Legendre points across the microlens and their weights [mm]."""
    nodes, weights = np.polynomial.legendre.leggauss(samples)
    return nodes * design.d / 2, weights * design.d / 2


def square_images(design, pupil_points, x, y, steps, samples):
    """Images of microlenses alike, summed: intensity at the product grid of x and y [mm] per unit of light in each.

    `steps` are the image centres, along each axis, of the neighbours that are counted. Of a square aperture the field
    is a product of two one-dimensional integrals, and so is its intensity.
    """
    v, dv = aperture(design, samples)
    unit = design.wavelength * design.d_2 * design.d

    def profile(points, sensor):
        image = np.zeros((len(points), sensor.size))
        for step in steps:
            for n, a in enumerate(points):
                image[n] += np.abs(sheet(design, sensor - step, a, 0.0, v) @ dv) ** 2
        return image / unit

    return np.einsum("ny,nx->yx", profile(pupil_points[:, 1], y), profile(pupil_points[:, 0], x)) / len(pupil_points)


def round_image(design, pupil_points, x, y, samples, axis=(0.0, 0.0)):
    """Image of one circular microlens at `axis`, as `square_images`; rows of the aperture end at its rim."""
    v, dv = aperture(design, samples)
    angle = v / (design.d / 2) * np.pi / 2
    row = design.d / 2 * np.sin(angle)
    drow = dv * np.pi / 2 * np.cos(angle)
    chord = np.sqrt((design.d / 2) ** 2 - row**2)
    image = np.zeros((y.size, x.size))
    for a in pupil_points:
        field = np.zeros((y.size, x.size), complex)
        for r, dr, half in zip(row, drow, chord, strict=True):
            across = sheet(design, x, a[0], axis[0], v / (design.d / 2) * half) @ (dv * half / (design.d / 2))
            field += dr * sheet(design, y, a[1], axis[1], np.array([r]))[:, :1] * across
        image += np.abs(field) ** 2
    return image / len(pupil_points) / (design.wavelength**2 * design.d_2**2 * np.pi * design.d**2 / 4)


def disc(radius, rings, centre=(0.0, 0.0)):
    """Points that fill a disc evenly: rings of equal area for each of their points."""
    points = []
    counts = 6 * np.arange(rings) + 3
    edges = radius * np.sqrt(np.concatenate([[0], np.cumsum(counts)]) / counts.sum())
    for k, n in enumerate(counts):
        r = np.sqrt((edges[k] ** 2 + edges[k + 1] ** 2) / 2)
        angle = 2 * np.pi * (np.arange(n) + 0.5 * (k % 2) + 0.25) / n
        points.append(np.stack([r * np.cos(angle), r * np.sin(angle)], -1))
    return np.concatenate(points) + centre
