"""Problems as numbers: scaling, derived lengths, derivatives against mpmath, bounds against what boxes really hold."""

from dataclasses import replace

import mpmath as mp
import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.catalogue import Catalogue
from roslf_design.optimization.bounds import Boxes, prunable
from roslf_design.optimization.combinations import Combinations
from roslf_design.optimization.search import gradient_error, value_and_jacobian
from roslf_design.optimization.variables import name_faults
from roslf_design.theory.quantities import QUANTITIES, quantity_named
from tests.optimization.posing import PAPER, goal, limit, posed, variable

TUBE = PAPER.replace({"stops": ({"diameter": 5.0, "distance": 150.0},)})
DEPTH = (goal("sigma_z_mm", "min", 150.0),)


@pytest.mark.parametrize("of", [variable(0.01, 0.5), variable(0.0, 200.0), variable(90, 110)])
def test_scaled_values_and_back(of):
    units = np.linspace(0, 1, 11)
    values = of.value(units)
    assert (values[0], values[-1]) == (of.min, of.max)
    assert [of.unit(float(value)) for value in values] == pytest.approx(units.tolist(), abs=1e-14)
    middle = (of.value(np.array(0.5 + 1e-6)) - of.value(np.array(0.5 - 1e-6))) / 2e-6
    assert of.rate(0.5) == pytest.approx(float(middle), rel=1e-6)
    assert (of.unit(of.max + 1), of.unit(of.min - 1)) == (1, 0)


def test_derived_lengths_set_the_places_they_mean():
    bounds = {"tube_length": (10.0, 60.0), "tube_diameter": (2.0, 6.0), "working_distance": (100.0, 300.0)}
    problem = posed(bounds, (), *DEPTH, design=TUBE)
    unit = np.array([0.5, 0.25, 0.5])
    design, values = problem.design_at(unit), problem.named(unit)
    assert design.stops[0].distance == pytest.approx(design.d_3 + values["tube_length"])
    assert design.D_F == design.stops[0].diameter == pytest.approx(values["tube_diameter"])
    assert design.d_f - design.stops[0].distance == pytest.approx(values["working_distance"])
    cameras = problem.cameras(unit[None])
    assert (float(cameras.d_f[0]), float(cameras.d_1[0])) == pytest.approx((design.d_f, design.d_1))


@pytest.mark.parametrize(
    ("bounds", "followers"),
    [
        ({"f": (90, 110)}, {"d_f", "f_ml"}),
        ({"f": (90, 110), "working_distance": (100, 300)}, {"d_f", "d_1", "f_ml"}),
        ({"d_1": (130, 150)}, {"d_f", "f_ml"}),
        ({"d_f": (300, 400)}, {"d_1", "f_ml"}),
        ({"f": (90, 110), "d_f": (350, 350)}, {"d_1", "f_ml"}),
        ({"working_distance": (100, 300)}, {"d_f", "d_1", "f_ml"}),
        ({"D_F": (2, 3)}, {"f_ml"}),
    ],
)
def test_what_moves_without_being_a_variable_is_named_with_its_value(bounds, followers):
    problem = posed(bounds, (), *DEPTH, in_focus=True)
    unit = np.full(len(bounds), 0.7)
    design, following = problem.design_at(unit), problem.following(unit)
    assert set(following) == followers
    assert following == pytest.approx({symbol: getattr(design, symbol) for symbol in followers}, rel=1e-12)
    moved = {s for s in ("f", "d_f", "d_1", "f_ml") if getattr(design, s) != pytest.approx(getattr(PAPER, s), rel=1e-9)}
    assert moved <= followers | set(bounds)


@pytest.mark.parametrize(("stated", "stays", "follows"), [("d_f", "d_f", "d_1"), ("d_1", "d_1", "d_f")])
def test_where_f_varies_what_the_design_states_stays_and_is_named(stated, stays, follows):
    """d_1 stayed though the file gave the focal plane: no lens then had another working distance."""
    design = PAPER.replace({stated: getattr(PAPER, stated), "f": PAPER.f})
    problem = posed({"f": (90, 110)}, (), *DEPTH, design=design)
    unit = np.array([0.2])
    best, f = problem.design_at(unit), 90 + 0.2 * 20
    assert problem.held(unit) == {stays: pytest.approx(getattr(PAPER, stays), rel=1e-12)}
    other = 1 / (1 / f - 1 / getattr(PAPER, stays))
    assert problem.following(unit) == {follows: pytest.approx(other, rel=1e-9)}
    assert (best.f, getattr(best, stays)) == pytest.approx((f, getattr(PAPER, stays)), rel=1e-12)
    assert posed({"f": (90, 110), "d_f": (300, 400)}, (), *DEPTH).held(np.full(2, 0.5)) == {}


