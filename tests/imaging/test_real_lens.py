"""Images through a real main lens: against pixels summed by hand, outlines traced on their own, and the thin limit."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose

from roslf_design.camera import Camera
from roslf_design.cli import main
from roslf_design.design import load
from roslf_design.effects import plan
from roslf_design.errors import InputError
from roslf_design.imaging.camera import Region
from roslf_design.imaging.lens_rays import real_camera
from roslf_design.imaging.render import render
from roslf_design.imaging.sampling import even_sampling, rays_for
from roslf_design.imaging.trace import RaySampling
from roslf_design.scenes import WHITE_FIELD, Checkerboard, Plane, Points, Scene, Sinusoid, Sphere
from roslf_design.traced.camera import camera_of, microlenses, views
from roslf_design.traced.images import real_field

# A small sensor far off the axis keeps the array, and so the test, small.
EDGE = {"microlens_array.size": (1.6, 1.6), "sensor.size": (0.6, 0.6)}


def bench(lens="LB1630-A", off=0.0, **changes):
    """The singlet bench with its array and sensor cut down and moved `off` along x [mm]."""
    there = {"microlens_array.decentre": (off, 0.0), "sensor.decentre": (off * (1 - 0.0045), 0.0)} if off else {}
    return load("paper-singlet").replace({"main_lens.prescription": lens, **EDGE, **there, **changes})


BARE = ["none", "+lens_distortion", "+overlap", "+decentres", "+vignetting"]


RECTANGLES = {
    "aperture": {"shape": "rectangle", "sides": (2.9, 2.2), "turn": 0.4, "distance": 120.0},
    "stops": [{"shape": "rectangle", "sides": (14.0, 9.0), "turn": 0.2, "distance": 60.0}],
}


@pytest.mark.parametrize(
    ("lens", "off", "changes"),
    [("LB1630-A", 0.0, {}), ("LA1050-A", 11.0, {}), ("AC508-100-A", 11.0, {}), ("LA1050-A", 9.0, RECTANGLES)],
)
def test_light_of_one_microlens_is_the_area_of_its_image(lens, off, changes):
    design = bench(lens, off, **changes)
    camera = real_camera(design, WHITE_FIELD, plan(design, overrides=BARE))
    m = int(np.argmin(np.hypot(*(camera.microlenses - [off, 0.0]).T)))
    alone = dataclasses.replace(camera, microlenses=camera.microlenses[m : m + 1], boxes=camera.boxes[m : m + 1])
    width, height = design.pixels
    image, _ = alone.image(Region(-60, -60, width + 120, height + 120), RaySampling())
    place = camera.microlenses[m] - design.microlens_array.decentre
    area = float(real_field(design, [tuple(place)]).images.area[0]) / design.q**2
    # Samples on the rim count by a linear share of a curved edge: some 5e-4 of the area at 4 x 4 samples a pixel.
    assert image.sum() == pytest.approx(area, rel=1.5e-3)


def by_hand(design, scene_at, column, row, microlens_near, count=24):
    """One pixel: every microlens nearby, a regular grid of points on the pixel, exact rays, what they meet."""
    camera = camera_of(design)
    width, height = design.pixels
    side = (np.arange(count) + 0.5) / count
    x = (column + side - width / 2) * design.q + design.sensor.decentre[0] - design.main_lens.decentre[0]
    y = (row + side - height / 2) * design.q + design.sensor.decentre[1] - design.main_lens.decentre[1]
    p = np.stack(np.meshgrid(x, y), axis=-1)
    total = 0.0
    steps = np.arange(-4, 5) * design.d
    for u in steps:
        for v in steps:
            (c,) = microlenses(design, [np.add(microlens_near, (u, v))])
            seen = views(camera, c, p)
            lit = seen.state == 0
            total += float(np.mean(np.where(lit, scene_at(seen, camera), 0.0)))
    return total


PIXELS = [(30, 40), (61, 61), (62, 67), (70, 52), (90, 85)]


def middle(design):
    """Nearest lattice point of the array to what the sensor's middle sees, in the array's frame."""
    return np.zeros(2)


@pytest.mark.parametrize("off", [0.0, 11.0])
def test_white_pixels_by_hand(off):
    design = bench("LB1630-A", off)
    image = render(design, overrides=BARE).pixels
    for column, row in PIXELS:
        wanted = by_hand(design, lambda seen, camera: 1.0, column, row, middle(design))
        # 24 x 24 points decide a pixel that a rim crosses to about 1/100.
        assert image[row, column] == pytest.approx(wanted, abs=0.02)


@pytest.mark.parametrize("off", [0.0, 11.0])
def test_textured_pixels_by_hand(off):
    design = bench("LB1630-A", off)
    scene = Scene(objects=(Plane(distance=300.0, texture=Sinusoid(period=3.0)),))
    on = [*BARE, "+object_defocus", "+lens_aberrations", "+field_curvature"]
    image = render(design, scene, overrides=on).pixels

    def grating(seen, camera):
        x = seen.at(300.0 - camera.d_3)[..., 0]
        return 0.5 * (1 + np.cos(2 * np.pi / 3.0 * x))

    for column, row in PIXELS:
        wanted = by_hand(design, grating, column, row, middle(design))
        assert image[row, column] == pytest.approx(wanted, abs=0.02)


@pytest.mark.parametrize("kind", ["checkerboard", "sphere"])
def test_towards_the_axis_of_a_corrected_lens_the_ideal_tracer_agrees(kind):
    """Same scene, same effects, two tracers: the paper's bench near its axis behind an achromat of 150 mm."""
    design = bench("AC508-150-A")
    thing = {
        "checkerboard": Plane(distance=320.0, texture=Checkerboard(period=2.0), tilt=(0.2, -0.1)),
        "sphere": Sphere(distance=340.0, radius=15.0, centre=(1.0, 0.5), texture=Checkerboard(period=2.0)),
    }[kind]
    scene = Scene(objects=(thing,), background=0.1)
    on = ["none", "+overlap", "+object_defocus", "+vignetting", "+finite_microlens_aperture"]
    real = render(design, scene, overrides=[*on, "+lens_aberrations"]).pixels
    thin = render(design.thin_twin, scene, overrides=on, sampling=RaySampling(1024, 1024)).pixels
    assert abs(real.mean() - thin.mean()) < 3e-3
    # 36 samples a pixel through the whole microlens leave noise; the images agree beyond it.
    assert np.sqrt(np.mean((real - thin) ** 2)) < 0.05
    assert np.corrcoef(real.ravel(), thin.ravel())[0, 1] > 0.99


