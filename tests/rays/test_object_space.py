"""Exact rays before the main lens, against Snell's law and ray equations in mpmath."""

import math
from pathlib import Path

import mpmath as mp
import numpy as np
import pytest
from pydantic import TypeAdapter

import roslf_design as roslf
from roslf_design.bore.elements import AnyElement
from roslf_design.camera import Camera
from roslf_design.fates import FATES, RayFate, state_at
from roslf_design.lenses import tracer
from roslf_design.theory.object_space import FAP, ObjectSpaceFaces, carry

PAPER = roslf.load("paper").replace({"aperture.distance": 2.0, "aperture.diameter": 50.0})
WATER = {"index": 1.333, "abbe": 55.8}
BLOCK = {"kind": "plate", "distance": 30.0, "thickness": 4.0, "material": {"index": 1.5}}


def looking(*elements, medium=1.0, **more):
    """A design of these elements, wherever the plane in focus then is."""
    window = {**BLOCK, "distance": 200.0}
    filled = PAPER.replace({"elements": [window], "object_space.medium": {"index": medium}, **more})
    return filled.model_copy(update={"elements": TypeAdapter(tuple[AnyElement, ...]).validate_python(elements)})


def turned(tilt_x, tilt_y, v):
    """Turned about x, then about y."""
    x, y, z = v
    y, z = y * mp.cos(tilt_x) - z * mp.sin(tilt_x), y * mp.sin(tilt_x) + z * mp.cos(tilt_x)
    return mp.matrix([x * mp.cos(tilt_y) + z * mp.sin(tilt_y), y, -x * mp.sin(tilt_y) + z * mp.cos(tilt_y)])


def dot(a, b):
    return sum(a[i] * b[i] for i in range(3))


def snell(point, way, vertex, normal, before, after):
    """Straight on to a plane and through it; the refracted direction by the law's vector form."""
    t = dot(vertex - point, normal) / dot(way, normal)
    ratio, cosine = mp.mpf(before) / after, -dot(way, normal)
    bent = ratio * way + (ratio * cosine - mp.sqrt(1 - ratio**2 * (1 - cosine**2))) * normal
    return point + t * way, bent


def outside(point, way):
    slope = way[0] / way[2], way[1] / way[2]
    return [float(point[k] - slope[k] * point[2]) for k in (0, 1)], [float(s) for s in slope]


def start(height, slope):
    way = mp.matrix([slope[0], slope[1], 1])
    return mp.matrix([height[0], height[1], 0]), -way / mp.sqrt(dot(way, way))


RAYS = [((0.0, 0.0), (0.0, 0.0)), ((3.0, -1.0), (0.4, 0.1)), ((-2.0, 2.0), (-0.3, 0.7)), ((0.5, 0.0), (1e-5, -2e-6))]


def test_tilted_wedged_plates_into_water_are_snells_law():
    first = {**BLOCK, "tilt": (0.05, -0.11), "wedge": (0.02, 0.03), "decentre": (0.3, -0.2)}
    second = {**BLOCK, "kind": "prism", "distance": 60.0, "thickness": 9.0, "material": {"index": 1.77}}
    second["tilt"] = (-0.08, 0.04)
    design = looking(first, second, medium=1.333)
    space = ObjectSpaceFaces.of(Camera.of(design))
    index = [float(e.material.index(design.wavelength)) for e in design.elements]
    with mp.workdps(40):
        for height, slope in RAYS:
            point, way = start([mp.mpf(h) for h in height], [mp.mpf(s) for s in slope])
            for k, (element, after) in enumerate(zip(design.elements, (1.0, 1.333), strict=True)):
                tilt, wedge = element.tilt, element.wedge
                normal = turned(*tilt, mp.matrix([0, 0, 1]))
                leaned = turned(*tilt, turned(*wedge, mp.matrix([0, 0, 1])))
                vertex = mp.matrix([*element.decentre, -mp.mpf(element.distance)])
                point, way = snell(point, way, vertex, leaned, 1, index[k])
                medium = float(design.object_space.medium.index(design.wavelength)) if after > 1 else 1
                point, way = snell(point, way, vertex - mp.mpf(element.thickness) * normal, normal, index[k], medium)
            found = space.rays(height, slope)
            assert found.status == RayFate.KEPT
            truth = outside(point, way)
            np.testing.assert_allclose(found.height, truth[0], rtol=0, atol=1e-12)
            np.testing.assert_allclose(found.slope, truth[1], rtol=0, atol=1e-12)


def test_a_plane_parallel_plate_shifts_a_ray_by_its_formula():
    design = looking(BLOCK)
    n = float(design.elements[0].material.index(design.wavelength))
    angle = np.linspace(0, 1.2, 13)
    found = ObjectSpaceFaces.of(Camera.of(design)).rays((0.0, 0.0), (np.tan(angle), 0.0))
    sideways = np.abs(found.height[0]) * np.cos(angle)
    law = 4.0 * np.sin(angle) * (1 - np.cos(angle) / np.sqrt(n * n - np.sin(angle) ** 2))
    np.testing.assert_allclose(sideways, law, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.slope[0], np.tan(angle), rtol=1e-13)


