"""Docstrings are plain text with numpydoc sections: what reStructuredText would misread in them is made safe.

Names between single backticks become links where they are known from where they stand, and code where they are not.
"""

from __future__ import annotations

import re
from typing import Any

from sphinx.application import Sphinx
from sphinx.domains.python import PythonDomain
from sphinx.environment import BuildEnvironment
from sphinx.ext.napoleon import Config, NumpyDocstring

_CODE = re.compile(r"(``.+?``|`[^`\n]+`)")
_NAME = re.compile(r"~?[A-Za-z_][\w.]*")
_EMPHASIS = re.compile(r"(?<![\w*])\*[^\s*][^*\n]*[^\s*]\*(?![\w*])")
_RULE = re.compile(r"=+(  +=+)+")
_SECTIONS = Config(napoleon_google_docstring=False, napoleon_use_rtype=False, napoleon_use_ivar=False)


class NearbyNames(PythonDomain):
    """Names that several modules define mean the one of the nearest package, or none: never just any."""

    def find_obj(
        self, env: BuildEnvironment, modname: str, classname: str, name: str, type: str | None, searchmode: int = 0
    ) -> list[tuple[str, Any]]:
        """Find what a name may mean, at most one."""
        found = super().find_obj(env, modname, classname, name, type, searchmode)
        found = found or super().find_obj(env, modname, classname, name, type, 1)
        exact = [match for match in found if match[0] in (name, f"{modname}.{name}", f"{modname}.{classname}.{name}")]
        if exact or not found:
            return exact[:1]
        home = (modname or "").split(".")[:2]
        kinds = ("class", "function", "data", "exception", "module")
        near = [match for match in found if match[0].split(".")[:2] == home]
        if len(near) != 1:
            near = [match for match in near or found if match[1].objtype in kinds]
        return near if len(near) == 1 else []


def safe_line(line: str) -> str:
    """One line whose bars, stars and trailing underscores are meant as such."""
    parts = _CODE.split(line)
    for index, part in enumerate(parts):
        if index % 2:
            if not part.startswith("``") and not _NAME.fullmatch(part[1:-1]):
                parts[index] = f"`{part}`"
        elif not part.lstrip().startswith((">>>", "...")):
            part = re.sub(r"(?<!\\)\|", r"\\|", part)
            part = _unless(_EMPHASIS, part, lambda text: text.replace("*", "\\*"))
            parts[index] = re.sub(r"(?<=\w)_(?=[\s,.;:)\]]|$)", r"\\_", part)
    return "".join(parts)


def _unless(kept: re.Pattern[str], text: str, change: Any) -> str:
    found = kept.findall(text)
    return "".join(change(p) + (found[i] if i < len(found) else "") for i, p in enumerate(kept.split(text)))


def lay_out_tables(lines: list[str]) -> None:
    """Give the columns of simple tables the width of their text."""
    rules = [index for index, line in enumerate(lines) if _RULE.fullmatch(line.strip())]
    for start, end in zip(rules[::3], rules[2::3], strict=False):
        columns = len(lines[start].split())
        rows = {i: re.split(r"\s{2,}", lines[i].strip(), maxsplit=columns - 1) for i in range(start, end + 1)}
        rules_here = [i for i in rows if i in rules]
        text = [row for i, row in rows.items() if i not in rules_here]
        widths = [max(len(row[c]) for row in text if len(row) > c) for c in range(columns)]
        indent = lines[start][: len(lines[start]) - len(lines[start].lstrip())]
        for i, row in rows.items():
            cells = (
                ["=" * w for w in widths]
                if i in rules_here
                else [c.ljust(w) for c, w in zip(row, widths, strict=False)]
            )
            lines[i] = indent + "  ".join(cells).rstrip()


def make_safe(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Rewrite a docstring in place; blocks of code stay as they are."""
    block = False
    for index, line in enumerate(lines):
        if line.strip() and not line.startswith(" "):
            block = False
        if not block:
            lines[index] = safe_line(line)
        block = block or line.rstrip().endswith("::")
    lay_out_tables(lines)
    if what in ("module", "class", "exception", "function", "method", "property"):
        lines[:] = NumpyDocstring("\n".join(lines), _SECTIONS, app, what, name, obj, options).lines()


def setup(app: Sphinx) -> dict[str, Any]:
    """In place of napoleon, which reads sections into the one-line texts below fields as well."""
    app.add_domain(NearbyNames, override=True)
    app.connect("autodoc-process-docstring", make_safe)
    return {"parallel_read_safe": True}
