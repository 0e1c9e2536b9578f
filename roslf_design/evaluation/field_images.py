"""Fields of a design as pages tell them: what the sensor sees, lit, of angles, planes and microlens images."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np

from .._arrays import Array
from ..camera import Camera
from ..design import Design
from ..design.required import ROUND_ANGLE, ROUND_RADIUS, Required
from ..errors import InputError, Problem
from ..fates import ImageFate
from ..theory import field_of_view, light
from ..theory.focused import has_views
from ..theory.light import on_array
from ..theory.quantities import QUANTITIES
from ..theory.quantity import Quantity, Way
from ..theory.stop_images import MicrolensImages
from ..theory.vignetting import field_limit, lit_pairs, lit_radius
from ..traced.fields import DesignImages, IdealImages, images_of
from ..traced.images import measured_bound
from ..words import listed, number, the
from .fields import default_fields, judged_field, lit_share, place_off_axis, round_radius
from .resolved import LEVELS, Place, Resolved, known, resolved
from .stations import ASKED

CORNER, RIM, DARK_CORNER = "corner of the field", "rim of the round field", "corner of the sensor"
"""Where a field ends: the corner of what the sensor sees, or of a round field that is required its rim.

Where light ends before, the field ends there, and that corner is the sensor's alone."""
PAST = 1.002
"""Share of the way to where light ends, by search, at which it surely has."""
ROUND_TO = 1.005
"""Diagonal over the shorter side up to which a field is round, for a search of where light ends."""
ROUND = 16
"""Places on the rim of a round field that are looked at."""
ASTRAY = 0.1
"""Ways by which views miss one slope [pitches] from which depth is not what closed forms tell: behind an AC254-045-A
depths of a wall scatter 1.1 times as predicted at .04, 1.5 times at .14, 2.1 times at .34, biased by .75 of that."""


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
class FieldPoint:
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
    def of(cls, images: MicrolensImages, focus: float) -> tuple[FieldPoint, ...]:
        """Each of the fields, on the focal plane so far ahead of the tip [mm]."""
        shape = len(images.fields), 1
        names = ("distortion_percent", "local_magnification", "relative_illumination")
        local = [np.broadcast_to(QUANTITIES[name].at_fields(images), shape)[:, 0].tolist() for name in names]
        met = np.broadcast_to(np.hypot(*images.on_plane(focus)), shape)[:, 0]
        ways = np.broadcast_to(images.directions, (*shape, 3))[:, 0]
        angles = np.rad2deg(np.arctan2(np.hypot(ways[:, 0], ways[:, 1]), ways[:, 2]))
        rows = zip(images.fields.tolist(), met.tolist(), angles.tolist(), *local, strict=True)
        return tuple(
            cls((at[0], at[1]), known(x0), known(angle), known(bent), known(along), light)
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
    def points(self) -> tuple[FieldPoint, ...]:
        """The fields on the focal plane."""
        return FieldPoint.of(self.images, self._plane(None))

    @property
    def farthest(self) -> int:
        """Which of the images is farthest out on the focal plane: the corner's."""
        return self.points.index(corner(self.points))

    @property
    def shown_last(self) -> FieldPoint:
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
        if not names:
            return "a smaller FAP or a smaller sensor keeps images whole"
        return f"free the images from {listed([the(name) for name in names])}: wider ones, a smaller FAP or sensor"

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
        if isinstance(asked.field, str):
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
        return self._lit(field_of_view.feet(light.sensor_field(self.images.camera)), all_round=True)

    def _lit(self, ends: Any, *, all_round: bool = False) -> Array:
        """Share of the ways from the axis to places on the array that gets light, in all others too; 1 of all; (N,)."""
        if self.design.main_lens.kind.mounted:
            return lit_share(self.design, ends)
        x, y = np.asarray(ends, float).T
        radius = lit_radius(self.images.camera, None if all_round else (x, y))
        return np.asarray(np.minimum(1.0, np.maximum(radius, 0.0) / np.maximum(np.hypot(x, y), 1e-300)))

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
        x, y = ways[np.argmin(shares)]
        darkest = min(lit_pairs(camera, (x, y)), key=lambda pair: float(pair[2]))
        pair = [rim.opening.partition(",")[0] for rim in darkest[:2]]
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
        usable = self.detail_at((self.images, 0), at).usable_lp_per_mm
        return math.nan if usable is None else usable

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


def astray(images: IdealImages | DesignImages, field: int, at: float | None) -> float:
    """Standard deviation of the ways by which a microlens's views miss one slope [pitches]; 0 behind an ideal lens."""
    return 0.0 if isinstance(images, IdealImages) else images.astray(field, at)


def corner(points: Sequence[FieldPoint]) -> FieldPoint:
    """The farthest of some; first those that the lens does not show."""
    return max(points, key=lambda point: math.inf if point.x0_mm is None else point.x0_mm)
