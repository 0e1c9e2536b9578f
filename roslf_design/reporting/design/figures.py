"""The figures of a design report: each a picture with a caption that says what to see and what follows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ...camera import Camera
from ...design import Design
from ...drawing.picture import PAGE, Picture, beside
from ...drawing.solid import NoViewerError, library, outlines, scene_data
from ...evaluation import default_fields
from ...evaluation.groups import RealLens
from ...evaluation.result import Evaluation, depth_basis
from ...imaging.transfer import encircled
from ...lenses.glass import ROOM
from ...theory.quantities import noise_words
from ...words import number, spaced, the
from ..blocks import Figure
from ..lens_words import lens_words
from .curves import DRAWN, KnownLengths, counted_lengths, depth_precision, matching_plane
from .effects import effects_budget
from .field import field_map, field_maps, lens_images, lens_over_field
from .instrument import instrument_scene, scale_drawing, tube_words
from .microlens import microlens_image, microlens_images, rays_and_waves
from .rays import cells, dimensions, is_centred, meridional, ray_diagrams, ray_words, scale_words, unfolded_words

SMALL = 0.6
"""Width of the small drawing to scale, in pages."""
ROWS = 48.0
"""Room that names take above the small drawing from which it is drawn as wide as the page [px]."""
PLACES = ("centre", "edge", "corner")
"""The fields that a report looks at."""


def glance(design: Design, views: bool, known: KnownLengths = DRAWN) -> Figure:
    """Figure of the whole: camera, rays, image of one microlens and, where pixels are `views`, depth over distance."""
    low = 250.0
    system = meridional(design, (PAGE, 210.0), key=False)
    parts = [microlens_image(design, (0.0, 0.0), (270.0, low), name="glance-image", key=False)]
    across, up = system.mapping.per_px
    above = f"Above, {scale_words(across / up)}: the camera in its tube and {ray_words(design)}."
    words = f"{above} Below: the image that the middle microlens paints"
    if views:
        parts.append(depth_precision(design, (PAGE - 270.0, low), known))
        own = "its bound" if design.depth.disparity_error is None else noise_words(True)
        words += f", and depth, expected, over the working range and the distances required, with {own}"
    below = beside("glance-below", "", parts)
    small = _to_scale(design, across < 0.999 * up)
    for drawing in small:
        words += f"; between them, {drawing.title.split(':')[0]}, the camera as it is built"
    picture = beside("glance", f"{design.name} at a glance", [system, *small, below], down=True)
    return replace(Figure.of("glance", "At a glance", f"{words}.", picture), breaks=0.0)


def _to_scale(design: Design, stretched: bool = False) -> list[Picture]:
    """Small drawing to scale of a camera whose axis is folded, or whose section is `stretched`; none of others.

    It is as wide as the page where names in it would stand over each other.
    """
    if not (stretched or Camera.of(design).chain.folds):
        return []
    small = scale_drawing(design, SMALL * PAGE)
    return [small if small.panels[0].box[1] < ROWS else scale_drawing(design, PAGE)]


def _ray_sheet(design: Design, result: Evaluation) -> Figure:
    field = result.non_distortion
    room = number(abs(field.room_at_corner_mm), 3)
    follow = (
        f"Every pencil that fills the FAP passes {the(field.nearest_rim)} with {room} mm clearance at the corner."
        if field.undistorted_in_field
        else f"Outer pencils lose light: {the(field.nearest_rim)} leaves {room} mm too little clearance at the corner."
    )
    plane = (
        "Each field lies in its own meridional plane, turned into the page."
        if is_centred(design)
        else "Drawn in the plane x-z, as decentres and tilts make the sides differ."
    )
    through = ""
    if result.object_space is not None:
        folds = " and ".join(dict.fromkeys(f"{part.kind}s" for part in Camera.of(design).chain.folding))
        bend = f"{folds} unfolded" if folds else "rays bend at its faces"
        through = f" Glass before the lens and about the array is light blue, at its mechanical distances; {bend}."
    caption = (
        "Below, larger, the tip, and array and sensor. Solid rays reach the sensor; dashed orange rays are blocked and "
        "end, with a cross, at what stops them (the outermost of each fan miss the FAP on purpose, to show it at "
        "work). The FAP is black, the main lens and its mount blue. The tube, to the scale of heights, reaches from "
        "tip to sensor: as [tube] states it, else the narrowest about clear apertures and sensor."
        f"{through}{lens_words(design.main_lens.kind).twin} {follow} {plane}"
    )
    return replace(Figure.of("rays", "Meridional ray diagram", caption, ray_diagrams(design)), fixed=True)


def _cells_sheet(design: Design, result: Evaluation) -> Figure:
    f = result.f_number
    touch = (
        "Neighbouring cones touch on the sensor to within a pixel: hardly one is idle or used twice."
        if result.matched
        else "Pixels are too wide to tell neighbouring cones apart."
        if not result.has_views and result.focused is None
        else f"Neighbouring cones overlap by {number(f.mismatch_px, 3)} px: those pixels mix views of two microlenses."
        if f.mismatch_px > 0
        else f"Between neighbouring cones {number(-f.mismatch_px, 3)} px stay dark: sensor area is wasted."
    )
    drift = (
        "The cones stay on their microlenses' axes over the whole array (image-space telecentric)."
        if result.exit_pupil.telecentric
        else f"At the edge the cones lean: images are {number(1e3 * abs(result.microlens_image.pitch_mm))} µm apart, "
        "not the microlens pitch, and decoding has to use that pitch."
    )
    if any(field.status != "full" for field in result.fields[:2]):
        drift += " Hatched cones never come: other rims block that light."
    caption = "Light cones behind five neighbouring microlenses; boxes are pixels. Height and depth differ in scale."
    (centre, _), (edge, _), _ = default_fields(design)
    picture = cells(design, {PLACES[0]: centre, "inside the edge": edge - 3 * design.d})
    return Figure.of("cells", "Zoom on microlens array and sensor", f"{caption} {touch} {drift}", picture)


def _image_sheet(design: Design, result: Evaluation) -> Figure:
    fields = {label: (design, field.x_ml_mm) for label, field in zip(PLACES, result.fields, strict=True)}
    picture, on_sensor = microlens_images(fields)
    follow = (
        "All three are full discs: every microlens sees the whole FAP."
        if all(field.status == "full" for field in result.fields)
        else "What other rims, dashed, cut away is light and views lost there: a cat's eye."
    )
    if on_sensor < 0.999:
        follow += (
            " Where it is hatched there is no sensor: of the outermost images only the share reported as seen falls on "
            "pixels."
        )
    caption = (
        "Ray-optics images, exact: grey is the share of each pixel that the image covers, the solid line its outline, "
        "dashed lines the single rims (those not seen lie outside the view), the green line its own "
        f"cell, the cross its chief ray. {follow} Diffraction, which blurs them over "
        f"{number(result.diffraction.airy_radius_px, 2)} px (Airy radius), is not drawn."
    )
    return Figure.of("images", "Microlens images on their pixels", caption, picture)


def _wave_sheet(design: Design, _: Evaluation) -> Figure:
    light = encircled(Camera.of(design))
    caption = (
        "Left by rays, right by waves: a uniform scene behind the microlens on the axis, before pixels integrate. Of "
        f"one image's light, diffraction leaves {100 * light.disc:.1f} % in the geometric image and "
        f"{100 * light.cell:.1f} % in its cell; the rest lies on the neighbours."
    )
    return Figure.of("waves", "One microlens image by rays and by waves", caption, rays_and_waves(design))


def _map_sheet(design: Design, result: Evaluation) -> Figure:
    fields, line = field_map(design), "line" if Camera.of(design).has_straight_sides else "circle"
    lost, dark = 1 - float(fields.kept.min()), float(np.mean(fields.kept == 0))
    left = (
        "No microlens on the array loses any of the pupil. Arrows"
        if lost == 0
        else f"Left: the pupil is cut outside the Eq. 6 {line}; "
        + (f"{100 * dark:.3g} % of the array gets no light at all" if dark else f"at most it loses {100 * lost:.3g} %")
        + ". Right: arrows"
    )
    shift = result.microlens_image.centre_shift_px_per_microlens
    caption = (
        f"{left} show where each image's centroid lies from its microlens's axis, as decoding meets it. "
        f"Against a camera whose pupil is the main lens, images move by {number(shift, 4)} px per microlens (Eq. 4), "
        f"{number(shift * design.microlens_array.size[0] / 2 / design.d, 3)} px at the array's edge."
        f"{lens_words(design.main_lens.kind).twin}"
    )
    return Figure.of("maps", "Microlens images over the array", caption, field_maps(design, fields))


def lens_sheets(design: Design, result: Evaluation, lens: RealLens) -> tuple[Figure, Figure]:
    """Microlens images and aberrations of a real main lens over the field, and its images beside the thin lens's."""
    edge = lens.fields[1]
    moved = "The sensor's edge has no whole image."
    if edge.shift_px is not None and edge.widening_percent is not None:
        off, wider = number(abs(edge.shift_px[0]), 3), number(edge.widening_percent, 3)
        moved = f"At the sensor's edge images lie {off} px off and are {wider} % wider."
    over = (
        f"Exact rays through {lens.lens}, from the axis to the distance of the sensor's corner. Left: microlens images "
        "against those of an ideal lens of the same focal length (dashed); the shift counts outwards. "
        f"{moved} Middle: how far an object point's light spreads over the array because the focal surfaces are bent "
        "(negative: in front of the array) and colours part. Right: distortion of the object. Images are whole out to "
        f"{number(lens.x_ml_max_mm, 4)} mm on the array; for the thin lens Eq. 6 says "
        f"{number(lens.thin_x_ml_max_mm, 4)} mm."
    )
    beside = (
        f"Outlines of microlens images through {lens.lens} (blue) and through its thin-lens model (dashed), in pixels "
        "from the thin image's centre. Ray optics; diffraction is not drawn."
    )
    places = {label: field.x_ml_mm for label, field in zip(PLACES, result.fields, strict=True)}
    return (
        Figure.of("lens-field", "The real lens over the field", over, lens_over_field(design)),
        Figure.of("lens-images", "Microlens images behind the real lens", beside, lens_images(design, places)),
    )


