"""Field and stops: which rays pass, and where a stop's disc appears."""

from __future__ import annotations

import mpmath as mp

from .camera import Camera, affine_root
from .judging import oracle


@oracle
def nondistortion_margin(lens_diameter, pupil_diameter, pupil_distance, distance, radius):
    """Room between the pencil's outermost ray and the lens's rim, in diameter, times Z - d_3."""
    edge = -pupil_diameter / 2  # the far edge of the pupil makes the outer ray of a point at a positive height
    x = abs(radius)
    outermost = abs(x + (edge - x) / (distance - pupil_distance) * distance)
    return (lens_diameter - 2 * outermost) * (distance - pupil_distance)


@oracle
def nondistortion_bound(lens_diameter, pupil_diameter, pupil_distance, distance, focal_length, focal_plane_distance):
    """Field point whose pencil's outermost ray meets the rim, and where its chief ray meets the array."""
    depth = distance - pupil_distance

    def outermost(x: mp.mpf) -> mp.mpf:
        return (pupil_diameter / 2 + x) / depth * distance - x

    if outermost(mp.mpf(0)) > lens_diameter / 2:
        return mp.mpf(0), mp.mpf(0)
    if pupil_distance == 0:  # the pencil covers the same disc whatever the field point
        return mp.inf, mp.inf
    radius = affine_root(outermost, lens_diameter / 2)
    camera = Camera.focused_at(focal_length, focal_plane_distance)
    return radius, abs(camera.seen(radius, depth, pupil_distance, 0)[0])


@oracle
def stop_margin(
    stop_diameter, stop_distance, pupil_diameter, pupil_distance, distance, point, stop_decentre, pupil_decentre
):
    """Room of the pencil's ray farthest from the stop's centre, in diameter, times Z - d_3."""

    def on_stop(pupil_point: list[mp.mpf]) -> list[mp.mpf]:
        share = (distance - stop_distance) / (distance - pupil_distance)
        return [x + (a - x) * share for x, a in zip(point, pupil_point, strict=True)]

    centre = [a - e for a, e in zip(on_stop(list(pupil_decentre)), stop_decentre, strict=True)]
    length = mp.hypot(*centre)
    direction = [part / length for part in centre] if length else [mp.mpf(1), mp.mpf(0)]
    rim = [e + pupil_diameter / 2 * n for e, n in zip(pupil_decentre, direction, strict=True)]
    farthest = mp.hypot(*[a - e for a, e in zip(on_stop(rim), stop_decentre, strict=True)])
    return (stop_diameter - 2 * farthest) * (distance - pupil_distance)


@oracle
def stop_disc(
    stop_diameter,
    stop_distance,
    microlens_centre,
    sensor_distance,
    focal_length,
    focal_plane_distance,
    stop_decentre,
):
    camera = Camera.focused_at(focal_length, focal_plane_distance)
    rim = stop_diameter / 2
    radius = camera.landing(0, sensor_distance, stop_distance, -rim) - camera.landing(
        0, sensor_distance, stop_distance, 0
    )
    centre = tuple(
        camera.landing(c, sensor_distance, stop_distance, e)
        for c, e in zip(microlens_centre, stop_decentre, strict=True)
    )
    return radius, centre
