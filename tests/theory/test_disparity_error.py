"""Light, noise and texture against numbers by hand, textbook limits and differences of rendered pictures."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import brentq
from scipy.special import jv, ndtr

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.evaluation import default_fields
from roslf_design.shapes.lattice import PACKINGS
from roslf_design.theory.depth_error import seen_at
from roslf_design.theory.disparity_error import (
    _disparity_information,
    axial_disparity_sigma,
    disparity_sigma,
    view_gradient,
)
from roslf_design.theory.disparity_information import Seen, Spectrum, _bessel_quotients, overlapping
from roslf_design.theory.exit_pupil import microlens_image_diameter, microlens_image_pitch
from roslf_design.theory.image_parts import AS_IT_IS, image_parts, light_read, whole_light
from roslf_design.theory.lens_shapes import LENS_SHAPES
from roslf_design.theory.photometry import dark_variance, electrons, exposure
from roslf_design.theory.quantities import QUANTITIES
from roslf_design.theory.stop_images import MicrolensImages
from studies.depth.prediction_proof import rendered_information

PAPER = roslf.load("paper")
SHORT = {"light.wavelength": 1e-9, "depth.window": 1}
"""Rays: nothing diffracts. (Through the whole design, 1e-9 mm is the finest wavelength that makes sense.)"""


def information(design, field=(0.0, 0.0), disparity=0.0):
    """One microlens's, of the texture that the design assumes."""
    camera = Camera.of(design)
    seen = seen_at(camera, None)._replace(disparity=np.asarray(disparity))
    return float(_disparity_information(MicrolensImages(camera, [field]), seen)[0, 0])


def test_electrons_by_hand():
    """1e5 lx, 30 % reflectance, 1/60 s at the paper's bench: 1.0e4 (h = 6.62607015e-34 J s, c = 299 792 458 m/s)."""
    design = PAPER.replace({"light.exposure": 1 / 60})
    radiance = 1e5 * 0.3 / np.pi / 683  # W/m^2/sr
    watts = radiance * (4.847826e-6) ** 2 * (63e-6 / 2e-3) ** 2 * 0.95
    photons = watts / 60 * 550e-9 / (6.62607015e-34 * 299_792_458)
    assert float(electrons(Camera.of(design))) == pytest.approx(photons * 0.7, rel=1e-6)
    assert float(electrons(Camera.of(design))) == pytest.approx(1.0e4, rel=0.01)
    direct = design.replace({"light.radiance": radiance})
    assert float(electrons(Camera.of(direct))) == pytest.approx(photons * 0.7, rel=1e-6)


def submerged(index, **light):
    """The paper's bench behind a window of sapphire, the scene in a medium; exposed for 1 ms."""
    window = {"kind": "plate", "distance": 125.0, "thickness": 2.0, "material": "sapphire"}
    seen = {"elements": [window], "object_space.medium": {"index": index}, "light.exposure": 1e-3}
    return PAPER.replace({**seen, **{f"light.{name}": value for name, value in light.items()}})


def electrons_of_rays(design, index, radiance):
    """By the light that rays carry: radiance times area, solid angle and cosine on the scene, added up ray by ray.

    A pixel's rays through its microlens, bent at both faces of the window; the etendue that their bundle has on the
    scene, from differences of where they end there and of their sines, about the middle one.
    """
    glass, at_window, thick = 1.7708, 125.0, 2.0
    d_1, f, d_2 = design.d_1, design.f, design.d_2

    def on_scene(pixel, lens, z=300.0):
        slope = (pixel - lens) / d_2
        out = slope + (lens - slope * d_1) / f
        sine = out / math.hypot(1, out)
        inside, wet = sine / glass, sine / index
        x = lens - slope * d_1 - out * at_window - thick * inside / math.sqrt(1 - inside**2)
        return x - (z - at_window - thick) * wet / math.sqrt(1 - wet**2), wet

    small = 1e-5
    rows = [[a - b for a, b in zip(on_scene(*up), on_scene(*down), strict=True)] for up, down in (
        ((small, 0.0), (-small, 0.0)), ((0.0, small), (0.0, -small)))]  # fmt: skip
    across = abs(rows[0][0] * rows[1][1] - rows[0][1] * rows[1][0]) / (2 * small) ** 2
    # Per area of pixel and microlens, in both directions.
    etendue = (across * design.q * design.d) ** 2 * 1e-6
    photons = radiance * etendue * 0.95 * 1e-3 * 550e-9 / (6.62607015e-34 * 299_792_458)
    return photons * 0.7


@pytest.mark.parametrize("index", [1.0, 1.3343, 1.52])
def test_out_of_a_liquid_comes_what_rays_carry(index):
    """Radiance over n^2 is what stays: of a lit surface, and of a radiance that is given in the liquid."""
    radiance = 1e5 * 0.3 / np.pi / 683
    for design in (submerged(index), submerged(index, radiance=radiance)):
        by_rays = electrons_of_rays(design, index, radiance)
        assert float(electrons(Camera.of(design))) == pytest.approx(by_rays, rel=1e-6)


