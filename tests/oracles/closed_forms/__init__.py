"""Closed forms found again at 60 digits by tracing rays, one oracle of the same name and keywords for each.

Nothing here knows the formulas of `roslf_design.theory`. A camera is four planes, and its only laws are: a ray is
straight; the main lens bends it by its height over f; a pinhole microlens passes the ray through its centre. Quantities
are read off traced rays; unknown rays and matched lengths are found from two tries, everything being affine.
"""

from . import calibration, decoding, depth, lens_and_pupils, matching, stops
from .judging import ORACLES, flat, judge, keywords
from .projection import microlens_of, pixel_of, ray_of

__all__ = [
    "ORACLES",
    "calibration",
    "decoding",
    "depth",
    "flat",
    "judge",
    "keywords",
    "lens_and_pupils",
    "matching",
    "microlens_of",
    "pixel_of",
    "ray_of",
    "stops",
]
