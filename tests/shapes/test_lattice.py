"""Lattice laws: spacing, symmetry, counting, and the nearest lens against looking at them all."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roslf_design.shapes.lattice import Lattice, _lens_indices, cell_polygon, lens_centres, nearest_lens

layouts = st.sampled_from(["square", "hexagonal"])
lattices = st.builds(
    Lattice,
    pitch=st.floats(0.5, 2),
    size=st.tuples(st.floats(4, 12), st.floats(4, 12)),
    layout=layouts,
    rotation=st.floats(-4, 4),
    decentre=st.tuples(st.floats(-3, 3), st.floats(-3, 3)),
)


@given(lattices)
def test_neighbours_are_a_pitch_apart(lattice):
    centres = lens_centres(lattice)
    assert len(centres) == len(_lens_indices(lattice))
    assert len({tuple(i) for i in _lens_indices(lattice)}) == len(centres)
    distances = np.hypot(*np.moveaxis(centres[:, None] - centres, -1, 0))
    distances[np.diag_indices(len(centres))] = np.inf
    if len(centres) > 1:
        assert distances.min() >= lattice.pitch * (1 - 1e-12)
    at_centre = np.flatnonzero((_lens_indices(lattice) == 0).all(axis=1))
    np.testing.assert_array_equal(centres[at_centre], [lattice.decentre])
    neighbours = 6 if lattice.layout == "hexagonal" else 4
    assert (np.sum(distances < lattice.pitch * 1.001, axis=1) <= neighbours).all()


@given(lattices)
def test_cells_fill_the_size_and_stay_inside(lattice):
    upright = lattice._replace(rotation=0.0, decentre=(0.0, 0.0))
    centres = lens_centres(upright)
    across = lattice.pitch / 2
    up = across * (math.sqrt(3) / 2 if lattice.layout == "hexagonal" else 1)
    assert np.abs(centres[:, 0]).max() + across <= lattice.size[0] / 2 * (1 + 1e-6)
    assert np.abs(centres[:, 1]).max() + up <= lattice.size[1] / 2 * (1 + 1e-6)
    assert np.abs(centres[:, 1]).max() + 3 * up > lattice.size[1] / 2 * (1 - 1e-6)
    middle = centres[np.abs(centres[:, 1]) < up / 2]
    assert np.abs(middle[:, 0]).max() + 3 * across > lattice.size[0] / 2 * (1 - 1e-6)


@given(lattices)
def test_array_is_its_own_image_turned_half_around(lattice):
    centres = lens_centres(lattice._replace(decentre=(0.0, 0.0)))
    order = np.lexsort(np.round(centres, 9).T)
    turned = np.lexsort(np.round(-centres, 9).T)
    np.testing.assert_allclose(centres[order], -centres[turned], atol=1e-12)


@given(lattices, st.lists(st.tuples(st.floats(-20, 20), st.floats(-20, 20)), min_size=1, max_size=8))
def test_nearest_lens_by_looking_at_all(lattice, points):
    points, centres = np.array(points), lens_centres(lattice)
    found = nearest_lens(lattice, points)
    assert {tuple(i) for i in found} <= {tuple(i) for i in _lens_indices(lattice)}
    distance = np.hypot(*(lens_centres(lattice, found) - points).T)
    best = np.hypot(*np.moveaxis(points[:, None] - centres, -1, 0)).min(axis=1)
    np.testing.assert_allclose(distance, best, rtol=0, atol=1e-12)


def test_paper_array():
    """365 microlenses of 63 um fit into 23 mm, 237 into the sensor's height."""
    assert len(_lens_indices(Lattice(0.063, (23.0, 14.932)))) == 365 * 237
    assert len(_lens_indices(Lattice(0.1, (0.3, 0.3)))) == 9  # a multiple of the pitch but for rounding


def test_hexagonal_array_by_hand():
    lattice = Lattice(2.0, (4.0, 6.0), "hexagonal")
    np.testing.assert_array_equal(_lens_indices(lattice), [[-1, -1], [0, -1], [0, 0], [-1, 1], [0, 1]])
    np.testing.assert_allclose(
        lens_centres(lattice), [[-1, -math.sqrt(3)], [1, -math.sqrt(3)], [0, 0], [-1, math.sqrt(3)], [1, math.sqrt(3)]]
    )


def test_one_column_leaves_odd_rows_without_lenses():
    lattice = Lattice(1.0, (1.0, 4.0), "hexagonal")
    np.testing.assert_array_equal(_lens_indices(lattice)[:, 0], 0)
    assert nearest_lens(lattice, [0.0, 0.9]).tolist() in ([0, 0], [0, 2])


@given(layouts, st.floats(0.1, 10), st.floats(-7, 7))
def test_cell_has_the_area_per_lens_and_its_edges_halfway(layout, pitch, rotation):
    corners = cell_polygon(layout, pitch, rotation)
    x, y = corners.T
    area = 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))
    np.testing.assert_allclose(area, pitch**2 * (math.sqrt(3) / 2 if layout == "hexagonal" else 1), rtol=1e-14)
    lattice = Lattice(pitch, (5 * pitch, 5 * pitch), layout, rotation)
    centres = lens_centres(lattice)
    distance = np.hypot(*(corners[:, None] - centres).T)
    own = np.hypot(*corners.T)
    np.testing.assert_allclose(distance.min(axis=0), own, rtol=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"layout": "cubic"}, "layout must be one of square, hexagonal"),
        ({"pitch": 0.0}, "pitch must be above 0 mm"),
        ({"size": (0.5, 9.0)}, "at least one microlens"),
    ],
)
def test_bad_lattices_are_named(change, message):
    with pytest.raises(ValueError, match=message):
        _lens_indices(Lattice(1.0, (3.0, 3.0))._replace(**change))
