"""Decoding against images whose every sample is known, and a real light-field microscope."""

import math
from dataclasses import replace

import numpy as np
import pytest

from roslf_design.calibration import CalibrationError, CentreLattice, Decoder, decode, find_centres
from roslf_design.calibration.frames import saturation_level
from tests.oracles.calibration import nodes_over, white_image


def lattice_of(turn, layout, pitch=9.7, origin=(101.3, 80.9)):
    ahead = turn + (math.pi / 2 if layout == "square" else math.pi / 3)
    first, second = ((pitch * math.cos(a), pitch * math.sin(a)) for a in (turn, ahead))
    return CentreLattice(origin, first, second, layout)


def quadratic(x, y):
    return 3 + 0.02 * x - 0.01 * y + 1e-4 * x * x - 2e-4 * x * y + 1.5e-4 * y * y


def position_on_sensor(field, lattice):
    """Where the sample (t, s, v, u) was taken, from the definition of the coordinates alone."""
    t, s, v, u = np.meshgrid(field.t, field.s, field.v, field.u, indexing="ij")
    along = np.asarray(lattice.first) / np.hypot(*lattice.first)
    across = np.array([-along[1], along[0]])
    pitch = lattice.pitch
    return [lattice.origin[k] + (u * pitch + s) * along[k] + (v * pitch + t) * across[k] for k in (0, 1)]


@pytest.mark.parametrize("lattice", [lattice_of(0.1, "square"), lattice_of(0.05, "hexagonal")])
def test_every_sample_of_a_quadratic_image_is_exact(lattice):
    y, x = np.mgrid[0:170, 0:210]
    field = decode(quadratic(x, y), lattice)
    assert field.values.shape == (9, 9, len(field.v), len(field.u))
    seen = field.weight > 0
    assert seen.mean() > 0.7
    expected = quadratic(*position_on_sensor(field, lattice))
    np.testing.assert_allclose(field.values[seen], expected[seen], rtol=3e-6)  # float32
    assert (field.values[~seen] == 0).all()
    steps = np.concatenate([np.diff(field.u), np.diff(field.v)])
    np.testing.assert_allclose(steps, 1 if lattice.layout == "square" else math.sqrt(3) / 2)


