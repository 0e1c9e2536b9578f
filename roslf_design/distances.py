"""Distances ahead of the tip, as the shell and Python take them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .errors import refusal
from .units import FARTHEST, read_quantity

Distance = float | str
"""Distance [mm], or text with its unit."""


def _millimetres(at: Distance | Sequence[Distance]) -> tuple[float, ...]:
    """One or several distances [mm]."""
    try:
        return tuple(
            read_quantity(one, "length") if isinstance(one, str) else float(one)
            for one in np.ravel(np.asarray(at, dtype=object)).tolist()  # numbers beside text stay numbers
        )
    except (TypeError, ValueError) as error:
        raise refusal("at", str(error)) from None


def one_distance(at: Distance | Sequence[Distance] | None) -> float | None:
    """Distance of what has a single one, from a number or a list of one; None where there is none.

    Raises
    ------
    InputError
        Several.
    """
    several = () if at is None else _millimetres(at)
    if len(several) > 1:
        raise refusal("at", f"{len(several)} distances given, and this has one; ask once for each")
    return several[0] if several else None


def check_distances(at: Distance | Sequence[Distance]) -> tuple[float, ...]:
    """Distances ahead of the tip [mm], one or several, each checked to be one.

    Raises
    ------
    InputError
        Text that is no length; what is not ahead of the tip.
    """
    several = _millimetres(at)
    for distance in several:
        if not 0 < distance <= FARTHEST["length"]:
            raise refusal(
                "at", f"{distance:g} mm is not ahead of the bore's tip, where it counts from; give more than 0"
            )
    return several
