"""Values that the page shows of a session: its pictures, and its numbers, verdicts and proposals."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from functools import cached_property
from html import escape
from typing import Any, NamedTuple

import numpy as np

from ..bore.mapping import NAMES
from ..camera import Camera
from ..design import Design
from ..drawing.marks import Point
from ..drawing.picture import Picture
from ..drawing.theme import short
from ..errors import FAULTS
from ..evaluation import Evaluation
from ..evaluation.field_images import RIM
from ..evaluation.groups import Verdict
from ..evaluation.required import Requirement
from ..evaluation.result import depth_facts
from ..evaluation.verdicts import farthest_off
from ..lenses.glass import Glass
from ..reporting.depth.pictures import normalised, profile
from ..reporting.design.curves import depth_over_field, depth_precision, field_curve, matching_plane
from ..reporting.design.effects import effects_budget
from ..reporting.design.field import mla_map
from ..reporting.design.figures import at_room
from ..reporting.design.instrument import scale_drawing
from ..reporting.design.microlens import microlens_image, nearest_microlens
from ..reporting.design.rays import meridional
from ..reporting.optimise.pictures import change_bars, ends_differ, goal_front, search_history
from ..reporting.tolerance.pictures import offender_bars, spread_bars, yield_bars, yield_curve
from ..theory.depth_budget import NOISE, WARMTH
from ..theory.quantities import QUANTITIES, noise_words
from ..words import clauses, decimals, listed, percent, sentence, the, to_html
from .optimise_run import OptimiseResult
from .state import (
    BY_SYMBOL,
    FIELDS,
    GLASSES,
    LIGHT,
    MEDIA,
    STEPS,
    TEMPERATURE,
    WHOLE,
    WINDOW,
    History,
    Look,
    NumberField,
    State,
    encode,
    objective_of,
    place_on_mla,
    position,
    reach,
    show,
    value_of,
    window_of,
)

Size = tuple[int, int]

GLANCE = (
    *("aperture_constant", "f_number_microlens", "f_number_pupil", "fill_factor", "undistorted_field_mm"),
    *("field_half_width_mm", "image_diameter_px", "views_geometric", "views_independent", "object_sample_mm"),
    *("sigma_z_mm", "airy_radius_px"),
)
"""Quantities that one asks for first."""

LIGHT_GROUPS = tuple(dict.fromkeys(field.group for field in LIGHT))

KNOWN_ALIKE = 1.1
"""Factor within which depth counts as known as well as on the axis."""

COOLER = (
    "against temperature, calibrated_at where the camera is used, a housing that expands otherwise, or a narrower range"
)
"""Remedies of depth that temperature spoils, all of [environment]."""

FOLDED = 2.4
"""Width of a drawing to scale, in heights of the room for it."""
LEAST, MOST = 160, 3000
"""Sizes that a picture is made in [px]."""


@dataclass(frozen=True)
class PictureSource:
    """Source of pictures: a design, the view of it, and results of runs."""

    design: Design
    """With an ideal lens: the pictures are of the thin-lens model."""
    real: Design
    """With its own lens, whose glass tells how depth warms."""
    evaluate: Callable[[], Evaluation]
    """Evaluation of it, as far as it is known."""
    look: Look
    limits: tuple[float, float] | None = None
    """Where the axes of the plane of d_3 and D_F end [mm], kept still while its point is dragged."""
    runs: Mapping[str, Any] = field(default_factory=dict)
    """Result of the last run of each kind."""

    @cached_property
    def evaluation(self) -> Evaluation:
        """Evaluation of the design: of a real lens as long as it is not traced, of its thin-lens model."""
        return self.evaluate()

    @property
    def provisional(self) -> bool:
        """Whether a real lens is yet to be traced."""
        return self.real is not self.design and self.evaluation.real_lens is None

    @property
    def traced_to(self) -> float | None:
        """How far from the array's middle images are whole through a real lens [mm]; None until it is traced."""
        if self.real is not self.design:
            with suppress(*FAULTS):  # the verdicts say so
                traced = self.evaluation.real_lens
                return None if traced is None else traced.x_ml_max_mm
        return None

    def lens_words(self, traced: str) -> str:
        """Lens that numbers are of, in few words, `traced` once a real one has been; empty of an ideal one."""
        if self.real is self.design:
            return ""
        return "thin lens; tracing ..." if self.provisional else traced

    @cached_property
    def place(self) -> tuple[float, float]:
        """Place of the microlens that is shown [mm]."""
        place = place_on_mla(self.design, self.look.place)
        return nearest_microlens(self.design, place, inward=isinstance(self.look.place, str))


