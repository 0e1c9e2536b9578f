"""Choosing and shaping a real main lens: against differential evolution over designs traced one at a time."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import differential_evolution

import roslf_design as roslf
from roslf_design.catalogue import load_catalogue
from roslf_design.cli import main
from roslf_design.design import preset_path
from roslf_design.errors import InputError
from roslf_design.lenses.glass import find_glass
from roslf_design.lenses.lens_file import load_lens, shipped_names
from roslf_design.lenses.prescription import Prescription, Surface, first_order
from roslf_design.optimization import Constraint, Goal, Settings, solve
from roslf_design.optimization.combinations import CatalogueTable, Combinations
from roslf_design.optimization.lens_variables import BENDING, FOCAL, LensVariation, with_glasses
from roslf_design.optimization.ranking import _Ranker, rank
from roslf_design.optimization.search import SearchBudget
from roslf_design.optimization.traces import FieldTraces
from roslf_design.optimization.variables import NumberVariable
from roslf_design.traced.camera import camera_of, microlenses
from roslf_design.traced.images import real_images
from tests.optimization.posing import posed
from tests.traced.brute import lit_part

SINGLET = roslf.load("paper-singlet").replace({"depth.disparity_error": 0.1})
FIELDS = ((0.0, 0.0), (11.0, 7.0))
GREEN = SINGLET.wavelength
DOUBLET = load_lens("AC254-100-A")


def shape_factor(lens):
    """(R_2 + R_1)/(R_2 - R_1) of the outer surfaces."""
    first, last = lens.surfaces[0].curvature, lens.surfaces[-1].curvature
    return (first + last) / (first - last)


def images(design, fields=FIELDS, points=64):
    """The fields of one design, integrated ray by ray."""
    return real_images(camera_of(design), microlenses(design, np.array(fields)), points=points)


def fill_factor(design, field):
    """Diameter of an image, integrated ray by ray, over the distance of its neighbours' centres half a pitch away."""
    steps = np.array([(-1, 0), (1, 0), (0, -1), (0, 1)]) * design.d / 2
    places = microlenses(design, np.asarray(field) + steps)
    west, east, south, north = places + real_images(camera_of(design), places, points=64).chief
    pitch = np.sqrt(abs(np.linalg.det(np.stack([east - west, north - south]))))
    return float(images(design, (field,), points=256).diameter[0] / pitch)


def test_a_large_part_of_an_image_cut_away_is_told():
    """Where rims of a small achromat leave half of a wide pencil: against thousands of spokes."""
    scope = roslf.load("studies/optimize-real-lens/start.toml")
    changes = {"aperture.diameter": 4.0, "aperture.distance": 9.2, "microlens_array.distance": 13.4}
    design = scope.replace({"main_lens.prescription": load_lens("AC050-010-A"), "main_lens.diameter": 4.5, **changes})
    fields = ((0.0, 0.0), (1.4, 1.05))
    traces = FieldTraces(design, fields, roslf.Camera.of(design, {"d_2": np.array([design.d_2])}))
    for field, most in zip(fields, (1.0, 0.7), strict=True):
        area, _, kept = lit_part(camera_of(design), microlenses(design, np.array(field)))
        assert 0.3 < kept < most + 1e-5
        assert traces.at(roslf.quantity("kept_fraction"), field)[0] == pytest.approx(kept, abs=1e-5)
        assert traces.at(roslf.quantity("image_area_mm2"), field)[0] == pytest.approx(area, rel=1e-5)


def thick_singlet(factor, focal_length, glass="N-BK7", thickness=9.69, diameter=50.8):
    """A singlet of a shape factor and a focal length, by the lensmaker's equation, quadratic in the curvatures."""
    n = float(find_glass(glass).index(GREEN))
    first, last = factor + 1, factor - 1  # in units of half the difference of curvatures
    bend = np.roots([(n - 1) ** 2 * thickness / n * first * last, 2 * (n - 1), -1 / focal_length])
    half = bend[np.argmin(np.abs(bend - 1 / (2 * (n - 1) * focal_length)))] if bend.size > 1 else bend[0]
    front = Surface(half * first, diameter / 2, thickness, find_glass(glass))
    return Prescription((front, Surface(half * last, diameter / 2)), name="by the lensmaker")


