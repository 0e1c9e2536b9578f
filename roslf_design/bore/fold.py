"""Folds of the axis: where directions and points of unfolded space really are."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def fold_of(turn: float, towards: float, reverses: bool) -> Floats:
    """Directions beyond a fold by those of the axis gone straight on, (3, 3).

    Parameters
    ----------
    turn : float
        Angle by which it turns the view [rad].
    towards : float
        Direction into which it does, across the axis from x towards y [rad].
    reverses : bool
        Whether it reverses along that direction, as an odd number of reflections does.
    """
    (c, s), (ahead, aside) = (math.cos(turn), math.sin(turn)), (math.cos(towards), math.sin(towards))
    roll = np.array([[ahead, -aside, 0.0], [aside, ahead, 0.0], [0.0, 0.0, 1.0]])
    own = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]]) * [-1.0 if reverses else 1.0, 1.0, 1.0]
    return np.asarray(roll @ own @ roll.T)
