"""What `roslf depth` says of a measurement: ticks for what holds, nothing judged from a few windows."""

from types import SimpleNamespace

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.depth.measure import Summary, assumed
from roslf_design.depth.pictures import default_scene
from roslf_design.reporting.depth.pages import _beside_evaluate, _percent, statements
from roslf_design.scenes import WHITE_FIELD


def measured(windows, spread=0.010, inside=0.68, bias=0.0, tail=0.0, runs=1):
    """The last three statements: off on the whole, as predicted, errors told; predicted and told are 10 um."""
    trial = SimpleNamespace(
        summary=lambda: Summary(bias, spread, 0.010, 0.010, inside, tail, 1.0),
        unknown=dict,
        compared=np.ones((25, windows), bool),
        runs=(None,) * runs,
        first=SimpleNamespace(
            disparities=SimpleNamespace(window=5), geometry=SimpleNamespace(unit="mm", place_unit="mm")
        ),
        saturated=0.0,
        aliased=0.0,
        edge=0.0,
        believed=None,
        raw=SimpleNamespace(design=None),
        scene=WHITE_FIELD,
        sphere=None,
        assumes=lambda: {"texture": "the scene's"},
    )
    return list(statements(trial))[-3:]


def said(windows, **faults):
    """Marks of these."""
    last = measured(windows, **faults)
    for statement in last:
        assert ("Cannot be judged here" in statement.remedy) == (statement.tone == "plain")
        assert (statement.tone == "good") == (statement.remedy == "")
    return [statement.tone for statement in last]


@pytest.mark.parametrize(
    ("windows", "faults", "tones"),
    [
        (100, {}, ["good", "good", "good"]),
        (3, {}, ["plain", "plain", "plain"]),
        # What three windows may show of a right estimator, and what they may not.
        (3, {"bias": 0.008, "spread": 0.0184, "inside": 0.32}, ["plain", "plain", "plain"]),
        (3, {"bias": 0.080, "spread": 0.0400, "inside": 0.03}, ["bad", "caution", "caution"]),
        (100, {"bias": 0.008, "spread": 0.0184, "inside": 0.32}, ["bad", "caution", "caution"]),
        # Most within, but some far out: no tick.
        (100, {"tail": 0.026}, ["good", "good", "caution"]),
        (100, {"spread": 0.0600, "inside": 0.70}, ["good", "caution", "caution"]),
        # Beyond the mark, but by chance at times: no tick, no fault.
        (40, {"spread": 0.0140, "inside": 0.55}, ["good", "plain", "plain"]),
    ],
)
def test_a_tick_stands_beside_what_holds_only(windows, faults, tones):
    assert said(windows, **faults) == tones


@pytest.mark.parametrize(
    ("faults", "words"),
    [
        ({"spread": 0.0600}, "believe 0.06 mm instead"),
        ({"spread": 0.0083}, "too small at some places, too large at others"),
        ({"spread": 0.0083, "runs": 2}, "what all exposures share"),
        ({"spread": 0.0060, "bias": 0.006}, "all are off by 0.006 mm together"),
    ],
)
def test_errors_that_depths_do_not_exceed_on_the_whole_are_not_called_too_small(faults, words):
    remedy = measured(100, inside=0.43, **faults)[-1].remedy
    assert words in remedy
    assert ("too small: for this scene believe" in remedy) == (faults["spread"] > 0.010)


def test_few_depths_far_beyond_their_errors_are_told_beside_the_tick_too():
    few, none = measured(100, tail=0.0028)[-1], measured(100)[-1]
    assert few.tone == none.tone == "good"
    assert "0.28 % are off by more than five times theirs" in few.text
    assert "five times" not in none.text


def test_the_wall_s_predicted_error_and_evaluate_s_bound_differ_by_their_textures():
    """Evaluate of the same texture says the same: detail of 2.5 microlenses, contrast against a part a tenth darker."""
    paper = roslf.load("paper")
    text = _beside_evaluate(paper, assumed(paper, default_scene(paper), 5, 0.45))
    sample = roslf.evaluate(paper).sampling.object_sample_mm
    alike = {"depth.finest": 2.5 * sample, "depth.contrast": 0.1 / 0.9}
    for design in (paper, paper.replace(alike)):
        assert f"{roslf.evaluate(design).depth.sigma_z_mm:.3g} mm" in text
    assert "(2.5 microlenses there) and 0.111 rms contrast" in text


def test_depth_expected_beside_simulated_exposures_is_that_of_evaluate_behind_a_real_lens():
    """It was the thin lens's, whose focus moves by the housing alone: no glass that warms with it."""
    warm = roslf.load("paper-singlet").replace({"environment": {"range": (-15.0, 55.0), "housing": "aluminium"}})
    text = _beside_evaluate(warm, assumed(warm, default_scene(warm), 5, 0.45))
    assert f"(u = {roslf.evaluate(warm).depth.expected['u_z_mm']:.3g} mm)" in text
    assert "temperature" in text


def test_shares_near_none_and_all_are_neither():
    shares = 0, 1e-6, 0.001, 0.5, 0.999, 1 - 1e-6, 1
    assert [*map(_percent, shares)] == ["none", "under 0.1 %", "0.1 %", "50 %", "99.9 %", "over 99.9 %", "100 %"]
