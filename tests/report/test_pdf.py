"""The PDF: the same content, the same bytes, and no text of a design that typst would run."""

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
