"""Faults of a design's bore: elements in each other, in stops, behind the focal plane."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

from ..bore.elements import element_name
from ..errors import Problem
from ..lenses.glass import AIR
from .check import shown, stop_beyond_focus

if TYPE_CHECKING:
    from .design import Design


def about_elements(design: Design, known: Sequence[Problem]) -> tuple[Problem, ...]:
    """Faults of elements: overlap with each other, stops, the focal plane.

    `known` are faults that there are already.
    """
    spans = [(f"elements.{k}", e.distance, e.distance + e.length) for k, e in enumerate(design.elements)]
    problems = []
    if not spans and design.object_space.medium != AIR:
        name = design.object_space.medium.name
        message = (
            f"nothing keeps {name} from the main lens; add the window that seals it off to [[elements]], or drop it"
        )
        problems.append(Problem("object_space.medium", message))
    ordered = sorted(spans, key=lambda span: span[1:])
    for (_, near, far), (place, start, _) in pairwise(ordered):
        if start < far:
            message = (
                f"{shown(start)} lies inside the element that reaches from {shown(near)} to {shown(far)}; move one"
            )
            problems.append(Problem(f"{place}.distance", message))
    stops = {"aperture": design.aperture, **{f"stops.{k}": stop for k, stop in enumerate(design.stops)}}
    for place, stop in stops.items():
        for element, near, far in spans:
            if near < stop.distance < far:
                span = f"{element}, from {shown(near)} to {shown(far)}"
                problems.append(Problem(f"{place}.distance", f"{shown(stop.distance)} lies inside {span}; move it out"))
    problems += [*([] if known else _about_reflection(design)), *_about_mapping(design)]
    if problems or known:
        return tuple(problems)
    substrate, behind = design.microlens_array.substrate, design.sensor.cover
    plates = [0.0 if plate is None else plate.thickness for plate in (substrate, behind)]
    before = substrate is not None and substrate.lenslets == "sensor"
    for place, room, glass in (
        ("microlens_array.distance", design.d_1, plates[0] if before else 0.0),
        ("sensor.distance", design.d_2, plates[1] if before else sum(plates)),
    ):
        if glass > room * (1 + 1e-9):
            message = (
                f"{shown(room)} does not hold the {shown(glass)} of glass in it; lengthen it or take thinner glass"
            )
            problems.append(Problem(place, message))
    d_f, tip = design.d_f, max([far for *_, far in spans], default=0.0)
    if not tip <= d_f < math.inf:
        message = f"{shown(d_f)} is not in front of the farthest element, which ends at {shown(tip)}; focus farther out"
        problems.append(Problem("main_lens.focal_plane", message))
    for place, stop in stops.items():
        if stop.distance >= d_f:
            problems.append(stop_beyond_focus(f"{place}.distance", stop.distance, d_f))
    return tuple(problems)


def _about_reflection(design: Design) -> list[Problem]:
    """Glass that the axis itself does not get through: turned so far that it reflects it totally."""
    problems = []
    farthest = max((element.distance for element in design.elements), default=0.0)
    for number, element in enumerate(design.elements):
        beyond = design.object_space.medium if element.distance == farthest else AIR
        fault = element.reflects(design.wavelength, float(beyond.index(design.wavelength)))
        if fault is not None:
            key, angle = fault
            message = (
                f"light along the axis is totally reflected in {element_name(element, number + 1)}, which it would "
                f"leave at {angle:.3g} degrees from the normal; take less wedge or tilt, or glass of a lower index"
            )
            problems.append(Problem(f"elements.{number}.{key}", message))
    return problems


def _about_mapping(design: Design) -> list[Problem]:
    """Faults of what stands before an objective with a mapping.

    Flat glass and the FAP may, other openings and lenses not.
    """
    problems = []
    for number, lens in enumerate(design.elements):
        if lens.law is None:
            continue
        key = f"elements.{number}.mapping"
        for other, element in enumerate(design.elements):
            if element.distance <= lens.distance:
                continue
            if element.bends:
                message = (
                    f"only the foremost lens maps angles, and elements.{other} ({element.kind}) stands before it; "
                    "give the mapping to that, or drop it"
                )
                problems.append(Problem(key, message))
            elif element.diameter is not None:
                message = (
                    f"{shown(element.diameter)} would cut rays before the lens with a mapping, where its first order "
                    f"does not tell their heights; drop it, or the mapping of elements.{number}"
                )
                problems.append(Problem(f"elements.{other}.diameter", message))
        for other, stop in enumerate(design.stops):
            if stop.distance > lens.distance:
                message = (
                    f"{shown(stop.distance)} is before the lens with a mapping, where only the FAP may stand; move it "
                    f"behind, or drop the mapping of elements.{number}"
                )
                problems.append(Problem(f"stops.{other}.distance", message))
        if design.aperture.distance > lens.distance and design.aperture.tilt != (0.0, 0.0):
            message = (
                f"a FAP before the lens with a mapping cannot be tilted; drop it, or the mapping of elements.{number}"
            )
            problems.append(Problem("aperture.tilt", message))
    return problems
