"""The instrument in three dimensions: its parts as bodies, rays of three microlenses, names."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..._arrays import Array
from ...bore.elements import AnyElement
from ...bore.fold import Fold, folded, folded_line
from ...camera import Camera
from ...camera.frames import Frame, frame
from ...design import Design
from ...design.parts import widening
from ...drawing.marks import Text
from ...drawing.picture import Picture
from ...drawing.solid import (
    AROUND,
    Body,
    BrowserScene,
    Instrument,
    Name,
    bands,
    browser_scene,
    outline,
    outlines,
    slanted,
    view_of,
)
from ...drawing.theme import FIELDS, ThemeName, short, stop_colour
from ...evaluation import default_fields
from ...lenses.glass import AIR
from ...rays import PASSED, paths, trace_pupil
from ...theory.quantities import QUANTITIES
from .rays import LENS, MEDIUM, MICROLENSES, name_of_drawn, reaches

NAMED = 3
"""Number of parts of glass up to which a legend names each."""
ALONG = 1e-9
"""Sine of the turn of a view up to which it stays along the axis."""
RINGS = 24
"""Parallels of an ellipsoid from pole to pole."""
RAYS = ("rays centre", "rays edge", "rays corner", "rays blocked")
"""Parts that may be without rays."""


def scale_drawing(design: Design, width: float) -> Picture:
    """Drawing of the instrument from the side, to scale, its axis folded by its true angles; real lenses thin."""
    seen = instrument_scene(design.thin_twin, side=True)
    names = tuple(name for name in seen.names if not name.foot)  # of parts: their colours need no others
    parts = tuple(part if part.kind == "lines" else part._replace(label="") for part in seen.parts)
    picture, camera = outlines(seen._replace(parts=parts, names=names), width, 22.0), Camera.of(design)
    aside = short(float(QUANTITIES["direction_of_view_deg"](camera)), 3)
    title = f"folded, to scale: it looks {aside}° from straight ahead" if camera.chain.folds else "to scale"
    return replace(picture, name="to-scale", title=title, remarks=(Text(14.0, 14.0, title, bold=True),))


def instrument_scene(design: Design, fold: bool = True, side: bool = False) -> Instrument:
    """The instrument from in front of the outermost stop to the sensor; the object plane lies beyond the left edge.

    With `fold` it is drawn as mirrors and prisms fold it, else along the unfolded axis. A prism turns light in the
    middle of its way: at a mirror there, or, of an even number of reflections, as if the axis bent. From the `side` one
    looks along the plane's normal in which the first of them turns the view.
    """
    design = design.with_own_stop
    end = design.d_1 + design.d_2
    camera = Camera.of(design)
    front = float(camera.tip)
    start = -min(front + 0.22 * (front + end), design.d_f)
    folds = camera.chain.folds if fold else ()
    rays = _pencils(design, start)
    inside = [np.concatenate(courses) for _, courses, _ in rays]
    reach = [float(np.hypot(*points[points[:, 2] >= -front, :2].T).max(initial=0.0)) for points in inside]
    # A tube that all elements and rays fit into, where none is stated.
    wide = max(
        1.08 * max(*reaches(design), math.hypot(*design.microlens_array.size) / 2), 1.02 * max(reach, default=0.0)
    )
    wall = _Wall.of(design, wide, -front)
    in_air = design.object_space.medium == AIR
    before = np.array([[0.0, 0.0, start]]) if in_air else turned([(wall.at(-front), z) for z in (start, -front)])
    tops = [(stop.name, -stop.near, wall.at(-stop.near)) for stop in design.openings]
    middles = ((at, -(at.near + at.far) / 2) for at in design.in_bore)
    tops += [(name_of_drawn(at, fold), z, wall.at(z)) for at, z in middles]
    tops += [("main lens", 0.0, wall.at(0.0)), ("MLA and sensor", end, wall.at(end))]
    tops.append((f"light comes from the object plane, {design.d_f:.4g} mm in front of the lens", start, 0.0))
    up = -folds[0].turn[:, 2] * [1.0, 1.0, 0.0] if side and folds else np.zeros(3)  # where what is ahead goes
    up = up / np.hypot(*up[:2]) if np.hypot(*up[:2]) > ALONG else np.array([0.0, 1.0, 0.0])
    ahead = np.array([0.0, 0.0, 1.0])
    axes = np.array([ahead, up, np.cross(ahead, up)]) if side else slanted()
    named = [
        Name(text, tuple(folded(folds, (y * up + z * ahead)[None])[0].tolist()), not y)
        for text, z, y in sorted(tops, key=lambda top: top[1])
    ]
    parts = [*_elements(design, camera, wall), *_glass(design, camera, wall, fold)]
    if not in_air:
        parts.append(Body("medium", "round", before, bands(2), *MEDIUM, label="liquid"))
    drawn = [part._replace(points=folded(folds, part.points)) for part in parts]
    tube = _tube(folds, wall, -front, end)
    lines = [
        _lines(name, [folded_line(folds, course) for course in courses], *look, name.removeprefix("rays "))
        for name, courses, look in rays
    ]
    view = view_of(np.concatenate([*(part.points for part in (*tube, *drawn)), folded(folds, before)]), axes)
    return Instrument((*lines, *drawn, *tube), view, tuple(named))


def tube_words(design: Design) -> str:
    """Words on the grey tube of the picture, after its name."""
    if design.tube is not None:
        return "is that of [tube]"
    return "stands around all that is drawn: it is not to the size of any [tube]"


class _Wall(NamedTuple):
    """Outer wall of what is drawn, along the axis: of the stated tube over its length, and about all parts behind."""

    inserted: float
    """Radius of the stated tube [mm]."""
    back: float
    """Where it ends, along the axis [mm]."""
    behind: float
    """Radius of what lies behind it [mm]."""
    front: float = 0.0
    """Where it begins [mm]."""
    flare: float = 0.0
    """By how much its radius is more at the other end of a cone [mm]."""

    label: str = "around all parts"
    """Name of it in a legend."""

    @classmethod
    def of(cls, design: Design, wide: float, front: float) -> _Wall:
        """Wall of a design whose parts and rays reach as `wide`."""
        tube = design.tube
        if tube is None:
            return cls(wide, front, wide)
        length = math.inf if tube.length is None else tube.length
        flare = 0.0 if tube.proximal_diameter is None else (tube.proximal_diameter - tube.outer_diameter) / 2
        return cls(tube.outer_diameter / 2, front + length, wide, front, flare, "tube")

    def at(self, z: float) -> float:
        """Radius at a place along the axis [mm]."""
        if not self.flare or z > self.back:
            return self.inserted if z <= self.back else self.behind
        return self.inserted + float(widening(0.0, self.flare, self.back - self.front, z - self.front))


def _tube(folds: Sequence[Fold], wall: _Wall, front: float, end: float) -> list[Body]:
    """The tube, mitred where the axis is folded; one that is stated no farther than it reaches.

    That is straight: it ends where it has room for the first fold, beyond which light leaves it sideways; none is drawn
    where that lies behind it.
    """
    stated = wall.back > front
    if folds and stated:
        first = -folds[0].distance
        if first >= wall.back:
            return []
        front = first - wall.at(first)
    if stated and (folds or wall.flare or wall.back < end):
        brims = [(wall.at(z), z) for z in (front, min(wall.back, end))]
        body = Body("tube", "round", turned(brims), bands(2), "grey", 0.10, label=wall.label)
        return [body, _lines("tube ends", [_circle(*one) for one in brims], "grey", 1.5)]
    radius = wall.at(front)
    joints = [turned([(radius, end)])]
    for fold in folds:
        for normal in fold.joints:
            joint = turned([(radius, -fold.distance)])
            joint[:, 2] -= joint[:, :2] @ normal[:2] / normal[2]
            joints.append(np.clip(joint, [-np.inf, -np.inf, front], [np.inf, np.inf, end]))
    joints.append(turned([(radius, front)]))
    tubes = []
    for k, (nearer, farther) in enumerate(zip(joints[::2], joints[1::2], strict=True)):
        points = np.append(farther, nearer, axis=0)
        for fold in reversed(folds[:k]):
            points = fold.turned(points)
        tubes.append(
            Body("tube" if k == 0 else f"tube {k + 1}", "round", points, bands(2), "grey", 0.10, label=wall.label)
        )
    ends = [folded(folds, _circle(radius, z)) for z in (front, end)]
    return [*tubes, _lines("tube ends", ends, "grey", 1.5)]


def _glass(design: Design, camera: Camera, wall: _Wall, fold: bool) -> list[Body]:
    """Elements before the main lens as bodies of revolution, prisms that fold as blocks, the plates about the array."""
    parts: list[Body] = []
    for k, (_, called, element, _, _) in enumerate(design.in_bore):
        radius, pose = element.half_height or wall.at(-element.distance), _pose(camera, k)
        if fold and element.turn and element.length:
            parts += [half._replace(label=called) for half in _prism(called, element, radius, pose)]
            continue
        for piece, faces in enumerate(element.body(radius, 0.18 * radius)):
            # Upper halves of both faces, from the axis out on the left one and back on the right one.
            (left, right) = (face[len(face) // 2 :] for face in faces)
            rim = np.append(left, right[::-1], axis=0) + np.array([element.distance, 0.0])
            name = called + (f" piece {piece + 1}" if piece else "")
            shape = turned(rim[:, ::-1], frame=pose)
            parts.append(Body(name, "round", shape, bands(len(rim)), "sky", 0.35, label=called))
        parts.append(_lines(f"{called} rim", [_circle(radius, 0.0, pose)], "sky", 2.0))
    sizes = {"microlens_array": design.microlens_array.size, "sensor": design.sensor_size}
    for plate in design.plates:
        pose = camera.ruler_pose(plate.held_by)
        ends = -plate.far - float(pose.origin[2]), -plate.near - float(pose.origin[2])
        parts.append(_slab(plate.name, pose, sizes[plate.held_by], ends)._replace(label=plate.name))
    names = list(dict.fromkeys(part.label for part in parts if part.label))
    key = ", ".join(names) if len(names) <= NAMED else "windows, lenses and plates"
    return [part._replace(label=key if part.label else "") for part in parts]


def _prism(name: str, element: AnyElement, radius: float, pose: Frame) -> list[Body]:
    """Both parts of a square block that a fold cuts in its middle, in unfolded space."""
    half, cut = element.length / 2, Fold.of(element)
    ahead = np.array([math.cos(element.towards), math.sin(element.towards), 0.0])
    axes = np.array([ahead, np.cross([0.0, 0.0, 1.0], ahead), [0.0, 0.0, 1.0]])
    halves = []
    for side, normal in zip((1, -1), cut.joints, strict=True):
        u, z = side * float(normal @ ahead), side * float(normal[2])
        corners = np.array([(-radius, -half), (radius, -half), (radius, half), (-radius, half)])
        way = np.array([z, -u]) * min(radius / max(abs(z), 1e-12), half / max(abs(u), 1e-12))
        face = outline(np.concatenate([corners[corners @ [u, z] > 0], [way, -way]]))
        count = len(face)
        flat = np.concatenate([np.insert(face, 1, y, axis=1) for y in (-radius, radius)])
        points = (flat - [0.0, 0.0, half]) @ axes @ np.array([pose.x, pose.y, pose.z]) + np.asarray(pose.origin)
        sides = [[4, k, (k + 1) % count, count + (k + 1) % count, count + k] for k in range(count)]
        cells = [np.array(cell) for cell in ([count, *range(count)], [count, *range(count, 2 * count)], *sides)]
        called = name if side > 0 else f"{name}, beyond its fold"
        halves.append(Body(called, "plate", points, np.concatenate(cells), "sky", 0.25))
    return halves


def _pose(camera: Camera, k: int) -> Frame:
    """Vertex and axes of an element, which its openings share."""
    part = camera.in_bore[k]
    (_, place), *_ = part.element.openings(part.at)
    return frame(part.at.pair("decentre"), -place, part.element.lean(part.at))


def _elements(design: Design, camera: Camera, wall: _Wall) -> list[Body]:
    sensor, array, lens = map(camera.ruler_pose, ("sensor", "microlens_array", "main_lens"))
    radius = design.D / 2
    parts: list[Body] = []
    for number, stop in enumerate(design.openings):
        pose, outline, colour = camera.ruler_pose(stop.place), stop.part.outline, stop_colour(number)
        edge = np.stack(outline.rim(np.cos(TURN), np.sin(TURN)), -1)
        wide = wall.at(-stop.near) * np.stack([np.cos(TURN), np.sin(TURN)], -1)
        plate = _placed(np.concatenate([edge, wide]), pose)
        parts.append(Body(f"{stop.name} plate", "ring", plate, bands(2), colour, 0.38, label=stop.name))
        rim = outline.outline(math.pi / 48)
        parts.append(_lines(f"{stop.name} rim", [_placed(np.append(rim, rim[:1], axis=0), pose)], colour, 4.0))
    angle = np.linspace(math.pi, 0.0, RINGS + 1)
    glass = turned(np.stack([radius * np.sin(angle), 0.09 * design.D * np.cos(angle)], -1))
    mount = turned([(radius, 0.0), (max(radius, wall.at(0.0)), 0.0)], frame=lens)
    return [
        *parts,
        Body("lens", "round", glass + np.asarray(lens.origin), bands(RINGS + 1), LENS[0], 0.35, label="main lens"),
        _lines("lens rim", [_circle(radius, 0.0, lens)], "blue", 3.0),
        Body("lens mount", "ring", mount, bands(2), "blue", 0.16),
        _plate("MLA", array, design.microlens_array.size, MICROLENSES, 0.55, "microlenses"),
        _plate("sensor", sensor, design.sensor_size, "ink", 0.9, "sensor"),
    ]


def _pencils(design: Design, start: float) -> list[tuple[str, list[Array], tuple[str, float]]]:
    """Rays of the centre, the right edge and a lower corner, through rim and middle of the FAP."""
    camera = Camera.of(design)
    centre, edge, (x, y) = default_fields(design)
    far_corner = (2 * centre[0] - x, 2 * centre[1] - y)
    around = np.linspace(0, 2 * math.pi, 16, endpoint=False)
    # Just inside the rim: a ray on the rim itself would be kept or not by rounding.
    pupil = 0.999 * np.array([[0.0, *np.cos(around)], [0.0, *np.sin(around)]])
    parts: list[tuple[str, list[Array], tuple[str, float]]] = []
    blocked: list[Array] = []
    for name, place, colour in zip(RAYS, (centre, edge, far_corner), FIELDS, strict=False):
        rays = trace_pupil(camera, (pupil[0], pupil[1]), place)
        kept: list[Array] = []
        for status, course in zip(rays.status.tolist(), paths(camera, rays, place, -start), strict=True):
            ended = np.flatnonzero((course != course[-1]).any(axis=1))[-1] + 2
            (kept if status in PASSED else blocked).append(course[:ended])
        if kept:
            parts.append((name, kept, (colour, 2.2)))
    return [*parts, (RAYS[-1], blocked, ("vermillion", 2.2))] if blocked else parts


HOME = Frame((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
"""The scene's own axes."""
TURN = np.linspace(0.0, 2 * math.pi, AROUND, endpoint=False)


