"""Specification of a camera on its data sheet, in the terms of the endoscope standards (ISO 8600)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np

from .._arrays import Array
from ..camera import Camera
from ..design import Design
from ..design.parts import Light
from ..design.required import ROUND_ANGLE, ROUND_RADIUS, Required
from ..distances import Distance, check_distances
from ..errors import InputError, Problem
from ..fates import ImageFate
from ..json_data import plain
from ..progress import UNHEARD, Share
from ..shapes.lattice import PACKINGS
from ..tables import BriefValue
from ..theory import field_of_view, light, tube
from ..theory.colours import ColourFilter, filters
from ..theory.depth_error import depth_error, seen_at
from ..theory.depth_of_field import Kind, depth_of_field
from ..theory.disparity_error import full_within, view_gradient
from ..theory.focused import FocusedArray, has_views
from ..theory.light import on_array
from ..theory.limits import as_design
from ..theory.photometry import electrons, exposure, through_filter
from ..theory.quantities import QUANTITIES
from ..theory.quantity import Quantity, Way
from ..theory.resolution import Direction
from ..theory.stop_images import MicrolensImages
from ..theory.vignetting import field_limit, lit_pairs, lit_radius
from ..traced.fields import DesignImages, IdealImages, images_of
from ..traced.images import measured_bound
from ..words import clauses, listed, number, the
from .fields import default_fields, judged_field, lit_share, place_off_axis, round_radius
from .groups import DepthAssumptions
from .working_range import BudgetAt, WorkingRange

Place = tuple[float, float]

CRITERION = "a point spreads over one microlens pitch, by rays"
AT_TIP = 0.01
"""Share of the focal plane's distance: what begins nearer counts as beginning at the tip."""
BEYOND = 2.0
"""Where the working range has no end, the data sheet's farthest plane, in distances of the focal plane."""
LEVELS = (0.5, 0.1)
DEEP = 3.0
"""Far end of a working range over the near one from which light that does not fall with distance is doubted."""
CORNER, RIM, DARK_CORNER = "corner of the field", "rim of the round field", "corner of the sensor"
"""Where a field ends: the corner of what the sensor sees, or of a round field that is required its rim.

Where light ends before, the field ends there, and that corner is the sensor's alone."""
PAST = 1.002
"""Share of the way to where light ends, by search, at which it surely has."""
ROUND_TO = 1.005
"""Diagonal over the shorter side up to which a field is round, for a search of where light ends."""
ROUND = 16
"""Places on the rim of a round field that are looked at."""
WAYS: tuple[Direction, Direction] = ("tangential", "sagittal")
FOCUS, ASKED = "focal plane", "asked for"
Station = tuple[str, float]
"""Name of a plane, and its distance ahead of the tip [mm]."""


@dataclass(frozen=True)
class FieldOfView:
    """Full angles between the field's ends [degrees]."""

    from_: Literal["entrance pupil", "distal tip"]
    """Which it is measured from: ISO 8600-3, method B, or the middle of the tip."""
    width: float
    height: float
    diagonal: float
    at_mm: float | None
    """Plane on which the tip sees the field; angles from the entrance pupil are the same on all."""

    @classmethod
    def of(cls, ends: MicrolensImages, at: float | None) -> FieldOfView:
        """Angles from the entrance pupil, or under which the tip sees a plane [mm ahead of it]."""
        names = [f"{'' if at is None else 'tip_'}field_of_view_{part}deg" for part in ("width_", "height_", "")]
        ways = ends.directions if at is None else np.stack(np.broadcast_arrays(*ends.on_plane(at), at), axis=-1)
        angles = _across(ways, field_of_view.between, lambda k: _over_sensor(names[k], ends.camera, at))
        return cls("entrance pupil" if at is None else "distal tip", *angles, at)


