"""Builds behind a real lens, each written out as a design of its own and traced alone."""

from typing import NamedTuple

import numpy as np

from roslf_design.tolerancing.traced import as_built
from roslf_design.traced.camera import camera_of, microlenses
from roslf_design.traced.images import real_images


class Apart(NamedTuple):
    """Largest differences between builds traced together and each alone, over their fields."""

    centre_px: float
    diameter_share: float
    kept_fraction: float


def apart(design, builds, values):
    """How far builds of a design, by their numbers `values` at places, are from each of them alone."""
    off = np.zeros(3)
    chief, sizes = np.stack(builds.chief, axis=-1), np.asarray(builds.diameter)
    shares = builds.shapes.kept_fraction
    for trial in range(builds.trials):
        one = as_built(design, {place: float(numbers[trial]) for place, numbers in values.items()})
        at = microlenses(one, builds.fields)
        images = real_images(camera_of(one), at)
        there = at + images.chief - np.subtract(one.sensor.decentre, one.main_lens.decentre)
        centre = (there - chief[:, trial]) / one.q
        differences = centre, images.diameter / sizes[:, trial] - 1, images.kept_fraction - shares[:, trial]
        off = np.maximum(off, [np.max(np.abs(part[np.isfinite(part)]), initial=0.0) for part in differences])
    return Apart(*off.tolist())
