"""Colour filters on a sensor's pixels, and the camera as the pixels of one colour see it.

Light is taken as white: a third of it at each filter's wavelength, of which that filter lets a part pass and the others
nothing. A colour's pixels are a coarser lattice of pixels just as large: of green every second one (a quincunx), of red
and blue every fourth. What pixels of all colours tell of a scene without colours of its own adds up.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera
from ..design.parts import PATHS, Colours

Letter = Literal["R", "G", "B"]

BANDS = 3
"""Parts of equal power that white light is taken to have."""


class ColourFilter(NamedTuple):
    """Filters of one colour."""

    letter: Letter
    name: str
    wavelength: float
    """Where most of it passes [mm]; about as makers' curves of colour CMOS sensors have their peaks."""
    taken: float
    """Electrons per photon of its band, over the bare sensor's quantum efficiency: what the filter lets pass, and less
    in red and blue, where silicon tells less. An assumption, about as such curves have it at their peaks."""
    share: float
    """Share of all pixels that have this filter."""
    spacing: float
    """Between a pixel of the colour and the nearest others [pixels]: finer detail than two of these, in the worst
    direction, is folded."""


FILTERS = (
    ColourFilter("R", "red", 600e-6, 0.7, 1 / 4, 2.0),
    ColourFilter("G", "green", 535e-6, 0.8, 1 / 2, 2.0**0.5),
    ColourFilter("B", "blue", 460e-6, 0.7, 1 / 4, 2.0),
)
"""Filters of a Bayer pattern, whatever its order."""
GREEN = FILTERS[1]


def filters(colours: Colours) -> tuple[ColourFilter, ...]:
    """Filters of a sensor; none of a monochrome one."""
    return () if colours == "mono" else FILTERS


def per_watt(one: ColourFilter) -> float:
    """Electrons per watt of white light in a pixel of a colour, as those of bare pixels go with the wavelength [mm]."""
    return one.taken * one.wavelength / BANDS


BRIGHTEST = max(map(per_watt, FILTERS))
"""Signal per watt of the brightest colour's pixels."""


def mixed(c: Camera) -> Camera:
    """A camera as pixels of all colours see it on average, once these are made equal; itself without filters."""
    if c.colours == "mono":
        return c
    return c.behind_filter({PATHS["wavelength"]: sum(one.share * one.wavelength for one in FILTERS)})


def mosaic(colours: Colours, column: int, row: int, columns: int, rows: int) -> NDArray[np.intp]:
    """Which of `FILTERS` the pixels of a region have, shape (rows, columns).

    Parameters
    ----------
    colours : str
        A pattern, not "mono".
    column, row, columns, rows : int
        The region; the pattern starts at the sensor's first pixel.
    """
    letters = [one.letter for one in FILTERS]
    cell = np.array([letters.index(letter) for letter in colours]).reshape(2, 2)  # type: ignore[arg-type]
    return np.asarray(cell[(np.arange(row, row + rows) % 2)[:, None], np.arange(column, column + columns) % 2])
