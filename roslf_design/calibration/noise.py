"""A sensor's noise from white images and dark frames: photon transfer, as EMVA 1288 (release 4.0) has it.

The variance of a pixel over frames of one exposure is ``r^2 + s^2/12 + m/g`` in counts: read noise r, steps s, light m
above black and g electrons a count. Microlens images hold all levels from their rim to their middle, so that one
exposure draws the line. Which pixels belong to one level is told by their neighbours, whose noise is not their own.

What stays of pixels that differ lastingly (PRNU, DSNU) is what their second differences along both axes show beyond the
microlens images' own, with the part of noise over frames taken off: pixel against pixel. Shading is left out, and what
microlenses differ by on the scale of a pixel cannot be told apart from it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..design.parts import Sensor
from ..words import number, rounded
from .centres import MicrolensCentres
from .frames import Array, Repeated
from .white_profile import ImageSamples, WhiteProfile

_BINS, _FEWEST = 32, 200
"""Levels of one exposure, and pixels of each at least."""
_BENT = 0.1
"""Share of the noise at the brightest level by which it may bend off a line: pixels that are no counts of light do."""
_SURE = 5.0
"""Standard errors from which a bend, or a slope, is one."""
_CLIPPED = 1e-3
"""Share of pixels at the end of the counts from which a level, or a black frame, is cut off there."""
_COARSE = 0.24
"""Variance, in squared steps, below which rounding is not noise of its own: EMVA 1288."""
_DEFECT = 10.0
"""Standard deviations off the others' black level, or times their noise, from which a pixel is defective."""
_TILE = 24
"""Side of the tiles [px] that scatter of pixels among their neighbours is told by."""
_BRIGHT = 0.5
"""Share of a microlens's brightest pixels above which pixels are compared."""
_SECOND = np.outer([1, -2, 1], [1, -2, 1]).astype(float)


@dataclass(frozen=True)
class _Figure:
    """Figure of a sensor with its standard error, or a bound of it."""

    value: float
    sigma: float
    bound: str = ""
    """"at least" or "at most"; empty where it is the figure itself."""

    def words(self, scale: float = 1.0) -> str:
        """Value with its standard error, both `scale` times as large, or the bound: "2.6 ± 0.03", "at least 8170"."""
        value, sigma = scale * self.value, scale * self.sigma
        return f"{self.bound} {number(value, 3)}" if self.bound else f"{rounded(value, sigma)} ± {sigma:.2g}"


@dataclass(frozen=True)
class MeasuredSensor:
    """Sensor's figures in the terms of EMVA 1288; None where images do not tell one, and `untold` says why."""

    gain: _Figure | None = None
    """Electrons a count."""
    read_noise: _Figure | None = None
    """Rms, without rounding [electrons]."""
    full_well: _Figure | None = None
    """[electrons]"""
    prnu: _Figure | None = None
    """Photo-response non-uniformity, rms share of the signal."""
    dsnu: _Figure | None = None
    """Dark-signal non-uniformity, rms [electrons]."""
    prnu_left: _Figure | None = None
    """Share that dividing by the mean white image leaves, at its bright pixels: the noise of that mean."""
    dsnu_left: _Figure | None = None
    """Rms that taking the mean dark frame off leaves [electrons]."""
    black: float | None = None
    """Black level [counts]."""
    white_frames: tuple[int, ...] = ()
    """Number of white images of each exposure."""
    dark_frames: int = 0
    defective_pixels: int = 0
    """Pixels left out, of a black level or noise unlike the others'."""
    curve: tuple[tuple[float, float, float], ...] = ()
    """Photon transfer: level above black [counts], variance and its standard error [counts^2]."""
    untold: tuple[str, ...] = ()
    """Reasons why figures are missing."""

    def known(self, sensor: Sensor) -> dict[str, float]:
        """Values of a design's `sensor` that are measured: PRNU and DSNU are what white image and dark frame leave."""
        told = {"read_noise": self.read_noise, "prnu": self.prnu_left, "dsnu": self.dsnu_left}
        own = {name: figure.value for name, figure in told.items() if figure is not None}
        if (full := self.full_well) is not None:
            own["full_well"] = max(full.value, sensor.full_well) if full.bound else full.value
        return own

    def to_dict(self) -> dict[str, Any]:
        """Object `sensor` of `calibration.json`."""
        return asdict(self)


