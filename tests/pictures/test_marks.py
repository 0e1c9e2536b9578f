"""Numbers, text and scales that all pictures are made of."""

import base64
import io
import itertools
import math
import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image as Pixels

from roslf_design.drawing import marks
from roslf_design.drawing.marks import Area, Disc, Dots, Image, Line, Text, bars, line_key, where_above
from roslf_design.drawing.panel import Panel, Scale, _log_ticks, round_ticks
from roslf_design.drawing.picture import Picture, beside, one_panel
from roslf_design.drawing.svg import _with_subscripts, px, tag
from roslf_design.drawing.theme import SMALL, THEMES, rows_of_names, short, text_width, theme_named, wrapped

length = st.floats(-1e4, 1e4)


@given(length, st.floats(1e-6, 1e6), st.integers(2, 12))
def test_round_ticks_are_few_even_and_inside(low, span, wanted):
    high = low + span
    ticks = round_ticks(low, high, wanted)
    assert 2 <= len(ticks) <= max(wanted + 1, 6)
    assert all(low - 1e-6 * span <= tick <= high + 1e-6 * span for tick in ticks)
    steps = [b - a for a, b in itertools.pairwise(ticks)]
    if steps:
        digit = steps[0] / 10 ** math.floor(math.log10(steps[0]) + 1e-6)
        assert min(abs(digit - wanted_digit) for wanted_digit in (1, 2, 5)) < 1e-3
        # Differences of numbers up to 1e4 lose digits to rounding.
        assert max(steps) - min(steps) < 1e-3 * steps[0] + 1e-11 * abs(low)


@given(st.floats(1e-6, 1e3), st.floats(1.5, 1e9))
def test_log_ticks_stay_within_the_axis(low, ratio):
    ticks = _log_ticks(low, low * ratio)
    assert ticks == sorted(ticks)
    assert all(low * (1 - 1e-6) <= tick <= low * ratio * (1 + 1e-6) for tick in ticks)


@given(length, length, st.floats(-500, 500), st.floats(1, 1e3))
def test_a_mapping_goes_there_and_back(px_, py, low, span):
    mapping = Panel((50, 20, 300, 200), Scale(low, low + span), Scale(2 * low, 2 * low + 3 * span))
    back = mapping.at(*mapping.to_value(px_, py))
    # Values of about 1e3, at 16 digits, over spans down to 1, on a few hundred pixels.
    assert back == pytest.approx((px_, py), abs=1e-7)
    assert mapping.to_value(50, 220) == pytest.approx((low, 2 * low), abs=1e-9)


def test_up_is_up():
    mapping = Panel((0, 0, 100, 100), Scale(0, 1), Scale(0, 1))
    assert mapping.at(1, 1) == (100, 0)
    assert Scale(1, 100, log=True).share(10) == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("value", "told"),
    [(0.0, "0"), (120.0, "120"), (31.7460317, "31.75"), (-0.01234567, "−0.01235"), (123456.0, "123500"),
     (1.5e-7, "1.5×10⁻⁷"), (2e9, "2×10⁹"), (math.inf, "∞"), (99999.6, "100000"), (9e-15, "0"), (-0.0, "0")],
)  # fmt: skip
def test_numbers_are_short(value, told):
    assert short(value) == told


def test_text_is_escaped_and_symbols_are_set():
    made = _with_subscripts('d_3 < "5" & um')
    assert "".join(ET.fromstring(f"<t>{made}</t>").itertext()).replace("\u200b", "") == 'd3 < "5" & µm'
    assert "&lt;" in made
    assert tag("g", data_testid='a"b') == '<g data-testid="a&quot;b"/>'
    assert px(-0.001) == "0"


def _luminance(colour):
    channels = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.parametrize("theme", THEMES.values(), ids=THEMES)
@pytest.mark.parametrize("hue", ["ink", "grey", "blue", "green", "vermillion", "purple"])
def test_colours_of_text_have_the_contrast_that_wcag_asks_for(theme, hue):
    light, dark = sorted((_luminance(getattr(theme, hue)), _luminance(theme.ground)), reverse=True)
    assert (light + 0.05) / (dark + 0.05) >= 4.5


@given(st.lists(st.text("abcdef_", min_size=1, max_size=12), min_size=1, max_size=30), st.integers(1, 5))
def test_wrapped_lines_are_narrow_and_hold_the_text(words, most):
    whole = wrapped(" ".join(words), 90)
    assert " ".join(whole) == " ".join(words)
    assert all(text_width(line, SMALL) <= 90 or " " not in line for line in whole)
    short_ = wrapped(" ".join(words), 90, most=most)
    assert len(short_) <= most
    assert (short_ == whole) == (len(whole) <= most)
    assert len(whole) <= most or short_[-1].endswith(" …")


def test_an_unknown_theme_is_named():
    with pytest.raises(ValueError, match="'blue' is not known; use light or dark"):
        theme_named("blue")