@dataclass(frozen=True)
class ObjectField:
    """Field on a plane ahead of the tip."""

    at_mm: float
    plane: str
    """Which plane it is, as "far end" of the working range."""
    width_mm: float
    height_mm: float
    diagonal_mm: float
    magnification: float
    """Array over object."""
    object_sample_mm: float
    """Footprint of a microlens."""

    @classmethod
    def of(cls, ends: MicrolensImages, at: float, plane: str) -> ObjectField:
        """Field that is seen between the field's ends."""
        camera = ends.camera
        halves = [f"field_half_{side}_mm" for side in ("width", "height", "diagonal")]
        magnification, sample = (float(QUANTITIES[n](camera, at)) for n in ("object_magnification", "object_sample_mm"))
        met = np.stack(ends.on_plane(at), axis=-1)
        sides = _across(
            met, lambda a, b: np.linalg.norm(a - b, axis=-1), lambda k: 2 * _over_sensor(halves[k], camera, at)
        )
        return cls(at, plane, *sides, magnification, sample)


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


@dataclass(frozen=True)
class _SharpEnds:
    """Near and far end ahead of the tip [mm]; an infinite far end is None in JSON."""

    view: tuple[float, float]
    refocused: tuple[float, float]
    criterion: str = CRITERION

    @classmethod
    def of(cls, camera: Camera) -> _SharpEnds:
        """Depth of field of a camera, of one view and refocused."""
        return cls(_sharp(camera, "view"), _sharp(camera, "refocused"))


@dataclass(frozen=True)
class _FieldPoint:
    """Field point on the focal plane."""

    x_ml_mm: Place
    x0_mm: float | None
    """From the axis to where its chief ray meets the plane; None, as what follows, where a real lens loses that ray."""
    angle_deg: float | None
    """Angle of the chief ray to the axis, in the medium of the scene."""
    distortion_percent: float | None
    local_magnification: float | None
    """Array over object, along the field's radius."""
    relative_illumination: float

    @classmethod
    def of(cls, images: MicrolensImages, focus: float) -> tuple[_FieldPoint, ...]:
        """Each of the fields, on the focal plane so far ahead of the tip [mm]."""
        shape = len(images.fields), 1
        names = ("distortion_percent", "local_magnification", "relative_illumination")
        local = [np.broadcast_to(QUANTITIES[name].at_fields(images), shape)[:, 0].tolist() for name in names]
        met = np.broadcast_to(np.hypot(*images.on_plane(focus)), shape)[:, 0]
        ways = np.broadcast_to(images.directions, (*shape, 3))[:, 0]
        angles = np.rad2deg(np.arctan2(np.hypot(ways[:, 0], ways[:, 1]), ways[:, 2]))
        rows = zip(images.fields.tolist(), met.tolist(), angles.tolist(), *local, strict=True)
        return tuple(
            cls((at[0], at[1]), _known(x0), _known(angle), _known(bent), _known(along), light)
            for at, x0, angle, bent, along, light in rows
        )


