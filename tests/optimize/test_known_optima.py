"""Problems whose optimum is known, from every start; and one that only brute force knows."""

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.optimize.problem import Constraint, DesignProblem, Goal, Variable
from roslf_design.optimize.search import search
from roslf_design.optimize.solve import Settings, solve
from roslf_design.theory.light import half_diagonal
from roslf_design.theory.quantities import quantity_named
from tests.oracles.optimize import brute_force, eq7_residual, largest_undistorted_plane, matched_sensor_distance

STARTS = 20
RELATIVE = 1e-6


def constraint(name, low=None, high=None, at=None):
    return Constraint(quantity_named(name), low, high, at)


def goal(name, direction, at=None, weight=1.0):
    return Goal(quantity_named(name), direction, at, weight)


@pytest.fixture(scope="module")
def paper():
    return roslf.load("paper")


def starts(n):
    return np.random.default_rng(11).random((STARTS, n))


def test_matching_a_given_bore_from_every_start(paper):
    """D_F and d_3 are the bore's: the only matched d_2 is Eq. 7's."""
    problem = DesignProblem(
        "match",
        paper,
        (Variable("d_2", 0.1, 20.0),),
        (constraint("fill_factor", 1.0, 1.0),),
        (goal("views_independent", "max"),),
    )
    wanted = float(matched_sensor_distance(paper))
    for start in starts(1):
        found = search(problem, start)
        assert found.feasible
        assert problem.values(found.unit[None])["sensor.distance"][0] == pytest.approx(wanted, rel=RELATIVE)


def test_matched_with_the_widest_pupil_from_every_start(paper):
    """Depth precision wants the widest pupil that the bore allows, and d_2 that matches it."""
    problem = DesignProblem(
        "match",
        paper,
        (Variable("d_2", 0.1, 20.0), Variable("D_F", 0.5, 4.0)),
        (constraint("fill_factor", 1.0, 1.0),),
        (goal("sigma_z_mm", "min"),),
    )
    wanted = float(matched_sensor_distance(paper.replace(D_F=4.0)))
    for start in starts(2):
        values = problem.values(search(problem, start).unit[None])
        assert values["aperture.diameter"][0] == pytest.approx(4.0, rel=RELATIVE)
        assert values["sensor.distance"][0] == pytest.approx(wanted, rel=RELATIVE)


def test_largest_undistorted_field_from_every_start(paper):
    """With a lens narrower than the array Eq. 6 ends the field: it is active at the optimum."""
    design = paper.replace(D=24.0, d_3=90.0)
    problem = DesignProblem(
        "field",
        design,
        (Variable("d_f", 150.0, 5000.0), Variable("D_F", 1.0, 5.0)),
        (constraint("non_distortion_room_mm", 0.0),),
        (goal("field_half_diagonal_mm", "max"),),
    )
    half = float(half_diagonal(problem.base))
    wanted = float(largest_undistorted_plane(design.replace(D_F=1.0), half))
    assert 150 < wanted < 5000
    for start in starts(2):
        values = problem.values(search(problem, start).unit[None])
        assert values["main_lens.focal_plane"][0] == pytest.approx(wanted, rel=RELATIVE)


def test_the_papers_bench_recovers_a_matched_design_near_it(paper):
    problem = DesignProblem(
        "bench",
        paper,
        tuple(Variable(s, getattr(paper, s) * 0.99, getattr(paper, s) * 1.01) for s in ("d_2", "d_3", "d_1")),
        (constraint("fill_factor", 1.0, 1.0),),
        (goal("sigma_z_mm", "min"),),
    )
    answer = solve(problem, Settings(starts=4, check=False))
    assert answer.feasible
    assert answer.same == 4
    design = problem.design_at(answer.unit)
    # 60 digits on the design as written: what is left is rounding of the three lengths themselves.
    assert abs(eq7_residual(design)) < 1e-9
    for symbol in ("d_2", "d_3", "d_1"):
        assert getattr(design, symbol) == pytest.approx(getattr(paper, symbol), rel=0.0101)


