"""The camera, data sheet and synthetic captures that tests of the calibration share."""

import importlib.util
import sys
from dataclasses import replace

import numpy as np

from roslf_design.calibration.model import DataSheet, Intrinsics, Observations, project_boards, rotation_matrix
from roslf_design.calibration.planning import Captures, camera_of, pupil_of, random_poses, synthetic_observations
from roslf_design.traced.camera import camera_of as traced_camera
from roslf_design.traced.camera import views
from roslf_design.traced.images import real_images

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


def traced_corners(design, captures, seed):
    """Corners of random poses as exact rays through the design's prescription have them, without noise.

    Views count from the middle of each microlens's image, as a lattice bent to third order follows those; the lens
    stands at the middle of the array. By Newton's method: from which microlens a ray of the view meets the corner.
    """
    camera, model = traced_camera(design), camera_of(design)
    poses = random_poses(captures, pupil_of(design), np.random.default_rng([seed, 1]))
    points, at = captures.board.points, captures.view_grid()
    scene = points @ np.swapaxes(rotation_matrix(poses.rotation), 1, 2) + poses.translation[:, None]
    uv = project_boards(replace(model, x_0=0.0, y_0=0.0).vector(), poses.vector, points, at).values
    reach = 1.1 * np.abs(uv).max() * design.d

    def columns(places):
        x, y = np.moveaxis(places / reach, -1, 0)
        return np.stack([x, y, x**3, x * x * y, x * y * y, y**3], axis=-1)

    side = np.linspace(-reach, reach, 12)
    lenses = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    lenses = lenses[np.hypot(*lenses.T) < 1.1 * np.hypot(*(uv * design.d).reshape(-1, 2).T).max()]
    bend = np.linalg.lstsq(columns(lenses), real_images(camera, lenses, points=32).centroid, rcond=None)[0]

    def missed(c):
        rays = views(camera, c, c + columns(c) @ bend + design.q * at[:, None], clip=False)
        return rays.at(scene[:, None, :, 2]) - scene[:, None, :, :2]

    c, nudge = uv * design.d, 1e-4
    for _ in range(30):
        off = missed(c)
        slope = np.stack([(missed(c + nudge * axis) - off) / nudge for axis in np.eye(2)], axis=-1)
        step = np.linalg.solve(slope, off[..., None])[..., 0]
        c = c - step
        if np.abs(step).max() < 1e-9:
            return Observations(points, at, c / design.d + (model.x_0, model.y_0))
    raise AssertionError("rays through the lens do not meet the board's corners")