@dataclass(frozen=True, eq=False)
class FieldImages:
    """Images of a design that first answer and data sheet are read from."""

    design: Design
    images: IdealImages | DesignImages
    """At the middle, the edge and the corner of what the sensor sees."""
    seen: IdealImages | DesignImages
    """At the ends of what it sees over width, height and both diagonals, two and two."""

    @classmethod
    def of(cls, design: Design) -> FieldImages:
        """Images of a design, tilts left out."""
        images = images_of(design, default_fields(design))
        corners = np.array(field_of_view.ends(light.sensor_field(images.camera)), float).reshape(8, 2)
        return cls(design, images, images_of(design, on_array(images.camera, corners)))

    @cached_property
    def ends(self) -> IdealImages | DesignImages:
        """Images at the ends of the field: where light ends, if it does within what the sensor sees."""
        corners = np.array(field_of_view.ends(light.sensor_field(self.images.camera)), float).reshape(8, 2)
        shares = self._lit(corners)
        if np.all(shares == 1):
            return self.seen
        return images_of(self.design, on_array(self.images.camera, shares[:, np.newaxis] * corners))

    @cached_property
    def points(self) -> tuple[_FieldPoint, ...]:
        """The fields on the focal plane."""
        return _FieldPoint.of(self.images, self._plane(None))

    @property
    def farthest(self) -> int:
        """Which of the images is farthest out on the focal plane: the corner's."""
        return self.points.index(corner(self.points))

    @property
    def shown_last(self) -> _FieldPoint:
        """The farthest of the fields that gets light and is imaged once; the middle where none else does."""
        fates = [0] * len(self.points) if isinstance(self.images, IdealImages) else self.images.traced.status.tolist()
        pairs = zip(self.points, fates, strict=True)
        seen = [at for at, fate in pairs if at.relative_illumination > 0 and fate != ImageFate.FOLDED]
        return corner(seen or self.points[:1])

    def outer_detail(self, at: float | None) -> float:
        """Usable detail of a refocused image at the farthest of the fields, on a plane [lp/mm]; 0 of none."""
        return resolved(self.images, self.farthest, (ASKED, self._plane(at)), "refocused").usable_lp_per_mm or 0.0

    @cached_property
    def freed(self) -> str:
        """Remedy of the images at the farthest of the fields, with the openings that cut them by name."""
        cuts = field_limit(self.images.camera, judged_field(self.design)).cuts
        names = dict.fromkeys(cut["rim"].partition(",")[0] for cut in cuts)  # of either face of an element
        return f"free the images from {listed([the(name) for name in names]) if names else 'what cuts them'}"

    @cached_property
    def outermost(self) -> str:
        """Place that is farthest out in the field, in words."""
        if round_radius(self.design) is not None:
            return RIM
        return CORNER if self.ends is self.seen else DARK_CORNER

    def in_words(self, place: str) -> str:
        """Place off the axis in words, the "edge" and the "corner" of the field too."""
        if place == "edge":
            return "in the field's edge"
        if place != "corner":
            return place
        return "in the field's corner" if self.outermost == CORNER else f"at the {self.outermost}"

    @cached_property
    def rim(self) -> Array:
        """Microlenses on the rim of the round field that the design requires, all round, on the array [mm]."""
        turn = np.linspace(0.0, 2 * np.pi, ROUND, endpoint=False)
        circle = (round_radius(self.design) or 0.0) * np.column_stack([np.cos(turn), np.sin(turn)])
        return on_array(self.images.camera, circle)

    def sees_to(self, asked: Required) -> float:
        """Angle [deg] to the axis, or distance from it on a plane [mm], that the sensor sees; NaN where all is lost."""
        ends = images_of(self.design, self.seen.fields[4:])
        ways = np.rad2deg(field_of_view.off_axis(ends.directions))
        met = np.hypot(*ends.on_plane(self._plane(asked.at)))
        return float(np.nanmax(ways if asked.object_height is None else met, initial=-math.inf))

    def off_axis(self, asked: Required) -> tuple[IdealImages | DesignImages, int] | None:
        """Images, and which of them sees the place off the axis that is asked for; None where the sensor sees none."""
        if asked.field is not None:
            corner = 2 if self.outermost == RIM else self.farthest  # of a rim all are as far
            return self.images, corner if asked.field == "corner" else 1
        place = place_off_axis(self.design, asked)
        return None if place is None else (images_of(self.design, [place]), 0)

    def detail_at(self, seen: tuple[IdealImages | DesignImages, int], at: float | None) -> Resolved:
        """Detail that the refocused image shows there of a plane."""
        return resolved(*seen, (ASKED, self._plane(at)), "refocused")

    @cached_property
    def _lit_to(self) -> Array:
        """Share of the way to each of the sensor's nearest sides, left, right, below and above, that gets light."""
        return self._lit(field_of_view.feet(light.sensor_field(self.images.camera)))

    def _lit(self, ends: Any) -> Array:
        """Share of the ways from the axis to places on the array that gets light, 1 of all; (N,)."""
        if self.design.main_lens.kind.mounted:
            return lit_share(self.design, ends)
        radius = float(lit_radius(self.images.camera))
        away = np.hypot(*np.asarray(ends, float).T)
        return np.asarray(np.minimum(1.0, max(radius, 0.0) / np.maximum(away, 1e-300)))

    def light_end(self, quantity: Quantity) -> str:
        """Words on what ends a field before the sensor does, and the remedy; empty where nothing does."""
        camera = self.images.camera
        field = light.sensor_field(camera)
        if not quantity.lit:
            return ""
        if quantity.name in (ROUND_ANGLE, ROUND_RADIUS):
            feet = np.array(field_of_view.feet(field), float)
            nearest = int(np.argmin(self._lit_to * np.hypot(*feet.T)))
            ways, shares = feet[nearest : nearest + 1], self._lit_to[nearest : nearest + 1]
        else:
            ways = np.array(field_of_view.ends(field), float).reshape(8, 2)[ends_of(quantity)]
            shares = self._lit(ways)
        if np.all(shares == 1):
            return ""
        beyond = images_of(self.design, on_array(camera, np.minimum(1.0, PAST * shares)[:, np.newaxis] * ways))
        if np.any(np.isnan(beyond.directions)):
            return "the lens does not image a rim so wide: a better corrected or wider one, or a smaller field"
        pair = [rim.opening.partition(",")[0] for rim in min(lit_pairs(camera), key=lambda pair: float(pair[2]))[:2]]
        wider = [the(name) for name in dict.fromkeys(pair) if name != camera.fap.opening]
        both = listed([the(name) for name in pair])
        return f"{both} leave less than a third of the pencils there: widen {listed(wider)}"

    @cached_property
    def dark_beyond(self) -> FieldOfView | None:
        """Angles that the sensor would see, were it lit; None where it is."""
        return None if self.ends is self.seen else FieldOfView.of(self.seen, None)

    def round_field(self, at: float | None, *, angle: bool) -> float:
        """Full angle [deg] or radius [mm] of the largest round field, as `Rays` has it."""
        field = light.sensor_field(self.images.camera)
        places = self._lit_to[:, np.newaxis] * np.array(field_of_view.feet(field), float)
        seen = images_of(self.design, on_array(self.images.camera, places))
        if angle:
            off = np.rad2deg(2 * np.broadcast_to(field_of_view.off_axis(seen.directions), (4, 1)))
        else:
            off = np.broadcast_to(np.hypot(*seen.on_plane(self._plane(at))), (4, 1))
        return float(field_of_view.round_within(field, off[:, 0]))

    def _plane(self, at: float | None) -> float:
        """Distance of a plane ahead of the tip, or of the focal plane [mm]."""
        return float(field_of_view.focus_ahead(self.images.camera)) if at is None else at

    def angle(self, way: Way, at: float | None, *, from_tip: bool) -> float:
        """Angle of view, as `Rays` has it [deg]."""
        return float(getattr(FieldOfView.of(self.ends, self._plane(at) if from_tip else None), way))

    def half_field(self, way: Way, at: float | None) -> float:
        """Half a way across the field, as `Rays` has it [mm]."""
        return float(getattr(ObjectField.of(self.ends, self._plane(at), ASKED), f"{way}_mm")) / 2

    def undistorted(self) -> float:
        """Largest undistorted object radius, as `Rays` has it [mm]."""
        return measured_bound(self.design)[0]

    def detail(self, level: float, at: float | None) -> float:
        """Detail on the axis, as `Rays` has it [lp/mm]."""
        each_way = self.images.transfer(0, self._plane(at)).limits_each_way(LEVELS, "refocused")
        return float(np.min([limits[LEVELS.index(level)] for limits in each_way]))

    def usable(self, at: float | None) -> float:
        """Detail on the axis that shows as what it is, as `Rays` has it [lp/mm]."""
        transfer = self.images.transfer(0, self._plane(at))
        return min(self.detail(LEVELS[0], at), *map(transfer.fold, WAYS))

    def share(self, quantity: Quantity, at: float | None) -> float | None:
        """Value that rays tell over that of the thin-lens model; None of what they do not tell, or cannot."""
        told = self.told(quantity, at)
        share = math.nan if told is None else told / float(quantity(self.images.camera, at))
        return share if math.isfinite(share) and share > 0 else None

    def told(self, quantity: Quantity, at: float | None) -> float | None:
        """A quantity as rays through a real lens tell it, NaN where they show none; None of what they do not tell."""
        if quantity.of_rays is None or not self.design.main_lens.kind.mounted:
            return None
        return None if quantity.of_views and not has_views(self.images.camera) else quantity.of_rays(self, at)


