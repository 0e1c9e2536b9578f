"""A few of the bad inputs that `tests/fuzz_bad_inputs.py` draws, of those that are quick."""

import os
import random
import tomllib

import pytest
import tomli_w

from tests.fuzz_bad_inputs import QUICK, ROOT, Case, case, faults, lay_out, run, scaled_by, scaled_case, scaled_lengths

SCALED = [one for one in scaled_lengths() if one[0][0] in ("evaluate", "render", "sweep", "tolerance")]


@pytest.mark.parametrize("number", range(42))
def test_a_bad_input_is_told_in_lines(number, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    _, one = case("make test", number, QUICK)
    lay_out(one)
    result = run(one.arguments)
    os.unlink("pipe")  # which pytest, tidying up, would wait for
    result.seconds = 0.0  # first use of kernels and libraries counts there
    assert faults(result) == [], (one.arguments, result.trace or result.err, result.warnings)


@pytest.mark.parametrize("number", random.Random("lengths").sample(range(len(SCALED)), 24))
def test_a_camera_of_one_length_a_million_times_another(number, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    what, one = scaled_case(*SCALED[number])
    lay_out(one)
    result = run(one.arguments)
    os.unlink("pipe")
    result.seconds = 0.0
    assert faults(result) == [], (what, one.arguments, result.trace or result.err, result.warnings)


@pytest.mark.parametrize(
    ("place", "factor", "words", "key"),
    [
        (("sensor", "pixel"), 1e-3, ["render", "x.toml", "-o", "o.tif"], "region: "),
        (("sensor", "pixel"), 1e-6, ["render", "x.toml", "-o", "o.tif", "--region", "0,0,99999,99999"], "region: "),
        (("microlens_array", "pitch"), 1e-3, ["depth", "x.toml"], "microlens_array.pitch: "),
        (
            ("microlens_array", "pitch"),
            1e-6,
            ["depth", "x.toml", "--region", "2240,1480,60,60"],
            "microlens_array.pitch: ",
        ),
    ],
)
def test_pictures_that_no_memory_holds(place, factor, words, key, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    data = scaled_by(tomllib.loads((ROOT / "designs" / "paper.toml").read_text()), place, factor)
    lay_out(Case(words, {"x.toml": tomli_w.dumps(data).encode()}))
    result = run(words)
    os.unlink("pipe")
    assert (result.code, result.trace, result.left) == (2, "", [])
    assert key in result.err
