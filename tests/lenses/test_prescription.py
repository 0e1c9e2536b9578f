"""Prescriptions: what is refused, what reversal and misalignment do, files that come back as they went."""

from __future__ import annotations

import pickle
import re
from dataclasses import replace

import numpy as np
import pytest
import tomli_w
from hypothesis import given, settings
from hypothesis import strategies as st

from roslf_design.lenses.glass import AIR, Glass, find_glass
from roslf_design.lenses.lens_file import _loads_lens, load_lens, shipped_names, table_of
from roslf_design.lenses.manufacture import as_made, lens_values
from roslf_design.lenses.prescription import LensError, Prescription, Surface, first_order
from tests.lenses.vector_rays import Rays, trace
from tests.oracles.lenses import incoming

BK7 = find_glass("N-BK7")
GREEN = 550e-6
FACTS = {  # radii, thicknesses, glasses, diameter; focal length printed by the maker
    "la1050-a": ((51.5, np.inf), (9.69,), ("N-BK7",), 50.8, 100),
    "lb1630-a": ((101.38, -101.38), (9.47,), ("N-BK7",), 50.8, 100),
    "ac508-100-a": ((71.12, -44.17, -363.1), (16, 4), ("N-BAF10", "SF10"), 50.8, 100),
    "ac508-150-a": ((83.18, -72.12, -247.7), (12, 3), ("N-BK7", "SF5"), 50.8, 150),
    "ac254-030-a": ((20.89, -16.7, -79.8), (12, 2), ("N-BAF10", "N-SF6HT"), 25.4, 30),
    "ac254-035-a": ((24, -19.1, -102.1), (12, 2), ("N-BAF10", "N-SF6HT"), 25.4, 35.2),
    "ac254-040-a": ((23.7, -20.1, -57.7), (10, 2.5), ("N-BK7", "SF5"), 25.4, 40.1),
    "ac254-045-a": ((31.2, -25.9, -130.6), (7, 2), ("N-BAF10", "N-SF6HT"), 25.4, 45),
    "ac254-050-a": ((33.34, -22.28, -291.1), (9, 2.5), ("N-BAF10", "SF10"), 25.4, 50),
    "ac254-100-a": ((62.75, -45.71, -128.2), (4, 2.5), ("N-BK7", "SF5"), 25.4, 100),
    "ac050-008-a": ((5.25, -3.9, -17.06), (2.8, 1.7), ("N-BAF10", "N-SF6HT"), 5, 7.5),
    "ac050-010-a": ((6.6, -4.3, -15.4), (2.5, 1.9), ("N-BAK4", "SF5"), 5, 10),
    "ac060-010-a": ((6.2, -4.6, -19.6), (2.5, 1.5), ("N-BAK4", "SF5"), 6, 10),
    "ac080-016-a": ((11, -9.2, -46.8), (2.5, 1.5), ("N-BAF10", "N-SF6HT"), 8, 16),
    "ac080-020-a": ((11.1, -9.2, -34.8), (2.5, 1.5), ("N-BK7", "SF2"), 8, 20),
    "ac127-019-a": ((12.94, -11.04, -59.26), (4.5, 1.5), ("N-BAF10", "N-SF6HT"), 12.7, 19),
    "ac127-025-a": ((18.79, -10.59, -68.08), (5, 2), ("N-BAF10", "N-SF10"), 12.7, 25),
    "ac127-030-a": ((17.865, -13.53, -44.17), (3.5, 1.5), ("N-BK7", "SF2"), 12.7, 30),
    "ac127-050-a": ((27.36, -22.54, -91.83), (3.5, 1.5), ("N-BK7", "SF2"), 12.7, 50),
    "45-089": ((4.13, -2.36, -21.7), (1.97, 1.03), ("N-BAF10", "SF10"), 3, 6),
    "45-090": ((5.26, -3.98, -12.05), (1.47, 1.03), ("N-BK7", "SF5"), 3, 9),
    "49-924": ((5.63, -3.71, -11.34), (5, 1), ("N-BAF10", "N-SF57"), 6.25, 7.5),
    "45-206": ((7.17, -4.39, -33.96), (1.73, 1.03), ("N-BAF10", "SF10"), 5, 10),
}


