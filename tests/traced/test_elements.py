"""A real main lens behind windows, liquids, lenses and rods, against rays traced face by face at 40 digits."""

import mpmath as mp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from roslf_design.camera import Camera
from roslf_design.design import load
from roslf_design.design.check import DesignError
from roslf_design.errors import InputError
from roslf_design.evaluation import evaluate
from roslf_design.fates import ImageFate, RayFate
from roslf_design.traced.camera import camera_of, sensor_of_pupil, views
from roslf_design.traced.images import field_map, measured_bound, real_field

WATER = {"index": 1.333, "abbe": 55.8}
WINDOW = {
    "kind": "plate",
    "distance": 118.0,
    "thickness": 1.0,
    "material": {"index": 1.77, "abbe": 72.0},
    "diameter": 30.0,
}
LEANING = {
    "kind": "plate",
    "distance": 50.0,
    "thickness": 8.0,
    "material": {"index": 1.5, "abbe": 60.0},
    "tilt": (0.03, -0.05),
    "wedge": (0.01, 0.02),
    "decentre": (0.3, -0.2),
}
AIR = {**WINDOW, "material": {"index": 1.0}}
RELAY = {"kind": "lens", "distance": 60.0, "focal_length": 250.0, "decentre": (0.2, 0.0)}
ROD = {"kind": "grin", "distance": 80.0, "thickness": 7.0, "index": 1.6, "gradient": 0.02, "diameter": 40.0}
GROUP = {"kind": "prescription", "distance": 80.0, "prescription": "AC508-150-A"}


def bench(*elements, medium=None, lens="LB1630-A", fap=115.0, **changes):
    """The singlet bench with these elements before it."""
    more = {} if medium is None else {"object_space.medium": medium}
    base = load("paper-singlet").replace({"main_lens.prescription": lens, "aperture.distance": fap})
    return base.replace({"elements": list(elements), **more, **changes})


def turned(tilt, v):
    """Turned about x, then about y."""
    x, y, z = v
    a, b = tilt
    y, z = y * mp.cos(a) - z * mp.sin(a), y * mp.sin(a) + z * mp.cos(a)
    return mp.matrix([x * mp.cos(b) + z * mp.sin(b), y, -x * mp.sin(b) + z * mp.cos(b)])


def dot(a, b):
    return sum(a[i] * b[i] for i in range(3))


def refracted(way, normal, before, after):
    """Snell's law; the normal against the ray."""
    ratio, cosine = mp.mpf(before) / after, -dot(way, normal)
    return ratio * way + (ratio * cosine - mp.sqrt(1 - ratio**2 * (1 - cosine**2))) * normal


def through_plane(point, way, vertex, normal, before, after):
    point = point + dot(vertex - point, normal) / dot(way, normal) * way
    return point, refracted(way, normal, before, after)


def through_sphere(point, way, vertex, curvature, before, after):
    """At the crossing nearest the vertex; axis along z."""
    if curvature == 0:
        return through_plane(point, way, mp.matrix([0, 0, vertex]), mp.matrix([0, 0, 1]), before, after)
    radius = 1 / mp.mpf(curvature)
    centre = mp.matrix([0, 0, vertex + radius])
    off = point - centre
    b, c = dot(off, way), dot(off, off) - radius**2
    roots = [-b + sign * mp.sqrt(b * b - c) for sign in (-1, 1)]
    point = min((point + t * way for t in roots), key=lambda p: abs(p[2] - vertex))
    normal = (point - centre) / radius
    return point, refracted(way, normal if dot(normal, way) < 0 else -normal, before, after)


