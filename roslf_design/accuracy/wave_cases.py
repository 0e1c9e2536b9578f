"""Hard cases of diffraction behind cut pupils: a cat's eye almost closed, and a rim that only just begins to cut."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ..design import Design
from .cases import Budget, HardCase, Trial
from .cut_methods import light_at
from .digits import many_digits
from .shape_cases import radii_of
from .walks import gaps

FEWER = 4
"""Each reference is an integral at many digits: a walk takes so many times fewer steps than others."""
PER_STEP = 40
"""Digits that references are integrated to."""

QUADRATURE = Budget(64, "a sum of some thousand products, whatever the gap: nothing is granted to the condition", False)


OUTLINE = Budget(16, "in units of the last place of R/w: where rims cross is known to the larger one's", False)


def _ours(r: float, R: float, d: float, w: float, x: float) -> float:
    return light_at(np.array([[0.0, 0.0], [d, 0.0]]), np.array([r, R]), w, (x, 0.0))


def _exact(r: Any, R: Any, d: Any, w: Any, x: Any) -> Any:
    """Slices across the line of centres; each slice's light by the sine integral."""
    mp = many_digits()
    low, high = max(-r, d - R), min(r, d + R)
    if high <= low:
        return mp.mpf(0)
    cross = (d * d + r * r - R * R) / (2 * d)
    places = [low, *([cross] if low < cross < high else []), high]

    def light(at: Any) -> Any:
        half = mp.sqrt(max(min(r * r - at * at, R * R - (at - d) ** 2), 0))
        t = mp.pi * half / w
        # Integral of sinc^2 from -half to half.
        column = 2 * (mp.si(2 * t) - mp.sin(t) ** 2 / t) / mp.pi if t else mp.mpf(0)
        return column * mp.sincpi((at - x) / w) ** 2 / w

    with mp.workdps(PER_STEP):
        # The integral in units of the slice's width: a thin one has no small numbers of its own.
        return mp.quad(light, places)


def _sampled(r: float, R: float, d: float, w: float, x: float) -> float:
    """64 x 64 points of the pupil's square."""
    unit = (np.arange(64) + 0.5) / 32 - 1
    px, py = r * unit, r * unit[:, None]
    kept = (px**2 + py**2 <= r * r) & ((px - d) ** 2 + py**2 <= R * R)
    light = np.sinc((px - x) / w) ** 2 * np.sinc(py / w) ** 2
    return float((kept * light).sum() * (r / 32) ** 2 / w**2)


def _reach(r: float, R: float, d: float, w: float, x: float) -> float:
    return max(1.0, R / w)


def _sizes(design: Design) -> tuple[float, float, float]:
    """Radii of the FAP's image and of a larger rim's, and the blur width [mm]."""
    r, R = radii_of(design)
    return r, R, max(design.wavelength * design.d_2 / design.d, 0.3 * r)


def almost_closed(design: Design, rng: np.random.Generator, count: int) -> Iterator[Trial]:
    """Cat's eyes with less and less left, seen at their own place."""
    r, R, w = _sizes(design)
    for gap in gaps(rng, max(3, count // FEWER), 1e-13):
        given = {"r": r, "R": R, "d": (r + R) - gap * r, "w": w * float(rng.uniform(0.7, 1.4)), "x": r}
        yield Trial("light through a sliver", gap, given, _ours, _exact, _sampled)


def just_cut(design: Design, rng: np.random.Generator, count: int) -> Iterator[Trial]:
    """Rims that begin to cut, from both sides of the seam."""
    r, R, w = _sizes(design)
    for gap in gaps(rng, max(3, count // FEWER), 1e-15):
        side = float(rng.choice([-1, 1]))
        given = {"r": r, "R": R, "d": (R - r) + side * gap * r, "w": w * float(rng.uniform(0.7, 1.4)), "x": -0.6 * r}
        yield Trial("light of a cat's eye", gap, given, _ours, _exact, _sampled, _reach)


WAVES = (
    HardCase(
        "cat's eye almost closed, waves",
        "samples miss it; slices lose their length",
        "slices' weights scaled to the sliver's own area",
        almost_closed,
        {"light through a sliver": QUADRATURE},
        "light through a sliver",
        "width of what is left over the radius",
    ),
    HardCase(
        "rims almost tangent, waves",
        "slices end in square roots that all but meet",
        "Green's theorem along the rims, smooth whatever they touch",
        just_cut,
        {"light of a cat's eye": OUTLINE},
        "light of a cat's eye",
        "how far the rim cuts in over the radius",
    ),
)
"""Rows about diffraction images."""
