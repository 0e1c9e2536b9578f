"""Does depth hold for strangers? All cameras that ship and twenty drawn by seed, five scenes each, three lights.

Run from the project's root: python studies/depth/depth_proof.py [-o FOLDER]. Interrupted, it goes on where it was.
--only NAME ... measures some cameras, --again NAME ... some anew, --quick three cameras by few microlenses,
--parts N looks at each scene in so many parts of the field, the first as without it; --scenes NAME ... at some scenes;
--write NAME -o FILE.toml writes the design of one, to be tried by itself.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import time
import zlib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as `roslf` has it: threads that wait count as work

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from roslf_design.camera import Camera
from roslf_design.depth.geometry import ArrayGeometry, depth_of, disparity_of
from roslf_design.depth.measure import HELD, Prediction, Trial, simulate
from roslf_design.depth.mixing import LEAST
from roslf_design.depth.pictures import DETAIL, PictureOptions, chief_rays, default_scene, region_about
from roslf_design.design import Design, save
from roslf_design.design.parts import MOST_CONTRAST
from roslf_design.drawing.marks import Area, Dots, Line, Mark, box_key, dot_key
from roslf_design.drawing.panel import Panel, Scale, named_ticks
from roslf_design.drawing.picture import Picture
from roslf_design.imaging.camera import Region
from roslf_design.json_data import plain
from roslf_design.reporting.blocks import (
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
from roslf_design.reporting.printers import render_html
from roslf_design.scenes import Noise, Plane, Scene, Sphere
from roslf_design.theory.light import object_scale
from roslf_design.theory.photometry import exposure
from roslf_design.theory.quantities import QUANTITIES
from roslf_design.theory.stop_images import MicrolensImages
from studies.depth.own_texture import EDGE, on_one_surface, own_texture
from studies.depth.proof_cameras import DRAWN, LARGEST, SEED, ProofCamera, cameras, place

OUT = Path("reports/depth-proof")
EXPOSURES = 2
"""Of each scene and light."""
SIDES, WIDE = (14, 20), 260
"""Fewest and most microlenses along a side of what is looked at; about so many pixels in between."""
LIGHTS = {"bright": 1.0, "dim": 1 / 4, "dark": 1 / 16}
"""Against the design's own exposure, which fills half of the full well, or is that of a video frame."""
END, HALF_STEP = 0.5, 0.25
"""Disparities, to both sides of the focal plane, of the walls and of both sides of the step [pitches]."""
CURVED = 0.6
"""Sine of the steepest place of the sphere in view, where its texture is seen as short as a microlens allows."""
NEAREST, FARTHEST = 0.2, 4.0
"""Distances from the bore's mouth between which scenes stand, over that of the focal plane."""
REACH = 1
"""Microlenses beyond its own window in which views past an edge show its other side: half a pitch each way."""
WHOLE = 0.98
"""Share of its image from which a microlens is not cut."""


class Bar(NamedTuple):
    """Bounds of a figure, and how it is drawn and told."""

    low: float
    high: float
    words: str
    label: str
    seen: tuple[float, float]
    """Ends of the scale that it is drawn on."""


BARS = {
    "spread": Bar(0.0, 1.3, "Spread at most 1.3 times the prediction", "spread / predicted", (0.6, 2.6)),
    "within": Bar(0.60, 0.76, "60 to 76 % within the errors reported", "share within", (0.2, 1.0)),
    "bias": Bar(0.0, 1 / 3, "Bias under a third of the spread", "bias / spread", (0.0, 1.6)),
    "known": Bar(0.95, 1.0, "95 % known of what is neither cut nor occluded", "share known", (0.6, 1.0)),
}
WINDOW = 25
"""Microlenses of a window."""
CHANCE = 2.0
"""Standard errors by which a bar may be missed by chance."""
QUICK = ("paper", "rigid-scope", "drawn 6")
SCENES = ("slanted wall", "near wall", "far wall", "step", "sphere")


