"""Centre and shading of microlens images told apart: a slope of brightness across an image moves its centroid too."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .cells import CellMoments, cell_moments, window_pull
from .frames import Frame
from .lattice import Array, CentreLattice, LatticeFit, fit_lattice
from .ripple import without_ripple

_CORE = 0.45
"""Size of the inner window against the cell: inside the bright disc of most microlens images."""
_LEAST_PITCH = 11.5
"""Below it [px] the inner window is too few pixels wide, and shading moves centroids by under 0.01 px."""


class Centred(NamedTuple):
    """Centres of microlens images and what was taken off to get them."""

    offset: Array
    """Each lens's centre minus its cell's middle [px], shape (n, 2)."""
    fit: LatticeFit
    """Of the lenses marked good."""
    shading: float
    """Largest brightness slope taken off, across one pitch, relative; 0 where none was significant or separable."""
    pull: float
    """Share of a cell's displacement that its centroid follows."""


def centred(
    frame: Frame, lattice: CentreLattice, indices: NDArray[np.int64], moments: CellMoments, good: NDArray[np.bool_]
) -> Centred:
    """Free centroids of the drag of their cell's sides and of shading across the images.

    With the cell's middle off the true centre by -delta and brightness (1 + h x) across the image, the centroid in a
    window lies at ``(1 - pull) delta + h V``, V the second moment in the window. The cell and a smaller window inside
    it give two equations for the lattice's delta and h, both affine over the array. Vignetting of the scene, of the
    pupil and of the lenses all come out as h; nothing is assumed of how they share it. Only the change of h over the
    array is taken off: a constant h moves all centres alike, which no calibration notices, and looks the same as a
    pixel grid that beats with the lattice. Where the images have no flat top (heavy blur) the two equations say the
    same, and nothing is taken off.
    """
    nodes = lattice.nodes(indices[:, 0], indices[:, 1])
    sample = nodes[good][:: max(1, int(good.sum()) // 500)]
    pull, inner_pull = window_pull(frame, lattice, sample), window_pull(frame, lattice, sample, _CORE)
    free = max(1 - pull, 1e-6)
    whole = without_ripple(nodes, indices, moments.offset / free, good)
    plain = fit_lattice(indices[good], (nodes + whole)[good], lattice.layout)
    inner = cell_moments(frame, lattice, nodes, scale=_CORE)
    size, inner_size = _second_moment(moments, good), _second_moment(inner, good)
    crossing = size * (1 - inner_pull) - inner_size * free
    if lattice.pitch < _LEAST_PITCH or abs(crossing) < 0.6 * (size * abs(1 - inner_pull) + inner_size * free):
        return Centred(whole, plain, 0.0, pull)
    delta = without_ripple(nodes, indices, (size * inner.offset - inner_size * moments.offset) / crossing, good)
    apart = fit_lattice(indices[good], (nodes + delta)[good], lattice.layout)
    slope = free * (whole - (apart.lattice.nodes(indices[:, 0], indices[:, 1]) - nodes)) / size
    design = np.column_stack([np.ones(len(indices)), indices - indices[good].mean(axis=0)])
    both = np.flatnonzero(good)[apart.inliers & plain.inliers]
    growth = np.linalg.lstsq(design[both], slope[both], rcond=None)[0]
    field = design[:, 1:] @ growth[1:]
    moved = np.sqrt(np.mean((field * size / free) ** 2))
    noise = np.sqrt(np.mean(np.einsum("ni,ij,nj->n", design[:, 1:], apart.covariance[1:, 1:], design[:, 1:])))
    if moved < 4 * noise:
        return Centred(whole, plain, 0.0, pull)
    offset = whole - field * size / free
    fit = fit_lattice(indices[good], (nodes + offset)[good], lattice.layout)
    fit = fit._replace(covariance=apart.covariance)
    return Centred(offset, fit, float(np.hypot(*field.T).max()) * lattice.pitch, pull)


def _second_moment(moments: CellMoments, good: NDArray[np.bool_]) -> float:
    """Mean second moment about the window's middle along one axis [px^2]."""
    about_middle = moments.spread[good][:, [0, 2]] + moments.offset[good] ** 2
    return float(np.median(about_middle.mean(axis=1)))
