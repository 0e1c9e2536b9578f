"""Every number of a camera, once: name, unit, words, equation and function.

`roslf evaluate`, the metrics of tolerance studies, the goals and limits of the optimiser, the explorer, the report and
the documentation's tables all read `QUANTITIES`. A new number is one more entry here, and every command knows it.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from operator import attrgetter
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from .._arrays import Array, product, ratio
from ..bore.opening import ClearAperture
from ..camera import Camera, Number
from ..camera.rims import place_of
from ..design import Design
from ..design.parts import PATHS
from ..design.required import ROUND_ANGLE, ROUND_RADIUS
from ..errors import expect
from ..toml_files import SLIP, nearest
from ..words import listed, number, the
from . import (
    depth_of_field,
    exit_pupil,
    f_number,
    field_of_view,
    focused,
    light,
    light_field,
    photometry,
    resolution,
    tube,
    vignetting,
)
from .depth_budget import COVERAGE
from .depth_error import (
    depth_at,
    depth_error,
    depth_error_at_fields,
    errors_at_fields,
    expected_error,
    plane_at,
    seen_at,
)
from .disparity_error import axial_disparity_sigma
from .field_of_view import Lit
from .light import SensorField
from .quantity import Depth, Listed, Quantity
from .stop_images import MicrolensImages

EXPANDED = "expanded_u_z_mm"
"""Name of U, twice `u_z_mm`."""


def quantity_named(name: str) -> Quantity:
    """Find a quantity.

    Raises
    ------
    ValueError
        Not known; names the nearest.
    """
    expect(name, "quantity", str, 'the name of a quantity, as "fill_factor"')
    if name in QUANTITIES:
        return QUANTITIES[name]
    labels = {key: one.label for key, one in QUANTITIES.items() if one.of is not None and key not in PATHS}
    known = f"`roslf quantities` lists {len(QUANTITIES)}, the symbols {', '.join(PATHS)} among them"
    remedy = nearest(name, QUANTITIES, known, labels)
    tables = {path.partition(".")[0] for path in PATHS.values()}
    table = next((one for one in tables if name.startswith((f"{one}_", f"{one}."))), "")
    if table and not difflib.get_close_matches(name, QUANTITIES, 1, SLIP):
        remedy = f"what its {table.replace('_', ' ')} is, keys of the design state: `roslf keys {table}`"
    if "'u_z_mm'" in remedy:  # U is what data sheets quote
        remedy += f" u_z_mm is the standard uncertainty, half of U (k = 2), which is {EXPANDED}"
    raise ValueError(f"'{name}' is no quantity of a design; {remedy}")


DEPTH_ERRORS = ("sigma_z_mm", "u_z_mm", EXPANDED)
"""Errors of one depth on the axis."""
EXPECTED_DEPTHS = ("u_z_mm", EXPANDED, "u_z_at_field_mm")
"""Depths, expected: of all that is known."""
ALIKE = 0.01
"""Share by which windows differ that are alike."""
NO_LENS_MOVES = frozenset(
    (
        *(
            "working_distance_mm",
            "direction_of_view_deg",
            "object_magnification",
            "object_sample_mm",
            "depth_window_mm",
        ),
        "fold_lp_per_mm",
        *(*tube.WIDTHS, "largest_diameter_mm", "total_length_mm", "camera_length_mm", "lateral_samples"),
        *("f_number_microlens", "f_number_microlens_lens", "fresnel_number", "views_independent", "airy_radius_px"),
        *PATHS,
    )
)
"""Quantities that a thin-lens model has as its real lens has them: of parts, or on the axis to first order."""


def thin_lens_note(designs: Iterable[Design], names: Iterable[str], *, untraced: str = "") -> str:
    """Words on the quantities that are of thin-lens models where lenses are real, and who tells more; empty of none.

    `untraced`: what would have been traced, in words, where these were too many.
    """
    lenses = dict.fromkeys(lens.name for design in designs if (lens := design.main_lens.kind).mounted)
    told = {name for name in dict.fromkeys(names) if name in QUANTITIES and QUANTITIES[name].of_rays is not None}
    moved = [name for name in dict.fromkeys(names) if name not in NO_LENS_MOVES and (untraced or name not in told)]
    if not lenses or not moved:
        return ""
    return (
        f"of the thin-lens model, not of rays through {listed([*lenses])}: {listed(moved)}; `roslf evaluate` traces "
        "field, light and detail"
    ) + (f" ({untraced}, too)" if untraced and told else "")


def window_note(names: Iterable[str], windows: Callable[[], ArrayLike]) -> str:
    """Words on windows of unlike size on the object [mm] that depths come from; empty where none is asked for."""
    if not (depths := [name for name in DEPTH_ERRORS if name in names]):
        return ""
    every = np.ravel(windows())
    known = every[np.isfinite(every)]
    if not known.size or np.ptp(known) <= ALIKE * known.max():
        return ""
    ends = f"{number(float(known.min()), 3)} to {number(float(known.max()), 3)} mm"
    remedy = "choose depth.window so that it is alike"
    return f"{listed(depths)} from windows of unlike size, {ends} on the object (depth_window_mm): {remedy}"


def quantities_of_cameras(names: str | Sequence[str], at: Depth = None) -> list[Quantity]:
    """Quantities of whole cameras, by their names.

    Parameters
    ----------
    names : str or sequence of str
    at : float, optional
        Distance ahead of the bore's tip that they are asked for at [mm]; None is the focal plane.

    Raises
    ------
    ValueError
        One that is not known, belongs to a field, or needs a distance.
    """
    expect(names, "quantities", Iterable, "names of quantities")
    known = [quantity_named(name) for name in ([names] if isinstance(names, str) else names)]
    for quantity in known:
        if quantity.of is None:
            raise ValueError(f"{quantity.name} belongs to a field, not to a whole camera; take another")
        if at is None and (fault := quantity.fault_of_distance(at)):
            raise ValueError(fault)
    return known


def _whole(form: Callable[[Camera], Number]) -> Callable[[Camera, Depth], Array]:
    return lambda c, _: np.asarray(form(c))


def _um(value: float) -> str:
    return f"{number(1e3 * value)} um"


def _over_field(form: Callable[[Camera, Depth, SensorField], Array]) -> dict[str, Any]:
    """`Quantity.of` and `Quantity.over` of what hangs on how much of the array the sensor sees."""
    return {"of": lambda c, at: form(c, at, light.sensor_field(c)), "over": form}


def _over_lit(form: Callable[[Camera, Depth, SensorField, Lit], Array]) -> dict[str, Any]:
    """`Quantity.of` and `Quantity.over` of what hangs on how much of that is lit, of a dark camera one microlens."""
    return {
        "of": lambda c, at: form(c, at, light.sensor_field(c), vignetting.lit_to(c)),
        "over": lambda c, at, field: form(c, at, field, None),
        "lit": True,
    }


def _half_field(way: Literal["width", "height", "diagonal"]) -> Callable[[Camera, Depth, SensorField, Lit], Array]:
    """Half of what the sensor sees, lit, of a plane, over its width, height or diagonal."""

    def of(c: Camera, at: Depth, field: SensorField, lit: Lit) -> Array:
        if c.chain.bends_rays:
            return np.asarray(getattr(field_of_view.object_field(c, field, at, lit), way) / 2)
        half = field.half_diagonal if way == "diagonal" else field.half[way == "height"]
        dark = np.real(field.radius) > (np.inf if lit is None else np.real(vignetting.lit_radius(c)))
        if np.any(dark):
            half = np.where(dark, getattr(field_of_view.apart(field, lit), way) / 2, half)
        return product(half, light.object_scale(c, at))

    return of


def _half_fields() -> Iterator[Quantity]:
    """Half of what the sensor sees, lit, of a plane, over its width, height and diagonal."""
    plane = "that the sensor sees, lit, at a distance ahead of the tip or at the focal plane"
    ways: tuple[tuple[Literal["width", "height", "diagonal"], str, str | None], ...] = (
        ("width", f"half the width {plane}, of traced chief rays", "on the focal plane"),
        ("height", f"half the height {plane}", None),
        ("diagonal", "the same to the corner", ""),
    )
    for way, words, line in ways:
        yield Quantity(
            f"field_half_{way}_mm",
            "mm",
            words,
            **_over_lit(_half_field(way)),
            of_rays=lambda rays, at, way=way: rays.half_field(way, at),  # type: ignore[misc]
            at="optional",
            traced=True,
            label=f"field half {way}",
            evaluated=None if line is None else Listed("non_distortion", f"sensor sees, half {way}", line),
        )


def _half_angle(c: Camera, _: Depth, field: SensorField, lit: Lit) -> Array:
    if not c.chain.bends_rays:
        half = field.half[0] if lit is None else np.minimum(field.half[0], lit(field.half[0], np.zeros(())))
        return np.asarray(np.rad2deg(1.0) * light.field_angle(c, half))
    return field_of_view.field_of_view(c, field, lit).width / 2


def _least(values: Array) -> Array:
    return np.asarray(values.min(axis=0))


def _greatest(values: Array) -> Array:
    return np.asarray(values.max(axis=0))


def _defocus_px(c: Camera, _: Depth) -> Array:
    return c.d * light.microlens_defocus(c) / c.q


def _behind_lens(c: Camera) -> Number:
    c = c.cold
    return c[PATHS["d_1"]] + c[PATHS["d_2"]] + c.hiatus


def _diameters(c: Camera, _: Depth) -> Array:
    c = c.cold
    parts = [place_of(rim.part) for rim in c.openings if rim.size_places]
    return np.stack(np.broadcast_arrays(*(2 * ClearAperture.of(c.numbers, part).reach for part in parts)))


def _resolved(level: float) -> Callable[[Camera, Depth], Array]:
    def of(c: Camera, at: Depth) -> Array:
        on_array = resolution.axial_limit(c, image_rate(c, at), level, at)
        return ratio(on_array, light.object_scale(c, at))

    return of


def _nyquist(c: Camera, at: Depth) -> Array:
    return ratio(resolution.fold(c), light.object_scale(c, at))


def image_rate(c: Camera, at: Depth | Array) -> Array:
    """Way on the array per way on the sensor that a point `at` a distance moves from view to view."""
    if at is None:
        return np.zeros(c.shape)[()]
    return np.asarray(light_field.pupil_shear(c, depth_at(c, at)) * ratio(c.seen.A, c.seen.d_2))


def _angles(start: Literal["entrance pupil", "tip"]) -> Iterator[Quantity]:
    """Angles of view over the field's diagonal, width and height."""
    from_tip = start == "tip"

    def of(c: Camera, field: SensorField, at: Depth, lit: Lit) -> field_of_view.Across:
        if from_tip:
            return field_of_view.tip_field_of_view(c, field, at, lit)
        return field_of_view.field_of_view(c, field, lit)

    medium = "at a distance ahead of it or at the focal plane" if from_tip else "in the medium of the scene"
    for part, way, label, seen in (
        ("", "diagonal", "full", "full (diagonal)"),
        ("width_", "width", "horizontal", "horizontal"),
        ("height_", "height", "vertical", "vertical"),
    ):
        yield Quantity(
            f"{'tip_' if from_tip else ''}field_of_view_{part}deg",
            "deg",
            f"full angle of view over the field's {way}, as far as it is lit, from the {start}, {medium}",
            **_over_lit(lambda c, at, field, lit, way=way: np.asarray(getattr(of(c, field, at, lit), way))),  # type: ignore[misc]
            label=f"field of view{' from the tip' if from_tip else ''}, {label}",
            sheet=Listed(
                "Field of view",
                f"from the {'distal ' if from_tip else ''}{start}, {seen}",
                "" if part else _ahead_of_tip if from_tip else "ISO 8600-3, method B: the FAP, as the scene sees it",
            ),
            positive=False,
            least=0.0,
            most=180.0,
            monotone=False,
            numeric=True,
            at="optional" if from_tip else "never",
            of_rays=lambda rays, at, way=way: rays.angle(way, at, from_tip=from_tip),  # type: ignore[misc]
        )


