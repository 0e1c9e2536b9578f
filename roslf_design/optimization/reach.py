"""Fields and detail that no choice within the bounds can give, beyond what the bore's rims let through.

Rims are as the corners of the box of variables have them. What is told is proven: of anything else, as of glass that
varies, nothing is.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from .._arrays import Array
from ..design import PATHS, Stop
from ..design.required import ROUND_ANGLE, ROUND_RADIUS
from ..theory.limits import limits
from ..theory.vignetting import passed
from ..words import length, number
from .bounds import extremes, prunable
from .conflict import Conflict, Violation
from .goals import Constraint
from .lens_variables import varies_lens
from .problem import DesignProblem
from .variables import places_of, tied

MOST_VARIED = 12
"""Variables of which all corners are looked at."""
DETAILS = {"detail_lp_per_mm": (0.404, 0.5), "mtf10_lp_per_mm": (0.806, 0.9), "mtf50_lp_per_mm": (0.404, 0.5)}
"""Shares of the cut-off frequency at which the overlap of a disc with itself, and of anything convex, has fallen to the
contrast that is asked for; the second is a bound."""
OF_PLANES = ROUND_RADIUS, "field_half_width_mm", "field_half_height_mm", "field_half_diagonal_mm"
OF_ANGLES = {
    ROUND_ANGLE: 2, "field_half_angle_deg": 1,
    **{f"field_of_view_{way}deg": 2 for way in ("", "width_", "height_")},
}  # fmt: skip
"""How many times the steepest chief ray's angle they are at most."""
OF_LIGHT = "relative_illumination", "kept_fraction"
FROM_TIP = tuple(f"tip_{name}" for name in OF_ANGLES if name.startswith("field_of_view"))


class Unreachable(NamedTuple):
    """A limit beyond what the bore's rims let through, whatever the lens."""

    constraint: int
    """Index among the problem's constraints; -1 of what single fields are to have."""
    missed: Violation
    """Limit, and the nearest to it that light through the bore comes."""
    words: str
    """Limit, what stands against it, and the remedy."""

    @property
    def short(self) -> float:
        """Logarithm of how many times what is possible is wanted, either way."""
        return abs(math.log(self.missed.wanted / self.missed.value)) if self.missed.value > 0 else math.inf


def unreachable(
    problem: DesignProblem, rims: Sequence[Stop] = (), chosen: Sequence[str] = (), required: bool = False
) -> list[Unreachable]:
    """Limits of a problem that no camera within the bounds holds, for its bore.

    Parameters
    ----------
    problem : DesignProblem
        As posed.
    rims : sequence of Stop
        Those of a bore for which one stop is to stand; that one is not asked, as nobody knows it yet.
    chosen : sequence of str
        Kinds of parts to choose, of which nothing is known.
    required : bool
        Whether all that the design requires is held.
    """
    base, mounted = problem.base, bool(problem.design.main_lens.kind.mounted)
    moved = places_of(problem.variables)
    glass = any(name.startswith("elements.") or (mounted and varies_lens(name)) for name in moved)
    glass |= "windows" in chosen or (PATHS["wavelength"] in moved and bool(base.chain.elements))
    bent = base.chain.bends or base.chain.mapped or base.chain.folding or base.leaning or base.chain.stop_behind
    if glass or bent or problem.n > MOST_VARIED or tied(problem.variables):
        return []
    if rims:
        problem = replace(problem, design=problem.design.replace({"stops": tuple(rims)}))
    bore = _Bore(problem, ("main_lens",) * (mounted or "lenses" in chosen) + ("aperture",) * bool(rims))
    with np.errstate(all="ignore"):
        return [*bore.beyond(), *(bore.dark() if required else ())]


