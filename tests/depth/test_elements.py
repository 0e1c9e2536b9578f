"""Depth behind windows, liquids and an objective: views look where exact rays go; a wall comes out where it stands."""

import math

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given, settings

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.depth.geometry import ArrayGeometry, depth_of, disparity_of
from roslf_design.depth.pictures import default_scene
from roslf_design.depth.traced_views import STEP, TracedViews
from roslf_design.imaging import transfer
from roslf_design.scenes import Noise, Plane, Scene
from tests.oracles.object_space import object_side
from tests.oracles.relays import relay_scopes

pytestmark = pytest.mark.usefixtures("unpredicted")

WATER = {"index": 1.333, "abbe": 55.8}
WINDOW = {"kind": "plate", "distance": 118.0, "thickness": 25.0, "material": {"index": 1.5}, "diameter": 60.0}
IN_WATER = roslf.load("paper").replace(
    {"elements": [WINDOW], "object_space.medium": WATER, "main_lens.focal_plane": 300.0, "aperture.distance": 110.0}
)


class Meridional:
    """A design's views in one plane, face by face in mpmath."""

    def __init__(self, design):
        self.design, self.camera = design, Camera.of(design)
        self.elements = [
            ("lens", e.distance, e.focal_length, 0.0)
            if e.kind == "lens"
            else ("plate", e.distance, e.thickness, float(e.material.index(design.wavelength)))
            for e in design.elements
        ]
        self.medium = float(design.object_space.medium.index(design.wavelength))

    def heights(self, microlens, slope, planes, exact=True):
        """Where the ray from a microlens that arrives there with a slope meets planes of object space."""
        d = self.design
        height = microlens - slope * d.d_1
        return object_side(height, slope + height / d.f, self.elements, self.medium, planes, exact)

    def height(self, microlens, sample, plane):
        """Where a sample looks, counted from where the chief ray falls [mm]."""
        stop = self.design.aperture.distance
        middle = mp.findroot(lambda slope: self.heights(microlens, slope, [stop])[0], (0.0, 1e-3), tol=1e-26)
        return self.heights(microlens, middle + sample / self.design.d_2, [plane])[0]

    def by_first_order(self, pupil):
        """Sample that sees a point of the FAP, by first order [mm]."""
        stop = self.design.aperture.distance
        first = [self.heights(mp.mpf(0), slope, [stop], exact=False)[0] for slope in (mp.mpf(0), mp.mpf(1))]
        return mp.mpf(pupil) * self.design.D_F / (first[1] - first[0]) * self.design.d_2

    def aside(self, microlens, sample, plane):
        """How many pitches on a sample of another microlens sees what this one's middle sees at a plane."""
        at = self.height(microlens, 0, plane)
        d = self.design.d
        return mp.findroot(lambda u: self.height(microlens + u * d, sample, plane) - at, (0.0, 0.1), tol=1e-22)


@pytest.mark.parametrize(
    ("design", "fields"),
    [(IN_WATER, (0.0, 5.0, 11.0)), (roslf.load("cystoscope"), (0.0, 1.8))],
    ids=["thick window in water", "relay, objective and window in water"],
)
def test_views_look_where_exact_rays_meet_the_scene(design, fields):
    geometry, oracle = ArrayGeometry(design), Meridional(design)
    camera = geometry.camera
    step = min(STEP, 0.25 * abs(float(disparity_of(camera, 1e9))))
    near, focal, far = (float(z) for z in geometry.depth(np.array([step, 0.0, -step])))
    for sample in (0.45, -0.3):
        own = sample * math.copysign(1.0, float(camera.seen.A * camera.seen.D_F * camera.fap.plane.magnification))
        looks, good = geometry.traced.view_coordinates(np.array([(x, 0.0) for x in fields]), np.array([[sample, 0.0]]))
        assert good.all()
        # Samples lie at points of the ellipses nearest to images.
        image, shift, _ = geometry.traced.image_maps(np.array([(x, 0.0) for x in fields]))
        at = zip(fields, looks[0, :, 0, 0], looks[1, :, 0, 0], image[:, 0, 0], shift[:, 0], strict=True)
        for field, pupil, aside, wider, off in at:
            with mp.workdps(30):
                c = mp.mpf(field)
                place = oracle.by_first_order(own) * mp.mpf(wider) + mp.mpf(off)
                each = [oracle.aside(c, place, plane) for plane in (near, focal, far)]
            assert pupil == pytest.approx(float((each[0] - each[2]) / (2 * step)), abs=3e-9)
            assert aside == pytest.approx(float(each[1]), abs=3e-9)
            # Not much is left that does not go with the disparity.
            assert abs(float(each[0] + each[2] - 2 * each[1])) / 2 < 1e-3 * step


