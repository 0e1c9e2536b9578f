"""What every picture must be, and that each says what the theory and the engines say."""

import itertools
import math
import pickle
import re
import xml.etree.ElementTree as ET
from functools import partial

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.design import load, preset_names
from roslf_design.drawing.marks import Area, Image, Text
from roslf_design.drawing.picture import PAGE
from roslf_design.drawing.theme import text_width
from roslf_design.errors import InputError
from roslf_design.evaluation import default_fields, evaluate
from roslf_design.evaluation.fields import field_openings
from roslf_design.evaluation.working_range import WorkingRange
from roslf_design.imaging.render import render
from roslf_design.imaging.white import ALWAYS_ON, white_patch
from roslf_design.reporting.blocks import Table
from roslf_design.reporting.design.curves import (
    KnownLengths,
    _depth_curve,
    _plane_of,
    depth_comparison,
    depth_over_field,
    depth_precision,
    matching_plane,
)
from roslf_design.reporting.design.effects import effects_budget
from roslf_design.reporting.design.field import field_map, field_maps, mla_map
from roslf_design.reporting.design.figures import dimensions_sheet, glance
from roslf_design.reporting.design.instrument import instrument_scene, scale_drawing
from roslf_design.reporting.design.microlens import (
    _image_view,
    microlens_image,
    microlens_images,
    nearest_microlens,
    preview,
    rays_and_waves,
)
from roslf_design.reporting.design.parts_list import parts_section
from roslf_design.reporting.design.rays import (
    _labelled_fans,
    cells,
    dimensions,
    meridional,
    ray_diagrams,
    ray_words,
)
from roslf_design.theory.depth_budget import depth_budget
from roslf_design.theory.length_covariance import LengthCovariance
from roslf_design.theory.vignetting import room_at
from roslf_design.units import parse_quantity
from tests.pictures.designs import DESIGNS, EXTREMES, PAPER, THROUGH, UNLIKE

SVG = "{http://www.w3.org/2000/svg}"
ALL = DESIGNS | EXTREMES | THROUGH
ALIKE = {*preset_names()} - {*UNLIKE}
"""Presets that are of a kind with another; the explorer's tests draw every view of them, `test_room` their sheets."""
KINDS = {name: design for name, design in ALL.items() if name not in ALIKE}
PICTURES = {
    "meridional": meridional,
    "rays": ray_diagrams,
    "cells": lambda d: cells(d.thin_twin, {"centre": 0.0, "edge": 0.4 * d.sensor_size[0]}),
    "dimensions": dimensions,
    "microlens": lambda d: microlens_image(d, default_fields(d)[2]),
    "microlens-waves": lambda d: microlens_image(d, default_fields(d)[0], waves=True, label="centre"),
    "mla-map": lambda d: mla_map(d, (0.3, -0.2)),
    "maps": lambda d: field_maps(d.thin_twin, field_map(d.thin_twin, 40)),
    "matching-plane": matching_plane,
    "depth": depth_precision,
    "effects": lambda d: effects_budget(evaluate(d.thin_twin).effects),
}


def _numbers(svg):
    for element in ET.fromstring(svg).iter():
        for key in ("x", "y", "x1", "x2", "y1", "y2", "cx", "cy", "r", "width", "height"):
            if key in element.attrib:
                yield float(element.attrib[key])
        if "d" in element.attrib:
            yield from (float(n) for n in re.findall(r"-?\d+\.?\d*(?:e-?\d+)?|nan|inf", element.attrib["d"]))


def _find(svg, testid):
    return [e for e in ET.fromstring(svg).iter() if e.attrib.get("data-testid") == testid]


def _mark(picture, testid):
    (mark,) = [m for m in picture.marks if m.testid == testid]
    return mark


def _words(svg):
    return " ".join(ET.fromstring(svg).itertext()).replace("\u200b", "")


@pytest.mark.parametrize("design", KINDS.values(), ids=KINDS)
@pytest.mark.parametrize("name", PICTURES)
def test_every_picture_of_every_kind_of_design_is_sound(name, design):
    picture = PICTURES[name](design)
    # Themes differ in colours alone.
    for theme in ("light", "dark") if design is PAPER else ("light",):
        svg = picture.svg(theme)
        root = ET.fromstring(svg)
        assert root.attrib["role"] == "img"
        label = root.find(f"{SVG}title")
        assert label.attrib["id"] == root.attrib["aria-labelledby"]
        assert label.text
        assert not re.search(r"\b(nan|inf)\b", " ".join(root.itertext()))
        assert all(math.isfinite(number) and abs(number) < 2e5 for number in _numbers(svg))
        assert min(float(e.attrib["font-size"]) for e in root.iter(f"{SVG}text")) >= 11
        ids = [e.attrib["id"] for e in root.iter() if "id" in e.attrib]
        prefix = root.attrib["data-testid"].removeprefix("picture-")
        assert len(ids) == len(set(ids))
        assert all(i.startswith(prefix) for i in ids)
        assert "http" not in svg.replace("http://www.w3.org/2000/svg", "")


