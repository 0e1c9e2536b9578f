"""What the figures show, against theory and brute force; and that every axis says what it is."""

import math
import re

import numpy as np
import pytest

from roslf_design.design import Design, load, preset_names
from roslf_design.evaluation import evaluate
from roslf_design.report import figures
from roslf_design.report.figures.cells import plot_cells
from roslf_design.report.figures.depth_precision import depth_precision
from roslf_design.report.figures.field_maps import field_map
from roslf_design.report.figures.matching_plane import matching_plane
from roslf_design.report.figures.microlens_images import image_view
from roslf_design.report.figures.ray_diagram import labelled_fans, name_rows
from roslf_design.report.figures.style import drawing, to_svg


def strange(**changes):
    """A design with further stops, decentres and strong vignetting."""
    data = load("paper").model_dump()
    data["stops"] = [
        {"diameter": 10.0, "distance": 60.0, "decentre": (0.8, 0.0)},
        {"diameter": 14.0, "distance": 200.0, "decentre": (0.0, 0.5), "tilt": (0.02, 0.0)},
    ]
    data["aperture"]["decentre"] = (-0.3, 0.2)
    data["microlens_array"]["layout"] = "hexagonal"
    return Design.make({**data, **changes})


DESIGNS = {name: load(name) for name in preset_names()}
DESIGNS["vignetted"] = load("paper").replace(D=12.0)
DESIGNS["at the lens"] = load("paper").replace(d_3=0.0)
DESIGNS["strange"] = strange()


@pytest.mark.parametrize("name", ["paper", "mismatched-borescope", "vignetted", "at the lens", "strange"])
def test_every_axis_has_a_label_with_its_unit(name):
    design = DESIGNS[name]
    with drawing():
        drawn = [
            figures.plot_ray_diagram(design),
            figures.plot_ray_diagram(design, instrument_only=True),
            figures.plot_cells(design, 0.0),
            figures.plot_microlens_image(design, (design.sensor_size[0] / 2, 0.0)),
            figures.plot_kept_fraction(design),
            figures.plot_image_offset(design),
            figures.plot_matching_plane(design),
            figures.plot_depth_precision(design),
            figures.plot_effects_budget(evaluate(design).effects),
        ]
    axes = {axes for ax in drawn for axes in ax.figure.axes}
    for ax in axes:
        for axis in (ax.xaxis, ax.yaxis):
            shared = axis.get_label_position() == "bottom" and ax not in drawn  # a twin or a colour bar
            if axis.get_visible() and axis.get_ticklabels() and not shared:
                assert "[" in axis.get_label_text(), (ax.get_title(), axis.get_label_text())


def test_axes_given_are_the_axes_returned():
    from matplotlib.figure import Figure

    ax = Figure().subplots()
    assert figures.plot_matching_plane(load("paper"), ax) is ax


def test_looks_end_with_the_drawing():
    import matplotlib

    before = dict(matplotlib.rcParams)
    with drawing():
        figures.plot_depth_precision(load("paper"))
    assert dict(matplotlib.rcParams) == before


def test_same_figure_same_text_and_no_identifiers_shared_between_figures():
    def draw(name):
        with drawing():
            return to_svg(plot_cells(load("paper")).figure, name)

    assert draw("a") == draw("a")
    ids = [set(re.findall(r' id="([^"]+)"', draw(name))) for name in "ab"]
    assert ids[0]
    assert not ids[0] & ids[1]


@pytest.mark.parametrize("name", ["paper", "ear-speculum", "rigid-scope", "pipe-bore"])
def test_matched_curve_passes_through_matched_designs(name):
    plane = matching_plane(load(name))
    for d_3, D_F in list(zip(plane.d_3, plane.exact, strict=True))[::40]:
        # 1e-12: a few roundings of quantities of order one.
        assert evaluate(load(name).replace(d_3=d_3, D_F=D_F)).f_number.fill_factor == pytest.approx(1, abs=1e-12)


@pytest.mark.parametrize("name", preset_names())
def test_plane_shows_design_and_curve_and_agrees_with_the_verdict(name):
    design = load(name)
    plane, result = matching_plane(design), evaluate(design)
    assert 0 <= design.d_3 < plane.d_3[-1]
    assert 0 < design.D_F < plane.D_F[-1]
    assert np.count_nonzero((plane.exact > 0) & (plane.exact < plane.D_F[-1])) > 0.3 * plane.d_3.size
    column, row = np.searchsorted(plane.d_3, design.d_3), np.searchsorted(plane.D_F, design.D_F)
    near = plane.margin[row - 1 : row + 1, max(column - 1, 0) : column + 1] >= 0
    assert near.any() or not result.non_distortion.undistorted_in_field
    assert not near.all() or result.non_distortion.undistorted_in_field


@pytest.mark.parametrize("name", ["mismatched-borescope", "vignetted"])
def test_kept_fraction_is_whole_inside_the_circle_of_eq_6_and_nowhere_outside(name):
    design = DESIGNS[name]
    fields = field_map(design, points=60)
    radius = evaluate(design).non_distortion.x_ml_max_mm
    distance = np.hypot(*np.meshgrid(fields.x, fields.y))
    assert ((fields.kept == 1) == (distance <= radius)).all()


