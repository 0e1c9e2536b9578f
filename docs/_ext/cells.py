"""Cells of Python that show what a notebook would: what they print, their last value, figures of matplotlib.

`python docs/_ext/cells.py docs/notebooks/*.ipynb` runs notebooks and stores what they show in them (`make notebooks`).
"""

from __future__ import annotations

import ast
import base64
import contextlib
import io
import json
import os
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("agg")
from matplotlib import pyplot as plt

DPI = 72
"""Of figures of matplotlib: notebooks stay small."""
RICHER = {"_repr_html_": "text/html", "_repr_svg_": "image/svg+xml", "_repr_png_": "image/png"}
Output = dict[str, Any]
"""One output of a cell, as a notebook file has it."""


def run(source: str, names: dict[str, Any], dpi: float = DPI) -> list[Output]:
    """Outputs of a cell, which finds and leaves its names in `names`; a semicolon at its end keeps its value back."""
    tree = ast.parse(source)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(tree, "<cell>", "exec"), names)
        value = None if last is None else eval(compile(ast.Expression(last.value), "<cell>", "eval"), names)
    outputs: list[Output] = []
    if text := printed.getvalue():
        outputs.append({"output_type": "stream", "name": "stdout", "text": _lines(text)})
    if value is not None and not source.rstrip().endswith(";"):
        data = {kind: _lines(content) for kind, content in shown(value).items()}
        outputs.append({"output_type": "execute_result", "data": data, "metadata": {}})
    for number in plt.get_fignums():
        stream = io.BytesIO()
        plt.figure(number).savefig(stream, format="png", dpi=dpi)
        png = base64.b64encode(stream.getvalue()).decode()
        data = {"image/png": png, "text/plain": ["a figure"]}
        outputs.append({"output_type": "display_data", "data": data, "metadata": {}})
    plt.close("all")
    return outputs


def shown(value: Any) -> dict[str, str]:
    """A value in each format that it shows itself in; where there is more than text, of that only what it is."""
    if hasattr(value, "_repr_mimebundle_"):
        return dict(value._repr_mimebundle_())
    rich = {kind: getattr(value, name)() for name, kind in RICHER.items() if hasattr(value, name)}
    return rich | {"text/plain": type(value).__name__ if rich else repr(value)}


def run_notebook(path: Path) -> Iterator[tuple[dict[str, Any], list[Output]]]:
    """Code cells of a notebook, one after the other in the working folder, each with what it shows now."""
    names: dict[str, Any] = {"__name__": "__main__"}
    for count, cell in enumerate(code_cells(json.loads(path.read_text(encoding="utf-8"))), 1):
        outputs = run("".join(cell["source"]), names)
        for output in outputs:
            if output["output_type"] == "execute_result":
                output["execution_count"] = count
        yield cell, outputs


def code_cells(notebook: dict[str, Any]) -> list[dict[str, Any]]:
    """Code cells of a notebook."""
    return [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]


def _lines(text: str) -> list[str]:
    return text.splitlines(keepends=True)


def store(path: Path) -> None:
    """Run a notebook in a folder of its own, and write it again with what it shows."""
    notebook = json.loads(path.read_text(encoding="utf-8"))
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        results = [outputs for _, outputs in run_notebook(path)]
    for count, (cell, outputs) in enumerate(zip(code_cells(notebook), results, strict=True), 1):
        cell.update(outputs=outputs, execution_count=count)
    path.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    os.environ.setdefault("COLUMNS", "100")
    for number, name in enumerate(sys.argv[1:], 1):
        print(f"{number} of {len(sys.argv) - 1}: {name}", flush=True)
        store(Path(name).resolve())
