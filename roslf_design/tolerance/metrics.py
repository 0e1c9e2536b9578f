"""The numbers of a build that can be held to limits: their names, meanings, and values over fields and trials."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..design import Design
from .axial import AXIAL
from .camera import build
from .thin import ThinBuilds
from .traced import TracedBuilds

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Metric:
    """A number of a build."""

    name: str
    unit: str
    meaning: str
    kind: Literal["pencil", "shape", "decoder", "axial"]
    """What it takes: the pencil through a microlens, the clipped image, a decoder, or nothing but axial distances."""

    @property
    def per_field(self) -> bool:
        """Whether it has a value at every field, or one for the whole camera."""
        return self.kind != "axial"


_TABLE: tuple[tuple[str, str, str, Literal["pencil", "shape", "decoder", "axial"]], ...] = (
    ("fill_factor", "", "microlens-image diameter over pitch, local to the field (Eq. 7)", "pencil"),
    ("mismatch_px", "px", "microlens-image diameter less pitch: overlap above 0, gap below", "pencil"),
    ("image_diameter_mm", "mm", "diameter of the disc as large as the unclipped microlens image", "pencil"),
    ("image_diameter_px", "px", "the same in pixels: geometric views", "pencil"),
    ("image_pitch_mm", "mm", "distance between neighbouring microlens images", "pencil"),
    (
        "non_distortion_room_mm",
        "mm",
        "room between the pencil and the nearest rim (Eqs. 5-6), below 0 where it is cut",
        "pencil",
    ),
    ("centre_shift_px", "px", "how far the image centre lies inside that through the lens's centre (Eq. 4)", "pencil"),
    ("kept_fraction", "", "area of the microlens image over that of the unclipped FAP", "shape"),
    ("image_area_mm2", "mm^2", "area of the microlens image", "shape"),
    (
        "blur_pitches",
        "pitches",
        "rms radius on the array of an object point's light, in microlens pitches; of rays alone",
        "decoder",
    ),
    ("axis_ratio", "", "minor over major axis of the microlens image's second moments; undefined where dark", "shape"),
    ("centre_error_px", "px", "distance of the image centre from where the decoder believes it", "decoder"),
    ("centre_error_x_px", "px", "the same along x", "decoder"),
    ("centre_error_y_px", "px", "the same along y", "decoder"),
    ("depth_error_mm", "mm", "decoded depth less true depth of a point on the field's chief ray", "decoder"),
    (
        "disparity_pitches_per_mm",
        "pitches/mm",
        "disparity between the FAP's rims per depth, at the focal plane",
        "axial",
    ),
    ("sigma_z_mm", "mm", "depth spread at the focal plane for a disparity error of 0.1 pitch", "axial"),
    ("inverse_aperture_constant", "", "1/H, Eq. 3", "axial"),
    ("vergence_at_mla_per_mm", "1/mm", "1/L of the exit pupil", "axial"),
    ("f_number_microlens", "", "d_2/d", "axial"),
    ("f_number_pupil", "", "d_1/(D_F H), Eq. 8", "axial"),
    ("f_number_main_lens", "", "d_1/D, Eq. 9", "axial"),
    ("centre_shift_px_per_microlens", "px", "Eq. 4 per microlens", "axial"),
    ("views_independent", "", "4 N_F", "axial"),
    ("object_sample_mm", "mm", "d d_f/d_1", "axial"),
    ("view_baseline_mm", "mm", "q d_1/(H d_2)", "axial"),
    ("fresnel_number", "", "N_F = d^2/(4 lambda d_2)", "axial"),
    ("airy_radius_px", "px", "1.22 lambda d_2/d", "axial"),
    ("microlens_defocus_px", "px", "ray blur d d_2 |1/f_ml - 1/d_2 - 1/L|", "axial"),
)
METRICS = {row[0]: Metric(*row) for row in _TABLE}
"""Every metric by its name; names and values follow `roslf evaluate --json` where it has them."""


@dataclass(frozen=True)
class Column:
    """One metric at one field (None: the whole camera)."""

    metric: str
    field: int | None

    @property
    def label(self) -> str:
        """E.g. ``kept_fraction@2``."""
        return self.metric if self.field is None else f"{self.metric}@{self.field}"


def metric_named(name: str) -> Metric:
    """Find a metric.

    Raises
    ------
    ValueError
        Not known; names the nearest.
    """
    if name in METRICS:
        return METRICS[name]
    near = difflib.get_close_matches(name, METRICS, 1, 0.4)
    raise ValueError(
        f"'{name}' is no metric; " + (f"did you mean '{near[0]}'?" if near else f"known are {', '.join(METRICS)}")
    )


@dataclass(frozen=True)
class Question:
    """What is asked of every build: a nominal design, metrics, fields, and where the depth target stands."""

    design: Design
    metrics: tuple[str, ...]
    fields: tuple[tuple[float, float], ...]
    """Microlens positions on the array [mm]."""
    object_distance: float
    """Z of the decoder's target, in front of the main lens [mm]."""

    @property
    def columns(self) -> tuple[Column, ...]:
        """Every metric at every field it has, metric by metric."""
        count = len(self.fields)
        return tuple(
            Column(name, field)
            for name in self.metrics
            for field in (range(count) if METRICS[name].per_field else (None,))
        )


def evaluate_builds(question: Question, values: Mapping[str, Array], trials: int, *, calibrated: bool = False) -> Array:
    """Every column of a question for many builds.

    Parameters
    ----------
    question : Question
        What is asked.
    values : mapping
        Perturbable place to its numbers in each build, shape (trials,); places left out are nominal.
    trials : int
        How many builds.
    calibrated : bool
        Whether the decoder was calibrated on each build, else it believes in the nominal design.

    Returns
    -------
    ndarray, shape (columns, trials)
        NaN marks what is undefined: every column of a build that is no design (d_3 >= d_f, a size below zero), the
        shape of a dark image, a depth at infinity.
    """
    design, rest = question.design, (question.fields, question.object_distance, calibrated)
    if design.lens is None:
        builds = ThinBuilds(build(design, values, trials), design, *rest)
    else:
        builds = TracedBuilds.of(design, values, trials, *rest)
    camera = builds.camera
    results = np.empty((len(question.columns), trials))
    row = 0
    # What a build leaves undefined divides by zero somewhere; it is told apart below, once.
    with np.errstate(all="ignore"):
        for name in question.metrics:
            metric = METRICS[name]
            rows = len(question.fields) if metric.per_field else 1
            results[row : row + rows] = AXIAL[name](camera) if metric.kind == "axial" else builds.value(name)
            row += rows
    results[:, ~camera.valid] = np.nan
    results[~np.isfinite(results)] = np.nan
    return results