def ends_of(quantity: Quantity) -> slice:
    """Ends over which a field's width, height or diagonal is told, of `FieldImages.ends`."""
    if "width" in quantity.name or "half_angle" in quantity.name:
        return slice(0, 2)
    return slice(2, 4) if "height" in quantity.name else slice(4, 8)


MOST_TRACED = 500
"""Designs that are traced for a sweep or a table; of more, which would take minutes, the thin-lens model tells."""


def rays_tell(
    design: Callable[[], Design],
    asked: Sequence[tuple[Quantity, float | None]],
    tell: Callable[[FieldImages, Quantity, float | None], float | None] = FieldImages.told,
) -> tuple[tuple[float | None, ...], tuple[Problem, ...]]:
    """Quantities of a design at distances as rays tell them; all NaN, and why, where it is none or they fail."""
    try:
        shown = FieldImages.of(design())
        return tuple(tell(shown, quantity, at) for quantity, at in asked), ()
    except InputError as error:  # a thin lens could be, but no real one
        return (math.nan,) * len(asked), error.problems


@dataclass(frozen=True)
class _DepthSpread:
    """Depth noise (bound) at one place."""

    at_mm: float
    plane: str
    x_ml_mm: Place
    sigma_z_mm: float
    """Infinite, None in JSON, where nothing tells of depth."""


