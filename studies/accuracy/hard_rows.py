"""The rows of the hard cases: closed forms, shapes, waves and fits, each with its walk towards the singular point."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import mpmath as mp
import numpy as np

from roslf_design.calibration.fit import EpiLines, StepOne, fit_lines, step_two
from roslf_design.calibration.model import Intrinsics, Observations, Poses
from roslf_design.camera import Camera
from roslf_design.design import Design
from roslf_design.design.conjugates import mla_distance
from roslf_design.effects import SceneBrief, Subject
from roslf_design.effects.geometry import cos4
from roslf_design.evaluation.fields import field_discs
from roslf_design.shapes.cells import area_in_rectangle
from roslf_design.shapes.discs import intersect
from roslf_design.theory.f_number import matched
from roslf_design.theory.light_field import back_substitute, view_projection

from .forms import CLOSED, camera_of
from .hard_cases import Budget, HardCase, Trial, Trials
from .oracles.closed_forms import ORACLES, keywords
from .oracles.judging import traced
from .oracles.textbook import TEXTBOOK, cos4_loss, lost_share, overlap
from .shapes import covered_pixels
from .waves import light_at

Numbers = Mapping[str, Any]
"""Arguments of closed forms by keyword; pairs for places."""
Rng = np.random.Generator

JITTER = 1e-3
"""Relative spread by which all other arguments are moved at every step of a walk, so that no round number helps."""

NUMBERS_WITHOUT_LENGTH = frozenset({"magnification", "index", "pixel", "centre", "slope", "disparity_sigma", "exact"})
"""Keywords that do not scale with the camera."""

ISSUE_RADII = (2.2, 25.4)
"""A pupil of 4.4 mm behind a two-inch lens [mm]."""


# --- walks ------------------------------------------------------------------------------------------------------------


def arguments_of(design: Design) -> dict[str, Any]:
    """One value for every keyword of the closed forms: the design's own lengths, and scenes of its own size."""
    camera = Camera.of(design)
    d_3 = design.d_3 or 0.01 * design.f
    x = design.sensor_size[0] / 2
    magnification = float(camera.m)
    field = x / magnification
    stop = design.stops[0] if design.stops else None
    return {
        "focal_length": design.f,
        "focal_plane_distance": design.d_f,
        "mla_distance": design.d_1,
        "pupil_distance": d_3,
        "pupil_diameter": design.D_F,
        "lens_diameter": design.D,
        "sensor_distance": design.d_2,
        "microlens_pitch": design.d,
        "pixel_pitch": design.q,
        "wavelength": design.wavelength,
        "microlens_focal_length": design.f_ml,
        "magnification": magnification,
        "effective_image_distance": float(camera.A),
        "index": 150.0,
        "pixel": 3.3,
        "coordinate": 0.3 * design.D_F,
        "centre": 0.21,
        "slope": 0.013,
        "depth": 0.8 * (design.d_f - design.d_3),
        "disparity_sigma": 0.1,
        "width": design.sensor_size[0],
        "field_radius": field,
        "distance": 1.5 * design.d_f,
        "radius": 0.7 * field,
        "stop_diameter": stop.diameter if stop else 1.4 * design.D_F,
        "stop_distance": stop.distance if stop else 0.4 * d_3,
        "point": (0.6 * field, -0.3 * field),
        "stop_decentre": (0.02 * design.D_F, -0.01 * design.D_F),
        "pupil_decentre": (-0.015 * design.D_F, 0.03 * design.D_F),
        "microlens_centre": (0.7 * x, 0.4 * x),
        "exact": True,
    }


def jittered(numbers: Numbers, rng: Rng) -> dict[str, Any]:
    """The same, every number moved a little."""

    def move(value: Any) -> Any:
        if isinstance(value, bool):
            return value
        if isinstance(value, tuple):
            return tuple(move(part) for part in value)
        return value * (1 + JITTER * float(rng.uniform(-1, 1)))

    return {key: move(value) for key, value in numbers.items()}


class Step(NamedTuple):
    """One place on a walk."""

    gap: float
    """Distance from the singular point, relative to the lengths there; of the walk in scale, the scale."""
    numbers: dict[str, Any]