@pytest.mark.parametrize("factor", [-2.5, -1.0, -0.3, 0.0, 1.0, 2.0])
def test_bending_is_the_lensmakers(factor):
    """Curvatures, focal length and principal planes, against the quadratic equation and the lens traced as drawn."""
    drawn = load_lens("LA1050-A")
    varied = LensVariation(drawn, GREEN, 100.0).at({BENDING: np.array([factor, 0.4]), FOCAL: np.array([123.0, 80.0])})
    other = thick_singlet(factor, 123.0)
    assert varied.places["surfaces.1.curvature"][0] == pytest.approx(other.surfaces[0].curvature, rel=1e-12, abs=1e-15)
    assert varied.places["surfaces.2.curvature"][0] == pytest.approx(other.surfaces[1].curvature, rel=1e-12, abs=1e-15)
    gauss = first_order(other, GREEN)
    ours = [float(part[0]) for part in (varied.focal_length, varied.front_principal, varied.rear_principal)]
    assert ours == pytest.approx([123.0, gauss.front_principal, gauss.rear_principal], rel=1e-12, abs=1e-12)


def test_a_bent_doublet_keeps_its_focal_length_and_to_first_order_its_glasses_powers():
    variation = LensVariation(DOUBLET, GREEN, first_order(DOUBLET, GREEN).focal_length)
    lens = variation.prescription({BENDING: 0.2})
    assert shape_factor(lens) == pytest.approx(0.2, rel=1e-12)
    assert first_order(lens, GREEN).focal_length == pytest.approx(variation.focal_length, rel=1e-12)
    drawn, bent = ([s.curvature for s in each.surfaces] for each in (DOUBLET, lens))
    powers = np.diff(drawn)[:, None], np.diff(bent)[:, None]
    assert powers[1] / powers[0] == pytest.approx(np.full((2, 1), powers[1][0, 0] / powers[0][0, 0]), rel=1e-9)


def test_other_glasses_keep_focal_length_and_shape():
    drawn = first_order(DOUBLET, GREEN).focal_length
    for names in (("N-BK7", "SF5"), ("N-LAK22", "N-SF6")):
        lens = with_glasses(DOUBLET, [find_glass(name) for name in names], GREEN)
        assert [surface.glass.name for surface in lens.surfaces[:2]] == list(names)
        assert first_order(lens, GREEN).focal_length == pytest.approx(drawn, rel=1e-12)
        assert shape_factor(lens) == pytest.approx(shape_factor(DOUBLET), rel=1e-9)


def test_no_bending_is_better_than_ours():
    """The widest image on the axis whose twin at the corner fits the pitch; the other's lens by the lensmaker."""

    def cost(numbers):
        lens = thick_singlet(numbers[0], SINGLET.f)
        changes = {"main_lens.prescription": lens, "main_lens.reversed": False, "aperture.diameter": numbers[1]}
        lit = images(SINGLET.replace({**changes, "microlens_array.distance": SINGLET.d_1}))
        if not np.isfinite(lit.diameter).all() or lit.kept_fraction[1] < 1:
            return 10.0  # folded or cut: it then has no diameter
        return -np.log(lit.diameter[0]) + 10 * max(0.0, np.log(lit.diameter[1] / 0.063))

    known = differential_evolution(cost, [(-1.5, 1.0), (1.5, 3.0)], seed=1, popsize=6, maxiter=10, polish=False)
    problem = posed(
        {"D_F": (1.5, 3.0)},
        [
            Constraint(quantity="image_diameter_mm", field=FIELDS[1], max=0.063),
            Constraint(quantity="kept_fraction", field=FIELDS[1], min=1 - 1e-9),
        ],
        Goal(quantity="image_diameter_mm", field=FIELDS[0], direction="max"),
        design=SINGLET,
    )
    problem = replace(problem, variables={**problem.variables, BENDING: NumberVariable(min=-1.5, max=1.0)})
    answer = solve(problem, Settings(starts=2, check=False, accuracy=1e-4))
    assert answer.feasible
    assert cost([answer.variables()[BENDING], answer.variables()["D_F"]]) <= known.fun + 1e-3
    best = problem.design_at(answer.unit)
    assert images(best).diameter == pytest.approx(
        [answer.number(part) for part in (*problem.goals, *problem.constraints)][:2], rel=1e-6
    )
    assert (best.d_1, best.d_3, best.f) == pytest.approx((SINGLET.d_1, SINGLET.d_3, SINGLET.f), rel=1e-12)


