"""Bad inputs over all commands, drawn at random: `python -m tests.fuzz_bad_inputs --seed 1 --count 2500`.

What ships (designs, studies) and what is made here (lenses, scenes, stories, pictures, views, a calibration) is
spoiled and given to every command, whose options get bad values, too. Held to: no traceback, no warning, exit code 2
with lines that begin with "roslf: " and nothing written, or 0 where the input came out good; under 20 s of processor
time and 2 GB. A case is told by its seed and number: `--first 17 --count 1 --keep FOLDER` makes it again. The seed
"every" goes through each key and each option with each extreme value instead, `--count 30000` of them; "scaled" through
designs of which one length is a million times another, and holds those that come out good to the time, too.
"""

from __future__ import annotations

import argparse
import contextlib
import copy
import io
import json
import os
import random
import re
import resource
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
import tomllib
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from functools import reduce
from itertools import islice
from operator import getitem
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from roslf_design import cli
from roslf_design.cli import main
from roslf_design.design import dumps, load

ROOT = Path(__file__).resolve().parent.parent
PRESETS = sorted(path.stem for path in (ROOT / "designs").glob("*.toml"))
EVERY = "every"
"""The seed of all that `every` lists."""
SCALED = "scaled"
"""That of all that `scaled` lists."""
SECONDS, BYTES, PATIENCE = 20.0, 2 << 30, 180.0
"""Processor time and memory that a bad input may take; and after how long it is given up."""

NUMBERS = [
    1e308,
    -1e308,
    1e300,
    1e-308,
    1e-300,
    5e-324,
    1e15,
    1e-15,
    0,
    -0.0,
    -1,
    1,
    2,
    0.5,
    3.7,
    1000,
    10**6,
    2**62,
    10**18,
    10**40,
    float("nan"),
    float("inf"),
    -float("inf"),
    True,
    False,
]
TEXTS = [
    "",
    " ",
    "x",
    "nan",
    "inf",
    "1",
    "1 mm",
    "-1 mm",
    "0 mm",
    "-0.0 mm",
    "nan mm",
    "inf mm",
    "1e308 mm",
    "1e-308 mm",
    "1e-300 mm",
    "1e15 mm",
    "1e-12 mm",
    "1 kg",
    "5 deg",
    "1e3 rad",
    "20 %",
    "120 um",
    "63 nm",
    "1 m",
    "1 lx",
    "2 s",
    "37 degC",
    "1 mm^-1",
    "[/bold]",
    "\x1b[31mred\x1b[0m",
    "\u202eabc",
    "\u03a3\u03c3",
    "a" * 300,
    "air",
    "water",
    "N-BK7",
    "LA1050-A",
    "..",
    "/",
    "/dev/zero",
    "x.toml",
    "9" * 400 + " mm",
]
NESTED: list[Any] = [
    [],
    {},
    [[]],
    [1],
    [1, 2],
    ["1 mm"],
    ["1 mm", "2 mm"],
    ["1 mm", "2 mm", "3 mm"],
    {"a": 1},
    [{}],
    [{"a": 1}],
    {"index": 1.5, "abbe": 50},
    {"index": 1e308},
    {"kind": "x"},
]
WORDS = [
    "",
    " ",
    "x",
    "nan",
    "inf",
    "-inf",
    "1e308",
    "-1e308",
    "1e300",
    "1e-300",
    "5e-324",
    "0",
    "-0",
    "-1",
    "1",
    "2",
    "3.5",
    "1e9",
    "7" * 30,
    "7" * 5000,
    "1 mm",
    "1e308 mm",
    "1e-300 mm",
    "-5 mm",
    "0 mm",
    "5 deg",
    "1 %",
    "0 %",
    "100 %",
    "1e300 %",
    "1 kg",
    "1,2",
    "1,2,3",
    "0,0,60,60",
    "-1,0,9,9",
    "99999999,0,1,1",
    ",",
    "=",
    "x=1",
    "x=",
    "=1 mm",
    "aperture.diameter=1 %",
    "elements.0.thickness=1 um",
    "0..1",
    "..",
    "1..2 mm",
    "\x1b[31mred",
    "[/bold]",
    "a" * 300,
    "b" * 5000,
    "caf\udce9",
    "\u03c3",
    "/",
    ".",
    "..",
    "/proc/self/mem",
    "/dev/zero",
    "/dev/null",
    "missing.toml",
    "paper",
    "rigid-scope",
    "cystoscope",
    "water",
    "all",
    "none",
    "-",
    "--",
    "%s",
    "{0}",
    "4x5 6 mm",
    "3x3 1.3 mm",
    "1x1 1 mm",
    "4x3 1 mm",
    "999x999 1 mm",
    "4x5 1e-300 mm",
    "charuco 8x6 6 mm 4.5 mm DICT_4X4_50",
    "charuco 8x6 6 mm 7 mm DICT_4X4_50",
    "charuco 2x2 6 mm 4.5 mm X",
    "charuco 80x60 6 mm 4.5 mm DICT_4X4_50",
]
PLACES = [
    "x.toml",
    "missing.toml",
    "",
    " ",
    ".",
    "folder",
    "empty",
    "pipe",
    "/proc/self/mem",
    "/dev/zero",
    "/dev/null",
    "a" * 300,
    "b/" * 3000,
    "caf\udce9.toml",
    "\x1b[31mred.toml",
    "line\nline.toml",
    "file/inside",
    "loop",
    "binary.toml",
    "latin.toml",
]
TARGETS = [
    "out{}",
    "file/out{}",
    "/proc/out{}",
    "/proc/self/out{}",
    "/sys/out{}",
    "folder{}",
    "a" * 300 + "{}",
    "c" * 250 + "{}",
    "caf\udce9{}",
    "\x1b[31mred{}",
    "",
    ".",
    "pipe{}",
    "loop/out{}",
    "out.xyz",
    "deep/er/out{}",
    "/dev/full/out{}",
]
"""Where results are to go; {} is the ending."""


@dataclass
class Case:
    """One bad input: the command, and the files that it needs in its folder."""

    arguments: list[str]
    files: dict[str, bytes] = field(default_factory=dict)


@dataclass
class Result:
    """What became of a case."""

    code: int | None
    """Exit code; None where it was killed."""
    out: str = ""
    err: str = ""
    warnings: list[str] = field(default_factory=list)
    trace: str = ""
    seconds: float = 0.0
    memory: int = 0
    left: list[str] = field(default_factory=list)
    """Files that were not there before."""


def faults(result: Result) -> list[str]:
    """What is wrong with how a case was told; nothing where all is well."""
    wrong = []
    lines = result.err.splitlines()
    if result.trace:
        wrong.append("traceback")
    elif result.code not in (0, 2):
        wrong.append(f"exit {result.code}")
    if result.warnings:
        wrong.append("warning")
    if result.code == 2 and (not lines or not all(line.startswith("roslf: ") for line in lines)):
        wrong.append("no line")
    if result.code == 2 and (len(lines) > cli.LISTED + 1 or any(len(line) > 2000 for line in lines)):
        wrong.append("too many words")
    if any(not (letter.isprintable() or letter in "\n ") for letter in result.out + result.err if letter != "\u3000"):
        wrong.append("raw letters")
    if result.code == 2 and any("failed." not in name and name != "out" for name in result.left):
        wrong.append("half written")
    if result.seconds > SECONDS and result.code != 0:  # what came out good may take as long as a study takes
        wrong.append("slow")
    if result.memory > BYTES:
        wrong.append("memory")
    return wrong


# --- spoiling ---------------------------------------------------------------------------------------------------------