def test_lenses_ship_with_the_makers_numbers():
    assert set(shipped_names()) == set(FACTS)
    for name, (radii, thicknesses, glasses, diameter, _) in FACTS.items():
        lens = load_lens(name.upper())
        assert lens.name == name.upper()
        np.testing.assert_allclose([s.radius for s in lens.surfaces], radii, rtol=3e-16)
        assert tuple(s.thickness for s in lens.surfaces[:-1]) == thicknesses
        assert tuple(s.glass.name for s in lens.surfaces[:-1]) == glasses
        assert {2 * s.semi_diameter for s in lens.surfaces} == {diameter}
        assert lens.clear_aperture == pytest.approx(0.9 * diameter, rel=1e-12)


def test_values_compare_hash_pickle_and_come_back_from_a_file():
    for lens in map(load_lens, shipped_names()):
        for other in (
            pickle.loads(pickle.dumps(lens)),
            _loads_lens(tomli_w.dumps(table_of(lens))),
            lens.reversed().reversed(),
        ):
            assert other == lens
            assert hash(other) == hash(lens)
        assert lens.reversed() != lens


finite = st.floats(-1, 1, allow_subnormal=False)
own_glass = Glass("polymer", "schott", (2.2, -0.01, 0.011), 4e-4, 1e-3, "made up")
constant_glass = Glass("stuff", "constant", (1.7,))


@settings(max_examples=40)
@given(
    st.floats(-0.3, 0.3),
    st.sampled_from([0.0, -1.0, 0.3]),
    st.lists(st.floats(-1e-5, 1e-5), max_size=8),
    st.floats(1e-3, 2.0),
    st.tuples(finite, finite, finite),
    st.tuples(finite, finite),
    st.sampled_from([BK7, own_glass, constant_glass]),
    st.floats(-1e-3, 1e-3),
)
def test_any_lens_comes_back_from_its_file(curvature, conic, asphere, semi, shift, tilt, glass, offset):
    while asphere and asphere[-1] == 0:
        asphere.pop()
    front = Surface(curvature, semi, 3.0, glass.with_offset(offset), conic, tuple(asphere), shift, tilt)
    lens = Prescription((front, Surface(0.0, semi / 3)), "any", wavelength=0.55e-3)
    again = _loads_lens(tomli_w.dumps(table_of(lens)))
    expected = replace(front, semi_diameter=semi)
    assert again == replace(lens, surfaces=(expected, lens.surfaces[1]))


def faulty(*surfaces, **rest):
    with pytest.raises(LensError) as caught:
        Prescription(tuple(surfaces), **rest)
    return str(caught.value)


def test_impossible_lenses_are_refused_with_every_fault():
    assert "at least one surface" in faulty()
    assert "must end in air" in faulty(Surface(0.01, 5.0, 0.0, BK7))
    assert "turns back" in faulty(Surface(1.0, 5.0, 1.0, BK7), Surface(0.0, 5.0))
    told = faulty(Surface(np.nan, -1.0, -2.0, BK7), Surface(0.0, np.inf))
    assert "surfaces.1.radius: is not a finite number" in told
    assert "surfaces.1.diameter: -2 mm must be a positive" in told
    assert "surfaces.2.diameter: inf mm" in told
    thin = faulty(Surface(1 / 20, 10.0, 1.0, BK7), Surface(-1 / 20, 10.0))
    assert "surfaces.1.thickness: the N-BK7 is" in thin
    assert "the surfaces cross" in thin
    between = (
        Surface(-0.02, 9.0, 2.0, BK7),
        Surface(-0.05, 9.0, 0.1),
        Surface(-0.08, 9.0, 4.0, BK7),
        Surface(0.0, 9.0),
    )
    assert "air gap" in faulty(*between)
    assert "nothing follows the last surface" in faulty(Surface(0.0, 5.0, 2.0, BK7), Surface(0.0, 5.0, 1.0))
    assert "at most 8" in faulty(Surface(0.0, 5.0, asphere=(0.0,) * 9))
    assert "wavelength" in faulty(Surface(0.0, 5.0), wavelength=-1.0)


