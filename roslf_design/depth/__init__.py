"""Depth from a light field: the disparity of every microlens and its standard error."""

from __future__ import annotations

from .estimate import (
    DisparityMap,
    DisparityStatus,
    EpipolarPlane,
    PixelNoise,
    epipolar_plane,
    estimate_disparity,
)

__all__ = [
    "DisparityMap",
    "DisparityStatus",
    "EpipolarPlane",
    "PixelNoise",
    "epipolar_plane",
    "estimate_disparity",
]
