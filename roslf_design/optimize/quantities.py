"""What a design can be held to or optimised for: names, units, meanings, and values for many cameras at once.

Names and values follow `roslf evaluate --json` and the metrics of tolerance studies where those have them.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from .. import theory
from ..design import PATHS
from .cameras import Cameras

Array = NDArray[np.float64]

SIGMA_DISPARITY = 0.1
"""Disparity error that depth precision is told for [microlens pitches], as in `roslf evaluate`."""

At = Literal["never", "optional", "needed"]


@dataclass(frozen=True)
class Quantity:
    """A number of a camera."""

    name: str
    unit: str
    meaning: str
    of: Callable[[Cameras, float | None], Array]
    """Values for cameras and a distance ahead of the bore's tip [mm]; with a leading axis where `worst` is set."""
    positive: bool = True
    """Whether every camera that can be built has it above zero: then ratios count, not differences."""
    at: At = "never"
    """Whether it is asked for at a distance."""
    worst: Callable[[Array], Array] | None = None
    """Of several values (one a rim) the one that counts."""
    monotone: bool = True
    """Whether it rises or falls in each single design length throughout, the others held, f excepted where
    `bent_in_f`: its extremes over a box then lie at corners."""
    bent_in_f: bool = False
    magnitude: bool = False
    """Whether it is the magnitude of something of either sign, which `signed` gives."""

    @property
    def length(self) -> bool:
        """Whether limits are lengths."""
        return self.unit == "mm"


def _room(c: Cameras, _: float | None) -> Array:
    """Room at the corner of the field, for the main lens and each stop (Eqs. 5-6, with decentres); shape (K, ...)."""
    gap = c.d_f - c.d_3
    radius = c.half_diagonal * c.object_scale
    own = c.decentre("aperture")
    rooms = []
    for diameter, distance, decentre in c.rims():
        offset = np.hypot(*(e * gap - o * (c.d_f - distance) for e, o in zip(decentre, own, strict=True)))
        axial = diameter * gap - c.D_F * (c.d_f - distance)
        rooms.append((axial - 2 * offset - 2 * radius * np.abs(c.d_3 - distance)) / (2 * gap))
    return np.stack(np.broadcast_arrays(*rooms))


def _undistorted(c: Cameras, _: float | None) -> Array:
    gap = c.d_f - c.d_3
    found = []
    for diameter, distance, _decentre in c.rims():
        axial = diameter * gap - c.D_F * (c.d_f - distance)
        found.append(axial / (2 * np.maximum(np.abs(c.d_3 - distance), 1e-12 * c.d_f)))
    return np.stack(np.broadcast_arrays(*found))


def _least(values: Array) -> Array:
    return np.asarray(values.min(axis=0))


def blur_signed(c: Cameras, at: float | None) -> Array:
    """Rim disparity at a distance [pitches], of either sign."""
    return theory.rim_disparity(c.depth(at), c.D_F, c.d, *c.optics)


def defocus_signed(c: Cameras, _: float | None) -> Array:
    """Microlens defocus blur [px] with its sign."""
    return c.d * (1 - c.d_2 / c.f_ml + c.d_2 * c.vergence) / c.q


SIGNED = {"blur_pitches": blur_signed, "microlens_defocus_px": defocus_signed}
"""Of quantities that are magnitudes: what they are the magnitude of."""


def _length(symbol: str) -> Callable[[Cameras, float | None], Array]:
    return lambda c, _: np.asarray(getattr(c, symbol))


