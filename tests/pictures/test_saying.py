"""Pictures say something: legends name what is drawn, shades differ, and captions speak of colours that are there."""

import numpy as np
import pytest

from roslf_design.design import load
from roslf_design.drawing.marks import Area, Disc, Dots, Image, Line
from roslf_design.drawing.picture import Picture
from roslf_design.evaluation import evaluate
from roslf_design.reporting.design.figures import SHEETS
from roslf_design.reporting.design.rays import meridional
from roslf_design.reporting.optimise.pictures import VariableMove, change_bars

NEARLY = 0.02
"""Share of a ramp below which shades are one."""


def colours(mark):
    """Colours that a mark is drawn in."""
    match mark:
        case Line():
            return {mark.colour}
        case Dots():
            return {mark.colour, mark.edge}
        case Area() | Disc():
            return {mark.fill, mark.edge}
        case Image():
            values = np.asarray(mark.values)
            names = {"whole": values == 1, "dark": values == 0, "cut": (values > 0) & (values < 1)}
            return {name for name, own in names.items() if own.any()}
    return set()


def faults(picture):
    """Entries of its legend that stand for nothing drawn, and maps of one shade."""
    marks = picture.marks + picture.remarks
    drawn = set().union(*(colours(mark) for mark in marks if _places(mark)))
    for key in picture.keys:
        own = set().union(*(colours(sample) for sample in key.samples)) - {
            "none",
            "ground",
            "ink",
            "#000000",
            "#ffffff",
        }
        if own and not own & drawn:
            yield f"{picture.name}: {key.text} is not drawn"
    for mark in marks:
        if isinstance(mark, Image) and np.ptp(mark.values) < NEARLY * (mark.high - mark.low):
            yield f"{picture.name}: one shade"


def _places(mark):
    return not isinstance(mark, (Line, Area, Dots)) or np.isfinite(np.asarray(mark.x, float)).any()


@pytest.mark.parametrize("name", ["rigid-scope", "mismatched-borescope"])
def test_pictures_of_a_design(name, monkeypatch):
    drawn, svg = [], Picture.svg
    monkeypatch.setattr(Picture, "svg", lambda self, *args, **kw: drawn.append(self) or svg(self, *args, **kw))
    design = load(name)
    result = evaluate(design)
    sheets = {sheet: SHEETS[sheet](design, result) for sheet in ("view", "images", "maps", "plane", "depth", "effects")}
    assert [fault for picture in drawn for fault in faults(picture)] == []
    blocked = any("blocked" in key.text for picture in drawn for key in picture.keys)
    assert ("Orange rays" in sheets["view"].caption) == blocked
    whole = evaluate(design).non_distortion.undistorted_in_field
    assert (
        ("Left:" in sheets["maps"].caption)
        == (not whole)
        == (len(next(p for p in drawn if p.name == "maps").panels) > 2)
    )


def test_a_legend_of_variables_names_bounds_only_where_one_is_met():
    moves = VariableMove("d_2", 1.0, 2.0, 0.5, 3.0), VariableMove("f", 1.0, 3.0, 0.5, 3.0)
    assert list(faults(change_bars(moves[:1]))) == list(faults(change_bars(moves[1:]))) == []
    texts = [[key.text for key in change_bars(some).keys] for some in (moves[:1], moves[1:], moves)]
    assert [len(some) for some in texts] == [2, 2, 3]


def test_faults_are_found():
    blank = change_bars((VariableMove("d_2", 1.0, 2.0, 0.5, 3.0),))
    assert list(faults(Picture("x", "x", (9, 9), (), blank.keys))) == [
        f"x: {key.text} is not drawn" for key in blank.keys
    ]


def test_rays_that_only_the_fap_ends_are_told_from_light_that_is_lost():
    """The paper's camera sees whole images all over its field; a narrow main lens cuts them."""
    paper = load("paper")
    cut = paper.replace({"main_lens.diameter": 8.0})
    assert evaluate(paper).non_distortion.undistorted_in_field
    assert not evaluate(cut).non_distortion.undistorted_in_field
    words = [[key.text for key in meridional(design).keys if "blocked" in key.text] for design in (paper, cut)]
    assert words == [["beyond the FAP's rim: blocked, and where"], ["blocked, and where"]]
