"""A decoded light field: microlens centres on the raw image, views, refocused pictures, an epipolar-plane image."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..._arrays import Array
from ...drawing.marks import Area, Disc, Dots, Image, Key, Line, Mark, Text, dot_key, line_key, xy
from ...drawing.panel import Panel, Scale, named_ticks
from ...drawing.picture import PAGE, Picture, legend_height, one_panel
from ...drawing.theme import MANY, PLAIN, wrapped
from ...words import fixed

if TYPE_CHECKING:
    from ...calibration.centres import MicrolensCentres
    from ...calibration.decoding import LightField
    from ...calibration.refocusing import FocusPlane
    from ...calibration.white_profile import WhiteProfile

Pixels = NDArray[np.floating]
Units = tuple[str, str]
"""Units of s and t, and of u and v, as labels have them."""
_SHOWN = 1500
"""Most pixels of an image in a picture along an axis: more would only make the picture larger."""
_LINES = {"along a row": (1, 0), "to the next row": (0, 1), "across the gaps": (1, 1)}
"""Lines over a microlens image, and steps of the lattice that they run along."""
_CELLS = 7.0
"""Microlens images across a zoom."""


def lattice_overlay(raw: Pixels, centres: MicrolensCentres) -> Picture:
    """Draw the fitted microlens centres on the raw image, at its centre, edge and corner, as large as can be read."""
    side, gap = 310.0, 68.0
    pitch = centres.lattice.pitch
    rows, columns = raw.shape
    places, reasons = centres.centres, centres.reasons
    middle = places[centres.used].mean(axis=0) if centres.used.any() else np.array([columns, rows]) / 2
    half = 0.5 * _CELLS * pitch
    ends = np.array([columns - 1.0, rows - 1.0])
    zooms = {
        "centre": middle, "edge": np.array([ends[0] - half, middle[1]]), "corner": np.array([ends[0] - half, half]),
    }  # fmt: skip
    frames = [np.clip(at, half, np.maximum(ends - half, half)) for at in zooms.values()]
    scale = min(side / columns, side / rows)
    boxes = [
        Area(*_square(at, half), "none", edge="vermillion", width=1.8) for at in frames
    ]  # fmt: skip
    panels = [_shown(raw, (64.0, 26.0, columns * scale, rows * scale), "raw image", marks=boxes)]
    colours = {int(reason): MANY[(5, 4, 0, 6, 2, 1, 3)[reason]] for reason in np.unique(reasons)}
    for number, (name, at) in enumerate(zip(zooms, frames, strict=True), 1):
        box = (64.0 + (side + gap) * (number % 2), 26.0 + (side + gap) * (number // 2), side, side)
        left, top = (max(int(v - half), 0) for v in at)
        crop = raw[top : int(at[1] + half) + 2, left : int(at[0] + half) + 2]
        near = (np.abs(places - at) <= half).all(axis=1)
        marks = [
            Dots(*xy(places[near & (reasons == reason)]), colour, "+", 4.5, width=1.8)
            for reason, colour in colours.items()
        ]
        window = (at[0] - half, at[0] + half, at[1] - half, at[1] + half)
        panels.append(_shown(crop, box, name, (left, top), marks, window))
    counts = zip(colours.items(), centres.counts().items(), strict=True)
    keys = [dot_key(f"{count} {said}", colour, "+", 4.5, width=1.8) for (_, colour), (said, count) in counts]
    foot = panels[-1].bottom + 46
    title = f"Microlens centres on the raw image: {centres.lattice.layout}, {pitch:.4g} px apart"
    size = (PAGE, foot + legend_height(keys, PAGE - 28))
    return Picture("lattice", title, size, tuple(panels), tuple(keys), (14.0, foot, 0.0))


def white_profile(profile: WhiteProfile) -> Picture:
    """Draw light across microlens images, as measured and as fitted: along both steps of the lattice, and between."""
    top = 1.08 * float(max(profile.measured.max(), profile.fitted.max()))
    panels = []
    for number, (name, way) in enumerate(_LINES.items()):
        px, measured, fitted = profile.along(*way)
        ends = Scale(float(px[0]), float(px[-1]))
        marks: list[Mark] = [Line(px, fitted, "blue", 1.8), Dots(px, measured, "vermillion", "o", 4.0)]
        if not profile.untold:
            marks.append(Line(np.array([px[0], px[-1]]), np.full(2, profile.veil), "ink", 1.4, "7 4"))
        box = (58.0 + number * (PAGE - 10) / 3, 28.0, (PAGE - 10) / 3 - 68, 230.0)
        axes = "from its middle [px]", "light [fully lit pixels]"
        panels.append(Panel(box, ends, Scale(0.0, top), tuple(marks), *axes, name))
    keys = [
        dot_key(f"measured, mean of {profile.microlenses} microlenses", "vermillion", "o", 4.0),
        line_key("an evenly lit pupil's", "blue", 1.8),
    ]
    if not profile.untold:
        keys.append(line_key("veil", "ink", 1.4, "7 4"))
    foot = panels[0].bottom + 46
    size = (PAGE, foot + legend_height(keys, PAGE - 28))
    return Picture("white", "Light across microlens images", size, tuple(panels), tuple(keys), (14.0, foot, 0.0))


def no_lattice(raw: Pixels, spectrum: Pixels, corner: Sequence[float], reason: str, pitch: float | None) -> Picture:
    """Draw what there was when no lattice was found: the image, its middle, the spectrum of its lit part, the reason.

    Parameters
    ----------
    raw : ndarray, shape (rows, columns)
    spectrum : ndarray
        Amplitude of the lit part, as `np.fft.fft2` orders it.
    corner : sequence of float
        First pixel (x, y) of the lit part.
    reason : str
        Why there is none.
    pitch : float or None
        Of the lattice that was expected [px].
    """
    rows, columns = raw.shape
    side, top = 200.0, 30.0
    scale = min(side / columns, side / rows)
    half = min(48.0, rows / 2, columns / 2)
    x, y = (min(max(v + n / 2, half), limit - half) for v, n, limit in
            zip(corner, spectrum.shape[::-1], (columns, rows), strict=True))  # fmt: skip
    crop = raw[int(y - half) : int(y + half) + 1, int(x - half) : int(x + half) + 1]
    frame = Area(*_square(np.array([x, y]), half), "none", edge="vermillion", width=1.8)
    window = (x - half, x + half, y - half, y + half)
    whole = _shown(raw, (52.0, top, columns * scale, rows * scale), "the image", marks=[frame])
    zoom = _shown(crop, (318.0, top, side, side), "its lit middle", (int(x - half), int(y - half)), (), window)
    shifted = np.log10(np.maximum(np.fft.fftshift(spectrum), 1e-12 * max(float(spectrum.max()), 1e-300)))
    frequencies = [np.fft.fftshift(np.fft.fftfreq(n)) for n in spectrum.shape]
    bands = [np.abs(axis) <= 0.25 for axis in frequencies]
    shades = _thinned(shifted[np.ix_(*bands)])
    low, high = (float(v) for v in np.quantile(shades, (0.3, 1.0)))
    marks: list[Mark] = [Image(shades, (-0.25, 0.25, -0.25, 0.25), "grey", low, max(high, low + 1e-9))]
    keys: list[Key] = []
    if pitch is not None and pitch > 4:
        marks.append(Disc(0.0, 0.0, 1 / pitch, edge="vermillion", width=1.6))
        keys.append(line_key(f"frequency of the expected pitch, {pitch:.4g} px", "vermillion", 1.6))
    scale_f = Scale(0.25, -0.25)
    power = Panel(
        (588.0, top, side - 34, side - 34), Scale(-0.25, 0.25), scale_f, tuple(marks), "frequency in x [1/px]",
        "frequency in y [1/px]", "spectrum (log)", grid="", equal=True,
    )  # fmt: skip
    foot = top + side + 52
    lines = wrapped(f"No lattice of microlenses: {reason}", PAGE - 40, PLAIN)
    remarks = tuple(Text(20, foot + 17 * n, line, "ink", PLAIN) for n, line in enumerate(lines))
    foot += 17 * len(lines)
    size = (PAGE, foot + legend_height(keys, PAGE - 40))
    return Picture("failed", "What was seen where no lattice was found", size, (whole, zoom, power), tuple(keys),
                   (14.0, foot - 6, 0.0), remarks)  # fmt: skip


def views_sheet(field: LightField, units: Units) -> Picture:
    """Draw every view at its place: s to the right, t downwards; white where nothing was measured."""
    nt, ns, nv, nu = field.values.shape
    step = max(1, -(-max(nu * ns, nv * nt) // _SHOWN))
    small = _thinned(_measured(field.values, field.weight), step)
    tall, wide = small.shape[2:]
    mosaic = np.full((nt * (tall + 1), ns * (wide + 1)), np.nan, np.float32)
    for t in range(nt):
        for s in range(ns):
            mosaic[t * (tall + 1) : t * (tall + 1) + tall, s * (wide + 1) : s * (wide + 1) + wide] = small[t, s]
    ds, dt = (float(axis[1] - axis[0]) if len(axis) > 1 else 1.0 for axis in (field.s, field.t))
    ends = (field.s[0] - ds / 2, field.s[-1] + ds / 2, field.t[0] - dt / 2, field.t[-1] + dt / 2)
    width = PAGE - 74
    height = width * mosaic.shape[0] / mosaic.shape[1]
    if height > 900:
        width, height = width * 900 / height, 900.0
    low, high = contrast(field.view(), field.view_weight())
    shares = (Scale(ends[0], ends[1]), Scale(ends[3], ends[2]))
    ticks = [named_ticks(axis[:: max(1, len(axis) // 9)].tolist()) for axis in (field.s, field.t)]
    panel = Panel(
        (58.0, 14.0, width, height), *shares, (Image(mosaic, ends, "grey", low, high),), f"s [{units[0]}]",
        f"t [{units[0]}]", grid="", x_ticks=ticks[0], y_ticks=ticks[1],
    )  # fmt: skip
    return Picture("views", f"{ns} x {nt} views of {nu} x {nv} samples", (PAGE, 14 + height + 46), (panel,))


def centre_view(field: LightField, row: int, units: Units) -> Picture:
    """Draw the view through the middle of the pupil, and which row of it the epipolar-plane image is of."""
    at = float(field.v[row])
    ends = (float(field.u[0]), float(field.u[-1]))
    marks = (Line(ends, (at, at), "vermillion", 1.6, "7 4"),)
    panel = _picture_of(field, field.view(), field.view_weight(), (PAGE - 80.0, 620.0), units, marks)
    keys = [line_key("row of the epipolar-plane image", "vermillion", 1.6, "7 4")]
    foot = panel.bottom + 44
    size = (PAGE, foot + legend_height(keys, PAGE - 28))
    return Picture("centre-view", "The view through the middle of the pupil", size, (panel,), tuple(keys),
                   (14.0, foot, 0.0))  # fmt: skip


def refocus_sheet(field: LightField, stack: Sequence[FocusPlane], units: Units) -> Picture:
    """Draw a stack of refocused pictures, far ones first, each under its distance and disparity."""
    columns = 2 if len(stack) > 1 else 1
    room = ((PAGE - 12) / columns - 74, 420.0)
    panels: list[Panel] = []
    top, lowest = 28.0, 0.0
    for number, plane in enumerate(stack):
        if number and number % columns == 0:
            top = lowest + 66
        left = 64 + (PAGE - 12) / columns * (number % columns)
        panels.append(
            _picture_of(field, plane.values, plane.weight, room, units, (), _plane_name(plane, units), (left, top))
        )
        lowest = max(lowest, panels[-1].bottom)
    return Picture("refocus", "Pictures refocused by shift and sum", (PAGE, lowest + 46), tuple(panels))


def _plane_name(plane: FocusPlane, units: Units) -> str:
    """Name of a refocused picture."""
    disparity = f"disparity {fixed(plane.disparity, 2, '+')} {units[1]}".replace("-", "−")
    return disparity if plane.distance is None else f"{plane.distance:.4g} mm ({disparity})"


def epi_image(field: LightField, row: int, units: Units) -> Picture:
    """Draw one row through all views along s: what slants to the left downwards is nearer than the focal plane."""
    t = int(np.abs(field.t).argmin())
    values = _measured(field.values[t, :, row], field.weight[t, :, row])
    ds, du = (float(axis[1] - axis[0]) if len(axis) > 1 else 1.0 for axis in (field.s, field.u))
    ends = (field.u[0] - du / 2, field.u[-1] + du / 2, field.s[0] - ds / 2, field.s[-1] + ds / 2)
    low, high = contrast(field.values[t, :, row], field.weight[t, :, row])
    image = Image(values, tuple(float(v) for v in ends), "grey", low, high)  # type: ignore[arg-type]
    panel = Panel(
        (0, 0, 1, 1), Scale(ends[0], ends[1]), Scale(ends[3], ends[2]), (image,), f"u [{units[1]}]", f"s [{units[0]}]",
        f"row v = {field.v[row]:.4g} {units[1]}, t = {field.t[t]:.3g}", grid="",
    )  # fmt: skip
    return one_panel("epi", "An epipolar-plane image: one row through all views", (PAGE, 280), panel, top=26)


EVEN = 0.01
"""Span of an image, over its highest value, below which it is even."""


def contrast(values: Pixels, weight: Pixels) -> tuple[float, float]:
    """Values drawn black and white: nearly all that was measured lies between; from 0 where it is as good as even."""
    known = values[weight > 0]
    if known.size == 0:
        return 0.0, 1.0
    low, high = (float(v) for v in np.quantile(known[:: 1 + known.size // 500_000], (0.005, 0.995)))
    if high - low < EVEN * abs(high):  # noise and rounding are no picture
        low = min(low, 0.0)
    return low, max(high, low + 1e-9)


def _measured(values: Pixels, weight: Pixels) -> Array:
    return np.asarray(np.where(weight > 0, values, np.nan), float)


def _picture_of(
    field: LightField,
    values: Pixels,
    weight: Pixels,
    room: tuple[float, float],
    units: Units,
    marks: Sequence[Mark] = (),
    title: str = "",
    at: tuple[float, float] = (64.0, 14.0),
) -> Panel:
    """A view, or a picture of a view's size, as large as there is room."""
    du, dv = (float(axis[1] - axis[0]) if len(axis) > 1 else 1.0 for axis in (field.u, field.v))
    left, right, upper, lower = (
        field.u[0] - du / 2, field.u[-1] + du / 2, field.v[0] - dv / 2, field.v[-1] + dv / 2,
    )  # fmt: skip
    scale = min(room[0] / (right - left), room[1] / (lower - upper))
    image = Image(
        _thinned(_measured(values, weight)),
        (float(left), float(right), float(upper), float(lower)),
        "grey",
        *contrast(values, weight),
    )
    return Panel(
        (*at, (right - left) * scale, (lower - upper) * scale), Scale(left, right), Scale(lower, upper),
        (image, *marks), f"u [{units[1]}]", f"v [{units[1]}]", title, grid="", equal=True,
    )  # fmt: skip


