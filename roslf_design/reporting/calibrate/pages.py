"""A calibration, the folder of one, or the plan of one: sentences, tables and pages that the terminal shares."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import Any

from ..._arrays import by_value
from ..._version import __version__
from ...calibration.centres import Reason
from ...calibration.cover import BoardCover
from ...calibration.diffraction import DiffractionCheck
from ...calibration.distortion import Distortion
from ...calibration.fit import VISIBLE
from ...calibration.misfit import DISAGREE
from ...calibration.model import QUANTITIES, UNITS, derived
from ...calibration.options import PlanOptions, calibration_plan, lengths_after, plan_cover, wider_board
from ...calibration.planning import (
    LEAST_GAIN,
    NO_GAIN,
    RESERVE,
    CapturePlan,
    Trust,
    fewer_boards,
    sizes_of,
    smaller_board,
    too_large,
    trust_in,
)
from ...calibration.result import LAPLACE, Outcome
from ...calibration.space import SceneSide
from ...calibration.written import file_in, read_numbers
from ...camera import Camera
from ...design import Design
from ...drawing.picture import Picture
from ...drawing.svg import redrawn
from ...errors import InputError, Problem
from ...evaluation.required import required_of
from ...evaluation.working_range import WorkingRange
from ...input_files import read_bytes
from ...theory.depth_budget import DepthBudget, depth_budget
from ...theory.length_covariance import LengthCovariance
from ...tolerancing.places import short_name
from ...words import clauses, length, listed, number, rounded, sentence, within
from ..blocks import (
    MARKS,
    Block,
    Bullets,
    Code,
    Figure,
    Finding,
    Paragraph,
    Report,
    Section,
    Statement,
    Statements,
    Table,
)
from ..design.pages import TONES
from . import pictures

MARKED: tuple[Trust, ...] = ("good", "caution", "bad")
"""Trust in quantities, the best first."""
UNDETERMINED = "not determined"
"""Cell of a quantity whose standard deviation is its own size or more."""
SOURCES: dict[str, tuple[str, str, str]] = {
    "images": ("images", "the images", "show more boards, tilted further and over more distances"),
    "f": ("f", "the data sheet's f", "have the focal length measured"),
    "q": ("pixel pitch", "the data sheet's pixel pitch", "have the pixel pitch measured"),
    "d": ("microlens pitch", "the data sheet's microlens pitch", "have the microlens pitch measured"),
    "board": ("board's scale", "the board's scale", "have the board's cells measured"),
    "elements": ("elements", "what stands before the lens", "have its glass and thicknesses measured"),
    "systematic": (
        "systematic",
        "systematic errors of the corners",
        "show the boards nearer the focal plane, where corners hardly move from view to view",
    ),
    "white": ("white image", "the white image's pitch", "know it, and the microlens and pixel pitch, better"),
    "distances": ("distances", "the boards' distances", "measure them better"),
}
"""Where variance comes from: at the head of a column, in a sentence, and what lessens it."""
REACHED = 1.05
"""Ratio of a working range's far end to the farthest board's distance up to which boards reach it."""
VARIANCE = "Where the variance comes from"
"""Title of the table of its shares."""
RATIOS = (
    "H = d_1/A; A: image distance as the pupil sees it; m = d_1/d_f: magnification on the array. ✗: sigma is as large "
    f"as the quantity, or that is not determined: not to be quoted; !: sigma is over {100 * RESERVE:g} % of it. A d_3 "
    "near 0 is held against d_1."
)
"""Meaning of the letters that a calibration has beside the lengths, and of the marks."""
FIGURES: dict[str, tuple[str, str, Callable[[Outcome], Picture]]] = {
    "residuals": (
        "What the joint fit leaves over",
        "A pattern that the boards share is distortion that was not asked for; scatter alone is noise.",
        pictures.residuals,
    ),
    "epi-lines": (
        "Epipolar slopes against inverse depth",
        "Slopes of all corners in the epipolar-plane images. The line's slope gives d_2, its zero the focal plane, m/A;"
        " points far off it are corners badly placed or a board badly posed.",
        pictures.epi_lines,
    ),
    "posterior": (
        "How sure: the posterior",
        "Dark and light regions hold 68 % and 95 %; dashed lines hold 68 %. A narrow ridge is a pair that the images"
        " cannot tell apart: better knowledge of one is better knowledge of the other.",
        lambda result: pictures.posterior(result, UNITS),
    ),
    "depth": (
        "What it means for measured depths",
        "Error that this calibration puts into every depth measured with it, the same in all images: averaging does not"
        " take it away. Ticks mark the boards; beyond them the calibration extrapolates.",
        pictures.depth_errors,
    ),
}
"""Title, caption and what draws it, of each picture that a calibration leaves in its folder."""


@by_value
@dataclass(frozen=True)
class Calibrated:
    """Content of a calibration's folder."""

    data: Mapping[str, Any]
    """Content of its calibration.json."""
    drawings: Mapping[str, str]
    """SVG text by name."""


