"""Renderings behind an objective with a mapping, against rays worked out here; points where their chief ray lands."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.effects import plan
from roslf_design.errors import InputError
from roslf_design.imaging.camera import ImageLattice, Region, pixel_centres
from roslf_design.imaging.render import render
from roslf_design.imaging.trace import RaySampling
from roslf_design.rays import fans
from roslf_design.scenes import make_scene
from roslf_design.theory.light import chief_slope, falloff

LENS = {"kind": "lens", "distance": 2.0, "focal_length": -4.0, "mapping": "f sin"}
BASE = {
    "elements": [LENS],
    "main_lens.focal_plane": 12.0,
    "microlens_array.size": (4.0, 4.0),
    "sensor.size": (2.4, 2.0),
}


def scope(mapping="f sin", **changes):
    """The rigid scope with an objective of -4 mm before its lens; the FAP touches the main lens, or as told."""
    return roslf.load("rigid-scope").replace(
        {**BASE, "elements": [{**LENS, "mapping": mapping}], "aperture.distance": 0.5, **changes}
    )


def outside(design, x, y, cx, cy):
    """Backward rays of sensor points through microlens centres: heights on the focal plane; f sin, in air.

    To first order by thin lenses in a row; then the sine of the angle is the first order's slope, from where the ray
    crosses the FAP's image, which is worked out from two rays of the FAP's middle.
    """
    lens, f_e, distance = LENS["distance"], LENS["focal_length"], design.d_f
    heights, slopes = [], []
    for p, c in ((x, cx), (y, cy)):
        s = (p - c) / design.d_2
        height = c - s * design.d_1
        o = s + height / design.f
        at = height - o * lens
        heights.append(at)
        slopes.append(o + at / f_e)
    behind = lens - design.d_3  # the FAP lies behind the objective: its image, before it
    pupil = 1 / (1 / f_e - 1 / behind)  # beyond the objective where > 0
    p = np.hypot(*slopes)
    grown = 1 / np.sqrt(1 - p * p)
    return [h - o * pupil - grown * o * (distance - lens - pupil) for h, o in zip(heights, slopes, strict=True)]


def test_a_texture_is_seen_where_rays_go():
    """One ray a pixel, through the middles of pixel and microlens: a slow wave, and pixels far smaller than its period.

    What sampling a pixel leaves: its own slope times a pixel's width, averaged.
    """
    design = scope()
    wave = {"kind": "sinusoid", "period": 6.0, "angle": 0.5, "contrast": 0.8}
    scene = make_scene({"objects": [{"kind": "plane", "texture": wave}]})
    camera = Camera.of(design)
    lattice, region = ImageLattice.of(camera), (80, 150, 300, 120)
    sampling = RaySampling(64, 64, 1e-9)
    shown = render(design, scene, overrides=["none", "+object_defocus"], region=region, sampling=sampling).pixels
    x, y = pixel_centres(camera, Region(*region))
    px, py = np.meshgrid(x, y)
    index = np.round(np.linalg.solve(lattice.image_axes, np.stack([px.ravel(), py.ravel()]))).T
    cx, cy = (part.reshape(px.shape) for part in lattice.microlens(index).T)
    u, v = outside(design, px, py, cx, cy)
    expected = 0.5 * (1 + 0.8 * np.cos(2 * np.pi / 6 * (u * math.cos(0.5) + v * math.sin(0.5))))
    inside = np.hypot(px - cx * lattice.grow, py - cy * lattice.grow) < 0.3 * design.d
    lit = inside & (shown > 0)
    assert lit.mean() > 0.2
    assert float(np.hypot(u, v)[lit].max()) > 3  # well into the bent field
    assert_allclose(shown[lit], expected[lit], atol=0.02)


@pytest.mark.parametrize("mapping", ["f theta", "f sin"])
@pytest.mark.parametrize("waves", [False, True])
def test_a_point_lands_where_its_chief_ray_does(mapping, waves):
    """Its light's middle against the microlens whose chief ray meets it, within a tenth of a microlens."""
    design = scope(mapping)
    camera, place = Camera.of(design), (0.31, -0.22)
    lattice = ImageLattice.of(camera)
    index = np.round(np.linalg.solve(lattice.turned, np.array(place)))
    cx, cy = lattice.microlens(index)
    target = np.array(lattice.image(index))
    g = {"f sin": lambda p: p / math.sqrt(1 - p * p), "f theta": math.tan}[mapping]
    # The chief ray: from the pupil's middle, along its own azimuth.
    straight = float(camera.seen.inverse_m * abs(camera.focus.magnification))
    pupil = float(camera.entrance_pupil_distance)
    slope = straight * math.hypot(cx, cy) / (design.d_f - pupil)
    reach = g(slope) * (design.d_f - pupil)
    sign = -np.sign(float(camera.focus.magnification))
    point = [float(sign * reach * c / math.hypot(cx, cy)) for c in (cx, cy)]
    scene = make_scene({"objects": [{"kind": "points", "positions": [[*point, design.d_f]]}]})
    effects = ["none", "+microlens_diffraction", "+fap_diffraction"] if waves else ["none"]
    column, row = np.floor(target / design.q + np.array(camera.pixels) / 2).astype(int) - 60
    region = Region(int(column), int(row), 120, 120)
    image = render(design, scene, overrides=effects, region=tuple(region)).pixels.astype(float)
    x, y = pixel_centres(camera, region)
    middle = np.array([image.sum(0) @ x, image.sum(1) @ y]) / image.sum()
    assert np.hypot(*(middle - target)) < (0.3 if waves else 0.1) * design.d


