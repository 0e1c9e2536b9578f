"""The instrument in three dimensions: bore, lens, microlens array, sensor and ray fans, as a scene to be drawn."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera
from ..evaluation import default_fields
from ..evaluation.rims import axes_in_space
from ..rays import PASSED, Status, trace_pupil
from .figures.style import BLOCKED, FIELD_COLOURS, INK, LENS_COLOUR, SKY, STOP_COLOURS

if TYPE_CHECKING:
    from ..design import Design

Floats = NDArray[np.float64]
Point = tuple[float, float, float]

WIDTH = 1800
"""Pixels."""
YAW, PITCH = math.radians(24), math.radians(16)
"""The view: turned from the side towards the object, and raised."""


class Name(NamedTuple):
    """Text to put into the picture."""

    text: str
    x: float
    """From the left, as a share of the width."""
    y: float
    """From the bottom, as a share of the height."""
    above: bool
    """Whether it names what is seen there; else it is a remark at the picture's foot."""
    at: Point = (0.0, 0.0, 0.0)
    """In the scene [mm]."""


class Scene(NamedTuple):
    """A scene, and where its names go."""

    data: dict[str, Any]
    """``window`` [width, height] in pixels; ``camera`` with ``position``, ``focus``, ``up`` and ``scale`` (half the
    height of the view); ``parts``, each with a ``name``, a ``kind`` of `meshes.MAKERS` with its numbers, a ``colour``
    and an ``opacity``. Lengths in mm."""
    names: tuple[Name, ...]
    """From the left to the right, as the elements stand."""


def instrument_scene(design: Design) -> Scene:
    """The instrument from in front of the outermost stop to the sensor; the object plane lies beyond the left edge."""
    end = design.d_1 + design.d_2
    front = max(stop.distance for stop in design.all_stops)
    start = -min(front + 0.22 * (front + end), design.d_f)
    rays = _rays(design, start)
    inside = [math.hypot(x, y) for part in rays for line in part["lines"] for x, y, z in line if z >= -front]
    wall = max(_wall(design), 1.02 * max(inside, default=0.0))
    parts: list[dict[str, Any]] = [*rays, *_elements(design, wall, front)]
    around = np.linspace(0, 2 * math.pi, 24, endpoint=False)
    corners = [(wall * math.cos(t), wall * math.sin(t), z) for z in (-front, end) for t in around]
    corners += [(0.0, 0.0, start)]
    camera, axes, height = _camera(corners)
    names = _names(design, wall, start, camera, axes, height)
    return Scene({"window": [WIDTH, height], "camera": camera, "parts": parts}, names)


def _wall(design: Design) -> float:
    """Radius of a tube that all elements fit into [mm]."""
    radii = [design.D / 2 + math.hypot(*design.main_lens.decentre)]
    radii += [stop.diameter / 2 + math.hypot(*stop.decentre) for stop in design.all_stops]
    return 1.08 * max(*radii, math.hypot(*design.microlens_array.size) / 2)


def _elements(design: Design, wall: float, front: float) -> list[dict[str, Any]]:
    camera = Camera.of(design)
    openings = ("aperture", *(rim.part for rim in camera.rims[1:]))
    sensor, array, lens, *stops = (
        camera.pose(part).seen_from(camera.world) for part in ("sensor", "microlens_array", "main_lens", *openings)
    )
    parts: list[dict[str, Any]] = []
    for index, (stop, pose) in enumerate(zip(design.all_stops, stops, strict=True)):
        colour = "#4d4d4d" if index == 0 else STOP_COLOURS[(index - 1) % len(STOP_COLOURS)]
        ring = {"inner": stop.diameter / 2, "outer": wall, "centre": _vertex(pose), "normal": _normal(pose)}
        name = f"stop {index}" if index else "FAP"
        parts.append({"name": f"{name} plate", "kind": "ring", **ring, "colour": colour, "opacity": 0.38})
        rim = [_circle(pose, stop.diameter / 2)]
        parts.append({"name": f"{name} rim", "kind": "lines", "lines": rim, "colour": colour, "width": 4.0})
    thickness = 0.09 * design.D
    parts.append(
        {"name": "lens", "kind": "ellipsoid", "centre": _vertex(lens), "radius": design.D / 2, "thickness": thickness,
         "colour": SKY, "opacity": 0.35}
    )  # fmt: skip
    rim = [_circle(lens, design.D / 2)]
    parts.append({"name": "lens rim", "kind": "lines", "lines": rim, "colour": LENS_COLOUR, "width": 3.0})
    mount = {"inner": design.D / 2, "outer": wall, "centre": _vertex(lens), "normal": _normal(lens)}
    parts.append({"name": "lens mount", "kind": "ring", **mount, "colour": LENS_COLOUR, "opacity": 0.16})
    width, height = design.sensor_size
    for name, pose, size, colour, opacity in (
        ("MLA", array, design.microlens_array.size, SKY, 0.55),
        ("sensor", sensor, (width, height), INK, 0.9),
    ):
        parts.append(
            {"name": name, "kind": "plate", "centre": _vertex(pose), "normal": _normal(pose), "size": list(size),
             "colour": colour, "opacity": opacity}
        )  # fmt: skip
    tube = {"centre": [0.0, 0.0, 0.0], "from": -front, "to": design.d_1 + design.d_2, "radius": wall}
    parts.append({"name": "tube", "kind": "tube", **tube, "colour": "#9a9a9a", "opacity": 0.10})
    rims = [[[wall * math.cos(t), wall * math.sin(t), z] for t in np.linspace(0, 2 * math.pi, 97)]
            for z in (-front, design.d_1 + design.d_2)]  # fmt: skip
    parts.append({"name": "tube ends", "kind": "lines", "lines": rims, "colour": "#8a8a8a", "width": 1.5})
    return parts


