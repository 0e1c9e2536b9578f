"""Sections of an instrument: rays in the meridional plane, light cones behind microlenses, drawing with dimensions."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..._arrays import Array
from ...bore.elements import AnyElement, made_of
from ...camera import Camera
from ...design import Design
from ...design.assembly import Placed
from ...design.parts import Opening, widening
from ...drawing.marks import Area, Dots, Key, Line, Mark, Point, Text, bars, box_key, joined, line_key, parted, xy
from ...drawing.panel import Panel, Scale
from ...drawing.picture import PAGE, Picture, beside, legend_height, one_panel
from ...drawing.theme import FIELDS, SMALL, rows_of_names, short, stop_colour, text_width
from ...evaluation import default_fields
from ...lenses.glass import AIR
from ...lenses.material import material_label
from ...rays import PASSED, fans, glass_shares, trace_pupil
from ...theory.limits import limits
from ...theory.quantities import QUANTITIES
from ...theory.tube import WHOLE, WIDTHS, shell, widest
from ...words import length, listed

FILL = 1.5
"""Width of a fan in FAP diameters: its outer rays meet the FAP's plate."""
RAYS = 13
"""Rays of a fan; with `FILL` above, every fourth of a radius."""
NAME_ROW, DIMENSION_ROW = 16.0, 19.0
"""Heights [px]."""
EXAGGERATIONS = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0)
"""How much larger than lengths heights may be drawn, times powers of ten."""
TO_SCALE = 0.8, 2.0
"""Ends between which scales that fill the room differ too little, heights over lengths, to be drawn stretched."""
SMALLEST_SHARE = 0.25
"""Least share of the picture's length that the instrument has when all is shown without being asked for."""
MOST_PIXELS = 200
"""In a column of a drawing up to which they are drawn one by one; finer ones would be grey, and a large file."""
BEYOND = 1.5
"""How far beyond all else blocked rays are followed, in its half heights."""
SAME_PLACE = 0.01
"""Share by which edge and corner differ up to which both are the rim of a round field."""
FLAT = 60.0
"""Height of a section below which no diameters are told inside it [px]."""
CLOSE = 0.125
"""Share of the instrument that a view of its tip shows."""
NEAR = {"tip": "at the tip", "sensor": "at array and sensor"}
"""Views of one end, in words."""
TALL, NEAR_TALL = 300.0, 220.0
"""Heights of a report's section, and of its views of the ends below [px]."""
LOWEST = 90.0
"""Least height of a section [px]."""


class _LabelledFan(NamedTuple):
    """Rays of one field."""

    label: str
    kept: NDArray[np.bool_]
    """Shape (N,)."""
    z: Array
    """Corners of each ray [mm], light's way, shape (N, V); a blocked ray repeats the point where it ends."""
    x: Array
    """Heights there [mm]."""


def _labelled_fans(design: Design) -> list[_LabelledFan]:
    """Fans of centre, edge and corner, or the rim of a round field; of both edges where decentres make sides differ."""
    (x, _), (edge, _), corner = default_fields(design)
    if is_centred(design):
        places = {"centre": 0.0, "edge": edge, "corner": math.hypot(*corner)}
        if math.isclose(edge, places["corner"], rel_tol=SAME_PLACE):  # of a round field
            places = {"centre": 0.0, "rim": edge}
    else:
        places = {"centre": x, "edge +x": edge, "edge -x": 2 * x - edge}
    drawn = fans(Camera.of(design), list(places.values()), rays=RAYS, fill=FILL)
    kept = np.isin(drawn.status, PASSED)
    return [_LabelledFan(label, kept[i], drawn.z[i], drawn.x[i]) for i, label in enumerate(places)]


def ray_words(design: Design) -> str:
    """Fields whose rays a section shows, with their colours, and what stops others, for a drawing without a key."""
    drawn = _labelled_fans(design.thin_twin.with_own_stop)
    rays = "rays of " + listed([f"{fan.label} ({colour})" for fan, colour in zip(drawn, FIELDS, strict=False)])
    ends = "" if all(fan.kept.all() for fan in drawn) else "; dashed orange ones end, with a cross, at a stop"
    return "; ".join([f"{rays}{ends}", *unfolded_words(design)])


def unfolded_words(design: Design) -> list[str]:
    """Words on which way a camera looks whose axis a section draws straight; none where nothing folds it."""
    camera = Camera.of(design)
    if not camera.chain.folding:
        return []
    aside = float(QUANTITIES["direction_of_view_deg"](camera))
    return [f"drawn unfolded along the light: it looks {short(aside, 3)}° from straight ahead"]


def _medium_label(design: Design) -> str:
    """Name of the medium that the scene lies in, with its index; empty for air."""
    medium = design.object_space.medium
    return "" if medium == AIR else material_label(medium, design.wavelength)


def is_centred(design: Design) -> bool:
    """Whether all elements are round about one axis, so that every meridional plane is like every other."""
    offsets = [design.main_lens.decentre, design.microlens_array.decentre, design.sensor.decentre]
    offsets += [at.part.decentre for at in design.placed]
    offsets += [turn for at in design.in_bore for turn in (at.part.tilt, getattr(at.part, "wedge", (0.0, 0.0)))]
    return design.sees_discs and all(offset == (0.0, 0.0) for offset in offsets)


