"""References of another kind for what the accuracy package computes: ray counts, and sums over explicit neighbours."""

import numpy as np


def white_image_by_points(radius, pitch, width, x, y, pupil, neighbours):
    """Wave image of a square array of microlenses in focus, alike: sinc^2 of each pupil point, each neighbour apart.

    Lengths in pixels; intensities at points x, y (not over pixels); `pupil` are points that fill the unit disc.
    """
    steps = np.arange(-neighbours, neighbours + 1) * pitch
    image = np.zeros((y.size, x.size))
    for a in pupil * radius:
        across = (np.sinc((x[:, None] - a[0] - steps) / width) ** 2).sum(1) / width
        along = (np.sinc((y[:, None] - a[1] - steps) / width) ** 2).sum(1) / width
        image += np.outer(along, across)
    return image * np.pi * radius**2 / len(pupil)


def quantile_spread(inverse, sigma):
    """Half the range of 1/v between the quantiles of one standard deviation, v normal."""
    from statistics import NormalDist

    law = NormalDist(inverse, sigma)
    ends = [1 / law.inv_cdf(NormalDist().cdf(side)) for side in (-1, 1)]
    return 0.5 * (ends[0] - ends[1])
