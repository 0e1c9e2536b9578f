"""What is kept of a chunk of trials: counts and sums that add up, the worst trials, and the first ones in full."""

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


def merge(first: Tally, second: Tally) -> Tally:
    """Results of two runs of trials, the first's before the second's."""
    summed: dict[str, Any] = {name: getattr(first, name) + getattr(second, name) for name in SUMMED}
    keep = max(len(first.worst), len(second.worst))
    worst = np.concatenate([first.worst, second.worst])
    scores = np.concatenate([first.scores, second.scores])
    order = np.lexsort((worst, -scores))[:keep]
    kept: dict[str, Any] = {
        name: np.concatenate([getattr(first, name), getattr(second, name)]) for name in ("drawn", "measured", "moved")
    }
    return Tally(
        **summed,
        **kept,
        low=np.minimum(first.low, second.low),
        high=np.maximum(first.high, second.high),
        worst=worst[order],
        scores=scores[order],
    )


def merged(tallies: Iterable[Tally]) -> Tally:
    """All results, in order; large arrays are added in place, so memory does not grow with their number."""
    whole: Tally | None = None
    for tally in tallies:
        if whole is None:
            whole = replace(tally, counts=tally.counts.copy())
        else:
            counts = whole.counts
            counts += tally.counts
            none = np.zeros(1, np.int64)
            whole = replace(merge(replace(whole, counts=none), replace(tally, counts=none)), counts=counts)
    if whole is None:
        raise ValueError("no trials: nothing to merge")
    return whole


def pack(tally: Tally, digest: str) -> bytes:
    """As the bytes of an .npz file; the same results give the same bytes. Histograms are stored sparsely."""
    arrays = {item.name: np.asarray(getattr(tally, item.name)) for item in fields(tally)}
    counts = arrays.pop("counts")
    filled = np.flatnonzero(counts)
    arrays |= {
        "filled": filled.astype(np.int32),
        "filled_counts": counts.ravel()[filled],
        "shape": np.array(counts.shape),
    }
    return npz_bytes(arrays, {"digest": digest})


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


def count_variant(deviations: Array) -> tuple[Counts, Counts, Array, Array, Array, Array]:
    """Undefined trials, bin counts, sum, sum of squares, least, greatest, for deviations of shape (C, trials)."""
    missing = np.isnan(deviations)
    undefined = missing.sum(axis=1)
    columns = len(deviations)
    counts = np.empty((columns, sketch.BINS), np.int64)
    total, square = np.empty(columns), np.empty(columns)
    low, high = np.empty(columns), np.empty(columns)
    for c in range(columns):
        row = deviations[c][~missing[c]] if undefined[c] else deviations[c]
        counts[c] = sketch.count(row)
        total[c], square[c] = row.sum(), np.einsum("t,t->", row, row)
        low[c], high[c] = row.min(initial=np.inf), row.max(initial=-np.inf)
    return undefined, counts, total, square, low, high


def _entry(name: str) -> zipfile.ZipInfo:
    entry = zipfile.ZipInfo(name, date_time=(1980, 1, 1, 0, 0, 0))
    entry.compress_type = zipfile.ZIP_DEFLATED
    entry.external_attr = 0o644 << 16
    return entry