class View(NamedTuple):
    """What a camera looks at."""

    scene: Scene
    region: Region
    key: int
    """Of the camera and scene by their names: its rays and noise are its own."""

    def seed(self, light: int) -> int:
        """Seed of the scene in a light."""
        return int(np.random.SeedSequence(SEED, spawn_key=(self.key, light)).generate_state(1)[0])


def key_of(name: str, scene: str, part: int = 1) -> str:
    """Name of a camera's scene in the results; the first part of the field goes without its number."""
    return f"{name}, {scene}" if part == 1 else f"{name}, {scene} {part}"


def view_of(name: str, camera: ProofCamera, scene: str, side: int | None = None, part: int = 1) -> View:
    """A scene and the part of the sensor that looks at it, drawn from the field by the names of both."""
    design, chosen = camera.design, zlib.crc32(key_of(name, scene, part).encode())
    rng = np.random.default_rng([SEED, chosen])
    at = place(camera, rng)
    k = Camera.of(design.thin_twin)
    if side is None:
        pitch = abs(float(QUANTITIES["image_pitch_mm"](k) / k.q))
        side = int(np.clip(round(WIDE / pitch), *SIDES))
    region = region_about(design, at, side)
    if scene == "slanted wall":
        return View(default_scene(design), region, chosen)
    mouth = float(k.tip)
    ends = mouth + NEAREST * (design.d_f - mouth), mouth + FARTHEST * (design.d_f - mouth)

    def distance(disparity: float) -> float:
        z = float(depth_of(k, np.asarray(disparity)))
        return float(np.clip(z if math.isfinite(z) else ends[1], *ends))

    def sample(z: float) -> float:
        return float(k.d * object_scale(k, np.asarray(z - mouth)))

    def met(z: float) -> tuple[float, float]:
        ray = chief_rays(k, ArrayGeometry(design).traced, np.array([at]))[0]
        return float(ray[0] - ray[2] * z), float(ray[1] - ray[3] * z)

    def texture(z: float, seed: int) -> Noise:
        contrast = min(design.depth.contrast, MOST_CONTRAST)
        return Noise(finest=DETAIL * sample(z), contrast=contrast, seed=seed)

    first, second = (int(seed) for seed in rng.integers(2**31, size=2))
    if scene.endswith("wall"):
        z = distance(END if scene == "near wall" else -END)
        objects: tuple[Plane | Sphere, ...] = (Plane(distance=z, texture=texture(z, first)),)
    elif scene == "step":
        near, far = distance(HALF_STEP), distance(-HALF_STEP)
        (x, y), wide = met(near), 8 * side * sample(far)
        edge = Plane(distance=near, size=(wide, wide), centre=(x + wide / 2, y), texture=texture(far, first))
        objects = (Plane(distance=far, texture=texture(far, second)), edge)
    else:
        near = distance(HALF_STEP)
        (x, y), half = met(near), side / math.sqrt(2) * sample(near)
        radius = max(half / CURVED, float(QUANTITIES["field_half_width_mm"](k)))
        look = texture(near + radius * (1 - math.sqrt(1 - CURVED**2)), first)
        objects = (Sphere(distance=near + radius, radius=radius, centre=(x, y), texture=look),)
    return View(Scene(name=scene, objects=objects), region, chosen)


def lit(design: Design, share: float) -> Design:
    """A design with so much of the light that it takes by itself."""
    return design.replace({"light.exposure": share * float(exposure(Camera.of(design.thin_twin)))})


def trials(
    camera: ProofCamera, view: View, lights: Iterable[str] = LIGHTS, *, exposures: int = EXPOSURES,
    rays: int | None = None,
) -> Iterator[tuple[str, Trial]]:  # fmt: skip
    """What pictures of a scene tell, by light; the picture is rendered once, noise differs."""
    design = camera.design
    trial = None
    for number, light in enumerate(lights):
        options = PictureOptions(region=view.region, seed=view.seed(number), exposures=exposures, rays=rays)
        trial = simulate(lit(design, LIGHTS[light]), view.scene, options, again=trial)
        if trial.brightest > 1:
            trial = simulate(lit(design, trial.room * LIGHTS[light]), view.scene, options, again=trial)
        yield light, trial


