"""The depth proof in small: its cameras, its own judgement of edges and bars, and two cameras that hold."""

import math

import numpy as np
import pytest
from scipy import ndimage

from roslf_design.camera import Camera
from roslf_design.depth.geometry import depth_of, disparity_of
from roslf_design.depth.measure import assumed
from roslf_design.design import load
from roslf_design.scenes import make_scene
from roslf_design.theory.stop_images import MicrolensImages
from studies.depth.depth_proof import BARS, LIGHTS, SCENES, WINDOW, aside_of_edges, judged, pooled, trials, view_of
from studies.depth.own_texture import on_one_surface, own_texture
from studies.depth.proof_cameras import FIELD, KEPT, cameras, place

SIDE = 14
"""Microlenses along each side: four windows."""


def test_cameras_are_drawn_from_the_ranges_that_are_stated():
    drawn = {name: camera for name, camera in cameras().items() if name.startswith("drawn")}
    assert len(cameras()) == 12 + 20 == 12 + len(drawn)
    layouts, colours = set(), set()
    for camera in drawn.values():
        design = camera.design
        assert 0.5 <= design.d**2 / (4 * design.wavelength * design.d_2) <= 6
        assert 8 <= design.d / design.sensor.pixel <= 50
        layouts.add(design.microlens_array.layout)
        colours.add(design.sensor.colours)
    assert layouts == {"square", "hexagonal"}
    assert colours == {"mono", "RGGB"}
    assert {element.kind for camera in drawn.values() for element in camera.design.elements} == {"plate", "lens"}
    assert sum(camera.design.main_lens.prescription is not None for camera in drawn.values()) == 4
    cut = [camera for camera in drawn.values() if camera.cut]
    assert len(cut) == 8
    for camera in cut:
        at = (FIELD * camera.design.sensor.size[0] / 2, 0.0)
        kept = float(MicrolensImages(Camera.of(camera.design), [at]).shapes.kept_fraction[0, 0])
        assert KEPT[0] - 1e-6 <= kept <= KEPT[1] + 1e-6
        assert abs(place(camera, np.random.default_rng(1))[0]) > 0.9 * at[0]


def made(windows, errors, sigma, predicted):
    """Figures as `judged` has them, of errors (exposure, window) whose microlenses are one window each."""
    return {
        "windows": windows, "exposures": len(errors), "spread": errors.std(0, ddof=1).mean(), "predicted": predicted,
        "over_predicted": errors.std(0, ddof=1).mean() / predicted,
        "bias": errors.mean(), "stays": 0.0, "within": (np.abs(errors) < sigma).mean(), "uneven": 0.0,
        "wanted": windows * WINDOW, "known": 1.0,
    }  # fmt: skip


def pooled_of(scale=1.0, offsets=(0.0, 0.0), sigma=1.0, windows=400):
    rng = np.random.default_rng(5)
    every = {
        f"scene {number}, bright": made(windows, offset + scale * rng.standard_normal((16, windows)), sigma, 1.0)
        for number, offset in enumerate(offsets)
    }
    return pooled(every)


def test_bars_see_what_misses_them_and_nothing_else():
    right = pooled_of()
    assert right.missed() == []
    assert right.within.value == pytest.approx(math.erf(math.sqrt(0.5)), abs=4 * right.within.error)
    assert right.bias.value < 0.05  # what chance makes of a mean of 6400 is 0.0125
    # Biases that cancel on the whole do not.
    opposite = pooled_of(offsets=(0.5, -0.5))
    assert abs(opposite.signed) < 0.05
    assert opposite.bias.value == pytest.approx(0.5, abs=0.05)
    assert opposite.missed(2.0) == ["bias"]
    assert "spread" in pooled_of(scale=1.5, sigma=1.5).missed(2.0)
    assert pooled_of(sigma=0.6).missed(2.0) == ["within"]
    few = pooled_of(scale=1.35, sigma=1.35, windows=2)
    assert few.spread.error > 0.1  # sixteen exposures of four windows
    assert pooled({"a, bright": {"wanted": 0, "known": None}}) is None


