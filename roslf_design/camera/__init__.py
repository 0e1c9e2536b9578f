"""The camera that everything computes with."""

from ..bore.part import Number
from .camera import SEEING, TIP, Camera, Rim
from .frames import Frame, Vector

__all__ = ["SEEING", "TIP", "Camera", "Frame", "Number", "Rim", "Vector"]
