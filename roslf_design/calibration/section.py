"""A calibration, or the plan of one, as tables and sentences that the terminal and the page share."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from ..report.blocks import Block, Bullets, Code, Figure, Paragraph, Report, Section, Statement, Statements, Table
from .centres import Reason
from .datasheet import derived
from .planning import CapturePlan as Plan
from .result import LAPLACE, SHOWN, UNITS, Outcome

PLAN_SCHEMA = "roslf.calibration-plan/1"
_SOURCES = {
    "images": "images",
    "f": "f",
    "q": "pixel pitch",
    "d": "microlens pitch",
    "board": "board's scale",
    "systematic": "systematic",
}
_ADVICE = {
    "images": "show more boards, tilted further and over more distances",
    "f": "have the focal length measured",
    "q": "have the pixel pitch measured",
    "d": "have the microlens pitch measured",
    "board": "have the board's cells measured",
    "systematic": "show the boards nearer the focal plane, where corners hardly move from view to view",
}
_TITLES = {
    "residuals": "A pattern that the boards share speaks of distortion that was not asked for; scatter alone is noise.",
    "epi-lines": (
        "Slopes of all corners in the epipolar-plane images. The line's slope gives d_2, its zero the focal plane, m/A;"
        " points far off it are corners badly placed or a board badly posed."
    ),
    "posterior": (
        "Dark and light regions hold 68 % and 95 %; dashed lines hold 68 %. A narrow ridge is a pair that the images"
        " cannot tell apart: better knowledge of one is better knowledge of the other."
    ),
    "depth": (
        "Error that this calibration puts into every depth measured with it, the same in all images: averaging does not"
        " take it away. Ticks mark the boards; beyond them the calibration extrapolates."
    ),
}


def quantities_table(result: Outcome) -> Table:
    """Every quantity with its intervals."""
    sampled = result.posterior is not None
    rows = []
    for name in SHOWN:
        e = result.estimates[name]
        places = _places(e.sigma)
        row = [name, f"{e.value:.{places}f}", UNITS[name], f"{e.sigma:.2g}"]
        row += [f"{a:.{places}f} to {b:.{places}f}" for a, b in ((e.low_68, e.high_68), (e.low_95, e.high_95))]
        if e.r_hat is not None and e.ess is not None:
            row += [f"{e.r_hat:.4f}", f"{e.ess:.0f}"]
        rows.append(tuple(row))
    headings = ("", "estimate", "", "sigma", "68 % interval", "95 % interval")
    if not sampled:
        title = "Calibrated, with intervals of Laplace's approximation"
        return Table(tuple(rows), "lrlrrr", headings, title)
    return Table(tuple(rows), "lrlrrrrr", (*headings, "R-hat", "ESS"), "Calibrated, with intervals of the posterior")


def shares_table(shares: Mapping[str, Mapping[str, float]]) -> Table:
    """Where each quantity's variance comes from; sources that add nothing to any are left out."""
    sources = [s for s in _SOURCES if any(shares[name][s] > 0 for name in SHOWN)]
    rows = tuple((name, *(f"{100 * shares[name][s]:.1f} %" for s in sources)) for name in SHOWN)
    note = "Systematic: what inner and outer views disagree on, and what corrections leave open."
    return Table(
        rows, "l" + "r" * len(sources), ("", *(_SOURCES[s] for s in sources)), "Where the variance comes from",
        note if "systematic" in sources else "",
    )  # fmt: skip


def ways_table(result: Outcome) -> Table:
    """The two steps beside the joint fit and, where diffraction was taken off, the joint fit without that."""
    found, sheet = result.calibration, result.sheet
    cameras = [found.second.camera, found.joint.camera]
    errors = [f"{found.first.rms:.3g}", f"{found.joint.rms:.3g}"]
    headings = ["steps one and two", "joint fit"]
    if result.diffraction is not None and result.diffraction.before is not None:
        cameras.append(result.diffraction.before)
        errors.append(f"{result.diffraction.rms_before:.3g}")
        headings.append("diffraction left in")
    lengths = [derived(camera.vector(), sheet, np.asarray(sheet.f)) for camera in cameras]
    names = ("A", "m", "d_2", "d_1", "d_f", "H", "d_3")
    rows = [(name, *(f"{float(values[name]):.5g}" for values in lengths), UNITS[name]) for name in names]
    rows.append(("reprojection RMS", *errors, "pitches"))
    return Table(
        tuple(rows), "l" + "r" * len(cameras) + "l", ("", *headings, ""), "By different ways",
        "Step one's error is that of the central view, the others' that of all views.",
    )  # fmt: skip


