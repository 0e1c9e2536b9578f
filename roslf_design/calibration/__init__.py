"""From raw images to the system's parameters and how sure we are of them.

White image -> microlens centres (`find_centres`) -> light field (`decode`) -> corners (`observe`) -> two steps and
joint refinement (`calibrate`) -> posterior (`sample_posterior`) -> depth errors (`depth_errors`); before any image,
`plan`.
Modules here import scipy, OpenCV and emcee only inside the functions that need them (extra `calibrate`).
"""

from __future__ import annotations

from .board import Board, Observations
from .calibrate import Calibration, calibrate
from .centres import MicrolensCentres, find_centres
from .consequences import depth_errors, variance_shares
from .corners import find_corners, observe, observe_pictures
from .coverage import Coverage, coverage
from .datasheet import DataSheet, derived
from .decode import decode
from .diffraction import Corrected, Diffraction, calibrate_corrected
from .draws import Draws, laplace_draws
from .errors import CalibrationError, MissingExtraError
from .lattice import CentreLattice
from .lightfield import LightField
from .model import Camera, Poses
from .planning import Plan, camera_of, expected_errors, plan, sheet_of
from .posterior import Posterior, sample_posterior
from .storage import load_light_field, save_light_field
from .synthetic import Captures, observe_synthetic, random_poses
from .trust import Reason
from .undistorted import undistorted_radius

__all__ = [
    "Board",
    "Calibration",
    "CalibrationError",
    "Camera",
    "Captures",
    "CentreLattice",
    "Corrected",
    "Coverage",
    "DataSheet",
    "Diffraction",
    "Draws",
    "LightField",
    "MicrolensCentres",
    "MissingExtraError",
    "Observations",
    "Plan",
    "Poses",
    "Posterior",
    "Reason",
    "calibrate",
    "calibrate_corrected",
    "camera_of",
    "coverage",
    "decode",
    "depth_errors",
    "derived",
    "expected_errors",
    "find_centres",
    "find_corners",
    "laplace_draws",
    "load_light_field",
    "observe",
    "observe_pictures",
    "observe_synthetic",
    "plan",
    "random_poses",
    "sample_posterior",
    "save_light_field",
    "sheet_of",
    "undistorted_radius",
    "variance_shares",
]
