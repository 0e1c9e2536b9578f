"""`evaluate_many`: quantities of many designs as one table."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..camera import Camera
from ..design import Design
from ..distances import Distance, one_distance
from ..errors import expect, refusal
from ..progress import CountedProgress, silent
from ..theory.depth_budget import depth_budget
from ..theory.focused import FocusedArray, focus_faults
from ..theory.limits import as_design
from ..theory.quantities import DEPTH_ERRORS, quantities_of_cameras, quantity_named, thin_lens_note, window_note
from ..theory.quantity import Quantity
from ..theory.quantity_table import QuantityTable
from ..words import listed
from .evaluate import at_temperature
from .field_images import MOST_TRACED, rays_tell

ANSWERS = (
    *("field_of_view_width_deg", "working_distance_mm", "field_half_width_mm", "object_sample_mm", "u_z_mm"),
    "depth_window_mm",
    *("insertion_diameter_mm", "outer_diameter_mm", "fill_factor", "non_distortion_room_mm", "views_independent"),
)
"""Quantities that a table has where none are named: what a buyer asks first, and what verdicts rest on."""


def evaluate_many(
    designs: Design | str | Mapping[str, Design | str | Path] | Iterable[Design | str | Path],
    quantities: Sequence[str] = ANSWERS,
    *,
    at: Distance | tuple[Distance] | None = None,
    temperature: float | str | None = None,
    progress: CountedProgress = silent,
) -> QuantityTable:
    """Quantities of many designs as a table: a row a design, a column a quantity.

    Designs that differ in numbers alone are computed all at once. Behind real lenses up to `MOST_TRACED` are traced,
    one after the other, for what `evaluate` tells by rays.

    Parameters
    ----------
    designs : Design or str, or iterable of Design, str or Path, or mapping
        Designs, names of presets, design files; a mapping gives each row its name, which else is the preset, the path,
        or the design's own name.
    quantities : sequence of str
        Names in `QUANTITIES`, of whole cameras.
    at : float or str, optional
        Distance ahead of the bore's tip [mm], or text as "10 mm", for quantities that are asked for at one; None is the
        focal plane.
    temperature : float or str, optional
        Of every camera, as for `evaluate`.
    progress : callable, optional
        Told how many of the designs behind real lenses are traced, and of how many, as by all functions.

    Returns
    -------
    QuantityTable
        Shows as a table in a notebook; `to_pandas`, `to_csv`. NaN, or an empty cell, is what a design has no value of,
        as numbers of views behind focused microlenses; `reasons` has why, by row, and why a depth is infinite.

    Raises
    ------
    DesignError
        A design file that cannot be used; a temperature that no camera meets.
    InputError
        No design at all.
    ValueError
        A quantity that is not known, belongs to a field, or needs a distance.

    Examples
    --------
    >>> import roslf_design as roslf
    >>> table = roslf.evaluate_many(["paper", "rigid-scope"], ["fill_factor", "u_z_mm"])
    >>> table.columns["fill_factor"].round(3)
    array([1.005, 0.991])
    """
    at = one_distance(at)
    known = quantities_of_cameras(quantities, at)
    if isinstance(designs, (Design, str)):  # of which Python would take the parts
        designs = [designs]
    expect(designs, "designs", Iterable, "a list of designs, or a mapping of names to them")
    named = list(designs.items()) if isinstance(designs, Mapping) else [(_name(one), one) for one in designs]
    if not named:
        raise refusal("designs", "there are none; give one or more")
    used = [at_temperature(as_design(design), temperature) for _, design in named]
    cameras = [Camera.of(design) for design in used]
    alike: dict[Any, list[int]] = defaultdict(list)
    for row, camera in enumerate(cameras):
        alike[camera.likeness, FocusedArray.of(camera) is not None].append(row)
    columns = {quantity.name: np.full(len(cameras), np.nan) for quantity in known}
    for (_, focused), rows in alike.items():
        camera = Camera.joined([cameras[row] for row in rows])
        for quantity in known:
            if not (focused and quantity.of_views):
                columns[quantity.name][rows] = quantity(camera, at if quantity.at != "never" else None)
    by_rays = [quantity for quantity in known if quantity.of_rays is not None]
    real = [row for row, design in enumerate(used) if design.main_lens.kind.mounted] if by_rays else []
    few = len(real) <= MOST_TRACED
    notes = [thin_lens_note(used, columns, untraced="" if few else f"a table of up to {MOST_TRACED} designs")]
    for done, row in enumerate(real if few else ()):
        progress("tracing", done, len(real))
        told, faults = rays_tell(partial(as_design, used[row]), [(quantity, at) for quantity in by_rays])
        notes += [f"{named[row][0]} without what rays tell: {fault}" for fault in faults[:1]]
        for quantity, value in zip(by_rays, told, strict=True):
            if value is not None:
                columns[quantity.name][row] = value
    if few and real:
        progress("tracing", len(real), len(real))
    reasons = dict[str, str]()
    windowed = quantity_named("depth_window_mm")
    seeing = [camera for camera in cameras if FocusedArray.of(camera) is None]
    notes.append(window_note(columns, lambda: [float(windowed(camera, at)) for camera in seeing]))
    for row, (name, _) in enumerate(named):
        if words := _reason(used[row], cameras[row], known, {one: column[row] for one, column in columns.items()}, at):
            reasons[str(name)] = words
    names = np.array([name for name, _ in named])
    units = {quantity.name: quantity.unit for quantity in known}
    return QuantityTable({"design": names, **columns}, units, note="; ".join(filter(None, notes)), reasons=reasons)


def _reason(
    design: Design, camera: Camera, asked: Sequence[Quantity], values: Mapping[str, float], at: float | None
) -> str:
    """Words on why a design has no value of some quantities, or an infinite depth; empty where it has all."""
    views = [one.name for one in asked if one.of_views and np.isnan(values[one.name])]
    if faults := [problem.message for problem in focus_faults(design, *views)]:
        return f"{faults[0]}; or set sensor.distance (d_2), which stays where another array is put in"
    endless = [one for one in DEPTH_ERRORS if np.isinf(values.get(one, 0.0))]
    return f"{listed(endless)} infinite: {depth_budget(camera, at).cause}" if endless else ""


def _name(design: Design | str | Path) -> str:
    return design.name if isinstance(design, Design) else str(design)
