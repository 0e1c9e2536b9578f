"""Shapes of microlenses and their layouts, against points strewn over them and sums over the lattice."""

import math

import mpmath
import numpy as np
import pytest

from roslf_design.shapes.lattice import PACKINGS, cell_polygon
from roslf_design.theory.lens_shapes import LENS_SHAPES

SIDE = 1201
NODES = (np.arange(SIDE) + 0.5) / SIDE - 0.5
X, Y = np.meshgrid(NODES, NODES)
INSIDE = {"square": np.ones(X.shape, bool), "circular": np.hypot(X, Y) <= 0.5}
shapes = pytest.mark.parametrize("name", LENS_SHAPES)
layouts = pytest.mark.parametrize("name", PACKINGS)


@shapes
def test_area_and_variance_are_those_of_points_all_over_the_aperture(name):
    shape, inside = LENS_SHAPES[name], INSIDE[name]
    assert shape.area == pytest.approx(inside.mean(), abs=1e-3)
    assert shape.variance == pytest.approx(np.mean(X[inside] ** 2), rel=1e-3)
    assert shape.diagonal == pytest.approx(2 * np.hypot(X, Y)[inside].max(), rel=2e-3)
    assert np.asarray(shape.holds(X, Y, 1.0) & np.ones(X.shape, bool)).sum() == inside.sum()


@shapes
@pytest.mark.parametrize("wave", [(0.0, 0.0), (0.4, 0.1), (1.3, -0.7), (0.0, 2.1)])
def test_blur_is_the_mean_of_a_wave_over_the_aperture(name, wave):
    inside = INSIDE[name]
    mean = np.cos(2 * math.pi * (wave[0] * X + wave[1] * Y))[inside].mean()
    blur = LENS_SHAPES[name].blur(np.array(wave[0]), np.array(wave[1]))
    assert float(blur) == pytest.approx(mean, abs=2e-4)


@shapes
@pytest.mark.parametrize("turn", [0.0, 0.3, math.pi / 4])
def test_breadth_is_how_far_the_turned_aperture_reaches(name, turn):
    inside = INSIDE[name]
    along = (X * math.cos(turn) - Y * math.sin(turn))[inside]
    assert LENS_SHAPES[name].breadth(turn) == pytest.approx(2 * along.max(), rel=3e-3)


@shapes
def test_rules_samples_and_places_average_over_the_aperture(name):
    """Gauss's rules take polynomials of the fourth order exactly; strewn points nearly so."""
    shape, inside = LENS_SHAPES[name], INSIDE[name]
    x, y, weight = shape.rule(2.0).T
    for i, j in ((0, 0), (2, 0), (0, 2), (2, 2), (4, 0), (1, 2)):
        moment = (X**i * Y**j)[inside].mean() * 2 ** (i + j)
        assert (weight * x**i * y**j).sum() == pytest.approx(moment, abs=3e-4)
    points = shape.sample(41)
    assert points.shape == (41**2, 2)
    assert np.mean(points**2, axis=0) == pytest.approx([shape.variance] * 2, rel=3e-3)
    u, v = (part.ravel() + 0.5 for part in (X, Y))
    places = np.stack(shape.places(u, v, 0.5, 0.2))
    assert np.mean(places**2, axis=1) == pytest.approx([shape.variance] * 2, rel=3e-3)


@shapes
@pytest.mark.parametrize(
    ("shift", "cycles"), [((0.3, 0.0), (0.5, 0.0)), ((0.2, -0.3), (-0.8, 1.1)), ((0.9, 0.9), (0, 0))]
)
def test_what_two_apertures_share_is_a_sum_over_their_common_part(name, shift, cycles):
    inside = INSIDE[name]
    wide = np.linspace(-1, 1, 1601)
    x, y = np.meshgrid(wide, wide)

    def holds(at_x, at_y):
        return np.hypot(at_x, at_y) <= 0.5 if name == "circular" else np.maximum(np.abs(at_x), np.abs(at_y)) <= 0.5

    both = holds(x - shift[0] / 2, y - shift[1] / 2) & holds(x + shift[0] / 2, y + shift[1] / 2)
    step = wide[1] - wide[0]
    total = np.cos(2 * math.pi * (cycles[0] * x + cycles[1] * y))[both].sum() * step**2 / inside.mean()
    shared = LENS_SHAPES[name].shared(1.0, np.array([shift]), np.array([cycles], float))
    assert float(shared[0]) == pytest.approx(total, abs=4e-3)