def _plane_sheet(design: Design, result: Evaluation) -> Figure:
    matched, free = result.matched, result.non_distortion.undistorted_in_field
    where = {
        (True, True): "on the curve and inside the green region: matched and undistorted",
        (True, False): "on the curve but outside the green region: matched, yet its corners are clipped",
        (False, True): "inside the green region but off the curve: undistorted, yet not matched",
        (False, False): "off the curve and outside the green region",
    }[matched, free]
    aside = "" if is_centred(design) else " Decentres are left aside here."
    aside += " All of it is the thin-lens model's." if result.real_lens is not None else ""
    caption = (
        f"All else held, images just touch along the blue curve. The design lies {where}. Moving along the curve keeps "
        f"the match; above it images overlap, below it pixels stay dark.{aside}"
    )
    return Figure.of("plane", "FAP diameter and distance", caption, matching_plane(design, (PAGE, 400)))


def depth_figure(design: Design, known: KnownLengths = DRAWN, more: str = "", tall: float = 220.0) -> Figure:
    """Depth, expected, and its bound over distance, in a picture so tall [px]; `more` is said of them."""
    budget = known.budget(Camera.of(design), None)
    noise = "the bound" if design.depth.disparity_error is None else noise_words(True)
    caption = (
        f"Depth, expected, U (k = 2), {counted_lengths(budget)}: {budget.expanded_words('± ')} at "
        f"the focal plane, which a measurement is to be believed to, and below it {noise}, over the working range and "
        f"all distances that are required or asked for.{more}"
    )
    return Figure.of("depth", "Depth, expected, over distance", caption, depth_precision(design, (PAGE, tall), known))


