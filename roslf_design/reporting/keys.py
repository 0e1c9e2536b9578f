"""Keys of every file that users write, from the models that read them: `roslf keys` and the reference pages print them.

Texts are those of the code below each field; what it leaves undescribed, or says in words that need the code, stands in
``keys.toml``. Names and values in them stand in backticks.
"""

from __future__ import annotations

import ast
import inspect
import re
import sys
import tomllib
import types
from collections.abc import Iterable, Sequence
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin, get_type_hints

from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from ..bench import captures as bench
from ..bore.elements import AnyElement, ObjectSpace
from ..bore.lens_sheet import LensSheet
from ..bore.mapping import MappingTable
from ..bore.real_lens import Lens
from ..calibration.options import BoardDistances, PlanOptions
from ..catalogue.entries import MODELS
from ..design import PATHS, Design, Light, MainLens, MicrolensArray, Pupil, Sensor, Stop
from ..design.environment import Environment
from ..design.parts import Cover, DepthSettings, Housing, Substrate
from ..design.required import Required
from ..errors import InputError, Problem
from ..lenses.glass import Glass
from ..lenses.lens_file import Asphere, Curvature, LensFile, Radius, SurfaceTable
from ..lenses.material import Material
from ..lenses.solid import Solid
from ..optimization.bore import BoreTable, StopTable, TubeTable
from ..optimization.combinations import CatalogueTable
from ..optimization.front import ParetoTable
from ..optimization.goals import Constraint, Goal
from ..optimization.robust import PerturbTable, RobustTable
from ..optimization.solve import SolverTable
from ..optimization.study import StudyTable
from ..optimization.variables import Variable
from ..scenes.objects import OBJECTS, TEXTURES
from ..scenes.scene import Scene, SceneLight
from ..tolerancing import study as tolerance
from ..tolerancing.study import FieldPlace
from ..toml_files import KIND, nearest
from ..units import (
    UNITS,
    Angle,
    AnyLength,
    Distance,
    Gradient,
    Illuminance,
    Length,
    Radiance,
    Temperature,
    Time,
    format_quantity,
)
from . import story

_QUANTITIES = (
    (Length, "length\u00a0>\u00a00"), (Distance, "length\u00a0≥\u00a00"), (AnyLength, "length"), (Angle, "angle"),
    (Illuminance, "illuminance"), (Radiance, "radiance"), (Time, "time"), (Temperature, "temperature"),
)  # fmt: skip
_OTHERS = (
    (Lens, "text or table"), (FieldPlace, "name, length or [length, length]"), (Material, "name or table"),
    (Gradient, "gradient\u00a0>\u00a00"), (Radius, '`"inf"` or length'), (Curvature, "curvature"),
)  # fmt: skip
NEEDED, INSTEAD = "needed", "see meaning"
"""Default of a key that a file must have, unless another gives it."""


class UndescribedError(ValueError):
    """A key that neither the code nor ``keys.toml`` says anything about."""


class FileKey(NamedTuple):
    """One key of a table."""

    name: str
    takes: str
    """Kind of value and its range, in words."""
    default: str
    meaning: str

    def words(self) -> tuple[str, ...]:
        """Fields as a terminal shows them."""
        return tuple(text.replace("`", "").replace("\u00a0", " ") for text in self)


class KeyTable(NamedTuple):
    """One table of a file."""

    file: str
    heading: str
    """Heading as a file writes it, in backticks."""
    model: type[BaseModel]
    """Reader of the table."""

    @property
    def place(self) -> str:
        """Dotted name: that of the file, of the table, and the kind where it may be of several."""
        name = re.match(r"`\W*([\w.]+)\W*`", self.heading)
        kind = re.search(r'kind "(\w+)"', self.heading)
        return ".".join([self.file, *(match[1] for match in (name, kind) if match)])

    @property
    def about(self) -> str:
        """Summary of what it is."""
        return " ".join(inspect.cleandoc(self.model.__doc__ or "").split("\n\n")[0].split())

    def rows(self) -> list[FileKey]:
        """Every key, in the order of the code."""
        return list(_rows(self))


