"""The one camera: numbers of a design, changed one by one or many at once."""

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.design import PATHS, DesignError
from roslf_design.traced.camera import _faces, camera_of
from roslf_design.traced.images import real_field

PAPER = roslf.load("paper")
NAMES = roslf.preset_names()
SYMBOLS = ("f", "d_f", "d_1", "D_F", "d_3", "d", "f_ml", "d_2", "q", "wavelength", "D")


@pytest.mark.parametrize("name", NAMES)
def test_numbers_are_the_designs_own(name):
    design = roslf.load(name)
    camera = Camera.of(design)
    assert [camera[PATHS[s]] for s in SYMBOLS] == [getattr(design, s) for s in SYMBOLS]
    if camera.chain.in_air:  # else symbols are what the main lens sees
        assert [getattr(camera, s) for s in SYMBOLS] == [getattr(design, s) for s in SYMBOLS]
    assert camera.shape == ()
    assert camera.valid
    names = ["main lens", *(f"stop {k + 1}" for k in range(len(design.stops)))]
    assert [rim.name for rim in camera.rims][: len(names)] == names
    assert bool(design.elements) == (len(camera.rims) > len(names))


@settings(max_examples=60, deadline=None)
@given(st.sets(st.sampled_from(["f", "d_f", "d_1", "d_3", "q", "d_2"]), min_size=1, max_size=5), st.data())
def test_many_builds_are_the_designs_one_by_one(names, data):
    """What follows (f, d_f, d_1) is told by `Design.replace`, another path through the same rule."""
    if {"f", "d_f", "d_1"} <= names:
        names = names - {"f"}
    factors = {name: data.draw(st.floats(0.98, 1.02)) for name in sorted(names)}
    values = {name: getattr(PAPER, name) * np.array([1.0, factor]) for name, factor in factors.items()}
    camera = Camera.of(PAPER, values)
    design = PAPER.replace(**{name: float(value[1]) for name, value in values.items()})
    for symbol in SYMBOLS:
        got = np.broadcast_to(getattr(camera, symbol), (2,))[1]
        assert got == pytest.approx(getattr(design, symbol), rel=1e-14)  # a rounding or two of the conjugates
    assert camera.build(1).f == pytest.approx(design.f, rel=1e-14)


def test_impossible_builds_are_told_and_keep_their_numbers():
    camera = Camera.of(PAPER, {"d_3": [0.0, 349.0, 350.0, 400.0], "D_F": [0.0, 1.0, 1.0, 1.0]})
    assert camera.valid.tolist() == [False, True, False, False]
    assert camera.H.tolist()[1:] == pytest.approx([350.0, np.inf, -7.0])
    assert camera.inverse_H.tolist() == pytest.approx([1, 1 / 350, 0, -1 / 7])


def test_focus_follows_where_asked():
    camera = Camera.of(PAPER, {"d_3": np.array([0.0, 100.0, 150.0])}, in_focus=True)
    np.testing.assert_allclose(1 / camera.f_ml, 1 / camera.d_2 + camera.vergence, rtol=1e-15)


def test_values_compare_hash_pickle_and_print():
    camera = Camera.of(PAPER, {"d_3": np.array([1.0, 2.0])})
    twin = pickle.loads(pickle.dumps(camera))
    assert twin == camera
    assert hash(twin) == hash(camera)
    assert camera != Camera.of(PAPER)
    assert camera != "a camera"
    assert "d_3=array(2,)" in repr(camera)


@pytest.mark.parametrize("place", ["aperture.size", "stops.3.diameter", "main_lens"])
def test_unknown_places_are_errors(place):
    with pytest.raises(DesignError, match="is not a number of this design"):
        Camera.of(PAPER, {place: 1.0})
    with pytest.raises(DesignError, match="did you mean 'd_3'"):
        Camera.of(PAPER, {"d_33": 1.0})


