"""Single microlenses: the shape of each image, its ray budget, and what a traced main lens makes of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache, partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._arrays import Array, sunflower
from .._jit import ahead
from ..accuracy.statement import check_accuracy
from ..camera import Camera
from ..design import Design
from ..design.assembly import Placed
from ..design.required import ROUND_ANGLE, ROUND_RADIUS, Required
from ..errors import InputError
from ..fates import ImageFate, RayFate
from ..lenses.prescription import LensError
from ..rays import trace_pupil
from ..shapes.lattice import cell_polygon
from ..shapes.openings import Openings
from ..theory import field_of_view
from ..theory.depth_error import errors_at_fields
from ..theory.exit_pupil import microlens_image_pitch
from ..theory.field_of_view import focus_ahead, off_axis
from ..theory.light import SensorField, on_array, sensor_field
from ..theory.limits import limits
from ..theory.quantity import FEASIBLE
from ..theory.stop_images import MicrolensImages, stop_openings
from ..theory.vignetting import field_limit
from ..traced.camera import camera_of
from ..traced.fields import DesignImages, images_of
from ..traced.images import measured_bound, real_field
from .groups import Field, Numbers, RayBudget, RealLens, RealLensField, Share

Place = tuple[float, float]
Shares = tuple[Array, Array, float, float]
"""Shares of the rays that fill the FAP: past each rim in the order of the file, and of light; on the sensor; in the
cell."""

RAYS = 65_536
"""Rays per microlens, evenly over the FAP, where no accuracy is asked for."""
BEST_ACCURACY = 3e-5
"""Below this, counting takes more rays than memory holds comfortably."""

FIELD_NAMES = ("centre", "edge", "corner")
"""Names of `default_fields`."""
TRIED = 33
"""Microlenses towards the field's corner between which one is looked for, twice: to 1e-6 of the way there."""
LIT_SHARE = 0.29
"""Share of the axis' light that an image keeps at least where a field counts as lit, as `vignetting.LIT` of a disc."""
HALVINGS = 11
"""Steps towards where light ends behind a real lens, to 1e-3 of the way."""
GROWN = (1.0, 1.02, 1.04, 1.06, 1.09, 1.12, 1.16, 1.2)
"""Shares of the field that is asked for at which its rims are tried by rays."""
FOLDING = 0.01
"""Part of a radius to which the one is looked for beyond which images fold."""
ROUND_FIELD = "round field"
"""Words for the field that a design requires to be round."""
MOST_FIELDS = 500
"""Fields looked at in one run."""
TRACING = 1.5
"""Seconds that `trace_lens` takes at least, interpreted."""


def default_fields(design: Design) -> tuple[Place, ...]:
    """Centre, edge and corner of what the sensor sees of the MLA [mm]; of a round field that is required, of its rim.

    Edge and corner belong to the outermost microlenses whose own cells still lie on the sensor, on the side that is
    farther from the main lens's axis. Those of a round field lie on its rim, along x and towards that corner.
    """
    centre, edge, corner = on_array(Camera.of(design), _outermost(design)).tolist()
    return tuple(centre), tuple(edge), tuple(corner)


def _outermost(design: Design) -> Array:
    """Outermost microlenses from the main lens's axis [mm], (3, 2)."""
    middle, (x, y) = _middle_and_corner(Camera.of(design))
    outer = np.array([middle, (x, middle[1]), (x, y)])
    radius = round_radius(design)
    if radius is not None:
        away = math.hypot(x, y)
        outer = np.array(
            [(0.0, 0.0), (math.copysign(min(radius, abs(x)), x), 0.0), (x * radius / away, y * radius / away)]
        )
    return outer


def _middle_and_corner(camera: Camera) -> tuple[Array, Array]:
    """Middle of the microlenses that the sensor sees whole, and the farthest of them, from the lens's axis [mm]."""
    low, high = (np.array(ends) for ends in sensor_field(camera, -np.abs(microlens_image_pitch(camera)) / 2))
    # The upper of two that are as far, but for rounding.
    return (low + high) / 2, np.where(high + low >= -1e-9 * (high - low), high, low)


