"""From invented work to page and table, without peers; scaling, names of cases, two revisions."""

import json
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

from benchmarks import __main__ as command
from benchmarks import bench_explorer, compare_revisions, run
from benchmarks.cases import centre_errors, peer_cases, white_image
from benchmarks.harness import scaling
from benchmarks.harness.comparison import Case, Check, Goal, Side
from benchmarks.harness.peers import PEERS, Installed
from benchmarks.harness.scaling import Axis, measure
from benchmarks.harness.words import digits, duration, rate
from benchmarks.own_cases import own_cases
from benchmarks.readme_table import readme_table

SIDE = """
import json
def add(inputs, options):
    state = {}
    def run():
        state["sum"] = sum(range(int(options.get("size", 1000)))) + options.get("off", 0)
    return run, lambda: {"sum": state["sum"]}
WORK = {"add": add}
"""


def judge(ours, theirs):
    return (Check("sum", float(abs(ours["sum"] - theirs["sum"])), 0.0),)


@pytest.fixture
def cases(tmp_path):
    file = tmp_path / "side.py"
    file.write_text(SIDE)

    def side(label, program="here", **options):
        return Side(label, program, "add", options=options, file=str(file))

    sides = (side("here"), side("plain numpy", "numpy"), side("Wrong", off=1), side("Optiland", "optiland"))
    goals = (Goal("plain numpy", 1e6, "a million times"), Goal("Optiland", 2.0, "twice"))
    slow = Case("slow", "Slow sums", "sums", 1, sides[:1], fast=False)
    return [Case("singlet", "Sums", "numbers", 1000, sides, judge=judge, goals=goals, note="Sums."), slow]


@pytest.fixture
def data(cases, monkeypatch):
    def bandwidth(threads):
        return 1e10

    def peers():
        return [Installed(PEERS[0], None, "no such release")]

    monkeypatch.setattr(run, "bandwidth", bandwidth)
    return run.run_all(True, tell=lambda text: None, peers=peers, cases=cases)


def test_a_quick_run_leaves_slow_cases_out_and_tells_what_is_missing(data):
    assert [case["name"] for case in data["cases"]] == ["singlet"]
    states = {side["label"]: (side["state"], side["reason"]) for side in data["cases"][0]["sides"]}
    assert states["Optiland"] == ("missing", "no such release")
    assert states["Wrong"][0] == "mismatch"
    missed, unknown = data["goals"]
    assert missed["met"] is False
    assert unknown["met"] is None


def test_page_table_and_json_are_written_and_drawn_again(data, tmp_path, capsys):
    point = {"size": 1e3, "seconds": 0.1, "measured": True, "runs": 3, "peak_mib": 80.0}
    guess = {"size": 1e5, "seconds": 10.0, "measured": False, "runs": 0, "peak_mib": None}
    axis = {"name": "rays", "title": "Rays", "unit": "rays", "threads": 2, "bytes_each": 33.0, "note": "In blocks."}
    fit = {"value": 1.0, "error": 0.1, "over": 2}
    data["scaling"] = [axis | {"points": [point, point | {"size": 1e4, "seconds": 1.0}, guess], "slope": fit}]
    data["topics"] = {"theory": {"seconds": 1.0, "failed": False, "text": "all of it"}}
    command.write(data, tmp_path)
    page = (tmp_path / "index.html").read_text()
    for words in ("no such release", "mismatch", "a million times", "extrapolated", "all of it", "1.00 ± 0.10"):
        assert words in page.lower() or words in page, words
    stored = json.loads((tmp_path / "benchmarks.json").read_text())
    assert stored == json.loads(json.dumps(data))
    (tmp_path / "index.html").unlink()
    assert command.main(["--redraw", "-o", str(tmp_path)]) == 0
    assert re.sub(r"\s", "", (tmp_path / "index.html").read_text()) == re.sub(r"\s", "", page)


def test_readme_table_has_ratios_only_of_results_that_agree(data):
    row = next(line for line in readme_table(data).splitlines() if line.startswith("| Sums"))
    assert re.search(r"plain numpy: [\d.,]+ \[[\d.,]+, [\d.,]+\]", row)
    assert "Wrong:" in row
    assert "Optiland: missing" in row
    assert data["machine"]["date"][:10] in readme_table(data)


def test_the_explorers_own_words_make_a_row(data):
    line = bench_explorer._line("camera", [80.0, 90.0, 100.0])
    data["topics"] = {"explorer": {"seconds": 1.0, "failed": False, "text": f"before\n{line}\n"}}
    assert readme_table(data).splitlines()[-1].startswith("| Explorer, slider to changed picture")
    assert "camera 90 ms (" in readme_table(data).splitlines()[-1]
    data["topics"]["explorer"]["text"] = "no chromium on this machine"
    assert "Explorer" not in readme_table(data)


