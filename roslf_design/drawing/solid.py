"""Bodies in three dimensions: as a drawing, for a browser's vtk.js, as a PyVista model, as PNG.

Bodies, drawing and what browsers get are plain numbers, without a graphics library. Pages of reports carry the scene
in vtk.js' own format, with the viewer page that comes with trame-vtk (BSD-3-Clause, Kitware). Building a PyVista model
is safe without OpenGL; drawing one is not: VTK without a working OpenGL does not raise, it ends the process. So a child
process draws.
"""

from __future__ import annotations

import base64
import ctypes
import gzip
import hashlib
import io
import json
import math
import os
import pickle
import re
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._arrays import Array
from .marks import Area, Line, Mark, Text, box_key, joined, line_key, xy
from .panel import Panel, Scale
from .picture import PAGE, Picture, legend_height
from .theme import SMALL, THEMES, ThemeName, rgb, text_width, theme_named

if TYPE_CHECKING:
    from pyvista import PolyData

Point3 = tuple[float, float, float]

WIDTH = 1800
"""Width of a view [px]."""
YAW, PITCH = math.radians(24), math.radians(16)
"""The view: turned from the side towards the object, and raised."""
AROUND = 72
"""Corners of what is round."""
EDGE_ON = 0.5
"""Width of a plate seen from its edge, below which it is drawn as a line [px]."""
LINE_WIDTH = 0.32
"""Widths of lines in a drawing against those of a view."""
DIGITS = 6
"""Significant digits of a part's largest coordinate in a browser; the others have as many decimals."""
LOAD = "console.log=()=>{};function loadDataSet(){OfflineLocalView.load(document.body,{base64Str:frameElement.scene});}"
"""Script that the viewer page runs first."""
SYSTEM, UNKNOWN_SYSTEM = 9, 255
"""Where gzip says on what system it ran, which hangs on Python's version, and what says nothing (RFC 1952)."""
VIEWER = "trame_vtk", "tools/static_viewer.html"
"""A package and its page that shows scenes."""
DEBIAN = "libegl1 libgl1-mesa-dri"
"""Packages with which off-screen 3D works on a machine without a display."""
TIMEOUT = 25.0
"""Seconds after which a picture is given up."""
CHILD = ("-m", "roslf_design.drawing.solid")
"""Arguments of the interpreter for the child process."""
WINDOWS = {"egl": "vtkEGLRenderWindow", "osmesa": "vtkOSOpenGLRenderWindow"}
"""VTK's own name for each way to draw without a display."""


class NoViewerError(Exception):
    """Why a scene cannot be turned; the message says what to install."""


class NoPictureError(Exception):
    """A 3D picture that cannot be made here; the message says why and what helps."""


class Body(NamedTuple):
    """Part of a scene in three dimensions."""

    name: str
    kind: str
    """"ring", "round" (a surface that looks smooth), "plate" or "lines"."""
    points: Array
    """Shape (N, 3) [mm]."""
    cells: NDArray[np.int64]
    """Number of corners, then their indices, of one polygon or polyline after the other."""
    colour: str
    """Colour as `theme.Theme.colour` takes it."""
    opacity: float = 1.0
    width: float = 1.0
    """Width of lines [px]."""
    label: str = ""
    """Name of its colour in a legend; empty where it has none."""


class Name(NamedTuple):
    """Text to put into the view."""

    text: str
    at: Point3
    """In the scene [mm]."""
    foot: bool = False
    """Whether it is a remark at the view's foot."""


class _View(NamedTuple):
    """A parallel view."""

    focus: Array
    """[mm]."""
    distance: float
    """Distance of the camera from there [mm]."""
    axes: Array
    """To the right, upwards and towards the viewer, shape (3, 3)."""
    scale: float
    """Half the height [mm]."""
    window: tuple[int, int]
    """Width and height [px]."""

    @property
    def camera(self) -> dict[str, Any]:
        """Camera as vtk.js takes it."""
        return {
            "position": (self.focus + self.distance * self.axes[2]).tolist(),
            "focalPoint": self.focus.tolist(),
            "viewUp": self.axes[1].tolist(),
            "parallelProjection": True,
            "parallelScale": self.scale,
        }


