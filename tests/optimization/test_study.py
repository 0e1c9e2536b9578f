"""Studies as files and as a command: what comes out, and what is wrong with bad ones."""

import json
import math
import os
import re
import signal
import sys
import time
import tomllib
from dataclasses import replace

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.catalogue import load_catalogue, rows
from roslf_design.cli import main
from roslf_design.design import dumps, save
from roslf_design.design.files import WRITTEN
from roslf_design.optimization import Constraint
from roslf_design.optimization.conflict import Conflict, Violation, explain
from roslf_design.optimization.search import SearchBudget
from roslf_design.optimization.study import load_study, read_study
from roslf_design.optimization.study import run as run_study
from roslf_design.reporting.blocks import Statements, Table
from roslf_design.reporting.optimise.pages import optimization_report, statements
from roslf_design.theory.depth_budget import depth_budget
from roslf_design.theory.focused import LIMIT, has_views, pupil_blur_ratio
from roslf_design.theory.length_covariance import LengthCovariance
from roslf_design.units import parse_quantity
from tests.optimization.posing import GOOD, PAPER, limit, posed

FOLLOWS = "microlens_in_focus = true"
"""The array's microlenses, made for it: behind a pupil so wide the paper's own show no views."""
SENSORS = 'kinds = ["sensors"]\nonly.sensors = ["EOS 90D sensor", "IMX253", "PYTHON 12K"]\n'
"""Some of the catalogue's forty."""


def run(capsys, *arguments):
    code = main([str(argument) for argument in arguments])
    out, err = capsys.readouterr()
    return code, out, err


def study(tmp_path, text, name="study.toml", design="given.toml"):
    """A study's file; of the paper's camera with depth errors in closed form, where it is of the paper's."""
    save(PAPER, tmp_path / "given.toml", overwrite=True)
    path = tmp_path / name
    path.write_text(text.replace('design = "paper"', f'design = "{design}"'))
    return path


def test_an_optimum_is_kept_where_robustness_is_stopped(capsys, tmp_path, monkeypatch):
    robust = '[robust]\ntrials = 64\n[[robust.perturb]]\nplace = "d_2"\ntolerance = "5 um"\n'
    text = GOOD + '[catalogue]\nkinds = ["sensors"]\nkeep = 3\n'
    found, folder = {}, tmp_path / "stopped"
    with monkeypatch.context() as patch:
        patch.setattr("roslf_design.commands.terminal.LOGGED", 0.0)
        code, _, log = run(capsys, "optimize", study(tmp_path, GOOD), "-o", tmp_path / "whole")
    assert code == 0
    assert re.search(r"^optimize: .*: \d+%, about [\d.e+-]+ s left$", log, re.MULTILINE)

    def interrupted(*_):
        found["before"] = (folder / "best.toml").read_bytes()
        raise KeyboardInterrupt

    monkeypatch.setattr("roslf_design.optimization.study.maximise_robustness", interrupted)
    code, out, _ = run(capsys, "optimize", study(tmp_path, text + robust), "-o", folder)
    assert code == 130
    assert "[robust] was stopped: how many builds hold every limit was not judged" in " ".join(out.split())
    whole = (tmp_path / "whole" / "best.toml").read_bytes()
    assert found["before"] == (folder / "best.toml").read_bytes() == whole
    data = json.loads((folder / "results.json").read_text())
    assert (data["robust"], data["catalogue"], data["status"]) == (None, None, "optimal")
    assert not (folder / "robust.toml").exists()


def test_a_job_whose_time_is_over_writes_the_best_so_far(capsys, tmp_path, monkeypatch):
    """SIGTERM, as of a limit on time, within the check, and Ctrl-C alike: nothing had been written."""
    solve, folder = sys.modules["roslf_design.optimization.solve"], tmp_path / "ended"
    check = solve._check

    def late(*arguments):
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(60)  # where the signal arrives
        return check(*arguments)

    before = signal.getsignal(signal.SIGTERM)
    monkeypatch.setattr(solve, "_check", late)
    code, out, _ = run(capsys, "optimize", study(tmp_path, GOOD.replace("check = false", "check = true")), "-o", folder)
    assert code == 130
    assert "it was stopped after" in " ".join(out.split())
    data = json.loads((folder / "results.json").read_text())
    assert data["trust"]["ended_by"] == "stopped"
    assert data["trust"]["checks"] == []
    assert roslf.load(folder / "best.toml").name.endswith("best so far")
    assert signal.getsignal(signal.SIGTERM) == before


