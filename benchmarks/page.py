"""The page of a stored run: goals, ratios, tables, scaling, how to run it again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from roslf_design.pictures.axes import drawing, to_svg
from roslf_design.report.blocks import (
    Block,
    Bullets,
    Code,
    Figure,
    Paragraph,
    Report,
    Section,
    Statement,
    Statements,
    Table,
    Tone,
)

from .figures import plot_ratios, plot_scaling
from .harness.words import digits, duration, interval, per, spread

OWN = ("closed-forms", "shapes", "coverage", "white", "textured", "trials", "optimum", "parts", "commands")
"""Beginnings of the cases that have no peer."""

REASONS = {
    "ideal-lens": "A ray is four numbers read, two numbers and a byte written; the arithmetic between takes less than "
    "fetching them, and threads share one memory. Optiland's arrays take the same way, several times over.",
    "singlet": "The profile is one compiled loop: in double precision, divisions and square roots at each surface.",
    "tolerance": "The profile tells compiled loops from what builds the lenses.",
    "first-answer": "What is left is Python, numpy and loading compiled code.",
    **dict.fromkeys(
        ("centres-hexagonal-0.7", "centres-square-0.7"),
        "Faster, but not more accurate: where images stand well apart, pixels of the gaps add their noise to our "
        "centroids, which take a whole cell so that images that touch are found as well. Both errors lie below 0.0003 "
        "px; where images nearly touch, as in a matched camera, the peer finds none.",
    ),
    "white-floor": "What is left is the sum of harmonics for each pixel, beside one write.",
}
"""Why a goal may be out of reach, told where it was missed."""


def benchmark_report(data: Mapping[str, Any]) -> Report:
    """The whole page."""
    own = [case for case in data["cases"] if case["name"].startswith(OWN) and case["name"] != "white-floor"]
    peers = [case for case in data["cases"] if case not in own]
    sections = [
        Section("Goals", goal_blocks(data["goals"])),
        Section("Side by side", tuple(side_blocks(peers, data["goals"]))),
    ]
    good = [case for case in peers if any(side["quality"] for side in case["sides"])]
    if good:
        sections.append(Section("Accuracy of microlens centres", (quality_table(good),)))
    left_out = [(case, side) for case in peers for side in case["sides"] if side["state"] != "timed"]
    if left_out:
        sections.append(Section("Without a ratio", (left_out_table(left_out),)))
    if own:
        sections.append(Section("What no peer offers", (Paragraph(OWN_TEXT), own_table(own))))
    if data["scaling"]:
        sections.append(Section("Scaling", tuple(scaling_blocks(data))))
    behind = [goal for goal in data["goals"] if goal["met"] is False]
    if behind:
        sections.append(Section("What is behind, and why", tuple(behind_blocks(behind, data))))
    if data["topics"]:
        sections.append(Section("Topics in full", tuple(topic_blocks(data["topics"]))))
    sections.append(Section("Peers", (peer_table(data["peers"]), Paragraph(PEER_TEXT))))
    sections.append(Section("How this was made", tuple(made(data))))
    machine = data["machine"]
    quick = "quick run, small sizes; " if data["quick"] else ""
    subtitle = f"{quick}{machine['processor']}, {machine['cores']} cores, {machine['date']}"
    return Report("Side by side with what people use today", subtitle, tuple(sections))


OWN_TEXT = (
    "None of the peers offers these, so they stand beside plain numpy doing the same work where one would write it by "
    "hand, or alone. Results are compared there too."
)
PEER_TEXT = (
    "Each peer lives in a Python environment of its own, made by the script with the versions above, and runs as a "
    "process of its own. None is needed by the project. PlenoptiSign and PlenoptiCam are called as documented and "
    "nothing of theirs is copied. Size: all packages an installation brings, byte code left out."
)


def goal_blocks(goals: Sequence[Mapping[str, Any]]) -> tuple[Block, ...]:
    """Every goal with what was reached."""
    if not goals:
        return (Paragraph("No comparison with a goal was run."),)
    items = []
    for goal in goals:
        tone: Tone = "caution" if goal["met"] is None else "good" if goal["met"] else "bad"
        if goal["ratio"] is None:
            text = f"{_capital(goal['text'])}: no ratio; {goal['against']} {goal['reason']}"
        else:
            reached = interval({"value": goal["ratio"], "low": goal["low"], "high": goal["high"]})
            text = f"{_capital(goal['text'])}: {reached} ({_human(goal['case'])})"
            if goal["least"] < 1:
                backwards = {"value": 1 / goal["ratio"], "low": 1 / goal["high"], "high": 1 / goal["low"]}
                text = f"{_capital(goal['text'])}: {interval(backwards)} times"
            if goal["worse_in"]:
                text += f"; worse in {', '.join(goal['worse_in'])}"
        items.append(Statement(tone, text))
    return (Statements(tuple(items)),)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _human(name: str) -> str:
    return name.replace("-", " ")


def side_blocks(cases: Sequence[Mapping[str, Any]], goals: Sequence[Mapping[str, Any]]) -> list[Block]:
    """Figure and table of the comparisons with peers."""
    with drawing():
        svg = to_svg(plot_ratios(cases, goals), "ratios")
    reading = Paragraph(
        "All sides of a comparison are run in turn, in an order that changes from round to round, so that each pair of "
        "times met the same machine. A ratio is the median over rounds of the other's time over the time here for the "
        "same work; in brackets its 95 % interval, from pairs drawn again. Where results differ by more than stated, "
        "no ratio is given."
    )
    caption = (
        "Dots with intervals: how many times as long the other takes. Where an interval holds 1, neither is faster. "
        "Red ticks are goals."
    )
    words = "Ratios of times with intervals, a row for each comparison, logarithmic"
    return [reading, Figure("ratios", "How many times as long", caption, svg, words), *case_tables(cases)]


WIDTHS = (17.0, 5.0, 11.0, 9.0, 10.0, 15.0)
"""Of the columns of a case's table [em], so that tables below each other align."""


