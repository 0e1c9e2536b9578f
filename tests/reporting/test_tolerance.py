"""What a report and a terminal get to see of a study."""

import csv
import io
import math
import tomllib
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import tomli_w

from roslf_design.commands.tolerance import summary
from roslf_design.design import load, loads, save
from roslf_design.errors import InputError
from roslf_design.reporting.blocks import Figure, Table
from roslf_design.reporting.printers import render_tables
from roslf_design.reporting.tolerance.pages import (
    _nominal,
    _tolerance_section,
    _yield_statement,
    blame,
    clearance_words,
    headline,
    interval_words,
    loose_words,
    looser,
    measured_words,
    ranking,
    statements,
    tables,
    tolerance_pictures,
    tolerance_report,
)
from roslf_design.tolerancing.metrics import Question
from roslf_design.tolerancing.places import short_name
from roslf_design.tolerancing.result import WorstTrial, analyse, save_worst
from roslf_design.tolerancing.run import tally_chunk
from roslf_design.tolerancing.study import make_plan, read_study, tolerance_plan
from roslf_design.tolerancing.yields import Yield
from tests.commands.test_cli import run
from tests.evaluation.test_required import SCANNER


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


@pytest.mark.parametrize("loose", ["sensor.distance", "aperture.diameter"])
def test_what_trials_tell_before_they_are_analysed_is_what_the_analyses_tell(loose):
    goal = {"metric": "fill_factor", "min": 1.0, "max": 1.01, "fields": [0]}
    perturb = [
        {"place": p, "tolerance": "40 um" if p == loose else "1 um"} for p in ("sensor.distance", "aperture.diameter")
    ]
    study, design, grades = read_study(
        {"name": "first", "design": "paper", "trials": 2000, "perturb": perturb, "goals": [goal], "sobol_samples": 0}
    )
    plan = make_plan(study, design, grades)
    tally = tally_chunk(plan, 0)
    told, full = measured_words(plan, tally), analyse(plan, study, grades, tally, budgets=False)
    assert f"yield {100 * full.final.result.value:.2f} %" in told
    assert f"image fill at field 0 is missed by most, {100 * (1 - full.final.weakest.result.value):.4g} %" in told
    share = full.correlations[0, [p.place for p in plan.draws.perturbations].index(loose)] ** 2
    assert f"mostly by {short_name(loose, design)} ({100 * share:.3g} % of its variance)" in told


def test_what_all_builds_hold_has_no_culprit(result):
    assert measured_words(result.plan, tally_chunk(result.plan, 0)).endswith("builds; analyses follow")


def test_the_section_answers_first_and_shows_every_part(result):
    section = _tolerance_section(result, "roslf tolerance study.toml -o out")
    first, limits, _, *_ = section.blocks
    (head,) = first.items
    assert head.text.startswith(f"Yield {100 * result.final.result.value:.2f} %: ")
    assert head.text[: head.lead].endswith(" (target yield 95 %)")
    assert head.rest.startswith("95 % interval ")
    assert limits.title == "Limits"
    share = result.final.result.value
    assert head.tone == ("good" if share >= 0.95 else "caution" if share >= 0.5 else "bad")
    titles = [block.title for block in section.blocks if isinstance(block, Table)]
    assert titles[0] == "Limits"
    assert any("Sobol" in title for title in titles)
    figures = [block for block in section.blocks if isinstance(block, Figure)]
    assert any(figure.caption.endswith("of its tolerance, after adjustment.") for figure in figures)
    assert len(figures) == 5
    assert all(figure.content.startswith("<svg") and figure.caption for figure in figures)


def test_what_moves_the_weakest_metric_is_ranked(result):
    place, share = ranking(result)[0]
    assert place.startswith("microlens_array.tilt")  # d_2 is adjusted, tilts are not
    assert 0.3 < share < 1


def test_numbers_have_no_digits_that_their_spread_drowns(result):
    by_title = {table.title: table for table in tables(result)}
    spread = by_title[next(title for title in by_title if title.startswith("Distributions"))]
    for _, _, mean, deviation, *quantiles in spread.rows:
        for text in (mean, *quantiles) if float(deviation) else ():
            assert "e-" not in text
            assert len(text.partition(".")[2]) <= 2 - np.floor(np.log10(float(deviation)))
    (rss,) = (table for title, table in by_title.items() if "RSS" in title)
    assert all(float(row[1]) == 0 for row in rss.rows if row[3] == "none")


