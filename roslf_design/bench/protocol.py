"""Protocol of a bench: what is to be captured, in which poses, at which levels, under which names."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..calibration.cover import BoardCover
from ..calibration.model import Poses
from ..calibration.options import PlanOptions, calibration_plan, lengths_after, plan_cover
from ..calibration.planning import CapturePlan, Captures, pupil_of, random_poses, smaller_board, too_large
from ..camera import Camera
from ..design import Design
from ..errors import refusal
from ..theory.length_covariance import CalibratedLengths
from .captures import BoardPose, Setup
from .targets import Sheet, setup_for, sheets

BRIGHT = (0.6, 0.8)
"""Level of the brightest pixels, over full scale."""


@dataclass(frozen=True, eq=False)
class Protocol:
    """Bench of a design."""

    design: Design
    setup: Setup
    plan: CapturePlan
    cover: BoardCover
    sheets: tuple[Sheet, ...]
    lengths: CalibratedLengths
    """Lengths of the camera as the plan's captures alone calibrate them."""

    @classmethod
    def of(cls, design: Design, asked: PlanOptions) -> Protocol:
        """Bench with the plan's board and poses, and targets that suit the design.

        Raises
        ------
        InputError
            The captures do not determine the camera, or its sensor does not see the board whole.
        """
        plan = calibration_plan(design, asked)
        if isinstance(plan, str):
            raise refusal("design", plan)
        large = plan.captures.board.markers is None and too_large(design, plan.captures)
        if large:
            raise refusal("board", f"{large}: {smaller_board(design, plan.captures)}")
        poses = planned_poses(design, plan.captures, asked.seed)
        setup = setup_for(design, plan.captures.board, poses, asked.seed, asked.at)
        cover = plan_cover(design, plan.captures, asked)
        return cls(design, setup, plan, cover, sheets(setup, design.name), lengths_after(design, plan, asked))

    @property
    def full(self) -> int:
        """Largest count of the sensor."""
        return int(2**self.design.sensor.bits - 1)

    @property
    def counts(self) -> tuple[int, int]:
        """Counts between which the brightest pixels are to lie."""
        low, high = (round(share * self.full) for share in BRIGHT)
        return low, high


def planned_poses(design: Design, captures: Captures, seed: int, round_: int = 0) -> tuple[BoardPose, ...]:
    """Poses of one of a plan's random sets, the `round_`-th, as a person sets them up; the nearest first."""
    pupil, tip = pupil_of(design), float(Camera.of(design).tip)
    poses = random_poses(captures, pupil, np.random.default_rng([seed, round_]))
    first = round_ * captures.boards
    return tuple(
        described(rotation, translation, tip - pupil, f"board_{first + number:02d}.tif")
        for number, (rotation, translation) in enumerate(
            sorted(zip(poses.rotation.tolist(), poses.translation.tolist(), strict=True), key=lambda pose: pose[1][2]),
            start=1,
        )
    )


def described(rotation: list[float], translation: list[float], ahead: float, file: str) -> BoardPose:
    """A pose of the calibration's frame in words of the bench; the tip lies `ahead` of the FAP [mm]."""
    x, y, turn = rotation
    right, down, away = translation
    tilt, towards = math.hypot(x, y), math.atan2(x, y)
    return BoardPose(file=file, ahead=away - ahead, right=right, up=-down, tilt=tilt, towards=towards, turn=turn)


def placed(poses: tuple[BoardPose, ...], ahead: float) -> Poses:
    """Poses in the calibration's frame; the tip lies `ahead` of the FAP [mm]."""
    places = [(pose.right, -pose.up, pose.ahead + ahead) for pose in poses]
    return Poses(np.array([pose.rotation for pose in poses]), np.array(places))