class Instrument(NamedTuple):
    """A scene, how it is looked at, and where its names go."""

    parts: tuple[Body, ...]
    view: _View
    names: tuple[Name, ...]
    """From the left to the right, as the elements stand."""


def slanted() -> Array:
    """Axes of a view turned from the side towards the object, and raised, as `_View` has them."""
    toward = np.array([-math.cos(PITCH) * math.cos(YAW), math.sin(PITCH), -math.cos(PITCH) * math.sin(YAW)])
    right = np.cross([0.0, 1.0, 0.0], toward)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(toward, right), toward])


def view_of(corners: Array, axes: Array) -> _View:
    """A parallel view along given axes that holds all corners."""
    turned_corners = corners @ axes.T
    low, high = turned_corners.min(axis=0), turned_corners.max(axis=0)
    size = high - low
    height = round(min(max(WIDTH * 1.3 * size[1] / size[0], 0.3 * WIDTH), 0.5 * WIDTH))
    # Room above for the names.
    scale = 0.5 * max(1.3 * size[1], 1.04 * size[0] * height / WIDTH)
    focus = ((low + high) / 2 + [0.0, 0.08 * size[1], 0.0]) @ axes
    return _View(focus, 4 * float(np.max(size)), axes, float(scale), (WIDTH, height))


def bands(rows: int) -> NDArray[np.int64]:
    """Quadrangles between neighbouring rows of turned points."""
    row, place = np.meshgrid(np.arange(rows - 1), np.arange(AROUND), indexing="ij")
    here, beside = row * AROUND + place, row * AROUND + (place + 1) % AROUND
    return np.stack([np.full_like(here, 4), here, beside, beside + AROUND, here + AROUND], axis=-1).ravel()


def outlines(scene: Instrument, width: float = PAGE, title: float = 0.0) -> Picture:
    """Draw a scene in its own view, what is farther first; `width` and the room left above for a `title` in px."""
    view = scene.view
    height = width * view.window[1] / view.window[0]

    def projected(points: ArrayLike) -> tuple[Array, Array]:
        """Places in the picture [px], and how near the viewer they are [mm]."""
        turned = np.subtract(points, view.focus) @ view.axes.T
        return np.array([width / 2, height / 2]) + 0.5 * height / view.scale * turned[:, :2], turned[:, 2]

    drawn: list[tuple[float, Mark]] = []
    for part in scene.parts:
        flat, near = projected(part.points)
        if part.kind == "lines":
            loops = [flat[line] for line in _split(part.cells)]
        else:
            loops = [flat[:AROUND], flat[AROUND:][::-1]] if part.kind == "ring" else [outline(flat)]
        x, y = xy(joined(loops))
        line = Line(x, y, part.colour, LINE_WIDTH * part.width * width / 576)
        along = np.linalg.svd(flat - flat.mean(axis=0), full_matrices=False)[2]
        if part.kind in ("plate", "ring") and np.ptp(flat @ along[1]) < EDGE_ON:
            # A ring's inner rim is left open.
            ends = [loop[np.argsort(loop @ along[0])[[0, -1]]] for loop in loops]
            pieces = [*zip(*ends, strict=True)] if part.kind == "ring" else ends
            line = Line(*xy(joined([np.array(piece) for piece in pieces])), part.colour, 2.4)
            drawn.append((float(near.mean()), line))
            continue
        drawn.append((float(near.mean()), line if part.kind == "lines" else Area(x, y, part.colour, part.opacity)))
    marks = [mark for _, mark in sorted(drawn, key=lambda one: one[0])]
    above = [name for name in scene.names if not name.foot]
    tops, _ = projected([name.at for name in above])
    widths = [text_width(name.text, SMALL) for name in above]
    places = [min(max(x, w / 2 + 2), width - w / 2 - 2) for x, w in zip(tops[:, 0].tolist(), widths, strict=True)]
    levels: list[float] = []
    for place, w, y in zip(
        places, widths, tops[:, 1].tolist(), strict=True
    ):  # parts of a folded axis lie at any height
        level, near = y + 12, (abs(place - np.array(places)) < (w + np.array(widths)) / 2 + 4)[: len(levels)]
        for other in np.sort(np.array(levels)[near]).tolist():
            level = other + 16 if abs(other - level) < 16 else level
        levels.append(level)
    marks += [Line([x, x], [y, level], "grey", 0.8) for (x, y), level in zip(tops, levels, strict=True)]
    for name, place, level in zip(above, places, levels, strict=True):
        marks.append(Text(place, level, name.text, anchor="middle", dy=-3, halo=True))
    # Names in several rows may stand above the view.
    head = max([0.0, *(level + 14 + title - height for level in levels)])
    marks += [Text(4.0, 6.0, name.text, "grey") for name in scene.names if name.foot]
    named = {part.label: part for part in reversed(scene.parts) if part.label}
    keys = [
        line_key(label, part.colour, 2.0)
        if part.kind == "lines"
        else box_key(label, part.colour, min(2 * part.opacity, 1.0))  # small, it has to be strong to be told apart
        for label, part in reversed(named.items())
    ]
    panel = Panel((0.0, head, width, height), Scale(0, width), Scale(0, height), tuple(marks), bare=True)
    size = (width, head + height + legend_height(keys, width - 24) + 6)
    key_box = (14.0, head + height + 3, width - 24)
    return Picture("view", "The instrument in three dimensions", size, (panel,), tuple(keys), key_box)


