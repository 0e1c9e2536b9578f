"""Bad input of every family over the commands: one line each, exit code 2, nothing written, soon."""

from __future__ import annotations

import json
import os
import re
import time
import warnings
from pathlib import Path

import numpy as np
import pytest
import tifffile
from hypothesis import given
from hypothesis import strategies as st

from roslf_design.accuracy.table import current_table
from roslf_design.calibration import Board, CalibrationError
from roslf_design.cli import COMMANDS, main
from roslf_design.reporting.blocks import slug
from tests.laws import LETTERS

ROOT = Path(__file__).resolve().parents[2]

DESIGN = {
    "main_lens.diameter": '"50.8 mm"',
    "main_lens.focal_length": '"100 mm"',
    "aperture.distance": '"120 mm"',
    "microlens_array.pitch": '"63 um"',
    "microlens_array.size": '["23 mm", "23 mm"]',
    "sensor.relay_magnification": "1.0",
    "sensor.size": '["22.3 mm", "14.932 mm"]',
    "light.wavelength": '"550 nm"',
}
"""Some keys of a design, and what they hold."""
REST = """
main_lens.focal_plane = "350 mm"
aperture.diameter = "2.9 mm"
microlens_array.focal_length = "2 mm"
sensor.distance = "2 mm"
sensor.pixel = "4.847826 um"
"""
LENS = {
    "radius": '"51.5 mm"',
    "thickness": '"9.69 mm"',
    "glass": '"N-BK7"',
    "diameter": '"50.8 mm"',
    "conic": "-0.6",
    "asphere": '{ r4 = "1e-9 mm^-3" }',
    "index_offset": "0.0",
}
GRADE = {"place": '"main_lens.focal_length"', "tight": '"1 %"', "provenance": '"judgement"'}
STUDY = """
name = "x"
design = "paper"
grade = "tight"
grades = "shop.toml"
trials = 64
[[goals]]
metric = "fill_factor"
max = 2
"""
SCENE = {"kind": '"plane"', "distance": '"350 mm"', "texture": '{ kind = "checkerboard", period = "3 mm" }'}

DEEP, LONG = "[" * 200 + "]" * 200, "[" + "1, " * 20_000 + "]"
NUMBERS = ["1" * 400, "1" * 5000, "1e308", "nan", "inf", "true", "2020-01-01", "[]", "{}", "[[]]", DEEP, LONG]
TEXTS = ['"1e9999999 mm"', '"1e300 mm"', '"1e-300 mm"', '"[/bold]\\u001b[31m\\nmm"', '"\\u0000"', '""']


def tables(values, bad=()):
    """Keys and their values as TOML, one of them bad."""
    return "".join(f"{key} = {value}\n" for key, value in {**values, **dict(bad)}.items())


def design(folder, bad):
    (folder / "x.toml").write_text(tables(DESIGN, bad) + REST)
    return ["evaluate", "x.toml"]


def lens(folder, bad):
    (folder / "x.toml").write_text(
        f'[[surfaces]]\n{tables(LENS, bad)}[[surfaces]]\nradius = "inf"\ndiameter = "50.8 mm"\n'
    )
    real = {**DESIGN, "main_lens.prescription": '"x.toml"'}
    del real["main_lens.focal_length"], real["main_lens.diameter"]
    (folder / "design.toml").write_text(tables(real) + REST)
    return ["evaluate", "design.toml"]


def scene(folder, bad):
    (folder / "x.toml").write_text(f"[[objects]]\n{tables(SCENE, bad)}")
    return ["render", "paper", "--scene", "x.toml", "--plan-only"]


def grades(folder, bad):
    (folder / "shop.toml").write_text(f'[grades]\ntight = "x"\n[[line]]\n{tables(GRADE, bad)}')
    (folder / "study.toml").write_text(STUDY)
    return ["tolerance", "study.toml", "-o", "out"]


KEYS = {design: DESIGN, lens: LENS, scene: SCENE, grades: GRADE}
FINE = {("conic", "1e308"), ("asphere", "{}"), ("glass", '""'), *(("provenance", text) for text in TEXTS)}
"""What means something."""
CASES = [
    (write, key, value)
    for number, (write, keys) in enumerate(KEYS.items())
    for place, key in enumerate(keys)
    for value in [*NUMBERS, *TEXTS][(number + place) % 3 :: 3]
    if (key, value) not in FINE
]


