"""Glasses: the catalogue's own index and Abbe number from its coefficients, and refusals instead of guesses."""

from __future__ import annotations

import json
import tomllib
from importlib.resources import files

import mpmath as mp
import numpy as np
import pytest

from roslf_design.cli import main
from roslf_design.design import load
from roslf_design.errors import InputError
from roslf_design.evaluation import evaluate
from roslf_design.lenses.glass import AIR, catalogue, find_glass, read_glass
from roslf_design.lenses.glass_files import _load_glass
from roslf_design.lenses.solid import find_solid
from roslf_design.reporting.design.figures import at_room

DATA = tomllib.loads(files("roslf_design.lenses").joinpath("glasses.toml").read_text())
D_LINE, F_LINE, C_LINE = 587.5618e-6, 486.1327e-6, 656.2725e-6


def digits(value):
    return len(repr(value).partition(".")[2])


@pytest.mark.parametrize("name", DATA["glasses"])
def test_coefficients_give_the_printed_index_and_abbe_number(name):
    entry, glass = DATA["glasses"][name], find_glass(name)
    d, f, c = (float(glass.index(line)) for line in (D_LINE, F_LINE, C_LINE))
    # half a unit of the last printed digit: of optical glasses the index's fifth and the Abbe number's second
    optical = entry["source"].startswith(("schott-2017", "schott-legacy"))
    assert abs(d - entry["nd"]) <= 0.5 * 10.0 ** -(5 if optical else digits(entry["nd"]))
    if "vd" in entry:
        assert abs((d - 1) / (f - c) - entry["vd"]) <= 0.5 * 10.0 ** -(2 if optical else digits(entry["vd"]))
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


def iapws(micrometres):
    """Index of water at 20 degrees C against vacuum: IAPWS R9-97 (Harvey, Gallagher and Levelt Sengers 1998)."""
    rho, t, square = (
        mp.mpf("0.998207"),
        mp.mpf("293.15") / mp.mpf("273.15"),
        (mp.mpf(micrometres) / mp.mpf("0.589")) ** 2,
    )
    a = [mp.mpf(v) for v in ("0.244257733", "9.74634476e-3", "-3.73234996e-3", "2.68678472e-4", "1.58920570e-3",
                             "2.45934259e-3", "0.900704920", "-1.66626219e-2")]  # fmt: skip
    part = a[0] + a[1] * rho + a[2] * t + a[3] * square * t + a[4] / square + a[7] * rho**2
    part += a[5] / (square - mp.mpf("0.2292020") ** 2) + a[6] / (square - mp.mpf("5.432937") ** 2)
    return mp.sqrt((1 + 2 * part * rho) / (1 - part * rho))


@pytest.mark.parametrize(
    ("wave", "air"),  # air at 20 degrees C by Ciddor's equation (refractiveindex.info: Appl. Opt. 35, 1566 (1996)), dry
    [("0.4861", 1.000275), ("0.5893", 1.000272), ("0.6563", 1.000271)],
)
def test_water_against_the_international_formulation(wave, air):
    water = float(find_glass("water").index(float(wave) * 1e-3))
    assert water == pytest.approx(float(iapws(wave)) / air, abs=5e-6)
    assert float(find_glass("water").index(589.3e-6)) == pytest.approx(1.3330, abs=5e-5)


def test_saline_is_water_and_its_salt():
    """0.9 % by mass at 0.0017682 per % (Tan and Huang 2015): 0.0016, at every colour."""
    waves = np.linspace(0.42, 0.7, 15) * 1e-3
    rise = find_glass("saline").index(waves) - find_glass("water").index(waves)
    np.testing.assert_allclose(rise, 0.0016, atol=2e-5)  # the source's table ends at 1e-4
    assert abs(0.9 * 0.0017682 - 0.0016) < 5e-5


@pytest.mark.parametrize(
    ("name", "lines", "within"),
    [
        # SCHOTT's data sheet of August 1993
        ("B270", {0.43583: 1.5341, 0.47999: 1.5297, 0.54607: 1.5251, 0.58929: 1.5229, 0.64385: 1.5207}, 1.5e-4),
        # the paper's table, whose indices are good to 0.001
        ("PMMA", {0.4861: 1.497, 0.5876: 1.491, 0.6328: 1.489}, 1e-3),
        ("polycarbonate", {0.4861: 1.599, 0.5876: 1.585, 0.6328: 1.580}, 1e-3),
    ],
)
def test_index_and_abbe_number_meet_the_measured_lines(name, lines, within):
    np.testing.assert_allclose(find_glass(name).index(np.array(list(lines)) * 1e-3), list(lines.values()), atol=within)


