"""Photometry: electrons that a pixel gets from the scene's light, and their scatter."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from .._arrays import Array, magnitude, product, ratio
from ..camera import Camera, Number
from ..design.parts import PATHS
from .colours import BANDS, PIXEL_FILTERS, ColourFilter
from .exit_pupil import microlens_image_diameter
from .field_of_view import focus_ahead
from .lens_shapes import LENS_SHAPES

PLANCK = 6.62607015e-34
"""[J s]; exact by the SI."""
LIGHT_SPEED = 299_792_458e3
"""[mm/s]; exact by the SI."""
EFFICACY = 683.0
"""Luminous efficacy at 555 nm [lm/W]; exact by the SI to 3e-5 (540 THz)."""
EYE = (4e-4, 0.004, 0.023, 0.06, 0.139, 0.323, 0.71, 0.954, 0.995, 0.87, 0.631, 0.381, 0.175, 0.061, 0.017, 0.0041)
"""Luminous efficiency V by CIE 1924 from 400 to 700 nm, every 20 nm."""
RINGS, SPOKES = 4, 8
"""Places over a microlens image at which slanting light is weighed: to 1e-3 where a tenth of it is left."""
LONGEST_EXPOSURE = 1 / 60
"""Exposure where none is given [s]: a frame of video."""
FILLED = 0.98
"""Part of the full well from which a pixel counts as full where depth is measured: interpolation mixes it with its
neighbours."""
BY_CHANCE = 3.0
"""Standard errors of noise below `FILLED` from which a pixel may be full by chance: of one in 700."""
LARGEST_FILL = 0.5
"""Part of the full well that the scene's mean fills at most where no exposure is given."""


def sensor_slope(c: Camera, radius: Number) -> Array:
    """Tangent of the steepest ray's angle at the sensor, from the middle of a microlens to its image's far rim.

    Parameters
    ----------
    radius : float or ndarray
        Of the microlens from the main lens's axis [mm].
    """
    reach = 2 * c.fap.outline.sized(microlens_image_diameter(c)).reach
    steep = np.abs(product(radius, c.seen.vergence)) + ratio(reach, 2 * c.seen.d_2)
    return np.asarray(magnitude(steep) / c["sensor.relay_magnification"])


def accepted(angle: Number, half: Number) -> Array:
    """Share of its light that a pixel takes at an angle, half of it at the angle `half` [both rad]: a Gaussian."""
    return np.asarray(2.0 ** -np.square(np.divide(angle, half)))


def response(c: Camera, radius: Number) -> Array:
    """Share of its light that the image of a microlens leaves in slanting pixels; 1 where nothing is known of them.

    Its mean over the whole image; of one that is no disc, as if the field lay along x.

    Parameters
    ----------
    radius : float or ndarray
        Of the microlens from the main lens's axis [mm].
    """
    half = c.numbers.get("sensor.acceptance")
    if half is None:
        return np.ones(())
    chief, across = product(radius, c.seen.vergence), ratio(magnitude(microlens_image_diameter(c)), 2 * c.seen.d_2)
    image = c.fap.outline.sized(2 * across)
    total = np.zeros(np.broadcast_shapes(np.shape(chief), np.shape(across), np.shape(half)))
    for out, weight in zip(*np.polynomial.legendre.leggauss(RINGS), strict=True):
        for turn in (np.arange(SPOKES) + 0.5) * (math.pi / SPOKES):
            x, y = image.polar(math.sqrt((out + 1) / 2), turn)  # rings of equal area
            slope = np.hypot(chief + x, y) / c["sensor.relay_magnification"]
            total = total + accepted(np.arctan(slope), half) * (weight / (2 * SPOKES))
    return np.asarray(total)


def eye_response(wavelength: Number) -> Array:
    """Luminous efficiency V of a wavelength [mm], 1 at 555 nm; 0 beyond 400 to 700 nm, where it is below 0.005."""
    nanometres = np.multiply(wavelength, 1e6)
    seen = np.exp(np.interp(nanometres, np.linspace(400, 700, len(EYE)), np.log(EYE)))
    return np.asarray(np.where((nanometres < 400) | (nanometres > 700), 0.0, seen))


def radiance(c: Camera) -> Array:
    """Radiance of the scene as air has it, on average [W/m^2/sr]: as given, or of a matt surface, ``E rho/(683 pi)``.

    Both are those in the medium that the scene lies in; out of an index n light comes with 1/n^2 of it, whatever
    windows it passes.
    """
    given = c.numbers.get("light.radiance")
    own = c["light.illuminance"] * c["light.reflectance"] / (math.pi * EFFICACY) if given is None else given
    return np.asarray(own / c.front[1].medium ** 2)


def _electron_rate(c: Camera) -> Array:
    """Electrons per second in a pixel that its microlens lights fully, where the scene is as bright as on average.

    ``L q^2 Omega tau QE lambda/(h c)``, L as air has it: the pixel, as it stands behind a relay, sees its microlens
    under the solid angle ``Omega = (d/d_2)^2``, or pi/4 of that where lenses are round. All lengths are those at the
    array. Behind colour filters it is a pixel of the brightest colour, in white light.
    """
    solid = ratio(c.d, c.seen.d_2) ** 2 * LENS_SHAPES[c.lens_shape].area
    watts = product(radiance(c) * 1e-6 * c.q**2, solid) * c["light.transmission"]
    wavelength = PIXEL_FILTERS[c.colours].brightest(c.wavelength)
    return np.asarray(watts * c["sensor.quantum_efficiency"] * wavelength / (PLANCK * LIGHT_SPEED))