@pytest.fixture(autouse=True)
def _somewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def refused(capsys, arguments, code=2):
    """What is said of a command that cannot be done, found to be one clear line (or one a fault)."""
    before = {path: os.stat(path).st_mtime_ns for path in os.listdir()}
    began = time.monotonic()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert main(arguments) == code
    assert time.monotonic() - began < 20
    out, err = capsys.readouterr()
    assert out == ""
    lines = err.splitlines()
    assert lines
    assert all(line.startswith("roslf: ") and line.isprintable() and len(line) < 2000 for line in lines)
    assert {path: os.stat(path).st_mtime_ns for path in os.listdir()} == before
    return lines


@pytest.mark.parametrize(("write", "key", "value"), CASES, ids=[f"{w.__name__}-{k}-{v[:12]}" for w, k, v in CASES])
def test_a_bad_value_is_told(write, key, value, capsys, tmp_path):
    assert len(refused(capsys, write(tmp_path, {key: value}))) <= 3


def entries(table, count, one):
    """A table so many times."""
    return f"[[{table}]]\n{one}\n" * count


STOP, WHITE = 'diameter = "3 mm"\ndistance = "10 mm"', 'kind = "white"'
POINTS = '[[objects]]\nkind = "points"\npositions = [{}]'
PARTS = '[story]\ntitle = "x"\ndesign = "paper"\n[[parts]]\ncalibration = {{ boards = {} }}\n'
WHOLE = tables(DESIGN) + REST
STUDY_OF = """
name = "x"
design = "paper"
trials = 64
{}
[[goals]]
metric = "fill_factor"
max = 2
[[perturb]]
place = "main_lens.focal_length"
tolerance = "1 %"
"""
RENDER = ["render", "paper", "--scene", "x.toml"]
PLAN = ["calibrate", "--plan", "paper"]
REQUIRED = f'name = "x"\n{WHOLE}\n[required]\nu_zz = {{max = 1}}\n'
WANTED = """
name = "x"
design = "x.toml"
[variables]
f = ["1 mm", "4 mm"]
[[objectives]]
quantity = "total_length_mm"
minimize = true
"""
TAKING_DESIGNS = {
    "evaluate": ("x.toml",),
    "render": ("x.toml",),
    "depth": ("x.toml", "paper --believed x.toml", "raw.tif --white raw.tif --design x.toml"),
    "report": ("x.toml", "paper x.toml --compare", "story.toml"),
    "datasheet": ("x.toml",),
    "sweep": ("x.toml --set d_3=1..2mm --quantity fill_factor",),
    "tolerance": ("study.toml -o out",),
    "optimize": ("wanted.toml -o out",),
    "calibrate": ("--plan x.toml", "shots --design x.toml --board 4x5,6mm -o out"),
    "bench": ("x.toml -o out", "check built", "report built"),
    "decode": ("raw.tif --design x.toml -o out",),
    "export": ("x.toml -o out.zmx",),
    "accuracy": ("x.toml", "calibrate x.toml", "hard-cases x.toml"),
    "explore": ("x.toml --no-browser",),
    **dict.fromkeys(("catalogue", "quantities", "keys", "presets", "warm"), ()),
}
"""Every command: its arguments where a design file is read that requires what is no quantity."""


