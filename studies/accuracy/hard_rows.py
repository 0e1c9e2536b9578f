"""The rows of the hard cases: closed forms, shapes and fits."""

from __future__ import annotations

from .hard_cases import HardCase
from .hard_fits import FITS
from .hard_forms import FORMS
from .hard_shapes import SHAPES


def all_cases() -> tuple[HardCase, ...]:
    """Every row."""
    return (*FORMS, *SHAPES, *FITS)
