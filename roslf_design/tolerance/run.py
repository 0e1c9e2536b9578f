"""A whole study: its trials wherever they run, its analyses, its files."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..design import save
from ..errors import InputError
from .chunk import one_trial, run_chunk
from .executors import in_pool, in_process, on_cluster
from .grades import Grades
from .metrics import METRICS
from .plan import Plan, make_plan
from .result import GradeYield, RssRow, StudyResult, WorstTrial
from .sensitivity import inverse_sensitivity, root_sum_square, sensitivity
from .sobol import sobol_indices
from .store import Store
from .study import Study
from .summary import Variant, correlations, summarise
from .tally import Tally, merged, npz_bytes
from .yields import curve_trials, scale_for_yield, yield_at, yield_curve

if TYPE_CHECKING:
    from .trace_check import TraceCheck

Progress = Callable[[int, int], None]
"""Told (trials done, trials in all)."""


__all__ = ["Where", "analyse", "npz_bytes", "run_trials", "save_worst", "trial_arrays"]


@dataclass(frozen=True)
class Where:
    """Where chunks run."""

    workers: int = 1
    """Processes; 1: this one."""
    scheduler: str | None = None
    """A Dask scheduler's address, or "local" for a cluster started here."""


def run_trials(
    plan: Plan, folder: Path, where: Where = Where(), *, resume: bool = False, progress: Progress | None = None
) -> Tally:
    """Run a plan's trials, chunk by chunk, into a folder.

    Parameters
    ----------
    plan : Plan
        What runs.
    folder : Path
        Gets a manifest and one file a chunk.
    where : Where
        Changes the time it takes, never the bytes.
    resume : bool
        Go on with a run that was stopped.
    progress : callable, optional
        Called after each chunk.

    Raises
    ------
    InputError
        The folder holds something else; no scheduler answers.
    ChunkLostError
        Workers keep dying over one chunk.
    OSError
        A file cannot be written; earlier chunks stay as they are.
    """
    store = Store(folder, plan, resume=resume)
    missing = store.missing()
    done = plan.trials - sum(plan.chunk_trials(index) for index in missing)
    if progress is not None:
        progress(done, plan.trials)
    with closing(_run(partial(run_chunk, plan), missing, where)) as finished:
        for index, content in finished:
            store.write(index, content)
            done += plan.chunk_trials(index)
            if progress is not None:
                progress(done, plan.trials)
    return merged(store.tallies())


def _run(work: Callable[[int], bytes], missing: list[int], where: Where) -> Generator[tuple[int, bytes], None, None]:
    if where.scheduler is not None:
        yield from on_cluster(work, missing, where.scheduler, where.workers)
    elif where.workers > 1 and len(missing) > 1:
        yield from in_pool(work, missing, where.workers)
    else:
        yield from in_process(work, missing)


def analyse(plan: Plan, study: Study, grades: Grades, tally: Tally, worst: tuple[WorstTrial, ...] = ()) -> StudyResult:
    """Every analysis of a study whose trials have run."""
    variants = summarise(plan, tally)
    one_at_a_time = sensitivity(plan)
    lens = _check_traced(plan)
    rss = tuple(
        RssRow(d.label, float(sigma), d.deviation, d.mean - d.nominal)
        for d, sigma in zip(variants[0].distributions, root_sum_square(plan, one_at_a_time), strict=True)
    )
    misses = plan.nominal_misses()
    count = len(plan.draws.perturbations)
    share = 1 / math.sqrt(count) if study.share == "rss" else 1 / count
    return StudyResult(
        plan=plan,
        study=study,
        tally=tally,
        variants=variants,
        sensitivity=one_at_a_time,
        rss=rss,
        sobol=sobol_indices(plan, study.sobol_samples) if study.sobol_samples else None,
        allowed=() if misses else inverse_sensitivity(plan, share),
        yield_curve=yield_curve(plan),
        scale_for_target=scale_for_yield(plan, study.yield_target),
        grades=_grades(plan, study, grades),
        correlations=correlations(tally),
        worst=worst,
        warnings=(*_lens_notes(plan, lens), *_warnings(plan, variants, rss, misses)),
        lens=lens,
    )


