"""How sure lengths are: what corners alone tell of them, against draws of whole calibrations; what builds miss."""

import json

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.calibration.lengths import ImageShare, calibrated_lengths
from roslf_design.calibration.options import PlanOptions, calibration_plan, data_sheet, planned_lengths
from roslf_design.calibration.planning import camera_of
from roslf_design.calibration.posterior import laplace_draws
from roslf_design.calibration.written import _FoundCovariance
from roslf_design.camera import Camera
from roslf_design.design import PATHS
from roslf_design.reporting.story import quick_study
from roslf_design.theory.depth_budget import depth_budget
from roslf_design.theory.exit_pupil import microlens_image_diameter, microlens_image_pitch
from roslf_design.theory.length_covariance import LengthCovariance
from roslf_design.tolerancing.study import plan_from, tolerance_plan
from roslf_design.tolerancing.trials import first_builds, lengths_built

pytestmark = pytest.mark.usefixtures("found_once")
WINDOWED = roslf.load("paper").replace({
    "object_space.medium": "water",
    "elements": [{"kind": "plate", "distance": 130.0, "thickness": 1.0, "material": "sapphire"}],
})  # fmt: skip


@pytest.mark.parametrize(
    ("design", "options"),
    [
        ("paper", {}),
        ("paper", {"white_pitch": "0.01 %"}),
        ("rigid-scope", {"cell_sigma": "0 %", "f_sigma": "0.2 %"}),
        (WINDOWED, {"sigma": {"elements.0.thickness": "0.02 mm"}}),
    ],
)
def test_information_with_the_data_sheet_is_the_calibration_s_covariance(design, options):
    """Draws go from the fit to lengths, each by the exact formulas; information by its Jacobian, priors put to it."""
    design = roslf.load(design) if isinstance(design, str) else design
    lengths = planned_lengths(design, PlanOptions(**options))
    places, matrix = lengths.covariance
    values = np.abs([float(Camera.of(design)[place]) for place in places])
    values[places.index("sensor.pixel")] = 0.0  # q is known
    sheet = np.array([lengths.sheet[lengths.information.places.index(place)] for place in places])
    before = LengthCovariance(places, np.diag(np.where(np.isfinite(sheet), sheet, 1e3 * values) ** 2))
    after = before.informed(lengths.information.of(places).matrix).matrix
    sigma = np.sqrt(np.diag(matrix))
    known = sigma > 1e-9 * np.maximum(values, 1e-6)
    unit = np.where(known, sigma, 1.0)
    # 20,000 draws tell variances to 1 %; that of d_2, the inverse of what is known to 6 %, is 3 % above first order.
    np.testing.assert_allclose(after / np.outer(unit, unit), matrix / np.outer(unit, unit) * known, atol=0.04)
    back = _FoundCovariance.model_validate(json.loads(json.dumps(lengths.to_dict()))).lengths()
    assert back.to_dict() == lengths.to_dict()


