"""Cameras that depth is proved for: all that ship, and some that are drawn by seed from wide ranges.

A camera is a plain design, and a place on its array for each scene.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from roslf_design.camera import Camera
from roslf_design.design import Design, load, preset_names
from roslf_design.errors import InputError
from roslf_design.theory.light import fresnel_number
from roslf_design.theory.quantities import QUANTITIES
from roslf_design.theory.stop_images import MicrolensImages

SEED, DRAWN = 30, 20
"""Seed of the cameras that are drawn, and how many."""
FRESNEL, PIXELS = (0.5, 6.0), (8.0, 50.0)
"""Fresnel number of a microlens, pixels a pitch; even in their logarithms."""
PIXEL, WAVELENGTH = (1.4e-3, 6e-3), (0.45e-3, 0.65e-3)
"""[mm]"""
MAGNIFICATION, SLOPE, BORE, CUTTING = (0.1, 0.6), (0.05, 0.3), (0.05, 0.7), (0.3, 0.7)
"""d_1/d_f, half the sensor's width over d_1, d_3/d_f; this where the main lens is to cut images."""
ACROSS = (40.0, 150.0)
"""Microlenses across the sensor; a real lens has a larger sensor of the same microlenses."""
FILLS = {"matched": (0.95, 1.0), "gaps": (0.6, 0.9), "overlap": (1.1, 1.6)}
"""Diameter of a microlens's image over the pitch of the images."""
KEPT = (0.4, 0.85)
"""Share of the image that a small main lens keeps, where it is looked."""
MICROLENS_F = (3.0, 60.0)
"""f-numbers of microlenses that are made."""
LARGEST = 0.1
"""Predicted standard error up to which depth can be told [pitches]: a third of the largest that is told at all."""
LENSES = ("AC254-050-A", "AC254-100-A", "AC508-150-A", "LA1050-A")
"""Real main lenses that are drawn from."""
FIELD = 0.8
"""Share of the sensor's half width and height within which places are drawn."""
TRIES = 1000


class RefusedError(Exception):
    """Numbers drawn that make no camera, with the reason."""


class ProofCamera(NamedTuple):
    """A camera and how it was made."""

    design: Design
    words: str
    """Description in words."""
    cut: bool = False
    """Whether its main lens cuts images where it is looked; places are then near the sensor's side."""
    refused: tuple[str, ...] = ()
    """Reasons why numbers drawn before these made none."""


@cache
def cameras() -> dict[str, ProofCamera]:
    """Every camera by its name: presets, then those drawn."""
    every = {name: ProofCamera(load(name), _words(load(name))) for name in preset_names()}
    return every | {f"drawn {number}": _drawn(number) for number in range(1, DRAWN + 1)}


def place(camera: ProofCamera, rng: np.random.Generator) -> tuple[float, float]:
    """Place on the array, drawn from the sensor's field [mm]."""
    along, down = rng.uniform(-FIELD, FIELD, 2)
    if camera.cut:
        along, down = FIELD * math.copysign(rng.uniform(0.95, 1.0), along), 0.0
    width, height = camera.design.sensor.size
    relay = camera.design.sensor.relay_magnification
    return along * width / (2 * relay), down * height / (2 * relay)


def _drawn(number: int) -> ProofCamera:
    rng, refused = np.random.default_rng([SEED, number]), list[str]()
    for _ in range(TRIES):
        try:
            design, cut = _tried(rng, number)
        except InputError as error:
            refused.append("; ".join(problem.key for problem in error.problems))
        except RefusedError as error:
            refused.append(str(error))
        else:
            return ProofCamera(design, _words(design), cut, tuple(refused))
    raise RefusedError(f"none of {TRIES} draws makes camera {number}")


