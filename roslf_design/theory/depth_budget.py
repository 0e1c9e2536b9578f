"""The uncertainty budget of depth, in the terms of the GUM (JCGM 100): what each source adds, and all together.

``u_c^2 = sum of u_i^2``, ``U = k u_c``. Noise, mismatch and veil meet in the Fisher information of one measurement
(`.disparity_error`), which is not a sum: each has what it adds to those before it, so that squares add up exactly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from .._arrays import Array, by_value
from ..camera import TEMPERATURES, Camera, Number
from ..words import clauses, length, listed, uncertainty
from .depth_error import (
    MOST_FILL,
    MOST_FITTED,
    depth_error,
    fill_left,
    ideal,
    lengths_error,
    lenses_in_pixel,
    overlap_error,
    seen_at,
    temperature_error,
    temperatures_met,
)
from .depth_of_field import view_blur
from .disparity_error import axial_disparity_sigmas, finest_seen, folds
from .disparity_information import Seen
from .length_covariance import CalibratedLengths, LengthCovariance
from .photometry import NOTHING, Beside, electrons, full_level
from .quantity import Depth

COVERAGE = 2
"""k: 95 % of depths lie within U where errors are normal."""
NOISE, MISMATCH, VEIL, OVERLAP = "shot and read noise", "view mismatch", "veil", "image overlap"
BUILT, CALIBRATED, WARMTH = "lengths as built", "lengths as calibrated", "temperature"
WORSE = 1.02
"""Ratio of U at a range's worse end to that over the range from which both are told."""
MODEL_ALONE = "no board covers that distance: there the model alone tells depth"
FULL, ALIASED = "pixels are full", "the texture aliases"
CAUSES = FULL, ALIASED
"""Reasons for which an infinite term says so, in its remark."""
SHARP = 1.6
"""Pitches that single views are blurred over from which on depth is told with a doubt: up to 1.5 walls before three
cameras are told to 1.4 times the noise."""
GIVEN = "in the disparity error that the design gives"
Kind = Literal["precision", "trueness"]
KINDS: tuple[Kind, ...] = ("precision", "trueness")


@by_value
@dataclass(frozen=True)
class BudgetTerm:
    """Source of uncertainty."""

    name: str
    type: Literal["A", "B"]
    """"A" where measurements of this camera tell it by their statistics; "B" where data sheets, limits or laws do."""
    kind: Kind
    """"precision" where each microlens has an error of its own, "trueness" where all have the same."""
    u_mm: Array | float | None
    """Standard uncertainty [mm], of builds in their shape; None where nothing gives it."""
    remark: str = ""
    """Basis of the number, or the reason why there is none."""

    def to_dict(self) -> dict[str, Any]:
        """Entry of `depth.expected.terms`, of one build."""
        u = None if self.u_mm is None else float(self.u_mm)
        return {"name": self.name, "type": self.type, "u_mm": u, "kind": self.kind, "remark": self.remark}


