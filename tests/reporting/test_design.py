"""A design's report as a whole: complete, self-contained, reproducible; its parts list; designs side by side."""

import csv
import re
import tomllib
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import pytest

from roslf_design import __version__
from roslf_design.catalogue import Catalogue, load_catalogue
from roslf_design.cli import main
from roslf_design.commands import report as command
from roslf_design.design import dumps, load, preset_names
from roslf_design.design.files import WRITTEN
from roslf_design.drawing import solid
from roslf_design.errors import InputError
from roslf_design.evaluation import evaluate
from roslf_design.evaluation.result import seen_table
from roslf_design.reporting.blocks import Code, Figure, Report, Section, Statement, Statements, Table
from roslf_design.reporting.design.compare import comparison_report
from roslf_design.reporting.design.figures import _picture_sheet, dimensions_sheet
from roslf_design.reporting.design.pages import design_report, making
from roslf_design.reporting.design.parts_list import _catalogue_match, parts_section
from roslf_design.reporting.printers import render_html
from roslf_design.reporting.story import full_report
from tests.pictures.designs import DESIGNS, THROUGH

pytestmark = pytest.mark.usefixtures("few_builds")

SECTIONS = (
    *("summary", "the-design", "parts-list", "evaluation", "rays", "microlens-images", "design-space", "effects"),
    *("tolerances", "calibration-plan", "accuracy", "assumptions-and-what-was-left-out", "how-this-report-was-made"),
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
        self.links += [v for name, v in attrs if name in ("src", "href", "xlink:href", "srcset", "data", "action")]
        self.anchors += [value for name, value in attrs if name == "id" and value]
        if tag not in ("meta", "link", "img", "br", "col"):
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        self.open.pop()

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


@pytest.fixture(scope="module")
def text(few_builds):
    return render_html(full_report(load("paper"), command="roslf report paper -o report-paper"))


def blocks(report, kind):
    return [block for section in report.sections for block in section.blocks if isinstance(block, kind)]


def test_page_is_well_formed_self_contained_and_whole(text):
    page = Page(text)
    assert page.open == []
    assert [link for link in page.links if not link.startswith(("#", "data:image/png;base64,"))] == ["data:,"]
    assert re.findall("<link[^>]*>", text) == ['<link rel="icon" href="data:,">']  # none, so that none is asked for
    assert not page.tags & {"iframe", "object", "embed"}
    assert not re.search(r"<script[^>]* src=|url\((?!#)|@import", text)
    assert [anchor for anchor in page.anchors if anchor in SECTIONS] == list(SECTIONS)
    assert len(page.anchors) == len(set(page.anchors))
    assert {link[1:] for link in page.links if link.startswith("#")} <= set(page.anchors)


def test_page_tells_command_and_design_and_no_date_and_text_in_drawings_is_text(text):
    assert "roslf report paper -o report-paper" in text
    assert "focal_plane = &#34;350 mm&#34;" in text
    assert not re.search(r"(?<!read )20\d\d-\d\d-\d\d|<dc:date>", text)  # but of what a part's figures rest on
    start = text.index('id="figure-rays"')
    drawing = text[text.index("<svg", start) : text.index("</svg>", start)]
    assert ">main lens</text>" in drawing


@pytest.mark.parametrize("name", ["mismatched-borescope", "vignetted", "strange"])
def test_difficult_designs_have_whole_reports(name):
    report = design_report(DESIGNS[name])
    assert len({figure.name for figure in report.figures}) == len(report.figures) == 13
    assert all("nan" not in figure.content.lower().split("base64")[0] for figure in report.figures)
    assert "% in the geometric image" in next(f.caption for f in report.figures if f.name == "waves")
    Page(render_html(report))


def test_a_real_lens_has_its_own_section(text, without_figures):
    report = design_report(load("paper-singlet"))
    titles = [section.title for section in report.sections]
    assert {"Real main lens", "Microlens images of the thin-lens model"} <= set(titles)
    page = render_html(report)
    assert "Exact rays through LA1050-A reversed" in page
    assert "its thin-lens model: an ideal lens" in page
    assert "Lens and rays are those of the thin-lens model" in _picture_sheet(load("paper-singlet")).caption
    assert "The main lens is ideal and thin" not in page
    assert "<h2>Real main lens</h2>" in page
    assert "<h2>Real main lens</h2>" not in text
    assert "The main lens is ideal and thin" in text


def test_same_design_same_bytes_and_nothing_else_in_the_folder(text, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    command.report("paper")
    assert (tmp_path / "report-paper" / "index.html").read_text() == text
    assert sorted(path.name for path in (tmp_path / "report-paper").iterdir()) == ["index.html", "tables"]
    told = capsys.readouterr()
    assert told.err == ""
    *paths, answer = told.out.splitlines()
    assert paths == [str(Path("report-paper") / name) for name in ("index.html", "tables")]
    assert answer.startswith("✓ f-number matched: image fill 1.0051")
    with (tmp_path / "report-paper" / "tables" / "field-of-view.csv").open() as file:
        rows = list(csv.reader(file))
    assert rows[1][:2] == ["from the entrance pupil, full (diagonal)", "16.67 deg"]


def test_figures_as_files(tmp_path, monkeypatch):
    made = design_report(load("rigid-scope"))
    monkeypatch.setattr(command, "maker", lambda *_: (made.title, lambda **_: made))
    with pytest.raises(InputError, match="'ray' is not here; there are all, glance, mtf, resolution-map, dimensions"):
        command.report("rigid-scope", output=tmp_path / "out", figure=["ray"])
    assert not (tmp_path / "out").exists()
    command.report("rigid-scope", output=tmp_path / "out", figure=["rays", "plane"])
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "index.html",
        "plane.svg",
        "rays.svg",
        "tables",
    ]
    root = ElementTree.parse(tmp_path / "out" / "rays.svg").getroot()
    assert root.tag == "{http://www.w3.org/2000/svg}svg"
    assert "main lens" in "".join(root.itertext())


def test_a_missing_library_leaves_the_picture_and_says_what_to_install(monkeypatch):
    monkeypatch.setattr(solid, "find_spec", lambda name: None)
    solid.library.cache_clear()
    solid.viewer.cache_clear()
    try:
        sheet = _picture_sheet(load("paper"))
        page = render_html(Report("a", "", (Section("Rays", (sheet,)),)))
    finally:
        solid.library.cache_clear()
        solid.viewer.cache_clear()
    assert "pip install trame-vtk" in sheet.caption
    assert "<script" not in page
    assert sheet.content.startswith("<svg")


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["{folder}/bad.toml"], "bad.toml"),
        (["{folder}/none.toml"], "none.toml: no such file"),
        (["paper", "-o", "{folder}/bad.toml/deeper"], "bad.toml is a file, not a folder"),
        (["paper", "--seed", "-1"], "--seed: -1 is negative"),
        (["paper", "pipe-bore"], "add --compare"),
        (["--compare", "paper"], "two or three"),
        (["--compare", "paper", "paper", "paper", "paper"], "two or three"),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(tmp_path, capsys, arguments, complaint):
    (tmp_path / "bad.toml").write_text("name = 'x'\n")
    words = [word.format(folder=tmp_path) for word in arguments]
    assert main(["report", *words, *([] if "-o" in words else ["-o", str(tmp_path / "out")])]) == 2
    assert complaint in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["bad.toml"]