def test_an_interval_s_ends_are_told_apart():
    assert interval_words(Yield(200_000, 200_000)) == "99.998 to 100.000"
    assert interval_words(Yield(1920, 4000)) == "46.44 to 49.56"


def test_figures_have_the_same_bytes_each_time(result):
    first, second = tolerance_pictures(result), tolerance_pictures(result)
    assert {name: first[name].svg() for name in first} == {name: second[name].svg() for name in second}
    assert len(first) == 5


def test_a_nominal_that_misses_is_told_and_of_every_metric_the_weakest_field_is_brief(result):
    assert _yield_statement(result, "study").text.endswith(" (study).")
    assert [len(table.rows) for table in tables(result)] >= [len(table.rows) for table in tables(result, brief=True)]
    brief, whole = tables(result, brief=True)[1], tables(result)[1]
    assert len({row[0].partition("@")[0] for row in brief.rows}) == len(brief.rows)
    assert set(brief.rows) < set(whole.rows)


def test_grades_are_ordered_and_the_summary_is_plain_text(result):
    yields = [at_grade.value for _, at_grade in result.grades]
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


@pytest.fixture(scope="module")
def colliding(tmp_path_factory):
    """A FAP and a window whose distances' tolerances reach into each other, and what they are in each build."""
    window = {"kind": "plate", "distance": "121 mm", "thickness": "4 mm", "material": "N-BK7", "diameter": "20 mm"}
    data = {
        "name": "colliding",
        "design": "paper",
        "trials": 2000,
        "goals": [{"metric": "fill_factor", "min": 0.99, "max": 1.02}],
        "perturb": [
            {"place": "aperture.distance", "tolerance": "2 mm", "distribution": "uniform"},
            {"place": "sensor.distance", "tolerance": "10 um", "distribution": "uniform"},
        ],
    }
    study, design, grades = read_study(data)
    plan = make_plan(study, design.replace({"elements": [window]}), grades)
    tally = tally_chunk(plan, 0)
    folder = tmp_path_factory.getbasetemp() / "colliding"
    folder.mkdir()
    worst = save_worst(plan, tally, folder)
    return analyse(plan, study, grades, tally, worst, budgets=False)


def test_builds_that_cannot_be_put_together_are_told_first_and_by_what_collides(colliding):
    draws, words = colliding.plan.draws, "FAP and plate 1 collide"
    distances = draws.values(draws.deviations(draws.uniforms(0, colliding.plan.chunk)))["aperture.distance"][:2000]
    count = int((distances > 121).sum())
    assert count > 300
    share = f"{100 * count / 2000:.3g} %"
    told = f"{share} of the builds cannot be put together: {words} in {share}."
    first, limits, then = _tolerance_section(colliding).blocks[:3]
    assert first.items[0].text.startswith("Yield ")
    row = tuple(cell.replace("\N{NO-BREAK SPACE}", " ") for cell in limits.rows[0])
    assert row == (
        "can be put together",
        "",
        f"{100 - 100 * count / 2000:.2f}",
        "~ marginal",
        "d_3 (100 %)",
    )
    assert told in [item.text for item in then.items]
    assert told in " ".join(summary(colliding).split())
    assert f"no design: {words}" in summary(colliding)
    assert summary(colliding).count(" undefined in ") == 0
    d_3 = next(allowed for allowed in colliding.allowed if allowed.place == "aperture.distance")
    assert d_3.alone_limited_by == words
    assert d_3.alone == pytest.approx(1.0, rel=1e-6)
    assert colliding.to_dict()["variants"][0]["impossible"] == {"trials": count, "reasons": {words: count}}


def test_what_keeps_builds_from_being_put_together_is_blamed_first(colliding):
    assert colliding.put_together.tolist() == [1.0, 0.0]  # the window's distance has no tolerance
    assert next(iter(blame(colliding))) == "aperture.distance"
    # Also where all that the rest goes with is another's.
    others = replace(colliding, correlations=np.tile([0.0, 1.0], (len(colliding.plan.columns), 1)))
    assert (ranking(others)[0][0], next(iter(blame(others)))) == ("sensor.distance", "aperture.distance")
    lost = next(item for item in statements(colliding) if "cannot be put together" in item.text)
    assert lost.remedy.startswith("Hold d_3 first: at its nominal it alone puts together 100 % of them.")
    table = next(table for table in tables(colliding) if table.title == "Tolerances")
    assert [row[0] for row in table.rows] == ["d_3", "d_2"]


