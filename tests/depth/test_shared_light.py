"""Light that microlenses share: noise of disparities by it, and what neighbours send."""

import math

import numpy as np
import pytest
from scipy import ndimage

import roslf_design as roslf
from roslf_design.calibration.decoding import LightField, _HexagonalRows, squared
from roslf_design.camera import Camera
from roslf_design.depth.measure import SETTLING, _shared_noise
from roslf_design.depth.unmixing import LEAST, PreparedViews, ViewLight, _shown
from roslf_design.theory.disparity_error import image_parts, waves_shown
from roslf_design.theory.exit_pupil import microlens_image_pitch
from roslf_design.theory.stop_images import MicrolensImages
from tests.depth.made import Texture

WINDOW = 5


@pytest.mark.parametrize("c", [-0.6, -0.2, 0.4])
def test_noise_of_shared_pixels_is_that_of_pixels_drawn_one_by_one(c):
    """Each microlens has a pixel of its own and shares one with each of four neighbours, whose noise pulls both."""
    rng, first = np.random.default_rng(1), 1.7
    own, shared = math.sqrt(1 - abs(c)), math.sqrt(abs(c) / 4)

    def mean(pulls):
        return ndimage.uniform_filter(pulls, (0, WINDOW, WINDOW), mode="wrap")

    def neighbours(values):
        return sum(np.roll(values, step, axis) for step in (1, -1) for axis in (1, 2)) / 4

    pulls = own * rng.standard_normal((60, 60, 60))
    for axis in (1, 2):
        noise = shared * rng.standard_normal(pulls.shape)
        pulls += noise - math.copysign(1, c) * np.roll(noise, 1, axis)
    alone = mean(rng.standard_normal(pulls.shape)).var()
    before = mean(pulls + math.sqrt(first**2 - 1) * rng.standard_normal(pulls.shape))
    for _ in range(SETTLING):
        before = mean(pulls) + mean(c * neighbours(mean(before)))
    again, beside = _shared_noise(c, WINDOW)
    assert before.var() / alone == pytest.approx(again + beside * (first**2 - 1), rel=0.05)


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
    """A wave along the rows: made square they have 0.998, 0.89, 0.72 and 0.61 of its strength."""
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
    at = places[8:-8, 25:-25].ravel()
    wave = np.stack([np.cos(turn * at), np.sin(turn * at), np.ones(at.size)], -1)
    strength = math.hypot(*np.linalg.lstsq(wave, shown[8:-8, 25:-25].ravel(), rcond=None)[0][:2])
    assert strength == pytest.approx(0.3, rel=0.02)


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
