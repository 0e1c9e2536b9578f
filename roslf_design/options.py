"""Base of a job's options: one frozen value that the shell, Python and study files read."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from numbers import Integral
from typing import Annotated, Any, Self

import numpy as np
from pydantic import AfterValidator, BeforeValidator, ConfigDict, ValidationError

from .errors import Argument, InputError, refusal
from .toml_files import StrictTable, problems_of
from .units import FARTHEST, read_quantity

FileName = Annotated[str, BeforeValidator(lambda name: os.fspath(name) if isinstance(name, os.PathLike) else name)]
"""Name of a file, or of a preset."""

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


def up_to(most: int) -> AfterValidator:
    """Validator of counts from 1 on."""

    def check(count: int) -> int:
        if not 1 <= count <= most:
            raise ValueError(f"{count} is out of range; give a whole number from 1 to {most}")
        return count

    return AfterValidator(check)


class Options(StrictTable):
    """Options of a job; the text below a field is its help in the shell."""

    model_config = ConfigDict(use_attribute_docstrings=True)

    @classmethod
    def of(cls, **values: Any) -> Self:
        """Options from keywords; None is as good as left out.

        Raises
        ------
        InputError
            Every fault, by its keyword.
        """
        return cls(**{name: value for name, value in values.items() if value is not None})

    @classmethod
    def _refused(cls, error: ValidationError, data: Mapping[str, Any]) -> InputError:
        return cls.refused(error)

    @classmethod
    def refused(cls, error: ValidationError) -> InputError:
        """Faults that pydantic found, each by its keyword."""
        return InputError(tuple(Argument(problem.key, problem.message) for problem in problems_of(error, cls)))


def refuse_idle(options: Options, names: Iterable[str]) -> None:
    """Refuse options of a raw image where there are views.

    Raises
    ------
    InputError
        Each of them that is given.
    """
    message = "goes with a raw image, and these are views; leave it out"
    if idle := [name for name in names if getattr(options, name) is not None]:
        raise InputError(tuple(Argument(name, message) for name in idle))


Distance = float | str
"""Distance [mm], or text with its unit."""


def _millimetres(at: Distance | Sequence[Distance]) -> tuple[float, ...]:
    """One or several distances [mm]."""
    try:
        return tuple(
            read_quantity(one, "length") if isinstance(one, str) else float(one)
            for one in np.ravel(np.asarray(at, dtype=object)).tolist()  # numbers beside text stay numbers
        )
    except (TypeError, ValueError) as error:
        raise refusal("at", str(error)) from None


def one_distance(at: Distance | Sequence[Distance] | None) -> float | None:
    """Distance of what has a single one, from a number or a list of one; None where there is none.

    Raises
    ------
    InputError
        Several.
    """
    several = () if at is None else _millimetres(at)
    if len(several) > 1:
        raise refusal("at", f"{len(several)} distances given, and this has one; ask once for each")
    return several[0] if several else None


def check_distances(at: Distance | Sequence[Distance]) -> tuple[float, ...]:
    """Distances ahead of the tip [mm], one or several, each checked to be one.

    Raises
    ------
    InputError
        Text that is no length; what is not ahead of the tip.
    """
    several = _millimetres(at)
    for distance in several:
        if not 0 < distance <= FARTHEST["length"]:
            raise refusal(
                "at", f"{distance:g} mm is not ahead of the bore's tip, where it counts from; give more than 0"
            )
    return several