@pytest.mark.parametrize("number", ["D_F", "d_2", "d", "d_3", "q"])
def test_a_changed_camera_has_the_light_that_its_own_rays_carry(number):
    """Same lamp and exposure, as optimisers and builds have them: no wider FAP makes a pixel brighter."""
    design = submerged(1.0)
    values = getattr(design, number) * np.array([0.7, 1.0, 1.4])
    many = electrons(Camera.of(design, {number: values}))
    by_rays = [electrons_of_rays(design.replace({number: value}), 1.0, 1e5 * 0.3 / np.pi / 683) for value in values]
    np.testing.assert_allclose(np.broadcast_to(many, 3), by_rays, rtol=1e-6)


def test_the_cystoscope_in_water_has_the_electrons_of_water():
    design = roslf.load("cystoscope")
    in_air = design.replace({"object_space.medium": "air"})
    both = [roslf.evaluate(d.replace({"light.exposure": 1 / 60})).depth for d in (design, in_air)]
    assert both[0].assumes.electrons == pytest.approx(2846, abs=1)
    assert both[1].assumes.electrons / both[0].assumes.electrons == pytest.approx(1.3343**2, rel=1e-4)


def test_no_exposure_given_leaves_half_of_the_full_well_free():
    camera = Camera.of(PAPER)
    assert float(electrons(camera)) == pytest.approx(0.5 * 10_500)
    assert float(exposure(camera)) < 1 / 60
    dim = Camera.of(PAPER.replace({"light.illuminance": 1e3}))
    assert float(exposure(dim)) == pytest.approx(1 / 60)
    assert float(electrons(dim)) == pytest.approx(100, rel=0.01)


def test_round_microlenses_get_pi_quarters_of_the_light():
    given = PAPER.replace({"light.exposure": 1e-3})
    circular = given.replace({"microlens_array.lens_shape": "circular"})
    assert float(electrons(Camera.of(circular)) / electrons(Camera.of(given))) == pytest.approx(np.pi / 4)


def test_rays_of_a_whole_disc():
    """Without diffraction J is N n/16 less what a pixel mixes, q^2/12: sigma_B = 1/(G sqrt(M N n/16))."""
    fine = PAPER.replace(
        {**SHORT, "sensor.pixel": PAPER.q / 8, "light.exposure": 1.0, "sensor.full_well": 1e9}, D_F=1.5
    )
    camera = Camera.of(fine)
    n = np.pi / 4 * (float(QUANTITIES["image_diameter_px"](camera))) ** 2
    shot = float(electrons(camera)) ** 2 / float(electrons(camera) + dark_variance(camera))
    gradient = float(view_gradient(camera, seen_at(camera, None)))
    # Extrapolated in the blur: to 1 %.
    assert information(fine) == pytest.approx(gradient**2 * shot * n / 16, rel=0.01)


@pytest.mark.parametrize(("kept", "cost"), [(0.62, 1.9), (0.39, 3.4), (0.20, 7.4)])
def test_cut_images_cost_what_their_second_moment_says(kept, cost):
    """Rays, a second stop with an image as large as the FAP's: across the cut 1.9, 3.4 and 7.4 times in sigma."""
    both = {"main_lens.diameter": PAPER.D_F * float(Camera.of(PAPER).H), "sensor.pixel": PAPER.q / 8}
    bare = PAPER.replace({**SHORT, **both, "sensor.read_noise": 0.0, "sensor.bits": 24})
    camera = Camera.of(bare)

    def at(x):
        return float(MicrolensImages(camera, [(x, 0.0)]).shapes.kept_fraction[0, 0])

    x = brentq(lambda x: at(x) - kept, 0.01, 3.2)
    shapes = MicrolensImages(camera, [(x, 0.0)]).shapes
    along, _, across = shapes.second_moments[0, 0] / (
        float(MicrolensImages(camera, [(0, 0)]).openings.radii[0, 0, 0]) ** 2 / 4
    )
    assert 1 / np.sqrt(kept * along) == pytest.approx(cost, rel=0.035)  # printed to two digits, as the share kept is
    # The texture has all directions: the mean of both.
    expected = kept * (along + across) / 2
    # Extrapolated in the blur: thin images to 3 % of sigma.
    assert np.sqrt(information(bare, (x, 0.0)) / information(bare) / expected) == pytest.approx(1.0, abs=0.03)


# --- against differences of rendered pictures ---------------------------------------------------------------------


CUT = PAPER.replace({"main_lens.diameter": 20.0})


