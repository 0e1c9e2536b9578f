"""Hard cases of shapes: discs that almost touch or contain each other, slivers, small angles."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import mpmath as mp
import numpy as np

from roslf_design.camera import Camera
from roslf_design.design import Design, load
from roslf_design.effects import SceneBrief, Subject
from roslf_design.effects.geometry import cos4
from roslf_design.evaluation.fields import field_openings
from roslf_design.shapes.discs import intersect
from roslf_design.shapes.openings import Openings
from roslf_design.theory.light import chief_slope

from .hard_cases import Budget, HardCase, Trial
from .hard_walks import (
    Rng,
    gaps,
)
from .oracles.judging import traced
from .oracles.textbook import cos4_loss, lost_share, overlap
from .shapes import covered_pixels

ISSUE_RADII = (2.2, 25.4)
"""A pupil of 4.4 mm behind a two-inch lens [mm]."""

ANY = ", any direction"
"""Added to a function's name where centres lie off the axes."""
EXACT_SHAPE = Budget(
    16, "for two discs exactly as given, whatever their gap: nothing is granted to the condition", False
)
ANY_DIRECTION = Budget(
    32, "off the axes the gap may be a fraction of the last place of the distance, which is no machine number", False
)
PIXELS = Budget(16, "in units of a fully lit pixel's last place, times the disc's radius in pixels", False)
CELL = Budget(16, "in units of the last place of the square of the discs' extent", False)
COLUMNS = 12
"""Pixels across the disc of the walk to slivers."""


def radii_of(design: Design) -> tuple[float, float]:
    """Image of the FAP, and the smallest image of another rim that is larger [mm]; by default the bench's."""
    _, radii = field_openings(design, [(0.0, 0.0)])[:2]
    larger = [float(R) for R in radii[0, 1:] if radii[0, 0] < R]
    return (float(radii[0, 0]), min(larger)) if larger else ISSUE_RADII


def _pairs(design: Design, rng: Rng) -> Iterator[tuple[float, float]]:
    """Radii to walk with, without end: the issue's, the design's own, others of any ratio."""
    while True:
        yield ISSUE_RADII
        yield radii_of(design)
        r = 10 ** float(rng.uniform(-6, 6))
        yield r, r * (1 + 10 ** float(rng.uniform(-3, 2)))


def _placed(distance: float, rng: Rng) -> tuple[str, float, float]:
    """Centre of the second disc, half of the time off the axes, and how that is called."""
    if rng.random() < 0.5:
        return "", distance, 0.0
    angle = float(rng.uniform(0, 2 * math.pi))
    return ANY, distance * math.cos(angle), distance * math.sin(angle)


def _two_discs(number: str, exact: Callable[..., Any]) -> tuple[Callable[..., Any], ...]:
    """Ours (a number of `intersect`), exact and textbook, of radii r, R and the second disc's place x, y."""
    return (
        lambda r, R, x, y: getattr(intersect([[0.0, 0.0], [x, y]], [r, R]), number),
        traced(lambda r, R, x, y: exact(r, R, mp.hypot(x, y))),
        lambda r, R, x, y: exact(r, R, math.hypot(x, y)),
    )


AREA = _two_discs("area", overlap)
LOST = _two_discs("lost_fraction", lost_share)
KEPT = _two_discs("kept_fraction", lambda r, R, distance: 1 - lost_share(r, R, distance))


def tangent_trial(gap: float) -> Trial:
    """The bench's discs, overlapping by a gap in mm."""
    r, R = ISSUE_RADII
    return Trial("overlap", gap / r, {"r": r, "R": R, "x": r + R - gap, "y": 0.0}, *AREA)


def tangent(design: Design, rng: Rng, count: int) -> Iterator[Trial]:
    """Discs that overlap by less and less."""
    pairs = _pairs(design, rng)
    for gap in (1e-4, 1e-6, 1e-8):
        yield tangent_trial(gap)
    for gap in gaps(rng, 2 * count):
        r, R = next(pairs)
        where, x, y = _placed((r + R) * (1 - gap), rng)
        yield Trial("overlap" + where, gap, {"r": r, "R": R, "x": x, "y": y}, *AREA)


def barely_clipped(design: Design, rng: Rng, count: int) -> Iterator[Trial]:
    """A small disc that another just begins to cut."""
    pairs = _pairs(design, rng)
    for gap in gaps(rng, 2 * count):
        r, R = next(pairs)
        where, x, y = _placed(R - r + gap * R, rng)
        given = {"r": r, "R": R, "x": x, "y": y}
        yield Trial("lost_fraction" + where, gap, given, *LOST)
        yield Trial("overlap" + where, gap, given, *AREA)


def coincident(design: Design, rng: Rng, count: int) -> Iterator[Trial]:
    """Equal discs that move onto each other, and neighbours of equality."""
    r = radii_of(design)[0]
    for gap in (*gaps(rng, count), 0.0):
        for R in (r, math.nextafter(r, math.inf), math.nextafter(r, 0)):
            where, x, y = _placed(gap * r, rng)
            yield Trial("kept_fraction" + where, gap, {"r": r, "R": R, "x": x, "y": y}, *KEPT)