def aside_of_edges(trial: Trial) -> NDArray[np.bool_]:
    """Microlenses whose windows see one surface alone, by the chief rays of their neighbours; shape (v, u)."""
    z = np.where(np.isfinite(trial.true), trial.true, 1e6)
    b = disparity_of(Camera.of(trial.raw.design.thin_twin), z)
    edge = np.zeros(b.shape, bool)
    for axis in (0, 1):
        jump = np.abs(np.diff(b, axis=axis)) > EDGE
        before, after = [slice(None)] * 2, [slice(None)] * 2
        before[axis], after[axis] = slice(None, -1), slice(1, None)
        edge[tuple(before)] |= jump
        edge[tuple(after)] |= jump
    reach = trial.first.disparities.window // 2 + REACH
    return np.asarray(~ndimage.binary_dilation(edge, np.ones((2 * reach - 1, 2 * reach - 1), bool)))


def _everywhere(prediction: Prediction, shape: tuple[int, int]) -> NDArray[np.float64]:
    """Standard errors predicted at every microlens; between those where they are, their inverses are straight lines."""
    rows, columns = np.unique(prediction.row), np.unique(prediction.column)
    inverse = np.reshape(1 / prediction.disparity, (len(rows), len(columns)))
    for axis, (known, count) in enumerate(zip((rows, columns), shape, strict=True)):
        inverse = np.apply_along_axis(partial(np.interp, np.arange(count), known), axis, inverse)
    return np.asarray(np.divide(1, inverse, out=np.full(shape, math.inf), where=inverse > 0))


def judged(trial: Trial) -> dict[str, Any]:
    """What a scene in a light tells, in disparities [pitches]: counts, spread, prediction, bias and share within."""
    camera = Camera.of(trial.raw.design.thin_twin)
    places, shape = trial.first.x_ml.reshape(-1, 2), trial.true.shape
    images, traced = MicrolensImages(camera, places), ArrayGeometry(trial.raw.design).traced
    images = images if traced is None else traced.cut(images)
    whole = images.shapes.kept_fraction[:, 0].reshape(shape) >= WHOLE
    single = aside_of_edges(trial)
    predicted = _everywhere(trial.prediction, shape)
    able = np.isfinite(trial.true) & (predicted <= LARGEST)
    wanted = able & whole & single
    measured = np.stack([run.measured for run in trial.runs])
    some = trial.compared & able & single
    around = trial.first.disparities.window
    window = around**2
    one: dict[str, Any] = {
        "microlenses": int(trial.true.size),
        "cut": float(1 - whole.mean()),
        "occluded": float(1 - single.mean()),
        "able": float(able.mean()),
        "wanted": int(wanted.sum()),
        "known": float(measured[:, wanted].mean()) if wanted.any() else None,
        "unknown": trial.unknown(),
        "exposures": len(trial.runs),
        "windows": float(some.sum() / window),
    }
    if some.sum() < window:
        return one
    true = disparity_of(camera, trial.true[some])
    off = np.stack([run.disparities.disparity[some] for run in trial.runs]) - true
    sigma = np.stack([run.disparities.sigma[some] for run in trial.runs])
    spread, mean = float(np.sqrt(off.var(0, ddof=1).mean())), off.mean(0)
    seen = trial.raw.design, trial.scene, trial.first.x_ml, trial.true
    texture = own_texture(*seen) * on_one_surface(*seen)
    own = ndimage.uniform_filter(texture / predicted**2, around, mode="nearest")[some] ** -0.5
    told = (sigma**2).mean(0) / own**2
    return one | {
        "disparity": float(true.mean()),
        "spread": spread,
        "over_predicted": float(np.sqrt((off.var(0, ddof=1) / own**2).mean())),
        "predicted": float(np.sqrt((own**2).mean())),
        "reported": float(np.sqrt((sigma**2).mean())),
        # Of the variance told, over that predicted, from one window to the next.
        "uneven": float(told.std() / told.mean()),
        "bias": float(off.mean()),
        # What stays in all exposures beside the bias: rays, and what windows make of their own texture.
        "stays": math.sqrt(max(float(mean.var()) - spread**2 / len(off), 0.0)),
        "within": float((np.abs(off) < sigma).mean()),
        "beyond_5": float((np.abs(off) > 5 * sigma).mean()),
    }