def statements(result: Outcome) -> Iterator[Statement]:
    """What an engineer came for."""
    e, found = result.estimates, result.calibration
    pair = ", ".join(
        f"{name} = {e[name].value:.{_places(e[name].sigma)}f} ± {e[name].sigma:.2g} {UNITS[name]}".strip()
        for name in ("H", "d_3")
    )
    yield Statement("caution" if result.warnings else "good", f"{pair} (standard deviations).")
    images, total = len(found.observations.names), len(found.observations.names) + len(found.missing)
    yield Statement(
        "plain",
        f"{images} of {total} images used, {len(found.observations.views)} views; reprojection RMS"
        f" {found.joint.rms:.3g} pitches, condition number {found.fit.covariance.condition:.3g}.",
    )
    yield Statement("plain", f"{lenses_used(result)}.")
    if result.diffraction is not None:
        yield _diffraction(result)
    parts = {source: result.shares["d_3"][source] for source in _SOURCES}
    worst = max(parts, key=lambda source: parts[source])
    yield Statement(
        "plain",
        f"{100 * parts[worst]:.0f} % of d_3's variance comes from {_from(worst)}.",
        f"To do better, {_ADVICE[worst]}.",
    )
    if result.posterior is not None:
        p = result.posterior
        yield Statement("good" if p.converged else "bad", f"Posterior {p.message}.")
    words = result.accuracy.sentence(times=False)
    yield Statement("caution" if result.accuracy.kept is False else "plain", f"{words[0].upper()}{words[1:]}.")
    for warning in result.warnings:
        yield Statement("caution", _sentence(warning))


def _diffraction(result: Outcome) -> Statement:
    found = result.diffraction
    assert found is not None
    if not found.corrected:
        return Statement("plain", f"{found.reason}.")
    taken = f"{found.reason}: up to {found.largest:.2g} pitches from a corner."
    if found.before is None:
        return Statement("plain", taken, "Left in, it would leave no calibration at all.")
    best = derived(found.before.vector(), result.sheet, np.asarray(result.sheet.f))
    changes = ", ".join(
        f"{name} {100 * (float(best[name]) / result.estimates[name].value - 1):+.2g} %"
        for name in ("d_2", "m", "H", "d_3")
    )
    return Statement(
        "plain",
        taken,
        f"Left in, it would change the results by {changes}.",
    )


def lenses_used(result: Outcome) -> str:
    """Which microlenses spoke for the lattice, and why others did not."""
    centres, radius = result.centres, result.undistorted_radius
    counts = [f"{number} {text}" for text, number in centres.counts().items() if text != Reason.USED.text]
    said = f"{int(centres.used.sum())} of {len(centres.indices)} microlenses used"
    said += f" (left out: {', '.join(counts)})" if counts else ""
    if radius is None:
        return said
    if math.isinf(radius):
        return f"{said}; by Eq. 6 the design cuts none of them"
    return f"{said}; by Eq. 6 the design cuts none within {radius:.0f} px of the axis"


def calibration_report(result: Outcome, pictures: Mapping[str, str], command: str, version: str) -> Report:
    """The page: answers, tables, figures (SVG text by name), how to run it again."""
    from .figures import PLOTS

    blocks: list[Block] = [Statements(tuple(statements(result))), quantities_table(result)]
    drawings = [Figure(f"calibration-{n}", PLOTS[n][0], _TITLES[n], svg) for n, svg in pictures.items()]
    method = Section("How it was done", (Paragraph(_method(result)), Code(command, "Run again")), "how")
    evidence = Section("Evidence", (*drawings, ways_table(result), shares_table(result.shares)), "evidence")
    subtitle = f"from {len(result.calibration.observations.names)} images of a {_board(result)}"
    return Report(
        f"Calibration of {result.design.name}",
        subtitle,
        (Section("Answers", tuple(blocks), "answers"), evidence, method),
        f"roslf_design {version}",
    )


