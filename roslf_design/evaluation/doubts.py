"""Warnings: numbers that a design gives and that are hardly meant, and what its pictures lose."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from ..camera import Camera
from ..design import Design
from ..design.growth import NAMED_AT, not_known, not_named
from ..design.parts import USUAL_PIXEL
from ..lenses.glass import ROOM
from ..shapes.lattice import PACKINGS
from ..theory.disparity_error import roomy, share_full
from ..theory.f_number import fill_factor
from ..theory.lens_shapes import LENS_SHAPES
from ..theory.light import outer_slope, sensor_field
from ..theory.photometry import EFFICACY, LARGEST_FILL, accepted, electrons, exposure, eye_response, response
from ..theory.quantities import QUANTITIES
from ..theory.quantity import FEASIBLE
from ..words import length, listed, lux, number, percent, place
from .groups import Field

LEAST_SEEN, UNSEEN = 0.5, 1e-3
"""Shares of its lux at 555 nm that the eye sees of a wavelength: below which it is told, and taken for dark."""
TAKEN_LOSS = 0.01
"""Share of light lost to slanting rays, and of pixels that are full, from which it is told."""
TAKEN_FIELD = 0.05
"""Share of the field without depth for full pixels from which it is told."""
WIDEST_PIXEL = 0.05
"""Pixels wider than this are none of a sensor that takes pictures [mm]."""


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
        f"{lux(light.illuminance)} count as light of 555 nm, 683 lm/W, and at {1e6 * design.wavelength:.4g} "
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
            whose = "its" if len(silent) == 1 else "their"
            yield (
                f"nothing says how {listed([*silent])} would grow with temperature, so {whose} lengths "
                f"stay as the file has them: name what they are of ({'; '.join(keys)})"
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
