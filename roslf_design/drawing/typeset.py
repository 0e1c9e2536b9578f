"""Pages and pictures typeset by typst, in the fonts that come with matplotlib: alike on every machine."""

from __future__ import annotations

import tempfile
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

from .marks import Point

POINTS = 0.75
"""Points a pixel."""


def typeset(root: Path, form: Literal["pdf", "png"] = "pdf", **more: Any) -> bytes:
    """The document ``main.typ`` of a folder, with what lies beside it; the same folder gives the same bytes.

    Raises
    ------
    ModuleNotFoundError
        The typst package is not installed.
    """
    import typst

    # Finding the fonts needs no import of matplotlib.
    matplotlib = find_spec("matplotlib")
    assert matplotlib is not None
    home = Path(next(iter(matplotlib.submodule_search_locations or ())))
    made: bytes = typst.compile(
        root / "main.typ",
        root=root,
        format=form,
        font_paths=[home / "mpl-data" / "fonts" / "ttf"],
        ignore_system_fonts=True,
        **more,
    )
    return made


def png_of(svg: bytes, size: Point, dpi: float) -> bytes:
    """A picture's SVG file, so many pixels wide and high, as PNG; 96 dots an inch are a dot a pixel."""
    width, height = (f"{POINTS * side}pt" for side in size)
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        (root / "picture.svg").write_bytes(svg)
        page = f"#set page(width: {width}, height: {height}, margin: 0pt)\n"
        (root / "main.typ").write_text(f'{page}#image("picture.svg", width: {width}, height: {height})')
        return typeset(root, "png", ppi=float(dpi))
