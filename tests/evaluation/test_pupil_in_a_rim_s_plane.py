"""A pupil in the plane of a rim, as at d_3 = 0: the rim cuts all microlens images alike, or none, and all say so."""

import math

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.design import PATHS
from roslf_design.effects import plan
from roslf_design.evaluation import evaluate
from roslf_design.explorer.fixes import proposals
from roslf_design.optimization.solve import Settings, solve
from roslf_design.theory.quantities import QUANTITIES
from roslf_design.theory.stop_images import MicrolensImages
from roslf_design.tolerancing.metrics import METRICS
from tests.optimization.posing import PAPER, goal, limit, posed

D = PAPER.D
PLATE = {"kind": "plate", "distance": "60 mm", "thickness": "3 mm", "material": "N-BK7", "diameter": "400 mm"}


def stop(diameter, **more):
    return {"stops": [{"diameter": diameter, "distance": 120.0, **more}]}


def aside(x, y):
    return {"aperture.decentre": (x, y)}


WHOLE = {
    "as wide as the lens": {"d_3": 0.0, "D_F": D},
    "a hair narrower": {"d_3": 0.0, "D_F": D - 1e-9},
    "a last digit narrower": {"d_3": 0.0, "D_F": math.nextafter(D, 0)},
    "touching aside": {"d_3": 0.0, "D_F": 50.7, **aside(0.05, 0.0)},
    "touching slantwise": {"d_3": 0.0, "D_F": D - 0.1, **aside(0.03, -0.04)},
    "touching with both aside": {"d_3": 0.0, "D_F": D - 0.2, **aside(0.3, 0.0), "main_lens.decentre": (0.2, 0.0)},
    "as wide as a stop beside it": {"D": 300.0, **stop(2.9)},
    "touching a stop beside it": {"D": 300.0, "D_F": 2.8, **aside(0.03, 0.04), **stop(2.9)},
    "a stop beside it, both aside": {"D": 300.0, "D_F": 2.7, **aside(0.31, 0.0), **stop(2.9, decentre=(0.21, 0.0))},
    "a stop beside it behind glass": {"D": 300.0, "elements": [PLATE], **stop(2.9)},
    "next to nothing before the lens": {"d_3": 1e-300, "D_F": D},
}
CUT = {
    "a hair wider": {"d_3": 0.0, "D_F": D + 1e-9},
    "aside": {"d_3": 0.0, "D_F": D, **aside(1e-9, 0.0)},
    "a stop narrower": {"D": 300.0, **stop(2.9 - 1e-9)},
    "a hair before the lens": {"d_3": 1e-9, "D_F": D},
}


def made(changes):
    """The paper's bench with other numbers."""
    return PAPER.replace({PATHS.get(name, name): value for name, value in changes.items()})


def rays_through(design, field):
    """Whether the straight rays of a field point by the FAP's rim, a last digit within, pass every rim: by hand."""
    turns = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    ring = design.D_F / 2 * (1 - 1e-13) * np.stack([np.cos(turns), np.sin(turns)])
    point = np.array([[field], [0.0]])
    at = ring + np.reshape(design.aperture.decentre, (2, 1))
    passed = True
    for rim in (design.main_lens, *design.stops):
        z = getattr(rim, "distance", 0.0) if rim is not design.main_lens else 0.0
        on = at + (point - at) * (z - design.d_3) / (design.d_f - design.d_3)
        passed &= bool(np.all(np.hypot(*(on - np.reshape(rim.decentre, (2, 1)))) <= rim.diameter / 2))
    return passed


