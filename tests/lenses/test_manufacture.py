"""Lenses as made: each place against its first-order meaning, many builds against one at a time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from roslf_design.lenses.glass import find_glass
from roslf_design.lenses.lens_file import load_lens
from roslf_design.lenses.manufacture import abbe_number, as_made, lens_builds, lens_places, lens_values
from roslf_design.lenses.prescription import LensError, Prescription, Surface, first_order, surface_table
from roslf_design.lenses.tracer import COLUMNS
from roslf_design.traced.camera import camera_of, microlenses
from roslf_design.traced.images import real_field, real_images

from .test_in_design import real
from .test_prescription import missed

AXES = [(0.0, 0.0), (6.0, 0.0), (0.0, 6.0)]
GREEN = 550e-6


def test_places_are_those_of_the_drawing():
    singlet = lens_places(load_lens("LA1050-A"))
    assert singlet["surfaces.1.radius"] == "length"
    assert singlet["surfaces.1.index"] == singlet["surfaces.1.abbe"] == singlet["surfaces.1.conic"] == "number"
    assert singlet["surfaces.2.curvature"] == "curvature"
    assert "surfaces.2.radius" not in singlet  # a plane has none
    assert singlet["elements.1.wedge.1"] == "angle"
    doublet = lens_places(load_lens("AC508-100-A"))
    assert "surfaces.3.radius" in doublet
    assert "surfaces.3.thickness" not in doublet
    assert sum(place.startswith("elements") for place in doublet) == 6


def test_a_lens_as_drawn_stays_as_it_is():
    for name in ("LA1050-A", "AC508-100-A"):
        lens = load_lens(name)
        made = as_made(lens, lens_values(lens, GREEN), GREEN)
        assert_allclose(surface_table(made), surface_table(lens), atol=1e-15)


def test_focal_lengths_change_as_the_lensmaker_says():
    """A thin-ish plano-convex lens: f = R/(n - 1)."""
    lens = load_lens("LA1050-A")
    f, n = first_order(lens, GREEN).focal_length, float(lens.surfaces[0].glass.index(GREEN))
    focal = first_order(missed(lens, surfaces_1_radius=0.5), GREEN).focal_length
    assert focal == pytest.approx(f + 0.5 / (n - 1), rel=1e-12)
    focal = first_order(missed(lens, surfaces_1_index=1e-3), GREEN).focal_length
    assert focal == pytest.approx(51.5 / (n + 1e-3 - 1), rel=1e-12)


def test_abbe_numbers_turn_the_dispersion_about_the_d_line():
    glass = load_lens("LA1050-A").surfaces[0].glass
    assert abbe_number(glass) == pytest.approx(64.17, abs=0.005)  # as the glass's data sheet has it
    made = missed(load_lens("LA1050-A"), surfaces_1_abbe=1.0).surfaces[0].glass
    n_d = float(glass.index(587.5618e-6))
    change = float(made.index(GREEN) - glass.index(GREEN))
    assert change == pytest.approx(float(glass.index(GREEN) - n_d) * (64.17 / 65.17 - 1), rel=1e-4)


def test_wedges_bend_light_as_thin_prisms_do():
    """A ray on the axis of a weak wedge turns by (n - 1) times its angle, across the axis that it turns about."""
    plate = Prescription((Surface(0.0, 10.0, 2.0, find_glass("N-BK7")), Surface(0.0, 10.0)))
    made = missed(plate, elements_1_wedge_1=1e-4)
    n = float(plate.surfaces[0].glass.index(GREEN))
    bent = made.through((0.0, 0.0), (0.0, 0.0), GREEN, start=-1.0, end=2.0, backward=False)
    assert_allclose(bent.slope, [-(n - 1) * 1e-4, 0.0], rtol=1e-6, atol=1e-15)


def test_a_decentred_lens_moves_images_as_a_decentred_design():
    design = real()
    camera, c = camera_of(design), microlenses(design, AXES)
    made = replace(camera, lens=missed(camera.lens, elements_1_decentre_0=0.05))
    shift = real_images(made, c).chief - real_images(camera, c).chief
    moved = real_field(design.replace({"main_lens.decentre": (0.05, 0.0)}), AXES).images.chief
    assert_allclose(shift, moved - real_field(design, AXES).images.chief, atol=1e-10)
    # The thin lens: h d_2/d_1 times d_3/f times the decentre.
    h = design.d_f / (design.d_f - design.d_3)
    assert shift[0, 0] == pytest.approx(0.05 * h * design.d_2 / design.d_1 * design.d_3 / design.f, rel=2e-3)


@pytest.mark.parametrize("name", ["LA1050-A", "AC508-100-A"])
@pytest.mark.parametrize("drawn_askew", [False, True])
def test_many_builds_are_the_builds_one_by_one(name, drawn_askew):
    """Every place at once, also of a lens whose drawing is decentred and tilted already."""
    lens = load_lens(name)
    if drawn_askew:
        askew = {"decentre_0": 0.3, "decentre_1": -0.1, "tilt_0": 0.01, "tilt_1": -0.02}
        lens = missed(lens, **{f"elements_1_{what}": value for what, value in askew.items()})
    width = {"length": 0.05, "curvature": 1e-5, "angle": 3e-3, "number": 1e-3, "form": 1e-4}
    drawn, stream = lens_values(lens, GREEN), np.random.default_rng(1)
    values = {p: drawn[p] + width[kind] * stream.uniform(-1, 1, 5) for p, kind in lens_places(lens).items()}
    found = lens_builds(lens, GREEN, values, 5)
    assert found.sound.all()
    for trial in range(5):
        one = as_made(lens, {place: float(numbers[trial]) for place, numbers in values.items()}, GREEN)
        own, table = surface_table(one).reshape(-1, COLUMNS), found.table[trial].reshape(-1, COLUMNS)
        axes = [8, 9, 10, 11, 12, 13, 14, 15, 16]
        assert_allclose(table[:, :7], own[:, :7], rtol=1e-12, atol=1e-13)
        # A surface is round: what it is turned by about its own axis is nothing.
        assert_allclose(table[:, axes].reshape(-1, 3, 3)[:, :, 2], own[:, axes].reshape(-1, 3, 3)[:, :, 2], atol=1e-14)
        assert_allclose(table[:, 26:33], own[:, 26:33], rtol=1e-15)
        media = [float(surface.glass.index(GREEN)) for surface in one.surfaces]
        assert_allclose(found.media[trial, 1:], media, rtol=1e-14)
        constants = first_order(one, GREEN)
        assert found.front_principal[trial] == pytest.approx(constants.front_principal, rel=1e-11)


def test_builds_that_are_no_lenses_are_those_that_a_drawing_refuses():
    lens = load_lens("LB1630-A")
    values = {
        "surfaces.1.radius": np.array([101.38, -3.0, 20.0, 101.38, 101.38]),
        "surfaces.1.thickness": np.array([9.47, 9.47, 9.47, 3.0, -1.0]),
    }
    found = lens_builds(lens, GREEN, values, 5)
    for trial, sound in enumerate(found.sound):
        one = {place: float(numbers[trial]) for place, numbers in values.items()}
        if sound:
            as_made(lens, one, GREEN)
        else:
            with pytest.raises(LensError):
                as_made(lens, one, GREEN)
    assert list(found.sound) == [True, False, False, False, False]