def case_tables(cases: Sequence[Mapping[str, Any]]) -> list[Block]:
    """A table for each case, a row for each side."""
    headings = ("who", "threads", "median", "quartiles", "times as long", "results differ by")
    found: list[Block] = []
    for case in cases:
        rows = []
        for index, side in enumerate(case["sides"]):
            checks = [f"{check['name']} {_small(check['difference'])}" for check in side["checks"] if index]
            rows.append((*_timed(case, side), "; ".join(checks)))
        found.append(Table(tuple(rows), "lrrrrl", headings, case["title"], case["note"], widths=WIDTHS))
    return found


def own_table(cases: Sequence[Mapping[str, Any]]) -> Table:
    """All cases without a peer in one table."""
    rows = []
    for case in cases:
        for index, side in enumerate(case["sides"]):
            rows.append((case["title"] if index == 0 else "", *_timed(case, side)))
    notes = " ".join({case["note"]: f"{case['title']}: {case['note']}" for case in cases if case["note"]}.values())
    return Table(tuple(rows), "llrrrr", ("work", "who", "threads", "median", "quartiles", "times as long"), "", notes)


def _timed(case: Mapping[str, Any], side: Mapping[str, Any]) -> tuple[str, ...]:
    """Who, threads, median, quartiles, ratio; numbers are not broken at the end of a line."""
    told = per(case, side) if side["state"] == "timed" else side["state"]
    numbers = (told, spread(side), interval(side["ratio"]))
    return (side["label"], str(side["threads"]), *(text.replace(" ", "\u00a0") for text in numbers))


def _small(value: float | None) -> str:
    return "-" if value is None else "0" if value == 0 else f"{value:.1e}" if value < 1e-2 else digits(value)


def quality_table(cases: Sequence[Mapping[str, Any]]) -> Table:
    """How good results are."""
    names = list(dict.fromkeys(name for case in cases for side in case["sides"] for name in side["quality"]))
    rows = []
    for case in cases:
        for index, side in enumerate(case["sides"]):
            values = [side["quality"].get(name) for name in names]
            shown = ["none found" if value is None else digits(value) for value in values]
            if not side["quality"]:
                shown = [side["state"]] * len(names)
            rows.append((case["title"] if index == 0 else "", side["label"], *shown))
    caption = "Against the lattice that the image was made from; lenses nearer than a pitch to the border left out."
    return Table(tuple(rows), "ll" + "r" * len(names), ("image", "who", *names), "", caption)


def left_out_table(found: Sequence[tuple[Mapping[str, Any], Mapping[str, Any]]]) -> Table:
    """Sides that were missing, failed or disagreed."""
    rows = tuple((case["title"], side["label"], side["state"], side["reason"]) for case, side in found)
    return Table(rows, "llll", ("work", "who", "state", "why"))


