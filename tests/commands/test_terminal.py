"""What long work shows, on a terminal only and nothing of it left behind; and how a command is typed again."""

from __future__ import annotations

import io
import re
import sys
import time

import pytest

from roslf_design.cli import main
from roslf_design.commands.terminal import StatusLine, _Log, bar, status_and_bars, tell_cost, typed
from roslf_design.words import about_time
from tests.commands.test_datasheet import STUDY
from tests.reporting.made import few_builds, few_waves


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def terminal(monkeypatch):
    """Standard error as a terminal: set inside the test, since pytest puts its own back after each fixture."""
    shown = Terminal()
    monkeypatch.setattr(sys, "stderr", shown)
    monkeypatch.setenv("TERM", "xterm")
    return shown


def test_the_status_line_replaces_itself_and_is_gone_afterwards(monkeypatch):
    shown = terminal(monkeypatch)
    with StatusLine("report") as status:
        status.tell("figures")
        status.tell("PDF")
    assert shown.getvalue() == "\r\x1b[2Kreport: figures ...\r\x1b[2Kreport: PDF ...\r\x1b[2K"


def test_a_bar_shows_nothing_of_work_that_is_soon_over(monkeypatch):
    shown = terminal(monkeypatch)
    with bar("trials", 100) as tell:
        tell(100)
    assert shown.getvalue() == ""


@pytest.mark.parametrize(("total", "text"), [(400, "100 of 400"), (1.0, "25%")])
def test_a_bar_counts_things_and_shares(monkeypatch, total, text):
    shown = terminal(monkeypatch)
    monkeypatch.setattr("roslf_design.commands.terminal.PATIENCE", -1.0)
    with bar("trials", total) as tell:
        tell(0.25 * total)
    assert text in shown.getvalue()


def test_silent_where_stderr_is_no_terminal(monkeypatch):
    shown = io.StringIO()
    monkeypatch.setattr(sys, "stderr", shown)
    with StatusLine("report") as status, bar("trials", 10) as tell:
        status.tell("figures")
        tell(5)
    assert shown.getvalue() == ""


def test_a_command_is_typed_again_with_what_was_given():
    given = {"compare": False, "output": "a b", "figure": ["rays", "maps"], "seed": 0, "accuracy": 1e-4, "board": None}
    again = typed("report", "paper", pdf=True, **given)
    assert again == "roslf report paper --pdf -o 'a b' --figure rays --figure maps --seed 0 --accuracy 0.0001"


def test_cost_is_told_beforehand_of_what_needs_patience(monkeypatch):
    shown = terminal(monkeypatch)
    tell_cost(1.0, "a little")
    tell_cost(41.3, "2.1 million pixels x 256 rays")
    assert shown.getvalue() == "about 41 s: 2.1 million pixels x 256 rays\n"
    tell_cost(1.0, "a little", is_compiled=False)
    assert "once on this machine" in shown.getvalue().splitlines()[1]


def test_a_log_has_a_line_of_progress_now_and_then(monkeypatch):
    shown, clock = io.StringIO(), iter([0.0, 10.0, 40.0, 50.0, 80.0, 100.0])
    monkeypatch.setattr("roslf_design.commands.terminal.LOGGED", 30.0)
    monkeypatch.setattr(sys, "stderr", shown)
    monkeypatch.setattr("roslf_design.commands.terminal.time.monotonic", lambda: next(clock))
    with bar("trials", 100) as tell:
        for done in (10, 40, 50, 80, 100):
            tell(done)
    assert shown.getvalue() == "trials: 40%, about 60 s left\ntrials: 80%, about 20 s left\n"


def test_what_was_done_before_a_step_began_makes_it_no_faster(monkeypatch):
    """Of combinations that bounds rule out at once, and of a run that goes on."""
    shown, clock = io.StringIO(), iter([0.0, 1.0, 41.0])
    monkeypatch.setattr("roslf_design.commands.terminal.LOGGED", 30.0)
    monkeypatch.setattr(sys, "stderr", shown)
    monkeypatch.setattr("roslf_design.commands.terminal.time.monotonic", lambda: next(clock))
    with bar("combinations decided", 100) as tell:
        tell(80)
        tell(90)
    assert shown.getvalue() == "combinations decided: 90%, about 40 s left\n"


