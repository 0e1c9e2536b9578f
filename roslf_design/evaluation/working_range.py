"""The working range: from where single views are sharp to where they are no more, or depth is of little use."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from ..camera import Camera
from ..theory.depth_budget import DepthBudget, depth_budget
from ..theory.depth_of_field import depth_of_field
from ..theory.disparity_error import full_within
from ..theory.field_of_view import focus_ahead
from ..words import clauses, number

TENTH = 0.1
"""Share of the distance up to which its expanded uncertainty U leaves depth of use."""
RULE = f"U is {100 * TENTH:g} % of the distance"
"""House's rule of the end, in words."""
LOST = "more than half of the field has no depth, for full pixels"
"""House's rule of the beginning in a light that is too strong nearer, in words."""
FAR = 1e3
"""Distance that is looked about where the focal plane is at none [mm]."""
REACH, STEP, GUESS, CLOSE, LARGE = 5.0, 1.5, 0.1, 2e-3, 30.0
"""Logarithms: of how far, in distances of the focal plane, ends are looked for where views are sharp without end or up
to the tip; of a step; of what is added to a guess; of how well the end is known; the largest told from infinity."""
CLOSELY = 16
"""Steps to the far end in which it is looked where a texture may be too fine for views: farther, out of focus, these
blur it, and depth may be known again."""
BudgetAt = Callable[..., DepthBudget]
"""Budget of depth at a distance ahead of the tip [mm], with or without `worst`, as `depth_budget`."""


class WorkingRange(NamedTuple):
    """Distances ahead of the tip at which views are sharp and depth is of use [mm]."""

    near: float
    """Nearest at which single views are sharp."""
    sharp_to: float
    """Farthest at which they are."""
    useful_to: float
    """Farthest of these at which U is a tenth of the distance at most; infinite without end, NaN if none is."""
    lengths: str = "as drawn"
    """How its budget of depth takes lengths."""
    full_within: float = 0.0
    """Distance nearer than which full pixels leave most of the field without depth; 0 or infinite of even light."""

    @classmethod
    def of(cls, camera: Camera, budget: BudgetAt | None = None) -> WorkingRange:
        """Range of a camera, by its budget of depth; None is that of its lengths as drawn."""
        near, far = (float(end) for end in depth_of_field(camera, "view"))
        focus, full = float(focus_ahead(camera)), full_within(camera)
        start = focus if 0 < focus < math.inf else FAR
        start = start if start > full or full >= far else min(math.exp(GUESS) * full, far)
        budget = budget or partial(depth_budget, camera)
        focused = budget(start, worst=False)
        steps = CLOSELY if "depth.finest" in camera.numbers else 1
        useful = math.nan if full >= far else _useful_to(budget, max(near, full), start, focused, far, steps)
        return cls(near, far, useful, focused.lengths, full)

    @property
    def ends(self) -> tuple[float, float] | None:
        """Near and far end; None where depth is of little use wherever views are sharp."""
        near = max(self.near, self.full_within)
        return (near, min(self.sharp_to, self.useful_to)) if self.useful_to > near else None

    @property
    def label(self) -> str:
        """Name of the line on it, which says of which lengths it is."""
        return f"working range, {self.lengths}"

    @property
    def value(self) -> str:
        """Ends in words."""
        return "none" if self.ends is None else _from_to(*self.ends)

    @property
    def begins(self) -> str:
        """Reason why it begins where it does, in words; empty where single views are sharp from there on."""
        return f"nearer, {LOST}" if self.full_within > self.near else ""

    @property
    def stops(self) -> str:
        """Reason why it ends where it does, in words."""
        if self.useful_to < self.sharp_to:
            far = "infinity" if math.isinf(self.sharp_to) else f"{number(self.sharp_to, 3)} mm"
            return f"to where {RULE}; views are sharp to {far}"
        return "where single views are sharp"

    @property
    def remark(self) -> str:
        """Reasons for both ends, or why there is none, in words."""
        if self.ends is None:
            sharp = f"single views are sharp from {_from_to(self.near, self.sharp_to)}, but"
            if self.full_within >= self.sharp_to:
                return f"{sharp} {LOST}, there"
            nearer = f"nearer than {number(self.full_within, 3)} mm {LOST}" * bool(self.begins)
            return clauses(f"{sharp} {RULE} or more there", nearer)
        return clauses(self.begins, self.stops)


def ranges(
    within: WorkingRange | None,
) -> tuple[tuple[float, float] | None, tuple[float, float] | None, float | None, str | None, float]:
    """Ends of the working range and of sharp views, how far depth is of use, by which lengths, where pixels are full.

    None for what there is not.
    """
    if within is None:
        return None, None, None, None, 0.0
    useful = None if math.isnan(within.useful_to) else within.useful_to
    return within.ends, (within.near, within.sharp_to), useful, within.lengths, within.full_within


def _from_to(near: float, far: float) -> str:
    return f"{number(near, 3)} to {number(far, 3)} mm"


def _useful_to(budget: BudgetAt, near: float, focus: float, focused: DepthBudget, far: float, steps: int = 1) -> float:
    """Farthest sharp distance ahead of the tip at which U is a tenth of it at most [mm]; NaN where it is none."""

    def excess(at: float, known: DepthBudget | None = None) -> float:
        """Logarithm of U over a tenth of the distance, by that of the distance."""
        u = float((known or budget(math.exp(at), worst=False)).expanded_mm) / (TENTH * math.exp(at))
        return min(max(math.log(u), -LARGE), LARGE) if u > 0 else -LARGE

    start = math.log(focus)
    low, end = (start - REACH if near <= 0 else math.log(near)), (math.log(far) if far < math.inf else start + REACH)
    useful, below = start, excess(start, focused)
    high, above = start, below
    ends = [min(start - below + GUESS, end), end]  # U grows as the square, or faster
    if steps > 1:
        ends = [start + (end - start) * step / steps for step in range(1, steps + 1)]
    for high in ends if below <= 0 else ():
        if (above := excess(high)) > 0:
            break
        useful, below = high, above
    if above <= 0:
        return far
    while below > 0:
        high, above = useful, below
        if useful <= low:
            return math.nan
        useful = max(useful - STEP, low)
        below = excess(useful)
    while high - useful > CLOSE:
        # By the power law between both, the end that stays made less of (Illinois), so that both move.
        at = useful + (high - useful) * below / (below - above)
        at = min(max(at, useful + CLOSE / 2), high - CLOSE / 2)
        if (there := excess(at)) <= 0:
            useful, below, above = at, there, above / 2
        else:
            high, above, below = at, there, below / 2
    return math.exp(useful)
