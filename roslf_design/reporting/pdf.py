"""A report as PDF, set by typst: the same content as the page, vector drawings, fonts that come along.

Content passes into the document as JSON and files, never as markup, so that no text of a design is ever typst code.
"""

from __future__ import annotations

import json
import re
import tempfile
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

from ..pictures.picture import PAGE
from ..words import spans
from .blocks import MARKS, Block, Bullets, Code, Figure, Paragraph, Report, Statements, Table

Paper = Literal["a4", "letter"]
PAGES = {"a4": "a4", "letter": "us-letter"}
"""What typst calls them."""
DOCUMENT = Path(__file__).with_name("templates") / "report.typ"


def render_pdf(report: Report, paper: Paper = "a4") -> bytes:
    """The report as PDF bytes; the same report gives the same bytes.

    Raises
    ------
    ModuleNotFoundError
        The typst package is not installed.
    """
    import typst

    # Finding the fonts that come with matplotlib needs no import of it.
    library = find_spec("matplotlib")
    assert library is not None
    home = next(iter(library.submodule_search_locations or ()))

    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        content = {
            "title": report.title,
            "subtitle": spans(report.subtitle),
            "footer": report.footer,
            "paper": PAGES[paper],
            "sections": [
                {"title": section.title, "blocks": [_block(block, root) for block in section.blocks]}
                for section in report.sections
            ],
        }
        (root / "content.json").write_text(json.dumps(content))
        (root / "main.typ").write_text(DOCUMENT.read_text())
        pdf: bytes = typst.compile(
            root / "main.typ",
            root=root,
            font_paths=[Path(home) / "mpl-data" / "fonts" / "ttf"],
            ignore_system_fonts=True,
            timestamp=0,
        )
    return pdf


def _block(block: Block, root: Path) -> dict[str, Any]:
    """One block as values that the document knows how to set."""
    match block:
        case Paragraph():
            return {"kind": "paragraph", "text": spans(block.text)}
        case Statements():
            items = [
                {"tone": item.tone, "mark": MARKS[item.tone][0], "text": spans(item.text), "remedy": spans(item.remedy)}
                for item in block.items
            ]
            return {"kind": "statements", "items": items}
        case Table():
            rows = [
                [
                    {
                        "text": spans(cell.text),
                        "whole": cell.whole,
                        "rest": spans(cell.rest),
                        "decimal": cell.align == "d",
                    }
                    for cell in row
                ]
                for row in block.cells()
            ]
            return {
                "kind": "table",
                "title": spans(block.title),
                "caption": spans(block.caption),
                "align": list(block.align),
                "headings": [spans(heading) for heading in block.headings],
                "rows": rows,
                "faint": block.faint,
                "widths": block.widths,
            }
        case Figure():
            file = root / f"{block.name}.{'svg' if isinstance(block.content, str) else 'png'}"
            file.write_bytes(block.content.encode() if isinstance(block.content, str) else block.content)
            return {
                "kind": "figure",
                "title": spans(block.title),
                "caption": spans(block.caption),
                "file": file.name,
                "width": _share_of_page(block.content),
                "alt": block.description or block.title,
            }
        case Bullets():
            return {"kind": "bullets", "items": [spans(item) for item in block.items]}
        case Code():
            return {"kind": "code", "title": spans(block.title), "text": block.text}


def _share_of_page(content: str | bytes) -> float:
    """Of the text's width: drawings narrower than the page stay so, and letters as large as in all others."""
    width = re.search(r'width="([\d.]+)(pt|)"', content[:400]) if isinstance(content, str) else None
    pixels = {"pt": 96 / 72, "": 1.0}
    return 1.0 if width is None else min(1.0, float(width[1]) * pixels[width[2]] / PAGE)
