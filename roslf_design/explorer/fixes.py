"""What to change to mend a design: each proposal with its one number, what it brings, and what it costs."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from .. import theory
from ..design import Design, DesignError
from ..effects.field import exit_pupil_vergence, half_sizes, ray_blur
from ..evaluation.rims import field_limit
from ..report.figures.depth_precision import focal_plane_sigma
from ..theory.matched import Matched
from .pictures.svg import short

WORTH_TELLING = 0.005
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
    mismatch_px: float
    undistorted_mm: float
    """Largest undistorted object radius at d_f; may be inf."""
    room_mm: float
    """At the sensor's corner; negative where it is distorted."""
    sigma_mm: float
    """Depth precision at the focal plane."""
    views: float
    """Pixels across a microlens image."""


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
    return tuple(_checked(design, *proposal) for proposal in _proposals(design))


def facts(design: Design) -> Facts:
    """What of a design the proposals change."""
    seen = design.thin_twin
    optics = (seen.f, seen.d_f, seen.d_3)
    corner = math.hypot(*half_sizes(seen)) * seen.d_f / seen.d_1
    limit = field_limit(seen, corner)
    return Facts(
        fill_factor=float(theory.fill_factor(seen.D_F, seen.d, seen.d_2, *optics)),
        mismatch_px=float(theory.matching_mismatch(seen.D_F, seen.d, seen.q, seen.d_2, *optics)),
        undistorted_mm=limit.radius,
        room_mm=limit.room,
        sigma_mm=focal_plane_sigma(seen),
        views=float(theory.geometric_views(seen.D_F, seen.q, seen.d_2, *optics)),
    )


Proposal = tuple[str, str, str, float | None, str]
"""Key, label, symbol, value [mm] or None, why not."""


def _proposals(design: Design) -> Iterator[Proposal]:
    yield from _matching(design)
    yield _undistorting(design)
    yield _widest(design)
    yield _telecentric(design)


def _matching(design: Design) -> Iterator[Proposal]:
    f, d_f, d_3 = design.f, design.d_f, design.d_3
    matched = abs(facts(design).fill_factor - 1) < 1e-9
    small = "the FAP is so small that microlens images never grow to their pitch, whatever d_2 is"
    no_size = "no FAP diameter matches: the exit pupil lies between microlens array and sensor"
    ways: tuple[tuple[str, Callable[[], Matched], str], ...] = (
        ("d_2", lambda: theory.matched_sensor_distance(design.D_F, design.d, f, d_f, d_3), small),
        ("D_F", lambda: theory.matched_pupil_diameter(design.d, design.d_2, f, d_f, d_3), no_size),
        ("d_3", lambda: theory.matched_pupil_distance(design.D_F, design.d, design.d_2, f, d_f), _no_distance(design)),
    )
    for symbol, solve, why_not in ways:
        found = solve()
        reason = "the f-number is matched already" if matched else "" if bool(found.exists) else why_not
        yield f"match-{symbol}", f"Match f-number by {symbol}", symbol, None if reason else float(found.value), reason


def _no_distance(design: Design) -> str:
    at_lens = float(theory.fill_factor(design.D_F, design.d, design.d_2, design.f, design.d_f, 0.0))
    if at_lens > 1:
        return (
            f"no FAP distance matches: even at the lens, where images are smallest, D_F fills {short(at_lens, 3)} of a "
            "pitch; use a smaller FAP or a shorter d_2"
        )
    return "no FAP distance in front of the focal plane matches; use a larger FAP or a longer d_2"


def _undistorting(design: Design) -> Proposal:
    """The FAP moved no farther than the corner's pencil needs to clear every rim."""
    key, label = "undistort-d_3", "Free the whole sensor by d_3"
    corner = math.hypot(*half_sizes(design)) * design.d_f / design.d_1

    def room(d_3: float) -> float:
        return field_limit(_moved(design, d_3), corner).room

    if room(design.d_3) >= 0:
        return key, label, "d_3", None, "the whole sensor is undistorted already"
    # Room times the gap is concave in d_3, so the distances with room are one interval.
    best = _highest(room, 0.0, design.d_f * (1 - 1e-9), [0.0, *(stop.distance for stop in design.stops)])
    if room(best) < 0:
        rim = field_limit(_moved(design, best), corner).rim
        return key, label, "d_3", None, f"no FAP distance frees it: the {rim} is too small for this FAP and sensor"
    inside, outside = best, design.d_3
    for _ in range(STEPS):
        middle = 0.5 * (inside + outside)
        inside, outside = (middle, outside) if room(middle) >= 0 else (inside, middle)
    return key, label, "d_3", inside, ""