def exposure(c: Camera) -> Array:
    """Exposure [s]: as given, or the longest that leaves half of the full well free, 1/60 s at most."""
    given = c.numbers.get("light.exposure")
    if given is not None:
        return np.asarray(given)
    filled = ratio(LARGEST_FILL * c["sensor.full_well"], _electron_rate(c))
    return np.asarray(np.where(np.real(filled) < LONGEST_EXPOSURE, filled, LONGEST_EXPOSURE))[()]


def lit(c: Camera, at: Number | None = None) -> Number:
    """Light of the scene `at` a distance ahead of the tip [mm], or at the focal plane, over what is stated of it.

    1 everywhere unless a source in the tip lights it: then ``(z_0/z)^2``, of a source small beside z.
    """
    stated = c.numbers.get("light.measured_at")
    return 1.0 if stated is None else np.square(ratio(stated, focus_ahead(c) if at is None else at))


def electrons(c: Camera, at: Number | None = None) -> Array:
    """Electrons of an exposure in a pixel that its microlens lights fully, where the scene is as bright as on average.

    More than the full well where the exposure given is too long: the sensor then tells nothing. `at` as for `lit`.
    """
    return np.asarray(product(product(_electron_rate(c), exposure(c)), lit(c, at)))


def source_in_tip(c: Camera) -> float:
    """Distance ahead of the tip at which pictures of what a source there lights are as bright as their scene says [mm].

    That of the focal plane; 0 of even light, and where nothing is lit there.
    """
    focus = float(focus_ahead(c))
    return focus if "light.measured_at" in c.numbers and 0 < focus < math.inf else 0.0


def veil_electrons(c: Camera) -> Number:
    """Electrons of veiling light in every pixel, whatever its own light."""
    return c["light.veil"] * c["sensor.full_well"]


def full_level(c: Camera, fully_lit: Number | None = None) -> Array:
    """The full well over what a fully lit pixel holds: so many electrons, by default `electrons`."""
    return np.asarray(ratio(c["sensor.full_well"], electrons(c) if fully_lit is None else fully_lit))


def veil_level(c: Camera, fully_lit: Number | None = None) -> Array:
    """Veiling light of a pixel over a fully lit pixel's own, as for `full_level`."""
    return np.asarray(product(c["light.veil"], full_level(c, fully_lit)))


def contrast_left(c: Camera, at: Number | None = None, light: Number = 1.0) -> Array:
    """Share of a picture's contrast that is left on the veil, ``1/(1 + veil/mean)``: a factor of every MTF.

    Parameters
    ----------
    at : float or ndarray, optional
        As for `lit`.
    light : float or ndarray
        Light of the pixels over that of fully lit ones on the axis.
    """
    own = electrons(c, at) * light
    return np.asarray(np.where(own > 0, ratio(own, own + veil_electrons(c)), 1.0))


def dark_variance(c: Camera) -> Array:
    """Variance that a pixel has without light [electrons^2]: read noise, and rounding to the sensor's steps."""
    step = c["sensor.full_well"] / 2.0 ** c["sensor.bits"]
    return np.asarray(c["sensor.read_noise"] ** 2 + step**2 / 12)


def surely_held(room: float, dark: float) -> float:
    """Electrons of light from which noise may fill a pixel: `BY_CHANCE` times their own noise below what it holds.

    Parameters
    ----------
    room : float
        Electrons of light that fill it.
    dark : float
        Variance without light [electrons^2].
    """
    half = BY_CHANCE / 2
    return room - BY_CHANCE * max(math.sqrt(half**2 + room + dark) - half, 1.0)


class Beside(NamedTuple):
    """Brightness and scatter of pixels beside the picture's light and its shot and read noise."""

    share: Number = 0.0
    """Rms share of brightness that pixels differ by."""
    dark: Number = 0.0
    """Rms of what they differ by in the dark [electrons]."""
    veil: Number = 0.0
    """Electrons in each that are not the picture's."""

    @classmethod
    def mismatched(cls, c: Camera) -> Beside:
        """Unequal views and pixels: view mismatch, PRNU and DSNU, without the veil."""
        share = np.sqrt(c["depth.view_mismatch"] ** 2 + c["sensor.prnu"] ** 2)
        return cls(share, c["sensor.dsnu"])

    @classmethod
    def of(cls, c: Camera) -> Beside:
        """All of them; the veil with the shot noise and the mismatch of its own brightness."""
        return cls.mismatched(c)._replace(veil=veil_electrons(c))


NOTHING = Beside()
"""Noise alone."""


def through_filter(c: Camera, one: ColourFilter) -> Camera:
    """A camera with colour filters as the pixels of one colour see it, for the same exposure.

    Lengths and glasses are as before: what colour does to the main lens is not in it.
    """
    efficiency = c["sensor.quantum_efficiency"] * (one.taken / BANDS)
    own = {PATHS["wavelength"]: one.wavelength, "sensor.quantum_efficiency": efficiency, "light.exposure": exposure(c)}
    return c.behind_filter(own)
