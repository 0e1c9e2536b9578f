"""The page that turns the 3D scene, in a real browser."""

import io
import shutil

import numpy as np
import pytest

from roslf_design.design import load
from roslf_design.report.blocks import Report, Section
from roslf_design.report.design.figures import picture_sheet
from roslf_design.report.printers import render_html

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = (
    *("--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-sync"),
    *("--disable-component-update", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
)


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium; on Debian: apt-get install chromium")
def test_the_page_turns_the_scene_in_a_browser_without_a_network(tmp_path):
    api = pytest.importorskip("playwright.sync_api", reason="the playwright package is not installed")
    (tmp_path / "index.html").write_text(
        render_html(Report("a", "", (Section("Rays", (picture_sheet(load("rigid-scope")),)),)))
    )
    asked, complaints = [], []
    with api.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        page = browser.new_page(viewport={"width": 1000, "height": 800})
        page.on("request", lambda request: asked.append(request.url))
        page.on("console", lambda message: complaints.append(message.text))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.goto((tmp_path / "index.html").as_uri())
        still = page.locator("#figure-view .drawing")
        assert still.is_visible()
        page.get_by_role("button", name="Turn it in 3D").click()
        page.wait_for_selector("figure[data-turned]")
        assert not still.is_visible()
        assert page.locator(".live .names span").all_text_contents() == ["FAP", "main lens", "MLA and sensor"]
        drawn = page.locator(".live").screenshot()
        page.get_by_role("button", name="From the object").click()
        page.wait_for_timeout(300)
        turned = page.locator(".live").screenshot()
        page.get_by_role("button", name="As in the picture").click()
        page.wait_for_timeout(300)
        again = page.locator(".live").screenshot()
        page.emulate_media(media="print")
        assert still.is_visible()
        assert not page.locator(".live").is_visible()
        page.emulate_media(media="screen")
        page.get_by_role("button", name="Back to the picture").click()
        assert still.is_visible()
        assert page.locator("iframe").count() == 0
        browser.close()
    assert colours(drawn) > 100  # shaded and blended: an empty view has two
    assert differing(drawn, turned) > 0.02
    assert differing(drawn, again) < 0.005
    assert complaints == []
    assert [url for url in asked if not url.startswith(("file:", "blob:", "data:", "about:"))] == []


def pixels(png):
    from PIL import Image

    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)


def colours(png):
    return len(np.unique(pixels(png).reshape(-1, 3), axis=0))


def differing(one, other):
    """Share of pixels that differ visibly."""
    return float(np.mean(np.abs(pixels(one) - pixels(other)).max(axis=-1) > 16))
