"""Pictures of what runs found say what they found."""

import math
import xml.etree.ElementTree as ET
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from roslf_design.design import load
from roslf_design.drawing.theme import PLAIN, text_width
from roslf_design.explorer.forms import GOALS
from roslf_design.explorer.optimise_run import OptimiseResult
from roslf_design.explorer.tolerance_run import ToleranceResult
from roslf_design.explorer.view import DRAWINGS, front
from roslf_design.reporting.optimise.pictures import (
    SearchEnd,
    VariableMove,
    bore_and_stop,
    change_bars,
    goal_front,
    robust_yields,
    search_history,
)
from roslf_design.reporting.tolerance.pictures import (
    LimitSpread,
    Offender,
    distributions,
    offender_bars,
    ranked_correlations,
    ranked_moves,
    spread_bars,
    yield_bars,
    yield_curve,
)
from roslf_design.tolerancing.yields import Yield

SVG = "{http://www.w3.org/2000/svg}"
HALF, MOST = Yield(2000, 4000), Yield(3600, 4000)
TOLERANCE = ToleranceResult(
    grade="precision",
    share=HALF,
    limits=(("image fill, edge", HALF),),
    offenders=(
        Offender("lens focal length", "1 mm", math.inf, "unvignetted fraction, corner"),
        Offender("sensor distance", "20 um", 2.5, "image fill, edge"),
        Offender("aperture diameter", "50 um", 0.25, "depth spread σ_Z"),
        Offender("aperture tilt x", "3 mrad", 1e-9, "image fill, edge"),
    ),
    spreads=(
        LimitSpread("image fill, edge", 1.0, 0.95, 1.05, 0.9, 1.1),
        LimitSpread("unvignetted fraction, corner", 1.0, -math.inf, 1.0, 0.99, math.inf),
        LimitSpread("image-centre error, edge", 0.0, 0.0, 0.0, -math.inf, 1.0),
    ),
    grades=(
        ("commercial", Yield(400, 4000)),
        ("precision", Yield(1920, 4000)),
        ("high", MOST),
    ),
    curve=((0.5, MOST), (1.0, HALF), (2.0, Yield(0, 4000))),
    question="",
    target=0.95,
)
OPTIMUM = OptimiseResult(
    goal=GOALS["depth"],
    before=1.25,
    after=0.6,
    changes=(VariableMove("D_F", 2.9, 5.8, 1.45, 5.8), VariableMove("d_3", 120.0, 100.0, 60.0, 240.0)),
    followers=(("d_1", 140.0, 141.0),),
    design=None,
    sentences=(),
    ends=(
        SearchEnd(20, 0.0, "start"),
        SearchEnd(50, 0.3, "start"),
        SearchEnd(60, 5.0, "bad"),
        SearchEnd(900, 0.0, "check"),
    ),
    against=GOALS["field"],
    front=((0.6, 20.0), (0.8, 28.0), (1.4, 40.0)),
)
MOVES = np.array([3.0, -1.0, 0.2])
PICTURES = {
    "yield": yield_bars(TOLERANCE, target=0.8),
    "yield-curve": yield_curve(TOLERANCE, target=0.8, reached=0.7),
    "offenders": offender_bars(TOLERANCE.offenders),
    "spread": spread_bars(TOLERANCE.spreads),
    "sensitivity": ranked_moves(["d_3", "d_2", "D"], MOVES, -MOVES, [2.5, -math.inf], "offset [px]"),
    "correlation": ranked_correlations(["d_3", "d_2", "D"], MOVES / 4, 0.1, "offset"),
    "changes": change_bars(OPTIMUM.changes),
    "history": search_history(OPTIMUM.ends),
    "front": front(OPTIMUM),
    "bore": bore_and_stop(np.arange(3.0), np.ones(3), np.ones(3) / 2, np.zeros(3)),
    "robust": robust_yields([("image fill ≤ 1", 0.5, 0.9), ("all together", 0.0, 1.0)]),
}


def _find(svg, testid):
    return [e for e in ET.fromstring(svg).iter() if e.attrib.get("data-testid") == testid]


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("name", PICTURES)
def test_every_picture_is_sound(name, theme):
    root = ET.fromstring(PICTURES[name].svg(theme))
    assert root.attrib["data-testid"] == f"picture-{name}"
    assert root.attrib["role"] == "img"
    assert min(float(e.attrib["font-size"]) for e in root.iter(f"{SVG}text")) >= 11
    for element in root.iter():
        for key in ("x", "y", "width", "height", "cx", "cy", "r", "x1", "x2", "y1", "y2"):
            if key in element.attrib:
                assert math.isfinite(float(element.attrib[key]))
    assert "nan" not in " ".join(root.itertext())


def test_pictures_say_what_they_are_of_in_png_too(real_pngs):
    for name in ("yield", "history", "changes"):
        assert PICTURES[name].to_png(40).startswith(b"\x89PNG")


def _widths(picture, *testids):
    return [float(np.ptp(np.asarray(m.x)[:5])) for t in testids for m in picture.marks if m.testid == t]


