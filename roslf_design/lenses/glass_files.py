"""Glasses out of other catalogues' files: Zemax .agf, and the .yml pages of the refractiveindex.info database.

Read are those dispersion formulas that `glass.Glass` has, Schott's of dn/dT and the expansion near room temperature.
What is not understood of a glass that is asked for is refused; glasses beside it do not matter.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from decimal import Decimal
from pathlib import Path
from typing import Any

from ..errors import InputError, Problem
from ..input_files import MOST_TEXT, read_bytes
from ..toml_files import StrictTable, nearest, validated
from .glass import Glass, read_glass

AGF_FORMULAS = {1: "schott", 2: "sellmeier", 6: "sellmeier", 11: "sellmeier"}
"""Zemax's numbers: Schott, Sellmeier 1, 3 and 5."""
LISTED = 20


def _load_glass(path: Path, name: str, origin: str = "") -> Glass:
    """A glass out of a file.

    Parameters
    ----------
    path : Path
        A .agf catalogue, or a .yml page of one material.
    name : str
        Of the glass, in any case; a page's own may be left empty.
    origin : str
        What errors call the file.

    Raises
    ------
    InputError
        A file or a glass that cannot be read; names the nearest glass known.
    """
    origin = origin or str(path)
    text = read_bytes(path, origin, most=MOST_TEXT).decode("utf-8-sig", "replace")
    if path.suffix.lower() in (".yml", ".yaml"):
        return _made(name or path.stem, _page(text, origin), origin, path.name)
    if path.suffix.lower() != ".agf":
        raise InputError((Problem("file", f"'{path.name}' is neither a .agf catalogue nor a .yml page of a glass"),))
    glasses = _agf(text)
    entry = glasses.get(name.strip().upper())
    if entry is None:
        known = list(glasses)[:LISTED] if len(glasses) <= LISTED else []
        hint = nearest(name.upper(), list(glasses), f"it holds {', '.join(known) or f'{len(glasses)} others'}")
        raise InputError((Problem("glass", f"'{name}' is not in it; {hint}"),), origin)
    return _made(name.strip(), _agf_table(entry, origin), origin, path.name)


class _GlassFile(StrictTable, defer_build=True):
    """Glass out of a file, and its name there where it is called otherwise."""

    file: str
    name: str = ""

    def glass(self, folder: Path | None) -> Glass:
        """Glass out of the file; an InputError where none may be opened, or as of `_load_glass`."""
        if folder is None:
            message = f"'{self.file}': this text may not open files; write the glass's numbers"
            raise InputError((Problem("file", message),))
        return _load_glass(folder / self.file, self.name, self.file)


def glass_of_table(table: Mapping[str, Any], folder: Path | None) -> Glass:
    """A glass as a table tells it: out of a file, by a formula's coefficients, or by index and Abbe number.

    Parameters
    ----------
    table : mapping
        With ``file`` and, where it is called otherwise there, ``name``; else as of `read_glass`.
    folder : Path or None
        What a file's path counts from; None where none may be opened.

    Raises
    ------
    InputError
        Every fault of it.
    """
    return validated(_GlassFile, table).glass(folder) if "file" in table else read_glass(table)


def _made(name: str, table: Mapping[str, Any], origin: str, source: str) -> Glass:
    try:
        return read_glass({**table, "name": name, "source": source, "warming_source": source})
    except InputError as error:
        faults = tuple(Problem(f"{name}.{problem.key}", problem.message) for problem in error.problems)
        raise InputError(faults, origin) from None


def _agf(text: str) -> dict[str, dict[str, list[str]]]:
    """Lines of each glass by its upper-case name, and by the word they begin with."""
    glasses: dict[str, dict[str, list[str]]] = {}
    here: dict[str, list[str]] = {}
    for line in text.splitlines():
        words = line.split()
        if words[:1] == ["NM"] and len(words) > 2:
            here = glasses[words[1].upper()] = {}
        if words:
            here.setdefault(words[0], words[1:])
    return glasses


