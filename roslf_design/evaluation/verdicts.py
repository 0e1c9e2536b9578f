"""The questions an engineer asks first, answered with their margins and what would mend them; warnings, hard cases."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .._arrays import product
from ..bore.part import TEMPERATURE
from ..camera import TEMPERATURES, Camera
from ..theory import field_of_view, tube
from ..theory.colours import PIXEL_FILTERS
from ..theory.f_number import TOUCHING_PX, fill_factor, matched
from ..theory.focused import LEAST_VIEWS, FocusedArray, filtered_views, pupil_remedy
from ..theory.light import sensor_field
from ..theory.quantities import image_rate
from ..theory.quantity import FEASIBLE
from ..theory.stop_images import MicrolensImages
from ..traced.fields import IdealImages, images_of
from ..words import clauses, length, listed, number, on_side, percent, place, the
from .answer import STOP, FirstAnswer
from .field_images import RIM, FieldImages
from .fields import Place
from .groups import Numbers, RealLens, Verdict
from .remedies import GAP_SLACK, OVERLAP_SLACK, SLACK_PX, ways_of
from .resolved import resolved
from .stations import ASKED

TURN_GAIN = 0.05
"""Share by which the undistorted field must grow for turning a lens round to be a remedy."""
NEIGHBOURS = 3.0
"""Microlenses across, so that one has a neighbour on either side, without which nothing is matched."""
EVEN = math.sqrt(STOP)
"""Share of the middle's light, half a stop less, from which the corner is evenly lit."""
DIM = 0.2
"""Share of the middle's light, more than two stops less, from which the corner is not too dark."""
CUT = 0.8
"""Part of its images below which cuts, not the field's angle, are what darkens the corner."""
FLAT_FIELD = "a flat-field correction of pictures evens it"
"""Remedy of a corner that is less than a stop darker."""
UNCUT, CUT_IN_IT = "microlens images uncut over the field", "microlens images cut in the field"
"""The paper's undistorted field, or not, in words that no picture's distortion is taken for."""
SHARP = 0.5
"""Part of the middle's detail that the corner of the field shows from which sharpness holds over the field."""

GAIN, REFOCUSED = 1.05, 3
"""Times the detail from which a real lens's best focus is told, and steps by which it is looked for."""


def verdicts_of(
    camera: Camera,
    f_number: Numbers,
    non_distortion: Numbers,
    sampling: Numbers,
    lens: RealLens | None = None,
    focused: FocusedArray | None = None,
    answer: FirstAnswer | None = None,
    asked: Sequence[Verdict] = (),
) -> tuple[Verdict, ...]:
    """Answer whether the f-number is matched, the field undistorted, the corner lit, the pixels worth having and so on.

    With a real lens the field is judged by the traced images, and whether the thin lens holds is a question of its own.
    Of focused microlenses that comes before these, with what it means, and no views are judged. What is `asked` stands
    before all of them, but for pixels that make no light-field camera; then what no tube holds.
    """
    thin, traced = ([], "") if lens is None else ([_thin(f_number, lens)], _traced_fill(f_number, lens))
    answers = [_matched(camera, f_number, traced), _undistorted(camera, non_distortion, lens, answer)]
    fits = [_fits(camera)] if tube.OUTER in camera.numbers else []
    if any(verdict.level == "fault" for verdict in fits):
        asked, fits = [*asked, *fits], []
    first = _resolved(camera, sampling) if focused is None else _focused(camera, focused)
    if first.level == "fault" and focused is None:
        answers = [first, *asked, *answers]
    else:
        answers = [*asked, *answers, first] if focused is None else [*asked, first, *answers]
    answers += thin
    answers += [] if answer is None else [lit(answer)]
    return (*_collisions(camera), *answers, *fits, *_reversed(camera))


