"""Aberrations over the field: Coddington's equations, first-order colour, growth with the field, the measured Eq. 6."""

from __future__ import annotations

from copy import copy
from dataclasses import replace

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.evaluation.specification import specification
from roslf_design.fates import ImageFate, describe
from roslf_design.lenses.lens_file import load_lens
from roslf_design.lenses.prescription import Prescription, first_order
from roslf_design.theory.quantities import QUANTITIES
from roslf_design.tolerancing.metrics import Question, evaluate_builds
from roslf_design.tolerancing.traced import as_built
from roslf_design.traced.camera import camera_of, microlenses, sensor_of_pupil
from roslf_design.traced.fields import DesignImages, IdealImages, images_of
from roslf_design.traced.images import field_map, real_images, thin_twin, undistorted_field
from roslf_design.traced.outlines import circle
from tests.traced.test_images import GREEN, bench, mounted

EDGE = 11.15


def coddington(camera, point):
    """Astigmatic foci behind the array of the pencil along the chief ray from `point` (its x, on the focal plane).

    Meridional section of a lens of spheres, surface by surface: s and t are distances along the chief ray from the
    surface to the sagittal and tangential focus, minus before it.
    """
    lens = camera.lens
    z, x, angle = camera.focal_plane, point, np.arctan2(-point, camera.fap.z - camera.focal_plane)
    indices = [1.0, *(float(surface.glass.index(camera.wavelength)) for surface in lens.surfaces)]
    s = t = None
    for number, (surface, vertex) in enumerate(zip(lens.surfaces, lens.vertices, strict=True)):
        n, m = indices[number : number + 2]
        c = surface.curvature
        # where the ray (z, x) + l (cos, sin) meets the circle: by its foot point next to the vertex
        dz, dx = np.cos(angle), np.sin(angle)
        qz, qx = z - vertex, x
        b = dz - c * (qz * dz + qx * dx)
        e = c * (qz * qz + qx * qx) - 2 * qz
        step = e / (b + np.sqrt(b * b - c * e))
        z, x = z + step * dz, x + step * dx
        s = -step if s is None else s - step
        t = -step if t is None else t - step
        normal = np.arcsin(-c * x)  # direction of the normal from the axis
        incidence = angle - normal
        refracted = np.arcsin(n / m * np.sin(incidence))
        oblique = c * (m * np.cos(refracted) - n * np.cos(incidence))
        s = m / (n / s + oblique)
        t = m * np.cos(refracted) ** 2 / (n * np.cos(incidence) ** 2 / t + oblique)
        angle = normal + refracted
    to_array = (camera.array.z - z) / np.cos(angle)
    return (t - to_array) * np.cos(angle), (s - to_array) * np.cos(angle)


@pytest.mark.parametrize(("name", "reverse"), [("la1050-a", True), ("ac508-100-a", True)])
def test_foci_are_coddingtons(name, reverse):
    camera = bench(name, reverse=reverse)
    fields = np.array([[1.0, 0.0], [6.0, 0.0], [EDGE, 0.0]])
    found = field_map(camera, fields)
    for row in range(3):
        tangential, sagittal = coddington(camera, found.object_point[row, 0])
        # the pencil is a thousandth of the FAP wide: its own aberration is a millionth of the blur
        assert found.tangential_focus[row] == pytest.approx(tangential, rel=2e-6, abs=2e-5)
        assert found.sagittal_focus[row] == pytest.approx(sagittal, rel=2e-6, abs=2e-5)


def test_aberrations_grow_with_the_square_of_the_field():
    camera = bench("ac508-100-a")
    near, twice = (field_map(camera, [x, 0.0]) for x in (0.4, 0.8))
    for name in ("distortion", "tangential_focus", "sagittal_focus"):
        assert getattr(twice, name) / getattr(near, name) == pytest.approx(4.0, rel=0.02), name
    axis = field_map(camera, [0.0, 0.0])
    assert abs(axis.distortion) + abs(axis.tangential_focus) + abs(axis.sagittal_focus) < 1e-4
    np.testing.assert_allclose(axis.object_point, 0, atol=1e-9)