@pytest.mark.parametrize(
    ("design", "field", "periods", "disparity"),
    [
        (PAPER, (0.0, 0.0), 0.25, 0.0),
        (PAPER, (0.0, 0.0), 0.25, 1.0),
        (roslf.load("paper-mismatched"), (9.0, 0.0), 0.25, 0.5),
        (PAPER.replace({"aperture.diameter": 1.3 * PAPER.D_F}), (0.0, 0.0), 0.25, 0.5),
        (CUT, (6.3, 0.0), 0.25, 0.0),
        (CUT, (7.3, 0.0), 0.25, 0.5),
    ],
    ids=["matched", "out of focus", "gaps", "overlap", "barely cut", "half cut"],
)  # fmt: skip
def test_prediction_against_differences_of_rendered_pictures(design, field, periods, disparity, light_from_48_px):
    """To 2 % of sigma, for a grating along x and one along y."""
    camera = Camera.of(design)
    power = np.full(1, 0.5**2 / 2 * np.sinc(periods) ** 2)
    for angle, x, y in ((0.0, periods, 0.0), (np.pi / 2, 0.0, periods)):
        brute = rendered_information(design, field, periods, angle, disparity)
        wave = Spectrum(np.array([x]), np.array([y]), power)
        seen = seen_at(camera, None)._replace(disparity=np.asarray(disparity))
        ours = float(_disparity_information(MicrolensImages(camera, [field]), seen, wave)[0, 0])
        assert np.sqrt(brute / ours) == pytest.approx(1.0, abs=0.02), angle


def misled(design, disparity, finest, side=21, fine=12, draws=6):
    """Variance of B by waves that fold, of one microlens [pitches^2]: by fits to samples of a torus of microlenses.

    Every sample counts alike. Waves' images are drawn on a grid, blurred there and laid on their neighbours'; beside B
    a picture at the lattice is fitted, freely.
    """
    c = Camera.of(design)
    pitch = float(microlens_image_pitch(c))
    wide = abs(float(microlens_image_diameter(c))) / pitch
    reach, many = 2, 8
    p = (np.arange((2 * reach + 1) * fine) + 0.5) / fine - reach - 0.5
    x, y = np.meshgrid(p, p, indexing="ij")
    sub = ((np.arange(many) + 0.5) / many - 0.5) / fine
    lit = np.mean([np.hypot(x + a, y + b) <= wide / 2 for a in sub for b in sub], 0)
    nu = np.abs(np.fft.fftfreq(p.size, 1 / fine))
    along = np.maximum(1 - nu * float(c.wavelength * c.seen.d_2 / c.d) / pitch, 0) * np.sinc(nu * float(c.q) / pitch)
    lenses = np.arange(2 * reach + 1) - reach

    def image(kappa, b):
        turned = lit * np.exp(2j * np.pi * b / wide * (kappa[0] * x + kappa[1] * y))
        blurred = np.fft.ifft2(np.fft.fft2(turned) * np.multiply.outer(along, along))
        cells = blurred.reshape(lenses.size, fine, lenses.size, fine)
        phase = [np.exp(-2j * np.pi * k * lenses) for k in kappa]
        return np.einsum("a,apbq,b->pq", phase[0], cells, phase[1]).ravel()

    steps = np.arange(-side, side + 1) / side
    kappa = np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2)
    long = np.hypot(*kappa.T)
    kappa = kappa[(long > 0) & (long < finest)]
    long = np.hypot(*kappa.T)
    folded = np.any(np.round(kappa) != 0, 1) & (long > 0.5)
    strength = 0.1**2 / (2 * np.pi * np.log(2) * long**2 * side**2) * np.prod(np.sinc(kappa), 1) ** 2
    at = np.stack(np.meshgrid(np.arange(side), np.arange(side), indexing="ij"), -1).reshape(-1, 2)
    over = np.exp(2j * np.pi * at @ kappa.T)
    shown = np.array([image(k, disparity) for k in kappa])
    moved = np.array([image(k, disparity + 0.01) - image(k, disparity - 0.01) for k in kappa]) / 0.02
    lattice = np.fft.fftfreq(side)
    waves = np.stack(np.meshgrid(lattice, lattice, indexing="ij"), -1).reshape(-1, 2)
    picture = np.array([image(k, disparity) for k in waves])
    picture /= np.linalg.norm(picture, axis=1)[:, None]
    rng, known, pulls = np.random.default_rng(5), [], []
    for _ in range(draws):
        c = np.array([1, 1j]) @ rng.standard_normal((2, len(kappa))) * np.sqrt(strength)
        change = ((over * np.where(long < 0.5, c, 0)) @ moved).real
        turned = np.fft.fft2(change.reshape(side, side, -1), axes=(0, 1)).reshape(side**2, -1)
        turned -= picture * (picture.conj() * turned).sum(1)[:, None]
        change = np.fft.ifft2(turned.reshape(side, side, -1), axes=(0, 1)).real.reshape(side**2, -1)
        known.append((change**2).sum())
        each = np.einsum("kp,wp,kw->w", change, shown[folded], over[:, folded], optimize=True)
        pulls.append((strength[folded] * np.abs(each) ** 2).sum())
    return side**2 * float(np.mean(pulls) / np.mean(known) ** 2)


