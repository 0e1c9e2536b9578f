"""Reports as one HTML page that needs nothing else, and as PDF, set by typst: the same content, vector drawings.

Content passes into the PDF's document as JSON and files, never as markup: no text of a design is ever typst code.
"""

from __future__ import annotations

import base64
import hashlib
import io
import json
import re
import tempfile
from collections.abc import Iterable
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from ..drawing.picture import PAGE
from ..drawing.solid import library, viewer
from ..tables import csv_bytes
from ..words import spans, to_html
from .blocks import MARKS, Block, Bullets, Code, Figure, Paragraph, Report, Statements, Table, slug

if TYPE_CHECKING:
    from jinja2 import Environment

Paper = Literal["a4", "letter"]
PAGES = {"a4": "a4", "letter": "us-letter"}
"""Paper sizes by typst's names."""
DOCUMENT = Path(__file__).with_name("templates") / "report.typ"

SCRIPT = Path(__file__).with_name("templates") / "viewer.js"
POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'"
"""Content security policy of pages without scripts. Drawings and tables bring their own styles."""


def render_html(report: Report) -> str:
    """The page as text; the same report gives the same text."""
    page = _environment().get_template("report.html.j2")
    if not any(figure.scene for figure in report.figures):
        return _letters(page.render(report=report, policy=_policy(()), viewer=""))
    script = SCRIPT.read_text(encoding="utf-8")
    policy = _policy((script, *re.findall(r"<script[^>]*>(.*?)</script>", viewer(), re.DOTALL)))
    return _letters(page.render(report=report, policy=policy, viewer=library(), script=script))


def _policy(scripts: Iterable[str]) -> str:
    """Content security policy of a page: it shows what is in it, and runs these scripts of its own, nothing else."""
    hashes = (base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in scripts)
    allowed = " ".join(f"'sha256-{value}'" for value in hashes)
    return POLICY + (f"; script-src {allowed}" if allowed else "")


def _letters(text: str) -> str:
    """Text with what of a file's name is no letter spelled out."""
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


@cache
def _environment() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup

    environment = Environment(
        loader=PackageLoader("roslf_design.reporting"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["symbols"] = lambda text: Markup(to_html(text))
    environment.filters["data_uri"] = lambda png: "data:image/png;base64," + base64.b64encode(png).decode()
    environment.filters["kind"] = lambda block: type(block).__name__.lower()
    environment.tests["drawing"] = lambda content: isinstance(content, str)
    environment.globals["marks"] = MARKS
    return environment


def render_pdf(report: Report, paper: Paper = "a4") -> bytes:
    """The report as PDF bytes; the same report gives the same bytes.

    Raises
    ------
    ModuleNotFoundError
        The typst package is not installed.
    """
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        sections = [
            {"title": section.title, "blocks": [_block(block, root) for block in section.blocks]}
            for section in report.sections
        ]
        head = {"title": report.title, "subtitle": spans(report.subtitle), "footer": report.footer}
        content = {**head, "paper": PAGES[paper], "sections": sections}
        (root / "content.json").write_bytes(json.dumps(content, ensure_ascii=False).encode("utf-8", "replace"))
        return _compiled(root, DOCUMENT.read_bytes())


def render_drawing(svg: bytes, width: float, height: float) -> bytes:
    """A drawing as a PDF of one page of its size [mm], true to scale; errors as of `render_pdf`."""
    page = f'#set page(width: {width}mm, height: {height}mm, margin: 0mm)\n#image("drawing.svg", width: {width}mm)\n'
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        (root / "drawing.svg").write_bytes(svg)
        return _compiled(root, page.encode())


def _compiled(root: Path, document: bytes) -> bytes:
    """PDF of a typst document whose files lie in `root`."""
    import typst

    # Finding the fonts that come with matplotlib needs no import of it.
    matplotlib = find_spec("matplotlib")
    assert matplotlib is not None
    home = next(iter(matplotlib.submodule_search_locations or ()))
    (root / "main.typ").write_bytes(document)
    pdf: bytes = typst.compile(
        root / "main.typ",
        root=root,
        font_paths=[Path(home) / "mpl-data" / "fonts" / "ttf"],
        ignore_system_fonts=True,
        timestamp=0,
    )
    return _packed(pdf)


def page_files(report: Report) -> dict[str, bytes]:
    """The page as index.html, and its tables as CSV beside it."""
    return render_tables(report) | {"index.html": render_html(report).encode()}


def render_tables(report: Report) -> dict[str, bytes]:
    """Each table of a report as CSV, its cells as the page has them, by the name of its file."""
    files: dict[str, bytes] = {}
    for section in report.sections:
        for table in (block for block in section.blocks if isinstance(block, Table)):
            name = slug(table.title) or section.anchor
            count = sum(other == name or re.fullmatch(rf"{name}-\d+", other) is not None for other in files)
            content = csv_bytes([table.headings, *table.rows] if table.headings else table.rows)
            files[f"{name}-{count + 1}" if count else name] = content
    return {f"tables/{name}.csv": content for name, content in files.items()}


def _packed(pdf: bytes) -> bytes:
    """PDF with its tags for screen readers packed as well: nearly half as large. Unchanged where pikepdf is missing."""
    try:
        import pikepdf
    except ModuleNotFoundError:
        return pdf
    stream = io.BytesIO()
    with pikepdf.open(io.BytesIO(pdf)) as document:
        document.save(
            stream,
            object_stream_mode=pikepdf.ObjectStreamMode.generate,
            recompress_flate=True,
            deterministic_id=True,
        )
    return stream.getvalue()


def _block(block: Block, root: Path) -> dict[str, Any]:
    """One block as values that the document knows how to set; drawings as files in `root`."""
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
                    {"text": spans(c.text), "whole": c.whole, "rest": spans(c.rest), "decimal": c.align == "d"}
                    for c in row
                ]
                for row in block.cells()
            ]
            look: dict[str, Any] = {
                "align": list(block.align),
                "faint": block.faint,
                "widths": block.widths,
                "dense": block.dense,
                "rows": rows,
            }
            words = {"title": spans(block.title), "caption": spans(block.caption)}
            return {"kind": "table", **look, **words, "headings": [spans(heading) for heading in block.headings]}
        case Figure():
            file = root / f"{block.name}.{'svg' if isinstance(block.content, str) else 'png'}"
            file.write_bytes(block.content.encode() if isinstance(block.content, str) else block.content)
            look = {"file": file.name, "width": _share_of_page(block.content), "alt": block.description or block.title}
            look["breaks"] = block.breaks
            return {"kind": "figure", **look, "title": spans(block.title), "caption": spans(block.caption)}
        case Bullets():
            return {"kind": "bullets", "items": [spans(item) for item in block.items]}
        case Code():
            return {"kind": "code", "title": spans(block.title), "text": block.text}


def _share_of_page(content: str | bytes) -> float:
    """Share of the text's width that a drawing takes.

    Drawings narrower than the page stay so, and letters as large as in all others.
    """
    width = re.search(r'width="([\d.]+)(pt|)"', content[:400]) if isinstance(content, str) else None
    pixels = {"pt": 96 / 72, "": 1.0}
    return 1.0 if width is None else min(1.0, float(width[1]) * pixels[width[2]] / PAGE)