def front(run: OptimiseResult, size: Point = (420, 300)) -> Picture:
    """Draw designs of which none is better in both goals of a run.

    Raises
    ------
    ValueError
        No second goal was asked for.
    """
    if run.against is None:
        raise ValueError("no front: the run was asked for one goal alone")
    goals = run.goal, run.against
    labels = [f"{goal.words} [{goal.unit}]" if goal.unit else goal.words for goal in goals]
    points = np.array(run.front, float).reshape(-1, 2)
    title = f"What {goals[0].label} costs of {goals[1].label}: {len(points)} designs"
    return goal_front(points, labels, title=title, size=size, also=(run.after,))


def _section(design: Design, whole: str, size: Size) -> Picture:
    """Section in the extent that is asked for; to scale, folded where the axis is, where it is asked for so."""
    if whole == "folded":
        return scale_drawing(design, min(size[0], max(FOLDED * size[1], LEAST)))
    return meridional(design, size, **WHOLE[whole])


class _Drawing(NamedTuple):
    """Drawing of the page."""

    tab: str
    """View that shows it."""
    label: str
    """Heading of the drawing."""
    size: Size
    """[px], until the browser tells how much room there is."""
    inputs: Callable[[PictureSource], tuple[Any, ...] | None]
    """Values that the drawing depends on, besides its size: equal inputs, equal picture; None where there is none."""
    make: Callable[..., Picture]
    """Takes the inputs, then the size."""
    run: str = ""
    """Kind of run among whose results it stands; empty of a drawing of the design itself."""
    traced: bool = False
    """Whether it is of a real lens's rays, once they are traced."""


def _rows(make: Callable[[Any, Size], Picture]) -> Callable[[Any, Size], Picture]:
    """Drawing of rows as high as they are, whatever room there is."""
    return lambda part, size: make(part, (size[0], 0))


def _of(
    run: str,
    label: str,
    size: Size,
    make: Callable[..., Picture],
    part: Callable[[Any], Any] = lambda result: result,
    tab: str = "",
) -> _Drawing:
    """Drawing of a run's result, or of a part of it; in the view of that name, unless another is given."""

    def inputs(source: PictureSource) -> tuple[Any] | None:
        value = part(source.runs[run]) if run in source.runs else None
        return None if value is None else (value,)

    return _Drawing(tab or run, label, size, inputs, make, run)


DRAWINGS = {
    "meridional": _Drawing(
        "camera", "Meridional section", (1040, 240), lambda s: (s.design, s.look.whole),
        lambda design, whole, size: _section(design, whole, size),
    ),
    "microlens": _Drawing(
        "camera", "Image of a microlens", (340, 330),
        lambda s: (s.design, s.place, s.look.diffraction, s.look.pixels),
        lambda design, place, waves, pixels, size: microlens_image(
            design, place, size, waves=waves, pixels=pixels
        ),
    ),
    "mla-map": _Drawing(
        "camera", "Microlens array", (340, 330), lambda s: (s.design, s.place, s.traced_to),
        lambda design, place, traced_to, size: mla_map(design, place, size, traced_to=traced_to),
    ),
    "matching-plane": _Drawing(
        "camera", "FAP diameter and distance", (340, 330), lambda s: (s.design, s.limits),
        lambda design, limits, size: matching_plane(design, size, limits=limits),
    ),
    "depth": _Drawing("depth", "Depth, expected, over distance", (520, 360), lambda s: (s.real,), depth_precision),
    "depth-field": _Drawing(
        "depth", "Depth, expected, over the field", (520, 360), lambda s: (s.real,), depth_over_field
    ),
    "effects": _Drawing(
        "depth", "Effects against their budgets", (520, 420), lambda s: (s.evaluation.effects,),
        lambda effects, size: effects_budget(effects, (size[0], math.inf)), traced=True,
    ),
    "measured-profile": _of("measure", "Depth measured along a row", (520, 440), profile, tab="depth"),
    "measured-errors": _of("measure", "Errors of the depths measured", (520, 440), normalised, tab="depth"),
    "yield": _of("tolerance", "Yield of each grade", (420, 200), _rows(yield_bars)),
    "yield-curve": _of("tolerance", "Yield over a common factor on all tolerances", (420, 260), yield_curve),
    "offenders": _of(
        "tolerance", "Worst offenders, each alone", (560, 300), _rows(offender_bars), lambda r: r.offenders
    ),
    "spreads": _of("tolerance", "Scatter of the limited numbers", (560, 300), _rows(spread_bars), lambda r: r.spreads),
    "changes": _of(
        "optimise", "What changed, between its bounds", (560, 240), _rows(change_bars), lambda r: r.changes
    ),
    "search": _of(
        "optimise", "Where the searches ended", (420, 260), search_history,
        lambda r: r.ends if ends_differ(r.ends) else None,
    ),
    "front": _of("optimise", "Goal against goal", (420, 300), front, lambda r: r if len(r.front) > 1 else None),
}  # fmt: skip
"""Drawings by the name that addresses and the page use; those of the camera's view have their places in `page.html`,
others stand where it has the cards of their view or kind of run."""


