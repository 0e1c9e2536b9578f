"""Rims that lean, of mirrors and tilted stops, in drawings, MTF and depth errors: against rays of one's own."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.effects import plan
from roslf_design.evaluation.fields import field_openings
from roslf_design.imaging.camera import Region, planned_camera
from roslf_design.imaging.trace import RaySampling, Tracer
from roslf_design.imaging.white import WhiteGeometry
from roslf_design.reporting.design.field import field_map
from roslf_design.reporting.design.microlens import _image_view
from roslf_design.scenes import Scene
from roslf_design.theory.depth_error import seen_at
from roslf_design.theory.disparity_error import _disparity_information
from roslf_design.theory.stop_images import MicrolensImages
from roslf_design.traced.fields import IdealImages
from tests.bore.folded import area, outline_by_rays
from tests.shapes.test_openings import clipped

PAPER = roslf.load("paper").replace({"main_lens.diameter": 30.0, "aperture.distance": 120.0})
PLACE = {"distance": 60.0, "diameter": 9.0, "decentre": (0.6, -0.4)}


def mirrored(angle=40.0, azimuth=25.0, **changes):
    own = {"kind": "mirror", "angle": math.radians(angle), "azimuth": math.radians(azimuth)}
    return PAPER.replace({"elements": (PLACE | own | changes,)})


def tilted(x, y, **changes):
    return PAPER.replace({"stops": (PLACE | {"tilt": (x, y)} | changes,)})


MIRROR = mirrored()
ROOM = "stops.0.tilt"
CASES = {
    "mirror": MIRROR,
    "grazing mirror": mirrored(15.0, 200.0, diameter=30.0),
    "tilted stop": tilted(0.5, -0.7),
    "mirror and stop": mirrored(
        50.0, 90.0, diameter=11.0, distance=70.0, decentre=(-1.0, 0.5)
    ).replace({"stops": ({"distance": 50.0, "diameter": 10.0, "tilt": (-0.6, 0.3)},)}),
}  # fmt: skip
FIELDS = [(0.0, 0.0), (4.0, 0.0), (-3.0, -4.0), (0.0, 5.0), (-5.0, 0.0), (3.0, 3.0)]


@pytest.mark.parametrize("design", CASES.values(), ids=CASES)
def test_openings_that_are_drawn_are_what_rays_find(design):
    """Shapes, outlines, rooms and pixels of a drawn image, at microlenses that it cuts or not."""
    parts = field_openings(design, FIELDS)
    common, cut = parts.common(), 0
    for k, microlens in enumerate(FIELDS):
        true, whole = outline_by_rays(design, microlens), outline_by_rays(design, microlens, only_fap=True)
        share = 0.0 if true is None else area(true) / area(whole)
        assert_allclose(common.kept_fraction[k], share, rtol=0, atol=2e-5)
        assert (parts.at(k).rooms.min() < 0) == (share < 1 - 1e-9)
        if not 0.02 < share < 1:
            continue
        cut += 1
        view = _image_view(design, microlens)
        assert_allclose(view.openings.contain(true * 0.999 + true.mean(0) * 0.001), True)
        assert not view.openings.contain(true.mean(0) + 1.001 * (true - true.mean(0))).any()
        # Chords of the drawn line, four degrees of its middle long at most, lie within.
        assert 0.997 < area(view.outline) / area(true) <= 1
        assert_allclose(view.coverage.sum() * design.q**2, area(true) * view.on_sensor, rtol=1e-3)
    assert cut > 1


def test_pixels_of_a_drawn_image_are_covered_as_rays_find():
    """Each by clipping the outline that rays find; polygons stand for ellipses, to 5e-4 of 13 pixels."""
    view, q = _image_view(MIRROR, FIELDS[1]), MIRROR.q
    outline = outline_by_rays(MIRROR, FIELDS[1], count=400)
    for j, y in enumerate(view.y[:-1]):
        for i, x in enumerate(view.x[:-1]):
            part = clipped([*outline], [(x, y), (x + q, y), (x + q, y + q), (x, y + q)])
            share = area(np.array(part)) / q**2 if len(part) > 2 else 0.0
            assert_allclose(view.coverage[j, i], share, rtol=0, atol=0.007)


def test_white_pictures_behind_a_mirror_come_by_areas_and_are_those_of_rays():
    scene = Scene()
    for design in (MIRROR, CASES["tilted stop"]):
        off = ["-microlens_diffraction", "-fap_diffraction", "-finite_microlens_aperture", "-cos4"]
        effects, region = plan(design, scene, overrides=off), Region(3000, 1900, 60, 60)
        camera = planned_camera(design, effects)
        assert camera.straight
        areas = WhiteGeometry.of(camera, effects).image(region)
        rays = Tracer.of(design, effects, scene).image(region, RaySampling(256, 256, 0.0, 1))[0]
        assert areas.std() > 0.3
        assert_allclose(np.abs(areas - rays).mean(), 0, atol=2e-3)  # 256 rays a pixel, at edges
        assert_allclose(areas.mean(), rays.mean(), rtol=1.5e-3)


def test_the_map_of_an_array_shows_the_leaning_rim():
    drawn = field_map(MIRROR, 9)
    for j, i in ((4, 1), (2, 6), (1, 3)):
        place = float(drawn.x[i]), float(drawn.y[j])
        true = outline_by_rays(MIRROR, place)
        whole = area(outline_by_rays(MIRROR, place, only_fap=True))
        assert_allclose(drawn.kept[j, i], 0.0 if true is None else area(true) / whole, rtol=0, atol=2e-5)
    assert drawn.kept.min() < 0.5


def test_room_is_the_least_way_to_the_rim():
    """Of discs within: how far they may go in the worst direction, by brute force over both rims."""
    parts = field_openings(mirrored(diameter=14.0), [(0.5, -0.3), (1.0, 1.0)])
    turn = np.linspace(0, 2 * math.pi, 20_001)
    for k in range(2):
        (xx, xy, yy), middle = parts.forms[k, 0], parts.centres[k, 2]
        lower = np.linalg.cholesky([[xx, xy], [xy, yy]])
        rim = middle + np.stack([np.cos(turn), np.sin(turn)], -1) @ lower.T
        apart = np.linalg.norm(rim - parts.centres[k, 0], axis=-1).min() - parts.radii[k, 0]
        assert_allclose(parts.rooms[k, 2], apart, rtol=1e-6)


@pytest.mark.parametrize("design", CASES.values(), ids=CASES)
def test_what_room_is_left_at_least_is_no_more_and_tells_what_cuts(design):
    x, y = np.meshgrid(*2 * [np.linspace(-8, 8, 12)])
    parts = field_openings(design, [*zip(x.ravel().tolist(), y.ravel().tolist(), strict=True)])
    rooms, least = parts.rooms, parts.least_rooms
    assert (least <= rooms + 1e-12).all()
    assert ((least < 0) == (rooms < 0)).all()


def overlap(polygon, by):
    """Area of a convex polygon's overlap with itself, moved: widths of rows of both, added up."""
    rows = np.linspace(polygon[:, 1].min() + abs(by[1]) / 2, polygon[:, 1].max() - abs(by[1]) / 2, 20_001)
    ends = []
    for sign in (-1, 1):
        x, y = (polygon + sign * np.asarray(by) / 2).T
        k, top = np.argmin(y), np.argmax(y)
        up = np.roll(np.arange(len(y)), -k)[: (top - k) % len(y) + 1]
        down = np.roll(np.arange(len(y)), -top)[: (k - top) % len(y) + 1][::-1]
        ends.append((np.interp(rows, y[down], x[down]), np.interp(rows, y[up], x[up])))
    (a, b), (c, d) = ends
    return np.trapezoid(np.maximum(np.minimum(b, d) - np.maximum(a, c), 0.0), rows)


