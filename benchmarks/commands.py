"""The commands that are timed as processes, and another revision beside this one."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import tomli_w

from .turns import Row, Run, RunError, Side, Spent, in_turn, last_line, process

REPOSITORY = Path(__file__).resolve().parents[1]
TRIALS = {True: 20_000, False: 200_000}
"""Of a tolerance study, quick or not."""
ROUNDS = {True: 2, False: 5}
SECONDS = {True: 4.0, False: 10.0}
"""After which a command is not run again."""
FIRST = 5
"""Commands that a newcomer types first."""


@dataclass(frozen=True)
class Command:
    """One command line of roslf, or what the explorer's slider does inside it."""

    name: str
    title: str
    words: tuple[str, ...] = ()
    """After `roslf`; none: the slider."""
    quick: bool = True
    bar: float | None = None
    """Processor seconds that it may take once its kernels are compiled."""
    cold: bool = False
    """Whether it is also run with no kernel compiled."""

    def run(self, python_path: Path = REPOSITORY, kernels: Path | None = None) -> Run:
        """It, with the package of a source tree; `kernels` as of `process`."""
        if not self.words:
            return process((sys.executable, str(REPOSITORY / "benchmarks" / "slider.py")), python_path, prints=True)
        return process((sys.executable, "-m", "roslf_design", *self.words), python_path, kernels=kernels)


def commands(folder: Path, quick: bool) -> list[Command]:
    """All, after their designs and studies have been written into `folder`; files that both revisions read."""
    study = tomllib.loads((REPOSITORY / "studies/tolerance-paper/study.toml").read_text())
    study |= {"sobol_samples": 256} if quick else {}
    plain = {key: value for key, value in study.items() if key != "compensators"}
    paper = tomllib.loads((REPOSITORY / "designs/paper.toml").read_text())
    paper["microlens_array"] |= {"layout": "hexagonal", "lens_shape": "circular"}
    files: dict[str, dict[str, Any]] = {"hexagonal": paper, "built": plain, "adjusted": study}
    at = {name: str(folder / f"{name}.toml") for name in files}
    for name, data in files.items():
        Path(at[name]).write_bytes(tomli_w.dumps(data).encode())
    few = ("--trials", str(TRIALS[quick]))
    tip = str(REPOSITORY / "studies/tolerance-scope/study.toml")
    readme = (REPOSITORY / "README.md").read_text()
    region = next(words for words in typed(readme) if words[:2] == ("depth", "paper"))
    pixels, board = "4600 x 3080 px", str(REPOSITORY / "studies/paper-images/board.toml")
    scope = str(REPOSITORY / "studies/optimize-rigid-scope/study.toml")
    speculum = str(REPOSITORY / "studies/optimize-ear-speculum/study.toml")
    lenses = str(REPOSITORY / "studies/optimize-real-lens/study.toml")
    held = partial(Command, cold=True)
    return [
        Command("help", "roslf --help", ("--help",)),
        held("evaluate", "roslf evaluate paper", ("evaluate", "paper"), bar=0.30),
        held("evaluate-singlet", "roslf evaluate paper-singlet", ("evaluate", "paper-singlet"), bar=0.9),
        Command("render", f"roslf render paper: white, {pixels}", ("render", "paper", "-o", "a.tif")),
        Command(
            "render-hexagonal", "the same, lenses in a hexagonal array", ("render", at["hexagonal"], "-o", "a.tif")
        ),
        held(
            "render-board",
            "roslf render paper --scene board.toml: 600 x 480 px",
            ("render", "paper", "--scene", board, "--region", "2000,1300,600,480", "-o", "a.tif"),
            bar=1.5,
        ),
        held("depth", "roslf depth paper", ("depth", "paper"), bar=4.0),
        held("depth-region", f"roslf {' '.join(region[:-2])}", region, bar=2.5),
        Command("depth-scope", "roslf depth rigid-scope", ("depth", "rigid-scope")),
        held(
            "tolerance-scope",
            "roslf tolerance tolerance-scope: 20,000 trials",
            ("tolerance", tip, "-o", "out", "--trials", "20000"),
            bar=3.0,
        ),
        Command(
            "tolerance",
            f"roslf tolerance tolerance-paper: {TRIALS[quick]:,} trials, as built",
            ("tolerance", at["built"], "-o", "out", *few),
        ),
        Command(
            "tolerance-adjusted",
            "the same, each build focused and its decoder calibrated",
            ("tolerance", at["adjusted"], "-o", "out", *few),
        ),
        held("optimize", "roslf optimize optimize-rigid-scope", ("optimize", scope, "-o", "out"), False, 5.0),
        Command("optimize-parts", "roslf optimize optimize-ear-speculum", ("optimize", speculum, "-o", "out"), False),
        Command(
            "optimize-lens",
            "roslf optimize optimize-real-lens: ten bought lenses and ways round, traced",
            ("optimize", lenses, "-o", "out"),
            False,
        ),
        held("report", "roslf report paper --pdf", ("report", "paper", "--pdf", "-o", "out"), bar=3.0),
        Command("slider", "explorer, slider to new pictures, without the browser"),
    ]


