"""Designs that name parts of the catalogue: what the parts give, what stands beside them, what is shown and written."""

import dataclasses
import math

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.catalogue import load_catalogue
from roslf_design.catalogue.conditions import read_condition
from roslf_design.catalogue.entries import meant
from roslf_design.cli import main
from roslf_design.design.check import at
from roslf_design.optimization import Combinations
from roslf_design.reporting.design.parts_list import named_parts, parts_section
from roslf_design.toml_files import nearest
from tests.optimization.posing import goal, posed

SCOPE = """
name = "named"
[main_lens]
part = "AC050-008-A"
focal_plane = "40 mm"
[aperture]
diameter = "2.2 mm"
distance = "2 mm"
[[elements]]
kind = "plate"
distance = "3 mm"
part = "sapphire 3 x 0.5 mm"
[microlens_array]
part = "18-00079"
[sensor]
part = "Sony imx250"
distance = "90 um"
"""
NAMES = {"main_lens": "AC050-008-A", "microlens_array": "18-00079", "sensor": "IMX250"}


def told(text):
    with pytest.raises(roslf.InputError) as error:
        roslf.loads(text)
    return str(error.value).splitlines()


def test_named_parts_are_the_values_that_the_catalogue_has():
    """A camera with every number typed off is the same but for names, and for an array that is cut from its stock."""
    design, known = roslf.loads(SCOPE), load_catalogue()
    array = next(part for part in known.microlens_arrays if part.part == "18-00079")
    mla, sensor, (window,) = design.microlens_array, design.sensor, design.elements
    assert (mla.pitch, mla.focal_length, mla.size, mla.layout) == (array.pitch, array.focal, array.size, array.layout)
    assert (sensor.pixel, design.pixels) == (3.45e-3, (2448, 2048))
    assert (window.thickness, window.material.name, window.diameter) == (0.5, "sapphire", 2.7)
    assert design.lens.name == "AC050-008-A"
    assert {place: getattr(design, place).part for place in NAMES} == NAMES
    typed = design.replace(dict.fromkeys((*(f"{place}.part" for place in NAMES), "elements.0.part")))
    assert typed != design
    assert typed.replace({**{f"{place}.part": name for place, name in NAMES.items()}}).elements == typed.elements
    told, own = (roslf.evaluate(one).answer for one in (typed, design))
    widths = ("insertion_diameter_mm", "outer_diameter_mm", "outer_diameter_counts")
    assert dataclasses.replace(told, **{name: getattr(own, name) for name in widths}) == own
    assert own.outer_diameter_mm < told.outer_diameter_mm == math.hypot(*array.size)


def test_what_is_written_is_whole_and_keeps_the_names():
    design = roslf.loads(SCOPE)
    text = roslf.dumps(design)
    assert roslf.loads(text) == design
    # Without their values, the names give them again.
    assert roslf.loads(text.replace('pixel = "3.45 um"\n', "").replace('pitch = "30 um"\n', "")) == design


def test_own_values_beside_a_name_win():
    cropped = roslf.loads(SCOPE.replace('part = "Sony imx250"', 'part = "IMX250"\npixels = [1000, 800]'))
    assert cropped.pixels == (1000, 800)
    assert dict(named_parts(cropped))["sensor"] == "Sony IMX250, 1000 x 800 of its 2448 x 2048 px read"
    thin = roslf.loads(SCOPE.replace('part = "AC050-008-A"', 'part = "AC050-008-A"\nfocal_length = "7.5 mm"'))
    assert (thin.lens, thin.f, thin.D) == (None, 7.5, 4.5)
    other = roslf.loads(SCOPE.replace('part = "18-00079"', 'part = "18-00079"\npitch = "40 um"'))
    words = dict(named_parts(other))["microlens array"]
    assert words.endswith("18-00079 is named; as catalogued: pitch 30 um")
    assert words in [row[-1] for row in parts_section(other).blocks[0].rows]


def test_a_name_that_is_none_is_told_with_the_nearest_and_all_at_once():
    lines = told(SCOPE.replace("imx250", "imx25O").replace("sapphire 3", "safire 3").replace("18-00079", "my array"))
    assert len(lines) == 3
    assert lines[0].startswith("elements.0.part: 'safire 3 x 0.5 mm' is none of the windows")
    assert "did you mean 'sapphire 3 x 0.5 mm'?" in lines[0]
    assert "`roslf catalogue --kind microlens_arrays` lists them" in lines[1]
    assert "sensor.part: 'Sony imx25O' is none of the sensors" in lines[2]
    assert "'Sony IMX250'" in lines[2]
    assert any(line.startswith("sensor.part: must be text") for line in told(SCOPE.replace('"Sony imx250"', "3")))