def _split(cells: NDArray[np.int64]) -> Iterator[NDArray[np.int64]]:
    """Indices of each cell."""
    while len(cells):
        yield cells[1 : 1 + cells[0]]
        cells = cells[1 + cells[0] :]


def outline(points: Array) -> Array:
    """Corners of the convex hull of points in a plane, shape (M, 2), counter-clockwise."""
    halves = []
    rising = points[np.lexsort(points.T[::-1])].tolist()
    for some in (rising, rising[::-1]):
        half: list[list[float]] = []
        for x, y in some:
            while len(half) > 1:
                (a, b), (c, d) = half[-2:]
                if (c - a) * (y - b) - (d - b) * (x - a) > 0:
                    break
                half.pop()
            half.append([x, y])
        halves += half[:-1]
    return np.array(halves)


class BrowserMesh(NamedTuple):
    """Mesh of one part; the lists are as vtk.js takes them."""

    points: list[float]
    """x, y, z of one point after the other [mm]."""
    lines: list[int]
    """Number of corners, then their indices, of one polyline after the other."""
    polys: list[int]
    """Polygons, in the same form."""
    colour: Point3
    """Red, green, blue from 0 to 1."""
    opacity: float
    width: float
    """Width of lines [px]."""
    label: str = ""
    """Name of its colour in a legend; empty where it has none, or is not drawn."""


class BrowserScene(NamedTuple):
    """Everything that a browser draws."""

    meshes: dict[str, BrowserMesh]
    """Their names are the same from design to design, so that a slider sends only those which it moves."""
    camera: dict[str, Any]
    """Where a viewer starts, as vtk.js takes it, and ``halfWidth``: in a view narrower than that, ``parallelScale``
    (half the height) has to be ``halfWidth`` times height over width [mm]."""
    ground: Point3
    """Colour behind everything."""


def browser_scene(scene: Instrument, theme: ThemeName, names: Iterable[str]) -> BrowserScene:
    """A scene for vtk.js; `names` are of parts that are there even where they are empty."""
    colours = theme_named(theme)

    def unit(name: str) -> Point3:
        red, green, blue = (round(part / 255, 4) for part in rgb(colours.colour(name)))
        return red, green, blue

    meshes = {}
    for part in scene.parts:
        reach = float(np.max(np.abs(part.points), initial=1e-9))
        points = np.round(part.points, DIGITS - 1 - int(np.floor(np.log10(reach)))).ravel().tolist()
        lines, polys = (part.cells.tolist(), []) if part.kind == "lines" else ([], part.cells.tolist())
        meshes[part.name] = BrowserMesh(points, lines, polys, unit(part.colour), part.opacity, part.width, part.label)
    for name in names:
        meshes.setdefault(name, BrowserMesh([], [], [], unit("vermillion"), 1.0, 2.0))
    view = scene.view
    half_width = view.scale * view.window[0] / view.window[1]
    start = view.camera | {"centerOfRotation": view.focus.tolist(), "halfWidth": half_width}
    return BrowserScene(meshes, start, unit("ground"))


