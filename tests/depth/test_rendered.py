"""Depth in a picture that `render` made of a scene with an exposure, by the rays that it takes by itself."""

from dataclasses import replace

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.accuracy.picture import BELOW_NOISE, stated
from roslf_design.effects import Budget, Plan
from roslf_design.imaging.files import write_image
from roslf_design.imaging.trace import RaySampling
from roslf_design.reporting.depth.captured import capture_answers, capture_basis
from roslf_design.reporting.depth.pages import measurement_pictures, statements
from roslf_design.scenes import Noise as Texture
from roslf_design.scenes import Plane, Scene, make_scene
from roslf_design.words import length, number

REGION = (2100, 1420, 420, 200)
"""32 x 15 microlenses of the paper's camera."""
NEAR, FAR = 342.0, 352.0
ELECTRONS, READ = 6000.0, 2.5
LIGHT = {"exposure": ELECTRONS, "read_noise": READ}


def step(**light):
    """A wall, and a nearer one before its half at x > 0."""
    texture = {"kind": "noise", "finest": 0.5}
    far = {"kind": "plane", "distance": FAR, "texture": texture}
    near = {"kind": "plane", "distance": NEAR, "centre": (10.0, 0.0), "size": (20.0, 40.0)}
    return make_scene({"objects": [far, near | {"texture": texture | {"seed": 3}}], "light": LIGHT | light})


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """raw.tif by default, few.tif by so few rays that they scatter more than light, white.tif."""
    place = tmp_path_factory.mktemp("rendered")
    few = RaySampling(least=4, most=4, tolerance=1.0)
    for name, scene, sampling in (("raw", step(), None), ("few", step(), few), ("white", None, None)):
        image = roslf.render("paper", scene, region=REGION, sampling=sampling)
        told = stated(image, None, None, Budget()).to_dict()
        write_image(replace(image, accuracy=told), place / f"{name}.tif")
    return place


def test_depth_in_a_rendered_step_agrees_with_the_scene(folder):
    found = roslf.capture_depth(folder / "raw.tif", white=folder / "white.tif", design="paper")
    assert found.noise.times == 1.0
    run = found.first
    # Which wall a microlens looks at is told by its depth; at the step a window sees both.
    near = run.depth < (NEAR + FAR) / 2
    for side, distance in ((near, NEAR), (~near & np.isfinite(run.depth), FAR)):
        inner = side & (np.lib.stride_tricks.sliding_window_view(np.pad(side, 2), (5, 5)).all((2, 3)))
        off = (run.depth - distance)[inner] / run.sigma[inner]
        assert inner.sum() > 100
        assert abs(off.mean()) < 3 / np.sqrt(off.size / found.first.disparities.window**2)
        assert np.sqrt((off**2).mean()) < 1.5


def test_noise_of_few_rays_is_told_as_that_of_the_rendering(folder):
    found = roslf.capture_depth(folder / "few.tif", white=folder / "white.tif", design="paper")
    told = found.to_dict()["noise"]
    assert told["times_believed"] > 1.2
    level = found.noise.scale
    assert told["stated_electrons"] == pytest.approx(ELECTRONS * level, rel=1e-6)
    assert told["stated_read_noise"] == pytest.approx(READ, rel=1e-6)
    assert told["electrons"] == pytest.approx(ELECTRONS * level / told["times_believed"] ** 2, rel=1e-6)
    words = str([*capture_answers(found), *capture_basis(found)])
    assert "rays that the picture was rendered with leave up to 2 %" in words
    assert "say in [sensor]" not in words
    assert f"{number(ELECTRONS * level, 4)} electrons in a pixel as bright as most, 2.5 read noise" in words


