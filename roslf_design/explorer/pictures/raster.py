"""Arrays as small images inside an SVG."""

from __future__ import annotations

import base64
import io

import numpy as np
from numpy.typing import NDArray

from .svg import px

Floats = NDArray[np.float64]

RAMP = ((0.0, (0, 0, 0)), (0.35, (0, 62, 112)), (0.6, (0, 114, 178)), (0.85, (86, 180, 233)), (1.0, (255, 255, 255)))
"""Black over Okabe and Ito's blues to white: even in lightness, and free of hue for those who see none."""


def ramp(values: Floats) -> NDArray[np.uint8]:
    """Colours of values from 0 to 1; shape (..., 4)."""
    places = [place for place, _ in RAMP]
    channels = [np.interp(values, places, [colour[k] for _, colour in RAMP]) for k in range(3)]
    return np.stack([*channels, np.full(np.shape(values), 255.0)], -1).round().astype(np.uint8)


def shaded(values: Floats, colour: str, strongest: float) -> NDArray[np.uint8]:
    """One colour, as opaque as the values (0 to 1) say, at most `strongest`; shape (..., 4)."""
    rgb = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
    alpha = 255 * strongest * np.clip(values, 0.0, 1.0)
    found = np.empty((*np.shape(values), 4), np.uint8)
    found[..., :3] = rgb
    found[..., 3] = alpha.round()
    return found


def image(colours: NDArray[np.uint8], box: tuple[float, float, float, float], *, smooth: bool = False) -> str:
    """An array of colours as an image.

    Parameters
    ----------
    colours : ndarray of uint8
        Shape (rows, columns, 4), row 0 at the bottom.
    box : (left, top, width, height)
        [px].
    smooth : bool
        Whether colours run into each other; else each is a rectangle.
    """
    if not colours.size:
        return ""
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(colours[::-1])).save(stream, "PNG", compress_level=1)
    data = base64.b64encode(stream.getvalue()).decode()
    left, top, width, height = box
    look = "" if smooth else ' style="image-rendering:pixelated"'
    return (
        f'<image x="{px(left)}" y="{px(top)}" width="{px(width)}" height="{px(height)}" preserveAspectRatio="none"'
        f'{look} href="data:image/png;base64,{data}"/>'
    )
