"""A FAP behind a real main lens, as the scene sees it: against Snell's law at every surface, written here.

Light is sent forwards, in the plain sense of an entrance pupil behind the lens: along the straight line of the lens's
own air that would meet the pupil's point, if the lens were not in the way.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

import roslf_design as roslf
from roslf_design.traced.camera import microlenses
from roslf_design.traced.images import measured_bound, real_field
from tests.lenses.test_in_design import real

RIM = 64
FIELDS = [(0.0, 0.0), (6.0, 0.0), (8.0, -5.0), (-3.0, 7.0)]


class Snell:
    """A lens in air and what is about it, z from its first vertex; unit vectors, row by row."""

    def __init__(self, design):
        surfaces, waves = design.lens.surfaces, design.wavelength
        self.curved = np.array([surface.curvature for surface in surfaces])
        self.semi = np.array([surface.semi_diameter for surface in surfaces])
        self.index = np.array([1.0, *(float(surface.glass.index(waves)) for surface in surfaces)])
        self.vertex = np.cumsum([0.0, *(surface.thickness for surface in surfaces[:-1])])
        (a, b), (c, d) = self.paraxial()
        self.f, rear, front = -1 / c, self.vertex[-1] + (1 - a) / c, (d - 1) / c
        assert a * d - b * c == pytest.approx(1, rel=1e-12)
        self.pupil, self.radius = front - design.d_3, design.D_F / 2
        self.focus = front - design.d_f
        self.d_1, self.d_2, self.d_3 = 1 / (1 / self.f - 1 / design.d_f), design.d_2, design.d_3
        self.array, self.lost = rear + self.d_1, 1 - self.d_1 / self.f

    def paraxial(self):
        """Height and slope before the first vertex to those behind the last."""
        matrix = np.eye(2)
        for k, curvature in enumerate(self.curved):
            if k:
                matrix = np.array([[1, self.vertex[k] - self.vertex[k - 1]], [0, 1]]) @ matrix
            n, m = self.index[k : k + 2]
            matrix = np.array([[1, 0], [-(m - n) * curvature / m, n / m]]) @ matrix
        return matrix

    def sent(self, pupil, slope):
        """Where rays through points of the pupil (n, 2), of slopes (n, 2) before the lens, meet the array; their
        slopes there, and their squared heights on the surfaces over those of the rims, (n, S)."""
        way = np.concatenate([slope, np.ones((len(slope), 1))], 1)
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        at = np.concatenate([pupil, np.full((len(pupil), 1), self.pupil)], 1)
        heights = []
        for k, (vertex, curvature) in enumerate(zip(self.vertex, self.curved, strict=True)):
            at = at + way * ((vertex - at[:, 2:]) / way[:, 2:])  # the plane of the vertex, then the sphere
            off = at - [0.0, 0.0, vertex]
            lean = way[:, 2] - curvature * (off * way).sum(1)
            sag = curvature * (off**2).sum(1)
            at = at + way * (sag / (lean + np.sqrt(lean**2 - curvature * sag)))[:, None]
            normal = [0.0, 0.0, 1.0] - curvature * (at - [0.0, 0.0, vertex])
            heights.append((at[:, :2] ** 2).sum(1) / self.semi[k] ** 2)
            ratio = self.index[k] / self.index[k + 1]
            cosine = (normal * way).sum(1, keepdims=True)
            way = ratio * way + (np.sqrt(1 - ratio**2 * (1 - cosine**2)) - ratio * cosine) * normal
        out = way[:, :2] / way[:, 2:]
        return at[:, :2] + out * (self.array - at[:, 2:]), out, np.stack(heights, 1)

    def aimed(self, microlens, pupil):
        """Rays through points of the pupil (n, 2) that meet a microlens: images on the sensor about the microlens's
        axis, slopes before the lens, heights."""
        slope = 0.8 * (microlens - pupil * self.lost) / (self.d_1 + self.d_3 * self.lost)  # short of a thin lens's
        for _ in range(20):
            there = self.sent(pupil, slope)[0]
            columns = [(self.sent(pupil, slope + step)[0] - there) / 1e-6 for step in 1e-6 * np.eye(2)]
            slope = slope - np.linalg.solve(np.stack(columns, -1), (there - microlens)[..., None])[..., 0]
        there, out, heights = self.sent(pupil, slope)
        assert_allclose(there, np.broadcast_to(microlens, there.shape), atol=1e-12)
        return self.d_2 * out, slope, heights

    def rim(self, count=RIM):
        """Points of the pupil's rim."""
        turn = 2 * np.pi * np.arange(count) / count
        return self.radius * np.stack([np.cos(turn), np.sin(turn)], 1)

    def room(self, radius):
        """Least room on the surfaces for rays from the pupil's rim to a microlens at a height (in its meridian)."""
        return 1 - self.aimed(np.array([radius, 0.0]), self.radius * np.array([[1.0, 0.0], [-1.0, 0.0]]))[2].max()


def area_and_middle(points):
    """Area inside a smooth outline, and centroid, by its Fourier series."""
    z = points @ [1, 1j]
    orders = np.fft.fftfreq(len(z), 1 / len(z))
    rate = np.fft.ifft(1j * orders * np.fft.fft(z))
    (x, y), (dx, dy) = (z.real, z.imag), (rate.real, rate.imag)
    area = np.pi * np.mean(x * dy - y * dx)
    return area, 2 * np.pi / area * np.array([np.mean(x * x * dy), -np.mean(y * y * dx)]) / 2


SINGLET = roslf.load("paper-singlet").replace(d_3=-25.0, D_F=4.6)
DESIGNS = [SINGLET, real("LA1050-A").replace(d_3=-80.0, D_F=9.0), real("AC508-100-A").replace(d_3=-60.0, D_F=9.0)]


@pytest.mark.parametrize("design", DESIGNS, ids=lambda design: design.lens.name)
def test_images_and_object_points_are_where_snell_has_them(design):
    snell = Snell(design)
    found = real_field(design, FIELDS)
    for k, c in enumerate(microlenses(design, FIELDS)):
        chief, slope, _ = snell.aimed(c, np.zeros((1, 2)))
        assert_allclose(found.images.chief[k], chief[0], atol=1e-9)
        assert_allclose(found.maps.object_point[k], slope[0] * (snell.focus - snell.pupil), atol=1e-9)
        area, middle = area_and_middle(snell.aimed(c, snell.rim())[0])
        assert found.images.diameter[k] == pytest.approx(2 * math.sqrt(area / np.pi), abs=1e-9)
        assert_allclose(found.images.centroid[k], middle, atol=1e-9)


@pytest.mark.parametrize("design", DESIGNS[1:], ids=lambda design: design.lens.name)
def test_whole_images_end_where_snell_s_rays_touch_the_lens_s_rim(design):
    snell = Snell(design)
    at, edge = measured_bound(design)
    assert all(snell.room(share * edge) > 0 for share in (0.0, 0.3, 0.6, 0.9, 1 - 1e-8))
    assert snell.room(edge) == pytest.approx(0, abs=1e-9)
    _, slope, _ = snell.aimed(np.array([edge, 0.0]), np.zeros((1, 2)))
    assert at == pytest.approx(abs(slope[0, 0]) * (snell.pupil - snell.focus), rel=1e-9)
