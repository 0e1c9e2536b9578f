"""Boards that a bench's images show: where they stand, how sure they make the camera, and which pose to take next."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..calibration.corner_statistics import corner_statistics, fit_at
from ..calibration.epilines import fit_lines
from ..calibration.fit import calibrate, shared_names
from ..calibration.frames import Array, CalibrationError
from ..calibration.least_squares import undetermined
from ..calibration.model import Intrinsics, Observations, Poses, project_boards, rotation_matrix
from ..calibration.options import SheetOptions, data_sheet
from ..calibration.planning import Captures, camera_of, pupil_of
from ..calibration.posterior import variance_shares
from ..camera import Camera
from .captures import Bench, BoardPose
from .protocol import described, placed, planned_poses

_ODD, _OTHER = 0.05, 0.08
"""Share by which a board's cells may look smaller or larger than those of the other images, and than bench.toml says:
cameras are built to a few per cent of their design's magnification."""
_FOCUS = 0.08
"""Share by which a build's focal plane may lie off its design's, as boards show it together: a rigid scope's does by
5 % where d_1 is 0.4 % off."""
_SLOPES = 0.15
"""Share that diffraction may take of views' slopes, and so of how far from focus a board looks."""

_Shares = dict[str, dict[str, float]]
"""For each length its standard deviation, and shares of its variance, as of `variance_shares`."""


class NextPose(NamedTuple):
    """Pose that makes d_3 surest."""

    pose: BoardPose
    sigma: dict[str, float] | None
    """Standard deviations once it is taken; None where more are needed still."""

    def to_dict(self) -> dict[str, Any]:
        """As JSON's types."""
        return {"file": self.pose.file, **self.pose.to_dict(), "sigma": self.sigma}


