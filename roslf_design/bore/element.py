"""The questions that every element before the main lens answers.

An element's `distance` is that of its sensor-side vertex from the main lens, as measured with a ruler. Whoever walks
the bore asks every element the same questions; a new kind of element is a class of its own that answers those whose
answers here are not its own, and a line in `elements.AnyElement`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._arrays import Array
from ..lenses.angles import F_TAN, AngleMap
from ..units import Distance, Length
from .export import SequenceRow
from .faces import Face, Surroundings
from .part import GivenName, Number, Offset, OpticalPart, PartNumbers, Tilt

Matrix = tuple[Number, Number, Number, Number]
"""A, B, C and D of light towards the sensor, its slopes times index."""
Outline = NDArray[np.float64]
"""Points (z, x) of a face in the plane x-z [mm], shape (N, 2)."""
Flags = np.bool_ | NDArray[np.bool_]
Shift = tuple[Number, Number]
"""Along one axis, where the main lens's axis is [mm], and index times its slope."""


class Element(OpticalPart):
    """Something transparent before the main lens."""

    distance: Distance
    """Main lens to the sensor-side vertex [mm]."""
    diameter: Length | None = None
    """Clear aperture, of both faces [mm]; None lets everything through."""
    decentre: Offset = (0.0, 0.0)
    """Offset from the axis [mm]."""
    tilt: Tilt = (0.0, 0.0)
    """About the sensor-side vertex [rad]."""
    name: GivenName | None = None
    """Name on pages and in tables, such as "ocular"; by its kind and number, "lens 1", where none is given."""

    number_keys: ClassVar[tuple[str, ...]] = ("distance", "diameter")
    """Its lengths and other numbers, as far as it has them."""
    poses: ClassVar[tuple[str, ...]] = ("decentre", "tilt")
    """Its pairs of numbers that are 0 where it stands straight."""
    bends: ClassVar[bool] = True
    """Whether it changes the size in which things are seen."""
    seals: ClassVar[bool] = False
    """Whether its last face is what a liquid before it ends at; else that is a window of no thickness."""
    round_when_seen: ClassVar[bool] = True
    """Whether each of its openings, looked at through it, is one upright circle."""
    steps: ClassVar[int] = 1
    """Straight pieces as which the course of a ray inside it is drawn."""
    cores: ClassVar[tuple[float, ...]] = ()
    """Shares of its radius within which it is denser."""
    power_sign: ClassVar[int] = 0
    """1 where a thin lens stands for it in a schematic drawing, -1 a diverging one, 0 a block."""
    catalogue: ClassVar[tuple[Literal["windows"], ...]] = ()
    """Kinds of a catalogue's parts that it can be."""
    maps: ClassVar[bool] = False
    """Whether a mapping of angles can be chosen for it."""
    turn: ClassVar[float] = 0.0
    """Angle by which it turns the axis [rad]."""
    towards: ClassVar[float] = 0.0
    """Direction into which it turns the view, across the axis from x towards y [rad]."""
    bounces: ClassVar[int] = 0
    """How often light is reflected in it."""
    leans: ClassVar[bool] = False
    """Whether its clear aperture leans where it stands straight."""
    signed: ClassVar[tuple[str, ...]] = ()
    """Keys of its numbers that may have either sign."""
    sealable: ClassVar[bool] = True
    """Whether a liquid before it may end at it."""
    shortest: ClassVar[float] = 0.0
    """Length below which it has no room for its clear aperture [mm]."""
    trade_name: ClassVar[str] = ""
    """Name under which it is bought; its kind without."""

    @property
    def reverses(self) -> bool:
        """Whether pictures are reversed by it: it reflects an odd number of times."""
        return self.bounces % 2 == 1

    @property
    def length(self) -> float:
        """Length from its sensor-side vertex to the one that faces the scene [mm]."""
        return float(getattr(self, "thickness", 0.0))

    @property
    def angle_map(self) -> AngleMap:
        """Mapping of angles."""
        return F_TAN

    @property
    def mapping_name(self) -> str:
        """Name of its mapping of angles; empty where that is f tan."""
        return ""

    @property
    def half_height(self) -> float | None:
        """Half of its height [mm]; None where it fills the bore."""
        return None if self.diameter is None else self.diameter / 2

    @property
    def bought(self) -> str:
        """Name of the product that it is; empty where it is made."""
        return ""

    def numbers(self) -> Iterator[tuple[str, float]]:
        """Numbers of the element by their keys, the index apart."""
        yield from ((key, float(value)) for key in self.number_keys if (value := getattr(self, key)) is not None)
        yield from ((f"{pose}.{axis}", float(getattr(self, pose)[axis])) for pose in self.poses for axis in (0, 1))

    def span(self, at: PartNumbers) -> Number:
        """Length along the axis in the camera [mm]."""
        return at.get("thickness", self.length)

    def forward(self, at: PartNumbers, inside: Number, passed: Flags) -> Matrix:
        """Matrix of the way through as much of it as lies `inside` [mm], of a thin one where it is `passed`."""
        raise NotImplementedError

    def lean(self, at: PartNumbers) -> tuple[Number, Number]:
        """Tilt of its openings [rad]."""
        return at.pair("tilt")

    def kick(self, at: PartNumbers, axis: int) -> Number:
        """Index times slope that its own shape adds to light along the axis."""
        return 0.0

    def shifted(
        self, at: PartNumbers, axis: int, forward: Matrix, inside: Number, shift: Shift, beyond: Number
    ) -> Shift:
        """Main lens's axis as it comes out of it, decentred and tilted as it is.

        Parameters
        ----------
        axis : int
            0 along x, 1 along y.
        forward : Matrix
            What `forward` says of as much of it.
        inside : float or ndarray
            How much of it light has passed [mm].
        shift : Shift
            Where that axis goes in.
        beyond : float or ndarray
            Index of what lies on its scene's side.
        """
        (p, q, r, s), (e, f) = forward, shift
        off = at.pair("decentre")[axis] - at.numbers[f"main_lens.decentre.{axis}"]
        # The normal of a part tilted by (t_x, t_y) leans by t_y along x and by -t_x along y.
        lean = np.tan(at.pair("tilt")[1 - axis]) * (1 if axis == 0 else -1)
        e, f = e - off, f - lean
        kick = self.kick(at, axis)
        if np.any(kick):
            f = f + kick * (inside > 0)
        # A leaning face between air and liquid bends the axis.
        return s * e - q * f + off - lean * inside, -r * e + p * f + lean * beyond

    def block_reach(self, at: PartNumbers) -> Number:
        """Farthest corner of a square block from the axis it stands on [mm]; 0 of what is round."""
        return 0.0

    def petzval(self, at: PartNumbers) -> Number:
        """Part of the Petzval sum, power over index [1/mm]; none of flat faces."""
        return 0.0

    def openings(self, at: PartNumbers) -> Iterator[tuple[str, Number]]:
        """Openings of its clear aperture: words after its name, and places before the main lens [mm]."""
        start, length = at["distance"], self.span(at)
        if np.ndim(length) == 0 and length == 0:
            yield "", start
        else:
            yield ", back", start
            yield ", front", start + length

    def faces(self, at: PartNumbers, name: str, around: Surroundings) -> list[Face]:
        """Faces that light meets, from the sensor's side on."""
        raise NotImplementedError

    def lengthened(self, at: PartNumbers, before: Number, after: Number) -> tuple[Number, Number]:
        """Length at one temperature [mm], and how many times as long it is at another [degrees C]."""
        return at.get("thickness", 0.0), 1.0 if self.glass is None else self.glass.grown(before, after)

    def reach(self, diameter: Number, height: Number) -> Number:
        """How far along the axis it sticks out of its length within a height [mm], where its clear aperture is that."""
        return 0.0

    def moved(self, at: PartNumbers, before: Number, after: Number) -> dict[str, Number]:
        """Numbers beside lengths, poses and index that change between two temperatures, by their keys."""
        return {}

    def profile(self, ends: tuple[float, float], thick: float) -> list[tuple[Outline, Outline]]:
        """Left and right faces of each of its pieces in the plane x-z, from the lower to the upper end.

        Parameters
        ----------
        ends : (low, high)
            Its rims [mm]; a prescription has its own.
        thick : float
            How thick an ideal lens, which has no thickness, is drawn [mm].
        """
        return [(face(ends, -self.distance - self.length), face(ends, -self.distance))]

    def body(self, half: float, thick: float) -> list[tuple[Outline, Outline]]:
        """Left and right faces in its own plane x-z, as far as `half` from its middle [mm]; see `profile`."""
        return self.profile((-half, half), thick)

    def rows(self, name: str, at: float, semi: float) -> list[SequenceRow]:
        """Surfaces as other programs take them.

        Parameters
        ----------
        name : str
        at : float
            Its sensor-side vertex behind the main lens's reference plane [mm].
        semi : float
            Semi-diameter [mm].

        Raises
        ------
        ValueError
            No surface stands for it; says what it is.
        """
        raise ValueError(f"an element of kind {getattr(self, 'kind', type(self).__name__)}")

    def words(self) -> tuple[str, ...]:
        """Description in a few words each: size and material, focal length, deviation."""
        return ()

    def incidence(self, wavelength: float, sines: Array) -> tuple[float, float] | None:
        """Least angle at which rays meet a face that reflects in glass, and that of total reflection there [degrees].

        None where there is no such face, or it is not known where it stands. `sines` are those of the rays before it,
        times the index, across the axis: shape (..., 2).
        """
        return None

    def reflects(self, wavelength: float, beyond: float) -> tuple[str, float] | None:
        """Key and angle from the normal [degrees] of a face that totally reflects light along the axis; None without.

        `beyond` is the index of what lies on its scene's side.
        """
        return None


def face(ends: tuple[float, float], z: ArrayLike, half: float | None = None, points: int = 25) -> Outline:
    """Points of a face between two rims, at heights z [mm]; `half` is its own half height."""
    t, middle, radius = np.linspace(-1, 1, points), (ends[0] + ends[1]) / 2, (ends[1] - ends[0]) / 2
    return np.stack([np.broadcast_to(z, t.shape), middle + (radius if half is None else half) * t], -1)


def degrees(cosine: float) -> float:
    """Angle of a cosine, rounding beyond 1 left out."""
    return math.degrees(math.acos(max(-1.0, min(1.0, cosine))))