def _collisions(camera: Camera) -> tuple[Verdict, ...]:
    """Whether parts stand in each other at temperatures where the camera is used; nothing where they do not."""
    ends = [camera.numbers[place] for place in TEMPERATURES[:2] if place in camera.numbers]
    used = [("", camera), *((f" at {end:g} °C", camera.replace({TEMPERATURE: end})) for end in ends)]
    short = dict[str, tuple[str, float]]()
    for there, one in used:
        for words, room in one.rooms():
            if not room >= 0:
                short.setdefault(words, (there, -float(room)))
    if not short:
        return ()
    told = [f"{words} by {number(by, 3)} mm{there}" for words, (there, by) in short.items()]
    remedy = "move them apart by as much" + ", or make a leaning mirror smaller" * bool(camera.chain.folding)
    return (Verdict.of("parts_clear", f"cannot be put together: {listed(told)}", remedy),)


def _reversed(camera: Camera) -> tuple[Verdict, ...]:
    """Whether pictures are reversed; nothing where they are not."""
    parts = [part for part in camera.in_bore if part.element.reverses]
    if len(parts) % 2 == 0:
        return ()
    across, up = np.abs(camera.chain.mirrored)
    ways = "left and right" if across >= up else "top and bottom"
    count = sum(part.element.bounces for part in parts)
    by = "one reflection" if count == 1 else f"{count} reflections, an odd number"
    text = f"picture is reversed, {ways}, by {by}: {listed([part.name for part in parts])}"
    return (Verdict("picture_reversed", False, "limit", text, "turn it round where it is shown"),)


def as_sharp(there: float | None, middle: float | None) -> bool:
    """Whether detail somewhere in the field is about that in its middle; also where the middle shows none [lp/mm]."""
    return middle is None or (there or 0.0) >= SHARP * middle


def sharp_over_field(answer: FirstAnswer, lens: RealLens | None) -> tuple[Verdict, ...]:
    """Whether a refocused image is much coarser in the corner of the field; nothing where it is not."""
    middle, corner = answer.at[0].usable_lp_per_mm, answer.corner_lp_per_mm
    if as_sharp(corner, middle):
        return ()
    there, here = ("nothing" if detail is None else f"{number(detail, 3)} lp/mm" for detail in (corner, middle))
    through = f" (traced through {lens.lens})" if lens else ""
    text = (
        f"not sharp over the field: in focus a refocused image shows {here} in the middle and "
        f"{there} {answer.outer_words}{through}; Nyquist frequency and MTF as required are the middle's"
    )
    remedy = (
        "a better corrected lens, a smaller FAP or a smaller sensor; `roslf datasheet` has the edge of the field, and "
        'what single views keep; studies hold it by quantity = "spot_pitches" with a field'
    )
    return (Verdict("sharp_over_field", False, "limit", text, remedy),)


def best_focus(shown: FieldImages) -> tuple[Verdict, ...]:
    """Where a real lens is sharpest, and the focal plane that brings it there; nothing where detail gains little."""
    design, images, lens = shown.design, shown.images, shown.design.main_lens.kind
    if isinstance(images, IdealImages):
        return ()
    camera = images.camera
    focus = sharpest = float(field_of_view.focus_ahead(camera))
    step = focus / 100
    steep = float(image_rate(camera, focus + step)) / step
    for _ in range(REFOCUSED):
        sharpest -= images.transfer(0, sharpest).rate / steep
        if not 0 < sharpest < 2 * focus:
            return ()
    plane = float(f"{design.d_f + focus - sharpest:.4g}")
    now, then = (
        resolved(one, 0, (ASKED, focus), "refocused").usable_lp_per_mm or 0.0
        for one in (images, images_of(design.replace(d_f=plane), [(0.0, 0.0)]))
    )
    if then < GAIN * now:
        return ()
    text = (
        f"best focus of {lens.name} is not its first-order one: the array is in focus {number(focus, 4)} mm ahead of "
        f"the tip to first order, and sharpest at {number(sharpest, 4)} mm"
    )
    remedy = (
        f'focal_plane = "{plane:g} mm" of [main_lens] brings it to {number(focus, 4)} mm, where a refocused image then '
        f"shows {number(then, 3)} lp/mm for {number(now, 3)}"
    )
    return (Verdict("best_focus", False, "limit", text, remedy),)


