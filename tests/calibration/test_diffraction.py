"""Microlens diffraction: read from white images, computed for corners, taken off a rendered calibration."""

import functools
import json
import math
from dataclasses import replace

import numpy as np
import pytest

from roslf_design.bore.opening import ClearAperture
from roslf_design.calibration import (
    Captures,
    camera_of,
    find_centres,
    random_poses,
    sheet_of,
    synthetic_observations,
)
from roslf_design.calibration.diffraction import (
    Corners,
    WhiteImage,
    _apparent_shifts,
    _looked_at,
    _view_weights,
    _ViewWeights,
)
from roslf_design.calibration.pupil_image import PupilImage
from roslf_design.calibration.white_profile import ImageFit
from roslf_design.camera import Camera
from roslf_design.cli import main
from roslf_design.design import load, save
from roslf_design.imaging.camera import ImageLattice, Region
from roslf_design.imaging.render import render
from roslf_design.theory.exit_pupil import microlens_image_diameter, microlens_image_pitch
from roslf_design.theory.light import diffraction_width
from tests.calibration.made import study

PAPER = load("paper")
VIEWS = np.array([[0.0, 0.0], [3.0, 0.0], [-3.0, 0.0], [0.0, 4.0], [2.0, 2.0]])
IMAGE = PupilImage(6.5, 3.6, 12.94)


def pupil_of(design):
    c, array = Camera.of(design), design.microlens_array
    lengths = microlens_image_diameter(c) / 2, diffraction_width(c), microlens_image_pitch(c)
    return PupilImage(*(float(x / c.q) for x in lengths), array.layout, array.lens_shape)


@pytest.mark.parametrize(
    ("layout", "shape", "slower"),
    [("square", "square", 1.0), ("square", "circular", 0.9), ("hexagonal", "circular", 0.8)],
)
def test_a_rendered_white_image_gives_its_pupil_and_its_blur(layout, shape, slower):
    design = PAPER.replace(
        {"microlens_array.layout": layout, "microlens_array.lens_shape": shape}, D_F=PAPER.D_F * slower
    )
    pixels = render(design, region=(2150, 1390, 300, 300)).pixels
    lattice = find_centres(pixels, layout=layout).lattice
    samples, true = WhiteImage(pixels, None, lattice).samples(), pupil_of(design)
    start = PupilImage(1.1 * true.radius, 0.8 * true.blur, lattice.pitch, layout, shape)
    found = ImageFit.of(samples, lattice, start)
    # The render is exact to its budget of 1 %; 23 microlenses across leave a few thousandths.
    assert found.image.radius == pytest.approx(true.radius, rel=5e-3)
    assert found.image.blur == pytest.approx(true.blur, rel=1e-2)
    assert found.misfit < 5e-3
    sharp = ImageFit.of(samples, lattice, replace(start, blur=0.0), ("radius",))
    assert sharp.misfit > 10 * found.misfit


BOX = {"shape": "rectangle", "sides": (2.5, 1.7), "turn": 0.35, "distance": 120.0}


def test_a_rendered_white_image_through_a_rectangle_gives_it_and_its_blur():
    """Turned against the array by the difference of both angles; centres lie where the rectangles' middles do."""
    design = PAPER.replace({"aperture": BOX, "microlens_array.rotation": 0.2})
    region = Region(2150, 1390, 300, 300)
    pixels = render(design, region=tuple(region)).pixels
    lattice, true = find_centres(pixels, layout="square").lattice, ImageLattice.of(Camera.of(design))
    nodes = np.stack(np.meshgrid(np.arange(-8, 9), np.arange(-8, 9)), -1).reshape(-1, 2)
    found = lattice.nodes(*nodes.T) + (region.column, region.row) + 0.5 - np.array(design.pixels) / 2
    index = np.linalg.solve(true.image_axes, (found * design.q - true.image_origin).T)
    assert np.abs(index - np.round(index)).max() * lattice.pitch < 5e-3

    def looked_at(some):
        return _looked_at(some, WhiteImage(pixels, None, lattice), "auto")

    found = looked_at(design)
    assert found.corrected
    assert not found.warning
    pupil = pupil_of(design)
    sides = [2 * half * design.q for half in found.image.opening.half]
    scale = microlens_image_diameter(Camera.of(design)) / design.D_F
    assert sides == pytest.approx([side * float(scale) for side in BOX["sides"]], rel=5e-3)
    assert found.image.blur == pytest.approx(pupil.blur, rel=1e-2)
    assert found.misfit < 5e-3
    # Taken for a disc, or turned the other way, it is something else.
    for other in ({"diameter": 2.5, "distance": 120.0}, BOX | {"turn": -0.35}):
        assert "none was taken off" in looked_at(design.replace({"aperture": other})).reason


