"""The 3D picture with names in selectable text."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from .style import BLOCKED, FIELD_COLOURS, GREY, WIDTH, new_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..scene3d import Name


def plot_picture(png: bytes, names: Sequence[Name], ax: Axes | None = None) -> Axes:
    """Show a drawn scene and write the names of its elements into it.

    Parameters
    ----------
    png : bytes
        The picture.
    names : sequence of Name
        With their places, from the left to the right.
    ax : Axes, optional
        To draw on; a new figure's where none is given.

    Returns
    -------
    Axes
        In pixels of the picture, without ticks.
    """
    from PIL import Image

    picture = np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))
    height, width = picture.shape[:2]
    ax = new_axes(ax, height=WIDTH * height / width)
    ax.imshow(picture, interpolation="none", extent=(0, width, 0, height), aspect="equal")
    reached: list[float] = []
    for name in names:
        x, y = name.x * width, name.y * height
        if not name.above:
            ax.text(0.005 * width, 0.02 * height, name.text, ha="left", va="bottom", fontsize=8, color=GREY)
            continue
        half = 0.0062 * width * len(name.text)
        x_text = min(x, width - half)
        row = next((r for r, end in enumerate(reached) if x_text - half > end), len(reached))
        reached[row : row + 1] = [x_text + half]
        y_text = y + (0.035 + 0.05 * row) * height
        ax.plot([x, x], [y, y_text], color=GREY, linewidth=0.6)
        ax.text(x_text, y_text, name.text, ha="center", va="bottom", fontsize=8)
    for label, colour in zip(("centre", "edge", "corner", "blocked"), (*FIELD_COLOURS, BLOCKED), strict=True):
        ax.plot([], [], color=colour, label=label)
    ax.legend(loc="lower right", ncols=4, borderaxespad=0.1)
    ax.set(xlim=(0, width), ylim=(0, height))
    ax.set_axis_off()
    return ax
