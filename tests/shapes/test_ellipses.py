"""Common parts of ellipses: affine images of discs, whose common parts are known otherwise; hard and empty cases."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roslf_design.fates import ImageFate
from roslf_design.shapes.discs import intersect
from roslf_design.shapes.ellipses import _ellipse_shapes, intersect_ellipses


def stretched(centres, radii, affine):
    """The ellipses that discs become under an affine map."""
    shape = np.einsum("ij,kj->ik", affine, affine)
    matrices = radii[..., None] ** 2 * np.array([shape[0, 0], shape[0, 1], shape[1, 1]])
    return centres @ affine.T, matrices


@given(st.integers(0, 10**6), st.integers(2, 4), st.floats(0.3, 3.0), st.floats(-0.8, 0.8))
def test_stretched_discs_have_stretched_areas_and_centroids(seed, count, stretch, shear):
    stream = np.random.default_rng(seed)
    centres, radii = stream.normal(0, 0.4, (30, count, 2)), stream.uniform(0.6, 1.5, (30, count))
    affine = np.array([[stretch, shear], [0.0, 1.0]])
    expected = intersect(centres, radii)
    found = intersect_ellipses(*stretched(centres, radii, affine))
    np.testing.assert_allclose(found.kept_fraction, expected.kept_fraction, atol=1e-12)
    np.testing.assert_allclose(found.area, expected.area * stretch, atol=1e-12 * np.pi * 1.5**2 * stretch)
    large = expected.kept_fraction > 1e-3
    # Moments of a sliver are differences of numbers as large as the ellipse's.
    np.testing.assert_allclose(
        found.centroid[large], (expected.centroid @ affine.T)[large], atol=1e-10 * max(stretch, 1)
    )
    # A slight difference decides what is whole and what touches.
    sure = (expected.kept_fraction > 1e-9) & (expected.lost_fraction > 1e-9)
    assert np.array_equal(found.status[sure], expected.status[sure])
    assert np.array_equal(found.clipping[sure], expected.clipping[sure])
    if stretch == 1 and shear == 0:
        np.testing.assert_allclose(found.axis_ratio[large], expected.axis_ratio[large], atol=1e-7)


@pytest.mark.parametrize("copies", [2, 3])
def test_equal_ellipses_are_one(copies):
    matrices = np.tile([1.0, 0.3, 0.5], (1, copies, 1))
    found = intersect_ellipses(np.zeros((1, copies, 2)), matrices)
    assert found.kept_fraction[0] == pytest.approx(1, abs=1e-13)
    low, high = np.linalg.eigvalsh([[1.0, 0.3], [0.3, 0.5]])
    assert found.axis_ratio[0] == pytest.approx(np.sqrt(low / high), rel=1e-12)


def test_an_ellipse_inside_all_others_is_whole_exactly():
    matrices = np.array([[[1.0, 0.1, 0.8], [4.0, 0.0, 4.0], [9.0, 2.0, 7.0]]])
    found = intersect_ellipses(np.zeros((1, 3, 2)), matrices)
    assert found.kept_fraction[0] == 1.0
    assert found.area[0] == np.pi * np.sqrt(0.8 - 0.01)
    assert tuple(found.centroid[0]) == (0.0, 0.0)
    assert found.status[0] == ImageFate.FULL
    assert not found.clipping.any()


def test_apart_and_touching_ellipses_have_nothing_in_common():
    one = np.tile([1.0, 0.0, 0.25], (3, 2, 1))
    centres = np.zeros((3, 2, 2))
    centres[:, 1, 0] = 3.0, 2.0 + 1e-9, 2.0
    found = intersect_ellipses(centres, one)
    np.testing.assert_allclose(found.area, 0.0, atol=1e-12)
    assert found.status[0] == ImageFate.DARK
    assert found.axis_ratio[0] == 0
    assert found.clipping[0].tolist() == [False, True]


def test_crossing_ellipses_meet_in_four_points():
    found = intersect_ellipses(np.zeros((1, 2, 2)), np.array([[[4.0, 0.0, 1.0], [1.0, 0.0, 4.0]]]))
    # By symmetry eight times the part between the diagonal and the axis: 4 a b atan(b/a).
    assert found.area[0] == pytest.approx(4 * 2 * np.arctan(0.5), rel=1e-13)
    assert found.axis_ratio[0] == pytest.approx(1, abs=1e-12)


def test_compiled_and_interpreted_kernels_agree():
    stream = np.random.default_rng(4)
    centres, radii = stream.normal(0, 0.4, (12, 3, 2)), stream.uniform(0.6, 1.5, (12, 3))
    matrices = np.stack([radii**2, 0.1 * radii**2, 0.8 * radii**2], -1)
    whole = centres[:, 0].copy(), matrices[:, 0].copy()  # as callers have them: another layout is compiled anew
    both = [(np.empty((12, 8)), np.empty(12, np.int8), np.empty((12, 3), np.bool_)) for _ in range(2)]
    for run, out in zip((_ellipse_shapes.interpreted, _ellipse_shapes.compiled), both, strict=True):
        run(*whole, centres, matrices, np.empty((12, 0, 3, 2)), 0, *out)
    np.testing.assert_allclose(both[0][0], both[1][0], atol=1e-13)
    assert all(np.array_equal(a, b) for a, b in zip(both[0][1:], both[1][1:], strict=True))