ONE_OF_EACH = (
    Line([1.0, 2.0, np.nan, 3.0, 4.0], [1.0, 10.0, np.nan, 10.0, 1.0], "blue", ends="<>"),
    Area([1.0, 4.0, 4.0, np.nan, 1.0, 2.0, 2.0], [1.0, 1.0, 90.0, np.nan, 50.0, 50.0, 90.0], "green", 0.5, "ink"),
    Area([1.0, 2.0, 2.0], [1.0, 1.0, 3.0], "grey", hatch=True),
    bars([1.0, 1.0], [2.0, 3.0], [10.0, 20.0], 2.0),
    Line([1.5, 2.5], [10.0, 10.0], ends="|"),
    *(Dots([2.0, 3.0], [5.0, 50.0], "orange", shape) for shape in "osD^v<>*x+|"),
    Text(2.0, 10.0, "d_3 & more", halo=True),
    Text(2.0, 20.0, "plate", plate=True, anchor="end"),
)
PANEL = Panel((60, 20, 300, 200), Scale(1, 4), Scale(1, 100, log=True), ONE_OF_EACH, "x [mm]", "d_3 [mm]", "title")
ROUND = Panel(
    (60, 20, 200, 200), Scale(-1, 1), Scale(-1, 1),
    (Image(np.eye(3), (-1, 1, -1, 1), "cividis"), Disc(0.5, 0.5, 0.25, "blue")), equal=True,
)  # fmt: skip


def picture(panel=PANEL):
    return one_panel("sample", "One of each", (420, 300), panel, [line_key("a line", "blue")])


def test_marks_are_where_their_values_are():
    made = picture()
    panel = made.panels[0]
    assert panel.at(1, 1) == pytest.approx((panel.box[0], panel.bottom))
    assert panel.at(2.5, 10) == pytest.approx((panel.box[0] + panel.box[2] / 2, panel.box[1] + panel.box[3] / 2))
    root = ET.fromstring(made.svg())
    d = next(e.attrib["d"] for e in root.iter() if e.attrib.get("d", "").count("M") == 2)
    first = tuple(float(v) for v in d[1:].split(" ")[0].split(","))
    assert first == pytest.approx(panel.at(1, 1), abs=0.006)
    circle = next(e for e in ET.fromstring(picture(ROUND).svg()).iter() if e.tag.endswith("circle"))
    round_panel = picture(ROUND).panels[0]
    assert float(circle.attrib["r"]) == pytest.approx(0.25 / round_panel.per_px[0], abs=0.006)


def test_both_printers_draw_every_mark_and_say_the_same_words():
    made = picture()
    root = ET.fromstring(made.svg())
    written = {"".join(e.itertext()).replace("\u200b", "") for e in root.iter() if e.tag.endswith("}text")}
    assert {"d3 & more", "plate", "x [mm]", "d3 [mm]", "title", "a line", "10", "100"} <= written
    figure = made.figure()
    ax = figure.axes[0]
    assert (ax.get_xlabel(), ax.get_xscale(), ax.get_yscale()) == ("x [mm]", "linear", "log")
    assert ax.get_xlim() == (1, 4)
    signs = {line.get_marker() for line in ax.lines} - {"None"}
    assert signs == set("osD^v<>*x+|")
    assert {"plate", "$d_{3}$ & more"} <= {text.get_text() for text in ax.texts}
    assert len(ax.patches) == 4  # an area and its edge, a hatch, bars
    np.testing.assert_array_equal(ax.lines[0].get_xdata(), ONE_OF_EACH[0].x)
    assert len(picture(ROUND).figure().axes[0].images) == 1


def test_same_picture_same_bytes_in_both_formats(real_pngs):
    assert picture().svg() == picture().svg()
    assert picture().svg("dark") != picture().svg()
    assert picture().to_png(72) == picture().to_png(72)
    assert picture().svg_file().startswith(b"<?xml")


def test_pictures_beside_and_below_keep_their_marks_and_identifiers_apart():
    for down in (False, True):
        joined = beside("row", "", [picture(), picture(ROUND)], down=down)
        assert isinstance(joined, Picture)
        assert len(joined.marks) == len(ONE_OF_EACH) + 2
        ids = [e.attrib["id"] for e in ET.fromstring(joined.svg()).iter() if "id" in e.attrib]
        assert len(ids) == len(set(ids))
        assert all(name.startswith(joined.name) for name in ids)
        assert "a line" in joined.svg()


def test_drawing_leaves_matplotlibs_settings(real_pngs):
    import matplotlib

    before = dict(matplotlib.rcParams)
    picture().to_png(50)
    assert dict(matplotlib.rcParams) == before


def test_names_never_touch():
    widths = [0.6 * len(name) for name in ("FAP", "main lens", "MLA, sensor", "far")]
    assert rows_of_names([0.0, 0.3, 0.5, 9.0], widths) == [0, 1, 2, 0]


