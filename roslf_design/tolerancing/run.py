"""A plan's trials, chunk by chunk, wherever they run: in this process, in a pool, on a Dask cluster. The same bytes.

What is kept of them is bounded: counts and sums that add up, the worst trials, the first in full. Distributions are
counts in bins of equal ratios of the deviation from nominal, `SPLIT` of them each time it doubles, both signs, from
2^-50 to 2^30: a quantile is then right to a `SPLIT`-th of its own deviation from nominal, whatever the scale, without
a pilot run. A value at nominal (an unclipped image keeps exactly 1) has a bin of its own.
"""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import io
import json
import logging
import math
import multiprocessing
import os
import signal
import threading
import zipfile
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, fields
from functools import partial, reduce
from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray

from .._arrays import Array, by_value
from .._jit import kernel
from ..design.files import write_atomically
from ..errors import Argument, InputError, Problem, refusal
from ..input_files import read_json
from ..theory.quantity import finite
from .study import TolerancePlan
from .trials import STRETCH, MeasuredTrials, measure_uniforms

Counts = NDArray[np.int64]
Work = Callable[[int], bytes]
"""A picklable function of a chunk's index."""
Progress = Callable[[int, int], None]
"""Told (trials done, trials in all)."""

ATTEMPTS = 4
"""Deaths of workers in a row, no chunk finished between them, after which a run is given up."""
PATIENCE = 3.0
"""How long nothing may come from a pool before its workers are looked after [s]."""
WORKER_ENVIRONMENT = {f"{name}_NUM_THREADS": 1 for name in ("OMP", "MKL", "OPENBLAS")} | {
    "MALLOC_MMAP_THRESHOLD_": 2**20,
    "MALLOC_TRIM_THRESHOLD_": 2**26,
}
"""Environment of Dask workers that are started here. Dask's own has freed memory handed back at once: fetching it
anew for every array takes as long as the arithmetic. What a block's arrays took is kept for the next, longer ones
are handed back."""
CONNECT = 2
"""Seconds that a Dask scheduler has to answer."""
MANIFEST = "manifest.json"
SCHEMA = "roslf.tolerance-run/1"

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
    *("trials", "passed", "held", "undefined", "infinite", "impossible", "faults"),
    *("counts", "moments", "total", "square", "x", "xx", "xy"),
)
"""Fields of a `Tally` that add up over chunks."""


class ChunkLostError(RuntimeError):
    """A chunk's worker died every time it was tried."""


@dataclass(frozen=True)
class WorkerSettings:
    """Workers on which chunks run."""

    workers: int = 1
    """Processes; 1: this one."""
    scheduler: str | None = None
    """A Dask scheduler's address ("tcp://host:8786"), or "local" for a cluster started here."""


def run_trials(
    plan: TolerancePlan,
    folder: Path,
    where: WorkerSettings = WorkerSettings(),
    *,
    resume: bool = False,
    progress: Progress | None = None,
) -> Tally:
    """Run a plan's trials, chunk by chunk, into a folder.

    Parameters
    ----------
    plan : TolerancePlan
        What runs.
    folder : Path
        Gets a manifest and one file a chunk.
    where : Where
        Changes the time it takes, never the bytes.
    resume : bool
        Go on with a run that was stopped.
    progress : callable, optional
        Called after each chunk.

    Raises
    ------
    InputError
        The folder holds something else; no scheduler answers.
    ChunkLostError
        Workers keep dying over one chunk.
    OSError
        A file cannot be written; earlier chunks stay as they are.
    """
    report = progress or (lambda done, total: None)
    digest, paths = plan.digest(), [folder / "chunks" / f"{index:06d}.npz" for index in range(plan.chunks)]
    _check_processes(where)
    _claim(plan, digest, folder, resume)
    missing = [index for index, path in enumerate(paths) if not _is_whole(path, digest, index)]
    done = plan.trials - sum(plan.chunk_trials(index) for index in missing)
    report(done, plan.trials)
    with contextlib.closing(run_chunks(partial(run_chunk, plan), missing, where)) as finished:
        for index, content in finished:
            write_atomically(paths[index], content)
            done += plan.chunk_trials(index)
            report(done, plan.trials)
    return merged(unpack(path.read_bytes(), digest, index) for index, path in enumerate(paths))


