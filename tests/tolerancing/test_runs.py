"""Runs: the same bytes from any executor, with workers killed, runs killed and resumed, disks full."""

import contextlib
import errno
import hashlib
import importlib
import json
import multiprocessing
import os
import re
import resource
import shutil
import signal
import socket
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from roslf_design.cli import main
from roslf_design.errors import InputError
from roslf_design.tolerancing import run as runs
from roslf_design.tolerancing.run import (
    ChunkLostError,
    WorkerSettings,
    local_cluster,
    run_chunks,
    run_trials,
    tally_chunk,
)
from roslf_design.tolerancing.study import load_plan, plan_from
from roslf_design.tolerancing.tally import merged, pack, unpack
from tests.tolerancing.work import die, fail

STUDY = """
name = "small"
design = "paper"
trials = {trials}
seed = 3
sobol_samples = 0
keep_trials = 100
[[perturb]]
place = ["f", "d_2", "D_F", "microlens_array.tilt"]
tolerance = "0.5 %"
"""


@pytest.fixture(scope="module")
def plan():
    goals = [{"metric": "fill_factor", "min": 0.99, "max": 1.02}, {"metric": "depth_error_mm", "max": 5.0}]
    whole = plan_from({"name": "s", "design": "paper", "grade": "precision", "goals": goals, "keep_trials": 500})
    return replace(whole, chunk=4096, trials=4096 * 9 + 77)


@pytest.fixture(scope="module")
def whole(plan, tmp_path_factory):
    """The folder of a run that nothing disturbed."""
    folder = tmp_path_factory.mktemp("reference")
    run_trials(plan, folder)
    return folder


@pytest.fixture(scope="module")
def expected(whole):
    return fingerprint(whole)


def fingerprint(folder):
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def kill_once(choose):
    """A progress callback that kills a worker with SIGKILL after the first chunk."""
    killed = []

    def progress(done, _total):
        if done and not killed:
            killed.append(choose())
            os.kill(killed[0], signal.SIGKILL)

    return progress, killed


def test_a_run_is_a_manifest_and_one_file_a_chunk(plan, expected):
    assert sorted(expected) == [*(f"chunks/{index:06d}.npz" for index in range(10)), "manifest.json"]


def test_a_pool_gives_the_same_bytes_though_a_worker_is_killed(plan, expected, tmp_path):
    progress, killed = kill_once(lambda: multiprocessing.active_children()[0].pid)
    run_trials(plan, tmp_path, WorkerSettings(2), progress=progress)
    assert killed
    assert fingerprint(tmp_path) == expected


HALF = """
import os, struct, sys

def work(index):
    mark = sys.argv[1]
    if index == 1 and not os.path.exists(mark):
        open(mark, "w").close()
        frame = sys._getframe()
        while "result_queue" not in frame.f_locals:
            frame = frame.f_back
        answers = frame.f_locals["result_queue"]
        answers._wlock.acquire()
        os.write(answers._writer.fileno(), struct.pack("!i", 100_000) + bytes(1000))
        os.kill(os.getpid(), 9)
    return b"%d" % index

if __name__ == "__main__":
    from roslf_design.tolerancing import run  # which workers need not

    print(sorted(content for _, content in run.run_chunks(work, range(6), run.WorkerSettings(2))))
"""


def test_a_worker_that_dies_in_the_midst_of_its_answer_is_made_good(tmp_path):
    (tmp_path / "half.py").write_text(HALF)
    command = [sys.executable, tmp_path / "half.py", tmp_path / "mark"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (tmp_path / "mark").exists()
    assert done.stdout.strip() == str([b"%d" % index for index in range(6)]), done.stderr


def test_a_dask_cluster_gives_the_same_bytes_though_a_worker_is_killed(plan, expected, tmp_path):
    distributed = pytest.importorskip("distributed", reason="Dask is not installed")
    with local_cluster(2) as cluster, distributed.Client(cluster, set_as_default=False) as client:
        progress, killed = kill_once(lambda: next(iter(client.run(os.getpid).values())))
        run_trials(plan, tmp_path, WorkerSettings(2, cluster.scheduler_address), progress=progress)
        assert killed
    assert fingerprint(tmp_path) == expected


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "nonsense", "ucx://x:1", "http://127.0.0.1:9", ""])
def test_no_scheduler_there_is_one_clear_error_soon(plan, tmp_path, address):
    pytest.importorskip("distributed", reason="Dask is not installed")
    began = time.monotonic()
    with pytest.raises(InputError, match=f"no Dask scheduler answers at {re.escape(address)}"):
        run_trials(plan, tmp_path, WorkerSettings(1, address))
    assert time.monotonic() - began < 5


