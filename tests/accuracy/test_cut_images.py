"""Diffraction images of cut pupils: Huygens's integral in three programs, the closed image's limit, slivers, energy."""

import math

import mpmath as mp
import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.accuracy.cut_methods import light_at, lines, pixel_places, pupil_nodes
from roslf_design.accuracy.jobs import CUT, Job, panel_jobs
from roslf_design.accuracy.methods import methods
from roslf_design.accuracy.references import reference
from roslf_design.accuracy.slices import gauss
from studies.accuracy.oracles.discs import area
from tests.oracles.huygens import aperture, from_pupil, towards_sensor

PAPER = roslf.load("paper")
JOBS = panel_jobs(PAPER, CUT)


def method(name):
    return next(one for one in methods(CUT) if one.name == name)


def test_there_are_eyes_of_every_kind():
    assert set(JOBS) == {"cat's eye, N_F 0.9", "cat's eye, N_F 4", "cat's eye, N_F 24", "almost closed", "barely cut"}
    shares = {name: area(*job.discs, digits=20) / (math.pi * job.radius**2) for name, job in JOBS.items()}
    assert 0.3 < shares["cat's eye, N_F 4"] < 0.7
    assert shares["almost closed"] < 0.02
    assert 0 < 1 - shares["barely cut"] < 1e-6


def test_a_line_is_huygens_integral_over_the_aperture():
    """Path lengths over the microlens, squared, over the pixel: another program's field, with this one's blur alone."""
    job = JOBS["cat's eye, N_F 0.9"]
    design = job.design
    x = np.array([0.4, 3.3, -5.1])
    v, dv = aperture(design, 60)
    nodes, weights = np.polynomial.legendre.leggauss(24)
    places = (x[:, None] + 0.5 * nodes) * design.q
    field = towards_sensor(design, places.ravel(), v) @ (dv[:, None] * from_pupil(design, np.zeros(1), 0.0, v))
    light = np.abs(field[:, 0]) ** 2 / (design.wavelength * design.d_2 * design.d)
    pixels = 0.5 * (light.reshape(places.shape) @ weights) * design.q
    assert np.allclose(lines(job, x, np.zeros(1))[:, 0], pixels, rtol=0, atol=1e-13)


def test_reference_is_the_double_integral_by_another_program():
    """One pixel of a cat's eye in focus: sinc^2 over pixel and pupil by mpmath's own rule, to eleven digits."""
    camera = JOBS["cat's eye, N_F 0.9"].design
    camera = camera.replace({"microlens_array.focal_length": 1 / (1 / camera.d_2 - 1 / 460)})
    job = Job(CUT, camera, JOBS["cat's eye, N_F 0.9"].axis)
    assert abs(job.blur[2]) < 1e-12
    w, _, _ = job.blur
    x, y = pixel_places(job)
    image = reference(job).reshape(y.size, x.size)
    i, j = x.size // 2, y.size // 2 + 2

    def line(off):
        """Of sinc^2(t/w)/w from off - 1/2 to off + 1/2."""
        ends = [mp.pi * (off + side) / w for side in (-0.5, 0.5)]
        total = [(mp.si(2 * t) - mp.sin(t) ** 2 / t if t else mp.mpf(0)) / mp.pi for t in ends]
        return total[1] - total[0]

    centres, radii = ([[mp.mpf(float(v)) for v in c] for c in job.discs[0]], [mp.mpf(float(r)) for r in job.discs[1]])
    with mp.workdps(15):
        low = max(c[0] - r for c, r in zip(centres, radii, strict=True))
        high = min(c[0] + r for c, r in zip(centres, radii, strict=True))
        (ax, ay), (bx, by) = centres
        apart = mp.hypot(bx - ax, by - ay)
        t = (apart**2 + radii[0] ** 2 - radii[1] ** 2) / (2 * apart**2)
        assert abs(by - ay) < 1e-9  # the microlens lies on the x axis
        cross = ax + t * (bx - ax)

        def column(a):
            half = [mp.sqrt(max(r * r - (a - c[0]) ** 2, 0)) for c, r in zip(centres, radii, strict=True)]
            top = min(c[1] + h for c, h in zip(centres, half, strict=True))
            bottom = max(c[1] - h for c, h in zip(centres, half, strict=True))
            inner = mp.quad(lambda b: line(mp.mpf(float(y[j])) - b), [bottom, top], maxdegree=4)
            return inner * line(mp.mpf(float(x[i])) - a)

        exact = mp.quad(column, sorted([low, cross, high]), maxdegree=4)
    assert image[j, i] > 0.1
    assert abs(image[j, i] - float(exact)) < 1e-11


