"""Fronts, robustness and parts, each against another way to the same."""

import sys

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.catalogue import Catalogue, load_catalogue, read_condition, rows
from roslf_design.errors import InputError
from roslf_design.optimization.combinations import Combinations
from roslf_design.optimization.front import pareto_front
from roslf_design.optimization.ranking import promise, rank
from roslf_design.optimization.robust import RobustTable, maximise_robustness, scatter_of
from roslf_design.optimization.search import QUICK, SearchBudget, search
from tests.optimization.posing import PAPER, goal, limit, posed


def test_front_against_its_closed_form():
    """With d_f alone free, sigma_z at a place and the field there follow from it: the front is that curve."""
    goals = (goal("sigma_z_mm", "min", 150.0), goal("field_half_width_mm", "max", 150.0))
    front = pareto_front(posed({"d_f": (200.0, 800.0), "D_F": (1.0, 3.0)}, (), *goals), goals, 9, [], SearchBudget())
    assert len(front.points) >= 8
    assert front.limits_without_design == 0
    sigma, field = np.array([list(point.goals.values()) for point in front.points]).T
    assert (np.diff(sigma[np.argsort(field)]) > 0).all()
    # sigma_z = Z^2 d s/(D_F A), field = w (d_f - f)/f Z/g = w Z/A at the widest pupil, w = half the sensor/(1 + d_2/L).
    d_f = np.array([point.variables_mm["d_f"] for point in front.points])
    grow = 1 + PAPER.d_2 * (PAPER.f - PAPER.d_3) * (d_f - PAPER.f) / (PAPER.f**2 * (d_f - PAPER.d_3))
    assert PAPER.sensor_size[0] / grow.min() < PAPER.microlens_array.size[0]
    assert sigma / field == pytest.approx(150 * PAPER.d * 0.1 / (3.0 * PAPER.sensor_size[0] / 2 / grow), rel=1e-6)


def test_three_goals_give_points_none_of_which_is_better():
    goals = (
        goal("sigma_z_mm", "min", 150.0),
        goal("field_half_width_mm", "max", 150.0),
        goal("views_independent", "max"),
    )
    problem = posed({"d_f": (200.0, 800.0), "d": (0.03, 0.2), "D_F": (1.0, 3.0)}, (), *goals)
    front = pareto_front(problem, goals, 7, [], SearchBudget())
    values = np.array([list(point.goals.values()) for point in front.points]) * np.array([1, -1, -1])
    assert len(values) >= 5
    for own in values:
        others = values[(values != own).any(axis=1)]
        assert not ((others <= own).all(axis=1) & (others < own * (1 - 1e-9)).any(axis=1)).any()


def test_ends_of_a_front_waste_nothing():
    """The field does not depend on D_F: the design at its end must have the widest pupil all the same."""
    goals = (goal("sigma_z_mm", "min", 150.0), goal("field_half_width_mm", "max"))
    front = pareto_front(posed({"d_f": (200.0, 800.0), "D_F": (1.0, 3.0)}, (), *goals), goals, 4, [], SearchBudget())
    assert [point.variables_mm["D_F"] for point in front.points] == pytest.approx([3.0] * len(front.points), rel=1e-6)


TIGHT = posed(
    {"d_2": (0.5, 9.0), "D_F": (1.0, 6.0), "d_3": (60.0, 190.0)},
    (limit("fill_factor", 0.98, 1.0), limit("non_distortion_room_mm", 0.0)),
    goal("sigma_z_mm", "min", 150.0),
)
MISSES = [
    {"place": "D_F", "tolerance": "10 um"},
    {"place": ["d_1", "d_3"], "tolerance": "50 um"},
    {"place": "d_2", "tolerance": "0.4 %"},
]


def made_robust(**asked):
    table = RobustTable.model_validate({"trials": 256, "perturb": MISSES, **asked})
    scatter = scatter_of(table, PAPER, 3)
    nominal = search(TIGHT.vector, np.array([0.4, 0.4, 0.4]))
    return scatter, maximise_robustness(TIGHT, table, scatter, nominal.unit, SearchBudget())


