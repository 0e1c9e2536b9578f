"""From raw images to the system's parameters and how sure we are of them.

White image -> microlens centres (`find_centres`) -> light field (`decode`) -> corners (`observe`) -> two steps and
joint refinement (`calibrate`) -> posterior (`sample_posterior`) -> depth errors (`depth_errors`); before any image,
`plan`. Modules here import scipy, OpenCV, emcee and arviz-stats only inside the functions that need them.
"""

from __future__ import annotations

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach(
    __name__,
    submod_attrs={
        "centres": ["MicrolensCentres", "Reason", "find_centres", "find_centres_in_scene"],
        "corners": ["find_corners", "observe", "observe_pictures"],
        "decoding": ["Decoder", "LightField", "decode"],
        "designed": ["undistorted_radius"],
        "diffraction": ["Corrected", "DiffractionCheck"],
        "distortion": ["Distortion", "with_distortion"],
        "fit": ["Calibration", "calibrate"],
        "frames": ["CalibrationError", "read_capture", "read_image"],
        "lattice": ["CentreLattice"],
        "model": ["Board", "DataSheet", "Intrinsics", "Observations", "Poses", "derived", "sheet_of"],
        "planning": [
            "CapturePlan",
            "Captures",
            "camera_of",
            "expected_errors",
            "plan",
            "random_poses",
            "synthetic_observations",
        ],
        "posterior": [
            "CameraDraws",
            "Posterior",
            "depth_errors",
            "laplace_draws",
            "sample_posterior",
            "variance_shares",
        ],
        "result": ["Outcome"],
        "sidedata": ["SideDatum", "board_distances", "white_pitch"],
    },
)
