"""What full pixels take of the field is told as depth is measured, and continuously."""

import math
import re

import numpy as np
import pytest
from scipy import ndimage

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.depth.estimate import PixelNoise, estimate_disparity
from roslf_design.evaluation.specification import depth_light
from roslf_design.scenes import Noise
from roslf_design.theory.disparity_error import share_full
from roslf_design.theory.photometry import electrons, exposure, surely_held
from roslf_design.words import number
from tests.depth.made import disc, exposed

WELL, FINEST = 10_500.0, 3.2
"""Electrons; samples of a texture's tile a microlens, of which 8 are a period of its finest detail."""


@pytest.fixture(scope="module")
def design():
    matched = roslf.load("paper")
    return matched.replace({"aperture.diameter": 0.95 * matched.D_F, "sensor.full_well": WELL})


def lit_to(design, level):
    """The design exposed so that the scene's mean fills so much of the well."""
    camera = Camera.of(design)
    return design.replace({"light.exposure": float(exposure(camera)) * level * WELL / float(electrons(camera))})


def requiring(design, line):
    return roslf.loads(f"{roslf.dumps(design)}\n[required]\n{line}\n")


@pytest.fixture(scope="module")
def wall():
    """Views without noise of a texture of six octaves, whose mean is 1, and the pupil's."""
    tile = Noise(finest=1.0, contrast=0.1, seed=3).load()
    seen = ndimage.gaussian_filter(tile / tile.mean(), FINEST / math.sqrt(12), mode="wrap")
    seen = ndimage.spline_filter(seen, mode="grid-wrap")
    pupil, inside = disc(5)
    place = 100 + FINEST * np.arange(160)
    views = np.zeros((5, 5, 160, 160), np.float32)
    for t, s in np.argwhere(inside):
        at = np.meshgrid(place - FINEST * pupil[1, t, s], place - FINEST * pupil[0, t, s], indexing="ij")
        views[t, s] = ndimage.map_coordinates(seen, at, order=3, mode="grid-wrap", prefilter=False)
    return views, pupil, inside


@pytest.mark.parametrize("level", [0.6, 0.7, 0.8, 0.9])
def test_the_field_lost_to_full_pixels_is_what_depth_loses(design, wall, level):
    """Simulated walls: the share of full pixels within 0.03, of the field within 0.07 (one tile of coarse detail)."""
    views, pupil, inside = wall
    light = np.where(inside, 1.0, 0.0)[..., None, None]
    field = exposed(views, light, level * WELL, 2.5, 1, WELL)
    found = estimate_disparity(field, pupil, PixelNoise(level * WELL, 2.5, 0.98 * WELL), search=(-3, 3))
    told = share_full(Camera.of(lit_to(design, level)))
    assert told[0] == pytest.approx(float((views[inside] * level > 1).mean()), abs=0.03)
    assert told[1] == pytest.approx(1 - float(found.measured.mean()), abs=0.07)


@pytest.mark.parametrize(("room", "dark"), [(9_800.0, 8.0), (780.0, 120.0), (1e6, 0.0)])
def test_light_that_noise_may_fill_a_pixel_with_does_so_once_in_700(room, dark):
    """Three of its own standard deviations below; Poisson's skewness adds where electrons are few."""
    held = surely_held(room, dark)
    assert held + 3 * math.sqrt(held + dark) == pytest.approx(room, rel=1e-12)
    charges = np.random.default_rng(1).poisson(held, 2_000_000) + math.sqrt(dark) * (
        np.random.default_rng(2).standard_normal(2_000_000)
    )
    assert float((charges >= room).mean()) == pytest.approx(1 / 741, rel=0.4)
    assert PixelNoise(room, math.sqrt(dark), room).brightest == pytest.approx(held, rel=1e-12)


def test_warning_and_depth_as_required_follow_the_same_share_without_a_jump(design):
    asked = requiring(design, 'u_z_mm = {max = "50 mm"}')
    outcomes = []
    for level in np.linspace(0.5, 1.5, 21):
        lit = lit_to(asked, level)
        result, lost = roslf.evaluate(lit), share_full(Camera.of(lit))[1]
        (one,) = result.required
        told_of = [text for text in result.warnings if "of the field has no depth" in text]
        assert bool(told_of) is (lost > 0.05)
        assert all("over the whole sensor" in text for text in told_of)
        assert one.met is (lost <= 0.5)
        assert ("where pixels are not full" in one.only) is (0.05 < lost <= 0.5)
        ((_, told, why),) = (row for row in result.answer.rows if row[0].startswith("working range"))
        assert (told == "none") is (lost > 0.5)
        assert ("but more than half of the field has no depth, for full pixels, there" in why) is (lost > 0.5)
        assert "missed by -" not in one.verdict.text
        outcomes.append(lost)
    assert outcomes[0] < 0.01
    assert outcomes[-1] > 0.99
    assert (np.diff(outcomes) >= 0).all()
    assert np.diff(outcomes).max() < 0.3


