"""The registry of quantities: what evaluate, tolerance studies and the optimiser share."""

import copy
import dataclasses
import pickle
import re

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.reporting.sheet.lines import basis
from roslf_design.theory.depth_of_field import depth_of_field
from roslf_design.theory.field_of_view import focus_ahead
from roslf_design.theory.quantities import _EVERY, QUANTITIES, in_words, quantity_named
from roslf_design.theory.quantity import Listed, Quantity
from roslf_design.theory.stop_images import MicrolensImages
from roslf_design.theory.vignetting import field_limit

PAPER = roslf.load("paper")
WIDE = {
    "stops": [{"diameter": 14.0, "distance": 60.0, "decentre": (0.4, 0.0)}, {"diameter": 9.0, "distance": 160.0}],
    "aperture.decentre": (-0.2, 0.1),
    "main_lens.decentre": (0.3, 0.2),
}


def test_names_and_words():
    for name, quantity in QUANTITIES.items():
        assert quantity.name == name
        assert quantity.words
        assert quantity.of or quantity.local
    assert quantity_named("fill_factor") is QUANTITIES["fill_factor"]
    with pytest.raises(ValueError, match="did you mean 'fill_factor'"):
        quantity_named("fil_factor")
    assert len(QUANTITIES) == len(_EVERY)  # no name twice
    with pytest.raises(ValueError, match="belongs to a field"):
        QUANTITIES["kept_fraction"](Camera.of(PAPER))


@pytest.mark.parametrize(
    ("name", "text", "limit"),
    [
        ("field_of_view_deg", "70 deg", 70.0),
        ("field_of_view_deg", "3.141592653589793 rad", 180.0),
        ("sigma_z_mm", "20 um", 0.02),
        ("mismatch_px", "0.5 px", 0.5),
        ("distortion_percent", "-3 %", -3.0),
        ("mtf50_lp_per_mm", "12 lp/mm", 12.0),
        ("pixel_electrons", "5000 e-", 5000.0),
    ],
)
def test_a_limit_is_read_with_its_unit(name, text, limit):
    assert QUANTITIES[name].limit(text) == limit
    for other in ("3 lx", text.split()[0], "three"):
        with pytest.raises(ValueError, match=rf"{other}.*(; |e\.g\. |but this)"):
            QUANTITIES[name].limit(other)


@pytest.mark.parametrize("name", sorted(q.name for q in QUANTITIES.values() if q.of))
def test_builds_are_their_single_cameras(name):
    quantity = QUANTITIES[name]
    at = 30.0 if quantity.at != "never" else None
    d_3 = np.array([0.0, 20.0, 100.0, 120.0])
    design = PAPER.replace(WIDE)
    together = np.broadcast_to(quantity(Camera.of(design, {"d_3": d_3}), at), 4)
    for value, one in zip(together, d_3, strict=True):
        # Rounding of `inverse_m` and the like, taken once for all or build by build: equal operations, equal bits. What
        # is summed takes closed forms for many builds and rows for one, far out of focus here: both to 1e-11.
        own = quantity(Camera.of(design, {"d_3": float(one)}), at)
        assert own == (pytest.approx(value, rel=1e-11) if quantity.numeric else value)


def test_the_undistorted_field_is_that_of_evaluate_under_decentres():
    for changes in (WIDE, {**WIDE, "aperture.distance": 40.0}, {**WIDE, "main_lens.diameter": 30.0}):
        design = PAPER.replace(changes)
        told = roslf.evaluate(design).non_distortion
        assert float(QUANTITIES["undistorted_field_mm"](Camera.of(design))) == pytest.approx(told.x0_max_mm, rel=1e-14)
        assert float(QUANTITIES["non_distortion_room_mm"](Camera.of(design))) == told.room_at_corner_mm
        assert field_limit(Camera.of(design)).rim == told.limited_by


