"""`import roslf_design as roslf`: what it offers, each with an example, and that it costs nothing until used."""

import doctest
import subprocess
import sys

import numpy as np
import pytest

import roslf_design as roslf

FUNCTIONS = ("calibrate", "decode", "evaluate", "load", "optimize", "quantity", "render", "report", "tolerance")


def test_importing_it_imports_nothing_heavy():
    code = "import sys, roslf_design; print([m for m in ('numpy', 'pydantic', 'numba', 'scipy') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("name", [n for n in roslf.__all__ if n != "__version__"])
def test_every_public_name_is_there_and_says_what_it_is(name):
    value = getattr(roslf, name)
    assert name in dir(roslf)
    assert value.__doc__
    if name in FUNCTIONS:
        assert "Examples" in value.__doc__ or name == "load"


def test_examples_run():
    from roslf_design import api

    # An array's digits are printed alike by every numpy that the project allows.
    assert doctest.testmod(api).failed == 0
    with pytest.raises(ValueError, match="did you mean 'fill_factor'"):
        roslf.quantity("fil_factor")


def test_a_sweep_is_a_camera_with_an_array():
    camera = roslf.Camera.of(roslf.load("paper"), {"d_3": np.linspace(0, 300, 61)})
    fill = roslf.quantity("fill_factor")(camera)
    assert fill.shape == (61,)
    assert fill[24] == pytest.approx(roslf.evaluate("paper").f_number.fill_factor, rel=1e-15)


def test_evaluate_takes_a_preset_a_path_or_a_design(tmp_path):
    path = tmp_path / "mine.toml"
    roslf.save(roslf.load("paper"), path)
    assert roslf.evaluate(path) == roslf.evaluate("paper") == roslf.evaluate(roslf.load("paper"))
    assert roslf.specification(path) == roslf.specification("paper")
    assert roslf.sweep(path, {"D_F": [2.0]}, ["fill_factor"]).values["fill_factor"].shape == (1,)


STUDY = """
name = "small"
design = "paper"
sobol_samples = 0
[[perturb]]
place = "aperture.diameter"
tolerance = "1 %"
[[goals]]
metric = "fill_factor"
max = 1.02
"""


def test_a_tolerance_study_runs_in_this_process(tmp_path):
    (tmp_path / "study.toml").write_text(STUDY)
    result = roslf.tolerance(tmp_path / "study.toml", trials=256, seed=3)
    assert 0 <= result.final.result.value <= 1
    assert result.to_dict()
