"""Who takes a ray: elements mark what they clip, nearest the sensor first, so that the last mark is light's first."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from . import kernels as kn
from .constants import rims
from .frames import STOPS, Floats
from .status import Status
from .system import System

Bytes = NDArray[np.uint8]
Mask = NDArray[np.bool_]
Mark = tuple[Mask, int | Bytes]
"""Which rays an element takes, and the status it gives them; a later mark overrules an earlier one."""


def outside(x: Floats, y: Floats, radius: Floats) -> Mask:
    """Whether points miss a circular opening about the origin; on the rim they pass, not a number they miss."""
    return np.asarray(~(x * x + y * y <= radius * radius))


def finite(*values: Floats) -> Mask:
    """Whether all of several values are finite."""
    total: Floats = sum((value - value for value in values), np.zeros(()))
    return np.asarray(total == 0.0)


def stop_marks(
    system: System, maps: Floats, line: tuple[Floats, Floats, Floats, Floats], filled: Mask | None = None
) -> tuple[list[Mark], Mask]:
    """What the stops take of object-side rays, tilted discs that they are.

    Parameters
    ----------
    system : System
        Its stops.
    maps : ndarray
        Its `frames`.
    line : four ndarray
        Height and slope in the lens's frame: l_x, l_y, o_x, o_y.
    filled : ndarray of bool, optional
        Whether a ray passes the flexible angular plane, where that is known better than by tracing.

    Returns
    -------
    marks : list
        One a stop, the nearest first.
    forward : ndarray of bool
        Whether light meets every stop from in front.
    """
    marks: list[Mark] = []
    forward: Mask = np.asarray(True)
    places, codes = rims(system)
    for place, code in zip(places, codes, strict=True):
        index = code.astype(np.intp) - int(Status.APERTURE) + STOPS
        ax, ay, _, _, front = kn.crossing(np.take_along_axis(maps, index[None, None, None], axis=0)[0], *line)
        forward = forward & front
        taken = outside(ax, ay, place[3])
        marks.append((taken if filled is None else np.where(code == Status.APERTURE, ~filled, taken), code))
    return marks, forward


def verdict(shape: tuple[int, ...], marks: Iterable[Mark]) -> Bytes:
    """Status of every ray, `Status.KEPT` where no element marked it."""
    status = np.full(shape, Status.KEPT, np.uint8)
    for taken, code in marks:
        np.copyto(status, np.asarray(code, np.uint8), where=taken)
    return status
