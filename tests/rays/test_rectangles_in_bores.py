"""Rectangular stops and a rectangular FAP with elements among them: polygon clipping, and Snell's law of one's own.

To first order every face and lens is a matrix, written out here again, so that a rectangle's image on the sensor is a
rectangle whose corners follow from two rays. By Snell's law rays go from face to face as vectors.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.effects import plan
from roslf_design.effects.elements import exact_minus_paraxial
from roslf_design.fates import state_at
from roslf_design.imaging.camera import Region, planned_camera
from roslf_design.imaging.trace import RaySampling, Tracer
from roslf_design.imaging.white import WhiteGeometry
from roslf_design.lenses.prescription import Prescription, Surface
from roslf_design.rays import trace_pupil
from roslf_design.scenes import WHITE_FIELD
from roslf_design.theory.object_space import FAP as FIRST
from roslf_design.theory.object_space import ObjectSpaceFaces
from roslf_design.theory.stop_images import MicrolensImages
from tests.shapes.test_openings import clipped, shoelace

PAPER = roslf.load("paper")
RAYS = 120_000
SPREAD = 5.0
"""Standard errors of a counted share: one test in a million is farther off."""
PLATE = {"kind": "plate", "distance": 60.0, "thickness": 12.0, "material": {"index": 1.6}}
LENS = {"kind": "lens", "distance": 30.0, "focal_length": 180.0, "decentre": (0.2, -0.1)}
WINDOW = {"kind": "plate", "distance": 130.0, "thickness": 2.0, "material": {"index": 1.5}}
WATER = {"index": 1.333, "abbe": 55.8}


def stop(sides, turn=0.0, distance=100.0, **more):
    return {"shape": "rectangle", "sides": sides, "turn": turn, "distance": distance, **more}


FAP = stop((2.9, 1.9), 0.35, 120.0)
STOPS = stop((9.0, 7.0), -0.2, 90.0, decentre=(0.3, -0.2)), stop((16.0, 14.0), 0.6, 45.0)
BENCH = PAPER.replace({
    "aperture": FAP, "stops": STOPS, "elements": [LENS, PLATE, WINDOW], "object_space.medium": WATER,
    "main_lens.diameter": 200.0,
})  # fmt: skip


def paraxial(design, axis, c, p, plane):
    """Height at a plane of object space of rays from sensor points p through the pinhole microlens at c, one axis."""
    slope = (p - c) / design.d_2
    height = c - slope * design.d_1
    slope, z, n = slope + height / design.f, 0.0, 1.0
    for element in design.elements:
        if element.distance >= plane:
            break
        height, z = height - slope / n * (element.distance - z), element.distance
        if element.kind == "lens":
            slope = slope + (height - element.decentre[axis]) / element.focal_length
        else:
            n = float(element.material.index(design.wavelength))
            assert plane >= z + element.thickness
            height, z, n = height - slope / n * element.thickness, z + element.thickness, 1.0
    return height - slope / n * (plane - z)


def on_sensor(design, c, part):
    """Corners on the sensor of a rectangle in the bore, counterclockwise, through the microlens at c."""
    wide, tall = part.sides
    corners = np.array([(a * wide / 2, b * tall / 2) for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))])
    cos, sin = math.cos(part.turn), math.sin(part.turn)
    corners = corners @ np.array([[cos, sin], [-sin, cos]]) + part.decentre
    for axis in (0, 1):
        at, further = (paraxial(design, axis, c[axis], c[axis] + p, part.distance) for p in (0.0, 1.0))
        corners[:, axis] = (corners[:, axis] - at) / (further - at)
    return corners


@pytest.mark.parametrize("c", [(0.0, 0.0), (2.0, -1.5), (4.0, -2.5), (3.0, 5.0), (-5.0, 2.0)])
def test_shares_to_first_order_are_those_of_polygon_clipping(c):
    whole, *others = (on_sensor(BENCH, c, part) for part in BENCH.all_stops)
    part = list(whole)
    for other in others:
        part = clipped(part, other)
    area, centroid, _ = shoelace(part)
    images = MicrolensImages(Camera.of(BENCH), [c])
    assert float(images.shapes.kept_fraction[0, 0]) == pytest.approx(area / shoelace(whole)[0], abs=1e-9)
    assert float(images.shapes.area[0, 0]) == pytest.approx(area, rel=1e-9)
    np.testing.assert_allclose(images.shapes.centroid[0, 0], centroid, rtol=0, atol=1e-9)


def test_some_of_these_fields_are_cut_and_some_are_not():
    found = [field.kept_fraction for field in roslf.evaluate(BENCH, [(0.0, 0.0), (2.0, -1.5), (-5.0, 2.0)]).fields]
    assert found[0] == 1
    assert 0.8 < found[1] < 0.9
    assert 0.05 < found[2] < 0.1


@pytest.mark.parametrize(
    "tilts", [{}, {"aperture.tilt": (0.1, -0.06), "stops.0.tilt": (-0.08, 0.12), "elements.1.tilt": (0.05, 0.1)}]
)
def test_shares_to_first_order_are_those_of_the_cameras_rays(tilts):
    camera, rng = Camera.of(BENCH.replace(tilts)), np.random.default_rng(1)
    r, turn = np.sqrt(rng.uniform(size=RAYS)), rng.uniform(0, 2 * math.pi, RAYS)
    for c in ((2.0, -1.5), (4.0, -2.5)):
        rays = trace_pupil(camera, (r * np.cos(turn), r * np.sin(turn)), c)
        passed = np.logical_and.reduce([*rays.passes.values()]).mean()
        # Even over the FAP is even over its image but for the small turn of perspective.
        slack = 3e-3 if tilts else 0.0
        kept = float(MicrolensImages(camera, [c]).shapes.kept_fraction[0, 0])
        assert passed == pytest.approx(kept, abs=slack + SPREAD * math.sqrt(0.25 / RAYS))


def transposed(design):
    """A design with x and y exchanged."""

    def swapped(part):
        own = part.model_dump(exclude_none=True)
        if own.get("shape") == "rectangle":
            own |= {"sides": own["sides"][::-1], "turn": -own["turn"]}
        return own | {"decentre": own["decentre"][::-1]}

    aperture, *stops = (swapped(part) for part in design.all_stops)
    elements = [element.model_copy(update={"decentre": element.decentre[::-1]}) for element in design.elements]
    return design.replace({"aperture": aperture, "stops": stops, "elements": elements})


def kept(design, *places):
    return MicrolensImages(Camera.of(design), places).shapes.kept_fraction[:, 0]


def test_x_and_y_exchanged_change_nothing():
    places = [(4.0, -2.5), (3.0, 5.0), (-5.0, 2.0)]
    np.testing.assert_allclose(
        kept(BENCH, *places), kept(transposed(BENCH), *((y, x) for x, y in places)), rtol=0, atol=1e-12
    )


def test_a_square_turned_by_a_quarter_is_itself():
    places = [(4.0, -2.5), (3.0, 5.0)]
    one, same = (
        BENCH.replace({
            "aperture": stop((2.4, 2.4), 0.35 + turn, 120.0), "stops": [stop((8.0, 8.0), turn - 0.2, 90.0)]
        })
        for turn in (0.0, math.pi / 2)
    )  # fmt: skip
    np.testing.assert_allclose(kept(one, *places), kept(same, *places), rtol=0, atol=1e-12)


def test_a_rectangle_far_larger_than_all_light_cuts_nothing():
    place = (9.0, 6.0)
    bare = BENCH.replace({"stops": []})
    huge = BENCH.replace({"stops": [stop((400.0, 300.0), 0.4, 90.0)]})
    assert kept(huge, place)[0] == 1
    np.testing.assert_allclose(*(MicrolensImages(Camera.of(d), [place]).shapes.area for d in (bare, huge)), rtol=1e-12)


def test_builds_are_those_of_one_at_a_time():
    rng, count = np.random.default_rng(0), 6
    drawn = {
        "aperture.sides.0": 2.9 + 0.2 * rng.normal(size=count), "stops.0.turn": rng.normal(size=count),
        "elements.0.decentre.1": 0.3 * rng.normal(size=count), "elements.1.thickness": 12 + rng.normal(size=count),
        "aperture.tilt.0": 0.05 * rng.normal(size=count),
    }  # fmt: skip
    for places in (drawn, {place: values for place, values in drawn.items() if "tilt" not in place}):
        many = MicrolensImages(Camera.of(BENCH, places), [(4.0, -2.5)]).shapes.kept_fraction[0]
        alone = [kept(BENCH.replace({p: float(v[k]) for p, v in places.items()}), (4.0, -2.5))[0] for k in range(count)]
        np.testing.assert_allclose(many, alone, rtol=0, atol=1e-12)


# By Snell's law.

R_1, R_2, CENTRE = 160.0, -160.0, 4.0
GLASS = PAPER.replace({"elements": [{**PLATE, "material": {"index": 1.62, "abbe": 40.0}}]}).elements[0].material
SURFACES = Surface(1 / R_1, 20.0, CENTRE, GLASS), Surface(1 / R_2, 20.0)
SINGLET = {"kind": "prescription", "distance": 25.0, "prescription": Prescription(SURFACES)}
TILTED = {**PLATE, "tilt": (0.1, -0.15), "decentre": (0.3, 0.0)}
THICK = PAPER.replace({
    "aperture": {**FAP, "tilt": (0.1, -0.2)}, "main_lens.diameter": 60.0, "elements": [SINGLET, TILTED],
    "stops": [{**STOPS[0], "tilt": (-0.05, 0.1)}, stop((16.0, 14.0), 0.6, 52.0)],
})  # fmt: skip


def bent(way, normal, ratio):
    """Direction behind a face, normals against the light."""
    cosine = -np.sum(way * normal, 0)
    return ratio * way + (ratio * cosine - np.sqrt(1 - ratio**2 * (1 - cosine**2))) * normal


def turned(tilt):
    """Axes of a part tilted about x, then y, as columns."""
    (ca, sa), (cb, sb) = ((math.cos(t), math.sin(t)) for t in tilt)
    return np.array([[cb, 0, sb], [0, 1, 0], [-sb, 0, cb]]) @ np.array([[1, 0, 0], [0, ca, -sa], [0, sa, ca]])


def to_plane(point, way, vertex, normal):
    return point + way * (normal @ (vertex[:, None] - point) / (normal @ way))


def through(design, height, slope):
    """Whether rays pass every rectangle, by Snell's law, and how far from an edge [mm]."""
    n = float(GLASS.index(design.wavelength))
    point = np.stack([*height, np.zeros_like(height[0])])
    way = -np.stack([*slope, np.ones_like(height[0])]) / np.sqrt(1 + slope[0] ** 2 + slope[1] ** 2)

    def sphere(point, way, z, radius, ratio):
        middle = np.array([0.0, 0.0, z + radius])[:, None]
        off = point - middle
        b, c = np.sum(off * way, 0), np.sum(off**2, 0) - radius**2
        roots = [-b + sign * np.sqrt(b * b - c) for sign in (-1, 1)]
        met = [point + t * way for t in roots]
        near = np.abs(met[0][2] - z) < np.abs(met[1][2] - z)
        point = np.where(near, met[0], met[1])
        normal = (point - middle) / radius
        normal = normal * np.sign(-np.sum(normal * way, 0))
        return point, bent(way, normal, ratio)

    z = -float(design.elements[0].distance)
    point, way = sphere(point, way, z, R_2, 1 / n)
    point, way = sphere(point, way, z - CENTRE, R_1, n)
    passed, nearest = np.ones(height[0].shape, bool), np.full(height[0].shape, np.inf)

    def rectangle(part):
        nonlocal passed, nearest
        axes = turned(part.tilt)
        own = axes.T @ (to_plane(point, way, vertex_of(part), axes[:, 2]) - vertex_of(part)[:, None])
        cos, sin = math.cos(part.turn), math.sin(part.turn)
        for side, at in zip(part.sides, (cos * own[0] + sin * own[1], cos * own[1] - sin * own[0]), strict=True):
            room = side / 2 - np.abs(at)
            passed, nearest = passed & (room >= 0), np.minimum(nearest, np.abs(room))

    def vertex_of(part):
        return np.array([*part.decentre, -part.distance])

    plate = design.elements[1]
    index = float(plate.material.index(design.wavelength))
    rectangle(design.stops[1])
    axes = turned(plate.tilt)
    normal, vertex = axes[:, 2], vertex_of(plate)
    point = to_plane(point, way, vertex, normal)
    way = bent(way, normal[:, None], 1 / index)
    point = to_plane(point, way, vertex - plate.thickness * normal, normal)
    way = bent(way, normal[:, None], index)
    rectangle(design.stops[0])
    rectangle(design.aperture)
    return passed, nearest


