"""Design files: TOML in and out, whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from ..toml_files import parse_toml, read_toml
from .design import Design, build
from .errors import DesignError
from .kinds import expect_kind
from .presets import preset_names, preset_path
from .write import write_atomically


def load(path: str | os.PathLike[str]) -> Design:
    """Read a design from a TOML file, or a shipped one by its name.

    Parameters
    ----------
    path : path-like
        A file; or, where there is no such file, the name of a preset such as ``"paper"``.

    Raises
    ------
    DesignError
        Names the file and every fault in it, with places and remedies.
    """
    origin = os.fspath(path)
    place = Path(path)
    if not place.exists() and origin in preset_names():
        place = preset_path(origin)
    missing = "check the path, or see `roslf presets` for the designs that ship"
    data = read_toml(place, origin, missing, refusal=DesignError)
    expect_kind(data, "design", origin)
    return build(data, from_file=True, origin=origin, folder=place.parent)


def load_beside(name: str, folder: Path) -> Design:
    """The design that a study in a folder names: a file beside it or, where there is none, a preset."""
    return load(name if name in preset_names() and not (folder / name).exists() else folder / name)


def loads(text: str, origin: str = "", folder: str | os.PathLike[str] = "") -> Design:
    """Read a design from TOML text; `origin` is what errors call it, `folder` what a lens file's path counts from."""
    return build(parse_toml(text, origin, refusal=DesignError), from_file=True, origin=origin, folder=Path(folder))


def dumps(design: Design) -> str:
    """Write a design as TOML text that `loads` turns into an equal design.

    A real main lens that ships is written by its name, any other as a table, so that the text needs no lens file.
    """
    import tomli_w

    data: dict[str, Any] = design.model_dump(mode="json", exclude_none=True, exclude_defaults=True)
    return tomli_w.dumps(data)


def save(design: Design, path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
    """Write a design file; appears whole or not at all.

    Raises
    ------
    FileExistsError
        Where the file exists and `overwrite` is false.
    """
    if not overwrite and Path(path).exists():
        raise FileExistsError(f"{path} exists; choose another name or pass overwrite=True")
    write_atomically(Path(path), dumps(design).encode())
