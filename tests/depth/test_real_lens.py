"""Depth behind a real main lens: views look where traced rays go, and a wall comes out where it stands."""

import math

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.calibration.decoding import LightField
from roslf_design.camera import Camera
from roslf_design.depth import measure as measuring
from roslf_design.depth.geometry import depth_of, disparity_of
from roslf_design.depth.nodes import NodeMap
from roslf_design.depth.pictures import lattice_of
from roslf_design.depth.traced_views import TracedViews
from roslf_design.depth.unmixing import ViewLight
from roslf_design.imaging.camera import Region
from roslf_design.scenes import Noise, Plane, Scene
from roslf_design.theory.exit_pupil import microlens_image_pitch
from roslf_design.theory.image_parts import waves_shown
from roslf_design.theory.light import microlens_defocus
from roslf_design.theory.quantities import QUANTITIES
from roslf_design.theory.stop_images import MicrolensImages
from roslf_design.theory.transfer import MicrolensTransfer
from roslf_design.traced.camera import camera_of, chief_slope, microlenses, sensor_of_pupil, views

pytestmark = pytest.mark.usefixtures("unpredicted")

DISPARITY = 0.3
SINGLET = """
name = "plano-convex, f/3.3"
surfaces = [
    {radius = "inf", thickness = "0.8 mm", glass = "sapphire", diameter = "2 mm"},
    {radius = "-1.463 mm", diameter = "2 mm"},
]
"""
BORE = """
name = "scope of 3 mm"
main_lens = {prescription = "singlet.toml", focal_plane = "9.5 mm"}
aperture = {diameter = "0.57 mm", distance = "0.6 mm"}
sensor = {distance = "68 um", pixel = "1.4 um", size = ["1 mm", "0.5 mm"], full_well = 1e6, read_noise = 0.0}
light = {wavelength = "550 nm", exposure = "0.02 s"}

[[elements]]
kind = "plate"
distance = "1 mm"
thickness = "0.5 mm"
material = "sapphire"

[microlens_array]
pitch = "17 um"
focal_length = "67 um"
size = ["1.1 mm", "0.6 mm"]
layout = "square"
lens_shape = "square"
"""


@pytest.fixture(scope="module")
def design():
    # No more microlenses than are looked at: where the light of each falls is traced beforehand.
    return roslf.load("paper-singlet").replace({"microlens_array.size": (13.0, 2.0)})


class Snell:
    """Rays from the sensor through the middles of microlenses and the lens, surface by surface, in space."""

    def __init__(self, design):
        self.mounted = camera_of(design)
        vertices, indices = [0.0], [1.0]
        for surface in design.lens.surfaces:
            vertices.append(vertices[-1] + surface.thickness)
            indices.append(float(surface.glass.index(design.wavelength)))
        self.faces = list(zip(design.lens.surfaces, vertices, indices, indices[1:], strict=False))[::-1]

    def ray(self, microlens, sensor):
        """A point in front of the lens and the direction there, towards the scene; both (..., 3)."""
        mounted = self.mounted
        at = np.concatenate([microlens, np.full((*microlens.shape[:-1], 1), mounted.array.z)], -1)
        way = at - np.concatenate([sensor, np.full((*sensor.shape[:-1], 1), mounted.detector.z)], -1)
        way /= np.linalg.norm(way, axis=-1, keepdims=True)
        for surface, vertex, front, back in self.faces:
            if surface.curvature == 0:
                at = at + way * ((vertex - at[..., 2:]) / way[..., 2:])
                normal = np.broadcast_to([0.0, 0.0, 1.0], at.shape)
            else:
                middle = np.array([0.0, 0.0, vertex + 1 / surface.curvature])
                along = -((at - middle) * way).sum(-1)
                half = np.sqrt(along**2 - ((at - middle) ** 2).sum(-1) + surface.curvature**-2)
                steps = np.stack([along - half, along + half])
                heights = at[..., 2] + steps * way[..., 2]
                at = at + way * np.take_along_axis(steps, np.abs(heights - vertex).argmin(0)[None], 0)[0][..., None]
                normal = (middle - at) * surface.curvature
            normal = -normal  # along the rays, which go backwards
            ratio, cosine = back / front, (normal * way).sum(-1, keepdims=True)
            way = ratio * way + (np.sqrt(1 - ratio**2 * (1 - cosine**2)) - ratio * cosine) * normal
        return at, way

    def crossing(self, microlens, sensor, z):
        """Point of the plane at `z` in the lens's frame."""
        at, way = self.ray(microlens, sensor)
        return (at + way * ((z - at[..., 2:]) / way[..., 2:]))[..., :2]

    def seeing(self, microlens, pupil):
        """Samples that see points of the FAP (n, 2) [mm], by Newton's method with differences."""
        sensor = microlens * (1 + self.mounted.d_2 / self.mounted.d_1) + 0 * pupil
        for _ in range(8):
            off = self.crossing(microlens + 0 * sensor, sensor, self.mounted.fap.z) - pupil
            columns = [
                (self.crossing(microlens + 0 * sensor, sensor + step, self.mounted.fap.z) - pupil - off) / 1e-5
                for step in 1e-5 * np.eye(2)
            ]
            sensor = sensor - np.linalg.solve(np.stack(columns, -1), off[..., None])[..., 0]
        return sensor

    def image(self, place):
        """Middle of the image of the FAP's rim, and the ellipse nearest to it, linear in pupil diameters."""
        turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
        rim = 0.5 * np.stack([np.cos(turn), np.sin(turn)], -1)
        seeing = self.seeing(place, self.mounted.fap.diameter * rim)
        middle = seeing.mean(0)
        return middle, np.linalg.lstsq(rim, seeing - middle, rcond=None)[0]