def test_exact_rays_pass_turned_and_tilted_rectangles_as_ones_own_do():
    rng = np.random.default_rng(5)
    height, slope = rng.uniform(-9, 9, (2, RAYS)), rng.uniform(-0.08, 0.08, (2, RAYS))
    passed, nearest = through(THICK, height, slope)
    assert 0.01 < passed.mean() < 0.5
    space = ObjectSpaceFaces.of(Camera.of(THICK))
    status = space.rays((height[0], height[1]), (slope[0], slope[1])).status
    sure = nearest > 1e-9
    np.testing.assert_array_equal((status == 0)[sure], passed[sure])
    assert set(np.unique(status)) <= {0, *(state_at(FIRST + k) for k in range(3))}
    one = [space.rays((height[0, k], height[1, k]), (slope[0, k], slope[1, k])).status for k in range(40)]
    np.testing.assert_array_equal(one, status[:40])


GLAZED = roslf.load("mismatched-borescope").replace({
    "aperture": stop((1.6, 1.1), 0.3, 60.5), "stops": [stop((1.9, 1.25), -0.15, 62.0, decentre=(0.05, 0.0))],
    "elements": [{"kind": "plate", "distance": 37.5, "thickness": 22.5, "material": {"index": 1.5}}],
    "microlens_array.pitch": 0.4,
})  # fmt: skip
PINHOLES = [
    *("-microlens_diffraction", "-microlens_defocus", "-fap_diffraction", "-finite_microlens_aperture", "-cos4"),
    *("+overlap", "+object_defocus", "+decentres", "+vignetting", "+plate_aberration"),
]


