"""Scenes before the camera: white field, textured planes, point sources, spheres, tubes; TOML in."""

from .objects import Checkerboard, Noise, PictureTexture, Plane, Points, Sinusoid, Sphere, Tube, Uniform, White
from .scene import WHITE_FIELD, Scene, SceneError, SceneLight, load_scene, make_scene

__all__ = [
    "WHITE_FIELD",
    "Checkerboard",
    "Noise",
    "PictureTexture",
    "Plane",
    "Points",
    "Scene",
    "SceneError",
    "SceneLight",
    "Sinusoid",
    "Sphere",
    "Tube",
    "Uniform",
    "White",
    "load_scene",
    "make_scene",
]
