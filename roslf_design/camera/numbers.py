"""Numbers of a camera by their places: which a design gives, which need not be given, what each may be."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import Any

import numpy as np

from ..bore.main_lens import HIATUS
from ..bore.opening import TURN
from ..bore.part import TEMPERATURE, Number
from ..design import Design
from ..design.check import at
from ..design.parts import PATHS
from ..units import COLDEST, HOTTEST
from ..words import in_file

TYPES = f"{PATHS['f_ml']}s."
"""Beginning of the places of the focal lengths of a multi-focus array but its first, which is f_ml."""
SIGNED = (".rotation", f".{TURN}", ".focal_length")
"""Ends of places whose numbers may be of either sign."""
PHOTOMETRIC = (
    *(f"light.{name}" for name in ("illuminance", "reflectance", "transmission", "veil")),
    *(f"sensor.{name}" for name in ("quantum_efficiency", "full_well", "read_noise", "prnu", "dsnu", "bits")),
    *(f"depth.{name}" for name in ("contrast", "window", "view_mismatch")),
)
"""Places of what light, sensor and texture have to do with depth errors."""
TEMPERATURES = ("environment.range.0", "environment.range.1", "environment.calibrated_at")
"""Places of the coldest and the warmest that the camera meets, and of the temperature at which it is calibrated."""
NOT_NEGATIVE = ("read_noise", "prnu", "dsnu", "veil", "view_mismatch")
"""Last names of numbers that may be 0."""
OPTIONAL = (
    *("light.radiance", "light.measured_at", "light.exposure", "sensor.acceptance"),
    *("depth.period", "depth.finest", "depth.disparity_error"),
    *TEMPERATURES,
)
"""Places of numbers that need not be given."""
VIEWING_CONDITIONS = frozenset((*PHOTOMETRIC, *OPTIONAL))
"""All of these: what a camera is used with, not what it is built of."""
TIP = "tip"
"""Beside the places of a design: where a bore ends that its own stops do not show [mm before the main lens]."""
BESIDE = frozenset((TIP, HIATUS))
"""All numbers beside the places of a design."""


def numbers_of(design: Design) -> dict[str, Number]:
    """Number of a design at every dotted place [mm, rad]."""
    array = design.microlens_array
    parts = ("main_lens", *(opening.place for opening in design.openings), "microlens_array", "sensor")
    places = [place for place in PATHS.values() if place not in (PATHS["D_F"], PATHS["d_3"])]
    at_fap = [*PATHS].index("D_F")
    places[at_fap:at_fap] = [f"aperture.{key}" for key in design.aperture.number_keys]
    places += ["sensor.relay_magnification", "microlens_array.rotation"]
    places += [f"{stop.place}.{key}" for stop in design.openings[1:] for key in stop.part.number_keys]
    places += [f"{part}.{pose}.{axis}" for part in parts for pose in ("decentre", "tilt") for axis in (0, 1)]
    places += [f"{part}.size.{axis}" for part in ("microlens_array", "sensor") for axis in (0, 1)]
    places += ["main_lens.outer_diameter"] * (design.main_lens.outer_diameter is not None)
    places += [f"sensor.package.{axis}" for axis in (0, 1) if design.sensor.package is not None]
    places += [f"{TYPES}{k}" for k in range(1, len(array.focal_lengths))]
    places += PHOTOMETRIC
    places += [place for place in OPTIONAL if at(design, place) is not None]
    if design.tube is not None:
        known = ("outer_diameter", "proximal_diameter", "wall", "light_guide", "length")
        places += [f"tube.{name}" for name in known if getattr(design.tube, name) is not None]
    if design.environment is not None:
        places.append(TEMPERATURE)
    lens = design.main_lens.kind
    beside = {TIP: lens.front, **({HIATUS: lens.hiatus(design.wavelength)} if lens.mounted else {})}
    return {**{place: design[place] for place in places}, **beside, **design.bore_numbers}


def possible(numbers: Mapping[str, Number], signed: Collection[str]) -> Iterator[tuple[str, Any]]:
    """Conditions that each number holds by itself, with the message where it does not.

    Parameters
    ----------
    numbers : mapping
        By place.
    signed : collection of str
        Places of further numbers that may be of either sign.
    """
    for place, value in numbers.items():
        part, _, name = place.partition(".")
        if ".tilt." in place or ".wedge." in place:
            yield f"{in_file(place)} is 90 degrees or more", np.abs(value) < np.pi / 2
            continue
        yield f"{in_file(place)} is not finite", np.isfinite(value)
        if place in (TEMPERATURE, *TEMPERATURES):
            yield f"{place} is beyond {COLDEST:g} to {HOTTEST:g} degC", np.clip(value, COLDEST, HOTTEST) == value
        if place in (TEMPERATURE, HIATUS, *TEMPERATURES, PATHS["d_f"], PATHS["d_3"]):
            continue
        if place == TIP or (name.endswith("distance") and part in ("stops", "elements")):
            yield f"{in_file(place)} is below 0", np.asarray(value) >= 0
        elif name.endswith("index"):
            yield f"{in_file(place)} is below 1", np.asarray(value) >= 1
        elif name in NOT_NEGATIVE:
            yield f"{in_file(place)} is below 0", np.asarray(value) >= 0
        elif place not in signed and ".decentre." not in place and not place.endswith(SIGNED):
            yield f"{in_file(place)} is not above 0", np.asarray(value) > 0
