"""Exact pixel coverage: against mpmath's slices and exact cells, and the laws of area, windows and sums."""

import math
from contextvars import ContextVar

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from roslf_design._jit import Kernel
from roslf_design.shapes import coverage as coverage_module
from roslf_design.shapes.coverage import coverage_image
from roslf_design.shapes.discs import intersect
from roslf_design.shapes.lattice import Lattice, lens_centres
from studies.accuracy.oracles import discs as oracle
from tests.laws import DEAR
from tests.shapes.blocks import area_in_rectangle, paper_discs, pixel_areas

disc = st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(0.2, 2))
sets = st.lists(disc, min_size=1, max_size=4).map(np.array)
half_grid = st.integers(-4, 4).map(lambda n: n / 2)
aligned = st.lists(st.tuples(half_grid, half_grid, st.integers(1, 6).map(lambda n: n / 2)), min_size=1, max_size=3)


def rectangles(block):
    """Lower and upper corners of each pixel of a block, shape (rows, columns, 2)."""
    x, y = np.meshgrid(block.x_edges, block.y_edges)
    corners = np.stack([x, y], -1)
    return corners[:-1, :-1], corners[1:, 1:]


@pytest.mark.parametrize("seed", range(4))
def test_each_pixel_by_slices(seed):
    rng = np.random.default_rng(seed)
    centres, radii = rng.normal(size=(seed + 1, 2)) * 0.4, rng.uniform(0.8, 1.2, seed + 1)
    block = pixel_areas([0.0, 0.0], centres, radii, pixel=0.45, sensor_centre=(0.013, 0.171))
    low, high = rectangles(block)
    for j, i in np.ndindex(block.area.shape):
        (x0, y0), (x1, y1) = low[j, i], high[j, i]
        corners = [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]
        reference = float(oracle.area(centres, radii, corners, digits=20))
        assert block.area[j, i] == pytest.approx(reference, abs=1e-15)


@given(sets, st.floats(0.1, 3), st.floats(-1, 1), st.floats(-1, 1))
@DEAR
@example(np.array([[0.0, 0.0, 1.0], [0.3, -0.2, 1.1]]), 0.05, 0.01, -0.02)
def test_each_pixel_is_the_exact_cell(discs, pixel, x, y):
    """Two ways of Green: from edge to edge of the pixels, and arc by arc within each rectangle."""
    centres, radii = discs[:, :2], discs[:, 2]
    block = pixel_areas([0.1, -0.2], centres, radii, pixel=pixel, sensor_centre=(x, y))
    if block.area.size:
        exact = area_in_rectangle(centres + np.array([0.1, -0.2]), radii, *rectangles(block))
        np.testing.assert_allclose(block.area, exact, rtol=0, atol=3e-14)
        assert (block.area >= 0).all()
        assert (block.area <= pixel**2 * (1 + 1e-15)).all()


@given(aligned.map(np.array))
def test_circles_that_touch_pixel_edges_and_corners(discs):
    """Centres and radii on a half-pixel grid: tangent to edges, through corners, equal to each other."""
    centres, radii = discs[:, :2], discs[:, 2]
    block = pixel_areas([0.0, 0.0], centres, radii, pixel=1.0)
    if block.area.size:
        exact = area_in_rectangle(centres, radii, *rectangles(block))
        np.testing.assert_allclose(block.area, exact, rtol=0, atol=1e-13)
    np.testing.assert_allclose(block.area.sum(), intersect(centres, radii).area, rtol=0, atol=1e-13)


@given(sets, st.floats(0.02, 10), st.floats(-1e3, 1e3), st.floats(-1e3, 1e3))
def test_pixels_add_up_to_the_area(discs, pixel, x, y):
    centres, radii = discs[:, :2], discs[:, 2]
    area = pixel_areas([x, y], centres, radii, pixel=pixel, size=(7, 4)).area.sum()
    np.testing.assert_allclose(area, intersect(centres, radii).area, rtol=0, atol=1e-12 * math.pi * radii[0] ** 2)


def test_large_disc_of_many_pixels():
    """A microlens image of 900 pixels across, cut: 1e-12 of it still, and whole pixels are whole."""
    centres, radii = np.array([[0.0, 0.0], [0.8, 0.3]]), np.array([1.0, 1.4])
    block = pixel_areas([0.0, 0.0], centres, radii, pixel=2 / 900)
    np.testing.assert_allclose(block.area.sum(), intersect(centres, radii).area, rtol=1e-12)
    low, high = rectangles(block)
    corners = np.stack(
        [low, high, np.stack([low[..., 0], high[..., 1]], -1), np.stack([high[..., 0], low[..., 1]], -1)]
    )
    distance = np.hypot(*np.moveaxis(corners[..., None, :] - centres, -1, 0)) - radii
    whole = (distance < -1e-9).all(axis=(0, -1))
    np.testing.assert_allclose(block.area[whole], (2 / 900) ** 2, rtol=1e-10)
    dark = np.hypot(*np.moveaxis((low + high)[..., None, :] / 2 - centres, -1, 0)) - radii > 2 / 900
    np.testing.assert_array_equal(block.area[dark.any(-1)], 0)