def _agf_table(entry: Mapping[str, list[str]], origin: str) -> dict[str, Any]:
    try:
        code = int(float(entry["NM"][1]))
        terms = [float(word) for word in entry["CD"]]
        low, high = (float(word) for word in entry["LD"][:2])
        warm = [float(word) for word in entry.get("TD", [])[:7]]
        expansion = float(Decimal(entry["ED"][0]) / 10**6) if entry.get("ED") else 0.0
    except (KeyError, ValueError, IndexError, ArithmeticError):
        name = entry.get("NM", ["?"])[0]
        message = f"'{name}' lacks its formula (NM), constants (CD) or range (LD); is the file cut off?"
        raise InputError((Problem("glass", message),), origin) from None
    if code not in AGF_FORMULAS:
        message = f"'{entry['NM'][0]}' has dispersion formula {code}; known are 1 (Schott), 2, 6 and 11 (Sellmeier)"
        raise InputError((Problem("glass", message),), origin)
    table: dict[str, Any] = {"formula": AGF_FORMULAS[code], "range": [f"{low!r} um", f"{high!r} um"]}
    if code == 1:
        table["a"] = terms[:6]
    else:
        pairs = [pair for pair in zip(terms[::2], terms[1::2], strict=False) if pair[0]]
        table |= {"b": [b for b, _ in pairs], "c": [c for _, c in pairs]}
    if expansion:
        table["cte"] = expansion
    if len(warm) >= 6 and any(warm[:5]):
        table["dndt"] = {"d": warm[:3], "e": warm[3:5], "lambda_tk": warm[5]}
    return table


def _page(text: str, origin: str) -> dict[str, Any]:
    kind = re.search(r"type:\s*formula (\d+)", text)
    terms = re.search(r"coefficients:([-+\d.eE \t]+)", text)
    reach = re.search(r"wavelength_range:\s*(\S+)\s+(\S+)", text)
    if kind is None or terms is None or reach is None:
        message = "has no dispersion formula with its range; pages of tables alone cannot be read"
        raise InputError((Problem("DATA", message),), origin)
    number, values = int(kind[1]), _numbers(terms[1], "DATA.coefficients", origin)
    if not values:
        raise InputError((Problem("DATA.coefficients", "holds no numbers; is the page cut off?"),), origin)
    table: dict[str, Any] = {"range": [f"{reach[1]} um", f"{reach[2]} um"]}
    pairs = [*zip(values[1::2], values[2::2], strict=False)]
    if number in (1, 2):
        pairs = [(b, c * c if number == 1 else c) for b, c in pairs]
        pairs += [(values[0], 0.0)] if values[0] else []
        table |= {"formula": "sellmeier", "b": [b for b, _ in pairs], "c": [c for _, c in pairs]}
    elif number == 3 and all(power in (2, -2, -4, -6, -8, -10, -12) for _, power in pairs):
        powers = {int(power): value for value, power in pairs}
        lowest = min((*powers, -2))
        table |= {"formula": "schott"}
        table["a"] = [values[0], powers.get(2, 0.0), *(powers.get(power, 0.0) for power in range(-2, lowest - 1, -2))]
    else:
        message = f"formula {number} cannot be read; known are 1, 2 (Sellmeier) and 3 with the powers of Schott's"
        raise InputError((Problem("DATA", message),), origin)
    if re.search(r"n_(?:is_)?absolute:\s*true", text):
        table["against"] = "vacuum"
    warm = re.search(r'Schott formula"?\s*\n?\s*coefficients:([-+\d.eE \t]+)', text)
    expansion = re.search(r"temperature_range:\s*-30\s+70\s*°C\s*\n\s*coefficient:\s*([-+\d.eE]+)", text)
    if warm is not None and len(six := _numbers(warm[1], "SPECS.thermal_dispersion", origin)) == 6:
        table["dndt"] = {"d": six[:3], "e": six[3:5], "lambda_tk": six[5]}
    if expansion is not None:
        table["cte"] = next(iter(_numbers(expansion[1], "SPECS.thermal_expansion", origin)))
    return table


def _numbers(text: str, key: str, origin: str) -> list[float]:
    try:
        return [float(word) for word in text.split()]
    except ValueError as error:
        raise InputError((Problem(key, f"{error}; write numbers with spaces between"),), origin) from None