def test_images_stand_in_a_row_with_one_legend():
    picture, on_sensor = microlens_images(
        {name: (PAPER, place) for name, place in zip("abc", default_fields(PAPER), strict=True)}
    )
    assert [panel.box[0] for panel in picture.panels] == sorted(panel.box[0] for panel in picture.panels)
    assert [key.text for key in picture.keys].count("image") == 1
    assert on_sensor == pytest.approx(1, abs=0.05)


@pytest.mark.parametrize("name", PICTURES)
def test_axes_have_labels_with_units_for_every_printer(name):
    picture = PICTURES[name](DESIGNS["vignetted"])
    panels = [panel for panel in picture.panels if not panel.bare]
    for panel in panels:
        x_ticks, y_ticks = panel.ticks()
        assert not any(label for _, label in x_ticks) or "[" in panel.x_label
        assert not any(label for _, label in y_ticks) or "[" in panel.y_label
    assert len(picture.figure().axes) == len(picture.panels) + 1  # legend and remarks


@pytest.mark.parametrize("name", KINDS)
def test_blocked_rays_end_at_an_opening_they_miss_and_kept_ones_on_the_sensor(name):
    design = ALL[name].thin_twin
    openings = {-float(rim.ruler_distance) for rim in (Camera.of(design).fap, *Camera.of(design).rims)}
    for fan in _labelled_fans(design):
        # Within half a millimetre per mm of stop radius for the stop that is tilted in one of them.
        np.testing.assert_allclose(fan.z[fan.kept, -1], design.d_1 + design.d_2, rtol=1e-12)
        for z in fan.z[~fan.kept, -1]:
            assert min(abs(z - plane) for plane in openings) < 0.5
    if name == "vignetted":
        edge = _labelled_fans(design)[1]
        inside = np.abs(edge.x[:, -1]) > design.D / 2
        assert (inside | (edge.z[:, -1] == -design.d_3)).all()


@pytest.mark.parametrize("whole", [True, False])
def test_lengths_are_to_scale_and_dimensioned(whole):
    picture = meridional(PAPER, whole=whole)
    words = _words(picture.svg()).replace("d 3", "d3")
    for text in ("d 3 = 120 mm", "d 1 = 140 mm", "d 2 = 2 mm", "D = 50.8 mm", "D F = 2.9 mm"):
        assert text.replace(" ", "") in words.replace(" ", "")
    assert ("df=350mm" in words.replace(" ", "")) == whole
    m = picture.mapping
    factor = m.per_px[0] / m.per_px[1]
    assert (f"heights ×{factor:.3g}" if whole else "to scale") in words
    assert whole or factor == pytest.approx(1.0)


@pytest.mark.parametrize("name", UNLIKE)
def test_a_report_s_section_fills_the_page_with_its_ends_below(name):
    design = load(name)
    whole, tip, sensor = ray_diagrams(design).panels
    assert whole.box[2] > 0.8 * PAGE
    assert min(tip.box[2], sensor.box[2]) > 0.65 * PAGE / 2
    assert tip.bottom == pytest.approx(sensor.bottom, abs=60)
    assert min(tip.box[1], sensor.box[1]) > whole.bottom
    thin = design.thin_twin.with_own_stop
    assert tip.x.low < -float(Camera.of(thin).tip) < tip.x.high
    assert sensor.x.low < thin.d_1 < thin.d_1 + thin.d_2 < sensor.x.high


@pytest.mark.parametrize("name", UNLIKE)
@pytest.mark.parametrize("close", ["", "tip", "sensor"])
def test_a_section_fills_its_width_and_tells_by_how_much_it_is_stretched(name, close):
    design = load(name)
    picture = meridional(design, (1076, 240), close=close)
    across, up = picture.mapping.per_px
    assert picture.mapping.box[2] > 0.85 * picture.size[0]
    stretched = next(key.text for key in picture.keys if "scale" in key.text)
    factor = re.search(r"(heights|lengths) ×([\d.]+)", stretched)
    expected = 1.0 if factor is None else float(factor[2]) ** (1 if factor[1] == "heights" else -1)
    assert across / up == pytest.approx(expected, rel=1e-3)
    for mark in picture.mapping.marks:
        if isinstance(mark, Text):
            x, _ = picture.mapping.at(mark.x, mark.y)
            assert 0 < x + mark.dx < picture.size[0]
    words = _words(picture.svg())
    tip = -float(Camera.of(design.thin_twin).tip)
    assert (picture.mapping.x.low <= tip <= picture.mapping.x.high) == (close != "sensor")
    assert ("sensor" in words) == (close != "tip")


def test_a_tip_without_a_name_in_it_is_drawn():
    """One window that is longer than the close-up of it."""
    window = {"kind": "plate", "distance": 1.0, "thickness": 4.0, "material": "N-BK7", "diameter": 4.0}
    assert "tip" in _words(ray_diagrams(load("rigid-scope").replace({"elements": [window]})).svg())