def test_a_server_that_is_no_scheduler_is_told_in_one_line(tmp_path):
    pytest.importorskip("distributed", reason="Dask is not installed")
    with socket.create_server(("127.0.0.1", 0)) as server:  # it takes calls, and says nothing
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        process = roslf(write_study(tmp_path), "-o", tmp_path / "out", "--scheduler", address)
        out, errors = process.communicate(timeout=60)
    assert (process.returncode, out) == (2, "")
    assert len(errors.splitlines()) == 1
    assert f"no Dask scheduler answers at {address}" in errors


def test_dask_missing_says_what_to_install(plan, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"pip install 'roslf_design\[cluster\]'"):
        run_trials(plan, tmp_path, WorkerSettings(1, "local"))


def test_a_chunk_that_kills_every_worker_is_given_up_with_advice(monkeypatch):
    monkeypatch.setattr(runs, "ATTEMPTS", 2)
    with pytest.raises(ChunkLostError, match="a worker process died 2 times"):
        list(run_chunks(die, [0, 1], WorkerSettings(2)))


def test_an_error_in_the_work_is_not_taken_for_a_dead_worker():
    with pytest.raises(ZeroDivisionError):
        list(run_chunks(fail, [0, 1], WorkerSettings(2)))


def test_a_full_disk_leaves_earlier_chunks_and_resuming_ends_in_the_same_bytes(plan, expected, tmp_path, monkeypatch):
    write, written = runs.write_atomically, []

    def full_after_four(path, content):
        if len(written) == 4:
            raise OSError(errno.ENOSPC, "No space left on device", str(path))
        written.append(path)
        write(path, content)

    monkeypatch.setattr(runs, "write_atomically", full_after_four)
    with pytest.raises(OSError, match="No space left"):
        run_trials(plan, tmp_path)
    monkeypatch.undo()
    partial = fingerprint(tmp_path)
    assert len(partial) == 4
    assert partial.items() <= expected.items()
    with pytest.raises(InputError, match="pass `resume`"):
        run_trials(plan, tmp_path)
    run_trials(plan, tmp_path, resume=True)
    assert fingerprint(tmp_path) == expected


def test_a_damaged_chunk_is_run_again(plan, whole, expected, tmp_path):
    shutil.copytree(whole, tmp_path, dirs_exist_ok=True)
    chunk = tmp_path / "chunks" / "000003.npz"
    chunk.write_bytes(chunk.read_bytes()[:1000])
    run_trials(plan, tmp_path, resume=True)
    assert fingerprint(tmp_path) == expected


def test_a_folder_of_another_run_is_not_touched(plan, tmp_path):
    run_trials(replace(plan, trials=100), tmp_path)
    before = fingerprint(tmp_path)
    with pytest.raises(InputError, match="another study, seed or trial count"):
        run_trials(replace(plan, draws=replace(plan.draws, seed=4)), tmp_path, resume=True)
    assert fingerprint(tmp_path) == before
    (tmp_path / "manifest.json").write_text("{")
    with pytest.raises(InputError, match="is damaged"):
        run_trials(plan, tmp_path, resume=True)


