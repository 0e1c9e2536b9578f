"""What no choice can give for the bore is said before any search: against designs all over the bounds, and rays."""

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.cli import main
from roslf_design.design.parts import Stop
from roslf_design.optimization.problem import sobol_units
from roslf_design.optimization.reach import OF_LIGHT, unreachable
from roslf_design.theory.quantities import QUANTITIES
from tests.evaluation.test_lit_field import PORT
from tests.optimization.posing import goal, limit, posed

WINDOW = {"kind": "plate", "distance": 97.0, "thickness": 3.0, "material": "sapphire", "diameter": 10.0}
GLAZED = PORT.replace({"stops": [{"diameter": 10.0, "distance": 10.0}], "elements": [WINDOW]})
LEANT = PORT.replace({"aperture.decentre": (0.3, -0.2), "stops.1.decentre": (-0.4, 0.0)})
WIDE = PORT.replace({"sensor.size": [60.0, 60.0], "microlens_array.size": [60.0, 60.0]})
BOUNDS = {"f": (40, 62), "D_F": (2, 6), "d_3": (20, 70), "stops.1.diameter": (6, 11), "stops.1.distance": (85, 105)}
ASKED = (
    ("field_half_width_mm", 100.0),
    ("field_half_diagonal_mm", None),
    ("round_field_radius_mm", 60.0),
    ("round_field_radius_mm", 100.0),
    ("field_half_height_mm", 160.0),
    ("field_of_view_deg", None),
    ("field_half_angle_deg", None),
    ("round_field_of_view_deg", None),
    ("tip_field_of_view_deg", 100.0),
)
FREE = {name: ends for name, ends in BOUNDS.items() if name[:2] != "st"}


def reached(problem, name, at, count=1000):
    """Most of a quantity, as pages tell it, of designs all over the bounds, their corners among them."""
    ends = np.array(np.meshgrid(*[(0.0, 1.0)] * problem.n)).reshape(problem.n, -1).T
    with np.errstate(all="ignore"):
        cameras = problem.cameras(np.vstack([ends, sobol_units(problem.n, count, 3)]))
        values = np.broadcast_to(QUANTITIES[name](cameras, at), cameras.shape)
        ahead = cameras["main_lens.focal_length"] < cameras.seen.d_f
        there = ahead & (cameras.seen.d_f > cameras.tip) & np.isfinite(values)
        # Half a pitch counts as field where nothing is lit.
        lit = values > 1.01 * np.asarray(cameras.d / 2 * np.abs(cameras.seen.inverse_m)) if "mm" in name else True
    return float(np.max(values, where=there & lit, initial=0.0))


@pytest.mark.parametrize("design", [WIDE, WIDE.replace({"microlens_array.distance": 60.0}), GLAZED, LEANT])
@pytest.mark.parametrize(("name", "at"), ASKED)
def test_no_design_within_the_bounds_reaches_what_is_called_out_of_reach(design, name, at):
    bounds = BOUNDS if len(design.stops) > 1 else FREE
    most = reached(posed(bounds, (), goal("sigma_z_mm", "min"), design=design), name, at)
    asked = [limit(name, (1 + 1e-9) * most * step, at=at) for step in np.linspace(0.2, 3, 57)]
    asked = [one for one in asked if one.min < one.quantity.most]
    problem = posed(bounds, asked, goal("sigma_z_mm", "min"), design=design)
    told = [problem.constraints[one.constraint].min for one in unreachable(problem)]
    assert all(least > most for least in told)
    assert told == [one.min for one in asked if told and one.min >= told[0]]
    assert told or (at is None and float(problem.cameras(np.zeros((1, problem.n))).seen.d_f[0]) != PORT.d_f)


@pytest.mark.parametrize(("stops", "at"), [((10.0, 10.0, 10.0, 100.0), 100.0), ((6.0, 20.0, 9.0, 70.0), 40.0)])
def test_what_is_told_is_what_lines_through_both_rims_reach(stops, at):
    (one, near, other, far), rng = stops, np.random.default_rng(2)
    design = PORT.replace({"stops": [{"diameter": one, "distance": near}, {"diameter": other, "distance": far}]})
    inner, outer = (w / 2 * np.exp(2j * np.pi * rng.random(200_000)) for w in (one, other))
    line = np.abs(outer + (outer - inner) * at / (far - near)).max()
    problem = posed({"D_F": (30, 40), "d_3": (1, 2)}, [limit("round_field_radius_mm", 3 * line, at=at)], design=design)
    (told,) = unreachable(problem)
    assert told.missed.value == pytest.approx(line, rel=1e-3)
    assert told.words.endswith(f"widen the bore, or require at most {told.missed.value:.4g} mm")
    rims = [Stop(diameter=one, distance=near), Stop(diameter=other, distance=far)]
    bare = posed({"f": (40, 60)}, [limit("field_half_width_mm", 1.01 * line, at=at)], design=PORT)
    assert [one.missed.value for one in unreachable(bare, rims)] == [told.missed.value]
    assert not unreachable(posed({"f": (40, 60)}, [limit("field_half_width_mm", 0.99 * line, at=at)]), rims)


