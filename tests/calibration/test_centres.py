"""Microlens centres against white images drawn by brute force with known centres, and against a real microscope's."""

import math

import numpy as np
import pytest
from scipy.spatial import cKDTree

import roslf_design as roslf
from roslf_design.calibration import CalibrationError, CentreLattice, Reason, find_centres
from roslf_design.calibration.lattice import fit_lattice
from roslf_design.camera import Camera
from roslf_design.imaging.render import render
from roslf_design.theory.exit_pupil import microlens_image_pitch
from tests.oracles.calibration import nodes_over, stretched_image, white_image

PITCH, ROTATION = 14.07, math.radians(0.31)


def errors(found, truth):
    """Fitted minus true centres, each matched to the nearest true one."""
    return found.centres - truth[cKDTree(truth).query(found.centres)[1]]


def rms(vectors):
    return float(np.sqrt(np.mean(vectors**2)))


@pytest.mark.parametrize(("layout", "fill"), [("square", 1.0), ("hexagonal", 0.9)])
def test_clean_white_image_gives_centres_below_two_thousandths_of_a_pixel(layout, fill):
    truth = nodes_over((600, 600), PITCH, ROTATION, layout, (1.3, 0.4))
    found = find_centres(white_image((600, 600), truth, fill * PITCH / 2, noise=0.01))
    assert found.lattice.layout == layout
    assert rms(errors(found, truth)) < 0.002
    assert np.all(found.used | (found.reasons == Reason.BORDER) | (found.reasons == Reason.OUTLIER))
    assert found.lattice.pitch == pytest.approx(PITCH, abs=2e-4)
    assert found.lattice.rotation == pytest.approx(ROTATION, abs=1e-5)


@pytest.mark.parametrize(("layout", "sign"), [("square", 1), ("hexagonal", -1)])
def test_cats_eyes_do_not_bias_the_lattice(layout, sign):
    shape = (700, 700)
    truth = nodes_over(shape, PITCH, ROTATION, layout, (1.3, 0.4))
    middle = np.array([349.5, 349.5])
    shift = sign * 5.0 * (truth - middle) / np.hypot(*middle)
    image = white_image(shape, truth, 0.95 * PITCH / 2, cut_radius=0.62 * PITCH, cut_shift=shift, noise=0.01)
    found = find_centres(image)
    assert rms(errors(found, truth)) < 0.006  # asked for 0.05; other tools 0.21-0.47
    cut = found.reasons == Reason.CUT
    off = np.hypot(*(found.measured - found.centres)[cut].T)
    assert np.sort(off)[-len(cut) // 20 :].mean() > 0.7  # the bias a fit through every centroid would have met
    radius = np.hypot(*(found.centres - middle).T)
    whole = (0.62 - 0.475) * PITCH / 5 * np.hypot(*middle)  # the second disc touches the first here
    assert cut[radius > 1.15 * whole].mean() > 0.9
    assert not cut[radius < 0.7 * whole].any()


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("layout", "share", "aside", "pedestal", "rim"),
    [
        ("square", 0.45, (0, 0), 0.0, 1),
        ("hexagonal", 0.2, (90, -60), 0.08, 1),
        ("square", 0.25, (-80, 40), 0.1, 40),
        ("hexagonal", 0.25, (-80, 40), 0.1, 40),
    ],
)
def test_a_round_field_is_measured_where_it_is_lit(layout, share, aside, pedestal, rim):
    """As an endoscope shows it: a disc of light, sharp or fading at its rim, on a sensor with or without a pedestal."""
    shape = (600, 800)
    truth = nodes_over(shape, PITCH, ROTATION, layout, (1.3, 0.4))
    middle, radius = np.array([399.5, 299.5]) + aside, math.sqrt(share * 600 * 800 / math.pi)
    inside = np.hypot(*(truth - middle).T) < radius
    y, x = np.mgrid[:600, :800]
    fading = np.clip((radius - np.hypot(x - middle[0], y - middle[1])) / rim + 1, 0, 1) if rim > 1 else 1.0
    found = find_centres(white_image(shape, truth[inside], 0.47 * PITCH, noise=0.01) * fading + pedestal)
    lit = np.hypot(*(found.centres - middle).T) < radius
    assert found.lattice.layout == layout
    assert rms(errors(found, truth)[lit]) < 0.003  # refused, or 0.05 to 0.26 px where dark cells were counted
    assert found.used[lit].mean() > (0.9 if rim == 1 else 0.5)
    assert not found.used[~lit].any()


