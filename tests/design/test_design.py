import copy
import pickle

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from pydantic import ValidationError

from roslf_design.design import (
    PATHS,
    Design,
    DesignError,
    Light,
    MainLens,
    MicrolensArray,
    Pupil,
    Sensor,
    Stop,
    dumps,
    load,
    loads,
    preset_names,
    save,
)

length = st.floats(1e-3, 1e3)
small = st.floats(-1.0, 1.0)


@st.composite
def designs(draw):
    """Any valid design: unlike archetypes, no two numbers have anything to do with each other."""
    f, reach = draw(length), draw(st.floats(1.001, 1e3))
    d_f = f * reach
    assume(d_f > f)
    given_pair = draw(st.sampled_from(["f d_f", "f d_1", "d_f d_1"]))
    d_1 = f + f * f / (d_f - f)
    assume(d_1 > f)
    pixel, count = draw(length), st.floats(1, 1e4)
    array = draw(length), draw(length)
    stops = draw(st.lists(st.builds(Stop, diameter=length, distance=st.floats(0, d_f * 0.9)), max_size=3))
    return Design(
        name=draw(st.text(st.characters(exclude_categories=["Cc", "Cs"]), min_size=1, max_size=12)),
        main_lens=MainLens(
            diameter=draw(length),
            focal_length=f if "f " in given_pair.replace("d_f", "") else None,
            focal_plane=d_f if "d_f" in given_pair else None,
            decentre=(draw(small), draw(small)),
        ),
        aperture=Stop(diameter=draw(length), distance=d_f * draw(st.floats(0, 0.9)), tilt=(draw(small), 0.0)),
        stops=tuple(stops),
        microlens_array=MicrolensArray(
            pitch=min(array) / draw(count),  # a whole microlens, at least
            focal_length=draw(length),
            distance=d_1 if "d_1" in given_pair else None,
            size=array,
            layout=draw(st.sampled_from(["square", "hexagonal"])),
            rotation=draw(small),
        ),
        sensor=Sensor(distance=draw(length), pixel=pixel, size=(pixel * draw(count), pixel * draw(count))),
        light=Light(wavelength=draw(st.floats(1e-4, 1e-2))),
    )


def every_value_round_trips(value, *texts):
    """What every value of the project owes its user: equality, hash, copy, pickle and its own texts."""
    read_again = [there_and_back(value) for there_and_back in texts]
    for twin in (copy.deepcopy(value), pickle.loads(pickle.dumps(value)), *read_again):
        assert twin == value
        assert hash(twin) == hash(value)
        assert repr(twin) == repr(value)


@given(designs())
def test_toml_json_pickle_round_trips(design):
    every_value_round_trips(
        design,
        lambda d: loads(dumps(d)),
        lambda d: Design.model_validate_json(d.model_dump_json()),
        lambda d: eval(repr(d), globals() | {"Pupil": Pupil}),
    )
    assert design.replace() == design


@given(designs())
def test_two_conjugates_give_the_third(design):
    assert_allclose(1 / design.d_f + 1 / design.d_1, 1 / design.f, rtol=1e-12)


@pytest.mark.parametrize("name", preset_names())
def test_presets_load_and_round_trip(name):
    design = load(name)
    assert loads(dumps(design)) == design
    assert design.source


def test_the_paper_is_the_first_preset_and_its_numbers_are_exact():
    assert preset_names()[0] == "paper"
    p = load("paper")
    assert (p.D, p.f, p.d_f, p.d_1, p.D_F, p.d_3, p.d, p.f_ml, p.d_2, p.q, p.wavelength) == (
        50.8,
        100.0,
        350.0,
        140.0,
        2.9,
        120.0,
        0.063,
        2.0,
        2.0,
        0.004847826,
        550e-6,
    )
    assert load("paper").pixels == (4600, 3080)


def test_table_2_gives_its_derived_distances():
    design = load("paper-calibrated")
    assert_allclose((design.d_1, design.d_f, design.d_3), (142.0, 14200 / 42, 100 + 8.91 / 0.42), rtol=1e-8)


def test_values_are_frozen_and_bare_numbers_are_mm_in_python():
    design = load("paper")
    with pytest.raises(ValidationError, match="frozen"):
        design.name = "other"
    assert design.replace({"aperture.diameter": "3 mm"}) == design.replace(D_F=3)


