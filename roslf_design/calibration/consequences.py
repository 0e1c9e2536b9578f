"""What a calibration's uncertainty means: in measured depths, and by where it comes from."""

from __future__ import annotations

import numpy as np

from .datasheet import QUANTITIES, DataSheet, derived
from .draws import Draws
from .errors import CalibrationError
from .lattice import Array
from .statistics_fit import StatisticsFit


def depth_errors(draws: Draws, fit: StatisticsFit, sheet: DataSheet, distances: Array) -> dict[str, Array]:
    """What the calibration's uncertainty does to depths measured with it.

    Parameters
    ----------
    draws : Draws
        Of a posterior, or of the normal law in its place.
    fit : StatisticsFit
        Whose camera makes the slope of a point at each distance.
    sheet : DataSheet
    distances : ndarray
        From the main lens [mm], beyond the FAP, shape (k,).

    Returns
    -------
    dict
        ``distance``; ``from_lens`` and ``from_pupil``: standard deviation of Z and of Z_F [mm]; ``low_95`` and
        ``high_95``: interval of the error of Z [mm]; each of shape (k,).

    Notes
    -----
    Eq. 12 solved for depth. The images' errors of d_3 and of A cancel in distances from the lens near the focal plane
    (d_f = f (1 + m)/m knows nothing of A), where the error of f alone is left; in distances from the pupil f drops out
    and the error of A stays.
    """
    distances = np.asarray(distances, float)
    best = derived(fit.camera.vector(), sheet, np.asarray(sheet.f))
    depth = distances - best["d_3"]
    if not (depth > 0).all():
        raise CalibrationError(f"distances must lie beyond the FAP at {float(best['d_3']):.2f} mm from the lens")
    # (m - A/Z_F) A/d_2 is what the views measure; d and q scale with it.
    measured = (best["m"] - best["A"] / depth) * best["A"] / best["d_2"]
    p = draws.quantities
    m, A, d_2, d_3 = (p[name][:, None] for name in ("m", "A", "d_2", "d_3"))
    with np.errstate(divide="ignore"):
        z_f = A / (m - measured * d_2 / A)
    z = z_f + d_3
    low, high = np.quantile(z - distances, [0.025, 0.975], axis=0)
    return {
        "distance": distances,
        "from_lens": z.std(axis=0, ddof=1),
        "from_pupil": z_f.std(axis=0, ddof=1),
        "low_95": low,
        "high_95": high,
    }


def variance_shares(fit: StatisticsFit, sheet: DataSheet) -> dict[str, dict[str, float]]:
    """To first order, what share of each quantity's variance comes from the images and from each data-sheet value.

    Returns
    -------
    dict
        For each of `QUANTITIES`, shares of ``images``, ``f``, ``q``, ``d``, ``board`` and ``systematic`` (what
        scatter does not show) that add up to 1, and ``sigma``, the standard deviation of all.
    """
    camera = fit.camera.vector()[:3]
    names = [n for n in ("A", "m", "inverse_d_2") if n in fit.covariance.names]
    root = np.linalg.cholesky(fit.covariance.part(names))
    steps: dict[str, list[tuple[Array, Array]]] = {"images": [(column, np.zeros(4)) for column in root.T]}
    sigmas = (sheet.f_sigma, sheet.q_sigma, sheet.d_sigma, sheet.cell_sigma)
    for k, name in enumerate(("f", "q", "d", "board")):
        steps[name] = [(np.zeros(3), np.eye(4)[k] * sigmas[k])]
    steps["systematic"] = [(shift, np.zeros(4)) for shift in fit.systematic]
    variances: dict[str, dict[str, float]] = {name: {} for name in QUANTITIES}
    for source, moves in steps.items():
        spread = dict.fromkeys(QUANTITIES, 0.0)
        for by_camera, by_sheet in moves:
            ahead, behind = (_derived_at(camera, sheet, sign * by_camera, sign * by_sheet) for sign in (0.01, -0.01))
            for name in QUANTITIES:
                spread[name] += float((ahead[name] - behind[name]) / 0.02) ** 2
        for name in QUANTITIES:
            variances[name][source] = spread[name]
    shares = {}
    for name, parts in variances.items():
        total = sum(parts.values())
        shares[name] = {source: part / total if total > 0 else 0.0 for source, part in parts.items()}
        shares[name]["sigma"] = float(np.sqrt(total))
    return shares


def _derived_at(camera: Array, sheet: DataSheet, by_camera: Array, by_sheet: Array) -> dict[str, Array]:
    f, q, d, board = np.array([sheet.f, sheet.q, sheet.d, 1.0]) + by_sheet
    return derived(camera + by_camera, sheet, np.asarray(f), np.array([q, d, board]))
