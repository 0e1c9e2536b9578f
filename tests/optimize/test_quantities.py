"""Quantities against `evaluate`, derivatives against mpmath, and bounds against what boxes really hold."""

import mpmath as mp
import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.optimize.parts import Catalogue
from roslf_design.optimize.problem import Constraint, DesignProblem, Goal, Variable
from roslf_design.optimize.ranking import Boxes, Combinations, prunable
from roslf_design.optimize.search import gradient_error, value_and_jacobian
from roslf_design.theory.quantities import QUANTITIES, quantity_named

PRESETS = ("paper", "paper-mismatched", "rigid-scope", "ear-speculum", "pipe-bore")


def number(design, name, at=None):
    return float(quantity_named(name)(Camera.of(design), at))


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("stops", [0, 2])
def test_values_are_those_of_evaluate(preset, stops):
    design = roslf.load(preset)
    rims = tuple({"diameter": design.D_F * k, "distance": design.d_3 * (1 + 0.1 * k)} for k in range(1, stops + 1))
    design = design.replace({"stops": rims, "aperture.decentre": (0.02 * design.D_F, 0.0)})
    seen = roslf.evaluate(design, [])
    wanted = {
        "fill_factor": seen.f_number.fill_factor,
        "mismatch_px": seen.f_number.mismatch_px,
        "f_number_microlens": seen.f_number.microlens,
        "f_number_pupil": seen.f_number.pupil,
        "f_number_main_lens": seen.f_number.main_lens,
        "non_distortion_room_mm": seen.non_distortion.room_at_corner_mm,
        "field_half_width_mm": seen.non_distortion.field_half_width_mm,
        "field_half_diagonal_mm": seen.non_distortion.field_half_diagonal_mm,
        "views_geometric": seen.sampling.views_geometric,
        "views_independent": seen.sampling.views_independent,
        "object_sample_mm": seen.sampling.object_sample_mm,
        "view_baseline_mm": seen.sampling.view_baseline_mm,
        "sigma_z_mm": seen.depth.sigma_z_mm,
        "fresnel_number": seen.diffraction.fresnel_number,
        "airy_radius_px": seen.diffraction.airy_radius_px,
        "vergence_at_mla_per_mm": seen.exit_pupil.vergence_at_mla_per_mm,
    }
    for name, value in wanted.items():
        assert number(design, name) == pytest.approx(value, rel=1e-12, abs=1e-14), name
    assert round(number(design, "lateral_samples")) == seen.sampling.lateral_samples


def test_at_a_distance_counts_from_the_tip():
    design = roslf.load("paper").replace({"stops": ({"diameter": 5.0, "distance": 150.0},)})
    ahead = design.d_f - 150.0
    assert number(design, "sigma_z_mm", ahead) == pytest.approx(number(design, "sigma_z_mm"), rel=1e-14)
    assert number(design, "blur_pitches", ahead) == pytest.approx(0, abs=1e-12)
    assert number(design, "field_half_width_mm", ahead) == pytest.approx(
        number(design, "field_half_width_mm"), rel=1e-14
    )
    assert number(design, "working_distance_mm") == pytest.approx(ahead)


def paper_problem():
    limits = [
        Constraint(quantity_named("fill_factor"), 0.5, 1.0),
        Constraint(quantity_named("non_distortion_room_mm"), 0.0),
        Constraint(quantity_named("blur_pitches"), None, 5.0, 150.0),
    ]
    variables = (
        Variable("D_F", 1.0, 6.0),
        Variable("d_3", 0.0, 190.0),
        Variable("d_f", 200.0, 600.0),
        Variable("d_2", 0.5, 9.0),
    )
    return DesignProblem(
        "p", roslf.load("paper"), variables, tuple(limits), (Goal(quantity_named("sigma_z_mm"), "min", 150.0),)
    )


