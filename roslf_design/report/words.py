"""Quantities and metrics in words, for pages and figures; study files and JSON keep their names."""

from __future__ import annotations

import re

WORDS = {
    "fill_factor": "fill factor",
    "mismatch_px": "f-number mismatch",
    "non_distortion_room_mm": "undistorted-field margin",
    "undistorted_field_mm": "undistorted field radius",
    "field_half_width_mm": "field half width",
    "field_half_diagonal_mm": "field half diagonal",
    "object_sample_mm": "object sample",
    "sigma_z_mm": "depth spread σ_Z",
    "blur_pitches": "defocus blur",
    "lateral_samples": "microlenses across",
    "views_geometric": "pixels across a microlens image",
    "views_independent": "independent views",
    "fresnel_number": "Fresnel number",
    "airy_radius_px": "Airy radius",
    "view_baseline_mm": "view baseline",
    "light_sr": "light a pixel gets",
    "f_number_microlens": "microlens f-number d_2/d",
    "f_number_microlens_lens": "microlens f-number f_ml/d",
    "f_number_pupil": "pupil f-number",
    "f_number_main_lens": "main-lens f-number",
    "vergence_at_mla_per_mm": "exit-pupil vergence 1/L",
    "telecentric_offset_mm": "distance from telecentric, d_3 - f",
    "microlens_defocus_px": "microlens defocus",
    "magnification": "magnification",
    "working_distance_mm": "working distance",
    "working_distance": "working distance",
    "total_length_mm": "length from tip to sensor",
    "camera_length_mm": "length from lens to sensor",
    "largest_diameter_mm": "largest diameter",
    "image_diameter_mm": "microlens-image diameter",
    "image_diameter_px": "microlens-image diameter",
    "image_pitch_mm": "microlens-image pitch",
    "image_area_mm2": "microlens-image area",
    "centre_shift_px": "image-centre shift",
    "centre_shift_px_per_microlens": "image-centre shift per microlens",
    "kept_fraction": "kept fraction",
    "axis_ratio": "axis ratio",
    "centre_error_px": "image-centre error",
    "centre_error_x_px": "image-centre error along x",
    "centre_error_y_px": "image-centre error along y",
    "depth_error_mm": "depth error",
    "disparity_pitches_per_mm": "disparity per depth",
    "aperture_constant": "aperture constant H",
    "inverse_aperture_constant": "1/H",
}
"""Name of a quantity, of a metric, or of a variable that is no symbol of the paper, to words; the unit goes beside."""
_NAME = re.compile(rf"(?<![\w.])({'|'.join(sorted(WORDS, key=len, reverse=True))})(?:@(\d+))?(?![\w@])")


def in_words(text: str) -> str:
    """A sentence or a label with names put into words: ``sigma_z_mm at 40 mm``, ``fill_factor@2``."""
    return (
        _NAME.sub(lambda match: WORDS[match[1]] + (f" at field {match[2]}" if match[2] else ""), text)
        .replace(" >= ", " ≥ ")
        .replace(" <= ", " ≤ ")
    )
