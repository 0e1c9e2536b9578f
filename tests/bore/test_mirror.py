"""Fold mirrors against rays that are really reflected, in real folded space."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import roslf_design as roslf
from roslf_design.calibration.decoding import LightField, _HexagonalRows
from roslf_design.camera import Camera
from roslf_design.cli import main
from roslf_design.design.files import save
from roslf_design.effects import plan
from roslf_design.fates import RayFate, state_at
from roslf_design.imaging.camera import Region
from roslf_design.imaging.trace import RaySampling, Tracer
from roslf_design.reporting.design.instrument import instrument_scene
from roslf_design.scenes import Scene
from roslf_design.theory.chief_rays import chief_rays
from roslf_design.theory.light import object_scale, sensor_field
from roslf_design.theory.object_space import ObjectSpaceFaces
from roslf_design.traced.camera import camera_of, views
from tests.bore.folded import Folded, SphericalLens, area, from_sensor, outline_by_rays, turned_towards
from tests.laws import DEAR

PAPER = roslf.load("paper")
MIRROR = {"kind": "mirror", "distance": 60.0, "angle": math.pi / 4, "azimuth": math.pi / 2, "diameter": 60.0}


def share(low, high):
    return st.floats(low, high, allow_nan=False)


@st.composite
def folded(draw, base=PAPER):
    """Cameras with mirrors, windows and lenses before them, the FAP anywhere between, all a little out of place."""

    def pair(size):
        return draw(share(-size, size)), draw(share(-size, size))

    place, elements, gaps = draw(share(15, 30)), [], [5.0]
    for number in range(draw(st.integers(1, 4))):
        kind = "mirror" if number == 0 else draw(st.sampled_from(("mirror", "plate", "lens")))
        part = {"kind": kind, "distance": place, "decentre": pair(0.5), "tilt": pair(0.03)}
        if kind == "mirror":
            part |= {"angle": draw(share(0.3, 1.4)), "azimuth": draw(share(-math.pi, math.pi))}
            part |= {"diameter": draw(share(8, 40)), "piston": draw(share(-0.4, 0.4))}
        elif kind == "plate":
            thick = draw(share(0.5, 4))
            part |= {"thickness": thick, "material": {"index": draw(share(1.3, 1.9))}, "wedge": pair(0.01)}
            place += thick
        else:
            part |= {"focal_length": draw(share(60, 300)), "tilt": (0.0, 0.0)}
        elements.append(part)
        place += draw(share(12, 25))
        gaps.append(place - 6)
    fap = {
        "diameter": draw(share(2, 9)),
        "distance": draw(st.sampled_from(gaps)),
        "decentre": pair(0.3),
        "tilt": pair(0.02),
    }
    try:
        return base.replace({"elements": elements, "aperture": fap, "main_lens.focal_plane": place + 100.0})
    except roslf.InputError:
        return None


@given(folded(), st.integers(0, 10**6))
def test_rays_in_unfolded_space_are_those_reflected_in_real_space(design, seed):
    if design is None:
        return
    rng = np.random.default_rng(seed)
    points, ways = from_sensor(design, rng.uniform(-6, 6, (200, 2)), rng.uniform(-0.05, 0.05, (200, 2)))
    real = Folded(design)
    points_there, ways_there, took, _ = real.outwards(points, ways)
    places, ways_there = real.unfolded(points_there, ways_there)
    space = ObjectSpaceFaces.of(Camera.of(design))
    out = space.rays((points[:, 0], points[:, 1]), (ways[:, 0] / ways[:, 2], ways[:, 1] / ways[:, 2]))
    names = {state_at(int(place)): name for place, name in zip(space.openings, space.names, strict=True)}
    assert [names.get(int(state), "nobody").split(",")[0] for state in out.status] == [real.name(k) for k in took]
    good = took < 0
    slope = ways_there[good, :2] / ways_there[good, 2:]
    height = places[good, :2] - slope * places[good, 2:]
    assert_allclose(out.slope.T[good], slope, rtol=0, atol=1e-12)
    assert_allclose(out.height.T[good], height, rtol=0, atol=1e-10)


REAL = {
    name: roslf.load("paper-singlet").replace({"main_lens.prescription": name}) for name in ("LA1050-A", "AC254-100-A")
}


@given(st.data(), st.sampled_from(sorted(REAL)), st.booleans(), st.integers(0, 10**6))
@DEAR
def test_rays_of_real_main_lenses_are_those_reflected_in_real_space(data, name, reversed_, seed):
    """Through its surfaces, then past and off all that stands before it: where they go, and who of them gets there."""
    design = data.draw(folded(REAL[name].replace({"main_lens.reversed": reversed_})))
    try:
        camera = None if design is None else camera_of(design)
    except roslf.InputError:  # something stands in the lens
        camera = None
    if camera is None:
        return
    lens = SphericalLens(design.lens, design.wavelength)
    assert_allclose(camera.array.z, lens.rear_principal + design.d_1, rtol=1e-12)
    rng = np.random.default_rng(seed)
    microlens = rng.uniform(-6, 6, (200, 2))
    spots = (microlens - rng.uniform(-8, 8, (200, 2))) * (design.d_2 / design.d_1)  # towards points of the lens
    points = np.column_stack([microlens, np.full(200, lens.rear_principal + design.d_1)])
    points, ways, passed = lens.outwards(points, -np.column_stack([spots / design.d_2, np.ones(200)]))
    real = Folded(design)
    points, ways, took, _ = real.outwards(points - [0.0, 0.0, lens.front_principal], ways)
    points, ways = real.unfolded(points, ways)
    slope = ways[:, :2] / ways[:, 2:]
    met, front = views(camera, microlens, microlens + spots, clip=False), ~real.behind
    assert (met.state == RayFate.KEPT).tolist() == front.tolist()
    assert_allclose(met.slope[front], slope[front], rtol=0, atol=1e-12)
    at_fap = points[:, :2] - slope * (points[:, 2:] + design.aperture.distance)
    assert_allclose(met.place[front], at_fap[front], rtol=0, atol=1e-10)
    kept = views(camera, microlens, microlens + spots).state == RayFate.KEPT
    assert kept.tolist() == (passed & (took < 0) & front).tolist()


SMALL = PAPER.replace({"main_lens.diameter": 30.0, "aperture.distance": 120.0})
"""Few things cut here but the mirror."""


def with_mirror(design=SMALL, other=(), **changes):
    return design.replace({"elements": (MIRROR | changes, *other)})


def kept_by_rays(design, microlens):
    """Share of the FAP's image behind a microlens that light reaches, by the rim of both as rays find it."""
    lit = outline_by_rays(design, microlens)
    return 0.0 if lit is None else area(lit) / area(outline_by_rays(design, microlens, only_fap=True))


