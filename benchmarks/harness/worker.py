"""Child process of a comparison: does one work of one side, on request. Runs in any Python from 3.9, stdlib only.

A side is a file that offers ``WORK``, a mapping from a name to a function of ``(inputs, options)``, which returns
``run`` (a callable that does the work once and returns nothing that counts) and ``result`` (a callable that
returns a mapping of names to arrays, or None). Requests and answers are one line of JSON each:

    {"do": "prepare", "side": FILE, "work": NAME, "inputs": NPZ or null, "options": {...}}   -> {"seconds": ...}
    {"do": "result", "to": NPZ}                                                              -> {"names": [...]}
    {"do": "run", "times": N}                              -> {"seconds": per run, "cpu": per run, "peak_mib": ...}
    {"do": "profile", "most": N}                           -> {"seconds": ..., "rows": [{"function", "share", "calls"}]}

What a side prints goes to stderr; so does its traceback, and the process ends.
"""

# mypy: ignore-errors

import importlib.util
import json
import os
import sys
import time


def load(file):
    """The side's module, from its file."""
    spec = importlib.util.spec_from_file_location("side", file)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def peak_mib():
    """Most memory that this process, or one it started, has held [MiB]; 0 where the system does not tell.

    Linux counts into a process's own ru_maxrss what its parent held when it was started; VmHWM is its own alone.
    """
    try:
        import resource
    except ImportError:
        return 0.0
    started = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    try:
        with open("/proc/self/status") as status:
            own = next(int(line.split()[1]) for line in status if line.startswith("VmHWM"))
    except (OSError, StopIteration):
        own = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return max(own, started) / 1024


def prepare(request):
    """Load the side, read the inputs, and make the work ready."""
    start = time.perf_counter()
    module = load(request["side"])
    inputs = {}
    if request.get("inputs"):
        import numpy

        with numpy.load(request["inputs"]) as stored:
            inputs = {name: stored[name] for name in stored.files}
    run, result = module.WORK[request["work"]](inputs, request.get("options") or {})
    return run, result, {"seconds": time.perf_counter() - start, "peak_mib": peak_mib()}


def timed(run, times):
    """Seconds and seconds of processor time of one run, as the mean of `times` in a row."""
    start, cpu = time.perf_counter(), time.process_time()
    for _ in range(times):
        run()
    return {
        "seconds": (time.perf_counter() - start) / times,
        "cpu": (time.process_time() - cpu) / times,
        "peak_mib": peak_mib(),
    }


def profiled(run, most):
    """Where the time of one run goes: functions by their own seconds, callees left out."""
    import cProfile
    import pstats

    watch = cProfile.Profile()
    watch.runcall(run)
    rows = [(own, calls, place) for place, (calls, _, own, _, _) in pstats.Stats(watch).stats.items()]
    total = sum(row[0] for row in rows) or 1.0
    names = []
    for own, calls, (file, _, name) in sorted(rows, key=lambda row: -row[0])[:most]:
        where = "" if file == "~" else os.path.basename(os.path.dirname(file)) + "/" + os.path.basename(file) + " "
        names.append({"function": where + name, "share": own / total, "calls": calls})
    return {"seconds": total, "rows": names}


def store(result, to):
    """Write a result's arrays."""
    import numpy

    found = {name: numpy.asarray(value) for name, value in (result() or {}).items()}
    numpy.savez(to, **found)
    return {"names": sorted(found)}


def main():
    """Answer until stdin ends."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    run = result = None
    for line in sys.stdin:
        request = json.loads(line)
        if request["do"] == "prepare":
            run, result, answer = prepare(request)
        elif request["do"] == "run":
            answer = timed(run, request["times"])
        elif request["do"] == "profile":
            answer = profiled(run, request["most"])
        elif request["do"] == "result":
            answer = store(result, request["to"])
        else:
            raise ValueError("no such request: " + str(request["do"]))
        answers.write(json.dumps(answer) + "\n")
        answers.flush()


if __name__ == "__main__":
    main()
