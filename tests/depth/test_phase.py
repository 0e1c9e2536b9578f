"""Places that views see fine texture from: against brute force, limits, and depth away from the focal plane."""

import math
from functools import partial

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.calibration.decoding import Decoder, LightField
from roslf_design.camera import Camera
from roslf_design.depth import geometry
from roslf_design.depth.estimate import PixelNoise, estimate_disparity
from roslf_design.depth.geometry import ArrayGeometry, depth_of
from roslf_design.depth.measure import measure, simulate
from roslf_design.depth.phases import _settled as settled
from roslf_design.depth.phases import _strength as strength_of
from roslf_design.depth.pictures import Framed, PictureOptions, Unexposed, chief_rays, lattice_of
from roslf_design.depth.unmixing import _as_they_stand as as_they_stand
from roslf_design.design import Design
from roslf_design.imaging.camera import Region
from roslf_design.scenes import make_scene
from roslf_design.theory.exit_pupil import microlens_image_diameter, microlens_image_pitch
from roslf_design.theory.image_parts import image_parts, waves_shown
from roslf_design.theory.light import microlens_defocus
from roslf_design.theory.stop_images import MicrolensImages
from tests.depth.made import Texture, fewer_rays

pytestmark = pytest.mark.usefixtures("unpredicted")

PLACES = np.array([-0.4, -0.15, 0.0, 0.3])


def by_brute_force(camera, x, wave, disparity):
    """Wave along x that square microlenses show at a pixel (x, 0) [image pitches], over the light there, by sums."""
    pitch = abs(float(microlens_image_pitch(camera)))
    wide = float(microlens_image_diameter(camera)) / pitch
    spot = float(camera.wavelength * camera.d_2 / camera.d) / pitch
    pixel = float(camera.q) / pitch
    at = (np.arange(120) + 0.5) / 120 - 0.5
    along, down = np.meshgrid(at, at)
    disc = np.hypot(along, down) < 0.5
    fine = ((np.arange(9) + 0.5) / 9 - 0.5) * pixel
    lenses = np.arange(-20, 21)
    # Light through a side of a microlens that is out of focus lands aside, and shows the texture there.
    sides = (np.arange(8) + 0.5) / 8 - 0.5
    blur = float(microlens_defocus(camera) * camera.d) / pitch

    def painted(place, wave):
        """Light from along the FAP by all microlenses, the wave's phase at each side of each turned on it."""
        light = 0
        for side in sides:
            apart = place - lenses[:, None, None] + wide * at[:, None] + fine - blur * side
            turned = np.exp(2j * math.pi * wave * (lenses + side))
            light = light + (turned[:, None] * (np.sinc(apart / spot) ** 2).mean(-1)).sum(0)
        return light / np.exp(2j * math.pi * wave * sides).sum()

    shown = painted(x, wave) * np.exp(-2j * math.pi * wave * disparity * at)
    light = np.multiply.outer(painted(0.0, 0.0), painted(x, 0.0)) * disc
    return (np.multiply.outer(painted(0.0, 0.0), shown) * disc).sum() / light.sum()


@pytest.mark.parametrize(("disparity", "focal_length"), [(0.5, 2.1), (-5.1, 2.0)])
def test_waves_are_shown_as_square_microlenses_paint_them(disparity, focal_length):
    design = roslf.load("paper").replace({"microlens_array.focal_length": focal_length})
    camera, waves = Camera.of(design), np.array([[0.1, 0.0], [0.35, 0.0]])
    shown = waves_shown(MicrolensImages(camera, [(0.0, 0.0)]), PLACES, np.zeros(1), waves, np.array([disparity]))
    for (wave, _), row in zip(waves, shown[0, :, 0, 0], strict=True):
        # Twenty microlenses on each side leave 1/500 of the light out, and the disc has 11,000 points.
        np.testing.assert_allclose(row, [by_brute_force(camera, x, wave, disparity) for x in PLACES], atol=3e-3)


