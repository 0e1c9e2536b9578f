"""The texture that windows of a simulated scene really have: random, it is stronger in some than in others."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from roslf_design.camera import Camera
from roslf_design.depth.geometry import ArrayGeometry, disparity_of
from roslf_design.depth.pictures import chief_rays
from roslf_design.design import Design
from roslf_design.design.parts import OCTAVES
from roslf_design.imaging.surfaces import encode, met
from roslf_design.scenes import Noise, Plane, Scene, Sphere

Array = NDArray[np.float64]

NODES, ANGLES = 8, 16
"""Waves looked at in each octave of `Noise`, and their directions."""
ACROSS, WEIGHTS = np.polynomial.legendre.leggauss(3)
"""Places across a microlens over which it averages."""
TINY = 1e-18
"""Square of steps [mm] that keeps those of what is not seen from being singular."""
CORNERS = np.array([(x, y) for x in (-0.5, 0.0, 0.5) for y in (-0.5, 0.0, 0.5)])
"""Places of a microlens: middle, sides and corners [pitches]."""
RIM = np.array([(0.0, 0.0), *((math.cos(turn) / 2, math.sin(turn) / 2) for turn in np.arange(8) * math.pi / 4)])
"""Places on the FAP that it is seen from: middle and rim [diameters]."""
EDGE = 0.25
"""Disparity between neighbouring microlenses, or what one sees, from which an edge lies between [pitches]."""
ASIDE = np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)]) / 4
"""Where views look beside the chief ray, of the disparity: with the mean square of a disc of half its width."""


def own_texture(design: Design, scene: Scene, places: Array, z: Array) -> Array:
    """Information of the texture that microlenses really see over that of the texture's spectrum.

    It is the squared slope of what a microlens averages, over the light there: by the radiance that chief rays meet,
    and by the waves of `Noise`, as strong in each octave, as they are seen there. Nothing of the theory of disparity
    errors is used.

    Parameters
    ----------
    design : Design
    scene : Scene
        Walls or a sphere with `Noise` of one kind.
    places : ndarray, shape (v, u, 2)
        Of microlenses on the array [mm].
    z : ndarray, shape (v, u)
        What their chief rays meet [mm], NaN where they meet nothing.

    Returns
    -------
    ndarray, shape (v, u)
        0 where nothing is seen.
    """
    camera, traced = Camera.of(design.thin_twin), ArrayGeometry(design).traced
    d = float(design.microlens_array.pitch)
    b = _disparity(camera, z)
    middle = places[..., None, :] + d * b[..., None, None] * ASIDE
    # From edge to edge of a microlens, along x and along y, places along both edges: (axis, edge, place, 2).
    along_x = np.array([[(side, at) for at in ACROSS] for side in (-1, 1)])
    points = middle[..., None, None, None, :] + d / 2 * np.stack([along_x, along_x[..., ::-1]])
    rays = chief_rays(camera, traced, points.reshape(-1, 2))
    surfaces = encode(scene, float(camera["main_lens.focal_plane"]), camera.chain.mirrored)
    distance, radiance = met(surfaces, float(camera.tip), rays)
    hits = np.column_stack([rays[:, :2] - rays[:, 2:] * distance[:, None], distance])
    light = radiance.reshape(points.shape[:-1]) @ WEIGHTS / 2
    ends = WEIGHTS / 2 @ _on_surface(scene, hits, camera.chain.mirrored).reshape(*points.shape[:-1], 3)
    along = ends[..., 1, :] - ends[..., 0, :]
    texture = next(thing.texture for thing in scene.surfaces if isinstance(thing, Plane | Sphere))
    if not isinstance(texture, Noise):
        raise TypeError(f"a texture of waves is needed, not {texture.kind}")
    seen = np.asarray(np.isfinite(along).all((-2, -1)))
    along = np.where(seen[..., None, None], along, 0.0)
    steps = np.asarray(np.linalg.cholesky(along @ np.swapaxes(along, -1, -2) + TINY * np.eye(2)), float)
    expected = (texture.mean * texture.contrast) ** 2 * _of_spectrum(steps, texture.finest) / light[seen].mean()
    own = (light[..., 1] - light[..., 0]) ** 2 / light.mean(-1)
    waves, told = (one.sum(-1).mean(-1) for one in (expected, np.where(seen[..., None], own, 0.0)))
    return np.asarray(np.divide(told, waves, out=np.zeros_like(told), where=seen.all(-1) & (waves > 0)))


def on_one_surface(design: Design, scene: Scene, places: Array, z: Array) -> NDArray[np.bool_]:
    """True of microlenses that tell the disparity of one surface: they and those about them see no other.

    What a microlens shows changes from view to view by what its neighbours see: it tells nothing beside one that an
    edge goes through. Arguments as of `own_texture`.
    """
    camera, traced = Camera.of(design.thin_twin), ArrayGeometry(design).traced
    surfaces = encode(scene, float(camera["main_lens.focal_plane"]), camera.chain.mirrored)
    b = _disparity(camera, z)
    least, most = ndimage.minimum_filter(b, 3), ndimage.maximum_filter(b, 3)
    near = most - least > EDGE
    one = np.ones(b.shape, bool)
    # A view looks past an edge beside the chief ray by the disparity of that edge's surface, whichever it is.
    for of_edge in (least[near], most[near]) if near.any() else ():
        beside = CORNERS[:, None] + of_edge[:, None, None, None] * RIM
        points = places[near][:, None, None] + float(camera.d) * beside
        rays = chief_rays(camera, traced, points.reshape(-1, 2))
        seen = _disparity(camera, met(surfaces, float(camera.tip), rays)[0]).reshape(len(points), -1)
        one[near] &= np.ptp(seen, axis=-1) <= EDGE
    return np.asarray(ndimage.minimum_filter(one, 3))


def _disparity(camera: Camera, z: Array) -> Array:
    """Disparities at distances; of what is met nowhere, of the infinitely far [pitches]."""
    return disparity_of(camera, np.where(np.isfinite(z), z, math.inf))


def _of_spectrum(steps: Array, finest: float) -> Array:
    """Mean square of what two edges of a microlens differ by along both axes, of noise of contrast 1 in each octave.

    `steps` are those on the surface [mm] from one microlens to the next, shape (..., 2, 2), but for a turn of it.
    """
    octaves = (np.arange(OCTAVES * NODES) + 0.5) / NODES
    angles = (np.arange(ANGLES) + 0.5) * math.pi / ANGLES
    total = np.zeros(steps.shape[:-1])
    for frequency in 2.0**-octaves / finest:
        for angle in angles:
            phase = steps @ np.array([math.cos(angle), math.sin(angle)]) * frequency
            across = np.sinc(phase[..., ::-1])
            total += (2 * np.sin(math.pi * phase) * across) ** 2
    return total / (NODES * ANGLES)


def _on_surface(scene: Scene, points: Array, mirrored: Array) -> Array:
    """Places on the texture of what is met, where that is a sphere; distances between them are as on the texture."""
    sphere = next((thing for thing in scene.surfaces if isinstance(thing, Sphere)), None)
    if sphere is None:
        return points
    across = points[:, :2] - 2 * (points[:, :2] @ mirrored)[:, None] * mirrored
    x, y = (across - sphere.centre).T
    along = sphere.radius * np.arctan2(x, sphere.distance - points[:, 2])
    up = sphere.radius * np.arcsin(np.clip(y / sphere.radius, -1, 1))
    return np.column_stack([along, up, np.zeros_like(up)])
