"""Exact rays through windows, prisms, rods and lenses before the main lens, and how far the closed forms are off them.

Snell's law against the chain of planes: the focus shift beyond the paraxial one, astigmatism, distortion, total
reflection, and in a scene of several wavelengths their colour, which the closed forms take at the design's own.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..bore.opening import POINT
from ..camera import Camera
from ..camera.rims import place_of
from ..design import Design
from ..design.parts import PATHS
from ..fates import RayFate
from ..rays.backward import behind_elements, mapped, scene_side
from ..theory.exit_pupil import microlens_image_diameter
from ..theory.light import outer_slope
from ..theory.object_space import ObjectSpaceFaces, SceneRays
from ..theory.stop_images import stop_discs
from .effect import Effect, Estimate, Subject

Floats = NDArray[np.float64]

RADII = (0.0, 0.5, 0.8, 1.0)
"""Parts of the field's radius at which rays are compared."""
RIM = 8
"""Points on the FAP's rim, beside its centre."""
ROUNDED = 1e-11
"""Rounding error where nothing moves [mm]."""
NEARLY = 1.02
"""Rays that far outside a rim still count."""


class _ExactMinusParaxial(NamedTuple):
    """Farthest that exact rays come from where the closed forms have them, over field and FAP."""

    image: float
    """Distance by which what clips microlens images is off, on the sensor [mm]; an image's diameter where rays are
    lost."""
    picture: float
    """Distance by which the picture of the scene is off, on the array [mm]."""
    spread: float
    """Distance within the light of one microlens, on the array [mm]."""
    lost: bool
    """Whether rays that the closed forms let through are totally reflected or miss a surface."""


@lru_cache(maxsize=256)
def exact_minus_paraxial(
    design: Design, radius: float, distances: tuple[float, ...], wavelengths: tuple[float, ...] = ()
) -> _ExactMinusParaxial:
    """Compare rays out to a radius of the array.

    Parameters
    ----------
    design : Design
        With an ideal main lens.
    radius : float
        From the main lens's axis, on the array [mm].
    distances : tuple of float
        Of what is seen [mm].
    wavelengths : tuple of float
        Beside the design's own [mm].
    """
    camera = Camera.of(design)
    front, law, (lens_x, lens_y) = scene_side(camera), camera.mapping.kernel, design.main_lens.decentre
    lx, ly, ox, oy = _rays(camera, radius)
    height, slope = (lx + lens_x, ly + lens_y), (ox, oy)
    passed = np.ones(lx.shape, np.bool_)
    for rim in camera.openings:
        x, y = camera.decentre(rim.part)
        passed &= rim.outline.scaled(NEARLY).contains(lx - ox * rim.distance - x, ly - oy * rim.distance - y)
    *closed, imaged = mapped(law, front, *behind_elements(front, lens_x, lens_y, *height, *slope))
    passed &= imaged
    if not passed.any():
        return _ExactMinusParaxial(0.0, 0.0, 0.0, False)
    image, picture, spread, lost = 0.0, 0.0, 0.0, False
    p = outer_slope(camera, radius)  # an objective's mapping may draw the edge larger than the middle
    compressed = min(1.0, float(camera.sagittal_stretch(p)), float(camera.tangential_stretch(p)))
    rims = sorted(camera.openings, key=lambda rim: float(rim.ruler_distance))
    for wavelength in dict.fromkeys((design.wavelength, *wavelengths)):
        coloured = camera if wavelength == design.wavelength else camera.replace({"wavelength": wavelength})
        space = ObjectSpaceFaces.unclipped(coloured)
        *at_rims, exact = space.rays_at([float(rim.ruler_distance) for rim in rims], height, slope)
        good = passed & (exact.status == RayFate.KEPT)
        lost |= bool((passed & ~good).any())
        there = {rim.part: rays for rim, rays in zip(rims, at_rims, strict=True)}
        image = max(image, _clipping(camera, there, (lx, ly, ox, oy), good, radius))
        for z in distances:
            scale = _on_array(camera, z) / compressed
            off = [(exact.height[k] - exact.slope[k] * z - (closed[k] - closed[2 + k] * z)) * scale for k in (0, 1)]
            # An edge may lie along either axis, or a corner along both.
            picture = max(picture, float(np.max((np.abs(off[0]) + np.abs(off[1]))[good], initial=0.0)))
            apart = np.hypot(*(part - part[:, :1] for part in off))
            spread = max(spread, float(np.max(apart[good & good[:, :1]], initial=0.0)))
    image, picture, spread = (size if size > ROUNDED else 0.0 for size in (image, picture, spread))
    whole = float(np.abs(microlens_image_diameter(camera)))
    return _ExactMinusParaxial(whole if lost else image, picture, spread, lost)


