"""A run's folder: a manifest that says what runs, and one file a finished chunk, each written whole or not at all."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

from ..design.write import write_atomically
from ..errors import InputError, Problem
from .plan import Plan
from .tally import Tally, unpack

MANIFEST = "manifest.json"
SCHEMA = "roslf.tolerance-run/1"


class Store:
    """Chunk files of one plan in a folder.

    Parameters
    ----------
    folder : Path
        Made where missing.
    plan : Plan
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

    def __init__(self, folder: Path, plan: Plan, *, resume: bool = False) -> None:
        self.folder, self.plan, self.digest = folder, plan, plan.digest()
        self.chunks = folder / "chunks"
        self.chunks.mkdir(parents=True, exist_ok=True)
        manifest = folder / MANIFEST
        if manifest.exists():
            self._same(manifest, resume)
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

    def _same(self, manifest: Path, resume: bool) -> None:
        try:
            digest = json.loads(manifest.read_text())["digest"]
        except (ValueError, KeyError, TypeError):
            raise InputError((Problem("", f"{manifest} is damaged; delete it or choose another folder"),)) from None
        if digest != self.digest:
            raise InputError(
                (
                    Problem(
                        "",
                        f"{self.folder} holds another study, seed or trial count; delete it or choose another folder",
                    ),
                )
            )
        if not resume and any(self.chunks.glob("*.npz")):
            raise InputError((Problem("", f"{self.folder} holds this run already; pass --resume to go on with it"),))

    def path(self, index: int) -> Path:
        """File of a chunk."""
        return self.chunks / f"{index:06d}.npz"

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
        write_atomically(self.path(index), content)

    def read(self, index: int) -> Tally:
        """Results of a chunk.

        Raises
        ------
        FileNotFoundError, ValueError
            Not run yet; damaged.
        """
        return unpack(self.path(index).read_bytes(), self.digest)

    def tallies(self) -> Iterator[Tally]:
        """Results of all chunks in order, one in memory at a time."""
        return (self.read(index) for index in range(self.plan.chunks))
