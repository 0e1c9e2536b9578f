"""The instrument in three dimensions: its parts as geometry, a drawing of them, lists for a browser's vtk.js.

Plain numbers without a graphics library, so nothing here needs OpenGL; `solid` packs and renders.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera
from ..evaluation import default_fields
from ..evaluation.fields import axes_in_space
from ..rays import PASSED, Status, trace_pupil
from .lettering import SMALL, rows_of_names, text_width
from .marks import Area, Line, Mark, Text, line_key, xy
from .panel import Panel, Scale
from .picture import PAGE, Picture, legend_height
from .theme import FIELDS, ThemeName, rgb, stop_colour, theme_named

if TYPE_CHECKING:
    from ..design import Design

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Point3 = tuple[float, float, float]

WIDTH = 1800
"""Of a view [px]."""
YAW, PITCH = math.radians(24), math.radians(16)
"""The view: turned from the side towards the object, and raised."""
AROUND = 72
"""Corners of what is round."""
RINGS = 24
"""Parallels of an ellipsoid from pole to pole."""
RAYS = ("rays centre", "rays edge", "rays corner", "rays blocked")
"""Parts that may be without rays."""
LINE_WIDTH = 0.32
"""Widths of lines in a drawing against those of a view."""
DIGITS = 6
"""Significant digits of a mesh's largest coordinate in a browser; the others have as many decimals."""


class Mesh(NamedTuple):
    """Geometry of one part."""

    points: Floats
    """Shape (N, 3) [mm]."""
    faces: Indices
    """Corners of quadrangles, shape (F, 4); empty for lines."""
    lines: tuple[Indices, ...]
    """Corners of each polyline; empty for surfaces."""
    normals: Floats | None
    """Unit normals at the points, where the surface is to look smooth."""


class Body(NamedTuple):
    """One thing of a scene."""

    name: str
    kind: str
    """"ring", "tube", "ellipsoid", "plate" or "lines"."""
    mesh: Mesh
    colour: str
    """As `theme.Theme.colour` takes it."""
    opacity: float = 1.0
    width: float = 1.0
    """Of lines [px]."""


class Name(NamedTuple):
    """Text to put into the view."""

    text: str
    x: float
    """From the left, as a share of the width."""
    y: float
    """From the bottom, as a share of the height."""
    above: bool
    """Whether it names what is seen there; else it is a remark at the view's foot."""
    at: Point3 = (0.0, 0.0, 0.0)
    """In the scene [mm]."""


class View(NamedTuple):
    """A parallel view."""

    position: tuple[float, ...]
    focus: tuple[float, ...]
    up: tuple[float, ...]
    scale: float
    """Half the height [mm]."""
    window: tuple[int, int]
    """Width and height [px]."""


class Instrument(NamedTuple):
    """A scene, how it is looked at, and where its names go."""

    parts: tuple[Body, ...]
    view: View
    names: tuple[Name, ...]
    """From the left to the right, as the elements stand."""


def instrument_scene(design: Design) -> Instrument:
    """The instrument from in front of the outermost stop to the sensor; the object plane lies beyond the left edge."""
    end = design.d_1 + design.d_2
    front = max(stop.distance for stop in design.all_stops)
    start = -min(front + 0.22 * (front + end), design.d_f)
    rays = _rays(design, start)
    inside = [
        float(np.hypot(p[:, 0], p[:, 1])[p[:, 2] >= -front].max(initial=0.0)) for p in (r.mesh.points for r in rays)
    ]
    # A tube that all elements and rays fit into.
    radii = [design.D / 2 + math.hypot(*design.main_lens.decentre)]
    radii += [stop.diameter / 2 + math.hypot(*stop.decentre) for stop in design.all_stops]
    wall = max(1.08 * max(*radii, math.hypot(*design.microlens_array.size) / 2), 1.02 * max(inside, default=0.0))
    around = np.linspace(0, 2 * math.pi, 24, endpoint=False)
    corners = [(wall * math.cos(t), wall * math.sin(t), z) for z in (-front, end) for t in around]
    view, axes = _view([*corners, (0.0, 0.0, start)])
    tops = [("FAP" if k == 0 else f"stop {k}", -stop.distance, wall) for k, stop in enumerate(design.all_stops)]
    tops += [("main lens", 0.0, wall), ("MLA and sensor", end, wall)]
    tops.append((f"light comes from the object plane, {design.d_f:.4g} mm in front of the lens", start, 0.0))
    names = []
    for text, z, y in sorted(tops, key=lambda top: top[1]):
        right, up, _ = axes @ (np.array([0.0, y, z]) - np.asarray(view.focus)) / view.scale
        across = float(0.5 + 0.5 * right * view.window[1] / WIDTH)
        names.append(Name(text, across, float(0.5 + 0.5 * up), y > 0, (0.0, y, z)))
    return Instrument((*rays, *_elements(design, wall, front)), view, tuple(names))