def scaling_blocks(data: Mapping[str, Any]) -> list[Block]:
    """Figure and table of slopes."""
    with drawing():
        svg = to_svg(plot_scaling(data["scaling"], data["bandwidth"]), "scaling")
    rows = []
    for axis in data["scaling"]:
        done = [point for point in axis["points"] if point["measured"]]
        left = [point for point in axis["points"] if not point["measured"]]
        told = "all" if not left else "up to " + (f"{done[-1]['size']:g}" if done else "none")
        reasons = sorted({point["reason"] for point in left if point.get("reason")})
        fit = axis["slope"]
        slope_text = "-" if fit is None else f"{fit['value']:.2f} ± {fit['error']:.2f}"
        largest = done[-1] if done else None
        floor = "-"
        if axis["bytes_each"] and largest:
            speed = data["bandwidth"].get(str(axis["threads"])) or next(iter(data["bandwidth"].values()))
            floor = digits(largest["seconds"] * speed / (largest["size"] * axis["bytes_each"]))
        rows.append(
            (
                axis["title"],
                str(axis["threads"]),
                "; ".join([told, *reasons]),
                slope_text,
                "-" if largest is None else f"{largest['size']:g}: {duration(largest['seconds'])}",
                "-" if largest is None or not largest["peak_mib"] else f"{digits(largest['peak_mib'])} MiB",
                floor,
                axis["note"],
            )
        )
    headings = ("what", "threads", "run", "slope", "largest run", "memory", "times the floor", "how")
    speeds = ", ".join(f"{value / 1e9:.1f} GB/s by {threads}" for threads, value in data["bandwidth"].items())
    caption = (
        "Slope: exponent of time against size over the largest four sizes. Floor: bytes that must be read and written, "
        f"at the speed at which memory copies ({speeds} threads, reading and writing together)."
    )
    note = "Each size in a process of its own. Hollow: not run but extrapolated in proportion to the largest run."
    words = "Time and memory against rays, trials, pixels and parameters"
    return [
        Figure("scaling", "Time and memory against size", note, svg, words),
        Table(tuple(rows), "lrlrrrrl", headings, "", caption),
    ]


def behind_blocks(goals: Sequence[Mapping[str, Any]], data: Mapping[str, Any]) -> list[Block]:
    """Each goal missed, with where the time goes."""
    blocks: list[Block] = []
    for goal in goals:
        name = goal["case"].split("-")[0] if goal["case"].startswith("centres") else goal["case"]
        reached = f"{_capital(goal['text'])}: reached {digits(goal['ratio'])}."
        case = next(case for case in data["cases"] if case["name"] == goal["case"])
        share = memory_share(case, data["bandwidth"])
        why = REASONS.get(name, "")
        if share is not None:
            why = f"Here memory moves at {100 * share:.0f} % of the speed at which it copies. " + why * (share > 0.5)
        blocks.append(Paragraph(f"{reached} {why}".strip()))
        rows = tuple(
            (row["function"], f"{100 * row['share']:.0f} %", str(row["calls"]))
            for row in goal.get("profile", ())
            if row["share"] >= 0.01
        )
        if rows:
            blocks.append(
                Table(rows, "lrr", ("function", "of the time", "calls"), f"Profile of {_human(goal['case'])}")
            )
    return blocks


def memory_share(case: Mapping[str, Any], bandwidth: Mapping[str, float]) -> float | None:
    """Part of the memory's speed that our side uses; None where it is not known what must be moved."""
    ours = case["sides"][0]
    if not case["bytes_each"] or ours["rate"] is None:
        return None
    speed = bandwidth.get(str(ours["threads"])) or next(iter(bandwidth.values()))
    return float(ours["rate"] * case["bytes_each"] / speed)


def topic_blocks(topics: Mapping[str, Mapping[str, Any]]) -> list[Block]:
    """What each topic printed."""
    return [Code(told["text"].strip(), f"{name} ({duration(told['seconds'])})") for name, told in topics.items()]


def peer_table(peers: Sequence[Mapping[str, Any]]) -> Table:
    """What was installed."""
    rows = []
    for peer in peers:
        state = "yes" if peer["installed"] else f"no: {peer['reason']}"
        size = f"{digits(peer['size_mib'])} MiB" if peer["installed"] else ""
        took = duration(peer["install_seconds"]) if peer["install_seconds"] else ""
        rows.append((peer["title"], peer["licence"], state, size, took, peer["note"]))
    return Table(tuple(rows), "lllrrl", ("program", "licence", "installed", "size", "took", "note"))


def made(data: Mapping[str, Any]) -> list[Block]:
    """Machine, rules, commands."""
    machine = data["machine"]
    packages = ", ".join(f"{name} {version}" for name, version in machine["packages"].items())
    facts = (
        f"{machine['processor']}, {machine['cores']} cores, {machine['memory_gib']} GiB, {machine['system']}, Python "
        f"{machine['python']}; {packages}; revision {machine['revision']} (+: files differed from it)",
        f"load of the machine before the run: {machine['load_before']} (0 is quiet; the more, the wider the intervals)",
        "threads of every pool (OpenMP, BLAS, numba) are set to the number in the tables",
        "a run that does not count comes first on each side: it compiles, caches and gives the result compared",
        "runs under 20 ms are repeated within one measurement",
        f"the whole took {duration(data['seconds'])}",
    )
    commands = (
        "make bench              # this page: peers, comparisons, scaling, topics; under 30 minutes\n"
        "make bench-quick        # small sizes, under 3 minutes, into out/benchmarks-quick\n"
        "python -m benchmarks --only singlet     # one comparison; --list names them\n"
        "make bench-compare REV=HEAD~10          # two revisions in turn, ratios with intervals"
    )
    return [Bullets(facts), Code(commands)]
