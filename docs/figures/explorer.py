"""Screenshot of the interactive explorer, for README and guide.

Run from the project's root, where Chromium and Playwright are: python docs/figures/explorer.py; it writes
docs/figures/explorer.png.
"""

from __future__ import annotations

import io
import re
import shutil
import subprocess
import sys
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright

SHOWN = Path(__file__).resolve().parent / "explorer.png"
SIZE = {"width": 1280, "height": 800}
SHADES = 256
"""Colours that are left of it, those of the legends among them: a page has few, and the file is a third as large."""
FLAGS = ["--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader"]


def shot(design: str = "rigid-scope") -> bytes:
    """PNG of the page that `roslf explore` opens on a design, once its verdicts and pictures are there."""
    command = [sys.executable, "-m", "roslf_design", "explore", design, "--no-browser", "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as explorer:
        try:
            assert explorer.stdout is not None
            (address,) = re.findall(r"http://\S+", explorer.stdout.readline())
            with sync_playwright() as driver:
                browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
                page = browser.new_page(viewport=SIZE)
                page.goto(address)
                page.wait_for_selector("[data-testid^=light-]", timeout=120_000)
                page.wait_for_load_state("networkidle", timeout=120_000)
                page.wait_for_timeout(3000)
                picture = page.screenshot()
                browser.close()
        finally:
            explorer.terminate()
    return picture


if __name__ == "__main__":
    Image.open(io.BytesIO(shot())).convert("RGB").quantize(SHADES, Image.Quantize.MAXCOVERAGE).save(
        SHOWN, optimize=True
    )