def paths(data: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Places of nested values."""
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in items:
        yield (*at, key)
        yield from paths(value, (*at, key))


def spoiled(data: dict[str, Any], rng: random.Random, times: int = 0) -> dict[str, Any]:
    """The same nested values with one to three faults."""
    data = copy.deepcopy(data)
    for _ in range(times or rng.choice([1, 1, 1, 2, 3])):
        places = list(paths(data))
        if not places:
            return data
        place = rng.choice(places)
        parent = data
        for step in place[:-1]:
            parent = parent[step]
        spoil(parent, place[-1], rng)
    return data


def spoil(parent: Any, key: Any, rng: random.Random) -> None:
    """Change one value of a table or list into what it should not be."""
    value = parent[key]
    kind = rng.choice(
        ["number", "text", "text", "nested", "wrap", "unwrap", "drop", "add", "rename", "scale", "scale", "repeat"]
    )
    if kind == "number":
        parent[key] = rng.choice(NUMBERS)
    elif kind == "text":
        parent[key] = rng.choice(TEXTS)
    elif kind == "nested":
        parent[key] = copy.deepcopy(rng.choice(NESTED))
    elif kind == "wrap":
        parent[key] = [value] if rng.random() < 0.7 else {"value": value}
    elif kind == "unwrap":
        inner = list(value.values()) if isinstance(value, dict) else value if isinstance(value, list) else [str(value)]
        parent[key] = inner[0] if inner else 0
    elif kind == "drop":
        del parent[key]
    elif kind == "add" and isinstance(parent, dict):
        parent[rng.choice(["x", "colour", f"{key}s", "kind", "", "a.b", "\x1b[31m"])] = rng.choice([1, "1 mm", [], {}])
    elif kind == "rename" and isinstance(parent, dict):
        parent[f"{key}"[:-1] or "x"] = parent.pop(key)
    elif kind == "scale":
        factor = 10.0 ** rng.choice([-300, -30, -9, -6, -3, -1, 1, 3, 6, 9, 30, 300]) * rng.choice([1, -1, 1.7])
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            parent[key] = value * factor
        elif isinstance(value, str) and (words := value.split()) and words[0].replace(".", "").isdigit():
            with contextlib.suppress(ValueError):
                parent[key] = " ".join([f"{float(words[0]) * factor:g}", *words[1:]])
    elif kind == "repeat" and isinstance(value, list):
        parent[key] = value * rng.choice([2, 3, 300])


def damaged(content: bytes, rng: random.Random) -> bytes:
    """Bytes cut off, changed or doubled."""
    kind = rng.choice(["cut", "cut", "change", "change", "line", "null", "none", "latin", "mark", "grow"])
    at = rng.randrange(len(content) + 1)
    if kind == "cut":
        return content[:at]
    if kind == "change":
        body = bytearray(content)
        for _ in range(rng.choice([1, 3, 30])):
            if body:
                body[rng.randrange(min(len(body), rng.choice([64, 1 << 30])))] = rng.randrange(256)
        return bytes(body)
    if kind == "line":
        lines = content.splitlines(keepends=True) or [b""]
        at = rng.randrange(len(lines))
        return b"".join([*lines[:at], lines[at] * rng.choice([0, 2, 50]), *lines[at + 1 :]])
    return {
        "null": content[:at] + b"\0" * rng.choice([1, 100]) + content[at:],
        "none": b"",
        "latin": content[:at] + b"\xe9\xff" + content[at:],
        "mark": b"\xef\xbb\xbf" + content,
        "grow": content * 3,
    }[kind]


def numbered(text: str, rng: random.Random) -> bytes:
    """Text of words one of whose numbers is another."""
    words = text.split(" ")
    marks = [
        k for k, word in enumerate(words) if word.strip().replace(".", "").replace("-", "").replace("e", "").isdigit()
    ]
    for _ in range(rng.choice([1, 1, 2, 5])):
        k = rng.choice(marks)
        words[k] = rng.choice(
            ["0", "-1", "1e308", "1e-308", "nan", "inf", "x", "", "1e400", "-0.0", "7" * 400]
        ) + "\n" * words[k].endswith("\n")
    return " ".join(words).encode()


def toml(data: dict[str, Any], rng: random.Random) -> bytes:
    """A spoiled TOML file."""
    with contextlib.suppress(TypeError, ValueError, AttributeError):
        text = tomli_w.dumps(spoiled(data, rng)).encode("utf-8", "surrogateescape")
        return damaged(text, rng) if rng.random() < 0.08 else text
    return b"["


# --- what is spoiled --------------------------------------------------------------------------------------------------

LENS = {
    "name": "x",
    "wavelength": "587.6 nm",
    "temperature": "20 degC",
    "surfaces": [
        {
            "radius": "51.5 mm",
            "thickness": "9.69 mm",
            "glass": "own",
            "diameter": "50.8 mm",
            "conic": -0.6,
            "asphere": {"r4": "1e-9 mm^-3"},
        },
        {"radius": "inf", "diameter": "50.8 mm", "thickness": "1 mm", "glass": "N-BK7"},
        {"radius": "-400 mm", "diameter": "50.8 mm"},
    ],
    "glasses": {
        "own": {
            "formula": "sellmeier",
            "b": [1.04, 0.23, 1.01],
            "c": [0.006, 0.02, 103.6],
            "range": ["0.3 um", "2.5 um"],
            "cte": 7.1e-6,
            "dndt": {"d": [1.86e-6, 1.31e-8, -1.37e-11], "e": [4.34e-7, 6.27e-10], "lambda_tk": 0.17},
        },
        "other": {
            "formula": "schott",
            "a": [2.27, -0.01, 0.01, 0.0002],
            "range": ["0.3 um", "2.5 um"],
            "dndt": {"rate": 1e-6},
        },
        "number": {"formula": "abbe", "index": 1.6, "abbe": 50, "range": ["0.3 um", "2.5 um"]},
    },
}
ZMX = """VERS 140124
MODE SEQ
NAME x
UNIT MM X W X CM MR CPMM
WAVM 1 0.55 1
PWAV 1
SURF 0
  TYPE STANDARD
  CURV 0.0 0 0 0 0
  DISZ INFINITY
SURF 1
  STOP
  TYPE EVENASPH
  CURV 0.0194 0 0 0 0
  CONI -0.6
  PARM 1 0
  PARM 2 1e-9
  DISZ 9.69
  GLAS N-BK7 0 0 1.5168 64.17 0 0 0 0 0 0
  DIAM 25.4 1 0 0 1
SURF 2
  TYPE STANDARD
  CURV 0.0 0 0 0 0
  DISZ 90
  DIAM 25.4 1 0 0 1
SURF 3
  TYPE STANDARD
  CURV 0.0 0 0 0 0
  DISZ 0
  DIAM 5 0 0 0 1
"""
AGF = """CC x
NM OWN 2 517642.251 1.5168 64.17 0 1 1
GC x
ED 7.1 8.3 2.51 -0.0009 0
CD 1.03961212 0.00600069867 0.231792344 0.0200179144 1.01046945 103.560653 0 0 0 0
TD 1.86e-06 1.31e-08 -1.37e-11 4.34e-07 6.27e-10 0.17 20
OD 1 1 1 1 1 1
LD 0.3 2.5
IT 0.3 0.05 10
"""
YML = """REFERENCES: "x"
DATA:
  - type: formula 1
    wavelength_range: 0.3 2.5
    coefficients: 0 1.03961212 0.0774641769 0.231792344 0.141484668 1.01046945 10.1764755
SPECS:
    n_is_absolute: false
    temperature: 20.0 \u00b0C
    thermal_dispersion:
      - type: "Schott formula"
        coefficients: 1.86e-06 1.31e-08 -1.37e-11 4.34e-07 6.27e-10 0.17
"""
SCENE = {
    "name": "x",
    "light": {"exposure": 5000, "read_noise": 3},
    "objects": [
        {
            "kind": "plane",
            "distance": "330 mm",
            "tilt": ["5 deg", "0 deg"],
            "size": ["30 mm", "30 mm"],
            "texture": {"kind": "checkerboard", "period": "3 mm", "low": 0.1, "high": 0.9},
        },
        {
            "kind": "sphere",
            "distance": "300 mm",
            "radius": "5 mm",
            "texture": {"kind": "noise", "finest": "1 mm", "contrast": 0.1},
        },
        {
            "kind": "tube",
            "start": "200 mm",
            "end": "400 mm",
            "radius": "40 mm",
            "texture": {"kind": "sinusoid", "period": "4 mm"},
        },
        {"kind": "points", "positions": [["0 mm", "0 mm", "300 mm"]], "flux": 2.0},
        {"kind": "plane", "distance": "350 mm", "texture": {"kind": "image", "file": "white.png", "width": "50 mm"}},
        {"kind": "white", "level": 0.5},
    ],
}
OPTIMIZE = tomllib.loads("""
name = "small"
design = "paper"
seed = 2
[variables]
d_2 = ["0.5 mm", "9 mm"]
D_F = {min = "1 mm", max = "4 mm", start = "2 mm"}
[[constraints]]
quantity = "fill_factor"
min = 0.98
max = 1.0
[[constraints]]
quantity = "field_half_width_mm"
at = "15 mm"
min = "2 mm"
[[goals]]
quantity = "views_independent"
direction = "max"
weight = 0.1
[solver]
starts = 2
check = false
""")
TOLERANCE = tomllib.loads("""
name = "small"
design = "rigid-scope"
grade = "high"
trials = 32
seed = 7
fields = ["centre", ["0.1 mm", "0 mm"]]
object_distance = "25 mm"
report = ["axis_ratio"]
yield_target = 0.9
[[perturb]]
place = "aperture.diameter"
tolerance = "5 um"
distribution = "uniform"
[[perturb]]
place = ["aperture.decentre", "main_lens.decentre"]
tolerance = "10 um"
group = "tip"
[[groups]]
name = "tip"
correlation = 0.7
[[goals]]
metric = "fill_factor"
min = 0.9
max = 1.1
[[compensators]]
place = "microlens_array.distance"
range = "20 um"
""")
STORY = tomllib.loads("""
[story]
title = "x"
question = "y"
design = "paper"
[[parts]]
calibration = { board = "8x6 6 mm", boards = 4, tilt = "25 deg", range = "50 mm", f_sigma = "0.5 %" }
""")
CATALOGUE = tomllib.loads("""
[[microlens_arrays]]
part = "A"
maker = "x"
pitch = "63 um"
focal_length = "2 mm"
size = ["10 mm", "10 mm"]
provenance = "y"
confidence = "catalogue"
[[sensors]]
part = "B"
maker = "x"
pixel = "4 um"
pixels = [1000, 800]
provenance = "y"
confidence = "catalogue"
""")
STOOD = {"sigma": "0.1 mm", "relative": True, "distances": {"board.tif": "320 mm"}}
GRADES = {
    "grades": {"tight": "x"},
    "line": [{"place": "main_lens.focal_length", "tight": "1 %", "provenance": "judgement"}],
}
PARAMETERS = """[intrinsics]
focal_length_mm = 100
image_resolution_x_px = 24
image_resolution_y_px = 24
sensor_size_mm = 35
[extrinsics]
num_cams_x = 3
num_cams_y = 3
baseline_mm = 50
focus_distance_m = 4
"""
CALIBRATION: dict[str, Any] = {
    "schema": "roslf.calibration/1",
    "design": "Zhou 2023 bench system",
    "quantities": {
        name: {
            "estimate": mean,
            "unit": "mm",
            "sigma": 0.001 * mean,
            "interval_68": [mean, mean],
            "interval_95": [mean, mean],
            "variance_shares": {},
        }
        for name, mean in (("H", 1.52), ("d_3", 120.0), ("d_2", 2.0), ("f", 100.0))
    },
    "covariance": {
        "places": ["main_lens.focal_length", "aperture.distance", "sensor.distance"],
        "matrix": [[1e-4, 0, 0], [0, 1e-4, 0], [0, 0, 1e-6]],
    },
}
STUDIES = {path.parent.name: path for path in sorted((ROOT / "studies").glob("*/study.toml"))}


def design_of(rng: random.Random) -> dict[str, Any]:
    """Nested values of a design that ships."""
    name = rng.choice(PRESETS)
    return tomllib.loads((ROOT / "designs" / f"{name}.toml").read_text())


# --- pictures ---------------------------------------------------------------------------------------------------------


def white_image() -> np.ndarray:
    """A small raw image of the paper's camera: round spots 12.94 px apart."""
    x = np.arange(110)
    wave = np.cos(2 * np.pi * (x - 54.5) / 12.94)
    return np.clip(0.5 + 0.5 * wave[:, None], 0, 1) * np.clip(0.5 + 0.5 * wave, 0, 1)


def encoded(values: np.ndarray, name: str) -> bytes:
    """A picture as a file of the kind that its name says."""
    stream = io.BytesIO()
    if name.endswith(".tif"):
        import tifffile

        tifffile.imwrite(stream, values, photometric="minisblack" if values.ndim == 2 else None)
    elif name.endswith(".npy"):
        np.save(stream, values)
    elif name.endswith(".mat"):
        from scipy.io import savemat

        savemat(stream, {"LF": values})
    elif name.endswith(".pfm"):
        rows, columns = values.shape
        stream.write(f"Pf\n{columns} {rows}\n-1.0\n".encode() + values.astype("<f4").tobytes())
    else:
        from PIL import Image

        Image.fromarray(np.clip(255 * values, 0, 255).astype(np.uint8)).save(stream, "PNG")
    return stream.getvalue()


def strange_values(values: np.ndarray, rng: random.Random) -> np.ndarray:
    """A picture of another kind, or with numbers that no sensor gives."""
    return strange(values, rng.choice(["same", *STRANGE]), rng)


def strange(values: np.ndarray, kind: str, rng: random.Random) -> np.ndarray:
    """The same of a kind."""
    spot = np.array(values, float)
    flat = spot.reshape(-1)
    if kind in ("nan", "inf", "huge", "negative"):
        flat[rng.randrange(flat.size)] = {"nan": np.nan, "inf": np.inf, "huge": 1e300, "negative": -1e9}[kind]
    made = {
        "black": lambda: 0 * spot,
        "one": lambda: 0 * spot + 1,
        "tiny": lambda: spot * 1e-300,
        "ints": lambda: (spot * 65535).astype(np.uint16),
        "int32": lambda: (spot * 2**31 - 1).astype(np.int32),
        "complex": lambda: spot * (1 + 1j),
        "bool": lambda: spot > 0.5,
        "empty": lambda: spot[:0] if rng.random() < 0.5 else spot[..., :0],
        "thin": lambda: spot[:1],
        "colours": lambda: np.stack([spot] * rng.choice([2, 3, 4, 7]), -1),
        "deep": lambda: spot[None, None],
        "max32": lambda: (spot * 3e38).astype(np.float32),
        "double": lambda: spot.astype(np.float64) * 1e200,
    }.get(kind, lambda: spot.astype(np.float32) if kind != "huge" else spot)
    return made()


def picture(name: str, rng: random.Random) -> bytes:
    """A spoiled picture."""
    values = white_image()
    if name.endswith(".mat"):
        values = np.linspace(0, 1, 3 * 3 * 12 * 12).reshape(3, 3, 12, 12)
    with contextlib.suppress(ValueError, TypeError, OSError, struct.error):
        content = encoded(strange_values(values, rng) if rng.random() < 0.7 else values, name)
        return damaged(content, rng) if rng.random() < 0.5 else content
    return damaged(encoded(values, name if name.endswith((".tif", ".mat")) else "x.png"), rng)


# --- cases ------------------------------------------------------------------------------------------------------------

Maker = Callable[[random.Random], Case]


def options(rng: random.Random, known: dict[str, list[str] | None], most: int = 3) -> list[str]:
    """Some options of a command; None stands for any word, a list for what the option takes besides."""
    chosen = rng.sample(sorted(known), min(len(known), rng.randrange(1, most + 1)))
    given: list[str] = []
    for name in chosen:
        good = known[name]
        if good == []:
            given.append(name)
        else:
            given += [name, rng.choice(good) if good and rng.random() < 0.5 else rng.choice(WORDS)]
    return given


def on_design(rng: random.Random, name: str) -> list[str]:
    """A command that takes a design."""
    quick = [
        ["evaluate", name],
        ["evaluate", name, "--json"],
        ["evaluate", name, "-o", "out.csv"],
        ["evaluate", name, "--field", rng.choice(["0", "1e-3", "0.3,0.2"])],
        ["evaluate", name, "--temperature", "37degC"],
        ["export", name, "-o", "out.zmx"],
        ["export", name, "-o", "out.json"],
        ["render", name, "--plan-only"],
        ["render", name, "--region", "40,40,6,6", "--effects", "none", "-o", "out.tif"],
        ["calibrate", "--plan", name],
        [
            "sweep",
            name,
            "--set",
            rng.choice(["D_F=1..3 mm", "d_2=0.1..2 mm", "light.wavelength=400..700 nm"]),
            "--points",
            "3",
            "--quantity",
            "fill_factor,sigma_z_mm",
            "-o",
            "out.csv",
        ],
        ["datasheet", name, "-o", "out.json"],
        ["datasheet", name, "-o", "out.csv"],
    ]
    slow = [
        ["report", name, "-o", "out"],
        ["depth", name, "--region", "40,40,60,60"],
        ["report", "--compare", name, "paper", "-o", "out"],
    ]
    return rng.choice(slow) if rng.random() < 0.03 else rng.choice(quick)


def bad_design(rng: random.Random) -> Case:
    return Case(on_design(rng, "x.toml"), {"x.toml": toml(design_of(rng), rng)})


def bad_lens(rng: random.Random) -> Case:
    kind = rng.choice(["toml", "toml", "zmx", "agf", "yml"])
    files, lens = {}, copy.deepcopy(LENS)
    if kind == "toml":
        files["lens.toml"] = toml(lens, rng)
    elif kind == "zmx":
        files["lens.zmx"] = damaged(ZMX.encode(), rng) if rng.random() < 0.5 else numbered(ZMX, rng)
    else:
        lens["glasses"] = {"own": {"file": f"glass.{kind}"}}
        files["lens.toml"] = tomli_w.dumps(lens).encode()
        text = AGF if kind == "agf" else YML
        files[f"glass.{kind}"] = damaged(text.encode(), rng) if rng.random() < 0.4 else numbered(text, rng)
    name = next(iter(files))
    if rng.random() < 0.5:
        return Case(["export", name, "-o", rng.choice(["out.zmx", "out.json"])], files)
    design = tomllib.loads((ROOT / "designs/paper-singlet.toml").read_text())
    design["main_lens"]["prescription"] = name
    if rng.random() < 0.3:
        design["environment"] = {"temperature": rng.choice(["37 degC", "-40 degC", "140 degC"])}
    files["x.toml"] = tomli_w.dumps(design).encode()
    return Case(
        rng.choice(
            [
                ["evaluate", "x.toml"],
                ["evaluate", "x.toml", "--json"],
                ["export", "x.toml", "-o", "out.zmx"],
                ["evaluate", "x.toml", "--temperature", "60degC"],
            ]
        ),
        files,
    )


def bad_glass(rng: random.Random) -> Case:
    data = tomllib.loads(
        (ROOT / "designs" / f"{rng.choice(['cystoscope', 'arthroscope', 'grin-needle'])}.toml").read_text()
    )
    material = rng.choice(
        [
            "N-BK7",
            {"index": 1.5, "abbe": 60},
            {"file": "glass.agf", "name": "OWN"},
            {"file": "glass.yml"},
            {"file": "glass.agf"},
            "N-BK77",
        ]
    )
    if isinstance(material, dict) and rng.random() < 0.5:
        material = spoiled(material, rng, 1)
    target = rng.choice(list(data.get("elements", [{}])))
    if rng.random() < 0.5:
        data.setdefault("object_space", {})["medium"] = material
    else:
        target["material"] = material
    files = {"x.toml": tomli_w.dumps(data).encode(), "glass.agf": numbered(AGF, rng), "glass.yml": numbered(YML, rng)}
    return Case(on_design(rng, "x.toml"), files)


def bad_scene(rng: random.Random) -> Case:
    scene = copy.deepcopy(SCENE)
    scene["objects"] = rng.sample(scene["objects"], rng.choice([1, 1, 2]))
    files = {
        "scene.toml": toml(scene, rng),
        "white.png": picture("white.png", rng) if rng.random() < 0.5 else encoded(white_image(), "white.png"),
    }
    rest = (
        ["--plan-only"]
        if rng.random() < 0.6
        else ["--region", "2000,1300,4,4", "--effects", "none", "--budget-intensity", "20%", "-o", "out.tif"]
    )
    return Case(["render", "paper", "--scene", "scene.toml", *rest], files)


def bad_study(rng: random.Random) -> Case:
    kind = rng.choice(["optimize", "tolerance", "tolerance", "grades", "ships", "design"])
    files = {"shop.toml": b""}
    if kind == "ships":
        path = rng.choice(list(STUDIES.values()))
        data = tomllib.loads(path.read_text())
        start = path.parent / "start.toml"
        if start.is_file():
            files["start.toml"] = start.read_bytes()
        command = "tolerance" if "tolerance" in path.parent.name else "optimize"
        data["trials" if command == "tolerance" else "seed"] = 16
        if command == "optimize":
            data.pop("pareto", None), data.pop("robust", None)
            data["solver"] = {"starts": 1, "check": False}
            data["catalogue"] = {"kinds": ["orientations"]} if "real" in path.parent.name else {}
            data.pop("catalogue") if not data["catalogue"] else None
        data.pop("sobol_samples", None), data.pop("report", None)
        return Case([command, "study.toml", "-o", "out"], {**files, "study.toml": toml(data, rng)})
    if kind == "grades":
        data = copy.deepcopy(TOLERANCE) | {"grade": "tight", "grades": "shop.toml"}
        return Case(
            ["tolerance", "study.toml", "-o", "out"],
            {"study.toml": tomli_w.dumps(data).encode(), "shop.toml": toml(GRADES, rng)},
        )
    if kind == "design":
        command = rng.choice(["optimize", "tolerance"])
        data = copy.deepcopy(OPTIMIZE if command == "optimize" else TOLERANCE) | {"design": "x.toml"}
        return Case(
            [command, "study.toml", "-o", "out"],
            {"study.toml": tomli_w.dumps(data).encode(), "x.toml": toml(design_of(rng), rng)},
        )
    data = OPTIMIZE if kind == "optimize" else TOLERANCE
    return Case([kind, "study.toml", "-o", "out"], {"study.toml": toml(data, rng)})


def bad_story(rng: random.Random) -> Case:
    story = copy.deepcopy(STORY)
    extra = rng.choice([None, {"optimize": "optimize.toml"}, {"tolerance": "tolerance.toml"}])
    if extra:
        story["parts"].insert(0, extra)
    files = {"optimize.toml": tomli_w.dumps(OPTIMIZE).encode(), "tolerance.toml": tomli_w.dumps(TOLERANCE).encode()}
    which = rng.choice(["story", "story", "optimize.toml", "tolerance.toml"])
    files["story.toml"] = toml(story, rng) if which == "story" else tomli_w.dumps(story).encode()
    if which != "story":
        files[which] = toml(OPTIMIZE if which == "optimize.toml" else TOLERANCE, rng)
    return Case(
        rng.choice([["report", "story.toml", "-o", "out"], ["datasheet", "story.toml", "-o", "out.json"]]), files
    )


def bad_picture(rng: random.Random) -> Case:
    name = rng.choice(["raw.tif", "raw.tif", "raw.png", "raw.npy", "raw.mat"])
    other = rng.choice(["white.tif", "white.png"])
    files = {
        name: picture(name, rng),
        other: picture(other, rng) if rng.random() < 0.5 else encoded(white_image(), other),
    }
    command = rng.choice(["decode", "depth"])
    extra = [
        ["--white", other],
        ["--white", other, "--design", "paper"],
        ["--design", "paper"],
        ["--dark", other, "--design", "paper"],
        [],
    ]
    given = [command, name, *rng.choice(extra), "-o", "out"]
    if command == "depth" and rng.random() < 0.5:
        given += ["--region", "2000,1300,110,110"]
    return Case(given, files)


def bad_views(rng: random.Random) -> Case:
    values = white_image()[:24, :24]
    files = {f"views/view_{k // 3:02d}_{k % 3:02d}.png": encoded(values, "x.png") for k in range(9)}
    if rng.random() < 0.6:
        k = rng.choice(sorted(files))
        files[k if rng.random() < 0.7 else "views/view_9999_9999.png"] = picture("x.png", rng)
    if rng.random() < 0.4:
        files["views/parameters.cfg"] = (
            damaged(PARAMETERS.encode(), rng)
            if rng.random() < 0.4
            else numbered(PARAMETERS.replace("\n", " \n "), rng).replace(b" \n ", b"\n")
        )
    given = [rng.choice(["depth", "decode"]), "views", "-o", "out"]
    if rng.random() < 0.4 and given[0] == "depth":
        with contextlib.suppress(ValueError):
            files["map.pfm"] = (
                damaged(encoded(values, "x.pfm"), rng)
                if rng.random() < 0.6
                else encoded(strange_values(values, rng).real.astype(np.float32), "x.pfm")
            )
            given += ["--truth", "map.pfm"]
    if rng.random() < 0.4:
        given += options(
            rng,
            {"--focus": ["1", "0", "-1,1"], "--row": ["3"]}
            if given[0] == "decode"
            else {"--window": ["3", "5"], "--between": None, "--sigma": None, "--design": ["paper"]},
            2,
        )
    return Case(given, files)


def bad_capture(rng: random.Random) -> Case:
    files = {
        f"images/{name}": picture(name, rng) if rng.random() < 0.4 else encoded(white_image(), name)
        for name in ("white.tif", "board.tif", "dark.png")
        if rng.random() < 0.85
    }
    files["stood.toml"] = toml(STOOD, rng)
    given = [
        "calibrate",
        "images",
        "--design",
        "paper",
        "--board",
        rng.choice(["4x5 6 mm", "4x4 1 mm", *WORDS]),
        "-o",
        "out",
        "--no-posterior",
    ]
    if rng.random() < 0.4:
        given += ["--distances", "stood.toml"]
    return Case(given, files)


def bad_calibration(rng: random.Random) -> Case:
    data = json.dumps(spoiled(CALIBRATION, rng) if rng.random() < 0.8 else CALIBRATION, default=str).encode()
    text = dumps(load("paper")).encode()
    files = {
        "monday/calibration.json": damaged(data, rng) if rng.random() < 0.3 else data,
        "monday/calibrated.toml": toml(tomllib.loads(text.decode()), rng) if rng.random() < 0.4 else text,
        "raw.tif": encoded(white_image(), "raw.tif"),
    }
    if rng.random() < 0.1:
        files.pop(rng.choice(sorted(files)))
    raw = ["raw.tif", "--white", "raw.tif", "--calibration", "monday", "-o", "out"]
    given = [
        ["decode", *raw],
        ["depth", *raw, "--region", "2000,1300,110,110"],
        ["datasheet", "paper", "--calibration", "monday", "-o", "out.json"],
    ]
    return Case(rng.choice(given), files)


def bad_catalogue(rng: random.Random) -> Case:
    return Case(
        ["catalogue", "--file", "parts.toml", *(["--json"] if rng.random() < 0.5 else [])],
        {"parts.toml": toml(CATALOGUE, rng)},
    )


DIGITS = ["1e-3", "0.1", "1e-9", "1", "2"]
KNOWN: dict[str, tuple[list[str], dict[str, list[str] | None]]] = {
    "evaluate": (
        ["evaluate", "paper"],
        {
            "--field": ["1", "11.15,7"],
            "--temperature": ["37degC"],
            "--json": [],
            "-o": ["out.json", "out.csv"],
            "--accuracy": DIGITS,
        },
    ),
    "evaluate scope": (
        ["evaluate", "cystoscope"],
        {"--field": ["0.3", "0.1,0.2"], "--temperature": ["37degC", "-59 degC"], "--json": [], "--accuracy": DIGITS},
    ),
    "render": (
        ["render", "paper"],
        {
            "--plan-only": [],
            "--region": ["0,0,6,6"],
            "--budget-px": DIGITS,
            "--budget-intensity": ["1%"],
            "--effects": ["none", "+x"],
            "--seed": ["1"],
            "--depth": ["16"],
            "--scene": PLACES,
            "-o": ["out.tif"],
            "--json": [],
        },
    ),
    "depth": (
        ["depth", "x.tif"],
        {
            "--white": PLACES,
            "--dark": PLACES,
            "--design": ["paper", *PLACES],
            "--calibration": PLACES,
            "--between": None,
            "--window": None,
            "--truth": PLACES,
            "--sigma": None,
            "--region": None,
            "--seed": ["1"],
            "--exposures": ["1"],
            "-o": ["out"],
        },
    ),
    "depth design": (
        ["depth", "paper", "--region", "0,0,1,1"],
        {
            "--scene": PLACES,
            "--believed": ["paper", *PLACES],
            "--exposures": None,
            "--seed": None,
            "--region": ["0,0,2,2"],
            "--window": None,
        },
    ),
    "report": (
        ["report", "missing.toml"],
        {
            "--compare": [],
            "--pdf": [],
            "--paper": ["a4"],
            "--figure": ["all"],
            "--seed": None,
            "--accuracy": DIGITS,
            "--calibration": PLACES,
            "-o": ["out"],
        },
    ),
    "report of a preset": (
        ["report", "paper"],
        {
            "--paper": ["b5"],
            "--seed": ["-1"],
            "--accuracy": ["0", "2", "nan", "x"],
            "--calibration": ["missing", "folder", "empty"],
        },
    ),
    "datasheet": (
        ["datasheet", "paper"],
        {"--paper": ["a4"], "--calibration": PLACES, "--seed": None, "-o": ["out.json", "out.csv"]},
    ),
    "sweep": (
        ["sweep", "paper", "--points", "3"],
        {
            "--set": [
                "d_3=0..150 mm",
                "D_F=1e-300..1 mm",
                "d_2=1..1e308 mm",
                "light.wavelength=1..2 nm",
                "D_F=3..1 mm",
                "d_1=1..100 mm",
            ],
            "--quantity": ["fill_factor", "sigma_z_mm,fill_factor", "mtf50_lp_per_mm"],
            "--at": ["20 mm"],
            "--points": ["2"],
            "-o": ["out.csv", "out.svg"],
        },
    ),
    "tolerance": (
        ["tolerance", "tolerance.toml", "-o", "out"],
        {"--seed": None, "--workers": None, "--trials": ["4"], "--accuracy": ["0.3"], "--resume": [], "--json": []},
    ),
    "optimize": (
        ["optimize", "optimize.toml", "-o", "out"],
        {"--seed": None, "--accuracy": ["0.3", *DIGITS], "--json": []},
    ),
    "calibrate": (
        ["calibrate", "images"],
        {
            "--design": ["paper", *PLACES],
            "--board": ["4x5 6 mm"],
            "-o": ["out"],
            "--f-sigma": ["1%"],
            "--d-sigma": ["1%"],
            "--cell-sigma": ["1%"],
            "--sigma": None,
            "--white-pitch": None,
            "--distances": PLACES,
            "--distortion": ["1", "3"],
            "--use-in": ["water"],
            "--accuracy": DIGITS,
            "--diffraction": ["on"],
        },
    ),
    "plan": (
        ["calibrate", "--plan"],
        {
            "--boards": ["3", "12"],
            "--tilt": ["20 deg"],
            "--distance": ["300 mm"],
            "--range": ["50 mm"],
            "--noise": ["0.06"],
            "--board": ["4x5 6 mm"],
            "--f-sigma": ["1%"],
            "--d-sigma": None,
            "--cell-sigma": None,
            "--sigma": None,
            "--white-pitch": ["0.01%"],
            "--distortion": ["1"],
            "--json": [],
        },
    ),
    "decode": (
        ["decode", "x.tif"],
        {
            "--white": PLACES,
            "--dark": PLACES,
            "--design": ["paper", *PLACES],
            "--calibration": PLACES,
            "--focus": ["1", "320 mm"],
            "--row": None,
            "-o": ["out"],
        },
    ),
    "decode white": (
        ["decode", "white.tif", "--white", "white.tif", "--design", "paper"],
        {"--focus": ["1e-3", "320 mm", "1e12 mm"], "--row": ["1"]},
    ),
    "catalogue": (
        ["catalogue"],
        {
            "--kind": ["lenses"],
            "--where": ["focal_length<=100 mm", "pitch<1e308 mm", "maker=Thorlabs", "pitch=x", "<1", "x<"],
            "--file": PLACES,
            "--json": [],
        },
    ),
    "export": (["export", "paper-singlet"], {"-o": ["out.zmx", "out.json"]}),
    "accuracy": (
        ["accuracy", "paper"],
        {
            "--accuracy": ["0", "x"],
            "--quantity": ["nothing"],
            "--scene": PLACES,
            "--field": ["x"],
            "--jobs": ["-1"],
            "--seed": ["-1"],
        },
    ),
    "explore": (["explore", "missing"], {"--port": ["-1", "99999"], "--host": ["x"]}),
    "presets": (["presets"], {"--json": [], "--x": None}),
    "quantities": (["quantities"], {"--json": [], "x": None}),
}


def bad_option(rng: random.Random) -> Case:
    name = rng.choice(sorted(KNOWN))
    words, known = KNOWN[name]
    words = list(words)
    if name == "plan":
        words.append(rng.choice(["paper", "rigid-scope", "cystoscope", *PLACES]))
    given = options(rng, known)
    if name == "accuracy":  # what is good there takes minutes
        given += ["--seed", "-1"]
    files = {"tolerance.toml": tomli_w.dumps(TOLERANCE).encode(), "optimize.toml": tomli_w.dumps(OPTIMIZE).encode()}
    files["white.tif"] = encoded(white_image(), "white.tif")
    return Case([*words, *given], files)


def bad_place(rng: random.Random) -> Case:
    place = rng.choice(PLACES)
    last = (
        ["-o", rng.choice(TARGETS).format(rng.choice([".json", ".csv", ".zmx", ".tif", ".html", ""]))]
        if rng.random() < 0.5
        else []
    )
    words = rng.choice(
        [
            ["evaluate"],
            ["datasheet"],
            ["export"],
            ["render"],
            ["report"],
            ["tolerance"],
            ["optimize"],
            ["calibrate", "--plan"],
            ["decode"],
            ["depth"],
            ["calibrate"],
            ["catalogue", "--file"],
            ["evaluate", "--json"],
            ["render", "paper", "--plan-only", "--scene"],
            ["sweep", "--set", "d_3=0..1 mm", "--quantity", "fill_factor"],
            ["accuracy", "--jobs", "-1"],
            ["depth", "x.tif", "--white"],
            ["decode", "x.tif", "--calibration"],
            ["report", "--compare", "paper"],
            ["explore", "--port", "x"],
        ]
    )
    return Case([*words, place, *last])


def bad_target(rng: random.Random) -> Case:
    target = rng.choice(TARGETS)
    ways: list[tuple[list[str], str]] = [
        (["evaluate", "paper"], ".json"),
        (["export", "paper"], ".zmx"),
        (["export", "LA1050-A"], ".json"),
        (["datasheet", "paper"], ".json"),
        (["sweep", "paper", "--set", "d_3=0..9 mm", "--quantity", "fill_factor", "--points", "3"], ".csv"),
        (["render", "paper", "--region", "0,0,4,4", "--effects", "none"], ".tif"),
        (["render", "paper", "--region", "0,0,4,4", "--effects", "none"], ".png"),
        (["decode", "white.tif", "--white", "white.tif"], ""),
        (["tolerance", "tolerance.toml"], ""),
        (["optimize", "optimize.toml"], ""),
        (["depth", "white.tif", "--design", "paper"], ""),
    ]
    words, ending = rng.choice(ways)
    files = {"tolerance.toml": tomli_w.dumps(TOLERANCE).encode(), "optimize.toml": tomli_w.dumps(OPTIMIZE).encode()}
    files["white.tif"] = encoded(white_image(), "white.tif")
    return Case([*words, "-o", target.format(ending)], files)


EXTREMES: list[Any] = [
    1e308,
    -1e308,
    1e-300,
    0,
    -1,
    float("nan"),
    float("inf"),
    10**18,
    True,
    "",
    "x",
    "1e308 mm",
    "1e-300 mm",
    "-1 mm",
    "0 mm",
    "1e15 mm",
    "1e-12 mm",
    "1 m",
    "1 um",
    [],
    {},
    "wrap",
    "drop",
]
STRANGE = (
    "black",
    "one",
    "nan",
    "inf",
    "huge",
    "tiny",
    "negative",
    "ints",
    "int32",
    "complex",
    "bool",
    "empty",
    "thin",
    "colours",
    "deep",
    "double",
    "max32",
)


def every() -> Iterator[tuple[str, Case]]:
    """Each key of each kind of file with each extreme value, and each strange picture wherever a picture is read."""
    paper = tomllib.loads((ROOT / "designs/paper.toml").read_text())
    scope = tomllib.loads((ROOT / "designs/cystoscope.toml").read_text())
    singlet = tomllib.loads((ROOT / "designs/paper-singlet.toml").read_text())
    singlet["main_lens"]["prescription"] = "lens.toml"
    behind = {"d.toml": tomli_w.dumps(singlet).encode()}
    story = {"story.toml": {**STORY}}
    bases: list[tuple[str, dict[str, Any], list[str], dict[str, bytes]]] = [
        ("paper", paper, ["evaluate", "x.toml", "--json"], {}),
        ("cystoscope", scope, ["evaluate", "x.toml", "--json"], {}),
        ("paper sheet", paper, ["datasheet", "x.toml", "-o", "out.json"], {}),
        ("paper plan", paper, ["calibrate", "--plan", "x.toml"], {}),
        ("paper effects", scope, ["render", "x.toml", "--plan-only"], {}),
        ("paper zmx", scope, ["export", "x.toml", "-o", "out.zmx"], {}),
        ("tolerance", TOLERANCE, ["tolerance", "x.toml", "-o", "out"], {}),
        ("optimize", OPTIMIZE, ["optimize", "x.toml", "-o", "out"], {}),
        ("story", story["story.toml"], ["datasheet", "x.toml", "-o", "out.json"], {}),
        ("catalogue", CATALOGUE, ["catalogue", "--file", "x.toml"], {}),
        ("catalogue where", CATALOGUE, ["catalogue", "--file", "x.toml", "--where", "pitch<1 mm", "--json"], {}),
        (
            "grades",
            GRADES,
            ["tolerance", "s.toml", "-o", "out"],
            {"s.toml": tomli_w.dumps({**TOLERANCE, "grade": "tight", "grades": "x.toml"}).encode()},
        ),
        ("lens", LENS, ["export", "lens.toml", "-o", "out.zmx"], {}),
        ("lens warm", LENS, ["evaluate", "d.toml", "--temperature", "60degC"], behind),
        (
            "stood",
            STOOD,
            ["calibrate", "images", "--design", "paper", "--board", "4x5 6 mm", "-o", "out", "--distances", "x.toml"],
            {
                "images/white.tif": encoded(white_image(), "white.tif"),
                "images/board.tif": encoded(white_image(), "x.tif"),
            },
        ),
    ]
    for k in range(len(SCENE["objects"])):
        one = {**SCENE, "objects": [SCENE["objects"][k]]}
        extra = {"white.png": encoded(white_image(), "white.png")}
        bases.append((f"scene {k}", one, ["render", "paper", "--scene", "x.toml", "--plan-only"], extra))
        bases.append(
            (
                f"scene {k} drawn",
                one,
                [
                    "render",
                    "paper",
                    "--scene",
                    "x.toml",
                    "--region",
                    "2000,1300,3,3",
                    "--effects",
                    "none",
                    "--budget-intensity",
                    "20%",
                    "-o",
                    "out.tif",
                ],
                extra,
            )
        )
    for name, base, words, files in bases:
        for place in paths(base):
            for value in EXTREMES:
                data = copy.deepcopy(base)
                parent = data
                for step in place[:-1]:
                    parent = parent[step]
                if value == "drop":
                    del parent[place[-1]]
                else:
                    parent[place[-1]] = [parent[place[-1]]] if value == "wrap" else value
                target = "lens.toml" if name.startswith("lens") else "x.toml"
                yield (
                    f"{name} {'.'.join(map(str, place))} = {value}",
                    Case(words, {**files, target: tomli_w.dumps(data).encode()}),
                )
    studies = {"tolerance.toml": tomli_w.dumps(TOLERANCE).encode(), "optimize.toml": tomli_w.dumps(OPTIMIZE).encode()}
    studies["white.tif"] = encoded(white_image(), "white.tif")
    for name, (words, known) in KNOWN.items():
        if name not in ("accuracy", "explore"):
            for option, good in known.items():
                for word in WORDS if good != [] else ():
                    if not (option == "-o" and word in ("/", "..")):
                        given = [*words, *(["paper"] if name == "plan" else []), option, word]
                        yield f"{name} {option} {word[:20]}", Case(given, studies)
    white = encoded(white_image(), "white.tif")
    image_scene = tomli_w.dumps({"objects": [SCENE["objects"][4]]}).encode()
    for kind in STRANGE:
        for name in ("raw.tif", "raw.png", "raw.npy"):
            with contextlib.suppress(ValueError, TypeError, OSError, struct.error, SystemError):
                bad = encoded(strange(white_image(), kind, random.Random(0)), name)
                for words in (
                    ["decode", name, "--white", "w.tif"],
                    ["decode", name, "--design", "paper"],
                    ["decode", "w.tif", "--white", name],
                    ["decode", name, "--white", name, "--design", "paper"],
                    ["decode", name, "--white", "w.tif", "--dark", name],
                    ["depth", name, "--white", "w.tif", "--design", "paper", "--region", "2000,1300,110,110"],
                    ["depth", "w.tif", "--white", name, "--design", "paper", "--region", "2000,1300,110,110"],
                    ["depth", name, "--design", "paper", "--region", "2000,1300,110,110"],
                ):
                    yield f"{kind} {name}", Case([*words, "-o", "out"], {name: bad, "w.tif": white})
                yield (
                    f"{kind} scene {name}",
                    Case(
                        [
                            "render",
                            "paper",
                            "--scene",
                            "s.toml",
                            "--region",
                            "2000,1300,3,3",
                            "--effects",
                            "none",
                            "--budget-intensity",
                            "20%",
                            "-o",
                            "out.tif",
                        ],
                        {"white.png": bad, "s.toml": image_scene},
                    ),
                )
                yield (
                    f"{kind} scene2 {name}",
                    Case(
                        [
                            "render",
                            "paper",
                            "--scene",
                            "s.toml",
                            "--region",
                            "2000,1300,3,3",
                            "--effects",
                            "none",
                            "--budget-intensity",
                            "20%",
                            "-o",
                            "out.tif",
                        ],
                        {"white.tif": bad, "s.toml": image_scene.replace(b"white.png", b"white.tif")},
                    ),
                )
                yield (
                    f"{kind} capture {name}",
                    Case(
                        [
                            "calibrate",
                            "images",
                            "--design",
                            "paper",
                            "--board",
                            "4x5 6 mm",
                            "-o",
                            "out",
                            "--no-posterior",
                        ],
                        {f"images/{name}": bad, "images/white.tif": white},
                    ),
                )
                yield (
                    f"{kind} capture2 {name}",
                    Case(
                        [
                            "calibrate",
                            "images",
                            "--design",
                            "paper",
                            "--board",
                            "4x5 6 mm",
                            "-o",
                            "out",
                            "--no-posterior",
                        ],
                        {f"images/white.{name[4:]}": bad, "images/b.tif": white},
                    ),
                )
                views = {f"views/view_{k // 3:02d}_{k % 3:02d}.{name[4:]}": bad for k in range(9)}
                yield f"{kind} views {name}", Case(["depth", "views", "-o", "out"], views)
                yield f"{kind} views {name}", Case(["decode", "views", "-o", "out"], views)
        with contextlib.suppress(ValueError, TypeError):
            values = strange(np.linspace(0, 1, 1296).reshape(3, 3, 12, 12), kind, random.Random(0))
            for words in (["decode", "x.mat", "-o", "out"], ["depth", "x.mat", "-o", "out"]):
                yield f"{kind} mat", Case(words, {"x.mat": encoded(values, "x.mat")})
            truth = np.real(strange(np.random.default_rng(0).random((24, 24)), kind, random.Random(0))).astype(
                np.float32
            )
            views = {
                f"views/view_{k // 3:02d}_{k % 3:02d}.png": encoded(np.random.default_rng(0).random((24, 24)), "x.png")
                for k in range(9)
            }
            yield (
                f"{kind} pfm",
                Case(["depth", "views", "-o", "out", "--truth", "t.pfm"], {**views, "t.pfm": encoded(truth, "t.pfm")}),
            )
            yield (
                f"{kind} pfm",
                Case(
                    ["depth", "views", "-o", "out"],
                    {
                        **views,
                        "views/gt_disp_lowres.pfm": encoded(truth, "t.pfm"),
                        "views/parameters.cfg": PARAMETERS.encode(),
                    },
                ),
            )


FACTORS = (1e-6, 1e-3, 1e3, 1e6)
MATTER = ("main_lens", "aperture", "microlens_array", "sensor", "light")
"""Parts of a design of which `scaled` takes lengths."""


def lengths(data: dict[str, Any]) -> list[tuple[Any, ...]]:
    """Where lengths stand in the parts of a design's nested values that every camera has."""
    given = [place for place in paths({key: data[key] for key in MATTER}) if len(place) > 1]
    texts = ((place, reduce(getitem, place, data)) for place in given)
    return [place for place, text in texts if isinstance(text, str) and re.fullmatch(r"[-\d.e]+ [a-z]+", text)]


def scaled_by(data: dict[str, Any], place: tuple[Any, ...], factor: float) -> dict[str, Any]:
    """Nested values of which one length is a factor longer."""
    data = copy.deepcopy(data)
    parent = reduce(getitem, place[:-1], data)
    number, unit = parent[place[-1]].split()
    parent[place[-1]] = f"{float(number) * factor:.9g} {unit}"
    return data


def scaled_lengths() -> Iterator[tuple[list[str], str, tuple[Any, ...], float]]:
    """Each length of three designs a factor longer or shorter, to each command that computes with a design alone."""
    commands = [
        ["evaluate", "x.toml", "--json"],
        ["datasheet", "x.toml", "-o", "out.json"],
        ["render", "x.toml", "--plan-only"],
        [
            "sweep",
            "x.toml",
            "--set",
            "aperture.diameter=1..4 mm",
            "--quantity",
            "fill_factor,sigma_z_mm",
            "-o",
            "o.csv",
        ],
        ["tolerance", "study.toml", "-o", "out", "--trials", "64", "--json"],
        ["depth", "x.toml", "--json"],
        ["report", "x.toml", "-o", "out"],
    ]
    names = ("paper", "cystoscope", "paper-singlet")
    places = {name: lengths(tomllib.loads((ROOT / "designs" / f"{name}.toml").read_text())) for name in names}
    for words in commands:
        for name in names:
            for place in places[name]:
                for factor in FACTORS:
                    yield words, name, place, factor


def scaled_case(words: list[str], name: str, place: tuple[Any, ...], factor: float) -> tuple[str, Case]:
    """One of what `scaled_lengths` lists, with its files."""
    tolerance = {
        "design": "x.toml",
        "perturb": [{"place": "aperture.diameter", "tolerance": "1 um"}],
        "goals": [{"metric": "fill_factor", "min": 0.9}],
    }
    data = tomllib.loads((ROOT / "designs" / f"{name}.toml").read_text())
    files = {"x.toml": scaled_by(data, place, factor), "study.toml": tolerance}
    what = f"{name} {'.'.join(map(str, place))} x {factor:g}"
    return what, Case(words, {key: tomli_w.dumps(value).encode() for key, value in files.items()})


def scaled() -> Iterator[tuple[str, Case]]:
    """Every case of `scaled_lengths`."""
    return (scaled_case(*one) for one in scaled_lengths())


MAKERS: dict[Maker, int] = {
    bad_design: 26,
    bad_lens: 9,
    bad_glass: 4,
    bad_scene: 9,
    bad_study: 12,
    bad_story: 4,
    bad_picture: 8,
    bad_views: 6,
    bad_capture: 3,
    bad_calibration: 5,
    bad_catalogue: 3,
    bad_option: 14,
    bad_place: 7,
    bad_target: 4,
}
"""Kinds of cases, and how many of each in a hundred or so."""
LISTS = {EVERY: every, SCALED: scaled}
QUICK = (bad_design, bad_lens, bad_glass, bad_option, bad_place, bad_catalogue)


def case(seed: int | str, number: int, makers: Any = None) -> tuple[str, Case]:
    """One case by its number, and its kind."""
    rng = random.Random(f"{seed}-{number}")
    make = rng.choices(list(MAKERS), list(MAKERS.values()))[0] if makers is None else makers[number % len(makers)]
    one = make(rng)
    for k, word in enumerate(one.arguments[1:], 1):  # nothing is to be written beside the case's own folder
        if one.arguments[k - 1] == "-o" and word in ("/", ".."):
            one.arguments[k] = "out"
    return make.__name__.removeprefix("bad_"), one


def lay_out(one: Case) -> None:
    """Write what a case needs into the current folder."""
    for name, content in one.files.items():
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).write_bytes(content)
    Path("folder").mkdir(exist_ok=True)
    Path("file").write_bytes(b"")
    Path("empty").write_bytes(b"")
    Path("binary.toml").write_bytes(bytes(range(256)))
    Path("latin.toml").write_bytes("name = 'é'".encode("latin-1"))
    os.mkfifo("pipe")
    os.symlink("loop", "loop")