def test_a_study_with_everything(capsys, tmp_path):
    traded = 'quantity = "blur_pitches"\nat = "300 mm"\ndirection = "min"'
    text = GOOD.replace('quantity = "views_independent"\ndirection = "max"', traded) + (
        '[pareto]\ngoals = ["sigma_z_mm", "blur_pitches"]\npoints = 4\n'
        '[robust]\ntrials = 64\n[[robust.perturb]]\nplace = "d_2"\ntolerance = "5 um"\n'
        f"[catalogue]\nkeep = 3\n{SENSORS}"
    )
    path = study(tmp_path, text)
    code, out, err = run(capsys, "optimize", path, "-o", tmp_path / "out", "--json")
    assert (code, err) == (0, "")
    found = json.loads(out)
    assert found["status"] == "optimal"
    assert found["trust"]["starts"] == 3  # those asked for, and the design's own
    assert any("outside the bounds" in note for note in found["notes"])
    assert any(a["multiplier"] > 0 for a in found["active"])
    assert len(found["front"]["points"]) >= 3
    assert found["robust"]["robust"]["yield"] > found["robust"]["nominal"]["yield"]
    assert found["catalogue"]["open"] == 0
    names = {place.name for place in (tmp_path / "out").iterdir()}
    assert names >= {
        "results.json",
        "best.toml",
        "robust.toml",
        "index.html",
        "front.png",
        "robust.png",
        "parts-01.toml",
    }
    best = roslf.load(tmp_path / "out" / "best.toml")
    assert pytest.approx(found["variables_mm"]["D_F"]) == best.D_F
    assert found["following_mm"] == {}
    assert 0.98 - 1e-8 <= roslf.evaluate(best, []).f_number.fill_factor <= 1 + 1e-8
    first = {place: place.read_bytes() for place in (tmp_path / "out").rglob("*.*")}
    (tmp_path / "copy").mkdir()
    copied = tmp_path / "copy" / path.name
    copied.write_bytes(path.read_bytes())
    save(PAPER, copied.with_name("given.toml"))
    code, _, err = run(capsys, "optimize", copied, "-o", tmp_path / "out")
    assert code == 2
    assert f"in {path}; delete it or choose another place" in err
    assert run(capsys, "optimize", path, "-o", tmp_path / "out")[0] == 0
    assert first == {place: place.read_bytes() for place in (tmp_path / "out").rglob("*.*")}


def test_a_square_bore_becomes_a_square_pupil(capsys, tmp_path):
    """Of a round one `test_bore.py` has what is reduced."""
    square = {"shape": "rectangle", "sides": (1.0, 1.0), "distance": 100.0}
    save(PAPER.replace({"aperture": square}), tmp_path / "b.toml")
    text = GOOD.replace('D_F = {min = "1 mm", max = "4 mm", start = "9 mm"}\n', "")
    text = text.replace('"paper"', '"b.toml"').replace("seed", f"{FOLLOWS}\nseed")
    text += '[bore.tube]\nshape = "rectangle"\nsides = ["6 mm", "6 mm"]\nlength = "20 mm"\ndistance = "110 mm"\n'
    code, out, err = run(capsys, "optimize", study(tmp_path, text), "-o", tmp_path / "out", "--json")
    assert (code, err) == (0, "")
    bore, best = json.loads(out)["bore"], roslf.load(tmp_path / "out" / "best.toml")
    assert bore["settled"]
    assert best.aperture.sides == pytest.approx([bore["pupil_diameter_mm"]] * 2)
    assert best.d_3 == pytest.approx(bore["pupil_distance_mm"])
    assert 110 <= best.d_3 <= 130
    assert 0 <= bore["worst_kept_difference"] <= bore["worst_misplaced"]
    assert (tmp_path / "out" / "bore.png").exists()