@pytest.mark.parametrize(
    ("name", "size", "share"),
    [("paper", 40, 1.0), ("rigid-scope", 40, 1.0), ("ear-speculum", 32, 1.0), ("paper", 40, 0.5)],
)
def test_rays_scatter_by_less_than_a_third_of_the_noise(monkeypatch, name, size, share):
    """A wall in focus in even light; one at half the distance, which a source in the tip lights four times as much."""
    design = roslf.load(name)
    tip = float(roslf.Camera.of(design).tip)
    place = {} if share == 1 else {"distance": tip + share * (design.d_f - tip)}
    if place:
        design = design.replace({"light.measured_at": 150.0})
    monkeypatch.setattr(Plan, "drawn", property(lambda plan: ()))  # the picture as it is before noise
    width, height = design.pixels
    part = ((width - size) // 2, (height - size) // 2, size, size)
    finest = 2.5 * float(roslf.quantity("object_sample_mm")(roslf.Camera.of(design)))
    wall = Scene.model_validate({"objects": (Plane(texture=Texture(finest=share * finest), **place),), "light": LIGHT})
    one, other = (roslf.render(design, wall, region=part, seed=seed).pixels.astype(float) for seed in (1, 2))
    mean = (one + other) / 2
    lit = mean > 0.1 * np.quantile(mean, 0.99)
    assert mean[lit].mean() * share**2 == pytest.approx(0.5, abs=0.15)
    noise = np.sqrt(mean[lit] * ELECTRONS + READ**2) / ELECTRONS
    scatter = np.sqrt((((one - other)[lit] ** 2) / 2).mean())
    assert scatter < BELOW_NOISE * np.sqrt((noise**2).mean())
    # What is taken off before, and given back by the white picture, leaves no trace.
    many = roslf.render(design, wall, region=part, seed=3, sampling=RaySampling(128, 128, 0.0)).pixels
    assert abs((mean - many)[lit].mean()) < 0.002 * mean[lit].mean()


def test_a_budget_by_hand_and_scenes_without_noise_are_sampled_as_before():
    part = (2240, 1480, 24, 24)
    by_hand = [{"budget": Budget(intensity=share)} for share in (0.01, 0.02)]  # 1 % is also what none given stands for
    for options in (*by_hand, {"overrides": ["-noise"]}):
        image = roslf.render("paper", step(), region=part, **options)
        tolerance = options.get("budget", Budget()).of("intensity")
        same = roslf.render("paper", step(), region=part, sampling=RaySampling(tolerance=tolerance), **options)
        assert image.pixels.tobytes() == same.pixels.tobytes()


def test_distances_are_told_ahead_of_the_tip_and_from_the_lens(folder):
    found = roslf.capture_depth(folder / "raw.tif", white=folder / "white.tif", design="paper")
    tip = 120.0  # the FAP is the foremost opening of the paper's camera
    near, far = np.quantile(found.first.depth[found.first.measured], (0.01, 0.99))
    words = str(capture_answers(found))
    assert f"between {near - tip:.4g} and {far - tip:.4g} mm ahead of the tip" in words
    assert f" ({near:.5g} and {far:.5g} mm from the main lens)" in words
    told = found.to_dict()
    assert told["tip_mm"] == tip
    assert all(one["ahead_of_tip_mm"] == pytest.approx(one["depth_mm"] - tip) for one in told["points"])
    drawn = measurement_pictures(found)
    assert "ahead of the tip [mm]" in drawn["map"].svg()
    assert "ahead of the tip [mm]" in drawn["profile"].svg()
    assert "from lens" not in drawn["map"].svg()


def test_a_field_of_a_few_patches_is_not_drawn_and_other_textures_are_named_where_numbers_are_compared():
    trial = roslf.measure_depth("paper", region=(2240, 1480, 110, 110), rays=8)
    assert "over the field" not in measurement_pictures(trial)["errors"].svg()
    (text,) = (line.text for line in statements(trial) if line.text.startswith("Is it as predicted?"))
    design, texture = roslf.load("paper"), trial.scene.objects[0].texture
    own = roslf.Camera.of(design)
    here = roslf.Camera.of(trial.texture)
    noise = roslf.quantity("sigma_z_mm")
    assert f"{float(noise(own)):.2g} mm in the middle" in text
    assert f"makes it {float(noise(here)):.2g} mm" in text
    assert f"finer than {length(texture.finest)}" in text
