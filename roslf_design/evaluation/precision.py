"""What the numbers of an evaluation are worth: method and error, and how close the design is to a hard case."""

from __future__ import annotations

import math
from typing import NamedTuple

from ..accuracy.statement import Accuracy, check_accuracy
from ..camera import Camera
from ..design import Design
from ..theory.f_number import fill_factor, matched
from .fields import BEST_ACCURACY, RAYS, default_fields, evaluate_fields, field_discs, rays_for
from .result import Evaluation

ROUNDING = 1e-12
"""Relative, of closed forms and disc areas."""
COUNTED_ERROR = 0.002
"""Of a share counted with the rays that are taken where no accuracy is asked for."""

NEAR = 1e-2
"""Relative distance below which a design is called near a hard case."""


def check_evaluation_accuracy(design: Design, accuracy: float | None) -> None:
    """Refuse what is no accuracy, or what counted rays cannot reach.

    Raises
    ------
    InputError
    """
    if accuracy is None:
        return
    check_accuracy(accuracy)
    if not design.aligned:
        check_accuracy(accuracy, BEST_ACCURACY, "parts are tilted, and rays are counted; straight designs are exact")


def evaluation_accuracy(
    design: Design, result: Evaluation, asked: float | None = None, seconds: float | None = None
) -> Accuracy:
    """Rounding where everything is straight; where rays are counted, what half of them would have told.

    Parameters
    ----------
    design : Design
    result : Evaluation
        Of it, to the accuracy asked for.
    asked : float, optional
    seconds : float, optional
        That it took.
    """
    if design.aligned:
        method = "closed forms and exact disc areas"
        return Accuracy("every number, relative", method, ROUNDING, asked=asked, seconds=seconds)
    rays = RAYS if asked is None else rays_for(asked)
    measured, by = None, ""
    if asked is not None:
        # Half the rays miss by more than all of them do: their difference is an upper bound but for luck.
        half = evaluate_fields(design, [field.x_ml_mm for field in result.fields], max(256, rays // 2))
        pairs = zip(result.fields, half, strict=True)
        measured = max((abs(a.kept_fraction - b.kept_fraction) for a, b in pairs), default=0.0)
        by = "half the rays"
    of = "shares of light over the field (all other numbers to rounding)"
    method = f"parts are tilted: {rays} rays counted for each microlens"
    return Accuracy(of, method, COUNTED_ERROR if asked is None else asked, measured, by, asked, seconds)


# --- hard cases near by -----------------------------------------------------------------------------------------------


class Near(NamedTuple):
    """A design's distance from one hard case."""

    case: str
    distance: float
    """Relative; 0 is on it."""
    near: bool
    says: str
    """What that means for this design; empty where it is not near."""


def near_cases(design: Design) -> tuple[Near, ...]:
    """Distance from every place where a textbook formula loses digits, closest first."""
    f, d_f, d_3 = design.f, design.d_f, design.d_3
    fill = float(fill_factor(Camera.of(design)))
    # The pupil at the lens has no distance to scale by: a little in front of it the images touch at about the same D_F.
    touching = float(matched(Camera.of(design, {"d_3": d_3 or 0.01 * f}), "D_F").value)
    at_lens = Near("d_3 → 0", 0.0, True, "the aperture is at the main lens; margins are exact there")
    cases = [
        _near("d_3 → d_f", (d_f - d_3) / d_f, "the bore's end lies almost in the focal plane"),
        _near("d_3 → f", abs(d_3 - f) / f, "image-space telecentric"),
        _near("d_f → f", (d_f - f) / f, "the object is almost in the front focus"),
        _near("d_f → ∞", f / d_f, "focused almost at infinity"),
        _near("images just touch", abs(design.D_F / touching - 1), f"fill factor {fill:.6g}"),
        _near("d_3 → 0", d_3 / d_f, "the aperture is almost at the main lens") if d_3 > 0 else at_lens,
        *_rim_cases(design),
    ]
    return tuple(sorted(cases, key=lambda one: one.distance))


def _near(case: str, distance: float, says: str) -> Near:
    near = distance < NEAR
    lost = min(16.0, -math.log10(max(distance, 2.0**-52)))
    text = f"{says}; a formula that cancels there loses {lost:.0f} of 16 digits, the forms used lose none"
    return Near(case, distance, near, text if near else "")


def _rim_cases(design: Design) -> list[Near]:
    """Discs near containment or tangency, at the centre, edge and corner of the sensor."""
    centres, radii = field_discs(design, default_fields(design))
    inner, outer = math.inf, math.inf
    for place in range(len(radii)):
        for k in range(1, radii.shape[1]):
            apart = math.hypot(*(centres[place, k] - centres[place, 0]))
            r, R = float(radii[place, 0]), float(radii[place, k])
            inner = min(inner, abs(apart - abs(R - r)) / r)
            outer = min(outer, abs(R + r - apart) / r)
    return [
        _near("barely clipped", inner, "a rim almost touches the pupil's image from outside, somewhere in the field"),
        _near("discs near tangency", outer, "a rim leaves almost nothing of the pupil's image somewhere in the field"),
    ]
