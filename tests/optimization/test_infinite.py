"""Limits and goals on what may be infinite, and designs at the end of what is a camera, against fine grids."""

import json
from functools import cache

import mpmath as mp
import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.catalogue import Catalogue, load_catalogue
from roslf_design.design import PATHS
from roslf_design.errors import InputError
from roslf_design.optimization.bounds import refuse_all
from roslf_design.optimization.combinations import Combinations
from roslf_design.optimization.front import pareto_front
from roslf_design.optimization.ranking import rank
from roslf_design.optimization.search import SearchBudget
from roslf_design.optimization.solve import Settings, solve
from roslf_design.optimization.study import read_study, run
from roslf_design.reporting.optimise.pages import statements
from roslf_design.theory.photometry import exposure
from roslf_design.theory.quantities import QUANTITIES
from roslf_design.theory.quantity import finite, from_finite
from tests.optimization.posing import PAPER, goal, limit, posed
from tests.oracles.optimize import brute_force

SCOPE = roslf.load("rigid-scope").replace({"depth.disparity_error": 0.1})
FAR, VIEW_FAR = "depth_of_field_far_mm", "view_depth_of_field_far_mm"
BOX = {"D_F": (0.05, 0.6), "d_f": (15.0, 60.0)}
BENCH = {"D_F": (0.5, 8.0), "d_f": (150.0, 2000.0)}
QUICK = Settings(starts=4, check=False)


@cache
def grid(design, points=900):
    """Cameras all over a box of two lengths."""
    bounds = BOX if design is SCOPE else BENCH
    axes = np.meshgrid(*(np.linspace(*ends, points) for ends in bounds.values()))
    return Camera.of(design).replace({PATHS[name]: axis.ravel() for name, axis in zip(bounds, axes, strict=True)})


def best_on_grid(design, limits, wanted, sign):
    cameras = grid(design)
    holds = np.array(cameras.valid)
    for name, low, high in limits:
        values = QUANTITIES[name](cameras)
        holds &= (values >= (-np.inf if low is None else low)) & (values <= (np.inf if high is None else high))
    return sign * np.min(np.where(holds, sign * QUANTITIES[wanted](cameras), np.inf))


@pytest.mark.parametrize(
    ("design", "limits", "wanted", "direction"),
    [
        # Infinite in the whole box, in a part of it, and only where the optimum is not.
        (SCOPE, [(VIEW_FAR, 200.0, None)], "light_sr", "max"),
        (SCOPE, [(FAR, 600.0, None)], "light_sr", "max"),
        (SCOPE, [(FAR, None, 200.0)], "light_sr", "min"),
        (SCOPE, [(FAR, 100.0, 300.0)], "light_sr", "max"),
        (SCOPE, [("light_sr", 0.06, None)], FAR, "max"),
        (SCOPE, [("light_sr", 0.06, None)], FAR, "min"),
        (PAPER, [(VIEW_FAR, 5000.0, None)], "light_sr", "max"),
        (PAPER, [(VIEW_FAR, None, 5000.0)], "light_sr", "min"),
        (PAPER, [(VIEW_FAR, 600.0, 900.0), ("depth_of_field_near_mm", 200.0, None)], "sigma_z_mm", "min"),
    ],
)  # fmt: skip
def test_a_limit_or_a_goal_that_may_be_infinite_against_a_grid(design, limits, wanted, direction):
    bounds, sign = (BOX if design is SCOPE else BENCH), 1.0 if direction == "min" else -1.0
    answer = solve(posed(bounds, [limit(*each) for each in limits], goal(wanted, direction), design=design), QUICK)
    oracle = best_on_grid(design, limits, wanted, sign)
    reached = answer.number(answer.problem.goals[0])
    assert answer.feasible
    assert len(answer.equals) >= 2
    if np.isinf(oracle):
        assert reached == oracle
    else:
        # A step of the grid is 1/900 of the box: the optimum gains no more over it than two of them.
        assert sign * reached <= sign * oracle + 1e-9 * abs(oracle)
        assert reached == pytest.approx(oracle, rel=0.02)
    for name, low, high in limits:
        value = answer.number(limit(name, low, high))
        assert low is None or value >= low * (1 - 1e-6)
        assert high is None or value <= high * (1 + 1e-6)
    assert not answer.runs_off


@pytest.mark.parametrize("weight", [0.3, 1.0, 2.6])
def test_goals_with_a_kink_where_one_becomes_infinite(weight):
    problem = posed(BENCH, [limit("light_sr", 1e-4)], goal(VIEW_FAR, "max", None, weight), goal("light_sr", "max"))
    problem = problem.with_scales()

    def evaluate(units):
        rows = problem.vector(units)
        return rows[0], rows[1:].max(axis=0)

    _, oracle = brute_force(evaluate, 2, 101, 12)
    answer = solve(problem, QUICK)
    assert answer.merit <= oracle + 1e-7
    assert len(answer.equals) == 4
    assert answer.residual < 1e-4


