"""Bounds over boxes of variables, for many combinations of parts at once: what cannot be feasible, or not good enough.

The closed forms rise or fall in each single length throughout, whichever way; then their extremes over a box lie at its
corners, and corners are cheap. Quantities for which that does not hold bound nothing, and rule nothing out.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from ..design.check import CONJUGATES
from .cameras import Cameras
from .combinations import Combinations
from .problem import ROOM, Constraint, Goal, Problem
from .quantities import SIGNED
from .variables import DERIVED, spread

Array = NDArray[np.float64]

ROUNDING = 1e-9
"""What bounds leave for rounding, relative."""


def prunable(problem: Problem, part: Constraint | Goal) -> bool:
    """Whether a quantity's extremes over boxes of these variables lie at corners."""
    quantity, names = part.quantity, {variable.place for variable in problem.variables}
    if not quantity.monotone or (problem.in_focus and quantity.name in ("f_ml", "microlens_defocus_px")):
        return False
    if names & (DERIVED.keys() - {"working_distance"}):
        return False
    if "working_distance" in names and quantity.name in (
        "total_length_mm",
        "vergence_at_mla_per_mm",
        "microlens_defocus_px",
    ):
        return False
    if problem.tip and "aperture.distance" in names:
        return False
    stops_matter = part.at is not None or quantity.name == "non_distortion_room_mm"
    moves = any(name == "aperture.distance" or name.startswith("stops.") for name in names)
    return not (problem.design.stops and moves and (stops_matter or quantity.name == "total_length_mm"))


class Boxes:
    """Boxes of scaled variables, each belonging to a combination."""

    def __init__(self, combinations: Combinations, owner: NDArray[np.intp], low: Array, high: Array) -> None:
        self.combinations, self.owner, self.low, self.high = combinations, owner, low, high

    def __len__(self) -> int:
        return len(self.owner)

    def where(self, keep: NDArray[np.bool_]) -> Boxes:
        """Some of them."""
        return Boxes(self.combinations, self.owner[keep], self.low[keep], self.high[keep])

    def split(self) -> Boxes:
        """Each in two, across its widest side."""
        axis = np.argmax(self.high - self.low, axis=1)
        row = np.arange(len(self))
        middle = (self.low[row, axis] + self.high[row, axis]) / 2
        left, right = self.high.copy(), self.low.copy()
        left[row, axis], right[row, axis] = middle, middle
        return Boxes(
            self.combinations,
            np.concatenate([self.owner, self.owner]),
            np.concatenate([self.low, right]),
            np.concatenate([left, self.high]),
        )

    def shaved(self, threshold: float) -> Boxes:
        """Each with the ends of its sides cut off where nothing feasible, or nothing below a merit, can lie."""
        low, high = self.low.copy(), self.high.copy()
        alive = np.ones(len(self), bool)
        for axis in range(low.shape[1]):
            side = high[:, axis] - low[:, axis]
            possible = np.empty((SLICES, len(self)), bool)
            for index in range(SLICES):
                left, right = low.copy(), high.copy()
                left[:, axis] = low[:, axis] + side * (index / SLICES)
                right[:, axis] = low[:, axis] + side * ((index + 1) / SLICES)
                possible[index] = Boxes(self.combinations, self.owner, left, right).bound() < threshold
            first = np.argmax(possible, axis=0)
            last = SLICES - np.argmax(possible[::-1], axis=0)
            alive &= possible.any(axis=0)
            start = low[:, axis].copy()
            low[:, axis] = np.where(first > 0, start + side * (first / SLICES), start)
            high[:, axis] = np.where(last < SLICES, start + side * (last / SLICES), high[:, axis])
        return Boxes(self.combinations, self.owner, low, high).where(alive)

    def bound(self) -> Array:
        """Least merit that a box can hold, shape (B,); infinite where nothing in it is feasible."""
        found = np.empty(len(self))
        for start in range(0, len(self), CHUNK):
            piece = slice(start, start + CHUNK)
            found[piece] = _bound(self.combinations, self.owner[piece], self.low[piece], self.high[piece])
        return found


CHUNK = 8_000
"""Boxes evaluated at once: their corners stay in a processor's cache."""
SLICES = 5
"""Parts of a side that are tried when shaving."""


def _bound(combinations: Combinations, owner: NDArray[np.intp], low: Array, high: Array) -> Array:
    problem = combinations.problem
    n = problem.n
    corners = np.array(list(product((0.0, 1.0), repeat=n)))
    units = low + corners[:, None, :] * (high - low)
    values = {v.place: v.value(units[..., i]) for i, v in enumerate(problem.variables)}
    parts = combinations.values(owner)
    numbers = {**parts, **spread(values, problem.places)}
    focal = numbers.get(CONJUGATES[0], problem.places[CONJUGATES[0]])
    for place in CONJUGATES[1:]:
        if place in numbers and not (CONJUGATES[1] in numbers and CONJUGATES[2] in numbers):
            # What lies beyond holds no camera; the corner moves to where cameras begin.
            numbers[place] = np.maximum(numbers[place], focal * (1 + 2 * ROOM))
    with np.errstate(all="ignore"):
        cameras = Cameras(problem.places, numbers, in_focus=problem.in_focus)
        shape = units.shape[:2]
        image = np.broadcast_to(cameras.d_f > cameras.f * (1 + ROOM), shape)
        ahead = np.broadcast_to(cameras.d_f * (1 - ROOM) > cameras.tip, shape)
        certain = image.all(axis=0)
        rows = (cameras, ahead, shape)
        # d_f > f and d_f > tip hold somewhere in the box only if they do at a corner: both are monotone.
        possible = image.any(axis=0) & (ahead | ~image).any(axis=0)
        for constraint in problem.constraints:
            if prunable(problem, constraint):
                possible &= ~(certain & _impossible(problem, constraint, *rows))
        merit = np.zeros(shape[1])
        weights = sum(goal.weight for goal in problem.goals)
        for index, goal in enumerate(problem.goals):
            if not prunable(problem, goal):
                merit[:] = -np.inf
                break
            least, most = _extremes(goal, *rows)
            best = least if goal.sign > 0 else most
            told = np.log(np.maximum(best, 0)) if goal.quantity.positive else best / problem.goal_scale(index)
            merit += goal.weight * goal.sign * told / weights
        merit = np.where(certain & ~np.isnan(merit), merit - ROUNDING * (1 + np.abs(merit)), -np.inf)
    return np.where(possible, merit, np.inf)