@pytest.mark.parametrize(
    ("text", "arguments", "said"),
    [
        (WHOLE + entries("stops", 20_000, STOP), ["evaluate", "x.toml"], "stops: has 20000 entries"),
        (WHOLE + entries("stops", 51, STOP), ["evaluate", "x.toml"], "stops: has 51 entries, at most 50"),
        (entries("objects", 10_000, WHITE), RENDER, "objects: has 10000 entries, at most 200"),
        (POINTS.format('["0 mm", "0 mm", "300 mm"],' * 9000), RENDER, "positions: has 9000 entries, at most 1000"),
        (PARTS.format(5000), ["report", "x.toml"], "parts.0.calibration.boards: "),
        (PARTS.format(12), ["report", "x.toml", "--seed", str(2**70)], "--seed: is too large"),
        ("", [*PLAN, "--boards", "1000000"], "--boards: "),
        ("", [*PLAN, "--board", "99999x5 6 mm"], "too many inner corners"),
        ("", [*PLAN, "--board", "4x5 1.2.3 mm"], "is not understood"),
        ("", [*PLAN, "--board", f"{'4' * 5000}x5 6 mm"], "is not understood"),
        ("", [*PLAN, "--board", "40x40 6 mm"], "a plan takes at most 10000"),
        ("", [*PLAN, "--tilt", "1e400deg"], "--tilt: "),
        ("", ["render", "paper", "--seed", str(2**64)], "--seed: is too large"),
        ("", ["optimize", "x.toml", "-o", "out", "--seed", str(2**64)], "--seed: is too large"),
        ("", ["explore", "paper", "--no-browser", "--host", "a" * 300], "--host: "),
        ("", ["evaluate", "paper", *["--field", "1"] * 51], "--field: given 51 times; give 50 fields at most"),
        (
            STUDY_OF.format("sobol_samples = 4194304"),
            ["tolerance", "x.toml", "-o", "out"],
            "sobol_samples: 4194304 of 1 fact",
        ),
        (
            STUDY_OF.format("fields = [" + "['1 mm', '0 mm'], " * 501 + "]"),
            ["tolerance", "x.toml", "-o", "out"],
            "fields: 501 are too many; ask for 500 at most",
        ),
        ("", ["evaluate", "."], "is a folder"),
        (
            "",
            ["sweep", "paper", "--set", "d_3=30..44", "--quantity", "fill_factor"],
            'd_3: "30..44" has no unit; write e.g. "30..44 mm"',
        ),
        ("", [*PLAN, "--at", "10"], '--at: "10" has no unit'),
        ("", ["bench", "paper", "-o", "out", "--at", "10"], '--at: "10" has no unit'),
        ("", ["tolerance", "/dev/zero", "-o", "out"], "is a pipe or a device"),
        ("", ["catalogue", "--file", "/dev/urandom"], "is a pipe or a device"),
        ('[[lenses]]\npart = ""', ["catalogue", "--file", "x.toml"], "lenses.0.part: "),
        ("", ["evaluate", "\x1b[31m[/bold].toml"], r"\x1b[31m[/bold].toml: no such file"),
    ],
)
def test_what_is_too_much_or_no_input_is_told_soon(text, arguments, said, capsys, tmp_path, monkeypatch):
    monkeypatch.setattr("roslf_design.commands.evaluate.MOST_FIELDS", 50)  # options by the hundred take seconds to read
    (tmp_path / "x.toml").write_text(text)
    assert any(said in line for line in refused(capsys, arguments))


def test_every_command_is_asked_whether_it_takes_a_design():
    assert set(TAKING_DESIGNS) == set(COMMANDS)


@pytest.mark.parametrize("command", [f"{name} {rest}" for name, ways in TAKING_DESIGNS.items() for rest in ways])
def test_a_design_that_requires_what_cannot_be_is_refused_by_every_command(command, capsys, tmp_path):
    Path("x.toml").write_text(REQUIRED)
    Path("story.toml").write_text(PARTS.format(12).replace('"paper"', '"x.toml"'))
    Path("study.toml").write_text(STUDY_OF.format("").replace('"paper"', '"x.toml"'))
    Path("wanted.toml").write_text(WANTED)
    tifffile.imwrite("raw.tif", np.zeros((60, 60), np.uint8))
    for folder in ("shots", "built"):
        Path(folder).mkdir()
    Path("built/bench.toml").write_text("")
    Path("built/design.toml").write_text(REQUIRED)
    lines = refused(capsys, [word.replace(",", " ") for word in command.split()])
    assert any(".toml: required.u_zz: 'u_zz' is no" in line for line in lines)


