"""A light source in the tip: as even light that is set anew, by hand, for each distance."""

import math

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.depth.measure import simulate
from roslf_design.depth.pictures import PictureOptions
from roslf_design.evaluation.working_range import WorkingRange
from roslf_design.imaging.render import render
from roslf_design.imaging.trace import RaySampling
from roslf_design.scenes import Noise, Plane, Scene, Uniform
from roslf_design.theory.colours import filters
from roslf_design.theory.disparity_error import full_within, share_full
from roslf_design.theory.photometry import electrons, through_filter
from roslf_design.traced.fields import images_of

SCOPE = roslf.load("rigid-scope").replace({"light.exposure": 1e-3, "light.veil": 0.05})
STATED = 30.0
LIT = SCOPE.replace({"light.measured_at": STATED})
PAPER = roslf.load("paper")


def evenly(design, z):
    """The design in even light as strong as a source in its tip makes it z ahead of that."""
    lux = design.light.illuminance * (STATED / z) ** 2
    return design.replace({"light.measured_at": None, "light.illuminance": lux})


@pytest.mark.parametrize(
    "name", ["pixel_electrons", "sigma_z_mm", "u_z_mm", "sigma_disparity_pitches", "mtf50_lp_per_mm"]
)
@pytest.mark.parametrize("z", [12.0, 30.0, 60.0])
def test_numbers_at_a_distance_are_those_of_the_light_there(name, z):
    quantity = roslf.quantity(name)
    expected = float(quantity(Camera.of(evenly(LIT, z)), z))
    assert float(quantity(Camera.of(LIT), z)) == pytest.approx(expected, rel=1e-12)
    assert z == STATED or expected != pytest.approx(float(quantity(Camera.of(SCOPE), z)), rel=1e-3)
    several = quantity(Camera.of(LIT), np.array([z, 2 * z]))
    assert several[0] == pytest.approx(expected, rel=1e-9)


def test_the_focal_plane_has_its_own_light():
    focus = float(roslf.quantity("working_distance_mm")(Camera.of(LIT)))
    for name in ("pixel_electrons", "u_z_mm", "mtf50_lp_per_mm"):
        quantity = roslf.quantity(name)
        assert float(quantity(Camera.of(LIT))) == pytest.approx(
            float(quantity(Camera.of(evenly(LIT, focus)))), rel=1e-12
        )


@pytest.mark.parametrize("preset", ["rigid-scope", "paper-singlet"])
def test_contrast_on_a_veil_over_the_field(preset):
    """Ideal and traced: the MTF at a field, on a plane nearer than in focus."""
    design = roslf.load(preset).replace({"light.exposure": 1e-4, "light.veil": 0.1, "light.measured_at": STATED})
    z = 0.7 * float(roslf.quantity("working_distance_mm")(Camera.of(design)))
    own, even = (images_of(one, [(0.5, 0.2)]).transfer(0, z) for one in (design, evenly(design, z)))
    assert own.contrast == pytest.approx(even.contrast, rel=1e-12)
    assert own.contrast < 1


def test_each_colour_has_the_light_there():
    design = LIT.replace({"sensor.colours": "RGGB"})
    for one in filters("RGGB"):
        ours, by_hand = (through_filter(Camera.of(each), one) for each in (design, evenly(design, 50.0)))
        assert float(electrons(ours, 50.0)) == pytest.approx(float(electrons(by_hand)), rel=1e-12)


def test_builds_have_their_own_focal_planes():
    many = Camera.of(LIT, {"main_lens.focal_plane": np.array([25.0, 30.0, 40.0])})
    each = [
        float(electrons(Camera.of(LIT.replace({"main_lens.focal_plane": z, "d_1": None})))) for z in (25.0, 30.0, 40.0)
    ]
    np.testing.assert_allclose(electrons(many), each, rtol=1e-9)


def test_an_automatic_exposure_is_that_of_the_stated_distance():
    lit = LIT.replace({"light.exposure": None})
    assert float(electrons(Camera.of(lit), STATED)) == pytest.approx(0.5 * lit.sensor.full_well)
    assert float(electrons(Camera.of(lit), 2 * STATED)) == pytest.approx(0.125 * lit.sensor.full_well)