WINDOW = {"kind": "plate", "distance": 118.0, "thickness": 1.0, "material": "sapphire", "diameter": 30.0}
ROD = {"kind": "grin", "distance": 60.0, "thickness": 7.0, "index": 1.6, "gradient": 0.01, "diameter": 40.0}
IN_WATER = {"elements": [ROD, WINDOW], "object_space.medium": "water", "aperture.distance": 115.0}


@pytest.mark.parametrize("fap", [115.0, 125.0])
def test_pixels_through_a_rod_and_a_window_by_hand(fap):
    design = bench("LB1630-A", 6.0, **{**IN_WATER, "aperture.distance": fap})
    scene = Scene(objects=(Plane(distance=330.0, texture=Sinusoid(period=3.0)),))
    on = [*BARE, "+object_defocus", "+lens_aberrations", "+field_curvature"]
    textured, white = render(design, scene, overrides=on).pixels, render(design, overrides=BARE).pixels

    def grating(seen, camera):
        return 0.5 * (1 + np.cos(2 * np.pi / 3.0 * seen.at(330.0 - design.d_3)[..., 0]))

    for column, row in PIXELS[:3]:
        wanted = by_hand(design, grating, column, row, middle(design))
        assert textured[row, column] == pytest.approx(wanted, abs=0.02)
        wanted = by_hand(design, lambda seen, camera: 1.0, column, row, middle(design))
        assert white[row, column] == pytest.approx(wanted, abs=0.02)


@pytest.mark.parametrize("defocus", ["+object_defocus", "-object_defocus"])
def test_behind_a_window_too_the_ideal_tracer_agrees_near_the_axis(defocus):
    design = bench("AC508-150-A", **IN_WATER)
    scene = Scene(objects=(Plane(distance=330.0, texture=Checkerboard(period=2.0)),), background=0.1)
    on = ["none", "+overlap", "+vignetting", "+finite_microlens_aperture", defocus]
    real = render(design, scene, overrides=[*on, "+lens_aberrations"]).pixels
    thin = render(design.thin_twin, scene, overrides=on, sampling=RaySampling(1024, 1024)).pixels
    # 36 samples a pixel through the whole microlens leave noise; the images agree beyond it.
    assert np.sqrt(np.mean((real - thin) ** 2)) < 0.05
    assert np.corrcoef(real.ravel(), thin.ravel())[0, 1] > 0.99


def test_a_window_of_index_1_leaves_the_picture():
    plain = bench("LB1630-A", 6.0, **{"aperture.distance": 115.0})
    empty = plain.replace({"elements": [{**WINDOW, "material": {"index": 1.0}, "diameter": 60.0}]})
    scene = Scene(objects=(Plane(distance=330.0, texture=Sinusoid(period=3.0)),))
    for what in (scene, None):
        assert_allclose(
            render(empty, what, overrides=BARE).pixels, render(plain, what, overrides=BARE).pixels, atol=1e-5
        )


