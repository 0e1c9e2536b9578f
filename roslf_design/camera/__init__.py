"""The camera that everything computes with."""

from ..bore.part import Number
from .camera import TEMPERATURES, TIP, VIEWING_CONDITIONS, Camera, Rim
from .frames import Frame, Vector

__all__ = ["TEMPERATURES", "TIP", "VIEWING_CONDITIONS", "Camera", "Frame", "Number", "Rim", "Vector"]
