"""Requirements of a design: quantities by name, each with its limits, as a study's constraints have them."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    PlainSerializer,
    SerializationInfo,
    ValidationError,
    ValidationInfo,
    model_validator,
)

from ..bore.part import Part
from ..errors import InputError, Problem
from ..toml_files import problems_of
from ..units import Angle, Length, format_quantity

ROUND_ANGLE, ROUND_RADIUS = "round_field_of_view_deg", "round_field_radius_mm"
"""Quantities of a round field: what requires one judges the field at its rim, and not in the sensor's corners."""
LIKE = '{max = "0.5 mm"}'
"""Limits as a file writes them."""


def _no_flag(value: Any) -> Any:
    if isinstance(value, bool):
        raise ValueError(f"must be a number, or text with a unit, got {value!r}")
    return value


_End = Annotated[float | str | None, BeforeValidator(_no_flag)]


def _place(field: Any) -> Any:
    """A name, or the share of the field's half diagonal that a number is, in text or not."""
    if field in ("middle", None):
        return None
    if field in ("edge", "corner"):
        return field
    with contextlib.suppress(TypeError, ValueError):
        if not isinstance(field, bool) and 0 < float(field) < 1:
            return float(field)
    raise ValueError(
        f'"{field}" is no place in the field; write "middle", "edge", "corner" or a share of its half diagonal, as 0.5 '
        'of its middle half; a distance from the axis is object_height = "5 mm"'
    )


def _ahead(angle: float) -> float:
    if not 0 < angle < math.pi:
        raise ValueError(f"must be above 0 and below 180 deg, got {math.degrees(angle):g} deg")
    return angle


class Required(Part):
    """Limits of one quantity; several of them, at other distances, stand in a list."""

    quantity: str
    at: Length | None = None
    """Distance ahead of the bore's tip [mm]; the focal plane where left out. Of a range, as ["15 mm", "80 mm"], both
    ends are required: one of them is the worst of depth and of detail."""
    field: Annotated[Literal["middle", "edge", "corner"] | float | None, BeforeValidator(_place)] = None
    """Where in what the sensor sees, or the share of its half diagonal (0.5: the middle half of the field, which is
    judged at its rim); the middle where left out, or all of it for what is of the whole camera."""
    object_height: Length | None = None
    """In its place: distance from the axis on the object, at that distance ahead, towards the field's corner [mm]."""
    field_angle: Annotated[Angle, AfterValidator(_ahead)] | None = None
    """In its place: angle of the chief ray to the axis, in the medium of the scene, towards the field's corner."""
    min: _End = None
    """Least value: text with a unit, or a number in the unit that the quantity's name ends with."""
    max: _End = None
    """Largest value."""

    @model_validator(mode="after")
    def _bounded(self) -> Required:
        if self.min is None and self.max is None:
            raise ValueError(f"{self.quantity} has no limit; give min, max or both, e.g. {LIKE}")
        return self

    @model_validator(mode="after")
    def _in_one_place(self) -> Required:
        if len(self.places) > 1:
            raise ValueError(f"{' and '.join(self.places)} are two places; keep one")
        return self

    @property
    def places(self) -> list[str]:
        """Keys that say where off the axis, of those that are given."""
        return [key for key in ("field", "object_height", "field_angle") if getattr(self, key) is not None]

    @property
    def off_axis(self) -> str | None:
        """Place off the axis, in words; None of what counts in the middle, or of the whole camera."""
        if self.object_height is not None:
            return f"{format_quantity(self.object_height, 'length', 4)} from the axis"
        if self.field_angle is not None:
            return f"{math.degrees(self.field_angle):.4g} deg off the axis"
        return f"at the rim of the middle {self.field:g} of the field" if isinstance(self.field, float) else self.field

    @property
    def where(self) -> tuple[object, ...]:
        """Plane and place: two limits of one quantity of which these are the same limit the same number."""
        return self.at, self.field, self.object_height, self.field_angle

    def limits(self, context: Any = None) -> dict[str, Any]:
        """Limits, and the distance they are for, as files and studies write them; without what is left out."""
        return self.model_dump(mode="json", exclude_none=True, exclude={"quantity"}, context=context)


def _one(data: Any, name: str, context: Any) -> Required:
    if isinstance(data, Required):
        return data
    if not isinstance(data, Mapping):
        raise InputError((Problem("", f"must be a table of limits such as {LIKE}, got {data!r}"),))
    try:
        return Required.model_validate({**data, "quantity": name}, context=context)
    except ValidationError as error:
        raise InputError(problems_of(error, Required)) from None


def _ends(limits: Any) -> list[Any]:
    """Limits at each end of a range of distances; themselves at one."""
    at = limits.get("at") if isinstance(limits, Mapping) else None
    if not isinstance(at, (list, tuple)):
        return [limits]
    if len(at) != 2:
        raise InputError((Problem("at", f'of a range is its two ends, as ["15 mm", "80 mm"], got {list(at)!r}'),))
    return [{**limits, "at": end} for end in at]


def _named(value: Any) -> Iterator[tuple[str, Any]]:
    """Name and limits of each entry, in a file's table or as `Design.replace` hands them on."""
    if isinstance(value, Mapping):
        for name, limits in value.items():
            several = isinstance(limits, Sequence) and not isinstance(limits, str)
            yield from ((str(name), one) for one in (limits if several else (limits,)))
    elif isinstance(value, (list, tuple)) and all(isinstance(one, (Mapping, Required)) for one in value):
        yield from ((one.quantity if isinstance(one, Required) else str(one.get("quantity")), one) for one in value)
    else:
        raise InputError((Problem("", f"must be a table of quantities ([required] in the file), got {value!r}"),))


def _read(value: Any, info: ValidationInfo) -> tuple[Required, ...]:
    entries, problems = list[Required](), list[Problem]()
    for name, data in _named(value):
        try:
            entries += [_one(one, name, info.context) for one in _ends(data)]
        except InputError as error:
            problems += [Problem(f"{name}.{fault.key}".rstrip("."), fault.message) for fault in error.problems]
    if problems:
        raise InputError(tuple(problems))
    return tuple(entries)


def readable(value: Any) -> Iterator[Required]:
    """Entries of a file's table that can be read, of a file whose other faults are told."""
    with contextlib.suppress(InputError):
        for name, data in _named(value):
            with contextlib.suppress(InputError):
                yield from [_one(one, name, {"from_file": True}) for one in _ends(data)]


def _written(entries: tuple[Required, ...], info: SerializationInfo) -> dict[str, Any]:
    """Table of a file."""
    tables: dict[str, list[Any]] = {}
    for one in entries:
        tables.setdefault(one.quantity, []).append(one.limits(info.context))
    return {name: several[0] if len(several) == 1 else several for name, several in tables.items()}


Requirements = Annotated[
    tuple[Required, ...], Field(max_length=50), BeforeValidator(_read), PlainSerializer(_written, return_type=Any)
]
"""Table ``[required]`` of a design file."""
