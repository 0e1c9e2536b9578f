"""Geometric images: exact areas, rays against areas, tiles, threads, seeds."""

import numpy as np
import pytest
from mpmath import mp
from scipy.stats.qmc import Sobol

from roslf_design.camera import Camera
from roslf_design.design import load
from roslf_design.effects import plan
from roslf_design.errors import InputError
from roslf_design.imaging.camera import ImageLattice, Region, pixel_centres, planned_camera
from roslf_design.imaging.points import PointSource, point_image
from roslf_design.imaging.render import render
from roslf_design.imaging.surfaces import encode, met
from roslf_design.imaging.trace import RaySampling, Tracer, sobol_points
from roslf_design.imaging.white import WhiteGeometry
from roslf_design.scenes import WHITE_FIELD, Plane, Points, Scene, Sinusoid, Sphere, Tube, Uniform

PAPER = load("paper")
BORE = load("mismatched-borescope")
RAYS_ONLY = ["-microlens_diffraction", "-microlens_defocus", "-fap_diffraction", "-cos4", "+overlap"]
WIDE = Region(4400, 2900, 60, 50)


def disc_in_box(radius, left, right, low, high):
    """Area of a disc about the origin in a box, at 50 digits, by integrating the chord's part."""
    with mp.workdps(50):
        r = mp.mpf(radius)
        a, b = max(mp.mpf(left), -r), min(mp.mpf(right), r)
        if a >= b:
            return mp.mpf(0)

        def part(height):
            """Integral over x of min(max(chord, -height), height)-like clipping, upper half plane only."""

            def clipped(x):
                return min(mp.sqrt(r * r - x * x), height) if height >= 0 else max(-mp.sqrt(r * r - x * x), height)

            cut = mp.sqrt(r * r - height * height) if abs(height) < r else mp.mpf(0)
            breaks = sorted({a, b, *(c for c in (-cut, cut) if a < c < b)})
            return mp.quad(clipped, breaks)

        return part(mp.mpf(high)) - part(mp.mpf(low))


@pytest.mark.parametrize("layout", ["square", "hexagonal"])
def test_the_nearest_microlens_is_the_nearest_of_all(layout):
    lattice = ImageLattice.of(Camera.of(PAPER.replace({"microlens_array.layout": layout})))
    index = np.random.default_rng(3).uniform(-2, 2, (500, 2))
    every = np.stack(np.meshgrid(*2 * [np.arange(-5, 6)]), -1).reshape(-1, 2)
    apart = np.hypot(*np.moveaxis(lattice.microlens(index)[:, None] - lattice.microlens(every), -1, 0))
    np.testing.assert_array_equal(lattice.nearest(index), every[apart.argmin(1)])


def test_white_image_is_exact_coverage():
    """P1 by rays: pixels of single microlens images against 50-digit integrals."""
    lines = plan(PAPER, overrides=RAYS_ONLY)
    seen = planned_camera(PAPER, lines)
    region = Region(2290, 1530, 16, 16)
    cover = WhiteGeometry.of(seen, lines).coverage(region)
    x, y = pixel_centres(seen, region)
    pitch, radius, half = 0.063 * (1 - 2 * 20 / (140 * 20 + 100 * 120) * 1.0), 2.9 * 35 / 23 / 140, seen.q / 2
    pitch = 0.063 * (1 + 2 * (120 - 100) / (140 * (120 - 100) - 100 * 120))
    error = 0.0
    for j in range(0, 16, 3):
        for i in range(0, 16, 2):
            truth = mp.mpf(0)
            for m in (-1, 0, 1):
                for n in (-1, 0, 1):
                    u, v = x[i] - m * pitch, y[j] - n * pitch
                    if np.hypot(u, v) < radius + 2 * seen.q:
                        truth += disc_in_box(radius, u - half, u + half, v - half, v + half)
            error = max(error, abs(cover[j, i] - float(truth / mp.mpf(seen.q) ** 2)))
    assert error < 1e-12


