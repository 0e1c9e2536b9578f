"""Disparities of bent surfaces, against means of windows by hand."""

import numpy as np
from scipy import ndimage

from roslf_design.depth.estimate import straightened


def test_means_of_windows_of_a_bent_surface_are_given_back_and_steps_left():
    v, u = np.mgrid[:31, :31] - 15.0
    surface = 0.25 - 0.003 * u**2 - 0.001 * v**2 + 0.02 * u
    wide = np.pad(surface, 10, mode="reflect", reflect_type="odd")
    once = ndimage.uniform_filter(wide, 5)[10:-10, 10:-10]
    twice = ndimage.uniform_filter(ndimage.uniform_filter(wide, 5), 5)[10:-10, 10:-10]
    middle = slice(9, -9), slice(9, -9)
    assert np.abs(once - surface)[middle].min() > 0.007  # (25 - 1)/12 of 0.004
    for mean, times in ((once, 1), (twice, 2)):
        np.testing.assert_allclose(straightened(mean, 5, times)[middle], surface[middle], atol=2e-3)
    step = np.where(u > 0, 0.5, -0.5)
    np.testing.assert_array_equal(straightened(step, 5), step)
