"""From raw images to the system's parameters and how sure we are of them.

White image -> microlens centres (`find_centres`) -> light field (`decode`) -> corners (`observe`) -> two steps and
joint refinement (`calibrate`) -> posterior (`sample_posterior`) -> depth errors (`depth_errors`); before any image,
`plan`. Modules here import scipy, OpenCV, emcee and arviz-stats only inside the functions that need them.
"""

from __future__ import annotations

from .centres import MicrolensCentres, Reason, find_centres, find_centres_in_scene
from .corners import find_corners, observe, observe_pictures
from .decoding import Decoder, LightField, decode
from .diffraction import Corrected, DiffractionCheck
from .distortion import Distortion, with_distortion
from .fit import Calibration, calibrate
from .frames import CalibrationError, read_capture, read_image
from .lattice import CentreLattice
from .model import Board, DataSheet, Intrinsics, Observations, Poses, derived, sheet_of
from .planning import (
    CapturePlan,
    Captures,
    camera_of,
    expected_errors,
    plan,
    random_poses,
    synthetic_observations,
)
from .posterior import CameraDraws, Posterior, depth_errors, laplace_draws, sample_posterior, variance_shares
from .result import Outcome, undistorted_radius
from .sidedata import SideDatum, board_distances, white_pitch

__all__ = [
    "Board",
    "Calibration",
    "CalibrationError",
    "CameraDraws",
    "CapturePlan",
    "Captures",
    "CentreLattice",
    "Corrected",
    "DataSheet",
    "Decoder",
    "DiffractionCheck",
    "Distortion",
    "Intrinsics",
    "LightField",
    "MicrolensCentres",
    "Observations",
    "Outcome",
    "Poses",
    "Posterior",
    "Reason",
    "SideDatum",
    "board_distances",
    "calibrate",
    "camera_of",
    "decode",
    "depth_errors",
    "derived",
    "expected_errors",
    "find_centres",
    "find_centres_in_scene",
    "find_corners",
    "laplace_draws",
    "observe",
    "observe_pictures",
    "plan",
    "random_poses",
    "read_capture",
    "read_image",
    "sample_posterior",
    "sheet_of",
    "synthetic_observations",
    "undistorted_radius",
    "variance_shares",
    "white_pitch",
    "with_distortion",
]
