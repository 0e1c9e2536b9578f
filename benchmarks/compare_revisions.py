"""Two revisions in turn: `python -m benchmarks.compare_revisions REV [--only NAME]`.

The fast set of comparisons runs on the working tree and on a revision checked out beside it, alternately, in the same
Python with the same packages. Ratios above 1: the revision took longer, the working tree is faster.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from .harness.comparison import Case, CaseResult, compare
from .harness.peers import REPOSITORY
from .harness.words import interval
from .run import chosen

SECONDS = 4.0
"""Of rounds for each case."""


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
    try:
        subprocess.run(
            [*git, "add", "--quiet", "--detach", str(folder / "tree"), revision],
            check=True,
            capture_output=True,
            text=True,
        )
        yield folder / "tree"
    except subprocess.CalledProcessError as error:
        raise ValueError((error.stderr.strip().splitlines() or ["git failed"])[-1]) from error
    finally:
        subprocess.run([*git, "remove", "--force", str(folder / "tree")], check=False, capture_output=True)
        shutil.rmtree(folder, ignore_errors=True)


def two_sided(case: Case, tree: Path) -> list[Case]:
    """Each side of ours, against itself at the revision; results must agree as they must with peers."""
    found = []
    for side in case.sides:
        if side.program != "here" or side.work.endswith("_numpy"):
            continue
        now = replace(side, label="now", python_path=REPOSITORY)
        then = replace(side, label="then", python_path=tree)
        title = case.title if side.label == "here" else f"{case.title} ({side.label})"
        found.append(replace(case, title=title, sides=(now, then), goals=()))
    return found


def cases(only: Sequence[str], tree: Path) -> list[Case]:
    """What is compared: the fast set, import times left out."""
    return [two for case in chosen(True, only, None) if case.name != "import" for two in two_sided(case, tree)]


def line(found: CaseResult) -> str:
    """One case for the terminal."""
    now, then = found.sides
    if then.ratio is None:
        bad = next((side for side in (now, then) if side.state != "timed"), then)
        return f"{found.case.title:72s} no ratio: {bad.label} {bad.state}: {bad.reason}"
    ratio = {"value": then.ratio.value, "low": then.ratio.low, "high": then.ratio.high}
    word = "faster" if then.ratio.low > 1 else "SLOWER" if then.ratio.high < 1 else "as fast, as far as can be told"
    return f"{found.case.title:72s} then/now {interval(ratio):>22s}  {word}"


def main(arguments: list[str] | None = None) -> int:
    """Compare and print; 0 whatever is found: a guard for eyes, not for scripts."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.compare_revisions", description=__doc__)
    parser.add_argument("revision", help="commit, tag or branch to compare the working tree with")
    parser.add_argument("--only", action="append", default=[], metavar="NAME", help="cases with this name")
    parser.add_argument("--seconds", type=float, default=SECONDS, help="of rounds for each case")
    asked = parser.parse_args(arguments)
    results = []
    try:
        with checked_out(asked.revision) as tree:
            for case in cases(asked.only, tree):
                results.append(compare(case, {}, {}, asked.seconds))
                print(line(results[-1]), flush=True)
    except ValueError as error:
        print(f"{asked.revision}: {error}", file=sys.stderr)
        return 2
    print(f"{len(results)} cases; above 1 the working tree is faster than {asked.revision}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
