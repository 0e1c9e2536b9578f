"""Hard cases of projection and of fits: points at infinity, slopes near the focal plane, few or near depths."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from .. import theory
from ..calibration.model import Intrinsics, Observations, Poses
from ..calibration.steps import EpiLines, StepOne, fit_lines, step_two
from ..design import Design
from .cases import Budget, HardCase, Trial
from .walks import arguments_of, gaps, jittered

CAMERA = ("effective_image_distance", "magnification", "microlens_pitch", "pixel_pitch", "sensor_distance")
VIEWS = 9
"""Views in a row."""
FAR_PIXEL = 2000.0
"""Where a microlens image in the middle of a sensor has its pixels, counted from the corner."""
DEPTHS = 5


# --- projection -------------------------------------------------------------------------------------------------------


def _seen(X: float, Z_F: float, S: float, A: float, m: float, d: float, q: float, d_2: float) -> Any:
    matrix = theory.view_projection((S, 0.0), A, m, d, q, d_2)
    return theory.from_homogeneous(theory.project(matrix, (X, 0.0, Z_F, 1.0)))[0]


def _seen_textbook(X: Any, Z_F: Any, S: Any, A: Any, m: Any, d: Any, q: Any, d_2: Any) -> Any:
    """Chief ray and Eq. 12, each divided by the depth."""
    pupil = -(q * A / d_2) * S
    return (-A * X / Z_F - (m - A / Z_F) * pupil) / d


def _back(X: float, Z_F: float, A: float, m: float, d: float, q: float, d_2: float) -> Any:
    """Depth of a point from its central-view microlens and its slope."""
    slope = theory.calibrated_epi_slope(Z_F, A, m, d, q, d_2)
    return theory.inverse_depth_from_epi_slope(slope, A, m, d, q, d_2)


def far_points(design: Design, rng: np.random.Generator, count: int) -> Iterator[Trial]:
    """Points that run off along a direction, from 10 to 1e30 depths away."""
    base = arguments_of(design)
    for gap in gaps(rng, count, 1e-30):
        numbers = jittered(base, rng)
        A, m, d, q, d_2 = (numbers[key] for key in CAMERA)
        given = {
            "X": 0.3 * numbers["depth"] / gap, "Z_F": numbers["depth"] / gap, "S": 5 * float(rng.normal()),
            "A": A, "m": m, "d": d, "q": q, "d_2": d_2,
        }  # fmt: skip
        yield Trial("view_projection", gap, given, _seen, _seen_textbook, _seen_textbook)


# --- epipolar lines ---------------------------------------------------------------------------------------------------


def _line(s: tuple[float, ...], u: tuple[float, ...]) -> Any:
    """Slope by `fit_lines`, of a corner seen in a row of views."""
    views = np.stack([np.array(s), np.zeros(len(s))], -1)
    uv = np.stack([np.array(u), np.zeros(len(u))], -1)[None, :, None, :]
    return fit_lines(Observations(np.zeros((1, 3)), views, uv)).slope[0, 0]


def _line_textbook(s: Any, u: Any) -> Any:
    """Slope by the normal equations."""
    n = len(s)
    sums = sum(s), sum(u), sum(a * b for a, b in zip(s, u, strict=True)), sum(a * a for a in s)
    return (n * sums[2] - sums[0] * sums[1]) / (n * sums[3] - sums[0] ** 2)


def flat_slopes(design: Design, rng: np.random.Generator, count: int) -> Iterator[Trial]:
    """Corners nearer and nearer to the focal plane, where slopes vanish; pixels counted from the sensor's corner."""
    for gap in gaps(rng, count, 1e-12):
        s = tuple(FAR_PIXEL + k + 1e-3 * float(rng.normal()) for k in range(VIEWS))
        u = tuple(137.0 + gap * (a - FAR_PIXEL) for a in s)
        yield Trial("fit_lines", gap, {"s": s, "u": u}, _line, _line_textbook, _line_textbook)


# --- calibration from depths that lie close together ------------------------------------------------------------------


