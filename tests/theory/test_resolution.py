"""Transfer of views and of the refocused image against sampled waves and slanted edges; depth of field against rays."""

import math

import numpy as np
import pytest
from scipy.special import j1

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.effects.waves import footprint
from roslf_design.imaging.camera import Region
from roslf_design.imaging.points import PointSource, point_image
from roslf_design.shapes.openings import Openings
from roslf_design.theory import light_field, resolution
from roslf_design.theory.depth_of_field import _pupil_part, depth_of_field, hyperfocal
from roslf_design.theory.lens_shapes import LENS_SHAPES
from roslf_design.theory.light import view_baseline
from roslf_design.theory.quantities import QUANTITIES, image_rate
from roslf_design.theory.resolution import FieldTransfer
from roslf_design.theory.stop_images import MicrolensImages
from tests.oracles import view_psf

PAPER = roslf.load("paper")
SHARES = np.array([0.1, 0.2, 0.3, 0.5, 0.8, 1.1])
"""Frequencies, in periods a pitch."""


def transfer_of(design, at=None, way=(1.0, 0.0)):
    """On the axis; the view's pixel lies where its light's middle is. Frequencies are those on the array."""
    camera = Camera.of(design)
    images = MicrolensImages(camera, [(0.0, 0.0)])
    opened, middle = images.openings, images.shapes.centroid[0, 0]
    rate = float(image_rate(camera, at))
    return FieldTransfer(
        camera, Openings.of_discs(opened.centres[0, 0], opened.radii[0, 0]), tuple(middle), rate, 1.0, 1.0, way, 1.0
    )


def opening(transfer):
    """What stops leave of the microlens image."""

    def lit(x, y):
        return np.all(
            [np.hypot(x - u, y - v) <= r for (u, v), r in zip(*transfer.openings[:2], strict=False)],
            axis=0,
        )

    return lit


@pytest.mark.parametrize(
    ("changes", "at", "tolerance"),
    [
        ({}, None, 4e-3),  # the sampled points end four pitches out
        ({"microlens_array.focal_length": 2.4}, 190.0, 4e-3),
        ({"stops": [{"diameter": 2.6, "distance": 110.0, "decentre": (0.9, 0.3)}]}, 215.0, 4e-3),
        ({"microlens_array.lens_shape": "circular"}, None, 4e-3),
    ],
)
def test_a_view_is_what_a_pixel_sees_of_points(changes, at, tolerance):
    """Waves sampled on FAP, microlens and pixel, in focus and out, whole and cut, along x, along y and aslant.

    Round microlenses leave gaps, which scatter light from afar, 1/v of it from beyond v: sampled out to 16 pitches, and
    through as many neighbours, 0.35 % is left, where four leave 1.4 %. Fields of square ones put out each other.
    """
    design = PAPER.replace(changes)
    transfer, frequency = transfer_of(design, at), SHARES / design.d
    far = design.microlens_array.lens_shape == "circular"
    places = np.arange(-128 if far else -32, 128 if far else 32) * design.d / 8
    sampled = {"samples": 240, "neighbours": 16} if far else {"neighbours": 3}
    (spread,) = view_psf.responses(design, transfer.rate, places, [transfer.middle], opening(transfer), **sampled)
    for direction, axis in (("tangential", 0), ("sagittal", 1)):
        truth = view_psf.line_transfer(spread, places, frequency, axis)
        np.testing.assert_allclose(transfer(frequency, "view", direction), truth, atol=tolerance)
    aslant = transfer_of(design, at, (0.8, 0.6))
    wave = [np.exp(-2j * np.pi * np.outer(frequency * part, places)) for part in (0.8, 0.6)]
    truth = np.abs(np.einsum("fx,yx,fy->f", wave[0], spread, wave[1])) / spread.sum()
    np.testing.assert_allclose(aslant(frequency, "view", "tangential"), truth, atol=tolerance)