def pictured(camera, texture, disparity, size=20):
    """Light field without noise of a texture before microlenses about the axis, all of its waves as they are shown."""
    pitch = abs(float(microlens_image_pitch(camera))) / float(camera.q)
    side = np.arange(-math.ceil(pitch / 2), math.ceil(pitch / 2) + 1.0)
    u = np.arange(float(size)) - (size - 1) / 2
    places = np.stack(np.meshgrid(u, u), -1).reshape(-1, 2) * float(camera.d)
    whole = (MicrolensImages(camera, places).shapes.kept_fraction >= 1 - 1e-9).all()
    images = MicrolensImages(camera, [(0.0, 0.0)] if whole else places)
    turned = math.copysign(1.0, float(camera.seen.A) * float(camera.seen.D_F)) * disparity
    amplitude, along, down, phase = texture.waves.T
    waves = np.stack([along, down], -1) / (2 * math.pi)
    shown = waves_shown(images, side / pitch, side / pitch, waves, np.array([turned]))[0]
    shown = np.moveaxis(np.broadcast_to(shown, (len(waves), size**2, *shown.shape[2:])), 1, -1)
    wave = amplitude[:, None] * np.exp(1j * (places / float(camera.d) @ np.stack([along, down]) + phase).T)
    values = texture.mean + np.einsum("wtsn,wn->tsn", shown, wave).real
    light = image_parts(images, side / pitch, side / pitch).light.sum(0)
    light = np.moveaxis(np.broadcast_to(light, (size**2, *light.shape[1:])), 0, -1) / light.max()
    light = np.where(light > 0.02, light, 0).reshape(*light.shape[:2], size, size).astype(np.float32)
    return LightField(values.reshape(light.shape).astype(np.float32), light, side, side, u, u, pitch)


def found(design, field, disparity, phases):
    """Disparities of the inner microlenses less the true one, and the standard errors told."""
    viewing, noise = geometry.ArrayGeometry(design).viewing(field), PixelNoise(13000.0, 2.5)
    views = viewing.prepared(field)
    search = disparity - 0.7, disparity + 0.7
    disparities = estimate_disparity(views.field, views.pupil, noise, search=search, aside=views.aside)
    if phases:
        views = viewing.at_phase(views, disparities)
        disparities = estimate_disparity(views.field, views.pupil, noise, search=search, aside=views.aside)
    inner = np.s_[4:-4, 4:-4]
    known = disparities.measured[inner]
    assert known.mean() > 0.9
    return disparities.disparity[inner][known] - disparity, disparities.sigma[inner][known]


@pytest.mark.parametrize(("disparity", "off"), [(5.1, 0.2), (-5.1, 0.15)])
def test_disparities_far_from_the_focal_plane_are_those_of_the_texture(disparity, off):
    design, texture = roslf.load("paper"), Texture.of(3, 0.2, finest=0.4)
    field = pictured(Camera.of(design), texture, disparity)
    before, _ = found(design, field, disparity, False)
    after, told = found(design, field, disparity, True)
    assert abs(before.mean()) > off
    # A third of what light alone makes of each; those near the border look past it.
    assert abs(after.mean()) < told.mean() / 3
    assert after.std() < told.mean()


def test_views_that_disagree_in_bright_light_are_put_in_phase():
    """Five pitches out of focus: by mean places all microlenses of such a wall were at odds, and left so."""
    disparity, noise = 5.1, PixelNoise(100_000.0, 2.5)
    design = roslf.load("paper")
    field = pictured(Camera.of(design), Texture.of(3, 0.2, finest=0.4), disparity)
    viewing, estimate = geometry.ArrayGeometry(design).viewing(field), partial(estimate_disparity, noise=noise)
    views, search = viewing.prepared(field), (disparity - 0.7, disparity + 0.7)
    before = estimate(views.field, views.pupil, search=search, aside=views.aside)
    # What lies beyond the sides is unknown: with half of the views, those at the border agree on a wrong disparity.
    assert before.within(np.s_[5:-5], np.s_[5:-5]).measured.mean() < 0.05
    views = viewing.at_phase(views, before)
    inner = estimate(views.field, views.pupil, search=search, aside=views.aside).within(np.s_[4:-4], np.s_[4:-4])
    assert inner.measured.all()
    assert abs(inner.disparity.mean() - disparity) < inner.error


def test_cut_images_are_seen_from_their_phases_too():
    """Behind a lens that leaves nine tenths of images a millimetre from the axis, three pitches out of focus."""
    design = roslf.load("paper").replace({"main_lens.diameter": 6.0})
    field = pictured(Camera.of(design), Texture.of(3, 0.2, finest=0.4, count=30), 3.0, size=14)
    before, _ = found(design, field, 3.0, False)
    after, told = found(design, field, 3.0, True)
    assert abs(before.mean()) > 0.07
    # All of few microlenses are near the border.
    assert abs(after.mean()) < 0.1 * abs(before.mean())
    assert after.std() < told.mean()


def test_light_that_microlenses_share_tells_disparities_too():
    """Behind a pupil whose images are 1.3 pitches wide, three pitches out of focus."""
    disparity, paper = 3.0, roslf.load("paper")
    design, texture = paper.replace(D_F=1.3 * paper.D_F), Texture.of(3, 0.2, finest=0.4)
    field = pictured(Camera.of(design), texture, disparity)
    _, before = found(design, field, disparity, True)
    off, told = by_shared_light(design, field, disparity)
    assert told.mean() < 0.8 * before.mean()
    assert abs(off.mean()) < told.mean() / 3
    assert off.std() < told.mean()