def test_the_map_turns_with_the_field():
    camera = bench("lb1630-a")
    along, turned = (field_map(camera, c, [486e-6]) for c in ([9.0, 0.0], [0.0, -9.0]))
    for name in ("distortion", "tangential_focus", "sagittal_focus", "spread"):
        np.testing.assert_allclose(getattr(turned, name), getattr(along, name), rtol=1e-7, err_msg=name)
    np.testing.assert_allclose(turned.lateral_colour[0, 1], -along.lateral_colour[0, 0], rtol=1e-9)
    np.testing.assert_allclose(turned.object_point[1], -along.object_point[0], rtol=1e-10)


def test_lateral_colour_of_small_fields_is_first_orders():
    camera = bench("la1050-a", reverse=True)
    colours = np.array([486.1e-6, GREEN, 656.3e-6])
    c = 0.05
    found = field_map(camera, [c, 0.0], colours)
    x = found.object_point[0]
    heights = []
    for colour in colours:
        (a, b), (p, q) = first_order(camera.lens, colour).matrix
        slope = -x / (camera.fap.z - camera.focal_plane)
        front = -slope * camera.fap.z
        out, way = a * front + b * slope, p * front + q * slope
        heights.append(out + way * (camera.array.z - camera.lens.length))
    np.testing.assert_allclose(found.lateral_colour[:, 0], np.array(heights) - heights[1], rtol=0, atol=1e-7)
    assert found.lateral_colour[1, 0] == 0
    np.testing.assert_array_equal(found.lateral_colour[:, 1], 0)


def test_blur_of_a_displaced_array_is_the_cones_width():
    camera = bench("ac508-100-a", scale=0.1)  # a FAP so small that spherical aberration is a millionth of the slopes
    # a disc of 5 mm times the pencil's angle; either side of focus, so that spherical aberration adds and subtracts
    width = 5.0 * camera.fap.diameter * camera.d_f / (camera.d_1 * (camera.d_f - camera.d_3))
    parts = {"array": camera.array, "detector": camera.detector}
    sides = [replace(camera, **{k: replace(p, z=p.z + step) for k, p in parts.items()}) for step in (5.0, -5.0)]
    found = [field_map(side, [0.0, 0.0]) for side in sides]
    assert (found[0].blur + found[1].blur) / 2 == pytest.approx(width / np.sqrt(8), rel=1e-5)
    np.testing.assert_allclose((found[0].spread + found[1].spread) / 2, width, rtol=1e-5)


def test_singlets_cost_pitches_and_percents():
    """Known from that bench: 7-17 pitches of blur, 5-12 % of distortion, some 5 pitches of colour."""
    pitch = 0.063
    for name, reverse in (("lb1630-a", False), ("la1050-a", True)):
        found = field_map(bench(name, reverse=reverse), [EDGE, 0.0], [486.1e-6, 656.3e-6])
        assert 7 < found.spread[0] / pitch < 17
        assert 0.05 < abs(found.distortion) < 0.12
        assert 5 < np.ptp(found.lateral_colour[:, 0]) / pitch < 7


def equation_6(camera):
    """Undistorted radius of the thin-lens model as the paper prints it, on the array."""
    c = thin_twin(camera)
    d_f, d_3, D_F = c["main_lens.focal_plane"], c["aperture.distance"], c["aperture.diameter"]
    return ((c.D - D_F) / d_3 - c.D / d_f) / 2 * c.f * d_f / (d_f - c.f)


