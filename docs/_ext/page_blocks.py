"""Fenced blocks of a page: what its reader writes, types and runs."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

FENCE = re.compile(r"^(?P<ticks>`{3,})(?P<info>.*?)\n(?P<text>.*?)^(?P=ticks)\s*$", re.MULTILINE | re.DOTALL)
RUN = ("console", "pycon", "toml", "sh", "python")
DRAWN = ("{picture}", "{drawn}")


class Block(NamedTuple):
    """A fenced block."""

    language: str
    text: str
    line: int
    caption: str
    """Name of the file that the reader is to write."""
    code: int
    """Exit code that the page promises."""


class Picture(NamedTuple):
    """A block that shows a picture: a file that commands above it write, or what code draws."""

    file: str
    """Empty where code draws it."""
    code: str
    line: int


def blocks(page: Path) -> list[Block]:
    """Every block of a page in a language that is run or written."""
    text = page.read_text(encoding="utf-8")
    return [_block(match, text) for match in FENCE.finditer(text) if _language(match["info"]) in RUN]


def pictures(page: Path) -> list[Picture]:
    """Every picture that a page shows and that is made when the page is."""
    text, found = page.read_text(encoding="utf-8"), []
    for match in FENCE.finditer(text):
        kind, _, file = match["info"].strip().partition(" ")
        if kind in DRAWN:
            body = re.sub(r"\A(:\w+:.*\n)*\n*", "", match["text"])
            line = text.count("\n", 0, match.start()) + 1
            found.append(Picture(file, "", line) if kind == "{picture}" else Picture("", body, line))
    return found


def steps(text: str) -> list[tuple[str, str]]:
    """Commands of a console block, each with what the page says it prints."""
    parts = re.split(r"^\$ ", text, flags=re.MULTILINE)
    assert not parts[0].strip(), "a console block starts with a command"
    pairs = []
    for part in parts[1:]:
        command, _, expected = part.replace("\\\n", " ").partition("\n")
        pairs.append((command.partition("  #")[0].strip(), expected))
    return pairs


def _language(info: str) -> str:
    return info.strip().removeprefix("{code-block}").strip()


def _block(match: re.Match[str], text: str) -> Block:
    options = {}
    body = match["text"]
    while found := re.match(r":(\w+): *(.*)\n", body):
        options[found[1]] = found[2]
        body = body[found.end() :]
    code = re.search(r"exit-(\d)", options.get("class", ""))
    line = text.count("\n", 0, match.start()) + 1
    return Block(
        _language(match["info"]), body.lstrip("\n"), line, options.get("caption", ""), int(code[1]) if code else 0
    )