def test_a_worst_trial_that_is_no_design_has_its_numbers_in_a_file_that_says_why(colliding, tmp_path_factory):
    draws = colliding.plan.draws
    for trial in colliding.worst:
        built = draws.values(draws.deviations(draws.uniforms(0, trial.number + 1)))["aperture.distance"][-1]
        assert trial.misses["aperture.distance"] == pytest.approx((built - 120.0) / 2.0)
        text = (tmp_path_factory.getbasetemp() / "colliding" / trial.file).read_text()
        assert tomllib.loads(text)["aperture"]["distance"] == f"{built:.13g} mm"
        with pytest.raises(InputError, match=r"lies inside elements\.0"):
            loads(text)


def test_a_worst_trial_that_is_no_design_names_lengths_of_the_parts_that_collide(colliding):
    table = next(table for table in tables(colliding) if table.title == "Worst trials")
    assert [row[1][:4] for row in table.rows] == ["d_3 "] * len(table.rows)
    assert not any("d_2" in row[1] for row in table.rows)


def test_adjustments_at_assembly_are_proposed_with_range_cost_and_yield():
    """The paper's camera at a commercial grade, held to its image fill: that is d_1 and d_2's, so focusing helps."""
    data = {"name": "focus", "design": "paper", "grade": "commercial", "trials": 256, "sobol_samples": 0}
    plan, study, grades = tolerance_plan({**data, "goals": [{"metric": "fill_factor", "min": 0.99, "max": 1.02}]})
    table = next(
        table
        for table in tables(analyse(plan, study, grades, tally_chunk(plan, 0)))
        if table.title == "What an adjustment at assembly would do"
    )
    (focus,) = (row for row in table.rows if row[0].startswith("focus the sensor behind the array: d_2"))
    assert focus[0].endswith("± 0.1 mm")
    assert focus[1] == "+3.00"
    with_it, *_ = tolerance_plan(
        {
            **data,
            "goals": [{"metric": "fill_factor", "min": 0.99, "max": 1.02}],
            "compensators": [{"place": "sensor.distance", "range": "0.1 mm"}],
            "trials": 4096,
        }
    )
    own = 100 * tally_chunk(with_it, 0).passed[-1] / 4096
    assert float(focus[2]) == pytest.approx(own, abs=3.0)


def test_no_adjustment_is_offered_that_moves_a_part_into_another():
    """A sensor 0.105 mm behind its array is not focused by a tenth: half of the distance is the most."""
    design = load("paper").replace({"sensor.distance": 0.105, "microlens_array.focal_length": 0.105})
    data = {"name": "near", "design": "paper", "grade": "commercial", "trials": 256, "sobol_samples": 0}
    goals = [{"metric": "f_number_microlens", "max": 1.6667}]
    plan, study, grades = tolerance_plan({**data, "goals": goals}, design)
    budget = analyse(plan, study, grades, tally_chunk(plan, 0)).budget
    reach = {place: far for one in budget.adjustments if one.aim != "focus" for place, _, far in one.steps}
    assert reach["sensor.distance"] == pytest.approx(0.0525)
    assert reach["microlens_array.distance"] == 0.5


def test_a_number_that_a_folded_or_dark_image_has_not_says_so():
    singlet = load("paper-singlet").replace({"main_lens.reversed": False})
    question = Question(singlet, ("fill_factor",), ((11.15, 0.0), (11.15, 7.4)), 350.0)
    study = SimpleNamespace(plan=SimpleNamespace(question=question), tracing=("by rays",))
    told = [_nominal(study, SimpleNamespace(column=column, nominal=math.nan)) for column in question.columns]
    assert told == ["folded at this field", "no light at this field"]


def test_one_at_a_time_moves_are_drawn_beside_an_end_that_is_no_camera(colliding):
    (figure,) = (
        block
        for block in _tolerance_section(colliding).blocks
        if isinstance(block, Figure) and block.name == "tolerance-sensitivity"
    )
    assert len(colliding.variants) == 1
    assert "at both ends of its tolerance. No" in figure.caption  # nothing is adjusted
    assert figure.caption.endswith("No bar at an end where the build has no such number: d_3.")
    moves = colliding.sensitivity
    assert np.isnan(moves.plus[-1, 0]).tolist() == [True, False]
    up, down, *_ = tolerance_pictures(colliding)["sensitivity"].panels[0].marks
    assert len(set(up.x[~np.isnan(up.x)])) == 2  # nothing, and d_2's
    assert len(set(down.x[~np.isnan(down.x)])) == 3