def test_a_log_has_steps_and_what_is_counted_in_them(monkeypatch):
    """One clock for all steps: many short ones are told of as well as one long one; the time left is the step's own."""
    shown, clock = io.StringIO(), iter([0.0, 10.0, 31.0, 40.0, 50.0, 70.0, 90.0, 150.0, 160.0])
    monkeypatch.setattr("roslf_design.commands.terminal.LOGGED", 30.0)
    monkeypatch.setattr(sys, "stderr", shown)
    monkeypatch.setattr("roslf_design.commands.terminal.time.monotonic", lambda: next(clock))
    with status_and_bars("report") as tell:
        tell("evaluating")
        tell("sections")
        tell("figures", 0, 10)
        tell("figures", 1, 10)
        tell("figures", 6, 10)
        tell("PDF")
        tell("part 2, tolerances: builds", 0, 50)
        tell("part 2, tolerances: builds", 20, 50)
    assert shown.getvalue().splitlines() == [
        "report: sections ...",
        "report: figures: 60%, about 20 s left",
        "report: part 2, tolerances: builds: 40%, about 15 s left",
    ]


def test_bars_follow_each_other_and_status_lines(monkeypatch):
    shown = terminal(monkeypatch)
    with status_and_bars("optimize") as tell:
        for what in ("searches", "front: limits"):
            tell(what, 1, 4)
        tell("checking")
    text = shown.getvalue()
    assert text.index("searches") < text.index("front: limits") < text.index("optimize: checking ...")
    assert "1 of 4" in text


def test_a_log_says_that_a_step_goes_on_which_tells_nothing_itself(monkeypatch):
    shown = io.StringIO()
    monkeypatch.setattr("roslf_design.commands.terminal.LOGGED", 0.02)
    monkeypatch.setattr(sys, "stderr", shown)
    with status_and_bars("report") as tell:
        tell("calibration plan")
        until = time.monotonic() + 20
        while "so far" not in shown.getvalue() and time.monotonic() < until:
            time.sleep(0.05)
    assert re.search(r"report: calibration plan \.\.\. .* so far\n", shown.getvalue())


@pytest.mark.parametrize(
    ("compiling", "says"),
    [(False, r"depth: 25%, .* so far\n"), (True, r"depth \.\.\. compiling, once on this machine; .* so far\n")],
)
def test_a_log_says_what_is_left_of_a_step_that_is_silent_for_long(monkeypatch, compiling, says):
    shown = io.StringIO()
    monkeypatch.setattr("roslf_design.commands.terminal.LOGGED", 0.02)
    monkeypatch.setattr("roslf_design.commands.terminal.is_compiling", lambda: compiling)
    monkeypatch.setattr(sys, "stderr", shown)
    with bar("depth") as tell:
        tell(0.0)
        tell(0.25)
        before, until = len(shown.getvalue()), time.monotonic() + 20
        while len(shown.getvalue()) == before and time.monotonic() < until:
            time.sleep(0.05)
    assert re.fullmatch(says, shown.getvalue()[before:])


def test_time_left_shrinks_while_a_step_is_silent_and_never_grows(monkeypatch):
    """It grew: by what the wait itself lets expect of what was done before it."""
    clock = [0.0]
    monkeypatch.setattr("roslf_design.commands.terminal.time.monotonic", lambda: clock[0])
    log = _Log()
    for clock[0], done in ((0.0, 0.0), (60.0, 0.25)):
        log.tell("depth", done, 1.0)
    assert [log._how_far(now) for now in (60.0, 120.0, 239.0)] == [
        f": 25%, about {about_time(left)} left" for left in (180.0, 120.0, 1.0)
    ]
    assert log._how_far(300.0) == f": 25%, {about_time(300.0)} so far"


def test_a_bar_that_nothing_is_told_yet_says_that_loops_are_compiled(monkeypatch):
    shown = terminal(monkeypatch)
    monkeypatch.setattr("roslf_design.commands.terminal.PATIENCE", 0.01)
    monkeypatch.setattr("roslf_design.commands.terminal.is_compiling", lambda: True)
    with bar("depth"):
        until = time.monotonic() + 20
        while "compiling" not in shown.getvalue() and time.monotonic() < until:
            time.sleep(0.05)
    assert "compiling, once on this machine" in shown.getvalue()


def test_a_long_command_says_in_a_log_how_far_it_is(tmp_path, monkeypatch, capsys):
    """Of an optimum and a report `tests/optimization/test_study.py` and `tests/explorer/test_session.py` look."""
    monkeypatch.setattr("roslf_design.commands.terminal.LOGGED", 0.0)
    few_builds(monkeypatch)
    few_waves(monkeypatch)
    (tmp_path / "study.toml").write_text(STUDY)
    assert main(["tolerance", str(tmp_path / "study.toml"), "-o", str(tmp_path / "out"), "--trials", "600"]) == 0
    lines = capsys.readouterr().err.splitlines()
    assert any(re.fullmatch(r"tolerance: .*: \d+%, about [\d.e+-]+ s left", line) for line in lines)
    # Trials are a part of it, and of few the least.
    assert any(line.startswith("tolerance: analyses: ") and line.endswith(" left") for line in lines)
