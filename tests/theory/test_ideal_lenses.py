"""Field curvature and colour of ideal lenses against textbook sums, exact matrices and rays through two real lenses."""

import math

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.bore.group import LensGroup
from roslf_design.bore.part import PartNumbers
from roslf_design.camera import Camera
from roslf_design.effects.plan import plan
from roslf_design.lenses.glass import AIR, find_glass
from roslf_design.lenses.prescription import Prescription, Surface
from roslf_design.theory.ideal_lenses import IdealLensFaults
from roslf_design.theory.light import sensor_field

FILE = """
name = "relay"
[main_lens]
diameter = "12 mm"
focal_length = "50 mm"
%s
[aperture]
diameter = "%s"
distance = "100 mm"
[[elements]]
kind = "lens"
distance = "50 mm"
focal_length = "50 mm"
diameter = "12 mm"
material = "N-BK7"
[[elements]]
kind = "lens"
distance = "140 mm"
focal_length = "30 mm"
diameter = "12 mm"
material = "N-SF5"
[microlens_array]
pitch = "60 um"
focal_length = "600 um"
distance = "50 mm"
size = ["4 mm", "4 mm"]
[sensor]
pixel = "6 um"
size = ["4 mm", "4 mm"]
distance = "600 um"
[light]
wavelength = "550 nm"
"""
LINES = 486.1327e-6, 656.2725e-6


def design(material='material = "N-BK7"', pupil="2 mm"):
    return roslf.loads(FILE % (material, pupil))


def lenses(design, material):
    near, far = design.elements
    return [
        (0.0, 50.0, material),
        (near.distance, near.focal_length, near.material),
        (far.distance, 30.0, far.material),
    ]


def image_plane(design, focal_lengths, array):
    """Plane that the array at a distance sees, by matrices, ahead of the farthest lens [mm]."""
    distance, matrix, at = array, np.eye(2), 0.0
    for (place, *_), f in zip(lenses(design, None), focal_lengths, strict=True):
        gap = distance if place == 0 else place - at
        matrix, at = np.array([[1, 0], [-1 / f, 1]]) @ np.array([[1, gap], [0, 1]]) @ matrix, place
    return -matrix[0, 1] / matrix[1, 1]


def test_petzval_sum_and_the_plane_that_it_focuses_on():
    own = design()
    found = IdealLensFaults.of(Camera.of(own))
    glass = own.main_lens.material
    by_hand = sum(1 / (f * float(material.index(550e-6))) for _, f, material in lenses(own, glass))
    assert found.petzval == pytest.approx(by_hand, rel=1e-12)
    assert (found.lenses, found.unnamed) == (3, 0)
    height = float(sensor_field(Camera.of(own)).radius)
    seen = image_plane(own, (50, 50, 30), 50 + by_hand * height**2 / 2)
    assert found.middle == pytest.approx(image_plane(own, (50, 50, 30), 50), rel=1e-9)
    assert found.corner == pytest.approx(seen, rel=1e-9)
    unnamed = IdealLensFaults.of(Camera.of(design("")))
    assert unnamed.petzval == pytest.approx(by_hand + 1 / 75 - 1 / (50 * float(glass.index(550e-6))), rel=1e-12)
    assert "n = 1.5 where no material is stated" in unnamed.curved
    assert "left out (1)" in unnamed.coloured


def test_colour_by_exact_matrices_and_by_abbe_numbers():
    own = design(pupil="0.2 mm")
    found = IdealLensFaults.of(Camera.of(own))
    glasses = [material for *_, material in lenses(own, own.main_lens.material)]
    for line, plane in zip(LINES, found.colours, strict=True):
        focal = [
            f * float((glass.index(550e-6) - 1) / (glass.index(line) - 1))
            for f, glass in zip((50, 50, 30), glasses, strict=True)
        ]
        assert plane == pytest.approx(image_plane(own, focal, 50), rel=1e-9)
    # The textbook's sum, to first order: a ray from the focal plane, its heights at the lenses and slope there.
    height, slope, total, places = -found.middle, 1.0, 0.0, (140.0, 50.0, 0.0)
    y = found.middle * slope
    for k, f in enumerate((30.0, 50.0, 50.0)):
        glass = glasses[2 - k]
        v = float((glass.index(550e-6) - 1) / (glass.index(LINES[0]) - glass.index(LINES[1])))
        total += y * y / (f * v)
        slope -= y / f
        y += slope * (places[k] - places[min(k + 1, 2)])
    assert found.colours[1] - found.colours[0] == pytest.approx(total, rel=0.1)
    assert height < 0


