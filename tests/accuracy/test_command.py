"""`roslf accuracy` as a user calls it."""

import json
import sys

import pytest

from roslf_design.accuracy.table import QUANTITIES, _read_table, shipped_table
from roslf_design.cli import main
from studies.accuracy import hard_rows, promises
from tests.docs.described import undescribed


def test_hard_cases_prints_json_that_repeats_itself(capsys, monkeypatch):
    few = [case for case in hard_rows.all_cases() if case.name in ("d_1 → f", "discs near tangency")]
    monkeypatch.setattr(hard_rows, "all_cases", lambda: few)
    texts = []
    for _ in range(2):
        assert main(["accuracy", "hard-cases", "paper", "--json"]) == 0
        texts.append(capsys.readouterr().out)
    assert texts[0] == texts[1]
    data = json.loads(texts[0])
    assert data["held"]
    assert not undescribed(data)
    assert [case["name"] for case in data["cases"]] == ["d_1 → f", "discs near tangency"]


def test_diagram_of_one_quantity_at_a_field(tmp_path, capsys):
    folder = tmp_path / "out"
    line = ["accuracy", "paper", "--quantity", "depth", "--field", "11.15", "--accuracy", "1e-4", "-o", str(folder)]
    assert main(line) == 0
    assert "closed form" in capsys.readouterr().out
    data = json.loads((folder / "accuracy.json").read_text())
    assert not undescribed(data)
    assert {point["method"] for point in data["diagrams"][0]["points"]} >= {"closed form", "Monte Carlo", "first order"}
    assert data["choices"][0]["expected_error"] <= 1e-4
    page = (folder / "index.html").read_text()
    assert "chosen" in page
    assert "closed form" in page


def test_scene_of_a_users_own(tmp_path, capsys, monkeypatch, near_light):
    monkeypatch.setattr(promises, "SCENE_RAYS", (64, 256, 1024))
    monkeypatch.setattr(promises, "REFERENCE_RAYS", 4096)
    monkeypatch.setattr(promises, "PATCH", 12)
    scene = tmp_path / "scene.toml"
    scene.write_text(
        'name = "grating"\n[[objects]]\nkind = "plane"\ndistance = "300 mm"\n'
        '[objects.texture]\nkind = "sinusoid"\nperiod = "4 mm"\n'
    )
    assert main(["accuracy", "paper", "--scene", str(scene), "--accuracy", "0.05"]) == 0
    told = capsys.readouterr().out
    assert "rays a pixel for 0.05" in told


@pytest.mark.parametrize(
    ("line", "says"),
    [
        (["paper", "--accuracy", "0"], "--accuracy"),
        (["paper", "--quantity", "brightness"], "kept fraction"),
        (["paper", "--jobs", "-1"], "--jobs"),
        (["paper", "--jobs", "100000000"], "whole number from 0 to 10000"),
        (["paper", "--field", "far"], "--field"),
        (["paper", "--quantity", "real lens", "--field", "0"], "real lens of the design's own"),
        (["arthroscope"], "cameras in air only"),
        (["arthroscope", "--quantity", "area"], "cameras in air only"),
        (["calibrate", "arthroscope", "-o", "table.json"], "cameras in air only"),
        (["nowhere.toml"], "nowhere.toml"),
        (["hard-cases", "paper", "--seed", "-1"], "--seed"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(line, says, capsys):
    assert main(["accuracy", *line]) == 2
    told = capsys.readouterr()
    assert says in told.err
    assert "Traceback" not in told.err
    assert told.out == ""


def test_calibrate_writes_where_it_is_told(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(promises, "calibrate", lambda *_, **__: shipped_table())  # which `test_choice` measures
    path = tmp_path / "deep" / "table.json"
    assert main(["accuracy", "calibrate", "-o", str(path)]) == 0
    assert _read_table(path).of("depth")
    assert str(path) in capsys.readouterr().out


def test_diffraction_of_round_microlenses_is_refused_by_name_and_file(root, tmp_path, capsys):
    path = tmp_path / "round.toml"
    paper = (root / "designs" / "paper.toml").read_text()
    path.write_text(paper.replace('lens_shape = "square"', 'lens_shape = "circular"'))
    assert main(["accuracy", str(path), "--quantity", "diffraction image"]) == 2
    told = capsys.readouterr()
    assert "circular microlenses" in told.err
    assert str(path) in told.err
    assert "--quantity" in told.err
    assert told.out == ""


def test_a_field_of_an_ideal_camera_leaves_the_real_lens_out_and_says_so(capsys, monkeypatch):
    """Of every method the first level, in place of those that are quick; which diagrams there are counts alone."""

    def first_alone(method, job, level, repeats):
        return (0.0, 0.0, 0.0) if level == method.levels[0] else (2 * promises.SLOWEST,) * 3

    def coarse(job):
        """In place of references to thirty digits."""
        first = promises.methods(job.quantity)[0]
        return first.compute(job, first.levels[0], 0)

    monkeypatch.setattr(promises, "timed", first_alone)
    monkeypatch.setattr(promises, "reference", coarse)
    assert main(["accuracy", "paper", "--field", "0", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert [line.split()[0:2] for line in data["left_out"]] == [["Real", "lens"]]
    assert {diagram["quantity"] for diagram in data["diagrams"]} == set(QUANTITIES) - {"real lens"}


def test_help_shows_an_example(capsys):
    assert main(["accuracy", "--help"]) == 0
    assert "Example" in capsys.readouterr().out


def test_without_mpmath_a_line_says_what_to_install(monkeypatch, capsys):
    for name in [name for name in sys.modules if name.split(".")[0] == "mpmath" or name.startswith("studies.accuracy")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "mpmath", None)
    for line in (["accuracy", "hard-cases", "paper"], ["accuracy", "paper"]):
        assert main(line) == 2
        told = capsys.readouterr().err
        assert "pip install mpmath" in told
        assert len(told.strip().splitlines()) == 1
