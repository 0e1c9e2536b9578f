"""What the effects need to know of a scene, without its geometry: how fine, how deep, how bright, which light."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..design import Design


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

    def wavelength(self, design: Design) -> float:
        """The longest wavelength in play [mm]: diffraction's worst."""
        return max(self.wavelengths, default=design.wavelength)


WHITE = SceneBrief()
"""The default scene."""
