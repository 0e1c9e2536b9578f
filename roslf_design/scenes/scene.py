"""A scene: objects, light and exposure, as one frozen value."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated

from pydantic import Field

from ..design import Design
from ..design.parts import Part
from ..design.units import Length
from ..effects import SceneBrief
from ..effects.field import field_radius
from ..errors import InputError, Problem
from .objects import Object, Plane, Points, Sphere, Tube, White, depths
from .textures import Picture


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
        light = self.light
        reach = [z for thing in self.objects for z in depths(thing, design.d_f, view_slope(design))]
        in_focus = all(abs(z - design.d_f) <= 1e-9 * design.d_f for z in reach)
        return SceneBrief(
            smallest_period=min(_periods(self), default=math.inf),
            hard_edges=any(_has_edges(self)),
            distances=None if in_focus else (min(reach), max(reach)),
            exposure=light.exposure,
            read_noise=light.read_noise,
            wavelengths=light.wavelengths,
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


def view_slope(design: Design) -> float:
    """Largest slope at which chief rays leave the FAP's centre towards the object."""
    return field_radius(design, SceneBrief()) * design.d_f / design.d_1 / (design.d_f - design.d_3)


def mouth(design: Design) -> float:
    """Z of the bore's mouth [mm]: its farthest rim."""
    return max(stop.distance for stop in design.all_stops)


def _misplaced(scene: Scene, design: Design) -> Iterator[Problem]:
    rim = mouth(design)
    for index, thing in enumerate(scene.objects):
        reach = list(depths(thing, design.d_f, view_slope(design)))
        if not reach:
            continue
        key, nearest = f"objects.{index}", min(reach)
        if nearest <= 0:
            yield Problem(key, f"reaches Z = {nearest:.6g} mm, inside the main lens; move it beyond {rim:g} mm")
        elif nearest <= rim:
            yield Problem(
                key, f"reaches Z = {nearest:.6g} mm, behind the bore's mouth at {rim:g} mm; move it farther out"
            )
        if not math.isfinite(max(reach)):
            yield Problem(f"{key}.tilt", "the plane runs out of sight at infinity; give it a size or tilt it less")


def _unreadable(scene: Scene) -> Iterator[Problem]:
    for index, thing in enumerate(scene.objects):
        texture = getattr(thing, "texture", None)
        if isinstance(texture, Picture):
            try:
                texture.load()
            except (OSError, ValueError) as error:
                reason = getattr(error, "strerror", None) or " ".join(str(error).split())
                message = f'cannot read "{texture.file}" as an image: {reason}; give a PNG or TIFF file'
                yield Problem(f"objects.{index}.texture.file", message)


def _periods(scene: Scene) -> Iterator[float]:
    for thing in scene.objects:
        if isinstance(thing, Points):
            yield 0.0
        elif not isinstance(thing, White):
            yield thing.texture.smallest_period
            if isinstance(thing, Plane) and thing.size is not None:
                yield 2 * min(thing.size)
            elif isinstance(thing, Sphere | Tube):
                yield 4 * thing.radius


def _has_edges(scene: Scene) -> Iterator[bool]:
    for thing in scene.objects:
        if isinstance(thing, Points | Sphere | Tube):
            yield True
        elif isinstance(thing, Plane):
            yield thing.texture.hard_edges or thing.size is not None