def _focused(camera: Camera, array: FocusedArray) -> Verdict:
    """Answer on what focused microlenses are focused on, and what that means."""
    blurs = listed([*dict.fromkeys(number(blur, 3) for blur in array.pupil_blur_px)])
    blurred = f"blur over {blurs} px where pixels and diffraction blur {array.own_blur_px:.3g} px"
    remedy = (
        "pixels are no views: numbers of views, depth from views and their resolution do not apply and are left out; "
        f"f-number match (of images' half-lit width), field, light and pictures hold; {pupil_remedy(camera)}"
    )
    seen = [plane for plane in array.in_focus if 0 < plane.ahead_mm < math.inf]
    if not seen:
        text = f"microlenses out of focus: they image nothing ahead of the tip, and the pupil they {blurred}"
        return Verdict.of("pupil_imaged", text, remedy)
    best = max(seen, key=lambda plane: plane.resolution_ratio)
    planes, depths = (
        listed([number(abs(value), 4) for value in values])
        for values in ([plane.ahead_mm for plane in seen], [plane.virtual_depth for plane in seen])
    )
    text = (
        f"focused (plenoptic 2.0) camera: its microlenses are focused on {planes} mm ahead of the tip (virtual depth "
        f"{depths}, {'Keplerian' if best.virtual_depth > 0 else 'Galilean'}), not on the pupil, which they {blurred}; "
        f"effective resolution up to {best.resolution_ratio:.3g} of the sensor's pixels along each axis, "
        f"{best.seen_by:.3g} microlenses across see a point (2 at least for depth)"
    )
    return Verdict("pupil_imaged", False, "limit", text, remedy)


def _traced_fill(f: Numbers, lens: RealLens) -> str:
    """Image fill through a real lens at the first field, beside its thin-lens model's; empty where none is whole."""
    fields = [field for field in lens.fields[:1] if field.widening_percent is not None]
    return "".join(
        f" (thin-lens model; traced through {lens.lens} at {place(field.x_ml_mm, 4)} mm: "
        f"{f.fill_factor * (1 + (field.widening_percent or 0.0) / 100):.4g})"
        for field in fields
    )


def _matched(camera: Camera, f: Numbers, traced: str) -> Verdict:
    """By closed forms; `traced` is what rays through a real lens say beside them."""
    kind = "overlap by" if f.mismatch_px > 0 else "leave gaps of"
    images = f"images {kind} {abs(f.mismatch_px):.3g} px" if abs(f.mismatch_px) >= TOUCHING_PX else "images just touch"
    sampled = filtered_views(camera) >= LEAST_VIEWS
    within = -GAP_SLACK <= f.fill_factor - 1 <= OVERLAP_SLACK
    if not sampled:
        images = "which no pixels show"
    else:
        images += traced
    if within and not sampled:
        text = f"f-number match means nothing yet: image fill {f.fill_factor:.5g}, {images}"
        return Verdict("f_number_matched", False, "limit", text, "mend the pixels first")
    if within or (abs(f.mismatch_px) <= SLACK_PX and sampled):
        return Verdict.of("f_number_matched", f"f-number matched: image fill {f.fill_factor:.5g}, {images}")
    text = (
        f"f-number not matched: microlens f/{f.microlens:.4g} against pupil f/{f.pupil:.4g}, image fill "
        f"{f.fill_factor:.4g}, {images}"
    )
    ways = {"d_2": matched(camera, "d_2"), "D_F": matched(camera, "D_F"), "d_3": matched(camera, "d_3")}
    values = {symbol: float(way.value) for symbol, way in ways.items() if way.exists}
    lengths = ways_of(camera, values, lambda changed: fill_factor(changed) <= 1 + FEASIBLE)
    remedy = f"any one of these matches it exactly: {', '.join(lengths)}"
    none = "no single change of d_2, D_F or d_3 that fits the bore matches it; change the microlens pitch or the focus"
    return Verdict.of("f_number_matched", text, remedy if lengths else none)