@pytest.mark.parametrize(("angle", "azimuth"), [(20.0, 90.0), (45.0, 200.0), (70.0, 0.0)])
def test_what_a_mirror_cuts_against_rays(angle, azimuth):
    """An ellipse along the axis whose ends lie nearer to and farther from the lens: exact in air."""
    design = with_mirror(
        angle=math.radians(angle), azimuth=math.radians(azimuth), diameter=7.0 / math.sin(math.radians(angle)),
        decentre=(0.6, -0.4),
    )  # fmt: skip
    fields = [(0.0, 0.0), (4.0, 0.0), (-3.0, -4.0), (0.0, 5.0), (-5.0, 0.0), (-7.0, 0.5), (2.0, 2.0)]
    images = roslf.evaluate(design, fields).fields
    for (x, y), image in zip(fields, images, strict=True):
        assert_allclose(image.kept_fraction, kept_by_rays(design, (x, y)), rtol=0, atol=2e-5)
    assert any(0 < image.kept_fraction < 0.9 for image in images)


@pytest.mark.parametrize(
    ("angle", "diameter", "decentre"), [(20.0, 30.0, (0.0, 0.0)), (45.0, 12.0, (1.0, 0.5)), (80.0, 12.0, (0.0, 0.0))]
)
def test_the_undistorted_field_and_the_room_against_rays_of_the_pencils_rim(angle, diameter, decentre):
    design = with_mirror(angle=math.radians(angle), diameter=diameter, decentre=decentre, azimuth=0.7)
    bound = roslf.evaluate(design).non_distortion
    real, turn = Folded(design), np.linspace(0, 2 * math.pi, 361)

    def farthest(radius, towards=turn):
        """Of rays from the focal plane through the FAP's rim, from the middle of the mirror."""
        ways = np.stack(np.meshgrid(towards, turn), -1).reshape(-1, 2)
        point = radius * np.stack([np.cos(ways[:, 0]), np.sin(ways[:, 0])], -1)
        pupil = design.D_F / 2 * np.stack([np.cos(ways[:, 1]), np.sin(ways[:, 1])], -1)
        slope = (pupil - point) / (design.d_f - design.aperture.distance)
        height = point + slope * design.d_f
        mirror = real.parts[0]
        start = np.column_stack([height, np.zeros(len(height))])
        end = real.outwards(start, -np.column_stack([slope, np.ones(len(slope))]))[3][0]
        return np.linalg.norm(end - mirror["centre"], axis=-1).max()

    assert bound.limited_by == "mirror 1"
    assert_allclose(farthest(bound.x0_max_mm), diameter / 2, rtol=0, atol=1e-3)
    camera = Camera.of(design)
    x, y = sensor_field(camera).corners.T
    half = float(object_scale(camera) * sensor_field(camera).half_diagonal)  # of all that the sensor sees, lit or not
    rooms = diameter / 2 - farthest(half, np.arctan2(y, x))
    assert_allclose(bound.room_at_corner_mm, rooms, rtol=0, atol=1e-3)


