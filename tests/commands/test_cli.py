"""The command line as a script sees it: output, exit code, one line for each thing wrong."""

import importlib.util
import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest
from PIL import Image

from roslf_design import cli, evaluate, load, preset_names, save
from roslf_design.cli import COMMANDS, main
from roslf_design.drawing.picture import Picture
from roslf_design.errors import printable
from tests.reporting.made import rough_resolution

COMMAND = [sys.executable, "-m", "roslf_design"]


def run(capsys, *arguments):
    code = main([str(argument) for argument in arguments])
    out, err = capsys.readouterr()
    return code, out, err


def test_evaluate_json(capsys, root):
    code, out, err = run(
        capsys, "evaluate", root / "designs" / "paper.toml", "--json", "--field", "11.15", "--field=-3,4"
    )
    assert (code, err) == (0, "")
    result = json.loads(out)
    assert [field["x_ml_mm"] for field in result["fields"]] == [[11.15, 0.0], [-3.0, 4.0]]


def test_evaluate_table_and_preset_name(capsys):
    code, out, err = run(capsys, "evaluate", "paper", "--all")
    assert (code, err) == (0, "")
    assert "f-number matched" in out
    assert "1.00506" in out
    assert "→ larger microlenses" in out
    assert len(out.splitlines()) > 100


def test_an_evaluation_fits_on_a_screen_and_tells_every_fault(capsys, monkeypatch):
    module, told = importlib.import_module("roslf_design.commands.evaluate"), []
    compute = module.compute
    monkeypatch.setattr(module, "compute", lambda *of, **how: told.append(compute(*of, **how)) or told[-1])
    for name in preset_names():
        code, out, _ = run(capsys, "evaluate", name)
        assert code == 0
        assert len(out.splitlines()) <= 40, out
        levels = [verdict.level for verdict in told[-1].verdicts]
        assert out.count("✗ ") == levels.count("fault")
        assert sum(line.startswith("~ ") for line in out.splitlines()) == levels.count("limit")
        assert "What it sees" in out
    code, out, _ = run(capsys, "evaluate", "paper", "--field", "1.5")
    assert "\n1.5, 0  " in out


def test_strict_fails_where_something_required_is_missed(capsys, tmp_path, root):
    for most, failed in (("1 mm", 0), ("1 um", 1)):
        path = tmp_path / "design.toml"
        path.write_text((root / "designs/paper.toml").read_text() + f'\n[required]\nu_z_mm = {{max = "{most}"}}\n')
        assert run(capsys, "evaluate", path)[0] == 0
        assert run(capsys, "evaluate", path, "--strict")[0] == failed
        assert run(capsys, "evaluate", path, "--strict", "--json")[0] == failed
        assert run(capsys, "evaluate", path, "--strict", "-o", tmp_path / "a.csv")[0] == failed


def test_presets(capsys):
    code, out, _ = run(capsys, "presets", "--json")
    assert code == 0
    assert {row["preset"] for row in json.loads(out)["presets"]} >= {"paper", "paper-mismatched", "rigid-scope"}
    code, out, _ = run(capsys, "presets")
    assert code == 0
    assert "paper-calibrated" in out


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["evaluate", "none.toml"], "none.toml: no such file"),
        (["evaluate", "paper", "--field", "abc"], "--field"),
        (["evaluate", "paper", "--field", "nan"], "--field"),
        (["evaluate", "paper", "--fild", "1"], "--fild"),
        (["evaluate"], "DESIGN"),
        (["evaluat", "paper"], "evaluat"),
    ],
)
def test_bad_arguments_are_one_line_and_exit_2(capsys, arguments, said):
    code, out, err = run(capsys, *arguments)
    assert code == 2
    assert out == ""
    assert said in err
    assert len(err.strip().splitlines()) == 1


def test_a_design_file_with_faults(capsys, tmp_path, root):
    text = (root / "designs" / "paper.toml").read_text()
    bad = tmp_path / "bad.toml"
    bad.write_text(text.replace('"2.9 mm"', "2.9").replace('"120 mm"', '"400 mm"').replace("pitch", "ptch"))
    code, out, err = run(capsys, "evaluate", bad)
    assert (code, out) == (2, "")
    lines = err.strip().splitlines()
    assert len(lines) == 4
    assert all(line.startswith(f"roslf: {bad}: ") for line in lines)
    for said in (
        "aperture.diameter: 2.9 has no unit",
        "microlens_array.pitch: is missing",
        "did you mean 'pitch'",
        "inside the bore",
    ):
        assert said in err


def test_every_command_has_help_with_an_example(capsys):
    code, out, _ = run(capsys, "--help")
    assert code == 0
    for name in COMMANDS:
        assert name in out
        code, text, _ = run(capsys, name, "--help")
        assert code == 0
        assert f"Example: roslf {name}" in text