@pytest.mark.parametrize("wider", [1.0, 1.3])
def test_pixels_are_full_where_even_light_as_strong_leaves_half_of_the_field_without_depth(wider):
    """By halving; of images that overlap as well, whose light adds up."""
    design = LIT.replace({"aperture.diameter": wider * LIT.D_F})
    low, high = 1.0, 1000.0
    for _ in range(60):
        middle = math.sqrt(low * high)
        full = share_full(Camera.of(evenly(design, middle)))[1] > 0.5
        low, high = (middle, high) if full else (low, middle)
    assert full_within(Camera.of(design)) == pytest.approx(low, rel=1e-9)
    assert math.isinf(float(roslf.quantity("u_z_mm")(Camera.of(design), low / 2)))
    for near, within in ((1.01 * low, 0.0), (low / 1.01, math.inf)):  # in even light all distances are alike
        assert full_within(Camera.of(evenly(design, near))) == within


def test_the_working_range_begins_where_pixels_are_no_longer_full():
    lit = LIT.replace({"light.exposure": 4e-3})
    within, even = (WorkingRange.of(Camera.of(one)) for one in (lit, lit.replace({"light.measured_at": None})))
    assert within.near == even.near < within.full_within == within.ends[0]
    assert "nearer, more than half of the field has no depth, for full pixels" in within.remark
    answer = roslf.evaluate(lit, at=within.full_within / 2).answer
    assert answer.at[1].cells[2:4] == ("none", "pixels are full")
    assert answer.working_range_mm == within.ends


def test_the_working_range_of_a_focal_plane_whose_pixels_are_full():
    lit = LIT.replace({"light.exposure": 8e-3})
    within = WorkingRange.of(Camera.of(lit))
    assert within.full_within > float(roslf.quantity("working_distance_mm")(Camera.of(lit)))
    assert within.ends is None or within.ends[0] == within.full_within


@pytest.mark.parametrize("preset", ["paper", "paper-singlet"])
def test_walls_are_as_bright_as_their_distance_has_it(near_light, preset):
    """Against the picture in even light; the same rays, so that only single precision differs."""
    design = roslf.load(preset)
    tip, focus = float(Camera.of(design).tip), design.d_f
    for z in (300.0, 420.0):
        scene = Scene(objects=(Plane(distance=z, texture=Uniform()),))
        effects, fixed = ["none", "+object_defocus"], RaySampling(least=64, most=64)
        even, lit = (
            render(one, scene, region=(2200, 1500, 30, 20), overrides=effects, sampling=fixed).pixels
            for one in (design, design.replace({"light.measured_at": 150.0}))
        )
        assert even.max() > 0.5
        np.testing.assert_allclose(lit, even * ((focus - tip) / (z - tip)) ** 2, rtol=1e-5, atol=1e-6)


def test_depth_is_measured_in_that_light(near_light):
    """A wall before the focal plane: electrons by hand, and noise as predicted for the same even light."""
    lit, z = PAPER.replace({"light.measured_at": 150.0}), 300.0
    ahead = z - float(Camera.of(PAPER).tip)
    even = PAPER.replace({
        "light.exposure": roslf.evaluate(lit).depth.assumes.exposure_s,
        "light.illuminance": PAPER.light.illuminance * (150 / ahead) ** 2,
    })  # fmt: skip
    scene, options = (
        Scene(objects=(Plane(distance=z, texture=Noise(finest=0.4)),)),
        PictureOptions(region=(2200, 1500, 150, 150), rays=64),
    )
    own, by_hand = (simulate(one, scene, options) for one in (lit, even))
    assert own.electrons == pytest.approx(by_hand.electrons, rel=1e-6)
    np.testing.assert_allclose(own.prediction.depth, by_hand.prediction.depth, rtol=1e-6)
    np.testing.assert_allclose(own.first.sigma, by_hand.first.sigma, rtol=0.02)