def _ahead_of_tip(c: Camera) -> str:
    return f"of what is seen {number(float(field_of_view.focus_ahead(c)), 4)} mm ahead of it"


_NEITHER: dict[str, Any] = {"positive": False, "monotone": False, "numeric": True}
_SHARP: dict[str, Any] = {**_NEITHER, "of_views": True, "least": 0.0}


def _of_types(form: Callable[[Camera, Array], Array], best: Any) -> Callable[[Camera, Any], Array]:
    """Number at a distance, of those microlenses that show it best."""

    def of(c: Camera, at: float) -> Array:
        values = (form(one, focused.inverse_virtual_depth(c, at)) for one in c.microlens_types)
        return np.asarray(best(np.broadcast_arrays(*values), axis=0))

    return of


def _depth_of_field(prefix: str, kind: depth_of_field.Kind, image: str, row: str, remark: str) -> Iterator[Quantity]:
    """Both ends of the depth of field of an image."""
    beyond: dict[str, Any] = {"infinite": True, "past_infinity": lambda c, _: depth_of_field.past_infinity(c, kind)}
    for k, end in enumerate(("near", "far")):
        yield Quantity(
            f"{prefix}depth_of_field_{end}_mm",
            "mm",
            f"{end} end of the depth of field of {image}, ahead of the tip: a point spreads over one microlens pitch",
            lambda c, _, k=k: depth_of_field.depth_of_field(c, kind)[k],  # type: ignore[misc]
            label=f"depth of field{' of a view' if prefix else ''}, {end}",
            sheet=Listed("Distances", f"{row}, {end}", "" if k else remark),
            **_SHARP,
            **(beyond if k else {}),
        )


