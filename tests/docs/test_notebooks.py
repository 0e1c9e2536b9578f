"""Notebooks of the documentation run from top to bottom, and what is stored in them is what they show now."""

import json
import sys
from pathlib import Path

import pytest
from matplotlib import pyplot as plt

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "docs/_ext"))
from cells import code_cells, run, run_notebook
from page_blocks import blocks, pictures

from roslf_design.tolerancing import budgets
from tests.reporting.made import few_builds, few_waves, without_figures

pytestmark = pytest.mark.usefixtures("found_once")
DOCS = Path(__file__).resolve().parents[2] / "docs"
NOTEBOOKS = sorted((DOCS / "notebooks").glob("*.ipynb"))


def printed(outputs):
    """What a cell prints, and what it shows besides, by kind."""
    text = "".join("".join(output["text"]) for output in outputs if output["output_type"] == "stream")
    return text, [sorted(output["data"]) for output in outputs if "data" in output]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_shows_what_is_stored_in_it(path, tmp_path, monkeypatch):
    few_builds(monkeypatch)  # of reports; no notebook prints what their default tolerances say
    without_figures(monkeypatch)  # nor does anybody look at those that reports draw
    if path.stem == "calibrate":  # which prints lengths alone
        few_waves(monkeypatch)
    elif path.stem == "tolerances":  # which prints yields, sensitivities and spreads
        monkeypatch.setattr(budgets, "MOST_TRIALS", 64)
        monkeypatch.setattr(budgets, "FRESH", 1)
    monkeypatch.chdir(tmp_path)
    plt.close("all")  # figures that other tests left open would be shown below a cell
    for cell, outputs in run_notebook(path):
        assert printed(outputs) == printed(cell["outputs"]), "".join(cell["source"])


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_one_that_jupyter_opens(path):
    notebook = json.loads(path.read_text(encoding="utf-8"))
    assert (notebook["nbformat"], notebook["nbformat_minor"]) == (4, 4)
    assert notebook["metadata"]["kernelspec"]["language"] == "python"
    assert "".join(notebook["cells"][0]["source"]).startswith("# ")
    cells = code_cells(notebook)
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    kinds = {kind for cell in cells for output in cell["outputs"] for kind in output.get("data", ())}
    assert kinds & {"image/svg+xml", "image/png"}
    assert path.stat().st_size < 600_000


def test_the_four_stories_are_told():
    assert [path.stem for path in NOTEBOOKS] == ["calibrate", "depth", "tip", "tolerances"]


def test_every_guide_has_a_picture_that_is_made_when_it_is():
    """Where it is a file, `test_pages` looks that a command above writes it."""
    for page in sorted((DOCS / "guides").glob("*.md")):
        assert pictures(page) or "_generated/" in page.read_text(encoding="utf-8"), page.name


GALLERY = DOCS / "gallery.md"


@pytest.mark.parametrize("number", range(len(pictures(GALLERY))))
def test_code_of_the_gallery_draws(number, tmp_path, monkeypatch, near_light, few_rays):
    few_builds(monkeypatch)
    few_waves(monkeypatch)
    monkeypatch.chdir(tmp_path)
    for block in blocks(GALLERY):
        (tmp_path / block.caption).write_text(block.text, encoding="utf-8")
    *_, last = run(pictures(GALLERY)[number].code, {})
    assert set(last["data"]) & {"image/svg+xml", "image/png"}
