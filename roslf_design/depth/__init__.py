"""Depth from a light field: the disparity of every microlens and its standard error; files of views and disparities."""

from __future__ import annotations

from .estimate import (
    DisparityMap,
    DisparityStatus,
    EpipolarPlane,
    PixelNoise,
    epipolar_plane,
    estimate_disparity,
)
from .view_files import CameraGrid, ViewFiles, pfm_bytes, read_pfm, read_views, view_files

__all__ = [
    "CameraGrid",
    "DisparityMap",
    "DisparityStatus",
    "EpipolarPlane",
    "PixelNoise",
    "ViewFiles",
    "epipolar_plane",
    "estimate_disparity",
    "pfm_bytes",
    "read_pfm",
    "read_views",
    "view_files",
]
