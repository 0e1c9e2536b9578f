"""Result of `roslf decode` on an image or files of views, with everything that it reports."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..calibration.decoding import LightField
from ..calibration.designed import image_pitch
from ..calibration.raw import OTHER_CAMERA, RawSource, from_raw
from ..calibration.refocusing import CameraDistances, Distances, FocusPlane, focus_stack
from ..calibration.white_profile import WhiteProfile
from ..calibration.written import calibrated_design
from ..camera import Camera
from ..design import Design
from ..errors import refusal
from ..options import FileName, Options, refuse_idle
from ..tables import BriefValue
from ..theory.focused import refuse_focused
from ..theory.limits import as_design
from ..units import read_quantity
from .captured import disagreement
from .view_files import is_views, read_views
from .view_order import in_order

SCHEMA = "roslf.decoding/1"
MOST_PLANES = 100
"""Planes of one refocus stack."""


@dataclass(frozen=True, eq=False)
class Decoded(BriefValue):
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
    turned_over: str = ""
    """Which of u and v was reversed, as the camera sees the scene in an odd number of mirrors."""
    white: WhiteProfile | None = None
    """Microlens images of the white image; None without one, and where nothing fits."""

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
            "lattice": None if self.raw is None else self.raw.to_dict(),
            "white": None if self.white is None else self.white.to_dict(),
            "views": {
                "columns": len(field.s),
                "rows": len(field.t),
                "with_light": self.views_with_light,
                "width": len(field.u),
                "height": len(field.v),
                "step_pitches": math.sqrt(3) / 2 if spread else 1.0,
            },
            "turned_over": self.turned_over or None,
            "distances_from": self.distances_from or None,
            "focus": [plane.to_dict() for plane in self.stack],
            "epi": {"row": self.row, "v_pitches": float(field.v[self.row])},
            "warnings": list(self.warnings),
        }


def _textured_row(field: LightField) -> int:
    """The row of the middle view with most contrast along it; the middle one where there is none."""
    view, weight = field.view(), field.view_weight() > 0
    steps = np.square(np.diff(view.astype(float), axis=1)) * (weight[:, 1:] & weight[:, :-1])
    power = steps.sum(axis=1)
    return int(power.argmax()) if power.max(initial=0.0) > 0 else len(field.v) // 2


class DecodeOptions(Options):
    """Files that help to decode an image, and planes to refocus to."""

    white: Path | None = None
    """White image of the same camera setting: shows where the microlens images are, and takes vignetting off. Without
    one, a design says what to look for in the image itself; views are then less sure, and vignetted."""
    dark: Path | None = None
    """Frame without light, taken off both."""
    design: FileName | None = None
    """Design of the camera: a file or a preset. Names refocused planes in mm, helps to find the microlens images."""
    calibration: Path | None = None
    """Folder that roslf calibrate wrote: the same by the camera as calibrated."""
    focus: list[str] | None = None
    """Planes to refocus to, several times or with commas: distances from the main lens ("320 mm"), or disparities
    between opposite edges of the views, in pitches (1.5; of files of views in pixels), above 0 for near points.
    Default: seven planes over all that is sharp."""
    row: int | None = None
    """Row of the views that the epipolar-plane image is of, from 0. Default: the one with most texture."""

    def camera(self) -> tuple[Design | None, str]:
        """Camera that was named, and what to call it."""
        if self.design is not None and self.calibration is not None:
            raise refusal("calibration", "is a camera as well as `design`; drop one")
        if self.calibration is not None:
            return calibrated_design(self.calibration), "the calibration"
        return (None, "") if self.design is None else (as_design(self.design), "the design")


def decoded(image: Path, options: DecodeOptions, progress: Callable[[str], None] = lambda _: None) -> Decoded:
    """Read and decode an image, or read views.

    Raises
    ------
    InputError
        What cannot be read or does not go together.
    NoLatticeError
        No microlens images are found.
    """
    views, row = is_views(image), options.row
    if views:
        refuse_idle(options, ("white", "dark", "design", "calibration"))
    camera, source = options.camera()
    if camera is not None:
        refuse_focused(camera, "decoding into views")
    warnings: list[str] = []
    raw: RawSource | None = None
    white: WhiteProfile | None = None
    distances: Distances | None = None
    turned_over = ""
    if views:
        progress("reading views")
        files = read_views(image)
        ordered = in_order(files.field, partial(disagreement, across=max(files.field.values.shape[:2])))
        field, kind, distances = ordered.field, files.kind, files.grid
        if ordered.warning:
            warnings.append(ordered.warning)
        source = "parameters.cfg" if files.grid is not None else ""
        if files.missing:
            warnings.append(f"{files.missing} of {field.values[:, :, 0, 0].size} views are missing")
    else:
        kind = "raw"
        if camera is not None:
            distances = CameraDistances(Camera.of(camera))
        read = from_raw(image, options.white, options.dark, camera, progress)
        field, raw = read.field, read.source
        if read.white is not None:
            progress("fitting microlens images")
            white = read.white.profile(raw.centres, camera, read.balance)
        warnings += raw.centres.warnings
        if camera is not None and (reversed_along := Camera.of(camera).chain.mirrored).any():
            turned_over = "uv"[(along := int(abs(reversed_along[1]) > abs(reversed_along[0])))]
            field = field.turned_over(along)
        designed = None if camera is None else image_pitch(camera)
        if designed is not None and abs(field.pitch / designed - 1) > OTHER_CAMERA:
            warnings.append(
                f"microlens images are {field.pitch:.4g} px apart, and {designed:.4g} px by {source}: distances are"
                " right only if it describes this camera"
            )
    chosen = None if options.focus is None else _disparities(options.focus, field, distances)
    if row is not None and not 0 <= row < len(field.v):
        raise refusal("row", f"{row} is none of the views' rows; give 0 to {len(field.v) - 1}")
    progress("refocusing")
    stack = focus_stack(field, chosen, distances)
    at = _textured_row(field) if row is None else row
    return Decoded(
        image.name, kind, field, stack, at, raw, source if distances is not None else "", tuple(warnings), turned_over,
        white,
    )  # fmt: skip


def _disparities(focus: list[str], field: LightField, distances: Distances | None) -> np.ndarray:
    """Disparities across the views [pitches] to refocus to; far ones first."""
    disparities = []
    texts = [part.strip() for each in focus for part in each.split(",")]
    if len(texts) > MOST_PLANES:
        raise refusal("focus", f"asks for {len(texts)} planes; give {MOST_PLANES} at most, the others in another run")
    for text in texts:
        try:
            value = float(text)
        except ValueError:
            if distances is None:
                message = f'"{text}" is a distance, which takes `design` or `calibration`; or give a disparity, as 1.5'
                raise refusal("focus", message) from None
            try:
                away = read_quantity(text, "length")
            except ValueError as error:
                raise refusal("focus", f'{error}; give "320 mm", or a disparity, as 1.5') from None
            slope = distances.slope(away) if away > 0 else math.nan
            if not math.isclose(distances.distance(slope), away, rel_tol=1e-6):
                raise refusal(
                    "focus", f'"{text}" lies where the camera sees nothing; give one in front of it'
                ) from None
            value = -slope * field.pitch
        reach = max(len(field.u), len(field.v))
        if not abs(value) <= reach:
            raise refusal("focus", f'"{text}" is a disparity of more than the whole picture, {reach}')
        disparities.append(value)
    return np.array(sorted(disparities))