@pytest.mark.parametrize(
    ("name", "changes", "at", "neighbours"),
    [
        ("ear-speculum", {}, 21.93087008, 4),
        (
            "ear-speculum",
            {"stops": [{"diameter": 3.0, "distance": 10.0, "decentre": (1.0, 0.4)}]},
            18,
            2,
        ),
        ("mismatched-borescope", {"f_ml": 0.9}, 28.46826127, 3),
        ("paper", {"D_F": 9.0}, 215.0, 4),
    ],
)
def test_limits_of_views_have_their_contrast(name, changes, at, neighbours):
    """Where phases turn fast, images overlap or are cut: sums over pupil, microlenses and pixel."""
    design = roslf.load(name)
    design = design.replace(
        {"stops": changes["stops"]} if "stops" in changes else {},
        **{key: value for key, value in changes.items() if key != "stops"},
    )
    transfer = transfer_of(design, at)
    fine = {"samples": 500, "lens": 120, "pixels": 4} if "stops" in changes else {}  # the cut goes through the grid
    discs = list(zip(transfer.openings.centres.tolist(), transfer.openings.radii.tolist(), strict=True))
    for direction, way in (("tangential", (1.0, 0.0)), ("sagittal", (0.0, 1.0))):
        limits = transfer.limits([0.5, 0.1], "view", direction)
        truth = view_psf.transfer(design, transfer.rate, transfer.middle, discs, limits, way, neighbours, **fine)
        np.testing.assert_allclose(np.abs(truth), [0.5, 0.1], atol=0.01)
    aslant, frequency = transfer_of(design, at, (0.8, 0.6)), SHARES[1::2] / design.d
    truth = view_psf.transfer(design, transfer.rate, transfer.middle, discs, frequency, (0.8, 0.6), neighbours, **fine)
    np.testing.assert_allclose(aslant(frequency, "view", "tangential"), np.abs(truth), atol=0.01)


@pytest.mark.parametrize("kind", ["view", "refocused"])
def test_limits_are_where_the_transfer_first_falls(kind):
    """Grazing dips are not passed over: a view of the borescope falls to 0.093 before it rises and falls for good."""
    transfer = transfer_of(roslf.load("mismatched-borescope"), 150.0)
    for level, limit in zip([0.5, 0.1], transfer.limits([0.5, 0.1], kind, "sagittal"), strict=True):
        assert transfer([limit], kind, "sagittal").item() == pytest.approx(level, abs=1e-4)
        assert (transfer(np.linspace(0, 0.999 * limit, 150), kind, "sagittal") > level).all()


@pytest.mark.parametrize("changes", [{"d": 1.0, "f_ml": 2.1, "wavelength": 1e-5}, {"d": 12.0}, {"wavelength": 1e-6}])
@pytest.mark.parametrize("shape", ["square", "circular"])
def test_views_of_coarse_microlenses_follow_rays(changes, shape):
    """Straight rays from the pixel through all of its microlens."""
    design = PAPER.replace({"microlens_array.lens_shape": shape}, **changes)
    transfer = transfer_of(design, 215.0)
    beta = 1 / design.f_ml - 1 / design.d_2 - float(Camera.of(design).vergence)
    rng = np.random.default_rng(1)
    w = (rng.random((2, 400_000)) - 0.5) * design.d
    seen = (rng.random((2, 400_000)) - 0.5) * design.q + w * beta * design.d_2
    through = np.hypot(*seen) <= transfer.openings.radii[0]
    if shape == "circular":
        through &= np.hypot(*w) <= design.d / 2
    frequency = np.array([0.2, 0.5, 0.9]) / design.d
    waves = np.exp(-2j * np.pi * np.outer(frequency, (w[0] - transfer.rate * seen[0])[through]))
    truth = np.abs(waves.mean(1))
    np.testing.assert_allclose(transfer(frequency, "view", "tangential"), truth, atol=0.01)


def test_a_view_of_coarse_microlenses_is_diffracted():
    """In green light those of 1 mm are off rays by 0.012 at a pitch's last period: so is the wave, summed up."""
    design = PAPER.replace(d=1.0, f_ml=2.1)
    transfer = transfer_of(design, 215.0)
    frequency = np.array([0.2, 0.5, 0.9]) / design.d
    discs = list(zip(transfer.openings.centres.tolist(), transfer.openings.radii.tolist(), strict=True))
    fine = {"samples": 300, "lens": 500, "pixels": 4}
    truth = view_psf.transfer(design, transfer.rate, transfer.middle, discs, frequency, (1.0, 0.0), 0, **fine)
    np.testing.assert_allclose(transfer(frequency, "view", "tangential"), np.abs(truth), atol=2e-3)