def test_a_pdf_without_typst_tells_what_is_missing(tmp_path, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(InputError, match="pip install typst"):
        command.report("paper", output=tmp_path / "out", pdf=True)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("given", "expected"),
    [("designs/my scope.toml", "my-scope"), ("paper", "paper"), ("..", "design"), ("/a/b.c.toml", "b.c")],
)
def test_folder_names(given, expected):
    assert command.folder_name(given) == expected


def test_every_part_of_a_design_is_listed_once_and_numbered():
    rows = parts_section(DESIGNS["strange"]).blocks[0].rows
    assert [row[0] for row in rows] == list("123456")
    names = ["main lens", "FAP, front stop", "stop 1", "stop 2", "microlens array", "image sensor"]
    assert [row[1] for row in rows] == names
    assert rows[3][2] == "opening 14 mm"


def test_drawing_and_parts_list_are_at_room_temperature_and_say_so():
    cold = load("rigid-scope").replace({"environment": {"housing": "stainless steel"}})
    warm = cold.at_temperature(60)
    assert warm.d_1 > 1.0005 * cold.d_1
    (drawn, told), (parts, listed) = (
        (dimensions_sheet(one), next(block for block in parts_section(one).blocks if isinstance(block, Table)))
        for one in (cold, warm)
    )
    assert (parts.content, listed.rows) == (drawn.content, told.rows)
    holds = "Lengths at 20 °C; the camera is used at 60 °C, in a housing of stainless steel, taken as 304, 17.2e-6 /K."
    assert (parts.caption, listed.caption) == (f"{drawn.caption} {holds}", f"{told.caption} {holds}")