@pytest.mark.parametrize("design", CASES.values(), ids=CASES)
def test_the_refocused_image_has_the_transfer_of_the_pupil_that_is_left(design):
    images = IdealImages(Camera.of(design), [(4.0, 0.0), (-3.0, -4.0)])
    whole = IdealImages(Camera.of(PAPER), images.fields)
    for k, microlens in enumerate(images.fields):
        true = outline_by_rays(design, microlens)
        transfer, bare = (some.transfer(k, None) for some in (images, whole))
        own = outline_by_rays(design, microlens, only_fap=True)
        for direction, axes in (("tangential", transfer.way), ("sagittal", (-transfer.way[1], transfer.way[0]))):
            scale = transfer.scale(direction)
            nu = np.array([4.0, 9.0])
            passed = transfer(nu / scale, "refocused", direction) / bare(
                nu / bare.scale(direction), "refocused", direction
            )
            for share, at in zip(passed, nu, strict=True):
                by = design.wavelength * design.d_2 * at * np.array(axes)
                expected = overlap(true, by) / area(true) / (overlap(own, by) / area(own))
                assert_allclose(share, expected, rtol=2e-3)  # kinks between Gauss-Legendre rows


@pytest.mark.parametrize("design", CASES.values(), ids=CASES)
def test_depth_errors_follow_the_second_moment_of_what_is_left(design):
    """Rays: nothing diffracts, and information goes as light times the spread of its places on the FAP."""
    fine = {"light.wavelength": 1e-9, "sensor.pixel": PAPER.q / 8, "sensor.read_noise": 0.0, "sensor.bits": 24}
    fields = [(4.0, 0.0), (-3.0, -4.0), (3.0, 3.0)]
    cut, bare = (
        _disparity_information(MicrolensImages(Camera.of(some), fields), seen_at(Camera.of(some), None))[:, 0]
        for some in (design.replace(fine), PAPER.replace(fine))
    )

    def spread(polygon):
        """Integral of the squared distance from its middle: light times mean square."""
        middle = polygon.mean(0)
        p, q = polygon - middle, np.roll(polygon, -1, 0) - middle
        cross = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
        second = (cross * ((p * p + p * q + q * q).sum(1))).sum() / 12
        first = (cross[:, None] * (p + q)).sum(0) / 6
        return second - first @ first / (cross.sum() / 2)

    for k, microlens in enumerate(fields):
        true, whole = outline_by_rays(design, microlens), outline_by_rays(design, microlens, only_fap=True)
        assert_allclose(cut[k] / bare[k], spread(true) / spread(whole), rtol=0.06)  # extrapolated in the blur, as `cut`


