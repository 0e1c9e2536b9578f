"""A scene: objects, light and exposure, as one frozen value; from TOML, every fault at once."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import Field, ValidationError

from ..camera import Camera
from ..design import Design
from ..design.parts import Part
from ..effects import SceneBrief, Subject
from ..errors import InputError, Problem
from ..toml_files import nearest, parse_toml, problems_of, read_toml
from ..units import Length
from .objects import OBJECTS, TEXTURES, Object, PictureTexture, Plane, Points, Sphere, Tube, White, depths, detail

P = TypeVar("P", bound=Part)


class SceneError(InputError):
    """A scene (or its file) that cannot be used."""


class SceneLight(Part):
    """Colour and exposure."""

    wavelengths: tuple[Length, ...] = ()
    """Equal parts of light at each [mm]; none is the design's own."""
    exposure: Annotated[float, Field(gt=0)] | None = None
    """Electrons in a fully lit pixel; none asks for no noise."""
    read_noise: Annotated[float, Field(ge=0)] = 0.0
    """Rms read noise [electrons]."""


class Scene(Part):
    """What the camera looks at. Radiance 1 is fully lit white; an object hides what lies behind it."""

    name: str = ""
    """What the scene is called."""
    objects: tuple[Object, ...] = Field(default=(White(),), min_length=1)
    """In any order."""
    background: Annotated[float, Field(ge=0)] = 0.0
    """Radiance where no object is met."""
    light: SceneLight = SceneLight()
    """Colour and exposure."""

    @property
    def white(self) -> float | None:
        """Radiance of a scene that is the same everywhere; None where there is anything to see."""
        if len(self.objects) == 1 and isinstance(self.objects[0], White):
            return self.objects[0].level
        return None

    @property
    def points(self) -> tuple[Points, ...]:
        """The point sources."""
        return tuple(thing for thing in self.objects if isinstance(thing, Points))

    @property
    def surfaces(self) -> tuple[White | Plane | Sphere | Tube, ...]:
        """Everything but the point sources."""
        return tuple(thing for thing in self.objects if not isinstance(thing, Points))

    def brief(self, design: Design) -> SceneBrief:
        """The scene in the few numbers that effects need; called by `effects.plan`.

        Raises
        ------
        SceneError
            What this design cannot see.
        """
        self.check(design)
        details = [detail(thing) for thing in self.objects]
        reach = [z for thing in self.objects for z in depths(thing, design.d_f, _view_slope(design))]
        in_focus = all(abs(z - design.d_f) <= 1e-9 * design.d_f for z in reach)
        return SceneBrief(
            smallest_period=min(period for period, _ in details),
            hard_edges=any(jumps for _, jumps in details),
            distances=None if in_focus else (min(reach), max(reach)),
            exposure=self.light.exposure,
            read_noise=self.light.read_noise,
            wavelengths=self.light.wavelengths,
        )

    def check(self, design: Design) -> None:
        """Refuse what this design cannot see.

        Raises
        ------
        SceneError
            Every object inside the lens or the bore, every texture that cannot be read.
        """
        problems = [*_misplaced(self, design), *_unreadable(self)]
        if problems:
            raise SceneError(tuple(problems), self.name)


WHITE_FIELD = Scene(name="white field")
"""The default scene."""


def _view_slope(design: Design) -> float:
    """Largest slope at which chief rays leave the FAP's centre towards the object."""
    camera = Camera.of(design)
    return Subject(design).x_ml * float(camera.inverse_m) / float(camera.gap)


def _misplaced(scene: Scene, design: Design) -> Iterator[Problem]:
    mouth = float(Camera.of(design).tip)
    for index, thing in enumerate(scene.objects):
        reach = list(depths(thing, design.d_f, _view_slope(design)))
        if not reach:
            continue
        key, nearest = f"objects.{index}", min(reach)
        if nearest <= 0:
            yield Problem(key, f"reaches Z = {nearest:.6g} mm, inside the main lens; move it beyond {mouth:g} mm")
        elif nearest <= mouth:
            yield Problem(
                key, f"reaches Z = {nearest:.6g} mm, behind the bore's mouth at {mouth:g} mm; move it farther out"
            )
        if not math.isfinite(max(reach)):
            yield Problem(f"{key}.tilt", "the plane runs out of sight at infinity; give it a size or tilt it less")


