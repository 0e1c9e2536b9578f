"""Plans made before any image: against repeated synthetic calibrations and the laws they must follow."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from roslf_design.bench.protocol import Protocol
from roslf_design.calibration import (
    Board,
    CalibrationError,
    Captures,
    calibrate,
    camera_of,
    expected_errors,
    plan,
    planning,
    random_poses,
    sheet_of,
    synthetic_observations,
)
from roslf_design.calibration.options import PlanOptions, calibration_plan, plan_cover
from roslf_design.camera import Camera
from roslf_design.design import load, preset_names
from roslf_design.theory.depth_of_field import depth_of_field

PAPER = load("paper")
CAMERA = camera_of(PAPER)
EXACT = replace(sheet_of(PAPER), f_sigma=0.0, d_sigma=0.0, cell_sigma=0.0)
"""A data sheet without errors: what images alone say."""


def test_design_gives_the_calibration_s_parameters():
    assert pytest.approx(92.0) == CAMERA.A
    assert CAMERA.m == pytest.approx(0.4)
    assert 1 / CAMERA.inverse_d_2 == pytest.approx(2.0)
    assert CAMERA.x_0 == pytest.approx(4600 * CAMERA.q / CAMERA.d / 2, rel=1e-3)
    assert sheet_of(PAPER).f_sigma == pytest.approx(1.0)


def test_promised_errors_are_those_of_repeated_calibrations():
    captures = Captures(boards=6, views=3)
    promised = expected_errors(CAMERA, EXACT, captures, samples=16)
    found = []
    for k in range(24):
        rng = np.random.default_rng([5, k])
        observations = synthetic_observations(CAMERA, random_poses(captures, 120.0, rng), captures, rng)
        fit = calibrate(observations, EXACT).fit
        found.append((fit.camera.A, 100 + (100 - fit.camera.A) / fit.camera.m, 1 / fit.camera.inverse_d_2))
    for name, values in zip(("A", "d_3", "d_2"), np.transpose(found), strict=True):
        assert values.std() == pytest.approx(promised.sigma[name], rel=0.35)  # 24 trials: 15 %; poses: 20 %


def test_tilt_is_what_d_3_needs():
    """12 boards of 4 x 5 cells of 6 mm, 0.06 px: d_3 to a few mm with tilts to 8 degrees, 2.5 times better with 20."""
    shallow, steep = (
        expected_errors(CAMERA, EXACT, Captures(tilt=math.radians(t), views=3)).sigma["d_3"] for t in (8.0, 20.0)
    )
    assert 3.5 < shallow < 7.5  # an independent Monte Carlo: 6.4
    assert 1.4 < steep < 3.2  # 2.6
    assert 2.0 < shallow / steep < 3.2  # 2.5
    loose = expected_errors(CAMERA, replace(EXACT, f_sigma=1.0), Captures(tilt=math.radians(20.0), views=3))
    assert math.sqrt(loose.sigma["d_3"] ** 2 - steep**2) == pytest.approx(3.5, rel=0.02)  # 1 + 1/m, m = 0.4


def test_laws_of_errors():
    captures = Captures(boards=6, views=3)
    before = expected_errors(CAMERA, EXACT, captures)
    halved = expected_errors(CAMERA, EXACT, replace(captures, noise=captures.noise / 2))
    assert halved.sigma["d_3"] == pytest.approx(before.sigma["d_3"] / 2, rel=1e-6)
    four = expected_errors(CAMERA, EXACT, replace(captures, boards=24), samples=16)
    assert four.sigma["d_3"] == pytest.approx(before.sigma["d_3"] / 2, rel=0.25)
    larger = expected_errors(CAMERA, EXACT, replace(captures, board=Board(7, 9, 6.0)))
    assert larger.sigma["d_3"] < 0.5 * before.sigma["d_3"]
    distorted = expected_errors(CAMERA, EXACT, captures, distortion=2)
    assert distorted.sigma["d_3"] >= before.sigma["d_3"]
    for shares in before.shares.values():
        assert sum(shares.values()) == pytest.approx(1.0)


def test_plan_ranks_the_changes():
    sheet = sheet_of(PAPER)
    found = plan(CAMERA, sheet, Captures(tilt=math.radians(20.0), views=3))
    gains = [change.gain(found.expected) for change in found.changes]
    assert gains == sorted(gains, reverse=True)
    assert found.changes[0].what == "know f twice as well"
    assert found.advice.startswith("Know f twice as well: d_3 to ±2.")
    sure = plan(CAMERA, replace(sheet, f_sigma=0.01), Captures(tilt=math.radians(8.0), views=3))
    assert "board" in sure.changes[0].what or "cells" in sure.changes[0].what
    assert any("tilt the boards by up to 12 degrees" in change.what for change in sure.changes)
    again = plan(CAMERA, sheet, Captures(tilt=math.radians(20.0), views=3))
    assert again.expected.sigma == found.expected.sigma


@pytest.mark.parametrize(
    ("captures", "said"),
    [
        ({"tilt": math.radians(1.0), "views": 3},
         r"do not determine A.*: the boards are all parallel \(tilts up to 1\.0 degrees\); tilt them by"),
        ({"views": 1}, "there is one view only"),
        ({"boards": 1}, "one image of the board"),
        ({"distance": 130.0}, r"reach into the bore: the FAP is at 120\.0 mm"),
        ({"views": 2}, "views across the pupil must be 1, or 3 or more"),
        ({"noise": 0.0}, "noise must be positive"),
        ({"tilt": math.radians(95.0)}, "cannot be tilted by 95 degrees; stay below 90"),
    ],
)  # fmt: skip
def test_captures_that_cannot_work_say_why(captures, said):
    with pytest.raises(CalibrationError, match=said):
        expected_errors(CAMERA, EXACT, Captures(**captures))


@pytest.mark.parametrize("name", [n for n in preset_names() if load(n).lens is None and not load(n).elements])
def test_every_corner_of_the_advised_boards_is_in_the_field(name):
    """Brute force: corners of random poses against what the sensor sees at each one's own distance."""
    design = load(name)
    own = Captures.for_design(design)
    seen = min(np.array(design.sensor_size)) / abs(float(Camera.of(design).A))  # per mm in front of the FAP
    for k in range(8):
        poses = random_poses(own, design.d_3, np.random.default_rng([0, k]))
        corners = project_poses(poses, own.board.points)
        assert np.all(np.abs(corners[..., :2]) <= seen / 2 * corners[..., 2:])


