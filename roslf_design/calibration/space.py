"""Space between boards and main lens: a calibration's fit knows the boards' space, the closed forms what is seen.

Boards are rigid where they stand, in the medium before the farthest element. What the main lens sees of that space is
nearer and perhaps of another size, so that a rigid board looks sheared. The fit therefore takes the camera as the
medium has it: with the plane matrix (a, b, c, d) of the farthest element's scene side (`..design.chain`) and the
medium's index n, the pupil stands where the medium sees it, mu = 1/(d - c d_3) times as large, and

    A' = n mu A,    m' = m (d - c d_f),    d_2' = n d_2,

in which every equation of the model keeps its form.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .._arrays import by_value
from ..bore.chain import ImagedPlane
from ..camera import Camera, Number
from ..design import Design
from ..design.parts import PATHS
from .frames import Array, CalibrationError


class ApparentCamera(NamedTuple):
    """The camera as the boards' medium has it."""

    A: Array
    """[mm]"""
    m: Array
    d_2: Array
    """[mm]"""
    pupil: Array
    """Where the medium has the FAP: before the main lens, a mechanical distance [mm]."""


@by_value
@dataclass(frozen=True)
class SceneSide:
    """Parts of a design before its main lens and about its array, to first order; numbers, or arrays over draws."""

    design: Design
    far: ImagedPlane
    """Plane of the farthest element's scene side."""
    end: Number
    """Distance of its scene side [mm before the main lens]."""
    near: ImagedPlane
    """Plane in which the design's FAP stands."""
    fap: float
    """[mm before the main lens]"""
    before_array: Number
    """Length that glass takes off d_1 [mm]."""
    behind_array: Number
    """Length that glass takes off d_2 [mm]."""
    upright: Number
    """1, or -1 where a relay turns the picture: A and m of the fit are positive."""

    @classmethod
    def of(cls, design: Design, changes: Mapping[str, Array] | None = None) -> SceneSide | None:
        """Space of a design, with numbers or arrays in some of its places; None where there is air only.

        Raises
        ------
        CalibrationError
            Its objective maps angles otherwise than f tan, which no parameter of the fit stands for; or the scene sees
            the FAP at infinity.
        """
        c = Camera.of(design, changes)
        if c.chain.in_air:
            return None
        if c.chain.mapped:
            raise CalibrationError(
                f"{c.chain.mapped}: a calibration takes rays before the objective as f tan has them; drop the mapping "
                "for it"
            )
        if np.any(c.chain.telecentric(c.numbers, c[PATHS["d_3"]])):
            raise CalibrationError(
                "aperture.distance: the scene sees the FAP at infinity (telecentric object space), where a calibration "
                "has no distance of it to tell; move the FAP off the focus of what stands before it"
            )
        if c.chain.stop_behind and np.any(np.greater(c.seen.d_3, 0)):
            raise CalibrationError(
                "aperture.behind: the scene sees the FAP at or beyond the boards, as it stands behind the main lens's "
                "focus: views part towards the scene there, and no calibration follows; move it nearer to the lens"
            )
        numbers = c.numbers
        end = c.chain.end(numbers)
        far = c.plane(np.nextafter(end, np.inf))
        before, behind = (part(numbers) for part in (c.chain.before_array, c.chain.behind_array))
        return cls(
            design,
            far,
            end,
            c.plane(design.d_3),
            design.d_3,
            before,
            behind,
            np.sign(c.seen.m * far.d - c.seen.d_1 * far.c),
        )

    def apparent(self, A: Array, m: Array, d_2: Array, d_3: Array, d_1: Array) -> ApparentCamera:
        """Camera of these lengths as the main lens sees them, as the boards' medium has it."""
        n, grown = self.far.medium, 1 / (self.far.d - d_3 * self.far.c)
        sign = self.upright
        # d_1 is m d_f also where the main lens sees the plane in focus at infinity, m = 0.
        return ApparentCamera(
            sign * n * grown * A, sign * (m * self.far.d - d_1 * self.far.c), n * d_2, _stands(self.far, self.end, d_3)
        )

    def seen(self, f: Array, A: Array, m: Array, d_2: Array) -> dict[str, Array]:
        """Lengths H, d_3, d_1, d_f, d_2, A and m as a main lens of focal length f sees them; the other way.

        Behind a relay m passes through 0, where d_f is infinite and nothing else.

        Raises
        ------
        ValueError
            f or m of the boards' medium is not positive.
        """
        n, c, d = self.far.medium, self.far.c, self.far.d
        if not (np.all(f > 0) and np.all(m > 0)):
            raise ValueError("focused at infinity or beyond")
        A, m = self.upright * A, self.upright * m
        m = (m + c * f) / (d - c * f)
        d_1 = f * (1 + m)
        scale = n * m - A * c
        d_3, A = (n * d_1 - A * d) / scale, A * (d * m - c * d_1) / scale
        with np.errstate(divide="ignore"):
            d_f, H = d_1 / m, d_1 / A
        return {"H": H, "d_3": d_3, "d_1": d_1, "d_f": d_f, "d_2": d_2 / n, "A": A, "m": m}

    def ruler(self, lengths: Mapping[str, Array]) -> dict[str, Array]:
        """d_3, d_1, d_f and d_2 as a ruler has them, and H of these, where `lengths` are seen [mm]."""
        d_3 = _stands(self.near, self.fap, lengths["d_3"])
        d_f = _stands(self.far, self.end, lengths["d_f"])
        d_1, d_2 = lengths["d_1"] + self.before_array, lengths["d_2"] + self.behind_array
        return {"H": d_f / (d_f - d_3), "d_3": d_3, "d_1": d_1, "d_f": d_f, "d_2": d_2}


