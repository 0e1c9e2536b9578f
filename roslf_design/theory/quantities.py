"""Every number of a camera, once: name, unit, words, equation and function.

`roslf evaluate`, the metrics of tolerance studies, the goals and limits of the optimiser, the explorer, the report and
the documentation's tables all read `QUANTITIES`. A new number is one more entry here (or `register`), and every command
knows it.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from .._arrays import Array, product, ratio
from ..bore.chain import ImagedPlane
from ..camera import Camera, Number
from ..design.parts import PATHS
from ..units import read_quantity
from . import (
    chief_rays,
    depth_of_field,
    exit_pupil,
    f_number,
    field_of_view,
    light,
    light_field,
    photometry,
    resolution,
    tube,
    vignetting,
)
from .disparity_error import Seen, axial_disparity_sigma, disparity_sigma
from .light import SensorField
from .stop_images import MicrolensImages

Depth = float | None
"""Distance ahead of the bore's tip at which a number is asked for [mm]; None is the focal plane."""


@dataclass(frozen=True)
class Quantity:
    """A number of a camera."""

    name: str
    unit: str
    words: str
    """Description in a line."""
    of: Callable[[Camera, Depth], Array] | None = None
    """Function of straight cameras (tilts left out), at a distance where `at` allows one: shape of the builds, or (K,
    ...) where `worst` is set. None: it exists only per field."""
    local: Callable[[MicrolensImages], Number] | None = None
    """At the fields of misaligned builds, shape (fields, builds); None: the camera has it only as a whole."""
    equation: str = ""
    """In the paper."""
    positive: bool = True
    """Whether every camera that can be built has it above zero: then ratios count, not differences."""
    at: Literal["never", "optional", "needed"] = "never"
    """Whether it is asked for at a distance."""
    worst: Callable[[Array], Array] | None = None
    """Function that takes the value that counts out of several (one a rim)."""
    monotone: bool = True
    """Whether `of` rises or falls in each single design length throughout, also beyond d_3 = d_f, the others held, f
    excepted where `bent_in_f`: its extremes over a box then lie at corners."""
    monotone_with: str = ""
    """A place of a design: where something stands there the quantity is monotone all the same."""
    numeric: bool = False
    """Whether it is summed or tabulated, and so has no derivative by complex numbers."""
    bent_in_f: bool = False
    traced: bool = False
    """Whether chief rays are traced for it where something stands before the main lens: it then neither has derivatives
    by complex numbers nor its extremes at corners."""
    signed: Callable[[Camera, Depth], Array] | None = None
    """Function for the signed value of a quantity that is a magnitude."""
    infinite: bool = False
    """Whether it is infinite for cameras that can be built: builds are then told apart by its `finite` twin."""
    past_infinity: Callable[[Camera, Depth], Array] | None = None
    """Function for -1 over a quantity that may be infinite and is above 0, going on above 0 where it has gone past
    infinity. Smooth, so that an optimiser finds its way into and out of infinity."""
    over: Callable[[Camera, Depth, SensorField], Array] | None = None
    """Function of a given rectangle of the array, for a quantity that depends on how much of it the sensor sees.
    `monotone` is then about this function, and the rectangle's ends are further lengths in which it rises or falls."""

    def __call__(self, camera: Camera, at: Depth = None) -> Array:
        """Its value for every build; of several values the one that counts; NaN behind the tip, where nothing can be.

        Raises
        ------
        ValueError
            It exists only per field.
        """
        if self.of is None:
            raise ValueError(f"{self.name} belongs to a field; take it from MicrolensImages")
        behind = np.asarray(np.less(0.0 if at is None or self.at == "never" else at, 0))
        if np.all(behind):
            return np.full(np.broadcast_shapes(camera.shape, behind.shape), np.nan)
        values = self.of(camera, at)
        values = values if self.worst is None else self.worst(values)
        return np.where(behind, np.nan, values) if np.any(behind) else values

    def at_fields(self, images: MicrolensImages) -> Number:
        """Its values at the fields of builds, shape (fields, builds).

        Raises
        ------
        ValueError
            It belongs to the whole camera.
        """
        if self.local is None:
            raise ValueError(f"{self.name} belongs to a whole camera")
        return self.local(images)

    @property
    def analytic(self) -> bool:
        """Whether complex numbers in a camera give its derivatives: no absolute value, no worst of several."""
        closed = self.signed is None and self.worst is None and not self.numeric
        return self.of is not None and closed and self.at != "needed"

    @property
    def length(self) -> bool:
        """Whether limits are lengths."""
        return self.unit == "mm"

    def limit(self, value: Any, *, from_file: bool = True) -> float:
        """A limit on it as a study writes it: a length with its unit, or a number in the unit that its name tells.

        Raises
        ------
        ValueError
            Neither; a number where nothing tells the unit.
        """
        if self.length:
            in_name = self.name.endswith("_mm")
            return read_quantity(value, "length", unit_required=from_file and not in_name)
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            unit = f" (in {self.unit})" if self.unit else ""
            raise ValueError(f"{self.name} is limited by a number{unit}, got {value!r}")
        return float(value)