def changed(before: Mapping[str, BrowserMesh], after: Mapping[str, BrowserMesh]) -> dict[str, BrowserMesh | None]:
    """Meshes of `after` that `before` has not, and None for those that are gone."""
    meshes: dict[str, BrowserMesh | None] = {name: mesh for name, mesh in after.items() if before.get(name) != mesh}
    return meshes | {name: None for name in before if name not in after}


@cache
def viewer() -> str:
    """The page in which vtk.js turns the ``scene`` of the frame that holds it.

    Raises
    ------
    NoViewerError
        trame-vtk is not installed, or without its viewer.
    """
    spec = find_spec(VIEWER[0])
    places = [] if spec is None else [Path(place) / VIEWER[1] for place in spec.submodule_search_locations or ()]
    page = next((place for place in places if place.is_file()), None)
    if page is None:
        raise NoViewerError("the trame-vtk package is not installed: pip install trame-vtk")
    text = page.read_text(encoding="utf-8")
    # The picture of its file-drop area, which is never shown here, and a link that would leave the page.
    text = re.sub(r"data:image/jpeg;base64,[A-Za-z0-9+/=]+", "data:,", text)
    text = text.replace("https://kitware.github.io/vtk-js/icon/favicon-", "data:,")
    return text.replace("<script>", f"<script>{LOAD}</script><script>", 1)


@cache
def library() -> str:
    """The viewer page: gzip, as base64; errors as `viewer`."""
    packed = bytearray(gzip.compress(viewer().encode(), 9, mtime=0))
    packed[SYSTEM] = UNKNOWN_SYSTEM
    return base64.b64encode(packed).decode()


def scene_data(scene: Instrument) -> str:
    """A scene as JSON: ``data`` (a vtk.js scene, zipped, base64), ``camera`` and ``names`` with their places [mm]."""
    first = scene.view.camera
    camera = {
        "position": first["position"],
        "focus": first["focalPoint"],
        "up": first["viewUp"],
        "scale": scene.view.scale,
    }
    names = [{"text": name.text, "at": name.at} for name in scene.names if not name.foot]
    text = json.dumps({"data": packed(scene.parts, scene.view), "camera": camera, "names": names})
    return text.replace("<", "\\u003c")  # no end tag inside the page's script element


def packed(parts: Sequence[Body], view: _View) -> str:
    """Parts and a view as vtk.js reads them: a zipped index.json, as base64; the same parts give the same text."""
    arrays: dict[str, Any] = {}
    # Depths between which all points lie, as the camera counts them.
    depths = view.distance - np.concatenate([(part.points - view.focus) @ view.axes[2] for part in parts])
    room = 0.1 * float(np.ptp(depths))
    look = view.camera | {"clippingRange": [float(depths.min()) - room, float(depths.max()) + room]}
    children = [("setActiveCamera", _object("camera", "vtkCamera", look))]
    children += [("addViewProp", _actor(f"part-{number}", part, arrays)) for number, part in enumerate(parts)]
    for name, kind, intensity, position in (
        ("headlight", "HeadLight", 0.55, [0.0, 0.0, 1.0]), ("key", "CameraLight", 0.45, [0.4, 0.8, 0.5]),
    ):  # fmt: skip
        look = {"switch": 1, "intensity": intensity, "color": [1.0, 1.0, 1.0], "lightType": kind, "positional": 0}
        look |= {"position": position, "focalPoint": [0.0, 0.0, 0.0]}
        children.append(("addLight", _object(name, "vtkLight", look)))
    look = {"background": [1.0, 1.0, 1.0], "twoSidedLighting": 1, "lightFollowCamera": 1, "layer": 0, "interactive": 1}
    renderer = _object("renderer", "vtkRenderer", look, *children)
    window = _object("window", "vtkRenderWindow", {"numberOfLayers": 1}, ("addRenderer", renderer))
    index = json.dumps({"scene": window | {"mtime": 1, "extra": {"camera": "camera"}}, "hashes": arrays})
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr(zipfile.ZipInfo("index.json"), index, zipfile.ZIP_DEFLATED, 9)
    return base64.b64encode(stream.getvalue()).decode()


