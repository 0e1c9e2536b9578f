"""Parts list of a design, and which parts of the catalogue are the same or come nearest."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ...bore.elements import element_name, made_of
from ...bore.plate import Plate
from ...optimization.parts import ArrayPart, Catalogue, Entry, Kind, LensPart, SensorPart, WindowPart, load_catalogue
from ...words import length
from ..blocks import Bullets, Section, Table

if TYPE_CHECKING:
    from ...bore.elements import AnyElement
    from ...design import Design

ALIKE = 0.01
"""Relative difference up to which a length of a part counts as the design's."""
ANOTHER = math.log(1.2)
"""Penalty for another material, as logarithm of a ratio."""
FAR = math.log(2)
"""Sum of logarithms of ratios beyond which a part is not worth naming."""


def parts_section(design: Design) -> Section:
    """The parts list, beside the shipped catalogue."""
    known = load_catalogue()
    kinds: tuple[Kind, ...] = ("lenses", "microlens_arrays", "sensors")
    (lens, array, sensor), entries = zip(*(catalogue_match(design, known, kind) for kind in kinds), strict=True)
    mla, (across, up) = design.microlens_array, design.pixels
    aperture = f"clear aperture {length(design.D)}"
    ideal = f"focal length {length(design.f)}, {aperture}, ideal in this report"
    microlenses = f"{mla.layout}, {mla.lens_shape} lenses, pitch {length(mla.pitch)}, f_ml {length(mla.focal_length)}"
    rows = [
        ("main lens", ideal if design.lens is None else f"{design.lens.name}, {aperture}", lens),
        ("FAP, front stop", f"opening {length(design.D_F)}", "made to drawing"),
    ]
    rows += [
        (f"stop {k}", f"opening {length(stop.diameter)}", "made to drawing") for k, stop in enumerate(design.stops, 1)
    ]
    for k, element in enumerate(design.elements, 1):
        bought, entry = element.bought or OWN, None
        if element.kind == "plate":
            bought, entry = catalogue_match(design, known, "windows", element)
        entries = (*entries, *([entry] if entry is not None and entry not in entries else []))
        rows.append((_part_name(element, k), ", ".join(made_of(element)), bought))
    for name, plate in (("cover glass of the sensor", design.sensor.cover), ("MLA substrate", mla.substrate)):
        if plate is not None:
            rows.append((name, f"{length(plate.thickness)} of {plate.material.name}", "comes with its part"))
    filters = "" if design.sensor.colours == "mono" else f", colour filters {design.sensor.colours}"
    rows += [
        ("microlens array", f"{microlenses}, {' x '.join(map(length, mla.size))}", array),
        ("image sensor", f"pixel {length(design.sensor.pixel)}, {across} x {up} px{filters}", sensor),
    ]
    if design.sensor.relay_magnification != 1:
        relay = f"magnification {design.sensor.relay_magnification:g}"
        rows.append(("relay to the sensor", relay, "not in the catalogue"))
    caption = (
        f"Catalogue: a part is the same where its lengths agree to {100 * ALIKE:g} % and it is large enough; else the "
        "nearest is named with what differs. Walls, mounts and light source are not part of the model."
    )
    table = Table(
        tuple((str(place), *row) for place, row in enumerate(rows, 1)),
        "rlll",
        ("", "part", "what it must be", "catalogue"),
        caption=caption,
        widths=(1.5, 9.5, 0, 0),
    )
    notes = tuple(_provenance(entry) for entry in entries if entry is not None)
    return Section("Parts list", (table, Bullets(notes)) if notes else (table,))


OWN = "to be made or bought"
"""Remark on an element that the catalogue has no kind for."""


def _part_name(element: AnyElement, number: int) -> str:
    return f"{element.trade_name or element.kind} ({element_name(element, number)})"


def catalogue_match(
    design: Design, catalogue: Catalogue, kind: Kind, window: Plate | None = None
) -> tuple[str, Entry | None]:
    """Remark on a part of the design (of windows, on one), and the catalogue's where it is the same or near.

    The same is one whose lengths agree and that lacks nothing; the nearest has the ratios to what is wanted least.
    """
    if kind == "lenses" and design.lens is not None:
        return f"{design.lens.name}, as prescribed", None
    unlike = {part.part: _unlike(design, part, window) for part in catalogue.of(kind)}
    same = [part for part in catalogue.of(kind) if not unlike[part.part][0]]
    best = min(same or catalogue.of(kind), key=lambda part: unlike[part.part][1], default=None)
    if best is None:
        return "the catalogue has none", None
    words, apart = unlike[best.part]
    if same:
        return f"the same as {_name(best)}", best
    if apart > FAR:
        return "to be made; the catalogue has nothing near", None
    return f"to be made; nearest is {_name(best)}: {', '.join(words)}", best


def _unlike(design: Design, part: Entry, window: Plate | None) -> tuple[list[str], float]:
    """Differences of a catalogue part from the design's, and their size: a sum of logarithms of ratios."""
    lengths: tuple[tuple[str, float, float], ...] = ()  # name, the part's, the design's
    lacks: list[str] = []
    short = 0.0
    match part:
        case LensPart():
            lengths = ("focal length", part.focal_length, design.f), ("clear aperture", part.aperture, design.D)
        case ArrayPart():
            mla = design.microlens_array
            lengths = ("pitch", part.pitch, mla.pitch), ("focal length", part.focal, mla.focal_length)
            if (part.layout, part.lens_shape) != (mla.layout, mla.lens_shape):
                lacks.append(f"{part.layout}, {part.lens_shape} lenses")
            needed = [min(pair) for pair in zip(mla.size, design.sensor_size, strict=True)]
            if any(have < need * (1 - ALIKE) for have, need in zip(part.size, needed, strict=True)):
                lacks.append(f"only {' x '.join(map(length, part.size))}")
        case SensorPart():  # a larger one, read out in part, is the same
            lengths = (("pixel", part.pixel, design.sensor.pixel),)
            short = sum(max(0.0, math.log(n / have)) for have, n in zip(part.pixels, design.pixels, strict=True))
            if short:
                lacks.append(f"only {part.pixels[0]} x {part.pixels[1]} px")
            if part.colours not in (None, design.sensor.colours):
                lacks.append("monochrome" if part.colours == "mono" else f"colour filters {part.colours}")
        case WindowPart():
            assert window is not None
            lengths = (("thickness", part.thickness, window.thickness),)
            if window.diameter is not None:
                lengths += (("clear aperture", part.aperture, window.diameter),)
            if part.material.name != window.material.name:
                lacks.append(f"of {part.material.name}")
                short = ANOTHER
    words = [f"{name} {length(have)}" for name, have, wanted in lengths if abs(have / wanted - 1) > ALIKE]
    return [*words, *lacks], short + sum(abs(math.log(have / wanted)) for _, have, wanted in lengths)


def _name(entry: Entry) -> str:
    return f"{entry.maker} {entry.part}".strip()


def _provenance(entry: Entry) -> str:
    remark = f" {entry.remark[:1].upper()}{entry.remark[1:].rstrip('.')}." if entry.remark else ""
    return f"{_name(entry)}: {entry.provenance} ({entry.confidence}).{remark}"
