"""One uncertainty of depth of a camera at a plane, wherever it is told, and what temperature adds, by warm cameras."""

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.evaluation.required import required_of
from roslf_design.reporting.design.pages import design_report
from roslf_design.reporting.sheet.lines import basis
from roslf_design.theory.depth_budget import WARMTH, depth_budget
from roslf_design.tolerancing.metrics import Question, evaluate_builds
from tests.pictures.designs import UNLIKE
from tests.reporting.made import rough_resolution, views_as_refocused

WARM = {"temperature": "20 degC", "range": ["15 degC", "37 degC"], "housing": "stainless steel"}
SINGLET = roslf.load("paper-singlet").replace({"environment": WARM})
DESIGNS = {name: roslf.load(name) for name in UNLIKE} | {"warm singlet": SINGLET}


@pytest.fixture(autouse=True)
def _depth_alone(monkeypatch):
    """Nobody here looks at what is resolved, half of what a sheet takes."""
    rough_resolution(monkeypatch)
    views_as_refocused(monkeypatch)


@pytest.mark.parametrize("design", DESIGNS.values(), ids=DESIGNS)
def test_sheet_table_and_evaluation_tell_one_uncertainty(design):
    ahead = float(roslf.quantity("working_distance_mm")(Camera.of(design)))
    design = design.replace({"required": {"u_z_mm": {"at": f"{ahead} mm", "max": "1 m"}}})
    told = roslf.evaluate(design, at=ahead)
    u = told.depth.expected["u_z_mm"]
    lines = {row.name: row.value for row in basis(design, at=(ahead,)).rows}
    assert next(v for name, v in lines.items() if name.startswith("standard uncertainty u")) == u
    assert next(v for name, v in lines.items() if name.startswith("depth, expected, u_Z at")) == pytest.approx(u)
    assert next(v for name, v in lines.items() if name.startswith("U at")) == pytest.approx(2 * u)
    assert [one.value for one in told.required] == [one.value for one in required_of(design)] == pytest.approx([u])
    assert roslf.evaluate_many([design], ["u_z_mm"]).columns["u_z_mm"] == pytest.approx([u])
    assert [plane.u_z_mm for plane in told.answer.at] == pytest.approx([u], rel=1e-9)  # in focus, asked for or not


def test_pages_of_a_report_tell_it_too(without_figures):
    u = roslf.evaluate(SINGLET).depth.expected["u_z_mm"]
    blocks = [block for section in design_report(SINGLET).sections for block in section.blocks]
    rows = [row for block in blocks for row in getattr(block, "rows", ()) if str(row[0]).startswith("together, u")]
    assert {row[1].split()[0] for row in rows} == {f"{u:.3g}"}


def test_builds_behind_a_real_lens_tell_it_too():
    question = Question(SINGLET, ("u_z_mm",), ((0.0, 0.0),), SINGLET.d_f)
    ((u, again),) = evaluate_builds(question, {"aperture.diameter": np.full(2, SINGLET.D_F)}, 2)
    assert u == again == pytest.approx(float(depth_budget(Camera.of(SINGLET)).u_z_mm))


def test_temperature_is_that_of_the_camera_made_cold_and_warm():
    """Root mean square over the range, of the plane in focus ahead of the tip."""
    cameras = [Camera.of(SINGLET.at_temperature(degrees)) for degrees in np.linspace(15.0, 37.0, 45)]
    moved = [float(camera["main_lens.focal_plane"] - camera.tip) for camera in cameras]
    shifts = np.array(moved) - moved[22]
    term = next(term for term in depth_budget(Camera.of(SINGLET)).terms if term.name == WARMTH)
    assert term.u_mm == pytest.approx(np.sqrt(np.trapezoid(shifts**2, dx=1 / 44)), rel=1e-3)


def test_a_range_tells_the_worst_of_it_as_a_camera_used_there_alone_has_it():
    """U over a range is a mean over it: less than where the camera is worst."""
    known = {"calibrated_at": "26 degC", "housing": "stainless steel"}
    ends = {end: SINGLET.replace({"environment": known | {"temperature": f"{end} degC"}}) for end in (15, 37)}
    worst = {end: float(depth_budget(Camera.of(one)).expanded_mm) for end, one in ends.items()}
    end = max(worst, key=worst.get)
    budget = depth_budget(Camera.of(SINGLET))
    assert budget.caution.startswith(f"at {end} °C, the worse end of environment.range, U = ")
    told = float(budget.caution.split(" = ")[1].split()[0])
    assert budget.to_dict()["caution"] == budget.caution
    assert told == pytest.approx(worst[end], rel=3e-2)  # the camera is focused where it is, here at another temperature
    assert told > budget.expanded_mm
    assert not depth_budget(Camera.of(ends[end])).caution
    assert depth_budget(Camera.of(SINGLET), np.array([240.0])).worst is None  # of one camera at one distance alone
