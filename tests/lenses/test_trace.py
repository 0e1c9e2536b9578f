"""Rays through lenses: against an independent tracer, closed forms, 60-digit traces, and what must hold of any lens."""

from __future__ import annotations

from pathlib import Path

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roslf_design._jit import Kernel
from roslf_design.errors import InputError
from roslf_design.fates import describe
from roslf_design.lenses.glass import AIR, Glass
from roslf_design.lenses.lens_file import load_lens, shipped_names
from roslf_design.lenses.prescription import LensError, Prescription, Surface, first_order
from tests.lenses.vector_rays import Rays, trace
from tests.oracles.lenses import RAY_COUNT, WAVELENGTH, incoming, vector_trace

STORED = Path(__file__).resolve().parents[1] / "oracles" / "lens_rays"
GLASS = Glass("test glass", "constant", (1.6,))


def lens_named(name):
    own = STORED / f"{name}.toml"
    return load_lens(own if own.exists() else name)


@pytest.mark.parametrize("name", [*shipped_names(), "asphere", "misaligned"])
def test_ten_thousand_rays_agree_with_an_independent_tracer(name):
    lens = lens_named(name)
    stored = np.load(STORED / f"{name}.npz")
    position, direction = incoming(lens.surfaces[0].semi_diameter, RAY_COUNT)
    ours = trace(lens, Rays(position, direction), WAVELENGTH, plane=lens.length + 100, clip=False)
    assert ours.kept.all()
    assert np.isfinite(stored["place"]).all()
    # both are double precision over 300 mm: 1e-12 mm is some twenty roundings; behind a short lens those of its heights
    # are as much larger as it bends them
    longer = max(1.0, 50 / abs(first_order(lens, WAVELENGTH).focal_length))
    np.testing.assert_allclose(ours.position[:2], stored["place"], rtol=0, atol=1e-12 * longer)
    np.testing.assert_allclose(ours.direction[:, :1000], stored["way"], rtol=0, atol=1e-14 * longer)


@pytest.mark.parametrize("name", ["la1050-a", "ac508-100-a", "asphere", "misaligned"])
def test_backward_rays_retrace_forward_ones(name):
    lens = lens_named(name)
    position, direction = incoming(lens.surfaces[0].semi_diameter, 500)
    there = trace(lens, Rays(position, direction), WAVELENGTH, plane=lens.length + 100)
    kept = there.kept
    assert kept.any()
    turned = Rays(there.position[:, kept], -there.direction[:, kept])
    back = trace(lens, turned, WAVELENGTH, backward=True, plane=-300.0)
    assert back.kept.all()
    start = position[:, kept] + direction[:, kept] * ((-300 - position[2]) / direction[2])[kept]
    np.testing.assert_allclose(back.position, start, rtol=0, atol=1e-11)


def test_reversed_lens_is_the_same_lens_from_behind():
    lens = load_lens("AC254-050-A")
    position, direction = incoming(12.7, 300)
    forward = trace(lens, Rays(position, direction), WAVELENGTH, plane=150.0)
    flip = np.array([1.0, 1.0, -1.0])[:, None]
    offset = np.array([0.0, 0.0, lens.length])[:, None]
    mirrored = Rays(position * flip + offset, direction * flip)
    turned = trace(lens.reversed(), mirrored, WAVELENGTH, backward=True, plane=lens.length - 150.0)
    np.testing.assert_array_equal(forward.kept, turned.kept)
    expected = forward.position * flip + offset
    np.testing.assert_allclose(turned.position, expected, rtol=0, atol=1e-11)


def element(*surfaces):
    return Prescription(tuple(surfaces))


def fan(semi, z, count=60, seed=1):
    rng = np.random.default_rng(seed)
    r, t = semi * np.sqrt(rng.uniform(size=count)), rng.uniform(0, 2 * np.pi, count)
    return np.stack([r * np.cos(t), r * np.sin(t), np.full(count, z)])