def _tried(rng: np.random.Generator, number: int) -> tuple[Design, bool]:
    """A design from numbers drawn, and whether its main lens cuts; what kind it is goes by its number."""
    evenly = rng.uniform

    def logarithmic(ends: tuple[float, float]) -> float:
        return float(np.exp(rng.uniform(*np.log(ends))))

    wavelength, pixel = evenly(*WAVELENGTH), logarithmic(PIXEL)
    pitch = logarithmic(PIXELS) * pixel
    sensor = pitch**2 / (4 * wavelength * logarithmic(FRESNEL))
    if not MICROLENS_F[0] <= sensor / pitch <= MICROLENS_F[1]:
        raise RefusedError("microlenses that are not made")
    m, slope, count = evenly(*MAGNIFICATION), evenly(*SLOPE), logarithmic(ACROSS)
    array, kind = count * pitch / (2 * slope), number % 5
    lens: dict[str, Any] = {"focal_length": array / (1 + m), "diameter": array}
    if kind == 0:
        lens = {"prescription": str(rng.choice(LENSES)), "reversed": bool(rng.integers(2))}
        focal = load("paper-singlet").replace({f"main_lens.{key}": value for key, value in lens.items()}).f
        array, slope = focal * (1 + m), slope / 3
        count = 2 * slope * array / pitch
    focus = array / m
    cut = kind in (1, 4)
    bore = evenly(*(CUTTING if cut else BORE)) * focus
    pixels = [round(count * pitch / pixel), round(0.75 * count * pitch / pixel)]
    data: dict[str, Any] = {
        "name": f"drawn {number}",
        "main_lens": {**lens, "focal_plane": focus},
        "aperture": {"diameter": 0.01 * focus, "distance": bore},
        "microlens_array": {
            "pitch": pitch, "focal_length": sensor, "size": (1.2 * count * pitch, count * pitch),
            "layout": "hexagonal" if number % 4 == 1 else "square",
            "lens_shape": str(rng.choice(["square", "circular"])),
        },
        "sensor": {"distance": sensor, "pixel": pixel, "pixels": pixels, "colours": "RGGB" if kind == 2 else "mono"},
        "light": {"wavelength": wavelength},
    }  # fmt: skip
    if kind == 3:
        data |= _elements(rng, bore, focus)
    design = Design.make(data)
    camera = Camera.of(design.thin_twin)
    fill = evenly(*FILLS[list(FILLS)[number % 3]])
    width = abs(float(QUANTITIES["image_diameter_mm"](camera) / QUANTITIES["image_pitch_mm"](camera)))
    design = design.replace(D_F=0.01 * focus * fill / width)
    if kind:
        reach = 1.3 * slope * array / m / (focus - bore) * bore + design.D_F * focus / (focus - bore) / 2
        design = design.replace({"main_lens.diameter": 2.1 * reach})
        if design.f < design.D:
            raise RefusedError("main lens faster than f/1")
    if cut:
        design = _cutting(design, evenly(*KEPT))
    if float(QUANTITIES["sigma_disparity_pitches"](Camera.of(design.thin_twin))) > LARGEST / 2:
        raise RefusedError("too little light or too few views to tell depth")
    return design, cut


def _elements(rng: np.random.Generator, bore: float, focus: float) -> dict[str, Any]:
    """A window before water or air, or a weak lens, in the bore."""
    at, thick = bore + 0.1 * (focus - bore), 0.02 * focus
    if rng.integers(2):
        power = {"kind": "lens", "distance": at, "focal_length": focus * rng.uniform(1.0, 3.0) * rng.choice([-1, 1])}
        return {"elements": [power | {"diameter": focus}]}
    window = {"kind": "plate", "distance": at, "thickness": thick, "material": "sapphire", "diameter": focus}
    return {"elements": [window], "object_space": {"medium": str(rng.choice(["air", "water"]))}}


def _cutting(design: Design, share: float) -> Design:
    """Design whose main lens keeps this share of the images at the sensor's side; by halving."""
    at = FIELD * design.sensor.size[0] / 2
    small, large = design.D / 50, design.D
    for _ in range(40):
        middle = (small + large) / 2
        images = MicrolensImages(Camera.of(design.replace(D=middle).thin_twin), [(at, 0.0)])
        if float(images.shapes.kept_fraction[0, 0]) < share:
            small = middle
        else:
            large = middle
    return design.replace(D=large)


def _words(design: Design) -> str:
    """Camera in a few words."""
    camera = Camera.of(design.thin_twin)
    pitch = abs(float(QUANTITIES["image_pitch_mm"](camera)))
    fill = abs(float(QUANTITIES["image_diameter_mm"](camera))) / pitch
    kind = "gaps" if fill < 0.93 else "overlap" if fill > 1.05 else "matched"
    words = [
        f"N_F {float(fresnel_number(camera)):.2g}", f"{pitch / float(camera.q):.2g} px a pitch",
        kind if kind == "matched" else f"{kind} {fill:.2g}",
    ]  # fmt: skip
    words += [design.microlens_array.layout] if design.microlens_array.layout != "square" else []
    words += [design.sensor.colours] if design.sensor.colours != "mono" else []
    words += dict.fromkeys(element.kind for element in design.elements)
    return ", ".join(words + (["real lens"] if design.main_lens.prescription is not None else []))
