"""Glasses: the catalogue's own index and Abbe number from its coefficients, and refusals instead of guesses."""

from __future__ import annotations

import tomllib
from importlib.resources import files

import mpmath as mp
import numpy as np
import pytest

from roslf_design.errors import InputError
from roslf_design.lenses.glass import AIR, find_glass, read_glass

DATA = tomllib.loads(files("roslf_design.lenses").joinpath("glasses.toml").read_text())
D_LINE, F_LINE, C_LINE = 587.5618e-6, 486.1327e-6, 656.2725e-6


def digits(value):
    return len(repr(value).partition(".")[2])


@pytest.mark.parametrize("name", DATA["glasses"])
def test_coefficients_give_the_printed_index_and_abbe_number(name):
    entry, glass = DATA["glasses"][name], find_glass(name)
    d, f, c = (float(glass.index(line)) for line in (D_LINE, F_LINE, C_LINE))
    # half a unit of the last printed digit, which is the fifth of the index and the second of the Abbe number
    half = 0.5 * 10.0 ** -max(4, min(5, digits(entry["nd"]) if entry["source"] == "malitson-1965" else 5))
    assert abs(d - entry["nd"]) <= half
    assert abs((d - 1) / (f - c) - entry["vd"]) <= (0.05 if entry["source"] == "malitson-1965" else 0.005)
    assert glass.source == DATA["sources"][entry["source"]]
    assert 0 < glass.shortest < F_LINE < C_LINE < glass.longest
    assert glass.index([glass.shortest, glass.longest]).shape == (2,)


def test_formulas_at_sixty_digits():
    for name in ("N-BK7", "BK7"):
        glass = find_glass(name)
        with mp.workdps(60):
            square = mp.mpf("0.55") ** 2
            a = [mp.mpf(v) for v in glass.coefficients]
            if glass.formula == "sellmeier":
                total = 1 + sum(b * square / (square - c) for b, c in zip(a[::2], a[1::2], strict=True))
            else:
                total = a[0] + a[1] * square + sum(v / square**power for power, v in enumerate(a[2:], start=1))
            expected = float(mp.sqrt(total))
        assert float(glass.index(0.55e-3)) == pytest.approx(expected, rel=4e-16)


def test_air_is_one_at_any_wavelength():
    np.testing.assert_array_equal(AIR.index([1e-4, 5e-4, 1e-2]), 1.0)
    assert find_glass("") == find_glass("air") == AIR


def test_unknown_glass_names_the_nearest_and_guesses_nothing():
    with pytest.raises(InputError, match="'N-BK8' is not a known glass; the nearest known is 'N-BK7'"):
        find_glass("N-BK8")
    assert find_glass("SF5") != find_glass("N-SF5")
    assert find_glass("silica") == find_glass("F_SILICA")


@pytest.mark.parametrize("wave", [0.299e-3, 2.501e-3, -0.5e-3, 0.0, np.nan, np.inf])
def test_wavelength_outside_the_measured_range_is_refused(wave):
    with pytest.raises(InputError, match=r"outside the range of N-BK7 \(300 nm to 2.5 um\)"):
        find_glass("N-BK7").index([0.55e-3, wave])


@pytest.mark.parametrize(
    ("table", "told"),
    [
        ({"formula": "cauchy"}, "formula: 'cauchy' is not a known formula"),
        ({"formula": "sellmeier", "b": [1.0], "c": [0.01, 1.0], "range": ["0.4 um", "1 um"]}, "c: has 2 numbers"),
        ({"formula": "sellmeier", "b": "x", "c": [1.0], "range": ["0.4 um", "1 um"]}, "b: must hold finite numbers"),
        ({"formula": "schott", "a": [2.3], "range": ["0.4 um", "1 um"]}, "a: needs at least"),
        ({"formula": "schott", "a": [2.3, 0.0], "range": ["1 um", "0.4 um"]}, "range: .* rising"),
        ({"formula": "schott", "a": [2.3, 0.0], "range": ["1 kg", "0.4 um"]}, "range: .*kg"),
        ({"formula": "schott", "a": [2.3, 0.0]}, "range: must be two wavelengths"),
        ({"formula": "schott", "a": [-2.3, 0.0], "range": ["0.4 um", "1 um"]}, "a: give an index"),
        ({"formula": "constant", "index": 0.2}, "index: give an index"),
        ({"formula": "constant", "index": 1.5, "colour": "red"}, "colour: is not a known key"),
    ],
)
def test_own_glass_with_a_fault_says_which(table, told):
    glass, problems = read_glass("mine", table)
    assert glass is None
    with pytest.raises(InputError, match=told):
        raise InputError(problems)


def test_offset_adds_to_the_index_at_every_wavelength():
    glass = find_glass("SF10")
    waves = np.array([0.45, 0.55, 0.65]) * 1e-3
    np.testing.assert_allclose(glass.with_offset(5e-4).index(waves) - glass.index(waves), 5e-4, atol=4e-16)
    assert glass.with_offset(5e-4).with_offset(-5e-4) == glass