def test_a_distance_s_words_do_not_leave_the_picture():
    """d_3 too short for its words, and the FAP near the left end."""
    design = load("rigid-scope").replace({"D_F": 1.28, "d_3": 1.0, "f": 3.03, "d_1": 3.29})
    for panel in meridional(design, (PAGE, 300.0)).panels:
        (words,) = (mark for mark in panel.marks if isinstance(mark, Text) and mark.text.startswith("d_3"))
        x = panel.at(words.x, words.y)[0] + words.dx
        assert x - (text_width(words.text, words.size) if words.anchor == "end" else 0.0) > 0


@pytest.mark.parametrize("turn", ["30 deg", "70 deg", "-70 deg"])
def test_where_a_prism_looks_is_said_below_the_parts_names(turn):
    design = load("arthroscope").replace({"elements.0.deviation": parse_quantity(turn, "angle")})
    panel = meridional(design, (PAGE, 210.0), whole=True).panels[0]
    words = [mark for mark in panel.marks if isinstance(mark, Text)]
    (view,) = (mark for mark in words if mark.text.startswith("view"))
    names = [mark for mark in words if mark.text.startswith(("FAP", "plate", "prism"))]
    lowest = max(panel.at(mark.x, mark.y)[1] + mark.dy for mark in names)
    assert panel.at(view.x, view.y)[1] + view.dy - view.size > lowest


def test_sections_of_two_designs_drawn_alike_have_the_same_axes():
    """One shows the object plane and is stretched otherwise where it is drawn alone."""
    scope = load("rigid-scope")
    other = scope.replace({"d_3": 2.5, "d_f": 90.0, "D_F": 0.6})
    alone = [meridional(design, (PAGE, 170.0), key=False).mapping for design in (scope, other)]
    assert alone[0].per_px != alone[1].per_px
    pair = [(scope, other), (other, scope)]
    alike = [meridional(design, (PAGE, 170.0), key=False, like=like).mapping for design, like in pair]
    assert [(panel.x, panel.y, panel.box[0], panel.box[2:]) for panel in alike[:1]] == [
        (panel.x, panel.y, panel.box[0], panel.box[2:]) for panel in alike[1:]
    ]


@pytest.mark.parametrize(("angle", "told"), [("70 deg", "70°"), ("-30 deg", "30°")])
def test_a_section_of_a_camera_that_looks_aside_says_that_it_is_drawn_unfolded(angle, told):
    design = load("arthroscope").replace({"elements.0.deviation": parse_quantity(angle, "angle")})
    words = f"drawn unfolded along the light: it looks {told} from straight ahead"
    assert words in [key.text for key in meridional(design).keys]
    assert words in glance(design, views=False).caption
    assert words in dimensions_sheet(design).caption
    assert "unfolded" not in dimensions_sheet(PAPER).caption


@pytest.mark.parametrize("name", ["paper", "cystoscope", "rigid-scope"])
def test_the_glance_s_caption_tells_which_scale_is_stretched(name):
    across, up = meridional(load(name), (PAGE, 210.0), key=False).mapping.per_px
    factor = re.search(r"(heights|lengths) ×(\d+(?:\.\d+)?)", glance(load(name), views=False).caption)
    expected = 1.0 if factor is None else float(factor[2]) ** (1 if factor[1] == "heights" else -1)
    assert across / up == pytest.approx(expected, rel=1e-3)


def test_pixels_of_a_microlens_are_its_exact_coverage():
    place = nearest_microlens(PAPER, (5.0, -3.0))
    (image,) = [mark for mark in microlens_image(PAPER, place).marks if isinstance(mark, Image)]
    exact = field_openings(PAPER, [place]).common().area[0] / PAPER.q**2
    assert image.values.sum() == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize("name", ["paper", "mismatched-borescope", "strange"])
def test_pixels_hold_what_a_fine_grid_of_points_finds(name):
    design = DESIGNS[name]
    place = (0.93 * design.sensor_size[0] / 2, 0.4 * design.sensor_size[1] / 2) if name != "strange" else (2.0, 1.0)
    view = _image_view(design, place)
    n = 24
    fine = (np.arange(n) + 0.5) / n * design.q
    x, y = ((edges[:-1, None] + fine).ravel() for edges in (view.x, view.y))
    across, up = np.meshgrid(x, y)
    inside = np.ones(across.shape, bool)
    for centre, radius in zip(view.openings.centres, view.openings.radii, strict=True):
        inside &= np.hypot(across - centre[0], up - centre[1]) <= radius
    counted = inside.reshape(len(view.y) - 1, n, len(view.x) - 1, n).mean(axis=(1, 3))
    # A boundary of length at most ~2 pixels passes a pixel: that many of its n x n points may be miscounted.
    assert np.abs(counted - view.coverage).max() < 2.0 / n
    assert counted.mean() == pytest.approx(view.coverage.mean(), abs=2e-3)
    assert len(view.outline) > 0
    if view.on_sensor == pytest.approx(1, abs=1e-9):
        area = view.kept_fraction * math.pi * view.openings.radii[0] ** 2
        assert view.coverage.sum() * design.q**2 == pytest.approx(area, rel=1e-9)