def test_outlines_of_a_level_enclose_its_area_without_its_hole():
    x = np.linspace(-2, 2, 201)
    r = np.hypot(*np.meshgrid(x, x))
    rings = where_above(np.minimum(r - 0.5, 1.5 - r), x, x, 0.0)
    area = 0.0
    for ring in np.split(rings, np.flatnonzero(np.isnan(rings[:, 0]))):
        u, v = ring[~np.isnan(ring[:, 0])].T
        area += 0.5 * float(np.sum(u[:-1] * v[1:] - u[1:] * v[:-1]))
    # Linear between points of a grid of 0.02 errs by second order.
    assert abs(area) == pytest.approx(math.pi * (1.5**2 - 0.5**2), rel=1e-3)
    assert where_above(np.zeros((3, 3)), x[:3], x[:3], 1.0).shape == (0, 2)


def test_shades_run_over_their_ramp_and_leave_out_what_is_not_there():
    shades = THEMES["light"].shades("grey", np.array([-1.0, 0.0, 0.5, 1.0, np.nan]))
    assert shades[:, 0].tolist() == [0, 0, 128, 255, 0]
    assert shades[:, 3].tolist() == [255, 255, 255, 255, 0]
    kept = {tuple(v) for v in THEMES["light"].shades("kept", np.array([0.0, 1e-6, 1 - 1e-6, 1.0])).tolist()}
    assert len(kept) == 4


@pytest.mark.parametrize("downwards", [False, True])
def test_an_image_stands_as_its_scale_runs(downwards, real_pngs):
    """Row 0 is at the lower end of the image's box, wherever the scale has that."""
    values = np.array([[0.0, 0.0], [1.0, 1.0]])
    scale = Scale(2.0, 0.0) if downwards else Scale(0.0, 2.0)
    panel = Panel((10, 10, 100, 100), Scale(0.0, 2.0), scale, (Image(values, (0.0, 2.0, 0.0, 2.0)),), bare=True)
    picture = Picture("image", "An image", (120, 120), (panel,))
    tag = re.search(r"<image [^>]*>", picture.svg())[0]
    box = {name: float(re.search(rf'\b{name}="([-\d.]+)"', tag)[1]) for name in ("x", "y", "width", "height")}
    assert box == {"x": 10, "y": 10, "width": 100, "height": 100}
    content = base64.b64decode(re.search(r'base64,([^"]+)"', tag)[1])
    with Pixels.open(io.BytesIO(content)) as stored:
        top = np.asarray(stored.convert("L"))[0]
    with Pixels.open(io.BytesIO(picture.to_png(96))) as drawn:
        shown = np.asarray(drawn.convert("L"))
    assert (top == (0 if downwards else 255)).all()
    assert abs(int(shown[30, 60]) - int(top[0])) < 3  # matplotlib agrees


THIN = ("ink", 0.8, "")


def test_lines_of_equal_values_lie_where_values_are_equal():
    x, y = np.linspace(0, 3, 31), np.linspace(1, 2, 21)
    levels = [(4.0, "4", THIN), (7.95, "7.95", THIN), (20.0, "20", THIN)]
    drawn = marks.contours(np.add.outer(y, 2 * x), x, y, levels, (300, 200))
    lines = [mark for mark in drawn if isinstance(mark, marks.Line)]
    for line, level in zip(lines, (4.0, 7.95), strict=True):  # none of a value that is nowhere
        np.testing.assert_allclose(2 * np.asarray(line.x) + line.y, level, atol=1e-12)
    assert [mark.text for mark in drawn if isinstance(mark, marks.Text)] == ["4"]  # of a mere corner none


def test_numbers_on_lines_of_equal_values_cover_neither_each_other_nor_what_is_kept_free_nor_the_edge():
    x, y, size = np.linspace(0.0, 1.0, 41), np.linspace(0.0, 1.0, 41), (300.0, 200.0)
    steep = np.broadcast_to(1.0 / (0.05 + x), (41, 41))  # its lines crowd at one side
    levels = [(level, f"at most {level} mm", THIN) for level in (19.0, 12.0, 8.0, 5.0, 4.0, 2.0)]
    drawn = marks.contours(steep, x, y, levels, size, [(0.45, 0.5)])
    told = [mark for mark in drawn if isinstance(mark, marks.Text)]
    assert [mark.text for mark in told] == [text for _, text, _ in levels]
    wide = [text_width(mark.text, mark.size) for mark in told]
    places = [(mark.x * size[0] + mark.dx, mark.y * size[1]) for mark in told]
    for k, (across, up) in enumerate(places):
        assert wide[k] / 2 <= across <= size[0] - wide[k] / 2
        assert abs(across - told[k].x * size[0]) <= wide[k] / 2 + 5  # beside its line at most
        others = [(*place, width / 2) for place, width in zip(places[:k], wide[:k], strict=True)] + [
            (135.0, 100.0, 6.0)
        ]
        assert all(abs(across - a) > (wide[k] / 2 + half) or abs(up - b) >= told[k].size for a, b, half in others)
