"""Statistics, judgements, table and page from invented times; nothing is measured here."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks import __main__ as command
from benchmarks import page, peers
from benchmarks.commands import REPOSITORY, checked_out, commands
from benchmarks.peers import PEERS, Case, Peer, compare, install, interpreter
from benchmarks.turns import Row, RunError, Side, Spread, in_turn, process

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
        return lambda: order.append(label) or float(len(order))

    assert in_turn({"a": run("a"), "b": run("b")}, 3) == {"a": [3.0, 6.0, 7.0], "b": [4.0, 5.0, 8.0]}
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
    assert process((sys.executable, "-c", "print(0.25)"), prints=True)() == 0.25
    with pytest.raises(RunError, match="not today"):
        process((sys.executable, "-c", "raise SystemExit('not today')"))()


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
    made["singlet"] = Row("singlet", "rays", "rays", (ours, other, Side("Third", fault="off by 1")), "Note <b>.")
    return made


def test_readme_has_ten_rows_at_most_with_ratios_only_of_results_that_agree():
    table = page.readme_table(list(rows().values()), MACHINE)
    lines = table.splitlines()[4:]
    assert len(lines) == len(page.README_ROWS) <= 10
    singlet = next(line for line in lines if line.startswith("| Rays through a singlet"))
    assert singlet.endswith("| 0.67 rays/s | Other: 2.5 [2, 3]; Third: off by 1 |")
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
    assert command.main(["-o", str(tmp_path)]) == 0
    html = (tmp_path / "index.html").read_text()
    assert len(html) < 100_000
    assert "what help does" in html
    assert "Note &lt;b&gt;." in html
    (tmp_path / "index.html").unlink()
    assert command.main(["--redraw", "-o", str(tmp_path)]) == 0
    assert (tmp_path / "index.html").read_text() == html
    stored = json.loads((tmp_path / "benchmarks.json").read_text())
    (tmp_path / "benchmarks.json").write_text(json.dumps(stored | {"schema": "roslf.benchmarks/1"}))
    assert command.main(["--redraw", "-o", str(tmp_path)]) == 2
    assert "another version" in capsys.readouterr().err


def test_two_revisions_in_a_line():
    now, slow, dead, few = (Side("", s) for s in ((1.0, 1.1, 1.2), (2.0, 2.0, 2.0), (), (3.0,)))
    assert page.comparison_line(Row("a", "A", sides=(now, slow))).endswith("0.55 [0.5, 0.6] of 3  faster")
    assert page.comparison_line(Row("a", "A", sides=(slow, now))).endswith("SLOWER")
    assert page.comparison_line(Row("a", "A", sides=(few, few))).endswith("as far as can be told")
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


def test_who_differs_or_is_missing_has_no_times():
    image = np.zeros((60, 60), np.float32)
    image[20:24, 20:24] = 1
    asked = ("centres-x", "Centres", "", {"scipy": 1, "batoid": 1}, {"image": image})
    case = Case(*asked, lambda a, b: "", lambda a: "ok")
    ours, missing = compare(case, {"batoid": "no wheel for it"}, 1, 0.0).sides
    assert (len(ours.seconds), ours.note, ours.fault) == (1, "ok", "")
    assert (missing.seconds, missing.fault) == ((), "no wheel for it")
    assert compare(Case(*asked, lambda a, b: "off by 1"), {}, 1, 0.0).sides[0].fault == "off by 1"
    assert peers.away("x", float("nan"), 1.0)