def meridional(
    design: Design, size: Point = (900, 340), *, whole: bool | None = None, key: bool = True,
    close: Literal["", "tip", "sensor"] = "", like: Design | None = None,
) -> Picture:  # fmt: skip
    """Draw the section in which rays run.

    Parameters
    ----------
    design : Design
        A real lens is drawn as its thin-lens model.
    size : (width, height)
        [px].
    whole : bool, optional
        From the object plane on (True; never where that is at infinity), or from a little before the outermost stop
        (False). None shows the way to the object unless the instrument would be small beside it.
    key : bool
        Whether a legend is drawn; else close to one end which end it is, and the scales.
    close : {"", "tip", "sensor"}
        Only what stands about the tip, or about array and sensor; `whole` is then of no account.
    like : Design, optional
        Another design whose section, drawn like this one, has the same axes and scales.

    Returns
    -------
    Picture
        To scale where both nearly fill it so, else filled, heights larger or smaller than lengths by a round factor;
        its mapping takes pixels to z and height [mm].

    Notes
    -----
    Each field lies in its own meridional plane, turned into the page; with decentres, the plane is x-z.
    """
    both = [design, *([] if like is None else [like])]
    if whole is None:
        whole = all(_instrument_share(one) > SMALLEST_SHARE for one in both)
    whole = whole and not close and all(math.isfinite(one.d_f) for one in both)
    twins = [one.thin_twin.with_own_stop for one in both]
    each = [_labelled_fans(twin) for twin in twins]
    tubes = [DrawnTube.of(one) for one in both]
    thin, drawn, tube = twins[0], each[0], tubes[0]
    keys = [
        line_key(fan.label if fan.kept.any() else f"{fan.label} (dark)", colour, 1.9)
        for fan, colour in zip(drawn, FIELDS, strict=False)
    ]
    blocked = sum(int(tube.meets(fan).sum()) for fan in drawn)
    if blocked:
        cross = Dots((0.0,), (0.0,), "vermillion", "x", 3.5, width=1.5)
        lost = any(fan.kept.sum() < np.sum(np.abs(np.linspace(-FILL, FILL, RAYS)) <= 1) for fan in drawn)
        words = "blocked, and where" if lost else "beyond the FAP's rim: blocked, and where"
        keys.append(line_key(words, "vermillion", 0.8, "4 3", cross))
    if medium := _medium_label(thin):
        keys.append(box_key(f"medium: {medium}", *MEDIUM))
    ruler = (Line((-11.0, 11.0), (0.0, 0.0), "grey", 1.2, ends="|"),)
    keys = keys if key else []

    def scales(exaggeration: float) -> list[Key]:
        words = scale_words(exaggeration)
        if not key:
            return [Key(f"{NEAR[close]}: {words}", ruler)] if close else []
        return [Key(words if whole else f"{words}; object plane {short(design.d_f)} mm before the lens", ruler)]

    # How many rows the legend takes must be known before the scale is, which it tells.
    keys += [*tube.keys, *(Key(words, ()) for words in unfolded_words(design))] if key else ()
    foot = legend_height([*keys, *scales(100.0)], size[0] - 28)
    clear = size[0], size[1] - foot
    frames = [_Frame.of(twin, fan, tube, whole, close) for twin, fan, tube in zip(twins, each, tubes, strict=True)]
    frame = functools.reduce(_Frame.around, frames)
    layouts = [_section(twin, clear, whole, close, own, frame) for twin, own in zip(twins, tubes, strict=True)]
    most, widest = (min(one) for one in zip(*((one.exaggeration, one.along) for one in layouts), strict=True))
    section = _section(thin, clear, whole, close, tube, frame, most, widest)
    keys += scales(section.exaggeration)
    tip, half = -_front(thin), section.half
    marks: list[Mark] = tube.marks(half)
    if medium:
        marks.append(_block(section.panel.x.low, tip, -half, half, *MEDIUM, testid="medium"))
    marks += _glass(thin, section)
    for fan, colour in zip(drawn, FIELDS, strict=False):
        marks += _fan(fan, colour, half, tube)
    marks += [*_elements(thin, section), *_names(section), *_openings(thin, section, drawn), *_lengths(thin, section)]
    ends = section.panel.x[:2]
    panel = section.panel.with_marks(*(mark for mark in marks if mark.clip or _within(mark, *ends)))
    height = max(size[1], panel.bottom + section.under + foot)
    title = (
        f"Meridional section of {design.name}: rays of {', '.join(fan.label for fan in drawn)}; "
        f"{blocked} of {blocked + sum(int(fan.kept.sum()) for fan in drawn)} drawn rays are blocked"
    )
    key_box = (16.0, height - foot - 3, size[0] - 28)
    return Picture("meridional", title, (size[0], height), (panel,), tuple(keys), key_box)


def _within(mark: Mark, low: float, high: float) -> bool:
    """Whether a mark that may leave the panel stands between the ends of its abscissa."""
    at = np.asarray(mark.x if isinstance(mark, Line | Text) else low)
    return bool(np.all((low <= at) & (at <= high)))


def ray_diagrams(design: Design) -> Picture:
    """The section over all of the width, and below it, side by side, its tip, and array and sensor."""
    section = meridional(design, (PAGE, TALL))
    ends = (meridional(design, (PAGE / 2, NEAR_TALL), key=False, close=end) for end in ("tip", "sensor"))
    return beside("rays", section.title, (section, beside("rays-near", "", ends)), down=True)


def _front(design: Design) -> float:
    """Distance of the outermost stop or element from the lens [mm]."""
    return float(Camera.of(design).tip)


def _instrument_share(design: Design) -> float:
    """Share of the length from the object plane to the sensor that the instrument takes."""
    end = design.d_1 + design.d_2
    return (end + _front(design)) / (end + design.d_f)


def scale_words(exaggeration: float) -> str:
    """Scales of a section in words, from pixels per millimetre of height over those of length."""
    if math.isclose(exaggeration, 1, rel_tol=1e-6):
        return "to scale"
    if exaggeration < 1:
        return f"heights to scale, lengths ×{short(1 / exaggeration)}"
    return f"lengths to scale, heights ×{short(exaggeration)}"