def _actor(own: str, part: Body, arrays: dict[str, Any]) -> dict[str, Any]:
    def array(values: NDArray[Any], kind: str, components: int) -> dict[str, Any]:
        content = values.tobytes()
        name = hashlib.sha256(content).hexdigest()[:16]
        type_ = "Float32Array" if values.dtype.kind == "f" else "Int32Array"
        entry = {"hash": name, "vtkClass": kind, "dataType": type_, "numberOfComponents": components}
        arrays[name] = entry | {"size": values.size, "content": base64.b64encode(content).decode()}
        return entry | {"size": values.size}

    lines = part.kind == "lines"
    geometry: dict[str, Any] = {"points": array(part.points.astype(np.float32), "vtkPoints", 3), "fields": []}
    geometry["lines" if lines else "polys"] = array(part.cells.astype(np.int32), "vtkCellArray", 1)
    if part.kind == "round":
        place = {"name": "Normals", "location": "pointData", "registration": "setNormals"}
        geometry["fields"].append(array(_normals(part).astype(np.float32), "vtkDataArray", 3) | place)
    colour = [channel / 255 for channel in _rgb(part)]
    look: dict[str, Any] = dict.fromkeys(("color", "diffuseColor", "ambientColor"), colour)
    look |= {"opacity": part.opacity, "lighting": 0 if lines else 1, "representation": 2, "lineWidth": part.width}
    look |= {"interpolation": 1, "ambient": 0.45, "diffuse": 0.6}
    shape = _object(f"{own}-geometry", "vtkPolyData", geometry)
    mapper = _object(f"{own}-mapper", "vtkMapper", {"scalarVisibility": 0}, ("setInputData", shape))
    surface = _object(f"{own}-look", "vtkProperty", look)
    visible = {"visibility": 1, "pickable": 0}
    return _object(own, "vtkActor", visible, ("setMapper", mapper), ("setProperty", surface))


def _normals(part: Body) -> Array:
    """Unit normals of a surface of quadrangles at its points, between those of the faces around."""
    corners = part.cells.reshape(-1, 5)[:, 1:]
    a, b, c, d = (part.points[corners[:, k]] for k in range(4))
    normals = np.zeros_like(part.points)
    np.add.at(normals, corners.ravel(), np.repeat(np.cross(c - a, d - b), 4, axis=0))
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.asarray(np.divide(normals, lengths, out=normals, where=lengths > 0))  # none where faces are but a line


def _object(
    name: str, kind: str, properties: Mapping[str, Any], *children: tuple[str, dict[str, Any]]
) -> dict[str, Any]:
    """One of vtk.js' objects, and by which calls it takes others."""
    calls = [[call, [f"instance:${{{child['id']}}}"]] for call, child in children]
    own = {"parent": "0x0", "id": name, "type": kind, "properties": dict(properties), "calls": calls}
    return own | {"dependencies": [child | {"parent": name} for _, child in children]}


def _rgb(part: Body) -> tuple[int, int, int]:
    return rgb(THEMES["light"].colour(part.colour))


def _poly_data(part: Body) -> PolyData:
    import pyvista

    faces, lines = (None, part.cells) if part.kind == "lines" else (part.cells, None)
    data = pyvista.PolyData(part.points, faces=faces, lines=lines)
    data.cell_data["colour"] = np.tile(np.array(_rgb(part), np.uint8), (data.n_cells, 1))
    return data


