"""`roslf tolerance --accuracy`: as many trials as it takes, and standard errors that are those of repeated runs."""

import json
from dataclasses import replace

import numpy as np
import pytest

from roslf_design.cli import main
from roslf_design.tolerancing.result import precision, shapes_text, trials_for
from roslf_design.tolerancing.run import tally_chunk
from roslf_design.tolerancing.study import plan_from
from roslf_design.tolerancing.summaries import summarise
from roslf_design.tolerancing.tally import merged
from roslf_design.tolerancing.yields import Yield

GOALS = [{"metric": "fill_factor", "max": 1.02}]
PERTURB = [{"place": "sensor.distance", "tolerance": "0.06 mm"}]
STUDY = """name = "short"
design = "paper"
trials = 2000
sobol_samples = 0
[[perturb]]
place = "sensor.distance"
tolerance = "0.06 mm"
[[goals]]
metric = "fill_factor"
max = 1.02
"""


DATA = {"name": "s", "design": "paper", "goals": GOALS, "perturb": PERTURB}


def run_of(trials, seed=0):
    plan = plan_from(DATA | {"trials": trials, "seed": seed})
    tally = merged(tally_chunk(plan, index) for index in range(plan.chunks))
    return plan, tally, summarise(plan, tally)[-1]


def test_standard_errors_are_the_spread_of_repeated_runs():
    """100 runs of other seeds: the spread of their yields is known to 7 %, one run's measured error to 16 %."""
    runs = [run_of(2000, seed) for seed in range(100)]
    told = precision(*runs[0], 0.05)
    yields = [final.result.value for _, _, final in runs]
    medians = [final.distributions[0].quantiles[3] for _, _, final in runs]
    spread = np.std(yields, ddof=1)
    assert told.yield_.expected == pytest.approx(spread, rel=0.3)
    assert told.yield_.measured == pytest.approx(spread, rel=0.6)
    assert told.ranks.expected == pytest.approx(0.5 / np.sqrt(2000), rel=1e-12)
    # The rank of a median is the share of one long run below it.
    _, _, whole = run_of(200_000, 999)
    column = whole.distributions[0]
    ranks = np.interp(medians, column.quantiles, column.probabilities)
    assert np.std(ranks, ddof=1) == pytest.approx(told.ranks.expected, rel=0.3)
    assert told.accuracy.kept


def test_errors_measured_from_part_of_a_run_are_scaled_to_it():
    """20 parts of a quarter of the run tell its errors to a sixth; too few kept trials tell nothing."""
    plan = replace(plan_from(DATA | {"trials": 40_000}), chunk=40_000)
    tally = tally_chunk(plan, 0)
    final = summarise(plan, tally)[-1]
    kept = precision(plan, tally, final)
    assert kept.accuracy.measured_by == "20 parts of the first 10,000 trials, scaled"
    assert kept.yield_.measured == pytest.approx(kept.yield_.expected, rel=0.7)
    assert kept.ranks.measured == pytest.approx(kept.ranks.expected, rel=0.7)
    assert (kept.accuracy.asked, kept.accuracy.kept) == (None, None)
    few = precision(plan, replace(tally, measured=tally.measured[:100]), final)
    assert few.yield_.measured is few.ranks.measured is few.accuracy.measured_error is None


@pytest.mark.parametrize("accuracy", [1.0, 0.3, 0.1, 0.01, 1e-3])
def test_trials_are_enough_whatever_the_yield(accuracy):
    n = trials_for(accuracy)
    for passed in {0, n // 4, n // 2, n}:
        low, high = Yield(passed, n).interval
        assert (high - low) / 2 <= accuracy
    sobol = trials_for(accuracy, "sobol")
    assert sobol & (sobol - 1) == 0
    assert n <= sobol < 2 * n


def test_a_study_to_an_accuracy(tmp_path, capsys):
    study = tmp_path / "study.toml"
    study.write_text(STUDY)
    results = []
    for name in ("one", "two"):
        assert main(["tolerance", str(study), "-o", str(tmp_path / name), "--accuracy", "0.02", "--json"]) == 0
        printed = json.loads(capsys.readouterr().out)
        assert printed["accuracy"]["seconds"] > 0
        results.append((tmp_path / name / "results.json").read_bytes())
    assert results[0] == results[1]  # times are told, not written
    told = json.loads(results[0])
    assert told["trials"] == trials_for(0.02)
    assert told["accuracy"]["asked"] == 0.02
    assert told["accuracy"]["expected_error"] <= 0.02
    assert told["accuracy"]["measured_error"] > 0
    assert told["accuracy"]["method"].startswith("2,601 random builds; ")
    assert "closed forms" in told["accuracy"]["method"]
    page = (tmp_path / "one" / "index.html").read_text()
    assert "asked for 2 % of the builds" in page
    low, high = told["yield"]["interval_95"]
    assert f"<p>Yield known to ±{50 * (high - low):.2g} % of the builds (95 %)" in page


@pytest.mark.parametrize("value", ["0", "-1", "nan", "1e-20", "fine", "2"])
def test_no_accuracy_is_one_line_and_nothing_written(value, tmp_path, capsys):
    study = tmp_path / "study.toml"
    study.write_text(STUDY)
    assert main(["tolerance", str(study), "-o", str(tmp_path / "out"), "--accuracy", value]) == 2
    told = capsys.readouterr().err
    assert "--accuracy" in told
    assert len(told.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_trials_and_accuracy_exclude_each_other(tmp_path, capsys):
    study = tmp_path / "study.toml"
    study.write_text(STUDY)
    line = ["tolerance", str(study), "-o", str(tmp_path / "out"), "--accuracy", "0.1", "--trials", "10"]
    assert main(line) == 2
    assert "--trials" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("design", "goal", "place", "says"),
    [
        ("paper", "fill_factor", "sensor.distance", "closed forms"),
        ("paper", "kept_fraction", "sensor.distance", "discs"),
        ("paper", "kept_fraction", "aperture.tilt.0", "ellipses"),
        ("paper-singlet", "kept_fraction", "sensor.distance", "its own lens"),
    ],
)
def test_the_way_builds_are_computed_is_told(design, goal, place, says):
    tolerance = "0.01 mm" if place == "sensor.distance" else "3 mrad"
    plan = plan_from(
        {
            "name": "s", "design": design, "goals": [{"metric": goal, "min": 0.5}], "trials": 10,
            "perturb": [{"place": place, "tolerance": tolerance}],
        }
    )  # fmt: skip
    assert says in shapes_text(plan)
