"""Base of a job's options: one frozen value that the shell, Python and study files read."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from typing import Annotated, Any, Self

from pydantic import AfterValidator, BeforeValidator, ConfigDict, ValidationError

from .errors import Argument, InputError
from .toml_files import StrictTable, problems_of

FileName = Annotated[str, BeforeValidator(lambda name: os.fspath(name) if isinstance(name, os.PathLike) else name)]
"""Name of a file, or of a preset."""


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