def test_no_bought_lens_is_better_than_ours():
    """Of two lenses, either way round, the brightest corner whose image on the axis fits the pitch."""
    names = ("AC508-100-A", "LB1630-A")
    shapes = [(load_lens(name), turned) for name in names for turned in (False, True)]

    def cost(numbers):
        lens, turned = shapes[int(numbers[0])]
        changes = {"main_lens.prescription": lens, "main_lens.reversed": turned, "main_lens.diameter": 0.9 * 50.8}
        changes |= {"aperture.diameter": numbers[1], "aperture.distance": numbers[2]}
        lit = images(SINGLET.replace(changes))  # its file states the focal plane
        if not np.isfinite(lit.area).all():
            return 20.0
        return -np.log(max(lit.area[1], 1e-9)) + 10 * max(0.0, np.log(lit.diameter[0] / 0.063))

    ends = [(0, 3), (2, 4), (90, 130)]
    known = differential_evolution(
        cost, ends, seed=1, popsize=6, maxiter=10, polish=False, integrality=[True, False, False]
    )
    problem = posed(
        {"D_F": (2, 4), "d_3": (90, 130)},
        [Constraint(quantity="image_diameter_mm", field=FIELDS[0], max=0.063)],
        Goal(quantity="image_area_mm2", field=FIELDS[1], direction="max"),
        design=SINGLET,
    )
    table = CatalogueTable(kinds=("lenses", "orientations"), only={"lenses": names})
    parts = table.chosen(load_catalogue(), SINGLET.main_lens.kind)
    combinations = Combinations.of(problem, parts, table.kinds)
    ranking = rank(combinations, 4, SearchBudget(), starts=2)
    assert ranking.optimised == len(combinations) == 4
    best = ranking.best[0]
    lens, way = (part.part for part in combinations.chosen(best.number))
    values = combinations.problem_at(best.number).named(best.search.unit)
    number = shapes.index((load_lens(lens), way == "reversed"))
    assert cost([number, values["D_F"], values["d_3"]]) <= known.fun + 1e-3


def chosen_design(design, name, bounds):
    """The design that a study begins from with a lens of the catalogue, in the middle of its bounds."""
    parts = CatalogueTable(kinds=("lenses",), only={"lenses": (name,)}).chosen(load_catalogue(), design.main_lens.kind)
    problem = Combinations.of(posed(bounds, (), design=design), parts, ("lenses",)).problem_at(0)
    return problem.design_at(np.full(problem.n, 0.5))


@pytest.mark.parametrize("base", [SINGLET, roslf.load("paper").replace({"f": 98.0})])
def test_before_a_chosen_lens_the_focal_plane_stays_where_the_file_states_it(base):
    """1/d_1 = 1/f - 1/d_f; d_1 was held, so that a shorter lens looked elsewhere and missed what it holds in focus."""
    file = base.replace({"d_f": base.d_f})
    stated = chosen_design(file, "AC508-100-A", {"D_F": (2.0, 3.0)})
    assert stated.d_f == pytest.approx(base.d_f, rel=1e-12)
    assert stated.d_1 == pytest.approx(1 / (1 / stated.f - 1 / base.d_f), rel=1e-9)
    assert stated.f != pytest.approx(base.f, rel=1e-4)
    # Hardware that the file states stays, and what varies is the study's.
    held = chosen_design(base.replace({"d_1": base.d_1}), "AC508-100-A", {"D_F": (2.0, 3.0)})
    assert held.d_1 == pytest.approx(base.d_1, rel=1e-12)
    moved = chosen_design(file, "AC508-100-A", {"working_distance": (300.0, 500.0)})
    assert moved.d_f > base.d_f + 50