def chief_ray(design, microlens):
    """The ray through a microlens's middle and the FAP's, by Newton's method: where on the sensor, unfolded outside."""
    real = Folded(design)
    fap = next(k for k, part in enumerate(real.parts) if part["part"] is design.aperture)

    def miss(spots):
        points, ways = from_sensor(design, np.broadcast_to(microlens, spots.shape), spots)
        points, ways, _, where = real.outwards(points, ways)
        return where[fap] - real.parts[fap]["centre"], real.unfolded(points, ways)

    spot, step = np.zeros(2), 1e-5
    for _ in range(8):
        near = spot + step * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
        off, _ = miss(near)
        slopes = np.stack([(off[1] - off[2]) / (2 * step), (off[3] - off[4]) / (2 * step)], -1)
        spot = spot - np.linalg.lstsq(slopes, off[0], rcond=None)[0]
    points, ways = miss(spot[None])[1]
    return spot, points[0], ways[0]


PLATE = {"kind": "plate", "distance": 130.0, "thickness": 3.0, "material": {"index": 1.5}}
TWO = (MIRROR | {"distance": 95.0, "angle": 0.5, "azimuth": 0.3}, PLATE)
POSES = {
    "tilt across": {"tilt": (1e-3, 0.0)},
    "tilt along": {"tilt": (0.0, 1e-3)},
    "piston": {"piston": 0.05},
    "all": {"tilt": (-2e-3, 1e-3), "piston": -0.1, "decentre": (1.0, 2.0)},
}


@pytest.mark.parametrize("pose", POSES.values(), ids=POSES)
@pytest.mark.parametrize("other", [(), TWO], ids=["one", "two and a plate"])
def test_a_mirror_out_of_place_against_chief_rays_in_real_space(pose, other):
    """Where images lie on the sensor and where their chief rays go: traced to rounding, closed forms to first order."""
    design = with_mirror(other=other, **pose)
    camera, straight = Camera.of(design), Camera.of(with_mirror(other=other))
    size = max(abs(x) for x in (*pose.get("tilt", (0,)), pose.get("piston", 0) / 60))
    for microlens in [(0.0, 0.0), (5.0, 0.0), (-3.0, 6.0)]:
        spot, point, way = chief_ray(design, microlens)
        rays = chief_rays(camera, microlens)
        slope = way[:2] / way[2]
        assert_allclose(rays.slope, slope, rtol=0, atol=1e-10)
        assert_allclose(rays.height, point[:2] - slope * point[2], rtol=0, atol=1e-8)
        told = np.array(camera.chief_point(*microlens)) - np.array(straight.chief_point(*microlens))
        true = spot - chief_ray(with_mirror(other=other), microlens)[0]
        assert_allclose(told, true, rtol=0, atol=2 * design.d_2 * (size**2 + 0.02 * size))
        assert np.hypot(*true) > 20 * np.hypot(*(told - true)) or np.hypot(*true) < 1e-5