def test_parts_of_the_catalogue_are_found_again():
    """A design made of catalogue parts lists just these."""
    known = load_catalogue()
    for array in known.microlens_arrays:
        changed = load("paper").replace(
            {
                "microlens_array.pitch": array.pitch,
                "microlens_array.focal_length": array.focal,
                "microlens_array.size": array.size,
                "microlens_array.layout": array.layout,
                "microlens_array.lens_shape": array.lens_shape,
            }
        )
        for sensor in known.sensors:
            both = changed.replace({"sensor.pixel": sensor.pixel, "sensor.size": sensor.size})
            assert _catalogue_match(both, known, "microlens_arrays")[1] == array
            match = _catalogue_match(both, known, "sensors")[1]
            assert (match.pixel, match.size) == (sensor.pixel, sensor.size)  # makers sell some that are alike
            assert "the same as" in _catalogue_match(both, known, "microlens_arrays")[0]


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"microlens_array.pitch": 0.07}, "pitch 63 um"),
        ({"microlens_array.focal_length": 2.1}, "focal length 2 mm"),
        ({"microlens_array.lens_shape": "circular"}, "square, square lenses"),
        ({"microlens_array.size": (40.0, 30.0), "sensor.size": (30.0, 20.0)}, "only 23 mm x 23 mm"),
    ],
)
def test_what_differs_from_the_nearest_part_is_named(changes, said):
    text, nearest = _catalogue_match(load("paper").replace(changes), load_catalogue(), "microlens_arrays")
    assert text.startswith("to be made; nearest is paper 63 um / 2 mm: ")
    assert said in text
    assert nearest.part == "paper 63 um / 2 mm"


def test_larger_sensors_far_parts_and_real_lenses():
    known = load_catalogue()
    design = load("mismatched-borescope")  # IMX250; a larger one, read out in part, is the same
    alone = Catalogue(sensors=tuple(part for part in known.sensors if part.part == "IMX250"))
    small, large = (design.replace({"sensor.size": size}) for size in ((4.0, 3.0), (8.6, 7.2)))
    read = "{} x {}".format(*small.pixels)
    assert _catalogue_match(small, alone, "sensors")[0] == f"Sony IMX250, {read} of its 2448 x 2048 px read"
    assert "only 2448 x 2048 px" in _catalogue_match(large, alone, "sensors")[0]
    # Of several that are large enough the smallest.
    assert _catalogue_match(large, known, "sensors")[0].startswith("Sony IMX255, 2492 x 2086 of its ")
    assert _catalogue_match(load("rigid-scope"), known, "lenses") == (
        "to be made; the catalogue has nothing near",
        None,
    )
    assert _catalogue_match(load("paper-singlet"), known, "lenses") == ("LA1050-A reversed, as prescribed", None)
    assert _catalogue_match(load("paper"), Catalogue(), "lenses") == ("the catalogue has none", None)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"diameter": 2.2}, "sapphire 3 x 0.5 mm, 3 mm wide"),
        ({"diameter": 2.7}, "the same as sapphire 3 x 0.5 mm"),
        ({"diameter": 24.0}, "nearest is Ted Pella 16005-1020: clear aperture 22.86 mm"),
        ({"diameter": 2.2, "thickness": 0.55}, "nearest is sapphire 3 x 0.5 mm: thickness 0.5 mm"),
        ({"diameter": 2.2, "thickness": 1.0, "material": "N-BK7"}, "N-BK7 3 x 1 mm, 3 mm wide"),
    ],
)
def test_a_window_that_is_wider_than_asked_is_the_same(changes, said):
    plate = {"kind": "plate", "distance": 1.0, "thickness": 0.5, "material": "sapphire"} | changes
    design = load("paper").replace({"elements": [plate]})
    assert said in _catalogue_match(design, load_catalogue(), "windows", design.elements[0])[0]


