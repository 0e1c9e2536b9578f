"""Scene files: TOML in, every fault at once."""

from __future__ import annotations

import difflib
import os
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from ..design.messages import problems_of
from ..design.parts import Part
from ..errors import Problem
from .objects import OBJECTS
from .scene import Scene, SceneError, SceneLight
from .textures import TEXTURES


def load_scene(path: str | os.PathLike[str]) -> Scene:
    """Read a scene from a TOML file; picture files are found relative to it.

    Raises
    ------
    SceneError
        Names the file and every fault in it, with places and remedies.
    """
    origin = os.fspath(path)
    try:
        text = Path(path).read_bytes().decode("utf-8")
    except FileNotFoundError:
        raise _failed(origin, "no such file; check the path to the scene") from None
    except IsADirectoryError:
        raise _failed(origin, "is a folder; name the scene file inside it") from None
    except UnicodeDecodeError as error:
        raise _failed(origin, f"is not UTF-8 text (byte {error.start}); a scene file is TOML text") from None
    except OSError as error:
        raise _failed(origin, f"cannot be read: {error.strerror}; check its permissions") from None
    return loads_scene(text, origin, Path(path).parent)


def loads_scene(text: str, origin: str = "", folder: Path | None = None) -> Scene:
    """Read a scene from TOML text.

    Parameters
    ----------
    text : str
        TOML.
    origin : str
        What errors call it.
    folder : Path, optional
        Where relative picture files are; none is the working folder.
    """
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        detail = str(error)
        raise _failed(origin, f"is not valid TOML: {detail[:1].lower()}{detail[1:]}; mend the line named") from None
    return make_scene(data, from_file=True, origin=origin, folder=folder)


def make_scene(
    data: Mapping[str, Any], *, from_file: bool = False, origin: str = "", folder: Path | None = None
) -> Scene:
    """A scene from nested values; without `from_file` bare numbers are mm and rad.

    Raises
    ------
    SceneError
        Every fault of `data`.
    """
    problems: list[Problem] = []
    objects = _objects(data.get("objects"), from_file, folder, problems)
    light = data.get("light")
    if isinstance(light, Mapping):
        light = _part(SceneLight, light, "light", from_file, problems) or SceneLight()
    rest = {key: value for key, value in data.items() if key not in ("objects", "light")}
    whole: dict[str, Any] = {**rest, **({} if light is None else {"light": light})}
    if objects:
        whole["objects"] = objects
    scene = _part(Scene, whole, "", from_file, problems)
    if problems:
        raise SceneError(tuple(problems), origin)
    assert isinstance(scene, Scene)
    return scene


def _objects(given: Any, from_file: bool, folder: Path | None, problems: list[Problem]) -> tuple[Part, ...]:
    if given is None:
        problems.append(Problem("objects", f"is missing; add a table [[objects]] with a kind: {', '.join(OBJECTS)}"))
        return ()
    if not isinstance(given, (list, tuple)) or not given:
        problems.append(Problem("objects", "must be tables, each headed [[objects]]"))
        return ()
    made = []
    for index, table in enumerate(given):
        key = f"objects.{index}"
        kind = _kind(OBJECTS, table, key, problems)
        if kind is None:
            continue
        values = dict(table)
        if "texture" in values and "texture" in kind.model_fields:
            look = _kind(TEXTURES, values["texture"], f"{key}.texture", problems)
            texture = look and _part(look, _at_home(values["texture"], folder), f"{key}.texture", from_file, problems)
            if texture is None:
                values.pop("texture")
            else:
                values["texture"] = texture
        thing = _part(kind, values, key, from_file, problems)
        if thing is not None:
            made.append(thing)
    return tuple(made)


def _kind(known: Mapping[str, type[Part]], table: Any, key: str, problems: list[Problem]) -> type[Part] | None:
    names = ", ".join(known)
    if not isinstance(table, Mapping):
        problems.append(Problem(key, f"must be a table of keys, got {table!r}"))
        return None
    kind = table.get("kind")
    if kind is None:
        problems.append(Problem(f"{key}.kind", f"is missing; write one of {names}"))
        return None
    if kind not in known:
        near = difflib.get_close_matches(str(kind), known, 1, 0.5)
        remedy = f"did you mean '{near[0]}'?" if near else f"write one of {names}"
        problems.append(Problem(f"{key}.kind", f'"{kind}" is not known; {remedy}'))
        return None
    return known[kind]


def _at_home(table: Mapping[str, Any], folder: Path | None) -> Mapping[str, Any]:
    file = table.get("file")
    if folder is None or not isinstance(file, str) or Path(file).is_absolute():
        return table
    return {**table, "file": str(folder / file)}


def _part(kind: type[Part], data: Mapping[str, Any], key: str, from_file: bool, problems: list[Problem]) -> Part | None:
    try:
        return kind.model_validate(data, context={"from_file": from_file})
    except ValidationError as error:
        found = [*problems_of(error, data, kind, from_file=from_file)]
        whole = [detail["msg"] for detail in error.errors(include_url=False) if not detail["loc"]]
        found += [Problem("", message.removeprefix("Value error, ")) for message in whole]
        for problem in found:
            place = ".".join(part for part in (key, problem.key) if part)
            problems.append(Problem(place, problem.message))
        return None


def _failed(origin: str, message: str) -> SceneError:
    return SceneError((Problem("", message),), origin)