def _widest(design: Design) -> Proposal:
    key, label = "widest-field-d_3", "Largest undistorted field by d_3"

    def radius(d_3: float) -> float:
        return field_limit(_moved(design, d_3), 0.0).radius

    rims = [0.0, *(stop.distance for stop in design.stops)]
    best, now = _highest(radius, 0.0, max(max(rims), design.d_3), rims), radius(design.d_3)
    if radius(best) == 0:
        return key, label, "d_3", None, "no FAP distance leaves any field undistorted: the FAP is wider than a rim"
    if radius(best) <= now * (1 + 1e-9):
        return key, label, "d_3", None, "no other FAP distance gives a larger undistorted field"
    return key, label, "d_3", best, ""


def _telecentric(design: Design) -> Proposal:
    key, label = "telecentric", "Go telecentric (d_3 = f)"
    if theory.is_telecentric(design.f, design.d_3):
        return key, label, "d_3", None, "it is image-space telecentric already"
    return key, label, "d_3", design.f, ""


def _moved(design: Design, d_3: float) -> Design:
    """The same thin camera with its FAP elsewhere, without the checks of `replace`: for searches."""
    seen = design.thin_twin
    return seen.model_copy(update={"aperture": seen.aperture.model_copy(update={"distance": d_3})})


def _highest(value: Callable[[float], float], low: float, high: float, corners: list[float]) -> float:
    """Where a function is largest that rises up to the last of `corners` at most, and then falls.

    A corner is tried as it is, and where there is but one, nothing else is.
    """
    candidates = [place for place in corners if low <= place <= high]
    if corners == [low]:
        return low
    high = min(high, max(corners))
    a, b = low, high
    for _ in range(STEPS):
        left, right = b - GOLDEN * (b - a), a + GOLDEN * (b - a)
        if value(left) >= value(right):
            b = right
        else:
            a = left
    return max([*candidates, 0.5 * (a + b)], key=value)


def _checked(design: Design, key: str, label: str, symbol: str, value: float | None, why_not: str) -> Fix:
    """The proposal with its consequences, told from the changed design itself."""
    if value is None:
        return Fix(key, label, why_not=why_not)
    changes = {symbol: value}
    try:
        changed = design.replace(**changes)
        follows = _in_focus(design, changed)
        if follows is not None:
            changes["f_ml"] = follows
            changed = design.replace(**changes)
    except DesignError as error:
        return Fix(key, label, why_not=error.problems[0].message)
    return Fix(key, label, changes, _told(changes, facts(design), facts(changed)))


def _in_focus(design: Design, changed: Design) -> float | None:
    """The f_ml that the changed design needs to keep its microlenses in focus; None where its own will do."""
    if ray_blur(changed) <= max(ray_blur(design), BLUR_PX * design.q):
        return None
    power = 1 / changed.d_2 + exit_pupil_vergence(changed)
    return 1 / power if power > 0 else None


def _told(changes: Mapping[str, float], before: Facts, after: Facts) -> str:
    brings: list[str] = []
    costs: list[str] = []
    moves = (
        (
            "fill factor",
            "",
            before.fill_factor,
            after.fill_factor,
            abs(after.fill_factor - 1) <= abs(before.fill_factor - 1),
        ),
        (
            "undistorted to",
            " mm",
            before.undistorted_mm,
            after.undistorted_mm,
            after.undistorted_mm >= before.undistorted_mm,
        ),
        ("depth precision", " mm", before.sigma_mm, after.sigma_mm, after.sigma_mm <= before.sigma_mm),
        ("views across", "", before.views, after.views, after.views >= before.views),
    )
    for name, unit, old, new, better in moves:
        if not math.isfinite(new) or abs(new - old) <= WORTH_TELLING * max(abs(old), abs(new)):
            continue
        (brings if better else costs).append(f"{name} {short(old, 3)} → {short(new, 3)}{unit}")
    if before.undistorted_mm < after.undistorted_mm == math.inf:
        brings.append("no field is too large")
    if after.room_mm < 0 <= before.room_mm:
        costs.append(f"the sensor's corner gets distorted ({short(-after.room_mm, 2)} mm of room missing)")
    sets = ", ".join(f"{symbol} = {short(value, 5)} mm" for symbol, value in changes.items())
    parts = [sets, *brings[:3]]
    if costs:
        parts.append(f"costs: {', '.join(costs)}")
    return "; ".join(parts)