@pytest.mark.parametrize(
    ("fap", "microlenses", "disparity"), [(2.9, 1.4, 0.5), (2.9, 1.25, -1.0), (2.9, 1.25, 2.5), (3.6, 1.4, 0.5)]
)
def test_detail_that_aliases_misleads_as_fits_to_a_torus_say(fap, microlenses, disparity):
    """To 6 % of the standard error that it adds to noise, where that hangs on its phases over the FAP."""
    even = {"depth.window": 1, "light.exposure": 1e-4, "sensor.full_well": 1e6, "sensor.read_noise": 1000.0}
    design = PAPER.replace({**even, "aperture.diameter": fap})

    def sigma(finest):
        c = Camera.of(
            design.replace({"depth.finest": finest * float(QUANTITIES["object_sample_mm"](Camera.of(design)))})
        )
        return float(axial_disparity_sigma(c, seen_at(c, None)._replace(disparity=np.asarray(disparity))))

    added = math.sqrt(sigma(microlenses) ** 2 - sigma(2.0) ** 2)
    assert added == pytest.approx(math.sqrt(misled(design, disparity, 1 / microlenses)), rel=0.06)


@pytest.mark.parametrize("layout", ["square", "hexagonal"])
def test_detail_that_aliases_ends_depth_where_views_are_sharp_alone(layout):
    """In bright light views disagree; what they blur, out of focus, does no harm; nor what they show as it is."""
    shape = "square" if layout == "square" else "circular"
    design = PAPER.replace({"microlens_array.layout": layout, "microlens_array.lens_shape": shape})
    sample = float(QUANTITIES["object_sample_mm"](Camera.of(design)))

    def sigma(microlenses, disparity):
        c = Camera.of(design.replace({"depth.finest": microlenses * sample}))
        return float(axial_disparity_sigma(c, seen_at(c, None)._replace(disparity=np.asarray(disparity))))

    least = float(axial_disparity_sigma(Camera.of(design), seen_at(Camera.of(design), None)))
    assert sigma(1.25, 0.5) == sigma(1.25, -0.5) == sigma(1.25, 0.0) == math.inf
    assert least < sigma(1.25, 4.0) < 2 * least
    fold = 1 / PACKINGS[layout].fold
    assert sigma(0.9999 * fold, 0.5) == pytest.approx(sigma(1.0001 * fold, 0.5), rel=0.02)


# --- laws ---------------------------------------------------------------------------------------------------------


def test_light_texture_and_window_scale_as_they_must():
    # Bright enough for shot noise alone.
    bright = PAPER.replace({"sensor.full_well": 1e8, "sensor.bits": 24, "light.exposure": 1.0})
    base = information(bright)
    assert information(bright.replace({"light.exposure": 4.0})) == pytest.approx(4 * base, rel=1e-4)
    assert information(bright.replace({"depth.contrast": 0.2})) == pytest.approx(4 * base, rel=1e-12)
    sigma = QUANTITIES["sigma_disparity_pitches"]
    wide = sigma(Camera.of(bright.replace({"depth.window": 9})))
    assert float(wide) == pytest.approx(float(sigma(Camera.of(bright))) * 5 / 9, rel=1e-12)


def test_what_overlapping_images_fill_tells_nothing():
    """Slow detail, where neighbours' light adds up to more than the full well: moments of the pixels that it leaves.

    One image alone fills four fifths of it. Both sides are sums over pixels, ours by the lattice's waves.
    """
    lit = {"sensor.full_well": 1e6, "light.exposure": 1.0, "sensor.read_noise": 0.0}
    design = PAPER.replace({**lit, "aperture.diameter": 1.4 * PAPER.D_F})
    room = float(electrons(Camera.of(design))) / 0.8
    images = MicrolensImages(Camera.of(design), [(0.0, 0.0)])
    places = (np.arange(60) + 0.5) / 60 - 0.5
    parts = image_parts(images, places, places)
    light, along = (part.sum(0)[0] for part in (parts.light, parts.light * parts.x))
    left = ndtr((1.25 - light) / (design.depth.contrast * light))
    slow = Spectrum(np.array([1e-3]), np.zeros(1), np.ones(1))
    both = [
        _disparity_information(
            MicrolensImages(Camera.of(design.replace({"sensor.full_well": well, "sensor.bits": 24})), [(0.0, 0.0)]),
            seen_at(Camera.of(design), None)._replace(disparity=np.zeros(())),
            slow,
        )[0, 0]
        for well in (room, 100 * room)
    ]
    expected = (left * along**2 / light).sum() / (along**2 / light).sum()
    assert expected < 0.6
    assert float(both[0] / both[1]) == pytest.approx(expected, rel=0.03)