class Pooled(NamedTuple):
    """A figure and its standard error."""

    value: float
    error: float


class Verdict(NamedTuple):
    """A camera's figures, pooled over its scenes and lights."""

    spread: Pooled
    """Over prediction."""
    within: Pooled
    """Share."""
    bias: Pooled
    """Rms over scenes and lights of the mean error over the spread there, less what chance leaves."""
    known: Pooled | None
    """Share of the microlenses that are neither cut nor beside an edge; None where all are."""
    signed: float
    """Mean of the bias over the spread, with its sign."""
    worst: str
    """Scene and light that are farthest off."""
    unable: int
    """Scenes and lights in which too little is to be known."""

    def missed(self, chance: float = 0.0) -> list[str]:
        """Bars that are missed by more than so many standard errors."""
        figures = zip(BARS.items(), (self.spread, self.within, self.bias, self.known), strict=True)
        return [
            name
            for (name, bar), one in figures
            if one is not None and max(bar.low - one.value, one.value - bar.high) > chance * one.error
        ]

    @property
    def words(self) -> str:
        """Verdict in words."""
        surely = self.missed(CHANCE)
        if surely:
            return f"misses {', '.join(surely)}"
        return f"open: {', '.join(self.missed())}" if self.missed() else "holds"


def pooled(results: Mapping[str, Mapping[str, Any]]) -> Verdict | None:
    """Figures of a camera from those of its scenes and lights; None where nothing could be compared.

    Scenes and lights count by their windows without common microlenses. What stays in all exposures, and the texture,
    which stays in all lights, counts once.
    """
    ones = {name: one for name, one in results.items() if one.get("spread")}
    if not ones:
        return None

    def column(key: str) -> NDArray[np.float64]:
        return np.array([one[key] for one in ones.values()], float)

    windows, count, spread, stays = (column(key) for key in ("windows", "exposures", "spread", "stays"))
    ratio, offset, inside = column("over_predicted"), column("bias") / spread, column("within")
    share = windows / windows.sum()
    square = float(share @ ratio**2)
    scenes = [name.split(", ")[0] for name in ones]
    texture = sum(
        float((share * ratio**2 * column("uneven"))[those].sum() / square) ** 2 / float(windows[those].max())
        for those in (np.array([scene == name for name in scenes]) for scene in {*scenes})
    )
    noise = 2 / float((windows * (count - 1)).sum())
    fixed = stays**2 / (stays**2 + spread**2)
    alone = windows * count / (1 + (count - 1) * fixed)
    within = float(alone @ inside / alone.sum())
    chance = (stays**2 + spread**2 / count) / windows / spread**2
    bias = math.sqrt(max(float(share @ (offset**2 - chance)), 0.0))
    wanted = [(one["wanted"], one["known"]) for one in results.values() if one["known"] is not None]
    total = sum(size for size, _ in wanted)
    known = sum(size * part for size, part in wanted) / max(total, 1)
    far = np.maximum(ratio / BARS["spread"].high, np.abs(offset) / BARS["bias"].high)
    return Verdict(
        Pooled(math.sqrt(square), math.sqrt(square * (noise + texture)) / 2),
        Pooled(within, math.sqrt(within * (1 - within) / float(alone.sum()))),
        Pooled(bias, float(np.sqrt((share**2 * chance).sum()))),
        Pooled(known, math.sqrt(known * (1 - known) / max(total / WINDOW, 1.0))) if total else None,
        float(share @ offset),
        list(ones)[int(far.argmax())],
        len(results) - len(ones),
    )


