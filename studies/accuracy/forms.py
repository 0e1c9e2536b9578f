"""What commands compute of a camera, by name and keywords, one for every oracle: lengths in, through a `Camera`.

Quantities are the registry's own, which evaluate, tolerance and optimize call; the others are what stands behind them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

import roslf_design as roslf
from roslf_design.bore import conjugates
from roslf_design.camera import Camera
from roslf_design.theory import exit_pupil, f_number, light, light_field, vignetting
from roslf_design.theory.light_field import back_substitute
from roslf_design.theory.quantities import QUANTITIES
from roslf_design.theory.stop_images import ROUNDING, stop_discs

SYMBOLS = {
    "focal_length": "f",
    "focal_plane_distance": "d_f",
    "mla_distance": "d_1",
    "pupil_distance": "d_3",
    "pupil_diameter": "D_F",
    "lens_diameter": "D",
    "sensor_distance": "d_2",
    "microlens_pitch": "d",
    "pixel_pitch": "q",
    "wavelength": "wavelength",
    "microlens_focal_length": "f_ml",
}
"""Keyword of each of a camera's lengths."""

_ANY = Camera.of(roslf.load("paper"))
"""What a form does not ask for."""


def camera_of(given: Mapping[str, Any]) -> Camera:
    """The camera with some lengths by keyword."""
    return _ANY.replace({SYMBOLS[key]: value for key, value in given.items() if key in SYMBOLS})


def _of(form: Callable[..., Any], *more: str, infinite: str = "") -> Callable[..., Any]:
    """A function of a camera and of further keywords, in that order, as one of keywords alone.

    `infinite` says where it is infinite; without it, its own documentation does.
    """

    def by_keyword(**given: Any) -> Any:
        return form(camera_of(given), *(given[key] for key in more))

    by_keyword.__doc__ = infinite or form.__doc__
    return by_keyword


def _matched(symbol: Any) -> Callable[..., Any]:
    def solved(c: Camera, exact: bool) -> f_number._Matched:
        return f_number.matched(c, symbol, exact=exact)

    solved.__doc__ = f_number.matched.__doc__
    return _of(solved, "exact")


def room(c: Camera, radius: Any) -> Any:
    """Room that the main lens's rim leaves the pencil of a field point at a radius [mm]; -inf at d_3 = d_f."""
    return vignetting.room_at(c, np.abs(radius))[0]


def undistorted_field(c: Camera) -> Any:
    """Half-field that evaluate tells [mm]: none where even the axis is cut; inf at d_3 = 0."""
    return np.maximum(QUANTITIES["undistorted_field_mm"](c), 0.0)


def stop_disc(**given: Any) -> tuple[Any, Any]:
    """Radius and centre of a stop's disc on the sensor, against the optical axis; inf in the focal plane."""
    own = {"stops": [{"diameter": 1.0, "distance": 1.0}]}
    camera = Camera.of(roslf.load("paper").replace(own)).replace(
        {
            **{SYMBOLS[key]: value for key, value in given.items() if key in SYMBOLS},
            "stops.0.diameter": given["stop_diameter"],
            "stops.0.distance": given["stop_distance"],
            "stops.0.decentre.0": given["stop_decentre"][0],
            "stops.0.decentre.1": given["stop_decentre"][1],
        }
    )
    x, y = given["microlens_centre"]
    centres, radii = stop_discs(camera, x, y)
    return radii[..., 2], (centres[..., 2, 0] + x, centres[..., 2, 1] + y)


AT_FOCUS = "inf at d_3 = d_f"
REGISTERED = {
    "aperture_constant": AT_FOCUS,
    "inverse_aperture_constant": "",
    "magnification": "inf at d_f = f",
    "vergence_at_mla_per_mm": AT_FOCUS,
    "image_pitch_mm": AT_FOCUS,
    "image_diameter_mm": AT_FOCUS,
    "views_geometric": AT_FOCUS,
    "centre_shift_px_per_microlens": AT_FOCUS,
    "fill_factor": "inf where images have no pitch",
    "mismatch_px": AT_FOCUS,
    "f_number_microlens": "",
    "f_number_pupil": "inf at D_F = 0",
    "f_number_main_lens": "inf at d_1 = inf",
    "view_baseline_mm": "inf at d_2 = 0",
    "views_independent": "inf at d_2 = 0",
    "fresnel_number": "inf at d_2 = 0",
    "airy_radius_px": "",
    "object_sample_mm": "inf at d_f = inf",
}
"""Quantities of the registry that follow from lengths alone, and where they are infinite."""

CLOSED: dict[str, Callable[..., Any]] = {
    **{name: _of(QUANTITIES[name], infinite=infinite or "finite") for name, infinite in REGISTERED.items()},
    "mla_distance": conjugates.mla_distance,
    "focal_plane_distance": conjugates.focal_plane_distance,
    "focal_length": conjugates.focal_length,
    "conjugate_residual": conjugates.conjugate_residual,
    "inverse_magnification": _of(lambda c: c.seen.inverse_m, infinite="inf at d_f = inf"),
    "gap": _of(lambda c: c.seen.gap, infinite="inf at d_f = inf"),
    "effective_image_distance": _of(lambda c: c.seen.A, infinite="inf at d_f = f"),
    "pupil_angle": _of(exit_pupil.pupil_angle),
    "exit_pupil_distance": _of(exit_pupil.exit_pupil_distance),
    "exit_pupil_diameter": _of(exit_pupil.exit_pupil_diameter),
    "matched_sensor_distance": _matched("d_2"),
    "matched_pupil_diameter": _matched("D_F"),
    "matched_microlens_pitch": _matched("d"),
    "matched_pupil_distance": _matched("d_3"),
    "non_distortion_room": _of(room, "radius"),
    "undistorted_field": _of(undistorted_field),
    "stop_disc": stop_disc,
    "pupil_shear": _of(light_field.pupil_shear, "depth"),
    "epi_slope": _of(light_field.epi_slope, "depth"),
    "rim_disparity": _of(light_field.rim_disparity, "depth"),
    "disparity_rate": _of(light_field.disparity_rate, "depth"),
    "depth_sigma": _of(light_field.depth_sigma, "depth", "disparity_sigma"),
    "diffraction_width": _of(light.diffraction_width),
    "pupil_airy_radius": _of(light.pupil_airy_radius),
    "microlens_defocus_waves": _of(light.microlens_defocus_waves),
    "microlens_defocus_blur": _of(light.microlens_defocus_blur),
    "back_substitute": back_substitute,
}
"""What commands call, under each name in `oracles.closed_forms.ORACLES`, by the same keywords."""


def left_out(name: str, given: Mapping[str, Any]) -> bool:
    """True where what the main lens's rim cuts is another question than at the same lengths nearby.

    Nothing is where a design cannot be focused, at infinity; and a FAP nearer the main lens than rounding tells apart
    counts as in its plane, as at d_3 = 0.
    """
    if name not in ("non_distortion_room", "undistorted_field"):
        return False
    in_plane = 0 < given["pupil_distance"] <= ROUNDING * given["focal_length"]
    return in_plane or math.isinf(given["focal_plane_distance"])
