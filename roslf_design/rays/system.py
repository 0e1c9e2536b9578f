"""What the ray engine needs to know of a camera: plain numbers, any of which may be an array over trials."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from ..design import Design, DesignBatch
from .status import MOST_STOPS

Scalar = float | NDArray[np.float64]
"""One number, or one per trial."""
Pair = tuple[Scalar, Scalar]
"""(x, y), each a number or one per trial."""


@dataclass(frozen=True, eq=False)
class Part:
    """Base of the engine's values: compared and hashed by their numbers, arrays included."""

    def leaves(self) -> Iterator[Any]:
        """Every number, array and name of this value, in the order of its fields."""
        for item in fields(self):
            yield from _leaves(getattr(self, item.name))

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        mine, theirs = list(self.leaves()), list(other.leaves())
        return len(mine) == len(theirs) and all(np.array_equal(a, b) for a, b in zip(mine, theirs, strict=True))

    def __hash__(self) -> int:
        # Adding 0 makes -0 and 0, which are equal, hash alike.
        return hash(tuple(x if isinstance(x, str) else (np.asarray(x) + 0.0).tobytes() for x in self.leaves()))


@dataclass(frozen=True, eq=False)
class Lens(Part):
    """The main lens: ideal, thin, at z = 0."""

    focal_length: Scalar
    """f [mm]."""
    diameter: Scalar
    """D [mm]; inf for a lens that never clips."""
    decentre: Pair = (0.0, 0.0)
    """[mm]."""
    tilt: Pair = (0.0, 0.0)
    """[rad]."""


@dataclass(frozen=True, eq=False)
class Stop(Part):
    """A circular opening in object space at z = -distance; a negative distance means the object-side ray prolonged."""

    diameter: Scalar
    """D_k [mm]."""
    distance: Scalar
    """z_k [mm], in front of the main lens."""
    decentre: Pair = (0.0, 0.0)
    """e_k [mm]."""
    tilt: Pair = (0.0, 0.0)
    """[rad]."""


@dataclass(frozen=True, eq=False)
class Array(Part):
    """The microlens array (MLA), a rigid plate of ideal thin lenses."""

    distance: Scalar
    """d_1 [mm]."""
    focal_length: Scalar
    """f_ml [mm]."""
    pitch: Scalar
    """d [mm]: lattice constant, and the width of one microlens's clear aperture."""
    layout: Literal["square", "hexagonal"] = "square"
    """Packing; hexagonal rows run along x."""
    lens_shape: Literal["square", "circular"] = "square"
    """Clear aperture of one microlens."""
    decentre: Pair = (0.0, 0.0)
    """[mm]."""
    tilt: Pair = (0.0, 0.0)
    """[rad]."""
    rotation: Scalar = 0.0
    """About the plate's own normal [rad]."""


@dataclass(frozen=True, eq=False)
class Sensor(Part):
    """The photosensor, as seen at the MLA's image plane."""

    distance: Scalar
    """d_2 [mm], from the MLA."""
    size: Pair = (np.inf, np.inf)
    """Width and height [mm]; inf where nothing falls off it."""
    decentre: Pair = (0.0, 0.0)
    """[mm]."""
    tilt: Pair = (0.0, 0.0)
    """[rad]."""


