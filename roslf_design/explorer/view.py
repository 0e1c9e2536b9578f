"""What the page's controls show of a state, as plain values for the browser."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from ..evaluation import Evaluation
from ..report.symbols import to_html
from .fields import CONJUGATE, FIELDS, STEPS, Field, position, reach, show
from .fixes import Fix
from .history import History
from .link import Look, encode
from .pictures.svg import short
from .places import place_on_mla
from .state import State, changeable, followers
from .verdicts import verdict_lights

_MARKUP = {
    "wavelength": "<i>λ</i>",
    **{
        field.symbol: f"<i>{field.symbol.split('_')[0]}</i><sub>{field.symbol.split('_')[1]}</sub>"
        if "_" in field.symbol
        else f"<i>{field.symbol}</i>"
        for field in FIELDS
        if field.symbol != "wavelength"
    },
}

_SPOKEN = {"wavelength": "lambda"}


def header(history: History) -> dict[str, Any]:
    """Name of the design, what went wrong with a file or link, and whether one can go back or forward."""
    state = history.present
    return {
        "title": state.design.name,
        "source": state.design.source,
        "message": state.message,
        "can_undo": bool(history.past),
        "can_redo": bool(history.future),
        "lens_name": "" if state.design.lens is None else (state.design.lens.name or "a real lens"),
    }


def controls(state: State) -> dict[str, Any]:
    """Every field with its slider, by part of the camera."""
    groups: dict[str, list[dict[str, Any]]] = {}
    for field in FIELDS:
        groups.setdefault(field.group, []).append(_control(field, state))
    return {"groups": [{"name": name, "fields": fields} for name, fields in groups.items()]}


def _control(field: Field, state: State) -> dict[str, Any]:
    value = float(getattr(state.design, field.symbol))
    ends = reach(field, state.reference, state.design)
    fault = state.fault(field.symbol)
    own = field.symbol == "f" and state.design.main_lens.prescription is not None
    return {
        "symbol": field.symbol,
        "markup": _MARKUP[field.symbol],
        "name": field.name,
        "spoken": f"{field.name}, {_SPOKEN.get(field.symbol, field.symbol.replace('_', ' '))}",
        "text": show(field, value) if fault is None else fault.text,
        "fault": "" if fault is None else fault.message,
        "position": position(field, value, ends),
        "steps": STEPS,
        "shown": show(field, value),
        "open": changeable(state, field.symbol),
        "follows": state.follows == field.symbol,
        "can_follow": field.symbol in CONJUGATE and field.symbol in followers(state.design),
        "why": "given by the lens" if own else "follows from the other two" if state.follows == field.symbol else "",
    }


_WORDS = {"good": "good", "limit": "at nature's limit", "fault": "fault"}


def verdicts(evaluation: Evaluation) -> list[dict[str, str]]:
    """The verdict lights, with a word for those who do not see their colour."""
    return [
        {
            **light._asdict(),
            "word": _WORDS[light.level],
            "text": to_html(light.text),
            "remedy": to_html(light.remedy),
            "plain": light.text,
        }
        for light in verdict_lights(evaluation)
    ]


def glance(evaluation: Evaluation) -> list[dict[str, str]]:
    """What one asks of a camera first, in numbers."""
    number, field, image = evaluation.f_number, evaluation.non_distortion, evaluation.microlens_image
    sampling, depth, light = evaluation.sampling, evaluation.depth, evaluation.diffraction
    rows = (
        ("aperture constant H", short(evaluation.aperture_constant)),
        ("f-number of microlens and pupil", f"{short(number.microlens)}, {short(number.pupil)}"),
        ("fill factor", short(number.fill_factor, 5)),
        ("object radius undistorted", f"{short(field.x0_max_mm)} mm"),
        ("object half width seen", f"{short(field.field_half_width_mm)} mm"),
        ("microlens image across", f"{short(image.diameter_px)} px"),
        (
            "views across: pixels, independent",
            f"{short(sampling.views_geometric, 3)}, {short(sampling.views_independent, 3)}",
        ),
        ("object sample", f"{short(sampling.object_sample_mm)} mm"),
        ("depth precision in focus", f"{short(depth.sigma_z_mm)} mm"),
        ("Airy radius of a microlens", f"{short(light.airy_radius_px, 3)} px"),
    )
    return [{"label": to_html(label), "value": value} for label, value in rows]


def proposed(fixes: Iterable[Fix]) -> list[dict[str, str]]:
    """What would mend the design, in words; its numbers stay on the server."""
    return [
        {"key": fix.key, "label": to_html(fix.label), "outcome": to_html(fix.outcome), "why_not": to_html(fix.why_not)}
        for fix in fixes
    ]


def looked_at(state: State, look: Look) -> dict[str, Any]:
    """What is looked at, and the link that brings all of it back."""
    x, y = place_on_mla(state.design, look.place)
    return {
        "tab": look.tab,
        "place": look.place if isinstance(look.place, str) else "chosen",
        "place_text": f"x {_mm(x)}, y {_mm(y)} mm",
        "diffraction": look.diffraction,
        "pixels": look.pixels,
        "whole": look.whole,
        "link": encode(state, look),
    }


def _mm(value: float) -> str:
    return "0" if abs(value) < 5e-4 else f"{value:.3f}".rstrip("0").rstrip(".") if math.isfinite(value) else "-"
