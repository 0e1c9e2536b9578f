"""The plan keeps its word: what it leaves out is smaller than it says, what it renders is larger than the budget.

Sizes are measured on images. Pixels: an edge moved by a share of a pixel changes the pixel that it crosses by as much
of full scale, so the largest change of any pixel is the displacement (as long as it stays below one pixel). Intensity:
rms of the change, for smooth fall-off its largest value. Pitches: mean change over the mean gradient along the array.
"""

import numpy as np
import pytest

from roslf_design.design import load
from roslf_design.effects import Budget, plan
from roslf_design.imaging.render import render
from roslf_design.imaging.trace import RaySampling
from roslf_design.scenes import Checkerboard, Plane, Points, Scene, SceneLight, Sinusoid

PAPER = load("paper")
PIPE = load("pipe-bore")
SCOPE = load("rigid-scope")
BORE = load("mismatched-borescope")
OUT_OF_FOCUS = PAPER.replace(f_ml=1.0)
SHARP = PAPER.replace(wavelength=7e-6)
PITCH_ON_OBJECT = 0.1575

MANY, FEW = RaySampling(256, 256, 0.0, 7), RaySampling(64, 64, 0.0, 7)
"""Rays enough that their noise does not count: against exact areas, and where it is the same with and without."""


def small(scene_period, distance=None, edges=False):
    texture = (Checkerboard if edges else Sinusoid)(period=scene_period)
    return Scene(objects=(Plane(distance=distance, texture=texture),))


def measure(design, scene, name, region, budget, overrides, how):
    """Estimate of an effect, whether it is on, and how much switching it changes the image."""
    lines = plan(design, scene, budget, overrides)
    sampling = MANY if scene is None else FEW
    with_it = render(design, scene, budget=budget, overrides=[*overrides, f"+{name}"], region=region, sampling=sampling)
    without = render(design, scene, budget=budget, overrides=[*overrides, f"-{name}"], region=region, sampling=sampling)
    change = with_it.pixels.astype(float) - without.pixels
    if how == "largest":
        size = np.abs(change).max()
    elif how == "coherent":  # edges are as wide as the blur, from dark to the brightest
        size = np.abs(change).max() / without.pixels.max() * lines["microlens_diffraction"].estimate
    elif how == "rms":
        size = np.sqrt(np.mean(change**2))
    else:
        gradient, bright = how(scene), without.pixels.mean() / 0.5
        size = np.abs(change).mean() / (gradient * bright)
    return lines[name], float(size)


def along_array(scene):
    """Mean brightness change per pitch of a texture on the focal plane, where bright and dark share evenly."""
    texture = scene.objects[0].texture
    steps = 2 if isinstance(texture, Sinusoid) else 4  # a checkerboard jumps along both axes
    return steps * PITCH_ON_OBJECT / texture.period


BOARD = small(0.42, edges=True)
POINT = Scene(objects=(Points(positions=((-27.0, -17.75, 350.0),)),))
"""Its light falls into the sensor's corner."""

NO_BLUR = ["-microlens_diffraction", "-microlens_defocus", "-overlap"]

LEFT_OUT = [
    ("paper, defocus hidden by diffraction", PAPER, None, "microlens_defocus", {}, [], "largest"),
    ("paper, defocus by rays", PAPER, None, "microlens_defocus", {}, ["-microlens_diffraction"], "largest"),
    ("high Fresnel number", SHARP, None, "microlens_diffraction", {}, [], "largest"),
    ("high Fresnel number, wide budget", PIPE, None, "microlens_diffraction", {"px": 0.4}, [], "largest"),
    ("wave defocus of the scope", SCOPE, None, "microlens_defocus", {}, [], "largest"),
    ("hardly vignetted", PAPER.replace(D=39.63), None, "vignetting", {}, NO_BLUR, "largest"),
    ("touching images", PAPER, None, "overlap", {}, NO_BLUR[:2], "largest"),
    ("narrow field", PAPER, None, "cos4", {"intensity": 0.05}, [], "largest"),
    ("rotated by 20 urad", PAPER.replace({"microlens_array.rotation": 2e-5}), None, "mla_rotation", {}, [], "largest"),
    ("decentred", PAPER.replace({"sensor.decentre": (3e-4, 2e-4)}), None, "decentres", {}, [], "largest"),
    ("tilted array", PAPER.replace({"microlens_array.tilt": (2e-4, 1e-4)}), None, "tilts", {}, NO_BLUR, "largest"),
    ("smooth texture", PAPER, small(2.0), "finite_microlens_aperture", {}, [], "rms"),
    ("nearly in focus", PAPER, small(2.0, 349.0), "object_defocus", {}, [], along_array),
    ("coarse board", PAPER, small(2.0, edges=True), "fap_diffraction", {"pitch": 0.5}, NO_BLUR[:1], along_array),
    ("point", PAPER.replace(f_ml=2.008), POINT, "microlens_defocus", {}, [], "coherent"),
    ("lens aside", PAPER.replace({"main_lens.decentre": (2e-4, 0.0)}), BOARD, "decentres", {}, [], "largest"),
    ("array aside", PAPER.replace({"microlens_array.decentre": (2e-4, 2e-4)}), BOARD, "decentres", {}, [], "largest"),
    ("bright", PAPER, Scene(light=SceneLight(exposure=4e4, read_noise=20)), "noise", {}, [], "rms"),
]

