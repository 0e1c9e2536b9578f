"""The instrument in 3D as plain lists that vtk.js draws in the browser: nothing is rendered here, so no OpenGL.

The scene is that of the report. Its meshes keep their names from design to design, so that a slider sends only those
which it moves.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..report.meshes import mesh_of
from ..report.scene3d import instrument_scene
from .pictures.theme import Theme, ThemeName, theme_named

if TYPE_CHECKING:
    from ..design import Design

LINE_WIDTH = 0.7
"""Of lines against the report's, whose picture is larger."""
DIGITS = 6
"""Significant digits of a mesh's largest coordinate; the others have as many decimals: finer than any screen."""
RAYS = ("rays centre", "rays edge", "rays corner", "rays blocked")
"""Meshes that may be without rays, and are kept then as empty ones."""


class Mesh(NamedTuple):
    """One part; the lists are as vtk.js takes them."""

    points: list[float]
    """x, y, z of one point after the other [mm]."""
    lines: list[int]
    """Number of corners, then their indices, of one polyline after the other."""
    polys: list[int]
    """The same of polygons."""
    colour: tuple[float, float, float]
    """Red, green, blue from 0 to 1."""
    opacity: float
    width: float
    """Of lines [px]."""


class Scene3D(NamedTuple):
    """Everything that is drawn."""

    meshes: dict[str, Mesh]
    camera: dict[str, Any]
    """Where a viewer starts, as vtk.js takes it, and ``halfWidth``: in a view narrower than that, ``parallelScale``
    (half the height) has to be ``halfWidth`` times height over width [mm]."""
    ground: tuple[float, float, float]
    """Colour behind everything."""


def scene(design: Design, theme: ThemeName = "light") -> Scene3D:
    """Bore, stops, lens, microlens array, sensor and the rays of three microlenses, coloured by field or as blocked.

    Parameters
    ----------
    design : Design
        A real lens is drawn as its thin twin.
    theme : {"light", "dark"}
    """
    colours = theme_named(theme)
    data = instrument_scene(design.thin_twin).data
    found = {part["name"]: _mesh(part, colours) for part in data["parts"]}
    for name in RAYS:
        found.setdefault(name, Mesh([], [], [], _rgb(colours.vermillion), 1.0, 2.0))
    camera, (wide, high) = data["camera"], data["window"]
    start = {
        "position": camera["position"],
        "focalPoint": camera["focus"],
        "centerOfRotation": camera["focus"],
        "viewUp": camera["up"],
        "parallelProjection": True,
        "parallelScale": camera["scale"],
        "halfWidth": camera["scale"] * wide / high,
    }
    return Scene3D(found, start, _rgb(colours.ground))


def changed(before: Mapping[str, Mesh], after: Mapping[str, Mesh]) -> dict[str, Mesh | None]:
    """Meshes of `after` that `before` has not, and None for those that are gone."""
    found: dict[str, Mesh | None] = {name: mesh for name, mesh in after.items() if before.get(name) != mesh}
    found.update({name: None for name in before if name not in after})
    return found


def _mesh(part: Mapping[str, Any], theme: Theme) -> Mesh:
    built = mesh_of(part)
    reach = float(np.max(np.abs(built.points), initial=1e-9))
    points = np.round(built.points, DIGITS - 1 - int(np.floor(np.log10(reach))))
    lines = [number for line in built.lines for number in (len(line), *line.tolist())]
    polys = np.insert(built.faces, 0, built.faces.shape[1], axis=1).ravel().tolist() if built.faces.size else []
    colour = _colour(part, theme)
    return Mesh(
        points.ravel().tolist(),
        lines,
        polys,
        _rgb(colour),
        float(part.get("opacity", 1.0)),
        float(part.get("width", 1.0)),
    )


def _colour(part: Mapping[str, Any], theme: Theme) -> str:
    """The theme's colour for what the report paints for white paper."""
    name: str = part["name"]
    if name.startswith("rays"):
        return dict(zip(RAYS, (*theme.fields, theme.vermillion), strict=True))[name]
    if name.startswith("stop"):
        number = int(name.split()[1])
        return theme.stops[(number - 1) % len(theme.stops)]
    kinds = {"FAP": theme.ink, "lens": theme.blue, "MLA": theme.sky, "sensor": theme.ink, "tube": theme.grey}
    return kinds[name.split()[0]]


def _rgb(colour: str) -> tuple[float, float, float]:
    red, green, blue = (int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5))
    return round(red, 4), round(green, 4), round(blue, 4)
