"""What any estimator can attain, by every pixel about a window: the prediction where all of them tell."""

import numpy as np
import pytest

from roslf_design.calibration.decoding import HALF, Decoder
from roslf_design.depth.geometry import ArrayGeometry
from roslf_design.depth.pictures import lattice_of
from roslf_design.design import load
from roslf_design.imaging.camera import Region
from studies.depth.attainable import attainable

COARSE = load("paper").replace({"sensor.pixel": 1.6 * load("paper").q})
"""Eight pixels a pitch, for few of them."""


def test_every_pixel_together_attains_the_prediction_and_overlap_costs_those_that_drop_shared_ones():
    matched = attainable(COARSE, (0.0, 0.0), draws=6)
    wide = attainable(COARSE.replace(D_F=1.3 * COARSE.D_F), (0.0, 0.0), draws=6)
    # Rms over windows of unlike texture lies a few per cent above the error of their mean information.
    assert matched.all_pixels == pytest.approx(1.08, abs=0.1)
    assert wide.all_pixels == pytest.approx(1.08, abs=0.12)
    assert matched.own_pixels < 1.15 * matched.all_pixels
    assert wide.own_pixels > 1.25 * wide.all_pixels


def test_samples_reach_to_the_rims_of_images_that_overlap():
    matched, wide = (ArrayGeometry(COARSE.replace(D_F=share * COARSE.D_F)) for share in (0.9, 1.3))
    assert matched.reach == HALF < wide.reach == pytest.approx(1.3 * 0.5 * 1.005, rel=0.01)
    region = Region(0, 0, 160, 160)
    lattice, white = lattice_of(wide.camera, region), np.ones((160, 160))
    near, far = (Decoder.of(lattice, white.shape, reach=one.reach)(white) for one in (matched, wide))
    assert far.s[-1] > near.s[-1]
    inner = far.values[np.isin(far.t, near.t)][:, np.isin(far.s, near.s)]
    np.testing.assert_array_equal(inner, near.values)
