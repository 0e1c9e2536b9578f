"""`evaluate`: every closed form of one design, in the terms an engineer asks in."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from ..camera import Camera
from ..design import Design, load
from ..effects.plan import plan
from ..theory import exit_pupil
from ..theory.light_field import SIGMA_DISPARITY
from ..theory.quantities import QUANTITIES
from ..theory.vignetting import field_limit
from .fields import RAYS, default_fields, evaluate_fields, rays_for
from .real_lens import trace_lens
from .result import (
    Depth,
    Diffraction,
    EffectLine,
    Evaluation,
    ExitPupil,
    FNumber,
    MicrolensImage,
    NonDistortion,
    Sampling,
)
from .verdicts import verdicts_of, warnings_of

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
    "Parts are tilted, so the shapes of the microlens images are those of exact ellipses and their ray budgets were "
    "counted from {rays} rays each (error of a share up to {error:g}); all other numbers are those of the untilted "
    "parts."
)


def evaluate(
    design: Design | str | Path,
    fields: Sequence[float | tuple[float, float]] | None = None,
    accuracy: float | None = None,
) -> Evaluation:
    """Everything closed forms say of a design.

    Parameters
    ----------
    design : Design, str or Path
        A design, the name of a preset, or a design file.
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
    DesignError
        A design file that cannot be used.
    ValueError
        A field that is not finite; an accuracy that no number of rays reaches.

    Examples
    --------
    >>> import roslf_design as roslf
    >>> round(roslf.evaluate("paper").f_number.fill_factor, 5)
    1.00506
    """
    if not isinstance(design, Design):
        design = load(design)
    rays = RAYS if accuracy is None or design.aligned else rays_for(accuracy)
    axes = default_fields(design) if fields is None else tuple(_axis(field) for field in fields)
    camera = Camera.of(design)

    def of(name: str) -> float:
        return float(QUANTITIES[name](camera))

    f_number = FNumber(
        microlens=of("f_number_microlens"),
        pupil=of("f_number_pupil"),
        main_lens=of("f_number_main_lens"),
        fill_factor=of("fill_factor"),
        mismatch_px=of("mismatch_px"),
    )
    limit = field_limit(camera)
    non_distortion = NonDistortion(
        x0_max_mm=limit.radius,
        x_ml_max_mm=limit.radius / float(camera.inverse_m),
        room_at_corner_mm=limit.room,
        limited_by=limit.rim,
        field_half_width_mm=of("field_half_width_mm"),
        field_half_diagonal_mm=of("field_half_diagonal_mm"),
        undistorted_in_field=limit.room >= 0,
    )
    sampling = Sampling(
        views_geometric=of("views_geometric"),
        views_independent=of("views_independent"),
        lateral_samples=round(of("lateral_samples")),
        object_sample_mm=of("object_sample_mm"),
        view_baseline_mm=of("view_baseline_mm"),
    )
    images = evaluate_fields(design, axes, rays)
    traced = trace_lens(design, axes, non_distortion)
    return Evaluation(
        design=design.name,
        aperture_constant=of("aperture_constant"),
        inverse_aperture_constant=of("inverse_aperture_constant"),
        exit_pupil=ExitPupil(
            distance_from_lens_mm=float(exit_pupil.exit_pupil_distance(camera)),
            vergence_at_mla_per_mm=of("vergence_at_mla_per_mm"),
            diameter_mm=float(exit_pupil.exit_pupil_diameter(camera)),
            telecentric=bool(exit_pupil.is_telecentric(camera)),
        ),
        f_number=f_number,
        non_distortion=non_distortion,
        microlens_image=MicrolensImage(
            diameter_mm=of("image_diameter_mm"),
            diameter_px=of("image_diameter_px"),
            pitch_mm=of("image_pitch_mm"),
            centre_shift_px_per_microlens=of("centre_shift_px_per_microlens"),
        ),
        fields=images,
        sampling=sampling,
        depth=Depth(
            disparity_pitches_per_mm=of("disparity_pitches_per_mm"),
            sigma_z_mm=of("sigma_z_mm"),
            sigma_disparity_pitches=SIGMA_DISPARITY,
        ),
        diffraction=Diffraction(fresnel_number=of("fresnel_number"), airy_radius_px=of("airy_radius_px")),
        effects=tuple(
            EffectLine(line.name, line.estimate, line.unit, line.budget, line.on, line.reason) for line in plan(design)
        ),
        verdicts=verdicts_of(camera, f_number, non_distortion, sampling, traced),
        warnings=warnings_of(design, images),
        method=" ".join(_methods(design, rays, COUNTED_ERROR if accuracy is None else accuracy)),
        real_lens=traced,
    )


def _methods(design: Design, rays: int, error: float) -> list[str]:
    methods = [METHOD]
    if not design.aligned:
        methods.append(COUNTED.format(rays=rays, error=error))
    if design.lens is not None:
        methods.append(TRACED)
    return methods


def _axis(field: float | tuple[float, float]) -> tuple[float, float]:
    x, y = (float(field), 0.0) if isinstance(field, (int, float)) else (float(field[0]), float(field[1]))
    if not (math.isfinite(x) and math.isfinite(y)):
        raise ValueError(f"field {field!r} is not finite; give mm on the MLA")
    return x, y
