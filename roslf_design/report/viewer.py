"""The 3D scene as something to turn in a browser: vtk.js and its data, packed for a page that needs nothing else.

The scene is written in vtk.js' own format without VTK, so it needs no OpenGL where the report is made. The library is
the viewer page that comes with trame-vtk (BSD-3-Clause, Kitware), packed once a report.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import io
import json
import re
import zipfile
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .meshes import Mesh, mesh_of

if TYPE_CHECKING:
    from .scene3d import Scene

PACKAGE = "trame_vtk"
PAGE = "tools/static_viewer.html"
SMOOTH = 1
"""vtk.js' number for shading that is even across edges."""


class NoViewerError(Exception):
    """Why a scene cannot be turned; the message says what to install."""


@cache
def library() -> str:
    """The viewer page: gzip, as base64.

    Raises
    ------
    NoViewerError
        trame-vtk is not installed, or without its viewer.
    """
    found = find_spec(PACKAGE)
    places = [] if found is None else [Path(place) / PAGE for place in found.submodule_search_locations or ()]
    page = next((place for place in places if place.is_file()), None)
    if page is None:
        raise NoViewerError("the trame-vtk package is not installed: pip install trame-vtk")
    text = page.read_text(encoding="utf-8")
    # The picture of its file-drop area, which is never shown here, and a link that would leave the page.
    text = re.sub(r"data:image/jpeg;base64,[A-Za-z0-9+/=]+", "data:,", text)
    text = text.replace("https://kitware.github.io/vtk-js/icon/favicon-", "data:,")
    return base64.b64encode(gzip.compress(text.encode(), 9, mtime=0)).decode()


def scene_data(scene: Scene) -> str:
    """A scene as JSON: ``data`` (a vtk.js scene, zipped, base64), ``camera`` and ``names`` with their places [mm]."""
    camera = scene.data["camera"]
    names = [{"text": name.text, "at": list(name.at)} for name in scene.names if name.above]
    text = json.dumps({"data": packed(scene.data["parts"], camera), "camera": camera, "names": names})
    return text.replace("<", "\\u003c")  # no end tag inside the page's script element


def packed(parts: Sequence[Mapping[str, Any]], camera: Mapping[str, Any]) -> str:
    """Parts and a camera as vtk.js reads them: a zipped index.json, as base64; the same parts give the same text."""
    arrays: dict[str, Any] = {}
    actors = [_actor(number, part, arrays) for number, part in enumerate(parts)]
    view = {
        "position": camera["position"],
        "focalPoint": camera["focus"],
        "viewUp": camera["up"],
        "parallelProjection": 1,
        "parallelScale": camera["scale"],
        "clippingRange": _clipping(parts, camera),
    }
    lights = [_light("headlight", 0.55, (0.0, 0.0, 1.0)), _light("key", 0.45, (0.4, 0.8, 0.5))]
    children = [_object("camera", "vtkCamera", "renderer", view), *actors, *lights]
    calls = [["setActiveCamera", ["instance:${camera}"]]]
    calls += [["addViewProp", [f"instance:${{{actor['id']}}}"]] for actor in actors]
    calls += [["addLight", [f"instance:${{{light['id']}}}"]] for light in lights]
    look = {"background": [1.0, 1.0, 1.0], "twoSidedLighting": 1, "lightFollowCamera": 1, "layer": 0, "interactive": 1}
    renderer = _object("renderer", "vtkRenderer", "window", look, calls, children)
    window = _object(
        "window",
        "vtkRenderWindow",
        "0x0",
        {"numberOfLayers": 1},
        [["addRenderer", ["instance:${renderer}"]]],
        [renderer],
    )
    index = json.dumps({"scene": window | {"mtime": 1, "extra": {"camera": "camera"}}, "hashes": arrays})
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr(zipfile.ZipInfo("index.json"), index, zipfile.ZIP_DEFLATED, 9)
    return base64.b64encode(stream.getvalue()).decode()


def _clipping(parts: Sequence[Mapping[str, Any]], camera: Mapping[str, Any]) -> list[float]:
    """Depths between which all points lie, as the camera counts them."""
    position, focus = np.array(camera["position"]), np.array(camera["focus"])
    away = (focus - position) / np.linalg.norm(focus - position)
    depths = np.concatenate([(mesh_of(part).points - position) @ away for part in parts])
    room = 0.1 * float(np.ptp(depths))
    return [float(depths.min()) - room, float(depths.max()) + room]


def _actor(number: int, part: Mapping[str, Any], arrays: dict[str, Any]) -> dict[str, Any]:
    own = f"part-{number}"
    mesh = mesh_of(part)
    geometry = _object(f"{own}-geometry", "vtkPolyData", f"{own}-mapper", _geometry(mesh, arrays))
    mapper = _object(
        f"{own}-mapper",
        "vtkMapper",
        own,
        {"scalarVisibility": 0},
        [["setInputData", [f"instance:${{{own}-geometry}}"]]],
        [geometry],
    )
    colour = [int(part["colour"][i : i + 2], 16) / 255 for i in (1, 3, 5)]
    look: dict[str, Any] = dict.fromkeys(("color", "diffuseColor", "ambientColor"), colour)
    look |= {"opacity": part.get("opacity", 1.0), "lighting": 0 if mesh.lines else 1, "representation": 2}
    look |= {"lineWidth": part.get("width", 1.0), "interpolation": SMOOTH, "ambient": 0.45, "diffuse": 0.6}
    surface = _object(f"{own}-look", "vtkProperty", own, look)
    calls = [["setMapper", [f"instance:${{{own}-mapper}}"]], ["setProperty", [f"instance:${{{own}-look}}"]]]
    return _object(own, "vtkActor", "renderer", {"visibility": 1, "pickable": 0}, calls, [mapper, surface])


def _geometry(mesh: Mesh, arrays: dict[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = {"points": _array(mesh.points.astype(np.float32), "vtkPoints", 3, arrays), "fields": []}
    if mesh.lines:
        cells = np.concatenate([np.concatenate([[len(line)], line]) for line in mesh.lines])
        found["lines"] = _array(cells.astype(np.int32), "vtkCellArray", 1, arrays)
    else:
        cells = np.insert(mesh.faces, 0, 4, axis=1)
        found["polys"] = _array(cells.astype(np.int32), "vtkCellArray", 1, arrays)
    if mesh.normals is not None:
        normals = _array(mesh.normals.astype(np.float32), "vtkDataArray", 3, arrays)
        place = {"name": "Normals", "location": "pointData", "registration": "setNormals"}
        found["fields"].append(normals | place)
    return found


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
    name: str,
    kind: str,
    parent: str,
    properties: Mapping[str, Any],
    calls: Sequence[Any] = (),
    children: Sequence[Any] = (),
) -> dict[str, Any]:
    own = {"parent": parent, "id": name, "type": kind, "properties": dict(properties)}
    return own | {"calls": list(calls), "dependencies": list(children)}