def with_cards(template: str) -> str:
    """Template of the page with the cards of each view and kind of run where it says so, one for each drawing."""

    def card(name: str, drawing: _Drawing) -> str:
        picture = f"picture_{name.replace('-', '_')}"
        shown = f'v-show="{picture}"' if drawing.run else ':lens="lens_name"' + ' :words="rays_of"' * drawing.traced
        drawn = f'<rx-picture name="{name}" :svg="{picture}"></rx-picture>'
        return f'<rx-card name="{name}" label="{escape(drawing.label)}" {shown}>{drawn}</rx-card>'

    def cards(match: re.Match[str]) -> str:
        return "\n".join(card(name, one) for name, one in DRAWINGS.items() if (one.run or one.tab) == match[1])

    return re.sub(r"<!-- cards: (\w+) -->", cards, template)


def fitting(size: Any, fallback: Size) -> Size:
    """A size that the browser tells, kept within reason."""
    try:
        width, height = (round(float(value)) for value in size)
    except (TypeError, ValueError, OverflowError):
        return fallback
    return min(max(width, LEAST), MOST), min(max(height, LEAST), MOST)


def header(history: History) -> dict[str, Any]:
    """Name of the design, what went wrong with a file or link, and whether one can go back or forward."""
    design = history.present.design
    return {
        "title": design.name,
        "source": design.source,
        "message": history.present.message,
        "can_undo": bool(history.past),
        "can_redo": bool(history.future),
        "folds": bool(Camera.of(design).chain.folds),
        "lens_name": design.main_lens.kind.name,
    }


def controls(state: State) -> dict[str, Any]:
    """Every field with its slider, by part of the camera."""
    groups: dict[str, list[dict[str, Any]]] = {}
    for number in (*FIELDS, TEMPERATURE, *WINDOW):
        if number not in WINDOW or window_of(state.design) is not None:
            groups.setdefault(number.group, []).append(_control(number, state))
    listed = [{"name": name, "fields": fields} for name, fields in groups.items() if name != WINDOW[0].group]
    lit = [{"name": name, "fields": [_control(f, state) for f in LIGHT if f.group == name]} for name in LIGHT_GROUPS]
    bore = {**_bore(state), "fields": groups.get(WINDOW[0].group, [])}
    # What pictures and answers are told at, where that is not what lengths are typed at.
    holds = at_room(state.design)[1].strip()
    return {"groups": listed, "bore": bore, "light_groups": lit, "holds": holds}