def test_robust_design_beside_the_nominal_one():
    scatter, found = made_robust(maximise="yield")
    assert found.robust.yield_.value > found.nominal.yield_.value + 0.2
    assert found.robust.goal_nominal >= found.nominal.goal_nominal * (1 - 1e-9)  # the price
    # The yield again, each build a design of its own.
    hardware = TIGHT.design_at(found.unit)
    held, count = 0, 100
    for column in scatter.fresh[:, :count].T:
        moves = dict(zip([p.place for p in scatter.perturbations], column, strict=True))
        build = hardware.replace(
            D_F=hardware.D_F + 0.01 * moves["aperture.diameter"],
            d_1=hardware.d_1 + 0.05 * moves["microlens_array.distance"],
            d_3=hardware.d_3 + 0.05 * moves["aperture.distance"],
            d_2=hardware.d_2 * (1 + 0.004 * moves["sensor.distance"]),
        )
        fill, room = (roslf.quantity(name)(Camera.of(build)) for name in ("fill_factor", "non_distortion_room_mm"))
        held += bool(0.98 <= fill <= 1.0 and room >= 0)
    own = (TIGHT.rows_of(scatter.builds(TIGHT, found.unit, scatter.fresh[:, :count]), count) <= 1e-9).all(axis=0).sum()
    assert held == own
    # Of several designs at once each has the builds that it has alone.
    units = np.stack([found.unit, found.unit * 0.9])
    few = scatter.fresh[:, :5]
    alone = [TIGHT.rows_of(scatter.builds(TIGHT, unit, few), 5) for unit in units]
    assert TIGHT.rows_of(scatter.builds(TIGHT, units, few), 10) == pytest.approx(np.concatenate(alone, axis=1))
    # What is told is what was applied: 0.4 % of this design's own d_2, not of the base design's.
    told = scatter.tolerances(TIGHT, found.unit)
    assert told["sensor.distance"] == pytest.approx(0.004 * hardware.d_2, rel=1e-12)
    assert told["aperture.diameter"] == pytest.approx(0.01)
    assert abs(hardware.d_2 / PAPER.d_2 - 1) > 0.1


def test_a_robust_search_says_how_far_it_is():
    table = RobustTable.model_validate({"trials": 64, "perturb": MISSES})
    scatter, told = scatter_of(table, PAPER, 3), []
    maximise_robustness(TIGHT, table, scatter, np.full(3, 0.4), SearchBudget(), lambda *step: told.append(step))
    assert {step[0] for step in told} == {"robust: yield"}
    shares = [done / total for _, done, total in told]
    assert shares == sorted(shares)
    assert shares[0] == 0
    assert 0.75 <= shares[-1] <= 1
    assert len(shares) > 8


def test_what_robustness_may_cost_is_kept():
    _, found = made_robust(give_up=0.002)
    assert found.robust.goal_nominal <= found.nominal.goal_nominal * 1.00201


def test_a_quantile_holds_the_wanted_yield():
    _, found = made_robust(maximise="quantile", wanted_yield=0.8)
    assert found.robust.yield_.interval[0] >= 0.8  # judged by 4096 builds that the search did not see
    assert found.nominal.yield_.interval[0] < 0.8
    assert found.robust.goal_quantile < 1.2 * found.nominal.goal_quantile


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ({"place": "d_4", "tolerance": "1 um"}, "did you mean"),
        ({"place": "d_f", "tolerance": "1 um"}, "no part of the hardware"),
        ({"place": "aperture.tilt", "tolerance": "1 mrad"}, "changes nothing"),
        ({"place": "D_F", "tolerance": "1"}, "no unit"),
    ],
)
def test_perturbations_that_make_no_sense(line, said):
    with pytest.raises(InputError, match=said):
        scatter_of(RobustTable.model_validate({"perturb": [line]}), PAPER, 0)


