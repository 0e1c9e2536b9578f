"""First answer on a camera, to what its buyer asks: how much it sees, where, how fine, how deep, how evenly lit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from ..bore.mapping import angle_map
from ..distances import Distance, check_distances
from ..lenses.angles import F_TAN
from ..theory import tube
from ..theory.depth_budget import CAUSES, COVERAGE, OVERLAP, DepthBudget, depth_budget
from ..theory.depth_error import temperatures_met
from ..theory.field_of_view import focus_ahead
from ..theory.focused import has_views
from ..theory.length_covariance import CalibratedLengths, LengthCovariance
from ..theory.light import outer_slope
from ..theory.limits import limits
from ..theory.quantities import QUANTITIES
from ..traced.fields import DesignImages, IdealImages, images_of
from ..words import clauses, listed, number, on_side, uncertainty
from .field_images import ASTRAY, CORNER, FieldImages, FieldOfView, ObjectField, astray, sides
from .resolved import resolved
from .specification import depth_light
from .stations import ASKED, FOCUS
from .working_range import WorkingRange, ranges

Row = tuple[str, str, str]
"""Name, value and remark."""


@dataclass(frozen=True)
class _AtDistance:
    """Field, depth and detail at one distance; None where pixels are no views, or nothing tells of it."""

    at_mm: float
    plane: str
    width_mm: float
    height_mm: float
    """Sides of the field there, as far as it is lit."""
    diagonal_mm: float
    """Its diagonal, no hypotenuse of these where a lens distorts."""
    u_z_mm: float | None
    """Depth, expected: combined standard uncertainty of one measurement on the axis."""
    expanded_mm: float | None
    """Expanded uncertainty, k = 2."""
    mostly: str
    """Largest term of it."""
    usable_lp_per_mm: float | None
    """Finest detail on the axis, refocused."""
    limited_by: str
    caution: str = ""
    """Reasons to believe U less; empty where none is known."""

    @property
    def field(self) -> str:
        """Field in words."""
        return sides(self.width_mm, self.height_mm, self.diagonal_mm, "mm")

    @property
    def cells(self) -> tuple[str, ...]:
        """Row of the table over distances."""
        where = f"{number(self.at_mm, 4)} mm{', in focus' if self.plane == FOCUS else ''}"
        field = self.field
        if self.expanded_mm is None:
            return where, field, "-", "-", "-"
        told = math.isfinite(self.expanded_mm) or self.mostly in (OVERLAP, *CAUSES)
        depth = uncertainty(self.expanded_mm, 2, "± ", self.at_mm), self.mostly if told else ""
        if self.usable_lp_per_mm is None:
            return where, field, *depth, "none"
        return where, field, *depth, f"{number(self.usable_lp_per_mm, 3)} lp/mm"


MEANT = (
    f"On the axis. Depth, expected: ± U, k = {COVERAGE}, within which 95 of 100 single measurements lie. Detail: the "
    "finest that the refocused image shows as what it is, with half its contrast or more."
)
"""Caption of it."""
STOP = 0.5
"""Share of the middle's light in the corner, one stop less, below which it is said what brings it up to that."""
SHARES = np.linspace(0.0, 1.0, 101)
"""Shares of the field whose corners' light is looked at."""
SMALLER = 1.05
"""Share of the middle's light in the corner from which it is said where more comes from."""


