"""What a report is made of: plain frozen data that HTML (and any later format) is written from.

Any package can add a section: it returns a `Section` of these blocks and needs to know nothing of pages. In all text,
symbols written as ``d_3`` or ``D_F`` are set with a subscript.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Tone = Literal["good", "bad", "caution", "plain"]
"""How a statement is meant; always shown by a sign and a word as well as by colour."""


@dataclass(frozen=True)
class Paragraph:
    """Running text."""

    text: str


@dataclass(frozen=True)
class Statement:
    """One answer an engineer came for."""

    tone: Tone
    text: str
    """The answer with its margin."""
    remedy: str = ""
    """What would mend it; empty where nothing needs mending."""


@dataclass(frozen=True)
class Statements:
    """Answers, one below the other."""

    items: tuple[Statement, ...]


@dataclass(frozen=True)
class Table:
    """Rows of text.

    Raises
    ------
    ValueError
        A row or `widths` not as long as `align`.
    """

    rows: tuple[tuple[str, ...], ...]
    align: str
    """One letter a column: l left, r right, d on the decimal point."""
    headings: tuple[str, ...] = ()
    title: str = ""
    caption: str = ""
    faint: tuple[int, ...] = ()
    """Rows that matter less."""
    widths: tuple[float, ...] = ()
    """Of the columns, in heights of a letter (em); 0 takes what its text needs. Aligns tables below each other."""

    def __post_init__(self) -> None:
        wrong = [row for row in (*self.rows, *filter(None, [self.headings])) if len(row) != len(self.align)]
        if wrong:
            raise ValueError(f"table {self.title!r}: {len(self.align)} columns are aligned, but a row has {wrong[0]}")
        if self.widths and len(self.widths) != len(self.align):
            raise ValueError(f"table {self.title!r}: {len(self.align)} columns have {len(self.widths)} widths")


@dataclass(frozen=True)
class Figure:
    """A vector drawing, or a picture."""

    name: str
    """Short and unique on the page; the anchor is ``figure-`` and this."""
    title: str
    caption: str
    """What to see, and what follows for the design."""
    content: str | bytes
    """SVG text, or the bytes of a PNG."""
    description: str = ""
    """For those who cannot see it."""
    scene: str = ""
    """JSON of `viewer.scene_data`: the same scene, to be turned on a page that can do it; empty for none."""


@dataclass(frozen=True)
class Bullets:
    """A list."""

    items: tuple[str, ...]


@dataclass(frozen=True)
class Code:
    """Text to be copied as it is."""

    text: str
    title: str = ""


Block = Paragraph | Statements | Table | Figure | Bullets | Code


@dataclass(frozen=True)
class Section:
    """A part of a report with its own heading."""

    title: str
    blocks: tuple[Block, ...]
    name: str = ""
    """Anchor; empty takes it from the title."""

    @property
    def anchor(self) -> str:
        """Where links to this section lead."""
        return self.name or "-".join("".join(c if c.isalnum() else " " for c in self.title.lower()).split())


@dataclass(frozen=True)
class Report:
    """A whole report, before it is written in any format."""

    title: str
    subtitle: str
    sections: tuple[Section, ...]
    footer: str = ""

    @property
    def figures(self) -> tuple[Figure, ...]:
        """All figures, in their order."""
        return tuple(b for section in self.sections for b in section.blocks if isinstance(b, Figure))

    def with_sections(self, *more: Section) -> Report:
        """The same report with sections added before its last one, which tells how it was made."""
        return Report(self.title, self.subtitle, (*self.sections[:-1], *more, *self.sections[-1:]), self.footer)
