"""The questions an engineer asks first, answered with their margins and what would mend them; warnings, hard cases."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from .._arrays import product
from ..bore.main_lens import IdealMainLens
from ..camera import Camera
from ..catalogue.entries import named_window, other_focal_length
from ..design import Design
from ..design.growth import NAMED_AT, not_known, not_named
from ..design.parts import USUAL_PIXEL, Stop
from ..errors import InputError
from ..lenses.glass import ROOM
from ..shapes.lattice import PACKINGS
from ..theory import tube
from ..theory.colours import PIXEL_FILTERS
from ..theory.disparity_error import roomy, share_full
from ..theory.f_number import TOUCHING_PX, fill_factor, main_lens_f_number, matched, pupil_f_number
from ..theory.focused import LEAST_VIEWS, FocusedArray, filtered_views, pupil_remedy
from ..theory.lens_shapes import LENS_SHAPES
from ..theory.light import outer_slope, sensor_field
from ..theory.photometry import EFFICACY, LARGEST_FILL, accepted, electrons, exposure, eye_response, response
from ..theory.quantities import QUANTITIES
from ..theory.quantity import FEASIBLE
from ..theory.stop_images import MicrolensImages
from ..theory.vignetting import corner_room
from ..words import clauses, in_file, length, listed, number, on_side, percent, place, the
from .answer import STOP, FirstAnswer
from .fields import Place, default_fields, field_openings, judged_field, round_radius
from .groups import Field, Numbers, RealLens, Verdict
from .remedies import GAP_SLACK, OVERLAP_SLACK, SLACK_PX, ways_of
from .specification import RIM, FieldImages

SHADED = 0.01
"""Share of an image at the end of the field that a tube's end takes from which it is told."""
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
LEAST_SEEN, UNSEEN = 0.5, 1e-3
"""Shares of its lux at 555 nm that the eye sees of a wavelength: below which it is told, and taken for dark."""
TAKEN_LOSS = 0.01
"""Share of light lost to slanting rays, and of pixels that are full, from which it is told."""
TAKEN_FIELD = 0.05
"""Share of the field without depth for full pixels from which it is told."""
WIDEST_PIXEL = 0.05
"""Pixels wider than this are none of a sensor that takes pictures [mm]."""
FAST, WIDE = 1.4, 46.0
"""f-number and full field [degrees] of a double Gauss lens, the fastest of the standard forms at such a field: the
example of 50 mm in W. J. Smith, Modern Lens Design, p. 335."""
FASTEST_LENS = 0.9
"""f-number below which hardly any lens with a field is sold: the fastest of the makers of camera lenses end at f/0.95
(Leica Noctilux-M 50 mm, Voigtländer Nokton 25 mm), but for single ones of f/0.8; aspheres for one pencil are faster."""
FASTEST_ZONE = 1.8
"""f-number f/(2 h) of the zone in which a lens is met by the chief rays of the field's end, below which elements hardly
image the pupil: an achromat of f/1.3 (AC254-030-A), traced behind an otoscope's FAP, loses chief rays from f/2.2 on."""
FASTEST_ARRAY = 3.0
"""f-number f_ml/d, rounded down, of the fastest microlens array in the catalogue (SUSS 18-00079, NA 0.16: f/3.1)."""
NEAR = 1e-2
"""Relative distance below which a design is called near a hard case."""


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
    return (*answers, *fits, *_reversed(camera))


