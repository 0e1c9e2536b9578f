"""Problems in a line."""

import roslf_design as roslf
from roslf_design.optimization.problem import Constraint, DesignProblem, Goal, Variable
from roslf_design.theory.quantities import quantity_named

PAPER = roslf.load("paper")


def limit(name, low=None, high=None, at=None):
    return Constraint(quantity_named(name), low, high, at)


def goal(name, direction, at=None, weight=1.0):
    return Goal(quantity_named(name), direction, at, weight)


def posed(bounds, limits, *goals, design=PAPER, **more):
    variables = tuple(Variable(name, *ends) for name, ends in bounds.items())
    return DesignProblem("posed", design, variables, tuple(limits), goals, **more)