def test_help_imports_nothing_heavy():
    probe = (
        "import sys; from roslf_design.cli import main; main(['--help'])\n"
        "heavy = {'numpy', 'numba', 'pydantic', 'matplotlib', 'scipy', 'pyvista'} & set(sys.modules)\n"
        "sys.exit(f'imported {heavy}' if heavy else 0)"
    )
    done = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_evaluate_imports_nothing_heavy_and_spells_out_letters_that_a_terminal_does_not_know():
    probe = (
        "import sys; from roslf_design import cli; sys.argv = ['roslf', 'evaluate', 'paper']\n"
        "try: cli.run()\n"
        "except SystemExit as end: assert not end.code\n"
        "heavy = {'numba', 'matplotlib', 'scipy', 'pyvista'} & set(sys.modules)\n"
        "sys.exit(f'imported {heavy}' if heavy else 0)"
    )
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    done = subprocess.run([sys.executable, "-c", probe], capture_output=True, check=False, env=environment)
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout.isascii()
    done = subprocess.run([*COMMAND, "evaluate", b"\xff.toml"], capture_output=True, check=False)
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1


def test_what_libraries_import_and_hardly_use_is_executed_when_asked_for():
    probe = (
        "import sys; from roslf_design import cli; sys.argv = ['roslf', '--version']\n"
        "try: cli.run()\n"
        "except SystemExit: pass\n"
        "import scipy.special, secrets, numpy\n"
        "assert 'unittest' not in sys.modules\n"
        "numpy.testing.assert_array_equal(len(secrets.token_bytes(2)), 2)\n"
        "assert 'unittest' in sys.modules\n"
    )
    done = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("name", ["a [/bold] design", "a [red]design", "\x1b[31mred\x9b0m", "{x} :smile:"])
def test_names_are_shown_as_they_are_written(name, capsys, tmp_path, root):
    text = (root / "designs" / "paper.toml").read_text().replace("Zhou 2023 bench system", "NAME")
    design = tmp_path / "design.toml"
    design.write_text(text.replace('"NAME"', json.dumps(name)))
    code, out, err = run(capsys, "evaluate", design)
    assert (code, err) == (0, "")
    assert out.splitlines()[0] == printable(name)
    code, out, _ = run(capsys, "evaluate", design, "--json")
    assert json.loads(out)["design"] == name
    assert out.replace("\n", "").isprintable()


def test_many_faults_are_told_in_a_few_lines(capsys, tmp_path, root):
    design = tmp_path / "design.toml"
    design.write_text((root / "designs" / "paper.toml").read_text() + "".join(f"k{n} = 1\n" for n in range(500)))
    code, out, err = run(capsys, "evaluate", design)
    assert (code, out) == (2, "")
    lines = err.splitlines()
    assert len(lines) == 41
    assert lines[-1] == "roslf: and 460 more faults"


def test_what_cannot_be_computed_with_is_one_line(capsys, monkeypatch):
    def fails(*_):
        raise OverflowError("(34, 'Numerical result out of range')")

    monkeypatch.setattr("roslf_design.cli._run", fails)
    code, _, err = run(capsys, "evaluate", "paper")
    assert code == 1
    assert len(err.splitlines()) == 1
    assert "a number went out of bounds" in err