def test_an_order_of_goals_and_goals_that_do_not_compete(capsys, tmp_path, monkeypatch):
    solve = sys.modules["roslf_design.optimization.solve"]  # whose function has its package's name for it
    globally = solve.globally  # a look by each global search, not a whole one
    monkeypatch.setattr(solve, "globally", lambda *args: globally(*args[:4], args[4] // 20, *args[5:]))
    text = "order = 'lexicographic'\nslack = 0.05\n" + GOOD.replace("weight = 0.1", "")
    text = text.replace("check = false", "isres = true")
    text += '[pareto]\ngoals = ["sigma_z_mm", "views_independent"]\npoints = 3\n[catalogue]\nkinds = ["sensors"]\n'
    code, out, err = run(capsys, "optimize", study(tmp_path, text), "-o", tmp_path / "out")
    assert (code, err) == (0, "")
    words = " ".join(out.split())
    assert "do not compete: one design is best in all of them" in words
    assert "ranked by the weighted goals, not by their order" in words
    assert "ISRES" in words
    assert "Lexicographic order" in words


def test_where_bought_parts_do_better_the_answer_says_so(capsys, tmp_path):
    """It stood behind the table of parts alone, and the answer above it was of the design's own part."""
    path = study(tmp_path, f"{GOOD}[catalogue]\n{SENSORS}", design="paper")
    code, out, _ = run(capsys, "optimize", path, "-o", tmp_path)
    assert code == 0
    own, bought = " ".join(out.split()).split("With other parts, first of the list below, it is better: ")
    sigma = [float(re.search(r"at 200 mm = ([\d.]+) mm", words)[1]) for words in (own, bought)]
    assert sigma[1] < sigma[0]


def test_a_limit_that_nothing_varies_is_refused_before_any_search(capsys, tmp_path):
    """It was searched for to the end, and the answer was that it cannot be."""
    more = "[[constraints]]\nquantity = 'q'\nmax = '1 um'\n[[constraints]]\nquantity = 'airy_radius_px'\nmin = 1e3\n"
    code, out, err = run(capsys, "optimize", study(tmp_path, GOOD + more), "-o", tmp_path / "out")
    assert (code, out) == (2, "")
    (first,) = err.splitlines()  # the Airy disc is d_2's, which varies
    assert re.search(
        r"constraints\.\d: q <= 0\.001 mm is missed before any search: sensor\.pixel of .* gives 0\.0048", first
    )
    assert "nothing that varies (" in first
    assert not (tmp_path / "out").exists()


WIDE = """name = "wide"
design = "rigid-scope"
microlens_in_focus = true
variables = {D_F = ["0.2 mm", "1.2 mm"]}
constraints = [{quantity = "u_z_mm", max = "0.02 mm"}, {quantity = "fill_factor", max = 1.0}]
goals = [{quantity = "light_sr", direction = "max"}]
"""


def test_a_limit_on_what_is_infinite_somewhere_is_searched_for(tmp_path):
    """Where images overlap no depth is known; with depth elsewhere that was taken for a value that nothing varies."""
    (tmp_path / "wide.toml").write_text(WIDE)
    problem = load_study(tmp_path / "wide.toml").problem
    ends = problem.constraints[0].values(problem.cameras(np.array([[0.0], [1.0]])))
    assert np.isfinite(ends).tolist() == [True, False]


def test_a_conflict_names_nothing_as_missed_that_is_held():
    """Limits held in all digits told were missed by their words; what a limit comes to without the others says so."""
    far = Violation("detail at 25 mm >=", 5.7473, 12.0, "lp/mm")
    near = Violation("detail at 40 mm >=", 2.4999999, 2.5, "lp/mm")
    conflict = Conflict(np.zeros(1), 1.0, violations=(far, near), clashing=(replace(far, value=9.2286),))
    assert conflict.missed == ""
    assert conflict.reason.endswith("(got 9.2286 lp/mm), all other limits left out")
    assert replace(conflict, clashing=(far,)).reason.endswith("(got 5.7473 lp/mm)")
    missed = replace(conflict, violations=(far, replace(near, value=2.4))).missed
    assert missed == "The least-violating point misses detail at 40 mm >= 2.5 lp/mm (got 2.4 lp/mm) as well."


def test_that_nothing_holds_is_said_where_it_is_proven_alone():
    """Image fill rises with d_2, so that its ends are a proof; of what one field asks there is none, only a search."""

    def fill(d_2):
        return float(roslf.quantity("fill_factor")(Camera.of(PAPER.replace({"d_2": d_2, "D_F": 4.0}))))

    bounds = {"d_2": (0.5, 9.0), "D_F": (1.0, 4.0)}
    alone = posed(bounds, (limit("fill_factor", 1.01 * fill(9.0)),))
    start = [np.full(2, 0.5)]
    proven = explain(alone, start, SearchBudget(), 0)
    assert (proven.proven, "nothing holds" in proven.reason) == (True, True)
    at_field = Constraint(quantity="fill_factor", field=(0.0, 0.0), min=1.01 * fill(9.0))
    searched = explain(posed(bounds, (at_field,)), start, SearchBudget(), 0)
    assert not searched.proven
    assert "no search found a camera that holds" in searched.reason
    # Two that each can be held: no corner excludes either, only ever smaller boxes do.
    both = posed(bounds, (limit("fill_factor", 1.01 * fill(1.0)), limit("d_2", high=1.0)))
    assert "cannot hold together" in explain(both, start, SearchBudget(), 0).reason


def test_an_impossible_study_exits_0_and_says_so(capsys, tmp_path):
    text = GOOD.replace(
        "min = 0.98",
        "min = 0.98\n[[constraints]]\nquantity = 'views_independent'\nmin = 50\n"
        "[[constraints]]\nquantity = 'fill_factor'",
    )
    code, out, err = run(capsys, "optimize", study(tmp_path, text), "-o", tmp_path / "out")
    assert (code, err) == (0, "")
    assert "No design was found" in out
    assert "nothing holds independent views >= 50" in " ".join(out.split()).replace("≥", ">=")
    assert "The least-violating point misses" not in out  # it holds all else
    found = json.loads((tmp_path / "out" / "results.json").read_text())
    assert [one["limit"] for one in found["infeasible"]["violations"]] == ["views_independent >="]
    assert found["status"] == "infeasible"
    assert found["infeasible"]["cannot_hold_together"]
    assert found["active"] is None
    assert not (tmp_path / "out" / "best.toml").exists()
    assert run(capsys, "optimize", tmp_path / "study.toml", "-o", tmp_path / "out", "--strict")[0] == 1


def test_a_study_that_is_stopped_before_a_design_says_so(capsys, tmp_path, monkeypatch):
    conflict = sys.modules["roslf_design.optimization.conflict"]

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(conflict, "_smallest", interrupted)
    more = "[[constraints]]\nquantity = 'views_independent'\nmin = 50\n[[constraints]]\nquantity = 'fill_factor'"
    text = GOOD.replace("min = 0.98", f"min = 0.98\n{more}")
    code, out, err = run(capsys, "optimize", study(tmp_path, text), "-o", tmp_path / "out")
    assert (code, err) == (130, "")
    assert "The search was stopped before a design was met that holds every limit" in " ".join(out.split())
    assert "No design was found" not in out
    found = json.loads((tmp_path / "out" / "results.json").read_text())
    assert (found["status"], found["infeasible"], found["trust"]["ended_by"]) == ("stopped", None, "stopped")
    nearest = roslf.load(tmp_path / "out" / "least-violating.toml")
    assert nearest.name.endswith("least-violating, best so far")
    assert not (tmp_path / "out" / "best.toml").exists()


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "[solver]",
            '[required]\nu_z_mm = {max = "1 mm"}\n[solver]',
            "required: what a design must reach stands with the design; write it in the design's file",
        ),
        (
            'd_2 = ["0.5 mm", "9 mm"]',
            'd_2 = ["9 mm", "0.5 mm"]',
            "variables.d_2: min 9 mm is above",
        ),
        ('d_2 = ["0.5 mm", "9 mm"]', 'd_2 = ["0.5 mm"]', "variables.d_2: ['0.5 mm'] is no pair of bounds"),
        ('d_2 = ["0.5 mm", "9 mm"]', 'd_2 = [0.5, "9 mm"]', "variables.d_2.min: 0.5 has no unit"),
        ("d_2 = [", "d2 = [", "'d2' is nothing that can vary; did you mean 'd_2'?"),
        ("d_2 = [", "tube_length = [", "'tube_length' needs a design with a further stop"),
        ('quantity = "fill_factor"', 'quantity = "fil_factor"', "did you mean 'fill_factor'?"),
        ('quantity = "fill_factor"', 'quantity = "kept_fraction"', "'kept_fraction' differs from field to field"),
        ('at = "200 mm"', 'field = "1 mm"', "sigma_z_mm is one number for the whole field; drop field"),
        ('quantity = "sigma_z_mm"', 'quantity = "sigma_zz"', "did you mean 'sigma_z_mm'?"),
        ('direction = "min"', "", "goals.0.direction: is missing; add it"),
        ('direction = "min"', 'direction = "down"', 'goals.0.direction: "down" is not known; write'),
        ("max = 1.0", "max = 0.5", "fill_factor: min 0.98 is above max 0.5: nothing lies between; did you swap them"),
        ("min = 0.98", "min = -0.98", "fill_factor: min -0.98 limits nothing, fill_factor is above 0; raise it"),
        ('quantity = "non_distortion_room_mm"\nmin = "0 mm"', 'quantity = "d_1"\nmin = 0.1', "0.1 has no unit"),
        (
            'quantity = "non_distortion_room_mm"\nmin = "0 mm"',
            'quantity = "fill_factor"\nmin = 1.2',
            "fill_factor >= 1.2 contradicts 0.98 <= fill_factor <= 1: nothing lies between",
        ),
        ('min = "0 mm"', "min = false", "expected a length"),
        ('min = "0 mm"', "", "non_distortion_room_mm has no limit"),
        ('at = "200 mm"', 'at = "200 mm"\ncolour = 1', "goals.0.colour: is not a known key"),
        ("weight = 0.1", 'weight = 0.1\nat = "3 mm"', "views_independent is not asked for at a distance"),
        (
            "weight = 0.1",
            "weight = 0.1\n[pareto]\ngoals = ['sigma_z_mm', 'views_indep']",
            "did you mean 'views_independent'?",
        ),
        ('design = "paper"', 'design = "papr.toml"', "design: papr.toml: no such file"),
        ("weight = 0.1", "weight = 0.1\n[bore]", "a bore is a tube or a list of stops"),
        (
            "weight = 0.1",
            "weight = 0.1\n[bore]\nstops = [{diameter = '3 mm', distance = '9 mm'}]",
            "'D_F' varies, but the bore gives it",
        ),
        ("weight = 0.1", "weight = 0.1\n[catalogue]\nfiles = ['none.toml']", "none.toml: no such file"),
        ("[solver]", "[[robust.perturb]]\nplace = 'd_4'\ntolerance = '1 um'\n[solver]", "robust.perturb.0"),
    ],
)
def test_bad_input_is_one_line_and_exit_2(capsys, tmp_path, old, new, said):
    assert old in GOOD
    path = study(tmp_path, GOOD.replace(old, new, 1))
    code, out, err = run(capsys, "optimize", path, "-o", tmp_path / "out")
    assert (code, out) == (2, "")
    assert said in err
    lines = err.strip().splitlines()
    assert len(lines) == 1
    assert lines[0].startswith(f"roslf: {path}: ")
    assert not (tmp_path / "out").exists()