@pytest.mark.parametrize("name", ["paper", "rigid-scope", "cystoscope", "arthroscope", "grin-needle"])
def test_the_twin_goes_on_where_the_far_end_has_passed_infinity(name):
    camera = Camera.of(roslf.load(name).thin_twin)
    focal = camera["main_lens.focal_plane"] * np.geomspace(0.5, 4, 400)
    cameras = camera.replace({"main_lens.focal_plane": focal})
    good = cameras.valid
    for quantity in (QUANTITIES[FAR], QUANTITIES[VIEW_FAR]):
        far, twin = quantity(cameras)[good], quantity.past_infinity(cameras, None)[good]
        assert (twin < 0).tolist() == np.isfinite(far).tolist()
        np.testing.assert_allclose(-1 / twin[twin < 0], far[twin < 0], rtol=1e-10)
        # No jump where infinity is passed: what it changes by there is like what it changes by next to it.
        at = np.flatnonzero(np.diff(np.sign(twin)))
        steps = np.abs(np.diff(twin))
        assert all(steps[k] < 1.5 * steps[k - 1] for k in at if k)


def test_the_twin_of_a_long_far_end_by_mpmath():
    camera = Camera.of(PAPER.replace({"main_lens.focal_plane": 5000.0}))
    f, d_f, d_3, d, width = (mp.mpf(float(x)) for x in (camera.f, 5000.0, camera.d_3, camera.d, camera.D_F))
    share = d / (width * f / (d_f - f))
    seen = d_3 + (d_f - d_3) / (1 - share)
    twin = QUANTITIES[FAR].past_infinity(camera, None)
    assert float(twin) == pytest.approx(float(-1 / (seen - mp.mpf(float(camera.tip)))), rel=1e-12)


def test_twins_rise_with_their_numbers_and_lead_back():
    values = np.array([-1e6, -3.0, 0.0, 0.5, 1 - 1e-12, 1.0, 2.0, 1e3, 1e12, np.inf])
    assert (np.diff(finite(values)) > 0).all()
    assert np.isfinite(finite(values)).all()
    np.testing.assert_allclose(from_finite(finite(values)), values, rtol=1e-12)
    np.testing.assert_allclose(np.diff(finite(np.array([1 - 1e-6, 1.0, 1 + 1e-6]))), 1e-6, rtol=1e-5)


def end_of(named):
    return [active.limit for active in named if active.multiplier > 1e-6]


@pytest.mark.parametrize("wanted", ["sigma_z_mm", "object_sample_mm", "working_distance_mm"])
def test_the_end_of_the_bore_is_named_beside_a_bound(wanted):
    rim = {"diameter": 40.0, "distance": 96.0}
    design = PAPER.replace({"main_lens.focal_length": 60.0, "aperture.distance": 50.0, "stops": (rim,)})
    answer = solve(posed({"D_F": (1.0, 8.0), "d_f": (90.0, 400.0)}, [], goal(wanted, "min"), design=design), QUICK)
    assert answer.variables()["d_f"] == pytest.approx(96 / (1 - 1e-6), rel=1e-6)
    assert "focal plane in front of the bore" in end_of(answer.active)
    assert ("D_F <= 8 mm" in end_of(answer.active)) == (wanted == "sigma_z_mm")
    # What is near is seen best: no pole, whatever its slope.
    assert not answer.runs_off
    assert answer.residual < 1e-4


def study(text, *more):
    return run(read_study({**text, **dict(more)}))


ASKED = {
    "name": "far",
    "design": "rigid-scope",
    "variables": {"D_F": ["0.05 mm", "0.6 mm"], "d_f": ["15 mm", "60 mm"]},
    "constraints": [{"quantity": VIEW_FAR, "min": "200 mm"}],
    "goals": [{"quantity": "light_sr", "direction": "max"}],
    "solver": {"starts": 2, "check": False},
}


def test_results_tell_infinity_by_its_twin_and_whether_a_goal_runs_off():
    data = study(ASKED).to_dict(timings=False)
    assert json.loads(json.dumps(data, allow_nan=False)) == data
    assert data["status"] == "optimal"
    assert data["runs_off"] is False
    assert data["constraints"][0]["value"] is None
    assert data["constraints"][0]["inverse"] == 0
    pole = {"variables": {"d_2": ["0.1 mm", "1000 mm"]}, "constraints": [], "design": "paper"}
    pole["goals"] = [{"quantity": "fill_factor", "direction": "max"}]
    result = study(ASKED, *pole.items())
    assert result.to_dict()["runs_off"] is True
    assert "Unbounded objective" in next(statements(result)).text


