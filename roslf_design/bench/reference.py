"""White image that a bench's other images are held against: light in the dark, microlens images elsewhere."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..calibration.centres import find_centres
from ..calibration.decoding import Decoder
from ..calibration.designed import image_pitch, undistorted_radius
from ..calibration.frames import Array, CalibrationError, ColourBalance, Frame, Image, grey_frame, same_size
from ..calibration.lattice import CentreLattice
from ..calibration.raw import OTHER_CAMERA
from ..design import Design
from ..theory.colours import filters

_LEAK = 0.01
"""Share of the white image in a dark frame that counts as light."""
_MOVED = 0.03
"""Shift of centres at the image's edge that counts as one [px]."""
_SURE = 5.0
_FEWEST, _MOST_LENSES = 20, 20_000
"""Microlenses that are compared at least and at most."""
_CORE = 0.3
"""Least light of a microlens whose centre is compared, over the brightest's."""


def leak(white: Image, dark: Image) -> str:
    """Fault of a dark frame in which the white image shows."""
    if white.shape != dark.shape:
        return "is of another size than the white image; use one camera setting"
    even = grey_frame(white)
    apart = even - even.mean(dtype=float)
    share = float((apart * grey_frame(dark)).mean(dtype=float) / max(np.square(apart).mean(dtype=float), 1e-30))
    return f"light in the dark frame: {100 * share:.2g} % of the white image's; put the cap on" if share > _LEAK else ""


@dataclass(frozen=True, eq=False)
class Reference:
    """White image that all others are held against."""

    name: str
    even: Frame
    dark: Image | None
    balance: ColourBalance | None
    lattice: CentreLattice
    decoder: Decoder

    @classmethod
    def of(cls, design: Design, name: str, white: Image, dark: Image | None) -> Reference:
        """Reference of a white image; `CalibrationError` where it is none of this camera."""
        balance = ColourBalance.of(white, dark) if filters(design.sensor.colours) else None
        if balance is not None:
            white, dark = balance(white, "white image"), None
        pitch, radius = image_pitch(design), undistorted_radius(design) or None
        layout = design.microlens_array.layout
        lattice = find_centres(white, dark, layout=layout, pitch=pitch, undistorted_radius=radius).lattice
        if abs(lattice.pitch / pitch - 1) > OTHER_CAMERA:
            raise CalibrationError(f"its microlens images stand {lattice.pitch:.4g} px apart, the design's {pitch:.4g}")
        decoder = Decoder.of(lattice, white.shape, white=white, dark=dark)
        return cls(name, grey_frame(white, dark, "white image"), dark, balance, lattice, decoder)

    def frame(self, pixels: Image, name: str) -> Image:
        """Pixels as the decoder takes them; `CalibrationError` where they are of another size."""
        same_size(name, pixels.shape, "white image", self.even.shape)
        return pixels if self.balance is None else self.balance(pixels, name)

    def moved(self, pixels: Image, name: str) -> str:
        """Fault of an image whose microlens images are not where the white image has them."""
        try:
            shift = _shifted(self.even, grey_frame(self.frame(pixels, name), self.dark, name), self.lattice)
        except CalibrationError as error:
            return " ".join(str(error).split())
        return "" if shift is None or not shift.real else shift.words

    @property
    def middle(self) -> Array:
        """Middle of the array as decoded [pitches]."""
        i, j = self.lattice.indices((np.array(self.even.shape[::-1]) - 1) / 2)
        return np.array([i, j] if self.lattice.layout == "square" else [i + j / 2, math.sqrt(3) / 2 * j])


class _Shift(NamedTuple):
    """How far microlens images lie from those of the white image."""

    offset: tuple[float, float]
    """In the middle [px]."""
    growth: float
    """Growth of the pitch, relative."""
    edge: float
    """Largest shift, at the image's edge [px]."""
    error: float
    """Standard deviation of that [px]."""

    @property
    def real(self) -> bool:
        """Whether it is one."""
        return self.edge > max(_MOVED, _SURE * self.error)

    @property
    def words(self) -> str:
        """Fault that it is."""
        return (
            f"refocused, or moved, since the white image: microlens images lie {self.edge:.2f} px off at the"
            f" edge (pitch {1e6 * self.growth:+.0f} ppm, middle {self.offset[0]:+.2f}, {self.offset[1]:+.2f} px);"
            " capture both anew"
        )


def _shifted(white: Frame, frame: Frame, lattice: CentreLattice) -> _Shift | None:
    """Shift of an image's microlens images against the white image's; None where too few are lit evenly.

    Each microlens's pixels are a multiple of the white image's and of its two slopes, whose shares are the shift.
    Scenes that are brighter on one side of a microlens image shift it as well, one way here, the other way there: the
    lattice's common shift and growth are fitted with what lies far off left out.
    """
    half = int(lattice.pitch // 2)
    nodes = lattice.nodes(*lattice.inside(white.shape).T)
    nodes = nodes[((nodes >= half + 2) & (nodes < np.array(white.shape[::-1]) - half - 3)).all(axis=1)]
    nodes = nodes[:: 1 + len(nodes) // _MOST_LENSES]
    if len(nodes) < _FEWEST:
        return None
    at = np.rint(nodes).astype(int)
    side = np.arange(-half, half + 1)
    rows, columns = at[:, 1, None, None] + side[:, None], at[:, 0, None, None] + side
    slopes = [-np.asarray(np.gradient(white, axis=axis)) for axis in (1, 0)]
    parts = np.stack([part[rows, columns].reshape(len(at), -1) for part in (white, *slopes)], axis=-1)
    seen = frame[rows, columns].reshape(len(at), -1, 1).astype(float)
    across = np.swapaxes(parts, 1, 2).astype(float)
    lift = 1e-9 * np.trace(across @ parts, axis1=1, axis2=2) + 1e-30  # some microlenses may have no light at all
    normal = across @ parts + lift[:, None, None] * np.eye(3)
    shares = np.linalg.solve(normal, across @ seen)[..., 0]
    rest = np.square(seen - parts @ shares[..., None]).mean(axis=(1, 2)) / np.maximum(
        np.square(seen).mean(axis=(1, 2)), 1e-30
    )
    lit = (shares[:, 0] > _CORE * np.quantile(shares[:, 0], 0.9)) & (rest <= np.median(rest))
    if lit.sum() < _FEWEST:
        return None
    middle = (np.array(white.shape[::-1]) - 1) / 2
    away, off = (nodes - middle)[lit], shares[lit, 1:] / shares[lit, :1]
    matrix = np.zeros((len(off), 2, 3))
    matrix[:, 0, 0] = matrix[:, 1, 1] = 1.0
    matrix[:, :, 2] = away
    near = np.ones(len(off), bool)
    for _ in range(5):
        design, target = matrix[near].reshape(-1, 3), off[near].ravel()
        best = np.linalg.lstsq(design, target, rcond=None)[0]
        gone = np.hypot(*(off - matrix @ best).T)
        near = gone <= 3 * np.median(gone)
    spread = float(np.sqrt(np.square((off - matrix @ best)[near]).mean()))
    errors = spread * np.sqrt(np.diag(np.linalg.inv(matrix[near].reshape(-1, 3).T @ matrix[near].reshape(-1, 3))))
    reach = float(np.hypot(*middle))
    edge = float(np.hypot(best[0], best[1])) + abs(float(best[2])) * reach
    return _Shift((float(best[0]), float(best[1])), float(best[2]), edge, float(np.hypot(errors[0], errors[2] * reach)))
