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
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ..drawing.picture import PAGE
from ..drawing.solid import library, viewer
from ..drawing.theme import THEMES
from ..drawing.typeset import page_of, typeset, typesetter
from ..errors import expect
from ..tables import csv_bytes
from ..words import spans, to_html
from .blocks import MARKS, Block, Bullets, Code, Figure, Paragraph, Report, Statements, Table, slug

if TYPE_CHECKING:
    from jinja2 import Environment

Paper = Literal["a4", "letter"]
PAGES = {"a4": "a4", "letter": "us-letter"}
"""Paper sizes by typst's names."""
LEAST_END = 1 / 3
"""Share of the last page from which it is no nearly empty one."""
LEAST_SHARE, CLEARANCE, MOST_TRIED, MOST_ABOVE = 0.72, 28.0, 16, 24.0
"""Share of its size down to which a figure is drawn so that a page is filled; room above it [pt]; figures tried;
room more above a block so that the foot of its page is not left empty [pt]."""
ENDS = ("flow", "float")
"""Kinds of spots at which blocks end."""
DOCUMENT = Path(__file__).with_name("templates") / "report.typ"

SCRIPT = Path(__file__).with_name("templates") / "viewer.js"
POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'"
"""Content security policy of pages without scripts. Drawings and tables bring their own styles."""


def render_html(report: Report) -> str:
    """The page as text; the same report gives the same text."""
    expect(report, "report", Report, "a Report, as `roslf_design.report` makes it")
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
    environment.tests["themed"] = _themed
    environment.globals |= {"marks": MARKS, **THEMES}
    return environment


def _themed(svg: str) -> bool:
    """Whether a drawing has the theme's colours alone, which another theme has, too; pictures have their own."""
    return "<image" not in svg and {*re.findall('="(#[^"]*)"', svg)} <= {*THEMES["light"]}


def render_pdf(report: Report, paper: Paper = "a4") -> bytes:
    """The report as PDF bytes; the same report gives the same bytes.

    Raises
    ------
    ModuleNotFoundError
        The typst package is not installed.
    """
    expect(report, "report", Report, "a Report, as `roslf_design.report` makes it")
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        sections = [
            {"title": one.title, "blocks": [_block(block, root) for block in one.blocks]} for one in report.sections
        ]
        head = {"title": report.title, "subtitle": spans(report.subtitle), "footer": report.footer}
        content = {**head, "paper": PAGES[paper], "sections": sections}
        (root / "content.json").write_bytes(json.dumps(content, ensure_ascii=False).encode("utf-8", "replace"))
        pages = typesetter(root, DOCUMENT.read_bytes())  # its fonts are looked for once; `root` has it read files anew

        fitting: set[str] = set()
        late: set[str] = set()
        shares: dict[str, float] = {}
        tight = len(sections)
        known: dict[str, list[dict[str, Any]]] = {}

        def laid_out(shares: Mapping[str, float], *places: Mapping[str, float]) -> str:
            choice = json.dumps([tight, shares, sorted(fitting), sorted(late), *(places or ({}, {}))])
            (root / "figures.json").write_text(choice, encoding="utf-8")
            return choice

        def spots(shares: Mapping[str, float]) -> list[dict[str, Any]]:
            choice = laid_out(shares)
            if choice not in known:
                known[choice] = json.loads(pages.query("<spots>", field="value", one=True, root=root))
            return known[choice]

        for _ in range(2):  # figures that are smaller let others fit, and others no more
            while more := _fitting(spots(shares)) - fitting:
                fitting |= more
            shares = _filling(spots, shares)
            fitting &= _fitting(spots(shares))
            while more := _above(spots(shares)) - late:
                late |= more
        usual = spots(shares)
        tight = _tight(usual, len(sections))
        if max(at["page"] for at in spots(shares)) == max(at["page"] for at in usual):
            tight = len(sections)
        laid_out(shares, _rooms_above(spots(shares)), _parted(spots(shares)))
        return _packed(typeset(pages, timestamp=0, root=root))


def render_drawing(svg: bytes, width: float, height: float) -> bytes:
    """A drawing as a PDF of one page of its size [mm], true to scale; errors as of `render_pdf`."""
    return _packed(page_of(svg, f"{width}mm", f"{height}mm", timestamp=0))


def _fitting(placed: Iterable[Mapping[str, Any]]) -> set[str]:
    """Names of figures that stand on the page where they are told of."""
    # What is invisible goes to the next page with what follows it.
    told = {at["name"]: at["page"] - (at["y"] <= 0) for at in placed if at["kind"] == "place"}
    return {at["name"] for at in placed if at["image"] and told.get(at["name"]) == at["page"]}


def _above(placed: Iterable[Mapping[str, Any]]) -> set[str]:
    """Names of figures that stand at the head of a page before the place where they are told of."""
    told = {at["name"]: at["page"] for at in placed if at["kind"] == "place"}
    return {at["name"] for at in placed if at["kind"] == "float" and at["image"] and at["page"] <= told[at["name"]]}