@pytest.fixture(scope="module")
def few():
    parts = load_catalogue()
    lenses = [lens for lens in parts.lenses if 50 <= lens.focal_length <= 150][:4]
    few = {"lenses": tuple(lenses), "microlens_arrays": parts.microlens_arrays[:5], "sensors": parts.sensors[-2:]}
    return parts.model_copy(update=few)


def test_ranking_against_every_combination_optimised(few):
    limits = (
        limit("fill_factor", 0.98, 1.0),
        limit("non_distortion_room_mm", 0.0),
        limit("microlens_defocus_px", None, 0.5),
        limit("total_length_mm", None, 500.0),
    )
    goals = (goal("sigma_z_mm", "min", 200.0), goal("lateral_samples", "max", None, 0.5))
    problem = posed({"d_2": (0.2, 20.0), "d_f": (210.0, 2000.0), "D_F": (1.0, 8.0)}, limits, *goals)
    combinations = Combinations.of(problem, few, ("lenses", "microlens_arrays", "sensors"))
    found = rank(combinations, 5, SearchBudget(30_000))
    assert found.open == 0
    assert found.ruled_out + found.optimised == len(combinations) == 40
    assert found.ruled_out > 20
    every = []
    for number in range(len(combinations)):
        own = combinations.problem_at(number)
        starts = ((0.5, 0.3, 0.3), (0.3, 0.7, 0.6))  # the other one where the first one finds no design
        results = (search(own.vector, start, tolerance=QUICK) for start in starts)
        every.append(next((result.merit for result in results if result.feasible), np.inf))
    assert [ranked.search.merit for ranked in found.best] == pytest.approx(sorted(every)[:5], abs=1e-5)
    # Each that was optimised is listed or has its reason: it misses a limit exactly where no search found a design.
    assert len(found.left_out) == found.optimised - 5
    assert all(why.startswith(("misses", "no camera")) == np.isinf(every[number]) for number, why in found.left_out)
    design = combinations.problem_at(found.best[0].number).design_at(found.best[0].search.unit)
    assert 0.98 - 1e-8 <= roslf.evaluate(design, []).f_number.fill_factor <= 1 + 1e-8


@pytest.mark.parametrize(
    ("falls", "spent", "ends", "off"),
    [
        (0.0, 0, 20, 1e-9),  # all alike: the time left is told to a second
        (1.0, 0, 20, 1.0),  # dear ones first, as the most promising are: never too little
        (0.0, 2000, 15, 0.02),  # a budget of 30,000 ends it after fifteen
    ],
)
def test_the_time_left_is_that_of_what_combinations_cost_so_far(few, monkeypatch, falls, spent, ends, off):
    """By a clock that only combinations move: what is told to be left falls, and is what there was left."""
    now, told, optimised = [0.0], [], []

    def optimise(ranker, number, low, high):
        ranker.heard()  # as every search in it does
        now[0] += 30.0 - falls * len(optimised)
        optimised.append(number)
        ranker.budget.evaluations -= spent
        ranker.done[number] = True

    monkeypatch.setattr("time.monotonic", lambda: now[0])
    monkeypatch.setattr("roslf_design.optimization.ranking._Ranker.optimise", optimise)
    for rest in ("polish", "optimise_some"):
        monkeypatch.setattr(f"roslf_design.optimization.ranking._Ranker.{rest}", lambda ranker: None)
    monkeypatch.setattr("roslf_design.optimization.ranking.Boxes.shaved", lambda boxes, threshold: boxes)
    problem = posed({"d_2": (0.2, 20.0)}, (), goal("u_z_mm", "min", 200.0))
    combinations = Combinations.of(problem, few, ("lenses", "microlens_arrays", "sensors"))
    rank(
        combinations,
        5,
        SearchBudget(30_000),
        tell=lambda what, done=0.0, total=0.0: told.append((now[0], done / total)),
    )
    assert len(optimised) == ends
    left = [(at, at * (1 - share) / share) for at, share in told if share > 0]
    assert len(left) >= ends - 1
    assert np.all(np.diff([seconds for _, seconds in left]) <= 1e-9)
    shares = [share for _, share in told]
    assert shares == sorted(shares)
    for at, seconds in left:
        really = now[0] - at
        assert really * (1 - min(off, 0.02)) - 1e-9 <= seconds <= really * (1 + off) + 1e-9