def test_images_that_overlap_a_hundred_times_leave_the_fap_alone():
    """A pixel's microlenses lie where rays through all of the FAP cross the array: a disc of them."""
    design = PAPER.replace(D_F=290.0, D=600.0)
    transfer = transfer_of(design, 215.0)
    pitch = 1 + design.d_2 * float(Camera.of(design).vergence)
    width = 2 * float(transfer.openings.radii[0]) * abs(transfer.rate + 1 / pitch)
    x = np.array([0.3, 0.7, 1.0]) * math.pi
    truth = np.abs(2 * j1(x) / x)
    np.testing.assert_allclose(transfer(x / math.pi / width, "view", "sagittal"), truth, atol=0.005)


def test_the_finest_microlenses_take_no_more_rows_of_the_pupil():
    """Faster phases than count need none: as with thousands of rows, and at a millionth of the pitch as many."""

    class ManyRows(FieldTransfer):
        def _rows(self, up, steps):
            return 1500

    fine = transfer_of(PAPER.replace(d=63e-6), 215.0)
    nu = np.array([0.01, 0.1, 0.3, 0.6]) / fine._width
    truth = ManyRows(**{key: getattr(fine, key) for key in fine.__dataclass_fields__})(nu, "view", "sagittal")
    np.testing.assert_allclose(fine(nu, "view", "sagittal"), truth, atol=1e-9)
    finest = transfer_of(PAPER.replace(d=63e-9), 215.0)
    up, steps = finest._orders(0.0, np.array([0.0, 1.0]))[1:3]
    assert finest._rows(up, steps) < 300


@pytest.mark.parametrize("cycles", [0.3, 40.0, 900.0, 2e4, 1e6])
def test_the_overlap_of_circles_whose_phases_turn_fast(cycles):
    """Of a circle with itself: the Airy pattern, however many nodes its phases would ask for."""
    seen = LENS_SHAPES["circular"].shared(1.0, np.zeros((1, 2)), np.array([[cycles, 0.0]]))
    assert seen.item() == pytest.approx(2 * j1(math.pi * cycles) / (math.pi * cycles), abs=1e-5)


def test_the_slanted_edge_of_the_wave_image():
    """One pixel of every microlens, points of the wave image added up to an edge: ISO 12233's way, within 2 %."""
    transfer = transfer_of(PAPER)
    places = np.arange(-32, 32) * PAPER.d / 8
    (spread,) = view_psf.responses(PAPER, 0.0, places, [(0.0, 0.0)], opening(transfer), neighbours=3)
    # The points are those of the wave image: the middle pixel of the middle microlens.
    aside = [0, 3, 6, 10]
    region, seen = Region(2299, 1539, 2, 2), []
    for k in aside:
        x = -places[32 + k] / 0.4
        image = point_image(PointSource(Camera.of(PAPER), x, 0.0, 350.0), region, (PAPER.wavelength,), 0.05)
        seen.append(float(image.sum()))
    corners = [(a * PAPER.q / 2, b * PAPER.q / 2) for a in (-1, 1) for b in (-1, 1)]
    four = view_psf.responses(PAPER, 0.0, places, corners, opening(transfer), nodes=2, neighbours=2).sum(0)[32]
    told = np.array([four[32 + k] for k in aside])
    np.testing.assert_allclose(np.array(seen) / seen[0], told / told[0], atol=0.01)  # 5 % of far tails left out
    # An edge through many microlenses, ten to one: each sees the light of the points on one side.
    line = spread.sum(0) / spread.sum()
    u = np.arange(-12, 13)
    distance = ((u[None, :] + u[:, None] / 10) * PAPER.d).ravel() / math.hypot(1, 0.1)
    edge = np.interp(distance, places, np.cumsum(line) - line / 2)
    step = PAPER.d / 8
    bins = np.round(distance / step).astype(int)
    kept = np.abs(bins) <= 60
    middle = np.array([edge[kept][bins[kept] == k].mean() for k in range(-60, 61)])
    fine = np.gradient(middle, step)
    at = np.arange(-60, 61) * step
    frequency = np.array([0.1, 0.2, 0.4, 0.6]) / PAPER.d
    measured = np.abs(np.exp(-2j * np.pi * np.outer(frequency, at)) @ fine) * step
    measured /= np.sinc(frequency * step) * np.sinc(2 * frequency * step)  # of bins and of differences
    np.testing.assert_allclose(transfer(frequency, "view", "tangential"), measured, atol=0.02)


