"""Results of commands that make reports: their blocks on the terminal, their pictures as files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from ..drawing.svg import file_of
from ..reporting.blocks import MARKS, Block, Bullets, Paragraph, Statements, Table
from ..tables import plain_text, print_table

if TYPE_CHECKING:
    from rich.console import Console

    from ..drawing.picture import Picture

COLOURS = {"good": "green", "bad": "red", "caution": "yellow", "plain": "dim"}


def print_blocks(blocks: Iterable[Block], console: Console) -> None:
    """Printing of a report's blocks on a terminal: all but figures and code."""
    for block in blocks:
        match block:
            case Paragraph():
                console.print(plain_text(block.text), soft_wrap=True)
            case Statements():
                for item in block.items:
                    mark = plain_text(f"{MARKS[item.tone][0]} ", COLOURS[item.tone])
                    console.print(mark + plain_text(f"{item.text} {item.remedy}".strip()), soft_wrap=True)
            case Table():
                print_table(block, console)
            case Bullets():
                console.print()
                for line in block.items:
                    console.print(plain_text(line), soft_wrap=True)


def print_titled(title: str, blocks: Iterable[Block]) -> None:
    """A heading and what follows it, on stdout."""
    from rich.console import Console

    console = Console()
    console.print(plain_text(title, "bold"))
    print_blocks(blocks, console)


def picture_files(pictures: Mapping[str, Picture], drawings: Mapping[str, str] | None = None) -> dict[str, bytes]:
    """Pictures as .svg and .png by their names; `drawings` is their SVG text where that is at hand."""
    files = {}
    for name, picture in pictures.items():
        files[f"{name}.svg"] = picture.svg_file() if drawings is None else file_of(drawings[name])
        files[f"{name}.png"] = picture.to_png()
    return files
