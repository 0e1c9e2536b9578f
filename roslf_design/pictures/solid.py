"""The 3D scene elsewhere: packed for a page that turns it, as a PyVista model, and drawn by OpenGL in a child process.

Pages carry the scene in vtk.js' own format, written without VTK, and the viewer page that comes with trame-vtk
(BSD-3-Clause, Kitware). Building a model is safe without OpenGL; drawing one is not: VTK without a working OpenGL does
not raise, it ends the process. So the parent never draws.
"""

from __future__ import annotations

import base64
import ctypes
import gzip
import hashlib
import io
import json
import os
import re
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..design import dumps, loads
from .scene3d import Body, Instrument, Mesh, View, instrument_scene
from .theme import THEMES, rgb

if TYPE_CHECKING:
    from pyvista import MultiBlock, PolyData

    from ..design import Design

PACKAGE = "trame_vtk"
PAGE = "tools/static_viewer.html"
SMOOTH = 1
"""vtk.js' number for shading that is even across edges."""
DEBIAN = "libegl1 libgl1-mesa-dri"
"""Packages with which off-screen 3D works on a machine without a display."""
TIMEOUT = 25.0
"""Seconds after which a picture is given up."""
CHILD = ("-m", "roslf_design.pictures.solid")
"""What the child runs: arguments of the interpreter."""
WINDOWS = {"egl": "vtkEGLRenderWindow", "osmesa": "vtkOSOpenGLRenderWindow"}
"""VTK's own name for each way to draw without a display."""


class NoViewerError(Exception):
    """Why a scene cannot be turned; the message says what to install."""


class NoPictureError(Exception):
    """A 3D picture that cannot be made here; the message says why and what helps."""


@cache
def library() -> str:
    """The viewer page: gzip, as base64.

    Raises
    ------
    NoViewerError
        trame-vtk is not installed, or without its viewer.
    """
    spec = find_spec(PACKAGE)
    places = [] if spec is None else [Path(place) / PAGE for place in spec.submodule_search_locations or ()]
    page = next((place for place in places if place.is_file()), None)
    if page is None:
        raise NoViewerError("the trame-vtk package is not installed: pip install trame-vtk")
    text = page.read_text(encoding="utf-8")
    # The picture of its file-drop area, which is never shown here, and a link that would leave the page.
    text = re.sub(r"data:image/jpeg;base64,[A-Za-z0-9+/=]+", "data:,", text)
    text = text.replace("https://kitware.github.io/vtk-js/icon/favicon-", "data:,")
    return base64.b64encode(gzip.compress(text.encode(), 9, mtime=0)).decode()


def scene_data(scene: Instrument) -> str:
    """A scene as JSON: ``data`` (a vtk.js scene, zipped, base64), ``camera`` and ``names`` with their places [mm]."""
    view = scene.view
    camera = {"position": view.position, "focus": view.focus, "up": view.up, "scale": view.scale}
    names = [{"text": name.text, "at": name.at} for name in scene.names if name.above]
    text = json.dumps({"data": packed(scene.parts, view), "camera": camera, "names": names})
    return text.replace("<", "\\u003c")  # no end tag inside the page's script element


def packed(parts: Sequence[Body], view: View) -> str:
    """Parts and a view as vtk.js reads them: a zipped index.json, as base64; the same parts give the same text."""
    arrays: dict[str, Any] = {}
    actors = [_actor(number, part, arrays) for number, part in enumerate(parts)]
    look: dict[str, Any] = {
        "position": view.position,
        "focalPoint": view.focus,
        "viewUp": view.up,
        "parallelProjection": 1,
        "parallelScale": view.scale,
        "clippingRange": _clipping(parts, view),
    }
    lights = [_light("headlight", 0.55, (0.0, 0.0, 1.0)), _light("key", 0.45, (0.4, 0.8, 0.5))]
    children = [_object("camera", "vtkCamera", "renderer", look), *actors, *lights]
    calls = [["setActiveCamera", ["instance:${camera}"]]]
    calls += [["addViewProp", [f"instance:${{{actor['id']}}}"]] for actor in actors]
    calls += [["addLight", [f"instance:${{{light['id']}}}"]] for light in lights]
    look = {"background": [1.0, 1.0, 1.0], "twoSidedLighting": 1, "lightFollowCamera": 1, "layer": 0, "interactive": 1}
    renderer = _object("renderer", "vtkRenderer", "window", look, calls, children)
    calls = [["addRenderer", ["instance:${renderer}"]]]
    window = _object("window", "vtkRenderWindow", "0x0", {"numberOfLayers": 1}, calls, [renderer])
    index = json.dumps({"scene": window | {"mtime": 1, "extra": {"camera": "camera"}}, "hashes": arrays})
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr(zipfile.ZipInfo("index.json"), index, zipfile.ZIP_DEFLATED, 9)
    return base64.b64encode(stream.getvalue()).decode()


