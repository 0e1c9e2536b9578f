"""Rectangular stops and FAPs behind real lenses.

An ideal lens, traced, against exact clipping; a singlet against rays asked one by one and thousands of spokes.
"""

from __future__ import annotations

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.fates import ImageFate
from roslf_design.theory.stop_images import MicrolensImages
from roslf_design.traced.camera import camera_of, microlenses, views
from roslf_design.traced.fields import DesignImages
from roslf_design.traced.images import real_images, undistorted_field
from tests.traced.brute import lit_part

SQUARE = {"shape": "rectangle", "sides": (2.6, 2.6), "turn": 0.3, "distance": 120.0, "decentre": (0.2, -0.1)}
LONG = {"shape": "rectangle", "sides": (5.0, 3.2), "turn": -0.5, "distance": 60.0, "decentre": (0.5, 0.3)}
TILTED = {"shape": "rectangle", "sides": (3.1, 1.7), "turn": 1.0, "distance": 118.0, "tilt": (0.1, 0.2)}
ROUND = {"diameter": 2.9, "distance": 120.0}
FIELDS = ((0.0, 0.0), (2.0, 1.0), (4.0, 2.0), (11.15, 7.4))

BENCHES = {
    "square FAP": (SQUARE, ()),
    "both": (SQUARE, (LONG,)),
    "square FAP, round stop": (SQUARE, ({"diameter": 4.0, "distance": 70.0},)),
    "round FAP, long stop": (ROUND, (LONG,)),
    "slit": (ROUND, ({**LONG, "sides": (0.4, 20.0)},)),
}


def bench(name, aperture, stops):
    return roslf.load(name).replace({"aperture": aperture, "stops": list(stops)})


@pytest.mark.parametrize("case", BENCHES)
def test_an_ideal_lens_traced_shows_what_clipping_leaves(case):
    """Corners are found to some 5e-4 of a turn, which areas know by its square."""
    design = bench("paper", *BENCHES[case])
    traced, exact = DesignImages(design, FIELDS), MicrolensImages(Camera.of(design), FIELDS)
    ours, theirs = traced.traced, exact.shapes
    assert traced.diameter == pytest.approx(np.broadcast_to(exact.diameter, (4, 1)), rel=1e-9)
    assert traced.clearance == pytest.approx(np.broadcast_to(exact.clearance, (4, 1)), rel=1e-9, abs=1e-9)
    assert ours.kept_fraction == pytest.approx(theirs.kept_fraction[:, 0], abs=1e-6)
    assert ours.area == pytest.approx(theirs.area[:, 0], rel=1e-6, abs=1e-12)
    for k in np.flatnonzero(theirs.lit[:, 0]):
        size = np.sqrt(theirs.area[k, 0])
        assert ours.centroid[k] == pytest.approx(theirs.centroid[k, 0], abs=1e-6 * size)
        assert ours.axis_ratio[k] == pytest.approx(theirs.axis_ratio[k, 0], abs=2e-6)
    assert theirs.lit.sum() >= 2


CUT = {
    "square FAP": (SQUARE, (), (12.0, 7.4)),
    "both": (SQUARE, (LONG,), (2.0, 1.0)),
    "whole": (SQUARE, (), (6.0, 3.0)),
    "tilted FAP": (TILTED, (LONG,), (4.0, 2.0)),
    "slit": (ROUND, ({**LONG, "sides": (0.4, 20.0)},), (2.0, 1.0)),
    "dark": (SQUARE, ({**LONG, "decentre": (9.0, 9.0)},), (0.0, 0.0)),
}


@pytest.mark.parametrize("case", CUT)
def test_images_of_a_singlet_against_thousands_of_spokes(case):
    *stops, place = CUT[case]
    design = bench("paper-singlet", *stops)
    camera, at = camera_of(design), microlenses(design, np.array(place))
    image, (area, ratio, kept) = real_images(camera, at), lit_part(camera, at, points=6144)
    if case == "dark":
        assert image.status == ImageFate.DARK
        assert kept == 0
        return
    assert image.status == (ImageFate.FULL if case == "whole" else ImageFate.CLIPPED)
    assert image.kept_fraction == pytest.approx(kept, abs=3e-6)  # corners cost polygons 20/K^2
    assert image.area == pytest.approx(area, rel=3e-6)
    assert image.axis_ratio == pytest.approx(ratio, abs=3e-6)


@pytest.mark.parametrize("case", ["both", "tilted FAP"])
def test_rays_pass_the_sides_that_they_pass_by_hand(case):
    design = bench("paper-singlet", *CUT[case][:2])
    camera, c = camera_of(design), np.array(CUT[case][2])
    p = real_images(camera, c).chief + c + np.random.default_rng(1).uniform(-0.05, 0.05, (20_000, 2))
    told = views(camera, c, p)
    run = np.array([*(c - p).T, np.full(len(p), camera.array.z - camera.detector.z)])
    rays = camera.lens.at(design.wavelength).through(
        c[:, None] + np.zeros((2, 1)), run[:2] / run[2], start=camera.array.z, end=0.0, clip=True
    )
    held = rays.state == 0
    for part in design.all_stops:
        z = camera.first_order.front_principal - part.distance
        tx, ty = part.tilt
        x = np.array([np.cos(ty), 0.0, -np.sin(ty)])  # about x, then about y
        y = np.array([np.sin(ty) * np.sin(tx), np.cos(tx), np.cos(ty) * np.sin(tx)])
        start = np.array([*(rays.height - np.reshape(part.decentre, (2, 1))), np.full(len(p), -z)])
        way, normal = np.array([*rays.slope, np.ones(len(p))]), np.cross(x, y)
        hit = start - way * (normal @ start / (normal @ way))
        u, v = x @ hit, y @ hit
        a, b = (half / 2 for half in part.sides)
        cos, sin = np.cos(part.turn), np.sin(part.turn)
        held &= (np.abs(cos * u + sin * v) <= a) & (np.abs(cos * v - sin * u) <= b)
    assert 500 < held.sum() < 19_500
    assert np.array_equal(told.state == 0, held)


def test_the_measured_bound_of_a_square_is_where_images_begin_to_be_cut():
    design = bench("paper-singlet", {**SQUARE, "decentre": (0.0, 0.0)}, ())
    camera = camera_of(design)
    for angle in (0.0, 1.0):
        radius = float(undistorted_field(camera, angle).mla_radius)
        way = np.array([np.cos(angle), np.sin(angle)])
        assert real_images(camera, radius * (1 - 1e-6) * way).status == ImageFate.FULL
        assert real_images(camera, radius * (1 + 1e-4) * way).status == ImageFate.CLIPPED
