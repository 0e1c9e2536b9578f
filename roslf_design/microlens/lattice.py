"""For modules that are being moved."""

from ..shapes.lattice import *  # noqa: F403