def of_camera(results: Mapping[str, Any], name: str) -> dict[str, dict[str, Any]]:
    """Figures of a camera by scene and light."""
    return {
        f"{key.removeprefix(f'{name}, ')}, {light}": one
        for scene in SCENES
        for key in sorted(results)
        if key.startswith(key_of(name, scene))
        for light, one in results[key]["lights"].items()
    }


Rows = Sequence[tuple[str, str, Verdict | None]]


def rows_of(results: Mapping[str, Any]) -> Rows:
    """Name, words and verdict of every camera that has been measured."""
    measured = ((name, camera.words, of_camera(results, name)) for name, camera in cameras().items())
    return [(name, words, pooled(ones)) for name, words, ones in measured if ones]


def table(rows: Rows) -> Table:
    """A row a camera."""
    lines = []
    for number, (name, words, one) in enumerate(rows, 1):
        if one is None:
            lines.append((f"{number}", name, words, *["-"] * 5, "nothing known"))
            continue
        figures = (
            f"{one.spread.value:.2f} ± {one.spread.error:.2f}",
            f"{100 * one.within.value:.0f} ± {100 * one.within.error:.0f} %",
            f"{one.bias.value:.2f} ± {one.bias.error:.2f}", f"{one.signed:+.2f}",
            "all are cut" if one.known is None else f"{100 * one.known.value:.1f} %",
        )  # fmt: skip
        lines.append((f"{number}", name, words, *figures, one.words))
    heads = ("", "camera", "what it is", "spread", "within", "bias", "signed", "known", "verdict")
    note = (
        "Spread over the prediction for each window's place and own texture; share of the errors within those "
        "reported; bias over spread, rms over scenes and lights, and its mean with the sign; known of the microlenses "
        "that are neither cut nor beside an edge. After ± the standard error that so few windows leave; "
        "open: missed by less than two of them."
    )
    return Table(tuple(lines), "rllrrrrrl", heads, "Cameras", note)


def worst_table(results: Mapping[str, Any], rows: Rows) -> Table:
    """Scenes and lights in which a bar is missed, of cameras that miss one."""
    lines = []
    for name, _, verdict in rows:
        if verdict is None or not verdict.missed():
            continue
        for case, one in of_camera(results, name).items():
            alone = pooled({case: one})
            known = "-" if one["known"] is None else f"{100 * one['known']:.0f} %"
            if alone is None and one["known"] is not None:
                lines.append((f"{name}, {case}", "-", f"{one['windows']:.0f}", *["-"] * 4, known, "known"))
            elif alone is not None and alone.missed(CHANCE):
                lines.append((
                    f"{name}, {case}", f"{one['disparity']:+.2f}", f"{one['windows']:.0f}", f"{alone.spread.value:.2f}",
                    f"{100 * one['within']:.0f} %", f"{alone.signed:+.2f}", f"{one['bias']:+.4f}", known,
                    ", ".join(alone.missed(CHANCE)),
                ))  # fmt: skip
    heads = ("camera, scene, light", "at", "windows", "spread", "within", "bias", "in pitches", "known", "misses")
    note = "Mean disparity there and mean error in pitches; each beyond two standard errors by itself."
    return Table(tuple(lines), "lrrrrrrrl", heads, "Where they miss", note)


