"""`roslf sweep`."""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from .._arrays import Array
from ..bore.conjugates import CONJUGATES
from ..bore.part import TEMPERATURE
from ..design import PATHS, Design
from ..errors import InputError, one_line, refusal
from ..evaluation.sweep import AT, Sweep, unit_of
from ..evaluation.sweep import sweep as compute
from ..reporting.sweep import sweep_picture
from ..theory.limits import as_design, limits
from ..theory.quantity_table import QuantityTable
from ..toml_files import nearest
from ..units import LACKING, read_quantity
from .report import folder_name
from .terminal import DesignName, OptionalOutput, bar, check_target, read_distances, say, write_file

KINDS = (".png", ".svg", ".csv", ".parquet")
MARK = "roslf_sweep_point"
"""Heading of a table's last column, the points' numbers: no table of anybody else has it."""
POINTS, ACROSS, MOST = 101, 61, 1_000_000
DIMENSIONS = {
    "mm": "length",
    "rad": "angle",
    "/mm": "gradient",
    "lx": "illuminance",
    "W/m2/sr": "radiance",
    "s": "time",
    "degC": "temperature",
}
"""Dimensions of base units, as `read_quantity` calls them; a number without a unit has none."""
NUMBER = r"[-+]?\d*\.?\d+(?:[eE][-+]?\d+)?"


def sweep(
    design: DesignName,
    /,
    *,
    set: Annotated[list[str], Parameter(name="--set", negative=())],
    quantity: Annotated[list[str], Parameter(name="--quantity", negative=())],
    output: OptionalOutput = None,
    at: str | None = None,
    points: int | None = None,
) -> None:
    """Any quantities over one or two numbers of a design: a picture, or a table.

    Example: roslf sweep paper --set "d_3=0..150 mm" --set "D_F=1..5 mm" --quantity fill_factor -o fill.png

    Parameters
    ----------
    set
        A dotted place or a symbol, and from where to where: "aperture.distance=0..150 mm"; "at=60..200 mm" is over the
        distance ahead of the bore's tip. May be given twice.
    quantity
        Names, with commas between; `roslf quantities` lists all. May be given several times.
    output
        File to write: .png, .svg, .csv or .parquet. Default: sweep-DESIGN.png.
    at
        Distance ahead of the bore's tip, as "20 mm", for quantities that are asked for at one. Default: the focal
        plane.
    points
        Along each axis. Default: 101; 61 for two.
    """
    target = Path(f"sweep-{folder_name(design)}.png") if output is None else output
    kind = check_target(target, KINDS)
    if kind == ".parquet" and importlib.util.find_spec("pyarrow") is None:
        raise refusal("output", "Parquet needs the pyarrow package (pip install pyarrow); or write .csv")
    count = points if points is not None else POINTS if len(set) == 1 else ACROSS
    if not count >= 2 or count ** len(set) > MOST:
        raise refusal("points", f"{count} is out of range; give 2 or more, and no more than {MOST} in all")
    if len(set) > 2:
        raise refusal("set", f"{len(set)} given; sweep one or two places")
    places = dict(_span(text, count) for text in set)
    if len(places) < len(set):
        raise refusal("set", "the same place twice; name two")
    names = [name.strip() for part in quantity for name in part.split(",") if name.strip()]
    away = None if at is None else read_distances([at])[0]
    loaded = as_design(design)
    if not names:
        raise refusal("quantity", "names none; give at least one, as fill_factor")
    try:
        with bar("sweep") as tell:
            swept = compute(
                loaded, places, list(dict.fromkeys(names)), away, lambda what, done=0.0, total=1.0: tell(done / total)
            )
    except InputError as error:
        raise refusal("set", "; ".join(map(str, error.problems))) from None
    except ValueError as error:
        raise refusal("quantity", str(error)) from None
    notes = list(_notes(swept, loaded))
    if not swept.valid.any():
        raise refusal("set", f"nothing between can be drawn: {'; '.join(notes)}")
    write_file(target, _written(swept, kind, loaded, notes))
    say(target)
    for note in notes:
        say(f"roslf: {one_line(note)}", error=True)


def _notes(swept: Sweep, design: Design) -> Iterator[str]:
    """Notes on what a picture does not show: which length follows, how many points cannot be shown, and why."""
    if swept.note:
        yield swept.note
    if swept.follows is not None:
        changed = [PATHS.get(place, place) for place in swept.places]
        still = () if TEMPERATURE in changed else CONJUGATES  # which moves them all
        kept = [place for place in still if place not in (swept.follows, *changed)]
        stays = "".join(f"; {place} stays {design[place]:.6g} mm" for place in kept)
        yield f"{swept.follows} follows from what is swept{stays}"
    for name, values in swept.values.items():
        if endless := int(np.isposinf(values).sum()):
            yield f"{name} is infinite at {endless} of {values.size} points, where pictures show nothing"
        if undefined := int((np.isnan(values) & swept.valid).sum()):
            yield f"{name} is undefined at {undefined} of {values.size} points, though a camera can be built there"
    if not swept.valid.all():
        count = int((~swept.valid).sum())
        yield f"{count} of {swept.valid.size} points cannot be built: {'; '.join(swept.refused(design))}"


def _span(text: str, count: int) -> tuple[str, Array]:
    """Read "aperture.distance=0..150 mm"."""
    place, equals, span = text.partition("=")
    match = re.fullmatch(rf"\s*({NUMBER})\s*\.\.\s*({NUMBER})\s*(.*)", span)
    if not equals or match is None:
        raise refusal("set", f'cannot read "{text}"; write PLACE=FROM..TO UNIT, as "aperture.distance=0..150 mm"')
    place, unit = place.strip(), match[3].strip()
    if "." not in place and place not in (AT, *PATHS):
        hint = nearest(place, [AT, *PATHS, *PATHS.values(), TEMPERATURE])
        raise refusal("set", f"{place}: is not a number of this design; {hint}")
    dimension = DIMENSIONS.get(unit_of(PATHS.get(place, place)))
    if dimension is None and unit:
        raise refusal("set", f"{place} is a plain number; leave out {unit}")
    try:
        ends = [float(end) if dimension is None else read_quantity(f"{end} {unit}".strip(), dimension)
                for end in match.groups()[:2]]  # fmt: skip
    except ValueError as error:
        if not unit:
            form = f"{match[1]}..{match[2]} {LACKING[dimension or 'length']}"
            raise refusal("set", f'{place}: "{span.strip()}" has no unit; write e.g. "{form}"') from None
        raise refusal("set", f"{place}: {error}") from None
    return place, np.linspace(ends[0], ends[1], count)


def _marked(table: QuantityTable) -> QuantityTable:
    """Table with the points' numbers under the mark by which a later sweep knows the file for one of ours."""
    return replace(table, columns={**table.columns, MARK: np.arange(1, len(table) + 1)})


def _written(swept: Sweep, kind: str, design: Design, notes: list[str]) -> bytes:
    if kind in (".png", ".svg"):
        picture = sweep_picture(swept, design.name, notes, [one for one in limits(design) if one[0].off_axis is None])
        return picture.to_png() if kind == ".png" else picture.svg_file()
    if kind == ".parquet":
        import pyarrow
        import pyarrow.parquet

        sink = pyarrow.BufferOutputStream()
        pyarrow.parquet.write_table(pyarrow.table(_marked(swept.table).headed), sink)
        return bytes(sink.getvalue())
    return _marked(swept.table).csv()