Walk = Callable[[Numbers, Rng, int], Iterator[Step]]
"""From a design's numbers, a generator and a count of steps."""


def gaps(rng: Rng, count: int, least: float = 1e-16) -> list[float]:
    """Log-uniform between 0.1 and `least`, largest first."""
    return sorted((10 ** float(rng.uniform(math.log10(least), -1)) for _ in range(count)), reverse=True)


def approach(target: float, rng: Rng, count: int, above_only: bool = False) -> Iterator[float]:
    """Values on the way to a target from both sides, the last its very neighbours."""
    for gap in gaps(rng, count):
        side = 1.0 if above_only else float(rng.choice([-1, 1]))
        value = target * (1 + side * gap)
        if value != target:
            yield value
    if not above_only:
        yield math.nextafter(target, -math.inf)
    yield math.nextafter(target, math.inf)


def towards(key: str, target: Callable[[Numbers], float], above_only: bool = False) -> Walk:
    """Walk of one argument towards a value that the others give."""

    def walk(numbers: Numbers, rng: Rng, count: int) -> Iterator[Step]:
        for n in range(count + 2):
            moved = jittered(numbers, rng)
            if key == "focal_plane_distance":
                moved["pupil_distance"] = 0.2 * moved["focal_length"]
            goal = target(moved)
            places = list(approach(goal, rng, 1, above_only))
            # The last two steps are the neighbours on each side.
            value = places[0] if n < count else places[-1 - (n - count) % (1 if above_only else 2)]
            yield Step(abs(value - goal) / abs(goal), moved | {key: value})

    return walk


def scaling(key: str, power: int) -> Walk:
    """Walk of one argument to zero (power 1) or to infinity (-1); the gap is its part of, or under, the one at hand."""

    def walk(numbers: Numbers, rng: Rng, count: int) -> Iterator[Step]:
        for gap in gaps(rng, count, 1e-30):
            moved = jittered(numbers, rng)
            yield Step(gap, moved | {key: moved[key] * gap if power > 0 else moved[key] / gap})

    return walk


def rescaled(numbers: Numbers, rng: Rng, count: int) -> Iterator[Step]:
    """Cameras of other sizes, 1e-6 to 1e6 times this one."""
    for n in range(count):
        scale = 10 ** (12 * n / max(1, count - 1) - 6)
        moved = jittered(numbers, rng)
        for key in moved.keys() - NUMBERS_WITHOUT_LENGTH:
            value = moved[key]
            moved[key] = tuple(scale * part for part in value) if isinstance(value, tuple) else scale * value
        yield Step(scale, moved)


# --- closed forms -----------------------------------------------------------------------------------------------------


def _names(key: str, only: tuple[str, ...]) -> tuple[str, ...]:
    """Closed forms that take `key`, or those named."""
    return only or tuple(name for name in sorted(ORACLES) if key in keywords(name))


def _on_the_verge(given: dict[str, Any]) -> bool:
    """Whether the pupil distance found is d_f but for rounding: there is none then, and either answer is right."""
    d_f, image = given["focal_plane_distance"], given["pupil_diameter"] * given["sensor_distance"]
    return bool(image <= 1e-14 * given["microlens_pitch"] * mla_distance(given["focal_length"], d_f))


def _form_trials(walk: Walk, *names: str) -> Trials:
    def trials(design: Design, rng: Rng, count: int) -> Iterator[Trial]:
        for step in walk(arguments_of(design), rng, count):
            for name in names:
                given = {key: step.numbers[key] for key in keywords(name)}
                if name != "matched_pupil_distance" or not _on_the_verge(given):
                    yield Trial(name, step.gap, given, CLOSED[name], ORACLES[name], TEXTBOOK[name])

    return trials