def test_a_white_image_without_diffraction_shows_none():
    pixels = render(
        PAPER, overrides=["-microlens_diffraction", "-microlens_defocus"], region=(2150, 1390, 300, 300)
    ).pixels
    lattice = find_centres(pixels, layout="square").lattice
    samples, true = WhiteImage(pixels, None, lattice).samples(), pupil_of(PAPER)
    sharp = ImageFit.of(samples, lattice, replace(true, blur=0.0), ("radius",))
    blurred = ImageFit.of(samples, lattice, true)
    assert sharp.image.radius == pytest.approx(true.radius, rel=2e-3)
    assert sharp.misfit < 0.02
    assert blurred.image.blur < 0.1 * true.blur


def brute_baseline(s, image):
    """Mean place along s of the light that the view (s, 0) gets through its own microlens, by sums over fine grids."""
    step = 0.02
    x = np.arange(-40, 40, step) + step / 2
    lens = np.sinc(x / image.blur) ** 2
    pixel = (np.abs(x) < 0.5).astype(float)
    size = np.abs(x)
    cubic = np.where(size < 1, (1.5 * size - 2.5) * size**2 + 1, ((-0.5 * size + 2.5) * size - 4) * size + 2)
    cubic = np.where(size < 2, cubic, 0)
    side = np.convolve(np.convolve(lens, pixel, "same"), cubic, "same")

    def blur(at):
        return np.interp(at, x, side)

    grid = np.linspace(-image.radius, image.radius, 401)
    across, along = np.meshgrid(grid, grid)
    inside = image.opening.contains(across, along)
    light = blur(s - across) * blur(-along) * inside
    return (light * across).sum() / light.sum()


def baseline(weights):
    """Mean place on the pupil of the light that each view gets through its own microlens, (v, 2) [px]."""
    own = weights.shares[:, 0]
    return own @ weights.places / own.sum(axis=1)[:, None]


def test_views_through_a_rectangle_look_from_where_a_sum_over_it_has_it():
    image = replace(IMAGE, shape=ClearAperture(math.inf, (1.0, 0.7), 0.0))
    found = baseline(_view_weights(image, VIEWS, points=4000))
    assert found[1, 0] == pytest.approx(brute_baseline(3.0, image), abs=0.02)
    turned = replace(image, shape=image.shape._replace(turn=math.pi / 2))
    np.testing.assert_allclose(baseline(_view_weights(turned, VIEWS[:, ::-1], points=4000)), found[:, ::-1], atol=0.03)


def test_views_look_from_further_inside_as_a_sum_over_the_pupil_has_it():
    weights = _view_weights(IMAGE, VIEWS, points=2000)
    np.testing.assert_allclose(weights.shares.sum(axis=(1, 2)), 1, rtol=1e-12)
    found = baseline(weights)
    np.testing.assert_allclose(found[0], 0, atol=0.02)
    assert found[1, 0] == pytest.approx(brute_baseline(3.0, IMAGE), abs=0.02)  # 2000 places: a hundredth of a pixel
    np.testing.assert_allclose(found[1], -found[2], atol=0.03)
    assert found[3, 1] == pytest.approx(brute_baseline(4.0, IMAGE), abs=0.02)
    assert 2.0 < found[1, 0] < 2.8
    sharp = baseline(_view_weights(PupilImage(6.5, 0.0, 12.94), VIEWS, points=2000))
    np.testing.assert_allclose(sharp[[0, 1, 4]], VIEWS[[0, 1, 4]], atol=0.05)  # inside the rim nothing moves


EDGES = (0.15, 0.15 + math.pi / 2)
LARGE = PupilImage(32.6, 2.35, 65.3, "hexagonal", "circular")
"""A 100 um microlens on pixels of 1.55 um."""