def _clipping(parts: Sequence[Body], view: View) -> list[float]:
    """Depths between which all points lie, as the camera counts them."""
    away = np.subtract(view.focus, view.position)
    away = away / np.linalg.norm(away)
    depths = np.concatenate([(part.mesh.points - view.position) @ away for part in parts])
    room = 0.1 * float(np.ptp(depths))
    return [float(depths.min()) - room, float(depths.max()) + room]


def _actor(number: int, part: Body, arrays: dict[str, Any]) -> dict[str, Any]:
    own, mesh = f"part-{number}", part.mesh
    geometry = _object(f"{own}-geometry", "vtkPolyData", f"{own}-mapper", _geometry(mesh, arrays))
    calls = [["setInputData", [f"instance:${{{own}-geometry}}"]]]
    mapper = _object(f"{own}-mapper", "vtkMapper", own, {"scalarVisibility": 0}, calls, [geometry])
    colour = [channel / 255 for channel in _rgb(part)]
    look: dict[str, Any] = dict.fromkeys(("color", "diffuseColor", "ambientColor"), colour)
    look |= {"opacity": part.opacity, "lighting": 0 if mesh.lines else 1, "representation": 2}
    look |= {"lineWidth": part.width, "interpolation": SMOOTH, "ambient": 0.45, "diffuse": 0.6}
    surface = _object(f"{own}-look", "vtkProperty", own, look)
    calls = [["setMapper", [f"instance:${{{own}-mapper}}"]], ["setProperty", [f"instance:${{{own}-look}}"]]]
    return _object(own, "vtkActor", "renderer", {"visibility": 1, "pickable": 0}, calls, [mapper, surface])


def _rgb(part: Body) -> tuple[int, int, int]:
    return rgb(THEMES["light"].colour(part.colour))


def _geometry(mesh: Mesh, arrays: dict[str, Any]) -> dict[str, Any]:
    values: dict[str, Any] = {"points": _array(mesh.points.astype(np.float32), "vtkPoints", 3, arrays), "fields": []}
    kind = "lines" if mesh.lines else "polys"
    values[kind] = _array(_cells(mesh).astype(np.int32), "vtkCellArray", 1, arrays)
    if mesh.normals is not None:
        normals = _array(mesh.normals.astype(np.float32), "vtkDataArray", 3, arrays)
        place = {"name": "Normals", "location": "pointData", "registration": "setNormals"}
        values["fields"].append(normals | place)
    return values


def _cells(mesh: Mesh) -> NDArray[np.int64]:
    """Number of corners, then their indices, of one line or face after the other."""
    if mesh.lines:
        return np.concatenate([[len(line), *line] for line in mesh.lines])
    return np.insert(mesh.faces, 0, 4, axis=1).ravel()


def _array(values: NDArray[Any], kind: str, components: int, arrays: dict[str, Any]) -> dict[str, Any]:
    content = np.ascontiguousarray(values).tobytes()
    name = hashlib.sha256(content).hexdigest()[:16]
    type_ = "Float32Array" if values.dtype.kind == "f" else "Int32Array"
    entry = {"hash": name, "vtkClass": kind, "dataType": type_, "numberOfComponents": components, "size": values.size}
    arrays[name] = entry | {"content": base64.b64encode(content).decode()}
    return entry


def _light(name: str, intensity: float, position: tuple[float, float, float]) -> dict[str, Any]:
    kind = "HeadLight" if name == "headlight" else "CameraLight"
    look = {"switch": 1, "intensity": intensity, "color": [1.0, 1.0, 1.0], "lightType": kind, "positional": 0}
    return _object(name, "vtkLight", "renderer", look | {"position": list(position), "focalPoint": [0.0, 0.0, 0.0]})


def _object(
    name: str, kind: str, parent: str, properties: Mapping[str, Any], calls: Sequence[Any] = (),
    children: Sequence[Any] = (),
) -> dict[str, Any]:  # fmt: skip
    own = {"parent": parent, "id": name, "type": kind, "properties": dict(properties)}
    return own | {"calls": list(calls), "dependencies": list(children)}


def model(design: Design) -> MultiBlock:
    """Bore, stops, main lens, microlens array, sensor and pencils as named blocks.

    Parameters
    ----------
    design : Design

    Returns
    -------
    pyvista.MultiBlock
        One `pyvista.PolyData` a part [mm], light along +z, the main lens at z = 0; each with ``colour`` (three bytes a
        cell) and, as field data, ``opacity``.
    """
    import pyvista

    blocks = pyvista.MultiBlock()
    for part in instrument_scene(design).parts:
        data = _poly_data(part.mesh)
        data.cell_data["colour"] = np.tile(np.array(_rgb(part), np.uint8), (data.n_cells, 1))
        data.field_data["opacity"] = [part.opacity]
        blocks.append(data, part.name)
    return blocks


