"""Series of depth noise over many builds against the sums that they stand for: promise and cost."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.theory import disparity_error, information_series
from roslf_design.theory.disparity_information import summed_information
from roslf_design.theory.quantities import QUANTITIES

LENGTHS = (
    "aperture.diameter",
    "aperture.distance",
    "main_lens.focal_length",
    "main_lens.focal_plane",
    "microlens_array.distance",
    "microlens_array.pitch",
    "microlens_array.focal_length",
    "sensor.distance",
    "sensor.pixel",
    "depth.contrast",
    "light.wavelength",
)


def builds(name, widths, shape, count, seed):
    """Builds of a design, all of whose lengths vary, each by its width."""
    camera, draw = Camera.of(roslf.load(name)), np.random.default_rng(seed)
    free = [place for place in LENGTHS if place in camera.numbers]
    away = draw.normal(size=(count, len(free))) if shape == "normal" else draw.uniform(-1.7, 1.7, (count, len(free)))
    scale = 1 + away * np.broadcast_to(widths, len(LENGTHS))[: len(free)]
    return camera.replace({place: camera[place] * scale[:, k] for k, place in enumerate(free)})


def summed_one_by_one(images, c, level):
    return summed_information(images, c, level, whole=True)


@pytest.mark.parametrize("shape", ["normal", "uniform"])
@pytest.mark.parametrize("name", ["rigid-scope", "ear-speculum", "video-otoscope", "paper"])
def test_sigma_is_that_of_sums_to_what_series_promise(name, shape, monkeypatch):
    """Every build of some, whose lengths all vary at once, by 0.1 to 5 % each; to 1e-4."""
    for seed in range(2):
        widths = np.exp(np.random.default_rng(seed).uniform(*np.log([1e-3, 0.05]), len(LENGTHS)))
        many = builds(name, widths * [0.3, 1.0][seed], shape, 700, seed)
        ours = QUANTITIES["sigma_z_mm"](many)
        with monkeypatch.context() as exact:
            exact.setattr(disparity_error, "interpolated_information", summed_one_by_one)
            assert_allclose(ours, QUANTITIES["sigma_z_mm"](many), rtol=1e-4)


@pytest.mark.parametrize(("name", "width", "most"), [("ear-speculum", 0.01, 0.3), ("ear-speculum", 0.03, 1.22)])
def test_series_that_are_not_right_cost_a_fifth_of_the_sums_at_most(name, width, most, monkeypatch):
    """And the images they are checked at; where builds are alike they save most of the sums."""
    sums, count = [], 2000

    def counted(images, *args, **options):
        sums.append(images.pitch.size)
        return summed_information(images, *args, **options)

    for known in (information_series._logarithms, information_series._series):
        known.cache_clear()
    monkeypatch.setattr(information_series, "summed_information", counted)
    QUANTITIES["sigma_z_mm"](builds(name, width, "normal", count, 1))
    assert 0 < sum(sums) < most * count
