"""Points made on planes and spheres, with errors of a known size."""

import math

import numpy as np
import pytest
from scipy.ndimage import uniform_filter

from roslf_design.bench.flatness import SphereSpacing, SurfaceFit


def test_flatness_error_is_the_range_about_a_tilted_plane():
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(-10, 10, 21), np.linspace(-8, 8, 17)))
    bump = 0.05 * (x == 0) * (y == 0) - 0.03 * (x == 5) * (y == 8)
    slope = np.array([0.2, -0.1])
    lean = math.sqrt(1 + slope @ slope)
    z = 40 + slope[0] * x + slope[1] * y + bump * lean
    fit = SurfaceFit.plane(np.stack([x, y, z], -1), np.full(x.size, 0.01), 1.0)
    # One point in 357 is three thousandths: the larger bump goes as a stray.
    assert fit.error == pytest.approx(0.03, rel=0.01)
    assert fit.parameters == pytest.approx([40, 0.2, -0.1], abs=1e-3)


def test_flatness_of_noise_is_told_with_its_error():
    rng, off, placed = np.random.default_rng(0), [], []
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(-10, 10, 40), np.linspace(-8, 8, 30)))
    for _ in range(100):
        fit = SurfaceFit.plane(np.stack([x, y, 40 + rng.normal(0, 0.02, x.size)], -1), np.full(x.size, 0.02), 1.0)
        off.append((fit.rms - 0.02) / fit.rms_sigma)
        placed.append((fit.parameters[0] - 40) / math.sqrt(fit.covariance[0, 0]))
        assert fit.error == pytest.approx(6 * 0.02, abs=4 * fit.error_sigma)
    assert np.sum(np.abs(off) < 2) >= 90
    assert np.sum(np.abs(placed) < 2) >= 90


def test_spacing_of_spheres_before_a_wall_holds_the_truth():
    off, round_, rng = [], [], np.random.default_rng(1)
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(-10, 10, 60), np.linspace(-6, 6, 36)))
    for _ in range(20):
        z, sigma = np.full(x.size, 50.0), 0.03
        for cx in (-4.0, 4.0):
            inside = 2.5**2 - (x - cx) ** 2 - y**2
            z = np.where(inside > 0, 40 - np.sqrt(np.maximum(inside, 0)), z)
        points = np.stack([x, y, z + rng.normal(0, sigma, z.size)], -1)
        seen = SphereSpacing.of(points, np.full(z.size, sigma), 1.0, 5.0, 8.1, 0.17)
        assert seen is not None
        off.append((seen.spacing - 8) / seen.sigma)
        round_.append(seen.size / seen.size_sigma)
        assert seen.size == pytest.approx(0, abs=0.5)
    assert np.sum(np.abs(off) < 2) >= 17
    assert np.sum(np.abs(round_) < 2) >= 17


def test_diameter_of_spheres_in_noise_and_in_wide_windows_is_told_with_its_error_or_not_at_all():
    """Depth by windows of 5 x 5 points: means over them, which near the rim hold what stands behind."""
    rng, off, told = np.random.default_rng(3), [], 0
    at_x, at_y = np.meshgrid(np.linspace(-9, 9, 151), np.linspace(-5, 5, 85))
    for sigma in (0.05, 0.1, 0.8):
        for _ in range(6):
            z = np.full(at_x.shape, 50.0)
            for cx in (-3.6, 3.6):
                inside = 3.0**2 - (at_x - cx) ** 2 - at_y**2
                z = np.where(inside > 0, 40 - np.sqrt(np.maximum(inside, 0)), z)
            # Noise of each point is 5 times that of its window's mean.
            z = uniform_filter(z + 5 * sigma * rng.normal(size=z.shape), 5)
            points = np.stack([at_x.ravel(), at_y.ravel(), z.ravel()], -1)
            seen = SphereSpacing.of(points, np.full(z.size, sigma), 25.0, 6.0, 7.2, 0.3)
            if seen is not None and seen.size is not None:
                told += 1
                off.append(seen.size / seen.size_sigma)
    assert 12 <= told < 18
    assert np.mean(np.abs(off) < 2) > 0.85


def test_spheres_of_another_size_are_others():
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(-10, 10, 60), np.linspace(-6, 6, 36)))
    z = np.full(x.size, 50.0)
    for cx in (-4.0, 4.0):
        z = np.minimum(z, 40 - np.sqrt(np.maximum(3.4**2 - (x - cx) ** 2 - y**2, 0)))
    points = np.stack([x, y, z + np.random.default_rng(0).normal(0, 0.01, x.size)], -1)
    seen = SphereSpacing.of(points, np.full(x.size, 0.01), 1.0, 6.0, 8.0, 0.17)
    assert seen is None or seen.size == pytest.approx(0.8, abs=0.2)


def test_wall_alone_has_no_spheres():
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(-10, 10, 60), np.linspace(-6, 6, 36)))
    points = np.stack([x, y, 40 + np.random.default_rng(0).normal(0, 0.02, x.size)], -1)
    assert SphereSpacing.of(points, np.full(x.size, 0.02), 1.0, 5.0, 8.0, 0.17) is None


def test_points_that_scatter_more_than_they_say_make_the_plane_less_sure():
    rng, off = np.random.default_rng(2), []
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(-10, 10, 20), np.linspace(-8, 8, 16)))
    for _ in range(60):
        z = 40 + rng.normal(0, 0.05, x.size)
        fit = SurfaceFit.plane(np.stack([x, y, z], -1), np.full(x.size, 0.02), 1.0)
        off.append((fit.parameters[0] - 40) / math.sqrt(fit.covariance[0, 0]))
    assert np.sum(np.abs(off) < 2) >= 53  # 57 expected