def _hyperfocal(prefix: str, kind: depth_of_field.Kind, image: str) -> Quantity:
    """Hyperfocal distance of an image."""
    return Quantity(
        f"{prefix}hyperfocal_mm",
        "mm",
        f"nearest focal plane ahead of the tip with which {image} is sharp to infinity",
        lambda c, _: depth_of_field.hyperfocal(c, kind),
        label=f"hyperfocal distance{' of a view' if prefix else ''}",
        sheet=Listed("Distances", remark="nearest focus that is sharp to infinity"),
        **_SHARP,
    )


PREDICTED_NOISE = "depth noise (bound)"
"""Depth noise where light, noise and texture tell the disparity error."""


def noise_words(given: bool) -> str:
    """Name of depth noise; where the design gives the disparity error it is no bound of anything."""
    return "depth noise, disparity error as given" if given else PREDICTED_NOISE


def _depth_remark(depth: Any) -> str:
    """Disparity error that the depth noise is told for."""
    error = f"1 sigma, for {number(depth.sigma_disparity_pitches, 3)} pitch of disparity error"
    return error + (", as the design gives it" if depth.assumes is None else ", predicted from:")


def _views_remark(c: Camera) -> str:
    return f"pixels across a microlens image; {number(float(light.independent_views(c)), 3)} of them independent"


def _tube_remark(c: Camera) -> str:
    unfolded = ", unfolded" if c.chain.folding else ""
    if tube.OUTER in c.numbers:
        return tube.head(c) or f"of the tube about clear apertures and sensor{unfolded}; {tube.walls(c)[1]}"
    widest = max(tube.housed(c), key=lambda part: float(part.width)).name
    counted = f"of the narrowest tube about clear apertures and sensor{unfolded}, widest: {widest}"
    return f"{counted}; {tube.uncounted(c)}; mounts come on top"


def _inserted_remark(c: Camera) -> str:
    walls = f"; {' '.join(tube.walls(c))}" if tube.LENGTH in c.numbers else ""
    return f"at its widest, of {tube.inserted(c)}{walls}"


def _length_remark(c: Camera) -> str:
    turning = " and ".join(dict.fromkeys(part.kind for part in c.chain.folding))
    unfolded = f", unfolded along the light: the housing turns with the {turning}" if turning else ""
    between = f", H to H' of the main lens ({number(float(c.cold.hiatus), 4)} mm) in it" if c.hiatus else ""
    cold = tube.cold_words(c)
    return f"tip to sensor{between}{unfolded}{cold and f'; {cold}'}"


