"""Effects of geometry: where microlens images lie, what cuts them, and what misplaced parts do to them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from .._arrays import magnitude
from ..camera import Camera, Number
from ..design import Design
from ..design.parts import PATHS
from ..errors import InputError, Problem
from ..lenses.angles import F_TAN
from ..theory.exit_pupil import microlens_image_diameter, stop_angle
from ..theory.f_number import TOUCHING_PX
from ..theory.light import chief_slope, outer_slope
from ..theory.stop_images import settled, stop_openings
from ..theory.vignetting import room_at
from ..words import angle, number, percent
from . import lens
from .effect import Effect, Estimate, Subject


def _pupil_geometry(s: Subject) -> Estimate:
    """Centre shift X_ml d_2/L at the field's rim [px], signed: negative towards the axis (Eqs. 2-4)."""
    shift = s.x_ml * float(s.camera.seen.d_2 * s.camera.seen.vergence) / s.design.q
    return Estimate(shift, f"image centre {shift:.3g} px from the microlens axis {s.at}")


def _cut_depth(s: Subject) -> float:
    """How deep the main lens and the further stops cut into the FAP's image at the field's rim, on the sensor [mm].

    0 where the FAP's image lies inside all others (the non-distortion margin of Eqs. 5-6 is not negative), its whole
    diameter where nothing is left. Decentres count at their worst where all openings are round.
    """
    x, y = np.transpose([(0.0, 0.0), *s.outermost])
    openings = stop_openings(s.camera, x, y)
    aside, own = openings.centres[1:], float(openings.spans[0, 0])
    if len(s.outermost) > 1:
        depths = -np.min([openings.at(k).rooms[1:] for k in range(1, len(x))], axis=0)
    else:
        moved = aside[0] - openings.centres[0]
        apart = np.hypot(*(moved[1:] - moved[0]).T)  # in the worst direction
        depths = apart - openings.at(0).rooms[1:]
    if s.camera.leaning:
        scale = s.camera.seen.inverse_m
        places = -np.array(s.outermost) * scale if len(s.outermost) > 1 else None
        room = room_at(s.camera, s.lens_field * magnitude(scale), places)
        for k in s.camera.leaning:
            rim = s.camera.rims[k]
            depths[k] = -room[k] / (rim.scale * rim.radius) * float(openings.spans[0, k + 1]) / 2
    depth = settled(np.max(depths), max(own / 2, np.abs(aside).max(initial=0.0)))
    return float(np.clip(depth, 0.0, own))


def _vignetting(s: Subject) -> Estimate:
    """Depth of the deepest cut [px]."""
    depth, at = _cut_depth(s) / s.design.q, f"at X_ml = {s.lens_field:.4g} mm"
    traced = lens.lens_aberrations(s.design, s.lens_field).cut / s.design.q
    if traced > depth:
        name = s.design.main_lens.kind.name
        return Estimate(traced, f"{name}, traced, cuts {traced:.3g} px off microlens images {at}")
    if depth <= 0:
        return Estimate(0.0, f"the FAP's disc lies inside all others {at}: nothing is clipped")
    return Estimate(depth, f"other rims cut {depth:.3g} px into the FAP's disc {at}")


def overlap(s: Subject) -> Estimate:
    """Width of the overlap of neighbouring images, diameter less pitch [px]; zero where they leave gaps (Eq. 7)."""
    width = (s.diameter - abs(s.pitch)) / s.design.q
    size = number(abs(width), 3, zero=TOUCHING_PX)
    if size == "0":
        return Estimate(0.0, "images just touch")
    apart = f"images overlap by {size} px" if width > 0 else f"images end {size} px short of each other"
    return Estimate(max(width, 0.0), apart)


def _blur_on_mla(c: Camera, distance: float, place: float = 0.0) -> float:
    """Width on the MLA over which an object point at Z = `distance` spreads [mm].

    D_F d_1 |1/(H Z_F) - 1/d_f| with Z_F = Z - d_3, in the form D_F (d_1/d_f) |d_f - Z|/(Z - d_3) that does not
    cancel near the focal plane. Behind an objective with a mapping, which bends the plane in focus, the most of middle
    and edge, along and across the field; `place` is that of the edge on the MLA [mm].

    Raises
    ------
    InputError
        Where the object is not beyond the FAP.
    """
    bore = max(float(c.fap.ruler_distance), 0.0)
    if distance <= bore:
        ahead = f"the aperture at d_3 = {bore:g} mm" if c.fap.ruler_distance >= 0 else "the main lens"
        fault = f"{distance:g} mm is not beyond {ahead}; move the object out"
        raise InputError((Problem("object distance", fault),))
    apparent = c.plane(distance).distance
    middle = float(np.abs(c.seen.D_F * c.seen.d_1 / c.seen.d_f * (c.seen.d_f - apparent) / (apparent - c.seen.d_3)))
    return (
        middle if place == 0 or not c.mapping.bends else max(middle, *(abs(b) for b in mapped_blur(c, distance, place)))
    )


