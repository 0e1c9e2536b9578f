"""Hard cases of closed forms, each with its walk towards the singular point."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

from roslf_design.bore.conjugates import mla_distance
from roslf_design.design import Design
from roslf_design.theory.f_number import matched

from .forms import CLOSED, camera_of, left_out
from .hard_cases import HardCase, Trial, Trials
from .hard_walks import (
    Numbers,
    Rng,
    Walk,
    arguments_of,
    rescaled,
    scaling,
    towards,
)
from .oracles.closed_forms import ORACLES, keywords
from .oracles.textbook import TEXTBOOK


def _names(key: str, only: tuple[str, ...]) -> tuple[str, ...]:
    """Closed forms that take `key`, or those named."""
    return only or tuple(name for name in sorted(ORACLES) if key in keywords(name))


def _on_the_verge(name: str, given: dict[str, Any]) -> bool:
    """True where either answer is right: the matched pupil distance is d_f but for rounding, or d_3 counts as 0."""
    if name != "matched_pupil_distance":
        return left_out(name, given)
    d_f, image = given["focal_plane_distance"], given["pupil_diameter"] * given["sensor_distance"]
    return bool(image <= 1e-14 * given["microlens_pitch"] * mla_distance(given["focal_length"], d_f))


def _form_trials(walk: Walk, *names: str) -> Trials:
    def trials(design: Design, rng: Rng, count: int) -> Iterator[Trial]:
        for step in walk(arguments_of(design), rng, count):
            for name in names:
                given = {key: step.numbers[key] for key in keywords(name)}
                if not _on_the_verge(name, given):
                    yield Trial(name, step.gap, given, CLOSED[name], ORACLES[name], TEXTBOOK[name])

    return trials


def _form(
    name: str, breaks: str, holds: str, key: str, walk: Walk, shown: str, only: tuple[str, ...] = (),
    at: Callable[[Numbers], float] | None = None, **more: Any,
) -> HardCase:  # fmt: skip
    """Row of every closed form that takes `key` (or of those named), and what they do where it has the value `at`."""

    def point(design: Design) -> Iterator[tuple[str, dict[str, Any]]]:
        assert at is not None
        numbers = arguments_of(design)
        if key == "focal_plane_distance" and at(numbers) == numbers["focal_length"]:
            numbers["pupil_distance"] = 0.2 * numbers["focal_length"]
        numbers[key] = at(numbers)
        for form in _names(key, only):
            given = {other: numbers[other] for other in keywords(form)}
            if not left_out(form, given):
                yield form, given

    trials = _form_trials(walk, *_names(key, only))
    return HardCase(name, breaks, holds, trials, shown, point=point if at else None, **more)


def _f(n: Numbers) -> float:
    return float(n["focal_length"])


def _d_f(n: Numbers) -> float:
    return float(n["focal_plane_distance"])


def _gap(n: Numbers) -> float:
    return float(n["focal_plane_distance"] - n["pupil_distance"])


def _touching(n: Numbers) -> float:
    """Pupil diameter at which microlens images just touch."""
    return float(matched(camera_of(n), "D_F").value)


def _zero(n: Numbers) -> float:
    return 0.0


def _infinity(n: Numbers) -> float:
    return math.inf


TOUCH = ("fill_factor", "mismatch_px")
SLOPES = ("pupil_shear", "epi_slope", "rim_disparity")
SCALED = ("microlens_pitch", "focal_length", "depth", "pupil_distance", "sensor_distance")

FORMS = (
    _form(
        "d_3 → d_f", "H = d_f/(d_f - d_3) grows without bound, 1 - d_3/d_f cancels",
        "the gap g = d_f - d_3 and 1/H = g/d_f",
        "pupil_distance", towards("pupil_distance", _d_f), "inverse_aperture_constant", at=_d_f,
    ),
    _form(
        "d_3 → 0", "Eq. 6 divides by d_3", "the room on the main lens, (D g - D_F d_f - 2|X_0| d_3)/2g",
        "pupil_distance", scaling("pupil_distance", 1), "non_distortion_room", at=_zero,
    ),
    _form(
        "d_3 → f", "the exit pupil runs to infinity: L = d_1 - z_x is inf - inf", "its vergence 1/L",
        "pupil_distance", towards("pupil_distance", _f), "vergence_at_mla_per_mm", at=_f,
    ),
    _form(
        "d_f → f", "d_1 runs to infinity, 1/f - 1/d_f cancels",
        "d_1 = f d_f/(d_f - f) with the difference taken first",
        "focal_plane_distance", towards("focal_plane_distance", _f, above_only=True), "mla_distance", at=_f,
    ),
    _form(
        "d_1 → f", "d_f runs to infinity", "d_f = f d_1/(d_1 - f)",
        "mla_distance", towards("mla_distance", _f, above_only=True), "focal_plane_distance", at=_f,
    ),
    _form(
        "d_f → ∞", "d_1 - f cancels, m vanishes", "d_1 - f = f^2/(d_f - f)",
        "focal_plane_distance", scaling("focal_plane_distance", -1), "magnification", at=_infinity,
        gap_means="this d_f over the one at hand, inverse",
    ),
    _form(
        "D_F → 0", "the f-number grows without bound", "the angle D_F H/d_1",
        "pupil_diameter", scaling("pupil_diameter", 1), "pupil_angle", at=_zero, gap_means="D_F over the one at hand",
    ),
    _form(
        "d_2 → 0", "Fresnel number and views grow without bound", "the angle d/d_2, the width lambda d_2/d",
        "sensor_distance", scaling("sensor_distance", 1), "image_pitch_mm", at=_zero,
        gap_means="d_2 over the one at hand",
    ),
    _form(
        "images just touch", "image diameter less image pitch cancels",
        "one numerator of exact differences over g d_1",
        "pupil_diameter", towards("pupil_diameter", _touching), "mismatch_px", TOUCH, _touching,
    ),
    _form(
        "Z_F → focal plane", "Eq. 12: m - A/Z_F cancels", "m (Z_F - A/m)/Z_F with Z_F - g taken first",
        "depth", towards("depth", _gap), "epi_slope", SLOPES, _gap,
    ),
    _form(
        "Z → ∞", "lengths overflow, differences of inverse depths vanish", "inverse depth, homogeneous coordinates",
        "depth", scaling("depth", -1), "disparity_rate", at=_infinity, gap_means="depth at hand over this one",
    ),
    _form(
        "scale 1e-6 to 1e6", "squares of lengths leave the range, absolute thresholds misjudge",
        "products of ratios, no absolute threshold", "", rescaled, "centre_shift_px_per_microlens",
        tuple(name for name in sorted(ORACLES) if set(SCALED) & set(keywords(name))),
        gap_means="size over the camera at hand",
    ),
)  # fmt: skip
"""Closed forms."""