@pytest.fixture(scope="module")
def scope_problem():
    return DesignProblem(
        "scope",
        roslf.load("rigid-scope"),
        (
            Variable("f", 1.0, 4.0),
            Variable("D_F", 0.1, 2.0),
            Variable("d_3", 1.0, 6.0),
            Variable("working_distance", 20.0, 60.0),
            Variable("d", 0.012, 0.06),
            Variable("d_2", 0.03, 2.0),
        ),
        (
            constraint("fill_factor", 0.6, 1.0),
            constraint("non_distortion_room_mm", 0.0),
            constraint("total_length_mm", None, 8.0),
            constraint("field_half_width_mm", 10.0, None, 40.0),
            constraint("views_independent", 6.0),
            constraint("blur_pitches", None, 8.0, 20.0),
        ),
        (goal("sigma_z_mm", "min", 40.0), goal("total_length_mm", "min", None, 0.2)),
    )


def test_six_variables_no_worse_than_brute_force(scope_problem):
    problem = scope_problem

    def evaluate(units):
        rows = problem.vector(units)
        return rows[0], np.where(np.isfinite(rows[1:]), rows[1:], np.inf).max(axis=0)

    _, grid = brute_force(evaluate, 6, 6, 14)
    answer = solve(problem, Settings(starts=8))
    assert answer.feasible
    assert answer.merit <= grid + 1e-9
    # The grid comes close enough to be a judge: within 3 % of the goals.
    assert grid - answer.merit < 0.03
    assert answer.same >= 6
    assert all(check.agrees(answer.merit) for check in answer.checks)
    assert answer.checks[0].polished.merit == pytest.approx(answer.merit, abs=1e-6)
    assert answer.conditions.residual < 1e-6


def test_lexicographic_order_holds_what_came_first(scope_problem):
    from dataclasses import replace

    problem = replace(scope_problem, order="lexicographic", slack=0.02)
    answer = solve(problem, Settings(starts=6, check=False))
    first, last = answer.stages
    assert answer.number(problem.goals[0]) <= first.value * (1.02 + 1e-8)
    alone = solve(replace(scope_problem, goals=scope_problem.goals[:1]), Settings(starts=6, check=False))
    assert first.value == pytest.approx(alone.number(problem.goals[0]), rel=1e-6)
    assert last.value <= alone.number(problem.goals[1]) * (1 + 1e-9)


def test_multipliers_say_what_a_relaxed_limit_buys(scope_problem):
    from dataclasses import replace

    one = replace(scope_problem, goals=scope_problem.goals[:1])
    answer = solve(one, Settings(starts=6, check=False))
    before = answer.number(one.goals[0])
    checked = 0
    for index, limit in enumerate(one.constraints):
        row = next(
            (a for a in answer.conditions.active if a.label.startswith(limit.label) and a.multiplier > 1e-3), None
        )
        if row is None:
            continue
        low, high = limit.low, limit.high
        step = 1e-4 * abs(low if ">=" in row.label else high)
        moved = replace(limit, low=low - step) if ">=" in row.label else replace(limit, high=high + step)
        relaxed = replace(one, constraints=(*one.constraints[:index], moved, *one.constraints[index + 1 :]))
        after = search(relaxed, answer.unit)
        gain = before - float(one.goals[0].values(relaxed.cameras(after.unit[None]))[0])
        # First order: off by the curvature over a step of 1e-4.
        assert gain / step == pytest.approx(row.goal_per_unit, rel=2e-3)
        checked += 1
    assert checked >= 2


def test_freedom_that_no_goal_decides_is_told(paper):
    """The goal does not see d_2, and nothing holds it."""
    variables = (Variable("D_F", 1.0, 4.0), Variable("d_2", 0.5, 9.0))
    problem = DesignProblem("free", paper, variables, (), (goal("sigma_z_mm", "min"),))
    answer = solve(problem, Settings(starts=5, check=False))
    assert set(answer.loose()) == {"d_2"}
    assert answer.same == 5
