"""What a page of the documentation tells its reader to do, and whether it comes out as the page says."""

import contextlib
import doctest
import io
import runpy
import shlex
import shutil
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "docs/_ext"))
from page_blocks import Block, blocks, pictures, steps

import roslf_design.optimization.solve  # noqa: F401
from roslf_design.cli import build_app, main
from studies.accuracy import promises
from tests.reporting.made import few_builds


def follow(page: Path, folder: Path) -> int:
    """Do in `folder`, the working folder, what a page says; returns how many things that were.

    Raises
    ------
    AssertionError
        Something came out otherwise than the page says.
    """
    names: dict[str, object] = {}
    done = 0
    for block in blocks(page):
        place = f"{page.name}:{block.line}"
        if block.caption:
            (folder / block.caption).parent.mkdir(parents=True, exist_ok=True)
            (folder / block.caption).write_text(block.text, encoding="utf-8")
        elif block.language == "console":
            for command, expected in steps(block.text):
                code, output = run(command, folder)
                assert code == block.code, f"{place}: `{command}` ends with {code}:\n{output}"
                assert matches(expected, output), f"{place}: `{command}` prints otherwise:\n{output}"
                done += 1
        elif block.language == "pycon":
            done += check_session(block, place, names)
        else:
            assert block.language == "toml", f"{place}: {block.language} is shown but not run; use console or pycon"
    for picture in pictures(page):
        place = f"{page.name}:{picture.line}"
        if picture.file:
            assert (folder / picture.file).is_file(), f"{place}: no command above writes {picture.file}"
        else:
            compile(picture.code, place, "exec")
    return done


def run(command: str, folder: Path) -> tuple[int, str]:
    """Exit code and output (stdout and stderr) of one command; `roslf` and scripts run in this process."""
    words = shlex.split(command)
    if words[:2] == ["roslf", "explore"]:  # serves until it is stopped: read, not run
        build_app().parse_args(words[1:], exit_on_error=False, print_error=False)
        return 0, ""
    if words[0] == "roslf":
        stream = io.StringIO()
        with contextlib.redirect_stdout(stream), contextlib.redirect_stderr(stream):
            code = main(words[1:])
        return code, stream.getvalue()
    if words[0] == "cp":
        shutil.copy(folder / words[1], folder / words[2])
        return 0, ""
    if words[0] == "ls":
        return 0, "\n".join(sorted(path.name for path in (folder / words[1]).iterdir()))
    assert words[0] == "python", f"no test knows how to run `{words[0]}`"
    (script,) = words[1:]
    stream = io.StringIO()
    with contextlib.redirect_stdout(stream), contextlib.redirect_stderr(stream):
        runpy.run_path(str(folder / script), run_name="__main__")
    return 0, stream.getvalue()


def matches(expected: str, output: str) -> bool:
    """Whether output is what a page shows; spaces and line ends count as one space, `...` is anything."""
    if not expected.strip():
        return True
    text = " ".join(output.split())
    first, *rest = (" ".join(part.split()) for part in expected.split("..."))
    if not text.startswith(first) or (not rest and text != first):
        return False
    at = len(first)
    for number, part in enumerate(rest, 1):
        found = max(text.rfind(part), at) if number == len(rest) else text.find(part, at)
        if not text.startswith(part, found) or found < at:
            return False
        at = found + len(part)
    return not rest or at == len(text)


def check_session(block: Block, place: str, names: dict[str, object]) -> int:
    """Run a Python session; one dictionary of names a page."""
    test = doctest.DocTestParser().get_doctest(block.text, names, place, place, block.line)
    report = io.StringIO()
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE, verbose=False)
    runner.run(test, out=report.write, clear_globs=False)
    names.update(test.globs)
    assert runner.failures == 0, report.getvalue()
    return len(test.examples)


def thin_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Reports look at few builds, and optima are checked by a short search; methods are measured where they are quick.

    What pages show is neither yields nor what the check said nor times, nor how far a log says that a busy machine is.
    """
    few_builds(monkeypatch)
    solve = sys.modules["roslf_design.optimization.solve"]  # whose function has its package's name for it
    globally = solve.globally
    monkeypatch.setattr(solve, "globally", lambda *args: globally(*args[:4], args[4] // 20, *args[5:]))
    monkeypatch.setattr(promises, "SLOWEST", 0.01)
    monkeypatch.setattr(promises, "SEEDS", 1)
    timed = promises.timed
    monkeypatch.setattr(promises, "timed", lambda *args: timed(*args[:3], 1))
