"""Bayer patterns against lists by hand, Fourier transforms, pictures of single colours and their differences."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

import roslf_design as roslf
from roslf_design.calibration.decoding import Decoder
from roslf_design.calibration.frames import ColourBalance
from roslf_design.camera import Camera
from roslf_design.depth.pictures import lattice_of
from roslf_design.imaging.camera import Region
from roslf_design.imaging.render import render
from roslf_design.imaging.trace import RaySampling
from roslf_design.imaging.white import white_patch
from roslf_design.scenes import Noise, Plane, Scene, SceneError
from roslf_design.theory.colours import FILTERS, mosaic
from roslf_design.theory.depth_error import seen_at
from roslf_design.theory.disparity_error import _disparity_information, disparity_sigma
from roslf_design.theory.disparity_information import Spectrum
from roslf_design.theory.photometry import electrons, exposure, response, through_filter
from roslf_design.theory.quantities import QUANTITIES
from roslf_design.theory.resolution import fold
from roslf_design.theory.stop_images import MicrolensImages
from roslf_design.tolerancing.metrics import Question, evaluate_builds
from roslf_design.traced.fields import images_of
from studies.depth.prediction_proof import rendered_information

PAPER = roslf.load("paper")
BAYER = PAPER.replace({"sensor.colours": "GRBG"})
REGION = (2201, 1440, 78, 66)
COARSE = {"region": REGION, "sampling": RaySampling(16, 16, 0.0)}
WALL = Scene(objects=(Plane(texture=Noise(finest=0.4, contrast=0.15, seed=3)),))


def least_period(lit):
    """Longest period that a set of places, on an even grid, turns into one of its own: 1 over the least frequency."""
    spectrum = np.abs(np.fft.fft2(lit))
    frequency = np.fft.fftfreq(len(lit))
    there = np.argwhere(spectrum > 1e-6 * spectrum.max())
    away = np.hypot(*frequency[there].T)
    return 1 / away[away > 0].min()


def test_patterns_by_hand():
    """The first two rows of four; a region starts where the sensor's pattern has it."""
    names = {k: one.letter for k, one in enumerate(FILTERS)}
    for pattern, rows in (("RGGB", ("RGRG", "GBGB")), ("GBRG", ("GBGB", "RGRG"))):
        assert ["".join(names[k] for k in row) for row in mosaic(pattern, 0, 0, 4, 2)] == list(rows)
    assert ["".join(names[k] for k in row) for row in mosaic("RGGB", 3, 1, 3, 2)] == ["BGB", "GRG"]
    counts = np.bincount(mosaic("BGGR", 0, 0, 8, 8).ravel())
    assert_allclose(counts / 64, [one.share for one in FILTERS])


def test_spacing_of_a_colour_and_of_views_in_it():
    """A colour's pixels repeat detail about frequencies of one over their spacing; so do microlenses where their images
    are an odd number of pixels apart, and one pixel of each is taken."""
    pixels = mosaic("RGGB", 0, 0, 32, 32)
    lenses = pixels[(np.arange(32)[:, None] * 13 + 5) % 32, (np.arange(32) * 13 + 6) % 32]
    sheet = roslf.specification(BAYER)
    at_object = float(QUANTITIES["object_sample_mm"](Camera.of(BAYER)))
    for k, (one, told) in enumerate(zip(FILTERS, sheet.colours, strict=True)):
        assert least_period(pixels == k) == pytest.approx(one.spacing)
        assert told.view_fold_lp_per_mm == pytest.approx(1 / (2 * least_period(lenses == k) * at_object))
        assert told.views_across == pytest.approx(sheet.views_across / least_period(pixels == k))
    assert float(fold(Camera.of(BAYER))) == float(fold(Camera.of(PAPER)))  # of all colours together