@pytest.mark.parametrize("across", [0, -1], ids=["longer", "as long as narrow"])
def test_images_that_aberrations_stretch_are_not_cut(across):
    """3 % at the field's corner: elliptical as a cut makes them, but nothing is lost."""
    shape = (500, 600)
    truth = nodes_over(shape, PITCH, ROTATION, "square", (1.3, 0.4))
    stretch = 1 + 0.03 * np.square(truth - (299.5, 249.5)).sum(axis=1) / (299.5**2 + 249.5**2)
    image = stretched_image(shape, truth, 6.3 * stretch, 6.3 * stretch**across, noise=0.01)
    found = find_centres(image, undistorted_radius=math.inf)
    assert not (found.reasons == Reason.CUT).any()
    assert found.used[found.reasons != Reason.BORDER].mean() > 0.99
    assert rms(errors(found, truth)) < 0.002
    assert found.warnings == ()


def test_distortion_of_the_field_is_followed_and_told():
    """Barrel distortion of 0.6 and 4 px at the corner, touching images: no cat's eyes, no silent error."""
    shape = (700, 900)
    straight = nodes_over(shape, PITCH, ROTATION, "square", (1.3, 0.4))
    away = straight - (449.5, 349.5)
    corner = math.hypot(449.5, 349.5)
    for barrel in (0.6, 4.0):
        truth = straight - barrel * away / corner * (np.square(away).sum(axis=1) / corner**2)[:, None]
        found = find_centres(white_image(shape, truth, PITCH / 2, noise=0.01), undistorted_radius=math.inf)
        assert rms(errors(found, truth)) < 0.003  # 0.05 and 0.44 as a straight lattice
        assert found.used[found.reasons != Reason.BORDER].mean() > 0.99
        assert found.lattice.pitch == pytest.approx(PITCH, abs=0.002)  # the field's middle is as it was
        (said,) = found.warnings
        told = float(said.split("up to ")[1].split(" px")[0])
        lattice = found.lattice
        np.testing.assert_allclose(lattice.indices(found.centres), found.indices, atol=1e-9)
        assert told == pytest.approx(barrel, rel=0.12)  # the outermost microlens stands inside the corner


def test_cats_eyes_where_the_design_has_none_and_few_whole_images_are_told():
    shape = (700, 700)
    truth = nodes_over(shape, PITCH, ROTATION, "square", (1.3, 0.4))
    shift = 6.0 * (truth - (349.5, 349.5)) / math.hypot(349.5, 349.5)
    image = white_image(shape, truth, 0.95 * PITCH / 2, cut_radius=0.55 * PITCH, cut_shift=shift, noise=0.01)
    found = find_centres(image, undistorted_radius=math.inf)
    cut, few = found.warnings
    assert "cut by a stop where Eq. 6 says that the design cuts none" in cut
    assert few.startswith(f"only {found.used.sum()} of ")
    assert rms(errors(found, truth)) < 0.01
    assert find_centres(image, undistorted_radius=75.0).warnings[0].startswith("only ")


@pytest.mark.parametrize(
    ("layout", "pitch", "expected", "lit"),
    [
        ("hexagonal", PITCH, PITCH, "95 %"),  # dirt's long periods were taken for the lattice's
        ("square", PITCH, PITCH, "left half"),
        ("hexagonal", PITCH, 1.1 * PITCH, "left half"),
        ("hexagonal", 5.0, 5.0, "all"),  # its rows stand 4.33 px apart
        ("square", 5.0, 5.0, "all"),
        ("hexagonal", PITCH, PITCH / 2, "all"),  # what another design promises is not found in harmonics
        ("square", PITCH, 2 * PITCH, "all"),
    ],
)
def test_the_design_s_pitch_finds_the_lattice_where_much_is_missing(layout, pitch, expected, lit):
    shape = (600, 700) if pitch > 6 else (300, 350)
    truth = nodes_over(shape, pitch, ROTATION, layout, (1.3, 0.4))
    kept = {
        "all": np.ones(len(truth), bool),
        "95 %": np.random.default_rng(4).random(len(truth)) > 0.05,
        "left half": truth[:, 0] < shape[1] / 2,
    }[lit]
    fill = 1.0 if lit == "95 %" else 0.95  # touching images have a weak first order; at an edge they pull
    image = white_image(shape, truth[kept], fill * pitch / 2, noise=0.01)
    found = find_centres(image, layout=layout, pitch=expected)
    there = cKDTree(truth[kept]).query(found.centres)[0] < 1
    assert rms(errors(found, truth)[there]) < 0.003
    assert found.used[there].mean() > 0.75