@pytest.mark.parametrize(("name", "reverse"), [("la1050-a", True), ("ac508-150-a", False)])
def test_measured_bound_is_where_images_begin_to_be_cut(name, reverse):
    camera = bench(name, reverse=reverse)
    bound = undistorted_field(camera)
    radius = float(bound.mla_radius)
    assert real_images(camera, [radius * (1 - 1e-6), 0.0]).status == ImageFate.FULL
    assert real_images(camera, [radius * (1 + 1e-4), 0.0]).status == ImageFate.CLIPPED
    chief = sensor_of_pupil(camera, [radius, 0.0], [0.0, 0.0])
    assert float(bound.object_radius) == pytest.approx(
        abs(chief.views.at(camera.fap.z - camera.focal_plane)[0]), rel=1e-12
    )
    thin = equation_6(camera)
    assert 0.7 * thin < radius < thin
    shifted = replace(camera, rims=(replace(camera.fap, x=1.0),))  # the worse for it, along its own direction
    assert undistorted_field(shifted).mla_radius < radius
    assert undistorted_field(bench("ac254-100-a", pupil=30.0)) == (0.0, 0.0)  # even the axis is cut


def test_measured_bound_tends_to_equation_six():
    ratios = []
    for semi in (4.0, 2.0, 1.0):
        lens = load_lens("AC508-150-A")
        small = Prescription(tuple(replace(s, semi_diameter=semi) for s in lens.surfaces), "small")
        camera = mounted(small, semi / 20, focal_plane=500.0)
        ratios.append(float(undistorted_field(camera).mla_radius / equation_6(camera)))
    # what remains is the lens's thickness: its two rims stand on either side of the principal planes, which is first
    # order; take it out by the same bound for a rim at the last vertex, the nearest to the array
    assert abs(ratios[2] - ratios[1]) < 0.3 * abs(ratios[1] - ratios[0])
    assert abs(ratios[2] - 1) < 0.07


def test_dark_fields_say_why_and_hold_no_nan():
    camera = bench("la1050-a")
    found = field_map(camera, [[11.15, 8.0], [0.0, 0.0], [40.0, 0.0]], [486e-6])
    assert found.status[1] == 0
    for row in (0, 2):
        assert describe(int(found.status[row])) != "kept"
        assert found.blur[row] == found.tangential_focus[row] == 0
    for values in found:
        assert np.isfinite(values).all()


def by_snell(camera, at, way):
    """Rays from points along unit vectors, both (3, n), to the array: points, unit vectors, optical paths."""
    indices = [1.0, *(float(surface.glass.index(camera.wavelength)) for surface in camera.lens.surfaces)]
    path = np.zeros(way.shape[1])
    for number, (surface, vertex) in enumerate(zip(camera.lens.surfaces, camera.lens.vertices, strict=True)):
        c, apart = surface.curvature, at - np.array([[0.0], [0.0], [vertex]])
        b, e = way[2] - c * np.sum(apart * way, axis=0), c * np.sum(apart**2, axis=0) - 2 * apart[2]
        step = e / (b + np.sqrt(b * b - c * e))
        at, path = at + step * way, path + indices[number] * step
        normal = np.array([[0.0], [0.0], [1.0]]) - c * (at - np.array([[0.0], [0.0], [vertex]]))
        share, inner = indices[number] / indices[number + 1], np.sum(normal * way, axis=0)
        way = share * way + (np.sqrt(1 - share**2 * (1 - inner**2)) - share * inner) * normal
    step = (camera.array.z - at[2]) / way[2]
    return at + step * way, way, path + step