@by_value
@dataclass(frozen=True)
class DepthBudget:
    """Terms of the uncertainty of depth on the axis, at one distance."""

    terms: tuple[BudgetTerm, ...]
    disparity_pitches: Array
    """Standard error of the disparity between the FAP's rims that noise alone leaves [microlens pitches]."""
    worst: tuple[float, float] | None = None
    """Temperature of the worse end of a range [degrees C] and U there [mm]; None where that is hardly more than U."""
    uncovered: bool = False
    """Whether no board covers the distance."""
    calibrated_at_degc: Array | float | None = None
    """Temperature that the term of temperature counts from [degrees C]; None where there is none."""
    ahead_mm: float = math.inf
    """Distance ahead of the tip, of one build [mm]."""
    doubt: str = ""
    """Reason to believe the noise less; empty where none is known."""

    def of_kind(self, kind: Kind | None = None) -> Array:
        """Root sum of squares of all terms, or of those of a kind [mm]."""
        known = [t.u_mm for t in self.terms if t.u_mm is not None and kind in (None, t.kind)]
        return np.asarray(np.sqrt(np.sum([np.square(u) for u in np.broadcast_arrays(0.0, *known)], axis=0)))

    @property
    def u_z_mm(self) -> Array:
        """Combined standard uncertainty u_c [mm]."""
        return self.of_kind()

    @property
    def expanded_mm(self) -> Array:
        """Expanded uncertainty U = k u_c [mm]."""
        return COVERAGE * self.u_z_mm

    @property
    def largest(self) -> BudgetTerm:
        """The largest term, of builds by their median."""
        known = [term for term in self.terms if term.u_mm is not None]
        return max(known, key=lambda term: _typical(term.u_mm))

    @property
    def cause(self) -> str:
        """Name of the largest term, or one of `CAUSES` where that is why it is infinite."""
        return next((cause for cause in CAUSES if cause in self.largest.remark), self.largest.name)

    @property
    def mostly(self) -> str:
        """Its largest term, lengths that are taken as drawn, and the caution."""
        drawn = f"{BUILT} not in it" * self.as_drawn
        return clauses(self.cause if self.cause in CAUSES else f"mostly {self.cause}", drawn, self.caution)

    @property
    def caution(self) -> str:
        """Reasons to believe the sum less; empty where none is known."""
        worst = ""
        if self.worst is not None:
            degrees, expanded = self.worst
            worst = f"at {degrees:g} °C, the worse end of environment.range, U = {uncertainty(expanded, 3)}"
        return clauses(worst, MODEL_ALONE * self.uncovered, self.doubt)

    @property
    def words(self) -> str:
        """The expanded uncertainty and its largest term, of one build."""
        return f"U = {self.expanded_words('± ')}, mostly {self.largest.name}"

    @property
    def no_depth(self) -> str:
        """Words in place of U where that is as large as the distance, or infinite; empty where it is a number."""
        return "" if self.expanded_mm < self.ahead_mm else self.expanded_words()

    def expanded_words(self, sign: str = "", digits: int = 3) -> str:
        """U with its unit, of one build."""
        return uncertainty(float(self.expanded_mm), digits, sign, self.ahead_mm)

    @property
    def left_out(self) -> str:
        """Sources that nothing gives a number for, each with the reason."""
        return "; ".join(f"{term.name}: {term.remark}" for term in self._lacking)

    @property
    def _lacking(self) -> list[BudgetTerm]:
        return [term for term in self.terms if term.u_mm is None and term.remark != GIVEN]

    @property
    def as_drawn(self) -> bool:
        """Whether neither tolerances nor a calibration say how far lengths are off: it takes them as drawn."""
        return BUILT in [term.name for term in self._lacking]

    @property
    def lengths(self) -> str:
        """How it takes lengths: as drawn, as built or as calibrated."""
        names = [term.name for term in self.terms]
        return "as drawn" if self.as_drawn else "as calibrated" if CALIBRATED in names else "as built"

    @property
    def counted(self) -> str:
        """Sources that the sum is of, and those that it is without."""
        names = [term.name for term in self.terms if term.u_mm is not None and np.any(term.u_mm)]
        lacking = [term.name for term in self._lacking]
        without = f", without {listed(lacking)}" if lacking else ""
        return f"of {listed(names or ['nothing'])}{without}"

    def to_dict(self) -> dict[str, Any]:
        """`depth.expected` of `roslf evaluate --json`, of one build."""
        return {
            "u_z_mm": float(self.u_z_mm),
            "expanded_mm": float(self.expanded_mm),
            "k": COVERAGE,
            "lengths": self.lengths,
            "calibrated_at_degc": None if self.calibrated_at_degc is None else float(self.calibrated_at_degc),
            "caution": self.caution,
            "terms": [term.to_dict() for term in self.terms],
        }


