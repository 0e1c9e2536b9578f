"""The explorer as its user sees it, in headless Chromium: every control does what it says."""

import re

import pytest

from roslf_design.design import dumps, load, loads, preset_names
from roslf_design.explorer.fields import BY_SYMBOL, FIELDS, read
from tests.explorer.conftest import Explorer

PAPER = load("paper")
SYMBOLS = [field.symbol for field in FIELDS]
FREE = [symbol for symbol in SYMBOLS if symbol != "d_f"]


def number(page, symbol):
    return page.locator(f"[data-field={symbol}] .number")


def slider(page, symbol):
    return page.locator(f"[data-field={symbol}] .slider")


def fault(page, symbol):
    return page.locator(f"[data-field={symbol}] .fault")


def picture(page, name="meridional"):
    return page.inner_html(f"[data-picture={name}]")


def idle(page):
    """Wait until the server has answered everything and the page shows it."""
    page.wait_for_function("!document.documentElement.dataset.busy")
    page.evaluate("() => new Promise((done) => requestAnimationFrame(() => setTimeout(done, 20)))")


def write(page, symbol, text):
    number(page, symbol).fill(text)
    number(page, symbol).press("Enter")
    idle(page)


def value(page, symbol):
    """What a field shows, in mm."""
    return read(BY_SYMBOL[symbol], number(page, symbol).input_value())


def values(page):
    return {symbol: value(page, symbol) for symbol in SYMBOLS}


def shown(page, design):
    """Whether the page's fields show a design, to their seven digits."""
    return values(page) == pytest.approx({s: getattr(design, s) for s in SYMBOLS}, rel=1e-6)


def title(page):
    return page.locator(".name strong").inner_text()


def test_every_slider_changes_its_number_the_pictures_and_the_address(page):
    for symbol in FREE:
        before, drawn, address = value(page, symbol), picture(page, "microlens") + picture(page), page.url
        slider(page, symbol).press("PageUp")
        idle(page)
        assert value(page, symbol) > before, symbol
        assert picture(page, "microlens") + picture(page) != drawn, symbol
        page.wait_for_function("(address) => location.href !== address", arg=address)


def test_a_slider_that_is_dragged_is_followed_and_is_one_step_back(page):
    box = slider(page, "D_F").bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.down()
    seen = set()
    for step in range(8):
        page.mouse.move(box["x"] + box["width"] * (0.5 + 0.04 * step), box["y"] + box["height"] / 2)
        idle(page)
        seen.add(number(page, "D_F").input_value())
    page.mouse.up()
    idle(page)
    assert len(seen) >= 6
    assert value(page, "D_F") > 2.9 * 1.5
    page.click("[data-testid=undo]")
    idle(page)
    assert shown(page, PAPER)
    assert page.locator("[data-testid=undo]").is_disabled()


def test_numbers_take_units_and_bad_ones_are_told_beside_their_field(page):
    write(page, "D_F", "3100 um")
    assert number(page, "D_F").input_value() == "3.1 mm"
    write(page, "D_F", "3.3")
    assert number(page, "D_F").input_value() == "3.3 mm"
    drawn = picture(page)
    for symbol, text, told in [
        ("D_F", "abc", "cannot read"),
        ("q", "5 deg", "unit of angle"),
        ("d_3", "400 mm", "not less than the focal-plane distance"),
        ("d", "-1 um", "greater than zero"),
    ]:
        write(page, symbol, text)
        assert told in fault(page, symbol).inner_text()
        assert number(page, symbol).input_value() == text
        assert number(page, symbol).get_attribute("aria-invalid") == "true"
        assert number(page, symbol).get_attribute("aria-describedby") == fault(page, symbol).get_attribute("id")
    assert picture(page) == drawn
    number(page, "D_F").press("Escape")
    idle(page)
    assert fault(page, "D_F").count() == 0
    assert value(page, "D_F") == 3.3
    write(page, "d_3", "100 mm")
    assert fault(page, "d_3").count() == 0
    assert picture(page) != drawn