def lens_speed(design: Design, camera: Camera) -> tuple[Verdict, ...]:
    """Whether an ideal main lens is faster, or takes in more, than known lenses; nothing where not, or it is real.

    Aperture by field, (D/d_1) tan(w), is the Lagrange invariant in terms of the lens's own length: no scale changes it.
    Of a round field that is required it is judged at the rim.
    """
    speed = float(main_lens_f_number(camera))
    rim = round_radius(design)
    tangent = (float(sensor_field(camera).radius) if rim is None else rim) / (speed * float(camera.D))
    beyond = tangent / speed / (math.tan(math.radians(WIDE / 2)) / FAST)
    unsold = speed < FASTEST_LENS * (1 - FEASIBLE)
    height = float(judged_field(design).radius) * abs(float(camera.seen.inverse_m * camera.seen.d_3 / camera.seen.gap))
    oblique = 2 * height * FASTEST_ZONE > float(camera.f) * (1 + FEASIBLE)
    if not isinstance(design.main_lens.kind, IdealMainLens) or not (unsold or beyond > 1 or oblique):
        return ()
    idealised = f", and an idealisation: hardly any lens faster than f/{FASTEST_LENS:g} is sold" if unsold else ""
    gauss, outer = f", {beyond:.3g} times the aperture by field of a double Gauss, f/{FAST:g} over {WIDE:g} degrees", ""
    if not (unsold or beyond > 1):
        gauss = ""
    if oblique:
        outer = (
            f", and chief rays meet the lens {height:.3g} mm off its axis, {percent(2 * height / float(camera.D))} of "
            f"its radius, where it is f/{float(camera.f) / (2 * height):.3g}"
        )
    text = (
        f"ideal lens: f/{speed:.3g} over {2 * math.degrees(math.atan(tangent)):.3g} degrees as the lens's own middle "
        f"sees the {'array' if rim is None else RIM} (the field of view is from the entrance pupil)"
        f"{gauss}{idealised}{outer}; single pencils f/{float(pupil_f_number(camera)):.3g}; "
        "a lens of one or two elements can take that in, but hardly sharp over the field: its aberrations are not in "
        "these figures"
    )
    remedy = "`roslf evaluate` with a real lens (main_lens.prescription) before trusting resolution and depth"
    return (Verdict("lens_speed", False, "limit", text, remedy),)


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


def _microlens_speed(camera: Camera) -> tuple[Verdict, ...]:
    """Whether microlenses are faster than any in the catalogue; nothing where they are not."""
    speed = float(QUANTITIES["f_number_microlens_lens"](camera))
    if speed >= FASTEST_ARRAY * (1 - FEASIBLE):
        return ()
    text = (
        f"microlenses of f/{speed:.3g} (f_ml = {length(float(camera.f_ml))}, pitch {length(float(camera.d))}): no "
        f"array in the catalogue is faster than f/{FASTEST_ARRAY:g}, and hardly any maker lists one"
    )
    remedy = (
        f'ask a maker first, or hold studies to what there is: [[constraints]] quantity = "f_number_microlens_lens", '
        f"min = {FASTEST_ARRAY:g}"
    )
    return (Verdict("microlens_speed", False, "limit", text, remedy),)


def _counted_to_rim(design: Design, camera: Camera) -> tuple[Verdict, ...]:
    """Whether more of a real main lens counts than its maker guarantees to be clear; nothing where not."""
    diameter = float(camera.cold.D)
    counted = diameter / (1 + FEASIBLE)
    lenses = [(lens.name, lens.clear_aperture) for lens in design.main_lens.prescribed]
    return tuple(
        Verdict(
            "clear_aperture",
            False,
            "limit",
            f"clear aperture: all {length(diameter)} of {name} count, of which its maker guarantees {length(sure)}: "
            "what the field gets through the rim is not certain",
            f'main_lens.diameter = "{length(sure)}" counts no more than that',
        )
        for name, sure in lenses
        if sure is not None and sure < counted
    )


def _windows_to_rim(design: Design, camera: Camera) -> Iterator[Verdict]:
    """Whether light needs more of a window than is clear for certain."""
    for at, name, element, *_ in design.at_room.in_bore:
        part, across = getattr(element, "part", None), element.diameter
        known = named_window(part)
        if known is None or across is None or across <= known.aperture * (1 + FEASIBLE):
            continue
        clear = known.aperture
        key = f"{at}.diameter"
        field = judged_field(design)
        narrower = corner_room(camera.replace({key: clear * float(camera[key]) / across}), field)
        if not np.any((narrower < 0) & (narrower < corner_room(camera, field))):
            continue
        text = (
            f"clear aperture: all {length(across)} of {the(name)} ({part}) count, of which {length(clear)}, 90 %, are "
            "taken as clear, and the field needs more than that"
        )
        remedy = f'{in_file(key)} = "{length(clear)}" counts no more than that'
        yield Verdict("clear_aperture", False, "limit", text, remedy)


