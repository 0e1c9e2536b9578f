"""The D_F - d_3 plane: where f-numbers match, where the whole sensor is undistorted, and the design in it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...effects.field import half_sizes
from ...theory.field import nondistortion_margin
from ...theory.matched import matched_pupil_diameter, matched_pupil_distance
from ...theory.matching import matching_mismatch
from ...theory.stops import stop_margin
from .style import BLUE, GREEN, GREY, INK, ORANGE, VERMILLION, new_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ...design import Design

Floats = NDArray[np.float64]


class MatchingPlane(NamedTuple):
    """What the figure shows."""

    d_3: Floats
    """Abscissae of the curves [mm], shape (N,)."""
    exact: Floats
    """D_F that matches at each (Eq. 7) [mm]; NaN-free: inf where there is none."""
    approximate: Floats
    """The same by Eq. 8."""
    D_F: Floats
    """Ordinates of the maps [mm], shape (M,)."""
    margin: Floats
    """Smallest non-distortion margin at the sensor's corner (Eqs. 5-6) [mm^2], shape (M, N); full discs where >= 0."""
    mismatch: Floats
    """Image diameter less pitch [px], shape (M, N)."""


def matching_plane(design: Design, points: int = 201, limits: tuple[float, float] | None = None) -> MatchingPlane:
    """Curves and maps over ranges in which the design and the matched curve are both seen.

    Parameters
    ----------
    design : Design
    points : int
        Along each axis.
    limits : (d_3, D_F), optional
        Ends of the ranges [mm], instead of those chosen for the design; d_3 stops short of the focal plane.
    """
    triple = design.f, design.d_f
    right = _right(design) if limits is None else min(limits[0], design.d_f * (1 - 1e-3))
    d_3 = np.linspace(0.0, right, points)
    exact = matched_pupil_diameter(design.d, design.d_2, *triple, d_3, exact=True)
    approximate = matched_pupil_diameter(design.d, design.d_2, *triple, d_3, exact=False)
    here = matched_pupil_diameter(design.d, design.d_2, *triple, design.d_3).value
    chosen = 1.35 * max(design.D_F, float(here) if math.isfinite(here) else 0.0, 0.75 * _largest(exact.value))
    top = chosen if limits is None else limits[1]
    D_F = np.linspace(0.0, top, points)
    across, up = np.meshgrid(d_3, D_F)
    margin = _margin(design, across, up)
    mismatch = matching_mismatch(up, design.d, design.q, design.d_2, *triple, across)
    return MatchingPlane(d_3, np.asarray(exact.value), np.asarray(approximate.value), D_F, margin, mismatch)


def _margin(design: Design, d_3: Floats, D_F: Floats) -> Floats:
    corner = math.hypot(*half_sizes(design)) * design.d_f / design.d_1
    margin = nondistortion_margin(design.D, D_F, d_3, design.d_f, corner)
    for stop in design.stops:
        room = stop_margin(stop.diameter, stop.distance, D_F, d_3, design.d_f, (corner, 0.0))
        margin = np.minimum(margin, room)
    return margin


def _right(design: Design) -> float:
    """A d_3 beyond the design, telecentricity, the undistorted region and the match for the design's own D_F."""
    reach = design.d_f * (1 - 1e-3)
    d_3 = np.linspace(0.0, reach, 401)
    clear = d_3[_margin(design, d_3, np.zeros_like(d_3)) >= 0]
    match = matched_pupil_distance(design.D_F, design.d, design.d_2, design.f, design.d_f)
    seen = [design.d_3, design.f, float(clear.max(initial=0.0)), float(match.value) if match.exists else 0.0]
    return min(reach, 1.15 * max(seen))


def plot_matching_plane(design: Design, ax: Axes | None = None) -> Axes:
    """Draw the D_F - d_3 plane of a design, everything else held.

    Parameters
    ----------
    design : Design
        Its decentres are left aside.
    ax : Axes, optional
        To draw on; a new figure's where none is given.

    Returns
    -------
    Axes
    """
    ax = new_axes(ax, height=4.2)
    plane = matching_plane(design)
    top = float(plane.D_F[-1])
    free = bool((plane.margin >= 0).any())
    if free:
        ax.contourf(plane.d_3, plane.D_F, plane.margin, [0, np.inf], colors=[GREEN], alpha=0.13)
    if free and (plane.margin < 0).any():
        ax.contour(plane.d_3, plane.D_F, plane.margin, [0], colors=[GREEN], linewidths=1.2)
    ax.fill_between(
        [], [], color=GREEN, alpha=0.13, label=f"whole sensor undistorted (Eq. 6){'' if free else ': nowhere'}"
    )
    lines = ax.contour(plane.d_3, plane.D_F, plane.mismatch, [-1, 1], colors=[BLUE], linewidths=0.7, linestyles=":")
    if any(np.size(path.vertices) for path in lines.get_paths()):
        ax.plot([], [], color=BLUE, linewidth=0.7, linestyle=":", label="mismatch of ±1 px")
    exact, rough = (np.where(curve <= 2 * top, curve, np.nan) for curve in (plane.exact, plane.approximate))
    ax.plot(plane.d_3, rough, color=ORANGE, linestyle="--", label="matched, approximation (Eq. 8)")
    ax.plot(plane.d_3, exact, color=BLUE, linewidth=1.8, label="matched: images just touch (Eq. 7)")
    ax.axvline(design.f, color=GREY, linewidth=0.8, linestyle=(0, (6, 3)))
    ax.annotate(
        "telecentric, d_3 = f", (design.f, 0.02), xycoords=("data", "axes fraction"), xytext=(3, 0),
        textcoords="offset points", va="bottom", fontsize=8, color=GREY,
    )  # fmt: skip
    ax.plot(design.d_3, design.D_F, "o", color=VERMILLION, markeredgecolor="white", markersize=8, label="this design")
    leftwards = design.d_3 > 0.6 * plane.d_3[-1]
    ax.annotate(
        f"d_3 = {design.d_3:.4g} mm, D_F = {design.D_F:.4g} mm", (design.d_3, design.D_F),
        xytext=(-9, -12) if leftwards else (9, 9), textcoords="offset points", fontsize=8, color=INK,
        ha="right" if leftwards else "left",
        bbox={"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.75},
    )  # fmt: skip
    ax.set(
        xlim=(0, float(plane.d_3[-1])), ylim=(0, top),
        xlabel="FAP distance d_3 [mm]", ylabel="FAP diameter D_F [mm]",
    )  # fmt: skip
    ax.grid(True)
    ax.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0)
    return ax


def _largest(values: Floats) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.max()) if finite.size else 0.0
