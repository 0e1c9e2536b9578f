"""What is computed: a quantity of a camera at a field, as the few arrays that every method works on.

Panels are jobs that between them show every difficulty; random jobs are what the table is measured on and tried on.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from roslf_design.accuracy.table import QUANTITIES
from roslf_design.camera import Camera
from roslf_design.design import Design, DesignError
from roslf_design.errors import InputError
from roslf_design.evaluation.fields import field_openings
from roslf_design.lenses.lens_file import load_lens, shipped_names
from roslf_design.lenses.prescription import first_order
from roslf_design.theory.exit_pupil import microlens_image_diameter, microlens_image_pitch
from roslf_design.theory.light import fresnel_number
from roslf_design.theory.light_field import depth_sigma
from roslf_design.traced.camera import camera_of

Floats = NDArray[np.float64]

WAVES = "diffraction image"
CUT = "cut diffraction image"
LENS = "real lens"

SIGMA_DISPARITY = 0.1
"""Disparity error of "depth" [pitches]."""

RAYS = 1024
"""Rays of one microlens through a real lens, all over the FAP."""


@dataclass(frozen=True)
class Job:
    """One thing to compute."""

    quantity: str
    design: Design = field(repr=False)
    axis: tuple[float, float] = (0.0, 0.0)
    """Microlens, on the array [mm]."""
    distance: float = 0.0
    """Depth Z_F that is measured [mm]; 0 is 0.8 of that of the focal plane."""
    cycles: float = 1.3
    """Of the sinusoid across one microlens image."""
    angle: float = 0.3
    """Its direction [rad]."""

    @cached_property
    def discs(self) -> tuple[Floats, Floats]:
        """Rims on the sensor relative to the microlens axis, in pixels; those around the FAP's left out."""
        centres, radii = field_openings(self.design, [self.axis])[:2]
        c, r = centres[0] / self.design.q, radii[0] / self.design.q
        cuts = np.hypot(*(c - c[0]).T) + r[0] > r
        cuts[0] = True
        return np.ascontiguousarray(c[cuts]), np.ascontiguousarray(r[cuts])

    @property
    def radius(self) -> float:
        """Of the pupil's image [px]."""
        return float(self.discs[1][0])

    @cached_property
    def box(self) -> tuple[Floats, int]:
        """Lower corner of the patch of pixels [px], and its width in pixels: the pupil's image and one more around."""
        corner = np.floor(self.discs[0][0] - self.radius - 0.37) - 0.37
        return corner, math.ceil(2 * self.radius + 2)

    @property
    def pixels(self) -> int:
        """In the patch."""
        return self.box[1] ** 2

    @cached_property
    def cells(self) -> tuple[Floats, Floats]:
        """Corners of the patch's pixels, row by row, shapes (P, 2) [px]."""
        corner, width = self.box
        at = np.arange(width)
        low = np.stack([np.tile(at, width), np.repeat(at, width)], -1) + corner
        return low, low + 1

    @cached_property
    def centres(self) -> tuple[Floats, Floats]:
        """Centres of the patch's columns and rows, from the microlens axis [px]."""
        corner, width = self.box
        at = np.arange(width) + 0.5
        return at + corner[0], at + corner[1]

    @cached_property
    def depth(self) -> float:
        """Z_F [mm]."""
        return self.distance or 0.8 * (self.design.d_f - self.design.d_3)

    @cached_property
    def inverse_depth(self) -> tuple[float, float]:
        """1/Z_F [1/mm] and its standard deviation."""
        c = self.design
        sigma = depth_sigma(Camera.of(c), 1.0, SIGMA_DISPARITY)
        return 1 / self.depth, float(sigma)

    @cached_property
    def wave(self) -> tuple[float, float, float]:
        """Sinusoid on the sensor: cycles per pixel along x and y, and its phase at the microlens axis [cycles]."""
        rate = self.cycles / (2 * self.radius)
        phase = 0.17 + math.modf(3.1 * self.axis[0] / self.design.d)[0]
        return rate * math.cos(self.angle), rate * math.sin(self.angle), phase

    @cached_property
    def blur(self) -> tuple[float, float, float]:
        """Microlens diffraction in pixels: its width lambda d_2/d; image pitch; defocus 1/f_ml - 1/d_2 - 1/L [1/mm]."""
        c = self.design
        pitch = abs(float(microlens_image_pitch(Camera.of(c))))
        bend = 1 / c.f_ml - 1 / c.d_2 - float(Camera.of(c).seen.vergence)
        return c.wavelength * c.d_2 / c.d / c.q, pitch / c.q, bend

    @property
    def harmonics(self) -> int:
        """Highest harmonic that diffraction lets pass, along each axis."""
        width, pitch, _ = self.blur
        return math.floor(pitch / width)

    def texture(self, x: Floats, y: Floats) -> Floats:
        """Brightness of the sinusoid that each sensor point sees [px]."""
        along, across, phase = self.wave
        return np.asarray(0.5 + 0.5 * np.cos(2 * math.pi * (along * x + across * y + phase)))

    def error(self, value: Floats, truth: Floats) -> float:
        """How far a result is off, as `QUANTITIES` tells."""
        if self.quantity == LENS:
            # Many digits are known of some rays; in units of d d_f/d_1, what one microlens sees of the focal plane.
            ends, known = np.reshape(value, (-1, 2)), np.reshape(truth, (-1, 2))
            off = np.hypot(*(ends[:: len(ends) // len(known)] - known).T)
            return float(np.max(off)) / (self.design.d * self.design.d_f / self.design.d_1)
        largest = float(np.max(np.abs(np.asarray(value) - truth)))
        if self.quantity == "centroid":
            return largest / self.radius
        if self.quantity in ("area", "depth"):
            top = float(np.max(np.abs(truth)))
            return largest / top if top > 0 else (0.0 if largest == 0 else math.inf)
        return largest


# --- panels -----------------------------------------------------------------------------------------------------------


def panel_jobs(design: Design, quantity: str) -> dict[str, Job]:
    """Jobs of one quantity, one a panel that it differs on."""
    if quantity == LENS:
        cameras = {name: (camera, camera.microlens_array.size[0]) for name, camera in lens_designs(design).items()}
        return {name: Job(LENS, camera, (0.25 * side, 0.1 * side)) for name, (camera, side) in cameras.items()}
    design = design.thin_twin  # other wavelengths are asked for than a real lens has glass for
    if quantity == CUT:
        return _cut_jobs(design)
    waves = quantity == WAVES
    jobs = {}
    for name, camera in _panels(design).items():
        is_wave = name.startswith("N_F")
        if not (is_wave or name == "mismatched" if waves else not is_wave):
            continue
        if quantity == "depth" and name not in ("round", "mismatched"):
            continue
        edge = camera.sensor_size[0] / 2
        axis = (edge, 0.0) if name in ("cat's eye", "near tangent") else (0.31 * edge, 0.17 * edge)
        jobs[name] = Job(quantity, camera, (0.0, 0.0) if waves else axis)
    return jobs


def unfit(design: Design, quantity: str, axis: tuple[float, float] | None = None) -> str:
    """Why methods and references do not hold for a design; empty where they do.

    Methods and references alike take every microlens image as a product of two lines, and neighbours as a square grid:
    of other arrays they would agree with each other and be wrong.

    Parameters
    ----------
    design : Design
    quantity : str
        One of `QUANTITIES`.
    axis : (x, y), optional
        Microlens on the array [mm]; None is the panels.
    """
    if not Camera.of(design).chain.in_air:
        return "it is computed of cameras in air only, and this design has glass, a liquid or stated distortion"
    array = design.microlens_array
    if quantity in (WAVES, CUT):
        if array.lens_shape != "square" or array.rotation:
            kind = f"{array.lens_shape} microlenses" if array.lens_shape != "square" else "turned microlenses"
            return f"it is computed of upright square microlenses only, and this design has {kind}"
        if quantity == WAVES and array.layout != "square":
            return f"it is computed of square arrays only, and this design's is {array.layout}"
    if axis is not None and quantity == WAVES and len(Job(quantity, design, axis).discs[1]) > 1:
        return f'rims cut the image at {axis[0]:g}, {axis[1]:g} mm, and there no neighbour is like it; ask for "{CUT}"'
    if axis is not None and quantity == LENS and not _traceable(design):
        return "only panels, without --field, trace the lenses that ship; a field needs a real lens of the design's own"
    return ""


def square_twin(design: Design) -> Design:
    """The design with upright square microlenses in a square array, which all quantities fit."""
    return design.replace({f"microlens_array.{key}": "square" for key in ("layout", "lens_shape")}
                          | {"microlens_array.rotation": 0.0})  # fmt: skip


def _pencil(design: Design) -> tuple[float, float]:
    """Where the pencil of the microlens at the sensor's edge lies on the main lens, and its radius there [mm]."""
    gap = design.d_f - design.d_3
    off = design.sensor_size[0] / 2 * design.d_f / design.d_1 * design.d_3 / gap
    return off, design.D_F / 2 * design.d_f / gap


def _panels(design: Design) -> dict[str, Design]:
    """Cameras that between them show every difficulty, made from one design."""
    off, radius = _pencil(design)
    slim = max(design.D_F * 1.0001, 2 * math.hypot(off, 0.4 * radius) if off > radius else 1.2 * radius)
    fresnel = float(fresnel_number(Camera.of(design)))
    made = {"round": design}
    if off > 0:
        made["cat's eye"] = design.replace({"main_lens.diameter": slim})
        tangent = 2 * (off - radius * (1 - 1e-5))
        if tangent > design.D_F:
            made["near tangent"] = design.replace({"main_lens.diameter": tangent})
    for number in (0.9, 4.0, 24.0):
        made[f"N_F {number:g}"] = design.replace({"light.wavelength": design.wavelength * fresnel / number})
    wide = design.d_3 / 3 if design.d_3 else 0.0
    made["mismatched"] = design.replace({"aperture.distance": wide, "aperture.diameter": design.D_F * 1.15})
    return made


def _cut_jobs(design: Design) -> dict[str, Job]:
    """Cat's eyes from coarse to fine waves; one almost closed; one that the rim almost misses."""
    made, edge = _panels(design), design.sensor_size[0] / 2
    off, radius = _pencil(design)
    if "cat's eye" not in made:
        return {"round": Job(CUT, design, (0.31 * edge, 0.17 * edge))}
    jobs = {}
    for number in (0.9, 4.0, 24.0):
        eye = made["cat's eye"].replace({"light.wavelength": made[f"N_F {number:g}"].wavelength})
        jobs[f"cat's eye, N_F {number:g}"] = Job(CUT, eye, (edge, 0.0))
    for name, reach in (("almost closed", off - 0.96 * radius), ("barely cut", off + (1 - 1e-6) * radius)):
        if 2 * reach > design.D_F:
            jobs[name] = Job(CUT, design.replace({"main_lens.diameter": 2 * reach}), (edge, 0.0))
    return jobs


# --- cameras with real lenses, and the rays of one microlens through them ---------------------------------------------


def with_lens(design: Design, name: str) -> Design | None:
    """A design behind a shipped lens: lengths that go with the main lens's focal length scaled by it.

    None where the lens does not suit the design (parts collide).
    """
    grow = first_order(load_lens(name), design.wavelength).focal_length / design.f
    array, sensor = design.microlens_array, design.sensor
    values = {
        "name": f"{design.name} behind {name}",
        "main_lens": {"prescription": name, "focal_plane": design.d_f * grow},
        "aperture": {"diameter": design.D_F * grow, "distance": design.d_3 * grow},
        "microlens_array": {
            "pitch": array.pitch, "focal_length": design.f_ml, "size": tuple(side * grow for side in array.size),
        },
        "sensor": {
            "distance": design.d_2, "pixel": sensor.pixel, "relay_magnification": sensor.relay_magnification,
            "size": tuple(side * grow for side in sensor.size),
        },
        "light": {"wavelength": design.wavelength},
    }  # fmt: skip
    try:
        made = Design.model_validate(values)
        camera_of(made)
    except (InputError, ValueError):
        return None
    return made


def lens_designs(design: Design) -> dict[str, Design]:
    """The design's own real lens, if the reference is for such, then every shipped lens in its place."""
    made = {}
    if design.lens and _traceable(design):
        made[design.lens.name or "own lens"] = design
    for name in (name.upper() for name in shipped_names()):
        camera = with_lens(design.thin_twin, name)
        if camera is not None and name not in (key.upper() for key in made):
            made[name] = camera
    return made


def _traceable(design: Design) -> bool:
    """Whether the reference is for the design's own real lens."""
    lens = design.lens
    spherical = lens is not None and lens.is_centred and not any(surface.asphere for surface in lens.surfaces)
    return spherical and design.aligned


@lru_cache(maxsize=64)
def microlens_rays(design: Design, axis: tuple[float, float]) -> tuple[Floats, Floats]:
    """Places on the array and image-side slopes (2, RAYS) of a microlens's rays that fill nine tenths of the FAP.

    By the thin-lens model's formulas: through the real lens they land a little elsewhere on the FAP; the same rays for
    every method.
    """
    k = np.arange(RAYS) + 0.5
    radius, turn = 0.45 * design.D_F * np.sqrt(k / RAYS), k * math.pi * (3 - math.sqrt(5))
    pupil = np.stack([radius * np.cos(turn), radius * np.sin(turn)])
    gap = 1 - design.d_3 / design.f
    place = np.array(axis)[:, None]
    slopes = (place * gap - pupil) / (design.d_1 * gap + design.d_3)
    return np.broadcast_to(place, slopes.shape).copy(), slopes


# --- random jobs ------------------------------------------------------------------------------------------------------


def random_job(design: Design, quantity: str, rng: np.random.Generator) -> Job:
    """A camera of other f-numbers, vignetting, field, pixels and wavelength than the design, and one quantity of it."""
    if quantity == LENS:
        camera = _random_lens_design(design, rng)
        x, y = (float(rng.uniform(-0.22, 0.22)) * side for side in camera.microlens_array.size)
        return Job(LENS, camera, (x, y))
    design = design.thin_twin
    while True:
        d_3 = float(rng.uniform(0, 0.75)) * design.d_f
        x, y = (float(rng.uniform(-0.5, 0.5)) * side for side in design.sensor_size)
        gap = design.d_f - d_3
        D_F = design.D_F * float(rng.uniform(0.6, 1.5)) * (gap / (design.d_f - design.d_3))
        pencil, off = D_F * design.d_f / gap, float(np.hypot(x, y)) * design.d_f / design.d_1 * d_3 / gap
        # Half of the lenses clip: from whole to almost nothing.
        room = rng.uniform(-0.45, 0.6) if rng.random() < 0.5 else 1.0
        lens = max(2 * off + room * pencil * 2, 1.001 * D_F, 0.1)
        pixels = float(rng.uniform(6, 22))
        fresnel = 10 ** float(rng.uniform(np.log10(0.6), np.log10(24)))
        image = float(microlens_image_diameter(Camera.of(design, {"D_F": D_F, "d_3": d_3})))
        wave = design.wavelength * float(fresnel_number(Camera.of(design))) / fresnel
        changes = {
            "aperture.distance": d_3,
            "aperture.diameter": D_F,
            "main_lens.diameter": lens,
            "sensor.pixel": image / pixels * design.sensor.relay_magnification,
            "light.wavelength": wave,
        }
        try:
            camera = design.replace(changes)
        except DesignError:
            continue
        axis = (0.0, 0.0) if quantity == WAVES else (x, y)
        depth = gap * float(rng.uniform(0.4, 1.6)) if quantity == "depth" else 0.0
        return Job(quantity, camera, axis, depth, float(rng.uniform(0.3, 2.5)), float(rng.uniform(0, np.pi)))


def _random_lens_design(design: Design, rng: np.random.Generator) -> Design:
    """A shipped lens behind another aperture, elsewhere."""
    names, thin = shipped_names(), design.thin_twin
    while True:
        scale, share = float(rng.uniform(0.5, 1.3)), float(rng.uniform(0.5, 1.4))
        try:
            other = thin.replace({"aperture.diameter": thin.D_F * scale, "aperture.distance": thin.d_3 * share})
        except DesignError:
            continue
        made = with_lens(other, names[int(rng.integers(len(names)))].upper())
        if made is not None:
            return made


def random_jobs(design: Design, count: int, seed: int) -> Iterator[tuple[Job, float]]:
    """Jobs of all quantities that fit the design in turn, each with an accuracy between 1e-1 and 1e-9."""
    rng = np.random.default_rng(seed)
    names = [name for name in QUANTITIES if not unfit(design, name)]
    for n in range(count):
        yield random_job(design, names[n % len(names)], rng), 10 ** -float(rng.uniform(1, 9))
