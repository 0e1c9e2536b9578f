"""Lines of a board's corners through the views: where views show a corner, against their place on the pupil."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .frames import Array, CalibrationError
from .model import Observations


class EpiLines(NamedTuple):
    """Lines u = u_mean + slope (s - s_mean), v = v_mean + slope (t - t_mean) of board b's corner n.

    Means and slope are independent for independent errors of the corners, and hold all that the views say of a corner
    but for distortion's second order in the baseline (1e-3 px in the paper's system).
    """

    mean: Array
    """(u, v) averaged over the views that saw the corner [pitches], shape (b, n, 2); NaN where fewer than one did."""
    at: Array
    """Average of (s', t') over the same views [px], shape (b, n, 2)."""
    slope: Array
    """Du/Ds' = Dv/Dt' [pitches/px], shape (b, n); NaN without a baseline."""
    views: Array
    """Views that saw the corner, shape (b, n)."""
    lever: Array
    """Sum of squared baselines along s and along t [px^2], shape (b, n, 2): slopes have variance sigma^2 over both."""
    sigma: float
    """Standard deviation of one coordinate about its line [pitches]; NaN with one view only."""

    @property
    def central(self) -> Array:
        """(u, v) in the central view [pitches], shape (b, n, 2)."""
        return self.mean - np.nan_to_num(self.slope)[..., None] * self.at


def fit_lines(observations: Observations) -> EpiLines:
    """Fit every corner's line.

    Raises
    ------
    CalibrationError
        A board without a corner.
    """
    seen = observations.seen
    if not seen.any(axis=(1, 2)).all():
        empty = [observations.names[k] for k in np.flatnonzero(~seen.any(axis=(1, 2)))]
        raise CalibrationError(f"no corner was seen of {', '.join(empty)}")
    count, held = seen.sum(axis=1).astype(float), seen[..., None]
    with np.errstate(invalid="ignore", divide="ignore"):
        weight = (seen / count[:, None])[..., None]
        st = np.broadcast_to(observations.views[None, :, None, :], observations.uv.shape)
        mean, at = ((weight * np.where(held, part, 0.0)).sum(axis=1) for part in (observations.uv, st))
        mean[count == 0] = np.nan
        base = np.where(held, st - at[:, None], 0.0)
        lever = np.square(base).sum(axis=1)
        power = lever.sum(axis=-1)
        moved = np.where(held, observations.uv - mean[:, None], 0.0)
        slope = np.where(power > 0, (base * moved).sum(axis=(1, 3)) / power, np.nan)
    rest = moved - np.nan_to_num(slope)[:, None, :, None] * base
    freedom = 2 * seen.sum() - 2 * (count > 0).sum() - (power > 0).sum()
    sigma = float(np.sqrt(np.square(rest).sum() / freedom)) if freedom > 0 and (power > 0).any() else float("nan")
    return EpiLines(mean, at, slope, count, lever, sigma)
