"""A tab's session without a browser: whatever the page asks in whatever order, the page stays whole."""

import asyncio

import pytest

from roslf_design.design import load, preset_names
from roslf_design.explorer.drawing import DRAWINGS
from roslf_design.explorer.link import TABS
from roslf_design.explorer.session import Session

PAPER = load("paper")


def played(session, *requests):
    """The page's values after some requests, each with the page drawn after it."""

    async def play():
        session.opened("", "light", {})
        page = session.page()
        for name, *arguments in requests:
            getattr(session, name)(*arguments)
            page = {**page, **session.page()}
        session.close()
        return page

    return asyncio.run(play())


@pytest.mark.parametrize("name", preset_names())
def test_every_view_of_every_preset_is_drawn(name):
    page = played(Session(load(name)), *(("show_tab", tab) for tab in TABS))
    for picture in ("meridional", "microlens", "mla_map", "matching_plane", "depth", "effects"):
        assert page[f"picture_{picture}"].startswith("<svg")
    assert page["space"]["meshes"]


def test_only_what_is_seen_is_drawn_and_only_what_has_changed_drawn_again(monkeypatch):
    drawn = []
    for name, drawing in list(DRAWINGS.items()):
        noted = drawing._replace(make=lambda *a, make=drawing.make, name=name: drawn.append(name) or make(*a))
        monkeypatch.setitem(DRAWINGS, name, noted)
    session = Session(PAPER)
    played(session)
    assert sorted(drawn) == ["matching-plane", "meridional", "microlens", "mla-map"]
    drawn.clear()
    played(session, ("choose", "corner"))
    assert sorted(drawn) == ["microlens", "mla-map"]


def test_the_3d_scene_is_sent_in_parts_and_whole_again_when_asked():
    session = Session(PAPER)

    async def play():
        session.opened("", "light", {})
        session.show_tab("space")
        whole = session.page()["space"]
        same = session.page()["space"]
        session.write("D_F", "3.5 mm")
        part = session.page()["space"]
        session.space_again()
        again = session.page()["space"]
        session.close()
        return whole, same, part, again

    whole, same, part, again = asyncio.run(play())
    assert same == whole
    assert (whole["since"], part["since"], again["since"]) == (0, whole["serial"], 0)
    assert set(part["meshes"]) < set(whole["meshes"]) == set(again["meshes"])
    assert again["serial"] == part["serial"] + 1


def test_proposals_come_after_a_pause_even_while_a_run_is_looked_after():
    session = Session(PAPER)
    news = []
    session.on_news = lambda: news.append(session.page()["fixes"])

    async def play():
        session.opened("", "light", {})
        session.start_run("tolerance", {"trials": ["1000000"]})
        session.page()
        for _ in range(200):
            await asyncio.sleep(0.05)
            if news and news[-1] and news[-1][0]["outcome"]:
                break
        session.close()

    asyncio.run(play())
    assert news[-1][0]["outcome"]


def test_a_file_too_large_for_a_design_is_refused():
    page = played(Session(PAPER), ("load_text", "big.toml", "x" * 1_000_001))
    assert page["message"] == "big.toml: is too large for a design file"