def _undistorted(camera: Camera, thin: Numbers, lens: RealLens | None, answer: FirstAnswer | None) -> Verdict:
    """By Eq. 6; behind a real lens by its traced images, Eq. 6's bound beside it."""
    half, corner = thin.field_half_width_mm, thin.field_half_diagonal_mm
    if answer is not None and camera.lens.mounted and math.isfinite(answer.at[0].width_mm):
        half, corner = answer.at[0].width_mm / 2, answer.at[0].diagonal_mm / 2
    sees = f"the sensor sees {half:.4g} mm (half width), {corner:.4g} mm (corner)"
    if answer is not None and answer.sensor_field_of_view_deg is not None:
        sees = f"the field is lit over {answer.at[0].field}"
    if answer is not None and answer.outermost == RIM:
        sees = f"{sees}, and judged to the {RIM} that is required"
    sees += f". {_shifted(camera)}{_stopped(camera)}"
    cuts = (lens and lens.cut_by) or thin.cut_by
    by_thin = _field_remedy(camera, cuts) if cuts else ""
    off = any(np.any(value) for at, value in camera.numbers.items() if ".decentre." in at)
    worst = " in the worst direction" if off or camera.has_straight_sides else ""
    if lens is not None:
        bound = (
            f"measured through {lens.lens}, whole out to {lens.x_ml_max_mm:.4g} mm on the MLA "
            f"({lens.x0_max_mm:.4g} mm object radius; thin lens, Eq. 6: {lens.thin_x_ml_max_mm:.4g} mm)"
        )
        if lens.undistorted_in_field:
            return Verdict.of("field_undistorted", f"{UNCUT}: {bound}; {sees}")
        folded = [field.x_ml_mm for field in lens.fields if field.status == "folded"]
        places = ", ".join(f"{place(x_ml)} mm" for x_ml in folded)
        where = f", folded over (a caustic of the pupil) at {places}" if folded else ""
        if lens.folded_beyond_mm is not None:  # before any rim cuts them
            by_thin = ""
            bound = (
                f"{lens.lens} folds them over (a caustic of the pupil, by its aberrations) beyond about "
                f"{lens.folded_beyond_mm:.3g} mm on the MLA, before any rim cuts them, beyond "
                f"{lens.x_ml_max_mm:.4g} mm ({lens.x0_max_mm:.4g} mm object radius; "
                f"thin lens, Eq. 6: {lens.thin_x_ml_max_mm:.4g} mm)"
            )
        other = lens.turned_x_ml_max_mm
        own = lens.x_ml_max_mm if lens.folded_beyond_mm is None else lens.folded_beyond_mm
        wider = other is not None and other > own * (1 + TURN_GAIN)
        turned = f"the other way round the lens sees whole images out to {other:.4g} mm" if wider else ""
        ways = "a better corrected or wider lens, a FAP closer to it or a smaller sensor helps"
        text = f"{CUT_IN_IT}: {bound}{where}; {sees}"
        return Verdict.of("field_undistorted", text, clauses(*((by_thin, turned) if by_thin else (turned, ways))))
    if by_thin:
        on_array = f" ({thin.x_ml_max_mm:.4g} mm on the MLA)" if thin.cut_beyond_mm == thin.x0_max_mm else ""
        others = [f"{the(cut['rim'])} (beyond {cut['beyond_mm']:.4g} mm)" for cut in thin.cut_by[1:]]
        text = (
            f"{CUT_IN_IT}: cat's eyes beyond {thin.cut_beyond_mm:.4g} mm object radius{worst}{on_array}, cut by "
            f"{the(thin.limited_by)}{f', then by {listed(others)}' if others else ''}; {sees}"
        )
        return Verdict.of("field_undistorted", text, by_thin)
    bound = "at any field"
    leaning = thin.limited_by in [camera.rims[k].opening for k in camera.leaning]
    straight = camera.has_straight_sides and not camera.round_fields
    if (leaning or straight) and thin.x0_max_mm < thin.field_half_diagonal_mm * (1 - FEASIBLE):
        bound = (
            f"over all that the sensor sees; {the(thin.limited_by)}{', which leans,' * leaning} would cut beyond "
            f"{thin.x0_max_mm:.4g} mm object radius, but in directions that the sensor does not see so far"
        )
    elif math.isfinite(thin.x0_max_mm):
        bound = f"out to {thin.x0_max_mm:.4g} mm object radius{worst}, limited by {the(thin.limited_by)}"
    return Verdict.of("field_undistorted", f"{UNCUT}: full {camera.fap.outline.kind}s {bound}; {sees}")


