"""A tab's session without a browser: whatever the page asks in whatever order, the page stays whole."""

import asyncio
import inspect
import os
import re
import time
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roslf_design.cli import main
from roslf_design.design import dumps, load, loads, preset_names
from roslf_design.drawing.theme import short
from roslf_design.evaluation import evaluate
from roslf_design.explorer import session as session_module
from roslf_design.explorer.jobs import PAUSE
from roslf_design.explorer.report_run import run_report
from roslf_design.explorer.runs import Run
from roslf_design.explorer.server import PAGE, _Tab
from roslf_design.explorer.session import DownloadError, Session
from roslf_design.explorer.state import FIELDS, LIGHT, STEPS, TABS
from roslf_design.explorer.view import DRAWINGS, awaited_lights, glance, lights, with_cards
from roslf_design.theory.depth_budget import WARMTH
from tests.evaluation.test_required import SCANNER
from tests.explorer.made import made_of
from tests.laws import LETTERS
from tests.pictures.designs import UNLIKE
from tests.reporting.made import few_builds, without_figures

PAPER = load("paper")
NUMBERS_GONE_WRONG = re.compile(r"\b(nan|NaN|inf|None|Infinity)\b")


def played(session, *requests):
    """The page's values after some requests, each with the page drawn after it."""

    async def play():
        page = session.page()
        session.opened("", "light", {})
        page = {**page, **session.page()}
        for name, *arguments in requests:
            getattr(session, name)(*arguments)
            page = {**page, **session.page()}
        session.close()
        return page

    return asyncio.run(play())


symbols = st.sampled_from([field.symbol for field in (*FIELDS, *LIGHT)])
TEXTS = ["3 mm", "0.2", "1e4 lx", "2 ms", "63 um", "1e-9 mm", "40 mm", "900 mm", "abc", "", "5 deg"]
pictures, pixels = st.sampled_from(list(DRAWINGS)), st.floats(0, 5000)
requests = st.one_of(
    st.tuples(st.just("slide"), symbols, st.integers(0, STEPS), st.sampled_from(["a", "b"])),
    st.tuples(st.just("write"), symbols, st.sampled_from(TEXTS)),
    st.tuples(st.just("follow"), st.sampled_from(["f", "d_1", "d_f", "D"])),
    st.tuples(st.just("load_path"), st.sampled_from([*preset_names(), "no such"])),
    st.tuples(st.just("look"), st.just("tab"), st.sampled_from([*TABS, "no such"])),
    st.tuples(st.just("look"), st.just("place"), st.sampled_from(["edge", "corner", "no such", (1.0, -2.0), (1e5, 0)])),
    st.tuples(st.just("point"), pictures, st.floats(-500, 2000), st.floats(-500, 2000), st.just("p")),
    st.tuples(st.just("nudge"), pictures, st.integers(-10, 10), st.integers(-10, 10)),
    st.tuples(st.just("look"), st.sampled_from(["diffraction", "pixels", "no such"]), st.booleans()),
    st.tuples(st.just("fix"), st.sampled_from(["match-d_2", "match-D_F", "telecentric", "no such"])),
    st.tuples(st.just("resize"), st.fixed_dictionaries({"microlens": st.tuples(pixels, pixels)})),
    st.sampled_from([("undo",), ("redo",), ("dismiss",), ("let_go",), ("space_again",), ("set_theme", "dark")]),
    st.tuples(st.just("restore"), st.text(LETTERS, max_size=20)),
)  # fmt: skip


