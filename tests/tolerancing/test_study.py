"""Study files and grades: read, resolved, and every fault told at once."""

import json
import math
import re

import numpy as np
import pytest

from roslf_design.camera import Camera
from roslf_design.cli import main
from roslf_design.design import dumps, load, preset_names, preset_path
from roslf_design.errors import InputError
from roslf_design.evaluation.field_images import FieldImages, ObjectField
from roslf_design.evaluation.required import required_of
from roslf_design.optimization import Constraint
from roslf_design.reporting.story import _builds_alone
from roslf_design.theory.depth_budget import depth_budget
from roslf_design.theory.focused import is_focused
from roslf_design.theory.quantities import QUANTITIES
from roslf_design.theory.stop_images import MicrolensImages
from roslf_design.tolerancing.metrics import METRICS, design_built, evaluate_builds
from roslf_design.tolerancing.places import (
    SHIPPED,
    display,
    expand,
    load_grades,
    nominal_values,
    parse_tolerance,
    perturbable,
    short_name,
)
from roslf_design.tolerancing.result import _beside_range, _share_that_meets_all, _within_reach
from roslf_design.tolerancing.sensitivities import inverse_sensitivity, sensitivity
from roslf_design.tolerancing.study import MetricGoal, load_plan, plan_from, tolerance_plan
from roslf_design.tolerancing.trials import first_builds

GOOD = {"name": "s", "design": "paper", "grade": "high", "goals": [{"metric": "fill_factor", "min": 0.9}]}


def faults(data):
    with pytest.raises(InputError) as caught:
        plan_from(data)
    return {problem.key: problem.message for problem in caught.value.problems}


def test_a_grade_covers_the_design_and_a_line_overrides_it():
    line = {"place": ["d_3", "aperture.tilt"], "distribution": "uniform"}
    plan = plan_from({**GOOD, "perturb": [line, {"place": "f", "tolerance": "3 %"}], "exclude": ["main_lens.tilt"]})
    found = {p.place: p for p in plan.draws.perturbations}
    assert found["main_lens.focal_length"].tolerance == pytest.approx(3.0)
    assert found["aperture.distance"].tolerance == 0.05
    assert found["aperture.distance"].distribution == found["aperture.tilt.1"].distribution == "uniform"
    assert found["microlens_array.pitch"].tolerance == pytest.approx(0.063 * 5e-5)
    assert found["microlens_array.rotation"].tolerance == pytest.approx(2e-4)
    assert "main_lens.tilt.0" not in found
    assert "engineering judgement" in found["aperture.diameter"].source
    assert "sensor.relay_magnification" not in found  # the paper's camera has no relay


def test_the_shipped_grades_hold_the_agreed_figures():
    grades, design = load_grades(), load("paper").replace({"sensor.relay_magnification": 2.0})
    assert grades.names == ("commercial", "precision", "high")
    expected = {
        "main_lens.focal_length": (2.0, 1.0, 0.5),
        "microlens_array.distance": (0.2, 0.05, 0.02),
        "sensor.distance": (0.05, 0.02, 0.005),
        "aperture.distance": (0.5, 0.2, 0.05),
        "aperture.diameter": (0.1, 0.05, 0.02),
        "aperture.decentre.0": (0.1, 0.05, 0.02),
        "main_lens.decentre.1": (0.1, 0.05, 0.02),
        "main_lens.tilt.0": (0.010, 0.003, 0.001),
        "microlens_array.tilt.0": (0.003, 0.001, 0.0002),
        "microlens_array.rotation": (0.003, 0.001, 0.0002),
        "microlens_array.pitch": (6.3e-5, 1.26e-5, 3.15e-6),
        "microlens_array.focal_length": (0.1, 0.06, 0.02),
        "sensor.relay_magnification": (0.02, 0.006, 0.002),
    }
    for place, widths in expected.items():
        assert [grades.tolerances(name, design)[place] for name in grades.names] == pytest.approx(widths)
    assert all(line.provenance for line in grades.lines)


def test_grades_of_further_stops_follow_the_design():
    design = load("paper").replace({"stops": [{"diameter": 9.0, "distance": 60.0}]})
    assert load_grades().tolerances("high", design)["stops.0.diameter"] == 0.02


