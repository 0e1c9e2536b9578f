"""What to change to mend a design: each proposal with its one number, what it brings, and what it costs."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from .. import theory
from ..design import Design, DesignError
from ..effects.field import exit_pupil_vergence, half_sizes, ray_blur
from ..evaluation.rims import FieldLimit, field_limit
from ..report.figures.depth_precision import focal_plane_sigma
from .pictures.svg import short

NOTEWORTHY = 0.005
"""Relative change from which a consequence is told."""
BLUR_PX = 0.5
"""Microlens defocus that a change of d_2 may leave without f_ml following [px]."""
GOLDEN = (math.sqrt(5) - 1) / 2
STEPS = 48
"""Of a search by golden section (1e-10 of the range is left) or by halving (4e-15)."""


@dataclass(frozen=True)
class Fix:
    """One proposal."""

    key: str
    """Stable name, e.g. "match-d_2"."""
    label: str
    changes: Mapping[str, float] = field(default_factory=dict)
    """The paper's symbols and their new values [mm], for `Design.replace`; empty where it cannot be done."""
    outcome: str = ""
    """What it brings and what it costs."""
    why_not: str = ""
    """Why it cannot be done, or need not be; "" where it can."""


class Facts(NamedTuple):
    """What a change is judged by; of the thin lens."""

    fill_factor: float
    undistorted_mm: float
    """Largest undistorted object radius at d_f; may be inf."""
    room_mm: float
    """At the sensor's corner; negative where it is distorted."""
    sigma_mm: float
    """Depth precision at the focal plane."""
    views: float
    """Pixels across a microlens image."""


class Proposal(NamedTuple):
    """A label, and the value [mm] of one symbol that does what it says, or why there is none."""

    key: str
    label: str
    symbol: str
    value: float | None
    why_not: str = ""


def proposals(design: Design) -> tuple[Fix, ...]:
    """Everything that one number could mend, always in the same order.

    Parameters
    ----------
    design : Design
        Judged by its thin twin where the lens is real.

    Returns
    -------
    tuple of Fix
        f-numbers matched by d_2, D_F and d_3; the whole sensor undistorted by the least change of d_3; the largest
        undistorted field by d_3; image-space telecentricity. `changes` applied to the design do what the label says;
        those that cannot, or have nothing to do, say why.
    """
    now = facts(design)
    every = (*_matching(design, now), _undistorting(design), _widest(design), _telecentric(design))
    return tuple(_with_consequences(design, now, proposal) for proposal in every)


def facts(design: Design) -> Facts:
    """What of a design the proposals change."""
    thin = design.thin_twin
    optics = (thin.f, thin.d_f, thin.d_3)
    limit = field_limit(thin, _corner(thin))
    return Facts(
        fill_factor=float(theory.fill_factor(thin.D_F, thin.d, thin.d_2, *optics)),
        undistorted_mm=limit.radius,
        room_mm=limit.room,
        sigma_mm=focal_plane_sigma(thin),
        views=float(theory.geometric_views(thin.D_F, thin.q, thin.d_2, *optics)),
    )


def _corner(design: Design) -> float:
    """Object radius that the sensor's corner sees on the focal plane [mm]."""
    return math.hypot(*half_sizes(design)) * design.d_f / design.d_1


def _matching(design: Design, now: Facts) -> Iterator[Proposal]:
    f, d_f, d_3, D_F, d, d_2 = design.f, design.d_f, design.d_3, design.D_F, design.d, design.d_2
    small = "the FAP is so small that microlens images never grow to their pitch, whatever d_2 is"
    no_size = "no FAP diameter matches: the exit pupil lies between microlens array and sensor"
    no_distance = "no FAP distance in front of the focal plane matches; use a larger FAP or a longer d_2"
    at_lens = float(theory.fill_factor(D_F, d, d_2, f, d_f, 0.0))
    if at_lens > 1:
        no_distance = (
            f"no FAP distance matches: even at the lens, where images are smallest, D_F fills {short(at_lens, 3)} of a "
            "pitch; use a smaller FAP or a shorter d_2"
        )
    ways = (
        ("d_2", theory.matched_sensor_distance(D_F, d, f, d_f, d_3), small),
        ("D_F", theory.matched_pupil_diameter(d, d_2, f, d_f, d_3), no_size),
        ("d_3", theory.matched_pupil_distance(D_F, d, d_2, f, d_f), no_distance),
    )
    matched = abs(now.fill_factor - 1) < 1e-9
    for symbol, answer, why_not in ways:
        reason = "the f-number is matched already" if matched else "" if bool(answer.exists) else why_not
        value = None if reason else float(answer.value)
        yield Proposal(f"match-{symbol}", f"Match f-number by {symbol}", symbol, value, reason)