@settings(max_examples=6)
@given(st.lists(requests, max_size=8))
def test_no_order_of_requests_breaks_the_page(asked):
    session = Session(PAPER)
    page = played(session, *asked)
    for name, drawing in DRAWINGS.items():
        svg = page[f"picture_{name.replace('-', '_')}"]
        if drawing.tab == page["tab"] and drawing.tab in ("camera", "depth") and not name.startswith("measured"):
            assert svg.startswith("<svg"), name
        bare = re.sub(r"<title.*?</title>|data:image/png;base64,[\w+/=]+", "", svg)
        assert not NUMBERS_GONE_WRONG.search(bare), name
    for group in page["groups"]:
        for field in group["fields"]:
            assert 0 <= field["position"] <= STEPS
            assert bool(field["fault"]) == (session.state.fault(field["symbol"]) is not None)


@pytest.mark.parametrize("name", ["paper-singlet", "cystoscope", "grin-needle", "pipe-bore"])
def test_every_view_is_drawn_of_presets_of_every_kind(name):
    page = played(Session(load(name)), *(("look", "tab", tab) for tab in TABS))
    for picture in ("meridional", "microlens", "mla_map", "matching_plane", "depth", "effects"):
        assert page[f"picture_{picture}"].startswith("<svg")
    assert page["space"]["meshes"]


def test_the_page_comes_in_parts_what_takes_no_time_first():
    async def play():
        session = Session(PAPER)
        session.opened("", "light", {})
        parts = [part() for part in session.parts()]
        whole = session.page()
        session.close()
        return parts, whole

    parts, whole = asyncio.run(play())
    assert {"groups", "tab", "title"} <= parts[0].keys()
    drawn = [[key for key in part if key.startswith("picture_")] for part in parts]
    assert drawn[0] == []
    assert [key for keys in drawn for key in keys] == [
        f"picture_{n}" for n in ("meridional", "microlens", "mla_map", "matching_plane")
    ]
    assert max(map(len, drawn)) == 1
    assert whole.keys() == set().union(*parts)


def undrawn(page):
    """Names of the pictures that a sentence stands for."""
    return {name for name in DRAWINGS if 'data-testid="undrawn"' in page.get(f"picture_{name.replace('-', '_')}", "")}


@pytest.mark.parametrize("pitch", ["24 mm", "40 mm", "1e15 mm"])
def test_a_pitch_wider_than_the_array_is_told_beside_it_and_leaves_the_page(pitch):
    session = Session(PAPER)
    page = played(session, ("write", "d", pitch))
    faults = {field["symbol"]: field["fault"] for group in page["groups"] for field in group["fields"]}
    assert "leaves no whole microlens" in faults["d"]
    assert not undrawn(page)
    assert page["lights"]
    page = played(session, ("write", "d", "63 um"))
    assert not any(field["fault"] for group in page["groups"] for field in group["fields"])


FAULTY = [
    ZeroDivisionError("float division by zero"),
    MemoryError(),
    IndexError("7"),
    RuntimeError("x"),
    OverflowError(),
]


@pytest.mark.parametrize(
    ("fault", "part"), [(fault, part) for fault, part in zip(FAULTY, 3 * ["inputs", "make"], strict=False)]
)
def test_whatever_goes_wrong_in_one_picture_leaves_the_others(monkeypatch, part, fault):
    def fail(*_):
        raise fault

    seen = [name for name, drawing in DRAWINGS.items() if drawing.tab == "camera"]
    monkeypatch.setitem(DRAWINGS, "microlens", DRAWINGS["microlens"]._replace(**{part: fail}))
    session = Session(PAPER)
    page = played(session, ("slide", "D_F", 700, "a"))
    assert undrawn(page) == {"microlens"}
    assert all(page[f"picture_{name.replace('-', '_')}"].startswith("<svg") for name in seen)
    assert "Image of a microlens cannot be drawn" in page["message"]
    with pytest.raises(DownloadError):
        asyncio.run(session.download("microlens.svg"))
    assert asyncio.run(session.download("mla-map.svg")).content.startswith(b"<?xml")


