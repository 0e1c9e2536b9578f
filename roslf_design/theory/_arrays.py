"""For modules that are being moved."""

from .._arrays import Array, floats, product, ratio

__all__ = ["Array", "floats", "product", "ratio"]
