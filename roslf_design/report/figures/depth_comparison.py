"""Depth precision of several designs in one picture."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from .depth_precision import SIGMA_DISPARITY, depth_precision, focal_plane_sigma
from .style import BLUE, GREEN, ORANGE, new_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ...design import Design

LOOKS = ((BLUE, "-"), (ORANGE, "--"), (GREEN, "-."))
"""Colour and line of each design."""


def plot_depth_comparison(
    designs: Mapping[str, Design], ax: Axes | None = None, sigma_disparity: float = SIGMA_DISPARITY
) -> Axes:
    """Draw sigma_Z over the distance from the FAP, Z_F, one line a design; both axes are logarithmic.

    Parameters
    ----------
    designs : mapping
        Up to three, by what to call them.
    ax : Axes, optional
        To draw on; a new figure's where none is given.
    sigma_disparity : float
        Standard deviation of the disparity between the FAP's rims [microlens pitches].

    Returns
    -------
    Axes
    """
    ax = new_axes(ax, height=3.2)
    for (name, design), (colour, line) in zip(designs.items(), LOOKS, strict=False):
        curve = depth_precision(design, sigma_disparity=sigma_disparity)
        ax.plot(curve.distance - design.d_3, curve.sigma, color=colour, linestyle=line, label=f"{name}: {design.name}")
        focus = design.d_f - design.d_3, focal_plane_sigma(design, sigma_disparity)
        ax.plot(*focus, "o", color=colour, markeredgecolor="white", markersize=8)
    ax.set(xscale="log", yscale="log", xlabel="object distance from the FAP Z_F [mm]", ylabel="sigma_Z [mm]")
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_formatter(_plain)
        axis.set_minor_formatter(_plain)
    ax.grid(True, which="both")
    ax.legend(loc="upper left")
    return ax


def _plain(value: float, _: object) -> str:
    """Ticks as numbers, not as powers; few of them."""
    digit = value / 10 ** np.floor(np.log10(value) + 1e-9)
    return f"{value:.6g}" if round(digit) in (1, 2, 5) else ""