@pytest.mark.parametrize("place", [(0.0, 0.0), (3.0, 0.0), (5.6, 1.6), (-4.0, 8.0)])
def test_views_look_where_snell_sends_them(design, place):
    camera, oracle, place = Camera.of(design.thin_twin), Snell(design), np.array(place)
    traced, fap = TracedViews(design, camera, lambda b: depth_of(camera, b)), oracle.mounted.fap
    chief, (middle, ellipse) = oracle.seeing(place, np.zeros((1, 2)))[0], oracle.image(place)
    turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    rim = 0.5 * np.stack([np.cos(turn), np.sin(turn)], -1)
    small = 1e-3 * rim
    ideal = np.linalg.lstsq(small, oracle.seeing(np.zeros(2), fap.diameter * small), rcond=None)[0]
    # The ideal is the lens's own image near the axis, but for its last digits.
    np.testing.assert_allclose(traced.images(place[None])[0], np.linalg.solve(ideal, ellipse), atol=1e-5)
    # Samples on that ellipse of other microlenses see what the first one sees, at two distances.
    points = 0.45 * np.array([[1.0, 0.0], [0.0, 1.0], [-0.6, 0.7]])
    (seen, aside), good = traced.view_coordinates(place[None], points)
    assert good.all()
    samples = points @ ellipse  # from the middle of each image, which centres of a lattice are
    sample = float(QUANTITIES["object_sample_mm"](camera))
    for disparity in (DISPARITY, -0.2):
        z = (
            fap.z
            - (oracle.mounted.fap.z - oracle.mounted.first_order.front_principal)
            - float(depth_of(camera, np.asarray(disparity)))
        )
        target = oracle.crossing(place, chief, z)
        for own, p, e in zip(samples, seen[0], aside[0], strict=True):
            other = place + (disparity * p + e) * design.d
            at = oracle.crossing(other, oracle.image(other)[0] + own, z)
            # What does not go with disparity is next to nothing.
            assert np.abs(at - target).max() < 0.005 * sample
    # What this microlens's samples see in the focal plane is seen so far aside by middles of others.
    z = oracle.mounted.first_order.front_principal - float(depth_of(camera, np.asarray(0.0)))
    for own, beside in zip(samples, traced.aside(place[None], points.T[:, None])[:, 0].T, strict=True):
        target = oracle.crossing(place, middle + own, z)
        other = place - beside * design.d
        at = oracle.crossing(other, oracle.seeing(other, np.zeros((1, 2)))[0], z)
        assert np.abs(at - target).max() < 0.005 * sample


