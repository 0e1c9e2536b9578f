"""From a bore to the paper's model: a tube or several stops reduced to one equivalent flexible angular plane (FAP).

A bore lets through what passes all its rims; the model has one rim. Which single stop stands for it best depends on the
field: the stop is chosen so that, over the field, as little light as possible is on the wrong side of its rim. That
share bounds the difference of kept fractions, and is told with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..design import Design, Stop
from ..microlens.discs import intersect
from ..microlens.images import stop_images

Array = NDArray[np.float64]

FIELDS = 9
"""Places from the axis to the corner of what the sensor sees."""


@dataclass(frozen=True)
class Tube:
    """A straight tube before the main lens: its rims are two stops."""

    diameter: float
    """Inner diameter [mm]."""
    length: float
    """[mm]."""
    distance: float
    """From the main lens to the tube's nearer end [mm]."""

    @property
    def rims(self) -> tuple[Stop, ...]:
        """The two ends, the nearer one first."""
        near = Stop(diameter=self.diameter, distance=self.distance)
        return near, Stop(diameter=self.diameter, distance=self.distance + self.length)


@dataclass(frozen=True)
class EquivalentPupil:
    """One stop in place of a bore."""

    diameter: float
    """D_F [mm]."""
    distance: float
    """d_3 [mm]."""
    field_mm: Array
    """Microlens positions that were compared, along the diagonal [mm]."""
    kept_bore: Array
    """Light through bore and main lens, over that of the unclipped equivalent pupil; may be above 1."""
    kept_pupil: Array
    """The same through the equivalent pupil and the main lens."""
    misplaced: Array
    """Share of the pupil's light that one lets through and the other does not."""

    @property
    def worst_kept_difference(self) -> float:
        """Largest difference of kept fractions over the field."""
        return float(np.abs(self.kept_bore - self.kept_pupil).max())

    @property
    def worst_misplaced(self) -> float:
        """Largest share on the wrong side; never below the difference of kept fractions."""
        return float(self.misplaced.max())


def reduce_bore(design: Design, rims: Sequence[Stop], half_diagonal: float) -> EquivalentPupil:
    """One stop that stands for several, for the field of a design.

    Parameters
    ----------
    design : Design
        Gives lens, focus and array; its own aperture and stops are not looked at.
    rims : sequence of Stop
        Of the bore, without the main lens.
    half_diagonal : float
        How far off axis microlenses count [mm on the array].

    Returns
    -------
    EquivalentPupil
        Exact (nothing misplaced) for a single rim, and where one rim is the only one that ever cuts.

    Raises
    ------
    ValueError
        A rim at or beyond the focal plane.
    """
    fields = np.linspace(0.0, half_diagonal, FIELDS)

    def compared(diameter: float, distance: float) -> EquivalentPupil:
        return _compare(design, rims, fields, diameter, distance)

    # On the axis the rim with the smallest angle seen from the focal plane is the pupil, wherever it stands.
    axial = [rim.diameter / (design.d_f - rim.distance) for rim in rims]
    near, far = min(rim.distance for rim in rims), max(rim.distance for rim in rims)
    candidates = [compared(rim.diameter, rim.distance) for rim in rims]
    candidates += [compared(min(axial) * (design.d_f - z), z) for z in np.linspace(near, far, 9)]
    best = min(candidates, key=_cost)
    if best.worst_misplaced == 0 or far == near:
        return best
    return _refined(compared, best, near, far)


def judge_pupil(
    design: Design, rims: Sequence[Stop], half_diagonal: float, diameter: float, distance: float
) -> EquivalentPupil:
    """How well a given stop stands for a bore; parameters as for `reduce_bore`."""
    return _compare(design, rims, np.linspace(0.0, half_diagonal, FIELDS), diameter, distance)


def _cost(pupil: EquivalentPupil) -> tuple[float, float]:
    return pupil.worst_misplaced, float(pupil.misplaced.sum())


def _refined(compared: object, best: EquivalentPupil, near: float, far: float) -> EquivalentPupil:
    """Nelder and Mead's simplex on (D_F, d_3): the cost has kinks where another field becomes the worst."""
    import nlopt

    assert callable(compared)
    found = [best]
    low, high = np.array([0.3 * best.diameter, near]), np.array([2.0 * best.diameter, far])

    def cost(unit: Array, _: Array) -> float:
        diameter, distance = low + np.array(unit) * (high - low)
        pupil: EquivalentPupil = compared(float(diameter), float(distance))
        if _cost(pupil) < _cost(found[0]):
            found[0] = pupil
        return pupil.worst_misplaced

    optimiser = nlopt.opt(nlopt.LN_NELDERMEAD, 2)
    optimiser.set_lower_bounds(np.zeros(2))
    optimiser.set_upper_bounds(np.ones(2))
    optimiser.set_min_objective(cost)
    optimiser.set_xtol_abs(1e-7)
    optimiser.set_maxeval(400)
    optimiser.set_initial_step(0.1)
    optimiser.optimize((np.array([best.diameter, best.distance]) - low) / (high - low))
    return found[0]


def _compare(design: Design, rims: Sequence[Stop], fields: Array, diameter: float, distance: float) -> EquivalentPupil:
    diameters = [diameter, design.D, *(rim.diameter for rim in rims)]
    distances = [distance, 0.0, *(rim.distance for rim in rims)]
    decentres = np.zeros((len(diameters), 2))
    for index, rim in enumerate(rims):
        decentres[2 + index] = rim.decentre
    axes = np.stack([fields, np.zeros_like(fields)], axis=1)
    centres, radii = stop_images(
        axes,
        diameters,
        distances,
        decentres,
        focal_length=design.f,
        focal_plane=design.d_f,
        mla_distance=design.d_1,
        sensor_distance=design.d_2,
    )
    radii = np.broadcast_to(radii, centres.shape[:-1])
    whole = np.pi * radii[:, 0] ** 2
    pupil = intersect(centres[:, :2], radii[:, :2]).area / whole
    bore = intersect(centres[:, 1:], radii[:, 1:]).area / whole
    both = intersect(centres, radii).area / whole
    misplaced = np.maximum(pupil - both, 0.0) + np.maximum(bore - both, 0.0)
    return EquivalentPupil(diameter, distance, fields, bore, pupil, misplaced)
