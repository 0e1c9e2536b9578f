"""Which numbers of a design a build can miss, what they measure, and their nominal values."""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping

from ..design import PATHS, Design
from ..design.units import parse_quantity

POSES = ("decentre.0", "decentre.1", "tilt.0", "tilt.1")
SHORT = {"relay": "sensor.relay_magnification", "rotation": "microlens_array.rotation"}
"""Short names beside the paper's symbols."""


def perturbable(design: Design) -> dict[str, str]:
    """Every place of a design that a build can miss.

    Returns
    -------
    dict
        Dotted place to what it measures: "length", "angle" or "ratio".
    """
    stops = ["aperture", *(f"stops.{index}" for index in range(len(design.stops)))]
    lengths = ["main_lens.diameter", "main_lens.focal_length", "main_lens.focal_plane"]
    lengths += [f"{stop}.{name}" for stop in stops for name in ("diameter", "distance")]
    lengths += [f"microlens_array.{name}" for name in ("pitch", "focal_length", "distance")]
    lengths += ["sensor.distance", "sensor.pixel", "light.wavelength"]
    kinds = dict.fromkeys(lengths, "length")
    for part in ("main_lens", *stops, "microlens_array", "sensor"):
        kinds |= {f"{part}.{pose}": "length" if pose.startswith("decentre") else "angle" for pose in POSES}
    kinds["microlens_array.rotation"] = "angle"
    kinds["sensor.relay_magnification"] = "ratio"
    return kinds


def expand(design: Design, name: str) -> tuple[str, ...]:
    """Places that a name in a study means.

    Parameters
    ----------
    design : Design
        Whose places.
    name : str
        A dotted place, a paper's symbol ("d_3"), a pair without its index ("aperture.decentre": x and y), or a pattern
        ("stops.*.diameter": every further stop).

    Raises
    ------
    ValueError
        Nothing is called that; the message names the nearest.
    """
    name = PATHS.get(name, SHORT.get(name, name))
    known = perturbable(design)
    if name.startswith("stops.*."):
        return tuple(
            place for index in range(len(design.stops)) for place in expand(design, name.replace("*", str(index)))
        )
    if name in known:
        return (name,)
    pair = tuple(place for place in known if place in (f"{name}.0", f"{name}.1"))
    if pair:
        return pair
    if name.startswith(("main_lens.surfaces.", "main_lens.elements.")):
        raise ValueError(
            f"'{name}' is a number of a lens's prescription; studies take a real main lens as its thin twin, so "
            "perturb main_lens.focal_length here, or give lens errors to roslf_design.lenses.manufacture"
        )
    names = [*known, *(place[:-2] for place in known if place.endswith(".0")), *PATHS, *SHORT]
    near = difflib.get_close_matches(name, names, 1, 0.4)
    remedy = (
        f"did you mean '{near[0]}'?"
        if near
        else f"known are {', '.join(PATHS)} and dotted places such as aperture.tilt"
    )
    raise ValueError(f"'{name}' is not a number of this design that a build can miss; {remedy}")


def nominal_values(design: Design) -> dict[str, float]:
    """The design's own number at every perturbable place; f, d_f and d_1 all resolved."""
    resolved = {
        "main_lens.focal_length": design.f,
        "main_lens.focal_plane": design.d_f,
        "microlens_array.distance": design.d_1,
    }
    return {place: resolved[place] if place in resolved else _read(design, place) for place in perturbable(design)}


def short_name(place: str) -> str:
    """What to call a place on a figure or in a table: "d_3", "FAP decentre x", "MLA rotation"."""
    symbols = {path: symbol for symbol, path in PATHS.items() if symbol not in ("q", "wavelength")}
    if place in symbols:
        return symbols[place]
    part, _, rest = place.partition(".")
    if part == "stops":
        index, _, rest = rest.partition(".")
        part = f"stop {int(index) + 1}"
    names = {"main_lens": "lens", "aperture": "FAP", "microlens_array": "MLA", "sensor": "sensor", "light": "light"}
    axis = {"0": "x", "1": "y"}
    words = [axis.get(word, word.replace("_", " ")) for word in rest.split(".")]
    return " ".join([names.get(part, part), *words]).replace("sensor relay magnification", "relay magnification")


def display(value: float, kind: str) -> str:
    """A deviation in the unit it reads best in, to three digits: "20 um", "0.05 mm", "3 mrad", "1.2 %"."""
    if not math.isfinite(value):
        return "any"
    if kind == "ratio":
        return f"{100 * value:.3g} %"
    if kind == "angle":
        return f"{1e3 * value:.3g} mrad"
    size = abs(value)
    if size and size < 1e-3:
        return f"{1e6 * value:.3g} nm"
    return f"{1e3 * value:.3g} um" if size < 0.1 else f"{value:.3g} mm"


def parse_tolerance(text: object, kind: str, nominal: float) -> float:
    """Half-width of a tolerance in the design's units.

    Parameters
    ----------
    text : object
        "0.05 mm", "3 mrad", or percent of the nominal value: "1 %". A ratio takes percent or a bare number.
    kind : {"length", "angle", "ratio"}
        What the place measures.
    nominal : float
        The design's value there.

    Raises
    ------
    ValueError
        Not readable, not finite, negative, or percent of a nominal zero.
    """
    if isinstance(text, str) and text.strip().endswith("%"):
        try:
            share = float(text.strip()[:-1])
        except ValueError:
            raise ValueError(f'cannot read "{text}"; write e.g. "1 %"') from None
        if nominal == 0:
            raise ValueError(f'"{text}" of a nominal value of zero is always zero; give an absolute tolerance')
        value = abs(nominal) * share / 100
    elif kind == "ratio":
        try:
            value = float(text)  # type: ignore[arg-type]
        except (TypeError, ValueError):
            raise ValueError(f'{text!r} is not a ratio; write e.g. "0.3 %" or 0.003') from None
    else:
        value = parse_quantity(text, kind)
    if not math.isfinite(value) or value < 0:
        raise ValueError(f'"{text}" must be a finite half-width that is not negative')
    return value


def _read(design: Design, place: str) -> float:
    value: object = design
    for step in place.split("."):
        value = value[int(step)] if isinstance(value, tuple) else getattr(value, step)
    assert isinstance(value, (int, float))
    return float(value)


def as_changes(values: Mapping[str, float], design: Design) -> dict[str, float]:
    """What `Design.replace` takes, without the places that keep their value."""
    nominal = nominal_values(design)
    return {place: value for place, value in values.items() if value != nominal[place]}