def _claim(plan: TolerancePlan, digest: str, folder: Path, resume: bool) -> None:
    """Write the manifest that says what runs, unless another run, or an earlier one of this plan, lies there."""
    manifest, chunks = folder / MANIFEST, folder / "chunks"
    remedy = "delete it or choose another folder"
    wrong = [f"{place} is a file, not a folder" for place in (folder, chunks) if place.exists() and not place.is_dir()]
    wrong += [f"{place} is a folder, not a chunk of results" for place in chunks.glob("*.npz") if place.is_dir()]
    if wrong:
        raise InputError((Problem("", f"{wrong[0]}; {remedy}"),))
    if manifest.exists():
        held = read_json(manifest, str(manifest), remedy)
        if not isinstance(held, dict) or "digest" not in held:
            raise InputError((Problem("", f"{manifest} is damaged; {remedy}"),))
        if held["digest"] != digest:
            raise InputError((Problem("", f"{folder} holds another study, seed or trial count; {remedy}"),))
        if not resume and any(chunks.glob("*.npz")):
            raise InputError((Argument("", f"{folder} holds this run already; pass `resume` to go on with it"),))
    chunks.mkdir(parents=True, exist_ok=True)
    content = {
        "schema": SCHEMA,
        "study": plan.name,
        "digest": digest,
        "seed": plan.draws.seed,
        "trials": plan.trials,
        "chunk": plan.chunk,
        "chunks": plan.chunks,
    }
    write_atomically(manifest, (json.dumps(content, indent=1) + "\n").encode())


def _is_whole(path: Path, digest: str, index: int) -> bool:
    """Whether a chunk has a file, as this run wrote it."""
    return path.is_file() and _is_sealed(path.read_bytes(), digest, index)


def run_chunk(plan: TolerancePlan, index: int) -> bytes:
    """Run one chunk and pack its results; a function of its arguments alone."""
    return pack(tally_chunk(plan, index), plan.digest(), index)


def tally_chunk(plan: TolerancePlan, index: int) -> Tally:
    """Run one chunk of a plan, a stretch at a time: a worker's memory holds no more, however long the chunk."""
    size, first = plan.chunk_trials(index), index * plan.chunk

    def stretch(start: int) -> Tally:
        drawn = plan.draws.uniforms(index, plan.chunk, start, min(start + STRETCH, size))
        return _tally_of(plan, measure_uniforms(plan, drawn), first + start)

    return merged(stretch(start) for start in range(0, size, STRETCH))


def _check_processes(where: WorkerSettings) -> None:
    """Refuse processes where the system has no room for what they share, as with a read-only /dev/shm."""
    if where.workers < 2 and where.scheduler != "local":
        return
    try:
        multiprocessing.get_context("spawn").Lock()
    except OSError as error:
        option = "workers" if where.scheduler is None else "scheduler"
        message = f"no processes can be started here (/dev/shm: {error.strerror}); give `workers` 1 alone"
        raise refusal(option, message) from None


def run_chunks(work: Work, indices: Sequence[int], where: WorkerSettings) -> Generator[tuple[int, bytes], None, None]:
    """Run chunks where asked, in whatever order they finish.

    Raises
    ------
    InputError
        Dask is not installed, or no scheduler answers there.
    ChunkLostError
        Workers keep dying over the same chunk.
    """
    if where.scheduler is not None:
        yield from _on_cluster(work, indices, where.scheduler, where.workers)
    elif where.workers > 1 and len(indices) > 1:
        yield from _in_pool(work, indices, where.workers)
    else:
        yield from ((index, work(index)) for index in indices)


def _in_pool(work: Work, indices: Sequence[int], workers: int) -> Iterator[tuple[int, bytes]]:
    """A worker that dies takes the pool with it: the pool is rebuilt and unfinished chunks run again."""
    left, deaths = dict.fromkeys(indices), 0
    # Not fork: the parent may hold threads (progress bar, numba) that a forked child would inherit half-alive.
    context = multiprocessing.get_context("spawn")
    while left:
        pool = ProcessPoolExecutor(workers, mp_context=context, initializer=_ready_for_work)
        try:
            with _ctrl_c_later():
                running = {pool.submit(work, index): index for index in left}
            for future in _finished(pool, running):
                content, index = future.result(), running.pop(future)
                del left[index]
                deaths = 0
                yield index, content
        except BrokenProcessPool:
            deaths += 1
            if deaths == ATTEMPTS:
                raise ChunkLostError(
                    f"chunk {min(left)} or a later one: a worker process died {ATTEMPTS} times; is memory short? "
                    "Run fewer `workers` and go on with `resume`"
                ) from None
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _finished(pool: ProcessPoolExecutor, running: Iterable[Future[bytes]]) -> Iterator[Future[bytes]]:
    """As `as_completed`, also where a worker died in the midst of its answer.

    The pool would wait for the rest of it for ever: the other workers and the pool itself hold the pipe open. Closed,
    it ends, and the pool breaks as it does over any death.
    """
    left = set(running)
    while left:
        done, left = wait(left, PATIENCE, FIRST_COMPLETED)
        workers = list((pool._processes or {}).values())
        if not done and any(worker.exitcode is not None for worker in workers):
            for worker in workers:
                worker.kill()
            pool._result_queue._writer.close()  # type: ignore[attr-defined]
        yield from done


@contextlib.contextmanager
def _ctrl_c_later() -> Iterator[None]:
    """Hold Ctrl-C back while workers start: they inherit that, and print no traceback from the midst of an import."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _ready_for_work() -> None:
    """Let this worker end with its parent, and quietly on Ctrl-C."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    end_with_parent()