@pytest.mark.parametrize(("f_ml", "at"), [(2.0, None), (2.4, 190.0)])
def test_the_refocused_image_adds_up_moved_views(f_ml, at):
    """All pixels about a microlens, each moved back; their tails' 1/n by Richardson's step."""
    design = PAPER.replace({"sensor.pixel": 0.0145}, f_ml=f_ml)
    transfer, frequency = transfer_of(design, at), SHARES[:4] / design.d
    places = np.arange(-32, 32) * design.d / 8
    reach = np.arange(-6, 7)
    pixels = [(a * design.q, b * design.q) for b in reach for a in reach]
    spreads = view_psf.responses(design, transfer.rate, places, pixels, opening(transfer), samples=48)

    def total(n):
        moved = 0.0
        for (x, y), spread in zip(pixels, spreads, strict=False):
            if max(abs(x), abs(y)) <= (n + 0.5) * design.q:
                wave = np.exp(-2j * np.pi * np.outer(np.append(0.0, frequency), places + transfer.rate * x))
                moved = moved + wave @ spread.sum(0)
        return moved

    truth = np.abs(2 * total(6) - total(3))
    np.testing.assert_allclose(transfer(frequency, "refocused", "tangential"), truth[1:] / truth[0], atol=0.02)


def test_limits_of_the_refocused_image():
    """Rays leave the microlens's footprint; microlenses far finer than the spot leave the pupil's own diffraction."""
    sharp = Camera.of(PAPER.replace(wavelength=1e-7))
    assert float(resolution.axial_limit(sharp, 0.0, 0.5)) * 0.063 == pytest.approx(0.603355, rel=1e-4)
    fine = Camera.of(PAPER.replace(d=1e-4, d_2=1e-3))
    cutoff = 2.9 / (550e-6 * float(fine.A))
    assert float(resolution.axial_limit(fine, 0.0, 0.5)) / cutoff == pytest.approx(0.403973, rel=1e-3)
    disc = PAPER.replace({"microlens_array.lens_shape": "circular"}, wavelength=1e-7)
    assert float(resolution.axial_limit(Camera.of(disc), 0.0, 0.5)) * 0.063 == pytest.approx(0.70510, rel=1e-3)
    for at in (None, 200.0):
        (half, tenth) = transfer_of(PAPER, at).limits([0.5, 0.1], "refocused", "sagittal")
        scale = float(QUANTITIES["object_sample_mm"](Camera.of(PAPER), at)) / 0.063
        assert half / scale == pytest.approx(float(QUANTITIES["mtf50_lp_per_mm"](Camera.of(PAPER), at)), rel=2e-3)
        assert tenth / scale == pytest.approx(float(QUANTITIES["mtf10_lp_per_mm"](Camera.of(PAPER), at)), rel=2e-3)


def test_a_view_of_a_sharp_camera_shows_the_microlens_alone():
    """96 independent views across an image: in focus a square microlens's box, whatever the pixel sees of the FAP."""
    pipe = roslf.load("pipe-bore")
    frequency = np.linspace(0.1, 1.4, 9) / pipe.d
    for direction in ("tangential", "sagittal"):
        seen = transfer_of(pipe)(frequency, "view", direction)
        np.testing.assert_allclose(seen, np.abs(np.sinc(frequency * pipe.d)), atol=0.02)


def test_a_dark_field_has_no_transfer():
    cut = PAPER.replace({"stops": [{"diameter": 0.5, "distance": 110.0, "decentre": (5.0, 0.0)}]})
    transfer = transfer_of(cut)
    dark = FieldTransfer(transfer.camera, transfer.openings, None, 0.0, 1.0, 1.0, (1.0, 0.0), 1.0)
    assert np.isnan(dark([1.0], "view", "tangential")).all()
    assert np.isnan(dark.limits([0.5], "refocused", "sagittal")).all()