@dataclass(frozen=True)
class DrawnTube:
    """Tube about an instrument's section, along the axis from its tip: the design's, or the narrowest one."""

    inner: float
    """Half of what is inside, at the tip [mm]."""
    wall: float
    """Half of what the wall, without a ring of light fibres within it, goes around there [mm]."""
    outer: float
    """Half the outer diameter there [mm]."""
    ends: tuple[float, float]
    """Tip and other end [mm]."""
    stated: bool
    most: float
    """Half the width that is required at most [mm]; infinite where none is."""
    flare: float = 0.0
    """By how much all of these are more at the other end of a cone [mm]."""

    @classmethod
    def of(cls, design: Design) -> DrawnTube:
        """Tube of a design, which may be widened by no part that it does not hold."""
        tip, end = -_front(design), design.d_1 + design.d_2
        most = min((high for _, one, _, high in limits(design) if one.name in WIDTHS and high), default=math.inf) / 2
        if (tube := design.tube) is None:
            outer = float(QUANTITIES[WHOLE](Camera.of(design))) / 2
            return cls(outer, outer, outer, (tip, end), False, most)
        cold = Camera.of(design).cold  # as it is stated, at 20 degrees C
        outer = float(cold["tube.outer_diameter"]) / 2
        far = end if tube.length is None else tip + tube.length
        inner, within, flare = (
            outer - float(shell(cold)),
            outer - float(cold["tube.wall"]),
            float(widest(cold)) / 2 - outer,
        )
        return cls(inner, within, outer, (tip, far), True, most, flare)

    def flared(self, z: Array | float) -> Array:
        """How much more of a cone its radii are at a place than at its tip [both mm]."""
        if not self.flare:
            return np.zeros(())
        return np.asarray(widening(0.0, self.flare, self.ends[1] - self.ends[0], z - self.ends[0]))

    def holds(self, z: float) -> bool:
        """Whether a place along the axis [mm] is in a tube that is stated."""
        slack = 1e-6 * (self.ends[1] - self.ends[0])
        return self.stated and self.ends[0] - slack <= z <= self.ends[1] + slack

    @property
    def sizes(self) -> str:
        """Diameters outside and inside, of a cone those of both ends."""
        ends = dict.fromkeys((0.0, self.flare))
        both = (" to ".join(short(2 * (half + out)) for out in ends) for half in (self.outer, self.inner))
        return f"⌀ {' / '.join(both)} mm"

    @property
    def keys(self) -> tuple[Key, ...]:
        """Entries of it in a legend."""
        wide_end = f" to {short(2 * (self.outer + self.flare))}" * (self.flare > 0)
        size = f"{short(2 * self.outer)}{wide_end} mm outside"
        keys = [box_key(f"tube, {size}", *TUBE) if self.stated else line_key(f"narrowest tube, {size}", "grey", 1.2)]
        keys += [box_key("light guide", *GUIDE)] * (self.wall > self.inner)
        keys += [line_key(f"required: at most {short(2 * self.most)} mm", *LIMIT)] * math.isfinite(self.most)
        return tuple(keys)

    def marks(self, half: float) -> list[Mark]:
        """Drawing of it, of what a picture so high shows [mm]."""
        tip, end = self.ends

        def ring(low: float, high: float, *fill: Any, **more: Any) -> Area:
            lows, highs = (
                [min(abs(edge) + out, half) * np.sign(edge) for out in (0.0, self.flare)] for edge in (low, high)
            )
            return Area([tip, end, end, tip], [*highs, *lows[::-1]], *fill, **more)

        marks: list[Mark] = [ring(-self.inner, self.inner, "pale", 0.28)]
        for sign in (-1, 1):
            for low, high, fill in ((self.inner, self.wall, GUIDE), (self.wall, self.outer, TUBE)):
                if low < min(high, half):
                    marks.append(ring(sign * low, sign * high, *fill, testid="tube"))
            if not self.stated and self.outer <= half:
                marks.append(Line([tip, end], [sign * self.outer] * 2, "grey", 1.2, testid="tube"))
            if self.most <= half:
                marks.append(Line([tip, end], [sign * self.most] * 2, *LIMIT, testid="tube-limit"))
        return marks

    def meets(self, fan: _LabelledFan) -> NDArray[np.bool_]:
        """Which blocked rays of a fan end within it; those that pass it outside are not drawn."""
        return ~fan.kept & (np.abs(fan.x[:, -1]) <= (self.outer + self.flared(fan.z[:, -1])) * (1 + 1e-9))

    def rim(self, edge: float, least: float, z: float) -> float:
        """How far from the axis a mount at z reaches whose opening ends at `edge` [mm]; by `least` without room."""
        return math.copysign(max(self.inner + float(self.flared(z)), abs(edge) + least), edge)


class _SectionLayout(NamedTuple):
    """Layout of a section: where things are in the picture."""

    panel: Panel
    tube: DrawnTube
    half: float
    """Elements and rays reach this high [mm]."""
    along: float
    """Pixels per millimetre of length."""
    exaggeration: float
    """Pixels per millimetre of height over those of length."""
    sides: dict[str, int]
    """Where each diameter is told: 1 behind its element, -1 before it, 0 with its name as there is no room."""
    names: tuple[tuple[float, str], ...]
    """Distance of each element [mm], with its name."""
    rows: tuple[int, ...]
    """Row of each name, so that names do not overlap."""
    whole: bool
    """Whether the object plane is in it."""
    under: float
    """Room below it for dimensions [px]."""


class _Frame(NamedTuple):
    """Frame of a section: what it shows, and the room beside it."""

    left: float
    """Ends along the axis [mm]."""
    right: float
    half: float
    """Half the height [mm]."""
    beside: float
    """Room right of it [px]."""

    @classmethod
    def of(cls, design: Design, drawn: list[_LabelledFan], tube: DrawnTube, whole: bool, close: str) -> _Frame:
        """Frame of one design's section."""
        end, front = design.d_1 + design.d_2, _front(design)
        length = end + (design.d_f if whole else front)
        left = -design.d_f - 0.05 * length if whole else -front - 0.14 * length
        right = end + 0.07 * length
        if close == "tip":
            left, right = -front - CLOSE * length / 4, CLOSE * length - front
        elif close:
            left, right = design.d_1 - 3 * design.d_2, end + design.d_2 / 4
        solid = [*reaches(design, left, right), *[math.hypot(*design.sensor_size) / 2] * (right >= end)]
        if close != "sensor":  # which may be far smaller than the tube
            solid += [tube.outer + float(tube.flared(right)), *[tube.most] * (tube.most < TALLEST * tube.outer)]
        high = np.abs([_heights(fan, left, right if close else math.inf) for fan in drawn])
        # Where all light passes, and where it starts; what is blocked may run to any height.
        lit = max(*solid, high[..., 0].max(), np.where([fan.kept for fan in drawn], high.max(axis=-1), 0.0).max())
        beside = 16.0 if close == "tip" else 18.0 + text_width(f"d_2 = {short(design.d_2)} mm", SMALL)
        return cls(left, right, 1.08 * min(max(lit, high.max()), BEYOND * lit), beside)

    def around(self, other: _Frame) -> _Frame:
        """Frame that shows what two show."""
        return _Frame(min(self.left, other.left), *map(max, self[1:], other[1:]))


def _section(
    design: Design, size: Point, whole: bool, close: str, tube: DrawnTube, frame: _Frame,
    most: float = math.inf, widest: float = math.inf,
) -> _SectionLayout:  # fmt: skip
    """Layout within a frame: heights at most `most` times as large as lengths, these at most `widest` px/mm."""
    left, right, half, beside = frame
    side = 16.0, beside
    across = max(size[0] - sum(side), 50.0)
    under = DIMENSION_ROW * (2 if not close or design.d_3 < 0 else 1) + 14
    rows, along, factor, over = [0], across / (right - left), 1.0, 0.0
    sides: dict[str, int] = {}
    names: list[tuple[float, str]] = []
    for _ in range(3):  # fewer pixels per millimetre may want more rows of names, and these leave fewer
        over = 8 + NAME_ROW * (1 + max(rows, default=0))
        along = min(across / (right - left), widest)
        factor = max(size[1] - over - under, LOWEST) / (2 * half) / along
        if TO_SCALE[0] <= min(factor, most) < TO_SCALE[1]:
            along, factor = along * min(factor, 1.0), 1.0
        sides = _sides(design, along, side[0] - along * (left + design.d_3), whole)
        if 2 * half * along * factor < FLAT:
            sides = dict.fromkeys(sides, 0)
        names = [name for name in _named(design, sides, whole, close) if left <= name[0] <= right]
        widths = [(text_width(name, SMALL) + 8) / along for _, name in names]
        rows = rows_of_names([z for z, _ in names], widths)
    steps = [step * 10.0**power for power in range(16) for step in EXAGGERATIONS]
    factor = max(step for step in (*steps, *(1 / step for step in steps)) if step <= min(factor, most) * (1 + 1e-9))
    width, tall = along * (right - left), 2 * half * along * factor
    x, y = side[0] + (across - width) / 2, over + (max(size[1] - over - under, LOWEST) - tall) / 2
    panel = Panel((x, y, width, tall), Scale(left, right), Scale(-half, half), bare=True)
    return _SectionLayout(panel, tube, half, along, factor, sides, tuple(names), tuple(rows), whole, under)