def drawn(rows: Rows) -> Picture:
    """A dot for each camera and figure, bars shaded; dots beyond the scale stand at its end."""
    known = [(number, one) for number, (_, _, one) in enumerate(rows, 1) if one is not None]
    size, high, panels = (760.0, 680.0), 128.0, []
    presets = sum(not name.startswith("drawn") for name, _, _ in rows) + 0.5
    for at, (name, bar) in enumerate(BARS.items()):
        judged_by = [(number, getattr(one, name)) for number, one in known if getattr(one, name) is not None]
        x, y = (np.array(axis, float) for axis in ([n for n, _ in judged_by], [one.value for _, one in judged_by]))
        good = (y >= bar.low) & (y <= bar.high)
        y, low = np.clip(y, *bar.seen), max(bar.low, bar.seen[0])
        across = Scale(0.0, len(rows) + 1.0)
        marks: tuple[Mark, ...] = (
            Area([0, across.high, across.high, 0], [low, low, bar.high, bar.high], "sky", 0.35),
            Line([presets, presets], list(bar.seen), "ink", 0.6),
            Dots(x[good], y[good], "blue", size=5), Dots(x[~good], y[~good], "vermillion", "s", 5),
        )  # fmt: skip
        frame = (62.0, 14.0 + at * (high + 26), size[0] - 78, high)
        label = "camera, by its number in the table" if at == len(BARS) - 1 else ""
        ticks = named_ticks(range(2, len(rows) + 1, 2))
        panels.append(Panel(frame, across, Scale(*bar.seen), marks, label, bar.label, x_ticks=ticks))
    keys = [
        dot_key("holds", "blue"), dot_key("misses, by chance or surely", "vermillion", "s"),
        box_key("where it holds", "sky", 0.35),
    ]  # fmt: skip
    return Picture("proof", "Cameras against the bars", size, tuple(panels), tuple(keys), (14.0, size[1] - 24, 0.0))


def differences(predicted: Mapping[str, Mapping[str, float]]) -> Table:
    """Predicted standard errors against those of differences of rendered pictures."""
    lines = [(name, f"{one['kept']:.0%}", f"{one['x']:.3f}", f"{one['y']:.3f}") for name, one in predicted.items()]
    heads = ("camera", "unvignetted", "grating along x", "along y")
    note = (
        "Predicted standard error over that from the Fisher information of rendered pictures, by their differences "
        "with disparity; amplitude and phase of the grating free (`prediction_proof.py`)."
    )
    return Table(tuple(lines), "lrrr", heads, "Prediction against rendered pictures", note)


def bounds(attained: Mapping[str, Mapping[str, float]]) -> Table:
    """What spread any estimator can attain, over the prediction."""
    kinds = "all_pixels", "own_pixels"
    lines = [
        (name, *("none" if one[key] is None else f"{one[key]:.2f}" for key in kinds)) for name, one in attained.items()
    ]
    heads = ("camera", "every pixel", f"pixels with {LEAST:.0%} own light")
    note = (
        "Bound of Cramér and Rao by the pixels about a window, texture and the disparities beside it unknown, rms over "
        "textures of a wall in focus, over the prediction (`attainable.py`): windows with less texture make it some "
        "per cent more than 1. No pixel is saturated in it: where images overlap, at the design's own exposure pixels "
        "that two or three share are; dim: with a quarter of its light, as else most would be. None: no pixel has so "
        "much, and the estimator, which begins with such pixels, knows nothing of what all of them hold."
    )
    return Table(tuple(lines), "lrr", heads, "What any estimator can attain", note)


def _why(results: Mapping[str, Any], name: str) -> str:
    """Why most microlenses of a camera have no depth."""
    shares = Counter[str]()
    for one in of_camera(results, name).values():
        shares.update(one["unknown"])
    return max(shares, key=shares.__getitem__)


def _answers(results: Mapping[str, Any], rows: Rows) -> Iterator[Statement]:
    told = [(name, one) for name, _, one in rows if one is not None]
    dark = {name: _why(results, name) for name, _, one in rows if one is None}
    surely = [(name, one) for name, one in told if one.missed(CHANCE)]
    holds = sum(not one.missed() for _, one in told)
    whole = not surely and len(told) == len(cameras())
    yield Statement(
        "good" if whole else "caution",
        f"Does depth hold for strangers? {holds} of {len(rows)} cameras hold every bar, "
        f"{len(told) - len(surely) - holds} more miss one by no more than {CHANCE:g} standard errors, "
        f"{len(surely)} miss{''.join(f'; of {name} no depth is known ({why})' for name, why in dark.items())}.",
        "; ".join(f"{name}: {', '.join(one.missed(CHANCE))} (worst: {one.worst})" for name, one in surely),
    )
    for name, bar in BARS.items():
        surely_not = [camera for camera, one in told if name in one.missed(CHANCE)]
        perhaps = [camera for camera, one in told if name in one.missed() and camera not in surely_not]
        text = f"{bar.words}: {len(told) - len(surely_not) - len(perhaps)} of {len(told)} cameras."
        those = [f"Not: {', '.join(surely_not)}."] * bool(surely_not)
        those += [f"Open, by no more than {CHANCE:g} standard errors: {', '.join(perhaps)}."] * bool(perhaps)
        yield Statement("caution" if those else "good", text, " ".join(those))
    unable = sum(one.unable for _, one in told)
    if unable:
        every = sum(len(of_camera(results, name)) for name, _ in told)
        text = f"In {unable} of {every} scenes and lights less than one window could be compared."
        yield Statement("plain", text, f"Predicted above {LARGEST:g} pitches, or unknown: see what is known.")