def _elements(design: Design, wall: float, front: float) -> list[Body]:
    camera = Camera.of(design)
    openings = ("aperture", *(rim.part for rim in camera.rims[1:]))
    sensor, array, lens, *stops = (
        camera.pose(part).seen_from(camera.world) for part in ("sensor", "microlens_array", "main_lens", *openings)
    )
    end = design.d_1 + design.d_2
    parts: list[Body] = []
    for number, (stop, pose) in enumerate(zip(design.all_stops, stops, strict=True)):
        name = f"stop {number}" if number else "FAP"
        colour, radius = stop_colour(number), stop.diameter / 2
        plate = ring(pose.origin, pose.z, radius, wall)
        parts.append(Body(f"{name} plate", "ring", plate, colour, 0.38))
        parts.append(Body(f"{name} rim", "lines", polylines([_circle(pose, radius)]), colour, width=4.0))
    glass = ellipsoid(lens.origin, design.D / 2, 0.09 * design.D)
    mount = ring(lens.origin, lens.z, design.D / 2, wall)
    ends = [_circle(None, wall, z) for z in (-front, end)]
    return [
        *parts,
        Body("lens", "ellipsoid", glass, "sky", 0.35),
        Body("lens rim", "lines", polylines([_circle(lens, design.D / 2)]), "blue", width=3.0),
        Body("lens mount", "ring", mount, "blue", 0.16),
        Body("MLA", "plate", plate_of(array.origin, array.z, design.microlens_array.size), "sky", 0.55),
        Body("sensor", "plate", plate_of(sensor.origin, sensor.z, design.sensor_size), "ink", 0.9),
        Body("tube", "tube", tube(wall, -front, end), "grey", 0.10),
        Body("tube ends", "lines", polylines(ends), "grey", width=1.5),
    ]


def _rays(design: Design, start: float) -> list[Body]:
    """Pencils of the centre, the right edge and a lower corner: rim and middle of the FAP."""
    camera = Camera.of(design)
    centre, edge, (x, y) = default_fields(design)
    far_corner = (2 * centre[0] - x, 2 * centre[1] - y)
    around = np.linspace(0, 2 * math.pi, 16, endpoint=False)
    pupil = np.concatenate([np.zeros((2, 1)), np.stack([np.cos(around), np.sin(around)])], axis=1)
    planes = {int(Status.APERTURE) + k: -stop.distance for k, stop in enumerate(design.all_stops)}
    planes[int(Status.MAIN_LENS)] = 0.0
    end = design.d_1 + design.d_2
    parts: list[Body] = []
    blocked: list[list[Point3]] = []
    for name, place, colour in zip(RAYS, (centre, edge, far_corner), FIELDS, strict=False):
        # Just inside the rim: a ray on the rim itself would be kept or not by rounding.
        rays = trace_pupil(camera, (0.999 * pupil[0], 0.999 * pupil[1]), place)
        (mla,) = axes_in_space(design, [place])
        landing = np.add(np.stack(rays.sensor, -1), design.sensor.decentre)
        kept: list[list[Point3]] = []
        for i, status in enumerate(rays.status):
            stop = planes.get(int(status), end)
            line: list[Point3] = []
            for z in (start, min(stop, 0.0)):
                across, up = (float(v[i]) for v in rays.at(-z))
                line.append((across, up, z))
            if stop > 0:
                line.append((float(mla[0]), float(mla[1]), design.d_1))
                line.append((float(landing[i, 0]), float(landing[i, 1]), end))
            (kept if int(status) in PASSED else blocked).append(line)
        if kept:
            parts.append(Body(name, "lines", polylines(kept), colour, width=2.2))
    if blocked:
        parts.append(Body(RAYS[-1], "lines", polylines(blocked), "vermillion", width=2.2))
    return parts