def test_parts_that_fit_none_and_a_time_that_is_up(few):
    problem = posed({"d_2": (0.2, 20.0)}, (limit("lateral_samples", 1e5),), goal("sigma_z_mm", "min"))
    found = rank(Combinations.of(problem, few, ("sensors",)), 5, SearchBudget())
    assert (found.best, found.ruled_out, found.optimised, found.open) == ((), 2, 0, 0)
    (limit_missed,) = found.refused
    assert set(limit_missed.parts) == {part.part for part in few.sensors}
    # What parts rule out is known at once; what limits rule out together is not, where no time is given.
    problem = posed({"d_2": (0.2, 20.0)}, (limit("d_2", 5.0), limit("d_2", None, 3.0)), goal("sigma_z_mm", "min"))
    late = rank(Combinations.of(problem, few, ("sensors",)), 5, SearchBudget.of(1, -1.0))
    assert (late.best, late.optimised, late.open) == ((), 0, 2)


def small_parts():
    """Parts for a tube, all with stock arrays that are far wider than it."""
    made = {"provenance": "made", "confidence": "typical"}
    array = made | {"pitch": 0.1, "focal_length": 2.0, "size": (10.0, 10.0)}
    arrays = [array | {"part": "diced"}, array | {"part": "whole", "cut": False}]
    sizes = {"small": (500, 400), "long": (1300, 300), "large": (2000, 1500)}
    sensors = [made | {"part": name, "pixel": 0.002, "pixels": pixels} for name, pixels in sizes.items()]
    return Catalogue(microlens_arrays=arrays, sensors=sensors)


def test_arrays_are_cut_and_what_does_not_fit_a_tube_is_refused_before_any_search():
    """Width of a tube by hand: the sensor's diagonal, or that of its picture on the array with the rim of 0.1 mm."""
    base = PAPER.replace({"D": 2.0, "f": 10.0, "d_f": 40.0, "D_F": 1.0, "d_3": 5.0})
    limits = (limit("outer_diameter_mm", None, 2.7),)
    problem = posed({"d_2": (0.5, 3.0), "D_F": (0.5, 1.5)}, limits, goal("sigma_z_mm", "min", 20.0), design=base)
    combinations = Combinations.of(problem, small_parts(), ("microlens_arrays", "sensors"))
    found = rank(combinations, 5, SearchBudget())
    names = [found.named(number) for number in range(len(combinations))]
    held = []
    for number, name in enumerate(names):
        d_2 = np.linspace(0.5, 3.0, 401)
        width, height = (0.002 * pixels for pixels in combinations.chosen(number)[1].pixels)
        grow = 1 + d_2 * (base.f - base.d_3) * (base.d_f - base.f) / (base.f**2 * (base.d_f - base.d_3))
        cut = np.hypot(width / grow + 0.2, height / grow + 0.2)
        array = cut if name["microlens_arrays"] == "diced" else np.hypot(10, 10)
        held.append((np.maximum(np.hypot(width, height), array) <= 2.7).any())
    assert sum(held) == 2
    assert [ranked.number for ranked in sorted(found.best, key=lambda one: one.number)] == list(np.flatnonzero(held))
    (refused,) = found.refused
    assert refused.numbers.tolist() == list(np.flatnonzero(~np.array(held)))
    assert found.optimised == 2
    assert found.ruled_out == 4
    for ranked in found.best:
        design = combinations.problem_at(ranked.number).design_at(ranked.search.unit)
        stock = design.replace({"microlens_array.size": (10.0, 10.0)})
        width, height = design.microlens_array.size
        told = f"diced, cut to {width:.3g} x {height:.3g} mm from 10 x 10 mm stock"
        assert found.ordered(ranked)["microlens_arrays"] == told
        for name, at in (("field_half_width_mm", 20.0), ("lateral_samples", None), ("non_distortion_room_mm", None)):
            quantity = goal(name, "max", at)
            assert quantity.values(Camera.of(design)) == pytest.approx(quantity.values(Camera.of(stock)), rel=1e-12)


