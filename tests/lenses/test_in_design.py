"""Designs whose main lens is a real one: read, held, changed, written, and what they contradict."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest
import tomli_w

from roslf_design.camera import Camera
from roslf_design.design import Design, DesignError, dumps, load, loads, preset_path, save
from roslf_design.lenses.glass import find_glass
from roslf_design.lenses.lens_file import load_lens, shipped_names, table_of
from roslf_design.lenses.prescription import Prescription, Surface, first_order

from .test_prescription import missed
from .test_zmx import GOOD

PAPER = preset_path("paper").read_text()
IDEAL = 'diameter = "50.8 mm"\nfocal_length = "100 mm"\nfocal_plane = "350 mm"\n'


def text(main_lens, distance=""):
    """The paper's design file with another main lens; the array's place left to follow unless given."""
    return PAPER.replace(IDEAL, main_lens).replace(
        'focal_length = "2 mm"\ndistance = "140 mm"', f'focal_length = "2 mm"\n{distance}'
    )


def real(lens="LB1630-A", **keys):
    extra = "".join(f"{key} = {value}\n" for key, value in keys.items())
    return loads(text(f'prescription = "{lens}"\nfocal_plane = "350 mm"\n{extra}'))


@pytest.mark.parametrize("name", ["LA1050-A", "AC508-150-A"])
def test_focal_length_and_diameter_are_the_lens_s(name):
    design = loads(text(f'prescription = "{name}"\nfocal_plane = "600 mm"\n'))
    lens = load_lens(name)
    f = first_order(lens, 550e-6).focal_length
    assert design.f == Camera.of(design).f == f
    assert 1 / design.d_1 + 1 / 600 == pytest.approx(1 / f, rel=1e-14)
    assert pytest.approx(lens.clear_diameter) == design.D
    assert design.lens == lens
    assert design.replace({"main_lens.reversed": True}).lens == lens.reversed()
    places = np.array([1.01, 1.02]) * design.d_1
    moved = Camera.of(design, {"d_1": places})  # many builds keep the lens's focal length
    assert moved.f == f
    np.testing.assert_allclose(moved.d_f, [design.replace(d_1=place).d_f for place in places], rtol=1e-14)


def test_a_smaller_diameter_cuts_every_surface_down():
    design = real(diameter='"30 mm"')
    assert design.D == 30
    assert {surface.semi_diameter for surface in design.lens.surfaces} == {15.0}
    assert design.main_lens.prescription == load_lens("LB1630-A")


def shared(design: Design) -> None:
    """What every value must survive."""
    for again in (loads(dumps(design)), pickle.loads(pickle.dumps(design)), design.replace({})):
        assert again == design
        assert hash(again) == hash(design)
    names = {"Design": Design, "Prescription": Prescription, "Surface": Surface}
    from roslf_design.design import Light, MainLens, MicrolensArray, Pupil, Sensor, Stop
    from roslf_design.lenses.glass import Glass, Warming

    parts = (Light, MainLens, MicrolensArray, Pupil, Sensor, Stop, Glass, Warming)
    names |= {part.__name__: part for part in parts} | {"inf": np.inf}
    assert eval(repr(design), names) == design


def test_round_trips_of_shipped_lenses_write_the_name():
    for name in map(str.upper, shipped_names()):
        design = loads(text(f'prescription = "{name}"\nreversed = true\nfocal_plane = "600 mm"\n'))
        shared(design)
        assert f'prescription = "{name}"' in dumps(design)
        assert design != design.replace({"main_lens.reversed": False})


def test_round_trips_of_lenses_as_made():
    lens = load_lens("AC254-100-A")
    made = missed(
        lens, surfaces_1_radius=0.21, surfaces_2_index=3e-4, elements_1_decentre_0=0.05, elements_1_tilt_0=1e-3
    )
    conic = Surface(1 / 51.5, 12.0, 5.0, find_glass("N-BK7"), -0.6, (0.0, 1e-7))
    for value in (made, Prescription((conic, Surface(0.0, 12.0)), "own")):
        shared(real("AC254-100-A").replace({"main_lens.prescription": value}))


def test_lens_files_lie_beside_the_design_and_saved_designs_need_none(tmp_path):
    folder, other = tmp_path / "a", tmp_path / "b"
    folder.mkdir()
    other.mkdir()
    lens = missed(load_lens("LB1630-A"), surfaces_1_radius=0.5)
    (folder / "lens.toml").write_text(tomli_w.dumps(table_of(replace(lens, name="mine"))))
    (folder / "lens.zmx").write_text(GOOD)
    (folder / "d.toml").write_text(text('prescription = "lens.toml"\nfocal_plane = "350 mm"\n'))
    (folder / "z.toml").write_text(text('prescription = "lens.zmx"\nfocal_plane = "350 mm"\n'))
    design = load(folder / "d.toml")
    assert design.lens.surfaces == lens.surfaces
    assert load(folder / "z.toml").f == pytest.approx(first_order(load_lens(folder / "lens.zmx"), 550e-6).focal_length)
    for name in ("d", "z"):
        save(load(folder / f"{name}.toml"), other / "saved.toml", overwrite=True)
        assert load(other / "saved.toml") == load(folder / f"{name}.toml")


def test_a_file_called_like_a_shipped_lens_comes_first(tmp_path):
    lens = load_lens("AC254-100-A")
    (tmp_path / "LB1630-A").write_text(tomli_w.dumps(table_of(lens)))
    (tmp_path / "d.toml").write_text(text('prescription = "LB1630-A"\nfocal_plane = "350 mm"\n'))
    assert load(tmp_path / "d.toml").lens == lens


def test_which_of_the_conjugates_follows():
    design = real()
    f = design.f
    closer = design.replace(d_f=300.0)
    assert (closer.d_f, closer.f) == (300.0, f)
    assert closer.d_1 == pytest.approx(1 / (1 / f - 1 / 300), rel=1e-14)
    fixed = design.replace(d_1=140.0)
    assert fixed.d_1 == 140.0
    assert fixed.d_f == pytest.approx(1 / (1 / f - 1 / 140), rel=1e-14)
    blue = fixed.replace(wavelength=480e-6)
    assert blue.f < f
    assert blue.d_1 == 140.0
    assert design.replace(wavelength=480e-6).d_f == 350.0
    assert loads(text('prescription = "LB1630-A"\n', 'distance = "140 mm"')) == fixed


def test_the_thin_twin_has_the_same_numbers():
    design = real(diameter='"40 mm"').replace({"main_lens.decentre": (0.1, 0.0)})
    twin = design.thin_twin
    assert twin.lens is None
    thick = Camera.of(design).numbers
    assert Camera.of(twin).numbers == {name: value for name, value in thick.items() if name != "hiatus"}
    assert twin == loads(dumps(twin))
    assert twin.main_lens.decentre == (0.1, 0.0)


CONTRADICTIONS = {
    'focal_length = "100 mm"\n': r"^main_lens.focal_length: 100 mm contradicts the prescription: LB1630-A has "
    r"f = 99.34\d* mm at 550 nm \(residual \+0.657\d mm\); drop main_lens.focal_length$",
    'diameter = "51 mm"\n': r"^main_lens.diameter: 51 mm is wider than LB1630-A, whose clear diameter is 50.8 mm; drop",
    'reversed = "yes"\n': r"^main_lens.reversed: ",
    'presciption = "x"\n': r"^main_lens.presciption: is not a known key; did you mean 'prescription'",
}


@pytest.mark.parametrize("extra", CONTRADICTIONS)
def test_contradictions(extra):
    with pytest.raises(DesignError, match=CONTRADICTIONS[extra]) as caught:
        loads(text(f'prescription = "LB1630-A"\nfocal_plane = "350 mm"\n{extra}'))
    assert len(caught.value.problems) == 1


def test_more_contradictions():
    agreeing = loads(text(f'prescription = "LB1630-A"\nfocal_plane = "350 mm"\nfocal_length = "{real().f!r} mm"\n'))
    assert agreeing.f == real().f
    cases = {
        text('prescription = "LB1630-A"\n'): "give one of main_lens.focal_plane or microlens_array.distance",
        text(
            'prescription = "LB1630-A"\nfocal_plane = "350 mm"\n', 'distance = "140 mm"'
        ): "f/d_f . f/d_1 - 1 = -0.006",
        text('prescription = "LB1630-A"\nfocal_plane = "90 mm"\n').replace(
            '"120 mm"', '"20 mm"'
        ): "main_lens.focal_plane: 90 mm is not beyond the",
        text('prescription = "LB1630-A"\nfocal_plane = "350 mm"\n').replace("550 nm", "90 nm"): "light.wavelength: LB",
        PAPER.replace("[aperture]", "reversed = true\n[aperture]"): "main_lens.reversed: an ideal lens looks the same",
        text('focal_plane = "350 mm"\nfocal_length = "100 mm"\n'): "main_lens.diameter: is missing",
        PAPER.replace(f"[main_lens]\n{IDEAL}", ""): r"add the table \[main_lens\] with diameter",
    }
    for content, told in cases.items():
        with pytest.raises(DesignError, match=told) as caught:
            loads(content)
        assert len(caught.value.problems) == 1, str(caught.value)
    hollow = Prescription((Surface(-1 / 50, 10.0, 2.0, find_glass("N-BK7")), Surface(1 / 50, 10.0)), "hollow")
    with pytest.raises(DesignError, match="hollow does not converge light"):
        real().replace({"main_lens.prescription": hollow})
    with pytest.raises(DesignError, match="contradicts the prescription"):
        real().replace(f=100.0)


@pytest.mark.parametrize(
    ("value", "told"),
    [
        ('"LB1630"', "no such file; check the path, or name a lens that ships: 45-089"),
        ('"none.zmx"', "none.zmx: no such file"),
        ('""', "expected a lens file"),
        ("3", "expected a lens file"),
        ("{ name = 'x' }", r"\.surfaces: a lens needs at least one surface"),
    ],
)
def test_lenses_that_cannot_be_read(value, told):
    with pytest.raises(DesignError, match=rf"^main_lens.prescription(: )?.*{told}"):
        loads(text(f'prescription = {value}\nfocal_plane = "350 mm"\n'))


def test_every_fault_of_lens_and_design_is_told_at_once(tmp_path):
    (tmp_path / "lens.toml").write_text('[[surfaces]]\nradius = "51 mm"\nglas = "N-BK7"\ndiameter = "50"\n')
    (tmp_path / "d.toml").write_text(
        text('prescription = "lens.toml"\nfocal_plane = "350 mm"\n').replace('"2.9 mm"', '"-2.9 mm"')
    )
    with pytest.raises(DesignError) as caught:
        load(tmp_path / "d.toml")
    lines = str(caught.value).splitlines()
    assert len(lines) == 3
    assert all(line.startswith(f"{tmp_path / 'd.toml'}: ") for line in lines)
    assert "main_lens.prescription: " in lines[0]
    assert "lens.toml: surfaces.1.diameter" in lines[0]
    assert "lens.toml: surfaces.1.glas: is not a known key; did you mean 'glass'?" in lines[1]
    assert "aperture.diameter" in lines[2]
