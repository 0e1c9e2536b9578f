"""How a light field's pictures are shaded."""

import numpy as np

from roslf_design.reporting.decode.pictures import contrast


def test_an_even_picture_is_not_stretched_from_noise_to_black():
    noise = np.random.default_rng(1).normal(0, 1e-4, (40, 40))
    weight = np.ones((40, 40))
    low, high = contrast(0.9 + noise, weight)
    assert low == 0
    assert 0.9 < high < 0.901
    low, high = contrast(0.9 + 100 * noise, weight)  # 1 % rms is a picture
    assert 0.86 < low < 0.88
    assert 0.92 < high < 0.94
