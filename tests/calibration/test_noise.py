"""Sensors whose figures are known, by frames drawn with numpy: Poisson light, read noise, unlike pixels, rounding."""

import functools

import numpy as np
import pytest

from roslf_design.calibration import find_centres, white_profile
from roslf_design.calibration.frames import Repeated
from roslf_design.calibration.noise import _root, measured_sensor
from roslf_design.calibration.white_profile import WhiteFrame
from roslf_design.design.parts import Sensor

SIDE, PITCH, BLACK, TOP = 150, 13.13, 100, 4095
GAIN, READ, PRNU, DSNU, PEAK = 2.6, 4.0, 0.01, 1.5, 8000


def evenly():
    """Microlens images, soft at their rims, darker towards the corners, turned by 4 mrad."""
    y, x = np.mgrid[:SIDE, :SIDE].astype(float)
    u, v = (x + 0.004 * y) / PITCH, (y - 0.004 * x) / PITCH
    away = np.hypot(u - np.rint(u), v - np.rint(v)) * PITCH
    images = (1 - 0.1 * (away / 5.4) ** 2) / (1 + np.exp((away - 5.4) / 0.8)) + 0.02
    return images * (1 - 0.15 * ((x - SIDE / 2) ** 2 + (y - SIDE / 2) ** 2) / SIDE**2)


class Drawn:
    """Frames of one sensor."""

    def __init__(self, seed, gain=GAIN, read=READ, prnu=PRNU, dsnu=DSNU, black=BLACK):
        self.rng, self.gain, self.read, self.black = np.random.default_rng(seed), gain, read, black
        self.response = 1 + prnu * self.rng.normal(size=(SIDE, SIDE))
        self.offset = dsnu * self.rng.normal(size=(SIDE, SIDE))

    def charge(self, peak):
        """Electrons of a frame whose lamp is off by some parts in a thousand."""
        light = evenly() * peak * self.response * (1 + 0.005 * self.rng.normal())
        return self.rng.poisson(light) + self.offset + self.read * self.rng.normal(size=light.shape)

    def frames(self, peak, count=2):
        counts = (np.rint(self.charge(peak) / self.gain + self.black) for _ in range(count))
        return [np.clip(frame, 0, TOP).astype(np.uint16) for frame in counts]


def together(frames):
    return functools.reduce(Repeated.plus, frames[1:], Repeated.of(frames[0]))


def measured(whites, darks, colours=False, images=True):
    """Figures of frames of each exposure, the brightest that is not saturated first.

    Microlens images are fitted for the PRNU alone: `images` is False where nothing is said of it.
    """
    whites, darks = [together(frames) for frames in whites], None if darks is None else together(darks)
    dark = 0.0 if darks is None else darks.mean
    centres = find_centres(whites[0].averaged, None if darks is None else darks.averaged, layout="square", pitch=PITCH)
    white = WhiteFrame((whites[0].mean - dark).astype(np.float32), float(TOP))
    profile = white.profile(centres, None) if images else None
    return measured_sensor(whites, darks, profile, centres, colours)


def off(figure, truth):
    """Standard errors off the truth; a bound that holds is none off."""
    if figure.bound:
        holds = truth <= figure.value if figure.bound == "at most" else truth >= figure.value
        return 0.0 if holds else np.inf
    return (figure.value - truth) / figure.sigma


@pytest.mark.parametrize("sensor", [
    {"gain": 0.4, "read": 2.0, "peak": 1200}, {"read": 20.0, "peak": 2500},
    {"prnu": 0.003, "dsnu": 0.4, "count": 4},
], ids=["fine steps", "noisy", "even pixels, four frames"])  # fmt: skip
def test_figures_are_within_their_errors(sensor):
    """Of two draws of four figures: within two errors but by chance, which puts more than two out once in 170; and
    errors are no excuse."""
    sensor = {"gain": GAIN, "read": READ, "prnu": PRNU, "dsnu": DSNU, "peak": PEAK, "count": 2} | sensor
    peak, count = sensor.pop("peak"), sensor.pop("count")
    misses = []
    for seed in range(2):
        drawn = Drawn(seed, **sensor)
        found = measured([drawn.frames(peak, count)], drawn.frames(0, count))
        assert found.untold == ()
        assert found.gain.sigma < 0.03 * found.gain.value
        assert found.read_noise.sigma < 0.03 * found.read_noise.value
        assert found.prnu.sigma < 0.0015
        assert found.full_well.bound == "at least"
        assert peak * 0.9 < found.full_well.value < peak * 1.1
        misses += [off(getattr(found, name), sensor[name]) for name in ("prnu", "dsnu", "gain")]
        misses.append(off(found.read_noise, sensor["read"]))
    assert np.sum(np.abs(misses) > 2) <= 2
    assert np.max(np.abs(misses)) < 4


def test_images_that_darken_by_any_law_are_fitted_in_few_steps(monkeypatch):
    """One that falls with the fourth power went on for thirty and more, a fifth less each, and was left out."""
    white = together(Drawn(0).frames(PEAK))
    centres = find_centres(white.averaged, None, layout="square", pitch=PITCH)
    frame = WhiteFrame((white.mean - BLACK).astype(np.float32), float(TOP))
    images = []
    for rounds in (14, 200):
        monkeypatch.setattr(white_profile, "_ROUNDS", rounds)
        images.append(frame.profile(centres, None).image)
    assert images[0].radius == pytest.approx(images[1].radius, rel=1e-4)
    assert images[0].dimmer == pytest.approx(images[1].dimmer, abs=1e-3)