def test_rays_through_two_real_lenses_have_the_petzval_sum():
    """By (3 S - T)/2, whatever the astigmatism: foci of close rays about the chief ray, by the package's tracer."""
    glass, gap, stop = find_glass("N-BK7"), 20.0, 12.0
    n, wave = float(glass.index(550e-6)), 550e-6

    def thin(f, behind):
        c = 1 / (2 * f * (n - 1))
        return Surface(c, 1.5, 0.06, glass), Surface(-c, 1.5, behind, AIR)

    lens = Prescription((*thin(60.0, gap), *thin(40.0, 0.0)), "two")
    slope, near = 2e-2, 1e-4

    def traced(tilt, x, y):
        """Parallel light through a stop before the lens."""
        heights = np.array([[x + stop * tilt], [y]])
        return lens.through(heights, np.array([[tilt], [0.0]]), wave, start=0.0, end=lens.length, backward=False)

    def focus(tilt, dx, dy):
        axis = int(dy > 0)
        one, other = traced(tilt, dx, dy), traced(tilt, -dx, -dy)
        apart = one.height[axis, 0] - other.height[axis, 0]
        return -apart / (one.slope[axis, 0] - other.slope[axis, 0])

    axial = focus(0.0, near, 0.0)
    tangential, sagittal = focus(slope, near, 0.0) - axial, focus(slope, 0.0, near) - axial
    chief = traced(slope, 0.0, 0.0)
    height = float(chief.height[0, 0] + axial * chief.slope[0, 0])
    petzval = 1 / (60 * n) + 1 / (40 * n)
    assert (3 * sagittal - tangential) / 2 == pytest.approx(-petzval * height**2 / 2, rel=5e-3)
    # A group of the same surfaces has the same sum.
    group = LensGroup(kind="prescription", distance=60.0, prescription=lens)
    numbers = PartNumbers(Camera.of(design()).numbers, "elements.0")
    assert group.petzval(numbers) == pytest.approx(petzval, rel=1e-9)


def test_a_gradient_index_rod_has_its_power_over_the_square_of_its_index():
    """By rays: meridional and skew ones about a chief ray through the middle of its face, of the rod's Hamiltonian."""
    n, g, length = 1.6, 0.05, 10.0
    rod = {"kind": "grin", "distance": 60.0, "thickness": length, "index": n, "gradient": g, "diameter": 2.0}
    (part,) = Camera.of(roslf.load("grin-needle").replace({"elements": (rod,)})).in_bore
    assert part.element.petzval(PartNumbers(part.at.numbers, part.at.place)) == pytest.approx(g * g * length / n)

    def through(x, y, p, q):
        """Height and slope in air behind the rod, by Hamilton's equations: H = -sqrt(n(r)^2 - p^2)."""
        state, steps = np.array([x, y, p, q], float), 400

        def rate(s):
            square = s[0] ** 2 + s[1] ** 2
            index = n * (1 - g * g * square / 2)
            along = math.sqrt(index**2 - s[2] ** 2 - s[3] ** 2)
            bend = -index * n * g * g / along
            return np.array([s[2] / along, s[3] / along, bend * s[0], bend * s[1]])

        h = length / steps
        for _ in range(steps):
            a = rate(state)
            b = rate(state + h / 2 * a)
            c = rate(state + h / 2 * b)
            state = state + h / 6 * (a + 2 * b + 2 * c + rate(state + h * c))
        along = math.sqrt(1 - state[2] ** 2 - state[3] ** 2)
        return state[:2], state[2:] / along

    def focus(p, dx, dy):
        axis, step = int(dy > 0), 1e-4
        (one, slope), (other, lean) = through(dx * step, dy * step, p, 0.0), through(-dx * step, -dy * step, p, 0.0)
        return -(one[axis] - other[axis]) / (slope[axis] - lean[axis])

    axial = focus(0.0, 1, 0)
    tilt = 0.02
    tangential, sagittal = focus(tilt, 1, 0) - axial, focus(tilt, 0, 1) - axial
    at, slope = through(0.0, 0.0, tilt, 0.0)
    height = at[0] + axial * slope[0]
    assert (3 * sagittal - tangential) / 2 == pytest.approx(-g * g * length / n * height**2 / 2, rel=5e-3)


def test_ideal_lenses_are_told_as_not_modelled_and_cautioned_where_they_leave_the_depth_of_field():
    own = design()
    lines = plan(own)
    assert not lines["field_curvature"].modelled
    assert "Petzval sum" in lines["field_curvature"].reason
    assert "486" in lines["lens_colour"].reason
    assert plan(roslf.load("paper"))["lens_colour"].reason == "not modelled: ideal lens"
    faults = IdealLensFaults.of(Camera.of(own))
    near, far = faults.sharp
    told = [one for one in roslf.evaluate(own).verdicts if one.name == "ideal_lenses"]
    assert bool(told) == any(not near <= plane <= far for plane in (faults.corner, *faults.colours))
    assert IdealLensFaults.of(Camera.of(roslf.load("paper"))) is None
