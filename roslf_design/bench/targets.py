"""Printed targets that suit a camera, and each as a drawing true to scale [mm]."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..calibration.frames import Array
from ..calibration.model import Board, Markers
from ..camera import Camera
from ..design import Design
from ..errors import refusal
from ..evaluation.field_images import FieldImages, ObjectField
from ..evaluation.required import required_depth, required_distances
from ..evaluation.stations import ASKED, planes
from ..theory.depth_budget import depth_budget
from ..theory.light import object_scale
from ..theory.vignetting import lit_radius
from .captures import BoardPose, BoardTarget, EdgeTarget, FieldTarget, Kind, Setup, SpheresTarget, WallTarget

A4 = (210.0, 297.0)
GLASS = (76.0, 52.0)
"""Smallest plate of a target that no printer resolves."""
DOT = 25.4 / 600
"""Dot of a printer [mm]."""
_ANGLE = math.radians(5.0)
PAPER_BAR, GLASS_BAR = 100.0, 20.0
"""Scale bars [mm]."""
_ACROSS, _WHOLE = 0.45, 0.85
"""Shares of the field's shorter side that the slanted square takes in the focal plane, and that it may take."""
_LEAST_EDGE = 20.0
"""Microlenses' footprints along the square's side, where its edges still tell something."""
_FEWEST_DOTS = 3
"""Dots of the wall across the field's shorter side, where it still has texture."""
_BALLS = 0.2, 0.3
"""Spheres' diameter and spacing over the diagonal of the measured volume: VDI/VDE 2634-2 has a tenth to a fifth, and
three tenths or more; depth by windows of microlenses takes the largest."""
CLOSE = 0.1
"""Share of a distance at which depth is required within which no other wall stands: of two promises there one holds."""
_RINGS, LINE = 8, 0.2
"""Rings in half the field at least, and the width of their lines over the gap between them."""


@dataclass(frozen=True)
class Words:
    """A line of text on a target."""

    x: float
    y: float
    text: str
    size: float
    """Height of its letters' em [mm]."""
    middle: bool = False
    """Centred about x; else it begins there."""

    def moved(self, by: Array) -> Words:
        """Line moved [mm]."""
        return replace(self, x=self.x + float(by[0]), y=self.y + float(by[1]))


