"""Proposals to mend a design: each a change of one number, what it brings, and what it costs."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera
from ..design import PATHS, Design, DesignError
from ..drawing.theme import short
from ..evaluation.fields import ROUND_FIELD, judged_part
from ..evaluation.remedies import BETWEEN, ROUNDS, nearest_holding
from ..theory.exit_pupil import is_telecentric
from ..theory.f_number import fill_factor, matched
from ..theory.field_of_view import judged_field
from ..theory.light import geometric_views, microlens_defocus_blur
from ..theory.quantities import QUANTITIES
from ..theory.tube import widest_fap
from ..theory.vignetting import corner_room, field_limit, undistorted_radii
from ..words import to_html
from .main_lens import explored_lens

Floats = NDArray[np.float64]
Change = float | str
"""Value [mm] of one number that does what is wanted, or why there is none."""

GAIN = 1e-6
"""Share by which the undistorted field grows at least where another place of the FAP is told."""
NOTEWORTHY = 0.005
"""Relative change from which a consequence is told."""
MATCHED = 0.01
"""Part of a pitch up to which images behind a bore's elements, made of lengths as sold, are matched."""
BLUR_PX = 0.5
"""Microlens defocus that a change of d_2 may leave without f_ml following [px]."""
BORE_PLACES = 2001
"""Evenly spaced places along a bore that are tried for the FAP."""
SAME_PLACE = 1e-9
"""Share of a bore's length below which two places are one."""
PEAKS = 8
"""Highest of them, at most, that are looked at more closely."""


@dataclass(frozen=True)
class Fix:
    """Proposal to mend a design."""

    key: str
    """Stable name, e.g. "match-d_2"."""
    label: str
    changes: Mapping[str, float] = field(default_factory=dict)
    """The paper's symbols and their new values [mm], for `Design.replace`; empty where it cannot be done."""
    outcome: str = ""
    """Benefit and cost of the change, in words."""
    why_not: str = ""
    """Why it cannot be done, or need not be; "" where it can."""

    @property
    def of_thin_lens(self) -> Fix:
        """Proposal behind a real lens, which none of it is traced through."""
        outcome, why_not = (text and f"thin lens: {text}" for text in (self.outcome, self.why_not))
        return replace(self, outcome=outcome, why_not=why_not)

    def page(self, settled: bool) -> dict[str, str]:
        """Values for the page; nothing is promised of a design that is still being changed."""
        promised = {"outcome": self.outcome, "why_not": self.why_not}
        told = {name: to_html(text) if settled else "" for name, text in promised.items()}
        return {"key": self.key, "label": to_html(self.label), **told}


class _Facts(NamedTuple):
    """Numbers that a change is judged by; of the thin lens."""

    fill_factor: float
    undistorted_mm: float
    """Largest undistorted object radius at d_f; may be inf."""
    room_mm: float
    """At the sensor's corner, or the rim of a round field that is required; negative where it is distorted."""
    sigma_mm: float
    """Depth noise (bound) at the focal plane."""
    views: float
    """Pixels across a microlens image."""

    @classmethod
    def of(cls, design: Design) -> _Facts:
        """_Facts of a design, or of its thin-lens model."""
        camera = Camera.of(design.thin_twin)
        limit = field_limit(camera, judged_field(camera))
        return cls(
            fill_factor=float(fill_factor(camera)),
            undistorted_mm=limit.radius,
            room_mm=limit.clearance,
            sigma_mm=float(QUANTITIES["sigma_z_mm"](camera)),
            views=float(geometric_views(camera)),
        )


def proposals(design: Design) -> tuple[Fix, ...]:
    """Everything that one number could mend, always in the same order.

    Parameters
    ----------
    design : Design
        Judged by its thin-lens model where the lens is real.

    Returns
    -------
    tuple of Fix
        f-numbers matched by d_2, D_F and d_3; the whole sensor, or the round field that is required, undistorted by
        the least change of d_3; the largest undistorted field by d_3; image-space telecentricity. `changes` applied
        to the design do what the label says; those that cannot, or have nothing to do, say why.
    """
    camera, now = Camera.of(design.thin_twin), _Facts.of(design)
    part = judged_part(design)
    focus = "d_3 = f" if camera.chain.in_air else "FAP seen through the bore at f"
    every = (
        *((f"match-{symbol}", f"Match f-number by {symbol}", symbol, way) for symbol, way in _matching(camera, now)),
        ("undistort-d_3", f"Free the {part} by d_3", "d_3", _undistorting(design, camera)),
        ("widest-field-d_3", "Largest undistorted field by d_3", "d_3", _widest(camera)),
        ("telecentric", f"Go telecentric ({focus})", "d_3", _telecentric(camera)),
    )
    fixes = tuple(_with_consequences(design, now, *proposal) for proposal in every)
    return tuple(fix.of_thin_lens for fix in fixes) if explored_lens(design).twin else fixes


