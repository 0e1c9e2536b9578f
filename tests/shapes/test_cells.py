"""Light in a cell: against mpmath's slices, the paper's cell, and the law that cells share out the whole."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roslf_design.shapes.discs import intersect
from roslf_design.shapes.lattice import cell_polygon
from studies.accuracy.oracles import discs as oracle
from tests.shapes.blocks import area_in_polygon, area_in_rectangle, paper_discs

any_disc = st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(1e-3, 2))
sets = st.lists(any_disc, min_size=1, max_size=5).map(np.array)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("layout", ["square", "hexagonal"])
def test_cell_cuts_discs_by_slices(layout, seed):
    rng = np.random.default_rng(seed)
    centres, radii = rng.normal(size=(1 + seed % 3, 2)) * 0.3, rng.uniform(0.6, 1.4, 1 + seed % 3)
    polygon = cell_polygon(layout, 1.4, rng.uniform(0, 6)) + rng.normal(size=2) * 0.2
    reference = float(oracle.area(centres, radii, polygon, digits=25))
    np.testing.assert_allclose(area_in_polygon(centres, radii, polygon), reference, rtol=0, atol=4e-15)


def test_paper_microlens_spills_a_thousandth_over_its_cell():
    """P1: a disc of 63.0435 um in a cell of 62.7261 um, the image pitch; 0.9991 stays."""
    centres, radii = paper_discs([11.15, 0.0])
    half = 0.0627261 / 2
    inside = area_in_rectangle(centres, radii, centres[0] - half, centres[0] + half)
    spill = math.acos(half / radii[0]) - half / radii[0] * math.sqrt(1 - (half / radii[0]) ** 2)
    share = inside / intersect(centres, radii).area
    np.testing.assert_allclose(share, 1 - 4 * spill / math.pi, rtol=1e-14)
    assert round(float(share), 4) == 0.9991


@given(sets, st.floats(0.2, 1.5), st.floats(0, 7), st.sampled_from(["square", "hexagonal"]))
def test_cells_share_out_the_whole(discs, pitch, rotation, layout):
    centres, radii = discs[:, :2], discs[:, 2]
    steps = np.arange(-20, 21)
    j, i = (v.ravel() for v in np.meshgrid(steps, steps))
    hexagonal = layout == "hexagonal"
    x, y = pitch * (i + (j % 2) / 2 * hexagonal), pitch * j * (math.sqrt(3) / 2 if hexagonal else 1)
    cosine, sine = math.cos(rotation), math.sin(rotation)
    middles = np.stack([cosine * x - sine * y, sine * x + cosine * y], -1)
    cells = cell_polygon(layout, pitch, rotation) + middles[:, None]
    near = np.hypot(*(middles - centres[0]).T) < radii[0] + 2 * pitch
    if pitch * 15 > radii[0] + 2:
        total = area_in_polygon(centres, radii, cells[near]).sum()
        np.testing.assert_allclose(total, intersect(centres, radii).area, rtol=0, atol=1e-13)


@given(sets)
def test_a_cell_around_everything_holds_everything(discs):
    area = area_in_rectangle(discs[:, :2], discs[:, 2], [-9, -9], [9, 9])
    np.testing.assert_allclose(area, intersect(discs[:, :2], discs[:, 2]).area, rtol=0, atol=1e-14)


def test_a_cell_within_all_discs_is_full_and_one_beside_them_dark():
    assert area_in_rectangle([[0, 0], [0.5, 0]], [4, 5], [-1, -0.5], [1, 0.25]) == pytest.approx(1.5, rel=1e-15)
    assert area_in_rectangle([[0, 0], [0.5, 0]], [4, 5], [6, 6], [7, 7]) == 0
