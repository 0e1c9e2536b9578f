"""A plan's trials, chunk by chunk, wherever they run: in this process, in a pool, on a Dask cluster. The same bytes."""

from __future__ import annotations

import contextlib
import json
import multiprocessing
import os
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any
from uuid import uuid4

from ..design.files import write_atomically
from ..errors import InputError, Problem
from .study import TolerancePlan
from .tally import Tally, counted, merged, pack, unpack
from .trials import BLOCK, measure_uniforms

Work = Callable[[int], bytes]
"""A picklable function of a chunk's index."""
Progress = Callable[[int, int], None]
"""Told (trials done, trials in all)."""

STRETCH = 8 * BLOCK
"""Trials counted at once: histograms are large, and adding them up block by block would cost more than the trials."""
ATTEMPTS = 4
"""Times that one chunk may be running when its worker dies before the run gives up on it."""
CONNECT = 10
"""Seconds that a Dask scheduler has to answer."""
MANIFEST = "manifest.json"
SCHEMA = "roslf.tolerance-run/1"


class ChunkLostError(RuntimeError):
    """A chunk's worker died every time it was tried."""


@dataclass(frozen=True)
class Where:
    """Where chunks run."""

    workers: int = 1
    """Processes; 1: this one."""
    scheduler: str | None = None
    """A Dask scheduler's address ("tcp://host:8786"), or "local" for a cluster started here."""


def run_trials(
    plan: TolerancePlan, folder: Path, where: Where = Where(), *, resume: bool = False, progress: Progress | None = None
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
    store = Store(folder, plan, resume=resume)
    missing = store.missing()
    done = plan.trials - sum(plan.chunk_trials(index) for index in missing)
    report = progress or (lambda done, total: None)
    report(done, plan.trials)
    with contextlib.closing(anywhere(partial(run_chunk, plan), missing, where)) as finished:
        for index, content in finished:
            store.write(index, content)
            done += plan.chunk_trials(index)
            report(done, plan.trials)
    return merged(store.tallies())


def run_chunk(plan: TolerancePlan, index: int) -> bytes:
    """Run one chunk and pack its results; a function of its arguments alone."""
    return pack(tally_chunk(plan, index), plan.digest())


def tally_chunk(plan: TolerancePlan, index: int) -> Tally:
    """Run one chunk of a plan."""
    uniforms = plan.draws.uniforms(index, plan.chunk)[:, : plan.chunk_trials(index)]
    first = index * plan.chunk
    return merged(
        counted(plan, measure_uniforms(plan, uniforms[:, at : at + STRETCH]), first + at)
        for at in range(0, uniforms.shape[1], STRETCH)
    )


def anywhere(work: Work, indices: Sequence[int], where: Where) -> Generator[tuple[int, bytes], None, None]:
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


def _on_cluster(work: Work, indices: Sequence[int], address: str, workers: int) -> Iterator[tuple[int, bytes]]:
    """Dask runs a dead worker's chunks again; `workers` are of a local cluster, stopped at the end."""
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
        cluster: Any = address
        if address == "local":
            cluster = untyped.LocalCluster(
                n_workers=workers, threads_per_worker=1, processes=True, host="127.0.0.1", dashboard_address=None
            )
            stack.enter_context(cluster)
        try:
            client = stack.enter_context(untyped.Client(cluster, timeout=CONNECT, set_as_default=False))
        except (OSError, ValueError) as error:
            raise InputError(
                (Problem("--scheduler", f"no Dask scheduler answers at {address} ({type(error).__name__}); check it"),)
            ) from None

        def submit(index: int) -> Any:
            # A key of its own: a scheduler that remembers an earlier run must not hand out that run's results.
            return client.submit(work, index, key=f"roslf-tolerance-{uuid4().hex}-{index}", pure=False, retries=0)

        waiting = list(reversed(indices))
        at_once = 2 * max(workers, len(client.scheduler_info(n_workers=-1)["workers"]), 1)
        first = [submit(waiting.pop()) for _ in range(min(at_once, len(waiting)))]
        finished = untyped.as_completed(first, loop=client.loop)
        for future in finished:
            index = int(future.key.rsplit("-", 1)[1])
            try:
                content = future.result()
            except KilledWorker as error:
                raise ChunkLostError(f"chunk {index}: its workers kept dying ({error}); go on with --resume") from None
            future.release()
            if waiting:
                finished.add(submit(waiting.pop()))
            yield index, content


class Store:
    """A run's folder: a manifest that says what runs, and one file a finished chunk, each written whole or not at all.

    Parameters
    ----------
    folder : Path
        Made where missing.
    plan : TolerancePlan
        Whose chunks.
    resume : bool
        Go on with what is there; else earlier results of the folder are an error.

    Raises
    ------
    InputError
        The folder holds another study's run, or one of this study and `resume` is false.
    OSError
        The folder cannot be made or written.
    """

    def __init__(self, folder: Path, plan: TolerancePlan, *, resume: bool = False) -> None:
        self.plan, self.digest = plan, plan.digest()
        self.folder = folder / "chunks"
        self.folder.mkdir(parents=True, exist_ok=True)
        manifest = folder / MANIFEST
        if manifest.exists():
            fault = self._fault(manifest, resume)
            if fault:
                raise InputError((Problem("", fault),))
        content = {
            "schema": SCHEMA,
            "study": plan.name,
            "digest": self.digest,
            "seed": plan.draws.seed,
            "trials": plan.trials,
            "chunk": plan.chunk,
            "chunks": plan.chunks,
        }
        write_atomically(manifest, (json.dumps(content, indent=1) + "\n").encode())

    def _fault(self, manifest: Path, resume: bool) -> str:
        """Why the run cannot use this folder; empty where it can."""
        folder = manifest.parent
        try:
            digest = json.loads(manifest.read_text())["digest"]
        except (ValueError, KeyError, TypeError):
            return f"{manifest} is damaged; delete it or choose another folder"
        if digest != self.digest:
            return f"{folder} holds another study, seed or trial count; delete it or choose another folder"
        if not resume and any(self.folder.glob("*.npz")):
            return f"{folder} holds this run already; pass --resume to go on with it"
        return ""

    def _path(self, index: int) -> Path:
        return self.folder / f"{index:06d}.npz"

    def missing(self) -> list[int]:
        """Chunks still to be run: those without a file, and those whose file is damaged or of something else."""
        return [index for index in range(self.plan.chunks) if not self._good(index)]

    def _good(self, index: int) -> bool:
        try:
            self.read(index)
        except (FileNotFoundError, ValueError):
            return False
        return True

    def write(self, index: int, content: bytes) -> None:
        """Keep a chunk's results."""
        write_atomically(self._path(index), content)

    def read(self, index: int) -> Tally:
        """Results of a chunk.

        Raises
        ------
        FileNotFoundError, ValueError
            Not run yet; damaged.
        """
        return unpack(self._path(index).read_bytes(), self.digest)

    def tallies(self) -> Iterator[Tally]:
        """Results of all chunks in order, one in memory at a time."""
        return (self.read(index) for index in range(self.plan.chunks))
