"""`evaluate`: every closed form of one design, in the terms an engineer asks in."""

from __future__ import annotations

import math
from collections.abc import Sequence

from .. import theory
from ..design import Design
from ..effects.field import half_sizes
from ..effects.plan import plan
from .fields import evaluate_fields
from .real_lens import trace_lens
from .result import (
    Depth,
    Diffraction,
    Effect,
    Evaluation,
    ExitPupil,
    FNumber,
    MicrolensImage,
    NonDistortion,
    Sampling,
)
from .rims import field_limit
from .tilted import RAYS, rays_for
from .verdicts import verdicts_of, warnings_of

SIGMA_DISPARITY = 0.1
"""Disparity error that depth precision is told for [microlens pitches]: what careful matching of views reaches."""


def evaluate(
    design: Design, fields: Sequence[float | tuple[float, float]] | None = None, accuracy: float | None = None
) -> Evaluation:
    """Everything closed forms say of a design.

    Parameters
    ----------
    design : Design
    fields : sequence of float or (x, y), optional
        Microlens positions on the MLA [mm], a bare number along x. Default: centre, edge and corner of what the
        sensor sees.
    accuracy : float, optional
        What shares of light may be off by where parts are tilted and rays are counted; None is `RAYS` rays. Straight
        designs are exact whatever is asked for.

    Returns
    -------
    Evaluation
        Prints as tables; `to_dict` gives the JSON object.

    Raises
    ------
    ValueError
        A field that is not finite; an accuracy that no number of rays reaches.
    """
    rays = RAYS if accuracy is None or design.aligned else rays_for(accuracy)
    axes = default_fields(design) if fields is None else tuple(_axis(field) for field in fields)
    non_distortion = _non_distortion(design)
    f_number, image = _f_number(design), _microlens_image(design)
    sampled, wave = _sampling(design), _diffraction(design)
    images = evaluate_fields(design, axes, rays)
    traced = trace_lens(design, axes, non_distortion)
    return Evaluation(
        design=design.name,
        aperture_constant=float(theory.aperture_constant(design.d_f, design.d_3)),
        inverse_aperture_constant=float(theory.inverse_aperture_constant(design.d_f, design.d_3)),
        exit_pupil=_exit_pupil(design),
        f_number=f_number,
        non_distortion=non_distortion,
        microlens_image=image,
        fields=images,
        sampling=sampled,
        depth=_depth(design),
        diffraction=wave,
        effects=tuple(
            Effect(line.name, line.estimate, line.unit, line.budget, line.on, line.reason) for line in plan(design)
        ),
        verdicts=verdicts_of(design, f_number, non_distortion, sampled, traced),
        warnings=warnings_of(design, images),
        method=" ".join(_methods(design, rays, COUNTED_ERROR if accuracy is None else accuracy)),
        real_lens=traced,
    )


METHOD = (
    "Closed forms and exact disc areas for pinhole microlenses in focus behind an ideal thin lens; rounding errors are "
    "below 1e-12 relative. What this model leaves out is listed, with its size, under effects."
)

TRACED = (
    "The main lens is real: all of that is its thin twin of the same focal length, and under real lens stands what "
    "exact rays through its surfaces say."
)

COUNTED_ERROR = 0.002
"""Of a share counted with `RAYS` rays [fraction]."""

COUNTED = (
    "Parts are tilted, so the microlens images over the field were counted from {rays} rays each (error of a share up "
    "to {error:g}); all other numbers are those of the untilted parts."
)


def _methods(design: Design, rays: int, error: float) -> list[str]:
    told = [METHOD]
    if not design.aligned:
        told.append(COUNTED.format(rays=rays, error=error))
    if design.lens is not None:
        told.append(TRACED)
    return told


def default_fields(design: Design) -> tuple[tuple[float, float], ...]:
    """Centre, edge and corner of what the sensor sees of the MLA [mm].

    Edge and corner are where the sensor or the array ends or, where images move outwards, the outermost microlenses
    whose own cells still lie on the sensor.
    """
    pitch = abs(float(theory.microlens_image_pitch(design.d, design.d_2, design.f, design.d_f, design.d_3)))
    edge, corner = (
        min(half, max(0.0, sensor / 2 - pitch / 2) * design.d / pitch) if pitch else half
        for half, sensor in zip(half_sizes(design), design.sensor_size, strict=True)
    )
    x, y = (sensor - mla for sensor, mla in zip(design.sensor.decentre, design.microlens_array.decentre, strict=True))
    return ((x, y), (x + edge, y), (x + edge, y + corner))