def save_worst(plan: Plan, tally: Tally, folder: Path) -> tuple[WorstTrial, ...]:
    """Write the worst trials as design files, adjustments included."""
    found = []
    for number, score in zip(tally.worst, tally.scores, strict=True):
        name = f"worst-trial-{number}.toml"
        try:
            design, _ = one_trial(plan, int(number))
        except InputError:
            name = ""  # its numbers make no design, which is why it failed
        else:
            text = {"name": f"{design.name}, trial {number} of {plan.name}", "source": f"seed {plan.draws.seed}"}
            save(design.replace(text), folder / name, overwrite=True)
        found.append(WorstTrial(int(number), float(score), name))
    return tuple(found)


def trial_arrays(plan: Plan, tally: Tally) -> dict[str, NDArray[Any]]:
    """The first trials one by one, for a notebook: deviations, metrics and adjustments, with their names."""
    return {
        "places": np.array([p.place for p in plan.draws.perturbations]),
        "tolerances": np.array([p.tolerance for p in plan.draws.perturbations]),
        "columns": np.array([column.label for column in plan.columns]),
        "adjusters": np.array([adjuster.place for adjuster in plan.adjusters], dtype=str),
        "deviations": tally.drawn,
        "metrics": tally.measured,
        "adjustments": tally.moved,
    }


def _grades(plan: Plan, study: Study, grades: Grades) -> tuple[GradeYield, ...]:
    if study.grade is None:
        return ()
    trials = curve_trials(plan)
    found = []
    for name in grades.names:
        other = make_plan(study.model_copy(update={"grade": name}), plan.question.design, grades)
        found.append(GradeYield(name, yield_at(other, 1.0, trials)))
    return tuple(found)


def _check_traced(plan: Plan) -> TraceCheck | None:
    if plan.question.design.lens is None:
        return None
    from .trace_check import check_traced

    return check_traced(plan)


def _lens_notes(plan: Plan, lens: TraceCheck | None) -> Iterator[str]:
    if lens is None:
        return
    from .reference import reference

    yield str(lens)
    question = plan.question
    folded = reference(question.design, question.fields, question.object_distance).folded
    if folded.any():
        where = ", ".join(f"{x:g}, {y:g} mm" for (x, y), bad in zip(question.fields, folded, strict=True) if bad)
        yield f"the nominal image at {where} is folded (a caustic lies in it): its shape is undefined in every trial"


def _warnings(
    plan: Plan, variants: tuple[Variant, ...], rss: tuple[RssRow, ...], misses: tuple[str, ...]
) -> Iterator[str]:
    if misses:
        yield (
            f"the nominal design itself misses {', '.join(misses)}: "
            "no tolerance can mend that, and inverse sensitivity is left out"
        )
    for column in variants[-1].distributions:
        if column.undefined:
            yield (
                f"{column.label} is undefined in {column.undefined} of {plan.trials} trials; they count as failures, "
                "and its mean and standard deviation are not stated"
            )
    bent = [row.label for row in rss if not row.linear and math.isfinite(row.monte_carlo)]
    if bent:
        yield f"not linear, so RSS misleads (use Monte Carlo): {', '.join(bent)}"
    if plan.draws.sampling == "sobol" and plan.trials & (plan.trials - 1):
        yield f"{plan.trials} trials of a Sobol sequence are less even than a power of two, e.g. {_power(plan.trials)}"
    tilts = [p.place for p in plan.draws.perturbations if ".tilt." in p.place]
    if tilts and any(column.metric == "non_distortion_room_mm" for column in plan.columns):
        yield "non_distortion_room_mm is right to first order in tilts; kept_fraction is exact in them"
    axial = [name for name in plan.question.metrics if not METRICS[name].per_field]
    if axial and tilts:
        yield f"of the whole camera, on its axis, so blind to decentres and tilts: {', '.join(axial)}"


def _power(trials: int) -> int:
    return 1 << (trials - 1).bit_length()
