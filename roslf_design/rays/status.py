"""What became of a ray: kept, or which element took it."""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera

Mask = NDArray[np.bool_]


class Status(IntEnum):
    """Fate of one ray; stored as one byte. Codes from `APERTURE` on number the stops: stop k is ``APERTURE + k``."""

    KEPT = 0
    """Passed everything; it landed in its own microlens's cell."""
    MAIN_LENS = 1
    """Clipped by the main lens's clear aperture."""
    MICROLENS = 2
    """Outside the clear aperture of its microlens."""
    OFF_SENSOR = 3
    """Missed the sensor."""
    NEIGHBOUR = 4
    """Landed on the sensor, outside its own microlens's cell."""
    UNTRACEABLE = 5
    """Meets some element from behind, along its plane or at infinity, or is not finite: no light travels there."""
    APERTURE = 16
    """Clipped by the flexible angular plane (FAP), which is stop 0; further stops follow."""


PASSED = (int(Status.KEPT), int(Status.NEIGHBOUR), int(Status.OFF_SENSOR))
"""Past every rim, wherever on the sensor's plane it landed."""

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
    """Readable name of a status code: "clipped by main lens", "clipped by stop 2".

    Raises
    ------
    ValueError
        A number that is no status.
    """
    if Status.APERTURE < code <= 255:
        return f"clipped by stop {code - Status.APERTURE}"
    try:
        return _NAMES[Status(code)]
    except ValueError:
        raise ValueError(
            f"{code} is not a ray status: expected 0 to 5, or {Status.APERTURE} + a stop's index"
        ) from None


def status_of(
    camera: Camera,
    shape: tuple[int, ...],
    passes: Mapping[str, Mask],
    *,
    on_sensor: Mask,
    own_cell: Mask,
    traceable: Mask,
) -> NDArray[np.uint8]:
    """Status of every ray: who takes it first, in the order of light.

    Parameters
    ----------
    camera : Camera
    shape : tuple of int
        Of the rays; the masks broadcast to it.
    passes : mapping
        Rim's name to whether a ray would pass it.
    on_sensor, own_cell, traceable : ndarray of bool
        Whether a ray that passes everything meets the sensor, in its own cell; whether there is light at all.
    """
    codes = {"FAP": int(Status.APERTURE), "main lens": int(Status.MAIN_LENS)}
    codes |= {rim.name: Status.APERTURE + k for k, rim in enumerate(camera.rims[1:], 1)}
    status = np.full(shape, Status.KEPT, np.uint8)
    # Light's first obstacle overrules what would take the ray later.
    np.copyto(status, np.uint8(Status.NEIGHBOUR), where=~own_cell)
    np.copyto(status, np.uint8(Status.OFF_SENSOR), where=~on_sensor)
    for rim in reversed(camera.in_light_order):
        np.copyto(status, np.uint8(codes[rim.name]), where=~passes[rim.name])
    np.copyto(status, np.uint8(Status.UNTRACEABLE), where=~traceable)
    return status
