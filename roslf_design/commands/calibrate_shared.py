"""What `roslf calibrate` and its plan share: options read, refusals, tables on a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .tables import print_table

if TYPE_CHECKING:
    from rich.console import Console

    from ..calibration import Board, DataSheet
    from ..design import Design
    from ..report.blocks import Block


def refusal(key: str, message: str, origin: str = "") -> Exception:
    """An `InputError` of one line."""
    from ..errors import InputError, Problem

    return InputError((Problem(key, " ".join(message.split())),), origin)


def read_board(text: str) -> Board:
    """A board from its option."""
    from ..calibration import Board, CalibrationError

    try:
        return Board.parse(text)
    except CalibrationError as error:
        raise refusal("--board", str(error)) from None


def read_sheet(design: Design, f_sigma: str) -> DataSheet:
    """The data sheet of a design, f as well known as --f-sigma says."""
    from ..calibration import sheet_of

    text = f_sigma.strip()
    if text.endswith("%"):
        try:
            relative = float(text[:-1]) / 100
        except ValueError:
            raise refusal("--f-sigma", f'"{f_sigma}" is not understood; give "1 mm" or "1%"') from None
    else:
        relative = read_quantity("--f-sigma", f_sigma, "length") / design.f
    return sheet_of(design, relative)


def read_quantity(option: str, text: str, dimension: str) -> float:
    """Millimetres or radians of an option with a unit."""
    from ..design.units import parse_quantity

    try:
        return parse_quantity(text, dimension)
    except ValueError as error:
        raise refusal(option, str(error)) from None


def print_blocks(blocks: tuple[Block, ...], console: Console) -> None:
    """Tables and bullets of a report, on a terminal."""
    from ..report.blocks import Bullets, Table

    for block in blocks:
        if isinstance(block, Table):
            print_table(block, console)
        elif isinstance(block, Bullets):
            console.print()
            for item in block.items:
                console.print(item, highlight=False, soft_wrap=True)
