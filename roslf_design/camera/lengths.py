"""Lengths of a camera under two names: by a ruler, and as the main lens sees them.

Through windows, liquids and lenses the main lens sees a plane elsewhere than a ruler finds it: in a cystoscope the FAP
stands 62.84 mm before it and is seen at 0.0052 mm. Closed forms know the air before the main lens only, and so what is
seen.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from .._arrays import Array, floats, product, ratio
from ..bore.chain import Chain, ImagedPlane
from ..bore.opening import ClearAperture
from ..bore.part import Number
from ..design.parts import PATHS, RulerSymbols
from .rims import Rim


class _Viewer(Protocol):
    """A camera, as far as its apparent lengths follow from it."""

    chain: Chain

    @property
    def f(self) -> Number:
        """Focal length [mm]."""

    @property
    def focus(self) -> ImagedPlane:
        """The focal plane."""

    @property
    def fap(self) -> Rim:
        """The FAP."""

    @property
    def numbers(self) -> Mapping[str, Number]:
        """Every place and its number."""

    @property
    def apparent(self) -> dict[str, Any]:
        """Apparent lengths as far as they were worked out."""


class RulerLengths(RulerSymbols[Number]):
    """Lengths of a camera by a ruler, each one or many."""

    def __init__(self, numbers: Mapping[str, Number]) -> None:
        self._numbers = numbers

    def __getitem__(self, place: str) -> Number:
        return self._numbers[place]

    @property
    def D_F(self) -> Number:
        """FAP diameter [mm]; of a rectangle the wider of its extents along x and y."""
        return ClearAperture.of(self._numbers, "aperture").width


T = TypeVar("T")


class _worked_out_once(Generic[T]):  # noqa: N801
    """Property that is worked out once for each camera, which keeps it: nothing refers back to the camera."""

    def __init__(self, form: Callable[[ApparentLengths], T]) -> None:
        self.form, self.name = form, form.__name__
        self.__doc__ = form.__doc__

    def __get__(self, lengths: ApparentLengths | None, _: type) -> T:
        if lengths is None:
            return self  # type: ignore[return-value]
        known: dict[str, Any] = lengths._camera.apparent
        if self.name not in known:
            known[self.name] = self.form(lengths)
        value: T = known[self.name]
        return value


class ApparentLengths:
    """Lengths of a camera as its main lens sees them, each one or many, and what follows from them."""

    __slots__ = ("_camera",)

    def __init__(self, camera: _Viewer) -> None:
        self._camera = camera

    @_worked_out_once
    def d_f(self) -> Number:
        """Focal plane before the main lens, as that sees it [mm]."""
        return self._camera.focus.distance

    @_worked_out_once
    def d_3(self) -> Number:
        """FAP before the main lens, as that sees it [mm]."""
        return self._camera.fap.distance

    @_worked_out_once
    def D_F(self) -> Number:
        """FAP diameter, as the main lens sees it [mm]; of a rectangle the wider of its extents along x and y.

        Below 0 where it is seen beyond the focal plane, behind a relay: D_F H is the size of what every microlens sees.
        """
        if self._camera.chain.in_air:
            return self._camera.fap.outline.width
        return np.asarray(np.where(np.real(self.inverse_H) < 0, -1.0, 1.0) * self._camera.fap.outline.width)[()]

    @_worked_out_once
    def d_1(self) -> Number:
        """Main lens to microlens array, reduced to air [mm]."""
        geometric = self._camera.numbers[PATHS["d_1"]]
        return geometric - self._camera.chain.before_array(self._camera.numbers)

    @_worked_out_once
    def d_2(self) -> Number:
        """Microlens array to sensor, reduced to air [mm]."""
        geometric = self._camera.numbers[PATHS["d_2"]]
        return geometric - self._camera.chain.behind_array(self._camera.numbers)

    @_worked_out_once
    def inverse_H(self) -> Array:
        """Inverse aperture constant ``1/H = (d_f - d_3)/d_f``: 0 at d_3 = d_f, 1 at d_3 = 0, never infinite. Eq. 3."""
        return ratio(self.gap, self.d_f)

    @_worked_out_once
    def H(self) -> Array:
        """Aperture constant ``H = d_f/(d_f - d_3)``; inf at d_3 = d_f, negative beyond. Eq. 3."""
        return ratio(self.d_f, self.gap)

    @_worked_out_once
    def A(self) -> Array:
        """Effective image distance ``A = d_1/H = f (d_f - d_3)/(d_f - f)`` [mm]; A/D_F is the pupil's f-number."""
        return self._camera.f * ratio(self.gap, self.d_f - self._camera.f)

    @_worked_out_once
    def m(self) -> Array:
        """Image-side magnification ``m = d_1/d_f = f/(d_f - f)``; 0 at d_f = inf, inf at d_f = f."""
        return ratio(self._camera.f, self.d_f - self._camera.f)

    @_worked_out_once
    def inverse_m(self) -> Array:
        """Object-side millimetres per millimetre on the array, ``d_f/d_1 = (d_f - f)/f``."""
        return ratio(self.d_f - self._camera.f, self._camera.f)

    @_worked_out_once
    def gap(self) -> Array:
        """Depth ``g = d_f - d_3`` of the focal plane measured from the FAP [mm]."""
        df, d3 = floats(self.d_f, self.d_3)
        return df - d3

    @_worked_out_once
    def vergence(self) -> Array:
        """Vergence 1/L of the exit pupil at the array, ``(f - d_3)(d_f - f)/(f^2 (d_f - d_3))`` [1/mm].

        Exactly 0 at d_3 = f (telecentric), 1/d_1 at d_3 = 0, positive for a pupil before the array, inf at d_3 = d_f.
        """
        return (
            product((self._camera.f - self.d_3) / self._camera.f, ratio(self.d_f - self._camera.f, self.gap))
            / self._camera.f
        )
