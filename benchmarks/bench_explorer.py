"""From a slider's input event to the changed picture in the page, in headless Chromium."""

from __future__ import annotations

import re
import shutil
import statistics
import subprocess
import sys
from pathlib import Path
from typing import Any

GOALS = {"camera": (100.0, 200.0), "depth": (100.0, 200.0), "space": (250.0, 250.0)}
"""Median and 95th percentile for each view [ms]."""

PICTURES = {"camera": "meridional", "depth": "effects", "space": "space"}
"""What must have changed before a view counts as changed; the page changes as one."""

FLAGS = (
    *("--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync", "--enable-unsafe-swiftshader"),
)

MEASURE = """async ([view, picture, count]) => {
  const slider = document.querySelector("[data-field=D_F] .slider");
  const box = document.querySelector(`[data-picture=${picture}]`);
  const times = [];
  for (let i = 0; i < count + 3; i++) {
    const changed = new Promise((done) => {
      if (view === "space") box.addEventListener("drawn", done, { once: true });
      else {
        const watch = new MutationObserver(() => { watch.disconnect(); done(); });
        watch.observe(box, { childList: true, subtree: true, attributes: true, characterData: true });
      }
    });
    const begun = performance.now();
    slider.value = 400 + ((i * 37) % 200);
    slider.dispatchEvent(new Event("input", { bubbles: true }));
    await changed;
    if (i >= 3) times.push(performance.now() - begun);
    do await new Promise((done) => setTimeout(done, 60)); while (document.documentElement.dataset.busy);
  }
  slider.dispatchEvent(new Event("change", { bubbles: true }));
  return times;
}"""


def main(count: int = 60) -> None:
    """Print median and 95th percentile for each view."""
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        print("no chromium on this machine (Debian: apt-get install chromium); nothing measured")
        return
    from playwright.sync_api import sync_playwright

    command = [str(Path(sys.executable).with_name("roslf")), "explore", "--no-browser", "--port", "0"]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert server.stdout is not None
        found = re.search(r"http://\S+", server.stdout.readline())
        assert found is not None
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=chromium, args=list(FLAGS))
            page = browser.new_page(viewport={"width": 1366, "height": 768})
            page.goto(found[0])
            page.wait_for_selector("[data-picture=meridional] svg")
            for view, picture in PICTURES.items():
                print(_line(view, _measured(page, view, picture, count)))
            browser.close()
    finally:
        server.terminate()
        server.wait()


def _measured(page: Any, view: str, picture: str, count: int) -> list[float]:
    page.click(f"#tab-{view}")
    page.wait_for_timeout(1500)
    times: list[float] = page.evaluate(MEASURE, [view, picture, count])
    return times


def _line(view: str, times: list[float]) -> str:
    median, late = statistics.median(times), statistics.quantiles(times, n=20)[-1]
    goals = GOALS[view]
    return (
        f"slider to picture, {view:7s} {median:6.1f} ms median (goal {goals[0]:.0f}), "
        f"{late:6.1f} ms 95th percentile (goal {goals[1]:.0f})"
    )


if __name__ == "__main__":
    main()
