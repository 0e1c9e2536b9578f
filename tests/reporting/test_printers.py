"""Blocks, tables, symbols and numbers, and the printers that set them: HTML, PDF, terminal."""

import io
import re
import shutil
import subprocess
import zlib
from dataclasses import replace

import pytest
from rich.console import Console

from roslf_design.commands.results import print_blocks
from roslf_design.design import PATHS, load
from roslf_design.reporting import printers
from roslf_design.reporting.blocks import (
    Bullets,
    Code,
    Figure,
    Paragraph,
    Report,
    Section,
    Statement,
    Statements,
    Table,
)
from roslf_design.reporting.design.figures import dimensions_sheet
from roslf_design.reporting.printers import render_pdf
from roslf_design.tables import print_table
from roslf_design.theory.quantities import QUANTITIES, in_words
from roslf_design.tolerancing.metrics import METRICS
from roslf_design.words import about_time, apart, length, lux, number, place, rounded, sentence, spans, to_html, within

SVG = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9" width="9pt" height="9pt"><text y="9">word</text></svg>'
NASTY = '#panic("no") $x$ *a* _b_ \\ "quoted" <label> @ref #eval("1") [c]'
LIMITS = (
    ("centre_error_px@2", "-0.00012345", "measured with a gauge that lies about, in words that may wrap", "0"),
    ("non_distortion_room_mm@0", "1.00506", "by hand", "12"),
    ("all together", "", "", "1"),
)
HEADINGS = ("metric@field", "std. dev.", "where it comes from", "undefined")


def report(text="plain"):
    blocks = (
        Paragraph(text),
        Statements((Statement("good", text, text), Statement("caution", "mind"))),
        Table((("a", "1.5 mm", text), ("b", "-", "")), "ldl", ("x", "y", "z"), text, text, faint=(1,)),
        Table((("a", "1.5 mm", text),), "ldl"),
        Figure("drawing", text, text, SVG, text),
        Bullets((text,)),
        Code(text, text),
    )
    return Report(text, text, (Section(text, blocks),), text)


def pages(report, tmp_path, paper="a4"):
    """Words of each page as a reader would select them."""
    pytest.importorskip("typst", reason="the typst package is not installed")
    if shutil.which("pdftotext") is None:
        pytest.skip("no pdftotext; on Debian: apt-get install poppler-utils")
    (tmp_path / "report.pdf").write_bytes(render_pdf(report, paper))
    command = ["pdftotext", "-layout", tmp_path / "report.pdf", "-"]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.split("\f")[:-1]


def test_figures_a_little_smaller_fill_pages(tmp_path, monkeypatch):
    """Three stand on a page, but for the first with its title, unless they are a little smaller."""
    tall = SVG.replace('viewBox="0 0 9 9" width="9pt" height="9pt"', 'viewBox="0 0 768 322" width="768" height="322"')
    figures = tuple(Figure(f"f{n}", f"Figure {n}", "what it shows", tall) for n in range(8))
    whole = Report("title", "", (Section("Figures", figures), Section("Text", (Paragraph("end"),))))
    told = []
    filling = printers._filling
    monkeypatch.setattr(printers, "_filling", lambda *given: told.append(filling(*given)) or told[-1])
    assert len(pages(whole, tmp_path)) == 3
    assert 0.75 <= min(told[0].values()) <= max(told[0].values()) < 1
    monkeypatch.setattr(printers, "_filling", lambda spots, shares: {})
    assert len(pages(whole, tmp_path)) == 4


def test_a_drawing_in_two_parts_makes_room_with_both(tmp_path):
    """Half of the drawing and the figure behind it could not get small enough."""
    size = 'viewBox="0 0 768 {0}" width="768" height="{0}"'
    first, second = (
        SVG.replace('viewBox="0 0 9 9" width="9pt" height="9pt"', size.format(tall)) for tall in (740, 300)
    )
    figures = (Figure("f1", "in parts", "what it shows", first, breaks=0.5), Figure("f2", "behind", "it", second))
    (page,) = pages(Report("title", "", (Section("Figures", figures),)), tmp_path)
    assert "behind" in page