class _Bore:
    """Rims within the bounds, and what they let through: proven, of which there is nothing beyond; told; and why."""

    def __init__(self, problem: DesignProblem, left_out: Sequence[str]) -> None:
        self.problem, self.left_out = problem, left_out
        self.corners = problem.cameras(np.array(list(product((0.0, 1.0), repeat=problem.n))))

    def beyond(self) -> Iterator[Unreachable]:
        """Limits of the whole camera that cannot be held."""
        for index, limit in enumerate(self.problem.constraints):
            if limit.temperature is None and limit.field is None:
                low, high = limit.min, limit.max if limit.min is None else None
                proven, told, reason = self._least(limit) if low is None else self._most(limit)
                if not limit.quantity.within(low, high, proven):
                    remedy = f"require at {'least' if low is None else 'most'} {limit.with_unit(told, 4)}"
                    words = f"{limit} is out of reach: {reason}; widen the bore, or {remedy}"
                    yield Unreachable(
                        index,
                        Violation(
                            limit.limit_words("max" if low is None else "min"),
                            told,
                            (low or high or 0.0),
                            limit.quantity.unit,
                        ),
                        words,
                    )

    def dark(self) -> Iterator[Unreachable]:
        """Light that the design requires where none comes from."""
        for asked, quantity, low, _ in limits(self.problem.design):
            if quantity.name in OF_LIGHT and low and asked.object_height is not None:
                proven, told, reason = self._radius(asked.at)
                if asked.object_height > proven:
                    missed = Violation(f"{quantity.name} {asked.off_axis} >=", 0.0, low, quantity.unit)
                    remedy = f"widen the bore, or require it to {number(told, 4)} mm at most"
                    yield Unreachable(-1, missed, f"{missed.asked} is out of reach: {reason}; {remedy}")

    def _most(self, limit: Constraint) -> tuple[float, float, str]:
        """Most that there can be of what a limit wants to be large."""
        name, at = limit.quantity.name, limit.at
        if name in OF_PLANES:
            return self._radius(at)
        if "aperture" not in self.left_out and name in DETAILS:
            return self._detail(name, at)
        if "aperture" not in self.left_out and (name in OF_ANGLES or (name in FROM_TIP and at is not None)):
            return self._angle(at if name in FROM_TIP else None, OF_ANGLES.get(name, 2))
        return math.inf, math.inf, ""

    def _least(self, limit: Constraint) -> tuple[float, float, str]:
        """Least that there can be of a depth whose disparity error is given."""
        known = limit.quantity.name == "sigma_z_mm" and "aperture" not in self.left_out
        least = extremes(self.problem, limit)[0] if known and prunable(self.problem, limit) else -math.inf
        return least, least, f"no FAP within the bounds tells depth better than {limit.with_unit(least, 4)}"

    def _radius(self, at: float | None) -> tuple[float, float, str]:
        """Most that light of a plane comes from off the axis [mm]."""
        pairs = list(passed(self.corners, at, self.left_out))
        if not pairs:
            return math.inf, math.inf, ""
        through = min(pairs, key=attrgetter("radius"))
        # Pages tell where chief rays meet a plane, which away from the focal plane may be farther off.
        chief = 0.0 if at is None or "aperture" in self.left_out else min(one.chief for one in pairs)
        return max(through.radius, chief), through.radius, f"{through.words}, whatever the lens"

    def _angle(self, at: float | None, times: int) -> tuple[float, float, str]:
        """Widest angle of a chief ray to the axis or, from the tip's middle, of where it meets a plane [deg]."""
        pairs = list(passed(self.corners, at, self.left_out))
        if not pairs:
            return math.inf, math.inf, ""
        through = min(pairs, key=attrgetter("slope" if at is None else "chief"))
        half = math.degrees(math.atan(through.slope if at is None else through.chief / at))
        reason = f"no chief ray passes {through.openings} at more than {number(half, 4)} deg to the axis"
        return times * half, times * half, f"{reason}, whatever the lens"

    def _detail(self, name: str, at: float | None) -> tuple[float, float, str]:
        """Detail that the diffraction of the FAP, as wide and as near as it can be, leaves of a plane [lp/mm]."""
        c = self.corners
        gap = float(np.min((c.seen.d_f if at is None else c.plane_ahead(at).distance) - c.seen.d_3))
        wavelength, width = float(np.min(c.wavelength)), 2 * float(np.max(c.fap.radius))
        most = width / (wavelength * gap) * DETAILS[name][not c.fap.round] if gap > 0 else math.inf
        light = f"light of {length(wavelength)} through a FAP of {number(width, 4)} mm, {number(gap, 4)} mm away"
        return most, most, f"{light}, shows nothing finer than {number(most, 4)} lp/mm, whatever the lens"


def conflict_with(unit: Array, beyond: Sequence[Unreachable]) -> Conflict:
    """Conflict of limits with the bore, at the point that comes nearest to all others."""
    missed, words = tuple(one.missed for one in beyond), tuple(one.words for one in beyond)
    return Conflict(unit, max(one.short for one in beyond), missed, missed, proven=True, bore=words)
