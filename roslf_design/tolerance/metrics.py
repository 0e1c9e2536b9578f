"""The numbers of a build that can be held to limits: their names, meanings, and values over fields and trials."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..design import Design
from .axial import AXIAL
from .camera import Camera, build
from .decoder import (
    Belief,
    Scene,
    believed_depth,
    calibrated_belief,
    chief_pixel,
    epi_slope_seen,
    nominal_belief,
    scene_for,
)
from .ellipses import intersect_ellipses
from .pencils import Ellipse, chief_point, rim_image, room

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

    @property
    def places(self) -> Array:
        """Fields as an array, shape (fields, 2) [mm]."""
        return np.array(self.fields, dtype=np.float64).reshape(-1, 2)


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
    camera = build(question.design, values, trials)
    fields = question.places
    known = _Builds(camera, question, fields, calibrated)
    results = np.empty((len(question.columns), trials))
    row = 0
    # What a build leaves undefined divides by zero somewhere; it is told apart below, once.
    with np.errstate(all="ignore"):
        for name in question.metrics:
            metric = METRICS[name]
            rows = len(fields) if metric.per_field else 1
            results[row : row + rows] = AXIAL[name](camera) if metric.kind == "axial" else known.value(name)
            row += rows
    results[:, ~camera.valid] = np.nan
    results[~np.isfinite(results)] = np.nan
    return results


class _Builds:
    """What several metrics of the same builds share, computed when first asked for."""

    def __init__(self, camera: Camera, question: Question, fields: Array, calibrated: bool) -> None:
        self.camera, self.question, self.fields, self.calibrated = camera, question, fields, calibrated
        self.x, self.y = fields[:, :1], fields[:, 1:]
        self.microlens = camera.microlens(self.x, self.y)
        self._kept: dict[str, Any] = {}

    def _once(self, key: str, make: Callable[[], Any]) -> Any:
        if key not in self._kept:
            self._kept[key] = make()
        return self._kept[key]

    def value(self, name: str) -> Any:
        return self._once(name, lambda: getattr(self, f"_{name}")())

    @property
    def image(self) -> Ellipse:
        rim = self.camera.rims[0]
        return self._once("image", lambda: rim_image(self.camera, rim, self.microlens).ellipse(rim.radius))  # type: ignore[no-any-return]

    @property
    def shapes(self) -> tuple[Array, Array, Array]:
        return self._once("shapes", self._shapes)  # type: ignore[no-any-return]

    @property
    def belief(self) -> Belief:
        return self._once("belief", self._believe)  # type: ignore[no-any-return]

    @property
    def scene(self) -> Scene:
        question = self.question
        return self._once("scene", lambda: scene_for(question.design, self.fields, question.object_distance))  # type: ignore[no-any-return]

    def _believe(self) -> Belief:
        design = self.question.design
        if not self.calibrated:
            return nominal_belief(design)
        reach = float(np.max(np.hypot(self.x, self.y))) or design.microlens_array.size[0] / 2
        return calibrated_belief(self.camera, design, reach, self.scene)

    def _image_diameter_mm(self) -> Any:
        return 2 * np.sqrt(np.sqrt(self.image.determinant))

    def _image_diameter_px(self) -> Any:
        return self.value("image_diameter_mm") / self.camera.q

    def _image_pitch_mm(self) -> Any:
        # Between the points half a pitch to either side: what mirrored builds share.
        camera, half = self.camera, self.camera.d / 2
        (x0, y0), (x1, y1), (x2, y2), (x3, y3) = (
            chief_point(camera, camera.microlens(self.x + a * half, self.y + b * half))
            for a, b in ((-1, 0), (1, 0), (0, -1), (0, 1))
        )
        return np.sqrt(np.abs((x1 - x0) * (y3 - y2) - (y1 - y0) * (x3 - x2)))

    def _fill_factor(self) -> Any:
        return self.value("image_diameter_mm") / self.value("image_pitch_mm")

    def _mismatch_px(self) -> Any:
        return (self.value("image_diameter_mm") - self.value("image_pitch_mm")) / self.camera.q

    def _non_distortion_room_mm(self) -> Any:
        return room(self.camera, self.microlens)

    def _centre_shift_px(self) -> Any:
        camera = self.camera
        x0, y0 = chief_point(camera, self.microlens)
        x1, y1 = rim_image(camera, camera.rims[1], self.microlens).centre
        cos, sin = self.scene.azimuth
        return ((x1 - x0) * cos + (y1 - y0) * sin) / camera.q

    def _shapes(self) -> tuple[Array, Array, Array]:
        camera = self.camera
        images = [rim_image(camera, rim, self.microlens).ellipse(rim.radius) for rim in camera.rims]
        shape = (len(self.fields), len(camera.valid))
        if not camera.tilted:
            from ..microlens.discs import intersect

            centres = np.stack([_spread([image.x, image.y], shape) for image in images], axis=-2)
            radii = np.stack([np.broadcast_to(np.sqrt(image.xx), shape) for image in images], axis=-1)
            centres -= centres[..., :1, :]
            found = intersect(centres, radii)
            return found.area, found.kept_fraction, np.where(found.lit, found.axis_ratio, np.nan)
        centres = np.stack([_spread([image.x, image.y], shape) for image in images], axis=-2).reshape(
            -1, len(images), 2
        )
        matrices = np.stack([_spread([image.xx, image.xy, image.yy], shape) for image in images], axis=-2)
        common = intersect_ellipses(centres - centres[:, :1], matrices.reshape(-1, len(images), 3))
        return common.area.reshape(shape), common.kept_fraction.reshape(shape), common.axis_ratio.reshape(shape)

    def _image_area_mm2(self) -> Any:
        return self.shapes[0]

    def _kept_fraction(self) -> Any:
        return self.shapes[1]

    def _axis_ratio(self) -> Any:
        return self.shapes[2]

    def _centre_error(self) -> tuple[Any, Any]:
        camera = self.camera
        x, y = chief_pixel(camera, self.x, self.y)
        believed = self.belief.lattice.centre(self.x / camera.d, self.y / camera.d)
        return x - believed[0], y - believed[1]

    def _centre_error_x_px(self) -> Any:
        return self._once("centre_error", self._centre_error)[0]

    def _centre_error_y_px(self) -> Any:
        return self._once("centre_error", self._centre_error)[1]

    def _centre_error_px(self) -> Any:
        return np.hypot(*self._once("centre_error", self._centre_error))

    def _depth_error_mm(self) -> Any:
        slope = epi_slope_seen(self.camera, self.scene, self.belief.lattice)
        return believed_depth(self.belief, self.question.design, slope) - self.scene.distance


def _spread(values: Sequence[Any], shape: tuple[int, int]) -> Array:
    return np.stack([np.broadcast_to(value, shape) for value in values], axis=-1)
