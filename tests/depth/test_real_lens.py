"""Depth behind a real main lens: views look where traced rays go, and a wall comes out where it stands."""

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.depth.geometry import depth_of, disparity_of
from roslf_design.depth.traced_views import TracedViews
from roslf_design.scenes import Noise, Plane, Scene
from roslf_design.theory.quantities import QUANTITIES
from roslf_design.traced.camera import camera_of, chief_slope, sensor_of_pupil, views

DISPARITY = 0.3


@pytest.fixture(scope="module")
def design():
    # No more microlenses than are looked at: where the light of each falls is traced beforehand.
    return roslf.load("paper-singlet").replace({"microlens_array.size": (8.0, 2.0)})


def met(design, place, pupil, z):
    """Where the ray of a sample that looks through a point of the FAP, by first order, meets the plane at Z [mm]."""
    mounted = camera_of(design)
    to_plane = mounted.fap.z - mounted.first_order.front_principal + z
    middle = sensor_of_pupil(mounted, place, mounted.fap.centre)
    away = chief_slope(mounted, place, mounted.fap.diameter * np.asarray(pupil)) - chief_slope(mounted, place, [0, 0])
    rays = views(mounted, place, middle.sensor + mounted.d_2 * away)
    assert rays.state == 0
    return rays.at(to_plane)


@pytest.mark.parametrize("field", [0.0, 3.0, 8.0])
def test_views_look_where_traced_rays_meet_the_scene(design, field):
    camera = Camera.of(design.thin_twin)
    place, points = np.array([field, 0.0]), 0.45 * np.array([[1.0, 0.0], [0.0, 1.0], [-0.6, 0.7]])
    (seen, aside), good = TracedViews(design, camera, lambda b: depth_of(camera, b)).view_coordinates(
        place[None], points
    )
    assert good.all()
    z = float(depth_of(camera, np.asarray(DISPARITY)))
    middle = met(design, place, np.zeros(2), z)
    for point, p, e in zip(points, seen[0], aside[0], strict=True):
        at = met(design, place + (DISPARITY * p + e) * design.d, point, z)
        # The pupil's own aberrations are those of the microlens that is moved from: next to the same.
        assert np.abs(at - middle).max() < 0.02 * float(QUANTITIES["object_sample_mm"](camera))


def test_a_wall_stands_where_it_is(design):
    # 3 mm off the axis astigmatism and field curvature move views by a pitch, several times the disparity.
    camera = Camera.of(design.thin_twin)
    z = float(depth_of(camera, np.asarray(DISPARITY)))
    texture = Noise(finest=5 * float(QUANTITIES["object_sample_mm"](camera)), contrast=0.2, seed=5)
    scene = Scene(objects=(Plane(distance=z, texture=texture),))
    width, height = camera.pixels
    region = (width // 2 - 65 + 620, height // 2 - 65, 130, 130)
    trial = roslf.measure_depth(design, scene, region=region, rays=100)
    first = trial.first
    assert first.measured.mean() > 0.8
    off = first.disparities.disparity[first.measured] - disparity_of(camera, np.array([z]))
    # As if of an ideal lens it would be off by half a pitch and more.
    assert abs(off.mean()) < 0.02