@dataclass(frozen=True)
class FirstAnswer:
    """Numbers of a camera in its buyer's terms."""

    field_of_view_deg: FieldOfView
    """From the entrance pupil (ISO 8600-3, method B), as far as the field is lit."""
    medium: str
    """Medium of the scene; empty for air."""
    working_distance_mm: float
    """Tip to focal plane."""
    working_range_mm: tuple[float, float] | None
    """Where single views are sharp and depth is of use, ahead of the tip; None where that is nowhere, or pixels are no
    views."""
    sharp_views_mm: tuple[float, float] | None
    """Where single views are sharp; None where pixels are no views."""
    useful_to_mm: float | None
    """Farthest of these at which U is a tenth of the distance at most; None where there is none."""
    working_range_lengths: str | None
    """Lengths that the working range counts: "as drawn", "as built" or "as calibrated"; None where pixels are no
    views."""
    full_within_mm: float
    """Distance ahead of the tip nearer than which full pixels leave most of the field without depth; 0 or infinite of
    even light."""
    depth_light: str
    """Exposure and light that the working range and depths hold for, in words; empty where the design gives the
    disparity's error, or pixels are no views."""
    corner_light: float
    """Light at the corner of the field over that in the middle."""
    corner_slant: float
    """Share that the field's angle before the bore and the lens's mapping alone leave; the rest is the size of what is
    lit of images."""
    corner_evened_by: str
    """Ways to even that, each with what it brings, in words; empty where it is less than a stop."""
    insertion_diameter_mm: float
    """Tube that the design states, wider where parts and walls need it; else all of the camera."""
    inserted: str
    """Part of the camera that is taken for inserted, in words."""
    outer_diameter_mm: float
    """Width of the whole camera."""
    outer_diameter_about: str
    """Tube that is inserted, in words."""
    outer_diameter_counts: str
    """Walls that this counts, in words."""
    head: str
    """Cause of the whole's width, in words; empty where all of it is inserted."""
    corner_lp_per_mm: float | None
    """Finest detail in the corner at the focal plane, refocused; None where it is dark, or pixels are no views."""
    depth_degc: float | None
    """Temperature that depths are expected at [degrees C]; None over `environment.range`, or where nothing tells it."""
    depth_between_degc: tuple[float, float] | None
    """Ends of `environment.range`, over which depths are then expected."""
    at: tuple[_AtDistance, ...]
    """At the focal plane, then at the distances asked for."""
    corner_freed_by: str = ""
    """Openings to widen where images in the corner are cut, in words."""
    outermost: str = CORNER
    """Place that counts as its corner: that of the field, or of a round field that is required its rim."""
    lit_diagonal_deg: float | None = None
    """Diagonal field of view where light ends it; None where the sensor does."""
    sensor_field_of_view_deg: FieldOfView | None = None
    """Angles to which the sensor would see, were the rest of it lit; None where it is."""

    @classmethod
    def of(
        cls,
        shown: FieldImages,
        at: Distance | Sequence[Distance] = (),
        build: LengthCovariance | None = None,
        calibration: CalibratedLengths | None = None,
        budget: DepthBudget | None = None,
    ) -> FirstAnswer:
        """Answer of a design.

        Parameters
        ----------
        shown : FieldImages
            Those of the design.
        at : sequence of float
            Distances ahead of the tip [mm], beside the focal plane.
        build, calibration : optional
            As for `depth_budget`.
        budget : DepthBudget, optional
            At the focal plane, where it is known.

        Raises
        ------
        InputError
            A distance that is none.
        """
        at = check_distances(at)
        images, ends = shown.images, shown.ends
        camera = images.camera
        focus = float(focus_ahead(camera))
        views = bool(has_views(camera))
        within = None
        if views:
            within = WorkingRange.of(camera, partial(depth_budget, camera, build=build, calibration=calibration))
        planes = []
        others = [asked for asked in dict.fromkeys(at) if number(asked, 4) != number(focus, 4)]
        for plane, distance in ((FOCUS, focus), *((ASKED, asked) for asked in others)):
            field = ObjectField.of(ends, distance, plane)
            u = expanded = lines = None
            mostly = limit = caution = ""
            if views:
                own = (plane == FOCUS and budget) or depth_budget(
                    camera, None if plane == FOCUS else distance, build=build, calibration=calibration
                )  # fmt: skip
                u, expanded, mostly = float(own.u_z_mm), float(own.expanded_mm), own.cause
                miss = astray(images, 0, None if plane == FOCUS else distance)
                bare = f"U is without aberrations, by which views miss one slope by {number(miss, 2)} pitches there"
                caution = clauses(own.caution, bare * (miss > ASTRAY))
                detail = resolved(images, 0, (plane, distance), "refocused")
                lines, limit = detail.usable_lp_per_mm, detail.limited_by
            planes.append(
                _AtDistance(
                    distance,
                    plane,
                    field.width_mm,
                    field.height_mm,
                    field.diagonal_mm,
                    u,
                    expanded,
                    mostly,
                    lines,
                    limit,
                    caution,
                )
            )
        farthest = shown.farthest
        outer = resolved(images, farthest, (FOCUS, focus), "refocused").usable_lp_per_mm if views else None
        medium, met = shown.design.object_space.medium.name, temperatures_met(camera)
        view = FieldOfView.of(ends, None)
        return cls(
            view,
            "" if medium == "air" else medium,
            focus,
            *ranges(within),
            "" if within is None else depth_light(shown.design, camera, within.ends),
            *_corner_light(images, farthest),
            _evened_by(shown, farthest),
            float(QUANTITIES[tube.INSERTED](camera)),
            tube.inserted(camera),
            float(QUANTITIES[tube.WHOLE](camera)),
            *tube.walls(camera),
            tube.head(camera),
            outer,
            None if met is None or met[0] != met[1] else float(met[0]),
            None if met is None or met[0] == met[1] else (float(met[0]), float(met[1])),
            tuple(planes),
            shown.freed,
            shown.outermost,
            None if shown.dark_beyond is None else view.diagonal,
            shown.dark_beyond,
        )

    @property
    def headings(self) -> tuple[str, ...]:
        """Headings of the table over distances."""
        lengths = self.working_range_lengths and f"lengths {self.working_range_lengths}"
        warm = "" if self.depth_degc is None else f"at {self.depth_degc:g} °C"
        if self.depth_between_degc is not None:
            warm = "over {:g} to {:g} °C".format(*self.depth_between_degc)
        depth = clauses("depth, U", lengths or "", warm, by=", ")
        return "ahead of the tip", "field", depth, "mostly of", "detail"

    def uncounted(self, design: str = "", calibrated: str = "", bare: str = "") -> str:
        """Line below the table over distances: U in the focal plane with what lengths add; else the command that tells.

        Empty where its depths count lengths. `design` is as it was typed; `calibrated` is U as planned, `bare` without
        a calibration, in words, empty where not known.
        """
        if self.working_range_lengths != "as drawn":
            return ""
        command = f"`{f'roslf calibrate --plan {design}'.strip()}`"
        told = clauses(
            f"calibrated as {command} plans {calibrated}" if calibrated else "",
            f"uncalibrated {bare}" if bare else "",
            by=", ",
        )
        known = f"{told} (U in the focal plane)" if told else f"{command} adds them"
        return f"errors of lengths not in U: {known}"

    @property
    def rows(self) -> tuple[Row, ...]:
        """Lines of the table."""
        view = self.field_of_view_deg
        around = f" in {self.medium}" if self.medium else ""
        dark = ""
        if (sensor := self.sensor_field_of_view_deg) is not None:
            spans = f"{number(sensor.width, 3)} x {number(sensor.height, 3)} deg"
            dark = f"; lit no farther, the sensor spans {spans}, diagonal {number(sensor.diagonal, 3)} deg"
        rows = [
            (
                "field of view",
                sides(view.width, view.height, view.diagonal, "deg"),
                f"diagonal {number(view.diagonal, 3)} deg, from the entrance pupil{around} (ISO 8600-3){dark}",
            ),
            ("working distance", f"{number(self.working_distance_mm, 4)} mm", "tip to focal plane"),
        ]
        if self.sharp_views_mm is not None:
            useful = math.nan if self.useful_to_mm is None else self.useful_to_mm
            lengths = self.working_range_lengths or ""
            within = WorkingRange(*self.sharp_views_mm, useful, lengths, self.full_within_mm)
            varies = bool(self.depth_light) and 0 < self.full_within_mm < math.inf  # no even light
            held_for = f"with {self.depth_light}" if varies else ""
            rows.append((within.label, within.value, clauses(within.remark, held_for)))
        light = f"{number(100 * self.corner_light, 3)} %"
        more = "; the lens draws the scene smaller there" if self.corner_light > SMALLER else ""
        rows.append((f"light {self.outer_words}", light, f"of that in the middle of the field{more}"))
        # Into which it goes.
        inserted, outer = (
            f"{on_side(width, True, 4)} mm" for width in (self.insertion_diameter_mm, self.outer_diameter_mm)
        )
        walls = f"{self.outer_diameter_about} {self.outer_diameter_counts}"
        if self.head:
            return (
                *rows,
                ("inserted width", inserted, f"{self.inserted}: {walls}"),
                ("outer diameter", outer, self.head),
            )
        if self.outer_diameter_about == tube.NARROWEST:
            return (*rows, ("outer diameter", outer, f"no [tube] stated: {self.outer_diameter_counts}"))
        return (*rows, ("outer diameter", outer, f"of {self.inserted}; {walls}"))

    @property
    def outer_words(self) -> str:
        """Place of what is told of the corner, in words."""
        return "in the corner" if self.outermost == CORNER else f"at the {self.outermost}"

    @property
    def cautions(self) -> list[str]:
        """Lines on where U is to be believed less."""
        return [f"{number(plane.at_mm, 4)} mm: {plane.caution}" for plane in self.at if plane.caution]

    @property
    def light_words(self) -> str:
        """Causes of the corner's light, each with its share."""
        area = self.corner_light / self.corner_slant if self.corner_slant > 0 else 1.0
        shares = {"the field's angle leaves": self.corner_slant, "the size of what is lit of its images leaves": area}
        if area > 1:
            gives = "the lens, which draws the scene smaller there, gives"
            shares = {"the field's angle leaves": self.corner_slant, gives: area}
        words = [f"{what} {number(100 * share, 3)} %" for what, share in shares.items() if abs(share - 1) > 0.01]
        return listed(words) if words else "nothing takes any"