def test_of_f_d_1_and_d_f_the_locked_one_follows(page):
    for follower, changed in [("d_f", "d_1"), ("d_1", "f"), ("f", "d_f")]:
        page.click(f"[data-field={follower}] .lock")
        idle(page)
        assert page.get_attribute(f"[data-field={follower}] .lock", "aria-pressed") == "true"
        assert slider(page, follower).is_disabled()
        assert not number(page, follower).is_editable()
        before = values(page)
        write(page, changed, f"{before[changed] * 1.02:.6g} mm")
        after = values(page)
        [kept] = {"f", "d_1", "d_f"} - {follower, changed}
        assert after[kept] == before[kept]
        assert after[follower] != before[follower]
        assert 1 / after["f"] == pytest.approx(1 / after["d_1"] + 1 / after["d_f"], rel=1e-6)  # Seven digits shown.


def test_every_preset_can_be_loaded_and_taken_back(page):
    for name in preset_names():
        page.select_option(".preset select", name)
        idle(page)
        assert title(page) == load(name).name
        assert shown(page, load(name))
        assert page.locator("[data-picture=meridional] svg").count() == 1
    for _ in preset_names()[:-1]:
        page.click("[data-testid=undo]")
        idle(page)
    assert title(page) == load(preset_names()[0]).name


def test_a_real_lens_is_traced_after_a_pause(page):
    page.select_option(".preset select", "paper-singlet")
    page.wait_for_selector("[data-testid=light-thin_lens_holds]", timeout=20_000)
    assert page.locator("[data-testid=light-tracing]").count() == 0
    assert not number(page, "f").is_editable()


def test_design_files_are_taken_and_wrong_ones_are_told(page, tmp_path):
    good, bad = tmp_path / "own.toml", tmp_path / "bad.toml"
    good.write_text(dumps(PAPER.replace({"name": "Own <b>design</b>"})))
    bad.write_text('name = "x"\n[main_lens]\ndiametre = "3 mm"\n')
    page.set_input_files("input[type=file]", bad)
    idle(page)
    assert "did you mean" in page.inner_text(".message")
    assert "bad.toml" in page.inner_text(".message")
    assert title(page) == PAPER.name
    page.click(".message button")
    idle(page)
    assert page.locator(".message").count() == 0
    page.set_input_files("input[type=file]", good)
    idle(page)
    assert title(page) == "Own <b>design</b>"
    for path, told in [(tmp_path / "none.toml", "no such file"), (bad, "did you mean")]:
        page.click("[data-testid=menu-open] summary")
        page.fill("[data-testid=menu-open] input[name=path]", str(path))
        page.press("[data-testid=menu-open] input[name=path]", "Enter")
        idle(page)
        assert told in page.inner_text(".message")
    page.click("[data-testid=menu-open] summary")
    page.fill("[data-testid=menu-open] input[name=path]", str(good))
    page.click("[data-testid=menu-open] button[type=submit]")
    idle(page)
    assert page.locator(".message").count() == 0


def test_undo_and_redo_by_button_and_key(page):
    for text in ("3 mm", "3.5 mm"):
        write(page, "D_F", text)
    page.locator("[data-testid=theme]").focus()
    page.keyboard.press("Control+z")
    idle(page)
    assert value(page, "D_F") == 3
    page.click("[data-testid=undo]")
    idle(page)
    assert shown(page, PAPER)
    page.click("[data-testid=redo]")
    idle(page)
    page.keyboard.press("Control+Shift+z")
    idle(page)
    assert value(page, "D_F") == 3.5
    assert page.locator("[data-testid=redo]").is_disabled()


