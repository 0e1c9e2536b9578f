"""MTF curves and the map of resolution: what they show, their units, and fields without light."""

import numpy as np

import roslf_design as roslf
from roslf_design.drawing.marks import Image, Line, Text
from roslf_design.reporting.design.curves import KnownLengths, depth_precision
from roslf_design.reporting.sheet.lines import basis, datasheet_section
from roslf_design.reporting.sheet.resolution import mtf_curves, resolution_map
from roslf_design.theory.light import on_array, sensor_field
from roslf_design.theory.quantities import QUANTITIES
from roslf_design.theory.stop_images import MicrolensImages

SCOPE = roslf.load("rigid-scope")
DARK = roslf.load("paper").replace({"stops": [{"diameter": 4.0, "distance": 40.0}]})


def test_curves_begin_at_one_and_pass_the_limits_that_the_sheet_tells():
    picture = mtf_curves(SCOPE)
    refocused = picture.panels[0]
    assert "lp/mm" in refocused.x_label
    curve = next(mark for mark in refocused.marks if isinstance(mark, Line) and mark.colour == "blue")
    x, y = np.asarray(curve.x), np.asarray(curve.y)
    assert y[0] == 1
    told = float(QUANTITIES["mtf50_lp_per_mm"](roslf.Camera.of(SCOPE)))
    assert abs(np.interp(told, x, y) - 0.5) < 2e-3  # drawn in steps


def test_an_ideal_lens_has_a_curve_in_place_of_a_map():
    """Its corner shows as much as its middle: shades would say nothing across."""
    (panel,) = resolution_map(SCOPE).panels
    (curve,) = panel.marks
    assert isinstance(curve, Line)
    assert (np.diff(np.asarray(curve.y)) < 0).all()
    told = [float(QUANTITIES["mtf50_lp_per_mm"](roslf.Camera.of(SCOPE), at)) for at in curve.x]
    assert np.allclose(curve.y, told, rtol=2e-3)  # searched for on a grid
    assert ("[mm]" in panel.x_label, "lp/mm" in panel.y_label) == (True, True)


def test_the_map_is_in_units_and_falls_with_distance():
    picture = resolution_map(roslf.load("cystoscope"))
    shades = next(mark for mark in picture.panels[0].marks if isinstance(mark, Image))
    assert (np.diff(shades.values[:, 0]) < 0).all()
    assert "[mm]" in picture.panels[0].y_label
    assert "lp/mm" in picture.panels[1].y_label


def test_dark_fields_are_named_and_the_map_ends_with_light():
    assert "corner: dark" in mtf_curves(DARK).svg()
    panel = resolution_map(DARK).panels[0]
    camera = roslf.Camera.of(DARK)
    low, high = (np.array([float(v) for v in end]) for end in sensor_field(camera))
    middle = (low + high) / 2
    share = np.linspace(1e-6, 1, 201)
    images = MicrolensImages(camera, on_array(camera, middle + share[:, None] * (high - middle)))
    light = images.shapes.kept_fraction
    lit = 100 * share[light.ravel() > 0].max()
    assert lit - 12 < panel.x.high <= lit + 1  # looked for in tenths of the way to the corner
    assert panel.x_label.endswith("dark beyond")
    rows = [row for block in datasheet_section(basis(DARK)).blocks for row in getattr(block, "rows", ())]
    assert any(row[1] == "dark" for row in rows)


def test_numbers_of_lines_are_clear_of_each_other_and_of_the_rim():
    """Of a scope that sees from 1.5 to 40 mm: all its detail lay in a corner of distances drawn in proportion."""
    panel = resolution_map(roslf.load("cystoscope")).panels[0]
    places = [np.array(panel.at(mark.x, mark.y)) for mark in panel.marks if isinstance(mark, Text)]
    assert len(places) >= 2
    for k, place in enumerate(places):
        assert all((np.abs(place - other) > (24, 12)).any() for other in places[:k])
        left, top, width, tall = panel.box
        assert left + 8 < place[0] < left + width - 8
        assert top + 6 < place[1] < top + tall - 6


def test_curves_over_distance_reach_what_is_asked_for():
    assert resolution_map(SCOPE).panels[0].x.high < 400
    asked = resolution_map(SCOPE, (4.0, 400.0)).panels[0].x
    assert (asked.low, asked.high) == (4.0, 400.0)
    drawn = depth_precision(SCOPE, known=KnownLengths(at=(4.0, 400.0))).panels[0].x
    assert drawn.low <= 4 < 400 <= drawn.high
