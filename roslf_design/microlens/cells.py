"""For modules that are being moved."""

from ..shapes.cells import *  # noqa: F403