@pytest.mark.parametrize("angle", [30.0, 45.0, 60.0])
@pytest.mark.parametrize("turned", [0, 1])
def test_a_tilt_turns_the_view_by_twice_as_much_and_a_piston_shifts_the_plane_in_focus(angle, turned):
    """About the line across the plane of the fold by 2 t, about that in both planes by 2 t sin(angle)."""
    base = with_mirror(SMALL.replace({"aperture.distance": 20.0}), angle=math.radians(angle))
    fold = math.radians(angle)
    tilt, camera = 1e-4, Camera.of(base)
    moved = camera.replace({f"elements.0.tilt.{turned}": tilt, "elements.0.piston": 0.2})
    slopes = np.array(chief_rays(moved, (0.0, 0.0)).slope) - np.array(chief_rays(camera, (0.0, 0.0)).slope)
    assert_allclose(np.hypot(*slopes), 2 * tilt * (math.sin(fold) if turned else 1), rtol=1e-6)
    view = roslf.quantity("direction_of_view_deg")
    if not turned:  # a larger angle between axis and surface
        assert_allclose(view(moved), 2 * angle + math.degrees(2 * tilt), rtol=1e-9)
    assert_allclose(view(camera), 2 * angle, rtol=1e-12)
    shifted = with_mirror(angle=fold, piston=0.2)
    real = Folded(shifted)
    points, ways = from_sensor(shifted, np.zeros((2, 2)), np.array([[0.0, 0.0], [0.02, 0.0]]))
    (a, b), (u, v) = real.unfolded(*real.outwards(points, ways)[:2])
    along = np.linalg.lstsq(np.stack([u, -v], -1), b - a, rcond=None)[0]  # where both cross
    assert_allclose(b + along[1] * v, a + along[0] * u, rtol=0, atol=1e-9)
    pushed = Camera.of(with_mirror(angle=fold)).replace({"elements.0.piston": 0.2})
    assert_allclose(pushed["main_lens.focal_plane"], -(a + along[0] * u)[2], rtol=1e-12)


@pytest.mark.parametrize("azimuths", [(90.0,), (0.0, 90.0), (30.0, 200.0), (0.0, 90.0, 45.0)])
def test_the_direction_of_view_against_where_rays_really_go(azimuths):
    """Any number of mirrors, each its own way, with sensor and view's middle off the axis."""
    mirrors = [
        MIRROR
        | {"distance": 15.0 + 30 * k, "angle": 0.4 + 0.2 * k, "azimuth": math.radians(azimuth)}
        | {"tilt": (0.01, 0.02), "diameter": 20.0}
        for k, azimuth in enumerate(azimuths)
    ]
    design = PAPER.replace({"elements": mirrors, "sensor.decentre": (1.0, -3.0), "aperture.distance": 120.0})
    (x0, y0), (x1, y1) = sensor_field(Camera.of(design))
    spot = chief_ray(design, ((x0 + x1) / 2, (y0 + y1) / 2))[0]
    points, ways = from_sensor(design, np.array([[(x0 + x1) / 2, (y0 + y1) / 2]]), spot[None])
    way = Folded(design).outwards(points, ways)[1][0]
    true = math.degrees(math.acos(-way[2]))
    assert_allclose(roslf.quantity("direction_of_view_deg")(Camera.of(design)), true, rtol=0, atol=1e-8)
    turned = Folded(design).unfolded(np.zeros((1, 3)), np.eye(3))[1]  # real axes, unfolded
    assert_allclose(Camera.of(design).chain.fold @ turned.T, np.eye(3), rtol=0, atol=1e-12)


@pytest.mark.parametrize("azimuth", [90.0, 0.0, 30.0])
def test_points_of_the_scene_are_given_in_axes_that_turn_with_the_view(azimuth):
    """Those axes are right-handed as those of the camera, so that its pictures show the scene reversed."""
    turn, towards = 2 * math.radians(35), math.radians(azimuth)
    design = with_mirror(angle=turn / 2, azimuth=towards)
    points = np.array([[3.0, 1.0, 300.0], [-2.0, 5.0, 200.0], [0.0, 0.0, 150.0]])
    # z towards the sensor; turning the view towards the azimuth turns that axis away from it
    axes = turned_towards(-turn, towards)
    vertex = np.array([0.0, 0.0, -60.0])
    real = vertex + (points * [1, 1, -1] - vertex) @ axes.T
    unfolded = Folded(design).unfolded(real, np.eye(3))[0]
    assert_allclose(Camera.of(design).chain.unfolded(points.tolist()), unfolded * [1, 1, -1], rtol=0, atol=1e-10)