def _sliver_pixels(x: float, y: float, r: float) -> float:
    """Coverage of the pixel that the disc's right end just enters; pixels of width 1."""
    image = covered_pixels(np.array([[x, y]]), np.array([r]), COLUMNS + 2, COLUMNS + 2)
    return float(image[math.floor(y), math.floor(x + r)])


def _sliver_cell(x: float, y: float, r: float) -> float:
    column, row = math.floor(x + r), math.floor(y)
    cell = np.array([[column, row], [column + 1, row], [column + 1, row + 1], [column, row + 1]], float)
    return float(Openings.of_discs(np.array([[x, y]]), np.array([r])).area_in(cell))


@traced
def _sliver_exact(x: Any, y: Any, r: Any) -> Any:
    """Segment of the disc beyond the pixel's left edge."""
    angle = mp.acos(1 - (x + r - mp.floor(x + r)) / r)
    return r * r * (angle - mp.sin(2 * angle) / 2)


def _sliver_samples(x: float, y: float, r: float) -> float:
    """Share of 64 x 64 samples."""
    at = (np.arange(64) + 0.5) / 64
    across, along = math.floor(x + r) + at - x, math.floor(y) + at[:, None] - y
    return float((across**2 + along**2 <= r * r).mean())


def slivers(design: Design, rng: Rng, count: int) -> Iterator[Trial]:
    """A disc that pokes less and less into a pixel, in the middle of that pixel's edge."""
    for gap in gaps(rng, count, 1e-9):
        r = 0.25 * COLUMNS + float(rng.uniform(-0.2, 0.2))
        edge = math.floor(COLUMNS / 2 + r)
        given = {"x": edge + min(gap, 0.02) - r, "y": COLUMNS // 2 + float(rng.uniform(0.45, 0.55)), "r": r}
        if given["x"] + r <= edge or math.floor(given["x"] + r) != edge:
            continue
        rest = _sliver_exact, _sliver_samples
        yield Trial("pixel coverage", gap, given, _sliver_pixels, *rest, lambda x, y, r: r)
        yield Trial("area in a cell", gap, given, _sliver_cell, *rest, lambda x, y, r: 4 * r * r)


def small_fields(design: Design, rng: Rng, count: int) -> Iterator[Trial]:
    """Loss by cos^4 at smaller and smaller fields; of the paper's bench where a lens or a mapping says otherwise."""
    if design.lens is not None or Camera.of(design).mapping.bends:
        design = load("paper")

    def ours(radius: float, slope: float) -> float:
        return cos4(Subject(design, SceneBrief(field_radius=radius))).value

    def textbook(radius: Any, slope: Any) -> Any:
        return cos4_loss(radius * slope)

    # The slope as rounded is what the loss is asked for: its own rounding is another row's.
    slope = float(chief_slope(Camera.of(design)))
    for gap in gaps(rng, count, 1e-15):  # the reference itself cancels: 30 of its 60 digits are left
        yield Trial("cos4 loss", gap, {"radius": gap / slope, "slope": slope}, ours, traced(textbook), textbook)


SHAPES = (
    HardCase(
        "discs near tangency", "acos of almost 1 and Heron's formula: error 0.18 at a gap of 1e-6 mm",
        "error-free sums for the gaps, Kahan's sorted product, cap areas by quadrature of positive terms",
        tangent, "overlap", {"overlap": EXACT_SHAPE, "overlap" + ANY: ANY_DIRECTION},
        "overlap of the discs over their radii' sum",
    ),
    HardCase(
        "barely clipped", "1 - A/A_0 cancels", "the crescent's own integral", barely_clipped, "lost_fraction",
        {"overlap": EXACT_SHAPE, "lost_fraction": EXACT_SHAPE, "overlap" + ANY: ANY_DIRECTION,
         "lost_fraction" + ANY: ANY_DIRECTION},
        "how far it pokes out over the larger radius",
    ),
    HardCase(
        "concentric, equal", "0/0, arc cosines of numbers beyond 1", "explicit branches that meet at their seams",
        coincident, "kept_fraction", {"kept_fraction": EXACT_SHAPE, "kept_fraction" + ANY: EXACT_SHAPE},
        "distance of the centres over the radius",
    ),
    HardCase(
        "tiny pixel coverage", "samples miss it", "exact arc-pixel area", slivers, "pixel coverage",
        {"pixel coverage": PIXELS, "area in a cell": CELL}, "how far the disc pokes into the pixel, in pixels",
    ),
    HardCase(
        "small field angles", "1 - cos^4 cancels", "expm1 and log1p", small_fields, "cos4 loss",
        gap_means="slope of the chief ray",
    ),
)  # fmt: skip
"""Shapes and angles."""