_ELEMENTS = {get_args(kind.model_fields[KIND].annotation)[0]: kind for kind in get_args(get_args(AnyElement)[0])}
_SHEET = {key: get_args(LensSheet.model_fields[key].annotation)[0] for key in ("distortion", "relative_illumination")}
WHOLE = "The file"
_HEADED: dict[str, dict[str, type[BaseModel]]] = {
    "design": {
        WHOLE: Design, "`[main_lens]`": MainLens, "`[main_lens.sheet]`": LensSheet,
        **{f"`main_lens.sheet.{key}`": kind for key, kind in _SHEET.items()},
        "`[aperture]`": Pupil, "`[[stops]]`": Stop, "`[object_space]`": ObjectSpace,
        **{f'`[[elements]]`, kind "{name}"': kind for name, kind in _ELEMENTS.items()},
        "`mapping`, where it is a table": MappingTable, "`[microlens_array]`": MicrolensArray,
        "`microlens_array.substrate`": Substrate, "`[sensor]`": Sensor, "`sensor.cover`": Cover, "`[tube]`": Housing,
        "`[environment]`": Environment, "`[light]`": Light, "`[depth]`": DepthSettings,
        "`[required]`, each quantity": Required,
    },
    "scene": {
        WHOLE: Scene, "`[light]`": SceneLight,
        **{f'`[[objects]]`, kind "{name}"': kind for name, kind in OBJECTS.items()},
        **{f'`texture`, kind "{name}"': kind for name, kind in TEXTURES.items()},
    },
    "tolerance": {
        WHOLE: tolerance.Study, "`[[perturb]]`": tolerance.Perturb, "`[[groups]]`": tolerance.Group,
        "`[[goals]]`": tolerance.MetricGoal, "`[[compensators]]`": tolerance.Compensate,
    },
    "optimize": {
        WHOLE: StudyTable, "`[variables]`, each": Variable,
        "`[[constraints]]`": Constraint, "`[[goals]]`": Goal, "`[bore]`": BoreTable,
        "`[bore.tube]`": TubeTable, "`[[bore.stops]]`": StopTable, "`[solver]`": SolverTable,
        "`[pareto]`": ParetoTable, "`[catalogue]`": CatalogueTable,
        "`[robust]`": RobustTable, "`[[robust.perturb]]`": PerturbTable,
    },
    "catalogue": {f"`[[{kind}]]`": model for kind, model in MODELS.items()},
    "story": {
        "`[story]`": story.StoryHeader, "`[[parts]]`, one study each": story.StoryPart,
        "`parts.calibration`": PlanOptions,
    },
    "bench": {
        WHOLE: bench.Setup, "`[board]`": bench.BoardTarget, "`[edge]`": bench.EdgeTarget, "`[wall]`": bench.WallTarget,
        "`[spheres]`": bench.SpheresTarget, "`[field]`": bench.FieldTarget, "`[[poses]]`": bench.BoardPose,
    },
    "distances": {WHOLE: BoardDistances},
    "lens": {WHOLE: LensFile, "`[[surfaces]]`": SurfaceTable, "`surfaces.asphere`": Asphere},
}  # fmt: skip
FILES = {file: tuple(KeyTable(file, *one) for one in tables.items()) for file, tables in _HEADED.items()}
"""Tables of each kind of file: designs, scenes, studies of `roslf tolerance` and `roslf optimize`, parts of one's own,
stories, ``bench.toml``, `roslf calibrate --distances` and lenses."""
TABLES = tuple(table for tables in FILES.values() for table in tables)


def looked_up(name: str) -> list[tuple[KeyTable, list[FileKey]]]:
    """Tables of a name, with those inside them, or else keys of it, each with its table.

    Parameters
    ----------
    name : str
        Dotted, with as much of the way before it as is wanted: "sensor", "design.sensor", "sensor.pixel", "pixel".

    Raises
    ------
    InputError
        Nothing has that name; names the nearest that is known.
    """
    steps = [step for step in re.split(r"[^\w]+", name.lower()) if step and not step.isdecimal()]
    whole = [(table, table.rows()) for table in TABLES if steps and _leads(steps, table.place)]
    if whole:
        return whole
    several = [
        (table, [key for key in table.rows() if steps[-1:] == [key.name.lower()]])
        for table in TABLES
        if _leads(steps[:-1], table.place)
    ]
    if single := [(table, keys) for table, keys in several if keys]:
        return single
    if name in PATHS:
        return looked_up(PATHS[name])
    if others := _called(steps):
        return [found for other in others for found in looked_up(".".join([other, *steps[1:]]))]
    if len(steps) > 2 and steps[0] in {step for known in _names() for step in known.split(".")}:
        return looked_up(".".join(steps[1:]))  # a table within tables goes by its own name
    meanings = {table.place: table.about for table in TABLES}
    near = nearest(".".join(steps), _names(), _OVERVIEW, meanings)
    raise InputError((Problem("", f"'{name}' is no table and no key of a file; {near}"),))


