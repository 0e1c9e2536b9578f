"""Irregular surfaces: Zernike modes by quadrature, rays by a tracer of 40 digits, builds as designs of their own."""

import math

import mpmath
import numpy as np
import pytest
import tomli_w

from roslf_design import load
from roslf_design.lenses import tracer
from roslf_design.lenses.glass import find_glass
from roslf_design.lenses.lens_file import _loads_lens, load_lens, table_of
from roslf_design.lenses.manufacture import as_made, lens_builds
from roslf_design.lenses.prescription import LensError, Prescription, Surface, surface_table
from roslf_design.tolerancing.metrics import Question, builds_of
from roslf_design.tolerancing.places import expand, perturbable, tolerance_at
from roslf_design.tolerancing.result import analyse
from roslf_design.tolerancing.run import tally_chunk
from roslf_design.tolerancing.study import tolerance_plan
from roslf_design.tolerancing.tally import merged
from tests.lenses.vector_rays import Rays, trace
from tests.tolerancing.alone import apart

FORM = (40e-6, -70e-6, 55e-6, 30e-6, -25e-6, 60e-6, 80e-6)
WAVE = 550e-6


def zernike(n, m, rho, theta):
    """Noll's modes by their radial polynomials, of unit rms over the disc."""
    radial = sum(
        (-1) ** k
        * math.factorial(n - k)
        / (math.factorial(k) * math.factorial((n + abs(m)) // 2 - k) * math.factorial((n - abs(m)) // 2 - k))
        * rho ** (n - 2 * k)
        for k in range((n - abs(m)) // 2 + 1)
    )
    if m == 0:
        return math.sqrt(n + 1) * radial
    turn = mpmath.cos(m * theta) if m > 0 else mpmath.sin(-m * theta)
    return math.sqrt(2 * (n + 1)) * radial * turn


NOLL = ((2, -2), (2, 2), (3, -1), (3, 1), (3, -3), (3, 3), (4, 0))
"""Orders of modes 5 to 11."""


def sag(x, y, radius, form, reach):
    rho, theta = mpmath.sqrt(x * x + y * y) / reach, mpmath.atan2(y, x)
    sphere = radius - mpmath.sign(radius) * mpmath.sqrt(radius**2 - x * x - y * y)
    return sphere + sum(a * zernike(n, m, rho, theta) for a, (n, m) in zip(form, NOLL, strict=True))


def test_modes_are_nolls_with_unit_rms():
    lens = Prescription((Surface(0.0, 5.0, 1.0, find_glass("N-BK7"), irregularity=FORM), Surface(0.0, 5.0)))
    row = surface_table(lens)[: tracer.COLUMNS]
    for x, y in ((1.3, -2.2), (-4.0, 1.0), (0.2, 0.1)):
        own = tracer.irregularity.interpreted(x, y, row, 0)
        rho, theta = math.hypot(x, y) / 5, math.atan2(y, x)
        assert own[0] == pytest.approx(
            float(sum(a * zernike(n, m, rho, theta) for a, (n, m) in zip(FORM, NOLL, strict=True))), abs=1e-18
        )
        for axis, step in enumerate(((1e-5, 0), (0, 1e-5))):
            ends = [tracer.irregularity.interpreted(x + s * step[0], y + s * step[1], row, 0)[0] for s in (1, -1)]
            assert own[1 + axis] == pytest.approx((ends[0] - ends[1]) / 2e-5, abs=1e-13)
    nodes, weights = np.polynomial.legendre.leggauss(12)
    square = total = 0.0
    for node, weight in zip(nodes, weights, strict=True):
        r = 5 * math.sqrt((1 + node) / 2)
        for turn in np.arange(24) * math.pi / 12:
            value = tracer.irregularity.interpreted(r * math.cos(turn), r * math.sin(turn), row, 0)[0]
            square, total = square + weight / 48 * value**2, total + weight / 48 * value
    assert math.sqrt(square) == pytest.approx(math.sqrt(sum(a * a for a in FORM)), rel=1e-12)
    assert total == pytest.approx(0, abs=1e-18)


@pytest.mark.parametrize("backward", [False, True])
def test_rays_by_forty_digits(backward):
    radius, reach, thick = 20.0, 6.0, 4.0
    glass = find_glass("N-BK7")
    lens = Prescription((Surface(1 / radius, reach, thick, glass, irregularity=FORM), Surface(0.0, reach)))
    start = np.array([2.5, -1.7, 30.0 if backward else -30.0])
    end = np.array([1.0, 2.9, 0.5])
    rays = Rays.between(start, end)
    # Of the second face only its plane, so that the first one's own ray is seen at the end.
    ended = trace(lens, rays, WAVE, backward=backward)
    with mpmath.workdps(40):
        n = mpmath.mpf(float(glass.index(WAVE)))
        p, d = [mpmath.matrix(list(map(mpmath.mpf, part.tolist()))) for part in rays]

        def refract(p, d, height, ratio):
            t = mpmath.findroot(lambda t: p[2] + t * d[2] - height(p[0] + t * d[0], p[1] + t * d[1]), -p[2] / d[2])
            p = p + t * d
            normal = mpmath.matrix([-mpmath.diff(height, (p[0], p[1]), (1, 0)),
                                    -mpmath.diff(height, (p[0], p[1]), (0, 1)), 1])  # fmt: skip
            normal /= mpmath.norm(normal)
            cosine = (d.T * normal)[0]
            sign = mpmath.sign(cosine)
            bend = sign * mpmath.sqrt(1 - ratio**2 * (1 - cosine**2)) - ratio * cosine
            return p, ratio * d + bend * normal

        def front(x, y):
            return sag(x, y, mpmath.mpf(radius), FORM, reach)

        def back(x, y):
            return mpmath.mpf(thick)

        faces = [(back, 1 / n), (front, n)] if backward else [(front, 1 / n), (back, n)]
        for height, ratio in faces:
            p, d = refract(p, d, height, ratio)
        p = p + (ended.position[2] - p[2]) / d[2] * d
        place, way = ([float(v) for v in part] for part in (p, d))
    assert bool(ended.kept)
    assert ended.position.tolist() == pytest.approx(place, abs=1e-13)
    assert ended.direction.tolist() == pytest.approx(way, abs=1e-14)
    regular = Prescription((Surface(1 / radius, reach, thick, glass), Surface(0.0, reach)))
    plain = trace(regular, rays, WAVE, backward=backward)
    assert np.max(np.abs(plain.direction - ended.direction)) > 1e-5


def test_turned_written_and_made():
    lens = load_lens("LA1050-A")
    values = {f"surfaces.1.irregularity.{mode}": a for mode, a in enumerate(FORM)}
    made = as_made(lens, values, WAVE)
    assert made.surfaces[0].irregularity == FORM
    assert not made.is_centred
    assert _loads_lens(tomli_w.dumps(table_of(made))) == made
    assert made.reversed().reversed() == made
    rays = Rays.between(np.array([3.0, 4.0, -50.0]), np.array([5.0, -8.0, 0.0]))
    mirrored = Rays(rays.position * [1, 1, -1] + [0, 0, lens.length], rays.direction * [1, 1, -1])
    one, other = trace(made, rays, WAVE), trace(made.reversed(), mirrored, WAVE, backward=True)
    assert one.direction == pytest.approx(other.direction * [1, 1, -1], abs=1e-15)
    builds = lens_builds(lens, WAVE, {place: np.array([a, 0.0]) for place, a in values.items()}, 2)
    (x, y, z), slope = rays.position, rays.direction[:2] / rays.direction[2]
    height, slope = (np.repeat(pair[:, None], 2, axis=1) for pair in (np.array([x, y]), slope))
    bent = builds.stack.through(height, slope, start=z, end=lens.length, backward=False).slope
    for build, alone in enumerate((one, trace(lens, rays, WAVE))):
        assert bent[:, build] == pytest.approx(alone.direction[:2] / alone.direction[2], abs=1e-15)
    with pytest.raises(LensError, match="has 2 terms"):
        Prescription((Surface(0.0, 5.0, irregularity=(1e-4, 0.0)),))


def test_a_study_of_a_singlets_surfaces():
    design = load("paper-singlet")
    places = expand(design, "main_lens.surfaces.*.irregularity")
    assert len(places) == 14
    assert {perturbable(design)[place] for place in places} == {"form"}
    widths = [tolerance_at(design, place, "50 nm") for place in places[:7]]
    assert math.sqrt(sum(width**2 for width in widths)) == pytest.approx(50e-6)  # of the whole surface, at most
    values = {place: np.array([a, -2 * a]) for place, a in zip(places[:7], FORM, strict=True)}
    question = Question(design, ("centre_error_px", "axis_ratio"), ((6.0, 0.0),), design.d_f)
    builds, valid = builds_of(question, values, 2)
    assert valid.all()
    check = apart(design, builds, values)
    assert check.centre_px < 1e-9
    assert np.all(np.hypot(*builds.centre_error) > 1e-3)


def test_iso_10110_5():
    design = load("paper-singlet")
    fringe = 546.07e-6 / 2
    curvature, *_, comatic, symmetric = (
        f"main_lens.surfaces.1.{name}" for name in ("curvature", "irregularity.3", "irregularity.6")
    )
    reach = design.lens.surfaces[0].semi_diameter
    # A: sagitta of two fringes; the sphere's is c r^2/2 to first order.
    assert tolerance_at(design, curvature, "3/2(1)") * reach**2 / 2 == pytest.approx(2 * fringe)
    # B: coma peaks at +-sqrt(8) rms, six modes add in quadrature; C: spherical aberration from -sqrt(5)/2 to sqrt(5).
    assert tolerance_at(design, comatic, "3/-(1/0.5)") * 2 * math.sqrt(8) * math.sqrt(6) == pytest.approx(fringe)
    assert tolerance_at(design, symmetric, "3/-(1/0.5)") * 1.5 * math.sqrt(5) == pytest.approx(0.5 * fringe)
    assert tolerance_at(design, comatic, "3/- RMSi < 0.1") == pytest.approx(0.1 * fringe / math.sqrt(7))
    for place, text, message in (
        (comatic, "3/1", "says nothing of the irregularity"),
        (curvature, "3/-(1)", "says nothing of the power"),
        (comatic, "3/x", "cannot read"),
        ("aperture.distance", "3/1(1)", "is of a surface's form"),
        (comatic, "5 mrad", "is a unit of angle"),
    ):
        with pytest.raises(ValueError, match=message):
            tolerance_at(design, place, text)


def test_microlenses_out_of_place_and_their_sag():
    for name, at in (("paper", (5.0, 2.0)), ("paper-singlet", (5.0, 2.0))):
        design = load(name)
        question = Question(design, ("centre_error_x_px", "centre_error_y_px"), ((0.0, 0.0), at), design.d_f)
        stray = np.array([0.5e-3, -1e-3])
        builds, _ = builds_of(question, {"microlens_array.lenslets.1.decentre.1": stray}, 2)
        x, y = builds.centre_error
        magnified = np.broadcast_to(builds.pitch, y.shape) / design.d
        assert x == pytest.approx(0, abs=1e-9)
        assert y[0] == pytest.approx(0, abs=1e-9)
        assert y[1] == pytest.approx(stray * magnified[1] / design.q, abs=1e-9)
    scope = load("arthroscope")
    n = float(find_glass("fused silica").index(scope.wavelength))
    radius = (n - 1) * scope.f_ml
    assert tolerance_at(scope, "microlens_array.sag", "10 %") == pytest.approx(0.1 * scope.d**2 / 8 / radius)
    question = Question(scope, ("fill_factor",), ((0.0, 0.0),), scope.d_f)
    flatter, _ = builds_of(question, {"microlens_array.sag": np.array([0.9 * scope.d**2 / 8 / radius])}, 1)
    assert flatter.camera.f_ml == pytest.approx(scope.f_ml / 0.9, rel=1e-12)
    assert "microlens_array.sag" not in perturbable(load("paper"))


def test_a_study_of_what_no_grade_knows():
    data = {"name": "scatter", "design": "paper", "trials": 64, "sobol_samples": 0, "fields": ["centre", "edge"]}
    data["perturb"] = [{"place": "microlens_array.lenslets.*.decentre", "tolerance": "0.5 um"}]
    data["goals"] = [{"metric": "centre_error_px", "max": 0.5}]
    plan, study, grades = tolerance_plan(data)
    assert {p.place.split(".")[2] for p in plan.draws.perturbations} == {"0", "1"}  # nobody looks at others
    result = analyse(plan, study, grades, merged(tally_chunk(plan, index) for index in range(plan.chunks)))
    assert result.final.result.value == 1
