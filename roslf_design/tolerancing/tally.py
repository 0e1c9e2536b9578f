"""What is kept of many trials: counts and sums that add up, the worst trials, and the first ones in full."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import sketch
from .study import TolerancePlan
from .trials import MeasuredTrials

Array = NDArray[np.float64]
Counts = NDArray[np.int64]

SUMMED = ("trials", "passed", "held", "undefined", "counts", "total", "square", "x", "xx", "xy")
"""What adds up over chunks."""


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
    counts: Counts
    """`sketch` counts of deviations from nominal, shape (V, C, BINS)."""
    total: Array
    """Sum of defined deviations from nominal, shape (V, C)."""
    square: Array
    """Sum of their squares, shape (V, C)."""
    low: Array
    high: Array
    """Least and greatest deviation, shape (V, C); inf and -inf where none is defined."""
    x: Array
    """Sum of the perturbations' deviations [tolerances] over trials where the column is defined, shape (C, P)."""
    xx: Array
    """Of their squares, shape (C, P)."""
    xy: Array
    """Of their products with the final variant's deviations, shape (C, P)."""
    worst: Counts
    """Numbers of the worst trials, worst first, shape (k,)."""
    scores: Array
    """How far they exceed their limits, in units of what the limit allows, shape (k,); inf where undefined."""
    drawn: Array
    """Deviations [tolerances] of the first trials kept, shape (kept, P)."""
    measured: Array
    """Their columns, shape (kept, V, C)."""
    moved: Array
    """Their adjustments [mm, rad], shape (kept, adjusters)."""


def counted(plan: TolerancePlan, trials: MeasuredTrials, first: int) -> Tally:
    """Count trials.

    Parameters
    ----------
    plan : TolerancePlan
        Its limits, and how many trials are kept.
    trials : MeasuredTrials
        T consecutive trials.
    first : int
        Number of the first of them.
    """
    variants, _, count = trials.variants.shape
    nominal = plan.nominal
    passes = [plan.passes(columns) for columns in trials.variants]
    off = trials.variants - nominal[:, None]
    x, xx, xy = _cross(off[-1], trials.deviations)
    scores = _scores(plan, nominal, trials.variants[-1])
    worst = np.lexsort((np.arange(count), -scores))[: plan.keep_worst]
    kept = max(0, min(plan.keep_trials - first, count))
    stats = [_distribution(columns) for columns in off]
    undefined, counts, total, square, low, high = (np.stack(part) for part in zip(*stats, strict=True))
    return Tally(
        trials=count,
        passed=np.array([good.all(axis=0).sum() for good in passes], np.int64),
        held=np.array([good.sum(axis=1) for good in passes], np.int64).reshape(variants, len(plan.limits)),
        undefined=undefined,
        counts=counts,
        total=total,
        square=square,
        low=low,
        high=high,
        x=x,
        xx=xx,
        xy=xy,
        worst=(worst + first).astype(np.int64),
        scores=scores[worst],
        drawn=np.ascontiguousarray(trials.deviations[:, :kept].T),
        measured=np.ascontiguousarray(np.moveaxis(trials.variants[:, :, :kept], 2, 0)),
        moved=np.ascontiguousarray(trials.moved[:, :kept].T),
    )


def _distribution(deviations: Array) -> tuple[Counts, Counts, Array, Array, Array, Array]:
    """Undefined trials, bin counts, sum, sum of squares, least, greatest, for deviations of shape (C, trials)."""
    missing = np.isnan(deviations)
    undefined = missing.sum(axis=1)
    columns = len(deviations)
    counts = np.empty((columns, sketch.BINS), np.int64)
    total, square, low, high = np.empty((4, columns))
    for c in range(columns):
        row = deviations[c][~missing[c]] if undefined[c] else deviations[c]
        counts[c] = sketch.count(row)
        total[c], square[c] = row.sum(), np.einsum("t,t->", row, row)
        low[c], high[c] = row.min(initial=np.inf), row.max(initial=-np.inf)
    return undefined, counts, total, square, low, high


def _cross(y: Array, x: Array) -> tuple[Array, Array, Array]:
    """Sums of x, x^2 and x y over trials where y is defined, shape (C, P) each."""
    sums = np.empty((3, len(y), len(x)))
    whole = x.sum(axis=1), np.einsum("pt,pt->p", x, x)
    for c, row in enumerate(y):
        good = np.isfinite(row)
        if good.all():
            sums[:, c] = *whole, np.einsum("pt,t->p", x, row)
        else:
            part = x[:, good]
            sums[:, c] = part.sum(axis=1), np.einsum("pt,pt->p", part, part), np.einsum("pt,t->p", part, row[good])
    return sums[0], sums[1], sums[2]


