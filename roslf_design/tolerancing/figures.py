"""Which pictures a study has, drawn by `pictures.tolerance` from the study's numbers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..pictures.picture import Picture
from ..pictures.tolerance import (
    Measured,
    RunYields,
    distributions,
    ranked_correlations,
    ranked_moves,
    yield_bars,
    yield_curve,
)
from ..words import in_words
from .analyses import LimitYield, Yield
from .metrics import METRICS
from .places import short_name
from .result import StudyResult

MOST = 14
"""Bars that a ranking shows."""


def plot_yield(result: StudyResult) -> Picture:
    """The yield over a common factor on all tolerances, with its interval, the target and what meets it."""
    reached = None if result.scale_for_target is None else result.scale_for_target[0]
    return yield_curve(_yields(result), (500, 320), result.study.yield_target, reached)


def plot_grades(result: StudyResult) -> Picture:
    """The yield that each grade of tolerances gives."""
    return yield_bars(_yields(result), (500, 0), result.study.yield_target)


def plot_sensitivity(result: StudyResult) -> Picture:
    """How far each perturbation alone moves the weakest metric, ranked, at both ends of its tolerance."""
    limit, row = _weakest(result)
    found = result.sensitivity
    order = _largest(np.nan_to_num(found.worst[-1, row], posinf=np.finfo(float).max))
    plus, minus = (np.nan_to_num(moves[-1, row, order]) for moves in (found.plus, found.minus))
    nominal = _nominal(result, row)
    limits = [edge - nominal for edge in (limit.low, limit.high)]
    return ranked_moves(_names(result, order), plus, minus, limits, _axis(result, row))


def plot_correlations(result: StudyResult) -> Picture:
    """The correlation of each perturbation with the weakest metric over all trials, ranked."""
    _, row = _weakest(result)
    values = result.correlations[row]
    noise = 2 / np.sqrt(result.plan.trials)
    order = _largest(np.where(np.abs(values) > noise, np.abs(values), 0.0))
    return ranked_correlations(_names(result, order), values[order], noise, _axis(result, row, unit=False))


def plot_spread(result: StudyResult) -> Picture:
    """The distribution of the weakest metric, as built and, where anything is adjusted, afterwards."""
    limit, row = _weakest(result)
    shown = [result.variants[0]] if len(result.variants) == 1 else [result.variants[0], result.final]
    columns = [variant.distributions[row] for variant in shown]
    parts = [
        (variant.name, np.array(column.cuts), np.array(column.histogram))
        for variant, column in zip(shown, columns, strict=True)
    ]
    limits = [edge for edge in (limit.low, limit.high) if np.isfinite(edge)]
    return distributions(
        parts, _nominal(result, row), limits, (columns[-1].low, columns[-1].high), _axis(result, row), (500, 310)
    )


PLOTS: dict[str, tuple[str, Callable[[StudyResult], Picture]]] = {
    "yield": ("Yield over tolerance", plot_yield),
    "grades": ("What a grade buys", plot_grades),
    "spread": ("Spread of the weakest metric", plot_spread),
    "sensitivity": ("What moves the weakest metric", plot_sensitivity),
    "correlation": ("What goes with the weakest metric", plot_correlations),
}
"""Name to title and drawing function."""


def drawn(result: StudyResult) -> dict[str, Picture]:
    """Every picture that the study has something for."""
    return {name: plot(result) for name, (_, plot) in PLOTS.items() if name != "grades" or result.grades}


def pictures(result: StudyResult) -> dict[str, bytes]:
    """Every picture as the bytes of files: name with suffix to content, SVG and PNG."""
    files: dict[str, bytes] = {}
    for name, picture in drawn(result).items():
        files[f"{name}.svg"] = picture.svg_file()
        files[f"{name}.png"] = picture.to_png()
    return files


def _measured(measured: Yield) -> Measured:
    return Measured(measured.value, *measured.interval)


def _yields(result: StudyResult) -> RunYields:
    grades = [(grade.grade, _measured(grade.result)) for grade in result.grades]
    own = next((share for name, share in grades if name == result.study.grade), _measured(result.final.result))
    return RunYields(
        result.study.grade or "", own, grades, [(scale, _measured(at)) for scale, at in result.yield_curve]
    )


def _names(result: StudyResult, order: NDArray[np.intp]) -> list[str]:
    return [short_name(result.plan.draws.perturbations[index].place) for index in order]


def _largest(sizes: NDArray[np.float64]) -> NDArray[np.intp]:
    """Where the largest are, in order; without those too small to be seen."""
    order = np.argsort(-sizes, kind="stable")[:MOST]
    large = order[sizes[order] > 2e-3 * sizes[order[0]]]
    return large if len(large) else order[:1]


def _weakest(result: StudyResult) -> tuple[LimitYield, int]:
    limit = result.final.weakest
    return limit, [column.label for column in result.plan.columns].index(limit.label)


def _nominal(result: StudyResult, row: int) -> float:
    value = result.variants[0].distributions[row].nominal
    return value if np.isfinite(value) else 0.0


def _axis(result: StudyResult, row: int, unit: bool = True) -> str:
    column = result.plan.columns[row]
    metric = METRICS[column.metric]
    place = ""
    if column.field is not None:
        x, y = result.plan.question.fields[column.field]
        place = f" at ({x:.3g}, {y:.3g}) mm"
    return f"{in_words(metric.name)}{place}" + (f" [{metric.unit}]" if unit and metric.unit else "")
