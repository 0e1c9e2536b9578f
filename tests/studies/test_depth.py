"""The study of depth by four cameras, on a few microlenses: what a forgotten bore costs, and what its README tells."""

from __future__ import annotations

import importlib.util
import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from roslf_design.camera import Camera
from roslf_design.depth.geometry import depth_of, disparity_of

FOLDER = Path(__file__).parents[2] / "studies" / "depth"
spec = importlib.util.spec_from_file_location("depth_study", FOLDER / "depth_study.py")
assert spec is not None
assert spec.loader is not None
study = importlib.util.module_from_spec(spec)
sys.modules[spec.name] = study
spec.loader.exec_module(study)


def test_a_forgotten_bore_bends_depth_as_the_formulas_say():
    case, wall = study.cases()["d_3 taken as 0"], study.scenes()["slanted wall"]
    # About ten microlenses in a row near the sensor's edge, where the wall is 5 mm behind the focal plane.
    found = study.measured(case, wall, (500, 1470, 140, 140), exposures=2, bins=1)
    z = np.array([np.nanmean(found.trial.true)])
    told = depth_of(Camera.of(case.believed), disparity_of(Camera.of(case.design), z))
    # Within a half: where on the FAP a pixel's light comes from, neighbours' included, is believed wrongly as well.
    assert abs(told - z) > 1
    assert found.bias == pytest.approx(told - z, rel=0.5)
    assert abs(found.bias[0]) > 3 * found.spread[0]


def test_the_readme_tells_the_numbers_that_were_written():
    told = json.loads((Path("reports") / "depth" / "depth.json").read_text())
    rows = re.findall(
        r"^\| (slanted wall|depth step) \| (.*?) \|(.*)\|$", (FOLDER / "README.md").read_text(), re.MULTILINE
    )
    assert len(rows) == sum(len(each) for each in told.values())
    for scene, camera, text in rows:
        summary, along = told[scene][camera]["summary"], told[scene][camera]["along_x"]
        worst = max(abs(value) for value in along["bias"] if value is not None)
        values = [summary[name] for name in ("bias_mm", "spread_mm", "predicted_mm")]
        wanted = [f"{100 * summary['measured']:.0f} %", *(f"{value:.2g}" for value in values), f"{worst:.2g}"]
        assert [cell.strip() for cell in text.split("|")] == wanted
