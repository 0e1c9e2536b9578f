"""Problems in a line."""

import roslf_design as roslf
from roslf_design.optimization.problem import Constraint, DesignProblem, Goal, Variable

PAPER = roslf.load("paper")


def limit(name, low=None, high=None, at=None):
    return Constraint(quantity=name, min=low, max=high, at=at)


def goal(name, direction, at=None, weight=1.0):
    return Goal(quantity=name, direction=direction, at=at, weight=weight)


def variable(low, high):
    return Variable(min=low, max=high)


def posed(bounds, limits, *goals, design=PAPER, **more):
    variables = {name: variable(*ends) for name, ends in bounds.items()}
    return DesignProblem("posed", design, variables, tuple(limits), goals, **more)