def test_bars_of_yields_are_as_long_as_the_yields():
    # That of the run itself, not of the shorter one by grade.
    assert _widths(PICTURES["yield"], *(f"yield-{n}" for n in ("commercial", "precision", "high"))) == [10, 50, 90]


def test_offenders_that_break_a_limit_alone_look_different_and_small_ones_are_left_out():
    picture = PICTURES["offenders"]
    shown = [m for k in range(4) for m in picture.marks if m.testid == f"offender-{k}"]
    assert [bar.fill for bar in shown] == ["vermillion", "vermillion", "blue"]
    assert _widths(picture, "offender-1", "offender-2") == pytest.approx([250, 25])
    words = [m.text for m in offender_bars(TOLERANCE.offenders, (210, 300)).marks if hasattr(m, "text")]
    assert "250 %" in words
    assert any("unvignetted fraction, corner undefined" in m.text for m in picture.marks if hasattr(m, "text"))
    assert "no tolerance matters" in offender_bars(()).svg()


@pytest.mark.parametrize("reached", [0.1, 0.7, 5.0])
def test_a_factor_beyond_the_axis_is_named_at_its_end(reached):
    curve = yield_curve(TOLERANCE, target=0.8, reached=reached)
    (words,) = (m for m in curve.marks if getattr(m, "text", "") == f"80 % at {reached:g} times")
    assert TOLERANCE.curve[0][0] <= words.x <= TOLERANCE.curve[-1][0]
    assert (words.dx > 0) == (words.x < 1)  # into the picture, whose axis is logarithmic about 1


def test_scatter_is_drawn_on_the_way_to_its_limit():
    assert _widths(PICTURES["spread"], "spread-0") == pytest.approx([100])


def test_a_variable_at_its_bound_is_marked():
    (at_bound,), (inside,) = (_find(PICTURES["changes"].svg(), f"change-{name}") for name in ("D_F", "d_3"))
    assert at_bound.attrib["fill"] != inside.attrib["fill"]
    assert "at bound" in PICTURES["changes"].svg()


def test_no_front_without_a_second_goal():
    with pytest.raises(ValueError, match="one goal alone"):
        front(replace(OPTIMUM, against=None))


def test_a_search_that_was_stopped_says_so():
    found = replace(OPTIMUM, design=load("paper"))
    assert "stopped" not in found.page()["headline"]
    assert replace(found, stopped=True).page()["headline"].endswith("0.6 mm, the best when it was stopped")
    assert replace(OPTIMUM, stopped=True).page()["headline"].startswith("Stopped before a design was found")


def test_pictures_that_say_no_more_than_a_sentence_are_not_drawn():
    """One design where goals do not compete, and searches that all ended at the answer."""

    def drawn(name, **changed):
        return DRAWINGS[name].inputs(SimpleNamespace(runs={"optimise": replace(OPTIMUM, **changed)})) is not None

    assert [drawn("front", front=((0.6, 20.0),) * count) for count in (0, 1, 2)] == [False, False, True]
    ends = SearchEnd(10, 0.0, "start"), SearchEnd(20, 1e-9, "check", "crs2")
    assert [drawn("search", ends=(*ends, *more)) for more in ((), (SearchEnd(30, 0.1, "start"),))] == [False, True]


def test_a_third_goal_is_told_by_shade_and_bar():
    points = np.array([[1.0, 5.0, 1.0], [2.0, 3.0, 10.0], [5.0, 2.4, 100.0]])
    picture = goal_front(points, ["a [mm]", "b [mm]", "c [1]"], log=(True, False, True), answer=(2.0, 3.0))
    assert len({m.colour for m in picture.marks if m.__class__.__name__ == "Dots" and m.edge == "grey"}) == 3
    assert {"a [mm]", "b [mm]", "c [1]", "the optimum"} <= {
        "".join(e.itertext()) for e in ET.fromstring(picture.svg()).iter()
    }


def test_a_goal_s_words_are_not_cut_by_the_picture():
    long = "depth, expected, u_Z at 40 mm, of all lengths as built [mm] (less is better)"
    picture = goal_front(np.array([[1.0, 5.0, 1.0], [2.0, 3.0, 10.0]]), ["a", long, long], answer=(2.0, 3.0))
    _, top, _, tall = picture.panels[0].box
    assert top + tall / 2 > text_width(long, PLAIN) / 2
    assert picture.size[1] - top - tall / 2 > text_width(long, PLAIN) / 2


def test_densities_hold_all_builds():
    cuts, counts = np.linspace(0, 4, 9), np.array([0, 1, 5, 9, 8, 4, 1, 0])
    picture = distributions([("as built", cuts, counts), ("adjusted", cuts / 2, counts)], 1.0, [3.0], "x [mm]")
    for mark in picture.marks[:2]:
        x, y = np.asarray(mark.x), np.asarray(mark.y)
        assert float(np.sum((y[1:] + y[:-1]) / 2 * np.diff(x))) == pytest.approx(1.0)
