"""What stands before the main lens, against rays through every face in mpmath; limits, laws, hard cases, bad input."""

import json
import math
import re

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.design import DesignError, dumps, loads
from roslf_design.design.sequence import sequence_of
from roslf_design.reporting.design.rays import dimensions
from roslf_design.theory.quantities import QUANTITIES, quantity_named
from roslf_design.theory.stop_images import MicrolensImages
from roslf_design.tolerancing.places import short_name
from tests.oracles.object_space import object_side

PAPER = roslf.load("paper").replace({"aperture.distance": 117.0})
WATER = {"index": 1.333, "abbe": 55.8}
PLATE = {"kind": "plate", "distance": 118.0, "thickness": 1.0, "material": {"index": 1.5}, "diameter": 8.0}


def share(low, high):
    return st.floats(low, high, allow_nan=False)


@st.composite
def looking_through(draw):
    """Cameras with up to four elements, the FAP and a stop anywhere between, air or liquid before them."""
    place, elements, gaps = draw(share(5, 20)), [], []
    for _ in range(draw(st.integers(1, 4))):
        gaps.append(place)
        if draw(st.booleans()):
            thick, index = draw(share(0.2, 8)), draw(share(1.3, 1.9))
            elements.append({"kind": "plate", "distance": place, "thickness": thick, "material": {"index": index}})
            place += thick
        else:
            focal = draw(share(30, 300)) * draw(st.sampled_from((-1, 1)))
            aside = draw(share(-0.3, 0.3))
            elements.append({"kind": "lens", "distance": place, "focal_length": focal, "decentre": (aside, 0.0)})
        place += draw(share(1, 20))
    d_3, stop = (draw(st.sampled_from([*gaps, place])) - draw(share(0.1, 0.9)) for _ in range(2))
    medium = draw(share(1.0, 1.6))
    design = PAPER.replace({"aperture.distance": 2.0})
    try:
        return design.replace(
            {
                "elements": elements,
                "object_space.medium": {"index": medium},
                "stops": (
                    {"diameter": draw(share(2, 9)), "distance": stop, "decentre": (draw(share(-0.5, 0.5)), 0.0)},
                ),
                "aperture.distance": d_3,
                "main_lens.focal_plane": place + draw(share(5, 400)),
            }
        )
    except DesignError:
        return None


def traced(design, heights_and_slopes, planes, exact=False):
    elements = []
    for element in sorted(design.elements, key=lambda e: e.distance):
        if element.kind == "plate":
            elements.append(("plate", element.distance, element.thickness, element.material.index(design.wavelength)))
        else:
            elements.append(("lens", element.distance, element.focal_length, element.decentre[0]))
    medium = float(design.object_space.medium.index(design.wavelength))
    return [object_side(x, o, elements, medium, planes, exact) for x, o in heights_and_slopes]


def discs_end_at_rims(design):
    """The ray through a microlens's middle that ends on the sensor at a disc's rim meets the stop's rim."""
    camera = Camera.of(design)
    c = 3.0
    images = MicrolensImages(camera, [(c, 0.0)])
    centres, radii = (part[0, 0] for part in (images.openings.centres, images.openings.radii))
    with mp.workdps(40):
        for stop, centre, radius in zip((design.aperture, None, *design.stops), centres, radii, strict=True):
            if stop is None or not np.isfinite(radius) or radius > 1e3:
                continue
            ends = []
            for sign in (-1, 1):
                s = (mp.mpf(centre[0]) + sign * mp.mpf(radius)) / mp.mpf(design.d_2)
                height = c - s * mp.mpf(design.d_1)
                ends.append((height, s + height / mp.mpf(design.f)))
            met = sorted(float(heights[0]) for heights in traced(design, ends, [stop.distance]))
            rim = [stop.decentre[0] - stop.diameter / 2, stop.decentre[0] + stop.diameter / 2]
            # How far an error of the sensor's last digit throws the ray on the stop's plane.
            thrown = stop.diameter / 2 / radius * (abs(centre[0]) + radius)
            assert_allclose(met, rim, rtol=0, atol=1e-11 * (1 + thrown))


@given(looking_through())
def test_discs_of_stops_against_rays_through_every_face(design):
    if design is not None:
        discs_end_at_rims(design)


