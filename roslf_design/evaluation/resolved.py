"""Detail that a picture resolves at a station and a microlens, and what limits it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..theory.depth_of_field import Kind
from ..theory.resolution import Direction
from ..traced.fields import DesignImages, IdealImages
from ..words import number
from .stations import Station

Place = tuple[float, float]
LEVELS = (0.5, 0.1)
WAYS: tuple[Direction, Direction] = ("tangential", "sagittal")


@dataclass(frozen=True)
class Resolved:
    """Detail that an image shows, by its contrast; the coarser of both directions. None where dark or folded."""

    at_mm: float
    plane: str
    """Which plane it is, as "focal plane"."""
    x0_mm: float | None
    """From the axis to the place on the object; None where the lens shows none."""
    x_ml_mm: Place
    image: Kind
    mtf50_lp_per_mm: float | None
    mtf10_lp_per_mm: float | None
    tangential_lp_per_mm: tuple[float | None, float | None]
    """Line frequencies at 50 and 10 % MTF."""
    sagittal_lp_per_mm: tuple[float | None, float | None]
    fold_lp_per_mm: float
    """Nyquist frequency of one sample a microlens: finer detail aliases."""
    usable_lp_per_mm: float | None
    """The lower of both: finest detail that shows, with half its contrast or more, as what it is."""
    limited_by: Literal["contrast", "sampling"]

    @property
    def remark(self) -> str:
        """Limit that counts, then the others."""
        limits = (self.mtf50_lp_per_mm, self.mtf10_lp_per_mm, self.fold_lp_per_mm)
        half, tenth, fold = (number(limit or 0.0, 4) for limit in limits)
        if self.limited_by == "contrast":
            return f"MTF 50 %; 10 % at {tenth}, aliases above {fold}"
        return f"sampling; MTF 50 % at {half}, 10 % at {tenth}"


def resolved(images: IdealImages | DesignImages, field: int, station: Station, image: Kind) -> Resolved:
    """Detail that one field shows of a plane ahead of the tip."""
    plane, at = station
    transfer = images.transfer(field, at)
    tangential, sagittal = transfer.limits_each_way(LEVELS, image)
    half, tenth = (None if math.isnan(a) else min(a, b) for a, b in zip(tangential, sagittal, strict=True))
    x0 = np.broadcast_to(np.hypot(*images.on_plane(at)), (len(images.fields), 1))[field, 0]
    place = tuple(images.fields[field].tolist())
    each = [(None if math.isnan(a) else a, None if math.isnan(b) else b) for a, b in (tangential, sagittal)]
    fold = min(map(transfer.fold, WAYS))
    usable = None if half is None else min(half, fold)
    limit: Literal["contrast", "sampling"] = "contrast" if usable == half else "sampling"
    return Resolved(at, plane, known(float(x0)), place, image, half, tenth, each[0], each[1], fold, usable, limit)


def known(value: float) -> float | None:
    """Value, or None where there is none."""
    return None if math.isnan(value) else value
