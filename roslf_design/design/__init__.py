"""Design of a system: frozen values, units at the boundary, TOML in and out, presets."""

from ..errors import Problem
from .check import DesignError
from .design import Design
from .files import dumps, load, loads, preset_names, preset_path, save
from .parts import PATHS, Light, MainLens, MicrolensArray, Pupil, Sensor, Stop

__all__ = [
    "PATHS",
    "Design",
    "DesignError",
    "Light",
    "MainLens",
    "MicrolensArray",
    "Problem",
    "Pupil",
    "Sensor",
    "Stop",
    "dumps",
    "load",
    "loads",
    "preset_names",
    "preset_path",
    "save",
]