def test_what_to_change_does_what_it_says(page):
    page.select_option(".preset select", "mismatched-borescope")
    idle(page)
    assert page.get_attribute("[data-testid=light-f_number_matched]", "data-level") == "fault"
    for key, symbol in [
        ("match-d_2", "d_2"),
        ("match-D_F", "D_F"),
        ("match-d_3", "d_3"),
        ("widest-field-d_3", "d_3"),
        ("telecentric", "d_3"),
    ]:
        page.click("[data-testid=menu-fixes] summary")
        button = page.locator(f"[data-testid=fix-{key}]")
        page.wait_for_function(
            "() => !(document.querySelector('.fixes .panel button')?.innerText ?? '…').includes('…')"
        )
        if button.is_disabled():
            page.keyboard.press("Escape")
            continue
        before = value(page, symbol)
        button.click()
        idle(page)
        assert value(page, symbol) != before
        if key.startswith("match"):
            assert page.get_attribute("[data-testid=light-f_number_matched]", "data-level") == "good"
        if key == "telecentric":
            assert value(page, "d_3") == pytest.approx(value(page, "f"), rel=1e-6)
        page.click("[data-testid=undo]")
        idle(page)


def test_a_verdict_tells_its_reason_on_request(page):
    write(page, "D", "20 mm")
    light = page.locator("[data-testid=light-field_undistorted]")
    assert light.get_attribute("data-level") == "fault"
    light.locator("summary").click()
    assert "cat's-eye" in light.locator(".panel").inner_text()
    page.keyboard.press("Escape")
    assert not light.locator(".panel").is_visible()


def test_the_pupil_is_dragged_in_its_plane(page):
    point = page.locator("[data-testid=design-point]")
    box = point.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    for step in range(1, 6):
        page.mouse.move(x - 8 * step, y + 6 * step)
        idle(page)
    moved = point.bounding_box()
    # The point follows the pointer, the axes stay.
    assert moved["x"] + moved["width"] / 2 == pytest.approx(x - 40, abs=2)
    assert moved["y"] + moved["height"] / 2 == pytest.approx(y + 30, abs=2)
    page.mouse.move(x - 4000, y + 4000)
    idle(page)
    assert value(page, "d_3") == 0
    assert value(page, "D_F") > 0
    page.mouse.move(x - 40, y + 30)
    page.mouse.up()
    idle(page)
    dragged = values(page)
    assert dragged["d_3"] < PAPER.d_3
    assert dragged["D_F"] < PAPER.D_F
    assert {s: dragged[s] for s in SYMBOLS if s not in ("d_3", "D_F")} == pytest.approx(
        {s: getattr(PAPER, s) for s in SYMBOLS if s not in ("d_3", "D_F")}, rel=1e-6
    )
    page.locator("[data-picture=matching-plane]").press("ArrowRight")
    idle(page)
    assert value(page, "d_3") > dragged["d_3"]
    for _ in range(2):
        page.click("[data-testid=undo]")
        idle(page)
    assert shown(page, PAPER)


def test_microlenses_are_chosen_by_name_click_and_key_and_shown_with_and_without(page):
    write(page, "D", "20 mm")
    seen = {}
    for name in ("corner", "edge", "centre"):
        page.click(f".card-microlens button:text-is('{name}')")
        idle(page)
        seen[name] = picture(page, "microlens")
        assert page.get_attribute(f".card-microlens button:text-is('{name}')", "aria-pressed") == "true"
    box = page.locator("[data-picture=mla-map]").bounding_box()
    page.mouse.click(box["x"] + 0.65 * box["width"], box["y"] + 0.3 * box["height"])
    idle(page)
    seen["clicked"] = picture(page, "microlens")
    page.locator("[data-picture=mla-map]").press("Shift+ArrowLeft")
    idle(page)
    seen["key"] = picture(page, "microlens")
    assert page.locator(".card-microlens .choices button[aria-pressed=true]").count() == 0
    for what in ("diffraction", "pixels"):
        page.uncheck(f".card-microlens label:has-text('{what}') input")
        idle(page)
        seen[what] = picture(page, "microlens")
    assert len(set(seen.values())) == len(seen)
    whole = {}
    for label in ("instrument", "with object"):
        page.click(f".card-meridional button:text-is('{label}')")
        idle(page)
        whole[label] = ">object plane<" in picture(page)
    assert whole == {"instrument": False, "with object": True}


