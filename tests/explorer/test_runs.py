"""Long runs from the page: what the forms ask for, progress, results, cancel, and nothing left behind."""

import os
import time

import pytest

from roslf_design.design import load
from roslf_design.errors import InputError
from roslf_design.explorer.optimise_run import GOALS, HELD, VARIABLES
from roslf_design.explorer.runs import (
    LEAST_TRIALS,
    MOST_TRIALS,
    begin,
    forms,
    kind_of,
    optimise_request,
    told,
    tolerance_request,
)
from roslf_design.explorer.tolerance_run import GRADES
from tests.explorer.test_browser import idle, shown, value
from tests.explorer.test_browser_runs import children

PAPER = load("paper")


def wait(condition, seconds=15.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


@pytest.mark.parametrize("grade", GRADES)
def test_the_tolerance_form_is_read(grade):
    request = tolerance_request(PAPER, {"grade": [grade], "trials": [" 500 "], "seed": ["7"], "calibrated": ["on"]})
    assert (request.design, request.grade, request.trials, request.seed) == (PAPER, grade, 500, 7)
    assert request.calibrated
    assert not tolerance_request(PAPER, {}).calibrated


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"trials": ["many"]}, f"trials: 'many' is not a whole number from {LEAST_TRIALS} to {MOST_TRIALS}"),
        ({"trials": ["1e9"]}, "trials: '1e9' is not"),
        ({"trials": ["5"]}, "trials: '5' is not"),
        ({"seed": ["-1"]}, "seed: '-1' is not"),
        ({"grade": ["best"]}, "grade: 'best' is not known"),
    ],
)
def test_what_the_tolerance_form_cannot_ask_is_told(options, message):
    with pytest.raises(InputError) as caught:
        tolerance_request(PAPER, options)
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
    request = optimise_request(PAPER, chosen)
    assert (request.goal, request.against) == (list(GOALS)[1], "depth")
    assert (request.variables, request.held) == (VARIABLES, tuple(HELD))
    assert (request.matched, request.undistorted) == (True, False)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "may vary: nothing is chosen"),
        ({"variables": ["no such"]}, "may vary: nothing is chosen"),
        ({"variables": ["d_2"], "goal": ["money"]}, "goal: 'money' is not known"),
        ({"variables": ["d_2"], "against": ["money"]}, "goal: 'money' is not known"),
    ],
)
def test_what_the_optimise_form_cannot_ask_is_told(options, message):
    with pytest.raises(InputError) as caught:
        optimise_request(PAPER, options)
    assert message in str(caught.value)


def test_there_is_no_other_kind_of_run():
    with pytest.raises(ValueError, match="no run called"):
        kind_of("__class__")


def test_a_run_is_told_from_start_to_cancel():
    assert told(None, PAPER)["state"] == "none"
    run = begin("tolerance", PAPER, {"trials": ["1000000"]})
    try:
        assert told(run, PAPER)["state"] == "running"
        assert told(run, PAPER.replace(D_F=3.0))["stale"]
    finally:
        run.job.cancel()
    assert told(run, PAPER)["state"] == "failed"
    assert told(run, PAPER)["message"] == "cancelled"


def test_a_tolerance_run_from_the_page(page, explorer):
    page.click("#tab-tolerance")
    page.fill("[data-testid=form-tolerance] [name=trials]", "lots")
    page.click("[data-testid=start-tolerance]")
    idle(page)
    assert "not a whole number" in page.inner_text("[data-testid=failed-tolerance]")
    page.fill("[data-testid=form-tolerance] [name=trials]", "64")
    page.select_option("[data-testid=form-tolerance] [name=grade]", "commercial")
    page.click("[data-testid=start-tolerance]")
    page.wait_for_selector("[data-testid=form-tolerance] progress")
    # Sliders go on meanwhile.
    page.locator("[data-field=D_F] .slider").press("PageUp")
    idle(page)
    assert value(page, "D_F") > PAPER.D_F
    page.wait_for_selector("[data-testid=found-tolerance]", timeout=60_000)
    assert "64 builds to the grade 'commercial'" in page.inner_text("[data-testid=found-tolerance]")
    assert "earlier design" in page.inner_text("[data-testid=found-tolerance]")
    for name in ("yield", "yield-curve", "offenders", "spreads"):
        assert page.locator(f"[data-picture={name}] svg").is_visible()
    assert page.input_value("[data-testid=form-tolerance] [name=trials]") == "64"
    wait(lambda: not children(explorer))


def test_a_run_is_cancelled_and_ends_with_its_tab(page, open_page, explorer):
    other = open_page()
    for each in (page, other):
        each.click("#tab-tolerance")
        each.fill("[data-testid=form-tolerance] [name=trials]", "1000000")
        each.click("[data-testid=start-tolerance]")
        each.wait_for_selector("[data-testid=form-tolerance] progress")
    assert len(children(explorer)) == 2
    page.click("[data-testid=cancel-tolerance]")
    page.wait_for_selector("[data-testid=failed-tolerance]")
    assert page.inner_text("[data-testid=failed-tolerance]") == "cancelled"
    wait(lambda: len(children(explorer)) == 1)
    other.close()
    wait(lambda: not children(explorer))


def test_an_optimum_is_found_and_taken(page):
    page.click("#tab-optimise")
    for name in ("d_3", "d_2"):
        page.uncheck(f"[data-testid=form-optimise] [name=variables][value={name}]")
    page.uncheck("[data-testid=form-optimise] [name=matched]")
    page.click("[data-testid=start-optimise]")
    page.wait_for_selector("[data-testid=found-optimise]", timeout=90_000)
    assert page.locator("[data-picture=changes] svg").is_visible()
    assert page.locator("[data-picture=search] svg").is_visible()
    assert shown(page, PAPER)
    page.click("[data-testid=take]")
    idle(page)
    # Depth precision grows with the pupil, alone: the optimum is at the end of its range.
    assert value(page, "D_F") == pytest.approx(2 * PAPER.D_F, rel=1e-4)
    page.click("[data-testid=undo]")
    idle(page)
    assert shown(page, PAPER)


def test_no_run_outlives_an_explorer_that_is_killed(open_page):
    from tests.explorer.conftest import Explorer

    running = Explorer("--port", "0")
    page = open_page(running.address)
    page.click("#tab-tolerance")
    page.fill("[data-testid=form-tolerance] [name=trials]", "1000000")
    page.click("[data-testid=start-tolerance]")
    page.wait_for_selector("[data-testid=form-tolerance] progress")
    assert len(children(running)) == 1
    page.context.close()
    os.kill(running.process.pid, 9)
    running.end()
    wait(lambda: not running.processes())
