"""Errors of a calibration behind a real main lens: its corners traced, fitted as captured ones are, against the design.

Distortion, the field's curvature and the growth of the baseline are fitted. Spherical aberration, which moves the plane
on which wide pencils agree, and higher orders are not, and scatter does not show them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..design import Design
from ..fates import ImageFate
from ..lenses.prescription import LensError
from ..traced.camera import LensCamera, views
from ..traced.camera import camera_of as traced_camera
from ..traced.images import real_images
from .fit import Calibration, calibrate
from .frames import Array, CalibrationError
from .lattice import bend_columns
from .model import GLOBALS, DataSheet, Observations, project_boards, rotation_matrix
from .planning import camera_of, pupil_of

_NAMES = GLOBALS[:3]
_NODES = 13
"""Microlenses along the sensor's longer side whose images say how the lattice is bent."""
_ROUNDS = 12
_MET = 1e-6
"""Step on the array [mm] from which a ray counts as meeting its corner."""
_NUDGE = 1e-4
"""Step for derivatives [mm]."""


def aberration_error(
    result: Calibration, sheet: DataSheet, design: Design, distortion: int = 0, bent: bool = True
) -> Array:
    """Error of (A, m, 1/d_2) that the design's own lens makes, with boards and views as in a calibration.

    `bent` says whether the lattice of microlens images follows their bend; else its pitch takes that up, and A with it.

    Returns
    -------
    ndarray
        As one independent standard deviation, shape (1, 3); (0, 3) where the lens has none, or its corners give no
        camera.
    """
    if not design.main_lens.kind.faults:
        return np.zeros((0, 3))
    model = camera_of(design)
    try:
        corners = _traced_corners(traced_camera(design), design, result, bent)
        fit = calibrate(corners, sheet, distortion=distortion, guess=model.A).fit
    except (CalibrationError, LensError):
        return np.zeros((0, 3))
    return (fit.camera.vector(_NAMES) - model.vector(_NAMES))[None]


def _traced_corners(camera: LensCamera, design: Design, result: Calibration, bent: bool = True) -> Observations:
    """The corners of a calibration as exact rays through the design's lens have them, its axis amid the array.

    By Newton's method: from which microlens the ray of a view meets the corner. Views count from the middles of the
    microlens images as a lattice, bent to third order or not, follows them. NaN where a corner was not seen or met.
    """
    observations, poses = result.observations, result.fit.poses
    model = replace(camera_of(design), x_0=0.0, y_0=0.0)
    scene = observations.points @ np.swapaxes(rotation_matrix(poses.rotation), 1, 2) + poses.translation[:, None]
    ahead = scene[:, None, :, 2] + pupil_of(design) - design.d_3
    pixels = design.q * observations.views[:, None]
    half = np.array(design.sensor_size) / 2
    reach = float(half.max())
    axes = (np.linspace(-side, side, max(5, round(_NODES * side / reach))) for side in half)
    nodes = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    images = real_images(camera, nodes, points=32)
    whole = images.status == ImageFate.FULL

    def columns(c: Array) -> Array:
        straight = np.concatenate([np.ones((*c.shape[:-1], 1)), c / reach], axis=-1)
        return np.concatenate([straight, bend_columns(c / reach)], axis=-1) if bent else straight

    if whole.sum() < columns(nodes).shape[-1]:
        raise CalibrationError("too few microlens images are whole behind the main lens")
    bend = np.linalg.lstsq(columns(nodes[whole]), images.centroid[whole], rcond=None)[0]

    def missed(c: Array) -> Array:
        rays = views(camera, c, c + columns(c) @ bend + pixels, clip=False)
        return np.asarray(rays.at(ahead) - scene[:, None, :, :2])

    c = project_boards(model.vector(), poses.vector, observations.points, observations.views).values * design.d
    step = np.full(c.shape, np.inf)
    for _ in range(_ROUNDS):
        off = missed(c)
        slope = np.stack([(missed(c + _NUDGE * axis) - off) / _NUDGE for axis in np.eye(2)], axis=-1)
        with np.errstate(invalid="ignore", divide="ignore"):
            step = (np.linalg.pinv(np.nan_to_num(slope)) @ off[..., None])[..., 0]
        c = c - step
        if not np.nanmax(np.abs(step)) > _MET:
            break
    met = observations.seen & (np.abs(step) <= _MET).all(axis=-1)
    return replace(observations, uv=np.where(met[..., None], c / design.d, np.nan))
