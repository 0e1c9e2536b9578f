"""`roslf render --accuracy`: pixels within what was promised, and told so with the picture."""

import json

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.accuracy.picture import left_out, settle, stated
from roslf_design.cli import main
from roslf_design.effects import Budget, plan
from roslf_design.imaging.camera import Region, pixel_centres, planned_camera
from roslf_design.imaging.render import render
from roslf_design.imaging.trace import RaySampling
from roslf_design.imaging.transfer import MicrolensTransfer
from roslf_design.imaging.white import harmonic_series
from roslf_design.scenes import WHITE_FIELD, Plane, Scene, Sinusoid, make_scene
from studies.accuracy.pictures import cameras, try_picture

PAPER = roslf.load("paper")
REGION = (2000, 1300, 32, 26)
"""Of 2.5 x 2 microlenses: its eight worst pixels are beyond the quantile that is promised."""
BOARD = make_scene(
    {
        "name": "board",
        "objects": [{"kind": "plane", "distance": 300.0, "texture": {"kind": "checkerboard", "period": 4.0}}],
    }
)
SHARP = ("-microlens_diffraction", "-microlens_defocus")


@pytest.mark.parametrize("overrides", [SHARP, ()])
def test_pixels_are_within_what_was_promised(overrides, near_light):
    """Reference: 512 rays a pixel of another seed, some times better than what is judged."""
    accuracy = 0.03
    way = settle(PAPER, BOARD, accuracy, overrides, region=REGION)
    image = render(PAPER, BOARD, effects=way.plan, budget=way.budget, sampling=way.sampling, region=REGION)
    many = RaySampling(512, 512, 0.0, 9)
    truth = render(PAPER, BOARD, effects=way.plan, budget=way.budget, sampling=many, region=REGION)
    off = np.abs(image.pixels.astype(float) - truth.pixels)
    assert np.quantile(off, 0.99) <= way.expected_error <= accuracy
    told = stated(image, way, accuracy, way.budget)
    assert told.kept
    assert told.measured_error is not None
    assert 0.2 < told.measured_error / np.quantile(off, 0.99) < 4


@pytest.mark.parametrize(("name", "by_budget"), [("hexagonal", True), ("cut", False), ("cut", True), ("round", False)])
def test_promises_are_kept_on_random_pictures(name, by_budget, near_light):
    """A few of the pictures that `studies/accuracy/pictures.py` tries."""
    one = try_picture(name, cameras()[name], np.random.default_rng(5), by_budget=by_budget)
    assert 0 < one.error <= one.asked


def test_less_accuracy_takes_fewer_rays_and_errors_stay_within_it(near_light):
    rays = []
    for intensity in (0.04, 0.01, 0.0025):
        given = {"region": (2000, 1300, 60, 60), "overrides": ["-noise"], "budget": Budget(intensity=intensity)}
        image, truth = (render(PAPER, BOARD, sampling=one, **given) for one in (None, RaySampling(512, 512, 0.0, 9)))
        assert np.quantile(np.abs(image.pixels.astype(float) - truth.pixels), 0.99) <= 2 * intensity
        rays.append(image.rays)
    assert rays[0] < 0.8 * rays[1] < 0.5 * rays[2]


def test_effects_left_out_take_half_of_the_accuracy_at_most():
    for accuracy in (0.3, 1e-3):
        way = settle(PAPER, WHITE_FIELD, accuracy)
        assert left_out(way.plan) <= accuracy / 2
        everything = render(PAPER, WHITE_FIELD, effects=plan(PAPER, WHITE_FIELD, overrides=["all"]), region=REGION)
        image = render(PAPER, WHITE_FIELD, effects=way.plan, region=REGION)
        off = np.abs(image.pixels.astype(float) - everything.pixels)
        assert np.quantile(off, 0.99) <= way.expected_error
    assert settle(PAPER, WHITE_FIELD, 1e-5).plan.on("microlens_defocus")  # 9e-5 px: above half of 1e-5


def test_series_in_single_precision_is_within_its_rounding():
    way = settle(PAPER, WHITE_FIELD, 1e-3, ["-cos4"])
    assert way.method == "harmonics"
    image = render(PAPER, WHITE_FIELD, effects=way.plan, region=REGION).pixels

    seen = planned_camera(PAPER, way.plan)
    series = harmonic_series(seen, MicrolensTransfer.of(seen, way.plan))
    x, y = pixel_centres(seen, Region(*REGION))
    phase = np.exp(2j * np.pi * np.multiply.outer(series.frequencies[:, 1], y - series.origin[1]))
    wave = np.exp(2j * np.pi * np.multiply.outer(series.frequencies[:, 0], x - series.origin[0]))
    exact = np.einsum("g,gy,gx->yx", series.coefficients, phase, wave).real
    assert np.abs(image - exact).max() < 3e-6


