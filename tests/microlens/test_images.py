"""Discs of the stops behind a microlens: against the backward ray, the paper's numbers, the limits."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roslf_design.microlens.discs import ClipStatus
from roslf_design.microlens.images import microlens_images, stop_images

P1 = {"focal_length": 100.0, "focal_plane": 350.0, "mla_distance": 140.0, "sensor_distance": 2.0}
FAP_AND_LENS = ([2.9, 50.8], [120.0, 0.0])


@given(
    st.floats(1.01, 20),
    st.floats(5, 200),
    st.floats(0.1, 5),
    st.floats(-0.5, 0.99),
    st.tuples(*[st.floats(-10, 10)] * 4),
    st.floats(0, 2 * math.pi),
)
def test_rim_of_the_disc_is_where_backward_rays_graze_the_stop(ratio, f, d_2, share, vectors, angle):
    d_f = ratio * f
    d_1 = 1 / (1 / f - 1 / d_f)
    z = share * d_f
    c, e = np.array(vectors[:2]), np.array(vectors[2:])
    centre, radius = stop_images(
        c, [3.0], [z], [e], focal_length=f, focal_plane=d_f, mla_distance=d_1, sensor_distance=d_2
    )
    p = c + centre[0] + radius[0] * np.array([math.cos(angle), math.sin(angle)])
    slope = (p - c) / d_2
    lens = c - slope * d_1
    at_stop = lens - (slope + lens / f) * z
    # Rounding of p, of d_1 (which breaks the focus by an ulp) and of the ray's heights, carried to the stop.
    size = np.abs(e).max() + np.abs(lens).max() + np.abs(p).max() * d_1 / d_2
    noise = 4e-16 * size * (1 + abs(z) / f) / (1 - share)
    assert np.hypot(*(at_stop - e)) == pytest.approx(1.5, abs=noise)


def test_paper_microlens_at_the_edge():
    shape = microlens_images([11.15, 0.0], *FAP_AND_LENS, **P1)
    assert shape.status == ClipStatus.FULL
    np.testing.assert_allclose(shape.area, 0.0031215, rtol=2e-5)
    np.testing.assert_allclose(shape.centroid, [-0.0484783, 0.0], atol=5e-8)
    assert (shape.kept_fraction, shape.lost_fraction) == (1, 0)


def test_paper_field_bound_is_where_clipping_begins():
    """Eq. 6: 17.7816666... mm on the MLA, in every direction."""
    bound = 17.781666666666666
    for angle in (0.0, 0.6, 4.0):
        axis = bound * np.array([math.cos(angle), math.sin(angle)])
        inside, outside = microlens_images([axis * (1 - 1e-12), axis * (1 + 1e-12)], *FAP_AND_LENS, **P1).status
        assert (inside, outside) == (ClipStatus.FULL, ClipStatus.CLIPPED)


def test_telecentric_images_stand_behind_their_microlenses():
    """d_3 = f: the microlens-image pitch is d exactly."""
    axis = np.random.default_rng(0).uniform(-10, 10, (50, 2))
    centres, _ = stop_images(axis, [2.9], [100.0], **P1)
    np.testing.assert_array_equal(centres, 0)


def test_stop_at_the_lens_is_the_traditional_light_field():
    """Eq. 9: image diameter D d_2 / d_1, image pitch d (1 + d_2/d_1)."""
    centres, radii = stop_images([7.0, -3.0], [50.8], [0.0], **P1)
    np.testing.assert_allclose(centres, [[7.0 * 2 / 140, -3.0 * 2 / 140]], rtol=1e-15)
    np.testing.assert_allclose(radii, [50.8 / 140], rtol=1e-15)


def test_collimated_object_plane_at_infinity():
    finite = stop_images([7.0, -3.0], *FAP_AND_LENS, **{**P1, "focal_plane": 1e15, "mla_distance": 100.0})
    infinite = stop_images([7.0, -3.0], *FAP_AND_LENS, **{**P1, "focal_plane": np.inf, "mla_distance": 100.0})
    for one, other in zip(finite, infinite, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12)


def test_trials_and_fields_are_leading_axes():
    axes = np.random.default_rng(1).uniform(-20, 20, (5, 2))
    focal = np.linspace(90, 110, 4)[:, None]
    system = {
        "focal_length": focal,
        "focal_plane": 350.0,
        "mla_distance": 1 / (1 / focal - 1 / 350),
        "sensor_distance": 2.0,
    }
    decentre = np.array([[0.1, 0.0], [0.0, -0.2]])
    shapes = microlens_images(axes, *FAP_AND_LENS, decentre, **system)
    assert shapes.area.shape == (4, 5)
    one = {k: np.broadcast_to(v, (4, 1))[2, 0] for k, v in system.items()}
    for field in range(5):
        single = microlens_images(axes[field], *FAP_AND_LENS, decentre, **one)
        for part, whole in zip(single, shapes, strict=True):
            np.testing.assert_array_equal(part, whole[2, field])


def test_object_inside_the_bore_is_refused():
    with pytest.raises(ValueError, match="stop at 350 mm is not in front of the object plane"):
        stop_images([0.0, 0.0], [2.9], [350.0], **P1)
