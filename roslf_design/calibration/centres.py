"""Microlens centres from a white image: estimate, grow, measure, judge, fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .cells import CellMoments, cell_moments
from .errors import CalibrationError
from .frames import Frame, grey_frame, saturation_level
from .lattice import Array, CentreLattice, LatticeFit, Layout, fit_lattice
from .shading import centred
from .spectrum import estimate_lattice
from .trust import Reason, judge_shapes

_SAMPLE = 3000
"""Lenses measured in each step of growth: enough for 0.01 px."""
WHITE_ALL_OVER = 0.9
"""Share of saturated pixels above which no lattice is left to find; below it, microlens images are counted."""


@dataclass(frozen=True, eq=False)
class MicrolensCentres:
    """The lattice of microlens images and the evidence for it."""

    lattice: CentreLattice
    indices: NDArray[np.int64]
    """Lattice indices (i, j) of every lens inside the image, shape (n, 2)."""
    measured: Array
    """Each lens's own centre [px], shape (n, 2): its centroid, freed of shading and of the drag of its cell's sides."""
    reasons: NDArray[np.int8]
    """A `Reason` for each lens: 0 where it was used in the fit."""
    light: Array
    """Sum over each cell, shape (n,)."""
    rms: float
    """RMS distance per axis between the used lenses' own centres and the lattice [px]."""
    sigma: float
    """Standard deviation, per axis, of the fitted lattice's centres from noise: RMS over all lenses [px]."""
    unseen_cut: float
    """RMS error of the fitted centres [px] that cuts too slight to be seen may cause, extrapolated over the field."""
    cut_bias: float
    """Mean distance [px] from the worst 5 % of the lenses, cut, to the lattice: the bias avoided."""
    pull: float
    """Share of a cell's displacement that its centroid follows."""
    shading: float
    """Largest slope of brightness taken off, across one pitch, relative; 0 where none was found."""

    @property
    def used(self) -> NDArray[np.bool_]:
        """Lenses that spoke in the fit."""
        return np.equal(self.reasons, Reason.USED)

    @property
    def centres(self) -> Array:
        """Fitted centres [px], shape (n, 2)."""
        return self.lattice.nodes(self.indices[:, 0], self.indices[:, 1])

    def counts(self) -> dict[str, int]:
        """Lenses for each reason, in words."""
        return {reason.text: int(np.sum(self.reasons == reason)) for reason in Reason if np.any(self.reasons == reason)}


def find_centres(
    white: ArrayLike | None,
    dark: ArrayLike | None = None,
    *,
    pitch: float | None = None,
    layout: Layout | None = None,
    saturation: float | None = None,
    undistorted_radius: float | None = None,
    axis: tuple[float, float] | None = None,
) -> MicrolensCentres:
    """Centres of the microlens images in a white image, for square and hexagonal arrays at any rotation.

    The lattice is fitted to the lenses whose image is whole. Towards the edge of the field a second stop cuts images
    to cat's eyes and draws their centroids towards the axis; those lenses are known by their shape and left out, and
    get their centres from the lattice.

    Parameters
    ----------
    white, dark : array_like
        White image and, optionally, a frame without light, shape (rows, columns).
    pitch : float, optional
        Expected pitch [px].
    layout : {"square", "hexagonal"}, optional
        Expected layout.
    saturation : float, optional
        Grey level of a saturated pixel in `white`; found from the image where not given.
    undistorted_radius : float, optional
        Radius [px] about `axis` inside which Eq. 6 promises whole images: lenses beyond are left out, and those inside
        still judged by their shape.
    axis : (float, float), optional
        Where the optical axis meets the sensor [px]; the middle of the image where not given.

    Raises
    ------
    CalibrationError
        Without a white image, with one of another size than its dark frame, saturated, without a lattice, or with too
        few whole images.
    """
    frame = grey_frame(white, dark, "white image")
    level = saturation_level(np.asarray(white)) if saturation is None else saturation
    full = float(np.mean(np.asarray(white) >= level))
    if full > WHITE_ALL_OVER:
        raise CalibrationError(
            f"the white image is saturated: {100 * full:.0f} % of its pixels reach grey level {level:g}; expose less"
        )
    raw = frame if dark is None else grey_frame(white, None, "white image")
    coarse = _grown(frame, estimate_lattice(frame, pitch, layout))
    fit = _Fit(frame, raw, level, undistorted_radius, axis)
    result = fit(coarse)
    return fit(result.lattice)


