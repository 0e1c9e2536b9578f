"""Effects of light's wavelength, of finite microlenses and pixels, and of the sensor's noise."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera
from ..design.parts import PATHS
from ..theory import light
from ..theory.f_number import fill_factor
from ..theory.photometry import veil_level
from ..theory.transfer import pixel_box
from ..words import number, percent
from .effect import Effect, Estimate, SceneBrief, Subject

LONGEST_GRATING = 4.0
"""Period in microlens pitches up to which what a texture loses falls with it."""
WIDEST = 1e6
"""Largest widening of a footprint at the edge of a mapped field: at 90 degrees it has no end."""
SHORTEST_GRATING = 2.0
"""Period that microlenses still sample."""


def microlens_diffraction(s: Subject) -> Estimate:
    """Displacement of an edge [px]: the blur width w, and more where w is a small part of the pitch p.

    The tails of sinc^2 fall off with the square of the distance, so light from a whole pitch around adds up: an edge
    between two images loses (2 w/pi^2) (ln(2 pi p/w) + 0.577) to them, which exceeds w from p/w = 13 on.
    """
    width, pitch = float(light.diffraction_width(s.camera)), abs(s.pitch)
    tails = 2 / math.pi**2 * (math.log(2 * math.pi * max(pitch / width, 1.0)) + 0.5772)
    fresnel = float(light.fresnel_number(s.camera))
    note = f"blur width lambda d_2/d = {width / s.design.q:.3g} px, N_F = {fresnel:.3g}"
    return Estimate(width * max(1.0, tails) / s.design.q, note)


def incoherent_texture_miss(camera: Camera, pitches: float = LONGEST_GRATING) -> float:
    """Rms of a fully lit pixel that a texture is missed by, at most, where light in a microlens counts as incoherent.

    Fitted above coherent object points added up, along one axis of a square microlens, for 4 N_F of 2 to 16 and fill
    factors F of 0.5 to 4: ``(0.04/sqrt(4 N_F) + 0.1 min(1, F - 1)/(4 N_F)) 4/pitches``, the second term where images
    overlap. Across the other axis F of them lie on one another. What is missed is one to two thirds smaller.

    Parameters
    ----------
    camera : Camera
        In focus: d_2 and the pitch set 4 N_F, images and their pitch F.
    pitches : float
        Period of a grating of full contrast [microlens pitches on the focal plane]; of longer ones less is missed, but
        not in proportion where images overlap, and that of `LONGEST_GRATING` is given.
    """
    views, fill = float(light.independent_views(camera)), float(fill_factor(camera))
    along = 0.04 / math.sqrt(views) + 0.1 * min(1.0, max(0.0, fill - 1)) / views
    return along * max(1.0, fill) * LONGEST_GRATING / min(pitches, LONGEST_GRATING)


def _fap_diffraction(s: Subject) -> Estimate:
    """Airy radius of the FAP on the array [microlens pitches]; zero for a uniform scene, which stays uniform.

    With matched f-numbers it is 1.22 times the microlenses' own blur, in pitches on either side: one and the same
    uncertainty. Textures are therefore blurred at the FAP only where the microlenses do not diffract already; point
    sources carry both, coherently.
    """
    radius = float(light.pupil_airy_radius(s.camera)) / s.design.d
    if s.brief.white:
        return Estimate(0.0, f"a uniform scene stays uniform (detail would blur by {radius:.3g} pitches)")
    own = s.brief.diffracts and s.brief.smallest_period > 0
    carried = ", carried by the microlenses' own diffraction" if own else ""
    return Estimate(radius, f"Airy radius on the MLA {radius:.3g} pitches{carried}")


def _microlens_defocus(s: Subject) -> Estimate:
    """Ray blur b of a sensor that is not where the microlenses image the exit pupil [px].

    Where diffraction of width w blurs as well, what is left of it is b^2/(b + 10 w): W = b/8w waves of defocus take at
    most 1 - sinc(2 W) = 6.6 W^2 of any frequency that diffraction lets pass, which counts for so much of w; beyond a
    wave or so the rays' blur takes over. That holds for incoherent light. A point source's is coherent: fields change
    by the first power of W, intensities by up to pi W of the brightest, the slope 1/w times pi b/8: nothing is hidden.
    Nor is it where the scene has texture: each side of a microlens then looks through another part of the FAP, which
    the views show as a depth that is off.
    """
    blur, waves = (float(of(s.camera)) for of in (light.microlens_defocus_blur, light.microlens_defocus_waves))
    white = s.brief.smallest_period == math.inf
    hidden = float(light.diffraction_width(s.camera)) if s.brief.diffracts and white else 0.0
    left = blur * blur / (blur + 10 * hidden) if blur > 0 else 0.0
    note = f"ray blur {number(blur / s.design.q, 3)} px, {number(waves, 2)} waves at the microlens edge"
    return Estimate(left / s.design.q, f"{note}, mostly hidden by diffraction" if 10 * hidden > blur else note)


def footprint(c: Camera, distance: float) -> float:
    """Width on the object, at Z = `distance`, of what one sensor point sees through a whole microlens [mm].

    At the focal plane this is d d_f/d_1 whatever the microlens's own focus.
    """
    bend = 1 / c.f_ml - 1 / c.seen.d_2
    on_lens = 1 - c.seen.d_1 * bend
    slope, plane = bend + on_lens / c.f, c.plane(distance)
    return float(c.d * np.abs(on_lens * plane.a - slope * plane.b))


def _finite_microlens_aperture(s: Subject) -> Estimate:
    """Rms change of a full-contrast texture seen in patches as wide as the footprint [fraction of full scale].

    A box of width F takes the share 1 - sinc(F/P) of a sinusoid of period P, whose rms is 1/sqrt(8); hard edges, two a
    period along each axis, each change by a ramp of width F: sqrt(F/3P) rms.
    """
    distances = (float(s.camera[PATHS["d_f"]]),) if s.brief.distances is None else s.brief.distances
    width = max(footprint(s.camera, distance) for distance in distances)
    along, _ = light.field_stretch(s.camera, s.x_ml)
    width *= min(max(1.0, float(along)), WIDEST)
    if s.brief.white:
        return Estimate(0.0, f"a uniform scene has no detail within the object footprint of {width:.3g} mm")
    period = s.brief.smallest_period
    if period == 0:
        return Estimate(1.0, f"points are smaller than the object footprint of {width:.3g} mm")
    ratio = width / period
    smooth = (1 - math.sin(math.pi * ratio) / (math.pi * ratio)) / math.sqrt(8)
    loss = 1.0 if ratio >= 1 else math.sqrt(ratio / 3) if s.brief.hard_edges else smooth
    return Estimate(loss, f"object footprint {width:.3g} mm against detail of period {period:.3g} mm")


def _pixel_integration(s: Subject) -> Estimate:
    """Share that a pixel takes of the highest harmonic of the image pitch that diffraction lets pass."""
    order = max(1, math.floor(abs(s.pitch) / float(light.diffraction_width(s.camera))))
    cycles = order * s.design.q / abs(s.pitch)
    share = 1.0 if cycles >= 1 else float(1 - pixel_box(cycles, 1.0))
    finest = f"the finest detail that diffraction passes, {order} to a microlens image"
    return Estimate(share, f"a pixel's width takes {percent(share, 1)} of the contrast of {finest}")


def _veil(s: Subject) -> Estimate:
    """Veiling light of each pixel, over a fully lit pixel's own."""
    share, level = float(s.camera["light.veil"]), float(veil_level(s.camera, s.brief.exposure))
    return Estimate(level, f"{percent(share, 2)} of the full well is {level:.3g} of a fully lit pixel")