def _form(
    name: str, breaks: str, holds: str, key: str, walk: Walk, shown: str, only: tuple[str, ...] = (),
    at: Callable[[Numbers], float] | None = None, **more: Any,
) -> HardCase:  # fmt: skip
    """Row of every closed form that takes `key` (or of those named), and what they do where it has the value `at`."""

    def point(design: Design) -> Iterator[tuple[str, dict[str, Any]]]:
        assert at is not None
        numbers = arguments_of(design)
        if key == "focal_plane_distance" and at(numbers) == numbers["focal_length"]:
            numbers["pupil_distance"] = 0.2 * numbers["focal_length"]
        numbers[key] = at(numbers)
        for form in _names(key, only):
            yield form, {other: numbers[other] for other in keywords(form)}

    trials = _form_trials(walk, *_names(key, only))
    return HardCase(name, breaks, holds, trials, shown, point=point if at else None, **more)


def _f(n: Numbers) -> float:
    return float(n["focal_length"])


def _d_f(n: Numbers) -> float:
    return float(n["focal_plane_distance"])


def _gap(n: Numbers) -> float:
    return float(n["focal_plane_distance"] - n["pupil_distance"])


def _touching(n: Numbers) -> float:
    """Pupil diameter at which microlens images just touch."""
    return float(matched(camera_of(n), "D_F").value)


def _zero(n: Numbers) -> float:
    return 0.0


def _infinity(n: Numbers) -> float:
    return math.inf


TOUCH = ("fill_factor", "matching_mismatch")
SLOPES = ("pupil_shear", "epi_slope", "rim_disparity")
SCALED = ("microlens_pitch", "focal_length", "depth", "pupil_distance", "sensor_distance")

FORMS = (
    _form(
        "d_3 → d_f", "H = d_f/(d_f - d_3) grows without bound, 1 - d_3/d_f cancels",
        "the gap g = d_f - d_3 and 1/H = g/d_f",
        "pupil_distance", towards("pupil_distance", _d_f), "inverse_aperture_constant", at=_d_f,
    ),
    _form(
        "d_3 → 0", "Eq. 6 divides by d_3", "the margin D g - D_F d_f - 2|X_0| d_3",
        "pupil_distance", scaling("pupil_distance", 1), "nondistortion_margin", at=_zero,
    ),
    _form(
        "d_3 → f", "the exit pupil runs to infinity: L = d_1 - z_x is inf - inf", "its vergence 1/L",
        "pupil_distance", towards("pupil_distance", _f), "exit_pupil_vergence", at=_f,
    ),
    _form(
        "d_f → f", "d_1 runs to infinity, 1/f - 1/d_f cancels",
        "d_1 = f d_f/(d_f - f) with the difference taken first",
        "focal_plane_distance", towards("focal_plane_distance", _f, above_only=True), "mla_distance", at=_f,
    ),
    _form(
        "d_1 → f", "d_f runs to infinity", "d_f = f d_1/(d_1 - f)",
        "mla_distance", towards("mla_distance", _f, above_only=True), "focal_plane_distance", at=_f,
    ),
    _form(
        "d_f → ∞", "d_1 - f cancels, m vanishes", "d_1 - f = f^2/(d_f - f)",
        "focal_plane_distance", scaling("focal_plane_distance", -1), "magnification", at=_infinity,
        gap_means="this d_f over the one at hand, inverse",
    ),
    _form(
        "D_F → 0", "the f-number grows without bound", "the angle D_F H/d_1",
        "pupil_diameter", scaling("pupil_diameter", 1), "pupil_angle", at=_zero, gap_means="D_F over the one at hand",
    ),
    _form(
        "d_2 → 0", "Fresnel number and views grow without bound", "the angle d/d_2, the width lambda d_2/d",
        "sensor_distance", scaling("sensor_distance", 1), "microlens_image_pitch", at=_zero,
        gap_means="d_2 over the one at hand",
    ),
    _form(
        "images just touch", "image diameter less image pitch cancels",
        "one numerator of exact differences over g d_1",
        "pupil_diameter", towards("pupil_diameter", _touching), "matching_mismatch", TOUCH, _touching,
    ),
    _form(
        "Z_F → focal plane", "Eq. 12: m - A/Z_F cancels", "m (Z_F - A/m)/Z_F with Z_F - g taken first",
        "depth", towards("depth", _gap), "epi_slope", SLOPES, _gap,
    ),
    _form(
        "Z → ∞", "lengths overflow, differences of inverse depths vanish", "inverse depth, homogeneous coordinates",
        "depth", scaling("depth", -1), "disparity_rate", at=_infinity, gap_means="depth at hand over this one",
    ),
    _form(
        "scale 1e-6 to 1e6", "squares of lengths leave the range, absolute thresholds misjudge",
        "products of ratios, no absolute threshold", "", rescaled, "centre_deviation",
        tuple(name for name in sorted(ORACLES) if set(SCALED) & set(keywords(name))),
        gap_means="size over the camera at hand",
    ),
)  # fmt: skip
"""Closed forms."""