def _filling(
    spots: Callable[[Mapping[str, float]], list[dict[str, Any]]], shares: dict[str, float]
) -> dict[str, float]:
    """Shares of their size, by name, at which figures leave those behind room on their page, from `shares` on.

    `spots` tells where each figure and block begins and ends, of the document whose figures have such shares.
    """
    tried: set[str] = set()
    placed = spots(shares)
    while len(tried) < MOST_TRIED and (wanted := _behind_a_gap(placed, shares, tried)) is not None:
        figure, smaller = wanted
        tried.add(figure)
        other = spots(shares | smaller)
        before, after = ({at["name"]: at["page"] for at in each if at["image"]} for each in (placed, other))
        if after[figure] < before[figure]:
            shares, placed = shares | smaller, other
    return shares


def _behind_a_gap(
    placed: Sequence[Mapping[str, Any]], shares: Mapping[str, float], tried: Container[str]
) -> tuple[str, dict[str, float]] | None:
    """First figure that begins a page, behind those of the page before, and shares at which all stand there."""
    for end in sorted((at for at in placed if at["image"]), key=lambda at: (at["page"], at["y"])):
        above = [at for at in placed if at["kind"] in ENDS and at["page"] == end["page"] and 0 < at["y"] < end["y"]]
        first = all(at["name"] == end["name"] for at in above)
        before = [at for at in placed if at["page"] == end["page"] - 1]
        if end["name"] in tried or not first or not before:
            continue
        filled = max((at["y"] for at in before if at["kind"] == "flow"), default=end["foot"])
        foot = min([end["foot"], *(at["y"] for at in before if at["kind"] == "begin" and at["y"] > filled)])
        missing = end["y"] + CLEARANCE - (foot - filled)
        figures = [(at["drawn"], at["name"], shares.get(at["name"], 1.0)) for at in (*before, end) if at["drawn"]]
        for share in np.linspace(1.0, LEAST_SHARE, 51):  # those that are small already lessen no further
            smaller = {name: max(own * float(share), LEAST_SHARE) for _, name, own in figures}
            if sum(drawn * (1 - smaller[name] / own) for drawn, name, own in figures) >= missing:
                return end["name"], smaller
    return None


def _rooms_above(placed: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Room more above blocks [pt], by key, where else the foot of a page would be left empty; none on the last page."""
    rooms: dict[str, float] = {}
    begun = {at["name"]: at["page"] for at in reversed(placed) if at["kind"] in ("top", "line", "part")}
    ends = {at["name"]: at for at in placed if at["kind"] in ENDS}
    for page in range(1, max(at["page"] for at in placed)):
        tops = [at["name"] for at in placed if at["kind"] == "top" and at["page"] == page and at["y"] > 0]
        here = [at for at in ends.values() if at["page"] == page]
        over = any(begun.get(name, page + 1) <= page < at["page"] for name, at in ends.items())
        if here and tops and not over:
            gap = min(at["foot"] - at["y"] for at in here) - 2
            rooms |= {name: min(gap / len(tops), MOST_ABOVE) for name in tops if gap > 0}
    return rooms


def _tight(placed: Sequence[Mapping[str, Any]], count: int) -> int:
    """Number of the first of `count` sections that may do with less room, so that the last page, nearly empty, goes."""
    last = max(at["page"] for at in placed)
    if max(at["y"] / at["foot"] for at in placed if at["page"] == last) > LEAST_END:
        return count
    begun = (int(at["name"]) for at in placed if at["kind"] == "top" and at["name"].isdigit() and at["page"] > last - 4)
    return min(begun, default=count)


def _parted(placed: Iterable[Mapping[str, Any]]) -> dict[str, int]:
    """First pages of tables that go over pages, by key."""
    parts: dict[str, list[int]] = {}
    for at in placed:
        if at["kind"] == "part":
            parts.setdefault(at["name"], []).append(at["page"])
    return {name: pages[0] for name, pages in parts.items() if pages[-1] > pages[0]}


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
            content = csv_bytes([*filter(None, [table.headings]), *table.rows, *table.left])
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
        document.save(stream, object_stream_mode=pikepdf.ObjectStreamMode.generate, deterministic_id=True)
    return stream.getvalue()


def _block(block: Block, root: Path) -> dict[str, Any]:
    """One block as values that the document knows how to set; drawings as files in `root`."""
    match block:
        case Paragraph():
            return {"kind": "paragraph", "text": spans(block.text)}
        case Statements():
            items = [
                {
                    "tone": item.tone,
                    "mark": MARKS[item.tone][0],
                    "lead": spans(item.text[: item.lead]),
                    "text": spans(item.rest),
                    "remedy": spans(item.remedy),
                }
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
            look |= {"breaks": block.breaks, "name": block.name, "fixed": block.fixed}
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
