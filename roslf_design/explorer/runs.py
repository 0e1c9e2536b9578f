"""Runs in the background: their kinds, each in a process of its own, and how far one is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from ..design import Design
from .forms import MeasureRequest, OptimiseRequest, Options, ToleranceRequest, read_form
from .jobs import Done, Failure, ProcessJob, Progress, Tell
from .measure_run import run_measure, trial_page
from .optimise_run import OptimiseResult, run_optimise
from .tolerance_run import ToleranceResult, run_tolerance

Work = Callable[[Any, Tell], Any]


class _Kind(NamedTuple):
    """Kind of run."""

    request: type[Any]
    work: Work
    page: Callable[[Any], dict[str, Any]]
    """What the page shows of its result."""
    does: str
    """What a run does and how long it takes, in words, for those who have started none."""


KINDS = {
    "tolerance": _Kind(
        ToleranceRequest, run_tolerance, ToleranceResult.page,
        "Start makes as many builds of this camera as are asked for, each number off by chance within the grade's "
        "tolerances, and counts those that hold every limit: ten seconds to a minute, longer with more pixels across a "
        "microlens image.",
    ),
    "optimise": _Kind(
        OptimiseRequest, run_optimise, OptimiseResult.page,
        "Start searches what is ticked, between its bounds, for the design that is best by the goal and keeps all that "
        "must hold: some seconds to half a minute. This design stays until you take the one found.",
    ),
    "measure": _Kind(
        MeasureRequest, run_measure, trial_page,
        "Start takes simulated pictures and measures depth in them as the camera would: ten seconds to half a minute.",
    ),
}  # fmt: skip


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
        request = read_form(KINDS[kind].request, design, options)
        return cls(kind, design, ProcessJob(KINDS[kind].work, request))

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
    return shown | {"state": "done", "seconds": f"{state.seconds:.1f} s", **KINDS[run.kind].page(state.result)}
