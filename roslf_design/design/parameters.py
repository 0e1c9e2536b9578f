"""The numbers of a design under the paper's symbols, scalars or arrays that broadcast."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Values = float | NDArray[np.float64]


class Parameters(NamedTuple):
    """What the closed forms take; every entry a float or an array, all broadcast together. Lengths in mm."""

    D: Values
    """Main lens clear aperture."""
    f: Values
    """Main lens focal length."""
    d_f: Values
    """Focal-plane distance."""
    d_1: Values
    """Main lens to MLA."""
    D_F: Values
    """FAP diameter."""
    d_3: Values
    """FAP distance."""
    d: Values
    """Microlens pitch."""
    f_ml: Values
    """Microlens focal length."""
    d_2: Values
    """MLA to sensor."""
    q: Values
    """Pixel pitch as seen at the MLA's image plane."""
    wavelength: Values
    """Light's wavelength."""


PATHS: dict[str, str] = {
    "D": "main_lens.diameter",
    "f": "main_lens.focal_length",
    "d_f": "main_lens.focal_plane",
    "d_1": "microlens_array.distance",
    "D_F": "aperture.diameter",
    "d_3": "aperture.distance",
    "d": "microlens_array.pitch",
    "f_ml": "microlens_array.focal_length",
    "d_2": "sensor.distance",
    "q": "sensor.pixel",
    "wavelength": "light.wavelength",
}
"""The paper's symbol to its place in a design file."""
