"""Table of each method's cost and error, and the cheapest method that keeps a promise.

>>> choose("kept fraction", 1e-6).method
'closed form'

The table is measured by the study `studies/accuracy`: shipped, or the user's own from ``roslf accuracy calibrate``.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

from ..errors import InputError, Problem, refusal
from ..input_files import read_json
from .statement import check_accuracy

SCHEMA = "roslf.accuracy-table/1"
SHIPPED = "default_table.json"

QUANTITIES: dict[str, str] = {
    "kept fraction": "share of the pupil's light that one microlens gets; error absolute",
    "centroid": "centroid of the microlens image; error over the radius of the pupil's image",
    "area": "area of the microlens image; error relative",
    "pixel image": "light of each pixel behind one microlens, by rays; largest error, 1 is a fully lit pixel",
    "diffraction image": "pixels with the microlens's diffraction, all neighbours alike; largest error",
    "cut diffraction image": "diffraction image of one microlens alone behind a pupil that rims cut; largest error",
    "textured image": "pixels by rays, of a sinusoid off the focal plane; largest error",
    "real lens": "rays of one microlens through a real lens; largest miss on the focal plane over its sample there",
    "depth": "half of the range of depths that holds 68.3 % of measurements; error relative",
}
"""Quantities, and what the error of each means."""

SAFETY = {
    "Monte Carlo": 2.5, "scrambled Sobol": 2.5, "grid": 2.0, "Gauss panels": 3.0, "arc integrals": 3.0,
    "adaptive quadrature": 3.0, "FFT": 4.0, "direct Huygens": 2.0,
}  # fmt: skip
"""How much worse than its worst measured case a method is taken to be (others: 1.5). Errors of samples scatter,
exact ones do not."""

FINEST = 4e-13
"""Accuracy below which rounding rules every method."""


@dataclass(frozen=True)
class Row:
    """Error and cost of one method at one level."""

    quantity: str
    method: str
    level: int
    error: float
    """Largest error over all jobs and seeds it was measured on."""
    seconds: float
    """Median time on the first job."""
    work: float
    """Work of the first job."""
    fixed: float
    """Part of the time that does not grow with work [s]."""

    def seconds_for(self, work: float) -> float:
        """Time expected for another job."""
        return self.fixed + (self.seconds - self.fixed) * work / self.work

    @property
    def expected_error(self) -> float:
        """At most, for a job like those it was measured on."""
        return max(self.error * SAFETY.get(self.method, 1.5), FINEST if self.error < FINEST else 0.0)


@dataclass(frozen=True, eq=False)
class AccuracyTable:
    """All rows, and where they were measured."""

    rows: tuple[Row, ...]
    machine: str
    """Python, numpy, processor; empty where unknown."""

    def of(self, quantity: str) -> tuple[Row, ...]:
        """Rows of one quantity, methods together, levels rising."""
        return tuple(row for row in self.rows if row.quantity == quantity)

    def to_json(self) -> str:
        """Text of a table file."""

        def short(value: Any) -> Any:
            return float(f"{value:.4g}") if isinstance(value, float) else value

        rows = [{key: short(value) for key, value in asdict(row).items()} for row in self.rows]
        lines = ",\n  ".join(json.dumps(row, allow_nan=False) for row in rows)
        head = json.dumps({"schema": SCHEMA, "machine": self.machine})[:-1]
        return f'{head}, "rows": [\n  {lines}\n]}}\n'


def _read_table(path: Path) -> AccuracyTable:
    """A table file.

    Raises
    ------
    InputError
        Not such a file.
    """
    remedy = "make a new one with: roslf accuracy calibrate"
    data = read_json(path, str(path), remedy)
    try:
        if data["schema"] != SCHEMA:
            raise ValueError(data["schema"])
        rows = tuple(Row(**row) for row in data["rows"])
        numbers = [number for row in rows for number in (row.level, row.error, row.seconds, row.work, row.fixed)]
        if not all(isinstance(number, int | float) and 0 <= number < math.inf for number in numbers):
            raise ValueError("a number is missing, negative or none")
        return AccuracyTable(rows, str(data["machine"]))
    except (ValueError, KeyError, TypeError) as error:
        message = f"is no accuracy table ({error}); {remedy}"
        raise InputError((Problem("", message),), str(path)) from None


def cache_file() -> Path:
    """Path of the user's own table."""
    fallback = os.environ.get("LOCALAPPDATA") or str(Path.home() / ".cache")
    return Path(os.environ.get("XDG_CACHE_HOME") or fallback) / "roslf" / "accuracy.json"


@cache
def current_table() -> AccuracyTable:
    """The user's own table where there is one, else the shipped one; read once."""
    own = cache_file()
    return _read_table(own) if own.is_file() else shipped_table()


@cache
def shipped_table() -> AccuracyTable:
    """Measured on another machine: errors hold here as well, times only in proportion."""
    return _read_table(Path(__file__).with_name(SHIPPED))


# --- the choice -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Choice:
    """A method for a job, before it is run."""

    quantity: str
    accuracy: float
    """Largest error allowed in the result, as `QUANTITIES` says for each quantity."""
    method: str
    level: int
    expected_error: float
    """At most, as measured on jobs of all kinds, with a margin."""
    expected_seconds: float
    attainable: bool
    """False where no method reaches the accuracy: this is then the most accurate one."""


def choose(quantity: str, accuracy: float, table: AccuracyTable | None = None) -> Choice:
    """Cheapest method for a quantity of one microlens; `ranked` has all.

    Parameters
    ----------
    quantity : str
        One of `QUANTITIES`.
    accuracy : float
        What the result may be off by.
    table : Table, optional
        None is the user's own, or the shipped one.

    Raises
    ------
    InputError
        No such quantity, an accuracy out of range.
    """
    check_quantity(quantity)
    return ranked(quantity, accuracy, table)[0]


def check_quantity(quantity: str) -> None:
    """Refuse what is no quantity.

    Raises
    ------
    InputError
    """
    if quantity not in QUANTITIES:
        known = ", ".join(QUANTITIES)
        raise refusal("quantity", f'no quantity is called "{quantity}"; there are {known}')


def ranked(
    quantity: str,
    accuracy: float,
    table: AccuracyTable | None = None,
    *,
    work: Callable[[Row], float] = lambda row: row.work,
    able: Callable[[Row], bool] = lambda row: True,
) -> tuple[Choice, ...]:
    """Methods that keep the promise, cheapest first; where none does, the most accurate one alone.

    Parameters
    ----------
    quantity : str
    accuracy : float
    table : Table, optional
        None is the user's own, or the shipped one.
    work : callable
        Of a row's method at its level on the job at hand; by default that of the job it was measured on.
    able : callable
        Whether a row's method can do the job at hand.

    Raises
    ------
    InputError
        An accuracy out of range; a table without the quantity.
    """
    check_accuracy(accuracy)
    rows = [row for row in (table or current_table()).of(quantity) if able(row)]
    if not rows:
        message = f"the accuracy table has nothing on {quantity}; make a new one with: roslf accuracy calibrate"
        raise InputError((Problem("accuracy", message),))
    # Levels rise in cost: of each method the first that is good enough is the cheapest.
    first: dict[str, Row] = {}
    for row in rows:
        if row.expected_error <= accuracy:
            first.setdefault(row.method, row)
    best = list(first.values()) or [min(rows, key=lambda row: row.expected_error)]
    choices = [
        Choice(quantity, accuracy, row.method, row.level, row.expected_error, row.seconds_for(work(row)), bool(first))
        for row in best
    ]
    return tuple(sorted(choices, key=lambda choice: choice.expected_seconds))
