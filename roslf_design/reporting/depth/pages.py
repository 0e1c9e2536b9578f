"""A measurement of depth, simulated or of a capture, as a page; the terminal shares its words."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from ...camera import Camera
from ...depth.estimate import DisparityStatus, epipolar_plane
from ...depth.geometry import ArrayGeometry, ViewGeometry
from ...depth.measure import REASONS, Measurement, Summary, Trial
from ...depth.sphere import SphereFit
from ...design import Design
from ...drawing.picture import Picture
from ...shapes.lattice import PACKINGS
from ...theory.colours import filters
from ...theory.depth_budget import MISMATCH, WARMTH, depth_budget
from ...theory.depth_error import MOST_FILL, fill_left
from ...theory.quantities import QUANTITIES
from ...words import length, listed, lux, number, percent
from ..blocks import Block, Bullets, Code, Figure, Paragraph, Report, Section, Statement, Statements, Table, Tone
from .pictures import depth_pictures

RIGHT = (0.61, 0.75)
"""Shares of errors within the standard error reported, of right ones: 68 % in the long run."""
NEAR = (0.9, 1.3)
"""Spread over prediction where prediction holds."""
ENOUGH = 30
"""Windows from which bias and spread are told well."""
SURELY = 3.0
"""Standard errors of a mean beyond which it is no chance: beyond two, one picture in twenty would be called biased."""
FEW = 0.98
"""Share of measured microlenses below which what is missing is a caution."""
WIDE = 1.3
"""Rms error over that told up to which errors reported are right."""
LITTLE = 0.001
"""Share from none, or all, below which no more digits are told."""
TAIL = 0.003
"""Share of the errors beyond five of those reported up to which they are right."""
FIGURES = {
    "map": (
        "Depth and its standard error at every microlens",
        "Of the first exposure. Where the legend names a reason, microlenses of its colour have no depth for it; "
        "nothing is filled in there.",
    ),
    "profile": (
        "Along the middle row",
        "Above, depth and the truth that the chief ray of each microlens meets. Below, the difference: most dots lie "
        "in the band where the errors reported are right; the dashed lines are what light, noise and texture allow. "
        "Neighbours share a window and err alike, so dots wander together.",
    ),
    "errors": (
        "Errors against prediction",
        "Left: errors in units of the standard error reported with each. Wider than the normal law: errors reported "
        "are too small. Right, where enough of the field was looked at: rms error around places of the field over what "
        "was predicted there, bias included; in a small part of the sensor each dot is a few windows, and scatters.",
    ),
    "dense": (
        "Dense: filled where unknown",
        "Hatched microlenses were not measured: they are filled from known ones nearby, along like brightness, with a "
        "larger error (dense.tif, dense_sigma.tif). No figure on this page counts them.",
    ),
    "epi": (
        "Epipolar-plane image",
        "One row of microlenses, seen through the row of pixels behind the middle of each. A point of the scene is a "
        "line; its slope is the disparity. The stretch with the steepest lines is shown.",
    ),
}
"""Title and caption of each picture."""


def measurement_pictures(trial: Measurement) -> dict[str, Picture]:
    """Every picture of a measurement."""
    run = trial.first
    plane = epipolar_plane(run.field, run.pupil, run.disparities, trial.true.shape[0] // 2, run.aside)
    return depth_pictures(trial, plane, REASONS)


def depth_report(trial: Trial, pictures: dict[str, Picture], command: str) -> Report:
    """The page: what was measured, how good it is, what that rests on, what is unknown and why, how to run it again."""
    columns, rows = trial.true.shape[::-1]
    return measurement_report(
        f"Depth that {trial.raw.design.name} measures",
        f"{trial.scene.name or 'a scene'}, seen by {columns} x {rows} microlenses; simulated with noise",
        answers(trial),
        basis(trial),
        [Figure.of(f"depth-{name}", *FIGURES[name], picture) for name, picture in pictures.items()],
        (Paragraph(_method(trial)), Code(command, "Run again")),
    )


def measurement_report(
    title: str, about: str, said: Sequence[Block], rests_on: tuple[Block, ...], figures: list[Figure],
    how: tuple[Block, ...],
) -> Report:  # fmt: skip
    """The page of a measurement, simulated or of a capture."""
    return Report(
        title,
        about,
        (
            Section("Answers", (*said, *figures[:1]), "answers"),
            Section("Assumptions", rests_on, "basis"),
            Section("Evidence", tuple(figures[1:]), "evidence"),
            Section("How it was done", how, "how"),
        ),
    )


def answers(trial: Trial) -> tuple[Block, ...]:
    """Blocks that answer a simulated measurement: what was measured, the verdicts, the numbers behind them."""
    return Paragraph(_what(trial)), Statements(tuple(statements(trial))), _summary_table(trial)


def _what(trial: Trial) -> str:
    run, count = trial.first, len(trial.runs)
    known = run.depth[run.measured]
    between = (
        f", which lies between {distances(run.geometry, float(known.min()), float(known.max()))}" if known.size else ""
    )
    wrong = trial.believed is not trial.raw.design
    other = f" Depth is computed for another camera, {trial.believed.name}." if wrong else ""
    times, alike = ("one exposure", "") if count == 1 else (f"{count} exposures", ", which differ by noise alone")
    return (
        f"The camera took {times} of {trial.scene.name or 'the scene'}{alike}; depth was measured in each, and "
        f"compared with the truth{between}.{other}"
    )


def distances(geometry: ViewGeometry, low: float, high: float) -> str:
    """Two depths in words: ahead of the tip where that is not the main lens, and from that as maps have them."""
    tip, lens = geometry.tip, f" {geometry.unit}"
    if geometry.place_unit == "mm":
        lens = f"{lens} from the main lens"
    if not tip:
        return f"{low:.5g} and {high:.5g}{lens}"
    return f"{low - tip:.4g} and {high - tip:.4g} mm ahead of the tip ({low:.5g} and {high:.5g}{lens})"


def _exposure_key(trial: Trial) -> str:
    """Key that says how long is exposed: the design's, or that of a scene that states it."""
    return "light.exposure" + " of the scene" * (trial.scene.light.exposure is not None)


