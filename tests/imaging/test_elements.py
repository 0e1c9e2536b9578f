"""Pictures through windows, liquids and lenses, against rays traced face by face."""

import math

import mpmath as mp
import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.effects import Budget, plan
from roslf_design.errors import InputError
from roslf_design.imaging.camera import ImageLattice, Region, pixel_centres, planned_camera
from roslf_design.imaging.points import PointSource, point_image
from roslf_design.imaging.render import render
from roslf_design.imaging.trace import RaySampling, Tracer
from roslf_design.imaging.white import WhiteGeometry
from roslf_design.scenes import WHITE_FIELD, Checkerboard, Plane, Points, Scene, Sinusoid
from roslf_design.theory.stop_images import MicrolensImages, stop_discs
from tests.oracles.object_space import object_side

PAPER = roslf.load("paper").replace({"aperture.distance": 117.0})
WATER = {"index": 1.333, "abbe": 55.8}
WINDOW = {"kind": "plate", "distance": 118.0, "thickness": 1.0, "material": {"index": 1.5}, "diameter": 8.0}
RELAY = {"kind": "lens", "distance": 60.0, "focal_length": 250.0, "decentre": (0.2, 0.0)}
IN_WATER = PAPER.replace({"elements": [WINDOW], "object_space.medium": WATER})
RELAYED = PAPER.replace({"elements": [RELAY, WINDOW], "object_space.medium": WATER, "main_lens.focal_plane": 190.0})
ALONE = 0.4
"""Pitch of microlenses that lend no neighbour their light [mm]."""
PINHOLES = [
    *("-microlens_diffraction", "-microlens_defocus", "-fap_diffraction", "-finite_microlens_aperture", "-cos4"),
    *("+overlap", "+object_defocus", "+decentres", "+vignetting"),
]


def heights(design, axis, sensor, microlens, plane):
    """Where rays from places on the sensor through a microlens's middle meet a plane of object space, one axis."""
    elements = []
    for e in design.elements:
        if e.kind == "lens":
            elements.append(("lens", e.distance, e.focal_length, e.decentre[axis]))
        else:
            elements.append(("plate", e.distance, e.thickness, float(e.material.index(design.wavelength))))
    medium, found = float(design.object_space.medium.index(design.wavelength)), []
    for p in sensor:
        slope = (p - microlens) / design.d_2
        height = microlens - slope * design.d_1
        found += object_side(height, slope + height / design.f, elements, medium, [plane])
    return np.array([float(x) for x in found])


@pytest.mark.parametrize("design", [IN_WATER, RELAYED], ids=["window in water", "lens, window in water"])
@pytest.mark.parametrize("nearer", [0.0, 15.0])
def test_a_texture_behind_elements_lies_where_rays_through_every_face_meet_it(design, nearer):
    """Its plane stands where a ruler says; pixels are the mean of the texture over where their rays meet it."""
    design = design.replace({"microlens_array.pitch": ALONE})
    at, wave = design.d_f - nearer, Sinusoid(period=3.0, angle=0.4)
    scene = Scene(objects=(Plane(distance=at, texture=wave, centre=(0.3, 0.1)),))
    lines = plan(design, scene, overrides=[*PINHOLES, "-plate_aberration"])
    camera = planned_camera(design, lines)
    lattice, index = ImageLattice.of(camera), np.array([8, 5])
    axis, image = lattice.microlens(index), lattice.image(index)
    corner = np.round(image / camera.q + np.array(camera.pixels) / 2).astype(int) - 3
    region = Region(*(int(c) for c in corner), 6, 6)
    sub = (np.arange(4) + 0.5) / 4 - 0.5
    grid = [(c[:, None] + sub * design.q).ravel() for c in pixel_centres(camera, region)]
    x, y = (heights(design, k, grid[k], axis[k], at) for k in (0, 1))
    k = 2 * math.pi / wave.period
    phase = k * ((x - 0.3) * math.cos(0.4) + (y[:, None] - 0.1) * math.sin(0.4))
    truth = (0.5 * (1 + np.cos(phase))).reshape(6, 4, 6, 4).mean((1, 3))
    assert np.ptp(truth) > 0.02 if nearer else True
    seen, _ = Tracer.of(design, lines, scene).image(region, RaySampling(1024, 1024, 0.0, 1))
    np.testing.assert_allclose(seen, truth, rtol=0, atol=2e-3)


