"""Synthetic calibrations: boards posed at random in front of a camera, their corners measured with noise."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from .board import Board, Observations
from .errors import CalibrationError
from .lattice import Array
from .model import Camera, Poses, project_boards


@dataclass(frozen=True)
class Captures:
    """What one means to capture."""

    board: Board = field(default_factory=lambda: Board(4, 5, 6.0))
    boards: int = 12
    """Images of the board."""
    distance: float = 350.0
    """Mean distance of the boards from the main lens [mm]."""
    distance_range: float = 60.0
    """Farthest minus nearest [mm]."""
    tilt: float = math.radians(20.0)
    """Largest tilt [rad]."""
    offset: float = 8.0
    """Largest sideways displacement of a board's middle from the axis, per axis [mm]."""
    noise: float = 0.06
    """Standard deviation of one corner coordinate in one view [pitches of the view's samples]."""
    views: int = 5
    """Views across the pupil, per axis."""
    reach: float = 5.0
    """Outermost view from the centre [px]."""

    def __post_init__(self) -> None:
        if self.views < 1 or self.views == 2:
            raise CalibrationError(f"views across the pupil must be 1, or 3 or more, got {self.views}")
        if self.boards < 1:
            raise CalibrationError(f"at least one image of the board is needed, got {self.boards}")
        for name in ("distance", "noise"):
            if not getattr(self, name) > 0:
                raise CalibrationError(f"{name} must be positive, got {getattr(self, name)}")

    def view_grid(self) -> Array:
        """(s', t') of the views inside the round pupil [px], shape (v, 2)."""
        if self.views == 1:
            return np.zeros((1, 2))
        s, t = np.meshgrid(*2 * [np.linspace(-self.reach, self.reach, self.views)])
        inside = np.hypot(s, t) <= (1.0 + 1e-9) * self.reach
        return np.stack([s[inside], t[inside]], axis=-1)


def random_poses(captures: Captures, pupil_distance: float, rng: np.random.Generator) -> Poses:
    """Poses as a person would choose them: distances spread evenly, tilts in every direction, boards turned in hand.

    Parameters
    ----------
    captures : Captures
    pupil_distance : float
        d_3 [mm], from lens to FAP: poses are in the FAP's frame.
    rng : Generator
    """
    n = captures.boards
    spread = (np.arange(n) + 0.5) / n - 0.5 if n > 1 else np.zeros(1)
    depth = captures.distance - pupil_distance + captures.distance_range * rng.permutation(spread)
    size, towards = captures.tilt * np.sqrt(rng.uniform(0, 1, n)), rng.uniform(0, 2 * math.pi, n)
    turn = rng.uniform(-math.pi / 8, math.pi / 8, n)
    rotation = np.column_stack([size * np.cos(towards), size * np.sin(towards), turn])
    aside = rng.uniform(-captures.offset, captures.offset, (n, 2))
    return Poses(rotation, np.column_stack([aside, depth]))


def ideal_observations(camera: Camera, poses: Poses, captures: Captures) -> Observations:
    """Corners where the model puts them."""
    views = captures.view_grid()
    uv = project_boards(camera.vector(), poses.vector, captures.board.points, views).uv
    return Observations(captures.board.points, views, uv)


def observe_synthetic(camera: Camera, poses: Poses, captures: Captures, rng: np.random.Generator) -> Observations:
    """Corners as measured: the model's, each coordinate in each view off by independent normal errors."""
    ideal = ideal_observations(camera, poses, captures)
    return Observations(ideal.points, ideal.views, ideal.uv + captures.noise * rng.normal(size=ideal.uv.shape))
