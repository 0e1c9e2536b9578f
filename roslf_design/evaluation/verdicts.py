"""The questions an engineer asks first, answered with their margins and what would mend them."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ..camera import Camera
from ..design import Design
from ..theory.f_number import matched
from .result import Field, FNumber, NonDistortion, RealLens, RealLensField, Sampling, Verdict

SLACK_PX = 0.5
"""Overlap or gap of neighbouring microlens images that still counts as matched [px]."""
TOUCHING_PX = 1e-6
"""Overlap or gap that is told as touching: rounding, not optics [px]."""
OVERLAP_SLACK, GAP_SLACK = 0.01, 0.05
"""The same as shares of the pitch, where that allows more: overlap mixes views, a gap only wastes pixels."""


def verdicts_of(
    camera: Camera,
    f_number: FNumber,
    non_distortion: NonDistortion,
    sampling: Sampling,
    lens: RealLens | None = None,
) -> tuple[Verdict, ...]:
    """Answer whether the f-number is matched, the field undistorted, and the pixels worth having.

    With a real lens the field is judged by the traced images, and whether the thin lens holds is a question of its own.
    """
    field = _undistorted(camera, non_distortion)
    return (
        _matched(camera, f_number),
        field if lens is None else _undistorted_through(lens, non_distortion, field),
        _resolved(sampling),
        *(() if lens is None else (_thin(f_number, lens),)),
    )


def _undistorted_through(lens: RealLens, thin: NonDistortion, by_thin: Verdict) -> Verdict:
    """The field's verdict by the traced lens, Eq. 6's bound beside it."""
    bound = (
        f"measured through {lens.lens}, microlens images are whole out to {lens.x_ml_max_mm:.4g} mm on the MLA "
        f"({lens.x0_max_mm:.4g} mm object radius; thin lens, Eq. 6: {lens.thin_x_ml_max_mm:.4g} mm)"
    )
    seen = (
        f"the sensor sees {thin.field_half_width_mm:.4g} mm (half width), {thin.field_half_diagonal_mm:.4g} mm (corner)"
    )
    if lens.undistorted_in_field:
        return Verdict("field_undistorted", True, "good", f"field undistorted: {bound}; {seen}", "")
    folded = [field for field in lens.fields if field.status == "folded"]
    where = f"; folded at {', '.join(f'{x:g}, {y:g} mm' for x, y in (f.x_ml_mm for f in folded))}" if folded else ""
    other = lens.turned_x_ml_max_mm
    turned = f"turned round the lens sees whole images out to {other:.4g} mm; " if other is not None else ""
    ways = "a better corrected or wider lens, a FAP closer to it or a smaller sensor helps"
    remedy = f"{turned}{by_thin.remedy or ways}"
    return Verdict("field_undistorted", False, "fault", f"field distorted: {bound}{where}; {seen}", remedy)


def _thin(f: FNumber, lens: RealLens) -> Verdict:
    """Whether microlens images lie where the thin lens puts them, and are as large."""
    told = [field for field in lens.fields if field.shift_px is not None and field.widening_px is not None]
    worst = max(told, key=lambda field: _departure(field), default=None)
    unseen = len(told) < len(lens.fields)
    if worst is None:
        if not lens.fields:
            return Verdict("thin_lens_holds", True, "good", "thin lens: no field was asked for", "")
        return Verdict(
            "thin_lens_holds", False, "fault", "thin lens fails: no field asked for has a whole image", _OTHER
        )
    assert worst.shift_px is not None
    assert worst.widening_percent is not None
    x, y = worst.x_ml_mm
    moved, fill = math.hypot(*worst.shift_px), f.fill_factor * (1 + worst.widening_percent / 100)
    size = (
        f"at {x:g}, {y:g} mm on the MLA {lens.lens} shifts the microlens image by {moved:.3g} px and widens it by "
        f"{worst.widening_percent:.3g} % (fill factor {fill:.3g})"
    )
    if _departure(worst) <= SLACK_PX and not unseen:
        return Verdict("thin_lens_holds", True, "good", f"thin lens holds: {size}", "")
    return Verdict("thin_lens_holds", False, "fault", f"thin lens does not hold: {size}", _OTHER)


_OTHER = "calibrate image centres rather than compute them, or take a better corrected lens"


def _departure(field: RealLensField) -> float:
    assert field.shift_px is not None
    assert field.widening_px is not None
    return math.hypot(*field.shift_px) + abs(field.widening_px) / 2


def _matched(camera: Camera, f: FNumber) -> Verdict:
    ok = abs(f.mismatch_px) <= SLACK_PX or -GAP_SLACK <= f.fill_factor - 1 <= OVERLAP_SLACK
    kind = "overlap by" if f.mismatch_px > 0 else "leave gaps of"
    images = f"images {kind} {abs(f.mismatch_px):.3g} px" if abs(f.mismatch_px) >= TOUCHING_PX else "images just touch"
    if ok:
        text = f"f-number matched: fill factor {f.fill_factor:.5g}, {images}"
        return Verdict("f_number_matched", True, "good", text, "")
    text = (
        f"f-number not matched: microlens f/{f.microlens:.4g} against pupil f/{f.pupil:.4g}, fill factor "
        f"{f.fill_factor:.4g}, {images}"
    )
    return Verdict("f_number_matched", False, "fault", text, _match_remedy(camera))


def _match_remedy(camera: Camera) -> str:
    ways = {"d_2": matched(camera, "d_2"), "D_F": matched(camera, "D_F"), "d_3": matched(camera, "d_3")}
    found = [f"{symbol} = {float(way.value):.5g} mm" for symbol, way in ways.items() if way.exists]
    if not found:
        return "no single change of d_2, D_F or d_3 matches it; change the microlens pitch or the focus"
    return f"any one of these matches it exactly: {', '.join(found)}"


def _undistorted(camera: Camera, field: NonDistortion) -> Verdict:
    seen = (
        f"the sensor sees {field.field_half_width_mm:.4g} mm (half width), "
        f"{field.field_half_diagonal_mm:.4g} mm (corner)"
    )
    if field.undistorted_in_field:
        bound = (
            f"out to {field.x0_max_mm:.4g} mm object radius, limited by the {field.limited_by}"
            if math.isfinite(field.x0_max_mm)
            else "at any field"
        )
        text = f"field undistorted: microlens images are full discs {bound}; {seen}"
        return Verdict("field_undistorted", True, "good", text, "")
    text = (
        f"field distorted: cat's-eye images beyond {field.x0_max_mm:.4g} mm object radius "
        f"({field.x_ml_max_mm:.4g} mm on the MLA), cut by the {field.limited_by}; {seen}"
    )
    return Verdict("field_undistorted", False, "fault", text, _field_remedy(camera, field))


def _field_remedy(camera: Camera, field: NonDistortion) -> str:
    grow = 2 * abs(field.room_at_corner_mm)
    if field.limited_by == "main lens":
        return (
            f"a main lens of {camera.D + grow:.4g} mm clear aperture frees the whole field; "
            "a smaller FAP, a FAP closer to the lens or a smaller sensor helps too"
        )
    return f"widen the {field.limited_by} by {grow:.4g} mm, or use a smaller FAP or a smaller sensor"


def _resolved(sampling: Sampling) -> Verdict:
    views, independent = sampling.views_geometric, sampling.views_independent
    if independent >= views:
        text = f"views resolved: {views:.3g} pixels across a microlens image, {independent:.3g} independent views"
        return Verdict("views_resolved", True, "good", text, "")
    return Verdict(
        "views_resolved",
        False,
        "limit",
        f"diffraction limits the views: {views:.3g} pixels across a microlens image hold {independent:.3g} independent "
        "views per axis (4 N_F)",
        "larger microlenses or a shorter d_2 gain views; larger pixels would lose nothing",
    )


def warnings_of(design: Design, fields: Sequence[Field]) -> tuple[str, ...]:
    """What is no error but must not go unsaid."""
    found = []
    for side, mla, sensor in zip(("wide", "high"), design.microlens_array.size, design.sensor_size, strict=True):
        if sensor > mla * (1 + 1e-9):
            found.append(
                f"the sensor is {sensor:.5g} mm {side} (seen at the MLA) but the MLA only {mla:.5g} mm: "
                "its margin stays dark, and fields are counted to the MLA's edge"
            )
    array = design.microlens_array
    if array.layout == "hexagonal" and array.lens_shape == "square":
        found.append(
            "square microlenses as wide as the pitch overlap in a hexagonal layout, whose rows are 0.866 pitch apart; "
            'lens_shape = "circular" fits'
        )
    half_x, half_y = (size / 2 for size in array.size)
    for field in fields:
        x, y = field.x_ml_mm
        if abs(x) > half_x or abs(y) > half_y:
            found.append(f"field {x:g}, {y:g} mm is beyond the MLA (half size {half_x:g} x {half_y:g} mm)")
        if field.status == "dark":
            found.append(f"field {x:g}, {y:g} mm gets no light: the rims' images do not overlap there")
    return tuple(found)