def _light_of_the_scene(trial: Trial) -> Iterator[Statement]:
    """Which light counts, where a scene states an exposure of its own."""
    given = trial.scene.light
    if given.exposure is None:
        return
    whose = "scene" if "read_noise" in given.model_fields_set else "sensor"
    text = (
        f"How much light? The scene's own exposure, not the design's: {number(given.exposure, 4)} electrons where "
        f"it is white, {number(trial.electrons, 4)} in a pixel where it is as bright as on average; read noise is the "
        f"{whose}'s, {trial.raw.design.sensor.read_noise:.3g}."
    )
    yield Statement("plain", text)


def statements(trial: Trial) -> Iterator[Statement]:
    """A verdict for each question."""
    summary = trial.summary()
    if trial.saturated > 0:
        text = (
            f"Is the exposure right? {_percent(trial.saturated)} of the pixels are full: on average "
            f"{trial.electrons:.4g} electrons, of {trial.raw.design.sensor.full_well:.5g} that a pixel holds; the "
            f"brightest {'get' if trial.brightest > 1 else 'reach'} {trial.brightest * 100:.0f} % of that."
        )
        if trial.raw.design.depth.period is None:
            text += (
                " That is of the part looked at, exposed to its own mean; `roslf evaluate` counts a texture over the "
                "whole sensor, whose coarse detail makes whole parts brighter: there more of the field may be lost."
            )
        remedy = f"Expose {trial.room:.2g} times as long ({_exposure_key(trial)})."
        yield Statement("bad" if trial.saturated > 1 - FEW else "caution", text, remedy)
    yield from _light_of_the_scene(trial)
    yield known(trial, summary)
    yield from _texture(trial)
    if summary.bias_mm is None or summary.spread_mm is None or summary.told_mm is None or summary.inside_68 is None:
        yield Statement("bad", "How good is it? Nothing to compare: no microlens has both a depth and a truth.")
        return
    bias, spread = summary.bias_mm, summary.spread_mm
    windows = max(1.0, trial.compared.sum() * len(trial.runs) / trial.first.disparities.window**2)
    if windows < ENOUGH:
        text = f"Compared are few windows without common microlenses ({windows:.0f}): what is below may be chance."
        yield Statement("caution", text, "Name a larger --region, or more --exposures.")
    text = f"How far does it scatter? By {_mm(spread)} (one standard deviation of a single microlens's depth)."
    yield Statement("plain", text)
    small, chance = abs(bias) <= spread / 3, abs(bias) <= SURELY * summary.told_mm / math.sqrt(windows)
    text = f"Is it off on the whole? By {bias:+.2g} mm on average, {_share(abs(bias), spread)} the scatter."
    remedy = (
        "Averaging does not take this away: calibrate, and believe no depth to better than it."
        if trial.believed is not trial.raw.design
        else "The camera is known exactly here: this is what the matching itself is off by. Believe no depth to better."
    )
    yield _judged(text, windows, small, None if small or chance else ("bad", remedy))
    if summary.predicted_mm is None:
        why = "pixels are full" if trial.saturated > 1 - FEW else "neither light nor texture gives depth"
        text = f"Is it as predicted? Nothing was predicted: {why} here."
        yield Statement("caution", text, "Believe the errors reported with each depth, where there is one.")
    else:
        ratio, room = spread / summary.predicted_mm, math.sqrt(2 / windows)
        off = not NEAR[0] * (1 - room) <= ratio <= NEAR[1] * (1 + room)
        text = f"{_as_predicted(spread, summary.predicted_mm, summary.told_mm)}{_other_texture(trial)}"
        yield _judged(text, windows, NEAR[0] <= ratio <= NEAR[1], ("caution", _believe(trial, ratio)) if off else None)
    if trial.sphere is not None and trial.ball is not None:
        true = trial.ball.radius
        yield Statement("plain", f"{sphere_words(trial.sphere)} The scene's is {length(abs(true))}{_way(true)}.")
    inside, room = summary.inside_68, 2 * math.sqrt(0.68 * 0.32 / windows)
    text = (
        f"Are the errors reported with each depth right? {100 * inside:.0f} % of the depths lie within theirs, "
        "68 % would be right."
    )
    far = summary.beyond_5 or 0.0
    tail = f"{100 * far:.2g} % are off by more than five times theirs, where chance puts next to none"
    wrong: tuple[Tone, str] | None = None
    rms = math.hypot(spread, bias)
    if inside < RIGHT[0] - room or rms > WIDE * (1 + math.sqrt(2 / windows)) * summary.told_mm:
        wrong = "caution", _too_few_inside(trial, summary, rms, windows)
    elif inside > RIGHT[1] + room:
        wrong = "caution", "They are larger than need be: depths are better than reported."
    elif far > TAIL:
        wrong = "caution", f"Some are far off: {tail}."
    elif far > 0:
        text += f" But {tail}, as beside a step or on a steep flank: check such places."
    yield _judged(text, windows, errors_right(summary), wrong)


