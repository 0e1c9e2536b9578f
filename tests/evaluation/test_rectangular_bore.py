"""Fields behind rectangular bores, turned too, against single rays: whole, cut and lit where the rays say so."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import roslf_design as roslf
from roslf_design._arrays import sunflower
from roslf_design.camera import Camera
from roslf_design.effects.effect import Subject
from roslf_design.effects.geometry import _vignetting
from roslf_design.reporting.sheet.lines import basis
from roslf_design.theory.light import sensor_field
from roslf_design.theory.vignetting import (
    corner_room,
    field_limit,
    lit_radius,
    room_at,
    undistorted_radii,
    undistorted_towards,
)

PAPER = roslf.load("paper")
SIZE = (11.3, 8.2)
GRID = 9
"""Places of the field along each way at which rays are counted."""


def bore(stops, aperture=None, **more):
    return PAPER.replace(
        {
            "main_lens": {"diameter": 22.86, "focal_length": 45.0},
            "aperture": aperture or {"diameter": 9.0, "distance": 5.0},
            "stops": stops,
            "microlens_array.distance": 92.0,
            "microlens_array.size": SIZE,
            "sensor.size": SIZE,
            **more,
        }
    )


def rectangle(sides, turn=0.0, distance=80.0, decentre=(0.0, 0.0)):
    return {"shape": "rectangle", "sides": sides, "turn": turn, "distance": distance, "decentre": decentre}


def within(stop, x, y):
    """Whether points of its plane lie in an opening, and how far outside they do at most [mm]."""
    x, y = x - stop.decentre[0], y - stop.decentre[1]
    if stop.shape == "circle":
        return np.hypot(x, y) - stop.diameter / 2
    cos, sin = math.cos(stop.turn), math.sin(stop.turn)
    return np.maximum(np.abs(cos * x + sin * y) - stop.sides[0] / 2, np.abs(cos * y - sin * x) - stop.sides[1] / 2)


def rim_of(stop, count=720):
    turn = np.linspace(0, 2 * math.pi, count, endpoint=False)
    if stop.shape == "circle":
        return stop.diameter / 2 * np.array([np.cos(turn), np.sin(turn)])
    cos, sin = math.cos(stop.turn), math.sin(stop.turn)
    a, b = np.array(stop.sides) / 2
    p, q = np.array([(a, b), (-a, b), (-a, -b), (a, -b)]).T
    return np.array([cos * p - sin * q, sin * p + cos * q]) + np.array(stop.decentre)[:, None]


def outside(design, places, points):
    """How far outside the stops rays go at most, from places in focus through points of the FAP: (places, rays)."""
    far = []
    for stop in design.stops:
        share = (design.d_f - stop.distance) / (design.d_f - design.d_3)
        at = [p[:, None] + (f - p[:, None]) * share for p, f in zip(places, points, strict=True)]
        far.append(within(stop, *at))
    return np.max(far, axis=0)


def object_places(design, share=1.0):
    """A grid over the part of the focal plane that the sensor sees."""
    field = sensor_field(Camera.of(design))
    scale = -design.d_f / design.d_1
    axes = [scale * share * np.linspace(float(lo), float(hi), GRID) for lo, hi in zip(*field, strict=True)]
    return np.array([axis.ravel() for axis in np.meshgrid(*axes)])


OPENING = st.tuples(
    st.floats(8.0, 20.0), st.floats(8.0, 20.0), st.floats(-1.6, 1.6), st.floats(20.0, 82.0),
    st.tuples(st.floats(-0.4, 0.4), st.floats(-0.4, 0.4)),
)  # fmt: skip
FAP = st.sampled_from(
    [{"diameter": 9.0, "distance": 5.0}, rectangle((7.0, 5.0), 0.4, 5.0), rectangle((4.0, 6.0), 0.0, 5.0, (0.2, -0.3))]
)


@settings(max_examples=25, deadline=None)
@given(st.lists(OPENING, min_size=1, max_size=2), FAP)
def test_clearance_is_what_the_worst_ray_of_the_sensors_own_field_leaves(openings, aperture):
    design = bore([rectangle(one[:2], *one[2:]) for one in openings], aperture)
    camera = Camera.of(design)
    points, places = rim_of(design.aperture), object_places(design)
    room = -outside(design, places, points).max()
    told = float(corner_room(camera)[1:].min())
    assert told == pytest.approx(room, abs=2e-4)  # of a rim that is told by 720 points
    limit = field_limit(camera)
    lost = outside(design, places, points).max(axis=1) > 1e-4
    cuts = [cut for cut in limit.cuts if cut["rim"] != "main lens"]
    if not cuts:
        assert not lost.any()
        return
    # Nothing nearer the axis is cut, and just farther out something is.
    first = min(cut["beyond_mm"] for cut in cuts)
    radius = np.hypot(*places)
    assert not np.any(lost & (radius < first - 1e-3))
    assert limit.radius <= first * (1 + 1e-12)
    turn = np.linspace(0, 2 * math.pi, 7200)
    (x0, y0), (x1, y1) = places.min(axis=1), places.max(axis=1)
    ring = (1.002 * first + 1e-3) * np.array([np.cos(turn), np.sin(turn)])
    ring = ring[:, (ring[0] >= x0) & (ring[0] <= x1) & (ring[1] >= y0) & (ring[1] <= y1)]
    if first > 0 and ring.size:
        assert outside(design, ring, points).max() > 0


def test_a_tip_that_passes_all_of_an_oblong_field_is_not_judged_by_its_inscribed_circle():
    design = bore([rectangle((12.0, 10.0), 0.0, at) for at in (13.0, 69.5, 82.1)])
    camera, places = Camera.of(design), object_places(design)
    x, y = 4.5 * sunflower(20_000)
    assert np.all(outside(design, places, (x, y)) <= 0)
    told = roslf.evaluate(design)
    assert told.non_distortion.x0_max_mm < told.non_distortion.field_half_diagonal_mm
    assert told.non_distortion.undistorted_in_field
    assert told.non_distortion.room_at_corner_mm > 0
    assert float(roslf.quantity("non_distortion_room_mm")(camera)) == told.non_distortion.room_at_corner_mm
    assert "directions that the sensor does not see" in next(
        one.text for one in told.verdicts if one.name == "field_undistorted"
    )
    assert _vignetting(Subject(design)).value == 0
    # Turned by a quarter it cuts what the sensor sees over its width.
    turned = roslf.evaluate(design.replace({"stops.2.turn": math.pi / 2})).non_distortion
    assert not turned.undistorted_in_field
    places = object_places(design, 1.0)
    lost = outside(design.replace({"stops.2.turn": math.pi / 2}), places, (x, y)).max(axis=1) > 0
    assert np.hypot(*places)[lost].min() >= turned.cut_beyond_mm


def test_a_round_field_that_is_required_is_judged_all_round():
    design = bore([rectangle((12.0, 9.0), 0.0, 82.1)])
    asked = design.replace({"required": {"round_field_radius_mm": {"min": "3.9 mm"}}})
    limit = field_limit(Camera.of(asked))
    assert limit.clearance > 0
    room = float(roslf.quantity("non_distortion_room_mm")(Camera.of(asked)))
    turn = np.linspace(0, 2 * math.pi, 360)
    ring = 3.9 * np.array([np.cos(turn), np.sin(turn)])
    assert room == pytest.approx(-outside(asked, ring, rim_of(asked.aperture)).max(), abs=1e-3)


@settings(max_examples=25, deadline=None)
@given(st.lists(st.tuples(st.floats(6.0, 20.0), st.floats(10.0, 82.0)), max_size=3), st.floats(-0.5, 0.5))
def test_round_bores_are_judged_by_the_farthest_corner_as_ever(rims, aside):
    design = bore([{"diameter": d, "distance": z, "decentre": (aside, 0.0)} for d, z in rims])
    camera = Camera.of(design)
    radius = float(sensor_field(camera).radius) * design.d_f / design.d_1
    np.testing.assert_array_equal(corner_room(camera), room_at(camera, radius))
    gap = design.d_f - design.d_3
    for k, (d, z) in enumerate(rims):
        share, move = (design.d_f - z) / gap, abs(z - design.d_3) / gap
        by_hand = d / 2 - abs(aside) - design.D_F / 2 * share - radius * move
        assert corner_room(camera)[k + 1] == pytest.approx(by_hand, abs=1e-9)
    begin = sorted(cut["beyond_mm"] for cut in field_limit(camera).cuts)
    bounds = np.maximum(undistorted_radii(camera), 0)
    assert not begin or begin[0] == pytest.approx(bounds.min())


@settings(max_examples=40, deadline=None)
@given(
    st.tuples(st.floats(6.0, 14.0), st.floats(6.0, 14.0), st.floats(-1.6, 1.6), st.floats(40.0, 82.0)),
    st.sampled_from([None, (4.0, 3.0), (4.0, 4.0)]),
)
def test_light_ends_in_each_direction_where_a_third_of_the_rays_is_left(opening, sides):
    aperture = {"diameter": 5.0, "distance": 5.0} if sides is None else rectangle(sides, opening[2], 5.0)
    design = bore([rectangle(opening[:2], *opening[2:])], aperture, **{"main_lens.diameter": 40.0})
    camera = Camera.of(design)
    if design.aperture.shape == "circle":
        points = 2.5 * sunflower(20_000)
    else:
        a, b = np.meshgrid(*[(np.arange(120) + 0.5) / 120 - 0.5] * 2)
        a, b = design.aperture.sides[0] * a.ravel(), design.aperture.sides[1] * b.ravel()
        cos, sin = math.cos(design.aperture.turn), math.sin(design.aperture.turn)
        points = np.array([cos * a - sin * b, sin * a + cos * b])
    turn = np.linspace(0, 2 * math.pi, 25)
    ways = np.array([np.cos(turn), np.sin(turn)])
    ends = lit_radius(camera, tuple(ways))
    least = float(lit_radius(camera))
    assert np.all(ends >= least * (1 - 1e-12))

    def kept(share):
        places = -share * ends * ways * design.d_f / design.d_1
        return (outside(design, places, points) <= 0).mean(axis=1)

    here = kept(1.0)
    assert np.all((here > 0.2) & (here < 0.45)), here
    assert np.all(kept(0.7) > here)
    assert np.all(kept(1.4) < 0.25)


def test_a_field_that_a_rectangle_lights_is_told_as_far_as_it_does():
    design = bore([rectangle((12.0, 10.0), 0.0, at) for at in (13.0, 69.5, 82.1)])
    answer = roslf.evaluate(design).answer
    half = [side * design.d_f / design.d_1 for side in sensor_field(Camera.of(design)).half]
    away = design.d_f - design.d_3
    full = [2 * math.degrees(math.atan(side / away)) for side in (*half, math.hypot(*half))]
    view = answer.field_of_view_deg
    assert [view.width, view.height, view.diagonal] == pytest.approx(full, rel=1e-9)
    assert answer.sensor_field_of_view_deg is None
    assert "lit no farther" not in answer.rows[0][2]
    # Lower, light ends over the height alone; the sheet says so there and at the diagonal.
    low = design.replace({f"stops.{k}.sides": [14.0, 4.0] for k in range(3)} | {"aperture.diameter": 3.0})
    remarks = {row.name: row.remark for row in basis(low).rows if row.subject == "Field of view"}
    ended = {name.rpartition(", ")[2] for name, remark in remarks.items() if "lit no farther" in remark}
    assert "vertical" in ended
    assert "horizontal" not in ended
    plate = {"kind": "plate", "distance": 81.0, "thickness": 1.0, "material": "sapphire", "name": "window"}
    mirror = {"kind": "mirror", "distance": 75.0, "diameter": 16.8, "angle": math.pi / 4, "azimuth": math.pi / 2}
    words = [row.remark for row in basis(design.replace({"elements": [mirror, plate]})).rows]
    assert any("window, no diameter stated" in text for text in words)


@settings(max_examples=25, deadline=None)
@given(st.lists(OPENING, min_size=1, max_size=2), FAP)
def test_the_line_drawn_is_where_rays_begin_to_be_cut(openings, aperture):
    design = bore([rectangle(one[:2], *one[2:]) for one in openings], aperture)
    camera, turn = Camera.of(design), np.linspace(0, 2 * math.pi, 61)
    ways = np.array([np.cos(turn), np.sin(turn)])
    ends = undistorted_towards(camera, ways.T)
    lens = float(undistorted_radii(camera)[0]) * design.d_1 / design.d_f
    points = rim_of(design.aperture)
    cut = (ends > 0) & (ends < lens * (1 - 1e-9))
    for share, inside in ((0.998, True), (1.004, False)):
        past = outside(design, -share * ends * ways * design.d_f / design.d_1, points).max(axis=1)[cut]
        assert np.all(past <= 0) if inside else np.all(past > 0)
