"""The study of the paper's bench behind real lenses: its numbers by counting rays, and what its README tells."""

from __future__ import annotations

import importlib.util
import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from roslf_design.evaluation import evaluate
from roslf_design.reporting.design.field import _lens_curves
from roslf_design.traced.camera import camera_of, views

FOLDER = Path(__file__).parents[2] / "studies" / "paper-real-lens"
spec = importlib.util.spec_from_file_location("paper_real_lens_study", FOLDER / "real_lens.py")
assert spec is not None
assert spec.loader is not None
study = importlib.util.module_from_spec(spec)
sys.modules[spec.name] = study
spec.loader.exec_module(study)

CASES = study.designs()
FLAT, ROUND = "LA1050-A, plane side to the scene", "LB1630-A, bi-convex"


def counted(design, x, half_px=16.0, steps=400):
    """Area [px^2] of an image by counting rays on a grid of sensor points."""
    camera = camera_of(design)
    c = np.array([x, 0.0])
    side = (np.arange(steps) + 0.5) / steps * 2 - 1
    p = c - [0.065, 0.0] + half_px * design.q * np.stack(np.meshgrid(side, side), axis=-1)
    lit = views(camera, c, p).state == 0
    return np.sum(lit) * (2 * half_px / steps) ** 2


@pytest.mark.parametrize("label", [FLAT, ROUND])
def test_diameters_at_the_edge_by_counting_rays(label):
    design = CASES[label]
    area = counted(design, study.SEEN_EDGE)
    field = evaluate(design, [study.SEEN_EDGE]).real_lens.fields[0]
    # A grid of 1.6e5 points counts a disc of some 40 000 of them to about its rim over its area, below 0.1 %.
    assert np.pi / 4 * (field.diameter_mm / design.q) ** 2 == pytest.approx(area, rel=1e-3)


def test_the_shift_beyond_a_lattice_is_blind_to_scale():
    curves = _lens_curves(CASES[ROUND])
    stretched = curves._replace(shift_px=curves.shift_px + 0.3 * curves.x)
    assert study.beyond_linear(stretched) == pytest.approx(study.beyond_linear(curves), rel=1e-9)
    assert study.beyond_linear(curves._replace(shift_px=0.3 * curves.x)) == pytest.approx(0, abs=1e-12)


def test_the_readme_tells_the_numbers_that_were_written():
    found = json.loads((Path("reports") / "paper-real-lens" / "facts.json").read_text())
    rows = re.findall(r"^\| ((?:LA|LB|AC).*?) \|(.*)\|$", (FOLDER / "README.md").read_text(), re.MULTILINE)
    assert [label for label, _ in rows] == list(study.LENSES)
    for label, text in rows:
        bound, shift, rest, growth, overlap, corner = (cell.strip() for cell in text.split("|"))
        fact = found[label]
        edge = fact["edge"]
        assert bound == f"{fact['undistorted_to_mm']:.1f} mm"
        assert shift.endswith(f"{edge['shift_px']:.1f} px")
        assert rest == f"{edge['shift_beyond_linear_px']:.1f} px"
        assert growth == ("-" if edge["widening_percent"] is None else f"{edge['widening_percent']:.0f} %")
        assert overlap == ("-" if edge["overlap_px"] is None else f"{edge['overlap_px']:.1f} px")
        assert corner.split(",")[0] == {"full": "whole", "clipped": "cut", "dark": "dark"}[fact["corner"]["status"]]


def test_the_numbers_that_were_written_are_those_of_the_study():
    found = json.loads((Path("reports") / "paper-real-lens" / "facts.json").read_text())
    design = CASES[ROUND]
    again = study.facts(design, _lens_curves(design), evaluate(design))
    for key, value in again["edge"].items():
        assert found[ROUND]["edge"][key] == (pytest.approx(value, rel=1e-6) if isinstance(value, float) else value)


def test_what_manufacture_does_is_told_as_it_was_written():
    found = json.loads((Path("reports") / "paper-real-lens" / "as-made.json").read_text())
    growth = {place: [one["growth_left_percent"], one["growth_right_percent"]] for place, one in found.items()}
    decentred = growth.pop("elements.1.decentre.0")
    readme = (FOLDER / "README.md").read_text()
    assert f"by {decentred[0]:+.1f} % on one side and {decentred[1]:+.1f} % on" in readme
    assert max(abs(value) for pair in growth.values() for value in pair) == pytest.approx(1.5, abs=0.05)
    assert found == {
        place: {key: pytest.approx(value, abs=1e-6) for key, value in one.items()}
        for place, one in study.made(CASES[ROUND]).items()
    }
