"""Every way to compute each quantity, with its levels of effort."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from .jobs import Job

Floats = NDArray[np.float64]

Kind = Literal[
    "exact", "panels", "adaptive", "grid", "random", "sobol", "series", "fft", "huygens", "fit", "first order"
]


@dataclass(frozen=True)
class Method:
    """One way."""

    name: str
    quantity: str
    kind: Kind
    levels: tuple[int, ...]
    """Efforts, rising: samples, nodes, subpixels; (0,) where there is nothing to choose."""
    compute: Callable[[Job, int, int], Floats] = field(repr=False)
    """Result for a job, a level and a seed."""
    work: Callable[[Job, int], float] = field(repr=False)
    """Evaluations, which time is proportional to beyond a fixed part."""
    does: str = ""
    """One line for the table of methods."""
    tested_on: Callable[[Job], bool] = field(default=lambda job: True, repr=False)
    """Whether it can compute a job at all."""

    @property
    def random(self) -> bool:
        """Whether the result depends on the seed."""
        return self.kind in ("random", "sobol")


@cache
def methods(quantity: str) -> tuple[Method, ...]:
    """All methods of one quantity.

    Raises
    ------
    ValueError
        No such quantity.
    """
    from .cut_methods import CUTS
    from .depth_methods import DEPTH
    from .image_methods import IMAGES
    from .lens_methods import LENSES
    from .shape_methods import SHAPES
    from .wave_methods import WAVES

    found = tuple(
        method for method in (*SHAPES, *IMAGES, *WAVES, *CUTS, *LENSES, *DEPTH) if method.quantity == quantity
    )
    if not found:
        from .jobs import QUANTITIES

        raise ValueError(f'no quantity is called "{quantity}"; there are {", ".join(QUANTITIES)}')
    return found


def random_points(kind: Kind, count: int, seed: int) -> Floats:
    """Points in the unit square, shape (count, 2): independent, or scrambled Sobol."""
    if kind == "random":
        return np.random.default_rng(seed).random((count, 2))
    from scipy.stats.qmc import Sobol

    return np.asarray(Sobol(2, seed=seed).random(count))


def grid_points(count: int) -> Floats:
    """Centres of count x count squares, shape (count^2, 2)."""
    at = (np.arange(count) + 0.5) / count
    return np.stack([np.tile(at, count), np.repeat(at, count)], -1)


def inside(centres: Floats, radii: Floats, x: Floats, y: Floats) -> NDArray[np.bool_]:
    """Whether points lie in all discs."""
    kept = np.ones(np.broadcast_shapes(x.shape, y.shape), np.bool_)
    for (cx, cy), r in zip(centres, radii, strict=True):
        kept &= (x - cx) ** 2 + (y - cy) ** 2 <= r * r
    return kept