RELAY = {"kind": "lens", "distance": 400.0, "focal_length": 30.0}
IMAGE_OF_THE_PLANE, FOCUS, IMAGE_OF_THE_LENS = 310.0, 430.0, 400.0 + 1 / (1 / 30 - 1 / 400)
"""Behind and before the relay: where it images a plane at 445 mm; where A = 0; where B = 0."""


def relayed(fap, stop, radius=4.5, **changes):
    design = {"elements": [RELAY], "aperture.distance": fap, "main_lens.focal_plane": 445.0}
    stops = [{"diameter": 2 * radius, "distance": stop}]
    return PAPER.replace({**design, "microlens_array.distance": None, "stops": stops, **changes})


@pytest.mark.parametrize("off", [0.0, 1e-12, 1e-6, -1e-3])
@pytest.mark.parametrize(("one", "other"), [(FOCUS, IMAGE_OF_THE_LENS), (IMAGE_OF_THE_LENS, FOCUS), (FOCUS, FOCUS)])
def test_stops_at_a_relays_foci_against_rays(one, other, off):
    """A -> 0, seen at infinity, and B -> 0, seen on the main lens: discs end where rays say, on and beside."""
    design = relayed(one + off, other + off)
    discs_end_at_rims(design)
    told = json.dumps(roslf.evaluate(design, [(0.0, 0.0), (2.0, 0.0)]).to_dict())
    assert "NaN" not in told
    assert "Infinity" not in told


@pytest.mark.parametrize("tilt", [0.0, 0.01])
@pytest.mark.parametrize("off", [0.0, 1e-9, -1e-5])
def test_a_stop_in_the_image_of_the_focal_plane_passes_all_of_a_microlens_or_nothing(off, tilt):
    """A field stop where the relay images the plane in focus, against where the rays of microlenses cross it."""
    stop = {"diameter": 9.0, "distance": IMAGE_OF_THE_PLANE + off, "tilt": (tilt, 0.0)}
    design = relayed(395.0, 310.0, **{"stops": [stop], "main_lens.diameter": 300.0})
    camera = Camera.of(design)
    places = np.array([0.0, 1.0, 2.0, 2.1, 2.2, 4.0])
    with mp.workdps(40):
        met = []
        for c in places:
            slope = mp.mpf("0.01")
            height = mp.mpf(c) - slope * mp.mpf(design.d_1)
            met.append(abs(traced(design, [(height, slope + height / mp.mpf(design.f))], [stop["distance"]])[0][0]))
    kept = MicrolensImages(camera, np.stack([places, 0 * places], -1)).shapes.kept_fraction[:, 0]
    assert_allclose(kept, [float(at <= 4.5) for at in met], rtol=0, atol=1e-12)
    fields = roslf.evaluate(design, [(0.0, 0.0), (4.0, 0.0)]).fields
    assert [field.status for field in fields] == ["full", "dark"]
    assert dict(fields[1].ray_budget.taken())["stop 1"] == 1.0


def test_an_object_on_the_windows_face_is_the_limit_of_objects_in_front_of_it():
    """In liquid: depth, scale and reach go on to the face itself, and the plane is seen where rays say."""
    base = {
        "elements": [PLATE],
        "object_space.medium": WATER,
        "microlens_array.distance": None,
        "aperture.distance": 100.0,
    }
    on, near = (PAPER.replace({**base, "main_lens.focal_plane": 119.0 + off}) for off in (0.0, 1e-9))
    here, there = Camera.of(on), Camera.of(near)
    with mp.workdps(40):
        ((seen,),) = traced(on, [(0, 1)], [119.0])
    assert float(here.seen.d_f) == pytest.approx(-float(seen), rel=1e-15)
    for name in ("sigma_z_mm", "object_sample_mm", "field_half_width_mm", "fill_factor", "field_half_angle_deg"):
        value = float(quantity_named(name)(here))
        assert math.isfinite(value), name
        assert value == pytest.approx(float(quantity_named(name)(there)), rel=1e-8), name
    told = roslf.evaluate(on).to_dict()
    assert "NaN" not in json.dumps(told)
    assert math.isfinite(float(QUANTITIES["field_half_width_mm"](here, 0.0)))