def merged(design: Design) -> PolyData:
    """The model as one body with a ``colour`` for every cell, as ``.vtp`` files hold it."""
    import pyvista

    blocks = model(design)
    body: PolyData = pyvista.merge([block for block in blocks if block is not None]).extract_surface(algorithm=None)
    for data in (body.point_data, body.cell_data):
        for name in [name for name in data if name.startswith("vtkOriginal")]:
            del data[name]
    return body


def vtp_bytes(design: Design) -> bytes:
    """The model as a ``.vtp`` file, which ParaView and PyVista read."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.vtp"
        merged(design).save(path)
        return path.read_bytes()


def plotter(design: Design, off_screen: bool = False) -> Any:
    """A PyVista plotter that shows the model from where reports look at it; call its ``show()``.

    Parameters
    ----------
    design : Design
    off_screen : bool
        Without a window, for a screenshot. Either way working OpenGL is needed: without it VTK ends the process.
    """
    import pyvista

    scene = instrument_scene(design)
    view = scene.view
    # Decorators hide the signatures of its methods.
    shown: Any = pyvista.Plotter(off_screen=off_screen, window_size=list(view.window), lighting="light kit")
    shown.set_background("white")
    for part in scene.parts:
        look: dict[str, Any] = {"color": THEMES["light"].colour(part.colour), "opacity": part.opacity}
        if part.kind == "lines":
            look |= {"line_width": part.width, "lighting": False}
        else:
            look |= {"smooth_shading": part.kind in ("ellipsoid", "tube"), "specular": 0.15}
        shown.add_mesh(_poly_data(part.mesh), name=part.name, **look)
    shown.camera_position = [view.position, view.focus, view.up]
    shown.camera.parallel_projection = True
    shown.camera.parallel_scale = view.scale
    shown.reset_camera_clipping_range()
    shown.enable_anti_aliasing("ssaa")
    return shown


def _poly_data(mesh: Mesh) -> PolyData:
    import pyvista

    cells = _cells(mesh)
    faces, lines = (None, cells) if mesh.lines else (cells, None)
    return pyvista.PolyData(np.asarray(mesh.points, float), faces=faces, lines=lines)


def picture(design: Design) -> bytes:
    """The model drawn by OpenGL as PNG bytes, in a child process.

    Raises
    ------
    NoPictureError
        There is no working OpenGL; the message names what helps.
    """
    return rendered(dumps(design))


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


def rendered(text: str, timeout: float = TIMEOUT) -> bytes:
    """The picture that a child process draws of a design as TOML, as PNG bytes.

    Raises
    ------
    NoPictureError
        There is no library to draw with, or the child crashed, failed or took too long.
    """
    variables = dict(os.environ)
    way = backend(variables)
    if way is None:
        raise NoPictureError(f"no OpenGL library is installed; on Debian: apt-get install {DEBIAN}")
    if way in WINDOWS:
        variables["VTK_DEFAULT_OPENGL_WINDOW"] = WINDOWS[way]
    root = str(Path(__file__).resolve().parents[2])
    variables["PYTHONPATH"] = os.pathsep.join(filter(None, [root, variables.get("PYTHONPATH", "")]))
    try:
        words = [sys.executable, *CHILD]
        child = subprocess.run(words, input=text.encode(), capture_output=True, env=variables, timeout=timeout)
    except subprocess.TimeoutExpired:
        raise NoPictureError(f"drawing took more than {timeout:g} s and was given up") from None
    if child.returncode == 0 and child.stdout.startswith(b"\x89PNG"):
        return child.stdout
    if child.returncode < 0:
        raise NoPictureError(f"OpenGL does not work here; on Debian: apt-get install {DEBIAN}")
    last = child.stderr.decode(errors="replace").strip().splitlines()[-1:] or ["no picture came"]
    raise NoPictureError(f"{last[0]}; on Debian this may help: apt-get install {DEBIAN}")


def main() -> int:
    """The child: a design as TOML on stdin, a PNG on stdout."""
    from PIL import Image

    shown = plotter(loads(sys.stdin.read()), off_screen=True)
    pixels = shown.screenshot(return_img=True)
    shown.close()
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, format="png", optimize=True)
    sys.stdout.buffer.write(stream.getvalue())
    return 0


if __name__ == "__main__":
    sys.exit(main())