@pytest.mark.parametrize("design", ["paper", WINDOWED], ids=["paper", "windowed"])
def test_a_white_image_that_tells_the_pupil(design):
    """D_F follows from the images' share of the pitch and from lengths: draw by draw, and by information with the data
    sheet; a workshop's builds know it no worse than the white image says."""
    design = roslf.load(design) if isinstance(design, str) else design
    asked = PlanOptions()
    best = calibration_plan(design, asked)
    sheet = data_sheet(design, best.captures.board, asked)
    fit, data = best.expected.typical
    draws = laplace_draws(fit, sheet, 20_000, np.random.default_rng(0), data)
    plain = calibrated_lengths(design, draws, fit, sheet, data)
    c = Camera.of(design)
    share, sigma = abs(float(microlens_image_diameter(c) / microlens_image_pitch(c))), 0.004
    images = ImageShare(0.9 * share, sigma)
    lengths = calibrated_lengths(design, draws, fit, sheet, data, images)
    places, matrix = lengths.covariance
    assert places == (*plain.covariance.places, "aperture.diameter")
    np.testing.assert_allclose(matrix[:-1, :-1], plain.covariance.matrix)
    # A camera with such lengths, one after another.
    one = images.pupil(design, {place: float(c[place]) for place in plain.covariance.places})["aperture.diameter"]
    assert float(one) == pytest.approx(0.9 * design.D_F, rel=1e-9)
    alone = plain.covariance.carried(
        c, lambda builds: np.log(microlens_image_diameter(builds) / microlens_image_pitch(builds))
    )
    assert np.sqrt(matrix[-1, -1]) == pytest.approx(0.9 * design.D_F * np.hypot(sigma, float(alone)), rel=0.05)
    sheet_sigma = np.array([lengths.sheet[lengths.information.places.index(place)] for place in places])
    values = np.abs([float(c[place]) for place in places])
    values[places.index("sensor.pixel")] = 0.0
    before = LengthCovariance(places, np.diag(np.where(np.isfinite(sheet_sigma), sheet_sigma, 1e3 * values) ** 2))
    after = before.informed(lengths.information.of(places).matrix).matrix
    unit = np.sqrt(np.diag(matrix))
    known = unit > 1e-9 * np.maximum(values, 1e-6)
    unit = np.where(known, unit, 1.0)
    np.testing.assert_allclose(after / np.outer(unit, unit), matrix / np.outer(unit, unit) * known, atol=0.04)
    made = 1e-6 * values
    made[-1] = 0.02 * design.D_F
    told, _ = lengths.after(LengthCovariance(places, np.diag(made**2)))
    at = told.places.index("aperture.diameter")
    assert np.sqrt(told.matrix[at, at]) == pytest.approx(0.9 * design.D_F * sigma, rel=0.05)


@pytest.mark.parametrize(("reach", "tied"), [("0.5 mm", 1e-6), ("1 um", 0.05)])
def test_lengths_built_against_the_builds_themselves(reach, tied):
    """Of tied parts, a sag that is told as focal length, and a sensor that is adjusted; 4096 builds tell 1.1 %.

    Of the shorter range most builds stand at its end.
    """
    plan = plan_from({
        "name": "builds", "design": "rigid-scope", "grade": "precision", "trials": 4096,
        "perturb": [{"place": ["d_3", "d_1"], "tolerance": "0.1 mm", "group": "barrel"}],
        "groups": [{"name": "barrel", "correlation": 0.8}],
        "goals": [{"metric": "fill_factor", "min": 0.9, "max": 1.1}, {"metric": "mismatch_px", "max": 0.1}],
        "compensators": [{"place": "sensor.distance", "range": reach}],
    })  # fmt: skip
    built = lengths_built(plan)
    builds, good = first_builds(plan, 4096)
    drawn = np.cov(np.stack([np.broadcast_to(builds.camera[place], 4096)[good] for place in built.places]))
    sigma = np.sqrt(np.diag(drawn))
    np.testing.assert_allclose(built.matrix / np.outer(sigma, sigma), drawn / np.outer(sigma, sigma), atol=0.08)
    assert "main_lens.focal_plane" not in built.places
    at = [built.places.index(place) for place in ("aperture.distance", "microlens_array.distance")]
    assert built.matrix[at[0], at[1]] == pytest.approx(0.8 * np.prod(np.sqrt(np.diag(built.matrix)[at])), rel=tied)


