"""What the study of real pictures measures, against what was put in."""

import importlib.util
import json
import math
import re
import sys
from pathlib import Path

import numpy as np
import pytest
import tifffile

from roslf_design.depth.view_files import view_files
from tests.depth.made import Texture, field_of, sharp

FOLDER = Path(__file__).parents[2] / "studies" / "depth"


@pytest.fixture(scope="module")
def study():
    """Both files, as the script finds them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(FOLDER))
        spec = importlib.util.spec_from_file_location("published", FOLDER / "published.py")
        module = sys.modules["published"] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module


@pytest.mark.parametrize("share", [0.05, 0.12])
def test_a_mismatch_that_was_put_in_is_found(study, share, tmp_path):
    """Views of own mismatch in each pixel: disparities of two sets of them scatter as it says."""
    across, size = 6, (56, 56)
    t, s = np.meshgrid(*2 * [np.arange(across) - (across - 1) / 2], indexing="ij")
    pupil = np.stack([-s, -t]) / across
    views = sharp(Texture.of(3, 0.25), 1.5, pupil, np.ones((across, across), bool), size)
    noisy = views + share * np.median(views) * np.random.default_rng(1).standard_normal(views.shape)
    for name, content in view_files(field_of(noisy, np.ones_like(noisy, np.float32))).items():
        (tmp_path / name).write_bytes(content)
    seen = study.Scatter.of(study.LytroViews.of(tmp_path), study.SETS[0])
    # 84 windows of 5 x 5 stand beside each other, and their planes share some: 68 % of errors to 10 %.
    assert seen.share == pytest.approx(share, rel=0.15)
    assert 0.58 < seen.inside(share) < 0.78


def test_a_white_frame_tells_what_its_microlenses_and_pixels_differ_by(study, tmp_path):
    rng, pitch, size = np.random.default_rng(2), 15.4, 436
    at = np.arange(size) / pitch
    shape = np.cos(np.pi * (at - np.rint(at))) ** 2
    gain = 1 + 0.03 * rng.standard_normal((40, 40))
    own = np.rint(at).astype(int)
    frame = 30_000 * np.outer(shape, shape) * gain[np.ix_(own, own)] * (1 + 0.01 * rng.standard_normal((size, size)))
    dark = np.full((size, size), 100.0)
    for name, one in (("Radiometry", frame + dark), ("DarkFrame", dark)):
        tifffile.imwrite(tmp_path / f"{name}_GUVExperim1.tif", np.rint(one).astype(np.uint16))
    found = study.white_frame(tmp_path)
    # Of some 480 microlenses, each in second differences with four others: 3 % and 1 % to a fifteenth.
    assert found.lenses == pytest.approx(0.03, rel=0.1)
    assert found.typical == pytest.approx(0.03, rel=0.15)
    assert found.pixels == pytest.approx(0.01, rel=0.05)


def test_the_guide_and_the_readme_tell_the_numbers_that_were_written():
    root = FOLDER.parents[1]
    real = json.loads((root / "reports/depth-published/published.json").read_text())["real"]
    if real is None:
        pytest.skip("the report was written without the real pictures")
    rows = json.loads((root / "reports/instruments/instruments.json").read_text())["rows"]
    ratios = [row["ratio"] for row in rows if row["subject"] == "depth" and row["ratio"] is not None]
    met, words = sum(0.5 <= ratio <= 2 for ratio in ratios), {5: "five", 6: "six", 7: "seven", 8: "eight", 9: "nine"}
    guide, readme = (" ".join((root / name).read_text().split()) for name in ("docs/guides/depth.md", "README.md"))
    assert f"Of {words[len(ratios)]} figures that can be compared, {words[met]} are predicted" in guide
    assert f"{met} of {len(ratios)} depth figures are met" in readme
    spread = [one["rms_ratio"] for one in real["repeated"]]
    assert f"to {min(spread):.2f} to {max(spread):.2f} times the errors" in guide
    measured = {row["measured"]: row for row in rows}
    default, fitted, other = (measured[name]["ratio"] for name in ("lytro error", "lytro error, right", "board"))
    assert f"{default:.2f} of the error in a Lytro" in guide
    assert f"({fitted:.2f})" in guide
    assert f"{other:.2f} of that on another" in guide
    bound = measured["lytro error"]["predicted"] / default / real["bound"]
    assert f"the bound alone: {1 / bound:.2f}" in guide
    assert f"errs {bound:.1f} times as much" in readme
    assert re.search(rf"{1 / default:.1f} times what is expected by default, {1 / fitted:.2f} times once", readme)
    white = real["white_frame"]
    assert f"has {100 * math.hypot(white['lenses'], white['pixels']):.1f} %" in guide
    held_out = math.ceil(100 * max(abs(one["ratio"] - 1) for one in real["held_out"][:2]))
    theory, study = (
        " ".join((root / name).read_text().split())
        for name in ("docs/theory/equations.md", "studies/instruments/README.md")
    )
    assert f"mismatch predicts the other half to {held_out} %" in guide
    assert f"predicts the errors of the other half to {held_out} %, and {other:.1f} of those in another" in theory
    assert f"with all defaults ({default:.2f} of what is measured)" in study
    assert f"by the first one's mismatch ({other:.2f})" in study
    plane, aperture = (
        next(row["ratio"] for row in rows if row["figure"] == f"distance of the {name}, calibrated less built")
        for name in ("plane in focus", "aperture")
    )
    assert f"their standard deviations ({plane:.2f}, {aperture:.1f})" in study
    assert f"a published d_f is {1 / plane:.1f} of its expected errors off" in guide