def read_calibration(place: Path) -> Calibrated:
    """Read the folder of a calibration, or its calibration.json.

    Raises
    ------
    InputError
        It is not there, or is something else; a drawing in it holds what none of ours does, such as a script.
    """
    data, file = read_numbers(place), file_in(place)
    files = {name: file.with_name(f"{name}.svg") for name in FIGURES}
    try:
        drawings = {name: _drawing(path, name) for name, path in files.items() if path.exists()}
    except InputError as error:
        raise InputError((Problem("calibration", str(error)),)) from None
    return Calibrated(data, drawings)


def _drawing(path: Path, name: str) -> str:
    """A picture of the folder, refused where it is not as `calibration_pictures` draws it."""
    text = read_bytes(path, str(path)).decode("utf-8", errors="replace")
    try:
        return redrawn(text[max(text.find("<svg"), 0) :].strip(), f"calibration-{name}")
    except ValueError as error:
        message = f"{error}, which roslf calibrate does not draw; delete the file, or calibrate again"
        raise InputError((Problem("", message),), str(path)) from None


def calibrated_finding(design: Design, calibrated: Calibrated) -> Finding:
    """Estimates with their intervals, where their variance comes from, drawings and warnings."""
    data = calibrated.data
    warned = bool(data.get("warnings")) or data.get("converged") is False
    trusts = _trusts(data)
    text = f"Calibrated from {len(data.get('images_used', ()))} images: {_quotable(trusts)}. {_pair(data)}."
    said = [Statement(max(_worst(trusts), MARKED[warned], key=MARKED.index), text)]
    if data.get("posterior"):
        text = f"Posterior {data['posterior']['message']}."
        said.append(Statement("good" if data.get("converged") else "bad", text))
    if data["design"] not in (design.name, f"{design.name}, calibrated") and not design.name.startswith(data["design"]):
        text = f"The calibration is of a camera built to another design: {data['design']}."
        said.append(Statement("caution", text))
    shares = {name: row["variance_shares"] for name, row in data["quantities"].items()}
    blocks: list[Block] = [Statements(tuple(said)), _quantities_table(data), _shares_table(shares)]
    blocks += _drawings(calibrated.drawings)
    if data.get("warnings"):
        blocks.append(Bullets(tuple(data["warnings"])))
    return Finding(Section("Calibration", tuple(blocks)), said[0])


def calibration_pictures(result: Outcome) -> dict[str, Picture]:
    """Every picture that a calibration has."""
    return {name: draw(result) for name, (_, _, draw) in FIGURES.items()}


def calibration_report(result: Outcome, drawings: Mapping[str, str], command: str) -> Report:
    """The page: answers, tables, figures (SVG text by name), how to run it again."""
    board = result.board
    answers: tuple[Block, ...] = (
        Statements(tuple(_statements(result))),
        _quantities_table(result.to_dict()),
        *_through_tables(result),
    )
    evidence: tuple[Block, ...] = (
        *_drawings(drawings),
        _design_table(result),
        *_sensor_table(result),
        _boards_table(result),
        _ways_table(result),
        _shares_table(result.shares),
    )
    return Report(
        f"Calibration of {result.design.name}",
        f"from {len(result.calibration.observations.names)} images of a {board.columns} x {board.rows} board of "
        f"{board.cell:g} mm cells",
        (
            Section("Answers", answers, "answers"),
            Section("Evidence", evidence, "evidence"),
            Section("How it was done", (Paragraph(_method(result)), Code(command, "Run again")), "how"),
        ),
        f"roslf_design {__version__}",
    )


