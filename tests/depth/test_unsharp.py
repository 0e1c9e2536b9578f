"""Views that disagree because the lens is not sharp are told from views of occluded scenes."""

import numpy as np
import pytest

from roslf_design.depth.estimate import DisparityMap, DisparityStatus, PixelNoise
from roslf_design.depth.geometry import GridGeometry
from roslf_design.depth.measure import REASONS, measure
from roslf_design.depth.unmixing import PreparedViews
from roslf_design.reporting.depth.pictures import UNKNOWN
from tests.depth.made import disc, field_of


class Astray:
    """Views that look aside, the outermost so many microlenses to either side."""

    def __init__(self, pupil, far, shape):
        self.pupil = np.broadcast_to(pupil[..., None, None], (*pupil.shape, *shape)).astype(np.float32)
        self.aside = 2 * far * self.pupil**2

    def prepared(self, field):
        return PreparedViews(field, self.pupil, self.aside)

    def jointly(self, *given):
        return None

    def at_phase(self, views, found):
        return None


@pytest.mark.parametrize(("far", "status"), [(1.0, DisparityStatus.INCONSISTENT), (16.0, DisparityStatus.UNSHARP)])
def test_views_that_disagree_far_aside_say_that_the_lens_is_not_sharp(monkeypatch, far, status):
    pupil, lit = disc(7)
    shape = 12, 12
    zero = np.zeros(shape)
    disagree = np.full(shape, DisparityStatus.INCONSISTENT, np.int8)
    disagree[0, 0] = DisparityStatus.NO_TEXTURE
    judged = DisparityMap(zero * np.nan, zero + np.inf, disagree, zero, zero, zero, 5, (-1, 1), (0.0, 0.0))
    monkeypatch.setattr("roslf_design.depth.measure.estimate_disparity", lambda *given, **more: judged)
    light = np.broadcast_to(lit[..., None, None], (*lit.shape, *shape)).astype(np.float32)
    viewing = Astray(pupil, far, shape)
    found = measure(GridGeometry(7), field_of(light, light), PixelNoise(1e5), search=(-1, 1), viewing=viewing)
    assert found.views_aside == pytest.approx(far / 2 * (6 / 7) ** 2 * np.sqrt(2), rel=0.3)
    assert (found.status.ravel()[1:] == status).all()
    assert found.status[0, 0] == DisparityStatus.NO_TEXTURE


def test_reasons_have_colours():
    assert UNKNOWN.keys() == REASONS.keys() - {0}
