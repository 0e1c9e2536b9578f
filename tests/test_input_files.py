"""Files that users name: what is refused, in one line each, and never waited for or swallowed whole."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image

from roslf_design.errors import InputError, one_line, printable
from roslf_design.input_files import DEEPEST, MOST_TEXT, read_bytes, read_json, read_pixels, read_text
from roslf_design.toml_files import parse_toml


def told(call) -> str:
    with pytest.raises(InputError) as caught:
        call()
    (line,) = str(caught.value).splitlines()
    return line


@pytest.mark.parametrize("device", ["/dev/zero", "/dev/urandom"])
def test_devices_are_not_read(device):

    assert told(lambda: read_bytes(Path(device), "x")) == "x: is a pipe or a device; name a file on disk"


def test_a_pipe_is_not_waited_for(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    assert "is a pipe or a device" in told(lambda: read_text(pipe, "x", "TOML"))


def test_a_file_too_large_is_not_read(tmp_path):
    large = tmp_path / "large.toml"
    with large.open("wb") as file:
        file.truncate(50_000_000)
    assert told(lambda: read_text(large, "x", "TOML")) == (
        "x: is too large (50 MB; at most 4 MB); is it the right file?"
    )
    with large.open("wb") as file:
        file.truncate(MOST_TEXT)
    assert read_text(large, "x", "TOML") == MOST_TEXT * "\0"


def test_names_that_no_file_has(tmp_path):
    assert "File name too long" in told(lambda: read_bytes(tmp_path / ("a" * 5000), "x"))
    assert "null" in told(lambda: read_bytes(tmp_path / "a\0b", "x"))
    (tmp_path / "file").write_text("")
    assert "no such file" in told(lambda: read_bytes(tmp_path / "file" / "inside", "x"))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a = " + "1" * 5000, "thousands of digits"),
        ("[b]\na = " + "1" * 400, "b.a: a whole number of 400 digits"),
        ("a = " + "[" * 5000 + "]" * 5000, "too deep within each other"),
        ("a = " + "[" * 200 + "]" * 200, f"more than {DEEPEST} tables or lists"),
        (".".join(["a"] * 5000) + " = 1", f"more than {DEEPEST} tables or lists"),
        ("a = [" + "1," * 20_000 + "]", "a: has 20000 entries, at most 10000"),
    ],
)
def test_toml_that_means_nothing(text, said):
    assert said in told(lambda: parse_toml(text, "x"))


@pytest.mark.parametrize(
    "content",
    [b"", b"{", b"\xff\xfe{", b"[" * 100_000, b'{"a": ' * 40 + b"1" + b"}" * 40, b"NaN", b"1" * 5000, b"1" * 400],
)
def test_json_that_is_damaged(content, tmp_path):
    file = tmp_path / "x.json"
    file.write_bytes(content)
    line = told(lambda: read_json(file, "x", "make it anew"))
    assert line.startswith("x: is damaged, or no JSON (")
    assert line.endswith("; make it anew")


def test_json_as_it_should_be(tmp_path):
    file = tmp_path / "x.json"
    file.write_text(json.dumps({"a": [1, 2.5, "ü", None]}), "utf-8")
    assert read_json(file, "x", "") == {"a": [1, 2.5, "ü", None]}


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("Zhou 2023, 63 µm at σ ≤ 1", "Zhou 2023, 63 µm at σ ≤ 1"),
        ("a\u00a0b\u2009c", "a\u00a0b\u2009c"),
        ("\x1b[31mred", r"\x1b[31mred"),
        ("\x9b31m\x7f", r"\x9b31m\x7f"),
        ("one\ntwo\r\u2028three", r"one\ntwo\r\u2028three"),
        ("\u202egnp.exe", r"\u202egnp.exe"),
        ("\udcff.toml", r"\udcff.toml"),
    ],
)
def test_what_steers_a_terminal_is_spelled_out(text, shown):
    assert printable(text) == shown
    assert printable(shown) == shown


def test_an_error_is_one_line_of_bearable_length():
    assert len(one_line("x" * 10**6)) < 2000
    assert one_line("x" * 1000) == "x" * 1000


def pictures(folder: Path) -> list[Path]:
    """Good ones of several kinds."""
    ramp = np.arange(40 * 50, dtype=np.uint16).reshape(40, 50)
    colours = np.stack([ramp.astype(np.uint8)] * 3, axis=-1)
    tifffile.imwrite(folder / "plain.tif", ramp, description='{"full_scale": 2.0}', metadata=None)
    tifffile.imwrite(folder / "packed.tif", ramp, compression="zlib", predictor=True, rowsperstrip=7)
    tifffile.imwrite(folder / "tiles.tif", colours, photometric="rgb", compression="zlib", tile=(16, 16))
    Image.fromarray(ramp).save(folder / "grey.png")
    Image.fromarray(colours).quantize(16).save(folder / "palette.png")
    Image.fromarray(colours).save(folder / "colours.jpg")
    return sorted(folder.iterdir())


def test_pictures_come_as_they_are_stored(tmp_path):
    ramp = np.arange(40 * 50).reshape(40, 50)
    kinds = {path.name: read_pixels(path, path.name) for path in pictures(tmp_path)}
    for name in ("plain.tif", "packed.tif", "grey.png"):
        np.testing.assert_array_equal(kinds[name][0], ramp)
    assert kinds["plain.tif"][1] == '{"full_scale": 2.0}'
    assert {kinds[name][0].shape for name in ("tiles.tif", "palette.png", "colours.jpg")} == {(40, 50, 3)}


def test_a_damaged_picture_is_refused_or_read_and_nothing_else(tmp_path, capfd):
    rng = np.random.default_rng(1)
    said = []
    for path in pictures(tmp_path):
        good = path.read_bytes()
        for number in range(60):
            bad = bytearray(good)
            for place in rng.integers(0, min(len(good), (64, len(good))[number % 2]), 1 + number // 10):
                bad[place] = rng.integers(256)
            spoilt = tmp_path / f"spoilt{path.suffix}"
            spoilt.write_bytes(bad[: rng.integers(len(bad))] if number % 5 == 0 else bad)
            try:
                read_pixels(spoilt, "x")
            except InputError as error:
                said.append(str(error))
    assert len(said) > 100
    assert all(line.startswith("x: cannot be read as an image (") and "\n" not in line for line in said)
    assert capfd.readouterr().err == ""


def test_a_picture_that_would_fill_the_memory_is_refused(tmp_path):
    huge = tmp_path / "huge.tif"
    tifffile.imwrite(huge, np.zeros((8, 8), np.uint8), metadata=None)
    content = bytearray(huge.read_bytes())
    with tifffile.TiffFile(huge) as file:
        places = [file.pages[0].tags[name].valueoffset for name in ("ImageWidth", "ImageLength")]
    for place in places:
        content[place : place + 4] = (60_000).to_bytes(4, "little")
    huge.write_bytes(content)
    assert "3600 million numbers" in told(lambda: read_pixels(huge, "x"))
    large = tmp_path / "large.png"
    Image.new("1", (16_000, 13_000)).save(large)
    assert "208000000 pixels" in told(lambda: read_pixels(large, "x"))