@pytest.mark.parametrize(("width", "height"), [(1366, 768), (1920, 1080), (420, 900)])
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_it_fits_every_screen_in_both_themes(open_page, width, height, theme):
    page = open_page(width=width, height=height, theme=theme)
    assert page.evaluate("document.documentElement.dataset.theme") == theme
    for tab in page.locator("[role=tab]").all():
        tab.click()
        idle(page)
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        if width > 900:
            assert page.evaluate("document.documentElement.scrollHeight") <= height
        for box in page.locator(".picture:not(.space):visible").all():
            inside, outside = box.locator("svg").bounding_box(), box.bounding_box()
            if inside:
                assert inside["width"] <= outside["width"] + 1
    if width < 900:
        assert not slider(page, "D").is_visible()
        page.click("[data-testid=sheet]")
        page.locator("#tab-camera").click()
        assert slider(page, "D").is_visible()
        before = value(page, "D")
        slider(page, "D").press("ArrowLeft")
        idle(page)
        assert value(page, "D") < before


def test_the_theme_is_turned_and_kept(page):
    before = picture(page)
    page.click("[data-testid=theme]")
    idle(page)
    assert page.evaluate("document.documentElement.dataset.theme") == "dark"
    assert picture(page) != before
    page.reload()
    page.wait_for_selector("[data-picture=meridional] svg")
    assert page.evaluate("document.documentElement.dataset.theme") == "dark"


def test_every_control_has_a_name_and_is_reached_by_the_keyboard(page):
    nameless = page.evaluate(
        """() => [...document.querySelectorAll("button, input, select, summary, [tabindex]")]
        .filter((e) => e.checkVisibility() && !(e.getAttribute("aria-label") || e.textContent.trim()
            || e.labels?.length || e.getAttribute("aria-labelledby") || e.id === "views"))
        .map((e) => e.outerHTML.slice(0, 120))"""
    )
    assert nameless == []
    wanted = page.evaluate(
        """() => [...document.querySelectorAll("button, input, select, summary, [tabindex='0']")]
        .filter((e) => e.checkVisibility() && !e.disabled && e.tabIndex >= 0).length"""
    )
    page.evaluate("document.body.focus()")
    reached = set()
    for _ in range(wanted + 4):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.outerHTML.slice(0, 300)"))
        ring = page.evaluate("getComputedStyle(document.activeElement).outlineStyle")
        assert ring != "none" or page.evaluate("document.activeElement === document.body")
    assert len(reached) >= wanted
    page.focus("#tab-camera")
    page.keyboard.press("ArrowRight")
    idle(page)
    assert page.get_attribute("#tab-depth", "aria-selected") == "true"
    assert page.locator("[data-picture=depth] svg").is_visible()


def test_the_design_is_saved_as_it_is(page):
    write(page, "D_F", "3.25 mm")
    page.click("[data-testid=menu-save] summary")
    with page.expect_download() as saved:
        page.click("[data-testid=menu-save] button:has-text('Design')")
    assert saved.value.suggested_filename == "Zhou-2023-bench-system.toml"
    assert loads(saved.value.path().read_text()) == PAPER.replace(D_F=3.25)


def test_every_figure_is_saved_as_svg_and_png(page):
    for tab in page.locator("[role=tab]").all():
        tab.click()
        idle(page)
        for card in page.locator(".card:not(.card-space):has(.files):visible").all():
            name = re.search(r"card-([a-z-]+)", card.get_attribute("class"))[1]
            with page.expect_download() as saved:
                card.locator(".files button:text-is('SVG')").click()
            text = saved.value.path().read_text()
            assert text.startswith("<svg")
            assert f'data-testid="picture-{name}"' in text
            with page.expect_download() as saved:
                card.locator(".files button:text-is('PNG')").click()
            assert saved.value.suggested_filename.endswith(f"{name}.png")
            assert saved.value.path().read_bytes().startswith(b"\x89PNG\r\n")