def _coatings(design: Design, camera: Camera) -> Iterator[Verdict]:
    """Which prisms do not reflect all of the field's light by total reflection."""
    if not design.in_bore:
        return
    corners = -judged_field(design).corners[[0, 1, 3, 2]] * float(camera.seen.inverse_m)
    ends = np.concatenate([corners, (corners + np.roll(corners, 1, axis=0)) / 2])
    pupil = camera.fap.outline.along_rim(24)
    ways = (ends[:, None] - pupil) / float(camera.seen.d_f - camera.seen.d_3)
    sines = ways / np.sqrt(1 + np.sum(np.square(ways), axis=-1, keepdims=True))
    for _, name, element, near, _ in design.in_bore:
        if any(other.part.bends and other.near < near for other in design.in_bore):
            continue
        known = element.incidence(design.wavelength, sines)
        if known is None or element.glass is None or not known[0] < known[1]:
            continue
        least, total = known
        text = (
            f"{name}: the field's light meets its reflecting face from {least:.3g} degrees to the normal on, and "
            f"{element.glass.name} reflects totally beyond {total:.3g} degrees alone"
        )
        remedy = "a reflecting coating on that face, a glass of higher index or a smaller field"
        yield Verdict("reflecting_face", False, "limit", text, remedy)


def walled(shown: FieldImages, camera: Camera) -> tuple[Verdict, ...]:
    """Whether an end of the tube, where no opening says so, would cut the field's images; nothing where it would not.

    Told of the end that would leave least light where the field, as it is lit, ends.
    """
    if tube.OUTER not in camera.numbers:
        return ()
    ends = {"tip": float(camera.cold.tip)}
    if tube.LENGTH in camera.numbers:
        ends["rear end"] = ends["tip"] - float(camera.cold[tube.LENGTH])
    design, told = shown.design, list[tuple[float, float, str, float]]()
    places = shown.rim if shown.outermost == RIM else shown.ends.fields[4:]
    kept = np.ravel(MicrolensImages(camera, places).shapes.kept_fraction)
    for end, ahead in ends.items():
        wide = float(tube.room(camera, ahead))
        if ahead <= 0 or any(abs(float(rim.ruler_distance) - ahead) <= tube.NEAR * ahead for rim in camera.openings):
            continue
        try:
            stop = Stop(diameter=wide, distance=ahead)
            cut = Camera.of(design.replace({"stops": (*design.stops, stop)}))
        except InputError:  # within a part, which has an opening of its own
            continue
        left = np.ravel(MicrolensImages(cut, places).shapes.kept_fraction)
        worst = int(np.argmax(kept - left))
        if left[worst] < kept[worst] - SHADED:
            told.append((float(left[worst]), float(kept[worst]), end, ahead))
    if not told:
        return ()
    share, whole, end, ahead = min(told)
    where = number(ahead, 6)
    text = (
        f"the tube's inside counts as no opening: its {end}, {where} mm before the lens and "
        f"{number(float(tube.room(camera, ahead)), 4)} mm wide, would leave {percent(share)} of an image at the end of "
        f"the field, of {percent(whole)} as counted"
    )
    remedy = f'to count it: [[stops]] distance = "{where} mm", bore = true, and no diameter'
    return (Verdict("tube_cuts", False, "limit", text, remedy),)