def _view(corners: Sequence[Point3]) -> tuple[View, Floats]:
    """A parallel view that holds all corners, and its axes: right, up, towards the viewer."""
    toward = np.array([-math.cos(PITCH) * math.cos(YAW), math.sin(PITCH), -math.cos(PITCH) * math.sin(YAW)])
    right = np.cross([0.0, 1.0, 0.0], toward)
    right /= np.hypot(right[0], right[2])
    axes = np.stack([right, np.cross(toward, right), toward])
    seen = np.asarray(corners) @ axes.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    size = high - low
    height = round(min(max(WIDTH * 1.3 * size[1] / size[0], 0.3 * WIDTH), 0.5 * WIDTH))
    # Room above for the names.
    scale = 0.5 * max(1.3 * size[1], 1.04 * size[0] * height / WIDTH)
    focus = ((low + high) / 2 + [0.0, 0.08 * size[1], 0.0]) @ axes
    position = focus + 4 * float(np.max(size)) * toward
    view = View(tuple(position.tolist()), tuple(focus.tolist()), tuple(axes[1].tolist()), float(scale), (WIDTH, height))
    return view, axes


def _circle(pose: Any, radius: float, z: float = 0.0) -> Floats:
    """A closed circle in the plane of a pose, or about the axis at z; shape (97, 3)."""
    t = np.linspace(0, 2 * math.pi, 97)
    local = np.stack([radius * np.cos(t), radius * np.sin(t), np.full_like(t, z)])
    return np.asarray(
        local.T
        if pose is None
        else (np.stack([pose.x, pose.y, pose.z], -1) @ local + np.reshape(pose.origin, (3, 1))).T
    )


def ring(centre: Any, normal: Any, inner: float, outer: float) -> Mesh:
    """A plate with a hole."""
    u, v = across(normal)
    t = _angles()[:, None]
    circle = np.cos(t) * u + np.sin(t) * v
    return Mesh(np.concatenate([inner * circle, outer * circle]) + np.asarray(centre), _bands(2), (), None)


def tube(radius: float, start: float, end: float) -> Mesh:
    """A cylinder about the axis."""
    t = _angles()
    circle = np.stack([np.cos(t), np.sin(t), np.zeros_like(t)], axis=1)
    ends = [radius * circle + [0.0, 0.0, z] for z in (start, end)]
    return Mesh(np.concatenate(ends), _bands(2), (), np.concatenate([circle, circle]))


def ellipsoid(centre: Any, radius: float, thickness: float) -> Mesh:
    """Round about the axis, half as thick as told."""
    t, s = _angles(), np.linspace(0.0, math.pi, RINGS + 1)[:, None]
    z = np.broadcast_to(np.cos(s), (RINGS + 1, AROUND))
    sphere = np.stack([np.sin(s) * np.cos(t), np.sin(s) * np.sin(t), z], axis=-1).reshape(-1, 3)
    size = np.array([radius, radius, thickness])
    normals = sphere / size
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Mesh(sphere * size + np.asarray(centre), _bands(RINGS + 1), (), normals)


