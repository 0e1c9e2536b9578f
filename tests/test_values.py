"""Every value of the package: equal to its copies, unequal with any field changed, hashed alike, pickled, shown.

Classes are found by walking the package: frozen dataclasses, named tuples, parts of pydantic, and what has an `__eq__`
of its own. Each is made of two samples a field, by the field's type, arrays wherever its type allows some; what checks
fields when an object is made is not asked. Then caches, which tell designs apart by all that.
"""

from __future__ import annotations

import collections.abc
import contextlib
import copy
import dataclasses
import enum
import functools
import importlib
import inspect
import json
import math
import pickle
import pkgutil
import types
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import roslf_design
import roslf_design as roslf
from roslf_design.calibration.decoding import LightField
from roslf_design.camera import Camera
from roslf_design.depth.estimate import DisparityMap
from roslf_design.evaluation.groups import Numbers
from roslf_design.lenses.glass import D_LINE
from roslf_design.traced.images import real_field

PLAIN: dict[Any, tuple[Any, Any]] = {
    float: (1.5, 2.5),
    int: (3, 4),
    bool: (True, False),
    str: ("one", "two"),
    bytes: (b"one", b"two"),
    complex: (1j, 2j),
    type(None): (None, None),
    Path: (Path("one"), Path("two")),
    Any: ("this", "that"),
    object: ("this", "that"),
    type: (int, str),
    slice: (slice(1), slice(2)),
    np.random.Generator: (1, 2),
    np.dtype: (np.dtype(float), np.dtype(int)),
}
ARRAYS = np.array([[1.0, 2.0]]), np.array([[1.0, 3.0]])
DEEPEST = 6


def modules() -> Iterator[types.ModuleType]:
    for module in pkgutil.walk_packages(roslf_design.__path__, "roslf_design."):
        if not module.name.endswith("__main__"):
            yield importlib.import_module(module.name)


def is_value(cls: type) -> bool:
    if issubclass(cls, BaseException | enum.Enum) or getattr(cls, "_is_protocol", False):
        return False
    if dataclasses.is_dataclass(cls):
        return cls.__dataclass_params__.frozen
    return hasattr(cls, "_fields") or hasattr(cls, "model_fields") or "__eq__" in vars(cls)


CLASSES = {
    f"{cls.__module__.removeprefix('roslf_design.')}.{name}": cls
    for module in modules()
    for name, cls in sorted(vars(module).items())
    if inspect.isclass(cls) and cls.__module__ == module.__name__
}
NAMES = {cls.__name__: cls for cls in CLASSES.values()}
VALUES = {name: cls for name, cls in CLASSES.items() if is_value(cls)}


@functools.cache
def hints(cls: type) -> dict[str, Any]:
    """Types of the fields that a value consists of."""
    if dataclasses.is_dataclass(cls):
        names = [field.name for field in dataclasses.fields(cls)]
    elif hasattr(cls, "model_fields"):
        return {name: field.annotation for name, field in cls.model_fields.items()}
    elif hasattr(cls, "_fields"):
        names = list(cls._fields)
    else:
        names = list(inspect.signature(cls).parameters)
    own = vars(importlib.import_module(cls.__module__))
    known = typing.get_type_hints(cls if hasattr(cls, "__match_args__") else cls.__init__, localns={**NAMES, **own})
    return {name: known[name] for name in names}


