"""A scene: objects, light and exposure, as one frozen value; from TOML, every fault at once."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, ValidationError, field_validator

from ..bore.part import Part
from ..camera import Camera
from ..design import Design
from ..effects import SceneBrief, Subject
from ..errors import InputError, Problem
from ..theory.colours import filters
from ..theory.photometry import veil_level
from ..toml_files import problems_of, read_toml
from ..units import Length
from .objects import (
    OBJECTS,
    Level,
    Object,
    PictureTexture,
    Plane,
    Points,
    Sphere,
    Tube,
    White,
    brightness,
    depths,
    detail,
)


class SceneError(InputError):
    """A scene (or its file) that cannot be used."""


LEAST_EXPOSURE = 1e-6
"""Electrons in a fully lit pixel, below which noise in units of it fits no image."""


class SceneLight(Part):
    """Colour and exposure."""

    wavelengths: Annotated[tuple[Length, ...], Field(max_length=100)] = ()
    """Equal parts of light at each [mm]; none is the design's own, or white light for a sensor with colour filters."""
    exposure: Annotated[float, Field(gt=0, le=1e12)] | None = None
    """Electrons in a fully lit pixel, in the place of the design's own light and exposure; left out, `roslf render`
    draws no noise and `roslf depth` counts the design's light. Where the design says `light.measured_at`, surfaces have
    their radiance at the focal plane, and 1/z^2 of it at others."""
    read_noise: Annotated[float, Field(ge=0, le=1e6)] = 0.0
    """Rms read noise [electrons]; left out, none in `roslf render`, and the sensor's own in `roslf depth`."""

    @field_validator("exposure")
    @classmethod
    def _shows_something(cls, exposure: float | None) -> float | None:
        if exposure is not None and exposure < LEAST_EXPOSURE:
            raise ValueError(f'"{exposure:g}" electrons show nothing; give {LEAST_EXPOSURE:g} or more, or leave it out')
        return exposure


class Scene(Part):
    """Scene that the camera looks at. Radiance 1 is fully lit white; an object hides what lies behind it."""

    name: str = ""
    """Name of the scene."""
    objects: Annotated[tuple[Object, ...], Field(max_length=200)] = (White(),)
    """Objects in any order."""
    background: Level = 0.0
    """Radiance where no object is met."""
    light: SceneLight = SceneLight()
    """Colour and exposure."""

    @field_validator("objects", mode="before")
    @classmethod
    def _some(cls, objects: Any) -> Any:
        if isinstance(objects, (list, tuple)) and not objects:
            raise ValueError("must be tables, each headed [[objects]]")
        return objects

    @classmethod
    def _refused(cls, error: ValidationError, data: Mapping[str, Any]) -> SceneError:
        return SceneError(problems_of(error, cls))

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

    @property
    def brightness(self) -> float:
        """Radiance that surfaces have on average, each counted alike; without any that of the background."""
        each = [brightness(thing) for thing in self.surfaces]
        return sum(each) / len(each) if each else self.background

    @property
    def mean_exposure(self) -> float | None:
        """Electrons of a fully lit pixel, where the scene is as bright as on average; None of a scene that states none.

        Those where it is white, of a scene that is dark but for points.
        """
        return None if self.light.exposure is None else self.light.exposure * (self.brightness or 1.0)

    def in_light(self, wavelengths: tuple[float, ...]) -> Scene:
        """Scene in equal parts of light at some wavelengths [mm]."""
        return self.model_copy(update={"light": self.light.model_copy(update={"wavelengths": wavelengths})})

    def seen_by(self, design: Design) -> Scene:
        """Scene whose distances all count from a design's main lens."""
        if all(isinstance(thing, White) or thing.measured_from == "main lens" for thing in self.objects):
            return self
        tip = float(Camera.of(design).tip)
        placed = tuple(thing if isinstance(thing, White) else thing.seen_from(tip) for thing in self.objects)
        return self.model_copy(update={"objects": placed})

    def brief(self, design: Design) -> SceneBrief:
        """The scene in the few numbers that effects need; called by `effects.plan`.

        Raises
        ------
        SceneError
            What this design cannot see.
        """
        self.check(design)
        details = [detail(thing) for thing in self.objects]
        placed = self.seen_by(design).objects
        reach = [z for thing in placed for z in depths(thing, design.d_f, *chief_ray_limits(design))]
        in_focus = all(abs(z - design.d_f) <= 1e-9 * design.d_f for z in reach)
        in_focus &= not (reach and Camera.of(design).mapping.bends)
        return SceneBrief(
            smallest_period=min(period for period, _ in details),
            hard_edges=any(jumps for _, jumps in details),
            distances=None if in_focus else (min(reach), max(reach)),
            exposure=self.light.exposure,
            read_noise=self.light.read_noise,
            veil=float(veil_level(Camera.of(design.thin_twin), self.light.exposure)),
            wavelengths=self.light.wavelengths or tuple(one.wavelength for one in filters(design.sensor.colours)),
        )

    def check(self, design: Design) -> None:
        """Refuse what this design cannot see.

        Raises
        ------
        SceneError
            Every object inside the lens or the bore, every texture that cannot be read.
        """
        problems = [*_misplaced(self, design), *_unreadable(self)]
        if self.light.wavelengths and filters(design.sensor.colours):
            message = "a sensor with colour filters is rendered in white light; drop it, or use sensor.colours = mono"
            problems.append(Problem("light.wavelengths", message))
        if problems:
            raise SceneError(tuple(problems), self.name)


