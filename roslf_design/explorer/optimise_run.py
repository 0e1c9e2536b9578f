"""An optimisation run for the explorer: a goal, what may vary, what must not get worse."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..design.units import format_quantity
from ..errors import InputError, Problem
from .jobs import Job, Tell

if TYPE_CHECKING:
    from ..design import Design
    from ..optimize.run import Result
    from ..optimize.solve import Answer

GOALS: dict[str, tuple[str, str, str]] = {
    "depth": ("finest depth", "sigma_z_mm", "min"),
    "field": ("widest field", "field_half_width_mm", "max"),
    "light": ("most light", "light_sr", "max"),
    "views": ("most independent views", "views_independent", "max"),
    "sample": ("finest object sample", "object_sample_mm", "min"),
    "length": ("shortest instrument", "total_length_mm", "min"),
}
"""Goals by their keys: what they are called, the quantity, the direction."""
VARIABLES = ("D", "f", "d_f", "D_F", "d_3", "d", "d_2")
"""What may vary; f_ml follows its focus."""
USUAL = ("D_F", "d_3", "d_2")
"""What varies where nobody says otherwise."""
HELD: dict[str, tuple[str, str]] = {
    "depth": ("sigma_z_mm", "max"),
    "field": ("field_half_width_mm", "min"),
    "views": ("views_independent", "min"),
    "pixels": ("views_geometric", "min"),
    "length": ("total_length_mm", "max"),
    "light": ("light_sr", "min"),
}
"""What may be kept from getting worse: the quantity and the side of its limit."""
GIVE = 1e-3
"""Part of a held value that may be given up, so that the design itself is inside its limits."""
REACH = 2.0
"""Bounds of a variable, as factors of its value, where nobody says otherwise."""
FILL = (0.98, 1.0)
"""Fill factor that counts as matched."""
STARTS, SECONDS = 8, 40.0
FRONT_POINTS = 9


@dataclass(frozen=True)
class OptimiseRequest:
    """What is asked."""

    design: Design
    goal: str = "depth"
    """A key of `GOALS`."""
    variables: tuple[str, ...] = USUAL
    bounds: Mapping[str, tuple[float, float]] | None = None
    """Least and greatest value of a variable [mm]; a factor of `REACH` either way where left out."""
    matched: bool = True
    """Whether microlens images have to fill their cells without overlap."""
    undistorted: bool = True
    """Whether no microlens image on the sensor may be cut."""
    held: tuple[str, ...] = ()
    """Keys of `HELD`."""
    against: str = ""
    """Another key of `GOALS`: what the goal costs of it is found out as well."""
    seed: int = 0


@dataclass(frozen=True)
class Change:
    """One variable."""

    symbol: str
    before: float
    after: float
    low: float
    high: float
    """[mm]."""

    @property
    def at_bound(self) -> bool:
        """Whether it ended at one of its bounds."""
        return min(self.after - self.low, self.high - self.after) <= 1e-6 * max(abs(self.high), 1e-12)


@dataclass(frozen=True)
class Sentence:
    """One thing to say of the run."""

    tone: str
    """"good", "caution", "bad" or "plain"."""
    text: str
    remedy: str


@dataclass(frozen=True)
class End:
    """Where one search ended."""

    spent: int
    """Evaluations so far, its own included."""
    loss: float
    """How much worse than the answer, as a share of the goal."""
    kind: str
    """"start", "check", or "bad" where a limit fails."""


@dataclass(frozen=True)
class OptimiseResult:
    """What was found."""

    feasible: bool
    goal: str
    """What was wanted, in words."""
    quantity: str
    """What that is a number of."""
    unit: str
    before: float
    after: float
    """The goal's quantity, of the design asked about and of the one found."""
    changes: tuple[Change, ...]
    design: Design | None
    """The design found; None where nothing holds all limits."""
    sentences: tuple[Sentence, ...]
    ends: tuple[End, ...]
    against: str
    """The other goal; "" where there is none."""
    against_quantity: str
    against_unit: str
    front: tuple[tuple[float, float], ...]
    """Goal and what it is against, of designs of which none is better in both."""


def start(request: OptimiseRequest) -> Job[OptimiseResult]:
    """Run it in a process of its own."""
    return Job(run, request)


def run(request: OptimiseRequest, tell: Tell = lambda share, text: None) -> OptimiseResult:
    """Run it here.

    Raises
    ------
    InputError
        Nothing may vary, what varies does not go together, or the main lens is a real one.
    """
    from ..report.studies import run_optimisation

    if request.design.lens is not None:
        message = f"{request.design.lens.name} is a real lens, and the search varies ideal ones; optimise its thin twin"
        raise InputError((Problem("main lens", message),))
    tell(None, "first search")
    found = run_optimisation(
        study(request), request.design, origin="optimise", tell=lambda text: tell(_part_done(text), text)
    )
    return _result(request, found)


