"""A lens as it was made rather than as it was drawn: each function gives a new prescription, the old one stays.

Surfaces and elements are numbered from 1, from the scene to the sensor, as a drawing numbers them. An element is what
moves as one piece (`Prescription.elements`), so a cemented doublet tilts as a whole.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..errors import Problem
from .glass import AIR
from .prescription import LensError, Prescription, Surface

Array = NDArray[np.float64]


def with_radius_error(lens: Prescription, surface: int, change: float) -> Prescription:
    """Radius of curvature changed by `change` [mm].

    Raises
    ------
    LensError
        The surface is a plane (use `with_curvature_error`), or the radius would pass through zero.
    """
    old = _surface(lens, surface)
    if old.curvature == 0:
        raise _fault(f"surfaces.{surface}.radius", "is infinite; change its curvature instead")
    radius = old.radius + change
    if radius * old.radius <= 0:
        raise _fault(f"surfaces.{surface}.radius", f"{old.radius:g} mm changed by {change:g} mm turns it inside out")
    return _with(lens, surface, replace(old, curvature=1 / radius))


def with_curvature_error(lens: Prescription, surface: int, change: float) -> Prescription:
    """Curvature changed by `change` [1/mm]; right for planes too."""
    old = _surface(lens, surface)
    return _with(lens, surface, replace(old, curvature=old.curvature + change))


def with_thickness_error(lens: Prescription, surface: int, change: float) -> Prescription:
    """Thickness after a surface changed by `change` [mm]; what follows moves along."""
    old = _surface(lens, surface)
    if surface == len(lens.surfaces):
        raise _fault(f"surfaces.{surface}.thickness", "nothing follows the last surface; move the microlens array")
    return _with(lens, surface, replace(old, thickness=old.thickness + change))


def with_index_error(lens: Prescription, surface: int, change: float) -> Prescription:
    """Index of the glass after a surface changed by `change`."""
    old = _surface(lens, surface)
    if old.glass == AIR:
        raise _fault(f"surfaces.{surface}.glass", "is air, whose index is 1; name a surface that glass follows")
    return _with(lens, surface, replace(old, glass=old.glass.with_offset(change)))


def decentred(lens: Prescription, element: int, x: float, y: float) -> Prescription:
    """An element moved sideways by (x, y) [mm]."""
    return moved(lens, element, (x, y), (0.0, 0.0))


def tilted(lens: Prescription, element: int, alpha: float, beta: float) -> Prescription:
    """An element turned by alpha about x, then beta about y [rad], about the middle of its axis."""
    return moved(lens, element, (0.0, 0.0), (alpha, beta))


def moved(lens: Prescription, element: int, step: tuple[float, float], tilt: tuple[float, float]) -> Prescription:
    """An element turned as by `tilted` about the middle of its axis, then moved sideways."""
    groups = lens.elements
    if not 1 <= element <= len(groups):
        raise _fault("element", f"{element} does not exist; the lens has elements 1 to {len(groups)}")
    members = groups[element - 1]
    vertices = _vertices(lens)
    middle = (vertices[members[0]] + vertices[members[-1]]) / 2
    return _carried(lens, members, middle, np.array([*step, 0.0]), rotation(*tilt))


def turned(lens: Prescription, alpha: float, beta: float, pivot: float) -> Prescription:
    """The whole lens turned by alpha about x, then beta about y [rad], about the axis point at `pivot` along z [mm]."""
    members = tuple(range(len(lens.surfaces)))
    return _carried(lens, members, np.array([0.0, 0.0, pivot]), np.zeros(3), rotation(alpha, beta))


def surface_tilted(lens: Prescription, surface: int, alpha: float, beta: float) -> Prescription:
    """One surface turned about its own vertex [rad]: the wedge of an element."""
    old = _surface(lens, surface)
    return _with(lens, surface, replace(old, tilt=(old.tilt[0] + alpha, old.tilt[1] + beta)))


def axis_of(surface: Surface) -> Array:
    """Unit vector along a surface's own axis, image side."""
    alpha, beta = surface.tilt
    return np.array([math.sin(beta), -math.sin(alpha) * math.cos(beta), math.cos(alpha) * math.cos(beta)])


def rotation(alpha: float, beta: float) -> Array:
    """Matrix that turns by alpha about x, then by beta about y [rad], (3, 3)."""
    ca, sa, cb, sb = math.cos(alpha), math.sin(alpha), math.cos(beta), math.sin(beta)
    about_x = np.array([[1, 0, 0], [0, ca, -sa], [0, sa, ca]])
    about_y = np.array([[cb, 0, sb], [0, 1, 0], [-sb, 0, cb]])
    return np.asarray(about_y @ about_x)


def _vertices(lens: Prescription) -> Array:
    return np.array([[*s.shift[:2], z + s.shift[2]] for s, z in zip(lens.surfaces, lens.vertices, strict=True)])


def _carried(lens: Prescription, members: tuple[int, ...], pivot: Array, step: Array, turn: Array) -> Prescription:
    """Surfaces that move as one: turned about a pivot, then shifted."""
    vertices = _vertices(lens)
    surfaces = list(lens.surfaces)
    for index in members:
        old = surfaces[index]
        place = pivot + turn @ (vertices[index] - pivot) + step - [0.0, 0.0, lens.vertices[index]]
        axis = turn @ axis_of(old)
        tilt = (math.atan2(-axis[1], axis[2]), math.atan2(axis[0], math.hypot(axis[1], axis[2])))
        surfaces[index] = replace(old, shift=_floats(place), tilt=tilt)
    return replace(lens, surfaces=tuple(surfaces))


def _floats(values: Iterable[float]) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _surface(lens: Prescription, number: int) -> Surface:
    if not 1 <= number <= len(lens.surfaces):
        raise _fault("surface", f"{number} does not exist; the lens has surfaces 1 to {len(lens.surfaces)}")
    return lens.surfaces[number - 1]


def _with(lens: Prescription, number: int, surface: Surface) -> Prescription:
    return replace(lens, surfaces=(*lens.surfaces[: number - 1], surface, *lens.surfaces[number:]))


def _fault(key: str, message: str) -> LensError:
    return LensError((Problem(key, message),))
