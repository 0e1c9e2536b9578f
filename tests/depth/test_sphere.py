"""The sphere that depths fit best, against spheres that they lie on, and how the page tells it."""

from dataclasses import replace

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.depth.measure import simulate
from roslf_design.depth.pictures import PictureOptions
from roslf_design.depth.sphere import SphereFit
from roslf_design.reporting.depth.pages import measurement_pictures, sphere_line, statements
from roslf_design.scenes import make_scene
from roslf_design.theory.photometry import electrons, exposure
from tests.depth.made import at_first_sight, fewer_rays

BALL = {"kind": "sphere", "distance": 355.0, "radius": 5.0, "centre": (0.4, -0.2)}
TEXTURE = {"kind": "noise", "finest": 0.4, "contrast": 0.1, "seed": 1}


def places(count=41, half=4.0):
    x, y = np.meshgrid(np.linspace(-half, half, count), np.linspace(-half, half, count))
    return x.ravel(), y.ravel()


def on_sphere(x, y, radius, centre):
    """Z of the near side, or of a hollow one's far side."""
    down = np.sqrt(radius**2 - (x - centre[0]) ** 2 - (y - centre[1]) ** 2)
    return centre[2] - np.copysign(down, radius)


@pytest.mark.parametrize("radius", [12.0, -12.0, 300.0, -6.0])
@pytest.mark.parametrize("off", [(0.0, 0.0), (1.5, -0.7)])
def test_points_on_a_sphere_give_its_radius_and_heights(radius, off):
    x, y = places()
    x, y = x / 2 + 3, y / 2
    centre = (3 + off[0], off[1], 70 + radius)
    z = on_sphere(x, y, radius, centre)
    fit = SphereFit.of(np.stack([x, y, z], -1), np.full(x.size, 0.01), 25.0)
    assert fit.radius == pytest.approx(radius, rel=1e-6)
    assert fit.rms < 1e-8
    np.testing.assert_allclose(fit.height(x, y), z, atol=1e-8)


def test_a_plane_has_no_curvature_and_few_points_no_sphere():
    x, y = places()
    points = np.stack([x, y, 60 + 0.2 * x - 0.1 * y], -1)
    fit = SphereFit.of(points, np.full(x.size, 0.01), 25.0)
    assert not fit.told
    assert abs(fit.parameters[3]) < 1e-9
    assert SphereFit.of(points[:99], np.full(99, 0.01), 25.0) is None


@pytest.mark.parametrize("window", [1, 5])
def test_the_error_of_the_curvature_is_what_it_scatters_by(window):
    """Noise that all of a window shares; the standard deviation of 200 draws is known to a twentieth."""
    x, y = places(40)
    z, rng, found = on_sphere(x, y, 12.0, (0.5, 0.3, 82.0)), np.random.default_rng(4), []
    blocks = 40 // window
    for _ in range(200):
        noise = np.kron(rng.normal(0, 0.05, (blocks, blocks)), np.ones((window, window))).ravel()
        fit = SphereFit.of(np.stack([x, y, z + noise], -1), np.full(x.size, 0.05), float(window**2))
        found.append((fit.parameters[3], fit.curvature_sigma))
    curvature, told = np.array(found).T
    assert curvature.std() == pytest.approx(np.median(told), rel=0.13)
    assert abs(curvature.mean() - 1 / 12) < 4 * curvature.std() / np.sqrt(200)


@pytest.fixture(scope="module")
def trials():
    """Of a ball and of a wall, before the paper's camera."""
    found = []
    with pytest.MonkeyPatch.context() as patch:
        fewer_rays(patch)
        at_first_sight(patch)
        for thing in (BALL, {"kind": "plane", "distance": 350.0}):
            light = {"exposure": 5000, "read_noise": 2.5} if thing is BALL else {}
            scene = make_scene({"objects": [thing | {"texture": TEXTURE}], "light": light})
            found.append(simulate(roslf.load("paper"), scene, PictureOptions(region=(2200, 1440, 200, 200), seed=3)))
    return found


def as_true(trial):
    """With depths as its chief rays meet the scene, and small errors."""
    (run,) = trial.runs
    known = replace(run, depth=trial.true, noise_sigma=np.full(trial.true.shape, 1e-3))
    return replace(trial, runs=(known,))


def test_depths_as_chief_rays_meet_a_ball_give_its_radius(trials):
    ball, wall = map(as_true, trials)
    assert ball.sphere.radius == pytest.approx(BALL["radius"], rel=1e-6)
    assert ball.to_dict()["sphere"]["true_radius_mm"] == BALL["radius"]
    assert wall.sphere is None
    assert wall.to_dict()["sphere"] is None


def test_words_and_pictures_have_the_sphere_where_the_scene_is_one(trials):
    ball, wall = map(as_true, trials)
    said = {trial: " ".join(f"{s.text} {s.remedy}" for s in statements(trial)) for trial in (ball, wall)}
    assert "has a radius of 5 ± " in said[ball]
    assert "bulging towards the camera; depths lie off it by " in said[ball]
    assert "The scene's is 5 mm" in said[ball]
    assert "sphere" not in said[wall]
    shown = measurement_pictures(ball), measurement_pictures(wall)
    for name in ("map", "profile"):
        with_it, without = (str(pictures[name]) for pictures in shown)
        assert "sphere that fits best" in with_it
        assert "sphere that fits best" not in without
    assert [panel.title for panel in shown[0]["map"].panels[::2]] == [
        "depth",
        "depth less the sphere",
        "its standard error",
    ]
    assert "of radius 5 ± " in str(shown[0]["map"])


def test_one_that_noise_hides_is_said_to_be_none_that_is_told(trials):
    ball, _ = trials
    assert not ball.sphere.told  # 2 mm across, known to a millimetre
    (text,) = (s.text for s in statements(ball) if "sphere" in s.text)
    assert "It cannot be told from a plane here: its radius is " in text
    assert sphere_line(ball.sphere) == []


def test_a_scene_that_states_an_exposure_is_exposed_so(trials):
    """Electrons of white by the pictures themselves: 5000."""
    ball, wall = trials
    level = ball.raw.pixels.sum() / ball.white.pixels.sum()
    assert ball.electrons / level == pytest.approx(5000, rel=1e-6)
    camera = Camera.of(ball.raw.design)
    assert float(electrons(camera)) == pytest.approx(ball.electrons, rel=1e-9)
    assert ball.saturated == pytest.approx(float((5000 * ball.raw.pixels >= camera["sensor.full_well"]).mean()))
    assert ball.assumes()["exposure"] == "the scene's"
    assert ball.assumes()["exposure_s"] == pytest.approx(float(exposure(camera)))
    assert wall.assumes()["exposure"] == "the design's"
    assert float(electrons(Camera.of(wall.raw.design))) == wall.electrons
    (said,) = (s for s in statements(ball) if s.text.startswith("How much light?"))
    assert f"5000 electrons where it is white, {ball.electrons:.4g} in a pixel" in said.text
    assert "read noise is the scene's, 2.5" in said.text
    assert not [s for s in statements(wall) if s.text.startswith("How much light?")]