def _bore(state: State) -> dict[str, Any]:
    """Values of the bore's controls: the scene's medium, the window at the tip and its material."""
    medium, k = state.design.object_space.medium, window_of(state.design)
    faults = {what: state.fault(what) for what in ("medium", "window", "window_material", "mapping")}
    objective = objective_of(state.design)
    mapping = None if objective is None else state.design.elements[objective].mapping  # type: ignore[union-attr]
    material = "" if k is None else _material_text(state.design.elements[k].material)  # type: ignore[union-attr, arg-type]
    wrong = faults["window_material"]
    return {
        "media": list(MEDIA),
        "medium": medium.name if medium.name in MEDIA else "index",
        "index": "" if medium.name in MEDIA else f"{float(medium.index(state.design.wavelength)):.5g}",
        "window": k is not None,
        "mapping": "" if mapping is None else mapping if isinstance(mapping, str) else "table",
        "mappings": [*NAMES, *([] if mapping is None or isinstance(mapping, str) else ["table"])],
        "materials": list(GLASSES),
        "material": material if wrong is None else wrong.text,
        **{f"{what}_fault": "" if fault is None else fault.message for what, fault in faults.items()},
    }


def _material_text(glass: Glass) -> str:
    return f"{glass.coefficients[0]:g}" if glass.formula in ("constant", "abbe") else glass.name


def _control(number: NumberField, state: State) -> dict[str, Any]:
    symbol = number.symbol
    shown = state.shown_by(symbol)
    known, ends = value_of(shown, symbol), reach(number, state.reference, shown)
    text, fault = "" if known is None else show(number, known), state.fault(symbol)
    letter, _, index = ("λ" if symbol == "wavelength" else symbol if symbol in BY_SYMBOL else "").partition("_")
    follows, changeable = state.follows == symbol, state.changeable(symbol)
    return {
        "symbol": symbol,
        "markup": f"<i>{letter}</i><sub>{index}</sub>" if index else f"<i>{letter}</i>" if letter else "",
        "name": number.name,
        "spoken": number.name
        if symbol not in BY_SYMBOL
        else f"{number.name}, {'lambda' if symbol == 'wavelength' else symbol.replace('_', ' ')}",
        "text": text if fault is None else fault.text,
        "fault": "" if fault is None else fault.message,
        "position": STEPS if known is None else position(number, known, ends),
        "steps": STEPS,
        "shown": text,
        "open": changeable,
        "follows": follows,
        "can_follow": symbol in state.followers,
        "left_out": number.left_out,
        "given": text not in ("", number.left_out),
        "why": "follows from the other two" if follows else "" if changeable else _why_shut(symbol),
    }


def _why_shut(symbol: str) -> str:
    if symbol.startswith("light."):
        return "the design gives the scene's radiance"
    return "the texture has one period" if symbol == "depth.finest" else "given by the lens"


TITLES = {
    "pupil_imaged": "microlenses",
    "f_number_matched": "f-number",
    "field_undistorted": "field",
    "views_resolved": "views",
    "thin_lens_holds": "thin lens",
    "corner_lit": "corner light",
    "sharp_over_field": "corner detail",
    "lens_speed": "lens speed",
    "microlens_speed": "array speed",
    "clear_aperture": "clear aperture",
}
LEVELS = {"good": "good", "limit": "a limit to know", "fault": "fault"}
"""Words for those who do not see a light's colour."""

TRACING = {
    "name": "tracing",
    "level": "wait",
    "word": "not yet known",
    "title": "real lens",
    "margin": "tracing ...",
    "text": "The verdicts are those of the thin-lens model; rays are being traced through the real lens.",
    "plain": "tracing rays through the real lens",
    "remedy": "",
}
"""Stands among the lights until the lens has been traced."""


def awaited(design: Design) -> str:
    """Sentence on what is awaited of a real lens and what is seen meanwhile; empty of an ideal one."""
    if not design.main_lens.kind.mounted:
        return ""
    return (
        f"Tracing rays through {design.main_lens.kind.name}: some seconds, the first time on a machine about a minute "
        "more. Until then pictures, numbers and grey verdicts are those of its thin-lens model."
    )


def unknown(what: str, why: str) -> dict[str, str]:
    """The light of verdicts that cannot be found."""
    words = f"{what} cannot be found: {why}"
    light = {"name": "unknown", "level": "fault", "word": LEVELS["fault"], "title": "verdicts", "margin": "unknown"}
    return {**light, "text": to_html(words), "plain": words, "remedy": ""}


