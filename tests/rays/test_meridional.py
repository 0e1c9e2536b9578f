"""The meridional plane: the same as 3D rays in y = 0, and sections read off two rays against counted ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roslf_design.rays import (
    Array,
    Lens,
    Sensor,
    Status,
    Stop,
    System,
    image_section,
    trace,
    trace_meridional,
    trace_pupil,
)
from tests.rays.systems import PAPER, random_points, random_system


def flat_system(rng, stops=3):
    """Decentred along x; only stops also along y."""
    system = random_system(rng, stops=stops, tilted=False)

    def flat(part):
        return replace(part, decentre=(part.decentre[0], 0.0))

    return System(flat(system.lens), system.stops, flat(system.array), flat(system.sensor))


@given(st.integers(0, 10**6))
def test_rays_of_the_plane_are_the_3d_rays_at_y_0(seed):
    rng = np.random.default_rng(seed)
    system = flat_system(rng)
    p, c, v = (x[0] for x in random_points(system, rng, 40))
    plane, space = trace_meridional(system, p, c, v), trace(system, (p, 0.0), (c, 0.0), (v, 0.0))
    # A stop decentred in y cuts the plane in a chord; no random ray lies within rounding of its end.
    np.testing.assert_array_equal(plane.status, space.status)
    scale = np.abs(space.height[0]).max()
    np.testing.assert_allclose(plane.height, space.height[0], rtol=1e-12, atol=1e-13 * scale)
    np.testing.assert_allclose(plane.slope, space.slope[0], rtol=1e-12, atol=1e-12 * np.abs(space.slope[0]).max())
    for z in (100.0, np.inf):
        np.testing.assert_allclose(plane.at(z), space.at(z)[0], rtol=1e-9, atol=1e-11 * np.abs(plane.at(z)).max())


@given(st.integers(0, 10**6))
def test_sections_end_where_rays_begin_to_be_clipped(seed):
    rng = np.random.default_rng(seed)
    system = flat_system(rng)
    c = float(random_points(system, rng, 1)[1][0, 0])
    section = image_section(system, c)
    for k in range(4):
        lower, upper = section.lower[k], section.upper[k]
        if not np.isfinite(lower):
            assert (lower, upper) == (np.inf, -np.inf)
            continue
        for inward, status in ((1e-9, True), (-1e-9, False)):
            width = upper - lower
            for edge, direction in ((lower, 1), (upper, -1)):
                ray = trace_meridional(system, edge + direction * inward * width, c)
                height = ray.height - ray.slope * (system.stops[k].distance if k < 3 else 0.0)
                part = system.stops[k] if k < 3 else system.lens
                y = part.decentre[1]
                inside = np.hypot(height - part.decentre[0], y) <= part.diameter / 2
                assert inside == status


def test_paper_section_is_the_disc_of_the_closed_form():
    for c in (0.0, 5.0, -11.15):
        section = image_section(PAPER, c)
        centre, radius = c * (1 + 2 / 140 - (350 / 230) * 120 * 2 / 140**2), 1.45 * (350 / 230) * 2 / 140
        np.testing.assert_allclose(section.edges, (centre - radius, centre + radius), rtol=1e-13, atol=1e-15)
        assert section.kept_fraction == 1.0


def test_kept_fraction_is_that_of_rays_along_the_line():
    system = replace(PAPER, lens=Lens(100.0, 8.0), stops=(Stop(2.9, 120.0), Stop(3.0, 150.0, (0.3, 0.4))))
    c = np.linspace(-6, 6, 49)
    kept = image_section(system, c).kept_fraction
    share = (np.arange(20000) + 0.5) / 10000 - 1
    status = trace_pupil(system, (share, 0.0), (c[:, None], 0.0)).status
    passed = np.isin(status, [Status.KEPT, Status.NEIGHBOUR, Status.OFF_SENSOR]).mean(axis=1)
    np.testing.assert_allclose(kept, passed, atol=1.01e-4)  # two ends of a row of 20000
    assert ((kept > 0.05) & (kept < 0.95)).sum() > 5


def test_a_rim_in_the_focal_plane_passes_the_whole_line_or_nothing():
    # f = 64, d_1 = d_f = 128 in binary fractions: the object point seen from c = 1 is -1, whatever the pixel.
    for diameter, edges in ((2.0, (-np.inf, np.inf)), (1.0, (np.inf, -np.inf))):
        system = System(
            Lens(64.0, 50.0), (Stop(2.0, 16.0), Stop(diameter, 128.0)), Array(128.0, 2.0, 0.0625), Sensor(2.0)
        )
        section = image_section(system, 1.0)
        assert (section.lower[1], section.upper[1]) == edges
        assert section.kept_fraction == (1.0 if diameter == 2.0 else 0.0)


def test_rays_that_are_not_finite_are_untraceable():
    rays = trace_meridional(PAPER, np.array([np.nan, 1e308]), 0.0)
    np.testing.assert_array_equal(rays.status, Status.UNTRACEABLE)
    np.testing.assert_array_equal(rays.height, 0.0)


@pytest.mark.parametrize(
    "changed",
    [
        {"lens": Lens(100.0, 50.8, tilt=(0.0, 1e-3))},
        {"lens": Lens(100.0, 50.8, decentre=(0.0, 0.1))},
        {"array": replace(PAPER.array, rotation=1e-3)},
        {"sensor": replace(PAPER.sensor, decentre=(0.0, 0.1))},
    ],
)
def test_a_camera_whose_rays_leave_the_plane_is_refused(changed):
    with pytest.raises(ValueError, match="leave the meridional plane"):
        trace_meridional(replace(PAPER, **changed), 0.0, 0.0)