RENDERED = [
    ("paper, 4 N_F = 3.6", PAPER, None, "microlens_diffraction", {}, [], "largest"),
    ("high Fresnel number", PIPE, None, "microlens_diffraction", {"px": 0.03}, [], "largest"),
    ("vignetted", BORE, None, "vignetting", {}, [], "largest"),
    ("overlapping", BORE, None, "overlap", {}, NO_BLUR[:2], "largest"),
    ("calibrated image fill", load("paper-calibrated"), None, "overlap", {}, NO_BLUR[:2], "largest"),
    ("microlenses out of focus", OUT_OF_FOCUS, None, "microlens_defocus", {}, [], "largest"),
    ("wide field", SCOPE, None, "cos4", {}, [], "largest"),
    ("rotated", PAPER.replace({"microlens_array.rotation": 1e-3}), None, "mla_rotation", {}, [], "largest"),
    ("decentred", PAPER.replace({"aperture.decentre": (0.3, 0.0)}), None, "decentres", {}, [], "largest"),
    ("tilted array", PAPER.replace({"microlens_array.tilt": (8e-3, 0.0)}), None, "tilts", {}, NO_BLUR, "largest"),
    ("fine texture", PAPER, small(0.5), "finite_microlens_aperture", {}, [], "rms"),
    ("out of focus", PAPER, small(2.0, 335.0), "object_defocus", {}, [], along_array),
    ("coarse board", PAPER, small(2.0, edges=True), "fap_diffraction", {"pitch": 0.05}, NO_BLUR[:1], along_array),
    ("point", PAPER.replace(f_ml=2.3), POINT, "microlens_defocus", {}, [], "coherent"),
    ("lens aside", PAPER.replace({"main_lens.decentre": (0.018, 0.0)}), BOARD, "decentres", {}, [], "largest"),
    ("dim", PAPER, Scene(light=SceneLight(exposure=500.0)), "noise", {}, [], "rms"),
]


def region_of(design, scene):
    """A piece of the sensor's corner, where every effect is at its largest."""
    width, height = design.pixels
    # One period, 12.7 pitches, of a 2 mm texture in the paper's camera; of white images some.
    side = 100 if scene is None else 164
    return width - side, height - side, side, side


@pytest.mark.parametrize(("design", "scene", "name", "budget", "overrides", "how"), [c[1:] for c in LEFT_OUT],
                         ids=[f"{c[3]}: {c[0]}" for c in LEFT_OUT])  # fmt: skip
def test_what_is_left_out_is_smaller_than_it_says(design, scene, name, budget, overrides, how, near_light):
    line, size = measure(design, scene, name, region_of(design, scene), Budget(**budget), overrides, how)
    assert not line.on
    # Noise is drawn at random: its rms over 25600 pixels is known to 0.5 %.
    assert size <= line.estimate * (1.02 if name == "noise" else 1.0) + 1e-6, f"{size / line.estimate:.3g} of estimate"


@pytest.mark.parametrize(("design", "scene", "name", "budget", "overrides", "how"), [c[1:] for c in RENDERED],
                         ids=[f"{c[3]}: {c[0]}" for c in RENDERED])  # fmt: skip
def test_what_is_rendered_is_larger_than_the_budget(design, scene, name, budget, overrides, how, near_light):
    line, size = measure(design, scene, name, region_of(design, scene), Budget(**budget), overrides, how)
    assert line.on
    assert size > line.budget, f"{size:.3g} of a budget of {line.budget:g}, estimated {line.estimate:.3g}"
