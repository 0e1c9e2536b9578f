"""From a bore to the paper's model: a tube or several stops reduced to one equivalent flexible angular plane (FAP).

A bore lets through what passes all its rims; the model has one rim. Which single stop stands for it best depends on the
field: the stop is chosen so that, over the field, as little light as possible is on the wrong side of its rim. That
share bounds the difference of kept fractions, and is told with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera
from ..design import Design, Stop
from ..errors import InputError, Problem
from ..shapes.discs import intersect
from ..theory.light import half_diagonal
from ..theory.stop_images import stop_discs
from .problem import DesignProblem
from .search import simplex
from .solve import Answer, Settings, Tell, solve

Array = NDArray[np.float64]

FIELDS = 9
"""Places from the axis to the corner of what the sensor sees."""
PASSES = 12
"""Most times that a bore is reduced again for the field of the optimum."""
SETTLED = 1e-6
"""Relative change of D_F and d_3 at which the bore's reduction has settled."""


@dataclass(frozen=True)
class EquivalentPupil:
    """One stop in place of a bore."""

    diameter: float
    """D_F [mm]."""
    distance: float
    """d_3 [mm]."""
    field_mm: Array
    """Microlens positions that were compared, along the diagonal [mm]."""
    kept_bore: Array
    """Light through bore and main lens, over that of the unclipped equivalent pupil; may be above 1."""
    kept_pupil: Array
    """The same through the equivalent pupil and the main lens."""
    misplaced: Array
    """Share of the pupil's light that one lets through and the other does not."""

    @property
    def worst_kept_difference(self) -> float:
        """Largest difference of kept fractions over the field."""
        return float(np.abs(self.kept_bore - self.kept_pupil).max())

    @property
    def worst_misplaced(self) -> float:
        """Largest share on the wrong side; never below the difference of kept fractions."""
        return float(self.misplaced.max())

    @property
    def cost(self) -> tuple[float, float]:
        """What is made small."""
        return self.worst_misplaced, float(self.misplaced.sum())

    def close_to(self, other: EquivalentPupil) -> bool:
        """Whether both are the same stop."""
        size = max(self.distance, self.diameter)
        narrower = abs(self.diameter - other.diameter) <= SETTLED * self.diameter
        return narrower and abs(self.distance - other.distance) <= SETTLED * size


@dataclass(frozen=True)
class Bore:
    """What stands for the bore."""

    pupil: EquivalentPupil
    passes: int
    settled: bool
    """Whether another reduction would change nothing."""


def reduce_bore(design: Design, rims: Sequence[Stop]) -> EquivalentPupil:
    """One stop that stands for the rims of a bore (without the main lens), for the field that a design's sensor sees.

    The design gives lens, focus and array; its own aperture and stops are not looked at. Exact (nothing misplaced) for
    a single rim, and where one rim is the only one that ever cuts.

    Raises
    ------
    InputError
        A rim at or beyond the focal plane.
    """
    near, far = min(rim.distance for rim in rims), max(rim.distance for rim in rims)
    if far >= design.d_f:
        words = (
            f"a rim at {far:g} mm is not in front of the object plane ({design.d_f:g} mm): the object is in the bore"
        )
        raise InputError((Problem("bore", f"{words}; focus the base design farther out, or shorten the bore"),))
    # On the axis the rim with the smallest angle seen from the focal plane is the pupil, wherever it stands.
    angle = min(rim.diameter / (design.d_f - rim.distance) for rim in rims)
    tried = [(rim.diameter, rim.distance) for rim in rims]
    tried += [(angle * (design.d_f - z), z) for z in np.linspace(near, far, 9).tolist()]
    best = min((judge_pupil(design, rims, stop) for stop in tried), key=lambda pupil: pupil.cost)
    if best.worst_misplaced == 0 or far == near:
        return best
    return _refined(design, rims, best)