def test_aplanatic_points_of_a_sphere():
    # Light converging on the point R n behind the centre meets, inside the sphere, the point R/n behind the centre.
    n, radius, thickness = 1.6, 20.0, 12.0
    image = radius + radius / n
    front = Surface(1 / radius, 15.0, thickness, GLASS)
    concentric = Surface(1 / (image - thickness), 15.0)  # centred on the image: crossed at right angles, bends nothing
    start = fan(14.0, -30.0)
    aim = np.array([0.0, 0.0, radius + radius * n])[:, None]
    rays = trace(element(front, concentric), Rays.between(start, aim), 5e-4, plane=image)
    assert rays.kept.all()
    np.testing.assert_allclose(rays.position[:2], 0, atol=2e-14)


def test_ellipsoid_focuses_collimated_light_inside_the_glass():
    n, radius, thickness = 1.6, 20.0, 10.0
    focus = radius * n / (n - 1)
    front = Surface(1 / radius, 12.0, thickness, GLASS, conic=-1 / n**2)
    concentric = Surface(1 / (focus - thickness), 12.0)
    start = fan(11.9, -25.0)
    rays = trace(element(front, concentric), Rays(start, np.tile([[0.0], [0.0], [1.0]], 60)), 5e-4, plane=focus)
    assert rays.kept.all()
    np.testing.assert_allclose(rays.position[:2], 0, atol=5e-14)


@pytest.mark.parametrize("backward", [False, True])
def test_plano_hyperbolic_lens_has_a_perfect_focus(backward):
    n, radius, thickness = 1.6, 15.0, 8.0
    lens = element(Surface(0.0, 12.0, thickness, GLASS), Surface(-1 / radius, 12.0, conic=-(n**2)))
    focus = thickness + radius / (n - 1)
    start = fan(11.0, -25.0)
    rays = Rays(start, np.tile([[0.0], [0.0], [1.0]], 60))
    if backward:
        lens, rays = lens.reversed(), Rays(rays.position * [[1], [1], [-1]] + [[0], [0], [thickness]], -rays.direction)
        focus = thickness - focus
    ended = trace(lens, rays, 5e-4, plane=focus, backward=backward)
    assert ended.kept.all()
    np.testing.assert_allclose(ended.position[:2], 0, atol=5e-14)


def oracle_surfaces(lens, wavelength=5e-4):
    indices = [1.0, *(float(s.glass.index(wavelength)) for s in lens.surfaces)]
    return [
        {"c": s.curvature, "k": s.conic, "a": s.asphere, "z": z, "semi": s.semi_diameter, "n": indices[i : i + 2]}
        for i, (s, z) in enumerate(zip(lens.surfaces, lens.vertices, strict=True))
    ]


