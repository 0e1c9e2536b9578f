"""First-order (Gaussian) data of a real lens: focal length, principal planes, pupils, where to put the array.

Distances along z are measured in the lens's frame: first vertex at z = 0, +z from scene to sensor. Misaligned
surfaces count as centred here; their first-order effect is a shift of the image, not of its focus.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import Problem
from .prescription import LensError, Prescription

Array = NDArray[np.float64]


class FirstOrder(NamedTuple):
    """Gaussian constants at one wavelength, in air on both sides."""

    power: float
    """1/f [1/mm]; 0 for an afocal lens."""
    matrix: Array
    """ABCD from the first vertex plane to the last: (height, slope) after = matrix @ (height, slope) before, (2, 2)."""
    length: float
    """First to last vertex [mm]."""

    @property
    def focal_length(self) -> float:
        """Effective focal length f [mm], infinite for an afocal lens."""
        return 1 / self.power if self.power else math.inf

    @property
    def back_focal_length(self) -> float:
        """Last vertex to the image-side focus [mm]."""
        return float(self.matrix[0, 0]) * self.focal_length

    @property
    def front_focal_length(self) -> float:
        """Object-side focus to the first vertex [mm], positive for a focus in front of the lens."""
        return float(self.matrix[1, 1]) * self.focal_length

    @property
    def front_principal(self) -> float:
        """Place of the object-side principal plane along z [mm]."""
        return (1 - float(self.matrix[1, 1])) * self.focal_length

    @property
    def rear_principal(self) -> float:
        """Place of the image-side principal plane along z [mm]."""
        return self.length + (float(self.matrix[0, 0]) - 1) * self.focal_length

    def image_of(self, z: float) -> tuple[float, float]:
        """Place along z of the image of an axial point of the scene's side, and the magnification.

        Parameters
        ----------
        z : float
            Of the object point [mm]; -inf for a far one.

        Returns
        -------
        tuple of float
            Place of the image [mm], infinite for a point at the front focus; transverse magnification (then infinite).
        """
        (a, b), (c, d) = self.matrix
        if math.isinf(z):
            return self.length + self.back_focal_length, 0.0
        slope = c * -z + d  # of the ray that leaves the axis at z with unit slope
        if slope == 0:
            return math.inf, math.inf
        return self.length - float((a * -z + b) / slope), float(1 / slope)

    def object_of(self, z: float) -> float:
        """Place along z of the scene's point whose image lies at `z` [mm]; infinite for the image-side focus."""
        (a, b), (c, d) = self.matrix
        back = z - self.length
        bottom = a + c * back
        return math.inf if bottom == 0 else float((b + d * back) / bottom)


def first_order(lens: Prescription, wavelength: float) -> FirstOrder:
    """Gaussian constants of a lens.

    Parameters
    ----------
    lens : Prescription
        Its vertex curvatures (with r^2 terms), thicknesses and indices count.
    wavelength : float
        In air [mm].

    Raises
    ------
    InputError
        The wavelength is outside a glass's range.
    """
    matrix = np.eye(2)
    before = 1.0
    for surface in lens.surfaces:
        after = float(surface.glass.index(wavelength))
        bend = np.array([[1.0, 0.0], [-(after - before) / after * surface.vertex_curvature, before / after]])
        carry = np.array([[1.0, surface.thickness], [0.0, 1.0]])
        matrix = carry @ bend @ matrix
        before = after
    return FirstOrder(-float(matrix[1, 0]), matrix, lens.length)


class ExitPupil(NamedTuple):
    """Image by the lens of a stop in object space, as seen from a point of the axis behind the lens."""

    z: float
    """Place along z [mm], infinite where telecentric."""
    diameter: float
    """[mm], infinite where telecentric."""
    vergence: float
    """1/L [1/mm], L from the pupil to the point it is seen from; 0 where telecentric."""
    angle: float
    """Diameter over L [rad], finite where telecentric."""


def exit_pupil(constants: FirstOrder, diameter: float, z: float, seen_from: float) -> ExitPupil:
    """Exit pupil of a stop in object space, such as the flexible angular plane; the stop itself is the entrance pupil.

    Parameters
    ----------
    constants : FirstOrder
        Of the lens.
    diameter : float
        Of the stop, D_F [mm].
    z : float
        Place of the stop [mm].
    seen_from : float
        Place along z of the microlens array [mm].
    """
    (a, b), (c, d) = constants.matrix
    slope, height = float(d - c * z), float(b - a * z)
    place, magnification = constants.image_of(z)
    reach = slope * (seen_from - constants.length) + height  # of that ray at the array; L is reach over slope
    if reach == 0:
        message = f"the stop at {z:g} mm is imaged onto the microlens array; move one of them"
        raise LensError((Problem("aperture.distance", message),))
    return ExitPupil(place, diameter * abs(magnification), slope / reach, diameter / abs(reach))


def focused(
    lens: Prescription, wavelength: float, *, focal_plane: float | None = None, mla: float | None = None
) -> tuple[float, float]:
    """Conjugate distances d_f and d_1 from the principal planes, given one of them.

    Parameters
    ----------
    lens, wavelength
        As for `first_order`.
    focal_plane : float, optional
        d_f, focal plane to object-side principal plane [mm].
    mla : float, optional
        d_1, image-side principal plane to microlens array [mm].

    Returns
    -------
    tuple of float
        d_f and d_1 [mm].

    Raises
    ------
    LensError
        Not exactly one is given, or no real image lies there (the distance is not beyond the focal length).
    """
    if (focal_plane is None) == (mla is None):
        raise LensError((Problem("focus", "give either d_f or d_1"),))
    power = first_order(lens, wavelength).power
    given = focal_plane if mla is None else mla
    assert given is not None
    name = "d_f" if mla is None else "d_1"
    if not power > 0:
        raise LensError((Problem("main_lens", f"{lens.name} does not converge light; it forms no real image"),))
    excess = given * power - 1
    if not (excess > 0 and math.isfinite(given)):
        message = f"{given:g} mm must be beyond the focal length, {1 / power:.6g} mm"
        raise LensError((Problem(name, message),))
    other = given / excess
    return (given, other) if mla is None else (other, given)
