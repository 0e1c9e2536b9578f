"""Parts list of a design, and which parts of the catalogue are the same or come nearest."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ...bore.elements import AnyElement, made_of
from ...optimization.parts import SAME, Catalogue, Entry, Kind, load_catalogue
from ...theory.colours import PIXEL_FILTERS
from ...words import length
from ..blocks import Bullets, Section, Table
from ..lens_words import lens_words
from .figures import at_room

if TYPE_CHECKING:
    from ...design import Design

FAR = math.log(2)
"""Sum of logarithms of ratios beyond which a part is not worth naming."""


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
    if design.sensor.relay_magnification != 1:
        relay = f"magnification {design.sensor.relay_magnification:g}"
        rows.append(("relay to the sensor", relay, "not in the catalogue"))
    caption = (
        f"Catalogue: a part is the same where its lengths agree to {100 * SAME:g} % and it is large enough; else the "
        f"nearest is named with what differs. Walls, mounts and light source are not part of the model.{holds}"
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


def _catalogue_match(
    design: Design, catalogue: Catalogue, kind: Kind, window: AnyElement | None = None
) -> tuple[str, Entry | None]:
    """Remark on a part of the design (of windows, on one), and the catalogue's where it is the same or near.

    The same is one whose lengths agree and that lacks nothing, the smallest of several; the nearest has the ratios to
    what is wanted least.
    """
    if kind == "lenses" and (bought := lens_words(design.main_lens.kind).bought):
        return bought, None
    unlike = {part.part: part.unlike(design, window) for part in catalogue.of(kind)}
    same = [part for part in catalogue.of(kind) if not unlike[part.part].words]
    best = min(same or catalogue.of(kind), key=lambda part: (unlike[part.part].size, part.area), default=None)
    if best is None:
        return "the catalogue has none", None
    if same:
        beyond = unlike[best.part].beyond
        return f"{_name(best)}, {beyond}" if beyond else f"the same as {_name(best)}", best
    if unlike[best.part].size > FAR:
        return "to be made; the catalogue has nothing near", None
    return f"to be made; nearest is {_name(best)}: {', '.join(unlike[best.part].words)}", best


def _name(entry: Entry) -> str:
    return f"{entry.maker} {entry.part}".strip()


def _provenance(entry: Entry) -> str:
    remark = f" {entry.remark[:1].upper()}{entry.remark[1:].rstrip('.')}." if entry.remark else ""
    return f"{_name(entry)}: {entry.source} ({entry.confidence}).{remark}"