def depth_budget(
    c: Camera,
    at: Depth | Array = None,
    *,
    build: LengthCovariance | None = None,
    calibration: CalibratedLengths | None = None,
    worst: bool = True,
) -> DepthBudget:
    """The uncertainty budget of depth on the axis, of one measurement of ``depth.window`` microlenses.

    Parameters
    ----------
    c : Camera
        Its builds lead all axes.
    at : float or ndarray, optional
        Distance ahead of the bore's tip [mm]; None is the focal plane.
    build : LengthCovariance, optional
        Of the lengths as a workshop makes them; without those that builds of `c` differ in already.
    calibration : CalibratedLengths, optional
        In place of the build, whose tolerances are what was known before (`CalibratedLengths.after`). What the lengths
        that it knows do not tell of the others keeps a term of its own.
    worst : bool
        Whether the worse end of a range of temperatures is looked for.

    Returns
    -------
    DepthBudget
        [mm]; as depths ahead of the tip have it.
    """
    mismatched, veiled = Beside.mismatched(c), Beside.of(c)
    besides = (NOTHING, mismatched, veiled) if np.any(veiled.veil) else (NOTHING, mismatched)
    plane, doubt = seen_at(c, at), ""
    sigmas = axial_disparity_sigmas(c, plane, besides)
    noise, uneven, hazy = (np.abs(depth_error(c, at, sigmas[k])) for k in (0, 1, -1))
    if "depth.disparity_error" in c.numbers:
        terms = [
            BudgetTerm("disparity error", "B", "precision", noise, "as the design gives it"),
            BudgetTerm(MISMATCH, "B", "precision", None, GIVEN),
            BudgetTerm(VEIL, "B", "precision", None, GIVEN),
        ]
    else:
        full, veil = bool(np.any(np.isinf(noise) & (full_level(c, electrons(c, at)) < 1))), _added(hazy, uneven)
        share = f"{_percent(c['light.veil'])} of full scale"
        lost, doubt = f"; {FULL}" * full, _doubt(c, plane)
        if not full and np.any(np.isinf(noise)) and folds(c, plane).any():
            lost = f"; {ALIASED}: {_folding(c, plane)}, and views disagree"
        terms = [
            BudgetTerm(NOISE, "B", "precision", noise, f"the bound{lost}"),
            BudgetTerm(MISMATCH, "B", "precision", _added(uneven, noise), _mismatch_words(c)),
            BudgetTerm(VEIL, "B", "precision", veil, share + f"; {FULL}" * bool(np.any(np.isinf(veil)))),
        ]
        overlap = overlap_error(c, at)
        if np.any(overlap):
            terms.append(BudgetTerm(OVERLAP, "B", "precision", overlap, _overlap_words(c)))
    terms += _lengths(c, at, build, calibration)
    warmth = temperature_error(c, at)
    remark = "neither environment.range nor calibrated_at is given"
    met = temperatures_met(c)
    if met is not None:
        coldest, warmest, known = map(_typical, met)
        used = f"{coldest:g}" if coldest == warmest else f"{coldest:g} to {warmest:g}"
        middle = "the middle of the range; if it is calibrated at another, say calibrated_at in [environment]"
        where = "where it is calibrated" if TEMPERATURES[2] in c.numbers else middle
        remark = f"{used} °C, counted from {known:g} °C, {where}"
        silent = () if c.growth is None else c.growth.silent
        if silent and not np.any(warmth) and not coldest == warmest == known:
            warmth, remark = None, f"nothing says how {listed([*silent])} would grow"
    alone = bool(calibration is not None and at is not None and np.isin(at, calibration.uncovered_mm).any())
    terms.append(BudgetTerm(WARMTH, "B", "trueness", warmth, remark))
    away = c["main_lens.focal_plane"] - c.tip if at is None else at
    ahead = math.inf if np.ndim(away) else float(away)
    budget = DepthBudget(tuple(terms), sigmas[0], None, alone, None if met is None else met[2], ahead, doubt)
    if not worst or met is None or warmth is None or c.shape or np.ndim(warmth) or met[0] == met[1]:
        return budget
    return replace(budget, worst=_at_worst(c, at, budget, met))