def plate_of(centre: Any, normal: Any, size: tuple[float, float]) -> Mesh:
    """A rectangle."""
    u, v = across(normal)
    corners = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    points = [np.asarray(centre) + 0.5 * (i * size[0] * u + j * size[1] * v) for i, j in corners]
    return Mesh(np.array(points), np.array([[0, 1, 2, 3]]), (), None)


def polylines(lines: Sequence[Any]) -> Mesh:
    """Lines, each a sequence of points."""
    starts = np.cumsum([0, *(len(line) for line in lines)])
    corners = tuple(np.arange(a, b) for a, b in itertools.pairwise(starts.tolist()))
    points = np.concatenate([np.asarray(line, float) for line in lines])
    return Mesh(points, np.empty((0, 4), np.int64), corners, None)


def across(normal: Any) -> tuple[Floats, Floats]:
    """Two unit vectors that span the plane of a normal, the first as near to x as can be."""
    n = np.asarray(normal, float) / np.linalg.norm(normal)
    u = np.array([1.0, 0.0, 0.0]) - n[0] * n
    if np.linalg.norm(u) < 1e-6:
        u = np.array([0.0, 1.0, 0.0]) - n[1] * n
    u /= np.linalg.norm(u)
    return u, np.cross(n, u)


def _angles() -> Floats:
    return np.linspace(0.0, 2 * math.pi, AROUND, endpoint=False)


def _bands(rows: int) -> Indices:
    """Quadrangles between neighbouring rows of points, closed around."""
    row, place = np.meshgrid(np.arange(rows - 1), np.arange(AROUND), indexing="ij")
    here, beside = row * AROUND + place, row * AROUND + (place + 1) % AROUND
    return np.stack([here, beside, beside + AROUND, here + AROUND], axis=-1).reshape(-1, 4)


def outlines(scene: Instrument, width: float = PAGE) -> Picture:
    """Draw a scene in its own view, what is farther first; `width` in px."""
    view = scene.view
    height = width * view.window[1] / view.window[0]
    away = np.subtract(view.focus, view.position)
    away = away / np.linalg.norm(away)
    axes = np.stack([np.cross(away, view.up), view.up])
    drawn: list[tuple[float, Mark]] = []
    for part in scene.parts:
        points = part.mesh.points - view.focus
        flat = np.array([width / 2, height / 2]) + 0.5 * height / view.scale * points @ axes.T
        depth = float(np.mean(points @ away))
        if part.mesh.lines:
            corners = np.concatenate([np.append(flat[line], [[np.nan, np.nan]], axis=0) for line in part.mesh.lines])
            drawn.append((depth, Line(*xy(corners), part.colour, LINE_WIDTH * part.width * width / 576)))
            continue
        loops = [flat[:AROUND], flat[AROUND:][::-1]] if part.kind == "ring" else [outline(flat)]
        gap = np.full((1, 2), np.nan)
        corners = np.concatenate([piece for loop in loops for piece in (loop, gap)][:-1])
        drawn.append((depth, Area(*xy(corners), part.colour, part.opacity)))
    marks = [mark for _, mark in sorted(drawn, key=lambda one: -one[0])]
    shown = [name for name in scene.names if name.above]
    widths = [text_width(name.text, SMALL) for name in shown]
    places = [
        min(max(name.x * width, wide / 2 + 2), width - wide / 2 - 2) for name, wide in zip(shown, widths, strict=True)
    ]
    rows = rows_of_names(places, widths, 4.0)
    for name, x, row in zip(shown, places, rows, strict=True):
        top, level = name.y * height, name.y * height + 12 + 16 * row
        marks += [
            Line([name.x * width] * 2, [top, level], "grey", 0.8),
            Text(x, level, name.text, anchor="middle", dy=-3),
        ]
    marks += [Text(4.0, 6.0, name.text, "grey") for name in scene.names if not name.above]
    keys = [line_key(label, hue, 2.0) for label, hue in
            zip(("centre", "edge", "corner", "blocked"), (*FIELDS, "vermillion"), strict=True)]  # fmt: skip
    # Names in several rows may stand above the view.
    head = max([0.0, *(mark.y + 14 - height for mark in marks if isinstance(mark, Text))])
    panel = Panel((0.0, head, width, height), Scale(0, width), Scale(0, height), tuple(marks), bare=True)
    size = (width, head + height + legend_height(keys, width - 24) + 6)
    return Picture(
        "view", "The instrument in three dimensions", size, (panel,), tuple(keys), (14.0, head + height + 3, width - 24)
    )


