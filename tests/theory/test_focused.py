"""Focused arrays against rays traced by hand: planes in focus, blur, who sees a point, samples of refocused images."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.design import DesignError
from roslf_design.imaging.render import render
from roslf_design.scenes import Checkerboard, Plane, Scene
from roslf_design.theory import focused
from tests.laws import DEAR

ROOT = Path(__file__).parents[2]
PAPER = roslf.load("paper")
KEPLER = roslf.Design.make(
    {
        "name": "near-infrared camera",
        "main_lens": {"diameter": 1.032, "focal_length": 3.04},
        "aperture": {"diameter": 1.032, "distance": 0.0},
        "microlens_array": {
            "pitch": 0.03, "focal_length": 0.075, "distance": 3.439, "size": (3.7, 2.8), "lens_shape": "circular",
        },
        "sensor": {"distance": 0.1, "pixel": 1.12e-3, "size": (3.6736, 2.75968)},
        "light": {"wavelength": 800e-6},
    }
)  # fmt: skip
"""Kim et al., authorea 438209/541372, figures S3 and S8: sharp from 60 to 250 mm, its gap is not its focal length."""
RAYTRIX = roslf.Design.make(
    {
        "name": "R12-A",
        "main_lens": {"diameter": 27.8, "focal_length": 49.885286},
        "aperture": {"diameter": 23.4, "distance": 0.0},
        "microlens_array": {
            "pitch": 0.12745, "focal_lengths": (0.582670, 0.524025, 0.560574), "distance": 56.859967,
            "size": (22.5, 17.0), "layout": "hexagonal", "lens_shape": "circular",
        },
        "sensor": {"distance": 0.3371257, "pixel": 5.5e-3, "size": (22.44, 16.874)},
        "light": {"wavelength": 550e-6},
    }
)  # fmt: skip
"""As its owners calibrated it: github comsee-research/compote, examples/config/intrinsics.js."""
BORE = KEPLER.replace(d_3=1.5, D_F=0.8)
"""The same behind a stop in front of its lens."""


class Rays:
    """Rays of one camera in air by its lengths alone, x against z: through points of the FAP and of the array."""

    def __init__(self, design, f_ml=None):
        self.f, self.d_1, self.d_2, self.d_3 = design.f, design.d_1, design.d_2, design.d_3
        self.f_ml = design.f_ml if f_ml is None else f_ml

    def on_array(self, x, z, stop):
        """Where the ray from (x, z before the lens) through a point of the FAP meets the array, and its slope there."""
        slope = (stop - x) / (z - self.d_3)
        height = x + slope * z
        bent = slope - height / self.f
        return height + bent * self.d_1, bent

    def through(self, x, z, on_array):
        """The stop's point through which the ray goes that meets the array at a height: linear, from two rays."""
        (a, _), (b, _) = self.on_array(x, z, 0.0), self.on_array(x, z, 1.0)
        return (on_array - a) / (b - a)

    def lands(self, x, z, w, axis=0.0):
        """On the sensor, the ray from a point through w of the microlens at an axis."""
        _, slope = self.on_array(x, z, self.through(x, z, axis + w))
        return axis + w + (slope - w / self.f_ml) * self.d_2

    def back(self, z, axis, slope):
        """Height at z before the lens of the ray that leaves the middle of a microlens towards the scene."""
        height = axis - slope * self.d_1
        return height - (slope + height / self.f) * z

    def chief(self, axis):
        """Slope at the middle of a microlens of the ray from the FAP's middle: linear, from two rays."""
        zero, one = (self.back(self.d_3, axis, slope) for slope in (0.0, 1.0))
        return -zero / (one - zero)


TYPES = [
    pytest.param(design, one, design.microlens_array.types[k], id=f"{design.name}, d_3 {design.d_3}, type {k}")
    for design in (KEPLER, BORE, RAYTRIX)
    for k, one in enumerate(Camera.of(design).microlens_types)
]


SEEN, BLUR, RATIO = (roslf.quantity(name) for name in ("seen_by", "microlens_blur_px", "resolution_ratio"))


def own_blur(camera):
    """Of a pixel and of diffraction together [mm]."""
    return math.hypot(camera.q, camera.wavelength * camera.d_2 / camera.d)


