"""What this project does that no peer offers: its own speed, beside plain numpy where one would write it by hand."""

from __future__ import annotations

from functools import partial

from .cases import relative
from .harness.comparison import Case, Side

PIXELS = 4600 * 3080
LENSES = 365 * 237
CHUNK = 32_768
"""Trials of one chunk of a study."""


def own_cases(quick: bool = False) -> list[Case]:
    """Cases with the first side here; their rows make up most of README's table."""
    found = [
        closed_forms(100_000 if quick else 1_000_000),
        *shapes(),
        *coverage(),
        *images(),
        *trials(),
        *searches(),
        *commands(),
    ]
    return found


def _here(work: str, threads: int = 1, **options: object) -> Side:
    label = "here" if threads == 1 else f"here, {threads} threads"
    return Side(label, "here", work, threads, options, file="own_side.py")


def _numpy(work: str, count: float | None = None, **options: object) -> Side:
    return Side("plain numpy", "numpy", work, 1, options, count, file="own_side.py")


def closed_forms(designs: int) -> Case:
    """All closed forms on many designs."""
    side = _here("closed_forms", designs=designs)
    return Case("closed-forms", "Designs through every closed form", "designs", designs, (side,))


def shapes() -> list[Case]:
    """Common parts of discs for a whole array."""
    return [
        Case(
            f"shapes{name}",
            f"Shapes of {LENSES:,} microlens images, two rims{words}",
            "images",
            LENSES,
            (_here("shapes", cut=cut), _numpy("shapes_numpy", cut=cut)),
            judge=partial(relative, {"area": 1e-7}),
            note="Here with moments and exact near tangency; by hand arc cosines, areas alone.",
            fast=not cut,
        )
        for name, words, cut in (("", "", False), ("-cut", ", every image cut", True))
    ]


def coverage() -> list[Case]:
    """Exact pixel coverage of a whole sensor."""
    return [
        Case(
            f"coverage{name}",
            f"Exact pixel coverage, 4600 x 3080 px{words}",
            "pixels",
            PIXELS,
            (_here("coverage", cut=cut), _numpy("coverage_numpy", PIXELS / 20, cut=cut)),
            judge=partial(relative, {"total": 2e-2}),
            note="By hand a twentieth of the lenses is done"
            + (", in 16 slices a pixel; its total is compared." if cut else "; its total is compared."),
            fast=not cut,
        )
        for name, words, cut in (("", "", False), ("-cut", ", every image cut", True))
    ]


def images() -> list[Case]:
    """Whole images."""
    rows = round(3080 / 10) * 4600
    return [
        Case(
            "white",
            "White image of 4600 x 3080 px with diffraction",
            "pixels",
            PIXELS,
            (_here("white", 2), _numpy("white_numpy", rows)),
            note="By hand the same 25 harmonics, a cosine for each and every pixel, on a tenth of the rows.",
        ),
        Case(
            "white-vignetted",
            "White image of 2448 x 2048 px, vignetted, diffraction by FFT",
            "pixels",
            2448 * 2048,
            (_here("white", 2, design="mismatched-borescope"),),
            fast=False,
        ),
        Case(
            "textured",
            "Checkerboard out of focus, 64 rays a pixel",
            "rays",
            300 * 200 * 64,
            (_here("textured", 2),),
        ),
    ]


def trials() -> list[Case]:
    """Tolerance trials of a camera."""
    return [
        Case(
            f"trials-{metrics}",
            f"Tolerance trials, 15 perturbations, 5 metrics at 5 fields, {words}",
            "trials",
            CHUNK,
            (_here("trials", metrics=metrics, trials=2_000_000),),
            note="One process, one thread; studies use as many processes as there are cores.",
            fast=metrics == "closed",
        )
        for metrics, words in (("closed", "closed forms"), ("shapes", "3D shapes"))
    ]


def searches() -> list[Case]:
    """Optimisation."""
    return [
        Case(
            "optimum",
            "Six-variable optimum, 16 starts and a second solver",
            "solutions",
            1,
            (_here("optimum"),),
            fast=False,
        ),
        Case("parts", "Best ten of 100,000 combinations of parts", "runs", 1, (_here("parts"),), fast=False),
    ]


def commands() -> list[Case]:
    """Whole commands."""
    found = []
    for name, *words in (("help", "--help"), ("evaluate", "evaluate", "paper"), ("report", "report", "paper")):
        rest = (*words, "-o", "report") if name == "report" else tuple(words)
        side = Side("here", "here", threads=2, command=("{python}", "-m", "roslf_design", *rest))
        title = f"roslf {' '.join(words)}, from start to exit"
        found.append(Case(f"commands-{name}", title, "runs", 1, (side,), fast=name != "report"))
    return found