def test_every_fault_is_told_at_once_with_the_nearest_name():
    found = faults(
        {
            "name": "x",
            "design": "paper",
            "grad": "high",
            "goals": [{"metric": "fill_facter", "min": 1}, {"metric": "sigma_z_mm"}],
            "perturb": [
                {"place": "aperture.tlt", "tolerance": "1 mrad"},
                {"place": "d_3", "tolerance": "1 mrad", "opposed": "no"},
            ],
            "required": "yes",
            "fields": [[1, 2], "rim"],
            "compensators": [{"place": "sensor.distanc"}],
            "trials": -5,
        }
    )
    assert "did you mean 'grade'" in found["grad"]
    assert "did you mean 'fill_factor'" in found["goals.0.metric"]
    assert "give min, max or both" in found["goals.1"]
    assert "did you mean 'aperture.tilt'" in found["perturb.0.place"]
    assert "this is a length" in found["perturb.1.tolerance"]
    assert "true or false, got 'no'" in found["perturb.1.opposed"]
    assert "true or false, got 'yes'" in found["required"]
    assert 'e.g. "1 mm"' in found["fields.0"]
    assert "centre, edge, corner" in found["fields.1"]
    assert "did you mean 'sensor.distance'" in found["compensators.0.place"]
    assert "trials" in found
    assert len(found) == 11


@pytest.mark.parametrize(
    ("change", "key", "words"),
    [
        ({"grade": "fine"}, "grade", "commercial, precision, high"),
        ({"design": "papr"}, "design", "no such file"),
        ({"goals": []}, "goals", "at least one"),
        ({"fields": []}, "fields", "at least one field"),
        ({"object_distance": "100 mm"}, "object_distance", "within the bore"),
        ({"grade": None}, "perturb", "nothing is perturbed"),
        ({"goals": [{"metric": "fill_factor", "min": 2, "max": 1}]}, "goals.0", "swap"),
        ({"goals": [{"metric": "fill_factor", "min": 1, "fields": [7]}]}, "goals.0.fields", "run from 0 to 2"),
        ({"goals": [{"metric": "mismatch_px", "quantity": "mismatch_px", "min": 1}]}, "goals.0.metric", "is called"),
        ({"goals": [{"quantity": "fill_factor", "min": 1, "field": "rim"}]}, "goals.0.field", "a length along x"),
        ({"goals": [{"quantity": "light_sr", "min": 1, "field": "0 mm"}]}, "goals.0", "one number for the whole field"),
        ({"goals": [{"quantity": "light_sr", "min": 1, "fields": ["edge"]}]}, "goals.0", "drop field or fields"),
        ({"goals": [{"quantity": "fill_factor", "min": 1, "fields": []}]}, "goals.0.fields", "at least 1 item"),
        ({"goals": [{"quantity": "fill_factor", "min": 1, "field": "11.4 mm"}]}, "goals.0", "-11.2 to 11.2 mm across"),
        ({"fields": ["edge", ["0 mm", "-7.6 mm"]]}, "fields.1", "-7.499 to 7.499 mm up"),
        ({"goals": [{"quantity": "u_z_mm", "max": 1, "at": "1 mm", "field": "0 mm"}]}, "goals.0", "drop at or field"),
        ({"groups": [{"name": "barrel"}]}, "groups", "has no member"),
        ({"perturb": [{"place": "sensor.tilt"}]}, "perturb.0.place", "does not cover it"),
        ({"perturb": [{"place": "d_3"}, {"place": "aperture.distance"}]}, "perturb.1.place", "twice"),
        ({"perturb": [{"place": "main_lens.focal_plane", "tolerance": "1 mm"}]}, "perturb", "one follows from two"),
        ({"perturb": [{"place": "sensor.tilt", "tolerance": "1 %"}]}, "perturb.0.tolerance", "absolute"),
        ({"perturb": [{"place": "d_3", "tolerance": "-1 mm"}]}, "perturb.0.tolerance", "not negative"),
        ({"perturb": [{"place": "relay", "tolerance": "much"}]}, "perturb.0.tolerance", "not a ratio"),
    ],
)
def test_faults_between_tables(change, key, words):
    data = {name: value for name, value in {**GOOD, **change}.items() if value is not None}
    assert words in faults(data)[key]