def test_a_real_lens_takes_more_samples_for_more_accuracy(near_light):
    singlet = roslf.load("paper-singlet")
    way = settle(singlet, WHITE_FIELD, 0.02, SHARP, region=REGION)
    assert way.sampling.side >= 4
    image = render(singlet, WHITE_FIELD, effects=way.plan, sampling=way.sampling, region=REGION)
    fine = render(singlet, WHITE_FIELD, effects=way.plan, sampling=RaySampling(side=16), region=REGION)
    assert np.quantile(np.abs(image.pixels.astype(float) - fine.pixels), 0.99) <= way.expected_error <= 0.02


def test_the_command_tells_it_and_writes_the_same_bytes(tmp_path, capsys, near_light):
    scene = tmp_path / "scene.toml"
    scene.write_text(
        'name = "grating"\n[[objects]]\nkind = "plane"\ndistance = "300 mm"\n'
        '[objects.texture]\nkind = "sinusoid"\nperiod = "4 mm"\n'
    )
    files = []
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        place = tmp_path / name / "image.tif"
        line = ["render", "paper", "--scene", str(scene), "--region", "2000,1300,26,26", "-o", str(place)]
        assert main([*line, "--accuracy", "0.05", "--json"]) == 0
        told = json.loads(capsys.readouterr().out)["accuracy"]
        assert told["seconds"] > 0
        assert told["kept"]
        assert told["expected_error"] <= told["asked"] == 0.05
        assert told["measured_error"] <= 0.05
        assert "rays a pixel" in told["method"]
        assert "incoherent" in told["model_error"]
        files.append([place.read_bytes(), place.with_suffix(".json").read_bytes()])
    assert files[0] == files[1]
    assert json.loads(files[0][1])["accuracy"]["asked"] == 0.05


def test_without_one_the_budgets_say_what_to_expect(tmp_path, capsys):
    place = tmp_path / "white.tif"
    assert main(["render", "paper", "--region", "0,0,40,40", "-o", str(place)]) == 0
    assert "99 of 100 pixels known to ±" in capsys.readouterr().out
    told = json.loads(place.with_suffix(".json").read_text())["accuracy"]
    assert told["asked"] is None
    assert 0 < told["expected_error"] < 1e-3


@pytest.mark.parametrize("value", ["-1", "nan", "fine"])
def test_no_accuracy_is_one_line_and_no_file(value, tmp_path, capsys):
    assert main(["render", "paper", "--accuracy", value, "-o", str(tmp_path / "x.tif")]) == 2
    told = capsys.readouterr().err
    assert "--accuracy" in told
    assert len(told.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_out_of_reach_is_said_before_anything_is_done(tmp_path, capsys):
    scene = tmp_path / "scene.toml"
    scene.write_text('name = "b"\n[[objects]]\nkind = "plane"\ndistance = "300 mm"\n'
                     '[objects.texture]\nkind = "checkerboard"\nperiod = "4 mm"\n')  # fmt: skip
    line = ["render", "paper", "--scene", str(scene), "-o", str(tmp_path / "x.tif"), "--accuracy", "1e-5"]
    assert main(line) == 2
    told = capsys.readouterr().err
    assert "out of reach" in told
    assert "ask for" in told
    assert not (tmp_path / "x.tif").exists()
    assert main(["render", "paper", "--accuracy", "0.1", "--budget-px", "0.1", "-o", str(tmp_path / "x.tif")]) == 2
    assert "--budget-px" in capsys.readouterr().err


@pytest.mark.parametrize(("fill", "percent"), [(1.0, "2.1 %"), (3.0, "15 %")])
def test_what_incoherent_light_misses_of_a_texture_is_told_of_each_camera(fill, percent, near_light):
    """0.04/sqrt(3.61) = 0.021; three images on one another, 3 (0.021 + 0.1/3.61) = 0.146."""
    design = PAPER.replace(d_3=100.0, D_F=3.15 * fill)
    scene = Scene(objects=(Plane(texture=Sinusoid(period=0.63)),))
    image = render(design, scene, region=(2280, 1520, 2, 2), sampling=RaySampling(4, 4, 0.0))
    assert f"up to {percent} rms of a full-contrast grating of 4 " in stated(image, None, None, Budget()).model


def test_interference_left_out_is_told_with_white_images():
    """Three per cent behind round microlenses; nothing where no diffraction spreads light over neighbours."""
    design = PAPER.replace({"microlens_array.lens_shape": "circular"})
    white, sharp = (render(design, region=(0, 0, 4, 4), overrides=way) for way in ((), ("-microlens_diffraction",)))
    assert (
        "interference of neighbouring microlenses, left out, changes pixels by up to 0.029"
        in stated(white, None, None, Budget()).model
    )
    assert not stated(sharp, None, None, Budget()).model
