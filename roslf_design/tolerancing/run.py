"""A plan's trials, chunk by chunk, wherever they run: in this process, in a pool, on a Dask cluster. The same bytes.

What is kept of them is bounded: counts and sums that add up, the worst trials, the first in full. Distributions are
counts in bins of equal ratios of the deviation from nominal, `SPLIT` of them each time it doubles, both signs, from
2^-50 to 2^30: a quantile is then right to a `SPLIT`-th of its own deviation from nominal, whatever the scale, without
a pilot run. A value at nominal (an unclipped image keeps exactly 1) has a bin of its own.
"""

from __future__ import annotations

import contextlib
import json
import logging
import multiprocessing
import signal
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any
from uuid import uuid4

from ..design.files import write_atomically
from ..errors import OTHER_PLACE, Argument, InputError, Problem, refusal
from ..input_files import read_json
from ..processes import ready_for_work
from .study import TolerancePlan
from .tally import Tally, is_sealed, merged, pack, tally_of, unpack
from .trials import STRETCH, measure_uniforms

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
    whole = (path.is_file() and is_sealed(path.read_bytes(), digest, index) for index, path in enumerate(paths))
    missing = [index for index, there in enumerate(whole) if not there]
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
    wrong = [f"{place} is a file, not a folder" for place in (folder, chunks) if place.exists() and not place.is_dir()]
    wrong += [f"{place} is a folder, not a chunk of results" for place in chunks.glob("*.npz") if place.is_dir()]
    if wrong:
        raise InputError((Problem("", f"{wrong[0]}; {OTHER_PLACE}"),))
    if manifest.exists():
        held = read_json(manifest, str(manifest), OTHER_PLACE)
        if not isinstance(held, dict) or "digest" not in held:
            raise InputError((Problem("", f"{manifest} is damaged; {OTHER_PLACE}"),))
        if held["digest"] != digest:
            raise InputError((Problem("", f"{folder} holds another study, seed or trial count; {OTHER_PLACE}"),))
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


def run_chunk(plan: TolerancePlan, index: int) -> bytes:
    """Run one chunk and pack its results; a function of its arguments alone."""
    return pack(tally_chunk(plan, index), plan.digest(), index)


def tally_chunk(plan: TolerancePlan, index: int) -> Tally:
    """Run one chunk of a plan, a stretch at a time: a worker's memory holds no more, however long the chunk."""
    size, first = plan.chunk_trials(index), index * plan.chunk

    def stretch(start: int) -> Tally:
        drawn = plan.draws.uniforms(index, plan.chunk, start, min(start + STRETCH, size))
        return tally_of(plan, measure_uniforms(plan, drawn), first + start)

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
    # Not fork: the parent may hold threads (progress bar, kernels) that a forked child would inherit half-alive.
    context = multiprocessing.get_context("spawn")
    while left:
        pool = ProcessPoolExecutor(workers, mp_context=context, initializer=ready_for_work)
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
    import asyncio  # a fiftieth of a second, with what it needs

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