def buildable(design: Design, camera: Camera) -> tuple[Verdict, ...]:
    """Doubts whether a camera's main lens and microlenses are ones that anybody makes; nothing where there are none."""
    counted = *_counted_to_rim(design, camera), *_windows_to_rim(design, camera)
    return *lens_speed(design, camera), *counted, *_coatings(design, camera), *_microlens_speed(camera)


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
    sees = f"{sees}; {_shifted(camera)}{_stopped(camera)}"
    if answer is not None and answer.outermost == RIM:
        sees = f"judged to the {RIM} that is required; {sees}"
    cuts = (lens and lens.cut_by) or thin.cut_by
    by_thin = _field_remedy(camera, cuts) if cuts else ""
    off = any(np.any(value) for at, value in camera.numbers.items() if ".decentre." in at)
    worst = " in the worst direction" if off or any(rim.outline.straight for rim in camera.openings) else ""
    if lens is not None:
        sees += " (thin-lens model)"
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
    if leaning and thin.x0_max_mm < thin.field_half_diagonal_mm * (1 - FEASIBLE):
        bound = (
            f"over all that the sensor sees; {the(thin.limited_by)}, which leans, would cut beyond "
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
        f"; in the middle, too, {the(rim.name)} leaves {percent(float(openings.common().kept_fraction))} of an image: "
        "light, depth and MTF are of that; image fill, f-numbers, views across an image and depths of field are the "
        "whole FAP's"
    )


def _shifted(camera: Camera) -> str:
    """Words on how far images lie beside their microlenses, and why: no fault, and none where telecentric."""
    corner = float(sensor_field(camera).radius)
    shift = abs(corner * float(product(camera.seen.d_2, camera.seen.vergence)) / float(camera.q))
    if shift < SLACK_PX:
        return f"shifted by less than {SLACK_PX:g} px there"
    return f"shifted by {number(shift, 3)} px there, no fault once calibrated (0 with the exit pupil at infinity)"


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
        text = f"{holds}; {extreme}{uncounted}{tube.unsaid_wall(camera)}"
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


def named_otherwise(design: Design) -> Iterator[Verdict]:
    """A main lens with the name of a part and a focal length that is not the part's: which is meant is not told."""
    lens = design.main_lens
    if lens.part and lens.focal_length is not None and (f := other_focal_length(lens.part, lens.focal_length)):
        own = f"focal_length of {length(lens.focal_length)}, of an ideal lens, and all here is that lens's"
        yield Verdict.of(
            "main_lens_as_named",
            f"main_lens has a part, {lens.part} of {length(f)}, and beside it a {own}",
            "drop focal_length for the part, or part for the ideal lens",
        )


def full_well_doubt(design: Design) -> str:
    """Caution that the full well is taken as that of other pixels than the sensor's; empty where it is not."""
    sensor = design.sensor
    if not sensor.well_unlike:
        return ""
    return (
        f"full well assumed, {number(sensor.full_well)} electrons: of a pixel of {length(USUAL_PIXEL)}, and those of "
        f"the sensor are of {length(sensor.pixel)}; state full_well in [sensor], as its data sheet has it"
    )


def _lux_doubt(design: Design) -> str:
    """Words on lux of light that the eye hardly sees; empty where radiance is stated, or it sees it well."""
    light, seen = design.light, float(eye_response(design.wavelength))
    if light.radiance is not None or seen >= LEAST_SEEN:
        return ""
    few = f"about {number(seen, 2)} of that" if seen > UNSEEN else "next to nothing"
    watts = light.illuminance * light.reflectance / (math.pi * EFFICACY * max(seen, UNSEEN))
    told = f'; as a luxmeter reads that light alone, radiance = "{number(watts, 2)} W/m2/sr"' * (seen > UNSEEN)
    return (
        f"{number(light.illuminance, 4)} lx count as light of 555 nm, 683 lm/W, and at {1e6 * design.wavelength:.4g} "
        f"nm the eye sees {few}: electrons and depth noise are those of that many watts. State light.radiance{told}"
    )