@dataclass(frozen=True, eq=False)
class Sheet:
    """One page with a target: x to the right, y down from its upper left corner [mm]."""

    kind: Kind
    title: str
    size: tuple[float, float]
    bar: float
    """Length of its scale bar."""
    dark: tuple[Array, ...]
    """Polygons in black, shape (n, 2) each."""
    rings: tuple[tuple[float, float, float, float], ...] = ()
    """Circles: x, y, radius, width of the line."""
    words: tuple[Words, ...] = ()
    feature: str = ""
    """Finest detail that must come out."""

    @property
    def remark(self) -> str:
        """How it is made: page and, where no printer resolves it, lithography."""
        page = "A4" if self.size == A4 else f"page {self.size[0]:g} x {self.size[1]:g} mm"
        return f"lithography (chrome on glass), {page}: {self.feature} for 600 dpi" if self.bar < PAPER_BAR else page

    @property
    def bar_places(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Ends of the scale bar, left and right."""
        x, y = (self.size[0] - self.bar) / 2, self.size[1] - (18.0 if self.size[1] > 150 else 9.0)
        return (x, y), (x + self.bar, y)


def setup_for(
    design: Design, board: Board, poses: tuple[BoardPose, ...], seed: int, asked: Sequence[float] = ()
) -> Setup:
    """Targets that suit a design, at its working range's ends and focal plane; `poses` are the plan's.

    The wall, which shows how flat depth is, stands at the distances that the design requires something at and at those
    `asked` for as well [mm]; but where the design has no depth, and beside a distance at which depth is required.

    Raises
    ------
    InputError
        A distance asked for at which the wall's dots would be too few, or the design has no depth.
    """
    camera = Camera.of(design)
    shown = FieldImages.of(design)
    ends = shown.ends
    stations = tuple(ObjectField.of(ends, at, name) for name, at in planes(camera))
    near, focus, far = stations
    required = required_distances(design, far.at_mm)
    others = (*((ASKED, at) for at in asked), *(("required", at) for at in required))
    walls = sorted({*stations, *(ObjectField.of(ends, at, name) for name, at in others)}, key=lambda field: field.at_mm)
    walls = _with_depth(design, walls)
    # Beyond the farthest its finest dots alias, and put depth off; too near, too few are in sight.
    suits = [field for field in walls if not asked or field.at_mm >= max(asked)] if required else walls[-1:]
    farthest = max(suits, key=lambda one: (len(_textured(walls, one)), one.at_mm))
    textured = _textured(walls, farthest)
    finest = _dots(farthest)
    for field in walls:
        if field.plane == ASKED and field not in textured:
            few = f"a wall that suits {farthest.at_mm:.4g} mm shows too few dots there"
            raise refusal("at", f"{field.at_mm:g} mm is too near: {few}; give a farther one")
    coarsest = max(_narrow(walls[0]) / 4, 8 * farthest.object_sample_mm)
    side = _rounded(_ACROSS * _narrow(focus), 2)
    suited = [
        field
        for field in stations
        if field is focus or _LEAST_EDGE * field.object_sample_mm <= side <= _WHOLE * _narrow(field)
    ]
    across = min(math.hypot(focus.width_mm, focus.height_mm), focus.diagonal_mm)
    volume = math.hypot(across, min(far.at_mm - near.at_mm, focus.at_mm))
    volume *= min(1.0, _WHOLE * max(focus.width_mm, focus.height_mm) / (sum(_BALLS) * volume))
    ends_lit = ObjectField.of(shown.seen, far.at_mm, "").diagonal_mm > far.diagonal_mm * (1 + 1e-9)
    lit = far.diagonal_mm / 2 if ends_lit else abs(float(lit_radius(camera) * object_scale(camera, far.at_mm)))
    radii = _radii(near.diagonal_mm / 2, far.diagonal_mm / 2, lit)

    def printed(fine: bool) -> dict[str, float]:
        bar = GLASS_BAR if fine else PAPER_BAR
        return {"bar": bar, "printed_bar": bar}

    return Setup(
        seed=seed,
        board=BoardTarget(cells=board.text, **printed(board.cell < 10 * DOT or _feature(board) < 4 * DOT)),
        edge=EdgeTarget(
            angle=_ANGLE, side=side, at=_at(suited), **printed(suited[0].object_sample_mm < 2 * DOT),
        ),
        wall=WallTarget(
            side=_rounded(1.1 * max(farthest.width_mm, farthest.height_mm), 3), finest=finest,
            octaves=1 + max(1, math.ceil(math.log2(coarsest / finest))), at=_at(textured), **printed(finest < 2 * DOT),
        ),
        spheres=SpheresTarget(
            diameter=_rounded(_BALLS[0] * volume, 2), spacing=_rounded(_BALLS[1] * volume, 2),
            finest=_rounded(2 * focus.object_sample_mm, 2), at=_at([focus]),
        ),
        field=FieldTarget(radii=radii, at=_at([near, far]), **printed(LINE * radii[0] < 2 * DOT)),
        poses=poses,
    )  # fmt: skip


def sheets(setup: Setup, name: str) -> tuple[Sheet, ...]:
    """Drawings of the targets, for the design of that name."""
    return (_board(setup, name), _edge(setup, name), _wall(setup, name), _spheres(setup, name), _field(setup, name))


def _with_depth(design: Design, walls: Sequence[ObjectField]) -> list[ObjectField]:
    """Walls where a design has depth, if it has any, and none beside a distance at which depth is required."""
    camera = Camera.of(design)
    budgets = {field: depth_budget(camera, field.at_mm) for field in walls}
    told = [field for field, budget in budgets.items() if math.isfinite(budget.u_z_mm)]
    for field in walls if told else []:
        if field.plane == ASKED and field not in told:
            raise refusal("at", f"{field.at_mm:g} mm: the design has no depth there ({budgets[field].cause}); drop it")
    limited = [field.at_mm for field in told if required_depth(design, field.at_mm) is not None]
    return [
        field
        for field in told or walls
        if field.plane == ASKED
        or field.at_mm in limited
        or not any(abs(field.at_mm - at) <= CLOSE * at for at in limited)
    ]


def _at(fields: Iterable[ObjectField]) -> tuple[float, ...]:
    return tuple(dict.fromkeys(_rounded(field.at_mm, 4) for field in fields))


def _rounded(value: float, digits: int) -> float:
    return float(f"{value:.{digits}g}")


def _dots(farthest: ObjectField) -> float:
    """Finest dots of a wall that suits a distance [mm]."""
    return _rounded(2 * farthest.object_sample_mm, 2)


def _textured(walls: Sequence[ObjectField], farthest: ObjectField) -> list[ObjectField]:
    """Places up to one that the wall suits for which it has dots enough."""
    least = _FEWEST_DOTS * _dots(farthest)
    return [field for field in walls if field.at_mm <= farthest.at_mm and _narrow(field) >= least]


def _narrow(field: ObjectField) -> float:
    """Side of the largest square that the field holds."""
    return min(field.width_mm, field.height_mm, field.diagonal_mm / math.sqrt(2))


def _radii(near: float, far: float, lit: float) -> tuple[float, ...]:
    """Radii of rings out to the field's half diagonals at both its ends: fine ones where the near field ends.

    Somewhat beyond, where the sensor may stand off the middle, but none where no light comes from.
    """
    radii: list[float] = []
    for reach in (near, far):
        decade = 10.0 ** math.floor(math.log10(reach / _RINGS))
        step = next(step * decade for step in (1, 2, 5, 10) if step * decade >= reach / _RINGS)
        count = math.ceil(1.15 * reach / step)
        radii += [_rounded(step * k, 6) for k in range(1, count + 1) if step * k > max(radii, default=0.0) * (1 + 1e-9)]
    return tuple(radius for radius in radii if radius <= lit * (1 + 1e-9))


def _feature(board: Board) -> float:
    """Finest feature of a board: a marker's bit, or a cell."""
    return board.cell if board.markers is None else board.markers.width / (_bits(board.markers) + 2)


def _too_fine(size: float) -> str:
    return f"features of {1e3 * size:.3g} um are too fine" if size < 0.1 else f"features of {size:.3g} mm are too fine"


def _bits(markers: Markers) -> int:
    return int(markers.dictionary[5])


def _page(content: tuple[float, float], glass: bool, bar: float) -> tuple[tuple[float, float], Array]:
    """Size of the page for a target of some size, and where its middle lies."""
    width, height = content
    if glass:
        size = max(GLASS[0], math.ceil(width + 12)), max(GLASS[1], math.ceil(height + 30))
        return size, np.array([size[0] / 2, (size[1] - 6) / 2])
    fits = width <= A4[0] - 20 and height <= A4[1] - 75
    size = A4 if fits else (max(bar + 60, math.ceil(width + 30)), math.ceil(height + 85))
    return size, np.array([size[0] / 2, (size[1] - 5) / 2])


def _sheet(
    kind: Kind, heads: tuple[str, str], content: tuple[float, float], dark: Iterable[Array], *, bar: float,
    feature: str = "", rings: Iterable[tuple[float, ...]] = (), words: Iterable[Words] = (),
) -> Sheet:  # fmt: skip
    """Page of a target whose parts are drawn about its middle."""
    glass = bar < PAPER_BAR
    size, middle = _page(content, glass, bar)
    letters = 1.6 if glass else 3.4
    how = f"Make it at 100 %, measure the bar, write its length to bench.toml: [{kind}] printed_bar"
    if kind == "spheres":
        how = "A drawing to machine by; measure diameter and spacing, write them to bench.toml: [spheres]"
    text = [
        Words(
            size[0] / 2, (3 if glass else 12) + 1.5 * letters * k, line, min(letters, 1.6 * size[0] / len(line)), True
        )
        for k, line in enumerate((*heads, how))
    ]
    text += [line.moved(middle) for line in words]
    return Sheet(
        kind,
        heads[0],
        (float(size[0]), float(size[1])),
        bar,
        tuple(polygon + middle for polygon in dark),
        tuple((x + middle[0], y + middle[1], radius, width) for x, y, radius, width in rings),
        tuple(text),
        feature,
    )


def _rectangle(corner: tuple[float, float] | Array, width: float, height: float) -> Array:
    return np.asarray(np.array([[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]]) + corner)


def _board(setup: Setup, name: str) -> Sheet:
    board, bar = setup.board.drawn, setup.board.bar
    width, height = board.columns * board.cell, board.rows * board.cell
    fine = _too_fine(_feature(board))
    return _sheet("board", (f"Board {board.text}", name), (width, height), _cells(board), bar=bar, feature=fine)


def _cells(board: Board) -> Iterator[Array]:
    """Dark cells, the first one dark, and the dark bits of markers where OpenCV puts them."""
    corner = -np.array([board.columns, board.rows]) * board.cell / 2
    for row in range(board.rows):
        for column in range(row % 2, board.columns, 2):
            yield _rectangle(corner + board.cell * np.array([column, row]), board.cell, board.cell)
    if board.markers is None:
        return
    import cv2

    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.markers.dictionary))
    drawn = cv2.aruco.CharucoBoard((board.columns, board.rows), board.cell, board.markers.width, dictionary)
    across = _bits(board.markers) + 2
    bit = board.markers.width / across
    for number, places in zip(np.ravel(drawn.getIds()), drawn.getObjPoints(), strict=True):
        dark = dictionary.generateImageMarker(int(number), across, borderBits=1) < 128
        yield from _runs(dark, bit, corner + np.asarray(places, float)[:, :2].min(axis=0))


