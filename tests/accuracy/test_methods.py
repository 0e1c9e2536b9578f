"""Every method of every quantity against references, the references against others, and the rates theory gives."""

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.accuracy.jobs import CUT, QUANTITIES, Job, panel_jobs
from roslf_design.accuracy.measure import model_error
from roslf_design.accuracy.methods import methods
from roslf_design.accuracy.random_jobs import random_job, random_jobs
from roslf_design.accuracy.rates import fitted_rate
from roslf_design.accuracy.references import reference
from roslf_design.accuracy.wave_methods import centres
from tests.oracles.accuracy import quantile_spread, white_image_by_points
from studies.accuracy.oracles.discs import area, shape
from tests.oracles.huygens import disc, square_images

PAPER = roslf.load("paper")


def method(quantity, name):
    return next(one for one in methods(quantity) if one.name == name)


def several(quantity, count, seed=11):
    rng = np.random.default_rng(seed)
    return [random_job(PAPER, quantity, rng) for _ in range(count)]


BEST = {
    "closed form": (0, 1e-12),
    "exact arc-pixel area": (0, 2e-13),  # 2e-16 times the square of a radius of up to 15 pixels, several discs
    "harmonic series": (100, 2e-14),
    "Gauss panels": (24, 1e-6),
    "arc integrals": (24, 1e-12),
    "exact trace": (0, 2e-12),
    "polynomial surrogate": (4, 1e-3),
    "adaptive quadrature": (8, 1e-4),
    "grid": (64, 0.05),
    "Monte Carlo": (4096, 0.2),
    "scrambled Sobol": (4096, 0.05),
    "FFT": (256, 2e-3),
    "direct Huygens": (0, 2e-2),
}
"""Level and error that each method must at least reach on panels that are not near tangent."""
CUT_BEST = BEST | {
    "Gauss panels": (16, 1e-8), "FFT": (4, 5e-3), "Monte Carlo": (4096, 0.7), "scrambled Sobol": (4096, 0.2),
}  # fmt: skip
"""The same of cut diffraction images, whose levels count from elsewhere; a pixel's light comes from the few points of
the pupil within a blur width of it, (w/2r)^2 of them all, so that samples scatter more."""


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_every_method_comes_to_the_same(quantity):
    for name, job in panel_jobs(PAPER, quantity).items():
        if name == "near tangent" or name.endswith("N_F 24"):
            continue
        best = CUT_BEST if quantity == CUT else BEST
        for one in methods(quantity):
            if one.name in best and one.tested_on(job):
                level, most = best[one.name]
                assert job.error(one.compute(job, level, 5), reference(job)) <= most, (name, one.name)


@pytest.mark.parametrize("quantity", ["kept fraction", "area", "centroid"])
def test_near_tangent_only_what_knows_the_edges_gets_it(quantity):
    job = panel_jobs(PAPER, quantity)["near tangent"]
    truth = reference(job)
    assert job.error(method(quantity, "closed form").compute(job, 0, 0), truth) < 1e-12
    if quantity == "area":
        assert job.error(method(quantity, "Monte Carlo").compute(job, 4096, 0), truth) == 1.0  # no point hits it


def test_references_of_shapes_are_another_oracles():
    for job in several("area", 4):
        centre, radii = job.discs
        exact = area(centre, radii, digits=25)
        assert abs(reference(job)[0] - float(exact)) <= 1e-14 * max(float(exact), 1e-6)
    job = panel_jobs(PAPER, "centroid")["cat's eye"]
    _, middle, _ = shape(*job.discs, digits=25)
    assert np.allclose(reference(job), [float(v) for v in middle], rtol=0, atol=1e-13)