def test_the_white_image_takes_off_vignetting_and_the_dark_frame_its_offset():
    truth = nodes_over((200, 200), 12.3, 0.02, "square")
    y, x = np.mgrid[-1:1:200j, -1:1:200j]
    white = 1000 * white_image((200, 200), truth, 5.5, envelope=1 - 0.3 * (x**2 + y**2))
    dark = 50 + np.zeros((200, 200))
    field = decode(0.37 * white + dark, find_centres(white).lattice, white=white + dark, dark=dark)
    seen = field.weight > 0
    np.testing.assert_allclose(field.values[seen] / np.median(field.values[seen]), 1.0, rtol=1e-5)
    assert field.weight[len(field.t) // 2, len(field.s) // 2].max() == pytest.approx(1.0, abs=0.02)
    assert (field.weight[0, 0] == 0).mean() > 0.9  # the corners between round images see nothing


@pytest.mark.parametrize("layout", ["square", "hexagonal"])
def test_images_of_one_camera_share_what_the_white_image_says(layout):
    truth = nodes_over((200, 200), 12.3, 0.02, layout)
    white = 1000 * white_image((200, 200), truth, 5.5)
    lattice = find_centres(white).lattice
    decoder = Decoder.of(lattice, white.shape, white=white)
    first, second = decoder(0.2 * white), decoder(0.6 * white)
    seen = first.weight > 0
    np.testing.assert_allclose(second.values[seen], 3 * first.values[seen], rtol=1e-5)
    np.testing.assert_array_equal(first.values, decode(0.2 * white, lattice, white=white).values)
    assert first.weight is second.weight or layout == "hexagonal"  # whole light fields of weights for every board
    with pytest.raises(CalibrationError, match="differ in size"):
        decoder(white[:100])


def test_a_bent_lattice_is_decoded_where_its_images_are():
    """Discs displaced by up to 2.5 px: read at their own centres, every view inside them is evenly lit."""
    away = nodes_over((500, 500), 12.3, 0.02, "square") - 249.5
    truth = 249.5 + away - 2.5 * away / 353.0 * (np.square(away).sum(axis=1) / 353.0**2)[:, None]
    white = white_image((500, 500), truth, 5.5)
    found = find_centres(white)
    field = decode(white, found.lattice)
    view = field.view(3.0, -2.0)[2:-2, 2:-2]  # 3.6 px off the centre
    straight = decode(white, replace(found.lattice, bend=None)).view(3.0, -2.0)[2:-2, 2:-2]
    assert straight.min() < 0.7  # beside the discs' rims
    np.testing.assert_allclose(view, 1.0, atol=0.02)


def test_a_moving_point_draws_a_line_of_its_slope_in_the_epi():
    slope, pitch = 0.4, 11.0
    y, x = np.mgrid[0:231, 0:231].astype(float)
    u, v = np.round((x - 115) / pitch), np.round((y - 115) / pitch)
    s, t = x - 115 - pitch * u, y - 115 - pitch * v
    raw = np.exp(-0.5 * ((u - 2 - slope * s) ** 2 + (v + 1 - slope * t) ** 2) / 0.8**2)
    field = decode(raw, CentreLattice((115.0, 115.0), (pitch, 0.0), (0.0, pitch), "square"))
    across, down = field.values[5, :, np.abs(field.v + 1).argmin()], field.values[:, 5, :, np.abs(field.u - 2).argmin()]
    for epi, axis, views, expected in ((across, field.u, field.s, 2.0), (down, field.v, field.t, -1.0)):
        centre = ((epi * axis).sum(axis=1) / epi.sum(axis=1))[1:-1]  # the rim of an image is its neighbour's
        np.testing.assert_allclose(np.polyfit(views[1:-1], centre, 1), [slope, expected], atol=2e-3)
    np.testing.assert_array_equal(field.view(1.2, -2.0), field.values[3, 6])
    np.testing.assert_allclose(field.position(3.0, 4.5), (field.u[3], 0.5 * (field.v[4] + field.v[5])))


def test_real_views_show_parallax(shared_data):
    import tifffile

    white, dark, raw = (
        tifffile.imread(shared_data / "guv" / f"{name}_GUVExperim1.tif")
        for name in ("Radiometry", "DarkFrame", "Lightfield")
    )
    field = decode(raw, find_centres(white, dark).lattice, white=white, dark=dark)
    assert (len(field.s), len(field.u), len(field.v)) == (15, 28, 28)
    left, middle, right = (field.view(s) for s in (-5.0, 0.0, 5.0))
    rim = middle.mean() + 0.5 * middle.std()
    widths = [np.ptp(np.flatnonzero((view > rim).sum(axis=0) > 1)) for view in (left, middle, right)]
    assert min(widths[0], widths[2]) > widths[1]  # the vesicle's near and far sides slide apart
    near, far = (np.corrcoef(left.ravel(), other.ravel())[0, 1] for other in (field.view(-4.0), right))
    assert far < 0.95 * near


def test_bad_images_are_named():
    lattice = CentreLattice((45.0, 45.0), (9.0, 0.0), (0.0, 9.0), "square")
    raw = np.zeros((90, 90))
    with pytest.raises(CalibrationError, match="raw image and the white image differ in size"):
        decode(raw, lattice, white=np.ones((90, 80)))
    with pytest.raises(CalibrationError, match="raw image and the dark frame differ in size"):
        decode(raw, lattice, dark=np.ones((80, 90)))
    with pytest.raises(CalibrationError, match=r"raw image is saturated: 100 % .* reach grey level 4095; expose less"):
        decode(np.full((90, 90), 4095, np.uint16), lattice)
    decode(np.full((90, 90), 4000, np.uint16), lattice)  # bright and even, not saturated
    for bits in (8, 10, 12, 14):  # of 16, the highest: no pixel reaches 65535
        step = 2 ** (16 - bits)
        counts = np.random.default_rng(bits).integers(0, 2**bits - 1, (90, 90)).astype(np.uint16) * np.uint16(step)
        decode(counts, lattice)
        assert saturation_level(counts) == 65536 - step
        counts[:, :30] = 65536 - step
        with pytest.raises(CalibrationError, match=rf"saturated: 33 % .* reach grey level {65536 - step}; expose less"):
            decode(counts, lattice)
