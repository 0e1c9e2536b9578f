"""The 3D scene: sound geometry, names that stay, and small changes for small moves."""

import json
import math
import subprocess
import sys

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.explorer.scene3d import RAYS, changed, scene

PAPER = roslf.load("paper")
DESIGNS = {name: roslf.load(name) for name in roslf.preset_names()} | {
    "dark": PAPER.replace(D=20.0, d_3=180.0),
    "stops and tilts": PAPER.replace(
        {"stops": ({"diameter": 8.0, "distance": 60.0},), "main_lens.tilt": (0.02, 0.0), "sensor.decentre": (0.3, 0.1)}
    ),
}


def cells(flat):
    found, i = [], 0
    while i < len(flat):
        found.append(flat[i + 1 : i + 1 + flat[i]])
        i += 1 + flat[i]
    assert i == len(flat)
    return found


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("design", DESIGNS.values(), ids=DESIGNS)
def test_meshes_are_sound(design, theme):
    found = scene(design, theme)
    assert set(RAYS) <= set(found.meshes)
    for mesh in found.meshes.values():
        points = np.reshape(mesh.points, (-1, 3))
        assert np.isfinite(points).all()
        used = {index for cell in cells(mesh.lines) + cells(mesh.polys) for index in cell}
        assert used == set(range(len(points)))
        assert all(0 <= channel <= 1 for channel in mesh.colour)
    json.dumps(found, allow_nan=False)


def test_points_are_those_of_the_design():
    meshes = scene(PAPER).meshes
    rim = np.reshape(meshes["FAP rim"].points, (-1, 3))
    np.testing.assert_allclose(np.hypot(rim[:, 0], rim[:, 1]), 1.45, atol=1e-3)
    np.testing.assert_allclose(rim[:, 2], -120.0)
    sensor = np.reshape(meshes["sensor"].points, (-1, 3))
    assert np.ptp(sensor, axis=0) == pytest.approx((22.3, 14.932, 0.0), abs=1e-3)
    assert sensor[0, 2] == pytest.approx(142.0)


def test_rays_are_coloured_by_their_fate():
    lit, dark = scene(PAPER).meshes, scene(DESIGNS["dark"]).meshes
    assert not lit["rays blocked"].points
    assert lit["rays corner"].points
    assert not dark["rays corner"].points
    blocked = np.reshape(dark["rays blocked"].points, (-1, 3))
    ends = blocked[[cell[-1] for cell in cells(dark["rays blocked"].lines)]]
    # They end at the main lens, outside its clear aperture.
    np.testing.assert_allclose(ends[:, 2], 0.0, atol=1e-9)
    assert (np.hypot(ends[:, 0], ends[:, 1]) > 10).all()


def test_a_move_sends_only_what_it_moves():
    before, after = scene(PAPER).meshes, scene(PAPER.replace(D_F=3.0)).meshes
    moved = changed(before, after)
    assert {"FAP plate", "FAP rim", "rays centre"} <= set(moved)
    assert not {"lens", "lens rim", "MLA", "sensor", "tube"} & set(moved)
    assert changed(after, after) == {}
    assert {**before, **moved} == after


def test_meshes_that_are_gone_are_told():
    with_stop = scene(DESIGNS["stops and tilts"]).meshes
    moved = changed(with_stop, scene(PAPER).meshes)
    assert {name for name, mesh in moved.items() if mesh is None} == {"stop 1 plate", "stop 1 rim"}


def test_all_is_seen_from_where_the_camera_starts():
    found = scene(PAPER)
    camera = found.camera
    toward = np.subtract(camera["position"], camera["focalPoint"])
    toward /= np.linalg.norm(toward)
    up = np.asarray(camera["viewUp"])
    right = np.cross(up, toward)
    for name in ("FAP plate", "lens", "sensor", "tube"):
        seen = np.reshape(found.meshes[name].points, (-1, 3)) - camera["focalPoint"]
        assert np.abs(seen @ up).max() <= camera["parallelScale"]
        assert np.abs(seen @ right).max() <= camera["halfWidth"] * (1 + 1e-3)


def test_no_graphics_library_is_loaded():
    code = (
        "import sys, roslf_design as r; from roslf_design.explorer.scene3d import scene; scene(r.load('paper'));"
        "sys.exit(any(name.split('.')[0] in ('vtk', 'vtkmodules', 'pyvista', 'matplotlib') for name in sys.modules))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_coordinates_are_rounded_far_below_a_pixel():
    mesh = scene(PAPER).meshes["lens"]
    assert max(len(f"{abs(value):.10g}") for value in mesh.points) <= 8
    assert math.isclose(max(mesh.points), 25.4, abs_tol=1e-3)
