"""Lenses as made: each place against its first-order meaning, all together against the sum of squares."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from roslf_design.lenses.first_order import first_order
from roslf_design.lenses.lens_file import load_lens
from roslf_design.lenses.manufacture import as_made, lens_places, sensitivity, trials
from roslf_design.lenses.of_design import real_field
from roslf_design.lenses.prescription import LensError
from roslf_design.tolerance.places import expand

from .test_in_design import real

AXES = [(0.0, 0.0), (6.0, 0.0), (0.0, 6.0)]
LOOSE = {
    "surfaces.1.radius": 0.3,
    "surfaces.1.thickness": 0.1,
    "surfaces.1.index": 5e-4,
    "surfaces.2.radius": -0.3,
    "elements.1.decentre": 0.05,
    "elements.1.tilt": 1e-3,
}


def test_places_are_those_of_the_drawing():
    assert list(lens_places(load_lens("LA1050-A"))) == [
        "surfaces.1.radius",
        "surfaces.1.thickness",
        "surfaces.1.index",
        "elements.1.decentre",
        "elements.1.tilt",
    ]
    doublet = lens_places(load_lens("AC508-100-A"))
    assert "surfaces.3.radius" in doublet
    assert "surfaces.3.thickness" not in doublet
    assert sum(place.startswith("elements") for place in doublet) == 2


def test_unknown_places_name_the_known():
    with pytest.raises(LensError, match=r"surfaces.2.radius: is no place of LA1050-A .* there are surfaces.1.radius"):
        as_made(load_lens("LA1050-A"), "surfaces.2.radius", 0.1)


def test_focal_lengths_change_as_the_lensmaker_says():
    """A thin-ish plano-convex lens: f = R/(n - 1)."""
    lens = load_lens("LA1050-A")
    f, n = first_order(lens, 550e-6).focal_length, float(lens.surfaces[0].glass.index(550e-6))
    assert first_order(as_made(lens, "surfaces.1.radius", 0.5), 550e-6).focal_length == pytest.approx(
        f + 0.5 / (n - 1), rel=1e-12
    )
    assert first_order(as_made(lens, "surfaces.1.index", 1e-3), 550e-6).focal_length == pytest.approx(
        51.5 / (n + 1e-3 - 1), rel=1e-12
    )


def test_a_decentred_lens_moves_images_as_a_decentred_design():
    design = real()
    one = sensitivity(design, {"elements.1.decentre": 0.05}, AXES)["elements.1.decentre"]
    moved = real_field(design.replace({"main_lens.decentre": (0.05, 0.0)}), AXES).images.chief
    assert_allclose(one.shift, moved - real_field(design, AXES).images.chief, atol=1e-10)
    # The thin lens: h d_2/d_1 times d_3/f times the decentre.
    h = design.d_f / (design.d_f - design.d_3)
    assert one.shift[0, 0] == pytest.approx(0.05 * h * design.d_2 / design.d_1 * design.d_3 / design.f, rel=2e-3)


def test_many_builds_spread_as_the_sum_of_squares():
    design = real()
    single = sensitivity(design, LOOSE, AXES)
    builds = trials(design, LOOSE, AXES, 300, seed=3)
    wanted = np.sqrt(sum(np.square(one.shift / 2) for one in single.values()))
    spread = np.std(builds.shift, axis=0)
    # 300 builds tell a standard deviation to 4 %; three sigma of that.
    assert_allclose(spread[1, 0], wanted[1, 0], rtol=0.13)
    assert builds.whole.all()
    again = trials(design, LOOSE, AXES, 300, seed=3)
    assert np.array_equal(builds.shift, again.shift)
    assert not np.array_equal(builds.shift, trials(design, LOOSE, AXES, 300, seed=4).shift)


def test_studies_say_where_lens_errors_go():
    with pytest.raises(ValueError, match="studies take a real main lens as its thin twin"):
        expand(real().thin_twin, "main_lens.surfaces.1.radius")
