"""Transfer function of a microlens's own aperture and defocus, for the pupil's image behind it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from .._arrays import Array as Floats
from ..camera import Camera, Number
from .lens_shapes import LENS_SHAPES, LensShape, shared_line
from .light import microlens_defocus


class _Switches(Protocol):
    """A plan of effects."""

    def on(self, name: str) -> bool:
        """Whether an effect is on."""


def pixel_box(frequency: ArrayLike, pixel: Number) -> Floats:
    """The pixel's transfer sinc(k q) at `frequency` k [1/mm] for pixels `pixel` = q wide [mm]; broadcast."""
    return np.asarray(np.sinc(np.multiply(frequency, pixel)))


@dataclass(frozen=True)
class MicrolensTransfer:
    """Transfer function of a microlens, diffraction and defocus as switched on; 1 at zero frequency."""

    width: float
    """d, the aperture's width [mm]."""
    sensor_distance: float
    """d_2 [mm]."""
    defocus: float
    """1/f_ml - 1/d_2 - 1/L [1/mm]; 0 leaves it out."""
    wavelengths: tuple[float, ...]
    """Equal parts of light at each [mm]; empty leaves diffraction out."""
    lens_shape: str
    """Shape of the aperture."""
    rotation: float = 0.0
    """Rotation of the array [rad]."""
    beyond_rays: bool = False
    """Whether this is only what it has beyond diffraction in focus of the rays' own blur."""

    @classmethod
    def of(cls, camera: Camera, plan: _Switches, wavelengths: Sequence[float] = ()) -> MicrolensTransfer:
        """Transfer of a planned camera's microlenses; no `wavelengths` [mm] are the camera's own."""
        return cls(
            float(camera.d),
            float(camera.seen.d_2),
            -float(microlens_defocus(camera) / camera.seen.d_2) if plan.on("microlens_defocus") else 0.0,
            (tuple(wavelengths) or (float(camera.wavelength),)) if plan.on("microlens_diffraction") else (),
            camera.lens_shape,
            float(camera["microlens_array.rotation"]) if plan.on("mla_rotation") else 0.0,
        )

    @property
    def shape(self) -> LensShape:
        """Shape of the aperture, which answers for itself."""
        return LENS_SHAPES[self.lens_shape]

    @property
    def trivial(self) -> bool:
        """True where the microlens image stays as geometry has it."""
        return not self.wavelengths and self.defocus == 0

    @property
    def cutoff(self) -> float:
        """Frequency along x or y beyond which nothing passes, d/(lambda d_2) [1/mm]; inf without diffraction."""
        if not self.wavelengths:
            return math.inf
        return self.width / (min(self.wavelengths) * self.sensor_distance) * self.shape.breadth(self.rotation)

    @property
    def largest(self) -> float:
        """Largest share of any frequency that passes, where diffraction ends them."""
        axis = np.linspace(0, self.cutoff, 65)
        return float(np.abs(self(axis, axis[:, None])).max())

    def __call__(self, frequency_x: ArrayLike, frequency_y: ArrayLike) -> Floats:
        """Transfer at spatial frequencies on the sensor [1/mm], which broadcast; real, as the aperture is symmetric."""
        x, y = (np.asarray(values, float) for values in (frequency_x, frequency_y))
        if self.trivial:
            return np.ones(np.broadcast_shapes(x.shape, y.shape))
        if self.beyond_rays:
            whole = replace(self, beyond_rays=False)
            return np.asarray(whole(x, y) - replace(whole, defocus=0.0)(x, y) * replace(whole, wavelengths=())(x, y))
        x, y = self.shape.own_axes(x, y, self.rotation)
        lens = self.width, self.sensor_distance, self.defocus
        parts = [math.prod(self.shape.factors(*lens, wavelength, x, y)) for wavelength in self.wavelengths or (0.0,)]
        return np.asarray(sum(parts) / len(parts))


def pair_transfer(
    transfer: MicrolensTransfer, frequency: Floats, apart: Floats, vergence: float, detail: ArrayLike = (0.0, 0.0)
) -> Floats:
    """Transfer by interference of a microlens with another, `apart` from it; 1 for one alone at frequency 0.

    Where both light the sensor, from an incoherent pupil, a frequency G comes of pairs of points ``a = lambda d_2 G``
    apart: of the overlap of one aperture with the other, shifted by a. In the overlap, of offset ``a - apart`` and with
    coordinates u about its middle, the two paths differ by ``u . (apart/f_ml - defocus a)``, which for one microlens is
    its defocus. Squares and circles.

    Parameters
    ----------
    transfer : MicrolensTransfer
        With one wavelength or more; not `beyond_rays`.
    frequency : ndarray, shape (M, 2)
        G on the sensor [1/mm].
    apart : ndarray, shape (2,) or (M, 2)
        [mm], along the same axes.
    vergence : float
        1/L [1/mm].
    detail : array_like, shape (2,)
        Frequency of a pattern over the array, seen through the overlap, along the same axes [1/mm].

    Returns
    -------
    ndarray, shape (M,)
        Without the sign ``exp(-i pi G . (apart P/d))``, 1 or -1 at frequencies of the lattice.
    """
    c, s = math.cos(transfer.rotation), math.sin(transfer.rotation)
    turn, detail = np.array([[c, -s], [s, c]]), np.asarray(detail, float)
    frequency, apart, detail = frequency @ turn, apart @ turn, detail @ turn
    total = np.zeros(len(frequency))
    for wavelength in transfer.wavelengths:
        paths = _paths(transfer, wavelength, frequency, apart, vergence, detail)
        total += transfer.shape.shared(transfer.width, *paths)
    return total / len(transfer.wavelengths)


def pair_line(
    transfer: MicrolensTransfer, wavelength: float, frequency: Floats, apart: Floats, vergence: float, detail: ArrayLike
) -> Floats:
    """Transfer by interference of two square microlenses along one of their sides, as `pair_transfer`."""
    return shared_line(transfer.width, *_paths(transfer, wavelength, frequency, apart, vergence, detail))


def _paths(
    transfer: MicrolensTransfer, wavelength: float, frequency: Floats, apart: Floats, vergence: float, detail: ArrayLike
) -> tuple[Floats, Floats]:
    """Offset of two microlenses' openings where they overlap [mm], and turn of phases there [1/mm]."""
    power = 1 / transfer.sensor_distance + vergence + transfer.defocus  # 1/f_ml
    pair = wavelength * transfer.sensor_distance * frequency
    return pair - apart, (apart * power - transfer.defocus * pair) / wavelength - np.asarray(detail)
