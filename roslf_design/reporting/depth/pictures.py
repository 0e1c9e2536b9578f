"""Drawings of measured depth: map, profile, errors against prediction, epipolar-plane image."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..._arrays import Array
from ...drawing.marks import (
    Area,
    Dots,
    Image,
    Key,
    Line,
    Mark,
    Point,
    Text,
    box_key,
    contours,
    dot_key,
    line_key,
    stairs,
)
from ...drawing.panel import Panel, Scale, colour_bar, named_ticks, round_ticks
from ...drawing.picture import PAGE, Picture, beside, one_panel
from ...drawing.theme import short

if TYPE_CHECKING:
    from ...depth.estimate import EpipolarPlane
    from ...depth.measure import Depths, Measurement, Prediction

UNKNOWN = {
    1: "grey", 2: "dark", 3: "orange", 4: "vermillion", 5: "purple", 6: "sky", 7: "green", 8: "blue", 9: "lost",
    10: "cut", 100: "pale",
}  # fmt: skip
"""Colours of microlenses without a depth, by the number of their reason."""
LEFT, TOP, RIGHT, BELOW = 62.0, 28.0, 84.0, 42.0
"""Margins of a map [px]."""
FLATTEST, HIGHEST = 70.0, 420.0
"""Height of a map [px]."""
TALL = 0.4
"""Height over width from which maps stand side by side."""
STRETCH = 60
"""Microlenses along an epipolar-plane image."""
LEVELS = 5
"""Contours of a sphere, about."""
CONTOUR = ("ink", 1.2, "")
"""Their look."""
LINES = 14
"""Fitted lines drawn on it."""
FITTED = "#ff9a3c"
"""Colour of fitted lines, on grey in any theme."""
LEAST_DOTS = 4
"""Patches of the field from which their errors are drawn against those predicted: fewer show no field."""
REACH = 4.0
"""Standard errors that a histogram shows; what is beyond counts at its ends."""


def _depth_map(trial: Measurement, reasons: dict[int, str]) -> Picture:
    """Draw depth and its standard error at every microlens of the first exposure.

    Parameters
    ----------
    trial : Measurement
    reasons : dict
        Words for the numbers of `Depths.status`.
    """
    run = trial.first
    box, turn = _box(run)
    words, sphere = _Words.of(run), _sphere(trial)
    depth = (run.depth - words.tip)[turn]
    status, known, sigma = run.status[turn], run.measured[turn], run.sigma[turn]
    across, up = Scale(*box[:2]), Scale(*box[2:])
    ratio = (up.high - up.low) / (across.high - across.low)
    down = ratio < TALL
    off = None if sphere is None else depth - sphere[turn]
    page = PAGE if down else PAGE / (2 if off is None else 3)
    width = page - LEFT - RIGHT
    height = width * ratio
    if height > HIGHEST:
        width, height = width * HIGHEST / height, HIGHEST
    stretched = height < FLATTEST
    codes = [code for code in np.unique(status).tolist() if code]
    marks = [Image(np.where(status == code, 1.0, np.nan), box, UNKNOWN[code]) for code in codes]
    pictures = []
    for title, values, label in (
        (words.quantity, depth, words.symbol), ("depth less the sphere", off, f"off by [{words.unit}]"),
        ("its standard error", sigma, f"σ [{words.unit}]"),
    ):  # fmt: skip
        if values is None:
            continue
        some = values[known]
        low, high = (0.0, 1.0) if not some.size else (float(q) for q in np.quantile(some, (0.005, 0.995)))
        if values is off:
            low, high = (sign * max(abs(low), abs(high)) for sign in (-1, 1))
        high = max(high, low + 1e-6 * max(abs(low), 1e-6))
        shades: list[Mark] = [Image(np.where(known, values, np.nan), box, "cividis", low, high)]
        if sphere is not None and values is depth:
            shades += _contours(sphere[turn], run, turn, (width, max(height, FLATTEST)))
        note, beside_bar = "", label
        if stretched:  # too low for the label beside the bar
            note, beside_bar = f", {label}, stretched upwards", f"[{words.unit}]"
        panel = Panel(
            (LEFT, TOP, width, max(height, FLATTEST)), across, up, (*shades, *marks), words.place,
            f"y [{run.geometry.place_unit}]", title + note, grid="", equal=not stretched,
        )  # fmt: skip
        size = page, panel.bottom + BELOW
        pictures.append(Picture(title, title, size, (panel, colour_bar(panel, low, high, "cividis", beside_bar))))
    shares = run.unknown()
    keys = [box_key(f"{reasons[n]}: {100 * shares[reasons[n]]:.3g} %", UNKNOWN[n], edge="grey") for n in codes]
    if sphere is not None and trial.sphere is not None:
        radius = f"{short(trial.sphere.radius, 3)} ± {short(trial.sphere.sigma, 2)} mm"
        keys.append(line_key(f"contours of the sphere that fits best, of radius {radius}", *CONTOUR))
    of = "microlenses" if run.geometry.place_unit == "mm" else "pixels"
    title = f"{words.quantity.capitalize()} of {known.sum()} of {known.size} {of} and its standard error"
    return beside("depth-map", title, pictures, keys, down=down)


def _sphere(trial: Measurement) -> Array | None:
    """Depths of the sphere that fits best, as drawn; None where none is called for."""
    if trial.sphere is None or not trial.sphere.told or (points := trial.first.points) is None:
        return None
    return trial.sphere.height(points[..., 0], points[..., 1]) - trial.first.geometry.tip


def _contours(heights: Array, run: Depths, turn: slice, size: Point) -> list[Line | Text]:
    """Lines of equal depth on a map, each with its number."""
    levels = named_ticks(round_ticks(float(np.nanmin(heights)), float(np.nanmax(heights)), LEVELS))
    inner = size[0] * (1 - 1 / heights.shape[1]), size[1] * (1 - 1 / heights.shape[0])  # between the outer middles
    x, y = run.x_ml[0, :, 0], run.x_ml[turn, 0, 1]
    return contours(heights, x, y, [(*level, CONTOUR) for level in levels], inner)


def _dense_map(trial: Measurement) -> Picture:
    """Draw depth everywhere, hatched where it was filled in from known places."""
    run, words, (box, turn) = trial.first, _Words.of(trial.first), _box(trial.first)
    values, known = run.dense[turn] - words.tip, run.measured[turn]
    some = values[np.isfinite(values)]
    low, high = (float(q) for q in np.quantile(some, (0.005, 0.995))) if some.size else (0.0, 1.0)
    high = max(high, low + 1e-6 * max(abs(low), 1e-6))
    filled = ~known & np.isfinite(values)
    hatch = np.where(filled & (np.add(*np.indices(known.shape)) % 3 == 0), 1.0, np.nan)
    width, title = PAGE / 2 - LEFT - RIGHT, f"{words.quantity.capitalize()}, filled where unknown"
    height = width * (box[3] - box[2]) / (box[1] - box[0])
    panel = Panel(
        (LEFT, TOP, width, max(height, FLATTEST)), Scale(*box[:2]), Scale(*box[2:]),
        (Image(values, box, "cividis", low, high), Image(hatch, box, "vermillion")), words.place,
        f"y [{run.geometry.place_unit}]", f"{words.quantity}, dense", grid="", equal=height >= FLATTEST,
    )  # fmt: skip
    drawn = Picture(
        title, title, (PAGE / 2, panel.bottom + BELOW),
        (panel, colour_bar(panel, low, high, "cividis", words.symbol)),
    )  # fmt: skip
    key = box_key(f"hatched: filled from known ones, not measured ({100 * filled.mean():.2g} %)", "vermillion")
    return beside("depth-dense", title, (drawn,), [key])


def _box(run: Depths) -> tuple[tuple[float, float, float, float], slice]:
    """Ends of a map, and its rows upwards: pictures' may run downwards, a panel's go upwards."""
    x, y = run.x_ml[0, :, 0], run.x_ml[:, 0, 1]
    dx, dy = float(x[1] - x[0]) / 2, abs(float(y[1] - y[0])) / 2
    box = float(x[0]) - dx, float(x[-1]) + dx, float(y.min()) - dy, float(y.max()) + dy
    return box, slice(None, None, 1 if y[-1] > y[0] else -1)


class _Words(NamedTuple):
    """Words on the axes of a measurement's drawings."""

    quantity: str
    unit: str
    symbol: str
    place: str
    tip: float = 0.0
    """Z of the tip, ahead of which depths that are drawn count [mm]."""

    @classmethod
    def of(cls, run: Depths) -> _Words:
        on_array = run.geometry.place_unit == "mm"
        place = "microlens x on the array [mm]" if on_array else "x from the middle of the view [px]"
        if run.geometry.unit == "px":
            return cls("disparity", "px", "from view to view [px]", place)
        tip = run.geometry.tip
        return cls("depth", "mm", "ahead of the tip [mm]" if tip else "Z from lens [mm]", place, tip)