class _Line(NamedTuple):
    """Photon transfer's line, and points that it goes through."""

    floor: float
    slope: float
    sigma: tuple[float, float]
    """Standard errors of both."""
    points: Array
    """Level, variance and its standard error; shape (n, 3)."""

    def variance(self, level: Array) -> Array:
        """Variance over frames of pixels at levels above black."""
        return np.maximum(self.floor + self.slope * level, 0.0)


def measured_sensor(
    whites: Sequence[Repeated],
    darks: Repeated | None,
    profile: WhiteProfile | None,
    centres: MicrolensCentres,
    colours: bool = False,
) -> MeasuredSensor:
    """Figures of the sensor that white images and dark frames were taken with.

    Parameters
    ----------
    whites : sequence of Repeated
        Of each exposure, the one first that `profile` and `centres` are of.
    darks : Repeated, optional
    profile : WhiteProfile, optional
        Microlens images; without it no PRNU is told.
    colours : bool
        Whether pixels have colour filters.
    """
    told = MeasuredSensor(
        white_frames=tuple(group.count for group in whites), dark_frames=0 if darks is None else darks.count
    )
    if whites[0].mean.ndim == 3 or (darks is not None and darks.mean.ndim == 3):
        return replace(told, untold=("colour pictures are no raw counts: their noise is not known",))
    black = 0.0 if darks is None else float(np.median(darks.mean))
    good = _good(darks, whites[0].mean.shape)
    told = replace(told, black=None if darks is None else black, defective_pixels=int((~good).sum()))
    step = 1.0 if whites[0].kind.kind in "ui" else 0.0
    line = _line(whites, darks, good, black, step)
    if isinstance(line, str):
        return replace(told, untold=(line,))
    gain = _Figure(1 / line.slope, line.sigma[1] / line.slope**2)
    untold: list[str] = []
    read, dsnu, dsnu_left = _dark_figures(darks, good, gain, step)
    if isinstance(read, str):
        untold.append(read)
    full = prnu = prnu_left = None
    if darks is None:
        untold.append("no dark frame tells the black level: no full well and no PRNU")
    else:
        full = _full_well(whites, black, gain)
        if colours or profile is None:
            untold.append("PRNU is not known " + ("behind colour filters" if colours else "without microlens images"))
        elif whites[0].count < 2:
            untold.append("PRNU is not known by one image of the brightest exposure")
        else:
            nodes = centres.centres[centres.used]
            prnu, prnu_left = _unlike_pixels(whites[0], darks, good, profile, nodes, line)
    return replace(
        told, gain=gain, read_noise=None if isinstance(read, str) else read, full_well=full, prnu=prnu, dsnu=dsnu,
        prnu_left=prnu_left, dsnu_left=dsnu_left, curve=tuple((m, v, s) for m, v, s in line.points.tolist()),
        untold=tuple(untold),
    )  # fmt: skip


def _variance(group: Repeated, black: float | None, good: NDArray[np.bool_]) -> Array:
    """Variance of each pixel over frames, without what lamps, or in the dark offsets, differ by from frame to frame."""
    drift, own = np.var(group.levels, ddof=1), group.squares / (group.count - 1)
    if black is None:
        return np.asarray(own - drift)
    mean = group.mean - black
    bright = float(mean[good].mean())
    return np.asarray(own - (drift / bright**2 if bright > 0 else 0.0) * np.square(mean))