def test_views_of_a_large_pupil_look_from_where_they_are():
    """400 places on it, 2.9 px apart, put views up to 0.5 px beside: either way, by the slope's sign."""
    sides = (10.0, 20.0, 27.0)
    at = np.concatenate([[[s, 0.0], [-s, 0.0], [0.0, s]] for s in sides])
    shares = np.repeat([brute_baseline(s, replace(LARGE, lens_shape="square")) / s for s in sides], 3)
    found = baseline(_view_weights(replace(LARGE, lens_shape="square"), at))
    np.testing.assert_allclose(found, shares[:, None] * at, atol=0.06)


def test_shifts_are_smooth_in_the_slope_and_those_of_a_smaller_pupil_with_finer_pixels():
    """Nothing about a view depends on pixels but their own width, here a tenth of the blur's effect."""
    slopes = np.array([-0.12, -0.11, -0.1, 0.1, 0.11, 0.12])
    views = np.array([[0.0, 0.0], [14.0, 0.0], [26.0, 0.0]])
    shifts = _apparent_shifts(_view_weights(LARGE, views), slopes, EDGES, 4, lens_shape="circular")
    np.testing.assert_allclose(shifts[0], 0, atol=2e-3)  # the middle view is what it is by symmetry
    assert np.abs(np.diff(shifts[:, :3], axis=1)).max() < 4e-3
    assert np.abs(np.diff(shifts[:, 3:], axis=1)).max() < 4e-3
    finer = PupilImage(2 * LARGE.radius, 2 * LARGE.blur, 2 * LARGE.pitch, "hexagonal", "circular")
    same = _apparent_shifts(_view_weights(finer, 2 * views), slopes / 2, EDGES, 4, lens_shape="circular")
    np.testing.assert_allclose(same, shifts, atol=3e-3)


def as_weights(places, shares, neighbours=((0.0, 0.0),)):
    shares = np.asarray(shares, float).reshape(1, len(neighbours), len(places))
    return _ViewWeights(np.array([[3.0, -2.0]]), shares, np.array(neighbours), np.array(places, float))


def test_light_from_elsewhere_on_the_pupil_moves_corners_by_the_slope():
    slopes = np.array([-0.2, 0.0, 0.25])
    nominal = _apparent_shifts(as_weights([(3.0, -2.0)], [1.0]), slopes, EDGES, 8)
    np.testing.assert_allclose(nominal, 0, atol=5e-3)  # bins of an eighth of a pitch
    inside = _apparent_shifts(as_weights([(2.0, -1.5)], [1.0]), slopes, EDGES, 8)
    np.testing.assert_allclose(inside[0], slopes[:, None] * [-1.0, 0.5], atol=5e-3)
    both = _apparent_shifts(as_weights([(2.0, -2.0), (4.0, -2.0)], [0.5, 0.5]), slopes, EDGES, 8)
    np.testing.assert_allclose(both, 0, atol=5e-3)


def test_a_neighbour_s_light_moves_corners_by_less_than_its_share():
    next_door = as_weights([(3.0, -2.0)], [0.8, 0.2], ((0.0, 0.0), (1.0, 0.0)))
    shift = _apparent_shifts(next_door, np.array([0.0]), EDGES, 8)[0, 0]
    assert -0.2 < shift[0] < -0.1
    assert abs(shift[1]) < 0.02
    far = as_weights([(3.0, -2.0)], [0.8, 0.2], ((0.0, 0.0), (3.0, 0.0)))
    assert abs(_apparent_shifts(far, np.array([0.0]), EDGES, 8)[0, 0, 0]) < 0.3  # its mean displacement is 0.6


CELL = 1.2


@pytest.fixture(scope="module")
def circle(root, tmp_path_factory):
    """Four boards by a corner of the paper's sensor through a rectangle turned against the array; the design beside.

    By rays and by waves; 16 rays a pixel scatter by over a half of the noise. Images overlap along x and leave gaps
    along y: the lattice's first order is weaker one way.
    """
    module, place = study(root / "studies" / "calibration-circle" / "captures.py"), tmp_path_factory.mktemp("circle")
    size = 600 * PAPER.q, 500 * PAPER.q
    array = {"microlens_array.size": (size[0] + 0.2, size[1] + 0.2)}
    design = PAPER.replace(
        {"name": "small sensor", "sensor.size": size, **array, "aperture": {**BOX, "sides": (2.5, 1.9)}}
    )
    save(design, place / "small.toml")
    with pytest.MonkeyPatch.context() as patch:  # a quarter of the rays less; what is beyond counts as even light
        patch.setattr("roslf_design.imaging.transfer.LEAST_HALO", 32)
        patch.setattr("roslf_design.imaging.transfer.LEAST_PITCHES", 0)
        patch.setattr(module, "capture", functools.partial(module.capture, rays=16))
        written = list(module.make(design, place, boards=4, cell=CELL, tilt=35.0))
    assert len(written) == 10
    return place