def differences(designs):
    section = next(s for s in comparison_report(designs).sections if s.title == "What differs")
    return {(table.title, row[1]): row for table in section.blocks if isinstance(table, Table) for row in table.rows}


def test_differences_are_marked():
    rows = differences([load("paper"), load("paper-mismatched")])
    name = "FAP in front of the lens, d_3"
    assert rows["Parameters", name] == ("≠", name, "120 mm", "20 mm")
    assert rows["f-number", "image fill"][0] == "≠"
    assert all((len(set(row[2:])) > 1) == bool(row[0]) for row in rows.values())
    assert not any(row[0] for row in differences([load("pipe-bore")] * 2).values())


def test_a_real_lens_beside_an_ideal_one():
    rows = differences([load("paper"), load("paper-singlet")])
    assert rows["Parameters", "main lens"][2:] == ("ideal", "LA1050-A reversed")
    traced = [row for (title, _), row in rows.items() if title.startswith("Real main lens")]
    assert len(traced) == 5
    assert all(row[2] == "-" and row[0] for row in traced)


def test_stops_misalignments_and_effects_are_compared_one_by_one():
    paper = load("paper")
    one = paper.replace({"stops": [{"diameter": 10.0, "distance": 60.0}]})
    other = paper.replace({"stops": [{"diameter": 11.0, "distance": 60.0}], "sensor.decentre": (0.1, 0.0)})
    rows = differences([one, other, paper])
    assert rows["Parameters", "stop 1"] == ("≠", "stop 1", "10 mm at 60 mm", "11 mm at 60 mm", "-")
    assert rows["Parameters", "misalignments"][2:] == ("none", "sensor 0.1 mm, 0 mm", "none")
    effects = {name: row for (title, name), row in rows.items() if title.startswith("Effects")}
    assert effects["microlens diffraction"][0] == ""
    assert effects["decentres"][0] == "≠"


def test_three_designs_of_different_scale_and_stops_fit_and_one_is_refused():
    report = comparison_report([load("rigid-scope"), DESIGNS["strange"], DESIGNS["vignetted"]])
    assert [figure.name for figure in blocks(report, Figure)] == ["rays-A", "rays-B", "rays-C", "images", "depth"]
    assert "https:" not in render_html(report)
    with pytest.raises(ValueError, match="two or three"):
        comparison_report([load("paper")])


def test_a_pdf_tells_date_version_and_command_at_its_foot_unless_asked_not_to(tmp_path, monkeypatch, capsys):
    pytest.importorskip("typst", reason="the typst package is not installed")
    empty = Report(load("paper").name, "", ())
    monkeypatch.setattr("roslf_design.commands.report.maker", lambda *_: (empty.title, lambda **_: empty))
    feet = []
    monkeypatch.setattr("roslf_design.commands.report.render_pdf", lambda made, _: feet.append(made.footer) or b"")
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "951782400")  # 2000-02-29, 00:00 UTC
    common = ["report", "paper", "-o", str(tmp_path), "--pdf"]
    for given in ([], ["--no-stamp"], ["--stamp"]):
        assert main([*common, *given]) == 0
    version = __version__
    assert feet[0] == f"roslf_design {version} · 2000-02-29 · roslf report paper -o {tmp_path} --pdf --paper a4"
    assert feet[1:] == ["roslf_design", f"{feet[0]} --stamp"]
    capsys.readouterr()
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "yesterday")
    assert main(common) == 2
    assert capsys.readouterr().err == (
        'roslf: SOURCE_DATE_EPOCH: "yesterday" is no date; give whole seconds since 1970, or unset it\n'
    )


