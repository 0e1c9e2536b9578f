"""Depth of a slanted wall and of a step, as four cameras measure it: matched, mismatched, cut, and wrongly believed.

Run from the project's root: python studies/depth/depth_study.py [-o FOLDER]
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from roslf_design.depth.measure import Trial, assumed, simulate
from roslf_design.depth.pictures import PictureOptions, default_scene
from roslf_design.design import Design, load
from roslf_design.drawing.marks import Area, Dots, Line, Mark, box_key, dot_key, line_key
from roslf_design.drawing.panel import Panel, Scale
from roslf_design.drawing.picture import PAGE, Picture, beside, one_panel
from roslf_design.evaluation import evaluate
from roslf_design.json_data import plain
from roslf_design.reporting.blocks import (
    Block,
    Bullets,
    Code,
    Figure,
    Paragraph,
    Report,
    Section,
    Statement,
    Statements,
    Table,
)
from roslf_design.reporting.depth.pictures import profile
from roslf_design.reporting.printers import render_html
from roslf_design.scenes import Noise, Plane, Scene

Floats = NDArray[np.float64]

OUT = Path("reports/depth")
STRIP = (0, 1436, 4600, 208)
"""Part of the sensor: all of its width, some sixteen microlenses high."""
BINS = 24
"""Places along x at which bias and spread are told."""
EXPOSURES, RAYS, SEED = 3, 256, 1
SMALL_LENS = 24.0
"""Diameter of the main lens of the camera that is used beyond its bound [mm]."""
SHORT_BORE = 20.0
"""d_3 of the mismatched camera [mm]."""


class Case(NamedTuple):
    """A camera, and what it is believed to be."""

    words: str
    design: Design
    believed: Design


def cases() -> dict[str, Case]:
    """The four cameras."""
    paper = load("paper")
    short, small = paper.replace(d_3=SHORT_BORE), paper.replace({"main_lens.diameter": SMALL_LENS})
    flat = paper.replace(d_3=0.0)
    return {
        "matched": Case("the paper's bench: images touch, none is cut", paper, paper),
        "mismatched": Case(f"d_3 = {SHORT_BORE:g} mm: images leave gaps, pixels stay dark", short, short),
        "cut": Case(f"main lens of {SMALL_LENS:g} mm: beyond Eq. 6 its rim cuts images", small, small),
        "d_3 taken as 0": Case("the paper's bench, depth computed as if the lens were the pupil", paper, flat),
    }


def scenes() -> dict[str, Scene]:
    """What they look at: the matched camera's own wall, and a step of 4 mm about the focal plane."""
    paper = load("paper")
    wall = default_scene(paper)
    first = wall.objects[0]
    assert isinstance(first, Plane)
    assert isinstance(first.texture, Noise)
    finest = first.texture.finest
    near = Plane(distance=348.0, centre=(30.0, 0.0), size=(60.0, 60.0), texture=Noise(finest=finest, seed=2))
    far = Plane(distance=352.0, texture=Noise(finest=finest, seed=1))
    return {"slanted wall": wall, "depth step": Scene(name="depth step", objects=(far, near))}


@dataclass(frozen=True, eq=False)
class Measured:
    """One camera's depth of one scene along x; arrays have one number a bin, NaN where too few depths fall in it."""

    trial: Trial
    x: Floats
    """Middle of each bin on the array [mm]."""
    bias: Floats
    """Mean error [mm]."""
    spread: Floats
    """Rms over the exposures about each microlens's mean [mm]."""
    reported: Floats
    """Rms of the standard errors reported with the depths, each from its own window [mm]."""
    predicted: Floats
    """Standard error for light, noise and texture, at the focal plane [mm]; inf where nothing tells depth."""
    kept: Floats
    """Unvignetted fraction of microlens images."""
    known: Floats
    """Share of the microlenses with a depth."""

    def to_dict(self) -> dict[str, Any]:
        """As JSON."""
        rows = {name: getattr(self, name) for name in ("x", "bias", "spread", "reported", "predicted", "kept", "known")}
        return plain({"summary": self.trial.summary(), "unknown": self.trial.unknown(), "along_x": rows})  # type: ignore[no-any-return]


