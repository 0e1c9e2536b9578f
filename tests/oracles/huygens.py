"""Direct Huygens quadrature of microlens images: field over the aperture, intensities over pupil points.

Shares nothing with the package's transfer functions: the aperture is integrated in real space, the pupil is a cloud of
mutually incoherent points on the FAP, and every phase is a path length to second order.
"""

import numpy as np


def towards_sensor(design, sensor, v):
    """Field kernel along one axis from aperture points v to sensor points, both from the microlens's axis."""
    path = (sensor[:, None] - v) ** 2 / (2 * design.d_2) - v**2 / (2 * design.f_ml)
    return np.exp(2j * np.pi / design.wavelength * path)


def from_pupil(design, a, c, v, bent=True):
    """The same from pupil points a to aperture points c + v of the microlens at c; columns are pupil points.

    Without what is `bent`: of the path what hangs on a, by which kernels to c and to v multiply to that to c + v.
    """
    # From the FAP through d_3 of air, the lens and d_1 of air: path (A a^2 - 2 a w + D w^2) / 2B, ray matrix A B C D.
    B = design.d_3 + design.d_1 - design.d_1 * design.d_3 / design.f
    D = 1 - design.d_3 / design.f
    w = (c + v)[:, None]
    return np.exp(2j * np.pi / design.wavelength * (-2 * a * w + bent * D * w**2) / (2 * B))


def aperture(design, samples):
    """Gauss-Legendre points across the microlens and their weights [mm]."""
    nodes, weights = np.polynomial.legendre.leggauss(samples)
    return nodes * design.d / 2, weights * design.d / 2


def square_images(design, pupil_points, x, y, steps, samples, steps_y=None):
    """Images of microlenses alike, summed: intensity at the product grid of x and y [mm] per unit of light in each.

    `steps` are the image centres, along each axis, of the neighbours that are counted (along y `steps_y`, where they
    differ). Of a square aperture the field is a product of two one-dimensional integrals, and so is its intensity.
    """
    v, dv = aperture(design, samples)
    unit = design.wavelength * design.d_2 * design.d

    def profile(points, sensor, steps):
        light = dv[:, None] * from_pupil(design, points, 0.0, v)
        return sum(np.abs(towards_sensor(design, sensor - step, v) @ light) ** 2 for step in steps) / unit

    return np.einsum(
        "yn,xn->yx",
        profile(pupil_points[:, 1], y, steps if steps_y is None else steps_y),
        profile(pupil_points[:, 0], x, steps),
    ) / len(pupil_points)


def round_image(design, pupil_points, x, y, samples, axis=(0.0, 0.0)):
    """Image of one circular microlens at `axis`, as `square_images`; rows of the aperture end at its rim."""
    v, dv = aperture(design, samples)
    angle = v / (design.d / 2) * np.pi / 2
    row = design.d / 2 * np.sin(angle)
    drow = dv * np.pi / 2 * np.cos(angle)
    chord = np.sqrt((design.d / 2) ** 2 - row**2)
    field = np.zeros((y.size, x.size, len(pupil_points)), complex)
    for r, dr, half in zip(row, drow, chord, strict=True):
        line, dline = v * (half / (design.d / 2)), dv * (half / (design.d / 2))
        across = towards_sensor(design, x, line) @ (
            dline[:, None] * from_pupil(design, pupil_points[:, 0], axis[0], line)
        )
        along = towards_sensor(design, y, np.array([r])) * from_pupil(
            design, pupil_points[:, 1], axis[1], np.array([r])
        )
        field += dr * along[:, None] * across
    image = (np.abs(field) ** 2).sum(-1)
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


def polar(radius, rings, turns):
    """Points in a disc and weights that add up to 1: Gauss-Legendre in the square of the radius, even in angle."""
    nodes, weights = np.polynomial.legendre.leggauss(rings)
    angle = 2 * np.pi * (np.arange(turns) + 0.5) / turns
    r = radius * np.sqrt((nodes + 1) / 2)
    points = np.stack([np.outer(r, np.cos(angle)).ravel(), np.outer(r, np.sin(angle)).ravel()], -1)
    return points, np.repeat(weights / 2 / turns, turns)


def square_interference(design, x, y, reach, rings, samples):
    """What coherence between square microlenses up to `reach` pitches off the axis adds; per unit of light in each.

    At the product grid of x and y: fields of all microlenses are added, then squared, less their squares added.
    """
    points, weights = polar(design.D_F / 2, rings, 4 * rings)
    v, dv = aperture(design, samples)
    both = []
    for at, a in ((x, points[:, 0]), (y, points[:, 1])):
        slanted = from_pupil(design, a, 0.0, v, bent=False)
        fields = [
            # Paths to c + v: those to v and to c, and what bends both.
            (towards_sensor(design, at - c, v) * dv * from_pupil(design, 0.0, c, v)[:, 0])
            @ slanted
            * from_pupil(design, a, c, np.zeros(1), bent=False)
            for c in design.d * np.arange(-reach, reach + 1)
        ]
        both.append((np.abs(sum(fields)) ** 2, sum(np.abs(field) ** 2 for field in fields)))
    (coherent_x, alone_x), (coherent_y, alone_y) = both
    unit = (design.wavelength * design.d_2 * design.d) ** 2
    sums = (np.einsum("p,yp,xp->yx", weights, *pair) for pair in ((coherent_y, coherent_x), (alone_y, alone_x)))
    return (next(sums) - next(sums)) / unit


def round_interference(design, places, centres, rings, samples):
    """The same of circular microlenses at `centres`, at sensor points `places`, shapes (n, 2)."""
    points, weights = polar(design.D_F / 2, rings, 4 * rings)
    lens, shares = polar(design.d / 2, samples, 4 * samples)
    coherent, alone = 0.0, 0.0
    # Paths to centre + lens: those to the lens's points and to its centre, and what bends both.
    slanted = np.prod([from_pupil(design, points[:, k], 0.0, lens[:, k], bent=False) for k in (0, 1)], axis=0)
    for centre in centres:
        bent, toward = (
            np.prod(parts, axis=0)
            for parts in (
                [from_pupil(design, 0.0, centre[k], lens[:, k])[:, 0] for k in (0, 1)],
                [from_pupil(design, points[:, k], centre[k], np.zeros(1), bent=False) for k in (0, 1)],
            )
        )
        field = np.prod([towards_sensor(design, places[:, k] - centre[k], lens[:, k]) for k in (0, 1)], axis=0)
        field = (field * (shares * bent)) @ slanted * toward
        coherent, alone = coherent + field, alone + np.abs(field) ** 2
    unit = (design.wavelength * design.d_2) ** 2 / (np.pi * design.d**2 / 4)
    return (np.abs(coherent) ** 2 - alone) @ weights / unit
