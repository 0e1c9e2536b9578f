"""The plan: which effects a rendering of this design and scene calls for, with sizes, budgets and reasons."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any, Protocol, Self

from ..design import Design
from ..errors import InputError, Problem
from ..words import spaced
from . import elements, geometry, lens, waves
from .effect import NOT_MODELLED, WHITE, Effect, Estimate, SceneBrief, Subject, Unit

EFFECTS: tuple[Effect, ...] = (
    geometry.PUPIL_GEOMETRY,
    geometry.VIGNETTING,
    waves.MICROLENS_DIFFRACTION,
    waves.FAP_DIFFRACTION,
    waves.MICROLENS_DEFOCUS,
    waves.FINITE_MICROLENS_APERTURE,
    waves.PIXEL_INTEGRATION,
    geometry.OVERLAP,
    geometry.OBJECT_DEFOCUS,
    geometry.COS4,
    *lens.EFFECTS,
    elements.PLATE_ABERRATION,
    geometry.MLA_ROTATION,
    geometry.TILTS,
    geometry.DECENTRES,
    waves.VEIL,
    waves.NOISE,
)
"""Every effect known, in the order in which a plan lists them."""
INTENSITY = 0.01
"""Budget of intensity where none is given."""
_BY_NAME = {effect.name: effect for effect in EFFECTS}


class PlanError(InputError):
    """A plan that cannot be made: unknown effect, impossible override, budget that is no number."""

    @classmethod
    def about(cls, key: str, message: str) -> Self:
        """Error with one fault, at `key`."""
        return cls((Problem(key, message),))


class _HasBrief(Protocol):
    """A scene: anything that can sum itself up."""

    def brief(self, design: Design) -> SceneBrief:
        """The scene in the few numbers that effects need."""
        ...


@dataclass(frozen=True)
class Budget:
    """Budget: the largest size of an effect that may be left out."""

    px: float = 0.1
    """Displacement on the sensor [pixels]."""
    intensity: float | None = None
    """Rms change [fraction of full scale]. None is `INTENSITY`, and the noise of a scene that states its exposure tells
    how many rays are traced."""
    pitch: float = 0.1
    """Displacement on the microlens array [pitches]."""

    def __post_init__(self) -> None:
        for unit in ("px", "intensity", "pitch"):
            value = self.of(unit)
            if not (value >= 0 and math.isfinite(value)):
                raise PlanError.about(
                    f"budget.{unit}", f"{value} is no budget; give a number that is not negative, such as 0.1"
                )

    def of(self, unit: Unit) -> float:
        """The budget in one of the units."""
        return INTENSITY if unit == "intensity" and self.intensity is None else float(getattr(self, unit))


@dataclass(frozen=True)
class PlannedEffect:
    """Line of a plan: an effect with its size and whether it is on."""

    name: str
    estimate: float
    """Size in `unit`, for this design and scene; signed where a direction means something."""
    unit: Unit
    budget: float
    on: bool
    reason: str
    cost: float = 0.0
    """Extra time to render it over the whole sensor [s], whether on or off."""

    @property
    def modelled(self) -> bool:
        """Whether its size is known, be it 0."""
        return not self.reason.startswith(NOT_MODELLED)


def not_modelled(effects: Iterable[PlannedEffect]) -> str:
    """Sentence on the effects that ideal lenses hide, with their sizes where they can be told; empty of none."""
    unknown = [effect for effect in effects if not effect.modelled]
    sizes = [f"; {effect.reason.partition('; ')[2]}" for effect in unknown if "; " in effect.reason]
    names = ", ".join(spaced(effect.name) for effect in unknown)
    return f"Not modelled, lenses being ideal: {names}{''.join(sizes)}." if names else ""


@dataclass(frozen=True)
class Plan:
    """Plan of the effects that are on. A frozen sequence; `plan["cos4"]` finds a line by its name."""

    effects: tuple[PlannedEffect, ...]

    def __iter__(self) -> Iterator[PlannedEffect]:
        return iter(self.effects)

    def __len__(self) -> int:
        return len(self.effects)

    def __getitem__(self, key: int | str) -> PlannedEffect:
        if isinstance(key, int):
            return self.effects[key]
        for line in self.effects:
            if line.name == key:
                return line
        raise KeyError(_unknown(key))

    def on(self, name: str) -> bool:
        """Whether an effect is to be rendered."""
        return self[name].on

    def without(self, name: str) -> Plan:
        """Plan with one effect off."""
        return Plan(tuple(replace(line, on=line.on and line.name != name) for line in self.effects))

    @property
    def drawn(self) -> tuple[Effect, ...]:
        """Effects that are on."""
        return tuple(_BY_NAME[line.name] for line in self if line.on)

    @property
    def left_out(self) -> tuple[Effect, ...]:
        """Effects that are off."""
        return tuple(_BY_NAME[line.name] for line in self if not line.on)

    @property
    def cost(self) -> float:
        """Expected extra time of all that is on [s]."""
        return sum(line.cost for line in self.effects if line.on)

    def as_dicts(self) -> list[dict[str, Any]]:
        """All lines as JSON-ready values."""
        return [asdict(line) for line in self.effects]


def plan(
    design: Design,
    scene: _HasBrief | SceneBrief | None = None,
    budget: Budget | None = None,
    overrides: Iterable[str] = (),
) -> Plan:
    """Decide which effects a rendering needs.

    Parameters
    ----------
    scene : scene or SceneBrief, optional
        None is a white field on the focal plane, seen over the whole sensor, in the design's wavelength, no noise.
    budget : Budget, optional
        Effects estimated below it are left out. None is ``Budget()``.
    overrides : iterable of str
        ``"all"``, ``"none"``, ``"+name"``, ``"-name"``, applied in order after the budget has decided.

    Returns
    -------
    Plan
        One line an effect, in the order of `EFFECTS`.

    Raises
    ------
    PlanError
        Unknown effects (the nearest is named), effects that cannot be switched that way.
    InputError
        A scene that this design cannot see.
    """
    brief = scene if isinstance(scene, SceneBrief) else WHITE if scene is None else scene.brief(design)
    subject = Subject(design, brief)
    budget = budget or Budget()
    wanted = _wanted(overrides, design)
    width, height = design.pixels
    lines: dict[str, PlannedEffect] = {}
    for effect in sorted(EFFECTS, key=lambda effect: bool(effect.required_by)):
        there = effect.available(design)
        size = effect.estimate(subject) if there else Estimate(0.0, effect.absent(subject))
        if not math.isfinite(size.value):
            raise PlanError.about(effect.name, f"its estimate is {size.value}; this design's values are too extreme")
        limit = budget.of(effect.unit)
        user = [name for name in effect.required_by if lines[name].on]
        on, why = _decide(effect, abs(size.value), limit, user) if there else (False, "")
        if there and not effect.always and effect.name in wanted:
            on, why = wanted[effect.name], "switched on by hand" if wanted[effect.name] else "switched off by hand"
        reason = f"{size.note}; {why}" if why else size.note
        cost = effect.cost_per_pixel * width * height
        if effect.name == "microlens_diffraction" and on != brief.diffracts:
            subject = Subject(design, replace(brief, diffracts=on))
        lines[effect.name] = PlannedEffect(effect.name, size.value, effect.unit, limit, on, reason, cost)
    return Plan(tuple(lines[effect.name] for effect in EFFECTS))


def _decide(effect: Effect, size: float, limit: float, user: list[str]) -> tuple[bool, str]:
    if effect.always:
        return True, "never left out"
    if size > limit:
        return True, "above the budget"
    if user:
        return True, f"{user[0].replace('_', ' ')} spreads light over the neighbours"
    return False, "" if size == 0 else "below the budget"


def _wanted(overrides: Iterable[str], design: Design) -> dict[str, bool]:
    known = _BY_NAME
    wanted: dict[str, bool] = {}
    for override in overrides:
        if override in ("all", "none"):
            wanted = dict.fromkeys(known, override == "all")
            continue
        sign, name = override[:1], override[1:]
        if sign not in ("+", "-"):
            raise PlanError.about("effects", f'cannot read "{override}"; write all, none, +name or -name')
        if name not in known:
            raise PlanError.about("effects", _unknown(name))
        if sign == "-" and known[name].always:
            raise PlanError.about("effects", f"{name} is never left out; drop -{name}")
        if sign == "+" and not known[name].available(design):
            raise PlanError.about("effects", f"{name} needs {known[name].needs}; drop +{name}")
        wanted[name] = sign == "+"
    return wanted


def _unknown(name: str) -> str:
    names = [effect.name for effect in EFFECTS]
    near = difflib.get_close_matches(name, names, 1, 0.4)
    remedy = f"did you mean '{near[0]}'?" if near else f"known are {', '.join(names)}"
    return f"'{name}' is not an effect; {remedy}"
