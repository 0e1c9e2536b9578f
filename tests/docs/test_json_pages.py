"""Every key of the JSON objects that `docs/reference/other-json.md` is about stands on that page.

Those of calibrations and of `roslf accuracy` are looked up where they are made: `tests/commands/test_calibrate.py`,
`tests/accuracy/test_command.py`.
"""

import json

import pytest

from roslf_design.bench.acceptance import Acceptance, AcceptanceLine
from roslf_design.bench.boards import NextPose
from roslf_design.bench.captures import BoardPose
from roslf_design.bench.check import BenchCheck, ImageCheck
from roslf_design.cli import main
from tests.docs.described import sections

POSE = BoardPose(file="board_01.tif", ahead=20.0, right=0.0, up=0.0, tilt=0.1, towards=0.0, turn=0.0)


@pytest.fixture(scope="module", name="sections")
def sections_of_the_page():
    return sections()


def assert_described(data, sections):
    missing = set(data) - sections[data["schema"]] - {"schema"}
    assert not missing


def test_keys_of_plans(sections, capsys):
    assert main(["calibrate", "--plan", "paper", "--at", "240mm", "--at", "600mm", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert_described(data, sections)
    assert set(data["cover"]) <= sections[data["schema"]]


def test_keys_of_tolerance_studies(sections, tmp_path, capsys):
    study = 'name = "s"\ndesign = "paper"\ngrade = "high"\ntrials = 64\n[[goals]]\nmetric = "fill_factor"\nmax = 1.1\n'
    (tmp_path / "study.toml").write_text(study)
    assert main(["tolerance", str(tmp_path / "study.toml"), "-o", str(tmp_path / "out")]) == 0
    capsys.readouterr()
    assert_described(json.loads((tmp_path / "out/results.json").read_text()), sections)


def test_keys_of_benches(sections):
    image = ImageCheck("board_01.tif", "board", pose=POSE)
    check = BenchCheck((image,), {"H": 0.1}, 0.06, NextPose(POSE, {"H": 0.05})).to_dict()
    assert_described(check, sections)
    assert set(check["images"][0]) <= sections[check["schema"]]
    line = AcceptanceLine("Depth", "flatness", "mm", 0.1, 0.02)
    result = Acceptance("paper", (line,), (), ()).to_dict()
    assert_described(result, sections)
    assert set(result["lines"][0]) <= sections[result["schema"]]


LISTS = [["presets"], ["quantities"], ["keys", "tube"], ["catalogue"]]
RENDER = ["render", "paper", "--region", "2000,1300,20,20", "--json"]


@pytest.mark.parametrize("words", [*LISTS, RENDER, [*RENDER, "--plan-only"]], ids=" ".join)
def test_keys_of_what_commands_print(words, sections, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(list(dict.fromkeys([*words, "--json"]))) == 0
    data = json.loads(capsys.readouterr().out)
    assert_described(data, sections)
    for name in ("presets", "quantities", "tables", "effects"):
        assert {key for row in data.get(name, ()) for key in row} <= sections[data["schema"]]


def test_keys_of_data_sheets_and_optima(sections, tmp_path, capsys):
    study = 'design = "rigid-scope"\n[variables]\nd_3 = ["0.4 mm", "0.6 mm"]\n[[goals]]\nquantity = "fill_factor"\n'
    (tmp_path / "study.toml").write_text(f'name = "s"\n{study}direction = "max"\n[solver]\nstarts = 2\n')
    assert main(["optimize", str(tmp_path / "study.toml"), "-o", str(tmp_path / "out")]) == 0
    assert main(["datasheet", "rigid-scope", "-o", str(tmp_path / "sheet.json")]) == 0
    capsys.readouterr()
    for path in (tmp_path / "out/results.json", tmp_path / "sheet.json"):
        assert_described(data := json.loads(path.read_text()), sections)
        for name in ("goals", "constraints", "lines"):
            assert {key for row in data.get(name, ()) for key in row} <= sections[data["schema"]]