def test_white_images_by_snells_law_are_polygons_where_rays_find_their_edges():
    lines = plan(GLAZED, overrides=PINHOLES)
    camera = planned_camera(GLAZED, lines)
    white = WhiteGeometry.of(camera, lines).by_snell(0.2, GLAZED.wavelength)
    off = white.exact.error / GLAZED.q
    assert 1e-4 < off < 0.2
    c = np.array([4.0, 2.5])
    index = float(GLAZED.elements[0].material.index(GLAZED.wavelength))
    rng = np.random.default_rng(2)
    openings, first = white.exact.at(c[:1], c[1:]).at(0), MicrolensImages(camera, [tuple(c)]).openings.at((0, 0))
    low, high = openings.corners[0].min(0) - 0.002, openings.corners[0].max(0) + 0.002
    p = rng.uniform(low, high, (RAYS, 2))
    slope = p / GLAZED.d_2
    height = c - slope * GLAZED.d_1
    slope = slope + height / GLAZED.f
    way = -np.stack([*slope.T, np.ones(RAYS)]) / np.sqrt(1 + np.sum(slope**2, 1))
    point, normal = np.stack([*height.T, np.zeros(RAYS)]), np.array([0.0, 0.0, 1.0])
    point = to_plane(point, way, np.array([0.0, 0.0, -37.5]), normal)
    inside = bent(way, normal[:, None], 1 / index)
    point = to_plane(point, inside, np.array([0.0, 0.0, -60.0]), normal)
    kept = np.ones(RAYS, bool)
    for part in GLAZED.all_stops:
        at = to_plane(point, way, np.array([0.0, 0.0, -part.distance]), normal)[:2] - np.array(part.decentre)[:, None]
        cos, sin = math.cos(part.turn), math.sin(part.turn)
        kept &= np.abs(cos * at[0] + sin * at[1]) <= part.sides[0] / 2
        kept &= np.abs(cos * at[1] - sin * at[0]) <= part.sides[1] / 2
        if part is GLAZED.aperture:
            whole = kept.mean()
    assert 0.3 < kept.mean() / whole < 0.95
    box = float(np.prod(high - low))
    length = np.hypot(*(np.roll(openings.corners[0], -1, 0) - openings.corners[0]).T).sum()
    for share, area in ((whole, float(openings.area)), (kept.mean(), float(np.ravel(openings.common().area)[0]))):
        scatter = SPREAD * math.sqrt(share * (1 - share) / RAYS)
        assert area / box == pytest.approx(share, abs=scatter + length * white.exact.error / box)
    # What Snell's law moves is more than that error.
    assert np.abs(openings.corners[0] - first.corners[0]).max() > 3 * white.exact.error