def test_parts_of_the_sensor_are_parts_of_the_image():
    design = bench("LA1050-A", 11.0)
    # Without diffraction, whose tiles end elsewhere for another region.
    whole, part, again = (render(design, overrides=BARE, region=piece) for piece in (None, *[(30, 20, 40, 50)] * 2))
    assert_allclose(part.pixels, whole.pixels[20:70, 30:70], atol=1e-5)
    assert np.array_equal(part.pixels, again.pixels)


def test_all_faults_off_is_the_thin_twin():
    design = bench("LB1630-A")
    off = ["-lens_aberrations", "-lens_distortion", "-field_curvature", "-lens_colour"]
    assert np.array_equal(render(design, overrides=off).pixels, render(design.thin_twin).pixels)


def test_skipped_distortion_moves_images_by_less_than_its_estimate():
    design = bench("LB1630-A", 3.0)
    brief = plan(design)["lens_distortion"]
    with_it, without = (
        render(design, overrides=["none", "+overlap", "+decentres", sign + "lens_distortion"]).pixels for sign in "+-"
    )
    # A rim moved by t changes a pixel on it by t at most, and images have two rims a pitch apart.
    assert np.max(np.abs(with_it - without)) <= 2 * abs(brief.estimate) + 0.02


def test_colours_take_their_own_ways():
    design = bench("LB1630-A", 11.0)
    waves = (486.1e-6, 656.3e-6)
    scene = Scene(objects=(Plane(texture=Sinusoid(period=4.0)),), light={"wavelengths": waves})
    on = ["none", "+overlap", "+decentres", "+vignetting", "+lens_aberrations", "+lens_colour"]
    both = render(design, scene, overrides=on).pixels
    single = [
        render(design, Scene(objects=scene.objects, light={"wavelengths": (wave,)}), overrides=on).pixels
        for wave in waves
    ]
    assert_allclose(both, np.mean(single, axis=0), atol=2e-3)
    assert np.max(np.abs(single[0] - single[1])) > 0.2


def test_what_is_not_rendered_is_refused_in_one_line():
    points = Scene(objects=(Points(positions=((0.0, 0.0, 350.0),)),))
    with pytest.raises(InputError, match="point sources behind a real main lens are not rendered; switch off"):
        render(load("paper-singlet"), points)
    with pytest.raises(InputError, match="a tilted sensor behind a real main lens is not rendered; add -tilts"):
        render(bench().replace({"sensor.tilt": (0.02, 0.0)}), overrides=["+tilts", "+lens_distortion"])
    textured = Scene(objects=(Plane(texture=Sinusoid(period=3.0)),))
    with pytest.raises(InputError, match="FAP diffraction alone"):
        render(bench(), textured, overrides=["none", "+lens_distortion", "+fap_diffraction", "+overlap"])


def test_command(tmp_path, capsys):
    target = tmp_path / "w.tif"
    assert main(["render", "paper-singlet", "--region", "4500,1500,40,40", "-o", str(target)]) == 0
    assert target.exists()
    assert "lens_distortion" in capsys.readouterr().out
    scene = tmp_path / "p.toml"
    scene.write_text('[[objects]]\nkind = "points"\npositions = [["0 mm", "0 mm", "350 mm"]]\n')
    assert main(["render", "paper-singlet", "--scene", str(scene), "-o", str(tmp_path / "p.tif")]) == 2
    err = capsys.readouterr().err
    assert len(err.splitlines()) == 1
    assert "point sources behind a real main lens" in err


def test_uniform_light_through_pinholes_is_out_of_focus_whatever_is_asked_of_apertures():
    """A white field has no detail that a whole microlens could blur: its rays go through middles, in focus."""
    design = load("paper-singlet").replace(f_ml=3.0)
    one, other = (
        render(design, region=(2280, 1520, 8, 8), overrides=[f"{sign}finite_microlens_aperture"]).pixels
        for sign in "+-"
    )
    np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("preset", ["paper-singlet", "arthroscope", "cystoscope"])
def test_no_fewer_samples_behind_a_real_lens_than_rays(preset):
    """Half as many along a side shifted all depths of a region alike, by 1.6 of their noise (proof, "drawn 20")."""
    camera = Camera.of(load(preset).thin_twin)
    for rays in (rays_for(camera), 4, 31, 64):
        assert even_sampling(camera, rays, 0).side ** 2 >= rays
