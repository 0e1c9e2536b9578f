"""Faults of a design's bore: elements in each other, in stops, behind the focal plane."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from itertools import pairwise

from ..bore.fold import PartOutline, collisions, outlines_of
from ..errors import Problem
from ..lenses.glass import AIR
from .assembly import Assembly
from .check import shown, stop_beyond_focus


def about_shapes(design: Assembly) -> Iterator[Problem]:
    """Stops whose straight sides are not followed, behind a real main lens with elements, or wider than their tube."""
    followed = not design.elements or design.thin_twin is design
    for k, stop in enumerate(design.all_stops):
        place, across = f"stops.{k - 1}" if k else "aperture", 2 * float(stop.outline.reach)
        if stop.bore and math.isnan(across):
            yield Problem(f"{place}.diameter", "is missing; give it, or the [tube] whose own bore this rim is")
        elif stop.bore and design.tube is not None:
            room = design.tube.room(design.tip - stop.stands)
            if across > room * (1 + 1e-9):
                message = (
                    f"the tube's own bore is {shown(room)} wide by its outer_diameter and wall, and this rim "
                    f"{shown(across)}; make it no wider, or drop its bore = true"
                )
                yield Problem(f"{place}.bore", message)
        if stop.outline.straight and not followed:
            message = (
                f'"{stop.shape}" is followed behind a real main lens through air only, and elements.0 '
                f"({design.elements[0].kind}) stands before it; give a circle, an ideal lens, or drop the element"
            )
            yield Problem(f"{place}.shape", message)


def about_array(design: Assembly) -> Iterator[Problem]:
    """Pitch wider than the microlens array."""
    pitch, size = design.microlens_array.pitch, design.microlens_array.size
    if pitch > min(size) * (1 + 1e-9):
        held = f"leaves no whole microlens on the array, {' x '.join(map(shown, size))}"
        message = f"{shown(pitch)} {held}; check its unit: a hundredth of that, or less, is usual"
        yield Problem("microlens_array.pitch", message)


def about_stop_behind(design: Assembly) -> Iterator[Problem]:
    """Faults of a stop behind the main lens, of a design whose values fit otherwise."""
    behind = design.aperture.behind
    if behind is None:
        return
    if not design.main_lens.kind.images_stops:
        message = (
            f"{shown(behind)} is behind a real lens, and rays are aimed at stops before it; give distance (below 0 "
            "behind the lens) and diameter of the entrance pupil that its data sheet states, or drop the prescription"
        )
    elif behind >= design.d_1:
        message = (
            f"{shown(behind)} is not between the main lens and the microlens array at d_1 = {shown(design.d_1)}; move "
            "the stop closer to the lens"
        )
    elif design.elements and behind >= design.f:
        message = (
            f"{shown(behind)} is not within the focal length {shown(design.f)}: with elements in the bore the scene "
            "must see the stop behind the lens; move it closer, or drop the elements"
        )
    else:
        return
    yield Problem("aperture.behind", message)


def about_sheet(design: Assembly) -> Iterator[Problem]:
    """Tables of a sheet over the field, whose rays something before the main lens turns."""
    sheet, plane = design.main_lens.sheet, design.d_f
    tilted = [] if design.aperture.tilt == (0.0, 0.0) else ["aperture, tilted,"]
    met = [*(at.place for at in design.placed[1:]), *tilted]
    bending = [at.place for at in design.in_bore if at.part.bends]
    for key, places in (("distortion", met), ("relative_illumination", bending)):
        if sheet and key in sheet.over_field and places:
            message = f"is followed through air alone, and {places[0]} stands before the lens; drop one of them"
            yield Problem(f"main_lens.sheet.{key}", message)
    if plane <= design.main_lens.kind.front:
        yield Problem("main_lens.focal_plane", f"{shown(plane)} is behind the lens's front vertex; focus farther out")


def about_names(design: Assembly) -> Iterator[Problem]:
    """Names that two parts of the bore have, or that pages call something else by."""
    at = dict.fromkeys(
        ("main lens", "MLA", "sensor", "focal plane", "own cell", "neighbours"), "another line of tables"
    )
    at |= {cover.name: place for place, cover in design.covers.items()}
    for part in design.placed:
        if (other := at.setdefault(part.name, part.place)) != part.place:
            yield Problem(f"{part.place}.name", f'"{part.name}" is the name of {other}, too; give each its own')
        if re.match(r"(\d+|\*)(\.|$)", part.name):
            words = f'"{part.name}" would be taken for a number in places; put a word first, as "lens {part.name}"'
            yield Problem(f"{part.place}.name", words)


def about_elements(design: Assembly, known: Sequence[Problem]) -> tuple[Problem, ...]:
    """Faults of elements: overlap with each other, stops, the focal plane.

    `known` are faults that there are already.
    """
    spans = [(at.place, at.near, at.far) for at in design.in_bore]
    names = {at.place: at.name for at in design.in_bore}
    problems = list[Problem]()
    if not spans and design.object_space.medium != AIR:
        name = design.object_space.medium.name
        message = (
            f"nothing keeps {name} from the main lens; add the window that seals it off to [[elements]], or drop it"
        )
        problems.append(Problem("object_space.medium", message))
    ordered = sorted(spans, key=lambda span: span[1:])
    for (other, near, far), (place, start, _) in pairwise(ordered):
        if start < far:
            message = (
                f"{shown(start)} lies inside the element that reaches from {shown(near)} to {shown(far)}, {other} "
                f"({names[other]}); move one"
            )
            problems.append(Problem(f"{place}.distance", message))
    for stop in design.openings:
        for element, near, far in spans:
            if near < stop.near < far:
                span = f"{element} ({names[element]}), from {shown(near)} to {shown(far)}"
                problems.append(
                    Problem(f"{stop.place}.distance", f"{shown(stop.near)} lies inside {span}; move it out")
                )
    problems += [*([] if known else _about_reflection(design)), *_about_mapping(design)]
    farthest = max(range(len(spans)), key=lambda k: spans[k][1:], default=None)
    if farthest is not None and design.object_space.medium != AIR and not design.elements[farthest].sealable:
        message = (
            f"nothing keeps {design.object_space.medium.name} off {spans[farthest][0]} "
            f"({design.elements[farthest].kind}); add the window that seals it off before it"
        )
        problems.append(Problem("object_space.medium", message))
    problems += [] if problems or known else _about_folds(design)
    if problems or known:
        return tuple(problems)
    array = -design.d_1
    for place, room, glass in (
        ("microlens_array.distance", design.d_1, sum(at.part.thickness for at in design.plates if at.near >= array)),
        ("sensor.distance", design.d_2, sum(at.part.thickness for at in design.plates if at.near < array)),
    ):
        if glass > room * (1 + 1e-9):
            message = (
                f"{shown(room)} does not hold the {shown(glass)} of glass in it; lengthen it or take thinner glass"
            )
            problems.append(Problem(place, message))
    d_f, tip = design.d_f, max([far for *_, far in spans], default=0.0)
    if not tip <= d_f < math.inf:
        if design.main_lens.focal_plane is None and design.chain.past_infinity(design.bore_numbers, d_f):
            message = f"{shown(design.d_1)} focuses beyond infinity, where nothing is; focus nearer by making it longer"
            return (*problems, Problem("microlens_array.distance", message))
        message = f"{shown(d_f)} is not in front of the farthest element, which ends at {shown(tip)}; focus farther out"
        problems.append(Problem("main_lens.focal_plane", message))
    for stop in design.openings:
        if stop.near >= d_f:
            problems.append(stop_beyond_focus(f"{stop.place}.distance", stop.near, d_f))
    return tuple(problems)


def _about_reflection(design: Assembly) -> list[Problem]:
    """Glass that the axis itself does not get through: turned so far that it reflects it totally."""
    problems = []
    farthest = max((at.near for at in design.in_bore), default=0.0)
    for at in design.in_bore:
        beyond = design.object_space.medium if at.near == farthest else AIR
        fault = at.part.reflects(design.wavelength, float(beyond.index(design.wavelength)))
        if fault is not None:
            key, angle = fault
            message = (
                f"light along the axis is totally reflected in {at.name}, which it would leave at "
                f"{angle:.3g} degrees from the normal; take less wedge or tilt, or glass of a lower index"
            )
            problems.append(Problem(f"{at.place}.{key}", message))
    return problems


def _about_folds(design: Assembly) -> list[Problem]:
    """Parts that stand in each other where the axis is folded."""
    outlines = [
        PartOutline("sensor", -design.d_1 - design.d_2, -design.d_1, math.hypot(*design.sensor_size) / 2),
        PartOutline("main_lens", 0.0, 0.0, design.D / 2),
        *outlines_of(design.elements),
    ]
    message = "it stands in {}, as the axis is folded; move one of them, or take it smaller"
    return [Problem(place, message.format(other)) for place, other in collisions(outlines)]


def _about_mapping(design: Assembly) -> list[Problem]:
    """Faults of what stands before an objective with a mapping.

    Flat glass and the FAP may, other openings and lenses not.
    """
    problems = []
    for lens in design.in_bore:
        if not lens.part.mapping_name:
            continue
        for place, _, element, near, _ in design.in_bore:
            if near <= lens.near:
                continue
            if element.bends:
                message = (
                    f"only the foremost lens maps angles, and {place} ({element.kind}) stands before it; give "
                    "the mapping to that, or drop it"
                )
                problems.append(Problem(f"{lens.place}.mapping", message))
            elif element.diameter is not None:
                message = (
                    f"{shown(element.diameter)} would cut rays before the lens with a mapping, where its first order "
                    f"does not give their heights; drop it, or the mapping of {lens.place}"
                )
                problems.append(Problem(f"{place}.diameter", message))
        for stop in design.openings[1:]:
            if stop.near > lens.near:
                message = (
                    f"{shown(stop.near)} is before the lens with a mapping, where only the FAP may stand; move it "
                    f"behind, or drop the mapping of {lens.place}"
                )
                problems.append(Problem(f"{stop.place}.distance", message))
        if design.aperture.stands > lens.near and design.aperture.tilt != (0.0, 0.0):
            message = f"a FAP before the lens with a mapping cannot be tilted; drop it, or the mapping of {lens.place}"
            problems.append(Problem("aperture.tilt", message))
    return problems