def test_words_of_an_abandoned_pass_are_said_of_their_own_design_only(monkeypatch):
    make = DRAWINGS["microlens"].make
    failing = DRAWINGS["microlens"]._replace(make=lambda *a: 1 / 0 if session.design == PAPER else make(*a))
    monkeypatch.setitem(DRAWINGS, "microlens", failing)
    session = Session(PAPER)

    async def play(*request):
        session.opened("", "light", {})
        for part in session.parts():
            if "picture_microlens" in part():
                break
        getattr(session, request[0])(*request[1:])
        page = session.page()
        session.close()
        return page["message"]

    assert "cannot be drawn" in asyncio.run(play("set_theme", "light"))
    session = Session(PAPER)
    assert asyncio.run(play("write", "D_F", "3.5 mm")) == ""


def test_a_theme_chosen_while_a_picture_is_drawn_is_the_next_ones(monkeypatch):
    make = DRAWINGS["microlens"].make
    session = Session(PAPER)
    slow = DRAWINGS["microlens"]._replace(make=lambda *a: (make(*a), session.set_theme("dark"))[0])
    light = played(Session(PAPER))["picture_microlens"]
    monkeypatch.setitem(DRAWINGS, "microlens", slow)
    assert played(session)["picture_microlens"] == light


class FaultyPage(Session):
    """The first of its parts fails, once and late."""

    fails = 1

    def parts(self):
        def first():
            time.sleep(0.2)
            self.fails -= 1
            return {} if self.fails < 0 else {}[0]

        yield first


def test_what_is_asked_while_a_part_fails_is_answered(monkeypatch, caplog):
    told = []
    monkeypatch.setattr(_Tab, "_update", lambda tab, values: "answered" in values and told.append(values["answered"]))

    async def play():
        tab = _Tab(FaultyPage(PAPER))
        handle = tab._handler("undo")
        handle()
        await asyncio.sleep(0.05)
        handle()
        await tab._showing
        await tab.close()

    asyncio.run(play())
    assert told[0] == 1
    assert told[-1] == 2
    assert "KeyError" in caplog.text


class ManyParts(Session):
    """Parts of values that stay as they are."""

    def parts(self):
        return iter([lambda k=k: {f"{k} {n}": 0 for n in range(10 if k == 0 else 1)} for k in range(9)])


def test_what_goes_on_by_itself_sends_what_is_fresh_in_one_order(monkeypatch):
    """Of a set's order, which may turn from one look to the next, every part would be sent as news."""
    told = []
    monkeypatch.setattr(_Tab, "_update", lambda tab, values: "fresh" in values and told.append(list(values["fresh"])))

    async def play():
        tab = _Tab(ManyParts(PAPER))
        for _ in range(3):
            tab.push()
            await tab._showing
        await tab.close()

    asyncio.run(play())
    assert len(told[8]) == 18
    assert told[9:] == [told[8]] * 18


@pytest.mark.parametrize(("fault", "preset"), [(FAULTY[0], "paper"), (FAULTY[1], "paper-singlet")])
def test_a_design_that_cannot_be_evaluated_leaves_its_pictures_and_its_numbers(monkeypatch, preset, fault):
    def fail(*_):
        raise fault

    for name in ("evaluate", "proposals", "scene"):
        monkeypatch.setattr(session_module, name, fail)
    session = Session(load(preset))

    async def play():
        session.opened("", "light", {})
        page = session.page()
        assert undrawn(page) == set()
        assert page["lights"][0]["level"] == "fault"
        assert "cannot be found" in page["lights"][0]["plain"]
        await asyncio.sleep(2 * PAUSE)  # until all that waited for the design to stand still is done
        assert [fix["label"] for fix in session.page()["fixes"]] == ["No proposals"]
        session.ask("look", "tab", "depth")
        page = session.page()
        assert "Depth is unknown" in page["depth_known"]["text"]
        assert undrawn(page) == {"effects"}
        session.ask("look", "tab", "space")
        assert "3D cannot be drawn" in session.page()["message"]
        for request in (("fix", "match-d_2"), ("write", "D_F", "3.1 mm"), ("look", "tab", "camera")):
            session.ask(*request)
            session.page()
        session.close()

    asyncio.run(play())
    assert session.design.D_F == 3.1


