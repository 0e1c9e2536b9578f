"""Quantities of a design over one or two of its numbers."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._arrays import Array
from ..bore.conjugates import follower
from ..camera import Camera
from ..design import Design
from ..distances import Distance, check_distances, one_distance
from ..errors import expect, refusal
from ..progress import CountedProgress, silent
from ..theory.field_of_view import focus_ahead
from ..theory.focused import refuse_focused
from ..theory.limits import as_design
from ..theory.quantities import QUANTITIES, quantities_of_cameras, quantity_named, thin_lens_note, window_note
from ..theory.quantity import Quantity
from ..theory.quantity_table import QuantityTable
from .field_images import MOST_TRACED, rays_tell


@dataclass(frozen=True, eq=False)
class Sweep:
    """Values of quantities at points of a line or a grid."""

    places: Mapping[str, Array]
    """Dotted place or symbol to its values; the first is the grid's first axis."""
    values: Mapping[str, Array]
    """Quantity to its values, shape (N,) or (N, M); nan where there is no camera."""
    units: Mapping[str, str]
    """Unit of each place and quantity."""
    valid: NDArray[np.bool_]
    """True where there is a camera, shape (N,) or (N, M)."""
    follows: str | None
    """Conjugate that follows from what is swept, of f, d_f and d_1; None where none changes."""
    at: float | None
    """Distance ahead of the bore's tip that quantities are asked for at [mm]; None: the focal plane."""
    own: tuple[float, ...]
    """The design's own value at each place."""
    note: str = ""
    """Quantities that are of the thin-lens model behind a real lens, in words; empty behind an ideal one."""

    def refused(self, design: Design) -> tuple[str, ...]:
        """Reasons why points have no camera, each once: those of up to `LOOKED_AT` of them."""
        points = np.argwhere(~self.valid)
        some = points[np.unique(np.linspace(0, len(points) - 1, LOOKED_AT).astype(int))] if len(points) else points
        reasons: dict[str, str] = {}
        for point in some.tolist():
            values = [float(axis[k]) for axis, k in zip(self.places.values(), point, strict=True)]
            named = dict(zip(self.places, values, strict=True))
            changes = {place: value for place, value in named.items() if place != AT}
            at = " and ".join(f"{place} = {value:.6g}" for place, value in zip(self.places, values, strict=True))
            asked = [(QUANTITIES[name], named.get(AT, self.at)) for name in self.values]
            for problem in rays_tell(partial(design.replace, changes), asked)[1]:
                reasons.setdefault(re.sub(r"[\d.]+", "", str(problem)), f"at {at}{self._unit()}: {problem}")
        return tuple(reasons.values())

    @property
    def table(self) -> QuantityTable:
        """Table with a row a point, places before quantities; of a grid the last place runs fastest."""
        grid = np.meshgrid(*self.places.values(), indexing="ij")
        columns = dict(zip(self.places, (axis.ravel() for axis in grid), strict=True))
        columns |= {name: values.ravel() for name, values in self.values.items()}
        return QuantityTable(columns, self.units, note=self.note)

    def to_csv(self, path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
        """Write `table` as a CSV file, as `QuantityTable.to_csv` does."""
        self.table.to_csv(path, overwrite=overwrite)

    def to_pandas(self) -> Any:
        """Copy of `table` as a `pandas.DataFrame`, as `QuantityTable.to_pandas` makes it."""
        return self.table.to_pandas()

    def __str__(self) -> str:
        return str(self.table)

    def _repr_html_(self) -> str:
        return self.table._repr_html_()

    def _unit(self) -> str:
        units = {self.units[place] for place in self.places}
        return f" {units.pop()}".rstrip() if len(units) == 1 else ""


AT = "at"
"""Place of no design: the distance ahead of the bore's tip that quantities are asked for at."""
LOOKED_AT = 12
"""Points without a camera that are asked why."""


def sweep(
    design: Design | str | Path,
    places: Mapping[str, ArrayLike],
    quantities: str | Sequence[str],
    at: Distance | Sequence[Distance] | None = None,
    progress: CountedProgress = silent,
) -> Sweep:
    """Quantities over one or two numbers of a design, all points at once.

    Behind a real lens up to `MOST_TRACED` points are traced, one after the other, for what `evaluate` tells by rays.

    Parameters
    ----------
    design : Design, str or Path
        Gives every other number; the name of a preset or a design file as well.
    places : mapping
        One or two dotted places ("aperture.distance") or symbols ("d_3") to their values [mm, rad]; "at" is the
        distance ahead of the tip. Of f, d_f and d_1 the same one follows as in `Design.replace`.
    quantities : str or sequence of str
        Names in `QUANTITIES`, of whole cameras.
    at : float or str, optional
        Distance ahead of the bore's tip for quantities that are asked for at one [mm], a list of one too; None is the
        focal plane. Behind the tip they have no value.
    progress : callable, optional
        Told what is being done, how many of the quantities and traced points, and of how many, as by all functions.

    Raises
    ------
    DesignError
        A place that the design has not.
    ValueError
        None or more than two places; a quantity that is not known, belongs to a field, or needs a distance.

    Examples
    --------
    >>> import roslf_design as roslf
    >>> roslf.sweep("paper", {"d_3": [20.0, 120.0]}, ["fill_factor"]).values["fill_factor"].round(3)
    array([0.689, 1.005])
    """
    design = as_design(design)
    expect(places, "places", Mapping, 'a mapping of places to values, as {"d_3": [20.0, 120.0]}')
    if not 1 <= len(places) <= 2:
        raise ValueError(f"{len(places)} places given; sweep one or two")
    at = one_distance(at)
    try:
        axes = {place: np.asarray(values, float).ravel() for place, values in places.items()}
    except (TypeError, ValueError):
        raise ValueError(f"{places}: give numbers in mm or rad, as numpy.linspace(0, 3, 61)") from None
    if AT in axes and at is not None:
        raise refusal(AT, "given and swept; drop one of them")
    distances = check_distances(axes[AT].tolist()) if AT in axes else (at,)
    known = quantities_of_cameras(quantities, distances[0])
    built = {place: values for place, values in axes.items() if place != AT}
    for quantity in known:
        if quantity.of_views:
            refuse_focused(design, quantity.name, changed=built)
    grid = np.meshgrid(*built.values(), indexing="ij")
    camera = Camera.of(design, {place: values.ravel() for place, values in zip(built, grid, strict=True)})
    points = int(np.prod([len(values) for values in built.values()]))
    values, valid = {}, np.broadcast_to(camera.valid, (points,)).copy()
    by_rays = [quantity for quantity in known if quantity.of_rays is not None and design.main_lens.kind.mounted]
    few = len(valid) * len(distances) <= MOST_TRACED
    traced = np.flatnonzero(valid) if by_rays and few else ()

    def of_points(quantity: Quantity, one: float | None) -> Array:
        each = quantity(camera, one if quantity.at != "never" else None)
        return np.where(valid, np.broadcast_to(each, (points,)), np.nan)

    with np.errstate(all="ignore"):  # of points that are no cameras
        for done, quantity in enumerate(known):
            progress("sweep", done, len(known) + len(traced))
            values[quantity.name] = np.stack([of_points(quantity, one) for one in distances])
    for done, k in enumerate(traced, len(known)):
        progress("sweep", done, len(known) + len(traced))
        point = {place: float(own.ravel()[k]) for place, own in zip(built, grid, strict=True)}
        asked = [(quantity, one) for quantity in by_rays for one in distances]
        told, faults = rays_tell(partial(design.replace, point), asked)
        valid[k] = not faults
        for (quantity, one), value in zip(asked, told, strict=True):
            if value is not None:
                values[quantity.name][distances.index(one), k] = value
    progress("sweep", len(known) + len(traced), len(known) + len(traced))

    def shaped(each: NDArray[Any]) -> NDArray[Any]:
        """Values at distances and points, on the grid's axes in their order."""
        own = each.reshape(len(distances), *(len(values) for values in built.values()))
        return own[0] if AT not in axes else own.T if len(axes) == 2 and list(axes)[1] == AT else own

    values = {name: shaped(np.where(valid, each, np.nan)) for name, each in values.items()}
    units = {quantity.name: quantity.unit for quantity in known}
    units |= {place: unit_of(place) for place in axes}
    follows = follower([design.place_named(place) for place in built])
    here = Camera.of(design)
    own = tuple(float(focus_ahead(here) if place == AT else here[design.place_named(place)]) for place in axes)
    note = thin_lens_note([design], values, untraced="" if few else f"a sweep of up to {MOST_TRACED} points")
    with np.errstate(all="ignore"):
        unlike = window_note(values, lambda: of_points(quantity_named("depth_window_mm"), distances[0]))
    note = "; ".join(filter(None, [unlike, note]))
    drawn = shaped(np.broadcast_to(valid, (len(distances), points)))
    return Sweep(axes, values, units, drawn, follows, at, own, note)


UNITS = {
    **dict.fromkeys(("rotation", "turn", "acceptance"), "rad"),
    "gradient": "/mm",
    "illuminance": "lx",
    "radiance": "W/m2/sr",
    "exposure": "s",
    **dict.fromkeys(
        ("index", "relay_magnification", "reflectance", "transmission", "quantum_efficiency", "full_well", "read_noise",
         "prnu", "dsnu", "veil", "bits", "contrast", "window", "view_mismatch", "disparity_error"), "",
    ),
}  # fmt: skip
"""Base unit of places by their last name, where that is no length."""


def unit_of(place: str) -> str:
    """Base unit of a place: "mm" of lengths, "rad" of angles, "degC" of temperatures, none of plain numbers."""
    if any(f".{pose}." in place for pose in ("tilt", "wedge")):
        return "rad"
    if place.startswith("environment."):
        return "degC"
    return UNITS.get(place.rpartition(".")[2], "mm")
