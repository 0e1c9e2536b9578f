"""From a bore to the paper's model: a tube or several stops reduced to one equivalent flexible angular plane (FAP).

A bore lets through what passes all its rims; the model has one rim. Which single stop stands for it best depends on the
field: the stop is chosen so that, over the field, as little light as possible is on the wrong side of its rim. That
share bounds the difference of unvignetted fractions, and is told with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pydantic import field_validator, model_validator

from .._arrays import Array, by_value
from ..camera import Camera
from ..design import Design, Stop
from ..design.parts import Opening
from ..errors import InputError, Problem
from ..theory.light import sensor_field
from ..theory.stop_images import stop_openings
from ..theory.vignetting import lit_radius
from ..toml_files import StrictTable
from ..units import Distance, Length
from .problem import DesignProblem
from .search import SearchBudget, derivative_free
from .solve import Answer, Settings, Tell, solve

FIELDS = 9
"""Places from the axis to the corner of what the sensor sees."""
DIRECTIONS = 8
"""Directions of these, over half a turn, where not all stops are round."""
PASSES = 12
"""Most times that a bore is reduced again for the field of the optimum."""
ROUNDING = 1e-9
"""Light on the axis, over that of the pupil, below which there is none."""
SETTLED = 1e-6
"""Relative change of D_F and d_3 at which the bore's reduction has settled."""


class StopTable(Opening):
    """Rim of the bore."""

    distance: Distance

    @field_validator("decentre", "tilt", "bore", mode="after")
    @classmethod
    def _centred(cls, value: Any) -> Any:
        if np.any(value):
            raise ValueError(
                "a bore is reduced to one stop on the axis; drop it, or put it into [[stops]] of the design"
            )
        return value

    def at(self, distance: float) -> Stop:
        """Rim of its shape at a distance [mm]."""
        return Stop(shape=self.shape, diameter=self.diameter, sides=self.sides, turn=self.turn, distance=distance)


class TubeTable(StopTable):
    """Straight tube or round cone: what passes both ends of either passes its wall."""

    length: Length
    proximal_diameter: Length | None = None
    """Diameter of a cone at its end towards the lens, `diameter` being that at the tip; None of a straight tube."""

    @model_validator(mode="after")
    def _round(self) -> TubeTable:
        if self.proximal_diameter is not None and self.diameter is None:
            raise ValueError("a cone is round: give diameter, that of its tip, beside proximal_diameter, or drop it")
        return self

    @property
    def rims(self) -> tuple[Stop, Stop]:
        """Both ends, the nearer first."""
        near = self.model_copy(update={"diameter": self.proximal_diameter or self.diameter})
        return near.at(self.distance), self.at(self.distance + self.length)


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
            return tuple(stop.at(stop.distance) for stop in self.stops)
        return self.tube.rims


@by_value
@dataclass(frozen=True)
class EquivalentPupil:
    """Stop in place of a bore."""

    pupil_diameter_mm: float
    """D_F: of a stop that is no disc the wider of its extents along x and y."""
    pupil_distance_mm: float
    """d_3."""
    fields_mm: Array
    """Distances of the microlenses that were compared from the axis, as far out as the bore leaves a third of a
    pencil's width; each in the direction where most is misplaced."""
    kept_bore: Array
    """Light through bore and main lens, over that of the unclipped equivalent pupil; may be above 1."""
    kept_pupil: Array
    """Light through equivalent pupil and main lens, over that of the unclipped equivalent pupil."""
    misplaced: Array
    """Light that one lets through and the other does not, over that of the pupil or, where it is less, of the bore on
    the axis."""
    worst_kept_difference: float
    """Largest difference of unvignetted fractions over the field."""
    worst_misplaced: float
    """Largest share on the wrong side; never below the difference of unvignetted fractions."""
    seen_to_mm: float
    """Distance of the farthest microlens that the sensor sees."""
    passes: int = 1
    """How many times the bore was reduced, each for the optimum behind the last pupil."""
    settled: bool = False
    """Whether another reduction would change nothing."""

    @property
    def stop(self) -> tuple[float, float]:
        """Diameter and distance [mm]."""
        return self.pupil_diameter_mm, self.pupil_distance_mm

    @property
    def dark_beyond_mm(self) -> float | None:
        """Distance of the microlenses beyond which the bore leaves too little; None where the sensor sees none."""
        lit = float(self.fields_mm[-1])
        return lit if lit < self.seen_to_mm else None

    @property
    def cost(self) -> tuple[float, float]:
        """Costs to minimise, in this order: the worst misplaced share of light, and the sum over fields."""
        return self.worst_misplaced, float(self.misplaced.sum())

    def close_to(self, other: EquivalentPupil) -> bool:
        """Whether both are the same stop."""
        narrower, nearer = np.abs(np.subtract(self.stop, other.stop))
        return bool(narrower <= SETTLED * self.pupil_diameter_mm and nearer <= SETTLED * max(self.stop))