def _refined(design: Design, rims: Sequence[Stop], best: EquivalentPupil) -> EquivalentPupil:
    """Nelder and Mead's simplex on (D_F, d_3): the cost has kinks where another field becomes the worst."""
    ends = [rim.distance for rim in rims]
    low, high = np.array([0.3 * best.diameter, min(ends)]), np.array([2.0 * best.diameter, max(ends)])

    def pupil(unit: Array) -> EquivalentPupil:
        diameter, distance = (low + unit * (high - low)).tolist()
        return judge_pupil(design, rims, (diameter, distance))

    start = (np.array([best.diameter, best.distance]) - low) / (high - low)
    unit, _ = simplex("LN_NELDERMEAD", lambda unit: pupil(unit).cost, start, step=0.1, xtol=1e-7, evaluations=400)
    return min(best, pupil(unit), key=lambda each: each.cost)


def judge_pupil(design: Design, rims: Sequence[Stop], stop: tuple[float, float]) -> EquivalentPupil:
    """How well a stop of some diameter and distance [mm] stands for a bore; the rest as for `reduce_bore`."""
    camera = _behind(design, tuple(rims)).replace({"aperture.diameter": stop[0], "aperture.distance": stop[1]})
    fields = np.linspace(0.0, float(half_diagonal(camera)), FIELDS)
    centres, radii = stop_discs(camera, fields, 0.0)
    whole = np.pi * radii[:, 0] ** 2
    pupil, bore, both = (
        intersect(centres[:, some], radii[:, some]).area / whole for some in (slice(2), slice(1, None), slice(None))
    )
    misplaced = np.maximum(pupil - both, 0.0) + np.maximum(bore - both, 0.0)
    return EquivalentPupil(stop[0], stop[1], fields, bore, pupil, misplaced)


@lru_cache(maxsize=8)
def _behind(design: Design, rims: tuple[Stop, ...]) -> Camera:
    centred = {f"{part}.decentre": (0.0, 0.0) for part in ("main_lens", "aperture")}
    return Camera.of(design.replace({"stops": rims, **centred}))


def through_bore(
    problem: DesignProblem, rims: Sequence[Stop], settings: Settings, tell: Tell
) -> tuple[DesignProblem, Bore]:
    """The problem with the bore's equivalent pupil, for the field and focus that the optimum itself has.

    Which stop stands for the bore depends on the optimum, and the optimum on the stop: they are found in turn until
    they agree. Where they go round in circles, the stop counts that suits its own optimum best.
    """
    quick = settings.model_copy(update={"starts": min(4, settings.starts), "check": False, "isres": False})
    base = problem.design
    tried: list[Bore] = []
    pupil = reduce_bore(base, rims)
    for number in range(1, PASSES + 1):
        tell(f"reducing the bore, pass {number}")
        problem = replace(problem, design=base.replace(D_F=pupil.diameter, d_3=pupil.distance))
        try:
            optimum = problem.design_at(solve(problem, quick, tell).unit)
            after = reduce_bore(optimum, rims)
        except InputError:
            break  # what was found is no design, or focuses inside the bore
        settled = after.close_to(pupil)
        own = judge_pupil(optimum, rims, (pupil.diameter, pupil.distance))
        tried.append(Bore(own, number, settled))
        if settled or any(after.close_to(earlier.pupil) for earlier in tried):
            break
        pupil = after
    if not tried:
        tried.append(Bore(pupil, 1, False))
    best = tried[-1] if tried[-1].settled else min(tried, key=lambda bore: bore.pupil.worst_misplaced)
    return replace(problem, design=base.replace(D_F=best.pupil.diameter, d_3=best.pupil.distance)), best


def judged_at(bore: Bore, rims: Sequence[Stop], answer: Answer) -> Bore:
    """The bore's pupil judged at the answer itself, where that is a design in front of the bore."""
    try:
        design = answer.problem.design_at(answer.unit)
    except InputError:
        return bore
    if design.d_f <= max(rim.distance for rim in rims):
        return bore
    return replace(bore, pupil=judge_pupil(design, rims, (bore.pupil.diameter, bore.pupil.distance)))
