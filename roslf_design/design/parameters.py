"""The paper's symbols and where their numbers stand in a design file."""

from __future__ import annotations

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