def measured(
    case: Case, scene: Scene, region: tuple[int, int, int, int] = STRIP, *, exposures: int = EXPOSURES, bins: int = BINS
) -> Measured:
    """Depth of a scene, and its errors along x."""
    options = PictureOptions(region=region, seed=SEED, exposures=exposures, rays=RAYS)
    trial = simulate(case.design, scene, options, believed=case.believed)
    x = trial.first.x_ml[0, :, 0]
    edges = np.linspace(x[0] - 1e-9, x[-1] + 1e-9, bins + 1)
    middle = (edges[1:] + edges[:-1]) / 2
    own = np.digitize(np.broadcast_to(x, trial.true.shape), edges) - 1
    some, errors, sigma = trial.compared, trial.errors, np.stack([run.sigma for run in trial.runs])
    window = trial.first.disparities.window
    bias, spread, from_windows, known = (np.full(bins, np.nan) for _ in range(4))
    for n in range(bins):
        here = some & (own == n)
        known[n] = np.mean([run.measured[own == n].mean() for run in trial.runs])
        if here.sum() < window:
            continue
        off = errors[:, here]
        bias[n] = off.mean()
        spread[n] = np.sqrt(((off - off.mean(0)) ** 2).sum() / max(exposures - 1, 1) / off.shape[1])
        from_windows[n] = np.sqrt((sigma[:, here] ** 2).mean())
    fields = evaluate(assumed(case.design, scene, window), [(float(at), 0.0) for at in middle]).fields
    predicted = np.array([np.inf if field.sigma_z_mm is None else field.sigma_z_mm for field in fields])
    kept = np.array([field.kept_fraction for field in fields])
    return Measured(trial, middle, bias, spread, from_windows, predicted, kept, known)


def along(results: dict[str, Measured]) -> Picture:
    """Draw bias, spread and prediction along x, a panel for each camera."""
    keys = [
        dot_key("bias: mean error", "blue", size=3), box_key("bias ± spread", "sky", 0.45),
        line_key("± predicted standard error", "vermillion", 1.8, "7 4"),
    ]  # fmt: skip
    if any(not np.isfinite(one.bias).all() for one in results.values()):
        keys.append(box_key("unknown", "grey", 0.25))
    parts = []
    for name, one in results.items():
        low, high = one.bias - one.spread, one.bias + one.spread
        expected = np.where(np.isfinite(one.predicted), one.predicted, np.nan)
        half = (one.x[1] - one.x[0]) / 2
        every = np.concatenate([low, high, np.minimum(expected, np.nanmax(np.abs([low, high]), initial=0.2) * 1.2)])
        reach = 1.15 * float(np.nanmax(np.abs(every)))
        across, up = Scale(float(one.x[0] - half), float(one.x[-1] + half)), Scale(-reach, reach)
        marks: list[Mark] = [
            Area([at - half, at + half, at + half, at - half], [-reach, -reach, reach, reach], "grey", 0.25)
            for at, value in zip(one.x, one.bias, strict=True) if not np.isfinite(value)
        ]  # fmt: skip
        for at, a, b in zip(one.x, low, high, strict=True):
            if np.isfinite(a):
                marks.append(Area([at - half, at + half, at + half, at - half], [a, a, b, b], "sky", 0.45))
        marks += [
            Line([across.low, across.high], [0.0, 0.0], "ink", 1.0),
            Line(one.x, expected, "vermillion", 1.8, "7 4"), Line(one.x, -expected, "vermillion", 1.8, "7 4"),
            Dots(one.x, one.bias, "blue", size=3, clip=True),
        ]  # fmt: skip
        last = name == list(results)[-1]
        label = "microlens x on the array [mm]" if last else ""
        panel = Panel((0, 0, 1, 1), across, up, tuple(marks), label, "off by [mm]", name)
        parts.append(
            one_panel(name, "", (PAGE, 180.0 if last else 165.0), panel, left=66, top=28, foot=42 if last else 22)
        )
    return beside("along", "Bias and spread of depth over the field, four cameras", parts, keys, down=True)