def test_names_units_and_flags_are_told_together(capsys, tmp_path):
    text = GOOD.replace('["0.5 mm", "9 mm"]', '["1 lx", "9 mm"]').replace("D_F = {", "D_G = {")
    text = text.replace('"fill_factor"', '"fil_factor"').replace("check = false", 'check = "no"\nisres = 1')
    text = f'required = "yes"\n{text}'
    robust = '[[robust.perturb]]\nplace = "D_F"\ntolerance = "1 lx"\n'
    code, _, err = run(capsys, "optimize", study(tmp_path, text + robust), "-o", tmp_path / "out")
    told = ["d_2.min: ", "required: must be", "fil_factor", "check: must be true or false, got 'no'", "got 1", "'D_G'"]
    assert code == 2
    assert not (tmp_path / "out").exists()
    assert all(words in err for words in [*told, "robust.perturb.0: "])
    assert len(err.strip().splitlines()) == len(told) + 1


def test_a_bore_beyond_the_focus_and_a_file_in_the_way(capsys, tmp_path):
    text = GOOD.replace('D_F = {min = "1 mm", max = "4 mm", start = "9 mm"}\n', "")
    path = study(tmp_path, text + '[bore.tube]\ndiameter = "6 mm"\nlength = "400 mm"\ndistance = "110 mm"\n')
    code, _, err = run(capsys, "optimize", path, "-o", tmp_path / "out")
    assert code == 2
    assert "bore" in err
    assert len(err.strip().splitlines()) == 1
    code, _, err = run(capsys, "optimize", path, "-o", path)
    assert code == 2
    assert "is a file, not a folder" in err
    assert run(capsys, "optimize", path, "-o", tmp_path / "out", "--seed", "-1")[0] == 2