def test_a_table_that_is_whole_may_have_any_name():
    own = SCOPE.replace('part = "Sony imx250"', 'part = "lot 7"\npixel = "2 um"\npixels = [900, 700]')
    design = roslf.loads(own)
    assert dict(named_parts(design))["sensor"] == "lot 7, as the design names it; not in the catalogue that ships"
    assert roslf.loads(roslf.dumps(design)) == design

    shipped = own.replace("lot 7", "Sony IMX250").replace("2 um", "3.45 um").replace("[900, 700]", "[2448, 2048]")
    assert dict(named_parts(roslf.loads(shipped)))["sensor"] == "Sony IMX250"


def test_a_quoted_array_says_what_it_is_made_of(tmp_path):
    """Its pitch grows as its glass: fused silica by 0.51e-6 /K (its data sheet's), and own values win."""
    (tmp_path / "mine.toml").write_text(
        '[[microlens_arrays]]\npart = "quote 9"\npitch = "45 um"\nfocal_length = "450 um"\nsize = ["9 mm", "9 mm"]\n'
        'material = "fused silica"\nprovenance = "x"\nconfidence = "typical"\n'
    )
    array = 'part = {file = "mine.toml", name = "quote 9"}'
    text = SCOPE.replace('part = "18-00079"', array) + '[environment]\ntemperature = "20 degC"\nhousing = "titanium"\n'
    design = roslf.loads(text, folder=tmp_path)
    assert design.at_temperature(120.0).d == pytest.approx(45e-3 * (1 + 0.51e-6 * 100), rel=1e-6)
    assert roslf.loads(roslf.dumps(design)) == design
    named = "quote 9, as the design names it; not in the catalogue that ships"
    assert dict(named_parts(design))["microlens array"] == named
    other = roslf.loads(text.replace(array, f'{array}\nmaterial = "BK7"'), folder=tmp_path)
    assert other.microlens_array.made_of.name == "BK7"


@pytest.mark.parametrize(
    ("names", "asked", "pixel"),
    [("qQ", "Q", 3e-3), ("qQ", "q", 2e-3), ("qq", "q", None), ("qQ", "M Q", 3e-3), ("qQ", "m q", None)],
)
def test_a_name_is_one_part_to_the_letter_or_in_other_case(tmp_path, names, asked, pixel):
    entry = '[[sensors]]\npart = "%s"\nmaker = "M"\npixel = "%d um"\npixels = [900, 700]\nprovenance = "x"\n'
    entries = (entry % pair + 'confidence = "typical"\n' for pair in zip(names, (2, 3), strict=True))
    (tmp_path / "mine.toml").write_text("".join(entries))
    text = SCOPE.replace('"Sony imx250"', f'{{file = "mine.toml", name = "{asked}"}}')
    if pixel:
        assert roslf.loads(text, folder=tmp_path).sensor.pixel == pixel
        return
    with pytest.raises(roslf.InputError, match=rf"sensor\.part: '{asked}' names 2 sensors in mine\.toml: '.' and '.'"):
        roslf.loads(text, folder=tmp_path)


def test_faults_of_tables_show_what_was_written():
    for wrong in (SCOPE.replace("[[elements]]", "[elements]"), SCOPE.replace("[main_lens]", "[[main_lens]]")):
        (line,) = told(wrong)
        assert "'part': " in line
        assert "Glass(" not in line
    for kind in ("mirror", "prism"):
        assert '[[elements]] (kind = "plate")' in told(SCOPE.replace('"plate"', f'"{kind}"'))[-1]


def test_parts_of_a_file_of_ones_own(tmp_path):
    (tmp_path / "mine.toml").write_text(
        '[[sensors]]\npart = "quote 7"\npixel = "2 um"\npixels = [900, 700]\nprovenance = "x"\nconfidence = "typical"\n'
    )
    text = SCOPE.replace('part = "Sony imx250"', 'part = {file = "mine.toml", name = "quote 7"}')
    (tmp_path / "scope.toml").write_text(text)
    design = roslf.load(tmp_path / "scope.toml")
    assert (design.pixels, design.sensor.part) == ((900, 700), "quote 7")
    assert roslf.loads(roslf.dumps(design)) == design  # without that file
    with pytest.raises(roslf.InputError, match="may open no file"):
        roslf.loads(text, folder=None)
    for wrong in ("sensors = 3\n", "sensors = [3]\n", "[sensors]\npart = 3\n"):
        (tmp_path / "mine.toml").write_text(wrong)
        with pytest.raises(roslf.InputError, match=r"sensor\.part: 'quote 7' is none of the sensors in mine\.toml"):
            roslf.load(tmp_path / "scope.toml")
    (tmp_path / "mine.toml").write_text('[[sensors]]\npart = "quote 7"\npixel = 2\n')
    with pytest.raises(
        roslf.InputError, match=r"sensor\.part: mine\.toml: .*pixel: 2 has no unit.*; mine\.toml: pixels"
    ):
        roslf.load(tmp_path / "scope.toml")
    with pytest.raises(roslf.InputError, match=r"sensor\.part: gone\.toml: .*check the path"):
        roslf.loads(text.replace("mine.toml", "gone.toml"), folder=tmp_path)


