"""Rays through real lenses: exact trace against many digits, the surrogate by order, the thin lens as a floor."""

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.accuracy.jobs import LENS, Job, panel_jobs
from roslf_design.accuracy.lens_jobs import EVERY, RAYS, lens_designs, microlens_rays, with_lens
from roslf_design.accuracy.lens_methods import surrogate_of
from roslf_design.accuracy.measure import model_error, work_diagram
from roslf_design.accuracy.methods import methods
from roslf_design.accuracy.references import reference
from roslf_design.lenses.lens_file import shipped_names

PAPER = roslf.load("paper")
JOBS = panel_jobs(PAPER, LENS)
METHODS = {one.name: one for one in methods(LENS)}


def test_every_shipped_lens_is_there():
    assert {name.lower() for name in JOBS} == set(shipped_names())
    own = lens_designs(roslf.load("paper-singlet"))
    assert next(iter(own)).lower().startswith("la1050-a")
    assert with_lens(PAPER.replace(d_3=1e-3), "LB1630-A") is None  # the FAP would stand inside the lens


@pytest.mark.parametrize("name", JOBS)
def test_exact_trace_keeps_its_digits_and_the_surrogate_its_word(name):
    job = JOBS[name]
    truth = reference(job)
    assert truth.size == 2 * RAYS // EVERY
    assert job.error(METHODS["exact trace"].compute(job, 0, 0), truth) < 2e-12
    sample = job.design.d * job.design.d_f / job.design.d_1
    for order in (2, 4):
        found = surrogate_of(job.design, order)
        error = job.error(METHODS["polynomial surrogate"].compute(job, order, 0), truth)
        assert error * sample <= found.object_error * 1.01  # that it states itself, over held-out rays


def test_surrogate_gains_two_digits_an_order_at_first():
    job = JOBS["AC508-100-A"]
    errors = [job.error(METHODS["polynomial surrogate"].compute(job, n, 0), reference(job)) for n in (1, 2, 4)]
    assert errors[1] < 0.05 * errors[0]
    assert errors[2] < 0.05 * errors[1]


def test_thin_lens_is_a_floor_line():
    job = JOBS["LA1050-A"]
    floor = model_error(job)
    assert floor == job.error(METHODS["thin lens"].compute(job, 0, 0), reference(job))
    assert floor > 1  # more than one microlens's sample on the focal plane
    # Stopped down and near the axis a lens is thin, but for its constants.
    near = Job(LENS, with_lens(PAPER.replace(D_F=0.05), "LA1050-A"), (1e-3, 0.0))
    assert model_error(near) < 1e-3 * floor


def test_thin_rays_fill_the_pupil():
    job = JOBS["LB1630-A"]
    place, slope = microlens_rays(job.design, job.axis)
    twin = job.design.thin_twin
    height = place - slope * twin.d_1
    at_pupil = height - (slope + height / twin.f) * twin.d_3
    radius = np.hypot(*at_pupil) / (twin.D_F / 2)
    assert radius.max() == pytest.approx(0.9, abs=1e-3)
    assert np.mean(radius**2) == pytest.approx(0.81 / 2, rel=1e-3)  # evenly


def test_diagram_has_all_methods():
    diagram = work_diagram("LB1630-A", JOBS["LB1630-A"], repeats=1)
    assert {point.method for point in diagram.points} == set(METHODS)
    assert diagram.floor is not None
