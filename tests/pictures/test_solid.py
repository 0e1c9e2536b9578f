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
from roslf_design.camera import Camera
from roslf_design.drawing.marks import Area, Line
from roslf_design.drawing.solid import AROUND, changed, library, outline, outlines, packed, scene_data
from roslf_design.reporting.design.instrument import RAYS, instrument_scene, scale_drawing, scene, turned
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


@pytest.mark.parametrize("design", DESIGNS.values(), ids=DESIGNS)
def test_meshes_are_sound(design):
    found = scene(design, "dark")
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
        "import sys, roslf_design as r; from roslf_design.reporting.design.instrument import scene\n"
        "scene(r.load('paper'))\n"
        "sys.exit(any(name.split('.')[0] in ('vtk', 'vtkmodules', 'pyvista', 'matplotlib') for name in sys.modules))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_coordinates_are_rounded_far_below_a_pixel():
    mesh = scene(PAPER).meshes["lens"]
    assert max(len(f"{abs(value):.10g}") for value in mesh.points) <= 8
    assert math.isclose(max(mesh.points), 25.4, abs_tol=1e-3)


TILTED = PAPER.replace({"sensor.tilt": (0.3, -0.2), "main_lens.tilt": (-0.1, 0.2), "microlens_array.rotation": 0.4})


def parts_of(design):
    return {part.name: part for part in instrument_scene(design).parts}


def area(part):
    """Of all quadrangles, each as two triangles."""
    a, b, c, d = (part.points[np.array(cells(part.cells))[:, k]] for k in range(4))
    return sum(np.linalg.norm(np.cross(q - p, r - p), axis=1).sum() / 2 for p, q, r in ((a, b, c), (a, c, d)))


def test_parts_are_as_large_as_their_formulas_say():
    parts = parts_of(TILTED)
    polygon = math.sin(2 * math.pi / AROUND) * AROUND / 2  # a regular polygon's area for radius 1
    wall = np.hypot(*parts["tube"].points[0, :2])
    assert area(parts["FAP plate"]) == pytest.approx((wall**2 - 1.45**2) * polygon, rel=1e-12)
    assert area(parts["lens mount"]) == pytest.approx((wall**2 - 25.4**2) * polygon, rel=1e-12)
    assert area(parts["tube"]) == pytest.approx(262 * AROUND * 2 * wall * math.sin(math.pi / AROUND), rel=1e-12)
    assert area(parts["sensor"]) == pytest.approx(22.3 * 14.932, rel=1e-12)
    # A sphere of flat faces is smaller by terms of second order in 2 pi / AROUND and pi / RINGS.
    lens, turn = parts["lens"], np.linspace(math.pi, 0, 25)
    sphere = lens._replace(points=turned(np.stack([2 * np.sin(turn), 2 * np.cos(turn)], -1)))
    assert area(sphere) == pytest.approx(4 * math.pi * 4, rel=1e-2)
    radius, thick = 25.4, 0.09 * 50.8
    np.testing.assert_allclose(np.sum((lens.points / [radius, radius, thick]) ** 2, axis=1), 1, rtol=1e-12)


def test_flat_parts_lie_in_their_planes():
    camera = Camera.of(TILTED)
    parts = parts_of(TILTED)
    for name, place in (("sensor", "sensor"), ("MLA", "microlens_array"), ("lens mount", "main_lens")):
        pose = camera.apparent_pose(place).seen_from(camera.world)
        np.testing.assert_allclose((parts[name].points - pose.origin) @ pose.z, 0, atol=1e-12)
    # The array's plate is turned as the array is.
    pose = camera.apparent_pose("microlens_array").seen_from(camera.world)
    np.testing.assert_allclose(np.ptp((parts["MLA"].points - pose.origin) @ pose.x), TILTED.microlens_array.size[0])