def _rays(design: Design, start: float) -> list[dict[str, Any]]:
    """Pencils of the centre, the right edge and a lower corner: circle and middle of the FAP."""
    camera = Camera.of(design)
    centre, edge, (x, y) = default_fields(design)
    far_corner = (2 * centre[0] - x, 2 * centre[1] - y)
    around = np.linspace(0, 2 * math.pi, 16, endpoint=False)
    pupil = np.concatenate([np.zeros((2, 1)), np.stack([np.cos(around), np.sin(around)])], axis=1)
    planes = {int(Status.APERTURE) + k: -stop.distance for k, stop in enumerate(design.all_stops)}
    planes[int(Status.MAIN_LENS)] = 0.0
    end = design.d_1 + design.d_2
    parts: list[dict[str, Any]] = []
    blocked: list[list[list[float]]] = []
    places = {"centre": centre, "edge": edge, "corner": far_corner}
    for (name, place), colour in zip(places.items(), FIELD_COLOURS, strict=True):
        # Just inside the rim: a ray on the rim itself would be kept or not by rounding.
        rays = trace_pupil(camera, (0.999 * pupil[0], 0.999 * pupil[1]), place)
        (mla,) = axes_in_space(design, [place])
        landing = np.add(np.stack(rays.sensor, -1), design.sensor.decentre)
        kept: list[list[list[float]]] = []
        for i, status in enumerate(rays.status):
            stop = planes.get(int(status), end)
            zs = [start, min(stop, 0.0)]
            line = [[*(float(v[i]) for v in rays.at(-z)), z] for z in zs]
            if stop > 0:
                line += [[float(mla[0]), float(mla[1]), design.d_1], [float(landing[i, 0]), float(landing[i, 1]), end]]
            (kept if status in PASSED else blocked).append(line)
        if kept:
            parts.append({"name": f"rays {name}", "kind": "lines", "lines": kept, "colour": colour, "width": 2.2})
    if blocked:
        parts.append({"name": "rays blocked", "kind": "lines", "lines": blocked, "colour": BLOCKED, "width": 2.2})
    return parts


def _camera(corners: list[Point]) -> tuple[dict[str, Any], Floats, int]:
    """A parallel view that holds all corners; its axes (right, up, towards the viewer); the picture's height."""
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
    middle = (low + high) / 2 + [0.0, 0.08 * size[1], 0.0]
    focus = middle @ axes
    position = focus + 4 * float(np.max(size)) * toward
    camera = {"position": position.tolist(), "focus": focus.tolist(), "up": axes[1].tolist(), "scale": float(scale)}
    return camera, axes, height


def _names(
    design: Design, wall: float, start: float, camera: dict[str, Any], axes: Floats, height: int
) -> tuple[Name, ...]:
    """Names of what is seen, each with the place of its element's top."""
    tops = [("FAP" if k == 0 else f"stop {k}", -stop.distance, wall) for k, stop in enumerate(design.all_stops)]
    tops += [("main lens", 0.0, wall), ("MLA and sensor", design.d_1 + design.d_2, wall)]
    tops.append((f"light comes from the object plane, {design.d_f:.4g} mm in front of the lens", start, 0.0))
    found = []
    for text, z, y in sorted(tops, key=lambda top: top[1]):
        right, up, _ = axes @ (np.array([0.0, y, z]) - np.asarray(camera["focus"]))
        reach = camera["scale"]
        across, over = float(0.5 + 0.5 * right / reach * height / WIDTH), float(0.5 + 0.5 * up / reach)
        found.append(Name(text, across, over, y > 0, (0.0, y, z)))
    return tuple(found)


def _vertex(pose: Any) -> list[float]:
    return [float(value) for value in pose.origin]


def _normal(pose: Any) -> list[float]:
    return [float(value) for value in pose.z]


def _circle(pose: Any, radius: float) -> list[list[float]]:
    t = np.linspace(0, 2 * math.pi, 97)
    local = np.stack([radius * np.cos(t), radius * np.sin(t), np.zeros_like(t)])
    points: list[list[float]] = (
        np.stack([pose.x, pose.y, pose.z], -1) @ local + np.array(_vertex(pose))[:, None]
    ).T.tolist()
    return points
