"""The page on accuracy against time: what to choose when, diagrams, methods, and whether the choice is honest."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median

import numpy as np

from roslf_design.accuracy.table import QUANTITIES, Choice
from roslf_design.accuracy.table import AccuracyTable as Measured
from roslf_design.drawing.marks import Dots, Key, Line, Mark, joined, line_key, xy
from roslf_design.drawing.panel import Panel, Scale
from roslf_design.drawing.picture import PAGE, Picture, beside, one_panel
from roslf_design.reporting.blocks import (
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

from .jobs import LENS, Job
from .promises import Answer, Tried, WorkDiagram, candidates, methods

Group = tuple[str, Sequence[WorkDiagram], Sequence[Answer]]
"""A quantity, its diagrams, and what was chosen for each."""

PROMISES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-9)
"""Accuracies that the table of choices goes through."""

ADVICE = (
    "Unvignetted fraction, centroid, area of a straight camera: the closed form, always. It costs tens of microseconds "
    "and is right to the last digits; no sampling is quicker at any accuracy that is of use.",
    "Pixels of a white scene by rays: the exact arc-pixel area, always: some 50 microseconds for the pixels of one "
    "microlens. Gauss panels are the way where pixels weigh something that is not constant. Sampling n x n points in "
    "each pixel takes an n of 100 for three digits.",
    "Diffraction: the harmonic series, where neighbours are alike. It ends, and is exact, at the harmonic P/w; "
    "cutting it saves little. The FFT is for what has no series, as vignetted neighbours. Direct Huygens quadrature "
    "is an independent check: right, and hundreds of times slower.",
    "Diffraction behind a cut pupil, a cat's eye: integrals along the rims' arcs, half a millisecond for fourteen "
    "digits of one microlens. The FFT over exact coverage is for whole sensors; each halving of its error takes some "
    "four times as long.",
    "Real lenses: the exact trace, always: tens of nanoseconds a ray. A thin lens may be off by whole microlenses.",
    "Textures: Gauss panels while the texture is smooth. Edges and pictures need samples: scrambled Sobol points, of "
    "which the same error takes far fewer than of independent ones.",
    "Depth: the range of depths in closed form. The first-order sigma is as good while it is small against the depth.",
    "Rays against waves: where the dashed line lies above the accuracy wanted, no number of rays helps; switch on "
    "diffraction. More digits of the wrong model are not accuracy.",
)
"""In words, what an engineer should choose."""

RATES = (
    ("Monte Carlo", "N^-1/2 in N points", "a hundred times the time for one digit more"),
    ("scrambled Sobol", "about N^-0.8", "an edge through the square keeps it from N^-1"),
    ("grid", "about N^-0.75 in N = n^2 points", "the rows that the rim cuts decide"),
    ("Gauss panels", "exponential in n nodes", "two to three nodes for a digit"),
    ("arc integrals", "exponential in n nodes", "nothing on a rim is singular, however near another it runs"),
    ("exact trace", "exact", "to 1e-13 of what a microlens sees"),
    ("adaptive quadrature", "to what is asked", "does not know where curves change, and pays for finding out"),
    ("FFT", "about n^-2 to n^-3", "what lies above the grid's frequencies aliases"),
    ("harmonic series", "exact once complete", "(2 P/w + 1)^2 terms"),
    ("direct Huygens", "about 1/K^2 in K neighbours", "tails of the sinc"),
)
"""Method, how its error falls, and a remark."""


def accuracy_report(
    name: str,
    groups: Sequence[Group],
    table: Measured,
    trials: Sequence[Tried],
    command: str,
    accuracy: float,
    left_out: Sequence[str] = (),
) -> Report:
    """The whole page.

    Parameters
    ----------
    name : str
        The design's.
    groups : sequence of (quantity, diagrams, answers)
    table : Measured
        What choices are made by.
    trials : sequence of Tried
        Of the choice; may be empty.
    command : str
        That makes this page.
    accuracy : float
        That the marked choices keep.
    left_out : sequence of str
        What the page is silent on, a sentence each.
    """
    figures = tuple(_figure(quantity, diagrams, answers, accuracy) for quantity, diagrams, answers in groups)
    jobs = {quantity: diagrams[0].job for quantity, diagrams, _ in groups if quantity in QUANTITIES}
    sections = [
        Section("What to choose when", (Bullets(ADVICE),)),
        Section("What is chosen", (choice_table(jobs, table),)),
        Section("Error against time", (_reading(accuracy), *(Paragraph(said) for said in left_out), *figures)),
        Section("Methods", (method_table(),)),
    ]
    if trials:
        sections.append(Section("Is the choice honest?", honesty_blocks(trials)))
    sections.append(Section("How this was made", (_made(table), Code(command))))
    return Report("Accuracy against time", f"{name}: what each digit costs", tuple(sections))


def _reading(accuracy: float) -> Paragraph:
    return Paragraph(
        "Each line is a method, each point a level of effort: medians, with bars over the middle half of times and all "
        "seeds' errors. Down and left is better; errors far above 1 are not drawn. A ring marks what is chosen for an "
        f"accuracy of {accuracy:g} (dotted). Errors against references of 22 to 50 digits; of cut diffraction images "
        "against Huygens's integral in double precision. Dashed: a floor that no effort gets past, as the model itself "
        "leaves something out: by how much the best ray image misses the wave image of the same camera, neighbours "
        "alike; by how much a thin lens misses the real one."
    )


def _figure(quantity: str, diagrams: Sequence[WorkDiagram], answers: Sequence[Answer], accuracy: float) -> Figure:
    chosen = dict.fromkeys(answer.choice.method for answer in answers)
    floors = [diagram.floor for diagram in diagrams if diagram.floor is not None]
    words = QUANTITIES.get(quantity, "pixels of the scene given; largest error, 1 is a fully lit pixel")
    caption = f"{words[0].upper()}{words[1:]}."
    if chosen:
        caption += f" Chosen for {accuracy:g}: {', '.join(chosen)}."
    if floors and quantity == LENS:
        caption += f" The thin lens is off by {min(floors):.2g} to {max(floors):.2g} of such samples."
    elif floors:
        caption += f" Rays miss the waves by {min(floors):.2g} to {max(floors):.2g} of a fully lit pixel here."
    words = f"Error against time of every method for {quantity}, both axes logarithmic"
    name = "work-" + quantity.replace(" ", "-")
    return Figure(name, quantity.capitalize(), caption, plot_diagrams(name, words, diagrams, answers).svg(), words)


def choice_table(jobs: dict[str, Job], table: Measured) -> Table:
    """Method, level and time for each quantity and accuracy."""
    rows = []
    for quantity, job in jobs.items():
        cells = [quantity]
        for accuracy in PROMISES:
            choice = candidates(job, accuracy, table)[0]
            level = f" {choice.level}" if choice.level else ""
            text = f"{choice.method}{level}: {time_text(choice.expected_seconds)}"
            cells.append(text if choice.attainable else f"none; {choice.method} reaches {choice.expected_error:.0e}")
        rows.append(tuple(cells))
    headings = ("quantity", *(f"{accuracy:g}" for accuracy in PROMISES))
    caption = "For the first job of each figure. Times as measured where the table was made."
    return Table(tuple(rows), "l" * len(headings), headings, "", caption)


def time_text(seconds: float) -> str:
    """A time with a unit."""
    if seconds >= 100:
        return f"{seconds / 60:.0f}\N{NO-BREAK SPACE}min"
    for unit, size in (("s", 1.0), ("ms", 1e-3)):
        if seconds >= size:
            return f"{seconds / size:.2g}\N{NO-BREAK SPACE}{unit}"
    return f"{seconds / 1e-6:.0f}\N{NO-BREAK SPACE}µs"


def method_table() -> Table:
    """Every method, what it computes, what a level is, and how its error falls."""
    laws = {name: (law, remark) for name, law, remark in RATES}
    quantities_of: dict[tuple[str, str], list[str]] = {}
    for quantity in QUANTITIES:
        for method in methods(quantity):
            quantities_of.setdefault((method.name, method.does), []).append(quantity)
    rows = []
    for (name, does), quantities in quantities_of.items():
        left_out = ("does not fall", "leaves out what the others compute")
        law = laws.get(
            name, left_out if name in ("rays alone", "first order", "thin lens") else ("exact", "to rounding")
        )
        rows.append((name, ", ".join(quantities), does, *law))
    return Table(tuple(rows), "lllll", ("method", "for", "level n", "error falls as", "remark"))


def honesty_blocks(trials: Sequence[Tried]) -> tuple[Statements, Table]:
    """How many promises were kept, and at what cost."""
    kept = sum(trial.kept for trial in trials)
    slow = [trial.slowdown for trial in trials if trial.slowdown is not None]
    tone: Tone = "good" if kept >= 0.98 * len(trials) else "bad"
    text = f"{kept} of {len(trials)} random jobs at accuracies between 1e-1 and 1e-9 were within what was promised"
    items = [Statement(tone, text)]
    if slow:
        ratio = median(slow)
        tone = "good" if ratio <= 2 else "caution"
        words = f"Median time {ratio:.2g} times that of the fastest method that would have kept the same promise"
        items.append(Statement(tone, words + ", checks included"))
    rows = []
    for quantity in dict.fromkeys(trial.job.quantity for trial in trials):
        mine = [trial for trial in trials if trial.job.quantity == quantity]
        ratios = [trial.slowdown for trial in mine if trial.slowdown is not None]
        used = dict.fromkeys(trial.answer.choice.method for trial in mine)
        worst = max(trial.actual_error / trial.accuracy for trial in mine)
        rows.append(
            (
                quantity,
                f"{sum(trial.kept for trial in mine)} of {len(mine)}",
                f"{worst:.2g}",
                f"{median(ratios):.2g}" if ratios else "-",
                ", ".join(used),
            )
        )
    headings = ("quantity", "met", "largest error over promise", "median time over fastest", "methods used")
    return Statements(tuple(items)), Table(tuple(rows), "llrrl", headings)


def _made(table: Measured) -> Paragraph:
    where = f" ({table.machine})" if table.machine else ""
    return Paragraph(
        f"Choices are made by a table of errors and times{where}; roslf accuracy calibrate measures your own. Times "
        "on this page are of the machine that made it, and differ from run to run; errors do not."
    )


def answers_table(groups: Sequence[Group]) -> Table:
    """What was chosen for each job, and what came of it."""
    rows = []
    for quantity, diagrams, answers in groups:
        for diagram, answer in zip(diagrams, answers, strict=True):
            choice = answer.choice
            actual = [p.error for p in diagram.points if (p.method, p.level) == (choice.method, choice.level)]
            rows.append(
                (
                    quantity,
                    diagram.title,
                    choice.method + (f" {choice.level}" if choice.level else ""),
                    f"{choice.expected_error:.1e}",
                    "-" if answer.measured_error is None else f"{answer.measured_error:.1e}",
                    f"{actual[0]:.1e}" if actual else "-",
                    time_text(answer.seconds),
                    "yes" if choice.attainable else "NO",
                )
            )
    headings = ("quantity", "job", "method", "expected", "measured", "actual", "time", "within")
    return Table(tuple(rows), "lllrrrrl", headings, "Cheapest methods")


def scene_sentence(diagram: WorkDiagram, choice: Choice, method: str) -> str:
    """The number of rays that a user's scene takes, in words; `method` is the renderer's."""
    rays = f"{choice.level} rays a pixel" if choice.level else f"no rays ({method})"
    enough = "" if choice.attainable else ", which is not enough: no number tried keeps it"
    text = f"{diagram.title}: {rays} for {choice.accuracy:g}{enough}; tracing the whole sensor takes about "
    return text + time_text(choice.expected_seconds)


# --- diagrams: error against time, both logarithmic, one line a method ------------------------------------------------

LOOKS = {
    "closed form": ("ink", "D"),
    "exact arc-pixel area": ("ink", "D"),
    "harmonic series": ("ink", "s"),
    "Gauss panels": ("blue", "o"),
    "arc integrals": ("ink", "D"),
    "adaptive quadrature": ("sky", "v"),
    "grid": ("orange", "s"),
    "Monte Carlo": ("vermillion", "x"),
    "scrambled Sobol": ("green", "^"),
    "rays (Sobol)": ("green", "^"),
    "FFT": ("orange", "+"),
    "direct Huygens": ("purple", "o"),
    "exact trace": ("ink", "D"),
    "thin lens": ("grey", "*"),
    "rays alone": ("grey", "*"),
    "first order": ("grey", "*"),
}
"""Colour and marker of each method: told apart by either."""

FLOORS = {LENS: "thin lens against the real one"}
"""What the floor's line is called, where it is not rays against waves."""

