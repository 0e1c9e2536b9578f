"""The figures of a design report, each composed from plot functions and given its caption."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal

from . import captions
from .blocks import Figure
from .figures.cells import plot_cells
from .figures.depth_precision import plot_depth_precision
from .figures.effects_budget import plot_effects_budget
from .figures.field_maps import field_map, plot_image_offset, plot_kept_fraction
from .figures.matching_plane import plot_matching_plane
from .figures.microlens_images import image_view, plot_microlens_image
from .figures.picture import plot_picture
from .figures.ray_diagram import TALLEST, frame_of, instrument_is_small, plot_ray_diagram
from .figures.style import WIDTH, drawing, to_svg

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Drawing

    from ..design import Design
    from ..evaluation.result import Evaluation
    from .scene3d import Name


def ray_sheet(design: Design, result: Evaluation) -> Figure:
    """The meridional section: all of it and, where that is small, the instrument."""
    views = [False, True] if instrument_is_small(design) else [False]
    heights = [min(TALLEST, frame_of(design, view).height_at(7.2)) for view in views]
    with drawing():
        figure = _new(sum(heights) + 0.5 * len(heights) + 0.3)
        rows = figure.subplots(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]
        for ax, view in zip(rows, views, strict=True):
            plot_ray_diagram(design, ax, instrument_only=view)
        _legend(figure, rows[0], "outside upper left", 4)
        return _figure("rays", "Meridional ray diagram, to scale", captions.rays(design, result), figure)


def cells_sheet(design: Design, result: Evaluation) -> Figure:
    """Microlenses and pixels, at the centre and at the edge."""
    places = zoom_places(design)
    with drawing():
        figure = _new(3.3)
        for ax, (label, place) in zip(figure.subplots(1, 2), places.items(), strict=True):
            plot_cells(design, place, ax)
            ax.set_title(f"{label}, x = {place:.4g} mm")
        return _figure("cells", "Zoom on microlens array and sensor", captions.cells(result), figure)


def zoom_places(design: Design) -> dict[str, float]:
    """Where along x the zoom looks: at the centre, and as far out as neighbours still lie before the edge [mm]."""
    from ..evaluation import default_fields

    (centre, _), (edge, _), _ = default_fields(design)
    return {"centre": centre, "edge": edge - 3 * design.d}


def image_sheet(design: Design, result: Evaluation) -> Figure:
    """Microlens images of the evaluation's fields."""
    labels, views = ("centre", "edge", "corner"), []
    with drawing():
        figure = _new(3.3)
        axes = figure.subplots(1, len(labels))
        for ax, label, field in zip(axes, labels, result.fields, strict=True):
            views.append(image_view(design, field.x_ml_mm))
            plot_microlens_image(design, field.x_ml_mm, ax, views[-1])
            ax.set_title(f"{label}: {ax.get_title(loc='left')}")
            if ax is not axes[0]:
                ax.set_ylabel("")
        # A dark field has no outline to show.
        known = {text: handle for ax in axes for handle, text in zip(*ax.get_legend_handles_labels(), strict=True)}
        columns = len(known) if len(known) <= 5 else math.ceil(len(known) / 2)
        figure.set_figheight(2.95 + 0.2 * math.ceil(len(known) / columns))
        figure.legend(known.values(), known.keys(), loc="outside lower center", ncols=columns)
        return _figure(
            "images",
            "Microlens images on their pixels",
            captions.images(result, min(view.on_sensor for view in views)),
            figure,
        )


def map_sheet(design: Design, result: Evaluation) -> Figure:
    """Kept fraction and image offset over the MLA."""
    with drawing():
        figure = _new(3.7)
        left, right = figure.subplots(1, 2)
        fields = field_map(design)
        plot_kept_fraction(design, left, fields)
        plot_image_offset(design, right, fields)
        _legend(figure, left, "outside lower center", 3)
        return _figure("maps", "Microlens images over the array", captions.maps(design, result, fields), figure)


def plane_sheet(design: Design, result: Evaluation) -> Figure:
    """The D_F - d_3 plane."""
    with drawing():
        figure = _new(3.9)
        plot_matching_plane(design, figure.subplots())
        return _figure("plane", "FAP diameter and distance", captions.plane(design, result), figure)


def depth_sheet(design: Design, result: Evaluation) -> Figure:
    """Depth precision."""
    with drawing():
        figure = _new(3.2)
        plot_depth_precision(design, figure.subplots(), sigma_disparity=result.depth.sigma_disparity_pitches)
        return _figure("depth", "Depth precision over distance", captions.depth(design, result), figure)


def effects_sheet(result: Evaluation) -> Figure:
    """Effects against their budgets."""
    shown = sum(effect.estimate != 0 for effect in result.effects)
    with drawing():
        figure = _new(0.9 + 0.27 * max(shown, 1))
        plot_effects_budget(result.effects, figure.subplots())
        return _figure("effects-budget", "Effects against their budgets", captions.effects(result), figure)


def picture_sheet(png: bytes, names: tuple[Name, ...]) -> Figure:
    """The 3D view."""
    with drawing():
        figure = plot_picture(png, names).figure
        return _figure("view", "The instrument in three dimensions", captions.PICTURE, figure)  # type: ignore[arg-type]


def _new(height: float) -> Drawing:
    from matplotlib.figure import Figure as NewDrawing

    return NewDrawing(figsize=(WIDTH, height), layout="constrained")


def _legend(
    figure: Drawing, ax: Axes, place: Literal["outside upper left", "outside lower center"], columns: int
) -> None:
    handles, labels = ax.get_legend_handles_labels()
    figure.legend(handles, labels, loc=place, ncols=columns)


def _figure(name: str, title: str, caption: str, figure: Drawing) -> Figure:
    return Figure(name, title, caption, to_svg(figure, name), description=f"{title}. {caption}")
