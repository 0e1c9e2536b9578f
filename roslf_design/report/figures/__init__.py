"""The figures, one a file: each takes a design (or its effects) and Axes, draws, and returns the Axes.

>>> ax = plot_matching_plane(roslf.load("paper"))

Names below are imported when first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .cells import plot_cells
    from .depth_precision import plot_depth_precision
    from .effects_budget import plot_effects_budget
    from .field_maps import plot_image_offset, plot_kept_fraction
    from .matching_plane import plot_matching_plane
    from .microlens_images import plot_microlens_image
    from .ray_diagram import plot_ray_diagram

_HOMES = {
    "plot_cells": ".cells",
    "plot_depth_precision": ".depth_precision",
    "plot_effects_budget": ".effects_budget",
    "plot_image_offset": ".field_maps",
    "plot_kept_fraction": ".field_maps",
    "plot_matching_plane": ".matching_plane",
    "plot_microlens_image": ".microlens_images",
    "plot_ray_diagram": ".ray_diagram",
}

__all__ = [
    "plot_cells",
    "plot_depth_precision",
    "plot_effects_budget",
    "plot_image_offset",
    "plot_kept_fraction",
    "plot_matching_plane",
    "plot_microlens_image",
    "plot_ray_diagram",
]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name], __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