def _noise(s: Subject) -> Estimate:
    """Rms noise sqrt(N + r^2)/N of a fully lit pixel [fraction of full scale]; zero where no exposure is given."""
    exposure, read = s.brief.exposure, s.brief.read_noise
    if exposure is None:
        return Estimate(0.0, "the scene gives no exposure, so no noise is asked for")
    rms = math.sqrt(exposure + read**2) / exposure
    return Estimate(rms, f"{percent(rms, 2)} rms at {exposure:.4g} electrons and {read:.3g} read noise")


def add_noise(
    image: NDArray[np.float32], exposure: float, read_noise: float, generator: np.random.Generator
) -> NDArray[np.float32]:
    """An image as one exposure would record it.

    Parameters
    ----------
    image : ndarray
        Relative intensities; 1 is a fully lit pixel.
    exposure : float
        Electrons N at intensity 1.
    read_noise : float
        Rms r [electrons].
    generator : numpy.random.Generator
        Same state, same bytes.

    Returns
    -------
    ndarray
        Relative intensities again, which read noise may take below zero.
    """
    electrons = generator.poisson(np.maximum(image, 0).astype(np.float64) * exposure).astype(np.float32)
    if read_noise > 0:
        electrons += np.float32(read_noise) * generator.standard_normal(image.shape, np.float32)
    return electrons / np.float32(exposure)


def _exposed(image: NDArray[np.float32], scene: SceneBrief, generator: np.random.Generator) -> NDArray[np.float32]:
    """An image as one exposure of the scene would record it; itself where none is asked for."""
    return image if scene.exposure is None else add_noise(image, scene.exposure, scene.read_noise, generator)


MICROLENS_DIFFRACTION = Effect(
    "microlens_diffraction", "Microlens diffraction", "px", microlens_diffraction, cost_per_pixel=20e-9
)
FAP_DIFFRACTION = Effect(
    "fap_diffraction", "FAP diffraction at the MLA", "pitch", _fap_diffraction, cost_per_pixel=100e-9
)
MICROLENS_DEFOCUS = Effect(
    "microlens_defocus",
    "Microlens defocus",
    "px",
    _microlens_defocus,
    cost_per_pixel=5e-9,
    simplified=lambda camera: camera.replace({}, in_focus=True),  # microlenses image the exit pupil onto the sensor
)
FINITE_MICROLENS_APERTURE = Effect(
    "finite_microlens_aperture",
    "Finite microlens aperture",
    "intensity",
    _finite_microlens_aperture,
    cost_per_pixel=64 * 25e-9,
)
PIXEL_INTEGRATION = Effect("pixel_integration", "Pixel box", "intensity", _pixel_integration, always=True)
VEIL = Effect(
    "veil",
    "Veiling light",
    "intensity",
    _veil,
    cost_per_pixel=1e-9,
    always=True,
    available=lambda design: design.light.veil > 0,
    absent=lambda subject: "the design has no veil",
    needs="veiling light, and `light.veil` of this design is 0",
    detected=lambda image, scene, _: image + np.float32(scene.veil),
)
NOISE = Effect("noise", "Shot and read noise", "intensity", _noise, cost_per_pixel=50e-9, detected=_exposed)