@pytest.mark.parametrize(
    "content", [b"[" * 100_000, b"{}", b'{"schema": "roslf.accuracy-table/1", "rows": [{}]}', b"\xff"]
)
def test_an_accuracy_table_that_is_damaged_is_told(content, capsys, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    (tmp_path / "roslf").mkdir()
    (tmp_path / "roslf" / "accuracy.json").write_bytes(content)
    current_table.cache_clear()
    try:
        (line,) = refused(capsys, ["accuracy", "paper", "--quantity", "area", "--field", "0"])
    finally:
        current_table.cache_clear()
    assert "roslf accuracy calibrate" in line


def test_a_damaged_picture_on_a_scene_or_in_a_capture_is_told(capsys, tmp_path):
    tifffile.imwrite("good.tif", np.arange(4096, dtype=np.uint16).reshape(64, 64), compression="zlib")
    content = bytearray((tmp_path / "good.tif").read_bytes())
    content[-200:] = bytes(200)
    (tmp_path / "bad.tif").write_bytes(content)
    texture = '{ kind = "image", file = "bad.tif", width = "5 mm" }'
    (tmp_path / "x.toml").write_text(f"[[objects]]\n{tables(SCENE, {'texture': texture})}")
    (line,) = refused(capsys, RENDER)
    assert "bad.tif: cannot be read as an image (" in line
    (tmp_path / "captures").mkdir()
    (tmp_path / "bad.tif").rename(tmp_path / "captures" / "white.tif")
    (tmp_path / "good.tif").rename(tmp_path / "captures" / "board.tif")
    (line,) = refused(capsys, ["calibrate", "captures", "--design", "paper", "--board", "4x5 6 mm", "-o", "out"])
    assert "white.tif cannot be read as an image (" in line


OTHER_WAY = {
    "[[sensor]]": (WHOLE.replace("sensor.", "x.") + '[[sensor]]\npixel = "4 um"\n', "sensor: must be a table"),
    "[[microlens_array]]": (
        WHOLE.replace("microlens_array.", "x.") + '[[microlens_array]]\npitch = "63 um"\n',
        "microlens_array: must be a table",
    ),
    "a list": ('sensor = ["1 mm"]\n' + WHOLE.replace("sensor.", "x."), "sensor: must be a table"),
    "a key without letters": ('"" = []\n' + WHOLE, '"": is not a known key'),
}


@pytest.mark.parametrize(
    ("values", "said"),
    [(1j, "complex128 numbers"), (1e300, "not finite, or above"), (np.nan, "not finite, or above")],
)
def test_pictures_of_no_greys_are_told(values, said, capsys, tmp_path):
    tifffile.imwrite("odd.tif", np.full((9, 9), values), photometric="minisblack")
    texture = '{ kind = "image", file = "odd.tif", width = "5 mm" }'
    (tmp_path / "x.toml").write_text(f"[[objects]]\n{tables(SCENE, {'texture': texture})}")
    (line,) = refused(capsys, RENDER)
    assert "odd.tif: holds" in line
    assert said in line


@pytest.mark.parametrize("kind", [np.uint8, np.float32])
def test_a_black_picture_with_a_white_image_is_told(kind, capsys):
    wave = 0.5 + 0.5 * np.cos(2 * np.pi * (np.arange(130) - 64.5) / 12.94)
    tifffile.imwrite("white.tif", np.outer(wave, wave).astype(np.float32))
    tifffile.imwrite("black.tif", np.zeros((130, 130), kind))
    words = ["--white", "white.tif", "--design", "paper", "--region", "2000,1300,130,130", "-o", "out"]
    (line,) = refused(capsys, ["depth", "black.tif", *words])
    assert "black.tif: is black" in line


@pytest.mark.parametrize("slip", OTHER_WAY)
def test_slips_of_brackets_are_told(slip, capsys, tmp_path):
    text, said = OTHER_WAY[slip]
    (tmp_path / "x.toml").write_text(text)
    assert any(said in line for line in refused(capsys, ["evaluate", "x.toml"]))


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["evaluate", "paper", "--field", "1e308"], "--field: "),
        (["evaluate", "paper", "--field", "0,-1e80"], "--field: "),
        ([*PLAN, "--noise", "1e-300"], "--noise: "),
        ([*PLAN, "--noise", "1e300"], "--noise: "),
        ([*PLAN, "--tilt", "caf\udce9"], "is no UTF-8 text"),
        ([*PLAN, "--d-sigma", "1e300 %"], "--d-sigma: "),
        (["calibrate", "x", "--design", "paper", "--board", "4x3 1.3 mm", "-o", "out"], "4 x 4 cells"),
        ([*PLAN, "--board", "3x3 1.3 mm"], "4 x 4 cells"),
        (["evaluate", "/proc/self/mem"], "cannot be read"),
        (["decode", "b/" * 3000, "--white", "x"], "name too long"),
        (["evaluate", "paper", "-o", "a" * 300 + ".json"], "name too long"),
    ],
)
def test_what_ended_in_tracebacks_or_as_a_failed_run_is_told(arguments, said, capsys):
    (line,) = refused(capsys, arguments)
    assert said in line


