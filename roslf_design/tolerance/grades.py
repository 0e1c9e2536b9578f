"""Tolerance grades: what a workshop holds, from a data file that says where each line comes from."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..design import Design
from ..design.files import read_toml
from ..errors import InputError, Problem
from .places import FOCAL_LENGTH, expand, in_lens, nominal_values, parse_tolerance, perturbable

SHIPPED = Path(__file__).with_name("grades.toml")
"""The grades that ship: engineering judgement, to be replaced by a shop's own figures."""


@dataclass(frozen=True)
class GradeLine:
    """One place's tolerance in every grade."""

    place: str
    """Dotted place, pair or pattern."""
    tolerances: tuple[str, ...]
    """One text a grade, e.g. "1 %"."""
    provenance: str
    """Where the figures come from."""


@dataclass(frozen=True)
class Grades:
    """A table of grades."""

    names: tuple[str, ...]
    """From loose to tight."""
    meanings: tuple[str, ...]
    """One sentence each."""
    lines: tuple[GradeLine, ...]

    def tolerances(self, grade: str, design: Design) -> dict[str, float]:
        """Half-widths at every place of a design that the table speaks of.

        Parameters
        ----------
        grade : str
            One of `names`.
        design : Design
            Percentages are of its values.

        Raises
        ------
        InputError
            Unknown grade, or a text that is no tolerance of its place.
        """
        if grade not in self.names:
            raise InputError((Problem("grade", f"'{grade}' is not known; use one of {', '.join(self.names)}"),))
        kinds, nominal, found, problems = perturbable(design), nominal_values(design), {}, []
        for line in self.lines:
            text = line.tolerances[self.names.index(grade)]
            try:
                for place in _covered(design, line.place):
                    found[place] = parse_tolerance(text, kinds[place], nominal[place])
            except ValueError as error:
                problems.append(Problem(f"{line.place}.{grade}", str(error)))
        if problems:
            raise InputError(tuple(problems), "grades")
        return found

    def provenance(self, design: Design) -> dict[str, str]:
        """Place to the words on where its line comes from."""
        return {place: line.provenance for line in self.lines for place in _covered(design, line.place)}


def _covered(design: Design, place: str) -> tuple[str, ...]:
    """Places of a design that a line speaks of; a real lens's focal length is no number of its own."""
    real = design.lens is not None
    return () if (real and place == FOCAL_LENGTH) or (not real and in_lens(place)) else expand(design, place)


def load_grades(path: Path = SHIPPED) -> Grades:
    """Read a table of grades.

    Raises
    ------
    InputError
        Every fault of the file: no grades, a line without its place, a value for each grade or its provenance.
    """
    data = read_toml(path, str(path))
    names = data.get("grades")
    if not isinstance(names, dict) or not names:
        raise InputError((Problem("grades", 'is missing; list them as [grades] with name = "meaning"'),), str(path))
    wanted = ("place", *names, "provenance")
    problems, lines = [], []
    for index, line in enumerate(data.get("line", [])):
        missing = [key for key in wanted if not isinstance(line.get(key), (str, int, float))]
        unknown = [key for key in line if key not in wanted]
        problems += [Problem(f"line.{index}.{key}", "is missing; add it") for key in missing]
        problems += [Problem(f"line.{index}.{key}", f"is not known; known are {', '.join(wanted)}") for key in unknown]
        if not missing:
            values = tuple(str(line[name]) for name in names)
            lines.append(GradeLine(line["place"], values, line["provenance"]))
    if problems:
        raise InputError(tuple(problems), str(path))
    return Grades(tuple(names), tuple(map(str, names.values())), tuple(lines))
