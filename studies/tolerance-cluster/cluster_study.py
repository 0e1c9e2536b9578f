"""A large tolerance run on a Dask cluster of two workers, with a worker and the run itself killed on the way.

Measures what a plan for a larger cluster needs: processor time a trial, bytes a chunk, the memory of workers and driver
over the run. Then the same run undisturbed: every chunk must be the same bytes. `--once` leaves that out, and computes
some chunks taken at random again in this process instead. A study that was stopped goes on where its folder says.

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
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import distributed
import numpy as np
import tomli_w

from roslf_design.tolerancing.run import local_cluster, run_chunk
from roslf_design.tolerancing.study import TolerancePlan, load_plan

HERE = Path(__file__).parent
STUDY = HERE.parent / "tolerance-paper" / "study.toml"
CHECKED = 5
"""Chunks that are computed again where there is no second run."""
EACH, TOLD = 1.0, 20.0
"""Seconds between two looks at the processes, and between two rows that are kept of them."""
WORKER_DIES, DRIVER_DIES = 0.2, 0.4
"""Shares of the chunks that are left to do after which they are killed."""


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


def chunks(out: Path) -> list[Path]:
    """Files of the chunks that are done."""
    return sorted((out / "chunks").glob("*.npz"))


def run(plan: TolerancePlan, study: Path, out: Path, workers: int, disturbed: bool) -> dict[str, object]:
    """One run; what was measured. Rows of what was measured on the way go to a file beside it."""
    command = [sys.executable, "-m", "roslf_design", "tolerance", str(study), "-o", str(out)]
    command += ["--trials", str(plan.trials), "--resume"]
    started, begun = time.perf_counter(), len(chunks(out))
    killed: list[str] = []
    rows: list[dict[str, float]] = []
    dask: Any = distributed
    with local_cluster(workers) as cluster, dask.Client(cluster, set_as_default=False) as client:
        command += ["--scheduler", cluster.scheduler_address]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        last: dict[int, float] = {}
        with out.with_suffix(".jsonl").open("w") as log:
            while process.poll() is None:
                time.sleep(EACH)
                here = list(client.run(os.getpid, on_error="ignore").values())
                done = len(chunks(out))
                last |= {pid: processor(pid) for pid in here}
                row = {
                    "seconds": round(time.perf_counter() - started, 1),
                    "chunks": done,
                    "worker_MB": round(max(map(resident, here), default=0.0)),
                    "driver_MB": round(resident(process.pid)),
                    "processor_seconds": round(sum(last.values()), 1),
                }
                if not rows or row["seconds"] >= rows[-1]["seconds"] + TOLD:
                    rows.append(row)
                    print(json.dumps(row), file=log, flush=True)
                share = (done - begun) / max(1, plan.chunks - begun)
                if disturbed and share > WORKER_DIES and not killed:
                    killed.append("worker")
                    os.kill(here[0], signal.SIGKILL)
                elif disturbed and share > DRIVER_DIES and killed == ["worker"]:
                    killed.append("driver")
                    process.kill()
                    process.wait()
                    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        spent = sum(last.values())
    sizes = [path.stat().st_size for path in chunks(out)]
    at_work = [row for row in rows if 0 < row["chunks"] < plan.chunks] or rows
    return {
        "killed": killed,
        "exit": process.returncode,
        "chunks": len(sizes),
        "chunks_of_earlier_runs": begun,
        "MB_of_chunks": round(sum(sizes) / 1e6, 1),
        "seconds": rows[-1]["seconds"],
        "processor_seconds_of_workers": round(spent, 1),
        "us_a_trial_and_worker": round(1e6 * spent / max(1, plan.trials - begun * plan.chunk), 2),
        "worker_MB_over_the_run": spread(row["worker_MB"] for row in at_work),
        "driver_MB_over_the_run": spread(row["driver_MB"] for row in at_work),
        "yield": json.loads((out / "results.json").read_text())["yield"]["value"],
    }


def spread(values: Iterator[float]) -> list[float]:
    """Largest in each tenth of a run."""
    return [float(part.max()) for part in np.array_split(np.array(list(values)), 10) if part.size]


def digest(out: Path) -> str:
    """Of all chunks' bytes."""
    return hashlib.sha256(b"".join(hashlib.sha256(path.read_bytes()).digest() for path in chunks(out))).hexdigest()[:16]


def main() -> int:
    """Run and write what was measured."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("output", type=Path)
    parser.add_argument("--trials", type=int, default=10_000_000)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--adjusted", action="store_true", help="with the study's compensators")
    parser.add_argument("--once", action="store_true", help="no second, undisturbed run")
    given = parser.parse_args()
    given.output.mkdir(parents=True, exist_ok=True)
    data = tomllib.loads(STUDY.read_text()) | {"sobol_samples": 0, "keep_worst": 0}
    if not given.adjusted:
        data.pop("compensators", None)
    study = given.output / "study.toml"
    study.write_bytes(tomli_w.dumps(data).encode())
    plan, _, _ = load_plan(study, trials=given.trials)
    out, again = given.output / "run", given.output / "undisturbed"
    measured: dict[str, Any] = {"trials": given.trials, "chunk_trials": plan.chunk}
    measured["run"] = run(plan, study, out, given.workers, disturbed=True)
    same = False
    if given.once:
        paths = chunks(out)
        sample = np.random.default_rng(0).choice(len(paths), min(CHECKED, len(paths)), replace=False)
        equal = [paths[k].read_bytes() == run_chunk(plan, int(k)) for k in sample]
        measured["chunks_computed_again_the_same"], same = f"{sum(equal)} of {len(equal)}", all(equal)
    else:
        measured["undisturbed"] = run(plan, study, again, given.workers, disturbed=False)
        digests = [digest(out), digest(again)]
        measured["digests_of_all_chunks"], same = digests, len(set(digests)) == 1
    text = json.dumps(measured, indent=1) + "\n"
    (given.output / "measured.json").write_text(text)
    print(text, end="")
    return 0 if same and measured["run"]["exit"] == 0 else 1


if __name__ == "__main__":
    raise SystemExit(main())
