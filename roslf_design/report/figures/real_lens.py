"""What a real main lens does over the field, its thin twin beside it: image places and sizes, foci, outlines."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...effects.field import half_sizes
from ...lenses.camera import camera_of, microlenses
from ...lenses.images import measured_bound, real_field
from ...lenses.tracer import KEPT
from ...theory import inverse_aperture_constant
from .style import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, VERMILLION, new_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ...design import Design

Floats = NDArray[np.float64]
FOLDED, FULL = 3, 2


class LensCurves(NamedTuple):
    """Along x from the axis to the distance of the sensor's corner; NaN where there is no light to tell it by."""

    x: Floats
    """Microlens [mm], shape (N,)."""
    shift_px: Floats
    """Image centre against the thin twin's, outwards positive."""
    diameter_px: Floats
    """Of the disc with the image's area; NaN where the image is folded."""
    thin_diameter_px: float
    axis_ratio: Floats
    kept: Floats
    """Part of the FAP that is seen."""
    folded: NDArray[np.bool_]
    tangential: Floats
    """Blur on the array from the tangential focus [pitches], signed like the focus."""
    sagittal: Floats
    distortion: Floats
    """[%]."""
    colour: Floats
    """F to C [pitches]."""
    bound: float
    """Measured non-distortion bound on the array [mm]."""


def lens_curves(design: Design, points: int = 46) -> LensCurves:
    """Trace a design's real lens along x."""
    x = np.linspace(0.0, math.hypot(*half_sizes(design)), points)
    found = real_field(design, np.stack([x, np.zeros(points)], axis=-1))
    cone = design.D_F / (design.d_1 * float(inverse_aperture_constant(design.d_f, design.d_3))) / design.d
    maps, images = found.maps, found.images
    seen, folded = maps.status == KEPT, images.status == FOLDED

    def told(values: Floats, where: NDArray[np.bool_]) -> Floats:
        return np.where(where, values, np.nan)

    return LensCurves(
        x=x,
        shift_px=found.shift[:, 0] / design.q,
        diameter_px=told(found.thin_diameter * (1 + found.widening) / design.q, ~folded),
        thin_diameter_px=found.thin_diameter / design.q,
        axis_ratio=told(images.axis_ratio, images.kept_fraction > 0),
        kept=images.kept_fraction,
        folded=folded,
        tangential=told(maps.tangential_focus * cone, seen),
        sagittal=told(maps.sagittal_focus * cone, seen),
        distortion=told(100 * maps.distortion, seen),
        colour=found.lateral_colour / design.d,
        bound=measured_bound(design)[1],
    )


def plot_lens_images_over_field(design: Design, ax: Axes | None = None, curves: LensCurves | None = None) -> Axes:
    """Draw how far images are displaced and widened against the thin twin.

    Parameters
    ----------
    design : Design
        With a real main lens.
    ax : Axes, optional
        To draw on; a new figure's where none is given.
    curves : LensCurves, optional
        As `lens_curves` gives them, where they are known already.

    Returns
    -------
    Axes
    """
    ax = new_axes(ax, width=4.5)
    found = lens_curves(design) if curves is None else curves
    ax.axhline(0, color=GREY, linewidth=0.9, linestyle=(0, (5, 3)), label="thin twin")
    ax.plot(found.x, found.shift_px, color=BLUE, label="image centre, shift")
    ax.plot(found.x, found.diameter_px - found.thin_diameter_px, color=VERMILLION, label="diameter, growth")
    _mark_bound(ax, found)
    ax.set(xlabel="microlens from the axis [mm]", ylabel="real less thin [px]", title="microlens images")
    return ax


def plot_lens_foci(design: Design, ax: Axes | None = None, curves: LensCurves | None = None) -> Axes:
    """Draw field curvature, astigmatism and lateral colour; parameters as `plot_lens_images_over_field`."""
    ax = new_axes(ax, width=4.5)
    found = lens_curves(design) if curves is None else curves
    ax.axhline(0, color=GREY, linewidth=0.9, linestyle=(0, (5, 3)))
    ax.plot(found.x, found.tangential, color=BLUE, label="tangential focus")
    ax.plot(found.x, found.sagittal, color=GREEN, label="sagittal focus")
    ax.plot(found.x, found.colour, color=PURPLE, linestyle=(0, (1, 1.2)), label="lateral colour, F to C")
    ax.set(xlabel="microlens from the axis [mm]", ylabel="blur on the array [pitches]", title="foci and colour")
    return ax


