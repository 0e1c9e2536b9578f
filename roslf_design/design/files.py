"""Files: designs in and out, those that ship, what kind of file a TOML is, and writing whole or not at all."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, NamedTuple

from ..bore.part import TEMPERATURE
from ..errors import InputError, Problem, expect, path_of
from ..toml_files import nearest, parse_toml, read_toml
from .check import DesignError
from .design import Design, build

_PACKAGE = Path(__file__).resolve().parent.parent

Kind = Literal["design", "story", "optimize", "tolerance"]


class _KindOfFile(NamedTuple):
    """Kind of file: its name, the command that takes it, and the keys that mark it."""

    called: str
    command: str
    keys: tuple[str, ...]
    shown: str
    """The keys as a sentence lists them."""


KINDS: Mapping[Kind, _KindOfFile] = {
    "story": _KindOfFile("a story", "roslf report", ("story",), "[story]"),
    "design": _KindOfFile(
        "a design",
        "roslf evaluate",
        ("main_lens", "microlens_array", "sensor"),
        "[main_lens], [microlens_array] or [sensor]",
    ),
    "optimize": _KindOfFile("an optimisation study", "roslf optimize", ("variables",), "[variables]"),
    "tolerance": _KindOfFile("a tolerance study", "roslf tolerance", ("grade", "perturb"), "grade or [[perturb]]"),
}


def _kind(data: Mapping[str, Any]) -> Kind | None:
    return next((kind for kind, marks in KINDS.items() if any(key in data for key in marks.keys)), None)


def kind_of(data: Mapping[str, Any], origin: str) -> Kind:
    """Kind of a file: a design, a study of one of two kinds, or a story.

    Raises
    ------
    InputError
        None of the keys looked for is there.
    """
    kind = _kind(data)
    if kind is not None:
        return kind
    _refuse_a_lens(data, origin)
    looked = ", ".join(
        f"{KINDS[kind].shown} ({KINDS[kind].called})" for kind in ("design", "optimize", "tolerance", "story")
    )
    held = f"; it has {', '.join(map(str, list(data)[:6]))}" if data else "; it is empty"
    raise InputError((Problem("", f"is neither a design nor a study: none of {looked} is in it{held}"),), origin)


def _refuse_a_lens(data: Mapping[str, Any], origin: str, refusal: type[InputError] = InputError) -> None:
    if "surfaces" in data:
        use = f'write prescription = "{Path(origin).name}" in the [main_lens] of a design beside it'
        raise refusal((Problem("", f"is a lens file, neither a design nor a study; {use}"),), origin)


def expect_kind(data: Mapping[str, Any], wanted: Kind, origin: str) -> None:
    """Refuse a file that is plainly of another kind, instead of listing all the keys that it has not.

    Raises
    ------
    InputError
        (DesignError where a design is wanted.) Says what the file is and which command takes it.
    """
    kind, refusal = _kind(data) or wanted, DesignError if wanted == "design" else InputError
    if _kind(data) is None:
        _refuse_a_lens(data, origin, refusal)
    if kind != wanted and not any(key in data for key in KINDS[wanted].keys):
        message = f"is {KINDS[kind].called}, not {KINDS[wanted].called}; {KINDS[kind].command} takes it"
        raise refusal((Problem("", message),), origin)


def _presets() -> Path:
    installed = _PACKAGE / "designs"
    return installed if installed.is_dir() else _PACKAGE.parent / "designs"


def preset_names() -> tuple[str, ...]:
    """Names of the designs that ship, the paper's first."""
    names = sorted(path.stem for path in _presets().glob("*.toml"))
    return tuple(sorted(names, key=lambda name: (not name.startswith("paper"), name)))