@pytest.mark.parametrize(
    "design",
    [
        BORE,
        load("pipe-bore").replace({"microlens_array.layout": "hexagonal", "microlens_array.lens_shape": "circular"}),
        PAPER.replace(
            {"microlens_array.rotation": 0.01, "aperture.decentre": (0.2, 0.1), "sensor.decentre": (0.01, 0.0)}
        ),
        PAPER.replace({"main_lens.decentre": (0.5, -0.3), "microlens_array.decentre": (0.01, 0.02)}),
        PAPER.replace({"stops": ({"diameter": 3.2, "distance": 60.0, "decentre": (0.1, 0.0)},)}),
    ],
    ids=["vignetted", "hexagonal", "rotated", "decentred", "further stop"],
)
def test_rays_find_the_same_areas(design):
    """Rays through microlens centres at Sobol points, against exact areas: two ways to the same geometry."""
    lines = plan(
        design, overrides=[*RAYS_ONLY, "+vignetting", "+decentres", "+mla_rotation", "-finite_microlens_aperture"]
    )
    width, height = design.pixels
    region = Region(width - 50, height - 40, 50, 40)
    exact = WhiteGeometry.of(planned_camera(design, lines), lines).image(region)
    rays, _ = Tracer.of(design, lines, WHITE_FIELD).image(region, RaySampling(1024, 1024, 0.0, 3))
    assert np.abs(rays - exact).max() < 0.02  # an edge through a pixel is known to about 1024^-3/4
    assert abs(rays.mean() - exact.mean()) < 2e-4


def test_a_cut_is_as_soft_as_all_of_a_microlens_sees_it():
    """Every point of a microlens sees the lens's rim elsewhere before the FAP: that, too, a uniform scene shows."""
    design = PAPER.replace({"main_lens.diameter": 14.0, "microlens_array.pitch": 0.5})
    region = Region(3300, 1500, 200, 60)
    white = {}
    for whole in ("+", "-"):
        lines = plan(design, overrides=[*RAYS_ONLY, "+vignetting", f"{whole}finite_microlens_aperture"])
        white[whole] = WhiteGeometry.of(planned_camera(design, lines), lines).image(region)
    even = Scene(objects=(Plane(distance=design.d_f, texture=Uniform()),))
    lines = plan(design, even, overrides=[*RAYS_ONLY, "+vignetting", "+finite_microlens_aperture"])
    rays, _ = Tracer.of(design, lines, even).image(region, RaySampling(256, 256, 0.0, 3))
    off = {whole: np.sqrt(((image - rays) ** 2).mean()) for whole, image in white.items()}
    assert off["-"] > 0.005
    assert off["+"] < 0.25 * off["-"]
    assert abs(white["+"].mean() - rays.mean()) < 1e-4


def test_an_array_beside_the_axis_is_cut_as_rays_say():
    """Array and sensor 8 mm aside look past the field that the lens leaves whole: the plan knows, pixels show it."""
    aside = PAPER.replace({"microlens_array.decentre": (8.0, 0.0), "sensor.decentre": (8.0, 0.0)})
    straight = ["-microlens_diffraction", "-microlens_defocus", "-cos4"]
    assert plan(PAPER)["vignetting"].estimate == 0
    assert plan(aside).on("vignetting")
    region = Region(4500, 1500, 60, 60)
    rays, _ = Tracer.of(aside, plan(aside, overrides=straight), WHITE_FIELD).image(region, RaySampling(256, 256, 0.0))
    for overrides in (straight, ["-cos4"]):  # diffraction moves light between pixels, and takes none away
        image = render(aside, region=region, overrides=overrides).pixels
        assert abs(image.mean() - rays.mean()) < 2e-3


def test_overlap_left_out_gives_no_pixel_more_than_one_image():
    lines = plan(BORE, overrides=[*RAYS_ONLY, "-overlap"])
    region = Region(1000, 900, 60, 60)
    exact = WhiteGeometry.of(planned_camera(BORE, lines), lines).image(region)
    rays, _ = Tracer.of(BORE, lines, WHITE_FIELD).image(region, RaySampling(256, 256, 0.0, 3))
    assert exact.max() == 1.0
    assert abs(rays.mean() - exact.mean()) < 5e-3