@pytest.mark.parametrize("ratio", [20, 65, 300, 3e4])
def test_a_disc_cut_by_a_far_larger_one(ratio):
    """Beyond 64 px of radius pixels are counted from chords: sums to 1e-12 of the part and pixels as exact cells."""
    centres, radii = np.array([[0.0, 0.0], [0.8 * ratio - 0.1, 0.6 * ratio]]), np.array([1.0, ratio])
    block = pixel_areas([0.0, 0.0], centres, radii, pixel=0.2, sensor_centre=(0.03, 0.05))
    np.testing.assert_allclose(block.area.sum(), intersect(centres, radii).area, rtol=1e-12)
    low, high = rectangles(block)
    lift = area_in_rectangle(centres[:1], radii[:1], low, high)
    assert ((block.area > 1e-6) & (block.area < lift - 1e-6)).sum() > 5
    for j, i in ((2, 5), (5, 5), (7, 3), (4, 6)):
        (x0, y0), (x1, y1) = low[j, i], high[j, i]
        reference = oracle.area(centres, radii, [[x0, y0], [x1, y0], [x1, y1], [x0, y1]], digits=25)
        assert block.area[j, i] == pytest.approx(float(reference), abs=1e-16 * (5 + ratio))


def test_a_vast_disc_that_clips_nothing_changes_nothing():
    block = pixel_areas([0.0, 0.0], [[0.1, 0.2], [1e3, 0.0]], [1.0, 1e9], pixel=0.2)
    np.testing.assert_array_equal(block.area, pixel_areas([0.0, 0.0], [[0.1, 0.2]], [1.0], pixel=0.2).area)
    with pytest.raises(ValueError, match=r"5e.09 pixels clips"):
        pixel_areas([0.0, 0.0], [[0.1, 0.2], [1e9, 0.0]], [1.0, 1e9], pixel=0.2)


def test_tiny_part_of_one_pixel_is_not_missed():
    """A sliver 1e-12 of a pixel wide; its place is rounded to 1e-16 of a pixel."""
    block = pixel_areas([0.5, 0.5], [[0.0, 0.0], [2e-7 - 1e-12, 0.0]], [1e-7, 1e-7], pixel=1.0)
    assert block.area.shape == (1, 1)
    np.testing.assert_allclose(block.area[0, 0], intersect([[0, 0], [2e-7 - 1e-12, 0]], [1e-7, 1e-7]).area, rtol=2e-4)


def paper_sensor(shape, stops=(), layout="square"):
    """Microlenses, discs and keywords for a part of P1's sensor."""
    axes = lens_centres(Lattice(0.063, (shape[0] * 4.9e-3 + 0.2, shape[1] * 4.9e-3 + 0.2), layout, rotation=2e-3))
    centres, radii = paper_discs(axes, {"stops": stops})
    return (axes, centres, radii), {"pixel": 4.847826e-3, "size": shape}


CLIPPED = {"stops": [{"diameter": 2.8, "distance": 100.0, "decentre": (0.5, 0.2)}]}


@pytest.mark.parametrize("layout", ["square", "hexagonal"])
@pytest.mark.parametrize("options", [{}, CLIPPED])
def test_a_window_is_that_part_of_the_whole_to_the_last_bit(options, layout):
    arguments, keywords = paper_sensor((300, 211), layout=layout, **options)
    whole = coverage_image(*arguments, **keywords)
    assert whole.shape == (211, 300)
    for window in (np.s_[10:60, 70:290], np.s_[:, 299:], np.s_[105:106, 20:21], np.s_[-3:, -500:]):
        np.testing.assert_array_equal(coverage_image(*arguments, window=window, **keywords), whole[window])
    tiled = np.zeros_like(whole)
    for j in range(0, 211, 50):
        for i in range(0, 300, 110):
            tile = np.s_[j : j + 50, i : i + 110]
            coverage_image(*arguments, window=tile, out=tiled[tile], **keywords)
    np.testing.assert_array_equal(tiled, whole)


@pytest.mark.parametrize("options", [{}, CLIPPED])
def test_threads_make_the_same_image(options):
    arguments, keywords = paper_sensor((300, 211), **options)
    one = coverage_image(*arguments, **keywords)
    np.testing.assert_array_equal(coverage_image(*arguments, parallel=True, **keywords), one)