def test_parts_that_miss_a_limit_by_rays_where_they_end_are_not_listed(monkeypatch):
    share = 1.0
    monkeypatch.setattr(
        "roslf_design.evaluation.field_images.FieldImages.half_field",
        lambda shown, way, at: share * float(roslf.QUANTITIES["field_half_width_mm"](shown.images.camera, at)),
    )
    limit = Constraint(quantity="field_half_width_mm", min=31.0)
    problem = posed({"d_f": (250, 450)}, [limit], Goal(quantity="sigma_z_mm", direction="min"), design=SINGLET)
    parts = CatalogueTable(kinds=("orientations",)).chosen(load_catalogue(), SINGLET.main_lens.kind)
    ranker = _Ranker(Combinations.of(problem, parts, ("orientations",)), 2, SearchBudget(), 0, 1)
    ranker.search()
    assert ranker.best
    share = 0.1
    ranker.polish()
    assert not ranker.best
    assert "misses field_half_width_mm >= 31 mm" in ranker.reasons[ranker.nearest.number]


STUDY = """
name = "of one's own"
design = "paper-singlet"

[variables]
"main_lens.bending" = [-1.5, 1]
D_F = ["2 mm", "4 mm"]

[[constraints]]
quantity = "fill_factor"
field = ["11 mm", "7 mm"]
max = 1.0

[[goals]]
quantity = "fill_factor"
field = "0 mm"
direction = "max"

[solver]
starts = 1
check = false

[catalogue]
kinds = ["glasses"]
only.glasses = ["N-BK7", "N-SF11"]
"""