@pytest.mark.parametrize("defocus", [0.0, 0.04, -3.0])
def test_a_round_lens_passes_what_its_overlap_with_itself_leaves_of_a_phase(defocus):
    """Many frequencies and lenses at once, beside each integral to 20 digits."""
    width, distance, waves = 0.1, 0.5, np.array([5e-4, 0.0])[:, None]
    radius = np.geomspace(1e-3, 250.0, 80)
    own = (np.full((2, 1), part) for part in (width, distance, defocus))
    (many,) = LENS_SHAPES["circular"].factors(*own, waves, radius + 0 * waves, 0 * radius + 0 * waves)
    for lens, at in ((0, 0), (0, 40), (0, 61), (0, 70), (0, 79), (1, 30), (1, 65)):
        offset = float(waves[lens, 0]) * distance * radius[at] / width
        turns = 2 * math.pi * defocus * distance * width * radius[at]
        assert many[lens, at] == pytest.approx(_overlap_integral(offset, turns), abs=1e-12)


def _overlap_integral(offset, turns):
    """Integral of a phase over what two circles share, over a circle's area."""
    half = max(0.5 - mpmath.mpf(offset) / 2, mpmath.mpf(0))
    ends = mpmath.linspace(0, half, 2 + int(abs(turns) * half / 3))

    def column(x):
        return mpmath.sqrt(max(0.25 - (x + offset / 2) ** 2, 0)) * mpmath.cos(turns * x)

    return float(16 / mpmath.pi * mpmath.quad(column, ends))


@layouts
def test_the_cell_is_nearest_to_its_own_lens_and_its_area_is_a_row_s_rise(name):
    packing = PACKINGS[name]
    steps = packing.steps
    others = np.array([steps @ (i, j) for i in range(-2, 3) for j in range(-2, 3) if i or j])
    x, y = 1.4 * X[::8, ::8], 1.4 * Y[::8, ::8]
    nearest = (np.hypot(x[..., None] - others[:, 0], y[..., None] - others[:, 1]) >= np.hypot(x, y)[..., None]).all(-1)
    assert (packing.in_cell(x, y) == nearest).all()
    assert packing.rise == pytest.approx(abs(np.linalg.det(steps)), rel=1e-14)
    corners = cell_polygon(name, 1.0)
    assert len(corners) == packing.corners
    assert packing.in_cell(*(corners.T * (1 - 1e-9))).all()
    assert not packing.in_cell(*(corners.T * (1 + 1e-9))).any()


@layouts
def test_fold_is_half_the_shortest_frequency_of_the_lattice(name):
    packing = PACKINGS[name]
    waves = np.linalg.inv(packing.steps)  # rows: frequencies of one period along one step, none along the other
    lengths = [np.hypot(*(i * waves[0] + j * waves[1])) for i in range(-2, 3) for j in range(-2, 3) if i or j]
    assert packing.fold == pytest.approx(min(lengths) / 2, rel=1e-14)
    for first, second in ((0.3, 0.1), (-0.2, 0.7)):
        wave = np.array([first, float(packing.wave_up(np.array(first), np.array(second)))])
        assert wave @ packing.steps == pytest.approx([first, second], rel=1e-14)


@layouts
def test_the_spectrum_of_a_cell_is_a_sum_over_its_points(name):
    packing, frequency = PACKINGS[name], np.array([0.21, 0.9, 1.7])
    x, y = 1.2 * X, 1.2 * Y
    inside = packing.in_cell(x, y)
    area = (1.2 / SIDE) ** 2
    for row, up in enumerate(frequency):
        for column, along in enumerate(frequency):
            total = np.cos(2 * math.pi * (along * x + up * y))[inside].sum() * area
            assert packing.cell_spectrum(1.0, frequency)[row, column] == pytest.approx(total, abs=2e-3)
