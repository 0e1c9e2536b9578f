"""Disparities of bent surfaces, against means of windows by hand and the surface that views are made of."""

import numpy as np
import pytest
from scipy import ndimage

from roslf_design.depth.bends import straightened, window_bends
from roslf_design.depth.estimate import PixelNoise, estimate_disparity
from roslf_design.depth.geometry import ArrayGeometry
from roslf_design.depth.measure import measure
from roslf_design.depth.unmixing import PreparedViews
from roslf_design.depth.windows import OVER, UNDER, WindowFit
from roslf_design.design import load
from tests.depth.made import Texture, disc, field_of, sharp


def test_means_of_windows_of_a_bent_surface_are_given_back_and_steps_left():
    v, u = np.mgrid[:31, :31] - 15.0
    surface = 0.25 - 0.003 * u**2 - 0.001 * v**2 + 0.02 * u
    wide = np.pad(surface, 10, mode="reflect", reflect_type="odd")
    once = ndimage.uniform_filter(wide, 5)[10:-10, 10:-10]
    twice = ndimage.uniform_filter(ndimage.uniform_filter(wide, 5), 5)[10:-10, 10:-10]
    middle = slice(9, -9), slice(9, -9)
    assert np.abs(once - surface)[middle].min() > 0.007  # (25 - 1)/12 of 0.004
    for mean, times in ((once, 1), (twice, 2)):
        np.testing.assert_allclose(straightened(mean, 5, 1e-3, times)[middle], surface[middle], atol=2e-3)


def test_beside_the_dark_surfaces_bend_as_they_do_farther_in():
    """Microlenses without light have no disparity; searched, they had the lowest one, and lay beyond a step."""
    v, u = np.mgrid[:31, :31] - 15.0
    surface = 0.25 - 0.003 * u**2 - 0.001 * v**2 + 0.02 * u
    mean = ndimage.uniform_filter(np.pad(surface, 10, mode="reflect", reflect_type="odd"), 5)[10:-10, 10:-10]
    told = straightened(np.where(u > 5, np.nan, mean), 5, 1e-3)
    lit = np.s_[9:-9, 9:21]
    assert np.abs(mean - surface)[lit].min() > 0.007
    np.testing.assert_allclose(told[lit], surface[lit], atol=2e-3)
    assert np.isnan(told[u > 5]).all()


@pytest.mark.parametrize("height", [0.12, 0.5, 1.0])
def test_a_step_bends_neither_side(height):
    """Means of windows over a step bend one way before and the other way beyond it, however low it is."""
    v, u = np.mgrid[:31, :31] - 15.0
    for edge in (u, v, u + 0.4 * v):
        step = ndimage.uniform_filter(np.where(edge > 0.2, height / 2, -height / 2), 5)
        np.testing.assert_array_equal(straightened(step, 5, 0.01), step)


def test_noise_makes_no_steps():
    """Errors of windows that share microlenses, as large as told, leave the bend of a surface what it is."""
    rng, off = np.random.default_rng(1), []
    v, u = np.mgrid[:31, :31] - 15.0
    surface = -0.003 * (u**2 + v**2)
    for _ in range(40):
        told = surface + 0.05 * ndimage.uniform_filter(rng.standard_normal(u.shape), 5)
        off.append((straightened(told, 5, 0.01) - told)[9:-9, 9:-9].mean())
    assert np.mean(off) == pytest.approx(0.012, rel=0.1)  # (25 - 1)/24 of 0.006 along each axis


def test_windows_at_the_rims_of_a_field_bend_nothing_within():
    """Those hold microlenses that look past the picture: a tenth of a pitch off, of a surface that is flat."""
    flat, inside = np.full((21, 20), -0.5), np.zeros((21, 20), bool)
    inside[3:-3, 3:-3] = True
    told = np.where(inside, flat, flat - 0.1)
    np.testing.assert_allclose(straightened(told, 5, 1e-3)[inside], flat[inside])


def test_depths_of_a_bent_surface_are_those_at_microlenses():
    """A window of 5 of a surface with the second derivative -0.006 means it 0.006 lower than its middle."""
    (pupil, lit), window, search = disc(7), 5, (-0.8, 0.8)

    def surface(u):
        return 0.3 - 0.003 * (u - 15) ** 2

    light = np.where(lit[..., None, None], np.ones((31, 31)), 0).astype(np.float32)
    field = field_of(sharp(Texture.of(1, 0.2), surface, pupil, lit, (31, 31)), light)

    class Alone:
        """Microlenses that send each other no light."""

        def prepared(self, field):
            return PreparedViews(field, pupil)

        def jointly(self, *given):
            return None

        def at_phase(self, views, found):
            return None

        def with_shared(self, field, views, disparity, picture):
            return None

    noise, middle = PixelNoise(1e4, 1.0), np.s_[8:-8, 8:-8]
    true = np.broadcast_to(surface(field.u), (31, 31))[middle]
    plain = estimate_disparity(field, pupil, noise, search=search, window=window)
    assert (plain.disparity[middle] - true).mean() == pytest.approx(-0.006, abs=0.002)
    depths = measure(ArrayGeometry(load("paper")), field, noise, search=search, viewing=Alone())
    assert (depths.disparities.disparity[middle] - true).mean() == pytest.approx(0, abs=0.0015)
    np.testing.assert_allclose(depths.depth, depths.geometry.depth(depths.disparities.disparity))


def test_windows_beside_a_gap_are_bent_as_those_away_from_it():
    v, u = np.mgrid[:30, :50].astype(float)
    surface = 0.02 * u - 0.4 + 1e-3 * (u - 20) ** 2 - 2e-3 * (v - 9) ** 2
    mean = ndimage.uniform_filter(surface, 7)
    gap, inside = np.where(abs(u - 27) < 2, np.nan, mean), np.pad(np.ones((24, 44)), 3)
    slope_u, slope_v = np.gradient(mean, axis=1), np.gradient(mean, axis=0)
    for over, under in ((0, 0), (3, 0), (0, -3), (-3, 3)):
        carried = mean + over * slope_u + under * slope_v
        off = carried - np.roll(surface, (-under, -over), (0, 1))  # of the windows about each middle
        maps = np.zeros((len(WindowFit.__dataclass_fields__), *gap.shape))
        maps[OVER], maps[UNDER] = over * inside, under * inside
        bent = window_bends(gap, 7, WindowFit(*maps))
        there = np.roll(off, (under, over), (0, 1))
        for inner in (np.s_[11:-11, 13:23], np.s_[11:-11, 32:-13]):
            np.testing.assert_allclose(bent[inner], there[inner], atol=1e-12)
