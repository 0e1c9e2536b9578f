"""What is looked at: white field, textured planes, point sources, spheres, tubes; TOML in."""

from .files import load_scene, loads_scene, make_scene
from .objects import Plane, Points, Sphere, Tube, White
from .scene import WHITE_FIELD, Scene, SceneError, SceneLight
from .textures import Checkerboard, Picture, Sinusoid, Uniform

__all__ = [
    "WHITE_FIELD",
    "Checkerboard",
    "Picture",
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
    "loads_scene",
    "make_scene",
]
