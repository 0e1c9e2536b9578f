"""Where chunks run: in this process, in a pool of processes, or on a Dask cluster. One call, the same bytes."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from ..errors import InputError, Problem

Work = Callable[[int], bytes]
"""A picklable function of a chunk's index."""

ATTEMPTS = 4
"""Times that one chunk may be running when its worker dies before the run gives up on it."""


CONNECT = 10
"""Seconds that a Dask scheduler has to answer."""


class ChunkLostError(RuntimeError):
    """A chunk's worker died every time it was tried."""


def in_process(work: Work, indices: Sequence[int]) -> Iterator[tuple[int, bytes]]:
    """Run chunks here, one after the other."""
    return ((index, work(index)) for index in indices)


def in_pool(work: Work, indices: Sequence[int], workers: int) -> Iterator[tuple[int, bytes]]:
    """Run chunks in a pool of processes, in whatever order they finish.

    A worker that dies takes the pool with it: the pool is rebuilt and unfinished chunks run again.

    Raises
    ------
    ChunkLostError
        Workers keep dying over the same chunk.
    """
    waiting, tries = list(reversed(indices)), dict.fromkeys(indices, 0)
    pool = _pool(workers)
    running: dict[Future[bytes], int] = {}
    try:
        while waiting or running:
            broken = False
            try:
                while waiting and len(running) < 2 * workers:
                    running[pool.submit(work, waiting[-1])] = waiting[-1]
                    waiting.pop()
            except BrokenProcessPool:
                broken = True
            done, _ = wait(running, return_when=FIRST_COMPLETED) if running else (set(), set())
            for future in done:
                if isinstance(future.exception(), BrokenProcessPool):
                    broken = True
                else:
                    yield running.pop(future), future.result()
            if broken:
                pool.shutdown(wait=True, cancel_futures=True)
                yield from _finished(running)
                for index in sorted(running.values(), reverse=True):
                    tries[index] += 1
                    if tries[index] >= ATTEMPTS:
                        raise ChunkLostError(
                            f"chunk {index}: its worker process died {ATTEMPTS} times; is memory short? "
                            "Run fewer workers (--workers) and go on with --resume"
                        )
                    waiting.append(index)
                running = {}
                pool = _pool(workers)
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def _finished(running: dict[Future[bytes], int]) -> Iterator[tuple[int, bytes]]:
    """Results that arrived before the pool broke."""
    for future in [future for future in running if future.done() and not future.cancelled()]:
        if future.exception() is None:
            yield running.pop(future), future.result()


def _pool(workers: int) -> ProcessPoolExecutor:
    # Not fork: the parent may hold threads (progress bar, numba) that a forked child would inherit half-alive.
    return ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"), initializer=_end_with_parent)


def _end_with_parent() -> None:
    """End this worker when its parent is killed; it would else wait for work for ever."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def wait_for_it() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=wait_for_it, daemon=True).start()


def on_cluster(
    work: Work, indices: Sequence[int], address: str | None, workers: int, ready: Callable[[Any], None] | None = None
) -> Iterator[tuple[int, bytes]]:
    """Run chunks on a Dask cluster, in whatever order they finish. Dask runs a dead worker's chunks again.

    Parameters
    ----------
    work, indices
        As for the others.
    address : str or None
        Of a scheduler ("tcp://host:8786"); None or "local": a cluster of worker processes is started here and stopped
        at the end.
    workers : int
        Of a local cluster.
    ready : callable, optional
        Called with the client once it is connected.

    Raises
    ------
    InputError
        Dask is not installed, or no scheduler answers there.
    ChunkLostError
        Workers keep dying over the same chunk.
    """
    try:
        import dask
        import distributed
        from distributed.scheduler import KilledWorker
    except ImportError:
        raise InputError(
            (Problem("--scheduler", "needs Dask, which is not installed; pip install 'roslf_design[cluster]'"),)
        ) from None
    if not indices:
        return
    untyped: Any = distributed
    with contextlib.ExitStack() as stack:
        stack.enter_context(dask.config.set({"distributed.scheduler.allowed-failures": ATTEMPTS}))
        if address in (None, "local"):
            cluster = untyped.LocalCluster(
                n_workers=workers, threads_per_worker=1, processes=True, host="127.0.0.1", dashboard_address=None
            )
            where: Any = stack.enter_context(cluster)
        else:
            where = address
        try:
            client = stack.enter_context(untyped.Client(where, timeout=CONNECT, set_as_default=False))
        except (OSError, ValueError) as error:
            raise InputError(
                (Problem("--scheduler", f"no Dask scheduler answers at {address} ({type(error).__name__}); check it"),)
            ) from None
        if ready is not None:
            ready(client)
        waiting = list(reversed(indices))
        at_once = 2 * max(workers, len(client.scheduler_info(n_workers=-1)["workers"]), 1)
        first = [_submit(client, work, waiting.pop()) for _ in range(min(at_once, len(waiting)))]
        finished = untyped.as_completed(first, loop=client.loop)
        for future in finished:
            index = int(future.key.rsplit("-", 1)[1])
            try:
                content = future.result()
            except KilledWorker as error:
                raise ChunkLostError(f"chunk {index}: its workers kept dying ({error}); go on with --resume") from None
            future.release()
            if waiting:
                finished.add(_submit(client, work, waiting.pop()))
            yield index, content


def _submit(client: Any, work: Work, index: int) -> Any:
    from uuid import uuid4

    # A key of its own: a scheduler that remembers an earlier run must not hand out that run's results.
    return client.submit(work, index, key=f"roslf-tolerance-{uuid4().hex}-{index}", pure=False, retries=0)