def test_a_file_of_short_lines_stands_in_two_columns_and_is_read_in_order(tmp_path):
    parts = ["\n".join([f"[part{n}]", *(f"key{n}{key} = 1" for key in range(5))]) for n in range(4)]
    (page,) = pages(Report("title", "", (Section("File", (Code("\n\n".join(parts)),)),)), tmp_path)
    assert re.search(r"\[part0\] +\[part2\]", page)
    command = ["pdftotext", "-raw", tmp_path / "report.pdf", "-"]
    text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert re.findall(r"\[part\d\]|key\d\d", text) == re.findall(r"\[part\d\]|key\d\d", "\n".join(parts))


def lines_and(count, *blocks):
    return Report("title", "", (Section("Text", (*(Paragraph(f"line{n}") for n in range(count)), *blocks)),), "")


def test_a_figure_stands_where_it_is_told_of_where_it_fits(tmp_path, monkeypatch):
    """Not at the page's foot, behind a gap that the table does not fit into."""
    monkeypatch.setattr(printers, "MOST_ABOVE", 0.0)
    monkeypatch.setattr(printers, "LEAST_END", 0.0)
    tall = SVG.replace('viewBox="0 0 9 9" width="9pt" height="9pt"', 'viewBox="0 0 768 500" width="768" height="500"')
    after = (Figure("f", "drawn", "what it shows", tall), Table((("row", "1"),) * 8, "ll"))
    first, second = pages(lines_and(17, *after), tmp_path)
    assert first.split("line16")[1].split("drawn")[0].count("\n") <= 3
    assert second.count("row") == 8


def test_no_figure_stands_in_the_section_behind_its_own(tmp_path):
    """At a page's foot it stood under the head of the section that begins above it."""
    tall = SVG.replace('viewBox="0 0 9 9" width="9pt" height="9pt"', 'viewBox="0 0 768 400" width="768" height="400"')
    figures = tuple(Figure(f"f{n}", f"drawn{n}", "what it shows", tall) for n in range(2))
    for lines in range(20, 36, 3):
        (own,) = lines_and(lines, *figures, Bullets(("note",))).sections
        text = "".join(pages(Report("t", "", (own, Section("Other", (Paragraph("behind"),)))), tmp_path))
        assert text.index("drawn0") < text.index("drawn1") < text.index("Other"), lines


@pytest.mark.parametrize("lines", range(2, 44, 6))
def test_no_figure_stands_before_the_head_of_its_section(tmp_path, lines):
    """At the head of the page that its section begins on it stood above what is before that."""
    tall = SVG.replace('viewBox="0 0 9 9" width="9pt" height="9pt"', 'viewBox="0 0 768 420" width="768" height="420"')
    (before,) = lines_and(lines).sections
    figures = tuple(Figure(f"f{n}", f"drawn{n}", "what it shows", tall) for n in range(2))
    own = Section("Its own", (*figures, Table((("row", "1"),) * 20, "ll"), Bullets(("note",))))
    text = "".join(pages(Report("t", "", (before, own)), tmp_path))
    assert text.index("Its own") < min(text.index("drawn0"), text.index("drawn1"))
    assert text.index(f"line{lines - 1}") < text.index("Its own")


def test_long_lines_of_a_file_do_not_run_into_its_second_column(tmp_path):
    lines = [f"key{n} = {n}" for n in range(9)]
    text = "\n".join(["[first]", "source = " + " ".join("w" * 40), *lines, "", "[second]", *lines, ""])
    pages(Report("title", "", (Section("File", (Code(text),)),)), tmp_path)
    command = ["pdftotext", "-bbox", tmp_path / "report.pdf", "-"]
    words = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    (second,) = re.findall(r'xMin="([\d.]+)"[^>]*>\[second\]', words)
    ends = [float(x) for x in re.findall(r'xMax="([\d.]+)"[^>]*>w<', words)]
    assert 5 < float(second) - max(ends) < 20


