"""Problems whose optimum is known, from every start; one that only brute force knows; and problems without a design."""

import math
import sys
import time
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from numpy.testing import assert_allclose

import roslf_design as roslf
from roslf_design.optimization.conflict import _Pool, explain
from roslf_design.optimization.goals import Goal
from roslf_design.optimization.problem import DesignProblem, sobol_units
from roslf_design.optimization.search import SearchBudget, search, value_and_jacobian
from roslf_design.optimization.solve import Settings, solve
from roslf_design.progress import EnoughError
from roslf_design.theory import information_series
from tests.optimization.posing import PAPER, goal, limit, posed
from tests.oracles.optimize import brute_force, eq7_residual, largest_undistorted_plane, matched_sensor_distance

RELATIVE = 1e-6


def optima(problem):
    """Variables at the ends of searches from twenty starts."""
    for start in np.random.default_rng(11).random((20, problem.n)):
        found = search(problem.vector, start)
        assert found.feasible
        yield problem.named(found.unit)


def test_matching_a_given_bore_from_every_start():
    """D_F and d_3 are the bore's: the only matched d_2 is Eq. 7's."""
    problem = posed({"d_2": (0.1, 20.0)}, [limit("fill_factor", 1.0, 1.0)], goal("views_independent", "max"))
    wanted = float(matched_sensor_distance(PAPER))
    for found in optima(problem):
        assert found["d_2"] == pytest.approx(wanted, rel=RELATIVE)


def test_matched_with_the_widest_pupil_from_every_start():
    """Depth precision wants the widest pupil that the bore allows, and d_2 that matches it."""
    bounds = {"d_2": (0.1, 20.0), "D_F": (0.5, 4.0)}
    problem = posed(bounds, [limit("fill_factor", 1.0, 1.0)], goal("sigma_z_mm", "min"))
    wanted = float(matched_sensor_distance(PAPER.replace(D_F=4.0)))
    for found in optima(problem):
        assert (found["D_F"], found["d_2"]) == pytest.approx((4.0, wanted), rel=RELATIVE)


def test_largest_undistorted_field_from_every_start():
    """With a lens narrower than the array Eq. 6 ends the field: it is active at the optimum."""
    design = PAPER.replace(D=24.0, d_3=90.0)
    bounds, widest = {"d_f": (150.0, 5000.0), "D_F": (1.0, 5.0)}, goal("field_half_diagonal_mm", "max")
    problem = posed(bounds, [limit("non_distortion_room_mm", 0.0)], widest, design=design)
    wanted = float(largest_undistorted_plane(design.replace(D_F=1.0)))
    assert 150 < wanted < 5000
    for found in optima(problem):
        assert found["d_f"] == pytest.approx(wanted, rel=RELATIVE)


def test_the_papers_bench_recovers_a_matched_design_near_it():
    bounds = {s: (getattr(PAPER, s) * 0.99, getattr(PAPER, s) * 1.01) for s in ("d_2", "d_3", "d_1")}
    problem = posed(bounds, [limit("fill_factor", 1.0, 1.0)], goal("sigma_z_mm", "min"))
    answer = solve(problem, Settings(starts=4, check=False))
    assert answer.feasible
    assert len(answer.equals) == 4
    design = problem.design_at(answer.unit)
    # 60 digits on the design as written: what is left is rounding of the three lengths themselves.
    assert abs(eq7_residual(design)) < 1e-9
    for symbol in bounds:
        assert getattr(design, symbol) == pytest.approx(getattr(PAPER, symbol), rel=0.0101)


def scope(*goals, **more):
    """A rigid endoscope of six variables."""
    bounds = {
        "f": (1.0, 4.0),
        "D_F": (0.1, 2.0),
        "d_3": (1.0, 6.0),
        "working_distance": (20.0, 60.0),
        "d": (0.012, 0.06),
        "d_2": (0.03, 2.0),
    }
    limits = [
        limit("fill_factor", 0.6, 1.0),
        limit("non_distortion_room_mm", 0.0),
        limit("total_length_mm", None, 8.0),
        limit("field_half_width_mm", 10.0, None, 40.0),
        limit("views_independent", 6.0),
        limit("blur_pitches", None, 8.0, 20.0),
    ]
    design = roslf.load("rigid-scope").replace({"depth.disparity_error": 0.1})
    return posed(bounds, limits, *goals, design=design, **more)


