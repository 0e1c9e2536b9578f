"""Matched lengths: they match, they are told when there is none, and Eqs. 7 to 9 as printed agree."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from roslf_design import theory

f = st.floats(1, 200)
share = st.floats(0.01, 0.99)
small = st.floats(0.005, 0.5)
TRIPLE = (100.0, 350.0, 120.0)


@given(f, st.floats(1.05, 20), share, st.floats(0.1, 10), small, st.floats(0.2, 5))
def test_matched_lengths_have_fill_factor_one(f, reduced, where, D_F, d, d_2):
    d_f = f * reduced
    d_3 = where * d_f
    for exact, fill in ((True, theory.fill_factor), (False, theory.approximate_fill_factor)):
        solved = {
            "d_2": theory.matched_sensor_distance(D_F, d, f, d_f, d_3, exact=exact),
            "D_F": theory.matched_pupil_diameter(d, d_2, f, d_f, d_3, exact=exact),
            "d": theory.matched_microlens_pitch(D_F, d_2, f, d_f, d_3, exact=exact),
            "d_3": theory.matched_pupil_distance(D_F, d, d_2, f, d_f, exact=exact),
        }
        for name, (value, exists) in solved.items():
            lengths = {"D_F": D_F, "d": d, "d_2": d_2, "d_3": d_3} | {name: value}
            if not exists:
                assert value == np.inf
                continue
            # Error of the solution times how steeply the fill factor answers to it, d_3 close to d_f the steepest.
            gap = d_f - lengths["d_3"]
            pitch = theory.microlens_image_pitch(lengths["d"], lengths["d_2"], f, d_f, lengths["d_3"])
            steep = (1 + d_f / gap) * (1 + lengths["d"] / abs(pitch)) * (1 + lengths["d_2"] / lengths["d"] * 5 / f)
            filled = fill(lengths["D_F"], lengths["d"], lengths["d_2"], f, d_f, lengths["d_3"])
            assert filled == pytest.approx(1, abs=1e-14 * steep)


@given(f, st.floats(1.05, 20), share, st.floats(0.1, 10), small, st.floats(0.2, 5))
def test_every_rule_agrees_on_overlap(f, reduced, where, D_F, d, d_2):
    """Fill factor, mismatch and the cleared Eq. 7 change sign together, and so does Eq. 7 as printed."""
    d_f = f * reduced
    d_3, d_1 = where * d_f, theory.mla_distance(f, d_f)
    fill = theory.fill_factor(D_F, d, d_2, f, d_f, d_3)
    assume(abs(fill - 1) > 1e-9 and theory.microlens_image_pitch(d, d_2, f, d_f, d_3) > 1e-9 * d)
    printed = (d_1 * D_F + d_3 * d) / ((d_f - d_3) * d * d_1) - (d_1 + d_2) / (d_2 * d_f)
    over = fill > 1
    assert (theory.matching_mismatch(D_F, d, 0.005, d_2, f, d_f, d_3) > 0) == over
    assert (theory.matching_residual(D_F, d, d_2, d_1, d_f, d_3) > 0) == over
    assert (printed > 0) == over


def test_f_numbers_agree_where_the_approximate_rule_says_so():
    d_2 = theory.matched_sensor_distance(2.9, 0.063, *TRIPLE, exact=False).value
    assert theory.microlens_f_number(d_2, 0.063) == pytest.approx(theory.pupil_f_number(2.9, *TRIPLE), rel=1e-15)
    assert theory.microlens_f_number(2.0, 0.063) * theory.microlens_angle(2.0, 0.063) == pytest.approx(1, rel=1e-15)


def test_rules_agree_when_telecentric():
    telecentric = (100.0, 350.0, 100.0)
    for exact in (True, False):
        assert theory.matched_sensor_distance(2.9, 0.063, *telecentric, exact=exact).value == pytest.approx(
            0.063 * 100 / 2.9, rel=1e-15
        )
    assert theory.fill_factor(2.9, 0.063, 2.0, *telecentric) == pytest.approx(
        theory.approximate_fill_factor(2.9, 0.063, 2.0, *telecentric), rel=1e-15
    )


def test_pupil_at_the_lens_matches_traditionally():
    """Eq. 9: with d_3 = 0 and the whole lens as pupil; Eq. 7 keeps the image pitch's 1 + d_2/d_1."""
    d_1 = 140.0
    assert theory.approximate_fill_factor(50.8, 0.063, 2.0, 100.0, 350.0, 0.0) == pytest.approx(
        theory.traditional_fill_factor(50.8, 0.063, 2.0, d_1), rel=1e-15
    )
    assert theory.fill_factor(50.8, 0.063, 2.0, 100.0, 350.0, 0.0) == pytest.approx(
        theory.traditional_fill_factor(50.8, 0.063, 2.0, d_1) / (1 + 2.0 / d_1), rel=1e-15
    )
    assert theory.main_lens_f_number(50.8, d_1) == theory.pupil_f_number(50.8, 100.0, 350.0, 0.0)


@pytest.mark.parametrize(
    ("solve", "arguments"),
    [
        (theory.matched_sensor_distance, (1e-3, 0.1, 100.0, 350.0, 50.0)),  # images grow slower than their pitch
        (theory.matched_sensor_distance, (2.9, 0.063, 100.0, 350.0, 350.0)),  # pupil in the focal plane
        (theory.matched_sensor_distance, (0.0, 0.063, 100.0, 350.0, 120.0)),  # no pupil
        (theory.matched_pupil_diameter, (0.063, 0.0, 100.0, 350.0, 120.0)),  # no image
        (theory.matched_pupil_diameter, (0.063, 500.0, 100.0, 350.0, 120.0)),  # exit pupil before the sensor
        (theory.matched_microlens_pitch, (0.0, 2.0, 100.0, 350.0, 120.0)),
        (theory.matched_microlens_pitch, (2.9, 500.0, 100.0, 350.0, 120.0)),
        (theory.matched_pupil_distance, (50.8, 0.063, 2.0, 100.0, 350.0)),  # too large even at the lens
        (theory.matched_pupil_distance, (2.9, 0.063, 0.0, 100.0, 350.0)),
        (theory.matched_pupil_distance, (0.0, 0.063, 2.0, 100.0, 350.0)),
    ],
)
def test_no_solution_is_told(solve, arguments):
    solution = solve(*arguments)
    assert not solution.exists
    assert solution.value == np.inf


def test_batches_mix_designs_with_and_without_solution():
    solved = theory.matched_pupil_distance([2.9, 50.8], 0.063, 2.0, 100.0, 350.0)
    np.testing.assert_array_equal(solved.exists, [True, False])
    assert solved.value[0] == pytest.approx(118.896447467876, rel=1e-13)
