"""Metrics of the whole camera: closed forms of its axial distances, whatever its decentres and tilts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..theory import aperture, decoding, depth, diffraction, matching, pupils, sampling
from .camera import Camera

SIGMA_DISPARITY = 0.1
"""Disparity error that sigma_z assumes [pitches], as in `roslf evaluate`."""


def _triple(c: Camera) -> dict[str, Any]:
    return {"focal_length": c.f, "focal_plane_distance": c.d_f, "pupil_distance": c.rims[0].distance}


def _disparity(c: Camera) -> Any:
    gap = c.d_f - c.rims[0].distance
    return depth.disparity_rate(gap, pupil_diameter=2 * c.rims[0].radius, microlens_pitch=c.d, **_triple(c))


def _sigma_z(c: Camera) -> Any:
    gap = c.d_f - c.rims[0].distance
    return depth.depth_sigma(
        SIGMA_DISPARITY, gap, pupil_diameter=2 * c.rims[0].radius, microlens_pitch=c.d, **_triple(c)
    )


def _baseline(c: Camera) -> Any:
    return decoding.view_baseline(c.q, c.d_2, aperture.effective_image_distance(**_triple(c)))


def _shift(c: Camera) -> Any:
    return pupils.centre_shift_per_microlens(microlens_pitch=c.d, pixel_pitch=c.q, sensor_distance=c.d_2, **_triple(c))


def _defocus(c: Camera) -> Any:
    vergence = pupils.exit_pupil_vergence(**_triple(c))
    blur = diffraction.microlens_defocus_blur(
        microlens_focal_length=c.f_ml, sensor_distance=c.d_2, exit_pupil_vergence=vergence, microlens_pitch=c.d
    )
    return blur / c.q


AXIAL: dict[str, Callable[[Camera], Any]] = {
    "disparity_pitches_per_mm": _disparity,
    "sigma_z_mm": _sigma_z,
    "inverse_aperture_constant": lambda c: aperture.inverse_aperture_constant(c.d_f, c.rims[0].distance),
    "vergence_at_mla_per_mm": lambda c: pupils.exit_pupil_vergence(**_triple(c)),
    "f_number_microlens": lambda c: matching.microlens_f_number(c.d_2, c.d),
    "f_number_pupil": lambda c: matching.pupil_f_number(2 * c.rims[0].radius, **_triple(c)),
    "f_number_main_lens": lambda c: matching.main_lens_f_number(2 * c.rims[1].radius, c.d_1),
    "centre_shift_px_per_microlens": _shift,
    "views_independent": lambda c: sampling.independent_views(c.d, c.d_2, c.wavelength),
    "object_sample_mm": lambda c: sampling.object_sample(c.d, c.f, c.d_f),
    "view_baseline_mm": _baseline,
    "fresnel_number": lambda c: diffraction.fresnel_number(c.d, c.d_2, c.wavelength),
    "airy_radius_px": lambda c: diffraction.airy_radius(c.d, c.d_2, c.wavelength) / c.q,
    "microlens_defocus_px": _defocus,
}
"""Metric name to its value over builds."""
