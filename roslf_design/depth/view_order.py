"""Order of the views in their grid: named as they stand, or turned or mirrored against their names."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..calibration.decoding import LightField

SIDE = 48
"""Pixels along each side of a window that orders are compared on."""
NEAR = 9
"""Pixels along each side that move alike, about."""
WINDOWS = 3
"""Windows compared, those with most texture along both axes."""
VIEWS = 6
"""Views along each side that are compared, about."""
CLEARLY = 0.6
"""Share of the named order's disagreement between views below which another order is believed. In the right order views
of a Lytro disagree by 0.2 to 0.6 of what they do in the next best; where nothing moves between views, by the same."""

MUCH_MORE = 1.7
"""Times as much of what neighbouring views differ by that movement explains in the named order as in any other, from
which no more is looked at: 2.5 to 20 times in views as they are named, 1.3 at most in others."""
BEYOND_DOUBT = 2.0
"""Logarithm of what other orders disagree by on one window, over the named one's, above which no more are looked at."""


class _ViewOrder(NamedTuple):
    """Grid of views against their names. Half a turn more fits alike, with near and far swapped."""

    transposed: bool
    """True where rows are columns."""
    mirrored: bool
    """True where one axis runs backwards."""

    def of(self, field: LightField) -> LightField:
        """Light field with its views in this order, s and t as they were."""
        values, weight, s, t = field.values, field.weight, field.s, field.t
        if self.transposed:
            values, weight, s, t = values.swapaxes(0, 1), weight.swapaxes(0, 1), t, s
        if self.mirrored:
            values, weight = values[:, ::-1], weight[:, ::-1]
        return replace(field, values=np.ascontiguousarray(values), weight=np.ascontiguousarray(weight), s=s, t=t)

    @property
    def change(self) -> str:
        """Change against the names, in words; empty where there is none."""
        if self.transposed:
            return "rows and columns of views are swapped" + (", and one of them reversed" if self.mirrored else "")
        return "columns of views are reversed" if self.mirrored else ""


AS_NAMED = _ViewOrder(False, False)
ORDERS = (AS_NAMED, _ViewOrder(True, False), _ViewOrder(False, True), _ViewOrder(True, True))


class _OrderedViews(NamedTuple):
    """Light field in the order in which its views agree."""

    field: LightField
    order: _ViewOrder
    agreement: float
    """Rms by which views disagree in the named order, over that in this one."""

    @property
    def warning(self) -> str:
        """Sentence on an order that is not the named one; empty where it is."""
        if self.order == AS_NAMED:
            return ""
        return (
            f"{self.order.change} against their names: so views agree {self.agreement:.2g} times better, and so they "
            "are taken; whether also both are reversed, which swaps near and far, their pictures do not show"
        )


def in_order(
    field: LightField, disagreement: Callable[[LightField], float], progress: Callable[[float], None] = lambda _: None
) -> _OrderedViews:
    """Views in the order in which they agree, near a few windows with texture; as named unless another fits clearly.

    Parameters
    ----------
    field : LightField
        As named, of views two or more along each side: in a single row of views nothing shows its order.
    disagreement : callable
        Variance by which views of a small light field differ along their best disparities, in any unit.
    """
    if min(field.values.shape[:2]) < 2 or _moves_as_named(field) or not (windows := _windows(field)):
        return _OrderedViews(field, AS_NAMED, 1.0)
    found = []
    for number, window in enumerate(windows):
        progress(number / len(windows))
        part = _part(field, *window)
        found.append(np.log([max(disagreement(order.of(part)), 1e-12) for order in ORDERS]))
        if len(found) == 1 and min(found[0][1:]) - found[0][0] > BEYOND_DOUBT:
            return _OrderedViews(field, AS_NAMED, 1.0)
    logs = np.median(np.array(found) - np.array(found)[:, :1], axis=0)
    ratio = dict(zip(ORDERS, map(float, np.exp(logs)), strict=True))
    best = min(ORDERS, key=ratio.__getitem__)
    if ratio[best] > CLEARLY:
        return _OrderedViews(field, AS_NAMED, 1.0)
    return _OrderedViews(best.of(field), best, ratio[best] ** -0.5)


def _moves_as_named(field: LightField) -> bool:
    """True where the middle views differ as by movement in the named order, and in no other nearly so."""
    t, s = (slice(axis.size // 2 - 1, axis.size // 2 + 2) for axis in (field.t, field.s))
    middle = field.values[t, s]
    if middle.shape[:2] != (3, 3) or not (field.weight[t, s] > 0).all():
        return False
    down, along = np.gradient(middle[1, 1])
    over, under = middle[1, 2] - middle[1, 0], middle[2, 1] - middle[0, 1]
    power = ndimage.uniform_filter(along**2 + down**2, NEAR)
    steps = (over, under), (under, over), (-over, under), (-under, over)
    named, *others = (
        float((np.square(ndimage.uniform_filter(a * along + b * down, NEAR))[power > 0] / power[power > 0]).sum())
        for a, b in steps
    )
    return named > MUCH_MORE * max(others)


def _windows(field: LightField) -> list[tuple[int, int]]:
    """First row and column of windows with most texture along both axes, none twice."""
    view = field.view().astype(float)
    along, down = (ndimage.uniform_filter(np.gradient(view, axis=axis) ** 2, SIDE) for axis in (1, 0))
    texture: NDArray[np.float64] = np.minimum(along, down)
    half = SIDE // 2
    rows, columns = texture.shape
    if min(rows, columns) <= SIDE:
        return [(0, 0)] if texture.max() > 0 else []
    inner = texture[half : rows - half, half : columns - half].copy()
    windows = []
    for _ in range(WINDOWS):
        row, column = (int(at) for at in np.unravel_index(inner.argmax(), inner.shape))
        if not inner[row, column] > 0:
            break
        windows.append((row, column))
        inner[max(0, row - half) : row + half, max(0, column - half) : column + half] = 0
    return windows


def _part(field: LightField, row: int, column: int) -> LightField:
    """Light field of a window, and of some of its views."""
    t, s = (slice(None, None, max(1, round((axis.size - 1) / (VIEWS - 1)))) for axis in (field.t, field.s))
    v, u = slice(row, row + SIDE), slice(column, column + SIDE)
    return replace(
        field, values=field.values[t, s, v, u], weight=field.weight[t, s, v, u], s=field.s[s], t=field.t[t],
        u=field.u[u], v=field.v[v],
    )  # fmt: skip