@pytest.mark.parametrize("cells", [(4, 4), (3, 4)])
def test_boards_are_those_that_opencv_looks_for(cells):
    import cv2

    inner = tuple(count - 1 for count in cells)
    try:
        cv2.findChessboardCornersSB(np.zeros((60, 60), np.uint8), inner)
        known = True
    except cv2.error:
        known = False
    if known:
        Board(*cells, 1.0)
    else:
        with pytest.raises(CalibrationError, match="too few inner corners"):
            Board(*cells, 1.0)


WORK = {
    "evaluate": (["evaluate", "paper"], ".csv"),
    "export": (["export", "paper"], ".zmx"),
    "datasheet": (["datasheet", "paper"], ".json"),
    "sweep": (["sweep", "paper", "--set", "d_3=0..9 mm", "--quantity", "fill_factor"], ".csv"),
    "render": (["render", "paper"], ".tif"),
    "accuracy": (["accuracy", "calibrate"], ".json"),
    "hard cases": (["accuracy", "hard-cases"], ""),
    "report": (["report", "paper"], ""),
    "decode": (["decode", "x.tif"], ""),
    "depth": (["depth", "paper"], ""),
    "tolerance": (["tolerance", "x.toml"], ""),
    "optimize": (["optimize", "x.toml"], ""),
    "calibrate": (["calibrate", "x", "--design", "paper", "--board", "4x5 1 mm"], ""),
}


@pytest.mark.parametrize("command", WORK)
@pytest.mark.parametrize("place", ["/proc/x", "links/loop/x", "/dev/null"])
def test_a_place_where_nothing_can_be_written_is_told_before_the_work(command, place, capsys):
    """/proc is where root cannot write either; a link to itself leads nowhere."""
    words, ending = WORK[command]
    if place == "/dev/null" and command != "accuracy":
        place = "/dev/null/x"
    os.mkdir("links")
    os.symlink("loop", "links/loop")
    (line,) = refused(capsys, [*words, "-o", f"{place}{'' if place == '/dev/null' else ending}"])
    assert line.startswith("roslf: -o: ")


def test_names_with_what_steers_a_terminal_are_spelled_out(capsys, tmp_path):
    assert main(["evaluate", "paper", "-o", "\x1b[31mred.csv"]) == 0
    assert capsys.readouterr().out == "\\x1b[31mred.csv\n"
    (tmp_path / "x.toml").write_text('name = "\\u202eabc\\u001b[31m"\n' + WHOLE)
    assert main(["evaluate", "x.toml", "--json"]) == 0
    out = capsys.readouterr().out
    assert json.loads(out)["design"] == "\u202eabc\x1b[31m"
    assert all(letter.isprintable() or letter in "\n\u202f" for letter in out)


def test_pages_of_files_whose_names_are_no_letters(capsys):
    name = os.fsdecode(b"caf\xe9.toml")
    with open(name, "w") as file:
        file.write('name = "x"\n' + WHOLE)
    assert main(["datasheet", name, "-o", "out.html"]) == 0
    with open("out.html", encoding="utf-8") as page:
        assert "</html>" in page.read()


@given(st.text(LETTERS, max_size=20))
def test_names_of_tables_fit_every_file_system(title):
    assert re.fullmatch(r"[a-z0-9]*(-[a-z0-9]+)*", slug(title))


def test_greek_letters_in_names_of_tables_are_spelled_out():
    assert slug("Depth spread σ_Z, ΔZ in µm") == "depth-spread-sigma-z-deltaz-in-mum"


