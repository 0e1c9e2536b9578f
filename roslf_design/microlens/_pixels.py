"""For modules that are being moved."""

from ..shapes.coverage import LARGEST_RADIUS, coverage

__all__ = ["LARGEST_RADIUS", "coverage"]
