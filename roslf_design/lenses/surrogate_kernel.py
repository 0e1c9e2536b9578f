"""Evaluating a surrogate: what depends on the microlens once for each of them, the rest for each of its rays.

Every polynomial is ``sum_t c_t(u) m_t`` with the nine products m_t of v and w up to the fourth degree in the pupil,
1, v, w, v^2, v w, w^2, v^3, v^2 w, v^4, and c_t a polynomial in u. The inner loops have no branches and no calls, so
that the compiler takes several rays at once.
"""

from __future__ import annotations

from typing import Any

from .._jit import kernel

TERMS = 9


@kernel()
def horner(coefficients: Any, begin: int, count: int, u: float) -> float:
    """Polynomial in `u` whose `count` coefficients, lowest power first, begin at `begin`."""
    total = 0.0
    for term in range(begin + count - 1, begin - 1, -1):
        total = total * u + coefficients[term]
    return total


@kernel()
def combine(a: Any, v: float, w: float) -> float:
    """Sum of the nine products with the weights `a`."""
    square = v * v
    low: float = a[0] + a[1] * v + a[2] * w + a[3] * square + a[4] * (v * w) + a[5] * (w * w)
    high: float = square * (a[6] * v + a[7] * w + a[8] * square)
    return low + high


@kernel()
def evaluate(
    x: Any,
    y: Any,
    sx: Any,
    sy: Any,
    rows: int,
    m: int,
    slope: float,
    reach: float,
    chief: Any,
    coefficients: Any,
    order: int,
    field: float,
    pupil: float,
    work: Any,
    out_x: Any,
    out_y: Any,
    out_sx: Any,
    out_sy: Any,
    room: Any,
) -> None:
    """Object-side rays of `m` image-side ones from each of `rows` points of the array.

    `coefficients` holds P, Q, R, S and then rooms, nine times ``order + 1`` numbers each; `field` and `pupil` scale x
    and y; `work` has room for nine numbers a polynomial.
    """
    length = TERMS * (order + 1)
    polynomials = len(coefficients) // length
    p, q, r, s = work[0:9], work[9:18], work[18:27], work[27:36]
    for row in range(rows):
        hx, hy = x[row] / field, y[row] / field
        u = hx * hx + hy * hy
        for term in range(TERMS * polynomials):
            work[term] = horner(coefficients, term * (order + 1), order + 1, u)
        k = horner(chief, 0, len(chief), u)
        ax, ay = (slope - k) * x[row] / pupil, (slope - k) * y[row] / pupil
        scale = reach / pupil
        first, last = row * m, row * m + m
        bx, by = sx[first:last], sy[first:last]
        ox, oy, osx, osy = out_x[first:last], out_y[first:last], out_sx[first:last], out_sy[first:last]
        rooms = room[first:last]
        for i in range(m):
            px, py = ax - scale * bx[i], ay - scale * by[i]
            v, w = hx * px + hy * py, px * px + py * py
            sp, sq = combine(p, v, w), combine(q, v, w)
            sr, ss = combine(r, v, w), combine(s, v, w)
            ox[i] = sp * hx + sq * px
            oy[i] = sp * hy + sq * py
            osx[i] = sr * hx + ss * px
            osy[i] = sr * hy + ss * py
            rooms[i] = 1.0
        for number in range(4, polynomials):
            a = work[TERMS * number : TERMS * (number + 1)]
            for i in range(m):
                px, py = ax - scale * bx[i], ay - scale * by[i]
                rooms[i] = min(rooms[i], combine(a, hx * px + hy * py, px * px + py * py))