def lost(one: Measured) -> Picture:
    """Draw spread and prediction over the unvignetted fraction of microlens images."""
    both = (one.kept > 0) & np.isfinite(one.spread)
    order = np.argsort(one.kept)
    finite = np.isfinite(one.predicted[order]) & (one.kept[order] > 0)
    values = np.concatenate([one.spread[both], one.predicted[order][finite]])
    up = Scale(float(values.min()) / 1.3, float(values.max()) * 1.3, log=True)
    marks = (
        Line(one.kept[order][finite], one.predicted[order][finite], "vermillion", 1.8, "7 4"),
        Dots(one.kept[both], one.reported[both], "green", "s", 3),
        Dots(one.kept[both], one.spread[both], "blue", size=4),
    )
    keys = [
        dot_key("measured spread", "blue"), dot_key("errors reported with the depths", "green", "s", 3),
        line_key("predicted", "vermillion", 1.8, "7 4"),
    ]  # fmt: skip
    labels = "unvignetted fraction of the microlens image", "standard error of depth [mm]"
    panel = Panel((0, 0, 1, 1), Scale(0.0, 1.04), up, marks, *labels)
    return one_panel(
        "lost", "Standard error of depth over the unvignetted fraction", (540.0, 320.0), panel, keys, left=70
    )


def statements(results: dict[str, dict[str, Measured]]) -> Iterator[Statement]:
    """What the comparison says."""
    wall = results["slanted wall"]
    matched, wrong = wall["matched"], wall["d_3 taken as 0"]
    summary = matched.trial.summary()
    if summary.spread_mm is not None and summary.predicted_mm is not None and summary.bias_mm is not None:
        ratio = summary.spread_mm / summary.predicted_mm
        yield Statement(
            "good" if ratio <= 1.3 else "caution",
            f"Does the matched camera reach its prediction? It scatters by {summary.spread_mm:.2g} mm, {ratio:.2f} "
            f"times the predicted {summary.predicted_mm:.2g} mm; bias {summary.bias_mm:+.1g} mm.",
        )
    far = wall["mismatched"].trial.summary()
    if far.spread_mm is not None and summary.spread_mm is not None and far.predicted_mm is not None:
        times = far.spread_mm / summary.spread_mm
        yield Statement(
            "plain",
            f"What does the mismatch cost? A spread of {far.spread_mm:.2g} mm, {times:.1f} times the matched "
            f"camera's (predicted {far.predicted_mm:.2g} mm): no bias, but smaller images and dark pixels.",
        )
    cut = wall["cut"]
    # Where few have a depth those are the ones that are cut least.
    some = np.isfinite(cut.spread) & (cut.known > 0.9) & (cut.kept < 0.999)
    if some.any():
        worst = int(np.flatnonzero(some)[cut.kept[some].argmin()])
        whole = float(np.nanmedian(cut.spread[cut.kept >= 0.999]))
        yield Statement(
            "plain",
            f"How much depth is lost where images are cut? Where {cut.kept[worst]:.0%} is unvignetted depth scatters "
            f"{cut.spread[worst] / whole:.1f} times as far as where images are whole (predicted "
            f"{cut.predicted[worst] / np.nanmin(cut.predicted):.1f}); of what is dark nothing is reported.",
        )
    off, scatter = float(np.nanmax(np.abs(wrong.bias))), float(np.nanmedian(wrong.spread))
    yield Statement(
        "bad",
        f"What if d_3 is taken as 0? Depths are off by up to {off:.2g} mm, {off / scatter:.0f} "
        "times what they scatter by, and no exposure or averaging shows it.",
        "Calibrate H and d_3: believe no depth from a model without the bore.",
    )