def by_hand(design, sensor, microlens, plane):
    """Where the ray from a sensor point through a microlens's middle crosses a plane before the lens; lens's axis.

    Through the spheres of the lens as it stands, then every face of plates, from the lens outwards.
    """
    lens, wave = design.lens, design.wavelength
    camera = camera_of(design)
    front = camera.first_order.front_principal
    start = mp.matrix([*microlens, mp.mpf(camera.array.z)])
    way = mp.matrix([*microlens, mp.mpf(camera.array.z)]) - mp.matrix([*sensor, mp.mpf(camera.detector.z)])
    point, way = start, way / mp.sqrt(dot(way, way))
    media = [1.0, *(float(s.glass.index(wave)) for s in lens.surfaces)]
    for k in reversed(range(len(lens.surfaces))):
        surface = lens.surfaces[k]
        point, way = through_sphere(point, way, mp.mpf(lens.vertices[k]), surface.curvature, media[k + 1], media[k])
    index = 1.0
    medium = float(design.object_space.medium.index(wave))
    elements = sorted(design.elements, key=lambda e: e.distance)
    for passed, element in enumerate(elements, 1):
        if element.distance >= plane:
            break
        normal, wedged = (turned(element.tilt, turned(t, (0, 0, 1))) for t in ((0, 0), element.wedge))
        aside = np.subtract(element.decentre, design.main_lens.decentre)
        vertex = mp.matrix([*aside, mp.mpf(front) - mp.mpf(element.distance)])
        glass = float(element.material.index(wave))
        point, way = through_plane(point, way, vertex, wedged, index, glass)
        index = medium if passed == len(elements) else 1.0
        point, way = through_plane(point, way, vertex - mp.mpf(element.thickness) * normal, normal, glass, index)
    t = (mp.mpf(front) - mp.mpf(plane) - point[2]) / way[2]
    return np.array([float((point + t * way)[k]) for k in (0, 1)])


CHAINS = {
    "window before the FAP, into water": bench(WINDOW, medium=WATER, **{"main_lens.focal_plane": 400.0}),
    "FAP in water": bench(WINDOW, medium=WATER, fap=125.0, **{"main_lens.focal_plane": 400.0}),
    "leaning plates about a decentred lens": bench(
        LEANING, WINDOW, medium=WATER, **{"main_lens.focal_plane": 400.0, "main_lens.decentre": (0.1, -0.3)}
    ),
}


@pytest.mark.parametrize("name", CHAINS)
def test_rays_are_those_of_every_surface_and_face(name):
    design = CHAINS[name]
    camera = camera_of(design)
    with mp.workdps(40):
        for c in ((0.0, 0.0), (6.0, -2.0), (-9.0, 5.0)):
            p = sensor_of_pupil(camera, c, camera.fap.centre + np.array([0.7, -0.9])).sensor
            seen = views(camera, c, p)
            assert seen.state == RayFate.KEPT
            truth = by_hand(design, p, c, design.d_3)
            assert_allclose(seen.pupil, truth, rtol=0, atol=1e-11)
            for z in (design.d_f, design.d_f + 150.0):
                # 1e-16 of the slope counts some 500 mm away.
                assert_allclose(seen.at(z - design.d_3), by_hand(design, p, c, z), rtol=0, atol=1e-11)


@pytest.mark.parametrize("elements", [(WINDOW,), (LEANING, ROD), (GROUP, WINDOW), (RELAY,)], ids=str)
@pytest.mark.parametrize("fap", [40.0, 115.0, 125.0])
def test_light_from_points_of_the_scene_goes_the_same_way_back(elements, fap):
    """Forward rays aimed at points that backward rays came from: same slope on the FAP, same place on the array."""
    design = bench(*elements, fap=fap, **{"main_lens.focal_plane": 190.0})
    camera = camera_of(design)
    c = np.array([[0.0, 0.0], [3.0, 1.0], [-2.0, 4.0]])
    pupil = camera.fap.centre + np.array([[0.0, 0.0], [1.2, 0.3], [-0.5, 1.0]])
    found = sensor_of_pupil(camera, c, pupil)
    assert found.ok.all()
    point = found.views.at(camera.fap.z - camera.focal_plane)
    there = np.stack([point[:, 0], point[:, 1], np.full(3, camera.focal_plane)])
    slopes, comes = camera.aimed(camera.fap.lifted(pupil), there, design.wavelength)
    assert comes.all()
    lens = camera.train(design.wavelength).lens
    back = lens.through(
        tuple(pupil.T), tuple(slopes), start=camera.fap.z, end=camera.array.z, backward=False, clip=True
    )
    assert np.all(back.state == RayFate.KEPT)
    assert_allclose(back.height.T, c, rtol=0, atol=1e-9)  # aimed to 1e-11 mm and farther spread by the lens