def test_the_range_of_focusing_that_puts_builds_together():
    """f of 100 ± 2 mm, even, before an array at 100.5 mm: ±R leaves (1.5 - R)/4 of the builds beyond infinity."""
    data = {
        "name": "far",
        "design": "paper",
        "trials": 2000,
        "goals": [{"metric": "fill_factor", "min": 0.2, "max": 5.0}],
        "perturb": [{"place": "main_lens.focal_length", "tolerance": "2 mm", "distribution": "uniform"}],
    }
    study, design, grades = read_study(data)
    plan = make_plan(study, design.replace({"d_1": 100.5}), grades)
    result = analyse(plan, study, grades, tally_chunk(plan, 0), budgets=False)
    adjuster, share = result.focusing
    assert result.final.impossible / 2000 == pytest.approx(1.5 / 4, abs=0.03)
    assert (adjuster.place, adjuster.reach) == ("microlens_array.distance", 1.5)
    assert share > 0.99
    first = next(item for item in statements(result) if "cannot be put together" in item.text)
    assert 'place = "microlens_array.distance", range = "1.5 mm", with which' in first.remedy
    data["compensators"] = [{"place": "microlens_array.distance", "range": "1.5 mm"}]
    study, _, grades = read_study(data)
    plan = make_plan(study, design.replace({"d_1": 100.5}), grades)
    again = analyse(plan, study, grades, tally_chunk(plan, 0), budgets=False)
    assert again.final.impossible <= 0.01 * 2000
    assert again.focusing is None


def test_of_many_tolerances_a_page_shows_those_that_matter_and_the_file_has_all():
    data = {
        "name": "many",
        "design": "arthroscope",
        "grade": "high",
        "trials": 256,
        "sobol_samples": 0,
        "goals": [{"metric": "fill_factor", "min": 0.2, "max": 5.0}],
    }
    study, design, grades = read_study(data)
    plan = make_plan(study, design, grades)
    result = analyse(plan, study, grades, tally_chunk(plan, 0), budgets=False)
    count = len(plan.draws.perturbations)
    assert count > 20
    (table,) = (table for table in _tolerance_section(result).blocks if getattr(table, "title", "") == "Tolerances")
    assert len(table.rows) == 15
    assert f"of {count}; all are in tables/tolerances.csv" in table.caption
    files = render_tables(tolerance_report(result, ""))
    rows = list(csv.reader(io.StringIO(files["tables/tolerances.csv"].decode("utf-8-sig"))))[1:]
    assert len(rows) == count
    assert len({tuple(row[:1]) for row in rows}) == count
    shares = [float(row[[*table.headings].index("r² [%]")]) for row in rows]
    assert min(shares[:15]) >= max(shares[15:])


def test_where_no_build_fails_none_is_said_to():
    data = {"name": "safe", "design": "paper", "grade": "high", "trials": 64, "sobol_samples": 0}
    study, design, grades = read_study(data | {"goals": [{"metric": "fill_factor", "min": 0.5, "max": 1.5}]})
    plan = make_plan(study, design, grades)
    result = analyse(plan, study, grades, tally_chunk(plan, 0), budgets=False)
    texts = [statement.text for statement in statements(result)]
    assert any(text.startswith("Every build holds every limit; least margin is left to image fill") for text in texts)
    labels = [limit.label for limit in result.final.limits]
    for value, title, row in (
        (1.4, "Builds nearest to a limit", ("3", "d_2 +1")),
        (1.6, "Worst trials", ("3", "d_2 +1", f"{labels[0]} 1.6", "none")),
    ):
        worst = WorstTrial(3, 0.9, "", {"sensor.distance": 1.0}, dict.fromkeys(labels, 1.0) | {labels[0]: value})
        table = tables(replace(result, worst=(worst,)))[-1]
        assert (table.title, *table.rows) == (title, row)


def test_a_build_that_holds_every_limit_is_no_design_file_of_misses(tmp_path):
    data = {"name": "a", "design": "paper", "trials": 64, "perturb": [{"place": "d_2", "tolerance": "30 um"}]}
    for limit, fail in ((2.0, False), (1.00506, True)):
        study, design, grades = read_study(data | {"goals": [{"metric": "fill_factor", "max": limit}]})
        plan = make_plan(study, design, grades)
        worst = save_worst(plan, tally_chunk(plan, 0), tmp_path)
        assert {one.file for one in worst} - {""} == {path.name for path in tmp_path.iterdir()}
        assert [bool(one.file) for one in worst] == [fail] * len(worst)


