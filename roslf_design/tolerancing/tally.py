"""Tallies of trials: what is counted and summed of them, histograms in equal ratios, and both as bytes."""

from __future__ import annotations

import hashlib
import io
import math
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._arrays import Array, by_value
from .._jit import kernel
from ..theory.quantity import finite
from .study import TolerancePlan
from .trials import MeasuredTrials

Counts = NDArray[np.int64]
TILE = 2048
"""Trials whose deviations are multiplied with all columns at once: they stay in a processor's cache."""
SPLIT_BITS = 7
SPLIT = 2**SPLIT_BITS
SMALLEST, LARGEST = -50, 30
"""Powers of 2 between which deviations are told apart."""
HALF = (LARGEST - SMALLEST) * SPLIT
BINS = 2 * HALF + 1
MAGNITUDE = 2**63 - 1
"""All of a double's bits but its sign."""
_SHIFT, _FIRST = 52 - SPLIT_BITS, (1023 + SMALLEST) << SPLIT_BITS
_POSITIVE = ((np.arange(HALF + 1, dtype=np.int64) + _FIRST) << _SHIFT).view(np.float64)
EDGES = np.concatenate([-_POSITIVE[::-1], _POSITIVE])
"""Edges of the bins, in deviation from nominal, shape (BINS + 1,); the middle bin is [-2^-50, 2^-50]."""
SUMMED = (
    *("trials", "passed", "held", "undefined", "infinite", "impossible", "faults", "at_end"),
    *("counts", "moments", "total", "square", "x", "xx", "xy"),
)
"""Fields of a `Tally` that add up over chunks."""


@by_value
@dataclass(frozen=True)
class Tally:
    """Results of a run of trials. V variants (as built; linearly adjusted; adjusted), C columns, P perturbations."""

    trials: int
    passed: Counts
    """Trials that hold all limits, shape (V,)."""
    held: Counts
    """Trials that hold each limit, shape (V, limits)."""
    undefined: Counts
    """Trials in which a column is undefined, shape (V, C)."""
    infinite: Counts
    """Trials in which it is infinite, shape (V, C)."""
    impossible: Counts
    """Trials that are no cameras, shape (V,): in these every column is undefined."""
    faults: Counts
    """For which of the plan's reasons, shape (V, reasons); a trial may have several."""
    at_end: Counts
    """Trials whose adjustment rests at the end of its range, shape (adjusters,)."""
    travel: Array
    """Largest adjustment either way [mm, rad], shape (adjusters,)."""
    counts: Counts
    """Bin counts of finite deviations from nominal, from 0 where nominal is infinite; shape (V, C, BINS)."""
    moments: Array
    """Sums of these deviations and of their squares, shape (V, C, 2)."""
    total: Array
    """Sum of defined deviations from nominal, of what may be infinite those of its twin, shape (V, C)."""
    square: Array
    """Sum of their squares, shape (V, C)."""
    low: Array
    high: Array
    """Least and greatest finite deviation, shape (V, C); inf and -inf where none is."""
    x: Array
    """Sum of the perturbations' deviations [tolerances] over trials where the column is defined, shape (C, P)."""
    xx: Array
    """Sums of the squares of these deviations, shape (C, P)."""
    xy: Array
    """Sums of the products of these deviations with the final variant's deviation from nominal, shape (C, P)."""
    worst: Counts
    """Numbers of the worst trials, worst first, shape (k,)."""
    scores: Array
    """How far they exceed their limits, in units of what the limit allows, shape (k,); inf where undefined."""
    worst_moved: Array
    """Their adjustments [mm, rad], shape (k, adjusters)."""
    drawn: Array
    """Deviations [tolerances] of the first trials kept, shape (kept, P)."""
    measured: Array
    """Columns of these trials, shape (kept, V, C)."""
    moved: Array
    """Their adjustments [mm, rad], shape (kept, adjusters)."""


