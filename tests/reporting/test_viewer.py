"""The page that turns the 3D scene, in a real browser."""

import base64
import gzip
import hashlib
import io
import re
import shutil
import zlib
from pathlib import Path

import numpy as np
import pytest

from roslf_design.design import load
from roslf_design.drawing.solid import library
from roslf_design.reporting.blocks import Bullets, Figure, Paragraph, Report, Section
from roslf_design.reporting.design.curves import depth_precision
from roslf_design.reporting.design.figures import _picture_sheet
from roslf_design.reporting.printers import render_html
from roslf_design.reporting.story import full_report

REPOSITORY = Path(__file__).parents[2]
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = (
    *("--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-sync"),
    *("--disable-component-update", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
)


@pytest.fixture(scope="module")
def browser():
    """One for both tests that look through it."""
    if CHROMIUM is None:
        pytest.skip("no chromium; on Debian: apt-get install chromium")
    api = pytest.importorskip("playwright.sync_api", reason="the playwright package is not installed")
    with api.sync_playwright() as driver:
        running = driver.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        yield running
        running.close()


@pytest.fixture(scope="module")
def drawing():
    """A picture that is not to be turned."""
    return depth_precision(load("paper"))


def test_the_page_turns_the_scene_in_a_browser_without_a_network(tmp_path, browser):
    (tmp_path / "index.html").write_text(
        render_html(Report("a", "", (Section("Rays", (_picture_sheet(load("rigid-scope")),)),)))
    )
    asked, complaints = [], []
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
    page.close()
    assert colours(drawn) > 100  # shaded and blended: an empty view has two
    assert differing(drawn, turned) > 0.02
    assert differing(drawn, again) < 0.005
    assert complaints == []
    assert [url for url in asked if not url.startswith(("file:", "blob:", "data:", "about:"))] == []


FAINT = """() => {
  const rgb = text => (text.match(/[\\d.]+/g) || [0, 0, 0, 0]).map(Number);
  const light = ([r, g, b]) => [r, g, b].map(v => v / 255)
    .map(v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)
    .reduce((sum, v, k) => sum + v * [0.2126, 0.7152, 0.0722][k], 0);
  const ground = element => {
    for (let e = element; e; e = e.parentElement) {
      const drawn = e.tagName === "svg" && e.querySelector(":scope > rect");
      const colour = rgb(drawn ? getComputedStyle(drawn).fill : getComputedStyle(e).backgroundColor);
      if (colour.length === 3 || colour[3] > 0) return colour;
    }
    return [255, 255, 255];
  };
  const own = e => [...e.childNodes].some(n => n.nodeType === 3 && n.data.trim());
  return [...document.body.querySelectorAll("*:not(script, style, title)")].filter(own).map(e => {
    const style = getComputedStyle(e);
    const two = [light(rgb(e.closest("svg") ? style.fill : style.color)), light(ground(e))];
    return [(Math.max(...two) + 0.05) / (Math.min(...two) + 0.05), e.textContent.trim().slice(0, 40)];
  }).filter(([contrast]) => contrast < 4.5);
}"""
"""Texts of a page whose contrast, by WCAG 2, is below 4.5, with it."""
WRITTEN = [
    page
    for page in sorted(REPOSITORY.glob("reports/*/index.html"))
    if page.parent.name != "paper" and not page.parent.name.startswith("story-")
]
"""Pages on record; of the paper and of stories that is a PDF, and a page that lies beside it is of any age."""


def test_pages_keep_to_a_phone_follow_a_dark_screen_and_print_light(tmp_path, browser, few_builds):
    # A name without a space, as addresses and files are: what made a page wider than the screen.
    long = Report("a", "", (Section("Parts", (Bullets(("x" * 200,)), Paragraph("y" * 200))),))
    (tmp_path / "long.html").write_text(render_html(long))
    (tmp_path / "paper.html").write_text(render_html(full_report(load("paper"), command="roslf report paper")))
    page = browser.new_page(viewport={"width": 390, "height": 844}, color_scheme="dark")
    for path in (tmp_path / "long.html", tmp_path / "paper.html", *WRITTEN):
        page.goto(path.as_uri())
        assert page.evaluate("document.documentElement.scrollWidth") <= 390, path
        letters = (
            "Math.min(...[...document.querySelectorAll('.drawing text')].map(e => e.getBoundingClientRect().height))"
        )
        assert page.evaluate(letters) > 9, path
        assert page.evaluate(FAINT) == [], path
        assert sum(map(int, page.evaluate(GROUND))) < 120, path
        page.emulate_media(media="print")
        assert sum(map(int, page.evaluate(GROUND))) in (0, 765), path  # transparent, or white
        assert page.evaluate(FAINT) == [], path
        page.emulate_media(media="screen")
    page.close()


GROUND = "getComputedStyle(document.body).backgroundColor.match(/\\d+/g).slice(0, 3)"
ATTACKS = (
    '<script>document.title = "attacked";</script>',
    '<img src="data:," onerror="document.title = &quot;attacked&quot;">',
    '<img src="https://evil.example/a.png">',
    '<iframe src="https://evil.example/"></iframe>',
    '<link rel="stylesheet" href="https://evil.example/a.css">',
    '<base href="https://evil.example/">',
    '<object data="https://evil.example/a"></object>',
)
"""What could get into a page that anything slips into."""


def test_the_page_runs_and_loads_nothing_but_its_own_whatever_got_into_it(tmp_path, browser, drawing, real_pngs):
    figures = Figure("a", "A", "", drawing.to_png(72)), Figure("b", "B", "", drawing.svg())
    still = Report("still", "", (Section("Rays", figures),))
    turned = Report("turned", "", (Section("Rays", (_picture_sheet(load("rigid-scope")),)),))
    for report in (still, turned):
        text = render_html(report)
        for attacks in ((), ATTACKS):
            (tmp_path / "index.html").write_text(text.replace("<main>", f"<main>{''.join(attacks)}"))
            page = browser.new_page()
            asked, refused = [], []
            page.on("request", lambda request, asked=asked: asked.append(request))
            page.on("console", lambda message, refused=refused: refused.append(message.text))
            page.goto((tmp_path / "index.html").as_uri())
            # The policy refuses them before any network does.
            assert {one.failure for one in asked if one.url.startswith("http")} <= {"csp"}
            assert page.title() == report.title
            assert len(refused) == len(attacks), refused
            own = page.locator("figure svg, figure img")
            assert all(one.bounding_box()["width"] > 10 for one in own.all())
            assert page.evaluate("[...document.querySelectorAll('figure img')].every(one => one.naturalWidth > 0)")
            page.close()


def test_the_policy_allows_scripts_by_what_they_say_alone(drawing):
    turned = render_html(Report("a", "", (Section("Rays", (_picture_sheet(load("rigid-scope")),)),)))
    still = render_html(Report("a", "", (Section("Rays", (Figure("a", "A", "", drawing.svg()),)),)))
    policies = [re.search(r'Content-Security-Policy" content="([^"]*)"', text)[1] for text in (turned, still)]
    for policy in policies:
        assert policy.startswith("default-src 'none';")
        assert "script-src 'unsafe" not in policy
        assert "http" not in policy
    assert "script-src" not in policies[1]
    (own,) = re.findall(r"<script>(.*?)</script>", turned, re.DOTALL)
    packed = re.search(r'id="viewer-library">([^<]*)<', turned)[1]
    inner = re.findall(r"<script[^>]*>(.*?)</script>", gzip.decompress(base64.b64decode(packed)).decode(), re.DOTALL)
    hashes = {base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in (own, *inner)}
    assert set(re.findall(r"'sha256-([^']*)'", policies[0])) == hashes


def test_the_packed_viewer_tells_neither_when_nor_where_it_was_packed(monkeypatch):
    """Python 3.11 leaves the byte of the system to zlib, 3.13 writes 255: by RFC 1952, that it is unknown."""
    packed = []
    for system in (3, 11):

        def compress(data, level, *, mtime, system=system):
            head = b"\x1f\x8b\x08\x00" + mtime.to_bytes(4, "little") + bytes([2, system])
            body = zlib.compressobj(level, wbits=-15)
            foot = zlib.crc32(data).to_bytes(4, "little") + len(data).to_bytes(4, "little")
            return head + body.compress(data) + body.flush() + foot

        monkeypatch.setattr(gzip, "compress", compress)
        packed.append(library.__wrapped__())
    assert len({*packed, library()}) == 1
    assert base64.b64decode(packed[0])[4:10] == b"\0\0\0\0\x02\xff"


def pixels(png):
    from PIL import Image

    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)


def colours(png):
    return len(np.unique(pixels(png).reshape(-1, 3), axis=0))


def differing(one, other):
    """Share of pixels that differ visibly."""
    return float(np.mean(np.abs(pixels(one) - pixels(other)).max(axis=-1) > 16))