@pytest.mark.parametrize(
    ("name", "disparity", "aside", "finest", "least", "around"),
    [
        # A thick prism and a window in saline, near the edge: by first order it would come out 0.11 pitches off.
        ("arthroscope", 0.3, 450, 5, 0.8, 48),
        # Objective and window in water: where brightness falls off in pixels otherwise than in the white image, this
        # wall, which shows little, comes out 0.06 pitches off. With light from nearer by alone most of it is unknown.
        ("cystoscope", 0.4, 0, 10, 0.6, 96),
    ],
)
def test_a_wall_stands_where_it_is(name, disparity, aside, finest, least, around, monkeypatch):
    monkeypatch.setattr(transfer, "LEAST_HALO", around)
    monkeypatch.setattr(transfer, "LEAST_PITCHES", 0)
    design = roslf.load(name)
    camera = Camera.of(design)
    z = float(depth_of(camera, np.asarray(disparity)))
    seen = camera.plane(z)
    # A microlens's footprint there.
    sample = float(
        camera.d * camera.seen.inverse_m * abs(seen.magnification) * (seen.distance - camera.seen.d_3) / camera.seen.gap
    )
    scene = Scene(objects=(Plane(distance=z, texture=Noise(finest=finest * sample, contrast=0.2, seed=1)),))
    width, height = camera.pixels
    region = (width // 2 - 60 + aside, height // 2 - 60, 120, 120)
    runs = roslf.measure_depth(design, scene, region=region, rays=64, exposures=4).runs
    assert min(run.measured.mean() for run in runs) > least
    # One window and a half of up to 0.04 pitches each, by noise: four exposures leave half, and rays less.
    off = [float((run.disparities.disparity[run.measured] - disparity).mean()) for run in runs]
    assert abs(np.mean(off)) < 0.03


@given(relay_scopes())
@settings(max_examples=10)
def test_the_wall_looked_at_by_default_stands_in_view_behind_any_relay(scope):
    nearest, farthest = default_scene(scope).brief(scope).distances
    assert float(Camera.of(scope).tip) < nearest < scope.d_f < farthest < math.inf


def test_views_through_a_rectangle_and_a_thin_window_look_from_where_first_order_has_them():
    """In D_F, the wider extent of the rectangle, not in the diameter of the circle that holds it."""
    window = {"kind": "plate", "distance": 60.0, "thickness": 1e-3, "material": {"index": 1.5}}
    box = {"shape": "rectangle", "sides": (2.5, 1.7), "turn": 0.35, "distance": 120.0}
    design = roslf.load("paper").replace({"elements": [window], "aperture": box})
    camera = Camera.of(design)
    traced = TracedViews(design, camera, lambda b: depth_of(camera, b))
    places = np.array([[0.0, 0.0], [4.0, -2.0]])
    for matrices in (traced.images(places), traced.bends(places)[0]):
        np.testing.assert_allclose(matrices, np.broadcast_to(np.eye(2), (2, 2, 2)), atol=1e-4)
    sample = np.array([[0.2, -0.1]])
    looks, good = traced.view_coordinates(places, sample)
    assert good.all()
    np.testing.assert_allclose(looks[0, :, 0], np.broadcast_to(sample, (2, 2)), rtol=1e-4)
    np.testing.assert_allclose(looks[1], 0, atol=1e-4)
