"""Verdicts as lights: one word, one number, a colour; the sentence behind it on request."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from .pictures.svg import short

if TYPE_CHECKING:
    from ..evaluation.result import Evaluation

TITLES = {
    "f_number_matched": "f-number",
    "field_undistorted": "field",
    "views_resolved": "views",
    "thin_lens_holds": "thin lens",
}


class Light(NamedTuple):
    """One verdict."""

    name: str
    """As in the evaluation."""
    level: str
    """"good", "limit" or "fault"."""
    title: str
    """At most 14 letters."""
    margin: str
    """How far from the limit, at most 14 letters."""
    text: str
    """The whole answer."""
    remedy: str
    """What would mend it; "" where nothing needs mending."""


def verdict_lights(evaluation: Evaluation) -> tuple[Light, ...]:
    """The verdicts of an evaluation, each with its margin in few letters."""
    return tuple(
        Light(
            v.name, v.level, TITLES.get(v.name, v.name.replace("_", " ")), _margin(evaluation, v.name), v.text, v.remedy
        )
        for v in evaluation.verdicts
    )


def _margin(evaluation: Evaluation, name: str) -> str:
    if name == "f_number_matched":
        return f"{_signed(evaluation.f_number.mismatch_px)} px"
    if name == "field_undistorted" and evaluation.real_lens is not None:
        return f"to {short(evaluation.real_lens.x_ml_max_mm, 2)} mm"
    if name == "field_undistorted":
        return f"{_signed(evaluation.non_distortion.room_at_corner_mm)} mm"
    if name == "views_resolved":
        sampling = evaluation.sampling
        return f"{short(sampling.views_independent, 2)} of {short(sampling.views_geometric, 2)}"
    lens = evaluation.real_lens
    if lens is None:
        return ""
    shifts = [math.hypot(*field.shift_px) for field in lens.fields if field.shift_px is not None]
    return f"{short(max(shifts), 2)} px" if shifts else "no image"


def _signed(value: float) -> str:
    return f"{'+' if value > 0 else ''}{short(value, 2)}"