def test_other_names_of_windows_and_plastics():
    for name, other in (
        ("F_SILICA", "fused silica"),
        ("D263", "d 263 t eco"),
        ("E48R", "zeonex e48r"),
        ("water", "H2O"),
    ):
        assert find_glass(name) == find_glass(other)
    with pytest.raises(InputError, match="'salin' is not a known glass; the nearest known is 'saline'"):
        find_glass("salin")


@pytest.mark.parametrize("name", ["CO2", "co2 gas", "Nitrogen", "argon", "helium"])
def test_a_gas_is_told_to_be_given_as_air(name):
    with pytest.raises(InputError, match=f"'{name}' is not a known glass; of a gas give \"air\", .* within 3e-4"):
        find_glass(name)


def test_unknown_glass_names_the_nearest_and_guesses_nothing():
    with pytest.raises(InputError, match="'N-BK8' is not a known glass; the nearest known is 'N-BK7'"):
        find_glass("N-BK8")
    assert find_glass("SF5") != find_glass("N-SF5")
    assert find_glass("silica") == find_glass("F_SILICA")


@pytest.mark.parametrize(
    ("name", "meant"),
    [("quartz glas", "fused silica"), ("Fused Quartz", "fused silica"), ("borosilicate", "N-BK7"), ("BK 7", "BK7")],
)
def test_other_names_of_trades_are_suggested_and_taken_for_nothing(name, meant):
    for find in (find_glass, find_solid):
        with pytest.raises(InputError, match=f"'{name}' is n") as caught:
            find(name)
        assert meant.lower() in str(caught.value).lower()
        assert len(str(caught.value)) < 200
    assert find_glass(meant).index(0.55e-3) > 1


def test_a_name_like_none_is_answered_by_a_few_and_by_what_lists_all(capsys):
    with pytest.raises(InputError, match=r"N-BK7.* and others: `roslf catalogue` ends with all") as caught:
        find_glass("germanium")
    assert len(str(caught.value)) < 250
    assert main(["catalogue"]) == 0
    listed = capsys.readouterr().out.partition("Materials by name: ")[2].partition(".\n")[0].replace("\n", " ")
    assert {find_glass(name) for name in listed.split(", ")} == set(catalogue().values())


def test_the_catalogue_lists_solids_by_every_name_with_expansion_and_source(capsys):
    data = tomllib.loads(files("roslf_design.lenses").joinpath("solids.toml").read_text("utf-8"))
    assert main(["catalogue"]) == 0
    printed = capsys.readouterr().out
    table = printed.partition("solids of housings")[2].partition("\n\n")[0].lower()
    assert main(["catalogue", "--json", "--kind", "windows"]) == 0
    told = {solid["name"]: solid for solid in json.loads(capsys.readouterr().out)["solids"]}
    assert told.keys() == data["solids"].keys()
    for name, solid in data["solids"].items():
        (line,) = (line for line in table.splitlines() if line.startswith(f"{name} "))
        assert all(other.lower() in line for other in solid.get("also", ()))
        assert f"{1e6 * solid['cte']:.4g}e-6 /k" in line
        assert told[name]["expansion_per_k"] == solid["cte"]
        assert told[name]["source"] == data["sources"][solid["source"]]
        assert " ".join(told[name]["source"].split()) in " ".join(printed.split())
        assert {find_solid(other).expansion for other in told[name]["also"]} <= {solid["cte"]}


@pytest.mark.parametrize("wave", [0.299e-3, 2.501e-3, -0.5e-3, 0.0, np.nan, np.inf])
def test_wavelength_outside_the_measured_range_is_refused(wave):
    with pytest.raises(InputError, match=r"outside the range of N-BK7 \(300 nm to 2.5 um\)"):
        find_glass("N-BK7").index([0.55e-3, wave])