def depth_sheet(design: Design, result: Evaluation, known: KnownLengths = DRAWN) -> Figure:
    """Depth, expected, and its bound over distance, with what they hang on."""
    depth, basis = result.depth, depth_basis(result.depth.assumes)
    behind = number(design.d_f - design.d_3 - result.answer.working_distance_mm, 4, zero=1e-9)
    where = "at the tip" if behind == "0" else f"{behind} mm behind the tip"
    noise = "The bound" if depth.assumes else noise_words(True).capitalize()
    more = (
        f" {noise} is σ_Z = {number(depth.sigma_z_mm, 3)} mm at the focal plane, where the disparity between the FAP's "
        f"rims is known to {number(depth.sigma_disparity_pitches, 3)} microlens pitches ({basis}). Both grow with the "
        f"square of the distance from the FAP ({where}), and further as views blur. The dashed "
        "curve shows how many microlenses an object point spreads over: far from the focal plane views must be "
        "refocused before they are compared."
    )
    return depth_figure(design, known, more, 330.0)


def _effects_sheet(_: Design, result: Evaluation) -> Figure:
    caption = "No effect exceeds its budget for a white scene at the focal plane."
    on = [effect for effect in result.effects if effect.on and effect.estimate != 0 and effect.budget > 0]
    if on:
        largest = max(on, key=lambda effect: abs(effect.estimate) / effect.budget)
        caption = (
            "Bars reach from nothing to the estimate, in units of the budget (logarithmic); blue effects are "
            "simulated, grey ones are small enough to be left out. Largest here: "
            f"{spaced(largest.name)}, {abs(largest.estimate) / largest.budget:.3g} times its budget. For a "
            "white scene at the focal plane."
        )
    return Figure.of(
        "effects-budget", "Effects against their budgets", caption, effects_budget(result.effects, (PAGE, 0))
    )