def _unreadable(scene: Scene) -> Iterator[Problem]:
    for index, thing in enumerate(scene.objects):
        texture = getattr(thing, "texture", None)
        if isinstance(texture, PictureTexture):
            try:
                texture.load()
            except (OSError, ValueError) as error:
                reason = getattr(error, "strerror", None) or " ".join(str(error).split())
                message = f'cannot read "{texture.file}" as an image: {reason}; give a PNG or TIFF file'
                yield Problem(f"objects.{index}.texture.file", message)


def load_scene(path: str | os.PathLike[str]) -> Scene:
    """Read a scene from a TOML file; picture files are found relative to it.

    Raises
    ------
    SceneError
        Names the file and every fault in it, with places and remedies.
    """
    origin = os.fspath(path)
    data = read_toml(Path(path), origin, "check the path to the scene", refusal=SceneError)
    return make_scene(data, from_file=True, origin=origin, folder=Path(path).parent)


def loads_scene(text: str, origin: str = "", folder: Path | None = None) -> Scene:
    """Read a scene from TOML text; `origin` is what errors call it, `folder` where relative picture files are."""
    data = parse_toml(text, origin, refusal=SceneError)
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
    reader = _Reader(from_file, folder)
    whole = {**data, "objects": reader.objects(data.get("objects"))}
    if isinstance(data.get("light"), Mapping):
        whole["light"] = reader.part(SceneLight, data["light"], "light") or SceneLight()
    if not whole["objects"]:
        del whole["objects"]
    scene = reader.part(Scene, whole, "")
    if scene is None or reader.problems:
        raise SceneError(tuple(reader.problems), origin)
    return scene


class _Reader:
    """Makes parts of nested values and collects what is wrong with them."""

    def __init__(self, from_file: bool, folder: Path | None) -> None:
        self.from_file = from_file
        self.folder = folder
        self.problems: list[Problem] = []

    def objects(self, given: Any) -> tuple[Part, ...]:
        if given is None:
            self._fault("objects", f"is missing; add a table [[objects]] with a kind: {', '.join(OBJECTS)}")
            return ()
        if not isinstance(given, (list, tuple)) or not given:
            self._fault("objects", "must be tables, each headed [[objects]]")
            return ()
        made = (self._object(table, f"objects.{index}") for index, table in enumerate(given))
        return tuple(thing for thing in made if thing is not None)

    def _object(self, table: Any, key: str) -> Part | None:
        kind = self._kind(OBJECTS, table, key)
        if kind is None:
            return None
        values = dict(table)
        if "texture" in values and "texture" in kind.model_fields:
            given = values.pop("texture")
            look = self._kind(TEXTURES, given, f"{key}.texture")
            texture = look and self.part(look, self._at_home(given), f"{key}.texture")
            if texture is not None:
                values["texture"] = texture
        return self.part(kind, values, key)

    def _kind(self, known: Mapping[str, type[Part]], table: Any, key: str) -> type[Part] | None:
        names = ", ".join(known)
        if not isinstance(table, Mapping):
            self._fault(key, f"must be a table of keys, got {table!r}")
        elif table.get("kind") is None:
            self._fault(f"{key}.kind", f"is missing; write one of {names}")
        elif table["kind"] in known:
            return known[table["kind"]]
        else:
            remedy = nearest(str(table["kind"]), known, f"write one of {names}")
            self._fault(f"{key}.kind", f'"{table["kind"]}" is not known; {remedy}')
        return None

    def _at_home(self, table: Mapping[str, Any]) -> Mapping[str, Any]:
        """The same with a picture's file counted from the scene's folder."""
        file = table.get("file")
        if self.folder is None or not isinstance(file, str) or Path(file).is_absolute():
            return table
        return {**table, "file": str(self.folder / file)}

    def part(self, kind: type[P], data: Mapping[str, Any], key: str) -> P | None:
        try:
            return kind.model_validate(data, context={"from_file": self.from_file})
        except ValidationError as error:
            for problem in problems_of(error, kind):
                self._fault(".".join(part for part in (key, problem.key) if part), problem.message)
            return None

    def _fault(self, key: str, message: str) -> None:
        self.problems.append(Problem(key, message))