def test_tolerances_over_a_tenth_of_their_lengths_are_told():
    """Of the paper's d_2 = 2 mm and d = 63 um; a decentre, an angle and the pupil's 0 mm are no lengths to compare."""
    lines = [("d_2", "0.21 mm"), ("d", "6.2 um"), ("aperture.decentre", "1 mm"), ("aperture.tilt", "9 deg")]
    data = {"name": "loose", "design": "paper", "trials": 64, "goals": [{"metric": "fill_factor", "min": 0.5}]}
    data["perturb"] = [{"place": place, "tolerance": size} for place, size in lines]
    assert loose_words(tolerance_plan(data)[0]) == "Tolerances over a tenth of their lengths: d_2 = 2 mm ± 0.21 mm."
    data["perturb"][0]["tolerance"] = "0.19 mm"
    assert loose_words(tolerance_plan(data)[0]) == ""


def test_clearances_that_a_tolerance_takes_over_half_of_are_told_before_and_after_a_run(tmp_path, capsys):
    """A window .15 mm before the FAP, both of which may miss by .1 mm; from .3 mm on nothing is said."""
    window = {"kind": "plate", "distance": 1.0, "thickness": 0.5, "material": "N-BK7", "diameter": 4.0}
    goal = {"metric": "fill_factor", "min": 0.1}
    misses = [{"place": place, "tolerance": "0.1 mm"} for place in ("d_3", "elements.0.distance")]
    data = {"name": "gap", "design": "scope.toml", "trials": 64, "sobol_samples": 0, "goals": [goal], "perturb": misses}
    for gap, tight in ((0.15, True), (0.3, False)):
        scope = load("rigid-scope").replace({"elements": [window], "d_3": 1.0 - gap})
        told = clearance_words(tolerance_plan(data, scope)[0])
        assert bool(told) == tight
        if tight:
            assert told.startswith(
                "Tolerances over half of what the design leaves: FAP and plate 1 collide once d_3 is off by 0.15 mm "
                "(± 0.1 mm) or plate 1 distance is off by 0.15 mm (± 0.1 mm), which no tolerance reaches alone. "
                "Builds that far off could not be put together and would count as failed"
            )
            assert told in loose_words(tolerance_plan(data, scope)[0])
            save(scope, tmp_path / "scope.toml")
            (tmp_path / "study.toml").write_text(tomli_w.dumps(data))
            code, _, err = run(capsys, "tolerance", tmp_path / "study.toml", "-o", tmp_path / "out")
            assert code == 0
            assert f"roslf: {told}\n" in err  # no grade is to blame
            page = (tmp_path / "out" / "index.html").read_text()
            assert str(tmp_path / "out") in page.partition("roslf tolerance ")[2].partition("<")[0]  # "Run again"


def two_plates(gap, *perturb, **more):
    """What is said beforehand of two plates so far apart on their barrel."""
    plate = {"kind": "plate", "distance": 1.0, "thickness": 0.5, "material": "N-BK7", "diameter": 4.0}
    scope = load("rigid-scope").replace({"elements": [plate, {**plate, "distance": 1.5 + gap}], "d_3": 0.0})
    data = {"name": "gap", "design": "x", "trials": 64, "goals": [{"metric": "fill_factor", "min": 0.1}]}
    return clearance_words(tolerance_plan(data | {"perturb": perturb} | more, scope)[0])


def test_clearances_are_told_of_groups_as_their_members_are_off_together():
    """On one barrel plates stay apart; against each other both take of the gap; alike in part each may do it alone."""
    first, second = "elements.0.distance", "elements.1.distance"
    both = {"place": [first, second], "tolerance": "0.1 mm", "group": "barrel"}
    assert two_plates(0.1, both) == ""
    alike = two_plates(0.1, both, groups=[{"name": "barrel", "correlation": 0.5}])
    assert "plate 1 and plate 2 collide once plate 1 distance is off by 0.1 mm (± 0.1 mm) or plate 2" in alike
    opposed = [
        {"place": first, "tolerance": "0.04 mm", "group": "b"},
        {"place": second, "tolerance": "0.04 mm", "group": "b", "opposed": True},
    ]
    assert "collide once group b is off by 125 % of its tolerances, which no tolerance reaches alone" in two_plates(
        0.1, *opposed
    )