def _called(steps: Sequence[str]) -> tuple[str, ...]:
    """Names in files of what guides call otherwise, or name in the singular or plural; empty of others."""
    word = next(iter(steps), "")
    known = {step for place in _names() for step in place.split(".")}
    forms = () if word in known else (word, f"{word}s", word.removesuffix("s"))
    return next((CALLED.get(form, (form,)) for form in forms if form in CALLED or form in known), ())


CALLED = {
    "study": ("tolerance", "optimize"), "studies": ("tolerance", "optimize"), "optimise": ("optimize",),
    "optimisation": ("optimize",), "optimization": ("optimize",), "perturbation": ("perturb",), "front": ("pareto",),
    "limit": ("required", "tolerance.goals", "constraints"), "requirement": ("required",),
    "adjuster": ("compensators",),
    "camera": ("design",), "fap": ("aperture",), "pupil": ("aperture",), "mla": ("microlens_array",),
    "array": ("microlens_array",), "microlens": ("microlens_array",), "microlenses": ("microlens_array",),
    "objective": ("elements.lens",), "relay": ("elements.lens", "relay_magnification"), "rod": ("elements.grin",),
    "liquid": ("object_space",), "water": ("object_space",), "cone": ("tube",), "lamp": ("light",),
    "illumination": ("light",), "filter": ("colours",), "focus": ("focal_plane",), "capture": ("bench",),
}  # fmt: skip
"""Words of guides and people, and what files call them."""


def told_of(name: str, shown: Sequence[tuple[KeyTable, list[FileKey]]]) -> list[str]:
    """Places of tables that are about what a name says, where only single keys have it."""
    if any(len(keys) == len(table.model.model_fields) for table, keys in shown):
        return []
    step = name.lower().rpartition(".")[2]
    word = re.compile(rf"\b{re.escape(step)}\b")
    named = [one.place for one in TABLES if step in one.place.split(".")]
    return named or [one.place for one in TABLES if word.search(one.about.lower())]


_OVERVIEW = "`roslf keys` lists all"


def _leads(steps: list[str], place: str) -> bool:
    """Whether steps stand in a dotted place in their order."""
    rest = iter(place.split("."))
    return all(step in rest for step in steps)


def _names() -> list[str]:
    """Every name of a table or a key, short and with the table before it."""
    names = []
    for table in TABLES:
        within = table.place.partition(".")[2]
        keys = [field.alias or key for key, field in table.model.model_fields.items()]
        names += [table.file, within, *keys, *(f"{within}.{key}" for key in keys if within)]
    return list(dict.fromkeys(filter(None, names)))


def units_of(keys: Iterable[FileKey]) -> dict[str, str]:
    """Units of the kinds of quantity that keys take."""
    words = {word for key in keys for word in re.findall(r"\w+", key.takes)}
    alike = str.maketrans("μ", "µ")
    return {
        kind: ", ".join(dict.fromkeys(unit.translate(alike) for unit in units))
        for kind, units in UNITS.items()
        if kind in words
    }


def descriptions(kind: type) -> dict[str, str]:
    """Texts of the fields of a class, from below each; of base classes too."""
    texts: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        if base.__module__.startswith("roslf_design"):
            texts |= _texts_below(base.__module__).get(base.__qualname__, {})
    return texts


@cache
def _rows(table: KeyTable) -> tuple[FileKey, ...]:
    """Every key, in the order of the code."""
    texts = _texts_beside()
    own = {name: text for kind in reversed(table.model.__mro__) for name, text in texts.get(kind.__name__, {}).items()}
    own |= texts.get(table.heading.strip("`"), {})
    fields = table.model.model_fields.items()
    words = descriptions(table.model) | own
    hints = get_type_hints(table.model, include_extras=True)
    keys = []
    for name, field in fields:
        called = field.alias or name
        if name == KIND and get_origin(hints[name]) is Literal and len(get_args(hints[name])) == 1:
            keys.append(FileKey(called, f'`"{get_args(hints[name])[0]}"`', NEEDED, "which of these it is"))
            continue
        if name not in words:
            raise UndescribedError(f"{table.model.__name__}.{name} is described neither in the code nor in keys.toml")
        default = NEEDED
        if not field.is_required():  # a default that is validated stands for what is given elsewhere
            other = field.validate_default
            default = INSTEAD if other else _default(field.get_default(call_default_factory=True), hints[name])
        # In a file a length carries its own unit.
        meaning = re.sub(r" ?\[(mm|rad|lx|s|W/m\^2/sr|degrees C)\]", "", words[name])
        meaning = re.sub(r"\bNone\b", "left out", re.sub(r"(?<=\. )None\b", "Left out", meaning)).strip(" .")
        meaning = f"{meaning or name.replace('_', ' ').capitalize()}."
        limits = "" if get_origin(hints[name]) is Annotated else _limits(field.metadata)
        keys.append(FileKey(called, f"{_takes(hints[name])} {limits}".rstrip(), default, meaning))
    return tuple(keys)


