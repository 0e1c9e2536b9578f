"""Kernels: one source, interpreted and compiled alike; no machine code of yesterday's source."""

import importlib
import sys

import numba
import numpy as np
import pytest
from numba.core.caching import IndexDataCacheFile

from roslf_design import cli
from roslf_design._jit import (
    COMPILE,
    PATIENCE,
    WHOLE,
    WIDE,
    Band,
    Kernel,
    _alone,
    ahead,
    cold_seconds,
    compiling,
    kernel,
    prange,
)

GAIN = 2.5


@kernel()
def scaled(x: float) -> float:
    return GAIN * x


@kernel(parallel=True)
def fill(values: np.ndarray, out: np.ndarray, band: Band = WHOLE) -> None:
    for i in prange(values.size, band):
        out[i] = scaled(values[i]) + 1.0


@pytest.fixture(autouse=True)
def as_commands_have_it():
    before = PATIENCE.set(COMPILE)
    yield
    PATIENCE.reset(before)


def test_interpreted_and_compiled_agree():
    values, plain, fast = np.linspace(-1, 1, 101), np.empty(101), np.empty(101)
    fill(values, plain)
    fill.compiled(values, fast)
    np.testing.assert_array_equal(plain, fast)
    np.testing.assert_array_equal(plain, 2.5 * values + 1)


def test_a_changed_callee_in_another_file_is_compiled_again(tmp_path, monkeypatch):
    """Numba's cache on disk is asked anew for each import, as in a new process."""
    (tmp_path / "caller.py").write_text(
        "from roslf_design._jit import kernel\n"
        "from callee import inner\n"
        "@kernel()\n"
        "def outer(x):\n"
        "    return inner(x) + 1.0\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    results = []
    for body in ("x", "10.0 * x", "FACTOR * x"):
        (tmp_path / "callee.py").write_text(
            f"from roslf_design._jit import kernel\nFACTOR = 3.0\n@kernel()\ndef inner(x):\n    return {body}\n"
        )
        for name in ("caller", "callee"):
            monkeypatch.delitem(sys.modules, name, raising=False)
        importlib.invalidate_caches()
        results.append(importlib.import_module("caller").outer.compiled(2.0))
    assert results == [3.0, 21.0, 7.0]


def test_a_cache_folder_that_cannot_be_written_to_is_done_without(tmp_path, monkeypatch):
    with _alone(tmp_path / "gone" / "kernel.lock"):
        pass
    # Full while machine code is kept; then no place for it at all.
    monkeypatch.setattr(IndexDataCacheFile, "save", lambda *_: (_ for _ in ()).throw(OSError(28, "No space left")))
    assert Kernel(lambda x: 3.0 * x).compiled(2.0) == 6.0
    monkeypatch.setattr("roslf_design._jit._cache_folder", lambda _: None)
    assert Kernel(lambda x: 5.0 * x).compiled(2.0) == 10.0


@kernel()
def inverse(values: np.ndarray, out: np.ndarray) -> None:
    for i in range(values.size):
        out[i] = 1.0 / float(values[i])


def test_little_work_is_interpreted_and_what_python_will_not_divide_is_compiled(monkeypatch):
    monkeypatch.setattr("roslf_design._jit._interpreted", [0.0])
    out = np.empty(2)
    inverse.quickest(1e-3)(np.array([2.0, 4.0]), out)
    assert not inverse.ready
    np.testing.assert_array_equal(out, [0.5, 0.25])
    inverse.quickest(1e-3)(np.array([2.0, 0.0]), out)
    assert inverse.ready
    np.testing.assert_array_equal(out, [0.5, np.inf])


def test_work_adds_up_until_machine_code_pays(monkeypatch):
    monkeypatch.setattr("roslf_design._jit._interpreted", [0.0])
    fresh = Kernel(lambda x: 7.0 * x)
    assert [fresh.pays(0.4 * COMPILE) for _ in range(3)] == [False, False, True]
    assert Kernel(lambda x: 8.0 * x).pays(0.0)  # what others have spent counts
    monkeypatch.setattr("roslf_design._jit._interpreted", [0.0])
    with compiling():
        assert fresh.pays(0.0)
    assert not fresh.pays(0.0)
    with ahead(0.5 * COMPILE):  # not enough to compile for, but to load
        assert not fresh.pays(0.0)
        fresh.shelved = True
        assert fresh.pays(0.0)
    assert not fresh.pays(0.0)


def test_seconds_for_want_of_machine_code_are_counted_and_told_to_who_watches(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("roslf_design._jit._unshelved", [0.0])
    monkeypatch.setattr("roslf_design._jit._interpreted", [0.0])
    fresh = Kernel(lambda x: 9.0 * x)
    assert not fresh.pays(1.5)
    assert cold_seconds() == 1.5
    assert fresh.compiled(2.0) == 18.0
    spent = cold_seconds()
    assert 1.5 < spent < 60
    assert fresh.compiled(3.0) == 27.0
    assert cold_seconds() == spent  # machine code is there from then on
    monkeypatch.setattr("roslf_design._jit._unshelved", [7.2])
    cli._advise(is_warm=False)
    assert capsys.readouterr().err == ""  # nobody watches
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    cli._advise(is_warm=True)
    assert capsys.readouterr().err == ""
    cli._advise(is_warm=False)
    assert "7 s of this" in (advice := capsys.readouterr().err)
    assert "`roslf warm`" in advice


@kernel()
def total(values: np.ndarray, more: tuple[np.ndarray, ...]) -> float:
    return values[0] + more[0][1]


def test_arrays_that_are_read_only_run_the_same_machine_code():
    open_, frozen = np.arange(2.0), np.arange(2.0) + 5
    frozen.flags.writeable = False
    for one, other in ((open_, open_), (frozen, open_), (open_, frozen), (frozen, frozen)):
        assert total.compiled(one, (other,)) == total(one, (other,))
    assert len(total.compiled.signatures) == 1


def test_what_others_compile_in_the_same_process_is_as_without_us():
    def own(values):
        return values[0] + 1.0

    before, features = numba.njit(own), numba.config.CPU_FEATURES
    before(np.ones(3))
    scaled.compiled(2.0)
    after = numba.njit(own)
    after(np.ones(3))
    for theirs in (before, after):
        assert WIDE not in "".join(theirs.inspect_llvm().values())
    assert numba.config.CPU_FEATURES is features
