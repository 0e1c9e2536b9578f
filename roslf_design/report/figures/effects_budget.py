"""Every effect's size against its budget."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .style import BLUE, GREY, INK, ORANGE, PALE, new_axes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

    from ...evaluation.result import Effect

FLOOR = 1e-4
"""Shares of the budget below which a bar is no longer drawn."""


def plot_effects_budget(effects: Sequence[Effect], ax: Axes | None = None) -> Axes:
    """Draw the effects of a plan as bars of estimate over budget, largest first; those of no size are left out.

    Parameters
    ----------
    effects : sequence of Effect
        E.g. ``roslf.evaluate(design).effects``.
    ax : Axes, optional
        To draw on; a new figure's where none is given.

    Returns
    -------
    Axes
    """
    shown = sorted(
        (effect for effect in effects if effect.estimate != 0 and effect.budget > 0),
        key=lambda effect: abs(effect.estimate) / effect.budget,
    )
    ax = new_axes(ax, height=0.6 + 0.3 * max(len(shown), 1))
    if not shown:
        ax.text(0.5, 0.5, "no effect has a size", ha="center", va="center", transform=ax.transAxes)
    shares = np.array([abs(effect.estimate) / effect.budget for effect in shown])
    # Always-on effects keep their colour below the budget: they are not left out.
    colours = [BLUE if effect.on else PALE for effect in shown]
    places = np.arange(len(shown))
    low = min(FLOOR, 1.0) if not shares.size else max(FLOOR, min(0.03, float(shares.min()) / 3))
    ax.barh(places, np.maximum(shares, low) - low, left=low, color=colours, height=0.62)
    top = max(3.0, float(shares.max(initial=0.0)))
    high = top * (top / low) ** 0.3  # room for the notes
    ax.set_xscale("log")
    ax.set_xlim(low, high)
    for place, effect, share in zip(places, shown, shares, strict=True):
        note = f"{effect.estimate:.3g} {_unit(effect.unit)}" + ("" if effect.on else ", left out")
        ax.annotate(
            note, (max(share, low), place), xytext=(5, 0), textcoords="offset points", va="center", fontsize=8,
            color=INK if effect.on else GREY, bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0},
        )  # fmt: skip
    ax.axvline(1.0, color=ORANGE, linewidth=1.6)
    ax.annotate("budget", (1.0, 1.0), xycoords=("data", "axes fraction"), xytext=(0, 3),
                textcoords="offset points", ha="center", va="bottom", fontsize=8)  # fmt: skip
    ax.set_yticks(places, [effect.name.replace("_", " ") for effect in shown])
    ax.tick_params(axis="y", length=0)
    ax.set_ylim(-0.6, max(len(shown), 1) - 0.4)
    ax.set_xlabel("estimate over budget [1]")
    ax.set_ylabel("effect [sorted by size]")
    ax.grid(True, axis="x")
    return ax


def _unit(unit: str) -> str:
    return {"pitch": "pitches", "intensity": "of full scale"}.get(unit, unit)
