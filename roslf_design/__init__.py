"""Optical design and tolerance explorer for light-field cameras that look through a restricted object space.

>>> import roslf_design as roslf
>>> design = roslf.load("paper")
>>> result = roslf.evaluate(design)

Names below are imported when first used, so that `import roslf_design` costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .design import Design, DesignBatch, DesignError, dumps, load, loads, preset_names, save
    from .evaluation import Evaluation, evaluate

__version__ = "0.1.0"

_HOMES = {
    "Design": ".design",
    "DesignBatch": ".design",
    "DesignError": ".design",
    "dumps": ".design",
    "load": ".design",
    "loads": ".design",
    "preset_names": ".design",
    "save": ".design",
    "Evaluation": ".evaluation",
    "evaluate": ".evaluation",
}

__all__ = [
    "Design",
    "DesignBatch",
    "DesignError",
    "Evaluation",
    "__version__",
    "dumps",
    "evaluate",
    "load",
    "loads",
    "preset_names",
    "save",
]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name], __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