def light_from_the_scene(camera, place, rings=6, spokes=12):
    """What a place on the array gets of a uniform scene, counted where the light enters: over the FAP, by Snell's law.

    Energy is kept, so the power that leaves a patch of the FAP into directions (p, q), its cosines, is what arrives:
    irradiance is the integral over the FAP of d(p, q)/d(x, y). The code takes the microlens's side.
    """

    def arrive(start, cosines):
        return by_snell(camera, start, np.stack([*cosines, np.sqrt(1 - np.sum(cosines**2, axis=0))]))[0][:2]

    nodes, weights = np.polynomial.legendre.leggauss(rings)
    radius, turn = camera.fap.diameter / 2 * np.sqrt((nodes + 1) / 2), 2 * np.pi * np.arange(spokes) / spokes
    x, y = np.outer(radius, np.cos(turn)).ravel(), np.outer(radius, np.sin(turn)).ravel()
    start, cosines, h = np.stack([x, y, np.full(x.shape, camera.fap.z)]), np.zeros((2, x.size)), 1e-5
    for _ in range(9):
        ways = [arrive(start, cosines + d) - arrive(start, cosines - d) for d in h * np.eye(2)[:, :, None]]
        jacobian = np.moveaxis(np.stack(ways, axis=1) / (2 * h), -1, 0)
        off = (arrive(start, cosines) - np.reshape(place, (2, 1))).T[..., None]
        cosines = cosines - np.linalg.solve(jacobian, off)[..., 0].T
    assert np.max(np.abs(off)) < 1e-10
    return np.sum(np.repeat(weights, spokes) / np.abs(np.linalg.det(jacobian)))


def test_light_over_the_field_is_what_enters_the_bore():
    design, fields = roslf.load("paper-singlet"), ((0.0, 0.0), (6.0, 0.0), (8.0, 5.0), (EDGE, 0.0))
    light = [light_from_the_scene(camera_of(design), field) for field in fields]
    found = QUANTITIES["relative_illumination"].at_fields(images_of(design, fields))[:, 0]
    assert found == pytest.approx(np.array(light) / light[0], rel=2e-8)  # derivatives' steps in the reference
    assert found[2] == pytest.approx(1.268, abs=5e-4)  # the ideal lens's is 0.979


def test_builds_are_lit_and_drawn_as_each_is_alone():
    """Cut, out of the lens's sight, tilted: polynomials and spokes are right to 1e-3 of the FAP there."""
    design, fields = roslf.load("paper-singlet"), ((0.0, 0.0), (8.0, 5.0), (11.15, 7.4))
    names = ("relative_illumination", "distortion_percent", "local_magnification")
    values = {
        "microlens_array.tilt.1": np.array([0.0, 0.03]),
        "sensor.tilt.0": np.array([0.0, 0.05]),
        "main_lens.decentre.0": np.array([0.0, 0.5]),
        "main_lens.surfaces.2.radius": np.array([-51.5, -51.2]),
    }
    found = evaluate_builds(Question(design, names, fields, 350.0), values, 2).reshape(3, 3, 2)
    for build in (0, 1):
        alone = as_built(design, {place: float(numbers[build]) for place, numbers in values.items()})
        images = images_of(alone, fields)
        for row, (name, off) in enumerate(zip(names, (2e-3, 2e-4, 2e-5), strict=True)):
            ours = np.array(QUANTITIES[name].at_fields(images))[:, 0]
            theirs = found[row, :, build]
            if row == 0:  # against the middle: the study takes the axis where the nominal lens has it
                ours, theirs = ours / ours[0], theirs / theirs[0]
            assert theirs == pytest.approx(ours, rel=off, abs=off), name


def test_chief_rays_of_images_are_those_of_rays_aimed_one_by_one():
    """Of a turned and decentred array behind a decentred lens, whose far corner it does not show."""
    turned = {"microlens_array.rotation": 0.3, "microlens_array.decentre": (0.2, -0.1)}
    design = roslf.load("paper-singlet").replace(
        {**turned, "main_lens.decentre": (0.4, 0.1), "aperture.tilt": (0.02, 0.0)}
    )
    fields = np.array([(3.0, 1.0), (11.0, -6.0), (30.0, 20.0)])
    camera, images = camera_of(design), images_of(design, fields)
    chief = sensor_of_pupil(camera, microlenses(design, fields), camera.fap.centre)
    assert chief.ok.tolist() == [True, True, False]
    for ahead in (150.0, 230.0):
        told = chief.views.at(camera.fap.z - camera.first_order.front_principal + images.camera.tip + ahead)
        told = np.where(chief.ok[:, None], told + design.main_lens.decentre, np.nan)
        assert np.stack(images.on_plane(ahead), axis=-1)[:, 0] == pytest.approx(told, abs=1e-9, nan_ok=True)
    assert images.directions[:2, 0, :2] / images.directions[:2, 0, 2:] == pytest.approx(
        -chief.views.slope[:2], abs=1e-12
    )
    assert np.isnan(images.directions[2]).all()


