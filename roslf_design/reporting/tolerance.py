"""A tolerance study as a page and as a section of a design's report; the terminal shares its words."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from .. import words
from ..tolerancing.metrics import METRICS
from ..tolerancing.places import display, perturbable, short_name
from ..tolerancing.result import StudyResult
from ..words import in_words
from .blocks import Block, Bullets, Code, Figure, Paragraph, Report, Section, Statement, Statements, Table
from .study_figures import TOLERANCE, tolerance_pictures

TOP = 12
"""Rows of a ranking."""
QUANTILES = 5
"""Columns of quantiles that fit on a page; the rest is in the results' file."""
MOST_RATIO = 1e3
"""Above it the root sum of squares is noise of rounding."""
number = partial(words.number, digits=4, zero=1e-9)


def tolerance_report(result: StudyResult, command: str) -> Report:
    """A study as a page of its own."""
    plan = result.plan
    return Report(f"Tolerances of {plan.question.design.name}", plan.name, (tolerance_section(result, command),))


def tolerance_section(result: StudyResult, command: str = "") -> Section:
    """A study as a section of a report; the command that reruns it is printed where given."""
    blocks: list[Block] = [Paragraph(result.study.question)] if result.study.question else []
    blocks.append(Statements(tuple(_statements(result))))
    captions = _captions(result)
    for name, figure in tolerance_pictures(result).items():
        svg = figure.svg(name=f"tolerance-{name}")
        blocks.append(Figure(f"tolerance-{name}", TOLERANCE[name], captions[name], svg))
    blocks += [_worded(table) for table in tables(result)]
    if result.warnings:
        blocks.append(Bullets(tuple(in_words(warning) for warning in result.warnings)))
    if command:
        blocks.append(Code(command, "Run again"))
    return Section(f"Tolerances: {result.plan.name}", tuple(blocks), f"tolerance-{result.plan.name}".replace(" ", "-"))


def tables(result: StudyResult, brief: bool = False) -> list[Table]:
    """The tables of a study; `brief`: of each metric the field that fails most often."""
    shown = [limits_table(result, brief), quantiles_table(result, brief), tolerances_table(result)]
    shown.append(rss_table(result, brief))
    return shown if result.sobol is None else [*shown, sobol_table(result)]


def headline(result: StudyResult) -> str:
    """One sentence: the yield and its interval."""
    low, high = result.final.result.interval
    plan = result.plan
    adjusted = "" if len(result.variants) == 1 else f" ({100 * result.variants[0].result.value:.2f} % as built)"
    return (
        f"Yield {100 * result.final.result.value:.2f} %{adjusted}, "
        f"95 % interval {100 * low:.2f} to {100 * high:.2f} %, {plan.trials} trials, seed {plan.draws.seed}"
    )


def yield_statement(result: StudyResult, name: str = "") -> Statement:
    """The yield as an answer, with what would mend it."""
    target = result.study.yield_target
    text = f"{headline(result)}; wanted {100 * target:.4g} %{f' ({name})' if name else ''}."
    misses = result.plan.nominal_misses()
    if result.final.result.value >= target:
        return Statement("good", text)
    if misses:
        named = ", ".join(in_words(label) for label in misses)
        remedy = f"The nominal design itself misses its limits ({named}): change the design or the limits."
    elif result.scale_for_target is None:
        remedy = "No tolerance is tight enough: change the nominal design or the limits."
    else:
        remedy = f"Tighten all tolerances to {result.scale_for_target[0]:.3g} of what they are, or the worst few."
    return Statement("bad", text, remedy)


def _statements(result: StudyResult) -> Iterator[Statement]:
    yield yield_statement(result)
    if result.precision is not None:
        accuracy = result.precision.accuracy
        yield Statement("caution" if accuracy.kept is False else "plain", words.sentence(accuracy.sentence(False)))
    weakest = result.final.weakest
    share = 100 * weakest.result.value
    yield Statement(
        "plain" if share == 100 else "caution",
        f"The weakest limit is that on {in_words(weakest.label)}: {share:.2f} % hold it.",
    )
    ranked = ranking(result)
    if ranked and ranked[0][1] > 0.05:
        place, part = ranked[0]
        yield Statement("plain", f"{short_name(place)} goes with it most: {100 * part:.0f} % of its variance.")