def test_far_ends_in_a_front_and_in_an_order():
    goals = (goal(FAR, "max"), goal("light_sr", "max"))
    front = pareto_front(posed(BOX, [], *goals, design=SCOPE), goals, 5, [np.full(2, 0.5)], SearchBudget())
    reached = [tuple(point.goals.values()) for point in front.points]
    assert front.complete
    assert not any(a[0] >= b[0] and a[1] > b[1] for a in reached for b in reached if a != b)
    answer = solve(posed(BOX, [], *goals, design=SCOPE, order="lexicographic"), QUICK)
    assert answer.number(goals[0]) == np.inf
    assert answer.number(goals[1]) == pytest.approx(best_on_grid(SCOPE, [(FAR, 1e300, None)], "light_sr", -1), rel=0.01)


def test_where_nothing_is_feasible_the_reason_is_told():
    bounds = {"D_F": (0.05, 0.06), "d_f": (0.1, 0.3)}
    answer = solve(posed(bounds, [limit("fill_factor", None, 1.0)], goal("light_sr", "max"), design=SCOPE), QUICK)
    assert not answer.feasible
    assert answer.conflict.smallest == ()
    assert answer.conflict.always
    assert "no camera" in answer.conflict.reason


def test_where_no_parts_are_listed_the_reason_is_told():
    limits = [limit("views_geometric", 200.0), limit("fill_factor", None, 1.0)]
    problem = posed(BOX, limits, goal("light_sr", "max"), design=SCOPE)
    combinations = Combinations.of(problem, load_catalogue(()), ("sensors",))
    ranking = rank(combinations, 3, SearchBudget())
    assert ranking.best == ()
    # Each sensor alone tells how many pixels a pitch may have: nothing is searched.
    (reason,) = ranking.refused
    assert str(reason.constraint.quantity.name) == "views_geometric"
    assert len(reason.numbers) == len(load_catalogue(()).sensors)
    most = max(reason.parts.values())
    assert most < 200
    with pytest.raises(
        InputError, match=rf"no combination of parts can be a design: .*\(nearest: {most:.4g}\); choose"
    ):
        refuse_all(combinations)


def test_images_that_overlap_too_much_are_no_design_and_named():
    """Wide FAPs overlap images wherever it is looked for: no depth is looked for at fills from 1.5 on."""
    wide = [("design", "rigid-scope"), ("variables", {"D_F": ["0.8 mm", "1.2 mm"]}), ("constraints", [])]
    result = study(ASKED, *wide, ("goals", [{"quantity": "u_z_mm", "direction": "min"}]))
    assert "no camera was found (views told apart one by one: image fill)" in next(statements(result)).text


def test_depth_is_looked_for_where_views_are_told_apart_one_by_one():
    """Fitted together they tell more beyond, in little light: the search stays below all the same."""
    dim = PAPER.replace({"light.exposure": float(exposure(Camera.of(PAPER))) / 4, "depth.disparity_error": None})
    bounds, least = {"D_F": (2.0, 6.0)}, goal("u_z_mm", "min")
    answer = solve(posed(bounds, [], least, design=dim), QUICK)
    best = answer.problem.design_at(answer.unit)
    beyond = dim.replace({"aperture.diameter": 1.2 * best.D_F})
    assert answer.feasible
    assert float(QUANTITIES["fill_factor"](Camera.of(best))) == pytest.approx(1.5, abs=1e-3)
    assert float(QUANTITIES["u_z_mm"](Camera.of(beyond))) < answer.number(least)


@pytest.mark.parametrize(("across", "named"), [(60.0, True), (10.0, False)])
def test_a_width_that_no_part_to_choose_mends_names_the_widest_of_the_others(across, named):
    """A window of 60 mm is wider than any sensor; of 10 mm, none of the sensors' own 12 mm and more."""
    window = {
        "kind": "plate",
        "distance": "150 mm",
        "thickness": "1 mm",
        "material": "N-BK7",
        "diameter": f"{across} mm",
    }
    base = PAPER.replace({"D": 5.0, "microlens_array.size": (2.0, 2.0), "elements": [window]})
    problem = posed(
        {"D_F": (1.0, 3.0)}, (limit("outer_diameter_mm", None, 6.0),), goal("sigma_z_mm", "min"), design=base
    )
    sensors = tuple(one for one in load_catalogue().sensors if np.hypot(*one.size) > 12.0)
    combinations = Combinations.of(problem, Catalogue(sensors=sensors), ("sensors",))
    with pytest.raises(InputError, match="no combination of parts can be a design") as told:
        refuse_all(combinations)
    words = "; the widest there is plate 1, 60 mm, which is not among the parts to choose); choose"
    assert (words in str(told.value)) == named
    assert ("the widest there" in str(told.value)) == named