def test_a_plate_of_index_1_changes_nothing():
    fields = [(0.0, 0.0), (6.0, 2.0), (9.0, 0.0)]
    for fap in (115.0, 125.0):
        one, other = (real_field(bench(*elements, fap=fap), fields) for elements in ((), (AIR,)))
        for a, b in zip((*one.images, *one.maps), (*other.images, *other.maps), strict=True):
            # Points are aimed at to 1e-11 mm; foci come from pencils of a thousandth of the FAP.
            assert_allclose(a, b, rtol=0, atol=1e-7)
        assert_allclose(one.images.outline, other.images.outline, rtol=0, atol=1e-11)
        assert_allclose(*(measured_bound(bench(*e, fap=fap)) for e in ((), (AIR,))), rtol=1e-9)


def test_a_window_moved_between_two_stops_changes_nothing():
    """In air a plane-parallel window shifts a ray by as much wherever it stands."""
    stops = [{"diameter": 30.0, "distance": 40.0}]
    near, far = (bench({**WINDOW, "distance": z, "diameter": 60.0}, stops=stops) for z in (60.0, 100.0))
    one, other = (real_field(design, [(2.0, 1.0), (9.0, 0.0)]) for design in (near, far))
    for a, b in zip((*one.images, *one.maps), (*other.images, *other.maps), strict=True):
        assert_allclose(a, b, rtol=0, atol=1e-9)


def test_stops_beside_a_window_bend_nothing_and_take_what_lies_outside_them():
    """One on either side of the FAP and of glass of index 1, through which a ray is straight on."""
    stops = [{"diameter": 12.0, "distance": 40.0}, {"diameter": 20.0, "distance": 200.0}]
    alone, stopped = (camera_of(bench(AIR, stops=given)) for given in ([], stops))
    c = np.array([[3.0, 0.0], [8.0, 4.0], [0.0, -6.0]])
    p = sensor_of_pupil(alone, c, alone.fap.centre).sensor + np.array([0.01, 0.02])
    free, at = (views(camera, c, p, clip=False) for camera in (alone, stopped))
    for bare, beside in zip((free.pupil, free.place, free.slope), (at.pupil, at.place, at.slope), strict=True):
        assert_allclose(beside, bare, rtol=0, atol=1e-13)  # planes on the way cost roundings of some 10 mm
    room = free.margin
    for stop in stops:
        off = np.hypot(*free.at(stop["distance"] - 115.0).T) / (stop["diameter"] / 2)
        room = np.minimum(room, 1 - off**2)
    assert_allclose(at.margin, room, rtol=0, atol=1e-12)
    assert 0 < (room < 0).sum() < len(room)


@pytest.mark.parametrize(
    "elements",
    [(WINDOW,), (RELAY,), (ROD,), (GROUP,), (ROD, {**RELAY, "distance": 100.0, "focal_length": 900.0})],
    ids=str,
)
@pytest.mark.parametrize("fap", [40.0, 115.0])
def test_near_the_axis_images_are_the_closed_forms(elements, fap):
    """Chief rays through microlenses ever nearer the axis lie where the thin-lens model's do, to the angle's cube."""
    focus = 140.0 if elements[0] is GROUP else 250.0
    design = bench(*elements, fap=fap, lens="AC508-100-A", **{"main_lens.focal_plane": focus})
    camera, twin = camera_of(design), Camera.of(design)
    off = []
    for size in (0.4, 0.2):
        c = size * np.array([[1.0, 0.0], [0.6, -0.8]])
        moved = []
        for sign in (1, -1):  # a decentred or leaning part adds what is even in the field
            real = sensor_of_pupil(camera, sign * c, np.broadcast_to(camera.fap.centre, c.shape)).sensor
            ideal = np.stack(twin.chief_point(*(sign * c.T)), axis=-1)
            moved.append(real - ideal)
        off.append(np.max(np.abs(moved[0] - moved[1])))
    assert off[0] < 1e-5
    assert off[1] < 0.2 * off[0] + 1e-12


