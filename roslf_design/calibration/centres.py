"""Microlens centres from a white image: estimate, grow, measure, judge, fit."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._jit import WHOLE, Band, kernel, prange
from .frames import Array, CalibrationError, Frame, grey_frame, refuse_saturated
from .lattice import CentreLattice, LatticeFit, Layout, estimate_lattice, fit_lattice, lattice_of_phases

_SAMPLE = 3000
"""Lenses measured in each step of growth: enough for 0.01 px."""
_ALL_OVER = 0.9
"""Share of saturated pixels above which no lattice is left to find; below it, microlens images are counted."""
_FEWEST = 12
"""Whole microlens images that a fit takes."""
_START = 6.0
"""Lenses about the light's middle from which the lattice is followed, and which tell how much contrast an image has."""
_DIM = 0.05
"""Contrast under which a microlens shows no image, against those in the light's middle."""
_BEND = 0.05
"""Least distance between straight and bent lattice that a bend is worth [px]."""
_BENT = 3
"""Order of the distortion that measured centres carry."""
_OFF = 0.1
"""Distance from their lattice that the centres of a neighbourhood may share [px]: more is told."""
_DARK_SCENE = 0.1
"""Light against that of a scene's bright parts under which its texture is not divided off."""
_CALM = 0.3
"""Change of a scene's brightness over a microlens image at which that counts half."""
_MOST_CUT, _LEAST_USED = 0.05, 0.5
"""Share of the lenses cut where the design has none, and of the lit lenses used, beyond which it is told."""


class Reason(IntEnum):
    """Reason why a lens was left out of the lattice fit."""

    USED = 0
    BORDER = 1
    DARK = 2
    SATURATED = 3
    CUT = 4
    OUTLIER = 5
    BEYOND = 6

    @property
    def text(self) -> str:
        """Phrase for reports."""
        return _REASONS[self]