def test_the_edge_is_measured_with_the_light_that_it_gets():
    """A microlens that nothing cuts, off the axis: as one on the axis in cos^4 of the light."""
    lit = PAPER.replace({"light.exposure": 1 / 240})
    # The chief ray leaves the FAP's centre, is bent by -h/f and meets the array at x.
    h = 11.15 / (1 + PAPER.d_1 / PAPER.d_3 - PAPER.d_1 / PAPER.f)
    dimmed = lit.replace({"light.exposure": np.cos(np.arctan(h / PAPER.d_3)) ** 4 / 240})
    assert information(lit, (11.15, 0.0)) == pytest.approx(information(dimmed), rel=1e-9)
    assert information(dimmed) < 0.98 * information(lit)


@pytest.mark.parametrize("wavelength", [5.5e-4, 1.2e-4])
def test_light_of_a_microlens_is_what_it_sends_alone(wavelength):
    """Against the white picture of an array of one, soft and sharp (16 periods in a pitch pass)."""
    lone = {"microlens_array.size": (0.0631, 0.0631), "sensor.size": (0.12, 0.12), "light.wavelength": wavelength}
    design = PAPER.replace(lone)
    camera = Camera.of(design)
    picture = roslf.render(design, overrides=["-cos4"]).pixels
    pixels = np.arange(len(picture)) - (len(picture) - 1) / 2
    x = pixels * design.q / float(microlens_image_pitch(camera))
    parts = image_parts(MicrolensImages(camera, [(0.0, 0.0)]), x, x)
    # The picture's own budget is a few thousandths.
    assert_allclose(parts.light[parts.steps.index((0, 0)), 0], picture, atol=3e-3)


def test_everything_in_another_unit_of_length():
    """A camera twice as large under twice the wavelength sees the same with as many electrons."""
    lengths = {
        "main_lens.diameter": 101.6, "main_lens.focal_length": 200.0, "main_lens.focal_plane": 700.0,
        "aperture.diameter": 5.8, "aperture.distance": 240.0, "microlens_array.pitch": 0.126,
        "microlens_array.focal_length": 4.0, "microlens_array.size": (46.0, 46.0), "sensor.distance": 4.0,
        "sensor.pixel": 2 * PAPER.q, "sensor.size": (44.6, 29.864), "light.wavelength": 1.1e-3,
    }  # fmt: skip
    large = PAPER.replace({**lengths, "microlens_array.distance": None})
    lit = PAPER.replace({"light.exposure": 1e-3})
    same = large.replace({"light.exposure": 1e-3 / 8})  # four times the area, photons of half the energy
    assert information(same) == pytest.approx(information(lit), rel=1e-9)


def test_seams_are_smooth():
    """Where the sum's size changes with the detail that diffraction passes, and where it is extrapolated."""
    waves = np.geomspace(0.15e-3, 1.2e-3, 60)
    camera = Camera.of(PAPER.replace({"light.exposure": 1e-4}), {"wavelength": waves})
    values = np.log(QUANTITIES["sigma_disparity_pitches"](camera))
    bends = np.diff(values, 2)
    assert np.abs(bends).max() < 4e-3  # the curve itself bends by 1e-3 a step
    cut = Camera.of(CUT)
    edge = brentq(lambda x: float(MicrolensImages(cut, [(x, 0.0)]).clearance[0, 0]), 1.0, 9.0)
    inside, outside = (information(CUT, (edge + off, 0.0)) for off in (-1e-6, 1e-6))
    assert outside == pytest.approx(inside, rel=1e-5)  # rows against Bessel functions


def test_nothing_to_tell():
    dark = MicrolensImages(Camera.of(CUT), [(11.0, 0.0)])
    assert np.isinf(disparity_sigma(dark, seen_at(Camera.of(CUT), None))).all()
    over = PAPER.replace({"light.exposure": 1.0})  # beyond the full well
    assert np.isinf(float(QUANTITIES["sigma_z_mm"](Camera.of(over))))
    unseen = PAPER.replace({"depth.period": 0.1})  # finer than two microlenses show
    assert np.isinf(float(QUANTITIES["sigma_z_mm"](Camera.of(unseen))))
    assert roslf.evaluate(unseen).to_dict()["depth"]["sigma_z_mm"] is None