def test_catalogue_command(capsys):
    code, out, err = run(capsys, "catalogue", "--kind", "sensors", "--where", "pixels>=4000", "--json")
    assert (code, err) == (0, "")
    assert [row["part"] for row in json.loads(out)["parts"]] == ["IMX541", "IMX540", "EOS 90D sensor"]  # by size
    code, out, _ = run(capsys, "catalogue")
    assert code == 0
    assert "MLA150-5C" in out
    assert "unverified" in out
    told = [run(capsys, "catalogue", "--kind", kind, "--json")[:2] for kind in ("arrays", "microlens_arrays")]
    assert told[0] == told[1]
    assert told[0][0] == 0
    code, out, _ = run(capsys, "catalogue", "--kind", "lenses", "--where", "diameter<=1 mm", "--where", "maker=Foo")
    diameters = [row["diameter"] for row in rows(load_catalogue([]), ["lenses"])]
    assert f"0 of {len(diameters)} parts" in out
    assert f"{min(diameters):g} mm to {max(diameters):g} mm" in out
    code, out, err = run(capsys, "catalogue", "--where", "ptch<1 mm")
    assert (code, out) == (2, "")
    assert "did you mean 'pitch'?" in err


BARE = """
name = "bare"
design = "paper"
[variables]
VARIABLES
[[goals]]
GOAL
[solver]
starts = 3
check = false
"""


