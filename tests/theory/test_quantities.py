"""The registry of quantities: what evaluate, tolerance studies and the optimiser share."""

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.theory.quantities import QUANTITIES, Quantity, quantity_named, register
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
    with pytest.raises(ValueError, match="already"):
        register(QUANTITIES["fill_factor"])
    with pytest.raises(ValueError, match="belongs to a field"):
        QUANTITIES["kept_fraction"](Camera.of(PAPER))


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


def test_a_new_quantity_is_one_entry():
    new = Quantity("f_over_d_mm", "", "f over the pitch", lambda c, _: np.asarray(c.f / c.d))
    assert float(new(Camera.of(PAPER))) == pytest.approx(100 / 0.063)
