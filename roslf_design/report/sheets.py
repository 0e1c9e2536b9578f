"""The figures of a design report: each composed from plots, with a caption that says what to see and what follows."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from ..evaluation import default_fields
from ..imaging.encircled import encircled
from ..imaging.figures import draw_microlens_images
from ..words import number, spaced
from .blocks import Figure
from .figures.cells import plot_cells
from .figures.depth_precision import plot_depth_precision
from .figures.dimensions import plot_dimensions
from .figures.effects_budget import plot_effects_budget
from .figures.field_maps import field_map, plot_image_offset, plot_kept_fraction
from .figures.matching_plane import plot_matching_plane
from .figures.microlens_images import image_view, plot_microlens_image
from .figures.ray_diagram import TALLEST, frame_of, instrument_is_small, is_centred, plot_ray_diagram
from .figures.real_lens import (
    lens_curves,
    plot_lens_distortion,
    plot_lens_foci,
    plot_lens_image,
    plot_lens_images_over_field,
)
from .figures.scene_outlines import plot_outlines
from .figures.search_history import plot_search_history
from .figures.style import WIDTH, drawing, to_svg
from .scene3d import instrument_scene
from .viewer import NoViewerError, library, scene_data

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Drawing

    from ..design import Design
    from ..evaluation.result import Evaluation
    from ..optimize.solve import Answer

PLACES = ("centre", "edge", "corner")
"""The fields that a report looks at."""


def ray_sheet(design: Design, result: Evaluation) -> Figure:
    """The meridional section."""
    field = result.non_distortion
    room = number(abs(field.room_at_corner_mm), 3)
    follow = (
        f"Every pencil that fills the FAP passes the {field.limited_by} with {room} mm to spare at the corner."
        if field.undistorted_in_field
        else f"Outer pencils lose light, most at the {field.limited_by}: {room} mm of room are missing at the corner."
    )
    plane = (
        "Each field lies in its own meridional plane, turned into the page."
        if is_centred(design)
        else "Drawn in the plane x-z, as decentres and tilts make the sides differ."
    )
    caption = (
        "Solid rays reach the sensor; dashed orange rays are blocked and end, with a cross, at what stops them (the "
        "outermost of each fan miss the FAP on purpose, to show it at work). The FAP is black, the main lens and its "
        f"mount blue. {follow} {plane}"
    )
    with drawing():
        return compose("rays", "Meridional ray diagram, to scale", caption, draw_ray_diagrams(design))


def draw_ray_diagrams(design: Design) -> Drawing:
    """All of the section and, where that is small in it, the instrument; to be called within `drawing`."""
    views = [False, True] if instrument_is_small(design) else [False]
    heights = [min(TALLEST, frame_of(design, view).height_at(7.2)) for view in views]
    figure = new_drawing(sum(heights) + 0.5 * len(heights) + 0.3)
    rows = figure.subplots(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]
    for ax, view in zip(rows, views, strict=True):
        plot_ray_diagram(design, ax, instrument_only=view)
    shared_legend(figure, rows[:1], "outside upper left")
    return figure


def cells_sheet(design: Design, result: Evaluation) -> Figure:
    """Microlenses and pixels, at the centre and as far out as neighbours still lie before the edge."""
    f = result.f_number
    touch = (
        "Neighbouring cones just touch on the sensor: all pixels are used and none twice."
        if result.verdicts[0].ok
        else f"Neighbouring cones overlap by {number(f.mismatch_px, 3)} px: those pixels mix views of two microlenses."
        if f.mismatch_px > 0
        else f"Between neighbouring cones {number(-f.mismatch_px, 3)} px stay dark: sensor area is wasted."
    )
    drift = (
        "The cones stay on their microlenses' axes over the whole array (image-space telecentric)."
        if result.exit_pupil.telecentric
        else f"At the edge the cones lean: images are {number(1e3 * result.microlens_image.pitch_mm)} µm apart, not "
        "the microlens pitch, and decoding has to use that pitch."
    )
    if any(field.status != "full" for field in result.fields[:2]):
        drift += " Hatched cones never come: other rims block that light."
    seen = "Light cones behind five neighbouring microlenses; boxes are pixels. Height and depth differ in scale."
    (centre, _), (edge, _), _ = default_fields(design)
    with drawing():
        figure = new_drawing(3.3)
        for ax, label, x in zip(figure.subplots(1, 2), PLACES, (centre, edge - 3 * design.d), strict=False):
            plot_cells(design, x, ax)
            ax.set_title(f"{label}, x = {x:.4g} mm")
        return compose("cells", "Zoom on microlens array and sensor", f"{seen} {touch} {drift}", figure)


def image_sheet(design: Design, result: Evaluation) -> Figure:
    """Microlens images of the evaluation's fields."""
    views = [image_view(design, field.x_ml_mm) for field in result.fields]
    follow = (
        "All three are full discs: every microlens sees the whole FAP."
        if all(field.status == "full" for field in result.fields)
        else "What the dashed discs of other rims cut away is light and views lost there: a cat's eye."
    )
    if min(view.on_sensor for view in views) < 0.999:
        follow += (
            " Where it is hatched there is no sensor: of the outermost images only the share told as seen falls on "
            "pixels."
        )
    caption = (
        "Ray-optics images, exact: grey is the share of each pixel that the image covers, the solid line its outline, "
        "dashed lines the discs of the single rims (those not seen lie outside the view), the green line its own "
        f"cell, the cross its chief ray. {follow} Diffraction, which blurs them over "
        f"{number(result.diffraction.airy_radius_px, 2)} px (Airy radius), is not drawn."
    )
    with drawing():
        figure = new_drawing(3.3)
        axes = figure.subplots(1, len(PLACES))
        for ax, label, field, view in zip(axes, PLACES, result.fields, views, strict=True):
            plot_microlens_image(design, field.x_ml_mm, ax, view)
            ax.set_title(f"{label}: {ax.get_title(loc='left')}")
            if ax is not axes[0]:
                ax.set_ylabel("")
        figure.set_figheight(2.95 + 0.2 * shared_legend(figure, axes, "outside lower center"))
        return compose("images", "Microlens images on their pixels", caption, figure)