def _texture(trial: Trial) -> Iterator[Statement]:
    """Sentence on a texture as fine as microlenses show, or finer; none on one that is coarser."""
    if trial.aliased > 0:
        text = (
            f"Is the texture seen? In {_percent(trial.aliased)} of the field it aliases: far or tilted as it is there, "
            "its finest detail has fewer than two microlenses a period."
        )
        remedy = "Depth errs more there, as predicted, or is unknown: look at a flatter or nearer part."
        if trial.black:
            text += f" So much contrast leaves {_percent(trial.black)} of it black, with edges finer than its detail."
            remedy = "Views disagree there, and depth scatters more: give it a contrast of 0.15, or coarser detail."
        yield Statement("caution", text, remedy)
    elif trial.edge > 0:
        text = (
            f"Is the texture seen? Just: in {_percent(trial.edge)} of the field its finest detail has about two "
            "microlenses a period, below which it aliases."
        )
        yield Statement("plain", text, "Detail coarser by a tenth leaves a margin.")


def sphere_words(fit: SphereFit) -> str:
    """Radius of the sphere that fits depths best, with its error, or how flat it may be."""
    if not fit.told:
        return f"Is it a sphere? It cannot be told from a plane here: its radius is {length(fit.flattest)} or more."
    return (
        f"Is it a sphere? The best one has a radius of {number(abs(fit.radius), 3)} ± {_mm(fit.sigma)} (one standard "
        f"error, by light, texture and matching){_way(fit.radius)}; depths lie off it by {_mm(fit.rms)} rms."
    )


def sphere_line(fit: SphereFit | None) -> list[tuple[str, str, str, str]]:
    """Row on it in the table of numbers, where there is one."""
    if fit is None or not fit.told:
        return []
    return [("radius of a sphere", number(fit.radius, 3), "mm", f"± {_mm(fit.sigma)}; negative where it is hollow")]


