"""The 3D scene: geometry against formulas, names that stay, small changes for small moves, and what is packed."""

import base64
import gzip
import io
import json
import math
import re
import subprocess
import sys
import zipfile

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.pictures.scene3d import (
    AROUND,
    RAYS,
    across,
    changed,
    ellipsoid,
    instrument_scene,
    outline,
    outlines,
    plate_of,
    ring,
    scene,
    tube,
)
from roslf_design.pictures.solid import library, packed, scene_data
from tests.pictures import designs

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
        "import sys, roslf_design as r; from roslf_design.pictures.scene3d import scene; scene(r.load('paper'));"
        "sys.exit(any(name.split('.')[0] in ('vtk', 'vtkmodules', 'pyvista', 'matplotlib') for name in sys.modules))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_coordinates_are_rounded_far_below_a_pixel():
    mesh = scene(PAPER).meshes["lens"]
    assert max(len(f"{abs(value):.10g}") for value in mesh.points) <= 8
    assert math.isclose(max(mesh.points), 25.4, abs_tol=1e-3)


TILTED = [0.3, -0.2, 0.9]


def area(mesh):
    """Of all quadrangles, each as two triangles."""
    a, b, c, d = (mesh.points[mesh.faces[:, k]] for k in range(4))
    return sum(np.linalg.norm(np.cross(q - p, r - p), axis=1).sum() / 2 for p, q, r in ((a, b, c), (a, c, d)))


def test_parts_are_as_large_as_their_formulas_say():
    polygon = math.sin(2 * math.pi / AROUND) * AROUND / 2  # a regular polygon's area for radius 1
    assert area(ring([1, 2, 3], TILTED, 1.0, 2.0)) == pytest.approx((2**2 - 1**2) * polygon, rel=1e-12)
    assert area(tube(2.0, -1.0, 4.0)) == pytest.approx(5 * AROUND * 2 * 2 * math.sin(math.pi / AROUND), rel=1e-12)
    assert area(plate_of([1, 0, 0], TILTED, (3.0, 2.0))) == pytest.approx(6, rel=1e-12)
    # A sphere of flat faces is smaller by terms of second order in 2 pi / AROUND and pi / RINGS.
    assert area(ellipsoid([1, 0, 0], 2.0, 2.0)) == pytest.approx(4 * math.pi * 4, rel=1e-2)


def test_flat_parts_lie_in_their_planes_and_normals_are_those_of_the_surface():
    u, v = across(TILTED)
    assert np.array([u @ u, v @ v, u @ v, u @ TILTED, v @ TILTED]) == pytest.approx([1, 1, 0, 0, 0], abs=1e-15)
    assert np.allclose(across([1, 0, 0]), ([0, 1, 0], [0, 0, 1]))
    plate = ring([1, 2, 3], TILTED, 1.0, 2.0)
    np.testing.assert_allclose((plate.points - [1, 2, 3]) @ TILTED, 0, atol=1e-14)
    lens = ellipsoid([0, 0, 0], 2.0, 0.5)
    gradient = lens.points / np.array([4.0, 4.0, 0.25])
    np.testing.assert_allclose(lens.normals, gradient / np.linalg.norm(gradient, axis=1, keepdims=True), atol=1e-12)


@pytest.mark.parametrize("name", ["paper", "strange", "at the lens"])
def test_every_part_is_whole_and_drawn(name):
    parts = instrument_scene(designs.DESIGNS[name]).parts
    for part in parts:
        assert np.isfinite(part.mesh.points).all()
        corners = np.concatenate([part.mesh.faces.ravel(), *part.mesh.lines])
        assert 0 <= corners.min() <= corners.max() == len(part.mesh.points) - 1
    picture = outlines(instrument_scene(designs.DESIGNS[name]))
    assert len(picture.marks) >= len(parts)
    assert ">main lens</text>" in picture.svg()


def test_outlines_hold_every_point_and_turn_left_throughout():
    points = np.random.default_rng(1).normal(size=(200, 2))
    hull = outline(points)
    edges = np.roll(hull, -1, axis=0) - hull
    away = points[:, None, :] - hull[None]
    # Left of every edge, or on it.
    assert (edges[None, :, 0] * away[..., 1] - edges[None, :, 1] * away[..., 0] >= -1e-12).all()
    assert {tuple(point) for point in hull} <= {tuple(point) for point in points}


def test_the_packed_scene_is_the_scene_and_always_the_same():
    parts, view, _ = instrument_scene(PAPER)
    text = packed(parts, view)
    assert text == packed(parts, view)
    with zipfile.ZipFile(io.BytesIO(base64.b64decode(text))) as archive:
        index = json.loads(archive.read("index.json"))
    (renderer,) = index["scene"]["dependencies"]
    actors = [child for child in renderer["dependencies"] if child["type"] == "vtkActor"]
    for actor, part in zip(actors, parts, strict=True):
        (geometry,) = actor["dependencies"][0]["dependencies"]
        stored = index["hashes"][geometry["properties"]["points"]["hash"]]["content"]
        points = np.frombuffer(base64.b64decode(stored), np.float32).reshape(-1, 3)
        np.testing.assert_array_equal(points, part.mesh.points.astype(np.float32))
    near, far = renderer["dependencies"][0]["properties"]["clippingRange"]
    assert 0 < near < far


def test_a_scene_cannot_end_its_script_element():
    named = instrument_scene(PAPER)
    nasty = named._replace(names=(named.names[-1]._replace(text="</script><b>"),))
    assert "</script" not in scene_data(nasty)
    assert json.loads(scene_data(nasty))["names"][0]["text"] == "</script><b>"


def test_the_library_refers_to_no_other_place():
    page = gzip.decompress(base64.b64decode(library())).decode()
    assert not re.search(r"<(link|script|img)[^>]+(href|src)=", page)
    assert "kitware.github.io/vtk-js/icon" not in page
