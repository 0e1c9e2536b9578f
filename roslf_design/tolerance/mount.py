"""Builds of a camera behind a real main lens: its lens as made, everything else where it was put."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..design import Design
from ..lenses.aim import Planes
from ..lenses.builds import LensBuilds, lens_builds
from ..lenses.of_design import camera_of
from .algebra import Frame, Number, frame
from .camera import DISTANCE, FOCAL, PLANE, Camera, build
from .places import LENS, in_lens, nominal_values

Array = NDArray[np.float64]


class Mounted(NamedTuple):
    """T builds of a camera behind a real lens."""

    lens: LensBuilds
    planes: Planes
    camera: Camera
    """Their thin twins: what closed forms of axial distances take."""
    world: Array
    """What the system's frame is shifted by against the lens's [mm], (T, 3)."""


def mounted(design: Design, values: Mapping[str, Array], trials: int) -> Mounted:
    """Where everything stands in builds of a design behind a real lens.

    The lens is missed in itself; the stops, the array and the sensor keep the places that the nominal lens gave them,
    but for their own misses.
    """
    nominal = nominal_values(design)

    def number(place: str) -> Array:
        return values.get(place, np.full(trials, nominal[place]))

    lens_x, lens_y = number("main_lens.decentre.0"), number("main_lens.decentre.1")
    camera, drawn = camera_of(design), design.lens
    assert drawn is not None
    constants = camera.first_order
    lens = lens_builds(
        drawn,
        design.wavelength,
        {place.removeprefix(LENS): value for place, value in values.items() if in_lens(place)},
        trials,
        light=values.get("light.wavelength"),
        diameter=values.get("main_lens.diameter"),
        tilt=(number("main_lens.tilt.0"), number("main_lens.tilt.1")),
    )
    d_1 = number(DISTANCE)
    if PLANE in values:  # refocused to it by the nominal lens's constants
        d_1 = design.f * values[PLANE] / (values[PLANE] - design.f)
    mla = constants.rear_principal + d_1
    stops = ["aperture", *(f"stops.{index}" for index in range(len(design.stops)))]
    places = {stop: constants.front_principal - number(f"{stop}.distance") for stop in stops}

    def stands(part: str, z: Array, roll: Number = 0.0) -> Array:
        decentre = (number(f"{part}.decentre.0") - lens_x, number(f"{part}.decentre.1") - lens_y)
        return _row(frame(decentre, z, (number(f"{part}.tilt.0"), number(f"{part}.tilt.1")), roll), trials)

    rims = [
        np.concatenate([stands(stop, places[stop]), number(f"{stop}.diameter")[:, None] / 2], axis=1) for stop in stops
    ]
    planes = Planes(
        stands("microlens_array", mla, number("microlens_array.rotation")),
        stands("sensor", mla + number("sensor.distance")),
        np.stack(rims, axis=1),
    )
    twin = {place: value for place, value in values.items() if not in_lens(place) and place != PLANE}
    twin[FOCAL] = 1 / lens.power
    twin[DISTANCE] = mla - lens.rear_principal
    for stop in stops:
        twin[f"{stop}.distance"] = lens.front_principal - places[stop]
    thin = build(design.thin_twin, twin, trials)
    clear = lens.sound & (mla > lens.rear)
    for stop in stops:
        clear &= places[stop] <= np.minimum(lens.front, camera.front)
    valid = thin.valid & clear
    return Mounted(lens, planes, replace(thin, valid=valid), -np.stack([lens_x, lens_y, 0 * lens_x], axis=-1))


def _row(stands: Frame, trials: int) -> Array:
    row = np.empty((trials, 12))
    for column, value in enumerate((*stands.origin, *stands.x, *stands.y, *stands.z)):
        row[:, column] = value
    return row


def as_built(design: Design, values: Mapping[str, float]) -> Design:
    """One build as a design of its own, whose traced camera is the build.

    Its lens is written out as made; distances then count from that lens's own principal planes.

    Parameters
    ----------
    design : Design
        The nominal design, behind a real lens.
    values : mapping
        Place to number.

    Raises
    ------
    InputError
        The numbers make no camera.
    """
    from ..lenses.first_order import first_order
    from ..lenses.manufacture import as_made

    drawn, constants = design.lens, camera_of(design).first_order
    assert drawn is not None
    nominal = nominal_values(design)
    made = as_made(drawn, {p.removeprefix(LENS): v for p, v in values.items() if in_lens(p)}, design.wavelength)
    narrowest = 2 * min(surface.semi_diameter for surface in drawn.surfaces)
    if "main_lens.diameter" in values:
        wide = values["main_lens.diameter"] / 2
        cut = [
            replace(s, semi_diameter=wide) if 2 * s.semi_diameter <= narrowest * (1 + 1e-9) else s
            for s in made.surfaces
        ]
        made = replace(made, surfaces=tuple(cut))
    changes: dict[str, object] = {p: v for p, v in values.items() if not in_lens(p) and p not in (DISTANCE, PLANE)}
    own = first_order(made, values.get("light.wavelength", design.wavelength))
    d_1 = values.get(DISTANCE, nominal[DISTANCE])
    if PLANE in values:
        d_1 = design.f * values[PLANE] / (values[PLANE] - design.f)
    changes[DISTANCE] = constants.rear_principal + d_1 - own.rear_principal
    for stop in ("aperture", *(f"stops.{index}" for index in range(len(design.stops)))):
        place = f"{stop}.distance"
        changes[place] = own.front_principal - (constants.front_principal - values.get(place, nominal[place]))
    changes |= {"main_lens.prescription": made, "main_lens.reversed": False, "main_lens.diameter": None}
    return design.replace({**changes, "main_lens.focal_length": None})