@dataclass(frozen=True)
class _DepthPrecision:
    """Standard errors of depth, of one measurement, before errors of calibration."""

    spreads: tuple[_DepthSpread, ...]
    """On the axis at the ends of the working range and the focal plane; there at the field's edge and corner, too."""
    sigma_disparity_pitches: float
    """Disparity error at the focal plane, on the axis."""
    assumes: DepthAssumptions | None
    """Light, texture and matching; None where the design gives the disparity's error."""

    @classmethod
    def of(cls, design: Design, images: MicrolensImages, stations: Sequence[Station]) -> _DepthPrecision:
        """Precision at planes."""
        camera, (axis, *off) = images.camera, [(x, y) for x, y in images.fields.tolist()]
        rows = [
            _DepthSpread(at, plane, axis, float(QUANTITIES["sigma_z_mm"](camera, None if plane == FOCUS else at)))
            for plane, at in stations
        ]
        local = np.broadcast_to(QUANTITIES["sigma_z_at_field_mm"].at_fields(images), (1 + len(off), 1))[1:, 0].tolist()
        focus = dict(stations)[FOCUS]
        known = (sigma if math.isfinite(sigma) else math.inf for sigma in local)
        rows += [_DepthSpread(focus, FOCUS, at, sigma) for at, sigma in zip(off, known, strict=True)]
        error = float(QUANTITIES["sigma_disparity_pitches"](camera))
        return cls(tuple(rows), error, depth_assumptions(design, camera, error))


@dataclass(frozen=True)
class _ListedPart:
    """Something that the tube holds."""

    name: str
    diameter_mm: float
    """Diameter or diagonal, with twice its decentre."""


def view_fold(camera: Camera, one: ColourFilter, at: float | None = None) -> float:
    """Nyquist frequency [lp/mm] of a view in one colour: one pixel of each microlens, of which some have the colour."""
    return float(QUANTITIES["fold_lp_per_mm"](through_filter(camera, one), at)) * math.sqrt(one.share)


@dataclass(frozen=True)
class Colour:
    """The pixels of one colour, alone."""

    name: str
    wavelength_nm: float
    share: float
    """Share of all pixels."""
    spacing_px: float
    """To the nearest pixels of the colour: half a period of the finest detail of a microlens image that they tell."""
    views_across: float
    """Microlens image over spacing."""
    view_fold_lp_per_mm: float
    """At the focal plane, of a view: one pixel of each microlens, of which so many have this colour."""
    mtf50_lp_per_mm: float
    """Refocused, on the axis at the focal plane, at its wavelength."""
    electrons: float
    """In a fully lit pixel, where the scene is as bright as on average."""
    sigma_z_mm: float
    """Depth noise (bound) on the axis at the focal plane."""

    @classmethod
    def of(cls, camera: Camera, one: ColourFilter) -> Colour:
        """Pixels behind a filter."""
        own = through_filter(camera, one)
        names = ("image_diameter_px", "mtf50_lp_per_mm", "pixel_electrons", "sigma_disparity_pitches")
        across, sharp, charge, alone = (float(QUANTITIES[name](own)) for name in names)
        given = "depth.disparity_error" in camera.numbers  # whatever light, and however many pixels
        spread = float(depth_error(own, None, alone if given else alone / math.sqrt(one.share)))
        apart = one.spacing
        views = across / apart, view_fold(camera, one)
        return cls(one.name, 1e6 * one.wavelength, one.share, apart, *views, sharp, charge, spread)