def _stopped(camera: Camera) -> str:
    """Words on what else than the FAP is the stop in the middle, and which numbers know; empty where none is."""
    openings = MicrolensImages(camera, [(0.0, 0.0)]).openings.at((0, 0))
    if openings.unclipped:
        return ""
    rim = camera.rims[int(openings.rooms[1:].argmin())]
    return (
        f". Even in the middle {the(rim.name)} leaves {percent(float(openings.common().kept_fraction))} of an image. "
        "Light, depth and MTF are of that; image fill, f-numbers, views across an image and depths of field are the "
        "whole FAP's"
    )


def _shifted(camera: Camera) -> str:
    """Sentence on how far images lie beside their microlenses: no fault, and none where telecentric."""
    corner = float(sensor_field(camera).radius)
    shift = abs(corner * float(product(camera.seen.d_2, camera.seen.vergence)) / float(camera.q))
    if shift < SLACK_PX:
        return f"Images are shifted by less than {SLACK_PX:g} px there"
    by = " by the thin-lens model" if camera.lens.mounted else ""
    return f"Images are shifted by {number(shift, 3)} px there{by}, no fault once calibrated"


def lit(answer: FirstAnswer) -> Verdict:
    """Whether the field's corner is lit about as the middle."""
    name, light = "corner_lit", answer.corner_light
    share = f"the {answer.outermost} gets {100 * light:.3g} % of the middle's light"
    if EVEN <= light <= 1 / EVEN:
        return Verdict.of(name, f"evenly lit to half a stop: {share}")
    if light <= 0:
        return Verdict.of(name, f"the {answer.outermost} is dark", answer.corner_freed_by)
    stops = f"{abs(math.log2(light)):.2g}"
    stops += " stop" if stops == "1" else " stops"
    text = f"{share}, {stops} {'darker' if light < 1 else 'brighter'}: {answer.light_words}"
    noise = f"; noise there counts {light**-0.5:.2g} times as much" if light < 1 else ""
    ways = answer.corner_evened_by or FLAT_FIELD
    if light < CUT * answer.corner_slant:
        ways = answer.corner_freed_by
    if light > 1:
        ways = "a smaller sensor, or a lens that keeps the pupil's size over the field, evens it"
    return Verdict(name, False, "limit" if light >= DIM else "fault", text, f"{ways}{noise}")


