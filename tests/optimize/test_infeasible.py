"""Problems without a design: what is missed, what conflicts, and what would help."""

from dataclasses import replace

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.optimize.problem import SIGNS, Constraint, DesignProblem, Goal, Variable
from roslf_design.optimize.solve import Settings, solve
from roslf_design.theory.quantities import quantity_named


@pytest.fixture(scope="module")
def impossible():
    def limit(name, low=None, high=None, at=None):
        return Constraint(quantity_named(name), low, high, at)

    return DesignProblem(
        "impossible",
        roslf.load("paper"),
        (Variable("d_2", 0.5, 10), Variable("d_3", 0, 300), Variable("d_1", 110, 300)),
        (
            limit("fill_factor", 0.9, 1.0),
            limit("non_distortion_room_mm", 0.0),
            limit("lateral_samples", 100.0),
            limit("total_length_mm", None, 700.0),
            limit("field_half_diagonal_mm", 60.0),
            limit("sigma_z_mm", None, 0.5),
        ),
        (Goal(quantity_named("views_independent"), "max"),),
    )


def relaxed_problem(problem, relaxation):
    """The problem with one limit moved to where it makes the whole feasible."""
    changed = []
    for limit in problem.constraints:
        for side in limit.sides:
            if relaxation.label == f"{limit.label} {SIGNS[side]}" and relaxation.limit == limit.limit(side):
                limit = replace(limit, **{"low" if side == "min" else "high": relaxation.needed})
        changed.append(limit)
    return replace(problem, constraints=tuple(changed))


@pytest.fixture(scope="module")
def answer(impossible):
    return solve(impossible, Settings(starts=6))


def test_no_optimum_is_claimed(answer):
    assert not answer.feasible
    assert answer.conditions is None
    assert answer.violation > 0.1
    assert answer.conflict.violations


def test_the_smallest_conflict_is_named(impossible, answer):
    smallest = answer.conflict.smallest
    assert answer.conflict.complete
    assert smallest == ("field_half_diagonal_mm >= 60 mm", "sigma_z_mm <= 0.5 mm")
    # Each of the two can hold without the other, together with all the rest.
    for index in (4, 5):
        kept = frozenset(range(len(impossible.constraints))) - {index}
        assert solve(impossible.without(kept), Settings(starts=6, check=False)).feasible


def test_each_relaxation_makes_it_feasible_and_less_does_not(impossible, answer):
    helpful = [r for r in answer.conflict.relaxations if r.needed is not None]
    assert len(helpful) == 2
    for relaxation in helpful:
        share = 1 - 1e-6 if relaxation.label.endswith(">=") else 1 + 1e-6
        enough = relaxed_problem(impossible, replace(relaxation, needed=relaxation.needed * share))
        assert solve(enough, Settings(starts=8, check=False)).feasible
        short = relaxation.limit + 0.98 * (relaxation.needed - relaxation.limit)
        assert not solve(relaxed_problem(impossible, replace(relaxation, needed=short)), Settings(starts=4)).feasible


def test_a_limit_beyond_a_bound_alone(impossible):
    problem = replace(impossible, constraints=(Constraint(quantity_named("D_F"), 5.0),))
    answer = solve(problem, Settings(starts=2))
    assert not answer.feasible
    assert answer.conflict.smallest == ("D_F >= 5 mm",)
    assert answer.conflict.relaxations[0].needed == pytest.approx(2.9)


def test_bounds_that_stand_in_the_way_are_named(impossible):
    problem = replace(impossible, constraints=(Constraint(quantity_named("d_2"), 12.0),))
    answer = solve(problem, Settings(starts=2))
    assert answer.conflict.bounds == ("d_2 <= 10 mm",)
    assert answer.conflict.relaxations[0].needed == pytest.approx(10.0)
    assert np.isfinite(answer.unit).all()
