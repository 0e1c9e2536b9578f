"""The 3D scene elsewhere: packed for a page that turns it, as a PyVista model, and drawn by OpenGL in a child process.

Building a model is safe without OpenGL; drawing one is not: VTK without a working OpenGL does not raise, it ends the
process. So the parent never draws.
"""

from __future__ import annotations

import base64
import ctypes
import io
import json
import os
import subprocess
import sys
import tempfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..design import dumps, loads
from .scene3d import Body, Mesh, instrument_scene, scene
from .theme import THEMES, rgb

if TYPE_CHECKING:
    from pyvista import MultiBlock, PolyData

    from ..design import Design

DEBIAN = "libegl1 libgl1-mesa-dri"
"""Packages with which off-screen 3D works on a machine without a display."""
TIMEOUT = 25.0
"""Seconds after which a picture is given up."""
CHILD = ("-m", "roslf_design.pictures.solid")
"""What the child runs: arguments of the interpreter."""
WINDOWS = {"egl": "vtkEGLRenderWindow", "osmesa": "vtkOSOpenGLRenderWindow"}
"""VTK's own name for each way to draw without a display."""


class NoPictureError(Exception):
    """A 3D picture that cannot be made here; the message says why and what helps."""


def scene_data(design: Design) -> str:
    """The scene for a page that turns it: JSON of ``meshes``, ``camera`` and ``names``, deflated, as base64.

    Meshes and camera are those of `scene3d.scene`; of each name its ``text`` and where it belongs, ``at`` [mm].
    """
    meshes, camera, _ = scene(design)
    names = [{"text": name.text, "at": name.at} for name in instrument_scene(design).names if name.above]
    data = {"meshes": [mesh._asdict() for mesh in meshes.values()], "camera": camera, "names": names}
    text = json.dumps(data, separators=(",", ":"))
    return base64.b64encode(zlib.compress(text.encode(), 9)).decode()


def _rgb(part: Body) -> tuple[int, int, int]:
    return rgb(THEMES["light"].colour(part.colour))


def _cells(mesh: Mesh) -> NDArray[np.int64]:
    """Number of corners, then their indices, of one line or face after the other."""
    if mesh.lines:
        return np.concatenate([[len(line), *line] for line in mesh.lines])
    return np.insert(mesh.faces, 0, 4, axis=1).ravel()


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