@pytest.mark.parametrize(
    ("table", "told"),
    [
        ({"formula": "cauchy"}, "formula: 'cauchy' is not a known formula"),
        ({"formula": "sellmeier", "b": [1.0], "c": [0.01, 1.0], "range": ["0.4 um", "1 um"]}, "c: has 2 numbers"),
        ({"formula": "sellmeier", "b": "x", "c": [1.0], "range": ["0.4 um", "1 um"]}, "b: must be a list, got 'x'"),
        ({"formula": "schott", "a": [2.3], "range": ["0.4 um", "1 um"]}, "a: has 1 of at least 2 entries"),
        ({"formula": "schott", "a": [2.3, 0.0], "range": ["1 um", "0.4 um"]}, "range: .* rising"),
        ({"formula": "schott", "a": [2.3, 0.0], "range": ["1 kg", "0.4 um"]}, "range.0: .*kg"),
        (
            {"formula": "schott", "a": [2.3, 0.0]},
            r"range: is missing; add it, e.g. range = \[\"0.35 um\", \"2.5 um\"\]",
        ),
        ({"formula": "schott", "a": [-2.3, 0.0], "range": ["0.4 um", "1 um"]}, "a: give an index"),
        ({"formula": "abbe", "index": 1.5, "range": ["0.4 um", "1 um"]}, "abbe: is missing; add it"),
        (
            {"formula": "constant", "index": 1.5, "against": "ether"},
            "against: .ether. is not known; write 'air' or 'vacuum'",
        ),
        ({"formula": "constant", "index": 0.2}, "index: an index must be a number from 1 to 5"),
        ({"formula": "constant", "index": 1.5, "colour": "red"}, "colour: is not a known key"),
    ],
)
def test_own_glass_with_a_fault_says_which(table, told):
    with pytest.raises(InputError, match=told) as caught:
        read_glass(table)
    assert len(caught.value.problems) == 1


def test_offset_adds_to_the_index_at_every_wavelength():
    glass = find_glass("SF10")
    waves = np.array([0.45, 0.55, 0.65]) * 1e-3
    np.testing.assert_allclose(glass.with_offset(5e-4).index(waves) - glass.index(waves), 5e-4, atol=4e-16)
    assert glass.with_offset(5e-4).with_offset(-5e-4) == glass


@pytest.mark.parametrize("resonance", [0.55, 0.55 + 1e-9])
def test_a_law_of_temperature_that_has_no_value_there_is_told(resonance):
    law = {"d": [1.86e-6, 1.31e-8, -1.37e-11], "e": [4.34e-7, 6.27e-10], "lambda_tk": resonance}
    glass = read_glass({"name": "mine", "formula": "constant", "index": 1.5, "dndt": law})
    assert glass.index(550e-6) == 1.5
    with pytest.raises(InputError, match="mine has no index at its temperature there: its dn/dT"):
        glass.index(550e-6, 60.0)


def test_a_page_without_coefficients_is_told(tmp_path):
    page = tmp_path / "glass.yml"
    for coefficients, said in (("", "holds no numbers"), ("1 2-3", "could not convert")):
        page.write_text(
            f"  - type: formula 1\n    wavelength_range: 0.3 2.5\n    coefficients: {coefficients}\nSPECS:\n"
        )
        with pytest.raises(InputError, match=said):
            _load_glass(page, "")


def test_a_housing_s_general_name_is_told_with_the_grade_that_it_is_taken_for():
    """Grades differ: 304 grows by 17.2, 316 by 15.9e-6 /K; a name that says its grade has none to add."""
    names = ("steel", "steel 304", "steel 316", "aluminum", "6061", "ti-6al-4v", "invar")
    told = {name: find_solid(name).words for name in names}
    assert told == {
        "steel": "stainless steel, taken as 304, 17.2e-6 /K",
        "steel 304": "steel 304, 17.2e-6 /K",
        "steel 316": "steel 316, 15.9e-6 /K",
        "aluminum": "aluminium, taken as 6061, 23.6e-6 /K",
        "6061": "6061, 23.6e-6 /K",
        "ti-6al-4v": "Ti-6Al-4V, 8.6e-6 /K",
        "invar": "invar, 1.6e-6 /K",
    }
    scope = load("paper").replace({"environment": {"temperature": 37.0, "housing": "steel"}})
    assert evaluate(scope).temperature.held == f"housing of {told['steel']}"
    assert f"in a housing of {told['steel']}." in at_room(scope)[1]
