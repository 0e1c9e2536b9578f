"""Page and server agree on what the page may ask, without a browser."""

import re

from roslf_design.explorer import front, layout
from roslf_design.explorer.drawing import DRAWINGS
from roslf_design.explorer.session import Session

HERE = front.HERE
SOURCES = [layout.page(), (HERE / "static" / "explorer.js").read_text()]
REQUEST = re.compile(r"""\bask\(["'](\w+)["']|\baskAs\([^,]+, ["'](\w+)["']""")


def asked():
    return {first or second for text in SOURCES for first, second in REQUEST.findall(text)}


def test_all_that_the_page_asks_is_answered_and_nothing_else_is_offered():
    assert asked() == set(Session.requests)
    assert all(callable(getattr(Session, name)) for name in Session.requests)


def test_every_picture_has_its_place_on_the_page():
    places = set(re.findall(r'<rx-picture name="([a-z-]+)"', SOURCES[0]))
    assert places == set(DRAWINGS)


def test_nothing_of_the_page_comes_from_elsewhere():
    for path in [*HERE.glob("layout/*.html"), *HERE.glob("static/*")]:
        links = re.findall(r"(?:https?:)?//[a-z][\w.-]+\.[a-z]+", path.read_text())
        assert [link for link in links if "www.w3.org" not in link] == [], path.name
