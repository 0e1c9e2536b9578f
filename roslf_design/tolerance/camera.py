"""Many builds of one camera at once: every number a float where nominal, an array over trials where missed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..design import Design
from .algebra import Frame, Number, Vector, along, frame
from .places import nominal_values

FOCAL, PLANE, DISTANCE = "main_lens.focal_length", "main_lens.focal_plane", "microlens_array.distance"


@dataclass(frozen=True)
class Rim:
    """A circular opening: the flexible angular plane (FAP), the main lens, or a further stop."""

    radius: Number
    """[mm]."""
    distance: Number
    """In front of the main lens [mm]."""
    pose: Frame
    """In the main lens's frame."""


@dataclass(frozen=True)
class Camera:
    """Builds of a camera, elements posed in the main lens's frame (its vertex, its axes)."""

    f: Number
    d_f: Number
    d_1: Number
    d_2: Number
    d: Number
    f_ml: Number
    q: Number
    wavelength: Number
    world: Frame
    """The system's own axes, in which object points are given."""
    rims: tuple[Rim, ...]
    """FAP, main lens, then the further stops."""
    array: Frame
    """Microlens array."""
    sensor: Frame
    tilted: bool
    """Whether any element is tilted in any trial: the stops' images are then not exactly discs."""
    valid: NDArray[np.bool_]
    """Shape (trials,): which builds are designs at all; the others hold nominal numbers and mean nothing."""

    def microlens(self, x: Number, y: Number) -> Vector:
        """Where the array's point (x, y) [mm, in its own frame] lies in the lens's frame."""
        return along(self.array.origin, x, self.array.x, y, self.array.y)


def build(design: Design, values: Mapping[str, NDArray[np.float64]], trials: int) -> Camera:
    """Builds of a design.

    Parameters
    ----------
    design : Design
        Gives every number that is not missed.
    values : mapping
        Perturbable place to numbers, shape (trials,).
    trials : int
        How many.

    Notes
    -----
    Of f, d_f and d_1 the same one follows as in `Design.replace`: f and d_1 are hardware and d_f follows; where d_f is
    given, d_1 is refocused to it.
    """
    nominal = nominal_values(design)
    valid = _possible(design, values, nominal, trials)
    broken = not valid.all()
    numbers: dict[str, Number] = dict(nominal)
    for place, value in values.items():
        numbers[place] = np.where(valid, value, nominal[place]) if broken else value
    _follow(numbers, values)

    def pose(part: str, z: Number, roll: Number = 0.0) -> Frame:
        def pair(name: str) -> tuple[Number, Number]:
            return numbers[f"{part}.{name}.0"], numbers[f"{part}.{name}.1"]

        return frame(pair("decentre"), z, pair("tilt"), roll)

    lens = pose("main_lens", 0.0)
    nowhere = frame((0.0, 0.0), 0.0, (0.0, 0.0))
    stops = ["aperture", *(f"stops.{index}" for index in range(len(design.stops)))]
    rims = [
        Rim(
            numbers[f"{stop}.diameter"] / 2,
            numbers[f"{stop}.distance"],
            pose(stop, -numbers[f"{stop}.distance"]).seen_from(lens),
        )
        for stop in stops
    ]
    rims.insert(1, Rim(numbers["main_lens.diameter"] / 2, 0.0, nowhere))
    d_1, d_2 = numbers[DISTANCE], numbers["sensor.distance"]
    tilts = [value for place, value in numbers.items() if ".tilt." in place]
    return Camera(
        f=numbers[FOCAL],
        d_f=numbers[PLANE],
        d_1=d_1,
        d_2=d_2,
        d=numbers["microlens_array.pitch"],
        f_ml=numbers["microlens_array.focal_length"],
        q=numbers["sensor.pixel"] / numbers["sensor.relay_magnification"],
        wavelength=numbers["light.wavelength"],
        world=nowhere.seen_from(lens),
        rims=tuple(rims),
        array=pose("microlens_array", d_1, numbers["microlens_array.rotation"]).seen_from(lens),
        sensor=pose("sensor", d_1 + d_2).seen_from(lens),
        tilted=any(bool(np.any(value)) for value in tilts),
        valid=valid,
    )


def _follow(numbers: dict[str, Number], values: Mapping[str, NDArray[np.float64]]) -> None:
    f, d_f, d_1 = numbers[FOCAL], numbers[PLANE], numbers[DISTANCE]
    if PLANE in values and DISTANCE in values:
        numbers[FOCAL] = d_f * d_1 / (d_f + d_1)
    elif PLANE in values:
        numbers[DISTANCE] = f * d_f / (d_f - f)
    elif FOCAL in values or DISTANCE in values:
        numbers[PLANE] = f * d_1 / (d_1 - f)


def _possible(
    design: Design, values: Mapping[str, NDArray[np.float64]], nominal: Mapping[str, float], trials: int
) -> NDArray[np.bool_]:
    """Positive sizes, a real image, every stop nearer than the object plane."""
    good = np.ones(trials, bool)
    for place, value in values.items():
        good &= np.isfinite(value)
        if ".tilt." in place:
            good &= np.abs(value) < np.pi / 2
        if ".decentre." in place or ".tilt." in place or place.endswith("rotation"):
            continue
        good &= (
            value >= 0 if place.startswith(("aperture.dist", "stops.")) and place.endswith("distance") else value > 0
        )
    numbers: dict[str, Number] = {**nominal, **values}
    with np.errstate(all="ignore"):
        _follow(numbers, values)
        d_f = numbers[PLANE]
        good &= (d_f > numbers[FOCAL]) & (numbers[DISTANCE] > numbers[FOCAL])
        for stop in ("aperture", *(f"stops.{index}" for index in range(len(design.stops)))):
            good &= numbers[f"{stop}.distance"] < d_f
    return good