def summary_table(results: dict[str, dict[str, Measured]]) -> Table:
    """Every camera and scene in numbers."""
    rows = []
    for scene, each in results.items():
        for name, one in each.items():
            summary = one.trial.summary()
            numbers = (summary.bias_mm, summary.spread_mm, summary.predicted_mm, summary.told_mm)
            inside = "-" if summary.inside_68 is None else f"{100 * summary.inside_68:.0f} %"
            worst = "-" if not np.isfinite(one.bias).any() else f"{np.nanmax(np.abs(one.bias)):.2g}"
            values = ("-" if value is None else f"{value:.2g}" for value in numbers)
            rows.append((scene, name, f"{100 * summary.measured:.0f} %", *values, worst, inside))
    heads = ("scene", "camera", "known", "bias", "spread", "predicted", "reported", "largest bias", "within reported")
    note = (
        "Lengths in mm. Predicted for texture and light on average; reported with each depth, from its own window. "
        "Largest bias of a twenty-fourth of the field. 68 % within where the errors reported are right."
    )
    return Table(tuple(rows), "llrrrrrrr", heads, "Four cameras, two scenes", note)


def report(results: dict[str, dict[str, Measured]]) -> Report:
    """The page."""
    words = tuple(f"{name}: {case.words}." for name, case in cases().items())
    figures = {
        scene: Figure.of(f"along-{k}", *_caption(scene), along(each)) for k, (scene, each) in enumerate(results.items())
    }
    step = results["depth step"]["matched"].trial
    evidence: tuple[Block, ...] = (
        *figures.values(),
        Figure.of(
            "lost", "What cut images cost",
            "The camera with the small lens: each dot is a twenty-fourth of the field. A cut image has less light and, "
            "worse, a narrower base: its views see the scene from places that are closer together. Predicted is for "
            "texture and light on average; depths of windows with less texture scatter more, and their errors say so.",
            lost(results["slanted wall"]["cut"]),
        ),
        Figure.of(
            "step", "The step, as the matched camera sees it",
            "The middle row. Within half a window of the step a microlens sees two depths: it takes one of them, or is "
            "unknown; nothing in between is made up.",
            profile(step),
        ),
    )  # fmt: skip
    about = Paragraph(
        f"Simulated with noise, {EXPOSURES} exposures each: {step.electrons:.0f} electrons a pixel, texture with 10 % "
        "rms contrast in each octave down to 2.5 microlenses, windows of 5 x 5. Centres of microlens images are those "
        "of a white image, whatever the camera is believed to be."
    )
    return Report(
        "What four cameras know of depth",
        "bias and spread over the field, beside the prediction",
        (
            Section("Answers", (Statements(tuple(statements(results))), summary_table(results)), "answers"),
            Section("The cameras", (Bullets(words), about), "cameras"),
            Section("Evidence", evidence, "evidence"),
            Section("How it was done", (Code("python studies/depth/depth_study.py", "Run again"),), "how"),
        ),
    )


def _caption(scene: str) -> tuple[str, str]:
    return (
        f"Bias and spread over the field: {scene}",
        "Dots are mean errors, bands what exposures scatter by about them, dashed lines what light, noise and texture "
        "allow at the focal plane. Scales differ.",
    )


def main() -> None:
    """Measure, write the numbers, pictures and the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=OUT, help="folder for the results")
    out = parser.parse_args().output
    out.mkdir(parents=True, exist_ok=True)
    results: dict[str, dict[str, Measured]] = {}
    for scene, look in scenes().items():
        results[scene] = {}
        for name, case in cases().items():
            results[scene][name] = measured(case, look)
            print(scene, name, results[scene][name].trial.summary(), flush=True)
    page = report(results)
    numbers = {scene: {name: one.to_dict() for name, one in each.items()} for scene, each in results.items()}
    (out / "depth.json").write_text(json.dumps(numbers, allow_nan=False) + "\n")
    (out / "index.html").write_text(render_html(page))
    for scene, each in results.items():
        (out / f"{scene.replace(' ', '-')}.png").write_bytes(along(each).to_png())
    (out / "lost.png").write_bytes(lost(results["slanted wall"]["cut"]).to_png())
    (out / "step.png").write_bytes(profile(results["depth step"]["matched"].trial).to_png())


if __name__ == "__main__":
    main()