def ranking(result: StudyResult) -> list[tuple[str, float]]:
    """Perturbations and the squares of their correlations with the weakest metric, largest first.

    For independent perturbations and a nearly linear response: their shares of its variance, after adjustment.
    """
    labels = [column.label for column in result.plan.columns]
    parts = result.correlations[labels.index(result.final.weakest.label)] ** 2
    order = np.argsort(-parts, kind="stable")
    return [(result.plan.draws.perturbations[index].place, float(parts[index])) for index in order]


def limits_table(result: StudyResult, brief: bool = False) -> Table:
    """Yield of each limit alone, for every variant; `brief` as for `tables`."""
    fields, shown = result.plan.question.fields, _shown(result, brief)
    rows = [
        (
            limit.label,
            *("" if math.isinf(edge) else number(edge) for edge in (limit.low, limit.high)),
            *(f"{100 * variant.limits[index].result.value:.2f}" for variant in result.variants),
        )
        for index, limit in enumerate(result.final.limits)
        if limit.label in shown
    ]
    rows.append(("all together", "", "", *(f"{100 * variant.result.value:.2f}" for variant in result.variants)))
    heads = ("metric@field", "min", "max", *(f"{variant.name} [%]" for variant in result.variants))
    places = ", ".join(f"{index} ({x:.3g}, {y:.3g})" for index, (x, y) in enumerate(fields))
    caption = f"Fields, by the position of their microlens [mm]: {places}." if places else ""
    return Table(tuple(rows), "l" + "d" * (len(heads) - 1), heads, "Limits", caption)


def quantiles_table(result: StudyResult, brief: bool = False) -> Table:
    """Nominal value, mean, spread and quantiles of every metric, finally; `brief` as for `tables`."""
    final, labels = result.final.distributions, _shown(result, brief)
    shown = _spread_out(len(final[0].probabilities))
    undefined = any(column.undefined for column in final)
    rows = tuple(
        (
            column.label,
            *(number(value) for value in (column.nominal, column.mean, column.deviation)),
            *(number(column.quantiles[index]) for index in shown),
            *((str(column.undefined),) if undefined else ()),
        )
        for column in final
        if column.label in labels
    )
    caption = "Undefined trials count as failures; quantiles rank them worst, mean and spread are then not stated."
    quantiles = (f"{100 * final[0].probabilities[index]:.4g} %" for index in shown)
    heads = ("metric@field", "nominal", "mean", "std. dev.", *quantiles, *(("undefined",) if undefined else ()))
    title = f"Distributions, {result.final.name}"
    return Table(rows, "l" + "r" * (len(heads) - 1), heads, title, caption if undefined else "")


def _spread_out(count: int) -> tuple[int, ...]:
    """Of so many quantiles in order, those that a page shows: the outer ones, the middle, and evenly between."""
    return tuple(sorted({round(i * (count - 1) / (QUANTILES - 1)) for i in range(QUANTILES)})) if count else ()


def tolerances_table(result: StudyResult) -> Table:
    """Every perturbation: its tolerance, what it may be alone, what the wanted yield asks, where it comes from."""
    kinds = perturbable(result.plan.question.design)
    allowed = {a.place: a for a in result.allowed}
    scale = None if result.scale_for_target is None else result.scale_for_target[0]
    shares = dict(ranking(result))
    rows = []
    for p in sorted(result.plan.draws.perturbations, key=lambda p: -shares.get(p.place, 0.0)):
        kind, alone = kinds[p.place], allowed.get(p.place)
        rows.append(
            (
                short_name(p.place),
                display(p.tolerance, kind),
                f"{100 * shares.get(p.place, 0.0):.1f}",
                "" if alone is None else display(alone.tolerance, kind),
                "" if alone is None else alone.limited_by,
                "" if scale is None else display(p.tolerance * scale, kind),
                p.source.split(";")[0],
            )
        )
    share = "1/sqrt(n)" if result.study.share == "rss" else "1/n"
    heads = ("parameter", "± tolerance", "r² [%]", "alone up to", "limited by", "for the wanted yield", "source")
    caption = (
        f"r²: squared correlation with the weakest metric. Alone up to: what uses {share} of a "
        "limit's room by itself. For the wanted yield: all tolerances scaled by one factor."
    )
    return Table(tuple(rows), "lrdrlrl", heads, "Tolerances", caption)


