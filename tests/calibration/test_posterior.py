"""The posterior against brute force, exact laws, coverage of known truths, and its own repeatability."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

import roslf_design as roslf
from roslf_design.calibration import (
    CalibrationError,
    Captures,
    calibrate,
    depth_errors,
    laplace_draws,
    sample_posterior,
    variance_shares,
)
from roslf_design.calibration.lengths import calibrated_lengths
from roslf_design.calibration.model import Observations, derived, project_boards
from roslf_design.calibration.posterior import (
    _ProfileLikelihood,
    most_steps_for,
    posterior_accuracy,
    sample_size_for,
)
from roslf_design.cli import main
from roslf_design.depth.geometry import calibration_sigma
from tests.calibration.made import CAMERA, SHEET, captured, poses_of, study


@pytest.fixture(scope="module")
def coverage(root):
    """Many synthetic calibrations with known truth: the study's, their posteriors good to a tenth of a sigma."""
    module = study(root / "studies" / "calibration-coverage" / "coverage_study.py")
    module.sample_posterior = lambda *given, chunk, **keys: sample_posterior(*given, chunk=50, most_steps=100, **keys)
    return module.coverage


@pytest.fixture(scope="module")
def fit():
    return calibrate(captured(Captures(boards=5, views=3)), SHEET).fit


@pytest.fixture(scope="module")
def posterior(fit):
    return sample_posterior(fit, SHEET, seed=3, chunk=200)


def brute_force(fit, camera):
    """Sum of squares with every pose fitted by scipy, from the model of corners in views alone."""
    data = fit.statistics
    total = 0.0
    for b in range(len(data.values)):
        middle = data.at[b, 0]
        views = middle + np.array([[0, 0], [1e-3, 0], [-1e-3, 0], [0, 1e-3], [0, -1e-3]])

        def off(pose, b=b, views=views):
            uv = project_boards(camera.vector(), pose[None], data.points, views).values[0]
            place = uv[0]
            slope = ((uv[1] - uv[2])[:, 0] + (uv[3] - uv[4])[:, 1]) / 4e-3  # share 1/2: a round pupil
            model = np.concatenate([place, slope[:, None]], axis=1)
            return ((model - data.values[b]) / data.sigma[b]).ravel()

        total += 2 * least_squares(off, fit.poses.vector[b], method="lm", x_scale="jac", diff_step=1e-7).cost
    return total


def test_likelihood_is_the_misfit_with_every_pose_fitted(fit):
    likelihood = _ProfileLikelihood(fit)
    root = np.linalg.cholesky(fit.covariance.matrix)
    rng = np.random.default_rng(1)
    for _ in range(3):
        step = 1.5 * rng.normal(size=5)
        camera = fit.camera.with_values(fit.covariance.names, fit.camera.vector(fit.covariance.names) + root @ step)
        value = likelihood(camera.vector(likelihood.names)[None])[0]
        assert value == pytest.approx(-0.5 * brute_force(fit, camera), abs=0.02)  # one closed-form step a pose
    np.testing.assert_allclose(likelihood.peak, -0.5 * brute_force(fit, fit.camera), atol=1e-4)


def test_boards_behind_the_camera_are_impossible_not_undefined(fit):
    likelihood = _ProfileLikelihood(fit)
    cameras = np.tile(likelihood.best, (3, 1))
    cameras[0, 0], cameras[1, 1], cameras[2, 2] = -92.0, -0.4, -0.5
    assert (likelihood(cameras) == -np.inf).all()


def test_posterior_is_the_normal_law_of_the_fisher_matrix_near_its_peak(fit, posterior):
    assert posterior.converged, posterior.message
    assert posterior.message.startswith("converged")
    sigma = fit.covariance.sigma
    for name in fit.covariance.names:
        draws = posterior.parameters[:, posterior.names.index(name)]
        assert draws.std() == pytest.approx(sigma[name], rel=0.15)
        assert abs(draws.mean() - getattr(fit.camera, name)) < 0.35 * sigma[name]
    assert posterior.draws("f").mean() == pytest.approx(100.0, abs=0.1)
    assert posterior.draws("f").std() == pytest.approx(1.0, rel=0.08)
    names = ["A", "m"]
    spread = np.zeros((3, 3))
    spread[0, 0] = 1.0
    spread[1:, 1:] = fit.covariance.part(names)
    f, A, m = 100.0, fit.camera.A, fit.camera.m
    by = np.array(
        [
            [1 + m, 0, f],
            [1 + 1 / m, 0, -f / m**2],
            [(1 + m) / A, -f * (1 + m) / A**2, f / A],
            [1 + 1 / m, -1 / m, (A - f) / m**2],
        ]
    )
    lengths = by @ spread @ by.T
    for k, name in enumerate(("d_1", "d_f", "H", "d_3")):
        assert posterior.quantities[name].std() == pytest.approx(math.sqrt(lengths[k, k]), rel=0.15)
    low, high = np.quantile(posterior.draws("d_3"), [0.025, 0.975])
    assert low < 120.0 < high
    with pytest.raises(ValueError, match="no quantity 'd_4' in the posterior: it holds H, d_3"):
        posterior.draws("d_4")


