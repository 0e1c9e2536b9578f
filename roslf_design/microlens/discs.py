"""For modules that are being moved."""

from ..shapes.discs import *  # noqa: F403