@dataclass(frozen=True)
class Specification(BriefValue):
    """The data sheet's lines."""

    field_of_view_deg: tuple[FieldOfView, ...]
    direction_of_view_deg: float
    working_range_mm: tuple[float, float] | None
    """Range in which single views are sharp and depth is of use, ahead of the tip; None where there is none."""
    useful_to_mm: float | None
    """Farthest distance at which views are sharp and U is a tenth of it at most; None where there is none."""
    working_distance_mm: float
    """Distance from the tip to the focal plane."""
    hyperfocal_mm: float | None
    """Nearest focal plane with which the refocused image is sharp to infinity; None where none is."""
    view_hyperfocal_mm: float | None
    object_field: tuple[ObjectField, ...]
    depth_precision: _DepthPrecision
    resolution: tuple[Resolved, ...]
    depth_of_field_mm: _SharpEnds
    field: tuple[_FieldPoint, ...]
    distortion: float | None
    """Distortion at the farthest of the fields that is lit and imaged once [%]."""
    relative_illumination: float
    """Light at the farthest of the fields."""
    pixels: tuple[int, int]
    views_across: float
    independent_views_across: float
    object_samples: tuple[int, int]
    colours: tuple[Colour, ...]
    """Behind colour filters; empty without."""
    insertion_diameter_mm: float
    """Width of what is inserted (ISO 8600: maximum insertion portion width); without a tube, of all of the camera."""
    outer_diameter_mm: float
    length_mm: float
    """Tip to sensor."""
    parts: tuple[_ListedPart, ...]
    focused: FocusedArray | None = None
    """Focused microlenses, of which what is reported of views means nothing."""
    has_views: bool = True
    """Whether pixels are views."""

    def to_dict(self) -> dict[str, Any]:
        """As `specification` of `roslf evaluate --json`; what is infinite, or means nothing, is None."""
        data: dict[str, Any] = plain(self, undefined=False)
        del data["has_views"]
        if self.focused is None:
            del data["focused"]
        if self.has_views:
            return data
        views = (
            "view",
            "independent",
            "object_samples",
            "working_range",
            "useful_to",
            "hyperfocal",
            "depth",
            "resolution",
            "colours",
        )
        return data | dict.fromkeys(key for key in data if key.startswith(views))


def planes(camera: Camera, asked: Sequence[float] = (), within: WorkingRange | None = None) -> tuple[Station, ...]:
    """Near end of the working range, focal plane and far end, then the distances asked for [mm ahead of the tip].

    Where the range begins at the tip, half of the focal plane's distance stands for its near end; where views are sharp
    without end, and depth of use that far, `BEYOND` times that for the far one. Of no working range the ends are those
    at which views are sharp.
    """
    focus = float(field_of_view.focus_ahead(camera))
    within = WorkingRange.of(camera) if within is None else within
    near, far = within.ends or (within.near, within.sharp_to)
    first = ("near end", near) if near > AT_TIP * focus else ("half the focus", focus / 2)
    endless = math.isinf(within.sharp_to) and far > BEYOND * focus
    last = ("twice the focus", BEYOND * focus) if endless else ("far end", far)
    return (first, (FOCUS, focus), last, *((ASKED, at) for at in asked))


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
    return Resolved(at, plane, _known(float(x0)), place, image, half, tenth, each[0], each[1], fold, usable, limit)


