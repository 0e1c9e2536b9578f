"""Designs behind a real main lens: the optimum against differential evolution over designs traced one at a time."""

import json
from dataclasses import replace
from itertools import chain, cycle, repeat

import numpy as np
import pytest
from scipy.optimize import brentq, differential_evolution

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.cli import main
from roslf_design.design import preset_path
from roslf_design.evaluation.field_images import FieldImages, ObjectField
from roslf_design.optimization import Constraint, Goal, Settings, pareto_front, solve
from roslf_design.optimization.search import SearchBudget
from roslf_design.optimization.solve import solve_by_rays
from roslf_design.optimization.traces import FieldTraces
from roslf_design.reporting.optimise.pages import _about_conflict
from roslf_design.traced.camera import camera_of, microlenses
from roslf_design.traced.images import real_images
from tests.optimization.posing import posed

SINGLET = roslf.load("paper-singlet").replace({"depth.disparity_error": 0.1})
FIELDS = ((0.0, 0.0), (11.0, 7.0))

STUDY = """
name = "behind a singlet"
design = "paper-singlet"

[variables]
D_F = ["2 mm", "4 mm"]
d_3 = ["90 mm", "130 mm"]

[[constraints]]
quantity = "fill_factor"
field = "11 mm"
max = 1.0

[[constraints]]
quantity = "kept_fraction"
field = ["11 mm", "7 mm"]
min = 0.98

[[goals]]
quantity = "sigma_z_mm"
direction = "min"

[solver]
starts = 1
check = false
"""


def images(design):
    """Both fields of one design, integrated ray by ray."""
    return real_images(camera_of(design), microlenses(design, np.array(FIELDS)), points=64)


def test_no_worse_than_differential_evolution_over_exact_traces():
    """The brightest corner whose image on the axis is no wider than the pitch: where the lens begins to cut it.

    64 points round a cut image leave 5e-3 of its area, the same to 1e-4 for cameras this near each other; both optima
    are compared by that one measure.
    """

    def cost(numbers):
        lit = images(SINGLET.replace(D_F=float(numbers[0]), d_3=float(numbers[1])))
        over = max(0.0, np.log(lit.diameter[0] / 0.063))
        return -np.log(max(lit.area[1], 1e-9)) + 10 * over

    known = differential_evolution(cost, [(2, 4), (90, 130)], seed=1, popsize=5, maxiter=8, polish=False)
    start = SINGLET.replace(D_F=10.0, d_3=195.0)  # dark at the corner, folded on the axis: no matter
    problem = posed(
        {"D_F": (2, 4), "d_3": (90, 130)},
        [Constraint(quantity="image_diameter_mm", field=FIELDS[0], max=0.063)],
        Goal(quantity="image_area_mm2", field=FIELDS[1], direction="max"),
        design=start,
    )
    answer = solve(problem, Settings(starts=1, check=False, accuracy=1e-4))
    assert answer.feasible
    assert cost([answer.variables()["D_F"], answer.variables()["d_3"]]) <= known.fun + 1e-3


def test_cameras_far_from_the_design_are_traced_as_if_they_were_it():
    """Whole and cut images, near and far FAPs, small and large."""
    numbers = {"D_F": np.array([1.0, 2.5, 6.0, 3.0]), "d_3": np.array([20.0, 93.0, 60.0, 125.0])}
    traces = FieldTraces(SINGLET, FIELDS, roslf.Camera.of(SINGLET, numbers))
    for build in range(4):
        own = images(SINGLET.replace(**{name: float(values[build]) for name, values in numbers.items()}))
        for k, field in enumerate(FIELDS):
            kept, area = (traces.at(roslf.quantity(name), field)[build] for name in ("kept_fraction", "image_area_mm2"))
            whole = own.kept_fraction[k] == 1
            assert area == pytest.approx(own.area[k], rel=1e-9 if whole else 1e-6)
            assert kept == pytest.approx(own.kept_fraction[k], rel=1e-9 if whole else 1e-6)


