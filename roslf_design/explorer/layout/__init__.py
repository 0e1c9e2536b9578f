"""The page as Vue templates, one file a part of it."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

_HERE = Path(__file__).parent


@cache
def page(name: str = "page.html") -> str:
    """A template with the parts that it names by ``<!-- part: file.html -->`` put in."""
    text = (_HERE / name).read_text(encoding="utf-8")
    return re.sub(r"<!-- part: ([a-z.]+) -->", lambda match: page(match[1]), text)