def turned(profile: ArrayLike, angles: Array = TURN, frame: Frame = HOME) -> Array:
    """Points of a profile, K radii and heights, turned about a frame's axis: shape (K x angles, 3) [mm]."""
    radius, height = np.asarray(profile, float).T[:, :, None]
    local = np.stack(np.broadcast_arrays(radius * np.cos(angles), radius * np.sin(angles), height), -1)
    return np.asarray(local.reshape(-1, 3) @ np.array([frame.x, frame.y, frame.z]) + np.asarray(frame.origin))


def _placed(points: Array, frame: Frame) -> Array:
    """Points (N, 2) of a frame's own plane, shape (N, 3) [mm]."""
    return np.asarray(points @ np.array([frame.x, frame.y]) + np.asarray(frame.origin))


def _circle(radius: float, height: float, frame: Frame = HOME) -> Array:
    return turned([(radius, height)], np.linspace(0, 2 * math.pi, 97), frame)


def _plate(name: str, frame: Frame, size: tuple[float, float], colour: str, opacity: float, label: str) -> Body:
    corners = 0.5 * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * size
    points = corners @ np.array([frame.x, frame.y]) + np.asarray(frame.origin)
    return Body(name, "plate", points, np.array([4, 0, 1, 2, 3]), colour, opacity, label=label)


