"""Depth measured in a capture, as a page; the terminal shares its words."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from ...depth.captured import MeasuredCapture
from ...depth.geometry import ArrayGeometry
from ...depth.measure import FLAT, Depths, Flatness
from ...drawing.picture import Picture
from ...words import length, listed, number, percent, sentence
from ..blocks import Block, Bullets, Code, Figure, Report, Statement, Statements, Table
from .pages import distances, errors_right, known, measurement_report, optics_notes, places, sphere_line, sphere_words

CAPTIONS = {
    "map": (
        "Depth and its standard error over the field",
        "Where the legend names a reason, places of its colour have no depth for it; nothing is filled in there.",
    ),
    "profile": (
        "Along the middle row",
        "Above, what was measured, and the truth where there is one. Below, what it is off by against the errors "
        "reported, or, without a truth, the standard error reported with each and where it comes from. Neighbours "
        "share a window and err alike.",
    ),
    "errors": (
        "Errors against those reported",
        "In units of the standard error reported with each. Wider than the normal law: errors reported are too small.",
    ),
    "dense": (
        "Dense: filled where unknown",
        "Hatched places were not measured: they are filled from known ones nearby, along like brightness, with a larger"
        " error (dense.tif, dense_sigma.tif). No figure on this page counts them.",
    ),
    "epi": (
        "Epipolar-plane image",
        "One row of microlenses, or of pixels, through the views side by side. A point of the scene is a line; its"
        " slope is the disparity. The stretch with the steepest lines is shown.",
    ),
}  # fmt: skip
"""Title and caption of each picture."""


def capture_report(measured: MeasuredCapture, pictures: dict[str, Picture], command: str) -> Report:
    """The page: what was measured, how sure it is, what that rests on, how to run it again."""
    rows, columns = measured.true.shape
    return measurement_report(
        f"Depth in {measured.source}",
        f"{columns} x {rows} {places(measured)}",
        capture_answers(measured),
        capture_basis(measured),
        [Figure.of(f"depth-{name}", *CAPTIONS[name], picture) for name, picture in pictures.items()],
        (Code(command, "Run again"),),
    )


def capture_answers(measured: MeasuredCapture) -> tuple[Block, ...]:
    """Statements of the depths measured in a capture and how sure they are, and the numbers behind them."""
    return Statements(tuple(_capture_statements(measured))), _numbers(measured)


def _capture_statements(measured: MeasuredCapture) -> Iterator[Statement]:
    """A verdict for each question."""
    run, summary = measured.first, measured.summary()
    unit = run.geometry.unit
    what = "Depths" if unit == "mm" else "Disparities"
    yield known(measured, summary)
    some = run.measured
    if some.any():
        values, sigma = run.depth[some], run.sigma[some]
        near, middle, far = (float(at) for at in np.quantile(values, (0.01, 0.5, 0.99)))
        tip = run.geometry.tip
        text = f"How far away? {what} between {distances(run.geometry, near, far)}, half of them below"
        yield Statement("plain", f"{text} {middle - tip:.{4 if tip else 5}g} {unit}{' ahead of it' if tip else ''}.")
        text = f"How sure is each? To {float(np.median(sigma)):.2g} {unit} (one standard error, of the middle one)"
        if run.calibration_sigma is None:
            yield Statement("plain", f"{text}, from its light, texture and matching.")
        else:
            noise, own = (float(np.median(part[some])) for part in (run.noise_sigma, run.calibration_sigma))
            text += f": {noise:.2g} {unit} from its light, texture and matching, {own:.2g} {unit} from calibration."
            yield Statement("plain", text, "Averaging lessens the former; the latter is the same in all pictures.")
    if measured.known_to:
        lengths = listed([f"{place} to {length(sigma)}" for place, sigma in measured.known_to.items()])
        rest = "what calibration found and " if measured.calibration else ""
        yield Statement("plain", f"Is the camera known? {lengths}, as given; but for {rest}these it is as designed.")
    elif run.calibration_sigma is None and run.geometry.place_unit == "mm":
        text = "Is the camera known? It is taken as designed, without error."
        yield Statement("caution", text, "Calibrate it, and name the folder with --calibration.")
    if unit == "px":
        yield Statement(
            "caution", "How far in mm? Unknown: nothing says how the cameras stood.",
            "A parameters.cfg beside the views does; or name the camera with --design.",
        )  # fmt: skip
    if summary.bias_mm is not None and summary.inside_68 is not None:
        rms = math.hypot(summary.bias_mm, summary.spread_mm or 0.0)
        text = (
            f"Is it true? By {measured.truth} it is off by {summary.bias_mm:+.2g} {unit} on average and scatters by"
            f" {summary.spread_mm:.2g} {unit}, together {rms / (summary.told_mm or math.inf):.2g} times the errors"
            f" reported; {100 * summary.inside_68:.0f} % lie within theirs (68 % would be right),"
            f" {100 * (summary.beyond_5 or 0.0):.2g} % beyond five times."
        )
        if errors_right(summary):
            yield Statement("good", text)
        else:
            yield Statement("caution", text, f"Believe {rms:.2g} {unit} where single {places(measured)} count.")
    if (flat := _plane(run)) is not None:
        text = (
            f"Is it a plane? Off the best one by {flat.rms:.2g} {unit} rms; {100 * flat.inside_68:.0f} % lie within "
            "the errors reported for light and texture, 68 % would of a plane."
        )
        yield Statement("plain", text)
    if measured.sphere is not None:
        yield Statement("plain", sphere_words(measured.sphere))
    if measured.noise.times != 1.0:
        found = measured.noise
        text = f"Is the noise as believed? It is {found.times:.2g} times as believed, as views show everywhere"
        remedy = "say in [sensor] and [light] what the camera has"
        if found.by_sampling:
            text += (
                f": rays that the picture was rendered with leave up to {percent(found.sampling)} of a fully lit pixel"
            )
            remedy = "render without --budget-intensity and --accuracy, or with less: rays then stay below the noise"
        yield Statement("caution", f"{text}.", f"Errors reported are for it; {remedy}.")
    for warning in measured.warnings:
        yield Statement("caution", sentence(warning))


def _plane(run: Depths) -> Flatness | None:
    """How flat a scene is that may be taken for a plane; None of others."""
    flat = run.flatness()
    return flat if flat is not None and flat.rms < FLAT * float(np.median(run.noise_sigma[run.measured])) else None


def _numbers(measured: MeasuredCapture) -> Table:
    run, summary, unit = measured.first, measured.summary(), measured.first.geometry.unit
    some, flat = run.measured, _plane(run)
    lines: list[tuple[str, str, str, str]] = []
    if some.any():
        lines.append(("standard error", f"{np.sqrt((run.sigma[some] ** 2).mean()):.3g}", unit, "rms, of all"))
    if run.calibration_sigma is not None and some.any():
        for name, part in (("of noise", run.noise_sigma), ("of calibration", run.calibration_sigma)):
            lines.append((name, f"{np.sqrt((part[some] ** 2).mean()):.3g}", unit, "rms"))
    if summary.bias_mm is not None and summary.spread_mm is not None and summary.inside_68 is not None:
        lines.append(("bias", f"{summary.bias_mm:.3g}", unit, f"mean error by {measured.truth}"))
        lines.append(("spread", f"{summary.spread_mm:.3g}", unit, "about it"))
        lines.append(("within the error reported", f"{100 * summary.inside_68:.1f}", "%", "68 where it is right"))
    if flat is not None:
        lines.append(("off a plane", f"{flat.rms:.3g}", unit, "rms about the best one"))
    lines += sphere_line(measured.sphere)
    lines.append((f"{places(measured)} with a {_quantity(measured)}", f"{100 * summary.measured:.1f}", "%", ""))
    lines += [("unknown", f"{100 * share:.3g}", "%", reason) for reason, share in measured.unknown().items()]
    return Table(tuple(lines), "lrll", ("", "", "", ""), "In numbers")


def capture_basis(measured: MeasuredCapture) -> tuple[Block, ...]:
    """Table of what depths and errors of a capture rest on: camera, noise, window."""
    run, noise, times = measured.first, measured.noise.stated, measured.noise.times
    low, high = run.disparities.search
    camera = measured.camera or "nothing says: disparities only"
    if measured.calibration:
        camera += f", from {measured.calibration}"
    light = f"{number(noise.electrons, 4)} electrons in a pixel as bright as most, {noise.read_noise:.3g} read noise"
    light = f"{light}; from {measured.noise.source}" if measured.kind == "raw" else measured.noise.source
    light += "" if times == 1.0 else f"; views show {number(times, 2)} times that noise, which errors count"
    side = run.disparities.window
    span = "pitches over the FAP" if run.geometry.place_unit == "mm" else "px over all views"
    rows = [
        ("camera", camera),
        ("noise", light),
        ("searched", f"disparities from {low:.3g} to {high:.3g} {span}"),
        ("matched", f"{side} x {side} {places(measured)}, depth taken as even within"),
    ]  # fmt: skip
    notes = [
        "What shines, shadows that move, and glass in front show other disparities than the surface itself.",
        "At depth steps a window sees two depths: there depth is unknown, or that of the better side.",
    ]
    if isinstance(run.geometry, ArrayGeometry):
        keys = run.geometry.design.aperture.outline.keys
        if not any(f"aperture.{key}" in measured.known_to for key in keys):
            notes.append(
                f"The FAP's {keys[0].partition('.')[0]}: as designed, without error; what neighbours shine into an "
                f"image follows from that. --sigma aperture.{keys[0]}=1% counts what that leaves open."
            )
        notes += optics_notes(run.geometry.design)
    return Table(tuple(rows), "ll", ("", ""), "Camera, noise, matching"), Bullets(tuple(notes))


def _quantity(measured: MeasuredCapture) -> str:
    return "depth" if measured.first.geometry.unit == "mm" else "disparity"