def finite(values: Array | float) -> Array:
    """Finite twin of what may be infinite: itself less 2 up to 1, -1 over it beyond; it rises where that rises."""
    values = np.asarray(values, float)
    return np.where(values < 1, values - 2, -1 / np.where(values < 1, 1.0, values))


def from_finite(twins: Array | float) -> Array:
    """Values of which these are the finite twins."""
    twins = np.asarray(twins, float)
    with np.errstate(divide="ignore"):
        beyond = np.where(twins < 0, -1 / np.where(twins < 0, twins, -1.0), np.inf)
    return np.where(np.isnan(twins), np.nan, np.where(twins < -1, twins + 2, beyond))


QUANTITIES: dict[str, Quantity] = {}
"""Every quantity by its name; the paper's symbols too."""


def register(*quantities: Quantity) -> None:
    """Add quantities, each under its name.

    Raises
    ------
    ValueError
        A name is taken.
    """
    for quantity in quantities:
        if quantity.name in QUANTITIES:
            raise ValueError(f"there is a quantity '{quantity.name}' already")
        QUANTITIES[quantity.name] = quantity


def quantity_named(name: str) -> Quantity:
    """Find a quantity.

    Raises
    ------
    ValueError
        Not known; names the nearest.
    """
    if name in QUANTITIES:
        return QUANTITIES[name]
    lowered = {known.lower(): known for known in QUANTITIES}
    near = difflib.get_close_matches(name.lower(), lowered, 1, 0.4)
    known = ", ".join(key for key in QUANTITIES if key not in PATHS)
    remedy = f"did you mean '{lowered[near[0]]}'?" if near else f"known are {known}, and the symbols {', '.join(PATHS)}"
    raise ValueError(f"'{name}' is no quantity of a design; {remedy}")


def depth_at(c: Camera, at: Depth | Array) -> Array:
    """Z_F of a point `at` [mm] ahead of the bore's tip, or of the focal plane, as the main lens sees it [mm]."""
    return c.seen.gap if at is None else np.asarray(_plane_at(c, at).distance - c.seen.d_3)


def _plane_at(c: Camera, at: Depth | Array) -> ImagedPlane:
    return c.focus if at is None else c.plane(at + c.tip)


def seen_at(c: Camera, at: Depth | Array) -> Seen:
    """A plane `at` [mm] ahead of the bore's tip, or the focal plane."""
    focus = np.zeros(()) if at is None else light_field.rim_disparity(c, depth_at(c, at))
    return Seen(focus, light.object_scale(c, at))