def _statements(result: Outcome) -> Iterator[Statement]:
    """Statements of a calibration's main results."""
    fitted = result.calibration
    data = result.to_dict()
    trusts = _trusts(data)
    worst = max(_worst(trusts), MARKED[bool(result.warnings)], key=MARKED.index)
    yield Statement(worst, f"{sentence(_quotable(trusts))} {_pair(data)}.")
    images, total = len(fitted.observations.names), len(fitted.observations.names) + len(fitted.observations.missing)
    yield Statement(
        "plain",
        f"{images} of {total} images used, {len(fitted.observations.views)} views; reprojection RMS"
        f" {fitted.joint.rms:.3g} pitches, condition number {fitted.fit.covariance.condition:.3g}.",
    )
    misfit = result.misfit
    yield Statement(
        "good" if max(misfit.scale, misfit.views) <= VISIBLE else "caution",
        f"Residuals of places are {misfit.places:.2g}, of slopes {misfit.slopes:.2g}, of whole views {misfit.views:.2g}"
        " times what scatter from view to view explains (1 where the model holds).",
    )
    if result.distortion.automatic and result.distortion.coefficients:
        yield _distortion(result.distortion)
    yield Statement("plain", f"{_lenses_used(result)}.")
    if result.combined.data:
        used = " and ".join(datum.what for datum in result.combined.data)
        apart = ", ".join(f"{far:.1f}" for far in result.combined.apart.values())
        f = result.combined.f
        sigma = float(result.draws.draws("f").std(ddof=1))
        yield Statement(
            "caution" if result.combined.warnings else "good",
            f"With {used} ({apart} sigma from the rest): f = {rounded(f, sigma)} ± {sigma:.2g} mm.",
        )
    if result.diffraction is not None:
        yield _diffraction(result, result.diffraction)
    parts = {source: result.shares["d_3"].get(source, 0.0) for source in SOURCES}
    largest = max(parts, key=lambda source: parts[source])
    _, source, advice = SOURCES[largest]
    text = f"{100 * parts[largest]:.0f} % of d_3's variance comes from {source}."
    yield Statement("plain", text, f"To do better, {advice}.")
    yield _pupil(result)
    yield _sensor(result)
    if result.posterior is not None:
        yield Statement("good" if result.posterior.converged else "bad", f"Posterior {result.posterior.message}.")
    words = sentence(result.accuracy.sentence(times=False))
    yield Statement("caution" if result.accuracy.kept is False else "plain", words)
    there = result.used_in
    if there is not None:
        name, medium = there.name, result.design.object_space.medium.name.lower()
        low, high = sorted(100 * there.relative[[0, -1]])
        off = f"{low:+.1f} %" if high - low < 0.1 else f"{low:+.1f} to {high:+.1f} %"
        yield Statement(
            "caution",
            f"Calibrated in {medium}, used in {name}: depths there would be off by {off}"
            f" ({there.error[0]:+.3g} mm at {there.distances[0]:.4g} mm, {there.error[-1]:+.3g} mm at"
            f" {there.distances[-1]:.4g} mm).",
            f"calibrated.toml is the camera in {name}: depths by it are right.",
        )
    for warning in result.warnings:
        yield Statement("caution", sentence(warning))


def _pupil(result: Outcome) -> Statement:
    """Pupil and veil as the white image tells them."""
    if result.pupil is None:
        reason = "no microlens images fit" if result.white is None else result.white.untold
        return Statement("plain", f"The white image shows no pupil and no veil: {reason}.", "D_F is the design's.")
    (value, sigma), design = result.pupil, result.design.D_F
    off = 100 * (value / design - 1)
    text = f"Effective pupil: {rounded(value, sigma)} ± {sigma:.2g} mm, {off:+.2g} % off the design's {design:.4g} mm"
    if result.veil is None:
        return Statement("plain", f"{text}; its veil is not known without black level and full scale.")
    share, error = (100 * part for part in result.veil)
    return Statement("plain", f"{text}; veil {rounded(share, error)} ± {error:.2g} % of full scale.")


def _sensor(result: Outcome) -> Statement:
    """Sensor's figures as photon transfer tells them, and why others are not told."""
    figures = [f"{name} {said} {unit}".strip() for name, said, unit, _ in _sensor_rows(result)]
    why = "; ".join(result.sensor.untold)
    if not figures:
        return Statement("plain", f"The sensor's noise is not measured: {why}.", "It is the design's.")
    return Statement("plain", f"Sensor: {', '.join(figures)}.", sentence(why))


def _sensor_rows(result: Outcome) -> list[tuple[str, str, str, str]]:
    """Name, value with its standard error, unit and the design's value of each figure of the sensor."""
    sensor, design = result.sensor, result.design.sensor
    rows = (
        ("gain", sensor.gain, "e/count", ""),
        ("read noise", sensor.read_noise, "e", f"{design.read_noise:.4g}"),
        ("full well", sensor.full_well, "e", f"{design.full_well:.4g}"),
        ("PRNU", sensor.prnu, "%", ""),
        ("DSNU", sensor.dsnu, "e", ""),
        ("PRNU left by the white image", sensor.prnu_left, "%", f"{100 * design.prnu:.4g}"),
        ("DSNU left by the dark frame", sensor.dsnu_left, "e", f"{design.dsnu:.4g}"),
    )
    return [(name, one.words(100.0 if unit == "%" else 1.0), unit, own) for name, one, unit, own in rows if one]


