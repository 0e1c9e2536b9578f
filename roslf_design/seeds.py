"""Seeds of random numbers, as files, the shell and Python take them."""

from __future__ import annotations

from numbers import Integral
from typing import Annotated

from pydantic import AfterValidator

from .errors import refusal

SEEDS = 2**63
"""Below which seeds lie: what files, generators and compiled kernels hold alike."""


def _usable_seed(seed: int) -> int:
    """Seed as it is.

    Raises
    ------
    ValueError
        Out of range.
    """
    if seed < 0:
        raise ValueError(f"{seed} is negative; give a whole number from 0")
    if seed >= SEEDS:
        raise ValueError("is too large; give a whole number below 2^63")
    return seed


def check_seed(seed: int) -> int:
    """Seed as it is; refused, by its keyword, where it is none."""
    if not isinstance(seed, Integral):
        raise refusal("seed", f"{seed!r} is no whole number; give one from 0")
    try:
        return _usable_seed(seed)
    except ValueError as error:
        raise refusal("seed", str(error)) from None


Seed = Annotated[int, AfterValidator(_usable_seed)]
"""Seed of random numbers."""