def _picture_sheet(design: Design, _: Evaluation | None = None) -> Figure:
    """The 3D view, with the scene to turn where the library for that is installed."""
    scene = instrument_scene(design)
    blocked = any(part.colour == "vermillion" for part in scene.parts)
    ends = "Orange rays end at what blocks them. " if blocked else ""
    turning = any(part.length for part in Camera.of(design).chain.folding if part.turn)
    bent = "A prism is drawn as turning light in the middle of its way. " if turning else ""
    caption = (
        "Pencils of the centre, the edge and a corner of the sensor, cut off in front of the bore; the grey plate is "
        f"the FAP, the blue disc the main lens. {ends}{bent}The grey tube {tube_words(design)}."
        f"{lens_words(design.main_lens.kind).twin}"
    )
    sheet = Figure.of("view", "The instrument in three dimensions", caption, outlines(scene))
    try:
        library()
    except NoViewerError as reason:
        return replace(sheet, caption=f"{sheet.caption} It cannot be turned in this page: {reason}.")
    return replace(sheet, scene=scene_data(scene))


def dimensions_sheet(design: Design, _: Evaluation | None = None) -> Figure:
    """The drawing with dimensions, as drawings are: at room temperature."""
    drawn, holds = at_room(design)
    caption = (
        "Elements in their order along the axis. The numbers are the dimensions. Lengths are not to "
        "scale; diameters are to one scale, but for the smallest. d_f, d_3 "
        f"and further stops count from the main lens towards the object, d_1 from it to the microlens array.{holds}"
        + "".join(f" It is {words}." for words in unfolded_words(drawn))
    )
    picture = dimensions(drawn)
    if small := _to_scale(drawn):
        caption += " Below, folded and to scale: as it is built."
        picture = beside("dimensions", picture.title, (picture, *small), down=True)
    return Figure.of("dimensions", "Dimensions", caption, picture)


def at_room(design: Design) -> tuple[Design, str]:
    """Design as drawings and parts lists have it, at room temperature, and a sentence on that where it is used warm."""
    used, drawn = design.environment, design.at_room
    if used is None or used.temperature == ROOM:
        return design, ""
    known = f" Lengths at {ROOM:g} °C; the camera is used at {used.temperature:g} °C"
    known = known if drawn is not design else f" Lengths at {used.temperature:g} °C"
    return drawn, f"{known}, in a {'rigid housing' if used.housing is None else f'housing of {used.housing.words}'}."


SHEETS: dict[str, Callable[[Design, Evaluation], Figure]] = {
    "dimensions": dimensions_sheet,
    "rays": _ray_sheet,
    "cells": _cells_sheet,
    "view": _picture_sheet,
    "images": _image_sheet,
    "waves": _wave_sheet,
    "maps": _map_sheet,
    "plane": _plane_sheet,
    "depth": depth_sheet,
    "effects": _effects_sheet,
}
"""The figures of every design, by name."""