@pytest.mark.parametrize(
    ("name", "asked"),
    [(name, {}) for name in ("paper", "rigid-scope", "arthroscope", "grin-needle", "pipe-bore", "video-otoscope")]
    + [("paper", {"boards": 150}), ("paper", {"boards": 100, "board": "10x10 3 mm"})],
)
def test_an_advised_board_is_one_that_the_bench_takes_and_that_covers_as_much(name, asked, monkeypatch):
    """Each advice asked for in its own words, as a person would type it; cells at the farthest by similar triangles."""
    # How sure each makes the camera is told by one set of poses instead of eight: nobody looks at it.
    monkeypatch.setattr(
        planning, "expected_errors", lambda *of, **known: expected_errors(*of, **known | {"samples": 1})
    )
    design = load(name)
    camera = Camera.of(design)
    asked = asked | {"at": (design.d_f - float(camera.tip),)}
    before = Protocol.of(design, PlanOptions.of(**asked))
    monkeypatch.setattr(planning, "_alternatives", lambda *_: ())  # of what was advised nothing else is advised
    for change in before.plan.changes:
        cells = re.search(r"(\d+) x (\d+) cells of (?:the same size|(\S+) mm)", change.what)
        images = re.match(r"show (\d+) boards", change.what)
        typed = {"board": f"{cells[1]}x{cells[2]} {cells[3] or before.plan.captures.board.cell} mm"} if cells else {}
        typed |= {"boards": int(images[1])} if images else {}
        if typed:
            after = Protocol.of(design, PlanOptions.of(**asked | typed))
            assert set(before.cover.covered_mm) <= set(after.cover.covered_mm)
            if not design.elements:
                spans = after.plan.captures.board.cell * float(camera.A) / (after.plan.captures.ends[1] - design.d_3)
                assert spans >= 5 * design.d


@pytest.mark.parametrize(
    ("name", "wanted"), [("rigid-scope", (14.0, 29.0)), ("paper", (205.0, 265.0)), ("ear-speculum", (18.8, 21.2))]
)
def test_boards_stand_wherever_something_is_required_or_asked_for(name, wanted):
    """Brute force: corners at each pose's own distance are in the field, their neighbours five microlenses apart."""
    near, far = wanted
    design = load(name).replace({"required": {"u_z_mm": {"at": near, "max": 9.0}}})
    asked = PlanOptions(at=(far,))
    own, camera = calibration_plan(design, asked).captures, Camera.of(design)
    cover = plan_cover(design, own, asked)
    assert cover.covered_mm == wanted
    assert cover.uncovered == ()
    seen = min(np.array(design.sensor_size)) / abs(float(camera.A))
    poses = random_poses(own, design.d_3, np.random.default_rng(0))
    ahead = np.sort(poses.translation[:, 2]) + design.d_3 - float(camera.tip)
    assert (ahead[0], ahead[-1]) == pytest.approx((cover.nearest_mm, cover.farthest_mm))
    assert ahead[0] <= near * (1 + 1e-9)
    assert ahead[-1] >= far * (1 - 1e-9)
    corners = project_poses(poses, own.board.points)
    assert np.all(np.abs(corners[..., :2]) <= seen / 2 * corners[..., 2:])
    image = abs(float(camera.A)) / design.d * corners[..., :2] / corners[..., 2:]
    across = image.reshape(own.boards, *own.board.inner[::-1], 2)
    assert np.linalg.norm(np.diff(across, axis=2), axis=-1).mean(axis=(1, 2)).min() > 5 * math.cos(own.tilt)