def test_light_of_neighbours_falls_where_snell_sends_it():
    # A quarter of a per cent nearer than by first order, which moved walls by 0.01 to 0.02 pitches.
    design, place = roslf.load("paper-singlet"), np.array([-7.7, 5.6])
    camera, oracle = Camera.of(design.thin_twin), Snell(design)
    pitch, at = abs(float(microlens_image_pitch(camera) / camera.q)), np.arange(-26.0, 27.0)
    blank = np.ones((at.size, at.size, 1, 1), np.float32)
    like = LightField(blank, blank, at, at, place[:1] / design.d, place[1:] / design.d, pitch)
    light = ViewLight(camera, like, TracedViews(design, camera, lambda b: depth_of(camera, b)))
    own, (_, _, parts) = oracle.image(place)[0], light.parts
    for step in ((1, 0), (0, -1)):
        middle = (oracle.image(place + np.multiply(step, design.d))[0] - own) / float(camera.q)
        # Light on one side of it is that on the other; far tails of diffraction are left out.
        x, y = (np.where(np.abs(away) < pitch, away, 0.0) for away in (at - middle[0], at - middle[1]))
        near = np.outer(np.cos(np.pi * y / 2 / pitch) ** 2 * (y != 0), np.cos(np.pi * x / 2 / pitch) ** 2 * (x != 0))
        shown = parts.light[parts.steps.index(step), 0] * near
        off = np.array([(shown * x).sum(), (shown.T * y).sum()]) / shown.sum()
        assert np.abs(off).max() < 5e-4 * pitch


def test_light_of_cut_images_is_where_rays_come_through():
    # Of cut images a scale stood for what the lens makes of their shape: light at their rims was .02 and more off.
    design = roslf.load("paper-singlet").replace({"main_lens.diameter": 16.0})
    camera, oracle, fine = Camera.of(design.thin_twin), Snell(design), 8
    place, at = np.array([5.4, 2.6]), np.arange(-6.0, 7.0)
    pitch, pixel = abs(float(microlens_image_pitch(camera))), float(camera.q)
    blank = np.ones((at.size, at.size, 1, 1), np.float32)
    like = LightField(blank, blank, at, at, place[:1] / design.d, place[1:] / design.d, pitch / pixel)
    _, _, parts = ViewLight(camera, like, TracedViews(design, camera, lambda b: depth_of(camera, b))).parts
    middle, half = oracle.image(place)[0], fine * round(2 * pitch / pixel)
    grid = np.arange(-half, half) / fine * pixel
    points = middle + np.stack(np.meshgrid(grid, grid), -1)
    frequency = np.fft.fftfreq(2 * half, pixel / fine)
    lens = MicrolensTransfer(
        float(camera.d), float(camera.seen.d_2), float(-microlens_defocus(camera) / camera.seen.d_2),
        (float(camera.wavelength),), camera.lens_shape,
    )  # fmt: skip
    boxes = np.sinc(frequency * pixel)
    passed, there = lens(frequency, frequency[:, None]) * boxes * boxes[:, None], half + fine * at.astype(int)
    for step in ((0, 0), (1, 0), (0, -1)):  # neighbours are taken to be cut as here
        rays = views(oracle.mounted, place + np.multiply(step, design.d), points, clip=False)
        lit = np.minimum(rays.fap_margin, rays.margin) >= 0
        wanted = np.fft.ifft2(np.fft.fft2(lit) * passed).real[np.ix_(there, there)]
        np.testing.assert_allclose(parts.light[parts.steps.index(step), 0], wanted, atol=0.007)


def test_images_are_cut_as_far_as_rays_come_through():
    # To 68 %; by first order to another share, and walls there were once told of as if images were whole.
    design, place = roslf.load("paper-singlet").replace({"main_lens.diameter": 16.0}), np.array([5.4, 0.0])
    camera, oracle = Camera.of(design.thin_twin), Snell(design)
    by_first_order = MicrolensImages(camera, place[None])
    cut = TracedViews(design, camera, lambda b: depth_of(camera, b)).cut(by_first_order)
    side = np.linspace(-0.5, 0.5, 61)
    points = np.stack(np.meshgrid(side, side), -1).reshape(-1, 2)
    pupil = oracle.mounted.fap.diameter * points[np.hypot(*points.T) < 0.5]
    share = (views(oracle.mounted, place, oracle.seeing(place, pupil), clip=False).margin >= 0).mean()
    assert cut.shapes.kept_fraction.item() == pytest.approx(share, abs=0.02)
    assert abs(by_first_order.shapes.kept_fraction.item() - share) > 0.04


