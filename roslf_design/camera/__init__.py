"""The camera that everything computes with."""

from ..design.parts import Number
from .camera import TIP, Camera, Rim
from .frames import Frame, Vector

__all__ = ["TIP", "Camera", "Frame", "Number", "Rim", "Vector"]