def tried(name, scene, lights, exposures=3):
    camera = cameras()[name]
    view = view_of(name, camera, scene, SIDE)
    return {f"{scene}, {light}": trial for light, trial in trials(camera, view, lights, exposures=exposures)}


def test_noise_of_each_camera_scene_and_light_is_its_own():
    """One noise for all makes one error of many, which pooled figures take for independent ones."""
    names, parts = ("paper", "drawn 18"), (1, 2)
    views = [view_of(name, cameras()[name], scene, part=part) for name in names for scene in SCENES for part in parts]
    seeds = [view.seed(light) for view in views for light in range(len(LIGHTS))]
    assert len({*seeds}) == len(seeds)
    assert seeds[0] == view_of("paper", cameras()["paper"], SCENES[0]).seed(0)


def test_cameras_hold_in_small(few_rays):
    trial = tried("paper", "step", ["dim"])["step, dim"]
    # Windows that are compared see one surface from all over the FAP: rays of thin lenses, by hand.
    design, z = trial.raw.design, trial.scene.objects[1].distance
    (x, _), (wide, _) = trial.scene.objects[1].centre, trial.scene.objects[1].size
    focal = -trial.first.x_ml[..., 0] * design.d_f / design.d_1
    rims = np.array([-1, 1])[:, None, None] * design.D_F / 2
    met = rims + (focal - rims) * (z - design.d_3) / (design.d_f - design.d_3)
    near = np.abs(met - x) < wide / 2
    single, half = aside_of_edges(trial), trial.first.disparities.window // 2
    assert 0.2 < single.mean() < 0.8
    for row, column in np.argwhere(single):
        seen = near[:, max(row - half, 0) : row + half + 1, max(column - half, 0) : column + half + 1]
        assert seen.all() or not seen.any()
    b = disparity_of(Camera.of(design), trial.true)
    assert b[single].min() == pytest.approx(-0.25, abs=1e-6)
    assert b[single].max() == pytest.approx(0.25, abs=1e-6)
    every = {"step, dim": judged(trial)}
    every |= {name: judged(one) for name, one in tried("paper", "near wall", ["bright", "dark"]).items()}
    verdict = pooled(every)
    assert list(verdict.missed(3.0)) == []
    assert verdict.known.value > BARS["known"].low


def test_windows_are_predicted_by_the_texture_that_they_have():
    """As slopes of what microlenses average have it, read from the texture itself; over many, as its waves."""
    design, finest = load("paper"), 0.4
    axis = np.arange(-10, 11) * design.d
    places, z = np.stack(np.meshgrid(axis, axis), -1), np.full((21, 21), design.d_f)
    step, fine = design.d * design.d_f / design.d_1, 8
    x = (np.arange(-10.5 * fine, 10.5 * fine + 1) / fine * step)[::-1]  # the image is upside down
    information = []
    for seed in range(4):
        scene = make_scene({
            "name": "wall",
            "objects": [{"kind": "plane", "texture": {"kind": "noise", "finest": finest, "seed": seed}}],
        })  # fmt: skip
        own = ndimage.uniform_filter(own_texture(design, scene, places, z), 5)
        texture = scene.objects[0].texture
        tile = texture.load()
        at = x / texture.width * len(tile) + len(tile) / 2 - 0.5
        seen = ndimage.map_coordinates(tile, np.meshgrid(at, at, indexing="ij"), order=1, mode="grid-wrap")
        whole = np.convolve(np.ones(fine - 1), [0.5, 0.5]) / fine
        down, along = (ndimage.convolve1d(seen, np.pad(whole, 1), axis=axis) for axis in (0, 1))
        left, right, top, low = down[:, :-1:fine], down[:, fine::fine], along[:-1:fine], along[fine::fine]
        edges = left[4::fine], right[4::fine], top[:, 4::fine], low[:, 4::fine]
        slopes = (edges[1] - edges[0]) ** 2 + (edges[3] - edges[2]) ** 2
        told = ndimage.uniform_filter(slopes / np.mean(edges, axis=0), 5)[2:-2, 2:-2]
        ratio = told / own[2:-2, 2:-2]
        assert ratio.std() / ratio.mean() < 0.03  # trapezia of an eighth of a pitch, for three nodes of Gauss
        information.append(float(own[2:-2, 2:-2].mean()))
    # Bilinear between samples, texture keeps 94 %; less light in places adds 5 %. Textures differ by a fifth.
    assert np.mean(information) == pytest.approx(0.99, abs=3 * 0.2 / math.sqrt(4))
    assert np.std(information) > 0.05