def _centre_shift(images: MicrolensImages) -> Number:
    """Chief ray's image against that through the lens's centre, along the field [px]."""
    camera, radius = images.camera, np.hypot(images.x, images.y)
    off = radius > 0
    cos = np.where(off, images.x / np.where(off, radius, 1), 1.0)
    sin = np.where(off, images.y / np.where(off, radius, 1), 0.0)
    x0, y0 = images.chief
    x1, y1 = images.through_lens
    return ((x1 - x0) * cos + (y1 - y0) * sin) / camera.q


_ROUND: dict[str, Any] = {**_NEITHER, "least": 0.0, "lit": True}


_EVERY = (
    # Pupils.
    Quantity(
        "aperture_constant",
        "",
        "H",
        _whole(lambda c: c.seen.H),
        equation="Eq. 3",
        monotone=False,
        label="aperture constant H",
        evaluated=Listed("", remark="Eq. 3: d_f/(d_f - d_3)"),
    ),
    Quantity(
        "inverse_aperture_constant",
        "",
        "1/H",
        _whole(lambda c: c.seen.inverse_H),
        equation="Eq. 3",
        label="1/H",
        evaluated=Listed("", None),
    ),
    Quantity(
        "vergence_at_mla_per_mm",
        "1/mm",
        "1/L of the exit pupil: 0 where telecentric",
        _whole(lambda c: c.seen.vergence),
        positive=False,
        bent_in_f=True,
        label="exit-pupil vergence 1/L",
        evaluated=Listed(
            "exit_pupil",
            "its vergence at the MLA, 1/L",
            "0 where telecentric",
            text=lambda value: f"{number(value)} /mm",
        ),
    ),
    Quantity(
        "telecentric_offset_mm",
        "mm",
        "d_3 - f: 0 where telecentric",
        _whole(lambda c: c.seen.d_3 - c.f),
        positive=False,
        label="distance from telecentric, d_3 - f",
    ),
    # f-numbers.
    Quantity(
        "f_number_microlens",
        "",
        "working f-number of a microlens, d_2/d",
        _whole(f_number.microlens_f_number),
        label="microlens f-number d_2/d",
        evaluated=Listed("f_number", "microlens d_2/d", key="microlens"),
    ),
    Quantity(
        "f_number_microlens_lens",
        "",
        "a microlens's own f-number, f_ml/d",
        lambda c, _: np.asarray(c.f_ml / c.d),
        monotone=False,
        label="microlens f-number f_ml/d",
        evaluated=Listed("f_number", None, key="microlens_lens"),
    ),
    Quantity(
        "f_number_pupil",
        "",
        "d_1/(D_F H)",
        _whole(f_number.pupil_f_number),
        equation="Eq. 8",
        label="pupil f-number",
        evaluated=Listed("f_number", "pupil d_1/(D_F H)", "Eq. 8: should equal the microlens's", key="pupil"),
    ),
    Quantity(
        "f_number_view",
        "",
        "f-number of an ordinary camera that is sharp as deep as one view, d_2/(q + λ d_2/d); a refocused image's is "
        "f_number_pupil",
        _whole(depth_of_field.view_f_number),
        monotone=False,
        label="f-number of one view",
        evaluated=Listed(
            "f_number",
            "one view d_2/(q + λ d_2/d)",
            "sharp as deep as that; a refocused image as the pupil's",
            key="view",
        ),
    ),
    Quantity(
        "f_number_main_lens",
        "",
        "d_1/D",
        _whole(f_number.main_lens_f_number),
        equation="Eq. 9",
        label="main-lens f-number",
        evaluated=Listed(
            "f_number", "main lens alone d_1/D", "Eq. 9: the traditional match, wrong behind a bore", key="main_lens"
        ),
    ),
    Quantity(
        "fill_factor",
        "",
        "microlens-image diameter over pitch: 1 where images just touch",
        _whole(f_number.fill_factor),
        lambda images: images.diameter / images.pitch,
        equation="Eq. 7",
        label="image fill",
        digits=6,
        evaluated=Listed("f_number", remark="Eq. 7, exact: image diameter over image pitch"),
    ),
    Quantity(
        "mismatch_px",
        "px",
        "microlens-image diameter less pitch: overlap above 0, gap below",
        _whole(f_number.mismatch_px),
        lambda images: (images.diameter - images.pitch) / images.camera.q,
        positive=False,
        monotone=False,
        label="f-number mismatch",
        evaluated=Listed("f_number", "mismatch", "positive: neighbours overlap"),
    ),
    # Field.
    Quantity(
        "undistorted_field_mm",
        "mm",
        "largest undistorted object radius at the focal plane, in the worst direction: of a traced chief ray, "
        "what rims cut to first order; infinite where any field is",
        lambda c, _: vignetting.on_focal_plane(c, vignetting.undistorted_radii(c)),
        of_rays=lambda rays, _: rays.undistorted(),
        equation="Eq. 6",
        positive=False,
        least=0.0,
        worst=_least,
        monotone=False,
        infinite=True,
        label="undistorted field radius",
        evaluated=Listed("non_distortion", "undistorted object radius", "Eq. 6, a half-field", key="x0_max_mm"),
    ),
    *_half_fields(),
    Quantity(
        "non_distortion_room_mm",
        "mm",
        "clearance of the pencil from the nearest rim, below 0 where it is cut; of the whole camera at the field's "
        "corner, or the rim of a round field that is required",
        of=lambda c, _: vignetting.corner_room(c, field_of_view.judged_field(c)),
        over=lambda c, _, field: vignetting.corner_room(c, field),
        local=lambda images: images.clearance,
        equation="Eqs. 5-6",
        positive=False,
        worst=_least,
        label="undistorted-field clearance",
        evaluated=Listed(
            "non_distortion",
            "clearance at the corner",
            lambda field: f"pencil to the rim of {the(field.nearest_rim)}",
            key="room_at_corner_mm",
        ),
    ),
    *_angles("entrance pupil"),
    *_angles("tip"),
    Quantity(
        ROUND_ANGLE,
        "deg",
        "full angle of the widest round field about the axis all of which the sensor sees, lit, from the "
        "entrance pupil, in the medium of the scene",
        **_over_field(lambda c, _, field: field_of_view.round_field_of_view(c, vignetting.lit_field(c, field))),
        of_rays=lambda rays, at: rays.round_field(at, angle=True),
        label="round field of view",
        most=180.0,
        **_ROUND,
    ),
    Quantity(
        ROUND_RADIUS,
        "mm",
        "radius of the largest circle about the axis all of which the sensor sees, lit, at a distance "
        "ahead of the tip or at the focal plane",
        **_over_field(lambda c, at, field: field_of_view.round_object_radius(c, vignetting.lit_field(c, field), at)),
        of_rays=lambda rays, at: rays.round_field(at, angle=False),
        at="optional",
        label="round field radius",
        **_ROUND,
    ),
    Quantity(
        "field_half_angle_deg",
        "deg",
        "half the angle of view along the width, as far as it is lit, from the entrance pupil, in the scene's medium",
        **_over_lit(_half_angle),
        monotone=False,
        traced=True,
        label="half angle of view",
        most=90.0,
    ),
    Quantity(
        "direction_of_view_deg",
        "deg",
        "angle between the tube's axis and the chief ray of the field's middle",
        **_over_field(lambda c, _, field: field_of_view.direction_of_view(c, field)),
        positive=False,
        least=0.0,
        most=180.0,
        monotone=False,
        numeric=True,
        label="direction of view",
        sheet=Listed("Field of view", remark="0 is straight ahead"),
    ),
    Quantity(
        "entrance_pupil_diameter_mm",
        "mm",
        "diameter of the entrance pupil, the aperture stop as the scene sees it: D_F where nothing bends light before",
        _whole(field_of_view.entrance_pupil_diameter),
        label="entrance pupil, diameter",
        evaluated=Listed("entrance_pupil", key="diameter_mm"),
        sheet=Listed("Field of view", remark="the aperture stop, as the scene sees it"),
    ),
    Quantity(
        "entrance_pupil_ahead_mm",
        "mm",
        "distance from the tip to the entrance pupil; below 0 where it lies behind the tip",
        _whole(field_of_view.entrance_pupil_ahead),
        positive=False,
        monotone=False,
        label="entrance pupil, ahead of the tip",
        evaluated=Listed("entrance_pupil", remark="below 0: behind the tip", key="ahead_of_tip_mm"),
        sheet=Listed("Field of view", remark="below 0: behind the tip"),
    ),
    Quantity(
        "object_magnification",
        "",
        "millimetres on the array per millimetre on a plane at a distance ahead of the tip, or the focal plane",
        lambda c, at: ratio(1.0, light.object_scale(c, at)),
        at="optional",
        monotone=False,
        label="magnification, array to object",
        sheet=Listed("Object field", "magnification", "array over object"),
    ),
    Quantity("magnification", "", "m = d_1/d_f", _whole(lambda c: c.seen.m), label="magnification"),
    # Microlens images.
    Quantity(
        "image_diameter_mm",
        "mm",
        "diameter of the disc as large as the uncut microlens image",
        _whole(exit_pupil.microlens_image_diameter),
        lambda images: images.diameter,
        label="microlens-image diameter",
        evaluated=Listed(
            "microlens_image", "diameter", lambda image: f"{number(image.diameter_px)} px", key="diameter_mm", text=_um
        ),
    ),
    Quantity(
        "image_diameter_px",
        "px",
        "the same in pixels: geometric views",
        _whole(light.geometric_views),
        lambda images: images.diameter / images.camera.q,
        label="microlens-image diameter",
        evaluated=Listed("microlens_image", None, key="diameter_px"),
    ),
    Quantity(
        "image_pitch_mm",
        "mm",
        "distance between neighbouring microlens images, below 0 where their order is reversed",
        _whole(exit_pupil.microlens_image_pitch),
        lambda images: images.pitch,
        positive=False,
        monotone=False,
        label="microlens-image pitch",
        evaluated=Listed(
            "microlens_image",
            "pitch",
            lambda image: "images in reversed order" if image.pitch_mm < 0 else "",
            key="pitch_mm",
            text=_um,
        ),
    ),
    Quantity(
        "centre_shift_px_per_microlens",
        "px",
        "how far the image centre lies inside that through the lens's centre, per microlens off axis",
        _whole(exit_pupil.centre_shift_per_microlens),
        equation="Eq. 4",
        positive=False,
        label="image-centre shift per microlens",
        evaluated=Listed(
            "microlens_image", "centre shift", "Eq. 4", text=lambda value: f"{number(value)} px per microlens"
        ),
    ),
    # Microlens images over the field.
    Quantity(
        "centre_shift_px",
        "px",
        "how far the image centre lies inside that through the lens's centre",
        None,
        _centre_shift,
        equation="Eq. 4",
        label="image-centre shift",
        positive=False,
    ),
    Quantity(
        "kept_fraction",
        "",
        "area of the microlens image over that of the uncut FAP",
        None,
        lambda images: images.shapes.kept_fraction,
        label="unvignetted fraction",
        most=1.0,
    ),
    Quantity(
        "image_area_mm2",
        "mm^2",
        "area of the microlens image",
        None,
        lambda images: images.shapes.area,
        label="microlens-image area",
    ),
    Quantity(
        "axis_ratio",
        "",
        "minor over major axis of the microlens image's second moments; undefined where dark",
        None,
        lambda images: np.where(images.shapes.lit, images.shapes.axis_ratio, np.nan),
        label="axis ratio",
        most=1.0,
    ),
    Quantity(
        "distortion_percent",
        "%",
        "image height against that of a flat object drawn without distortion, of traced chief rays; below 0 is "
        "barrel-shaped",
        None,
        lambda images: 100 * (ratio(1.0, np.asarray(images.stretch[1], float)) - 1),
        positive=False,
        least=-100.0,
        label="distortion",
    ),
    Quantity(
        "local_magnification",
        "",
        "millimetres on the array per millimetre at the focal plane, along the field's radius",
        None,
        lambda images: ratio(1.0, light.object_scale(images.camera) * np.asarray(images.stretch[0], float)),
        label="local magnification",
    ),
    Quantity(
        "relative_illumination",
        "",
        "light of a microlens against an uncut one on the axis: what stops leave, times cos^4 or what a mapping says, "
        "through elements to first order; traced behind a real lens",
        None,
        lambda images: images.illumination,
        label="relative illumination",
    ),
    Quantity(
        "spot_pitches",
        "pitches",
        "rms radius on the array of the light of the point in focus that the chief ray comes from; of rays alone, none "
        "behind an ideal lens",
        None,
        lambda images: images.spot_pitches,
        positive=False,
        least=0.0,
        label="blur of the lens",
    ),
    # Sampling and diffraction.
    Quantity(
        "views_geometric",
        "",
        "pixels across a microlens image",
        _whole(light.geometric_views),
        of_views=True,
        label="pixels across a microlens image",
        digits=4,
        evaluated=Listed("sampling", "views across a microlens image", "pixels"),
        sheet=Listed("Sampling", "views across", _views_remark),
    ),
    Quantity(
        "views_independent",
        "",
        "4 N_F: views per axis that diffraction leaves",
        _whole(light.independent_views),
        of_views=True,
        label="independent views",
        digits=3,
        evaluated=Listed("sampling", "independent views per axis", "4 N_F: what diffraction leaves"),
    ),
    Quantity(
        "fresnel_number",
        "",
        "N_F = d²/(4 lambda d_2)",
        _whole(light.fresnel_number),
        label="Fresnel number",
        digits=3,
        evaluated=Listed("diffraction", "Fresnel number of a microlens", "d²/(4 λ d_2)"),
    ),
    Quantity(
        "airy_radius_px",
        "px",
        "1.22 lambda d_2/d on the sensor",
        lambda c, _: light.airy_radius(c) / c.q,
        label="Airy radius",
        digits=4,
        evaluated=Listed("diffraction", "Airy radius on the sensor"),
    ),
    Quantity(
        "lateral_samples",
        "",
        "microlenses across the width that the sensor sees",
        **_over_field(lambda c, _, field: ratio(2 * field.half[0], c.d)),
        label="microlenses across",
        evaluated=Listed(
            "sampling", "microlenses across the sensor", value=lambda count: math.floor(float(count) + 1e-9), text=str
        ),
    ),
    Quantity(
        "object_sample_mm",
        "mm",
        "footprint of one microlens, at a distance ahead of the tip or at the focal plane",
        lambda c, at: product(c.d, light.object_scale(c, at)),
        at="optional",
        of_views=True,
        label="object sample",
        evaluated=Listed("sampling", remark="one microlens at the focal plane"),
        sheet=Listed("Object field", remark="one microlens"),
    ),
    Quantity(
        "depth_window_mm",
        "mm",
        "side on the object of the square of depth.window microlenses that one depth comes from, at a distance ahead "
        "of the tip or at the focal plane",
        lambda c, at: product(c["depth.window"] * c.d, light.object_scale(c, at)),
        at="optional",
        of_views=True,
        label="window of one depth",
    ),
    Quantity(
        "view_baseline_mm",
        "mm",
        "distance on the FAP between neighbouring pixels' views, q d_1/(H d_2)",
        _whole(light.view_baseline),
        equation="Eq. 2",
        of_views=True,
        label="view baseline",
        evaluated=Listed("sampling", remark="one pixel, on the FAP"),
    ),
    Quantity(
        "microlens_defocus_px",
        "px",
        "ray blur of microlens defocus, d d_2 |1/f_ml - 1/d_2 - 1/L|",
        lambda c, at: np.abs(_defocus_px(c, at)),
        positive=False,
        least=0.0,
        bent_in_f=True,
        signed=_defocus_px,
        label="microlens defocus",
    ),
    # Sharpness over depth.
    Quantity(
        "mtf50_lp_per_mm",
        "lp/mm",
        "detail of which the refocused image shows half the contrast, on the axis, at a distance ahead of the tip or "
        "at the focal plane",
        _resolved(0.5),
        of_rays=lambda rays, at: rays.detail(0.5, at),
        at="optional",
        monotone=False,
        numeric=True,
        of_views=True,
        label="resolution, MTF 50 %",
    ),
    Quantity(
        "detail_lp_per_mm",
        "lp/mm",
        "finest detail that the refocused image shows as what it is, on the axis: with half its contrast, and no finer "
        "than its Nyquist frequency",
        lambda c, at: np.minimum(_resolved(0.5)(c, at), _nyquist(c, at)),
        of_rays=lambda rays, at: rays.usable(at),
        at="optional",
        monotone=False,
        numeric=True,
        of_views=True,
        label="detail",
    ),
    Quantity(
        "mtf10_lp_per_mm",
        "lp/mm",
        "the same of a tenth of the contrast",
        _resolved(0.1),
        of_rays=lambda rays, at: rays.detail(0.1, at),
        at="optional",
        monotone=False,
        numeric=True,
        of_views=True,
        label="resolution, MTF 10 %",
    ),
    Quantity(
        "fold_lp_per_mm",
        "lp/mm",
        "Nyquist frequency of one sample a microlens: finer detail aliases",
        _nyquist,
        at="optional",
        monotone=False,
        of_views=True,
        label="Nyquist frequency",
    ),
    Quantity(
        "blur_pitches",
        "pitches",
        "spread over the array of a point at a distance ahead of the tip",
        lambda c, at: np.abs(light_field.rim_disparity(c, depth_at(c, at))),
        positive=False,
        least=0.0,
        at="needed",
        signed=lambda c, at: light_field.rim_disparity(c, depth_at(c, at)),
        label="defocus blur",
    ),
    # Focused microlenses, of several types the one that shows a plane best.
    *(
        Quantity(
            name,
            unit,
            f"{words}, at a distance ahead of the tip",
            _of_types(of, np.min if unit else np.max),
            label=name.removesuffix("_px").replace("_", " "),
            at="needed",
            **_NEITHER,
        )
        for name, unit, of, words in (
            ("virtual_depth", "", lambda _, v: ratio(1.0, v), "a/d_2 of a plane's image, below 0 behind the array"),
            ("microlens_blur_px", "px", focused.point_blur, "width over which a microlens spreads a point"),
            ("seen_by", "", focused.seen_by, "microlenses across that see a point"),
            ("resolution_ratio", "", focused.resolution_ratio, "pixels of a refocused image for one of the sensor's"),
        )
    ),
    # Distances.
    Quantity(
        "working_distance_mm",
        "mm",
        "from the bore's tip to the focal plane",
        _whole(field_of_view.focus_ahead),
        positive=False,
        least=0.0,
        label="working distance",
        sheet=Listed("Distances", remark="tip to focal plane"),
    ),
    *_depth_of_field("view_", "view", "a single view", "depth of field, one view", "sharp unrefocused"),
    *_depth_of_field("", "refocused", "the image", "depth of field, refocused", "sharp with the focal plane"),
    _hyperfocal("", "refocused", "the image"),
    _hyperfocal("view_", "view", "a single view"),
    # Depth.
    Quantity(
        "disparity_pitches_per_mm",
        "pitches/mm",
        "disparity between the FAP's rims per depth, at a distance ahead of the tip or at the focal plane",
        lambda c, at: light_field.disparity_rate(c, depth_at(c, at)) / plane_at(c, at).depth,
        at="optional",
        monotone=False,
        of_views=True,
        label="disparity per depth",
        evaluated=Listed("depth", "disparity", "between the FAP's rims"),
    ),
    Quantity(
        "sigma_z_mm",
        "mm",
        "depth noise, at a distance ahead of the tip or at the focal plane: the standard error that light, noise and "
        "texture leave, a bound, or that of a given disparity error; not what is to be expected, which is u_z_mm",
        depth_error,
        at="optional",
        monotone=False,
        monotone_with="depth.disparity_error",
        numeric=True,
        of_views=True,
        label="depth noise σ_Z",
        evaluated=Listed("depth", PREDICTED_NOISE, _depth_remark),
    ),
    Quantity(
        "u_z_mm",
        "mm",
        "depth, expected: combined standard uncertainty at a distance ahead of the tip or at the focal plane, of "
        "noise, view mismatch, veil and the range of temperatures; that of the lengths comes on top",
        expected_error,
        at="optional",
        monotone=False,
        numeric=True,
        of_views=True,
        label="depth, expected, u_Z",
    ),
    Quantity(
        EXPANDED,
        "mm",
        "expanded uncertainty U of depth, k = 2, as data sheets print it: twice u_z_mm, at a distance ahead of the tip "
        "or at the focal plane",
        lambda c, at: COVERAGE * expected_error(c, at),
        at="optional",
        monotone=False,
        numeric=True,
        of_views=True,
        label="depth, expected, U",
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
        of_views=True,
        label="disparity error",
        evaluated=Listed("depth", None),
    ),
    Quantity(
        "sigma_z_at_field_mm",
        "mm",
        "depth noise at the focal plane, as the field's own microlens image is cut; through windows to first order",
        None,
        depth_error_at_fields,
        numeric=True,
        of_views=True,
        label="depth noise σ_Z at the field",
    ),
    Quantity(
        "u_z_at_field_mm",
        "mm",
        "depth, expected, at the focal plane, as the field's own microlens image is cut; through windows to first "
        "order",
        None,
        lambda images: errors_at_fields(images, bound=False)[-1],
        numeric=True,
        of_views=True,
        label="depth, expected, u_Z at the field",
    ),
    # Light.
    Quantity(
        "pixel_electrons",
        "e-",
        "electrons in a pixel that its microlens lights fully, where the scene is as bright as on average, at a "
        "distance ahead of the tip or at the focal plane",
        photometry.electrons,
        at="optional",
        monotone=False,
        label="electrons a pixel",
    ),
    Quantity(
        "sensor_angle_deg",
        "deg",
        "angle to the sensor's normal of the steepest ray through a microlens's middle, at the field's corner",
        **_over_field(lambda c, _, field: np.rad2deg(np.arctan(photometry.sensor_slope(c, field.radius)))),
        monotone=False,
        numeric=True,
        label="steepest ray at the sensor",
        most=90.0,
    ),
    Quantity(
        "light_sr",
        "sr",
        "solid angle of the pupil seen from the array, pi/4 (D_F/A)^2: the light a pixel gets",
        _whole(light.solid_angle),
        label="light a pixel gets",
    ),
    # Body.
    Quantity(
        tube.INSERTED,
        "mm",
        "of what is inserted: the tube stated, over its length, wider where parts and walls in it need it; without a "
        "tube all of the camera; at 20 °C",
        lambda c, _: tube.diameters(c, whole=False),
        worst=_greatest,
        monotone=False,
        label="inserted width",
        sheet=Listed("Body", remark=_inserted_remark),
    ),
    Quantity(
        tube.WHOLE,
        "mm",
        "of the whole camera: the tube stated, wider where parts and walls need it, and what lies behind it; without a "
        "tube the narrowest, sensor by diagonal; at 20 °C",
        lambda c, _: tube.diameters(c, whole=True),
        worst=_greatest,
        monotone=False,
        label="outer diameter",
        sheet=Listed("Body", remark=_tube_remark),
    ),
    Quantity(
        "largest_diameter_mm",
        "mm",
        "the widest of lens, FAP and stops, at 20 °C",
        _diameters,
        worst=_greatest,
        label="largest diameter",
    ),
    Quantity(
        "total_length_mm",
        "mm",
        "from the bore's tip to the sensor, at 20 °C",
        _whole(lambda c: c.cold.tip + _behind_lens(c)),
        label="length from tip to sensor",
        sheet=Listed("Body", "length", _length_remark),
    ),
    Quantity(
        "camera_length_mm",
        "mm",
        "from the main lens to the sensor, at 20 °C",
        _whole(_behind_lens),
        label="length from lens to sensor",
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
QUANTITIES = {quantity.name: quantity for quantity in _EVERY}
"""Every quantity by its name; the paper's symbols too."""

_centre_error = attrgetter("centre_error")
DECODED = {
    metric.name: metric
    for metric in (
        Quantity(
            "blur_pitches",
            "pitches",
            "rms radius on the array of an object point's light, in microlens pitches; of rays alone",
            local=attrgetter("blur_pitches"),
            label=QUANTITIES["blur_pitches"].label,
        ),
        Quantity(
            "centre_error_px",
            "px",
            "distance of the image centre from where the decoder believes it",
            local=lambda builds: np.hypot(*_centre_error(builds)),
            label="image-centre error",
        ),
        *(
            Quantity(
                f"centre_error_{axis}_px",
                "px",
                f"the same along {axis}",
                local=lambda builds, k=k: _centre_error(builds)[k],  # type: ignore[misc]
                label=f"image-centre error along {axis}",
                positive=False,
            )
            for k, axis in enumerate("xy")
        ),
        Quantity(
            "depth_error_mm",
            "mm",
            "decoded depth less true depth of a point on the field's chief ray",
            local=attrgetter("depth_error_mm"),
            of_views=True,
            label="depth error",
            positive=False,
        ),
    )
}
"""Metrics of tolerance studies alone: errors of a decoder that takes a build for another."""
_VARIABLES = {"main_lens.bending": "bending of the lens", "working_distance": "working distance"}
_NAME = re.compile(r"(?<![\w.])([A-Za-z]\w*(?:\.\w+)*)(?:@(\d+))?(?![\w@])")


def bound_note(names: Iterable[str], given: bool) -> str:
    """Sentence on what depth noise is not, where one of the quantities is that; else "". `given` as `noise_words`."""
    if not any(name in ("sigma_z_mm", "sigma_z_at_field_mm") for name in names):
        return ""
    if given:
        return "Depth noise is that of the disparity error that the design gives, whatever light and texture: no bound."
    return "Depth noise is the bound that light, noise and texture set; what depth is expected to have is u_Z."


def in_words(text: str) -> str:
    """A sentence or a label with names put into words: ``sigma_z_mm at 40 mm``, ``fill_factor@2``."""

    def worded(match: re.Match[str]) -> str:
        known = QUANTITIES.get(match[1]) or DECODED.get(match[1])
        words = _VARIABLES.get(match[1], "") if known is None else known.label
        return words + (f" at field {match[2]}" if match[2] else "") if words else match[0]

    return _NAME.sub(worded, text).replace(" >= ", " ≥ ").replace(" <= ", " ≤ ")