def test_a_plan_goes_on_where_a_lens_in_the_bore_may_show_what_is_in_focus_at_infinity(capsys):
    """m = 0.0075 here, and a lens before the main lens that may be off by 20 %: some of such cameras have d_1 <= f."""
    text = (ROOT / "designs" / "grin-needle.toml").read_text()
    with open("x.toml", "w") as file:
        file.write(text.replace('distance = "41 mm"', 'distance = "40.3 mm"'))
    board = ["--board", "4x5 6 mm"]
    assert main(["calibrate", "--plan", "x.toml", "--json", *board, "--sigma", "elements.0.focal_length=20 %"]) == 0
    sigma = json.loads(capsys.readouterr().out)["expected_sigma"]
    assert np.isfinite([*sigma.values()]).all()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[light]\nread_noise = 1e300\n[[objects]]\nkind = 'white'\n", "light.read_noise"),
        ("[light]\nexposure = 1e308\n[[objects]]\nkind = 'white'\n", "light.exposure"),
        ("[light]\nexposure = 1e-300\n[[objects]]\nkind = 'white'\n", "light.exposure"),
        ("background = 1e308\n[[objects]]\nkind = 'white'\n", "background"),
        ('[[objects]]\nkind = "white"\nlevel = 1e308\n', "objects.0.level"),
    ],
)
def test_light_that_no_float_of_an_image_holds_is_told(text, said, capsys, tmp_path):
    (tmp_path / "x.toml").write_text(text)
    (line,) = refused(capsys, RENDER)
    assert f"x.toml: {said}: " in line


@pytest.mark.parametrize("truncate", ["1e308", "1e-300"])
def test_cut_offs_that_no_distribution_has_are_told(truncate, capsys, tmp_path):
    (tmp_path / "x.toml").write_text(f"truncate = {truncate}\n{STUDY}".replace('grades = "shop.toml"\n', ""))
    lines = refused(capsys, ["tolerance", "x.toml", "-o", "out"])
    assert any("truncate: " in line for line in lines)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("evaluate paper --at", "--at: -3 mm is not ahead of the bore's tip"),
        ("sweep paper --set d_3=1..3mm --quantity fill_factor --at", "--at: -3 mm is not ahead of the bore's tip"),
        ("calibrate --plan paper --distance", '--distance: "-3 mm" must be greater than zero'),
        ("calibrate --plan paper --range", '--range: "-3 mm" must not be negative'),
    ],
)
def test_a_length_below_zero_is_refused_as_one_and_is_no_option(capsys, words, said):
    assert main([*words.split(), "-3 mm"]) == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (
            ("report", "paper", "--pdf", "out/x.pdf"),
            "--pdf takes no value: the files are written into the folder given",
        ),
        (("report", "paper", "out/x.html"), "a report is named by its folder: the files are written into the folder"),
        (("catalogue", "--where", "width<=6 mm"), "'width' is no key of a part; write size"),
        (("catalogue", "--where", "colour_depth=3"), "microlens arrays have pitch, focal_length"),
        (("catalogue", "--where", "diametre<=6 mm"), "did you mean 'diameter'?"),
        (
            ("sweep", "paper", "--set", "environment.temperature=5..80", "--quantity", "fill_factor"),
            'write e.g. "5..80 degC"',
        ),
        (("sweep", "paper", "--set", "d_3=5..80", "--quantity", "fill_factor"), 'write e.g. "5..80 mm"'),
        (("sweep", "paper", "--set", "light.illuminance=5..80", "--quantity", "fill_factor"), 'write e.g. "5..80 lx"'),
        (("sweep", "paper", "--set", "aperture.tilt.0=5..80", "--quantity", "fill_factor"), 'write e.g. "5..80 deg"'),
    ],
)
def test_what_was_meant_is_named(arguments, said, capsys):
    assert main(arguments) == 2
    assert said in " ".join(capsys.readouterr().err.split())


def test_a_command_misspelt_is_named(capsys):
    assert main(["evalute", "head.toml"]) == 2
    assert "'evalute' is no command; did you mean evaluate?" in capsys.readouterr().err
