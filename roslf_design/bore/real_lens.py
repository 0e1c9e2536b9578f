"""A main lens given by its prescription: read when the design is, held as a value, written so that it reads back.

``prescription`` in a design file is the name of a lens that ships ("LA1050-A"), the path of a lens file (.toml or
.zmx) relative to the design file, or the lens itself as a table with a lens file's keys. Whichever it was, the design
holds the lens as a value. Written again, a lens that ships becomes its name, and every other one a table: the design
file then needs nothing beside it, and can be moved.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, PlainSerializer, SerializationInfo, ValidationInfo
from pydantic_core import PydanticCustomError

from ..lenses.lens_file import lens_of, load_lens, shipped_names, table_of
from ..lenses.prescription import Prescription, first_order
from ..toml_files import Instance


def read_prescription(value: Any, folder: str | Path | None = "") -> Prescription | None:
    """A lens from what a design file (or Python) gives.

    Parameters
    ----------
    value : str, mapping, Prescription or None
        Name, path, table, or the lens itself.
    folder : path-like
        What a relative path counts from; None where no file may be opened, only lenses that ship and tables.

    Raises
    ------
    LensError
        Names the lens file and every fault in it.
    ValueError
        None of these.
    """
    if value is None:
        return None
    if isinstance(value, Prescription):
        return value
    if isinstance(value, Mapping):
        return lens_of(value, "", None if folder is None else Path(folder))
    if not isinstance(value, str) or not value.strip():
        known = ", ".join(name.upper() for name in shipped_names())
        raise ValueError(f"expected a lens file (.toml or .zmx) or a lens that ships ({known}), got {value!r}")
    if folder is None:
        if value.lower() not in shipped_names():
            known = ", ".join(name.upper() for name in shipped_names())
            message = f"'{value}' is no lens that ships ({known}), and this text may not open files; write a table"
            raise ValueError(message)
        return load_lens(value.lower())
    place = Path(folder) / value
    return load_lens(value if value.lower() in shipped_names() and not place.exists() else place)


def _validated(value: Any, info: ValidationInfo) -> Any:
    return read_prescription(value, (info.context or {}).get("folder", ""))


def _required(value: Any, info: ValidationInfo) -> Any:
    if value is None:
        raise PydanticCustomError("missing", "Field required")
    return _validated(value, info)


def _written(lens: Prescription | None, info: SerializationInfo) -> str | dict[str, Any] | None:
    """Text or table of a lens in a design file: its name where it ships, else a table of its own."""
    if lens is None:
        return None
    table = table_of(lens, (info.context or {}).get("digits"))
    if lens.name.lower() in shipped_names() and table_of(load_lens(lens.name.lower())) == table:
        return lens.name
    return table


_WRITTEN = PlainSerializer(_written, return_type=Any, when_used="json")
Lens = Annotated[Annotated[Prescription, Instance] | None, BeforeValidator(_validated), _WRITTEN]
"""A lens's prescription, or None for the ideal lens."""
RealLens = Annotated[Prescription, Instance, BeforeValidator(_required), _WRITTEN]
"""A lens's prescription."""


@lru_cache(maxsize=256)
def mounted_lens(lens: Prescription, turned: bool, diameter: float | None) -> Prescription:
    """The lens as it stands in the camera: turned round where asked for, cut down to a clear diameter [mm]."""
    lens = lens.reversed() if turned else lens
    if diameter is None or diameter >= lens.clear_diameter:
        return lens
    cut = tuple(replace(s, semi_diameter=min(s.semi_diameter, diameter / 2)) for s in lens.surfaces)
    return replace(lens, surfaces=cut)


@lru_cache(maxsize=1024)
def focal_length_at(lens: Prescription, wavelength: float) -> float:
    """Focal length at a wavelength [mm]; infinite for an afocal lens, negative for a diverging one.

    Raises
    ------
    InputError
        The wavelength is outside a glass's range.
    """
    return float(first_order(lens, wavelength).focal_length)
