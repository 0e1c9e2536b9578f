"""Variables that set several places at once, against designs written by hand and searched over one number."""

import numpy as np
import pytest
from scipy.optimize import brentq

import roslf_design as roslf
from roslf_design.optimization.study import read_study, run

AT = {"relay rear": (30.0, 20.0), "relay front": (70.0, 20.0), "objective": (100.0, 15.0)}
"""Distance and focal length of each lens: a 4f relay, and what stands before it."""
BASE = roslf.Design.make({
    "name": "relayed",
    "source": "own",
    "main_lens": {"diameter": 40.0, "focal_length": 50.0},
    "aperture": {"diameter": 4.0, "distance": 42.0},
    "elements": [
        {"kind": "lens", "name": name, "distance": at, "focal_length": f, "diameter": 40.0}
        for name, (at, f) in AT.items()
    ],
    "microlens_array": {"pitch": 0.05, "focal_length": 0.6, "distance": 50.0, "size": [6.0, 4.0]},
    "sensor": {"pixel": 0.003, "pixels": [2000, 1400], "distance": 0.6},
    "depth": {"disparity_error": 0.1},
})  # fmt: skip
ROOM = 8.0
"""Room that the undistorted field is to have [mm]."""
FOCALS = [f"elements.{name}.focal_length" for name in ("relay rear", "relay front")]
GROWN = {
    **dict.fromkeys(FOCALS, 1.0),
    "elements.relay rear.distance": 1.0,
    "elements.relay front.distance": 3.0,
    "elements.objective.distance": 4.0,
}
"""How far each moves where a relay of the focal length f grows, what stands before it pushed along."""


def asked(**variables):
    return {
        "name": "ties",
        "variables": variables,
        "goals": [{"quantity": "sigma_z_mm", "direction": "min"}],
        "constraints": [{"quantity": "non_distortion_room_mm", "min": f"{ROOM} mm"}],
        "solver": {"starts": 2, "check": False},
    }


def by_hand(factors, shift):
    """The design with lengths of each lens written out."""
    changes = {}
    for k, (name, lengths) in enumerate(AT.items()):
        for key, own in zip(("distance", "focal_length"), lengths, strict=True):
            changes[f"elements.{k}.{key}"] = own + factors.get(f"elements.{name}.{key}", 0.0) * shift
    return BASE.replace(changes)


def told(design, name):
    return float(roslf.quantity(name)(roslf.Camera.of(design)))


@pytest.mark.parametrize(
    ("tie", "factors"),
    [
        ({"same": FOCALS, "min": "18 mm", "max": "22 mm"}, dict.fromkeys(FOCALS, 1.0)),
        (
            {"together": list(GROWN)[2:4], "min": "-3 mm", "max": "2 mm"},
            dict.fromkeys(list(GROWN)[2:4], 1.0),
        ),
        ({"together": GROWN, "min": "-2 mm", "max": "2 mm"}, GROWN),
    ],
    ids=["alike", "moved", "grown"],
)
def test_the_optimum_is_that_of_a_search_over_one_number_by_hand(tie, factors):
    low, high = (float(tie[end].split()[0]) - 20.0 * ("same" in tie) for end in ("min", "max"))
    # The error falls with the room, so that the best has just the room.
    shift = brentq(lambda s: told(by_hand(factors, s), "non_distortion_room_mm") - ROOM, low, high, xtol=1e-10)
    best = by_hand(factors, shift)
    assert told(by_hand(factors, shift + 0.1), "sigma_z_mm") > told(best, "sigma_z_mm")
    result = run(read_study(asked(stage=tie), design=BASE))
    assert result.answer.feasible
    assert result.answer.variables()["stage"] == pytest.approx(shift + 20.0 * ("same" in tie), abs=1e-5)
    found = dict(result.designs())["best.toml"]
    assert [part.distance for part in found.elements] == pytest.approx(
        [part.distance for part in best.elements], abs=1e-4
    )
    assert [part.focal_length for part in found.elements] == pytest.approx(
        [part.focal_length for part in best.elements], abs=1e-5
    )
    assert told(found, "sigma_z_mm") == pytest.approx(told(best, "sigma_z_mm"), rel=1e-6)
    assert set(result.to_dict()["following_mm"]) >= {BASE.place_named(place) for place in factors}


def test_shifts_of_the_same_place_add():
    stages = {
        "grown": {"together": GROWN, "min": "-1 mm", "max": "1 mm"},
        "front": {
            "together": ["elements.relay front.distance", "elements.objective.distance"],
            "min": "0 mm",
            "max": "1 mm",
        },
    }
    problem = read_study(asked(**stages), design=BASE).problem
    values = problem.values(np.array([0.75, 0.25]))  # shifts of 0.5 and 0.25 mm
    for place, factor in GROWN.items():
        own = BASE.place_named(place)
        moved = factor * 0.5 + 0.25 * (place in stages["front"]["together"])
        assert values[own] == pytest.approx(roslf.Camera.of(BASE)[own] + moved, abs=1e-12)
    assert problem.before(problem.variables) == {"grown": 0.0, "front": 0.0}
    assert problem.drawn[0].tolist() == [0.5, 0.0]


BOUNDS = {"min": "1 mm", "max": "2 mm"}
REAR = FOCALS[0]


@pytest.mark.parametrize(
    ("variables", "words"),
    [
        ({"a": {"same": FOCALS, "together": FOCALS, **BOUNDS}}, "keep one, and give the other a name"),
        ({"a": {"same": [], **BOUNDS}}, "same names no place"),
        ({"a": {"same": [REAR, REAR], **BOUNDS}}, "names elements.0.focal_length twice"),
        ({"a": {"together": [REAR, REAR], **BOUNDS}}, f"names {REAR} twice"),
        ({"d_3": {"same": FOCALS, **BOUNDS}}, "'d_3' is a place itself"),
        ({"a": {"same": ["elements.relay raer.distance"], **BOUNDS}}, "did you mean 'elements.relay rear.distance'"),
        ({"a": {"together": ["working_distance"], **BOUNDS}}, "which is no length that can vary"),
        ({"a": {"same": FOCALS, **BOUNDS}, REAR: ["1 mm", "2 mm"]}, f"'{REAR}' varies twice"),
        ({"a": {"together": FOCALS, **BOUNDS}, REAR: ["1 mm", "2 mm"]}, f"'{REAR}' varies twice"),
        ({"a": {"together": FOCALS, **BOUNDS, "min": "-21 mm"}}, "through 0: it is 20 mm in size and would be -1 mm"),
        ({"a": {"same": ["aperture.diameter"], **BOUNDS, "min": "0 mm"}}, "min must be greater than zero"),
        ({"a": {"same": ["f", "d_f", "d_1"], **BOUNDS}}, "cannot all vary"),
    ],
)
def test_refusals(variables, words):
    with pytest.raises(roslf.InputError) as refused:
        read_study(asked(**variables), design=BASE)
    assert words in str(refused.value)