def _scores(plan: TolerancePlan, nominal: Array, columns: Array) -> Array:
    """How far each trial exceeds its limits: 0 at nominal, 1 at a limit, in units of what the limit allows."""
    worst = np.full(columns.shape[1], -np.inf)
    for limit in plan.limits:
        value, here = columns[limit.column], nominal[limit.column]
        for edge, over in ((limit.high, value - here), (limit.low, here - value)):
            if np.isfinite(edge):
                allowed = abs(edge - here)
                used = over / allowed if allowed > 0 else np.where(over > 0, 1 + over, over)
                worst = np.maximum(worst, np.where(np.isnan(used), np.inf, used))
    return worst


def merged(tallies: Iterable[Tally]) -> Tally:
    """Results of runs of trials, in order; large arrays are added in place, so memory does not grow with their number.

    Raises
    ------
    ValueError
        There are none.
    """
    whole: Tally | None = None
    for tally in tallies:
        if whole is None:
            whole = replace(tally, counts=tally.counts.copy())
        else:
            counts = whole.counts
            counts += tally.counts
            none = np.zeros(1, np.int64)
            whole = replace(_both(replace(whole, counts=none), replace(tally, counts=none)), counts=counts)
    if whole is None:
        raise ValueError("no trials: nothing to merge")
    return whole


def _both(first: Tally, second: Tally) -> Tally:
    def joined(name: str) -> Any:
        return np.concatenate([getattr(first, name), getattr(second, name)])

    worst, scores = joined("worst"), joined("scores")
    order = np.lexsort((worst, -scores))[: max(len(first.worst), len(second.worst))]
    summed: dict[str, Any] = {name: getattr(first, name) + getattr(second, name) for name in SUMMED}
    return Tally(
        **summed,
        **{name: joined(name) for name in ("drawn", "measured", "moved")},
        low=np.minimum(first.low, second.low),
        high=np.maximum(first.high, second.high),
        worst=worst[order],
        scores=scores[order],
    )


def pack(tally: Tally, digest: str) -> bytes:
    """As the bytes of an .npz file; the same results give the same bytes. Histograms are stored sparsely."""
    arrays = {item.name: np.asarray(getattr(tally, item.name)) for item in fields(tally)}
    counts = arrays.pop("counts")
    filled = np.flatnonzero(counts)
    arrays["filled"], arrays["filled_counts"] = filled.astype(np.int32), counts.ravel()[filled]
    arrays["shape"] = np.array(counts.shape)
    return npz_bytes(arrays, {"digest": digest})


def unpack(content: bytes, digest: str) -> Tally:
    """The results in a chunk's bytes.

    Raises
    ------
    ValueError
        Not such a file, damaged, or of another study.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            if json.loads(archive.read("note.json"))["digest"] != digest:
                raise ValueError("belongs to another study, seed or version")
            arrays = {
                name.removesuffix(".npy"): np.lib.format.read_array(io.BytesIO(archive.read(name)), allow_pickle=False)
                for name in archive.namelist()
                if name.endswith(".npy")
            }
    except (zipfile.BadZipFile, KeyError, EOFError, OSError) as error:
        raise ValueError(f"is damaged ({error})") from None
    counts = np.zeros(tuple(arrays.pop("shape")), np.int64)
    counts.ravel()[arrays.pop("filled")] = arrays.pop("filled_counts")
    return Tally(trials=int(arrays.pop("trials")), counts=counts, **arrays)


def npz_bytes(arrays: Mapping[str, NDArray[Any]], note: Mapping[str, str] | None = None) -> bytes:
    """The bytes of an .npz file without dates, the same for the same arrays; `note` becomes note.json in it."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        if note is not None:
            archive.writestr(_entry("note.json"), json.dumps(note))
        for name, array in arrays.items():
            raw = io.BytesIO()
            np.lib.format.write_array(raw, np.asarray(array, order="C"), allow_pickle=False)
            archive.writestr(_entry(f"{name}.npy"), raw.getvalue(), compresslevel=1)
    return buffer.getvalue()


def _entry(name: str) -> zipfile.ZipInfo:
    entry = zipfile.ZipInfo(name, date_time=(1980, 1, 1, 0, 0, 0))
    entry.compress_type = zipfile.ZIP_DEFLATED
    entry.external_attr = 0o644 << 16
    return entry