def typed(readme: str) -> list[tuple[str, ...]]:
    """Words after `roslf` of every command in README's tour that ends by itself, files named from anywhere."""
    lines = [shlex.split(line, comments=True) for line in re.findall(r"(?m)^roslf (.*)$", readme)]
    return [
        tuple(str(REPOSITORY / word) if (REPOSITORY / word).is_file() else word for word in words)
        for words in lines
        if words[0] not in ("explore", "warm")
    ]


def first_cold() -> Row:
    """README's first commands one after the other, as on the day of installation: together, no kernel compiled."""
    first = typed((REPOSITORY / "README.md").read_text())[:FIRST]
    title = f"README's first {FIRST} commands, cold, together"
    note = "; ".join(f"roslf {' '.join(word.removeprefix(f'{REPOSITORY}/') for word in words)}" for words in first)
    with tempfile.TemporaryDirectory(prefix="roslf-kernels-") as kernels:
        spent = [Command("", "", words).run(kernels=Path(kernels)) for words in first]
        side = Side.of("cold", _once(lambda: _together([run() for run in spent])))
    return Row("first-five", title, sides=(side,), note=f"{note}.", bar=15.0)


def _together(runs: Sequence[Spent]) -> Spent:
    return Spent(sum(run.wall for run in runs), sum(run.processor for run in runs), max(run.peak for run in runs))


def _once(run: Run) -> list[Spent] | str:
    """A run that nothing warmed."""
    try:
        return [run()]
    except RunError as error:
        return str(error)


def cold(command: Command) -> Side:
    """A command once, no kernel compiled."""
    with tempfile.TemporaryDirectory(prefix="roslf-kernels-") as kernels:
        return Side.of("cold", _once(command.run(kernels=Path(kernels))))


def measure(quick: bool, chosen: Sequence[str]) -> Iterator[Row]:
    """Every command, one after the other: warm, as `roslf warm` leaves a machine, and, once, cold."""
    if not chosen or set(chosen) - {"first-five"}:
        Command("", "", ("warm",)).run()()
    with tempfile.TemporaryDirectory(prefix="roslf-bench-") as folder:
        for command in commands(Path(folder), quick):
            if command.name in chosen or (not chosen and (command.quick or not quick)):
                here = in_turn({"warm": command.run()}, ROUNDS[quick], SECONDS[quick])["warm"]
                also = (cold(command),) if command.cold and not quick else ()
                yield Row(command.name, command.title, sides=(Side.of("warm", here), *also), bar=command.bar)
    if "first-five" in chosen or not (chosen or quick):
        yield first_cold()


@contextmanager
def checked_out(revision: str, repository: Path = REPOSITORY) -> Iterator[Path]:
    """A work tree of a revision, gone afterwards.

    Raises
    ------
    ValueError
        No such revision, or no git.
    """
    folder = Path(tempfile.mkdtemp(prefix="roslf-revision-"))
    git = ["git", "-C", str(repository), "worktree"]
    tree = folder / "tree"
    try:
        try:
            add = [*git, "add", "--quiet", "--detach", str(tree), revision]
            subprocess.run(add, check=True, capture_output=True, text=True)
        except subprocess.CalledProcessError as error:
            raise ValueError(last_line(error.stderr) or "git failed") from error
        yield tree
    finally:
        subprocess.run([*git, "remove", "--force", str(tree)], check=False, capture_output=True)
        shutil.rmtree(folder, ignore_errors=True)


def compared(revision: str, chosen: Sequence[str] = (), rounds: int = ROUNDS[False]) -> Iterator[Row]:
    """Every command here and at a revision, in turn, in the same Python with the same packages.

    Raises
    ------
    ValueError
        No such revision.
    """
    with checked_out(revision) as tree, tempfile.TemporaryDirectory(prefix="roslf-bench-") as folder:
        for command in commands(Path(folder), True):
            if command.name in chosen or not chosen:
                turns = in_turn({"now": command.run(), "then": command.run(tree)}, rounds, SECONDS[False], least=3)
                yield Row(command.name, command.title, sides=tuple(Side.of(*turn) for turn in turns.items()))
