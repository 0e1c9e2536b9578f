"""Places that views see fine texture from: against brute force, limits, and depth away from the focal plane."""

import math

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.depth.geometry import _texture_frequency
from roslf_design.depth.measure import PictureOptions, simulate
from roslf_design.scenes import make_scene
from roslf_design.theory.disparity_error import image_parts, phase_places
from roslf_design.theory.exit_pupil import microlens_image_diameter, microlens_image_pitch
from roslf_design.theory.stop_images import MicrolensImages
from tests.depth.made import Texture, fewer_rays

PLACES = np.array([-0.4, -0.15, 0.0, 0.3])
RATES = np.array([0.25, 0.5, 0.75, 1.0])


def by_brute_force(camera, x, rate):
    """Phase over rate of what a square microlens paints of a disc at a pixel (x, 0) [image pitches], by sums."""
    pitch = abs(float(microlens_image_pitch(camera)))
    wide = float(microlens_image_diameter(camera)) / pitch
    spot = float(camera.wavelength * camera.d_2 / camera.d) / pitch
    pixel = float(camera.q) / pitch
    at = (np.arange(300) + 0.5) / 300 - 0.5
    along, down = np.meshgrid(at, at)
    disc = np.hypot(along, down) < 0.5
    fine = ((np.arange(9) + 0.5) / 9 - 0.5) * pixel
    spread = [np.mean([np.sinc((place + wide * at + d) / spot) ** 2 for d in fine], axis=0) for place in (x, 0.0)]
    light = np.multiply.outer(spread[1], spread[0]) * disc
    return -np.angle((light * np.exp(-2j * math.pi * rate * along)).sum()) / (2 * math.pi * rate)


def test_phases_are_those_of_the_light_that_a_square_microlens_paints():
    camera = Camera.of(roslf.load("paper"))
    places = phase_places(MicrolensImages(camera, [(0.0, 0.0)]), PLACES, np.zeros(1), RATES)[:, 0, 0, 0]
    for rate, row in zip(RATES[:2], places[:2], strict=True):
        # Images that stand alone are a mean over eight waves, and the disc has 70,000 points.
        np.testing.assert_allclose(row, [by_brute_force(camera, x, rate) for x in PLACES], atol=2e-3)
    assert abs(places[-1, 0]) > 1.02 * abs(places[0, 0])  # farther out the finer


def test_slow_texture_is_seen_from_the_mean_place():
    images = MicrolensImages(Camera.of(roslf.load("paper")), [(0.0, 0.0)])
    parts = image_parts(images, PLACES, PLACES)
    own = parts.steps.index((0, 0))
    (slow,) = phase_places(images, PLACES, PLACES, np.array([1e-3]))
    np.testing.assert_allclose(slow[0, 0], parts.x[own, 0], atol=1e-5)
    np.testing.assert_allclose(slow[1, 0], parts.y[own, 0], atol=1e-5)


@pytest.mark.parametrize("finest", [0.1, 0.2, 0.3])
def test_frequency_of_a_texture_is_that_of_its_gradient(finest):
    texture = Texture.of(1, 0.2, finest=finest)
    amplitude, along, down, _ = texture.waves.T
    across, up = along / (2 * math.pi), down / (2 * math.pi)
    power = amplitude**2
    expected = math.sqrt((power * (across**4 + up**4)).sum() / (power * (across**2 + up**2)).sum())
    axis = np.arange(120.0)
    # Waves that a window does not part interfere.
    assert _texture_frequency(texture.grid(axis, axis), (1.0, 1.0)) == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize(("distance", "least"), [(300.0, 0.8), (440.0, 2.6)])
def test_depth_away_from_the_focal_plane(distance, least, monkeypatch):
    """Five pitches out of focus: by mean places 2.1 and 5.6 mm off (`least` mm more than now, in these pictures)."""
    fewer_rays(monkeypatch)
    design = roslf.load("paper")
    step = float(roslf.quantity("object_sample_mm")(Camera.of(design)))
    finest = 2.5 * step * (distance - design.d_3) / (design.d_f - design.d_3)
    texture = {"kind": "noise", "finest": finest, "contrast": 0.1, "seed": 1}
    scene = make_scene({"objects": [{"kind": "plane", "distance": distance, "texture": texture}]})
    part = PictureOptions(region=(2220, 1460, 160, 160))
    now = simulate(design, scene, part).summary()
    monkeypatch.setattr("roslf_design.depth.geometry.SLOW_TEXTURE", math.inf)
    before = simulate(design, scene, part).summary()
    assert abs(before.bias_mm) - abs(now.bias_mm) > least
    assert now.spread_mm < 1.1 * before.spread_mm
