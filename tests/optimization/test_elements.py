"""Optimising what stands before the main lens: variables, what keeps parts apart, distances in the medium, parts."""

import json
from dataclasses import replace

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.catalogue import load_catalogue
from roslf_design.cli import main
from roslf_design.design import save
from roslf_design.errors import InputError
from roslf_design.optimization.bounds import _bound, prunable
from roslf_design.optimization.solve import Settings, solve
from roslf_design.optimization.study import load_study
from roslf_design.optimization.variables import name_faults
from tests.optimization.posing import PAPER, goal, limit, posed

QUICK = Settings(starts=4, check=False, isres=False)
TWICE = QUICK.model_copy(update={"starts": 2})


@pytest.fixture(scope="module")
def windowed():
    """A FAP and a window before it, in water."""
    return PAPER.replace(
        {
            "aperture.distance": 116.0,
            "elements": [
                {"kind": "plate", "distance": 118.0, "thickness": 1.0, "material": {"index": 1.5}, "diameter": 8.0},
                {"kind": "lens", "distance": 60.0, "focal_length": 300.0, "diameter": 40.0},
            ],
            "object_space.medium": {"index": 1.333},
        }
    )


def test_working_distances_are_real_ones_from_the_farthest_element(windowed):
    problem = posed(
        {"working_distance": (20, 80), "elements.0.distance": (117, 140), "elements.0.thickness": (0.5, 3)},
        (),
        goal("sigma_z_mm", "min"),
        design=windowed,
    )
    cameras = problem.cameras(np.array([[0.0, 0.0, 0.0], [0.5, 0.5, 0.0], [1.0, 1.0, 1.0]]))
    ends = cameras["elements.0.distance"] + cameras["elements.0.thickness"]
    assert np.allclose(cameras["main_lens.focal_plane"] - ends, roslf.quantity("working_distance_mm")(cameras))
    assert cameras["main_lens.focal_plane"] - ends == pytest.approx([20, 40, 80], rel=1e-12)  # bounds 4 apart: log
    one = problem.design_at(np.array([1.0, 1.0, 1.0]))
    assert one.d_f == pytest.approx(140 + 3 + 80, rel=1e-12)


def test_elements_and_stops_are_kept_apart(windowed):
    """Pushed into the FAP on one side, into the lens on the other: it stops where glass would touch."""
    behind = posed(
        {"aperture.distance": (50, 150), "d_2": (1.9, 2.1)}, (), goal("aperture_constant", "max"), design=windowed
    )
    answer = solve(behind, QUICK, lambda *_: None)
    assert answer.feasible
    d_3 = behind.named(answer.unit)["aperture.distance"]
    assert d_3 <= 118
    assert d_3 == pytest.approx(118, rel=1e-5)
    behind.design_at(answer.unit)  # is a design
    moved = posed(
        {"elements.1.distance": (20, 150), "d_2": (1.9, 2.1)}, (), goal("total_length_mm", "min"), design=windowed
    )
    labels = [row.label for row in moved.rows]
    assert "lens 2 clear of plate 1" in labels
    assert "FAP clear of lens 2" in labels
    assert "FAP clear of plate 1" not in labels  # neither moves
    units = np.linspace(0, 1, 60)[:, None] * np.array([1.0, 0.0]) + np.array([0.0, 0.5])
    rows, valid = moved.rows_of(moved.cameras(units), 60), moved.cameras(units).valid
    assert np.array_equal(np.all(rows[:, valid] <= 0, axis=0), np.ones(valid.sum(), bool))
    assert 0 < valid.sum() < 60


def test_an_optimum_through_glass_is_where_brute_force_finds_it(windowed):
    """The deepest view of an image fill of one through a window and a relay whose place may change."""
    problem = posed(
        {"elements.1.focal_length": (150, 600), "D_F": (1.0, 4.0), "elements.0.thickness": (0.5, 1.5)},
        (limit("fill_factor", 0.98, 1.0),),
        goal("sigma_z_mm", "min"),
        design=windowed,
    )
    answer = solve(problem, QUICK, lambda *_: None)
    assert answer.feasible
    grid = np.stack(np.meshgrid(*[np.linspace(0, 1, 41)] * 3, indexing="ij"), -1).reshape(-1, 3)
    vector = problem.vector(grid)
    good = np.all(vector[1:] <= 0, axis=0) & problem.cameras(grid).valid
    assert good.any()
    assert answer.merit <= np.min(vector[0][good]) + 1e-9
    sigma = problem.number(problem.goals[0], answer.unit)
    design = problem.design_at(answer.unit)
    assert roslf.evaluate(design).depth.sigma_z_mm == pytest.approx(sigma, rel=1e-9)