def _heights(fan: _LabelledFan, left: float, right: float) -> Array:
    """Heights of a fan's rays at corners between two ends, and at these where both are; shape (N, V or V + 2)."""
    inside = np.where((fan.z >= left) & (fan.z <= right), fan.x, 0.0)
    if not math.isfinite(right):
        return inside
    return np.append(inside, [np.interp((left, right), *ray) for ray in zip(fan.z, fan.x, strict=True)], axis=1)


def _sides(design: Design, along: float, before: float, whole: bool) -> dict[str, int]:
    """Sides of the labels for `_SectionLayout.sides`, from pixels per millimetre and those before the FAP."""
    spans = [(stop.near, stop.far) for stop in design.openings if stop.near > 0]
    spans += [(at.near, at.far) for at in design.in_bore]
    inner = [near for near, _ in spans]
    gaps = [design.d_3 - far for _, far in (*spans, (0.0, 0.0)) if far < design.d_3]
    beyond = [design.d_f] * whole + [near for near, _ in spans if near > design.d_3]
    before = min([before, *(along * (z - design.d_3) for z in beyond)])
    lens = {1: along * design.d_1 - 34, -1: along * min(inner, default=design.d_f) - 34}
    pupil = {-1: before - 20, 1: along * min(gaps, default=design.d_1) - 20}
    if design.d_3 < _front(design) * (1 - SAME_PLACE):  # rays, walls and glass are before it
        pupil = {-1: 0.0, 1: 0.0}
    if design.d_3 < 0:
        lens[1] = pupil[-1] = -along * design.d_3 - 34
        pupil[1] = along * (design.d_1 + design.d_3) - 20
    return {
        symbol: next((side for side, room in rooms.items() if room > text_width(_diameter(design, symbol), SMALL)), 0)
        for symbol, rooms in (("D", lens), ("D_F", pupil))
    }


def _diameter(design: Design, symbol: str) -> str:
    if symbol == "D_F" and design.aperture.outline.straight:
        return design.aperture.outline.size
    if symbol == "D_F" and design.d_3 < 0:
        return f"{short(design.D_F)} mm"
    return f"{symbol} = {short(design.D if symbol == 'D' else design.D_F)} mm"


def _half(stop: Opening) -> float:
    """Half the section of an opening along x, through its centre [mm]."""
    return float(stop.outline.rim(np.ones(()), np.zeros(()))[0])


def _named(design: Design, sides: Mapping[str, int], whole: bool, close: str) -> list[tuple[float, str]]:
    """Names of elements where they stand, with the diameters that have no room elsewhere."""
    openings = {symbol: "" if side else f", {_diameter(design, symbol)}" for symbol, side in sides.items()}
    fap, *stops = design.openings
    names = [(-fap.near, f"{_pupil_name(design)}{openings['D_F']}"), *((-stop.near, stop.name) for stop in stops)]
    names += [(-(at.near + at.far) / 2, name_of_drawn(at)) for at in design.in_bore]
    planes = f", H and H' {short(gap)} mm apart" if (gap := design.main_lens.kind.gap) else ""
    end = design.d_1 + design.d_2
    names += [(0.0, f"main lens{planes}{openings['D']}"), (end, "sensor" if close else "MLA, sensor")]
    names += [(design.d_1, "MLA")] * bool(close)
    return sorted([*names, *([(-design.d_f, "object plane")] if whole else [])])


def _pupil_name(design: Design) -> str:
    return "FAP" if design.d_3 >= 0 else "stop of the FAP"


def name_of_drawn(at: Placed[AnyElement], fold: bool = False) -> str:
    """Name of an element in a picture; of one that turns the axis by how much, and whether it is drawn unfolded."""
    drawn = "" if fold else "unfolded: "
    return at.name + (f", {drawn}turns by {math.degrees(at.part.turn):.3g}°" if at.part.turn else "")