def test_pictures_through_rectangles_and_glass_are_those_of_sampled_rays():
    lines = plan(GLAZED, overrides=PINHOLES)
    camera = planned_camera(GLAZED, lines)
    white = WhiteGeometry.of(camera, lines).by_snell(0.2, GLAZED.wavelength)
    width, height = GLAZED.pixels
    region = Region(width - 120, height - 120, 40, 40)
    rays, _ = Tracer.of(GLAZED, lines, WHITE_FIELD).image(region, RaySampling(512, 512, 0.0, 1))
    image = white.image(region)
    assert np.ptp(image) > 0.9
    np.testing.assert_allclose(image, rays, rtol=0, atol=math.sqrt(2) * white.exact.error / GLAZED.q + 0.015)


def test_the_effect_of_exact_rays_is_about_what_the_outlines_move():
    lines = plan(GLAZED, overrides=PINHOLES)
    camera = planned_camera(GLAZED, lines)
    white = WhiteGeometry.of(camera, lines).by_snell(0.2, GLAZED.wavelength)
    half = np.array(camera.pixels) * camera.q / 2
    said = exact_minus_paraxial(GLAZED, float(np.hypot(*half)), (GLAZED.d_f,)).image
    moved = 0.0
    for at in itertools.product((-half[0], 0.0, half[0]), (-half[1], half[1])):
        x, y = (np.array([a]) for a in at)
        exact = white.exact.at(x, y)
        first = MicrolensImages(camera, [at]).openings.at((slice(None), 0)).some(white.exact.rims)
        moved = max(moved, float(np.hypot(*(exact.corners - first.corners).reshape(-1, 2).T).max()))
    assert 0.9 * moved < said < 4 * moved
