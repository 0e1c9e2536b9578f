"""What is wrong with an input, every fault at once, each with its place and its remedy."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Problem:
    """One fault of an input: where it is, what is wrong, what to do."""

    key: str
    """Dotted place in the file, e.g. ``aperture.distance``; empty for the file as a whole."""
    message: str
    """What is wrong, with the value, and the remedy."""

    def __str__(self) -> str:
        return f"{self.key}: {self.message}" if self.key else self.message


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
        return "\n".join(f"{start}{problem}" for problem in self.problems)
