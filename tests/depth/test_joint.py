"""Disparities of images that overlap twofold: texture and disparities together, in pictures that rays made."""

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.depth.geometry import depth_of, disparity_of
from roslf_design.depth.joint import _best, _of_windows
from roslf_design.depth.measure import simulate
from roslf_design.depth.pictures import DETAIL, PictureOptions, region_about
from roslf_design.scenes import Noise, Plane, Scene
from roslf_design.theory.depth_error import fill_left, overlap_error
from roslf_design.theory.light import object_scale
from roslf_design.theory.photometry import exposure

DISPARITY, ACROSS, ROOM = 0.2, 13, 0.34


@pytest.mark.parametrize(
    ("name", "fill"), [("mismatched-borescope", 1.6), ("mismatched-borescope", 2.1), ("paper", 1.8)]
)
def test_a_wall_is_known_within_its_errors_where_few_pixels_show_one_microlens(name, fill):
    """By a third of the light, as else pixels are full; rays know nothing of waves. Windows are few."""
    design = roslf.load(name)
    wide = design.aperture.diameter * fill / float(fill_left(Camera.of(design.thin_twin)))
    design = design.replace({"aperture.diameter": wide})
    camera = Camera.of(design.thin_twin)
    design = design.replace({"light.exposure": ROOM * float(exposure(camera))})
    z = float(depth_of(camera, np.asarray(DISPARITY)))
    sample = float(camera.d * object_scale(camera, np.asarray(z - float(camera.tip))))
    wall = Plane(distance=z, texture=Noise(finest=DETAIL * sample, contrast=0.1, seed=8))
    options = PictureOptions(region=region_about(design, (0.0, 0.0), ACROSS), seed=8)
    trial = simulate(design, Scene(name="wall", objects=(wall,)), options)
    found, some = trial.first.disparities, trial.compared
    assert trial.first.measured.mean() > 0.95
    off = (found.disparity - disparity_of(camera, trial.true))[some]
    error = found.sigma[some]
    windows = some.sum() / found.window**2
    assert abs(off.mean()) < 2.5 * error.mean() / np.sqrt(windows)
    assert 0.5 < np.sqrt(((off / error) ** 2).mean()) < 1.6
    predicted = trial.prediction.disparity.mean()
    assert error.mean() < 1.4 * predicted
    assert 0.6 < np.sqrt((off**2).mean()) / predicted < 1.8
    assert overlap_error(Camera.of(design.thin_twin), z - camera.tip) == 0


def test_windows_that_know_more_to_one_side_tell_a_slope_at_their_middles():
    rng = np.random.default_rng(3)
    v, u = np.indices((15, 15))
    slanted = 0.02 * u - 0.01 * v
    means = _of_windows(slanted, rng.uniform(0.1, 5.0, slanted.shape), 5)
    np.testing.assert_allclose(means[4:-4, 4:-4], slanted[4:-4, 4:-4], atol=1e-12)


def test_the_best_of_a_search_lies_between_its_steps_and_the_next_dip_is_told():
    x = np.arange(12.0)
    totals = np.minimum((x - 3.3) ** 2, (x - 9) ** 2 + 5)[:, None, None]
    at, margin = _best(totals)
    assert np.allclose(at, 3.3)
    assert np.allclose(margin, 5 - 0.09)