def test_same_seed_same_draws_and_a_short_run_says_that_it_did_not_converge(fit):
    short, again, other = (sample_posterior(fit, SHEET, seed=seed, chunk=10, most_steps=10) for seed in (0, 0, 1))
    np.testing.assert_array_equal(short.parameters, again.parameters)
    np.testing.assert_array_equal(short.quantities["d_2"], again.quantities["d_2"])
    assert not np.array_equal(short.parameters, other.parameters)
    assert not short.converged
    assert short.message.startswith("NOT converged after 10 steps: R-hat")


def test_distortion_is_sampled_where_asked():
    camera = replace(CAMERA, k_1=0.5, k_2=-5.0)
    fit = calibrate(captured(Captures(boards=6, views=3, offset=20.0), camera=camera), SHEET, distortion=2).fit
    posterior = sample_posterior(fit, SHEET, seed=1, chunk=30, most_steps=30)
    assert posterior.names == ("A", "m", "inverse_d_2", "x_0", "y_0", "k_1", "k_2", "c_1", "b_1", "f")
    assert abs(posterior.draws("k_1").mean() - 0.5) < 4 * fit.covariance.sigma["k_1"]


def test_variance_shares_add_up_and_agree_with_draws(fit):
    shares = variance_shares(fit, SHEET)
    draws = laplace_draws(fit, SHEET, 40_000, np.random.default_rng(0)).quantities
    for name, parts in shares.items():
        assert sum(v for key, v in parts.items() if key != "sigma") == pytest.approx(1.0)
        assert parts["sigma"] == pytest.approx(draws[name].std(), rel=0.03)
    assert shares["d_f"]["f"] > 0.95  # d_f = f (1 + m)/m, and m is known well
    known = variance_shares(fit, replace(SHEET, f_sigma=0.0, d_sigma=0.0, cell_sigma=0.0))
    assert known["d_3"]["images"] == pytest.approx(1.0)
    assert shares["d_3"]["sigma"] ** 2 * shares["d_3"]["f"] == pytest.approx((1 + 1 / fit.camera.m) ** 2, rel=1e-3)


def test_depth_errors_are_those_of_the_draws(fit, posterior):
    d_3 = 100 + (100 - fit.camera.A) / fit.camera.m
    d_f = 100 * (1 + fit.camera.m) / fit.camera.m
    found = depth_errors(posterior, fit, SHEET, np.array([250.0, d_f, 500.0]))
    # On the focal plane the slope is 0 whatever A and d_2 are: Z is d_f's error, Z_F is A/m's.
    assert found["from_lens"][1] == pytest.approx(posterior.quantities["d_f"].std(), rel=1e-3)
    assert found["from_pupil"][1] == pytest.approx(
        (posterior.quantities["A"] / posterior.quantities["m"]).std(), rel=1e-3
    )
    assert (found["low_95"] < 0).all()
    assert (found["high_95"] > 0).all()
    with pytest.raises(CalibrationError, match="beyond the FAP"):
        depth_errors(posterior, fit, SHEET, np.array([d_3 - 1.0]))


def test_intervals_of_68_percent_hold_the_truth_as_often_as_they_say(coverage):
    found = coverage(140.0, 2.0, 120.0, SHEET, Captures(boards=6, views=3), trials=24, seed=1)
    assert found.failed == 0
    assert found.trials == 24
    low, high = found.expected
    assert (low, high) == pytest.approx((0.417, 0.917), abs=0.001)  # binomial, 99 of 100
    for name, share in found.share.items():
        assert low <= share <= high, (name, share)
        assert abs(found.pulls[name].mean()) < 0.6  # three times what chance makes of 24
        assert 0.6 < found.pulls[name].std() < 1.45


def test_intervals_of_the_sampled_posterior_hold_too(coverage):
    found = coverage(
        140.0, 2.0, 120.0, SHEET, Captures(boards=3, views=3), trials=2, seed=2, level=0.95, method="ensembles"
    )
    assert found.failed == 0
    assert all(share >= found.expected[0] > 0 for share in found.share.values())
    fisher = coverage(140.0, 2.0, 120.0, SHEET, Captures(boards=3, views=3), trials=2, seed=2, level=0.95)
    for name, pulls in found.pulls.items():  # the same cameras, judged alike by both
        np.testing.assert_allclose(pulls, fisher.pulls[name], atol=0.5)