def test_a_study_that_bends_a_lens_and_chooses_its_glass(tmp_path, capsys):
    """What it says is what its files do, evaluated as designs of their own."""
    (tmp_path / "study.toml").write_text(STUDY)
    assert main(["optimize", str(tmp_path / "study.toml"), "-o", str(tmp_path / "out"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["status"] == "optimal"
    assert list(told["variables_mm"]) == ["D_F"]
    rows = told["catalogue"]["best"]
    # Of a higher index, faces are flatter and aberrations less.
    assert [row["parts"]["glasses"] for row in rows] == ["N-SF11", "N-BK7"]
    assert rows[1]["goals"] == pytest.approx({"fill_factor at (0, 0) mm": told["goals"][0]["value"]}, rel=1e-6)
    for name, row in (("best.toml", told), ("parts-01.toml", rows[0])):
        design = roslf.load(tmp_path / "out" / name)
        assert shape_factor(design.lens) == pytest.approx(row["shape_factor"], rel=1e-9)
        assert design.f == pytest.approx(SINGLET.f, rel=1e-9)
        assert row["traced"]["goals_and_limits"] < 1e-9
        goal = row["goals"][0]["value"] if name == "best.toml" else next(iter(row["goals"].values()))
        assert fill_factor(design, FIELDS[0]) == pytest.approx(goal, rel=1e-6)
        assert fill_factor(design, FIELDS[1]) <= 1 + 1e-6
    page = (tmp_path / "out" / "index.html").read_text()
    assert "N-SF11" in page


AIR_SPACED = """
name = "two singlets"
[[surfaces]]
radius = "104 mm"
thickness = "5 mm"
glass = "N-BK7"
diameter = "40 mm"
[[surfaces]]
radius = "inf"
thickness = "3 mm"
diameter = "40 mm"
[[surfaces]]
radius = "inf"
thickness = "5 mm"
glass = "N-BK7"
diameter = "40 mm"
[[surfaces]]
radius = "-104 mm"
diameter = "40 mm"
"""


@pytest.fixture
def air_spaced(tmp_path):
    """A study beside a design behind two singlets."""
    (tmp_path / "lens.toml").write_text(AIR_SPACED)
    text = preset_path("paper-singlet").read_text().replace('"LA1050-A"', '"lens.toml"')
    (tmp_path / "two.toml").write_text(text)
    return STUDY.replace('"paper-singlet"', '"two.toml"')


def test_an_air_gap_moves_the_lens_and_its_focus(air_spaced, tmp_path, capsys):
    """The wider two singlets stand apart, the weaker the lens: f is held by a limit on it, against Gauss's formula."""
    text = air_spaced.replace('"main_lens.bending" = [-1.5, 1]', '"main_lens.surfaces.2.thickness" = ["1 mm", "30 mm"]')
    text = text[: text.index("[catalogue]")] + '[[constraints]]\nquantity = "f"\nmin = "108 mm"\n'
    (tmp_path / "study.toml").write_text(text)
    assert main(["optimize", str(tmp_path / "study.toml"), "-o", str(tmp_path / "out"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    gap = told["variables_mm"]["main_lens.surfaces.2.thickness"]
    best = roslf.load(tmp_path / "out" / "best.toml")
    n = float(find_glass("N-BK7").index(best.wavelength))
    single = 104 / (n - 1)  # a plano-convex lens's; its principal planes at the curved vertex and 5/n into the glass
    apart = gap + 2 * 5 / n
    assert best.f == pytest.approx(1 / (2 / single - apart / single**2), rel=1e-9)
    assert best.f >= 108 * (1 - 1e-9)
    assert told["following_mm"]["f"] == pytest.approx(best.f, rel=1e-9)
    assert told["traced"]["goals_and_limits"] < 1e-9


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("[-1.5, 1]", "[1, -1.5]", "main_lens.bending: min 1 is above max -1.5: nothing lies between"),
        ("[-1.5, 1]", '["1 mm", "2 mm"]', "has no unit"),
        ('only.glasses = ["N-BK7"', 'only.glasses = ["N-BK8"', "'N-BK8' is not a known glass; the nearest known is"),
        ('["glasses"]', '["lenses"]', "a bought lens stays as it is, and 'main_lens.bending' varies"),
        ('["glasses"]', '["windows"]', "with a real main lens (LA1050-A reversed) windows are not chosen"),
        ('["glasses"]', '["lenses", "glasses"]', "a bought lens has its glasses"),
        ("D_F = [", 'd_f = ["300 mm", "400 mm"]\nd_1 = [', "so d_f and d_1 cannot both vary"),
        (
            "D_F = [",
            '"main_lens.surfaces.1.radius" = [',
            "sets every radius, and 'main_lens.surfaces.1.radius' varies too",
        ),
        (
            "D_F = [",
            '"main_lens.surfaces.2.thickness" = [',
            "is of the last surface, behind which nothing follows",
        ),
        ('"paper-singlet"', '"paper"', "'main_lens.bending' is nothing that can vary"),
        (
            '"paper-singlet"',
            '"two.toml"',
            "is for spherical singlets and cemented doublets (two singlets reversed: it has 2",
        ),
    ],
)
@pytest.mark.usefixtures("air_spaced")
def test_what_no_lens_can_be_is_one_line(capsys, tmp_path, old, new, said):
    assert old in STUDY
    (tmp_path / "study.toml").write_text(STUDY.replace(old, new, 1))
    assert main(["optimize", str(tmp_path / "study.toml"), "-o", str(tmp_path / "out")]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert any(said in line for line in lines)
    assert not (tmp_path / "out").exists()


BOUGHT = STUDY.replace('"main_lens.bending" = [-1.5, 1]', 'd_3 = ["90 mm", "130 mm"]')
BOUGHT = BOUGHT[: BOUGHT.index("kinds = ")] + 'kinds = ["lenses", "orientations"]\n'


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ('only.lenses = ["AC050-08-A"]', "'AC050-08-A' is no part of the catalogue; did you mean 'AC050-008-A'?"),
        ('where.lenses = ["focal_length<=3 mm"]', "lenses meets focal_length<=3 mm; see `roslf catalogue"),
        ('only.lenses = ["singlet 25.4 mm f35"]', "none has a prescription that could be traced"),
        ('where.lenses = ["focal_length<=3"]', "has no unit"),
        ('where.lens = ["focal_length<=3 mm"]', "lens"),
    ],
)
def test_lenses_that_cannot_be_bought_are_one_line(capsys, tmp_path, line, said):
    (tmp_path / "study.toml").write_text(BOUGHT + line)
    assert main(["optimize", str(tmp_path / "study.toml"), "-o", str(tmp_path / "out")]) == 2
    (told,) = capsys.readouterr().err.splitlines()
    assert said in told
    assert not (tmp_path / "out").exists()


def test_orientations_are_of_real_lenses(capsys, tmp_path):
    text = BOUGHT.replace('"paper-singlet"', '"paper"').replace('["lenses", "orientations"]', '["orientations"]')
    (tmp_path / "study.toml").write_text(text)
    assert main(["optimize", str(tmp_path / "study.toml"), "-o", str(tmp_path / "out")]) == 2
    assert "orientations are of a real main lens and this design's is ideal" in capsys.readouterr().err


def test_small_achromats_are_bought_with_their_surfaces():
    """Every lens that ships can be chosen, and its line says the focal length that its surfaces have."""
    lines = {part.part: part for part in load_catalogue().lenses if part.prescription is not None}
    assert set(map(str.lower, lines)) == set(shipped_names())
    for part in lines.values():
        assert part.prescription == load_lens(part.part)
        assert part.aperture <= part.prescription.clear_diameter


def test_a_line_that_is_not_its_prescription_is_refused(tmp_path):
    (tmp_path / "mine.toml").write_text(
        '[[lenses]]\npart = "x"\ndiameter = "5 mm"\nfocal_length = "9 mm"\nprescription = "AC050-008-A"\n'
        'provenance = "none"\nconfidence = "typical"\n'
    )
    with pytest.raises(InputError, match=r"focal_length is 9 mm, and its prescription's 7\.5"):
        load_catalogue([tmp_path / "mine.toml"])


def test_the_blur_of_a_point_in_focus():
    """As `evaluate` has it on the axis and off it, with other rays over the pupil; of a bent lens, too."""
    fields = ((0.0, 0.0), (6.0, 0.0), (11.0, 7.0))
    problem = posed(
        {"D_F": (2, 4)}, (), Goal(quantity="spot_pitches", field=fields[0], direction="min"), design=SINGLET
    )
    problem = replace(problem, variables={**problem.variables, BENDING: NumberVariable(min=-1.0, max=1.0)})
    unit = np.array([[0.5, 0.3], [0.5, 0.5]])
    cameras, lens = problem.cameras(unit), problem.varied_lens(unit)
    traces = FieldTraces(SINGLET, fields, cameras, lens)
    ours = np.array([traces.at(roslf.quantity("spot_pitches"), field) for field in fields])
    for k in range(2):
        evaluated = roslf.evaluate(problem.design_at(unit[k]), fields).real_lens
        # 48 rays by Gauss's rule here, an even spread there.
        assert ours[:, k] == pytest.approx([field.blur_pitches for field in evaluated.fields], rel=1e-2)
    ideal = Goal(quantity="spot_pitches", field=fields[1], direction="min")
    assert ideal.values(roslf.Camera.of(roslf.load("paper"))) == 0


def test_the_bending_of_least_blur_is_coddingtons():
    """Spherical aberration on the axis is least at the shape factor 2 (n^2 - 1)/(n + 2) (d_f - d_1)/(d_f + d_1)."""
    thin = SINGLET.replace(
        {
            "main_lens.prescription": thick_singlet(0.3, SINGLET.f, thickness=1.0, diameter=16.0),
            "main_lens.reversed": False,
        }
    )
    thin = thin.replace({"aperture.distance": 2.0, "aperture.diameter": 12.0})
    problem = posed({}, (), Goal(quantity="spot_pitches", field=(0.0, 0.0), direction="min"), design=thin)
    problem = replace(problem, variables={BENDING: NumberVariable(min=-1.0, max=2.0)})
    answer = solve(problem, Settings(starts=1, check=False, accuracy=1e-5))
    n = float(find_glass("N-BK7").index(GREEN))
    wanted = 2 * (n * n - 1) / (n + 2) * (thin.d_f - thin.d_1) / (thin.d_f + thin.d_1)
    assert answer.variables()[BENDING] == pytest.approx(wanted, abs=0.01)  # third order, and a lens 1 mm thick