def _matching(camera: Camera, now: _Facts) -> Iterator[tuple[str, Change]]:
    at_lens = float(fill_factor(camera.replace({"d_3": 0.0})))
    no_distance = "no FAP distance in front of the focal plane matches; use a larger FAP or a longer d_2"
    if at_lens > 1:
        no_distance = (
            f"no FAP distance matches: even at the lens, where images are smallest, D_F fills {short(at_lens, 3)} of a "
            "pitch; use a smaller FAP or a shorter d_2"
        )
    why_not = {
        "d_2": "the FAP is so small that microlens images never grow to their pitch, whatever d_2 is",
        "D_F": "no FAP diameter matches: the exit pupil lies on the sensor, and so all microlens images on one another",
        "d_3": no_distance,
    }
    for symbol in ("d_2", "D_F", "d_3"):
        answer = matched(camera, symbol)
        if abs(now.fill_factor - 1) < (MATCHED if camera.in_bore else 1e-9):
            yield symbol, "the f-number is matched already"
        else:
            place = float(answer.value) if answer.exists else None
            if symbol == "d_3" and camera.chain.bends:  # where it is seen in another size wherever it stands
                place = _nearest_place(camera, lambda d_3: fill_factor(camera.replace({"d_3": d_3})) - 1)
            yield symbol, why_not[symbol] if place is None else place


def _telecentric(camera: Camera) -> Change:
    """The FAP in the plane that the main lens sees at its focus."""
    if is_telecentric(camera):
        return "it is image-space telecentric already"

    def off(d_3: Floats | float) -> Floats:
        plane = camera.plane(d_3)
        return np.asarray(plane.b - camera.f * plane.a)

    if camera.chain.in_air:
        return float(camera.f)
    place = _nearest_place(camera, off)
    return "no place before the focal plane is seen at the main lens's focus" if place is None else place


def _nearest_place(camera: Camera, off: Callable[[Floats | float], Floats]) -> float | None:
    """Distance of the FAP [mm, with a ruler] at which a function is 0, the one nearest to today's; None without."""
    from scipy.optimize import brentq

    ends = _bore(camera)
    with np.errstate(divide="ignore", invalid="ignore"):
        values = off(ends)
    turns = np.flatnonzero(np.sign(values[:-1]) * np.sign(values[1:]) <= 0)
    places = [float(brentq(lambda z: float(off(z)), ends[k], ends[k + 1], xtol=1e-12)) for k in turns]
    # Beyond a pole a function changes its sign, too.
    scale = float(np.nanmedian(np.abs(values[np.isfinite(values)])))
    zeros = [place for place in places if abs(float(off(place))) < 1e-6 * max(scale, 1.0)]
    return min(zeros, key=lambda place: abs(place - float(camera[PATHS["d_3"]])), default=None)


def _undistorting(design: Design, camera: Camera) -> Change:
    """The FAP moved no farther than the outermost pencil needs to clear every rim."""

    def rooms(d_3: Floats | float) -> Floats:
        changed = camera.replace({"d_3": d_3})
        return corner_room(changed, judged_field(changed))

    def least(d_3: Floats) -> Floats:
        return np.asarray(rooms(d_3).min(axis=0))

    here = float(camera[PATHS["d_3"]])  # with a ruler, as what replaces it
    if rooms(here).min() >= 0:
        return f"the {judged_part(design)} is undistorted already"
    # What the sensor sees changes with the distance, too: room may come, go and come again.
    places = _with_peaks(least, camera)
    free = nearest_holding(lambda d_3: least(d_3) >= 0, places[np.argsort(np.abs(places - here))], here)
    if free is None:
        tightest = int(np.argmin(rooms(float(places[int(np.argmax(least(places)))]))))
        rim, part = camera.rims[tightest].opening, judged_part(design).split()[-1]
        return f"no FAP distance frees it: the {rim} is too small for this FAP and {part}"
    return free


def _widest(camera: Camera) -> Change:
    def radius(d_3: Floats | float) -> Floats:
        return np.asarray(undistorted_radii(camera.replace({"d_3": d_3})).min(axis=0))

    places = _with_peaks(radius, camera)
    best = float(places[int(np.argmax(radius(places)))])
    if radius(best) <= 0:
        return "no FAP distance leaves any field undistorted: the FAP is wider than a rim"
    if radius(best) <= radius(float(camera[PATHS["d_3"]])) * (1 + GAIN):
        return "no other FAP distance gives a larger undistorted field"
    return best


def _bore(camera: Camera) -> Floats:
    """Distances of the FAP that are tried [mm, with a ruler]: evenly spaced, today's, and every rim's own."""
    low, end = _free(camera)
    own = [place for place in (float(rim.ruler_distance) for rim in camera.rims) if low <= place < end]
    even = np.linspace(low, end, BORE_PLACES)[:-1]
    places = np.union1d(even, [*own, float(camera[PATHS["d_3"]])])
    return places[np.diff(places, prepend=-end) > SAME_PLACE * end]