def by_shared_light(design, field, disparity):
    """Errors of the disparities of the inner microlenses as a measurement has them, and those told."""
    search, noise = (disparity - 0.7, disparity + 0.7), PixelNoise(13000.0, 2.5)
    inner = measure(geometry.ArrayGeometry(design), field, noise, search=search).within(np.s_[4:-4], np.s_[4:-4])
    known = inner.disparities.measured
    assert known.mean() > 0.9
    return inner.disparities.disparity[known] - disparity, inner.disparities.sigma[known]


def test_light_that_microlenses_share_settles():
    """Where images are 1.5 pitches wide disparities would go to and fro by more than the errors told."""
    disparity, paper = 0.2, roslf.load("paper")
    design, texture = paper.replace(D_F=1.5 * paper.D_F), Texture.of(3, 0.2, finest=0.4)
    off, told = by_shared_light(design, pictured(Camera.of(design), texture, disparity), disparity)
    assert abs(off.mean()) < told.mean() / 4
    assert off.std() < told.mean() / 2


def test_waves_are_as_strong_in_a_picture_as_once_it_has_settled():
    """Sent light taken off as strong as the picture shows waves, which then shows them anew, half of each round."""
    rng = np.random.default_rng(1)
    alone, sent = rng.standard_normal((2, 40, 30, 3, 2)) @ np.array([1, 1j])
    alone, sent = 1.0 + 0.2 * alone, 0.3 * sent
    alone[:, :4], sent[:, :4] = 0.0, 0.0  # views that are not used
    strength = np.ones((40, 1, 3))
    for _ in range(80):
        strength += (strength_of(alone - strength * sent) - strength) / 2
    np.testing.assert_allclose(settled(alone, sent), strength, rtol=1e-6)
    # Of so much, turned so, no strength is what it leaves: x^2 = (1 + 1.2 x)^2 has no root above 0.
    assert settled(np.ones((1, 1, 1), complex), np.full((1, 1, 1), -1.2 + 0j)).max() < 5


def test_views_in_focus_are_left_as_they_are():
    design, texture = roslf.load("paper"), Texture.of(3, 0.2, finest=0.4)
    field = pictured(Camera.of(design), texture, 0.0, size=12)
    viewing = geometry.ArrayGeometry(design).viewing(field)
    views = viewing.prepared(field)._replace(aside=None)
    disparities = estimate_disparity(views.field, views.pupil, PixelNoise(13000.0, 2.5), search=(-0.7, 0.7))
    assert viewing.at_phase(views, disparities) is None


def test_depth_away_from_the_focal_plane(monkeypatch):
    """Five pitches out of focus, by mean places 5.2 mm off."""
    fewer_rays(monkeypatch)
    design, distance = roslf.load("paper"), 440.0
    step = float(roslf.quantity("object_sample_mm")(Camera.of(design)))
    finest = 2.5 * step * (distance - design.d_3) / (design.d_f - design.d_3)
    texture = {"kind": "noise", "finest": finest, "contrast": 0.1, "seed": 1}
    scene = make_scene({"objects": [{"kind": "plane", "distance": distance, "texture": texture}]})
    found = simulate(design, scene, PictureOptions(region=(2160, 1400, 280, 280))).summary()
    # A tenth of that: so few rays, and light from 48 pixels around alone, put some of it back.
    assert abs(found.bias_mm) < 0.5
    assert found.spread_mm < 0.6


def test_neighbours_light_is_cut_where_they_stand():
    """A rim moves from one microlens to the next: what a neighbour sends is what it sends at its own place."""
    fap = 1.3 * roslf.load("paper").D_F
    camera = Camera.of(roslf.load("paper").replace({"main_lens.diameter": 24.0, "aperture.diameter": fap}))
    at, u = np.linspace(-0.5, 0.5, 15), np.array([-122.0, -120.0, -118.0])

    def parts(places):
        images = MicrolensImages(camera, [(place * float(camera.d), 0.0) for place in places])
        assert (images.shapes.kept_fraction < 1).all()
        return image_parts(images, at, at)

    some, neighbour = parts(u), parts([-121.0])
    stood = as_they_stand(some, u, np.zeros(1), np.eye(2))
    left, own = some.steps.index((-1, 0)), some.steps.index((0, 0))
    alike, moved = (np.abs(one.light[left, 1] - neighbour.light[left, 0]).max() for one in (some, stood))
    # The cut moves by 0.02 pitches from one to the next; between nodes the rim's profile is nearly straight.
    assert alike > 0.05
    assert moved < 0.1 * alike
    np.testing.assert_allclose(stood.light[own], some.light[own], rtol=0, atol=1e-15)


