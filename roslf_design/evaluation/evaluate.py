"""`evaluate`: every closed form of one design, in the terms an engineer asks in, and what its numbers are worth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._arrays import ratio
from ..accuracy.statement import Accuracy, check_accuracy
from ..bore.elements import made_of
from ..bore.opening import ClearAperture
from ..bore.part import TEMPERATURE
from ..camera import Camera
from ..design import Design
from ..design.growth import not_known, not_named
from ..design.parts import PATHS
from ..distances import Distance
from ..effects.plan import plan
from ..errors import refusal
from ..lenses.glass import AIR, ROOM
from ..lenses.material import material_label
from ..theory import exit_pupil
from ..theory.depth_budget import COVERAGE, DepthBudget, depth_budget
from ..theory.depth_error import depth_error, errors_at_fields
from ..theory.field_of_view import entrance_pupil_from_focus
from ..theory.focused import FocusedArray
from ..theory.length_covariance import CalibratedLengths, LengthCovariance
from ..theory.limits import as_design
from ..theory.quantities import QUANTITIES
from ..theory.stop_images import MicrolensImages
from ..theory.vignetting import field_limit
from ..traced.fields import images_of
from ..units import FARTHEST
from .answer import FirstAnswer
from .doubts import warnings_of
from .field_images import FieldImages
from .fields import MOST_FIELDS, default_fields, evaluate_fields, judged_field, rays_for, trace_lens
from .groups import (
    AtTemperature,
    LookedThrough,
    MappedField,
    Numbers,
    ObjectiveMapping,
    SeenPart,
    Temperatures,
)
from .part_verdicts import buildable, named_otherwise, walled
from .required import Requirement, depth_off_axis, requirements
from .result import Evaluation
from .specification import depth_assumptions
from .verdicts import best_focus, sharp_over_field, verdicts_of

METHOD = (
    "Closed forms and exact disc areas for pinhole microlenses in focus behind an ideal thin lens; rounding errors are "
    "below 1e-12 relative. What this model leaves out is listed, with its size, under effects."
)
TRACED = (
    "The main lens is real: all of that is its thin-lens model of the same focal length, and under real lens stands "
    "what exact rays through its surfaces say."
)
ROUNDING = 1e-12
"""Relative, of closed forms and disc areas."""
COUNTED_ERROR = 0.002
"""Error of a share that is counted with the rays taken where no accuracy is asked for."""
COUNTED = (
    "Parts are tilted, so the shapes of the microlens images are those of exact ellipses and their ray budgets were "
    "counted from {rays} rays each (error of a share up to {error:g}); all other numbers are those of the untilted "
    "parts."
)

UPRIGHT = "Tilted stops cut images as they lean; bounds of the undistorted field take them as upright."


def evaluate(
    design: Design | str | Path,
    fields: Sequence[float | tuple[float, float]] | NDArray[Any] | float | None = None,
    accuracy: float | None = None,
    *,
    at: Distance | Sequence[Distance] = (),
    temperature: float | str | None = None,
    build: LengthCovariance | None = None,
    calibration: CalibratedLengths | None = None,
    shown: FieldImages | None = None,
) -> Evaluation:
    """Everything closed forms say of a design.

    Parameters
    ----------
    design : Design, str or Path
        A design, the name of a preset, or a design file.
    fields : sequence of float or (x, y), or float, optional
        Microlens positions on the MLA [mm], a bare number along x. Default: centre, edge and corner of what the
        sensor sees.
    accuracy : float, optional
        What shares of light may be off by where parts are tilted and rays are counted; None is 65 536 rays. Straight
        designs are exact whatever is asked for.
    at : float or str, or a sequence of these
        Distances ahead of the tip [mm], or text as "10 mm", that the first answer tells of, beside the focal plane.
    temperature : float or str, optional
        Of the camera and of what it looks through: degrees C, or text as "37 degC", as `Design.at_temperature` takes
        it. None is what the design's `[environment]` says, else 20 degrees C.
    build : LengthCovariance, optional
    calibration : CalibratedLengths, optional
        How sure the lengths are as built and as calibrated, for the budget of depth (`depth_budget`).
    shown : FieldImages, optional
        Those of the design, where they are known.

    Returns
    -------
    Evaluation
        Prints as tables; `to_dict` gives the JSON object.

    Raises
    ------
    DesignError
        A design file that cannot be used; a temperature that no camera meets, or beyond what is known of a material.
    InputError
        More than `MOST_FIELDS` fields; a distance that is none; an accuracy that is none, or that no number of rays
        reaches.
    ValueError
        A field that is not finite.

    Examples
    --------
    >>> import roslf_design as roslf
    >>> round(roslf.evaluate("paper").f_number.fill_factor, 5)
    1.00506
    """
    if accuracy is not None:
        check_accuracy(accuracy)
    design = at_temperature(as_design(design), temperature)
    rays = rays_for(None if design.has_exact_areas else accuracy)
    axes = default_fields(design) if fields is None else _axes(fields)
    camera = Camera.of(design)
    limit = field_limit(camera, judged_field(design))
    f_number, sampling = Numbers.of(camera, "f_number"), Numbers.of(camera, "sampling")
    non_distortion = Numbers.of(camera, "non_distortion", limit.numbers, undistorted_in_field=not limit.cuts)
    images = evaluate_fields(design, axes, rays)
    pupil = _size(camera.fap.outline, float(exit_pupil.exit_pupil_diameter(camera)))
    image = _size(camera.fap.outline, float(exit_pupil.microlens_image_diameter(camera)))
    vergence, slope = (float(one) for one in entrance_pupil_from_focus(camera))
    traced = trace_lens(design, axes, non_distortion)
    budget = depth_budget(camera, build=build, calibration=calibration)
    depth, focused = _depth(design, camera, budget), FocusedArray.of(camera)
    shown = FieldImages.of(design) if shown is None else shown
    answer = FirstAnswer.of(shown, at, build, calibration, budget)

    def budget_at(distance: float | None) -> DepthBudget:
        return budget if distance is None else depth_budget(camera, distance, build=build, calibration=calibration)

    required = requirements(shown, camera, budget_at)
    asked = [one.verdict for one in required]
    answers = verdicts_of(camera, f_number, non_distortion, sampling, traced, focused, answer, asked)
    method = [METHOD]
    if not design.has_exact_areas:
        method.append(COUNTED.format(rays=rays, error=COUNTED_ERROR if accuracy is None else accuracy))
    elif not design.aligned:
        method.append(UPRIGHT)
    if traced is not None:
        method.append(TRACED)
    method += filter(None, [design.main_lens.kind.untold])
    lenses = *best_focus(shown), *sharp_over_field(answer, traced), *buildable(design, camera), *walled(shown, camera)
    return Evaluation(
        design=design.name,
        answer=answer,
        **Numbers.of(camera, ""),
        entrance_pupil=Numbers.of(
            camera, "entrance_pupil", vergence_at_focus_per_mm=vergence, diameter_over_distance=slope
        ),
        exit_pupil=Numbers.of(
            camera,
            "exit_pupil",
            {"distance_from_lens_mm": float(exit_pupil.exit_pupil_distance(camera))},
            **pupil,
            telecentric=bool(exit_pupil.is_telecentric(camera)),
        ),
        f_number=f_number,
        non_distortion=non_distortion,
        microlens_image=Numbers.of(camera, "microlens_image", **image),
        fields=images,
        sampling=sampling,
        depth=depth,
        depth_budget=budget,
        diffraction=Numbers.of(camera, "diffraction"),
        effects=tuple(plan(design)),
        verdicts=(*named_otherwise(design), *answers, *lenses),
        warnings=tuple(warnings_of(design, images)),
        method=" ".join(method),
        real_lens=traced,
        object_space=None if camera.chain.in_air else _looked_through(design, camera, axes, depth.sigma_z_mm),
        temperature=_temperatures(design, camera),
        focused=focused,
        required=required,
    )


def held_as_planned(
    result: Evaluation, shown: FieldImages, build: LengthCovariance, planned: CalibratedLengths | None
) -> Evaluation:
    """An evaluation as drawn whose required depths, they alone, count lengths as a plan calibrates them.

    As drawn where there is no plan; beside them stands the depth of a camera of that `build` that nobody calibrates.
    """
    camera, told = Camera.of(shown.design), result.required
    if planned is not None:
        told = requirements(shown, camera, partial(depth_budget, camera, build=build, calibration=planned))
    once = "once calibrated as planned" * (planned is not None)

    def beside(one: Requirement) -> Requirement:
        if one.quantity != "u_z_mm":
            return one
        bare = depth_budget(camera, one.at_mm, build=build)
        if one.x_ml_mm is None:
            return one.beside(once, bare.expanded_mm)
        own = errors_at_fields(images_of(shown.design, [one.x_ml_mm]), one.at_mm)[1].item()
        return one.beside(once, np.asarray(COVERAGE * depth_off_axis(camera, bare, own, one.at_mm)))

    return held_to(result, [beside(one) for one in told])


def held_to(result: Evaluation, required: Sequence[Requirement]) -> Evaluation:
    """An evaluation with these of its requirements, each in its place, and their verdicts."""
    asked = iter([one.verdict for one in required])
    verdicts = (next(asked) if verdict.name.startswith("required_") else verdict for verdict in result.verdicts)
    return replace(result, required=tuple(required), verdicts=tuple(verdicts))


def at_temperature(design: Design, temperature: float | str | None) -> Design:
    """Design at a temperature [degrees C], or as it is at None."""
    return design if temperature is None else design.at_temperature(temperature)


def _temperatures(design: Design, camera: Camera) -> Temperatures | None:
    """The camera as it is focused, at temperatures it meets."""
    environment = design.environment
    if environment is None:
        return None
    plane, rows = float(camera[PATHS["d_f"]]), []
    met = {ROOM, float(environment.temperature), *(environment.range or ())}
    for degrees in sorted(met if environment.calibrated_at is None else {*met, float(environment.calibrated_at)}):
        warm = camera.replace({TEMPERATURE: degrees})
        fits = bool(warm.valid)
        with np.errstate(all="ignore"):
            shift = float(QUANTITIES["disparity_pitches_per_mm"](warm)) * (plane - float(warm[PATHS["d_f"]]))
        f, d_1, d_f = (float(warm[PATHS[symbol]]) for symbol in ("f", "d_1", "d_f"))
        fill = float(QUANTITIES["fill_factor"](warm))
        rows.append(AtTemperature(degrees, f, d_1, d_f, shift if fits else None, fill, fits))
    housing, grade = ("", "") if environment.housing is None else (environment.housing.name, environment.housing.grade)
    away = any(row.temperature_degc != ROOM for row in rows)
    unknown = not_known(design) if away else ()
    named = housing, environment.expansion, tuple(rows), unknown, not_named(design), grade
    own = None if design.tube is None else design.tube.material
    return Temperatures(float(environment.temperature), *named, "" if own is None else own.words)


def _depth(design: Design, camera: Camera, budget: DepthBudget) -> Numbers:
    error = float(budget.disparity_pitches)
    depth, assumed = float(depth_error(camera, None, error)), depth_assumptions(design, camera, error)
    own: dict[str, Any] = {"sigma_z_mm": depth, "sigma_disparity_pitches": error, "assumes": assumed}
    return Numbers.of(camera, "depth", **own, expected=budget.to_dict())


def _looked_through(design: Design, camera: Camera, axes: Sequence[tuple[float, float]], sigma: float) -> LookedThrough:
    medium, room, cold = design.object_space.medium, design.at_room, camera.cold
    parts = [
        SeenPart(
            "focal plane",
            "" if medium == AIR else f"in {material_label(medium, design.wavelength)}",
            float(cold[PATHS["d_f"]]),
            None,
            float(cold.seen.d_f),
            None,
        )
    ]
    for _, name, element, near, _ in room.in_bore:
        at = float(cold.plane(near).distance)
        wide = None if element.half_height is None else 2 * float(element.half_height)
        what = ", ".join(word for word in made_of(element) if wide is None or not word.startswith("diameter"))
        parts.append(SeenPart(name, what, near, wide, at, None))
    for rim in cold.stop_openings:
        across, made = 2 * float(rim.radius), rim.outline.scaled(rim.scale)
        own, seen = (None, None) if made.straight else (across * float(rim.scale), across)
        sides = tuple(map(float, made.lengths)) if made.straight else None
        parts.append(SeenPart(rim.name, "opening", float(rim.ruler_distance), own, float(rim.distance), seen, sides))
    parts.sort(key=lambda part: -part.distance_mm)
    glass = {plate.held_by: f"{plate.name} {', '.join(plate.part.words())}" for plate in room.plates}
    array, sensor = glass.get("microlens_array", ""), glass.get("sensor", "")
    parts.append(SeenPart("MLA", array, room.d_1, None, float(cold.seen.d_1), None))
    parts.append(SeenPart("sensor", sensor, room.d_2, None, float(cold.seen.d_2), None))
    index = float(medium.index(design.wavelength))
    return LookedThrough(medium.name, index, tuple(parts), _mapping(design, camera, axes, sigma))


def _mapping(
    design: Design, camera: Camera, axes: Sequence[tuple[float, float]], sigma: float
) -> ObjectiveMapping | None:
    if not camera.chain.mapped:
        return None
    named = [(at.part.mapping_name, at.name) for at in design.in_bore if at.part.mapping_name]
    name, element = next(iter(named), ("its data sheet", "main lens"))
    widest = min(camera.mapping.widest, float(camera.mapping.angle(camera.lens.told_to)))
    sample = float(QUANTITIES["object_sample_mm"](camera))
    images = MicrolensImages(camera, axes)
    x, y, z = np.moveaxis(images.directions[:, 0], -1, 0)
    sine = np.hypot(x, y)
    in_air = np.arcsin(np.minimum(camera.front[1].medium * sine, 1.0))
    drawn = np.where(sine > 0, 100 * (ratio(camera.mapping.height(in_air), np.tan(in_air)) - 1), 0.0)
    along, across = (np.ravel(scale).tolist() for scale in images.stretch)
    fields = zip(axes, np.rad2deg(np.arctan2(sine, z)), drawn, along, across, strict=True)
    rows = tuple(
        MappedField(
            axis, float(angle), float(d), (sample * float(a), sample * float(b)), (sigma * float(a), sigma * float(b))
        )
        for axis, angle, d, a, b in fields
    )
    return ObjectiveMapping(name, element, math.degrees(widest), rows)


def _size(outline: ClearAperture, width: float) -> dict[str, Any]:
    """Diameter, or sides, of an image of an opening so wide [mm]."""
    if not outline.straight:
        return {"diameter_mm": width, "sides_mm": None}
    grown = width / float(outline.width)
    return {"diameter_mm": None, "sides_mm": tuple(float(length) * grown for length in outline.lengths)}


def _axes(fields: Any) -> tuple[tuple[float, float], ...]:
    one = isinstance(fields, (int, float)) or getattr(fields, "ndim", 1) == 0
    places = [fields] if one else list(fields)
    if len(places) > MOST_FIELDS:
        raise refusal("fields", f"{len(places)} are too many; give {MOST_FIELDS} at most, the others in another call")
    return tuple(map(_axis, places))


def _axis(field: Any) -> tuple[float, float]:
    """A position [mm] from one number or two, Python's or numpy's of any kind."""
    try:
        numbers = [float(number) for number in np.ravel(field)]
    except (TypeError, ValueError):
        numbers = []
    if len(numbers) not in (1, 2):
        raise ValueError(f"field {field!r} is no position; give x or (x, y) in mm on the MLA")
    if not all(map(math.isfinite, numbers)):
        raise ValueError(f"field {field!r} is not finite; give mm on the MLA")
    if max(map(abs, numbers)) > FARTHEST["length"]:
        raise ValueError(f"field {field!r} is beyond {FARTHEST['length']:g} mm; give mm on the MLA")
    return numbers[0], numbers[1] if len(numbers) == 2 else 0.0


def check_evaluation_accuracy(design: Design, accuracy: float | None) -> None:
    """Refuse what is no accuracy, or what counted rays cannot reach.

    Raises
    ------
    InputError
    """
    if accuracy is not None:
        check_accuracy(accuracy)
        rays_for(None if design.has_exact_areas else accuracy)


def evaluation_accuracy(
    design: Design, result: Evaluation, asked: float | None = None, seconds: float | None = None
) -> Accuracy:
    """Rounding where everything is straight; where rays are counted, what half of them would have told.

    Parameters
    ----------
    result : Evaluation
        Of it, to the accuracy asked for.
    asked : float, optional
    seconds : float, optional
        That it took.
    """
    if design.has_exact_areas:
        method = f"closed forms and exact {'disc ' if design.sees_discs else ''}areas"
        known = (
            f"arithmetic alone: rounding is below {ROUNDING:.0e} of each number; it says nothing of the camera built"
        )
        model = "the model has an ideal lens: what the one that is bought adds is not in it" * (design.lens is None)
        return Accuracy(
            "every number", "of its value", method, ROUNDING, asked=asked, seconds=seconds, model=model, known=known
        )
    rays = rays_for(asked)
    measured, by = None, ""
    if asked is not None:
        # Half the rays miss by more than all of them do: their difference is an upper bound but for luck.
        half = evaluate_fields(design, [field.x_ml_mm for field in result.fields], max(256, rays // 2))
        pairs = zip(result.fields, half, strict=True)
        measured = max((abs(a.kept_fraction - b.kept_fraction) for a, b in pairs), default=0.0)
        by = "half the rays"
    of = "shares of light over the field (all other numbers to rounding)"
    unit = "% of the light"
    method = f"parts are tilted: {rays} rays counted for each microlens"
    return Accuracy(of, unit, method, COUNTED_ERROR if asked is None else asked, measured, by, asked, seconds)
