"""For modules that are being moved: lengths of a design that several effects share."""

from __future__ import annotations

from ..camera import Camera
from ..design import Design
from ..theory import light
from ..theory.exit_pupil import microlens_image_diameter, microlens_image_pitch, stop_angle
from ..theory.light import half_field
from .effect import SceneBrief, Subject


def half_sizes(design: Design) -> tuple[float, float]:
    """Half width and half height of the microlens array that the sensor sees [mm]."""
    x, y = half_field(Camera.of(design))
    return float(x), float(y)


def field_radius(design: Design, brief: SceneBrief) -> float:
    """X_ml of the farthest microlens that counts [mm]."""
    return Subject(design, brief).x_ml


def exit_pupil_vergence(design: Design) -> float:
    """1/L [1/mm]."""
    return float(Camera.of(design).vergence)


def image_pitch(design: Design) -> float:
    """d(1 + d_2/L) [mm]."""
    return float(microlens_image_pitch(Camera.of(design)))


def stop_scale(design: Design, distance: float) -> float:
    """Scale h d_2/d_1 of a length on a stop at `distance` on the sensor."""
    return design.d_2 * float(stop_angle(Camera.of(design), distance))


def image_diameter(design: Design) -> float:
    """D_F H d_2/d_1 [mm]."""
    return float(microlens_image_diameter(Camera.of(design)))


def ray_blur(design: Design) -> float:
    """Width of the sensor patch that one point of the exit pupil lights through the whole microlens [mm]."""
    return float(light.microlens_defocus_blur(Camera.of(design)))


def defocus(design: Design) -> float:
    """1/f_ml - 1/d_2 - 1/L [1/mm]; zero where the exit pupil is in focus on the sensor."""
    return -float(light.microlens_defocus(Camera.of(design))) / design.d_2


def blur_width(design: Design, wavelength: float) -> float:
    """First zero of a square microlens's diffraction, w = lambda d_2/d [mm]."""
    return float(light.diffraction_width(Camera.of(design, {"wavelength": wavelength})))