def test_a_focus_that_an_adjuster_brings_back_is_not_told_as_lost():
    """A tolerance that takes the focus beyond infinity was called too wide of builds that are focused."""
    scope, place, tolerance = load("cystoscope"), "elements.0.focal_length", 0.01
    data = {"name": "focus", "design": "x", "trials": 64, "goals": [{"metric": "fill_factor", "min": 0.1}]}
    data |= {"perturb": [{"place": place, "tolerance": f"{100 * tolerance} %"}]}
    assert "in focus beyond infinity once lens 1 focal length" in clearance_words(tolerance_plan(data, scope)[0])
    nominal = scope.elements[0].focal_length
    off = {sign * 2 * tolerance: (1 + sign * 2 * tolerance) * nominal for sign in (-1, 1)}
    known = [scope.replace({place: f, "d_f": scope.d_f}).d_1 - scope.d_1 for f in off.values()]  # where it is in focus
    for reach, told in ((2 * max(map(abs, known)), False), (1e-6, True)):
        for aim in ("limits", "focus"):
            line = {"place": "microlens_array.distance", "aim": aim, "range": f"{reach} mm"}
            assert (
                "beyond infinity" in clearance_words(tolerance_plan(data | {"compensators": [line]}, scope)[0])
            ) == told


def test_parts_that_touch_are_told_as_such():
    """They were told to collide "once off by 0.000745 nm", where a search by halves ended."""
    said = two_plates(0.0, {"place": "elements.0.distance", "tolerance": "0.1 mm"})
    assert "collide once plate 1 distance is off at all, for they touch. Builds" in said


def test_a_grade_is_blamed_for_loose_lengths_where_one_is_given():
    data = {"name": "a", "design": "paper", "trials": 64, "goals": [{"metric": "fill_factor", "min": 0.5}]}
    own = [{"place": "d_2", "tolerance": "0.21 mm"}]
    assert looser(tolerance_plan(data | {"perturb": own})[0]) == ""
    assert looser(tolerance_plan(data | {"grade": "commercial"})[0]).startswith("A grade knows no sizes")


def analysed(data, required=(), budgets=False):
    """A study of the paper's camera, analysed."""
    study, design, grades = read_study({"name": "head", "design": "paper", "sobol_samples": 0, **data})
    plan = make_plan(study, design.replace({"required": required}) if required else design, grades)
    return analyse(plan, study, grades, tally_chunk(plan, 0), budgets=budgets)


MISSES = [{"place": "d_2", "tolerance": "30 um"}, {"place": "f", "tolerance": "1 %"}]
FAR = [{"place": "d_2", "tolerance": "1 mm"}]


@pytest.mark.parametrize(
    ("goal", "misses", "budgets", "kind", "said"),
    [
        # At the edge of its limit half of all builds miss it, however little they miss; focused, none does.
        ({"max": 1.00506}, MISSES, True, "adjustment", "No single tolerance reaches it, however tight."),
        ({"max": 1.00506}, MISSES, False, None, "were not tried: `roslf tolerance`"),
        # Farther off than any adjustment reaches.
        ({"max": 1.00506}, FAR, True, None, "nor does one alone or an adjustment at assembly: change"),
        # One length is all that misses: it alone, to a grade or less, is enough.
        ({"min": 0.999, "max": 1.01}, MISSES[:1], True, "tightening", "Cheapest: d_2 to ± "),
        ({"min": 0.999, "max": 1.01}, MISSES[:1], False, None, "Tighten all tolerances to 0."),
    ],
)
def test_the_remedy_is_true_of_what_was_tried(goal, misses, budgets, kind, said):
    goals = [{"metric": "fill_factor", **goal}]
    result = analysed({"trials": 600, "goals": goals, "perturb": misses}, budgets=budgets)
    statement = _yield_statement(result)
    assert statement.tone == ("caution" if result.final.result.value >= 0.5 else "bad")
    assert said in statement.remedy
    assert statement.remedy in " ".join(summary(result).split())
    assert ("lies at its limits on image fill" in statement.remedy) == ("max" in goal and "min" not in goal)
    missed = 100 * np.mean(tally_chunk(result.plan, 0).measured[:, -1, 0] > goal["max"])
    assert (f"({missed:.2f} % miss it)" in statement.remedy) == ("min" not in goal)
    assert ("tolerances, however tight, do" in statement.remedy) == (
        "min" not in goal and result.scale_for_target is None
    )
    if kind is None:
        assert result.budget is None or not result.budget.changes
        return
    best = result.budget.changes[0]
    assert best.kind == kind
    assert best.result.interval[0] >= 0.95
    singles = [change for change in result.budget.changes if change.kind in ("grade", "tightening")]
    assert bool(singles) == ("No single tolerance" not in statement.remedy)


def test_a_calibration_that_helps_no_limit_is_said_to_help_none():
    goals = [{"metric": "fill_factor", "min": 0.999, "max": 1.01}]
    data = {"trials": 64, "goals": goals, "perturb": MISSES[:1]}
    words = "calibration moves none of these limits"
    assert words in summary(analysed(data | {"compensators": [{"place": "calibration"}]}))
    assert words not in summary(analysed(data))