def test_goals_are_asked_for_as_in_optimise_studies_and_by_their_former_keys():
    """Quantity and field, a length or a place, each a column of its own; the former keys give the same plan."""

    def limited(*goals):
        plan = plan_from({**GOOD, "goals": list(goals)})
        return plan.question.fields, [plan.columns[limit.column].label for limit in plan.limits]

    fill = {"quantity": "fill_factor", "min": 0.9}
    fields, labels = limited({**fill, "field": ["3 mm", "1 mm"]}, {"quantity": "mismatch_px", "max": 1.0})
    assert (fields[3], labels) == ((3.0, 1.0), ["fill_factor@3", *(f"mismatch_px@{k}" for k in range(3))])
    former = limited({"metric": "fill_factor", "min": 0.9, "fields": [0]})
    assert limited({**fill, "field": "0 mm"}) == limited({**fill, "fields": ["centre"]}) == former
    assert limited({"quantity": "light_sr", "min": 0.0, "fields": [0]})[1] == ["light_sr"]  # as ever
    assert limited({**fill, "fields": ["corner", "2 mm"]})[1] == ["fill_factor@2", "fill_factor@3"]


def test_a_study_of_ones_own_grades_and_design_beside_it(tmp_path):
    (tmp_path / "shop.toml").write_text(SHIPPED.read_text().replace('"0.05 mm"', '"0.04 mm"'))
    (tmp_path / "mine.toml").write_text(preset_path("paper").read_text())
    head = 'name = "n"\ndesign = "mine.toml"\ngrade = "precision"\ngrades = "shop.toml"\n'
    text = head + '[[goals]]\nmetric = "fill_factor"\nmin = 0.9\n'
    (tmp_path / "study.toml").write_text(text)
    plan, study, _ = load_plan(tmp_path / "study.toml", trials=77, seed=9)
    assert {p.place: p.tolerance for p in plan.draws.perturbations}["microlens_array.distance"] == 0.04
    assert (plan.trials, plan.draws.seed, study.trials) == (77, 9, 77)
    assert plan.question.design == load("paper")


def test_a_damaged_table_of_grades_is_told(tmp_path):
    (tmp_path / "g.toml").write_text('[grades]\nloose = "x"\n[[line]]\nplace = "d"\nloos = "1 %"\n')
    with pytest.raises(InputError) as caught:
        load_grades(tmp_path / "g.toml")
    assert [problem.key for problem in caught.value.problems] == ["line.0.loose", "line.0.provenance", "line.0.loos"]


def test_places():
    design = load("paper")
    assert expand(design, "aperture.decentre") == ("aperture.decentre.0", "aperture.decentre.1")
    assert expand(design, "d_1") == ("microlens_array.distance",)
    assert expand(design, "stops.*.tilt") == ()
    assert set(nominal_values(design)) == set(perturbable(design))
    assert parse_tolerance("2 %", "length", -50.0) == 1.0
    assert short_name("microlens_array.tilt.1") == "MLA tilt y"
    assert short_name("stops.0.decentre.0") == "stop 1 decentre x"
    assert short_name("aperture.distance") == "d_3"
    assert [display(0.02, "length"), display(0.001, "angle"), display(0.003, "ratio")] == ["20 um", "1 mrad", "0.3 %"]
    assert display(np.inf, "length") == "any"
    assert [display(np.pi / 2, "angle"), display(-0.999, "angle")] == ["90 deg", "-999 mrad"]


def test_group_members_share_pose_by_pose():
    line = {"place": ["aperture.decentre", "main_lens.decentre", "d_1"], "group": "barrel"}
    plan = plan_from({**GOOD, "perturb": [line], "groups": [{"name": "barrel", "correlation": 0.5}]})
    groups = {p.place: p.group for p in plan.draws.perturbations if p.group}
    assert groups["aperture.decentre.0"] == groups["main_lens.decentre.0"] == "barrel: decentre x"
    assert groups["aperture.decentre.1"] == "barrel: decentre y"
    assert groups["microlens_array.distance"] == "barrel"
    assert dict(plan.draws.correlations) == dict.fromkeys(groups.values(), 0.5)


