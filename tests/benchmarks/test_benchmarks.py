"""Statistics, judgements, table and page from invented times; nothing is measured here."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks import __main__ as command
from benchmarks import page, peers, yardstick
from benchmarks.commands import FIRST, REPOSITORY, checked_out, commands, typed
from benchmarks.peers import PEERS, Case, Peer, compare, install, interpreter
from benchmarks.scaling import SERIES, growth, one
from benchmarks.sides import here_lens
from benchmarks.turns import Row, RunError, Side, Spread, environment, in_turn, process

MACHINE = {
    "processor": "P",
    "cores": 2,
    "date": "2026-01-01",
    "python": "3.11",
    "numpy": "2",
    "revision": "r",
    "load": 0,
}


def test_runs_take_turns_and_the_first_round_does_not_count():
    order = []

    def run(label):
        return lambda: order.append(label) or len(order)

    assert in_turn({"a": run("a"), "b": run("b")}, 3) == {"a": [3, 6, 7], "b": [4, 5, 8]}
    assert "".join(order) == "baabbaab"
    assert len(in_turn({"a": run("a")}, 9, most_seconds=0.0)["a"]) == 1


def test_who_fails_is_left_out_and_the_rest_goes_on():
    def bad():
        raise RunError("no such lens")

    assert in_turn({"a": lambda: 1.0, "b": bad}, 2) == {"a": [1.0, 1.0], "b": "no such lens"}


def test_ratios_are_of_pairs_so_that_the_machines_drift_cancels():
    drift = np.exp(np.random.default_rng(0).normal(0, 2, 31))
    ratio = Side("a", tuple(drift)).ratio(Side("b", tuple(3 * drift)))
    assert (ratio.low, ratio.median, ratio.high) == pytest.approx((3, 3, 3), rel=1e-12)
    assert Side("a", (1.0, 2.0), 10).ratio(Side("b", (1.0, 4.0), 1)) == Spread(15.0, 10.0, 20.0, 2)
    with pytest.raises(ValueError, match="1 and 2 runs"):
        Side("a", (1.0,)).ratio(Side("b", (1.0, 2.0)))


def test_processes_are_timed_from_start_to_exit_or_print_their_own_seconds():
    assert process((sys.executable, "-c", "print(0.25)"), prints=True)().wall == 0.25
    assert process((sys.executable, "-c", "print(0.25, 0.5)"), prints=True)()[:2] == (0.25, 0.5)
    busy = process((sys.executable, "-S", "-c", "import time\nwhile time.process_time() < 0.3: pass"))()
    assert 0.3 <= busy.processor <= busy.wall + 0.05
    with pytest.raises(RunError, match="not today"):
        process((sys.executable, "-c", "raise SystemExit('not today')"))()


def test_memory_is_the_commands_own_and_not_that_of_who_starts_it():
    mine = np.ones(40_000_000)
    small, large = (process((sys.executable, "-S", "-c", f"b'x' * {size}"))().peak for size in (1, 100_000_000))
    assert small < 100 < mine.nbytes / 1e6
    assert large - small == pytest.approx(100, rel=0.1)


def test_bytecode_is_kept_as_users_have_it(monkeypatch):
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    assert "PYTHONDONTWRITEBYTECODE" not in environment()
    assert environment(1)["OMP_NUM_THREADS"] == "1"


def test_a_bar_is_of_processor_seconds_or_of_units_a_second():
    side = Side("warm", (1.0, 1.0, 1.0), processor=(2.0, 2.1, 1.9))
    rows = [Row("a", "A", sides=(side,), bar=2.5), Row("a", "A", sides=(side,), bar=1.5)]
    rows += [Row("a", "A", "rays", (side,), bar=0.4), Row("a", "A", "rays", (side,), bar=0.6)]
    assert [row.met for row in rows] == [True, False, True, False]
    assert [page.bar(row).split(": ")[1] for row in rows] == ["met", "MISSED"] * 2
    assert Row("a", "A", sides=(Side("warm", fault="no"),), bar=1.0).met is None
    assert page.figure(rows[1]) == "2 s (at most 1.5 s: MISSED)"


def test_growth_is_the_exponent_of_a_power_law_with_its_error():
    sizes = (1e3, 1e4, 1e5, 1e6)
    off = np.array([1, -1, -1, 1]) * 0.1  # square to line and constant, so the fit is not moved by it
    times = 3e-6 * np.power(sizes, 1.5) * np.exp(off)
    sides = [Side(f"{n:g}", (1.0,), n, processor=(t,)) for n, t in zip(sizes, times, strict=True)]
    ones = growth(sides)
    x = np.log(sizes)
    assert ones.exponent == pytest.approx(1.5, rel=1e-12)
    assert ones.error == pytest.approx(np.sqrt(0.04 / 2 / np.sum((x - x.mean()) ** 2)), rel=1e-9)
    assert ones.at(1e7) == pytest.approx(times[-1] * 10**ones.at_end, rel=1e-9)
    assert ones.at_end > ones.exponent
    assert ones.faster
    assert "FASTER" in page.grown(ones)
    assert growth([Side("0", (1.0,), 0, processor=(1.0,)), *sides[:1]]) is None


def test_what_takes_too_long_is_computed_and_says_so():
    series = next(series for series in SERIES if series.name == "trials")
    sides = [Side(f"{n:g}", (1.0,), n, processor=(1e-3 * n,)) for n in (1e3, 1e4, 1e5)]
    far = one(series, 10**7, growth(sides))
    assert far.seconds == ()
    assert far.fault == "computed from the smaller ones, not run: 10000 s"
    table = page.page({"scaling": [Row("scaling-trials", "T", "trials", (*sides, far))]}, MACHINE)
    assert "not run: 10000 s" in table
    assert "<svg" in table
    assert "processor time [s]" in table


@pytest.mark.parametrize("series", SERIES, ids=lambda series: series.name)
def test_every_series_has_sizes_that_grow_and_is_prepared(series):
    assert list(series.sizes) == sorted(set(series.sizes))
    assert callable(series.prepare(series.sizes[0]))


def test_readmes_first_commands_end_by_themselves():
    first = typed((REPOSITORY / "README.md").read_text())[:FIRST]
    assert [words[0] for words in first] == ["presets", "catalogue", "evaluate", "evaluate", "evaluate"]


def test_plain_estimators_disparities_are_judged_by_their_slope_on_the_true_ones():
    true = np.linspace(-0.5, 0.5, 101).reshape(1, -1)
    bias, scatter, within = peers.disparity_errors(true, {"disparity": 1.12 * true + 0.01})
    assert (bias, scatter) == (pytest.approx(0.12), pytest.approx(0, abs=1e-12))
    assert np.isnan(within)
    known = {"disparity": true + 0.02, "sigma": np.where(true < 0, 0.01, 0.03)}
    assert peers.disparity_errors(true, known)[2] == pytest.approx(51 / 101)


def test_numbers_have_digits_that_count_and_units():
    texts = {0: "0", 0.0123: "0.012", 12.34: "12.3", 1234.5: "1,230", -45.6: "-45.6"}
    assert [page.digits(value) for value in texts] == list(texts.values())
    assert [page.amount(t) for t in (600.0, 3.21, 0.0321, 4e-5, 2e-8)] == [
        "10 min",
        "3.2 s",
        "32.1 ms",
        "40 µs",
        "20 ns",
    ]
    assert [page.amount(1 / n, "rays") for n in (3.51e8, 2260)] == ["351 million rays/s", "2,260 rays/s"]


def rows():
    names = [name for _, joined in page.README_ROWS for name in joined]
    ours, other = Side("here", (1.0, 2.0)), Side("Other", (3.0, 4.0))
    made = {name: Row(name, f"what {name} does", sides=(ours,)) for name in names}
    short = Side("Short", (0.5, 1.0), note="1 thread; 42.6% missing", short="off by 1")
    made["centres-square"] = Row("centres-square", "centres", sides=(ours, short))
    made["singlet"] = Row("singlet", "rays", "rays", (ours, other, Side("Third", fault="off by 1")), "Note <b>.")
    return made


def test_readme_has_ten_rows_at_most_with_ratios_only_of_results_that_agree():
    table = page.readme_table(list(rows().values()), MACHINE)
    lines = table.splitlines()[4:]
    assert len(lines) == len(page.README_ROWS) <= 10
    singlet = next(line for line in lines if line.startswith("| Rays through a singlet"))
    assert singlet.endswith("| 0.67 rays/s | Other: 2.5 [2, 3]; Third: off by 1 |")
    assert "Short: 0.5 [0.5, 0.5], FASTER than here (42.6% missing) |" in table
    few = page.readme_table([row for name, row in rows().items() if name != "help"], MACHINE)
    assert "--help" not in few


def test_the_table_goes_between_its_marks():
    begin, end = page.MARKS
    text = page.with_table(f"before {begin} old {end} after", "new\n")
    assert text == f"before {begin}\nnew\n{end} after"
    assert page.with_table(text, "new\n") == text
    for wrong in ("no marks", f"{end} {begin}", f"{begin} {begin} {end}"):
        with pytest.raises(ValueError, match="once each"):
            page.with_table(wrong, "new")
    assert page.with_table((REPOSITORY / "README.md").read_text(), "new\n")


def test_a_run_is_stored_and_drawn_again_small(tmp_path, capsys, monkeypatch):
    made = rows()
    for part in command.PARTS:
        some = [row for name, row in made.items() if (name == "singlet") == (part == "peers") and part != "rates"]
        monkeypatch.setitem(command.PARTS, part, lambda quick, chosen, some=some: iter(some))
    monkeypatch.setattr(command.yardstick, "measure", lambda: {"a loop": 0.5})
    assert command.main(["-o", str(tmp_path)]) == 0
    html = (tmp_path / "index.html").read_text()
    assert len(html) < 100_000
    assert "Yardstick, processor time: a loop, 500 ms." in html
    assert "what help does" in html
    assert "Note &lt;b&gt;." in html
    (tmp_path / "index.html").unlink()
    assert command.main(["--redraw", "-o", str(tmp_path)]) == 0
    assert (tmp_path / "index.html").read_text() == html
    stored = json.loads((tmp_path / "benchmarks.json").read_text())
    assert stored["machine"].pop("yardstick") == {"a loop": 0.5}  # which older runs have not
    (tmp_path / "benchmarks.json").write_text(json.dumps(stored))
    assert command.main(["--redraw", "-o", str(tmp_path)]) == 0
    assert (tmp_path / "index.html").read_text() == html.replace(" Yardstick, processor time: a loop, 500 ms.", "")
    (tmp_path / "benchmarks.json").write_text(json.dumps(stored | {"schema": "roslf.benchmarks/1"}))
    assert command.main(["--redraw", "-o", str(tmp_path)]) == 2
    assert "another version" in capsys.readouterr().err


def test_the_yardstick_alone_runs_nothing_of_ours(capsys, monkeypatch):
    monkeypatch.setattr(yardstick, "WORK", {"nothing": "pass", "four": "print(4.0, 4.0)", "wrong": "import nowhere"})
    for part in command.PARTS:
        monkeypatch.setitem(command.PARTS, part, pytest.fail)
    assert command.main(["--only", "yardstick"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("Yardstick, processor time: nothing, ")
    assert said.endswith("four, 4000 ms.\n")


def test_two_revisions_in_a_line():
    now, slow, dead, few = (Side("", s) for s in ((1.0, 1.1, 1.2), (2.0, 2.0, 2.0), (), (3.0,)))
    assert page.comparison_line(Row("a", "A", sides=(now, slow))).endswith("0.55 [0.5, 0.6] of 3  faster")
    assert page.comparison_line(Row("a", "A", sides=(slow, now))).endswith("SLOWER")
    assert page.comparison_line(Row("a", "A", sides=(few, few))).endswith("as far as can be seen")
    assert "no ratio" in page.comparison_line(Row("a", "A", sides=(now, dead)))


def test_a_revision_is_checked_out_and_gone_afterwards(tmp_path):
    git = ["git", "-C", str(tmp_path), "-c", "user.name=x", "-c", "user.email=x@y"]
    subprocess.run([*git, "init", "-q"], check=True)
    subprocess.run([*git, "commit", "-q", "--allow-empty", "-m", "first"], check=True)
    with checked_out("HEAD", tmp_path) as tree:
        assert tree.is_dir()
    assert not tree.exists()
    with pytest.raises(ValueError, match="nonsense"), checked_out("nonsense", tmp_path):
        pass


def test_commands_have_files_and_names_of_their_own(tmp_path):
    made = commands(tmp_path, quick=True)
    assert len({one.name for one in made}) == len(made)
    assert all(Path(word).is_file() for one in made for word in one.words if word.endswith(".toml"))


def test_peers_are_pinned_and_what_cannot_be_had_is_said(tmp_path):
    for peer in PEERS:
        assert any(name.endswith(f"=={peer.title.split()[1]}") for name in (*peer.loose, *peer.packages))
    assert interpreter(()) == sys.executable
    with pytest.raises(RunError, match=r"no Python 1\.4"):
        install(Peer("old", "Old 1", (), pythons=("1.4",)), tmp_path)


def test_our_side_of_the_spots_is_snells_law():
    """What others are compared with holds by itself: 127 rays through two spheres in vectors; both round to 1e-13."""
    (case,) = peers.cases(True, ["spots"])
    radius, thickness, near, far, pupil, index = (
        float(case.inputs[key]) for key in ("radius", "thickness", "object", "image", "pupil", "index")
    )
    rings = [k * np.exp(2j * np.pi * np.arange(6 * k) / (6 * k)) for k in range(1, 7)]
    spread = np.concatenate([[0.0], *rings]) * pupil / 2 / 6
    start = np.stack([spread.real, spread.imag, 0 * spread.real], axis=-1)
    expected = []
    for height in case.inputs["heights"]:
        point, ray = start, start - [0.0, -height, -near]
        for vertex, bend, before, behind in ((0.0, radius, 1.0, index), (thickness, -radius, index, 1.0)):
            ray = ray / np.linalg.norm(ray, axis=1, keepdims=True)
            away = point - [0.0, 0.0, vertex + bend]
            along = np.sum(away * ray, axis=1)
            root = np.sqrt(along**2 - np.sum(away**2, axis=1) + bend**2)
            point = point + (-along - np.sign(bend) * root)[:, None] * ray
            normal = (point - [0.0, 0.0, vertex + bend]) / -bend
            cos, ratio = np.sum(normal * ray, axis=1), before / behind
            ray = ratio * ray + (np.sqrt(1 - ratio**2 * (1 - cos**2)) - ratio * cos)[:, None] * normal
        seen = (point + ((thickness + far - point[:, 2]) / ray[:, 2])[:, None] * ray)[:, :2]
        expected.append(np.sqrt(np.mean(np.sum((seen - seen.mean(axis=0)) ** 2, axis=1))))
    _, spots = here_lens({key: np.asarray(value) for key, value in case.inputs.items()})
    assert spots({}, np.array([thickness + far]), np.zeros((1, 3)))[0] == pytest.approx(expected, rel=1e-11)


def test_who_differs_or_is_missing_has_no_times():
    image = np.zeros((60, 60), np.float32)
    image[20:24, 20:24] = 1
    asked = ("centres-x", "Centres", "", {"scipy": 1, "batoid": 1}, {"image": image})
    case = Case(*asked, lambda a, b: "", lambda a: "ok")
    ours, missing = compare(case, {"batoid": "no wheel for it"}, 1, 0.0).sides
    assert (len(ours.seconds), ours.note[-4:], ours.fault) == (1, "; ok", "")
    assert (missing.seconds, missing.fault) == ((), "no wheel for it")
    assert compare(Case(*asked, lambda a, b: "off by 1"), {}, 1, 0.0).sides[0].fault == "off by 1"
    stands = compare(Case(*asked, lambda a, b: "off by 1", lambda a: "42.6 % missing", stands=True), {}, 1, 0.0)
    assert (len(stands.sides[0].seconds), stands.sides[0].short) == (1, "off by 1")
    assert "1 thread" in stands.sides[0].note
    assert peers.away("x", float("nan"), 1.0)
