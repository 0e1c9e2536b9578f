"""Microlens images through real lenses: the thin lens as a limit, brute force on a pixel grid, symmetry, refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from roslf_design.fates import ImageFate
from roslf_design.lenses.lens_file import load_lens
from roslf_design.lenses.manufacture import as_made
from roslf_design.lenses.prescription import LensError, first_order
from roslf_design.traced.camera import LensCamera, TracedPlane, chief_slope, sensor_of_pupil, views
from roslf_design.traced.images import real_images
from roslf_design.traced.outlines import Outlines
from roslf_design.traced.train import AimedRays
from tests.traced.brute import lit_part

GREEN = 550e-6


def bench(name, *, reverse=False, scale=1.0, stops=(), pupil=2.9, distance=120.0):
    """The paper's bench with a real lens in place of the ideal one; `scale` shrinks the FAP."""
    lens = load_lens(name)
    return mounted(lens.reversed() if reverse else lens, pupil * scale, distance, stops=stops)


def mounted(lens, pupil, distance=120.0, *, focal_plane=None, stops=()):
    """A lens focused by its first order, 3.5 f away unless said otherwise."""
    constants = first_order(lens, GREEN)
    f = constants.focal_length
    d_f = 3.5 * f if focal_plane is None else focal_plane
    mla = constants.rear_principal + f * d_f / (d_f - f)
    fap = TracedPlane(constants.front_principal - distance, diameter=pupil)
    parts = TracedPlane(mla), TracedPlane(mla + 2.0)
    return LensCamera(lens, GREEN, (fap, *stops), constants.front_principal - d_f, *parts)


def thin_disc(camera, c):
    """Area, centroid and moments of whole images by the thin lens."""
    r = camera.fap.diameter / 2 * abs(camera.d_2 * chief_slope(camera, [0.0, 0.0], [1.0, 0.0])[0])
    centre = camera.d_2 * chief_slope(camera, c, camera.fap.centre)
    return np.pi * r * r, centre, np.array([r * r / 4, 0.0, r * r / 4])


@pytest.mark.parametrize(("name", "reverse"), [("la1050-a", True), ("ac508-100-a", False)])
def test_thin_lens_is_the_limit_of_small_pupils_and_fields(name, reverse):
    errors = []
    field = np.array([[1.0, 0.0], [0.6, -0.7]])
    for scale in (1.0, 0.5, 0.25, 0.01):
        camera = bench(name, reverse=reverse, scale=scale)
        real, (area, centroid, moments) = real_images(camera, field * scale), thin_disc(camera, field * scale)
        assert (real.status == ImageFate.FULL).all()
        size = np.sqrt(area / np.pi)
        errors.append(
            max(
                np.max(np.abs(real.area / area - 1)),
                np.max(np.abs(real.centroid - centroid) / size),
                np.max(np.abs(real.second_moments - moments) / size**2),
            )
        )
    # third-order aberrations against the first order: a quarter for every half
    assert errors[0] < 0.06
    assert errors[1] == pytest.approx(errors[0] / 4, rel=0.05)
    assert errors[2] == pytest.approx(errors[1] / 4, rel=0.03)
    assert errors[3] < 1e-5


def by_pixels(camera, c, count=400):
    """Area, centroid and moments of what is lit, and the share of the FAP seen, on a grid of pinhole rays."""
    low, high = c * camera.d_2 / camera.d_1 - 0.55, c * camera.d_2 / camera.d_1 + 0.55
    for _ in range(2):  # first everywhere, then where there is light
        step = (high - low) / count
        sides = [low[i] + (np.arange(count) + 0.5) * step[i] for i in (0, 1)]
        offset = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1)
        lit = views(camera, c, c + offset).state == 0
        points = offset[lit]
        if not len(points):
            return 0.0, np.zeros(2), np.zeros(3), 0.0
        low, high = points.min(axis=0) - 2 * step, points.max(axis=0) + 2 * step
    x, y = (points - points.mean(axis=0)).T
    moments = np.array([np.mean(x * x), np.mean(x * y), np.mean(y * y)])
    pupil = views(camera, c, c + offset, clip=False).pupil
    (xx, xy), (yx, yy) = (np.gradient(pupil[..., i], *step) for i in (0, 1))
    seen = np.sum(np.abs(xx * yy - xy * yx)[lit]) * np.prod(step) / (np.pi / 4 * camera.fap.diameter**2)
    return lit.sum() * np.prod(step), points.mean(axis=0), moments, seen