def profile(trial: Measurement, size: Point = (PAGE, 440.0)) -> Picture:
    """Draw depth along the middle row, with the truth as far as it is known; below, what it is off by, or its error."""
    run, row, words = trial.first, trial.true.shape[0] // 2, _Words.of(trial.first)
    x, true, known = run.x_ml[row, :, 0], trial.true[row] - words.tip, run.measured[row]
    depth = np.where(known, run.depth[row] - words.tip, np.nan)
    across = _along(x)
    dot, compared = 1.5 if x.size > 100 else 3.0, bool(np.isfinite(true).any())
    sigma = np.where(known, run.sigma[row], np.nan)
    behind: Mark = Line(x, true, "ink", 1.6) if compared else Area(*_band(x, depth - sigma, depth + sigma), "sky", 0.45)
    estimate: list[Mark] = [behind, Dots(x, depth, "blue", size=dot, opacity=0.8, clip=True)]
    ends = [*true, *depth] if compared else [*(depth - sigma), *(depth + sigma)]
    symbol = f"depth {words.symbol}" if words.unit == "mm" else "disparity [px]"
    above = Panel(
        (0, 0, 1, 1), across, Scale.around(ends), tuple(estimate), "", symbol,
        f"middle row, y = {short(float(run.x_ml[row, 0, 1]), 3)} {run.geometry.place_unit}",
    )  # fmt: skip
    under, keys = (_off if compared else _told)(trial, row, dot)
    first = line_key("truth", "ink") if compared else box_key("± its standard error", "sky", 0.45)
    keys = [first, dot_key("measured", "blue", size=2.2), *keys]
    if (sphere := _sphere(trial)) is not None:
        above = above.with_marks(Line(x, sphere[row], "green", 1.8, "7 4"))
        keys.insert(1, line_key("sphere that fits best", "green", 1.8, "7 4"))
    parts = (
        one_panel("above", "", (size[0], 0.52 * size[1]), above, left=68, top=TOP, foot=24),
        one_panel("under", "", (size[0], 0.48 * size[1]), under, left=68),
    )
    title = f"{words.quantity.capitalize()} along the middle row, and its errors"
    return beside("depth-profile", title, parts, keys, down=True)


