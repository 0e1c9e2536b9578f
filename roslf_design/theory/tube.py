"""Tube of a scope: the parts in it and how wide it is, as sizes are stated: at 20 degrees C (`Camera.cold`)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from .._arrays import Array
from ..bore.fold import fold_of
from ..bore.opening import ClearAperture
from ..bore.part import Number
from ..camera import Camera
from ..design import PATHS
from ..design.parts import tube_room, widening
from ..lenses.glass import ROOM
from ..lenses.prescription import Prescription
from ..words import clauses, listed, number, the
from .light import as_cut

WALL, GUIDE, LENGTH, OUTER = "tube.wall", "tube.light_guide", "tube.length", "tube.outer_diameter"
PROXIMAL = "tube.proximal_diameter"
NARROWEST = "narrowest tube about the optics,"
"""Tube where no design states one, in words."""
WIDTHS = INSERTED, WHOLE = "insertion_diameter_mm", "outer_diameter_mm"
"""Names of the two widths: of what is inserted, which a stated tube is, and of all of the camera."""
PACKAGE = "sensor.package"
NEAR = 1e-3
"""Share of its distance within which a rim stands at a cone's wide end."""
RIM = np.linspace(0.0, 2 * np.pi, 72, endpoint=False)
"""Angles at which a rim that stands sideways is looked at [rad]."""


class _Housed(NamedTuple):
    """A part of known width."""

    name: str
    """Name in ray budgets; of an element's two faces both."""
    width: Number
    """Diameter, of a bought window or lens its outer, of a real lens that of its widest surface, or diagonal, and twice
    how far it is decentred [mm]."""
    place: Number
    """Its end towards the scene [mm before the main lens, below 0 behind it]."""
    clear: Number
    """Width of its clear aperture [mm]."""
    aside: Number | None = None
    """Its farthest point from the tube's axis, where a fold turns its own [mm]; the wall may open for it."""
    corners: Number = 0.0
    """Width across the corners of the square block that it may be ground from [mm]; 0 of what is round."""

    def needs(self, c: Camera) -> Number:
        """Room that it needs between walls, across [mm]."""
        return self.across if self.aside is None else self.across - 2 * shell(c)

    @property
    def across(self) -> Number:
        """Width that it takes, without walls [mm]."""
        return self.width if self.aside is None else 2 * self.aside

    def sizes(self, c: Camera) -> str:
        """Its width, or how far beside the tube's axis it ends, in words."""
        if self.aside is None:
            return f"{float(self.width):.4g} mm"
        return f"sideways, out to {float(self.aside):.4g} mm from the tube's axis"

    def inside(self, c: Camera) -> Array:
        """Whether it lies in the tube."""
        return _in_tube(c, self.place)


def _in_tube(c: Camera, place: Number) -> Array:
    """Whether a place [mm before the main lens] is no farther behind the tip than the tube is long."""
    c, numbers = c.cold, c.cold.numbers
    return np.asarray(place >= c.tip - numbers[LENGTH] if LENGTH in numbers else np.True_)


def housed(c: Camera) -> tuple[_Housed, ...]:
    """FAP, stops, elements, main lens, array and sensor.

    Without elements of no known diameter, and without the sensor where a relay stands between, which may be anywhere.
    """
    c, numbers = c.cold, c.cold.numbers

    def part(name: str, key: str, width: Number, place: Number, glass: Number = 0.0, corners: Number = 0.0) -> _Housed:
        aside = 2 * np.hypot(numbers[f"{key}.decentre.0"], numbers[f"{key}.decentre.1"])
        whole = np.maximum(width, glass) + aside
        if key in c.chain.bores:  # what is amiss of it is so of the wall, whatever that leaves of the tube
            whole = np.minimum(whole, room(c, place))
        return _Housed(name, whole, place, width + aside, _aside(c, place, whole / 2), corners)

    def diagonal(key: str) -> Number:
        size: Number = np.hypot(numbers[f"{key}.0"], numbers[f"{key}.1"])
        return size

    parts = [
        part(rim.name, rim.part, 2 * ClearAperture.of(numbers, rim.part).reach, rim.ruler_distance)
        for rim in c.stop_openings
    ]
    for at in c.in_bore:
        glass = numbers.get(f"{at.at.place}.outer_diameter", _widest(at.element.prescribed))
        if np.any(glass) or f"{at.at.place}.diameter" in numbers or _aside(c, at.end, 0.0) is not None:
            upright = _aside(c, at.start, 0.0) is None  # no fold before it turns its own axis
            corners = 2 * at.element.block_reach(at.at) if upright else 0.0
            parts.append(part(at.name, at.at.place, at.at.get("diameter", glass), at.end, glass, corners))
    array, d_2 = -numbers[PATHS["d_1"]] - c.hiatus, numbers[PATHS["d_2"]]
    edge = np.maximum(_widest(c.lens.prescribed), numbers.get("main_lens.outer_diameter", 0.0))
    parts.append(part("main lens", "main_lens", numbers[PATHS["D"]], 0.0, edge))
    parts.append(part("microlens array", "microlens_array", np.hypot(*as_cut(c)), array))
    if _holds_sensor(c):
        parts.append(part("sensor", "sensor", diagonal(PACKAGE if _packaged(c) else "sensor.size"), array - d_2))
    return tuple(parts)