def test_several_exposures_tell_the_full_well():
    drawn = Drawn(5)
    found = measured([drawn.frames(PEAK), drawn.frames(PEAK / 3), drawn.frames(16_000)], drawn.frames(0))
    assert found.white_frames == (2, 2, 2)
    assert not found.full_well.bound
    assert abs(off(found.full_well, (TOP - BLACK) * GAIN)) < 3
    assert abs(off(found.gain, GAIN)) < 3
    known = found.known(Sensor(distance="2 mm", pixel="5 um", size=["5 mm", "5 mm"]))
    assert known["full_well"] == found.full_well.value
    assert known["prnu"] == found.prnu_left.value < PRNU
    # The mean of two frames has the noise of light, halved, and of the dark frames.
    share = np.sqrt((evenly().max() * PEAK * 0.9 + 2 * READ**2) / 2) / (evenly().max() * PEAK * 0.9)
    assert found.prnu_left.value == pytest.approx(share, rel=0.1)
    assert found.dsnu_left.value == pytest.approx(np.sqrt(READ**2 + GAIN**2 / 12) / np.sqrt(2), rel=0.03)


def test_drift_of_the_lamp_is_no_noise_of_light():
    drawn = Drawn(6)
    first, second = drawn.frames(PEAK)
    brighter = np.clip(np.rint((drawn.charge(1.02 * PEAK)) / GAIN + BLACK), 0, TOP).astype(np.uint16)
    for frames in ([first, second], [first, brighter]):
        assert abs(off(measured([frames], drawn.frames(0), images=False).gain, GAIN)) < 3


def test_defective_pixels_are_counted_and_left_out():
    drawn = Drawn(7)
    white, dark = drawn.frames(PEAK), drawn.frames(0)
    for frame in (*white, *dark):
        frame[20:140:30, 25:140:30] = 3900
    found = measured([white], dark, images=False)
    assert found.defective_pixels == 16
    assert abs(off(found.dsnu, DSNU)) < 3
    assert abs(off(found.read_noise, READ)) < 3


def test_images_without_noise_are_refused():
    frame = np.rint(evenly() * 3000 + BLACK).astype(np.uint16)
    dark = np.full_like(frame, BLACK)
    found = measured([[frame, frame]], [dark, dark])
    assert "do not differ" in found.untold[0]
    assert found.gain is found.read_noise is found.prnu is None
    smooth = np.float32(evenly())
    assert "do not differ" in measured([[smooth, smooth]], None, images=False).untold[0]


def test_one_frame_is_refused():
    drawn = Drawn(8)
    assert "two or more of one" in measured([drawn.frames(PEAK, 1)], drawn.frames(0), images=False).untold[0]
    found = measured([drawn.frames(PEAK)], drawn.frames(0, 1), images=False)
    assert "two dark frames" in found.untold[0]
    assert found.read_noise is None
    assert abs(off(found.gain, GAIN)) < 3
    found = measured([drawn.frames(PEAK)], None, images=False)
    assert "no full well and no PRNU" in found.untold[1]
    assert abs(off(found.gain, GAIN)) < 3
    assert "colour filters" in measured([drawn.frames(PEAK)], drawn.frames(0), colours=True).untold[0]


def test_clipped_frames_are_refused():
    drawn = Drawn(9, black=0)
    found = measured([drawn.frames(PEAK)], drawn.frames(0), images=False)
    assert "cut off at 0 counts" in found.untold[0]
    assert found.read_noise is None
    assert abs(off(found.gain, GAIN)) < 3
    full = together([np.full((SIDE, SIDE), TOP, np.uint16)] * 2)
    usual = together(drawn.frames(PEAK))
    centres = find_centres(usual.averaged, None, layout="square", pitch=PITCH)
    assert "saturated" in measured_sensor([full], None, None, centres).untold[0]


@pytest.mark.parametrize("power", [1 / 2.2, 0.7, 1.4])
def test_pixels_with_a_gamma_are_recognised(power):
    drawn = Drawn(10)

    def picture(peak):
        return np.rint(255 * np.clip(drawn.charge(peak) / 10_000 + 0.01, 0, 1) ** power).astype(np.uint8)

    found = measured([[picture(PEAK), picture(PEAK)]], [picture(0), picture(0)], images=False)
    assert found.gain is None
    assert "gamma" in found.untold[0] or "finer than the steps" in found.untold[0]


def test_colour_pictures_are_refused():
    drawn = Drawn(11)
    white = together(drawn.frames(PEAK))
    centres = find_centres(white.averaged, None, layout="square", pitch=PITCH)
    colour = together([np.stack([frame] * 3, -1) for frame in drawn.frames(PEAK)])
    assert "colour pictures" in measured_sensor([colour], None, None, centres).untold[0]


@pytest.mark.parametrize("truth", [0.0, 0.3, 0.5, 1.0, 2.0, 4.0, 9.0])
def test_roots_of_squares_near_their_errors_are_within_theirs(truth):
    """Of squares with an error of 1, roots or bounds of them: 954 of 1000 within two errors."""
    figures = [_root(truth + one, 1.0, 1.0, 0.0) for one in np.random.default_rng(2).normal(size=2000)]
    assert np.mean([abs(off(figure, np.sqrt(truth))) <= 2 for figure in figures]) > 0.94