def _axis(field: float | tuple[float, float]) -> tuple[float, float]:
    x, y = (float(field), 0.0) if isinstance(field, (int, float)) else (float(field[0]), float(field[1]))
    if not (math.isfinite(x) and math.isfinite(y)):
        raise ValueError(f"field {field!r} is not finite; give mm on the MLA")
    return x, y


def _exit_pupil(design: Design) -> ExitPupil:
    return ExitPupil(
        distance_from_lens_mm=float(theory.exit_pupil_distance(design.f, design.d_3)),
        vergence_at_mla_per_mm=float(theory.exit_pupil_vergence(design.f, design.d_f, design.d_3)),
        diameter_mm=float(theory.exit_pupil_diameter(design.D_F, design.f, design.d_3)),
        telecentric=bool(theory.is_telecentric(design.f, design.d_3)),
    )


def _f_number(design: Design) -> FNumber:
    optics = (design.f, design.d_f, design.d_3)
    return FNumber(
        microlens=float(theory.microlens_f_number(design.d_2, design.d)),
        pupil=float(theory.pupil_f_number(design.D_F, *optics)),
        main_lens=float(theory.main_lens_f_number(design.D, design.d_1)),
        fill_factor=float(theory.fill_factor(design.D_F, design.d, design.d_2, *optics)),
        mismatch_px=float(theory.matching_mismatch(design.D_F, design.d, design.q, design.d_2, *optics)),
    )


def _non_distortion(design: Design) -> NonDistortion:
    half_x, half_y = half_sizes(design)
    per_mla_mm = float(theory.inverse_magnification(design.f, design.d_f))
    diagonal = math.hypot(half_x, half_y) * per_mla_mm
    limit = field_limit(design, diagonal)
    return NonDistortion(
        x0_max_mm=limit.radius,
        x_ml_max_mm=limit.radius / per_mla_mm,
        room_at_corner_mm=limit.room,
        limited_by=limit.rim,
        field_half_width_mm=half_x * per_mla_mm,
        field_half_diagonal_mm=diagonal,
        undistorted_in_field=limit.room >= 0,
    )


def _microlens_image(design: Design) -> MicrolensImage:
    optics = (design.f, design.d_f, design.d_3)
    diameter = float(theory.microlens_image_diameter(design.D_F, design.d_2, *optics))
    return MicrolensImage(
        diameter_mm=diameter,
        diameter_px=diameter / design.q,
        pitch_mm=float(theory.microlens_image_pitch(design.d, design.d_2, *optics)),
        centre_shift_px_per_microlens=float(theory.centre_shift_per_microlens(design.d, design.q, design.d_2, *optics)),
    )


def _sampling(design: Design) -> Sampling:
    optics = (design.f, design.d_f, design.d_3)
    return Sampling(
        views_geometric=float(theory.geometric_views(design.D_F, design.q, design.d_2, *optics)),
        views_independent=float(theory.independent_views(design.d, design.d_2, design.wavelength)),
        lateral_samples=round(float(theory.lateral_samples(2 * half_sizes(design)[0], design.d))),
        object_sample_mm=float(theory.object_sample(design.d, design.f, design.d_f)),
        view_baseline_mm=float(theory.view_baseline(design.q, design.d_2, theory.effective_image_distance(*optics))),
    )


def _depth(design: Design) -> Depth:
    gap = theory.gap(design.d_f, design.d_3)
    seen = (gap, design.D_F, design.d, design.f, design.d_f, design.d_3)
    return Depth(
        disparity_pitches_per_mm=float(theory.disparity_rate(*seen)),
        sigma_z_mm=float(theory.depth_sigma(SIGMA_DISPARITY, *seen)),
        sigma_disparity_pitches=SIGMA_DISPARITY,
    )


def _diffraction(design: Design) -> Diffraction:
    at_sensor = (design.d, design.d_2, design.wavelength)
    return Diffraction(
        fresnel_number=float(theory.fresnel_number(*at_sensor)),
        airy_radius_px=float(theory.airy_radius(*at_sensor)) / design.q,
    )