@pytest.mark.parametrize("arguments", [["presets", "--json"], ["catalogue"], ["--help"]])
def test_a_reader_that_has_enough_ends_it_quietly(arguments):
    with subprocess.Popen([*COMMAND, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as done:
        assert done.stdout is not None
        assert done.stderr is not None
        done.stdout.close()  # before anything is written
        assert done.stderr.read() == b""
        assert done.wait() in (0, 141)


@pytest.mark.parametrize(
    "module", ["roslf_design.cli", "cyclopts", "roslf_design.commands.evaluate", "numpy", "pydantic", "rich.console"]
)
def test_ctrl_c_is_one_quiet_line_even_while_modules_are_imported(module):
    probe = (
        "import runpy, sys\n"
        "class Interrupted:\n"
        "    @staticmethod\n"
        "    def find_spec(name, *_):\n"
        f"        if name == {module!r}: raise KeyboardInterrupt\n"
        "sys.meta_path.insert(0, Interrupted)\n"
        "sys.argv = ['roslf', 'evaluate', 'paper']\n"
        "runpy.run_module('roslf_design', run_name='__main__')"
    )
    done = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "roslf: stopped\n")


def test_evaluate_shows_the_distances_that_are_required_and_fields_by_name(tmp_path, capsys):
    asked = load("paper").replace({"required": {"field_half_width_mm": [{"at": "240 mm", "min": 1.0}]}})
    save(asked, tmp_path / "a.toml")
    assert main(["evaluate", str(tmp_path / "a.toml"), "--json", "--field", "corner", "--field", "centre"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [one["at_mm"] for one in told["answer"]["at"]][1:] == [240.0]
    centre, _, corner = evaluate(asked).fields
    assert [tuple(one["x_ml_mm"]) for one in told["fields"]] == [corner.x_ml_mm, centre.x_ml_mm]


SWEPT = ("--set", "d_3=1..9 mm")


@pytest.mark.parametrize(
    ("command", "name", "other"),
    [
        (("evaluate", "paper"), "all.json", ("--at", "200mm")),
        (("evaluate", "paper"), "all.csv", ("--at", "200mm")),
        (("sweep", "paper", "--quantity", "fill_factor", *SWEPT), "s.csv", ("--points", "4")),
        (("sweep", "paper", "--quantity", "fill_factor", *SWEPT), "s.svg", ("--quantity", "sigma_z_mm")),
        (("sweep", "paper", "--quantity", "fill_factor", *SWEPT), "s.png", ("--quantity", "sigma_z_mm")),
        (("export", "paper"), "paper.zmx", ()),
        (("datasheet", "paper"), "sheet.csv", ("--at", "200mm")),
        (("datasheet", "paper"), "sheet.json", ("--at", "200mm")),
        (("datasheet", "paper"), "sheet.html", ("--at", "200mm")),
    ],
)
def test_a_file_is_written_over_its_earlier_self_alone_and_says_so(
    capsys, monkeypatch, blank_pngs, tmp_path, command, name, other
):
    monkeypatch.setattr(Picture, "to_png", blank_pngs)
    rough_resolution(monkeypatch)
    place = tmp_path / name
    place.write_text("notes of mine, which nothing else holds")
    code, _, err = run(capsys, *command, "-o", place)
    assert (code, err) == (2, f"roslf: -o: {place} is of something else; delete it or choose another place\n")
    assert place.read_text() == "notes of mine, which nothing else holds"
    place.unlink()
    said = f"roslf: {place} was there and is written over"
    assert said not in run(capsys, *command, "-o", place)[2]
    first = place.read_bytes()
    assert said not in run(capsys, *command, "-o", place)[2]  # the same bytes
    assert place.read_bytes() == first
    code, _, err = run(capsys, *command, *other, "-o", place)
    assert (code, said in err, place.read_bytes() != first) == (0, bool(other), bool(other))


def test_a_module_that_waits_is_whole_for_every_thread(tmp_path, monkeypatch):
    (tmp_path / "waiting_module.py").write_text("import time\nEARLY = 1\ntime.sleep(0.05)\nLATE = 2\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(cli, "SELDOM_USED", frozenset({"waiting_module"}))
    monkeypatch.setattr(sys, "meta_path", [cli._Lazily, *sys.meta_path])
    module = importlib.import_module("waiting_module")
    monkeypatch.delitem(sys.modules, "waiting_module")
    assert "EARLY" not in vars(module)
    with ThreadPoolExecutor(8) as pool:
        assert list(pool.map(lambda _: module.LATE + module.EARLY, range(8))) == [3] * 8
    with pytest.raises(AttributeError, match="'waiting_module' has no attribute 'NEVER'"):
        _ = module.NEVER


FOREIGN = {
    "a.json": (("evaluate", "paper"), b'{"mine": 1}'),
    "deep.json": (("evaluate", "paper"), b"[" * 200_000),
    "a.csv": (("evaluate", "paper"), b"key,value\nmine,1\n"),
    "sheet.json": (("datasheet", "paper"), b'{"a":' * 200_000),
    "s.png": (("sweep", "paper", "--quantity", "fill_factor", *SWEPT), None),
    "s.svg": (
        ("sweep", "paper", "--quantity", "fill_factor", *SWEPT),
        b'<?xml version="1.0" encoding="utf-8"?>\n<svg xmlns="http://www.w3.org/2000/svg"/>\n',
    ),
    "s.parquet": (("sweep", "paper", "--quantity", "fill_factor", *SWEPT), None),
    "s.csv": (("sweep", "paper", "--quantity", "fill_factor", *SWEPT), b"d_3 [mm],fill_factor\n1.0,0.5\n"),
    "own.zmx": (("export", "paper"), b"VERS 140124 258 36214\nMODE SEQ\nNAME mine\nUNIT MM X W X CM MR CPMM\n"),
    "lens.json": (("export", "paper"), b'{"version": 1.0, "name": "mine"}'),
}
"""Files of the same kinds that others wrote, by name, and commands that would write there."""


@pytest.mark.parametrize("name", FOREIGN)
def test_a_file_of_the_same_kind_that_something_else_wrote_is_kept(capsys, monkeypatch, blank_pngs, tmp_path, name):
    monkeypatch.setattr(Picture, "to_png", blank_pngs)
    command, content = FOREIGN[name]
    place = tmp_path / name
    match place.suffix:
        case ".png":
            Image.new("L", (4, 4)).save(place)
        case ".parquet":
            pyarrow = pytest.importorskip("pyarrow")
            importlib.import_module("pyarrow.parquet").write_table(pyarrow.table({"mine": [1.0]}), place)
        case _:
            place.write_bytes(content)
    held = place.read_bytes()
    code, _, err = run(capsys, *command, "-o", place)
    assert (code, place.read_bytes() == held) == (2, True)
    assert "is of something else; delete it or choose another place" in err