def test_reference_of_a_pixel_is_another_oracles():
    job = panel_jobs(PAPER, "pixel image")["cat's eye"]
    low, high = job.cells
    truth = reference(job)
    partly = np.flatnonzero((truth > 0) & (truth < 1))
    for n in partly[:: max(1, partly.size // 5)]:
        box = [low[n], [high[n, 0], low[n, 1]], high[n], [low[n, 0], high[n, 1]]]
        exact = float(area(*job.discs, np.array(box), digits=20))
        assert abs(truth[n] - exact) < 1e-14


def test_series_is_a_sum_over_explicit_neighbours():
    """In focus, 200 neighbours each way: tails of sinc^2 beyond them are 1e-3 of what is left."""
    camera = PAPER.replace({"microlens_array.focal_length": 1 / (1 / 2.0 - 1 / 460)})
    job = Job("diffraction image", camera)
    width, pitch, bend = job.blur
    assert abs(bend) < 1e-12
    x, y = centres(job)
    fine = (np.arange(4) + 0.5) / 4 - 0.5
    wide = (x[3:6, None] + fine).ravel(), (y[5:8, None] + fine).ravel()
    image = white_image_by_points(job.radius, pitch, width, *wide, disc(1.0, 18), 200)
    pixels = image.reshape(3, 4, 3, 4).mean((1, 3))
    side = job.box[1]
    assert np.abs(reference(job).reshape(side, side)[5:8, 3:6] - pixels).max() < 4e-3


def test_huygens_here_is_huygens_there():
    """Both integrate the aperture directly; one counts path lengths from the pupil, one phases on the sensor."""
    from roslf_design.accuracy.wave_methods import profile

    job = Job("diffraction image", PAPER)
    q = PAPER.q
    places = np.array([0.3, 2.2, -4.1])
    mine = profile(job, places, 0)
    width, pitch, _ = job.blur
    tail = width / (np.pi**2 * 0.5 * pitch**2)
    there = square_images(PAPER, np.zeros((1, 2)), places * q, np.array([0.0]), [0.0], 80)[0]
    peak = square_images(PAPER, np.zeros((1, 2)), np.array([0.0]), np.array([0.0]), [0.0], 80)[0, 0]
    middle = profile(job, np.array([0.0]), 0)[0] - tail
    assert np.allclose((mine - tail) / middle, there / peak, rtol=1e-9)


def test_spread_of_depths_is_that_of_the_law():
    from roslf_design.accuracy.depth_methods import spread

    for job in several("depth", 5):
        assert reference(job)[0] == pytest.approx(quantile_spread(*spread(job)), rel=1e-7)


# --- rates ------------------------------------------------------------------------------------------------------------


def cat_eyes(quantity, count=24):
    found = []
    rng = np.random.default_rng(3)
    while len(found) < count:
        job = random_job(PAPER, quantity, rng)
        if len(job.discs[1]) > 1 and 0.1 < reference(Job("kept fraction", job.design, job.axis))[0] < 0.9:
            found.append(job)
    return found


@pytest.mark.parametrize(
    ("name", "levels", "least", "most"),
    [
        ("Monte Carlo", (64, 256, 1024, 4096, 16384), -0.6, -0.4),
        ("scrambled Sobol", (64, 256, 1024, 4096, 16384), -1.05, -0.65),
        ("grid", (8, 16, 32, 64, 128, 256), -1.05, -0.6),
    ],
)
def test_samples_converge_as_theory_says(name, levels, least, most):
    """Independent points -1/2; points that fill a square evenly, cut by a smooth rim, -3/4 and better."""
    rate = fitted_rate(method("area", name), cat_eyes("area"), levels, seeds=(0, 1, 2, 3))
    assert least < rate.power < most, rate


def test_gauss_panels_converge_exponentially():
    """Rims that cross at a small angle have their singularities close by and set the pace in the end."""
    jobs = cat_eyes("area")
    assert fitted_rate(method("area", "Gauss panels"), jobs, (2, 3, 4, 6, 8)).per_node < -1.2
    late = fitted_rate(method("area", "Gauss panels"), jobs, (8, 16, 24))
    assert late.errors[0] > 20 * late.errors[1] > 400 * late.errors[2]


def test_fft_converges_faster_than_second_order_in_its_grid():
    jobs = [panel_jobs(PAPER, "diffraction image")[name] for name in ("N_F 0.9", "mismatched")]
    rate = fitted_rate(method("diffraction image", "FFT"), jobs, (16, 32, 64, 128, 256))
    assert rate.power < -1.5


# --- jobs -------------------------------------------------------------------------------------------------------------


def test_model_error_is_that_of_the_paper_camera():
    """Largest 0.47 of full scale behind one microlens; physics has an rms of 0.25 over a cell."""
    floor = model_error(Job("pixel image", PAPER))
    assert 0.3 < floor < 0.6
    assert model_error(Job("depth", PAPER)) is None
    sharp = PAPER.replace({"light.wavelength": PAPER.wavelength / 100})
    assert model_error(Job("pixel image", sharp)) < 0.2 * floor


def test_random_jobs_are_of_every_quantity_and_repeat_themselves():
    first, again = list(random_jobs(PAPER, 27, 4)), list(random_jobs(PAPER, 27, 4))
    assert first == again
    assert {job.quantity for job, _ in first} == set(QUANTITIES)
    assert all(1e-9 <= accuracy <= 1e-1 for _, accuracy in first)


def test_same_seed_same_bytes_other_seed_other_points():
    job = panel_jobs(PAPER, "kept fraction")["cat's eye"]
    for name in ("Monte Carlo", "scrambled Sobol"):
        one = method("kept fraction", name)
        assert one.compute(job, 256, 1) == one.compute(job, 256, 1)
        assert one.compute(job, 256, 1) != one.compute(job, 256, 2)
