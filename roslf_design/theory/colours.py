"""Colour filters on a sensor's pixels, and the camera as the pixels of one colour see it.

Light is taken as white: a third of it at each filter's wavelength, of which that filter lets a part pass and the others
nothing. A colour's pixels are a coarser lattice of pixels just as large: of green every second one (a quincunx), of red
and blue every fourth. What pixels of all colours tell of a scene without colours of its own adds up.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from ..bore.part import Colours
from ..camera import Camera, Number
from ..design.parts import PATHS

Letter = Literal["R", "G", "B"]

BANDS = 3
"""Parts of equal power that white light is taken to have."""


class ColourFilter(NamedTuple):
    """Filters of one colour."""

    letter: Letter
    name: str
    wavelength: float
    """Wavelength of the filter's peak [mm]; about as in makers' curves of colour CMOS sensors."""
    taken: float
    """Electrons per photon of its band, over the bare sensor's quantum efficiency: what the filter lets pass, and less
    in red and blue, where silicon tells less. An assumption, about as such curves have it at their peaks."""
    share: float
    """Share of all pixels that have this filter."""
    spacing: float
    """Distance between a pixel of the colour and the nearest others [pixels]: finer detail than two of these, in the
    worst direction, is folded."""


FILTERS = (
    ColourFilter("R", "red", 600e-6, 0.7, 1 / 4, 2.0),
    ColourFilter("G", "green", 535e-6, 0.8, 1 / 2, 2.0**0.5),
    ColourFilter("B", "blue", 460e-6, 0.7, 1 / 4, 2.0),
)
"""Filters of a Bayer pattern, whatever its order."""
GREEN = FILTERS[1]


def per_watt(one: ColourFilter) -> float:
    """Electrons per watt of white light in a pixel of a colour, as those of bare pixels go with the wavelength [mm]."""
    return one.taken * one.wavelength / BANDS


BRIGHTEST = max(map(per_watt, FILTERS))
"""Signal per watt of the brightest colour's pixels."""


class _PixelFilters:
    """Filters on a sensor's pixels: none."""

    kinds: tuple[ColourFilter, ...] = ()
    spacing = 1.0
    """Between pixels of the colour that has most [pixels]."""
    pixels = "pixels"
    """Words for those."""
    name = "none"
    words = "monochrome"

    def mixed(self, c: Camera) -> Camera:
        """A camera as pixels of all colours see it on average, once these are made equal."""
        return c

    def brightest(self, wavelength: Number) -> Number:
        """Wavelength [mm] times electrons per photon of white light, over a bare pixel's, where that is most."""
        return wavelength


class _Bayer(_PixelFilters):
    """A Bayer pattern."""

    kinds, spacing, pixels = FILTERS, GREEN.spacing, f"green pixels ({GREEN.spacing:.3g} px apart)"

    def __init__(self, pattern: Colours) -> None:
        self.name, self.words = pattern, f"colour filters {pattern}"

    def mixed(self, c: Camera) -> Camera:
        """A camera at the mean wavelength of all pixels."""
        return c.behind_filter({PATHS["wavelength"]: sum(one.share * one.wavelength for one in FILTERS)})

    def brightest(self, wavelength: Number) -> Number:
        """`BRIGHTEST`, whatever the design's wavelength."""
        return BRIGHTEST


PIXEL_FILTERS: Mapping[Colours, _PixelFilters] = MappingProxyType(
    {"mono": _PixelFilters(), **{pattern: _Bayer(pattern) for pattern in get_args(Colours) if pattern != "mono"}}
)
"""Filters by their names in a design file."""


def filters(colours: Colours) -> tuple[ColourFilter, ...]:
    """Filters of a sensor; none of a monochrome one."""
    return PIXEL_FILTERS[colours].kinds


def panchromatic(c: Camera) -> Camera:
    """A camera as pixels of all colours see it on average, once these are made equal; itself without filters."""
    return PIXEL_FILTERS[c.colours].mixed(c)


def mosaic(colours: Colours, column: int, row: int, columns: int, rows: int) -> NDArray[np.intp]:
    """Index in `FILTERS` of each pixel's filter in a region, shape (rows, columns).

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
