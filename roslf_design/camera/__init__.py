"""The camera that everything computes with."""

from ..bore.part import Number
from .camera import Camera
from .frames import Frame, Vector
from .numbers import BESIDE, TEMPERATURES, TIP, VIEWING_CONDITIONS
from .rims import Rim

__all__ = ["BESIDE", "TEMPERATURES", "TIP", "VIEWING_CONDITIONS", "Camera", "Frame", "Number", "Rim", "Vector"]