def place_off_axis(design: Design, asked: Required) -> Place | None:
    """Microlens that sees what lies so far off the axis, towards the field's corner [mm]; None where none does."""
    if isinstance(asked.field, float):
        x, y = on_array(Camera.of(design), asked.field * _outermost(design)[2]).tolist()
        return x, y
    if asked.field is not None:
        return dict(zip(FIELD_NAMES, default_fields(design), strict=True))[asked.field]
    angle, height = asked.field_angle, asked.object_height
    radius = _radius(design, angle, height, asked.at)
    if radius is None:
        return None
    camera = Camera.of(design)
    corner = _middle_and_corner(camera)[1]
    x, y = on_array(camera, corner * (radius / np.hypot(*corner))).tolist()
    return x, y


def _radius(design: Design, angle: float | None, height: float | None, at: float | None) -> float | None:
    """Distance from the lens's axis of the microlens that sees an angle [rad] or height [mm] off it, [mm].

    By the chief rays of microlenses towards the field's corner, traced behind a real lens; None beyond those.
    """
    camera = Camera.of(design)
    corner, shares = _middle_and_corner(camera)[1], np.linspace(0.0, 1.0, TRIED)
    plane = float(focus_ahead(camera)) if at is None else at
    wanted = (angle or 0.0) if height is None else height  # one of both is given
    for _ in range(2):
        images = images_of(design, on_array(camera, shares[:, np.newaxis] * corner))
        ways = off_axis(images.directions) if height is None else np.hypot(*images.on_plane(plane))
        off = np.broadcast_to(ways, (TRIED, 1))[:, 0]
        off = np.where(np.logical_or.accumulate(np.isnan(off)), np.nan, off)  # what a real lens folds comes back
        ended = np.flatnonzero(~(off < wanted * (1 - FEASIBLE)))  # reached, or lost
        if not ended.size:
            return None
        k = max(int(ended[0]), 1)
        between = shares[k - 1 : k + 1]
        share = math.nan if np.isnan(off[k]) else float(np.interp(wanted, off[k - 1 : k + 1], between))
        shares = np.linspace(between[0], between[1], TRIED)
    return None if math.isnan(share) else share * float(np.hypot(*corner))


def lit_share(design: Design, ends: ArrayLike) -> Array:
    """Share of the ways from the axis to places on the array to which a real lens lights images, shape (N,).

    And lets their chief rays through; those to 1e-4 of the way, light to 1e-3.

    Parameters
    ----------
    ends : array_like, shape (N, 2)
        From the main lens's axis [mm].
    """
    camera, ends = Camera.of(design), np.asarray(ends, float)

    def images(shares: Array) -> DesignImages:
        return DesignImages(design, on_array(camera, (shares[..., np.newaxis] * ends).reshape(-1, 2)))

    near, far, each = np.zeros(len(ends)), np.ones(len(ends)), np.arange(len(ends))
    for _ in range(3):
        shares = np.linspace(near, far, TRIED)
        lost = np.isnan(off_axis(images(shares).directions)).reshape(shares.shape)
        first = np.where(lost.any(axis=0), np.argmax(lost, axis=0), TRIED)
        near, far = shares[np.clip(first - 1, 0, None), each], shares[np.clip(first, 0, TRIED - 1), each]
    lit, tried = np.zeros(len(ends)), near
    middle = float(DesignImages(design, on_array(camera, [(0.0, 0.0)])).traced.kept_fraction[0])
    least = LIT_SHARE * (middle or 1.0)
    for _ in range(HALVINGS):
        reached = images(tried).traced.kept_fraction >= least
        lit, near = np.where(reached, tried, lit), np.where(reached, near, tried)
        if np.all(reached) and np.all(lit == near):
            break
        tried = (lit + near) / 2
    return lit


