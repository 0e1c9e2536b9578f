"""Pictures of what runs found say what they found."""

import math
import xml.etree.ElementTree as ET

import pytest

from roslf_design.explorer.pictures.optimise import change_bars, front, search_history
from roslf_design.explorer.pictures.tolerance import offender_bars, spread_bars, yield_bars, yield_curve
from roslf_design.explorer.runs import (
    LimitSpread,
    Offender,
    OptimiseResult,
    SearchEnd,
    Share,
    ToleranceResult,
    VariableMove,
)

SVG = "{http://www.w3.org/2000/svg}"
HALF, MOST = Share(0.5, 0.45, 0.55), Share(0.9, 0.88, 0.92)
TOLERANCE = ToleranceResult(
    grade="precision",
    trials=1000,
    share=HALF,
    limits=(("fill factor, edge", HALF),),
    offenders=(
        Offender("lens focal length", "1 mm", math.inf, "kept fraction, corner"),
        Offender("sensor distance", "20 um", 2.5, "fill factor, edge"),
        Offender("aperture diameter", "50 um", 0.25, "depth spread σ_Z"),
        Offender("aperture tilt x", "3 mrad", 1e-9, "fill factor, edge"),
    ),
    spreads=(
        LimitSpread("fill factor, edge", 1.0, 0.03, 0.95, 1.05, 0.9, 1.1),
        LimitSpread("kept fraction, corner", 1.0, math.nan, -math.inf, 1.0, 0.99, math.inf),
        LimitSpread("image-centre error, edge", 0.0, 0.0, 0.0, 0.0, -math.inf, 1.0),
    ),
    grades=(("commercial", Share(0.1, 0.08, 0.12)), ("precision", Share(0.48, 0.4, 0.56)), ("high", MOST)),
    curve=((0.5, MOST), (1.0, HALF), (2.0, Share(0.0, 0.0, 0.01))),
    question="",
)
OPTIMUM = OptimiseResult(
    feasible=True,
    goal="finest depth",
    quantity="depth spread σ_Z",
    unit="mm",
    before=1.25,
    after=0.6,
    changes=(VariableMove("D_F", 2.9, 5.8, 1.45, 5.8), VariableMove("d_3", 120.0, 100.0, 60.0, 240.0)),
    design=None,
    sentences=(),
    ends=(
        SearchEnd(20, 0.0, "start"),
        SearchEnd(50, 0.3, "start"),
        SearchEnd(60, 5.0, "bad"),
        SearchEnd(900, 0.0, "check"),
    ),
    against="widest field",
    against_quantity="field half width",
    against_unit="mm",
    front=((0.6, 20.0), (0.8, 28.0), (1.4, 40.0)),
)
PICTURES = {
    "yield": lambda t: yield_bars(TOLERANCE, t),
    "yield-curve": lambda t: yield_curve(TOLERANCE, t),
    "offenders": lambda t: offender_bars(TOLERANCE.offenders, t),
    "spread": lambda t: spread_bars(TOLERANCE.spreads, t),
    "changes": lambda t: change_bars(OPTIMUM, t),
    "history": lambda t: search_history(OPTIMUM, t),
    "front": lambda t: front(OPTIMUM, t),
}


def _find(svg, testid):
    return [e for e in ET.fromstring(svg).iter() if e.attrib.get("data-testid") == testid]


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("name", PICTURES)
def test_every_picture_is_sound(name, theme):
    root = ET.fromstring(PICTURES[name](theme).svg)
    assert root.attrib["data-testid"] == f"picture-{name}"
    assert root.attrib["role"] == "img"
    assert min(float(e.attrib["font-size"]) for e in root.iter(f"{SVG}text")) >= 11
    for element in root.iter():
        for key in ("x", "y", "width", "height", "cx", "cy", "r", "x1", "x2", "y1", "y2"):
            if key in element.attrib:
                assert math.isfinite(float(element.attrib[key]))
    assert "nan" not in " ".join(root.itertext())


def test_bars_of_yields_are_as_long_as_the_yields():
    svg = yield_bars(TOLERANCE).svg
    widths = {n: float(_find(svg, f"yield-{n}")[0].attrib["width"]) for n in ("commercial", "precision", "high")}
    assert widths["high"] / widths["commercial"] == pytest.approx(9.0, rel=1e-2)
    # That of the run itself, not of the shorter one by grade.
    assert widths["precision"] / widths["commercial"] == pytest.approx(5.0, rel=1e-2)


def test_offenders_that_break_a_limit_alone_look_different_and_small_ones_are_left_out():
    svg = offender_bars(TOLERANCE.offenders).svg
    bars = [_find(svg, f"offender-{k}") for k in range(4)]
    assert [len(bar) for bar in bars] == [1, 1, 1, 0]
    assert bars[0][0].attrib["fill"] == bars[1][0].attrib["fill"] != bars[2][0].attrib["fill"]
    assert float(bars[1][0].attrib["width"]) == pytest.approx(10 * float(bars[2][0].attrib["width"]), rel=1e-2)
    narrow = " ".join(ET.fromstring(offender_bars(TOLERANCE.offenders, "light", (210, 300)).svg).itertext())
    assert "250 %" in narrow
    assert "250 %: fill" not in narrow.split("uses")[-1]
    told = " ".join(ET.fromstring(svg).itertext())
    assert "kept fraction, corner undefined" in told
    assert "no tolerance matters" in offender_bars(()).svg


def test_scatter_is_drawn_on_the_way_to_its_limit():
    svg = spread_bars(TOLERANCE.spreads).svg
    (bar,) = _find(svg, "spread-0")
    limits = sorted(
        float(e.attrib["x1"]) for e in ET.fromstring(svg).iter(f"{SVG}line") if e.attrib.get("stroke-width") == "2"
    )
    assert float(bar.attrib["width"]) == pytest.approx((limits[1] - limits[0]) / 2, rel=1e-2)


def test_a_variable_at_its_bound_is_marked():
    svg = change_bars(OPTIMUM).svg
    (at_bound,), (inside,) = _find(svg, "change-D_F"), _find(svg, "change-d_3")
    assert at_bound.attrib["fill"] != inside.attrib["fill"]
    assert "at bound" in " ".join(ET.fromstring(svg).itertext())


def test_no_front_without_a_second_goal():
    from dataclasses import replace

    with pytest.raises(ValueError, match="one goal alone"):
        front(replace(OPTIMUM, against=""))
    assert "the goals do not compete" in front(replace(OPTIMUM, front=((0.6, 20.0),))).svg
    assert "no design holds every limit" in front(replace(OPTIMUM, front=())).svg
