"""Optimisation run: a better design within bounds and limits, and how the page shows it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ..camera import Camera
from ..design import Design
from ..drawing.theme import short
from ..evaluation.field_images import rays_tell
from ..optimization.study import Result
from ..reporting.blocks import Statement
from ..reporting.optimise.pages import statements
from ..reporting.optimise.pictures import SearchEnd, VariableMove, ends_of
from ..reporting.optimise.run import run_optimisation
from ..theory.quantities import quantity_named
from ..units import format_quantity
from ..words import to_html
from .forms import GOALS, HELD, OptimiseRequest, WantedQuantity
from .jobs import Tell, stages
from .main_lens import explored_lens
from .state import BY_SYMBOL, fixed_conjugates, show

GIVE = 1e-3
"""Part of a held value that may be given up, so that the design itself is inside its limits."""
STARTS = 8
FRONT_POINTS = 9
STEPS = {"searches": 3.0, "checking": 4.0, "rays at": 4.0, "finding what": 1.0}
"""Steps of a run, and about how long each takes."""
FRONT_STEPS = {"front: ends": 3.0, "front: limits": 3.5}
"""Further steps where one goal is set against another."""


@dataclass(frozen=True)
class OptimiseResult:
    """Result of an optimisation run."""

    goal: WantedQuantity
    before: float
    after: float
    """The goal's quantity, of the design asked about and of the one found."""
    changes: tuple[VariableMove, ...]
    followers: tuple[tuple[str, float, float], ...]
    """Numbers that moved with the variables: symbol, before and after [mm]."""
    design: Design | None
    """The design found; None where nothing holds all limits."""
    sentences: tuple[Statement, ...]
    ends: tuple[SearchEnd, ...]
    against: WantedQuantity | None
    """The other goal."""
    front: tuple[tuple[float, float], ...]
    """Goal and what it is against, of designs of which none is better in both."""
    stopped: bool = False
    """Whether somebody had enough before the searches' own end."""

    def page(self) -> dict[str, Any]:
        """Values for the page."""
        headline = "Nothing within the bounds holds all that was asked"
        if self.stopped:
            headline = "Stopped before a design was found that holds all that was asked"
        if self.design is not None:
            after = f"{short(self.after, 4)} {self.goal.unit}".strip()
            headline = f"{to_html(self.goal.words)}: {short(self.before, 4)} → {after}"
            headline += ", the best when it was stopped" * self.stopped
        return {
            "headline": headline,
            "rows": [
                *({"label": to_html(change.symbol), "share": _moved(change)} for change in self.changes),
                *(
                    {"label": to_html(symbol), "share": f"{_from_to(symbol, before, after)} (follows)"}
                    for symbol, before, after in self.followers
                ),
            ],
            "sentences": [
                {"tone": s.tone, "text": to_html(s.text), "remedy": to_html(s.remedy)} for s in self.sentences
            ],
            "can_apply": self.design is not None,
        }


def run_optimise(request: OptimiseRequest, tell: Tell = lambda share, text: None) -> OptimiseResult:
    """A better design: a goal, what may vary, what must not get worse.

    Raises
    ------
    InputError
        Nothing may vary, or what varies does not go together.
    """
    design = request.design
    tell(None, "first search")
    study = _optimise_study(request)
    told = stages(tell, STEPS | (FRONT_STEPS if "pareto" in study else {}))
    result = run_optimisation(study, design, origin="optimise", tell=told)
    answer, wish = result.answer, GOALS[request.goal]
    values = answer.variables()
    best = answer.problem.design_at(answer.unit, f"{design.name}, {wish.label}") if answer.feasible else None
    return OptimiseResult(
        goal=wish,
        before=_number(design, wish.quantity),
        after=answer.number(answer.asked.goals[0]),
        changes=tuple(
            VariableMove(symbol, float(getattr(design, symbol)), values[symbol], *ends)
            for symbol, ends in request.all_bounds.items()
        ),
        followers=tuple(
            (symbol, float(getattr(design, symbol)), after) for symbol, after in answer.followers().items()
        ),
        design=best,
        sentences=tuple(statements(result)),
        ends=ends_of(answer),
        against=GOALS[request.against] if request.against not in ("", request.goal) else None,
        stopped=answer.ended == "stopped",
        front=_front(result),
    )


def _optimise_study(request: OptimiseRequest) -> dict[str, Any]:
    """The run as a study file would say it, but for the design."""
    label, quantity, direction = GOALS[request.goal]
    goals: list[dict[str, Any]] = [{"quantity": quantity, "direction": direction}]
    design, bounds = request.design, request.all_bounds
    lens, kept = explored_lens(design), design.main_lens.kind.kept_conjugates
    fixed = (symbol for symbol in fixed_conjugates(request.follows, bounds) if symbol in kept)
    bounds |= {symbol: 2 * (getattr(design, symbol),) for symbol in fixed}
    data: dict[str, Any] = {
        "name": f"{design.name}: {label}",
        "microlens_in_focus": request.in_focus,
        "required": request.required and bool(design.required),
        "seed": request.seed,
        "variables": {s: [format_quantity(value, "length") for value in ends] for s, ends in bounds.items()},
        "solver": {"starts": STARTS},
    }
    limits: list[dict[str, Any]] = []
    if request.matched:
        limits.append(lens.matched(design))
    if request.undistorted:
        limits.append(lens.undistorted(design))
    for key in request.held:
        _, name, side = HELD[key]
        value = _number(design, name) * (1 + GIVE if side == "max" else 1 - GIVE)
        limits.append(
            {"quantity": name, side: format_quantity(value, "length") if quantity_named(name).length else value}
        )
    if request.against and request.against != request.goal:
        _, other, way = GOALS[request.against]
        # The answer is the goal's own; the other goal is there for the front.
        goals.append({"quantity": other, "direction": way, "weight": 1e-6})
        data["pareto"] = {"goals": [quantity, other], "points": FRONT_POINTS}
    return data | {"goals": goals, "constraints": limits}


def _number(design: Design, name: str) -> float:
    """A quantity, as rays tell it behind a real lens."""
    quantity = quantity_named(name)
    ((told,), _) = rays_tell(lambda: design, [(quantity, None)]) if quantity.of_rays is not None else ((None,), ())
    return float(quantity(Camera.of(design))) if told is None else told


def _front(result: Result) -> tuple[tuple[float, float], ...]:
    points = () if result.front is None else result.front.points
    return tuple((first, second) for first, second, *_ in (point.goals.values() for point in points))


def _moved(change: VariableMove) -> str:
    bound = " (at its bound)" if change.at_bound else ""
    return f"{_from_to(change.symbol, change.before, change.after)}{bound}"


def _from_to(symbol: str, before: float, after: float) -> str:
    number = BY_SYMBOL[symbol]
    return " → ".join(show(number, float(f"{value:.5g}")) for value in (before, after))
