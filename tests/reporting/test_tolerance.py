"""What a report and a terminal get to see of a study."""

import pytest

from roslf_design.commands.tolerance import summary
from roslf_design.reporting.blocks import Figure, Statements, Table
from roslf_design.reporting.tolerance import ranking, tables, tolerance_pictures, tolerance_section, yield_statement
from roslf_design.tolerancing.result import analyse
from roslf_design.tolerancing.run import tally_chunk
from roslf_design.tolerancing.study import make_plan, read_study


@pytest.fixture(scope="module")
def result():
    data = {
        "name": "section",
        "design": "paper",
        "grade": "precision",
        "trials": 1000,
        "goals": [{"metric": "fill_factor", "min": 0.99, "max": 1.02}],
        "report": ["depth_error_mm"],
        "compensators": [{"place": "sensor.distance"}],
        "sobol_samples": 64,
    }
    study, design, grades = read_study(data)
    plan = make_plan(study, design, grades)
    return analyse(plan, study, grades, tally_chunk(plan, 0))


def test_the_section_answers_first_and_shows_every_part(result):
    section = tolerance_section(result, "roslf tolerance study.toml -o out")
    statements = next(block for block in section.blocks if isinstance(block, Statements))
    assert f"Yield {100 * result.final.result.value:.2f} %" in statements.items[0].text
    assert statements.items[0].tone == ("good" if result.final.result.value >= 0.95 else "bad")
    titles = [block.title for block in section.blocks if isinstance(block, Table)]
    assert titles[0] == "Limits"
    assert any("Sobol" in title for title in titles)
    figures = [block for block in section.blocks if isinstance(block, Figure)]
    assert len(figures) == 5
    assert all(figure.content.startswith("<svg") and figure.caption for figure in figures)


def test_what_moves_the_weakest_metric_is_ranked(result):
    place, share = ranking(result)[0]
    assert place.startswith("microlens_array.tilt")  # d_2 is adjusted, tilts are not
    assert 0.3 < share < 1


def test_figures_have_the_same_bytes_each_time(result):
    first, second = tolerance_pictures(result), tolerance_pictures(result)
    assert {name: first[name].svg() for name in first} == {name: second[name].svg() for name in second}
    assert len(first) == 5


def test_a_nominal_that_misses_is_told_and_of_every_metric_the_weakest_field_is_brief(result):
    assert yield_statement(result, "study").text.endswith("wanted 95 % (study).")
    assert [len(table.rows) for table in tables(result)] >= [len(table.rows) for table in tables(result, brief=True)]
    brief, whole = tables(result, brief=True)[1], tables(result)[1]
    assert len({row[0].partition("@")[0] for row in brief.rows}) == len(brief.rows)
    assert set(brief.rows) < set(whole.rows)


def test_grades_are_ordered_and_the_summary_is_plain_text(result):
    yields = [grade.result.value for grade in result.grades]
    assert yields == sorted(yields)
    text = summary(result)
    assert "\x1b" not in text
    assert max(map(len, text.splitlines())) <= 1000
    assert "fill_factor" in text
    assert "Tolerances" in text


def test_one_at_a_time_moves_shrink_after_adjustment(result):
    moves = result.sensitivity.worst
    d_2 = [p.place for p in result.plan.draws.perturbations].index("sensor.distance")
    assert moves[-1, 0, d_2] < 1e-6 < moves[0, 0, d_2]