def run(arguments: list[str]) -> Result:
    """Run a command as the shell would, in the current folder, and say what became of it."""
    before = {path.as_posix() for path in Path().rglob("*")}
    began = time.process_time(), resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    streams = [io.TextIOWrapper(io.BytesIO(), "utf-8", errors="backslashreplace", write_through=True) for _ in range(2)]
    trace, code = "", None
    with (
        warnings.catch_warnings(record=True) as caught,
        contextlib.redirect_stdout(streams[0]),
        contextlib.redirect_stderr(streams[1]),
    ):
        warnings.simplefilter("always")
        warnings.filterwarnings("ignore", module="numba")
        try:
            code = main(arguments)
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 1
        except Exception:  # noqa: BLE001 - what any traceback says is what is looked for
            trace = traceback.format_exc()
    seconds = time.process_time() - began[0] + resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - began[1]
    out, err = (stream.buffer.getvalue().decode() for stream in streams)  # type: ignore[attr-defined]
    notes = [f"{Path(w.filename).name}:{w.lineno}: {w.category.__name__}: {w.message}" for w in caught]
    left = sorted({path.as_posix() for path in Path().rglob("*")} - before)
    return Result(code, out, err, notes, trace, seconds, 0, left)


# --- one process that runs them, and one that watches it --------------------------------------------------------------


