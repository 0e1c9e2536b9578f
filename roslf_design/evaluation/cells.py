"""Light in a microlens's own cell: the lattice's cell at the pitch of the images, about the image's chief ray."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .. import theory
from ..design import Design
from ..microlens.cells import area_in_polygon
from ..microlens.lattice import cell_polygon


def own_cell_area(design: Design, centres: NDArray[np.float64], radii: NDArray[np.float64]) -> NDArray[np.float64]:
    """Area of each microlens image inside its own cell.

    Parameters
    ----------
    design : Design
    centres, radii : ndarray
        Discs of the rims, the FAP first [mm], shapes (N, K, 2) and (N, K).

    Returns
    -------
    ndarray
        Shape (N,) [mm^2]; 0 where the images' pitch is 0, and with it the cell.
    """
    array = design.microlens_array
    pitch = abs(float(theory.microlens_image_pitch(design.d, design.d_2, design.f, design.d_f, design.d_3)))
    if pitch == 0:
        return np.zeros(len(radii))
    cell = cell_polygon(array.layout, pitch, array.rotation)
    return area_in_polygon(centres, radii, centres[:, :1] + cell)
