"""Closed forms of light-field imaging through a restricted object space, scalar or batched.

Every function takes numbers or arrays, broadcasts them as float64 and returns a numpy float64 (all scalars) or an
array; lengths in mm, wavelengths too, angles in rad. What belongs to the design of a camera takes the same three
lengths of the main lens, ``focal_length`` f, ``focal_plane_distance`` d_f and ``pupil_distance`` d_3, since all else
follows from them by differences that floating point takes without loss; what a calibration works with (decoding,
projection) takes A = d_1/H as ``effective_image_distance`` and m = d_1/d_f as ``magnification``.

========  ==========================================================================================================
equation  functions
========  ==========================================================================================================
lens      `conjugates`, `mla_distance`, `focal_plane_distance`, `focal_length`, `magnification`, `conjugate_residual`
Eq. 1     `pixel_to_lens`
Eq. 2     `pixel_to_pupil`, `pupil_to_pixel`, `view_baseline`
Eq. 3     `aperture_constant`, `inverse_aperture_constant`, `gap`, `effective_image_distance`
Eq. 4     `centre_deviation`, `centre_shift_per_microlens`; `microlens_image_pitch`, `exit_pupil_vergence`
Eqs. 5-6  `nondistortion_margin`, `nondistortion_bound`; any stops: `stop_margin`, `stop_disc`
Eq. 7     `fill_factor`, `matching_residual`, `matching_mismatch`; solved: `matched_*`
Eq. 8     `approximate_fill_factor`, `microlens_f_number`, `pupil_f_number`; solved: `matched_*` with ``exact=False``
Eq. 9     `traditional_fill_factor`, `main_lens_f_number`
Eq. 10    `view_projection`, `microlens_projection`, `light_field_projection`, `ray_matrix` and their inverses
Eq. 11    the same with ``d_3 = 0``, ``A = d_1``
Eq. 12    `epi_slope`, `pupil_shear`, `calibrated_epi_slope`, `inverse_depth_from_epi_slope`
depth     `rim_disparity`, `defocus_blur`, `disparity_rate`, `depth_sigma`, `inverse_depth_sigma`
light     `fresnel_number`, `diffraction_width`, `airy_radius`, `independent_views`, `phase_space_limit`
========  ==========================================================================================================

Domain and limits. Lengths are positive; ``d_3 >= 0``, ``D_F >= 0`` and ``d_2 >= 0`` may be 0. Real designs have
``f < d_f`` and ``d_3 < d_f``; beyond, formulas go on with their sign (H < 0: the focal plane lies in the bore). No
argument in this domain gives NaN, and inf comes only where a docstring says so, next to its finite twin: 1/H for H, 1/L
for the exit pupil's distance, angles for f-numbers, the diffraction width for Fresnel numbers, a homogeneous weight for
points at infinity. NaN in is NaN out: validating a design is `roslf_design.design`'s part.

Accuracy. Each result is within 4 ulp times (1 + its condition number, the sum over arguments of |x df/dx / f|) of the
exact function of the floating-point arguments.
"""

from __future__ import annotations

from .aperture import (
    aperture_constant,
    effective_image_distance,
    effective_image_distance_from_magnification,
    gap,
    inverse_aperture_constant,
    pupil_angle,
)
from .back_substitution import (
    BackSubstituted,
    back_substitute,
    back_substitution_jacobian,
)
from .conjugates import (
    Conjugates,
    conjugate_residual,
    conjugates,
    focal_length,
    focal_plane_distance,
    inverse_magnification,
    magnification,
    mla_distance,
    mla_excess,
)
from .decoding import centre_deviation, pixel_to_lens, pixel_to_pupil, pupil_to_pixel, view_baseline
from .depth import defocus_blur, depth_sigma, disparity_rate, inverse_depth_sigma, rim_disparity
from .diffraction import (
    airy_radius,
    diffraction_width,
    fresnel_number,
    microlens_defocus_blur,
    microlens_defocus_waves,
    pupil_airy_radius,
)
from .epi import calibrated_epi_slope, epi_inverse_slope, epi_slope, inverse_depth_from_epi_slope, pupil_shear
from .field import FieldBound, nondistortion_bound, nondistortion_margin
from .matched import (
    Matched,
    matched_microlens_pitch,
    matched_pupil_diameter,
    matched_pupil_distance,
    matched_sensor_distance,
)
from .matching import (
    approximate_fill_factor,
    fill_factor,
    main_lens_f_number,
    matching_mismatch,
    matching_residual,
    microlens_angle,
    microlens_f_number,
    pupil_f_number,
    traditional_fill_factor,
)
from .projection import from_homogeneous, microlens_projection, project, pupil_frame, view_projection
from .pupils import (
    centre_shift_per_microlens,
    exit_pupil_diameter,
    exit_pupil_distance,
    exit_pupil_vergence,
    is_telecentric,
    microlens_image_diameter,
    microlens_image_pitch,
)
from .reconstruction import decoding_matrix, light_field_projection, light_field_reconstruction, ray_matrix
from .sampling import geometric_views, independent_views, lateral_samples, object_sample, phase_space_limit
from .stops import StopDisc, stop_disc, stop_margin

__all__ = [
    "BackSubstituted",
    "Conjugates",
    "FieldBound",
    "Matched",
    "StopDisc",
    "airy_radius",
    "aperture_constant",
    "approximate_fill_factor",
    "back_substitute",
    "back_substitution_jacobian",
    "calibrated_epi_slope",
    "centre_deviation",
    "centre_shift_per_microlens",
    "conjugate_residual",
    "conjugates",
    "decoding_matrix",
    "defocus_blur",
    "depth_sigma",
    "diffraction_width",
    "disparity_rate",
    "effective_image_distance",
    "effective_image_distance_from_magnification",
    "epi_inverse_slope",
    "epi_slope",
    "exit_pupil_diameter",
    "exit_pupil_distance",
    "exit_pupil_vergence",
    "fill_factor",
    "focal_length",
    "focal_plane_distance",
    "fresnel_number",
    "from_homogeneous",
    "gap",
    "geometric_views",
    "independent_views",
    "inverse_aperture_constant",
    "inverse_depth_from_epi_slope",
    "inverse_depth_sigma",
    "inverse_magnification",
    "is_telecentric",
    "lateral_samples",
    "light_field_projection",
    "light_field_reconstruction",
    "magnification",
    "main_lens_f_number",
    "matched_microlens_pitch",
    "matched_pupil_diameter",
    "matched_pupil_distance",
    "matched_sensor_distance",
    "matching_mismatch",
    "matching_residual",
    "microlens_angle",
    "microlens_defocus_blur",
    "microlens_defocus_waves",
    "microlens_f_number",
    "microlens_image_diameter",
    "microlens_image_pitch",
    "microlens_projection",
    "mla_distance",
    "mla_excess",
    "nondistortion_bound",
    "nondistortion_margin",
    "object_sample",
    "phase_space_limit",
    "pixel_to_lens",
    "pixel_to_pupil",
    "project",
    "pupil_airy_radius",
    "pupil_angle",
    "pupil_f_number",
    "pupil_frame",
    "pupil_shear",
    "pupil_to_pixel",
    "ray_matrix",
    "rim_disparity",
    "stop_disc",
    "stop_margin",
    "traditional_fill_factor",
    "view_baseline",
    "view_projection",
]