def awaited_lights(design: Design) -> list[dict[str, str]]:
    """Lights of the verdicts that a camera will have, before any is known, in the room that these will take."""
    named = {
        "required": "required" * bool(design.required),
        **{name: TITLES[name] for name in ("f_number_matched", "field_undistorted", "views_resolved")},
        "thin_lens_holds": TITLES["thin_lens_holds"] * bool(design.main_lens.kind.mounted),
        "corner_lit": TITLES["corner_lit"],
        "fits_tube": "fits tube" * (design.tube is not None),
    }
    words = {"margin": "computing ...", "text": "Not computed yet.", "plain": "computing"}
    return [{**TRACING, **words, "name": name, "title": title} for name, title in named.items() if title]


def shown_lights(source: PictureSource) -> list[dict[str, str]]:
    """The verdicts as lights; those of the thin-lens model without colour, as long as a real lens is not traced."""
    found = lights(source.evaluation)
    waits = {"level": TRACING["level"], "word": TRACING["word"]}
    return [*({**light, **waits} for light in found), TRACING] if source.provisional else found


def lights(evaluation: Evaluation) -> list[dict[str, str]]:
    """The verdicts as lights: a colour, a few words, a number, the sentence behind it; the required are one."""
    required = [one.verdict for one in evaluation.required]
    others = [verdict for verdict in evaluation.verdicts if verdict not in required]
    asked = [_asked(evaluation.required)] if required else []
    told = [_light([verdict], **_named(evaluation, verdict)) for verdict in others]
    first = next((k for k, verdict in enumerate(evaluation.verdicts) if verdict in required), 0)
    return [*told[:first], *asked, *told[first:]]


def _light(verdicts: Sequence[Verdict], **words: str) -> dict[str, str]:
    """One light for verdicts: the colour of the worst, and all their sentences and remedies behind it."""
    worst = max(verdicts, key=lambda verdict: tuple(LEVELS).index(verdict.level))
    said = (f'<p class="said {verdict.level}">{to_html(verdict.text)}</p>' for verdict in verdicts)
    return {
        "name": worst.name,
        "level": worst.level,
        "word": LEVELS[worst.level],
        "text": "".join(said),
        "plain": "\n".join(verdict.text for verdict in verdicts),
        "remedy": to_html("; ".join(dict.fromkeys(verdict.remedy for verdict in verdicts if verdict.remedy))),
        **words,
    }


def _asked(required: Sequence[Requirement]) -> dict[str, str]:
    """Light of what is required: of one its value and limit, of several how many are met, and the first missed."""
    labels = [re.sub(r", \w+_\w+", "", one.label) for one in required]  # symbols stand in the sentence behind
    if len(required) == 1:
        value = "none" if required[0].told is None else short(required[0].told, 4)
        symbol = "u " if required[0].expanded(1.0) else ""
        return _light([required[0].verdict], title=labels[0], margin=f"{symbol}{value} of {required[0].limits}")
    missed = [label for label, one in zip(labels, required, strict=True) if not (one.met or one.untold)]
    only = [one.only for one in required if one.met and one.only]
    margin = f"{sum(one.met for one in required)} of {len(required)} met"
    margin += f", {len(only)} {only[0] if len(set(only)) == 1 else 'with a reservation'}" if only else ""
    unknown = sum(one.untold for one in required)
    margin += f", {unknown} not known" * (unknown > 0)
    if missed:
        margin += f"; missed: {missed[0]}" + f" and {len(missed) - 1} more" * (len(missed) > 1)
    return _light([one.verdict for one in required], title="required", margin=margin, name="required")


def _named(evaluation: Evaluation, verdict: Verdict) -> dict[str, str]:
    """Title and margin of one of the verdicts that every camera has."""
    title = TITLES.get(verdict.name, verdict.name.replace("_", " "))
    return {"title": title.replace("corner", _outermost(evaluation)), "margin": _margin(evaluation, verdict)}


def _outermost(evaluation: Evaluation) -> str:
    """Word for where the field ends that is judged."""
    return "rim" if evaluation.answer.outermost == RIM else "corner"