def test_a_change_of_name_changes_the_part_and_a_change_of_focus_keeps_it():
    design = roslf.loads(SCOPE)
    assert design.replace({"sensor.part": "IMX226"}).pixels == (4000, 3000)
    assert design.replace({"sensor.part": "IMX226", "sensor.size": (3.7, 1.85)}).pixels == (2000, 1000)
    assert design.replace(d_f=50.0).main_lens.part == "AC050-008-A"
    singlet = design.replace({"main_lens.part": "singlet 25.4 mm f35", "d_f": 80.0})
    assert (singlet.lens, singlet.f, singlet.d_f) == (None, 35.0, 80.0)
    other = singlet.replace(d_f=80.0, d_1=90.0)  # which asks for another focal length
    assert other.main_lens.part is None
    assert roslf.loads(roslf.dumps(other)) == other


@pytest.mark.parametrize("place", ["aperture", "foo", "elements", "elements.7", "elements.0.material", "sensor.cover"])
def test_a_place_that_no_part_has_is_told(place):
    with pytest.raises(roslf.InputError, match=f"^{place}.part: is not a "):
        roslf.loads(SCOPE).replace({f"{place}.part": "x"})


@pytest.mark.parametrize(
    "own", ['"lot 7"\npixel = "2 um"\npixels = [90, 70]', '"IMX250"\npixels = [100, 100]', '"OV5647"\ncolours = "RGGB"']
)
def test_a_name_given_again_changes_nothing(own):
    design = roslf.loads(SCOPE.replace('"Sony imx250"', own))
    places = ("sensor.part", "main_lens.part", "microlens_array.part", "elements.0.part")
    assert design.replace({place: at(design, place) for place in places}) == design


def test_another_part_takes_the_place_of_what_it_gives():
    """Filters of one's own stay where it says nothing of them; those of the part before do not."""
    for own, kept in (
        ('"IMX250"\ncolours = "RGGB"', "RGGB"),
        ('"OV5647"\ncolours = "RGGB"', "RGGB"),
        ('"OV5647"', "mono"),
    ):
        sensor = roslf.loads(SCOPE.replace('"Sony imx250"', own)).replace({"sensor.part": "IMX226"}).sensor
        assert (sensor.pixel, sensor.colours, sensor.acceptance) == (1.85e-3, kept, None)


def test_another_prescription_is_no_longer_the_lens_that_was_named():
    design = roslf.loads(SCOPE)
    changes = {"main_lens.prescription": "LA1050-A", "d_f": 150.0}
    assert design.replace(changes).main_lens.part is None
    assert design.replace({**changes, "main_lens.part": "LA1050-A"}).main_lens.part == "LA1050-A"
    assert design.replace({"main_lens.prescription": design.main_lens.prescription}) == design
    base = roslf.load("paper-singlet").replace({"main_lens.part": "LA1050-A"})
    problem = posed({"d_3": (80.0, 140.0)}, (), goal("sigma_z_mm", "min"), design=base)
    glasses = Combinations.of(problem, load_catalogue(), ("glasses",), glasses=("N-SF11", "N-BK7"))
    assert [glasses.problem_at(k).design.main_lens.part for k in range(2)] == [None, "LA1050-A"]


def test_a_study_that_chooses_parts_names_them():
    """In place of those that the design named before."""
    base = roslf.load("rigid-scope").replace({"sensor.part": "IMX250"})
    problem = posed({"d_2": (0.2, 20.0)}, (), goal("sigma_z_mm", "min"), design=base)
    combinations = Combinations.of(problem, load_catalogue(), ("microlens_arrays", "sensors"))
    array, sensor = combinations.chosen(7)
    design = combinations.problem_at(7).design_at(np.array([0.5]))
    assert (design.microlens_array.part, design.sensor.part) == (array.part, sensor.part)
    assert roslf.loads(roslf.dumps(design)) == design
    assert dict(named_parts(design))["sensor"].startswith(sensor.name)


