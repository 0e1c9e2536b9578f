"""Many designs that differ in some values: any parameter an array, still one immutable value."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..theory.conjugates import focal_length, focal_plane_distance, mla_distance
from .check import CONJUGATES
from .design import Design
from .errors import DesignError, Problem
from .parameters import PATHS, Parameters
from .real_lens import focal_length_at

Array = NDArray[np.float64]


class DesignBatch:
    """A base design with arrays in place of some values.

    Parameters
    ----------
    base : Design
        Gives every value that is not varied.
    values : mapping, optional
        Dotted places to arrays that broadcast together, e.g. ``{"aperture.decentre.0": [...]}``.
    **symbols
        The same by the paper's symbols, e.g. ``d_3=np.linspace(0, 200, 50)``.

    Raises
    ------
    DesignError
        Unknown places, arrays that do not broadcast or are not finite, all three of f, d_f and d_1 varied.

    Notes
    -----
    Of f, d_f and d_1 the same one follows as in `Design.replace`. A batch may hold combinations that are no design
    (d_3 >= d_f and the like): `valid` tells which are, and `batch[i]` raises for those that are not.
    """

    def __init__(self, base: Design, values: Mapping[str, ArrayLike] | None = None, /, **symbols: ArrayLike) -> None:
        unknown = [name for name in symbols if name not in PATHS]
        if unknown:
            known = ", ".join(PATHS)
            raise DesignError(tuple(Problem(name, f"is not a symbol of a design; known: {known}") for name in unknown))
        given = {**(values or {}), **{PATHS[name]: value for name, value in symbols.items()}}
        if "q" in symbols:
            given[PATHS["q"]] = np.multiply(symbols["q"], base.sensor.relay_magnification)
        if base.main_lens.prescription is not None:
            _check_lens_keeps_f(given)
        if all(key in given for key in CONJUGATES):
            raise DesignError((Problem(", ".join(CONJUGATES), "vary two of these; the third follows"),))
        self._base = base
        self._values = {place: _frozen(place, value) for place, value in sorted(given.items())}
        for place in self._values:
            base.replace({place: _value_at(base, place)})  # an unknown place is an error here, not later
        try:
            self._shape: tuple[int, ...] = np.broadcast_shapes(*(value.shape for value in self._values.values()))
        except ValueError:
            shapes = ", ".join(f"{place} {value.shape}" for place, value in self._values.items())
            raise DesignError((Problem("", f"shapes do not broadcast together: {shapes}"),)) from None

    @property
    def base(self) -> Design:
        """The design that gives what is not varied."""
        return self._base

    @property
    def values(self) -> Mapping[str, Array]:
        """The varied places and their (read-only) arrays."""
        return dict(self._values)

    @property
    def shape(self) -> tuple[int, ...]:
        """Common shape of the varied arrays."""
        return self._shape

    def __len__(self) -> int:
        if not self._shape:
            raise TypeError("a batch of one design has no length")
        return self._shape[0]

    def get(self, place: str) -> Array | Any:
        """The array at a varied place, else the base design's value there."""
        return self._values[place] if place in self._values else _value_at(self._base, place)

    @property
    def parameters(self) -> Parameters:
        """The numbers under the paper's symbols; arrays where varied or following from what is."""
        numbers = {symbol: self._symbol(symbol) for symbol in PATHS}
        f, d_f, d_1 = self._conjugates()
        return Parameters(**{**numbers, "f": f, "d_f": d_f, "d_1": d_1})

    def _symbol(self, symbol: str) -> Array | float:
        place = PATHS[symbol]
        if symbol == "q":
            value: Array | float = np.asarray(self.get(place)) / np.asarray(self.get("sensor.relay_magnification"))
            return value if np.ndim(value) else float(value)
        return self._values[place] if place in self._values else float(getattr(self._base, symbol))

    def _conjugates(self) -> tuple[Array | float, Array | float, Array | float]:
        base = self._base
        focal, plane, distance = CONJUGATES
        f = self._values.get(focal, base.f)
        d_f = self._values.get(plane, base.d_f)
        d_1 = self._values.get(distance, base.d_1)
        colours = self._values.get(PATHS["wavelength"])
        if base.main_lens.prescription is not None and colours is not None:
            f = np.asarray(np.vectorize(partial(focal_length_at, base.main_lens.prescription), otypes=[float])(colours))
            if plane not in self._values and base.microlens_array.distance is None and distance not in self._values:
                return f, d_f, mla_distance(f, d_f)
            if plane not in self._values:
                return f, focal_plane_distance(f, d_1), d_1
        if plane in self._values and distance in self._values:
            return focal_length(d_f, d_1), d_f, d_1
        if plane in self._values:
            return f, d_f, mla_distance(f, d_f)
        if focal in self._values or distance in self._values:
            return f, focal_plane_distance(f, d_1), d_1
        return f, d_f, d_1

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Which combinations are designs: positive sizes, a real image, every stop nearer than the object plane."""
        p = self.parameters
        with np.errstate(invalid="ignore"):
            good = (np.asarray(p.d_f) > p.f) & (np.asarray(p.d_1) > p.f)
            for size in (p.D, p.f, p.D_F, p.d, p.f_ml, p.d_2, p.q, p.wavelength):
                good = good & (np.asarray(size) > 0)
            for stop in ("aperture", *(f"stops.{index}" for index in range(len(self._base.stops)))):
                reach = np.asarray(self.get(f"{stop}.distance"))
                good = good & (reach >= 0) & (reach < p.d_f) & (np.asarray(self.get(f"{stop}.diameter")) > 0)
        return np.broadcast_to(good, self._shape)

    def __getitem__(self, index: int | tuple[int, ...]) -> Design:
        changes = {place: float(np.broadcast_to(value, self._shape)[index]) for place, value in self._values.items()}
        return self._base.replace(changes)

    def __iter__(self) -> Iterator[Design]:
        return (self[index] for index in np.ndindex(self._shape))

    def replace(self, values: Mapping[str, ArrayLike] | None = None, /, **symbols: ArrayLike) -> DesignBatch:
        """A new batch with further or other arrays."""
        return DesignBatch(self._base, {**self._values, **(values or {})}, **symbols)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, DesignBatch):
            return NotImplemented
        same = self._base == other._base and self._values.keys() == other._values.keys()
        return same and all(np.array_equal(value, other._values[place]) for place, value in self._values.items())

    def __hash__(self) -> int:
        return hash((self._base, *((place, value.shape, value.tobytes()) for place, value in self._values.items())))

    def __repr__(self) -> str:
        varied = ", ".join(f"{place} {value.shape}" for place, value in self._values.items())
        return f"DesignBatch({self._base.name!r}, {varied or 'nothing varied'})"


def _check_lens_keeps_f(given: Mapping[str, Any]) -> None:
    """Two of f, d_f and d_1 varied would vary f, which a real lens's prescription gives."""
    focal, plane, distance = CONJUGATES
    if focal in given:
        raise DesignError((Problem(focal, "follows from the main lens's prescription; it cannot be varied by itself"),))
    if plane in given and distance in given:
        message = "vary one of these; the other follows from the main lens's prescription"
        raise DesignError((Problem(f"{plane}, {distance}", message),))


def _frozen(place: str, value: ArrayLike) -> Array:
    array = np.array(value, dtype=float)
    if not np.all(np.isfinite(array)):
        raise DesignError((Problem(place, "holds values that are not finite"),))
    array.setflags(write=False)
    return array


def _value_at(design: Design, place: str) -> Any:
    resolved = {**dict(zip(CONJUGATES, ("f", "d_f", "d_1"), strict=True)), PATHS["D"]: "D"}
    if place in resolved:
        return getattr(design, resolved[place])
    value: Any = design
    try:
        for step in place.split("."):
            value = value[int(step)] if isinstance(value, tuple) else getattr(value, step)
    except (AttributeError, IndexError, ValueError):
        raise DesignError((Problem(place, "is not a place in this design"),)) from None
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise DesignError((Problem(place, "is not a number of the design, so it cannot be varied"),))
    return value