@pytest.mark.parametrize(
    "design",
    [
        IN_WATER.replace({"elements.0.diameter": 3.0}),
        RELAYED.replace({"stops": ({"diameter": 16.0, "distance": 30.0, "decentre": (0.1, 0.0)},)}),
    ],
    ids=["window cuts", "stop behind a lens"],
)
def test_white_images_behind_elements_have_their_shapes_area(design):
    """Light of whole images: coverage and rays alike add up to the exact area of the common part of all discs."""
    alone = design.replace({"microlens_array.pitch": ALONE})
    lines = plan(alone, overrides=[*PINHOLES, "-plate_aberration"])
    camera = planned_camera(alone, lines)
    lattice, index = ImageLattice.of(camera), np.array([15, 8])
    axis, image = lattice.microlens(index), lattice.image(index)
    images = MicrolensImages(camera, [tuple(axis - lattice.offset)])
    area = float(np.squeeze(images.shapes.area)) / design.q**2
    assert 0.1 < float(np.squeeze(images.shapes.kept_fraction)) < 0.99
    corner = np.round(image / camera.q + np.array(camera.pixels) / 2).astype(int) - 14
    region = Region(*(int(c) for c in corner), 28, 28)
    exact = WhiteGeometry.of(camera, lines).image(region).astype(float).sum()
    rays = Tracer.of(alone, lines, WHITE_FIELD).image(region, RaySampling(1024, 1024, 0.0, 1))[0].astype(float).sum()
    assert exact == pytest.approx(area, rel=1e-5)
    assert rays == pytest.approx(area, rel=1e-3)


@pytest.mark.parametrize("design", [IN_WATER, RELAYED], ids=["window in water", "lens, window in water"])
def test_a_point_behind_elements_is_where_rays_say(design):
    """The middle of its image lies where the rays from it through the FAP land on the microlenses that they meet."""
    z = design.d_f - 8.0
    scene = Scene(objects=(Points(positions=((1.2, -0.7, z),)),))
    rays = ["none", "+object_defocus", "+overlap", "+finite_microlens_aperture"]
    camera = planned_camera(design, plan(design, scene, overrides=rays))
    seen = camera.image_of(1.2, -0.7, z)
    source = PointSource(camera, *(float(part) for part in seen))
    # Two rays seen through the point: where they leave the main lens, face by face they meet in the point itself.
    straight = design.replace({f"elements.{k}.decentre": (0.0, 0.0) for k in range(len(design.elements))})
    for a in (-0.5, 0.8):
        slope = (a - source.x) / source.reach
        height = a + slope * float(camera.seen.d_3)
        elements = [
            ("lens", e.distance, e.focal_length, 0.0)
            if e.kind == "lens"
            else ("plate", e.distance, e.thickness, float(e.material.index(design.wavelength)))
            for e in straight.elements
        ]
        medium = float(design.object_space.medium.index(design.wavelength))
        (met,) = object_side(mp.mpf(height), mp.mpf(slope), elements, medium, [z])
        assert float(met) == pytest.approx(1.2, abs=1e-9)
    whole = Region(0, 0, *camera.pixels)
    image = point_image(source, whole, (), 0.01)
    drawn = render(design, scene, overrides=rays)
    np.testing.assert_array_equal(drawn.pixels, image)
    assert image.sum() == pytest.approx(1.0, abs=0.02)


def test_brightness_falls_off_with_the_angle_at_the_fap():
    """Behind a relay of magnification the chief ray's angle at the FAP counts, not the one at the main lens."""
    design = RELAYED.replace({"elements.0.decentre": (0.0, 0.0)})
    c, d_3 = mp.mpf(4), design.d_3
    # The ray through the FAP's middle: of those through the microlens, the one whose height there is 0.
    elements = [("lens", 60.0, 250.0, 0.0)]
    ends = [object_side(c - s * design.d_1, s + (c - s * design.d_1) / design.f, elements, 1, [d_3])[0] for s in (0, 1)]
    s = -ends[0] / (ends[1] - ends[0])
    height = c - s * design.d_1
    near = object_side(height, s + height / design.f, elements, 1, [d_3 - 1, d_3])
    truth = float(near[1] - near[0])
    slope = 4 * Tracer.of(design, plan(design, overrides=["+cos4"]), WHITE_FIELD).falloff
    assert abs(slope) == pytest.approx(abs(truth), rel=1e-9)


GLASS = {"kind": "plate", "distance": 37.5, "thickness": 22.5, "material": {"index": 1.7, "abbe": 30.0}}
BORE = {"main_lens.focal_plane": 150.0, "main_lens.diameter": 80.0, "elements": [GLASS], "microlens_array.pitch": ALONE}
GLAZED = roslf.load("mismatched-borescope").replace(BORE)
THICK = PAPER.replace({"elements": [{**GLASS, "distance": 121.0}], "main_lens.focal_plane": 350.0})
BOARD = Scene(objects=(Plane(texture=Checkerboard(period=0.42)),))
WAVES = Scene(objects=(Plane(texture=Sinusoid(period=1.0)),))
BY_RAYS = ["-microlens_diffraction", "-microlens_defocus"]


@pytest.mark.usefixtures("near_light")
@pytest.mark.parametrize(
    ("design", "scene", "overrides"),
    [
        (GLAZED, None, BY_RAYS),
        (GLAZED, None, []),
        (THICK, BOARD, BY_RAYS),
        (IN_WATER, WAVES, BY_RAYS),
    ],
    ids=["glass before the FAP", "glass, waves", "thick window", "water"],
)
def test_exact_rays_change_pictures_by_less_than_the_plan_says(design, scene, overrides):
    """In the sensor's corner; by an edge moved by a share of a pixel (`test_honesty`). Above the budget they are on."""
    left_out, on = plan(design, scene, Budget(px=3.0), overrides), plan(design, scene, overrides=overrides)
    assert not left_out.on("plate_aberration")
    assert on.on("plate_aberration") is (on["plate_aberration"].estimate > 0.1)
    width, height = design.pixels
    side, rays = (120, 128) if scene is None else (40, 1024)  # a few images whole; a few microlenses
    region, sampling = (width - side, height - side, side, side), RaySampling(rays, rays, 0.0, 7)
    images = [
        render(design, scene, overrides=[*overrides, f"{sign}plate_aberration"], region=region, sampling=sampling)
        for sign in "+-"
    ]
    size = np.abs(images[0].pixels.astype(float) - images[1].pixels).max()
    assert 0.01 < size <= on["plate_aberration"].estimate