def _impossible(
    problem: Problem, constraint: Constraint, cameras: Cameras, ahead: NDArray[np.bool_], shape: tuple[int, ...]
) -> NDArray[np.bool_]:
    """Whether no camera in a box, that has its focal plane in front of the bore, holds a constraint."""
    quantity, low, high = constraint.quantity, constraint.low, constraint.high
    if quantity.name == "non_distortion_room_mm" and high is None and low is not None:
        # Times twice the gap it has no pole where the focal plane comes to the bore.
        gap = cameras.d_f - cameras.d_3
        cleared = 2 * gap * (quantity.of(cameras, None) - low)
        every = np.broadcast_to(cleared, (len(cleared), *shape))
        size = ROUNDING * np.abs(every).max(axis=1)
        return np.asarray((every.max(axis=1) < -size).any(axis=0))
    if quantity.name == "microlens_defocus_px" and low is None and high is not None:
        gap = cameras.d_f - cameras.d_3
        signed, most = np.broadcast_to(gap * SIGNED[quantity.name](cameras, None), shape), high * gap
        size = ROUNDING * (np.abs(signed).max(axis=0) + np.abs(most).max())
        return np.asarray(((signed - most).min(axis=0) > size) | ((-signed - most).min(axis=0) > size))
    least, greatest = _extremes(constraint, cameras, ahead, shape)
    finite = np.where(np.isfinite(least), np.abs(least), 0) + np.where(np.isfinite(greatest), np.abs(greatest), 0)
    room = ROUNDING * (finite + abs(low or 0.0) + abs(high or 0.0))
    wrong = np.zeros(shape[1], bool)
    if low is not None:
        wrong |= greatest + room < low
    if high is not None:
        wrong |= least - room > high
    return wrong


def _extremes(
    part: Constraint | Goal, cameras: Cameras, ahead: NDArray[np.bool_], shape: tuple[int, ...]
) -> tuple[Array, Array]:
    """Least and greatest value in a box, over its cameras that have their focal plane in front of the bore."""
    quantity = part.quantity
    if quantity.name == "fill_factor":
        inverse = np.broadcast_to(
            cameras.d * (cameras.reach / cameras.d_2 + 1 - cameras.d_3 / cameras.f) / cameras.D_F, shape
        )
        least, most = inverse.min(axis=0), inverse.max(axis=0)
        # A box with images of no pitch in it has no largest fill factor.
        return np.where(most > 0, 1 / most, np.inf), np.where(least > 0, 1 / least, np.inf)
    every_ahead = ahead.all(axis=0)
    found = (SIGNED[quantity.name] if quantity.magnitude else quantity.of)(cameras, part.at)
    if quantity.worst is not None:
        every = np.broadcast_to(found, (len(found), *shape))
        least, most = quantity.worst(every.min(axis=1)), quantity.worst(every.max(axis=1))
        kind = "signed" if quantity.name == "non_distortion_room_mm" else "none"
    else:
        values = np.broadcast_to(found, shape)
        kind = _at_the_bore(part)
        inside = np.where(ahead, values, np.inf) if kind == "pole" else values
        least, most = inside.min(axis=0), values.max(axis=0)
    if kind == "pole":
        most = np.where(every_ahead, most, np.inf)
    elif kind == "zero":
        least = np.where(every_ahead, least, 0.0)
    elif kind == "signed":
        least, most = np.where(every_ahead, least, -np.inf), np.where(every_ahead, most, np.inf)
    if not quantity.magnitude:
        return least, most
    crosses = (least <= 0) & (most >= 0)
    sizes = np.abs(least), np.abs(most)
    return np.where(crosses, 0.0, np.minimum(*sizes)), np.maximum(*sizes)


def _at_the_bore(part: Constraint | Goal) -> str:
    """What a quantity does where the focal plane comes to the bore (d_f - d_3 -> 0): a pole, a zero, or nothing."""
    name = part.quantity.name
    if name in ("views_geometric", "light_sr") or (name in ("sigma_z_mm", *GROWING) and part.at is not None):
        return "pole"
    if name in ("f_number_pupil", "view_baseline_mm", "sigma_z_mm"):
        return "zero"
    return "signed" if name in ("vergence_at_mla_per_mm", "microlens_defocus_px") else "none"


GROWING = ("field_half_width_mm", "field_half_diagonal_mm", "object_sample_mm")
"""What grows with distance from the bore."""
