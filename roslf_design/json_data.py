"""What results become before they are written as JSON, which has no infinity and nothing undefined."""

from __future__ import annotations

import math
from typing import Any


def null_unless_finite(value: Any) -> Any:
    """The same tree of mappings and lists, with None for every number that is not finite.

    For results that say elsewhere why a number is missing (a metric that no trial defines, a limit that is not set).
    """
    if isinstance(value, dict):
        return {key: null_unless_finite(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [null_unless_finite(inner) for inner in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