@pytest.mark.parametrize(("name", "at"), [("mtf50_lp_per_mm", None), ("mtf10_lp_per_mm", 100.0)])
def test_no_design_shows_finer_detail_than_the_widest_aperture_diffracts(name, at):
    """Arrays and pixels far finer than any, so that the FAP alone ends detail: it comes within a quarter."""
    design = PORT.replace({"d_2": 0.02, "microlens_array.pitch": 0.003, "sensor.pixel": 1e-4})
    bounds = {"D_F": (2, 4), "d_3": (20, 70), "f": (45, 50), "wavelength": (4.5e-4, 6.5e-4)}
    most = reached(posed(bounds, (), design=design), name, at, 60)
    told = [unreachable(posed(bounds, [limit(name, share * most, at=at)], design=design)) for share in (1.0, 1.35)]
    assert [len(one) for one in told] == [0, 1]


def test_light_that_is_required_where_none_comes_from_is_out_of_reach():
    for name in OF_LIGHT:
        asked = [{"object_height": f"{away} mm", "at": "100 mm", "min": 0.1} for away in (12, 30)]
        problem = posed(
            {"d_2": (0.5, 2)}, (), goal("sigma_z_mm", "min"), design=PORT.replace({"required": {name: asked}})
        )
        (told,) = unreachable(problem, required=True)
        assert "30 mm from the axis" in told.words
        assert "beyond 16.11 mm there, whatever the lens; widen the bore, or require it to 16.11 mm" in told.words


def test_depth_of_a_given_disparity_error_has_a_least_within_the_bounds():
    bounds = {"D_F": (1.0, 4.0), "d_2": (0.5, 2.0)}
    problem = posed(
        bounds, (), goal("sigma_z_mm", "min"), design=roslf.load("paper").replace({"depth.disparity_error": 0.1})
    )
    units = sobol_units(2, 4000, 1)
    best = float(np.min(QUANTITIES["sigma_z_mm"](problem.cameras(units), None)))
    for share, beyond in ((1.0, 0), (0.9, 1)):
        again = posed(
            bounds, [limit("sigma_z_mm", high=share * best)], goal("sigma_z_mm", "min"), design=problem.design
        )
        assert len(unreachable(again)) == beyond


def test_depth_is_not_refused_where_an_image_may_be_none():
    """From 20 mm on, before the focal length: of such a box nothing is proven."""
    bounds = {"D_F": (1.0, 4.0), "d_f": (20.0, 400.0)}
    design = roslf.load("paper").replace({"depth.disparity_error": 0.1})
    assert not unreachable(posed(bounds, [limit("sigma_z_mm", high=1e-9)], goal("f", "min"), design=design))


def test_a_study_that_asks_for_it_ends_at_once_with_the_numbers(capsys, tmp_path):
    study = tmp_path / "wide.toml"
    (tmp_path / "port.toml").write_text(roslf.dumps(PORT))
    study.write_text(
        'name = "wide"\ndesign = "port.toml"\n[variables]\nf = ["40 mm", "60 mm"]\n'
        '[[constraints]]\nquantity = "field_half_width_mm"\nat = "100 mm"\nmin = "25 mm"\n'
        '[[constraints]]\nquantity = "fill_factor"\nmax = 1.5\n'
        '[[goals]]\nquantity = "views_independent"\ndirection = "max"\n'
    )
    assert main(["optimize", str(study), "-o", str(tmp_path / "out"), "--strict"]) == 1
    out = " ".join(capsys.readouterr().out.split())
    said = (
        "no ray passes stop 1 and stop 2 beyond 16.11 mm there, whatever the lens; widen the bore, or require at most"
    )
    assert f"{said} 16.11 mm" in out
    result = roslf.optimize(study)
    assert result.answer.status == "infeasible"
    conflict = result.to_dict()["infeasible"]
    assert conflict["proven"]
    assert said in conflict["reason"]
    assert result.answer.evaluations < 300
