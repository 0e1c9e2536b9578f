"""The command line as a script sees it: output, exit code, one line for each thing wrong."""

import json
import subprocess
import sys

import pytest

from roslf_design.cli import COMMANDS, main


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
    code, out, err = run(capsys, "evaluate", "paper")
    assert (code, err) == (0, "")
    assert "f-number matched" in out
    assert "1.00506" in out


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


def test_evaluate_imports_nothing_heavy():
    probe = (
        "import sys; from roslf_design.cli import main; main(['evaluate', 'paper', '--json'])\n"
        "heavy = {'numba', 'matplotlib', 'scipy', 'pyvista'} & set(sys.modules)\n"
        "sys.exit(f'imported {heavy}' if heavy else 0)"
    )
    done = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