def warnings_of(design: Design, fields: Sequence[Field]) -> Iterator[str]:
    """Warnings about what is no error but must not go unsaid."""
    array, pixel = design.microlens_array, design.sensor.pixel
    if design.q > array.pitch or pixel > WIDEST_PIXEL:
        wide = "than a microlens" if design.q > array.pitch else "than those of any usual sensor"
        meant = "" if pixel < 0.1 else f", or are {pixel:.4g} um meant?"
        yield f"pixels of {length(pixel)} are wider {wide} (pitch {length(array.pitch)}): check sensor.pixel{meant}"
    if design.sensor.part is not None and (doubt := full_well_doubt(design)):
        yield doubt
    if doubt := _lux_doubt(design):
        yield doubt
    for side, mla, sensor in zip(("wide", "high"), array.size, design.sensor_size, strict=True):
        if sensor > mla * (1 + 1e-9):
            yield (
                f"the sensor is {sensor:.5g} mm {side} (seen at the MLA) but the MLA only {mla:.5g} mm: "
                "its margin stays dark, and fields are counted to the MLA's edge"
            )
    if LENS_SHAPES[array.lens_shape].area > PACKINGS[array.layout].rise:
        yield (
            "square microlenses as wide as the pitch overlap in a hexagonal layout, whose rows are 0.866 pitch apart; "
            'lens_shape = "circular" fits'
        )
    environment = design.environment
    if environment is not None and {environment.temperature, *(environment.range or ())} != {ROOM}:
        if silent := not_named(design):
            keys = dict.fromkeys(NAMED_AT.get(name, "material in [[elements]]") for name in silent)
            yield (
                f"nothing says how {listed([*silent])} would grow with temperature, so their lengths stay as the file "
                f"has them: name what they are of ({'; '.join(keys)})"
            )
        if unknown := [f"the glass with {name}" if name[:4] == "n = " else name for name in not_known(design)]:
            yield f"how the index of {listed(unknown)} changes with temperature is not known; it stays"
    camera = Camera.of(design)
    if design.sensor.acceptance is not None:
        steepest = float(QUANTITIES["sensor_angle_deg"](camera))
        lost = 1 - float(accepted(math.radians(steepest), design.sensor.acceptance))
        kept = float(response(camera, sensor_field(camera).radius))
        if lost > TAKEN_LOSS:
            yield (
                f"at the field's corner rays meet the sensor at up to {steepest:.3g} degrees, where its pixels lose "
                f"{100 * lost:.3g} % of the light (half at {math.degrees(design.sensor.acceptance):.3g} degrees); of "
                f"the whole microlens image {100 * (1 - kept):.3g} % is lost there, which makes depth noise about "
                f"{kept**-0.5:.3g} times as large; {_straighter(camera, kept)}"
            )
    full = share_full(camera) if math.isfinite(float(fill_factor(camera))) else None
    if full is not None and (full[0] > TAKEN_LOSS or full[1] > TAKEN_FIELD):
        alone, room = share_full(camera, neighbours=False), roomy(camera) / float(electrons(camera))
        cause, ways = "", "a shorter light.exposure"  # where a veil takes the room
        if alone[0] <= TAKEN_LOSS and alone[1] <= TAKEN_FIELD:
            cause = ", where light of neighbouring images adds up"
            ways = "images that do not overlap or a shorter exposure"
        elif room < 1 - FEASIBLE:
            given = design.light.exposure is not None and design.light.measured_at is None
            enough = roomy(camera) >= LARGEST_FILL * design.sensor.full_well * (1 - FEASIBLE)
            other = ", or none given," * (given and enough)
            ways = f"light.exposure of {number(1e3 * room * float(exposure(camera)), 3)} ms or less{other}"
        part = "a part exposed to its own mean, as in `roslf depth`, may lose less"
        whole = f" (over the whole sensor; {part})" * (design.depth.period is None)
        yield (
            f"{percent(full[0])} of the pixels saturate{cause}: about {percent(full[1])} of the field has no "
            f"depth, as the texture's bright places fill the well{whole}; {ways} leaves room"
        )
    corner = float(sensor_field(camera).radius)
    beyond = float(outer_slope(camera, corner)) / camera.lens.told_to
    if beyond > 1 + 1e-3:
        yield (
            f"the main lens's sheet states fields to {corner / beyond:.4g} mm on the MLA, and the sensor sees "
            f"{corner:.4g} mm: beyond, its last numbers are held"
        )
    half_x, half_y = (size / 2 for size in array.size)
    for field in fields:
        x, y = field.x_ml_mm
        if abs(x) > half_x or abs(y) > half_y:
            yield f"field {place(field.x_ml_mm)} mm is beyond the MLA (half size {half_x:g} x {half_y:g} mm)"
        if field.status == "dark":
            yield f"field {place(field.x_ml_mm)} mm gets no light: the rims' images do not overlap there"