@pytest.mark.parametrize(
    ("variables", "goal", "said"),
    [
        # Light grows with D_F squared, sigma_Z falls with 1/D_F: only the bound stops them.
        ('D_F = ["1 mm", "8 mm"]', 'quantity = "light_sr"\ndirection = "max"', "save the bound D_F <= 8 mm"),
        ('D_F = ["1 mm", "8 mm"]\nd = ["50 um", "90 um"]', 'quantity = "sigma_z_mm"\ndirection = "min"',
         "save the bounds D_F <= 8 mm and d >= 0.05 mm"),
        # At the lens every field is undistorted: infinity at a bound; where images have no pitch, a pole inside.
        ('d_3 = ["0 mm", "200 mm"]', 'quantity = "undistorted_field_mm"\ndirection = "max"',
         "Unbounded objective: the bound d_3 >= 0 mm stopped it"),
        ('d_2 = ["0.1 mm", "1000 mm"]', 'quantity = "fill_factor"\ndirection = "max"',
         "Unbounded objective: the search stopped it"),
    ],
)  # fmt: skip
def test_a_goal_that_only_a_bound_stops_is_told_so(capsys, tmp_path, variables, goal, said):
    text = BARE.replace("VARIABLES", variables).replace("GOAL", goal)
    code, out, err = run(capsys, "optimize", study(tmp_path, text), "-o", tmp_path / "out")
    assert (code, err) == (0, "")
    first = " ".join(out.split("starts ended")[0].split()).replace("≤", "<=").replace("≥", ">=")
    assert said in first
    assert "best found" not in first
    assert "kink" not in out


def test_an_optimum_between_its_bounds_is_best_found(capsys, tmp_path):
    path = study(tmp_path, GOOD.replace('"0.5 mm", "9 mm"', '"0.5 mm", "90 mm"'))
    _, out, _ = run(capsys, "optimize", path, "-o", tmp_path / "out")
    assert "best found" in out


def test_a_share_is_told_as_it_was_applied(capsys, tmp_path):
    robust = "\n[robust]\ntrials = 32\n[[robust.perturb]]\nplace = 'f'\ntolerance = '0.2 %'\n"
    text = BARE.replace("VARIABLES", 'f = ["60 mm", "90 mm"]').replace(
        "GOAL", "quantity = 'sigma_z_mm'\ndirection = 'min'"
    )
    _, out, _ = run(capsys, "optimize", study(tmp_path, text + robust), "-o", tmp_path / "out", "--json")
    found = json.loads(out)
    (miss,) = found["robust"]["perturbations"]
    assert miss["tolerance"] == pytest.approx(0.002 * found["robust"]["robust_variables_mm"]["f"], rel=1e-9)
    assert miss["tolerance_nominal"] == pytest.approx(0.002 * found["variables_mm"]["f"], rel=1e-9)


def test_a_design_that_no_search_ended_at_is_said_to_be_met_on_the_way():
    """`0 of 2 starts ended at this design (0 at a feasible one)` stood beside a design that holds every limit."""
    result = run_study(read_study(tomllib.loads(GOOD), design=PAPER))
    lost = replace(result.answer, searches=tuple(replace(one, violation=1.0) for one in result.answer.searches))
    told = " ".join(one.text for one in statements(replace(result, answer=lost)))
    assert f"None of {len(lost.searches)} starts ended at a feasible design: this one was met on the way;" in told


