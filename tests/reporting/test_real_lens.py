"""The report of a design with a real main lens: its own section, figures that show what was traced."""

from __future__ import annotations

import numpy as np
import pytest

from roslf_design.design import load
from roslf_design.evaluation import evaluate
from roslf_design.reporting.design import figures as sheets
from roslf_design.reporting.design.field import _lens_curves, _lens_image, lens_over_field
from roslf_design.traced.images import real_field

SINGLET = load("paper-singlet")
CONVEX_FIRST = SINGLET.replace({"main_lens.reversed": False})


def test_curves_are_the_traced_fields():
    curves = _lens_curves(SINGLET, 12)
    field = real_field(SINGLET, [(curves.x[7], 0.0)])
    assert curves.shift_px[7] == pytest.approx(field.shift[0, 0] / SINGLET.q)
    assert curves.diameter_px[7] == pytest.approx(float(field.images.diameter[0]) / SINGLET.q)
    picture = lens_over_field(SINGLET, curves)
    shown = [mark.y for mark in picture.marks]
    for line in (curves.shift_px, curves.diameter_px - curves.thin_diameter_px, curves.tangential, curves.sagittal):
        assert any(np.array_equal(line, y, equal_nan=True) for y in shown)
    assert "undistorted within" in {key.text for key in picture.keys}


def test_folded_and_dark_fields_are_told():
    curves = _lens_curves(CONVEX_FIRST, 20)
    assert curves.folded.any()
    assert np.isnan(curves.diameter_px[curves.folded]).all()
    assert "folded or dark" in {key.text for key in lens_over_field(CONVEX_FIRST, curves).keys}
    titles = [_lens_image(CONVEX_FIRST, place)[1] for place in ((0, 0), (11.15, 0), (11.15, 7.4))]
    assert titles == ["whole", "folded, 62.3 % unvignetted", "dark"]


def test_captions_of_fields_without_whole_images():
    result = evaluate(CONVEX_FIRST)
    over, seen = sheets.lens_sheets(CONVEX_FIRST, result, result.real_lens)
    assert "10.09 mm on the array" in over.caption
    assert "Outlines" in seen.caption