STEEP = Surface(1 / 9.0, 8.0, 14.0, GLASS, -0.9, (0.0, 1e-4, -2e-6, 1.5e-8, 1e-11))
PARABOLOID = Surface(1 / 12.0, 14.0, 12.0, GLASS, conic=-1.0)
BALL = Surface(1 / 10.0, 9.999, 20.0, GLASS), Surface(-1 / 10.0, 9.999)
TINY = Surface(1e-14, 10.0, 5.0, GLASS), Surface(-1e-300, 10.0)
HARD = {
    "along the axis": ((STEEP, Surface(0.0, 30.0)), (0, 0, -5), (0, 0, 1)),
    "parallel to the axis, steep asphere": ((STEEP, Surface(0.0, 30.0)), (7.5, 0, -5), (0, 0, 1)),
    "oblique on a steep asphere": ((STEEP, Surface(0.0, 30.0)), (-9, 2, -8), (0.6, 0.1, 0.79)),
    "paraboloid, along its axis": ((PARABOLOID, Surface(0.0, 30.0)), (13, 1, -8), (0, 0, 1)),
    "paraboloid, oblique": ((PARABOLOID, Surface(0.0, 30.0)), (-13, 0, -8), (0.5, 0.2, 0.8)),
    "nearly a plane": (TINY, (3, 2, -50), (0.05, -0.1, 0.97)),
    "ball lens near its edge": (BALL, (9.9, 0, -5), (0, 0, 1)),
    "grazing a sphere, just met": (BALL, (9.9989, 0, -5), (0, 0, 1)),
    "grazing a sphere, just missed": (BALL, (10.0000001, 0, -5), (0, 0, 1)),
    "missing altogether": (BALL, (15, 0, -5), (0, 0, 1)),
    "total reflection at the rear": (
        (Surface(0.0, 12.0, 9.0, GLASS), Surface(-1 / 13.0, 12.0)),
        (11, 0, -5),
        (0, 0, 1),
    ),
    "clipped in front": ((Surface(1 / 10.0, 5.0, 20.0, GLASS), BALL[1]), (7, 0, -40), (0, 0, 1)),
    "from very far": ((Surface(1 / 50, 20.0, 9.0, GLASS), Surface(0.0, 20.0)), (-1e4, 0, -1e5), (10005, 3, 1e5)),
    "across the axis, almost flat": (BALL, (-9, 0, 0.2), (0.95, 0, 0.31)),
}


@pytest.mark.parametrize("case", HARD)
@pytest.mark.parametrize("backward", [False, True])
def test_hard_cases_against_sixty_digits(case, backward):
    surfaces, position, direction = HARD[case]
    lens = element(*surfaces)
    position, direction = np.array(position, float), np.array(direction, float)
    direction = direction / np.sqrt(np.sum(direction**2))
    if backward:  # the same meeting from the sensor's side of the reversed lens
        lens = lens.reversed()
        position = position * [1, 1, -1] + [0, 0, lens.length]
        direction = direction * [1, 1, -1]
    fate, place, way = vector_trace(oracle_surfaces(lens), position, direction, backward)
    ours = trace(lens, Rays(position[:, None], direction[:, None]), 5e-4, backward=backward)
    words = {"kept": "kept", "missed": "missed surface", "clipped": "clipped at", "reflected": "total internal"}
    told = describe(int(ours.state[0]))
    if fate[0] == "kept" and way[2] * (-1 if backward else 1) < 0:  # the lens turns it back
        assert told == "never reaches the plane"
        return
    assert told.startswith(words[fate[0]]), (told, fate)
    if fate[0] != "kept":
        assert told.endswith(f"surface {fate[1]}")
    if fate[0] == "missed":
        return
    # near grazing, inputs rounded at 1e-16 move the point by the root of that; elsewhere by a few roundings
    slack = 3e-12 if "graz" in case or "far" in case else 1e-13
    scale = max(1.0, float(mp.norm(mp.matrix(place))))
    if fate[0] == "kept":  # on to the plane through the last vertex
        np.testing.assert_allclose(ours.direction[:, 0], [float(v) for v in way], rtol=0, atol=slack * 10)
        along = (ours.position[2, 0] - place[2]) / way[2]
        place, scale = [v + along * w for v, w in zip(place, way, strict=True)], scale / abs(float(way[2]))
    np.testing.assert_allclose(ours.position[:2, 0], [float(v) for v in place[:2]], rtol=0, atol=slack * scale)


def test_plane_is_the_limit_of_a_sphere():
    position, direction = incoming(10.0, 200)
    rays = Rays(position, direction)
    plane = trace(element(Surface(0.0, 12.0, 5.0, GLASS), Surface(0.0, 12.0)), rays, 5e-4, plane=50.0, clip=False)
    for curvature in (1e-18, -1e-15, 1e-12, 1e-9):
        near = trace(
            element(Surface(curvature, 12.0, 5.0, GLASS), Surface(0.0, 12.0)), rays, 5e-4, plane=50.0, clip=False
        )
        # a sphere of that curvature deflects by about h c (n - 1) over 50 mm
        allowed = 1e-13 + abs(curvature) * 12 * 50
        np.testing.assert_allclose(near.position, plane.position, rtol=0, atol=allowed)