def test_glass_about_the_array_is_air_of_reduced_length():
    plain = bench(fap=115.0)
    glazed = plain.replace(
        {
            "sensor.cover": {"thickness": 0.4, "material": {"index": 1.5}},
            "microlens_array.substrate": {"thickness": 1.2, "material": {"index": 1.6}, "lenslets": "sensor"},
        }
    )
    index = [
        float(part.material.index(plain.wavelength)) for part in (glazed.sensor.cover, glazed.microlens_array.substrate)
    ]
    reduced = {"d_1": plain.d_1 - 1.2 * (1 - 1 / index[1]), "d_2": plain.d_2 - 0.4 * (1 - 1 / index[0])}
    glazed, air = glazed.replace(d_1=plain.d_1), plain.replace(**reduced)
    one, other = (real_field(design, [(0.0, 0.0), (8.0, 3.0)]) for design in (glazed, air))
    for a, b in zip((*one.images, *one.maps), (*other.images, *other.maps), strict=True):
        assert_allclose(a, b, rtol=0, atol=1e-9)


def test_what_stands_before_the_lens_clips_and_is_named():
    narrow = bench({**WINDOW, "diameter": 3.2}, fap=115.0)
    images = real_field(narrow, [(0.0, 0.0), (9.0, 0.0), (11.0, 0.0)]).images
    assert images.status[0] == ImageFate.FULL
    assert np.all(images.kept_fraction[1:] < 1)
    camera = camera_of(narrow)
    c = np.array([11.0, 0.0])
    p = sensor_of_pupil(camera, c, camera.fap.centre - [1.4, 0.0]).sensor
    assert camera.describe(int(views(camera, c, p).state)) == "clipped at plate 1, back"


def test_evaluate_says_what_a_real_lens_behind_a_window_does():
    found = evaluate(bench({**WINDOW, "diameter": 3.2}, medium=WATER, **{"main_lens.focal_plane": 400.0})).to_dict()[
        "real_lens"
    ]
    assert found["undistorted_in_field"] is False
    assert found["fields"][0]["status"] == "full"
    assert abs(found["fields"][0]["distortion_percent"]) < 1e-6


def test_blur_of_a_point_through_a_rod_is_that_of_many_rays():
    """Light of one point of the focal plane, sampled anew: rays through random points of the FAP."""
    design = bench(ROD, fap=60.0, **{"main_lens.focal_plane": 250.0})
    camera = camera_of(design)
    c = np.array([5.0, 2.0])
    maps = field_map(camera, c)
    stream = np.random.default_rng(3)
    r, turn = 1.45 * np.sqrt(stream.uniform(size=4000)), stream.uniform(0, 2 * np.pi, 4000)
    pupil = camera.fap.centre + np.stack([r * np.cos(turn), r * np.sin(turn)], axis=-1)
    point = np.broadcast_to(maps.object_point, pupil.shape)
    slopes, _ = camera.aimed(
        camera.fap.lifted(pupil), np.stack([*point.T, np.full(4000, camera.focal_plane)]), design.wavelength
    )
    lens = camera.train(design.wavelength).lens
    there = lens.through(tuple(pupil.T), tuple(slopes), start=camera.fap.z, end=camera.array.z, backward=False).height
    spread = np.sqrt(np.sum(np.var(there, axis=1)))
    assert maps.blur == pytest.approx(spread, rel=0.03)  # 200 rays against 4000


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"elements": [{**WINDOW, "distance": 0.5}]}, r"elements\.0\.distance: .* inside the lens"),
        ({"elements": [{**WINDOW, "distance": 60.5}, {**WINDOW, "distance": 60.0}]}, r"elements\.1 \(plate 2\); move"),
    ],
)
def test_elements_that_collide_are_told(changes, told):
    with pytest.raises((InputError, DesignError), match=told):
        camera_of(bench(fap=115.0).replace(changes))