def rss_table(result: StudyResult, brief: bool = False) -> Table:
    """Root sum of squares beside Monte Carlo; `brief` as for `tables`."""
    shown = _shown(result, brief)
    rows = tuple(
        (
            row.column,
            number(row.rss),
            number(row.monte_carlo),
            # A spread that is no first-order effect has no ratio worth its digits.
            "none" if row.ratio > MOST_RATIO or math.isnan(row.ratio) else number(row.ratio),
            number(row.mean_shift),
            "yes" if row.linear else "no: use Monte Carlo",
        )
        for row in result.rss
        if row.column in shown
    )
    heads = ("metric@field", "RSS", "Monte Carlo", "ratio", "mean shift", "linear")
    return Table(rows, "lddddl", heads, "Standard deviations as built: RSS beside Monte Carlo")


def sobol_table(result: StudyResult) -> Table:
    """Sobol indices of the weakest metric, ranked by total index."""
    found = result.sobol
    assert found is not None
    label = result.final.weakest.label
    row = [column.label for column in result.plan.columns].index(label)
    rows: list[tuple[str, ...]] = []
    if found.undefined_evaluations[row]:
        rows.append(
            (f"undefined in {found.undefined_evaluations[row]} of {found.evaluations} builds: no indices", "", "")
        )
    else:
        for index in np.argsort(-found.total[row], kind="stable")[:TOP]:
            cells = [
                f"{value[row, index]:.3f} ({ends[row, index, 0]:.3f} to {ends[row, index, 1]:.3f})"
                for value, ends in ((found.first, found.first_interval_95), (found.total, found.total_interval_95))
            ]
            rows.append((_factor(found.factors[index]), *cells))
    heads = ("parameter", "first order (95 %)", "total (95 %)")
    return Table(tuple(rows), "lrr", heads, f"Sobol indices of {label}, {result.final.name}")


def _shown(result: StudyResult, brief: bool) -> set[str]:
    """Labels of all columns; `brief`: of each metric the one that fails most often, else the one that scatters most."""
    if not brief:
        return {column.label for column in result.plan.columns}
    held = {limit.label: limit.result.passed for limit in result.final.limits}
    spread = {column.label: column.high - column.low for column in result.final.distributions}
    worst: dict[str, str] = {}
    for column in result.plan.columns:
        best = worst.get(column.metric)
        key = (held.get(column.label, 0), -spread[column.label])
        if best is None or key < (held.get(best, 0), -spread[best]):
            worst[column.metric] = column.label
    return set(worst.values())


def _captions(result: StudyResult) -> dict[str, str]:
    weakest = in_words(result.final.weakest.label)
    return {
        "yield": "Share of builds that hold all limits, over a common factor on all tolerances; same draws.",
        "grades": "The same study with every graded tolerance at each grade; bars show 95 % intervals.",
        "spread": f"The {weakest}: as built, and after adjustment where anything is adjusted. Dashed: nominal.",
        "sensitivity": f"One miss at a time: change of {weakest} at both ends of its tolerance, after adjustment.",
        "correlation": f"Over all trials, finally: {weakest}. Grey: what chance alone gives in 95 % of cases.",
    }


def _factor(name: str) -> str:
    if name.startswith("group "):
        return name
    place = name.removesuffix(" (own part)")
    return short_name(place) + ("" if place == name else ", own part")


def _worded(table: Table) -> Table:
    """For a page, where there is room: metrics in words, with their units."""
    rows = tuple((_label(first), *(in_words(cell) for cell in rest)) for first, *rest in table.rows)
    heads = tuple(heading.replace("metric@field", "metric") for heading in table.headings)
    return replace(table, rows=rows, headings=heads, title=in_words(table.title))


def _label(cell: str) -> str:
    metric = METRICS.get(cell.partition("@")[0])
    return in_words(cell) + (f" [{metric.unit}]" if metric is not None and metric.unit else "")