# --- shapes: discs that almost touch or almost contain each other, slivers in pixels, small angles --------------------

ANY = ", any direction"
"""Added to a function's name where centres lie off the axes."""
EXACT_SHAPE = Budget(
    16, "for two discs exactly as given, whatever their gap: nothing is granted to the condition", False
)
ANY_DIRECTION = Budget(
    32, "off the axes the gap may be a fraction of the last place of the distance, which is no machine number", False
)
PIXELS = Budget(16, "in units of a fully lit pixel's last place, times the disc's radius in pixels", False)
CELL = Budget(16, "in units of the last place of the square of the discs' extent", False)
COLUMNS = 12
"""Pixels across the disc of the walk to slivers."""


def radii_of(design: Design) -> tuple[float, float]:
    """Image of the FAP, and the smallest image of another rim that is larger [mm]; by default the bench's."""
    _, radii = field_discs(design, [(0.0, 0.0)])
    larger = [float(R) for R in radii[0, 1:] if radii[0, 0] < R]
    return (float(radii[0, 0]), min(larger)) if larger else ISSUE_RADII


def _pairs(design: Design, rng: Rng) -> Iterator[tuple[float, float]]:
    """Radii to walk with, without end: the issue's, the design's own, others of any ratio."""
    while True:
        yield ISSUE_RADII
        yield radii_of(design)
        r = 10 ** float(rng.uniform(-6, 6))
        yield r, r * (1 + 10 ** float(rng.uniform(-3, 2)))


def _placed(distance: float, rng: Rng) -> tuple[str, float, float]:
    """Centre of the second disc, half of the time off the axes, and how that is called."""
    if rng.random() < 0.5:
        return "", distance, 0.0
    angle = float(rng.uniform(0, 2 * math.pi))
    return ANY, distance * math.cos(angle), distance * math.sin(angle)


def _two_discs(number: str, exact: Callable[..., Any]) -> tuple[Callable[..., Any], ...]:
    """Ours (a number of `intersect`), exact and textbook, of radii r, R and the second disc's place x, y."""
    return (
        lambda r, R, x, y: getattr(intersect([[0.0, 0.0], [x, y]], [r, R]), number),
        traced(lambda r, R, x, y: exact(r, R, mp.hypot(x, y))),
        lambda r, R, x, y: exact(r, R, math.hypot(x, y)),
    )


AREA = _two_discs("area", overlap)
LOST = _two_discs("lost_fraction", lost_share)
KEPT = _two_discs("kept_fraction", lambda r, R, distance: 1 - lost_share(r, R, distance))


def tangent_trial(gap: float) -> Trial:
    """The bench's discs, overlapping by a gap in mm."""
    r, R = ISSUE_RADII
    return Trial("overlap", gap / r, {"r": r, "R": R, "x": r + R - gap, "y": 0.0}, *AREA)


def tangent(design: Design, rng: Rng, count: int) -> Iterator[Trial]:
    """Discs that overlap by less and less."""
    pairs = _pairs(design, rng)
    for gap in (1e-4, 1e-6, 1e-8):
        yield tangent_trial(gap)
    for gap in gaps(rng, 2 * count):
        r, R = next(pairs)
        where, x, y = _placed((r + R) * (1 - gap), rng)
        yield Trial("overlap" + where, gap, {"r": r, "R": R, "x": x, "y": y}, *AREA)


def barely_clipped(design: Design, rng: Rng, count: int) -> Iterator[Trial]:
    """A small disc that another just begins to cut."""
    pairs = _pairs(design, rng)
    for gap in gaps(rng, 2 * count):
        r, R = next(pairs)
        where, x, y = _placed(R - r + gap * R, rng)
        given = {"r": r, "R": R, "x": x, "y": y}
        yield Trial("lost_fraction" + where, gap, given, *LOST)
        yield Trial("overlap" + where, gap, given, *AREA)