def test_a_diaphragm_may_stand_within_the_sag_of_its_neighbour():
    lens = Prescription((Surface(0.0, 5.0), Surface(-0.05, 6.0, 4.0, BK7), Surface(0.0, 8.0)))
    assert lens.elements == ((0,), (1, 2))
    assert load_lens("AC508-100-A").elements == ((0, 1, 2),)  # what is cemented moves as one


def missed(lens, **off):
    """A lens with places missed by so much; dots written as underscores."""
    drawn = lens_values(lens, GREEN)
    names = {place.replace(".", "_"): place for place in drawn}
    return as_made(lens, {names[name]: drawn[names[name]] + value for name, value in off.items()}, GREEN)


def test_radius_and_index_errors_change_what_they_name():
    lens = load_lens("AC254-100-A")
    assert missed(lens, surfaces_2_radius=0.5).surfaces[1].radius == pytest.approx(-45.21)
    assert missed(load_lens("LA1050-A"), surfaces_2_curvature=1e-4).surfaces[1].curvature == 1e-4
    assert missed(lens, surfaces_1_thickness=-0.1).length == pytest.approx(6.4)
    heavier = missed(lens, surfaces_1_index=1e-3)
    assert heavier.surfaces[0].glass.index(5e-4) == pytest.approx(float(BK7.index(5e-4)) + 1e-3)
    assert heavier.surfaces[1:] == lens.surfaces[1:]
    for place, value, told in (
        ("surfaces.1.radius", -7.0, "inside out"),
        ("surfaces.1.radius", 10.0, "turns back"),
        ("surfaces.1.thickness", -1.0, "must not be negative"),
        ("surfaces.1.thickness", 0.1, "the surfaces cross"),
        ("surfaces.3.thickness", 1.0, "is no place of AC254-100-A"),
        ("elements.2.decentre.0", 0.1, "is no place of AC254-100-A"),
    ):
        with pytest.raises(LensError, match=told):
            as_made(lens, {place: value}, GREEN)


rotations = st.floats(-0.1, 0.1)


@settings(max_examples=40)
@given(rotations, rotations, st.floats(-1, 1), st.floats(-1, 1))
def test_a_moved_element_acts_as_rays_moved_the_other_way(alpha, beta, x, y):
    lens = load_lens("AC254-050-A")
    moved = missed(
        lens, elements_1_decentre_0=x, elements_1_decentre_1=y, elements_1_tilt_0=alpha, elements_1_tilt_1=beta
    )
    ca, sa, cb, sb = np.cos(alpha), np.sin(alpha), np.cos(beta), np.sin(beta)
    turn = np.array([[cb, 0, sb], [0, 1, 0], [-sb, 0, cb]]) @ np.array([[1, 0, 0], [0, ca, -sa], [0, sa, ca]])
    pivot = np.array([x, y, lens.length / 2])[:, None]
    place, way = incoming(8.0, 20)
    still = trace(lens, Rays(place, way), GREEN)
    home = np.array([0.0, 0.0, lens.length / 2])[:, None]
    there = trace(moved, Rays(turn @ (place - home) + pivot, turn @ way), GREEN)
    assert still.kept.all()
    assert there.kept.all()
    np.testing.assert_allclose(there.direction, turn @ still.direction, rtol=0, atol=1e-14)
    aside = np.cross(there.position - turn @ (still.position - home) - pivot, there.direction, axis=0)
    np.testing.assert_allclose(aside, 0, atol=2e-13)