def test_names_of_cases():
    names = [case.name for case in (*peer_cases(), *own_cases())]
    assert len(set(names)) == len(names)
    assert [case.name for case in run.chosen(False, ["singlet"], None)] == ["singlet"]
    with pytest.raises(ValueError, match=r"called nothing.*singlet"):
        run.chosen(False, ["nothing"], None)
    quick = {case.name for case in run.chosen(True, (), None)}
    assert {"ideal-lens", "singlet", "tolerance"} <= quick < set(names)


def test_every_side_has_its_work():
    sides = Path(run.__file__).parent / "sides"
    for case in (*peer_cases(), *own_cases()):
        assert case.sides[0].program == "here"
        assert len({side.label for side in case.sides}) == len(case.sides)
        for side in case.sides:
            if not side.command:
                text = (sides / (side.file or f"{side.program}_side.py")).read_text()
                assert f'"{side.work}": ' in text, (case.name, side.label)


def test_errors_of_centres_are_those_put_in():
    _, truth = white_image("square", 0.7, (80, 90))
    nodes = truth.nodes(*truth.inside((80, 90), margin=14.07).T)
    found = centre_errors(truth, (80, 90), {"centres": np.add(nodes, (0.03, -0.04))})
    assert found["RMS error [px]"] == pytest.approx(0.05 / 2**0.5, rel=1e-9)  # per axis
    assert found["lenses not found [%]"] == 0
    half = centre_errors(truth, (80, 90), {"centres": nodes[::2]})
    assert half["lenses not found [%]"] == pytest.approx(50, abs=100 / len(nodes))
    assert centre_errors(truth, (80, 90), {"centres": []})["lenses not found [%]"] == 100


def test_sizes_beyond_the_limit_are_extrapolated_and_said_to_be(monkeypatch):
    def point(axis, size):
        return {"size": size, "seconds": 1e-3 * size, "measured": True, "runs": 1, "peak_mib": 50.0}

    monkeypatch.setattr(scaling, "_point", point)
    found = measure(Axis("rays", "Rays", "rays", "rays", (1e2, 1e3, 1e4, 1e6), limit=100.0))
    assert [one["measured"] for one in found["points"]] == [True, True, True, False]
    assert found["points"][-1]["seconds"] == pytest.approx(1e3)
    assert found["slope"]["value"] == pytest.approx(1.0)
    assert found["slope"]["over"] == 3


def test_a_size_that_fails_is_told(monkeypatch):
    def point(axis, size):
        raise scaling.SideError("out of memory")

    monkeypatch.setattr(scaling, "_point", point)
    found = measure(Axis("rays", "Rays", "rays", "rays", (1e2,)))
    assert found["slope"] is None
    assert found["points"][0]["reason"] == "out of memory"


def test_two_revisions_do_the_same_work_with_their_own_package(tmp_path):
    for case in compare_revisions.cases((), tmp_path):
        now, then = case.sides
        assert (now.label, then.label) == ("now", "then")
        assert (now.work, now.options, now.threads, now.command) == (
            then.work,
            then.options,
            then.threads,
            then.command,
        )
        assert now.python_path != then.python_path == tmp_path


def test_a_revision_is_checked_out_and_gone_afterwards(tmp_path):
    def git(*words):
        subprocess.run(["git", "-C", str(tmp_path), *words], check=True, capture_output=True)

    git("init", "-q")
    (tmp_path / "lens.txt").write_text("then")
    git("add", ".")
    git("-c", "user.name=x", "-c", "user.email=x@y", "commit", "-q", "-m", "first")
    (tmp_path / "lens.txt").write_text("now")
    with compare_revisions.checked_out("HEAD", tmp_path) as tree:
        assert (tree / "lens.txt").read_text() == "then"
    assert not tree.exists()
    with pytest.raises(ValueError, match="nonsense"), compare_revisions.checked_out("nonsense", tmp_path):
        pass


@pytest.mark.parametrize(
    ("value", "text"),
    [(0, "0"), (0.0123, "0.012"), (1.234, "1.2"), (12.34, "12.3"), (1234.5, "1,230"), (-45.6, "-45.6")],
)
def test_digits(value, text):
    assert digits(value) == text


def test_times_and_rates_have_units():
    assert [duration(t) for t in (600.0, 3.21, 0.0321, 4e-5)] == ["10 min", "3.2 s", "32.1 ms", "40 µs"]
    assert rate(3.51e8, "rays") == "351 million rays/s"
    assert rate(2260, "trials") == "2,260 trials/s"
