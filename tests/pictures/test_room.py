"""Pictures leave room for what they show: sections that stay wide, labels beside lines, small files."""

import re
import xml.etree.ElementTree as ET

import matplotlib
import numpy as np
import pytest
from PIL import ImageFont

from roslf_design.design import load, preset_names
from roslf_design.drawing.marks import Area, Disc, Dots, Line, Text
from roslf_design.drawing.svg import redrawn
from roslf_design.drawing.theme import SMALL, text_width, theme_named
from roslf_design.evaluation import evaluate
from roslf_design.reporting.design.curves import matching_plane
from roslf_design.reporting.design.field import field_map, field_maps, mla_map
from roslf_design.reporting.design.figures import SHEETS, lens_sheets
from roslf_design.reporting.design.microlens import ON_PICTURE, microlens_image
from roslf_design.reporting.design.rays import cells, dimensions, meridional, ray_diagrams
from roslf_design.reporting.tolerance.pictures import Yields, yield_bars
from roslf_design.tolerancing.yields import Yield
from tests.pictures.designs import DESIGNS, PAPER, THROUGH

LOOKING = THROUGH | {name: design for name, design in DESIGNS.items() if design.elements}
FONT = ImageFont.truetype(f"{matplotlib.get_data_path()}/fonts/ttf/DejaVuSans.ttf", 1000)
BOLD = ImageFont.truetype(f"{matplotlib.get_data_path()}/fonts/ttf/DejaVuSans-Bold.ttf", 1000)


@pytest.mark.parametrize(
    "words", ["telecentric: d", "unvignetted fraction, edge", "D = 50.8 mm", "Eq. 6: undistorted", "90.4 %"]
)
def test_words_are_taken_as_wide_as_the_widest_font_sets_them(words):
    assert 0.97 < text_width(words, SMALL) / (FONT.getlength(words) * SMALL / 1000) < 1.12


def _outside(svg):
    """Lines of text that leave their picture at a side, as the widest font sets them."""
    root = ET.fromstring(svg)
    for text in root.iter("{http://www.w3.org/2000/svg}text"):
        words = "".join(text.itertext()).replace("\u200b", "")
        font = BOLD if "font-weight" in text.attrib else FONT
        wide = font.getlength(words) * float(text.attrib["font-size"]) / 1000
        left = float(text.attrib["x"]) - {"middle": wide / 2, "end": wide}.get(text.attrib.get("text-anchor"), 0.0)
        if "transform" not in text.attrib and not -1 <= left <= float(root.attrib["width"]) + 1 - wide:
            yield words


@pytest.mark.parametrize("name", preset_names())
def test_no_text_of_a_preset_s_figures_leaves_its_picture(name):
    design = load(name)
    result = evaluate(design)
    sheets = [SHEETS[key](design, result) for key in ("dimensions", "cells", "images", "plane", "depth", "effects")]
    for figure in sheets if result.real_lens is None else [*sheets, *lens_sheets(design, result, result.real_lens)]:
        assert not list(_outside(figure.content)), figure.name


@pytest.mark.parametrize("name", preset_names())
def test_no_text_of_a_section_leaves_a_phone_s_screen(name):
    assert not list(_outside(meridional(load(name), (372, 290)).svg()))


@pytest.mark.parametrize("near", [0.9, 0.99, 1 - 1e-6])
@pytest.mark.parametrize("name", ["paper", "rigid-scope", "ear-speculum", "pipe-bore"])
def test_blocked_rays_do_not_shrink_the_section_where_the_pupil_nears_the_focal_plane(name, near):
    design = DESIGNS[name].thin_twin
    picture = meridional(design.replace(d_3=near * design.d_f), (1040, 240))
    panel, half = picture.panels[0], picture.panels[0].y.high
    assert panel.box[2] > 280  # of 1040; the ear speculum is half as high as long
    blocked = [mark for mark in picture.marks if isinstance(mark, Line) and mark.testid.startswith("blocked")]
    assert blocked
    assert max(np.nanmax(np.abs(mark.y)) for mark in blocked) <= half * (1 + 1e-12)
    crosses = [mark for mark in picture.marks if isinstance(mark, Dots)]
    assert all(abs(y) <= half for mark in crosses for y in mark.y)