def test_a_sphere_tilted_about_its_centre_is_the_same_sphere():
    lens = Prescription((Surface(1 / 30, 10.0, 6.0, BK7), Surface(0.0, 12.0)))
    tilt = 0.05
    front = replace(lens.surfaces[0], tilt=(0.0, tilt), shift=(-30 * np.sin(tilt), 0.0, 30 - 30 * np.cos(tilt)))
    turned = replace(lens, surfaces=(front, lens.surfaces[1]))
    rays = Rays(*incoming(5.0, 50))
    one, other = (trace(each, rays, 5e-4, clip=False) for each in (lens, turned))
    np.testing.assert_allclose(one.position, other.position, rtol=0, atol=1e-13)


BROKEN = """
nam = "x"
[[surfaces]]
radius = 51.5
thickness = "9 kg"
glas = "N-BK7"
diameter = "0 mm"
[[surfaces]]
radius = "5 mm"
curvature = "0.2 mm^-1"
glass = "N-BK8"
diameter = "5 mm"
conic = "a"
asphere = { r3 = "1", r4 = "2 mm^-2" }
shift = ["1 mm"]
tilt = ["1 mm", "2 mrad"]
"""


def test_a_lens_file_tells_every_fault_at_once():
    with pytest.raises(LensError) as caught:
        _loads_lens(BROKEN, "bad.toml")
    told = str(caught.value).splitlines()
    for start in (
        "bad.toml: nam: is not a known key; did you mean 'name'?",
        "bad.toml: surfaces.1.glas: is not a known key; did you mean 'glass'?",
        'bad.toml: surfaces.1.radius: 51.5 has no unit; write it as text with one, e.g. "51.5 mm"',
        "bad.toml: surfaces.1.thickness: \"9 kg\": 'kg' is not a known unit",
        'bad.toml: surfaces.1.diameter: "0 mm" must be greater than zero',
        "bad.toml: surfaces.2.radius: radius and curvature: both are given; drop one",
        "bad.toml: surfaces.2.conic: must be a finite number",
        "bad.toml: surfaces.2.asphere.r3: is not a known key",
        "bad.toml: surfaces.2.asphere.r4: expected a number of mm^-3",
        "bad.toml: surfaces.2.shift: must be a list of 3, got",
        "bad.toml: surfaces.2.tilt.0: \"1 mm\": 'mm' is a unit of length",
        "bad.toml: surfaces.2.glass: 'N-BK8' is not a known glass; the nearest known is 'N-BK7'",
    ):
        assert any(line.startswith(start) for line in told), start
    assert len(told) == 12


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "surfaces: a lens needs at least one surface"),
        ("surfaces = 3", "surfaces: must be a list of tables"),
        ("surfaces = [3]", "surfaces.1: must be a table"),
        ("name = 3\n[[surfaces]]\nradius='inf'\ndiameter='5 mm'", "name: must be text"),
        (
            "wavelength = '-5 nm'\n[[surfaces]]\nradius='inf'\ndiameter='5 mm'",
            "wavelength: .-5 nm. must be greater than zero",
        ),
        ("[[surfaces]]\nradius='0 mm'\ndiameter='5 mm'", "is a point"),
        ("[[surfaces]]\nradius='inf'", "surfaces.1.diameter: is missing"),
        ("[[surfaces]]\ndiameter='5 mm'", "surfaces.1.radius: is missing"),
        ("[[surfaces]]\nradius='inf'\ndiameter='5 mm'\nglass=3", "glass: must be a glass's name"),
        ("[[surfaces]]\nradius='inf'\ndiameter='5 mm'\nglass='N-BK7'", "must end in air"),
        ("[glasses.a]\nformula='x'\n[[surfaces]]\nradius='inf'\ndiameter='5 mm'", "glasses.a.formula: 'x'"),
        ("[[surfaces", "is not valid TOML"),
    ],
)
def test_broken_lens_texts(text, told):
    with pytest.raises(LensError, match=told):
        _loads_lens(text, "bad.toml")


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(LensError, match=r"no such file; .*AC254-050-A"):
        load_lens(tmp_path / "none.toml")
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(LensError, match="is not UTF-8"):
        load_lens(binary)
    with pytest.raises(LensError, match="is a folder; name the file inside it"):
        load_lens(tmp_path)