def test_microlenses_in_focus():
    problem = posed({"d_2": (1.0, 4.0)}, (), *DEPTH, design=TUBE, in_focus=True)
    design = problem.design_at(np.array([0.3]))
    vergence = roslf.evaluate(design, []).exit_pupil.vergence_at_mla_per_mm
    assert 1 / design.f_ml == pytest.approx(1 / design.d_2 + vergence, rel=1e-12)


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (("f", "d_f", "d_1"), "two of them give the third"),
        (("working_distance", "d_f"), "sets d_f"),
        (("working_distance", "f", "d_1"), "two of them give the third"),
        (("d_3", "aperture.distance"), "varies twice"),
        (("tube_diameter", "D_F"), "one of which varies too"),
    ],
)
def test_what_would_be_set_twice(names, said):
    (fault,) = name_faults(names, Camera.of(TUBE).numbers)
    assert said in fault


@pytest.mark.parametrize("name", ["aperture.tilt.0", "sensor.decentre.0", "tip", "microlens_array.rotation"])
def test_what_no_quantity_depends_on_does_not_vary(name):
    (fault,) = name_faults([name], Camera.of(TUBE).numbers)
    assert "nothing that can vary" in fault


def test_scales_travel_with_the_problem():
    goals = (goal("non_distortion_room_mm", "max"),)
    problem = posed({"d_3": (0.0, 200.0)}, (), *goals)
    other = Combinations(problem.with_scales(), (), ()).problem
    assert other.goal_scale(0) == problem.goal_scale(0)


@pytest.mark.parametrize("stops", [0, 2])
@pytest.mark.parametrize("preset", ["paper", "rigid-scope", "ear-speculum", "pipe-bore"])
def test_goals_and_limits_see_what_evaluate_sees_also_where_parts_are_decentred(preset, stops):
    design = roslf.load(preset)
    rims = tuple(
        {"diameter": design.D_F * k, "distance": design.d_3 * (1 + 0.1 * k), "decentre": (0.0, 0.03 * design.D_F)}
        for k in range(2, stops + 2)
    )
    shifts = {"aperture.decentre": (0.02 * design.D_F, 0.0), "main_lens.decentre": (0.0, 0.01 * design.D)}
    design = design.replace({"stops": rims, **shifts})
    seen = roslf.evaluate(design, [])
    problem = posed({"d_2": (design.d_2, design.d_2)}, (), *DEPTH, design=design)
    wanted = {
        "fill_factor": seen.f_number.fill_factor,
        "mismatch_px": seen.f_number.mismatch_px,
        "non_distortion_room_mm": seen.non_distortion.room_at_corner_mm,
        "undistorted_field_mm": seen.non_distortion.x0_max_mm,
        "sigma_z_mm": seen.depth.sigma_z_mm,
        "view_baseline_mm": seen.sampling.view_baseline_mm,
    }
    for name, value in wanted.items():
        found = problem.number(goal(name, "min"), np.zeros(1))
        # `evaluate` tells no field below 0, where even the axis is cut.
        assert (max(found, 0.0) if name == "undistorted_field_mm" else found) == pytest.approx(value, rel=1e-12), name


def test_at_a_distance_counts_from_the_tip():
    ahead = TUBE.d_f - 150.0
    problem = posed({"d_2": (1.0, 2.0)}, (), *DEPTH, design=TUBE)
    for name in ("sigma_z_mm", "field_half_width_mm"):
        here, there = (problem.number(goal(name, "min", at), np.zeros(1)) for at in (None, ahead))
        assert there == pytest.approx(here, rel=1e-14)
    assert problem.number(goal("blur_pitches", "min", ahead), np.zeros(1)) == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("unit", [(0.5, 0.5, 0.5, 0.5), (0.0, 0.0, 0.2, 1.0), (1.0, 0.9, 0.9, 0.0)])