def _margin(evaluation: Evaluation, verdict: Verdict) -> str:
    """How far a verdict is from its limit, in at most 14 letters."""
    lens, name = evaluation.real_lens, verdict.name
    if name == "pupil_imaged":
        return "focused (2.0)"
    if name == "f_number_matched":
        return f"{_signed(evaluation.f_number.mismatch_px)} px"
    if name == "field_undistorted" and lens is not None:
        return f"to {short(lens.x_ml_max_mm, 2)} mm"
    if name == "field_undistorted":
        return f"{_signed(evaluation.non_distortion.room_at_corner_mm)} mm"
    if name == "views_resolved":
        sampling = evaluation.sampling
        apart, across = sampling.views_independent, f"{short(sampling.views_geometric, 2)} px"
        return f"all {across}" if apart >= sampling.views_geometric else f"{short(apart, 2)} in {across}"
    if name == "fits_tube":
        word = "needs" if verdict.level == "fault" else "fits"
        return f"{word} {short(evaluation.answer.insertion_diameter_mm, 3)} mm"
    if name == "corner_lit":
        return f"{100 * evaluation.answer.corner_light:.3g} %"
    if name == "sharp_over_field":
        return f"{short(evaluation.answer.corner_lp_per_mm or 0.0, 2)} lp/mm"
    if name == "lens_speed":
        return f"f/{short(evaluation.f_number.main_lens, 3)}"
    if name == "clear_aperture":
        return "not guaranteed"
    if name == "microlens_speed":
        return f"f/{short(evaluation.f_number.microlens_lens, 3)}"
    if lens is None or name != "thin_lens_holds":
        return ""
    image = farthest_off(lens)
    return "no image" if image is None else f"{short(image[0], 2)} px"


def _signed(value: float) -> str:
    return f"{'+' if value > 0 else ''}{short(value, 2)}"


def depth_unknown(why: str) -> dict[str, Any]:
    """Values in the form of `depth_known`, where no depth can be computed."""
    return {"tone": "bad", "text": to_html(f"Depth is unknown: {why}"), "remedy": "", "rows": []}


def depth_known(source: PictureSource) -> dict[str, Any]:
    """How well depth is known, where and why not; and what light, texture and matching that is for."""
    if source.evaluation.focused is not None:
        return depth_unknown("the microlenses are focused on the scene, not on the pupil, and pixels are no views.")
    if not source.evaluation.has_views:
        return depth_unknown("too few pixels lie across a microlens image to be views.")
    depth, curve = source.evaluation.depth, field_curve(source.real)
    design, assumed, outermost = source.design, depth.assumes, _outermost(source.evaluation)
    sigma, rows = depth.sigma_z_mm, _assumed_rows(source.evaluation)
    if not math.isfinite(sigma):
        full = assumed is not None and assumed.electrons > design.sensor.full_well
        why = "No texture that single views can show gives depth."
        remedy = "detail of more than two microlenses, or more contrast"
        if full:
            why, remedy = "Pixels hold fewer electrons than so much light makes.", "a shorter exposure, or less light"
        elif assumed is not None and not assumed.electrons > 0:
            why, remedy = "There is no light.", "a longer exposure"
        return {"tone": "bad", "text": f"Depth is unknown. {why}", "remedy": remedy, "rows": rows}
    known = curve.sigma[0] * KNOWN_ALIKE
    alike, last = curve.sigma <= known, curve.place[-1]
    budget = source.evaluation.depth_budget
    ahead = source.evaluation.answer.working_distance_mm
    share = f"{100 * float(budget.expanded_mm) / ahead:.2g} % of the {short(ahead, 4)} mm from the tip"
    noise = "Noise (bound)" if assumed is not None else noise_words(True).capitalize()
    text = (
        f"Depth, expected, lengths {budget.lengths}, in the plane in focus: {budget.words}, {share}. "
        f"{to_html(sentence(source.evaluation.answer.uncounted()))} {noise}: {short(sigma, 3)} mm."
    )
    tone, remedy = "good", ""
    if not alike.all():
        ends = curve.place[~alike][0]
        causes, remedy = _falls(source.evaluation)
        what = "noise" if assumed is None else "bound"
        text += f" The {what} holds out to {short(ends, 3)} of {short(last, 3)} mm on the array; beyond, {causes}"
        unknown = not math.isfinite(curve.sigma[-1])
        text += f", to {'nothing' if unknown else short(curve.sigma[-1], 3) + ' mm'} at the {outermost}."
        tone = "caution"
    if source.real is not design and any(v.name == "sharp_over_field" for v in source.evaluation.verdicts):
        there = short(source.evaluation.answer.corner_lp_per_mm or 0.0, 2)
        text += (
            f" Off the axis that is the thin lens's: the real one is not sharp there, {there} lp/mm at the {outermost}."
        )
        tone = "caution"
    if assumed is not None and budget.largest.name != NOISE:
        text += f" More light hardly helps: {budget.largest.name} rules."
        if budget.largest.name == WARMTH:
            remedy = clauses(COOLER, remedy and f"at the {outermost} {remedy}")
    elif assumed is not None:
        dark = design.sensor.read_noise**2 / max(assumed.electrons, 1e-300)
        text += " Twice the contrast halves it; " + (
            "twice the light nearly does too: read noise rules." if dark > 1 else "so does four times the light."
        )
    return {"tone": tone, "text": text, "remedy": remedy, "rows": rows}