def test_a_real_lens_is_missed_in_its_own_numbers(tmp_path, capsys):
    text = preset_path("paper").read_text()
    real = text.replace('diameter = "50.8 mm"\nfocal_length = "100 mm"', 'prescription = "ac508-150-a"')
    assert real != text
    real = real.replace('focal_plane = "350 mm"', 'focal_plane = "500 mm"').replace('distance = "140 mm"\n', "")
    (tmp_path / "real.toml").write_text(real)
    (tmp_path / "study.toml").write_text(
        'name = "n"\ndesign = "real.toml"\ngrade = "high"\n[[goals]]\nmetric = "fill_factor"\nmin = 0.1\n'
    )
    plan, _, _ = load_plan(tmp_path / "study.toml")
    assert plan.question.design.lens.name == "AC508-150-A"
    missed = {p.place: p for p in plan.draws.perturbations}
    assert missed["main_lens.surfaces.1.radius"].tolerance == pytest.approx(0.0005 * 83.18)
    assert missed["main_lens.surfaces.2.index"].tolerance == 0.0001
    assert "main_lens.focal_length" not in missed
    wide = real.replace('"23 mm"', '"140 mm"').replace('"22.3 mm"', '"140 mm"')
    (tmp_path / "real.toml").write_text(wide)
    dark = 'name = "n"\nfields = ["centre", ["60 mm", "0 mm"]]\n'  # no light comes so far aside
    study = (tmp_path / "study.toml").read_text().replace('name = "n"\n', dark)
    (tmp_path / "study.toml").write_text(study)
    for command, out in (("tolerance", "out"), ("report", "out"), ("datasheet", "out.pdf")):
        assert main([command, str(tmp_path / "study.toml"), "-o", str(tmp_path / out)]) == 2
        assert "goals: fill_factor@1: the nominal design has no value there" in capsys.readouterr().err
        assert not (tmp_path / out).exists()
    (tmp_path / "study.toml").write_text(f"trials = 16\nsobol_samples = 0\n{study}fields = [0]\nmax = 0.2\n")
    assert main(["tolerance", str(tmp_path / "study.toml"), "-o", str(tmp_path / "out")]) == 0
    assert capsys.readouterr().err.startswith("roslf: the nominal design itself misses fill_factor@0: its builds")


def test_an_optimum_that_rests_on_a_limit_holds_it(tmp_path):
    """Optimisers leave 1e-9 of a limit to rounding, `evaluate` as well."""
    fill = float(QUANTITIES["fill_factor"](Camera.of(load("paper"))))
    study = tmp_path / "study.toml"
    for share, missed in ((1e-12, ()), (1e-6, ("fill_factor@0",))):
        text = f'quantity = "fill_factor"\nmin = {fill * (1 + share)!r}\n'
        study.write_text(f'name = "n"\ndesign = "paper"\ngrade = "high"\nfields = ["centre"]\n[[goals]]\n{text}')
        assert load_plan(study)[0].nominal_misses() == missed


def test_places_of_a_real_lens_are_told_apart():
    real, ideal = load("paper-singlet"), load("paper")
    assert expand(real, "main_lens.surfaces.*.radius") == ("main_lens.surfaces.2.radius",)  # the first is a plane
    assert expand(real, "main_lens.elements.1.wedge") == (
        "main_lens.elements.1.wedge.0",
        "main_lens.elements.1.wedge.1",
    )
    assert expand(real, "main_lens.surfaces.*.tilt") == tuple(
        f"main_lens.surfaces.{n}.tilt.{axis}" for n in (1, 2) for axis in (0, 1)
    )
    for design, name, words in (
        (real, "f", "follows from the real lens's surfaces; perturb main_lens.surfaces"),
        (ideal, "main_lens.surfaces.1.radius", "this design's is ideal; perturb main_lens.focal_length"),
        (real, "main_lens.surfaces.1.radius", "did you mean 'main_lens.surfaces.2.radius'"),
        (real, "main_lens.surfaces.*.colour", "nothing that a lens's making can miss; there are abbe, conic"),
    ):
        with pytest.raises(ValueError, match=words):
            expand(design, name)
    assert parse_tolerance("1e-5 /mm", "curvature", 0.0) == 1e-5
    assert parse_tolerance(5e-4, "number", 1.5) == 5e-4
    assert parse_tolerance("0.1 %", "number", 1.5) == pytest.approx(1.5e-3)
    with pytest.raises(ValueError, match=r"is not a number; write e\.g\. 0\.0005"):
        parse_tolerance("much", "number", 1.5)
    assert short_name("main_lens.surfaces.1.radius") == "surface 1 radius"
    assert short_name("main_lens.elements.2.tilt.1") == "element 2 tilt y"
    assert display(5e-4, "number") == "0.0005"