DEPTH, LENGTH = goal("sigma_z_mm", "min", 40.0), goal("total_length_mm", "min", None, 0.2)


def test_six_variables_no_worse_than_brute_force(monkeypatch):
    problem = scope(DEPTH, LENGTH)
    module = sys.modules[solve.__module__]  # whose function has its package's name for it
    globally = module.globally
    monkeypatch.setattr(module, "globally", lambda *args: globally(*args[:4], args[4] // 6, *args[5:]))

    def evaluate(units):
        rows = problem.vector(units)
        return rows[0], np.where(np.isfinite(rows[1:]), rows[1:], np.inf).max(axis=0)

    _, grid = brute_force(evaluate, 6, 6, 9)
    answer = solve(problem, Settings(starts=8))
    assert answer.feasible
    # The grid comes close enough to be a judge: within 3 % of the goals.
    assert -1e-9 <= grid - answer.merit < 0.03
    assert len(answer.equals) >= 6
    assert all(answer.agrees(check) for check in answer.checks)
    assert answer.checks[0].polished.merit == pytest.approx(answer.merit, abs=1e-6)
    assert answer.residual < 1e-6


def test_lexicographic_order_holds_what_came_first():
    problem = scope(DEPTH, LENGTH, order="lexicographic", slack=0.02)
    answer = solve(problem, Settings(starts=3, check=False))
    first, last = answer.stages
    assert answer.number(DEPTH) <= first.value * (1.02 + 1e-8)
    alone = solve(scope(DEPTH), Settings(starts=3, check=False))
    assert first.value == pytest.approx(alone.number(DEPTH), rel=1e-6)
    assert last.value <= alone.number(LENGTH) * (1 + 1e-9)


def test_multipliers_say_what_a_relaxed_limit_buys():
    one = scope(DEPTH)
    answer = solve(one, Settings(starts=3, check=False))
    before, checked = answer.number(DEPTH), 0
    for index, held in enumerate(one.constraints):
        rows = [a for a in answer.active if a.limit.startswith(held.label) and a.multiplier > 1e-3]
        if not rows:
            continue
        lower = ">=" in rows[0].limit
        step = 1e-4 * (abs(held.min if lower else held.max) or 1.0)
        moved = held.model_copy(update={"min": held.min - step} if lower else {"max": held.max + step})
        relaxed = replace(one, constraints=(*one.constraints[:index], moved, *one.constraints[index + 1 :]))
        gain = before - relaxed.number(DEPTH, search(relaxed.vector, answer.unit).unit)
        # First order: off by the curvature over a step of 1e-4.
        assert gain / step == pytest.approx(rows[0].goal_gain_per_unit, rel=2e-3)
        checked += 1
    assert checked >= 2


def test_freedom_that_no_goal_decides_is_told():
    """The goal does not see d_2, and nothing holds it."""
    answer = solve(posed({"D_F": (1.0, 4.0), "d_2": (0.5, 9.0)}, [], DEPTH), Settings(starts=5, check=False))
    assert set(answer.loose()) == {"d_2"}
    assert len(answer.equals) == 5


def test_what_ended_a_search_is_told_and_no_clock_does_unless_asked(monkeypatch):
    problem = posed({"d_2": (0.1, 20.0), "D_F": (0.5, 4.0)}, [limit("fill_factor", 1.0, 1.0)], DEPTH)
    calm = solve(problem, Settings(starts=4, check=False))
    ticks = iter(range(0, 10**9, 1000))
    monkeypatch.setattr(time, "monotonic", lambda: float(next(ticks)))  # a machine on which everything takes ages
    busy = solve(problem, Settings(starts=4, check=False))
    assert (busy.unit.tobytes(), busy.evaluations, busy.ended) == (calm.unit.tobytes(), calm.evaluations, "")
    asked = solve(problem, Settings(starts=4, check=False, seconds=500))
    assert asked.ended == "seconds"
    assert "the clock of 500 seconds ran out after 1 of 4 starts" in asked.notes[0]
    counted = solve(problem, Settings(starts=64, check=False, budget=100))
    assert counted.ended == "evaluations"
    assert 1 < len(counted.searches) < 64
    assert "the budget of 100 evaluations was spent" in counted.notes[0]


@pytest.mark.parametrize(("while_", "done"), [("searches", 3), ("checking", 40)])
def test_who_has_enough_gets_the_best_so_far(while_, done):
    problem = posed({"d_2": (0.1, 20.0), "D_F": (0.5, 4.0)}, [limit("fill_factor", 1.0, 1.0)], DEPTH)
    told = []

    def tell(what, now=0.0, total=0.0):
        told.append((what, now, total))
        if what.startswith(while_) and now >= done:
            raise EnoughError

    settings = Settings(starts=6)
    stopped, whole = solve(problem, settings, tell), solve(problem, settings)
    assert (stopped.ended, whole.ended) == ("stopped", "")
    assert stopped.feasible
    first = whole.searches[: len(stopped.searches)]
    assert [s.unit.tobytes() for s in stopped.searches] == [s.unit.tobytes() for s in first]
    assert len(first) == (3 if while_ == "searches" else 6)
    assert stopped.merit == min(s.merit for s in first if s.feasible)
    assert "it was stopped after" in stopped.notes[0]
    counts = [now for what, now, _ in told if what.startswith("checking")]
    assert counts == sorted(counts)
    assert all(now <= total for _, now, total in told if total)


def test_the_time_that_searches_have_left_is_that_of_the_check_too(monkeypatch):
    """By a clock that a design takes a second of: the check counts as many searches as it may try designs."""
    problem = posed({"d_2": (0.1, 20.0), "D_F": (0.5, 4.0)}, [limit("fill_factor", 1.0, 1.0)], DEPTH)
    calm, vector, clock, told = solve(problem, Settings(starts=6)), DesignProblem.vector, 0, []

    def slow(self, units):
        nonlocal clock
        clock += len(units)
        return vector(self, units)

    monkeypatch.setattr(DesignProblem, "vector", slow)
    monkeypatch.setattr(time, "monotonic", lambda: float(clock))
    same = solve(problem, Settings(starts=6), lambda *one: told.append((*one, clock)))
    assert same.unit.tobytes() == calm.unit.tobytes()
    (first, *searching) = [one for one in told if one[0].startswith("searches")]
    assert first[1:3] == (0, 6)
    assert [done for _, done, *_ in searching] == [1, 2, 3, 4, 5]
    tried = searching[0][3] - first[3] - 16  # as many are tried to see how long a check will take
    assert {total for _, _, total, _ in searching} == {6 + math.ceil(3000 / tried)}  # 1500 for each variable


def test_a_predicted_depth_error_is_as_good_as_an_exact_search(monkeypatch):
    """Tangents for derivatives, against every build summed by itself: never worse by 1e-3."""
    bounds = {"d_2": (0.5, 9.0), "D_F": (1.0, 4.0), "d_f": (300.0, 900.0)}
    limits = [limit("fill_factor", 0.9, 1.0), limit("field_half_width_mm", 25.0)]
    light = roslf.load("paper").replace({"depth.finest": 1.0, "light.illuminance": 2e4})
    problem = posed(bounds, limits, DEPTH, goal("sigma_disparity_pitches", "min", 150.0, 0.3), design=light)
    ours = search(problem.vector, np.full(3, 0.5))
    own = value_and_jacobian(problem.vector, np.full(3, 0.4))[1]
    with monkeypatch.context() as exact:
        exact.setattr(information_series, "CLOSE", 0.0)
        assert problem.vector(ours.unit[None])[0, 0] == pytest.approx(ours.merit, abs=1e-12)
        assert_allclose(own, value_and_jacobian(problem.vector, np.full(3, 0.4))[1], atol=1e-4, rtol=1e-4)
        slow = search(problem.vector, np.full(3, 0.5))
    assert ours.feasible
    assert ours.merit <= slow.merit + 1e-6


IMPOSSIBLE = posed(
    {"d_2": (0.5, 10), "d_3": (0, 300), "d_1": (110, 300)},
    [
        limit("fill_factor", 0.9, 1.0),
        limit("non_distortion_room_mm", 0.0),
        limit("lateral_samples", 100.0),
        limit("total_length_mm", None, 700.0),
        limit("field_half_diagonal_mm", 60.0),
        limit("sigma_z_mm", None, 0.5),
    ],
    goal("views_independent", "max"),
)


def can_hold(problem):
    return any(search(problem.vector, start).feasible for start in sobol_units(problem.n, 8, 0))


@pytest.fixture(scope="module")
def refused():
    return solve(IMPOSSIBLE, Settings(starts=6, check=False))


@pytest.mark.parametrize("during", ["searches", "finding what stands in the way"])
def test_a_search_that_is_stopped_before_a_design_tells_no_conflict(monkeypatch, during):
    """Ctrl-C while limits are searched for, or while their conflict is: nothing says that they clash."""

    def tell(what, done=0.0, total=0.0):
        if what == during:
            raise EnoughError

    stopped = solve(IMPOSSIBLE, Settings(starts=6, check=False), tell)
    assert (stopped.ended, stopped.feasible, stopped.conflict) == ("stopped", False, None)
    assert stopped.status == "stopped"
    assert np.isfinite(stopped.unit).all()
    assert stopped.violation > 0.1
    conflict = sys.modules["roslf_design.optimization.conflict"]

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(conflict, "_smallest", interrupted)
    late = solve(IMPOSSIBLE, Settings(starts=1, check=False))
    assert (late.ended, late.conflict, late.status) == ("stopped", None, "stopped")


def test_no_optimum_is_claimed_and_the_smallest_conflict_is_named(refused):
    assert not refused.feasible
    assert refused.active == ()
    assert refused.violation > 0.1
    assert refused.conflict.violations
    told = [f"{one.limit} {one.wanted:g} {one.unit}".rstrip() + " (got " for one in refused.conflict.violations]
    words = f"{refused.conflict.reason} {refused.conflict.missed}"
    assert [words.count(one) for one in told] == [1] * len(told)  # one number of each
    # With all other limits left out each of these can be held, or its best is told.
    assert [
        way.alone for way in refused.conflict.relaxations if way.label in {"field_half_diagonal_mm >=", "sigma_z_mm <="}
    ] == ["held"] * 2
    rows = [way.label for way in refused.conflict.relaxations]
    assert {one.limit for one in refused.conflict.violations} <= set(rows)
    assert len(rows) == len(set(rows))
    assert refused.conflict.complete
    assert refused.conflict.smallest == ("field_half_diagonal_mm >= 60 mm", "sigma_z_mm <= 0.5 mm")
    # Each of the two can hold without the other, together with all the rest.
    for index in (4, 5):
        assert can_hold(IMPOSSIBLE.keeping(frozenset(range(6)) - {index}))


def relaxed(relaxation, needed):
    """The problem with the limit moved that a relaxation names."""
    changed = []
    for held in IMPOSSIBLE.constraints:
        for side in held.limits:
            if relaxation.label == held.limit_words(side):
                held = held.model_copy(update={side: needed})
        changed.append(held)
    return replace(IMPOSSIBLE, constraints=tuple(changed))


def test_each_relaxation_makes_it_feasible_and_less_does_not(refused):
    helpful = [r for r in refused.conflict.relaxations if r.needed is not None]
    assert len(helpful) == 2
    for relaxation in helpful:
        share = 1 - 1e-6 if relaxation.label.endswith(">=") else 1 + 1e-6
        assert can_hold(relaxed(relaxation, relaxation.needed * share))
        short = relaxation.limit + 0.98 * (relaxation.needed - relaxation.limit)
        assert not can_hold(relaxed(relaxation, short))


def test_what_would_do_is_no_farther_than_what_was_met(monkeypatch):
    """A search that stalls told 13.96 mm where 15.85 mm had been met; alone, a limit could be what it comes to."""

    def stalls(guard, starts, *_, **__):
        unit = np.clip(starts[-1], 0.0, 1.0)
        return unit, guard.rows(unit)[0][1:]

    monkeypatch.setattr("roslf_design.optimization.conflict.least_violation", stalls)
    problem = posed({"d_2": (0.5, 9.0), "D_F": (1.0, 4.0)}, (limit("D_F", 5.0),))
    conflict = explain(problem, [np.array([0.3, 1.0]), np.array([0.5, 0.2])], SearchBudget(), 0)
    assert conflict.relaxations[0].needed == pytest.approx(4.0, rel=1e-12)
    # Where another limit keeps from it: no point counts that misses the other.
    both = replace(problem, constraints=(limit("D_F", 5.0), limit("fill_factor", high=0.2)))
    way = {one.label: one.needed for one in explain(both, [np.array([0.3, 1.0])], SearchBudget(), 0).relaxations}
    widest = replace(both, constraints=(limit("D_F", way["D_F >="]), limit("fill_factor", high=0.2)))
    assert way["D_F >="] is None or can_hold(widest)


def test_a_limit_or_a_bound_that_stands_in_the_way_alone_is_named():
    answer = solve(replace(IMPOSSIBLE, constraints=(limit("D_F", 5.0),)), Settings(starts=2, check=False))
    assert not answer.feasible
    assert answer.conflict.smallest == ("D_F >= 5 mm",)
    assert answer.conflict.relaxations[0].needed == pytest.approx(2.9)
    answer = solve(replace(IMPOSSIBLE, constraints=(limit("d_2", 12.0),)), Settings(starts=2, check=False))
    assert answer.conflict.bounds == ("d_2 <= 10 mm",)
    assert answer.conflict.relaxations[0].needed == pytest.approx(10.0)
    assert np.isfinite(answer.unit).all()


def test_where_the_merit_has_no_gradient_no_limit_is_made_up():
    # Up to the pole of the image fill, derivatives are not finite: nnls raised a ValueError.
    problem = posed({"d_3": (0.0, 200.0), "d_2": (0.1, 1000.0)}, (), goal("fill_factor", "max"), in_focus=True)
    answer = solve(problem, Settings(starts=2, check=False, evaluations=60))
    assert answer.runs_off
    assert answer.active == ()


def test_depth_at_a_field_is_a_goal_like_others():
    """A narrow lens cuts images off the axis: where it does least at 6 mm, against a walk along the only length."""
    light = roslf.load("paper").replace({"main_lens.diameter": 20.0, "light.illuminance": 5e3, "depth.finest": 0.5})
    wanted = Goal(quantity="sigma_z_at_field_mm", field=(6.0, 0.0), direction="min")
    problem = posed({"d_3": (60.0, 140.0)}, [], wanted, design=light)
    best = search(problem.vector, np.array([0.5]), tolerance=1e-4)
    walk = problem.vector(np.linspace(0, 1, 17)[:, None])[0]
    assert walk.min() - 0.02 < best.merit <= walk.min() + 1e-4  # a step of the walk is 5 mm
    evaluated = roslf.evaluate(problem.design_at(best.unit), [6.0]).fields[0].sigma_z_mm
    assert evaluated == pytest.approx(problem.number(wanted, best.unit), rel=1e-9)


BOX = {"d_3": (5.0, 200.0), "D_F": (1.0, 8.0)}
QUANTITIES = ("fill_factor", "sigma_z_mm", "field_half_diagonal_mm", "views_independent", "non_distortion_room_mm")


@pytest.fixture(scope="module")
def gridded():
    """Which cameras of a fine grid can be built, and their quantities."""
    axis = np.linspace(0.0, 1.0, 301)
    grid = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    free = posed(BOX, [], goal("fill_factor", "max"))
    cameras = free.cameras(grid)
    ok = (free.limits(grid) <= 0).all(axis=0)
    return ok, {name: np.broadcast_to(roslf.quantity(name)(cameras), len(grid)) for name in QUANTITIES}


def in_all(problem, units):
    """What points miss of all limits together."""
    return np.maximum(problem.one_sided().limits(units), 0.0).sum(axis=0)


def test_what_misses_least_is_the_same_from_everywhere_and_never_worse_than_the_base_design():
    """No start is given; a search whose limits are far off must not end where it began."""
    design = roslf.load("paper").replace({"depth.disparity_error": 0.1, "d_2": 2.0})
    for ask, wide in ((1e-4, 9.0), (1e-2, 4e3), (1e-7, 1e5)):
        limits = [limit("sigma_z_mm", None, ask), limit("field_half_diagonal_mm", wide), limit("fill_factor", 0.9, 1.0)]
        bounds = {"d_2": (0.5, 10), "d_3": (0, 300), "D_F": (1, 4), "d": (0.02, 1)}
        problem = posed(bounds, limits, goal("views_independent", "max"), design=design)
        (drawn,) = problem.drawn
        assert problem.named(drawn) == pytest.approx(problem.before(bounds))
        sided, ends = problem.one_sided(), []
        for seed in range(3):
            unit = _Pool.about(sided, (), SearchBudget(), seed).nearest(frozenset(range(len(sided.constraints))))
            around = np.clip(unit + np.random.default_rng(seed).normal(0, 0.01, (64, 4)), 0, 1)
            end, base, *near = in_all(problem, np.stack([unit, drawn, *around]))
            ends.append(end)
            assert end <= base
            assert end <= min(near) + 1e-3
        assert ends == pytest.approx(ends[:1] * 3, rel=1e-3)


@pytest.mark.parametrize("seed", range(4))
def test_limits_that_clash_are_a_smallest_set_by_brute_force(seed, gridded):
    """Every set of one-sided limits at every point of a fine grid; each limit with what there is of it."""
    random, (ok, values) = np.random.default_rng(seed), gridded
    while True:
        limits = []
        for name in QUANTITIES:
            low, high = np.quantile(values[name][ok], np.sort(random.uniform(0.0, 1.0, 2))).tolist()
            kind = random.integers(3)
            limits.append(limit(name, low if kind else None, high if kind != 1 else None))
        sides = [side for one in limits for side in one.one_sided]
        held = [ok & one.quantity.within(one.min, one.max, values[one.quantity.name]) for one in sides]
        if not np.all(held, axis=0).any():
            break
    conflict = explain(posed(BOX, limits, goal("fill_factor", "max")), (), SearchBudget(), 0)
    sizes = (
        [keep for keep in combinations(range(len(sides)), size) if not np.all([held[k] for k in keep], axis=0).any()]
        for size in range(1, len(sides) + 1)
    )
    assert conflict.complete
    assert conflict.smallest in [tuple(str(sides[k]) for k in keep) for keep in next(filter(None, sizes))]
    asked = {str(side): side for side in sides}
    named = [asked[words] for words in conflict.smallest]
    ends = [end for one in named for end in one.limits.values()]
    assert [got.wanted for got in conflict.clashing] == ends
    got = zip(named, conflict.clashing, strict=True)
    assert not all(one.quantity.within(one.min, one.max, there.value) for one, there in got)
    for one in conflict.clashing:
        held = one.value == pytest.approx(one.wanted, rel=1e-4)  # printed to five digits
        there = [f"{one.asked} (got {one.value_words})", *[f"{one.asked} (at its limit)"] * held]
        assert any(words in conflict.reason for words in there)
