"""The paper's system, and the numbers that users of the evaluation may rely on, each to its last printed digit."""

from __future__ import annotations

import pytest

from roslf_design import theory
from tests.theory.designs import P1

D, D_F, F, D_FOCAL, D_1, D_2, D_3 = 50.8, 2.9, 100.0, 350.0, 140.0, 2.0, 120.0
PITCH, PIXEL, WAVE = 0.063, 0.004847826, 550e-6
TRIPLE = (F, D_FOCAL, D_3)
GAP = 230.0

PRINTED = {
    "aperture_constant": (theory.aperture_constant(D_FOCAL, D_3), "1.52174"),
    "inverse_aperture_constant": (theory.inverse_aperture_constant(D_FOCAL, D_3), "0.657143"),
    "exit pupil distance": (theory.exit_pupil_distance(F, D_3), "600.0"),
    "exit pupil vergence": (theory.exit_pupil_vergence(*TRIPLE), "-0.0021739"),
    "f-number, microlens": (theory.microlens_f_number(D_2, PITCH), "31.746"),
    "f-number, pupil": (theory.pupil_f_number(D_F, *TRIPLE), "31.724"),
    "f-number, main lens": (theory.main_lens_f_number(D, D_1), "2.7559"),
    "f-number, pupil at 20 mm": (theory.pupil_f_number(D_F, F, D_FOCAL, 20.0), "45.517"),
    "fill factor": (theory.fill_factor(D_F, PITCH, D_2, *TRIPLE), "1.00506"),
    "mismatch": (theory.matching_mismatch(D_F, PITCH, PIXEL, D_2, *TRIPLE), "0.0655"),
    "x0_max": (theory.nondistortion_bound(D, D_F, D_3, D_FOCAL, F, D_FOCAL).object_radius, "44.4542"),
    "x_ml_max": (theory.nondistortion_bound(D, D_F, D_3, D_FOCAL, F, D_FOCAL).mla_radius, "17.7817"),
    "image diameter": (theory.microlens_image_diameter(D_F, D_2, *TRIPLE), "0.0630435"),
    "image diameter in pixels": (theory.geometric_views(D_F, PIXEL, D_2, *TRIPLE), "13.0045"),
    "image pitch": (theory.microlens_image_pitch(PITCH, D_2, *TRIPLE), "0.0627261"),
    "centre shift": (theory.centre_shift_per_microlens(PITCH, PIXEL, D_2, *TRIPLE), "0.242152"),
    "centroid": (theory.stop_disc(D_F, D_3, (11.15, 0.0), D_2, F, D_FOCAL).centre[0] - 11.15, "-0.0484783"),
    "independent views": (theory.independent_views(PITCH, D_2, WAVE), "3.6"),
    "lateral samples": (theory.lateral_samples(22.3, PITCH), "354"),
    "object sample": (theory.object_sample(PITCH, F, D_FOCAL), "0.1575"),
    "view baseline": (theory.view_baseline(PIXEL, D_2, theory.effective_image_distance(*TRIPLE)), "0.223000"),
    "disparity rate": (theory.disparity_rate(GAP, D_F, PITCH, *TRIPLE), "0.080055"),
    "depth sigma": (theory.depth_sigma(0.1, GAP, D_F, PITCH, *TRIPLE), "1.2491"),
    "Fresnel number": (theory.fresnel_number(PITCH, D_2, WAVE), "0.902"),
    "Airy radius in pixels": (theory.airy_radius(PITCH, D_2, WAVE) / PIXEL, "4.394"),
    "Airy radius": (1e3 * theory.airy_radius(PITCH, D_2, WAVE), "21.3"),
    "blur width in pixels": (theory.diffraction_width(PITCH, D_2, WAVE) / PIXEL, "3.6"),
    "FAP diffraction in pitches": (theory.pupil_airy_radius(D_F, 92.0, WAVE) / PITCH, "0.34"),
    "microlens defocus": (
        theory.microlens_defocus_waves(2.0, D_2, theory.exit_pupil_vergence(*TRIPLE), PITCH, WAVE),
        "0.002",
    ),
    "defocus at Z_F = 200 mm": (theory.defocus_blur(200.0, D_F, PITCH, *TRIPLE), "2.8"),
}


@pytest.mark.parametrize("quantity", PRINTED)
def test_number_to_its_last_printed_digit(quantity):
    value, printed = PRINTED[quantity]
    digits = len(printed.partition(".")[2])
    assert f"{value:.{digits}f}" == printed


def test_disparity_at_the_focal_plane_is_what_a_step_of_a_millimetre_shows():
    """A step of 1 mm about the focal plane shows 0.080056: the derivative's 0.080055 and its third order."""
    near, far = theory.rim_disparity([GAP - 0.5, GAP + 0.5], D_F, PITCH, *TRIPLE)
    assert f"{near - far:.6f}" == "0.080056"
    assert near - far == pytest.approx(theory.disparity_rate(GAP, D_F, PITCH, *TRIPLE), rel=1e-5)


def test_the_paper_writes_equation_4_per_microlens():
    """Ten microlenses off axis, by the formula as printed with x the microlens index."""
    printed = PITCH * D_2 * D_3 * D_FOCAL / (PIXEL * D_1**2 * (D_FOCAL - D_3)) * 10
    assert theory.centre_deviation(10, PITCH, PIXEL, D_2, *TRIPLE) == pytest.approx(printed, rel=1e-15)


def test_equations_as_printed():
    """Eqs. 2, 3, 6, 8 and 12 in the paper's own symbols."""
    H = D_FOCAL / (D_FOCAL - D_3)
    A, m = D_1 / H, D_1 / D_FOCAL
    assert theory.pixel_to_pupil(3.0, PIXEL, D_2, A) == pytest.approx(-(1 / H) * (PIXEL * D_1 / D_2) * 3, rel=1e-15)
    assert theory.effective_image_distance_from_magnification(F, m, D_3) == pytest.approx(A, rel=1e-15)
    bound = theory.nondistortion_bound(D, D_F, D_3, D_FOCAL, F, D_FOCAL)
    assert bound.object_radius / D_FOCAL == pytest.approx(((D - D_F) / D_3 - D / D_FOCAL) / 2, rel=1e-14)
    slope = PIXEL * A / (PITCH * D_2) * (m - A / 80.0)
    assert theory.calibrated_epi_slope(80.0, A, m, PITCH, PIXEL, D_2) == pytest.approx(slope, rel=1e-14)
    assert theory.epi_slope(80.0, PITCH, PIXEL, D_2, *TRIPLE) == pytest.approx(slope, rel=1e-14)


def test_walks_and_paper_speak_of_the_same_system():
    assert (P1["focal_length"], P1["focal_plane_distance"], P1["pupil_distance"]) == TRIPLE