def unsaid_bore(c: Camera) -> str:
    """Words on openings that are just as wide as the tube leaves, so that builds' do not fit; empty of none."""
    within = [
        part
        for part in housed(c)
        if part.aside is None and np.all(np.logical_and(part.inside(c), np.equal(part.clear, part.width)))
    ]
    names = [
        part.name for part in within if np.isclose(float(part.width), float(room(c, part.place)), rtol=1e-9, atol=0.0)
    ]
    bores = {rim.name for rim in c.stop_openings if rim.part not in c.chain.bores}
    at = [the(name) for name in names if name in bores]
    return f"{listed(at)} as wide as the tube leaves: if that is its own bore, give it bore = true" if at else ""


def unsaid_wall(c: Camera) -> str:
    """Words on a cone whose wide end no opening stands for, so that its wall cuts no light; empty of none."""
    if PROXIMAL not in c.numbers:
        return ""
    end = float(c.cold.tip - c.cold[LENGTH])
    if end <= 0 or any(abs(float(c.cold[f"{bore}.distance"]) - end) <= NEAR * end for bore in c.chain.bores):
        return ""
    return f'; its wall cuts no rays, until [[stops]] says distance = "{number(end, 6)} mm", bore = true'


def unjudged(c: Camera) -> str:
    """Words on what the width does not count, as it stands sideways no one knows where; empty where it counts all."""
    parts = [c.in_bore[k] for k in c.chain.order]
    name = next((at.name for at in parts if at.element.turn and at.element.bounces > 1), "")
    return f"not judged: what lies ahead of {the(name)} stands sideways" if name else ""


def _aside(c: Camera, place: Number, half: Number) -> Number | None:
    """Farthest point from the tube's axis of a disc about the folded axis [mm]; None where nothing known turns that.

    Light turns halfway through a prism; where it does that by several reflections is not known.
    """
    frame, off, before = np.eye(3), [np.asarray(0.0), np.asarray(0.0)], np.asarray(0.0)

    def moved(end: Number) -> list[Array]:
        return [start + way * (end - before) for start, way in zip(off, frame[:2, 2], strict=True)]

    towards: float | None = None
    for at in (c.in_bore[k] for k in c.chain.order):
        part, fold = at.element, at.start + at.length / 2
        if part.turn and np.all(np.greater(place, fold)):
            if part.bounces > 1:
                return None
            off, towards = moved(fold), part.towards
            frame, before = frame @ fold_of(part.turn, part.towards, part.reverses), np.asarray(fold)
    if towards is None:
        return None
    rim = frame[:2, :2] @ [np.cos(RIM + towards), np.sin(RIM + towards)]
    x, y = (np.asarray(a)[..., None] + np.asarray(half)[..., None] * b for a, b in zip(moved(place), rim, strict=True))
    return np.asarray(np.hypot(x, y).max(axis=-1))


def _widest(lenses: Iterable[Prescription]) -> float:
    """Diameter of the widest surface of real lenses [mm], which a stop at them makes no narrower; 0 of none."""
    return 2 * max((surface.semi_diameter for lens in lenses for surface in lens.warmed(ROOM).surfaces), default=0.0)


def _holds_sensor(c: Camera) -> bool:
    """Whether the sensor stands behind the array, and no relay between them."""
    return bool(np.all(np.equal(c.numbers["sensor.relay_magnification"], 1)))


def _packaged(c: Camera) -> bool:
    """Whether the sensor's package is known."""
    return f"{PACKAGE}.0" in c.numbers


def shell(c: Camera) -> Number:
    """Thickness of wall and light guide about the parts [mm]; 0 where no design states a tube."""
    return c.cold.numbers.get(WALL, 0.0) + c.cold.numbers.get(GUIDE, 0.0)


def uncounted(c: Camera) -> str:
    """Things that stand in a camera's tube and that its width does not count, in words; empty where it counts all."""
    package = _holds_sensor(c) and not _packaged(c) and bool(np.any(housed(c)[-1].inside(c)))
    guide = GUIDE not in c.numbers and "light.radiance" not in c.numbers  # what shines by itself needs none
    left = {"wall": OUTER not in c.numbers, "sensor package": package, "light guide": guide}
    names = [name for name, out in left.items() if out]
    return f"without {' or '.join(filter(None, (', '.join(names[:-1]), names[-1])))}" if names else ""


def slack(c: Camera, place: Number) -> Number:
    """How much wider than at a place [mm before the main lens] a cone is at its wide end [mm]; 0 of a straight tube."""
    if PROXIMAL not in c.numbers:
        return 0.0
    ends = c.cold[OUTER], c.cold[PROXIMAL]
    return ends[1] - ends[0] - widening(*ends, c.cold[LENGTH], c.cold.tip - place)


