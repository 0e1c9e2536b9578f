"""Long runs from the page: what the forms ask for, progress, results, cancel, and nothing left behind."""

import pytest

from roslf_design.design import load
from roslf_design.errors import InputError
from roslf_design.explorer.runs import (
    GOALS,
    GRADES,
    HELD,
    VARIABLES,
    OptimiseRequest,
    Run,
    ToleranceRequest,
    forms,
    read_form,
    summary,
)

PAPER = load("paper")


@pytest.mark.parametrize("grade", GRADES)
def test_the_tolerance_form_is_read(grade):
    request = read_form(
        ToleranceRequest, PAPER, {"grade": [grade], "trials": [" 500 "], "seed": ["7"], "calibrated": ["on"]}
    )
    assert (request.design, request.grade, request.trials, request.seed) == (PAPER, grade, 500, 7)
    assert request.calibrated
    assert not read_form(ToleranceRequest, PAPER, {}).calibrated


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"trials": ["many"]}, "trials: 'many' is not a whole number from 64 to 1000000"),
        ({"trials": ["1e9"]}, "trials: '1e9' is not"),
        ({"trials": ["5"]}, "trials: '5' is not"),
        ({"seed": ["-1"]}, "seed: '-1' is not"),
        ({"grade": ["best"]}, "grade: 'best' is not known"),
    ],
)
def test_what_the_tolerance_form_cannot_ask_is_told(options, message):
    with pytest.raises(InputError) as caught:
        read_form(ToleranceRequest, PAPER, options)
    assert message in str(caught.value)


def test_the_optimise_form_is_read():
    offered = forms(PAPER)
    chosen = {
        "goal": [offered["goals"][1]["key"]],
        "against": ["depth"],
        "variables": [item["key"] for item in offered["variables"]],
        "held": [item["key"] for item in offered["held"]],
        "matched": ["on"],
    }
    request = read_form(OptimiseRequest, PAPER, chosen)
    assert (request.goal, request.against) == (list(GOALS)[1], "depth")
    assert (request.variables, request.held) == (VARIABLES, tuple(HELD))
    assert (request.matched, request.undistorted) == (True, False)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "may vary: nothing is chosen"),
        ({"variables": ["no such"]}, "may vary: nothing is chosen"),
        ({"variables": ["d_2"], "goal": ["money"]}, "goal: 'money' is not known"),
        ({"variables": ["d_2"], "against": ["money"]}, "against: 'money' is not known"),
    ],
)
def test_what_the_optimise_form_cannot_ask_is_told(options, message):
    with pytest.raises(InputError) as caught:
        read_form(OptimiseRequest, PAPER, options)
    assert message in str(caught.value)


def test_a_run_is_told_from_start_to_cancel():
    assert summary(None, PAPER)["state"] == "none"
    run = Run.begin("tolerance", PAPER, {"trials": ["1000000"]})
    try:
        assert summary(run, PAPER)["state"] == "running"
        assert summary(run, PAPER.replace(D_F=3.0))["stale"]
    finally:
        run.job.cancel()
    assert summary(run, PAPER)["state"] == "failed"
    assert summary(run, PAPER)["message"] == "cancelled"