def test_a_scene_that_cannot_be_drawn_leaves_nothing_of_the_one_before(monkeypatch):
    session = Session(PAPER)

    async def play():
        session.opened("", "light", {})
        session.look("tab", "space")
        whole = session.page()["space"]
        with monkeypatch.context() as patched:
            patched.setattr(session_module, "scene", lambda *_: 1 / 0)
            session.write("D_F", "3.5 mm")
            empty = session.page()["space"]
            assert session.page()["space"] == empty
        session.write("D_F", "3.6 mm")
        again = session.page()["space"]
        session.close()
        return whole, empty, again

    whole, empty, again = asyncio.run(play())
    assert empty["meshes"] == dict.fromkeys(whole["meshes"])
    assert (empty["since"], empty["ground"]) == (whole["serial"], whole["ground"])
    assert again["meshes"].keys() == whole["meshes"].keys()
    assert None not in again["meshes"].values()


def field_of(page, symbol):
    return next(f for group in page["light_groups"] for f in group["fields"] if f["symbol"] == symbol)


def test_light_and_texture_are_set_left_out_and_told():
    depth = ("look", "tab", "depth")
    before = played(Session(PAPER), depth)
    assert f"{evaluate(PAPER).depth.sigma_z_mm:.3g} mm" in before["depth_known"]["text"]
    session = Session(PAPER)
    page = played(
        session,
        depth,
        ("write", "light.exposure", "1"),
        ("write", "depth.window", "9"),
        ("slide", "depth.contrast", 0, "a"),
    )
    light, known = session.design.light, session.design.depth
    assert (light.exposure, known.window, known.contrast) == (1e-3, 9, 1e-3)
    expected = evaluate(session.design).depth.sigma_z_mm
    assert f"{expected:.3g} mm" in page["depth_known"]["text"]
    assert {row["label"]: row["value"] for row in page["depth_known"]["rows"]}["microlenses matched"].startswith(
        "9 x 9"
    )
    assert field_of(page, "light.exposure")["text"] == "1 ms"
    page = played(session, depth, ("write", "light.exposure", ""), ("write", "depth.disparity_error", "0.1"))
    assert session.design.light.exposure is None
    assert "1.25 mm" in page["depth_known"]["text"]
    page = played(session, depth, ("write", "depth.window", "9.5"), ("write", "depth.contrast", "2"))
    assert field_of(page, "depth.window")["fault"]
    assert field_of(page, "depth.contrast")["fault"]
    assert loads(dumps(session.design)).depth == session.design.depth
    bright = Session(load("paper").replace({"light.radiance": 4.0}))
    assert not field_of(played(bright, depth), "light.illuminance")["open"]


