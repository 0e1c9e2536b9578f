"""Notebooks as pages: their text, code and stored outputs, with a link to the notebook itself."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from docutils import nodes
from myst_parser.parsers.sphinx_ import MystParser
from sphinx.application import Sphinx

OPEN = (
    "{{download}}`{name}` opens in Jupyter, with live objects. What stands below is what it showed when it was last "
    "run.\n"
)
SUFFIXES = {"image/svg+xml": "svg", "image/png": "png"}


class NotebookParser(MystParser):  # type: ignore[misc]
    """Parser of notebooks: their Markdown is MyST, like that of all pages."""

    supported = ("notebook",)

    def parse(self, inputstring: str, document: nodes.document) -> None:
        """Fill a document."""
        page = Path(document["source"])
        super().parse("\n\n".join(_parts(json.loads(inputstring), page)), document)


def _parts(notebook: dict[str, Any], page: Path) -> Iterator[str]:
    """Text of a page, cell after cell."""
    pictures = page.parents[1] / "_generated" / "notebooks"
    for number, cell in enumerate(notebook["cells"]):
        text = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            yield text
            if number == 0:
                yield OPEN.format(name=page.name)
            continue
        yield f"```python\n{text}\n```"
        for place, output in enumerate(cell["outputs"]):
            yield _output(output, pictures, f"{page.stem}-{number}-{place}")


def _output(output: dict[str, Any], pictures: Path, name: str) -> str:
    """What a cell showed, in its richest form; pictures as files."""
    data = output.get("data", {"text/plain": output.get("text", "")})
    for kind, suffix in SUFFIXES.items():
        if kind in data:
            pictures.mkdir(parents=True, exist_ok=True)
            content = "".join(data[kind])
            file = pictures / f"{name}.{suffix}"
            file.write_bytes(base64.b64decode(content) if suffix == "png" else content.encode())
            words = "".join(data["text/plain"])
            return f"```{{image}} ../_generated/notebooks/{file.name}\n:alt: {words}\n:class: plot\n```"
    if "text/html" in data:
        html = "".join(data["text/html"])
        return f'````{{raw}} html\n<div class="output">{html}</div>\n````'
    return f"```text\n{''.join(data['text/plain'])}\n```"


def setup(app: Sphinx) -> dict[str, Any]:
    """Notebooks beside pages."""
    app.add_source_suffix(".ipynb", "notebook")
    app.add_source_parser(NotebookParser)
    return {"parallel_read_safe": True}