def focused_at(result):
    """Working distance of each build of the paper's camera whose array alone is misplaced, by the lens equation."""
    plan = result.plan
    d_1 = 140 + 0.5 * plan.draws.deviations(plan.draws.uniforms(0, plan.chunk, 0, plan.trials))[0]
    return 1 / (1 / 100 - 1 / d_1) - 350 + 230


FAR_OFF = [{"place": "microlens_array.distance", "tolerance": "0.5 mm", "distribution": "uniform"}]


def test_what_the_study_limits_otherwise_than_the_design_has_a_row_for_each():
    """Figures of one quantity: of builds as required, by the study's own limit, and of a depth uncalibrated."""
    data = {
        "trials": 600,
        "goals": [{"quantity": "working_distance_mm", "min": 229}, {"quantity": "u_z_mm", "at": "230 mm", "max": 40}],
        "perturb": FAR_OFF,
    }
    depth = {"at": "230 mm", "max": "1 mm"}
    result = analysed(data, {"working_distance_mm": {"min": "229.5 mm"}, "u_z_mm": depth, "q": {"max": "1 mm"}})
    met, held = (np.mean(focused_at(result) >= least) for least in (229.5, 229.0))
    assert result.together.value == met
    table = tables(result)[0]
    assert table.headings == ("limit", "required", "as built [%]", "verdict", "culprit")
    rows = {row[:2]: row[2:] for row in table.rows}
    assert rows["working distance", "at least 229.5 mm"][0] == f"{100 * met:.2f}"
    assert rows["working distance", "at least 229.5 mm"][2] in (
        "d_1 (99\N{NO-BREAK SPACE}%)",
        "d_1 (100\N{NO-BREAK SPACE}%)",
    )
    assert rows["working distance", "at least 229 mm"][0] == f"{100 * held:.2f}"
    share, verdict, _ = rows["depth, expected, u_Z at 230 mm", "at most 1 mm"]
    assert (share, verdict[:10], verdict[-12:]) == ("", "✗ missed: ", "uncalibrated")
    assert rows["depth, expected, u_Z at 230 mm, lengths known", "at most 40 mm"][0] == "100.00"
    assert rows["everything together", ""][0] == f"{100 * met:.2f}"
    assert table.rows[0][0].startswith("depth")  # what is missed stands first
    assert [row[0] for row in table.rows[-2:]] == ["the study's limits together", "everything together"]
    same = tables(analysed(data, {"working_distance_mm": {"min": "229 mm"}}))[0]
    assert [row[0] for row in same.rows].count("working distance") == 1


@pytest.mark.parametrize(
    ("half", "outcome", "tone"), [(0.5, "missed", "bad"), (2.5, "marginal", "caution"), (9.0, "met", "good")]
)
def test_the_head_is_the_yield_of_everything_required_and_its_outcome(half, outcome, tone):
    """By the lens equation: of builds whose array is misplaced few have their focal plane where it is required."""
    goals = [{"metric": "fill_factor", "min": 0.5, "max": 2.0}]
    ends = {"min": f"{230 - half} mm", "max": f"{230 + half} mm"}
    result = analysed({"trials": 600, "goals": goals, "perturb": FAR_OFF}, {"working_distance_mm": ends})
    near = np.mean(abs(focused_at(result) - 230) <= half)
    assert result.final.result.value == 1.0
    assert result.together == Yield(round(600 * near), 600)
    assert result.to_dict()["yield_required"]["yield"] == near
    statement = _yield_statement(result)
    assert statement.tone == tone
    assert statement.text[: statement.lead] == f"Yield {100 * near:.2f} %: {outcome} (target yield 95 %)"
    own = "by everything required; by the study's own limits 100.00 % of 600"  # told where it is another
    assert (own in statement.rest) == (near < 1)
    assert ("`required = true` in the study" in statement.remedy) == (outcome != "met")
    assert summary(result).splitlines()[1].startswith(f"Yield {100 * near:.2f} %")
    short = [row["share"] for row in result.to_dict()["required_short_of"]]
    assert short == ([] if outcome == "met" else [near])


def test_what_the_nominal_design_misses_no_build_meets():
    data = {"trials": 600, "goals": [{"metric": "fill_factor", "min": 0.5}], "perturb": FAR_OFF}
    result = analysed(data, {"q": {"max": "1 um"}})
    assert result.together.value == 0.0
    assert [row["share"] for row in result.to_dict()["required_short_of"]] == [0.0]
    assert analysed(data).together == analysed(data).final.result


