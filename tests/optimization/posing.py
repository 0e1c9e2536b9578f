"""Problems in a line."""

import roslf_design as roslf
from roslf_design.optimization import Constraint, DesignProblem, Goal, Variable

PAPER = roslf.load("paper").replace({"depth.disparity_error": 0.1})
"""Depth errors are then closed forms, for oracles."""


GOOD = """
name = "small"
design = "paper"
seed = 2

[variables]
d_2 = ["0.5 mm", "9 mm"]
D_F = {min = "1 mm", max = "4 mm", start = "9 mm"}

[[constraints]]
quantity = "fill_factor"
min = 0.98
max = 1.0

[[constraints]]
quantity = "non_distortion_room_mm"
min = "0 mm"

[[goals]]
quantity = "sigma_z_mm"
at = "200 mm"
direction = "min"

[[goals]]
quantity = "views_independent"
direction = "max"
weight = 0.1

[solver]
starts = 2
check = false
"""
"""A study's file."""


def limit(name, low=None, high=None, at=None):
    return Constraint(quantity=name, min=low, max=high, at=at)


def goal(name, direction, at=None, weight=1.0):
    return Goal(quantity=name, direction=direction, at=at, weight=weight)


def variable(low, high):
    return Variable(min=low, max=high)


def posed(bounds, limits, *goals, design=PAPER, **more):
    variables = {name: variable(*ends) for name, ends in bounds.items()}
    return DesignProblem("posed", design, variables, tuple(limits), goals, **more)