@pytest.mark.parametrize("name", [q.name for q in QUANTITIES.values() if q.of and q.local and q.worst is None])
def test_local_numbers_of_straight_cameras_are_the_whole_cameras(name):
    camera = Camera.of(PAPER, {"d_3": np.array([20.0, 120.0])})
    local = np.broadcast_to(QUANTITIES[name].local(MicrolensImages(camera, [(0.0, 0.0), (8.0, -5.0)])), (2, 2))
    np.testing.assert_allclose(local, np.broadcast_to(QUANTITIES[name](camera), (2, 2)), rtol=1e-10)


def test_behind_the_tip_nothing_has_a_value():
    camera = Camera.of(PAPER, {"d_2": np.array([1.9, 2.0])})
    for name in ("sigma_z_mm", "object_sample_mm", "blur_pitches", "mtf50_lp_per_mm"):
        for at in (-1.0, -1e-9):
            assert np.isnan(QUANTITIES[name](camera, at)).tolist() == [True, True]
        assert np.isfinite(QUANTITIES[name](camera, 200.0)).all()


def test_one_entry_is_seen_in_evaluate_and_on_the_data_sheet(monkeypatch):
    entry = Quantity(
        "twice_the_distance_mm",
        "mm",
        "twice the way from the tip to a plane",
        lambda c, at: np.asarray(2 * (focus_ahead(c) if at is None else at)),
        at="optional",
        label="twice the distance",
        digits=3,
        evaluated=Listed("sampling", remark="of the focal plane"),
        sheet=Listed("Object field", remark="for nothing"),
    )
    monkeypatch.setitem(QUANTITIES, entry.name, entry)
    design = roslf.load("paper")
    ahead = design.d_f - design.d_3
    result = roslf.evaluate(design)
    assert result.sampling.twice_the_distance_mm == 2 * ahead
    assert result.to_dict()["sampling"]["twice_the_distance_mm"] == 2 * ahead
    assert re.search(r"twice the distance +460 mm +of the focal plane", result.everything)
    rows = [line for line in basis(design).rows if line.name.startswith("twice the distance")]
    places = [float(line.name.split()[4]) for line in rows]
    assert [line.value for line in rows] == pytest.approx([2 * place for place in places], rel=1e-3)
    assert [line.quantity for line in rows] == ["", entry.name, ""]
    assert in_words("twice_the_distance_mm@1") == "twice the distance at field 1"


def test_numbers_of_a_group_are_values():
    numbers = roslf.evaluate("paper").f_number
    assert numbers == roslf.evaluate("paper").f_number
    assert numbers != roslf.evaluate("paper-mismatched").f_number
    assert pickle.loads(pickle.dumps(numbers)) == copy.deepcopy(numbers) == numbers
    assert hash(numbers) == hash(copy.copy(numbers))
    assert eval(repr(numbers).replace("Numbers", "dict")) == dict(numbers)
    assert numbers["pupil"] == numbers.pupil
    with pytest.raises(AttributeError, match=r"there is no pupils among microlens, .*pupil"):
        _ = numbers.pupils
    with pytest.raises(dataclasses.FrozenInstanceError):
        numbers.pupil = 1.0


@pytest.mark.parametrize("d_3", [0.0, 40.0, 120.0])
def test_a_view_is_sharp_as_deep_as_an_ordinary_camera_of_its_f_number(d_3):
    """By the thin lens: at both ends of a view's depth of field the cone of that f-number is one pitch wide there."""
    design = PAPER.replace({"aperture.distance": d_3})
    camera = Camera.of(design)
    f, d_1 = float(camera.f), float(camera.seen.d_1)
    exit_pupil = d_3 * f / (d_3 - f) if d_3 else 0.0  # behind the lens
    cone = (d_1 - exit_pupil) / float(QUANTITIES["f_number_view"](camera))
    for end in depth_of_field(camera, "view"):
        image = 1 / (1 / f - 1 / float(end + camera.tip))
        assert abs(cone * (image - d_1) / (image - exit_pupil)) == pytest.approx(float(camera.d), rel=1e-9)
