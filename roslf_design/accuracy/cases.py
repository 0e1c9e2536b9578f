"""The hard cases: what breaks, which form holds, and trials that walk up to the point where it breaks."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .. import theory
from ..design import Design
from . import textbook
from .walks import Walk, arguments_of, growing, rescaled, touching, towards, vanishing

TOUCH = ("fill_factor", "matching_mismatch", "matching_residual")
SLOPES = ("pupil_shear", "epi_slope", "epi_inverse_slope", "rim_disparity", "defocus_blur")

STEPS = 40
"""Steps of a walk."""


@dataclass(frozen=True)
class Budget:
    """How far a function may be off."""

    ulps: float = 4.0
    reason: str = ""
    """Why it is not 4 ulp times (1 + condition)."""
    conditioned: bool = True
    """Whether the number is per (1 + condition)."""

    @property
    def text(self) -> str:
        """For tables."""
        return f"{self.ulps:g} (1 + condition)" if self.conditioned else f"{self.ulps:g}"


@dataclass(frozen=True)
class Trial:
    """One function at one place of a walk."""

    function: str
    gap: float
    given: dict[str, Any] = field(repr=False)
    ours: Callable[..., Any] = field(repr=False)
    exact: Callable[..., Any] = field(repr=False)
    """Textbook formula at 60 digits, by the same keywords."""
    naive: Callable[..., Any] | None = field(repr=False)
    """Textbook formula in double precision."""
    scale: Callable[..., float] | None = field(default=None, repr=False)
    """What errors are measured against; None is the result itself."""


@dataclass(frozen=True)
class HardCase:
    """One row of the table."""

    name: str
    breaks: str
    holds: str
    trials: Callable[[Design, np.random.Generator, int], Iterator[Trial]] = field(repr=False)
    budgets: dict[str, Budget] = field(default_factory=dict, repr=False)
    """By function; without an entry, `Budget()`."""
    shown: str = ""
    """Function whose errors the figure shows."""
    gap_means: str = "relative distance from the singular point"
    point: Callable[[Design], Iterator[tuple[str, dict[str, Any]]]] | None = field(default=None, repr=False)
    """Functions and arguments at the singular point itself."""

    def budget(self, function: str) -> Budget:
        """Of one function."""
        return self.budgets.get(function, Budget())


def _names(keys: tuple[str, ...], only: tuple[str, ...]) -> tuple[str, ...]:
    """Closed forms that take one of `keys`, or those named."""
    return only or tuple(
        name for name in sorted(textbook.formulas()) if not set(keys).isdisjoint(textbook.keywords(name))
    )


def at_point(key: str, value: Callable[[Any], float], only: tuple[str, ...] = ()) -> Callable[..., Any]:
    """Every closed form that takes `key` (or those named), with that value of it."""

    def point(design: Design) -> Iterator[tuple[str, dict[str, Any]]]:
        numbers = arguments_of(design)
        if key == "focal_plane_distance" and value(numbers) == numbers["focal_length"]:
            numbers["pupil_distance"] = 0.2 * numbers["focal_length"]
        numbers[key] = value(numbers)
        for name in _names((key,), only):
            yield name, {other: numbers[other] for other in textbook.keywords(name)}

    return point


def form_trials(walk: Walk, keys: tuple[str, ...], only: tuple[str, ...] = ()) -> Callable[..., Iterator[Trial]]:
    """Trials of every closed form that takes one of `keys` (or of those named)."""

    def trials(design: Design, rng: np.random.Generator, count: int) -> Iterator[Trial]:
        names = _names(keys, only)
        for step in walk(arguments_of(design), rng, count):
            for name in names:
                given = {key: step.numbers[key] for key in textbook.keywords(name)}
                if name == "matched_pupil_distance" and _on_the_verge(given):
                    continue
                yield Trial(name, step.gap, given, getattr(theory, name), textbook.exact(name), textbook.naive(name))

    return trials


def _on_the_verge(given: dict[str, Any]) -> bool:
    """Whether the pupil distance found is d_f but for rounding: there is none then, and either answer is right."""
    d_f, image = given["focal_plane_distance"], given["pupil_diameter"] * given["sensor_distance"]
    scale = given["microlens_pitch"] * theory.mla_distance(given["focal_length"], d_f)
    return bool(image <= 1e-14 * scale)


def _focus_depth(numbers: Any) -> float:
    return float(numbers["focal_plane_distance"] - numbers["pupil_distance"])


def _calibrated_focus_depth(numbers: Any) -> float:
    return float(numbers["effective_image_distance"] / numbers["magnification"])


FORMS = (
    HardCase(
        "d_3 → d_f",
        "H = d_f/(d_f - d_3) grows without bound, 1 - d_3/d_f cancels",
        "the gap g = d_f - d_3 and 1/H = g/d_f",
        form_trials(towards("pupil_distance", lambda n: float(n["focal_plane_distance"])), ("pupil_distance",)),
        shown="inverse_aperture_constant",
        point=at_point("pupil_distance", lambda n: float(n["focal_plane_distance"])),
    ),
    HardCase(
        "d_3 → 0",
        "Eq. 6 divides by d_3",
        "the margin D g - D_F d_f - 2|X_0| d_3",
        form_trials(vanishing("pupil_distance"), ("pupil_distance",)),
        shown="nondistortion_margin",
        point=at_point("pupil_distance", lambda n: 0.0),
    ),
    HardCase(
        "d_3 → f",
        "the exit pupil runs to infinity: L = d_1 - z_x is inf - inf",
        "its vergence 1/L",
        form_trials(towards("pupil_distance", lambda n: float(n["focal_length"])), ("pupil_distance",)),
        shown="exit_pupil_vergence",
        point=at_point("pupil_distance", lambda n: float(n["focal_length"])),
    ),
    HardCase(
        "d_f → f",
        "d_1 runs to infinity, 1/f - 1/d_f cancels",
        "d_1 = f d_f/(d_f - f) with the difference taken first",
        form_trials(
            towards("focal_plane_distance", lambda n: float(n["focal_length"]), above_only=True),
            ("focal_plane_distance",),
        ),
        shown="mla_distance",
        point=at_point("focal_plane_distance", lambda n: float(n["focal_length"])),
    ),
    HardCase(
        "d_1 → f",
        "d_f runs to infinity",
        "d_f = f d_1/(d_1 - f)",
        form_trials(towards("mla_distance", lambda n: float(n["focal_length"]), above_only=True), ("mla_distance",)),
        shown="focal_plane_distance",
        point=at_point("mla_distance", lambda n: float(n["focal_length"])),
    ),
    HardCase(
        "d_f → ∞",
        "d_1 - f cancels, m vanishes",
        "d_1 - f = f^2/(d_f - f)",
        form_trials(growing("focal_plane_distance"), ("focal_plane_distance",)),
        shown="mla_excess",
        gap_means="this d_f over the one at hand, inverse",
        point=at_point("focal_plane_distance", lambda n: math.inf),
    ),
    HardCase(
        "D_F → 0",
        "the f-number grows without bound",
        "the angle D_F H/d_1",
        form_trials(vanishing("pupil_diameter"), ("pupil_diameter",)),
        shown="pupil_angle",
        gap_means="D_F over the one at hand",
        point=at_point("pupil_diameter", lambda n: 0.0),
    ),
    HardCase(
        "d_2 → 0",
        "Fresnel number and views grow without bound",
        "the angle d/d_2, the width lambda d_2/d",
        form_trials(vanishing("sensor_distance"), ("sensor_distance",)),
        shown="microlens_image_pitch",
        gap_means="d_2 over the one at hand",
        point=at_point("sensor_distance", lambda n: 0.0),
    ),
    HardCase(
        "images just touch",
        "image diameter less image pitch cancels",
        "one numerator of exact differences over g d_1",
        form_trials(
            towards("pupil_diameter", touching),
            ("pupil_diameter",),
            TOUCH,
        ),
        shown="matching_mismatch",
        point=at_point("pupil_diameter", touching, TOUCH),
    ),
    HardCase(
        "Z_F → focal plane",
        "Eq. 12: m - A/Z_F cancels",
        "m (Z_F - A/m)/Z_F with Z_F - g taken first",
        form_trials(
            towards("depth", _focus_depth),
            ("depth",),
            SLOPES,
        ),
        shown="epi_slope",
        point=at_point("depth", _focus_depth, SLOPES),
    ),
    HardCase(
        "Z_F → A/m",
        "the same with calibrated A and m, which carry errors of their own",
        "fit in 1/Z_F - 1/Z_0; condition told",
        form_trials(towards("depth", _calibrated_focus_depth), ("depth",), ("calibrated_epi_slope",)),
        shown="calibrated_epi_slope",
        point=at_point("depth", _calibrated_focus_depth, ("calibrated_epi_slope",)),
    ),
    HardCase(
        "Z → ∞",
        "lengths overflow, differences of inverse depths vanish",
        "inverse depth, homogeneous coordinates",
        form_trials(growing("depth"), ("depth",)),
        shown="disparity_rate",
        gap_means="depth at hand over this one",
        point=at_point("depth", lambda n: math.inf),
    ),
    HardCase(
        "scale 1e-6 to 1e6",
        "squares of lengths leave the range, absolute thresholds misjudge",
        "products of ratios, no absolute threshold",
        form_trials(rescaled, ("microlens_pitch", "focal_length", "depth", "pupil_distance", "sensor_distance")),
        shown="centre_deviation",
        gap_means="size over the camera at hand",
    ),
)
"""Rows whose functions are closed forms; the shapes are in `shape_cases`."""
