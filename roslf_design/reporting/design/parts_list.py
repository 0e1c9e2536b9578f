"""Parts list of a design, and which parts of the catalogue are the same or come nearest."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from ...bore.elements import AnyElement, made_of
from ...catalogue import Catalogue, Entry, Kind, load_catalogue
from ...catalogue.entries import NAMED, meant
from ...design import Design
from ...design.check import at
from ...theory.colours import PIXEL_FILTERS
from ...words import length, listed
from ..blocks import Bullets, Section, Table
from ..lens_words import lens_words
from .figures import at_room
from .rays import DrawnTube

FAR = math.log(2)
"""Sum of logarithms of ratios beyond which a part is not worth naming."""


SAME = 0.01
"""Relative difference up to which a length of a part counts as the design's."""
WIDER = 2.0
"""Clear aperture, over the design's, up to which a window still stands for one that is narrower."""
ANOTHER = math.log(1.2)
"""Penalty for another material, as logarithm of a ratio."""


class _Unlike(NamedTuple):
    """Differences of a part from what a design asks for."""

    lengths: tuple[tuple[str, float, float], ...]
    """Name, the part's, the design's [mm]."""
    lacks: tuple[str, ...] = ()
    short: float = 0.0
    """Size of what it lacks, as logarithm of a ratio."""
    beyond: str = ""
    """Words on what it has beyond what is asked for, which does not count."""

    @property
    def words(self) -> list[str]:
        """Words on what is not the same; empty of a part that serves as it is."""
        apart = [f"{name} {length(have)}" for name, have, wanted in self.lengths if abs(have / wanted - 1) > SAME]
        return [*apart, *self.lacks]

    @property
    def size(self) -> float:
        """Sum of logarithms of ratios."""
        return self.short + sum(abs(math.log(have / wanted)) for _, have, wanted in self.lengths)


def _lens(part: Any, design: Design, element: AnyElement | None) -> _Unlike:
    """Differences in focal length and clear aperture."""
    aperture = "clear aperture", part.aperture, design.D
    return _Unlike((("focal length", part.focal_length, design.f), aperture))


def _array(part: Any, design: Design, element: AnyElement | None) -> _Unlike:
    """Differences in pitch, focal length and shape, and whether it is too small for array or sensor."""
    mla, lacks = design.microlens_array, []
    if (part.layout, part.lens_shape) != (mla.layout, mla.lens_shape):
        lacks.append(f"{part.layout}, {part.lens_shape} lenses")
    needed = [min(pair) for pair in zip(mla.size, design.sensor_size, strict=True)]
    if any(have < need * (1 - SAME) for have, need in zip(part.size, needed, strict=True)):
        lacks.append(f"only {' x '.join(map(length, part.size))}")
    lengths = ("pitch", part.pitch, mla.pitch), ("focal length", part.focal, design.f_ml)
    larger = any(have > side * (1 + SAME) for have, side in zip(part.size, mla.size, strict=True))
    return _Unlike(lengths, tuple(lacks), beyond="cut to size" if larger and part.cut else "")


def _sensor(part: Any, design: Design, element: AnyElement | None) -> _Unlike:
    """Differences in pixel and filters, and pixels that it lacks: a larger one, read out in part, is the same."""
    lacks = []
    short = sum(max(0.0, math.log(need / have)) for have, need in zip(part.pixels, design.pixels, strict=True))
    if short:
        lacks.append(f"only {part.pixels[0]} x {part.pixels[1]} px")
    if part.colours is not None and part.colours != design.sensor.colours:
        lacks.append(PIXEL_FILTERS[part.colours].words)
    (across, up), (wide, high) = design.pixels, part.pixels
    read = f"{across} x {up} of its {wide} x {high} px read" if (wide, high) != (across, up) else ""
    return _Unlike((("pixel", part.pixel, design.sensor.pixel),), tuple(lacks), short, read)


def _window(part: Any, design: Design, element: AnyElement | None) -> _Unlike:
    """Differences in thickness, clear aperture and material; one that is somewhat wider is the same."""
    assert element is not None
    lacks, wider = [], 1.0 if element.diameter is None else part.aperture / element.diameter
    apart = abs(math.log(wider)) * (1 if wider > 1 else 2)  # which cuts light
    if not 1 - SAME <= wider <= WIDER:
        lacks.append(f"clear aperture {length(part.aperture)}")
    if element.glass is None or part.material.name != element.glass.name:
        lacks.append(f"of {part.material.name}")
        apart += ANOTHER
    beyond = f"{length(part.diameter)} wide" if wider > 1 + SAME else ""
    if design.tube is not None:
        room = design.tube.room(design.tip - element.distance - element.length)
        if part.diameter > room * (1 + SAME):
            lacks.append(f"{length(part.diameter)} wide in a tube of {length(room)} inside")
            apart += 2 * math.log(part.diameter / room)
    return _Unlike((("thickness", part.thickness, element.length),), tuple(lacks), apart, beyond)


UNLIKE: Mapping[Kind, Callable[[Any, Design, AnyElement | None], _Unlike]] = {
    "lenses": _lens, "microlens_arrays": _array, "sensors": _sensor, "windows": _window,
}  # fmt: skip
"""Differences of a part from the one that a design has, by its kind; of a window from the element it stands for."""