@pytest.mark.parametrize("ahead", [0.0, 115.0])
def test_depths_by_builds_that_are_calibrated_scatter_as_the_budget_says(ahead):
    """Builds of a workshop, each calibrated: what its corners tell, drawn, its likeliest lengths, depths by those."""
    design, asked = roslf.load("paper"), PlanOptions()
    best = calibration_plan(design, asked)
    sheet = data_sheet(design, best.captures.board, asked)
    fit, plan = best.expected.typical[0], tolerance_plan(quick_study(design) | {"trials": 8192}, design)[0]
    places = [PATHS[name] for name in ("f", "d_1", "d_3", "d_2", "d")]
    built, count = lengths_built(plan), 8192
    builds, _ = first_builds(plan, count)
    true = np.stack([np.broadcast_to(builds.camera[place], count) for place in places])
    nominal = np.array([float(Camera.of(design)[place]) for place in places])

    def shown(f, d_1, d_3, d_2, d, board=1.0):
        """A, m and 1/d_2 that corners tell to one who believes in the design's d and the board's nominal size."""
        d_f = 1 / (1 / f - 1 / d_1)
        return np.stack([d_1 * (d_f - d_3) / d_f * design.d / d, d_1 / d_f * board * design.d / d,
                         d / design.d / (d_2 * board)])  # fmt: skip

    def rates(steps, board=0.0):
        return (shown(*(nominal + steps), 1 + board) - shown(*(nominal - steps), 1 - board)) / 2

    rng = np.random.default_rng(0)
    noise = np.linalg.cholesky(fit.covariance.part(("A", "m", "inverse_d_2"))) @ rng.normal(size=(3, count))
    told = shown(*true, 1 + sheet.cell_sigma * rng.normal(size=count)) + noise
    by_length = np.stack([rates(step) / step.sum() for step in np.diag(1e-6 * nominal)], 1)
    by_board = rates(0.0, 1e-6) / 1e-6 * sheet.cell_sigma
    prior = built.of(tuple(places)).matrix
    scatter = fit.covariance.part(("A", "m", "inverse_d_2")) + np.outer(by_board, by_board)
    gain = prior @ by_length.T @ np.linalg.inv(by_length @ prior @ by_length.T + scatter)
    believed = nominal[:, None] + gain @ (told - shown(*nominal)[:, None])

    def parts(f, d_1, d_3, d_2, d):
        d_f = 1 / (1 / f - 1 / d_1)
        return d_1 * (d_f - d_3) / d_f, d_1 / d_f, d_3, d_2 * d

    z = design.d_f + ahead
    A, m, d_3, unit = parts(*true)
    slope = (m - A / (z - d_3)) * A / unit
    A, m, d_3, unit = parts(*believed)
    rms = np.std(d_3 + A / (m - slope * unit / A) - z)
    lengths = best.expected.lengths(design, sheet)
    budget = depth_budget(Camera.of(design), z - design.d_3, build=built, calibration=lengths)
    # 8192 builds tell it to 0.8 %, and the likeliest lengths are those of straight formulas.
    assert float(budget.of_kind("trueness")) == pytest.approx(rms, rel=0.03)


def test_corners_see_elements_that_nobody_calibrates():
    """Boards stand before them: what they are off is in A, m and d_2 as the boards' medium has them."""
    design, asked = roslf.load("cystoscope"), PlanOptions()
    best = calibration_plan(design, asked)
    sheet = data_sheet(design, best.captures.board, asked)
    fit, lengths = best.expected.typical[0], best.expected.lengths(design, sheet)
    m, inverse_d_2 = camera_of(design).vector()[1:3]
    by_board = np.array([0.0, m, -inverse_d_2]) * sheet.cell_sigma
    spread = fit.covariance.part(("A", "m", "inverse_d_2")) + np.outer(by_board, by_board)
    seen = [place for place in lengths.information.places if place.startswith("elements.")]
    assert seen
    for place in seen[:3]:
        step = 1e-6 * float(Camera.of(design)[place])
        ends = [design.replace({place: float(Camera.of(design)[place]) + off}, d_1=design.d_1) for off in (step, -step)]
        ahead, behind = (camera_of(end).vector()[:3] for end in ends)
        rate = (ahead - behind) / (2 * step)
        told = lengths.information.of((place,)).matrix[0, 0]
        assert told == pytest.approx(rate @ np.linalg.solve(spread, rate), rel=0.02), place  # about the mean of draws
    unfocused = quick_study(design) | {"compensators": [{"place": "calibration"}]}
    built = lengths_built(tolerance_plan(unfocused, design)[0])
    camera = Camera.of(design)
    assert (
        depth_budget(camera, build=built, calibration=lengths).u_z_mm < 0.1 * depth_budget(camera, build=built).u_z_mm
    )