def test_a_page_shows_the_camera_before_and_after_and_what_a_yield_of_depth_leaves_out():
    """The drawing and its words are of what was and what is found; u with lengths is that of the robust design."""
    asked = {"quantity": "u_z_mm", "at": "300 mm", "max": "9 mm"}
    miss = {"place": "d_2", "tolerance": "5 um", "distribution": "uniform"}
    tables = {"robust": {"trials": 32, "perturb": [miss]}, "constraints": [asked]}
    result = run_study(read_study(tomllib.loads(GOOD) | tables, design=PAPER))
    (section,) = optimization_report(result, "").sections
    first, picture = section.blocks[:2]
    assert (type(first), len(first.items), picture.title) == (Statements, 1, "Before and after")
    best, robust = (dict(result.designs())[f"{name}.toml"] for name in ("best", "robust"))
    assert f"D_F {PAPER.D_F:.4g} → {best.D_F:.4g} mm" in picture.caption
    assert f"{PAPER.name} and {best.name}" in picture.content
    spread = LengthCovariance(("sensor.distance",), np.array([[0.005**2 / 3]]))
    u = float(depth_budget(Camera.of(robust), 300.0, build=spread).u_z_mm)
    told = [one.text for one in statements(result) if one.text.startswith("Of Monte Carlo units")]
    assert f"nobody calibrates, u = {u:.3g} mm at 300 mm" in told[0]
    (table,) = (block for block in section.blocks if isinstance(block, Table) and block.title == "The design")
    row = next(row for row in table.rows if row[0] == "D_F")
    assert row[table.headings.index("before")] == f"{PAPER.D_F:.5g}"


@pytest.mark.parametrize("environment", [None, {"temperature": 45.0, "housing": "aluminium"}])
def test_lengths_at_the_use_s_temperature_and_in_the_file_are_told_where_they_differ_in_print(tmp_path, environment):
    base = PAPER if environment is None else PAPER.replace({"environment": environment})
    result = run_study(read_study(tomllib.loads(GOOD), design=base))
    (section,) = optimization_report(result, "").sections
    (table,) = (block for block in section.blocks if isinstance(block, Table) and block.title == "The design")
    assert ("in the file" in table.headings) == bool(environment) == bool(table.caption)
    if environment is None:
        return
    assert table.caption.startswith("Values and bounds are those at 45 °C")
    files = dict(result.designs())
    written = tomllib.loads(dumps(files["best.toml"], WRITTEN))
    told = {row[0]: row[table.headings.index("in the file")] for row in table.rows}
    assert told["D_F"] == f"{parse_quantity(written['aperture']['diameter'], 'length'):.5g}"
    found = {row[0]: row[table.headings.index("value")] for row in table.rows}
    assert found["D_F"] == f"{files['best.toml'].D_F:.5g}" != told["D_F"]


def test_words_below_the_table_of_parts_are_its_own():
    """They were those on active constraints, where there are any."""
    text = f"{GOOD}[catalogue]\n{SENSORS}"
    result = run_study(read_study(tomllib.loads(text), design=PAPER))
    (section,) = optimization_report(result, "").sections
    captions = {block.title: block.caption for block in section.blocks if isinstance(block, Table)}
    assert captions["Active constraints"].startswith("Multiplier: ")
    assert captions["The design"] == ""
    assert captions["Parts"].startswith("Full well by area of pixels, as nobody states it: ")


def test_a_length_of_zero_needs_no_unit():
    plain = GOOD.replace("d_2 = [", "d_3 = [0, '8 mm']\nd_2 = [").replace('min = "0 mm"', "min = 0")
    read, other = (read_study(tomllib.loads(text)) for text in (plain, plain.replace("0, '8", "'0 um', '8")))
    assert read.problem.variables == other.problem.variables
    assert [c.min for c in read.problem.constraints] == [0.98, 0.0]