@pytest.mark.parametrize("unit", [(0.5, 0.5, 0.5, 0.5), (0.0, 0.0, 0.2, 1.0), (1.0, 0.9, 0.9, 0.0)])
def test_derivatives_against_mpmath(unit):
    """Of the merit and of the fill factor's lower limit, written out anew at 60 digits."""
    problem, p = paper_problem(), roslf.load("paper")
    unit = np.array(unit)
    values, jacobian = value_and_jacobian(problem.vector, unit)
    ends = [(v.low, v.high, v.logarithmic) for v in problem.variables]

    def lengths(u):
        pairs = zip(ends, u, strict=True)
        return [
            mp.mpf(a) * (mp.mpf(b) / a) ** x if log else mp.mpf(a) + x * (mp.mpf(b) - a) for (a, b, log), x in pairs
        ]

    def merit(*u):
        D_F, d_3, d_f, _ = lengths(u)
        A = mp.mpf(p.f) * (d_f - d_3) / (d_f - mp.mpf(p.f))
        return mp.log(mp.mpf(150) ** 2 * mp.mpf(p.d) * mp.mpf(0.1) / (D_F * A))

    def low_fill(*u):
        D_F, d_3, d_f, d_2 = lengths(u)
        f = mp.mpf(p.f)
        A = f * (d_f - d_3) / (d_f - f)
        return mp.mpf(0.5) * mp.mpf(p.d) * (A / d_2 + (f - d_3) / f) / D_F - 1

    row = 1 + next(i for i, r in enumerate(problem.rows) if r.constraint == 0 and r.side == "min")
    with mp.workdps(60):
        for index, formula in ((0, merit), (row, low_fill)):
            at = [mp.mpf(float(x)) for x in unit]
            assert values[index] == pytest.approx(float(formula(*at)), rel=1e-12, abs=1e-13)
            for i in range(4):
                order = tuple(int(k == i) for k in range(4))
                wanted = float(mp.diff(formula, tuple(at), order))
                # One-sided fourth order at bounds: step^4 times the fifth derivative, of a variable over two decades.
                assert jacobian[index, i] == pytest.approx(wanted, rel=2e-9, abs=2e-9)
    assert gradient_error(problem.vector, unit) < 1e-7


BOXED = [name for name, quantity in QUANTITIES.items() if quantity.monotone and quantity.of is not None]
LENGTHS = (
    Variable("D_F", 1.0, 6.0),
    Variable("d_3", 0.0, 250.0),
    Variable("d_f", 90.0, 900.0),
    Variable("d_2", 0.2, 9.0),
    Variable("d", 0.03, 0.3),
)


def boxes(rng):
    """Ends of boxes of all sizes; every other one lies across d_3 = d_f."""
    for number in range(24):
        middle, half = rng.random(5), 0.5 * rng.random(5) ** 2
        low, high = np.clip(middle - half, 0, 1), np.clip(middle + half, 0, 1)
        if number % 2:
            plane = float(LENGTHS[2].value(np.asarray(low[2])))
            low[1] = LENGTHS[1].unit(plane * (1 - 0.5 * rng.random()))
            high[1] = LENGTHS[1].unit(plane * (1 + 0.2 * rng.random()))
        yield low, high


@pytest.mark.parametrize("name", BOXED)
def test_boxes_hold_nothing_beyond_their_bounds(name):
    """The best camera met in a box is never better than the bound, and no box with a camera is ruled out."""
    quantity = quantity_named(name)
    at = 80.0 if quantity.at != "never" else None
    rng = np.random.default_rng(4)
    design = roslf.load("paper")
    checked = 0
    for low, high in boxes(rng):
        corners = rng.integers(0, 2, (200, 5))
        units = low + np.concatenate([corners, rng.beta(0.5, 0.5, (800, 5))]) * (high - low)
        problem = DesignProblem("b", design, LENGTHS, (), (Goal(quantity, "min", at),))
        assert prunable(problem, problem.goals[0])
        rows = problem.vector(units)[1:]
        real = (rows <= 0).all(axis=0)
        with np.errstate(all="ignore"):
            values = np.broadcast_to(problem.goals[0].values(problem.cameras(units)), real.shape)[real]
        if not values.size:
            continue
        least, most = float(values.min()), float(values.max())

        def bound(constraints, direction, low=low, high=high):
            posed = DesignProblem("b", design, LENGTHS, constraints, (Goal(quantity, direction, at),))
            combinations = Combinations.of(posed, Catalogue(), ())
            found = Boxes(combinations, np.zeros(1, np.intp), low[None], high[None]).bound()[0]
            return found, combinations.problem

        for direction, extreme in (("min", least), ("max", most)):
            found, posed = bound((), direction)
            sign = 1 if direction == "min" else -1
            told = np.log(extreme) if quantity.positive else extreme / posed.goal_scale(0)
            assert sign * told >= found - 1e-12 * (1 + abs(told)), (low, high)
        assert bound((Constraint(quantity, None, least, at),), "min")[0] < np.inf, (low, high)
        assert bound((Constraint(quantity, most, None, at),), "min")[0] < np.inf, (low, high)
        checked += 1
    assert checked > 10
