"""Every text of the explorer's page in full: none cut by what it lies in, none printed over another, none pale."""

from roslf_design.design import dumps, load
from tests.explorer.test_browser import WITHOUT_WEBGL, click, idle, preset

FAULTS_OF_TEXTS = r"""
() => {
  // Texts that are cut by what they lie in, that overprint each other, or that are pale on their ground.
  const faults = [], texts = [], root = document.documentElement;
  const brief = (text) => text.trim().replace(/\s+/g, " ").slice(0, 60);
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node = walker.nextNode(); node; node = walker.nextNode()) {
    const parent = node.parentElement;
    if (!node.data.trim() || parent.closest(".unseen, .skip, option, title, style, script")) continue;
    if (!parent.checkVisibility({ checkVisibilityCSS: true, checkOpacity: true })) continue;
    const range = document.createRange();
    range.selectNodeContents(node);
    const drawn = parent.closest("text"), whole = drawn ?? node;
    for (const rect of drawn ? [drawn.getBoundingClientRect()] : range.getClientRects()) {
      if (rect.width > 1) texts.push({ words: brief(node.data), rect, parent, whole });
    }
  }
  for (const { words, rect, parent } of texts) {
    for (let box = parent; box && box !== document.body; box = box.parentElement) {
      const style = getComputedStyle(box), edge = box.getBoundingClientRect();
      const cuts = (flow) => box.tagName === "svg" || /hidden|clip|auto|scroll/.test(flow);
      // What scrolls downwards shows the rest in time; nobody looks sideways.
      const side = cuts(style.overflowX) ? Math.max(edge.left - rect.left, rect.right - edge.right) : 0;
      const still = box.tagName === "svg" || /hidden|clip/.test(style.overflowY);
      const over = still ? Math.max(edge.top - rect.top, rect.bottom - edge.bottom) - 0.15 * rect.height : 0;
      if (side > 1 || over > 1) {
        faults.push(`cut by ${Math.max(side, over).toFixed(0)} px: ${words}`);
        break;
      }
      if (style.position === "fixed") break;
    }
    if (rect.right > root.clientWidth + 1 || rect.left < -1) faults.push(`beyond the page: ${words}`);
  }
  for (const box of document.querySelectorAll("input[type=text]")) {
    const full = !box.checkVisibility() || box.scrollWidth <= box.clientWidth + 1;
    if (!full) faults.push(`cut in its field: ${box.value || box.placeholder}`);
  }
  const parts = (colour) => colour.match(/[\d.]+/g).map(Number);
  const light = (colour) => {
    const linear = parts(colour).map((c) => (c > 10 ? ((c / 255 + 0.055) / 1.055) ** 2.4 : c / 255 / 12.92));
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2] + 0.05;
  };
  for (const { words, parent } of texts) {
    if (parent.closest(":disabled")) continue;
    const style = getComputedStyle(parent), clear = (box) => (parts(getComputedStyle(box).backgroundColor)[3] ?? 1) < 1;
    let ground = parent;
    while (ground !== root && clear(ground)) ground = ground.parentElement;
    const under = light(getComputedStyle(ground).backgroundColor);
    const over = light(parent.closest("text") ? style.fill : style.color);
    const contrast = Math.max(over, under) / Math.min(over, under);
    if (contrast < 4.5) faults.push(`pale, ${contrast.toFixed(1)} to 1: ${words}`);
  }
  const pen = document.createElement("canvas").getContext("2d");
  for (const box of document.querySelectorAll("select")) {
    if (!box.checkVisibility()) continue;
    const style = getComputedStyle(box);
    pen.font = style.font;
    const room = box.clientWidth - parseFloat(style.paddingLeft) - parseFloat(style.paddingRight) - 16;
    const wide = pen.measureText(box.selectedOptions[0]?.text ?? "").width;
    if (wide > room + 1) faults.push(`cut in its list: ${box.selectedOptions[0].text}`);
  }
  // What is scrolled out of its box is in nobody's way.
  for (const text of texts) {
    for (let box = text.parent; box; box = box.parentElement) {
      if (!/auto|scroll/.test(getComputedStyle(box).overflowY) || box === document.body) continue;
      const { top, bottom } = box.getBoundingClientRect();
      const seen = [Math.max(text.rect.top, top), Math.min(text.rect.bottom, bottom)];
      text.rect = new DOMRect(text.rect.left, seen[0], text.rect.width, Math.max(0, seen[1] - seen[0]));
    }
  }
  texts.sort((a, b) => a.rect.top - b.rect.top);
  for (let i = 0; i < texts.length; i++) {
    const a = texts[i];
    for (let j = i + 1; j < texts.length && texts[j].rect.top < a.rect.bottom; j++) {
      const b = texts[j];
      if (a.whole === b.whole) continue;
      const across = Math.min(a.rect.right, b.rect.right) - Math.max(a.rect.left, b.rect.left);
      const down = Math.min(a.rect.bottom, b.rect.bottom) - Math.max(a.rect.top, b.rect.top);
      // Letters leave a quarter of their box empty above and below.
      const fixed = (t) => t.parent.closest(".numbers, .menu[open] .panel");
      if (fixed(a) !== fixed(b)) continue;
      if (across > 2 && down > 0.3 * Math.min(a.rect.height, b.rect.height)) {
        faults.push(`overprinted by ${across.toFixed(0)} x ${down.toFixed(0)} px: ${a.words} | ${b.words}`);
      }
    }
  }
  return [...new Set(faults)];
}
"""
"""Script that lists texts which are cut by what they lie in, overlap each other, or have a contrast below 4.5."""