def _notes(results: Mapping[str, Any]) -> Iterator[str]:
    refused = Counter(reason for camera in cameras().values() for reason in camera.refused)
    why = ", ".join(f"{count} for {reason}" for reason, count in refused.items())
    yield (
        f"{DRAWN} cameras are drawn (seed {SEED}); {sum(refused.values())} more were drawn and refused ({why}). "
        "Ranges: Fresnel number 0.5 to 6, 8 to 50 pixels a pitch, pixels of 1.4 to 6 um, microlens images of "
        "0.6 to 1.6 pitches, microlenses of f/3 to f/60, main lenses up to f/1, 450 to 650 nm. One in four is "
        "hexagonal; of each five one has a Bayer pattern, one a window or a lens in the bore, one a real main lens, "
        "and two have main lenses that cut images to 40 to 85 % where they are looked at."
    )
    yield (
        "Scenes: the slanted wall of roslf depth; walls at +0.5 and -0.5 pitches; a step from +0.25 to -0.25; a sphere "
        "as wide as the field, its front at +0.25 (larger where its texture would be seen too steeply). Where such a "
        "disparity lies before the bore's mouth or beyond infinity, the scene stands at a fifth, or four times, of the "
        "focal plane's distance from the mouth. Each is looked at somewhere else in the field, by seed. "
        "Finest detail of 2.5 microlenses there, the design's contrast."
    )
    yield (
        "One part of the field for a scene holds few windows. Cameras that it left open or missing were looked at in "
        "further parts (`--parts`), and all of them count: each with a texture, noise and place of its own."
    )
    yield (
        "Light: the design's own exposure (half of the full well, or 1/60 s), a quarter and a sixteenth of it; the "
        f"first is shortened where overlapping images would fill pixels, to {HELD:.0%} of the full well. Where "
        f"more than {LARGEST:g} pitches are predicted depth is not expected, and nothing counts. Noise is drawn for "
        "each camera, scene and light by itself."
    )
    yield (
        "Of each window the prediction counts microlenses that see one surface alone, with their neighbours and from "
        "all over the FAP: beside an edge these are fewer, by the scene's geometry."
    )
    yield (
        f"Pooled: over a camera's {len(SCENES)} scenes and {len(LIGHTS)} lights, each by its windows without common "
        "microlenses. Spread is the rms about each microlens's mean over exposures. Bias is squared before it is "
        "averaged, so that what differs in sign does not cancel, and freed of what chance adds to a square."
    )
    yield (
        f"Missed is a bar beyond {CHANCE:g} standard errors, open one within. These count exposures and windows; what "
        "stays in all exposures counts once, and so, for all lights, what windows' spread differs by for other reasons "
        "than texture and place."
    )
    yield (
        f"Beside an edge: chief rays of neighbours meet surfaces more than {EDGE:g} pitches apart within the window "
        f"and {REACH} microlens beyond. These microlenses count nowhere. Cut (less than {WHOLE:.0%} of the image "
        "unvignetted) ones count in all but what is known."
    )