def wave_sheet(design: Design) -> Figure:
    """One microlens image by rays and by waves."""
    light = encircled(design)
    caption = (
        "Left by rays, right by waves: a uniform scene behind the microlens on the axis, before pixels integrate. Of "
        f"one image's light, diffraction leaves {100 * light.disc:.1f} % in the geometric disc and "
        f"{100 * light.cell:.1f} % in a cell of one image pitch; the rest lies on the neighbours."
    )
    with drawing():
        figure = new_drawing(3.3)
        rays, waves = figure.subplots(1, 2)
        draw_microlens_images(rays, waves, design)
        return compose("waves", "One microlens image by rays and by waves", caption, figure)


def map_sheet(design: Design, result: Evaluation) -> Figure:
    """Kept fraction and image offset over the MLA."""
    fields = field_map(design)
    lost, dark = 1 - float(fields.kept.min()), float(np.mean(fields.kept == 0))
    left = (
        "Left: no microlens on the array loses any of the pupil."
        if lost == 0
        else f"Left: the pupil is cut outside the Eq. 6 circle; {100 * dark:.3g} % of the array gets no light at all."
        if dark > 0
        else f"Left: the pupil is cut outside the Eq. 6 circle; the worst microlens loses {100 * lost:.3g} %."
    )
    shift = result.microlens_image.centre_shift_px_per_microlens
    caption = (
        f"{left} Right: arrows show where each image's centroid lies from its microlens's axis, as decoding meets it. "
        f"Against a camera whose pupil is the main lens, images move by {number(shift, 4)} px per microlens (Eq. 4), "
        f"{number(shift * design.microlens_array.size[0] / 2 / design.d, 3)} px at the array's edge."
    )
    with drawing():
        figure = new_drawing(3.7)
        axes = figure.subplots(1, 2)
        plot_kept_fraction(design, axes[0], fields)
        plot_image_offset(design, axes[1], fields)
        shared_legend(figure, axes[:1], "outside lower center")
        return compose("maps", "Microlens images over the array", caption, figure)


def lens_sheets(design: Design, result: Evaluation) -> tuple[Figure, Figure]:
    """Microlens images and aberrations of a real main lens over the field, and its images beside the thin lens's."""
    lens = result.real_lens
    assert lens is not None
    edge = lens.fields[1]
    moved = (
        f"At the sensor's edge images lie {number(abs(edge.shift_px[0]), 3)} px off and are "
        f"{number(edge.widening_percent, 3)} % wider."
        if edge.shift_px is not None and edge.widening_percent is not None
        else "The sensor's edge has no whole image."
    )
    over = (
        f"Exact rays through {lens.lens}, from the axis to the distance of the sensor's corner. Left: microlens images "
        "against those of an ideal lens of the same focal length (dashed); the shift counts outwards. "
        f"{moved} Middle: how far an object point's light spreads over the array because the focal surfaces are bent "
        "(negative: in front of the array) and colours part. Right: distortion of the object. Images are whole out to "
        f"{number(lens.x_ml_max_mm, 4)} mm on the array; for the thin lens Eq. 6 says "
        f"{number(lens.thin_x_ml_max_mm, 4)} mm."
    )
    beside = (
        f"Outlines of microlens images through {lens.lens} (blue) and through its thin twin (dashed), in pixels from "
        "the thin image's centre. Ray optics; diffraction is not drawn."
    )
    curves = lens_curves(design)
    with drawing():
        field = new_drawing(3.5)
        axes = field.subplots(1, 3)
        for ax, plot in zip(axes, (plot_lens_images_over_field, plot_lens_foci, plot_lens_distortion), strict=True):
            plot(design, ax, curves)
            ax.set_xlabel("microlens off axis [mm]")
        shared_legend(field, axes, "outside lower center", most=4)
        images = new_drawing(3.2)
        axes = images.subplots(1, len(PLACES), sharex=True, sharey=True)
        for ax, label, place in zip(axes, PLACES, result.fields, strict=True):
            plot_lens_image(design, place.x_ml_mm, ax)
            ax.set_title(f"{label}: {ax.get_title(loc='left')}")
        shared_legend(images, axes, "outside lower center")
        return (
            compose("lens-field", "The real lens over the field", over, field),
            compose("lens-images", "Microlens images behind the real lens", beside, images),
        )


