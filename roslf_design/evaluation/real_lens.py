"""A real main lens traced: what it does to microlens images and to the field, beside its thin twin."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ..camera import Camera
from ..design import Design
from ..lenses.prescription import LensError
from ..lenses.tracer import KEPT
from ..theory.light import half_field
from ..traced.camera import camera_of
from ..traced.images import measured_bound, real_field
from .result import NonDistortion, RealLens, RealLensField

STATUS = ("dark", "clipped", "full", "folded")


def trace_lens(design: Design, axes: Sequence[tuple[float, float]], thin: NonDistortion) -> RealLens | None:
    """Trace a design's main lens.

    Parameters
    ----------
    design : Design
    axes : sequence of (x, y)
        Microlens axes, on the MLA [mm].
    thin : NonDistortion
        Eq. 6 for the thin twin.

    Returns
    -------
    RealLens or None
        None where the main lens is ideal.

    Raises
    ------
    LensError
        Parts that collide with the lens.
    """
    if design.lens is None:
        return None

    camera = camera_of(design)
    constants = camera.first_order
    x0, x_ml = measured_bound(design)
    half_x, half_y = map(float, half_field(Camera.of(design)))
    corner = ((half_x, half_y), (-half_x, half_y), (half_x, -half_y), (-half_x, -half_y))
    fields = _fields(design, axes)
    whole = all(field.status == "full" for field in (*fields, *_fields(design, corner)))
    return RealLens(
        lens=camera.lens.name,
        focal_length_mm=constants.focal_length,
        back_focal_length_mm=constants.back_focal_length,
        front_principal_mm=constants.front_principal,
        rear_principal_mm=constants.rear_principal,
        first_vertex_to_fap_mm=-camera.fap.z,
        last_vertex_to_mla_mm=camera.array.z - camera.lens.length,
        x0_max_mm=x0,
        x_ml_max_mm=x_ml,
        thin_x_ml_max_mm=thin.x_ml_max_mm,
        turned_x_ml_max_mm=None if whole else _turned_bound(design),
        undistorted_in_field=whole,
        fields=fields,
    )


def _turned_bound(design: Design) -> float | None:

    try:
        return measured_bound(design.replace({"main_lens.reversed": not design.main_lens.reversed}))[1]
    except LensError:
        return None


def _fields(design: Design, axes: Sequence[tuple[float, float]]) -> tuple[RealLensField, ...]:
    if not axes:
        return ()

    found = real_field(design, axes)
    images, maps = found.images, found.maps
    cone = design.D_F / float(Camera.of(design).A)
    rows = []
    for i, axis in enumerate(axes):
        seen = maps.status[i] == KEPT
        whole = seen and not math.isnan(found.widening[i])
        tangential, sagittal = float(maps.tangential_focus[i]), float(maps.sagittal_focus[i])
        colour = float(found.lateral_colour[i])
        rows.append(
            RealLensField(
                x_ml_mm=axis,
                status=STATUS[int(images.status[i])],
                chief_ray=found.chief[i],
                kept_fraction=float(images.kept_fraction[i]),
                centre_mm=_pair(images.chief[i]) if seen else None,
                diameter_mm=found.thin_diameter * (1 + float(found.widening[i])) if whole else None,
                axis_ratio=float(images.axis_ratio[i]) if images.status[i] else None,
                shift_px=_pair(found.shift[i] / design.q) if seen else None,
                widening_px=found.thin_diameter * float(found.widening[i]) / design.q if whole else None,
                widening_percent=100 * float(found.widening[i]) if whole else None,
                tangential_focus_mm=tangential if seen else None,
                sagittal_focus_mm=sagittal if seen else None,
                tangential_focus_pitches=tangential * cone / design.d if seen else None,
                sagittal_focus_pitches=sagittal * cone / design.d if seen else None,
                blur_pitches=float(maps.blur[i]) / design.d if seen else None,
                distortion_percent=100 * float(maps.distortion[i]) if seen else None,
                lateral_colour_pitches=None if math.isnan(colour) else colour / design.d,
            )
        )
    return tuple(rows)


def _pair(values: Sequence[float]) -> tuple[float, float]:
    return float(values[0]), float(values[1])