def tally_of(plan: TolerancePlan, trials: MeasuredTrials, first: int) -> Tally:
    """Count consecutive trials, the first of which has the number `first`."""
    drawn, (variants, columns, size) = trials.deviations, trials.variants.shape
    passes = np.array([plan.passes(values) for values in trials.variants])
    off, rows = trials.variants - np.where(np.isinf(plan.nominal), 0.0, plan.nominal)[:, None], plan.infinite
    infinite = np.zeros((variants, columns), np.int64)
    infinite[:, rows] = np.isinf(off[:, rows]).sum(axis=2)
    off[:, rows] = np.where(np.isinf(off[:, rows]), np.nan, off[:, rows])
    counts = np.zeros((variants, columns, BINS), np.int64)
    total, square, low, high = np.zeros((4, variants, columns))
    undefined = np.zeros((variants, columns), np.int64)
    for sums in zip(off, counts, total, square, low, high, undefined, strict=True):
        add_up.compiled(sums[0], sums[0].view(np.int64), *sums[1:])
    undefined -= infinite
    moments = np.stack([total, square], axis=-1)
    if rows.any():  # what goes with what is told of twins, which are finite
        off[:, rows] = finite(trials.variants[:, rows]) - finite(plan.nominal[rows])[:, None]
        total[:, rows], square[:, rows] = np.nansum(off[:, rows], axis=2), np.nansum(off[:, rows] ** 2, axis=2)
    x, xx, xy = np.zeros((3, columns, len(drawn)))
    for start in range(0, size, TILE):
        some, ends = drawn[:, start : start + TILE], off[-1, :, start : start + TILE]
        good = ~np.isnan(ends)
        if good.all():
            x += some.sum(axis=1)
            xx += np.einsum("pt,pt->p", some, some)
        else:
            known, ends = good.astype(float), np.where(good, ends, 0.0)
            x += np.einsum("ct,pt->cp", known, some)
            xx += np.einsum("ct,pt->cp", known, some * some)
        xy += np.einsum("ct,pt->cp", ends, some)
    impossible, faults = np.zeros(variants, np.int64), np.zeros((variants, len(plan.faults)), np.int64)
    for v, reasons in enumerate(trials.faults(plan)):
        for words, flags in reasons.items():
            faults[v, plan.faults.index(words)] = flags.sum()
        impossible[v] = np.sum(np.any(list(reasons.values()), axis=0)) if reasons else 0
    scores = plan.used_room(trials.variants[-1])
    worst = np.lexsort((np.arange(size), -scores))[: plan.keep_worst]
    kept = max(0, min(plan.keep_trials - first, size))
    return Tally(
        trials=size,
        passed=passes.all(axis=1).sum(axis=1),
        held=passes.sum(axis=2),
        undefined=undefined,
        infinite=infinite,
        impossible=impossible,
        faults=faults,
        at_end=plan.at_end(trials.moved).sum(axis=1),
        travel=np.abs(trials.moved).max(axis=1, initial=0.0),
        counts=counts,
        moments=moments,
        total=total,
        square=square,
        low=low,
        high=high,
        x=x,
        xx=xx,
        xy=xy,
        worst=worst + first,
        scores=scores[worst],
        worst_moved=np.ascontiguousarray(trials.moved[:, worst].T),
        drawn=np.ascontiguousarray(drawn[:, :kept].T),
        measured=np.ascontiguousarray(np.moveaxis(trials.variants[:, :, :kept], 2, 0)),
        moved=np.ascontiguousarray(trials.moved[:, :kept].T),
    )


def merged(tallies: Iterable[Tally]) -> Tally:
    """Results of one or more runs of trials, in order; memory does not grow with their number."""
    return reduce(_both, tallies)


def _both(first: Tally, second: Tally) -> Tally:
    def joined(name: str) -> Any:
        return np.concatenate([getattr(first, name), getattr(second, name)])

    worst, scores = joined("worst"), joined("scores")
    order = np.lexsort((worst, -scores))[: max(len(first.worst), len(second.worst))]
    return Tally(
        **{name: getattr(first, name) + getattr(second, name) for name in SUMMED},
        **{name: joined(name) for name in ("drawn", "measured", "moved")},
        low=np.minimum(first.low, second.low),
        high=np.maximum(first.high, second.high),
        travel=np.maximum(first.travel, second.travel),
        worst=worst[order],
        scores=scores[order],
        worst_moved=joined("worst_moved")[order],
    )


SEAL = 64
"""Hexadecimal digits at the end of a chunk (a .zip's comment): a digest of the run, the chunk's index and its bytes."""


def _seal(content: bytes, digest: str, index: int) -> bytes:
    return hashlib.sha256(f"{digest} {index} ".encode() + content).hexdigest().encode()


def is_sealed(content: bytes, digest: str, index: int) -> bool:
    """Whether these are the bytes that `pack` made of a run's chunk."""
    return content[-SEAL:] == _seal(content[:-SEAL], digest, index)