def reduce_bore(design: Design, rims: Sequence[Stop]) -> EquivalentPupil:
    """One stop that stands for the rims of a bore (without the main lens), for the field that it lights on the sensor.

    The design gives lens, focus, array and the shape of the stop; its own stops are not looked at. Exact (nothing
    misplaced) for a single rim of that shape, and where one such rim is the only one that ever cuts.

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
    pupil = _on_axis(design, rims)
    angle = float(pupil.outline.width) / (design.d_f - pupil.distance)
    tried = [(float(rim.outline.width), rim.distance) for rim in rims]
    tried += [(angle * (design.d_f - z), z) for z in np.linspace(near, far, 9).tolist()]
    best = min((_judged(camera, *stop) for stop in tried), key=lambda pupil: pupil.cost)
    if best.worst_misplaced == 0 or far == near:
        return best
    # The cost has kinks where another field becomes the worst: Nelder and Mead's simplex.
    low, high = np.array([0.3 * best.stop[0], near]), np.array([2.0 * best.stop[0], far])

    def stop(unit: Array) -> EquivalentPupil:
        return _judged(camera, *(low + unit * (high - low)).tolist())

    start = (np.array(best.stop) - low) / (high - low)
    unit, _ = derivative_free(
        "LN_NELDERMEAD", lambda unit: stop(unit).cost, start, xtol=1e-7, budget=SearchBudget().at_most(400)
    )
    return min(best, stop(unit), key=lambda each: each.cost)


def judge_pupil(design: Design, rims: Sequence[Stop], diameter: float, distance: float) -> EquivalentPupil:
    """How well a stop of some diameter and distance [mm] stands for a bore; the rest as for `reduce_bore`."""
    return _judged(_behind(design, rims), diameter, distance)


def _on_axis(design: Design, rims: Sequence[Stop]) -> Stop:
    """The bore's pupil on the axis: the rim with the smallest angle seen from the focal plane, wherever it stands."""
    return min(rims, key=lambda rim: float(rim.outline.width) / (design.d_f - rim.distance))


def _behind(design: Design, rims: Sequence[Stop]) -> Camera:
    """The bore, its pupil on the axis for FAP."""
    centred = {f"{part}.decentre": (0.0, 0.0) for part in ("main_lens", "aperture")}
    pupil = _on_axis(design, rims)
    camera = Camera.of(design.replace({"stops": tuple(rims), **centred}))
    return camera.replace({"D_F": float(pupil.outline.width), "aperture.distance": pupil.distance})


def _judged(bore: Camera, diameter: float, distance: float) -> EquivalentPupil:
    camera = bore.replace({"D_F": diameter, "aperture.distance": distance})
    seen = float(sensor_field(camera).radius)
    fields = np.linspace(0.0, min(seen, float(lit_radius(bore))), FIELDS)
    # Stops are centred: opposite fields are alike.
    turns = DIRECTIONS if camera.has_straight_sides else 1
    turn = np.linspace(0, np.pi, turns, endpoint=False)[:, None]
    openings = stop_openings(camera, fields * np.cos(turn), fields * np.sin(turn))
    every = range(openings.total)
    pupil, through, both = (openings.some(some).common().area / openings.area for some in (every[:2], every[1:], every))
    misplaced = np.maximum(pupil - both, 0.0) + np.maximum(through - both, 0.0)
    worst = np.argmax(misplaced, axis=0), np.arange(FIELDS)
    pupil, through, misplaced = (share[worst] for share in (pupil, through, misplaced))
    misplaced = misplaced / np.clip(through[0], ROUNDING, 1.0)  # a pupil far too wide would hide all that it adds
    most = float(np.abs(through - pupil).max()), float(misplaced.max())
    return EquivalentPupil(diameter, distance, fields, through, pupil, misplaced, *most, seen)


def solve_through(
    problem: DesignProblem, rims: Sequence[Stop], settings: Settings, tell: Tell
) -> tuple[Answer, EquivalentPupil]:
    """The best design behind the bore's equivalent pupil, for the field and focus that the optimum itself has.

    Which stop stands for the bore depends on the optimum, and the optimum on the stop: they are found in turn until
    they agree. Where they go round in circles, the stop counts that suits its own optimum best.
    """
    quick = settings.model_copy(update={"starts": min(4, settings.starts), "check": False, "isres": False})
    tried: list[EquivalentPupil] = []
    pupil = reduce_bore(problem.design, rims)
    for number in range(1, PASSES + 1):
        tell(f"reducing the bore, pass {number}")
        posed = _behind_pupil(problem, pupil)
        try:
            optimum = posed.design_at(solve(posed, quick, tell).unit)
            after = reduce_bore(optimum, rims)
        except InputError:
            break  # what was found is no design, or focuses inside the bore
        settled = after.close_to(pupil)
        tried.append(replace(judge_pupil(optimum, rims, *pupil.stop), passes=number, settled=settled))
        if settled or any(after.close_to(earlier) for earlier in tried):
            break
        pupil = after
    tried = tried or [pupil]
    best = tried[-1] if tried[-1].settled else min(tried, key=lambda pupil: pupil.worst_misplaced)
    answer = solve(_behind_pupil(problem, best), settings, tell)
    try:
        design = answer.problem.design_at(answer.unit)
    except InputError:
        return answer, best
    if design.d_f > max(rim.distance for rim in rims):
        own = judge_pupil(design, rims, *best.stop)
        best = replace(own, passes=best.passes, settled=best.settled)
    return answer, best


def _behind_pupil(problem: DesignProblem, pupil: EquivalentPupil) -> DesignProblem:
    stop = dict(zip(("D_F", "d_3"), pupil.stop, strict=True))
    camera = Camera.of(problem.design).replace(stop)
    places = [*camera.fap.size_places, "aperture.distance"]
    return replace(problem, given={**problem.given, **{place: float(camera[place]) for place in places}})