@lru_cache(maxsize=64)
def round_radius(design: Design) -> float | None:
    """Distance from the lens's axis of the rim of the widest round field that a design requires [mm].

    None where it requires none, or one that the sensor does not see even towards its corner.
    """
    camera = Camera.of(design)
    if not camera.round_fields:
        return None
    if not design.main_lens.kind.mounted:
        field = field_of_view.judged_field(camera)
        return None if field is sensor_field(camera) else float(field.radius)
    radii = [
        _radius(design, math.radians(low / 2), None, None)
        if quantity.name == ROUND_ANGLE
        else _radius(design, None, low, asked.at)
        for asked, quantity, low, _ in limits(design)
        if quantity.name in (ROUND_ANGLE, ROUND_RADIUS) and low
    ]
    return None if None in radii else max(filter(None, radii), default=None)


def judged_field(design: Design) -> SensorField:
    """Part of the array to be lit and imaged: all that the sensor sees, or the square whose corners lie on the rim.

    That rim is of the round field that the design requires.
    """
    radius = round_radius(design)
    if radius is None:
        return sensor_field(Camera.of(design))
    half = np.asarray(radius / math.sqrt(2))
    return SensorField((-half, -half), (half, half))


def judged_part(design: Design) -> str:
    """Part of what the sensor sees that `judged_field` is of, in words."""
    return "whole sensor" if round_radius(design) is None else ROUND_FIELD


def unseen(design: Design, place: Place) -> str:
    """Words on a place of the array [mm] whose microlens the sensor does not see; empty where it does, to a pitch."""
    camera = Camera.of(design)
    low, high = (np.array(end) for end in sensor_field(camera))
    at, room = MicrolensImages(camera, [place]).from_lens[0], design.d
    if not np.any((at < low - room) | (at > high + room)):
        return ""
    (left, bottom), (right, top) = low.tolist(), high.tolist()
    return (
        f"field ({place[0]:g}, {place[1]:g}) mm lies beyond what the sensor sees of the array: {left:.4g} to "
        f"{right:.4g} mm across, {bottom:.4g} to {top:.4g} mm up; ask for one that it sees"
    )


def field_openings(design: Design, axes: ArrayLike) -> Openings:
    """Openings that the FAP, the main lens and the stops cut out on the sensor, relative to each microlens axis.

    Parameters
    ----------
    design : Design
        Tilts of FAP, main lens, array and sensor are left out.
    axes : array_like, shape (N, 2)
        Microlens axes, on the MLA [mm].

    Returns
    -------
    Openings
        One axis of N [mm], the FAP first, then `Camera.rims`.
    """
    camera = Camera.of(design)
    return stop_openings(camera, *MicrolensImages(camera, axes).from_lens.T)


def rays_for(accuracy: float | None) -> int:
    """Rays that count a share to within `accuracy`; `RAYS` where none is asked for.

    Points that fill the FAP evenly, cut by a rim, miss its share by at most about ``N^-3/4`` (largest of six tilted
    cameras each at 256 to 262 144 rays); twice that is allowed for.

    Raises
    ------
    InputError
        Not between `BEST_ACCURACY` and 1.
    """
    if accuracy is None:
        return RAYS
    check_accuracy(accuracy, BEST_ACCURACY, "parts are tilted, and rays are counted; straight designs are exact")
    return max(256, math.ceil(math.pow(2 / accuracy, 4 / 3)))