def test_results_travel_through_bytes_unchanged(plan):
    small = replace(plan, trials=3000)
    tally = tally_chunk(small, 0)
    content = pack(tally, "x", 0)
    again = unpack(content, "x", 0)
    for name in tally.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(again, name), getattr(tally, name))
    assert pack(again, "x", 0) == content
    changed = bytearray(content)
    changed[len(content) // 2] ^= 1
    for damaged in (content[:-30], b"", b"PK not a zip", bytes(changed), content + b"x"):
        with pytest.raises(ValueError, match="is damaged"):
            unpack(damaged, "x", 0)
    for digest, index in (("y", 0), ("x", 1)):
        with pytest.raises(ValueError, match="another study"):
            unpack(content, digest, index)


def test_numbers_changed_on_disk_are_computed_again(plan, tmp_path):
    two = replace(plan, trials=plan.chunk + 100)
    run_trials(two, tmp_path)
    expected = fingerprint(tmp_path)
    first, second = sorted((tmp_path / "chunks").glob("*.npz"))
    with np.load(second) as archive:
        arrays = dict(archive)
    arrays["passed"] = arrays["passed"] + 1  # a whole .npz, of this run, with another yield
    np.savez_compressed(second, **arrays)
    tally = run_trials(two, tmp_path, resume=True)
    assert fingerprint(tmp_path) == expected
    assert tally.trials == two.trials
    second.write_bytes(first.read_bytes())  # another chunk's
    run_trials(two, tmp_path, resume=True)
    assert fingerprint(tmp_path) == expected


def manifest_is_a_folder(out):
    (out / "manifest.json").mkdir(parents=True)
    return "manifest.json: is a folder"


def manifest_is_a_list(out):
    out.mkdir()
    (out / "manifest.json").write_text("[1]")
    return "manifest.json is damaged; delete it or choose another place"


def manifest_is_deep(out):
    out.mkdir()
    (out / "manifest.json").write_text("[" * 100_000)
    return "manifest.json: is damaged"


def chunks_are_a_file(out):
    out.mkdir()
    (out / "chunks").write_text("")
    return "chunks is a file, not a folder; delete it or choose another place"


def a_chunk_is_a_folder(out):
    (out / "chunks" / "000000.npz").mkdir(parents=True)
    return "000000.npz is a folder, not a chunk of results; delete it or choose another place"


def out_is_a_file(out):
    out.write_text("")
    return "is a file, not a folder"


def out_is_in_a_file(out):
    out.parent.rmdir()
    out.parent.write_text("")
    return "is a file, not a folder"


@pytest.mark.parametrize(
    "spoil",
    [
        manifest_is_a_folder, manifest_is_a_list, manifest_is_deep, chunks_are_a_file, a_chunk_is_a_folder,
        out_is_a_file, out_is_in_a_file,
    ],
)  # fmt: skip
@pytest.mark.parametrize("resume", [[], ["--resume"]])
def test_a_folder_that_cannot_hold_a_run_is_told_in_one_line(spoil, resume, tmp_path, root, capsys):
    out = tmp_path / "in" / "out"
    out.parent.mkdir()
    said = spoil(out)
    study = str(root / "studies" / "tolerance-scope" / "study.toml")
    assert main(["tolerance", study, "-o", str(out), "--trials", "100", *resume]) == 2
    err = capsys.readouterr().err
    assert said in err
    assert len(err.splitlines()) == 1


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (
            ["--trials", str(10**12)],
            "--trials: 1000000000000 is out of range; give a whole number from 1 to 10000000000",
        ),
        (["--trials", "0"], "--trials: 0 is out of range"),
        (["--workers", "100000"], "--workers: 100000 is out of range; give a whole number from 1 to 512"),
        (["--accuracy", "1e-6"], "--accuracy: 1e-06 is out of range"),
    ],
)
def test_more_than_can_ever_end_is_refused_in_one_line(options, says, tmp_path, root, capsys):
    study = str(root / "studies" / "tolerance-scope" / "study.toml")
    assert main(["tolerance", study, "-o", str(tmp_path / "out"), *options]) == 2
    err = capsys.readouterr().err
    assert says in err
    assert len(err.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_a_study_may_ask_for_a_thousand_million_trials_and_not_for_ever(tmp_path):
    assert load_plan(write_study(tmp_path, 10**9))[0].trials == 10**9
    with pytest.raises(InputError, match="trials: 1000000000000 would take"):
        load_plan(write_study(tmp_path, 10**12))


def test_memory_does_not_grow_with_the_number_of_chunks(plan):
    import tracemalloc

    one = tally_chunk(replace(plan, keep_trials=0), 0)
    peaks = []
    for count in (4, 40):
        tracemalloc.start()
        whole = merged(one for _ in range(count))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert whole.trials == count * one.trials
        assert whole.counts.sum() == count * one.counts.sum()
    assert peaks[1] < 1.1 * peaks[0]


def write_study(folder, trials=20000):
    text = STUDY.format(trials=trials) + '[[goals]]\nmetric = "fill_factor"\nmin = 0.99\nmax = 1.02\n'
    path = folder / "study.toml"
    path.write_text(text.replace('"microlens_array.tilt"', '"microlens_array.pitch"'))
    return path


def roslf(*arguments, **options):
    return subprocess.Popen(
        [sys.executable, "-m", "roslf_design", "tolerance", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # A shell's background job, as tests may be, ignores Ctrl-C, and so would its children.
        **{"preexec_fn": lambda: signal.signal(signal.SIGINT, signal.SIG_DFL), **options},
    )


def test_a_run_killed_and_resumed_ends_in_the_same_bytes(tmp_path, capsys):
    study = write_study(tmp_path, 150_000)
    whole, cut = tmp_path / "whole", tmp_path / "out"
    assert main(["tolerance", str(study), "-o", str(cut)]) == 0
    assert "Yield" in capsys.readouterr().out
    cut.rename(whole)  # the page names the folder that it was written to
    process = roslf(study, "-o", cut, "--workers", 2)
    deadline = time.monotonic() + 60
    while not len(list(cut.glob("chunks/0*.npz"))) and time.monotonic() < deadline:
        time.sleep(0.005)
    process.send_signal(signal.SIGKILL)
    process.communicate(timeout=120)
    assert not (cut / "results.json").exists()
    assert 1 <= len(list(cut.glob("chunks/0*.npz"))) < 5
    for stray in cut.glob("chunks/.*"):  # what was being written when the power went
        stray.unlink()
    assert main(["tolerance", str(study), "-o", str(cut), "--resume"]) == 0
    assert fingerprint(cut) == fingerprint(whole)


def test_the_command_writes_all_its_files_and_json(tmp_path, capsys):
    study = write_study(tmp_path)
    line = ["tolerance", str(study), "-o", str(tmp_path / "out"), "--json", "--trials", "5000", "--seed", "8"]
    assert main(line) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["schema"] == "roslf.tolerance/1"
    assert (data["trials"], data["seed"]) == (5000, 8)
    built = {term["name"]: term["u_mm"] for term in data["depth_expected"]["terms"]}["lengths as built"]
    assert 0 < built <= data["depth_expected"]["u_z_mm"]
    assert f"U = ± {2 * data['depth_expected']['u_z_mm']:.3g} mm" in (tmp_path / "out" / "summary.txt").read_text()
    assert data["accuracy"].pop("seconds") > 0  # printed only: files repeat themselves
    assert data == json.loads((tmp_path / "out" / "results.json").read_text())
    names = {path.name for path in (tmp_path / "out").iterdir()}
    for name in ("yield", "spread", "sensitivity", "correlation"):
        assert {f"{name}.svg", f"{name}.png"} <= names
    assert "grades.svg" not in names  # the study names no grade
    table = (tmp_path / "out" / "tables" / "distributions-as-built.csv").read_text().splitlines()
    assert table[0].startswith("metric,nominal,mean,")
    assert {line.count(",") for line in table} == {table[0].count(",")}
    assert {worst["file"] for worst in data["worst"]} <= names
    with np.load(tmp_path / "out" / "trials.npz") as trials:
        assert trials["metrics"].shape == (100, 1, 3)
        assert trials["places"].tolist() == [p["place"] for p in data["perturbations"]]


def test_wrong_input_is_exit_code_2_and_one_line_each(tmp_path, capsys):
    study = write_study(tmp_path)
    study.write_text(study.read_text().replace("fill_factor", "fil_factor").replace('"d_2"', '"d_22"'))
    assert main(["tolerance", str(study), "-o", str(tmp_path / "out")]) == 2
    out, errors = capsys.readouterr()
    assert out == ""
    lines = errors.splitlines()
    assert len(lines) == 2
    assert all(line.startswith(f"roslf: {study}: ") for line in lines)
    for bad in (["--trials", "0"], ["--workers", "0"], ["--seed", "-1"]):
        assert main(["tolerance", str(write_study(tmp_path)), "-o", str(tmp_path / "out"), *bad]) == 2
        assert bad[0] in capsys.readouterr().err


@pytest.mark.parametrize(("way", "code"), [("file", 2), ("limit", 1)])
def test_an_unwritable_place_is_one_clear_error(tmp_path, way, code):
    study = write_study(tmp_path)
    if way == "file":
        (tmp_path / "out").write_text("in the way")
        process = roslf(study, "-o", tmp_path / "out")
    else:
        limit = (5000, 5000)  # the kernel refuses larger files: as a full disk does
        process = roslf(
            study, "-o", tmp_path / "out", preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, limit)
        )
    out, errors = process.communicate(timeout=120)
    assert process.returncode == code
    assert out == ""
    assert len(errors.splitlines()) == 1
    assert errors.startswith("roslf: ")
    with contextlib.suppress(OSError):
        assert not list((tmp_path / "out" / "chunks").glob("*"))


def test_ctrl_c_while_workers_start_is_one_line(tmp_path):
    process = roslf(write_study(tmp_path, 400_000), "-o", tmp_path / "out", "--workers", "2", start_new_session=True)
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    while len(children.read_text().split()) < 3 and process.poll() is None:  # a resource tracker and two workers
        time.sleep(0.005)
    time.sleep(0.1)
    os.killpg(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert errors == "roslf: stopped\n"


def test_help_shows_an_example(capsys):
    assert main(["tolerance", "--help"]) == 0
    assert "roslf tolerance studies/tolerance-paper/study.toml" in capsys.readouterr().out


@pytest.mark.parametrize("options", [["--workers", "2"], ["--scheduler", "local"]])
def test_processes_that_cannot_be_started_are_told_before_anything_is_written(options, tmp_path, capsys, monkeypatch):
    """As where /dev/shm is read-only."""

    def refuse(*_):
        raise OSError(30, "Read-only file system")

    importlib.import_module("multiprocessing.synchronize")  # which asks the real one for its largest count
    monkeypatch.setattr("_multiprocessing.SemLock", refuse)
    (tmp_path / "study.toml").write_text(
        'name = "x"\ndesign = "paper"\ngrade = "high"\ntrials = 8\n[[goals]]\nmetric = "fill_factor"\nmax = 2\n'
    )
    assert main(["tolerance", str(tmp_path / "study.toml"), "-o", str(tmp_path / "out"), *options]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"roslf: {options[0]}: no processes can be started here")
    assert not (tmp_path / "out").exists()