def depth_error(c: Camera, at: Depth | Array, sigma: Number | None = None) -> Array:
    """Standard error of depth on the axis, `at` [mm] ahead of the bore's tip or at the focal plane [mm].

    The disparity's, which takes milliseconds to predict, may be given [microlens pitches].
    """
    sigma = axial_disparity_sigma(c, seen_at(c, at)) if sigma is None else np.asarray(sigma)
    return light_field.depth_sigma(c, depth_at(c, at), sigma) * _plane_at(c, at).depth


def _local_depth_sigma(images: MicrolensImages) -> Number:
    c = images.camera
    sigma = light_field.depth_sigma(c, c.seen.gap, disparity_sigma(images, seen_at(c, None))) * c.focus.depth
    if c.law is None:
        return sigma
    # Views set apart along the field's radius and across it tell of depth as much less as a mapping stretches slopes.
    p = light.outer_slope(c, np.hypot(images.microlens[0], images.microlens[1]))
    depth_kept = c.stretch_along(p) ** -2.0 + c.stretch(p) ** -2.0
    return sigma * np.sqrt(2 / depth_kept)


def _whole(form: Callable[[Camera], Number]) -> Callable[[Camera, Depth], Array]:
    return lambda c, _: np.asarray(form(c))


def _over_field(form: Callable[[Camera, Depth, SensorField], Array]) -> dict[str, Any]:
    """`Quantity.of` and `Quantity.over` of what hangs on how much of the array the sensor sees."""
    return {"of": lambda c, at: form(c, at, light.sensor_field(c)), "over": form}


def _half_field(way: Literal["width", "height", "diagonal"]) -> Callable[[Camera, Depth, SensorField], Array]:
    """Half of what the sensor sees of a plane, over its width, height or diagonal."""

    def of(c: Camera, at: Depth, field: SensorField) -> Array:
        if not chief_rays.traced(c):
            half = field.half_diagonal if way == "diagonal" else field.half[way == "height"]
            return product(half, light.object_scale(c, at))
        return np.asarray(getattr(field_of_view.object_field(c, field, at), way) / 2)

    return of


def _half_angle(c: Camera, _: Depth, field: SensorField) -> Array:
    if not chief_rays.traced(c):
        return np.asarray(np.rad2deg(1.0) * light.field_angle(c, field.half[0]))
    return field_of_view.field_of_view(c, field).width / 2


def _least(values: Array) -> Array:
    return np.asarray(values.min(axis=0))


def _greatest(values: Array) -> Array:
    return np.asarray(values.max(axis=0))


def _defocus_px(c: Camera, _: Depth) -> Array:
    return c.d * light.microlens_defocus(c) / c.q


def _behind_lens(c: Camera) -> Number:
    return c[PATHS["d_1"]] + c[PATHS["d_2"]]


def _diameters(c: Camera, _: Depth) -> Array:
    places = [rim.diameter_place for rim in (c.fap, *c.rims)]
    return np.stack(np.broadcast_arrays(*(c[place] for place in places if place is not None)))


def _resolved(level: float) -> Callable[[Camera, Depth], Array]:
    def of(c: Camera, at: Depth) -> Array:
        on_array = resolution.axial_limit(c, image_rate(c, at), level)
        return ratio(on_array, light.object_scale(c, at))

    return of


def image_rate(c: Camera, at: Depth | Array) -> Array:
    """Way on the array per way on the sensor that a point `at` a distance moves from view to view."""
    if at is None:
        return np.zeros(c.shape)[()]
    return np.asarray(light_field.pupil_shear(c, depth_at(c, at)) * ratio(c.seen.A, c.seen.d_2))