@dataclass(frozen=True, eq=False)
class _Fit:
    """One round: measure every cell at the current lattice, judge, fit anew."""

    frame: Frame
    raw: Frame
    level: float
    radius: float | None
    axis: tuple[float, float] | None

    def __call__(self, lattice: CentreLattice) -> MicrolensCentres:
        shape = self.frame.shape
        indices = lattice.inside((shape[0], shape[1]))
        nodes = lattice.nodes(indices[:, 0], indices[:, 1])
        moments = cell_moments(self.frame, lattice, nodes)
        reasons, distance = self._first_reasons(lattice, indices, nodes, moments)
        good = reasons == Reason.USED
        if good.sum() < 12:
            raise CalibrationError(f"only {int(good.sum())} whole microlens images in the white image: 12 are needed")
        if self.radius is not None:
            reasons[good & (distance > self.radius)] = Reason.BEYOND
            good = reasons == Reason.USED
            if good.sum() < 12:
                raise CalibrationError(
                    f"only {int(good.sum())} microlens images lie within the {self.radius:.4g} px of the axis that"
                    " Eq. 6 leaves undistorted: 12 are needed; does the design describe this camera?"
                )
        shapes = judge_shapes(indices, moments.spread, good, distance)
        reasons[good & shapes.cut] = Reason.CUT
        limit = shapes.threshold
        good = reasons == Reason.USED
        if good.sum() < 12:
            raise CalibrationError(
                f"only {int(good.sum())} microlens images are not cut by a stop: the lattice cannot be told from cat's"
                " eyes; capture the white image with the second stop opened or give `undistorted_radius`"
            )
        offset, fit, shading, pull = centred(self.frame, lattice, indices, moments, good)
        if pull > 0.97:
            raise CalibrationError(
                "the microlens images melt into each other: the white image shows no contrast to centre on"
            )
        measured = nodes + offset
        reasons[np.flatnonzero(good)[~fit.inliers]] = Reason.OUTLIER
        reach = float(distance.max() / distance[reasons == Reason.USED].max())
        unseen = 0.0 if not np.isfinite(limit) else limit * lattice.pitch / 8 / (1 - pull) * reach / 2
        return MicrolensCentres(
            lattice=fit.lattice,
            indices=indices,
            measured=measured,
            reasons=reasons,
            light=moments.light,
            rms=fit.rms,
            sigma=_sigma(fit, indices),
            unseen_cut=unseen,
            cut_bias=_bias(fit, indices, measured, reasons),
            pull=pull,
            shading=shading,
        )

    def _first_reasons(
        self, lattice: CentreLattice, indices: NDArray[np.int64], nodes: Array, moments: CellMoments
    ) -> tuple[NDArray[np.int8], Array]:
        rows, columns = self.frame.shape
        reasons = np.zeros(len(indices), np.int8)
        _, halves = lattice.cell()
        reach = float(halves.max()) * (1.4143 if lattice.layout == "square" else 1.1548) + 1
        border = (nodes < reach).any(axis=1) | (nodes > (columns - 1 - reach, rows - 1 - reach)).any(axis=1)
        hot = np.zeros(len(indices), bool)
        if np.isfinite(self.level):
            hot = cell_moments(self.raw, lattice, nodes, self.level).saturated > 0
        inside = ~border
        if inside.any() and hot[inside].mean() > 0.2:
            raise CalibrationError(
                f"the white image is saturated: {100 * hot[inside].mean():.0f} % of its microlens images reach"
                f" grey level {self.level:g}; expose less"
            )
        typical = float(np.median(moments.light[inside])) if inside.any() else 0.0
        reasons[moments.light < 0.05 * typical] = Reason.DARK
        reasons[hot] = Reason.SATURATED
        reasons[border] = Reason.BORDER
        middle = np.array([(columns - 1) / 2, (rows - 1) / 2]) if self.axis is None else np.asarray(self.axis, float)
        return reasons, np.hypot(*(nodes - middle).T)


def _grown(frame: Frame, lattice: CentreLattice) -> CentreLattice:
    """Follow the lattice from the middle of the image to its corners, doubling the radius with every fit."""
    rows, columns = frame.shape
    _, halves = lattice.cell()
    everywhere = lattice.inside((rows, columns), margin=float(halves.max()) * 1.5)
    reach, farthest = 6.0, float(np.hypot(*everywhere.T).max()) if len(everywhere) else 0.0
    while True:
        near = everywhere[np.hypot(*everywhere.T) <= reach]
        if len(near) < 9:
            raise CalibrationError("the white image holds too few whole microlens images: at least 5 x 5 are needed")
        near = near[:: max(1, len(near) // _SAMPLE)]
        for _ in range(3 if reach == 6.0 else 1):
            nodes = lattice.nodes(near[:, 0], near[:, 1])
            moments = cell_moments(frame, lattice, nodes)
            lit = moments.light > 0.05 * np.median(moments.light)
            lattice = fit_lattice(near[lit], (nodes + moments.offset)[lit], lattice.layout).lattice
        if reach >= farthest:
            return lattice
        reach *= 2


def _sigma(fit: LatticeFit, indices: NDArray[np.int64]) -> float:
    design = np.column_stack([np.ones(len(indices)), indices])
    return float(np.sqrt(np.mean(np.einsum("ni,ij,nj->n", design, fit.covariance, design))))


def _bias(fit: LatticeFit, indices: NDArray[np.int64], measured: Array, reasons: NDArray[np.int8]) -> float:
    cut = reasons == Reason.CUT
    if not cut.any():
        return 0.0
    off = measured[cut] - fit.lattice.nodes(indices[cut, 0], indices[cut, 1])
    worst = np.sort(np.hypot(*off.T))[-max(1, len(reasons) // 20) :]
    return float(worst.mean())