def test_white_images_by_snells_law_are_discs_between_the_edges_that_rays_find():
    """Edges across the field by mpmath; a corner's pixels by sampled rays, as near as the discs say."""
    alone = GLAZED.replace({"microlens_array.pitch": ALONE})
    lines = plan(alone, overrides=[*PINHOLES, "+plate_aberration"])
    camera = planned_camera(alone, lines)
    white = WhiteGeometry.of(camera, lines).by_snell(0.1, alone.wavelength)
    off = white.exact.error / alone.q
    assert 0.001 < off < 0.1
    glass = [("plate", 37.5, 22.5, float(alone.elements[0].material.index(alone.wavelength)))]
    c = 4.0

    def at_fap(p):
        slope = p / alone.d_2
        height = c - slope * alone.d_1
        return object_side(height, slope + height / alone.f, glass, 1, [alone.d_3], True)[0]

    (centres, radii, *_), (first, _) = white.exact.at(np.array([c]), np.array([0.0])), stop_discs(camera, c, 0.0)
    edges = sorted(float(mp.findroot(lambda p, e=e: at_fap(p) - e * alone.D_F / 2, first[0, 0])) for e in (-1, 1))
    seen = centres[0, 0, 0] + radii[0, 0] * np.array([-1, 1])
    np.testing.assert_allclose(seen, edges, rtol=0, atol=white.exact.error)
    assert abs(first[0, 0] - centres[0, 0, 0]) > 2 * white.exact.error
    width, height = alone.pixels
    region = Region(width - 140, height - 140, 70, 70)
    rays, _ = Tracer.of(alone, lines, WHITE_FIELD).image(region, RaySampling(1024, 1024, 0.0, 1))
    image = white.image(region)
    assert np.ptp(image) > 0.9, "an edge is in it"
    np.testing.assert_allclose(image, rays, rtol=0, atol=math.sqrt(2) * off + 0.01)  # along a diagonal; 1024 rays
    tilted = camera.replace({"elements.0.wedge.0": 1e-3})
    assert WhiteGeometry.of(tilted, lines).by_snell(0.1, alone.wavelength) is None


def test_exact_pictures_are_textures_met_by_snells_law():
    """Pinholes and a plane in water: pixels are the texture where mpmath's exact rays meet it, at two wavelengths."""
    design = IN_WATER.replace({"microlens_array.pitch": ALONE})
    wave = Sinusoid(period=3.0)
    colours = (4.5e-4, 6.5e-4)
    scene = Scene(objects=(Plane(distance=300.0, texture=wave),), light={"wavelengths": colours})
    lines = plan(design, scene, overrides=[*PINHOLES, "+plate_aberration"])
    camera = planned_camera(design, lines)
    lattice, index = ImageLattice.of(camera), np.array([20, 0])
    axis, image = lattice.microlens(index), lattice.image(index)
    corner = np.round(image / camera.q + np.array(camera.pixels) / 2).astype(int) - 3
    region = Region(*(int(c) for c in corner), 6, 6)
    sub = (np.arange(4) + 0.5) / 4 - 0.5
    x, y = ((c[:, None] + sub * design.q).ravel() for c in pixel_centres(camera, region))
    truth = 0
    for colour in colours:
        met = []
        for p in x:
            slope = (p - axis[0]) / design.d_2
            height = axis[0] - slope * design.d_1
            plate = [("plate", 118.0, 1.0, float(design.elements[0].material.index(colour)))]
            water = float(design.object_space.medium.index(colour))
            met += object_side(height, slope + height / design.f, plate, water, [300.0], True)
        truth = truth + 0.25 * (1 + np.cos(2 * math.pi / 3 * np.array([float(u) for u in met])))
    seen, _ = Tracer.of(design, lines, scene).image(region, RaySampling(1024, 1024, 0.0, 1))
    assert y.size == x.size
    np.testing.assert_allclose(seen, np.tile(truth.reshape(6, 4).mean(1), (6, 1)), rtol=0, atol=2e-3)
    closed = plan(design, scene, overrides=[*PINHOLES, "-plate_aberration"])
    off, _ = Tracer.of(design, closed, scene).image(region, RaySampling(1024, 1024, 0.0, 1))
    assert np.abs(off - seen).max() > 0.02


def test_window_aberrations_need_a_window():
    with pytest.raises(InputError, match=r"plate_aberration needs something before the main lens"):
        plan(PAPER, overrides=["+plate_aberration"])