def rendered(design, centre):
    thing = {"kind": "plane", "distance": 350.0, "centre": centre, "size": (2.0, 1.0), "texture": {"kind": "uniform"}}
    scene = Scene.model_validate({"objects": [thing]})
    lines = plan(design, scene, overrides=["-microlens_diffraction", "-fap_diffraction", "-plate_aberration"])
    return Tracer.of(design, lines, scene).image(Region(2240, 1480, 120, 120), RaySampling(64, 64, 0.0, 1))[0]


def test_pictures_show_the_scene_reversed_behind_one_mirror_and_not_behind_two():
    straight = rendered(SMALL, (0.5, -1.0))
    assert straight.std() > 0.2
    for azimuths, centre in (((90.0,), (0.5, 1.0)), ((0.0,), (-0.5, -1.0)), ((90.0, 0.0), (0.5, -1.0))):
        mirrors = [
            MIRROR | {"distance": 20.0 + 30 * k, "azimuth": math.radians(azimuth), "diameter": 75.0}
            for k, azimuth in enumerate(azimuths)
        ]
        picture = rendered(SMALL.replace({"elements": mirrors}), centre)
        assert np.abs(picture - straight).mean() < 1e-3


def test_prisms_reverse_pictures_where_they_reflect_an_odd_number_of_times():
    prism = {"kind": "prism", "distance": 50.0, "thickness": 10.0, "material": {"index": 1.5}, "deviation": math.pi / 2}
    for count in range(4):
        camera = Camera.of(SMALL.replace({"elements": [prism | {"reflections": count}]}))
        assert camera.chain.mirrored.tolist() == pytest.approx([float(count % 2), 0.0])
        assert np.linalg.det(camera.chain.fold) == pytest.approx((-1) ** count)


@pytest.mark.parametrize("layout", ["square", "hexagonal"])
@pytest.mark.parametrize("along", [0, 1])
def test_a_light_field_turned_over_shows_every_point_reversed_at_the_same_slope(layout, along):
    """A point's light lies along u = u_0 + slope s: at -u_0 with that slope afterwards."""
    rng = np.random.default_rng(3)
    shape, rows = (3, 5, 4, 7), None
    values, weight = (rng.uniform(0.5, 1, shape).astype(np.float32) for _ in range(2))
    if layout == "hexagonal":
        rows = _HexagonalRows(values, weight, np.array([-3.0, -2.5, -3.0, -2.5]))
    axes = (np.arange(-2.0, 3), np.arange(-1.0, 2), np.arange(-3.0, 4), np.arange(-1.0, 3))
    field = LightField(values, weight, *axes, 13.0, rows)
    turned = field.turned_over(along)
    signs = (-1, 1) if along == 0 else (1, -1)
    for t, s, v, u in np.ndindex(*shape):
        at = [np.flatnonzero(axis == sign * here)[0] for axis, sign, here in (
            (turned.t, signs[1], field.t[t]), (turned.s, signs[0], field.s[s]),
            (turned.v, signs[1], field.v[v]), (turned.u, signs[0], field.u[u]),
        )]  # fmt: skip
        assert turned.values[tuple(at)] == values[t, s, v, u]
        if rows is not None and turned.hexagonal is not None:
            k = 6 - u if along == 0 else u
            assert turned.hexagonal.values[at[0], at[1], at[2], k] == values[t, s, v, u]
            assert turned.hexagonal.starts[at[2]] + k == signs[0] * (rows.starts[v] + u)


def vertices_in_space(text):
    """Where a .zmx file's surfaces stand: coordinate breaks turn the axes, thicknesses go along z."""
    axes, at, places = np.eye(3), np.zeros(3), {}
    for surface in text.split("SURF ")[1:]:
        words = {line.split()[0]: line.split()[1:] for line in surface.splitlines()[1:]}
        if words["TYPE"] == ["COORDBRK"]:
            parameter, degrees = words["PARM"]
            c, s = math.cos(math.radians(float(degrees))), math.sin(math.radians(float(degrees)))
            about_x, about_z = [[1, 0, 0], [0, c, -s], [0, s, c]], [[c, -s, 0], [s, c, 0], [0, 0, 1]]
            axes = axes @ np.array({"3": about_x, "5": about_z}[parameter])
        else:
            places[" ".join(words["COMM"])] = at
        at = at + float(words["DISZ"][0]) * axes[:, 2] if words["DISZ"][0] != "INFINITY" else at
    return places


