"""Rays through stops, main lens and microlenses: backward and forward, in 3D and in the meridional plane; budgets."""

from .backward import Ends, ObjectRays, ends, trace
from .budget import Fraction, RayBudget, ray_budget
from .fans import Fan, fans
from .forward import PupilRays, trace_pupil
from .meridional import MeridionalRays, Section, image_section, trace_meridional
from .status import Status, describe
from .system import Array, Lens, Sensor, Stop, System

__all__ = [
    "Array",
    "Ends",
    "Fan",
    "Fraction",
    "Lens",
    "MeridionalRays",
    "ObjectRays",
    "PupilRays",
    "RayBudget",
    "Section",
    "Sensor",
    "Status",
    "Stop",
    "System",
    "describe",
    "ends",
    "fans",
    "image_section",
    "ray_budget",
    "trace",
    "trace_meridional",
    "trace_pupil",
]