CASES = {
    "whole, on axis": ("lb1630-a", False, (0.0, 0.0), ImageFate.FULL),
    "whole, at the edge": ("lb1630-a", False, (11.15, 0.0), ImageFate.FULL),
    "whole, in the corner": ("ac508-100-a", False, (-9.0, 9.0), ImageFate.FULL),
    "clipped by the lens": ("lb1630-a", False, (16.0, 3.0), ImageFate.CLIPPED),
    "clipped, achromat": ("ac508-100-a", False, (0.0, -15.5), ImageFate.CLIPPED),
    "cut to a sliver": ("lb1630-a", False, (17.4, 0.0), ImageFate.CLIPPED),
    "dark": ("lb1630-a", False, (24.0, 0.0), ImageFate.DARK),
    "folded": ("la1050-a", False, (11.15, 0.0), ImageFate.FOLDED),
}


@pytest.mark.parametrize("case", CASES)
def test_images_against_a_pixel_count(case):
    name, reverse, c, status = CASES[case]
    camera = bench(name, reverse=reverse)
    c = np.array(c)
    image = real_images(camera, c)
    area, centroid, moments, seen = by_pixels(camera, c)
    assert image.status == status
    assert image.area.shape == ()
    if status == ImageFate.DARK:
        assert area == 0
        assert image.area == image.kept_fraction == 0
        np.testing.assert_array_equal(image.centroid, image.chief)
        return
    # pixels along the rim of an image 400 across count right to some 1 in 500, a sliver's fewer to 1 in 200; corners
    # of a cut image cost K = 96 points as much
    slack = 2e-2 if "sliver" in case else 5e-3
    assert image.area == pytest.approx(area, rel=slack)
    size = np.sqrt(area)
    np.testing.assert_allclose(image.centroid, centroid, rtol=0, atol=slack * size)
    np.testing.assert_allclose(image.second_moments, moments, rtol=0, atol=slack * size**2)
    if status == ImageFate.FULL:
        assert image.kept_fraction == 1
    if status == ImageFate.CLIPPED:
        assert image.kept_fraction == pytest.approx(seen, rel=2 * slack)
    if status == ImageFate.FOLDED:
        assert 0 < image.kept_fraction < 1 < image.area / thin_disc(camera, c)[0]


@pytest.mark.parametrize("place", [(16.0, 3.0), (17.4, 0.0), (12.0, 9.0), (24.0, 0.0)])
def test_cut_images_against_thousands_of_spokes(place):
    camera = bench("lb1630-a")
    image, (area, ratio, kept) = real_images(camera, place), lit_part(camera, np.array(place))
    assert image.kept_fraction == pytest.approx(kept, abs=4e-6)  # corners cost polygons 20/K^2
    assert image.area == pytest.approx(area, rel=1e-5)
    assert image.axis_ratio == pytest.approx(ratio, abs=4e-6)  # corners cost polygons 20/K^2
    if area:  # the boundary that is drawn has its corners: 96 chords leave out 7e-4 of a disc, of a sliver some more
        x, y = (image.boundary - image.centroid).T
        assert abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) / 2 == pytest.approx(
            area, rel=1.5e-3 if kept > 0.1 else 4e-3
        )


def test_a_whole_image_converges_with_its_boundary_points():
    camera = bench("lb1630-a")
    whole, dense = (real_images(camera, [9.0, 3.0], points=k) for k in (48, 192))
    assert whole.area == pytest.approx(float(dense.area), rel=1e-12)


def test_inverse_map_is_an_inverse():
    camera = bench("la1050-a", reverse=True)
    rng = np.random.default_rng(5)
    c, a = rng.uniform(-8, 8, (60, 2)), rng.uniform(-1.2, 1.2, (60, 2))
    found = sensor_of_pupil(camera, c, a)
    assert found.ok.all()
    np.testing.assert_allclose(views(camera, c, found.sensor, clip=False).pupil, a, rtol=0, atol=3e-11)


def test_a_round_lens_knows_no_direction():
    camera = bench("ac508-100-a")
    angle = 0.7
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    c = np.array([[9.0, 2.0], [15.0, 1.0]])
    straight, turned = real_images(camera, c), real_images(camera, c @ turn.T)
    np.testing.assert_array_equal(straight.status, turned.status)
    np.testing.assert_allclose(turned.area, straight.area, rtol=2e-3)
    np.testing.assert_allclose(turned.area[0], straight.area[0], rtol=1e-11)
    np.testing.assert_allclose(turned.centroid[0], turn @ straight.centroid[0], atol=1e-12)
    mirrored = real_images(camera, c * [1, -1])
    np.testing.assert_allclose(mirrored.area, straight.area, rtol=2e-3)