def _runs(dark: NDArray[np.bool_], side: float, corner: Array) -> Iterator[Array]:
    """Dark squares of a grid as rectangles, joined along rows."""
    for row, line in enumerate(dark):
        ends = np.flatnonzero(np.diff(np.concatenate([[0], line.astype(int), [0]])))
        for start, end in ends.reshape(-1, 2):
            yield _rectangle(corner + side * np.array([start, row]), side * (end - start), side)


def _edge(setup: Setup, name: str) -> Sheet:
    edge = setup.edge
    cos, sin = math.cos(edge.angle), math.sin(edge.angle)
    square = _rectangle((-edge.side / 2, -edge.side / 2), edge.side, edge.side) @ np.array([[cos, sin], [-sin, cos]])
    title = f"Slanted edge, square of {edge.side:g} mm turned by {math.degrees(edge.angle):g} degrees"
    size, ragged = (edge.across, edge.across), "edges are too ragged"
    return _sheet("edge", (title, name), size, [square], bar=edge.bar, feature=ragged)


def _wall(setup: Setup, name: str) -> Sheet:
    wall, count = setup.wall, setup.wall.count
    dark = texture(count, wall.octaves, np.random.default_rng(setup.seed))
    side = count * wall.finest
    corner = np.full(2, -side / 2)
    title = f"Wall with texture, dots from {wall.finest:g} mm in {wall.octaves} octaves"
    squares = _runs(dark, wall.finest, corner)
    return _sheet("wall", (title, name), (side, side), squares, bar=wall.bar, feature=_too_fine(wall.finest))