@dataclass(frozen=True, eq=False)
class FoundBoards:
    """Boards that were found, by the design's camera."""

    bench: Bench
    observations: Observations
    camera: Intrinsics
    poses: Poses
    sizes: Array
    """Size of the cells, by parallax, over what bench.toml says, focused as boards are together, shape (b,)."""
    doubts: Array
    """Error that diffraction may make of it, shape (b,)."""
    noise: float

    @classmethod
    def of(cls, bench: Bench, observations: Observations, middle: Array) -> FoundBoards:
        """Poses by each board's own corners in the central view, from which parallax follows."""
        import cv2

        camera, lines = camera_of(bench.design), fit_lines(observations)
        pinhole = np.diag([camera.A / camera.d, camera.A / camera.d, 1.0])
        vectors, near, by_parallax = [], [], []
        for central, slope in zip(lines.central, lines.slope, strict=True):
            seen = np.isfinite(central[:, 0])
            points = np.ascontiguousarray(observations.points[seen])
            image = np.ascontiguousarray(middle - central[seen])
            pose = np.concatenate(cv2.solvePnP(points, image, pinhole, None)[1:]).ravel()
            vectors.append(pose)
            depth = points @ rotation_matrix(pose[:3])[2] + pose[5]
            near.append(np.nanmean(camera.A / depth))
            away = slope[seen] * camera.d / (camera.q * camera.A * camera.inverse_d_2)
            by_parallax.append(camera.m - np.nanmean(away))
        noise = lines.sigma if lines.sigma > 0 else Captures().noise
        looks = np.array(near), np.array(by_parallax)
        off = float(np.nanmedian(looks[1] - looks[0]))
        sizes = looks[0] / (looks[1] - np.clip(off, -_FOCUS * camera.m, _FOCUS * camera.m))
        doubts = _SLOPES * np.abs(looks[1] / camera.m - 1)
        return cls(bench, observations, camera, Poses.from_vector(np.array(vectors)), sizes, doubts, noise)

    def described(self, k: int) -> BoardPose:
        """Pose of a board, as of the protocol."""
        rotation, place = self.poses.rotation[k].tolist(), self.poses.translation[k].tolist()
        # Colours that leave half a turn open do so here.
        return described(rotation, place, self._ahead, self.observations.names[k])

    @property
    def _ahead(self) -> float:
        return float(Camera.of(self.bench.design).tip) - pupil_of(self.bench.design)

    def wrong_size(self, k: int) -> str:
        """Fault of a board whose cells are not as large as bench.toml says."""
        size, usual, doubt = float(self.sizes[k]), float(np.nanmedian(self.sizes)), float(self.doubts[k])
        cell = self.bench.setup.board.board.cell
        if abs(size - 1) > _OTHER + doubt or (len(self.sizes) > 2 and abs(size / usual - 1) > _ODD + doubt):
            return f"wrong target, or another focus: cells look {size * cell:.3g} mm wide, bench.toml says {cell:g} mm"
        return ""

    def scattered(self, sound: list[int]) -> FoundBoards:
        """Boards whose corners' noise is what the sound ones scatter by about the camera that fits them, if one does.

        Errors in neighbouring views go together: scatter about lines through the views promises too much.
        """
        design, names = self.bench.design, self.observations.names
        sheet = data_sheet(design, self.bench.setup.board.board, SheetOptions())
        part = replace(self.observations, uv=self.observations.uv[sound], names=tuple(names[k] for k in sound))
        try:
            fit = calibrate(part, sheet, distortion=design.main_lens.kind.radial, guess=self.camera.A).fit
        except CalibrationError:
            return self
        return replace(self, noise=self.noise * max(1.0, *fit.scales))

    def shares(self, sound: list[int], more: tuple[BoardPose, ...] = ()) -> _Shares | None:
        """Variances that sound boards, and more, would leave at the design's camera; None where something is open."""
        design, board = self.bench.design, self.bench.setup.board.board
        count = len(sound) + len(more)
        if count < 2:
            return None
        added = [placed(more, self._ahead).vector] if more else []
        poses = Poses.from_vector(np.concatenate([self.poses.vector[sound], *added]))
        views, points = self.observations.views, self.observations.points
        uv = np.array(project_boards(self.camera.vector(), poses.vector, points, views).values)
        uv[: len(sound)][~self.observations.seen[sound]] = np.nan
        corners = replace(self.observations, uv=uv, names=tuple(map(str, range(count))), missing=())
        statistics = corner_statistics(corners, fit_lines(corners), self.noise)
        fit = fit_at(statistics, self.camera, poses, shared_names(design.main_lens.kind.radial))
        if undetermined(fit.covariance, self.camera, count):
            return None
        return variance_shares(fit, data_sheet(design, board, SheetOptions()))

    def best(self, sound: list[int]) -> NextPose:
        """Pose that leaves d_3 surest, of those planned that are left, or of another round."""
        taken = [self.observations.names[k] for k in sound]
        after = [NextPose(pose, sigma_of(self.shares(sound, (pose,)))) for pose in left_poses(self.bench, taken)]
        return min(after, key=lambda one: math.inf if one.sigma is None else one.sigma["d_3"])


def sigma_of(shares: _Shares | None) -> dict[str, float] | None:
    """Standard deviations alone."""
    return None if shares is None else {name: share["sigma"] for name, share in shares.items()}


def _planned(bench: Bench) -> Captures:
    """Captures of another round, over the distances of the first."""
    count, ahead = len(bench.setup.poses), [pose.ahead for pose in bench.setup.poses]
    board = bench.setup.board.board
    if count < 2:
        return Captures.for_design(bench.design, board=board)
    middle = (min(ahead) + max(ahead)) / 2 + float(Camera.of(bench.design).tip)
    spread = (max(ahead) - min(ahead)) * count / (count - 1)
    return Captures.for_design(bench.design, board=board, boards=count, distance=middle, distance_range=spread)


def left_poses(bench: Bench, taken: Collection[str]) -> tuple[BoardPose, ...]:
    """Poses that are planned and not taken; where all are, those of another round."""
    stems = {Path(name).stem for name in taken}
    poses, round_ = bench.setup.poses, 0
    while not (left := tuple(pose for pose in poses if Path(pose.file).stem not in stems)):
        round_ += 1
        captures = _planned(bench)
        poses = planned_poses(bench.design, captures, bench.setup.seed, round_)
    return left
