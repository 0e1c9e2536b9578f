"""The package's closed forms by name and keywords, one for every oracle: lengths in, through a `Camera`, numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import roslf_design as roslf
from roslf_design.bore import conjugates
from roslf_design.camera import Camera
from roslf_design.theory import exit_pupil, f_number, light, light_field, vignetting
from roslf_design.theory.light_field import back_substitute, back_substitution_jacobian
from roslf_design.theory.stop_images import stop_discs

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


def _of(form: Callable[..., Any], *more: str) -> Callable[..., Any]:
    """A function of a camera and of further keywords, in that order, as one of keywords alone."""

    def by_keyword(**given: Any) -> Any:
        return form(camera_of(given), *(given[key] for key in more))

    by_keyword.__doc__ = form.__doc__
    return by_keyword


def _said(words: str, form: Callable[[Camera], Any]) -> Callable[..., Any]:
    form.__doc__ = words
    return _of(form)


def _matched(symbol: Any) -> Callable[..., Any]:
    def solved(c: Camera, exact: bool) -> f_number.Matched:
        return f_number.matched(c, symbol, exact=exact)

    solved.__doc__ = f_number.matched.__doc__
    return _of(solved, "exact")


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


CLOSED: dict[str, Callable[..., Any]] = {
    "mla_distance": conjugates.mla_distance,
    "focal_plane_distance": conjugates.focal_plane_distance,
    "focal_length": conjugates.focal_length,
    "conjugate_residual": conjugates.conjugate_residual,
    "magnification": _said("inf at d_f = f", lambda c: c.seen.m),
    "inverse_magnification": _said("inf at d_f = inf", lambda c: c.seen.inverse_m),
    "gap": _said("inf at d_f = inf", lambda c: c.seen.gap),
    "aperture_constant": _said("inf at d_3 = d_f", lambda c: c.seen.H),
    "inverse_aperture_constant": _said("finite", lambda c: c.seen.inverse_H),
    "effective_image_distance": _said("inf at d_f = f", lambda c: c.seen.A),
    "exit_pupil_vergence": _said("inf at d_3 = d_f", lambda c: c.seen.vergence),
    "pupil_angle": _of(exit_pupil.pupil_angle),
    "exit_pupil_distance": _of(exit_pupil.exit_pupil_distance),
    "exit_pupil_diameter": _of(exit_pupil.exit_pupil_diameter),
    "microlens_image_pitch": _of(exit_pupil.microlens_image_pitch),
    "microlens_image_diameter": _of(exit_pupil.microlens_image_diameter),
    "centre_shift_per_microlens": _of(exit_pupil.centre_shift_per_microlens),
    "centre_deviation": _of(exit_pupil.centre_deviation, "index"),
    "microlens_f_number": _of(f_number.microlens_f_number),
    "pupil_f_number": _of(f_number.pupil_f_number),
    "main_lens_f_number": _of(f_number.main_lens_f_number),
    "fill_factor": _of(f_number.fill_factor),
    "approximate_fill_factor": _of(f_number.approximate_fill_factor),
    "traditional_fill_factor": _of(f_number.traditional_fill_factor),
    "matching_mismatch": _of(f_number.mismatch_px),
    "matched_sensor_distance": _matched("d_2"),
    "matched_pupil_diameter": _matched("D_F"),
    "matched_microlens_pitch": _matched("d"),
    "matched_pupil_distance": _matched("d_3"),
    "nondistortion_margin": _of(vignetting.nondistortion_margin, "radius", "distance"),
    "nondistortion_bound": _of(vignetting.nondistortion_bound, "distance"),
    "stop_disc": stop_disc,
    "pixel_to_pupil": _of(light_field.pixel_to_pupil, "pixel"),
    "pupil_to_pixel": _of(light_field.pupil_to_pixel, "coordinate"),
    "view_baseline": _of(light.view_baseline),
    "pupil_shear": _of(light_field.pupil_shear, "depth"),
    "epi_slope": _of(light_field.epi_slope, "depth"),
    "rim_disparity": _of(light_field.rim_disparity, "depth"),
    "disparity_rate": _of(light_field.disparity_rate, "depth"),
    "depth_sigma": _of(light_field.depth_sigma, "depth", "disparity_sigma"),
    "geometric_views": _of(light.geometric_views),
    "object_sample": _of(light.object_sample),
    "fresnel_number": _of(light.fresnel_number),
    "independent_views": _of(light.independent_views),
    "diffraction_width": _of(light.diffraction_width),
    "airy_radius": _of(light.airy_radius),
    "pupil_airy_radius": _of(light.pupil_airy_radius),
    "microlens_defocus_waves": _of(light.microlens_defocus_waves),
    "microlens_defocus_blur": _of(light.microlens_defocus_blur),
    "back_substitute": back_substitute,
    "back_substitution_jacobian": back_substitution_jacobian,
}
"""Closed form of each name in `oracles.closed_forms.ORACLES`, by the same keywords."""
