"""Bad input of every family over the commands: one line each, exit code 2, nothing written, soon."""

from __future__ import annotations

import os
import time
import warnings

import numpy as np
import pytest
import tifffile

from roslf_design.accuracy.table import current_table
from roslf_design.cli import main

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
        ("", ["evaluate", "paper", *["--field", "1"] * 501], "--field: given 501 times; give 500 fields at most"),
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
        ("", ["tolerance", "/dev/zero", "-o", "out"], "is a pipe or a device"),
        ("", ["catalogue", "--file", "/dev/urandom"], "is a pipe or a device"),
        ('[[lenses]]\npart = ""', ["catalogue", "--file", "x.toml"], "lenses.0.part: "),
        ("", ["evaluate", "\x1b[31m[/bold].toml"], r"\x1b[31m[/bold].toml: no such file"),
    ],
)
def test_what_is_too_much_or_no_input_is_told_soon(text, arguments, said, capsys, tmp_path):
    (tmp_path / "x.toml").write_text(text)
    assert any(said in line for line in refused(capsys, arguments))


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
