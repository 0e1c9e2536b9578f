"""How sure the lengths of a calibrated camera are."""

from __future__ import annotations

import numpy as np

from ..design import PATHS
from ..theory.length_covariance import LengthCovariance
from .model import DataSheet
from .posterior import CameraDraws


def drawn_covariance(draws: CameraDraws, sheet: DataSheet) -> LengthCovariance:
    """Covariance of a design's calibrated lengths, elements before the lens included, from draws of them."""
    lengths = dict(draws.quantities)
    if (space := sheet.space_at(lengths)) is not None:
        lengths |= space.ruler(lengths)
    own = {PATHS[name]: lengths[name] for name in ("d_3", "d_1", "d_2", "d", "q")} | {PATHS["f"]: draws.draws("f")}
    drawn = own | {known.place: lengths[known.place] for known in sheet.uncertain}
    return LengthCovariance(tuple(drawn), np.atleast_2d(np.cov(np.stack([*drawn.values()]))))