@cache
def _texts_beside() -> dict[str, dict[str, str]]:
    """Texts of ``keys.toml``, by the class or the heading."""
    return tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))


@cache
def _texts_below(module: str) -> dict[str, dict[str, str]]:
    """Texts below the fields of every class of a module, by the class."""
    texts: dict[str, dict[str, str]] = {}
    for tree in ast.parse(inspect.getsource(sys.modules[module])).body:
        for line, below in pairwise(tree.body if isinstance(tree, ast.ClassDef) else ()):
            match tree, line, below:
                case ast.ClassDef(), ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(str(text))):
                    texts.setdefault(tree.name, {})[name] = " ".join(text.split())
    return texts


def _takes(hint: Any) -> str:
    """Kind of value that a key may hold, in words."""
    for known, words in (*_QUANTITIES, *_OTHERS):
        if hint == known or (
            get_origin(hint) is Annotated and get_args(hint)[: len(get_args(known))] == get_args(known)
        ):
            return words
    origin, parts = get_origin(hint), get_args(hint)
    if origin is Annotated:
        words, limits = _takes(parts[0]), _limits(parts[1:])
        return f"{words} {limits}" if limits else words
    if origin in (Union, types.UnionType):
        return " or ".join(dict.fromkeys(_takes(part) for part in parts if part is not type(None)))
    if origin is Literal:
        return " or ".join(f'`"{part}"`' if isinstance(part, str) else f"`{part}`" for part in parts)
    if origin is tuple:
        words = _takes(parts[0])
        if parts[-1] is Ellipsis:
            return "tables" if words == "table" else f"list of {words}"
        return (
            f"[{', '.join([words] * len(parts))}]" if set(parts) == {parts[0]} else f"[{', '.join(map(_takes, parts))}]"
        )
    if origin is dict or (isinstance(hint, type) and issubclass(hint, BaseModel)):
        return "table"
    simple = {float: "number", int: "whole number", bool: "`true` or `false`", str: "text", Any: "text or number"}
    return simple.get(hint, getattr(hint, "__name__", str(hint)).lower())


def _limits(constraints: Iterable[Any]) -> str:
    signs = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤"}
    parts = [part for constraint in constraints for part in getattr(constraint, "metadata", [constraint])]
    limits = ((sign, getattr(part, name, None)) for part in parts for name, sign in signs.items())
    return ", ".join(f"{sign}\u00a0{_number(limit)}" for sign, limit in limits if limit is not None)


def _number(value: float) -> str:
    return f"{value:.0e}".replace("e+", "e") if isinstance(value, int) and value > 10**6 else f"{value:,}"


def _default(value: Any, hint: Any) -> str:
    if value is PydanticUndefined or value is None or value == () or value == {}:
        return "none"
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, BaseModel):
        return "its own"
    if isinstance(value, tuple) and isinstance(value[0], BaseModel):
        return "a white field"
    if isinstance(value, tuple):
        unit = "length" if _takes(get_args(hint)[0]).startswith("length") else "angle"
        quantities = "length" in _takes(hint) or "angle" in _takes(hint)
        texts = [f'"{format_quantity(v, unit)}"' if isinstance(v, float) and quantities else repr(v) for v in value]
        return f"`[{', '.join(texts)}]`".replace("'", '"')
    for known, words in _QUANTITIES:
        if hint == known:
            return f'`"{format_quantity(value, words.partition(chr(0xA0))[0])}"`'
    if isinstance(value, (Glass, Solid)):
        return f'`"{value.name}"`'
    return f'`"{value}"`' if isinstance(value, str) else f"`{value:g}`"