@pytest.mark.parametrize("name", ["asphere", "la1050-a"])
def test_interpreted_and_compiled_kernels_give_the_same_bits(name, monkeypatch):
    lens = lens_named(name)
    position, direction = incoming(14.0, 150)
    position[0, 3], direction[1, 5] = np.nan, np.inf
    runs = []
    for compiled in (False, True):
        monkeypatch.setattr(Kernel, "pays", lambda *_, compiled=compiled: compiled)
        runs.append(trace(lens, Rays(position, direction), 5e-4, plane=40.0))
    for one, other in zip(*runs, strict=True):
        np.testing.assert_array_equal(one, other)
    assert describe(int(runs[0].state[3])).startswith("not a ray")
    assert describe(int(runs[0].state[5])).startswith("not a ray")


@pytest.mark.parametrize(
    ("heights", "slopes", "planes"),
    [((1, 1), (3, 200), ()), ((3, 1), (1, 200), (3, 1)), ((1, 1), (1, 1), (1, 1)), ((), (), ()), ((0,), (), ())],
)
def test_numbers_that_rays_have_in_common_are_broadcast(heights, slopes, planes):
    lens, random = load_lens("LA1050-A").at(5e-4), np.random.default_rng(1)
    height, slope = random.uniform(-5, 5, (2, *heights)), random.uniform(-0.1, 0.1, (2, *slopes))
    start, shape = random.uniform(-20, -10, planes), np.broadcast_shapes(heights, slopes, planes)
    few = lens.through(tuple(height), tuple(slope), start=start, end=90.0, backward=False)
    parts = [[np.broadcast_to(one, shape) for one in each] for each in (height, slope, [start])]
    every = lens.through(tuple(parts[0]), tuple(parts[1]), start=parts[2][0], end=90.0, backward=False)
    assert few.state.shape == shape
    for one, other in zip(few, every, strict=True):
        np.testing.assert_array_equal(one, other)


def test_builds_times_rays_are_each_build_alone():
    """Three colours of one lens as three builds, back to a plane for each, and forwards again."""
    lens = load_lens("AC508-150-A")
    _, direction = incoming(20.0, 400)
    colours, planes = np.array([486.1e-6, 550e-6, 656.3e-6]), np.array([140.0, 150.0, 160.0])
    slope = direction[:2] / direction[2]
    back = lens.at(colours).through(*(np.broadcast_to(x[:, None], (2, 3, 400)) for x in (slope, -0.1 * slope)),
                                    start=200.0, end=-planes)  # fmt: skip
    for row, colour in enumerate(colours):
        one = lens.through(slope, -0.1 * slope, colour, start=200.0, end=-planes[row])
        for part, whole in ((one.height, back.height), (one.slope, back.slope), (one.margin, back.margin)):
            np.testing.assert_array_equal(part, whole[..., row, :])
        turned = lens.through(one.height, one.slope, colour, start=-planes[row], end=200.0, backward=False)
        np.testing.assert_allclose(turned.height, slope, rtol=0, atol=1e-11)
        np.testing.assert_allclose(turned.slope, -0.1 * slope, rtol=0, atol=1e-13)


def test_room_changes_sign_where_the_clear_aperture_ends():
    lens = load_lens("LB1630-A")
    heights = np.linspace(0, 30, 601)
    rays = Rays(np.stack([heights, 0 * heights, np.full(601, -10.0)]), np.tile([[0.0], [0.0], [1.0]], 601))
    clipped = trace(lens, rays, 5.5e-4)
    open_ = lens.through(rays.position[:2], (0.0, 0.0), 5.5e-4, start=-10.0, end=20.0, backward=False)
    assert (open_.state == 0).all()
    np.testing.assert_array_equal(open_.margin >= 0, clipped.kept)
    assert {describe(int(state)) for state in clipped.state} == {"kept", "clipped at surface 1"}