def test_what_follows_when_one_of_f_df_d1_changes():
    paper = load("paper")
    refocused = paper.replace(d_f=400.0)
    assert (refocused.f, refocused.d_f) == (100.0, 400.0)
    assert_allclose(refocused.d_1, 400 / 3, rtol=1e-15)
    other_lens = paper.replace(f=101.0)
    assert (other_lens.f, other_lens.d_1) == (101.0, 140.0)
    assert_allclose(other_lens.d_f, 101 * 140 / 39, rtol=1e-14)
    assert_allclose(paper.replace(f=90.0, d_f=400.0).d_1, 90 * 400 / 310, rtol=1e-14)


def test_replacing_a_list_entry_and_an_offset():
    design = load("paper").replace({"stops": [{"diameter": 5.0, "distance": 60.0}]})
    moved = design.replace({"stops.0.decentre.1": 0.25, "aperture.decentre.0": -0.1})
    assert moved.stops[0].decentre == (0.0, 0.25)
    assert moved.aperture.decentre == (-0.1, 0.0)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"aperture.diamter": 3.0}, "diamter.*did you mean 'diameter'"),
        ({"apertur.diameter": 3.0}, "apertur.diameter: is not a place"),
        ({"stops.3.diameter": 3.0}, "is not a place"),
        ({"aperture.diameter": -3.0}, "must be greater than zero"),
        ({"aperture.distance": 350.0}, "object plane would lie inside the bore"),
        ({"main_lens.focal_plane": 90.0}, "not beyond the focal length"),
        (
            {"sensor.pixel": 25.0},
            r"sensor\.size: 22\.3 mm x 14\.932 mm is less than one pixel of 25 mm; check the units",
        ),
        ({"depth.contrast": 0.31}, r"depth\.contrast: 0\.31 in each octave .* give 0\.3 at most, or depth\.period"),
    ],
)
def test_replace_tells_what_is_wrong(changes, said):
    with pytest.raises(DesignError, match=said):
        load("paper").replace(changes)


@pytest.mark.parametrize("symbol", ["d_3", "D_F", "q", "f_ml"])
def test_replace_takes_symbols_among_places(symbol):
    paper = load("paper").replace({"sensor.relay_magnification": 2.0})
    value = 0.9 * getattr(paper, symbol)
    assert paper.replace({symbol: value, "sensor.relay_magnification": 2.0}) == paper.replace(**{symbol: value})


def test_faults_between_parts_made_in_python_are_told():
    with pytest.raises(DesignError, match=r"aperture\.distance: 400 mm .* inside the bore"):
        Design(**{**dict(load("paper")), "aperture": Stop(diameter=1.0, distance=400.0)})


def test_unknown_symbol():
    with pytest.raises(DesignError, match="d_9: is not a symbol"):
        load("paper").replace(d_9=1.0)


def test_relay_scales_the_pixel_and_the_sensor_alike():
    design = load("paper").replace({"sensor.relay_magnification": 0.5})
    assert design.q == 2 * 0.004847826
    assert design.sensor_size[0] == 44.6
    assert design.pixels == (4600, 3080)
    assert design.replace(q=0.004).q == 0.004


BAD = """
name = "bad"
[main_lens]
diameter = 50.8
focal_length = "100 mm"
focal_plane = "350 mm"
[aperture]
diameter = "-2.9 mm"
distance = "400 mm"
diamter = "3 mm"
[microlens_array]
pitch = "63 mrad"
focal_length = "0 mm"
distance = "150 mm"
size = ["23 mm"]
layout = "hex"
[sensor]
distance = "2 mm"
pixel = "5 um"
"""


def test_every_fault_at_once_with_place_and_remedy():
    with pytest.raises(DesignError) as caught:
        loads(BAD, "bad.toml")
    lines = str(caught.value).splitlines()
    assert all(line.startswith("bad.toml: ") for line in lines)
    for key, words in {
        "main_lens.diameter": "has no unit",
        "aperture.diameter": "greater than zero",
        "aperture.diamter": "did you mean 'diameter'",
        "microlens_array.pitch": "unit of angle",
        "microlens_array.focal_length": "greater than zero",
        "microlens_array.size": "must be a list of 2",
        "microlens_array.layout": "square",
        "sensor.size": "is missing",
        "aperture.distance": "inside the bore",
        "microlens_array.distance": "contradict each other: .*drop microlens_array.distance .*140 mm",
    }.items():
        assert any(key in line and __import__("re").search(words, line) for line in lines), (key, words, lines)