def evaluate_fields(design: Design, axes: Sequence[Place], rays: int = RAYS) -> tuple[Field, ...]:
    """Shape and ray budget of the microlens at each place.

    Parameters
    ----------
    axes : sequence of (x, y)
        Microlens axes, on the MLA [mm].
    rays : int
        Counted for the budget where FAP, main lens, array or sensor is tilted.

    Returns
    -------
    tuple of Field
        From exact areas. Where FAP, main lens, array or sensor is tilted, stops are ellipses on the sensor, still
        exactly, but shares of the ray budget are counted from rays.
    """
    if not axes:
        return ()
    camera = Camera.of(design)
    images = MicrolensImages(camera, axes)
    shape, offset = images.shapes, np.zeros((len(axes), 2))
    if design.has_exact_areas:
        shares = _exact_shares(images)
    else:
        points = sunflower(rays)
        shares = [_counted_shares(camera, axis, points) for axis in axes]
    if camera.tilted:  # shapes count from the FAP's image
        middle = np.stack(np.broadcast_arrays(images.outline.x, images.outline.y, images.x)[:2], -1)[:, 0]
        offset = middle + np.asarray(camera.decentre("sensor")) - images.from_lens
    depth_error, expected = (np.broadcast_to(error, shape.area.shape)[:, 0] for error in errors_at_fields(images))
    centroid, lit, ratio = shape.centroid[:, 0] + offset, shape.lit[:, 0], shape.axis_ratio[:, 0]
    return tuple(
        Field(
            x_ml_mm=axis,
            status=ImageFate(shape.status[i, 0]).words,
            area_mm2=float(shape.area[i, 0]),
            kept_fraction=float(shape.kept_fraction[i, 0]),
            lost_fraction=float(shape.lost_fraction[i, 0]),
            centroid_mm=_pair(centroid[i]) if lit[i] else None,
            axis_ratio=float(ratio[i]) if lit[i] else None,
            ray_budget=_budget(camera, *shares[i]),
            sigma_z_mm=float(depth_error[i]) if np.isfinite(depth_error[i]) else None,
            u_z_mm=float(expected[i]) if np.isfinite(expected[i]) else None,
            rays=None if design.has_exact_areas else rays,
        )
        for i, axis in enumerate(axes)
    )


def _budget(camera: Camera, kept: Array, past: Array, sensor: float, own: float) -> RayBudget:
    named = {rim.opening: float(share) for rim, share in zip(camera.in_light_order, past, strict=True)}
    return RayBudget(
        fap=1.0,
        main_lens=float(kept[1]),
        stops=tuple(kept[2:].tolist()),
        own_cell=own,
        by_name=(
            *(Share(name, share) for name, share in named.items()),
            Share("sensor", sensor),
            Share("own cell", own),
            Share("neighbours", sensor - own),
        ),
    )


def _exact_shares(images: MicrolensImages) -> list[Shares]:
    """Shares from areas on the sensor."""
    camera, openings = images.camera, images.openings.at(np.s_[:, 0])
    names = [rim.name for rim in (camera.fap, *camera.rims)]
    in_light = [names.index(rim.name) for rim in camera.in_light_order]

    cut = images.shapes.status[:, 0] != ImageFate.FULL

    cutting = np.any(openings.least_rooms < 0, axis=0)  # the others hold the FAP's image in theirs

    def past(order: list[int]) -> Array:
        """Shares past the first few rims; shape (microlenses, rims)."""
        shares, few = np.ones((len(cut), len(order))), order[:1]
        for k in range(1, len(order) if cut.any() else 0):
            shares[:, k] = shares[:, k - 1]
            if cutting[order[k]]:
                few.append(order[k])
                shares[cut, k] = openings.at(cut).some(few).common().kept_fraction
        return shares

    # The FAP stands among the others; what stops before it take is taken of the rays that fill it.
    at_fap = in_light.index(0)
    fap_first = past([0, *(k for k in in_light if k)])
    light = fap_first[:, [*range(1, at_fap + 1), at_fap, *range(at_fap + 1, len(names))]]
    kept = past(list(range(len(names))))
    on_sensor, own = (
        np.minimum(area / openings.area, kept[:, -1]).tolist() for area in _areas_on_sensor(images, openings)
    )
    return [(*rows, sensor, min(cell, sensor)) for *rows, sensor, cell in zip(kept, light, on_sensor, own, strict=True)]


def _areas_on_sensor(images: MicrolensImages, openings: Openings) -> tuple[Array, Array]:
    """Area of each image on the sensor, and of that in its own cell (0 where the images' pitch is) [mm^2]."""
    camera = images.camera
    pitch = abs(float(microlens_image_pitch(camera)))
    cell = cell_polygon(camera.layout, pitch, float(camera["microlens_array.rotation"])) if pitch else np.empty((0, 2))
    half = np.asarray(camera.sensor_size, float) / 2
    middle = np.asarray(camera.decentre("sensor"), float)
    on_sensor, own = np.zeros(len(images.fields)), np.zeros(len(images.fields))
    for i, axis in enumerate(images.from_lens):
        low, high = middle - half - axis, middle + half - axis
        box = np.array([low, (high[0], low[1]), high, (low[0], high[1])])
        on_sensor[i] = openings.at(i).area_in(box)
        polygon = _clipped_to_box(openings.centres[i, 0] + cell, low, high)
        if len(polygon) > 2:
            own[i] = openings.at(i).area_in(polygon)
    return on_sensor, own