def test_an_entrance_pupil_behind_the_lens_stands_in_no_one_s_way():
    """The widest that fills the pitch on the axis, traced alone."""
    problem = posed(
        {"D_F": (2, 7), "d_3": (-60, -10)},
        [Constraint(quantity="image_diameter_mm", field=FIELDS[0], max=0.063)],
        Goal(quantity="image_area_mm2", field=FIELDS[1], direction="max"),
        design=SINGLET.replace(D_F=4.0, d_3=-25.0),
    )
    answer = solve(problem, Settings(starts=1, check=False, accuracy=1e-4))
    assert answer.feasible
    own = images(problem.design.replace(**answer.variables()))
    assert own.diameter[0] == pytest.approx(0.063, rel=1e-6)
    assert own.kept_fraction[1] == 1


def test_a_field_of_the_whole_camera_is_held_as_rays_tell_it():
    """The nearest focal plane on which the traced field is wide enough, by bisection over data sheets' fields."""
    design = SINGLET.replace({"sensor.distance": SINGLET.d_2, "main_lens.focal_plane": 350.0})
    limit = Constraint(quantity="field_half_width_mm", min=31.0)
    problem = posed({"d_f": (250, 450)}, [limit], Goal(quantity="sigma_z_mm", direction="min"), design=design)

    def room(plane):
        moved = design.replace({"main_lens.focal_plane": plane})
        ahead = float(roslf.quantity("working_distance_mm")(Camera.of(moved)))
        return ObjectField.of(FieldImages.of(moved).ends, ahead, "focal plane").width_mm / 2 - 31.0

    known = brentq(room, 250, 450, xtol=1e-5)
    settings = Settings(starts=2, check=False)
    answer = solve_by_rays(problem, settings)
    assert answer.feasible
    assert room(answer.variables()["d_f"]) >= -31e-9
    assert answer.variables()["d_f"] == pytest.approx(known, rel=1e-5)
    assert answer.number(answer.asked.constraints[0]) == pytest.approx(31.0, rel=1e-9)
    alone = solve(problem, settings).variables()["d_f"]  # by the thin-lens model
    assert abs(alone / known - 1) > 0.05


def test_the_widest_aperture_that_is_sharp_is_where_a_scan_by_rays_finds_it():
    """The singlet, refocused, is this sharp between about 3.6 and 7.6 mm, and searches start far from there."""
    scanned = np.geomspace(7.45, 7.75, 9)
    detail = roslf.QUANTITIES["mtf50_lp_per_mm"]
    sharp = [FieldImages.of(SINGLET.replace(D_F=float(each))).told(detail, None) for each in scanned]
    limit, goal = Constraint(quantity=detail.name, min=3.38), Goal(quantity="f_number_pupil", direction="min")
    answer = solve_by_rays(posed({"D_F": (0.5, 20)}, [limit], goal, design=SINGLET), Settings(starts=1, check=False))
    assert answer.optimal
    assert answer.residual < 1e-4
    assert answer.variables()["D_F"] == pytest.approx(np.interp(-3.38, np.negative(sharp), scanned), rel=1e-4)


def test_what_rays_told_at_two_places_holds_at_both_and_lies_between():
    design = SINGLET.replace({"main_lens.focal_plane": 350.0})
    limit = Constraint(quantity="field_half_width_mm", min=31.0)
    problem = posed({"d_f": (250, 450)}, [limit], Goal(quantity="sigma_z_mm", direction="min"), design=design)
    ends, middle = np.array([[0.1], [0.9]]), np.array([[0.5]])
    for end in ends:
        problem, _ = problem.told_by_rays(end)
    told = [FieldImages.of(problem.design_at(end)).told(roslf.QUANTITIES["field_half_width_mm"], None) for end in ends]
    rows = [row.label.startswith("field_half_width_mm") for row in problem.rows]
    for found in (problem.vector(ends)[1:], problem.limits(ends)):
        assert 31.0 * np.exp(-found[rows][0]) == pytest.approx(told, rel=1e-9)
    assert [problem.number(problem.constraints[0], end) for end in ends] == pytest.approx(told, rel=1e-9)
    thin = roslf.QUANTITIES["field_half_width_mm"](problem.cameras(np.vstack([ends, middle])), None)
    shares = 31.0 * np.exp(-problem.limits(np.vstack([ends, middle]))[rows][0]) / thin
    assert shares[2] == pytest.approx(np.sqrt(shares[0] * shares[1]), rel=1e-9)
    assert abs(shares[0] / shares[1] - 1) > 1e-3


