"""Back-substitution: the round trip, the paper's Table 2, first-order errors against sampled ones, refusals."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.theory.light_field import back_substitute

PAPER = roslf.load("paper")


@given(st.floats(1, 500), st.floats(1.01, 50), st.floats(0.0, 0.99))
def test_round_trip_of_a_design(f, reduced, where):
    d_f = f * reduced
    d_3 = where * d_f
    camera = Camera.of(PAPER, {"f": f, "d_f": d_f, "d_3": d_3})
    m = camera.m
    back = back_substitute(f, camera.A, m)
    # A, m and d_f each carry a rounding that d_3 = f + (f - A)/m magnifies by 1 + 1/m and A/m.
    loss = 8 * np.spacing(f) * (2 + 2 / m) * (1 + d_f / f)
    assert back.mla_distance == pytest.approx(camera.d_1, abs=loss)
    assert back.focal_plane_distance == pytest.approx(d_f, abs=loss)
    assert back.pupil_distance == pytest.approx(d_3, abs=loss)
    assert back.inverse_aperture_constant == pytest.approx(1 - where, abs=1e-14 * reduced)


def test_table_2_of_the_paper():
    back = back_substitute(100.0, 91.09, 0.42)
    assert back.mla_distance == pytest.approx(142.00, abs=0.005)
    assert back.focal_plane_distance == pytest.approx(338.10, abs=0.005)
    assert back.pupil_distance == pytest.approx(121.21, abs=0.005)
    assert back.aperture_constant == pytest.approx(1.56, abs=0.005)
    assert back.aperture_constant * back.inverse_aperture_constant == pytest.approx(1, rel=1e-15)


def test_one_percent_of_focal_length_moves_the_pupil_by_its_condition():
    moved = back_substitute(101.0, 91.09, 0.42).pupil_distance
    assert moved - back_substitute(100.0, 91.09, 0.42).pupil_distance == pytest.approx(1 + 1 / 0.42, rel=1e-12)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((100.0, 91.0, 0.0), "magnification must be positive, got 0"),
        ((100.0, 91.0, np.nan), "magnification must be positive, got nan"),
        ((-100.0, 91.0, 0.4), "focal_length must be positive, got -100"),
        ((100.0, 91.0, [0.4, -1.0]), "magnification must be positive, got -1"),
    ],
)
def test_undetermined_back_substitution_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        back_substitute(*arguments)


def test_an_infinite_aperture_constant_has_a_finite_twin():
    back = back_substitute(100.0, 0.0, 0.4)
    assert back.aperture_constant == np.inf
    assert back.inverse_aperture_constant == 0
