"""Light fields of a known continuous texture, and their disparity's Fisher information by numerical derivatives."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from roslf_design.calibration.decoding import LightField
from roslf_design.depth import geometry, measure
from roslf_design.imaging import sampling, transfer


def fewer_rays(patch):
    """Pictures that depth is simulated with, by a fifth of the work: a quarter of the rays, light from 48 px around.

    Depths scatter twice as much, and as many are known: where what is said of them counts, not how good they are.
    """
    patch.setattr(transfer, "LEAST_HALO", 48)
    patch.setattr(transfer, "LEAST_PITCHES", 0)
    patch.setattr(sampling, "RAYS", sampling.RAYS // 4)
    patch.setattr(sampling, "LEAST_RAYS", sampling.LEAST_RAYS // 4)


def at_first_sight(patch):
    """Depths of pictures as they are first seen, before phases and neighbours' light: where nobody looks at them."""
    patch.setattr(geometry._ArrayViewing, "at_phase", lambda *_: None)
    patch.setattr(measure, "with_shared_light", lambda *given: given[4:6])
    patch.setattr(measure, "PREDICTED", 1)


@dataclass(frozen=True)
class Texture:
    """A sum of sinusoids of random directions and phases, as many an octave: amplitudes fall as 1/f over the plane."""

    waves: np.ndarray
    """Amplitude, radians a pitch along u and v, phase; shape (wave, 4)."""
    mean: float = 0.4

    @classmethod
    def of(cls, seed, contrast, finest=0.3, count=60, mean=0.4):
        rng = np.random.default_rng(seed)
        frequency = np.exp(rng.uniform(math.log(0.03), math.log(finest), count))
        angle = rng.uniform(0, 2 * np.pi, count)
        along, down = frequency * np.cos(angle), frequency * np.sin(angle)
        amplitude = np.sinc(along) * np.sinc(down)  # footprint of a microlens
        amplitude *= contrast * mean * math.sqrt(2 / np.sum(amplitude**2))
        phase = rng.uniform(0, 2 * np.pi, count)
        return cls(np.stack([amplitude, 2 * np.pi * along, 2 * np.pi * down, phase], axis=1), mean)

    def __call__(self, u, v):
        return self.mean + sum(a * np.cos(x * u + y * v + p) for a, x, y, p in self.waves)

    def grid(self, u, v, lower=0.0):
        """At rows v and columns u, each a line of places [pitches]; columns may stand `lower`, each by its own."""
        amplitude, along, down, phase = self.waves.T
        across = amplitude * np.exp(1j * (np.multiply.outer(u, along) - np.multiply.outer(lower, down) + phase))
        return self.mean + np.real(np.exp(1j * np.multiply.outer(v, down)) @ across.T)


def disc(across, cut=None):
    """Pupil coordinates (2, t, s) of `across` views a side, and which lie inside a full or cut disc."""
    side = (np.arange(across) - (across - 1) / 2) / across
    pupil = np.stack(np.broadcast_arrays(side[None, :], side[:, None]))
    inside = np.hypot(*pupil) <= 0.5
    if cut is not None:
        inside &= np.hypot(pupil[0] - cut, pupil[1]) <= 0.5
    return pupil, inside


def sharp(texture, disparity, pupil, lit, shape):
    """Views without noise, of a surface whose disparity is a number or a function of u [pitches]."""
    v, u = np.arange(float(shape[0])), np.arange(float(shape[1]))
    views = np.zeros((*pupil.shape[1:], *shape), np.float32)
    for t, s in np.argwhere(lit):
        along, down = pupil[:, t, s]
        if not callable(disparity):
            views[t, s] = texture.grid(u - disparity * along, v - disparity * down)
            continue
        place = u
        for _ in range(40):
            place = u - disparity(place) * along
        views[t, s] = texture.grid(place, v, disparity(place) * down)
    return views


def exposed(views, light, electrons, read, seed, saturation=math.inf):
    """A light field of noisy views under `light` (broadcast to theirs)."""
    rng = np.random.default_rng(seed)
    light = np.broadcast_to(light, views.shape).astype(np.float32)
    charge = rng.poisson(np.maximum(views, 0) * light * electrons) + read * rng.standard_normal(views.shape)
    values = np.divide(np.minimum(charge, saturation) / electrons, light, out=np.zeros(views.shape), where=light > 0)
    return field_of(values, light)


def field_of(values, light):
    t, s, v, u = (np.arange(float(n)) for n in values.shape)
    return LightField(values.astype(np.float32), light, s - s.mean(), t - t.mean(), u, v, float(len(s)))


def predicted_sigma(texture, disparity, pupil, lit, shape, electrons, read, window=5):
    """1/sqrt(Fisher information of B), each microlens's value free, of a full-lit field.

    The derivative of each view by B is taken numerically at the texture's own places (what the window follows), and the
    values' nuisance is removed by Schur's complement.
    """
    v, u = np.arange(float(shape[0])), np.arange(float(shape[1]))
    weight = electrons / (texture.grid(u, v) + read**2 / electrons)
    step, first, second, count = 1e-4, 0.0, 0.0, 0
    for along, down in pupil[:, lit].T:
        before, after = (texture.grid(u - b * along, v - b * down) for b in (-step, step))
        slope = (after - before) / (2 * step)
        first, second, count = first + slope, second + slope**2, count + 1
    information = weight * (second - first**2 / count)
    return 1 / np.sqrt(ndimage.uniform_filter(information, window, mode="constant") * window**2)
