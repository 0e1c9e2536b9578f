"""Runs in processes of their own: told, ended, cancelled, never left behind."""

import asyncio
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from roslf_design.explorer.jobs import Done, Failure, Later, ProcessJob, Progress
from roslf_design.progress import EnoughError
from tests.explorer.work import die, double, refuse, stumble, wait_and_refuse_to_end, wait_for_ever


def until(job, kind, seconds=120.0):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        state = job.poll()
        if isinstance(state, kind):
            return state
        time.sleep(0.02)
    raise AssertionError(f"still {state}")


@pytest.mark.parametrize(
    ("share", "seconds", "told", "left"),
    [
        (0.25, 8.0, 8.0, 24.0),
        (0.25, 10.0, 8.0, 22.0),
        (0.5, 30.0, 8.0, 0.0),
        (0.001, 9.0, 9.0, None),
        (None, 9.0, 0.0, None),
    ],
)
def test_the_time_left_is_that_of_the_share_that_is_not_done(share, seconds, told, left):
    assert Progress(share, "", seconds, told).left == left


def started(work, request):
    """A run, and the process that does it."""
    others = set(multiprocessing.active_children())
    job = ProcessJob(work, request)
    [child] = set(multiprocessing.active_children()) - others
    return job, child.pid


def gone(pid, seconds=60.0):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        try:
            state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
        except (FileNotFoundError, ProcessLookupError):  # the latter where it ends while it is read
            return True
        if state == "Z":
            return True
        time.sleep(0.02)
    return False


def test_a_run_tells_how_far_it_is_and_what_it_found():
    job, child = started(double, 21)
    state = until(job, Done)
    assert state.result == 42
    assert job.poll() == state
    assert gone(child)


def test_polling_returns_at_once_and_cancelling_ends_the_process():
    job, child = started(wait_for_ever, None)
    end = time.monotonic() + 30
    while True:
        began = time.monotonic()
        state = job.poll()
        assert time.monotonic() - began < 1
        assert isinstance(state, Progress)
        if state.text == "waiting" or time.monotonic() > end:
            break
        time.sleep(0.02)
    assert state.share == 0.1
    job.cancel()
    assert job.poll() == Failure("cancelled")
    assert gone(child)
    job.cancel()


def stop_when_told(request, tell):
    try:
        while True:
            tell(0.5, "searching")
            time.sleep(0.02)
    except EnoughError:
        return "the best so far"


def search_for_ever(request, tell):
    while True:
        tell(0.5, "searching")
        time.sleep(0.02)


@pytest.mark.parametrize(
    ("work", "ends"), [(stop_when_told, "the best so far"), (search_for_ever, "stopped before anything was found")]
)
def test_a_run_that_is_stopped_ends_with_what_it_has(work, ends):
    job = ProcessJob(work, None)
    while not (isinstance(state := job.poll(), Progress) and state.share):
        time.sleep(0.02)
    job.stop()
    state = until(job, Done | Failure)
    assert (state.result if isinstance(state, Done) else state.message) == ends
    job.stop()  # of one that is over nothing comes


def test_a_run_that_will_not_end_is_killed():
    job, child = started(wait_and_refuse_to_end, None)
    end = time.monotonic() + 30
    while getattr(job.poll(), "text", "") != "stubborn" and time.monotonic() < end:
        time.sleep(0.02)
    job.cancel()
    assert gone(child)


@pytest.mark.parametrize(
    ("work", "told"),
    [(refuse, "grade: is not known"), (stumble, "ZeroDivisionError: division by zero"), (die, "exit code 7")],
)
def test_a_run_that_fails_says_why(work, told):
    job, child = started(work, None)
    state = until(job, Failure)
    assert told in state.message
    assert gone(child)


PARENT = """
import multiprocessing, sys, time
sys.path.insert(0, {root!r})
from roslf_design.explorer.jobs import ProcessJob
from tests.explorer.work import wait_for_ever
if __name__ == "__main__":
    job = ProcessJob(wait_for_ever, None)
    while getattr(job.poll(), "text", "") != "waiting":
        time.sleep(0.02)
    print(multiprocessing.active_children()[0].pid, flush=True)
    time.sleep(600)
"""


def test_no_run_outlives_a_killed_program(tmp_path):
    script = tmp_path / "parent.py"
    script.write_text(PARENT.format(root=os.getcwd()))
    with subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE, text=True) as parent:
        child = int(parent.stdout.readline())
        os.kill(child, 0)
        parent.send_signal(signal.SIGKILL)
        assert gone(child)


def test_work_that_fails_is_told_and_done_again_when_asked_again():
    done, told = [], []

    async def play():
        asyncio.get_running_loop().set_exception_handler(lambda _, context: told.append(context["exception"]))
        later = Later(lambda: done.append("done"))
        for work in (lambda: 1 / 0, lambda: 1 / 0, lambda: done.append("work")):
            later.do("one", work, "subject", 0.01)
            await asyncio.sleep(0.2)

    asyncio.run(play())
    assert [type(error) for error in told] == [ZeroDivisionError] * 2
    assert done == ["work", "done"]


def test_nothing_of_these_runs_is_left():
    assert not [child for child in multiprocessing.active_children() if child.is_alive()]
