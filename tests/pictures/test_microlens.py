"""Pictures of microlens images against their images one by one."""

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.bore.opening import ClearAperture
from roslf_design.camera import Camera
from roslf_design.imaging.camera import ImageLattice
from roslf_design.reporting.design.microlens import _images_over
from roslf_design.theory.exit_pupil import microlens_image_diameter


@pytest.mark.parametrize("fap", [1.0, 2.9, 20.0])
@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"microlens_array.layout": "hexagonal", "microlens_array.rotation": 0.03},
        {"microlens_array.size": (0.4, 0.4)},  # so few that images end
    ],
)
def test_images_over_a_place_are_counted_row_by_row(changes, fap):
    camera = Camera.of(roslf.load("paper").replace(changes, D_F=fap))
    lattice, half, radius = ImageLattice.of(camera), 0.05, float(microlens_image_diameter(camera)) / 2
    axis = np.linspace(-half, half, 41)
    points = np.stack(np.meshgrid(axis, axis), -1)
    truth = np.zeros((41, 41))
    for x, y in lattice.image(lattice.indices(-half, half, -half, half)):
        truth += np.hypot(points[..., 0] - x, points[..., 1] - y) <= radius
    np.testing.assert_array_equal(_images_over(lattice, ClearAperture(radius), points, half), truth)