def test_offset_map_is_the_pitch_law_where_nothing_is_clipped():
    design = load("paper")
    fields = field_map(design, points=20)
    growth = evaluate(design).microlens_image.pitch_mm / design.d - 1
    expected = np.stack(np.meshgrid(fields.x, fields.y), axis=-1) * growth / design.q
    np.testing.assert_allclose(fields.offset_px, expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("name", ["paper", "mismatched-borescope", "strange"])
def test_pixels_hold_what_a_fine_grid_of_points_finds(name):
    design = DESIGNS[name]
    place = (0.93 * design.sensor_size[0] / 2, 0.4 * design.sensor_size[1] / 2) if name != "strange" else (2.0, 1.0)
    view = image_view(design, place)
    n = 24
    fine = (np.arange(n) + 0.5) / n * design.q
    x, y = ((edges[:-1, None] + fine).ravel() for edges in (view.x, view.y))
    across, up = np.meshgrid(x, y)
    inside = np.ones(across.shape, bool)
    for centre, radius in zip(view.centres, view.radii, strict=True):
        inside &= np.hypot(across - centre[0], up - centre[1]) <= radius
    counted = inside.reshape(len(view.y) - 1, n, len(view.x) - 1, n).mean(axis=(1, 3))
    # A boundary of length at most ~2 pixels passes a pixel: that many of its n x n points may be miscounted.
    assert np.abs(counted - view.coverage).max() < 2.0 / n
    assert counted.mean() == pytest.approx(view.coverage.mean(), abs=2e-3)
    assert len(view.outline) > 0
    if view.on_sensor == pytest.approx(1, abs=1e-9):
        area = view.kept_fraction * math.pi * view.radii[0] ** 2
        assert view.coverage.sum() * design.q**2 == pytest.approx(area, rel=1e-9)


def test_pixels_lie_where_the_sensor_has_them():
    design = load("rigid-scope")
    assert image_view(design, (0.0, 0.0)).on_sensor == pytest.approx(1, abs=1e-9)
    beyond = image_view(design, (design.sensor_size[0] / 2, 0.0))
    assert beyond.on_sensor == 0
    edges = image_view(design, (0.3, 0.2)).x + 0.3
    steps = (edges + design.pixels[0] * design.q / 2) / design.q
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)


def test_dark_images_have_no_outline_and_no_pixels():
    view = image_view(DESIGNS["vignetted"], (11.15, 0.0))
    assert view.kept_fraction == 0
    assert view.outline.shape == (0, 2)
    assert not view.coverage.any()


@pytest.mark.parametrize("name", DESIGNS)
def test_blocked_rays_end_at_an_opening_they_miss_and_kept_ones_on_the_sensor(name):
    design = DESIGNS[name]
    openings = {-stop.distance: stop.diameter / 2 for stop in design.all_stops} | {0.0: design.D / 2}
    for fan in labelled_fans(design):
        # Within half a millimetre per mm of stop radius for the stop that is tilted in one of them.
        np.testing.assert_allclose(fan.z[fan.kept, -1], design.d_1 + design.d_2, rtol=1e-12)
        for z in fan.z[~fan.kept, -1]:
            assert min(abs(z - plane) for plane in openings) < 0.5
    if name == "vignetted":
        edge = labelled_fans(design)[1]
        inside = np.abs(edge.x[:, -1]) > design.D / 2
        assert (inside | (edge.z[:, -1] == -design.d_3)).all()


def test_depth_curve_passes_through_the_evaluation_at_the_focal_plane():
    design = load("paper")
    curve, told = depth_precision(design), evaluate(design).depth
    at_focus = np.interp(design.d_f, curve.distance, np.sqrt(curve.sigma)) ** 2  # sqrt of a parabola is linear
    assert at_focus == pytest.approx(told.sigma_z_mm, rel=1e-9)
    away = curve.distance - design.d_f
    near = np.abs(away) < 5
    rate = np.polyfit(away[near], curve.blur[near] * np.sign(away[near]), 2)[1]
    assert rate == pytest.approx(told.disparity_pitches_per_mm, rel=1e-3)


def test_names_never_touch():
    names = [(0.0, "FAP"), (0.3, "main lens"), (0.5, "MLA, sensor"), (9.0, "far")]
    assert name_rows(names, 1.0) == [0, 1, 2, 0]


def test_maps_and_images_follow_a_turned_and_shifted_array():
    import math

    paper = load("paper")
    moved = paper.replace(
        {"microlens_array.rotation": math.pi / 2, "microlens_array.decentre.0": 0.5, "sensor.decentre.1": 0.25}
    )
    ax = figures.plot_kept_fraction(moved)
    sensor = next(patch for patch in ax.patches if patch.get_label() == "sensor")
    corners = sensor.get_patch_transform().transform([(0, 0), (1, 0), (1, 1), (0, 1)])
    # In the array's axes the sensor, at (-0.5, 0.25) from its centre, is turned by a quarter the other way.
    np.testing.assert_allclose(corners.mean(axis=0), (0.25, 0.5), atol=1e-12)
    np.testing.assert_allclose(np.ptp(corners, axis=0), paper.sensor_size[::-1], rtol=1e-12)
    view, straight = image_view(moved, (2.0, 1.0)), image_view(paper, (-1.0 + 0.5, 2.0))
    np.testing.assert_allclose(view.centres, straight.centres, atol=1e-12)