def _straighter(camera: Camera, kept: float) -> str:
    """Ways to meet the sensor straighter at the corner, where pixels take the share `kept`, by what slants there."""
    middle, radius = float(response(camera, 0.0)), float(sensor_field(camera).radius)
    relay = float(camera["sensor.relay_magnification"])
    lean = math.degrees(math.atan(abs(radius * float(camera.seen.vergence)) / relay))
    cone = f"in the middle, where images come straight, {100 * (1 - middle):.3g} % is lost"
    if 1 - middle > (1 - kept) / 2:
        return f"{cone}: it is the width of their cone, which slower microlenses narrow and no exit pupil does"
    return (
        f"{cone}: it is the lean of chief rays, {lean:.3g} degrees at the corner, which a smaller sensor or an exit "
        "pupil farther away (d_3 nearer to f) lessens, and a sensor made for chief rays that lean so takes"
    )


class Near(NamedTuple):
    """A design's distance from one hard case."""

    case: str
    distance: float
    """Relative; 0 is on it."""
    near: bool
    says: str
    """Sentence on what that means for this design; empty where it is not near."""

    @classmethod
    def of(cls, case: str, distance: float, says: str) -> Near:
        """Case, with what its loss of digits means where it is near."""
        near = distance < NEAR
        lost = min(16.0, -math.log10(max(distance, 2.0**-52)))
        text = f"{says}; a formula that cancels there loses {lost:.0f} of 16 digits, the forms used lose none"
        return cls(case, distance, near, text if near else "")


def near_cases(design: Design) -> tuple[Near, ...]:
    """Distance from every place where a textbook formula loses digits, closest first."""
    camera = Camera.of(design)
    f, d_f, d_3, D_F = (float(length) for length in (camera.f, camera.seen.d_f, camera.seen.d_3, camera.seen.D_F))
    fill = float(fill_factor(camera))
    # The pupil at the lens has no distance to scale by: a little in front of it the images touch at about the same D_F.
    near = camera if d_3 else camera.replace({"d_3": 0.01 * f})
    touching = float(matched(near, "D_F").value / near.fap.scale)
    # Openings near containment or, of discs, tangency, at the centre, edge and corner of the sensor.
    openings = field_openings(design, default_fields(design))
    centres, spans = openings.centres, openings.spans
    r, R = spans[:, :1] / 2, spans[:, 1:] / 2
    apart = np.hypot(*np.moveaxis(centres[:, 1:] - centres[:, :1], -1, 0))
    inner, outer = float((abs(apart - abs(R - r)) / r).min()), float((abs(R + r - apart) / r).min())
    if openings.polygons:
        inner = float((abs(openings.rooms[:, 1:]) / r).min())
    at_lens = Near("d_3 → 0", 0.0, True, "the aperture is at the main lens; margins are exact there")
    # Behind power in the bore d_f may have either sign, and is not where the camera is focused.
    far, scale = "focused almost at infinity", d_f
    if camera.chain.bends:
        far, scale = "the main lens sees the focal plane almost at infinity", f
    cases = [
        Near.of("d_3 → d_f", abs(d_f - d_3) / max(abs(d_f), abs(d_3)), "the bore's end lies almost in the focal plane"),
        Near.of("d_3 → f", abs(d_3 - f) / f, "image-space telecentric"),
        Near.of("d_f → f", abs(d_f - f) / f, "the object is almost in the front focus"),
        Near.of("d_f → ∞", abs(f / d_f), far),
        Near.of("images just touch", abs(D_F / touching - 1), f"image fill {fill:.6g}"),
        Near.of("d_3 → 0", abs(d_3 / scale), "the aperture is almost at the main lens") if d_3 else at_lens,
        Near.of("barely clipped", inner, "a rim almost touches the pupil's image from outside, somewhere in the field"),
        Near.of(
            "discs near tangency", outer, "a rim leaves almost nothing of the pupil's image somewhere in the field"
        ),
    ]
    return tuple(sorted(cases, key=lambda one: one.distance))