def test_pixels_lie_where_the_sensor_has_them():
    design = DESIGNS["rigid-scope"]
    assert _image_view(design, (0.0, 0.0)).on_sensor == pytest.approx(1, abs=1e-9)
    assert _image_view(design, (design.sensor_size[0] / 2, 0.0)).on_sensor == 0
    edges = _image_view(design, (0.3, 0.2)).x + 0.3
    steps = (edges + design.pixels[0] * design.q / 2) / design.q
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)


def test_the_nearest_microlens_is_one_and_near():
    x, y = nearest_microlens(PAPER, (1.0, -2.0))
    assert (x / PAPER.d) == pytest.approx(round(x / PAPER.d))
    assert abs(x - 1) <= PAPER.d / 2 + 1e-12
    assert abs(y + 2) <= PAPER.d / 2 + 1e-12
    corner = default_fields(PAPER)[2]
    inner = nearest_microlens(PAPER, corner, inward=True)
    assert all(a <= b + 0.002 * PAPER.d for a, b in zip(inner, corner, strict=True))
    assert all(b - a < 1.01 * PAPER.d for a, b in zip(inner, corner, strict=True))
    with pytest.raises(InputError, match=r"microlens_array\.pitch: 900 mm leaves no whole microlens on the array"):
        microlens_image(PAPER.replace(d=900.0), (0.0, 0.0))