def _peak() -> int:
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmHWM"):
            return int(line.split()[1]) << 10
    return 0


def worker(seed: str) -> None:
    """Run the cases whose numbers come on stdin; a line of JSON each."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    main(["evaluate", "paper", "-o", os.devnull.replace("null", "x.xyz")])
    size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (size + BYTES + (BYTES >> 1),) * 2)
    home = os.getcwd()
    listed = list(LISTS[seed]()) if seed in LISTS else []
    for line in sys.stdin:
        kind, one = listed[int(line)] if listed else case(seed, int(line))
        with tempfile.TemporaryDirectory(prefix="fuzz") as folder:
            os.chdir(folder)
            lay_out(one)
            with contextlib.suppress(OSError):
                Path("/proc/self/clear_refs").write_text("5")
            start = _peak()
            result = run(one.arguments)
            result.memory = _peak() - start
            os.chdir(home)
        result.out = result.out[:20000]
        result.err = result.err[:20000]
        answers.write(
            json.dumps({"number": int(line), "kind": kind, "arguments": one.arguments, **asdict(result)}) + "\n"
        )
        answers.flush()


def start(seed: str) -> subprocess.Popen[str]:
    """A new worker."""
    words = [sys.executable, "-m", "tests.fuzz_bad_inputs", "--worker", "--seed", seed]
    return subprocess.Popen(
        words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, cwd=ROOT
    )


def ask(process: subprocess.Popen[str], number: int) -> dict[str, Any] | None:
    """What became of a case; None where it never ended, or took the process with it."""
    assert process.stdin
    assert process.stdout

    def late(*_: object) -> None:
        raise TimeoutError

    signal.signal(signal.SIGALRM, late)
    signal.alarm(int(PATIENCE))
    try:
        process.stdin.write(f"{number}\n")
        process.stdin.flush()
        line = process.stdout.readline()
    except (TimeoutError, BrokenPipeError):
        return None
    finally:
        signal.alarm(0)
    return json.loads(line) if line else None


def fuzz(seed: str, numbers: range, log: Path) -> int:
    """Run cases one after the other; returns how many were told wrongly."""
    process, counts, wrong = start(seed), Counter[str](), Counter[str]()
    bad = 0
    with log.open("a") as file:
        for number in numbers:
            answer = ask(process, number)
            if answer is None:
                process.kill()
                process.wait()
                process = start(seed)
                kind, one = next(islice(LISTS[seed](), number, None)) if seed in LISTS else case(seed, number)
                answer = {"number": number, "kind": kind, "arguments": one.arguments, **asdict(Result(None))}
                told = ["killed"]
            else:
                result = Result(**{key: answer[key] for key in Result.__dataclass_fields__})
                told = faults(result) + ["slow"] * (seed == SCALED and result.seconds > SECONDS and result.code == 0)
            counts[f"exit {answer['code']}"] += 1
            wrong.update(told)
            if told:
                bad += 1
                file.write(json.dumps({"faults": told, "seed": seed, **answer}) + "\n")
                file.flush()
                shown = (answer["trace"].splitlines() or answer["warnings"] or answer["err"].splitlines() or [""])[-1]
                print(
                    f"{number} {answer['kind']} {told} {' '.join(answer['arguments'])[:120]!a}: {shown[:200]!a}",
                    flush=True,
                )
            if number % 100 == 99:
                print(f"-- {number + 1}: {dict(counts)}, wrong {bad}", flush=True)
    process.kill()
    process.wait()
    print(f"seed {seed}: {len(numbers)} cases, {dict(counts)}; wrong {bad}: {dict(wrong)}")
    return bad


def command() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", default="1")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=2500)
    parser.add_argument("--log", type=Path, default=Path(tempfile.gettempdir()) / "fuzz.jsonl")
    parser.add_argument("--keep", type=Path, help="write the first case's files here, and run it")
    parser.add_argument("--worker", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.worker:
        worker(given.seed)
        return 0
    if given.keep:
        shutil.rmtree(given.keep, ignore_errors=True)
        given.keep.mkdir(parents=True)
        os.chdir(given.keep)
        every_one = islice(LISTS[given.seed](), given.first, None) if given.seed in LISTS else iter(())
        _, one = next(every_one, None) or case(given.seed, given.first)
        lay_out(one)
        print(one.arguments)
        result = run(one.arguments)
        print(result.trace or result.err, result.warnings, f"exit {result.code}, {result.seconds:.1f} s", sep="\n")
        return 1 if faults(result) else 0
    most = sum(1 for _ in LISTS[given.seed]()) if given.seed in LISTS else given.first + given.count
    return 1 if fuzz(given.seed, range(given.first, min(given.first + given.count, most)), given.log) else 0


if __name__ == "__main__":
    sys.exit(command())