@given(looking_through())
def test_the_focal_plane_is_where_rays_of_one_microlens_meet(design):
    if design is None:
        return
    camera = Camera.of(design)
    with mp.workdps(40):
        c, ends = mp.mpf(2), []
        for s in (mp.mpf("-0.02"), mp.mpf("0.013")):
            height = c - s * mp.mpf(design.d_1)
            ends.append((height, s + height / mp.mpf(design.f)))
        (one,), (other,) = traced(design, ends, [design.d_f])
        reach = max(abs(one), abs(other), 1)
        assert abs(one - other) < 1e-9 * reach
        # On the axis's side of it, as far from where the axis meets it as the object scale says.
        ((axis,),) = traced(design, [(0, 0)], [design.d_f])
        assert abs(abs(one - axis) - 2 * float(QUANTITIES["object_sample_mm"](camera)) / design.d) < 1e-8 * reach


def test_exact_rays_near_the_axis_are_the_paraxial_ones():
    """By Snell's law, ever nearer the axis: the paraxial planes are the limit, and it is met like the angle squared."""
    design = PAPER.replace({"elements": [PLATE], "object_space.medium": WATER})
    with mp.workdps(40):
        off = []
        for slope in (mp.mpf("1e-4"), mp.mpf("1e-6")):
            (exact,), (paraxial,) = (traced(design, [(0, slope)], [design.d_f], kind)[0:1] for kind in (True, False))
            off.append(abs(exact[0] / paraxial[0] - 1))
    assert off[1] < 1e-12
    assert off[0] / off[1] == pytest.approx(1e4, rel=1e-3)


@pytest.mark.parametrize("change", [{"thickness": 1e-12}, {"material": {"index": 1.0}}])
def test_a_plate_that_is_nothing_changes_nothing(change):
    bare = roslf.evaluate(PAPER.replace({"main_lens.focal_plane": 350.0}))
    plate = PAPER.replace({"elements": [{**PLATE, **change, "diameter": 50.0}], "main_lens.focal_plane": 350.0})
    seen = roslf.evaluate(plate)
    for name in ("f_number", "non_distortion", "microlens_image", "sampling", "depth"):
        for key, value in vars(getattr(bare, name)).items():
            if isinstance(value, float):
                assert getattr(getattr(seen, name), key) == pytest.approx(value, rel=1e-10), (name, key)


def test_a_window_moved_between_two_stops_changes_nothing():
    """Nothing but where its own faces cut."""
    stops = ({"diameter": 6.0, "distance": 60.0},)
    here, there = (
        PAPER.replace(
            {"elements": [{**PLATE, "distance": z, "diameter": None}], "stops": stops, "main_lens.focal_plane": 300.0}
        )
        for z in (70.0, 110.0)
    )
    a, b = (roslf.evaluate(design).to_dict() for design in (here, there))
    assert a.pop("design") == b.pop("design")
    a.pop("object_space"), b.pop("object_space")  # where things stand

    def close(x, y, place):
        if isinstance(x, dict):
            assert x.keys() == y.keys()
            for key in x:
                close(x[key], y[key], f"{place}.{key}")
        elif isinstance(x, list):
            for k, (u, v) in enumerate(zip(x, y, strict=True)):
                close(u, v, f"{place}.{k}")
        elif isinstance(x, float):
            assert x == pytest.approx(y, rel=1e-9, abs=1e-9), place

    close(a, b, "")


def test_water_moves_the_focal_plane_to_n_fold_its_distance_and_depth_errors_with_it():
    """In front of a window of no thickness the plane in focus lies n times as far from it, with n times the sigma."""
    window = {**PLATE, "thickness": 1e-9, "distance": 118.0}
    air, water = (
        PAPER.replace(
            {"elements": [window], "object_space.medium": {"index": n}, "microlens_array.distance": PAPER.d_1}
        )
        for n in (1.0, 1.333)
    )
    assert water.d_f - 118 == pytest.approx(1.333 * (air.d_f - 118), rel=1e-9)
    sigma_air, sigma_water = (quantity_named("sigma_z_mm")(Camera.of(design)) for design in (air, water))
    assert sigma_water == pytest.approx(1.333 * sigma_air, rel=1e-9)
    same = "fill_factor", "image_diameter_mm", "object_sample_mm", "view_baseline_mm"
    for name in same:
        assert quantity_named(name)(Camera.of(water)) == pytest.approx(
            float(quantity_named(name)(Camera.of(air))), rel=1e-9
        )
    # What crosses the FAP's middle, 1 mm behind the window, is bent there by the sines of its angles.
    across = float(quantity_named("field_half_width_mm")(Camera.of(air)))
    sine = math.sin(math.atan(across / (air.d_f - air.d_3))) / 1.333
    bent = (water.d_f - 118) * sine / math.sqrt(1 - sine**2) + (118 - air.d_3) * across / (air.d_f - air.d_3)
    assert float(quantity_named("field_half_width_mm")(Camera.of(water))) == pytest.approx(bent, rel=1e-9)