def _clipped_to_box(polygon: Array, low: Array, high: Array) -> Array:
    """Part of a convex polygon inside an upright box, corners (M, 2) in order; none where it has no area."""
    for side in (0, 1):
        for sign, limit in ((1.0, high[side]), (-1.0, -low[side])):
            room = limit - sign * polygon[:, side]
            inside: list[Array] = []
            for i in range(len(polygon)):
                j = (i + 1) % len(polygon)
                if room[i] >= 0:
                    inside.append(polygon[i])
                if room[i] * room[j] < 0:
                    inside.append(polygon[i] + (polygon[j] - polygon[i]) * (room[i] / (room[i] - room[j])))
            polygon = np.array(inside).reshape(-1, 2)
    x, y = (polygon - polygon[:1]).T
    return polygon if abs(float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))) > 0 else np.empty((0, 2))


def _counted_shares(camera: Camera, axis: Place, points: Array) -> Shares:
    rays = trace_pupil(camera, (points[0], points[1]), axis)
    traceable = rays.status != RayFate.MISSED
    kept, past = (
        np.logical_and.accumulate([rays.passes[rim.name] & traceable for rim in rims]).mean(axis=1)
        for rims in ((camera.fap, *camera.rims), camera.in_light_order)
    )
    own = rays.status == RayFate.KEPT
    on_sensor = own | (rays.status == RayFate.NEIGHBOUR)
    return kept, past, float(on_sensor.mean()), float(own.mean())


@ahead(TRACING)
def trace_lens(design: Design, axes: Sequence[Place], thin: Numbers) -> RealLens | None:
    """Trace a design's main lens.

    Parameters
    ----------
    axes : sequence of (x, y)
        Microlens axes, on the MLA [mm].
    thin : Numbers
        Eq. 6 for the thin-lens model.

    Returns
    -------
    RealLens or None
        None where the main lens is ideal.

    Raises
    ------
    LensError
        Parts that collide with the lens.
    """
    if design.lens is None:
        return None
    camera = camera_of(design)
    constants = camera.first_order
    x0, x_ml = measured_bound(design)
    thin_twin = Camera.of(design)
    corners = on_array(thin_twin, judged_field(design).corners).tolist()
    fields = _traced_fields(design, axes)
    whole = all(field.status == "full" for field in (*fields, *_traced_fields(design, corners)))
    folds = None if whole else _folded_beyond(design, x_ml)
    return RealLens(
        lens=camera.lens.name,
        focal_length_mm=constants.focal_length,
        back_focal_length_mm=constants.back_focal_length,
        front_principal_mm=constants.front_principal,
        rear_principal_mm=constants.rear_principal,
        first_vertex_to_fap_mm=-camera.fap.z,
        last_vertex_to_mla_mm=constants.rear_principal + design.d_1 - camera.lens.length,
        x0_max_mm=x0,
        x_ml_max_mm=x_ml,
        thin_x_ml_max_mm=thin.x_ml_max_mm,
        turned_x_ml_max_mm=None if whole else _turned_bound(design, x_ml if folds is None else folds),
        undistorted_in_field=whole,
        folded_beyond_mm=folds,
        cut_by=() if whole or folds is not None else tuple(_cuts_by_rays(design)),
        fields=fields,
    )