def test_pixels_do_not_depend_on_the_region_tiles_or_threads():
    scene = Scene(objects=(Plane(distance=340.0, texture=Sinusoid(period=3.0)),))
    lines = plan(PAPER, scene)
    tracer = Tracer.of(PAPER, lines, scene)
    whole, _ = tracer.image(WIDE, RaySampling())
    part, _ = tracer.image(Region(WIDE.column + 7, WIDE.row + 9, 20, 30), RaySampling())
    np.testing.assert_array_equal(part, whole[9:39, 7:27])
    images = [render(PAPER, scene, region=WIDE, threads=n, seed=5).pixels for n in (1, 2)]
    np.testing.assert_array_equal(*images)
    other = render(PAPER, scene, region=WIDE, seed=6).pixels
    assert (other != images[0]).any()


def test_points_are_those_of_the_sobol_sequence():
    for count in (1, 5, 4096):
        points = Sobol(6, scramble=False, bits=32).random_base2((count - 1).bit_length())[:count]
        np.testing.assert_array_equal(sobol_points(count), points * 2.0**32)


def test_noise_repeats_with_its_seed():
    scene = Scene(light={"exposure": 1000.0, "read_noise": 3.0})
    one, same, other = (render(PAPER, scene, region=(0, 0, 600, 600), seed=seed).pixels for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, same)
    assert (one != other).any()


def test_a_uniform_plane_looks_like_a_white_field(near_light):
    region = (3000, 2000, 40, 40)
    plane = Scene(objects=(Plane(distance=300.0, texture=Uniform(level=0.5)),))
    traced = render(PAPER, plane, region=region, sampling=RaySampling(1024, 1024, 0.0, 1))
    white = render(PAPER, Scene(objects=({"kind": "white", "level": 0.5},)), region=region)
    assert (traced.method, white.method) == ("rays", "harmonics")
    assert np.abs(traced.pixels - white.pixels).max() < 6e-3


@pytest.mark.parametrize(
    "thing",
    [
        Plane(distance=330.0, tilt=(0.2, -0.1), texture=Sinusoid(period=2.0, angle=0.4)),
        Sphere(distance=345.0, radius=15.0, centre=(1.0, -2.0), texture=Sinusoid(period=2.0)),
        Sphere(distance=345.0, radius=-15.0, centre=(1.0, -2.0), texture=Sinusoid(period=2.0)),
        Sphere(distance=150.0, radius=-90.0, centre=(3.0, 1.0), texture=Sinusoid(period=2.0, angle=0.7)),
        Tube(start=200.0, end=900.0, radius=12.0, texture=Sinusoid(period=9.0, angle=1.0)),
    ],
)
def test_single_rays_end_where_plain_geometry_says(thing):
    """Surfaces met by rays from the FAP's centre, found again by bisection on the surface's own equation."""
    surfaces = encode(Scene(objects=(thing,), background=0.123), 350.0)
    for slope in [(0.01, 0.02), (-0.03, 0.015), (0.06, -0.05), (0.002, -0.11)]:
        ox, oy = slope
        _, (value,) = met(surfaces, 120.0, np.array([[120.0 * ox, 120.0 * oy, ox, oy]]))
        assert value == pytest.approx(by_marching(thing, ox, oy), abs=1e-6)


def grating(texture, u, v):
    along = u * np.cos(texture.angle) + v * np.sin(texture.angle)
    return 0.5 * (1 + np.cos(2 * np.pi / texture.period * along))