@pytest.mark.parametrize(("in_air", "in_water"), [(70, 50.972), (90, 64.073), (120, 81.035)])
def test_angles_of_view_in_air_are_narrower_in_water(in_air, in_water):
    """The same camera behind the same window; and the ray through the FAP's middle, traced by Snell's law."""
    window = {**PLATE, "distance": 3.0, "thickness": 0.5, "diameter": None}
    scope = roslf.load("rigid-scope")
    half = quantity_named("field_half_angle_deg")
    before = math.tan(math.radians(float(half(Camera.of(scope)))))
    width = scope.sensor.size[0] * math.tan(math.radians(in_air / 2)) / before
    wide = scope.replace({"sensor.size": (width, width), "microlens_array.size": (2 * width, 2 * width)})
    designs = [
        wide.replace({"elements": [window], "object_space.medium": medium, "microlens_array.distance": scope.d_1})
        for medium in ({"index": 1.0}, {"index": 1.333})
    ]
    air, water = (2 * float(half(Camera.of(design))) for design in designs)
    assert float(half(Camera.of(wide))) == pytest.approx(in_air / 2, rel=1e-12)
    assert air == pytest.approx(in_air, rel=1e-12)
    assert water == pytest.approx(in_water, abs=6e-4)
    slope = mp.tan(mp.radians(in_air) / 2)
    (near, far), *_ = traced(designs[1], [(slope * mp.mpf(scope.d_3), slope)], [10, 20], exact=True)
    assert water == pytest.approx(2 * math.degrees(math.atan(abs(far - near) / 10)), rel=1e-12)


def test_glass_about_the_array_is_reduced():
    """Cover and substrate behind the lenslets take t (1 - 1/n) off d_2; a substrate before them off d_1."""
    cover, plate = {"thickness": 0.4, "material": {"index": 1.5}}, {"thickness": 1.2, "material": {"index": 1.6}}
    behind = Camera.of(PAPER.replace({"sensor.cover": cover, "microlens_array.substrate": plate}))
    assert behind.seen.d_2 == pytest.approx(2 - 0.4 * (1 - 1 / 1.5) - 1.2 * (1 - 1 / 1.6), rel=1e-14)
    assert behind.d_1 == 140
    before = Camera.of(PAPER.replace({"microlens_array.substrate": {**plate, "lenslets": "sensor"}}))
    assert before.seen.d_1 == pytest.approx(140 - 1.2 * (1 - 1 / 1.6), rel=1e-14)
    assert before.d_2 == 2
    assert 1 / before.d_f + 1 / before.seen.d_1 == pytest.approx(1 / 100, rel=1e-12)


def test_a_pupil_in_the_focus_of_an_objective_is_finite():
    """The FAP's image lies at infinity: all numbers are the limit of those beside it."""
    lens = {
        "kind": "lens",
        "distance": 400.0,
        "focal_length": 30.0,
    }  # its image of the scene is what the main lens sees
    at, near = (
        PAPER.replace({"elements": [lens], "aperture.distance": 430.0 - off, "main_lens.focal_plane": 445.0})
        for off in (0.0, 1e-7)
    )
    here, there = (Camera.of(design) for design in (at, near))
    for name in ("fill_factor", "image_diameter_mm", "image_pitch_mm", "sigma_z_mm", "non_distortion_room_mm"):
        value = float(quantity_named(name)(here))
        assert math.isfinite(value), name
        assert value == pytest.approx(float(quantity_named(name)(there)), rel=1e-5), name


