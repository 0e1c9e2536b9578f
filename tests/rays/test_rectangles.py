"""Rectangular stops and a rectangular FAP: kept shares against the same camera's rays, and against rays of one's own.

A backward ray is followed by the thin lens's own formulas, written out here again: sensor point, pinhole microlens,
lens, stops, whose openings are asked by turned coordinates.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.errors import InputError
from roslf_design.rays import trace_pupil
from roslf_design.theory.f_number import matched
from roslf_design.theory.image_parts import image_parts
from roslf_design.theory.light import solid_angle
from roslf_design.theory.quantities import QUANTITIES
from roslf_design.theory.stop_images import MicrolensImages
from roslf_design.theory.vignetting import room_at, undistorted_radii

PAPER = roslf.load("paper")
RAYS = 200_000
SPREAD = 5.0
"""Standard errors of a counted share: one test in a million is farther off."""


def stop(sides, turn=0.0, distance=100.0, **more):
    return {"shape": "rectangle", "sides": sides, "turn": turn, "distance": distance, **more}


def bench(aperture, *stops):
    """The paper's bench with another FAP and further stops."""
    return PAPER.replace({"aperture": aperture, "stops": list(stops)})


SQUARE = bench(stop((2.9, 1.9), 0.35, 120.0), stop((5.0, 4.0), -0.2), {"diameter": 4.5, "distance": 60.0})
DECENTRED = bench(stop((2.0, 2.5), 1.1, 120.0, decentre=(0.2, -0.1)), stop((4.0, 3.0), 0.5, 90.0, decentre=(-0.3, 0.4)))
SLIT = bench({"diameter": 2.9, "distance": 120.0}, stop((0.3, 20.0), 0.8))


def own_rays(design, c, count, seed=3):
    """Shares of rays through the pinhole microlens at c that fill the FAP and pass all else, and their mean landing."""
    rng = np.random.default_rng(seed)
    f, d_1, d_2, d_3 = design.f, design.d_1, design.d_2, design.d_3

    def inside(part, x, y):
        x, y = x - part.decentre[0], y - part.decentre[1]
        if part.shape == "circle":
            return np.hypot(x, y) <= part.diameter / 2
        cos, sin = math.cos(part.turn), math.sin(part.turn)
        return (np.abs(cos * x + sin * y) <= part.sides[0] / 2) & (np.abs(cos * y - sin * x) <= part.sides[1] / 2)

    # Rays at all points of the sensor that the FAP may light: a box about its image.
    reach = 0.06
    middle = np.array(c) * d_2 * (1 / d_1 - (d_3 / d_1**2) * design.d_f / (design.d_f - d_3))
    p = np.array(c) + middle + rng.uniform(-reach, reach, (count, 2))
    s = (p - c) / d_2
    lens = c - s * d_1
    slope = s + lens / f
    at = {z: lens - slope * z for z in {0.0, *(part.distance for part in design.all_stops)}}
    filled = inside(design.aperture, *at[d_3].T)
    kept = filled & (np.hypot(*at[0.0].T) <= design.D / 2)
    for part in design.stops:
        kept &= inside(part, *at[part.distance].T)
    return filled, kept, p - c


@pytest.mark.parametrize("design", [SQUARE, DECENTRED, SLIT])
@pytest.mark.parametrize("c", [(0.0, 0.0), (6.3, -2.1), (11.0, 7.0)])
def test_kept_shares_and_centroids_are_those_of_ones_own_rays(design, c):
    filled, kept, place = own_rays(design, c, RAYS)
    (field,) = roslf.evaluate(design, [c]).fields
    share, n = kept.sum() / filled.sum(), filled.sum()
    assert n > 1000
    assert field.kept_fraction == pytest.approx(share, abs=SPREAD * math.sqrt(max(share * (1 - share), 1e-4) / n))
    assert field.kept_fraction + field.lost_fraction == 1
    if kept.sum() > 100:
        spread = place[kept].std(0) / math.sqrt(kept.sum())
        np.testing.assert_array_less(np.abs(place[kept].mean(0) - field.centroid_mm), SPREAD * spread)


@pytest.mark.parametrize("design", [SQUARE, DECENTRED])
def test_areas_are_those_of_the_cameras_rays_with_every_part_tilted(design):
    tilted = design.replace({
        "aperture.tilt": (0.1, -0.06), "stops.0.tilt": (-0.08, 0.12), "sensor.tilt": (0.01, 0.0),
        "microlens_array.tilt": (0.0, 0.01), "main_lens.tilt": (0.02, 0.01),
    })  # fmt: skip
    rng = np.random.default_rng(1)
    r, turn = np.sqrt(rng.uniform(size=RAYS)), rng.uniform(0, 2 * math.pi, RAYS)
    for some in (design, tilted):
        camera = Camera.of(some)
        for c in ((0.0, 0.0), (5.0, 3.0), (11.0, -6.0)):
            rays = trace_pupil(camera, (r * np.cos(turn), r * np.sin(turn)), c)
            passed = np.logical_and.reduce([*rays.passes.values()])
            kept = float(MicrolensImages(camera, [c]).shapes.kept_fraction[0, 0])
            # Even over the FAP is even over its image but for the small turn of perspective.
            slack = 0.0 if some is design else 3e-3
            assert passed.mean() == pytest.approx(kept, abs=slack + SPREAD * math.sqrt(0.25 / RAYS))