def test_an_ideal_lens_traced_shows_the_detail_that_formulas_say():
    design, fields = roslf.load("paper"), ((0.0, 0.0), (8.0, 5.0))
    traced, thin = DesignImages(design, fields), IdealImages(roslf.Camera.of(design), fields)
    for at, field in ((None, 1), (200.0, 0), (200.0, 1), (330.0, 1)):
        ours, theirs = (images.transfer(field, at) for images in (traced, thin))
        finest, plane = (np.min(image.limits_each_way((0.5,), "refocused")) for image in (ours, theirs))
        assert finest > (1 - 1e-3) * plane  # of all slopes, of which the plane's is one
        ours = replace(ours, rate=theirs.rate)
        detail = np.linspace(0.0, 1.2 * theirs.fold("tangential"), 6)
        for kind in ("view", "refocused"):
            for way in ("tangential", "sagittal"):
                # the image's outline has 96 corners, sums are right to 1e-3
                assert ours(detail, kind, way) == pytest.approx(theirs(detail, kind, way), abs=2e-3), (at, kind, way)


class Waves:
    """A point of the focal plane, by waves: its optical paths through the lens to the array, beside one microlens.

    The wave at the array is a sum over directions, of phases ``path - direction . place``; neighbours of the microlens
    light its pixel as well. Radius of the field along x.
    """

    def __init__(self, camera, place, point, span, step):
        disc = np.concatenate([[[0.0, 0.0]], *(r * circle(24) for r in np.sqrt(np.linspace(0.05, 1.0, 10)))]).T
        wanted = np.stack([*(camera.fap.diameter / 2 * disc), np.full(disc.shape[1], camera.fap.z)])
        start = np.array([[point[0]], [point[1]], [camera.focal_plane]])
        way = (wanted - start) / np.linalg.norm(wanted - start, axis=0)
        at, way, path = by_snell(camera, start, way)
        phase, self.middle = path - np.sum(way[:2] * (at[:2] - np.reshape(place, (2, 1))), axis=0), way[:, 0]
        off = way[:2] - way[:2, :1]
        size = float(np.abs(off).max())
        powers = [(a, b) for a in range(10) for b in range(10 - a)]
        products = np.stack([(off[0] / size) ** a * (off[1] / size) ** b for a, b in powers], axis=-1)
        terms = np.linalg.lstsq(products, phase - phase[0], rcond=None)[0]
        assert np.abs(products @ terms - phase + phase[0]).max() < 1e-3 * camera.wavelength
        rim = off[:, -24:]
        count = int(2.5 * span * np.ptp(rim[0]) / camera.wavelength)  # no copies within the span
        self.x, self.y = (np.linspace(row.min(), row.max(), count) for row in rim)
        grid = np.stack(np.meshgrid(self.x, self.y, indexing="ij"))
        turns = np.arctan2(*rim[::-1])
        order = np.argsort(turns)
        edge = np.interp(np.arctan2(*grid[::-1]), turns[order], np.hypot(*rim)[order], period=2 * np.pi)
        inside = np.clip((edge - np.hypot(*grid)) / (self.x[1] - self.x[0]) + 0.5, 0.0, 1.0)
        wave = sum(t * (grid[0] / size) ** a * (grid[1] / size) ** b for t, (a, b) in zip(terms, powers, strict=True))
        self.k = 2 * np.pi / camera.wavelength
        self.spectrum, self.places = inside * np.exp(1j * self.k * wave), np.arange(-span, span, step)

    def light(self, x, y):
        """Over places, for what each direction along x and y becomes there."""
        return np.abs(x @ self.spectrum @ y.T) ** 2

    def on_array(self, ahead=0.0):
        """On the array, or so far behind it: there the microlenses' images of the FAP, each moved as far, bring it."""
        seen = replaced(self, spectrum=self.spectrum * np.exp(1j * self.k * ahead * self.along))
        return seen.light(*(np.exp(1j * self.k * np.outer(self.places, way)) for way in (self.x, self.y)))

    @property
    def along(self):
        """Cosines to the axis, without what merely moves all of the light."""
        x, y = self.x[:, None] + self.middle[0], self.y + self.middle[1]
        return np.sqrt(1 - x**2 - y**2) + (self.middle[0] * self.x[:, None] + self.middle[1] * self.y) / self.middle[2]

    def pixel(self, design, offset, growth, neighbours=2, nodes=3):
        """Of the pixel `offset` from image centres, which stray by `growth` per way on the array."""
        (at, share), total = np.polynomial.legendre.leggauss(nodes), 0.0
        sides = []
        for axis, ways in enumerate((self.x, self.y)):
            way, each = ways + self.middle[axis], []
            for part in at:
                image = design.d_2 * self.middle[axis] / self.middle[2] + growth[axis] * self.places
                field = 0.0
                for m in range(-neighbours, neighbours + 1):
                    p = (image + offset[axis] + part * design.q / 2 - m * design.d)[:, None]
                    through = np.sinc(design.d / design.wavelength * (way / self.middle[2] - p / design.d_2))
                    field = field + through * np.exp(1j * self.k * (m * design.d * way + p * p / (2 * design.d_2)))
                each.append(field * np.exp(1j * self.k * np.outer(self.places, way)))
            sides.append(each)
        for a, x in enumerate(sides[0]):
            for b, y in enumerate(sides[1]):
                total = total + share[a] * share[b] * self.light(x, y)
        return total

    def contrast(self, light, frequency, axis):
        line = light.sum(1 - axis)
        return np.abs(np.exp(-2j * np.pi * np.outer(frequency, self.places)) @ line) / line.sum()