def study(request: OptimiseRequest) -> dict[str, Any]:
    """The run as a study file would say it, but for the design."""
    from ..camera import Camera
    from ..theory.quantities import quantity_named

    design = request.design.thin_twin
    camera = Camera.of(design)
    _, quantity, direction = GOALS[request.goal]
    goals: list[dict[str, Any]] = [{"quantity": quantity, "direction": direction}]
    data: dict[str, Any] = {
        "name": f"{design.name}: {GOALS[request.goal][0]}",
        "microlens_in_focus": True,
        "seed": request.seed,
        "variables": {symbol: _texts(bounds_of(request, symbol)) for symbol in request.variables},
        "solver": {"starts": STARTS, "seconds": SECONDS},
    }
    limits: list[dict[str, Any]] = []
    if request.matched:
        limits.append({"quantity": "fill_factor", "min": FILL[0], "max": FILL[1]})
    if request.undistorted:
        limits.append({"quantity": "non_distortion_room_mm", "min": "0 mm"})
    for key in request.held:
        name, side = HELD[key]
        asked = quantity_named(name)
        value = float(asked(camera)) * (1 + GIVE if side == "max" else 1 - GIVE)
        limits.append({"quantity": name, side: format_quantity(value, "length") if asked.length else value})
    if request.against and request.against != request.goal:
        _, other, way = GOALS[request.against]
        # The answer is the goal's own; the other goal is there for the front.
        goals.append({"quantity": other, "direction": way, "weight": 1e-6})
        data["pareto"] = {"goals": [quantity, other], "points": FRONT_POINTS}
    return data | {"goals": goals, "constraints": limits}


def bounds_of(request: OptimiseRequest, symbol: str) -> tuple[float, float]:
    """Least and greatest value of a variable [mm]."""
    given = (request.bounds or {}).get(symbol)
    if given is not None:
        return given
    value = float(getattr(request.design, symbol))
    if symbol == "d_3":
        return value / REACH, max(REACH * value, 0.1 * request.design.f)
    if symbol == "d_f":
        return max(value / REACH, 1.05 * request.design.f), REACH * value
    return value / REACH, REACH * value


def _texts(bounds: tuple[float, float]) -> list[str]:
    return [format_quantity(value, "length") for value in bounds]


def _part_done(text: str) -> float | None:
    """Share of the searches that are done, from what the solver tells."""
    words = text.split()
    if words[:1] == ["start"] and words[2:3] == ["of"]:
        return 0.8 * (int(words[1]) - 1) / int(words[3])
    return 0.85 if text.startswith("checking") else None


def _ends(answer: Answer) -> Iterator[End]:
    spent = 0
    for search in answer.searches:
        spent += search.evaluations
        yield End(spent, max(search.merit - answer.merit, 0.0), "start" if search.feasible else "bad")
    for check in answer.checks:
        spent += check.evaluations + check.polished.evaluations
        yield End(spent, max(check.polished.merit - answer.merit, 0.0), "check" if check.polished.feasible else "bad")


def _result(request: OptimiseRequest, found: Result) -> OptimiseResult:
    from ..optimize.section import statements
    from ..report.words import in_words

    answer = found.answer
    goal = answer.asked.goals[0]
    before = float(np.ravel(goal.values(answer.problem.base))[0])
    values = answer.variables()
    changes = tuple(
        Change(symbol, float(getattr(request.design, symbol)), values[symbol], *bounds_of(request, symbol))
        for symbol in request.variables
    )
    front = () if found.front is None else tuple((p.values[0], p.values[1]) for p in found.front.points)
    other = GOALS[request.against] if request.against and request.against != request.goal else None
    name = f"{request.design.name}, {GOALS[request.goal][0]}"
    return OptimiseResult(
        feasible=answer.feasible,
        goal=GOALS[request.goal][0],
        quantity=in_words(goal.quantity.name),
        unit=goal.quantity.unit,
        before=before,
        after=answer.number(goal),
        changes=changes,
        design=answer.problem.design_at(answer.unit, name) if answer.feasible else None,
        sentences=tuple(Sentence(s.tone, s.text, s.remedy) for s in statements(found)),
        ends=tuple(_ends(answer)),
        against="" if other is None else other[0],
        against_quantity="" if other is None else in_words(other[1]),
        against_unit="" if other is None else answer.asked.goals[1].quantity.unit,
        front=front,
    )
