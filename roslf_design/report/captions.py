"""What to see in each figure, and what follows for the design, in words filled with the evaluation's numbers."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ..evaluation.show import number
from .figures.ray_diagram import is_centred

if TYPE_CHECKING:
    from ..design import Design
    from ..evaluation.result import Evaluation
    from ..imaging.encircled import Encircled
    from .figures.field_maps import FieldMap

DIMENSIONS = (
    "Elements in their order along the axis. The numbers are the dimensions; the drawing is not to scale, the ray "
    "diagram is. d_f, d_3 and further stops count from the main lens towards the object, d_1 from it to the microlens "
    "array."
)
HISTORY = (
    "Each dot is a local search from a Sobol point: how much worse its goals are than the answer's, over the "
    "evaluations spent by then. Dots on the lower edge ended at the answer; a diamond there is another solver that "
    "found none better."
)
PICTURE = (
    "Pencils of the centre, the edge and a corner of the sensor, cut off in front of the bore; the grey plate is the "
    "FAP, the blue disc the main lens. Orange rays end at what blocks them. The tube wall is drawn for orientation and "
    "is not part of the design."
)


def rays(design: Design, result: Evaluation) -> str:
    """Of the ray diagram."""
    field = result.non_distortion
    if field.undistorted_in_field:
        follow = (
            f"Every pencil that fills the FAP passes the {field.limited_by} with "
            f"{number(field.room_at_corner_mm, 3)} mm to spare at the corner."
        )
    else:
        follow = (
            f"Outer pencils lose light, most at the {field.limited_by}: "
            f"{number(-field.room_at_corner_mm, 3)} mm of room are missing at the corner."
        )
    plane = (
        "Each field lies in its own meridional plane, turned into the page."
        if is_centred(design)
        else "Drawn in the plane x-z, as decentres and tilts make the sides differ."
    )
    return (
        "Solid rays reach the sensor; dashed orange rays are blocked and end, with a cross, at what stops them (the "
        "outermost of each fan miss the FAP on purpose, to show it at work). The FAP is black, the main lens and its "
        f"mount blue. {follow} {plane}"
    )


def cells(result: Evaluation) -> str:
    """Of the zoom on the MLA."""
    f, image = result.f_number, result.microlens_image
    touch = (
        "Neighbouring cones just touch on the sensor: all pixels are used and none twice."
        if result.verdicts[0].ok
        else f"Neighbouring cones overlap by {number(f.mismatch_px, 3)} px: those pixels mix views of two microlenses."
        if f.mismatch_px > 0
        else f"Between neighbouring cones {number(-f.mismatch_px, 3)} px stay dark: sensor area is wasted."
    )
    drift = (
        "The cones stay on their microlenses' axes over the whole array (image-space telecentric)."
        if result.exit_pupil.telecentric
        else f"At the edge the cones lean: images are {number(1e3 * image.pitch_mm)} µm apart, not the microlens "
        "pitch, and decoding has to use that pitch."
    )
    if any(field.status != "full" for field in result.fields[:2]):
        drift += " Hatched cones never come: other rims block that light."
    seen = "Light cones behind five neighbouring microlenses; boxes are pixels. Height and depth differ in scale."
    return f"{seen} {touch} {drift}"


def images(result: Evaluation, on_sensor: float) -> str:
    """Of the microlens images, of which the worst has that share on the sensor."""
    clipped = [field for field in result.fields if field.status != "full"]
    follow = (
        "All three are full discs: every microlens sees the whole FAP."
        if not clipped
        else "What the dashed discs of other rims cut away is light and views lost there: a cat's eye."
    )
    if on_sensor < 0.999:
        follow += " Where it is hatched there is no sensor: of the outermost images only the share told as seen "
        follow += "falls on pixels."
    return (
        "Ray-optics images, exact: grey is the share of each pixel that the image covers, the solid line its outline, "
        "dashed lines the discs of the single rims (those not seen lie outside the view), the green line its own "
        "cell, the cross its chief ray. "
        f"{follow} Diffraction, which blurs them over {number(result.diffraction.airy_radius_px, 2)} px (Airy radius), "
        "is not drawn."
    )


def waves(light: Encircled) -> str:
    """Of one microlens image by rays and by waves."""
    return (
        "Left by rays, right by waves: a uniform scene behind the microlens on the axis, before pixels integrate. Of "
        f"one image's light, diffraction leaves {100 * light.disc:.1f} % in the geometric disc and "
        f"{100 * light.cell:.1f} % in a cell of one image pitch; the rest lies on the neighbours."
    )


def maps(design: Design, result: Evaluation, fields: FieldMap) -> str:
    """Of the maps over the MLA."""
    lost = 1 - float(fields.kept.min())
    dark = float(np.mean(fields.kept == 0))
    left = (
        "Left: no microlens on the array loses any of the pupil."
        if lost == 0
        else f"Left: the pupil is cut outside the Eq. 6 circle; {100 * dark:.3g} % of the array gets no light at all."
        if dark > 0
        else f"Left: the pupil is cut outside the Eq. 6 circle; the worst microlens loses {100 * lost:.3g} %."
    )
    shift = result.microlens_image.centre_shift_px_per_microlens
    right = (
        "Right: arrows show where each image's centroid lies from its microlens's axis, as decoding meets it. Against "
        f"a camera whose pupil is the main lens, images move by {number(shift, 4)} px per microlens (Eq. 4), "
        f"{number(shift * design.microlens_array.size[0] / 2 / design.d, 3)} px at the array's edge."
    )
    return f"{left} {right}"


def lens_field(result: Evaluation) -> str:
    """Of the aberrations over the field."""
    lens = result.real_lens
    assert lens is not None
    edge = lens.fields[1]
    moved = (
        f"At the sensor's edge images lie {number(abs(edge.shift_px[0]), 3)} px off and are "
        f"{number(edge.widening_percent, 3)} % wider. "
        if edge.shift_px is not None and edge.widening_percent is not None
        else "The sensor's edge has no whole image. "
    )
    return (
        f"Exact rays through {lens.lens}, from the axis to the distance of the sensor's corner. Left: microlens images "
        "against those of an ideal lens of the same focal length (dashed); the shift counts outwards. "
        f"{moved}Middle: how far an object point's light spreads over the array because the focal surfaces are bent "
        "(negative: in front of the array) and colours part. Right: distortion of the object. Images are whole out to "
        f"{number(lens.x_ml_max_mm, 4)} mm on the array; for the thin lens Eq. 6 says "
        f"{number(lens.thin_x_ml_max_mm, 4)} mm."
    )


def lens_images(result: Evaluation) -> str:
    """Of the outlines behind a real lens."""
    assert result.real_lens is not None
    return (
        f"Outlines of microlens images through {result.real_lens.lens} (blue) and through its thin twin (dashed), in "
        "pixels from the thin image's centre. Ray optics; diffraction is not drawn."
    )


def plane(design: Design, result: Evaluation) -> str:
    """Of the D_F - d_3 plane."""
    matched, free = result.verdicts[0].ok, result.non_distortion.undistorted_in_field
    where = {
        (True, True): "The design lies on the curve and inside the green region: matched and undistorted.",
        (
            True,
            False,
        ): "The design lies on the curve but outside the green region: matched, yet its corners are clipped.",
        (False, True): "The design lies inside the green region but off the curve: undistorted, yet not matched.",
        (False, False): "The design lies off the curve and outside the green region.",
    }[matched, free]
    aside = "" if is_centred(design) else " Decentres are left aside here."
    return (
        f"All else held, images just touch along the blue curve. {where} Moving along the curve keeps the match; "
        f"above it images overlap, below it pixels stay dark.{aside}"
    )


def depth(design: Design, result: Evaluation) -> str:
    """Of the depth precision."""
    told = result.depth
    near = "inf" if not math.isfinite(told.sigma_z_mm) else number(told.sigma_z_mm, 3)
    return (
        f"One standard deviation of depth for {told.sigma_disparity_pitches:g} microlens pitches of disparity error "
        f"between the FAP's rims: {near} mm at the focal plane, growing with the square of the distance from the FAP "
        f"(at Z = {design.d_3:.4g} mm). The dashed curve tells how many microlenses an object point spreads over: "
        "far from the focal plane views must be refocused before they are compared."
    )


def effects(result: Evaluation) -> str:
    """Of the effects chart."""
    on = [effect for effect in result.effects if effect.on and effect.estimate != 0 and effect.budget > 0]
    if not on:
        return "No effect exceeds its budget for a white scene at the focal plane."
    largest = max(on, key=lambda effect: abs(effect.estimate) / effect.budget)
    return (
        "Bars reach from nothing to the estimate, in units of the budget (logarithmic); blue effects are simulated, "
        f"grey ones are small enough to be left out. Largest here: {largest.name.replace('_', ' ')}, "
        f"{abs(largest.estimate) / largest.budget:.3g} times its budget. For a white scene at the focal plane."
    )
