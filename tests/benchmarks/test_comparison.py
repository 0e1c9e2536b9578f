"""Sides as real processes with invented work: who agrees is timed, who differs, fails or is missing is told."""

import json
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.harness.comparison import Case, Check, Goal, Side, compare, turn
from benchmarks.harness.store import case_dict, check, goal_dicts
from benchmarks.harness.words import case_lines

WORKS = """
import os, numpy as np
print("said while it is loaded")

def total(inputs, options):
    state = {}
    def run():
        print("said while it runs")
        state["sum"] = inputs["values"].sum() * options.get("factor", 1)
    return run, lambda: {"sum": state["sum"]}

def lazy(inputs, options):
    return (lambda: None), (lambda: {})

def broken(inputs, options):
    raise RuntimeError("no such lens")

def late(inputs, options):
    runs = []
    def run():
        runs.append(1)
        if len(runs) > 3:
            os._exit(7)
    return run, lambda: {"sum": inputs["values"].sum()}

def pools(inputs, options):
    names = ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS")
    return (lambda: None), (lambda: {"sum": [int(os.environ[name]) for name in names]})

WORK = {"total": total, "lazy": lazy, "broken": broken, "late": late, "pools": pools}
"""


def same_sum(ours, theirs):
    return (Check("sum", float(abs(ours["sum"] - theirs["sum"])), 1e-9),)


@pytest.fixture
def side(tmp_path):
    file = tmp_path / "invented_side.py"
    file.write_text(WORKS)
    return lambda label, work="total", **more: Side(label, more.pop("program", "here"), work, file=str(file), **more)


def case(*sides, judge=same_sum, **more):
    return Case("sums", "Sums", "values", 3, sides, lambda: {"values": [1.0, 2.0, 3.0]}, judge, **more)


def run(one, pythons=None, reasons=None):
    found = compare(one, pythons or {}, reasons or {}, 0.0)
    stored = json.loads(json.dumps(case_dict(found), allow_nan=False))
    return found, {told["label"]: told for told in stored["sides"]}


def test_sides_that_agree_get_a_ratio(side):
    found, stored = run(case(side("here"), side("other", threads=2), goals=(Goal("other", 1e-9, "at all"),)))
    ratio = stored["other"]["ratio"]
    assert 0 < ratio["low"] <= ratio["value"] <= ratio["high"]
    assert ratio["pairs"] == len(stored["here"]["samples"]) == len(stored["other"]["samples"]) >= 5
    assert stored["here"]["ratio"] is None
    assert stored["other"]["checks"] == [{"name": "sum", "difference": 0.0, "allowed": 1e-9, "ok": True}]
    assert goal_dicts(found)[0]["met"] is True


def test_a_mismatch_gives_no_ratio_and_is_told(side):
    found, stored = run(case(side("here"), side("off", options={"factor": 1.5}), goals=(Goal("off", 1.0, "as fast"),)))
    assert stored["off"]["state"] == "mismatch"
    assert stored["off"]["ratio"] is None
    assert stored["off"]["samples"] == []
    assert "sum off by 3" in stored["off"]["reason"]
    assert stored["here"]["samples"]
    assert any("mismatch: sum off by 3" in line and "no ratio" in line for line in case_lines(case_dict(found)))
    goal = goal_dicts(found)[0]
    assert goal["met"] is None
    assert goal["reason"].startswith("mismatch")


def test_a_result_without_what_is_compared_is_a_mismatch(side):
    _, stored = run(case(side("here"), side("lazy", "lazy")))
    assert stored["lazy"]["state"] == "mismatch"
    assert stored["lazy"]["ratio"] is None


def test_nan_never_agrees(side):
    def judge(ours, theirs):
        return (Check("difference", float("nan"), 1.0),)

    _, stored = run(case(side("here"), side("other"), judge=judge))
    assert {one["state"] for one in stored.values()} == {"mismatch"}
    assert stored["other"]["checks"][0]["difference"] is None


def test_a_missing_peer_is_reported_and_the_rest_goes_on(side):
    absent = side("absent", program="absent")
    _, stored = run(case(side("here"), absent, side("other")), {"absent": None}, {"absent": "no wheel for it"})
    assert (stored["absent"]["state"], stored["absent"]["reason"]) == ("missing", "no wheel for it")
    assert stored["other"]["ratio"] is not None


