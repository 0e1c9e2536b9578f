"""First-order data: against rays 1e-20 mm from the axis at 60 digits, lensmaker's formula, and the thin lens."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roslf_design.lenses.glass import Glass
from roslf_design.lenses.lens_file import load_lens, shipped_names
from roslf_design.lenses.prescription import Prescription, Surface, first_order
from tests.lenses.test_prescription import FACTS
from tests.lenses.test_trace import lens_named, oracle_surfaces
from tests.oracles.lenses import vector_trace

TINY = 1e-20
ALL = ["la1050-a", "ac508-100-a", "asphere"]


def height_and_slope(lens, height, slope, wavelength=5e-4):
    """What a ray so near the axis that first order is all there is does from first to last vertex plane."""
    surfaces = oracle_surfaces(lens, wavelength)
    fate, place, way = vector_trace(surfaces, (height * TINY, 0, 0), (slope * TINY, 0, 1))
    assert fate == ("kept", 0)
    with mp.workdps(60):
        out = way[0] / way[2]
        return float((place[0] + out * (lens.length - place[2])) / mp.mpf(TINY)), float(out / mp.mpf(TINY))


@pytest.mark.parametrize("name", ALL)
def test_matrix_is_that_of_rays_next_to_the_axis(name):
    lens = lens_named(name)
    matrix = first_order(lens, 5e-4).matrix
    expected = np.array([height_and_slope(lens, 1, 0), height_and_slope(lens, 0, 1)]).T
    np.testing.assert_allclose(matrix, expected, rtol=0, atol=3e-14)
    assert np.linalg.det(matrix) == pytest.approx(1, abs=1e-13)


def test_focal_lengths_are_the_catalogues_within_their_tolerance():
    for name in shipped_names():
        assert first_order(load_lens(name), 587.6e-6).focal_length == pytest.approx(FACTS[name][-1], rel=0.01)


@pytest.mark.parametrize(("name", "maker"), [("030", 22.2), ("035", 27.3), ("040", 33.4), ("045", 40.2), ("050", 43.4)])
def test_back_focus_of_common_achromats_is_the_makers(name, maker):
    assert first_order(load_lens(f"AC254-{name}-A"), 587.6e-6).back_focal_length == pytest.approx(maker, rel=0.01)


@given(st.floats(-0.05, 0.05), st.floats(-0.05, 0.05), st.floats(0.5, 20), st.floats(1.3, 2.0))
def test_thick_singlet_is_the_lensmakers(front, rear, thickness, n):
    semi = 0.1
    lens = Prescription((Surface(front, semi, thickness, Glass("g", "constant", (n,))), Surface(rear, semi)))
    power = (n - 1) * (front - rear + (n - 1) * thickness * front * rear / n)
    constants = first_order(lens, 5e-4)
    assert constants.power == pytest.approx(power, abs=1e-16)
    if abs(power) > 1e-4:
        f = 1 / power
        assert constants.front_principal == pytest.approx(-f * (n - 1) * thickness * rear / n, abs=1e-11 * abs(f))
        assert constants.rear_principal - thickness == pytest.approx(
            -f * (n - 1) * thickness * front / n, abs=1e-11 * abs(f)
        )


@pytest.mark.parametrize("name", ALL)
def test_reversal_swaps_front_and_rear(name):
    lens = lens_named(name)
    one, other = first_order(lens, 5.5e-4), first_order(lens.reversed(), 5.5e-4)
    assert other.focal_length == pytest.approx(one.focal_length, rel=1e-13)
    assert other.front_principal == pytest.approx(lens.length - one.rear_principal, abs=1e-11)


@given(st.floats(-2000, -1), st.sampled_from(ALL))
def test_images_and_objects_are_conjugate(z, name):
    constants = first_order(lens_named(name), 5.5e-4)
    place, magnification = constants.image_of(z)
    f = constants.focal_length
    x = (constants.front_principal - z) - f  # Newton: distances from the foci multiply to f^2
    if abs(x) > 1e-3:
        assert (place - constants.rear_principal - f) * x == pytest.approx(f * f, rel=1e-9)
        assert magnification == pytest.approx(-f / x, rel=1e-9)
        back = constants.length - first_order(lens_named(name).reversed(), 5.5e-4).image_of(constants.length - place)[0]
        assert back == pytest.approx(z, rel=1e-8)


def test_far_objects_and_focal_planes():
    constants = first_order(load_lens("AC508-100-A"), 5.5e-4)
    focus = constants.length + constants.back_focal_length
    assert constants.image_of(-np.inf) == (focus, 0.0)
    assert focus - constants.rear_principal == pytest.approx(constants.focal_length, rel=1e-14)
    front = constants.front_principal - constants.focal_length
    assert abs(constants.image_of(front)[0]) > 1e12
    afocal = Prescription((Surface(0.0, 5.0, 2.0, Glass("g", "constant", (1.5,))), Surface(0.0, 5.0)))
    assert first_order(afocal, 5e-4).focal_length == np.inf
