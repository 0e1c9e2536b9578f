"""Blocks of a report: plain frozen data that HTML (and any later format) is written from.

In all text, symbols written as ``d_3`` or ``D_F`` are set with a subscript.
"""

from __future__ import annotations

import base64
import re
import unicodedata
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Literal, NamedTuple

from ..tables import BriefValue
from ..tables import Table as Table
from ..words import to_html

if TYPE_CHECKING:
    from ..drawing.picture import Picture
    from ..theory.length_covariance import CalibratedLengths

_GREEK = re.compile(r"GREEK SMALL LETTER (?:FINAL )?(\w+)")
Tone = Literal["good", "bad", "caution", "plain"]
"""How a statement is meant; always shown by a sign and a word as well as by colour."""
MARKS: dict[Tone, tuple[str, str]] = {
    "good": ("✓", "yes"),
    "bad": ("✗", "no"),
    "caution": ("!", "mind"),
    "plain": ("·", "note"),
}
"""Sign and word of each tone."""


@dataclass(frozen=True)
class Paragraph:
    """Running text."""

    text: str


@dataclass(frozen=True)
class Statement:
    """Statement that an engineer came for."""

    tone: Tone
    text: str
    """The answer with its margin."""
    remedy: str = ""
    """Remedy in a sentence; empty where nothing needs mending."""
    lead: int = 0
    """Letters of the text that are set large: the number that it is about."""

    @property
    def rest(self) -> str:
        """Text behind these."""
        return self.text[self.lead :].lstrip(". ") if self.lead else self.text


@dataclass(frozen=True)
class Statements:
    """Answers, one below the other."""

    items: tuple[Statement, ...]


HALF = 545.0
"""Width of a picture up to which two stand side by side on a wide page [px]."""


@dataclass(frozen=True)
class Figure:
    """A vector drawing, or a picture."""

    name: str
    """Short and unique on the page; the anchor is ``figure-`` and this."""
    title: str
    caption: str
    """Caption: what to see, and what follows for the design."""
    content: str | bytes
    """SVG text, or the bytes of a PNG."""
    description: str = ""
    """Description for those who cannot see it."""
    scene: str = ""
    """JSON of `viewer.scene_data`: the same scene, to be turned on a page that can do it; empty for none."""
    breaks: float = 0.0
    """Share of its height after which it may go on another page; 0 for nowhere."""
    fixed: bool = False
    """Whether it is never drawn smaller to fill a page."""
    half: bool = False
    """Whether two such stand side by side on a wide page."""

    @classmethod
    def of(cls, name: str, title: str, caption: str, picture: Picture) -> Figure:
        """A picture as a figure, described by its title and caption."""
        svg = picture.svg(name=name)
        return cls(
            name, title, caption, svg, f"{title}. {caption}", breaks=picture.breaks, half=picture.size[0] <= HALF
        )

    def _repr_mimebundle_(self, **_: object) -> dict[str, str]:
        """Figure as notebooks show it."""
        if isinstance(self.content, str):
            return {"image/svg+xml": self.content, "text/plain": self.title}
        return {"image/png": base64.b64encode(self.content).decode(), "text/plain": self.title}


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
        """Anchor that links to this section lead to."""
        return self.name or slug(self.title)


def slug(title: str) -> str:
    """A title as links and names of files have it: plain letters, digits and hyphens; Greek letters by their names."""
    return "-".join("".join(map(_plain, title.lower())).split())


def _plain(letter: str) -> str:
    """A letter as any file system can write it; by its number where nothing else is left of it."""
    plain = unicodedata.normalize("NFKD", letter)
    if greek := _GREEK.match(unicodedata.name(plain[0], "")):
        return greek[1].lower()
    plain = "".join(c for c in plain if c.isascii() and c.isalnum())
    return plain or (f"u{ord(letter):x}" if letter.isalnum() else " ")


class Finding(NamedTuple):
    """Finding of a study about a design, for that design's report."""

    section: Section
    statement: Statement | None = None
    """The answer, for the summary."""
    seed: str = ""
    """Sentence about the seed of what chance had a part in; empty where it had none."""
    lengths: CalibratedLengths | None = None
    """Lengths as a calibration that it plans will know them."""


@dataclass(frozen=True)
class Report(BriefValue):
    """A whole report, before it is written in any format."""

    title: str
    subtitle: str
    sections: tuple[Section, ...]
    footer: str = "roslf_design"
    """No version where the same input is to give the same bytes for years."""

    def __str__(self) -> str:
        return f"Report on {self.title}. {self.answer}"

    @property
    def figures(self) -> tuple[Figure, ...]:
        """All figures, in their order."""
        return tuple(b for section in self.sections for b in section.blocks if isinstance(b, Figure))

    @property
    def answer(self) -> str:
        """The first answer that is bad, or else the first, in one line with its sign; empty where there is none."""
        blocks = [block for section in self.sections[:1] for block in section.blocks]
        said = [one for block in blocks if isinstance(block, Statements) for one in block.items]
        faults = [one for one in said if one.tone == "bad"]
        more = f" ({len(faults) - 1} more ✗ in the report)" if len(faults) > 1 else ""
        return "".join(f"{MARKS[one.tone][0]} {one.text}{more}" for one in [*faults, *said][:1])

    def figure(self, name: str) -> Figure:
        """Figure of a name; a notebook shows it.

        Raises
        ------
        ValueError
            There is none of it; names those that there are.
        """
        figures = {figure.name: figure for figure in self.figures}
        if name not in figures:
            raise ValueError(f"the report has no figure '{name}'; there are {', '.join(figures) or 'none'}")
        return figures[name]

    def _repr_html_(self) -> str:
        """Answers and contents, as a notebook shows them; the whole page is `render_html`'s."""
        blocks = [block for section in self.sections[:1] for block in section.blocks if isinstance(block, Statements)]
        answers = [f"{MARKS[item.tone][0]} {item.text} {item.remedy}" for block in blocks for item in block.items]
        contents = [section.title for section in self.sections]
        figures = ", ".join(figure.name for figure in self.figures)
        lines = [*answers, f"Sections: {', '.join(contents)}", *([f"Figures: {figures}"] if figures else [])]
        listed = "".join(f"<li>{to_html(line)}</li>" for line in lines)
        return f"<h3>{escape(self.title)}</h3><p>{to_html(self.subtitle)}</p><ul>{listed}</ul>"
