"""A few of the bad inputs that `tests/fuzz_bad_inputs.py` draws, of those that are quick."""

import os

import pytest

from tests.fuzz_bad_inputs import QUICK, case, faults, lay_out, run


@pytest.mark.parametrize("number", range(42))
def test_a_bad_input_is_told_in_lines(number, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    _, one = case("make test", number, QUICK)
    lay_out(one)
    result = run(one.arguments)
    os.unlink("pipe")  # which pytest, tidying up, would wait for
    result.seconds = 0.0  # first use of kernels and libraries counts there
    assert faults(result) == [], (one.arguments, result.trace or result.err, result.warnings)