def plane_sheet(design: Design, result: Evaluation) -> Figure:
    """The D_F - d_3 plane."""
    matched, free = result.verdicts[0].ok, result.non_distortion.undistorted_in_field
    where = {
        (True, True): "on the curve and inside the green region: matched and undistorted",
        (True, False): "on the curve but outside the green region: matched, yet its corners are clipped",
        (False, True): "inside the green region but off the curve: undistorted, yet not matched",
        (False, False): "off the curve and outside the green region",
    }[matched, free]
    aside = "" if is_centred(design) else " Decentres are left aside here."
    caption = (
        f"All else held, images just touch along the blue curve. The design lies {where}. Moving along the curve keeps "
        f"the match; above it images overlap, below it pixels stay dark.{aside}"
    )
    with drawing():
        figure = new_drawing(3.9)
        plot_matching_plane(design, figure.subplots())
        return compose("plane", "FAP diameter and distance", caption, figure)


def depth_sheet(design: Design, result: Evaluation) -> Figure:
    """Depth precision."""
    depth = result.depth
    caption = (
        f"One standard deviation of depth for {depth.sigma_disparity_pitches:g} microlens pitches of disparity error "
        f"between the FAP's rims: {number(depth.sigma_z_mm, 3)} mm at the focal plane, growing with the square of the "
        f"distance from the FAP (at Z = {design.d_3:.4g} mm). The dashed curve tells how many microlenses an object "
        "point spreads over: far from the focal plane views must be refocused before they are compared."
    )
    with drawing():
        figure = new_drawing(3.2)
        plot_depth_precision(design, figure.subplots(), sigma_disparity=depth.sigma_disparity_pitches)
        return compose("depth", "Depth precision over distance", caption, figure)


def effects_sheet(result: Evaluation) -> Figure:
    """Effects against their budgets."""
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
    with drawing():
        figure = new_drawing(0.9 + 0.27 * max(sum(effect.estimate != 0 for effect in result.effects), 1))
        plot_effects_budget(result.effects, figure.subplots())
        return compose("effects-budget", "Effects against their budgets", caption, figure)


def picture_sheet(design: Design) -> Figure:
    """The 3D view, with the scene to turn where the library for that is installed."""
    scene = instrument_scene(design)
    caption = (
        "Pencils of the centre, the edge and a corner of the sensor, cut off in front of the bore; the grey plate is "
        "the FAP, the blue disc the main lens. Orange rays end at what blocks them. The tube wall is drawn for "
        "orientation and is not part of the design."
    )
    with drawing():
        figure = plot_outlines(scene).figure
        sheet = compose("view", "The instrument in three dimensions", caption, figure)  # type: ignore[arg-type]
    try:
        library()
    except NoViewerError as reason:
        return replace(sheet, caption=f"{sheet.caption} It cannot be turned in this page: {reason}.")
    return replace(sheet, scene=scene_data(scene))


def dimensions_sheet(design: Design) -> Figure:
    """The drawing with dimensions."""
    caption = (
        "Elements in their order along the axis. The numbers are the dimensions; the drawing is not to scale, the ray "
        "diagram is. d_f, d_3 and further stops count from the main lens towards the object, d_1 from it to the "
        "microlens array."
    )
    with drawing():
        return compose("dimensions", "Dimensions", caption, plot_dimensions(design).figure)  # type: ignore[arg-type]


def history_sheet(answer: Answer) -> Figure:
    """How an optimisation went."""
    caption = (
        "Each dot is a local search from a Sobol point: how much worse its goals are than the answer's, over the "
        "evaluations spent by then. Dots on the lower edge ended at the answer; a diamond there is another solver "
        "that found none better."
    )
    with drawing():
        figure = plot_search_history(answer).figure
        return compose("history", "What every start came to", caption, figure)  # type: ignore[arg-type]


def new_drawing(height: float) -> Drawing:
    """A figure as wide as the page, its height in inches."""
    from matplotlib.figure import Figure as NewDrawing

    return NewDrawing(figsize=(WIDTH, height), layout="constrained")


def shared_legend(
    figure: Drawing, axes: Iterable[Axes], place: Literal["outside upper left", "outside lower center"], most: int = 5
) -> int:
    """One legend for several Axes, each entry once; returns how many rows it takes."""
    pairs = [pair for ax in axes for pair in zip(*ax.get_legend_handles_labels(), strict=True)]
    known = {text: handle for handle, text in reversed(pairs)}
    ordered = {text: known[text] for _, text in pairs}
    rows = math.ceil(len(ordered) / most)
    figure.legend(list(ordered.values()), list(ordered), loc=place, ncols=math.ceil(len(ordered) / rows))
    return rows


def compose(name: str, title: str, caption: str, figure: Drawing) -> Figure:
    """A drawing as a block of a report."""
    return Figure(name, title, caption, to_svg(figure, name), description=f"{title}. {caption}")