def test_a_rod_is_its_ray_equation():
    """Skew rays against mpmath's Taylor solution of d/ds(n dr/ds) = grad n for n = n_0 (1 - g^2 r^2/2)."""
    rod = {"kind": "grin", "distance": 30.0, "thickness": 7.0, "index": 1.6, "gradient": 0.25, "tilt": (0.02, -0.01)}
    design = looking(rod, medium=1.333)
    space = ObjectSpaceFaces.of(Camera.of(design))
    n_m = float(design.object_space.medium.index(design.wavelength))
    with mp.workdps(25):
        for height, slope in (((0.2, 0.1), (0.01, -0.02)), ((1.0, 2.0), (0.05, 0.08))):
            point, way = start([mp.mpf(h) for h in height], [mp.mpf(s) for s in slope])
            axes = [turned(0.02, -0.01, mp.matrix([k == 0, k == 1, k == 2])) for k in range(3)]
            vertex = mp.matrix([0, 0, -30])
            point, way = (mp.matrix([dot(v, axis) for axis in axes]) for v in (point - vertex, way))
            t = -point[2] / way[2]
            x, y = point[0] + t * way[0], point[1] + t * way[1]

            def index(x, y):
                return mp.mpf("1.6") * (1 - mp.mpf("0.25") ** 2 * (x * x + y * y) / 2)

            forward = mp.sqrt(index(x, y) ** 2 - way[0] ** 2 - way[1] ** 2)

            def step(_, v, forward=forward):
                # tau with ds = n d tau: x'' = n dn/dx; all per length along the axis, which is forward * tau.
                pull = -mp.mpf("1.6") * mp.mpf("0.25") ** 2 * index(v[0], v[1]) / forward**2
                return [v[2], v[3], pull * v[0], pull * v[1]]

            x, y, u, v = mp.odefun(step, 0, [x, y, way[0] / forward, way[1] / forward], tol=mp.mpf("1e-14"))(7)
            p = [u * forward / n_m, v * forward / n_m]
            local = mp.matrix([x, y, -7]), mp.matrix([*p, -mp.sqrt(1 - p[0] ** 2 - p[1] ** 2)])
            out = [sum((axes[k] * part[k] for k in range(3)), mp.zeros(3, 1)) for part in local]
            truth = outside(vertex + out[0], out[1])
            found = space.rays(height, slope)
            np.testing.assert_allclose(found.height, truth[0], rtol=0, atol=1e-11)  # 40 mm on from the rod
            np.testing.assert_allclose(space.for_pixels.rays(height, slope).height, truth[0], rtol=2e-6)
            np.testing.assert_allclose(found.slope, truth[1], rtol=0, atol=1e-12)


ROD = {"kind": "grin", "distance": 30.0, "thickness": 40.0, "index": 1.6, "gradient": 0.2, "diameter": 2.0}


@pytest.mark.parametrize("slope", [0.1, -0.2])
def test_a_rods_barrel_takes_what_swings_beyond_it(slope):
    """Where a ray in a plane turns: of x'' = -k^2 x (1 - g^2 x^2/2) the sum of squares that stays tells how far out."""
    height, n, g = 0.3, ROD["index"], ROD["gradient"]
    x = height - slope * ROD["distance"]
    if abs(x) > 1:  # aimed at the middle instead
        height, x = slope * ROD["distance"] + 0.3, 0.3
    sine = slope / math.sqrt(1 + slope**2)
    own = n * (1 - g * g * x * x / 2)
    k = n * g / math.sqrt(own**2 - sine**2)
    kept = sine**2 / (own**2 - sine**2) / k**2 + x * x - g * g * x**4 / 4
    crest = math.sqrt(2 / g**2 * (1 - math.sqrt(1 - g * g * kept)))
    for share, status in ((1.002, RayFate.KEPT), (0.998, state_at(FAP + 1))):
        rod = {**ROD, "diameter": 2 * crest * share}
        found = ObjectSpaceFaces.of(Camera.of(looking(rod))).rays((height, 0.0), (slope, 0.0))
        assert found.status == status, share
    stages = ObjectSpaceFaces.of(Camera.of(looking({**ROD, "diameter": None})))
    depths = np.linspace(0.1, 39.9, 200)
    seen = [
        r.height[0] - r.slope[0] * (30 + z)
        for z, r in zip(depths, stages.rays_at(30 + depths, (height, 0.0), (slope, 0.0)), strict=False)
    ]
    assert np.max(np.abs(seen)) == pytest.approx(crest, rel=2e-3)
    *_, end = stages.rays_at(30 + depths, (height, 0.0), (slope, 0.0))
    whole = stages.rays((height, 0.0), (slope, 0.0))
    np.testing.assert_allclose(end.height, whole.height, rtol=0, atol=1e-10)
    np.testing.assert_allclose(end.slope, whole.slope, rtol=0, atol=1e-12)


