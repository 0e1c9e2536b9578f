"""Rays for each pixel of a picture whose noise is known: so many that what they scatter stays well below it."""

from __future__ import annotations

import math

import numpy as np

from ..camera import Camera
from ..design import Design
from ..scenes import Scene
from ..theory.chief_rays import chief_rays
from ..theory.exit_pupil import microlens_image_diameter, microlens_image_pitch
from ..theory.photometry import electrons, source_in_tip
from ..theory.quantities import QUANTITIES
from ..theory.stop_images import MicrolensImages
from .camera import Floats, ImageLattice, Region, pixel_centres
from .surfaces import seen_distances
from .trace import RaySampling

RAYS, RAYS_FOR = 32, (5000.0, 13.0)
"""For each pixel of a textured scene whose pixels hold so many electrons, behind microlens images so many pixels wide
that no diffraction spreads: errors of depth scatter by up to a twentieth more than without their scatter. Rays scatter
alike in all exposures, so that what they add to errors reads as bias."""
LEAST_RAYS, MOST_RAYS = 16, 256
"""Fewest where diffraction leaves blocks of rays apart: 8 of a video-otoscope's pixel shift all depths alike, by half
of what its noise scatters."""
TOUCHING, GAPS = 0.93, 2.5
"""Diameter of microlens images over their pitch from which they touch: what rays miss of one at its rim the same rays
show of its neighbour. Times as many rays where they leave gaps, or stops cut them: errors of depth scatter 1.5 to 2.9
times as much there, of the cameras of the proof."""
SPREADING = 1.9
"""Times fewer, at most, where diffraction spreads each one's light over several pixels."""
ALL_SPREAD, FEWER, LEAST_SPREAD = 6.0, 2.0, 4
"""Pixels it spreads light over from which it averages whole blocks of rays spread together, times fewer still, and
the fewest there: 4 rays of a grin-needle's pixel scatter half as much against its noise as 32 of a rigid scope's."""
TOGETHER = 8
"""Subpixels along the side of blocks whose rays are spread evenly together."""
SCATTER = 0.85
"""Power of the number of rays that what they scatter falls with."""
LOOKS = 9
"""Places along each axis of a region at which is looked what its microlenses see."""
SECONDS = {"ray": 2e-7, "pixel": 2e-6}
"""Processor time, about: of each ray and pixel of a picture."""
SLOWER = 3.0
"""Times that rays take where they go face by face."""


def rays_for(camera: Camera, region: Region | None = None, light: float | None = None) -> int:
    """Rays for each pixel that stay as far below a camera's noise as `RAYS` do, in a region or where nothing is cut.

    They scatter at the rims of microlens images, of which wide images have less a pixel. `light` is the electrons of a
    fully lit pixel, where a scene is as bright as on average; None is the design's.
    """
    pixels, width = float(camera.q), abs(float(microlens_image_diameter(camera) / camera.q))
    light = float(electrons(camera)) if light is None else light
    wanted = (light / RAYS_FOR[0] * RAYS_FOR[1] / max(width, 1.0)) ** (0.5 / SCATTER)
    blur = _blur(camera)
    kept = 1.0 if region is None else MicrolensImages(camera, looked_at(camera, region)).shapes.kept_fraction.min()
    touching = TOUCHING * abs(float(microlens_image_pitch(camera)))
    wanted *= GAPS if width * pixels * math.sqrt(kept) < touching else 1.0
    fewer, least = (FEWER, LEAST_SPREAD) if blur > ALL_SPREAD else (1.0, LEAST_RAYS)
    some = float(np.clip(RAYS * wanted / np.clip(blur, 1.0, SPREADING) / fewer, least, MOST_RAYS))
    return 1 << (math.ceil(some) - 1).bit_length()


def _blur(camera: Camera) -> float:
    """Width of diffraction at the microlenses [px]."""
    return float(camera.wavelength * camera.seen.d_2 / camera.d / camera.q)


def samples_along(rays: int) -> int:
    """Samples along a pixel's side behind a real main lens, no fewer than rays.

    All microlenses of a window may look through the same points: half as many along a side shift depths of the proof's
    twentieth camera alike, by 1.6 of what its noise scatters.
    """
    return math.ceil(math.sqrt(rays))


def looked_at(camera: Camera, region: Region) -> Floats:
    """Some places of a region on the array [mm], shape (n, 2)."""
    lattice, share = ImageLattice.of(camera), np.linspace(0, 1, LOOKS)
    ends = [(axis[0], axis[-1]) for axis in pixel_centres(camera, region)]
    points = np.stack(np.meshgrid(*(low + share * (high - low) for low, high in ends)), -1).reshape(-1, 2)
    return np.asarray(np.linalg.solve(lattice.image_axes, (points - lattice.image_origin).T).T @ lattice.axes.T)


def light_met(scene: Scene, camera: Camera, rays: Floats) -> float:
    """Mean light where rays meet a scene over that at the focal plane; 1 where no source in the tip lights it.

    Parameters
    ----------
    scene : Scene
        Its distances count from the main lens.
    camera : Camera
    rays : ndarray, shape (N, 4)
        As for `seen_distances`.
    """
    focus = source_in_tip(camera)
    met = seen_distances(scene, camera, rays) if focus else np.empty(0)
    ahead = met[np.isfinite(met)] - camera.tip
    return float(np.mean((focus / ahead) ** 2)) if ahead.size else 1.0


def mean_light(scene: Scene, camera: Camera, region: Region) -> float:
    """Light of a scene's surfaces over that of a fully lit pixel, on average of a region."""
    if not source_in_tip(camera):
        return scene.brightness
    rays = chief_rays(camera, tuple(looked_at(camera, region).T))
    return scene.brightness * light_met(scene, camera, np.stack([*rays.height, *rays.slope], -1))


def even_sampling(camera: Camera, rays: int, seed: int) -> RaySampling:
    """So many rays for each pixel, spread so that what they scatter is least behind diffraction."""
    side = samples_along(rays)
    return RaySampling(least=rays, most=rays, tolerance=1e-6, seed=seed, side=side, together=TOGETHER)


def render_seconds(design: Design, pixels: int, rays: int) -> float:
    """Processor time that so many pixels of a textured scene take, with so many rays each [s], about."""
    overlapping = max(1.0, float(QUANTITIES["fill_factor"](Camera.of(design.thin_twin))) ** 2)
    slower = SLOWER if design.traced_through else 1.0
    return pixels * (SECONDS["ray"] * rays * slower * overlapping + SECONDS["pixel"])