def _corner_light(images: IdealImages | DesignImages, field: int) -> tuple[float, float]:
    """Light at a field over that in the middle, the first, and the share of it that is not the size of what is lit."""
    shape = (len(images.fields), 1)
    lit = QUANTITIES["relative_illumination"].at_fields(images)
    (light, middle), (level, straight) = (
        np.broadcast_to(one, shape)[[field, 0], 0].tolist() for one in (lit, images.level)
    )
    return (light / middle, level / straight) if middle > 0 else (light, level)


def _evened_by(shown: FieldImages, field: int) -> str:
    """Ways to light the corner, one of the fields, up to `STOP`, with the figures of the cameras that have them.

    The FAP limits light in the scene, and so its angle there counts: no place of the exit pupil changes that.
    """
    design, images, camera = shown.design, shown.images, shown.images.camera
    light, level = _corner_light(images, field)
    if light >= STOP:
        return ""
    narrower = images_of(design, SHARES[:, np.newaxis] * images.fields[field])
    lit = np.ravel(QUANTITIES["relative_illumination"].at_fields(narrower))
    dark = int(np.argmax(lit < STOP * lit[0]))  # the corner is, against the middle
    view = FieldOfView.of(images_of(design, shown.seen.fields * SHARES[dark - 1]), None)
    angles = {"": view.diagonal, "width_": view.width, "height_": view.height}
    least = [
        f"{quantity.label}: at least {number(low, 4)} deg"
        for _, quantity, low, _ in limits(design)
        for side, angle in angles.items()
        if quantity.name == f"field_of_view_{side}deg" and low is not None and low > angle
    ]
    ways = [] if least else [f"a smaller sensor, of a field of {number(view.diagonal, 3)} deg over its diagonal"]
    slope = float(outer_slope(camera, np.hypot(*images.fields[field])))
    by_angle = math.isclose(level, camera.mapping.light(slope), rel_tol=1e-9)  # and by no rays of a real lens
    if by_angle and not camera.mapping.words:
        barrel = float(angle_map("f theta", 1.0).light(F_TAN.angle(slope)))
        if barrel * light >= STOP * level:
            ways.append(f"an objective that draws the same field barrel-shaped (f theta leaves {100 * barrel:.3g} %)")
    return clauses(
        "no place of the exit pupil evens it" if by_angle else "",
        f"what is required ({listed(least)}) allows no smaller sensor" if least else "",
        f"{' or '.join(ways)} would" if ways else "",
        f"{'else' if ways else 'what is left is'} a flat-field correction of pictures, with that noise",
    )
