"""Is the predicted standard error of disparity right? Fisher information of rendered pictures, for twenty cameras.

Run from the project's root: python studies/depth/prediction_proof.py [-o FOLDER]. Interrupted, it goes on where it was;
depth_proof.py puts its table on the page.
"""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import j1

from roslf_design.camera import Camera
from roslf_design.design import Design, Stop, load
from roslf_design.imaging.camera import ImageLattice
from roslf_design.imaging.render import render
from roslf_design.imaging.trace import RaySampling
from roslf_design.scenes import Plane, Scene, Sinusoid, White
from roslf_design.theory.depth_error import seen_at
from roslf_design.theory.disparity_error import _disparity_information
from roslf_design.theory.disparity_information import Spectrum
from roslf_design.theory.light_field import rim_disparity
from roslf_design.theory.photometry import NOTHING, Beside, dark_variance, electrons
from roslf_design.theory.stop_images import MicrolensImages

OUT = Path("reports/depth-proof")
CONTRAST = 0.5
RAYS = 64


class Case(NamedTuple):
    """A camera, a microlens of it and the grating that is looked at."""

    design: Design
    field: tuple[float, float] = (0.0, 0.0)
    """Place on the array [mm]."""
    periods: float = 0.25
    """In a microlens pitch."""
    disparity: float = 0.0
    """[pitches]"""


def cases() -> dict[str, Case]:
    """The cameras."""
    paper, gaps = load("paper"), load("paper-mismatched")
    cut = paper.replace({"main_lens.diameter": 20.0})
    near = Stop(distance=115.0, diameter=2.9, decentre=(1.5, 0.0))
    return {
        "matched": Case(paper),
        "matched, a pitch out of focus": Case(paper, disparity=1.0),
        "matched, beyond the focal plane": Case(paper, disparity=-1.0),
        "matched, finer grating": Case(paper, periods=1 / 3),
        "matched, coarse grating": Case(paper, periods=0.125),
        "gaps": Case(gaps, (9.0, 0.0), disparity=0.5),
        "gaps, on the axis": Case(gaps),
        "overlap": Case(paper.replace(D_F=3.3)),
        "barely cut": Case(cut, (6.3, 0.0)),
        "half cut": Case(cut, (7.3, 0.0), disparity=0.5),
        "cut aslant": Case(cut, (4.8, 4.8)),
        "cut to a third": Case(cut, (8.0, 0.0)),
        "cut to a third by a stop near the FAP": Case(paper.replace({"stops": (near,)})),
        "round microlenses": Case(paper.replace({"microlens_array.lens_shape": "circular"})),
        "finer pixels": Case(paper.replace({"sensor.pixel": paper.q / 1.5})),
        "coarser pixels": Case(paper.replace({"sensor.pixel": paper.q * 1.5})),
        "infrared": Case(paper.replace({"light.wavelength": 0.85e-3})),
        "blue": Case(paper.replace({"light.wavelength": 0.45e-3}), disparity=0.5),
        "long bore": Case(paper.replace(d_3=200.0, D_F=1.89)),
        "narrow FAP": Case(paper.replace(D_F=1.8)),
        "little light": Case(paper.replace({"light.exposure": 2e-5})),
    }


