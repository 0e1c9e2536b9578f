"""Planes of the scene that numbers are told at: ends of the working range, the focal plane, what is asked for."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ..camera import Camera
from ..theory import field_of_view
from .working_range import WorkingRange

AT_TIP = 0.01
"""Share of the focal plane's distance: what begins nearer counts as beginning at the tip."""
BEYOND = 2.0
"""Where the working range has no end, the data sheet's farthest plane, in distances of the focal plane."""
FOCUS, ASKED = "focal plane", "asked for"
Station = tuple[str, float]
"""Name of a plane, and its distance ahead of the tip [mm]."""


def planes(camera: Camera, asked: Sequence[float] = (), within: WorkingRange | None = None) -> tuple[Station, ...]:
    """Near end of the working range, focal plane and far end, then the distances asked for [mm ahead of the tip].

    Where the range begins at the tip, half of the focal plane's distance stands for its near end; where views are sharp
    without end, and depth of use that far, `BEYOND` times that for the far one. Of no working range the ends are those
    at which views are sharp.
    """
    focus = float(field_of_view.focus_ahead(camera))
    within = WorkingRange.of(camera) if within is None else within
    near, far = within.ends or (within.near, within.sharp_to)
    first = ("near end", near) if near > AT_TIP * focus else ("half the focus", focus / 2)
    endless = math.isinf(within.sharp_to) and far > BEYOND * focus
    last = ("twice the focus", BEYOND * focus) if endless else ("far end", far)
    return (first, (FOCUS, focus), last, *((ASKED, at) for at in asked))
