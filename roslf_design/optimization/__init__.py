"""Optimising designs: from a bore and what must be seen to a design and a parts list, or to what stands in the way.

A study file gives a `DesignProblem` (variables, constraints, goals); `solve` finds the best design from many starts and
says how far to trust it, or names the smallest set of limits that cannot hold together and what would relax it. `run`
does everything that a study file asks for: reduce a bore to one stop, trace a front, make a design robust,
choose parts.
"""

from ..catalogue import Catalogue, load_catalogue
from .bore import EquivalentPupil, reduce_bore
from .combinations import Combinations
from .front import Front, pareto_front
from .goals import Constraint, Goal
from .problem import DesignProblem
from .ranking import Ranking, rank
from .solve import Answer, Settings, solve
from .study import OptimizeStudy, Result, load_study, read_study, run
from .variables import Variable

__all__ = [
    "Answer",
    "Catalogue",
    "Combinations",
    "Constraint",
    "DesignProblem",
    "EquivalentPupil",
    "Front",
    "Goal",
    "OptimizeStudy",
    "Ranking",
    "Result",
    "Settings",
    "Variable",
    "load_catalogue",
    "load_study",
    "pareto_front",
    "rank",
    "read_study",
    "reduce_bore",
    "run",
    "solve",
]
