"""Statement on the accuracy of a computed result: method, expected and measured error, time."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Real
from typing import Any

from ..errors import refusal

LEAST = 1e-15


def check_accuracy(accuracy: float, least: float = LEAST, why: str = "") -> float:
    """Refuse what is no accuracy.

    Parameters
    ----------
    accuracy : float
        As asked for.
    least : float
        The finest that can be had.
    why : str
        What sets it; for the message.

    Raises
    ------
    InputError
        Not between `least` and 1.
    """
    if not (isinstance(accuracy, Real) and least <= accuracy <= 1):
        given = f"{accuracy:g}" if isinstance(accuracy, Real) else repr(accuracy)
        reason = f" ({why})" if why else ""
        raise refusal("accuracy", f"{given} is out of range; give {least:g} to 1, as 1e-3{reason}")
    return accuracy


@dataclass(frozen=True)
class Accuracy:
    """Accuracy of a result."""

    of: str
    """Subject of the errors."""
    unit: str
    """Unit of the errors in words; one that begins with % has them in hundredths."""
    method: str
    """Method by which it was computed, with its effort."""
    expected_error: float
    """At most, or in 95 % of cases where chance is in it."""
    measured_error: float | None = None
    """None where measuring would cost as much again, or nothing is sampled."""
    measured_by: str = ""
    """Way in which the error was measured; empty where it was not."""
    asked: float | None = None
    """Accuracy asked for; None where none was."""
    seconds: float | None = None
    """Seconds that the result took, checks included."""
    model: str = ""
    """Model error that no effort gets past, in words; empty where none is known."""
    scatter: float = 0.0
    """Relative standard error of the measured error itself."""
    sampling: float | None = None
    """Part of the expected error that samples leave; None where nothing is sampled, or it is not told apart."""
    known: str = ""
    """Statement of what is known to what, in words; empty: the subject to the expected error."""

    @property
    def kept(self) -> bool | None:
        """Whether what was asked for is kept, by what is expected and what was measured; None where nothing was."""
        if self.asked is None:
            return None
        measured = self.measured_error or 0.0
        return self.expected_error <= self.asked and measured <= self.asked * (1 + 2 * self.scatter)

    def to_dict(self, times: bool = False) -> dict[str, Any]:
        """JSON-ready; `times` adds what differs from run to run, which files that repeat themselves leave out."""
        statement: dict[str, Any] = {
            "of": f"{self.of} ({'0.01: 1 ' if self.unit.startswith('%') else 'in '}{self.unit})",
            "asked": self.asked,
            "method": self.method,
            "expected_error": self.expected_error,
            "measured_error": self.measured_error,
            "measured_by": self.measured_by or None,
            "kept": self.kept,
            "model_error": self.model or None,
        }
        statement |= {} if self.sampling is None else {"sampling_error": self.sampling}
        return statement | ({"seconds": self.seconds} if times else {})

    def sentence(self, times: bool = True) -> str:
        """Sentences for a terminal or a page: first what is known to what, then how that is known."""
        words = self.known or f"{self.of} known to ±{self._amount(self.expected_error)}"
        words = f"{words[:1].upper()}{words[1:]}"
        if self.asked is not None:
            words += f" (asked for {self._amount(self.asked)}{'' if self.kept else ': not met'})"
        if self.measured_error is not None:
            words += f". Measured: ±{self._amount(self.measured_error)} ({self.measured_by})"
        words += f". Method: {self.method}"
        if self.model:
            words += f"; {self.model}"
        if times and self.seconds is not None:
            words += f"; {self.seconds:{'.0f' if self.seconds >= 10 else '.2g'}} s"
        return words

    def _amount(self, error: float) -> str:
        """An error with its unit."""
        return f"{(100 if self.unit.startswith('%') else 1) * error:.2g} {self.unit}"
