"""The camera, data sheet and synthetic captures that tests of the calibration share."""

import importlib.util
import sys

import numpy as np

from roslf_design.calibration.model import DataSheet, Intrinsics
from roslf_design.calibration.planning import Captures, random_poses, synthetic_observations

CAMERA = Intrinsics(92.0, 0.4, 0.5, 182.0, 118.0, q=0.004847826, d=0.063)
SHEET = DataSheet(100.0, CAMERA.q, CAMERA.d, 1.0, d_sigma=6.3e-5, cell_sigma=1e-3)


def study(path):
    """A script of studies/ as a module."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def captured(captures, seed=0, camera=CAMERA):
    rng = np.random.default_rng(seed)
    return synthetic_observations(camera, random_poses(captures, 120.0, rng), captures, rng)


def poses_of(boards, seed=0):
    return random_poses(Captures(boards=boards), 120.0, np.random.default_rng(seed))