@pytest.mark.parametrize("name", ["paper", "paper-mismatched", "rigid-scope", "ear-speculum", "dark"])
@pytest.mark.parametrize("corner", [False, True])
def test_the_quick_patch_is_the_rendered_image(name, corner):
    design = ALL[name]
    side = 24
    width, height = design.pixels
    column, row = (width - side, height - side) if corner else (width // 2 - 12, height // 2 - 12)
    quick = white_patch(design, slice(column, column + side), slice(row, row + side))
    whole = render(design, region=(column, row, side, side), threads=1, overrides=ALWAYS_ON).pixels
    # What `white_patch` promises: light of far microlenses is replaced by that of the other side.
    np.testing.assert_allclose(quick, whole, atol=1e-2)


def test_what_cannot_be_seen_is_told_instead():
    told = _words(PICTURES["microlens-waves"](ALL["a thousandfold overlap"]).svg())
    assert "too many images overlap for diffraction" in told or "pixels too small to draw" in told
    assert "pixels too small to draw" in _words(PICTURES["microlens"](ALL["pixels by the million"]).svg())


@pytest.mark.parametrize("change", [{"q": 1e-9}, {"q": 14.9}, {"D_F": 1e5}, {"f_ml": 1e-9}, {"d_2": 1e5}, {"D": 1e-9}])
def test_extreme_numbers_are_drawn_or_told_within_little_memory(change):
    design = PAPER.replace(**change)
    for waves in (True, False):
        assert len(microlens_image(design, default_fields(design)[2], waves=waves).svg()) < 500_000


def test_a_dark_microlens_is_called_dark():
    corner = default_fields(ALL["dark"])[2]
    view = _image_view(ALL["dark"], corner)
    assert (view.kept_fraction, view.outline.shape, view.coverage.any()) == (0, (0, 2), False)
    svg = microlens_image(ALL["dark"], corner).svg()
    assert _find(svg, "microlens-kept")[0].text == "dark"
    assert not _find(svg, "microlens-outline")
    assert "dark" in _find(mla_map(ALL["dark"]).svg(), "mla-shares")[0].text
    assert _find(mla_map(PAPER).svg(), "mla-shares")[0].text.endswith("all whole")


@pytest.mark.parametrize("name", ["mismatched-borescope", "vignetted"])
def test_kept_fraction_is_whole_inside_the_circle_of_eq_6_and_nowhere_outside(name):
    design = DESIGNS[name]
    fields = field_map(design, points=60)
    radius = evaluate(design).non_distortion.x_ml_max_mm
    distance = np.hypot(*np.meshgrid(fields.x, fields.y))
    assert ((fields.kept == 1) == (distance <= radius)).all()
    assert _mark(mla_map(design), "eq6-circle").radius == pytest.approx(radius)
    (shown,) = [mark for mark in mla_map(design).marks if isinstance(mark, Image)]
    at = np.random.default_rng(1).integers(min(shown.values.shape), size=(40, 2))
    left, right, low, high = shown.box
    rows, columns = shown.values.shape
    places = np.stack(
        [left + (at[:, 1] + 0.5) / columns * (right - left), low + (at[:, 0] + 0.5) / rows * (high - low)], -1
    )
    np.testing.assert_allclose(
        shown.values[tuple(at.T)], field_openings(design, places).common().kept_fraction, rtol=1e-9
    )


def test_report_and_explorer_count_whole_and_cut_images_alike():
    design = DESIGNS["mismatched-borescope"]
    fields = field_map(design)
    told = [text.text for text in field_maps(design, fields).marks if isinstance(text, Text)]
    told += [panel.title for panel in field_maps(design, fields).panels]
    (shown,) = _find(mla_map(design).svg(), "mla-shares")
    assert shown.text in told
    # What is whole by Eq. 6, counted microlens by microlens, to a percentage point.
    x, y = (np.arange(-round(side / design.d / 2), round(side / design.d / 2) + 1) * design.d for side in (9.0, 7.5))
    at = np.meshgrid(x, y)
    seen = [
        np.abs(place) <= side / 2
        for place, side in zip(Camera.of(design).chief_point(*at), design.sensor_size, strict=True)
    ]
    whole = (np.hypot(*at) <= evaluate(design).non_distortion.x_ml_max_mm)[seen[0] & seen[1]].mean()
    assert abs(int(re.search(r"(\d+) % whole", shown.text)[1]) - 100 * whole) <= 1


def test_offset_map_is_the_pitch_law_where_nothing_is_clipped():
    fields = field_map(PAPER, points=20)
    growth = evaluate(PAPER).microlens_image.pitch_mm / PAPER.d - 1
    expected = np.stack(np.meshgrid(fields.x, fields.y), axis=-1) * growth / PAPER.q
    np.testing.assert_allclose(fields.offset_px, expected, rtol=1e-9, atol=1e-12)


def test_maps_and_images_follow_a_turned_and_shifted_array():
    moved = PAPER.replace(
        {"microlens_array.rotation": math.pi / 2, "microlens_array.decentre.0": 0.5, "sensor.decentre.1": 0.25}
    )
    sensor = _mark(mla_map(moved), "mla-sensor")
    # What the sensor, at (-0.5, 0.25) from the array's centre, sees is turned by a quarter the other way in its axes:
    # half the sensor over 1 + d_2/L, on the left up to the array's end, 11.5 mm from its centre.
    grow = 1 - 2 / 460
    right, high, low = 11.15 / grow - 0.5, (0.25 + 7.466) / grow, (0.25 - 7.466) / grow
    np.testing.assert_allclose((sensor.x.min(), sensor.x.max()), (low, high), rtol=1e-12)
    np.testing.assert_allclose((sensor.y.min(), sensor.y.max()), (-right, 11.5), rtol=1e-12)
    view, straight = _image_view(moved, (2.0, 1.0)), _image_view(PAPER, (-1.0 + 0.5, 2.0))
    np.testing.assert_allclose(view.openings.centres, straight.openings.centres, atol=1e-12)


@pytest.mark.parametrize("name", ["paper", "ear-speculum", "rigid-scope", "pipe-bore"])
def test_matched_curve_passes_through_matched_designs(name):
    plane = _plane_of(DESIGNS[name])
    for d_3, D_F in list(zip(plane.d_3, plane.exact, strict=True))[::40]:
        # 1e-12: a few roundings of quantities of order one.
        assert evaluate(DESIGNS[name].replace(d_3=d_3, D_F=D_F)).f_number.fill_factor == pytest.approx(1, abs=1e-12)


@pytest.mark.parametrize("name", [*UNLIKE, "mismatched-borescope"])
def test_plane_shows_design_and_curve_and_agrees_with_the_verdict(name):
    design = DESIGNS[name].thin_twin
    plane, result = _plane_of(design), evaluate(design)
    assert 0 <= design.d_3 < plane.d_3[-1]
    assert 0 < design.D_F < plane.D_F[-1]
    assert np.count_nonzero((plane.exact > 0) & (plane.exact < plane.D_F[-1])) > 0.3 * plane.d_3.size
    column, row = np.searchsorted(plane.d_3, design.d_3), np.searchsorted(plane.D_F, design.D_F)
    near = plane.margin[row - 1 : row + 1, max(column - 1, 0) : column + 1] >= 0
    assert near.any() or not result.non_distortion.undistorted_in_field
    assert not near.all() or result.non_distortion.undistorted_in_field


def test_the_design_point_maps_to_the_design_and_axes_stay_when_told():
    picture = matching_plane(PAPER)
    (point,) = _find(picture.svg(), "design-point")
    value = picture.mapping.to_value(float(point.attrib["cx"]), float(point.attrib["cy"]))
    assert value == pytest.approx((120.0, 2.9), rel=1e-3)  # a hundredth of a pixel
    limits = picture.mapping.x.high, picture.mapping.y.high
    moved = matching_plane(PAPER.replace(d_3=30.0, D_F=4.0), limits=limits).mapping
    assert (moved.box, moved.x, moved.y) == (picture.mapping.box, picture.mapping.x, picture.mapping.y)


def test_the_region_of_eq_6_ends_where_the_margin_vanishes():
    picture = matching_plane(PAPER)
    region = _mark(picture, "eq6-region")
    # Others lie on the frame.
    corners = [(x, y) for x, y in zip(region.x, region.y, strict=True) if 0 < y < picture.mapping.y.high and x > 0]
    assert len(corners) > 3
    for d_3, D_F in corners:
        camera = Camera.of(PAPER, {"d_3": d_3, "D_F": D_F})
        x0 = np.hypot(*PAPER.sensor_size) / 2 / (1 + PAPER.d_2 * camera.vergence) * PAPER.d_f / PAPER.d_1
        # The room bends a little with the image pitch where it is drawn straight; it falls by d_f/2g per mm of D_F.
        hundredth_px = 0.01 * picture.mapping.y.high / picture.mapping.box[3]
        assert abs(2 * camera.gap * float(room_at(camera, x0)[0])) < hundredth_px * PAPER.d_f


def test_depth_over_the_field_of_a_single_microlens_is_a_dot():
    """With the stop just before the plane in focus the sensor sees no farther than the axis."""
    design = roslf.load("cystoscope").replace({"d_3": 120.4, "depth.disparity_error": 0.1})
    assert default_fields(design) == ((0.0, 0.0),) * 3
    picture = depth_over_field(design)
    (dot,) = (mark for mark in picture.marks if mark.testid == "field-curve")
    assert [*dot.x] == [0.0]
    assert 0 < dot.y[0] < math.inf
    assert picture.svg().count('data-testid="field-curve"') == 1


def test_depth_curve_passes_through_the_evaluation_at_the_focal_plane():
    own = evaluate(PAPER)
    assert _depth_curve(PAPER).least == pytest.approx(own.depth.sigma_z_mm, rel=1e-9)
    assert _depth_curve(PAPER).in_focus == pytest.approx(float(own.depth_budget.u_z_mm), rel=1e-9)
    fixed = PAPER.replace({"depth.disparity_error": 0.1})
    curve, told = _depth_curve(fixed), evaluate(fixed).depth
    at_focus = np.interp(curve.focus, curve.distance, np.sqrt(curve.sigma)) ** 2  # sqrt of a parabola is linear
    assert at_focus == pytest.approx(told.sigma_z_mm, rel=1e-9)
    away = curve.distance - (PAPER.d_f - PAPER.d_3)  # the FAP is the tip
    near = np.abs(away) < 5
    rate = np.polyfit(away[near], curve.blur[near] * np.sign(away[near]), 2)[1]
    assert rate == pytest.approx(told.disparity_pitches_per_mm, rel=1e-3)
    both = depth_comparison({"A": PAPER, "B": DESIGNS["rigid-scope"]})
    assert [key.text[0] for key in both.keys] == ["A", "B"]


def test_bars_of_effects_are_as_long_as_their_shares():
    effects = evaluate(PAPER).effects
    picture = effects_budget(effects)
    for effect in effects:
        if effect.estimate:
            bar = _mark(picture, f"effect-{effect.name}")
            assert isinstance(bar, Area)
            assert np.max(bar.x) == pytest.approx(abs(effect.estimate) / effect.budget)
    roomy, tight = (_words(effects_budget(effects, (560, h)).svg()) for h in (640, 240))
    assert "blur width" in roomy
    assert "Of no size here: vignetting" in roomy
    assert "blur width" not in tight
    assert "no effect has a size" in effects_budget(()).svg()


def test_a_hexagonal_array_is_hexagonal_by_rays_by_waves_and_in_its_cell():
    """Six neighbours a pitch away, at 60 degrees; the cell's corners lie between them."""
    turn = 0.2
    changes = {"microlens_array.layout": "hexagonal", "microlens_array.rotation": turn, "light.wavelength": 4e-5}
    design = PAPER.replace(changes)
    rays, waves = rays_and_waves(design, samples=41).panels[::2]
    (ray,), (wave,) = ([mark for mark in panel.marks if isinstance(mark, Image)] for panel in (rays, waves))
    pitch, radius = 0.062726086956521737, 2.9 * 35 / 23 * 2 / 140 / 2
    x, y = np.meshgrid(*[np.linspace(-0.75, 0.75, 41) * pitch] * 2)
    angles = turn + np.pi / 3 * np.arange(6)
    middles = [(0.0, 0.0), *(pitch * np.stack([np.cos(angles), np.sin(angles)], -1))]
    count = sum(((x - a) ** 2 + (y - b) ** 2 <= radius**2).astype(float) for a, b in middles)
    near = np.hypot(x, y) < 0.8 * pitch  # farther out, light of the next ring
    np.testing.assert_array_equal(ray.values[near], count[near])
    assert np.abs(wave.values - count)[near].mean() < 0.05  # the wave image of short waves is that of rays
    for panel in (rays, waves):
        cells = [np.stack([mark.x, mark.y], -1) for mark in panel.marks if isinstance(mark, Area)]
        for cell in cells:
            assert np.allclose(np.hypot(*cell.T), 1e3 * pitch / np.sqrt(3))
            corners = np.sort(np.mod(np.arctan2(cell[:, 1], cell[:, 0]) - turn, np.pi / 3))
            assert np.allclose(corners, np.pi / 6)


def test_waves_and_raw_images_are_shown_with_their_scales():
    picture = rays_and_waves(PAPER, samples=31)
    assert "74.1 %" in picture.panels[2].title
    assert all("µm" in panel.x_label for panel in picture.panels[::2])
    raw = render(PAPER, region=(0, 0, 200, 100), threads=1)
    places = ("centre", "edge", "corner")
    assert {panel.title for panel in preview(raw).panels} >= {f"{place} of this region" for place in places}
    small = PAPER.replace({"sensor.size": (0.96, 0.48)})
    assert {panel.title for panel in preview(render(small, threads=1)).panels} >= {*places}


@pytest.mark.parametrize("name", THROUGH)
def test_depth_precision_is_told_where_a_ruler_finds_the_object(name):
    """At the focal plane as `evaluate` says; beside it the spread of a point is that of two traced rays."""
    design = THROUGH[name]
    curve = _depth_curve(design, 15)
    assert curve.least == pytest.approx(evaluate(design).depth.sigma_z_mm, rel=1e-9)
    ahead = design.d_f - float(Camera.of(design).tip)
    assert float(np.interp(ahead, curve.distance, curve.blur)) == pytest.approx(0, abs=1e-6 * curve.blur.max())
    # sigma is the disparity error over how fast disparity changes with the object's place.
    near, at = _depth_curve(design.replace({"depth.disparity_error": 0.1}), 100_001), 60_000
    rate = abs(near.blur[at + 1] - near.blur[at - 1]) / (near.distance[at + 1] - near.distance[at - 1])
    assert near.sigma[at] == pytest.approx(0.1 / rate, rel=1e-6)
    assert curve.distance[0] > 0


def test_depth_is_drawn_over_the_working_range_and_all_that_is_required():
    """Each distance's u and bound as the budget there says, with lengths as built; signs met by what is drawn."""
    asked = {
        "u_z_mm": [{"at": 3.0, "max": 0.9}, {"at": 60.0, "max": 0.01}],
        "field_half_width_mm": {"at": 90, "min": 1},
    }
    scope = load("rigid-scope").replace({"required": asked})
    known = KnownLengths(LengthCovariance(("microlens_array.distance", "aperture.distance"), np.diag([1e-4, 1e-3])))
    curve, camera = _depth_curve(scope, 7, known), Camera.of(scope)
    near, far = WorkingRange.of(camera, partial(known.budget, camera)).ends
    assert curve.distance[0] < 3.0 < near < far <= curve.distance[-1] * (1 + 1e-9)
    assert {3.0, 60.0, 90.0} <= {*curve.distance}
    for at, u, bound in zip(curve.distance[::3], curve.expected[::3], curve.sigma[::3], strict=True):
        budget = depth_budget(camera, float(at), build=known.build)
        assert (u, bound) == pytest.approx((float(budget.u_z_mm), float(budget.terms[0].u_mm)), rel=1e-6)
        assert u > bound
    picture = depth_precision(scope, known=known)
    keys = [key.text for key in picture.keys]
    assert any(text.startswith("U, depth, expected") and "with lengths as built" in text for text in keys)
    assert "required: U at most 1.8 mm at 3 mm, met" in keys
    colours = {key.text: key.samples[0].colour for key in [*picture.keys, *depth_precision(scope).keys] if key.samples}
    told = {"met as drawn": "orange", "met": "green"}  # as verdicts have it: met with a reservation, and without one
    assert {word: colours[f"required: U at most 1.8 mm at 3 mm, {word}"] for word in told} == told
    assert "required: U at most 0.02 mm at 60 mm, missed" in keys
    assert not any("at 90 mm" in text for text in keys)  # is no limit on depth
    signs = [mark for mark in picture.marks if mark.testid == "required"]
    assert [(*mark.x, *mark.y) for mark in signs] == [(3.0, 1.8), (60.0, 0.02)]  # as quoted: U = 2 u
    assert picture.panels[0].y_label == "depth, U (k = 2) [mm]"
    assert {"depth-curve", "sigma-curve"} <= {mark.testid for mark in picture.marks}


def test_elements_are_drawn_where_a_ruler_puts_them():
    """Glass between its faces and as high as its clear aperture; the medium begins at the farthest face."""
    design = THROUGH["needle"]
    picture = meridional(design)
    for number, (near, far, radius) in enumerate([(1.0, 32.4, 1.35), (32.6, 32.9, 1.3)], 1):
        mark = _mark(picture, f"element-{number}")
        assert (min(mark.x), max(mark.x)) == pytest.approx((-far, -near))
        assert (min(mark.y), max(mark.y)) == pytest.approx((-radius, radius))
    assert max(_mark(picture, "medium").x) == pytest.approx(-32.9)
    assert "n = 1.333" in _words(picture.svg())
    assert not [mark for mark in meridional(PAPER).marks if mark.testid in ("medium", "element-1")]
    assert "prism 1, unfolded: turns by 29.8°" in _words(meridional(THROUGH["prism and cover"]).svg())


def test_a_design_from_another_process_lies_in_air_as_before():
    """Its air is equal, not the same object."""
    there = pickle.loads(pickle.dumps(THROUGH["objective"]))
    assert meridional(there).svg() == meridional(THROUGH["objective"]).svg()
    assert evaluate(there).object_space == evaluate(THROUGH["objective"]).object_space


def test_the_tube_is_drawn_to_the_scale_of_heights_with_its_limit():
    """Wall, light guide and the outer diameter that is required, where the design file puts them."""
    tube = {"outer_diameter": "6 mm", "wall": "0.2 mm", "light_guide": "0.3 mm", "length": "2 mm"}
    scope = load("rigid-scope")
    stated = scope.replace({"tube": tube, "required": {"outer_diameter_mm": {"max": "7 mm"}}})
    picture = meridional(stated)
    bands = {(min(np.abs(m.y)), max(np.abs(m.y))) for m in picture.marks if m.testid == "tube"}
    assert sorted(bands) == [pytest.approx((2.5, 2.8)), pytest.approx((2.8, 3.0))]
    ends = {(min(m.x), max(m.x)) for m in picture.marks if m.testid == "tube"}
    assert list(ends) == [pytest.approx((-0.5, 1.5))]
    assert {abs(m.y[0]) for m in picture.marks if m.testid == "tube-limit"} == {3.5}
    told = " ".join(key.text for key in picture.keys)
    assert "tube, 6 mm outside light guide required: at most 7 mm" in told
    narrowest = meridional(scope)
    outer = evaluate(scope).answer.outer_diameter_mm
    assert {float(abs(m.y[0])) for m in narrowest.marks if m.testid == "tube"} == {outer / 2}
    assert f"narrowest tube, {outer:g} mm outside" in [key.text for key in narrowest.keys]


@pytest.mark.parametrize(
    ("name", "size", "stretched"),
    [("ear-speculum", (PAGE, 300.0), False), ("pipe-bore", (PAGE, 300.0), False), ("rigid-scope", (PAGE, 210.0), True)],
)
def test_a_section_that_nearly_fits_is_to_scale_and_a_stretched_one_has_a_drawing_to_scale_below(name, size, stretched):
    design = load(name)
    picture = meridional(design, size)
    across, up = picture.mapping.per_px
    assert (across == pytest.approx(up)) is not stretched
    assert ("to scale" in [key.text for key in picture.keys]) is not stretched
    caption = glance(design, views=False).caption
    assert ("between them, to scale, the camera as it is built" in caption) == ("heights to scale" in caption)
    (panel,) = scale_drawing(design, 322.0).panels
    assert panel.per_px[0] == pytest.approx(panel.per_px[1])
    # Ends of the tube, by the lengths of the design's file.
    tubes = [part for part in instrument_scene(design, side=True).parts if part.label in ("tube", "around all parts")]
    long = None if design.tube is None else design.tube.length
    assert {part.label == "tube" for part in tubes} == {design.tube is not None}
    whole = design.d_3 + design.d_1 + design.d_2
    assert np.ptp(np.concatenate([part.points for part in tubes])[:, 2]) == pytest.approx(long or whole)


def test_names_above_a_folded_drawing_do_not_stand_on_each_other_or_its_title():
    picture = scale_drawing(load("arthroscope"), 322.0)
    (panel,) = picture.panels
    names = [mark for mark in panel.marks if isinstance(mark, Text)]
    boxes = [(*panel.at(mark.x, mark.y), text_width(mark.text, mark.size) / 2) for mark in names]
    assert len(boxes) == 5
    for (x, y, half), (other, level, width) in itertools.combinations(boxes, 2):
        assert abs(x - other) >= half + width or abs(y - level) >= 12
    assert all(y > 26 for _, y, _ in boxes)


@pytest.mark.parametrize(("length", "told"), [(2.0, ", 2 mm"), (None, "")])
def test_dimensions_show_the_tube_with_its_bore_and_length(length, told):
    """Wall and bore in the ratio of the file's diameters, and as wide as a window of the bore's width is high."""
    tube = {"outer_diameter": 9.0, "wall": 1.0} | ({} if length is None else {"length": length})
    design = load("video-otoscope").replace({"tube": tube, "elements.0.diameter": 7.0})
    (panel,) = dimensions(design).panels
    (words,) = [mark.text for mark in panel.marks if isinstance(mark, Text) and mark.text.startswith("tube")]
    assert words == f"tube \u2300 9 / 7 mm{told}"
    walls = [mark for mark in panel.marks if isinstance(mark, Area) and mark.testid == "tube"]
    (inner, outer), *others = {(min(np.abs(mark.y)), max(np.abs(mark.y))) for mark in walls}
    assert not others
    assert outer / inner == pytest.approx(9 / 7)
    blocks = [mark for mark in panel.marks if isinstance(mark, Area) and max(mark.y) == pytest.approx(inner)]
    assert blocks, "the window"
    rows = next(block for block in parts_section(design).blocks if isinstance(block, Table)).rows
    assert [row[1] for row in rows].count("tube") == 1


def test_a_round_field_has_one_pencil_at_its_rim():
    """Edge and corner of what is judged lie on one circle: drawn twice, one colour hides the other."""
    round_field = load("rigid-scope").replace({"required": {"round_field_radius_mm": {"at": "20 mm", "min": "1 mm"}}})
    assert "rays of centre (blue) and rim (green)" in ray_words(round_field)
    assert "edge (green) and corner (purple)" in ray_words(load("rigid-scope"))
