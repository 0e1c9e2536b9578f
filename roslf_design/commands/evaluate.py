"""`roslf evaluate`."""

from __future__ import annotations

import json as json_text
import math
import time
from dataclasses import replace
from typing import Annotated

from cyclopts import Parameter

from ..accuracy.statement import check_accuracy
from ..design import load
from ..errors import InputError, Problem
from ..evaluation import evaluate as compute
from ..evaluation.precision import evaluation_accuracy
from ..evaluation.show import print_evaluation


def evaluate(
    design: str,
    /,
    *,
    field: Annotated[list[str] | None, Parameter(allow_leading_hyphen=True, negative=())] = None,
    json: Annotated[bool, Parameter(negative=())] = False,
    accuracy: float | None = None,
) -> None:
    """Everything closed forms say of a design: f-number match, field, microlens images, depth, diffraction.

    Parameters
    ----------
    design
        A design file, or the name of a preset (see `roslf presets`).
    field
        Microlens position on the MLA in mm, along x ("11.15") or "x,y"; may be given several times. Default: centre,
        edge and corner of what the sensor sees.
    json
        Print JSON instead of tables.
    accuracy
        What shares of light may be off by where parts are tilted and rays are counted, as 1e-4. Default: 0.002.
        Straight designs are exact.
    """
    if accuracy is not None:
        check_accuracy(accuracy)
    fields = None if field is None else [parse_field(text) for text in field]
    began = time.perf_counter()
    loaded = load(design)
    try:
        result = compute(loaded, fields, accuracy)
    except ValueError as error:
        if isinstance(error, InputError):
            raise
        raise InputError((Problem("--accuracy", str(error)),)) from None
    worth = evaluation_accuracy(loaded, result, accuracy)
    worth = replace(worth, seconds=time.perf_counter() - began)
    if json:
        # Without an accuracy asked for, nothing that differs from run to run.
        values = result.to_dict() | {"accuracy": worth.to_dict(times=accuracy is not None)}
        print(json_text.dumps(values, indent=1, allow_nan=False, ensure_ascii=False))
        return
    from rich.console import Console

    console = Console()
    print_evaluation(result, console)
    if accuracy is not None:
        console.print(f"\n{worth.sentence()}", highlight=False, soft_wrap=True)


def parse_field(text: str) -> tuple[float, float]:
    """Read "11.15" or "x,y" as a position on the MLA [mm].

    Raises
    ------
    InputError
        Neither one nor two finite numbers.
    """
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (1, 2) or not all(map(math.isfinite, numbers)):
        raise InputError((Problem("--field", f'cannot read "{text}"; write mm on the MLA, as "11.15" or "11.15,7.4"'),))
    return numbers[0], numbers[1] if len(numbers) == 2 else 0.0
