"""From a bore to the paper's model: a tube or several stops reduced to one equivalent flexible angular plane (FAP).

A bore lets through what passes all its rims; the model has one rim. Which single stop stands for it best depends on the
field: the stop is chosen so that, over the field, as little light as possible is on the wrong side of its rim. That
share bounds the difference of kept fractions, and is told with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from ..camera import Camera
from ..design import Design, Stop
from ..errors import InputError, Problem
from ..shapes.discs import intersect
from ..theory.light import half_diagonal
from ..theory.stop_images import stop_discs
from ..tolerancing.study import StrictTable
from ..units import Distance, Length
from .problem import DesignProblem
from .search import derivative_free
from .solve import Answer, Settings, Tell, solve

Array = NDArray[np.float64]

FIELDS = 9
"""Places from the axis to the corner of what the sensor sees."""
PASSES = 12
"""Most times that a bore is reduced again for the field of the optimum."""
SETTLED = 1e-6
"""Relative change of D_F and d_3 at which the bore's reduction has settled."""


class StopTable(StrictTable):
    """One rim."""

    diameter: Length
    distance: Distance


class TubeTable(StopTable):
    """A straight tube."""

    length: Length


class BoreTable(StrictTable):
    """The bore, instead of a flexible angular plane: a tube, or several stops."""

    tube: TubeTable | None = None
    stops: tuple[StopTable, ...] = ()

    @model_validator(mode="after")
    def _one(self) -> BoreTable:
        if (self.tube is None) == (not self.stops):
            raise ValueError("a bore is a tube or a list of stops; give [bore.tube] or [[bore.stops]], not both")
        return self

    @property
    def rims(self) -> tuple[Stop, ...]:
        """Every rim; of a tube the nearer end first."""
        if self.tube is None:
            return tuple(Stop(diameter=stop.diameter, distance=stop.distance) for stop in self.stops)
        ends = self.tube.distance, self.tube.distance + self.tube.length
        return tuple(Stop(diameter=self.tube.diameter, distance=end) for end in ends)


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
    camera = _behind(design, rims)
    # On the axis the rim with the smallest angle seen from the focal plane is the pupil, wherever it stands.
    angle = min(rim.diameter / (design.d_f - rim.distance) for rim in rims)
    tried = [(rim.diameter, rim.distance) for rim in rims]
    tried += [(angle * (design.d_f - z), z) for z in np.linspace(near, far, 9).tolist()]
    best = min((_judged(camera, *stop) for stop in tried), key=lambda pupil: pupil.cost)
    if best.worst_misplaced == 0 or far == near:
        return best
    # The cost has kinks where another field becomes the worst: Nelder and Mead's simplex.
    low, high = np.array([0.3 * best.diameter, near]), np.array([2.0 * best.diameter, far])

    def pupil(unit: Array) -> EquivalentPupil:
        return _judged(camera, *(low + unit * (high - low)).tolist())

    start = (np.array([best.diameter, best.distance]) - low) / (high - low)
    unit, _ = derivative_free("LN_NELDERMEAD", lambda unit: pupil(unit).cost, start, xtol=1e-7, evaluations=400)
    return min(best, pupil(unit), key=lambda each: each.cost)


def judge_pupil(design: Design, rims: Sequence[Stop], diameter: float, distance: float) -> EquivalentPupil:
    """How well a stop of some diameter and distance [mm] stands for a bore; the rest as for `reduce_bore`."""
    return _judged(_behind(design, rims), diameter, distance)


def _behind(design: Design, rims: Sequence[Stop]) -> Camera:
    centred = {f"{part}.decentre": (0.0, 0.0) for part in ("main_lens", "aperture")}
    return Camera.of(design.replace({"stops": tuple(rims), **centred}))


def _judged(bore: Camera, diameter: float, distance: float) -> EquivalentPupil:
    camera = bore.replace({"aperture.diameter": diameter, "aperture.distance": distance})
    fields = np.linspace(0.0, float(half_diagonal(camera)), FIELDS)
    centres, radii = stop_discs(camera, fields, 0.0)
    whole = np.pi * radii[:, 0] ** 2
    pupil, through, both = (
        intersect(centres[:, some], radii[:, some]).area / whole for some in (slice(2), slice(1, None), slice(None))
    )
    misplaced = np.maximum(pupil - both, 0.0) + np.maximum(through - both, 0.0)
    return EquivalentPupil(diameter, distance, fields, through, pupil, misplaced)


def solve_through(problem: DesignProblem, rims: Sequence[Stop], settings: Settings, tell: Tell) -> tuple[Answer, Bore]:
    """The best design behind the bore's equivalent pupil, for the field and focus that the optimum itself has.

    Which stop stands for the bore depends on the optimum, and the optimum on the stop: they are found in turn until
    they agree. Where they go round in circles, the stop counts that suits its own optimum best.
    """
    quick = settings.model_copy(update={"starts": min(4, settings.starts), "check": False, "isres": False})
    tried: list[Bore] = []
    pupil = reduce_bore(problem.design, rims)
    for number in range(1, PASSES + 1):
        tell(f"reducing the bore, pass {number}")
        posed = _with_pupil(problem, pupil)
        try:
            optimum = posed.design_at(solve(posed, quick, tell).unit)
            after = reduce_bore(optimum, rims)
        except InputError:
            break  # what was found is no design, or focuses inside the bore
        settled = after.close_to(pupil)
        tried.append(Bore(judge_pupil(optimum, rims, pupil.diameter, pupil.distance), number, settled))
        if settled or any(after.close_to(earlier.pupil) for earlier in tried):
            break
        pupil = after
    tried = tried or [Bore(pupil, 1, False)]
    best = tried[-1] if tried[-1].settled else min(tried, key=lambda bore: bore.pupil.worst_misplaced)
    answer = solve(_with_pupil(problem, best.pupil), settings, tell)
    try:
        design = answer.problem.design_at(answer.unit)
    except InputError:
        return answer, best
    if design.d_f > max(rim.distance for rim in rims):
        best = replace(best, pupil=judge_pupil(design, rims, best.pupil.diameter, best.pupil.distance))
    return answer, best


def _with_pupil(problem: DesignProblem, pupil: EquivalentPupil) -> DesignProblem:
    stop = {"aperture.diameter": pupil.diameter, "aperture.distance": pupil.distance}
    return replace(problem, given={**problem.given, **stop})
