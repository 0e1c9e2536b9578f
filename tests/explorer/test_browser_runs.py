"""Tolerance and optimisation runs as the explorer's user sees them, in headless Chromium."""

import re
import signal
import time

import pytest

from roslf_design import theory
from roslf_design.design import load
from roslf_design.explorer.fields import BY_SYMBOL, read
from roslf_design.explorer.tolerance_run import ToleranceRequest, run
from tests.explorer.conftest import Explorer

PAPER = load("paper")
LONG = 60_000
"""A run and its start on a busy machine [ms]."""


def show(page, view):
    page.get_by_role("tab", name=view).click()


def form(page, kind):
    return page.get_by_test_id(f"form-{kind}")


def started(page, kind, **options):
    for name, value in options.items():
        field = form(page, kind).locator(f"[name={name}]")
        if field.evaluate("e => e.tagName") == "SELECT":
            field.select_option(value)
        else:
            field.fill(str(value))
    form(page, kind).get_by_role("button", name="Start").click()


def tick(page, kind, name, *values):
    """Tick these of the boxes of a name, and no others."""
    for box in form(page, kind).locator(f"[name={name}]").all():
        box.set_checked(box.get_attribute("value") in values)


def found(page, kind):
    place = page.get_by_test_id(f"found-{kind}")
    place.wait_for(timeout=LONG)
    return place


def value(page, symbol):
    return read(BY_SYMBOL[symbol], page.locator(f"[data-field={symbol}] .number").input_value())


def until(question, seconds=20.0):
    end = time.monotonic() + seconds
    while not question() and time.monotonic() < end:
        time.sleep(0.05)
    return question()


def children(explorer):
    """Runs of this program that go on: Python's own helper, which tracks shared resources, is none."""
    return [line for line in explorer.processes() if "multiprocessing" in line and "resource_tracker" not in line]


def test_a_tolerance_run_tells_its_yield_and_draws_it(page):
    show(page, "Tolerance")
    started(page, "tolerance", trials=512, grade="commercial")
    told = found(page, "tolerance").inner_text()
    expected = run(ToleranceRequest(PAPER, "commercial", 512))
    assert f"{100 * expected.share.value:.3g} % of the builds hold every limit" in told
    assert "512 builds to the grade 'commercial'" in told
    for name in ("yield", "yield-curve", "offenders", "spreads"):
        assert page.locator(f"[data-picture={name}] svg").is_visible()
    offenders = page.locator("[data-picture=offenders]").inner_text()
    assert expected.offenders[0].place in offenders


def test_a_run_goes_on_beside_other_work_and_what_it_found_is_marked_when_the_design_moves_on(page):
    show(page, "Tolerance")
    started(page, "tolerance", trials=512)
    show(page, "Depth")
    page.locator("[data-field=D_F] .number").fill("2.8 mm")
    page.locator("[data-field=D_F] .number").press("Enter")
    show(page, "Tolerance")
    assert "earlier design" in found(page, "tolerance").inner_text()


def test_a_run_is_cancelled_and_its_process_is_gone(page, explorer):
    show(page, "Tolerance")
    started(page, "tolerance", trials=1_000_000)
    cancel = form(page, "tolerance").get_by_role("button", name="Cancel")
    page.wait_for_function(
        "() => /of 1000000 builds/.test(document.querySelector('[data-testid=form-tolerance]').innerText)", timeout=LONG
    )
    assert children(explorer)
    cancel.click()
    page.wait_for_function(
        "() => /cancelled/.test(document.querySelector('[data-testid=form-tolerance]').innerText)", timeout=LONG
    )
    assert not page.get_by_test_id("found-tolerance").is_visible()
    assert until(lambda: not children(explorer))


def test_a_run_ends_with_its_tab(open_page, explorer):
    page = open_page()
    show(page, "Tolerance")
    started(page, "tolerance", trials=1_000_000)
    assert until(lambda: children(explorer))
    page.close()
    assert until(lambda: not children(explorer))


def test_a_run_ends_with_the_program(chromium):
    running = Explorer("--port", "0")
    window = chromium.new_context()
    page = window.new_page()
    page.goto(running.address)
    page.wait_for_selector(".picture svg:visible")
    show(page, "Tolerance")
    started(page, "tolerance", trials=1_000_000)
    assert until(lambda: children(running))
    assert running.end(signal.SIGINT) == 0
    assert until(lambda: not running.processes())
    assert running.stderr == ""
    window.close()


@pytest.mark.parametrize("trials", ["many", "3"])
def test_builds_that_are_no_number_are_told_beside_the_form(page, trials):
    show(page, "Tolerance")
    started(page, "tolerance", trials=trials)
    told = form(page, "tolerance").get_by_text(f"'{trials}' is not a whole number from 64 to 1000000")
    told.wait_for()
    assert not page.get_by_test_id("found-tolerance").is_visible()


def test_an_optimum_is_found_taken_and_undone(page):
    show(page, "Optimise")
    tick(page, "optimise", "variables", "D_F")
    form(page, "optimise").locator("[name=undistorted]").set_checked(False)
    started(page, "optimise", goal="depth")
    told = found(page, "optimise")
    exact = float(theory.matched_pupil_diameter(PAPER.d, PAPER.d_2, PAPER.f, PAPER.d_f, PAPER.d_3).value)
    # Finest depth at a given place is the largest pupil that still matches.
    assert re.search(rf"2\.9 mm → {exact:.3f}", told.inner_text())
    assert page.locator("[data-picture=changes] svg").is_visible()
    assert page.locator("[data-picture=search] svg").is_visible()
    page.get_by_test_id("take").click()
    assert until(lambda: abs(value(page, "D_F") - exact) < 1e-5)
    assert until(lambda: "earlier design" in told.inner_text())
    page.keyboard.press("Control+z")
    assert until(lambda: value(page, "D_F") == 2.9)


def test_one_goal_is_set_against_another(page):
    show(page, "Optimise")
    tick(page, "optimise", "variables", "D_F", "d_2", "d_3", "d_f")
    started(page, "optimise", goal="depth", against="field")
    found(page, "optimise")
    assert page.locator("[data-picture=front] svg").is_visible()
    assert "field half width" in page.locator("[data-picture=front]").inner_text()


def test_nothing_to_vary_is_told(page):
    show(page, "Optimise")
    tick(page, "optimise", "variables")
    started(page, "optimise")
    form(page, "optimise").get_by_text("tick at least one number that may vary").wait_for()


def test_what_stands_in_the_way_is_told_and_cannot_be_taken(page):
    page.get_by_label("Presets").select_option("mismatched-borescope")
    assert until(lambda: value(page, "f") == 50)
    show(page, "Optimise")
    tick(page, "optimise", "held", "depth", "pixels", "light", "length")
    started(page, "optimise")
    told = found(page, "optimise")
    assert "cannot hold together" in told.inner_text()
    assert "What helps" in told.inner_text()
    assert not page.get_by_test_id("take").is_visible()