@pytest.mark.parametrize("layout", ["square", "hexagonal"])
def test_a_window_holds_the_microlenses_of_a_square_of_so_many_rows(layout):
    """Counted: rows of a hexagonal array are closer than a pitch, and the square as wide as it is high."""
    camera = Camera.of(PAPER.replace({"microlens_array.layout": layout, "depth.window": 5}))
    images, plane, steps = MicrolensImages(camera, [(0.0, 0.0)]), seen_at(camera, None), PACKINGS[layout].steps
    nodes = np.stack(np.meshgrid(np.arange(-20, 21), np.arange(-20, 21)), -1).reshape(-1, 2) @ steps.T
    corners, side = np.random.default_rng(1).uniform(-2, 2, (4000, 1, 2)), 5 * steps[1, 1]
    held = np.mean(((nodes > corners) & (nodes < corners + side)).all(-1).sum(-1))
    own = float(_disparity_information(images, plane)[0, 0])
    assert float(disparity_sigma(images, plane)[0, 0]) == pytest.approx(1 / (held * own) ** 0.5, rel=0.01)


@pytest.mark.parametrize("layout", ["square", "hexagonal"])
@pytest.mark.parametrize("lens_shape", ["square", "circular"])
def test_builds_are_those_taken_one_by_one(layout, lens_shape):
    design = PAPER.replace({"microlens_array.layout": layout, "microlens_array.lens_shape": lens_shape})
    d_2 = np.array([0.4, 1.0, 1.9, 2.0, 2.3])
    many = QUANTITIES["sigma_z_mm"](Camera.of(design, {"d_2": d_2}))
    ones = [float(QUANTITIES["sigma_z_mm"](Camera.of(design, {"d_2": value}))) for value in d_2]
    assert_allclose(many, ones, rtol=3e-8)
    assert np.isfinite(many).all()


def test_transforms_of_a_disc_have_the_bessel_functions_of_scipy():
    """By tables and series, from the middle to far beyond what passes, and beyond all tables."""
    z = np.append(np.random.default_rng(4).uniform(0, 300, 2000), [*np.linspace(0, 0.1, 50), 1e6, 1e12])[1:]
    ones, twos = _bessel_quotients(z * z)
    safe = np.where(z > 0, z, 1.0)
    assert_allclose(ones, np.where(z > 0, jv(1, safe) / safe, 1 / 2), atol=2e-12)
    assert_allclose(twos, np.where(z > 0, jv(2, safe) / safe**2, 1 / 8), atol=2e-12)


def test_builds_all_alike_are_as_one():
    """As of trials none of which can be put together, and which stand as nominal; series through them have no axis."""
    one = float(QUANTITIES["sigma_z_mm"](Camera.of(PAPER)))
    for count in (20, 300):
        many = QUANTITIES["sigma_z_mm"](Camera.of(PAPER, {"sensor.distance": np.full(count, PAPER.d_2)}))
        assert_allclose(many, np.full(count, one), rtol=3e-8)


def test_builds_far_from_alike_are_those_taken_one_by_one():
    """As a workshop without tolerances makes them: series through few builds, to 1.5e-3 of the information."""
    at = np.random.default_rng(1)
    changes = {
        "main_lens.focal_plane": 350 * np.exp(0.3 * at.uniform(-1, 1, 400)),
        "aperture.diameter": 2.9 * np.exp(0.3 * at.uniform(-1, 1, 400)),
    }
    together = QUANTITIES["sigma_disparity_pitches"](Camera.of(PAPER, changes))
    for k in range(0, 400, 40):
        one = Camera.of(PAPER, {place: float(values[k]) for place, values in changes.items()})
        assert float(QUANTITIES["sigma_disparity_pitches"](one)) == pytest.approx(together[k], rel=8e-4)


@pytest.mark.parametrize(("name", "at"), [("arthroscope", 5.0), ("paper", 600.0)])
def test_many_builds_out_of_focus_are_those_taken_one_by_one(name, at):
    """Sigma to the 1e-4 that series promise."""
    draw, places = np.random.default_rng(2), ("sensor.distance", "aperture.diameter", "main_lens.focal_plane")
    camera = Camera.of(roslf.load(name))
    many = camera.replace({place: camera[place] * np.exp(2e-3 * draw.normal(size=800)) for place in places})
    together = axial_disparity_sigma(many, seen_at(many, at))
    for k in (*range(0, 800, 100), int(np.argmin(together)), int(np.argmax(together))):
        alone = many.build(k)
        assert float(axial_disparity_sigma(alone, seen_at(alone, at))) == pytest.approx(together[k], rel=1e-4)


@pytest.mark.parametrize("name", ["grin-needle", "rigid-scope"])
def test_few_builds_that_differ_little_are_those_taken_one_by_one(name):
    camera, at = Camera.of(roslf.load(name)), np.random.default_rng(3)
    for spread in (1e-2, 1e-3):
        places = ("aperture.distance", "sensor.distance", "aperture.diameter")
        many = camera.replace({place: camera[place] * np.exp(spread * at.uniform(-1, 1, 24)) for place in places})
        alone = [float(QUANTITIES["sigma_z_mm"](many.build(k))) for k in range(24)]
        assert_allclose(QUANTITIES["sigma_z_mm"](many), alone, rtol=5e-5)


