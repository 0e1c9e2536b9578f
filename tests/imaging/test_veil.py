"""Veiling light: the same electrons in every pixel of every picture, and what they leave of contrast and depth."""

from dataclasses import replace

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.calibration.raw import from_raw
from roslf_design.camera import Camera
from roslf_design.depth.measure import simulate
from roslf_design.depth.pictures import PictureOptions
from roslf_design.effects import Budget, plan
from roslf_design.imaging.files import write_image
from roslf_design.imaging.render import render
from roslf_design.scenes import Checkerboard, Noise, Plane, Scene, SceneLight
from roslf_design.theory.photometry import electrons
from roslf_design.traced.fields import images_of

PAPER = roslf.load("paper")
HAZY = PAPER.replace({"light.veil": 0.04})
REGION = (2200, 1500, 96, 80)
BOARD = Scene(objects=(Plane(texture=Checkerboard(period=1.0)),))


def level(design, lit=None):
    """Veil over a fully lit pixel, by hand."""
    return design.light.veil * design.sensor.full_well / (float(electrons(Camera.of(design))) if lit is None else lit)


@pytest.mark.parametrize(("scene", "lit"), [
    (Scene(), None), (BOARD, None), (Scene(light=SceneLight(exposure=3000.0)), 3000.0),
])  # fmt: skip
def test_pictures_get_the_veil_once(near_light, scene, lit):
    """White and textured alike; rays of both pictures are the same, so that only rounding differs."""
    clear, hazy = (render(one, scene, region=REGION, overrides=["-noise"]).pixels for one in (PAPER, HAZY))
    np.testing.assert_allclose(hazy - clear, level(HAZY, lit), atol=3e-6)
    assert level(HAZY, lit) > 0.01


def test_its_shot_noise_is_in_pictures():
    """Variance over mean is one electron; 7,680 pixels tell it to 1.6 %, four standard errors are allowed."""
    scene = Scene(light=SceneLight(exposure=3000.0))
    clear = render(HAZY, scene, region=REGION, overrides=["-noise", "+veil"]).pixels
    noisy = render(HAZY, scene, region=REGION, overrides=["+noise"], seed=3).pixels
    assert np.mean(3000 * (noisy - clear) ** 2 / clear) == pytest.approx(1.0, abs=0.065)


def test_the_plan_says_its_size_and_never_leaves_it_out():
    """However small: captures of such a design have it taken off."""
    assert plan(HAZY)["veil"].estimate == pytest.approx(level(HAZY))
    assert plan(HAZY)["veil"].on
    assert not plan(PAPER)["veil"].on
    assert plan(HAZY, budget=Budget(intensity=0.2), overrides=["none"])["veil"].on
    with pytest.raises(roslf.InputError, match=r"light\.veil"):
        plan(PAPER, overrides=["+veil"])


@pytest.mark.parametrize("design", [PAPER, roslf.load("paper-singlet")], ids=["ideal", "real"])
def test_contrast_falls_by_the_veil_over_the_mean(design):
    """On the axis, where a view's mean is a fully lit pixel: by 1/(1 + V/N), in limits as in the transfer itself."""
    hazy = design.replace({"light.veil": 0.04})
    clear, veiled = (images_of(one, [(0.0, 0.0)]).transfer(0, None) for one in (design, hazy))
    left = 1 / (1 + level(hazy))
    at = np.array([0.0, 0.5, 2.0, 4.0])
    for kind in ("view", "refocused"):
        expected = clear(at, kind, "tangential") * [1.0, left, left, left]
        np.testing.assert_allclose(veiled(at, kind, "tangential"), expected, rtol=1e-9)
        limit = veiled.limits([0.5], kind, "tangential")[0]
        assert clear(np.array([limit]), kind, "tangential")[0] == pytest.approx(0.5 / left, abs=2e-3)  # limits: 1e-3
    blind = images_of(design.replace({"light.veil": 0.6}), [(0.0, 0.0)]).transfer(0, None)
    assert blind.limits([0.5], "refocused", "tangential") == [0.0]


def test_resolution_in_studies_is_that_of_the_sheet():
    quantity = roslf.quantity("mtf50_lp_per_mm")
    sheet = next(r for r in roslf.specification(HAZY).resolution if r.x_ml_mm == (0.0, 0.0) and r.image == "refocused"
                 and r.at_mm == pytest.approx(230.0))  # fmt: skip
    assert float(quantity(Camera.of(HAZY))) == pytest.approx(sheet.mtf50_lp_per_mm, rel=1e-3)
    assert float(quantity(Camera.of(HAZY.replace({"light.veil": 0.6})))) == 0.0


def test_simulated_depth_has_its_noise(near_light):
    """Errors told grow as the Fisher information says, to 5 % (chance of ten windows), and nothing is lost or moved.

    Few rays would scatter more than that.
    """
    options = PictureOptions(region=(2150, 1450, 260, 160))
    scene = Scene(objects=(Plane(tilt=(0.0, 0.3), texture=Noise(finest=0.4, contrast=0.2, seed=1)),))
    trials = [simulate(PAPER, scene, options)]
    trials += [simulate(PAPER.replace({"light.veil": 0.1}), scene, options, again=trials[0])]
    clear, hazy = (trial.summary() for trial in trials)
    assert hazy.predicted_mm > 1.1 * clear.predicted_mm
    assert hazy.told_mm / clear.told_mm == pytest.approx(hazy.predicted_mm / clear.predicted_mm, rel=0.05)
    assert hazy.measured == 1.0
    assert abs(hazy.bias_mm - clear.bias_mm) < hazy.told_mm
    assert trials[1].brightest == pytest.approx(trials[0].brightest + 0.1)
    blind = simulate(PAPER.replace({"light.veil": 0.99}), scene, options, again=trials[0])
    assert set(blind.unknown()) == {"saturated"}


def test_a_veil_that_the_design_has_is_taken_off_captures(near_light, tmp_path):
    """Raw image and white with a veil decode to what they decode to without; to rounding of floats."""
    files = {}
    for name, design in (("clear", PAPER), ("hazy", HAZY)):
        for kind, scene in (("white", Scene()), ("raw", BOARD)):
            image = render(design, scene, region=REGION)
            write_image(replace(image, design=HAZY), files.setdefault((name, kind), tmp_path / f"{name}-{kind}.tif"))
    clear = from_raw(files["clear", "raw"], files["clear", "white"], None, PAPER, print)
    hazy = from_raw(files["hazy", "raw"], files["hazy", "white"], None, HAZY, print)
    lit = clear.field.weight > 0.2
    np.testing.assert_allclose(hazy.field.values[lit], clear.field.values[lit], atol=2e-3)