def test_a_table_over_pages_says_so_and_one_that_begins_a_page_does_not(tmp_path):
    long = Table((("row", "1"),) * 40, "ll", ("what", "count"), title="A long one")
    first, second = pages(lines_and(25, long), tmp_path)
    assert "A long one" in first
    assert "continued" not in first
    assert "A long one, continued" in second
    assert "what" in second
    first, second = pages(lines_and(49, replace(long, title="Of page two")), tmp_path)
    assert "Of page two" not in first
    assert "Of page two" in second
    assert "continued" not in second


def test_what_a_foot_would_leave_empty_stands_between_blocks(tmp_path, monkeypatch):
    tall = SVG.replace('viewBox="0 0 9 9" width="9pt" height="9pt"', 'viewBox="0 0 768 900" width="768" height="900"')
    report = lines_and(34, Figure("f", "drawn", "what it shows", tall))
    told = []
    rooms = printers._rooms_above
    monkeypatch.setattr(printers, "_rooms_above", lambda placed: told.append((placed, rooms(placed))) or told[-1][1])
    words = pages(report, tmp_path)
    (placed, more) = told[0]
    assert max(at["page"] for at in placed) == len(words)  # nothing goes to another page for it
    assert more == {"0": printers.MOST_ABOVE}


def test_no_page_is_left_with_a_few_lines_where_less_room_between_blocks_will_do(tmp_path, monkeypatch):
    few = Table((("a", "1"), ("b", "2")), "ll", title="Few")
    sections = tuple(Section(f"Part {n}", (few,)) for n in range(9))
    last = Section("Last", (Code("\n".join(f"line {n}" for n in range(5))),))
    report = Report("title", "", (*sections, last))
    assert len(pages(report, tmp_path)) == 1
    monkeypatch.setattr(printers, "_tight", lambda placed, count: count)
    assert len(pages(report, tmp_path)) == 2


def test_a_tall_table_of_few_rows_goes_over_pages(tmp_path):
    """Seven rows of several lines each left a third of a page empty."""
    rows = tuple((f"row{n}", "words that go on and on " * 12) for n in range(7))
    first, second = pages(lines_and(36, Table(rows, "ll")), tmp_path)
    assert first.count("row") >= 3
    assert second.count("row") >= 3
    first, _ = pages(lines_and(50, Table(tuple((f"row{n}", "1") for n in range(7)), "ll")), tmp_path)
    assert "row" not in first


def test_a_table_over_pages_leaves_no_row_alone(tmp_path):
    rows = tuple((f"row{n}", "1") for n in range(12))
    on_first = [pages(lines_and(lines, Table(rows, "ll")), tmp_path)[0].count("row") for lines in range(39, 52)]
    assert set(on_first) <= {0, *range(5, 10), 12}  # no fewer than five below its head
    assert len(set(on_first)) > 3


def printed(block, width=80):
    shown = io.StringIO()
    print_table(block, Console(file=shown, width=width))
    return shown.getvalue()


def test_numbers_lengths_and_sentences():
    assert (number(1090.3, 3), number(-20123, 2), number(123456, 3)) == ("1090", "-20000", "1.23e+05")
    assert [number(v) for v in (0.0, 1 / 3, 123456, 1e-7, float("inf"), -float("inf"), float("nan"))] == [
        *("0", "0.33333", "1.2346e+05", "1e-07", "∞", "-∞", "not stated")
    ]
    assert number(1e-12, 4, zero=1e-9) == "0"
    assert [number(v) for v in (-0.0, 9e-15, -9e-15)] == ["0", "0", "0"]  # rounding, of lengths, pixels and shares
    assert [place((-0.0, 9e-15)), place((3.0625, -7.466), 3)] == ["0, 0", "3.06, -7.47"]
    assert length(-9e-15) == length(-0.0) == "0 mm"
    assert [length(v) for v in (0.0, 0.063, 0.00155, 0.1, 140.0, 22.272000000000002)] == [
        *("0 mm", "63 um", "1.55 um", "0.1 mm", "140 mm", "22.272 mm")
    ]
    assert [rounded(*pair) for pair in ((1.52345, 0.0123), (120.456, 23.4), (2.0, 0.0))] == ["1.523", "120", "2.000000"]
    assert [sentence(t) for t in ("", "so", "d_3 off?", "f-number met.", "a rim", "bore.x = 1")] == [
        *("", "So.", "d_3 off?", "f-number met.", "A rim.", "bore.x = 1.")
    ]