def _stands(plane: ImagedPlane, at: Number, apparent: Array) -> Array:
    """Where a plane stands that is seen at a distance, in the space about a plane `at` [mm]."""
    far = np.abs(apparent) > 1  # at infinity even, where a relay shows it there
    z, w = np.where(far, 1.0, apparent), 1 / np.where(far, apparent, 1.0)
    return np.asarray(at + plane.medium * (z * plane.a - w * plane.b) / (w * plane.d - z * plane.c))


def as_shown(lengths: Mapping[str, Array], space: SceneSide | None) -> ApparentCamera:
    """The camera of `derived` lengths, as the boards' medium has it."""
    A, m, d_2, d_3, d_1 = (lengths[name] for name in ("A", "m", "d_2", "d_3", "d_1"))
    return ApparentCamera(A, m, d_2, d_3) if space is None else space.apparent(A, m, d_2, d_3, d_1)


def shown_by(design: Design, changes: Mapping[str, Array] | None = None) -> ApparentCamera:
    """A design as the boards' medium has it, with numbers or arrays in some of its places."""
    c = Camera.of(design, changes)
    lengths = {name: np.asarray(getattr(c.seen, name), float) for name in ("A", "m", "d_2", "d_3", "d_1")}
    return as_shown(lengths, SceneSide.of(design, changes))


# --- calibrated in one medium, used in another ------------------------------------------------------------------------


class MediumChange(NamedTuple):
    """Depths measured where a calibrated camera looks into another medium."""

    design: Design
    """The calibrated camera in that medium: what corrects them."""
    distances: Array
    """Distances of planes before the main lens, in that medium [mm]."""
    uncorrected: Array
    """Distance that the uncorrected calibration gives each [mm]."""
    end: float
    """Where the medium begins [mm before the main lens]."""

    @property
    def name(self) -> str:
        """The medium's, as a sentence has it."""
        name = self.design.object_space.medium.name
        return f"a medium of {name}" if name.startswith("n =") else name

    @property
    def error(self) -> Array:
        """Uncorrected less true [mm]."""
        return np.asarray(self.uncorrected - self.distances)

    @property
    def relative(self) -> Array:
        """Error relative to the distance in the medium."""
        return np.asarray(self.error / (self.distances - self.end))

    def to_dict(self) -> dict[str, object]:
        """Values as JSON's types."""
        medium = self.design.object_space.medium
        return {
            "medium": medium.name,
            "index": float(medium.index(self.design.wavelength)),
            "focal_plane_mm": self.design.d_f,
            "distances_mm": self.distances.tolist(),
            "uncorrected_mm": self.uncorrected.tolist(),
            "error_mm": self.error.tolist(),
            "error_relative": self.relative.tolist(),
        }


def in_medium(design: Design, medium: str) -> Design:
    """Design with the same hardware before another medium, by its name or index: d_f follows, f, d_1 and the FAP stay.

    Raises
    ------
    DesignError
        No such medium, nothing that seals it off, or nothing in focus there.
    """
    try:
        what: object = {"index": float(medium)}
    except ValueError:
        what = medium
    return design.replace({"object_space.medium": what}, d_1=design.d_1)


def used_in(calibrated: Design, medium: str, distances: Array) -> MediumChange:
    """Depths read in another medium with a calibration left as it is.

    Parameters
    ----------
    calibrated : Design
        In the medium of its boards.
    medium : str
        Name or index.
    distances : ndarray
        Planes [mm before the main lens] that are seen in the boards' medium; those seen alike in the other are told of.
    """
    there = in_medium(calibrated, medium)
    made, used = Camera.of(calibrated), Camera.of(there)
    planes = np.asarray(used.plane_seen_at(made.plane(distances).distance))
    # Eq. 12: what slope a point there has, and which depth has it in the calibrated camera.
    slope = (used.seen.m - used.seen.A / (used.plane(planes).distance - used.seen.d_3)) * used.seen.A / used.seen.d_2
    uncorrected = made.plane_seen_at(made.seen.d_3 + made.seen.A / (made.seen.m - slope * made.seen.d_2 / made.seen.A))
    return MediumChange(there, planes, np.asarray(uncorrected), float(used.chain.end(used.numbers)))