def _way(radius: float) -> str:
    return ", bulging towards the camera" if radius > 0 else ", hollow"


def _as_predicted(spread: float, predicted: float, told: float) -> str:
    """Spread against the prediction [mm], and whether the errors reported count what is beyond it."""
    text = f"Is it as predicted? Predicted were {_mm(predicted)}; it scatters by {spread / predicted:.2f} times that."
    if spread > NEAR[1] * predicted and spread <= NEAR[1] * told and told * NEAR[0] > predicted:
        times = f"{told / predicted:.2f} times that"
        text += f" The errors reported, each by what its own window shows, are {times} as well: believe these."
    return text


def _too_few_inside(trial: Trial, summary: Summary, rms: float, windows: float) -> str:
    """Remedy of errors that too few depths lie within, or that are too small: by which of it is so."""
    told, bias = summary.told_mm or 0.0, abs(summary.bias_mm or 0.0)
    if rms > told:
        return f"They are too small: for this scene believe {_mm(rms)} instead."
    why = "too small at some places, too large at others"
    if len(trial.runs) > 1:
        why = "a place is off by what all exposures share, too, which their scatter does not show"
    if bias > (summary.spread_mm or 0.0) / 2:
        why = f"all are off by {_mm(bias)} together, which no error of single depths tells"
    elif windows < ENOUGH:
        why = "too few windows to tell"
    return f"On the whole they are large enough, {_mm(told)} reported and {_mm(rms)} found: {why}."


def errors_right(summary: Summary) -> bool:
    """True where errors are as large as those reported with each depth, in the middle and at the tails."""
    if summary.bias_mm is None or summary.spread_mm is None or not summary.told_mm or summary.inside_68 is None:
        return False
    rms = math.hypot(summary.spread_mm, summary.bias_mm)
    in_middle = RIGHT[0] <= summary.inside_68 <= RIGHT[1]
    return in_middle and rms <= WIDE * summary.told_mm and (summary.beyond_5 or 0.0) <= TAIL


def places(trial: Measurement) -> str:
    """Name of what has a depth: microlenses, or pixels of views."""
    return "microlenses" if trial.first.geometry.place_unit == "mm" else "pixels"


def _judged(text: str, windows: float, holds: bool, against: tuple[Tone, str] | None) -> Statement:
    """A tick for what holds and would show if it did not; `against` where chance alone does not explain what fails."""
    if against is not None:
        return Statement(against[0], text, against[1])
    if holds and windows >= ENOUGH:
        return Statement("good", text)
    count = f"{windows:.0f} window{'' if round(windows) == 1 else 's'} without common microlenses"
    return Statement("plain", text, f"Cannot be judged here: {count}.")


def known(trial: Measurement, summary: Summary) -> Statement:
    """How much of the field has a depth, and why the rest has none."""
    reasons = trial.unknown()
    why = listed([f"{_percent(share)} {reason}" for reason, share in reasons.items()]) if reasons else ""
    quantity = "depth" if trial.first.geometry.unit == "mm" else "disparity"
    text = f"How much of the field has a {quantity}? {_percent(summary.measured)} of the {places(trial)}."
    remedy = f"The rest is unknown, not guessed: {why}." if why else ""
    if reasons.get(DisparityStatus.SATURATED.reason, 0.0) > 1 - FEW:
        remedy += " Expose less: where pixels are full nothing is measured."
    if reasons.get(DisparityStatus.OUT_OF_RANGE.reason, 0.0) > 1 - FEW:
        remedy += " Search elsewhere: --between takes disparities, and distances where a camera is known."
    if reasons.get(DisparityStatus.MIXED.reason, 0.0) > 1 - FEW:
        remedy += f" {_overlap(trial.first.geometry)}"
    if DisparityStatus.UNSHARP.reason in reasons:
        blurred = trial.first.disparities.status == DisparityStatus.UNSHARP
        apart = float(trial.first.views_aside[blurred].mean())
        remedy += f" Where the lens is not sharp, views look {apart:.0f} microlenses apart: look nearer to the axis."
    tone: Tone = "good" if summary.measured >= FEW else "caution" if summary.measured > 0 else "bad"
    return Statement(tone, text, remedy)


