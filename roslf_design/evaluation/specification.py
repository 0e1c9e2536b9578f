"""Specification of a camera on its data sheet, in the terms of the endoscope standards (ISO 8600)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..camera import Camera
from ..design import Design
from ..design.parts import Light
from ..distances import Distance, check_distances
from ..json_data import plain
from ..progress import UNHEARD, Share
from ..shapes.lattice import PACKINGS
from ..tables import BriefValue
from ..theory import tube
from ..theory.colours import ColourFilter, filters
from ..theory.depth_error import depth_error, seen_at
from ..theory.depth_of_field import Kind, depth_of_field
from ..theory.disparity_error import full_within, texture, view_gradient
from ..theory.focused import FocusedArray, has_views
from ..theory.limits import as_design
from ..theory.photometry import electrons, exposure, through_filter
from ..theory.quantities import QUANTITIES
from ..theory.stop_images import MicrolensImages
from ..words import clauses, lux, number
from .field_images import FieldImages, FieldOfView, FieldPoint, ObjectField, corner
from .groups import DepthAssumptions
from .resolved import Place, Resolved, known, resolved
from .stations import FOCUS, Station, planes
from .working_range import BudgetAt, WorkingRange

CRITERION = "a point spreads over one microlens pitch, by rays"
DEEP = 3.0
"""Far end of a working range over the near one from which light that does not fall with distance is doubted."""


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
    field: tuple[FieldPoint, ...]
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
        useful_to_mm=known(within.useful_to),
        working_distance_mm=distances[1],
        hyperfocal_mm=known(value["hyperfocal_mm"]),
        view_hyperfocal_mm=known(value["view_hyperfocal_mm"]),
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


def _light_words(light: Light) -> tuple[str, str]:
    """Light on the scene, and how it goes with distance, in words."""
    on_scene = (
        f"{lux(light.illuminance)}, reflectance {number(light.reflectance, 3)}"
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
    focus, stated = seen_at(camera, None), design.depth.period or design.depth.finest
    microlenses = 1 / float(texture(camera, focus).fine)
    return DepthAssumptions(
        electrons=float(QUANTITIES["pixel_electrons"](camera)),
        full_within_mm=full_within(camera),
        full_well=float(camera["sensor.full_well"]),
        light=_light_words(design.light)[0],
        light_at_distances=_light_words(design.light)[1],
        exposure_s=float(exposure(camera)),
        contrast=design.depth.contrast,
        period_mm=design.depth.period,
        finest_mm=stated or microlenses * float(camera.d * focus.scale),
        finest_microlenses=None if stated else microlenses,
        gradient_per_pitch=float(view_gradient(camera, focus)),
        views=math.pi / 4 * across**2,
        window=design.depth.window,
        sigma_disparity_pitches=error,
    )


def _samples(ends: MicrolensImages) -> tuple[int, int]:
    """Whole microlenses across the width and the height of the field."""
    camera, (left, right, below, above) = ends.camera, ends.fields[:4]
    rows = PACKINGS[camera.layout].rise
    across, up = (math.dist(*pair) / float(camera.d) for pair in ((left, right), (below, above)))
    return math.floor(across + 1e-9), math.floor(up / rows + 1e-9)
