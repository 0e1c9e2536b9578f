"""What parts of a design must be to each other; works on whatever parts could be read."""

from __future__ import annotations

from collections.abc import Mapping

from ..units import format_quantity
from .conjugates import CONJUGATES, conjugate_residual
from .errors import Problem

RESIDUAL_LIMIT = 1e-6
"""Largest |f/d_f + f/d_1 - 1| at which f, d_f and d_1 count as one set: rounding of printed digits, not an error."""


def cross_check(values: Mapping[str, float | None]) -> tuple[Problem, ...]:
    """Faults between values that are each right on their own.

    Parameters
    ----------
    values : mapping
        Dotted key to length [mm]: the three of `CONJUGATES` and every stop's ``distance``; None where a key is not
        given, absent where it could not be read.
    """
    problems = list(_conjugates(values))
    d_f = _focal_plane(values)
    if d_f is not None:
        for key, distance in values.items():
            if key.endswith(".distance") and key.startswith(("aperture", "stops")) and distance is not None:
                problems += _object_inside_bore(key, distance, d_f)
    return tuple(problems)


def _conjugates(values: Mapping[str, float | None]) -> list[Problem]:
    if any(key not in values for key in CONJUGATES):
        return []
    f, d_f, d_1 = (values[key] for key in CONJUGATES)
    missing = [key for key in CONJUGATES if values[key] is None]
    if len(missing) > 1:
        return [
            Problem(CONJUGATES[0], f"two of {', '.join(CONJUGATES)} are needed; give one of {' or '.join(missing)}")
        ]
    problems = []
    for key, distance in ((CONJUGATES[1], d_f), (CONJUGATES[2], d_1)):
        if f is not None and distance is not None and distance <= f:
            shown, focal = format_quantity(distance, "length"), format_quantity(_rounded(f), "length")
            problems.append(
                Problem(key, f"{shown} is not beyond the focal length {focal}, so no real image forms; make it longer")
            )
    if not problems and f is not None and d_f is not None and d_1 is not None:
        residual = float(conjugate_residual(f, d_f, d_1))
        if abs(residual) > RESIDUAL_LIMIT:
            problems.append(
                Problem(
                    CONJUGATES[2],
                    f"f, d_f and d_1 contradict each other: f/d_f + f/d_1 - 1 = {residual:.4g}, not 0; drop "
                    f"microlens_array.distance (it would become {format_quantity(_rounded(_image(f, d_f)), 'length')}) "
                    f"or main_lens.focal_plane (it would become {format_quantity(_rounded(_image(f, d_1)), 'length')})",
                )
            )
    return problems


def _image(f: float, distance: float) -> float:
    return f + f * f / (distance - f)


def _rounded(value: float) -> float:
    return float(f"{value:.8g}")


def _focal_plane(values: Mapping[str, float | None]) -> float | None:
    f, d_f, d_1 = (values.get(key) for key in CONJUGATES)
    if d_f is not None:
        return d_f
    return _image(f, d_1) if f is not None and d_1 is not None and d_1 > f else None


def _object_inside_bore(key: str, distance: float, d_f: float) -> list[Problem]:
    if distance < d_f:
        return []
    return [
        Problem(
            key,
            f"{format_quantity(distance, 'length')} is not less than the focal-plane distance d_f = "
            f"{format_quantity(_rounded(d_f), 'length')}: the object plane would lie inside the bore; "
            "move this stop closer to the lens or focus farther out",
        )
    ]