def _two(depth: tuple[float, ...], slope: tuple[float, ...], A: float, q: float, d: float) -> Any:
    """M and 1/d_2 by `step_two`, of one corner on each board."""
    b = len(depth)
    pose = np.zeros((b, 6))
    pose[:, 5] = depth
    one = np.ones((b, 1))
    lines = EpiLines(np.zeros((b, 1, 2)), np.zeros((b, 1, 2)), np.array(slope)[:, None], one, one, 0.0)
    first = StepOne(Intrinsics(A, 0.0, 0.0, 0.0, 0.0, q=q, d=d), Poses.from_vector(pose), 0.0)
    observations = Observations(np.zeros((1, 3)), np.zeros((1, 2)), np.zeros((b, 1, 1, 2)))
    camera = step_two(observations, lines, first).camera
    return camera.m, camera.inverse_d_2


def _two_textbook(depth: Any, slope: Any, A: Any, q: Any, d: Any) -> Any:
    """The normal equations of slope = a + b/Z_F, not centred."""
    inverse = [1 / z for z in depth]
    b = _line_textbook(inverse, slope)
    a = (sum(slope) - b * sum(inverse)) / len(depth)
    return -A * a / b, -b * d / (q * A * A)


def near_depths(design: Design, rng: np.random.Generator, count: int) -> Iterator[Trial]:
    """Boards closer and closer together in depth."""
    base = arguments_of(design)
    for gap in gaps(rng, count, 1e-7):
        numbers = jittered(base, rng)
        A, m, d, q, d_2 = (numbers[key] for key in CAMERA)
        middle = numbers["depth"]
        depth = tuple(middle * (1 + gap * (k - DEPTHS // 2) / DEPTHS) for k in range(DEPTHS))
        slope = tuple(q * A / (d * d_2) * (m - A / z) for z in depth)
        given = {"depth": depth, "slope": slope, "A": A, "q": q, "d": d}
        yield Trial("step_two", gap, given, _two, _two_textbook, _two_textbook)


# --- back-substitution ------------------------------------------------------------------------------------------------


def _lengths(f: float, A: float, m: float) -> Any:
    found = theory.back_substitute(f, A, m)
    return found.mla_distance, found.focal_plane_distance, found.pupil_distance, found.inverse_aperture_constant


def _lengths_textbook(f: Any, A: Any, m: Any) -> Any:
    """By way of H: d_3 = d_f - d_f/H."""
    d_1 = f * (1 + m)
    d_f = d_1 / m
    return d_1, d_f, d_f - d_f / (d_1 / A), A / d_1


def far_focus(design: Design, rng: np.random.Generator, count: int) -> Iterator[Trial]:
    """Cameras focused farther and farther away, where A = f says less and less of d_3."""
    base = arguments_of(design)
    for gap in gaps(rng, count):
        numbers = jittered(base, rng)
        f, m = numbers["focal_length"], numbers["magnification"] * gap
        given = {"f": f, "A": f + m * (f - numbers["pupil_distance"]), "m": m}
        yield Trial("back_substitute", gap, given, _lengths, _lengths_textbook, _lengths_textbook)


FITS = (
    HardCase(
        "points at infinity",
        "coordinates overflow",
        "homogeneous coordinates",
        far_points,
        {},
        "view_projection",
        "inverse distance, in depths",
    ),
    HardCase(
        "slopes near the focal plane",
        "normal equations cancel: sums of squares of pixel numbers",
        "means taken out first",
        flat_slopes,
        {"fit_lines": Budget(8, "a sum of nine products about means of nine; each mean is one more rounding")},
        "fit_lines",
        "slope [pitches per pixel]",
    ),
    HardCase(
        "calibration from near depths",
        "columns 1 and 1/Z_F become collinear",
        "1/Z_F - 1/Z_0, its own condition told",
        near_depths,
        {"step_two": Budget(8, "two sums and a quotient, then m from three of them")},
        "step_two",
        "spread of depths over their mean",
    ),
    HardCase(
        "calibration focused far away",
        "m vanishes and with it what A says of d_3",
        "d_3 = f + (f - A)/m; f = 0 or m = 0 refused",
        far_focus,
        {},
        "back_substitute",
        "m over the one at hand",
    ),
)
"""Rows about projection and calibration."""
