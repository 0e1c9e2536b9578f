"""A file of another kind is called by its name, and by the command that takes it."""

from __future__ import annotations

import pytest

from roslf_design.cli import main
from roslf_design.design import DesignError, load

FILES = {
    "design": "designs/paper.toml",
    "optimize": "studies/optimize-rigid-scope/study.toml",
    "tolerance": "studies/tolerance-paper/study.toml",
    "story": "studies/story-otoscope/story.toml",
}
TOLD = {
    "design": "is a design, not {}; roslf evaluate takes it",
    "optimize": "is an optimisation study, not {}; roslf optimize takes it",
    "tolerance": "is a tolerance study, not {}; roslf tolerance takes it",
    "story": "is a story, not {}; roslf report takes it",
}
WANTED = {"evaluate": "a design", "optimize": "an optimisation study", "tolerance": "a tolerance study"}


PAIRS = [(kind, command) for kind in FILES for command in WANTED if command != {"design": "evaluate"}.get(kind, kind)]


@pytest.mark.parametrize(("kind", "command"), PAIRS)
def test_the_wrong_kind_of_file(kind, command, tmp_path, capsys):
    options = [] if command == "evaluate" else ["-o", str(tmp_path / "out")]
    assert main([command, FILES[kind], *options]) == 2
    assert capsys.readouterr().err == f"roslf: {FILES[kind]}: {TOLD[kind].format(WANTED[command])}\n"
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("command", ["evaluate", "datasheet", "report"])
def test_a_lens_file_is_called_one(command, capsys):
    lens = "roslf_design/lenses/shipped/ac060-010-a.toml"
    assert main([command, lens]) == 2
    told = 'is a lens file, neither a design nor a study; write prescription = "ac060-010-a.toml" in the [main_lens]'
    assert capsys.readouterr().err == f"roslf: {lens}: {told} of a design beside it\n"


def test_python_gets_the_error_that_load_promises():
    with pytest.raises(DesignError, match="is a tolerance study"):
        load(FILES["tolerance"])


def test_a_missing_list_of_tables_is_shown_as_one(tmp_path, capsys):
    study = tmp_path / "study.toml"
    study.write_text('name = "s"\ndesign = "paper"\ngrade = "high"\n')
    assert main(["tolerance", str(study), "-o", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert (
        "goals: a study needs at least one [[goals]] with a quantity and a limit, or a design with [required]" in said
    )