def specification(
    design: Design | str | Path,
    at: Distance | Sequence[Distance] = (),
    shown: FieldImages | None = None,
    budget: BudgetAt | None = None,
    tell: Share = UNHEARD,
) -> Specification:
    """The data sheet of a design: of its straight parts, tilts left out.

    Behind a real main lens rays tell where fields lie, the rest is the thin lens's.
    Fields are the middle, the edge and the corner of what the sensor sees.

    Parameters
    ----------
    design : Design, str or Path
        A design, the name of a preset, or a design file.
    at : float or str, or a sequence of these
        Distances ahead of the tip [mm] that are told of beside the working range's ends and the focal plane.
    shown : FieldImages, optional
        Those of the design, where they are known.
    budget : callable, optional
        Budget of depth at distances ahead of the tip [mm], by which the working range ends; default: of the lengths as
        drawn.
    tell : callable, optional
        Hears what share of it is known, from 0 to 1.

    Raises
    ------
    InputError
        A distance that is none.

    Examples
    --------
    >>> import roslf_design as roslf
    >>> sheet = roslf.specification("paper")
    >>> [round(end, 1) for end in sheet.depth_of_field_mm.refocused]
    [218.2, 243.2]
    """
    at = check_distances(at)
    design = as_design(design)
    shown = FieldImages.of(design) if shown is None else shown
    images, ends = shown.images, shown.ends
    camera = images.camera
    within = WorkingRange.of(camera, budget)
    stations = planes(camera, at, within)
    distances = tuple(distance for _, distance in stations)
    sharp = _SharpEnds.of(camera)
    focused, rows = FocusedArray.of(camera), list[Resolved]()
    if focused is None:
        fields = range(len(images.fields))
        wanted: list[tuple[int, Station, Kind]] = [(k, one, "refocused") for one in stations for k in fields]
        wanted += [(0, one, "view") for one in stations]
        if design.main_lens.kind.faults:  # views, too, are less sharp off the axis
            wanted += [(k, stations[1], "view") for k in fields[1:]]
        for done, (k, one, image) in enumerate(wanted):
            tell(done / len(wanted))
            rows.append(resolved(images, k, one, image))
    points = shown.points
    farthest = corner(points)
    value = {name: float(QUANTITIES[name](camera)) for name in _NAMES}
    return Specification(
        field_of_view_deg=tuple(FieldOfView.of(ends, at) for at in (None, *distances)),
        direction_of_view_deg=value["direction_of_view_deg"],
        working_range_mm=within.ends,
        useful_to_mm=_known(within.useful_to),
        working_distance_mm=distances[1],
        hyperfocal_mm=_known(value["hyperfocal_mm"]),
        view_hyperfocal_mm=_known(value["view_hyperfocal_mm"]),
        object_field=tuple(ObjectField.of(ends, at, plane) for plane, at in stations),
        depth_precision=_DepthPrecision.of(design, images, stations),
        resolution=tuple(rows),
        depth_of_field_mm=sharp,
        field=points,
        distortion=shown.shown_last.distortion_percent,
        relative_illumination=farthest.relative_illumination,
        pixels=design.pixels,
        views_across=value["views_geometric"],
        independent_views_across=value["views_independent"],
        object_samples=_samples(ends),
        colours=tuple(Colour.of(camera, one) for one in filters(camera.colours)),
        insertion_diameter_mm=value[tube.INSERTED],
        outer_diameter_mm=value[tube.WHOLE],
        length_mm=value["total_length_mm"],
        parts=tuple(_ListedPart(part.name, float(part.width)) for part in tube.housed(camera)),
        focused=focused,
        has_views=bool(has_views(camera)),
    )


_NAMES = (
    "direction_of_view_deg",
    "hyperfocal_mm",
    "view_hyperfocal_mm",
    "views_geometric",
    "views_independent",
    *tube.WIDTHS,
    "total_length_mm",
)


def _sharp(camera: Camera, kind: Kind) -> tuple[float, float]:
    near, far = depth_of_field(camera, kind)
    return float(near), float(far)


def _known(value: float) -> float | None:
    return None if math.isnan(value) else value