def test_barrels_of_rods_cut_as_rays_swinging_inside_them_say():
    """A needle scope's kept fractions against paraxial rays by hand, met all along its rods; to the sections' 1 %."""
    design = roslf.load("grin-needle").replace({"aperture.diameter": 1.8, "sensor.size": (1.68, 1.68)})
    camera = Camera.of(design)
    turn = np.pi * (1 + 5**0.5) * (np.arange(5_000) + 0.5)
    r = np.sqrt((np.arange(5_000) + 0.5) / 5_000) * design.D_F / 2
    pupil = np.stack([r * np.cos(turn), r * np.sin(turn)])
    fields = [(0.0, 0.0), (0.5, 0.0), (0.8, 0.0), (0.8, 0.8)]
    kept = MicrolensImages(camera, fields).shapes.kept_fraction[:, 0]
    for field, closed in zip(fields, kept, strict=True):
        # Every ray of a microlens passes its image on the plane in focus; the FAP stands before all elements, in air.
        slope = (pupil + np.array(field)[:, None] * float(camera.seen.inverse_m)) / (
            float(camera.seen.d_f) - design.d_3
        )
        x, at, good = pupil + slope * design.d_3, 0.0, np.ones(5_000, bool)
        for element in design.elements:
            x, at = x - slope * (element.distance - at), element.distance
            if element.kind == "lens":
                good &= np.hypot(*x) <= element.diameter / 2
                slope = slope + x / element.focal_length
                continue
            g, inside = element.gradient, np.linspace(0, element.thickness, 200)
            for t in inside:
                along = x * np.cos(g * t) - slope / (element.index * g) * np.sin(g * t)
                good &= np.hypot(*along) <= element.diameter / 2
            end = g * element.thickness
            slope = element.index * g * x * np.sin(end) + slope * np.cos(end)
            x, at = along, at + element.thickness
        assert closed == pytest.approx(good.mean(), abs=0.01), field
    assert kept[0] == 1
    assert kept[-1] < 0.6
    budget = {share.name: share.kept for share in roslf.evaluate(design).fields[1].ray_budget.by_name}
    assert list(budget)[3:6] == ["grin 2, front", "grin 2, barrel", "grin 2, back"]
    assert budget["grin 2, front"] == 1 > budget["grin 2, barrel"]


def test_derivatives_behind_a_relay_that_inverts_are_those_of_differences():
    """Complex steps through every closed form, beside central differences, whose own error is some 1e-8."""
    design = roslf.load("cystoscope")
    camera = Camera.of(design)
    names = [name for name, quantity in QUANTITIES.items() if quantity.analytic and not quantity.traced]
    assert {"object_sample_mm", "object_magnification", "image_diameter_mm", "fill_factor"} <= set(names)
    for place in ("elements.0.focal_length", "elements.5.distance", "elements.2.index", "object_space.index"):
        here, size = camera[place], 1e-6 * camera[place]
        step = camera.replace({place: np.array([here + 1e-30j])})
        apart = camera.replace({place: np.array([here - size, here + size])})
        for name in names:
            exact = np.imag(np.squeeze(QUANTITIES[name](step))) / 1e-30
            low, high = np.broadcast_to(QUANTITIES[name](apart), (2,))
            size_of = abs(high) / here
            assert exact == pytest.approx((high - low) / (2 * size), rel=1e-4, abs=1e-6 * size_of), (name, place)


def test_planes_that_a_rod_shows_beyond_infinity_have_sizes_and_depths_as_beside_them():
    """Where the image runs through infinity nothing happens to what lies there."""
    rod = {"kind": "grin", "distance": 150.0, "thickness": 20.0, "index": 1.6, "gradient": 0.01}
    camera = Camera.of(PAPER.replace({"elements": [rod]}))
    ahead = np.array([300.0, 310.0, 320.0, 330.0, 340.0])
    seen = camera.plane(ahead + camera.tip).distance
    assert seen.min() < 0 < seen.max()
    for name in ("field_half_width_mm", "object_sample_mm", "sigma_z_mm"):
        values = QUANTITIES[name](camera, ahead)
        assert np.all(values > 0), name
        assert np.abs(np.diff(values, 2)).max() < 0.1 * np.abs(np.diff(values)).min(), name  # no jump


