"""Runs in the background: their kinds, each in a process of its own, and how far one is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ..design import Design
from .forms import MeasureRequest, OptimiseRequest, Options, ToleranceRequest, read_form
from .jobs import Done, Failure, ProcessJob, Progress, Tell
from .measure_run import run_measure, trial_page
from .optimise_run import OptimiseResult, run_optimise
from .tolerance_run import ToleranceResult, run_tolerance

Work = Callable[[Any, Tell], Any]
KINDS: dict[str, tuple[type[Any], Work, Callable[[Any], dict[str, Any]]]] = {
    "tolerance": (ToleranceRequest, run_tolerance, ToleranceResult.page),
    "optimise": (OptimiseRequest, run_optimise, OptimiseResult.page),
    "measure": (MeasureRequest, run_measure, trial_page),
}
"""Kinds of run: the request, the work, and what the page shows of its result."""


@dataclass(frozen=True)
class Run:
    """A run, and the design that it was started for."""

    kind: str
    """Kind of run, one of `KINDS`."""
    design: Design
    job: ProcessJob[Any]

    @classmethod
    def begin(cls, kind: str, design: Design, options: Options) -> Run:
        """Start a run in a process of its own.

        Raises
        ------
        InputError
            Options that cannot be.
        """
        request, work, _ = KINDS[kind]
        return cls(kind, design, ProcessJob(work, read_form(request, design, options)))

    @property
    def result(self) -> Any:
        """Result of the run; None before the end."""
        state = self.job.poll()
        return state.result if isinstance(state, Done) else None


def summary(run: Run | None, design: Design, wrong: str = "") -> dict[str, Any]:
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
    shown = {"state": "none", "share": -1, "text": "", "message": wrong, "stale": False, "seconds": ""}
    if run is None:
        return shown
    shown["stale"] = run.design != design
    state = run.job.poll()
    if isinstance(state, Progress):
        share = -1 if state.share is None else state.share
        return shown | {"state": "running", "share": share, "text": state.words, "seconds": f"{state.seconds:.0f} s"}
    if isinstance(state, Failure):
        return shown | {"state": "failed", "message": wrong or state.message}
    _, _, show_result = KINDS[run.kind]
    return shown | {"state": "done", "seconds": f"{state.seconds:.1f} s", **show_result(state.result)}
