"""The depth study in small: what scatters beside what is predicted, for the paper's camera in three lights."""

import pytest

from studies.depth.depth_proof import LARGEST, LIGHTS, TEXTURES, cases, judged, trials

SIDE = 15
"""Microlenses along each side: five by five stay away from the edges, which is one window."""


def test_errors_told_are_those_that_come():
    told = {}
    for light, trial in trials(cases()["matched"], TEXTURES["fine"], LIGHTS, side=SIDE, exposures=10, rays=64):
        told[light] = judged(trial)
    for light in ("bright", "dim"):
        one = told[light]
        assert one["known"] == 1
        # Ten exposures of one window or so: spread is known to a quarter, the mean to a third and what rays scatter.
        assert one["score_spread"] == pytest.approx(1.0, abs=0.5)
        assert abs(one["score_bias"]) < 1.0
        assert one["told"] < 1.8 * one["predicted"] / one["texture"]
    assert told["dark"]["predicted"] > LARGEST
    assert told["dark"]["known"] < 0.5