def test_a_faulty_width_hides_no_fault_behind_glass():
    plate = {"kind": "plate", "distance": 120.0, "thickness": 1.0, "material": "N-BK7"}
    text = dumps(load("paper").replace({"elements": [plate]})).replace('"140 mm"', '"90 mm"')
    with pytest.raises(DesignError) as caught:
        loads(text.replace('diameter = "2.9 mm"', 'diameter = "-2.9 mm"'))
    assert [problem.key for problem in caught.value.problems] == ["aperture.diameter", "microlens_array.distance"]


def test_residual_of_a_contradiction_is_the_one_by_hand():
    with pytest.raises(DesignError, match=r"f/d_f \+ f/d_1 - 1 = -0\.04762, not 0"):
        load("paper").replace({"main_lens.focal_length": 100, "main_lens.focal_plane": 350, CONTRADICTED: 150})


CONTRADICTED = "microlens_array.distance"


@pytest.mark.parametrize(
    ("content", "said"),
    [(b"name = [", "is not valid TOML"), (b"\xff\xfe", "not UTF-8"), (b"", "main_lens: is missing; add the table")],
)
def test_files_that_are_no_design(tmp_path, content, said):
    path = tmp_path / "x.toml"
    path.write_bytes(content)
    with pytest.raises(DesignError, match=said):
        load(path)


def test_missing_file_and_folder(tmp_path):
    with pytest.raises(DesignError, match="no such file"):
        load(tmp_path / "none.toml")
    with pytest.raises(DesignError, match="is a folder"):
        load(tmp_path)


def test_save_is_whole_or_nothing(tmp_path):
    path = tmp_path / "d.toml"
    save(load("paper"), path)
    assert load(path) == load("paper")
    with pytest.raises(FileExistsError):
        save(load("paper-mismatched"), path)
    assert load(path) == load("paper")
    save(load("paper-mismatched"), path, overwrite=True)
    assert load(path).d_3 == 20.0
    assert [p.name for p in tmp_path.iterdir()] == ["d.toml"]


def test_a_bare_design_says_what_is_missing_in_our_words():
    with pytest.raises(DesignError) as error:
        Design(name="bare")
    text = str(error.value)
    assert "main_lens" in text
    assert "microlens_array" in text
    assert "validation error" not in text


def test_notebooks_show_a_design_as_a_table():
    page = load("paper")._repr_html_()
    assert "<table>" in page
    assert ">d_3</td><td>120 mm</td>" in page


def test_tables_in_a_row_are_counted_from_0_in_messages():
    """As in every place that studies, `replace` and `--sigma` take."""
    paper = dumps(load("paper"))
    for second, key in (("-9 mm", "stops.1.diameter"), ("9 mm", "stops.1.distance")):
        stops = [("9 mm", "50 mm"), (second, "400 mm" if key.endswith("distance") else "50 mm")]
        text = "".join(f'\n[[stops]]\ndiameter = "{size}"\ndistance = "{z}"\n' for size, z in stops)
        with pytest.raises(DesignError) as caught:
            loads(paper + text)
        assert [problem.key for problem in caught.value.problems] == [key]


def test_a_key_in_the_wrong_table_is_told_where_it_stands():
    with pytest.raises(DesignError) as told:
        loads(dumps(load("paper")).replace("[sensor]\n", '[sensor]\nilluminance = "2 lx"\nmaterial = "N-BK7"\n'))
    text = str(told.value)
    assert "sensor.illuminance: is not a known key; it stands in [light]" in text
    assert "sensor.material: is not a known key; it stands in [main_lens] or [[elements]] or [microlens_array]" in text


@pytest.mark.parametrize("symbol", PATHS)
def test_replace_names_the_symbol_of_a_file_s_key(symbol):
    key = PATHS[symbol].rpartition(".")[2]
    if key != symbol:
        with pytest.raises(DesignError, match=rf"did you mean .*'{symbol}'"):
            load("paper").replace(**{key: 2.0})
