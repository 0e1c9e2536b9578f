"""Diffraction against Huygens quadrature and against a coherent wave carried through the whole camera."""

import math

import numpy as np
import pytest

from roslf_design.camera import Camera
from roslf_design.design import load
from roslf_design.effects import Budget, plan
from roslf_design.effects.waves import incoherent_texture_miss
from roslf_design.imaging.camera import ImageLattice, Region, pixel_centres, planned_camera
from roslf_design.imaging.points import PointSource, point_image
from roslf_design.imaging.render import method_of, render
from roslf_design.imaging.trace import RaySampling
from roslf_design.imaging.transfer import MicrolensTransfer, bands, encircled, fineness
from roslf_design.imaging.white import (
    WhiteGeometry,
    _interference_series,
    harmonic_series,
    neighbour_interference,
)
from roslf_design.scenes import WHITE_FIELD, Plane, Scene, Sinusoid, Uniform
from tests.oracles import coherent, huygens

PAPER = load("paper")
ROUND = PAPER.replace({"microlens_array.lens_shape": "circular"})
PUPIL = huygens.disc(PAPER.D_F / 2, 20)


def planned(design, overrides=()):
    lines = plan(design, overrides=["-cos4", *overrides])
    seen = planned_camera(design, lines)
    return lines, seen, MicrolensTransfer.of(seen, lines)


def test_white_image_against_huygens_quadrature():
    """Neighbours up to 16 pitches away are summed directly; their tails' 1/N is taken out by Richardson's step."""
    _, seen, transfer = planned(PAPER, ["+microlens_defocus"])
    axis = np.linspace(-0.55, 0.55, 23) * PAPER.d
    pitch = 0.062726086956521737
    area = np.pi * (2.9 * 35 / 23 * 2 / 140 / 2) ** 2
    near, far = (
        huygens.square_images(seen, PUPIL, axis, axis, pitch * np.arange(-n, n + 1), 60 + 12 * n) * area
        for n in (8, 16)
    )
    truth = 2 * far - near
    image = harmonic_series(seen, transfer, pixel=False).at(axis, axis)
    assert np.sqrt(np.mean((image - truth) ** 2)) < 1e-3
    assert np.abs(image - truth).max() < 6e-3  # 1200 pupil points; with 4800 it is 1.1e-3


@pytest.mark.parametrize("wave", [0.05, 0.1, 0.3])
def test_waves_over_the_array_reach_pixels_by_all_their_microlenses(wave):
    """Lines of light 31 pixels apart against Poisson's sum of all: by those within 96 px waves are 9 mrad off."""
    pitch, pixel = 31, 1e-3
    transfer = MicrolensTransfer(pitch * pixel, 0.6, 0.0, (6e-4,), "square")

    def lines(region, fine, turn=0.0):
        at = (region.column * fine + np.arange(region.columns * fine)) / fine
        shines = np.cos(2 * np.pi * (wave * np.round(at / pitch) - turn)) * (at % pitch == 0)
        return np.tile(np.float32(shines), (region.rows * fine, 1))

    region = Region(0, 0, pitch, 1)
    real, imaginary = (
        next(bands(region, lambda part, fine, turn=turn: lines(part, fine, turn), transfer, pixel, 1))[1][0]
        for turn in (0.0, 0.25)
    )
    orders = (np.arange(-9, 10) + wave) / pitch
    place = np.arange(pitch) + 0.5 - 0.5 / fineness(transfer, pixel)
    passed = transfer(orders / pixel, 0.0) * np.sinc(orders)
    off = np.angle((real + 1j * imaginary) / (np.exp(2j * np.pi * np.outer(place, orders)) @ passed))
    assert np.abs(off[np.abs(real + 1j * imaginary) > 0.01]).max() < 1e-3


def test_light_of_large_images_comes_from_as_near_as_accuracy_asks(monkeypatch):
    """White pixels with light from three microlenses around (180 px), and with that from eight (463 px)."""
    lines, seen, transfer = planned(load("mismatched-borescope").replace({"microlens_array.pitch": 0.2}))
    given = Region(1000, 600, 64, 64), WhiteGeometry.of(seen, lines).image, transfer, float(seen.q), 1
    ((_, near),) = bands(*given)
    monkeypatch.setattr("roslf_design.imaging.transfer.LEAST_BLURS", math.inf)
    ((_, far),) = bands(*given)
    assert 0 < np.abs(near - far).max() < 1e-3  # of 1e-2 that is promised


