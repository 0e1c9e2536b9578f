"""Every method of every quantity against references, the references against others, and the rates theory gives."""

import functools
import math
from statistics import NormalDist

import mpmath as mp
import numpy as np
import pytest
from scipy import special

import roslf_design as roslf
from roslf_design.accuracy.table import QUANTITIES, shipped_table
from roslf_design.effects import plan
from roslf_design.imaging.camera import planned_camera
from roslf_design.imaging.transfer import MicrolensTransfer
from roslf_design.imaging.white import harmonic_series as rendered_series
from roslf_design.lenses.lens_file import shipped_names
from studies.accuracy import references, waves
from studies.accuracy.jobs import (
    CUT,
    LENS,
    RAYS,
    WAVES,
    Job,
    lens_designs,
    microlens_rays,
    panel_jobs,
    random_job,
    random_jobs,
    unfit,
    with_lens,
)
from studies.accuracy.oracles.discs import area, shape
from studies.accuracy.promises import methods, model_error, work_diagram
from studies.accuracy.references import ALIKE_PRECISION, EVERY, alike_series, huygens_image, reference
from studies.accuracy.shapes import gauss
from tests.oracles.huygens import aperture, disc, from_pupil, square_images, towards_sensor

PAPER = roslf.load("paper")
CUTS = panel_jobs(PAPER, CUT)
LENSES = panel_jobs(PAPER, LENS)


def method(quantity, name):
    return next(one for one in methods(quantity) if one.name == name)