_REASONS = (
    "used",
    "cell reaches over the image's edge",
    "too dark",
    "saturated pixels",
    "image cut by a stop (cat's eye)",
    "off the lattice by over 5 sigma",
    "beyond the undistorted field",
)


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
    rms: float
    """RMS distance per axis between the used lenses' own centres and the lattice [px]."""
    warnings: tuple[str, ...] = ()
    """Faults that the image shows of a lattice of whole images, for the user."""

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
    layout: Layout | None = None,
    pitch: float | None = None,
    undistorted_radius: float | None = None,
) -> MicrolensCentres:
    """Centres of the microlens images in a white image, for square and hexagonal arrays at any rotation.

    The lattice is fitted to the lenses whose image is whole. Towards the edge of the field a second stop cuts images
    to cat's eyes and draws their centroids towards the axis; those lenses are known by what they lost of their shape,
    their size and their light, and left out, and get their centres from the lattice. The field may be a part of the
    image, round as behind an endoscope. A lattice that distortion bends is followed to third order.

    Parameters
    ----------
    white, dark : array_like
        White image and, optionally, a frame without light, shape (rows, columns).
    layout : {"square", "hexagonal"}, optional
        Expected layout.
    pitch : float, optional
        Expected pitch of the microlens images [px], such as the design's: to be preferred where dirt, missing lenses or
        the field's edge show other periods. An image of another pitch is measured as it is.
    undistorted_radius : float, optional
        Radius [px] about the image's middle inside which Eq. 6 promises whole images: lenses beyond are left out, and
        those inside still judged by their shape.

    Raises
    ------
    CalibrationError
        Without a white image, with one of another size than its dark frame, saturated, without a lattice, or with too
        few whole images.
    """
    frame = grey_frame(white, dark, "white image")
    level = refuse_saturated(np.asarray(white), "white image", _ALL_OVER)
    raw = frame if dark is None else grey_frame(white, None, "white image")
    if dark is None:  # a pedestal hides what cut images lose
        frame = frame - np.float32(np.quantile(frame.ravel()[:: 1 + frame.size // 500_000], 0.01))
    lattice = _grown(frame, estimate_lattice(frame, layout, pitch))
    centres = _fitted(frame, raw, level, undistorted_radius, lattice)
    for _ in range(1 if centres.lattice.bend is None else 2):
        centres = _fitted(frame, raw, level, undistorted_radius, centres.lattice)
    return centres


def find_centres_in_scene(
    raw: ArrayLike, dark: ArrayLike | None = None, *, layout: Layout, pitch: float
) -> MicrolensCentres:
    """Centres of the microlens images in a picture of a scene, where there is no white image.

    What the scene has over more than a microlens image is divided off; the lattice is where the rest is in step with
    one of the expected pitch. Good for views and pictures, not for a calibration: a scene that sends its light to one
    side of all microlens images moves all centres alike, which nothing shows, and no bend is followed.

    Parameters
    ----------
    raw, dark : array_like
        Picture and, optionally, a frame without light, shape (rows, columns).
    layout : {"square", "hexagonal"}
        As designed: a scene has periods of its own.
    pitch : float
        Of the microlens images, as designed [px].

    Raises
    ------
    CalibrationError
        A raw image that is none or saturated; no such lattice in it.
    """
    from scipy.ndimage import maximum_filter, minimum_filter, uniform_filter

    frame = grey_frame(raw, dark, "raw image")
    refuse_saturated(np.asarray(raw), "raw image", _MOST_CUT)
    size = max(round(pitch), 3)
    around = uniform_filter(uniform_filter(frame, size), size)
    bright = float(np.quantile(around.ravel()[:: 1 + frame.size // 500_000], 0.9))
    lit = around > max(_DARK_SCENE * bright, 1e-30)
    even = np.where(lit, frame / np.where(lit, around, 1) - 1, 0).astype(np.float32)
    np.clip(even, -1, 1, out=even)
    # Edges in the scene speak of themselves: the less it changes over a microlens image, the more that counts.
    change = (maximum_filter(around, size) - minimum_filter(around, size)) / np.where(lit, around, 1)
    even /= 1 + np.square(change / _CALM)
    try:
        lattice, apart = lattice_of_phases(even, layout, pitch)
    except CalibrationError as error:
        raise CalibrationError(f"{error}; give a white image, or the design of this camera") from None
    indices = lattice.inside((frame.shape[0], frame.shape[1]))
    nodes = lattice.nodes(indices[:, 0], indices[:, 1])
    moments = _cell_moments(even + 1, lattice, nodes)
    border = ~_within(lattice, nodes, frame.shape)
    at = np.clip(np.rint(nodes).astype(int), 0, np.array(frame.shape[::-1]) - 1)
    reasons = np.where(border, Reason.BORDER, np.where(lit[at[:, 1], at[:, 0]], Reason.USED, Reason.DARK))
    if (reasons == Reason.USED).sum() < _FEWEST:
        raise CalibrationError("the raw image holds too few microlens images with light")
    rms = float(np.sqrt(np.mean(moments.offset[reasons == Reason.USED] ** 2)))
    said = (
        f"centres come from the scene itself, to about {apart:.2g} px; and where its light fills one side of the pupil"
        " more than the other, all views are off alike: a white image shows it"
    )
    return MicrolensCentres(lattice, indices, nodes + moments.offset, reasons.astype(np.int8), rms, (said,))


def _fitted(frame: Frame, raw: Frame, level: float, radius: float | None, lattice: CentreLattice) -> MicrolensCentres:
    """One round: measure every cell at the current lattice, judge, fit anew."""
    indices = lattice.inside((frame.shape[0], frame.shape[1]))
    nodes = lattice.nodes(indices[:, 0], indices[:, 1])
    moments, core = _cell_moments(frame, lattice, nodes), _cell_moments(frame, lattice, nodes, scale=_CORE)
    reasons = _first_reasons(frame, raw, level, lattice, indices, nodes, _contrast(lattice, moments, core))
    lit = (reasons != Reason.BORDER) & (reasons != Reason.DARK)

    def enough(said: str) -> NDArray[np.bool_]:
        good = np.equal(reasons, Reason.USED)
        if good.sum() < _FEWEST:
            raise CalibrationError(f"only {int(good.sum())} {said}")
        return good

    good = enough(f"whole microlens images in the white image: {_FEWEST} are needed")
    within = np.ones(len(nodes), bool)
    if radius is not None:
        within = np.hypot(*(nodes - (np.array(frame.shape[::-1]) - 1) / 2).T) <= radius
        reasons[good & ~within] = Reason.BEYOND
        good = enough(
            f"microlens images lie within the {radius:.4g} px of the axis that Eq. 6 leaves undistorted:"
            f" {_FEWEST} are needed; does the design describe this camera?"
        )
    distance = np.hypot(*(nodes - nodes[good].mean(axis=0)).T)
    cut = good & _cut(indices, moments, good, distance)
    reasons[cut] = Reason.CUT
    good = enough(
        "microlens images are not cut by a stop: the lattice cannot be told apart from cat's eyes; capture the white "
        "image with the second stop opened or give `undistorted_radius`"
    )
    offset, fit = _centred(frame, lattice, indices, moments, core, good)
    reasons[np.flatnonzero(good)[~fit.inliers]] = Reason.OUTLIER
    notes = []
    if radius is not None and cut.sum() > _MOST_CUT * (within & lit).sum():
        notes.append(
            f"{cut.sum()} of {(within & lit).sum()} microlens images look cut by a stop where Eq. 6 says that the"
            " design cuts none: are its aperture, stops and main lens those of this camera?"
        )
    used = np.equal(reasons, Reason.USED)
    if used.sum() < _LEAST_USED * lit.sum():
        notes.append(f"only {used.sum()} of {lit.sum()} microlens images with light say where the lattice lies")
    own = fit.lattice.nodes(indices[:, 0], indices[:, 1])
    if fit.lattice.bend is not None:
        bend = float(np.hypot(*fit.lattice.bend.at(indices[lit]).T).max())
        notes.append(
            f"the microlens images depart from a regular lattice by up to {bend:.2g} px, as a relay's or the main"
            " lens's distortion has them do; their centres follow it to third order"
        )
    astray = _neighbourhood_mean(indices, nodes + offset - own, np.asarray(used))[used]
    left = float(np.quantile(np.hypot(*astray.T), 0.99))
    if left > _OFF:
        notes.append(
            f"neighbouring microlens images lie up to {left:.2g} px off the lattice together, and views are read as far"
            " beside them: is there distortion, or a seam in the array?"
        )
    return MicrolensCentres(fit.lattice, indices, nodes + offset, reasons, fit.rms, tuple(notes))


def _first_reasons(
    frame: Frame,
    raw: Frame,
    level: float,
    lattice: CentreLattice,
    indices: NDArray[np.int64],
    nodes: Array,
    contrast: Array,
) -> NDArray[np.int8]:
    reasons = np.zeros(len(nodes), np.int8)
    border = ~_within(lattice, nodes, frame.shape)
    middle = ~border & (np.hypot(*indices.T) <= _START)
    if not middle.any():
        raise CalibrationError(f"only 0 whole microlens images in the white image: {_FEWEST} are needed")
    # Noise can lend a dark cell contrast, but not its neighbours as well.
    around = _neighbourhood_mean(indices, contrast[:, None], np.asarray(~border))[:, 0]
    lit = ~border & (np.minimum(contrast, around) > _DIM * float(np.median(contrast[middle])))
    hot = np.zeros(len(nodes), bool)
    if np.isfinite(level):
        hot = _cell_moments(raw, lattice, nodes, level).saturated > 0
    if lit.any() and hot[lit].mean() > 0.2:
        raise CalibrationError(
            f"the white image is saturated: {100 * hot[lit].mean():.0f} % of its microlens images reach"
            f" grey level {level:g}; expose less"
        )
    reasons[~lit] = Reason.DARK
    reasons[hot] = Reason.SATURATED
    reasons[border] = Reason.BORDER
    return reasons


def _within(lattice: CentreLattice, nodes: Array, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Whether all of a node's cell lies in the image."""
    reach = float(lattice.cell()[1].max()) * (1.4143 if lattice.layout == "square" else 1.1548) + 1
    return np.asarray(((nodes >= reach) & (nodes <= np.array(shape[::-1]) - 1 - reach)).all(axis=1))


def _contrast(lattice: CentreLattice, whole: _CellMoments, core: _CellMoments) -> Array:
    """Mean level in the middle of each cell less that of all of it: light of an image, no pedestal's, no glow's."""
    area = abs(float(np.linalg.det(lattice.basis)))
    return core.light / (_CORE**2 * area) - whole.light / area


def _grown(frame: Frame, lattice: CentreLattice) -> CentreLattice:
    """Follow the lattice from the light's middle to the image's corners, doubling the radius with every fit."""
    everywhere = lattice.inside((frame.shape[0], frame.shape[1]), margin=float(lattice.cell()[1].max()) * 1.5)
    distance = np.hypot(*everywhere.T)
    reach, farthest, typical = _START, float(distance.max(initial=0.0)), 0.0
    while True:
        near = everywhere[distance <= reach]
        if len(near) < 9:
            raise CalibrationError("the white image holds too few whole microlens images: at least 5 x 5 are needed")
        near = near[:: max(1, len(near) // _SAMPLE)]
        for _ in range(3 if reach == _START else 1):
            nodes = lattice.nodes(near[:, 0], near[:, 1])
            moments = _cell_moments(frame, lattice, nodes)
            contrast = _contrast(lattice, moments, _cell_moments(frame, lattice, nodes, scale=_CORE))
            typical = float(np.median(contrast)) if reach == _START else typical
            lit = contrast > 0.2 * typical
            lattice = fit_lattice(near[lit], (nodes + moments.offset)[lit], lattice.layout).lattice
        if reach >= farthest:
            return lattice
        reach *= 2


# --- moments of a cell's light ----------------------------------------------------------------------------------------


class _CellMoments(NamedTuple):
    """Moments of the light inside each lens's Voronoi cell, about the cell's middle."""

    light: Array
    """Sum of the pixel values, shape (n,)."""
    offset: Array
    """Centroid minus the cell's middle [px], shape (n, 2)."""
    spread: Array
    """Central second moments xx, xy, yy [px^2], shape (n, 3)."""
    saturated: NDArray[np.int64]
    """Pixels at or above the saturation level in the cell."""


def _cell_moments(
    image: Frame, lattice: CentreLattice, centres: Array, saturation: float = math.inf, scale: float = 1.0
) -> _CellMoments:
    """Moments of `image` in the Voronoi cells of `lattice` placed at `centres` [px], shape (n, 2), in one pass.

    Pixels on a cell's side count in proportion to how far they reach inside; those at or above `saturation` are counted
    as well; `scale` is the window's size against the cell. A dark cell has zero offset and spread, never NaN.
    """
    normals, halves = lattice.cell()
    out = np.zeros((len(centres), 7))
    x, y = np.ascontiguousarray(centres[:, 0]), np.ascontiguousarray(centres[:, 1])
    _moments.compiled(np.ascontiguousarray(image), x, y, normals, scale * halves, float(saturation), out)
    light = out[:, 0]
    mean = out[:, 1:6] / np.where(light > 0, light, 1.0)[:, None] * (light > 0)[:, None]
    offset = mean[:, :2]
    squares = np.column_stack([offset[:, 0] ** 2, offset[:, 0] * offset[:, 1], offset[:, 1] ** 2])
    return _CellMoments(light, offset, mean[:, 2:] - squares, out[:, 6].astype(np.int64))


@kernel(parallel=True)
def _moments(
    image: Frame, x: Array, y: Array, normals: Array, halves: Array, limit: float, out: Array, band: Band = WHOLE
) -> None:
    rows, columns = image.shape
    sides = halves.shape[0]
    reach = 0.0
    for m in range(sides):
        reach = max(reach, halves[m])
    reach = reach * 1.4143 + 1.0
    for n in prange(x.shape[0], band):
        x0, y0 = x[n], y[n]
        light, mx, my, mxx, mxy, myy, hot = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for row in range(max(0, math.ceil(y0 - reach)), min(rows, math.floor(y0 + reach) + 1)):
            dy = float(row) - y0
            for column in range(max(0, math.ceil(x0 - reach)), min(columns, math.floor(x0 + reach) + 1)):
                dx = float(column) - x0
                weight, ex, ey = 1.0, dx, dy
                for m in range(sides):
                    along = normals[m, 0] * dx + normals[m, 1] * dy
                    depth = halves[m] - abs(along) + 0.5
                    if depth < 1.0:
                        weight *= max(depth, 0.0)
                        inward = 0.5 * (depth - 1.0) if along > 0.0 else 0.5 * (1.0 - depth)
                        ex += normals[m, 0] * inward
                        ey += normals[m, 1] * inward
                if weight > 0.0:
                    value = float(image[row, column])
                    if value >= limit and weight > 0.5:
                        hot += 1.0
                    value *= weight
                    light += value
                    mx += value * ex
                    my += value * ey
                    mxx += value * ex * ex
                    mxy += value * ex * ey
                    myy += value * ey * ey
        out[n, 0], out[n, 1], out[n, 2] = light, mx, my
        out[n, 3], out[n, 4], out[n, 5], out[n, 6] = mxx, mxy, myy, hot


# --- centre and shading told apart ------------------------------------------------------------------------------------

_CORE = 0.45
"""Size of the inner window against the cell: inside the bright disc of most microlens images."""
_LEAST_PITCH = 11.5
"""Below it [px] the inner window is too few pixels wide, and shading moves centroids by under 0.01 px."""
_SURE = 100
"""Lenses from which a bend is told from their errors."""
_MELTED = 0.97
"""Pull of the cells' sides above which nothing is left to centre on."""


def _centred(
    frame: Frame,
    lattice: CentreLattice,
    indices: NDArray[np.int64],
    moments: _CellMoments,
    inner: _CellMoments,
    good: NDArray[np.bool_],
) -> tuple[Array, LatticeFit]:
    """Centre minus node of every lens [px], freed of the drag of its cell's sides and of shading; lattice of the good.

    With the cell's middle off the true centre by -delta and brightness (1 + h x) across the image, the centroid in a
    window lies at ``(1 - pull) delta + h V``, V the second moment in the window. The cell and a smaller window inside
    it give two equations for the lattice's delta and h, both affine over the array. Vignetting of the scene, of the
    pupil and of the lenses all come out as h; nothing is assumed of how they share it. Only the change of h over the
    array is taken off: a constant h moves all centres alike, which no calibration notices, and looks the same as a
    pixel grid that beats with the lattice. Where the images have no flat top (heavy blur) the two equations say the
    same, and nothing is taken off. `moments` are those of the cells, `inner` those of the smaller windows.
    """
    nodes = lattice.nodes(indices[:, 0], indices[:, 1])
    sample = nodes[good][:: max(1, int(good.sum()) // 500)]
    pull, inner_pull = _window_pull(frame, lattice, sample, 1.0), _window_pull(frame, lattice, sample, _CORE)
    if pull > _MELTED:
        raise CalibrationError(
            "the microlens images melt into each other: the white image shows no contrast to centre on"
        )
    free = 1 - pull
    whole = _without_ripple(nodes, indices, moments.offset / free, good)
    order = _BENT if _bent(indices[good], (nodes + whole)[good], lattice.layout) else 1

    def fitted(offset: Array) -> LatticeFit:
        return fit_lattice(indices[good], (nodes + offset)[good], lattice.layout, order)

    plain = fitted(whole)
    # Mean second moments about the windows' middles along one axis [px^2].
    size, inner_size = (
        float(np.median((m.spread[good][:, [0, 2]] + m.offset[good] ** 2).mean(axis=1))) for m in (moments, inner)
    )
    crossing = size * (1 - inner_pull) - inner_size * free
    if lattice.pitch < _LEAST_PITCH or abs(crossing) < 0.6 * (size * abs(1 - inner_pull) + inner_size * free):
        return whole, plain
    apart = fitted(
        _without_ripple(nodes, indices, (size * inner.offset - inner_size * moments.offset) / crossing, good)
    )
    slope = free * (whole - (apart.lattice.nodes(indices[:, 0], indices[:, 1]) - nodes)) / size
    design = np.column_stack([np.ones(len(indices)), indices - indices[good].mean(axis=0)])
    both = np.flatnonzero(good)[apart.inliers & plain.inliers]
    growth = np.linalg.lstsq(design[both], slope[both], rcond=None)[0]
    moved = design[:, 1:] @ growth[1:] * size / free
    noise = np.sqrt(np.mean(np.einsum("ni,ij,nj->n", design[:, 1:], apart.covariance[1:, 1:], design[:, 1:])))
    if np.sqrt(np.mean(moved**2)) < 4 * noise:
        return whole, plain
    return whole - moved, fitted(whole - moved)


def _bent(indices: NDArray[np.int64], centres: Array, layout: Layout) -> bool:
    """Whether centres follow a bent lattice, surely and by more than the images' own noise matters."""
    if len(indices) < _SURE:
        return False
    fit = fit_lattice(indices, centres, layout, _BENT)
    assert fit.lattice.bend is not None
    # What of the bend no straight lattice takes up.
    straight = fit_lattice(indices, fit.lattice.nodes(indices[:, 0], indices[:, 1]), layout).residuals
    away = np.hypot(*straight[fit.inliers].T)
    return bool(np.quantile(away, 0.99) > _BEND and np.sqrt(np.mean(away**2)) > 6 * np.sqrt(np.mean(fit.bend_error**2)))


def _window_pull(image: Frame, lattice: CentreLattice, centres: Array, scale: float) -> float:
    """Share of a cell's displacement that its centroid follows: 0 where images stand apart, towards 1 without contrast.

    Light at the sides of a cell drags the centroid along with the cell. For a periodic image the drag is the mean
    light on the sides over the mean light in the cell; here it is measured, by moving the cells to and fro.
    """
    step = min(0.3, 0.05 * lattice.pitch)
    pulls = []
    for direction in np.asarray(lattice.first) / lattice.pitches[0], np.asarray(lattice.second) / lattice.pitches[1]:
        ahead = _cell_moments(image, lattice, centres + step * direction, scale=scale).offset @ direction
        behind = _cell_moments(image, lattice, centres - step * direction, scale=scale).offset @ direction
        pulls.append(1 + float(np.median(ahead - behind)) / (2 * step))
    return float(np.mean(pulls))


def _without_ripple(nodes: Array, indices: NDArray[np.int64], offset: Array, good: NDArray[np.bool_]) -> Array:
    """Offsets of lenses from their nodes without the part that depends on where in its pixel a node lies.

    Sharp images on coarse pixels have centroids that are off by a few hundredths of a pixel, periodically in the node's
    place within its pixel, and not at all at the pixel's middle or edge, by symmetry: waves sin(2 pi x), sin(4 pi x).
    Where the lattice beats slowly with the grid (a pitch near a whole number of pixels, no rotation) that does not
    average out. The waves' two amplitudes, the same for x and y, are fitted together with the lattice to offsets within
    6 robust standard deviations; a wave that is less than 30 % independent of the lattice's own columns (all nodes lie
    alike in their pixels) cannot be told from a common shift, and stays.
    """
    waves = np.stack([np.sin(2 * np.pi * nodes), np.sin(4 * np.pi * nodes)], axis=-1)  # (n, 2, 2)
    away = np.abs(offset - np.median(offset[good], axis=0))
    used = good & (away <= 6.0 * 1.4826 * np.median(away[good], axis=0) + 1e-9).all(axis=1)
    basis = np.linalg.qr(np.column_stack([np.ones(len(indices)), indices - indices[used].mean(axis=0)])[used])[0]
    flat = waves[used].reshape(len(basis), 4)
    columns = (flat - basis @ (basis.T @ flat)).reshape(-1, 2)
    target = (offset[used] - basis @ (basis.T @ offset[used])).ravel()
    separable = np.sqrt(np.square(columns).mean(axis=0) / 0.5) > 0.3
    amplitude = np.zeros(2)
    if separable.any():
        amplitude[separable] = np.linalg.lstsq(columns[:, separable], target, rcond=None)[0]
    return np.asarray(offset - waves @ amplitude)


# --- which images are cut ---------------------------------------------------------------------------------------------

_AROUND = 7
"""Shapes are averaged over 7 x 7 lenses before they are judged."""
_CUT = 0.003
"""Least ellipticity called a cut, where there are clear cuts. A disc of radius r that is cut to an ellipticity e has
its centroid moved by about r e/4 or a little more."""
_CLEAR = 0.015
"""A cut is clear above this; a field without one is taken whole, since slow changes of shape are then aberrations."""
_LOST = 0.2
"""Least share of size and of light that a cut image has lost, against its ellipticity; half of it where all is even."""


def _cut(
    indices: NDArray[np.int64], moments: _CellMoments, good: NDArray[np.bool_], radius: Array
) -> NDArray[np.bool_]:
    """Lenses whose neighbourhood is cut: its shape departs from that in the middle of the field, and it lost by it.

    A stop that cuts a disc makes it narrower along the field's radius: its second moments become elliptical before its
    centroid moves by much. A shape common to all lenses (square lenses, astigmatism) is taken off first. Aberrations
    stretch images as well, and distortion moves them out of their cells, but neither takes size and light away: a disc
    that loses a sliver of the share e/2 of its area has an ellipticity of e, and its light and the sum of its moments
    are e/2 less. `radius` is the distance from the field's middle (n,).
    """
    xx, xy, yy = moments.spread.T
    total = np.where(xx + yy > 0, xx + yy, 1.0)
    shape = np.column_stack([(xx - yy) / total, 2 * xy / total])
    smooth = _neighbourhood_mean(indices, np.column_stack([shape, total, moments.light]), good)
    threshold = _CUT + 4 * _noise(indices, shape, good) / _AROUND
    trusted = good & (radius <= max(float(np.quantile(radius[good], 0.15)), float(np.sort(radius[good])[:9][-1])))
    ellipticity = np.zeros(len(shape))
    for _ in range(8):
        middle = np.median(smooth[trusted], axis=0)
        ellipticity = np.hypot(*(smooth[:, :2] - middle[:2]).T)
        grown = good & (ellipticity <= threshold)
        if np.array_equal(grown, trusted) or grown.sum() < 9:
            break
        trusted = grown
    lost = (1 - smooth[:, 2:] / middle[2:]).min(axis=1)
    cut = (ellipticity > threshold) & (lost > _LOST * ellipticity)
    clear = np.count_nonzero(cut[good] & (ellipticity[good] > _CLEAR)) >= max(0.002 * good.sum(), 4)
    return cut if clear else np.zeros(len(shape), bool)


def _neighbourhood_mean(indices: NDArray[np.int64], values: Array, good: NDArray[np.bool_]) -> Array:
    """Mean of `values` over the good lenses within 3 indices of each lens; 0 where there are none."""
    from scipy.ndimage import uniform_filter

    low = indices.min(axis=0)
    size, at = indices.max(axis=0) - low + 1, tuple((indices - low).T)

    def box(value: Array) -> Array:
        grid = np.zeros(size)
        grid[at] = np.where(good, value, 0.0)
        return np.asarray(uniform_filter(grid, _AROUND, mode="constant")[at])

    held = box(np.ones(len(values)))
    held = np.where(held > 0.5 / _AROUND**2, held, np.inf)
    return np.column_stack([box(value) / held for value in values.T])


def _noise(indices: NDArray[np.int64], values: Array, good: NDArray[np.bool_]) -> float:
    """Robust standard deviation of one lens's shape, from differences between neighbours along an index row."""
    order = np.lexsort((indices[:, 0], indices[:, 1]))
    ordered, usable = indices[order], good[order]
    pair = (np.diff(ordered[:, 0]) == 1) & (np.diff(ordered[:, 1]) == 0) & usable[1:] & usable[:-1]
    steps = np.diff(values[order], axis=0)[pair]
    return float(np.median(np.abs(steps))) * 1.4826 / np.sqrt(2) if len(steps) else 0.0
