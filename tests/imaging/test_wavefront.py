"""Waves of points through exact elements, against optical paths through tilted glass, and Snell's law at 30 digits."""

import math

import mpmath as mp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from roslf_design.camera import Camera
from roslf_design.design import load
from roslf_design.effects import Budget
from roslf_design.imaging.camera import Region
from roslf_design.imaging.points import PointSource, point_image
from roslf_design.imaging.render import render
from roslf_design.imaging.wavefront import Wavefront
from roslf_design.scenes import Points, Scene
from roslf_design.theory.object_space import ObjectSpaceFaces
from tests.oracles import coherent

PAPER = load("paper")
INDEX, THICK, TILT = 1.5, 160.0, 0.25
SLAB = {"kind": "plate", "distance": 150.0, "thickness": THICK, "material": {"index": INDEX}, "tilt": (0.0, TILT)}


def behind(element, **changes):
    design = PAPER.replace({"elements": [element], **changes})
    return design, float(design.elements[0].material.index(design.wavelength))


def source_at(design, place, exact=True):
    camera = Camera.of(design)
    seen = [float(part) for part in camera.image_of(*place)]
    return PointSource(camera, *seen, tuple(place) if exact else None)


def central(design, side):
    width, height = design.pixels
    return Region(width // 2 - side // 2, height // 2 - side // 2, side, side)


def test_a_wave_through_a_leaning_slab_against_optical_paths_through_the_whole_camera():
    """Astigmatism of 0.2 waves: paths by Snell's law from the point to every sample of the FAP, then by FFT."""
    design, n = behind(SLAB, **{"main_lens.focal_plane": 350.0 + THICK * (1 - 1 / INDEX)})
    z = design.d_f - 15.0
    axis = ObjectSpaceFaces.of(Camera.of(design)).rays((0.0, 0.0), (0.0, 0.0))
    place = np.array([*axis.height - axis.slope * z + [0.02, 0.03], z])

    def path(x, y):
        """Between the point and the FAP, from the tangents of the angles to the slab's normal."""
        normal = np.array([math.sin(TILT), 0.0, math.cos(TILT)])
        run = np.stack(np.broadcast_arrays(x - place[0], y - place[1], place[2] - design.d_3), axis=-1)
        along = run @ normal
        aside = np.sqrt(np.sum(run**2, axis=-1) - along**2)
        sine = aside / np.hypot(aside, along)
        for _ in range(60):
            inside = sine / np.sqrt(n * n - sine * sine)
            miss = (along - THICK) * sine / np.sqrt(1 - sine * sine) + THICK * inside - aside
            if np.abs(miss).max() < 1e-13:
                break
            sine = sine - miss / ((along - THICK) / (1 - sine * sine) ** 1.5 + THICK * n * n / (n * n - sine**2) ** 1.5)
        return (along - THICK) / np.sqrt(1 - sine * sine) + n * THICK / np.sqrt(1 - (sine / n) ** 2)

    region, seen = central(design, 52), Camera.of(design)
    edges = (np.arange(53) - 26) * design.q
    air = PAPER.replace({"main_lens.focal_plane": float(seen.seen.d_f)})
    truth = coherent.pixel_sums(*coherent.sensor_intensity(air, (0.0, 0.0, 340.0), path=path), edges)
    image = point_image(source_at(design, place), region, (design.wavelength,), 4e-3)
    error = image - truth
    assert np.abs(error).max() < 4e-3 * truth.max()  # as in air
    assert np.sqrt(np.mean(error**2)) < 1e-3 * truth.max()


def test_the_path_is_the_integral_of_exact_slopes():
    """On the axis: slopes by Snell's law; and for small angles the optical path's own fourth power."""
    plate = {"kind": "plate", "distance": 122.0, "thickness": 40.0, "material": {"index": INDEX}}
    design, n = behind(plate, **{"main_lens.focal_plane": 350.0, "aperture.diameter": 8.0, "aperture.distance": 120.0})
    z = 200.0
    source = source_at(design, (0.0, 0.0, z))
    front = Wavefront.of(source, design.wavelength)
    with mp.workdps(30):

        def height(tan):
            sine = tan / mp.sqrt(1 + tan**2) / mp.mpf(n)
            return (z - 120 - 40) * tan + 40 * sine / mp.sqrt(1 - sine**2)

        def extra(a):
            tan = mp.findroot(lambda t: height(t) - a, a / (z - 120 - 40 + 40 / mp.mpf(n)))
            return tan - a / source.reach

        for a in (1.0, 3.9):
            truth = float(mp.quad(extra, [0, a]))
            found = float(front.path(np.array([a, 0.0])) - front.path(np.zeros(2)))
            assert found == pytest.approx(truth, abs=1e-11)
            angle = a / source.reach
            # The optical path's own: t (n^2 - 1)/(8 n^3) angle^4, here with tangents in place of sines.
            assert abs(found) == pytest.approx((n * n - 1) / (8 * n**3) * 40 * angle**4, rel=0.7)


BOX = {"shape": "rectangle", "sides": (2.9, 1.6), "turn": 0.35, "distance": 120.0}


@pytest.mark.parametrize(("distance", "changes"), [(60.0, {}), (125.0, {}), (60.0, {"aperture": BOX})])
def test_glass_of_index_1_leaves_the_image(distance, changes):
    """The quadrature over the traced opening against that over the disc, or the rectangle."""
    design, _ = behind({**SLAB, "distance": distance, "thickness": 5.0, "material": {"index": 1.0}}, **changes)
    region, place = central(design, 78), (0.05, -0.02, 330.0)
    one, other = (point_image(source_at(design, place, e), region, (design.wavelength,), 0.05) for e in (True, False))
    assert_allclose(one, other, rtol=0, atol=1e-4 * other.max())


def test_rays_and_waves_put_a_point_behind_thick_glass_at_the_same_place():
    plate = {"kind": "plate", "distance": 125.0, "thickness": 60.0, "material": {"index": 1.7}, "diameter": 60.0}
    design, _ = behind(
        plate, **{"main_lens.focal_plane": 380.0, "sensor.size": (1.0, 1.0), "sensor.decentre": (-9.8, 0.0)}
    )
    scene = Scene(objects=(Points(positions=((21.8, 0.0, 350.0),)),))
    on = ["none", "+overlap", "+object_defocus", "+finite_microlens_aperture", "+decentres", "+vignetting"]
    exact = [*on, "+plate_aberration"]
    rays, waves = (
        render(design, scene, budget=Budget(intensity=0.05), overrides=how).pixels
        for how in (exact, [*exact, "+fap_diffraction", "+microlens_diffraction"])
    )
    x = (np.arange(rays.shape[1]) + 0.5) * design.q

    def middle(image):
        return float(image.sum(0) @ x / image.sum())

    assert rays.sum() == pytest.approx(1.0, abs=0.02)
    assert middle(waves) == pytest.approx(middle(rays), abs=0.2 * design.d)


def test_light_that_glass_stops_is_missing():
    plate = {"kind": "plate", "distance": 125.0, "thickness": 5.0, "material": {"index": 1.7}, "diameter": 2.0}
    design, _ = behind(plate)
    region, place = central(design, 104), (0.0, 0.0, 345.0)
    image = point_image(source_at(design, place), region, (), 0.02)
    # Of the pencil, 2.9 mm wide at the FAP, a disc of about 2 mm.
    assert 0.3 < image.sum() < 0.7
    dark = behind({**plate, "diameter": 1e-3, "decentre": (1.0, 0.0), "thickness": 1.0})[0]
    assert point_image(source_at(dark, (-30.0, 0.0, 345.0)), region, (design.wavelength,), 0.02).sum() == 0