def test_electrons_of_a_colour_by_hand():
    """A third of white light's power in each band, 1e5 lx, 30 % reflectance, 1/60 s; brightest where none is named."""
    camera = Camera.of(BAYER.replace({"light.exposure": 1 / 60}))
    watts = 1e5 * 0.3 / np.pi / 683 * (4.847826e-6) ** 2 * (63e-6 / 2e-3) ** 2 * 0.95 / 3
    by_hand = []
    for one, taken in zip(FILTERS, (0.7, 0.8, 0.7), strict=True):
        photons = watts / 60 * one.wavelength * 1e-3 / (6.62607015e-34 * 299_792_458)
        by_hand.append(photons * 0.7 * taken)
        assert float(electrons(through_filter(camera, one))) == pytest.approx(by_hand[-1], rel=1e-6)
    assert float(electrons(camera)) == pytest.approx(max(by_hand), rel=1e-6)
    bright = Camera.of(BAYER.replace({"light.illuminance": 1e6}))  # half the well of the brightest colour
    assert float(electrons(bright)) == pytest.approx(0.5 * 10_500)
    assert float(exposure(bright)) < 1 / 60


def test_information_against_differences_of_rendered_mosaics(light_from_48_px):
    """To 2 % of sigma, for a grating along x: what pixels of all colours tell adds up."""
    design, periods = BAYER.replace({"light.exposure": 0.004}), 0.25
    camera = Camera.of(design)
    wave = Spectrum(np.array([periods]), np.zeros(1), np.full(1, 0.5**2 / 2 * np.sinc(periods) ** 2))
    seen = seen_at(camera, None)._replace(disparity=np.asarray(0.5))
    ours = float(_disparity_information(MicrolensImages(camera, [(0.0, 0.0)]), seen, wave)[0, 0])
    brute = rendered_information(design, (0.0, 0.0), periods, 0.0, 0.5, rays=32)
    assert math.sqrt(brute / ours) == pytest.approx(1.0, abs=0.02)
    grey = Camera.of(design.replace({"sensor.colours": "mono"}))
    assert ours < 0.5 * float(_disparity_information(MicrolensImages(grey, [(0.0, 0.0)]), seen, wave)[0, 0])


def test_a_mosaic_is_put_together_from_pictures_in_each_colour(near_light):
    image = render(BAYER, WALL, **COARSE).pixels
    own = mosaic("GRBG", *REGION)
    signals = [0.7 * 600, 0.8 * 535, 0.7 * 460]
    white = render(BAYER, region=REGION).pixels
    patch = white_patch(BAYER, slice(2201, 2231), slice(1440, 1460))
    for k, one in enumerate(FILTERS):
        light = WALL.in_light((one.wavelength,))
        plan = roslf.effects.plan(BAYER, WALL)
        bare = render(PAPER, light, effects=plan, **COARSE).pixels * np.float32(signals[k] / max(signals))
        assert_allclose(image[own == k], bare[own == k], rtol=1e-6)
        even = render(PAPER, Scene().in_light((one.wavelength,)), region=REGION).pixels * signals[k] / max(signals)
        assert_allclose(white[own == k], even[own == k], atol=2e-3)  # by a series, or not
    # What is shown of single images, as exact as white_patch says.
    assert_allclose(patch, white[:20, :30], atol=1e-2)


def test_the_white_image_makes_colours_equal(near_light):
    """Views of a mosaic are those of a grey sensor, but for what wavelengths blur and interpolation mixes: 1 % rms."""
    camera, shape = Camera.of(BAYER), REGION[:1:-1]
    lattice = lattice_of(camera, Region(*REGION))
    white, raw = (render(BAYER, scene, region=REGION).pixels for scene in (None, WALL))
    balance = ColourBalance.of(white)
    # The region starts in an odd column: red, green / green, blue.
    assert_allclose(balance.gains, [[428 / 420, 1], [1, 428 / 322]], rtol=0.01)
    mixed = Decoder.of(lattice, shape, white=balance(white))(balance(raw))
    grey_white, grey_raw = (render(PAPER, scene, region=REGION).pixels for scene in (None, WALL))
    grey = Decoder.of(lattice, shape, white=grey_white)(grey_raw)
    for s, t in ((0, 0), (3, -2)):
        lit = (mixed.view_weight(s, t) > 0) & (grey.view_weight(s, t) > 0)
        ours, theirs = (f.view(s, t)[lit] / np.median(f.view(s, t)[lit]) for f in (mixed, grey))
        assert np.sqrt(np.mean((ours / theirs - 1) ** 2)) < 0.01
    dark = np.full(shape, 0.1, np.float32)
    assert_allclose(ColourBalance.of(white + dark, dark)(raw + dark), balance(raw), atol=1e-5)