LEAST = 1e-17
MOST = {LENS: 30.0}
"""Errors above this are not drawn; of most quantities 3, where 1 is everything."""
COLUMNS = 2


TICKS = tuple((10.0**power, f"10{str(power).translate(str.maketrans('-0123456789', '⁻⁰¹²³⁴⁵⁶⁷⁸⁹'))}" if power else "1")
              for power in (-16, -12, -8, -4, 0))  # fmt: skip


def plot_diagrams(name: str, title: str, diagrams: Sequence[WorkDiagram], answers: Sequence[Answer]) -> Picture:
    """Panels side by side, one legend; what was chosen for each gets a ring, its accuracy a line."""
    columns = min(COLUMNS, len(diagrams))
    width = PAGE / columns if columns > 1 else 0.75 * PAGE
    keys: dict[str, Key] = {}
    drawn = [_plot(f"{name}-{k}", width, *pair, keys) for k, pair in enumerate(zip(diagrams, answers, strict=True))]
    rows = [drawn[k : k + columns] for k in range(0, len(drawn), columns)]
    return beside(name, title, [beside("", "", row) for row in rows], list(keys.values()), down=True)


def _plot(name: str, width: float, diagram: WorkDiagram, answer: Answer, keys: dict[str, Key]) -> Picture:
    most, choice = MOST.get(diagram.job.quantity, 3.0), answer.choice
    drawn = [point for point in diagram.points if point.error_range[1] <= most]
    ends = [second for point in drawn for second in point.seconds_range] or [1e-6, 1.0]
    across, up = Scale(min(ends) / 2, max(ends) * 2, log=True), Scale(LEAST, most, log=True)
    marks: list[Mark] = []
    for method in dict.fromkeys(point.method for point in drawn):
        colour, sign = LOOKS[method]
        mine = [point for point in drawn if point.method == method]
        places = [(point.seconds, max(point.error, LEAST)) for point in mine]
        bars = [
            np.array([(second, e) for second in point.seconds_range])
            for point, (_, e) in zip(mine, places, strict=True)
        ]
        bars += [np.array([(point.seconds, max(error, LEAST)) for error in point.error_range]) for point in mine]
        marks += [Line(*xy(places), colour), Line(*xy(joined(bars)), colour, 0.8), Dots(*xy(places), colour, sign, 3)]
        keys.setdefault(method, line_key(method, colour, 1.3, "", Dots((0.0,), (0.0,), colour, sign, 3)))
    lines = [(choice.accuracy, "accuracy asked for", "ink", "1.5 2.5")]
    if diagram.floor is not None:
        lines.append((diagram.floor, FLOORS.get(diagram.job.quantity, "rays against waves"), "grey", "6 3"))
    for error, words, colour, dash in lines:
        marks.append(Line(across[:2], [error, error], colour, 1.3, dash))
        keys.setdefault(words, line_key(words, colour, 1.3, dash))
    for point in diagram.points:
        if (point.method, point.level) == (choice.method, choice.level):
            ring = Dots([point.seconds], [max(point.error, LEAST)], "none", size=8, edge="ink", width=1.8)
            marks.append(ring)
            keys.setdefault("chosen", Key("chosen", (Dots((0.0,), (0.0,), "none", size=6, edge="ink", width=1.8),)))
    title = f"{diagram.job.quantity}: {diagram.title}"
    panel = Panel((0, 0, 1, 1), across, up, tuple(marks), "time [s]", "error", title, y_ticks=TICKS)
    return one_panel(name, title, (width, 264.0), panel, top=28)