def _angles(part: str, way: Literal["width", "height", "diagonal"]) -> tuple[Quantity, Quantity]:
    """Angle of view from the entrance pupil, and from the tip."""

    def from_pupil(c: Camera, _: Depth, field: SensorField) -> Array:
        return np.asarray(getattr(field_of_view.field_of_view(c, field), way))

    def from_tip(c: Camera, at: Depth, field: SensorField) -> Array:
        return np.asarray(getattr(field_of_view.tip_field_of_view(c, field, at), way))

    words, name = f"full angle of view over the field's {way}", f"field_of_view_{part}deg"
    more: dict[str, Any] = {"positive": False, "monotone": False, "numeric": True}
    pupil = f"{words}, from the entrance pupil, in the medium of the scene"
    tip = f"{words}, from the tip, at a distance ahead of it or at the focal plane"
    return (
        Quantity(name, "deg", pupil, **_over_field(from_pupil), **more),
        Quantity(f"tip_{name}", "deg", tip, **_over_field(from_tip), **more, at="optional"),
    )


def _sharpness(prefix: str, kind: depth_of_field.Kind, image: str) -> tuple[Quantity, ...]:
    """Depth of field of an image, and its hyperfocal distance."""

    def ends(k: int) -> Callable[[Camera, Depth], Array]:
        return lambda c, _: depth_of_field.depth_of_field(c, kind)[k]

    beyond: dict[str, Any] = {"infinite": True, "past_infinity": lambda c, _: depth_of_field.past_infinity(c, kind)}
    sharp = f"end of the depth of field of {image}, ahead of the tip: a point spreads over one microlens pitch"
    far = f"nearest focal plane ahead of the tip with which {image} is sharp to infinity"
    more: dict[str, Any] = {"monotone": False, "numeric": True}
    return (
        Quantity(f"{prefix}depth_of_field_near_mm", "mm", f"near {sharp}", ends(0), positive=False, **more),
        Quantity(f"{prefix}depth_of_field_far_mm", "mm", f"far {sharp}", ends(1), positive=False, **more, **beyond),
        Quantity(
            f"{prefix}hyperfocal_mm",
            "mm",
            far,
            lambda c, _: depth_of_field.hyperfocal(c, kind),
            positive=False,
            **more,
        ),
    )


def _centre_shift(images: MicrolensImages) -> Number:
    """Chief ray's image against that through the lens's centre, along the field [px]."""
    camera, radius = images.camera, np.hypot(images.x, images.y)
    off = radius > 0
    cos = np.where(off, images.x / np.where(off, radius, 1), 1.0)
    sin = np.where(off, images.y / np.where(off, radius, 1), 0.0)
    x0, y0 = images.chief
    x1, y1 = images.through_lens
    return ((x1 - x0) * cos + (y1 - y0) * sin) / camera.q


def _axis_ratio(images: MicrolensImages) -> Number:
    return np.where(images.shapes.lit, images.shapes.axis_ratio, np.nan)


