"""A large tolerance run on a Dask cluster of two workers, with a worker and the run itself killed on the way.

Measures what a plan for a larger cluster needs: processor time a trial, bytes a chunk, the memory of workers and driver
over the run. Chunks taken at random are computed again in this process and compared byte by byte.

    python studies/tolerance-cluster/cluster_study.py out/cluster --trials 10000000
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path
from typing import Any

import distributed
import numpy as np
import tomli_w

from roslf_design.tolerancing.run import run_chunk
from roslf_design.tolerancing.study import load_plan

HERE = Path(__file__).parent
STUDY = HERE.parent / "tolerance-paper" / "study.toml"
CHECKED = 5
"""Chunks that are computed again."""


def resident(pid: int) -> float:
    """Memory of a process [MB]; 0 where it has ended."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    except (OSError, IndexError):
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def processor(pid: int) -> float:
    """Processor time of a process [s]."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def run(folder: Path, study: Path, trials: int, workers: int) -> dict[str, object]:
    """The run, killed and resumed; what was measured."""
    out = folder / "run"
    command = [sys.executable, "-m", "roslf_design", "tolerance", str(study), "-o", str(out), "--trials", str(trials)]
    plan, _, _ = load_plan(study, trials=trials)
    memory: dict[str, list[float]] = {"worker": [], "driver": []}
    started, spent = time.perf_counter(), 0.0
    dask: Any = distributed
    local = dask.LocalCluster(
        n_workers=workers, threads_per_worker=1, processes=True, host="127.0.0.1", dashboard_address=None
    )
    with local as cluster, dask.Client(cluster, set_as_default=False) as client:
        command += ["--scheduler", cluster.scheduler_address]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        killed: list[str] = []
        last: dict[int, float] = {}
        while process.poll() is None:
            time.sleep(0.5)
            here = client.run(os.getpid).values()
            done = len(list((out / "chunks").glob("*.npz"))) / plan.chunks
            memory["worker"].append(max(map(resident, here), default=0.0))
            memory["driver"].append(resident(process.pid))
            last |= {pid: processor(pid) for pid in here}
            if done > 0.2 and not killed:
                killed.append("worker")
                os.kill(next(iter(here)), signal.SIGKILL)
            elif done > 0.4 and killed == ["worker"]:
                killed.append("driver")
                process.kill()
                process.wait()
                process = subprocess.Popen([*command, "--resume"], stdout=subprocess.DEVNULL)
        spent = sum(last.values())
    paths = sorted((out / "chunks").glob("*.npz"))
    sample = np.random.default_rng(0).choice(len(paths), min(CHECKED, len(paths)), replace=False)
    same = [paths[k].read_bytes() == run_chunk(plan, int(k)) for k in sample]
    results = json.loads((out / "results.json").read_text())
    half = len(memory["worker"]) // 2
    return {
        "trials": trials,
        "chunks": len(paths),
        "chunk_trials": plan.chunk,
        "chunk_kB": round(sum(path.stat().st_size for path in paths) / len(paths) / 1e3, 1),
        "killed": killed,
        "exit": process.returncode,
        "seconds": round(time.perf_counter() - started, 1),
        "processor_seconds_of_workers": round(spent, 1),
        "us_a_trial_and_worker": round(1e6 * spent / trials, 2),
        "worker_MB": {"first_half": max(memory["worker"][:half]), "second_half": max(memory["worker"][half:])},
        "driver_MB": {"first_half": max(memory["driver"][:half]), "second_half": max(memory["driver"][half:])},
        "chunks_computed_again_the_same": f"{sum(same)} of {len(same)}",
        "yield": results["yield"]["value"],
        "bytes": hashlib.sha256(b"".join(path.read_bytes() for path in paths)).hexdigest()[:16],
    }


def main() -> int:
    """Run and write what was measured."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("output", type=Path)
    parser.add_argument("--trials", type=int, default=10_000_000)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--adjusted", action="store_true", help="with the study's compensators")
    given = parser.parse_args()
    given.output.mkdir(parents=True, exist_ok=True)
    data = tomllib.loads(STUDY.read_text()) | {"sobol_samples": 0, "keep_worst": 0}
    if not given.adjusted:
        data.pop("compensators", None)
    study = given.output / "study.toml"
    study.write_bytes(tomli_w.dumps(data).encode())
    measured = run(given.output, study, given.trials, given.workers)
    text = json.dumps(measured, indent=1) + "\n"
    (given.output / "measured.json").write_text(text)
    print(text, end="")
    return 0 if measured["exit"] == 0 else 1


if __name__ == "__main__":
    raise SystemExit(main())