def test_a_search_that_is_stopped_keeps_its_best(monkeypatch):
    base = PAPER.replace({"D": 2.0, "f": 10.0, "d_f": 40.0, "D_F": 1.0, "d_3": 5.0})
    problem = posed({"d_2": (0.5, 3.0)}, (), goal("sigma_z_mm", "min", 20.0), design=base)
    combinations = Combinations.of(problem, small_parts(), ("microlens_arrays", "sensors"))
    whole, asked = rank(combinations, 6, SearchBudget()), []
    problem_at = Combinations.problem_at

    def interrupted(self, number):
        asked.append(number)
        if len(asked) == 4:
            raise KeyboardInterrupt
        return problem_at(self, number)

    monkeypatch.setattr(Combinations, "problem_at", interrupted)
    part = rank(combinations, 6, SearchBudget())
    assert (part.stopped, part.optimised, part.open) == (True, 3, 3)
    every = {ranked.number: ranked.search.merit for ranked in whole.best}
    assert [ranked.search.merit for ranked in part.best] == pytest.approx([every[one.number] for one in part.best])


def test_a_search_that_is_stopped_within_a_combination_searches_no_more(monkeypatch):
    """Ctrl-C within a search ends that, as a budget does: nothing is polished, and what it broke off stays open."""
    base = PAPER.replace({"D": 2.0, "f": 10.0, "d_f": 40.0, "D_F": 1.0, "d_3": 5.0})
    problem = posed({"d_2": (0.5, 3.0)}, (), goal("sigma_z_mm", "min", 20.0), design=base)
    combinations = Combinations.of(problem, small_parts(), ("microlens_arrays", "sensors"))
    ranking, budget, after = sys.modules["roslf_design.optimization.ranking"], SearchBudget(), []
    searched, problem_at, asked = ranking.searched, Combinations.problem_at, []

    def counted(*arguments, **options):
        after.append(budget.ended)
        return searched(*arguments, **options)

    def stopping(self, number):
        asked.append(number)
        if len(asked) == 4:
            budget.halted.set()
        return problem_at(self, number)

    monkeypatch.setattr(ranking, "searched", counted)
    monkeypatch.setattr(Combinations, "problem_at", stopping)
    part = rank(combinations, 6, budget)
    assert part.stopped
    assert part.best
    assert part.conflict is None
    assert 1 <= after.count("stopped") <= 2  # the starts of the fourth, none of them a thorough search
    assert len(asked) == 4


def test_combinations_without_bounds_are_looked_at_in_the_order_of_a_brute_force():
    """Depth, expected, has no bounds over boxes: parts were searched in the order of the catalogue."""
    paper = roslf.load("paper")
    parts = load_catalogue().of("microlens_arrays")
    goal_of, fill = goal("u_z_mm", "min"), limit("fill_factor", high=1.0)
    problem = posed({"D_F": (0.5, 4.0), "d_2": (0.3, 3.0)}, (fill,), goal_of, design=paper)
    catalogue = Catalogue(lenses=(), microlens_arrays=parts, sensors=(), windows=())
    combinations = Combinations.of(problem, catalogue, ("microlens_arrays",))
    numbers = np.arange(len(combinations))
    order = promise(combinations, numbers, 0)
    grid = np.stack(np.meshgrid(np.linspace(0, 1, 21), np.linspace(0, 1, 21)), -1).reshape(-1, 2)
    least = []
    for number in numbers.tolist():
        cameras = combinations.problem_at(number).cameras(grid)
        values, fills = (roslf.quantity(name)(cameras) for name in ("u_z_mm", "fill_factor"))
        least.append(np.nanmin(np.where(fills <= 1.0, values, np.inf)))
    least = np.array(least)
    best = int(least.argmin())
    assert least[int(order.argmin())] <= 1.2 * least[best]
    assert np.corrcoef(np.argsort(np.argsort(order)), np.argsort(np.argsort(least)))[0, 1] > 0.9