def parts_section(design: Design) -> Section:
    """The parts list, beside the shipped catalogue."""
    known, (design, holds) = load_catalogue(), at_room(design)
    kinds: tuple[Kind, ...] = ("lenses", "microlens_arrays", "sensors")
    (lens, array, sensor), entries = zip(*(_catalogue_match(design, known, kind) for kind in kinds), strict=True)
    mla, (across, up) = design.microlens_array, design.pixels
    aperture = f"clear aperture {length(design.D)}"
    for prescribed in design.main_lens.prescribed:
        if prescribed.clear_aperture is not None and prescribed.clear_aperture < design.D:
            aperture += f", of which {length(prescribed.clear_aperture)} is guaranteed"
    words = lens_words(design.main_lens.kind)
    main_lens = words.part.format(name=words.title, focal_length=length(design.f), aperture=aperture)
    microlenses = f"{mla.layout}, {mla.lens_shape} lenses, pitch {length(mla.pitch)}, f_ml {mla.focal_words}"
    made = design.with_own_stop
    stop = "FAP, front stop", f"opening {made.aperture.outline.words}", "made to drawing"
    if made.aperture.behind is not None:
        stop = "stop behind the main lens", *stop[1:]
    elif design.d_3 < 0:
        stop = "stop of the main lens", f"entrance pupil {made.aperture.outline.words}", "comes with the lens"
    rows = [("main lens", main_lens, lens), stop]
    rows += [(stop.name, f"opening {stop.part.outline.words}", "made to drawing") for stop in design.openings[1:]]
    for _, name, element, _, _ in design.in_bore:
        bought, entry = element.bought or OWN, None
        for kind in element.catalogue:
            bought, entry = _catalogue_match(design, known, kind, element)
        entries = (*entries, *([entry] if entry is not None and entry not in entries else []))
        rows.append((f"{element.trade_name or element.kind} ({name})", ", ".join(made_of(element)), bought))
    rows += [(at.part.trade_name, at.part.words()[0], "comes with its part") for at in design.plates]
    filters = f", {own.words}" if (own := PIXEL_FILTERS[design.sensor.colours]).kinds else ""
    rows += [
        ("microlens array", f"{microlenses}, {' x '.join(map(length, mla.size))}", array),
        ("image sensor", f"pixel {length(design.sensor.pixel)}, {across} x {up} px{filters}", sensor),
    ]
    if (tube := design.tube) is not None:
        made_from = tube.material or (None if design.environment is None else design.environment.housing)
        long = "" if tube.length is None else f", {length(tube.length)} long"
        of = "" if made_from is None else f", of {made_from.words}"
        rows.append(("tube", f"{DrawnTube.of(design).sizes} outside / inside{long}{of}", "made to drawing"))
    if design.sensor.relay_magnification != 1:
        relay = f"magnification {design.sensor.relay_magnification:g}"
        rows.append(("relay to the sensor", relay, "not in the catalogue"))
    caption = (
        f"Catalogue: a part is the same where its lengths agree to {100 * SAME:g} % and it is large enough; else the "
        f"nearest is named with what differs. Mounts and light source are not part of the model.{holds}"
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


def named_parts(design: Design) -> list[tuple[str, str]]:
    """Trade name of each part that the design names, and what the catalogue says of it."""
    known, (design, _) = load_catalogue(), at_room(design)
    parts: list[tuple[str, Kind, AnyElement | None]] = [
        (place.replace("_", " "), kind, None) for place, kind in NAMED.items() if kind != "windows"
    ]
    parts += [(name, kind, part) for _, name, part, _, _ in design.in_bore for kind in part.catalogue]
    named: list[tuple[str, str]] = []
    for name, kind, window in parts:
        if _own(design, kind, window).part is not None:
            words, entry = _catalogue_match(design, known, kind, window)
            doubt = ", unverified" if entry is not None and entry.confidence == "unverified" else ""
            unpacked = (
                ", no package size known" if kind == "sensors" and doubt and design.sensor.package is None else ""
            )
            named.append((name, f"{words}{doubt}{unpacked}"))
    return named


def _own(design: Design, kind: Kind, window: AnyElement | None) -> Any:
    """The design's part of a kind; of windows, one."""
    return window or next(at(design, place) for place, its in NAMED.items() if its == kind)


def _catalogue_match(
    design: Design, catalogue: Catalogue, kind: Kind, window: AnyElement | None = None
) -> tuple[str, Entry | None]:
    """Remark on a part of the design (of windows, on one), and the catalogue's where it is the same or near.

    The same is one whose lengths agree and that lacks nothing, the smallest of several; the nearest has the ratios to
    what is wanted least.
    """
    if kind == "lenses" and (bought := lens_words(design.main_lens.kind).bought):
        return bought, None  # whose surfaces say which one it is
    own = _own(design, kind, window).part
    parts = catalogue.of(kind)
    named = [] if own is None else [parts[k] for k in meant(own, [(part.part, part.name) for part in parts])]
    if own is not None and not named:
        return f"{own}, as the design names it; not in the catalogue that ships", None
    unlike = {part.part: UNLIKE[kind](part, design, window) for part in named or parts}
    same = [part for part in named or parts if not unlike[part.part].words]
    best = min(same or named or parts, key=lambda part: (unlike[part.part].size, part.area), default=None)
    if best is None:
        return "the catalogue has none", None
    if named and not same:
        return f"{best.name} is named; as catalogued: {', '.join(unlike[best.part].words)}", best
    if same:
        beyond = unlike[best.part].beyond
        alike = best.name if named else f"the same as {best.name}"
        return f"{best.name}, {beyond}" if beyond else alike, best
    if unlike[best.part].size > FAR:
        return "to be made; the catalogue has nothing near", None
    return f"to be made; nearest is {best.name}: {', '.join(unlike[best.part].words)}", best


def _provenance(entry: Entry) -> str:
    remark = f" {entry.remark[:1].upper()}{entry.remark[1:].rstrip('.')}." if entry.remark else ""
    unstated = f" Not stated: {listed([*entry.unstated])}." if entry.unstated else ""
    return f"{entry.name}: {entry.source} ({entry.confidence}).{remark}{unstated}"