def by_marching(thing, ox, oy):
    """Radiance along the ray (x, y, z) = (-o (Z - 120), -Z), stepping outwards until it crosses the surface."""

    def inside(z):
        x, y = -ox * (z - 120), -oy * (z - 120)
        if isinstance(thing, Plane):
            t_x, t_y = thing.tilt
            normal = np.array([np.sin(t_y) * np.cos(t_x), -np.sin(t_x), np.cos(t_x) * np.cos(t_y)])
            return normal @ [x, y, -z + thing.distance]
        if isinstance(thing, Sphere):
            away = np.hypot(np.hypot(x - thing.centre[0], y - thing.centre[1]), z - thing.distance)
            return away - thing.radius if thing.radius > 0 else -thing.radius - away
        return thing.radius - np.hypot(x, y)

    depths = np.linspace(201, 900, 20001)
    signs = np.array([inside(z) for z in depths]) > 0
    hollow = isinstance(thing, Sphere) and thing.radius < 0
    crossed = np.nonzero(signs[:-1] & ~signs[1:])[0]  # a hollow one is left, whether its near side was met or not
    if not (signs[0] or hollow) or not crossed.size:
        return 0.123
    low, high = depths[crossed[0]], depths[crossed[0] + 1]
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if inside(middle) > 0 else (low, middle)
    z = low
    x, y = -ox * (z - 120), -oy * (z - 120)
    if isinstance(thing, Plane):
        t_x, t_y = thing.tilt
        u_axis = np.array([np.cos(t_y), 0, -np.sin(t_y)])
        v_axis = np.array([np.sin(t_y) * np.sin(t_x), np.cos(t_x), np.cos(t_y) * np.sin(t_x)])
        at = np.array([x, y, thing.distance - z])
        return float(grating(thing.texture, u_axis @ at, v_axis @ at))
    if isinstance(thing, Sphere):
        dx, dy, dz = x - thing.centre[0], y - thing.centre[1], thing.distance - z
        r, towards = abs(thing.radius), dz if thing.radius > 0 else -dz
        return float(grating(thing.texture, r * np.arctan2(dx, towards), r * np.arcsin(dy / r)))
    return float(grating(thing.texture, thing.radius * np.arctan2(y, x), z))


def test_nearer_objects_hide_farther_ones():
    board = Plane(distance=350.0, texture=Uniform(level=0.25))
    card = Plane(distance=300.0, size=(4.0, 400.0), texture=Uniform(level=1.0))
    level = {}
    for column, place in ((2280, "card"), (3800, "board")):
        scene = Scene(objects=(board, card))
        image = render(PAPER, scene, region=(column, 1530, 13, 13), overrides=RAYS_ONLY)
        level[place] = np.median(image.pixels)
    assert level["card"] == pytest.approx(1.0, abs=0.02)
    assert level["board"] == pytest.approx(0.25, abs=0.02)


def test_points_by_rays_keep_their_light():
    """Out of focus, over many microlenses: what the FAP takes in arrives; a clipped pupil loses its share."""
    region = Region(2000, 1300, 600, 500)
    image = point_image(PointSource(Camera.of(PAPER), 0.3, -0.2, 250.0), region, (), 0.01)
    assert image.sum() == pytest.approx(1.0, abs=1e-6)
    corner = np.array([region.row, region.column]) - np.array(PAPER.pixels[::-1]) / 2
    centre = np.array(np.nonzero(image)).mean(1) + corner
    spot = np.array(PointSource(Camera.of(PAPER), 0.3, -0.2, 250.0).spot) / PAPER.q
    np.testing.assert_allclose(centre[::-1], spot, atol=3.0)
    scene = Scene(objects=(Points(positions=((0.0, 0.0, 350.0),), flux=50.0),))
    image = render(PAPER, scene, region=region, overrides=[*RAYS_ONLY, "-finite_microlens_aperture"])
    assert image.method == "points"
    assert image.pixels.sum() == pytest.approx(50.0, rel=1e-5)


def test_points_through_tilted_parts_are_refused():
    tilted = PAPER.replace({"sensor.tilt": (0.01, 0.0)})
    scene = Scene(objects=(Points(positions=((0.0, 0.0, 350.0),)),))
    with pytest.raises(InputError, match="-tilts"):
        render(tilted, scene, region=(2300, 1540, 20, 20))


@pytest.mark.parametrize("region", [(0, 0, 0, 5), (-1, 0, 5, 5), (4590, 0, 20, 5), (0, 3079, 5, 2)])
def test_regions_outside_the_sensor(region):
    with pytest.raises(InputError, match="4600 x 3080"):
        render(PAPER, region=region)


def test_lattice_holds_whole_cells_only():
    lattice = ImageLattice.of(Camera.of(PAPER))
    index = lattice.indices(-20, 20, -20, 20)
    assert index.max() == 182  # (23 mm / 63 um - 1)/2 = 182.04
    assert len(index) == 365**2