def plot_lens_distortion(design: Design, ax: Axes | None = None, curves: LensCurves | None = None) -> Axes:
    """Draw distortion; parameters as `plot_lens_images_over_field`."""
    ax = new_axes(ax, width=4.5)
    found = lens_curves(design) if curves is None else curves
    ax.axhline(0, color=GREY, linewidth=0.9, linestyle=(0, (5, 3)))
    ax.plot(found.x, found.distortion, color=ORANGE, label="distortion")
    ax.set(xlabel="microlens from the axis [mm]", ylabel="image height against first order [%]", title="distortion")
    return ax


def _mark_bound(ax: Axes, found: LensCurves) -> None:
    if found.bound < found.x[-1]:
        ax.axvline(found.bound, color=INK, linewidth=0.9, linestyle=(0, (1, 1.5)), label="undistorted within")
    if np.any(found.folded):
        first = float(found.x[np.argmax(found.folded)])
        ax.axvspan(first, found.x[-1], color=GREY, alpha=0.18, linewidth=0, label="folded or dark")


def plot_lens_image(design: Design, place: tuple[float, float] = (0.0, 0.0), ax: Axes | None = None) -> Axes:
    """Draw a microlens image as the real lens makes it, and its thin twin's.

    Parameters
    ----------
    design : Design
        With a real main lens.
    place : (x, y)
        The microlens's axis on the MLA [mm].
    ax : Axes, optional
        To draw on; a new figure's where none is given.

    Returns
    -------
    Axes
        In px, relative to the thin image's centre.
    """
    ax = new_axes(ax, width=3.0, height=3.0)
    found = real_field(design, [place])
    centre, radius = found.thin_centre[0], found.thin_diameter / 2
    turn = np.linspace(0, 2 * np.pi, 181)
    ring = radius * np.stack([np.cos(turn), np.sin(turn)], axis=-1) / design.q
    ax.plot(ring[:, 0], ring[:, 1], color=GREY, linewidth=1.1, linestyle=(0, (5, 3)), label="thin twin")
    status = int(found.images.status[0])
    if status == FOLDED:
        _draw_folded(ax, design, place, centre)
    elif status:
        edge = (found.images.boundary[0] - centre) / design.q
        ax.fill(edge[:, 0], edge[:, 1], facecolor=BLUE, alpha=0.25, edgecolor="none")
        closed = np.concatenate([edge, edge[:1]])
        ax.plot(closed[:, 0], closed[:, 1], color=BLUE, linewidth=1.5, label="real lens")
    ax.set_aspect("equal")
    kept = float(found.images.kept_fraction[0])
    told = {0: "dark", 1: f"cut, {100 * kept:.3g} % kept", 2: "whole", 3: f"folded, {100 * kept:.3g} % kept"}[status]
    ax.set(xlabel="x [px]", ylabel="y [px]", title=told)
    return ax


def _draw_folded(ax: Axes, design: Design, place: tuple[float, float], centre: Floats) -> None:
    """What is lit, on a grid: a folded image has no single outline."""
    from ...lenses.camera import views

    camera = camera_of(design)
    (c,) = microlenses(design, [place])
    side = np.linspace(-1, 1, 161) * 0.7 * camera.lens_diameter * camera.d_2 / camera.d_1
    grid = np.stack(np.meshgrid(side, side), axis=-1) + c * (1 + camera.d_2 / camera.d_1)
    at = views(camera, c, grid, clip=False)
    room = np.minimum(at.fap_room, at.room)
    x, y = ((grid[..., k] - c[k] - centre[k]) / design.q for k in (0, 1))
    ax.contourf(x, y, room, levels=[0.0, 2.0], colors=[BLUE], alpha=0.25)
    ax.contour(x, y, room, levels=[0.0], colors=[BLUE], linewidths=1.5)