def _undistorting(design: Design) -> Proposal:
    """The FAP moved no farther than the corner's pencil needs to clear every rim."""
    offer = Proposal("undistort-d_3", "Free the whole sensor by d_3", "d_3", None)
    corner = _corner(design)

    def room(d_3: float) -> float:
        return _limit_at(design, d_3, corner).room

    if room(design.d_3) >= 0:
        return offer._replace(why_not="the whole sensor is undistorted already")
    # Room times the gap is concave in d_3, so the distances with room are one interval.
    best = _highest(room, design.d_f * (1 - 1e-9), _rims(design))
    if room(best) < 0:
        rim = _limit_at(design, best, corner).rim
        return offer._replace(why_not=f"no FAP distance frees it: the {rim} is too small for this FAP and sensor")
    inside, outside = best, design.d_3
    for _ in range(STEPS):
        middle = 0.5 * (inside + outside)
        inside, outside = (middle, outside) if room(middle) >= 0 else (inside, middle)
    return offer._replace(value=inside)


def _widest(design: Design) -> Proposal:
    offer = Proposal("widest-field-d_3", "Largest undistorted field by d_3", "d_3", None)

    def radius(d_3: float) -> float:
        return _limit_at(design, d_3, 0.0).radius

    rims = _rims(design)
    best, now = _highest(radius, max(*rims, design.d_3), rims), radius(design.d_3)
    if radius(best) == 0:
        return offer._replace(why_not="no FAP distance leaves any field undistorted: the FAP is wider than a rim")
    if radius(best) <= now * (1 + 1e-9):
        return offer._replace(why_not="no other FAP distance gives a larger undistorted field")
    return offer._replace(value=best)


def _telecentric(design: Design) -> Proposal:
    offer = Proposal("telecentric", "Go telecentric (d_3 = f)", "d_3", design.f)
    if theory.is_telecentric(design.f, design.d_3):
        return offer._replace(value=None, why_not="it is image-space telecentric already")
    return offer


def _rims(design: Design) -> list[float]:
    """Distances of the rims that the FAP's pencils pass: the lens's, and those of further stops."""
    return [0.0, *(stop.distance for stop in design.stops)]


def _limit_at(design: Design, d_3: float, object_radius: float) -> FieldLimit:
    """What limits the field of the same thin camera with its FAP elsewhere; without the checks of `replace`."""
    thin = design.thin_twin
    moved = thin.model_copy(update={"aperture": thin.aperture.model_copy(update={"distance": d_3})})
    return field_limit(moved, object_radius)


def _highest(value: Callable[[float], float], high: float, corners: list[float]) -> float:
    """Where a function from 0 to `high` is largest that rises up to the last of `corners` at most, and then falls.

    A corner is tried as it is, and where there is but the one at 0, nothing else is.
    """
    if corners == [0.0]:
        return 0.0
    a, b = 0.0, min(high, max(corners))
    for _ in range(STEPS):
        left, right = b - GOLDEN * (b - a), a + GOLDEN * (b - a)
        if value(left) >= value(right):
            b = right
        else:
            a = left
    return max([*(place for place in corners if 0.0 <= place <= high), 0.5 * (a + b)], key=value)


def _with_consequences(design: Design, now: Facts, offer: Proposal) -> Fix:
    """The proposal with what follows from it, told from the changed design itself."""
    if offer.value is None:
        return Fix(offer.key, offer.label, why_not=offer.why_not)
    changes = {offer.symbol: offer.value}
    try:
        changed = design.replace(**changes)
        focal_length = _in_focus(design, changed)
        if focal_length is not None:
            changes["f_ml"] = focal_length
            changed = design.replace(**changes)
    except DesignError as error:
        return Fix(offer.key, offer.label, why_not=error.problems[0].message)
    return Fix(offer.key, offer.label, changes, _outcome(changes, now, facts(changed)))


def _in_focus(design: Design, changed: Design) -> float | None:
    """The f_ml that the changed design needs to keep its microlenses in focus; None where its own will do."""
    if ray_blur(changed) <= max(ray_blur(design), BLUR_PX * design.q):
        return None
    power = 1 / changed.d_2 + exit_pupil_vergence(changed)
    return 1 / power if power > 0 else None


def _outcome(changes: Mapping[str, float], before: Facts, after: Facts) -> str:
    brings: list[str] = []
    costs: list[str] = []
    b, a = before, after
    for name, unit, old, new, better in (
        ("fill factor", "", b.fill_factor, a.fill_factor, abs(a.fill_factor - 1) <= abs(b.fill_factor - 1)),
        ("undistorted to", " mm", b.undistorted_mm, a.undistorted_mm, a.undistorted_mm >= b.undistorted_mm),
        ("depth precision", " mm", b.sigma_mm, a.sigma_mm, a.sigma_mm <= b.sigma_mm),
        ("views across", "", b.views, a.views, a.views >= b.views),
    ):
        if math.isfinite(new) and abs(new - old) > NOTEWORTHY * max(abs(old), abs(new)):
            (brings if better else costs).append(f"{name} {short(old, 3)} → {short(new, 3)}{unit}")
    if before.undistorted_mm < after.undistorted_mm == math.inf:
        brings.append("no field is too large")
    if after.room_mm < 0 <= before.room_mm:
        costs.append(f"the sensor's corner gets distorted ({short(-after.room_mm, 2)} mm of room missing)")
    sets = ", ".join(f"{symbol} = {short(value, 5)} mm" for symbol, value in changes.items())
    return "; ".join([sets, *brings[:3], *([f"costs: {', '.join(costs)}"] if costs else [])])