@pytest.mark.parametrize(("design", "camera", "f_ml"), TYPES)
def test_focus_blur_and_who_sees_a_point_are_those_of_traced_rays(design, camera, f_ml):
    """Rounding of four-fold differences: 1e-9."""
    rays, (told,) = Rays(design, f_ml), focused.FocusedArray.of(camera).in_focus
    z, across = told.ahead_mm + design.d_3, np.linspace(-0.5, 0.5, 5) * design.d
    assert np.ptp(rays.lands(0.3, z, across)) < 1e-9 * design.d  # in focus whatever part of a microlens
    for ahead in (0.8 * z, z, 1.3 * z):
        at = ahead - design.d_3
        beam = abs(rays.on_array(0.0, ahead, design.D_F)[0] - rays.on_array(0.0, ahead, 0.0)[0])
        assert SEEN(camera, at) == pytest.approx(beam / design.d, rel=1e-9)
        spread = np.ptp(rays.lands(0.0, ahead, across)) / design.q
        assert BLUR(camera, at) == pytest.approx(spread, rel=1e-7, abs=1e-6)
        # The middles of two pixels on the plane, through one microlens, and two chief rays there and on the sensor: how
        # many pixels' widths of the plane a microlens has to itself, for one of the sensor's.
        pixel = np.ptp([rays.back(ahead, 0.0, p / rays.d_2) for p in (0.0, design.q)])
        own = np.ptp([rays.back(ahead, axis, rays.chief(axis)) for axis in (0.0, design.d)])
        pitch = np.ptp([axis + rays.chief(axis) * rays.d_2 for axis in (0.0, design.d)])
        coarser = math.hypot(own_blur(camera) / design.q, spread)
        assert beam > design.d
        assert RATIO(camera, at) == pytest.approx(own / pixel / (pitch / design.q) / coarser, rel=1e-7)


@pytest.mark.parametrize(("design", "camera", "f_ml"), TYPES)
def test_light_of_a_point_near_the_focal_plane_fills_microlenses_in_part(design, camera, f_ml):
    """Its width on the array is less than a microlens: at the focal plane itself the pupil's image is what is lit."""
    rays, focal = Rays(design, f_ml), design.d_f
    for ahead in (focal * 0.999, focal * 1.0003):
        beam = abs(rays.on_array(0.0, ahead, design.D_F)[0] - rays.on_array(0.0, ahead, 0.0)[0])
        assert beam < design.d
        spread = np.ptp(rays.lands(0.0, ahead, np.array([-0.5, 0.5]) * beam)) / design.q
        assert BLUR(camera, ahead - design.d_3) == pytest.approx(spread, rel=1e-6)
    image = float(roslf.quantity("image_diameter_px")(camera))
    assert BLUR(camera, focal - design.d_3) == pytest.approx(image, rel=1e-6)


@pytest.mark.parametrize(("design", "camera", "f_ml"), TYPES)
def test_the_pupil_is_a_point_that_is_blurred_like_any_other(design, camera, f_ml):
    rays, across = Rays(design, f_ml), np.linspace(-0.5, 0.5, 5) * design.d
    landed = np.ptp([w + (rays.chief(w) - w / f_ml) * rays.d_2 for w in across])
    assert focused.FocusedArray.of(camera).pupil_blur_px == pytest.approx((landed / design.q,), rel=1e-9)


def test_planes_in_water_behind_a_window_are_where_reduced_lengths_put_them():
    """Air, 0.5 mm of an index of 1.5, then water: as the lens sees them each over its index."""
    window = {"kind": "plate", "distance": 2.0, "thickness": 0.5, "material": {"index": 1.5}, "diameter": 40.0}
    wet = KEPLER.replace({"elements": [window], "object_space": {"medium": {"index": 1.333}}})
    (plane,) = focused.FocusedArray.of(Camera.of(wet)).in_focus
    (dry,) = focused.FocusedArray.of(Camera.of(KEPLER)).in_focus
    assert plane.virtual_depth == dry.virtual_depth
    assert plane.ahead_mm == pytest.approx(1.333 * (dry.ahead_mm - 2.0 - 0.5 / 1.5), rel=1e-9)
    assert roslf.quantity("virtual_depth")(Camera.of(wet), plane.ahead_mm) == pytest.approx(dry.virtual_depth, rel=1e-9)


