"""The white image's pitch and the boards' distances, against the truth, the theory and brute force."""

import math
from dataclasses import replace

import numpy as np
import pytest

from roslf_design.calibration import (
    CalibrationError,
    Captures,
    board_distances,
    calibrate,
    camera_of,
    derived,
    laplace_draws,
    random_poses,
    sheet_of,
    synthetic_observations,
    variance_shares,
    white_pitch,
)
from roslf_design.calibration.sidedata import combine, image_pitch
from roslf_design.design import load
from tests.calibration.made import CAMERA, SHEET

CAPTURES = Captures(boards=8, noise=0.02, distance_range=80.0)
POSES = random_poses(CAPTURES, 120.0, np.random.default_rng(5))
PITCH = 0.063 / CAMERA.q * (1 - 2 / 460)
"""By the textbook: the FAP at 120 mm behind 100 mm is imaged to 600 mm, 460 mm behind the array."""
EXACT = replace(SHEET, d_sigma=1e-5 * SHEET.d, cell_sigma=1e-4)


@pytest.fixture(scope="module")
def fit():
    observations = synthetic_observations(CAMERA, POSES, CAPTURES, np.random.default_rng(6))
    return calibrate(observations, SHEET).fit


@pytest.mark.parametrize("name", ["paper", "rigid-scope", "ear-speculum"])
def test_image_pitch_is_the_exit_pupil_s(name):
    design = load(name)
    pupil = 1 / (1 / design.f - 1 / design.d_3) if design.d_3 != design.f else math.inf
    expected = design.d / design.q * (1 + design.d_2 / (design.d_1 - pupil))
    assert float(image_pitch(camera_of(design).vector(), sheet_of(design))) == pytest.approx(expected, rel=1e-12)


def sigma_f(fit, sheet, *data):
    return float(laplace_draws(fit, sheet, 20_000, np.random.default_rng(0), data).draws("f").std())


def test_the_white_image_s_pitch_finds_a_focal_length_told_wrong(fit):
    wrong = replace(EXACT, f=101.0)
    datum = white_pitch(fit, wrong, PITCH, 1e-5)
    found = combine(fit, wrong, [datum])
    sigma = sigma_f(fit, wrong, datum)
    # 1/f = 1/A + (m/d_2) (pitch q/d - 1): A's error reaches f whole, as (f/A)^2; pitch and d by f m/d_2 = 20.
    of_A = (100 / 92) ** 2 * fit.covariance.sigma["A"]
    assert sigma == pytest.approx(math.hypot(of_A, 100 * 20 * math.sqrt(2) * 1e-5), rel=0.5)
    assert sigma < 1.0 / 3
    assert found.f == pytest.approx(100.0, abs=3 * sigma)
    assert found.warnings == ()
    d_3 = found.lengths(wrong)["d_3"]
    assert abs(float(d_3) - 120) < 0.5 * abs(float(combine(fit, wrong, []).lengths(wrong)["d_3"]) - 120)


def test_draws_are_those_of_brute_force(fit):
    """Draws that know nothing of the pitch, each weighed by how well it meets it."""
    datum = white_pitch(fit, SHEET, PITCH * 1.0005, 1e-3)
    rng = np.random.default_rng(1)
    blind = laplace_draws(fit, SHEET, 400_000, rng)
    cameras, f = blind.parameters[:, :-1], blind.parameters[:, -1]
    # q is exact; d and the board's scale are told by what they do to m and d_2, and do not enter the pitch but so.
    drawn = np.stack([f, *SHEET.draws(len(f), rng)[1:]])
    off = (image_pitch(cameras, SHEET, drawn) / (PITCH * 1.0005) - 1) / 1e-3
    weight = np.exp(-0.5 * off**2)
    weight /= weight.sum()
    known = laplace_draws(fit, SHEET, 400_000, np.random.default_rng(2), [datum])
    lengths = derived(cameras, SHEET, drawn)
    for name in ("d_3", "H", "A", "m", "d_2"):
        mean = float(weight @ lengths[name])
        spread = math.sqrt(float(weight @ (lengths[name] - mean) ** 2))
        assert known.draws(name).mean() == pytest.approx(mean, abs=0.03 * spread), name
        assert known.draws(name).std() == pytest.approx(spread, rel=0.02), name


def test_shares_add_up_to_the_spread_of_the_draws(fit):
    data = [
        white_pitch(fit, EXACT, PITCH, 1e-4),
        board_distances(fit, EXACT, dict(enumerate(POSES.translation[:, 2])), 0.2, relative=True),
    ]
    shares = variance_shares(fit, EXACT, data)
    draws = laplace_draws(fit, EXACT, 40_000, np.random.default_rng(3), data)
    for name, row in shares.items():
        assert sum(share for source, share in row.items() if source != "sigma") == pytest.approx(1)
        assert row["sigma"] == pytest.approx(draws.draws(name).std(), rel=0.03), name
        assert {"white", "distances"} <= row.keys()


def test_readings_of_a_rail_tell_A_where_tilts_are_small():
    captures = replace(CAPTURES, tilt=math.radians(5), noise=0.1)
    off, gain = [], []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        poses = random_poses(captures, 120.0, rng)
        fit = calibrate(synthetic_observations(CAMERA, poses, captures, rng), SHEET, guess=92.0).fit
        readings = poses.translation[:, 2] - 77.0 + 0.05 * rng.normal(size=8)
        datum = board_distances(fit, EXACT, dict(enumerate(readings)), 0.05, relative=True)
        sigma = variance_shares(fit, EXACT, [datum])["A"]["sigma"]
        off.append((combine(fit, EXACT, [datum]).best[0] - 92) / sigma)
        gain.append(fit.covariance.sigma["A"] / sigma)
    assert np.median(gain) > 5
    assert 0.3 < np.sqrt(np.mean(np.square(off))) < 1.8


def test_distances_from_the_lens_tell_d_3(fit):
    told = dict(enumerate(POSES.translation[:, 2] + 120.0))
    wrong = replace(EXACT, f=101.0)  # would put the FAP 3.5 mm off
    datum = board_distances(fit, wrong, told, 0.1, relative=False)
    sigma = variance_shares(fit, wrong, [datum])["d_3"]["sigma"]
    d_3 = float(combine(fit, wrong, [datum]).lengths(wrong)["d_3"])
    assert sigma < 0.3 * variance_shares(fit, wrong)["d_3"]["sigma"]
    assert d_3 == pytest.approx(120.0, abs=3 * sigma)


def test_side_data_that_contradict_the_rest_are_told(fit):
    far = dict(enumerate(1.05 * POSES.translation[:, 2] + 120.0))
    (said,) = combine(fit, EXACT, [board_distances(fit, EXACT, far, 0.05, relative=True)]).warnings
    assert "the boards' distances and the rest disagree by" in said
    assert combine(fit, EXACT, [white_pitch(fit, EXACT, 1.01 * PITCH, 1e-4)]).warnings


def test_side_data_are_checked(fit):
    with pytest.raises(CalibrationError, match="above zero"):
        white_pitch(fit, SHEET, PITCH, 0.0)
    with pytest.raises(CalibrationError, match="two boards or more"):
        board_distances(fit, SHEET, {0: 200.0}, 0.1, relative=True)
    with pytest.raises(CalibrationError, match="above zero"):
        board_distances(fit, SHEET, {0: 200.0}, math.nan, relative=False)