@pytest.mark.parametrize("name", ["paper", "rigid-scope", "arthroscope", "grin-needle", "video-otoscope"])
def test_depth_of_field_ends_where_a_point_spreads_over_a_pitch(name):
    """Rays from both ends of the part of the FAP, through what stands before the lens, to the array."""
    camera = Camera.of(roslf.load(name))
    for kind in ("refocused", "view"):
        sharp, width = depth_of_field(camera, kind), float(_pupil_part(camera, kind))
        for end in sharp:
            if not 0 < float(end) < math.inf:
                continue
            plane = camera.plane(float(end) + camera.tip)
            slopes = []
            for a in (-width / 2, width / 2):  # from the axis point of the plane through a place of the FAP
                o = a / (float(plane.distance) - float(camera.d_3))
                height = a + o * float(camera.d_3)
                slopes.append(height + float(camera.d_1) * (o - height / float(camera.f)))
            assert abs(slopes[1] - slopes[0]) == pytest.approx(float(camera.d), rel=1e-9)
        nearest = float(hyperfocal(camera, kind))
        if math.isfinite(nearest):
            focus = nearest + float(camera.tip)
            ends = [depth_of_field(camera.replace({"d_f": focus * s}), kind).far for s in (1 - 1e-6, 1 + 1e-6)]
            assert math.isfinite(float(ends[0]))
            assert math.isinf(float(ends[1]))


@pytest.mark.parametrize("name", ["arthroscope", "cystoscope", "grin-needle", "video-otoscope"])
@pytest.mark.parametrize("kind", ["refocused", "view"])
def test_without_a_hyperfocal_plane_all_focal_planes_are_alike(name, kind):
    """0 where all ahead of the tip are sharp to infinity, nan where none is: against focal planes all over."""
    base = Camera.of(roslf.load(name).thin_twin)
    rng = np.random.default_rng(5)
    sizes = ["main_lens.focal_length", "aperture.diameter", "microlens_array.pitch", "sensor.distance"]
    several = {place: base[place] * np.exp(rng.normal(0, 0.7, 400)) for place in sizes}
    cameras = base.replace(several)
    nearest = hyperfocal(cameras, kind)
    for k in np.flatnonzero(cameras.valid & ~(nearest > 0)):
        planes = {"main_lens.focal_plane": float(base.tip) + np.geomspace(1e-3, 1e5, 60)}
        built = base.replace({place: np.full(60, values[k]) for place, values in several.items()} | planes)
        far = depth_of_field(built, kind).far[built.valid]
        assert np.isinf(far).all() if nearest[k] == 0 else np.isfinite(far).all()


def test_plenoptisign_where_the_models_agree():
    """Its default camera: a plane refocused by a pixel's step, and where the outermost pixels' beams part about it.

    A microlens's beam is as wide as `footprint` and its pixel's share of the pupil; PlenoptiSign's own test has
    962.7459, 1110.0123 and 838.1359 mm, counted from the array.
    """
    f, exit_pupil, pixels = 193.2935, 111.0324, 13
    z = f - exit_pupil  # behind the lens; focused at infinity
    numbers = {"f": f, "d_f": 1e10, "d_3": f * z / (z - f), "d_2": 2.75, "f_ml": 2.75, "d": 0.125, "q": 0.009}
    camera = Camera.of(roslf.load("paper"), {k: np.array(v) for k, v in numbers.items()})
    across = float(view_baseline(camera))
    depth = float(light_field.depth_of_slope(camera, -1.0))
    from_array = float(camera.d_3) + f - 65.5563
    assert depth + from_array == pytest.approx(962.7459, abs=1e-3)

    def parted(at, sign):
        """Room between the two beams at Z_F [mm on the object]."""
        aside = (pixels - 1) * across * (at / depth - 1)
        beam = footprint(camera, at + float(camera.d_3)) + across * abs(at / float(camera.gap) - 1)
        return sign * aside - beam

    for sign, told in ((1, 1110.0123), (-1, 838.1359)):
        low, high = sorted((depth, told - from_array + sign * 40))
        for _ in range(60):
            middle = (low + high) / 2
            low, high = (middle, high) if (parted(middle, sign) < 0) == (sign > 0) else (low, middle)
        assert low + from_array == pytest.approx(told, abs=1e-2)