def test_room_is_where_the_first_ray_is_cut():
    """The radius at which a rim begins to cut, in the worst direction, against rays through the FAP's corners."""
    design = bench(stop((2.0, 1.2), 0.3, 120.0), stop((9.0, 8.0), 0.7, 70.0))
    camera = Camera.of(design)
    (radius,) = undistorted_radii(camera)[1:]
    corners = np.array(camera.fap.outline.corners, float)
    turn = np.linspace(0, 2 * math.pi, 7201)
    object_points = -radius * np.stack([np.cos(turn), np.sin(turn)], -1)
    for scale, whole in ((0.999, True), (1.001, False)):
        points = scale * object_points[:, None]
        slope = (corners - points) / (design.d_f - design.d_3)
        at = points + slope * (design.d_f - 70.0)
        held = camera.rims[1].outline.contains(at[..., 0], at[..., 1])
        assert held.all() == whole
    assert room_at(camera, float(radius))[1] == pytest.approx(0, abs=1e-12)


def test_what_assumes_a_disc_says_what_a_rectangle_has():
    wide, tall = 2.0, 1.2
    design = bench(stop((wide, tall), 0.0, 120.0))
    camera, disc = Camera.of(design), Camera.of(PAPER.replace(D_F=wide))
    turned = Camera.of(bench(stop((tall, wide), math.pi / 2, 120.0)))
    for name in ("fill_factor", "f_number_pupil", "mismatch_px", "image_diameter_mm", "view_depth_of_field_near_mm"):
        # Of extents along x and y the wider one.
        assert float(QUANTITIES[name](camera)) == pytest.approx(float(QUANTITIES[name](disc)), rel=1e-12)
        assert float(QUANTITIES[name](turned)) == pytest.approx(float(QUANTITIES[name](disc)), rel=1e-12)
    a = float(camera.seen.A)
    assert float(solid_angle(camera)) == pytest.approx(wide * tall / a**2, rel=1e-12)
    assert float(QUANTITIES["largest_diameter_mm"](camera)) == PAPER.D
    slanted = Camera.of(bench(stop((2.0, 2.0), math.pi / 4, 120.0)))
    assert float(slanted.seen.D_F) == pytest.approx(2 * math.sqrt(2), rel=1e-14)
    # D_F as a number of a camera widens both sides alike.
    match = float(matched(camera, "D_F").value)
    assert float(QUANTITIES["fill_factor"](camera.replace({"D_F": match}))) == pytest.approx(1, rel=1e-12)
    found = design.replace(D_F=match).aperture
    assert found.sides[0] / found.sides[1] == pytest.approx(wide / tall, rel=1e-12)


def test_twelfth_of_the_side_squared_without_diffraction():
    """Disparity's error of an even, narrow-band texture, against its own sum over a rectangle and a disc."""
    sharp = {"light.wavelength": 1e-9, "depth.period": 40.0, "sensor.read_noise": 0.0, "sensor.full_well": 1e9}
    side = 1.2
    box = Camera.of(bench(stop((side, side), 0.0, 120.0)).replace(sharp))
    disc = Camera.of(PAPER.replace({**sharp, "aperture.diameter": side}))
    sigma = [float(QUANTITIES["sigma_disparity_pitches"](one)) for one in (box, disc)]
    # Light times second moment: w^2 w^2/12 against pi w^2/4 w^2/16.
    assert sigma[0] / sigma[1] == pytest.approx(math.sqrt((math.pi / 4 / 16) / (1 / 12)), rel=0.03)


@settings(max_examples=12, deadline=None)
@given(st.floats(0.5, 4), st.floats(0.5, 4), st.floats(0, 3), st.floats(-9, 9), st.floats(-6, 6))
def test_a_quarter_turn_of_everything_and_other_sides_first_change_nothing(a, b, turn, x, y):
    one = Camera.of(bench({"diameter": 2.9, "distance": 120.0}, stop((a, b), turn)))
    same = Camera.of(bench({"diameter": 2.9, "distance": 120.0}, stop((b, a), turn + math.pi / 2)))
    kept = [
        float(MicrolensImages(camera, [place]).shapes.kept_fraction[0, 0])
        for camera, place in itertools.product((one, same), [(x, y), (-x, -y)])
    ]
    np.testing.assert_allclose(kept, kept[0], rtol=0, atol=1e-11)


def test_a_huge_rectangle_cuts_nothing():
    wide = bench({"diameter": 2.9, "distance": 120.0}, stop((400.0, 300.0), 0.4))
    (field,) = roslf.evaluate(wide, [(11.0, 7.0)]).fields
    (bare,) = roslf.evaluate(PAPER, [(11.0, 7.0)]).fields
    assert field.status == "full"
    assert field.kept_fraction == 1
    assert field.area_mm2 == pytest.approx(bare.area_mm2, rel=1e-12)
    assert field.centroid_mm == pytest.approx(bare.centroid_mm, rel=1e-12)


