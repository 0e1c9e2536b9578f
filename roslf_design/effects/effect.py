"""Effect: a name, a unit, a closed-form size for a camera and a scene, and the cost of rendering it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera
from ..design import Design
from ..theory.exit_pupil import microlens_image_diameter, microlens_image_pitch, stop_angle
from ..theory.light import SensorField, on_array, sensor_field

Unit = Literal["px", "pitch", "intensity"]
"""Displacement on the sensor [pixels], displacement on the microlens array [pitches], fraction of full scale (rms)."""
UNIT_WORDS = {"px": "px", "pitch": "pitches", "intensity": "of full scale"}
"""Units behind a number, as pages have them."""


NOT_MODELLED = "not modelled: "
"""Beginning of the reason of an effect of which nothing is known."""


@dataclass(frozen=True)
class SceneBrief:
    """A scene in the few numbers that decide which effects it calls for.

    The default is a white field on the focal plane, seen over the whole sensor in one colour, without noise.
    """

    smallest_period: float = math.inf
    """Period of the finest detail, on the object [mm]; inf for a uniform scene, 0 for point sources."""
    hard_edges: bool = False
    """True where brightness jumps (checkerboards, points): box blurs then change the image at first order."""
    distances: tuple[float, float] | None = None
    """Nearest and farthest object distance from the main lens, Z [mm]; None is the focal plane."""
    exposure: float | None = None
    """Electrons in a fully lit pixel; None asks for no noise."""
    read_noise: float = 0.0
    """Read noise r [electrons]."""
    veil: float = 0.0
    """Veiling light of each pixel over a fully lit pixel's own; `scenes` sets it."""
    wavelengths: tuple[float, ...] = ()
    """[mm]; empty means the design's own."""
    diffracts: bool = True
    """Whether microlens diffraction is rendered too, which hides what is finer than itself; `plan` sets it."""
    field_radius: float | None = None
    """Largest X_ml that counts [mm]; None is the last microlens whose image the sensor's corner shows."""

    def __post_init__(self) -> None:
        if not self.smallest_period >= 0:
            raise ValueError(f"smallest_period is {self.smallest_period}; it must be 0 (points) or a positive length")
        if self.exposure is not None and not (self.exposure > 0 and math.isfinite(self.exposure)):
            raise ValueError(f"exposure is {self.exposure}; give a positive number of electrons, or None for no noise")
        if not (self.read_noise >= 0 and math.isfinite(self.read_noise)):
            raise ValueError(f"read_noise is {self.read_noise}; it must not be negative")
        if any(not (wavelength > 0 and math.isfinite(wavelength)) for wavelength in self.wavelengths):
            raise ValueError(f"wavelengths are {self.wavelengths}; they must be positive lengths")

    @property
    def white(self) -> bool:
        """True where the scene is uniform, so that nothing that blurs the object matters."""
        return math.isinf(self.smallest_period)


WHITE = SceneBrief()
"""The default scene."""


@dataclass(frozen=True)
class Subject:
    """Subject of an estimate: one camera and the scene before it."""

    design: Design
    brief: SceneBrief = WHITE

    @cached_property
    def camera(self) -> Camera:
        """The design's camera, as traced for the longest wavelength in play: diffraction's worst."""
        own = self.design.wavelength
        longest = max(self.brief.wavelengths, default=own)
        return Camera.of(self.design.thin_twin, {} if longest == own else {"wavelength": longest})

    @cached_property
    def pitch(self) -> float:
        """Distance between neighbouring microlens images [mm]; negative where their order is reversed."""
        return float(microlens_image_pitch(self.camera))

    @cached_property
    def diameter(self) -> float:
        """Diameter of an uncut microlens image [mm]."""
        return float(microlens_image_diameter(self.camera))

    def scale(self, distance: float) -> float:
        """Scale on the sensor of a length on a stop at `distance`, h d_2/d_1."""
        return float(self.camera.seen.d_2 * stop_angle(self.camera, distance))

    @cached_property
    def x_ml(self) -> float:
        """X_ml of the farthest microlens that counts [mm]: the brief's, or the last whose image the corner shows."""
        if self.brief.field_radius is not None:
            return self.brief.field_radius
        return float(np.max(np.hypot(*on_array(self.camera, self._field.corners).T)))

    @cached_property
    def _field(self) -> SensorField:
        """Every microlens of which the sensor sees anything."""
        return sensor_field(self.camera, self.diameter / 2)

    @property
    def at(self) -> str:
        """Place of the field's rim in words, on the array."""
        return f"at X_ml = {self.x_ml:.4g} mm"

    @cached_property
    def lens_field(self) -> float:
        """Radius of the field from the main lens's axis [mm], with decentres of array, sensor and lens."""
        if self.brief.field_radius is None:
            return float(self._field.radius)
        return self.brief.field_radius + math.hypot(*self.camera.decentre("microlens_array"))

    @cached_property
    def outermost(self) -> list[tuple[float, float]]:
        """Places from the main lens's axis at which openings are asked what they cut [mm]: one is at `lens_field`.

        Corners of the field where its openings have straight sides.
        """
        if self.brief.field_radius is None and self.camera.has_straight_sides:
            return [(float(x), float(y)) for x, y in self._field.corners]
        return [(self.lens_field, 0.0)]


class Estimate(NamedTuple):
    """Estimate of an effect's size, and a few words on it."""

    value: float
    """Value in the effect's unit; its magnitude is what the budget is compared with."""
    note: str
    """Note on where the number comes from, for the plan's reason."""


Detected = Callable[[NDArray[np.float32], SceneBrief, "np.random.Generator"], NDArray[np.float32]]
"""Rows of pixels, 1 fully lit, as the sensor gives them: of a scene, by random numbers that go on from row to row."""


@dataclass(frozen=True)
class Effect:
    """Effect of physics on an image."""

    name: str
    """Stable name, as in `--effects +name`."""
    title: str
    """The field's term, for tables and charts."""
    unit: Unit
    estimate: Callable[[Subject], Estimate]
    """Closed form; microseconds."""
    cost_per_pixel: float = 0.0
    """Extra time to render it [s per pixel], measured on two cores; prints the plan's cost."""
    always: bool = False
    """True where the image means nothing without it."""
    required_by: tuple[str, ...] = ()
    """Effects that spread light in a way that makes this one matter whatever its own size."""
    available: Callable[[Design], bool] = lambda design: True
    """False where the design's model holds no such physics."""
    absent: Callable[[Subject], str] = lambda subject: ""
    """Why it has none there, in words; what begins with `NOT_MODELLED` may well be there."""
    needs: str = "a traced main lens, and this design's is ideal"
    """Requirement on a design for the effect, in words."""
    straight: Callable[[Design], Mapping[str, Any]] = lambda design: {}
    """Values, by their places, of a design that is drawn without it."""
    simplified: Callable[[Camera], Camera] = lambda camera: camera
    """Camera that is drawn without it."""
    detected: Detected | None = None
    """Change of a picture's rows once all light has reached the sensor; None of what happens to light before."""