def test_what_is_known_of_some_sensors_counts_in_their_designs():
    """Half at 1.76 times the chief-ray angle (24 degrees), where 80 % are taken: a Gaussian."""
    parts = load_catalogue()
    problem = posed({"d_2": (0.2, 20.0)}, (), goal("sigma_z_mm", "min"))
    combinations = Combinations.of(problem, parts, ("sensors",))
    designs = [combinations.problem_at(number).design_at(np.array([0.5])) for number in range(len(combinations))]
    sensors = {part.part: design.sensor for part, design in zip(parts.sensors, designs, strict=True)}
    told = sensors["OV5647"]
    assert (told.colours, told.pixel) == ("BGGR", pytest.approx(1.4e-3))
    assert 2.0 ** -((np.radians(24.0) / told.acceptance) ** 2) == pytest.approx(0.8, abs=0.005)
    assert (sensors["IMX250"].colours, sensors["IMX250"].acceptance) == ("mono", None)
    for text, names in (("acceptance>=30 deg", ["OV5647"]), ("colours=BGGR", ["OV5647", "IMX708"])):
        condition = read_condition(text)
        assert [row["part"] for row in rows(parts, ("sensors",)) if condition(row)] == names


def test_the_shipped_catalogue():
    every = list(rows(load_catalogue()))
    assert len(every) > 40
    assert all(row["provenance"] and row["confidence"] for row in every)
    # A maker's figure is one that was read where and when it says.
    assert all("page" in row and "read" in row for row in every if row["confidence"] == "datasheet")
    pitches = [row["pitch"] for row in every if row["kind"] == "microlens_arrays"]
    assert min(pitches) == pytest.approx(0.03)
    canon = next(row for row in every if row["part"] == "EOS 90D sensor")
    assert canon["pixels"] == (6960, 4640)
    assert canon["size"] == pytest.approx([22.272, 14.848])


def test_conditions_on_parts():
    every = list(rows(load_catalogue()))

    def names(*texts):
        conditions = [read_condition(text) for text in texts]
        return {row["part"] for row in every if all(condition(row) for condition in conditions)}

    assert names("pitch<=0.1 mm") == {"18-00079", "paper 63 um / 2 mm", "generic 100 um / 2.1 mm"}
    assert names("maker=thorlabs", "pitch>150 um") == {"MLA300-14AR"}
    assert names("pixels>=4000") == {"EOS 90D sensor", "IMX540", "IMX541"}
    assert names("filters=rggb") == names("colours=RGGB") != set()
    small = {row["part"] for row in every if "package" in row and max(row["package"]) <= 1.0}
    assert names("package<=1 mm") == small != set()
    assert names("package<=1 mm", "package>1 mm") == set()
    kinds = {row["part"]: row.get("type", "") for row in every}
    assert {"singlet", "achromat"} == {kinds[name].split()[-1] for name in names("diameter=25.4 mm", "kind=lenses")}
    wrong = {"focl=3": "focal_length", "pitch<3": "no unit", "maker<3": "words", "pitch": "cannot read"}
    for text, said in wrong.items():
        with pytest.raises(InputError, match=said):
            read_condition(text)


def test_faults_of_a_catalogue_file_are_all_told(tmp_path):
    bad = tmp_path / "mine.toml"
    head = '[[sensors]]\npart = "IMX250"\npixels = [10, 10]\n'
    bad.write_text(head + 'pixel = 3.45\nprovenence = "x"\nconfidence = "sure"\n')
    with pytest.raises(InputError) as caught:
        load_catalogue([bad])
    for said in ("3.45 has no unit", "did you mean 'provenance'", "'measured'"):
        assert said in str(caught.value)
    good = 'pixel = "3.45 um"\nprovenance = "x"\nconfidence = "typical"\n'
    bad.write_text(head + good + 'read = "yesterday"\n')
    with pytest.raises(InputError, match=r"read.*yesterday"):
        load_catalogue([bad])
    bad.write_text(head + good)
    with pytest.raises(InputError, match="two parts are called 'IMX250'"):
        load_catalogue([bad])
