"""The page as a whole: complete, self-contained, reproducible, and never at the mercy of OpenGL."""

import re
from html.parser import HTMLParser
from xml.etree import ElementTree

import pytest

from roslf_design.cli import main
from roslf_design.commands import report as command
from roslf_design.design import load
from roslf_design.errors import InputError
from roslf_design.report import content, viewer
from roslf_design.report.blocks import Figure, Report, Section, Table
from roslf_design.report.html import render_html
from roslf_design.report.sheets import picture_sheet
from roslf_design.report.story import full_report
from roslf_design.report.symbols import to_html
from roslf_design.report.tables import column_cells
from tests.report.test_figures import DESIGNS

SECTIONS = (
    "summary",
    "the-design",
    "parts-list",
    "evaluation",
    "rays",
    "microlens-images",
    "design-space",
    "effects",
    "tolerances",
    "calibration-plan",
    "accuracy",
    "assumptions-and-what-was-left-out",
    "how-this-report-was-made",
)


class Page(HTMLParser):
    """What a page refers to, and what it holds."""

    def __init__(self, text):
        super().__init__()
        self.links, self.anchors, self.tags, self.open = [], [], set(), []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        for name, value in attrs:
            if name in ("src", "href", "xlink:href", "srcset", "data", "action"):
                self.links.append(value)
            if name == "id" and value:
                self.anchors.append(value)
        if tag not in ("meta", "img", "br", "col"):
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        self.open.pop()

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


@pytest.fixture(scope="module")
def text(few_builds):
    return render_html(full_report(load("paper"), command="roslf report paper -o report-paper"))


@pytest.fixture(scope="module")
def page(text):
    return Page(text)


def test_page_is_well_formed_and_self_contained(page, text):
    assert page.open == []
    assert [link for link in page.links if not link.startswith(("#", "data:image/png;base64,"))] == []
    assert not page.tags & {"link", "iframe", "object", "embed"}
    assert not re.search(r"<script[^>]* src=", text)
    assert not re.search(r"url\((?!#)|@import", text)


def test_page_has_every_section_with_links_that_lead_there(page):
    assert [anchor for anchor in page.anchors if anchor in SECTIONS] == list(SECTIONS)
    assert len(page.anchors) == len(set(page.anchors))
    assert {link[1:] for link in page.links if link.startswith("#")} <= set(page.anchors)


def test_page_tells_command_and_design_and_no_date(text):
    assert "roslf report paper -o report-paper" in text
    assert "focal_plane = &#34;350 mm&#34;" in text
    assert not re.search(r"20\d\d-\d\d-\d\d|<dc:date>", text)


def test_text_in_drawings_is_text(text):
    start = text.index('id="figure-rays"')
    drawing = text[text.index("<svg", start) : text.index("</svg>", start)]
    assert ">main lens</text>" in drawing
    assert "font-family" not in drawing


@pytest.mark.parametrize("name", ["mismatched-borescope", "vignetted", "strange"])
def test_difficult_designs_have_whole_reports(name):
    report = content.design_report(DESIGNS[name])
    figures = [block for section in report.sections for block in section.blocks if isinstance(block, Figure)]
    assert len({figure.name for figure in figures}) == len(figures) == 10
    assert all("nan" not in figure.content.lower().split("base64")[0] for figure in figures)
    waves = next(figure for figure in figures if figure.name == "waves")
    assert "% in the geometric disc" in waves.caption
    Page(render_html(report))


def test_same_design_same_bytes_and_nothing_else_in_the_folder(text, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    command.report("paper")
    folder = tmp_path / "report-paper"
    assert (folder / "index.html").read_text() == text
    assert [path.name for path in folder.iterdir()] == ["index.html"]
    assert capsys.readouterr().err == ""


def test_figures_as_files(tmp_path, capsys, monkeypatch):
    found = content.design_report(load("rigid-scope"), command="--figure rays --figure plane")
    monkeypatch.setattr(command, "maker", lambda *_: lambda **_: found)
    with pytest.raises(InputError, match="'ray' is not here; there are all, dimensions, rays, cells"):
        command.report("rigid-scope", output=tmp_path / "out", figure=["ray"])
    assert not (tmp_path / "out").exists()
    command.report("rigid-scope", output=tmp_path / "out", figure=["rays", "plane"])
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["index.html", "plane.svg", "rays.svg"]
    root = ElementTree.parse(tmp_path / "out" / "rays.svg").getroot()
    assert root.tag == "{http://www.w3.org/2000/svg}svg"
    assert "main lens" in "".join(root.itertext())


def test_a_missing_library_leaves_the_picture_and_says_what_to_install(monkeypatch):
    monkeypatch.setattr(viewer, "find_spec", lambda name: None)
    viewer.library.cache_clear()
    try:
        sheet = picture_sheet(load("paper"))
        page = render_html(Report("a", "", (Section("Rays", (sheet,)),)))
    finally:
        viewer.library.cache_clear()
    assert "pip install trame-vtk" in sheet.caption
    assert "<script" not in page
    assert sheet.content.startswith("<svg")


def test_bad_input_writes_nothing(tmp_path, capsys):
    bad = tmp_path / "bad.toml"
    bad.write_text("name = 'x'\n")
    for arguments in (["report", str(bad)], ["report", str(tmp_path / "none.toml")]):
        assert main([*arguments, "-o", str(tmp_path / "out")]) == 2
    assert not (tmp_path / "out").exists()
    assert "none.toml: no such file" in capsys.readouterr().err


def test_a_file_in_the_way_is_told_before_any_work(tmp_path, capsys):
    (tmp_path / "taken").write_text("mine")
    assert main(["report", "paper", "-o", str(tmp_path / "taken" / "deeper")]) == 2
    assert "taken is a file, not a folder" in capsys.readouterr().err
    assert (tmp_path / "taken").read_text() == "mine"


@pytest.mark.parametrize(
    ("given", "expected"),
    [("designs/my scope.toml", "my-scope"), ("paper", "paper"), ("..", "design"), ("/a/b.c.toml", "b.c")],
)
def test_folder_names(given, expected):
    assert command.folder_name(given) == expected


def test_symbols_are_set_and_text_is_escaped():
    assert to_html("d_2/d < f_ml") == "<var>d</var><sub>2</sub>/<var>d</var> &lt; <var>f</var><sub>ml</sub>"
    assert to_html("sigma_Z 3 um, microlens_array, a_b.toml") == (
        "<var>σ</var><sub>Z</sub> 3 µm, microlens_array, a_b.toml"
    )
    assert to_html("album") == "album"


def test_decimal_columns_split_at_the_point_and_keep_every_character():
    table = Table((("a", "12.5 mm"), ("b", "-0.02"), ("c", "∞ mm"), ("d", "-")), "ld")
    cells = [row[1] for row in column_cells(table)]
    assert [(cell.whole, cell.rest) for cell in cells[:3]] == [("12", ".5 mm"), ("-0", ".02"), ("∞", " mm")]
    assert cells[3].align == "l"
    assert all(cell.room == 2 for cell in cells)


def test_tables_refuse_rows_that_do_not_fit():
    with pytest.raises(ValueError, match="3 columns"):
        Table((("a", "b"),), "lll")


def test_sections_can_be_added_before_the_last():
    report = Report("a", "b", (Section("Verdicts", ()), Section("How this report was made", ())))
    more = report.with_sections(Section("Tolerances", ()))
    assert [section.anchor for section in more.sections][-2:] == ["tolerances", "how-this-report-was-made"]