def _rays(camera: Camera, radius: float) -> tuple[Floats, Floats, Floats, Floats]:
    """Heights from the main lens's axis and slopes just before it, (fields, 1 + RIM): the FAP's centre first."""
    turn = np.linspace(0, 2 * np.pi, RIM, endpoint=False)
    poses = (".decentre.", ".tilt.", ".wedge.")
    posed = any(value for place, value in camera.numbers.items() if any(pose in place for pose in poses))
    posed |= camera.has_straight_sides
    ways = turn if posed else turn[:1]
    turn = turn if posed else turn[: RIM // 2 + 1]  # the other half is its mirror image
    fields = np.array([[r * np.cos(way), r * np.sin(way)] for r in RADII for way in ways]) * radius
    aside = np.array(camera.decentre("aperture"))
    rim = np.stack(camera.fap.outline.places(np.append(0.0, np.cos(turn)), np.append(0.0, np.sin(turn))), -1)
    pupil, points = aside + rim, -fields[:, None] * float(camera.seen.inverse_m)
    slope = (pupil - points) / float(camera.seen.gap)
    height = points + slope * float(camera.seen.d_f)
    return height[..., 0], height[..., 1], slope[..., 0], slope[..., 1]


def _on_array(camera: Camera, distance: float) -> float:
    """Millimetres on the array per millimetre at a distance, along chief rays."""
    plane = camera.plane(distance)
    reach = float((plane.distance - camera.seen.d_3) * camera.seen.inverse_m * np.abs(plane.magnification))
    return abs(float(camera.seen.gap) / reach) if reach else 0.0


def _clipping(
    camera: Camera,
    there: Mapping[str, SceneRays],
    rays: tuple[Floats, Floats, Floats, Floats],
    good: NDArray[np.bool_],
    radius: float,
) -> float:
    """Distance on the sensor that rims which clip light move [mm]; `there` are the rays at each, by its part."""
    lx, ly, ox, oy = rays
    (middle, aside), (radii, _) = stop_discs(camera, np.array([0.0, radius]), 0.0)
    apart = np.hypot(*(middle - middle[0]).T) + np.hypot(*((aside - middle) - (aside - middle)[0]).T)
    posed = len(lx) > len(RADII)  # the FAP's edge is then sampled all around, but in no field's own direction
    moved: list[float] = []
    inner = [size * float(rim.outline.inradius / rim.radius) for rim, size in zip(camera.openings, radii, strict=True)]
    for rim, deep, size in zip(camera.openings, apart + radii[0] - inner, radii, strict=True):
        if rim.behind or not rim.size_places:  # met before all glass, or a stop for slopes, which flat faces keep
            moved.append(0.0)
            continue
        z, plane = float(rim.ruler_distance), rim.plane or camera.plane(rim.ruler_distance)
        height, slope, _ = there[rim.part]
        place = [part[good] for part in (height[0] - slope[0] * z, height[1] - slope[1] * z)]
        first = (
            off + plane.a * l - plane.b * o + aside
            for off, aside, l, o in zip(camera.lens_centre, plane.axis_offset, (lx, ly), (ox, oy), strict=True)
        )
        farthest = float(np.max(np.hypot(*(at - part[good] for at, part in zip(place, first, strict=True)))))
        moved.append(farthest / float(rim.radius * rim.scale) * float(size))
        if rim is camera.fap or camera.tilted:
            continue
        # What a rim does not reach into, by first order nor by Snell's law, it changes by no more than that.
        part, own, nearly = place_of(rim.part), rim.outline.scaled(rim.scale), NEARLY if posed else 1.0
        off_x, off_y = (
            nearly * (at - camera[f"{part}.decentre.{axis}"]) for at, axis in zip(place, (0, 1), strict=True)
        )
        cut = -float(np.min(own.room(POINT, off_x, off_y))) / float(own.reach) * float(size)
        moved[-1] = min(moved[-1], max(max(cut, deep) + moved[0], 0.0))
    return max(moved)


def plate_aberration(s: Subject) -> Estimate:
    """Distance that exact rays move microlens images, and what is seen in them [px].

    A pixel looks through a whole microlens: an edge of the scene that moves by a share of a pitch over the array
    changes it by as much as an image's edge that moves by that share of a pixel, and counts for so much.
    """
    distances = (float(s.camera[PATHS["d_f"]]),) if s.brief.distances is None else s.brief.distances
    missed = exact_minus_paraxial(s.design, s.lens_field, distances, s.brief.wavelengths)
    size, at = missed.image / s.design.q, f"to X_ml = {s.lens_field:.4g} mm"
    note = f"by Snell's law microlens images lie up to {size:.3g} px off {at}"
    if missed.lost:
        note = f"by Snell's law rays that reach microlenses {at} are lost in what stands before the main lens"
    if s.brief.white:
        return Estimate(size, note)
    picture, spread = missed.picture / s.design.d, missed.spread / s.design.d
    note += f", object points up to {picture:.3g} pitches off and spread over {spread:.3g}"
    return Estimate(max(size, picture), note)


PLATE_ABERRATION = Effect(
    "plate_aberration",
    "Window aberrations",
    "px",
    plate_aberration,
    cost_per_pixel=32 * 0.2e-6,
    available=lambda design: bool(design.elements),
    absent=lambda subject: "nothing stands before the main lens",
    needs="something before the main lens ([[elements]])",
)