def test_isolated_round_microlens_against_huygens_quadrature():
    """One microlens of an array of one, out of focus: the convolution with its own kernel."""
    lone = ROUND.replace({"microlens_array.size": (0.064, 0.064)}, f_ml=1.6)
    lines, seen, transfer = planned(lone, ["+microlens_defocus"])
    width, height = lone.pixels
    region = Region(width // 2 - 8, height // 2 - 8, 16, 16)
    geometry = WhiteGeometry.of(seen, lines)
    image = np.concatenate([band for _, band in bands(region, geometry.image, transfer, seen.q, 1)])
    nodes, weights = np.polynomial.legendre.leggauss(3)
    x, y = ((c[:, None] + nodes * seen.q / 2).ravel() for c in pixel_centres(seen, region))
    area = np.pi * (2.9 * 35 / 23 * 2 / 140 / 2) ** 2
    truth = huygens.round_image(seen, huygens.disc(PAPER.D_F / 2, 20), x, y, 32) * area
    truth = np.einsum("jaib,a,b->ji", truth.reshape(16, 3, 16, 3), weights, weights) / 4
    assert np.sqrt(np.mean((image - truth) ** 2)) < 1e-3
    assert np.abs(image - truth).max() < 4e-3


@pytest.mark.parametrize("lens_shape", ["square", "circular"])
@pytest.mark.parametrize("layout", ["square", "hexagonal"])
@pytest.mark.parametrize("rotation", [0.0, 0.02])
def test_series_and_convolution_agree_where_both_hold(lens_shape, layout, rotation):
    array = {"lens_shape": lens_shape, "layout": layout, "rotation": rotation, "decentre": (0.011, -0.007)}
    lines, seen, transfer = planned(PAPER.replace({f"microlens_array.{key}": value for key, value in array.items()}))
    region = Region(2100, 1500, 300, 200)
    series = harmonic_series(seen, transfer).at(*pixel_centres(seen, region))
    geometry = WhiteGeometry.of(seen, lines)
    image = np.concatenate([band for _, band in bands(region, geometry.image, transfer, seen.q, 2)])
    assert np.sqrt(np.mean((image - series) ** 2)) < 1e-3  # what two subpixels fold back


def test_white_image_of_a_hexagonal_array_against_huygens_quadrature():
    """Even rows and odd rows are two square grids, but for their steps; tails as above."""
    hexagonal = PAPER.replace({"microlens_array.layout": "hexagonal"}, f_ml=1.8)
    _, seen, transfer = planned(hexagonal, ["+microlens_defocus"])
    axis = np.linspace(-0.55, 0.55, 23) * PAPER.d
    pitch, area = 0.062726086956521737, np.pi * (2.9 * 35 / 23 * 2 / 140 / 2) ** 2

    def summed(n):
        """Neighbours out to n pitches along x and along y."""
        steps = np.arange(-n, n + 1)
        rows = np.sqrt(3) * np.arange(-round(n / np.sqrt(3)), round(n / np.sqrt(3)) + 1)
        grids = [
            (steps, rows),
            (np.append(steps, n + 1) - 0.5, np.append(rows, rows[-1] + np.sqrt(3)) - np.sqrt(3) / 2),
        ]
        return sum(
            huygens.square_images(seen, PUPIL, axis, axis, pitch * across, 60 + 12 * n, pitch * along)
            for across, along in grids
        )

    truth = (2 * summed(16) - summed(8)) * area
    image = harmonic_series(seen, transfer, pixel=False).at(axis, axis)
    assert np.sqrt(np.mean((image - truth) ** 2)) < 2e-3
    assert np.abs(image - truth).max() < 8e-3  # 1200 pupil points


@pytest.mark.parametrize("wavelength", [5.5e-4, 1e-4, 1e-5])
@pytest.mark.parametrize("rotation", [0.0, 1e-3])
def test_a_hexagonal_array_takes_a_series_as_a_square_one_does(wavelength, rotation):
    """Rows of harmonics are what it costs: 528 of them had been too many where a square array had 198."""
    turned = PAPER.replace({"microlens_array.rotation": rotation}, wavelength=wavelength)
    ways = []
    for layout in ("square", "hexagonal"):
        design = turned.replace({"microlens_array.layout": layout})
        lines, seen, transfer = planned(design, ["+microlens_diffraction"])
        series = harmonic_series(seen, transfer)
        ways.append((method_of(design, WHITE_FIELD, lines), series.rows))
    assert ways[0][0] == ways[1][0] == ("convolution" if rotation and wavelength == 1e-5 else "harmonics")
    assert ways[1][1] <= 1.8 * ways[0][1]  # rows lie sqrt(3)/2 of a pitch apart, and half a harmonic apart


def test_interference_of_square_neighbours_against_huygens_quadrature():
    """Fields of all microlenses added up for every point of the pupil; tails' 1/N by Richardson's step."""
    _, seen, transfer = planned(PAPER.replace(f_ml=2.3), ["+microlens_defocus"])
    axis, area = np.linspace(-0.5, 0.5, 5) * 0.0627, np.pi * (2.9 * 35 / 23 * 2 / 140 / 2) ** 2
    near, far = (huygens.square_interference(seen, axis, axis, n, 48, 60 + 10 * n) * area for n in (4, 8))
    series = _interference_series(seen, transfer, pixel=False, reach=8).at(axis, axis)
    assert np.abs(series - (2 * far - near)).max() < 6e-4
    assert np.abs(series).max() > 0.028


def test_interference_of_round_neighbours_against_huygens_quadrature():
    """Microlenses up to three pitches off; what those beyond add, with their fields' tails, is 4e-3."""
    design = ROUND.replace({"microlens_array.layout": "hexagonal"})
    _, seen, transfer = planned(design, ["+microlens_defocus"])
    places = 0.062726086956521737 * np.array([[0.0, 0.0], [0.0, 0.5773]])
    lattice = ImageLattice.of(seen)
    centres = lattice.microlens(np.stack(np.meshgrid(*[np.arange(-6, 7)] * 2), -1).reshape(-1, 2))
    centres = centres[np.hypot(*centres.T) < 3.01 * seen.d]
    truth = huygens.round_interference(seen, places, centres, 14, 14) * np.pi * (2.9 * 35 / 23 * 2 / 140 / 2) ** 2
    series = _interference_series(seen, transfer, pixel=False)
    found = [series.at(x, y)[0, 0] for x, y in places[..., None]]
    assert np.abs(found - truth).max() < 4e-3
    assert np.abs(truth).max() > 0.02


def test_interference_of_the_bench_is_0_4_percent_and_fades_with_the_fresnel_number():
    _, seen, transfer = planned(PAPER)
    assert neighbour_interference(seen, transfer) == pytest.approx(0.0041, abs=2e-4)
    sizes = []
    for wavelength in (5.5e-4, 2e-4):
        _, seen, transfer = planned(ROUND.replace(wavelength=wavelength), ["+microlens_diffraction"])
        sizes.append(neighbour_interference(seen, transfer))
        many = _interference_series(seen, transfer, reach=2).at(*[np.linspace(0, 0.0627, 60)] * 2)
        assert np.abs(many).max() <= 1.05 * sizes[-1]  # beyond 4 N_F = 8 a bound
    assert sizes[0] > 0.02


def test_encircled_energy_of_the_paper_design():
    np.testing.assert_allclose(encircled(Camera.of(PAPER)), (0.741, 0.806), atol=5e-4)
    np.testing.assert_allclose(encircled(Camera.of(ROUND)), (0.730, 0.797), atol=5e-4)


def test_encircled_energy_by_summing_the_huygens_image():
    """The same number from the image itself, integrated over the cell."""
    nodes, weights = np.polynomial.legendre.leggauss(20)
    half = 0.062726086956521737 / 2
    _, seen, _ = planned(PAPER)
    image = huygens.square_images(seen, PUPIL, nodes * half, nodes * half, [0.0], 64)
    summed = (image * weights[:, None] * weights).sum() * half**2
    assert summed == pytest.approx(0.806, abs=5e-4)
    assert summed == pytest.approx(encircled(Camera.of(PAPER)).cell, abs=2e-4)


def test_encircled_energy_of_a_hexagonal_cell_by_summing_the_huygens_image():
    """Rows of the hexagon whose six sides are half a pitch from its middle."""
    hexagonal = PAPER.replace({"microlens_array.layout": "hexagonal"})
    apothem, (nodes, weights) = 0.062726086956521737 / 2, np.polynomial.legendre.leggauss(16)
    _, seen, _ = planned(hexagonal)
    summed = 0.0
    for low, high in ((-2, -1), (-1, 1), (1, 2)):  # heights in halves of a side
        side = apothem / np.sqrt(3)
        for node, weight in zip(nodes, weights, strict=True):
            y = side * ((low + high) / 2 + (high - low) / 2 * node)
            reach = min(apothem, 2 * apothem - np.sqrt(3) * abs(y))
            row = huygens.square_images(seen, PUPIL, nodes * reach, np.array([y]), [0.0], 64)[0]
            summed += row @ weights * reach * weight * side * (high - low) / 2
    assert encircled(Camera.of(hexagonal)).cell == pytest.approx(summed, abs=3e-4)
    assert encircled(Camera.of(PAPER)).cell - summed > 0.02


BOX = {"shape": "rectangle", "sides": (2.9, 1.6), "turn": 0.35, "distance": 120.0}


@pytest.mark.parametrize("point", [(0.02, 0.03, 350.0), (0.02, 0.0, 320.0)])
def test_point_source_against_a_wave_through_the_whole_camera(point):
    """In and out of focus; 5 x 5 microlenses in the reference, all that count in the package."""
    side = 52
    width, height = PAPER.pixels
    region = Region(width // 2 - side // 2, height // 2 - side // 2, side, side)
    edges = (np.arange(side + 1) - side // 2) * PAPER.q
    truth = coherent.pixel_sums(*coherent.sensor_intensity(PAPER, point), edges)
    image = point_image(PointSource(Camera.of(PAPER), *point), region, (PAPER.wavelength,), 4e-3)
    error = image - truth
    assert np.abs(error).max() < 4e-3 * truth.max()
    assert np.sqrt(np.mean(error**2)) < 1e-3 * truth.max()
    assert image.sum() == pytest.approx(truth.sum(), abs=3e-3)


def test_point_source_through_a_rectangle_against_a_wave_through_the_whole_camera():
    """As far as the light that is left out in its tails allows, whose field adds to what is there."""
    design, point = PAPER.replace({"aperture": {**BOX, "turn": 0.0}}), (0.02, 0.03, 350.0)
    width, height = design.pixels
    region = Region(width // 2 - 26, height // 2 - 26, 52, 52)
    truth = coherent.pixel_sums(*coherent.sensor_intensity(design, point), (np.arange(53) - 26) * design.q)
    image = point_image(PointSource(Camera.of(design), *point), region, (design.wavelength,), 0.05)
    error = image - truth
    assert np.abs(error).max() < 0.05 * truth.max()
    assert np.sqrt(np.mean(error**2)) < 2.5e-3 * truth.max()
    assert image.sum() == pytest.approx(truth.sum(), abs=5e-3)


def test_rays_from_a_point_through_a_rectangle_fill_it():
    """Out of focus the lit microlenses are the rectangle's shadow: moments of its light are as the rectangle's."""
    design = PAPER.replace({"aperture": BOX})
    image = point_image(PointSource(Camera.of(design), 0.0, 0.0, 250.0), Region(0, 0, *design.pixels), (), 0.01)
    assert image.sum() == pytest.approx(1.0, abs=1e-3)
    (a, b), turn = BOX["sides"], BOX["turn"]
    x, y = (((np.arange(pixels) + 0.5) - pixels / 2) * design.q for pixels in design.pixels)
    xx, yy, xy = image.sum(0) @ x**2, image.sum(1) @ y**2, y @ image @ x
    assert 0.5 * math.atan2(2 * xy, xx - yy) == pytest.approx(turn, abs=0.02)
    assert (xx + yy) / math.hypot(xx - yy, 2 * xy) == pytest.approx((a * a + b * b) / (a * a - b * b), rel=0.03)


def test_clipped_pupil_takes_light_away_and_the_two_integrals_agree():
    """A stop that just holds the pencil goes through the round table; a hair smaller, through the chords."""
    region = Region(2240, 1480, 120, 120)
    at = (0.02, 0.05, 330.0)
    decentred = PAPER.replace({"aperture.decentre": (0.3, -0.2)})
    whole = PointSource(Camera.of(decentred), *at)
    grazing = PointSource(Camera.of(decentred.replace({"stops": ({"diameter": 5.0, "distance": 60.0},)})), *at)
    cut = PointSource(Camera.of(decentred.replace({"stops": ({"diameter": 3.0, "distance": 60.0},)})), *at)
    images = [point_image(p, region, (PAPER.wavelength,), 0.05) for p in (whole, grazing, cut)]
    assert whole.opening.unclipped
    assert not cut.opening.unclipped
    np.testing.assert_allclose(images[0], images[1], atol=1e-4 * images[0].max())
    assert 0.3 < images[2].sum() / images[0].sum() < 0.99


def test_many_incoherent_points_make_the_white_image():
    """Points spread over one microlens's footprint, on the focal plane, light it as a white field does."""
    n = 4
    # Light of the neighbours' footprints comes too: fold the sensor's cells instead of repeating the scene.
    steps = (np.arange(n // 2) + 0.5) / n
    total = np.zeros((91, 91))
    telecentric = PAPER.replace(d_3=100.0, q=PAPER.d / 13)  # images repeat every 13 pixels exactly
    big = Region(telecentric.pixels[0] // 2 - 45, telecentric.pixels[1] // 2 - 45, 91, 91)
    for u in steps:
        for v in steps:
            source = PointSource(Camera.of(telecentric), u * 0.1575, v * 0.1575, 350.0)
            quarter = point_image(source, big, (PAPER.wavelength,), 0.02)
            total += quarter + quarter[::-1] + quarter[:, ::-1] + quarter[::-1, ::-1]
    cell = sum(total[i : i + 13, j : j + 13] for i in range(0, 78, 13) for j in range(0, 78, 13))
    # One pupil's light in every footprint: a pixel inside a geometric image would get q^2 / image area.
    lines, seen, transfer = planned(telecentric)
    scale = (np.pi * (telecentric.D_F * telecentric.d_2 / 100 / 2) ** 2 / telecentric.q**2) / n**2
    white = harmonic_series(seen, transfer).at(*pixel_centres(seen, big))[:13, :13]
    assert lines.on("microlens_diffraction")
    assert np.sqrt(np.mean((cell * scale - white) ** 2)) < 0.02  # tails beyond the patch, 4 x 4 points


@pytest.mark.parametrize(("f_ml", "fill", "points"), [(2.0, 1.0, 4), (3.0, 1.0, 4), (2.0, 2.0, 6)])
def test_error_of_the_incoherent_model_for_a_texture(f_ml, fill, points, light_from_48_px):
    """A grating of four pitches on the focal plane: coherent points, added up, against rays and one convolution."""
    # Images repeat every 13 pixels exactly; a point's light spans 0.28 pitch on the array, or 0.14.
    telecentric = PAPER.replace(d_3=100.0, q=PAPER.d / 13, f_ml=f_ml, D_F=3.15 * fill)
    period, cells, pitch = 4, 9, 0.1575
    side = 13 * cells
    middle = Region(telecentric.pixels[0] // 2 - side // 2, telecentric.pixels[1] // 2 - side // 2, side, side)
    truth = np.zeros((13, 13 * period))
    steps = (np.arange(points // 2) + 0.5) / points
    for u in steps:
        for v in steps:
            quarter = point_image(
                PointSource(Camera.of(telecentric), u * pitch, v * pitch, 350.0), middle, (PAPER.wavelength,), 0.02
            )
            for sign, image in ((1, quarter), (-1, quarter[:, ::-1])):
                # Sources in all cells along y; along x each cell's source with its own brightness.
                folded = sum(image[13 * j : 13 * j + 13] for j in range(cells))
                folded = folded + folded[::-1]
                for cell in range(-cells, cells + period):
                    bright = 0.5 * (1 + np.cos(2 * np.pi * (sign * u + cell) / period))
                    for place in range(period):
                        piece = place + cell + cells // 2
                        if 0 <= piece < cells:
                            truth[:, 13 * place : 13 * place + 13] += bright * folded[:, 13 * piece : 13 * piece + 13]
    scene = Scene(objects=(Plane(texture=Sinusoid(period=period * pitch)),))
    region = (middle.column + 13 * (cells // 2), middle.row + 13 * (cells // 2), 13 * period, 13)
    sampling = RaySampling(256, 256, 0.0)
    image = render(telecentric, scene, region=region, overrides=["-cos4"], sampling=sampling).pixels
    truth *= image.mean() / truth.mean()  # 2 % of the light lies in tails beyond the patch
    missed = np.sqrt(np.mean((image - truth) ** 2))
    assert missed < 0.02 * fill**2
    assert missed < incoherent_texture_miss(Camera.of(telecentric), period) < 2 * missed


@pytest.mark.parametrize(
    ("changes", "textured"),
    [
        ({"microlens_array.focal_length": 2.5}, True),
        ({"microlens_array.focal_length": 5.0, "microlens_array.rotation": 0.2}, True),
        ({"microlens_array.focal_length": 3.0, "microlens_array.lens_shape": "circular"}, True),
        ({"microlens_array.focal_length": 3.0, "microlens_array.tilt": (0.01, 0.0)}, False),
    ],
    ids=["a quarter off", "far off, turned", "round", "white, traced"],
)
def test_a_wall_without_contrast_looks_like_a_white_field_out_of_focus(changes, textured, light_from_48_px):
    """Through whole microlenses and through their middles alike: uniform light has no detail that could tell."""
    design = PAPER.replace(changes)
    region, sampling = (2280, 1520, 12, 12), RaySampling(512, 512, 0.0)
    wall = Scene(objects=(Plane(texture=Uniform(level=1.0)),)) if textured else None
    white, image = (
        render(design, scene, region=region, overrides=["-cos4", f"{sign}finite_microlens_aperture"], sampling=sampling)
        for scene, sign in ((None, "-"), (wall, "+"))
    )
    assert np.abs(image.pixels - white.pixels).max() < 6e-3  # 512 rays a pixel


def test_tails_where_the_array_ends_are_as_wide_as_was_asked():
    """Pixels of 1 um are small against a blur of 17 um; beyond the last microlens nothing stands in for its light."""
    design = PAPER.replace({"microlens_array.size": (8.0, 8.0)}, q=0.001)
    _, seen, _ = planned(design)
    lattice = ImageLattice.of(seen)
    last = lattice.image(np.array([62, 62]))  # 125 microlenses of 0.063 mm and a rim
    assert lattice.holds(np.array([[62, 62], [63, 62]])).tolist() == [True, False]
    column, row = (int(c / 0.001 + n / 2) for c, n in zip(last, design.pixels, strict=True))
    region = Region(column - 10, row - 10, 60, 60)
    pupil = huygens.disc(PAPER.D_F / 2, 40)
    x, y = (c[::6] - at for c, at in zip(pixel_centres(seen, region), last, strict=True))
    area = np.pi * (2.9 * 35 / 23 * 2 / 140 / 2) ** 2
    near, far = (
        huygens.square_images(seen, pupil, x, y, 0.062726086956521737 * np.arange(-n, 1), 60 + 12 * n) * area
        for n in (8, 16)
    )
    for asked in (0.01, 0.003):
        budget = Budget(intensity=asked)
        whole = render(design, region=region, budget=budget, overrides=["-cos4"]).pixels
        assert np.abs(whole[::6, ::6] - (2 * far - near)).max() < asked
    beside = region._replace(column=column, columns=6)
    part = render(design, region=beside, budget=budget, overrides=["-cos4"]).pixels
    np.testing.assert_allclose(part, whole[:, 10:16], atol=2e-6)  # of the transforms, in single precision


def test_what_only_pixels_beside_would_get_is_not_traced():
    scene = Scene(objects=(Plane(texture=Sinusoid(period=3.0)),))
    given = {"region": (2000, 1500, 120, 40), "sampling": RaySampling(4, 4, 1e-6)}
    whole = render(PAPER, scene, **given)
    part = render(PAPER, scene, inner=(2040, 1510, 40, 20), **given)
    assert part.rays < 0.8 * whole.rays
    # Fourier transforms round.
    np.testing.assert_allclose(part.pixels[10:30, 40:80], whole.pixels[10:30, 40:80], atol=1e-6)
