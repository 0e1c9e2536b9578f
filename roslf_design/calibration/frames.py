"""Raw frames: grey levels as float32, dark frame taken off, sizes and saturation checked."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import CalibrationError

Frame = NDArray[np.float32]
_FULL = tuple(2**bits - 1 for bits in (8, 10, 12, 14))


def grey_frame(image: ArrayLike | None, dark: ArrayLike | None = None, name: str = "image") -> Frame:
    """One grey frame from a grey or colour image, minus its dark frame.

    Parameters
    ----------
    image : array_like
        Shape (rows, columns) or (rows, columns, channels); channels are averaged.
    dark : array_like, optional
        Frame taken without light, same size.
    name : str
        What the image is, for the messages.

    Raises
    ------
    CalibrationError
        If the image is missing, not an image, not finite, or its dark frame has another size.
    """
    if image is None:
        raise CalibrationError(f"the {name} is missing: give one frame of the same camera setting")
    frame = _grey(np.asarray(image), name)
    if dark is not None:
        black = _grey(np.asarray(dark), "dark frame")
        same_size(name, frame.shape, "dark frame", black.shape)
        frame = frame - black
    return frame


def same_size(name: str, shape: tuple[int, ...], other: str, other_shape: tuple[int, ...]) -> None:
    """Demand two frames of one size.

    Raises
    ------
    CalibrationError
        Naming both frames and both sizes.
    """
    if shape[:2] != other_shape[:2]:
        sizes = f"{shape[1]} x {shape[0]} px and {other_shape[1]} x {other_shape[0]} px"
        raise CalibrationError(f"the {name} and the {other} differ in size ({sizes}): use frames of one camera setting")


def saturation_level(image: ArrayLike) -> float:
    """Level at which a pixel of this raw image is saturated: its integer type's largest value, or infinity for floats.

    Sensors with fewer bits than their file saturate lower: where at least 0.1 % of the pixels share the largest value
    found and that is the end of 8, 10, 12 or 14 bits, it is the level.
    """
    raw = np.asarray(image)
    if raw.dtype.kind not in "ui":
        return float("inf")
    top = int(raw.max())
    piled = top in _FULL and np.count_nonzero(raw == top) >= max(0.001 * raw.size, 16)
    return float(top) if piled else float(np.iinfo(raw.dtype).max)


def refuse_saturated(image: ArrayLike, name: str, level: float | None = None) -> None:
    """Demand that fewer than 5 % of an image's pixels are saturated.

    Raises
    ------
    CalibrationError
        Naming the image, the share and the level.
    """
    top = saturation_level(image) if level is None else level
    share = float(np.mean(np.asarray(image) >= top))
    if share > 0.05:
        raise CalibrationError(f"the {name} is saturated: {100 * share:.0f} % of its pixels reach {top:g}; expose less")


def _grey(image: NDArray[np.generic], name: str) -> Frame:
    if image.ndim == 3:
        image = image.mean(axis=2)
    if image.ndim != 2 or min(image.shape) < 8 or image.dtype.kind not in "buif":
        raise CalibrationError(f"the {name} is no image: array of shape {image.shape} and type {image.dtype}")
    frame = np.ascontiguousarray(image, np.float32)
    if not np.isfinite(frame).all():
        raise CalibrationError(f"the {name} has pixels that are not finite numbers")
    return frame
