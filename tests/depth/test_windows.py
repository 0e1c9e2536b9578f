"""Errors of windows by many draws of noise."""

import numpy as np
import pytest

from roslf_design.depth.windows import TERMS, WindowFit, _fit_windows, _move_beside, box

SHAPE, CORNERS = (16, 16), np.s_[[0, 0, -1, -1], [0, -1, 0, -1]]


def drawn(density, wide):
    """Fits of windows of 5 to single microlenses, which err by a twentieth each, and planes of these or wider ones."""
    rng, (v, u) = np.random.default_rng(3), np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    zero, light = np.zeros(SHAPE), np.full(SHAPE, 400.0)
    for _ in range(800):
        d = rng.standard_normal(SHAPE) / 20 / np.sqrt(density)  # as samples of squared rows are alike
        moments = [light * part for part in (1, u, v, u * u, u * v, v * v)] + [light * d * part for part in (1, u, v)]
        others = [light, -light * d, zero, zero, zero, light * d * d, zero + 1, zero + 1, zero + 1, zero + 1]
        terms, fit = np.stack(moments + others), np.empty((len(WindowFit.__dataclass_fields__), *SHAPE))
        assert len(terms) == TERMS
        _fit_windows.compiled(box(terms, 5), box(terms, 15)[: TERMS * wide], zero, 1.0, density, fit)
        yield fit


def over_told(fits):
    """Scatter of disparities over the errors told."""
    fits = np.array([fit[:2] for fit in fits])
    return fits[:, 0].std(0) / np.sqrt((fits[:, 1] ** 2).mean(0))


def test_errors_at_a_corner_are_what_values_carried_there_scatter_by():
    """A slope by a wide window errs with what the near one says where both lie to one side of the microlens."""
    ratio = over_told(drawn(1.0, True))
    assert abs(ratio[CORNERS].mean() - 1) < 0.03  # 1.12 without what both have in common
    assert np.abs(ratio[7:9, 7:9].mean() - 1) < 0.03


@pytest.mark.parametrize(("density", "wide"), [(1.0, True), (0.8, True), (0.8, False)])
def test_errors_of_windows_moved_beside_are_what_they_scatter_by(density, wide):
    """What a window of the rim says at its middle errs with the slope that carries it to the corner."""
    misfit, reach = np.zeros(SHAPE), 2
    misfit[CORNERS] = 2.0
    misfit[7:9, 7:9] = 2.0

    def moved(fit):
        out = fit.copy()
        _move_beside.compiled(fit, misfit, reach, out)
        assert (out[0] != fit[0]).sum() == 8
        return out

    ratio = over_told(map(moved, drawn(density, wide)))
    assert abs(ratio[CORNERS].mean() - 1) < 0.03
    assert np.abs(ratio[7:9, 7:9].mean() - 1) < 0.04


def test_steep_surfaces_are_carried_all_the_way():
    fit, misfit = np.zeros((len(WindowFit.__dataclass_fields__), 7, 7)), np.full((7, 7), 2.0)
    fit[1], fit[5], fit[6], fit[7] = 0.01, 40.0, 0.4, -0.3
    misfit[0, 6] = 0.5
    moved = fit.copy()
    _move_beside.compiled(fit, misfit, 3, moved)
    np.testing.assert_allclose(moved[[0, 13, 14], 3, 3], [-3 * 0.4 - 3 * 0.3, -3, 3])
    rows, columns = WindowFit(*moved).middles
    assert (rows[3, 3], columns[3, 3]) == (0, 6)
    assert (rows[0, 0], columns[0, 0]) == (0, 0)