def test_batches_keep_their_places():
    camera = bench("lb1630-a")
    grid = np.stack(np.meshgrid(np.linspace(-9, 9, 5), np.linspace(-6, 6, 17)), axis=-1)
    images = real_images(camera, grid)
    assert images.area.shape == (17, 5)
    assert images.outline.shape == (17, 5, 96, 2)
    np.testing.assert_allclose(images.area[3, 4], real_images(camera, grid[3, 4]).area, rtol=1e-12)


def test_a_decentred_lens_shifts_the_images_as_the_bench_does():
    camera = bench("ac508-100-a")
    moved = replace(camera, lens=as_made(camera.lens, {"elements.1.decentre.0": 0.5}, GREEN))
    there = real_images(moved, [3.0, 0.0])
    # the same as lens at rest, with the array, the sensor and the FAP moved the other way
    still = replace(camera, rims=(replace(camera.fap, x=-0.5),))
    here = real_images(still, [2.5, 0.0])
    np.testing.assert_allclose(there.centroid, here.centroid, rtol=0, atol=1e-11)
    assert there.area == pytest.approx(float(here.area), rel=1e-11)


def test_states_say_which_stop_took_a_ray():
    camera = bench("lb1630-a", stops=(TracedPlane(-60.0, 0.0, 1.0, diameter=6.0),))
    side = np.linspace(-0.4, 0.4, 161)
    p = np.stack(np.meshgrid(side, side), axis=-1) + 5.0
    at = views(camera, [5.0, 5.0], p)
    told = {camera.describe(int(code)) for code in np.unique(at.state)}
    assert {"kept", "clipped at FAP", "clipped at stop 1", "clipped at surface 2"} <= told
    kept = at.state == 0
    np.testing.assert_array_equal(kept, (at.margin >= 0) & (at.fap_margin >= 0))
    loose = views(camera, [5.0, 5.0], p, clip=False)
    assert (loose.state == 0).all()
    np.testing.assert_array_equal(loose.margin[kept], at.margin[kept])
    cut = real_images(camera, [5.0, 5.0])
    assert cut.status == ImageFate.CLIPPED
    near = np.linspace(-0.03, 0.03, 301)
    p = 5.0 + cut.centroid + np.stack(np.meshgrid(near, near), axis=-1)
    count = np.sum(views(camera, [5.0, 5.0], p).state == 0)
    assert cut.area == pytest.approx(count * (near[1] - near[0]) ** 2, rel=5e-3)


def moments_inside(points):
    """Area, centroid and moments inside a curve through points, as of an image that nothing cuts."""
    area, x, y, *moments = Outlines.of(AimedRays(points[None], np.empty((1, len(points), 0))), straight=False).shape[0]
    return area, np.array([x, y]), moments


def test_moments_of_discs_ellipses_and_half_discs():
    t = 2 * np.pi * np.arange(40) / 40
    ellipse = np.stack([3 + 2 * np.cos(t), -1 + 0.5 * np.sin(t)], axis=-1)
    area, centroid, moments = moments_inside(ellipse[::-1])
    assert area == pytest.approx(np.pi, rel=1e-14)
    np.testing.assert_allclose(centroid, [3, -1], atol=1e-14)
    np.testing.assert_allclose(moments, [1, 0, 1 / 16], atol=1e-14)
    k = 400
    t = 2 * np.pi * np.arange(k) / k
    radius = np.minimum(1.0, 0.4 / np.maximum(np.cos(t), 1e-9))  # a disc cut straight at x = 0.4
    area, centroid, _ = moments_inside(np.stack([radius * np.cos(t), radius * np.sin(t)], axis=-1))
    cap = np.arccos(0.4) - 0.4 * np.sqrt(1 - 0.16)
    assert area == pytest.approx(np.pi - cap, rel=20 / k**2)
    assert centroid[0] == pytest.approx(-2 / 3 * (1 - 0.16) ** 1.5 / (np.pi - cap), abs=20 / k**2)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"distance": 1.0}, "inside the lens"),
        ({"distance": 400.0}, "must lie in front of the flexible angular plane"),
        ({"pupil": 0.0}, "must be greater than zero"),
        ({"stops": (TracedPlane(3.0, diameter=5.0),)}, "inside the lens"),
        ({"stops": (TracedPlane(-900.0, diameter=5.0),)}, "must lie in front"),
    ],
)
def test_cameras_that_cannot_be_built(change, told):
    with pytest.raises(LensError, match=told):
        bench("LB1630-A", **change)
    with pytest.raises(LensError, match="behind the microlens array"):
        replace(bench("LB1630-A"), detector=TracedPlane(0.0))
