"""First-order data: against rays 1e-20 mm from the axis at 60 digits, lensmaker's formula, and the thin lens."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roslf_design.lenses.first_order import exit_pupil, first_order, focused
from roslf_design.lenses.glass import Glass
from roslf_design.lenses.lens_file import load_lens, shipped_names
from roslf_design.lenses.prescription import LensError, Prescription, Surface
from roslf_design.theory.conjugates import mla_distance
from roslf_design.theory.pupils import exit_pupil_diameter, exit_pupil_distance, exit_pupil_vergence
from tests.lenses.test_prescription import FACTS
from tests.lenses.test_trace import lens_named, oracle_surfaces
from tests.oracles.lenses import vector_trace

TINY = 1e-20
ALL = [*shipped_names(), "asphere"]


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


@pytest.mark.parametrize("name", shipped_names())
def test_focal_length_is_the_catalogues_within_its_tolerance(name):
    assert first_order(load_lens(name), 587.6e-6).focal_length == pytest.approx(FACTS[name][-1], rel=0.01)


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
    assert other.front_focal_length == pytest.approx(one.back_focal_length, rel=1e-13)
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
        assert constants.object_of(place) == pytest.approx(z, rel=1e-8)


def test_far_objects_and_focal_planes():
    constants = first_order(load_lens("AC508-100-A"), 5.5e-4)
    focus = constants.length + constants.back_focal_length
    assert constants.image_of(-np.inf) == (focus, 0.0)
    assert focus - constants.rear_principal == pytest.approx(constants.focal_length, rel=1e-14)
    assert abs(constants.image_of(-constants.front_focal_length)[0]) > 1e12
    afocal = Prescription((Surface(0.0, 5.0, 2.0, Glass("g", "constant", (1.5,))), Surface(0.0, 5.0)))
    assert first_order(afocal, 5e-4).focal_length == np.inf


@given(st.floats(10, 400), st.floats(0.5, 8), st.floats(110, 2000))
def test_exit_pupil_is_the_thin_lenss(pupil_distance, diameter, focal_plane):
    constants = first_order(load_lens("LB1630-A"), 5.5e-4)
    f = constants.focal_length
    if abs(pupil_distance - f) < 1e-6 or abs(focal_plane - pupil_distance) < 1e-3:
        return
    d_1 = float(mla_distance(f, focal_plane))
    pupil = exit_pupil(constants, diameter, constants.front_principal - pupil_distance, constants.rear_principal + d_1)
    assert pupil.z - constants.rear_principal == pytest.approx(float(exit_pupil_distance(f, pupil_distance)), rel=1e-8)
    assert pupil.diameter == pytest.approx(float(exit_pupil_diameter(diameter, f, pupil_distance)), rel=1e-8)
    vergence = float(exit_pupil_vergence(f, focal_plane, pupil_distance))
    assert pupil.vergence == pytest.approx(vergence, rel=1e-7, abs=1e-12)
    assert pupil.angle == pytest.approx(pupil.diameter * abs(pupil.vergence), rel=1e-7)


def test_telecentric_pupil_stays_finite_where_it_can():
    constants = first_order(load_lens("AC254-100-A"), 5.5e-4)
    pupil = exit_pupil(constants, 3.0, -constants.front_focal_length, 150.0)
    assert abs(pupil.vergence) < 1e-15
    assert pupil.angle == pytest.approx(3.0 / constants.focal_length, rel=1e-12)
    thin = constants._replace(matrix=np.array([[1.0, 0.0], [-0.01, 1.0]]), power=0.01, length=0.0)
    with pytest.raises(LensError, match="imaged onto the microlens array"):
        exit_pupil(thin, 3.0, -200.0, 200.0)


def test_focus_for_either_distance_and_refusals():
    lens = load_lens("LA1050-A")
    d_f, d_1 = focused(lens, 5.5e-4, focal_plane=350.0)
    assert d_1 == pytest.approx(float(mla_distance(first_order(lens, 5.5e-4).focal_length, 350.0)), rel=1e-13)
    assert focused(lens, 5.5e-4, mla=d_1)[0] == pytest.approx(d_f, rel=1e-12)
    diverging = Prescription((Surface(-0.01, 5.0, 2.0, lens.surfaces[0].glass), Surface(0.0, 5.0)), "diverging")
    for arguments, told in (
        ((lens, {}), "either d_f or d_1"),
        ((lens, {"focal_plane": 300.0, "mla": 150.0}), "either d_f or d_1"),
        ((lens, {"focal_plane": 90.0}), "beyond the focal length, 99.3"),
        ((lens, {"mla": np.inf}), "beyond the focal length"),
        ((diverging, {"focal_plane": 350.0}), "does not converge light"),
    ):
        with pytest.raises(LensError, match=told):
            focused(arguments[0], 5.5e-4, **arguments[1])
