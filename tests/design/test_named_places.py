"""Places by the names of parts: the same as by their numbers, wherever a place is written."""

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.optimization.combinations import CatalogueTable
from roslf_design.optimization.study import read_study
from roslf_design.tolerancing.places import expand

WINDOW = {"kind": "plate", "distance": 125.0, "thickness": 1.0, "material": "N-BK7"}
BORE = roslf.load("paper").replace({"elements": (WINDOW,)})
"""The paper's camera behind a window without a name."""
NAMED = roslf.load("paper").replace(
    {"elements": ({**WINDOW, "name": "front 1.5"}, {**WINDOW, "name": "front", "distance": 130.0})}
)
"""Behind two windows, of which one is called as the other begins."""


def test_by_name_is_by_number():
    for name, k in (("front 1.5", 0), ("front", 1)):
        named, numbered = f"elements.{name}.thickness", f"elements.{k}.thickness"
        assert NAMED.replace({named: 2.0}) == NAMED.replace({numbered: 2.0}) != NAMED
        assert roslf.Camera.of(NAMED, {named: 2.0})[numbered] == 2.0
        assert expand(NAMED, named) == (numbered,)
        assert NAMED.chain.called(numbered) == named
        swept = (roslf.sweep(NAMED, {place: [1.0, 2.0]}, "working_distance_mm") for place in (named, numbered))
        one, two = (each.values["working_distance_mm"] for each in swept)
        assert np.ptp(one) > 0
        assert one.tolist() == two.tolist()


def test_without_a_name_parts_go_by_what_pages_call_them():
    assert BORE.place_named("elements.plate 1.thickness") == "elements.0.thickness"
    assert BORE.chain.called("elements.0.thickness") == "elements.0.thickness"
    stopped = BORE.replace({"stops": ({"name": "rim", "distance": 118.0, "diameter": 30.0},)})
    assert stopped.place_named("stops.rim.diameter") == expand(stopped, "stops.rim.diameter")[0] == "stops.0.diameter"
    assert stopped.chain.called("stops.0.diameter") == "stops.rim.diameter"


def test_a_study_varies_by_name_and_says_so():
    asked = {
        "name": "windows",
        "variables": {"elements.front.thickness": ["1 mm", "2 mm"]},
        "goals": [{"quantity": "working_distance_mm", "direction": "min"}],
    }
    problem = read_study(asked, design=NAMED).problem
    assert list(problem.variables) == ["elements.1.thickness"]
    assert problem.called("elements.1.thickness") == "elements.front.thickness"
    twice = {
        **asked,
        "variables": {f"elements.{which}.thickness": ["1 mm", "2 mm"] for which in ("front", "1")},
    }
    with pytest.raises(roslf.InputError, match=r"elements\.front\.thickness is elements\.1\.thickness, which varies"):
        read_study(twice, design=NAMED)
    near = {**asked, "variables": {"elements.fromt.thickness": ["1 mm", "2 mm"]}}
    with pytest.raises(
        roslf.InputError, match=r"'elements\.fromt\.thickness' is nothing .*'elements\.front\.thickness'"
    ):
        read_study(near, design=NAMED)


def test_refusals():
    with pytest.raises(roslf.DesignError, match=r"is given as elements\.front\.thickness, too; give it once"):
        NAMED.replace({"elements.front.thickness": 2.0, "elements.1.thickness": 2.0})
    for name in ("2", "2.5", "*"):
        with pytest.raises(roslf.DesignError, match=f'put a word first, as "lens {name.replace("*", ".")}"'):
            NAMED.replace({"elements.front.name": name})
    NAMED.replace({"elements.front.name": "2nd window"})
    with pytest.raises(ValueError, match=r"did you mean 'elements\.front\.thickness'"):
        expand(NAMED, "elements.fromt.thickness")


def test_a_catalogue_s_window_is_for_a_plate_by_its_name():
    for name, k in (("front", 1), ("front 1.5", 0), (1, 1)):
        assert CatalogueTable(kinds=("windows",), element=name).plate(NAMED) == k
    with pytest.raises(ValueError, match=r'element = "front 1\.5" or "front"$'):
        CatalogueTable(kinds=("windows",), element="fromt").plate(NAMED)
    with pytest.raises(ValueError, match="for which plate"):
        CatalogueTable(kinds=("windows",), element=-1).plate(NAMED)
