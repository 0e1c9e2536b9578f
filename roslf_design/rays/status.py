"""What became of a ray: kept, or which element took it."""

from __future__ import annotations

from enum import IntEnum


class Status(IntEnum):
    """Fate of one ray; stored as one byte. Codes from `APERTURE` on number the stops: stop k is ``APERTURE + k``."""

    KEPT = 0
    """Passed everything; forward, it landed in its own microlens's cell."""
    MAIN_LENS = 1
    """Clipped by the main lens's clear aperture."""
    MICROLENS = 2
    """Outside the clear aperture of its microlens."""
    OFF_SENSOR = 3
    """Forward only: missed the sensor."""
    NEIGHBOUR = 4
    """Forward only: landed on the sensor, outside its own microlens's cell."""
    UNTRACEABLE = 5
    """Meets some element from behind, along its plane or at infinity, or is not finite: no light travels there."""
    APERTURE = 16
    """Clipped by the flexible angular plane (FAP), which is stop 0; further stops follow."""


MOST_STOPS = 256 - Status.APERTURE
"""Stops that one byte can tell apart."""

_NAMES = {
    Status.KEPT: "kept",
    Status.MAIN_LENS: "clipped by main lens",
    Status.MICROLENS: "outside its microlens",
    Status.OFF_SENSOR: "off the sensor",
    Status.NEIGHBOUR: "in a neighbour's cell",
    Status.UNTRACEABLE: "untraceable",
    Status.APERTURE: "clipped by flexible angular plane",
}


def describe(code: int) -> str:
    """Readable name of a status code.

    Parameters
    ----------
    code : int
        As found in a status array.

    Returns
    -------
    str
        E.g. ``"clipped by main lens"``, ``"clipped by stop 2"``.

    Raises
    ------
    ValueError
        A number that is no status.
    """
    if Status.APERTURE < code < Status.APERTURE + MOST_STOPS:
        return f"clipped by stop {code - Status.APERTURE}"
    try:
        return _NAMES[Status(code)]
    except ValueError:
        raise ValueError(
            f"{code} is not a ray status: expected 0 to 5, or {Status.APERTURE} + a stop's index"
        ) from None