@dataclass(frozen=True, eq=False)
class System(Part):
    """A camera for the ray engine.

    Poses: every element has its own frame, whose origin (the element's vertex) lies on the axis at the element's z,
    moved by `decentre`, and whose axes are turned by `tilt`: the normal is z rotated by t_x about x, then by t_y about
    the fixed y; ``R = R_y(t_y) R_x(t_x)``, and the MLA first by its rotation, ``R_y R_x R_z``. Points on the
    MLA and on the sensor are given in those elements' own frames: a microlens and a pixel keep their coordinates
    when the part they belong to moves.

    Any number may be an array over trials; all broadcast together and against the rays' points.

    Raises
    ------
    ValueError
        No stop at all, too many, a size or distance that is not positive, shapes that do not broadcast.
    """

    lens: Lens
    """At z = 0."""
    stops: tuple[Stop, ...]
    """The flexible angular plane (FAP, the entrance pupil) first, then any further rims, in any order."""
    array: Array
    """At z = d_1."""
    sensor: Sensor
    """At z = d_1 + d_2."""

    def __post_init__(self) -> None:
        if not 1 <= len(self.stops) <= MOST_STOPS:
            raise ValueError(f"stops: {len(self.stops)} given; a system has a FAP and at most {MOST_STOPS - 1} more")
        positive = {
            "lens.diameter": self.lens.diameter,
            "array.distance": self.array.distance,
            "array.pitch": self.array.pitch,
            "sensor.distance": self.sensor.distance,
            **{f"stops.{k}.diameter": stop.diameter for k, stop in enumerate(self.stops)},
        }
        for key, value in positive.items():
            if not np.all(np.asarray(value) > 0):
                raise ValueError(f"{key}: {value} is not positive; give a length in mm above zero")
        for key, value in {"lens": self.lens.focal_length, "array": self.array.focal_length}.items():
            if np.any(np.asarray(value) == 0) or np.any(np.isnan(value)):
                raise ValueError(f"{key}.focal_length: {value} has no power; give a length in mm, not zero")
        try:
            _ = self.shape
        except ValueError:
            raise ValueError(
                "the system's arrays do not broadcast together; give every trial axis one length"
            ) from None

    @property
    def shape(self) -> tuple[int, ...]:
        """Common shape of the trials; () for one system."""
        return np.broadcast_shapes(*(np.shape(leaf) for leaf in self.leaves()))

    @property
    def aligned(self) -> bool:
        """Whether nothing is tilted or rotated in any trial; decentres are allowed."""
        turned = [
            *self.lens.tilt,
            *self.array.tilt,
            *self.sensor.tilt,
            *(angle for stop in self.stops for angle in stop.tilt),
        ]
        return not any(np.any(angle) for angle in (*turned, self.array.rotation))

    def spread(self, axes: int) -> System:
        """The same trials with `axes` axes of length 1 behind them, where fields or rays shall go."""
        behind = (1,) * axes
        spread: System = _mapped(self, lambda leaf: leaf.reshape(leaf.shape + behind) if np.ndim(leaf) else leaf)
        return spread

    def trial(self, index: int | tuple[int, ...]) -> System:
        """One system of a batch."""
        shape = self.shape
        one: System = _mapped(self, lambda leaf: float(np.broadcast_to(leaf, shape)[index]))
        return one

    @classmethod
    def from_design(cls, design: Design | DesignBatch) -> Self:
        """The camera of a design, or of a whole batch of designs.

        Parameters
        ----------
        design : Design or DesignBatch
            The sensor is taken as seen through its relay, if it has one.
        """
        get = design.get if isinstance(design, DesignBatch) else _places(design)
        base = design.base if isinstance(design, DesignBatch) else design
        p = design.parameters

        def pair(place: str) -> Pair:
            return get(f"{place}.0"), get(f"{place}.1")

        def pose(place: str) -> dict[str, Pair]:
            return {"decentre": pair(f"{place}.decentre"), "tilt": pair(f"{place}.tilt")}

        width, height = pair("sensor.size")
        relay = get("sensor.relay_magnification")
        return cls(
            lens=Lens(p.f, p.D, **pose("main_lens")),
            stops=tuple(
                Stop(get(f"{place}.diameter"), get(f"{place}.distance"), **pose(place))
                for place in ("aperture", *(f"stops.{k}" for k in range(len(base.stops))))
            ),
            array=Array(
                p.d_1,
                p.f_ml,
                p.d,
                base.microlens_array.layout,
                base.microlens_array.lens_shape,
                rotation=get("microlens_array.rotation"),
                **pose("microlens_array"),
            ),
            sensor=Sensor(p.d_2, (width / relay, height / relay), **pose("sensor")),
        )


def _leaves(value: Any) -> Iterator[Any]:
    if isinstance(value, Part):
        yield from value.leaves()
    elif isinstance(value, tuple):
        for item in value:
            yield from _leaves(item)
    else:
        yield value


def _mapped(value: Any, change: Callable[[Any], Any]) -> Any:
    """The same value with every number changed."""
    if isinstance(value, Part):
        return replace(value, **{item.name: _mapped(getattr(value, item.name), change) for item in fields(value)})
    if isinstance(value, tuple):
        return tuple(_mapped(item, change) for item in value)
    return value if isinstance(value, str) else change(value)


def _places(design: Design) -> Callable[[str], Any]:
    """Read a design by dotted places, as a batch does."""

    def get(place: str) -> Any:
        value: Any = design
        for step in place.split("."):
            value = value[int(step)] if isinstance(value, tuple) else getattr(value, step)
        return value

    return get