def _falls(evaluation: Evaluation) -> tuple[str, str]:
    """Causes of poorer depth at the field's corner, the largest first, and what helps against that one."""
    kept, slant = evaluation.fields[-1].kept_fraction, evaluation.answer.corner_slant
    slanted = f"light falls with the field's angle ({100 * slant:.3g} % left)"
    causes = sorted((
        (kept, "stops cut images", "a wider lens or stops, a smaller pupil, or another d_3"),
        (slant, slanted, evaluation.answer.corner_evened_by or "more light, or a longer exposure"),
    ))  # fmt: skip
    # Of two the smaller is told where it takes a quarter of what the larger does.
    told = [words for left, words, _ in causes if 1 - left > max(0.25 * (1 - causes[0][0]), 0.01)]
    return listed(told or ["images shrink"]), causes[0][2] if told else "another d_3"


def _assumed_rows(evaluation: Evaluation) -> list[dict[str, str]]:
    parts = [
        (f"from {term.name}", f"{short(float(term.u_mm), 3)} mm", term.remark)
        for term in evaluation.depth_budget.terms
        if term.u_mm is not None
    ]
    return [
        {"label": to_html(label), "value": ", ".join(part for part in (value, note) if part)}
        for label, value, note in (*depth_facts(evaluation), *parts)
    ]


def glance(evaluation: Evaluation) -> list[dict[str, str]]:
    """Main numbers of a camera at a glance."""
    views = evaluation.has_views
    first = [QUANTITIES[name] for name in GLANCE if views or not QUANTITIES[name].of_views]
    rows = {name: value for name, value, _ in evaluation.answer.rows}
    budget = evaluation.depth_budget
    rows |= {f"depth, expected, lengths {budget.lengths}": budget.words} if views else {}
    rows |= {quantity.label: quantity.text(evaluation.value(quantity)) for quantity in first}
    if (lens := evaluation.real_lens) is not None:
        rows[QUANTITIES["undistorted_field_mm"].label] = f"{short(lens.x0_max_mm, 5)} mm"
        rows[QUANTITIES["field_half_width_mm"].label] = f"{short(evaluation.answer.at[0].width_mm / 2, 5)} mm"
    for name, share in evaluation.fields[-1].ray_budget.taken():
        landed = {"own cell": "in its own cell", "neighbours": "in its neighbours"}.get(name)
        if landed or share > 0:
            rows[f"light at the {_outermost(evaluation)} {landed or f'lost at {the(name)}'}"] = percent(share, 1)
    return [{"label": to_html(label), "value": value} for label, value in rows.items()]


def warmth(evaluation: Evaluation) -> str:
    """Where the camera is in focus at the temperatures that it meets, in a sentence; empty where none is told."""
    if (warm := evaluation.temperature) is None or len(warm.at) < 2:
        return ""
    shifts = (f"{decimals(row.focus_shift_pitches, 3, '+')} pitches" if row.fits else "no camera" for row in warm.at)
    planes = [
        f"{row.focal_plane_mm:.6g} mm at {row.temperature_degc:g} °C ({shift})"
        for row, shift in zip(warm.at, shifts, strict=True)
    ]
    still = f" No material is named of {listed(list(warm.not_named))}: nothing there changes." if warm.not_named else ""
    return to_html(f"Left as it was focused, in a {warm.held}, d_f is {listed(planes)}.{still}")


def looked_at(state: State, look: Look) -> dict[str, Any]:
    """View of the design, and the link that brings all of it back."""
    place = look.place if isinstance(look.place, str) else "chosen"
    return {**asdict(look), "place": place, "link": encode(state, look)}