def test_sharp_ranges_end_where_blur_is_that_of_pixels_and_diffraction():
    for _, camera, _ in (case.values for case in TYPES):
        array = focused.FocusedArray.of(camera)
        own = own_blur(camera) / camera.q
        assert array.own_blur_px == pytest.approx(own, rel=1e-12)
        for end in array.limits[:2]:
            assert end.blur_px == pytest.approx((own,), rel=1e-12)
            if math.isfinite(end.ahead_mm):
                assert BLUR(camera, end.ahead_mm) == pytest.approx(own, rel=1e-6)
    # The published range of the near-infrared camera, 60 to 250 mm, lies within what is sharp by this measure.
    near, far, covered = focused.FocusedArray.of(Camera.of(KEPLER)).limits
    assert 55 < near.ahead_mm < 62
    assert far.ahead_mm == math.inf
    assert roslf.quantity("virtual_depth")(Camera.of(KEPLER), covered.ahead_mm) == pytest.approx(2.0, rel=1e-9)


def test_the_calibrated_raytrix_is_focused_where_its_owners_say():
    """Their planes hold for the lengths of a first guess; those of the final ones lie 0.4 to 1.2 % nearer."""
    told = focused.FocusedArray.of(Camera.of(RAYTRIX))
    assert [plane.ahead_mm for plane in told.in_focus] == pytest.approx([374.254, 365.641, 371.489], rel=0.013)
    assert all(-3 < plane.virtual_depth < -2 for plane in told.in_focus)  # Galilean
    pitch = float(roslf.quantity("image_pitch_mm")(Camera.of(RAYTRIX))) / RAYTRIX.q
    assert pitch == pytest.approx(23.3127, rel=2e-4)  # as measured in its white images
    for at, k in ((370.0, 0), (364.0, 1), (368.0, 2)):  # of several types the sharpest counts
        assert BLUR(Camera.of(RAYTRIX), at) == pytest.approx(BLUR(Camera.of(RAYTRIX).microlens_types[k], at))
        assert RATIO(Camera.of(RAYTRIX), at) == pytest.approx(RATIO(Camera.of(RAYTRIX).microlens_types[k], at))


def test_from_the_total_covering_plane_on_all_types_see_each_point():
    """A microlens sees of a plane at virtual depth v the disc of radius v d/2 before it; counted at random points."""
    points = np.random.default_rng(1).uniform(-1, 1, (4000, 2))
    steps = np.arange(-9, 10)
    i, j = (axis.ravel() for axis in np.meshgrid(steps, steps))
    hexagonal = np.stack([i + j / 2, j * math.sqrt(0.75)], -1)
    kinds = (i - j) % 3
    square = np.stack([i, j], -1)

    def least(lattice, v):
        return (np.hypot(*(points[:, None] - lattice).T) <= v / 2).sum(0).min()

    v = focused.COVERED
    assert min(least(hexagonal[kinds == kind], v) for kind in range(3)) >= 1
    assert min(least(hexagonal[kinds == kind], 0.95 * v) for kind in range(3)) == 0
    assert least(square, v) >= 2
    assert least(square, 0.95 * v) < 2


KEPT = sorted((ROOT / "studies" / "depth" / "instruments").glob("*.toml"))


@pytest.mark.parametrize("design", [*roslf.preset_names(), *KEPT, PAPER.replace(f_ml=2.3)], ids=str)
def test_cameras_whose_microlenses_image_the_pupil_are_left_alone(design):
    """Those that ship, published ones, and the paper's with a focal length 15 % off: diffraction blurs it more."""
    design = design if isinstance(design, roslf.Design) else roslf.load(design)
    assert focused.FocusedArray.of(Camera.of(design.thin_twin)) is None
    assert not [*focused.focus_faults(design, "anything")]


def test_the_limit_is_where_half_the_views_are_left():
    """Of the widths that blur a view: at the limit 1/sqrt(5) of the views that pixels and diffraction leave."""
    camera = Camera.of(roslf.load("pipe-bore"))
    image = float(roslf.quantity("image_diameter_px")(camera) * camera.q)
    views = image / own_blur(camera)
    told = []
    for f_ml in np.linspace(0.7, 1.4, 281) * float(camera.f_ml):
        one = camera.replace({"f_ml": f_ml})
        blurred = image / math.hypot(image / views, float(roslf.quantity("microlens_defocus_px")(one)) * one.q)
        told.append((blurred / views, bool(focused.is_focused(one))))
    assert {caught for share, caught in told if share < 0.445} == {True}
    assert {caught for share, caught in told if share > 0.45} == {False}


