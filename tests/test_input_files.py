"""Files that users name: what is refused, in one line each, and never waited for or swallowed whole."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from roslf_design.errors import InputError, one_line, printable
from roslf_design.input_files import DEEPEST, MOST_TEXT, read_bytes, read_json, read_text
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