def _free(camera: Camera) -> tuple[float, float]:
    """Ends of the room that the FAP can be moved in, past no element [mm before the main lens]."""
    here, ends = float(camera[PATHS["d_3"]]), [(float(at.start), float(at.end)) for at in camera.in_bore]
    nearest = max((end for _, end in ends if end <= here), default=0.0)
    return min(nearest, here), min((start for start, _ in ends if start > here), default=float(camera[PATHS["d_f"]]))


def _with_peaks(value: Callable[[Floats], Floats], camera: Camera) -> Floats:
    """Distances that are tried, and where between them a function of them is largest."""
    places = _bore(camera)
    values = value(places)
    rises = np.concatenate([[True], values[1:] > values[:-1]])
    falls = np.concatenate([values[1:] <= values[:-1], [True]])
    peaks = np.flatnonzero(rises & falls)
    top = peaks[np.argsort(values[peaks])[-PEAKS:]]
    low, high = places[np.maximum(top - 1, 0)], places[np.minimum(top + 1, len(places) - 1)]
    rows = np.arange(len(top))
    for _ in range(ROUNDS):
        tried = np.linspace(low, high, BETWEEN, axis=1)
        best = np.argmax(value(tried.ravel()).reshape(tried.shape), axis=1)
        low, high = tried[rows, np.maximum(best - 1, 0)], tried[rows, np.minimum(best + 1, BETWEEN - 1)]
    return np.union1d(places, 0.5 * (low + high))


def _with_consequences(design: Design, now: _Facts, key: str, label: str, symbol: str, change: Change) -> Fix:
    """The proposal with what follows from it, told from the changed design itself."""
    if isinstance(change, str):
        return Fix(key, label, why_not=change)
    changes = {symbol: change}
    if symbol == "d_3" and not (room := _free(Camera.of(design.thin_twin)))[0] <= change <= room[1]:
        return Fix(key, label, why_not=f"d_3 = {short(change, 5)} mm lies beyond what stands before or behind the FAP")
    if symbol == "D_F" and change > (widest := float(widest_fap(Camera.of(design.thin_twin)))):
        why_not = f"D_F = {short(change, 5)} mm does not fit the {short(widest, 4)} mm of lens and tube"
        return Fix(key, label, why_not=why_not)
    try:
        changed = design.replace(**changes)
        focal_length = _in_focus(design, changed)
        if focal_length is not None:
            changes["f_ml"] = focal_length
            changed = design.replace(**changes)
    except DesignError as error:
        return Fix(key, label, why_not=error.problems[0].message)
    outermost = "round field's rim" if judged_part(design) == ROUND_FIELD else "sensor's corner"
    return Fix(key, label, changes, _outcome(changes, now, _Facts.of(changed), outermost))


def _in_focus(design: Design, changed: Design) -> float | None:
    """The f_ml that the changed design needs to keep its microlenses in focus; None where its own will do."""
    before, after = Camera.of(design.thin_twin), Camera.of(changed.thin_twin)
    if microlens_defocus_blur(after) <= max(float(microlens_defocus_blur(before)), BLUR_PX * design.q):
        return None
    power = float(1 / after.seen.d_2 + after.seen.vergence)
    return 1 / power if power > 0 else None


def _outcome(changes: Mapping[str, float], before: _Facts, after: _Facts, outermost: str) -> str:
    brings: list[str] = []
    costs: list[str] = []
    b, a = before, after
    for name, unit, old, new, better in (
        ("image fill", "", b.fill_factor, a.fill_factor, abs(a.fill_factor - 1) <= abs(b.fill_factor - 1)),
        ("undistorted to", " mm", b.undistorted_mm, a.undistorted_mm, a.undistorted_mm >= b.undistorted_mm),
        ("depth noise", " mm", b.sigma_mm, a.sigma_mm, a.sigma_mm <= b.sigma_mm),
        ("views across", "", b.views, a.views, a.views >= b.views),
    ):
        if math.isfinite(new) and abs(new - old) > NOTEWORTHY * max(abs(old), abs(new)):
            (brings if better else costs).append(f"{name} {short(old, 3)} → {short(new, 3)}{unit}")
    if before.undistorted_mm < after.undistorted_mm == math.inf:
        brings.append("no field is too large")
    if after.room_mm < 0 <= before.room_mm:
        costs.append(f"the {outermost} gets distorted ({short(-after.room_mm, 2)} mm of clearance missing)")
    sets = ", ".join(f"{symbol} = {short(value, 5)} mm" for symbol, value in changes.items())
    return "; ".join([sets, *brings[:3], *([f"costs: {', '.join(costs)}"] if costs else [])])
