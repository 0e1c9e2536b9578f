"""Every command and every Python session of the documentation does what its page says."""

import os
import sys
from pathlib import Path

import pytest

sys.path.insert(0, os.path.dirname(__file__))
from pages import blocks, follow, matches, steps, thin_out

from tests.reporting.made import few_waves, views_as_refocused

pytestmark = pytest.mark.usefixtures("found_once")  # pages calibrate the same captures twice
DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGES = [
    page
    for page in sorted(DOCS.rglob("*.md"))
    if not any(part.startswith("_") for part in page.relative_to(DOCS).parts)
    and any(block.language in ("console", "pycon") for block in blocks(page))
]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(DOCS).as_posix())
def test_page_does_what_it_says(page, tmp_path, monkeypatch, request):
    request.getfixturevalue("few_rays" if page.stem == "depth" else "near_light")
    thin_out(monkeypatch)
    if page.stem in ("tolerance", "report", "optimise"):  # which print no depth precision
        few_waves(monkeypatch)
    elif page.stem == "endoscope":
        views_as_refocused(monkeypatch)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    assert follow(page, tmp_path) > 0


def test_output_that_differs_is_noticed():
    assert matches("a ... b 2\n", "a x\ny b   2\n")
    assert not matches("a ... b 2\n", "a x\ny b   3\n")
    assert not matches("a b\n", "a b c\n")
    assert not matches("a ... b\n", "a b c\n")
    assert not matches("... c ... a\n", "a b c\n")
    assert matches("... b ...\n", "b")
    assert steps("$ roslf presets  # which\npaper\n$ ls out\n") == [("roslf presets", "paper\n"), ("ls out", "")]


def test_guides_show_commands():
    guides = "design evaluate render decode real-lens tolerance optimise calibrate accuracy report endoscope"
    assert {page.stem for page in PAGES if page.parent.name == "guides"} >= set(guides.split())