def test_points_of_a_front_are_told_by_rays_of_their_own():
    goals = (Goal(quantity="field_half_width_mm", direction="max"), Goal(quantity="sigma_z_mm", direction="min"))
    problem = posed({"d_f": (250, 450)}, [], *goals, design=SINGLET.replace({"main_lens.focal_plane": 350.0}))
    answer = solve_by_rays(problem, Settings(starts=1, check=False))
    front = pareto_front(answer.asked, answer.asked.goals, 3, [answer.unit], SearchBudget())
    assert len(front.points) >= 3
    for point in front.points:
        shown = FieldImages.of(problem.design.replace(**point.variables_mm))
        told = shown.told(roslf.QUANTITIES["field_half_width_mm"], None)
        assert point.goals["field_half_width_mm"] == pytest.approx(told, rel=1e-9)


def test_an_answer_holds_its_limits_as_rays_tell_them_where_it_is(monkeypatch):
    """A share that misses the limit wherever the search settles: no design; one that never settles is told."""
    limit = Constraint(quantity="field_half_width_mm", min=31.0)
    problem = posed({"d_f": (250, 450)}, [limit], Goal(quantity="sigma_z_mm", direction="min"), design=SINGLET)
    shares = chain([1.0], repeat(0.1))
    monkeypatch.setattr(
        "roslf_design.evaluation.field_images.FieldImages.half_field",
        lambda shown, way, at: next(shares) * float(roslf.QUANTITIES["field_half_width_mm"](shown.images.camera, at)),
    )
    answer = solve_by_rays(problem, Settings(starts=1, check=False))
    assert not answer.feasible
    assert answer.conflict is not None
    assert answer.violation > 1
    shares = cycle([1.0, 1.1])
    settled = solve_by_rays(problem, Settings(starts=1, check=False))
    assert "limits and goals by rays are not settled" in settled.notes[-1]


def test_no_field_is_traced_where_the_whole_camera_s_limits_cannot_be_held(monkeypatch):
    """Nor is depth summed; what settling takes counts, and so does its time."""

    def none(*_):
        raise AssertionError

    monkeypatch.setattr(FieldTraces, "at", none)
    limits = [
        Constraint(quantity="fill_factor", field=FIELDS[1], max=1.0),
        Constraint(quantity="field_half_width_mm", min=100.0),
        Constraint(quantity="u_z_mm", max=1e-3),
    ]
    goal = Goal(quantity="sigma_z_mm", direction="min")
    settings = Settings(starts=1, check=False, seconds=1e-9)
    answer = solve_by_rays(posed({"d_f": (250, 450)}, limits, goal, design=SINGLET), settings)
    assert not answer.feasible
    assert [one.limit for one in answer.conflict.clashing] == ["field_half_width_mm >="]
    assert answer.conflict.clashing[0].value < 100
    assert "limits at single fields were not looked at" in answer.notes[0]
    x, y = FIELDS[1]
    assert answer.conflict.unjudged == (f"fill_factor at ({x:g}, {y:g}) mm", "u_z_mm")
    said = _about_conflict(answer.conflict).remedy
    assert (
        f"would do for the limits that were judged (not judged: fill_factor at ({x:g}, {y:g}) mm and u_z_mm): " in said
    )
    assert "would do: " in _about_conflict(replace(answer.conflict, unjudged=())).remedy
    assert "the clock of 1e-09 seconds ran out" in answer.notes[1]
    assert answer.evaluations > 0
    assert answer.seconds > 0


