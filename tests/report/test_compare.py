"""Designs side by side: what differs is marked, what does not is not."""

import pytest

from roslf_design.cli import main
from roslf_design.design import load
from roslf_design.report.blocks import Figure, Table
from roslf_design.report.compare import comparison_report
from roslf_design.report.html import render_html


@pytest.fixture(scope="module")
def pair():
    return comparison_report([load("paper"), load("paper-mismatched")], command="roslf report --compare a b")


def rows(report):
    (section,) = (section for section in report.sections if section.title == "What differs")
    return {(table.title, row[1]): row for table in section.blocks if isinstance(table, Table) for row in table.rows}


def test_differences_are_marked(pair):
    found = rows(pair)
    assert found["Parameters", "FAP in front of the lens, d_3"] == (
        "≠",
        "FAP in front of the lens, d_3",
        "120 mm",
        "20 mm",
    )
    assert found["f-number", "fill factor"][0] == "≠"
    assert found["Parameters", "microlens pitch, d"][0] == ""
    marked = [row for row in found.values() if row[0]]
    assert all(len(set(row[2:])) > 1 for row in marked)
    assert all(len(set(row[2:])) == 1 for row in found.values() if not row[0])


@pytest.mark.parametrize("order", [("paper", "paper-singlet"), ("paper-singlet", "paper")])
def test_a_real_lens_beside_an_ideal_one(order):
    found = rows(comparison_report([load(name) for name in order]))
    lens = found["Parameters", "main lens"]
    assert (lens[0], set(lens[2:])) == ("≠", {"ideal", "LA1050-A reversed"})
    traced = [row for (title, _), row in found.items() if title.startswith("Real main lens")]
    assert len(traced) == 5
    assert all("-" in row[2:] and row[0] for row in traced)


def test_stops_misalignments_and_effects_are_compared_one_by_one():
    paper = load("paper")
    one = paper.replace({"stops": [{"diameter": 10.0, "distance": 60.0}]})
    other = paper.replace({"stops": [{"diameter": 11.0, "distance": 60.0}], "sensor.decentre": (0.1, 0.0)})
    found = rows(comparison_report([one, other, paper]))
    assert found["Parameters", "stop 1"] == ("≠", "stop 1", "10 mm at 60 mm", "11 mm at 60 mm", "-")
    assert found["Parameters", "misalignments"][2:] == ("none", "sensor 0.1 mm, 0 mm", "none")
    effects = {name: row for (title, name), row in found.items() if title.startswith("Effects")}
    assert effects["microlens diffraction"][0] == ""
    assert effects["decentres"][0] == "≠"


def test_a_design_is_like_itself():
    assert not any(row[0] for row in rows(comparison_report([load("pipe-bore")] * 2)).values())


def test_three_designs_of_different_scale_and_stops_fit():
    from tests.report.test_figures import DESIGNS

    report = comparison_report([load("rigid-scope"), DESIGNS["strange"], DESIGNS["vignetted"]])
    names = [block.name for section in report.sections for block in section.blocks if isinstance(block, Figure)]
    assert names == ["rays-A", "rays-B", "rays-C", "images", "depth"]
    assert "https:" not in render_html(report)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["paper", "pipe-bore"], "add --compare"),
        (["--compare", "paper"], "two or three"),
        (["--compare", "paper", "paper", "paper", "paper"], "two or three"),
    ],
)
def test_wrong_numbers_of_designs(tmp_path, capsys, arguments, complaint):
    assert main(["report", *arguments, "-o", str(tmp_path / "out")]) == 2
    assert complaint in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_core_refuses_as_well():
    with pytest.raises(ValueError, match="two or three"):
        comparison_report([load("paper")])
