"""Samples that lie between pixels: what interpolation passes, and neighbours' light in images sharper than pixels."""

import math

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.calibration.decoding import Decoder, LightField, read_between
from roslf_design.calibration.lattice import CentreLattice
from roslf_design.camera import Camera
from roslf_design.depth.pictures import Framed, Unexposed, default_scene
from roslf_design.depth.unmixing import ViewLight
from roslf_design.imaging.camera import Region
from roslf_design.theory.exit_pupil import microlens_image_diameter, microlens_image_pitch

LENSES, FINE = 12, 16
"""Microlenses along each side of the picture, and points a pixel that it is summed over."""


@pytest.mark.parametrize("pitch", [9.0, 9.25, 9.37])
def test_interpolation_passes_of_a_wave_what_decoding_leaves_of_it(pitch):
    """All samples lie alike between pixels where the pitch is whole, in four ways, and nearly in all."""
    lattice, frequency = CentreLattice((20.3, 21.8), (pitch, 0.0), (0.0, pitch), "square"), 0.31
    columns = np.arange(900)
    field = Decoder.of(lattice, (60, 900))(np.tile(np.exp(2j * math.pi * frequency * columns).real + 2, (60, 1)))
    lens, s = 20.3 + pitch * field.u[:, None], field.s
    # Waves are real: what decoding leaves of cosines, a fit tells.
    angle = 2 * math.pi * frequency * (lens + s)
    terms = np.stack([np.cos(angle).ravel(), -np.sin(angle).ravel(), np.ones(angle.size)], -1)
    values, light = (np.moveaxis(part[4, :, 1], 0, -1).ravel() for part in (field.values, field.weight))
    real, imaginary, _ = np.linalg.lstsq(terms[light > 0], values[light > 0], rcond=None)[0]
    assert read_between(frequency, field.between[0].ravel()) == pytest.approx(real + 1j * imaginary, abs=2e-3)