def calibrated(capsys, circle, kind, out, *options):
    arguments = ["calibrate", circle / kind, "--design", circle / "small.toml", "--board", f"4x5 {CELL} mm", "-o", out]
    code = main([str(a) for a in (*arguments, "--no-posterior", "--json", *options)])
    said, err = capsys.readouterr()
    assert (code, err) == (0, "")
    return json.loads(said)


TRUTH = {"H": 140 / 92, "d_3": 120.0, "d_1": 140.0, "d_f": 350.0, "d_2": 2.0, "A": 92.0, "m": 0.4}


def test_full_circle_with_diffraction(capsys, circle, tmp_path, blank_pngs):
    """By rays alone `tests/commands/test_calibrate.py` goes round."""
    waves = calibrated(capsys, circle, "waves", tmp_path / "waves")
    assert len(waves["images_used"]) == 4
    assert waves["reprojection_rms_pitches"] < 0.06  # the paper's
    for name, true in TRUTH.items():
        low, high = waves["quantities"][name]["interval_95"]
        assert low < true < high, name
    told = waves["diffraction"]
    assert told["corrected"] is True
    assert told["seen_blur_px"] == pytest.approx(told["expected_blur_px"], rel=0.01)
    assert told["without"]["d_2"] > 1.06 * TRUTH["d_2"]
    assert told["seen_radius_px"] == pytest.approx(math.hypot(1.25, 0.95) * 2.0 / 92.0 / PAPER.q, rel=5e-3)
    assert waves["quantities"]["d_2"]["estimate"] == pytest.approx(TRUTH["d_2"], rel=0.015)
    assert waves["quantities"]["m"]["estimate"] == pytest.approx(TRUTH["m"], rel=1e-3)
    # The correction's own uncertainty: 5 % of what it takes off, and what its pupil is off.
    low, high = waves["quantities"]["d_2"]["interval_68"]
    own = (high - low) / 2 * math.sqrt(waves["quantities"]["d_2"]["variance_shares"]["systematic"])
    assert 0.04 < own / (told["without"]["d_2"] - TRUTH["d_2"]) < 0.2


def test_what_is_asked_what_is_expected_and_what_is_seen_decide():
    captures = Captures(boards=3, views=3, reach=3.0, noise=0.01)
    rng = np.random.default_rng(0)
    camera = camera_of(PAPER)
    observations = synthetic_observations(camera, random_poses(captures, 120.0, rng), captures, rng)

    @functools.cache
    def white_of(overrides):
        white = render(PAPER, overrides=overrides, region=(2100, 1340, 240, 240)).pixels
        return WhiteImage(white, None, find_centres(white, layout="square").lattice)

    def looked(overrides, wish, design=PAPER):
        return _looked_at(design, white_of(overrides), wish)

    def calibrated(wish):
        white = white_of(())
        found = Corners.of(observations, captures.board, PAPER, white, wish).calibrated(sheet_of(PAPER))
        return found.diffraction, found.calibration

    rays = ("-microlens_diffraction", "-microlens_defocus")
    asked = looked(rays, "on")
    assert asked.corrected
    assert "where the design's diffraction makes 3.60 px" in asked.warning
    none = looked(rays, "auto")
    assert not none.corrected
    assert "shows no microlens diffraction" in none.reason
    left, plain = calibrated("off")
    assert (left.corrected, left.image) == (False, None)
    seen, found = calibrated("auto")
    assert seen.corrected
    assert seen.warning == ""
    # Corners that nobody displaced: taking off what diffraction would do makes d_2 too small, by the bias it has.
    assert found.joint.camera.inverse_d_2 > 1.05 * plain.joint.camera.inverse_d_2
    fine = PAPER.replace({"light.wavelength": 1e-5})
    small = looked(rays, "auto", fine)
    assert "too small to matter" in small.reason
    foreign = looked((), "auto", PAPER.replace({"light.wavelength": 900e-6}))
    assert "are its wavelength, its d_2 and its pixel those of this camera?" in foreign.warning
