"""Child process that draws a 3D scene with VTK: JSON on stdin, PNG on stdout; see `offscreen` for why a process.

The scene: ``window`` [width, height] in pixels; ``camera`` with ``position``, ``focus``, ``up`` and ``scale`` (half the
height of the view); ``parts``, each a ``kind`` with its numbers, a ``colour`` and an ``opacity``. Lengths in mm.
"""

from __future__ import annotations

import json
import sys
from typing import Any


def main() -> int:
    """Draw what stdin says."""
    scene = json.load(sys.stdin)
    picture = draw(scene)
    sys.stdout.buffer.write(picture)
    return 0


def draw(scene: dict[str, Any]) -> bytes:
    """PNG bytes of a scene."""
    import io

    import pyvista
    from PIL import Image

    pv: Any = pyvista

    plotter = pv.Plotter(off_screen=True, window_size=scene["window"], lighting="light kit")
    plotter.set_background("white")
    for part in scene["parts"]:
        look: dict[str, Any] = {"color": part["colour"], "opacity": part.get("opacity", 1.0)}
        if part["kind"] == "lines":
            look |= {"line_width": part["width"], "lighting": False}
        else:
            look |= {"smooth_shading": part["kind"] in ("ellipsoid", "tube"), "specular": 0.15}
        plotter.add_mesh(MESHES[part["kind"]](pv, part), **look)
    camera = scene["camera"]
    plotter.camera_position = [camera["position"], camera["focus"], camera["up"]]
    plotter.camera.parallel_projection = True
    plotter.camera.parallel_scale = camera["scale"]
    plotter.reset_camera_clipping_range()
    plotter.enable_anti_aliasing("ssaa")
    pixels = plotter.screenshot(return_img=True)
    plotter.close()
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, format="png", optimize=True)
    return stream.getvalue()


def _ring(pv: Any, part: dict[str, Any]) -> Any:
    return pv.Disc(center=part["centre"], inner=part["inner"], outer=part["outer"], normal=part["normal"], c_res=96)


def _tube(pv: Any, part: dict[str, Any]) -> Any:
    x, y, _ = part["centre"]
    start, end = part["from"], part["to"]
    return pv.Cylinder(
        center=(x, y, (start + end) / 2),
        direction=(0, 0, 1),
        radius=part["radius"],
        height=end - start,
        capping=False,
        resolution=128,
    )


def _ellipsoid(pv: Any, part: dict[str, Any]) -> Any:
    radius, thickness = part["radius"], part["thickness"]
    body = pv.Sphere(radius=1.0, theta_resolution=96, phi_resolution=64, direction=(0, 0, 1))
    return body.scale((radius, radius, thickness), inplace=False).translate(part["centre"], inplace=False)


def _plate(pv: Any, part: dict[str, Any]) -> Any:
    width, height = part["size"]
    return pv.Plane(
        center=part["centre"], direction=part["normal"], i_size=height, j_size=width, i_resolution=1, j_resolution=1
    )


def _lines(pv: Any, part: dict[str, Any]) -> Any:
    import numpy as np

    lengths = [len(line) for line in part["lines"]]
    starts = np.cumsum([0, *lengths[:-1]])
    cells = [item for n, start in zip(lengths, starts, strict=True) for item in (n, *range(start, start + n))]
    return pv.PolyData(np.concatenate([np.asarray(line, float) for line in part["lines"]]), lines=np.asarray(cells))


MESHES = {"ring": _ring, "tube": _tube, "ellipsoid": _ellipsoid, "plate": _plate, "lines": _lines}
"""How each kind of part is built."""

if __name__ == "__main__":
    sys.exit(main())