@pytest.mark.parametrize("name", ["paper", "strange", "at the lens"])
def test_every_part_is_whole_and_drawn(name):
    parts = instrument_scene(designs.DESIGNS[name]).parts
    for part in parts:
        assert np.isfinite(part.points).all()
        corners = np.concatenate(cells(part.cells))
        assert 0 <= corners.min() <= corners.max() == len(part.points) - 1
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
        np.testing.assert_array_equal(points, part.points.astype(np.float32))
        for stored in geometry["properties"]["fields"]:
            normals = np.frombuffer(base64.b64decode(index["hashes"][stored["hash"]]["content"]), np.float32)
            normals, outwards = normals.reshape(-1, 3), part.points * [1, 1, 30.9 if part.name == "lens" else 0]
            # Those of an ellipsoid or a tube, of which faces differ by about their angles.
            outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
            assert (np.sum(normals * outwards, axis=1) > 0.99).all()
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


def test_elements_stand_in_the_scene_where_a_ruler_puts_them():
    design = designs.THROUGH["prism and cover"]
    straight, bent = (instrument_scene(design, fold) for fold in (False, True))
    parts = {part.name: part for part in straight.parts}
    assert "prism 1, unfolded: turns by 29.8°" in [name.text for name in straight.names]
    assert "prism 1, turns by 29.8°" in [name.text for name in bent.names]
    prism = parts["prism 1"].points
    assert (prism[:, 2].min(), prism[:, 2].max()) == pytest.approx((-80.0, -20.0))
    assert np.hypot(*prism[:, :2].T).max() == pytest.approx(20.0)
    assert np.abs(parts["lens 2"].points[:, 0].mean() - 0.6) < 1e-9
    end = design.d_1 + design.d_2
    parts = {part.name: part for part in bent.parts}
    assert sorted({round(z, 9) for z in parts["cover"].points[:, 2]}) == pytest.approx([end - 0.4, end])
    assert sorted({round(z, 9) for z in parts["substrate"].points[:, 2]}) == pytest.approx(
        [design.d_1, design.d_1 + 1.2]
    )
    medium = {part.name: part for part in instrument_scene(designs.THROUGH["needle"]).parts}["medium"].points
    assert medium[:, 2].max() == pytest.approx(-32.9)
    before, after = (scene(design).meshes for design in (design.replace({"elements": ()}), design))
    assert {"prism 1", "lens 2", "prescription 3"} <= changed(before, after).keys()
    assert changed(after, before)["prism 1"] is None


SIDE = {"kind": "prism", "distance": 20.0, "thickness": 30.0, "material": "N-BK7", "diameter": 30.0}


@pytest.mark.parametrize("azimuth", [0.0, 0.7, -2.0])
def test_a_right_angle_prism_is_drawn_as_its_two_legs_and_folds_what_stands_before_it(azimuth):
    """By hand: a leg towards the lens at z = -20, the other one 15 mm aside of the axis at z = -35."""
    prism = SIDE | {"deviation": math.pi / 2, "azimuth": azimuth, "reflections": 1}
    window = {"kind": "plate", "distance": 55.0, "thickness": 2.0, "material": "N-BK7", "diameter": 30.0}
    design = PAPER.replace({"elements": [prism, window]})
    parts = {part.name: part for part in instrument_scene(design).parts}
    aside = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
    corners = np.concatenate([parts[name].points for name in ("prism 1", "prism 1, beyond its fold")])
    u, z = corners @ aside, corners[:, 2]
    # The triangle of the axis's plane, of both halves.
    assert (u.min(), u.max(), z.min(), z.max()) == pytest.approx((-15.0, 15.0, -50.0, -20.0))
    assert ((u + z) >= -35.0 - 1e-9).all()
    u = parts["plate 2"].points @ aside
    assert (u.min(), u.max()) == pytest.approx((20.0, 22.0))  # 5 mm before the leg
    assert parts["plate 2"].points[:, 2].mean() == pytest.approx(-35.0)
    ends = [parts["rays centre"].points[cell[0]] for cell in cells(parts["rays centre"].cells)]
    assert min(point @ aside for point in ends) > 22.0  # light comes from aside


