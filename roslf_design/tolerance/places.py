"""Which numbers of a design a build can miss, what they measure, and their nominal values.

Behind a real main lens they are those of its drawing, as `lenses.manufacture` names them, after ``main_lens.``; its
focal length then follows.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping
from functools import lru_cache

from ..design import PATHS, Design
from ..design.units import parse_quantity

POSES = ("decentre.0", "decentre.1", "tilt.0", "tilt.1")
SHORT = {"relay": "sensor.relay_magnification", "rotation": "microlens_array.rotation"}
"""Short names beside the paper's symbols."""
LENS = "main_lens."
"""What places in a real main lens begin with."""
FOCAL_LENGTH = "main_lens.focal_length"
BARE = {"ratio": '"0.3 %" or 0.003', "number": '0.0005 or "0.1 %"', "curvature": '"1e-5 /mm" or "0.1 %"'}
"""Kinds whose tolerances are not lengths or angles, and how they are written."""


def perturbable(design: Design) -> dict[str, str]:
    """Every place of a design that a build can miss.

    Returns
    -------
    dict
        Dotted place to what it measures: "length", "angle", "ratio"; in a real lens also "curvature" or "number".
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
    if design.lens is not None:
        from ..lenses.manufacture import lens_places

        del kinds[FOCAL_LENGTH]
        kinds |= {LENS + place: kind for place, kind in lens_places(design.lens).items()}
    return kinds


def in_lens(place: str) -> bool:
    """Whether a place is of a real lens's surfaces or elements."""
    return place.startswith((f"{LENS}surfaces.", f"{LENS}elements."))


def expand(design: Design, name: str) -> tuple[str, ...]:
    """Places that a name in a study means.

    Parameters
    ----------
    design : Design
        Whose places.
    name : str
        A dotted place, a paper's symbol ("d_3"), a pair without its index ("aperture.decentre": x and y), or a pattern
        ("stops.*.diameter": every further stop; "main_lens.surfaces.*.radius": every surface that has one).

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
    if "*" in name and in_lens(name):
        return _of_lens(design, name, known)
    if name in known:
        return (name,)
    pair = tuple(place for place in known if place in (f"{name}.0", f"{name}.1"))
    if pair:
        return pair
    if name == FOCAL_LENGTH:
        raise ValueError(
            "'main_lens.focal_length' follows from the real lens's surfaces; perturb main_lens.surfaces.*.radius, "
            ".thickness and .index instead"
        )
    if in_lens(name) and design.lens is None:
        raise ValueError(f"'{name}' is of a real lens and this design's is ideal; perturb main_lens.focal_length")
    names = [*known, *(place[:-2] for place in known if place.endswith(".0")), *PATHS, *SHORT]
    near = difflib.get_close_matches(name, names, 1, 0.4)
    remedy = (
        f"did you mean '{near[0]}'?"
        if near
        else f"known are {', '.join(PATHS)} and dotted places such as aperture.tilt"
    )
    raise ValueError(f"'{name}' is not a number of this design that a build can miss; {remedy}")


def _of_lens(design: Design, name: str, known: Mapping[str, str]) -> tuple[str, ...]:
    """Places that a pattern in a real lens means; none behind an ideal one."""
    head, tail = name.split("*", 1)
    found = tuple(
        place
        for place in known
        if place.startswith(head)
        and place[len(head) :].partition(".")[2] in (f"{tail[1:]}{end}" for end in ("", ".0", ".1"))
    )
    what = tail[1:]
    if not found and design.lens is not None and what not in ("radius", "conic", "abbe", "wedge"):
        parts = sorted(
            {place.split(".", 3)[3].removesuffix(".0").removesuffix(".1") for place in known if in_lens(place)}
        )
        raise ValueError(f"'{name}' is nothing that a lens's making can miss; there are {', '.join(parts)}")
    return found


def nominal_values(design: Design) -> dict[str, float]:
    """The design's own number at every perturbable place; f, d_f and d_1 all resolved."""
    return dict(_nominal_values(design))


@lru_cache(maxsize=64)
def _nominal_values(design: Design) -> Mapping[str, float]:
    resolved = {
        FOCAL_LENGTH: design.f,
        "main_lens.focal_plane": design.d_f,
        "microlens_array.distance": design.d_1,
        "main_lens.diameter": design.D,
    }
    if design.lens is not None:
        from ..lenses.manufacture import lens_values

        resolved |= {LENS + place: value for place, value in lens_values(design.lens, design.wavelength).items()}
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
    if in_lens(place):
        part, index, rest = rest.split(".", 2)
        part = f"{part.removesuffix('s')} {index}"
    names = {"main_lens": "lens", "aperture": "FAP", "microlens_array": "MLA", "sensor": "sensor", "light": "light"}
    axis = {"0": "x", "1": "y"}
    words = [axis.get(word, word.replace("_", " ")) for word in rest.split(".")]
    return " ".join([names.get(part, part), *words]).replace("sensor relay magnification", "relay magnification")


def display(value: float, kind: str) -> str:
    """A deviation in the unit it reads best in, to three digits: "20 um", "0.05 mm", "3 mrad", "1.2 %", "0.0005"."""
    if not math.isfinite(value):
        return "any"
    if kind == "number":
        return f"{value:.3g}"
    if kind == "curvature":
        return f"{value:.3g} /mm"
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
        "0.05 mm", "3 mrad", or percent of the nominal value: "1 %". A ratio or a number takes percent or a bare number,
        a curvature "1e-5 /mm".
    kind : {"length", "angle", "ratio", "number", "curvature"}
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
    elif kind in BARE:
        bare = text.strip().removesuffix("/mm").strip() if kind == "curvature" and isinstance(text, str) else text
        try:
            value = float(bare)  # type: ignore[arg-type]
        except (TypeError, ValueError):
            raise ValueError(f"{text!r} is not a {kind}; write e.g. {BARE[kind]}") from None
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
