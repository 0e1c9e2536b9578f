"""What every method is judged against: the same quantities at 30 to 50 digits, by other ways.

Two discs by the textbook's arcs; more of them, and pixels, by slices and mpmath's tanh-sinh rule; diffraction by the
Fourier series with 50-digit Bessel functions; depths by their definition.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..lenses.of_design import camera_of
from .depth_methods import spread
from .digits import many_digits
from .jobs import CUT, LENS, Job
from .wave_methods import centres

Floats = NDArray[np.float64]

SHAPE_DIGITS = 32
PIXEL_DIGITS = 22
WAVE_DIGITS = 50
LENS_DIGITS = 30


def reference(job: Job) -> Floats:
    """The exact result, rounded to double precision; remembered for the last jobs asked for.

    Raises
    ------
    InputError
        mpmath is not installed.
    """
    return _remembered(job)


@lru_cache(maxsize=512)
def _remembered(job: Job) -> Floats:
    mp = many_digits()
    if job.quantity == "diffraction image":
        return _waves(job, mp)
    if job.quantity == CUT:
        from .cut_reference import huygens_image

        return huygens_image(job)
    if job.quantity == LENS:
        return _lens(job)
    if job.quantity == "depth":
        return _depth(job, mp)
    if job.quantity in ("pixel image", "textured image"):
        return _pixels(job, mp)
    return _shape(job, mp)


def _lens(job: Job) -> Floats:
    from .lens_jobs import EVERY, exact_ends, microlens_rays

    place, slope = microlens_rays(job.design, job.axis)
    ends = exact_ends(camera_of(job.design), place[:, ::EVERY], slope[:, ::EVERY], LENS_DIGITS)
    return np.array([[float(x), float(y)] for x, y in ends]).ravel()


def _discs(job: Job, mp: Any) -> list[tuple[Any, Any, Any]]:
    at, radii = job.discs
    return [(mp.mpf(float(x)), mp.mpf(float(y)), mp.mpf(float(r))) for (x, y), r in zip(at, radii, strict=True)]


def _places(discs: list[tuple[Any, Any, Any]], box: tuple[Any, Any, Any, Any] | None, mp: Any) -> list[Any]:
    """Ends of the slices' range and the places where curves change, sorted."""
    low = max(x - r for x, _, r in discs)
    high = min(x + r for x, _, r in discs)
    inner = [x for x, _, _ in discs]
    for (x, y, r), (X, Y, R) in combinations(discs, 2):
        square = (X - x) ** 2 + (Y - y) ** 2
        if square == 0:
            continue
        t = ((r - R) * (r + R) / square + 1) / 2
        root = r * r / square - t * t
        if root >= 0:
            inner += [x + t * (X - x) + side * mp.sqrt(root) * (Y - y) for side in (-1, 1)]
    if box is not None:
        left, bottom, right, top = box
        low, high = max(low, left), min(high, right)
        for x, y, r in discs:
            for edge in (bottom, top):
                root = r * r - (edge - y) ** 2
                if root >= 0:
                    inner += [x - mp.sqrt(root), x + mp.sqrt(root)]
    if high <= low:
        return []
    return [low, *sorted({x for x in inner if low < x < high}), high]


def _span(
    discs: list[tuple[Any, Any, Any]], box: tuple[Any, Any, Any, Any] | None, at: Any, mp: Any
) -> tuple[Any, Any]:
    chords = [(y, mp.sqrt(max(r * r - (at - x) ** 2, 0))) for x, y, r in discs]
    bottom, top = max(y - half for y, half in chords), min(y + half for y, half in chords)
    if box is not None:
        bottom, top = max(bottom, box[1]), min(top, box[3])
    return bottom, max(bottom, top)


def _shape(job: Job, mp: Any) -> Floats:
    with mp.workdps(SHAPE_DIGITS):
        discs = _discs(job, mp)
        places = _places(discs, None, mp)

        def integral(power_x: int, power_y: int) -> Any:
            def slices(x: Any) -> Any:
                bottom, top = _span(discs, None, x, mp)
                return x**power_x * (top ** (power_y + 1) - bottom ** (power_y + 1)) / (power_y + 1)

            return mp.quad(slices, places) if places else mp.mpf(0)

        area = integral(0, 0)
        if job.quantity == "area":
            return np.array([float(area)])
        if job.quantity == "kept fraction":
            return np.array([float(area / (mp.pi * discs[0][2] ** 2))])
        if area == 0:
            return np.array(job.discs[0][0])
        return np.array([float(integral(1, 0) / area), float(integral(0, 1) / area)])