def coincident(design: Design, rng: Rng, count: int) -> Iterator[Trial]:
    """Equal discs that move onto each other, and neighbours of equality."""
    r = radii_of(design)[0]
    for gap in (*gaps(rng, count), 0.0):
        for R in (r, math.nextafter(r, math.inf), math.nextafter(r, 0)):
            where, x, y = _placed(gap * r, rng)
            yield Trial("kept_fraction" + where, gap, {"r": r, "R": R, "x": x, "y": y}, *KEPT)


def _sliver_pixels(x: float, y: float, r: float) -> float:
    """Coverage of the pixel that the disc's right end just enters; pixels of width 1."""
    image = covered_pixels(np.array([[x, y]]), np.array([r]), COLUMNS + 2, COLUMNS + 2)
    return float(image[math.floor(y), math.floor(x + r)])


def _sliver_cell(x: float, y: float, r: float) -> float:
    column, row = math.floor(x + r), math.floor(y)
    return float(area_in_rectangle([[x, y]], [r], (column, row), (column + 1, row + 1)))


@traced
def _sliver_exact(x: Any, y: Any, r: Any) -> Any:
    """Segment of the disc beyond the pixel's left edge."""
    angle = mp.acos(1 - (x + r - mp.floor(x + r)) / r)
    return r * r * (angle - mp.sin(2 * angle) / 2)


def _sliver_samples(x: float, y: float, r: float) -> float:
    """Share of 64 x 64 samples."""
    at = (np.arange(64) + 0.5) / 64
    across, along = math.floor(x + r) + at - x, math.floor(y) + at[:, None] - y
    return float((across**2 + along**2 <= r * r).mean())


