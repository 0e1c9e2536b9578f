"""The report of a design with a real main lens: its own section, figures that show what was traced."""

from __future__ import annotations

import numpy as np
import pytest

from roslf_design.design import load
from roslf_design.evaluation import evaluate
from roslf_design.lenses.images import real_field
from roslf_design.report import sheets
from roslf_design.report.figures.real_lens import (
    lens_curves,
    plot_lens_foci,
    plot_lens_image,
    plot_lens_images_over_field,
)

SINGLET = load("paper-singlet")
CONVEX_FIRST = SINGLET.replace({"main_lens.reversed": False})


def test_curves_are_the_traced_fields():
    curves = lens_curves(SINGLET, 12)
    field = real_field(SINGLET, [(curves.x[7], 0.0)])
    assert curves.shift_px[7] == pytest.approx(field.shift[0, 0] / SINGLET.q)
    assert curves.diameter_px[7] == pytest.approx(float(field.images.diameter[0]) / SINGLET.q)
    lines = {line.get_label(): line.get_ydata() for line in plot_lens_images_over_field(SINGLET, curves=curves).lines}
    np.testing.assert_allclose(lines["image centre, shift"], curves.shift_px)
    np.testing.assert_allclose(lines["diameter, growth"][:9], curves.diameter_px[:9] - curves.thin_diameter_px)
    assert "undistorted within" in lines
    assert {"tangential focus", "sagittal focus", "lateral colour, F to C"} <= {
        line.get_label() for line in plot_lens_foci(SINGLET, curves=curves).lines
    }


def test_folded_and_dark_fields_are_told():
    curves = lens_curves(CONVEX_FIRST, 20)
    assert curves.folded.any()
    assert np.isnan(curves.diameter_px[curves.folded]).all()
    ax = plot_lens_images_over_field(CONVEX_FIRST, curves=curves)
    assert "folded or dark" in ax.get_legend_handles_labels()[1]
    titles = [plot_lens_image(CONVEX_FIRST, place).get_title() for place in ((0, 0), (11.15, 0), (11.15, 7.4))]
    assert titles == ["whole", "folded, 62.3 % kept", "dark"]


def test_captions_of_fields_without_whole_images():
    over, seen = sheets.lens_sheets(CONVEX_FIRST, evaluate(CONVEX_FIRST))
    assert "10.09 mm on the array" in over.caption
    assert "Outlines" in seen.caption