def test_distances_at_once():
    camera = Camera.of(PAPER)
    ahead = np.array([100.0, 200.0, 230.0, 400.0])
    each = [float(QUANTITIES["sigma_z_mm"](camera, float(at))) for at in ahead]
    from roslf_design.theory.depth_error import depth_error

    assert_allclose(depth_error(camera, ahead), each, rtol=1e-9)
    assert np.argmin(np.array(each) / ahead**2) == 2  # out of focus, blur costs beside the square of the distance


def test_a_given_disparity_error_stands():
    fixed = PAPER.replace({"depth.disparity_error": 0.1})
    assert float(QUANTITIES["sigma_z_mm"](Camera.of(fixed))) == pytest.approx(1.2491, abs=5e-5)
    told = roslf.evaluate(fixed)
    assert told.depth.assumes is None
    assert told.depth.sigma_disparity_pitches == 0.1
    free = Seen(np.zeros(()), np.ones(()))
    assert np.isinf(
        disparity_sigma(MicrolensImages(Camera.of(CUT.replace({"depth.disparity_error": 0.1})), [(11.0, 0)]), free)
    )


@pytest.mark.parametrize("period", [1e-2, 1e-6, 1e-9])
def test_a_texture_too_fine_for_single_views_tells_nothing_at_no_cost(period):
    """Seconds and gigabytes went into counting its waves."""
    design = PAPER.replace({"depth.period": period, "main_lens.diameter": 20.0})
    corner = default_fields(design)[-1]
    assert information(design, corner) == information(design) == 0.0


def test_where_next_to_nothing_is_left_fields_at_once_are_those_taken_one_by_one():
    """Tangents there have slopes of 7e4, of rounding alone, and overflowed."""
    design = roslf.load("paper-mismatched").replace({"sensor.distance": 10.0, "light.wavelength": 925e-6})
    fields = default_fields(design)
    camera = Camera.of(design)
    together = _disparity_information(MicrolensImages(camera, fields), seen_at(camera, None))[:, 0]
    assert_allclose(together, [information(design, field) for field in fields], rtol=1e-12)


@pytest.mark.parametrize("texture", [{}, {"depth.finest": 0.2}, {"depth.period": 0.5}])
def test_a_plane_seen_upside_down_has_the_texture_of_one_seen_upright(texture):
    """As where the lens lies within its focal length of the array: the scale's sign once was that of a frequency."""
    camera = Camera.of(PAPER.replace(texture))
    upright, inverted = (Seen(np.zeros(()), np.asarray(scale)) for scale in (2.5, -2.5))
    assert_allclose(view_gradient(camera, inverted), view_gradient(camera, upright), rtol=1e-15)
    fields = MicrolensImages(camera, [(0.0, 0.0)])
    assert_allclose(_disparity_information(fields, inverted), _disparity_information(fields, upright), rtol=1e-15)


def many_waves(camera, disparity, octave, directions):
    """Information of the texture that designs assume, by so many waves that more change nothing: NumPy's nodes."""
    fine = PACKINGS[camera.layout].fold
    r, over_r = np.polynomial.legendre.leggauss(octave)
    t, over_t = np.polynomial.legendre.leggauss(directions)
    k, angle = (fine * (r + 1) / 2)[:, None], ((t + 1) * np.pi / 4)[None]
    x, y = (k * np.cos(angle)).ravel(), (k * np.sin(angle)).ravel()
    power = np.outer(over_r / (r + 1) / np.log(2), over_t / 2).ravel() * float(camera["depth.contrast"]) ** 2
    power *= LENS_SHAPES[camera.lens_shape].blur(x, y) ** 2
    images = MicrolensImages(camera, [(0.0, 0.0)])
    plane = seen_at(camera, None)._replace(disparity=np.asarray(disparity))
    return float(_disparity_information(images, plane, Spectrum(x, y, power))[0, 0])


@pytest.mark.parametrize(
    ("preset", "changes", "within"),
    [
        ("paper", {}, 0.01),
        ("video-otoscope", {}, 0.01),
        ("paper", {"microlens_array.layout": "hexagonal", "microlens_array.lens_shape": "circular"}, 0.01),
        ("mismatched-borescope", {}, 0.035),  # images overlap twofold
    ],
)
def test_waves_are_enough_however_far_out_of_focus(preset, changes, within):
    """Sigma against many waves, before the focal plane and behind it; nine waves were up to 30 % off here."""
    camera = Camera.of(roslf.load(preset).replace(changes))
    images = MicrolensImages(camera, [(0.0, 0.0)])
    for disparity in (-12.3, -6.1, -2.2, -1.2, 0.0, 2.1, 3.6, 12.3):
        plane = seen_at(camera, None)._replace(disparity=np.asarray(disparity))
        ours = float(_disparity_information(images, plane)[0, 0])
        many = many_waves(camera, disparity, 30, 5)
        assert (many / ours) ** 0.5 == pytest.approx(1.0, abs=within), disparity