def mapped_blur(c: Camera, distance: float, place: float) -> tuple[float, float]:
    """Widths on the MLA of an object point, signed, behind an objective with a mapping.

    Along the field's radius and across it.

    The FAP seen from outside, 2 R at a distance Z_P, spreads directions by 2 R/Z_P; of these the first order has as
    much less as the mapping stretches slopes there.
    """
    _, front = c.front
    wide = front.d - front.c * c.seen.d_3
    p, pupil = outer_slope(c, place), c.entrance_pupil_distance
    spread = 2 * front.medium * c.fap.radius * c.seen.gap / (c.seen.inverse_m * wide * wide)
    away, focus = distance - pupil, c[PATHS["d_f"]] - pupil
    along, across = (
        float(spread * (1 / (away * grown) - 1 / focus)) for grown in (c.tangential_stretch(p), c.sagittal_stretch(p))
    )
    return along, across


def object_defocus(s: Subject) -> Estimate:
    """Spread over the MLA [microlens pitches] of the scene's nearest or farthest point; zero for a uniform scene."""
    if s.brief.distances is None:
        return Estimate(0.0, "the scene lies on the focal plane")
    spread = max(_blur_on_mla(s.camera, distance, s.x_ml) for distance in s.brief.distances) / s.design.d
    nearest, farthest = s.brief.distances
    if s.brief.white:
        return Estimate(0.0, f"a uniform scene looks alike at any distance (detail would spread {spread:.3g} pitches)")
    reach = f"Z = {nearest:.4g} mm" if nearest == farthest else f"Z = {nearest:.4g} to {farthest:.4g} mm"
    return Estimate(spread, f"object points at {reach} spread over {spread:.3g} pitches")


def cos4(s: Subject) -> Estimate:
    """Loss at the field's rim [fraction of full scale]: cos^4, or as the mapping of an objective has it.

    Behind a real lens it is that of the rays behind the array: what obliqueness costs in front of the lens shows in
    the size of the microlens images there, which are traced (etendue is conserved).
    """
    if s.design.main_lens.kind.faults:
        loss = F_TAN.loss(lens.lens_aberrations(s.design, s.lens_field).steepest)
        return Estimate(
            loss,
            f"{percent(loss, 2)} darker at X_ml = {s.lens_field:.4g} mm, by cos⁴ of the steepest ray behind the array",
        )
    loss = s.camera.mapping.loss(s.x_ml * float(chief_slope(s.camera)))
    return Estimate(loss, f"{percent(loss, 2)} darker {s.at}{s.camera.mapping.words}")


def _mla_rotation(s: Subject) -> Estimate:
    """Chord 2 X_ml sin(rotation/2) that the outermost microlens moves by [px]."""
    turned = s.design.microlens_array.rotation
    if turned == 0:
        return Estimate(0.0, "the array is not rotated")
    moved = 2 * s.x_ml * abs(math.sin(turned / 2)) / s.design.q
    return Estimate(moved, f"{angle(turned)} move microlenses by {moved:.3g} px {s.at}")


def tilt_shift(camera: Camera, x_ml: float) -> float:
    """Shift or blur of a microlens image at X_ml = `x_ml` by tilts, first order, all added up [mm].

    An array or sensor tilted by t lies X_ml t out of place there: the chief ray (slope X_ml/L), the image's radius
    (D_F H/2 d_1) and the microlens's own rays (d/2 d_2) each turn that into a shift; in the tilted plane lengths
    shrink by 1 - cos t. A tilted rim reaches D_F t/2 out of its plane, seen under the field angle; a tilted thin
    lens refracts at height l about l t away from z = 0, where it bends by l/f.
    """

    def tilt(part: str) -> float:
        return math.hypot(*map(float, camera.tilt(part)))

    def scale(distance: Number) -> float:
        return float(camera.seen.d_2 * stop_angle(camera, distance))

    slope = abs(x_ml * float(camera.seen.vergence))
    cone = float((microlens_image_diameter(camera) + camera.d) / (2 * camera.seen.d_2))
    array, sensor = tilt("microlens_array"), tilt("sensor")
    moved = x_ml * (array + sensor) * (slope + cone)
    moved += x_ml * (2 * math.sin(array / 2) ** 2 + 2 * math.sin(sensor / 2) ** 2)
    field_angle = x_ml * float(camera.seen.inverse_m) / float(camera.seen.gap)
    for rim in camera.openings_ahead:
        moved += 0.0 if rim.leans else float(rim.radius) * tilt(rim.part) * field_angle * scale(rim.distance)
    height = x_ml * float(camera.seen.d_3 / camera.seen.A)
    return moved + height**2 / float(camera.f) * tilt("main_lens") * scale(camera.seen.d_3)


