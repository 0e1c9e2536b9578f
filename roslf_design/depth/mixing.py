"""Neighbours' light in samples: lists of it, and the samples without it."""

from __future__ import annotations

import itertools
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._jit import WHOLE, Band, kernel, prange
from ..theory.image_parts import ImageParts
from .nodes import NodeMap

ROUNDS = 8
"""Rounds of taking neighbours' light away: what is left falls to less than a third each time."""
FAINT, STRONG, SLOW = 1e-5, 0.02, (1, 3, 6)
"""Share of a neighbour's light in a sample that is let be; up to which it is looked at in some rounds alone; these."""
NEAR = 0.03
"""Pitches beside what a view shows up to which neighbours' light is taken for what it shows."""
LEAST, SURE = 0.6, 0.65
"""Own share of a sample's light under which it is dropped: it tells more of its neighbours. Share from which on it
tells what the microlens sends others: of less errors would go to and fro, and the mean of its other samples does."""
FEW = 1_000_000
"""Pairs of points below which all distances are worked out sooner than scipy.spatial is imported."""


class Mixing(NamedTuple):
    """Neighbours' light in every sample: a list for each, one after the other."""

    first: NDArray[np.int64]
    """Where the list of each sample begins, and the last one ends."""
    source: NDArray[np.int64]
    """The neighbour's sample that shows what it sends."""
    step: NDArray[np.int64]
    """Steps to the neighbour, shape (M, 2)."""
    share: NDArray[np.float32]
    """Share of the sample's light, at the nodes, shape (M, nodes)."""

    @classmethod
    def of(
        cls, parts: ImageParts, shares: NDArray[np.float64], own: int, usable: NDArray[np.bool_], faint: bool | None,
        beside: NDArray[np.float64] | None = None, sure: float = SURE,
    ) -> Mixing:  # fmt: skip
        """For samples that are `usable`, shape (t, s), and of them; of faint light, of other, or (None) of all.

        Where light sees `beside`, as `ViewLight.beside` has it, what the nearest view shows is looked for that much on.
        """

        def picked(part: NDArray[np.float64]) -> NDArray[np.float64]:
            return np.compress(usable.ravel(), part.reshape(*part.shape[:-2], -1), -1)

        x, y, shares = map(picked, (parts.x, parts.y, shares))
        most = np.abs(shares).max(1)
        taken = (most > FAINT) & ((most <= STRONG) == faint if faint is not None else True)
        taken[own] = False
        sample, step = np.nonzero(taken.T)
        steps, count = np.array(parts.steps, np.int64).reshape(-1, 2)[step], np.arange(taken.shape[1] + 1)
        if beside is None:
            light = np.abs(parts.light[..., usable])
            places = np.stack([(axis * light).mean(1) / np.maximum(light.mean(1), 1e-12) for axis in (x, y)], -1)
            known = np.flatnonzero((shares[own] > sure).any(0))
            source = known[_nearest(places[own][known], places[step, sample])] if known.size else 0 * sample
            share = np.ascontiguousarray(shares[step, :, sample], np.float32)
            return cls(np.searchsorted(sample, count), np.asarray(source, np.int64), steps, share)
        beside, keys, each = np.broadcast_to(picked(beside), (2, *shares.shape)), [], []
        far = int(np.abs(steps).max(initial=0)) + math.ceil(float(np.abs(beside).max(initial=0.0)) * 2) + 1
        size = (*2 * taken.shape[1:], 2 * far + 1, 2 * far + 1)
        for node in range(shares.shape[1]):
            some = np.flatnonzero(np.abs(shares[step, node, sample]) > FAINT)
            to, by = sample[some], step[some]
            places = np.stack([x[:, node], y[:, node]], -1)
            lit = np.flatnonzero((shares[own, node] > sure) | (shares[own, node].max() <= sure))
            source = lit[_nearest(places[own, lit], places[by, to])]
            off = beside[:, own, node, source] - beside[:, by, node, to]
            at = steps[some].T + np.where(np.abs(off) > NEAR, off, 0.0)
            low = np.floor(at).astype(np.int64)
            before, after = np.array([1 - at + low, at - low])
            key, sent = np.ravel_multi_index((to, source, *(low + far)), size), shares[by, node, to]
            for aside, (along, up) in enumerate(itertools.product((before, after), repeat=2)):
                part = along[0] * up[1] * sent
                strong = np.abs(part) > FAINT
                keys.append(key[strong] + (aside // 2) * size[3] + aside % 2)
                each.append(part[strong])
        numbers, back = np.unique(np.concatenate(keys), return_inverse=True)
        nodes = np.repeat(np.arange(len(keys)) // 4, [len(part) for part in each])
        share = np.zeros((numbers.size, shares.shape[1]), np.float32)
        np.add.at(share.reshape(-1), back * shares.shape[1] + nodes, np.concatenate(each).astype(np.float32))
        to, source, *way = np.unravel_index(numbers, size)
        source, steps = np.ascontiguousarray(source), np.ascontiguousarray(np.transpose(way)) - far
        return cls(np.searchsorted(to, count), source, steps, share)

    def noise(self, light: NDArray[np.float64], own: NDArray[np.float64]) -> NDArray[np.float64]:
        """Variance that the neighbours' samples leave in each, over that of its own light; all (sample, node)."""
        sent = np.divide(1.0, light * own**2, out=np.zeros_like(light), where=own > SURE)
        left = np.zeros_like(light)
        np.add.at(left, np.repeat(np.arange(len(light)), np.diff(self.first)), self.share**2 * sent[self.source])
        return left * light


def _nearest(some: NDArray[np.float64], places: NDArray[np.float64]) -> NDArray[np.intp]:
    """Number of the nearest of some points to each of the places, (M,)."""
    if len(some) * len(places) <= FEW:
        # Axis by axis: numpy sums short last axes slowly.
        along, across = (np.square(places[:, axis, None] - some[:, axis].astype(np.float64)) for axis in (0, 1))
        return np.asarray((along + across).argmin(1), np.intp)
    from scipy.spatial import cKDTree

    return np.asarray(cKDTree(some).query(places)[1], np.intp)


def freed_in_rounds(
    raw: NDArray[np.float32],
    gain: NDArray[np.float32],
    sure: NDArray[np.float32],
    ways: list[Mixing],
    maps: NodeMap,
    start: NDArray[np.intp],
) -> NDArray[np.float32]:
    """Samples without what neighbours put into them, shape (view, v, u), by Jacobi's iteration; 0 where `gain` is.

    Neighbours send what their samples tell whose `sure` is not 0.
    """
    near, faint = ways
    dark = (sure <= 0).all(0).astype(np.float32)
    values, other, rest = np.empty_like(raw), np.empty_like(raw), np.zeros_like(raw)
    _fill.compiled(raw, sure, values)
    for count in range(ROUNDS):
        if count in SLOW:  # faint light changes little
            rest[:] = 0
            add_neighbours.compiled(values, dark, *faint, *maps, start, rest)
        free_samples.compiled(
            raw, gain, gain if count == ROUNDS - 1 else sure, rest, values, dark, *near, *maps, start, other
        )
        values, other = other, values
    values[gain <= 0] = 0
    return values


@kernel()
def _fill(values: Any, known: Any, out: Any) -> None:
    """Samples, and the mean of the microlens's others for those that are not known; 0 of none."""
    count, rows, columns = values.shape
    for v in range(rows):
        for n in range(count):  # whole arrays at once would be compiled four times as long
            for u in range(columns):
                out[n, v, u] = values[n, v, u]
        _fill_row(known[:, v], out[:, v])


@kernel()
def _fill_row(known: Any, values: Any) -> None:
    count, columns = values.shape
    sums, views = np.zeros(columns), np.zeros(columns)
    for n in range(count):
        for u in range(columns):
            if known[n, u] > 0:
                sums[u] += values[n, u]
                views[u] += 1.0
    for n in range(count):
        for u in range(columns):
            if known[n, u] <= 0:
                values[n, u] = sums[u] / max(views[u], 1.0)


@kernel()
def _gather_row(
    n: int, v: int, values: Any, dark: Any, first: Any, source: Any, steps: Any, shares: Any, node: Any, down: Any,
    along: Any, across: int, start: Any, out: Any, like: Any, share: Any,
) -> None:  # fmt: skip
    """Add neighbours' light in samples n of row v; one that nothing is known of is like the microlens itself."""
    rows, columns = dark.shape
    nodes = shares.shape[1]
    least, most = node[v].min(), min(node[v].max() + across + 2, nodes)
    for u in range(columns):  # here and below: whole arrays at once would be compiled twice as long
        like[u] = 0.0
    for m in range(first[n], first[n + 1]):
        w, sends = v + steps[m, 1], False
        for c in range(least, most):
            if shares[m, c] != 0:
                sends = True
                break
        if not sends:
            continue
        if nodes == 1:
            for u in range(columns):
                share[u] = shares[m, 0]
        else:
            for u in range(columns):
                c, part = node[v, u], down[v, u]
                left = shares[m, c] + part * (shares[m, c + across] - shares[m, c])
                right = shares[m, c + 1] + part * (shares[m, c + across + 1] - shares[m, c + 1])
                share[u] = left + along[v, u] * (right - left)
        if w < 0 or w >= rows:
            for u in range(columns):
                like[u] += share[u]
            continue
        off = steps[m, 0] + start[v] - start[w]
        low = min(max(-off, 0), columns)
        high = max(min(columns - off, columns), low)
        for u in range(low):
            like[u] += share[u]
        for u in range(high, columns):
            like[u] += share[u]
        part, sent, unlit = (
            share[low:high],
            values[source[m], w, low + off : high + off],
            dark[w, low + off : high + off],
        )
        total, same = out[low:high], like[low:high]
        for u in range(part.size):
            total[u] += part[u] * sent[u]
            same[u] += part[u] * unlit[u]
    own = values[n, v]
    for u in range(columns):
        out[u] += like[u] * own[u]


@kernel(parallel=True)
def add_neighbours(
    values: Any, dark: Any, first: Any, source: Any, steps: Any, shares: Any, node: Any, down: Any, along: Any,
    across: int, start: Any, out: Any, band: Band = WHOLE,
) -> None:  # fmt: skip
    """Add neighbours' light in all samples, shape (view, v, u); `dark` is 1 where nothing is known of a microlens."""
    count, rows, columns = values.shape
    for v in prange(rows, band):
        like, share = np.empty(columns, np.float32), np.empty(columns, np.float32)
        for n in range(count):
            _gather_row(
                n, v, values, dark, first, source, steps, shares, node, down, along, across, start, out[n, v], like,
                share,
            )  # fmt: skip


@kernel(parallel=True)
def free_samples(
    raw: Any, gain: Any, sure: Any, rest: Any, values: Any, dark: Any, first: Any, source: Any, steps: Any, shares: Any,
    node: Any, down: Any, along: Any, across: int, start: Any, out: Any, band: Band = WHOLE,
) -> None:  # fmt: skip
    """Samples without `rest` and what neighbours that show `values` put into them, times `gain`; filled by `sure`."""
    count, rows, columns = values.shape
    for v in prange(rows, band):
        like, share = np.empty(columns, np.float32), np.empty(columns, np.float32)
        for n in range(count):
            foreign, before, much, freed = rest[n, v].copy(), raw[n, v], gain[n, v], out[n, v]
            _gather_row(
                n, v, values, dark, first, source, steps, shares, node, down, along, across, start, foreign, like,
                share,
            )  # fmt: skip
            for u in range(columns):
                freed[u] = (before[u] - foreign[u]) * much[u]
        _fill_row(sure[:, v], out[:, v])
