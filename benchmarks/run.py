"""Everything in one run: peers, comparisons, scaling, topics; JSON-ready."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from .cases import peer_cases
from .harness.comparison import SIDES, Case, CaseResult, Tell, compare
from .harness.machine import bandwidth, describe
from .harness.peers import PEERS, REPOSITORY, Installed, cache_folder, install
from .harness.process import SideError, Worker, store_arrays
from .harness.scaling import axes, measure
from .harness.store import SCHEMA, case_dict, goal_dicts
from .harness.words import case_lines
from .own_cases import own_cases

ROUNDS = {True: 2.0, False: 8.0}
"""Seconds of rounds for each comparison, quick or not."""
THREADS = 2
TOPIC_SECONDS = 300.0
"""Longest time for one topic; what it printed until then is kept."""


def run_all(
    quick: bool = False,
    only: Sequence[str] = (),
    topics: Sequence[str] = (),
    tell: Tell = print,
    peers: Callable[[], Sequence[Installed]] | None = None,
    cases: Sequence[Case] | None = None,
) -> dict[str, Any]:
    """Run everything.

    Parameters
    ----------
    quick : bool
        Small sizes, few rounds, no topics, fast cases alone.
    only : sequence of str
        Names of cases (or their beginnings); nothing else is run then.
    topics : sequence of str
        Names of benchmark topics to run at the end, each as a process of its own.
    tell : callable
        Told lines of text as they come.
    peers : callable, optional
        Gives the peers; by default they are installed.
    cases : sequence of Case, optional
        Instead of all.
    """
    began = time.perf_counter()
    wanted = chosen(quick, only, cases)
    machine = describe(REPOSITORY)
    installed = install_peers(quick, tell) if peers is None else list(peers())
    speed = {str(threads): bandwidth(threads) for threads in (1, THREADS)}
    pythons = {one.peer.key: one.python for one in installed}
    reasons = {one.peer.key: one.reason for one in installed}
    results: list[CaseResult] = []
    goals: list[dict[str, Any]] = []
    for case in wanted:
        found = compare(case, pythons, reasons, ROUNDS[quick])
        results.append(found)
        tell("\n".join(case_lines(case_dict(found))))
        goals += [goal | _profile(found, goal) for goal in goal_dicts(found)]
    scaled = [] if only or cases is not None else [measure(axis, tell) for axis in axes(quick)]
    return {
        "schema": SCHEMA,
        "quick": quick,
        "machine": machine,
        "bandwidth": speed,
        "peers": [one.to_dict() for one in installed],
        "cases": [case_dict(found) for found in results],
        "goals": goals,
        "scaling": scaled,
        "topics": {name: topic(name, tell) for name in topics},
        "seconds": round(time.perf_counter() - began, 1),
    }


def chosen(quick: bool, only: Sequence[str], cases: Sequence[Case] | None) -> list[Case]:
    """Cases to run.

    Raises
    ------
    ValueError
        A name that no case begins with.
    """
    everything = list(cases) if cases is not None else [*peer_cases(quick), *own_cases(quick)]
    if not only:
        return [case for case in everything if case.fast or not quick]
    unknown = [name for name in only if not any(case.name.startswith(name) for case in everything)]
    if unknown:
        known = ", ".join(case.name for case in everything)
        raise ValueError(f"no comparison is called {', '.join(unknown)}; there are {known}")
    return [case for case in everything if any(case.name.startswith(name) for name in only)]


def install_peers(quick: bool, tell: Tell = print) -> list[Installed]:
    """All peers, made where they are not there yet; a quick run does not weigh the project itself."""
    found = []
    for peer in PEERS:
        if quick and peer.key == "here":
            continue
        one = install(peer)
        told = f"{one.mib:.0f} MiB" if one.python else f"left out: {one.reason}"
        tell(f"{peer.title}: {told}")
        found.append(one)
    return found


def _profile(found: CaseResult, goal: Mapping[str, Any]) -> dict[str, Any]:
    """Where our time goes, for a goal that was not met."""
    side = found.case.sides[0]
    if goal["met"] is not False or side.command or found.case.inputs is None:
        return {}
    with tempfile.TemporaryDirectory() as folder:
        stored = Path(folder) / "inputs.npz"
        store_arrays(stored, found.case.inputs())
        worker = Worker(Path(sys.executable), side.threads, side.python_path)
        try:
            worker.prepare(SIDES / (side.file or f"{side.program}_side.py"), side.work, stored, side.options)
            worker.run()
            return {"profile": worker.profile()["rows"]}
        except SideError as error:
            return {"profile_failed": str(error)}
        finally:
            worker.close()


def topic(name: str, tell: Tell = print) -> dict[str, Any]:
    """What a topic prints, and how long it took; a topic that fails is told so."""
    tell(f"topic {name}")
    start = time.perf_counter()
    words = [sys.executable, "-u", "-m", "benchmarks", name]
    peer = cache_folder() / "optiland" / "bin" / "python"
    surroundings = {**os.environ, **({"OPTILAND_PYTHON": str(peer)} if peer.exists() else {})}
    with tempfile.TemporaryFile("w+") as printed:
        wrong = ""
        try:
            done = subprocess.run(
                words,
                stdout=printed,
                stderr=subprocess.PIPE,
                text=True,
                check=False,
                cwd=REPOSITORY,
                env=surroundings,
                timeout=TOPIC_SECONDS,
            )
            if done.returncode:
                wrong = f"failed: {(done.stderr.strip().splitlines() or ['without a word'])[-1]}"
        except subprocess.TimeoutExpired:
            wrong = f"stopped after {TOPIC_SECONDS:.0f} s"
        printed.seek(0)
        text = printed.read() + wrong
    for path, word in ((REPOSITORY, "."), (Path.home(), "~")):
        text = text.replace(str(path), word)
    return {"seconds": round(time.perf_counter() - start, 1), "failed": bool(wrong), "text": text}
