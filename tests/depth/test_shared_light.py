"""Light that microlenses share: noise of disparities by it, and what neighbours send."""

import math
from typing import Any

import numpy as np
import pytest
from scipy import ndimage

import roslf_design as roslf
from roslf_design.calibration.decoding import LightField, _HexagonalRows, left_by_rows, squared
from roslf_design.camera import Camera
from roslf_design.depth.crosstalk import _shared_noise
from roslf_design.depth.mixing import LEAST
from roslf_design.depth.unmixing import FREQUENCIES, TURNS, PreparedViews, ViewLight, _shown, returned
from roslf_design.theory.exit_pupil import microlens_image_pitch
from roslf_design.theory.image_parts import image_parts, waves_shown
from roslf_design.theory.stop_images import MicrolensImages
from tests.depth.made import Texture

WINDOW = 5


def by_waves(c, back):
    """Variance of disparities over a wide field, by the spectra of their errors; the median taken for the mean."""
    k = np.fft.fftfreq(128)
    lines = np.sinc(WINDOW * k) / np.sinc(k)
    lag, wide = WINDOW // 2 + 2, np.sinc((2 * WINDOW + 1) * k) / np.sinc(k)
    bends = 2 * (1 - np.cos(2 * math.pi * lag * k)) * (WINDOW**2 - 1) / 24 / lag**2
    mean, near = np.multiply.outer(lines, lines), np.add.outer(np.cos(2 * math.pi * k), np.cos(2 * math.pi * k)) / 2
    smoothed = mean * (1 + 2 * np.add.outer(bends, bends) * np.multiply.outer(wide, wide))
    times = back * near * mean * smoothed
    square = (1 - c * near) / (1 - times) ** 2
    return (mean**2 * square).mean() / (mean**2).mean()


@pytest.mark.parametrize(("c", "back"), [(-0.6, -0.5), (-0.2, 0.0), (0.0, 0.2), (0.2, 0.2), (0.4, 0.6)])
def test_noise_of_shared_pixels_is_that_of_their_spectrum(c, back):
    """Pixels that two microlenses share pull both; errors come back until they settle, smoothed and straightened."""
    drawn = _shared_noise(c, back, WINDOW, (100, 100))
    assert drawn == pytest.approx(by_waves(c, back), rel=0.1)


def test_the_picture_brings_back_as_much_of_an_error_as_is_seen_when_neighbours_are_taken_off():
    """By views that are freed along disparities that are off, again and again: nothing of waves and their sums."""
    paper, disparity = roslf.load("paper"), -0.4
    camera = Camera.of(paper.replace({"aperture.diameter": 1.4 * paper.D_F}))
    pitch = abs(float(microlens_image_pitch(camera) / camera.q))
    s, u, off = np.arange(-9, 10.0), np.arange(28.0) - 14, 0.02
    images = MicrolensImages(camera, [(0.0, 0.0)])
    light = image_parts(images, s / pitch, s / pitch).light.sum(0)[0]
    lit = (np.where(light > 0.1, light, 0)[..., None, None] * np.ones((28, 28))).astype(np.float32)
    field = LightField(np.ones_like(lit), lit, s, s, u, u, pitch)
    views = ViewLight(camera, field)
    looks = PreparedViews(field, *views.looks)
    # Every wave that is summed over, each as strong in every octave.
    rng, picture, slope = np.random.default_rng(2), np.full((28, 28), 5.0), np.zeros((2, 28, 28))
    for turn in math.pi * np.arange(TURNS) / TURNS:
        for k in 0.5 * np.array(FREQUENCIES):
            way = 2 * math.pi * k * np.array([math.cos(turn), math.sin(turn)])
            angle = way[0] * u + way[1] * u[:, None] + rng.uniform(0, 2 * math.pi)
            picture += 0.03 / math.sqrt(k) * np.cos(angle)
            slope -= 0.03 / math.sqrt(k) * way[:, None, None] * np.sin(angle)

    def freed(b, shown):
        return views.with_shared(field, looks, np.full((28, 28), b), shown).field

    right = freed(disparity, picture)
    weight, pupil = right.weight.astype(float), looks.pupil[..., None, None]

    def mean(values):
        return (weight * values).sum((0, 1)) / np.maximum(weight.sum((0, 1)), 1e-12)

    def at_middle(change):  # the view from s sees at u + B s what the middle sees at u
        out = np.empty_like(change)
        for t, n in np.ndindex(*change.shape[:2]):
            out[t, n] = ndimage.shift(change[t, n], -disparity * looks.pupil[::-1, t, n], order=5, mode="nearest")
        return out

    change = np.zeros_like(picture)
    for _ in range(5):
        change = mean(at_middle(freed(disparity + off, picture + change).values - right.values))
    moved = at_middle(freed(disparity, picture + change).values - right.values)
    lever = (pupil[0] - mean(pupil[0])) * slope[0] + (pupil[1] - mean(pupil[1])) * slope[1]
    inner = (..., slice(7, -7), slice(7, -7))
    brought = -(weight * lever * moved)[inner].sum() / (weight * lever**2)[inner].sum() / off
    expected = returned(views, looks._replace(field=right), disparity)
    assert 0.1 < expected < 0.4
    assert brought == pytest.approx(expected, abs=0.02)