@pytest.mark.parametrize("name", JOBS)
def test_outline_and_inside_are_huygens(name):
    """Three ways that share no quadrature: along the rims, over slices, and rows of directly squared fields."""
    job, truth = JOBS[name], reference(JOBS[name])
    assert job.error(method("arc integrals").compute(job, 24, 0), truth) < 3e-10
    if not name.endswith("24"):
        assert job.error(method("arc integrals").compute(job, 24, 0), truth) < 1e-12
        assert job.error(method("Gauss panels").compute(job, 16, 0), truth) < 1e-8
        assert job.error(method("FFT").compute(job, 4, 0), truth) < 5e-3


def test_arcs_converge_exponentially_and_the_fft_by_its_square():
    job, truth = JOBS["cat's eye, N_F 0.9"], reference(JOBS["cat's eye, N_F 0.9"])
    arcs = [job.error(method("arc integrals").compute(job, n, 0), truth) for n in (1, 2, 4, 8)]
    assert arcs[1] < 0.3 * arcs[0]
    assert arcs[3] < 1e-3 * arcs[2] < 1e-3 * 0.05 * arcs[1]
    fft = [job.error(method("FFT").compute(job, n, 0), truth) for n in (1, 2, 4)]
    assert fft[2] < fft[1] / 3 < fft[0] / 9


def test_without_diffraction_it_is_the_shape():
    """Waves a thousand times shorter: what is left is the ray image, but for a pixel's rim of w."""
    eye = JOBS["cat's eye, N_F 24"].design
    job = Job(CUT, eye.replace({"light.wavelength": eye.wavelength / 10}), JOBS["cat's eye, N_F 24"].axis)
    rays = method("rays alone").compute(job, 0, 0)
    waves = method("arc integrals").compute(job, 24, 0)
    inside = rays == 1.0
    assert inside.any()
    assert np.abs(waves[inside] - 1).max() < 0.02
    assert abs(waves.sum() - rays.sum()) < 0.01 * rays.sum()


def test_no_light_from_a_dark_pupil_and_all_of_a_whole_one():
    assert light_at(np.array([[0.0, 0.0], [9.0, 0.0]]), np.array([1.0, 2.0]), 0.5, (0.0, 0.0)) == 0
    wide = light_at(np.array([[0.0, 0.0]]), np.array([400.0]), 0.5, (0.3, -0.2))
    assert wide == pytest.approx(1, abs=2e-3)  # tails beyond: 2 w/(pi^2 r) on each axis


@pytest.mark.parametrize("gap", [0.03, 0.02, 0.0195, 1e-3, 1e-9, 1e-14])
def test_sliver_and_outline_meet_at_their_seam(gap):
    """Either way at both sides of the branch: the same to rounding of what the outline's two sides cancel."""
    from roslf_design.accuracy import cut_methods

    centres, radii = np.array([[0.0, 0.0], [1 + 5 - gap, 0.0]]), np.array([1.0, 5.0])
    values = []
    for seam in (0.0, 1.0):
        before, cut_methods.SLIVER = cut_methods.SLIVER, seam
        try:
            values.append(light_at(centres, radii, 0.4, (0.9, 0.1)))
        finally:
            cut_methods.SLIVER = before
    assert abs(values[0] - values[1]) < 3e-14
    points, weights = pupil_nodes(centres, radii, 24)
    assert weights.sum() == pytest.approx(float(area(centres, radii, digits=40)), rel=1e-14)
    assert (np.hypot(*points.T) <= 1 + 1e-12).all()


def test_gauss_rule_keeps_its_small_weights():
    for count in (1, 2, 7, 24, 60):
        nodes, weights = gauss(count)
        assert weights.sum() == pytest.approx(1, abs=1e-15 * count)
        for power in range(0, 2 * count, max(1, count // 5)):
            assert (weights * nodes**power).sum() == pytest.approx(1 / (power + 1), rel=3e-15 * count)
    with mp.workdps(30):
        # The first weight of the rule of 60 by its formula, x found in the angle.
        t = mp.findroot(lambda t: mp.legendre(60, mp.cos(t)), (0.035, 0.044), solver="anderson")
        slope = mp.diff(lambda t: mp.legendre(60, mp.cos(t)), t)
        assert float(1 / slope**2) == pytest.approx(gauss(60)[1][-1], rel=1e-13)
