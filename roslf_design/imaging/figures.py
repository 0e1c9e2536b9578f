"""Figures of raw images: one microlens image by rays and by waves, an image with zooms."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..design import Design
from ..effects import plan
from ..effects.field import image_diameter, image_pitch
from .camera import planned_design
from .encircled import encircled
from .grid import Region
from .render import RawImage
from .series import harmonic_series
from .transfer import MicrolensTransfer

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BLUE, VERMILLION, GREEN = "#0072B2", "#D55E00", "#009E73"
"""Okabe and Ito's colours, which colour-blind readers can tell apart."""


def draw_microlens_images(rays: Axes, waves: Axes, design: Design, samples: int = 181) -> tuple[Axes, Axes]:
    """One microlens image with its neighbours, by ray and by wave optics, before pixels integrate.

    Parameters
    ----------
    rays, waves : matplotlib Axes
        Drawn into.
    design : Design
        Its microlens on the axis is shown, unclipped.
    samples : int
        Points along each side.

    Returns
    -------
    rays, waves : matplotlib Axes
    """
    pitch, radius = abs(image_pitch(design)), image_diameter(design) / 2
    effects = plan(design, overrides=["+microlens_diffraction", "+overlap", "-vignetting", "-tilts", "-decentres"])
    seen = planned_design(design, effects)
    transfer = MicrolensTransfer.of(seen, effects)
    half = 0.75 * pitch
    axis = np.linspace(-half, half, samples)
    series = harmonic_series(seen, transfer, pixel=False)
    wave = series.at(axis, axis)
    x, y = np.meshgrid(axis, axis)
    steps = [pitch * np.array([i, j]) for i in (-1, 0, 1) for j in (-1, 0, 1)]
    ray = sum(((x - step[0]) ** 2 + (y - step[1]) ** 2 <= radius**2).astype(float) for step in steps)
    inside = encircled(design)
    box = (-half * 1e3, half * 1e3, -half * 1e3, half * 1e3)
    for axes, image, title in (
        (rays, ray, "Rays: all light in the disc"),
        (waves, wave, f"Waves: {inside.disc:.1%} in the disc, {inside.cell:.1%} in the cell"),
    ):
        shown = axes.imshow(image, extent=box, origin="lower", cmap="viridis", vmin=0, vmax=max(1.0, float(wave.max())))
        turn = np.linspace(0, 2 * np.pi, 181)
        axes.plot(
            radius * 1e3 * np.cos(turn), radius * 1e3 * np.sin(turn), color="white", lw=1, label="geometric image"
        )
        edge = np.array([-1, 1, 1, -1, -1]) * pitch / 2 * 1e3
        axes.plot(edge, np.roll(edge, 1), color="white", lw=1, ls="--", label="cell of one image pitch")
        axes.set(title=title, xlabel="x on the sensor [µm]", ylabel="y on the sensor [µm]")
        if axes.figure is not None:
            axes.figure.colorbar(shown, ax=axes, label="relative intensity", shrink=0.8)
    return rays, waves


def draw_preview(image: RawImage, zoom: int | None = None) -> Figure:
    """An image with zooms at its centre, edge and corner.

    Parameters
    ----------
    image : RawImage
    zoom : int, optional
        Side of a zoom [pixels]; None shows about five microlens images.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 7.5), layout="constrained")
    grid = figure.add_gridspec(2, 3, height_ratios=(2, 1.3))
    whole = figure.add_subplot(grid[0, :])
    pixels, region = image.pixels, image.region
    top = max(float(np.percentile(pixels[:: max(1, region.rows // 500)], 99.9)), 1e-9)
    ends = _extent(region)
    # Every so many pixels would beat with the microlenses: show means of blocks.
    step = max(1, -(-max(pixels.shape) // 1400))
    kept = pixels[: pixels.shape[0] // step * step, : pixels.shape[1] // step * step]
    small = kept.reshape(kept.shape[0] // step, step, -1, step).mean((1, 3))
    whole.imshow(small, extent=ends, origin="lower", cmap="gray", vmin=0, vmax=top)
    whole.set(title=f"{image.design.name}: {image.scene.name or 'scene'}", xlabel="column [px]", ylabel="row [px]")
    if zoom is None:
        zoom = max(24, round(5 * abs(image_pitch(image.design)) / image.design.q))
    side = min(zoom, region.rows, region.columns)
    middle_x, middle_y = (region.columns - side) // 2, (region.rows - side) // 2
    places = {
        "centre": (middle_x, middle_y),
        "edge": (region.columns - side, middle_y),
        "corner": (region.columns - side, region.rows - side),
    }
    colours = (BLUE, VERMILLION, GREEN)
    for n, ((name, (column, row)), colour) in enumerate(zip(places.items(), colours, strict=True)):
        axes = figure.add_subplot(grid[1, n])
        part = pixels[row : row + side, column : column + side]
        piece = Region(region.column + column, region.row + row, side, side)
        shown = axes.imshow(part, extent=_extent(piece), origin="lower", cmap="gray", vmin=0, vmax=top)
        axes.set(title=name, xlabel="column [px]", ylabel="row [px]")
        for spine in axes.spines.values():
            spine.set(color=colour, linewidth=2.5)
        x0, x1, y0, y1 = _extent(piece)
        whole.plot([x0, x1, x1, x0, x0], [y0, y0, y1, y1, y0], color=colour, lw=2)
    figure.colorbar(shown, ax=figure.axes, label="relative intensity", shrink=0.6)
    return figure


def _extent(region: Region) -> tuple[float, float, float, float]:
    return region.column, region.column + region.columns, region.row, region.row + region.rows
