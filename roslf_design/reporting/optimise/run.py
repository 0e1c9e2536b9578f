"""An optimisation study run for a page about it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ...design import Design
from ...errors import InputError
from ...optimization.study import Result, read_study, run
from ...progress import CountedProgress, silent


def run_optimisation(
    data: Mapping[str, Any],
    design: Design | None = None,
    folder: Path = Path(),
    origin: str = "",
    tell: CountedProgress = silent,
    seed: int | None = None,
) -> Result:
    """Run an optimisation study: as `tolerance_plan`; `tell` hears what is being done, `seed` replaces the study's."""
    study = read_study(data, folder, origin, seed, design)
    try:
        return run(study, tell)
    except InputError as error:
        raise error if error.origin else InputError(error.problems, origin) from None