def test_depth_of_a_mosaic():
    """Errors told are those made, as far as fifteen by fifteen microlenses say; predicted ones are not far below."""
    trial = roslf.measure_depth(BAYER, region=(2200, 1440, 195, 195), seed=1, exposures=2, rays=48)
    summary = trial.summary()
    assert summary.measured > 0.9
    assert abs(summary.bias_mm) < 0.7 * summary.told_mm
    assert 0.5 < summary.inside_68 < 0.9
    assert summary.spread_mm < 2.5 * summary.predicted_mm


@pytest.mark.parametrize("name", ["paper", "paper-singlet"])
def test_depth_over_the_field_of_a_mosaic_goes_on_from_the_axis(name):
    """At fields of a data sheet and in tolerance studies as on the axis, behind an ideal lens and a real one."""
    design = roslf.load(name).replace({"sensor.colours": "RGGB"})
    fields = ((0.0, 0.0), (3.0, 0.0))
    builds = evaluate_builds(Question(design, ("sigma_z_at_field_mm",), fields, 350.0), {}, 1)[:, 0]
    alone = np.asarray(QUANTITIES["sigma_z_at_field_mm"].at_fields(images_of(design, fields)))[:, 0]
    assert_allclose(builds, alone, rtol=1e-9)  # twins of builds have their lenses' own focal lengths
    assert alone[0] == pytest.approx(float(QUANTITIES["sigma_z_mm"](Camera.of(design))), rel=1e-9)
    assert alone[0] < alone[1] < 1.01 * alone[0]  # slanting light is weaker


def test_slanting_light_is_lost_in_picture_and_prediction():
    """Against angles from each microlens's middle by hand; the mean over an image point by point."""
    half = math.radians(2.0)
    design = PAPER.replace({"sensor.acceptance": half})
    camera = Camera.of(design)
    fields = [(0.0, 0.0), (9.072, 0.0)]
    lost = []
    for x, _ in fields:
        chief = x * float(1 + camera.d_2 * camera.vergence)
        column = round(chief / float(camera.q) + 2300 - 6.5)
        region = (column, 1534, 13, 13)
        taken, whole = (render(each, region=region).pixels.astype(float) for each in (design, PAPER))
        across = (column + np.arange(13) + 0.5 - 2300) * float(camera.q) - x
        down = (1534 + np.arange(13) + 0.5 - 1540) * float(camera.q)
        angle = np.arctan(np.hypot(across, down[:, None]) / float(camera.d_2))
        own = slice(1, 12)  # what is no neighbour's cell
        assert_allclose((taken / whole)[own, own], 2.0 ** -((angle[own, own] / half) ** 2), rtol=1e-5)
        # Over the image's disc, point by point.
        u, v = np.meshgrid(*2 * [np.linspace(-1, 1, 401) * float(QUANTITIES["image_diameter_mm"](camera)) / 2])
        lit = np.hypot(u, v) < u.max()
        steep = np.arctan(np.hypot(u + chief - x, v)[lit] / float(camera.d_2))
        lost.append((2.0 ** -((steep / half) ** 2)).mean())
    radius = np.array([x for x, _ in fields])
    assert_allclose(response(camera, radius), lost, rtol=2e-3)
    images, bare = (MicrolensImages(Camera.of(each), fields) for each in (design, PAPER))
    ratio = disparity_sigma(images, seen_at(camera, None)) / disparity_sigma(bare, seen_at(camera, None))
    # Shot noise, nearly: sigma goes with one over the root of the light.
    assert_allclose(ratio[:, 0], 1 / np.sqrt(lost), rtol=0.01)


def test_bad_input():
    with pytest.raises(roslf.DesignError, match=r"sensor\.colours"):
        PAPER.replace({"sensor.colours": "bayer"})
    with pytest.raises(SceneError, match="white light"):
        render(BAYER, WALL.in_light((550e-6,)), region=REGION)
    singlet = roslf.load("paper-singlet").replace({"sensor.colours": "RGGB"})
    with pytest.raises(roslf.InputError, match="pitches apart on the axis"):
        roslf.measure_depth(singlet, region=REGION)
    with pytest.raises(ValueError, match="no light"):
        ColourBalance.of(np.tile(np.array([[1, 0], [1, 1]]), (8, 8)))