def _cut(fan: _LabelledFan, half: float, among: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Corners of some rays, those that leave the picture as far as they are in it."""
    z, x = fan.z[among].copy(), fan.x[among].copy()
    for k in range(1, x.shape[1]):
        step = x[:, k] - x[:, k - 1]
        over = np.abs(x[:, k]) > half
        share = np.where(over, (np.copysign(half, x[:, k]) - x[:, k - 1]) / np.where(step == 0, 1.0, step), 1.0)
        z[:, k], x[:, k] = z[:, k - 1] + share * (z[:, k] - z[:, k - 1]), x[:, k - 1] + share * step
    return z, x


def _fan(fan: _LabelledFan, colour: str, half: float, tube: DrawnTube) -> list[Mark]:
    passed = np.flatnonzero(fan.kept)
    marks: list[Mark] = []
    for number in passed:
        # Chief and marginal rays stand out.
        width = 1.9 if number == len(fan.kept) // 2 else 1.4 if number in (passed[0], passed[-1]) else 0.6
        marks.append(Line(fan.z[number], fan.x[number], colour, width, testid="ray"))
    if (met := tube.meets(fan)).any():
        z, x = _cut(fan, half, met)
        inside = np.abs(x[:, -1]) < half
        marks.append(Line(parted(z), parted(x), "vermillion", 0.8, "4 3", testid=f"blocked-{fan.label.split()[0]}"))
        marks.append(Dots(z[inside, -1], x[inside, -1], "vermillion", "x", 3.5, width=1.5, clip=True))
    return marks


def _elements(design: Design, section: _SectionLayout) -> list[Mark]:
    half, (mm, up), tube = section.half, section.panel.per_px, section.tube
    end = design.d_1 + design.d_2
    marks: list[Mark] = [Line([section.panel.x.low, end], [0.0, 0.0], "grey", 0.8, "10 3 2 3")]
    for number, stop in enumerate(design.openings):
        for sign in (-1, 1):
            edge = stop.part.decentre[0] + sign * _half(stop.part)
            rim = tube.rim(edge if edge * sign > 0 else sign * 1e-9, 5 * up, -stop.near)
            marks.append(Line([-stop.near] * 2, [edge, rim], stop_colour(number), 3.2))
    middle, radius = design.main_lens.decentre[0], design.D / 2
    bulge = _thick(radius, section) / 2
    t = np.linspace(-1, 1, 25)
    z, x = bulge * (1 - t**2), middle + radius * t
    marks.append(Area([*z, *-z[::-1]], [*x, *x[::-1]], *LENS, "blue", 1.2))
    marks += [
        Line([0.0, 0.0], [middle + sign * radius, tube.rim(middle + sign * radius, 5 * up, 0.0)], "blue", 3.2)
        for sign in (-1, 1)
    ]
    if design.main_lens.kind.gap:
        marks.append(Line([0.0, 0.0], [-half, half], "blue", 1.0, "7 3"))
    centred, mla = is_centred(design), design.microlens_array
    heights = [math.hypot(*box) if centred else box[0] for box in (mla.size, design.sensor_size)]
    # Each is drawn on the outer side of its plane, so that d_2 between them stays true.
    for z_at, centre, height, colour, shift in (
        (design.d_1, mla.decentre[0], heights[0], MICROLENSES, -1.5),
        (end, design.sensor.decentre[0], heights[1], "ink", 1.5),
    ):
        marks.append(Line([z_at + shift * mm] * 2, [centre - height / 2, centre + height / 2], colour, 3))
    if section.whole:
        marks.append(Line([-design.d_f] * 2, [-half, half], "grey", 1.6, "7 3"))
    return marks


GLASS, MEDIUM, LENS = ("sky", 0.3), ("green", 0.16), ("blue", 0.22)
"""Fillings of glass, of what the scene lies in, and of the main lens."""
MICROLENSES = "orange"
TUBE, GUIDE, LIMIT = ("grey", 0.55), ("orange", 0.35), ("vermillion", 1.2, "8 3 2 3")
"""Fillings of a tube's wall and of a ring of light fibres within it; line of an outer diameter that is required."""
TALLEST = 2.0
"""Ratio of a required outer diameter to the tube's up to which the section is as high as that."""


def _block(start: float, end: float, low: float, high: float, fill: str, opacity: float, **more: Any) -> Area:
    return Area([start, end, end, start], [high, high, low, low], fill, opacity, **more)


def reaches(design: Design, left: float = -math.inf, right: float = math.inf) -> list[float]:
    """How far from the axis the main lens, stops and elements with a rim of their own reach, between two z [mm]."""
    halves = [(0.0, design.D / 2 + math.hypot(*design.main_lens.decentre))]
    halves += [(-at.near, float(at.part.outline.reach) + math.hypot(*at.part.decentre)) for at in design.openings]
    halves += [(-at.near, (at.part.half_height or 0.0) + math.hypot(*at.part.decentre)) for at in design.in_bore]
    return [reach for z, reach in halves if left <= z <= right]


def _glass(design: Design, section: _SectionLayout) -> list[Mark]:
    """Elements before the main lens with their mounts, and the plates about the array."""
    marks, tube = list[Mark](), section.tube
    for number, (_, _, element, start, end) in enumerate(design.in_bore, 1):
        near, far, middle = -start, -end, element.decentre[0]
        half = min(section.half, tube.inner + float(tube.flared(far)))
        radius = element.half_height or half
        low, high = max(middle - radius, -section.half), min(middle + radius, section.half)
        for edge, wall in ((high, half), (low, -half)):
            if abs(edge) < half and element.length:
                marks.append(_block(far, near, edge, wall, "grey", 0.25))
            elif abs(edge) < half and not element.leans:
                marks.append(Line([near, near], [edge, wall], "grey", 3.2))
        outline = joined(
            np.append(left, right[::-1], axis=0)
            for left, right in element.profile((low, high), _thick(radius, section))
        )
        marks.append(Area(*xy(outline), *GLASS, "sky", 1.2, testid=f"element-{number}"))
        if element.length > 2 * VIEW * section.panel.per_px[0]:
            start = middle + 0.45 * radius
            reach = (half - start) / section.panel.per_px[1] / max(abs(math.sin(element.turn)), 1e-9)
            marks += _view(element.turn, (near, start), min(VIEW, reach), section.panel.per_px)
        # The denser, the darker.
        marks += [_block(far, near, middle - k * radius, middle + k * radius, "sky", 0.2) for k in element.cores]
    mla, plates = design.microlens_array, [(-plate.far, -plate.near) for plate in design.plates]
    (x, _), height = mla.decentre, mla.size[0] / 2
    return marks + [_block(*plate, x - height, x + height, *GLASS, edge="sky", width=0.8) for plate in plates]


VIEW = 46.0
"""Length of the arrow that shows where a prism looks, in the ray picture [px]."""


def _view(angle: float, start: tuple[float, float], size: float, per_px: tuple[float, float]) -> list[Mark]:
    """Where an element, drawn unfolded, really turns the view: the axis goes on, an arrow leaves it by the angle."""
    if not angle:
        return []
    (mm, up), (z, x) = per_px, start
    tip = z - size * math.cos(angle) * mm, x + size * math.sin(angle) * up
    arc = np.linspace(0.0, angle, 20)
    return [
        Line([z, z - size * mm], [x, x], "grey", 0.8, "3 3"),
        Line(z - 0.6 * size * np.cos(arc) * mm, x + 0.6 * size * np.sin(arc) * up, "grey", 0.8),
        Line([z, tip[0]], [x, tip[1]], "ink", 1.4, ends=">", testid="view"),
        Text(*tip, f"view {math.degrees(angle):.3g}°", "ink", SMALL, "end", -5, 4 + 3 * np.sign(angle), plate=True),
    ]


def _thick(radius: float, section: _SectionLayout) -> float:
    """How thick an ideal lens is drawn, which has no thickness [mm]."""
    mm, up = section.panel.per_px
    return min(max(0.18 * radius / up, 4.0), 14.0) * mm


def _names(section: _SectionLayout) -> list[Mark]:
    panel, leaders, names = section.panel, [], []  # type: Panel, list[Mark], list[Mark]
    for (z, name), row in zip(section.names, section.rows, strict=True):
        rise = 5 + NAME_ROW * row
        if row:
            ends = [section.half + (2 * panel.per_px[1]), section.half + (rise - 3) * panel.per_px[1]]
            leaders.append(Line([z, z], ends, "grid", 1, clip=False))
        # Names do not leave the picture on the left.
        shift = max(0.0, text_width(name, SMALL) / 2 + 2.0 - panel.at(z, 0.0)[0])
        names.append(Text(z, section.half, name, "ink", SMALL, "middle", dx=shift, dy=-rise, plate=True))
    return [*leaders, *names]


def _openings(design: Design, section: _SectionLayout, drawn: Iterable[_LabelledFan]) -> list[Mark]:
    """Diameters of the FAP and the main lens as dimensions across, their words clear of the rays that pass."""
    rays = [ray for fan in drawn for ray in zip(fan.z[fan.kept], fan.x[fan.kept], strict=True)]
    marks: list[Mark] = []
    mm, up = section.panel.per_px
    for symbol, z, middle, diameter, side in (
        ("D_F", -design.d_3, design.aperture.decentre[0], 2 * _half(design.aperture), section.sides["D_F"]),
        ("D", 0.0, design.main_lens.decentre[0], design.D, section.sides["D"]),
    ):
        if not side:
            continue
        at, top, low = z + side * 16 * mm, middle + diameter / 2, middle - diameter / 2
        marks.append(Line([at, at], [top, low], "grey", 1.0, ends="|", clip=False))
        words, anchor = _diameter(design, symbol), "start" if side > 0 else "end"
        # Fields are drawn on the upper side of the lens, so on the lower side of what lies before the FAP.
        beside = low + 0.12 * diameter if diameter / up > 40 else low - 15 * up
        ends = [at, at + side * (text_width(words, SMALL) + 5) * mm]
        passing = np.array([[low, low], *(np.interp(ends, z, x) for z, x in rays)])
        over, under = max(top, float(passing.max())), min(low, float(passing.min()))
        beside = min(beside, float(passing[1:].min(initial=math.inf)) - 13 * up)
        y, dx, dy = (
            (beside, 5.0 * side, 0.0) if symbol == "D" else (over, -2.0, -6.0) if side < 0 else (under, 0.0, 16.0)
        )
        marks.append(Text(at, y, words, "ink", SMALL, anchor, dx, dy, plate=True))
    return marks


def _lengths(design: Design, section: _SectionLayout) -> list[Mark]:
    """Distances as dimensions along."""
    marks: list[Mark] = []
    mm, up = section.panel.per_px
    bottom, end = -section.half, design.d_1 + design.d_2
    rows = [("d_3", -design.d_3, 0.0, 0), ("d_1", 0.0, design.d_1, 0)]
    if design.d_3 < 0:
        rows[0] = ("stop", 0.0, -design.d_3, 1)
    if section.whole:
        rows.append(("d_f", -design.d_f, 0.0, 1))
    apart = design.d_2 / mm > text_width(beside := f"d_2 = {short(design.d_2)} mm", SMALL) + 24
    if apart:
        rows.append(("d_2", design.d_1, end, 0))
    below = 0.0
    for symbol, start, stop, row in rows:
        level = bottom - (13 + DIMENSION_ROW * row) * up
        words = f"{symbol} = {short(stop - start)} mm"
        roomy = (stop - start) / mm > text_width(words, SMALL) + 24
        inside = section.panel.x.low <= start and stop <= section.panel.x.high
        if not inside or (stop - start) / mm < 1 or (symbol == "stop" and not roomy):
            continue
        marks += [Line([z, z], [bottom - 2 * up, level - 4 * up], "grid", clip=False) for z in (start, stop)]
        marks.append(Line([start, stop], [level, level], "grey", 1.0, ends="|", clip=False))
        if roomy:
            marks.append(Text((start + stop) / 2, level, words, "ink", SMALL, "middle", dy=4, plate=True))
        elif symbol == "d_1":
            below = DIMENSION_ROW  # d_1 stands beside its own line
            marks.append(Text(stop, level, words, "ink", SMALL, dx=8, dy=4))
        elif section.panel.at(start, level)[0] > text_width(words, SMALL) + 10:
            marks.append(Text(start, level, words, "ink", SMALL, "end", dx=-8, dy=4))
        else:  # in front of its line it would leave the picture; below it may stand d_f
            marks.append(Text(start, level, words, "ink", SMALL, dx=-4, dy=-4 if section.whole else 4 + DIMENSION_ROW))
    if not apart:
        marks.append(Text(end, bottom, beside, "ink", SMALL, dx=8, dy=17 + below))
    return marks


def cells(design: Design, places: Mapping[str, float]) -> Picture:
    """Draw five neighbouring microlenses along x with their light cones and the pixels behind them; scales differ.

    `places` are x of the middle microlens on the MLA [mm] by what to call it.
    """
    offsets, share, t = design.d * np.arange(-2, 3), np.linspace(-1, 1, 129), np.linspace(-1, 1, 31)
    depth, axes, pitch = 1e3 * design.d_2, 1e3 * offsets, 1e3 * design.d
    labels = "distance behind the MLA [µm]", "height from this microlens's axis [µm]"
    pictures, behind = [], glass_shares(Camera.of(design))[1]
    for label, place in places.items():
        rays = trace_pupil(Camera.of(design), (share, 0.0), (place + offsets[:, None], 0.0))
        origin = place + design.microlens_array.decentre[0] - design.sensor.decentre[0]
        landing, passed = 1e3 * (rays.sensor[0] - origin), np.isin(rays.status, PASSED)
        bends = [(1e3 * ruler * design.d_2, in_air) for in_air, ruler in behind]
        marks: list[Mark] = []
        for k, (axis, ends, lit) in enumerate(zip(axes, landing, passed, strict=True)):
            # Stretches of equal fate share their ends.
            cuts = [0, *(np.flatnonzero(np.diff(lit)) + 1).tolist(), len(lit) - 1]
            for start, stop in pairwise(cuts):
                kept, a, b = lit[start], ends[start], ends[stop]
                edge = ("sky" if k % 2 else "blue") if kept else "vermillion"
                zs = [depth, *(at for at, _ in bends[::-1]), 0.0, *(at for at, _ in bends), depth]
                xs = [a, *(axis + in_air * (a - axis) for _, in_air in bends[::-1])]
                xs += [axis, *(axis + in_air * (b - axis) for _, in_air in bends), b]
                marks.append(Area(zs, xs, edge, 0.4 if kept else 1.0, hatch=not kept))
                marks.append(Line(zs, xs, edge, 0.9))
        bulge = 0.03 * depth * (1 - t**2)
        for axis in axes:
            y = axis + pitch / 2 * np.concatenate([t, t[::-1]])
            marks.append(Area([*-bulge, *bulge[::-1]], y, "pale", 1.0, "grey", 0.9))
        low = min(float(axes[0] - 0.6 * pitch), float(landing.min()))
        high = max(float(axes[-1] + 0.6 * pitch), float(landing.max()))
        for plate in (each for each in design.plates if not each.part.before_lenslets):
            near, far = (-1e3 * (z + design.d_1) for z in (plate.far, plate.near))
            marks.insert(0, _block(near, far, low, high, *GLASS, edge="sky", width=0.8, testid="glass"))
        marks += _pixel_row(design, 1e3 * origin, low, high, depth)
        x, title = Scale(-0.16 * depth, 1.16 * depth), f"{label}, x = {short(place)} mm"
        panel = Panel((0, 0, 1, 1), x, Scale(low, high), tuple(marks), *labels, title, grid="")
        size = PAGE / len(places), 310.0
        pictures.append(one_panel(f"cells-{label}", label, size, panel, left=62, top=26, right=12))
    return beside("cells", f"Light cones behind 5 microlenses of {design.name}", pictures)


def _pixel_row(design: Design, origin: float, low: float, high: float, depth: float) -> list[Mark]:
    size = 1e3 * design.q
    # The sensor's first pixel starts at its edge.
    edge = -500 * design.pixels[0] * design.q - origin
    first, last = max(math.floor((low - edge) / size), 0), min(math.ceil((high - edge) / size), design.pixels[0])
    left, right = depth, 1.06 * depth
    fine = last - first > MOST_PIXELS
    dark = edge + size * np.arange(first + (first + 1) % 2, first if fine else last, 2)
    marks: list[Mark] = [bars(left, right, dark + size / 2, size, fill="pale")] if len(dark) else []
    if first < last:
        middle = edge + size * (first + last) / 2
        marks.append(
            bars(left, right, middle, size * (last - first), fill="pale" if fine else "none", edge="grey", width=0.6)
        )
    return [*marks, Line([depth, depth], [low, high], "ink", 1.6)]


ROOM = 0.35
"""Exponent that brings distances of all sizes into one drawing; 1 would be to scale."""
THICK = 0.09
"""Half the width in which an element before the main lens is drawn."""
WALL = 1.12
"""Where mounts end, in half heights of the tallest element."""
LEAST = 0.1
"""Least half height of a part in it: smaller ones are drawn taller than to the scale of the others."""
TUBE_END = "end of the tube"


class _SchematicPart(NamedTuple):
    """Something on the axis."""

    name: str
    z: float
    """Distance from the lens, in front of it below 0 [mm]."""
    diameter: float
    """Or height [mm]; 0 where it has none."""
    says: tuple[str, ...]
    """Lines that are written above it; none of what others name."""
    glass: AnyElement | None = None
    """Element before the main lens that it is; None of other parts."""
    stop: int | None = None
    """Number of the stop that it is, 0 the FAP; None of other parts."""


def dimensions(design: Design) -> Picture:
    """Draw the parts in their order along the axis with dimension lines; not to scale, the numbers are."""
    design = design.thin_twin.with_own_stop if design.d_3 < 0 else design
    tube = DrawnTube.of(design)
    parts = _schematic_parts(design, tube)
    gaps = [b.z - a.z for a, b in pairwise(parts)]
    spread = np.cumsum([0.0, *(max(0.28, (gap / max(gaps)) ** ROOM) for gap in gaps)])
    # From 0 at the object plane to 8 at the sensor.
    place = dict(zip((e.name for e in parts), (8 * spread / spread[-1]).tolist(), strict=True))
    tallest = max([*(part.diameter for part in parts), 2 * (tube.outer + tube.flare) * tube.stated])
    high = {e.name: max(LEAST, e.diameter / tallest) if e.diameter else 0.8 for e in parts}
    mounts = {e.name: tube.outer / (tallest / 2) if tube.holds(e.z) else WALL for e in parts}
    x = Scale(-0.45, 8.75)
    unit = PAGE / (x.high - x.low)
    up = 1 / (0.86 * unit)
    marks: list[Mark] = [Line([-0.1, 8.25], [0.0, 0.0], "grey", 0.9, "12 4 3 4")]
    for part in parts:
        marks += _drawn(part, place[part.name], high[part.name], mounts[part.name])
    # A part's distance is that of its sensor side; the whole ends at the other.
    thick = {e.name: THICK if e.glass is not None and e.glass.length else 0.0 for e in parts}
    near, far = ({name: at + side * thick[name] for name, at in place.items()} for side in (1, -1))
    # What each part is stands above it, higher where its neighbour's words would touch.
    said = [part for part in parts if part.says]
    widths = [(max(text_width(line, SMALL) for line in part.says) + 6) / unit for part in said]
    highest, words = WALL, []  # type: float, list[Mark]
    for part, row in zip(said, rows_of_names([place[part.name] for part in said], widths), strict=True):
        at, bottom = place[part.name], WALL + (10 + 44 * row) * up
        top = mounts[part.name] if part.stop is not None else high[part.name]
        marks.append(Line([at, at], [top + 0.03, bottom - 2 * up], "grey", 0.7))
        for k, line in enumerate(reversed(part.says)):
            words.append(Text(at, bottom + 13 * k * up, line, "ink", SMALL, "middle", dy=-2, plate=True))
        highest = max(highest, bottom + (13 * len(part.says) + 6) * up)
        if part.glass is not None:
            marks += _view(part.glass.turn, (at - THICK, 0.0), 62.0, (1 / unit, up))
    marks += words  # over the leaders of their neighbours
    level = -WALL - 0.25
    aside: list[Mark] = []
    lines = [
        (text, start, stop, far[start] if text.startswith(("overall", "tube")) else near[start], near[stop])
        for text, start, stop in _dimension_lines(design, tube, parts)
    ]
    for text, _, _, a, b in lines:
        if text.startswith("tube"):
            inner, wall, outer, flare = (2 * s / tallest for s in (tube.inner, tube.wall, tube.outer, tube.flare))
            marks[:0] = DrawnTube(inner, wall, outer, (a, b), True, math.inf, flare).marks(math.inf)
    for k, (text, start, stop_at, a, b) in enumerate(lines):
        for at, top in ((a, -high[start]), (b, -high[stop_at])):
            marks.append(Line([at, at], [top - 0.04, level - 0.05], "grey", 0.5))
        wide = (text_width(text, SMALL) + 8) / unit
        below = {at for *_, one, other in lines[k + 1 :] for at in (one, other)}
        middle = _clear_middle(a, b, below, wide, 8 / unit)
        if middle is None:
            marks.append(Line([a, b], [level, level], "ink", 0.9, ends="<>"))
            at, end, off = (a, "end", -7.0) if a - wide > x.low else (b, "start", 7.0)
            aside.append(Text(at, level, text, "ink", SMALL, end, off, 4, plate=True))
        else:  # the line stops before its words
            for end, side in ((a, -1), (b, 1)):
                marks.append(Line([middle + side * wide / 2, end], [level, level], "ink", 0.9, ends=">"))
            marks.append(Text(middle, level, text, "ink", SMALL, "middle", 0.0, 4))
        level -= 0.36
    marks += aside  # over the leaders of longer ones
    y = Scale(level + 0.05, highest)
    size = PAGE, 0.86 * unit * (y.high - y.low)
    panel = Panel((0.0, 0.0, *size), x, y, tuple(marks), bare=True)
    return Picture("dimensions", f"Elements of {design.name} and their dimensions", size, (panel,))


def _clear_middle(start: float, end: float, crossing: Iterable[float], wide: float, head: float) -> float | None:
    """Where words so wide stand on a dimension line: near its middle, between the leaders that cross it, off its heads.

    None where there is no room on it.
    """
    cuts = sorted({start, end, *(at for at in crossing if start < at < end)})
    rooms = [(a + (head if a == start else 0.0), b - (head if b == end else 0.0)) for a, b in pairwise(cuts)]
    middle = (start + end) / 2
    places = [min(max(middle, a + wide / 2), b - wide / 2) for a, b in rooms if b - a >= wide]
    return min(places, key=lambda place: abs(place - middle), default=None)


def _schematic_parts(design: Design, tube: DrawnTube) -> list[_SchematicPart]:
    """Everything on the axis, from the object to the sensor, and the end of a tube that no part stands at."""
    mla, (wide, tall), say = design.microlens_array, design.sensor_size, length
    parts = [
        _SchematicPart("object plane", -design.d_f, 0.0, ("object plane",)),
        _SchematicPart("FAP", -design.d_3, design.D_F, (_pupil_name(design), _pupil_size(design)), stop=0),
        _SchematicPart("main lens", 0.0, design.D, (f"main lens, D = {say(design.D)}", f"f = {say(design.f)}")),
        _SchematicPart("MLA", design.d_1, mla.size[1], ("MLA", f"d = {say(design.d)}", f"f_ml = {mla.focal_words}")),
        _SchematicPart(
            "sensor", design.d_1 + design.d_2, tall, ("sensor", f"q = {say(design.q)}", f"{wide:.4g} × {tall:.4g} mm")
        ),
    ]
    for number, stop in enumerate(design.openings[1:], 1):
        wide, words = float(stop.part.outline.width), stop.part.outline.words
        parts.append(_SchematicPart(stop.name, -stop.near, wide, (stop.name, words), stop=number))
    for _, name, part, near, far in design.in_bore:
        tall = 2 * (part.half_height or 0.0)
        parts.append(_SchematicPart(name, -(near + far) / 2, tall, (name, *made_of(part)), part))
    if tube.stated and not any(_at_end(part, tube) for part in parts):
        parts.append(_SchematicPart(TUBE_END, tube.ends[1], 2 * tube.outer, ()))
    return sorted(parts, key=lambda part: part.z)


def _at_end(part: _SchematicPart, tube: DrawnTube) -> bool:
    return math.isclose(part.z, tube.ends[1], abs_tol=1e-6 * (tube.ends[1] - tube.ends[0]))


def _pupil_size(design: Design) -> str:
    outline = design.aperture.outline
    if outline.straight or design.d_3 < 0:
        return outline.words
    return f"D_F = {length(design.D_F)}"


def _dimension_lines(design: Design, tube: DrawnTube, parts: Iterable[_SchematicPart]) -> list[tuple[str, str, str]]:
    """Text of each dimension line, and the two parts it runs between."""
    standing = design.placed
    stops, ends = {at.name: at.near for at in standing}, {at.name: at.far for at in standing}
    front = max(ends, key=lambda name: ends[name])
    front = front if ends[front] > 0 else "main lens"
    behind = stops.pop("FAP") if stops["FAP"] < 0 else 0.0
    camera = Camera.of(design)
    between = f" with {length(float(camera.hiatus))} from H to H'" if camera.hiatus else ""
    back = next((part.name for part in parts if _at_end(part, tube)), "")
    long = "" if back == "sensor" else f", {length(tube.ends[1] - tube.ends[0])}"
    return [
        (f"d_2 = {length(design.d_2)}", "MLA", "sensor"),
        *([(f"stop {length(-behind)} behind", "main lens", "FAP")] if behind else []),
        (f"d_1 = {length(design.d_1)}", "main lens", "MLA"),
        *(
            (f"d_3 = {length(distance)}" if name == "FAP" else f"{name}: {length(distance)}", name, "main lens")
            for name, distance in sorted(stops.items(), key=lambda stop: stop[1])
        ),
        (f"d_f = {length(design.d_f)}", "object plane", "main lens"),
        *([(f"tube {tube.sizes}{long}", front, back)] if tube.stated else []),
        (f"overall {length(float(QUANTITIES['total_length_mm'](camera)))}{between}", front, "sensor"),
    ]


def _drawn(element: _SchematicPart, x: float, half: float, wall: float) -> list[Mark]:
    if element.name == "object plane":
        return [Line([x, x], [-half, half], "ink", 1.3, "5 4")]
    if element.name == TUBE_END:
        return []
    if element.name == "sensor":
        return [Area([x, x + 0.09, x + 0.09, x], [-half, -half, half, half], "ink")]
    power = 1 if element.glass is None else element.glass.power_sign
    if not power:
        return [_block(x - THICK, x + THICK, -half, half, *GLASS, edge="sky", width=1.2)]
    if element.name in ("main lens", "MLA") or element.glass is not None:
        count, wide = (11, 0.05) if element.name == "MLA" else (1, 0.13)
        if power < 0:
            up = np.linspace(-half, half, 25)
            edge = 0.04 + 0.1 * (up / half) ** 2
            return [Area([*(x - edge), *(x + edge)[::-1]], [*up, *up[::-1]], "sky", 0.6, "blue", 1.0)]
        turn = np.linspace(0, 2 * np.pi, 40, endpoint=False)
        middles = (2 * np.arange(count)[:, None] + 1 - count) * half / count
        xs, ys = np.tile(x + wide * np.cos(turn), (count, 1)), middles + half / count * np.sin(turn)
        return [Area(parted(xs), parted(ys), "sky", 0.6, "blue", 1.0 if count == 1 else 0.7)]
    colour = stop_colour(element.stop or 0)
    return [Line([x, x], [sign * half, sign * max(half, wall)], colour, 4) for sign in (-1, 1)]