def _overlap(geometry: ViewGeometry) -> str:
    """How far microlens images overlap where no pixel shows mostly its own microlens, and what is to be done."""
    words = "Microlens images overlap so much that views cannot be told apart"
    if isinstance(geometry, ArrayGeometry):
        camera = geometry.camera
        fill = float(fill_left(camera))
        shared = math.pi / 4 * fill**2 / PACKINGS[camera.layout].rise
        words = (
            f"Microlens images are {number(fill, 2)} times as wide as they lie apart, and a pixel has light of "
            f"{number(shared, 2)} microlenses: from {MOST_FILL[camera.layout]} times on views cannot be told apart"
        )
    return f"{words}. Match the f-number; roslf evaluate names the lengths that do."


def _believe(trial: Trial, ratio: float) -> str:
    if trial.assumes()["texture"] != "the scene's":
        return "The prediction is for the design's texture, not for that of this scene: believe what was measured."
    if ratio < 1:
        return "Believe the prediction for other places: this part of the scene has more texture, or luck."
    return (
        "Believe what was measured: the prediction is a bound, for texture that is alike everywhere and with nothing "
        "lost in matching."
    )


def _summary_table(trial: Trial) -> Table:
    """Table of bias, spread and predicted errors of the measured depths."""
    summary = trial.summary()
    rows = [
        ("bias", summary.bias_mm, "mean error"),
        ("spread", summary.spread_mm, _spread_note(trial)),
        ("predicted", summary.predicted_mm, "from light, noise and texture, over the field"),
        ("reported", summary.told_mm, "with each depth, from what its window shows"),
    ]
    lines = [(name, "-" if value is None else f"{value:.3g}", "mm", note) for name, value, note in rows]
    inside = "-" if summary.inside_68 is None else f"{100 * summary.inside_68:.1f}"
    lines.append(("within the error reported", inside, "%", "68 where it is right"))
    lines += sphere_line(trial.sphere)
    lines.append(("microlenses with a depth", f"{100 * summary.measured:.1f}", "%", ""))
    lines += [("unknown", f"{100 * share:.3g}", "%", reason) for reason, share in trial.unknown().items()]
    return Table(tuple(lines), "lrll", ("", "", "", ""), "In numbers")


def _spread_note(trial: Trial) -> str:
    if len(trial.runs) > 1:
        return f"of {len(trial.runs)} exposures about each microlens's mean"
    return "of one exposure, about the mean error"


def basis(trial: Trial) -> tuple[Block, ...]:
    """Assumptions behind the predicted errors and the noise of the picture."""
    design, given = trial.raw.design, trial.assumes()
    light, sensor = design.light, design.sensor
    source = (
        f"radiance {light.radiance:g} W/m^2/sr" if light.radiance is not None
        else f"{lux(light.illuminance)} on a surface that reflects {percent(light.reflectance)}"
    )  # fmt: skip
    rows: list[tuple[str, str, str]] = [
        ("light", source, f"{percent(light.transmission)} passes the optics, {1e6 * light.wavelength:.4g} nm"),
        ("electrons a pixel", number(trial.electrons, 4), "fully lit, where the scene is as bright as on average"),
        ("sensor", f"{percent(sensor.quantum_efficiency)} quantum efficiency", _noise_words(trial)),
    ]
    if "exposure_s" in given:
        detail = "in each octave of detail" if given["period_mm"] is None else f"period {length(given['period_mm'])}"
        rows += [
            ("exposure", f"{1e3 * given['exposure_s']:.3g} ms", ""),
            ("texture", f"{given['contrast']:.3g} rms contrast", f"{detail}; {given['texture']}"),
            ("independent views over the image", f"{given['views']:.3g}", "what diffraction leaves of the pixels"),
        ]
    else:
        rows.append(("disparity error", f"{given['sigma_disparity_pitches']:g} pitches", "as the design gives it"))
    rows.append(("microlenses matched", f"{given['window']} x {given['window']}", "depth is taken as even within"))
    notes = [
        "The scene's texture is alike everywhere and matt; real ones have shine, shadow and plain places.",
        "The camera is known exactly; what a calibration leaves open comes on top (roslf calibrate --plan).",
        "Away from depth steps: windows that see two depths are reported as unknown, or take the better side.",
    ]
    notes += optics_notes(trial.believed)
    if given["texture"] == "the scene's" and "exposure_s" in given:
        notes.append(_beside_evaluate(design, trial.texture))
    if trial.believed is not trial.raw.design:
        notes[1] = "Depth is computed for another camera than the one that took the pictures: what that costs is shown."
    return Table(tuple(rows), "lll", ("", "", ""), "Light, sensor, texture, matching"), Bullets(tuple(notes))