def _good(darks: Repeated | None, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """True where a pixel is not defective."""
    if darks is None:
        return np.ones(shape, bool)
    off = np.abs(darks.mean - np.median(darks.mean))
    spread = max(1.4826 * float(np.median(off)), float(off.mean()))
    good = off <= _DEFECT * spread
    if darks.count > 1:
        noise = darks.squares / (darks.count - 1)
        good &= noise <= _DEFECT**2 * noise.mean()
    return np.asarray(good)


def _cut_off(darks: Repeated) -> bool:
    """Whether dark frames end at zero counts."""
    return darks.kind.kind == "u" and float(np.mean(darks.mean == 0)) > _CLIPPED


def _line(
    whites: Sequence[Repeated], darks: Repeated | None, good: NDArray[np.bool_], black: float, step: float
) -> _Line | str:
    """Line through variances of all levels; or why there is none."""
    points, degrees = [], []
    some = [group for group in whites if group.count > 1]
    # Of saturated frames how far the lamp drifted is hidden by the pixels that are full.
    for group in [group for group in some if float(group.full.mean()) <= _CLIPPED] or some:
        for level, variance, pixels in _levels(group, black, good):
            points.append((level, variance))
            degrees.append(pixels * (group.count - 1))
    if not some:
        return "one white image of each exposure: two or more of one tell the noise (white_1, white_2)"
    if not points:
        return "white images are saturated, or too small: no noise is measured"
    if darks is not None and darks.count > 1 and not _cut_off(darks):
        points.append((0.0, float(_variance(darks, None, good)[good].mean())))
        degrees.append(int(good.sum()) * (darks.count - 1))
    level, variance = np.array(points).T
    most, noisiest = float(level.max()), float(variance.max())
    if not most > 0:
        return "white images are no brighter than the dark frames"
    if noisiest <= 1e-12 * most**2:
        return "white images of one exposure do not differ: copies, or rendered without noise"
    if noisiest < _COARSE * step**2:
        return "noise of white images is finer than the steps of their counts: save more bits"
    columns = np.stack([np.ones_like(level), level / most, np.square(level / most)], -1)
    fitted = variance
    for _ in range(4):
        sigma = np.maximum(fitted, 1e-3 * noisiest) * np.sqrt(2 / np.array(degrees))
        best, spread = _fitted(columns[:, :2], variance, sigma)
        fitted = columns[:, :2] @ best
    floor, slope = float(best[0]), float(best[1])
    error = float(spread[1])
    if len(points) > 3:
        bent, doubt = _fitted(columns, variance, sigma)
        bend = abs(float(bent[2]))
        if bend > _SURE * doubt[2] and bend > _BENT * max(slope, 0.0):
            return (
                "photon transfer is not straight: pixels are no counts of light (a gamma, a tone curve, a compressed"
                " picture), or saturate below the end of their counts"
            )
        if bend > 3 * doubt[2]:
            error = math.hypot(error, 0.5 * bend)
    if not slope > _SURE * error:
        return (
            "noise does not grow with light, as that of counts does: pixels have a gamma or a tone curve, or what"
            " differs between white images is not light's noise"
        )
    return _Line(floor, slope / most, (float(spread[0]), error / most), np.column_stack([level, variance, sigma]))


def _levels(group: Repeated, black: float, good: NDArray[np.bool_]) -> list[tuple[float, float, int]]:
    """Level above black, variance and number of pixels, by even steps of neighbours; cut-off ones left out."""
    from scipy.ndimage import uniform_filter

    variance = _variance(group, black, good)[good]
    beside = ((9 * uniform_filter(group.mean, 3) - group.mean) / 8)[good]
    low, high = np.quantile(beside, [0.001, 0.999])
    at = np.clip((beside - low) / max(high - low, 1e-12) * _BINS, 0, _BINS - 1).astype(int)
    sums = [np.bincount(at, part, _BINS) for part in (group.mean[good] - black, variance, group.full[good], at >= 0)]
    level, noise, full, count = (part[sums[3] >= _FEWEST] for part in sums)
    return [
        (float(m), float(v), int(n))
        for m, v, f, n in zip(level / count, noise / count, full / count, count, strict=True)
        if f <= _CLIPPED
    ]


def _fitted(columns: Array, values: Array, sigma: Array) -> tuple[Array, Array]:
    """Weighted least squares: parameters and their standard errors, widened by what residuals show."""
    weighted = columns / sigma[:, None]
    covariance = np.linalg.pinv(weighted.T @ weighted)
    best = covariance @ weighted.T @ (values / sigma)
    free = len(values) - columns.shape[1]
    chi2 = float(np.square((values - columns @ best) / sigma).sum()) / free if free > 0 else 1.0
    return best, np.sqrt(np.diag(covariance) * max(chi2, 1.0))


def _dark_figures(
    darks: Repeated | None, good: NDArray[np.bool_], gain: _Figure, step: float
) -> tuple[_Figure | str, _Figure | None, _Figure | None]:
    """Read noise or why it is not told, DSNU, and what a mean dark frame leaves of it."""
    if darks is None or darks.count < 2:
        return "two dark frames or more tell read noise and DSNU (dark_1, dark_2)", None, None
    if _cut_off(darks):
        return "dark frames are cut off at 0 counts and tell no read noise: raise the camera's black level", None, None
    share = gain.sigma / gain.value
    each = _variance(darks, None, good)
    noise = float(each[good].mean())
    error = float(each[good].std()) / math.sqrt(float(good.sum()))
    if noise < _COARSE * step**2:
        read = _Figure(0.4 * step * gain.value, 0.0, "at most")
    else:
        rms = math.sqrt(noise - step**2 / 12)
        read = _Figure(rms * gain.value, rms * gain.value * math.hypot(share, error / (2 * rms**2)))
    left = math.sqrt(noise / darks.count) * gain.value
    level = np.ones(darks.mean.shape)
    square, doubt = _unlike(darks.mean, noise / darks.count * level, level, good)
    doubt = math.hypot(doubt, error / darks.count)
    return read, _root(square, doubt, gain.value, share), _Figure(left, left * share)


def _full_well(whites: Sequence[Repeated], black: float, gain: _Figure) -> _Figure:
    """Electrons at the level where pixels saturate, or as many as they were seen to hold."""
    ends = [group.top for group in whites if math.isfinite(group.top) and float(group.full.mean()) >= _CLIPPED]
    level = min(ends) if ends else max(float(np.quantile(group.mean, 0.999)) for group in whites)
    value = (level - black) * gain.value
    return _Figure(value, value * gain.sigma / gain.value, "" if ends else "at least")


def _unlike_pixels(
    white: Repeated, darks: Repeated, good: NDArray[np.bool_], profile: WhiteProfile, nodes: Array, line: _Line
) -> tuple[_Figure | None, _Figure]:
    """PRNU of the pixels in bright parts of microlens images, and what dividing by their mean leaves."""
    from scipy.ndimage import gaussian_filter

    lattice, frame = profile.lattice, white.mean - darks.mean
    samples = ImageSamples.of(frame.astype(np.float32), lattice, nodes)
    steps = max(len(profile.measured), math.ceil(4 * lattice.pitch))
    smooth = len(profile.measured) / lattice.pitch / 2
    (light,) = samples.read([profile.image.over_cell(lattice, steps) + profile.veil])
    light += samples.read([gaussian_filter(profile.measured - profile.fitted, smooth, mode="wrap")])[0]
    level = light * (samples.mean(samples.value) / samples.mean(light))[samples.lens]
    row, column = samples.pixel
    own, some = np.zeros(frame.shape), np.zeros(frame.shape, bool)
    own[row, column], some[row, column] = level, light > _BRIGHT * light.max()
    noise = line.variance(own) / white.count
    if darks.count > 1:
        noise += float((darks.squares[good] / (darks.count - 1)).mean()) / darks.count
    some &= good & ~white.full
    square, doubt = _unlike(frame - own, noise, own, some)
    left = math.sqrt(float(noise[some].mean() / np.square(own[some]).mean()))
    share = line.sigma[1] / line.slope
    return _root(square, math.hypot(doubt, share * left**2), 1.0, 0.0), _Figure(left, 0.5 * left * share)


def _unlike(off: Array, noise: Array, level: Array, some: NDArray[np.bool_]) -> tuple[float, float]:
    """Mean square of pixels' lasting differences from their neighbours, over their level's, and its standard error.

    Parameters
    ----------
    off : ndarray, shape (rows, columns)
        What they differ from smooth light by.
    noise : ndarray
        Variance of that which does not last.
    level : ndarray
    some : ndarray of bool
        Pixels that count, with those around them.
    """
    from scipy.ndimage import convolve, minimum_filter

    inside = minimum_filter(some, 3, mode="constant")
    own = np.square(convolve(off, _SECOND)) - convolve(noise, np.square(_SECOND))
    whole = convolve(np.square(level), np.square(_SECOND))
    rows, columns = np.nonzero(inside)
    tiles = rows // _TILE * (inside.shape[1] // _TILE + 1) + columns // _TILE
    a, b = (np.bincount(tiles, part[inside]) for part in (own, whole))
    if not b.sum() > 0:
        return 0.0, math.inf
    square = float(a.sum() / b.sum())
    shared = 1 + 2 / _TILE  # neighbouring tiles share pixels at their sides
    return square, shared * float(np.sqrt(np.square(a - square * b).sum()) / b.sum())


def _root(square: float, doubt: float, scale: float, share: float) -> _Figure | None:
    """Figure whose square, in units of `scale`, is known to a standard error; a bound where that may be nothing."""
    if not math.isfinite(doubt):
        return None
    if square < 2 * doubt:
        return _Figure(scale * math.sqrt(max(square, 0.0) + 2 * doubt), 0.0, "at most")
    root = math.sqrt(square)
    down = (root - math.sqrt(square - 2 * doubt)) / 2  # a root is known less well downwards, where doubt is large
    return _Figure(scale * root, scale * math.hypot(down, root * share))