@DEAR
@given(st.floats(0.03, 0.5), st.floats(0.0, 2.0))
def test_types_together_are_as_each_alone(f_ml, d_3):
    pair = KEPLER.replace(d_3=d_3).replace(
        {"microlens_array.focal_length": None, "microlens_array.focal_lengths": (f_ml, 0.08)}
    )
    alone = [KEPLER.replace(d_3=d_3, f_ml=each) for each in (f_ml, 0.08)]
    for one, other in zip(Camera.of(pair).microlens_types, alone, strict=True):
        assert focused.FocusedArray.of(one) == focused.FocusedArray.of(Camera.of(other))
    assert roslf.loads(roslf.dumps(pair)) == pair
    swept = Camera.of(pair, {"f_ml": np.array([0.07, f_ml]), "microlens_array.focal_lengths.1": 0.08})
    assert BLUR(swept, 50.0)[1] == BLUR(Camera.of(pair), 50.0)


@pytest.mark.parametrize(
    ("changes", "place", "words"),
    [
        ({"focal_lengths": (0.5, 0.6), "focal_length": 0.5}, "focal_length", "drop one of them"),
        ({"focal_length": None}, "focal_length", "missing"),
        ({"focal_lengths": (0.5, -0.6), "focal_length": None}, "focal_lengths.1", "greater than zero"),
        ({"focal_lengths": (0.5,) * 17, "focal_length": None}, "focal_lengths", "16"),
        ({"focal_lengths": "0.5 mm", "focal_length": None}, "focal_lengths", "list"),
    ],
)
def test_lists_of_focal_lengths_that_cannot_be_are_refused(changes, place, words):
    with pytest.raises(DesignError) as refused:
        KEPLER.replace({f"microlens_array.{key}": value for key, value in changes.items()})
    assert [problem.key for problem in refused.value.problems] == [f"microlens_array.{place}"]
    assert words in str(refused.value)


def test_temperature_weakens_all_types_alike():
    warm = RAYTRIX.replace({"microlens_array.material": "fused silica", "environment": {"temperature": 20.0}})
    grown = warm.at_temperature(60.0).microlens_array.types
    assert np.ptp(np.divide(grown, RAYTRIX.microlens_array.types)) < 1e-12
    alone = warm.replace({"microlens_array.focal_lengths": (), "microlens_array.focal_length": 0.5}).at_temperature(
        60.0
    )
    assert grown[0] / RAYTRIX.microlens_array.types[0] == pytest.approx(alone.f_ml / 0.5, rel=1e-12)
    assert grown[0] != RAYTRIX.microlens_array.types[0]


@pytest.mark.parametrize("ahead", [96.389, 60.0, 250.0])
def test_rendered_edges_are_as_blurred_as_is_told(ahead):
    """An edge seen by the microlens on the axis: its ramp's spread against the blur of a square microlens.

    A pixel's width and the difference of two add a box each. Rays scatter by 1 % of full scale at each of some six
    pixels: 0.1 px of the spread; diffraction is left out.
    """
    design = KEPLER.replace({"microlens_array.lens_shape": "square", "sensor.pixel": 0.56e-3})
    board = Scene(name="edge", objects=(Plane(distance=ahead, texture=Checkerboard(period=390.0)),))
    width, height = design.pixels
    off = ["-microlens_diffraction", "-fap_diffraction", "-cos4", "+microlens_defocus", "+finite_microlens_aperture"]
    image = render(design, board, overrides=off, region=(width // 2 - 7, height // 2 + 8, 14, 8))
    row = np.asarray(image.pixels, float).mean(0)
    row = (row - row.min()) / np.ptp(row)
    slope = np.diff(row)
    at = np.arange(slope.size)
    middle = (at * slope).sum() / slope.sum()
    measured = math.sqrt(12 * ((at - middle) ** 2 * slope).sum() / slope.sum())
    camera = Camera.of(design)
    told = float(BLUR(camera, ahead))
    if told < 1e-3:  # within a pixel, or two where the edge lies in one's middle
        assert measured <= math.sqrt(3)
        return
    assert measured == pytest.approx(math.hypot(told, 1.0, 1.0), abs=0.15)
