"""For modules that are being moved."""

from ..shapes.ellipses import *  # noqa: F403