def test_images_between_those_worked_out_are_as_snell_has_them(design):
    # They grow with the square of the height: linear from corner to corner they were 0.2 % off, and rims of images that
    # touch then give light to the wrong microlens, which looks a pitch aside.
    camera, oracle = Camera.of(design.thin_twin), Snell(design)
    u, v = 18 + np.arange(33.0), -16 + np.arange(33.0)
    blank = np.ones((1, 1, v.size, u.size), np.float32)
    like = LightField(blank, blank, np.zeros(1), np.zeros(1), u, v, 10.0)
    light = ViewLight(camera, like, TracedViews(design, camera, lambda b: depth_of(camera, b)))
    rows, columns, _ = light.nodes
    known = np.stack([oracle.image(place)[1] for place in light.places[np.ix_(rows, columns)].reshape(-1, 2)])
    over = NodeMap.of_views(rows, columns, (v.size, u.size))(np.moveaxis(known, 0, -1))
    some = [(4, 4), (16, 16), (8, 24), (27, 5)]
    off = [over[..., row, column] - oracle.image(light.places[row, column])[1] for row, column in some]
    assert np.abs(off).max() < 1e-3 * np.abs(known).max()


def test_views_between_places_worked_out_look_as_snell_has_them():
    # .035 pitches off they were, linear from corner to corner of 23 microlenses, and their phases a tenth of it: a wall
    # stood .005 pitches off.
    design = roslf.load("paper-singlet").replace({
        "main_lens.prescription": "AC254-100-A", "main_lens.reversed": True, "main_lens.focal_plane": 380.0,
        "aperture.diameter": 3.3, "aperture.distance": 155.0, "microlens_array.pitch": 0.034,
        "microlens_array.focal_length": 0.66, "sensor.distance": 0.66,
    })  # fmt: skip
    camera, oracle = Camera.of(design.thin_twin), Snell(design)
    u, v = -108 + np.arange(23.0), 24 + np.arange(23.0)
    blank = np.ones((1, 1, v.size, u.size), np.float32)
    like = LightField(blank, blank, np.zeros(1), np.zeros(1), u, v, 10.0)
    light = ViewLight(camera, like, TracedViews(design, camera, lambda b: depth_of(camera, b)))
    z = oracle.mounted.first_order.front_principal - float(depth_of(camera, np.asarray(0.0)))

    def beside(place):
        """How far a point of the FAP's rim sees aside of the chief ray [pitches]."""
        middle, ellipse = oracle.image(place)
        around = place + design.d * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
        chief = np.stack([oracle.crossing(c, oracle.seeing(c, np.zeros((1, 2)))[0], z) for c in around])
        steps = np.stack([chief[1] - chief[2], chief[3] - chief[4]], -1) / 2
        return np.linalg.solve(steps, oracle.crossing(place, middle + ellipse[0] / 2, z) - chief[0])

    rows, columns, _ = light.nodes
    known = np.stack([beside(place) for place in light.places[np.ix_(rows, columns)].reshape(-1, 2)])
    over = NodeMap.of_views(rows, columns, (v.size, u.size))(known.T)
    some = [(11, 11), (6, 17), (2, 5)]
    off = [over[..., row, column] - beside(light.places[row, column]) for row, column in some]
    assert np.abs(off).max() < 0.01


@pytest.mark.parametrize("focal_length", [2.1, 2.0])
def test_waves_behind_a_lens_without_faults_are_those_of_an_ideal_one(focal_length):
    # Out of focus on the FAP, each side of a microlens puts what it sees elsewhere on the sensor.
    design = roslf.load("paper").replace({"microlens_array.focal_length": focal_length})
    camera = Camera.of(design)
    pitch = abs(float(microlens_image_pitch(camera) / camera.q))
    at, u, disparities = np.array([-0.4, -0.15, 0.0, 0.3]), np.arange(4.0), np.array([-2.0, 0.5])
    blank = np.ones((4, 4, 4, 4), np.float32)
    field = LightField(blank, blank, at * pitch, at * pitch, u, u, pitch)
    places, waves = np.array([[0.5, 0.3]]), np.array([[0.1, 0.0], [0.2, -0.35]])
    side = math.copysign(1.0, float(camera.seen.A * camera.seen.D_F))
    ideal = waves_shown(MicrolensImages(camera, places), at, at, waves, side * disparities)
    traced = TracedViews(design, camera, lambda b: depth_of(camera, b)).shown(field, places, waves, disparities)
    for (shown, _), wanted in zip(traced, ideal, strict=True):
        # Images stand on a grid of 32 points a pitch, and light of microlenses beyond the next is left out.
        np.testing.assert_allclose(shown, wanted, atol=0.01)