def test_exact_rays_through_a_mapped_objective_alone_leave_a_point_where_it_is():
    """So small an opening that one focus stands for all of it; slopes are drawn out thirtyfold there."""
    lens = {**LENS, "focal_length": -1.5}
    changes = {"elements": [lens], "aperture.diameter": 0.08, "sensor.size": (4.0, 4.0)}
    scene = make_scene({"objects": [{"kind": "points", "positions": [[30.0, 9.0, 12.0]]}]})
    ideal, exact = (
        render(scope(**changes), scene, overrides=["none", *effects]).pixels.astype(float)
        for effects in ([], ["+plate_aberration"])
    )
    assert ideal.sum() > 0
    assert exact.sum() == pytest.approx(ideal.sum(), rel=1e-3)
    for axis in (0, 1):
        across = np.arange(ideal.shape[1 - axis])
        middles = [image.sum(axis) @ across / image.sum() for image in (ideal, exact)]
        assert middles[0] == pytest.approx(middles[1], abs=0.1)  # pixels


def test_points_that_the_mapping_draws_out_are_refused():
    scene = make_scene({"objects": [{"kind": "points", "positions": [[2.5, 0.0, 5.0]]}]})
    with pytest.raises(InputError, match=r"drawn out by .* pitches by the objective's mapping"):
        render(scope(**{"aperture.diameter": 1.5}), scene, overrides=["-plate_aberration"])


def test_white_fields_darken_by_the_law_and_rays_agree_with_coverage():
    """With the FAP before the objective; as textures are traced, as white is."""
    design = scope("f theta", **{"aperture.distance": 3.0})
    camera = Camera.of(design)
    effects = plan(design, None, None, ["none", "+cos4"])
    x = np.linspace(-1.0, 1.0, 5)
    shares = falloff(camera, chief_slope(camera) * x)
    slope = float(chief_slope(camera)) * 1.0
    assert shares[-1] == pytest.approx(math.sin(slope) * math.cos(slope) / slope, rel=1e-12)
    assert shares[-1] < 0.99
    region = (300, 300, 60, 60)
    white = render(design, None, effects=effects, region=region).pixels
    plane = make_scene({"objects": [{"kind": "plane"}]})
    sampling = RaySampling(64, 64, 1e-9)
    traced = render(design, plane, overrides=["none", "+cos4"], region=region, sampling=sampling).pixels
    whole = (white > 0.9 * white.max()) & (traced > 0.9 * white.max())
    assert whole.mean() > 0.2
    assert white[whole].mean() < 0.999
    # Pixel by pixel: what decoding divides by is what light falls off by. Depth would take the rest for disparity.
    lit = render(design, None, overrides=["none"], region=region).pixels == 1
    assert np.median(np.abs(traced[lit] / white[lit] - 1)) < 1e-6


def test_drawn_rays_stay_finite_where_nothing_is_imaged():
    design = scope(**{"sensor.size": (20.0, 20.0), "microlens_array.size": (20.0, 20.0), "main_lens.diameter": 30.0})
    drawn = fans(Camera.of(design), np.linspace(-9, 9, 7))
    assert (drawn.status >= 16).any()
    assert np.isfinite(drawn.x).all()
    assert np.abs(drawn.x).max() < 1e4