def test_large_and_small_problems_agree(monkeypatch):
    """Compiled and interpreted kernels do the same arithmetic, but for an ulp of a sine or an arc tangent."""
    (axes, centres, radii), keywords = paper_sensor((300, 211), **CLIPPED)
    whole = coverage_image(axes, centres, radii, **keywords)
    monkeypatch.setattr(Kernel, "pays", lambda kernel, seconds: False)
    pieces = np.zeros_like(whole)
    for k in range(0, len(axes), 150):
        some = slice(k, k + 150)
        coverage_image(axes[some], centres[some], radii[some], out=pieces, **keywords)
    np.testing.assert_allclose(pieces, whole, rtol=0, atol=4e-15)


def test_many_small_problems_end_compiled(monkeypatch):
    """Interpreting is for the first few: a thousand small images must not take a thousand times as long as one."""
    kernel, limit, ran = coverage_module.coverage, 500 * coverage_module.PIXEL, []
    interpreted = kernel.interpreted
    monkeypatch.setattr(kernel, "_compiled", kernel.compiled)
    monkeypatch.setattr(Kernel, "ready", False)
    monkeypatch.setattr("roslf_design._jit._interpreted", [0.0])
    monkeypatch.setattr("roslf_design._jit.PATIENCE", ContextVar("PATIENCE", default=limit))
    for name in ("LOAD", "IMPORT"):
        monkeypatch.setattr(f"roslf_design._jit.{name}", limit)
    monkeypatch.setattr(kernel, "interpreted", lambda *arguments: ran.append(interpreted(*arguments)))
    images = [
        coverage_image([0.1, 0.2], [[0.0, 0.0], [3.0, 1.0]], [4.0, 5.0], pixel=1.0, size=(11, 11)) for _ in range(20)
    ]
    assert 0 < len(ran) < 10
    for image in images:
        np.testing.assert_allclose(image, images[0], rtol=0, atol=4e-15)


def test_neighbours_add_up():
    """P1's images are wider than their pitch: where they overlap, a pixel gets light twice."""
    arguments, keywords = paper_sensor((130, 130))
    image = coverage_image(*arguments, **keywords)
    assert image.max() > 1.01
    inside = image[40:90, 40:90].mean()
    np.testing.assert_allclose(inside, math.pi / 4 * 1.00506**2, rtol=0.02)


def test_single_precision_and_adding_to_an_image():
    arguments, keywords = paper_sensor((130, 90))
    exact = coverage_image(*arguments, **keywords)
    single = coverage_image(*arguments, dtype=np.float32, **keywords)
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, exact, rtol=0, atol=1.2e-7)
    image = np.full((90, 130), 2.0)
    assert coverage_image(*arguments, out=image, **keywords) is image
    np.testing.assert_allclose(image, exact + 2, rtol=0, atol=1e-14)


def test_light_beside_the_sensor_is_not_on_it():
    image = coverage_image([[0.0, 0.0], [9.0, 0.0]], [[0.0, 0.0]], [1.0], pixel=0.5, size=(2, 2))
    np.testing.assert_allclose(image, area_in_rectangle([[0, 0]], [1], [0, 0], [0.5, 0.5]) / 0.25, rtol=1e-15)


def test_dark_microlenses_leave_no_trace():
    block = pixel_areas([0.0, 0.0], [[0.0, 0.0], [3.0, 0.0]], [1.0, 1.0], pixel=0.5)
    assert block.area.sum() == 0
    assert pixel_areas([0.0, 0.0], [[0.0, 0.0]], [0.0], pixel=0.5).area.sum() == 0
    triple = pixel_areas([0.0, 0.0], np.stack([np.cos([0, 2.1, 4.2]), np.sin([0, 2.1, 4.2])], -1), [0.9] * 3, pixel=0.1)
    np.testing.assert_array_equal(triple.area, 0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"size": (0, 5)}, "at least one pixel by one"),
        ({"pixel": 0.0}, "pixel must be above 0"),
        ({"pixel": 1e-6}, "pixels across"),
        ({"axes": [1e20, 0.0]}, "from the sensor's corner"),
        ({"axes": [0.0]}, "axes must have shape"),
        ({"axes": np.zeros((3, 2)), "radii": np.ones((2, 1))}, "do not fit"),
        ({"window": np.s_[::2, :]}, "no steps"),
        ({"out": np.zeros((3, 3))}, "but the window's is"),
        ({"dtype": int}, "float32 or float64"),
    ],
)
def test_bad_input_is_named(change, message):
    arguments = {"axes": [0.0, 0.0], "centres": [[0.0, 0.0]], "radii": [1.0], "pixel": 0.5, "size": (4, 5)} | change
    with pytest.raises(ValueError, match=message):
        coverage_image(**arguments)