@pytest.mark.parametrize("degrees", [30.0, 70.0, 110.0])
def test_a_folded_section_shows_the_true_angle(degrees):
    """By hand: light turns 35 mm before the lens, in the middle of the prism; the window's middle is 41 mm beyond."""
    prism = SIDE | {"deviation": math.radians(degrees), "azimuth": 0.7, "reflections": 1}
    window = {"kind": "plate", "distance": 75.0, "thickness": 2.0, "material": "N-BK7", "diameter": 30.0}
    design = PAPER.replace({"elements": [prism, window]})
    seen = instrument_scene(design, side=True)
    at = {part.name: part.points @ seen.view.axes.T for part in seen.parts}
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    np.testing.assert_allclose(at["plate 2"].mean(axis=0), (-35 - 41 * c, 41 * s, 0.0), atol=1e-9)
    assert np.ptp(at["sensor"][:, 0]) == pytest.approx(0.0, abs=1e-9)  # straight from the side
    picture = scale_drawing(design, 700.0)
    assert f"looks {degrees:g}° from straight ahead" in picture.title
    (panel,) = picture.panels
    assert panel.per_px[0] == pytest.approx(panel.per_px[1])
    assert all(-1e-6 <= x <= 700 + 1e-6 for mark in picture.marks if isinstance(mark, Area) for x in mark.x)
    # The FAP is seen from its edge, and left open: two lines with its diameter between them.
    edges = [mark for mark in picture.marks if isinstance(mark, Line) and (mark.width, mark.colour) == (2.4, "ink")]
    both = (np.column_stack([mark.x, mark.y])[np.isfinite(mark.x)] for mark in edges)  # the sensor, too
    (corners,) = (each for each in both if len(each) == 4)
    mm = 0.5 * seen.view.window[1] / seen.view.scale * 700 / seen.view.window[0]
    gaps = [np.hypot(*(one - other)) for one in corners[:2] for other in corners[2:]]
    assert min(gaps) == pytest.approx(design.D_F * mm, rel=1 - math.cos(math.pi / AROUND))  # of a polygon


def test_every_colour_of_the_scene_is_named_once():
    design = roslf.load("arthroscope")
    meshes = scene(design).meshes
    named = {mesh.label: mesh.colour for mesh in meshes.values() if mesh.label}
    parts = {"FAP", "main lens", "microlenses", "sensor", "around all parts", "liquid"}  # no [tube] is to that width
    assert parts | {"centre", "edge", "corner"} < set(named)
    colours = [named[label] for label in parts] + [meshes["prism 1"].colour]
    assert len(set(colours)) == len(colours) - 1  # the sensor is as dark as the FAP
    drawn = {key.text: key for key in outlines(instrument_scene(design)).keys}
    assert set(drawn) == set(named)


def test_a_prism_that_bends_the_axis_keeps_rays_and_tube_whole():
    """Both halves' tubes end in one ellipse, the plane between both directions; the middle ray turns on the axis."""
    turn = math.radians(30)
    design = PAPER.replace({"elements": [SIDE | {"deviation": turn}]})
    parts = {part.name: part for part in instrument_scene(design).parts}
    near, far = parts["tube"].points[:AROUND], parts["tube 2"].points[AROUND:]
    np.testing.assert_allclose(near, far, atol=1e-9)
    np.testing.assert_allclose(
        (near + np.array([0, 0, 35.0])) @ [-math.sin(turn / 2), 0.0, math.cos(turn / 2)], 0, atol=1e-9
    )
    middle = parts["rays centre"].points[cells(parts["rays centre"].cells)[0]]
    axis = np.array([-math.sin(turn), 0.0, math.cos(turn)])
    beyond = middle[middle[:, 2] < -35.0 - 1e-6] + np.array([0, 0, 35.0])
    assert len(beyond) > 1
    np.testing.assert_allclose(np.cross(beyond, axis), 0, atol=1e-9)


