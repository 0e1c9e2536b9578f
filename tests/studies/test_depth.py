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
from roslf_design.theory.exit_pupil import microlens_image_pitch
from roslf_design.theory.image_parts import image_parts
from roslf_design.theory.light import microlens_defocus
from roslf_design.theory.stop_images import MicrolensImages

FOLDER = Path(__file__).parents[2] / "studies" / "depth"
spec = importlib.util.spec_from_file_location("depth_study", FOLDER / "depth_study.py")
assert spec is not None
assert spec.loader is not None
study = importlib.util.module_from_spec(spec)
sys.modules[spec.name] = study
spec.loader.exec_module(study)


def test_a_forgotten_bore_bends_depth_as_the_formulas_say(few_rays):
    case, wall = study.cases()["d_3 taken as 0"], study.scenes()["slanted wall"]
    # About ten microlenses in a row near the sensor's edge, where the wall is 5 mm behind the focal plane.
    found = study.measured(case, wall, (500, 1470, 140, 140), exposures=1, bins=1)
    true, believed = Camera.of(case.design), Camera.of(case.believed)
    z = np.array([np.nanmean(found.trial.true)])
    # Pixels believed to look through other places of the FAP, diffraction included, take disparity for less than it is.
    pixels = np.arange(-5, 6.0) / found.trial.first.field.pitch
    (where, aside, _), (taken, believed_aside, weight) = (places_of(camera, pixels) for camera in (true, believed))
    # The believed FAP is out of the microlenses' focus, so that views are believed to look past their middles.
    seen = disparity_of(true, z) * where + aside - believed_aside
    told = depth_of(believed, (weight * taken * seen).sum() / (weight * taken**2).sum())
    assert abs(told - z) > 1
    # The bias's own standard error is some 0.1 mm: some five windows stand side by side.
    assert found.bias == pytest.approx(told - z, abs=0.4)


def places_of(camera, pixels):
    """Where on the FAP the pixels' own light comes from along x, how far beside the microlens's middle, and weights.

    Defocus moves the FAP's rim over the image as the light's place on a square microlens moves, of variance 1/12.
    """
    parts = image_parts(MicrolensImages(camera, [(0.0, 0.0)]), pixels, pixels)
    own = parts.steps.index((0, 0))
    light = parts.light[own, 0]
    moved = microlens_defocus(camera) * camera.d / microlens_image_pitch(camera)
    aside = moved / 12 * np.gradient(light, pixels, axis=1) / light
    return parts.x[own, 0], aside, light**2 / parts.light[:, 0].sum(0)


def test_the_readme_tells_the_numbers_that_were_written():
    told = json.loads((Path("reports") / "depth" / "depth.json").read_text())
    rows = re.findall(
        r"^\| (slanted wall|depth step) \| (.*?) \|(.*)\|$", (FOLDER / "README.md").read_text(), re.MULTILINE
    )
    assert len(rows) == sum(len(each) for each in told.values())
    for scene, camera, text in rows:
        summary, along = told[scene][camera]["summary"], told[scene][camera]["along_x"]
        worst = max(abs(value) for value in along["bias"] if value is not None)
        values = [summary[name] for name in ("bias_mm", "spread_mm", "predicted_mm", "told_mm")]
        wanted = [f"{100 * summary['measured']:.0f} %", *(f"{value:.2g}" for value in values), f"{worst:.2g}"]
        assert [cell.strip() for cell in text.split("|")] == wanted