def test_names_that_vary(windowed):
    numbers = Camera.of(windowed).numbers
    good = ("elements.0.distance", "elements.0.thickness", "elements.1.focal_length", "elements.0.diameter")
    assert not [*name_faults(good, numbers)]
    for name in ("elements.0.index", "elements.0.wedge.0", "object_space.index", "elements.1.thickness"):
        assert "is nothing that can vary" in next(name_faults((name,), numbers))


def test_largest_diameter_counts_every_element(windowed):
    """Two rows for each plate, whose faces are two rims: 0.1 left the last ones out."""
    problem = posed(
        {"elements.0.diameter": (5, 80), "D_F": (1, 4)},
        (limit("largest_diameter_mm", high=60.0),),
        goal("sigma_z_mm", "min"),
        design=windowed,
    )
    wide = np.array([[1.0, 0.5]])
    assert np.any(problem.vector(wide)[1:] > 0)


@pytest.mark.parametrize("medium", [1.0, 1.45])
def test_boxes_bound_what_is_seen_through_a_window(windowed, medium):
    """Nothing that random cameras in boxes reach lies below the bound; a relay or moving glass bounds nothing."""
    flat = windowed.replace({"elements": [windowed.elements[0]], "object_space.medium": {"index": medium}})
    problem = posed(
        {"d_3": (20, 117), "D_F": (1, 5), "d_2": (1, 4), "d_f": (125, 400), "f": (60, 118)},
        (limit("fill_factor", 0.5, 2.0), limit("total_length_mm", high=330.0)),
        goal("sigma_z_mm", "min"),
        design=flat,
    )
    assert prunable(problem, problem.goals[0])

    class Alone:
        def __init__(self, problem):
            self.problem = problem

        def values(self, _owner):
            return {}

    stream = np.random.default_rng(3)
    low = stream.uniform(0, 0.8, (150, 5))
    high = low + stream.uniform(0.02, 0.2, (150, 5))
    bounds = _bound(Alone(problem), np.zeros(150, np.intp), low, high)
    assert np.isfinite(bounds).any()
    for k in range(150):
        inside = low[k] + stream.uniform(0, 1, (400, 5)) * (high[k] - low[k])
        vector, valid = problem.vector(inside), problem.cameras(inside).valid
        good = valid & np.all(vector[1:] <= 0, axis=0)
        if good.any():
            assert bounds[k] <= np.min(vector[0][good]) + 1e-9, k
    assert not prunable(posed({"d_2": (1, 4)}, (), goal("sigma_z_mm", "min"), design=windowed), problem.goals[0])
    moving = posed({"elements.0.thickness": (0.5, 4)}, (), goal("sigma_z_mm", "min"), design=flat)
    assert not prunable(moving, problem.goals[0])


WINDOWS = """
name = "window"
design = "scope.toml"
[variables]
d_2 = ["1 mm", "4 mm"]
D_F = ["1 mm", "6 mm"]
working_distance = ["60 mm", "90 mm"]
[[constraints]]
quantity = "fill_factor"
min = 0.98
max = 1.0
[[constraints]]
quantity = "non_distortion_room_mm"
min = "0 mm"
[[constraints]]
quantity = "total_length_mm"
max = "400 mm"
[[goals]]
quantity = "sigma_z_mm"
direction = "min"
[solver]
starts = 3
check = false
[catalogue]
kinds = ["windows"]
keep = 3
"""