def test_light_meets_the_farthest_stop_first():
    design = PAPER.replace({"stops": [{"diameter": 9.0, "distance": 60.0}, {"diameter": 5.0, "distance": 200.0}]})
    assert [rim.name for rim in Camera.of(design).in_light_order] == ["stop 2", "FAP", "stop 1", "main lens"]


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"d_3": [1.0, 2.0], "D_F": [1.0, 2.0, 3.0]}, "do not broadcast together: d_3 .2,., D_F .3,."),
        ({"f": 100.0, "d_f": 350.0, "d_1": 140.0}, "vary two of these"),
    ],
)
def test_what_makes_no_camera_is_named(values, said):
    with pytest.raises(DesignError, match=said):
        Camera.of(PAPER, values)


def test_a_real_lens_has_its_own_focal_length_for_every_colour():
    design = roslf.load("paper-singlet")
    colours = np.array([486e-6, 550e-6, 656e-6])
    camera = Camera.of(design, {"wavelength": colours})
    for f, colour in zip(camera.f, colours, strict=True):
        assert f == pytest.approx(design.replace(wavelength=float(colour)).f, rel=1e-14)
    np.testing.assert_allclose(1 / camera.d_f + 1 / camera.d_1, 1 / camera.f, rtol=1e-14)


def in_liquid(abbe: float, **more):
    """Behind a plate in a liquid whose index at the design's wavelength, the d line, no Abbe number changes."""
    plate = {"kind": "plate", "distance": "125 mm", "thickness": "3 mm", "material": "N-BK7", "diameter": "40 mm"}
    return roslf.load("paper-singlet").replace(
        {
            "light.wavelength": 587.5618e-6,
            "elements": [plate],
            "object_space": {"medium": {"index": 1.35, "abbe": abbe}},
            **more,
        }
    )


def kinds():
    """Designs of which each pair differs in one thing that no number of a camera shows."""
    yield in_liquid(20.0)
    yield in_liquid(80.0)
    yield in_liquid(20.0, environment={"temperature": 20.0})
    yield in_liquid(20.0, environment={"temperature": 20.0, "housing": "aluminium"})
    yield in_liquid(20.0, **{"sensor.colours": "RGGB"})
    yield in_liquid(20.0, **{"microlens_array.lens_shape": "circular"})
    yield in_liquid(20.0, **{"microlens_array.layout": "hexagonal"})


def test_cameras_are_equal_only_where_all_of_them_is():
    cameras = [Camera.of(design) for design in kinds()]
    for k, camera in enumerate(cameras):
        for other in cameras[:k]:
            assert camera != other
            assert hash(camera) != hash(other)
        numbers = dict(reversed(camera.numbers.items()))  # equal whatever the order in which places were given
        turned = Camera(numbers, camera._kind)
        for twin in (pickle.loads(pickle.dumps(camera)), camera.replace({}), turned):
            assert twin == camera
            assert hash(twin) == hash(camera)


def test_dispersion_is_that_of_a_design_s_own_liquid_whatever_was_asked_before():
    field, every = [(0.5, 0.0)], {}
    for order in ((20.0, 80.0), (80.0, 20.0)):
        for cached in (camera_of, _faces):
            cached.cache_clear()  # what comes first is computed, as in a process of its own
        every[order] = {abbe: real_field(in_liquid(abbe), field).lateral_colour[0] for abbe in order}
    assert every[20.0, 80.0] == every[80.0, 20.0]
    assert every[20.0, 80.0][20.0] != pytest.approx(every[20.0, 80.0][80.0], rel=0.1)


def test_a_symbol_alone_answers_only_where_ruler_and_lens_agree():
    air, behind = Camera.of(roslf.load("paper")), Camera.of(roslf.load("cystoscope"))
    for symbol in ("d_f", "d_1", "d_2", "d_3", "D_F"):
        assert getattr(air, symbol) == getattr(air.seen, symbol) == getattr(air.ruler, symbol)
    assert behind.ruler.d_3 == 62.84
    assert behind.seen.d_3 == pytest.approx(0.0052, abs=5e-5)
    with pytest.raises(AttributeError, match=r"62\.84 as a mechanical .*\(camera\.ruler\.d_3\).*camera\.seen\.d_3"):
        _ = behind.d_3
    with pytest.raises(AttributeError, match=r"camera\.seen\.H"):
        _ = behind.H
    assert behind.d_2 == behind.seen.d_2  # no glass between array and sensor
    with pytest.raises(AttributeError, match="no attribute 'd_4'"):
        _ = behind.d_4