def test_bought_arrays_out_of_focus_are_named_with_the_constraint_that_keeps_them_in_it(capsys, tmp_path):
    text = GOOD + '[catalogue]\nkinds = ["microlens_arrays"]\nkeep = 4\n'
    code, out, _ = run(capsys, "optimize", study(tmp_path, text), "-o", tmp_path / "out")
    assert code == 0
    words = " ".join(out.split())
    defocus = roslf.quantity("microlens_defocus_px")
    designs = {place.stem: roslf.load(place) for place in sorted((tmp_path / "out").glob("parts-*.toml"))}
    cameras = {name: roslf.Camera.of(design) for name, design in designs.items()}
    blurred = {
        name: float(defocus(c))
        for name, c in cameras.items()
        if float(defocus(c)) > math.hypot(1, float(c.wavelength * c.d_2 / c.d / c.q))
    }
    assert blurred
    assert all((f"{name} by {blurred.get(name, 0.0):.3g} px" in words) == (name in blurred) for name in cameras)
    assert "The best above chooses none: it has the microlens array of the base design" in words
    most = float(re.search(r'quantity = "microlens_defocus_px", max = ([0-9.]+[0-9])', words)[1])
    held = text + f'[[constraints]]\nquantity = "microlens_defocus_px"\nmax = {most}\n'
    code, out, _ = run(capsys, "optimize", study(tmp_path, held, "held.toml"), "-o", tmp_path / "held")
    assert code == 0
    assert "out of focus" not in out


def test_an_optimum_is_judged_by_what_its_design_requires(capsys, tmp_path):
    """Not by the study's limits alone, until the study takes those of the design over; `evaluate` says the same."""
    asked = {"working_distance_mm": {"max": "225 mm"}, "views_independent": {"min": 3.0}}
    save(PAPER.replace({"required": asked}), tmp_path / "paper.toml")
    text = (
        'name = "far"\ndesign = "paper.toml"\n{}\n[variables]\nd_f = ["250 mm", "400 mm"]\n'
        '[[goals]]\nquantity = "sigma_z_mm"\nat = "100 mm"\ndirection = "min"\n[solver]\nstarts = 2\ncheck = false\n'
    )
    for key, mark in (("", "✗"), ("required = true", "✓")):
        code, out, _ = run(capsys, "optimize", study(tmp_path, text.format(key)), "-o", tmp_path / "out")
        first = re.sub(r"\s+", " ", out.removeprefix("far\n")).split(" starts ended")[0]
        held = roslf.evaluate(tmp_path / "out" / "best.toml").required
        judged = json.loads((tmp_path / "out" / "results.json").read_text())["required"]["best"]
        assert (code, [one["met"] for one in judged]) == (0, [one.met for one in held])
        assert all(one.met for one in held) == (mark == "✓"), held
        if mark == "✗":
            assert first.startswith("✗ best.toml misses what its [required] asks for: working distance ")
            assert "(at most 225 mm)" in first
            assert "required = true" in first
            assert "independent views" not in first
        else:
            assert first[0] in "✓!"
            assert "best.toml is all that its [required] asks for" in first
    code, _, err = run(capsys, "optimize", study(tmp_path, f"required = true\n{GOOD}"), "-o", tmp_path)
    assert code == 2
    assert "required: " in err
    assert "has no [required]" in err


def test_an_optimum_by_views_is_a_camera_that_has_views():
    """Out of the microlenses' focus pixels are no views, whatever closed forms make of them."""
    base = roslf.load("rigid-scope").replace({"depth.disparity_error": 0.1})
    data = {
        "name": "long", "design": "", "variables": {"d_2": ["0.06 mm", "2 mm"]},
        "goals": [{"quantity": "views_independent", "direction": "max"}], "solver": {"starts": 2, "check": False},
    }  # fmt: skip
    (best,) = (design for _, design in run_study(read_study(data, design=base)).designs())
    assert bool(has_views(Camera.of(best)))
    assert float(pupil_blur_ratio(Camera.of(best))) == pytest.approx(LIMIT, rel=1e-3)


def test_what_a_working_distance_was_before_is_told():
    """It is no length of a design file, but the distance of its focal plane from the tip."""
    design = roslf.load("arthroscope")
    before = posed({}, (), design=design).before(("working_distance", "d_2"))
    told = roslf.evaluate(design).answer.working_distance_mm
    assert before == {"working_distance": pytest.approx(told), "d_2": design.d_2}


def test_faults_of_the_optimum_that_no_limit_asked_for_are_told():
    asked = {"name": "wide", "variables": {"D_F": ["3 mm", "6 mm"]}, "solver": {"starts": 1, "check": False}}
    asked["goals"] = [{"quantity": "D_F", "direction": "max"}]
    for quantity, wrong in (("fill_factor", 0), ("D_F", 1)):  # a limit of what it says, and of something else
        limit = {"quantity": quantity, "max": 1.0 if quantity == "fill_factor" else "6 mm"}
        result = run_study(read_study({**asked, "design": "paper", "constraints": [limit]}))
        told = [said.text for said in statements(result) if "finds a fault: f-number not matched" in said.text]
        assert len(told) == wrong