def model(scene: Instrument) -> PolyData:
    """All parts as one body [mm].

    ``colour`` of its cells, three bytes each, tells its parts apart.
    """
    import pyvista

    parts = [_poly_data(part) for part in scene.parts]
    body: PolyData = pyvista.merge(parts).extract_surface(algorithm=None)
    for data in (body.point_data, body.cell_data):
        for name in [name for name in data if name.startswith("vtkOriginal")]:
            del data[name]
    return body


def vtp_bytes(scene: Instrument) -> bytes:
    """The model as a ``.vtp`` file, which ParaView and PyVista read."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.vtp"
        model(scene).save(path)
        return path.read_bytes()


def picture(scene: Instrument, timeout: float = TIMEOUT) -> bytes:
    """A scene as PNG bytes, drawn by OpenGL in a child process that is given up after `timeout` seconds.

    Raises
    ------
    NoPictureError
        There is no library to draw with, or the child crashed, failed or took too long; the message names what helps.
    """
    variables = dict(os.environ)
    way = backend(variables)
    if way is None:
        raise NoPictureError(f"no OpenGL library is installed; on Debian: apt-get install {DEBIAN}")
    if way in WINDOWS:
        variables["VTK_DEFAULT_OPENGL_WINDOW"] = WINDOWS[way]
    root = str(Path(__file__).resolve().parents[2])
    variables["PYTHONPATH"] = os.pathsep.join(filter(None, [root, variables.get("PYTHONPATH", "")]))
    words, data = [sys.executable, *CHILD], pickle.dumps((scene.parts, scene.view))
    try:
        child = subprocess.run(words, input=data, capture_output=True, env=variables, timeout=timeout)
    except subprocess.TimeoutExpired:
        raise NoPictureError(f"drawing took more than {timeout:g} s and was given up") from None
    if child.returncode == 0 and child.stdout.startswith(b"\x89PNG"):
        return child.stdout
    if child.returncode < 0:
        raise NoPictureError(f"OpenGL does not work here; on Debian: apt-get install {DEBIAN}")
    last = child.stderr.decode(errors="replace").strip().splitlines()[-1:] or ["no picture came"]
    raise NoPictureError(f"{last[0]}; on Debian this may help: apt-get install {DEBIAN}")


def backend(environment: Mapping[str, str]) -> str | None:
    """The way in which VTK could draw: "egl", "x", "osmesa", "native", or None where no library for it is there."""
    if sys.platform != "linux":
        return "native"
    if _loads("libEGL.so.1"):
        return "egl"
    if environment.get("DISPLAY") and _loads("libX11.so.6") and _loads("libGL.so.1"):
        return "x"
    return "osmesa" if _loads("libOSMesa.so.8") or _loads("libOSMesa.so") else None


def _loads(shared: str) -> bool:
    try:
        ctypes.CDLL(shared)
    except OSError:
        return False
    return True


def main() -> int:
    """The child: parts and a view, pickled, on stdin; a PNG on stdout."""
    import pyvista
    from PIL import Image

    parts, view = pickle.load(sys.stdin.buffer)
    # Decorators hide the signatures of its methods.
    shown: Any = pyvista.Plotter(off_screen=True, window_size=list(view.window), lighting="light kit")
    shown.set_background("white")
    for part in parts:
        look: dict[str, Any] = {"line_width": part.width, "lighting": False}
        if part.kind != "lines":
            look = {"smooth_shading": part.kind == "round", "specular": 0.15}
        shown.add_mesh(_poly_data(part), name=part.name, color=_rgb(part), opacity=part.opacity, **look)
    camera = view.camera
    shown.camera_position = [camera["position"], camera["focalPoint"], camera["viewUp"]]
    shown.camera.parallel_projection = True
    shown.camera.parallel_scale = view.scale
    shown.reset_camera_clipping_range()
    shown.enable_anti_aliasing("ssaa")
    pixels = shown.screenshot(return_img=True)
    shown.close()
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, format="png", optimize=True)
    sys.stdout.buffer.write(stream.getvalue())
    return 0


if __name__ == "__main__":
    sys.exit(main())
