"""What a system is: frozen values, units at the boundary, TOML in and out, presets, batches."""

from .design import Design
from .errors import DesignError, Problem
from .files import dumps, load, loads, save
from .parameters import PATHS
from .parts import Light, MainLens, MicrolensArray, Sensor, Stop
from .presets import preset_names, preset_path

__all__ = [
    "PATHS",
    "Design",
    "DesignError",
    "Light",
    "MainLens",
    "MicrolensArray",
    "Problem",
    "Sensor",
    "Stop",
    "dumps",
    "load",
    "loads",
    "preset_names",
    "preset_path",
    "save",
]