def _cuts_by_rays(design: Design) -> list[dict[str, Any]]:
    """Cuts of the field as `field_limit` has them, each as deep as rays through a real lens ask for.

    The thin-lens model's, over a field that grows until rims wider by so much leave its images whole by rays; empty
    where that takes more than `GROWN`, as the lens itself is in the way, or the main lens cuts.
    """
    camera = Camera.of(design)
    asked, corners = field_of_view.judged_field(camera), on_array(camera, judged_field(design).corners).tolist()
    standing: tuple[Placed[Any], ...] = (*design.openings, *design.in_bore)
    places = {at.name: at.place for at in standing}
    free = {"tube": None, **{f"{opening.place}.bore": False for opening in design.openings if opening.part.bore}}
    for share in GROWN:
        low, high = ((share * x, share * y) for x, y in asked)
        cuts = field_limit(camera, SensorField(low, high)).cuts
        wider = dict[str, float]()
        for cut in cuts:
            place = f"{places.get(cut['rim'].partition(',')[0])}.diameter"
            if place not in camera.cold.numbers:  # the main lens, or no disc
                return []
            wider[place] = max(wider.get(place, 0.0), float(camera.cold[place]) + 2 * abs(cut["clearance_mm"]))
        try:
            if wider and all(one.status == "full" for one in _traced_fields(design.replace(free | wider), corners)):
                return cuts
        except InputError:  # wider than the glass that it stands in, or in another part
            return []
    return []


def _turned_bound(design: Design, own: float) -> float | None:
    """Radius of whole images the other way round; folds are looked for where nothing cuts them as far as now, `own`."""
    try:
        turned = design.replace({"main_lens.reversed": not design.main_lens.reversed})
        cut = measured_bound(turned)[1]
        folded = _folded_beyond(turned, cut) if cut > own else None
        return cut if folded is None else folded
    except LensError:
        return None


def _folded_beyond(design: Design, radius: float) -> float | None:
    """Radius on the array, along x, beyond which images fold, to 1e-2 of the one to which nothing cuts them [mm]."""
    folds = partial(_folded, design)
    if not 0 < radius < math.inf or not folds(radius):
        return None
    near, far = 0.0, radius
    while far - near > FOLDING * radius:
        middle = (near + far) / 2
        near, far = (near, middle) if folds(middle) else (middle, far)
    return near


def _folded(design: Design, radius: float) -> bool:
    return bool(real_field(design, [(radius, 0.0)]).images.status[0] == ImageFate.FOLDED)


def _traced_fields(design: Design, axes: Sequence[Place]) -> tuple[RealLensField, ...]:
    if not axes:
        return ()
    traced = real_field(design, axes)
    images, maps, diameter = traced.images, traced.maps, traced.thin_diameter
    twin = Camera.of(design)
    cone = float(twin.seen.D_F / twin.seen.A) / design.d
    kept = maps.status == RayFate.KEPT
    columns = {
        "diameter_mm": diameter * (1 + traced.widening),
        "widening_px": diameter * traced.widening / design.q,
        "widening_percent": 100 * traced.widening,
        "tangential_focus_mm": maps.tangential_focus,
        "sagittal_focus_mm": maps.sagittal_focus,
        "tangential_focus_pitches": maps.tangential_focus * cone,
        "sagittal_focus_pitches": maps.sagittal_focus * cone,
        "blur_pitches": maps.blur / design.d,
        "distortion_percent": 100 * maps.distortion,
        "lateral_colour_pitches": traced.lateral_colour / design.d,
    }
    known: list[dict[str, Any]] = [
        {name: float(column[i]) if kept[i] and not math.isnan(column[i]) else None for name, column in columns.items()}
        for i in range(len(axes))
    ]
    return tuple(
        RealLensField(
            x_ml_mm=axis,
            status=ImageFate(images.status[i]).words,
            chief_ray=traced.chief[i],
            kept_fraction=float(images.kept_fraction[i]),
            centre_mm=_pair(images.chief[i]) if kept[i] else None,
            axis_ratio=float(images.axis_ratio[i]) if images.status[i] != ImageFate.DARK else None,
            shift_px=_pair(traced.shift[i] / design.q) if kept[i] else None,
            **known[i],
        )
        for i, axis in enumerate(axes)
    )


def _pair(values: Array) -> Place:
    return float(values[0]), float(values[1])
