"""What a design is made of, part by part, and which parts of the catalogue are the same or come nearest."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeVar

from ..optimization.parts import ArrayPart, Catalogue, Entry, LensPart, SensorPart, load_catalogue
from ..words import length
from .blocks import Bullets, Section, Table

if TYPE_CHECKING:
    from ..design import Design

ALIKE = 0.01
"""Relative difference up to which a length of a part counts as the design's."""
FAR = math.log(2)
"""Sum of logarithms of ratios beyond which a part is not worth naming."""

Part = TypeVar("Part", bound=Entry)
Lengths = tuple[tuple[str, float, float], ...]
"""Name, the part's, the design's [mm]."""


def parts_section(design: Design, catalogue: Catalogue | None = None) -> Section:
    """The parts list; without a catalogue, with the shipped one."""
    known = load_catalogue() if catalogue is None else catalogue
    lens, array, sensor = lens_match(design, known), array_match(design, known), sensor_match(design, known)
    mla, (across, up) = design.microlens_array, design.pixels
    size = " x ".join(length(side) for side in mla.size)
    microlenses = f"{mla.layout}, {mla.lens_shape} lenses, pitch {length(mla.pitch)}, f_ml {length(mla.focal_length)}"
    rows = [
        ("main lens", _lens(design), lens[0]),
        ("FAP, front stop", f"opening {length(design.D_F)}", "made to drawing"),
        *(
            (f"stop {k}", f"opening {length(stop.diameter)}", "made to drawing")
            for k, stop in enumerate(design.stops, 1)
        ),
        ("microlens array", f"{microlenses}, {size}", array[0]),
        ("image sensor", f"pixel {length(design.sensor.pixel)}, {across} x {up} px", sensor[0]),
    ]
    if design.sensor.relay_magnification != 1:
        relay = f"magnification {design.sensor.relay_magnification:g}"
        rows.append(("relay to the sensor", relay, "not in the catalogue"))
    caption = (
        f"Catalogue: a part is the same where its lengths agree to {100 * ALIKE:g} % and it is large enough; else the "
        "nearest is named with what differs. Walls, window, mounts and light source are not part of the model."
    )
    table = Table(
        tuple((str(place), *row) for place, row in enumerate(rows, 1)),
        "rlll",
        ("", "part", "what it must be", "catalogue"),
        caption=caption,
        widths=(1.5, 9.5, 0, 0),
    )
    notes = tuple(_provenance(entry) for _, entry in (lens, array, sensor) if entry is not None)
    return Section("Parts list", (table, Bullets(notes)) if notes else (table,))


def lens_match(design: Design, catalogue: Catalogue) -> tuple[str, LensPart | None]:
    """What to say of the main lens, and the catalogue's part where it is the same or near."""
    if design.lens is not None:
        return f"{design.lens.name}, as prescribed", None

    def lengths(part: LensPart) -> Lengths:
        return ("focal length", part.focal_length, design.f), ("clear aperture", part.aperture, design.D)

    return _match(catalogue.lenses, lengths)


def array_match(design: Design, catalogue: Catalogue) -> tuple[str, ArrayPart | None]:
    """The same of the microlens array."""
    mla = design.microlens_array

    def lengths(part: ArrayPart) -> Lengths:
        return ("pitch", part.pitch, mla.pitch), ("focal length", part.focal, mla.focal_length)

    def lacks(part: ArrayPart) -> list[str]:
        needed = [min(a, b) for a, b in zip(mla.size, design.sensor_size, strict=True)]
        small = any(have < need * (1 - ALIKE) for have, need in zip(part.size, needed, strict=True))
        same = (part.layout, part.lens_shape) == (mla.layout, mla.lens_shape)
        kind = [] if same else [f"{part.layout}, {part.lens_shape} lenses"]
        return [*kind, f"only {' x '.join(length(side) for side in part.size)}"] if small else kind

    return _match(catalogue.microlens_arrays, lengths, lacks)


def sensor_match(design: Design, catalogue: Catalogue) -> tuple[str, SensorPart | None]:
    """The same of the sensor; a larger one, read out in part, is the same."""
    needed = design.pixels

    def lengths(part: SensorPart) -> Lengths:
        return (("pixel", part.pixel, design.sensor.pixel),)

    def lacks(part: SensorPart) -> list[str]:
        small = any(have < need for have, need in zip(part.pixels, needed, strict=True))
        return [f"only {part.pixels[0]} x {part.pixels[1]} px"] if small else []

    def short(part: SensorPart) -> float:
        return sum(max(0.0, math.log(need / have)) for have, need in zip(part.pixels, needed, strict=True))

    return _match(catalogue.sensors, lengths, lacks, short)


def _match(
    parts: Sequence[Part],
    lengths: Callable[[Part], Lengths],
    lacks: Callable[[Part], list[str]] = lambda _: [],
    short: Callable[[Part], float] = lambda _: 0.0,
) -> tuple[str, Part | None]:
    """The part whose lengths agree and that lacks nothing, else the one whose ratios to what is wanted are least."""
    if not parts:
        return "the catalogue has none", None

    def differs(part: Part) -> list[str]:
        unlike = [f"{name} {length(have)}" for name, have, wanted in lengths(part) if abs(have / wanted - 1) > ALIKE]
        return [*unlike, *lacks(part)]

    def apart(part: Part) -> float:
        return sum(abs(math.log(have / wanted)) for _, have, wanted in lengths(part)) + short(part)

    same = [part for part in parts if not differs(part)]
    best = min(same or parts, key=apart)
    if same:
        return f"the same as {_name(best)}", best
    if apart(best) > FAR:
        return "to be made; the catalogue has nothing near", None
    return f"to be made; nearest is {_name(best)}: {', '.join(differs(best))}", best


def _lens(design: Design) -> str:
    if design.lens is not None:
        return f"{design.lens.name}, clear aperture {length(design.D)}"
    return f"focal length {length(design.f)}, clear aperture {length(design.D)}, ideal in this report"


def _name(entry: Entry) -> str:
    return f"{entry.maker} {entry.part}".strip()


def _provenance(entry: Entry) -> str:
    remark = f" {entry.remark[:1].upper()}{entry.remark[1:].rstrip('.')}." if entry.remark else ""
    return f"{_name(entry)}: {entry.provenance} ({entry.confidence}).{remark}"
