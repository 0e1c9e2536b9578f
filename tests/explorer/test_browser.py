"""The explorer as its user sees it, in headless Chromium."""

import re

import pytest

FIELDS = ["D", "f", "d_f", "d_1", "D_F", "d_3", "d", "f_ml", "d_2", "q", "wavelength"]


def number(page, symbol):
    return page.locator(f"[data-field={symbol}] .number")


def idle(page):
    """Wait until the server has answered everything and the page shows it."""
    page.wait_for_function("!document.documentElement.dataset.busy")
    page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")


def write(page, symbol, text):
    number(page, symbol).fill(text)
    number(page, symbol).press("Enter")
    idle(page)


@pytest.mark.parametrize("symbol", [symbol for symbol in FIELDS if symbol != "d_f"])
def test_every_slider_changes_its_number(page, symbol):
    before = number(page, symbol).input_value()
    page.locator(f"[data-field={symbol}] .slider").press("ArrowRight")
    page.wait_for_function(
        "([symbol, before]) => document.querySelector(`[data-field=${symbol}] .number`).value !== before",
        arg=[symbol, before],
    )
    after = number(page, symbol).input_value()
    assert re.fullmatch(r"[\d.]+ (mm|um|nm)", after)
    assert float(after.split()[0]) > float(before.split()[0])