@pytest.mark.parametrize("name", ["paper", "rigid-scope", "paper-singlet"])
@pytest.mark.parametrize("samples", [30, 34, 40, 47, 55, 64, 90])
def test_cells_of_a_board_of_our_choosing_are_told_apart_in_the_focal_plane_or_the_plan_says_why_not(name, samples):
    """Across the narrow side of a sensor that sees so many microlenses: cells by similar triangles from the FAP."""
    design = load(name)
    across = min(design.sensor_size) / design.d
    design = design.replace({"sensor.size": tuple(samples / across * side for side in design.sensor.size)})
    asked = PlanOptions()
    captures = Captures.for_design(design)
    span = captures.board.cell * abs(float(Camera.of(design).A)) / (design.d_f - design.d_3) / design.d
    missed = plan_cover(design, captures, asked).uncovered
    assert [one.reason.startswith("the board's cells span 5 microlenses only up to") for one in missed] == [True] * (
        span < 5
    )
    if samples >= 40:  # four cells of a round size in four fifths of the narrow side, an eighth nearer than the focus
        assert span >= 5


def test_distances_that_no_board_serves_for_are_named_with_the_reason():
    design = load("paper")
    asked = PlanOptions(at=(20.0, 240.0, 600.0))
    cover = plan_cover(design, calibration_plan(design, asked).captures, asked)
    assert cover.covered_mm == (240.0,)
    near, far = cover.uncovered
    assert (near.at_mm, far.at_mm) == (20.0, 600.0)
    first, last = depth_of_field(Camera.of(design), "view")
    assert near.reason == f"views are sharp only from {float(first):.3g} mm on"
    assert far.reason == f"views are sharp only up to {float(last):.3g} mm"
    large = PlanOptions(at=(205.0,), board="4x5 60 mm")
    (missed,) = plan_cover(design, calibration_plan(design, large).captures, large).uncovered
    assert "the sensor sees the board whole only from" in missed.reason
    fixed = PlanOptions(at=(205.0,), range=10.0)
    (missed,) = plan_cover(design, calibration_plan(design, fixed).captures, fixed).uncovered
    assert "boards stand from 225 to 235 mm" in missed.reason
    distance, reach = map(float, re.search(r'--distance "(.+) mm" --range "(.+) mm"', missed.reason).groups())
    wider = PlanOptions(at=(205.0,), distance=distance, range=reach)
    assert plan_cover(design, calibration_plan(design, wider).captures, wider).covered_mm == (205.0,)
    assert (
        calibration_plan(design, PlanOptions(at=(230.0,))).captures == calibration_plan(design, PlanOptions()).captures
    )


def project_poses(poses, points):
    """Corners [mm] in the FAP's frame, shape (boards, corners, 3)."""
    turned = Rotation.from_rotvec(poses.rotation).as_matrix()
    return points @ np.swapaxes(turned, 1, 2) + poses.translation[:, None]


def test_a_main_lens_focused_at_infinity_has_an_H_to_know_and_no_d_f():
    """H by drawn magnifications about 0, of which none is sure of its sign: as sure as the plan says, unlike d_f."""
    f, d_3, sigma_m = 100.0, 8.0, 1e-4
    drawn = np.random.default_rng(3).normal(0, sigma_m, 100_000)
    H = 1 / (1 - d_3 * drawn / (f * (1 + drawn)))
    sigma = {"H": float(H.std()), "m": sigma_m, "d_f": 1e30}
    assert sigma["H"] == pytest.approx(d_3 / f * sigma_m, rel=0.01)
    assert planning.trust_in("H", sigma, {"H": 1.0, "m": 0.0, "d_f": math.inf}) == "good"
    assert planning.trust_in("d_f", sigma, {"H": 1.0, "m": 0.0, "d_f": 1e20}) == "bad"


def test_boards_keep_clear_of_the_bore_by_default_and_what_does_not_is_told_what_does():
    """7.8 mm before a window's end at 82 mm: a quarter of the way from the FAP is 21 mm, half in the bore."""
    window = {"kind": "plate", "distance": 81.0, "thickness": 1.0, "material": "N-BK7"}
    design = load("paper").replace({"aperture.distance": 5.0}).replace({"f": 47.0, "d_f": 90.0})
    design = design.replace({"elements": [window]})
    captures = Captures.for_design(design)
    assert captures.distance - captures.distance_range / 2 == pytest.approx((82.0 + captures.distance) / 2)
    assert calibration_plan(design, PlanOptions()).captures.ends[0] > 82.0
    said = calibration_plan(design, PlanOptions(range=30.0))
    assert "reach into the bore" in said
    assert not isinstance(
        calibration_plan(design, PlanOptions(range=float(re.search(r"range of ([\d.]+) mm", said)[1]))), str
    )