def test_files_hold_elements():
    design = PAPER.replace(
        {
            "elements": [
                {**PLATE, "material": "N-BK7"},
                {"kind": "prism", "distance": 10.0, "thickness": 5.0, "material": WATER, "deviation": 0.5},
                {"kind": "lens", "distance": 20.0, "focal_length": -300.0},
                {"kind": "grin", "distance": 30.0, "thickness": 8.0, "index": 1.6, "gradient": 0.002},
                {"kind": "prescription", "distance": 50.0, "prescription": "LA1050-A"},
            ],
            "main_lens.focal_plane": 165.0,
            "object_space.medium": WATER,
            "sensor.cover": {"thickness": 0.4, "material": "N-BK7"},
            "microlens_array.substrate": {"thickness": 0.5, "material": {"index": 1.46}},
        }
    )
    assert loads(dumps(design)) == design
    assert Camera.of(design) == Camera.of(loads(dumps(design)))
    moved = Camera.of(design, {"elements.0.thickness": np.array([1.0, 1.1])})
    one = design.replace({"elements.0.thickness": 1.1})
    assert moved.rims[2].distance[1] == pytest.approx(float(Camera.of(one).rims[2].distance), rel=1e-12)
    assert moved["main_lens.focal_plane"][1] == pytest.approx(one.d_f, rel=1e-12)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"object_space.medium": WATER}, r"object_space.medium: nothing keeps n = 1.333.* from the main lens; add"),
        ({"elements": [{**PLATE, "material": "N-BK8"}]}, r"elements.0.material: .*the nearest known is 'N-BK7'"),
        ({"elements": [{**PLATE, "distance": 116.5}]}, r"aperture.distance: 117 mm lies inside .*; move it out"),
        ({"elements": [PLATE, {**PLATE, "distance": 118.5}]}, r"elements.1.distance: 118.5 mm lies inside the element"),
        ({"elements": [{**PLATE, "kind": "plat"}]}, r"elements.0.kind: .*did you mean 'plate'"),
        (
            {
                "sensor.cover": {"thickness": 1.2, "material": "D263"},
                "microlens_array.substrate": {"thickness": 1.0, "material": {"index": 1.5}},
            },
            "sensor.distance: 2 mm does not hold the 2.2 mm of glass in it",
        ),
        (
            {
                "microlens_array.substrate": {
                    "thickness": 150.0,
                    "material": {"index": 1.1},
                    "lenslets": "sensor",
                },
            },
            r"microlens_array.distance: 140 mm does not hold the 150 mm of glass",
        ),
        (
            {"elements": [{**PLATE, "distance": 400.0}]},
            r"main_lens.focal_plane: .* is not in front of the",
        ),
        (
            {"elements": [{**PLATE, "material": {"index": 0.5}}]},
            "elements.0.material.index: an index must be a number from 1 to 5, got 0.5",
        ),
        (  # by Snell's law in the plane: 74.5 degrees, 30.5 inside, 44 on the other face; 31.8 is the most
            {"elements": [{**PLATE, "material": {"index": 1.9}, "wedge": (1.3, 0.0)}]},
            r"elements.0.wedge: light along the axis is totally reflected in plate 1, .* at 44 degrees",
        ),
    ],
)
def test_bad_elements_are_told(change, said):
    with pytest.raises(DesignError, match=said):
        PAPER.replace(change)


def test_a_wedge_that_light_still_leaves_is_none_of_them():
    """In water the same face lets it out up to 44.6 degrees."""
    wedged = {**PLATE, "material": {"index": 1.9}, "wedge": (1.3, 0.0)}
    assert PAPER.replace({"elements": [wedged], "object_space.medium": WATER}).elements[0].wedge == (1.3, 0.0)


@pytest.mark.parametrize("name", ["water", "saline", "B270", "sapphire", "fused silica"])
def test_materials_by_name_come_back_from_a_file_by_name(name):
    design = PAPER.replace({"elements": [{**PLATE, "material": name}], "object_space.medium": name})
    again = loads(dumps(design))
    assert again == design
    assert f'material = "{again.elements[0].material.name}"' in dumps(design)
    with pytest.raises(DesignError, match=r"object_space.medium: 'sallne' is not .* nearest known is 'saline'"):
        PAPER.replace({"elements": [PLATE], "object_space.medium": "sallne"})


