"""Closed forms, meridional rays and 3D rays tell the same of 200 random cameras, and of the hard ones."""

from __future__ import annotations

import numpy as np
import pytest

from roslf_design import theory
from roslf_design.rays import Array, Lens, Sensor, Status, Stop, System, ends, image_section, trace, trace_pupil

EPS = np.finfo(float).eps


def camera(f, d_f, d_3, D=50.0, D_F=3.0, d=0.06, d_2=2.0):
    """A centred camera from the numbers of the closed forms."""
    d_1 = float(theory.mla_distance(f, d_f))
    return System(Lens(f, D), (Stop(D_F, d_3),), Array(d_1, d_2, d), Sensor(d_2))


def random_camera(rng):
    f = 10 ** rng.uniform(0, 2.5)
    m = 10 ** rng.uniform(-1.5, 0.5)
    d_f = f * (1 + m) / m
    d = 10 ** rng.uniform(-2, -0.5)
    return {
        "f": f,
        "d_f": d_f,
        "d_3": d_f * rng.uniform(0, 0.95),
        "D": f / 10 ** rng.uniform(0, 1),
        "D_F": f / 10 ** rng.uniform(0.3, 2),
        "d": d,
        "d_2": d * 10 ** rng.uniform(0.3, 2),
    }


def compare(numbers, c, rtol):
    """Every quantity that the three ways have in common, for a microlens at c off axis (x and turned in the plane)."""
    f, d_f, d_3, D, D_F, d, d_2 = (numbers[name] for name in ("f", "d_f", "d_3", "D", "D_F", "d", "d_2"))
    system = camera(**numbers)
    d_1 = system.array.distance
    turn = 0.7
    along = np.array([np.cos(turn), np.sin(turn)])
    discs = [theory.stop_disc(D_k, z, c * along, d_2, f, d_f) for D_k, z in ((D_F, d_3), (D, 0.0))]
    radius, centre = float(discs[0].radius), discs[0].centre
    size = abs(c) + radius + np.abs(centre).max()

    # The FAP's image on the sensor, upside down: diameter (Eqs. 2-3), centre (Eq. 4), pitch.
    angle = np.linspace(0, 2 * np.pi, 13)
    rim = np.stack([np.cos(angle), np.sin(angle)])
    landing = np.stack(trace_pupil(system, rim, c * along).sensor)
    np.testing.assert_allclose(landing, centre[:, None] - radius * rim, rtol=0, atol=rtol * size)
    section = image_section(system, c)
    for k, disc in enumerate(discs):
        middle = disc.centre @ along
        wanted = middle - disc.radius, middle + disc.radius
        scale = abs(c) + abs(middle) + disc.radius
        np.testing.assert_allclose((section.lower[k], section.upper[k]), wanted, rtol=0, atol=rtol * scale)
        edges = section.lower[k], section.upper[k]
        assert abs((edges[1] - edges[0]) / 2 - disc.radius) < rtol * scale
    image = float(theory.microlens_image_diameter(D_F, d_2, f, d_f, d_3))
    assert abs((section.upper[0] - section.lower[0]) - image) < rtol * size
    step = trace_pupil(system, (0.0, 0.0), (c + d, 0.0)).sensor[0] - trace_pupil(system, (0.0, 0.0), (c, 0.0)).sensor[0]
    assert abs(step - theory.microlens_image_pitch(d, d_2, f, d_f, d_3)) < rtol * size

    # Backward rays from that rim graze the FAP's, and meet in the object point -c d_f/d_1.
    back = trace(system, landing, c * along)
    np.testing.assert_allclose(np.hypot(*back.at(d_3)), D_F / 2, rtol=0, atol=rtol * size * d_1 / d_2)
    seen = -c * along * float(theory.inverse_magnification(f, d_f))
    got = np.stack(ends(system, landing, c * along, distance=d_f)[1:])
    np.testing.assert_allclose(got, np.broadcast_to(seen[:, None], got.shape), rtol=0, atol=rtol * size * d_f / d_2)

    # Room left in the main lens (Eq. 6): its radius less the highest ray of the pencil, times 2 (d_f - d_3).
    outermost = trace_pupil(system, np.stack([along, -along], -1), c * along)
    highest = np.hypot(*outermost.height).max()
    margin = theory.nondistortion_margin(D, D_F, d_3, d_f, np.hypot(*seen))
    assert abs(2 * (d_f - d_3) * (D / 2 - highest) - margin) < rtol * d_f * (D + D_F + abs(c) * d_f / d_1)
    inside = section.lower[0] >= section.lower[1] and section.upper[0] <= section.upper[1]
    if abs(margin) > rtol * d_f * (D + D_F):
        assert inside == (margin >= 0)
        assert np.all(np.isin(outermost.status, [Status.KEPT, Status.NEIGHBOUR])) == (margin >= 0)
    return margin


def test_200_random_cameras():
    rng = np.random.default_rng(2024)
    margins = []
    for _ in range(200):
        numbers = random_camera(rng)
        c = numbers["D"] * rng.uniform(-0.5, 0.5)
        # d_3 <= 0.95 d_f, H <= 20: some hundreds of roundings of the largest term at most. Measured: 3e-14.
        margins.append(compare(numbers, c, rtol=1e-12))
    assert 20 < np.sum(np.array(margins) > 0) < 180


P1 = {"f": 100.0, "d_f": 350.0, "d_3": 120.0, "D": 50.8, "D_F": 2.9, "d": 0.063, "d_2": 2.0}


@pytest.mark.parametrize("c", [0.0, 11.15, -17.78, 1e5])
@pytest.mark.parametrize(
    ("changed", "condition"),
    [
        ({}, 1),
        ({"d_3": 0.0}, 1),
        ({"d_3": 100.0}, 1),
        ({"d_3": np.nextafter(100.0, 0)}, 1),
        # Near d_f the gap d_f - d_3 loses digits of d_f, which the engine has from f and d_1 only: condition d_f/gap.
        ({"d_3": 350.0 * (1 - 1e-6)}, 1e6),
        ({"d_3": 350.0 * (1 - 1e-9)}, 1e9),
        # Near f, d_1 grows without bound.
        ({"d_f": 100.0 * (1 + 1e-6), "d_3": 50.0}, 1e6),
        ({"d_f": 1e12, "d_3": 50.0}, 1),
        ({"D_F": 1e-9}, 1),
    ],
)
def test_hard_cases(changed, condition, c):
    compare({**P1, **changed}, c, rtol=1e-12 + 64 * EPS * condition)


def test_telecentric_pitch_is_the_arrays():
    system = camera(**{**P1, "d_3": 100.0})
    chief = trace_pupil(system, (0.0, 0.0), (0.063 * np.arange(-170, 171), 0.0)).sensor[0]
    np.testing.assert_allclose(np.diff(chief), 0.063, rtol=0, atol=2 * EPS * 11)


def test_stop_at_the_lens_is_the_traditional_light_field():
    # Eq. 9's geometry: the lens is the pupil; image diameter D d_2/d_1, pitch d (1 + d_2/d_1), nothing clipped.
    system = camera(**{**P1, "d_3": 0.0, "D_F": 50.8})
    c = np.array([0.0, 5.0, 1e3])
    section = image_section(system, c)
    np.testing.assert_allclose(section.edges[1] - section.edges[0], 50.8 * 2 / 140, rtol=1e-10)
    np.testing.assert_allclose(sum(section.edges) / 2, c * (1 + 2 / 140), rtol=1e-13)
    np.testing.assert_allclose(section.kept_fraction, 1.0, rtol=1e-10)