def test_a_real_objective_is_its_prescription():
    """A prescription as element against the lens's own trace, turned and shifted by hand."""
    group = {"kind": "prescription", "distance": 40.0, "prescription": "AC254-050-A", "decentre": (0.4, -0.1)}
    design = looking(group)
    lens = design.elements[0].lens
    height, slope = (np.array([1.0, -3.0]), np.array([2.0, 0.5])), (np.array([0.02, -0.05]), np.array([0.01, 0.03]))
    found = ObjectSpaceFaces.of(Camera.of(design)).rays(height, slope)
    at = [h - s * (40.0 - 0.0) for h, s in zip(height, slope, strict=True)]  # on its sensor-side vertex's plane
    there = lens.through((at[0] - 0.4, at[1] + 0.1), slope, design.wavelength, start=lens.length, end=-5.0, clip=True)
    z = -40.0 - lens.length - 5.0
    for axis, off in ((0, 0.4), (1, -0.1)):
        np.testing.assert_allclose(found.slope[axis], there.slope[axis], rtol=0, atol=1e-13)
        met = found.height[axis] + found.slope[axis] * z
        np.testing.assert_allclose(met, there.height[axis] + off, rtol=0, atol=1e-12)


def test_near_the_axis_rays_are_the_closed_forms():
    """Of every kind of element, tilts, wedges and decentres together: off by the angle squared and no more."""
    elements = (
        {**BLOCK, "wedge": (1e-5, -2e-5), "tilt": (2e-5, 1e-5)},
        {"kind": "lens", "distance": 50.0, "focal_length": 120.0, "decentre": (1e-5, 0.0)},
        {"kind": "grin", "distance": 60.0, "thickness": 8.0, "index": 1.6, "gradient": 0.1, "decentre": (0.0, 2e-5)},
        {"kind": "prescription", "distance": 90.0, "prescription": "AC254-050-A", "tilt": (1e-5, 0.0)},
        {**BLOCK, "distance": 120.0, "tilt": (-1e-5, 2e-5)},
    )
    design = looking(*elements, medium=1.333)
    camera = Camera.of(design)
    end, plane = camera.front
    l, o = np.array([3e-5, -1e-5]), np.array([1e-6, 2e-6])
    found = ObjectSpaceFaces.of(camera).rays(tuple(l), tuple(o))
    assert found.status == RayFate.KEPT
    for k in (0, 1):
        met = found.height[k] + found.slope[k] * -float(end)
        assert met == pytest.approx(float(plane.a * l[k] - plane.b * o[k] + plane.axis_offset[k]), rel=2e-8)
        leaves = (-plane.c * l[k] + plane.d * o[k] + plane.axis_slope[k]) / plane.medium
        assert found.slope[k] == pytest.approx(float(leaves), rel=2e-8)


def test_every_opening_takes_its_rays_in_order_and_what_is_reflected_says_so():
    stops = ({"diameter": 6.0, "distance": 20.0}, {"diameter": 1.0, "distance": 50.0})
    design = looking({**BLOCK, "diameter": 5.0}, stops=stops, **{"aperture.diameter": 10.0})
    space = ObjectSpaceFaces.of(Camera.of(design))
    height, stop = [0.0, 6.0, 4.0, 2.8, 2.0], FAP
    fates = space.rays((np.array(height), 0.0), (0.0, 0.0)).status
    assert fates.tolist() == [0, *(state_at(stop + k) for k in (0, 1, 3, 2))]
    # Between the faces: in at 2.4 mm, out at 2.6 mm.
    slope = math.tan(math.asin(1.5 * math.sin(math.atan(0.06))))
    assert space.rays((2.4 - slope * 30, 0.0), (-slope, 0.0)).status == state_at(stop + 4)
    assert not ObjectSpaceFaces.of(Camera.of(design), clip=False).rays((height, 0.0), (0.0, 0.0)).status.any()
    # 45 degrees in glass cannot get out of a wedge's far face.
    wedge = looking({**BLOCK, "kind": "prism", "material": {"index": 1.9}, "wedge": (0.0, 0.8)})
    assert ObjectSpaceFaces.of(Camera.of(wedge)).rays((0.0, 0.0), (0.9, 0.0)).status % FATES == RayFate.REFLECTED