def test_a_diameter_without_room_stands_with_its_element_s_name():
    design = DESIGNS["rigid-scope"]  # its sensor stands 2 mm behind the lens, of 27 mm in all
    panel = meridional(design, (768.0, 300.0), whole=True).panels[0]
    words = {mark.text: mark for mark in panel.marks if isinstance(mark, Text)}
    assert "main lens, D = 3 mm" in words
    assert "D = 3 mm" not in words


@pytest.mark.parametrize(("d_3", "D_F"), [(120.0, 2.9), (345.0, 2.9), (100.0, 3.0)])
def test_numbers_of_a_small_plane_stand_in_its_legend_and_on_no_curve(d_3, D_F):
    picture = matching_plane(PAPER.replace(d_3=d_3, D_F=D_F), (340, 330))
    assert not [mark for mark in picture.panels[0].marks if isinstance(mark, Text)]
    keys = [key.text for key in picture.keys]
    assert f"this design: d_3 = {d_3:g} mm, D_F = {D_F:g} mm" in keys
    assert "telecentric: d_3 = f" in keys


def test_no_target_line_runs_through_a_yield():
    share = Yield(3702, 4096)
    panel = yield_bars(Yields("precision", share, (("precision", share),), ()), target=0.95).panels[0]
    line = next(mark for mark in panel.marks if isinstance(mark, Line) and mark.colour == "orange")
    words = next(mark for mark in panel.marks if isinstance(mark, Text) and mark.text == "90.4 %")
    assert panel.at(words.x, 0.0)[0] + words.dx > panel.at(line.x[0], 0.0)[0] + 3


def test_a_map_where_all_is_kept_is_no_white_paper():
    """Where all is kept the report has no map of it at all, and the explorer's names that shade alone."""
    for theme in ("light", "dark"):
        whole, ground = (theme_named(theme).colour(name) for name in ("whole", "ground"))
        channels = [[int(colour[k : k + 2], 16) for k in (1, 3, 5)] for colour in (whole, ground)]
        assert max(abs(a - b) for a, b in zip(*channels, strict=True)) > 40
    cut = load("mismatched-borescope")
    report = [[key.text for key in field_maps(each, field_map(each, 40)).keys] for each in (PAPER, cut)]
    assert not {"whole", "cut, a little to nearly all", "dark"} & set(report[0])
    assert report[1][:2] == ["whole", "cut, a little to nearly all"]
    assert mla_map(PAPER).keys[0].text == "whole"
    assert "cut" not in mla_map(PAPER).keys[1].text


def test_legends_have_the_colours_of_what_they_name():
    """Shades of cut images run from `cut` to `lost`; on a picture of light, outlines are drawn in another colour."""
    theme = theme_named("light")
    key = next(key for key in mla_map(load("mismatched-borescope")).keys if key.text.startswith("cut"))
    shades = theme.shades("kept", np.array([1 - 1e-9, 1e-9]))[:, :3]
    assert [theme.colour(sample.fill) for sample in key.samples] == [f"#{shade.tobytes().hex()}" for shade in shades]
    for waves in (False, True):
        picture = microlens_image(PAPER, (0.0, 0.0), waves=waves)
        outline = next(mark for mark in picture.marks if mark.testid == "microlens-outline")
        image, fap = picture.keys[:2]
        assert image.samples[0].colour == outline.colour == (ON_PICTURE if waves else "ink")
        assert fap.samples[0].colour == next(mark for mark in picture.marks if isinstance(mark, Disc)).edge