def _sensor_table(result: Outcome) -> Iterator[Table]:
    """Table of the sensor's figures, where any is told."""
    if rows := _sensor_rows(result):
        caption = (
            "Photon transfer over the levels within microlens images. PRNU and DSNU are those of pixels against their"
            " neighbours: shading is not in them, and what microlenses differ by within a pixel or two is."
        )
        yield Table(tuple(rows), "lrlr", ("", "measured", "", "design"), "Sensor (EMVA 1288)", caption)


def _through_tables(result: Outcome) -> Iterator[Table]:
    """Lengths with a ruler where elements make them others, and depths in another medium."""
    if result.ruler:
        rows = tuple(
            (name, rounded(e.value, e.sigma), UNITS[name], f"{e.sigma:.2g}", f"{e.design:.6g}")
            for name, e in result.ruler.items()
        )
        heads = ("", "estimate", "", "sigma", "design")
        note = "The lengths above are those that the main lens sees through elements and glass, as if all were air."
        yield Table(rows, "lrlrr", heads, "The same as mechanical distances", note)
    used = result.used_in
    if used is not None:
        columns = zip(used.distances, used.uncorrected, used.error, 100 * used.relative, strict=True)
        titles = ("true distance [mm]", "uncorrected [mm]", "off [mm]", "off [%]")
        depths = tuple(
            (f"{z:.5g}", f"{decoded:.5g}", f"{off:+.3g}", f"{share:+.1f}") for z, decoded, off, share in columns
        )
        name = used.name
        note = f"Distances before the main lens; shares of the way through {name}, which begins at {used.end:.5g} mm."
        yield Table(depths, "rrrr", titles, f"Depths in {name}", note)


def _lenses_used(result: Outcome) -> str:
    """Which microlenses spoke for the lattice, and why others did not."""
    centres, radius = result.centres, result.undistorted_radius
    counts = [f"{number} {text}" for text, number in centres.counts().items() if text != Reason.USED.text]
    text = f"{int(centres.used.sum())} of {len(centres.indices)} microlenses used"
    text += f" (left out: {', '.join(counts)})" if counts else ""
    if radius is None:
        return text
    if math.isinf(radius):
        return f"{text}; by Eq. 6 the design cuts none of them"
    return f"{text}; by Eq. 6 the design cuts none within {radius:.0f} px of the axis"


def _quantities_table(data: Mapping[str, Any]) -> Table:
    """Every quantity of a calibration's JSON with its intervals."""
    sampled = bool(data.get("posterior"))
    rows = []
    trusts = _trusts(data)
    for name, row in data["quantities"].items():
        ends = [[rounded(end, row["sigma"]) for end in row[key]] for key in ("interval_68", "interval_95")]
        chains = (f"{row['r_hat']:.4f}", f"{row['ess']:.0f}") if sampled else ()
        intervals = (f"{low} to {high}" for low, high in ends)
        rows.append(
            (
                name,
                rounded(row["estimate"], row["sigma"]),
                row["unit"],
                f"{row['sigma']:.2g}",
                *intervals,
                *chains,
                MARKS[trusts[name]][0],
            )
        )
    heads = ("", "estimate", "", "sigma", "68 % interval", "95 % interval", *(("R-hat", "ESS") * sampled), "")
    source = "posterior" if sampled else "Laplace's approximation"
    return Table(
        tuple(rows),
        "lrlrrr" + "r" * (len(heads) - 7) + "l",
        heads,
        f"Calibrated, with intervals of {'the ' * sampled}{source}",
        RATIOS,
    )


def _shares_table(shares: Mapping[str, Mapping[str, float]], title: str = VARIANCE) -> Table:
    """Where each quantity's variance comes from; sources that add nothing to any are left out."""
    names = [name for name in QUANTITIES if name in shares]
    sources = [source for source in SOURCES if any(shares[name].get(source, 0.0) > 0 for name in names)]
    rows = tuple((name, *(f"{100 * shares[name].get(source, 0.0):.1f} %" for source in sources)) for name in names)
    note = "Systematic: what inner and outer views disagree on, and what corrections and a real main lens leave open."
    heads = ("", *(SOURCES[source][0] for source in sources))
    caption = note if "systematic" in sources else ""
    return Table(rows, "l" + "r" * len(sources), heads, title, caption)