def test_detail_is_as_strong_in_the_dark_parts_of_a_texture_and_so_predicted_with_more_contrast():
    """The part's mean over white tells its contrast: brightness comes of coarse octaves, detail of fine ones."""
    wall = {"kind": "plane", "distance": 300.0, "texture": {"kind": "noise", "finest": 1.0, "contrast": 0.12}}
    scene = make_scene({"name": "wall", "objects": [wall]})
    texture = scene.surfaces[0].texture
    blocks = texture.load()[:480, :480].reshape(30, 16, 30, 16).swapaxes(1, 2).reshape(-1, 16, 16).astype(float)
    mean, order = blocks.mean((1, 2)), np.argsort(blocks.mean((1, 2)))
    detail = np.sqrt((np.diff(blocks, axis=1) ** 2).mean((1, 2)))
    dark, bright = order[:90], order[-90:]
    assert mean[dark].mean() < 0.85 * mean[bright].mean()
    assert detail[dark].mean() == pytest.approx(detail[bright].mean(), rel=0.05)
    contrasts = [assumed(load("paper"), scene, 5, float(mean[some].mean())).depth.contrast for some in (dark, bright)]
    assert contrasts[0] / contrasts[1] == pytest.approx(
        (detail[dark] / mean[dark]).mean() / (detail[bright] / mean[bright]).mean(), rel=0.06
    )
    assert assumed(load("paper"), scene, 5).depth.contrast == texture.contrast


@pytest.mark.parametrize("edge", np.linspace(-0.45, 0.5, 6))
def test_windows_beside_an_edge_have_the_microlenses_that_rays_from_all_over_the_fap_tell_of_one_surface(edge):
    """Against rays of thin lenses by hand, many of each microlens, counted one by one."""
    design, size, half = load("paper"), 15, 2
    axis = np.arange(-7, 8) * design.d
    places = np.stack(np.meshgrid(axis, axis), -1)
    near, far = (float(depth_of(Camera.of(design), np.asarray(b))) for b in (0.25, -0.25))

    def met(x, rim, z):
        """Where light of a place on the array meets a plane, from places on the FAP along x [mm]."""
        focal = -x * design.d_f / design.d_1
        return rim + (focal - rim) * (z - design.d_3) / (design.d_f - design.d_3)

    start = met(edge * design.d, 0.0, near)
    noise = {"kind": "noise", "finest": 0.5}
    scene = make_scene({"name": "step", "objects": [
        {"kind": "plane", "distance": far, "texture": noise},
        {"kind": "plane", "distance": near, "size": [80, 80], "centre": [start + 40, 0], "texture": noise},
    ]})  # fmt: skip
    z = np.where(met(places[..., 0], 0.0, near) > start, near, far)
    told = on_one_surface(design, scene, places, z)
    across, rim = np.linspace(-0.5, 0.5, 17) * design.d, np.linspace(-0.5, 0.5, 17) * design.D_F
    shows = met(axis[:, None, None] + across[:, None], rim, near) > start
    whole = [{*one.ravel().tolist()} for one in shows]  # of each column: of the nearer, of the farther, or both
    alone = [len(set.union(*whole[max(at - 1, 0) : at + 2])) == 1 for at in range(size)]
    for column in range(half, size - half):
        count = told[half - 2 : half + 3, column - half : column + half + 1].sum()
        assert count == 5 * sum(alone[column - half : column + half + 1])
    assert 2 <= size - sum(alone) <= 4
    assert on_one_surface(design, scene, places, np.full_like(z, far)).all()