def report(
    results: Mapping[str, Any],
    predicted: Mapping[str, Mapping[str, float]],
    attained: Mapping[str, Mapping[str, float]],
) -> Report:
    """The page."""
    rows = rows_of(results)
    seconds = sum(one["seconds"] for one in results.values())
    cost = Paragraph(
        f"{len(results)} pictures are measured, {len(SCENES)} or more of each of {len(cameras())} cameras, each in "
        f"{len(LIGHTS)} lights, in {seconds / 60:.0f} minutes of one core."
    )
    figure = Figure.of(
        "proof", "Cameras against the bars", "A sign is a camera, by its number in the table; those that ship left of "
        "the line. Figures beyond a scale stand at its end.", drawn(rows),
    )  # fmt: skip
    proofs = (differences(predicted),) if predicted else ()
    evidence = (worst_table(results, rows), *proofs, *((bounds(attained),) if attained else ()))
    again = Code("python studies/depth/prediction_proof.py\npython studies/depth/depth_proof.py", "Run again")
    return Report(
        "Depth that is proved",
        "cameras that ship, and strangers",
        (
            Section("Answers", (Statements(tuple(_answers(results, rows))), figure, table(rows)), "answers"),
            Section("Evidence", evidence, "evidence"),
            Section("How it was done", (cost, Bullets(tuple(_notes(results))), again), "how"),
        ),
    )


def main() -> None:
    """Measure what is missing, write the numbers, the picture and the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=None, help=f"folder for results ({OUT}), or a design file")
    parser.add_argument("--only", nargs="+", default=None, metavar="NAME", help="cameras to measure")
    parser.add_argument("--again", nargs="+", default=[], metavar="NAME", help="cameras to measure anew")
    parser.add_argument("--quick", action="store_true", help=f"{', '.join(QUICK)} by few microlenses")
    parser.add_argument("--exposures", type=int, default=EXPOSURES, help="of each scene and light")
    parser.add_argument("--parts", type=int, default=1, help="of the field that each scene is looked at in")
    parser.add_argument("--scenes", nargs="+", default=SCENES, choices=SCENES, help="to measure, else all")
    parser.add_argument("--rays", type=int, default=None, help="a pixel; else as roslf depth takes them")
    parser.add_argument("--write", metavar="NAME", help="write this camera's design to the file named with -o")
    given = parser.parse_args()
    named = [*(given.only or ()), *given.again, *([given.write] if given.write else [])]
    if unknown := sorted({*named} - {*cameras()}):
        parser.error(f'no camera "{unknown[0]}"; they are called {", ".join(cameras())}')
    if given.write:
        file = given.output or Path(f"{given.write.replace(' ', '-')}.toml")
        save(cameras()[given.write].design, file)
        print(f"written to {file}")
        return
    if given.exposures < 2:
        parser.error("spread takes two exposures at least")
    out = given.output or OUT
    out.mkdir(parents=True, exist_ok=True)
    store, beside = out / "proof.json", (out / "prediction.json", out / "attainable.json")
    results: dict[str, Any] = json.loads(store.read_text()) if store.exists() else {}
    looks = [(scene, part) for part in range(1, given.parts + 1) for scene in given.scenes]
    for name in QUICK if given.quick else given.only or given.again or cameras():
        for scene, part in looks:
            key = key_of(name, scene, part)
            if key in results and name not in given.again:
                continue
            camera, start = cameras()[name], time.process_time()
            view = view_of(name, camera, scene, SIDES[0] if given.quick else None, part)
            every = trials(camera, view, exposures=given.exposures, rays=given.rays)
            lights = {light: judged(trial) for light, trial in every}
            seconds = round(time.process_time() - start, 1)
            results[key] = plain({"region_px": list(view.region), "seconds": seconds, "lights": lights})
            store.write_text(json.dumps(results, allow_nan=False, indent=1) + "\n")
        one = pooled(of_camera(results, name))
        print(f"{name}: {'nothing known' if one is None else f'{one.words}; {one}'}", flush=True)
    predicted, attained = (json.loads(each.read_text()) if each.exists() else {} for each in beside)
    (out / "index.html").write_text(render_html(report(results, predicted, attained)))
    (out / "proof.png").write_bytes(drawn(rows_of(results)).to_png())


if __name__ == "__main__":
    main()