def test_lenses_beyond_the_promised_radius_are_left_out():
    truth = nodes_over((400, 400), PITCH, ROTATION, "square")
    found = find_centres(white_image((400, 400), truth, 6.0, noise=0.01), undistorted_radius=100.0)
    radius = np.hypot(*(found.centres - 199.5).T)
    assert (radius[found.used] < 100.5).all()
    assert (found.reasons[radius > 101] != Reason.USED).all()
    assert rms(errors(found, truth)) < 0.003


@pytest.mark.parametrize(
    ("layout", "pitch", "degrees"),
    [("square", 6.3, 12), ("hexagonal", 80.0, 17), ("square", 31.4, 40)],
)
def test_any_pitch_and_rotation_without_knowing_them(layout, pitch, degrees):
    shape = (700, 820) if pitch > 20 else (350, 410)
    truth = nodes_over(shape, pitch, math.radians(degrees), layout, (0.3, -2.4))
    found = find_centres(white_image(shape, truth, 0.8 * pitch / 2, noise=0.01))
    assert found.lattice.layout == layout
    assert rms(errors(found, truth)) < 0.005  # few lenses at 80 px: each is known to 0.02


@pytest.mark.parametrize(("pitch", "fill"), [(14.07, 1.0), (40.3, 0.9)])
def test_vignetting_leaves_the_centres_alone(pitch, fill):
    shape = (900, 1100) if pitch > 20 else (450, 550)
    truth = nodes_over(shape, pitch, ROTATION, "square", (1.3, 0.4))
    y, x = np.mgrid[-1 : 1 : shape[0] * 1j, -1 : 1 : shape[1] * 1j]
    image = white_image(shape, truth, fill * pitch / 2, noise=0.01, envelope=1 - 0.25 * (x**2 + y**2))
    assert rms(errors(find_centres(image), truth)) < 0.003  # centroids alone: 0.015 at 14 px, 0.1 at 40 px
    middle = (np.array(shape[::-1]) - 1) / 2
    by_lens = np.round(1 - 0.25 * (((truth - middle) / middle) ** 2).sum(axis=1), 2)
    stairs = white_image(shape, truth, fill * pitch / 2, noise=0.01, seed=3, light=by_lens)
    assert rms(errors(find_centres(stairs), truth)) < 0.005


def test_blurred_images_that_run_into_each_other():
    truth = nodes_over((500, 500), PITCH, 0.2, "square")
    sharp = white_image((500, 500), truth, PITCH / 2)
    frequency = np.fft.fftfreq(500)
    blur = np.exp(-2 * (math.pi * 0.15 * PITCH) ** 2 * (frequency[:, None] ** 2 + frequency[None, :] ** 2))
    image = np.fft.ifft2(np.fft.fft2(sharp) * blur).real + np.random.default_rng(0).normal(0, 0.01, sharp.shape)
    assert rms(errors(find_centres(image), truth)) < 0.004


def test_dark_frame_is_taken_off_and_a_constant_changes_nothing():
    truth = nodes_over((400, 400), PITCH, ROTATION, "square")
    image = 3000 * white_image((400, 400), truth, 6.0, noise=0.01)
    dark = 500 + 40 * np.random.default_rng(1).normal(size=image.shape)
    raw = np.clip(image + dark, 0, None).astype(np.uint16)
    freed, plain, left = (find_centres(*frames).lattice for frames in ((raw, dark), (image,), (raw,)))
    np.testing.assert_allclose(freed.basis, plain.basis, atol=2e-4)  # uint16 rounding
    np.testing.assert_allclose(left.origin, plain.origin, atol=0.01)