def texture(count: int, octaves: int, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Dark dots of a wall, shape (count, count): octaves of noise with equal weight, half of the dots dark."""
    total = np.zeros((count, count))
    for octave in range(octaves):
        size = 2**octave
        coarse = rng.normal(size=(math.ceil(count / size),) * 2)
        total += np.kron(coarse, np.ones((size, size)))[:count, :count]
    return np.asarray(total > np.median(total))


def _spheres(setup: Setup, name: str) -> Sheet:
    ball = setup.spheres
    enlarged = next(k for k in (1, 2, 5, 10, 20, 50, 100, 1000) if k * ball.spacing >= 20 or k == 1000)
    diameter, half = enlarged * ball.diameter, enlarged * ball.spacing / 2
    radius, line, size = diameter / 2, 0.25, 3.4
    low, high = 1.2 * diameter, -0.9 * diameter
    dark = [
        _rectangle((-half, low - line / 2), 2 * half, line),
        _rectangle((-half - radius, high - line / 2), diameter, line),
        *(_rectangle((x - line / 2, 0.0), line, low + size / 2) for x in (-half, half)),
        *(_rectangle((x - line / 2, high - size / 2), line, size / 2 - high) for x in (-half - radius, -half + radius)),
    ]
    words = [
        Words(0.0, low + 1.5 * size, f"{ball.spacing:g} mm between centres", size, middle=True),
        Words(-half - radius, high - 0.8 * size, f"diameter {ball.diameter:g} mm, twice", size),
        Words(0.0, low + 3.0 * size, f"matt, light, with dots of {ball.finest:g} mm", size, middle=True),
    ]
    rings = [(x, 0.0, radius, line) for x in (-half, half)]
    scale = "" if enlarged == 1 else f" (drawn {enlarged} : 1)"
    title = f"Pair of spheres, {ball.diameter:g} mm, centres {ball.spacing:g} mm apart{scale}"
    content = 2 * half + diameter, 3.2 * diameter
    return _sheet("spheres", (title, name), content, dark, bar=PAPER_BAR, rings=rings, words=words)


def _field(setup: Setup, name: str) -> Sheet:
    field = setup.field
    gaps = np.diff([0.0, *field.radii])
    rings = [(0.0, 0.0, radius, LINE * float(gap)) for radius, gap in zip(field.radii, gaps, strict=True)]
    arm, line = field.radii[0] / 2, LINE * field.radii[0]
    dark = [_rectangle((-arm, -line / 2), 2 * arm, line), _rectangle((-line / 2, -arm), line, 2 * arm)]
    words = [
        Words((radius - gap / 2) / math.sqrt(2), (radius - 0.25 * gap) / math.sqrt(2), f"{radius:g}", 0.3 * gap, True)
        for radius, gap in zip(field.radii, gaps.tolist(), strict=True)
    ]
    reach = field.radii[-1]
    title = f"Rings for the field of view: radii in mm to the middle of their lines, to {reach:g} mm"
    content = 2 * reach + line, 2 * reach + line
    fine = _too_fine(line)
    return _sheet("field", (title, name), content, dark, bar=field.bar, feature=fine, rings=rings, words=words)