SMALL, LARGE, NARROW = SIZES = ((1024, 768), (1440, 900), (390, 844))
SEEN = {"paper": SIZES, "cystoscope": (SMALL, NARROW), "paper-singlet": (SMALL,)}
"""Screens at which each preset is looked at: every one at the one with least room beside each other."""
TABS = ("camera", "depth", "tolerance", "optimise", "space")
SPOILT = """() => {
  document.querySelector(".card-depth h2").style.cssText = "max-width: 3em; overflow: hidden; white-space: nowrap";
  document.querySelector("#tab-camera").style.cssText = "position: relative; left: 60px";
  document.querySelector(".card-glance h2").style.color = "#808080";
}"""


def faults(page):
    idle(page)
    return page.evaluate(FAULTS_OF_TEXTS)


def test_it_fits_every_screen_and_no_text_is_cut_or_overprinted(page):
    page.evaluate(WITHOUT_WEBGL)
    told = {}
    for name, sizes in SEEN.items():
        preset(page, name)
        if name == "paper-singlet":
            page.wait_for_selector("[data-testid=light-thin_lens_holds]", timeout=60_000)
        for width, height in sizes:
            page.set_viewport_size({"width": width, "height": height})
            click(page, "theme")
            for tab in TABS:
                click(page, f"#tab-{tab}")
                page.wait_for_timeout(120)  # until the page has told how much room its pictures have
                told[name, width, tab] = faults(page) + wide(page, width, height)
            for panel in page.locator(".verdicts details.menu").all():
                panel.evaluate("(e) => { e.open = true; }")
                told[name, width, panel.get_attribute("data-testid")] = faults(page)
                panel.evaluate("(e) => { e.open = false; }")
    assert {place: texts for place, texts in told.items() if texts} == {}


def wide(page, width, height):
    """What is larger than it has room for: the page, and pictures."""
    found = page.evaluate(
        """() => [document.documentElement.scrollWidth, document.documentElement.scrollHeight,
        ...[...document.querySelectorAll(".picture:not(.space)")].filter((e) => e.checkVisibility())
            .filter((e) => e.querySelector("svg")?.getBoundingClientRect().width > e.getBoundingClientRect().width + 1)
            .map((e) => e.dataset.picture)]"""
    )
    page_width, page_height, *pictures = found
    # On a narrow screen one scrolls down.
    return [*pictures, *["page"] * (page_width > width or (page_height > height and width > 900))]


def test_texts_that_are_cut_or_overprinted_are_noticed(page):
    click(page, "#tab-depth")
    assert faults(page) == []
    page.evaluate(SPOILT)
    assert {fault.split()[0] for fault in faults(page)} == {"cut", "overprinted", "pale,"}


def test_it_says_that_it_starts_until_the_page_is_there(same_page, chromium, explorer):
    page = same_page
    assert not page.locator(".wait").is_visible()
    early = chromium.new_page()
    early.route("**/assets/*.js", lambda route: route.abort())
    early.goto(explorer.address)
    assert "Starting" in early.locator(".wait").inner_text()
    early.close()


def test_the_first_screen_holds_all_verdicts_and_a_picture(page, tmp_path):
    file = tmp_path / "asked.toml"
    at = [{"at": float(distance), "max": "0.0125 mm"} for distance in (10, 15, 20, 30, 40)]
    asked = {"u_z_mm": at, "outer_diameter_mm": {"max": 4.0}, "field_of_view_deg": {"min": 90.0}}
    file.write_text(dumps(load("rigid-scope").replace({"required": asked})))
    page.set_input_files("input[type=file]", file)
    idle(page)
    click(page, "#tab-tolerance")
    for width, height in SIZES:
        page.set_viewport_size({"width": width, "height": height})
        assert faults(page) == []
    click(page, "#tab-camera")
    for width, height in SIZES:
        page.set_viewport_size({"width": width, "height": height})
        page.wait_for_timeout(120)
        picture = page.locator(".card-meridional").bounding_box()
        assert picture["y"] > page.locator("[data-testid=light-required]").bounding_box()["y"]
        assert picture["y"] + picture["height"] < height - 40