def _table() -> tuple[Quantity, ...]:
    # d_3 alone may be 0.
    lengths = tuple(
        Quantity(symbol, "mm", f"the design's {place}", _length(symbol), positive=symbol != "d_3")
        for symbol, place in PATHS.items()
    )
    return (
        Quantity(
            "fill_factor",
            "",
            "microlens-image diameter over pitch, exact (Eq. 7)",
            lambda c, _: theory.fill_factor(c.D_F, c.d, c.d_2, *c.optics),
        ),
        Quantity(
            "mismatch_px",
            "px",
            "microlens-image diameter less pitch",
            lambda c, _: theory.matching_mismatch(c.D_F, c.d, c.q, c.d_2, *c.optics),
            positive=False,
            monotone=False,
        ),
        Quantity(
            "non_distortion_room_mm",
            "mm",
            "room between the corner field's pencil and the nearest rim (Eqs. 5-6): undistorted where >= 0",
            _room,
            positive=False,
            worst=_least,
        ),
        Quantity(
            "undistorted_field_mm",
            "mm",
            "largest undistorted object radius at the focal plane (Eq. 6)",
            _undistorted,
            positive=False,
            worst=_least,
            monotone=False,
        ),
        Quantity(
            "field_half_width_mm",
            "mm",
            "half the width that the sensor sees, at a distance ahead of the tip or at the focal plane",
            lambda c, at: c.half_sizes[0] * c.object_scale * _grown(c, at),
            at="optional",
        ),
        Quantity(
            "field_half_diagonal_mm",
            "mm",
            "the same to the corner",
            lambda c, at: c.half_diagonal * c.object_scale * _grown(c, at),
            at="optional",
        ),
        Quantity(
            "object_sample_mm",
            "mm",
            "footprint of one microlens, at a distance ahead of the tip or at the focal plane",
            lambda c, at: c.d * c.object_scale * _grown(c, at),
            at="optional",
        ),
        Quantity(
            "sigma_z_mm",
            "mm",
            "depth spread for a disparity error of 0.1 pitch, at a distance ahead of the tip or at the focal plane",
            lambda c, at: theory.depth_sigma(SIGMA_DISPARITY, c.depth(at), c.D_F, c.d, *c.optics),
            at="optional",
        ),
        Quantity(
            "blur_pitches",
            "pitches",
            "spread over the array of a point at a distance ahead of the tip",
            lambda c, at: np.abs(blur_signed(c, at)),
            positive=False,
            at="needed",
            magnitude=True,
        ),
        Quantity(
            "lateral_samples",
            "",
            "microlenses across the sensor's width",
            lambda c, _: theory.lateral_samples(2 * c.half_sizes[0], c.d),
        ),
        Quantity(
            "views_geometric",
            "",
            "pixels across a microlens image",
            lambda c, _: theory.geometric_views(c.D_F, c.q, c.d_2, *c.optics),
        ),
        Quantity(
            "views_independent",
            "",
            "4 N_F: views per axis that diffraction leaves",
            lambda c, _: theory.independent_views(c.d, c.d_2, c.wavelength),
        ),
        Quantity(
            "fresnel_number",
            "",
            "N_F = d^2/(4 lambda d_2)",
            lambda c, _: theory.fresnel_number(c.d, c.d_2, c.wavelength),
        ),
        Quantity(
            "airy_radius_px",
            "px",
            "1.22 lambda d_2/d on the sensor",
            lambda c, _: theory.airy_radius(c.d, c.d_2, c.wavelength) / c.q,
        ),
        Quantity(
            "view_baseline_mm",
            "mm",
            "distance on the FAP between neighbouring pixels' views",
            lambda c, _: theory.view_baseline(c.q, c.d_2, c.reach),
        ),
        Quantity(
            "light_sr",
            "sr",
            "solid angle of the pupil seen from the array, pi/4 (D_F/A)^2: the light a pixel gets",
            lambda c, _: math.pi / 4 * (c.D_F / c.reach) ** 2,
        ),
        Quantity(
            "f_number_microlens",
            "",
            "working f-number of a microlens, d_2/d",
            lambda c, _: theory.microlens_f_number(c.d_2, c.d),
        ),
        Quantity(
            "f_number_microlens_lens",
            "",
            "a microlens's own f-number, f_ml/d",
            lambda c, _: c.f_ml / c.d,
            monotone=False,
        ),
        Quantity("f_number_pupil", "", "d_1/(D_F H), Eq. 8", lambda c, _: theory.pupil_f_number(c.D_F, *c.optics)),
        Quantity("f_number_main_lens", "", "d_1/D, Eq. 9", lambda c, _: theory.main_lens_f_number(c.D, c.d_1)),
        Quantity(
            "vergence_at_mla_per_mm",
            "1/mm",
            "1/L of the exit pupil: 0 where telecentric",
            lambda c, _: c.vergence,
            positive=False,
            bent_in_f=True,
        ),
        Quantity(
            "telecentric_offset_mm",
            "mm",
            "d_3 - f: 0 where telecentric",
            lambda c, _: c.d_3 - c.f,
            positive=False,
        ),
        Quantity(
            "microlens_defocus_px",
            "px",
            "ray blur of microlens defocus, d d_2 |1/f_ml - 1/d_2 - 1/L|",
            lambda c, at: np.abs(defocus_signed(c, at)),
            positive=False,
            magnitude=True,
            bent_in_f=True,
        ),
        Quantity("magnification", "", "m = d_1/d_f", lambda c, _: theory.magnification(c.f, c.d_f)),
        Quantity(
            "working_distance_mm",
            "mm",
            "from the bore's tip to the focal plane",
            lambda c, _: c.d_f - c.tip,
            positive=False,
        ),
        Quantity("total_length_mm", "mm", "from the bore's tip to the sensor", lambda c, _: c.tip + c.d_1 + c.d_2),
        Quantity("camera_length_mm", "mm", "from the main lens to the sensor", lambda c, _: c.d_1 + c.d_2),
        Quantity(
            "largest_diameter_mm",
            "mm",
            "the widest of lens, FAP and stops",
            lambda c, _: np.stack(np.broadcast_arrays(c.D_F, *(rim[0] for rim in c.rims()))),
            worst=lambda values: np.asarray(values.max(axis=0)),
        ),
        *lengths,
    )


def _grown(c: Cameras, at: float | None) -> Array | float:
    """How much larger the field is at a distance than at the focal plane: chief rays meet in the FAP."""
    return 1.0 if at is None else c.depth(at) / (c.d_f - c.d_3)


QUANTITIES = {quantity.name: quantity for quantity in _table()}
"""Every quantity by its name; the paper's symbols too."""


def quantity_named(name: str) -> Quantity:
    """Find a quantity.

    Raises
    ------
    ValueError
        Not known; names the nearest.
    """
    if name in QUANTITIES:
        return QUANTITIES[name]
    lowered = {known.lower(): known for known in QUANTITIES}
    near = difflib.get_close_matches(name.lower(), lowered, 1, 0.4)
    known = ", ".join(key for key in QUANTITIES if key not in PATHS)
    remedy = f"did you mean '{lowered[near[0]]}'?" if near else f"known are {known}, and the symbols {', '.join(PATHS)}"
    raise ValueError(f"'{name}' is no quantity of a design; {remedy}")
