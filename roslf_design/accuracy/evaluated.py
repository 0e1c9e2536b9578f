"""What the numbers of an evaluation are worth: rounding where everything is straight, counted rays where it is not."""

from __future__ import annotations

from dataclasses import replace

from ..design import Design
from ..evaluation.fields import BEST_ACCURACY, RAYS, evaluate_fields, rays_for
from ..evaluation.result import Evaluation
from .statement import Accuracy, check_accuracy

ROUNDING = 1e-12
"""Relative, of closed forms and disc areas."""
COUNTED_ERROR = 0.002
"""Of a share counted with the rays that are taken where no accuracy is asked for."""


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
    """Method, expected and measured error.

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
        told = Accuracy("every number, relative", "closed forms and exact disc areas", ROUNDING, asked=asked)
        return replace(told, seconds=seconds)
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