def test_chunks_stay_few_and_large():
    few, some, many = (
        plan_from(
            {
                "name": "s",
                "design": "paper",
                "goals": [{"metric": "fill_factor", "max": 2.0}],
                "perturb": [{"place": "d_2", "tolerance": "1 um"}],
                "trials": trials,
            }
        )
        for trials in (100, 10**6, 10**8)
    )
    assert few.chunk == some.chunk == 2**15
    assert many.chunks < 1100


GRADES = """
[grades]
tight = "as good as it gets"
[[line]]
place = "main_lens.focal_length"
tight = "1 %"
provenance = "judgement"
"""


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('tight = "as good as it gets"', "tight = 7", "grades.tight: must be text, got 7"),
        ('[grades]\ntight = "as good as it gets"', "grades = 7", "grades: is missing"),
        (GRADES, "line = 7\n[grades]\ntight = 'x'", "line: must be tables, each headed [[line]]"),
        (GRADES, "line = [7]\n[grades]\ntight = 'x'", "line.0: must be a table of keys ([[line]] in the file)"),
        ('place = "main_lens.focal_length"', "place = 7", "line.0.place: must be text, got 7"),
        ('provenance = "judgement"', "provenance = []", "line.0.provenance: must be text, got []"),
        ('tight = "1 %"', "tight = []", 'line.0.tight: must be text such as "1 %", got []'),
        ('tight = "1 %"', "", "line.0.tight: is missing"),
        ('place = "main_lens.focal_length"', 'place = "nothing"', "nothing.tight: 'nothing' is not a number"),
        ('tight = "1 %"', 'tight = "1e9999999 mm"', "not a finite number"),
    ],
)
def test_a_table_of_grades_of_the_wrong_kind_is_told_in_one_line(old, new, said, tmp_path, capsys):
    assert old in GRADES
    (tmp_path / "shop.toml").write_text(GRADES.replace(old, new))
    (tmp_path / "study.toml").write_text(
        'name = "x"\ndesign = "paper"\ngrade = "tight"\ngrades = "shop.toml"\n[[goals]]\nmetric="fill_factor"\nmax=2'
    )
    assert main(["tolerance", str(tmp_path / "study.toml"), "-o", str(tmp_path / "out")]) == 2
    err = capsys.readouterr().err
    assert said in err
    assert len(err.splitlines()) == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("written", [6.0, "6 mm", "6000 um"])
def test_limits_are_written_alike_in_tolerance_and_optimise_studies(written):
    goal = MetricGoal.model_validate({"metric": "sigma_z_mm", "max": written})
    held = Constraint.model_validate({"quantity": "sigma_z_mm", "max": written}, context={"from_file": True})
    assert goal.max == held.max == 6.0
    for wrong in ("6 deg", "6", True):
        for model, name in ((MetricGoal, "metric"), (Constraint, "quantity")):
            with pytest.raises(ValueError, match=r"unit|expected a length"):
                model.model_validate({name: "sigma_z_mm", "max": wrong}, context={"from_file": True})


@pytest.mark.parametrize(
    ("name", "low", "high", "said"),
    [
        ("kept_fraction", 1.2, None, "min 1.2 is none that a camera holds, kept_fraction is at most 1; lower it"),
        ("kept_fraction", None, "-0.1", "max -0.1 is none that a camera holds, kept_fraction is above 0; raise it"),
        ("field_of_view_deg", "200 deg", None, "min 200 deg is none that a camera holds, .* at most 180 deg"),
        ("field_of_view_deg", None, "200 deg", "max 200 deg limits nothing, .* lower it or leave it out"),
        ("view_depth_of_field_near_mm", None, "-3 mm", "is none that a camera holds, .* at least 0; raise it"),
        ("image_diameter_mm", "-3 um", None, "min -3 um limits nothing, image_diameter_mm is above 0; raise"),
        ("sigma_z_mm", "2 mm", "1 mm", "min 2 mm is above max 1 mm: nothing lies between; did you swap them"),
    ],
)  # fmt: skip
def test_limits_that_by_nature_cannot_hold_are_refused_alike(name, low, high, said, tmp_path, capsys):
    """In tolerance studies, in studies of `roslf optimize`, and in designs: one line with file, key and remedy."""
    limits = "".join(
        f"{side} = {json.dumps(value)}\n" for side, value in (("min", low), ("max", high)) if value is not None
    )
    tolerance, optimum, design = (tmp_path / f"{file}.toml" for file in ("tolerance", "optimize", "design"))
    if name in METRICS:
        tolerance.write_text(f'name = "t"\ndesign = "paper"\ngrade = "high"\n[[goals]]\nmetric = "{name}"\n{limits}')
    field = 'field = "1 mm"\n' if QUANTITIES[name].of is None else ""
    optimum.write_text(
        'name = "o"\ndesign = "paper"\n[variables]\nd_2 = ["1 mm", "3 mm"]\n[[goals]]\nquantity = "sigma_z_mm"\n'
        f'direction = "min"\n[[constraints]]\nquantity = "{name}"\n{field}{limits}'
    )
    if not field:
        paper = dumps(load("paper"))
        design.write_text(f"{paper}\n[required.{name}]\n{limits}")
    for command in (["tolerance", tolerance], ["optimize", optimum], ["evaluate", design]):
        if command[1].exists():
            output = [] if command[0] == "evaluate" else ["-o", str(tmp_path / "out")]
            assert main([command[0], str(command[1]), *output]) == 2
            (line,) = capsys.readouterr().err.splitlines()
            assert line.startswith(f"roslf: {command[1]}: ")
            assert re.search(said, line), line
    assert not (tmp_path / "out").exists()


