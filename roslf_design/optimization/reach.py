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
from typing import Literal, NamedTuple

import numpy as np

from ..design import PATHS, Stop
from ..design.required import ROUND_ANGLE, ROUND_RADIUS
from ..theory.limits import limits
from ..theory.vignetting import passed
from ..words import length, number
from .bounds import extremes, prunable
from .goals import Constraint
from .lens_variables import varies_lens
from .problem import DesignProblem

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
    """Index among the problem's constraints."""
    limit: str
    """Limit in words, without its number."""
    wanted: float
    most: float
    """Nearest to it that any camera within the bounds comes."""
    unit: str
    words: str
    """Limit, what stands against it, and the remedy."""

    @property
    def short(self) -> float:
        """Logarithm of how many times what is possible is wanted, either way."""
        return abs(math.log(self.wanted / self.most)) if self.most > 0 else math.inf


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
    base = problem.base
    moved = {PATHS.get(name, name) for name in problem.variables}
    shaped = bool(problem.design.main_lens.kind.mounted) and any(map(varies_lens, moved))
    glass = shaped or any(name.startswith("elements.") for name in moved) or "windows" in chosen
    glass |= PATHS["wavelength"] in moved and bool(base.chain.elements)
    bent = base.chain.bends or base.chain.mapped or base.chain.folding or base.leaning or base.chain.stop_behind
    if glass or bent or problem.n > MOST_VARIED:
        return []
    if rims:
        problem = replace(problem, design=problem.design.replace({"stops": tuple(rims)}))
    lens = bool(problem.design.main_lens.kind.mounted) or "lenses" in chosen
    bore = _Bore(problem, ("main_lens",) * lens + ("aperture",) * bool(rims))
    with np.errstate(all="ignore"):
        return [*_limits(problem, bore), *(_places(problem, bore) if required else ())]


def _limits(problem: DesignProblem, bore: _Bore) -> Iterator[Unreachable]:
    """Limits of the whole camera that cannot be held."""
    for index, limit in enumerate(problem.constraints):
        if limit.temperature is None and limit.field is None:
            side: Literal["min", "max"] = "max" if limit.min is None else "min"
            wanted, (end, told, reason) = limit.limits.get(side, limit.min), getattr(bore, side)(limit)
            low, high = (wanted, None) if side == "min" else (None, wanted)
            if wanted is None or limit.quantity.within(low, high, end):
                continue
            remedy = f"widen the bore, or require at {'most' if side == 'min' else 'least'} {limit.with_unit(told, 4)}"
            words = f"{limit} is out of reach: {reason}; {remedy}"
            yield Unreachable(index, limit.limit_words(side), wanted, told, limit.quantity.unit, words)


def _places(problem: DesignProblem, bore: _Bore) -> Iterator[Unreachable]:
    """Light that the design requires where none comes from."""
    for asked, quantity, low, _ in limits(problem.design):
        if quantity.name not in OF_LIGHT or not low or (asked.object_height or asked.field_angle) is None:
            continue
        if asked.object_height is not None:
            place, (most, told, reason), unit = asked.object_height, bore.radius(asked.at), "mm"
        else:
            place, (most, told, reason), unit = math.degrees(asked.field_angle or 0.0), bore.angle(), "deg"
        if place > most:
            where = f"{quantity.name} {asked.off_axis}"
            remedy = f"widen the bore, or require it to {number(told, 4)} {unit} at most"
            words = f"{where} >= {number(low)} is out of reach: {reason}; {remedy}"
            yield Unreachable(-1, f"{where} >=", low, 0.0, quantity.unit, words)


class _End(NamedTuple):
    """Farthest that a number of any camera within the bounds goes."""

    proven: float
    """None goes beyond; infinite where nothing is known."""
    told: float = math.nan
    """Number to require in its place: what light that comes through the bore reaches."""
    reason: str = ""

    @classmethod
    def of(cls, end: float, reason: str) -> _End:
        """End that is told as it is."""
        return cls(end, end, reason)


class _Bore:
    """Rims within the bounds, and what they let through at most."""

    def __init__(self, problem: DesignProblem, left_out: Sequence[str]) -> None:
        self.problem, self.left_out = problem, left_out
        self.corners = problem.cameras(np.array(list(product((0.0, 1.0), repeat=problem.n))))

    def min(self, limit: Constraint) -> _End:
        """Most that there can be of what a limit wants to be large, and why; infinite where nothing is proven."""
        name, at = limit.quantity.name, limit.at
        if name in DETAILS and "aperture" not in self.left_out:
            return self._detail(name, at)
        if name in OF_PLANES:
            return self.radius(at)
        if name in OF_ANGLES or (name in FROM_TIP and at is not None):
            half, _, reason = self.angle(at if name in FROM_TIP else None)
            return _End.of(half * OF_ANGLES.get(name, 2), reason)
        return _End(math.inf)

    def max(self, limit: Constraint) -> _End:
        """Least that there can be of a depth whose disparity error is given, and why; -infinite else."""
        if limit.quantity.name != "sigma_z_mm" or not prunable(self.problem, limit):
            return _End(-math.inf)
        least = extremes(self.problem, limit)[0]
        return _End.of(least, f"no FAP within the bounds tells depth better than {limit.with_unit(least, 4)}")

    def radius(self, at: float | None) -> _End:
        """Most that light of a plane comes from off the axis [mm]."""
        pairs = list(passed(self.corners, at, self.left_out))
        if not pairs:
            return _End(math.inf)
        through = min(pairs, key=attrgetter("radius"))
        # Pages tell where chief rays meet a plane, which away from the focal plane may be farther off.
        chief = 0.0 if at is None or "aperture" in self.left_out else min(one.chief for one in pairs)
        return _End(max(through.radius, chief), through.radius, f"{through.words}, whatever the lens")

    def angle(self, at: float | None = None) -> _End:
        """Widest angle of a chief ray to the axis or, from the tip's middle, of where it meets a plane [deg]."""
        pairs = list(passed(self.corners, at, self.left_out))
        if not pairs or "aperture" in self.left_out:  # through which chief rays go
            return _End(math.inf)
        through = min(pairs, key=attrgetter("slope" if at is None else "chief"))
        half = math.degrees(math.atan(through.slope if at is None else through.chief / at))
        words = f"no chief ray passes {through.openings} at more than {number(half, 4)} deg to the axis"
        return _End.of(half, f"{words}, whatever the lens")

    def _detail(self, name: str, at: float | None) -> _End:
        """Detail that the diffraction of the FAP, as wide and as near as it can be, leaves of a plane [lp/mm]."""
        c = self.corners
        gap = float(np.min((c.seen.d_f if at is None else c.plane_ahead(at).distance) - c.seen.d_3))
        wavelength, width = float(np.min(c.wavelength)), 2 * float(np.max(c.fap.radius))
        if not gap > 0:
            return _End(math.inf)
        most = width / (wavelength * gap) * DETAILS[name][not c.fap.round]
        light = f"light of {length(wavelength)} through a FAP of {number(width, 4)} mm, {number(gap, 4)} mm away"
        return _End.of(most, f"{light}, shows nothing finer than {number(most, 4)} lp/mm, whatever the lens")
