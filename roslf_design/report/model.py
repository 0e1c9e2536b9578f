"""The instrument as a PyVista model, for ParaView, CAD and notebooks, and its picture by OpenGL.

Nothing of a report needs it: reports carry vector drawings and vtk.js scenes. Building a model is safe on a machine
without OpenGL; a plotter is not (VTK ends the process), so `picture` draws in a child process.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import numpy as np

from .meshes import Mesh, mesh_of
from .scene3d import instrument_scene

if TYPE_CHECKING:
    from pyvista import MultiBlock, Plotter, PolyData

    from ..design import Design


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
    for number, part in enumerate(instrument_scene(design).data["parts"]):
        data = _poly_data(mesh_of(part))
        colour = [int(part["colour"][i : i + 2], 16) for i in (1, 3, 5)]
        data.cell_data["colour"] = np.tile(np.array(colour, np.uint8), (data.n_cells, 1))
        data.field_data["opacity"] = [float(part.get("opacity", 1.0))]
        blocks.append(data, str(part.get("name", f"part {number}")))
    return blocks


def merged(design: Design) -> PolyData:
    """The model as one body with a ``colour`` for every cell, as ``.vtp`` files hold it."""
    import pyvista

    blocks = model(design)
    body: PolyData = pyvista.merge([block for block in blocks if block is not None]).extract_surface(algorithm=None)
    for kept in (body.point_data, body.cell_data):
        for name in [name for name in kept if name.startswith("vtkOriginal")]:
            del kept[name]
    return body


def vtp_bytes(design: Design) -> bytes:
    """The model as a ``.vtp`` file, which ParaView and PyVista read."""
    import tempfile
    from pathlib import Path

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.vtp"
        merged(design).save(path)
        return path.read_bytes()


def plotter(design: Design, off_screen: bool = False) -> Plotter:
    """A PyVista plotter that shows the model from where reports look at it; call its ``show()``.

    Parameters
    ----------
    design : Design
    off_screen : bool
        Without a window, for a screenshot. Either way working OpenGL is needed: without it VTK ends the process.
    """
    import pyvista

    scene = instrument_scene(design)
    shown: Plotter = pyvista.Plotter(
        off_screen=off_screen, window_size=list(scene.data["window"]), lighting="light kit"
    )
    paper: Any = shown  # decorators hide the signatures of its methods
    paper.set_background("white")
    for part in scene.data["parts"]:
        look: dict[str, Any] = {"color": part["colour"], "opacity": part.get("opacity", 1.0)}
        if part["kind"] == "lines":
            look |= {"line_width": part["width"], "lighting": False}
        else:
            look |= {"smooth_shading": part["kind"] in ("ellipsoid", "tube"), "specular": 0.15}
        shown.add_mesh(_poly_data(mesh_of(part)), name=part.get("name"), **look)
    camera = scene.data["camera"]
    shown.camera_position = [camera["position"], camera["focus"], camera["up"]]
    shown.camera.parallel_projection = True
    shown.camera.parallel_scale = camera["scale"]
    shown.reset_camera_clipping_range()
    shown.enable_anti_aliasing("ssaa")
    return shown


def picture(design: Design) -> bytes:
    """The model drawn by OpenGL as PNG bytes, in a child process.

    Raises
    ------
    NoPictureError
        There is no working OpenGL; the message names what helps.
    """
    from ..design import dumps
    from .offscreen import Rendering

    return Rendering(dumps(design)).result()


def main() -> int:
    """The child: a design as TOML on stdin, a PNG on stdout."""
    import io

    from PIL import Image

    from ..design import loads

    shown: Any = plotter(loads(sys.stdin.read()), off_screen=True)
    pixels = shown.screenshot(return_img=True)
    shown.close()
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, format="png", optimize=True)
    sys.stdout.buffer.write(stream.getvalue())
    return 0


def _poly_data(mesh: Mesh) -> PolyData:
    import pyvista

    if mesh.lines:
        cells = np.concatenate([[len(line), *line] for line in mesh.lines])
        return pyvista.PolyData(np.asarray(mesh.points, float), lines=cells)
    faces = np.column_stack([np.full(len(mesh.faces), 4), mesh.faces]).ravel()
    return pyvista.PolyData(np.asarray(mesh.points, float), faces=faces)


if __name__ == "__main__":
    sys.exit(main())
