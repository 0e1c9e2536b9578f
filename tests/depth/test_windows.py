"""Errors of windows by many draws of noise."""

import numpy as np

from roslf_design.depth.windows import TERMS, WindowFit, _fit_windows, box


def test_errors_at_a_corner_are_what_values_carried_there_scatter_by():
    """A slope by a wide window errs with what the near one says where both lie to one side of the microlens."""
    shape, rng = (16, 16), np.random.default_rng(3)
    v, u = np.mgrid[: shape[0], : shape[1]].astype(float)
    fits, zero, some = [], np.zeros(shape), np.ones(shape, bool)
    for _ in range(800):
        d, light = rng.standard_normal(shape) / 20, np.full(shape, 400.0)  # of single microlenses, and 1/d^2
        moments = [light * part for part in (1, u, v, u * u, u * v, v * v)] + [light * d * part for part in (1, u, v)]
        others = [light, -light * d, zero, zero, zero, light * d * d, zero + 1, zero + 1, zero + 1, zero + 1]
        terms, fit = np.stack(moments + others), np.empty((len(WindowFit.__dataclass_fields__), *shape))
        assert len(terms) == TERMS
        _fit_windows.compiled(box(terms, 5), 0, box(terms, 15), zero, some, 1.0, 1.0, fit)
        fits.append(fit)
    scatter = np.std([fit[0] for fit in fits], axis=0)
    told = np.sqrt(np.mean([fit[1] ** 2 for fit in fits], axis=0))
    corners = np.s_[[0, 0, -1, -1], [0, -1, 0, -1]]
    assert abs((scatter / told)[corners].mean() - 1) < 0.03  # 1.12 without what both have in common
    assert np.abs((scatter / told)[7:9, 7:9].mean() - 1) < 0.03