def test_the_report_is_made_of_the_design_as_it_is(page):
    write(page, "D_F", "3.25 mm")
    page.click("[data-testid=menu-save] summary")
    with page.expect_download(timeout=60_000) as saved:
        page.click("[data-testid=menu-save] button:has-text('Report')")
    text = saved.value.path().read_text()
    assert text.lower().startswith("<!doctype html>")
    assert "3.25 mm" in text


def test_the_address_brings_everything_back(page, open_page):
    write(page, "D_F", "3.25 mm")
    page.click("[data-field=f] .lock")
    page.click(".card-microlens button:text-is('edge')")
    page.click("#tab-depth")
    idle(page)
    page.wait_for_timeout(300)
    address = page.url
    for other in (open_page(address), page):
        other.reload()
        other.wait_for_selector("[data-picture=depth] svg")
        assert value(other, "D_F") == 3.25
        assert other.get_attribute("[data-field=f] .lock", "aria-pressed") == "true"
        assert other.get_attribute("#tab-depth", "aria-selected") == "true"
        other.click("#tab-camera")
        idle(other)
        assert other.get_attribute(".card-microlens button:text-is('edge')", "aria-pressed") == "true"


def test_a_link_that_is_cut_off_is_told_and_the_design_stays(page):
    write(page, "D_F", "3.25 mm")
    page.wait_for_timeout(300)
    page.evaluate("location.hash = location.hash.slice(0, 40)")
    page.wait_for_selector(".message")
    assert "cut off or changed" in page.inner_text(".message")
    assert value(page, "D_F") == 3.25


def test_two_tabs_do_not_disturb_each_other(open_page):
    one, two = open_page(), open_page()
    write(one, "D_F", "3.25 mm")
    two.select_option(".preset select", "rigid-scope")
    idle(two)
    write(one, "d_3", "110 mm")
    assert value(one, "D_F") == 3.25
    assert title(one) == PAPER.name
    assert shown(two, load("rigid-scope"))
    two.click("[data-testid=undo]")
    idle(two)
    assert shown(two, PAPER)
    assert shown(one, PAPER.replace(D_F=3.25, d_3=110.0))
    two.close()
    write(one, "D_F", "3.5 mm")
    assert value(one, "D_F") == 3.5


def test_it_ends_while_pages_are_open(chromium):
    running = Explorer("--port", "0")
    page = chromium.new_page()
    page.goto(running.address)
    page.wait_for_selector(".picture svg:visible")
    assert running.end() == 0
    assert running.stderr == ""
    page.wait_for_selector(".gone")
    assert "roslf explore" in page.inner_text(".gone")
    page.close()


def test_the_instrument_is_drawn_in_3d_and_follows(page):
    page.click("#tab-space")
    page.wait_for_selector("[data-picture=space] canvas")
    page.wait_for_timeout(800)
    place = page.locator("[data-picture=space]")
    seen = [place.screenshot()]
    for act in (
        lambda: write(page, "d_3", "60 mm"),
        lambda: place.press("ArrowRight"),
        lambda: drag(page, place.bounding_box(), 60, 30),
        lambda: page.click("[data-testid=space-home]"),
        lambda: page.click("[data-testid=theme]"),
    ):
        act()
        page.wait_for_timeout(500)
        seen.append(place.screenshot())
    assert len(set(seen)) == len(seen)
    with page.expect_download() as saved:
        page.click(".card-space .files button")
    assert saved.value.path().read_bytes().startswith(b"\x89PNG")


def drag(page, box, right, down):
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + right, y + down, steps=4)
    page.mouse.up()