def test_no_camera_that_ships_is_beyond_what_is_possible_by_nature():
    for preset in preset_names():
        camera = Camera.of(load(preset))
        for quantity in QUANTITIES.values():
            if quantity.of is not None:
                value = float(quantity(camera, 40.0 if quantity.at == "needed" else None))
                least = 0.0 if quantity.positive else quantity.least
                assert math.isnan(value) or least <= value <= quantity.most, (preset, quantity.name, value)
            elif not (quantity.of_views and is_focused(camera)):
                values = np.ravel(quantity.at_fields(MicrolensImages(camera, [(0.0, 0.0), (0.1, 0.0), (-0.1, 0.1)])))
                least = 0.0 if quantity.positive else quantity.least
                assert all(math.isnan(v) or least <= v <= quantity.most * (1 + 1e-12) for v in values), quantity.name


def test_more_trials_than_a_sobol_sequence_has_points_are_refused():
    data = {"design": "paper", "grade": "high", "goals": [{"metric": "fill_factor", "max": 1.1}], "sampling": "sobol"}
    assert plan_from({**data, "name": "s", "trials": 2**32}).chunks == 4096
    with pytest.raises(InputError, match="trials: a Sobol sequence has 4294967296 points; ask for fewer"):
        plan_from({**data, "name": "s", "trials": 10**10})


DISTANCES = {
    "u_z_mm": 15.0,
    "sigma_z_mm": 15.0,
    "field_half_width_mm": 40.0,
    "virtual_depth": 60.0,
    "blur_pitches": 60.0,
}


@pytest.mark.parametrize("name", ["paper", "paper-singlet"])
def test_metrics_at_a_distance_are_those_of_each_build_alone(name):
    goals = [{"metric": metric, "at": f"{mm:g} mm", "max": 1e6} for metric, mm in DISTANCES.items()]
    goals.append({"metric": "sigma_z_mm", "max": "1 m"})
    plan = plan_from({**GOOD, "design": name, "grade": "commercial", "goals": goals, "fields": ["centre"]})
    labels = [column.label for column in plan.columns]
    assert labels == ["sigma_z_mm", *(f"{metric} at {mm:g} mm" for metric, mm in DISTANCES.items())]
    assert plan.nominal[0] != pytest.approx(plan.nominal[2], rel=0.1)
    values = plan.draws.values(plan.draws.deviations(plan.draws.uniforms(0, 64)[:, :4]))
    builds = evaluate_builds(plan.question, values, 4)
    for build in range(4):
        one = design_built(plan.question.design, {place: float(at[build]) for place, at in values.items()})
        alone = {metric: float(QUANTITIES[metric](Camera.of(one), mm)) for metric, mm in DISTANCES.items()}
        if name == "paper-singlet":  # by rays
            alone["field_half_width_mm"] = ObjectField.of(FieldImages.of(one).ends, 40.0, "").width_mm / 2
        # Depth is taken from series through builds that are alike; fields change as the thin-lens model's.
        near = {metric: pytest.approx(value, rel=1e-3) for metric, value in alone.items()}
        near["field_half_width_mm"] = pytest.approx(alone["field_half_width_mm"], rel=1e-2)
        assert dict(zip(DISTANCES, builds[1:, build].tolist(), strict=True)) == near