@pytest.mark.parametrize(
    "glass",
    [
        'formula = "abbe"\nindex = 1.52\nabbe = 58.0',
        'formula = "schott"\na = [2.3, -0.01, 0.01]\nagainst = "vacuum"',
    ],
)
def test_own_glasses_of_every_kind_come_back_from_a_file(glass):
    text = f"""
        [[surfaces]]
        radius = "20 mm"
        thickness = "3 mm"
        glass = "mine"
        diameter = "10 mm"
        [[surfaces]]
        radius = "inf"
        diameter = "10 mm"
        [glasses.mine]
        {glass}
        range = ["400 nm", "700 nm"]
        """
    lens = _loads_lens(text)
    assert _loads_lens(tomli_w.dumps(table_of(lens))) == lens


def test_own_glass_in_a_lens_file():
    lens = _loads_lens(
        """
        [glasses.polymer]
        formula = "constant"
        index = 1.49
        [[surfaces]]
        radius = "20 mm"
        thickness = "3 mm"
        glass = "Polymer"
        diameter = "10 mm"
        [[surfaces]]
        radius = "inf"
        diameter = "10 mm"
        """
    )
    assert lens.surfaces[0].glass.index(5e-4) == 1.49
    assert lens.surfaces[1].glass == AIR


SINGLET = """
[[surfaces]]
radius = "20 mm"
thickness = "3 mm"
glass = {glass}
diameter = "10 mm"
[[surfaces]]
radius = "-30 mm"
diameter = "10 mm"
"""


@pytest.mark.parametrize(
    ("glass", "more"),
    [
        ("{index = 1.5168, abbe = 64.17}", ""),
        ('"melt"', "[glasses]\nmelt = {index = 1.5168, abbe = 64.17}"),
    ],
)
def test_glasses_by_index_and_abbe_number(glass, more):
    """Against the lensmaker's equation, and n_F - n_C = (n_d - 1)/V."""
    lens = _loads_lens(SINGLET.format(glass=glass) + more)
    n, r_1, r_2, t = 1.5168, 20.0, -30.0, 3.0
    power = (n - 1) * (1 / r_1 - 1 / r_2 + (n - 1) * t / (n * r_1 * r_2))
    assert first_order(lens, 587.5618e-6).focal_length == pytest.approx(1 / power, rel=1e-12)
    f_line, c_line = (float(lens.surfaces[0].glass.index(wave)) for wave in (486.1327e-6, 656.2725e-6))
    assert f_line - c_line == pytest.approx((n - 1) / 64.17, rel=1e-12)
    assert _loads_lens(tomli_w.dumps(table_of(lens))) == lens


def test_glasses_whose_numbers_look_alike_stay_apart():
    glasses = [f"{{index = {index!r}, abbe = 64.17}}" for index in (1.5168, 1.51680001)]
    text = "".join(SINGLET.split("[[surfaces]]")[1].join(["[[surfaces]]", ""]).format(glass=glass) for glass in glasses)
    lens = _loads_lens(text + '[[surfaces]]\nradius = "inf"\ndiameter = "10 mm"\n')
    assert _loads_lens(tomli_w.dumps(table_of(lens))) == lens


@pytest.mark.parametrize(
    ("glass", "said"),
    [
        ("{index = 0.5}", "surfaces.1.glass.index: an index must be a number from 1 to 5"),
        ("{index = 1.5, abe = 60}", "surfaces.1.glass.abe: is not a known key; did you mean 'abbe'?"),
        ("{formula = {a = 1}}", "surfaces.1.glass: a glass by its formula stands in [glasses]"),
        ("[1]", "surfaces.1.glass: must be a glass's name or a table"),
    ],
)
def test_glasses_of_surfaces_with_a_fault_say_which(glass, said):
    with pytest.raises(LensError, match=re.escape(said)):
        _loads_lens(SINGLET.format(glass=glass))