BEST = {
    "closed form": (0, 1e-12),
    "exact arc-pixel area": (0, 2e-13),  # 2e-16 times the square of a radius of up to 15 pixels, several discs
    "harmonic series": (100, 2e-14),
    "Gauss panels": (24, 1e-6),
    "arc integrals": (24, 1e-12),
    "exact trace": (0, 2e-12),
    "adaptive quadrature": (8, 1e-4),
    "grid": (64, 0.05),
    "Monte Carlo": (4096, 0.2),
    "scrambled Sobol": (4096, 0.05),
    "FFT": (8, 2e-3),
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


# --- references against others ----------------------------------------------------------------------------------------


def test_reference_of_a_whole_pixel_of_a_texture_is_its_mean():
    """Product of sincs against points, and pixels that add up to the shape's area."""
    job = panel_jobs(PAPER, "textured image")["round"]
    truth, (low, _) = reference(job), job.cells
    at = (np.arange(200) + 0.5) / 200
    for n in np.flatnonzero(reference(panel_jobs(PAPER, "pixel image")["round"]) == 1)[::40]:
        mean = job.texture(low[n, 0] + at, low[n, 1] + at[:, None]).mean()
        assert truth[n] == pytest.approx(mean, abs=1e-5)
    white = panel_jobs(PAPER, "pixel image")["cat's eye"]
    assert reference(white).sum() == pytest.approx(float(area(*white.discs, digits=25)), rel=1e-14)
    _, middle, _ = shape(*white.discs, digits=25)
    centroid = reference(panel_jobs(PAPER, "centroid")["cat's eye"])
    assert np.allclose(centroid, [float(v) for v in middle], rtol=0, atol=1e-13)


def test_series_is_a_sum_over_explicit_neighbours():
    """In focus, sinc^2 of each pupil point, 200 neighbours each way: tails beyond them are 1e-3 of what is left."""
    job = Job("diffraction image", PAPER.replace({"microlens_array.focal_length": 1 / (1 / 2.0 - 1 / 460)}))
    width, pitch, bend = job.blur
    assert abs(bend) < 1e-12
    fine = (np.arange(4) + 0.5) / 4 - 0.5
    columns, rows = waves.alike_centres(job)
    x, y = (columns[3:6, None] + fine).ravel(), (rows[5:8, None] + fine).ravel()
    steps, points = np.arange(-200, 201) * pitch, disc(1.0, 18) * job.radius
    image = np.zeros((y.size, x.size))
    for a in points:
        across = (np.sinc((x[:, None] - a[0] - steps) / width) ** 2).sum(1) / width
        along = (np.sinc((y[:, None] - a[1] - steps) / width) ** 2).sum(1) / width
        image += np.outer(along, across)
    pixels = (image * math.pi * job.radius**2 / len(points)).reshape(3, 4, 3, 4).mean((1, 3))
    side = job.box[1]
    assert np.abs(reference(job).reshape(side, side)[5:8, 3:6] - pixels).max() < 4e-3


@pytest.mark.parametrize("name", ["rigid-scope", "ear-speculum"])
def test_light_of_neighbours_added_one_by_one_is_the_series(name):
    """Field over the aperture, squared, against a transfer of frequencies: to what the former is known to."""
    rng = np.random.default_rng(31)
    jobs = [job for panel, job in panel_jobs(roslf.load(name), WAVES).items() if panel in ("N_F 4", "mismatched")]
    for job in [*jobs, random_job(roslf.load(name), WAVES, rng)]:
        if job.harmonics < 40:
            assert np.abs(huygens_image(job) - alike_series(job)).max() < ALIKE_PRECISION


@pytest.mark.parametrize(
    "other",
    [
        lambda job, nu: np.maximum(1 - 0.98 * job.blur[0] * nu, 0.0),  # 2 % narrower
        lambda job, nu: np.maximum(1 - job.blur[0] * nu, 0.0) ** 1.05,  # thinner towards its rim
        lambda job, nu: np.maximum(1 - job.blur[0] * nu, 0.0),  # in focus
    ],
    ids=["narrow", "soft", "in focus"],
)
def test_a_series_of_another_aperture_is_judged_wrong_though_both_series_are_of_it(other, monkeypatch):
    """The same mistake in the method and in the series of 50 digits: what is added one by one tells them off."""
    job = panel_jobs(roslf.load("rigid-scope"), WAVES)["N_F 4"]
    monkeypatch.setattr(waves, "transfer", other)
    wrong = waves.harmonic_series(job)
    monkeypatch.setattr(references, "alike_series", lambda job: wrong)
    assert job.error(wrong, reference.__wrapped__(job)) > 1e-3  # not the one that is kept


@pytest.mark.parametrize("name", ["paper", "rigid-scope", "ear-speculum"])
def test_table_keeps_its_promise_of_diffraction(name):
    """Of every method at every level, not only of those that were chosen."""
    rows = {(row.method, row.level): row.expected_error for row in shipped_table().of(WAVES)}
    rng = np.random.default_rng(17)
    design = roslf.load(name)
    for job in [*panel_jobs(design, WAVES).values(), *(random_job(design, WAVES, rng) for _ in range(4))]:
        truth = waves.harmonic_series(job)  # judged elsewhere, and a thousand times as good as any of these
        for one in methods(WAVES):
            for level in one.levels if one.name == "FFT" and one.tested_on(job) else ():
                assert job.error(one.compute(job, level, 0), truth) <= rows[one.name, level], (job, level)


def test_huygens_here_is_huygens_there():
    """Both integrate the aperture directly; one counts path lengths from the pupil, one phases on the sensor."""
    job = Job("diffraction image", PAPER)
    places = np.array([0.3, 2.2, -4.1])
    width, pitch, _ = job.blur
    tail = width / (np.pi**2 * 0.5 * pitch**2)
    there = square_images(PAPER, np.zeros((1, 2)), np.append(places, 0.0) * PAPER.q, np.array([0.0]), [0.0], 80)[0]
    mine = waves.profile(job, np.append(places, 0.0), 0) - tail
    assert np.allclose(mine[:-1] / mine[-1], there[:-1] / there[-1], rtol=1e-9)


def test_spread_of_depths_is_that_of_the_law():
    rng = np.random.default_rng(11)
    for job in [random_job(PAPER, "depth", rng) for _ in range(5)]:
        law = NormalDist(*job.inverse_depth)
        ends = [1 / law.inv_cdf(NormalDist().cdf(side)) for side in (-1, 1)]
        assert reference(job)[0] == pytest.approx(0.5 * (ends[0] - ends[1]), rel=1e-7)


@pytest.mark.parametrize(
    "changes",
    [{"layout": "hexagonal"}, {"lens_shape": "circular"}, {"rotation": 1e-3}],
    ids=["hexagonal", "round", "turned"],
)
def test_diffraction_of_other_arrays_is_refused_where_methods_and_reference_would_agree_and_be_wrong(changes):
    """The renderer, whose own tests are against Huygens's integral, sees another image than these methods do."""
    other = PAPER.replace({f"microlens_array.{key}": value for key, value in changes.items()})
    job = Job(WAVES, other)
    assert unfit(other, WAVES)
    assert (unfit(other, CUT) == "") == ("layout" in changes)  # one microlens alone has no neighbours
    assert not any(unfit(PAPER, quantity) for quantity in QUANTITIES)
    assert {job.quantity for job, _ in random_jobs(other, 27, 4)} == {q for q in QUANTITIES if not unfit(other, q)}
    lines = plan(other, overrides=["-cos4"])
    camera = planned_camera(other, lines.without("microlens_defocus"))
    rendered = rendered_series(camera, MicrolensTransfer.of(camera, lines)).at(*(job.design.q * c for c in job.centres))
    assert np.abs(rendered.ravel() - reference(job)).max() > 1e-4


def test_diffraction_image_is_refused_where_neighbours_are_cut_otherwise():
    eye = panel_jobs(PAPER, "area")["cat's eye"]
    assert "rims cut" in unfit(eye.design, WAVES, eye.axis)
    assert not unfit(eye.design, CUT, eye.axis)


def test_cut_image_of_a_dark_field_is_black():
    job = Job(CUT, roslf.load("mismatched-borescope"), (40.0, 0.0))
    assert not reference(job).any()
    for one in methods(CUT):
        assert not one.compute(job, one.levels[0], 0).any(), one.name


# --- cut pupils -------------------------------------------------------------------------------------------------------


def test_there_are_eyes_of_every_kind():
    assert set(CUTS) == {"cat's eye, N_F 0.9", "cat's eye, N_F 4", "cat's eye, N_F 24", "almost closed", "barely cut"}
    shares = {name: area(*job.discs, digits=20) / (math.pi * job.radius**2) for name, job in CUTS.items()}
    assert 0.3 < shares["cat's eye, N_F 4"] < 0.7
    assert shares["almost closed"] < 0.02
    assert 0 < 1 - shares["barely cut"] < 1e-6


def test_a_line_is_huygens_integral_over_the_aperture():
    """Path lengths over the microlens, squared, over the pixel: another program's field, with this one's blur alone."""
    job = CUTS["cat's eye, N_F 0.9"]
    design = job.design
    x = np.array([0.4, 3.3, -5.1])
    v, dv = aperture(design, 60)
    nodes, weights = np.polynomial.legendre.leggauss(24)
    places = (x[:, None] + 0.5 * nodes) * design.q
    field = towards_sensor(design, places.ravel(), v) @ (dv[:, None] * from_pupil(design, np.zeros(1), 0.0, v))
    light = np.abs(field[:, 0]) ** 2 / (design.wavelength * design.d_2 * design.d)
    pixels = 0.5 * (light.reshape(places.shape) @ weights) * design.q
    assert np.allclose(waves.lines(job, x, np.zeros(1))[:, 0], pixels, rtol=0, atol=1e-13)


def test_reference_of_a_cut_image_is_the_double_integral_by_another_program():
    """One pixel of a cat's eye in focus: sinc^2 over the pixel by its sine integral, over the pupil by columns."""
    camera = CUTS["cat's eye, N_F 0.9"].design
    camera = camera.replace({"microlens_array.focal_length": 1 / (1 / camera.d_2 - 1 / 460)})
    job = Job(CUT, camera, CUTS["cat's eye, N_F 0.9"].axis)
    w, _, bend = job.blur
    assert abs(bend) < 1e-12
    x, y = job.centres
    i, j = x.size // 2, y.size // 2 + 2

    def line(off):
        """Of sinc^2(t/w)/w from off - 1/2 to off + 1/2."""
        low, high = (np.pi * (off + side) / w for side in (-0.5, 0.5))
        return np.diff([special.sici(2 * t)[0] - np.sin(t) ** 2 / t for t in (low, high)], axis=0)[0] / np.pi

    (left, right), (r, s) = sorted(job.discs[0][:, 0].tolist()), job.discs[1][np.argsort(job.discs[0][:, 0])]
    assert np.ptp(job.discs[0][:, 1]) < 1e-9  # the microlens lies on the x axis
    ends = right - s, (left + right + (r * r - s * s) / (right - left)) / 2, left + r
    nodes, weights = np.polynomial.legendre.leggauss(64)
    exact = 0.0
    for end, cross in ((ends[0], ends[1]), (ends[2], ends[1])):  # columns grow from nought as a root does
        a = end + (cross - end) * ((nodes + 1) / 2) ** 2
        half = np.sqrt(np.minimum(r * r - (a - left) ** 2, s * s - (a - right) ** 2))
        up = job.discs[0][0, 1] + half[:, None] * nodes
        inner = half * (line(y[j] - up) @ weights)
        exact += abs(cross - end) * ((nodes + 1) / 2 * inner * line(x[i] - a)) @ weights
    pixel = reference(job).reshape(y.size, x.size)[j, i]
    assert pixel > 0.1
    assert abs(pixel - exact) < 1e-11


@pytest.mark.parametrize("name", CUTS)
def test_outline_and_inside_are_huygens(name):
    """Three ways that share no quadrature: along the rims, over slices, and rows of directly squared fields."""
    job, truth = CUTS[name], reference(CUTS[name])
    fine = name.endswith("24")
    assert job.error(method(CUT, "arc integrals").compute(job, 24, 0), truth) < (3e-10 if fine else 1e-12)


def test_without_diffraction_it_is_the_shape():
    """Waves ten times shorter: what is left is the ray image, but for a pixel's rim of w."""
    eye = CUTS["cat's eye, N_F 4"].design
    job = Job(CUT, eye.replace({"light.wavelength": eye.wavelength / 10}), CUTS["cat's eye, N_F 4"].axis)
    rays = method(CUT, "rays alone").compute(job, 0, 0)
    light = method(CUT, "arc integrals").compute(job, 24, 0)
    inside = rays == 1.0
    assert inside.any()
    assert np.abs(light[inside] - 1).max() < 0.02
    assert abs(light.sum() - rays.sum()) < 0.01 * rays.sum()


@pytest.mark.parametrize("gap", [0.02, 1e-3, 1e-9, 1e-14])
def test_nodes_of_a_sliver_have_its_area(gap):
    centres, radii = np.array([[0.0, 0.0], [1 + 5 - gap, 0.0]]), np.array([1.0, 5.0])
    points, weights = waves.pupil_nodes(centres, radii, 24)
    assert weights.sum() == pytest.approx(float(area(centres, radii, digits=40)), rel=1e-14)
    assert (np.hypot(*points.T) <= 1 + 1e-12).all()


def test_gauss_rule_keeps_its_small_weights():
    for count in (1, 2, 7, 24, 60):
        nodes, weights = gauss(count)
        for power in range(0, 2 * count, max(1, count // 5)):
            assert (weights * nodes**power).sum() == pytest.approx(1 / (power + 1), rel=3e-15 * count)
    with mp.workdps(30):
        # The first weight of the rule of 60 by its formula, x found in the angle.
        t = mp.findroot(lambda t: mp.legendre(60, mp.cos(t)), (0.035, 0.044), solver="anderson")
        slope = mp.diff(lambda t: mp.legendre(60, mp.cos(t)), t)
        assert float(1 / slope**2) == pytest.approx(gauss(60)[1][-1], rel=1e-13)


# --- real lenses ------------------------------------------------------------------------------------------------------


def test_every_shipped_lens_is_there():
    assert {name.lower() for name in LENSES} == set(shipped_names())
    assert next(iter(lens_designs(roslf.load("paper-singlet")))).lower().startswith("la1050-a")
    assert with_lens(PAPER.replace(d_3=1e-3), "LB1630-A") is None  # the FAP would stand inside the lens


@pytest.mark.parametrize("name", LENSES)
def test_exact_trace_keeps_its_digits(name):
    job, truth = LENSES[name], reference(LENSES[name])
    assert truth.size == 2 * RAYS // EVERY
    assert job.error(method(LENS, "exact trace").compute(job, 0, 0), truth) < 2e-12


def test_thin_lens_and_rays_are_floor_lines():
    """Stopped down and near the axis a lens is thin; short waves are rays. Largest 0.47 of full scale for the paper."""
    job = LENSES["LA1050-A"]
    assert model_error(job) > 1  # more than one microlens's sample on the focal plane
    near = Job(LENS, with_lens(PAPER.replace(D_F=0.05), "LA1050-A"), (1e-3, 0.0))
    assert model_error(near) < 1e-3 * model_error(job)
    floor = model_error(Job("pixel image", PAPER))
    assert 0.3 < floor < 0.6
    assert model_error(Job("depth", PAPER)) is None
    sharp = PAPER.replace({"light.wavelength": PAPER.wavelength / 100})
    assert model_error(Job("pixel image", sharp)) < 0.2 * floor
    diagram = work_diagram("LB1630-A", LENSES["LB1630-A"], repeats=1)
    assert {point.method for point in diagram.points} == {one.name for one in methods(LENS)}


def test_rays_of_a_microlens_fill_the_pupil():
    job = LENSES["LB1630-A"]
    place, slope = microlens_rays(job.design, job.axis)
    twin = job.design.thin_twin
    height = place - slope * twin.d_1
    radius = np.hypot(*(height - (slope + height / twin.f) * twin.d_3)) / (twin.D_F / 2)
    assert radius.max() == pytest.approx(0.9, abs=1e-3)
    assert np.mean(radius**2) == pytest.approx(0.81 / 2, rel=1e-3)  # evenly


# --- rates ------------------------------------------------------------------------------------------------------------


def errors_of(one, jobs, levels, seeds=(0,)):
    """Root mean squares over jobs and seeds, so that luck averages out."""
    return [
        np.sqrt(np.mean([job.error(one.compute(job, n, seed), reference(job)) ** 2 for job in jobs for seed in seeds]))
        for n in levels
    ]


@functools.cache
def cat_eyes(count=24):
    rng, eyes = np.random.default_rng(3), []
    while len(eyes) < count:
        job = random_job(PAPER, "area", rng)
        if len(job.discs[1]) > 1 and 0.1 < reference(Job("kept fraction", job.design, job.axis))[0] < 0.9:
            eyes.append(job)
    return eyes


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
    errors = errors_of(method("area", name), cat_eyes(), levels, (0, 1, 2, 3))
    samples = np.array(levels, float) ** (2 if name == "grid" else 1)
    assert least < np.polyfit(np.log(samples), np.log(errors), 1)[0] < most


def test_quadratures_converge_exponentially_and_the_fft_by_its_square():
    """Rims that cross at a small angle have their singularities close by and set the pace of slices in the end."""
    levels = (2, 3, 4, 6, 8, 16, 24)
    errors = errors_of(method("area", "Gauss panels"), cat_eyes(), levels)
    assert np.polyfit(levels[:5], np.log(errors[:5]), 1)[0] < -1.2
    assert errors[4] > 20 * errors[5] > 400 * errors[6]
    eye = [CUTS["cat's eye, N_F 0.9"]]
    arcs = errors_of(method(CUT, "arc integrals"), eye, (1, 2, 4, 8))
    assert arcs[1] < 0.3 * arcs[0]
    assert arcs[3] < 1e-3 * arcs[2] < 1e-3 * 0.05 * arcs[1]
    coarse = errors_of(method(CUT, "FFT"), eye, (1, 2, 4))
    assert coarse[2] < coarse[1] / 3 < coarse[0] / 9
    alike = [panel_jobs(PAPER, "diffraction image")[name] for name in ("N_F 0.9", "mismatched")]
    levels = (2, 4, 8, 16, 32)
    errors = errors_of(method("diffraction image", "FFT"), alike, levels)
    assert np.polyfit(np.log(levels), np.log(errors), 1)[0] < -1.5