def test_what_makes_views_differ_is_set_and_depth_expected_told_with_its_terms():
    session, depth = Session(PAPER), ("look", "tab", "depth")
    places = ("depth.view_mismatch", "sensor.prnu", "sensor.dsnu", "light.veil")
    page = played(session, depth, *(("slide", place, STEPS // 2, "a") for place in places))
    design = session.design
    assert (design.depth.view_mismatch, design.sensor.prnu, design.sensor.dsnu) == (0.1, 0.025, 50.0)
    budget = evaluate(design).depth_budget
    assert budget.words in page["depth_known"]["text"]
    rows = {row["label"]: row["value"] for row in page["depth_known"]["rows"]}
    told = {term.name: float(term.u_mm) for term in budget.terms if term.u_mm is not None}
    assert all(rows[f"from {name}"].startswith(f"{u:.3g} mm") for name, u in told.items())
    page = played(session, ("write", "light.veil", "1.5"), *(("write", place, "0") for place in places[:3]))
    assert field_of(page, "light.veil")["fault"]
    assert "from view mismatch" in {row["label"] for row in page["depth_known"]["rows"]}
    assert (session.design.depth.view_mismatch, session.design.sensor.dsnu) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("changes", "text", "remedy"),
    [
        ({"light.exposure": 1.0}, "fewer electrons", "shorter exposure"),
        ({"depth.period": 0.1}, "No texture", "detail"),
        ({"main_lens.diameter": 20.0}, "stops cut images, to nothing at the corner", "wider lens"),
    ],
)
def test_where_depth_is_unknown_is_hatched_and_told(changes, text, remedy):
    page = played(Session(PAPER.replace(changes)), ("look", "tab", "depth"))
    assert text in page["depth_known"]["text"]
    assert remedy in page["depth_known"]["remedy"]
    assert 'data-testid="unknown"' in page["picture_depth_field"]
    assert ('data-testid="unknown"' in page["picture_depth"]) == ("stops" not in text)


@pytest.mark.parametrize(
    ("name", "changes", "cause", "remedy"),
    [
        ("cystoscope", {}, "light falls with the field's angle (38.7 % left)", "smaller sensor"),
        ("paper", {"main_lens.diameter": 36.0}, "stops cut images, to", "wider lens"),
    ],
)
def test_what_spoils_depth_towards_the_corner_is_what_falls_there(name, changes, cause, remedy):
    design = load(name).replace(changes)
    known = played(Session(design), ("look", "tab", "depth"))["depth_known"]
    assert f"beyond, {cause}" in known["text"]
    assert remedy in known["remedy"]
    # Where no stop cuts, shot noise grows as light falls: sigma goes with one over its root.
    result = evaluate(design)
    grown = result.fields[-1].sigma_z_mm / result.fields[0].sigma_z_mm
    by_light = result.answer.corner_slant**-0.5
    assert (grown == pytest.approx(by_light, rel=0.02)) == (name == "cystoscope")


def test_only_what_is_seen_is_drawn_and_only_what_has_changed_drawn_again(monkeypatch):
    drawn = []
    for name, drawing in list(DRAWINGS.items()):
        noted = drawing._replace(make=lambda *a, make=drawing.make, name=name: drawn.append(name) or make(*a))
        monkeypatch.setitem(DRAWINGS, name, noted)
    session = Session(PAPER)
    played(session)
    assert sorted(drawn) == ["matching-plane", "meridional", "microlens", "mla-map"]
    drawn.clear()
    played(session, ("look", "place", "corner"))
    assert sorted(drawn) == ["microlens", "mla-map"]


def test_the_3d_scene_is_sent_in_parts_and_whole_again_when_asked():
    session = Session(PAPER)

    async def play():
        session.opened("", "light", {})
        session.look("tab", "space")
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


ODD = (None, True, -1, 1e400, float("nan"), "", "x", "D_F", [], [1], {}, {"a": 1}, {"trials": ["x"]})
COUNTS = {name: len(inspect.signature(getattr(Session, name)).parameters) - 1 for name in Session.requests}
ODD_REQUESTS = [(name, (odd,) * many) for name, count in COUNTS.items() for many in range(count + 2) for odd in ODD]


def test_malformed_requests_are_answered(monkeypatch):
    monkeypatch.setattr(Run, "begin", lambda *asked: pytest.fail(f"{asked} started a run"))
    session = Session(PAPER)

    async def play():
        for name, arguments in ODD_REQUESTS:
            session.ask("dismiss")
            session.ask(name, *arguments)
            # A scalar where a slider's place and gesture are asked for: told, and nothing changed.
            if name == "slide":
                assert "(slide, argument" in session.state.message, arguments
        session.close()

    asyncio.run(play())
    assert len(ODD_REQUESTS) > 600
    assert session.design == PAPER


def test_a_file_of_the_machine_may_be_no_pipe_and_no_device(tmp_path):
    os.mkfifo(tmp_path / "pipe.toml")
    for place in (str(tmp_path / "pipe.toml"), "/dev/zero"):
        page = played(Session(PAPER), ("load_path", place))
        assert page["message"] == f"{place}: is a pipe or a device; name a file on disk"
    for place, said in (
        ("x" * 5000, "cannot be read"),
        ("a\0b.toml", "cannot be read"),
        (str(tmp_path), "is a folder"),
    ):
        assert said in played(Session(PAPER), ("load_path", place))["message"]


def test_an_uploaded_design_opens_no_lens_file(tmp_path):
    os.mkfifo(tmp_path / "lens.toml")
    text = dumps(load("paper-singlet")).replace("LA1050-A", str(tmp_path / "lens.toml"))
    assert "may not open files" in played(Session(PAPER), ("load_text", "mine.toml", text))["message"]


def test_a_design_that_requires_what_is_no_quantity_is_refused(tmp_path):
    file = tmp_path / "x.toml"
    required = "[required]\nu_zz = {max = 1}\n"
    for text in (dumps(PAPER), dumps(PAPER).replace("[sensor]", "[sensor]\nwell = 3")):
        file.write_text(text + required)
        for load_it in (("load_text", "x.toml", file.read_text()), ("load_path", str(file))):
            message = played(Session(PAPER), load_it)["message"]
            assert "required.u_zz: 'u_zz' is no" in message
            assert message.startswith(load_it[1])
            assert ("sensor.well" in message) == ("well" in text)  # all faults at once


def test_a_file_too_large_for_a_design_is_refused():
    page = played(Session(PAPER), ("load_text", "big.toml", "x" * 1_000_001))
    assert page["message"] == "big.toml: is too large for a design file"


def test_the_report_is_made_of_the_design_as_it_is_in_a_process_of_its_own(monkeypatch):
    monkeypatch.setattr(session_module, "run_report", made_of)
    session = Session(PAPER)
    told = []
    session.on_news = lambda: told.append(session.page()["reporting"])
    with pytest.raises(DownloadError, match="not the design"):
        asyncio.run(session.download("report.html"))
    session.write("D_F", "3.25 mm")
    file = asyncio.run(session.download("report.html"))
    assert (file.name, file.kind) == ("Zhou-2023-bench-system-report.html", "text/html")
    assert loads(file.content.decode()) == session.design
    assert told[0] == "running: starting"
    assert session.page()["reporting"] == ""


def test_the_report_is_the_one_of_its_command_and_tells_how_much_is_done(monkeypatch, tmp_path, capsys):
    few_builds(monkeypatch)
    without_figures(monkeypatch)
    shares = []
    page = run_report(PAPER, lambda share, text: shares.append(share))
    assert None not in shares
    assert shares == sorted(shares)
    monkeypatch.chdir(tmp_path)
    Path("Zhou-2023-bench-system.toml").write_text(dumps(PAPER))
    monkeypatch.setattr("roslf_design.commands.terminal.LOGGED", 0.0)
    assert main(["report", "Zhou-2023-bench-system.toml", "-o", "report"]) == 0
    log = capsys.readouterr().err
    assert re.search(r"^report: .*: \d+%, about [\d.e+-]+ s left$", log, re.MULTILINE)
    assert page == Path("report/index.html").read_bytes()


def test_there_is_no_other_download():
    for name in ("passwd", "no-such.svg", "front.svg", "report", "../design.toml"):
        assert asyncio.run(Session(PAPER).download(name)) is None


LIT = (*map(load, [*UNLIKE, "mismatched-borescope"]), PAPER.replace(D=20.0, d_3=180.0))
"""Designs of good and of bad verdicts, the last of them dark."""


@pytest.mark.parametrize("design", LIT, ids=lambda design: design.name)
def test_lights_say_what_the_verdicts_say_in_few_letters(design):
    evaluation = evaluate(design.thin_twin)
    shown = lights(evaluation)
    assert [(x["name"], x["level"], x["plain"]) for x in shown] == [
        (v.name, v.level, v.text) for v in evaluation.verdicts
    ]
    asked = {one.verdict.name for one in evaluation.required}  # in the words of the design's own limit
    assert all(0 < len(x["title"]) <= 14 and 0 < len(x["margin"]) <= 14 for x in shown if x["name"] not in asked)


def test_what_is_required_is_one_light():
    limits = [{"at": 20.0, "max": 0.5}, {"at": 40.0, "max": 1e-3}]
    both = {"u_z_mm": limits, "outer_diameter_mm": {"max": 4.0}}
    evaluation = evaluate(load("rigid-scope").replace({"required": both}))
    asked, *others = lights(evaluation)
    assert [light["name"] for light in others] == [verdict.name for verdict in evaluation.verdicts[3:]]
    # One light for all of them: the worst one's colour, the first that is missed, and every sentence behind it.
    assert (asked["title"], asked["level"]) == ("required", "fault")
    assert asked["margin"] == "2 of 3 met, 1 as drawn; missed: depth, expected at 40 mm"
    assert asked["plain"].splitlines() == [verdict.text for verdict in evaluation.verdicts[:3]]
    contrast = {"u_z_mm": {"max": 1.0}, "mtf50_lp_per_mm": {"min": 2.0}}
    reserved = lights(evaluate(load("rigid-scope").replace({"required": contrast})))[0]
    assert (reserved["margin"], reserved["level"]) == ("2 of 2 met, 2 with a reservation", "limit")
    astray = loads(SCANNER).replace({"required": {"u_z_mm": {"max": 1e3}, "outer_diameter_mm": {"max": 99.0}}})
    margin = lights(evaluate(astray))[0]["margin"]
    assert margin == "1 of 2 met, 1 not known"
    met = {"field_of_view_deg": {"min": 1.0}, "outer_diameter_mm": {"max": 4.0}}
    whole = lights(evaluate(load("rigid-scope").replace({"required": met})))[0]
    assert (whole["margin"], whole["level"]) == ("2 of 2 met", "good")
    one = load("rigid-scope").replace({"required": {"outer_diameter_mm": {"max": 4.0}}})
    alone = lights(evaluate(one))[0]
    assert (alone["title"], alone["margin"], alone["level"]) == ("outer diameter", "3 of at most 4 mm", "good")


def test_the_light_of_fast_microlenses_has_their_own_f_number():
    fast = {light["name"]: light for light in lights(evaluate(load("rigid-scope").replace({"f_ml": 0.04})))}
    assert fast["microlens_speed"]["margin"] == "f/2"


def test_lights_of_a_real_lens_tell_the_traced_field():
    traced = {light["name"]: light for light in lights(evaluate(load("paper-singlet")))}
    assert traced["field_undistorted"]["level"] == "fault"
    assert traced["field_undistorted"]["margin"].startswith("to ")
    assert traced["thin_lens_holds"]["margin"].endswith(" px")


WARM = {"environment": {"range": (5.0, 30.0), "calibrated_at": 20.0, "housing": "titanium"}}


@pytest.mark.parametrize("warmed", [{}, WARM], ids=["room", "warm"])
@pytest.mark.parametrize("name", [name for name in preset_names() if load(name).lens is not None])
def test_behind_a_real_lens_the_explorer_tells_what_evaluate_tells(name, warmed):
    design = load(name).replace(warmed)
    result, session = evaluate(design), Session(design)
    expanded = f"{short(2 * float(result.depth_budget.u_z_mm), 3)} mm"

    async def play():
        session.opened("", "light", {})
        session.ask("look", "tab", "depth")
        first = session.page()
        session.ask("look", "tab", "camera")
        map_first = session.page()["picture_mla_map"]
        for _ in range(400):
            await asyncio.sleep(0.05)
            if not any(light["level"] == "wait" for light in session.page()["lights"]):
                break
        later = session.page()
        session.ask("look", "tab", "depth")
        last = session.page()
        session.close()
        return first, map_first, later, last

    first, map_first, later, last = asyncio.run(play())
    # Depth is the one of the lens's own glass at once, in words and in both pictures.
    for page in (first, last):
        words = "Depth, expected, lengths as drawn, in the plane in focus: U = ± "
        assert page["depth_known"]["text"].startswith(words + expanded)
        assert f": ± {expanded} at the focal plane" in page["picture_depth"]
        assert f": ± {expanded} at its centre" in page["picture_depth_field"]
    # What rays tell waits for them.
    assert {light["level"] for light in first["lights"]} == {"wait"}
    assert all("tracing" in first[words] for words in ("glance_of", "rays_of"))
    assert "LA1050-A" in first["awaited"]
    assert "thin-lens model" in first["awaited"]
    assert "traced" not in map_first
    assert later["lights"] == lights(result)
    assert later["glance"] == glance(result)
    assert ("tracing" not in later["glance_of"], later["rays_of"]) == (True, "traced")
    assert later["awaited"] == ""
    thin_lens = next(light for light in later["lights"] if light["name"] == "thin_lens_holds")
    moved = float(re.search(r"by ([\d.]+) px", thin_lens["plain"])[1])
    assert float(thin_lens["margin"].removesuffix(" px")) == pytest.approx(moved, rel=0.05)
    assert thin_lens["level"] == "fault"
    assert "no whole image at" in thin_lens["plain"]
    # On the field verdict, numbers, map and proposals agree.
    lens = result.real_lens
    assert f"traced: whole to {lens.x_ml_max_mm:.4g} mm" in later["picture_mla_map"]
    assert {"label": "undistorted field radius", "value": f"{short(lens.x0_max_mm, 5)} mm"} in later["glance"]
    assert all((fix["why_not"] or fix["outcome"]).startswith("thin lens: ") for fix in later["fixes"])
    assert ("calibrated_at" in last["depth_known"]["remedy"]) == (result.depth_budget.largest.name == WARMTH)


# Page and server agree on what the page may ask.

SOURCES = [(PAGE / name).read_text() for name in ("page.html", "explorer.js")]
REQUEST = re.compile(r"""\bask\(["'](\w+)["']|\baskAs\([^,]+, ["'](\w+)["']""")


def test_all_that_the_page_asks_is_answered_and_nothing_else_is_offered():
    asked = {first or second for text in SOURCES for first, second in REQUEST.findall(text)}
    assert asked == set(Session.requests)
    assert all(callable(getattr(Session, name)) for name in Session.requests)


def test_every_picture_has_its_place_on_the_page():
    assert set(re.findall(r'<rx-picture name="([a-z-]+)"', with_cards(SOURCES[0]))) == set(DRAWINGS)


def test_nothing_of_the_page_comes_from_elsewhere():
    for path in PAGE.iterdir():
        links = re.findall(r"(?:https?:)?//[a-z][\w.-]+\.[a-z]+", path.read_text())
        assert [link for link in links if "www.w3.org" not in link] == [], path.name


def test_a_saved_picture_of_a_real_lenss_thin_twin_says_so():
    for name, twin in (("paper", ""), ("paper-singlet", "-thin-lens")):
        file = asyncio.run(Session(load(name)).download("microlens.svg"))
        assert file.name.endswith(f"{twin}-microlens.svg")
        assert ("thin-lens" in file.name) == bool(twin)


@pytest.mark.parametrize("name", ["rigid-scope", "paper-singlet", "video-otoscope"])
def test_verdicts_have_their_room_before_any_is_known(name):
    design = load(name)
    first = Session(design).page()["lights"]
    assert first == awaited_lights(design)
    assert {light["level"] for light in first} == {"wait"}
    assert {light["name"] for light in first} - {"required"} <= {light["name"] for light in lights(evaluate(design))}