def _design_table(result: Outcome) -> Table:
    """Every quantity beside the design's."""
    rows = []
    for name, e in result.estimates.items():
        off = "" if e.off is None else f"{e.off:+.1f}"
        values = (rounded(e.value, e.sigma), f"{e.design:.6g}", rounded(e.value - e.design, e.sigma))
        rows.append((name, *values, f"{e.built_sigma:.2g}", UNITS[name], off))
    heads = ("", "calibrated", "design", "difference", "sigma", "", "in sigma")
    caption = (
        "Sigma: of the calibration, and of what f, as well as the data sheet knows it, leaves open of a camera built as"
        f" designed. Beyond {DISAGREE:g} sigma it was built otherwise, or a length that it takes as known is"
        " wrong."
    )
    return Table(tuple(rows), "lrrrrlr", heads, "Calibrated against the design", caption)


def _boards_table(result: Outcome) -> Table:
    """Table of how each board fits."""
    rows = tuple(
        (
            board.name,
            str(board.corners),
            f"{board.rms:.3g}",
            *("" if math.isnan(scale) else f"{scale:.2g}" for scale in (board.places, board.slopes)),
            str(board.strays or ""),
        )
        for board in result.misfit.boards
    )
    heads = ("image", "corners", "RMS [pitches]", "places", "slopes", "far off")
    caption = (
        "Places and slopes: residuals over what views of one corner scatter by. Far off: corners given little weight."
    )
    return Table(rows, "lrrrrr", heads, "Board by board", caption)


def _ways_table(result: Outcome) -> Table:
    """The two steps beside the joint fit and, where diffraction was taken off, the joint fit without that."""
    fitted, sheet = result.calibration, result.sheet
    ways = {
        "steps one and two": (fitted.second.camera, fitted.first.rms),
        "joint fit": (fitted.joint.camera, fitted.joint.rms),
    }
    if result.diffraction is not None and result.diffraction.before is not None:
        ways["diffraction left in"] = (result.diffraction.before, result.diffraction.rms_before)
    lengths = [derived(camera.vector(), sheet) for camera, _ in ways.values()]
    rows = [(name, *(f"{float(values[name]):.5g}" for values in lengths), UNITS[name]) for name in QUANTITIES]
    rows.append(("reprojection RMS", *(f"{rms:.3g}" for _, rms in ways.values()), "pitches"))
    caption = "Step one's error is that of the central view, the others' that of all views."
    return Table(tuple(rows), "l" + "r" * len(ways) + "l", ("", *ways, ""), "By different ways", caption)


def plan_finding(design: Design, asked: PlanOptions, build: LengthCovariance | None = None) -> Finding:
    """A plan in a design's report; or why captures cannot determine the camera. `build` as for `plan_blocks`."""
    plan = calibration_plan(design, asked)
    seed = f"Seed of the calibration boards' poses: {asked.seed}."
    if isinstance(plan, str):
        none = Statements((Statement("caution", f"No plan: {plan}."),))
        return Finding(Section("Calibration plan", (none,)), None, seed)
    blocks = plan_blocks(design, plan, asked, build)
    assert isinstance(blocks[1], Statements)
    return Finding(Section("Calibration plan", blocks), blocks[1].items[0], seed, lengths_after(design, plan, asked))


def planned_depth(
    design: Design,
    plan: CapturePlan,
    asked: PlanOptions,
    build: LengthCovariance | None = None,
    at: float | None = None,
) -> DepthBudget:
    """Depth to be expected of a camera that is calibrated as planned, `at` [mm] ahead of the tip or in focus."""
    lengths = lengths_after(design, plan, asked)
    return depth_budget(Camera.of(design), at, build=build, calibration=lengths)


def _changed_depths(design: Design, plan: CapturePlan, build: LengthCovariance | None) -> dict[str, float]:
    """Standard uncertainty of depth after each change of a plan [mm]; smallest first."""
    camera = Camera.of(design)
    lengths = {change.what: change.expected.lengths(design, change.sheet) for change in plan.changes}
    after = {what: float(depth_budget(camera, build=build, calibration=one).u_z_mm) for what, one in lengths.items()}
    return dict(sorted(after.items(), key=lambda pair: pair[1]))


def cover_statement(cover: BoardCover, wider: str = "") -> Statement | None:
    """Distances required or asked for that a plan's boards cover, and why not the others; None where there are none.

    `wider` is a board that covers more, as text.
    """
    if not (cover.covered_mm or cover.uncovered):
        return None
    covered = listed([f"{number(z, 4)} mm" for z in cover.covered_mm]) if cover.covered_mm else "nothing"
    text = f"Of the distances ahead of the tip that matter here, boards cover {covered}"
    missed = "".join(f"; {one}" for one in cover.uncovered)
    remedy = "There the model alone tells depth." if missed else ""
    if wider:
        remedy += f' A board of "{wider}" covers more.'
    return Statement("caution" if missed else "plain", f"{text}{missed}.", remedy)