def test_many_rays_are_few_rays():
    """Compiled and interpreted: the same bits."""
    rod = {"kind": "grin", "distance": 60.0, "thickness": 8.0, "index": 1.6, "gradient": 0.1}
    space = ObjectSpaceFaces.of(Camera.of(looking({**BLOCK, "tilt": (0.1, 0.0)}, rod, medium=1.333)))
    rng = np.random.default_rng(3)
    lines = rng.uniform(-0.2, 0.2, (4, 4000))
    many = space.rays(tuple(lines[:2]), tuple(lines[2:]))
    few, status = np.zeros((4, 50)), np.zeros(50, np.int16)
    room = np.empty(tracer.ROWS * tracer.BLOCK), np.empty(tracer.BLOCK)
    few_lines = np.ascontiguousarray(lines[:, :50])
    carry(space.table, space.media, space.openings, space.law, *room, few_lines, few, status)
    np.testing.assert_array_equal(few[:2], many.height[:, :50])
    np.testing.assert_array_equal(few[2:], many.slope[:, :50])


def test_many_rays_through_a_mapped_objective_are_single_ones():
    """Angles of sines and tangents may differ by a bit between the two: one of them does it all."""
    lens = {"kind": "lens", "distance": 60.0, "focal_length": 70.0, "mapping": "f sin"}
    space = ObjectSpaceFaces.of(Camera.of(looking(lens)))
    lines = np.random.default_rng(3).uniform(-0.5, 0.5, (4, 2000))
    many = space.rays(tuple(lines[:2]), tuple(lines[2:]))
    assert not many.status.any()
    single = [space.rays(tuple(line[:2]), tuple(line[2:])) for line in lines[:, :50].T]
    np.testing.assert_array_equal([found.height for found in single], many.height[:, :50].T)
    np.testing.assert_array_equal([found.slope for found in single], many.slope[:, :50].T)


@pytest.mark.parametrize("mapping", ["f tan", "f theta"])
def test_builds_of_a_lens_are_those_of_one_at_a_time(mapping):
    lens = {"kind": "lens", "distance": 80.0, "focal_length": 70.0, "mapping": mapping}
    camera = Camera.of(looking(BLOCK, lens, medium=1.333))
    for place, values in (
        ("elements.1.focal_length", np.array([65.0, 70.0, 80.0])),
        ("aperture.distance", np.array([60.0, 75.0])),
    ):
        table = ObjectSpaceFaces.of(camera.replace({place: values})).table
        alone = [ObjectSpaceFaces.of(camera.replace({place: value})).table for value in values]
        np.testing.assert_allclose(table, alone, rtol=1e-14, atol=0)


def test_rays_stage_by_stage_are_those_of_a_chain_cut_short():
    """Between faces against the same chain without what stands farther; at the end all of it."""
    second = {**BLOCK, "distance": 60.0, "tilt": (0.05, 0.0)}
    lens = {"kind": "lens", "distance": 80.0, "focal_length": 70.0}
    height, slope = (np.array([0.0, 2.0, -3.0]), np.array([1.0, 0.0, 0.5])), (np.array([0.1, -0.3, 0.0]), 0.02)
    whole = ObjectSpaceFaces.of(Camera.of(looking(BLOCK, second, lens)))
    *part, end = whole.rays_at([10.0, 45.0, 70.0, 80.0], height, slope)
    parts = [looking(), looking(BLOCK), looking(BLOCK, second), looking(BLOCK, second)]
    for found, design in zip(part, parts, strict=True):
        alone = ObjectSpaceFaces.of(Camera.of(design)).rays(height, slope)
        np.testing.assert_allclose(found.height, alone.height, rtol=0, atol=1e-13)
        np.testing.assert_allclose(found.slope, alone.slope, rtol=0, atol=1e-15)
    np.testing.assert_allclose(end.height, whole.rays(height, slope).height, rtol=0, atol=1e-13)


@pytest.mark.parametrize("name", ["upright", "tilted"])
def test_plane_parallel_plates_are_optilands(name):
    """Stored rays of Optiland 0.6.3, made by `oracles/optiland_plates.py`: three plates, two in contact, into water."""
    stored = np.load(Path(__file__).parents[1] / "oracles/plate_rays.npz")
    plates = ((30.0, 4.0, 1.5168), (60.0, 9.0, 1.7705), (69.0, 0.5, 1.4585))
    first, *others = (
        {"kind": "plate", "distance": at, "thickness": thickness, "material": {"index": index}}
        for at, thickness, index in plates
    )
    tilt = (0.31, -0.22) if name == "tilted" else (0.0, 0.0)
    camera = Camera.of(looking({**first, "tilt": tilt}, *others, medium=1.333))
    found = ObjectSpaceFaces.of(camera).rays(tuple(stored["height"]), tuple(-stored["slope"]))
    assert not found.status.any()
    np.testing.assert_allclose(found.slope, -stored[f"{name}_slope"], rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.height - 100 * found.slope, stored[f"{name}_end"], rtol=0, atol=1e-9)