def widest(c: Camera) -> Number:
    """Outer diameter of the tube that is stated, of a cone at its wide end [mm]."""
    return c.cold[PROXIMAL if PROXIMAL in c.numbers else OUTER]


def room(c: Camera, place: Number) -> Array:
    """Width that the tube leaves a part at a place [both mm]; infinite where no design states one.

    A cone is narrowest about a part's end towards the scene.
    """
    return np.asarray(tube_room(c.cold.numbers, c.cold.tip - place) if OUTER in c.numbers else np.inf)


def widest_fap(c: Camera) -> Array:
    """Diameter up to which a FAP fits the tube, if it is in it, and the main lens lets all its light through [mm]."""
    fap = c.cold.numbers[PATHS["d_3"]]
    return np.minimum(np.where(_in_tube(c, fap), room(c, fap), np.inf), c.cold.D)


def walls(c: Camera) -> tuple[str, str]:
    """Tube that is inserted: the design's, or the narrowest one; walls that it counts and does not count.

    Both in words.
    """
    if OUTER not in c.numbers:
        return NARROWEST, clauses(uncounted(c), _cut_words(c))
    outer, wall, narrowest = float(widest(c)), float(shell(c)), float(np.max(_about(c, False)))
    walls = "walls with light guide" if GUIDE in c.numbers else "walls"
    within = [part for part in housed(c) if part.inside(c)]
    widest_part = max(within, key=lambda part: float(part.needs(c) + slack(c, part.place)), default=None)
    parts = f"parts of {number(narrowest - 2 * wall, 4)} mm"
    if widest_part is not None and widest_part.aside is not None:
        parts = f"{the(widest_part.name)}, {widest_part.sizes(c)},"
    parts += f" and {walls} of {number(wall, 4)} mm"
    if PROXIMAL in c.numbers:
        parts = f"a cone from {number(float(c.cold[OUTER]), 4)} mm at the tip, {walls} of {number(wall, 4)} mm"
    counted = f"as stated: {parts}, clearance {number(outer - narrowest, 3, 1e-9)} mm"
    if outer < narrowest * (1 - 1e-9):
        counted = f"with its wall: {parts}; {number(outer, 4)} mm as stated is too narrow"
    return "tube", clauses(counted, uncounted(c), _cut_words(c), cold_words(c))


def _cut_words(c: Camera) -> str:
    """Words on an array that counts as it is cut from its stock; empty of one that does not."""
    sides, whole = ([float(side) for side in pair] for pair in (as_cut(c.cold), c.cold.array_size))
    return f"array cut to {number(sides[0], 3)} x {number(sides[1], 3)} mm" if sides != whole else ""


def cold_words(c: Camera) -> str:
    """Words on the temperature that sizes are stated at; empty of a camera that is not used at another."""
    return "" if c.cold is c else f"at {ROOM:g} °C"


def inserted(c: Camera) -> str:
    """Part of the camera that is taken for inserted, in words."""
    if LENGTH in c.numbers:
        length, aside = float(c.cold[LENGTH]), 0.0
        if c.chain.folds:
            aside = float(c.cold.tip) - c.chain.folds[0].distance
        turned = f" of the light's way, {number(length - aside, 4)} mm of them up to its fold" * (0 < aside < length)
        return f"the first {number(length, 4)} mm{turned}"
    return "all of the camera"


def head(c: Camera) -> str:
    """Cause of the whole camera's width, where a part of it stays outside, in words; else empty."""
    if LENGTH not in c.numbers:
        return ""
    behind = [part for part in housed(c) if not part.inside(c)]
    widest = max(behind, key=lambda part: float(part.across), default=None)
    if widest is None or float(widest.across) <= float(np.max(diameters(c, False))):
        return "of the whole camera: no part behind the tube is wider than it"
    package = _holds_sensor(c) and not _packaged(c)
    without = "wall" + " or sensor package" * package
    return f"of the whole camera, by its head, which stays outside: {widest.name}, {widest.sizes(c)}, without {without}"


def diameters(c: Camera, whole: bool) -> Array:
    """Outer diameter about each of `housed`, last of the tube that is stated, if one is [mm]: (K, ...).

    Of the whole camera, or of its inserted part: all in the stated tube, or all there is where no length is stated.
    """
    about = _about(c, whole)
    return np.stack(np.broadcast_arrays(*about, *([widest(c)] if OUTER in c.numbers else [])))


def _about(c: Camera, whole: bool) -> Array:
    """Outer diameter about each of `housed` [mm], shape (K, ...); of what lies behind the tube its own or none.

    Of a cone that of its wide end, if it is as much wider everywhere as the part in it needs.
    """
    parts, walls = housed(c), 2 * shell(c)
    widths = [
        np.where(part.inside(c), part.needs(c) + slack(c, part.place) + walls, part.across if whole else walls)
        for part in parts
    ]
    return np.stack(np.broadcast_arrays(*widths))