def _shown(
    image: Pixels,
    box: tuple[float, float, float, float],
    title: str,
    corner: tuple[int, int] = (0, 0),
    marks: Sequence[Mark] = (),
    window: tuple[float, float, float, float] | None = None,
) -> Panel:
    """A part of a raw image, its first pixel at `corner`; `window` is left, right, upper and lower end that is seen."""
    rows, columns = image.shape
    ends = (corner[0] - 0.5, corner[0] + columns - 0.5, corner[1] - 0.5, corner[1] + rows - 0.5)
    left, right, upper, lower = window or ends
    low, high = contrast(image, np.ones_like(image))
    drawn = Image(_thinned(np.asarray(image, float)), ends, "grey", low, high)
    return Panel(
        box, Scale(left, right), Scale(lower, upper), (drawn, *marks), "column [px]", "row [px]", title, grid="",
        equal=True,
    )  # fmt: skip


def _square(at: Array, half: float) -> tuple[list[float], list[float]]:
    x, y = float(at[0]), float(at[1])
    return [x - half, x + half, x + half, x - half], [y - half, y - half, y + half, y + half]


def _thinned(image: Array, step: int = 0) -> Array:
    """Means of blocks of `step` pixels along the last two axes, of so many that the picture stays small enough."""
    step = step or max(1, -(-max(image.shape[-2:]) // _SHOWN))
    if step == 1:
        return np.asarray(image)
    rows, columns = (max(1, n // step) for n in image.shape[-2:])
    cut = image[..., : rows * step, : columns * step] if min(image.shape[-2:]) >= step else image
    if min(image.shape[-2:]) < step:
        return np.asarray(image[..., ::step, ::step])
    blocks = cut.reshape(*image.shape[:-2], rows, step, columns, step)
    known = ~np.isnan(blocks)
    count = known.sum(axis=(-3, -1))
    total = np.where(known, blocks, 0).sum(axis=(-3, -1))
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
