"""Numbers, text and scales that all pictures are made of."""

import itertools
import math
import xml.etree.ElementTree as ET

import pytest
from hypothesis import given
from hypothesis import strategies as st

from roslf_design.explorer.pictures.axes import Mapping, Scale, log_ticks, round_ticks
from roslf_design.explorer.pictures.svg import SMALL, px, short, tag, text, text_width, wrapped
from roslf_design.explorer.pictures.theme import THEMES, theme_named

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
    ticks = log_ticks(low, low * ratio)
    assert ticks == sorted(ticks)
    assert all(low * (1 - 1e-6) <= tick <= low * ratio * (1 + 1e-6) for tick in ticks)


@given(length, length, st.floats(-500, 500), st.floats(1, 1e3))
def test_a_mapping_goes_there_and_back(px_, py, low, span):
    mapping = Mapping(50, 20, 300, 200, low, low + span, 2 * low, 2 * low + 3 * span)
    back = mapping.to_px(*mapping.to_value(px_, py))
    # Values of about 1e3, at 16 digits, over spans down to 1, on a few hundred pixels.
    assert back == pytest.approx((px_, py), abs=1e-7)
    assert mapping.to_value(50, 220) == pytest.approx((low, 2 * low), abs=1e-9)


def test_up_is_up():
    mapping = Mapping(0, 0, 100, 100, 0, 1, 0, 1)
    assert mapping.to_px(1, 1) == (100, 0)
    assert Scale(1, 100, log=True).share(10) == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("value", "told"),
    [(0.0, "0"), (120.0, "120"), (31.7460317, "31.75"), (-0.01234567, "−0.01235"), (123456.0, "123500"),
     (1.5e-7, "1.5×10⁻⁷"), (2e9, "2×10⁹"), (math.inf, "∞"), (99999.6, "100000")],
)  # fmt: skip
def test_numbers_are_short(value, told):
    assert short(value) == told


def test_text_is_escaped_and_symbols_are_set():
    made = text((1, 2), 'd_3 < "5" & um', "#000")
    assert "".join(ET.fromstring(made).itertext()).replace("\u200b", "") == 'd3 < "5" & µm'
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