def test_windows_are_chosen_for_a_plate(windowed, tmp_path, capsys):
    """The best three of some in each glass, each optimised alone by hand; files hold the glass by its name."""
    flat = windowed.replace({"elements": [{**dict(windowed.elements[0]), "diameter": None}]})
    save(flat, tmp_path / "scope.toml")
    (tmp_path / "study.toml").write_text(WINDOWS + 'where.windows = ["diameter>=3 mm", "diameter<=5 mm"]\n')
    assert main(["optimize", str(tmp_path / "study.toml"), "-o", str(tmp_path / "out"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["catalogue"]
    every = []
    study = load_study(tmp_path / "study.toml")
    parts = [part for part in load_catalogue().windows if 3 <= part.diameter <= 5]
    assert told["combinations"] == len(parts) == 7
    assert told["open"] == 0
    for part in parts:
        glass = {"thickness": part.thickness, "material": part.material, "diameter": part.aperture}
        design = flat.replace({f"elements.0.{name}": value for name, value in glass.items()})
        answer = solve(replace(study.problem, design=design), TWICE, lambda *_: None)
        if answer.feasible:
            every.append((answer.number(answer.asked.goals[0]), part.part))
    best = [row["goals"]["sigma_z_mm"] for row in told["best"]]
    assert best == pytest.approx([value for value, _ in sorted(every)[:3]], rel=1e-5)
    chosen = {part.part: part for part in parts}[told["best"][0]["parts"]["windows"]]
    design = roslf.load(tmp_path / "out" / "parts-01.toml")
    plate = design.elements[0]
    assert (plate.material, plate.thickness, plate.diameter) == (chosen.material, chosen.thickness, chosen.aperture)
    assert plate.material.name in (tmp_path / "out" / "parts-01.toml").read_text()
    assert roslf.evaluate(design).depth.sigma_z_mm == pytest.approx(best[0], rel=1e-9)


def test_windows_that_fit_no_plate_are_told(windowed, tmp_path, capsys):
    two = {"kind": "plate", "distance": 30.0, "thickness": 1.0, "material": "N-BK7"}
    for design, key, said in (
        (roslf.load("paper"), "", "the design has none; add one"),
        (windowed.replace({"elements": [*windowed.elements, two]}), "", "element = 0 or 2"),
        (windowed, "element = 1", "element = 0"),
    ):
        save(design, tmp_path / "scope.toml", overwrite=True)
        (tmp_path / "study.toml").write_text(WINDOWS + key)
        assert main(["optimize", str(tmp_path / "study.toml"), "-o", str(tmp_path / "out")]) == 2
        err = capsys.readouterr().err
        assert said in err
        assert len(err.splitlines()) == 1


def test_the_windows_that_ship():
    """Of each material sizes that fit a bore, every one with its provenance; what the optimiser gets is its glass."""
    parts = load_catalogue().windows
    assert {part.material.name for part in parts} == {"sapphire", "F_SILICA", "N-BK7"}
    assert min(part.diameter for part in parts) <= 2
    assert all(part.provenance for part in parts)
    assert {part.confidence for part in parts if not part.maker} == {"typical"}
    assert next(p for p in parts if p.part == "16005-0540").aperture == pytest.approx(0.9 * 12.7)


def test_a_study_says_what_does_not_vary(windowed, tmp_path, capsys):
    save(windowed, tmp_path / "scope.toml")
    (tmp_path / "study.toml").write_text(
        'name = "s"\ndesign = "scope.toml"\n[variables]\n"elements.0.index" = ["1.4 mm", "1.6 mm"]\n'
        '[[goals]]\nquantity = "sigma_z_mm"\ndirection = "min"\n'
    )
    assert main(["optimize", str(tmp_path / "study.toml"), "-o", str(tmp_path / "out")]) == 2
    err = capsys.readouterr().err
    assert "'elements.0.index' is nothing that can vary" in err
    assert len(err.splitlines()) == 1


def test_glass_in_one_another_is_refused(windowed):
    with pytest.raises(InputError):
        windowed.replace({"elements.1.distance": 118.5})


def test_a_lens_that_diverges_may_vary(windowed):
    """Its focal length against a scan of Camera's own numbers; towards 0 from below it is the strongest lens."""
    problem = posed(
        {"elements.1.focal_length": (-900, -150), "d_2": (1.9, 2.1)},
        (),
        goal("field_half_width_mm", "max"),
        design=windowed,
    )
    values = np.linspace(-900, -150, 400)
    changes = {"elements.1.focal_length": values, "d_1": windowed.d_1}
    cameras = Camera.of(windowed, changes)
    widths = np.where(cameras.valid, roslf.quantity("field_half_width_mm")(cameras), -np.inf)
    answer = solve(problem, TWICE, lambda *_: None)
    assert answer.feasible
    chosen = problem.named(answer.unit)["elements.1.focal_length"]
    assert chosen < 0
    width = float(roslf.quantity("field_half_width_mm")(problem.cameras(answer.unit)))
    assert width >= widths.max() * (1 - 1e-6)


@pytest.mark.parametrize(
    ("place", "bounds", "said"),
    [
        ("f", '["-80 mm", "-20 mm"]', "min must not be negative; only an element's focal length may be"),
        ("elements.1.focal_length", '["-80 mm", "20 mm"]', "hold 0 between them; keep to one sign"),
        ("elements.1.focal_length", '["0 mm", "20 mm"]', "min must be greater than zero"),
        (
            "elements.1.focal_length",
            '["-20 mm", "-80 mm"]',
            "min -20 mm is above max -80 mm: nothing lies between; did you swap them?",
        ),
    ],
)
def test_bounds_that_no_lens_has_are_refused(capsys, tmp_path, windowed, place, bounds, said):
    save(windowed, tmp_path / "design.toml")
    text = f'design = "design.toml"\n[variables]\n"{place}" = {bounds}\n[[goals]]\nquantity = "sigma_z_mm"\n'
    (tmp_path / "study.toml").write_text(f'name = "x"\nquestion = "x"\n{text}direction = "min"\n')
    assert main(["optimize", str(tmp_path / "study.toml"), "-o", str(tmp_path / "out")]) == 2
    assert said in capsys.readouterr().err