def _assumed(design: Design, plan: CapturePlan, asked: PlanOptions) -> str:
    """Sentences on what a plan takes images and knowledge before them to be."""
    c = plan.captures
    size = f"{c.board.columns} x {c.board.rows}"
    known = f"microlens pitch to {asked.d_sigma} and board to {asked.cell_sigma}"
    if asked.d_sigma == asked.cell_sigma:
        known = f"microlens pitch and board to {asked.d_sigma}"
    white = "" if asked.white_pitch is None else f", the white image's pitch to {asked.white_pitch}"
    elements = "".join(f", {short_name(place, design)} to {sigma}" for place, sigma in asked.sigma.items())
    text = (
        f"{c.boards} images of a board of {size} cells of {length(c.board.cell)}, "
        f"tilted by up to {math.degrees(c.tilt):.3g} degrees, "
        f"{c.distance:.4g} mm in front of the lens, over {c.distance_range:.3g} mm (± {c.distance_range / 2:.3g}); "
        f"corners found to {c.noise:g} pitches in {len(c.view_grid())} views; focal length known "
        f"to {asked.f_sigma}, {known}{white}{elements}. Standard deviations are from the Fisher matrix, medians over "
        "random sets of poses."
    )
    if plan.distortion:
        text += f" Distortion is fitted ({_terms(plan.distortion)})."
    if SceneSide.of(design) is not None:
        text += " Boards stand at mechanical distances; d_3, H and the other lengths are as the main lens sees them."
    return text


def plan_blocks(
    design: Design,
    plan: CapturePlan,
    asked: PlanOptions,
    build: LengthCovariance | None = None,
    whose: str = "tolerances",
    focused: str = "",
) -> tuple[Block, ...]:
    """A plan with its promise and its changes; with the `build`'s tolerances, where known, `whose`, how `focused`."""
    c, before = plan.captures, plan.expected
    supposed, others = "by captures alone", list[str]()
    promises, changed, whence = "Expected from these captures", "Expected sigma after one change", VARIANCE
    if build is not None:
        u, bare = planned_depth(design, plan, asked).expanded_mm, depth_budget(Camera.of(design), build=build)
        supposed = "with tolerances known before"
        wide = bare.expanded_words("± ")
        others = [
            f"Uncalibrated, by {whose} alone: {wide} in the focal plane{focused}.",
            f"By captures alone, of a camera whose tolerances nobody knows: ± {_rounded(u)} in the focal plane.",
        ]
        promises += ", without tolerances"
        whence += ", without tolerances"
        changed += ": of lengths without tolerances, of depth with them"
    depth = planned_depth(design, plan, asked, build)
    after = _changed_depths(design, plan, build)
    best = next(iter(after), "")
    helps = best and after[best] <= float(depth.u_z_mm) / LEAST_GAIN
    places = {"in the focal plane": depth}
    places |= {f"at {number(z, 4)} mm ahead of the tip": planned_depth(design, plan, asked, build, z) for z in asked.at}
    mostly = {where: one.mostly.replace("; ", ", but ", 1).replace("; ", ", and ") for where, one in places.items()}
    depths = [f"± {_rounded(one.expanded_mm)} {where}, {mostly[where]}" for where, one in places.items()]
    promise = f"Calibration as planned, {supposed}: depth, expected, to U = {'; '.join(depths)}."
    promise += f" Assumes a board of {c.board.columns} x {c.board.rows} cells."
    remedy = sentence(f"{best}: ± {_rounded(2 * after[best])} in the focal plane") if helps else NO_GAIN
    fewer = after.get(fewer_boards(c), math.inf)
    if fewer <= LEAST_GAIN * float(depth.u_z_mm):
        remedy += f" Half the boards do nearly as well: with {c.boards // 2}, U = ± {_rounded(2 * fewer)}."
    answers = [Statement("plain", promise, remedy)]
    if large := too_large(design, c):
        answers.append(Statement("caution", sentence(large), sentence(smaller_board(design, c))))
    covered = cover_statement(plan_cover(design, c, asked), wider_board(design, c, asked))
    answers += filter(None, [covered, _far_end(design, plan, asked, build)])
    known = lengths_after(design, plan, asked)
    required = (one for one in required_of(design, build, known) if one.quantity == "u_z_mm")
    told = (one.verdict for one in required)
    answers += [Statement(TONES[one.level], sentence(one.text), sentence(one.remedy)) for one in told]
    answers.append(_promise(design, plan, asked, build))
    answers += [Statement("plain", other) for other in others]  # a report's summary has one U
    sigmas = "".join(f' --sigma "{place}={sigma}"' for place, sigma in asked.sigma.items())
    command = f'roslf calibrate CAPTURES --design design.toml --board "{c.board.text}"{sigmas} -o calibration'

    def cell(name: str, expected: Any) -> str:
        sigma = expected.sigma[name]
        return UNDETERMINED if not plan.determined(name, expected) else f"{sigma:.3g}" if sigma >= 1e-5 else "< 0.00001"

    rows = tuple(
        (name, cell(name, before), UNITS[name], number(plan.sizes[name], 4), MARKS[plan.trust(name)][0])
        for name in plan.quantities
    )
    changes = tuple(
        (
            c.what,
            *(cell(name, c.expected) for name in ("d_3", "H", "d_2")),
            f"{c.gain(before):.2f}",
            number(after[c.what], 3),
        )
        for c in sorted(plan.changes, key=lambda change: after[change.what])
    )
    return (
        Paragraph(_assumed(design, plan, asked)),
        Statements(tuple(answers)),
        Table(rows, "lrlrl", ("", "expected sigma", "", "of", ""), promises, RATIOS),
        _shares_table({name: before.shares[name] for name in plan.quantities}, whence),
        Table(
            changes,
            "lrrrrr",
            ("one change", "d_3 [mm]", "H", "d_2 [mm]", "gain in d_3", "depth, u [mm]"),
            changed,
        ),
        Code(command, "Once images are captured, with the design below as design.toml"),
    )


