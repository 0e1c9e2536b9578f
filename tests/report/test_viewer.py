"""The 3D scene: geometry against formulas, the picture against the geometry, and the page in a real browser."""

import base64
import io
import json
import math
import re
import shutil
import zipfile

import numpy as np
import pytest

from roslf_design.design import load
from roslf_design.report.blocks import Report, Section
from roslf_design.report.figures.scene_outlines import outline
from roslf_design.report.html import render_html
from roslf_design.report.meshes import AROUND, MAKERS, across, mesh_of
from roslf_design.report.scene3d import instrument_scene
from roslf_design.report.sheets import picture_sheet
from roslf_design.report.viewer import library, packed, scene_data
from tests.report.test_figures import DESIGNS

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = (
    *("--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-sync"),
    *("--disable-component-update", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
)
TILTED = [0.3, -0.2, 0.9]


def area(mesh):
    """Of all quadrangles, each as two triangles."""
    a, b, c, d = (mesh.points[mesh.faces[:, k]] for k in range(4))
    return sum(np.linalg.norm(np.cross(q - p, r - p), axis=1).sum() / 2 for p, q, r in ((a, b, c), (a, c, d)))


def test_parts_are_as_large_as_their_formulas_say():
    ring = {"kind": "ring", "inner": 1.0, "outer": 2.0, "centre": [1, 2, 3], "normal": TILTED}
    tube = {"kind": "tube", "centre": [0, 0, 0], "from": -1.0, "to": 4.0, "radius": 2.0}
    plate = {"kind": "plate", "centre": [1, 0, 0], "normal": TILTED, "size": [3.0, 2.0]}
    ball = {"kind": "ellipsoid", "centre": [1, 0, 0], "radius": 2.0, "thickness": 2.0}
    polygon = math.sin(2 * math.pi / AROUND) * AROUND / 2  # a regular polygon's area for radius 1
    assert area(mesh_of(ring)) == pytest.approx((2**2 - 1**2) * polygon, rel=1e-12)
    assert area(mesh_of(tube)) == pytest.approx(5 * AROUND * 2 * 2 * math.sin(math.pi / AROUND), rel=1e-12)
    assert area(mesh_of(plate)) == pytest.approx(6, rel=1e-12)
    # A sphere of flat faces is smaller by terms of second order in 2 pi / AROUND and pi / RINGS.
    assert area(mesh_of(ball)) == pytest.approx(4 * math.pi * 4, rel=1e-2)


def test_flat_parts_lie_in_their_planes_and_normals_are_those_of_the_surface():
    u, v = across(TILTED)
    assert np.array([u @ u, v @ v, u @ v, u @ TILTED, v @ TILTED]) == pytest.approx([1, 1, 0, 0, 0], abs=1e-15)
    assert np.allclose(across([1, 0, 0]), ([0, 1, 0], [0, 0, 1]))
    ring = mesh_of({"kind": "ring", "inner": 1.0, "outer": 2.0, "centre": [1, 2, 3], "normal": TILTED})
    np.testing.assert_allclose((ring.points - [1, 2, 3]) @ TILTED, 0, atol=1e-14)
    lens = mesh_of({"kind": "ellipsoid", "centre": [0, 0, 0], "radius": 2.0, "thickness": 0.5})
    gradient = lens.points / np.array([4.0, 4.0, 0.25])
    np.testing.assert_allclose(lens.normals, gradient / np.linalg.norm(gradient, axis=1, keepdims=True), atol=1e-12)


@pytest.mark.parametrize("name", ["paper", "strange", "at the lens"])
def test_every_part_of_a_scene_can_be_built(name):
    for part in instrument_scene(DESIGNS[name]).data["parts"]:
        mesh = MAKERS[part["kind"]](part)
        assert np.isfinite(mesh.points).all()
        corners = np.concatenate([mesh.faces.ravel(), *mesh.lines])
        assert 0 <= corners.min() <= corners.max() == len(mesh.points) - 1


def test_outlines_hold_every_point_and_turn_left_throughout():
    points = np.random.default_rng(1).normal(size=(200, 2))
    hull = outline(points)
    edges = np.roll(hull, -1, axis=0) - hull
    away = points[:, None, :] - hull[None]
    # Left of every edge, or on it.
    assert (edges[None, :, 0] * away[..., 1] - edges[None, :, 1] * away[..., 0] >= -1e-12).all()
    assert {tuple(point) for point in hull} <= {tuple(point) for point in points}


def test_the_packed_scene_is_the_scene_and_always_the_same():
    scene = instrument_scene(load("paper"))
    text = packed(scene.data["parts"], scene.data["camera"])
    assert text == packed(scene.data["parts"], scene.data["camera"])
    with zipfile.ZipFile(io.BytesIO(base64.b64decode(text))) as archive:
        index = json.loads(archive.read("index.json"))
    (renderer,) = index["scene"]["dependencies"]
    actors = [child for child in renderer["dependencies"] if child["type"] == "vtkActor"]
    assert len(actors) == len(scene.data["parts"])
    for actor, part in zip(actors, scene.data["parts"], strict=True):
        (geometry,) = actor["dependencies"][0]["dependencies"]
        stored = index["hashes"][geometry["properties"]["points"]["hash"]]["content"]
        found = np.frombuffer(base64.b64decode(stored), np.float32).reshape(-1, 3)
        np.testing.assert_array_equal(found, mesh_of(part).points.astype(np.float32))
    near, far = renderer["dependencies"][0]["properties"]["clippingRange"]
    assert 0 < near < far


def test_a_scene_cannot_end_its_script_element():
    scene = instrument_scene(load("paper"))
    nasty = scene._replace(names=(scene.names[-1]._replace(text="</script><b>"),))
    assert "</script" not in scene_data(nasty)
    assert json.loads(scene_data(nasty))["names"][0]["text"] == "</script><b>"


def test_the_library_refers_to_no_other_place():
    import gzip

    page = gzip.decompress(base64.b64decode(library())).decode()
    assert not re.search(r"<(link|script|img)[^>]+(href|src)=", page)
    assert "kitware.github.io/vtk-js/icon" not in page


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium; on Debian: apt-get install chromium")
def test_the_page_turns_the_scene_in_a_browser_without_a_network(tmp_path):
    api = pytest.importorskip("playwright.sync_api", reason="the playwright package is not installed")
    (tmp_path / "index.html").write_text(
        render_html(Report("a", "", (Section("Rays", (picture_sheet(load("rigid-scope")),)),)))
    )
    asked, complaints = [], []
    with api.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        page = browser.new_page(viewport={"width": 1000, "height": 800})
        page.on("request", lambda request: asked.append(request.url))
        page.on("console", lambda message: complaints.append(message.text))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.goto((tmp_path / "index.html").as_uri())
        still = page.locator("#figure-view .drawing")
        assert still.is_visible()
        page.get_by_role("button", name="Turn it in 3D").click()
        page.wait_for_selector("figure[data-turned]")
        assert not still.is_visible()
        assert page.locator(".live .names span").all_text_contents() == ["FAP", "main lens", "MLA and sensor"]
        drawn = page.locator(".live").screenshot()
        page.get_by_role("button", name="From the object").click()
        page.wait_for_timeout(300)
        turned = page.locator(".live").screenshot()
        page.get_by_role("button", name="As in the picture").click()
        page.wait_for_timeout(300)
        again = page.locator(".live").screenshot()
        page.emulate_media(media="print")
        assert still.is_visible()
        assert not page.locator(".live").is_visible()
        page.emulate_media(media="screen")
        page.get_by_role("button", name="Back to the picture").click()
        assert still.is_visible()
        assert page.locator("iframe").count() == 0
        browser.close()
    assert colours(drawn) > 100  # shaded and blended: an empty view has two
    assert differing(drawn, turned) > 0.02
    assert differing(drawn, again) < 0.005
    assert complaints == []
    assert [url for url in asked if not url.startswith(("file:", "blob:", "data:", "about:"))] == []


def pixels(png):
    from PIL import Image

    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)


def colours(png):
    return len(np.unique(pixels(png).reshape(-1, 3), axis=0))


def differing(one, other):
    """Share of pixels that differ visibly."""
    return float(np.mean(np.abs(pixels(one) - pixels(other)).max(axis=-1) > 16))
