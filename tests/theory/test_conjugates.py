"""Main lens: any two of f, d_f, d_1; contradictions; the excess that survives where distances do not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roslf_design import theory

length = st.floats(1e-3, 1e3)


@given(length, st.floats(1e-12, 1e6))
def test_any_two_give_the_third(f, excess):
    d_f = f * (1 + excess)
    triple = theory.conjugates(focal_length=f, focal_plane_distance=d_f)
    assert abs(theory.conjugate_residual(*triple)) <= 4 * np.spacing(f / triple.mla_distance + d_f / f - 1)
    # Going round is as ill-conditioned as d_1/f and d_f/f are large: the distances are given to an ulp each.
    again = theory.conjugates(focal_plane_distance=d_f, mla_distance=triple.mla_distance)
    assert abs(again.focal_length - f) <= 4 * np.spacing(f)
    third = theory.conjugates(focal_length=f, mla_distance=triple.mla_distance)
    assert abs(third.focal_plane_distance - d_f) <= 4 * np.spacing(d_f) * (1 + d_f / f)


@given(length, length)
def test_object_and_image_side_may_be_swapped(f, other):
    assert theory.mla_distance(f, other) == theory.focal_plane_distance(f, other)
    assert theory.focal_length(f, other) == theory.focal_length(other, f)


def test_excess_keeps_its_digits_where_the_distance_has_none():
    assert theory.mla_excess(100.0, 1e20) == pytest.approx(1e-16, rel=1e-15)
    assert theory.mla_distance(100.0, 1e20) == 100.0
    assert theory.mla_distance(100.0, np.inf) == 100.0
    assert theory.mla_distance(100.0, 100.0) == np.inf
    assert theory.inverse_magnification(100.0, 100.0) == 0.0
    assert theory.focal_length(np.inf, np.inf) == np.inf


def test_consistent_triple_passes_as_given():
    triple = theory.conjugates(100.0, [350.0, np.inf], [140.0, 100.0])
    np.testing.assert_array_equal(triple.focal_plane_distance, [350.0, np.inf])
    assert triple.focal_length == 100.0


@pytest.mark.parametrize("wrong", [141.0, [140.0, 141.0], np.nan])
def test_contradiction_names_residual_and_remedy(wrong):
    with pytest.raises(ValueError, match=r"contradict.*f/d_f \+ f/d_1 - 1 = .*drop one of them.*would be 140 mm"):
        theory.conjugates(100.0, 350.0, wrong)


@pytest.mark.parametrize("given_", [{}, {"focal_length": 1.0}, {"focal_plane_distance": 1.0}, {"mla_distance": 1.0}])
def test_one_distance_is_not_enough(given_):
    with pytest.raises(ValueError, match="under-determined"):
        theory.conjugates(**given_)


def test_residual_is_that_of_the_smallest_misplacement():
    d_1 = 140.0
    moved = np.nextafter(d_1, 150)
    expected = -100.0 / d_1 / d_1 * (moved - d_1)
    assert theory.conjugate_residual(100.0, 350.0, moved) == pytest.approx(expected, rel=1e-2)