def _fits(camera: Camera) -> Verdict:
    outer, wall = float(camera.cold[tube.OUTER]), float(tube.shell(camera))
    within = [
        (part, float(part.needs(camera)), float(tube.room(camera, part.place)))
        for part in tube.housed(camera)
        if part.inside(camera)
    ]
    wide = [(part, needed - room) for part, needed, room in within if needed > room * (1 + FEASIBLE)]
    walls = "a wall with its light guide" if tube.GUIDE in camera.numbers else "a wall"
    cone = tube.PROXIMAL in camera.numbers
    ends = [outer, float(tube.widest(camera))] if cone else [outer]
    across, left = (" to ".join(f"{end - less:.4g}" for end in ends) for less in (0.0, 2 * wall))
    holds = f"{across} mm outside and {walls} of {wall:.4g} mm leave {left} mm"
    uncounted = f" ({tube.uncounted(camera)})" if tube.uncounted(camera) else ""
    if not wide:
        (widest, _, room), unjudged = min(within, key=lambda one: one[2] - one[1]), tube.unjudged(camera)
        there = f" where it leaves {room:.4g} mm" * cone
        extreme = f"{'tightest' if cone else 'widest'} is {the(widest.name)}, {widest.sizes(camera)}{there}"
        ground = [
            f"; {part.name} counts as ground round: across the corners of a square block it is {float(corners):.4g} mm"
            for part, _, room in within
            if np.any((corners := part.corners) > room * (1 + FEASIBLE))
        ]
        text = f"{holds}; {extreme}{uncounted}{tube.unsaid_wall(camera)}{''.join(ground)}"
        if unjudged:
            text = f"fits inside the tube, but {unjudged}; {text}"
            return Verdict("fits_tube", False, "limit", text, "look at its drawing")
        return Verdict.of("fits_tube", f"fits inside the tube: {text}")
    parts = [
        f"{part.name} of {part.sizes(camera)} is {over:.4g} mm too wide"
        if part.aside is None
        else f"{part.name} lies {part.sizes(camera)}, of {float(tube.room(camera, part.place)) / 2 + wall:.4g} mm"
        for part, over in wide
    ]
    text = f"does not fit inside the tube: {listed(parts)}; {holds}{uncounted}"
    more = max(over for _, over in wide)
    wider = f"a tube of {' to '.join(on_side(end + more, True, 4) for end in ends)} mm outside"
    ways = f"smaller ones, or {wider}"
    seen = [2 * (float(half) + float(camera.d)) for half in sensor_field(camera).half]
    rooms = {part.name: room for part, _, room in within}
    if "microlens array" in [part.name for part, _ in wide] and math.hypot(*seen) <= rooms["microlens array"]:
        sides = ", ".join(f'"{on_side(side, True, 3)} mm"' for side in seen)
        ways = f"an array diced to all that the sensor sees, microlens_array.size = [{sides}], or {wider}"
        ways = f"smaller ones, {ways}" if wide[1:] else ways
    behind = {float(camera.cold.tip - part.place): part.name for part, _ in wide}
    if tube.LENGTH not in camera.numbers and (far := [ahead for ahead in behind if ahead > outer]):
        ways += f"; where it ends before {the(behind[min(far)])}, say so: [tube] length, below {number(min(far), 4)} mm"
    return Verdict.of("fits_tube", text, ways)


def _field_remedy(camera: Camera, cuts: Sequence[Mapping[str, Any]]) -> str:
    others, grow = "a smaller FAP or a smaller sensor", dict[str, float]()
    for cut in cuts:
        name = cut["rim"].partition(",")[0]  # of either face of an element
        grow[name] = max(grow.get(name, 0.0), 2 * abs(cut["clearance_mm"]))
    rooms = [(part, float(tube.room(camera, part.place))) for part in tube.housed(camera) if part.inside(camera)]
    if tight := [(part, room) for part, room in rooms if part.clear + grow.get(part.name, -math.inf) > room]:
        sizes = listed([f"{the(part.name)} {float(part.clear + grow[part.name]):.4g} mm" for part, _ in tight])
        left = " and ".join(dict.fromkeys(f"{room:.4g}" for _, room in tight))
        there = " there" * (tube.PROXIMAL in camera.numbers)
        return (
            f"the whole field takes {sizes} wide, and the tube leaves {left} mm{there}: {others}, or a wider tube, "
            "frees the field"
        )
    if [*grow] == ["main lens"]:
        wide = float(camera.cold.D) * (1 + grow["main lens"] / float(camera.D))
        sure = min((one.clear_aperture for one in camera.lens.prescribed if one.clear_aperture), default=math.inf)
        lens = "a main lens" if wide <= sure * (1 + FEASIBLE) else f"another main lens (this one's is {length(sure)}),"
        return (
            f"{lens} of {on_side(wide, True, 4)} mm clear aperture frees the whole field; "
            "a smaller FAP, a FAP closer to the lens or a smaller sensor helps too"
        )
    if any(cut["rim"].endswith("mapping") for cut in cuts):
        largest = math.degrees(camera.mapping.widest)
        return f"the objective images no farther than {largest:.4g} degrees in air; use a smaller sensor or FAP"
    wider = listed([f"{the(name)} by {on_side(by, True, 4)} mm" for name, by in grow.items()])
    return f"widen {wider}, or use {others}"