def numbers_of(design):
    """Kept shares, MTFs and depth errors of cut microlens images."""
    images = IdealImages(Camera.of(design), FIELDS[1:4])
    transfer = [images.transfer(k, None) for k in range(3)]
    mtf = [
        one(np.array([1.0, 2.0]) / one.scale(way), kind, way)
        for one in transfer for kind in ("view", "refocused") for way in ("tangential", "sagittal")
    ]  # fmt: skip
    sigma = [field.sigma_z_mm for field in roslf.evaluate(design, FIELDS[1:4]).fields]
    return np.concatenate([field_openings(design, FIELDS[1:4]).common().kept_fraction, *mtf, sigma])


def test_a_mirror_cuts_as_a_stop_that_leans_as_it_does():
    design = mirrored(40.0, 25.0, tilt=(0.0, 0.0), decentre=(0.0, 0.0))
    x, y, z = (part for part in design.elements[0]._normal)
    stop = tilted(math.atan2(-y, math.hypot(x, z)), math.atan2(x, z), decentre=(0.0, 0.0))
    assert_allclose(numbers_of(design), numbers_of(stop), rtol=1e-9)


@pytest.mark.parametrize("tilt", [(1e-6, 0.0), (-1e-7, 1e-7)])
def test_a_stop_that_hardly_leans_cuts_as_an_upright_one(tilt):
    """To the kinks between rows, which discs and ellipses take at places of their own."""
    assert_allclose(numbers_of(tilted(*tilt)), numbers_of(tilted(0.0, 0.0)), rtol=2e-3)


def test_a_tilted_rectangle_is_seen_as_a_quadrilateral():
    """Corners where rays through the microlens's image in front of the lens meet its plane."""
    sides = {"shape": "rectangle", "sides": (8.0, 5.0), "turn": 0.3, "diameter": None}
    design = tilted(0.4, -0.5, **sides)
    parts, camera = field_openings(design, [(4.0, 1.0)]), Camera.of(design)
    pose, outline = camera.apparent_pose("stops.0"), camera.rims[1].outline
    focus = -np.array([4.0, 1.0]) * design.d_f / design.d_1
    for k, (a, b) in enumerate(outline.corners):
        corner = np.array(pose.origin) + a * np.array(pose.x) + b * np.array(pose.y)
        z = -corner[2]
        on_lens = corner[:2] + (focus - corner[:2]) * (z / (z - design.d_f))
        spot = (np.array([4.0, 1.0]) - on_lens) * design.d_2 / design.d_1
        assert_allclose(parts.corners[0, 0, k], spot, rtol=0, atol=1e-12)


def test_a_tilted_plate_leaves_images_where_they_are():
    """Its first order shifts them by some 1e-8 mm; shapes count from the FAP's image there, not from the microlens."""
    plate = {"kind": "plate", "distance": 130.0, "thickness": 3.0, "material": {"index": 1.5}}
    straight, leaning = (
        roslf.evaluate(PAPER.replace({"elements": (plate | {"tilt": tilt},)}), [(3.0, 2.0)]).fields[0].centroid_mm
        for tilt in ((0.0, 0.0), (1e-6, 0.0))
    )
    assert_allclose(leaning, straight, rtol=0, atol=1e-7)
    assert abs(straight[0]) > 1e-3


def test_ray_budgets_behind_leaning_rims_are_areas():
    """Shares past each rim in the order of light, against outlines of rays; nothing is counted."""
    design = mirrored().replace({"stops": ({"distance": 50.0, "diameter": 9.0, "tilt": (0.4, 0.3)},)})
    result = roslf.evaluate(design, [(-3.0, -4.0)])
    field, alone = result.fields[0], outline_by_rays(mirrored(), (-3.0, -4.0))
    whole, both = (outline_by_rays(design, (-3.0, -4.0), only_fap) for only_fap in (True, False))
    shares = {share.name: share.kept for share in field.ray_budget.by_name}
    assert_allclose(shares["mirror 1"], area(alone) / area(whole), rtol=0, atol=2e-5)
    assert_allclose(shares["stop 1"], area(both) / area(whole), rtol=0, atol=2e-5)
    assert field.rays is None
    assert "counted" not in result.method
    assert "upright" in result.method
