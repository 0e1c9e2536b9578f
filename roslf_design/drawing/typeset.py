"""Pages and pictures typeset by typst, in the fonts that come with matplotlib: alike on every machine."""

from __future__ import annotations

import tempfile
import zlib
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    import typst

    from .marks import Point

POINTS = 0.75
"""Points a pixel."""
_SAID = b"tEXtSoftware\0roslf_design"
PNG_MARK = (len(_SAID) - 4).to_bytes(4) + _SAID + zlib.crc32(_SAID).to_bytes(4)
"""Chunk of a PNG that says what made it."""


def typesetter(root: Path, document: bytes) -> typst.Compiler:
    """Compiler of a typst document whose files lie in `root`.

    Raises
    ------
    ModuleNotFoundError
        The typst package is not installed.
    """
    import typst

    (root / "main.typ").write_bytes(document)
    return typst.Compiler(root / "main.typ", root=root, font_paths=_fonts())


@cache
def _fonts() -> typst.Fonts:
    """Fonts of all pictures and pages: looking for them takes as long as a picture."""
    import typst

    # Finding them needs no import of matplotlib.
    matplotlib = find_spec("matplotlib")
    assert matplotlib is not None
    home = Path(next(iter(matplotlib.submodule_search_locations or ())))
    return typst.Fonts(include_system_fonts=False, font_paths=[home / "mpl-data" / "fonts" / "ttf"])


def typeset(compiler: typst.Compiler, form: Literal["pdf", "png"] = "pdf", **more: Any) -> bytes:
    """A compiler's document as its files are now; the same files give the same bytes."""
    made = compiler.compile(format=form, **more)
    assert isinstance(made, bytes)
    return made


def page_of(svg: bytes, width: str, height: str, form: Literal["pdf", "png"] = "pdf", **more: Any) -> bytes:
    """A drawing's SVG file as a page of that size, with its unit; `more` as of `typeset`, errors as of `typesetter`."""
    page = f'#set page(width: {width}, height: {height}, margin: 0pt)\n#image("drawing.svg", width: {width})\n'
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        (root / "drawing.svg").write_bytes(svg)
        return typeset(typesetter(root, page.encode()), form, **more)


def png_of(svg: bytes, size: Point, dpi: float) -> bytes:
    """A picture's SVG file, so many pixels wide and high, as PNG; 96 dots an inch are a dot a pixel."""
    width, height = (f"{POINTS * side}pt" for side in size)
    drawn = page_of(svg, width, height, "png", ppi=float(dpi))
    return drawn[:33] + PNG_MARK + drawn[33:]  # behind the first
