"""`roslf calibrate --accuracy`: a posterior sampled for as long as its means take, and their error told."""

import numpy as np
import pytest

from roslf_design.calibration.calibrate import calibrate
from roslf_design.calibration.datasheet import DataSheet, laplace_draws
from roslf_design.calibration.model import Intrinsics
from roslf_design.calibration.planning import Captures, random_poses, synthetic_observations
from roslf_design.calibration.posterior import (
    most_steps_for,
    posterior_accuracy,
    sample_posterior,
    sample_size_for,
)
from roslf_design.cli import main

CAMERA = Intrinsics(92.0, 0.4, 0.5, 182.0, 118.0, q=0.004847826, d=0.063)
SHEET = DataSheet(100.0, CAMERA.q, CAMERA.d, 1.0, d_sigma=6.3e-5, cell_sigma=1e-3)


@pytest.fixture(scope="module")
def fit():
    captures, rng = Captures(boards=5, views=3), np.random.default_rng(0)
    observations = synthetic_observations(CAMERA, random_poses(captures, 120.0, rng), captures, rng)
    return calibrate(observations, SHEET).fit


@pytest.fixture(scope="module")
def runs(fit):
    size = sample_size_for(0.2)
    return [sample_posterior(fit, SHEET, seed=seed, chunk=150, most_steps=150, ess=size) for seed in range(4)]


def test_means_of_repeated_runs_scatter_as_told(runs):
    """Four runs, six parameters: their scatter is known to a sixth or so, one run's measured error to a fourth."""
    means = np.array([run.parameters.mean(0) for run in runs]) / runs[0].parameters.std(0)
    scatter = float(np.sqrt(np.mean(means.var(axis=0, ddof=1))))
    told = [posterior_accuracy(run, 0.2) for run in runs]
    assert all(one.expected_error <= 0.2 for one in told)
    assert 2 * scatter <= 1.5 * max(one.expected_error for one in told)
    assert 0.3 < np.median([one.measured_error for one in told]) / (2 * scatter) < 3


def test_more_accuracy_takes_more_steps(fit, runs):
    finer = sample_posterior(fit, SHEET, seed=0, chunk=300, ess=sample_size_for(0.1))
    assert finer.converged
    assert finer.steps > runs[0].steps
    told = posterior_accuracy(finer, 0.1)
    assert told.expected_error <= 0.1 * 1.01  # of 40000 draws kept, a hundredth more
    assert sample_size_for(None) == 400
    assert most_steps_for(sample_size_for(0.02)) == 60_000


def test_laplace_says_what_it_is(fit):
    draws = laplace_draws(fit, SHEET, 10_000, np.random.default_rng(0))
    told = posterior_accuracy(draws)
    assert told.expected_error == pytest.approx(0.02)
    assert "normal" in told.model
    assert told.kept is None


@pytest.mark.parametrize("value", ["0", "-1", "nan", "1e-20", "fine", "2"])
def test_no_accuracy_is_one_line_and_nothing_written(value, tmp_path, capsys):
    line = ["calibrate", str(tmp_path), "--design", "paper", "--board", "4x5 6 mm", "-o", str(tmp_path / "out")]
    assert main([*line, "--accuracy", value]) == 2
    told = capsys.readouterr().err
    assert "--accuracy" in told
    assert len(told.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_accuracy_is_the_posteriors(tmp_path, capsys):
    line = ["calibrate", str(tmp_path), "--design", "paper", "--board", "4x5 6 mm", "-o", str(tmp_path / "out")]
    assert main([*line, "--accuracy", "0.1", "--no-posterior"]) == 2
    assert "--no-posterior" in capsys.readouterr().err
    assert main(["calibrate", "--plan", "paper", "--accuracy", "0.1"]) == 2
    assert "--plan" in capsys.readouterr().err