def _light_words(light: Light) -> tuple[str, str]:
    """Light on the scene, and how it goes with distance, in words."""
    on_scene = (
        f"{number(light.illuminance, 4)} lx, reflectance {number(light.reflectance, 3)}"
        if light.radiance is None
        else f"radiance {number(light.radiance, 4)} W/m²/sr"
    )
    if light.measured_at is None:
        return on_scene, "as bright at every distance"
    return on_scene, f"falls as 1/z² from {number(light.measured_at, 4)} mm"


def depth_light(design: Design, camera: Camera, ends: tuple[float, float] | None) -> str:
    """Exposure that depth is told for, and how its light goes with distance, in words; empty where the error is given.

    With a caution where a source in the tip would darken the far end of a deep working range.
    """
    if design.depth.disparity_error is not None:
        return ""
    charge = f"{number(float(electrons(camera)), 4)} of {number(design.sensor.full_well, 4)} electrons a pixel in focus"
    told = f"{charge} in {number(1e3 * float(exposure(camera)), 3)} ms, {_light_words(design.light)[1]}"
    return clauses(told, _darkened(design.light, ends))


def _darkened(light: Light, ends: tuple[float, float] | None) -> str:
    if light.measured_at is not None or ends is None or not ends[0] > 0 or ends[1] <= DEEP * ends[0]:
        return ""
    left = "no light" if math.isinf(ends[1]) else f"1/{number((ends[1] / ends[0]) ** 2, 2)} of the light"
    return (
        f"a source in the tip would leave {left} of the near end at the far one: state light.measured_at to count that"
    )


def depth_assumptions(design: Design, camera: Camera, error: float) -> DepthAssumptions | None:
    """Assumptions behind a predicted disparity error; None where the design gives the error."""
    if design.depth.disparity_error is not None:
        return None
    across = min(float(QUANTITIES[name](camera)) for name in ("views_independent", "views_geometric"))
    return DepthAssumptions(
        electrons=float(QUANTITIES["pixel_electrons"](camera)),
        full_within_mm=full_within(camera),
        full_well=float(camera["sensor.full_well"]),
        light=_light_words(design.light)[0],
        light_at_distances=_light_words(design.light)[1],
        exposure_s=float(exposure(camera)),
        contrast=design.depth.contrast,
        period_mm=design.depth.period,
        gradient_per_pitch=float(view_gradient(camera, seen_at(camera, None))),
        views=math.pi / 4 * across**2,
        window=design.depth.window,
        sigma_disparity_pitches=error,
    )


def sides(width: float, height: float, diagonal: float, unit: str) -> str:
    """Width and height of a field in words; of one that light alone ends its diameter."""
    least = min(width, height)
    if diagonal <= ROUND_TO * least:
        return f"{number(least, 3)} {unit} round"
    return f"{number(width, 3)} x {number(height, 3)} {unit}"


def _over_sensor(name: str, camera: Camera, at: float | None) -> Array:
    """Field by chief rays, lit or not, of the thin-lens model."""
    over = QUANTITIES[name].over
    assert over is not None, name
    return over(camera, at, light.sensor_field(camera))


def _across(
    rays: Array, between: Callable[[Array, Array], Array], thin: Callable[[int], Array]
) -> tuple[float, float, float]:
    """Sizes between the rays of the field's ends, over width, height and diagonal.

    Where a real main lens does not show all of them, its thin-lens model's.
    """
    one, other = rays.reshape(4, 2, -1).swapaxes(0, 1)
    sizes = field_of_view.Across.widest(list(between(one, other)))
    width, height, diagonal = (float(thin(k) if np.isnan(size) else size) for k, size in enumerate(sizes))
    return width, height, diagonal


def _samples(ends: MicrolensImages) -> tuple[int, int]:
    """Whole microlenses across the width and the height of the field."""
    camera, (left, right, below, above) = ends.camera, ends.fields[:4]
    rows = PACKINGS[camera.layout].rise
    across, up = (math.dist(*pair) / float(camera.d) for pair in ((left, right), (below, above)))
    return math.floor(across + 1e-9), math.floor(up / rows + 1e-9)


def corner(points: Sequence[_FieldPoint]) -> _FieldPoint:
    """The farthest of some; first those that the lens does not show."""
    return max(points, key=lambda point: math.inf if point.x0_mm is None else point.x0_mm)