def _method(result: Outcome) -> str:
    lattice, sheet = result.centres.lattice, result.sheet
    return (
        f"Microlens centres from the white image ({lattice.layout}, pitch {lattice.pitch:.4f} px,"
        f" {result.centres.rms:.3g} px RMS about the lattice): {lenses_used(result)}. Decoded;"
        " corners in the views; Zhang's method on the central view; Eq. 12 over the epipolar slopes; a joint fit of all"
        f" corners. From data sheets: f = {sheet.f:.6g} ± {sheet.f_sigma:.2g} mm, q = {sheet.q * 1e3:.6g} um,"
        f" d = {sheet.d * 1e3:.6g} ± {sheet.d_sigma * 1e3:.2g} um, the board's cell to"
        f" {100 * sheet.cell_sigma:.2g} %. Radial distortion coefficients fitted: {result.distortion}."
        + (f" Posterior sampled with seed {result.seed}." if result.posterior else f" Intervals: {LAPLACE}.")
    )


def plan_blocks(plan: Plan) -> tuple[Block, ...]:
    """A plan's promise and its changes, as tables."""
    before = plan.expected
    rows = tuple((name, f"{before.sigma[name]:.3g}", UNITS[name]) for name in SHOWN)
    changes = tuple(
        (c.what, *(f"{c.expected.sigma[name]:.3g}" for name in ("d_3", "H", "d_2")), f"{c.gain(before):.2f}")
        for c in plan.changes
    )
    return (
        Table(rows, "lrl", ("", "expected sigma", ""), "What these captures promise"),
        shares_table(before.shares),
        Table(changes, "lrrrr", ("one change", "d_3 [mm]", "H", "d_2 [mm]", "gain"), "Expected sigma after one change"),
        Bullets((plan_advice(plan),)),
    )


def plan_advice(plan: Plan) -> str:
    """The change that helps most, as a sentence; where none helps, that."""
    if not plan.changes or plan.changes[0].gain(plan.expected) < 1.02:
        return "No single change helps by more than 2 %."
    return _sentence(plan.advice)


def plan_to_dict(plan: Plan, design: str, seed: int, distortion: int) -> dict[str, object]:
    """A plan as JSON's types."""
    s, before = plan.captures, plan.expected
    return {
        "schema": PLAN_SCHEMA,
        "design": design,
        "captures": {
            "board": {"columns": s.board.columns, "rows": s.board.rows, "cell_mm": s.board.cell},
            "boards": s.boards,
            "distance_mm": s.distance,
            "range_mm": s.distance_range,
            "tilt_deg": math.degrees(s.tilt),
            "offset_mm": s.offset,
            "noise_pitches": s.noise,
            "views_across": s.views,
            "reach_px": s.reach,
        },
        "expected_sigma": {name: before.sigma[name] for name in SHOWN},
        "variance_shares": before.shares,
        "condition_number": before.condition,
        "correlation_A_inverse_d_2": before.correlation,
        "changes": [
            {
                "change": c.what,
                "expected_sigma": {name: c.expected.sigma[name] for name in SHOWN},
                "gain_d_3": c.gain(before),
            }
            for c in plan.changes
        ],
        "advice": plan_advice(plan),
        "distortion_coefficients": distortion,
        "seed": seed,
    }


def _places(sigma: float) -> int:
    """Decimals that show two digits of a standard deviation."""
    return max(0, min(8, 1 - math.floor(math.log10(sigma)))) if sigma > 0 else 6


def _from(source: str) -> str:
    names = {"images": "the images", "board": "the board's scale", "systematic": "systematic errors of the corners"}
    return names.get(source, f"the data sheet's {_SOURCES[source]}")


def _sentence(text: str) -> str:
    whole = f"{text[:1].upper()}{text[1:]}"
    return whole if whole.endswith((".", "?")) else f"{whole}."


def _board(result: Outcome) -> str:
    b = result.board
    return f"{b.columns} x {b.rows} board of {b.cell:g} mm cells"
