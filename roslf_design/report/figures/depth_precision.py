"""Depth precision over the working range, and how far an object there is out of focus."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...theory.aperture import gap
from ...theory.depth import defocus_blur, depth_sigma
from .style import BLUE, GREY, ORANGE, ORANGE_TEXT, VERMILLION, new_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ...design import Design

Floats = NDArray[np.float64]

SIGMA_DISPARITY = 0.1
"""Disparity error that depth precision assumes [microlens pitches]."""


class DepthPrecision(NamedTuple):
    """What the figure shows."""

    distance: Floats
    """Z from the main lens [mm], shape (N,)."""
    sigma: Floats
    """sigma_Z [mm]."""
    blur: Floats
    """Spread of an object point over the MLA [microlens pitches]."""


def depth_precision(design: Design, points: int = 241, sigma_disparity: float = SIGMA_DISPARITY) -> DepthPrecision:
    """Depth precision from 0.4 to 1.8 times the focal plane's depth, both counted from the FAP."""
    ahead = float(gap(design.d_f, design.d_3))
    depth = np.linspace(0.4, 1.8, points) * ahead
    numbers = depth, design.D_F, design.d, design.f, design.d_f, design.d_3
    return DepthPrecision(depth + design.d_3, depth_sigma(sigma_disparity, *numbers), defocus_blur(*numbers))


def focal_plane_sigma(design: Design, sigma_disparity: float = SIGMA_DISPARITY) -> float:
    """Find sigma_Z at the focal plane [mm]."""
    seen = design.D_F, design.d, design.f, design.d_f, design.d_3
    return float(depth_sigma(sigma_disparity, gap(design.d_f, design.d_3), *seen))


def plot_depth_precision(design: Design, ax: Axes | None = None, sigma_disparity: float = SIGMA_DISPARITY) -> Axes:
    """Draw sigma_Z over the object distance Z, and the defocus in pitches on a second axis.

    Parameters
    ----------
    design : Design
    ax : Axes, optional
        To draw on; a new figure's where none is given.
    sigma_disparity : float
        Standard deviation of the disparity between the FAP's rims [microlens pitches].

    Returns
    -------
    Axes
        That of sigma_Z; the other is ``ax.figure.axes[-1]``.
    """
    ax = new_axes(ax, height=3.3)
    curve = depth_precision(design, sigma_disparity=sigma_disparity)
    (left,) = ax.plot(curve.distance, curve.sigma, color=BLUE, label="depth precision sigma_Z")
    focus = focal_plane_sigma(design, sigma_disparity)
    ax.plot(design.d_f, focus, "o", color=VERMILLION, markeredgecolor="white", markersize=7)
    ax.axvline(design.d_f, color=GREY, linewidth=0.8, linestyle=(0, (6, 3)))
    ax.annotate(
        f"focal plane d_f = {design.d_f:.4g} mm: {focus:.3g} mm", (design.d_f, focus), xytext=(7, -12),
        textcoords="offset points", fontsize=8,
    )  # fmt: skip
    other = ax.twinx()
    (right,) = other.plot(
        curve.distance, curve.blur, color=ORANGE, linestyle="--", label="defocus on the MLA (right axis)"
    )
    other.set_ylabel("spread of an object point [pitches]")
    other.set_ylim(0, float(np.max(curve.blur)) * 1.05)
    other.spines["right"].set_visible(True)
    ax.yaxis.label.set_color(BLUE)
    other.yaxis.label.set_color(ORANGE_TEXT)
    ax.set(
        xlabel="object distance from the main lens Z [mm]", ylabel="sigma_Z [mm]",
        xlim=(float(curve.distance[0]), float(curve.distance[-1])), ylim=(0, float(np.max(curve.sigma)) * 1.05),
    )  # fmt: skip
    ax.grid(True)
    ax.legend(handles=[left, right], loc="upper left", bbox_to_anchor=(0.45, 1.0))
    return ax