def test_times_that_are_left():
    times = [about_time(seconds) for seconds in (0.2, 3.4, 41.3, 89.4, 89.6, 190.0, 1170.0, 1300.0, 4790.0, 7200.0)]
    assert times == ["1 s", "3 s", "41 s", "89 s", "1 min", "3 min", "20 min", "20 min", "1 h 20 min", "2 h"]


def test_every_quantity_that_is_no_symbol_has_words_and_they_are_put_in_once():
    named = {q.name: q.label for q in (*QUANTITIES.values(), *METRICS.values()) if q.name not in PATHS}
    named |= {"main_lens.bending": "bending of the lens", "working_distance": "working distance"}
    for name, words in named.items():
        assert words
        said = in_words(f"{name} at 40 mm = 3, f_number_microlens >= 2")
        assert said == in_words(said) == f"{words} at 40 mm = 3, microlens f-number d_2/d ≥ 2"
    assert in_words("hold fill_factor@2, d_3 <= 6 mm, magnification_of_something") == (
        "hold image fill at field 2, d_3 ≤ 6 mm, magnification_of_something"
    )


def test_symbols_are_set_and_text_is_escaped():
    assert to_html("d_2/d < f_ml") == "<var>d</var><sub>2</sub>/<var>d</var> &lt; <var>f</var><sub>ml</sub>"
    assert to_html("sigma_Z 3 um, array_2, a_b.toml") == "<var>σ</var><sub>Z</sub> 3 µm, array_2, a_b.toml"
    assert (to_html("album"), to_html("d")) == ("album", "<var>d</var>")
    assert spans("d_2/d um") == [("symbol", "d"), ("sub", "2"), ("plain", "/"), ("symbol", "d"), ("plain", " µm")]
    assert spans("") == []


def test_decimal_columns_split_at_the_point_and_keep_every_character():
    table = Table((("a", "12.5 mm"), ("b", "-0.02"), ("c", "∞ mm"), ("d", "-")), "ld")
    cells = [row[1] for row in table.cells()]
    assert [(cell.whole, cell.rest) for cell in cells[:3]] == [("12", ".5 mm"), ("-0", ".02"), ("∞", " mm")]
    assert cells[3].align == "l"
    assert all(cell.room == 2 for cell in cells)
    with pytest.raises(ValueError, match="3 columns"):
        Table((("a", "b"),), "lll")


@pytest.mark.parametrize("width", [20, 60, 80, 200])
def test_no_number_and_no_name_is_cut_on_a_terminal(width):
    lines = printed(Table(LIMITS, "ldlr", HEADINGS, "Limits"), width).splitlines()
    assert "…" not in "".join(lines)
    for name, value, _, count in LIMITS[:2]:
        # Where it is narrow, columns stand below each other, each row with its name.
        own = [word for line in lines if line.startswith(name) for word in line.split()]
        assert {value, count} <= set(own)
    assert any("undefined" in line for line in lines)


def test_a_wide_table_fits_the_terminal_whole():
    rows = tuple((f"metric_{k}", *(f"{k}.{j}23456" for j in range(9))) for k in range(3))
    heads = ("metric@field", *(f"column {j}" for j in range(9)))
    lines = printed(Table(rows, "l" + "d" * 9, heads, "Wide")).splitlines()
    assert max(map(len, lines)) <= 80
    for name, *cells in rows:
        shown = [word for line in lines if line.startswith(name) for word in line.split()]
        assert [word for word in shown if word != name] == cells
    assert sum(line.startswith("Wide") for line in lines) == 1


def test_brackets_are_no_markup_and_headings_may_be_missing():
    assert "[red]f[/red]" in printed(Table((("[red]f[/red]", "1"),), "lr", ("what [mm]", "n")))
    assert "1.5 mm" in printed(Table((("a", "1.5 mm"),), "ld"))