def preset_path(name: str) -> Path:
    """Path of the design file of a preset.

    Raises
    ------
    KeyError
        No preset is called that.
    """
    if name not in preset_names():
        raise KeyError(f"no preset is called {name!r}; there are {', '.join(preset_names())}")
    return _presets() / f"{name}.toml"


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
    place, origin = path_of(path, "path", "a design file, or the name of a preset"), os.fspath(path)
    # A folder may well be called as a preset, being what a command wrote of it; unlike `Path`, `os.path` never raises.
    if origin in preset_names() and (os.path.isdir(place) or not os.path.exists(place)):
        place = preset_path(origin)
    missing = "check the path, or see `roslf presets` for the designs that ship"
    if place.name == origin and not place.suffix:  # as a preset is called
        missing = nearest(origin, preset_names(), missing)
    data = read_toml(place, origin, missing, refusal=DesignError)
    expect_kind(data, "design", origin)
    return build(data, from_file=True, origin=origin, folder=place.parent)


def loads(text: str, origin: str = "", folder: str | os.PathLike[str] | None = "") -> Design:
    """Read a design from TOML text; `origin` is what errors call it, `folder` what a lens file's path counts from.

    With `folder` None it opens no file: text of someone else's may name lenses that ship, and hold others as tables.
    """
    expect(text, "text", str, "TOML text")
    place = None if folder is None else Path(folder)
    return build(parse_toml(text, origin, refusal=DesignError), from_file=True, origin=origin, folder=place)


WRITTEN = 13
"""Digits of a design that commands write: computed numbers have no more that mean anything."""


def dumps(design: Design, digits: int | None = None) -> str:
    """Write a design as TOML text that `loads` turns into an equal design, or into one rounded to `digits`.

    Rounded, it is for a workshop: its lengths hold at 20 degrees C, whatever the camera is used at. A length stays in
    the unit it was typed in. A real main lens that ships is written by its name, any other as a
    table, so that the text needs no lens file.
    """
    import tomli_w

    expect(design, "design", Design, "a Design")
    if digits is not None and design.environment is not None:
        design = design.at_room.unchecked({TEMPERATURE: design.environment.temperature})
    data: dict[str, Any] = design.model_dump(
        mode="json", exclude_none=True, exclude_defaults=True, context={"digits": digits}
    )
    return tomli_w.dumps(data)


def save(design: Design, path: str | os.PathLike[str], *, overwrite: bool = False, digits: int | None = None) -> None:
    """Write a design file, as `dumps` has it; appears whole or not at all.

    Raises
    ------
    FileExistsError
        Where the file exists and `overwrite` is false.
    """
    write_new(path_of(path, "path", "a file to write"), dumps(design, digits).encode(), overwrite)


def write_new(path: Path, content: bytes, overwrite: bool) -> None:
    """Write a file as `write_atomically` does, over another only with `overwrite`.

    Raises
    ------
    FileExistsError
        Where the file exists and `overwrite` is false.
    """
    if not overwrite and path.exists():
        raise FileExistsError(f"{path} exists; choose another name or pass overwrite=True")
    write_atomically(path, content)


def in_the_way(path: Path) -> str:
    """Obstacle to writing a file at a path, with the remedy; empty where there is none.

    The nearest folder above it that is there is tried by a file without a name: no permission says what root, a file
    system that is mounted for reading, or /proc will do.
    """
    try:
        if path.is_dir():
            return f"{path} is a folder; name a file in it"
        if path.exists() and not path.is_file():
            return f"{path} is a pipe or a device; name another place"
        for at in path.parents:
            if at.is_dir():
                with tempfile.TemporaryFile(dir=at):
                    return ""
            if at.exists():
                return f"{at} is a file, not a folder; name another place"
            if at.is_symlink():
                return f"{at} is a link that leads nowhere; name another place"
    except OSError as error:
        return f"{path} cannot be written: {error.strerror}; name another place"
    return ""


def write_atomically(path: Path, content: bytes) -> None:
    """Write to a temporary name beside `path`, then rename; on disk, also where the power fails, once it returns.

    Raises
    ------
    OSError
        Names `path`: folder missing or unwritable, disk full; it is then as it was.
    """
    try:
        _write_whole(path, content)
    except OSError as error:
        raise OSError(error.errno, f"cannot be written: {error.strerror or error}", str(path)) from None


def _write_whole(path: Path, content: bytes) -> None:
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=".roslf-")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(temporary, 0o666 & ~mask)
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
    with contextlib.suppress(OSError):  # Windows opens no folders, and some file systems sync none
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