# --- how long it is sampled -------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def runs(fit):
    size = sample_size_for(0.2)
    return [sample_posterior(fit, SHEET, seed=seed, chunk=60, most_steps=60, ess=size) for seed in range(4)]


def test_means_of_repeated_runs_scatter_as_told(runs):
    """Four runs, six parameters: their scatter is known to a sixth or so, one run's measured error to a fourth."""
    means = np.array([run.parameters.mean(0) for run in runs]) / runs[0].parameters.std(0)
    scatter = float(np.sqrt(np.mean(means.var(axis=0, ddof=1))))
    told = [posterior_accuracy(run, 0.2) for run in runs]
    assert all(one.expected_error <= 0.2 for one in told)
    assert 2 * scatter <= 1.5 * max(one.expected_error for one in told)
    assert 0.3 < np.median([one.measured_error for one in told]) / (2 * scatter) < 3


def test_more_accuracy_takes_more_steps(posterior, runs):
    assert posterior.steps > runs[0].steps
    assert posterior_accuracy(posterior, 0.1).expected_error <= 0.1 * 1.01  # of 40000 draws kept, a hundredth more
    assert sample_size_for(None) == sample_size_for(0.1) == 400
    assert most_steps_for(sample_size_for(0.02)) == 60_000


def test_laplace_says_what_it_is(fit):
    told = posterior_accuracy(laplace_draws(fit, SHEET, 10_000, np.random.default_rng(0)))
    assert told.expected_error == pytest.approx(0.02)
    assert "normal" in told.model
    assert told.kept is None


@pytest.mark.parametrize("value", ["0", "-1", "nan", "1e-20", "fine", "2", "0.1"])
def test_no_accuracy_is_one_line_and_nothing_written(value, tmp_path, capsys):
    line = ["calibrate", str(tmp_path), "--design", "paper", "--board", "4x5 6 mm", "-o", str(tmp_path / "out")]
    beside = ["--no-posterior"] if value == "0.1" else []
    assert main([*line, "--accuracy", value, *beside]) == 2
    said = capsys.readouterr().err
    assert "--accuracy" in said
    assert all(option in said for option in beside)
    assert len(said.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()
    assert main(["calibrate", "--plan", "paper", "--accuracy", "0.1"]) == 2
    assert "--plan" in capsys.readouterr().err


def test_pitches_that_are_off_are_in_the_slopes_measured_too():
    """Instruments whose pitches are not the data sheet's, each calibrated, then measuring points: no error from those.

    Only the pupil's place depends on them: d_3 = f + (f - A)/m, with f known.
    """
    sheet = replace(SHEET, f_sigma=0.0, cell_sigma=0.0, d_sigma=2e-3 * SHEET.d, q_sigma=1e-3 * SHEET.q)
    distances, captures = np.array([200.0, 320.0, 900.0]), Captures(boards=5, views=3)
    poses, views, points = poses_of(captures.boards), captures.view_grid(), captures.board.points

    def fitted(camera):
        uv = project_boards(camera.vector(), poses.vector, points, views).values
        return calibrate(Observations(points, views, uv), sheet).fit

    for q, d in ((sheet.q, 1.02 * sheet.d), (1.01 * sheet.q, 0.98 * sheet.d)):
        true = replace(CAMERA, q=q, d=d)
        found = sheet.apparent(derived(fitted(true).camera.vector(), sheet))
        depth = distances - (100.0 + (100.0 - true.A) / true.m)
        slope = q * true.A * true.inverse_d_2 / d * (true.m - true.A / depth)
        told = found.A / (found.m - slope * sheet.d * found.d_2 / (sheet.q * found.A))
        np.testing.assert_allclose(told, depth, rtol=1e-6)

    fit = fitted(CAMERA)
    fit = fit._replace(covariance=fit.covariance._replace(matrix=1e-20 * np.eye(5)))
    draws = laplace_draws(fit, sheet, 4000, np.random.default_rng(0))
    errors = depth_errors(draws, fit, sheet, distances)
    np.testing.assert_allclose(errors["from_pupil"], 0.0, atol=1e-6)  # images known to 1e-10
    np.testing.assert_allclose(errors["from_lens"], draws.draws("d_3").std(ddof=1), rtol=1e-6)
    carried = calibration_sigma(
        roslf.load("paper"), calibrated_lengths(roslf.load("paper"), draws, fit, sheet).covariance, distances
    )
    np.testing.assert_allclose(carried, errors["from_lens"], rtol=0.01)  # to first order