def test_derivatives_against_mpmath(unit):
    """Of the merit and of the image fill's lower limit, written out anew at 60 digits."""
    bounds = {"D_F": (1.0, 6.0), "d_3": (0.0, 190.0), "d_f": (200.0, 600.0), "d_2": (0.5, 9.0)}
    limits = (
        limit("fill_factor", 0.5, 1.0),
        limit("blur_pitches", None, 5.0, 150.0),
    )
    problem = posed(bounds, limits, *DEPTH)
    values, jacobian = value_and_jacobian(problem.vector, np.array(unit))

    def lengths(u):
        for v, x in zip(problem.variables.values(), u, strict=True):
            low, high = mp.mpf(v.min), mp.mpf(v.max)
            yield low * (high / low) ** x if v.logarithmic else low + x * (high - low)

    f, d = mp.mpf(PAPER.f), mp.mpf(PAPER.d)

    def merit(*u):
        D_F, d_3, d_f, _ = lengths(u)
        return mp.log(mp.mpf(150) ** 2 * d * mp.mpf(0.1) / (D_F * f * (d_f - d_3) / (d_f - f)))

    def low_fill(*u):
        D_F, d_3, d_f, d_2 = lengths(u)
        return mp.mpf(0.5) * d * (f * (d_f - d_3) / (d_f - f) / d_2 + (f - d_3) / f) / D_F - 1

    row = 1 + next(i for i, r in enumerate(problem.rows) if r.constraint == 0 and r.side == "min")
    with mp.workdps(60):
        for index, formula in ((0, merit), (row, low_fill)):
            at = tuple(mp.mpf(float(x)) for x in unit)
            assert values[index] == pytest.approx(float(formula(*at)), rel=1e-12, abs=1e-13)
            for i in range(4):
                wanted = float(mp.diff(formula, at, tuple(int(k == i) for k in range(4))))
                # One-sided fourth order at bounds: step^4 times the fifth derivative, of a variable over two decades.
                assert jacobian[index, i] == pytest.approx(wanted, rel=2e-9, abs=2e-9)
    assert gradient_error(problem.vector, np.array(unit)) < 1e-7


BOXED = [name for name, quantity in QUANTITIES.items() if quantity.monotone and quantity.of is not None]
LENGTHS = {"D_F": (1.0, 6.0), "d_3": (0.0, 250.0), "d_f": (90.0, 900.0), "d_2": (0.2, 9.0), "d": (0.03, 0.3)}


def boxes(rng):
    """Ends of boxes of all sizes; every other one lies across d_3 = d_f."""
    for number in range(24):
        middle, half = rng.random(5), 0.5 * rng.random(5) ** 2
        low, high = np.clip(middle - half, 0, 1), np.clip(middle + half, 0, 1)
        if number % 2:
            plane = float(variable(*LENGTHS["d_f"]).value(np.asarray(low[2])))
            low[1] = variable(*LENGTHS["d_3"]).unit(plane * (1 - 0.5 * rng.random()))
            high[1] = variable(*LENGTHS["d_3"]).unit(plane * (1 + 0.2 * rng.random()))
        yield low, high


@pytest.fixture(scope="module")
def boxed():
    """Boxes, and many of the cameras in each: at its corners and within."""
    rng, bare, held = np.random.default_rng(4), posed(LENGTHS, (), *DEPTH), []
    for low, high in boxes(rng):
        corners = rng.integers(0, 2, (200, 5))
        units = low + np.concatenate([corners, rng.beta(0.5, 0.5, (800, 5))]) * (high - low)
        real = (bare.vector(units)[1:] <= 0).all(axis=0)
        if real.any():
            held.append((low, high, bare.cameras(units[real])))
    return held


@pytest.mark.parametrize("name", BOXED)
def test_boxes_hold_nothing_beyond_their_bounds(boxed, name):
    """The best camera met in a box is never better than the bound, and no box with a camera is ruled out."""
    quantity = quantity_named(name)
    at = 80.0 if quantity.at != "never" else None
    least_of, most_of = (
        Combinations.of(posed(LENGTHS, (), goal(name, direction, at)), Catalogue(), ()) for direction in ("min", "max")
    )
    assert prunable(least_of.problem, least_of.problem.goals[0])
    assert len(boxed) > 10
    scale = least_of.problem.goal_scale(0)

    def bounds(combinations, low, high, *limits):
        scaled = replace(combinations.problem, constraints=limits, scales=((scale,) * len(limits), (scale,)))
        held = replace(combinations, problem=scaled)
        return Boxes(held, np.zeros(len(low), np.intp), low, high).bound()

    def bound(combinations, low, high, *limits):
        return bounds(combinations, low[None], high[None], *limits)[0]

    lows, highs = (np.stack(ends) for ends in list(zip(*boxed, strict=True))[:2])
    told = zip(boxed, bounds(least_of, lows, highs), bounds(most_of, lows, highs), strict=True)
    for (low, high, cameras), *of_box in told:
        with np.errstate(all="ignore"):
            values = least_of.problem.goals[0].values(cameras)
        least, most = float(values.min()), float(values.max())
        for own, sign, extreme in zip(of_box, (1, -1), (least, most), strict=True):
            merit = np.log(extreme) if quantity.positive else extreme / scale
            assert sign * merit >= own - 1e-12 * (1 + abs(merit)), (low, high)
        assert bound(least_of, low, high, limit(name, None, least, at)) < np.inf, (low, high)
        assert bound(least_of, low, high, limit(name, most, None, at)) < np.inf, (low, high)