@pytest.mark.parametrize(("own", "kept"), [({}, "mono"), ({"sensor.colours": "RGGB"}, "RGGB")])
def test_a_sensor_that_a_study_chooses_has_not_what_the_one_before_declared(own, kept):
    """Filters of one's own stay; each sensor has those that it declares itself."""
    base = roslf.load("rigid-scope").replace({"sensor.part": "OV5647"})
    assert (base.sensor.colours, base.sensor.acceptance) == ("BGGR", pytest.approx(np.radians(42)))
    problem = posed({"d_2": (0.2, 20.0)}, (), goal("sigma_z_mm", "min"), design=base.replace(own))
    combinations = Combinations.of(problem, load_catalogue(), ("sensors",))
    chosen = [combinations.problem_at(k).design.sensor for k in range(len(combinations))]
    assert {sensor.colours for sensor in chosen if sensor.part == "OV5647"} == {"BGGR"}
    silent = {part.part for part in load_catalogue().sensors if part.colours is None}
    others = [sensor for sensor in chosen if sensor.part in silent]
    assert {(sensor.colours, sensor.acceptance) for sensor in others} == {(kept, None)}
    assert {sensor.colours for sensor in chosen if sensor.part == "IMX477"} == {"RGGB"}


def test_what_nobody_states_of_a_sensor_is_said(capsys):
    """Filters, full well, package and cover glass: of each sensor what is known, else that it is not."""
    sensors = {part.part: part for part in load_catalogue().sensors}
    told = {name: (sensors[name].filters, sensors[name].unstated) for name in ("OV9734", "IMX290", "IMX477", "OV6948")}
    assert told == {
        "OV9734": ("not stated", ("colour filters", "full well", "package", "cover glass")),
        "IMX290": ("with and without", ("full well", "package", "cover glass")),
        "IMX477": ("RGGB", ("full well", "package", "cover glass")),
        "OV6948": ("not stated", ("colour filters", "full well", "cover glass")),
    }
    assert roslf.load("rigid-scope").replace({"sensor.part": "OV6948"}).sensor.package == (0.575, 0.575)
    assert main(["catalogue", "--kind", "sensors"]) == 0
    said = capsys.readouterr().out
    assert said.count("not stated") > 30
    assert "No cover glass is stated" in said


def test_the_catalogue_prints_what_to_paste(capsys, tmp_path):
    from roslf_design.commands.catalogue import catalogue

    catalogue(kind=["sensors"], where=["part=IMX250"])
    assert '[sensor]\npart = "IMX250"  # gives pixel, size, full_well, read_noise\n' in capsys.readouterr().out
    mine = tmp_path / "mine.toml"
    mine.write_text(
        '[[windows]]\npart = "w"\ndiameter = "3 mm"\nthickness = "1 mm"\nmaterial = "sapphire"\nprovenance = "x"\n'
        'confidence = "typical"\n'
    )
    catalogue(kind=["windows"], where=["part=w"], file=[mine])
    assert f'kind = "plate"\npart = {{file = "{mine}", name = "w"}}' in capsys.readouterr().out


def test_parts_are_known_in_other_case_and_with_other_spaces():
    names = [("IMX 290", "Sony IMX 290"), ("IMX296", "Sony IMX296"), ("imx296", "another")]
    assert [meant(asked, names) for asked in ("imx290", "sony imx296", "imx296", "IMX 291")] == [[0], [1], [2], []]


def test_a_part_one_digit_off_is_the_one_meant():
    """As many letters are alike in another, whose digits would have to change places."""
    for known in (["OV6948", "OV5647"], ["OV5647", "OV6948"]):
        assert nearest("OV5648", known) == "did you mean 'OV5647'?"


def test_a_slip_in_the_last_digit_suggests_the_nearest_number():
    """IMX305 is IMX304 by the last digit, IMX335 by one amid it."""
    assert "did you mean 'IMX304'?" in nearest("IMX305", ["IMX335", "IMX304", "IMX412"])


def test_sensors_sold_with_filters_and_without_can_be_had_as_either():
    mono, bayer = (read_condition(f"colours={name}") for name in ("mono", "bayer"))
    assert mono({"mono_too": True})
    assert bayer({"mono_too": True})
    assert not mono({"mono_too": False})
    assert not mono({"colours": "bayer"})


def test_a_part_that_nobody_verified_says_so_beside_its_name():
    text = SCOPE.replace('part = "Sony imx250"', 'part = "OH02A10"')
    assert dict(named_parts(roslf.loads(text)))["sensor"] == "OmniVision OH02A10, unverified, no package size known"