def samples(kind: Any, depth: int = 0) -> tuple[Any, Any]:
    """Two values of a type that differ; arrays where there may be some."""
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if kind in PLAIN or origin in PLAIN:
        return PLAIN[kind if kind in PLAIN else origin]
    if isinstance(kind, typing.TypeVar):
        return samples(kind.__bound__ or (kind.__constraints__ or (float,))[0], depth)
    if isinstance(kind, str | typing.ForwardRef):
        raise TypeError(f"unresolved {kind}")
    if origin is typing.Annotated:
        return samples(arguments[0], depth)
    if origin is typing.Literal:
        return arguments[0], arguments[-1] if len(arguments) > 1 else "other"
    if origin in (typing.Union, types.UnionType):
        arrays = [one for one in arguments if is_array(one)]
        return samples((arrays or [one for one in arguments if one is not type(None)])[0], depth)
    if is_array(kind):
        return ARRAYS
    if origin is tuple or kind is tuple:
        parts = [samples(one, depth) for one in arguments if one is not ...] or [PLAIN[str]]
        return tuple(a for a, _ in parts), tuple(b for _, b in parts)
    if origin in (list, set, frozenset, collections.abc.Set):
        made = origin if origin is not collections.abc.Set else frozenset
        a, b = samples(arguments[0], depth)
        return made([a]), made([b])
    if origin in (dict, collections.abc.Mapping, collections.abc.MutableMapping) or kind in (
        dict,
        collections.abc.Mapping,
    ):
        (key, _), (a, b) = (samples(one, depth) for one in arguments or (str, float))
        return {key: a}, {key: b}
    if origin in (
        collections.abc.Sequence,
        collections.abc.Iterable,
        collections.abc.Collection,
        collections.abc.Iterator,
    ):
        a, b = samples(arguments[0], depth)
        return (a,), (b,)
    if origin is collections.abc.Callable or kind is collections.abc.Callable:
        return math.sin, math.cos
    if origin is type:
        return int, str
    if inspect.isclass(kind) and issubclass(kind, enum.Enum):
        members = list(kind)
        return members[0], members[-1]
    if inspect.isclass(kind) or inspect.isclass(origin):
        cls = kind if inspect.isclass(kind) else origin
        if is_value(cls) and depth < DEEPEST:
            return pair(cls, depth + 1)
        return "this", "that"
    raise TypeError(f"no sample of {kind}")


def is_array(kind: Any) -> bool:
    return kind is np.ndarray or typing.get_origin(kind) is np.ndarray


def make(cls: type, values: dict[str, Any]) -> Any:
    """Instance with these fields, unchecked."""
    if hasattr(cls, "model_fields"):
        return cls.model_construct(**values)
    if hasattr(cls, "_fields") or not dataclasses.is_dataclass(cls):
        return cls(**values)
    made = object.__new__(cls)
    for name, value in values.items():
        object.__setattr__(made, name, value)
    return made


def pair(cls: type, depth: int = 0) -> tuple[Any, Any]:
    """Two instances that differ in every field."""
    both = both_of(cls, depth)
    return tuple(make(cls, {name: values[k] for name, values in both.items()}) for k in (0, 1))


@functools.cache
def both_of(cls: type, depth: int = 0) -> dict[str, tuple[Any, Any]]:
    """Two samples of every field."""
    if cls is Camera:
        numbers = dict(Camera.of(roslf.load("paper"), {"d_3": ARRAYS[0]}).numbers)
        rest = {name: samples(kind, depth) for name, kind in hints(cls).items() if name != "numbers"}
        return {"numbers": (numbers, numbers | {"aperture.distance": ARRAYS[1]}), **rest}
    return {name: samples(kind, depth) for name, kind in hints(cls).items()}


