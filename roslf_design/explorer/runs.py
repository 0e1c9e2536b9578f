"""Long runs as the page sees them: what the form asks for, how far a run is, what it found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from ..design import Design
from ..errors import InputError, Problem
from ..report.symbols import to_html
from . import optimise_run, tolerance_run
from .fields import BY_SYMBOL, show
from .jobs import Done, Failure, Job, Progress
from .optimise_run import GOALS, HELD, USUAL, VARIABLES, Change, OptimiseRequest, OptimiseResult
from .pictures.svg import short
from .tolerance_run import GRADES, TRIALS, TRIALS_TRACED, ToleranceRequest, ToleranceResult

Kind = Literal["tolerance", "optimise"]
KINDS: tuple[Kind, ...] = ("tolerance", "optimise")

LEAST_TRIALS, MOST_TRIALS = 64, 1_000_000
LARGEST_SEED = 2**32 - 1

HELD_WORDS = {
    "depth": "depth precision",
    "field": "field",
    "views": "independent views",
    "pixels": "pixels across an image",
    "length": "total length",
    "light": "light",
}

Options = Mapping[str, Sequence[str]]
"""A form as the browser sends it: every field's name with the values chosen."""


@dataclass(frozen=True)
class Run:
    """A run, and the design that it was started for."""

    design: Design
    job: Job[Any]

    @property
    def result(self) -> Any:
        """What was found; None before the end."""
        state = self.job.poll()
        return state.result if isinstance(state, Done) else None


def begin(kind: Kind, design: Design, options: Options) -> Run:
    """Start a run.

    Raises
    ------
    InputError
        Options that cannot be.
    """
    if kind == "tolerance":
        return Run(design, tolerance_run.start(tolerance_request(design, options)))
    return Run(design, optimise_run.start(optimise_request(design, options)))


def tolerance_request(design: Design, options: Options) -> ToleranceRequest:
    """What the form of the tolerance view asks for.

    Raises
    ------
    InputError
        A grade that is not known, or numbers out of range.
    """
    grade = _one(options, "grade", GRADES[1])
    if grade not in GRADES:
        raise InputError((Problem("grade", f"'{grade}' is not known; there are {', '.join(GRADES)}"),))
    return ToleranceRequest(
        design,
        grade,
        _whole(options, "trials", TRIALS, LEAST_TRIALS, MOST_TRIALS),
        _whole(options, "seed", 0, 0, LARGEST_SEED),
        "calibrated" in options,
    )


def optimise_request(design: Design, options: Options) -> OptimiseRequest:
    """What the form of the optimise view asks for.

    Raises
    ------
    InputError
        A goal that is not known, nothing that may vary, or a seed out of range.
    """
    goal, against = _one(options, "goal", "depth"), _one(options, "against", "")
    unknown = [key for key in (goal, against) if key and key not in GOALS]
    if unknown:
        raise InputError((Problem("goal", f"'{unknown[0]}' is not known; there are {', '.join(GOALS)}"),))
    variables = tuple(symbol for symbol in VARIABLES if symbol in options.get("variables", ()))
    if not variables:
        raise InputError((Problem("may vary", "nothing is chosen; tick at least one number that may vary"),))
    held = tuple(key for key in HELD if key in options.get("held", ()))
    seed = _whole(options, "seed", 0, 0, LARGEST_SEED)
    return OptimiseRequest(
        design,
        goal,
        variables,
        None,
        matched="matched" in options,
        undistorted="undistorted" in options,
        held=held,
        against=against,
        seed=seed,
    )


def forms(design: Design) -> dict[str, Any]:
    """What the forms offer, and what is chosen before anyone chooses."""
    return {
        "grades": [{"key": grade, "chosen": grade == GRADES[1]} for grade in GRADES],
        "trials": TRIALS if design.main_lens.prescription is None else TRIALS_TRACED,
        "goals": [{"key": key, "label": told} for key, (told, _, _) in GOALS.items()],
        "variables": [{"key": s, "label": to_html(s), "chosen": s in USUAL} for s in VARIABLES],
        "held": [{"key": key, "label": HELD_WORDS[key]} for key in HELD],
        "lens": design.main_lens.prescription is not None,
    }


def told(run: Run | None, design: Design, wrong: str = "") -> dict[str, Any]:
    """A run for the page: its state, how far it is, what it found.

    Parameters
    ----------
    run : Run, optional
        None where there was none.
    design : Design
        Shown now; what was found for another is marked so.
    wrong : str
        What is wrong with what the form asked for.
    """
    blank = {"state": "none", "share": -1, "text": "", "message": wrong, "stale": False, "seconds": ""}
    if run is None:
        return blank
    state = run.job.poll()
    shown = {**blank, "stale": run.design != design}
    if isinstance(state, Progress):
        share = -1 if state.share is None else state.share
        return {**shown, "state": "running", "share": share, "text": state.text, "seconds": f"{state.seconds:.0f} s"}
    if isinstance(state, Failure):
        return {**shown, "state": "failed", "message": wrong or state.message}
    found = _tolerance(state.result) if isinstance(state.result, ToleranceResult) else _optimise(state.result)
    return {**shown, "state": "done", "seconds": f"{state.seconds:.1f} s", **found}


def _tolerance(found: ToleranceResult) -> dict[str, Any]:
    return {
        "headline": f"{_percent(found.share.value)} of the builds hold every limit "
        f"(95 % interval {_percent(found.share.low)} to {_percent(found.share.high)})",
        "question": to_html(found.question),
        "rows": [
            {"label": to_html(row.label), "share": _percent(row.share.value)}
            for row in sorted(found.limits, key=lambda row: row.share.value)
        ],
    }


def _optimise(found: OptimiseResult) -> dict[str, Any]:
    unit = f" {found.unit}" if found.unit else ""
    return {
        "headline": f"{to_html(found.quantity)}: {short(found.before, 4)} → {short(found.after, 4)}{unit}"
        if found.feasible
        else "Nothing within the bounds holds all that was asked",
        "rows": [{"label": to_html(change.symbol), "share": _moved(change)} for change in found.changes],
        "sentences": [{"tone": s.tone, "text": to_html(s.text), "remedy": to_html(s.remedy)} for s in found.sentences],
        "can_apply": found.design is not None,
        "front": bool(found.front),
    }


def _moved(change: Change) -> str:
    field = BY_SYMBOL[change.symbol]
    bound = " (at its bound)" if change.at_bound else ""
    return f"{show(field, change.before)} → {show(field, change.after)}{bound}"


def _percent(share: float) -> str:
    return f"{100 * share:.3g} %"


def _one(options: Options, name: str, otherwise: str) -> str:
    values = options.get(name) or (otherwise,)
    return str(values[0])


def _whole(options: Options, name: str, otherwise: int, low: int, high: int) -> int:
    text = _one(options, name, str(otherwise)).strip()
    try:
        value = int(text)
    except ValueError:
        value = low - 1
    if not low <= value <= high:
        raise InputError((Problem(name, f"'{text}' is not a whole number from {low} to {high}"),))
    return value


def kind_of(text: str) -> Kind:
    """A kind of run by its name.

    Raises
    ------
    ValueError
        There is none of that name.
    """
    if text not in KINDS:
        raise ValueError(f"there is no run called {text!r}")
    return text