def test_light_of_cut_images_is_that_of_a_white_picture_where_hexagonal_microlenses_are_out_of_focus():
    """A rim that crosses images within three microlenses, sides of which send light apart: what rays make of it."""
    design = Design.make({
        "name": "out of focus",
        "main_lens": {"focal_length": 25.239, "diameter": 10.707, "focal_plane": 188.8},
        "aperture": {"diameter": 0.42713, "distance": 76.381},
        "microlens_array": {
            "pitch": 0.061357, "focal_length": 1.8871, "size": [3.62, 3.02], "layout": "hexagonal",
            "lens_shape": "circular",
        },
        "sensor": {"distance": 1.8871, "pixel": 5.0695e-3, "size": [3.0214, 2.2661]},
        "light": {"wavelength": 0.000604},
    })  # fmt: skip
    camera, geometry_of = Camera.of(design), ArrayGeometry(design)
    scene = make_scene({"objects": [{"kind": "plane", "distance": design.d_f}]})
    framed = Framed.of(design, scene, Region(27, 129, 100, 150))
    _, white = (image.pixels for image in Unexposed.of(design, scene, framed, rays=64))
    field = Decoder.of(lattice_of(camera, framed.wide), white.shape, reach=geometry_of.reach)(white)
    lenses = geometry_of.viewing(field).light.flat_fielded().hexagonal
    inner = np.zeros(lenses.values.shape[2:], bool)
    inner[3:-3, 3:-3] = True
    evened = lenses.values[(lenses.weight > 0.4) & inner]
    assert evened.size > 2000
    # Neighbours' light in the corners of images is interpolated between microlenses that the rim cuts unlike.
    assert np.sqrt(((evened / np.median(evened) - 1) ** 2).mean()) < 0.1


def test_views_of_images_cut_within_few_microlenses_look_where_gratings_are_seen():
    """A rim that takes images from whole to nothing within four microlenses: pupils and neighbours both differ.

    A microlens's sides see other parts of the FAP: what views see aside for that, whatever the disparity, phases know
    nothing of. Taken for none it moves them by up to half a pitch here.
    """
    design = Design.make({
        "name": "near rim",
        "main_lens": {"focal_length": 6.939, "diameter": 3.0, "focal_plane": 20.5},
        "aperture": {"diameter": 0.1282, "distance": 6.505},
        "microlens_array": {"pitch": 0.05344, "focal_length": 2.13, "size": [4.9, 4.1], "lens_shape": "circular"},
        "sensor": {"distance": 2.13, "pixel": 4.016e-3, "size": [4.088, 3.064]},
        "light": {"wavelength": 0.000525},
    })  # fmt: skip
    camera, geometry_of, region = Camera.of(design), ArrayGeometry(design), Region(880, 350, 70, 50)
    z, d = float(depth_of(camera, np.asarray(0.5))), float(camera.d)

    def middles(places):
        rays = chief_rays(camera, None, places.reshape(-1, 2))
        return (rays[:, 0] - rays[:, 2] * z).reshape(places.shape[:-1])

    apart = float(np.diff(middles(np.array([[0.0, 0.0], [d, 0.0]])))[0])
    period, shown = abs(apart) / 0.12, 0
    for turn, aside in ((1, 0.0), (1j, period / 4)):
        grating = {"kind": "sinusoid", "period": period}
        scene = make_scene({"objects": [{"kind": "plane", "distance": z, "centre": [aside, 0.0], "texture": grating}]})
        framed = Framed.of(design, scene, region)
        picture, white = (image.pixels for image in Unexposed.of(design, scene, framed, rays=64))
        decoder = Decoder.of(lattice_of(camera, framed.wide), white.shape, white=white, reach=geometry_of.reach)
        field = decoder(picture - white / 2)
        views = geometry_of.viewing(field).prepared(field)
        shown = shown + turn * views.field.values
    places = geometry_of.places(field)
    turned = np.angle(shown * np.exp(-2j * math.pi * middles(places) / period))
    off = -turned * period / (2 * math.pi * apart) - 0.5 * views.pupil[0] - views.aside[0]
    kept = MicrolensImages(camera, places.reshape(-1, 2)).shapes.kept_fraction[:, 0].reshape(places.shape[:-1])
    weight = views.field.weight
    light = np.maximum(weight.sum((0, 1)), 1e-9)
    lever = views.pupil[0] - (weight * views.pupil[0]).sum((0, 1)) / light
    bias = (weight * lever * off).sum((0, 1)) / np.maximum((weight * lever**2).sum((0, 1)), 1e-9)
    cut, whole = (np.abs(bias[2:-2, 2:][some[2:-2, 2:]]) for some in ((kept > 0.3) & (kept < 0.9), kept > 0.999))
    assert min(cut.size, whole.size) > 5
    assert cut.max() < 0.03
    assert whole.max() < 0.02
