"""Result of `roslf decode` on an image or files of views, with everything that it reports."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..calibration.centres import MicrolensCentres
from ..calibration.decoding import LightField
from ..calibration.frames import Frame
from ..calibration.refocusing import FocusPlane

SCHEMA = "roslf.decoding/1"


@dataclass(frozen=True, eq=False)
class RawSource:
    """The raw image that a light field was decoded from, and its lattice."""

    frame: Frame
    """Grey, dark frame off."""
    centres: MicrolensCentres
    white: bool
    """Whether a white image told the centres; else the scene itself."""


@dataclass(frozen=True, eq=False)
class Decoded:
    """A light field, its refocus stack, and where both come from."""

    source: str
    """Name of the file or folder."""
    kind: str
    """"raw", "views" or "matlab"."""
    field: LightField
    stack: tuple[FocusPlane, ...]
    row: int
    """Row of the epipolar-plane image."""
    raw: RawSource | None = None
    distances_from: str = ""
    """Source of distances [mm]: a design, a calibration, the cameras of a folder; empty where there is none."""
    warnings: tuple[str, ...] = ()

    @property
    def units(self) -> tuple[str, str]:
        """Unit of s and t, and of u and v."""
        return ("px", "pitches") if self.kind == "raw" else ("views", "px")

    @property
    def views_with_light(self) -> int:
        """Views in which anything was measured."""
        return int((self.field.weight > 0).any(axis=(2, 3)).sum())

    def to_dict(self) -> dict[str, Any]:
        """Everything as JSON's types."""
        field = self.field
        spread = field.hexagonal is not None
        return {
            "schema": SCHEMA,
            "source": self.source,
            "kind": self.kind,
            "lattice": None if self.raw is None else _lattice(self.raw),
            "views": {
                "columns": len(field.s),
                "rows": len(field.t),
                "with_light": self.views_with_light,
                "width": len(field.u),
                "height": len(field.v),
                "step_pitches": math.sqrt(3) / 2 if spread else 1.0,
            },
            "distances_from": self.distances_from or None,
            "focus": [
                {
                    "distance_mm": plane.distance,
                    "disparity_pitches": plane.disparity,
                    "slope_pitches_per_px": plane.slope,
                }
                for plane in self.stack
            ],
            "epi": {"row": self.row, "v_pitches": float(field.v[self.row])},
            "warnings": list(self.warnings),
        }


def _lattice(raw: RawSource) -> dict[str, Any]:
    lattice = raw.centres.lattice
    return {
        "from": "white image" if raw.white else "raw image",
        "layout": lattice.layout,
        "pitch_px": lattice.pitch,
        "rotation_mrad": 1e3 * lattice.rotation,
        "origin_px": list(lattice.origin),
        "first_px": list(lattice.first),
        "second_px": list(lattice.second),
        "bent": lattice.bend is not None,
        "rms_px": raw.centres.rms,
        "microlenses": raw.centres.counts(),
    }


def textured_row(field: LightField) -> int:
    """The row of the middle view with most contrast along it; the middle one where there is none."""
    view, weight = field.view(), field.view_weight() > 0
    steps = np.square(np.diff(view.astype(float), axis=1)) * (weight[:, 1:] & weight[:, :-1])
    power = steps.sum(axis=1)
    return int(power.argmax()) if power.max(initial=0.0) > 0 else len(field.v) // 2