def test_json_tells_sides_beside_no_diameter():
    data = roslf.evaluate(bench(stop((2.0, 1.0), 0.3, 120.0)), [0.0]).to_dict()
    assert data["microlens_image"]["diameter_mm"] is None
    sides = data["microlens_image"]["sides_mm"]
    assert sides[0] / sides[1] == pytest.approx(2.0, rel=1e-12)
    assert "sides_mm" not in roslf.evaluate(PAPER, [0.0]).to_dict()["microlens_image"]


@pytest.mark.parametrize(
    ("keys", "place", "words"),
    [
        ({"shape": "rectangle"}, "aperture.sides", "is missing"),
        ({"shape": "rectangle", "sides": (3.0, -2.0)}, "aperture.sides.1", "greater than zero"),
        ({"shape": "rectangle", "sides": (3.0, 2.0), "diameter": 3.0}, "aperture.diameter", "drop diameter"),
        ({"diameter": 3.0, "turn": 0.3}, "aperture.turn", 'give shape = "rectangle"'),
        ({"diameter": 3.0, "sides": (3.0, 2.0)}, "aperture.sides", 'give shape = "rectangle"'),
        ({}, "aperture.diameter", "is missing"),
        ({"shape": "triangle", "sides": (3.0, 2.0)}, "aperture.shape", "rectangle"),
    ],
)
def test_bad_openings_get_one_message(keys, place, words):
    with pytest.raises(InputError) as error:
        PAPER.replace({"aperture": {"distance": 120.0, **keys}})
    (problem,) = error.value.problems
    assert problem.key == place
    assert words in problem.message


def test_what_is_not_followed_is_refused():
    window = {"kind": "plate", "distance": 20.0, "thickness": 1.0, "material": "N-BK7"}
    design = roslf.load("paper-singlet").replace({"elements": [window]})
    with pytest.raises(InputError, match="real main lens through air only") as error:
        design.replace({"stops": [stop((4.0, 3.0), distance=design.d_3)]})
    assert error.value.problems[0].key == "stops.0.shape"
    assert "elements.0" in error.value.problems[0].message


def test_where_light_of_a_whole_rectangle_comes_from_is_as_of_one_that_is_hardly_cut():
    """What undoes crosstalk of views: closed transforms of a whole image, rows of one of which a stop takes a hair."""
    aperture = {"shape": "rectangle", "sides": (2.9, 2.2), "turn": 0.35, "distance": 120.0}
    hair = {**aperture, "sides": (2.9 * (1 - 1e-7), 9.0), "distance": 119.9999999}
    places = np.linspace(-0.5, 0.5, 5)
    whole, cut = (
        image_parts(MicrolensImages(Camera.of(bench(aperture, *stops)), [(0.0, 0.0)]), places, places)
        for stops in ((), (hair,))
    )
    assert whole.light.max() > 0.5
    for ours, theirs in zip(whole[1:], cut[1:], strict=True):
        assert ours == pytest.approx(theirs, abs=1e-5)


def test_depth_behind_a_whole_rectangle_is_that_of_one_that_is_hardly_cut():
    """Closed transforms of the whole image against rows of one of which a stop takes a hair."""
    whole = roslf.load("paper").replace(
        {"aperture": {"shape": "rectangle", "sides": (2.9, 2.2), "turn": 0.35, "distance": 120.0}}
    )
    camera = Camera.of(whole)
    # At the FAP's distance a stop cuts every microlens image alike, here by 1e-7 of its width.
    cut = whole.replace(
        {"stops": ({"shape": "rectangle", "sides": (2.9 * (1 - 1e-7), 9.0), "turn": 0.35, "distance": 119.9999999},)}
    )
    assert roslf.quantity("sigma_z_mm")(Camera.of(cut)) == pytest.approx(
        float(roslf.quantity("sigma_z_mm")(camera)), rel=1e-6
    )


def test_depth_of_many_builds_is_that_of_each():
    """Series over builds that are nearly alike, to the 5e-4 rms that they promise, 1.5e-3 at most."""
    design = roslf.load("paper").replace(
        {"aperture": {"shape": "rectangle", "sides": (2.9, 2.2), "turn": 0.35, "distance": 120.0}}
    )
    rng = np.random.default_rng(0)
    numbers = {"aperture.sides.0": (2.9, 5e-3), "aperture.turn": (0.35, 5e-3), "d_2": (2.0, 5e-3), "f": (100.0, 0.1)}
    drawn = {place: middle + spread * rng.normal(size=400) for place, (middle, spread) in numbers.items()}
    many = Camera.of(design, drawn)
    sigma = roslf.quantity("sigma_z_mm")
    alone = [float(sigma(many.build(k))) for k in range(0, 400, 40)]
    np.testing.assert_allclose(sigma(many)[::40], alone, rtol=1.5e-3)