def rendered_information(
    design: Design,
    field: tuple[float, float],
    periods: float,
    direction: float,
    disparity: float,
    rays: int = 64,
    step: float = 0.02,
    contrast: float = 0.5,
    beside: Beside = NOTHING,
) -> float:
    """Fisher information of B per microlens, a grating's amplitude and phase unknown, by differences.

    The grating has so many periods per microlens pitch; on planes at other distances it grows with the distance from
    the FAP, so that views from its middle stay as they are.
    """
    camera = Camera.of(design)
    lattice, q, gap = ImageLattice.of(camera), float(camera.q), float(camera.seen.gap)
    period = float(camera.seen.inverse_m * camera.d) / periods
    lenses = round(1 / periods) if periods < 0.5 else 4
    centre = lattice.image(np.round(np.linalg.solve(lattice.axes, np.array(field))))
    half = lenses / 2 * abs(lattice.grow) * float(camera.d)
    size = round(2 * half / q)
    region = *(round((c - half) / q + n / 2) for c, n in zip(centre, camera.pixels, strict=True)), size, size
    names = ["microlens_diffraction", "vignetting", "finite_microlens_aperture", "object_defocus"]
    off = ["noise", "cos4", "fap_diffraction", "microlens_defocus"]
    switches = [f"+{name}" for name in names] + [f"-{name}" for name in off]
    sampling = RaySampling(least=rays, most=rays, tolerance=1e-9)

    def at(b: float) -> float:
        d_3 = float(camera.seen.d_3)
        return float(
            brentq(lambda z: float(rim_disparity(camera, z - d_3)) - b, d_3 * 1.0001, 50 * float(camera.seen.d_f))
        )

    def picture(z: float, phase: float = 0.0) -> NDArray[np.float64]:
        wide = period * (z - float(camera.seen.d_3)) / gap
        look = Sinusoid(period=wide, angle=direction, contrast=contrast)
        aside = (phase * wide * np.cos(direction), phase * wide * np.sin(direction))
        scene = Scene(objects=(Plane(distance=z, centre=aside, texture=look),))
        shown = render(design, scene, overrides=switches, region=region, sampling=sampling, threads=2)
        return np.asarray(2 * float(electrons(camera)) * shown.pixels.astype(float).ravel())

    white = Scene(objects=(White(level=0.5),))
    even = render(design, white, overrides=switches, region=region, sampling=sampling, threads=2).pixels
    mean = 2 * float(electrons(camera)) * even.astype(float).ravel()
    bright = mean + beside.veil
    weight = 1 / (bright + float(dark_variance(camera)) + beside.dark**2 + (beside.share * bright) ** 2)
    moved = (picture(at(disparity + step)) - picture(at(disparity - step))) / (2 * step)
    nuisance = np.stack([picture(at(disparity), phase) - mean for phase in (0.0, 0.25)], 1)
    mixed = nuisance.T @ (weight * moved)
    left = moved @ (weight * moved) - mixed @ np.linalg.solve(nuisance.T @ (weight[:, None] * nuisance), mixed)
    return float(left / (size * size * q * q / abs(np.linalg.det(lattice.image_axes))))


def compared(case: Case, rays: int = RAYS) -> dict[str, float]:
    """Predicted standard error over that of rendered pictures, for gratings along x and along y."""
    camera = Camera.of(case.design)
    power = CONTRAST**2 / 2 * float(np.sinc(case.periods)) ** 2
    if camera.lens_shape == "circular":
        k = math.pi * case.periods
        power = CONTRAST**2 / 2 * (2 * float(j1(k)) / k) ** 2
    plane = seen_at(camera, None)._replace(disparity=np.asarray(case.disparity))
    # The pictures are of the microlenses about the field, those at their sides by halves; where images are cut, these
    # change from one to the next.
    lattice = ImageLattice.of(camera)
    middle = lattice.axes @ np.round(np.linalg.solve(lattice.axes, np.array(case.field)))
    half = (round(1 / case.periods) if case.periods < 0.5 else 4) / 2
    steps = np.arange(-math.floor(half), math.floor(half) + 1)
    share = np.clip(half + 0.5 - np.abs(steps), 0.0, 1.0)
    along, down = np.meshgrid(steps, steps)
    images = MicrolensImages(camera, middle + np.stack([along.ravel(), down.ravel()], -1) * float(camera.d))
    weight = np.multiply.outer(share, share).ravel()
    kept = float(np.average(images.shapes.kept_fraction[:, 0], weights=weight))
    ratios = {}
    for name, angle in (("x", 0.0), ("y", math.pi / 2)):
        rendered = rendered_information(case.design, case.field, case.periods, angle, case.disparity, rays)
        waves = np.array([case.periods if name == axis else 0.0 for axis in "xy"])
        wave = Spectrum(waves[:1], waves[1:], np.array([power]))
        predicted = np.average(_disparity_information(images, plane, wave)[:, 0], weights=weight)
        ratios[name] = math.sqrt(rendered / float(predicted))
    return {**ratios, "kept": kept}


def main() -> None:
    """Compare what is missing and write the numbers."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=OUT, help="folder for the results")
    out = parser.parse_args().output
    out.mkdir(parents=True, exist_ok=True)
    store = out / "prediction.json"
    results = json.loads(store.read_text()) if store.exists() else {}
    for name, case in cases().items():
        if name not in results:
            results[name] = compared(case)
            store.write_text(json.dumps(results, allow_nan=False, indent=1) + "\n")
            print(name, results[name], flush=True)


if __name__ == "__main__":
    main()
