"""Boards that a bench's images show, by corners that the calibration's model projects."""

import functools

import numpy as np
import pytest

from roslf_design.bench.boards import FoundBoards
from roslf_design.bench.captures import Bench
from roslf_design.bench.protocol import Protocol, placed
from roslf_design.calibration.model import Observations, project_boards
from roslf_design.calibration.options import PlanOptions
from roslf_design.calibration.planning import camera_of, pupil_of
from roslf_design.camera import Camera
from roslf_design.design import load

SCOPE = load("rigid-scope")


@functools.cache
def setup():
    """Of a bench for the scope: planned when it is asked for, not by each worker that reads the tests."""
    return Protocol.of(SCOPE, PlanOptions.of(board=None, boards=8)).setup


def faults(tmp_path, d_1=1.0, sizes=(1.0,) * 8):
    """What is said of boards whose cells are some times as large, seen by a scope whose d_1 is so much longer."""
    build = SCOPE.replace({}, d_1=d_1 * SCOPE.d_1)
    camera, points = camera_of(build), setup().board.board.points
    views = np.stack(np.meshgrid([-4.0, 0.0, 4.0], [-4.0, 0.0, 4.0]), -1).reshape(-1, 2)
    poses = placed(setup().poses, float(Camera.of(build).tip) - pupil_of(build)).vector
    uv = [
        project_boards(camera.vector(), poses[k : k + 1], size * points, views).values[0]
        for k, size in enumerate(sizes)
    ]
    observations = Observations(points, views, np.array(uv))
    looked = FoundBoards.of(Bench(tmp_path, SCOPE, setup()), observations, np.array([camera.x_0, camera.y_0]))
    return [looked.wrong_size(k) for k in range(len(sizes))]


@pytest.mark.parametrize("d_1", [0.994, 1.0, 1.006])
def test_boards_of_a_camera_that_is_focused_elsewhere_are_not_blamed(tmp_path, d_1):
    """0.6 % of d_1 moves a scope's focal plane by 8 %: boards seem up to a tenth larger or smaller."""
    assert faults(tmp_path, d_1) == [""] * 8


@pytest.mark.parametrize("d_1", [0.996, 1.0])
def test_one_board_of_another_size_is_named_all_the_same(tmp_path, d_1):
    named = faults(tmp_path, d_1, (1.0, 0.8, *(1.0,) * 6))
    assert [bool(fault) for fault in named] == [False, True, *[False] * 6]
    cell = setup().board.board.cell
    assert float(named[1].split("look ")[1].split(" mm")[0]) == pytest.approx(0.8 * cell, rel=0.02)


def test_boards_all_of_another_size_are_no_other_focus(tmp_path):
    assert all(faults(tmp_path, 1.0, (0.8,) * 8))
