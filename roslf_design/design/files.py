"""Design files: TOML in and out, whole or not at all."""

from __future__ import annotations

import os
import tomllib
from pathlib import Path
from typing import Any

from .design import Design, build
from .errors import DesignError, Problem
from .kinds import expect_kind
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
    from .presets import preset_names, preset_path

    origin = os.fspath(path)
    place = Path(path)
    if not place.exists() and origin in preset_names():
        place = preset_path(origin)
    data = read_toml(place, origin, "check the path, or see `roslf presets` for the designs that ship")
    expect_kind(data, "design", origin)
    return build(data, from_file=True, origin=origin, folder=place.parent)


def loads(text: str, origin: str = "", folder: str | os.PathLike[str] = "") -> Design:
    """Read a design from TOML text; `origin` is what errors call it, `folder` what a lens file's path counts from."""
    return build(parse_toml(text, origin), from_file=True, origin=origin, folder=Path(folder))


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


def read_toml(path: Path, origin: str, missing: str = "check the path") -> dict[str, Any]:
    """The nested values of a TOML file, with one clear error for a file that cannot be read.

    Parameters
    ----------
    path : Path
        The file.
    origin : str
        What errors call it.
    missing : str
        What to do where there is no such file.

    Raises
    ------
    DesignError
        Missing, not a file, not readable, not UTF-8, not TOML.
    """
    try:
        text = path.read_bytes().decode("utf-8")
    except FileNotFoundError:
        raise _failed(origin, f"no such file; {missing}") from None
    except IsADirectoryError:
        raise _failed(origin, "is a folder; name the file inside it") from None
    except UnicodeDecodeError as error:
        raise _failed(origin, f"is not UTF-8 text (byte {error.start}); expected a TOML file") from None
    except OSError as error:
        raise _failed(origin, f"cannot be read: {error.strerror}; check its permissions") from None
    return parse_toml(text, origin)


def parse_toml(text: str, origin: str) -> dict[str, Any]:
    """The nested values of TOML text; `origin` is what errors call it.

    Raises
    ------
    DesignError
        Not TOML.
    """
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        detail = str(error)
        raise _failed(origin, f"is not valid TOML: {detail[:1].lower()}{detail[1:]}; mend the line named") from None


def _failed(origin: str, message: str) -> DesignError:
    return DesignError((Problem("", message),), origin)