def test_a_clock_that_runs_out_among_the_whole_camera_s_limits_is_no_conflict():
    """A strip that one search has no time to reach, and a field's limit that every camera holds."""
    limits = [
        Constraint(quantity="fill_factor", field=FIELDS[0], max=100.0),
        Constraint(quantity="sigma_z_mm", min=0.5, max=0.500001),
    ]
    problem = posed({"D_F": (1, 8), "d_3": (20, 200)}, limits, Goal(quantity="D_F", direction="min"), design=SINGLET)
    answer = solve_by_rays(problem, Settings(starts=1, check=False, seconds=1e-9))
    assert answer.feasible
    assert answer.ended == "seconds"
    assert "the clock of 1e-09 seconds ran out" in answer.notes[0]


def test_a_study_behind_a_real_lens(tmp_path, capsys):
    (tmp_path / "study.toml").write_text(STUDY)
    assert main(["optimize", str(tmp_path / "study.toml"), "-o", str(tmp_path / "out"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["status"] == "optimal"
    assert found["traced"]["lens"] == "LA1050-A reversed"
    assert found["traced"]["goals_and_limits"] < 1e-6
    assert found["traced"]["folded_fields_mm"] == []
    best = roslf.load(tmp_path / "out" / "best.toml")
    assert best.lens == SINGLET.lens
    field = roslf.evaluate(best, [FIELDS[1]]).fields[0]
    asked = {c["quantity"]: c["value"] for c in found["constraints"]}
    assert field.kept_fraction == pytest.approx(asked["kept_fraction"], abs=1e-6)
    assert asked["fill_factor"] <= 1 + 1e-8
    assert asked["kept_fraction"] >= 0.98 - 1e-8
    assert "was traced at every design tried" in (tmp_path / "out" / "index.html").read_text()


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("D_F = [", "D = [", "'D' is the real lens's own"),
        ('field = "11 mm"\n', "", "constraints.0: behind a real lens (LA1050-A reversed) fill_factor is traced and"),
        (
            '"fill_factor"\nfield = "11 mm"\n',
            '"undistorted_field_mm"\n',
            "leaves out what the lens's aberrations cut; hold non_distortion",
        ),
        ('field = "11 mm"\n', 'field = "11 mm"\nat = "9 mm"\n', "is not asked for at a distance"),
        ('field = "11 mm"\n', 'field = "12 mm"\n', "lies beyond the array"),
        ("[solver]", "[[robust.perturb]]\nplace = 'd_2'\ntolerance = '1 um'\n[solver]", "is for ideal main lenses"),
    ],
)
def test_what_does_not_go_behind_a_real_lens_is_one_line(capsys, tmp_path, old, new, said):
    assert old in STUDY
    (tmp_path / "study.toml").write_text(STUDY.replace(old, new, 1))
    assert main(["optimize", str(tmp_path / "study.toml"), "-o", str(tmp_path / "out")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line
    assert not (tmp_path / "out").exists()


def test_a_spent_budget_is_told(capsys, tmp_path):
    (tmp_path / "study.toml").write_text(STUDY.replace("starts = 1", "starts = 40\nbudget = 100\nevaluations = 30"))
    assert main(["optimize", str(tmp_path / "study.toml"), "-o", str(tmp_path / "out"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["trust"]["ended_by"] == "evaluations"


def test_a_lens_that_diverges_is_one_line(capsys, tmp_path):
    surfaces = '[[surfaces]]\nradius = "-50 mm"\nthickness = "3 mm"\nglass = "N-BK7"\ndiameter = "50 mm"\n'
    surfaces += '[[surfaces]]\nradius = "50 mm"\ndiameter = "50 mm"\n'
    (tmp_path / "lens.toml").write_text(f'name = "hollow"\n{surfaces}')
    design = (preset_path("paper-singlet")).read_text().replace('"LA1050-A"', '"lens.toml"')
    (tmp_path / "hollow.toml").write_text(design)
    (tmp_path / "study.toml").write_text(STUDY.replace('"paper-singlet"', '"hollow.toml"'))
    assert main(["optimize", str(tmp_path / "study.toml"), "-o", str(tmp_path / "out")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "hollow" in line
    assert "does not converge light" in line