def _tilts(s: Subject) -> Estimate:
    """Shift [px] at the field's rim."""
    if s.camera.largest_tilt == 0:
        return Estimate(0.0, "nothing is tilted")
    moved = tilt_shift(s.camera, s.x_ml) / s.design.q
    return Estimate(moved, f"tilts move microlens images by {moved:.3g} px {s.at}")


def _decentres(s: Subject) -> Estimate:
    """Distance that all decentres, each at its worst, move light on the sensor [px], the same all over.

    Microlens images move there; what is seen in them moves over the array too, by e (1 + m) with the main lens and by e
    with the array, unless the scene is uniform. The larger of the two counts.
    """
    design, c = s.design, s.camera
    lens, array = (math.hypot(*part.decentre) for part in (design.main_lens, design.microlens_array))
    images = lens * abs(s.scale(float(c.seen.d_3)) * float(c.seen.d_3)) / design.f + array * abs(s.pitch) / design.d
    images += math.hypot(*design.sensor.decentre)
    for rim in c.openings_ahead:
        # As seen: decentres, tilts and wedges of elements count.
        x, y = (float(a) + b for a, b in zip(c.decentre(rim.part), design.main_lens.decentre, strict=True))
        images += math.hypot(x, y) * abs(s.scale(float(rim.distance)))
    picture = 0.0 if s.brief.white else lens * (1 + float(c.seen.m)) + array
    if not s.brief.white:
        picture += float(np.hypot(*c.focus.axis_offset) * c.seen.m / np.abs(c.focus.magnification))
    images, picture = images / design.q, picture / design.q
    if images == picture == 0:
        return Estimate(0.0, "nothing is decentred")
    if picture > images:
        return Estimate(picture, f"decentres move the scene's picture by {picture:.3g} px over the array")
    return Estimate(images, f"decentres move microlens images by {images:.3g} px")


PUPIL_GEOMETRY = Effect("pupil_geometry", "Pupil geometry", "px", _pupil_geometry, always=True)


def _rimless(c: Camera) -> Camera:
    """Camera of which no rim but the FAP's clips."""
    return c.replace({place: math.inf for rim in c.rims for place in rim.size_places})


def _undecentred(design: Design) -> dict[str, Any]:
    """Centred parts; what tilted and wedged elements do is shift what is seen through them."""
    values = {f"{place}.decentre": (0.0, 0.0) for place in _movable(design)}
    return values | {f"{at.place}.{pose}": (0.0, 0.0) for at in design.in_bore for pose in at.part.poses}


def _movable(design: Design) -> tuple[str, ...]:
    return ("main_lens", *(stop.place for stop in design.openings), "microlens_array", "sensor")


VIGNETTING = Effect("vignetting", "Vignetting", "px", _vignetting, cost_per_pixel=5e-9, simplified=_rimless)
OVERLAP = Effect(
    "overlap",
    "Overlap with neighbours",
    "px",
    overlap,
    cost_per_pixel=5e-9,
    required_by=("microlens_diffraction", "microlens_defocus"),
)
OBJECT_DEFOCUS = Effect("object_defocus", "Object out of focus", "pitch", object_defocus)
COS4 = Effect("cos4", "cos^4 fall-off", "intensity", cos4)
MLA_ROTATION = Effect(
    "mla_rotation", "MLA rotation", "px", _mla_rotation, straight=lambda design: {"microlens_array.rotation": 0.0}
)
TILTS = Effect(
    "tilts", "Tilts", "px", _tilts, straight=lambda design: {f"{place}.tilt": (0.0, 0.0) for place in _movable(design)}
)
DECENTRES = Effect("decentres", "Decentres", "px", _decentres, straight=_undecentred)
