"""`roslf optimize --accuracy`: stopping rules loosened as far as the optimum may be off, and the error told."""

import json
from dataclasses import replace

import numpy as np
import pytest

from roslf_design.cli import main
from roslf_design.optimization.search import search
from roslf_design.optimization.solve import Settings, optimum_accuracy, solve
from roslf_design.optimization.study import load_study
from tests.optimization.posing import GOOD

STUDY = "studies/optimize-ear-speculum/study.toml"


def valley(units):
    """Rosenbrock's valley over the unit box, its floor at 0 in (0.6, 0.36): slow to walk along, curved everywhere."""
    x, y = units.T
    return np.stack([(0.6 - x) ** 2 + 100 * (y - x * x) ** 2, x + y - 1.9])


@pytest.mark.parametrize("accuracy", [1e-1, 1e-2, 1e-4, 1e-6])
def test_searches_end_within_the_accuracy_and_sooner(accuracy):
    tolerance = Settings(accuracy=accuracy).tolerance
    spent = 0
    for start in np.random.default_rng(5).random((12, 2)):
        found = search(valley, start, tolerance=tolerance)
        assert found.merit <= accuracy
        spent += found.evaluations
    whole = sum(search(valley, start).evaluations for start in np.random.default_rng(5).random((12, 2)))
    assert spent < whole


def test_optimum_of_a_study_is_within_what_was_asked_for():
    study = load_study(STUDY)
    usual = study.settings.model_copy(update={"starts": 4})
    best = solve(study.problem, usual.model_copy(update={"check": False})).merit
    evaluations = []
    for accuracy in (0.3, 1e-2, 1e-5):
        answer = solve(study.problem, usual.model_copy(update={"accuracy": accuracy}))
        told = optimum_accuracy(answer)
        assert abs(answer.merit - best) <= told.expected_error == accuracy
        assert told.measured_error <= accuracy
        assert told.kept
        evaluations.append(answer.evaluations)
    assert evaluations[0] < evaluations[1] < evaluations[2]
    assert optimum_accuracy(replace(answer, feasible=False)) is None


def test_the_command_tells_it(tmp_path, capsys):
    (tmp_path / "study.toml").write_text(GOOD)
    line = ["optimize", str(tmp_path / "study.toml"), "-o", str(tmp_path / "out"), "--accuracy", "0.01", "--json"]
    assert main(line) == 0
    told = json.loads(capsys.readouterr().out)["accuracy"]
    assert told["asked"] == told["expected_error"] == 0.01
    assert told["measured_error"] <= 0.01
    assert told["seconds"] > 0
    written = json.loads((tmp_path / "out" / "results.json").read_text())["accuracy"]
    assert "seconds" not in written
    assert "asked for" in (tmp_path / "out" / "index.html").read_text()


@pytest.mark.parametrize("value", ["0", "-1", "nan", "1e-20", "fine", "2"])
def test_no_accuracy_is_one_line_and_nothing_written(value, tmp_path, capsys):
    assert main(["optimize", STUDY, "-o", str(tmp_path / "out"), "--accuracy", value]) == 2
    told = capsys.readouterr().err
    assert "--accuracy" in told
    assert len(told.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()