def pack(tally: Tally, digest: str, index: int) -> bytes:
    """As the bytes of an .npz file, sealed; the same results give the same bytes. Histograms are stored sparsely.

    Parameters
    ----------
    tally : Tally
        Results of a chunk.
    digest : str
        Of the plan.
    index : int
        Of the chunk.
    """
    arrays = {item.name: np.asarray(getattr(tally, item.name)) for item in fields(tally)}
    counts = arrays.pop("counts")
    filled = np.flatnonzero(counts)
    sparse = {"filled": filled.astype(np.int32), "filled_counts": counts.ravel()[filled], "shape": counts.shape}
    arrays |= {k: np.asarray(v) for k, v in sparse.items()}
    content = npz_bytes(arrays, SEAL * b"0", zipfile.ZIP_STORED)[:-SEAL]  # written and read once each
    return content + _seal(content, digest, index)


def unpack(content: bytes, digest: str, index: int) -> Tally:
    """The results in a chunk's bytes; arguments as for `pack`.

    Raises
    ------
    ValueError
        Not as `pack` wrote them: damaged, changed, or of another study or chunk.
    """
    if not is_sealed(content, digest, index):
        raise ValueError(f"chunk {index} is damaged, or of another study, seed or version")
    with np.load(io.BytesIO(content)) as archive:
        arrays = dict(archive)
    counts = np.zeros(arrays.pop("shape"), np.int64)
    counts.ravel()[arrays.pop("filled")] = arrays.pop("filled_counts")
    return Tally(trials=int(arrays.pop("trials")), counts=counts, **arrays)


def npz_bytes(arrays: Mapping[str, NDArray[Any]], comment: bytes = b"", how: int = zipfile.ZIP_DEFLATED) -> bytes:
    """The bytes of an .npz file, which has no dates: the same for the same arrays; they end in the comment."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", how, compresslevel=1) as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w") as file:
                np.lib.format.write_array(file, array, allow_pickle=False)
        archive.comment = comment
    return buffer.getvalue()


@kernel()
def add_up(
    off: Array, bits: Counts, counts: Counts, total: Array, square: Array, low: Array, high: Array, undefined: Counts
) -> None:
    """Count deviations from nominal and add them up, row by row; NaN is undefined and left out.

    Parameters
    ----------
    off : ndarray, shape (C, n)
    bits : ndarray, shape (C, n)
        The same memory as integers: a double's exponent and first digits are its bin.
    counts : ndarray, shape (C, BINS)
        Added to; infinite ones go to the outermost bins.
    total, square, low, high, undefined : ndarray, shape (C,)
        Set.
    """
    for c in range(off.shape[0]):
        some, squares, least, most, lost = 0.0, 0.0, math.inf, -math.inf, 0
        for t in range(off.shape[1]):
            value = off[c, t]
            if value != value:
                lost += 1
                continue
            size = ((bits[c, t] & MAGNITUDE) >> _SHIFT) - (_FIRST - 1)
            size = 0 if size < 0 else HALF if size > HALF else size
            counts[c, HALF - size if value < 0 else HALF + size] += 1
            some += value
            squares += value * value
            least, most = min(least, value), max(most, value)
        total[c], square[c], low[c], high[c], undefined[c] = some, squares, least, most, lost


def quantiles(
    counts: Counts, probabilities: Sequence[float], low: float, high: float, below: int = 0, above: int = 0
) -> Array:
    """Quantiles of deviations, linear inside a bin.

    Parameters
    ----------
    counts : ndarray, shape (BINS,)
        Of all defined trials.
    probabilities : sequence of float
        In (0, 1).
    low, high : float
        Least and greatest deviation; no quantile lies outside.
    below, above : int
        Undefined trials, which count as worse than any: on which side is the caller's knowledge of the goal. Quantiles
        that fall among them are -inf or inf.
    """
    heaped = np.concatenate([[0], np.cumsum(counts)]) + below
    rank, defined = np.multiply(probabilities, heaped[-1] + above), heaped[-1]
    after = np.clip(np.searchsorted(heaped, rank, side="left"), 1, BINS)
    first, start = heaped[after - 1], EDGES[after - 1]
    at = start + (rank - first) / np.maximum(heaped[after] - first, 1) * (EDGES[after] - start)
    at = np.clip(np.where(after - 1 == HALF, 0.0, at), low, high)
    return np.where(rank < below, -np.inf, np.where((rank > defined) | (defined + above == 0), np.inf, at))


def rebin(counts: Counts, cuts: Array) -> Array:
    """Trials between neighbouring cuts (in deviation), fine bins split evenly; shape (cuts - 1,)."""
    return np.diff(np.interp(cuts, EDGES, np.concatenate([[0.0], np.cumsum(counts)])))
