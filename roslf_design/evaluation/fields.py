"""Single microlenses: the shape of each image, and the ray budget in exact areas."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..design import Design
from ..microlens.discs import ClipStatus, intersect
from ..microlens.images import stop_images
from .cells import own_cell_area
from .result import Field, RayBudget
from .rims import axes_in_space, rims
from .tilted import RAYS, count_fields

STATUS = {ClipStatus.FULL: "full", ClipStatus.CLIPPED: "clipped", ClipStatus.EMPTY: "dark"}


def evaluate_fields(design: Design, axes: Sequence[tuple[float, float]], rays: int = RAYS) -> tuple[Field, ...]:
    """Shape and ray budget of the microlens at each place.

    Parameters
    ----------
    design : Design
    axes : sequence of (x, y)
        Microlens axes, on the MLA [mm].
    rays : int
        Counted where something is tilted.

    Returns
    -------
    tuple of Field
        From exact disc areas; where something is tilted and rims are no discs on the sensor, from counted rays.
    """
    if not axes:
        return ()
    if not design.aligned:
        return count_fields(design, axes, rays)
    centres, radii = field_discs(design, axes)
    past = [intersect(centres[:, :count], radii[:, :count]) for count in range(1, radii.shape[1] + 1)]
    shape = past[-1]
    own = own_cell_area(design, axes_in_space(design, axes), centres, radii) / (math.pi * radii[:, 0] ** 2)
    kept = np.stack([prefix.kept_fraction for prefix in past], -1)
    return tuple(
        Field(
            x_ml_mm=axis,
            status=STATUS[ClipStatus(int(shape.status[i]))],
            area_mm2=float(shape.area[i]),
            kept_fraction=float(shape.kept_fraction[i]),
            lost_fraction=float(shape.lost_fraction[i]),
            centroid_mm=(float(shape.centroid[i, 0]), float(shape.centroid[i, 1])) if shape.lit[i] else None,
            axis_ratio=float(shape.axis_ratio[i]) if shape.lit[i] else None,
            ray_budget=RayBudget(
                fap=1.0,
                main_lens=float(kept[i, 1]),
                stops=tuple(float(share) for share in kept[i, 2:]),
                own_cell=float(own[i]),
            ),
            rays=None,
        )
        for i, axis in enumerate(axes)
    )


def field_discs(design: Design, axes: Sequence[tuple[float, float]]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Discs that the FAP, the main lens and the stops cut out on the sensor, relative to each microlens axis.

    Parameters
    ----------
    design : Design
        Its tilts are left out.
    axes : sequence of (x, y)
        Microlens axes, on the MLA [mm].

    Returns
    -------
    (centres, radii)
        Shapes (N, K, 2) and (N, K) [mm], the FAP first.
    """
    all_rims = rims(design)
    return stop_images(
        axes_in_space(design, axes) - np.asarray(design.main_lens.decentre),
        [rim.diameter for rim in all_rims],
        [rim.distance for rim in all_rims],
        [rim.decentre for rim in all_rims],
        focal_length=design.f,
        focal_plane=design.d_f,
        mla_distance=design.d_1,
        sensor_distance=design.d_2,
    )
