"""Is the standard error of depth right? Twelve cameras, three textures, three lights.

Run from the project's root: python studies/depth/depth_proof.py [-o FOLDER]. Interrupted, it goes on where it was; with
--again NAME ... --exposures N some combinations are measured anew, with more exposures where few leave it open.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from roslf_design.camera import Camera
from roslf_design.depth.geometry import depth_of, disparity_of
from roslf_design.depth.measure import PictureOptions, Trial, _Unexposed, assumed, simulate
from roslf_design.design import Design, load
from roslf_design.drawing.marks import Area, Dots, Line, Mark, box_key, dot_key
from roslf_design.drawing.panel import Panel, Scale
from roslf_design.drawing.picture import Picture, one_panel
from roslf_design.imaging.camera import Region
from roslf_design.json_data import plain
from roslf_design.reporting.blocks import Code, Figure, Paragraph, Report, Section, Statement, Statements, Table
from roslf_design.reporting.printers import render_html
from roslf_design.scenes import Noise, Plane, Scene
from roslf_design.theory.depth_error import seen_at
from roslf_design.theory.disparity_error import view_gradient
from roslf_design.theory.photometry import exposure
from roslf_design.theory.quantities import QUANTITIES

OUT = Path("reports/depth-proof")
SIDE = 19
"""Microlenses along each side of what is looked at."""
EXPOSURES, RAYS, SEED = 16, 512, 3
"""Of each combination; rays a pixel; of noise and rays."""
DISPARITY = 0.3
"""Of the wall that is looked at [pitches]."""
LARGEST = 0.1
"""Predicted standard error up to which depth can be told [pitches]: a third of the largest that is told at all."""


class Case(NamedTuple):
    """A camera and where on its sensor is looked."""

    design: Design
    column: int | None = None
    """Of the region's middle [px]; None is the sensor's."""


def cases() -> dict[str, Case]:
    """The cameras."""
    paper = load("paper")
    small = paper.replace({"main_lens.diameter": 24.0})
    return {
        "matched": Case(paper),
        "gaps": Case(load("paper-mismatched")),
        "overlap": Case(paper.replace(D_F=3.3)),
        "cut": Case(small, 560),
        "cut to two fifths": Case(small, 361),
        "cut to a fifth": Case(small, 248),
        "hexagonal": Case(paper.replace({"microlens_array.layout": "hexagonal"})),
        "tilted array": Case(paper.replace({"microlens_array.tilt": (0.002, 0.003), "microlens_array.rotation": 0.01})),
        "real lens": Case(load("paper-singlet")),
        "window in water": Case(load("cystoscope")),
        "finer pixels": Case(paper.replace({"sensor.pixel": paper.q / 1.4})),
        "long bore": Case(paper.replace(d_3=200.0, D_F=1.89)),
    }


def ordered() -> list[str]:
    """Names of all combinations, as the table has them."""
    return [", ".join(parts) for parts in product(cases(), TEXTURES, LIGHTS)]


TEXTURES = {"fine": (4.0, 0.1), "coarse": (8.0, 0.1), "faint": (4.0, 0.03)}
"""Period of the finest detail [microlenses] and rms contrast in each octave."""
LIGHTS = {"bright": 1.0, "dim": 0.125, "dark": 0.004}
"""Against the exposure that fills half of the full well."""


def lit(design: Design, share: float) -> Design:
    """A design with so much of the light that it takes by itself."""
    return design.replace({"light.exposure": share * float(exposure(Camera.of(design.thin_twin)))})


def view_of(case: Case, texture: tuple[float, float], side: int = SIDE) -> tuple[Scene, Region]:
    """A wall out of focus, and the part of the sensor that looks at it."""
    camera = Camera.of(case.design.thin_twin)
    period, contrast = texture
    z = float(depth_of(camera, np.asarray(DISPARITY)))
    detail = period * float(QUANTITIES["object_sample_mm"](camera))
    scene = Scene(name="wall", objects=(Plane(distance=z, texture=Noise(finest=detail, contrast=contrast, seed=5)),))
    size = math.ceil(side * abs(float(QUANTITIES["image_pitch_mm"](camera) / camera.q)))
    width, height = camera.pixels
    column = width // 2 if case.column is None else case.column
    return scene, Region(column - size // 2, (height - size) // 2, size, size)


def trials(
    case: Case, texture: tuple[float, float], lights: Iterable[str], *, side: int = SIDE, exposures: int = EXPOSURES,
    rays: int = RAYS,
) -> Iterator[tuple[str, Trial]]:  # fmt: skip
    """What pictures of a wall tell, by light; noise differs, the rendered picture is the same."""
    scene, region = view_of(case, texture, side)
    picture: _Unexposed | None = None
    for light in lights:
        if picture is None:
            picture = _Unexposed.of(case.design, scene, region, seed=SEED, rays=rays)
        design = lit(case.design, LIGHTS[light])
        yield (
            light,
            simulate(design, scene, PictureOptions(region=region, seed=SEED, exposures=exposures), unexposed=picture),
        )


def judged(trial: Trial) -> dict[str, Any]:
    """What a trial says, in disparities [pitches]: spread and bias against prediction and against the errors told."""
    edge = trial.first.disparities.window
    some = trial.compared.copy()
    some[:edge], some[-edge:], some[:, :edge], some[:, -edge:] = False, False, False, False
    inner = np.zeros(some.shape, bool)
    inner[edge:-edge, edge:-edge] = True
    predicted = trial.prediction.disparity[inner[trial.prediction.row, trial.prediction.column]]
    # Of the mean information: windows have more texture or less of it.
    result: dict[str, Any] = {"predicted": float(np.mean(predicted**-2.0) ** -0.5), "compared": int(some.sum())}
    result["exposures"] = len(trial.runs)
    result["texture"] = steepness(trial, inner)
    result["known"] = float(np.mean([run.measured[inner].mean() for run in trial.runs]))
    if some.sum() < edge**2:
        return result
    camera = Camera.of(trial.raw.design.thin_twin)
    off = np.stack([run.disparities.disparity[some] for run in trial.runs]) - disparity_of(camera, trial.true[some])
    sigma = np.stack([run.disparities.sigma[some] for run in trial.runs])
    scores, count = off / sigma, len(trial.runs)
    about = (scores**2).sum(0) - count * scores.mean(0) ** 2
    spread = float(np.sqrt(about.mean() / (count - 1)))
    stays = float((scores.mean(0) ** 2).mean()) - spread**2 / count
    return result | {
        "told": float(np.mean(sigma**-2.0) ** -0.5),
        "spread": float(np.sqrt((off.var(0, ddof=1)).mean())),
        "score_spread": spread,
        "score_bias": float(scores.mean()),
        "score_stays": math.sqrt(max(stays, 0.0)),
        "bias_sigma": float(scores.mean(1).std(ddof=1)) / math.sqrt(count),
        "inside_68": float((np.abs(scores) < 1).mean()),
        "inside_sigma": float((np.abs(scores) < 1).mean(1).std(ddof=1)) / math.sqrt(count),
    }


def steepness(trial: Trial, inner: NDArray[np.bool_]) -> float:
    """Rms gradient of the picture taken, of few windows, against that of the whole texture."""
    field, picture = trial.first.field, trial.first.disparities.picture
    slopes = [
        make_interp_spline(axis, picture, k=5, axis=k).derivative()(axis) for k, axis in ((0, field.v), (1, field.u))
    ]
    camera = Camera.of(assumed(trial.raw.design, trial.scene, trial.first.disparities.window).thin_twin)
    expected = float(view_gradient(camera, seen_at(camera, float(np.nanmean(trial.true)) - float(camera.tip))))
    return float(np.sqrt((slopes[0] ** 2 + slopes[1] ** 2)[inner].mean()) / picture[inner].mean() / expected)


def faults(one: dict[str, Any]) -> list[str]:
    """Which bars a combination misses; the prediction is that for the texture which is really there."""
    if one["expected"] > LARGEST:
        # Too little texture or light: then it must say so, or tell a number with its error.
        return [] if "inside_68" not in one or one["inside_68"] > 0.55 else ["intervals"]
    if "told" not in one:
        return ["unknown"]
    ratio = one["told"] / one["expected"] * one["score_spread"]
    missed = [] if ratio <= 1.3 else ["spread"]
    missed += [] if abs(one["score_bias"]) <= 1 / 3 else ["bias"]
    return missed + ([] if 0.61 <= one["inside_68"] <= 0.75 else ["intervals"])


def by_chance(one: dict[str, Any]) -> bool:
    """Whether what misses is within two of the standard errors that so few exposures leave."""
    missed = faults(one)
    if "spread" in missed or "unknown" in missed:
        return False
    far = abs(one["inside_68"] - min(max(one["inside_68"], 0.61), 0.75)) > 2 * one["inside_sigma"]
    return not ("bias" in missed and abs(one["score_bias"]) - 1 / 3 > 2 * one["bias_sigma"]) and not (
        "intervals" in missed and far
    )


def drawn(rows: Sequence[tuple[str, dict[str, Any]]]) -> Picture:
    """Spread over prediction for every combination, and the bar."""
    known = [(name, one) for name, one in rows if "told" in one]
    x = np.array([one["expected"] for _, one in known])
    y = np.array([one["told"] * one["score_spread"] for _, one in known]) / x
    good = np.array([not faults(one) for _, one in known])
    across, up = Scale(x.min() / 1.3, x.max() * 1.3, log=True), Scale(0.0, max(2.0, 1.1 * y.max()))
    ends = [across.low, across.high]
    marks: tuple[Mark, ...] = (
        Area([*ends, *ends[::-1]], [1.0, 1.0, 1.3, 1.3], "sky", 0.35),
        Line([LARGEST, LARGEST], [up.low, up.high], "ink", 1.0),
        Dots(x[good], y[good], "blue", size=4), Dots(x[~good], y[~good], "vermillion", "s", 4),
    )  # fmt: skip
    keys = [
        dot_key("holds every bar", "blue"), dot_key("misses one", "vermillion", "s"), box_key("1 to 1.3", "sky", 0.35)
    ]  # fmt: skip
    panel = Panel((0, 0, 1, 1), across, up, marks, "predicted standard error of disparity [pitches]", "spread over it")
    return one_panel("proof", "Spread of disparity over its prediction", (620.0, 340.0), panel, keys, left=66)


def table(rows: Sequence[tuple[str, dict[str, Any]]]) -> Table:
    """Every combination in numbers."""
    lines = []
    for name, one in rows:
        known = f"{100 * one['known']:.0f} %"
        if "told" not in one:
            numbers = ["-"] * 4
        else:
            numbers = [
                f"{one['told'] * one['score_spread'] / one['expected']:.2f}", f"{one['score_spread']:.2f}",
                f"{one['score_bias']:+.2f} ± {one['bias_sigma']:.2f}",
                f"{100 * one['inside_68']:.0f} ± {100 * one['inside_sigma']:.0f} %",
            ]  # fmt: skip
        missed = ", ".join(faults(one)) or "none"
        count = f"{one['exposures']}"
        lines.append((name, count, f"{one['expected']:.3g}", known, *numbers, missed))
    heads = (
        "camera, texture, light", "exposures", "predicted", "known", "spread", "in errors told", "bias", "within",
        "missed",
    )  # fmt: skip
    note = (
        "Standard error of disparity predicted for the texture in view, in pitches; spread over it; spread and mean in "
        "the errors told with each depth; share within them. Bias and share with the standard error that the exposures "
        "leave. Each combination looks at 25 to 121 microlenses, about five windows of their own."
    )
    return Table(tuple(lines), "lrrrrrrrl", heads, "Cameras, textures, lights", note)


def differences(rows: Sequence[tuple[str, dict[str, float]]]) -> Table:
    """Predicted standard errors against those of differences of rendered pictures."""
    lines = [(name, f"{one['kept']:.0%}", f"{one['x']:.3f}", f"{one['y']:.3f}") for name, one in rows]
    heads = ("camera", "kept of the image", "grating along x", "along y")
    note = (
        "Predicted standard error over that from the Fisher information of rendered pictures, by their differences "
        "with disparity; amplitude and phase of the grating free (`prediction_proof.py`)."
    )
    return Table(tuple(lines), "lrrr", heads, "Prediction against rendered pictures", note)


def report(rows: Sequence[tuple[str, dict[str, Any]]], predicted: Sequence[tuple[str, dict[str, float]]]) -> Report:
    """The page."""
    can = [one for _, one in rows if one["expected"] <= LARGEST]
    holds = sum(not faults(one) for one in can)
    chance = sum(bool(faults(one)) and by_chance(one) for one in can)
    cannot = [one for _, one in rows if one["expected"] > LARGEST]
    unknown = float(np.mean([one["known"] for one in cannot])) if cannot else 0.0
    judged_ones = [one for one in can if "told" in one]
    ratios = [one["told"] * one["score_spread"] / one["expected"] for one in judged_ones]
    within = float(np.mean([one["inside_68"] for one in judged_ones]))
    sure = math.sqrt(sum(one["inside_sigma"] ** 2 for one in judged_ones)) / max(len(judged_ones), 1)
    good = holds + chance == len(can)
    rest = (
        f"{chance} more miss one by no more than two standard errors of what so few exposures tell. " if chance else ""
    )
    lost = [(name, faults(one)) for name, one in rows if faults(one) and not by_chance(one)]
    answers = [
        Statement(
            "good" if good else "caution",
            f"Does depth scatter as predicted? {holds} of {len(can)} combinations that can tell depth hold every bar: "
            "spread up to 1.3 times the prediction, bias under a third, 61 to 75 of 100 within. "
            f"{rest}Spread is {min(ratios):.2f} to {max(ratios):.2f} of the prediction, {np.median(ratios):.2f} in the "
            f"middle; {sum(ratio < 1 for ratio in ratios)} lie below 1, as few windows have more texture or less.",
            "; ".join(f"{name}: {' and '.join(missed)}" for name, missed in lost) or "What misses stands in the table.",
        ),
        Statement(
            "good" if 0.61 <= within <= 0.75 else "caution",
            f"Are the errors told right? {within:.1%} of all errors lie within them (± {sure:.1%}).",
        ),
        Statement(
            "plain",
            f"And where there is too little light or texture? {len(cannot)} combinations are predicted above "
            f"{LARGEST:g} pitch; of their microlenses {unknown:.0%} have a depth, the others are unknown.",
        ),
    ]
    if predicted:
        off = max(abs(one[axis] - 1) for _, one in predicted for axis in "xy")
        close = sum(all(abs(one[axis] - 1) < 0.02 for axis in "xy") for _, one in predicted)
        answers.append(
            Statement(
                "good" if close == len(predicted) else "caution",
                f"Is the prediction what pictures hold? {close} of {len(predicted)} cameras agree to 2 % with the "
                f"Fisher information of rendered pictures; the farthest is off by {off:.1%}.",
            )
        )
    names = {name for name, _ in rows}
    missing = [c for c in cases() if any(name.startswith(f"{c}, ") and name not in names for name in ordered())]
    rays = " or ".join(str(n) for n in sorted({one["rays"] for _, one in rows}))
    about = Paragraph(
        f"A wall {DISPARITY:g} pitches out of focus; textures: finest detail of 4 or 8 microlenses, contrast 10 % or "
        f"3 % an octave; light: half of the full well, an eighth and a 250th of that. {rays} "
        "rays a pixel: what they scatter is the same in all exposures. "
        f"{len(rows)} of the {len(cases()) * len(TEXTURES) * len(LIGHTS)} combinations are measured."
        + (f" Not or not all of: {', '.join(missing)}." if missing else "")
    )
    figure = Figure.of(
        "proof", "Spread over prediction", "Each sign is one camera, texture and light; right of the line depth is not "
        "expected to be told.", drawn(rows),
    )  # fmt: skip
    return Report(
        "Depth that is proved",
        "what scatters beside what is predicted",
        (
            Section("Answers", (Statements(tuple(answers)), about), "answers"),
            Section("Evidence", (figure, table(rows), *((differences(predicted),) if predicted else ())), "evidence"),
            Section(
                "How it was done",
                (Code("python studies/depth/prediction_proof.py\npython studies/depth/depth_proof.py", "Run again"),),
                "how",
            ),
        ),
    )


def main() -> None:
    """Measure what is missing, write the numbers, the picture and the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=OUT, help="folder for the results")
    parser.add_argument("--again", nargs="*", default=[], metavar="NAME", help="combinations to measure anew")
    parser.add_argument("--exposures", type=int, default=EXPOSURES, help="of each combination that is measured")
    given = parser.parse_args()
    unknown = sorted({*given.again} - {*ordered()})
    if unknown:
        parser.error(f'no combination "{unknown[0]}"; they are called like "{ordered()[0]}"')
    if given.exposures < 2:
        parser.error("spread takes two exposures at least")
    out = given.output
    out.mkdir(parents=True, exist_ok=True)
    store = out / "proof.json"
    results: dict[str, Any] = json.loads(store.read_text()) if store.exists() else {}
    known = {*results} - {*given.again}
    for (camera, case), (texture, look) in product(cases().items(), TEXTURES.items()):
        names = {light: f"{camera}, {texture}, {light}" for light in LIGHTS}
        lights = [light for light, name in names.items() if name not in known]
        for light, trial in trials(case, look, lights, exposures=given.exposures):
            one = judged(trial)
            # The few windows have more texture than the whole of it, or less: best seen in bright light.
            bright = one if light == "bright" else results.get(names["bright"], one)
            results[names[light]] = plain(one | {"expected": one["predicted"] / bright["texture"], "rays": RAYS})
            store.write_text(json.dumps(results, allow_nan=False, indent=1) + "\n")
            print(names[light], results[names[light]], flush=True)
    rows = [(name, results[name]) for name in ordered() if name in results]
    beside = out / "prediction.json"
    predicted = list(json.loads(beside.read_text()).items()) if beside.exists() else []
    (out / "index.html").write_text(render_html(report(rows, predicted)))
    (out / "proof.png").write_bytes(drawn(rows).to_png())


if __name__ == "__main__":
    main()