def test_a_goal_at_a_distance_decides_the_yield_and_has_its_sensitivities():
    goals = [{"metric": "sigma_z_mm", "at": "15 mm", "max": 1.0}, {"metric": "sigma_z_mm", "max": 1.0}]
    plan, *_ = tolerance_plan({**GOOD, "goals": goals, "trials": 200})
    focal, near = plan.nominal
    held = {**GOOD, "trials": 200, "keep_worst": 0}
    held["goals"] = [{"metric": "sigma_z_mm", "at": "15 mm", "max": near}, {"metric": "sigma_z_mm", "max": 2 * focal}]
    shares = {limit["column"]: limit["yield"] for limit in _builds_alone(held).final.to_dict()["limits"]}
    assert 0.2 < shares["sigma_z_mm at 15 mm"] < 0.8
    assert shares["sigma_z_mm"] == 1.0
    moves = sensitivity(plan)
    place = [p.place for p in plan.draws.perturbations].index("main_lens.focal_length")
    design, f = plan.question.design, load("paper").f
    ends = [Camera.of(design).replace({"main_lens.focal_length": f * (1 + by)}) for by in (1e-5, -1e-5)]
    for column, at in enumerate((None, 15.0)):
        ahead, behind = (float(QUANTITIES["sigma_z_mm"](camera, at)) for camera in ends)
        assert moves.derivatives[column, place] == pytest.approx((ahead - behind) / (2e-5 * f), rel=1e-3)


@pytest.mark.parametrize(
    ("goal", "said"),
    [
        ({"metric": "fill_factor", "at": "15 mm", "min": 0.5}, "fill_factor is not asked for at a distance; drop at"),
        ({"metric": "virtual_depth", "max": 5}, 'virtual_depth needs a distance ahead of the tip; write e.g. at = "40'),
        ({"metric": "sigma_z_mm", "at": 15, "max": 5}, "unit"),
        ({"metric": "sigma_z_mm", "at": "-15 mm", "max": 5}, "greater than zero"),
        ({"metric": "sigma_z_mm", "at": "15 mm", "fields": [0], "max": 5}, "drop at or field"),
    ],
)
def test_distances_of_goals_are_checked_as_those_of_requirements(goal, said):
    assert said in " ".join(faults({**GOOD, "goals": [goal]}).values())


def test_without_goals_a_study_holds_what_its_design_requires():
    bare = {key: value for key, value in GOOD.items() if key != "goals"}
    assert "[required]" in faults(bare)["goals"]
    limits = {"u_z_mm": [{"max": "0.5 mm"}, {"at": "15 mm", "max": 0.1}], "fill_factor": {"min": 0.9}}
    plan, *_ = tolerance_plan({**bare, "fields": ["centre"]}, load("paper").replace({"required": limits}))
    asked = [(plan.columns[limit.column].label, limit.low, limit.high) for limit in plan.limits]
    none = math.inf
    assert asked == [("u_z_mm", -none, 0.5), ("u_z_mm at 15 mm", -none, 0.1), ("fill_factor@0", 0.9, none)]


def test_a_study_holds_what_its_design_requires_beside_goals_of_its_own():
    design = load("paper").replace({"required": {"u_z_mm": {"max": "0.5 mm"}, "fill_factor": {"min": 0.9}}})
    data = {**GOOD, "fields": ["centre"], "required": True}
    own = {"metric": "fill_factor", "min": 0.9}
    plan, *_ = tolerance_plan({**data, "goals": [own, {"metric": "kept_fraction", "min": 0.5}]}, design)
    asked = [(plan.columns[limit.column].label, limit.low, limit.high) for limit in plan.limits]
    none = math.inf
    assert asked == [("fill_factor@0", 0.9, none), ("kept_fraction@0", 0.5, none), ("u_z_mm", -none, 0.5)]
    assert "has no [required]" in faults(data)["required"]