def behind(design, slope, detail):
    """Contrast that a microlens and a pixel leave where views are moved by a slope."""
    apart = design.wavelength * design.d_2 * abs(slope) * detail
    lens = np.maximum(1 - apart / design.d, 0.0) * np.sinc((design.d - apart) * detail)
    return np.abs(lens * np.sinc(slope * design.q * detail))


def replaced(waves, **parts):
    other = copy(waves)
    vars(other).update(parts)
    return other


def test_detail_behind_a_real_lens_is_what_waves_show():
    design, place = roslf.load("paper-singlet"), np.array([6.0, 0.0])
    camera = camera_of(design)
    transfer = DesignImages(design, [place]).transfer(0, None)
    chief = sensor_of_pupil(
        camera, place + 0.05 * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]]), camera.fap.centre
    )
    strayed = chief.sensor - place
    growth = (strayed[1, 0] - strayed[2, 0]) / 0.1 - 1, (strayed[3, 1] - strayed[4, 1]) / 0.1 - 1
    waves = Waves(camera, place, chief.views.at(camera.fap.z - camera.focal_plane)[0], span=0.8, step=design.d / 8)
    view = waves.pixel(design, np.subtract(transfer.middle, strayed[0]), growth)
    whole = waves.on_array(-design.d_2 * transfer.rate)
    for axis, way in enumerate(("tangential", "sagittal")):
        detail = np.linspace(0.0, 1.2 * transfer.limits((0.1,), "view", way)[0], 6)
        shown = waves.contrast(view, detail * transfer.scale(way), axis)
        assert transfer(detail, "view", way) == pytest.approx(shown, abs=4e-3)
        # all of a microlens's light, views moved by the slope: the lens's contrast times microlens's and pixel's
        detail = np.linspace(0.0, 1.2 * transfer.limits((0.1,), "refocused", way)[0], 6)
        on_array = detail * transfer.scale(way)
        shown = waves.contrast(whole, on_array, axis) * behind(design, transfer.rate, on_array)
        assert transfer(detail, "refocused", way) == pytest.approx(shown, abs=8e-3)  # Airy rings beyond the span
    assert transfer.limits((0.5,), "view", "tangential")[0] == pytest.approx(
        2.15, abs=0.02
    )  # the thin-lens model's: 3.93


