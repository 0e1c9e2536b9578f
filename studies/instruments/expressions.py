"""Expressions of a camera's numbers by their names: what a table of published numbers is predicted with."""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

import roslf_design as roslf
from roslf_design.calibration.options import PlanOptions, calibration_plan
from roslf_design.camera import Camera
from roslf_design.design import Design
from roslf_design.theory import light, light_field
from roslf_design.theory.depth_error import depth_at, depth_told
from roslf_design.theory.disparity_error import axial_disparity_sigma
from roslf_design.theory.disparity_information import Seen
from roslf_design.theory.photometry import Beside
from roslf_design.theory.quantities import QUANTITIES
from roslf_design.toml_files import nearest

Function = Callable[[float], float]


def distance_at_slope(c: Camera, slope: float) -> float:
    """Distance before the main lens of what moves by a slope from one pixel's view to the next [mm]."""
    return float(depth_told(c, slope))


def slope_at_distance(c: Camera, at: float) -> float:
    """Slope of what stands at a distance ahead of the tip [microlenses per px]."""
    return float(light_field.epi_slope(c, depth_at(c, np.asarray(at))))


def disparity_error(c: Camera, disparity: float) -> float:
    """Standard error of a disparity across the pupil of the size given, view mismatch included [pitches]."""
    seen = Seen(np.asarray(disparity), light.object_scale(c, None))
    return float(axial_disparity_sigma(c, seen, Beside.mismatched(c)))


OF_CAMERAS: dict[str, Callable[[Camera, float], float]] = {
    "distance_at_slope": distance_at_slope,
    "slope_at_distance": slope_at_distance,
    "disparity_error": disparity_error,
}
"""Functions of a camera and one number that are no quantities."""
OF_NUMBERS: dict[str, Function] = {
    "sqrt": math.sqrt, "asin": math.asin, "atan": math.atan, "degrees": math.degrees,
}  # fmt: skip
PLANNED, EVALUATED = "plan", "evaluate"
"""Names before a dot: errors that a calibration plan expects, as `plan.d_f`; the JSON of `roslf evaluate`, whose lists
are counted from 0, as `evaluate.focused.in_focus[0].ahead_mm`."""
OPERATORS: dict[type[ast.AST], Callable[..., float]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv,
    ast.Pow: operator.pow, ast.USub: operator.neg,
}  # fmt: skip
CALLED = {name for name, quantity in QUANTITIES.items() if quantity.at != "never"} | {*OF_CAMERAS, *OF_NUMBERS}
PLAIN = {name for name, quantity in QUANTITIES.items() if quantity.of and quantity.at != "needed"} | {"pi"}


@dataclass(frozen=True)
class Expression:
    """Arithmetic of names, as ``view_baseline_mm * 6``."""

    text: str

    @cached_property
    def tree(self) -> ast.expr:
        """Its operations.

        Raises
        ------
        SyntaxError
            It is no expression.
        """
        return ast.parse(self.text.strip(), mode="eval").body

    @property
    def asks_camera(self) -> bool:
        """True where a number of a camera stands in it."""
        names = {node.id for node in ast.walk(self.tree) if isinstance(node, ast.Name)}
        return bool(names & (PLAIN | CALLED | {PLANNED, EVALUATED}) - {"pi", *OF_NUMBERS})

    def faults(self, given: Collection[str]) -> Iterator[str]:
        """What is wrong with it, where these names beside the camera's are known."""
        try:
            tree = self.tree
        except SyntaxError:
            yield f'"{self.text}" is no expression; write one such as "view_baseline_mm * 6"'
        else:
            yield from _faults(tree, given)

    def value(self, design: Design | None, given: Mapping[str, float]) -> float:
        """Value for a design; None where only names that are given stand in it."""
        camera = None if design is None else Camera.of(design)
        return _value(self.tree, design, camera, given)


def _faults(node: ast.expr, given: Collection[str]) -> Iterator[str]:
    match node:
        case ast.Constant(value=float() | int()):
            return
        case ast.BinOp(left=left, op=op, right=right) if type(op) in OPERATORS:
            yield from _faults(left, given)
            yield from _faults(right, given)
        case ast.UnaryOp(op=ast.USub(), operand=inner):
            yield from _faults(inner, given)
        case ast.Call(func=ast.Name(id=name), args=[inner], keywords=[]):
            if name not in CALLED:
                yield f"'{name}' is no function here; {nearest(name, sorted(CALLED))}"
            yield from _faults(inner, given)
        case ast.Name(id=name):
            if name not in PLAIN and name not in given:
                otherwise = "`roslf quantities` lists all"
                yield f"'{name}' is no quantity; {nearest(name, sorted(PLAIN | set(given)), otherwise)}"
        case ast.Attribute() | ast.Subscript() if (parts := _dotted(node)) and parts[0] in (PLANNED, EVALUATED):
            return
        case _:
            yield f'"{ast.unparse(node)}" is not known; use numbers, names, + - * / **, and functions of one number'


def _dotted(node: ast.expr) -> list[str | int]:
    """Parts of a dotted name, numbers in brackets among them; empty for anything else."""
    match node:
        case ast.Name(id=name):
            return [name]
        case ast.Attribute(value=inner, attr=name):
            parts = _dotted(inner)
            return [*parts, name] if parts else []
        case ast.Subscript(value=inner, slice=ast.Constant(value=int(index))):
            parts = _dotted(inner)
            return [*parts, index] if parts else []
    return []


def _value(node: ast.expr, design: Design | None, camera: Camera | None, given: Mapping[str, float]) -> float:
    match node:
        case ast.Constant(value=number):
            return float(number)  # type: ignore[arg-type]
        case ast.BinOp(left=left, op=op, right=right):
            both = (_value(side, design, camera, given) for side in (left, right))
            return OPERATORS[type(op)](*both)
        case ast.UnaryOp(op=op, operand=inner):
            return OPERATORS[type(op)](_value(inner, design, camera, given))
        case ast.Call(func=ast.Name(id=name), args=[inner]):
            at = _value(inner, design, camera, given)
            if name in OF_NUMBERS:
                return OF_NUMBERS[name](at)
            assert camera is not None
            return OF_CAMERAS[name](camera, at) if name in OF_CAMERAS else float(QUANTITIES[name](camera, at))
        case ast.Name(id="pi"):
            return math.pi
        case ast.Name(id=name) if name in given:
            return given[name]
        case ast.Name(id=name):
            assert camera is not None
            return float(QUANTITIES[name](camera))
    assert design is not None
    return _looked_up(design, *_dotted(node))


def _looked_up(design: Design, root: str | int, *keys: Any) -> float:
    """A number of the calibration plan, or of the JSON of `roslf evaluate`.

    Raises
    ------
    LookupError
        There is none of that name.
    """
    if root == PLANNED:
        planned = calibration_plan(design, PlanOptions())
        assert not isinstance(planned, str)
        return float(planned.expected.sigma[keys[0]])
    found: Any = roslf.evaluate(design).to_dict()
    try:
        for key in keys:
            found = found[key]
        return float(found)
    except (LookupError, TypeError):
        raise LookupError(repr(key)) from None