def by_fields(value: Any) -> Any:
    """What numpy's test compares field by field."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return [type(value), *(by_fields(getattr(value, field.name)) for field in dataclasses.fields(value))]
    if isinstance(value, collections.abc.Mapping):
        return {key: by_fields(one) for key, one in value.items()}
    return [by_fields(one) for one in value] if isinstance(value, tuple | list) else value


def alike(value: Any, other: Any) -> bool:
    try:
        np.testing.assert_equal(by_fields(value), by_fields(other))
    except AssertionError:
        return False
    return True


def equal(value: Any, other: Any) -> bool:
    """Equal by the class's own word; or field by field where it has none.

    Two kinds have none. A dataclass with ``eq=False`` says that it is compared as an object: pictures, tables and what
    is worked out from them. A tuple of such or of arrays is several answers of one function, compared as tuples are.
    """
    if not speaks(value):
        return alike(value, other)
    answer, opposite = value == other, value != other
    assert isinstance(answer, bool), "== gives no truth"
    assert opposite is not answer
    return answer


def speaks(value: Any) -> bool:
    if dataclasses.is_dataclass(value):
        return value.__dataclass_params__.eq
    if isinstance(value, collections.abc.Mapping):
        return all(map(speaks, value.values()))
    return all(map(speaks, value)) if isinstance(value, tuple | list) else not isinstance(value, np.ndarray)


def test_every_value_is_all_of_its_fields_and_shows_them():
    """Each of some six hundred in a millisecond or two: as tests of their own they take twice the time."""
    for name, cls in VALUES.items():
        try:
            is_all_of_its_fields(cls)
            shows_itself(cls)
        except AssertionError as error:
            raise AssertionError(name) from error


def is_all_of_its_fields(cls):
    both = both_of(cls)
    value = make(cls, {field: a for field, (a, _) in both.items()})
    for other in (make(cls, {f: copy.deepcopy(a) for f, (a, _) in both.items()}), pickle.loads(pickle.dumps(value))):
        assert equal(value, other)
        if not speaks(value):
            continue
        with contextlib.suppress(TypeError):  # unhashable
            assert hash(other) == hash(value)
    for field, (_, b) in both.items():
        changed = make(cls, {f: b if f == field else copy.deepcopy(a) for f, (a, _) in both.items()})
        assert not equal(value, changed), field
    assert value != "something else"


def shows_itself(cls):
    """Its name and all fields; parts of a design leave out what is as by default."""
    both = both_of(cls)
    value = make(cls, {field: a for field, (a, _) in both.items()})
    text = repr(value)
    assert cls.__name__ in text
    if issubclass(cls, Camera | LightField | DisparityMap | Numbers):
        return  # some thousand numbers: symbols, sizes, or a table's own names
    defaults = {name: field.default for name, field in getattr(cls, "model_fields", {}).items()}
    left_out = [field for field in both if f"{field}=" not in text]
    assert all(field in defaults and defaults[field] == getattr(value, field) for field in left_out), left_out


@pytest.mark.parametrize("preset", ["paper", "cystoscope", "paper-singlet"])
def test_a_camera_is_all_of_its_numbers(preset):
    camera = Camera.of(roslf.load(preset))
    _ = camera.chief_point(0.1, 0.2), camera.decentre("aperture")
    again = pickle.loads(pickle.dumps(camera))
    assert again == camera
    assert hash(again) == hash(camera)
    assert again.worked_out is not camera.worked_out
    assert not copy.copy(camera).replace({}).worked_out
    for place in camera.numbers:
        assert camera.replace({place: camera[place] + 1e-9}) != camera, place


# --- caches -----------------------------------------------------------------------------------------------------------


def forget() -> None:
    """Empty every cache of the package."""
    for module in modules():
        for one in vars(module).values():
            if hasattr(one, "cache_clear"):
                one.cache_clear()


def outcome(design: roslf.Design) -> str:
    if design.lens is None:
        return json.dumps(roslf.evaluate(design, [(1.0, 0.5)]).to_dict())
    field = real_field(design, [(1.0, 0.5)])
    return repr((field.images, field.shift, field.widening, field.lateral_colour))


LIQUID = {"index": 1.333, "abbe": 55.8}
PLATE = {"kind": "plate", "distance": 130.0, "thickness": 4.0, "material": {"index": 1.5168, "abbe": 64.17}}
# At the line of the given indices cameras have the same numbers, whatever their dispersion.
YELLOW = {"elements": [PLATE], "object_space.medium": LIQUID, "light.wavelength": D_LINE * 1e-3}
SINGLET = roslf.load("paper-singlet").replace(YELLOW)
NEIGHBOURS = {
    "the liquid's dispersion": (SINGLET, {"object_space.medium": LIQUID | {"abbe": 30.0}}),
    "the plate's dispersion": (SINGLET, {"elements": [PLATE | {"material": {"index": 1.5168, "abbe": 30.0}}]}),
    "a surface": (SINGLET, {"main_lens.prescription": "ac254-100-a"}),
    "the wavelength": (SINGLET, {"light.wavelength": "500 nm"}),
    "a decentre": (SINGLET, {"main_lens.decentre": (0.0, 0.2)}),
    "an index beside a lens": (roslf.load("cystoscope"), {"object_space.medium": LIQUID | {"abbe": 30.0}}),
    "a temperature": (
        roslf.load("cystoscope").replace({"environment": {"temperature": "37 degC", "housing": "steel"}}),
        {"environment": {"temperature": "37 degC", "housing": "aluminium"}},
    ),
    "colours": (roslf.load("paper"), {"sensor.colours": "RGGB"}),
    "the layout": (roslf.load("paper"), {"microlens_array.layout": "hexagonal"}),
}
"""Designs that differ in one thing alone."""


@pytest.mark.parametrize("what", NEIGHBOURS)
def test_what_was_evaluated_before_leaves_nothing_behind(what, known_before):
    design, change = NEIGHBOURS[what]
    pair = design, design.replace(change)
    orders = []
    for order in (1, -1):
        forget()
        known_before.clear()
        orders.append([outcome(one) for one in pair[::order]][::order])
    assert orders[0] == orders[1]
    assert orders[0][0] != orders[0][1]