def end_with_parent() -> None:
    """End this process when its parent is killed and cannot say so: it would else wait for work for ever."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def wait_for_it() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=wait_for_it, daemon=True).start()


@contextlib.contextmanager
def local_cluster(workers: int) -> Iterator[Any]:
    """A Dask cluster of so many single-threaded processes on this machine."""
    import dask
    import distributed

    untyped: Any = distributed
    with (
        dask.config.set(
            {
                "distributed.nanny.pre-spawn-environ": WORKER_ENVIRONMENT,
                "distributed.worker.profile.enabled": False,  # it gathers memory for an hour
            }
        ),
        untyped.LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",  # beside other clusters
        ) as cluster,
    ):
        yield cluster


def _on_cluster(work: Work, indices: Sequence[int], address: str, workers: int) -> Iterator[tuple[int, bytes]]:
    """Dask runs a dead worker's chunks again; `workers` are of a local cluster, stopped at the end."""
    try:
        import dask
        import distributed
        from distributed.scheduler import KilledWorker
    except ImportError:
        raise refusal("scheduler", "needs Dask, which is not installed; pip install 'roslf_design[cluster]'") from None
    if not indices:
        return
    untyped: Any = distributed
    with contextlib.ExitStack() as stack:
        stack.enter_context(dask.config.set({"distributed.scheduler.allowed-failures": ATTEMPTS}))
        cluster: Any = address
        if address == "local":
            cluster = stack.enter_context(local_cluster(workers))
        else:
            _ask(address)
        client = stack.enter_context(untyped.Client(cluster, set_as_default=False))
        # Keys of its own: a scheduler that remembers an earlier run must not hand out that run's results.
        own = f"roslf-tolerance-{uuid4().hex}"
        futures = [client.submit(work, index, key=f"{own}-{index}", pure=False, retries=0) for index in indices]
        for future in untyped.as_completed(futures, loop=client.loop):
            index = int(future.key.rsplit("-", 1)[1])
            try:
                content = future.result()
            except KilledWorker as error:
                raise ChunkLostError(f"chunk {index}: its workers kept dying ({error}); go on with `resume`") from None
            future.release()
            yield index, content


def _ask(address: str) -> None:
    """Refuse an address where no scheduler answers; a Client would take 20 s to give it up, and log why at length."""
    import distributed

    untyped: Any = distributed

    async def identity() -> Any:
        arguments = untyped.Security().get_connection_args("client")
        async with untyped.rpc(address, timeout=CONNECT, connection_args=arguments) as scheduler:
            return await asyncio.wait_for(scheduler.identity(), CONNECT)

    log = logging.getLogger("distributed")
    level = log.level
    log.setLevel(logging.CRITICAL + 1)
    try:
        kind = asyncio.run(identity()).get("type", "no scheduler")
    except (OSError, ValueError, TypeError, RuntimeError, ImportError, MemoryError) as error:
        kind = type(error).__name__
    finally:
        log.setLevel(level)
    if kind != "Scheduler":
        message = f'no Dask scheduler answers at {address} ({kind}); give one such as "tcp://host:8786"'
        raise refusal("scheduler", message)


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
    drawn: Array
    """Deviations [tolerances] of the first trials kept, shape (kept, P)."""
    measured: Array
    """Columns of these trials, shape (kept, V, C)."""
    moved: Array
    """Their adjustments [mm, rad], shape (kept, adjusters)."""


def _tally_of(plan: TolerancePlan, trials: MeasuredTrials, first: int) -> Tally:
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
        worst=worst[order],
        scores=scores[order],
    )


SEAL = 64
"""Hexadecimal digits at the end of a chunk (a .zip's comment): a digest of the run, the chunk's index and its bytes."""


def _seal(content: bytes, digest: str, index: int) -> bytes:
    return hashlib.sha256(f"{digest} {index} ".encode() + content).hexdigest().encode()


def _is_sealed(content: bytes, digest: str, index: int) -> bool:
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
    content = npz_bytes({**arrays, **{k: np.asarray(v) for k, v in sparse.items()}}, comment=SEAL * b"0")[:-SEAL]
    return content + _seal(content, digest, index)


def unpack(content: bytes, digest: str, index: int) -> Tally:
    """The results in a chunk's bytes; arguments as for `pack`.

    Raises
    ------
    ValueError
        Not as `pack` wrote them: damaged, changed, or of another study or chunk.
    """
    if not _is_sealed(content, digest, index):
        raise ValueError(f"chunk {index} is damaged, or of another study, seed or version")
    with np.load(io.BytesIO(content)) as archive:
        arrays = dict(archive)
    counts = np.zeros(arrays.pop("shape"), np.int64)
    counts.ravel()[arrays.pop("filled")] = arrays.pop("filled_counts")
    return Tally(trials=int(arrays.pop("trials")), counts=counts, **arrays)


def npz_bytes(arrays: Mapping[str, NDArray[Any]], comment: bytes = b"") -> bytes:
    """The bytes of an .npz file, which has no dates: the same for the same arrays; they end in the comment."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
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