def test_a_study_of_temperatures_takes_its_nominal_design_as_its_builds():
    """At one temperature: the square of what depth has of the range over it comes off, by the budget's own terms."""
    warm = {"temperature": 20.0, "range": [15.0, 40.0], "calibrated_at": 20.0, "housing": "aluminium"}
    design = load("paper").replace({"environment": warm})
    study = {
        "name": "warm", "trials": 8, "goals": [{"metric": "u_z_mm", "max": 9.0}],
        "perturb": [{"place": "environment.temperature", "tolerance": "5 K"}],
    }  # fmt: skip
    nominal = tolerance_plan(study, design)[0].nominal[0]
    budget = depth_budget(Camera.of(design))
    terms = {term.name: float(term.u_mm or 0.0) for term in budget.terms}
    assert terms["temperature"] > 0.1
    assert nominal == pytest.approx(np.sqrt(float(budget.u_z_mm) ** 2 - terms["temperature"] ** 2), rel=1e-6)
    fixed = {**study, "perturb": [{"place": "sensor.distance", "tolerance": "5 um"}]}
    assert tolerance_plan(fixed, design)[0].nominal[0] == pytest.approx(float(budget.u_z_mm), rel=1e-6)


def test_a_temperature_that_fails_no_limit_says_how_far_it_was_looked_for():
    """By hand: from 20 degrees to the coldest that a camera meets, -60; pixels overflow nowhere before."""
    warm = {"temperature": 20.0, "range": [15.0, 40.0], "housing": "aluminium"}
    design = load("paper").replace({"environment": warm})
    perturb = [{"place": "environment.temperature", "tolerance": "5 K"}]
    study = {"name": "warm", "trials": 8, "goals": [{"metric": "fill_factor", "min": 0.5}], "perturb": perturb}
    plan = tolerance_plan(study, design)[0]
    (one,), (p,) = inverse_sensitivity(plan, 0.5), plan.draws.perturbations
    assert one.alone == pytest.approx(80.0, rel=1e-6)
    told = _within_reach(one, p, "temperature")
    assert (told.alone, told.alone_limited_by) == (math.inf, "no limit within ± 80 K")
    narrow = {**study, "goals": [{"metric": "working_distance_mm", "min": "229.9 mm", "max": "230.1 mm"}]}
    plan = tolerance_plan(narrow, design)[0]
    told = _within_reach(*inverse_sensitivity(plan, 0.5), p, "temperature")
    assert told.alone < 80.0
    assert told.alone_limited_by == "working_distance_mm"


def test_builds_that_are_warmed_otherwise_than_the_range_of_the_design_are_told():
    """Half of 5 to 80 degC is 37.5 K, which about 20 degC reach from -17.5 to 57.5."""
    perturb = [{"place": "environment.temperature", "tolerance": "37.5 K"}]
    study = {"name": "warm", "trials": 8, "goals": [{"metric": "fill_factor", "min": 0.5}], "perturb": perturb}
    warm = {"temperature": 20.0, "range": [5.0, 80.0], "housing": "titanium"}

    def told(**more):
        design = load("paper").replace({"environment": {**warm, **more}})
        return list(_beside_range(tolerance_plan(study, design)[0]))

    (said,) = told()
    assert "used at -17.5 to 57.5 degC" in said
    assert 'with temperature = "42.5 degC" in [environment] and a tolerance of 37.5 K' in said
    assert told(temperature=42.5) == told(range=None) == []


def test_builds_that_meet_all_that_is_required_are_counted_together():
    """By brute force, build by build: two limits that other builds miss are met by fewer than either."""
    asked = {"working_distance_mm": {"min": 229.98}, "fill_factor": {"max": 1.006}, "u_z_mm": {"max": 9.0}}
    design = load("paper").replace({"required": asked})
    perturb = [{"place": place, "tolerance": width} for place, width in (
        ("microlens_array.distance", "0.02 mm"), ("aperture.diameter", "0.01 mm"))]  # fmt: skip
    study = {"name": "both", "trials": 64, "goals": [{"metric": "fill_factor", "min": 0.5}], "perturb": perturb}
    plan, required = tolerance_plan(study, design)[0], required_of(design)
    builds, good = first_builds(plan, 64)
    held = [[bool(one.holds(QUANTITIES[one.quantity](builds.camera.build(k)))) for k in range(64)]
            for one in required if one.quantity != "u_z_mm"]  # fmt: skip
    together = _share_that_meets_all(plan, required)
    assert good.all()
    assert (together.passed, together.trials) == (int(np.all(held, axis=0).sum()), 64)
    assert 0 < together.passed < min(sum(one) for one in held)
    assert _share_that_meets_all(plan, [one for one in required if one.quantity == "u_z_mm"]) is None
