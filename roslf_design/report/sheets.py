"""The figures of a design report, each composed from plot functions and given its caption."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

from . import captions
from .blocks import Figure
from .figures.cells import plot_cells
from .figures.depth_precision import plot_depth_precision
from .figures.dimensions import plot_dimensions
from .figures.effects_budget import plot_effects_budget
from .figures.field_maps import field_map, plot_image_offset, plot_kept_fraction
from .figures.matching_plane import plot_matching_plane
from .figures.microlens_images import image_view, plot_microlens_image
from .figures.ray_diagram import TALLEST, frame_of, instrument_is_small, plot_ray_diagram
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


def ray_sheet(design: Design, result: Evaluation) -> Figure:
    """The meridional section."""
    with drawing():
        return compose(
            "rays", "Meridional ray diagram, to scale", captions.rays(design, result), draw_ray_diagrams(design)
        )


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
    """Microlenses and pixels, at the centre and at the edge."""
    places = zoom_places(design)
    with drawing():
        figure = new_drawing(3.3)
        for ax, (label, place) in zip(figure.subplots(1, 2), places.items(), strict=True):
            plot_cells(design, place, ax)
            ax.set_title(f"{label}, x = {place:.4g} mm")
        return compose("cells", "Zoom on microlens array and sensor", captions.cells(result), figure)


def zoom_places(design: Design) -> dict[str, float]:
    """Where along x the zoom looks: at the centre, and as far out as neighbours still lie before the edge [mm]."""
    from ..evaluation import default_fields

    (centre, _), (edge, _), _ = default_fields(design)
    return {"centre": centre, "edge": edge - 3 * design.d}


def image_sheet(design: Design, result: Evaluation) -> Figure:
    """Microlens images of the evaluation's fields."""
    labels, views = ("centre", "edge", "corner"), []
    with drawing():
        figure = new_drawing(3.3)
        axes = figure.subplots(1, len(labels))
        for ax, label, field in zip(axes, labels, result.fields, strict=True):
            views.append(image_view(design, field.x_ml_mm))
            plot_microlens_image(design, field.x_ml_mm, ax, views[-1])
            ax.set_title(f"{label}: {ax.get_title(loc='left')}")
            if ax is not axes[0]:
                ax.set_ylabel("")
        seen = min(view.on_sensor for view in views)
        rows = shared_legend(figure, axes, "outside lower center")
        figure.set_figheight(2.95 + 0.2 * rows)
        return compose("images", "Microlens images on their pixels", captions.images(result, seen), figure)


def wave_sheet(design: Design) -> Figure:
    """One microlens image by rays and by waves."""
    from ..imaging.encircled import encircled
    from ..imaging.figures import draw_microlens_images

    with drawing():
        figure = new_drawing(3.3)
        rays, waves = figure.subplots(1, 2)
        draw_microlens_images(rays, waves, design)
        return compose("waves", "One microlens image by rays and by waves", captions.waves(encircled(design)), figure)


def map_sheet(design: Design, result: Evaluation) -> Figure:
    """Kept fraction and image offset over the MLA."""
    with drawing():
        figure = new_drawing(3.7)
        left, right = figure.subplots(1, 2)
        fields = field_map(design)
        plot_kept_fraction(design, left, fields)
        plot_image_offset(design, right, fields)
        shared_legend(figure, [left], "outside lower center")
        return compose("maps", "Microlens images over the array", captions.maps(design, result, fields), figure)


def lens_sheets(design: Design, result: Evaluation) -> tuple[Figure, Figure]:
    """Microlens images and aberrations of a real main lens over the field, and its images beside the thin lens's."""
    from .figures.real_lens import (
        lens_curves,
        plot_lens_distortion,
        plot_lens_foci,
        plot_lens_image,
        plot_lens_images_over_field,
    )

    curves = lens_curves(design)
    with drawing():
        figure = new_drawing(3.5)
        axes = figure.subplots(1, 3)
        for ax, plot in zip(axes, (plot_lens_images_over_field, plot_lens_foci, plot_lens_distortion), strict=True):
            plot(design, ax, curves)
            ax.set_xlabel("microlens off axis [mm]")
        shared_legend(figure, axes, "outside lower center", most=4)
        over = compose("lens-field", "The real lens over the field", captions.lens_field(result), figure)
        figure = new_drawing(3.2)
        axes = figure.subplots(1, len(result.fields), sharex=True, sharey=True)
        for ax, label, field in zip(axes, ("centre", "edge", "corner"), result.fields, strict=True):
            plot_lens_image(design, field.x_ml_mm, ax)
            ax.set_title(f"{label}: {ax.get_title(loc='left')}")
        shared_legend(figure, axes, "outside lower center")
        seen = compose("lens-images", "Microlens images behind the real lens", captions.lens_images(result), figure)
    return over, seen


def plane_sheet(design: Design, result: Evaluation) -> Figure:
    """The D_F - d_3 plane."""
    with drawing():
        figure = new_drawing(3.9)
        plot_matching_plane(design, figure.subplots())
        return compose("plane", "FAP diameter and distance", captions.plane(design, result), figure)


def depth_sheet(design: Design, result: Evaluation) -> Figure:
    """Depth precision."""
    with drawing():
        figure = new_drawing(3.2)
        plot_depth_precision(design, figure.subplots(), sigma_disparity=result.depth.sigma_disparity_pitches)
        return compose("depth", "Depth precision over distance", captions.depth(design, result), figure)


def effects_sheet(result: Evaluation) -> Figure:
    """Effects against their budgets."""
    shown = sum(effect.estimate != 0 for effect in result.effects)
    with drawing():
        figure = new_drawing(0.9 + 0.27 * max(shown, 1))
        plot_effects_budget(result.effects, figure.subplots())
        return compose("effects-budget", "Effects against their budgets", captions.effects(result), figure)


def picture_sheet(design: Design) -> Figure:
    """The 3D view, with the scene to turn where the library for that is installed."""
    scene = instrument_scene(design)
    with drawing():
        sheet = compose(
            "view",
            "The instrument in three dimensions",
            captions.PICTURE,
            plot_outlines(scene).figure,  # type: ignore[arg-type]
        )
    try:
        library()
    except NoViewerError as reason:
        return replace(sheet, caption=f"{sheet.caption} It cannot be turned in this page: {reason}.")
    return replace(sheet, scene=scene_data(scene))


def dimensions_sheet(design: Design) -> Figure:
    """The drawing with dimensions."""
    with drawing():
        figure = plot_dimensions(design).figure
        return compose("dimensions", "Dimensions", captions.DIMENSIONS, figure)  # type: ignore[arg-type]


def history_sheet(answer: Answer) -> Figure:
    """How an optimisation went."""
    with drawing():
        figure = plot_search_history(answer).figure
        return compose("history", "What every start came to", captions.HISTORY, figure)  # type: ignore[arg-type]


def new_drawing(height: float) -> Drawing:
    """A figure as wide as the page."""
    from matplotlib.figure import Figure as NewDrawing

    return NewDrawing(figsize=(WIDTH, height), layout="constrained")


Place = Literal["outside upper left", "outside lower center"]


def shared_legend(figure: Drawing, axes: Iterable[Axes], place: Place, most: int = 5) -> int:
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
