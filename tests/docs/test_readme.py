"""Every command and every Python block of README works as printed, from the project's folder.

Studies are thinned (fewer trials, starts and cases): what a reader types is run, how long it takes is not.
"""

import ast
import contextlib
import io
import os
import re
import shlex
import shutil
import sys

import pytest

sys.path.insert(0, os.path.dirname(__file__))
from pages import blocks, run, thin_out

from roslf_design.cli import COMMANDS
from roslf_design.commands import warm
from roslf_design.optimization import robust
from studies.accuracy import hard_rows
from tests.depth.made import at_first_sight
from tests.reporting.made import few_waves, without_figures

SERVES = ("explore",)
"""Commands that run until they are stopped; README may leave them out."""
STUDIES = ("study.toml", "optimize.toml", "tolerance.toml", "story.toml")
THINNER = (
    (r"(?m)^trials = .*$", "trials = 64"),
    (r"(?m)^sobol_samples = .*$", "sobol_samples = 0"),
    (r"(?m)^points = .*$", "points = 3"),
    # Predicted depth precision is a hundred times the work of all else; `tests/tolerancing` holds it.
    (r'(?ms)^\[\[goals\]\]\nmetric = "depth_error_mm"\n.*?\n\n', ""),
    (r'(?m)^(report = \[.*), "sigma_z_mm"\]$', r"\1]"),
    (r"(?ms)^\[\[compensators\]\].*?(?=^\[|\Z)", ""),  # each build is searched for its best: so is it there
    (r'(?m)^(goals = \["\w+", "\w+"), .*$', r"\1]"),
    (r"focal_length<=20 mm", "focal_length<=9 mm"),  # one lens, either way round
    # Each is traced in each step of its search: in the middle alone.
    (r'(?m)^\[\[constraints\]\]\nquantity = "\w+"\nfield = \["1.4 mm", "1.05 mm"\]\n(?:m\w+ = .*\n)+\n', ""),
    (r'(?m)^(?:working_distance = \["28 mm", "32 mm"\]|d_3 = \["6 mm", "30 mm"\])\n', ""),
    (
        r'(?m)^(kinds = \["microlens_arrays", "sensors"\])$(?:\nwhere.sensors = .*$)?',
        r'\1\nwhere.sensors = ["pixel>=3.3 um", "pixel<=3.5 um"]\n'
        r'where.microlens_arrays = ["pitch>=60 um", "pitch<=65 um"]',
    ),
    (r'(?m)^take = "parts-\d+"', 'take = "parts-01"'),
    (r"(?m)^\[solver\]\nstarts = .*\n\n", ""),
    (r"(?m)^\[variables\]", "[solver]\nstarts = 1\nevaluations = 40\ncheck = false\n\n[variables]"),
)


def lines_of(root):
    """Commands of README, without comments."""
    found = []
    for block in blocks(root / "README.md"):
        if block.language in ("sh", "console"):
            found += [line for line in block.text.splitlines() if line.strip() and not line.startswith("#")]
    return [line.removeprefix("$ ").strip() for line in found]


@pytest.fixture
def project(root, tmp_path, monkeypatch, near_light, few_rays, found_once):
    """A copy of the project's designs and thinned studies, as the working folder."""
    for name in ("designs", "studies"):
        shutil.copytree(root / name, tmp_path / name)
    for study in (path for name in STUDIES for path in (tmp_path / "studies").rglob(name)):
        text = study.read_text()
        for pattern, thinner in THINNER:
            text = re.sub(pattern, thinner, text)
        study.write_text(text)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "120")
    thin_out(monkeypatch)
    few_waves(monkeypatch)
    without_figures(monkeypatch)
    monkeypatch.setattr(warm, "SMALL", 40)  # what is compiled does not hang on it
    at_first_sight(monkeypatch)
    monkeypatch.setattr(robust, "SHARP", robust.SHARP[:1])
    few = [case for case in hard_rows.all_cases() if case.name in ("d_1 → f", "discs near tangency")]
    monkeypatch.setattr(hard_rows, "all_cases", lambda: few)
    return tmp_path


def test_commands_run_as_printed(root, project):
    makefile = (root / "Makefile").read_text()
    ran = set()
    for line in lines_of(root):
        words = shlex.split(line, comments=True)
        if words[0] == "make":
            assert re.search(rf"(?m)^{words[1]}:", makefile), f"`{line}`: no such target"
        elif words[0] == "source":
            assert words[1] == ".venv/bin/activate"
        else:
            code, output = run(shlex.join(words), project)
            assert code == 0, f"`{line}` ends with {code}:\n{output}"
        ran.add(words[1])
    assert ran >= {"test", "bench"} | (set(COMMANDS) - set(SERVES))


def test_python_prints_what_the_comments_say(root, project):
    (text,) = [block.text for block in blocks(root / "README.md") if block.language == "python"]
    wanted = re.findall(r"(?m)^print\(.*\)\s+# (-?\d[\d.]*)$", text)
    assert wanted
    stream = io.StringIO()
    with contextlib.redirect_stdout(stream):
        exec(compile(ast.parse(text), "README.md", "exec"), {})
    for value in wanted:
        digits = len(value.partition(".")[2])
        numbers = re.findall(r"-?\d+\.\d+", stream.getvalue())
        assert any(f"{float(number):.{digits}f}" == value for number in numbers), f"{value} is not printed"