@pytest.mark.parametrize("reflections", [0, 1, 2])
@pytest.mark.parametrize("degrees", [125, 170, 179, 180])
def test_a_prism_that_looks_back_keeps_rays_and_tube_in_place(degrees, reflections):
    """Both tubes end in one ellipse of a mirror's plane, which each ray reaches and leaves."""
    prism = SIDE | {"deviation": math.radians(degrees), "reflections": reflections}
    design = PAPER.replace({"elements": [prism]})
    json.dumps(scene(design, "light"), allow_nan=False)
    parts = {part.name: part for part in instrument_scene(design).parts}
    normal = [math.cos(math.radians(degrees) / 2), 0.0, math.sin(math.radians(degrees) / 2)]
    middle = np.array([0.0, 0.0, -35.0])
    for points in (parts["tube"].points[:AROUND], parts["tube 2"].points[AROUND:]):
        np.testing.assert_allclose((points - middle) @ normal, 0, atol=1e-9)
    rays = parts["rays corner"]
    heights = [(rays.points[cell] - middle) @ normal for cell in cells(rays.cells)]
    assert {int((abs(height) < 1e-9).sum()) for height in heights} == {2}
    assert min(height.min() for height in heights) > -1e-9


@pytest.mark.parametrize("reflections", [1, 2])
@pytest.mark.parametrize("degrees", [90, 150, 180])
def test_a_prism_that_turns_back_is_one_that_turns_the_other_way(degrees, reflections):
    one, other = (
        instrument_scene(PAPER.replace({"elements": [SIDE | {"reflections": reflections} | turn]})).parts
        for turn in (
            {"deviation": -math.radians(degrees)},
            {"deviation": math.radians(degrees), "azimuth": math.pi},
        )
    )
    for mine, its in zip(one, other, strict=True):
        if "prism" not in mine.name:  # a block's corners come in another order
            np.testing.assert_allclose(mine.points, its.points, atol=1e-9)


def test_a_stated_tube_is_drawn_as_wide_and_as_long_as_stated():
    """And no farther: around what stays outside nobody states one; without a length it goes to the sensor."""
    scope = roslf.load("video-otoscope")
    for tube, ends in (
        ({"outer_diameter": 9.0, "wall": 0.2, "length": 2.0}, (9.0, 2.0)),
        ({"outer_diameter": 9.0, "wall": 0.2}, (9.0, None)),
    ):
        drawn = instrument_scene(scope.replace({"tube": tube}))
        (tip,) = (part for part in drawn.parts if part.name.startswith("tube") and part.label)
        assert tip.label == "tube"
        assert np.ptp(tip.points[:, 0]) == pytest.approx(ends[0])
        if ends[1] is not None:
            assert np.ptp(tip.points[:, 2]) == pytest.approx(ends[1])


def test_a_stated_tube_is_drawn_straight_to_the_prism_that_looks_out_of_its_side():
    """By hand: the fold stands 35 mm before the lens; the tube ends its radius ahead, 40 mm of light behind the tip."""
    window = {"kind": "plate", "distance": 50.0, "thickness": 2.0, "material": "N-BK7", "diameter": 10.0}
    prism = SIDE | {"deviation": math.radians(90), "reflections": 1}
    tube = {"outer_diameter": 36.0, "wall": 0.5, "length": 40.0}
    design = PAPER.replace({"elements": [prism, window], "tube": tube}, d_3=10.0)
    (tip,) = (part.points for part in instrument_scene(design).parts if part.label == "tube")
    assert np.ptp(tip[:, 0]) == pytest.approx(36.0)
    assert (tip[:, 2].min(), tip[:, 2].max()) == pytest.approx((-35 - 18, -52 + 40))
    assert not [part for part in instrument_scene(design.replace({"tube.length": 10.0})).parts if part.label == "tube"]
