"""Hard cases of projection and fits: points at infinity, slopes near the focal plane, few or near depths."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from roslf_design.calibration.epilines import EpiLines, fit_lines
from roslf_design.calibration.fit import _step_two, _StepOne
from roslf_design.calibration.model import Intrinsics, Observations, Poses, project_boards
from roslf_design.design import Design
from roslf_design.theory.light_field import back_substitute

from .hard_cases import Budget, HardCase, Trial
from .hard_walks import (
    Rng,
    arguments_of,
    gaps,
    jittered,
)
from .oracles.closed_forms import ORACLES, microlens_of
from .oracles.judging import traced
from .oracles.textbook import TEXTBOOK

CAMERA = ("effective_image_distance", "magnification", "microlens_pitch", "pixel_pitch", "sensor_distance")
VIEWS = 9
"""Views in a row."""
FAR_PIXEL = 2000.0
"""Where a microlens image in the middle of a sensor has its pixels, counted from the corner."""
DEPTHS = 5


def _corner(
    X: float, Z_F: float, pixel: float, centre: float, A: float, m: float, d: float, q: float, d_2: float, u_0: float
) -> Any:
    """Microlens where `project_boards` has a corner that lies alone on its board."""
    camera = Intrinsics(A, m, 1 / d_2, u_0, 0.0, q=q, d=d).vector()
    pose, view = np.array([[0.0, 0.0, 0.0, X, 0.0, Z_F]]), np.array([[pixel - centre, 0.0]])
    return project_boards(camera, pose, np.zeros((1, 3)), view).values[0, 0, 0, 0]


def _corner_textbook(
    X: Any, Z_F: Any, pixel: Any, centre: Any, A: Any, m: Any, d: Any, q: Any, d_2: Any, u_0: Any
) -> Any:
    """Chief ray and Eq. 12, each divided by the depth."""
    return u_0 - (A * X / Z_F - (m - A / Z_F) * (q * A / d_2) * (pixel - centre)) / d


def far_points(design: Design, rng: Rng, count: int) -> Iterator[Trial]:
    """Points that run off along a direction, from 10 to 1e30 depths away."""
    base = arguments_of(design)
    for gap in gaps(rng, count, 1e-30):
        numbers = jittered(base, rng)
        A, m, d, q, d_2 = (numbers[key] for key in CAMERA)
        given = {
            "X": 0.3 * numbers["depth"] / gap, "Z_F": numbers["depth"] / gap, "pixel": 5 * float(rng.normal()),
            "centre": 0.0, "A": A, "m": m, "d": d, "q": q, "d_2": d_2, "u_0": 0.0,
        }  # fmt: skip
        yield Trial("project_boards", gap, given, _corner, microlens_of, _corner_textbook)


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


def flat_slopes(design: Design, rng: Rng, count: int) -> Iterator[Trial]:
    """Corners nearer and nearer to the focal plane, where slopes vanish; pixels counted from the sensor's corner."""
    for gap in gaps(rng, count, 1e-12):
        s = tuple(FAR_PIXEL + k + 1e-3 * float(rng.normal()) for k in range(VIEWS))
        u = tuple(137.0 + gap * (a - FAR_PIXEL) for a in s)
        yield Trial("fit_lines", gap, {"s": s, "u": u}, _line, traced(_line_textbook), _line_textbook)


def _two(depth: tuple[float, ...], slope: tuple[float, ...], A: float, q: float, d: float) -> Any:
    """M and 1/d_2 by `step_two`, of one corner on each board."""
    b = len(depth)
    pose = np.zeros((b, 6))
    pose[:, 5] = depth
    one = np.ones((b, 1))
    lines = EpiLines(np.zeros((b, 1, 2)), np.zeros((b, 1, 2)), np.array(slope)[:, None], one, np.ones((b, 1, 2)), 0.0)
    first = _StepOne(Intrinsics(A, 0.0, 0.0, 0.0, 0.0, q=q, d=d), Poses.from_vector(pose), 0.0)
    observations = Observations(np.zeros((1, 3)), np.zeros((1, 2)), np.zeros((b, 1, 1, 2)))
    camera = _step_two(observations, lines, first).camera
    return camera.m, camera.inverse_d_2


def _two_textbook(depth: Any, slope: Any, A: Any, q: Any, d: Any) -> Any:
    """The normal equations of slope = a + b/Z_F, not centred."""
    inverse = [1 / z for z in depth]
    b = _line_textbook(inverse, slope)
    a = (sum(slope) - b * sum(inverse)) / len(depth)
    return -A * a / b, -b * d / (q * A * A)


def near_depths(design: Design, rng: Rng, count: int) -> Iterator[Trial]:
    """Boards closer and closer together in depth."""
    base = arguments_of(design)
    for gap in gaps(rng, count, 1e-7):
        numbers = jittered(base, rng)
        A, m, d, q, d_2 = (numbers[key] for key in CAMERA)
        depth = tuple(numbers["depth"] * (1 + gap * (k - DEPTHS // 2) / DEPTHS) for k in range(DEPTHS))
        slope = tuple(q * A / (d * d_2) * (m - A / z) for z in depth)
        given = {"depth": depth, "slope": slope, "A": A, "q": q, "d": d}
        yield Trial("step_two", gap, given, _two, traced(_two_textbook), _two_textbook)


def _lengths(f: float, A: float, m: float) -> Any:
    camera = back_substitute(f, A, m)
    return camera.mla_distance, camera.focal_plane_distance, camera.pupil_distance, camera.inverse_aperture_constant


def _lengths_of(form: Callable[..., Any]) -> Callable[..., Any]:
    """The same four of d_1, d_f, H, d_3, 1/H."""

    def lengths(f: Any, A: Any, m: Any) -> Any:
        d_1, d_f, _, d_3, per_h = form(focal_length=f, effective_image_distance=A, magnification=m)
        return d_1, d_f, d_3, per_h

    return lengths


def far_focus(design: Design, rng: Rng, count: int) -> Iterator[Trial]:
    """Cameras focused farther and farther away, where A = f says less and less of d_3."""
    base = arguments_of(design)
    exact, naive = (_lengths_of(forms["back_substitute"]) for forms in (ORACLES, TEXTBOOK))
    for gap in gaps(rng, count):
        numbers = jittered(base, rng)
        f, m = numbers["focal_length"], numbers["magnification"] * gap
        given = {"f": f, "A": f + m * (f - numbers["pupil_distance"]), "m": m}
        yield Trial("back_substitute", gap, given, _lengths, exact, naive)


FITS = (
    HardCase(
        "points at infinity", "coordinates overflow", "slopes before coordinates", far_points, "project_boards",
        gap_means="inverse distance, in depths",
    ),
    HardCase(
        "slopes near the focal plane", "normal equations cancel: sums of squares of pixel numbers",
        "means taken out first", flat_slopes, "fit_lines",
        {"fit_lines": Budget(8, "a sum of nine products about means of nine; each mean is one more rounding")},
        "slope [pitches per pixel]",
    ),
    HardCase(
        "calibration from near depths", "columns 1 and 1/Z_F become collinear",
        "1/Z_F - 1/Z_0, its own condition stated", near_depths, "step_two",
        {"step_two": Budget(8, "two sums and a quotient, then m from three of them")},
        "spread of depths over their mean",
    ),
    HardCase(
        "calibration focused far away", "m vanishes and with it what A says of d_3",
        "d_3 = f + (f - A)/m; f = 0 or m = 0 refused", far_focus, "back_substitute",
        gap_means="m over the one at hand",
    ),
)  # fmt: skip
"""Projection and calibration."""