def test_a_wall_stands_where_it_is(design, monkeypatch):
    # 8.2 mm off the axis astigmatism and field curvature move views by three and a half pitches to each side, and light
    # of neighbours in them sees as far away; half of the wall was unknown there.
    monkeypatch.setattr(measuring, "with_shared_light", lambda *given: given[4:6])  # as far aside, with less noise
    design = design.replace({"microlens_array.size": (19.0, 2.0), "light.exposure": 1.5e-3})
    camera = Camera.of(design.thin_twin)
    z = float(depth_of(camera, np.asarray(DISPARITY)))
    texture = Noise(finest=5 * float(QUANTITIES["object_sample_mm"](camera)), contrast=0.2, seed=5)
    scene = Scene(objects=(Plane(distance=z, texture=texture),))
    width, height = camera.pixels
    region = (width // 2 - 52 + 1690, height // 2 - 52, 104, 104)
    trial = roslf.measure_depth(design, scene, region=region, rays=100)
    first = trial.first
    assert first.measured.mean() > 0.95
    off = first.disparities.disparity[first.measured] - disparity_of(camera, np.array([z]))
    # Windows of 25 microlenses err by themselves: of their mean three standard errors; .06 pitches where views lie
    # farthest off, where one in three textures is .02 off. As if of an ideal lens it would be half a pitch.
    errors = first.disparities.sigma[first.measured]
    assert abs(off.mean()) < 3 * float(np.sqrt(np.mean(errors**2) / (off.size / 25)))


def test_a_wall_behind_a_fast_singlet_stands_where_it_is_but_for_noise(tmp_path):
    # Views lie up to 1.2 pitches aside on the axis. Rays of a pixel that came more from its side of the microlens made
    # .021 pitches of bias, light of a sample that was spread over the pupil as middles see it .005.
    singlet, bore = tmp_path / "singlet.toml", tmp_path / "bore.toml"
    singlet.write_text(SINGLET)
    bore.write_text(BORE)
    design = roslf.load(bore)
    camera, (width, height) = Camera.of(design.thin_twin), design.pixels
    texture = Noise(finest=2.5 * float(QUANTITIES["object_sample_mm"](camera)), contrast=0.1, seed=5)
    scene = Scene(objects=(Plane(distance=float(depth_of(camera, np.asarray(0.2))), texture=texture),))
    region = (width // 2 - 90, height // 2 - 75, 180, 150)
    trial = roslf.measure_depth(design, scene, region=region, rays=64)
    off = trial.first.disparities.disparity[trial.compared] - 0.2
    assert off.size > 20
    assert abs(off.mean()) < 0.005


def test_centres_of_images_follow_distortion_over_the_whole_sensor():
    """Of what a regular lattice leaves at the sides, or the fifth order's .08 px, depth makes bias."""
    design = roslf.load("paper-singlet")
    camera, strip = Camera.of(design.thin_twin), Region(300, 1462, 4000, 156)
    traced, regular = TracedViews(design, camera, lambda b: depth_of(camera, b)), lattice_of(camera, strip)
    indices = regular.inside((strip.rows, strip.columns))
    lattice = traced.lattice(regular, indices, float(camera.q))
    some = indices[3::97]
    c = microlenses(design, some * float(camera.d))
    middle = sensor_of_pupil(traced.mounted, c, traced.mounted.fap.centre)
    first = c + traced.mounted.d_2 * chief_slope(traced.mounted, c, traced.mounted.fap.centre)
    moved = (middle.sensor + traced.image_maps(c)[1] - first) / float(camera.q)
    off = lattice.nodes(*some.T) - regular.nodes(*some.T) - moved
    columns = np.concatenate([np.ones((len(some), 1)), some], -1)
    straight = moved - columns @ np.linalg.lstsq(columns, moved, rcond=None)[0]
    assert np.abs(off).max() < 0.005
    assert np.abs(straight).max() > 100 * np.abs(off).max()


TRIPLET = """
name = "triplet, 5 mm"
surfaces = [
    {radius = "2.2586 mm", thickness = "0.45 mm", glass = "N-SK16", diameter = "2.5 mm"},
    {radius = "-44.71 mm", thickness = "0.56 mm", diameter = "2.5 mm"},
    {radius = "-2.2791 mm", thickness = "0.12 mm", glass = "F2", diameter = "1.8 mm"},
    {radius = "2.0820 mm", thickness = "0.42 mm", diameter = "1.8 mm"},
    {radius = "8.1755 mm", thickness = "0.6 mm", glass = "N-SK16", diameter = "2.4 mm"},
    {radius = "-1.8874 mm", diameter = "2.4 mm"},
]
"""
HEAD = """
name = "head behind a triplet"
main_lens = {prescription = "triplet.toml", focal_plane = "63.5 mm"}
aperture = {diameter = "1.66 mm", distance = "-0.2 mm"}
sensor = {distance = "35.7 um", pixel = "2 um", pixels = [2592, 1944]}

[microlens_array]
pitch = "10.9 um"
focal_length = "35.7 um"
size = ["5.4 mm", "4.1 mm"]
layout = "square"
lens_shape = "square"
"""


def test_centres_of_images_do_not_run_away_where_rays_fold_in_the_corner(tmp_path):
    """What polynomials of those that come through say of the others: they multiplied 1e-4 px by 4e5 and overflowed."""
    (tmp_path / "triplet.toml").write_text(TRIPLET)
    (tmp_path / "head.toml").write_text(HEAD)
    design = roslf.load(tmp_path / "head.toml")
    camera, shares = Camera.of(design.thin_twin), []
    traced = TracedViews(design, camera, lambda b: depth_of(camera, b))
    for part in (Region(2238, 1638, 354, 284), Region(2404, 1754, 188, 190), Region(2492, 1844, 100, 100)):
        size, regular = (part.rows, part.columns), lattice_of(camera, part)
        indices = regular.inside(size)
        lattice = traced.lattice(regular, indices, float(camera.q))
        c = microlenses(design, indices * float(camera.d))
        middle = sensor_of_pupil(traced.mounted, c, traced.mounted.fap.centre)
        first = c + traced.mounted.d_2 * chief_slope(traced.mounted, c, traced.mounted.fap.centre)
        _, shift, whole = traced.image_maps(c)
        moved = lattice.nodes(*indices.T) - regular.nodes(*indices.T)
        off = moved - (middle.sensor + shift - first) / float(camera.q)
        assert np.abs(off[whole]).max(initial=0) < 0.05
        assert np.abs(moved).max() < 3
        assert 0.9 < len(lattice.inside(size)) / len(indices) < 1.2
        shares.append(whole.mean())
    assert shares[0] > 0.5 > shares[1] > 0.1 > shares[2]


def test_where_rays_fold_nothing_is_said_of_where_views_look(tmp_path):
    """What is said is what polynomials over a few microlenses say, next to exact; E runs over 18 pitches there."""
    (tmp_path / "triplet.toml").write_text(TRIPLET)
    (tmp_path / "head.toml").write_text(HEAD)
    design = roslf.load(tmp_path / "head.toml")
    camera = Camera.of(design.thin_twin)
    traced = TracedViews(design, camera, lambda b: depth_of(camera, b))
    view = np.arange(-2.0, 3.0)
    pupil = np.stack(np.meshgrid(view, view)) / 6

    def slopes(u, v):
        """How far views see to the side over the pupil's width along u, shape (v, u) [pitches]; NaN where unknown."""
        light = np.ones((5, 5, len(v), len(u)), np.float32)
        field, nodes = LightField(light, light, view, view, u, v, 5.45), np.arange(0, len(u), max(1, len(u) // 6))
        seen, aside = traced.sight(field, pupil, (nodes, nodes))
        slope = np.einsum("s,sji->ji", view * 6 / (view @ view), aside[0, 2])
        return np.where(np.isfinite(seen).all((0, 1, 2)), slope, np.nan)

    pitch = float(camera.d)
    inside, corner = ((1.6, 1.2), (2.1, 1.6)), ((1.81, 1.33), (2.54, 1.92))
    shares = []
    for low, high in (inside, corner):
        u, v = (np.round(np.linspace(a, b, 24) / pitch) for a, b in zip(low, high, strict=True))
        told = slopes(u, v)
        shares.append(np.isfinite(told).mean())
        for row, column in np.argwhere(np.isfinite(told))[::150]:
            near = slopes(u[column] + np.arange(-1.0, 2.0), v[row] + np.arange(-1.0, 2.0))[1, 1]
            assert abs(told[row, column] - near) < 0.1
    assert shares[0] > 0.5 > 0.1 > shares[1]