def _off(trial: Measurement, row: int, size: float) -> tuple[Panel, list[Key]]:
    """Panel of the errors along a row, against the errors that each depth comes with and those predicted."""
    run, words = trial.first, _Words.of(trial.first)
    x, known = run.x_ml[row, :, 0], run.measured[row]
    sigma = np.where(known, run.sigma[row], np.nan)
    error = np.where(known, run.depth[row], np.nan) - trial.true[row]
    at, predicted = _predicted_along(trial, row)
    across = _along(x)
    shown = [*error, *predicted, *-predicted, *(2 * sigma[known])]
    reach = 1.08 * max((abs(value) for value in shown if math.isfinite(value)), default=0.0) or 1.0
    marks: list[Mark] = [
        Area(*_band(x, -sigma, sigma), "sky", 0.45),
        Line([across.low, across.high], [0.0, 0.0], "ink", 1.2),
        Dots(x, error, "blue", size=size, opacity=0.8, clip=True),
        Line(at, predicted, "vermillion", 1.8, "7 4"), Line(at, -predicted, "vermillion", 1.8, "7 4"),
    ]  # fmt: skip
    keys = [box_key("± standard error reported with it", "sky", 0.45)]
    if trial.prediction is not None:
        keys.append(line_key("± predicted from light, noise and texture", "vermillion", 1.8, "7 4"))
    panel = Panel((0, 0, 1, 1), across, Scale(-reach, reach), tuple(marks), words.place, f"off by [{words.unit}]")
    return panel, keys


def _told(trial: Measurement, row: int, size: float) -> tuple[Panel, list[Key]]:
    """Standard errors reported along a row, by where they come from."""
    run, words = trial.first, _Words.of(trial.first)
    x, known = run.x_ml[row, :, 0], run.measured[row]
    noise = np.where(known, run.noise_sigma[row], np.nan)
    marks: list[Mark] = [Dots(x, noise, "purple", size=size, opacity=0.8, clip=True)]
    keys, top = [dot_key("σ of its light, texture and matching", "purple", size=2.2)], noise
    if run.calibration_sigma is not None:
        own, both = (np.where(known, values[row], np.nan) for values in (run.calibration_sigma, run.sigma))
        marks = [Line(x, both, "sky", 3.0), *marks, Line(x, own, "vermillion", 1.8, "7 4")]
        keys += [line_key("σ of calibration, common to all", "vermillion", 1.8, "7 4"), line_key("both", "sky", 3.0)]
        top = both
    high = 1.08 * max((value for value in top.tolist() if math.isfinite(value)), default=0.0) or 1.0
    return Panel((0, 0, 1, 1), _along(x), Scale(0.0, high), tuple(marks), words.place, f"σ [{words.unit}]"), keys