def test_blocks_on_a_terminal():
    shown = io.StringIO()
    blocks = (Statements((Statement("bad", "It fails.", "Mend it."),)), Bullets(("one",)), Code("left out"))
    print_blocks(blocks, Console(file=shown, width=80))
    assert shown.getvalue() == "✗ It fails. Mend it.\n\none\n"


def test_same_report_same_bytes_and_text_is_never_code():
    pytest.importorskip("typst", reason="the typst package is not installed")
    assert render_pdf(report()).startswith(b"%PDF")
    assert render_pdf(report(NASTY)) == render_pdf(report(NASTY))


@pytest.mark.parametrize(("paper", "height"), [("a4", b"841.8"), ("letter", b"792")])
def test_paper_sizes(paper, height):
    pytest.importorskip("typst", reason="the typst package is not installed")
    pdf = render_pdf(report(), paper)
    streams = [part.split(b"endstream")[0].strip(b"\r\n") for part in pdf.split(b"stream\n")[1:]]
    assert height in pdf + b"".join(zlib.decompress(s) for s in streams if s[:1] == b"x")


def test_text_can_be_selected_in_drawings_too(tmp_path):
    (page,) = pages(Report("A title", "", (Section("Drawing", (dimensions_sheet(load("paper")),)),)), tmp_path)
    for words in ("A title", "Drawing", "object plane", "overall 262 mm", "= 120 mm"):
        assert words in page


def test_long_tables_repeat_their_header_on_every_page(tmp_path):
    rows = tuple((f"row {n}", str(n)) for n in range(150))
    table = Table(rows, "ld", ("some quantity", "its value"), "A long table")
    found = pages(Report("t", "", (Section("s", (table,)),)), tmp_path)
    assert len(found) > 2
    assert all("some quantity" in page and "its value" in page for page in found)
    assert [sum(f"row {n} " in page for page in found) for n in (0, 75, 149)] == [1, 1, 1]


@pytest.mark.parametrize("paper", ["a4", "letter"])
def test_wide_tables_stay_on_the_page(tmp_path, paper):
    """Every cell is whole: columns that do not fit break their lines instead."""
    long = "a rather long remark that says where a figure comes from and how far it can be trusted"
    rows = tuple((f"parameter {n}", "0.123 mm", "1.0", "1.00 mm", "image fill", long) for n in range(5))
    table = Table(rows, "lrdrll", ("parameter", "tolerance", "share", "alone", "limited by", "source"))
    text = " ".join(" ".join(pages(Report("t", "", (Section("s", (table,)),)), tmp_path, paper)).split())
    assert text.count("0.123 mm") == text.count("trusted") == 5
    assert "parameter 4 0.123 mm 1.0 1.00 mm image fill" in text


def test_text_goes_before_a_figure_that_does_not_fit_the_page(tmp_path):
    """And not before the next section; a section's last figures stay in their order."""
    tall = SVG.replace('viewBox="0 0 9 9" width="9pt" height="9pt"', 'viewBox="0 0 9 9" width="400pt" height="400pt"')
    lines = Bullets(tuple(f"line {n}" for n in range(38)))
    figures = [Figure(name, f"figure {name}", "", tall, "") for name in "abc"]
    sections = (
        Section("One", (lines, figures[0], Paragraph("what follows"))),
        Section("Two", (Paragraph("the next"), figures[1], figures[2])),
    )
    first, *others = pages(Report("t", "", sections), tmp_path)
    assert "line 37" in first
    assert "what follows" in first
    assert "figure a" not in first
    rest = "\f".join(others)
    order = [rest.index(words) for words in ("figure a", "Two", "the next", "figure b", "figure c")]
    assert order == sorted(order)


def test_what_people_read_has_no_powers_of_ten():
    assert [lux(value) for value in (1e5, 12345.6, 300.0)] == ["100,000 lx", "12,346 lx", "300 lx"]
    assert [within(value, "±") for value in (0.0123, 4.5e-9)] == ["±0.012", "better than ±0.0001"]
    assert [apart(value) for value in (4.4e-16, 2e-3)] == ["in the last digits", "by up to 0.002"]
