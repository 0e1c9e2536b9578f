"""What nlopt does not forgive: the guard and the searches above it must."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import nlopt
import numpy as np
import pytest

from roslf_design.optimization.search import Guard, SearchBudget, globally, search, slsqp, value_and_jacobian


@dataclass(frozen=True)
class Toy:
    """Minimise |u - (0.7, 0.4)|^2 with u_0 + u_1 <= 1: the optimum is (0.65, 0.35)."""

    spoil: Callable = lambda units, rows: rows

    def vector(self, units):
        merit = (units[:, 0] - 0.7) ** 2 + (units[:, 1] - 0.4) ** 2
        return self.spoil(units, np.stack([merit, units.sum(axis=1) - 1]))


OPTIMUM = (0.65, 0.35)


@pytest.mark.parametrize("place", [0.0, 0.4, 1.0])
def test_derivatives_of_two_points_each_serve_searches_that_end_coarsely(place):
    asked = []

    def vector(units):
        asked.append(len(units))
        return np.stack([np.exp(units[:, 0]) * units[:, 1] ** 3, np.sin(3 * units[:, 1])])

    unit = np.array([place, 0.7])
    known = [[np.exp(place) * 0.343, 3 * np.exp(place) * 0.49], [0.0, 3 * np.cos(2.1)]]
    for roughly, error in ((True, 5e-6), (False, 1e-10)):
        values, jacobian = value_and_jacobian(vector, unit, roughly=roughly)
        assert values == pytest.approx([np.exp(place) * 0.343, np.sin(2.1)])
        assert np.abs(jacobian - known).max() < error
    assert asked == [5, 9]


def nan_region(units, rows):
    return np.where(units[:, 0] > 0.66, np.nan, rows)


@pytest.mark.parametrize("start", [(0.1, 0.1), (0.5, 0.2), (0.3, 0.9)])
def test_regions_without_numbers_are_walked_around(start):
    found = search(Toy(nan_region).vector, np.array(start))
    assert found.feasible
    assert found.unit == pytest.approx(OPTIMUM, abs=1e-5)


def test_a_start_in_the_nan_region_gives_no_wrong_optimum():
    found = search(Toy(nan_region).vector, np.array([0.9, 0.05]))
    assert not found.feasible or found.unit[0] <= 0.66
    assert found.mapped > 0


def test_nan_does_not_kill_the_global_search():
    guard = Guard(Toy(nan_region).vector)
    globally(guard, 2, "crs2", 10.0, 2000, 0)
    assert guard.mapped > 0
    assert guard.feasible
    assert guard.unit == pytest.approx(OPTIMUM, abs=2e-2)


def test_a_global_search_ends_where_its_population_agrees_and_a_polish_does_the_rest():
    rough, fine = Guard(Toy().vector), Guard(Toy().vector)
    start = globally(rough, 2, "crs2", 10.0, 5000, 0, 0.1)
    globally(fine, 2, "crs2", 10.0, 5000, 0, 1e-6)
    assert 30 < rough.evaluations < fine.evaluations < 5000
    assert fine.unit == pytest.approx(OPTIMUM, abs=2e-3)
    assert search(Toy().vector, start).unit == pytest.approx(OPTIMUM, abs=1e-6)


def test_isres_keeps_to_the_rows():
    guard = Guard(Toy().vector)
    globally(guard, 2, "isres", 0.0, 4000, 3)
    assert guard.feasible
    assert guard.unit == pytest.approx(OPTIMUM, abs=2e-2)


@pytest.mark.parametrize("error", [nlopt.RoundoffLimited, nlopt.runtime_error, RuntimeError])
def test_the_best_point_survives_a_search_that_breaks_down(monkeypatch, error):
    real = nlopt.opt.optimize

    def broken(self, x):
        real(self, x)
        raise error("as nlopt would")

    monkeypatch.setattr(nlopt.opt, "optimize", broken)
    guard = Guard(Toy().vector)
    slsqp(guard, np.array([0.1, 0.9]))
    assert guard.feasible
    assert guard.unit == pytest.approx(OPTIMUM, abs=1e-6)


@pytest.mark.parametrize("start", [(-3.0, 0.5), (0.2, 7.0), (np.nan, 0.5)])
def test_a_start_outside_the_bounds_is_moved_onto_them(start):
    found = search(Toy().vector, np.array(start))
    assert found.clipped
    assert found.unit == pytest.approx(OPTIMUM, abs=1e-6)
    assert (found.unit >= 0).all()
    assert (found.unit <= 1).all()


def test_time_is_kept_and_the_best_point_with_it():
    def slow(units, rows):
        time.sleep(0.02)
        return rows

    guard = Guard(Toy(slow).vector, SearchBudget.of(np.inf, 0.15))
    slsqp(guard, np.array([0.0, 0.0]), 10_000)
    assert guard.evaluations < 50
    assert guard.unit is not None
    late = search(Toy().vector, np.array([0.2, 0.2]), SearchBudget.of(np.inf, -1))
    assert late.evaluations <= 2


def test_a_count_ends_a_search_and_the_best_point_is_kept():
    budget = SearchBudget(2)
    few = search(Toy().vector, np.array([0.0, 0.0]), budget)
    assert budget.ended == "evaluations"
    assert few.feasible
    assert few.evaluations <= 5  # what is under way is finished


def test_points_are_copied_from_nlopts_memory():
    guard = Guard(Toy().vector)
    x = np.array([0.2, 0.3])
    guard.rows(x, True)
    x[:] = 0.9
    assert guard.unit == pytest.approx((0.2, 0.3))


def test_where_designs_count_a_budget_ends_with_those_for_derivatives():
    """Of 30 designs a search may try, each takes 10 of 300 evaluations: one step more is what it cannot take back."""
    tried = []

    def vector(units):
        tried.append(len(units))
        return Toy().vector(units)

    budget = SearchBudget.of(300, None, 10)
    search(budget.counting(vector), np.array([0.2, 0.2]), budget)
    assert budget.ended == "evaluations"
    assert 30 <= sum(tried) <= 30 + 4 * 17  # its end is put on its limits, by nine designs each of four times at most
    free = SearchBudget.of(300, None)
    assert free.counting(vector) is vector
    assert free.at_most(300).evaluations == 299


@pytest.mark.parametrize("count", [2, 4])
def test_a_search_that_is_interrupted_keeps_its_best_point(count):
    """Ctrl-C ends it as a budget does, and all that shares the budget; a second one ends everything."""
    asked, best = [], [np.inf]

    def interrupted(units, rows):
        asked.append(len(units))
        if len(asked) == count:
            raise KeyboardInterrupt
        good = rows[1] <= 0
        best[0] = min([best[0], *rows[0][good]])
        return rows

    budget = SearchBudget()
    found = search(Toy(interrupted).vector, (0.1, 0.2), budget)
    assert budget.ended == budget.at_most(9).ended == budget.at_least(9, 9.0).ended == "stopped"
    assert found.feasible
    assert best[0] <= found.merit <= 0.6**2 + 0.2**2
    asked[:] = [0] * (count - 1)
    with pytest.raises(KeyboardInterrupt), budget.interruptible():
        raise KeyboardInterrupt