def outline(points: Floats) -> Floats:
    """Corners of the convex hull of points in a plane, shape (M, 2), counter-clockwise."""
    ordered = sorted({(float(x), float(y)) for x, y in points})
    halves = []
    for direction in (ordered, ordered[::-1]):
        half: list[tuple[float, float]] = []
        for c in direction:
            # Until the last two and the new one turn left.
            while len(half) > 1:
                a, b = half[-2:]
                if (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) > 0:
                    break
                half.pop()
            half.append(c)
        halves.append(half[:-1])
    return np.array(halves[0] + halves[1])


class BrowserMesh(NamedTuple):
    """One part; the lists are as vtk.js takes them."""

    points: list[float]
    """x, y, z of one point after the other [mm]."""
    lines: list[int]
    """Number of corners, then their indices, of one polyline after the other."""
    polys: list[int]
    """The same of polygons."""
    colour: Point3
    """Red, green, blue from 0 to 1."""
    opacity: float
    width: float
    """Of lines [px]."""


class BrowserScene(NamedTuple):
    """Everything that a browser draws."""

    meshes: dict[str, BrowserMesh]
    """Their names are the same from design to design, so that a slider sends only those which it moves."""
    camera: dict[str, Any]
    """Where a viewer starts, as vtk.js takes it, and ``halfWidth``: in a view narrower than that, ``parallelScale``
    (half the height) has to be ``halfWidth`` times height over width [mm]."""
    ground: Point3
    """Colour behind everything."""


def scene(design: Design, theme: ThemeName = "light") -> BrowserScene:
    """Bore, stops, lens, microlens array, sensor and the rays of three microlenses, as plain lists for vtk.js.

    Parameters
    ----------
    design : Design
        A real lens is drawn as its thin twin.
    theme : {"light", "dark"}
    """
    colours = theme_named(theme)

    def unit(name: str) -> Point3:
        red, green, blue = (round(part / 255, 4) for part in rgb(colours.colour(name)))
        return red, green, blue

    parts, view, _ = instrument_scene(design.thin_twin)
    meshes = {}
    for part in parts:
        reach = float(np.max(np.abs(part.mesh.points), initial=1e-9))
        points = np.round(part.mesh.points, DIGITS - 1 - int(np.floor(np.log10(reach)))).ravel().tolist()
        lines = [number for line in part.mesh.lines for number in (len(line), *line.tolist())]
        polys = np.insert(part.mesh.faces, 0, 4, axis=1).ravel().tolist() if part.mesh.faces.size else []
        meshes[part.name] = BrowserMesh(points, lines, polys, unit(part.colour), part.opacity, part.width)
    for name in RAYS:
        meshes.setdefault(name, BrowserMesh([], [], [], unit("vermillion"), 1.0, 2.0))
    start = {
        "position": list(view.position),
        "focalPoint": list(view.focus),
        "centerOfRotation": list(view.focus),
        "viewUp": list(view.up),
        "parallelProjection": True,
        "parallelScale": view.scale,
        "halfWidth": view.scale * view.window[0] / view.window[1],
    }
    return BrowserScene(meshes, start, unit("ground"))


def changed(before: Mapping[str, BrowserMesh], after: Mapping[str, BrowserMesh]) -> dict[str, BrowserMesh | None]:
    """Meshes of `after` that `before` has not, and None for those that are gone."""
    meshes: dict[str, BrowserMesh | None] = {name: mesh for name, mesh in after.items() if before.get(name) != mesh}
    return meshes | {name: None for name in before if name not in after}