def slivers(design: Design, rng: Rng, count: int) -> Iterator[Trial]:
    """A disc that pokes less and less into a pixel, in the middle of that pixel's edge."""
    for gap in gaps(rng, count, 1e-9):
        r = 0.25 * COLUMNS + float(rng.uniform(-0.2, 0.2))
        edge = math.floor(COLUMNS / 2 + r)
        given = {"x": edge + min(gap, 0.02) - r, "y": COLUMNS // 2 + float(rng.uniform(0.45, 0.55)), "r": r}
        if given["x"] + r <= edge or math.floor(given["x"] + r) != edge:
            continue
        rest = _sliver_exact, _sliver_samples
        yield Trial("pixel coverage", gap, given, _sliver_pixels, *rest, lambda x, y, r: r)
        yield Trial("area_in_rectangle", gap, given, _sliver_cell, *rest, lambda x, y, r: 4 * r * r)


def small_fields(design: Design, rng: Rng, count: int) -> Iterator[Trial]:
    """Loss by cos^4 at smaller and smaller fields."""
    base = design.d_1 / design.d_f * (design.d_f - design.d_3)

    def ours(radius: float, d_f: float, d_1: float, g: float) -> float:
        return cos4(Subject(design, SceneBrief(field_radius=radius))).value

    def textbook(radius: Any, d_f: Any, d_1: Any, g: Any) -> Any:
        return cos4_loss(radius * d_f / d_1 / g)

    # d_f - d_3 as rounded is what the loss is asked for: its own rounding is another row's.
    fixed = {"d_f": design.d_f, "d_1": design.d_1, "g": design.d_f - design.d_3}
    for gap in gaps(rng, count, 1e-15):  # the reference itself cancels: 30 of its 60 digits are left
        yield Trial("cos4 loss", gap, {"radius": base * gap} | fixed, ours, traced(textbook), textbook)


SHAPES = (
    HardCase(
        "discs near tangency", "acos of almost 1 and Heron's formula: error 0.18 at a gap of 1e-6 mm",
        "error-free sums for the gaps, Kahan's sorted product, cap areas by quadrature of positive terms",
        tangent, "overlap", {"overlap": EXACT_SHAPE, "overlap" + ANY: ANY_DIRECTION},
        "overlap of the discs over their radii' sum",
    ),
    HardCase(
        "barely clipped", "1 - A/A_0 cancels", "the crescent's own integral", barely_clipped, "lost_fraction",
        {"overlap": EXACT_SHAPE, "lost_fraction": EXACT_SHAPE, "overlap" + ANY: ANY_DIRECTION,
         "lost_fraction" + ANY: ANY_DIRECTION},
        "how far it pokes out over the larger radius",
    ),
    HardCase(
        "concentric, equal", "0/0, arc cosines of numbers beyond 1", "explicit branches that meet at their seams",
        coincident, "kept_fraction", {"kept_fraction": EXACT_SHAPE, "kept_fraction" + ANY: EXACT_SHAPE},
        "distance of the centres over the radius",
    ),
    HardCase(
        "tiny pixel coverage", "samples miss it", "exact arc-pixel area", slivers, "pixel coverage",
        {"pixel coverage": PIXELS, "area_in_rectangle": CELL}, "how far the disc pokes into the pixel, in pixels",
    ),
    HardCase(
        "small field angles", "1 - cos^4 cancels", "expm1 and log1p", small_fields, "cos4 loss",
        gap_means="slope of the chief ray",
    ),
)  # fmt: skip
"""Shapes and angles."""


# --- diffraction behind cut pupils: a cat's eye almost closed, and a rim that only just begins to cut -----------------

FEWER = 4
"""Each reference is an integral at many digits: a walk takes so many times fewer steps than others."""
WAVE_DIGITS = 40
"""Digits that references are integrated to."""
QUADRATURE = Budget(64, "a sum of some thousand products, whatever the gap: nothing is granted to the condition", False)
OUTLINE = Budget(16, "in units of the last place of R/w: where rims cross is known to the larger one's", False)


def _light(r: float, R: float, d: float, w: float, x: float) -> float:
    return light_at(np.array([[0.0, 0.0], [d, 0.0]]), np.array([r, R]), w, (x, 0.0))


@traced
def _light_exact(r: Any, R: Any, d: Any, w: Any, x: Any) -> Any:
    """Slices across the line of centres; each slice's light by the sine integral."""
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

    with mp.workdps(WAVE_DIGITS):
        return mp.quad(light, places)


def _light_samples(r: float, R: float, d: float, w: float, x: float) -> float:
    """64 x 64 points of the pupil's square."""
    unit = (np.arange(64) + 0.5) / 32 - 1
    px, py = r * unit, r * unit[:, None]
    kept = (px**2 + py**2 <= r * r) & ((px - d) ** 2 + py**2 <= R * R)
    light = np.sinc((px - x) / w) ** 2 * np.sinc(py / w) ** 2
    return float((kept * light).sum() * (r / 32) ** 2 / w**2)


def _blurred(design: Design) -> tuple[float, float, float]:
    """Radii of the FAP's image and of a larger rim's, and the blur width [mm]."""
    r, R = radii_of(design)
    return r, R, max(design.wavelength * design.d_2 / design.d, 0.3 * r)


def almost_closed(design: Design, rng: Rng, count: int) -> Iterator[Trial]:
    """Cat's eyes with less and less left, seen at their own place."""
    r, R, w = _blurred(design)
    for gap in gaps(rng, max(3, count // FEWER), 1e-13):
        given = {"r": r, "R": R, "d": (r + R) - gap * r, "w": w * float(rng.uniform(0.7, 1.4)), "x": r}
        yield Trial("light through a sliver", gap, given, _light, _light_exact, _light_samples)


def just_cut(design: Design, rng: Rng, count: int) -> Iterator[Trial]:
    """Rims that begin to cut, from both sides of the seam."""
    r, R, w = _blurred(design)
    for gap in gaps(rng, max(3, count // FEWER), 1e-15):
        side = float(rng.choice([-1, 1]))
        given = {"r": r, "R": R, "d": (R - r) + side * gap * r, "w": w * float(rng.uniform(0.7, 1.4)), "x": -0.6 * r}
        reach = lambda r, R, d, w, x: max(1.0, R / w)  # noqa: E731
        yield Trial("light of a cat's eye", gap, given, _light, _light_exact, _light_samples, reach)


WAVES = (
    HardCase(
        "cat's eye almost closed, waves", "samples miss it; slices lose their length",
        "slices' weights scaled to the sliver's own area", almost_closed, "light through a sliver",
        {"light through a sliver": QUADRATURE}, "width of what is left over the radius",
    ),
    HardCase(
        "rims almost tangent, waves", "slices end in square roots that all but meet",
        "Green's theorem along the rims, smooth whatever they touch", just_cut, "light of a cat's eye",
        {"light of a cat's eye": OUTLINE}, "how far the rim cuts in over the radius",
    ),
)  # fmt: skip
"""Diffraction images."""


# --- projection and fits: points at infinity, slopes near the focal plane, few or near depths -------------------------

CAMERA = ("effective_image_distance", "magnification", "microlens_pitch", "pixel_pitch", "sensor_distance")
LENGTHS = (
    "focal_length",
    "focal_plane_distance",
    "pupil_distance",
    "microlens_pitch",
    "pixel_pitch",
    "sensor_distance",
)
VIEWS = 9
"""Views in a row."""
FAR_PIXEL = 2000.0
"""Where a microlens image in the middle of a sensor has its pixels, counted from the corner."""
DEPTHS = 5


def _seen(X: float, Z_F: float, S: float, **lengths: float) -> Any:
    u, _, w = view_projection(camera_of(lengths), (S, 0.0)) @ (X, 0.0, Z_F, 1.0)
    return u / w


def _seen_textbook(X: Any, Z_F: Any, S: Any, **lengths: Any) -> Any:
    """Chief ray and Eq. 12, each divided by the depth."""
    f, d_f, d_3, d, q, d_2 = (lengths[key] for key in LENGTHS)
    m, A = f / (d_f - f), f * (d_f - d_3) / (d_f - f)
    pupil = -(q * A / d_2) * S
    return (-A * X / Z_F - (m - A / Z_F) * pupil) / d


def far_points(design: Design, rng: Rng, count: int) -> Iterator[Trial]:
    """Points that run off along a direction, from 10 to 1e30 depths away."""
    base = arguments_of(design)
    for gap in gaps(rng, count, 1e-30):
        numbers = jittered(base, rng)
        given = {
            "X": 0.3 * numbers["depth"] / gap, "Z_F": numbers["depth"] / gap, "S": 5 * float(rng.normal()),
            **{key: numbers[key] for key in LENGTHS},
        }  # fmt: skip
        yield Trial("view_projection", gap, given, _seen, traced(_seen_textbook), _seen_textbook)


def _line(s: tuple[float, ...], u: tuple[float, ...]) -> Any:
    """Slope by `fit_lines`, of a corner seen in a row of views."""
    views = np.stack([np.array(s), np.zeros(len(s))], -1)
    uv = np.stack([np.array(u), np.zeros(len(u))], -1)[None, :, None, :]
    return fit_lines(Observations(np.zeros((1, 3)), views, uv)).slope[0, 0]


def _line_textbook(s: Any, u: Any) -> Any:
    """Slope by the normal equations."""
    n = len(s)
    sums = sum(s), sum(u), sum(a * b for a, b in zip(s, u, strict=True)), sum(a * a for a in s)
    return (n * sums[2] - sums[0] * sums[1]) / (n * sums[3] - sums[0] ** 2)


def flat_slopes(design: Design, rng: Rng, count: int) -> Iterator[Trial]:
    """Corners nearer and nearer to the focal plane, where slopes vanish; pixels counted from the sensor's corner."""
    for gap in gaps(rng, count, 1e-12):
        s = tuple(FAR_PIXEL + k + 1e-3 * float(rng.normal()) for k in range(VIEWS))
        u = tuple(137.0 + gap * (a - FAR_PIXEL) for a in s)
        yield Trial("fit_lines", gap, {"s": s, "u": u}, _line, traced(_line_textbook), _line_textbook)


def _two(depth: tuple[float, ...], slope: tuple[float, ...], A: float, q: float, d: float) -> Any:
    """M and 1/d_2 by `step_two`, of one corner on each board."""
    b = len(depth)
    pose = np.zeros((b, 6))
    pose[:, 5] = depth
    one = np.ones((b, 1))
    lines = EpiLines(np.zeros((b, 1, 2)), np.zeros((b, 1, 2)), np.array(slope)[:, None], one, np.ones((b, 1, 2)), 0.0)
    first = StepOne(Intrinsics(A, 0.0, 0.0, 0.0, 0.0, q=q, d=d), Poses.from_vector(pose), 0.0)
    observations = Observations(np.zeros((1, 3)), np.zeros((1, 2)), np.zeros((b, 1, 1, 2)))
    camera = step_two(observations, lines, first).camera
    return camera.m, camera.inverse_d_2


def _two_textbook(depth: Any, slope: Any, A: Any, q: Any, d: Any) -> Any:
    """The normal equations of slope = a + b/Z_F, not centred."""
    inverse = [1 / z for z in depth]
    b = _line_textbook(inverse, slope)
    a = (sum(slope) - b * sum(inverse)) / len(depth)
    return -A * a / b, -b * d / (q * A * A)


def near_depths(design: Design, rng: Rng, count: int) -> Iterator[Trial]:
    """Boards closer and closer together in depth."""
    base = arguments_of(design)
    for gap in gaps(rng, count, 1e-7):
        numbers = jittered(base, rng)
        A, m, d, q, d_2 = (numbers[key] for key in CAMERA)
        depth = tuple(numbers["depth"] * (1 + gap * (k - DEPTHS // 2) / DEPTHS) for k in range(DEPTHS))
        slope = tuple(q * A / (d * d_2) * (m - A / z) for z in depth)
        given = {"depth": depth, "slope": slope, "A": A, "q": q, "d": d}
        yield Trial("step_two", gap, given, _two, traced(_two_textbook), _two_textbook)


def _lengths(f: float, A: float, m: float) -> Any:
    camera = back_substitute(f, A, m)
    return camera.mla_distance, camera.focal_plane_distance, camera.pupil_distance, camera.inverse_aperture_constant


def _lengths_of(form: Callable[..., Any]) -> Callable[..., Any]:
    """The same four of d_1, d_f, H, d_3, 1/H."""

    def lengths(f: Any, A: Any, m: Any) -> Any:
        d_1, d_f, _, d_3, per_h = form(focal_length=f, effective_image_distance=A, magnification=m)
        return d_1, d_f, d_3, per_h

    return lengths


def far_focus(design: Design, rng: Rng, count: int) -> Iterator[Trial]:
    """Cameras focused farther and farther away, where A = f says less and less of d_3."""
    base = arguments_of(design)
    exact, naive = (_lengths_of(forms["back_substitute"]) for forms in (ORACLES, TEXTBOOK))
    for gap in gaps(rng, count):
        numbers = jittered(base, rng)
        f, m = numbers["focal_length"], numbers["magnification"] * gap
        given = {"f": f, "A": f + m * (f - numbers["pupil_distance"]), "m": m}
        yield Trial("back_substitute", gap, given, _lengths, exact, naive)


FITS = (
    HardCase(
        "points at infinity", "coordinates overflow", "homogeneous coordinates", far_points, "view_projection",
        gap_means="inverse distance, in depths",
    ),
    HardCase(
        "slopes near the focal plane", "normal equations cancel: sums of squares of pixel numbers",
        "means taken out first", flat_slopes, "fit_lines",
        {"fit_lines": Budget(8, "a sum of nine products about means of nine; each mean is one more rounding")},
        "slope [pitches per pixel]",
    ),
    HardCase(
        "calibration from near depths", "columns 1 and 1/Z_F become collinear",
        "1/Z_F - 1/Z_0, its own condition told", near_depths, "step_two",
        {"step_two": Budget(8, "two sums and a quotient, then m from three of them")},
        "spread of depths over their mean",
    ),
    HardCase(
        "calibration focused far away", "m vanishes and with it what A says of d_3",
        "d_3 = f + (f - A)/m; f = 0 or m = 0 refused", far_focus, "back_substitute",
        gap_means="m over the one at hand",
    ),
)  # fmt: skip
"""Projection and calibration."""


def all_cases() -> tuple[HardCase, ...]:
    """Every row: closed forms, shapes, waves, fits."""
    return (*FORMS, *SHAPES, *WAVES, *FITS)
