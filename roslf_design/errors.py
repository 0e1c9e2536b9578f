"""Faults of an input, all at once, each with its place and its remedy."""

from __future__ import annotations

import os
import re
import unicodedata
from dataclasses import dataclass
from pathlib import Path

OTHER_PLACE = "delete it or choose another place"
"""Remedy where something else lies in the way of what is to be written."""
LONGEST = 1600
"""Letters of one line; of what is longer the middle is left out."""


def printable(text: str, kept: str = "") -> str:
    """Text as a terminal may show it: what would steer it (escapes, other lines, reversed writing) is spelled out.

    Parameters
    ----------
    text : str
        As a user, or a file, gave it.
    kept : str
        Letters that stay as they are, such as a newline.
    """
    if text.isprintable():
        return text
    spaces = (unicodedata.category(c) == "Zs" for c in text)
    return "".join(
        c if c.isprintable() or space or c in kept else c.encode("unicode_escape").decode()
        for c, space in zip(text, spaces, strict=True)
    )


def one_line(text: str) -> str:
    """Text as one line of an error, cut where it is very long."""
    text = printable(text)
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 200]} [...] {text[-200:]}"


@dataclass(frozen=True)
class Problem:
    """One fault of an input: where it is, what is wrong, what to do."""

    key: str
    """Dotted place in the file, e.g. ``aperture.distance``; empty for the file as a whole."""
    message: str
    """Message: the fault, with the value, and the remedy."""

    def __str__(self) -> str:
        return f"{self.key}: {self.message}" if self.key else self.message

    def in_shell(self) -> Problem:
        """Fault as the shell tells it."""
        return self


@dataclass(frozen=True)
class Argument(Problem):
    """One fault of an argument: its key is a keyword in Python, and an option in the shell.

    Other arguments that the message names stand in backticks.
    """

    def in_shell(self) -> Problem:
        """Fault as the shell tells it: arguments are options."""
        return Problem(_option(self.key) if self.key else "", with_options(self.message))


def _option(name: str) -> str:
    """Option of the shell that a keyword stands for; one given several times has no number there."""
    return "-o" if name == "output" else f"--{re.sub(r'[.][0-9]+$', '', name).replace('_', '-')}"


def with_options(text: str) -> str:
    """Text whose arguments, in backticks, are options of the shell."""
    return re.sub("`([a-z][a-z_]*)`", lambda match: _option(match[1]), text)


class InputError(ValueError):
    """An input (a design, a scene, a study, an option) that cannot be used; the shell exits with code 2.

    Parameters
    ----------
    problems : tuple of Problem
        Every fault that was found, never just the first.
    origin : str
        Name of the file, or "" for values made in Python.
    """

    def __init__(self, problems: tuple[Problem, ...], origin: str = "") -> None:
        self.problems = tuple(problems)
        self.origin = origin
        super().__init__(str(self))

    def __reduce__(self) -> tuple[type[InputError], tuple[tuple[Problem, ...], str]]:
        return type(self), (self.problems, self.origin)

    def __str__(self) -> str:
        start = f"{self.origin}: " if self.origin else ""
        return "\n".join(one_line(f"{start}{problem}") for problem in self.problems)

    def in_shell(self) -> InputError:
        """Error as the shell tells it: arguments are options."""
        return type(self)(tuple(problem.in_shell() for problem in self.problems), self.origin)


def refusal(name: str, message: str) -> InputError:
    """Argument that cannot be had; `name` is its keyword."""
    return InputError((Argument(name, message),))


def expect(value: object, name: str, kinds: type | tuple[type, ...], what: str) -> None:
    """Refusal of an argument that is of no such kind; `what` says in words what it is to be."""
    if not isinstance(value, kinds):
        given = "None" if value is None else type(value).__name__
        raise refusal(name, f"takes {what}; got {given}")


def path_of(value: object, name: str, what: str) -> Path:
    """Path that an argument gives, as text or as a path; `what` says in words what lies there."""
    expect(value, name, (str, os.PathLike), f"the path of {what}")
    return Path(value)  # type: ignore[arg-type]


FAULTS = (ArithmeticError, LookupError, MemoryError, RuntimeError, TypeError, ValueError)
"""Exceptions in which computations end where numbers lie far from any camera's."""


def cause(error: Exception) -> str:
    """Why a computation ended in one of `FAULTS`, on one line, and what to do."""
    if isinstance(error, ValueError):
        return one_line("; ".join(str(error).splitlines()) or type(error).__name__)
    detail = " ".join(str(error).split()) or type(error).__name__
    what = "there is not enough memory" if isinstance(error, MemoryError) else "a number went out of bounds"
    return one_line(f"{what} ({detail}); check the input for values far from any camera's")