def test_waves_grow_in_number_without_a_step():
    """Sigma's slope by differences of 1e-5 pitches is that by differences of 1e-2, so it has no steps to trip over."""
    camera = Camera.of(PAPER)
    at = np.linspace(2.0, 9.0, 701)

    def sigma(disparity):
        return axial_disparity_sigma(camera, Seen(np.asarray(disparity), np.full(np.shape(disparity), 3.0)))

    coarse, fine = (np.log(sigma(at + step) / sigma(at - step)) / (2 * step) for step in (5e-3, 5e-6))
    assert_allclose(fine, coarse, atol=0.05)


@pytest.mark.parametrize(("layout", "wide"), [("square", 1.0149), ("square", 1.3), ("hexagonal", 1.1)])
def test_pixels_that_several_images_reach_are_those_of_drawn_discs(layout, wide):
    """By 400 x 400 places of the lattice's cell: 1 / 400 of a share is what its rows leave open."""
    rise = PACKINGS[layout].rise
    places = (np.arange(400) + 0.5) / 400
    x, y = np.meshgrid(places, 2 * rise * places)
    rows = [(k + (0.5 * (n % 2) if rise < 1 else 0.0), n * rise) for k in range(-2, 4) for n in range(-2, 5)]
    covered = sum(np.hypot(x - a, y - b) < wide / 2 for a, b in rows)
    assert overlapping(wide, rise, True) == pytest.approx(np.mean(covered > 1), abs=2.5e-3)
    assert overlapping(0.98, rise, True) == overlapping(1.0, rise, False) == 0


def narrowed(design, width, distance):
    """A design whose FAP a stop cuts, and the same camera with that stop for its FAP."""
    stop = {"diameter": width, "distance": distance}
    return design.replace({"stops": [stop]}), design.replace({f"aperture.{key}": value for key, value in stop.items()})


@pytest.mark.parametrize("name", ["sigma_z_mm", "u_z_mm", "mtf50_lp_per_mm", "mtf10_lp_per_mm"])
def test_a_stop_narrower_than_the_pupil_limits_depth_and_detail(name):
    """As if it were the FAP: that is the same camera. In focus the pitch of the images alone tells them apart."""
    value, scope = QUANTITIES[name], roslf.load("rigid-scope")
    cut, own = (Camera.of(one) for one in narrowed(scope, 0.21, 0.9))
    assert float(value(cut)) == pytest.approx(float(value(own)), rel=5e-3)
    # Away from it single views of the two are of other points' light: there alike to first order in 0.4 mm.
    assert float(value(cut, 10.0)) == pytest.approx(float(value(own, 10.0)), rel=0.06)
    # The whole pupil's would be another.
    assert abs(float(value(Camera.of(scope), 10.0)) / float(value(own, 10.0)) - 1) > 0.065


def test_builds_that_a_stop_cuts_are_those_taken_one_by_one():
    cut = Camera.of(narrowed(roslf.load("rigid-scope"), 0.21, 0.9)[0])
    many = cut.replace(
        {"aperture.decentre.0": np.array([0.0, 0.02, 0.05]), "stops.0.diameter": np.array([0.2, 0.3, 0.6])}
    )
    for name in ("sigma_z_mm", "mtf50_lp_per_mm"):
        together = QUANTITIES[name](many)
        alone = [float(QUANTITIES[name](many.build(k))) for k in range(3)]
        np.testing.assert_allclose(together, alone, rtol=1e-4)


def test_images_overlap_by_what_stops_leave_of_them():
    """A FAP too wide for the pitch behind a stop as wide as the pitch asks for: depth is that of the narrow FAP."""
    paper = roslf.load("paper")
    wide = paper.replace({"D_F": 1.6 * paper.D_F})
    stopped = narrowed(wide, paper.D_F, paper.d_3)[0]
    u_z = QUANTITIES["u_z_mm"]
    assert np.isinf(u_z(Camera.of(wide)))
    assert float(u_z(Camera.of(stopped))) == pytest.approx(float(u_z(Camera.of(paper))), rel=5e-3)


@pytest.mark.parametrize("name", ["paper", "paper-mismatched"])
def test_light_of_all_microlenses_is_that_of_each_added_up(name):
    images, at = MicrolensImages(Camera.of(roslf.load(name)), [(0.0, 0.0)]), (np.arange(5) - 2) / 5
    assert_allclose(whole_light(images, at, at), light_read(images, at, at, AS_IT_IS).sum(0), rtol=1e-12, atol=1e-14)