def test_a_report_ends_with_its_answer_the_faults_first(tmp_path, monkeypatch, capsys):
    good = Statement("good", "Evenly lit.")
    bad = Statement("bad", "No light-field camera."), Statement("bad", "Dark.")
    report = Report("x", "", (Section("Summary", (Statements((good, *bad)),)),))
    assert report.answer == "✗ No light-field camera. (1 more ✗ in the report)"
    assert Report("x", "", (Section("Summary", (Statements((good,)),)),)).answer == "✓ Evenly lit."
    monkeypatch.setattr("roslf_design.commands.report.maker", lambda *_: (report.title, lambda **_: report))
    assert main(["report", "paper", "-o", str(tmp_path)]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == report.answer


def test_reports_that_git_keeps_are_made_without_a_date(root):
    lines = [line for line in (root / "Makefile").read_text().splitlines() if "roslf report" in line]
    assert all("--no-stamp" in line for line in lines if "--pdf" in line)


@pytest.mark.parametrize("name", THROUGH)
def test_table_parts_and_drawing_list_what_stands_before_the_lens(name):
    design = THROUGH[name]
    told = {row[0]: row for row in seen_table(evaluate(design)).rows}
    (parts,) = [block for block in parts_section(design).blocks if isinstance(block, Table)]
    bought = " | ".join(row[1] for row in parts.rows)
    for k, element in enumerate(design.elements, 1):
        assert float(told[f"{element.kind} {k}"][2].split()[0]) == element.distance
        assert f"({element.kind} {k})" in bought
    drawn = dimensions_sheet(design).content
    assert all(f"{e.kind} {k}" in drawn for k, e in enumerate(design.elements, 1))
    tip = max(design.d_3, *(e.distance + e.length for e in design.elements))
    assert evaluate(design).answer.working_distance_mm == pytest.approx(design.d_f - tip, rel=1e-4)


def test_a_report_behind_elements_is_whole_and_tells_them(without_figures):
    report = design_report(THROUGH["prism and cover"])
    Page(render_html(report))
    assert [table for table in blocks(report, Table) if table.title.startswith("Beside the main lens")]


def test_windows_are_looked_for_in_the_catalogue():
    """One that is sold is found by its sizes and material; of other glass, or too thick, it is only the nearest."""
    known, scope = load_catalogue(), load("video-otoscope").replace({"tube.outer_diameter": 20.0})
    part = known.of("windows")[0]
    glass = {"kind": "plate", "distance": 3.0, "thickness": part.thickness, "material": part.material.name}

    def told(**changes):
        window = type(scope.elements[-1]).model_validate({**glass, **changes}, context={"from_file": False})
        return _catalogue_match(scope, known, "windows", window)

    assert told(diameter=part.aperture)[0].startswith("the same as")
    assert told(diameter=part.aperture)[1].thickness == part.thickness
    assert told(diameter=part.aperture, material="SF5")[0].startswith("to be made")
    assert told(diameter=0.01) == ("to be made; the catalogue has nothing near", None)
    rows = parts_section(load("arthroscope")).blocks[0].rows
    assert any("window" in row[1] and row[3] != "to be made or bought" for row in rows)


@pytest.mark.parametrize("name", preset_names())
def test_the_design_s_file_on_the_page_is_the_design_and_has_short_lists_on_a_line(name):
    (code,) = (block for block in making("", (), (), load(name)).blocks if isinstance(block, Code))
    assert tomllib.loads(code.text) == tomllib.loads(dumps(load(name), WRITTEN))
    assert not re.search(r"= \[\n +\"[^\n]{1,12}\",\n +\"[^\n]{1,12}\",\n\]", code.text)
