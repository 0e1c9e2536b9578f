"""A design's faults: those of any input, under a name of their own."""

from __future__ import annotations

from ..errors import InputError, Problem

__all__ = ["DesignError", "InputError", "Problem"]


class DesignError(InputError):
    """A design (or its file) that cannot be used."""
