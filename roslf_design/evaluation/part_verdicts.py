"""Verdicts on parts: what can be made and bought, what stands where it is counted to, and what is named."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from ..bore.main_lens import IdealMainLens
from ..camera import Camera
from ..catalogue.entries import named_window, other_focal_length
from ..design import Design
from ..design.parts import Stop
from ..errors import InputError
from ..theory import tube
from ..theory.f_number import main_lens_f_number, pupil_f_number
from ..theory.ideal_lenses import IdealLensFaults
from ..theory.light import sensor_field
from ..theory.quantities import QUANTITIES
from ..theory.quantity import FEASIBLE
from ..theory.stop_images import MicrolensImages
from ..theory.vignetting import corner_room
from ..words import in_file, length, number, percent, the
from .field_images import RIM, FieldImages
from .fields import judged_field, round_radius
from .groups import Verdict

SHADED = 0.01
"""Share of an image at the end of the field that a tube's end takes from which it is told."""
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


def _short_prisms(design: Design) -> Iterator[Verdict]:
    """Which prisms of one reflection are shorter than their clear aperture takes."""
    for at, name, element, *_ in design.in_bore:
        if not element.length < element.shortest * (1 - FEASIBLE):
            continue
        text = (
            f"{name}: one reflection by {math.degrees(element.turn):.4g} degrees takes a path of at least "
            f"{length(element.shortest)} under a clear aperture of {length(element.diameter or 0.0)}, and has "
            f"{length(element.length)}: a real one cuts light that is counted"
        )
        most = element.length * (element.diameter or 0.0) / element.shortest
        remedy = f'{in_file(f"{at}.thickness")} = "{length(element.shortest)}", or a diameter of {length(most)}'
        yield Verdict("prism_too_short", False, "limit", text, remedy)


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


def _ideal(camera: Camera) -> Iterator[Verdict]:
    """Whether ideal lenses of the bore, were they real, would be sharp over the field and in all colours."""
    faults = IdealLensFaults.of(camera)
    if faults is None or not faults.beyond:
        return
    near, far = (number(end, 3) for end in faults.sharp)
    text = (
        f"ideal lenses ({faults.lenses}): field curvature and colour are not modelled, and are beyond the depth of "
        f"field, {near} to {far} mm: {'; '.join(faults.beyond)} (estimates to third order, without astigmatism)"
    )
    remedy = 'achromats by their surfaces (kind = "prescription") before trusting white light and the field\'s edge'
    yield Verdict("ideal_lenses", False, "limit", text, remedy)


def buildable(design: Design, camera: Camera) -> tuple[Verdict, ...]:
    """Doubts whether a camera's main lens and microlenses are ones that anybody makes; nothing where there are none."""
    counted = *_counted_to_rim(design, camera), *_windows_to_rim(design, camera)
    return (
        *lens_speed(design, camera),
        *_ideal(camera),
        *counted,
        *_short_prisms(design),
        *_coatings(design, camera),
        *_microlens_speed(camera),
    )


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