SCANNER = """
name = "scanner"
main_lens = {{part = "AC254-045-A", focal_plane = "{focus} mm"}}
aperture = {{diameter = "8 mm", distance = "5 mm"}}
microlens_array = {{pitch = "25 um", focal_length = "265 um", size = ["12 mm", "9 mm"]}}
sensor = {{part = "IMX535", distance = "265 um"}}
light = {{wavelength = "550 nm"}}
"""


@pytest.mark.parametrize("focus", [90.0, 91.0])
def test_detail_behind_a_real_lens_is_that_of_the_sharpest_slope(focus, tmp_path):
    """Rays of a point through AC254-045-A, moved back by every slope: the best of all keeps half the contrast of ours.

    Where the array stands at the point's paraxial image that is no longer the slope of the plane, by far.
    """
    (tmp_path / "scanner.toml").write_text(SCANNER.format(focus=focus))
    design = roslf.load(tmp_path / "scanner.toml")
    camera = camera_of(design)
    away = camera.first_order.front_principal - 90.0
    fan = np.linspace(0.0, camera.fap.diameter / 2, 30)
    ways = np.stack([fan, 0 * fan, np.full(30, camera.fap.z - away)])
    at, along, _ = by_snell(camera, np.array([[0.0], [0.0], [away]]), ways / np.linalg.norm(ways, axis=0))
    shown = design.d_2 * along[0] / along[2]  # where a microlens shows the ray, which meets the array astray
    powers = np.arange(1, 11, 2)
    terms = np.linalg.lstsq(shown[:, None] ** powers, at[0], rcond=None)[0]
    radius = abs(shown[-1])
    x, y = np.meshgrid(*2 * [np.linspace(-radius, radius, 121)], indexing="ij")

    def path(x, slope):
        """Phase of the wave by ways astray, once they are moved back by a slope [turns]."""
        square = x**2 + y**2
        whole = sum(t * square ** ((k + 1) / 2) / (k + 1) for t, k in zip(terms, powers, strict=True))
        return (whole - slope * square / 2) / (design.wavelength * design.d_2)

    def contrast(detail, slope):
        half = design.wavelength * design.d_2 * detail / 2
        both = np.maximum(np.hypot(x + half, y), np.hypot(x - half, y)) <= radius
        wave = np.exp(2j * np.pi * (path(x + half, slope) - path(x - half, slope)))
        return abs(wave[both].sum()) / (np.hypot(x, y) <= radius).sum() * behind(design, slope, detail)

    def limit(slope):
        low, high = 1.0, 40.0
        for _ in range(10):
            middle = (low + high) / 2
            low, high = (middle, high) if contrast(middle, slope) >= 0.5 else (low, middle)
        return low

    transfer = DesignImages(design, [[0.0, 0.0]]).transfer(0, 90.0 - float(roslf.Camera.of(design).tip))
    ours = transfer.limits((0.5,), "refocused", "tangential")[0] * transfer.along
    assert ours == pytest.approx(max(limit(slope) for slope in np.linspace(-4.0, 6.0, 51)), rel=0.02)


def test_what_a_lens_does_not_show_is_left_out_of_its_sheet():
    data = specification(roslf.load("paper-singlet").replace({"main_lens.reversed": False})).to_dict()
    assert data["resolution"][2]["mtf50_lp_per_mm"] is None
    assert data["resolution"][2]["fold_lp_per_mm"] > 0
    assert data["field"][2]["distortion_percent"] is None
    assert data["field"][2]["relative_illumination"] == 0.0  # the corner lies beyond the lens
