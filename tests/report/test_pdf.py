"""The PDF: the same content, the same bytes, and no text of a design that typst would run."""

import shutil
import subprocess
import zlib

import pytest

from roslf_design.commands import report as command
from roslf_design.errors import InputError
from roslf_design.report.blocks import Bullets, Code, Figure, Paragraph, Report, Section, Statement, Statements, Table
from roslf_design.report.pdf import render_pdf, spans

pytest.importorskip("typst", reason="the typst package is not installed")

SVG = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9" width="9pt" height="9pt"><text y="9">word</text></svg>'
NASTY = '#panic("no") $x$ *a* _b_ \\ "quoted" <label> @ref #eval("1") [c]'


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


def test_same_report_same_bytes():
    first = render_pdf(report())
    assert first.startswith(b"%PDF")
    assert first == render_pdf(report())


def test_text_is_never_code():
    assert len(render_pdf(report(NASTY))) > 0


def test_paper_sizes():
    boxes = {"a4": b"841.8", "letter": b"792"}
    for paper, height in boxes.items():
        pdf = render_pdf(report(), paper)
        streams = [part.split(b"endstream")[0].strip(b"\r\n") for part in pdf.split(b"stream\n")[1:]]
        unpacked = b"".join(zlib.decompress(s) for s in streams if s[:1] == b"x")
        assert height in pdf + unpacked


def test_symbols_become_pieces():
    assert spans("of d_2/d um") == [
        ["plain", "of "],
        ["symbol", "d"],
        ["sub", "2"],
        ["plain", "/"],
        ["symbol", "d"],
        ["plain", " µm"],
    ]
    assert spans("") == []


def test_command_writes_both_or_tells_what_is_missing(tmp_path, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(InputError, match="pip install typst"):
        command.report("paper", output=tmp_path / "out", pdf=True)
    assert not (tmp_path / "out").exists()


def pages(pdf, tmp_path):
    """Words of each page as a reader would select them."""
    if shutil.which("pdftotext") is None:
        pytest.skip("no pdftotext; on Debian: apt-get install poppler-utils")
    (tmp_path / "report.pdf").write_bytes(pdf)
    said = subprocess.run(
        ["pdftotext", "-layout", tmp_path / "report.pdf", "-"], capture_output=True, text=True, check=True
    )
    return said.stdout.split("\f")[:-1]


def test_text_can_be_selected_in_drawings_too(tmp_path):
    from roslf_design.design import load
    from roslf_design.report.sheets import dimensions_sheet

    sheet = dimensions_sheet(load("paper"))
    (page,) = pages(render_pdf(Report("A title", "", (Section("Drawing", (sheet,)),))), tmp_path)
    for words in ("A title", "Drawing", "object plane", "overall 262 mm", "= 120 mm"):
        assert words in page


def test_long_tables_repeat_their_header_on_every_page(tmp_path):
    rows = tuple((f"row {n}", str(n)) for n in range(150))
    table = Table(rows, "ld", ("some quantity", "its value"), "A long table")
    found = pages(render_pdf(Report("t", "", (Section("s", (table,)),))), tmp_path)
    assert len(found) > 2
    assert all("some quantity" in page and "its value" in page for page in found)
    assert [sum(f"row {n} " in page for page in found) for n in (0, 75, 149)] == [1, 1, 1]


@pytest.mark.parametrize("paper", ["a4", "letter"])
def test_wide_tables_stay_on_the_page(tmp_path, paper):
    """Every cell is whole: columns that do not fit break their lines instead."""
    long = "a rather long remark that says where a figure comes from and how far it can be trusted"
    rows = tuple((f"parameter {n}", "0.123 mm", "1.0", "1.00 mm", "fill factor", long) for n in range(5))
    table = Table(rows, "lrdrll", ("parameter", "tolerance", "share", "alone", "limited by", "source"))
    words = " ".join(
        " ".join(page.split())
        for page in pages(render_pdf(Report("t", "", (Section("s", (table,)),)), paper), tmp_path)
    )
    assert words.count("0.123 mm") == 5
    assert words.count("trusted") == 5
    assert "parameter 4 0.123 mm 1.0 1.00 mm fill factor" in words
