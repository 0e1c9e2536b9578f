"""Formulas as MathML, which browsers draw themselves, with a font that lies beside the pages: nothing is fetched.

Without a font that has a table of mathematical spacing, browsers leave subscripts on the line. STIX Two Math has one;
the ziamath package carries it.
"""

from __future__ import annotations

import shutil
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx


def visit_inline(self: Any, node: nodes.math) -> None:
    """Write a formula within a line."""
    self.body.append(convert(node.astext()))
    raise nodes.SkipNode


def visit_block(self: Any, node: nodes.math_block) -> None:
    """Write a formula of its own, with its number where it has one."""
    self.body.append(self.starttag(node, "div", CLASS="math-block"))
    self.body.append(convert(node.astext(), display="block"))
    if node.get("number"):
        self.body.append(f'<span class="eqno">({node["number"]})</span>')
    self.body.append("</div>\n")
    raise nodes.SkipNode


FONT = "STIXTwoMath-Regular.ttf"


def lay_font(app: Sphinx, error: Exception | None) -> None:
    """Put the font where the style sheet looks for it."""
    if error is None and app.builder.format == "html":
        with as_file(files("ziamath.fonts").joinpath(FONT)) as font:
            shutil.copyfile(font, Path(app.outdir) / "_static" / FONT)


def setup(app: Sphinx) -> dict[str, Any]:
    """Replace the formulas of the HTML builder."""
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_block, None))
    app.connect("build-finished", lay_font)
    app.config.html_math_renderer = "mathml"
    return {"parallel_read_safe": True, "parallel_write_safe": True}