WHITE_FIELD = Scene(name="white field")
"""The default scene."""


def chief_ray_limits(design: Design) -> tuple[float, float]:
    """How far off the axis chief rays go, ``slope Z + height``: slope, height [mm]."""
    camera = Camera.of(design)
    slope = Subject(design).x_ml * float(camera.seen.inverse_m) / float(camera.seen.gap)
    end, plane = camera.front
    if end == 0:
        return slope, -slope * float(camera.seen.d_3)
    outside = slope * float((plane.d - plane.c * camera.seen.d_3) / plane.medium)
    height = slope * float(plane.b - plane.a * camera.seen.d_3) - outside * float(end)

    def grown() -> float:
        return float(camera.sagittal_stretch(abs(outside) * plane.medium))

    ((height, slope),) = camera.mapping.redrawn(
        [(height, -outside)], grown, lambda: float(camera.entrance_pupil_distance)
    )
    outside = -slope
    away = 1 if outside * design.d_f + height > 0 else -1  # from the axis; else towards a pupil beyond the focal plane
    return away * outside, away * height


def _misplaced(scene: Scene, design: Design) -> Iterator[Problem]:
    mouth = float(Camera.of(design).tip)
    for number, thing in enumerate(scene.seen_by(design).objects):
        reach = list(depths(thing, design.d_f, *chief_ray_limits(design)))
        if not reach:
            continue
        key, nearest = f"objects.{number}", min(reach)
        if nearest <= 0:
            yield Problem(key, f"reaches Z = {nearest:.6g} mm, inside the main lens; move it beyond {mouth:g} mm")
        elif nearest <= mouth:
            yield Problem(
                key, f"reaches Z = {nearest:.6g} mm, behind the bore's mouth at {mouth:g} mm; move it farther out"
            )
        if not math.isfinite(max(reach)):
            yield Problem(f"{key}.tilt", "the plane runs out of sight at infinity; give it a size or tilt it less")


def _unreadable(scene: Scene) -> Iterator[Problem]:
    for number, thing in enumerate(scene.objects):
        texture = getattr(thing, "texture", None)
        if isinstance(texture, PictureTexture):
            try:
                texture.load()
            except InputError as error:
                yield Problem(f"objects.{number}.texture.file", str(error))


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


def make_scene(
    data: Mapping[str, Any], *, from_file: bool = False, origin: str = "", folder: Path | None = None
) -> Scene:
    """A scene from nested values; without `from_file` bare numbers are mm and rad.

    Raises
    ------
    SceneError
        Every fault of `data`.
    """
    problems = []
    if data.get("objects") is None:
        remedy = f"is missing; add a table [[objects]] with a kind: {', '.join(OBJECTS)}"
        problems, data = [Problem("objects", remedy)], {**data, "objects": (White(),)}
    try:
        scene = Scene.model_validate(data, context={"from_file": from_file, "folder": folder})
    except ValidationError as error:
        problems += problems_of(error, Scene)
    if problems:
        raise SceneError(tuple(problems), origin)
    return scene