def _other_texture(trial: Trial) -> str:
    """Why a scatter as predicted is not what `roslf evaluate` expects; empty where textures make no difference."""
    given = trial.assumes()
    if given["texture"] != "the scene's" or "exposure_s" not in given:
        return ""
    own, seen = map(Camera.of, (trial.raw.design, trial.texture))
    bound, here = (float(QUANTITIES["sigma_z_mm"](camera)) for camera in (own, seen))
    if not 0 < bound < math.inf or NEAR[0] <= here / bound <= 1 / NEAR[0]:
        return ""
    return (
        f" roslf evaluate expects other noise, {_mm(bound)} in the middle of the focal plane, for the design's texture:"
        f" this scene's, with no detail finer than {length(float(seen['depth.finest']))}, makes it {_mm(here)} there."
    )


def _beside_evaluate(design: Design, texture: Design) -> str:
    """Why the predicted error is another than the bound of `roslf evaluate`: each is of its own texture."""
    own, seen = map(Camera.of, (design, texture))
    bound, here = (number(float(QUANTITIES["sigma_z_mm"](camera)), 3) for camera in (own, seen))
    finest, sample = float(seen["depth.finest"]), float(QUANTITIES["object_sample_mm"](own))
    return (
        f"roslf evaluate's depth noise, {bound} mm in the middle of the focal plane, is for the design's texture. For "
        f"this scene's, with no detail finer than {length(finest)} ({number(finest / sample, 3)} microlenses "
        f"there) and {number(float(seen['depth.contrast']), 3)} rms contrast against this part's brightness, it is "
        f"{here} mm; what is left between that and the error predicted comes of other distances and fields. "
        f"{_beside_expected(own)}"
    )


def _beside_expected(camera: Camera) -> str:
    """Sentence on what depth, expected, counts that simulated exposures do not have; empty where it counts nothing."""
    budget = depth_budget(camera)
    others = [term.name for term in budget.terms if term.name in (MISMATCH, WARMTH) and (term.u_mm or 0.0) > 0]
    if not (others and math.isfinite(budget.u_z_mm)):
        return ""
    return (
        f"Depth, expected, there (u = {number(float(budget.u_z_mm), 3)} mm) counts {listed(others)} beside that noise, "
        "which these exposures do not have: what they scatter by is noise, in this scene's texture."
    )


def optics_notes(design: Design) -> list[str]:
    """How what bends light before the microlenses is taken; what colour filters take."""
    notes = []
    if filters(colours := design.sensor.colours):
        notes.append(
            f"Behind its {colours} filters the white image makes all colours equal, and pixels are matched as grey "
            "ones: a scene with colours of its own scatters more than reported."
        )
    if through := list(design.traced_through):
        rest = "; colours and the blur of aberrations are left out"
        notes.append(f"Views look where rays traced through {listed(through)} go{rest}.")
    return notes


def _noise_words(trial: Trial) -> str:
    sensor = trial.raw.design.sensor
    return f"{sensor.full_well:g} electrons full well, {sensor.read_noise:g} read noise, {sensor.bits} bits"


def _method(trial: Trial) -> str:
    low, high = trial.first.disparities.search
    side = trial.first.disparities.window
    return (
        "The raw image was rendered with every effect that the scene calls for, given shot and read noise, decoded, "
        f"and freed of neighbours' light. Disparity was sought between {low:.2g} and {high:.2g} pitches over all views "
        f"at once and refined by least squares over {side} x {side} microlenses; its standard error is "
        "that of the samples used. Errors are counted where every exposure gave a depth, half a window from the edge."
    )


def _mm(value: float) -> str:
    return f"{value:.2g} mm"


def _share(part: float, whole: float) -> str:
    if not whole > 0:
        return "no part of"
    return f"{part / whole:.2g} times" if part > whole else f"{100 * part / whole:.0f} % of"


def _percent(share: float) -> str:
    """A share in words: all and none are told apart from nearly so."""
    if 0 < share < LITTLE or 1 - LITTLE < share < 1:
        return "under 0.1 %" if share < 0.5 else "over 99.9 %"
    return "100 %" if share == 1 else "none" if share == 0 else f"{100 * share:.3g} %"