def test_real_microscope(shared_data):
    import tifffile

    white, dark = (tifffile.imread(shared_data / "guv" / f"{n}_GUVExperim1.tif") for n in ("Radiometry", "DarkFrame"))
    found = find_centres(white, dark)
    np.testing.assert_allclose(found.lattice.pitches, (15.389, 15.411), atol=0.01)
    assert rms((found.measured - found.centres)[found.reasons != Reason.BORDER]) <= 0.07
    assert found.used.mean() > 0.8


def test_reasons_are_counted_in_words():
    truth = nodes_over((400, 400), PITCH, 0.0, "square", (0.31, 0.17))
    image = white_image((400, 400), truth, 6.0, noise=0.005)
    image[180:200, 180:200] = 0
    raw = np.clip(40_000 * image + 1000, 0, 60_000).astype(np.uint16)
    raw[100:102, 100:102] = 65535
    found = find_centres(raw)
    counts = found.counts()
    assert sum(counts.values()) == len(found.indices)
    assert counts["saturated pixels"] in (1, 2, 3, 4)
    assert "cell reaches over the image's edge" in counts
    assert (found.reasons == Reason.DARK).sum() + (found.reasons == Reason.OUTLIER).sum() >= 1
    assert rms(errors(found, truth)) < 0.003


IMAGE = white_image((300, 300), nodes_over((300, 300), PITCH, 0.0, "square"), 6.0)


@pytest.mark.parametrize(
    ("frames", "layout", "said"),
    [
        ((None,), None, "white image is missing"),
        (
            (IMAGE, np.zeros((300, 200))),
            None,
            r"white image and the dark frame differ in size \(300 x 300 px and 200",
        ),
        ((np.clip(400 * IMAGE, 0, 255).astype(np.uint8),), None, "saturated: 100 % of its microlens .* grey level 255"),
        ((np.random.default_rng(0).normal(100, 1, (300, 300)),), None, "no periodic lattice"),
        ((np.ones((300, 300)),), None, "no periodic lattice"),
        ((np.full((300, 300), np.nan),), None, "not finite"),
        ((np.zeros(12),), None, "no image"),
        ((IMAGE,), "hexagonal", "square lattice, not a hexagonal"),
        ((np.tile(np.sin(np.arange(300) / 2.0) + 1, (300, 1)),), None, "one direction only|neither square"),
    ],
)
def test_bad_white_images_are_refused_in_one_line(frames, layout, said):
    with pytest.raises(CalibrationError, match=said):
        find_centres(*frames, layout=layout)


def test_lattice_fit_is_exact_on_exact_points_and_clips_outliers():
    lattice = CentreLattice((3.0, 4.0), (14.0, 0.2), (-0.2, 13.9), "square")
    j, i = np.mgrid[0:9, 0:7]
    index = np.stack([i.ravel(), j.ravel()], axis=-1)
    points = lattice.nodes(index[:, 0], index[:, 1]) + np.random.default_rng(0).normal(0, 1e-3, (63, 2))
    points[5] += 3.0
    fit = fit_lattice(index, points, "square")
    assert not fit.inliers[5]
    np.testing.assert_allclose(fit.lattice.basis, lattice.basis, atol=1e-3)
    np.testing.assert_allclose(lattice.indices(lattice.nodes(i, j)), np.stack([i, j], axis=-1), atol=1e-12)
    with pytest.raises(CalibrationError, match="four microlenses"):
        fit_lattice(index[:5] * (1, 0), points[:5], "square")


@pytest.mark.parametrize("wanted", [["none"], ["none", "+overlap", "+microlens_diffraction"]])
def test_the_engine_s_white_image_has_the_closed_form_s_pitch(wanted):
    """Touching, slightly overlapping images (image fill 1.005), or images that run into each other."""
    paper = roslf.load("paper")
    design = paper.replace({"sensor.size": (500 * paper.sensor.pixel, 400 * paper.sensor.pixel)})
    found = find_centres(render(design, overrides=wanted).pixels)
    true = float(microlens_image_pitch(Camera.of(design))) / design.q
    np.testing.assert_allclose(found.lattice.pitches, true, atol=5e-5)  # 0.001 px over the image
    np.testing.assert_allclose(np.array([249.5, 199.5]), found.lattice.nodes(0, 0), atol=1e-3)  # the lens on axis