def electrons_asked(design, low, level):
    lit = requiring(lit_to(design, level), f"pixel_electrons = {{min = {low}}}")
    (one,) = roslf.evaluate(lit).required
    return lit, one


def test_electrons_that_no_pixel_holds_are_not_as_required(design):
    lit, one = electrons_asked(design, 4000, 1.93)
    assert not one.met
    assert "the full well holds 10500" in one.verdict.text
    (time,) = re.findall(r'light.exposure = "([\d.]+) ms"', one.verdict.remedy)
    mended = lit.replace({"light.exposure": 1e-3 * float(time)})
    assert roslf.evaluate(mended).required[0].met
    assert not roslf.evaluate(mended).warnings
    _, beyond = electrons_asked(design, 20_000, 0.5)
    assert not beyond.met
    assert "larger sensor.full_well" in beyond.verdict.remedy


def test_too_few_electrons_ask_for_more_exposure_or_light_first(design):
    """Either of the two that the remedy names reaches what is required."""
    lit, one = electrons_asked(design, 4000, 0.1)
    assert not one.met
    assert one.remedy.startswith("light.exposure = ")
    assert "d_2" not in one.remedy
    ((time, light),) = re.findall(r'light.exposure = "(\S+) ms" or light.illuminance = "(\S+) lx"', one.remedy)
    for changes in ({"light.exposure": 1e-3 * float(time)}, {"light.illuminance": float(light)}):
        assert roslf.evaluate(lit.replace(changes)).required[0].met


@pytest.mark.parametrize("given", [True, False])
def test_what_the_remedy_of_electrons_names_gives_as_many(design, given):
    """Of too many as of too few: with the exposure that it names the limit is met, and met just so.

    Light is named beside it only where the exposure is given: one that follows the light would undo it.
    """
    base = lit_to(design, 0.4) if given else design
    held = float(electrons(Camera.of(base)))
    for limit in (f"min = {round(1.2 * held)}", f"max = {round(0.7 * held)}"):
        asked = requiring(base, f"pixel_electrons = {{{limit}}}")
        (one,) = roslf.evaluate(asked).required
        assert not one.met
        assert ("light.illuminance" in one.remedy) == given
        time = float(re.search(r'light.exposure = "(\S+) ms"', one.remedy)[1]) * 1e-3
        (mended,) = roslf.evaluate(asked.replace({"light.exposure": time})).required
        assert mended.met
        assert mended.value == pytest.approx(round((1.2 if "min" in limit else 0.7) * held), rel=1e-3)


def test_the_light_that_depth_rests_on_is_told_with_how_it_goes_with_distance():
    """Even light over a deep range is doubted by the square of its ends' ratio; one that falls says from where."""
    scope = roslf.load("rigid-scope")
    even = roslf.evaluate(scope).depth.assumes
    falls = roslf.evaluate(scope.replace({"light.measured_at": 30.0})).depth.assumes
    assert even.light == f"{scope.light.illuminance:,.0f} lx, reflectance {scope.light.reflectance:g}"
    assert even.light_at_distances == "as bright at every distance"
    assert falls.light_at_distances == "falls as 1/z² from 30 mm"
    for one in (even, falls):
        assert one.light in str(one)
        assert one.light_at_distances in str(one)
    tip, given = scope.replace({"light.measured_at": 30.0}), scope.replace({"depth.disparity_error": 0.1})

    def told(design, *ends):
        return depth_light(design, Camera.of(design), ends)

    assert "1/16 of the light" in told(scope, 10.0, 40.0)
    for words in (told(scope, 10.0, 29.0), told(tip, 10.0, 40.0)):
        assert "of the light" not in words
    assert told(given, 1.0, 9.0) == ""
    # The first screen has the same words beside its working range as the sheet, where light differs over it.
    for design, differs in ((scope, False), (tip, True)):
        answer = roslf.evaluate(design).answer
        ((_, _, remark),) = (row for row in answer.rows if row[0].startswith("working range"))
        assert answer.depth_light == told(design, *answer.working_range_mm)
        assert remark.endswith(answer.depth_light) is differs
        ms = number(1e3 * float(exposure(Camera.of(design))), 3)
        assert f"in {ms} ms" in answer.depth_light