def test_wavelength_outside_a_glass_is_refused():
    with pytest.raises(InputError, match="200 nm is outside the range of N-BK7"):
        trace(load_lens("LA1050-A"), Rays(*incoming(5.0, 3)), 200e-6)


curvatures = st.one_of(st.just(0.0), st.floats(-0.2, 0.2), st.floats(-1e-9, 1e-9))
glasses = st.sampled_from([AIR, GLASS, Glass("dense", "constant", (2.4,)), Glass("thin", "constant", (1.0001,))])


@st.composite
def lenses(draw):
    """Any stack that a prescription accepts, however silly."""
    count = draw(st.integers(1, 5))
    surfaces = []
    for index in range(count):
        last = index == count - 1
        surfaces.append(
            Surface(
                draw(curvatures),
                draw(st.floats(0.1, 12)),
                0.0 if last else draw(st.floats(0, 15)),
                AIR if last else draw(glasses),
                draw(st.sampled_from([0.0, -1.0, -0.5, 0.7, -4.0])),
                draw(st.sampled_from([(), (0.0, 2e-4), (1e-3, -1e-4, 1e-6), (0.0, 0.0, 0.0, 1e-7)])),
                (draw(st.floats(-0.5, 0.5)), draw(st.floats(-0.5, 0.5)), draw(st.floats(-0.2, 0.2))),
                draw(st.sampled_from([(0.0, 0.0), (0.02, -0.01), (0.3, 0.2)])),
            )
        )
    try:
        return Prescription(tuple(surfaces))
    except LensError:
        return None


@settings(max_examples=50)
@given(lenses(), st.integers(0, 2**32 - 1), st.booleans(), st.booleans())
def test_any_lens_keeps_or_stops_every_ray_and_says_so(lens, seed, backward, clip):
    if lens is None:
        return
    rng = np.random.default_rng(seed)
    start = rng.uniform(-20, 20, (3, 80)) * [[1], [1], [0.2]] + [[0], [0], [lens.length + 40 if backward else -40]]
    aim = rng.uniform(-14, 14, (3, 80)) * [[1], [1], [0]]
    rays = Rays.between(start, aim)
    plane = -200.0 if backward else lens.length + 200
    out = trace(lens, rays, 5e-4, backward=backward, clip=clip, plane=plane)
    assert np.isfinite([*out.position, *out.direction]).all()
    assert all(describe(int(code)) for code in out.state)
    if clip:
        # nothing that a clear aperture stops is kept, and nothing else is stopped by it
        slope = rays.direction[:2] / rays.direction[2]
        loose = lens.through(start[:2], slope, 5e-4, start=start[2], end=plane, backward=backward)
        assert np.isfinite([*loose.height, *loose.slope, loose.margin]).all()
        np.testing.assert_array_equal(out.kept, (loose.state == 0) & (loose.margin >= 0))


@settings(max_examples=60)
@given(lenses(), st.integers(0, 2**32 - 1))
def test_any_kept_ray_can_be_followed_home(lens, seed):
    if lens is None:
        return
    rng = np.random.default_rng(seed)
    start = rng.uniform(-5, 5, (3, 40)) * [[1], [1], [0]] + [[0], [0], [-30]]
    rays = Rays.between(start, rng.uniform(-3, 3, (3, 40)) * [[1], [1], [0]])
    out = trace(lens, rays, 5e-4)
    kept = out.kept
    back = trace(lens, Rays(out.position[:, kept], -out.direction[:, kept]), 5e-4, backward=True, plane=-30.0)
    # A ray may leave by a surface's far side first (an asphere that turns back), or graze: those are few and say so.
    home = back.kept
    error = np.abs(back.position - start[:, kept])[:, home]
    assert home.sum() >= 0.9 * kept.sum() - 1
    assert (error < 1e-6).all()