def _pixels(job: Job, mp: Any) -> Floats:
    low, high = job.cells
    at, radii = job.discs
    white = job.quantity == "pixel image"
    corners = [np.stack([x[:, 0], y[:, 1]], -1) for x in (low, high) for y in (low, high)]
    inside = np.all([(np.hypot(*(c[:, None] - at).transpose(2, 0, 1)) < radii).all(1) for c in corners], axis=0)
    nearest = np.clip(at[None], low[:, None], high[:, None]) - at
    outside = (np.hypot(nearest[..., 0], nearest[..., 1]) > radii).any(1)
    found = np.zeros(len(low))
    with mp.workdps(PIXEL_DIGITS):
        discs = _discs(job, mp)
        kx, ky, phase = (mp.mpf(v) for v in job.wave)
        for n in np.flatnonzero(~outside):
            if inside[n] and white:
                found[n] = 1.0
                continue
            box = tuple(mp.mpf(float(v)) for v in (*low[n], *high[n]))
            if white:
                found[n] = float(_quad(discs, box, lambda x, a, b: b - a, mp))
            elif inside[n]:
                found[n] = float(_whole(box, kx, ky, phase, mp))
            else:
                found[n] = float(_quad(discs, box, lambda x, a, b: _line(x, a, b, kx, ky, phase, mp), mp))
    return found


def _quad(discs: Any, box: Any, line: Any, mp: Any) -> Any:
    places = _places(discs, box, mp)
    if not places:
        return mp.mpf(0)
    return mp.quad(lambda x: line(x, *_span(discs, box, x, mp)), places)


def _line(x: Any, bottom: Any, top: Any, kx: Any, ky: Any, phase: Any, mp: Any) -> Any:
    """Integral over y of (1 + cos(2 pi (kx x + ky y + phase)))/2."""
    turn = 2 * mp.pi * (kx * x + phase)
    if ky == 0:
        return (top - bottom) * (1 + mp.cos(turn)) / 2
    rate = 2 * mp.pi * ky
    return (top - bottom) / 2 + (mp.sin(turn + rate * top) - mp.sin(turn + rate * bottom)) / (2 * rate)


def _whole(box: Any, kx: Any, ky: Any, phase: Any, mp: Any) -> Any:
    """A pixel that no disc cuts: product of two sincs."""
    left, bottom, right, top = box
    middle = 2 * mp.pi * (kx * (left + right) / 2 + ky * (bottom + top) / 2 + phase)
    return (1 + mp.cos(middle) * mp.sincpi(kx) * mp.sincpi(ky)) / 2


def _depth(job: Job, mp: Any) -> Floats:
    inverse, sigma = (mp.mpf(v) for v in spread(job))
    with mp.workdps(WAVE_DIGITS):
        return np.array([float((1 / (inverse - sigma) - 1 / (inverse + sigma)) / 2)])


def _waves(job: Job, mp: Any) -> Floats:
    with mp.workdps(WAVE_DIGITS):
        width, pitch, bend = (mp.mpf(v) for v in job.blur)
        radius = mp.mpf(job.radius)
        turns = bend * mp.mpf(job.design.d_2) * mp.mpf(job.design.d) / mp.mpf(job.design.q)
        count = int(mp.floor(pitch / width)) + 1

        def passed(order: int) -> Any:
            frequency = order / pitch
            overlap = max(1 - width * frequency, mp.mpf(0))
            return overlap * mp.sincpi(turns * frequency * overlap) * mp.sincpi(frequency)

        axis = [passed(k) * (2 if k else 1) for k in range(count)]
        bessel = {}
        for m in range(count):
            for n in range(m + 1):
                height = mp.sqrt(m * m + n * n) / pitch
                whole = mp.pi * radius**2
                bessel[m, n] = radius * mp.besselj(1, 2 * mp.pi * radius * height) / height if m else whole
        x, y = (
            [[mp.cos(2 * mp.pi * k * mp.mpf(float(v)) / pitch) for k in range(count)] for v in at]
            for at in centres(job)
        )
        # Along x first: count x width sums, then the rows.
        inner = [
            [mp.fdot((axis[m] * bessel[max(m, n), min(m, n)], column[m]) for m in range(count)) for column in x]
            for n in range(count)
        ]
        found = [
            [mp.fdot((axis[n] * row[n], inner[n][i]) for n in range(count)) / pitch**2 for i in range(len(x))]
            for row in y
        ]
        return np.array([float(v) for line in found for v in line])