def pictures(camera, pixel, spot, *brightness):
    """Pictures of microlenses of a `brightness` each, by sums over a disc and diffraction of a square; their lattice.

    Places of images are whole numbers of `FINE` parts of a pixel of width `pixel`.
    """
    from scipy import signal  # a second of every worker's, where only one comes here

    pitch = float(microlens_image_pitch(camera)) / pixel
    radius, step = float(microlens_image_diameter(camera)) / pixel / 2, 1 / FINE
    reach = int(2 * pitch)
    at = (np.arange(2 * reach * FINE + 1) - reach * FINE) * step
    sharp = 4  # rims of the disc, within a step
    finer = ((np.arange(sharp) + 0.5) / sharp - 0.5) * step
    disc = sum((np.hypot(at[:, None] + a, at + b) < radius) for a in finer for b in finer) / sharp**2
    box = np.abs(finer[:, None] + at) < 0.5
    lines = signal.fftconvolve(np.sinc(at / spot) ** 2 / spot * step, box.mean(0) * step, "same")
    one = signal.fftconvolve(signal.fftconvolve(disc, lines[:, None], "same"), lines[None], "same")
    size, first = math.ceil((LENSES + 5) * pitch), 3 * pitch + 0.25
    made = np.zeros((len(brightness), size, size))
    for lens in np.ndindex(brightness[0].shape):
        places = [round((first + n * pitch) * FINE) for n in lens]
        begin = [-(-place // FINE) - reach for place in places]
        row, column = (n * FINE - place + reach * FINE for n, place in zip(begin, places, strict=True))
        part = one[row::FINE, column::FINE]
        place = tuple(slice(n, n + m) for n, m in zip(begin, part.shape, strict=True))
        for whole, values in zip(made, brightness, strict=True):
            whole[place] += values[lens] * part
    return *made, CentreLattice((first, first), (pitch, 0.0), (0.0, pitch), "square")


@pytest.mark.parametrize("pitch", [239 / 16, 15.0])
def test_neighbours_light_is_taken_off_where_images_are_sharper_than_pixels(pitch):
    """In the focal plane each microlens sees one brightness, whatever the view; cubic interpolation mixes rims."""
    design = roslf.load("ear-speculum")
    pixel = float(microlens_image_pitch(Camera.of(design))) / pitch
    design = design.replace({"sensor.pixel": pixel})
    camera = Camera.of(design)
    spot = float(camera.wavelength * camera.d_2 / camera.d) / pixel
    true = np.random.default_rng(1).uniform(0.5, 1.5, (LENSES, LENSES))
    taken, white, lattice = pictures(camera, pixel, spot, true, np.ones_like(true))
    field = Decoder.of(lattice, taken.shape, white=white)(taken)
    inner = np.s_[:, :, 3:-3, 3:-3]
    rows, columns = (np.rint(axis).astype(int) for axis in (field.v, field.u))
    truth = np.zeros((len(rows), len(columns)))
    known = (rows >= 0) & (rows < LENSES), (columns >= 0) & (columns < LENSES)
    truth[np.ix_(*known)] = true[np.ix_(rows[known[0]], columns[known[1]])]

    def slant(of: LightField) -> float:
        """Slope over the FAP of what samples show of their neighbours on both sides, the estimator's bias."""
        light = ViewLight(camera, of)
        own = light.without_crosstalk(of)
        off, weight = (own.values - truth)[inner], own.weight[inner]
        apart = (0.5 * (np.roll(truth, -1, 1) - np.roll(truth, 1, 1)))[3:-3, 3:-3]
        at = light.looks[0][0][:, :, None, None]
        return float((weight * off * at * apart).sum() / (weight * at**2 * apart**2).sum())

    assert abs(slant(field)) < 5e-4
    assert abs(slant(field_without(field))) > 6e-3


def field_without(field):
    """The light field, its samples taken to be read where pixels are."""
    return LightField(field.values, field.weight, field.s, field.t, field.u, field.v, field.pitch)


def test_microlenses_of_the_margin_are_lit_however_many_pixels_they_have(monkeypatch):
    """Of coarse pitches, light that diffracts reaches less far than the margin: it was left dark, and measured so."""
    monkeypatch.setattr("roslf_design.imaging.transfer.LEAST_HALO", 24)
    monkeypatch.setattr("roslf_design.imaging.transfer.LEAST_PITCHES", 0)
    design = roslf.load("paper")
    scene, part = default_scene(design), Region(2280, 1520, 40, 40)
    shown = Unexposed.of(design, scene, Framed.of(design, scene, part), rays=16).scene.pixels
    rim = np.concatenate([shown[:13], shown[-13:], shown[:, :13].T, shown[:, -13:].T], axis=1)
    cells = rim[:, : rim.shape[1] // 13 * 13].reshape(13, -1, 13).mean((0, 2))
    assert cells.min() > 0.5 * np.median(shown)


class Grown:
    """A lens that makes whole images larger than first order has them, and brings them nearer together."""

    def cut(self, images):
        return images

    def images(self, places):
        return np.broadcast_to(np.diag([1.06, 1.03]), (len(places), 2, 2))

    def apart(self, places):
        return np.broadcast_to(np.diag([0.99, 0.995]), (len(places), 2, 2))

    def aside(self, places, pupil):
        return np.zeros_like(pupil)

    def parts(self, camera, field, places):
        return None


def test_light_at_places_between_pixels_is_on_average_that_of_all_behind_a_real_lens():
    """Where one place stands for all, light between pixels left out what the lens makes of images: .3 at rims."""
    design = roslf.load("ear-speculum")
    pitch = 239 / 16
    pixel = float(microlens_image_pitch(Camera.of(design))) / pitch
    camera = Camera.of(design.replace({"sensor.pixel": pixel}))
    at, u = np.arange(-8.0, 9.0), np.arange(16.0)
    ranks = (np.arange(u.size) + 0.5) / u.size
    between = np.stack(np.meshgrid(ranks, ranks)).astype(np.float32)
    blank = np.ones((at.size, at.size, u.size, u.size), np.float32)
    field = LightField(blank, blank, at, at, u, u, pitch, between=between)
    light = ViewLight(camera, field, Grown())
    each, maps, *_ = light._mixed
    parts = light.parts[2]
    assert each.light.shape[1] > 1
    mean = maps(np.moveaxis(each.light, 1, -1)).mean((-2, -1))
    np.testing.assert_allclose(mean, parts.light[:, 0], atol=5e-4)