def test_names_with_spaces_and_brackets_clip():
    picture = microlens_image(PAPER, (0.0, 0.0), name="f/4 (edge)")
    svg = picture.svg()
    assert redrawn(text := picture.svg(name="at the edge"), "at the edge") == text
    known = {element.get("id") for element in ET.fromstring(svg).iter() if element.get("id")}
    asked = set(re.findall(r"url\(#(.*?)\)[\"']", svg))
    assert asked
    assert asked <= known
    assert all(re.fullmatch(r"[\w-]+", name) for name in known)


def test_a_million_pixels_behind_five_microlenses_are_a_small_file():
    assert len(cells(PAPER.replace(q=1e-5), {"centre": 0.0, "edge": 11.0}).svg()) < 50_000
    plain = cells(PAPER, {"centre": 0.0})
    assert any(isinstance(mark, Area) and mark.fill == "pale" and len(mark.x) > 100 for mark in plain.marks)


@pytest.mark.parametrize("size", [(1040.0, 300.0), (420.0, 260.0)])
@pytest.mark.parametrize("name", LOOKING)
def test_words_of_a_section_with_elements_do_not_touch(name, size):
    design = LOOKING[name]
    for picture in (meridional(design, size), ray_diagrams(design), dimensions(design)):
        for panel in picture.panels:
            boxes = []
            for mark in (mark for mark in panel.marks if isinstance(mark, Text)):
                wide = FONT.getlength(re.sub("_", "", mark.text)) * mark.size / 1000
                x, y = panel.at(mark.x, mark.y)
                left = x + mark.dx - wide * {"start": 0.0, "middle": 0.5, "end": 1.0}[mark.anchor]
                boxes.append((left, left + wide, y + mark.dy - 0.7 * mark.size, y + mark.dy, mark.text))
            for n, (left, right, top, bottom, text) in enumerate(boxes):
                for other in boxes[:n]:
                    apart = left >= other[1] or right <= other[0] or top >= other[3] or bottom <= other[2]
                    assert apart, (picture.name, text, other[4])


@pytest.mark.parametrize("name", LOOKING)
def test_no_line_strikes_through_the_words_of_a_dimension(name):
    (panel,) = dimensions(LOOKING[name]).panels
    lines = [mark for mark in panel.marks if isinstance(mark, Line) and np.size(mark.x) == 2]
    words = [mark for mark in panel.marks if isinstance(mark, Text) and mark.anchor == "middle" and "=" in mark.text]
    low = [mark for mark in words if mark.y < 0]
    assert any(mark.text.startswith("d_f") for mark in low)
    for mark in low:
        x, y = panel.at(mark.x, mark.y)
        half = FONT.getlength(re.sub("_", "", mark.text)) * mark.size / 2000
        for line in lines:
            (x0, y0), (x1, y1) = (panel.at(*end) for end in zip(np.ravel(line.x), np.ravel(line.y), strict=True))
            apart = max(x0, x1) <= x - half or min(x0, x1) >= x + half or max(y0, y1) < y - 4 or min(y0, y1) > y + 4
            assert apart, mark.text


@pytest.mark.parametrize("ahead", [205.0, 290.0, 325.0])
def test_words_beside_a_short_dimension_are_within_the_picture(ahead):
    """Of a tube far ahead of the lens as well, whose line leaves no room for them on the object's side."""
    tube = {"outer_diameter": 4.8, "wall": 0.3, "length": 10.0}
    picture = dimensions(PAPER.replace({"tube": tube, "D_F": 1.5, "stops": [{"diameter": 4.0, "distance": ahead}]}))
    (panel,) = picture.panels
    for mark in (mark for mark in panel.marks if isinstance(mark, Text)):
        wide = FONT.getlength(re.sub("_", "", mark.text)) * mark.size / 1000
        left = panel.at(mark.x, mark.y)[0] + mark.dx - wide * {"start": 0.0, "middle": 0.5, "end": 1.0}[mark.anchor]
        assert left >= 0, mark.text
        assert left + wide <= picture.size[0], mark.text