def _along(x: Array) -> Scale:
    """Microlenses in a row, all of each."""
    half = abs(float(x[1] - x[0])) / 2
    return Scale(float(x[0]) - half, float(x[-1]) + half)


def _predicted_along(trial: Measurement, row: int) -> tuple[Array, Array]:
    """Predicted standard error along the predicted row nearest to another: places [mm], errors [mm]."""
    if trial.prediction is None:
        return np.zeros(0), np.zeros(0)
    rows = trial.prediction.row
    mine = rows == rows[np.abs(rows - row).argmin()]
    values = trial.prediction.depth[mine]
    return trial.first.x_ml[row, trial.prediction.column[mine], 0], np.where(np.isfinite(values), values, np.nan)


def _band(x: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """Areas between two lines, parted where they are not known."""
    known = np.isfinite(low) & np.isfinite(high)
    runs = np.split(np.flatnonzero(known), np.flatnonzero(np.diff(np.flatnonzero(known)) > 1) + 1)
    gap = np.array([np.nan])
    xs = [np.concatenate([x[own], x[own[::-1]], gap]) for own in runs if own.size]
    ys = [np.concatenate([low[own], high[own[::-1]], gap]) for own in runs if own.size]
    return np.concatenate([*xs, gap]), np.concatenate([*ys, gap])


def normalised(trial: Measurement, size: Point = (PAGE / 2, 340.0)) -> Picture:
    """Draw errors in units of the standard error reported."""
    some = trial.compared
    sigma = np.stack([run.sigma[some] for run in trial.runs])
    ratio = (trial.errors[:, some] / sigma).ravel()
    cuts = np.linspace(-REACH, REACH, 33)
    heights = np.histogram(np.clip(ratio, -REACH, REACH), cuts)[0] / max(ratio.size, 1) / (cuts[1] - cuts[0])
    at = np.linspace(-REACH, REACH, 121)
    normal = np.exp(-(at**2) / 2) / math.sqrt(2 * math.pi)
    outline = stairs(cuts, heights)
    inside = f"{100 * float((np.abs(ratio) < 1).mean()):.0f} % within ±1" if ratio.size else "nothing to compare"
    marks = (Area(*outline, "blue", 0.35), Line(*outline, "blue", 1.2), Line(at, normal, "vermillion", 1.8, "7 4"))
    top = 1.12 * max(float(heights.max(initial=0.0)), float(normal.max()))
    left = Panel(
        (0, 0, 1, 1), Scale(-REACH, REACH), Scale(0.0, top), marks, "error over standard error reported",
        "share per unit", f"{inside}; 68 % is right",
    )  # fmt: skip
    keys = [box_key("all errors", "blue", 0.35), line_key("normal law", "vermillion", 1.8, "7 4")]
    return one_panel("normalised", "Errors against the errors reported", size, left, keys, left=60, top=TOP)


def _errors(trial: Measurement) -> Picture:
    """Draw errors in units of the standard error reported, and their rms over the field against prediction."""
    histogram = normalised(trial)
    if trial.prediction is None:
        return beside("depth-errors", "Errors against the errors reported", (histogram,))
    predicted, off = _by_place(trial, trial.prediction)
    if predicted.size < LEAST_DOTS:
        return beside("depth-errors", "Errors against the errors reported", (histogram,))
    ends = np.concatenate([predicted, off])
    scale = Scale(float(ends.min()) / 1.25, float(ends.max()) * 1.25, log=True)
    diagonal = np.array([scale.low, scale.high])
    lines = (
        Line(diagonal, diagonal, "ink", 1.2), Line(diagonal, 1.3 * diagonal, "grey", 1.2, "6 4"),
        Dots(predicted, off, "blue", size=3.5, opacity=0.8, clip=True),
    )  # fmt: skip
    right = Panel(
        (0, 0, 1, 1), scale, scale, lines, "predicted standard error [mm]", "rms error [mm]",
        "over the field, each dot a patch",
    )  # fmt: skip
    more = [line_key("as predicted", "ink", 1.2), line_key("1.3 times that", "grey", 1.2, "6 4")]
    parts = (
        histogram,
        one_panel("against", "", histogram.size, right, more, left=66, top=TOP),
    )
    return beside("depth-errors", "Errors of depth against the errors reported and predicted", parts)


def _by_place(trial: Measurement, prediction: Prediction) -> tuple[Array, Array]:
    """Predicted standard error, and rms error of the microlenses nearest to each place of the prediction."""
    rows, columns = (np.unique(index) for index in (prediction.row, prediction.column))
    table = np.full((len(rows), len(columns)), np.nan)
    table[np.searchsorted(rows, prediction.row), np.searchsorted(columns, prediction.column)] = prediction.depth
    places = zip(trial.true.shape, (rows, columns), strict=True)
    near = [np.abs(np.arange(size)[:, None] - own).argmin(1) for size, own in places]
    patch: NDArray[np.intp] = near[0][:, None] * len(columns) + near[1]
    some = trial.compared
    if np.bincount(patch[some]).max(initial=0) < trial.first.disparities.window**2:
        # Less than a window each: all of them are one.
        patch, table = np.zeros_like(patch), np.array([math.sqrt(np.nanmean(table**2))])
    square = np.bincount(patch[some], (trial.errors[:, some] ** 2).mean(0), table.size)
    count = np.bincount(patch[some], minlength=table.size)
    shown = (count > 0) & np.isfinite(table.ravel()) & (square > 0)
    return table.ravel()[shown], np.sqrt(square[shown] / count[shown])


def _epipolar(plane: EpipolarPlane, on_array: bool = True) -> Picture:
    """Draw the stretch of an epipolar-plane image with the steepest slopes, and those fitted to it."""
    steep = np.nan_to_num(np.abs(plane.disparity))
    length = min(STRETCH, steep.size)
    first = int(np.convolve(steep, np.ones(length), "valid").argmax())
    part = np.s_[first : first + STRETCH]
    where = plane.pupil[:, part]
    lit = plane.lit[:, part] & np.isfinite(where)
    shown = lit.any(axis=1)
    heights = np.array([own[light].mean() for own, light in zip(where[shown], lit[shown], strict=True)])
    values = np.where(lit, plane.values[:, part], np.nan)[shown]
    u = plane.u[part]
    step = float(u[1] - u[0])
    box_u = float(u[0]) - step / 2, float(u[-1]) + step / 2
    if not heights.size:
        heights, values = np.zeros(1), np.full((1, len(u)), np.nan)
    spacing = float(np.diff(np.sort(heights)).mean()) if heights.size > 1 else 0.1
    low, high = float(heights.min()) - spacing / 2, float(heights.max()) + spacing / 2
    fine = low + (np.arange(160) + 0.5) / 160 * (high - low)
    rows = np.abs(fine[:, None] - heights).argmin(1)
    bright = values[np.isfinite(values)]
    dark, light = (float(q) for q in np.quantile(bright, (0.01, 0.99))) if bright.size else (0.0, 1.0)
    shades = Image(values[rows], (*box_u, low, high), "grey", dark, max(light, dark + 1e-9))
    measured = np.flatnonzero(np.isfinite(plane.disparity[part])) + first
    every = max(1, math.ceil(measured.size / LINES))
    chosen = measured[every // 2 :: every].tolist()
    marks: list[Mark] = [shades, *(Line(*plane.line(index), FITTED, 2.0) for index in chosen)]
    keys = [line_key("slope fitted there: the disparity", FITTED, 2.0)]
    names = "u [px from the middle of the view]", "view [share of all across]"
    if on_array:
        names = "microlens u [pitches from the array's centre]", "place on the FAP [D_F]"
    panel = Panel((0, 0, 1, 1), Scale(*box_u), Scale(low, high), tuple(marks), *names, grid="")
    return one_panel("depth-epi", "Epipolar-plane image with fitted slopes", (PAGE, 300.0), panel, keys, left=66)


def depth_pictures(trial: Measurement, plane: EpipolarPlane, reasons: dict[int, str]) -> dict[str, Picture]:
    """All of them, by name; errors where there is a truth."""
    shown = {"map": _depth_map(trial, reasons), "profile": profile(trial)}
    if np.isfinite(trial.true).any():
        shown["errors"] = _errors(trial)
    if not trial.first.measured.all():
        shown["dense"] = _dense_map(trial)
    return shown | {"epi": _epipolar(plane, trial.first.geometry.place_unit == "mm")}