def _slab(name: str, frame: Frame, size: tuple[float, float], ends: tuple[float, float]) -> Body:
    """A plate between two planes along its frame's normal [mm]."""
    flat = 0.5 * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * size
    corners = np.concatenate([np.column_stack([flat, np.full(4, z)]) for z in ends])
    points = corners @ np.array([frame.x, frame.y, frame.z]) + np.asarray(frame.origin)
    sides = [(0, 1, 2, 3), (4, 5, 6, 7), *((k, (k + 1) % 4, 4 + (k + 1) % 4, 4 + k) for k in range(4))]
    return Body(name, "plate", points, np.array([[4, *side] for side in sides]).ravel(), "sky", 0.3)


def _lines(name: str, lines: Sequence[Array], colour: str, width: float, label: str = "") -> Body:
    starts = itertools.accumulate(map(len, lines), initial=0)
    cells = [
        np.array([len(line), *range(start, start + len(line))]) for line, start in zip(lines, starts, strict=False)
    ]
    return Body(name, "lines", np.concatenate(lines), np.concatenate(cells), colour, width=width, label=label)


def scene(design: Design, theme: ThemeName = "light") -> BrowserScene:
    """Bore, stops, lens (real: its thin-lens model), array, sensor and rays of three microlenses, for vtk.js."""
    return browser_scene(instrument_scene(design.thin_twin), theme, RAYS)