def test_a_failing_side_is_reported_with_its_last_words(side):
    _, stored = run(case(side("here"), side("broken", "broken"), side("other")))
    assert stored["broken"]["state"] == "failed"
    assert stored["broken"]["reason"] == "RuntimeError: no such lens"
    assert stored["other"]["ratio"] is not None


def test_a_side_that_dies_while_timed_has_no_ratio(side):
    _, stored = run(case(side("here"), side("late", "late"), side("other")))
    assert stored["late"]["state"] == "failed"
    assert stored["late"]["reason"].startswith("while timed")
    assert stored["late"]["ratio"] is None
    assert stored["other"]["ratio"] is not None


def test_without_our_side_nothing_is_compared(side):
    _, stored = run(case(side("here", "broken"), side("other")))
    assert all(one["ratio"] is None for one in stored.values())


def test_a_ratio_is_for_the_same_amount_of_work(side):
    _, stored = run(case(side("here"), side("tenth", count=0.3)))  # the same run, said to be a tenth of the work
    ours, theirs = (np.array(stored[name]["samples"]) for name in ("here", "tenth"))
    pairs = (theirs / 0.3) / (ours / 3)
    assert stored["tenth"]["ratio"]["value"] == pytest.approx(np.median(pairs), rel=1e-4)  # stored to six digits


def test_thread_pools_are_told_their_size(side):
    def judge(ours, theirs):
        return (Check("threads", float(np.abs(theirs["sum"] - 3).max()), 0.0),)

    _, stored = run(case(side("here", "pools", threads=3), judge=judge))
    assert stored["here"]["state"] == "timed"


def test_whole_processes_answer_by_their_last_line():
    words = ("{python}", "-c", "import json; print('hello'); print(json.dumps({'sum': 6.0}))")
    sides = (Side("here", "here", command=words), Side("other", "here", command=words))
    dead = Side("dead", "here", command=("{python}", "-c", "raise SystemExit('not today')"))
    _, stored = run(Case("start", "Start", "runs", 1, (*sides, dead), judge=same_sum))
    assert stored["other"]["ratio"] is not None
    assert (stored["dead"]["state"], stored["dead"]["reason"]) == ("failed", "not today")


def test_turns_are_fair():
    labels = ["a", "b", "c"]
    orders = [turn(labels, index) for index in range(12)]
    for place in range(3):
        seen = [order[place] for order in orders]
        assert {label: seen.count(label) for label in labels} == dict.fromkeys(labels, 4)
    assert turn([], 3) == []


def stored_run(side):
    found, _ = run(case(side("here"), side("other")))
    parts = {"machine": {}, "bandwidth": {}, "topics": {}, "peers": [], "goals": [], "scaling": []}
    return {"schema": "roslf.benchmarks/1", "quick": True, "seconds": 1.0, "cases": [case_dict(found)], **parts}


def test_a_stored_run_is_checked(side):
    data = stored_run(side)
    check(data)
    with pytest.raises(ValueError, match="schema"):
        check(data | {"schema": "roslf.benchmarks/0"})
    with pytest.raises(ValueError, match="scaling"):
        check({name: part for name, part in data.items() if name != "scaling"})
    other = data["cases"][0]["sides"][1]
    other["checks"][0]["ok"] = False
    with pytest.raises(ValueError, match="a ratio without results that agree"):
        check(data)
    other["checks"][0]["ok"], other["state"] = True, "rumoured"
    with pytest.raises(ValueError, match="no such state"):
        check(data)


def test_worse_quality_misses_a_goal_however_fast(side):
    def quality(answer):
        return {"error": float(answer["sum"])}

    one = case(side("here", options={"factor": 2}), side("other"), judge=lambda a, b: (), quality=quality)
    found, _ = run(replace(one, goals=(Goal("other", 1e-9, "at all"),)))
    goal = goal_dicts(found)[0]
    assert goal["worse_in"] == ["error"]
    assert goal["met"] is False


def test_memory_told_is_the_sides_own(side):
    held = np.ones(50_000_000)  # 400 MB of ours are none of theirs
    found, _ = run(case(side("here")))
    assert 5 < found.sides[0].peak_mib < held.nbytes / 2**20