register(
    Quantity(
        "fill_factor",
        "",
        "microlens-image diameter over pitch: 1 where images just touch",
        _whole(f_number.fill_factor),
        lambda images: images.diameter / images.pitch,
        equation="Eq. 7",
    ),
    Quantity(
        "mismatch_px",
        "px",
        "microlens-image diameter less pitch: overlap above 0, gap below",
        _whole(f_number.mismatch_px),
        lambda images: (images.diameter - images.pitch) / images.camera.q,
        positive=False,
        monotone=False,
    ),
    Quantity(
        "image_diameter_mm",
        "mm",
        "diameter of the disc as large as the uncut microlens image",
        _whole(exit_pupil.microlens_image_diameter),
        lambda images: images.diameter,
    ),
    Quantity(
        "image_diameter_px",
        "px",
        "the same in pixels: geometric views",
        _whole(light.geometric_views),
        lambda images: images.diameter / images.camera.q,
    ),
    Quantity(
        "image_pitch_mm",
        "mm",
        "distance between neighbouring microlens images, below 0 where their order is reversed",
        _whole(exit_pupil.microlens_image_pitch),
        lambda images: images.pitch,
        positive=False,
        monotone=False,
    ),
    Quantity(
        "non_distortion_room_mm",
        "mm",
        "room between the pencil and the nearest rim, below 0 where it is cut; in `optimize` at the field's corner",
        **_over_field(lambda c, _, field: vignetting.corner_room(c, field)),
        local=lambda images: images.room,
        equation="Eqs. 5-6",
        positive=False,
        worst=_least,
    ),
    Quantity(
        "undistorted_field_mm",
        "mm",
        "largest undistorted object radius at the focal plane, in the worst direction: of a traced chief ray, "
        "what rims cut to first order; infinite where any field is",
        lambda c, _: vignetting.on_focal_plane(c, vignetting.undistorted_radii(c)),
        equation="Eq. 6",
        positive=False,
        worst=_least,
        monotone=False,
        infinite=True,
    ),
    Quantity(
        "centre_shift_px",
        "px",
        "how far the image centre lies inside that through the lens's centre",
        None,
        _centre_shift,
        equation="Eq. 4",
    ),
    Quantity(
        "centre_shift_px_per_microlens",
        "px",
        "the same per microlens off axis",
        _whole(exit_pupil.centre_shift_per_microlens),
        equation="Eq. 4",
        positive=False,
    ),
    Quantity(
        "kept_fraction",
        "",
        "area of the microlens image over that of the uncut FAP",
        None,
        lambda images: images.shapes.kept_fraction,
    ),
    Quantity("image_area_mm2", "mm^2", "area of the microlens image", None, lambda images: images.shapes.area),
    Quantity(
        "axis_ratio",
        "",
        "minor over major axis of the microlens image's second moments; undefined where dark",
        None,
        _axis_ratio,
    ),
    Quantity(
        "field_half_width_mm",
        "mm",
        "half the width that the sensor sees, at a distance ahead of the tip or at the focal plane, of traced chief "
        "rays",
        **_over_field(_half_field("width")),
        at="optional",
        traced=True,
    ),
    Quantity(
        "field_half_diagonal_mm",
        "mm",
        "the same to the corner",
        **_over_field(_half_field("diagonal")),
        at="optional",
        traced=True,
    ),
    Quantity(
        "field_half_angle_deg",
        "deg",
        "half the angle of view along the width, from the entrance pupil, in the medium of the scene",
        **_over_field(_half_angle),
        monotone=False,
        traced=True,
    ),
    Quantity(
        "field_half_height_mm",
        "mm",
        "half the height that the sensor sees, at a distance ahead of the tip or at the focal plane",
        **_over_field(_half_field("height")),
        at="optional",
        traced=True,
    ),
    *_angles("width_", "width"),
    *_angles("height_", "height"),
    *_angles("", "diagonal"),
    Quantity(
        "direction_of_view_deg",
        "deg",
        "angle between the tube's axis and the chief ray of the field's middle",
        **_over_field(lambda c, _, field: field_of_view.direction_of_view(c, field)),
        positive=False,
        monotone=False,
        numeric=True,
    ),
    Quantity(
        "distortion_percent",
        "%",
        "image height against that of a flat object drawn without distortion, of traced chief rays; below 0 is "
        "barrel-shaped",
        None,
        lambda images: 100 * (ratio(1.0, np.asarray(images.stretch[1], float)) - 1),
        positive=False,
    ),
    Quantity(
        "local_magnification",
        "",
        "millimetres on the array per millimetre at the focal plane, along the field's radius",
        None,
        lambda images: ratio(1.0, light.object_scale(images.camera) * np.asarray(images.stretch[0], float)),
    ),
    Quantity(
        "relative_illumination",
        "",
        "light of a microlens against an uncut one on the axis: what stops leave, times cos^4 or what a mapping says, "
        "through elements to first order; traced behind a real lens",
        None,
        lambda images: images.illumination,
    ),
    Quantity(
        "object_magnification",
        "",
        "millimetres on the array per millimetre on a plane at a distance ahead of the tip, or the focal plane",
        lambda c, at: ratio(1.0, light.object_scale(c, at)),
        at="optional",
        monotone=False,
    ),
    Quantity(
        "mtf50_lp_per_mm",
        "lp/mm",
        "detail of which the refocused image shows half the contrast, on the axis, at a distance ahead of the tip or "
        "at the focal plane",
        _resolved(0.5),
        at="optional",
        monotone=False,
        numeric=True,
    ),
    Quantity(
        "mtf10_lp_per_mm",
        "lp/mm",
        "the same of a tenth of the contrast",
        _resolved(0.1),
        at="optional",
        monotone=False,
        numeric=True,
    ),
    Quantity(
        "fold_lp_per_mm",
        "lp/mm",
        "detail beyond which sampling once a microlens folds it back",
        lambda c, at: ratio(resolution.fold(c), light.object_scale(c, at)),
        at="optional",
        monotone=False,
    ),
    *_sharpness("", "refocused", "the image"),
    *_sharpness("view_", "view", "a single view"),
    Quantity(
        "object_sample_mm",
        "mm",
        "footprint of one microlens, at a distance ahead of the tip or at the focal plane",
        lambda c, at: product(c.d, light.object_scale(c, at)),
        at="optional",
    ),
    Quantity(
        "disparity_pitches_per_mm",
        "pitches/mm",
        "disparity between the FAP's rims per depth, at a distance ahead of the tip or at the focal plane",
        lambda c, at: light_field.disparity_rate(c, depth_at(c, at)) / _plane_at(c, at).depth,
        at="optional",
        monotone=False,
    ),
    Quantity(
        "sigma_z_mm",
        "mm",
        "standard error of depth, at a distance ahead of the tip or at the focal plane: of light, noise and texture, "
        "or of a given disparity error",
        depth_error,
        at="optional",
        monotone=False,
        monotone_with="depth.disparity_error",
        numeric=True,
    ),
    Quantity(
        "sigma_disparity_pitches",
        "pitches",
        "standard error of the disparity between the FAP's rims, at a distance ahead of the tip or at the focal plane",
        lambda c, at: axial_disparity_sigma(c, seen_at(c, at)),
        at="optional",
        monotone=False,
        monotone_with="depth.disparity_error",
        numeric=True,
    ),
    Quantity(
        "sigma_z_at_field_mm",
        "mm",
        "standard error of depth at the focal plane, as the field's own microlens image is cut; through windows to "
        "first order",
        None,
        _local_depth_sigma,
        numeric=True,
    ),
    Quantity(
        "pixel_electrons",
        "e-",
        "electrons in a pixel that its microlens lights fully, where the scene is as bright as on average",
        _whole(photometry.electrons),
        monotone=False,
    ),
    Quantity(
        "sensor_angle_deg",
        "deg",
        "angle to the sensor's normal of the steepest ray through a microlens's middle, at the field's corner",
        **_over_field(lambda c, _, field: np.rad2deg(np.arctan(photometry.sensor_slope(c, field.radius)))),
        monotone=False,
        numeric=True,
    ),
    Quantity(
        "blur_pitches",
        "pitches",
        "spread over the array of a point at a distance ahead of the tip",
        lambda c, at: np.abs(light_field.rim_disparity(c, depth_at(c, at))),
        positive=False,
        at="needed",
        signed=lambda c, at: light_field.rim_disparity(c, depth_at(c, at)),
    ),
    Quantity(
        "spot_pitches",
        "pitches",
        "rms radius on the array of the light of the point in focus that the chief ray comes from; of rays alone, none "
        "behind an ideal lens",
        None,
        lambda images: images.spot_pitches,
        positive=False,
    ),
    Quantity(
        "lateral_samples",
        "",
        "microlenses across the width that the sensor sees",
        **_over_field(lambda c, _, field: ratio(2 * field.half[0], c.d)),
    ),
    Quantity("views_geometric", "", "pixels across a microlens image", _whole(light.geometric_views)),
    Quantity("views_independent", "", "4 N_F: views per axis that diffraction leaves", _whole(light.independent_views)),
    Quantity("fresnel_number", "", "N_F = d^2/(4 lambda d_2)", _whole(light.fresnel_number)),
    Quantity("airy_radius_px", "px", "1.22 lambda d_2/d on the sensor", lambda c, _: light.airy_radius(c) / c.q),
    Quantity(
        "view_baseline_mm",
        "mm",
        "distance on the FAP between neighbouring pixels' views, q d_1/(H d_2)",
        _whole(light.view_baseline),
        equation="Eq. 2",
    ),
    Quantity(
        "light_sr",
        "sr",
        "solid angle of the pupil seen from the array, pi/4 (D_F/A)^2: the light a pixel gets",
        _whole(light.solid_angle),
    ),
    Quantity("f_number_microlens", "", "working f-number of a microlens, d_2/d", _whole(f_number.microlens_f_number)),
    Quantity(
        "f_number_microlens_lens",
        "",
        "a microlens's own f-number, f_ml/d",
        lambda c, _: np.asarray(c.f_ml / c.d),
        monotone=False,
    ),
    Quantity("f_number_pupil", "", "d_1/(D_F H)", _whole(f_number.pupil_f_number), equation="Eq. 8"),
    Quantity("f_number_main_lens", "", "d_1/D", _whole(f_number.main_lens_f_number), equation="Eq. 9"),
    Quantity("aperture_constant", "", "H", _whole(lambda c: c.seen.H), equation="Eq. 3", monotone=False),
    Quantity("inverse_aperture_constant", "", "1/H", _whole(lambda c: c.seen.inverse_H), equation="Eq. 3"),
    Quantity(
        "vergence_at_mla_per_mm",
        "1/mm",
        "1/L of the exit pupil: 0 where telecentric",
        _whole(lambda c: c.seen.vergence),
        positive=False,
        bent_in_f=True,
    ),
    Quantity(
        "telecentric_offset_mm",
        "mm",
        "d_3 - f: 0 where telecentric",
        _whole(lambda c: c.seen.d_3 - c.f),
        positive=False,
    ),
    Quantity(
        "microlens_defocus_px",
        "px",
        "ray blur of microlens defocus, d d_2 |1/f_ml - 1/d_2 - 1/L|",
        lambda c, at: np.abs(_defocus_px(c, at)),
        positive=False,
        bent_in_f=True,
        signed=_defocus_px,
    ),
    Quantity("magnification", "", "m = d_1/d_f", _whole(lambda c: c.seen.m)),
    Quantity(
        "working_distance_mm",
        "mm",
        "from the bore's tip to the focal plane",
        _whole(lambda c: c[PATHS["d_f"]] - c.tip),
        positive=False,
    ),
    Quantity(
        "total_length_mm",
        "mm",
        "from the bore's tip to the sensor",
        _whole(lambda c: c.tip + _behind_lens(c)),
    ),
    Quantity(
        "camera_length_mm",
        "mm",
        "from the main lens to the sensor",
        _whole(_behind_lens),
    ),
    Quantity(
        "largest_diameter_mm",
        "mm",
        "the widest of lens, FAP and stops",
        _diameters,
        worst=_greatest,
    ),
    Quantity(
        "outer_diameter_mm",
        "mm",
        "of the narrowest tube about all that lies in it: lens, FAP, stops, elements, array and sensor by its diagonal",
        lambda c, _: tube.outer_diameters(c),
        worst=_greatest,
        monotone=False,
    ),
    # d_3 alone may be 0.
    *(
        Quantity(
            symbol,
            "mm",
            f"the design's {place}",
            _whole(lambda c, symbol=symbol, place=place: c.q if symbol == "q" else c[place]),  # type: ignore[misc]
            positive=symbol != "d_3",
        )
        for symbol, place in PATHS.items()
    ),
)