def _overlap_words(c: Camera) -> str:
    """Reason why images that overlap tell no depth."""
    fill = _typical(fill_left(c))
    words = f"image fill {fill:.3g}: "
    if not ideal(c):
        return f"{words}beyond {MOST_FILL[c.layout]} views cannot be told apart"
    if fill > MOST_FITTED[c.layout]:
        return f"{words}beyond {MOST_FITTED[c.layout]} texture and depth cannot be told apart"
    return f"{words}light of {_typical(lenses_in_pixel(c)):.2g} microlenses adds up, and {FULL}"


def _folding(c: Camera, plane: Seen) -> str:
    """Words on detail too fine for single views."""
    stated = length(float(np.ravel(c["depth.finest"])[0]))
    return f"its detail of {stated} has {1 / _typical(finest_seen(c, plane)):.2g} microlenses a period there"


def _doubt(c: Camera, plane: Seen) -> str:
    """Reasons to believe the noise less at a plane, in words."""
    blur = _typical(view_blur(c, plane.disparity))
    unsharp = (
        f"single views are blurred over {blur:.2g} pitches there: depths of simulated pictures are off by "
        f"{'up to twice' if blur < 2.25 else 'up to five times' if blur <= 3 else 'many times'} the noise predicted"
    )
    aliased = f"{_folding(c, plane)}, and aliases" if folds(c, plane).any() else ""
    return clauses(unsharp * (blur > SHARP), aliased)


def _at_worst(
    c: Camera, at: Depth | Array, budget: DepthBudget, met: tuple[Number, Number, Number]
) -> tuple[float, float] | None:
    """Worse end of a range of temperatures, over which their term is a mean, and U there; None where hardly more."""
    coldest, warmest, known = met
    *rest, warmth = budget.terms
    ends = {
        float(end): replace(budget, terms=(*rest, replace(warmth, u_mm=temperature_error(c, at, (end, end, known)))))
        for end in (coldest, warmest)
    }
    degrees, worst = max(ends.items(), key=lambda item: float(item[1].u_z_mm))
    return (degrees, float(worst.expanded_mm)) if float(worst.u_z_mm) > WORSE * float(budget.u_z_mm) else None


def _lengths(
    c: Camera, at: Depth | Array, build: LengthCovariance | None, calibration: CalibratedLengths | None
) -> list[BudgetTerm]:
    if calibration is None:
        made = None if build is None else lengths_error(c, at, build)
        remark = "no tolerances are given" if build is None else "tolerances, the camera taken as designed"
        return [BudgetTerm(BUILT, "B", "trueness", made, remark)]
    known, left = calibration.after(build)
    kind: Literal["A", "B"] = "B" if calibration.planned else "A"
    before = "its data sheet" if build is None or calibration.information is None else "the tolerances"
    remark = f"{'as planned' if calibration.planned else 'by its pictures'}, {before} known before"
    terms = [BudgetTerm(CALIBRATED, kind, "trueness", lengths_error(c, at, known), remark)]
    if left.matrix.any():
        rest = lengths_error(c, at, left)
        terms.append(BudgetTerm(BUILT, "B", "trueness", rest, "tolerances of what calibration does not see"))
    return terms


def _added(after: Array, before: Array) -> Array:
    """Growth of a standard uncertainty, in squares; none of an infinite one."""
    with np.errstate(invalid="ignore"):
        more = np.square(after) - np.square(before)
    return np.sqrt(np.maximum(np.where(np.isinf(before), 0.0, more), 0.0))[()]


def _typical(values: Any) -> float:
    """Median over builds; of one camera its own number, without the 20 ms that numpy loads for a median."""
    values = np.ravel(values)
    return float(values[0] if values.size == 1 else np.median(values))


def _percent(share: Any) -> str:
    return f"{100 * _typical(share):.3g} %"


def _mismatch_words(c: Camera) -> str:
    words = f"{_percent(c['depth.view_mismatch'])} of brightness"
    prnu, dsnu = (_typical(c[f"sensor.{name}"]) for name in ("prnu", "dsnu"))
    words += f", PRNU {_percent(prnu)}" if prnu else ""
    return words + (f", DSNU {dsnu:.3g} e-" if dsnu else "")