def test_a_depth_that_builds_miss_uncalibrated_is_told_apart_from_the_yield():
    """The same limit as a study's goal takes each build's lengths as known: its yield was a tick beside the miss."""
    limit = {"max": "0.3 mm"}
    goals = [{"metric": "u_z_mm", **limit}]
    result = analysed(
        {"trials": 300, "goals": goals, "perturb": [FAR_OFF[0] | {"distribution": "normal"}]}, {"u_z_mm": limit}
    )
    assert result.final.result.value == 1.0
    assert [row["share"] for row in result.to_dict()["required_short_of"]] == [0.0]
    statement = _yield_statement(result)
    assert statement.tone == "caution"
    (one,) = result.required
    missed = f", and depth, expected, u_Z is missed: {one.value_words} against at most 0.3 mm. 95 % interval"
    assert missed in headline(result)
    assert (
        " Not in it, as builds do not tell it: depth, expected, u_Z. Missed by a camera that nobody" in statement.text
    )
    assert "calibrated one believe its verdict with lengths as calibrated." in statement.text
    assert "depth, expected, u_Z, lengths known" in " ".join(summary(result).split())
    files = render_tables(tolerance_report(result, ""))
    assert "lengths known" in files["tables/limits.csv"].decode("utf-8-sig")


def test_a_depth_that_no_formula_tells_is_no_pass_and_no_miss():
    """Behind a fast achromat, whose aberrations set views astray."""
    scanner = loads(SCANNER).replace({"required": {"expanded_u_z_mm": {"max": 0.5}}})
    goals = [{"metric": "fill_factor", "min": 0.5, "max": 2.0}]
    data = {"name": "head", "design": "paper", "trials": 64, "goals": goals, "sobol_samples": 0}
    study, _, grades = read_study({**data, "perturb": [{"place": "microlens_array.distance", "tolerance": "1 um"}]})
    plan = make_plan(study, scanner, grades)
    result = analyse(plan, study, grades, tally_chunk(plan, 0), budgets=False)
    (one,) = result.required
    assert one.untold
    assert "U is not known. 95 % interval" in headline(result)
    assert _yield_statement(result).tone == "caution"
    (row,) = (row for row in tables(result)[0].rows if row[0] == one.label)
    assert row[-2].startswith("~ not known: ")


def test_the_field_shown_of_a_metric_is_the_one_whose_room_scatter_uses_most_of():
    """Of fields that all builds hold it was the one that scatters most, though another has less room for its own."""
    data = {
        "trials": 300,
        "fields": [["0 mm", "0 mm"], ["9 mm", "0 mm"]],
        "goals": [{"metric": "non_distortion_room_mm", "min": 0.0}],
        "perturb": [{"place": "aperture.decentre.0", "tolerance": "0.2 mm"}, {"place": "d_2", "tolerance": "5 um"}],
    }
    result = analysed(data)
    assert result.final.result.value == 1.0
    room = {c.label: c.nominal / (c.high - c.low) for c in result.final.distributions}
    brief = tables(result, brief=True)[0]
    weakest = min(room, key=lambda label: room[label]).partition("@")[2]
    assert [row[0] for row in brief.rows[:-1]] == [f"undistorted-field clearance at field {weakest}"]


def test_no_tolerance_is_told_that_makes_another_camera():
    data = {
        "trials": 100,
        "goals": [{"metric": "fill_factor", "min": 0.99, "max": 1.02}],
        "perturb": [
            {"place": "microlens_array.focal_length", "tolerance": "10 um"},
            {"place": "microlens_array.rotation", "tolerance": "1 mrad"},
            {"place": "sensor.distance", "tolerance": "10 um"},
        ],
    }
    result = analysed(data)
    table = next(table for table in tables(result) if table.title == "Tolerances")
    alone, fails = (table.headings.index(heading) for heading in ("alone up to", "until it fails"))
    rows = {row[0]: (row[alone], row[fails]) for row in table.rows}
    assert rows["f_ml"] == ("over 0.2 mm", "no limit within ± 0.2 mm")  # where it is 2 mm
    assert rows["MLA rotation"] == ("over 100 mrad", "no limit within ± 100 mrad")
    d_2 = next(one for one in result.allowed if one.place == "sensor.distance")
    assert 0 < d_2.alone < 0.2
    assert d_2.alone_limited_by.startswith("fill_factor")
    assert all(math.isinf(one.alone) and math.isinf(one.tolerance) for one in result.allowed if one is not d_2)
