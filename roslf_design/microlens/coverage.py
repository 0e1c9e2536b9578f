"""For modules that are being moved."""

from ..shapes.coverage import *  # noqa: F403