def _far_end(design: Design, plan: CapturePlan, asked: PlanOptions, build: LengthCovariance | None) -> Statement | None:
    """Far end of the working range as calibrated, where no board stands; None where one does or it is told already."""
    cover, known = plan_cover(design, plan.captures, asked), lengths_after(design, plan, asked)
    camera, far = Camera.of(design), cover.farthest_mm
    within = WorkingRange.of(camera, partial(depth_budget, camera, build=build, calibration=known)).ends
    told = any(one.at_mm > far for one in cover.uncovered)
    if told or within is None or not far * REACHED < within[1] < math.inf:
        return None
    end = f"{number(within[1], 3)} mm"
    text = (
        f"Boards stand from {number(cover.nearest_mm, 3)} to {number(far, 3)} mm ahead of the tip; the working range, "
        f"lengths as calibrated, ends at {end}: beyond the boards the model alone tells depth."
    )
    return Statement("plain", text, f'`--at "{end}"` takes boards there, or says why one cannot serve.')


def _promise(design: Design, plan: CapturePlan, asked: PlanOptions, build: LengthCovariance | None) -> Statement:
    """Lengths that a plan promises, the build's tolerances known before, and those that its poses do not determine."""
    alone = sigma = plan.expected.sigma
    if build is not None:
        measured, left = lengths_after(design, plan, asked).after(build)
        lengths, camera = measured.plus(left), Camera.of(design.thin_twin)
        both = {name: float(lengths.carried(camera, attrgetter(f"seen.{name}"))) for name in ("d_3", "H", "d_2")}
        sigma = {name: one or alone[name] for name, one in both.items()}
    sizes = {"d_3": f"{within(sigma['d_3'])} mm", "H": within(sigma["H"]), "d_2": _rounded(sigma["d_2"])}
    known = [f"{name} to {size}" for name, size in sizes.items() if plan.determined(name)]
    trusts = {name: plan.trust(name) for name in plan.quantities}
    text = f"By captures alone, {_quotable(trusts)}."
    text += f" It will know {listed(known)} (one standard deviation)." if known else ""
    advice = plan.advice
    if build is not None and plan.determined("d_3"):
        text += f" Tolerances are known before; captures alone tell d_3 to {alone['d_3']:.2g} mm."
        advice = f"{advice.removesuffix('.')}, by captures alone."
    d_3 = float(Camera.of(design).seen.d_3)
    if plan.determined("d_3") and sigma["d_3"] >= abs(d_3):
        text += f" d_3 itself is {number(d_3, 2)} mm as the main lens sees it."
    if plan.quantities != QUANTITIES:
        text += " The main lens sees its focal plane at infinity, so m is 0 and d_f is infinite."
    if lost := [name for name in plan.quantities if not plan.determined(name)]:
        text += f" Not determined by these poses: {listed(lost)}; depth is known without them."
    return Statement("plain" if (worst := _worst(trusts)) == "good" else worst, text, advice)


