"""What a design is made of, part by part, and which parts of the catalogue are the same or come nearest."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeVar

from ..optimize.parts import ArrayPart, Catalogue, Entry, LensPart, SensorPart, load_catalogue
from .blocks import Bullets, Section, Table

if TYPE_CHECKING:
    from ..design import Design

ALIKE = 0.01
"""Relative difference up to which a length of a part counts as the design's."""
FAR = math.log(2)
"""Sum of logarithms of ratios beyond which a part is not worth naming."""

Part = TypeVar("Part", bound=Entry)


def parts_section(design: Design, catalogue: Catalogue | None = None) -> Section:
    """The parts list.

    Parameters
    ----------
    design : Design
    catalogue : Catalogue, optional
        The shipped one where not given.
    """
    known = load_catalogue() if catalogue is None else catalogue
    lens, array, sensor = lens_match(design, known), array_match(design, known), sensor_match(design, known)
    mla, (across, up) = design.microlens_array, design.pixels
    rows = [
        ("1", "main lens", _lens(design), lens[0]),
        ("2", "FAP, front stop", f"opening {length(design.D_F)}", "made to drawing"),
        *(
            (str(k + 3), f"stop {k + 1}", f"opening {length(stop.diameter)}", "made to drawing")
            for k, stop in enumerate(design.stops)
        ),
    ]
    number = len(rows) + 1
    size = " x ".join(length(side) for side in mla.size)
    rows += [
        (
            str(number),
            "microlens array",
            f"{mla.layout}, {mla.lens_shape} lenses, pitch {length(mla.pitch)}, f_ml {length(mla.focal_length)}, "
            f"{size}",
            array[0],
        ),
        (str(number + 1), "image sensor", f"pixel {length(design.sensor.pixel)}, {across} x {up} px", sensor[0]),
    ]
    if design.sensor.relay_magnification != 1:
        relay = f"magnification {design.sensor.relay_magnification:g}"
        rows.append((str(number + 2), "relay to the sensor", relay, "not in the catalogue"))
    heads = ("", "part", "what it must be", "catalogue")
    caption = (
        f"Catalogue: a part is the same where its lengths agree to {100 * ALIKE:g} % and it is large enough; else the "
        "nearest is named with what differs. Walls, window, mounts and light source are not part of the model."
    )
    found = [entry for _, entry in (lens, array, sensor) if entry is not None]
    notes = tuple(_said(entry) for entry in found)
    blocks = (Table(tuple(rows), "rlll", heads, caption=caption, widths=(1.5, 9.5, 0, 0)),)
    return Section("Parts list", (*blocks, Bullets(notes)) if notes else blocks)


def lens_match(design: Design, catalogue: Catalogue) -> tuple[str, Entry | None]:
    """What to say of the main lens, and the catalogue's part where it is the same or near."""
    if design.lens is not None:
        return f"{design.lens.name}, as prescribed", None

    def differs(part: LensPart) -> list[str]:
        return _unlike(("focal length", part.focal_length, design.f), ("clear aperture", part.aperture, design.D))

    def apart(part: LensPart) -> float:
        return _ratio(part.focal_length, design.f) + _ratio(part.aperture, design.D)

    return _match(catalogue.lenses, differs, apart)


def array_match(design: Design, catalogue: Catalogue) -> tuple[str, Entry | None]:
    """The same of the microlens array."""
    mla = design.microlens_array

    def differs(part: ArrayPart) -> list[str]:
        found = _unlike(("pitch", part.pitch, mla.pitch), ("focal length", part.focal, mla.focal_length))
        if (part.layout, part.lens_shape) != (mla.layout, mla.lens_shape):
            found.append(f"{part.layout}, {part.lens_shape} lenses")
        needed = [min(a, b) for a, b in zip(mla.size, design.sensor_size, strict=True)]
        if any(have < need * (1 - ALIKE) for have, need in zip(part.size, needed, strict=True)):
            found.append(f"only {' x '.join(length(side) for side in part.size)}")
        return found

    def apart(part: ArrayPart) -> float:
        return _ratio(part.pitch, mla.pitch) + _ratio(part.focal, mla.focal_length)

    return _match(catalogue.microlens_arrays, differs, apart)


def sensor_match(design: Design, catalogue: Catalogue) -> tuple[str, Entry | None]:
    """The same of the sensor; a larger one, read out in part, is the same."""
    pixel, needed = design.sensor.pixel, design.pixels

    def differs(part: SensorPart) -> list[str]:
        found = _unlike(("pixel", part.pixel, pixel))
        if any(have < need for have, need in zip(part.pixels, needed, strict=True)):
            found.append(f"only {part.pixels[0]} x {part.pixels[1]} px")
        return found

    def apart(part: SensorPart) -> float:
        short = sum(max(0.0, math.log(need / have)) for have, need in zip(part.pixels, needed, strict=True))
        return _ratio(part.pixel, pixel) + short

    return _match(catalogue.sensors, differs, apart)


def _match(
    parts: Sequence[Part], differs: Callable[[Part], list[str]], apart: Callable[[Part], float]
) -> tuple[str, Part | None]:
    if not parts:
        return "the catalogue has none", None
    same = [part for part in parts if not differs(part)]
    best = min(same or parts, key=apart)
    maker = f"{best.maker} " if best.maker else ""
    if same:
        return f"the same as {maker}{best.part}", best
    if apart(best) > FAR:
        return "to be made; the catalogue has nothing near", None
    told = ", ".join(differs(best))
    return f"to be made; nearest is {maker}{best.part}: {told}", best


def _unlike(*lengths: tuple[str, float, float]) -> list[str]:
    return [f"{name} {length(have)}" for name, have, wanted in lengths if abs(have / wanted - 1) > ALIKE]


def _ratio(have: float, wanted: float) -> float:
    return abs(math.log(have / wanted))


def _lens(design: Design) -> str:
    if design.lens is not None:
        return f"{design.lens.name}, clear aperture {length(design.D)}"
    return f"focal length {length(design.f)}, clear aperture {length(design.D)}, ideal in this report"


def _said(entry: Entry) -> str:
    maker = f"{entry.maker} " if entry.maker else ""
    remark = f" {entry.remark[:1].upper()}{entry.remark[1:].rstrip('.')}." if entry.remark else ""
    return f"{maker}{entry.part}: {entry.provenance} ({entry.confidence}).{remark}"


def length(value: float) -> str:
    """A length as a reader wants it: five digits, micrometres below 0.1 mm."""
    return f"{value:.5g} mm" if abs(value) >= 0.1 or value == 0 else f"{1e3 * value:.5g} um"
