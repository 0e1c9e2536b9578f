"""The camera that everything computes with."""

from .camera import TIP, Camera, Rim, nominal_numbers
from .frames import Frame, Number, Vector

__all__ = ["TIP", "Camera", "Frame", "Number", "Rim", "Vector", "nominal_numbers"]