def _quotable(trusts: Mapping[str, Trust]) -> str:
    """Clause on the quantities that a signed calibration may quote, those with reserve, and those not."""
    good, reserve, none = ([name for name, trust in trusts.items() if trust == one] for one in MARKED)
    told = [
        f"a signed calibration may quote {listed(good)}" if good else "a signed calibration may quote nothing as it is",
        f"with reserve {listed(reserve)} (sigma over {100 * RESERVE:g} % of it)" if reserve else "",
        f"not {listed(none)} (sigma as large as itself, or not determined)" if none else "",
    ]
    return clauses(*told)


def _worst(trusts: Mapping[str, Trust]) -> Trust:
    return max(trusts.values(), key=MARKED.index)


def _trusts(data: Mapping[str, Any]) -> dict[str, Trust]:
    """Trust in each quantity of a calibration's JSON."""
    rows = data["quantities"]
    sigma, sizes = ({name: row[key] for name, row in rows.items()} for key in ("sigma", "estimate"))
    return {name: trust_in(name, sigma, sizes_of(sizes)) for name in rows}


def _rounded(size: Any) -> str:
    """A standard deviation [mm] with its unit, to three digits."""
    return length(float(f"{float(size):.3g}"))


def _pair(data: Mapping[str, Any]) -> str:
    """H and d_3 of a calibration's JSON with their standard deviations."""
    rows = {name: data["quantities"][name] for name in ("H", "d_3")}
    values = (
        f"{name} = {rounded(row['estimate'], row['sigma'])} ± {row['sigma']:.2g} {row['unit']}".strip()
        for name, row in rows.items()
    )
    return f"{', '.join(values)} (standard deviations)"


def _terms(radial: int) -> str:
    coefficients = "1 radial coefficient" if radial == 1 else f"{radial} radial coefficients"
    return f"{coefficients}, the field's curvature, the growth of the views' baseline"


def _distortion(fitted: Distortion) -> Statement:
    text = f"Distortion was fitted ({_terms(fitted.coefficients)}), {fitted.reason}."
    if fitted.without is None:
        return Statement("plain", text, "Without, these images give no camera.")
    places, slopes = fitted.without.places, fitted.without.slopes
    return Statement("plain", text, f"Without, residuals of places are {places:.2g}, of slopes {slopes:.2g} times.")


def _diffraction(result: Outcome, check: DiffractionCheck) -> Statement:
    if not check.corrected:
        return Statement("plain", f"{check.reason}.")
    taken = f"{check.reason}: up to {check.largest:.2g} pitches from a corner."
    if check.before is None:
        return Statement("plain", taken, "Left in, it would leave no calibration at all.")
    best = derived(check.before.vector(), result.sheet)
    changes = ", ".join(
        f"{name} {100 * (float(best[name]) / result.estimates[name].value - 1):+.2g} %"
        for name in ("d_2", "m", "H", "d_3")
    )
    return Statement("plain", taken, f"Left in, it would change the results by {changes}.")


def _method(result: Outcome) -> str:
    lattice, sheet = result.centres.lattice, result.sheet
    names = ((short_name(known.place, result.design), known) for known in sheet.uncertain)
    elements = "".join(f", {name} = {known.value:.6g} ± {known.sigma:.2g}" for name, known in names)
    return (
        f"Microlens centres from the white image ({lattice.layout}, pitch {lattice.pitch:.4f} px,"
        f" {result.centres.rms:.3g} px RMS about the lattice): {_lenses_used(result)}. Decoded;"
        " corners in the views; Zhang's method on the central view; Eq. 12 over the epipolar slopes; a joint fit of all"
        f" corners. From data sheets: f = {sheet.f:.6g} ± {sheet.f_sigma:.2g} mm, q = {sheet.q * 1e3:.6g} um,"
        f" d = {sheet.d * 1e3:.6g} ± {sheet.d_sigma * 1e3:.2g} um, the board's cell to"
        f" {100 * sheet.cell_sigma:.2g} %{elements}. Radial distortion coefficients fitted:"
        f" {result.distortion.coefficients}, {result.distortion.reason}."
        + (f" Posterior sampled with seed {result.seed}." if result.posterior else f" Intervals: {LAPLACE}.")
    )


def _drawings(drawings: Mapping[str, str]) -> list[Figure]:
    return [Figure(f"calibration-{name}", *FIGURES[name][:2], svg) for name, svg in drawings.items()]