def test_a_wavelength_that_no_glass_is_known_at_is_told_with_its_place():
    with pytest.raises(DesignError, match=r"light.wavelength: 100 nm is outside the range of N-LASF9 .365 nm"):
        roslf.load("arthroscope").replace({"light.wavelength": 1e-4})


@pytest.mark.parametrize("z", [-5.0, 0.0, 120.0, math.inf, np.array([-1.0, 40.0]), np.array([3.0 + 1e-30j])])
def test_an_empty_bore_leaves_every_plane_where_it_is(z):
    """To the bit: behind the main lens, at infinity and with complex steps too."""
    camera = Camera.of(PAPER)
    plane = camera.plane(z)
    assert np.array_equal(plane.distance, z)
    assert np.all(plane.magnification == 1)
    assert np.all(plane.medium == 1)
    assert np.array_equal(camera.plane_seen_at(z), z)


def test_a_build_that_is_no_camera_names_the_element_as_its_file_does():
    build = Camera.of(PAPER.replace({"elements": [PLATE]})).replace({"elements.0.thickness": -0.1})
    assert "[[elements]] 1, thickness is not above 0" in [words for words, holds in build.faults().items() if holds]


def test_elements_go_by_their_names():
    """Verdicts, ray budget and saved files have the names given; two parts of one name are refused."""
    named = PAPER.replace({"elements": [PLATE | {"name": "window"}, PLATE | {"distance": 120.0}]})
    page = roslf.evaluate(named).everything
    assert "window" in page
    assert "plate 2" in page
    assert "plate 1" not in page
    assert loads(dumps(named)).elements == named.elements
    for name, other in (("window", {"name": "window"}), ("plate 2", {}), ("FAP", {}), ("main lens", {})):
        with pytest.raises(DesignError, match=f'"{name}" is the name of'):
            PAPER.replace({"elements": [PLATE | {"name": name}, PLATE | {"distance": 120.0} | other]})


def test_ray_budget_folds_what_takes_no_light():
    """Shares that are shown add up to one, whatever is folded."""
    result = roslf.evaluate("cystoscope")
    rows = next(part for part in result.everything.split("Ray budget")[1:])
    table = rows.split("\n\n")[0]
    assert "lost at all others" in table
    shares = [float(share) for share in re.findall(r"([\d.]+) %", table)]
    fields = len(result.fields)
    for k in range(fields):
        assert sum(shares[k::fields]) == pytest.approx(100, abs=0.05)


@pytest.mark.parametrize("bore", [{}, {"elements": [PLATE]}])
def test_stops_go_by_their_names(bore):
    """Verdicts, ray budget, places of a tolerance study, drawings and saved files have the names given."""
    stops = [{"diameter": 2.0, "distance": 100.0, "name": "wide end"}, {"diameter": 9.0, "distance": 60.0}]
    named = PAPER.replace(bore | {"stops": stops})
    page = roslf.evaluate(named).everything
    assert "wide end" in page
    assert "stop 2" in page
    assert "stop 1" not in page
    bare = PAPER.replace(bore | {"stops": [{key: stop[key] for key in ("diameter", "distance")} for stop in stops]})
    assert re.sub(r"(the\s+)?wide\s+end", "stop 1", page).split() == roslf.evaluate(bare).everything.split()
    assert loads(dumps(named)).stops == named.stops
    assert short_name("stops.0.decentre.0", named) == "wide end decentre x"
    assert "wide end" in str(dimensions(named))
    (row,) = (row for row in sequence_of(named) if row.name == "wide end")
    assert row.clip.reach == 1.0
    for name in ("stop 2", "FAP"):
        with pytest.raises(DesignError, match=f'"{name}" is the name of'):
            PAPER.replace(bore | {"stops": [stops[0] | {"name": name}, stops[1]]})


def test_rays_behind_a_real_lens_that_a_named_stop_clips_say_so():
    singlet = roslf.load("paper-singlet")
    page = roslf.evaluate(
        singlet.replace({"stops": [{"diameter": 2.0, "distance": 100.0, "name": "wide end"}]})
    ).everything
    assert "clipped at wide end" in page
    assert "stop 1" not in page