@pytest.mark.parametrize("changes", WHOLE.values(), ids=WHOLE.keys())
def test_any_field_is_whole(changes):
    design = made(changes)
    if not design.elements:
        assert all(rays_through(design, field) for field in (0.0, 30.0, -200.0, *([] if design.d_3 else [1e3, -1e4])))
    told = evaluate(design)
    assert told.non_distortion.undistorted_in_field
    most = math.inf
    if design.stops:  # beside it there is a lens of 300 mm, which ends the field some 280 mm off the axis
        assert told.non_distortion.limited_by == "main lens"
        most = told.non_distortion.x0_max_mm
        assert 250 < most < 300
    assert told.non_distortion.x0_max_mm == most
    verdict = next(answer for answer in told.verdicts if answer.name == "field_undistorted")
    assert verdict.ok
    assert ("full discs at any field" in verdict.text) == math.isinf(most)
    assert [(field.status, field.kept_fraction) for field in told.fields] == [("full", 1.0)] * 3
    camera = Camera.of(design)
    assert QUANTITIES["undistorted_field_mm"](camera) == most
    assert QUANTITIES["non_distortion_room_mm"](camera) >= 0
    assert METRICS["undistorted_field_mm"](camera) == most
    images = MicrolensImages(camera, [(0.0, 0.0), (11.0, 0.0), (-7.0, 9.0), (60.0, -40.0)])
    assert np.all(images.clearance >= 0)
    assert np.all(images.shapes.kept_fraction == 1)
    assert plan(design)["vignetting"].estimate == 0
    assert "the whole sensor is undistorted already" in [proposal.why_not for proposal in proposals(design)]
    problem = posed({"d_2": (1.0, 2.0)}, [limit("undistorted_field_mm", 240.0)], goal("light_sr", "max"), design=design)
    rows = problem.vector(np.full((1, 1), 0.5))
    assert np.isfinite(rows).all()
    assert rows[1:].max() <= 0


@pytest.mark.parametrize("changes", CUT.values(), ids=CUT.keys())
def test_no_field_is_whole(changes):
    design = made(changes)
    assert not rays_through(design, 0.0)
    told = evaluate(design)
    assert not told.non_distortion.undistorted_in_field
    assert told.non_distortion.x0_max_mm == 0
    assert [field.status for field in told.fields] == ["clipped"] * 3
    camera = Camera.of(design)
    assert QUANTITIES["undistorted_field_mm"](camera) < 0
    assert MicrolensImages(camera, [(0.0, 0.0)]).clearance < 0
    assert plan(design)["vignetting"].estimate > 0
    problem = posed({"d_2": (1.0, 2.0)}, [limit("undistorted_field_mm", 0.1)], goal("light_sr", "max"), design=design)
    assert problem.vector(np.full((1, 1), 0.5))[1:].max() > 0


@pytest.mark.parametrize("most", [5.0, 1e5])
def test_the_widest_pupil_at_the_lens_is_the_lens_whatever_field_is_asked(most):
    bounds, widest = {"D_F": (1.0, 60.0)}, goal("light_sr", "max")
    problem = posed(bounds, [limit("undistorted_field_mm", most)], widest, design=PAPER.replace(d_3=0.0))
    answer = solve(problem, Settings(starts=4, check=False))
    assert answer.feasible
    assert problem.named(answer.unit)["D_F"] == pytest.approx(D, rel=1e-9)


def test_builds_at_once_are_judged_as_one_by_one():
    widths = np.array([50.0, D, D + 1e-9, 52.0])
    many = Camera.of(PAPER.replace(d_3=0.0), {"D_F": widths})
    fields = [(0.0, 0.0), (9.0, 5.0)]
    radii = QUANTITIES["undistorted_field_mm"](many)
    assert (radii == math.inf).tolist() == [True, True, False, False]
    assert np.all((MicrolensImages(many, fields).shapes.kept_fraction == 1) == [True, True, False, False])
    assert np.all((MicrolensImages(many, fields).clearance >= 0) == [True, True, False, False])


def test_a_traditional_camera_s_field_is_told_by_the_margin_s_limit():
    """Away from the lens Eq. 6 bounds the field; its bound rises without end as the FAP comes to the lens."""
    design = PAPER.replace(D_F=50.0)
    for d_3 in (1.0, 1e-3, 1e-6):
        bound = ((D - 50.0) / d_3 - D / design.d_f) / 2 * design.d_f
        told = float(QUANTITIES["undistorted_field_mm"](Camera.of(design.replace(d_3=d_3))))
        assert told == pytest.approx(bound, rel=1e-9)
    assert roslf.evaluate(design.replace(d_3=0.0)).non_distortion.x0_max_mm == math.inf