def test_an_exported_file_stands_where_the_instrument_really_does(tmp_path, capsys):
    """All distances between surfaces in space; which way round chirality goes they do not tell."""
    far = {"kind": "mirror", "distance": 100.0, "angle": 0.5, "azimuth": 2.0, "diameter": 60.0}
    design = with_mirror(
        SMALL.replace({"aperture.distance": 140.0}), other=(far, PLATE | {"distance": 150.0}), azimuth=0.4
    )
    save(design, tmp_path / "folded.toml")
    assert main(["export", str(tmp_path / "folded.toml"), "-o", str(tmp_path / "folded.zmx")]) == 0
    places = vertices_in_space((tmp_path / "folded.zmx").read_text())
    real = Folded(design)
    true = {"main lens": np.zeros(3), "sensor": np.array([0.0, 0.0, design.d_1 + design.d_2])}
    true |= dict(zip(["mirror 1", "mirror 2", "FAP", "plate 3, back", "plate 3, front"],
                     [part["centre"] for part in real.parts], strict=True))  # fmt: skip
    for one, other in itertools.combinations(true, 2):
        apart = np.linalg.norm(places[one] - places[other])
        assert_allclose(apart, np.linalg.norm(true[one] - true[other]), rtol=0, atol=1e-9)
    assert main(["export", str(tmp_path / "folded.toml"), "-o", str(tmp_path / "folded.json")]) == 2
    assert "write a .zmx file" in capsys.readouterr().err


BAD = {
    "along the axis": ({"angle": 0.0}, "elements.0.angle: 0 deg is no fold"),
    "straight back": ({"angle": math.pi / 2}, "elements.0.angle: 90 deg is no fold"),
    "without a size": ({"diameter": None}, "elements.0.diameter"),
}


@pytest.mark.parametrize(("changes", "told"), BAD.values(), ids=BAD)
def test_what_is_no_mirror_is_told(changes, told):
    with pytest.raises(roslf.InputError, match=told):
        with_mirror(**changes)


def test_parts_that_stand_in_each_other_where_the_axis_is_folded_are_told():
    window = {"kind": "plate", "thickness": 2.0, "material": {"index": 1.5}}
    with pytest.raises(
        roslf.InputError, match=r"stands in elements\.1, as the axis is folded"
    ):  # the mirror's own edge
        with_mirror(other=[window | {"distance": 75.0, "diameter": 40.0}])
    with_mirror(other=[window | {"distance": 82.0, "diameter": 40.0}])
    # turned by 160 degrees the light comes back beside the main lens
    back = {"angle": math.radians(80), "diameter": 20.0}
    with pytest.raises(roslf.InputError, match=r"main_lens: it stands in elements\.1"):
        with_mirror(other=[window | {"distance": 120.0, "diameter": 20.0}], **back)
    with_mirror(other=[window | {"distance": 120.0, "diameter": 8.0}], **back)
    water = {"object_space.medium": "water"}
    with pytest.raises(roslf.InputError, match=r"nothing keeps water off elements.0 \(mirror\)"):
        with_mirror().replace(water)


def test_the_instrument_is_drawn_where_it_really_stands():
    """Rims, and rays up to the window, as reflected in real space; along the unfolded axis where that is asked for."""
    window = PLATE | {"distance": 110.0, "diameter": 30.0}
    design = with_mirror(SMALL.replace({"aperture.distance": 20.0}), other=(window,), azimuth=0.7)
    bodies = {body.name: body for body in instrument_scene(design).parts}
    straight = {body.name: body for body in instrument_scene(design, fold=False).parts}
    real = Folded(design)
    for name, part in (("mirror 1 rim", real.parts[1]), ("plate 2 rim", real.parts[2])):
        points = bodies[name].points
        assert_allclose(np.linalg.norm(points - part["centre"], axis=-1), part["radius"], rtol=1e-12)
        assert_allclose((points - part["centre"]) @ part["normal"], 0, atol=1e-9)
    assert_allclose(straight["plate 2 rim"].points[:, 2], -110.0)
    rays = bodies["rays centre"].points
    for number in (1, 2):  # some corners of the drawn rays lie on each
        height = np.abs((rays - real.parts[number]["centre"]) @ real.parts[number]["normal"])
        assert (height < 1e-9).sum() >= 16
