"""What a page of the documentation tells its reader to do, and whether it comes out as the page says."""

import contextlib
import doctest
import io
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

import roslf_design.optimization.solve  # noqa: F401
from roslf_design.cli import build_app, main
from studies.accuracy import promises
from tests.reporting.made import few_builds

FENCE = re.compile(r"^(?P<ticks>`{3,})(?P<info>.*?)\n(?P<text>.*?)^(?P=ticks)\s*$", re.MULTILINE | re.DOTALL)
RUN = ("console", "pycon", "toml", "sh", "python")


class Block(NamedTuple):
    """A fenced block."""

    language: str
    text: str
    line: int
    caption: str
    """Name of the file that the reader is to write."""
    code: int
    """Exit code that the page promises."""


def blocks(page: Path) -> list[Block]:
    """Every block of a page in a language that is run or written."""
    text = page.read_text(encoding="utf-8")
    return [block_of(match, text) for match in FENCE.finditer(text) if language_of(match["info"]) in RUN]


def language_of(info: str) -> str:
    return info.strip().removeprefix("{code-block}").strip()


def block_of(match: re.Match[str], text: str) -> Block:
    options = {}
    body = match["text"]
    while found := re.match(r":(\w+): *(.*)\n", body):
        options[found[1]] = found[2]
        body = body[found.end() :]
    code = re.search(r"exit-(\d)", options.get("class", ""))
    line = text.count("\n", 0, match.start()) + 1
    return Block(
        language_of(match["info"]), body.lstrip("\n"), line, options.get("caption", ""), int(code[1]) if code else 0
    )


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
    return done


def steps(text: str) -> list[tuple[str, str]]:
    """Commands of a console block, each with what the page says it prints."""
    parts = re.split(r"^\$ ", text, flags=re.MULTILINE)
    assert not parts[0].strip(), "a console block starts with a command"
    pairs = []
    for part in parts[1:]:
        command, _, expected = part.replace("\\\n", " ").partition("\n")
        pairs.append((command.partition("  #")[0].strip(), expected))
    return pairs


def run(command: str, folder: Path) -> tuple[int, str]:
    """Exit code and output (stdout and stderr) of one command; `roslf` runs in this process."""
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
    found = subprocess.run([sys.executable, *words[1:]], cwd=folder, capture_output=True, text=True, timeout=120)
    return found.returncode, found.stdout + found.stderr


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

    What pages show is neither yields nor what the check said nor times.
    """
    few_builds(monkeypatch)
    solve = sys.modules["roslf_design.optimization.solve"]  # whose function has its package's name for it
    globally = solve.globally
    monkeypatch.setattr(solve, "globally", lambda *args: globally(*args[:4], args[4] // 20, *args[5:]))
    monkeypatch.setattr(promises, "SLOWEST", 0.01)