def _resolved(camera: Camera, sampling: Numbers) -> Verdict:
    """By pixels; behind a Bayer pattern by green ones, which lie farther apart."""
    views, independent = float(filtered_views(camera)), sampling.views_independent
    kind = PIXEL_FILTERS[camera.colours].pixels
    across = 2 * float(min(sensor_field(camera).half)) / float(camera.d)
    if across < NEIGHBOURS:
        text = f"no light-field camera: the sensor sees {across:.2g} microlenses across its shorter side"
        return Verdict.of("views_resolved", text, f"check microlens_array.pitch, {length(float(camera.d))}")
    if views < LEAST_VIEWS:
        pixel = 1e3 * float(camera.q)
        return Verdict.of(
            "views_resolved",
            f"no light-field camera: {views:.3g} {kind} across a microlens image, which take all its directions as one",
            f"check sensor.pixel: pixels are {pixel:.4g} um wide, a microlens image "
            f"{pixel * sampling.views_geometric:.4g} um; a fifth of that, or less, is usual",
        )
    if independent >= views:
        text = (
            f"views resolved: {views:.3g} {kind} across a microlens image, {independent:.3g} independent views per axis"
        )
        return Verdict.of("views_resolved", text)
    # The band that diffraction lets pass ends where 8 N_F samples across an image hold all of it.
    enough = 2 * independent
    pixels = (
        f"pixels up to {views / enough:.3g} times as large sample all that passes, too (8 N_F = {enough:.3g} across)"
        if views > 1.05 * enough
        else f"pixels sample just what passes (8 N_F = {enough:.3g} across)"
        if views > 0.95 * enough
        else f"finer pixels add no views, but detail, up to 8 N_F = {enough:.3g} across an image"
    )
    return Verdict(
        "views_resolved",
        False,
        "limit",
        f"diffraction limits the views: {views:.3g} {kind} across a microlens image hold {independent:.3g} independent "
        "views per axis (4 N_F, with the Fresnel number N_F of a microlens)",
        f"larger microlenses or a shorter d_2 gain views; {pixels}",
    )


def farthest_off(lens: RealLens) -> tuple[float, float, float, Place] | None:
    """Shift [px], widening [px and %] and place [mm] of the traced image that differs most from the thin lens's."""
    images = [
        (math.hypot(*field.shift_px), field.widening_px, field.widening_percent, field.x_ml_mm)
        for field in lens.fields
        if field.shift_px is not None and field.widening_px is not None and field.widening_percent is not None
    ]
    # A rim of the image moves by half of what it widens.
    return max(images, key=lambda image: image[0] + abs(image[1]) / 2, default=None)


def _thin(f: Numbers, lens: RealLens) -> Verdict:
    """Whether microlens images lie where the thin lens puts them, and are as large."""
    name, other = "thin_lens_holds", "calibrate image centres rather than compute them, or take a better corrected lens"
    if not lens.fields:
        return Verdict.of(name, "thin lens: no field was asked for")
    image = farthest_off(lens)
    if image is None:
        return Verdict.of(name, f"thin lens fails: through {lens.lens} no field asked for has a whole image", other)
    moved, wider, percent, at = image
    size = (
        f"at {place(at)} mm on the MLA {lens.lens} shifts the microlens image by {moved:.3g} px and "
        f"{'narrows' if percent < 0 else 'widens'} it by {abs(percent):.3g} % "
        f"(image fill {f.fill_factor * (1 + percent / 100):.3g})"
    )
    lost = [place(field.x_ml_mm) for field in lens.fields if field.shift_px is None or field.widening_px is None]
    if not lost and moved + abs(wider) / 2 <= SLACK_PX:
        return Verdict.of(name, f"thin lens holds for the places and sizes of images: {size}")
    none = f", and there is no whole image at {listed(lost)} mm" if lost else ""
    return Verdict.of(name, f"thin lens does not hold: {size}{none}", other)