def test_neighbours_show_the_finest_detail_where_it_is():
    """A wave of 2.5 microlenses from off the pupil's middle; by splines of single samples it was 0.09 radians off."""
    at = np.arange(40.0)
    field = LightField(np.zeros((1, 1, 40, 40)), np.ones((1, 1, 40, 40)), np.zeros(1), np.zeros(1), at, at, 10.0)
    looks, turn = PreparedViews(field, np.array([[[0.4]], [[0.0]]])), 2 * math.pi * 0.4
    picture = 1 + 0.3 * np.cos(turn * at) * np.ones((40, 1))
    shown = _shown(field, np.ones((1, 1), bool), looks, np.full((40, 40), 0.6), picture)[0]
    inner = np.s_[10:-10, 10:-10]
    expected = 1 + 0.3 * np.cos(turn * (at - 0.4 * 0.6)) * np.ones((40, 1))
    np.testing.assert_allclose(shown[inner], expected[inner], atol=0.3 * 0.01)


@pytest.mark.parametrize("periods", [0.1, 0.3, 0.4, 0.45])
def test_neighbours_in_hexagonal_rows_show_waves_as_strong_as_they_are(periods):
    """A wave along the rows: made square they have 1.00, 0.99, 0.92 and 0.77 of its strength."""
    rows, columns, rise, turn = 30, 160, math.sqrt(0.75), 2 * math.pi * periods
    starts = -80.0 + 0.5 * (np.arange(rows) % 2)
    places = starts[:, None] + np.arange(columns)
    values = (1 + 0.3 * np.cos(turn * places))[None, None].astype(np.float32)
    u, v = rise * np.arange(-85, 86), rise * np.arange(rows)
    even, weight = squared(values, np.ones_like(values), u, starts)
    hexagonal = _HexagonalRows(values, np.ones_like(values), starts)
    field = LightField(even, weight, np.zeros(1), np.zeros(1), u, v, 10.0, hexagonal)
    looks = PreparedViews(field, np.zeros((2, 1, 1)))
    shown = _shown(field, np.ones((1, 1), bool), looks, np.zeros(even.shape[2:]), even[0, 0].astype(float))[0]

    def strength(samples: Any, at: Any) -> float:
        wave = np.stack([np.cos(turn * at), np.sin(turn * at), np.ones_like(at)], -1)
        return math.hypot(*np.linalg.lstsq(wave, samples, rcond=None)[0][:2])

    assert strength(even[0, 0, 8, 25:-25], u[25:-25]) == pytest.approx(0.3 * left_by_rows(periods), rel=0.02)
    assert strength(shown[8:-8, 25:-25].ravel(), places[8:-8, 25:-25].ravel()) == pytest.approx(0.3, rel=0.02)


def test_light_from_beyond_the_picture_is_not_made_up():
    """A wall in focus, of which the views of every microlens show the same, up to the field's rims.

    What lies beyond was taken to look like the microlens itself: samples of the outermost were off by three times the
    texture's rms. A fiftieth of a sample's light from there may be, of which three tenths are its own.
    """
    paper = roslf.load("paper")
    camera = Camera.of(paper.replace({"aperture.diameter": 1.4 * paper.D_F}))
    pitch = abs(float(microlens_image_pitch(camera) / camera.q))
    s, u, images = np.arange(-9, 10.0), np.arange(12.0) - 6, MicrolensImages(camera, [(0.0, 0.0)])
    texture = Texture.of(3, 0.2)
    amplitude, *turns, phase = texture.waves.T
    raw = waves_shown(images, s / pitch, s / pitch, np.transpose(turns) / (2 * math.pi), np.zeros(1))[0][:, 0]
    along, down = (np.exp(1j * np.multiply.outer(turn, u)) for turn in turns)
    waves = (amplitude * np.exp(1j * phase))[:, None, None] * down[:, :, None] * along[:, None]
    light = image_parts(images, s / pitch, s / pitch).light.sum(0)[0]
    lit = np.where(light > 0.1, light, 0)[..., None, None] * np.ones((12, 12))
    values = texture.mean + np.einsum("wts,wvu->tsvu", raw, waves).real
    field = LightField(values.astype(np.float32), lit.astype(np.float32), s, s, u, u, pitch)
    views, shown = ViewLight(camera, field), texture.grid(u, u)
    shared = views.with_shared(field, PreparedViews(field, *views.looks), np.zeros((12, 12)), shown).field
    off = np.where(shared.weight > 0, shared.values - shown, 0)
    usable, own, _ = views.sharing
    mixed = off[usable][own[:, 0, 0] <= LEAST]  # others tell by their own light, whatever lies beyond
    assert mixed.any()
    assert np.abs(mixed).max() < 0.25 * shown.std()
    assert np.abs(off[..., 2:-2, 2:-2]).max() < 0.1 * shown.std()
    telling = (shared.weight > 0).sum((0, 1))[2:-2, 2:-2]
    assert telling.min() == telling.max() > 200
