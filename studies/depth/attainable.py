"""What can any estimator attain? Bounds of Cramér and Rao by every pixel about a window, the texture unknown.

Run from the project's root: python studies/depth/attainable.py NAME ... [-o FOLDER]; depth_proof.py puts the table on
the page. Nothing of the theory of disparity errors is used: the light of single microlens images is made on a fine
grid, neighbours' and all, and read by square pixels wherever they happen to lie; unknown are every wave of the texture
that the array resolves, and the disparity of every microlens about the window.
"""

from __future__ import annotations

import argparse
import json
import math
import zlib
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage, sparse
from scipy.spatial import cKDTree

from roslf_design.camera import Camera
from roslf_design.depth.mixing import LEAST
from roslf_design.depth.pictures import DETAIL
from roslf_design.design import Design
from roslf_design.shapes.lattice import PACKINGS
from roslf_design.theory.colours import filters, panchromatic
from roslf_design.theory.disparity_error import disparity_sigma, share_full
from roslf_design.theory.disparity_information import Seen
from roslf_design.theory.exit_pupil import microlens_image_pitch
from roslf_design.theory.lens_shapes import LENS_SHAPES
from roslf_design.theory.light import microlens_defocus
from roslf_design.theory.photometry import dark_variance, electrons, through_filter
from roslf_design.theory.stop_images import MicrolensImages
from studies.depth.depth_proof import LIGHTS, lit
from studies.depth.proof_cameras import SEED, cameras, place

OUT = Path("reports/depth-proof")
WINDOW, AROUND = 5, 2
"""Microlenses along a side of the window, and beyond it to each side."""
FINE, REACH, FAINT = 6, 1.45, 2e-4
"""Steps of the fine grid in a pixel; pitches from its middle to which a microlens lights; light that is let be."""
DRAWS = 12
"""Textures."""
FULL = 0.5
"""Share of the pixels that are full from which on less light is taken."""
PIXELS = 16
"""Pixels a pitch from which on some are taken together: their number takes memory, and tells nothing more."""
TINY = 1e-9
"""Share of a matrix's mean diagonal that keeps it from being singular."""

Array = NDArray[np.float64]


class Attainable(NamedTuple):
    """Standard errors over the prediction, rms over textures of a window."""

    all_pixels: float
    """Of every pixel."""
    own_pixels: float
    """Of pixels that have `LEAST` of their light from the nearest microlens; inf where there are none."""


def _image(camera: Camera, at: tuple[float, float]) -> tuple[list[Array], float, int]:
    """Splines of a microlens image's light and first moments on the FAP, the grid's step [pitches] and its middle."""
    pitch = abs(float(microlens_image_pitch(camera)))
    openings, step = MicrolensImages(camera, [at]).openings, float(camera.q) / pitch / FINE
    centres, radii = openings.centres[0, 0] / pitch, openings.radii[0, 0] / pitch
    count = fft.next_fast_len(2 * int(3.5 / step))
    axis = (np.arange(count) - count // 2) * step
    x, y = np.meshgrid(axis, axis)
    opening = np.ones_like(x)
    for (a, b), radius in zip(centres - centres[0], radii, strict=True):
        opening *= np.clip((radius - np.hypot(x - a, y - b)) / step + 0.5, 0, 1)
    k = np.fft.fftfreq(count, step)
    fx, fy = np.meshgrid(k, k)
    distance, defocus = float(camera.seen.d_2), float(-microlens_defocus(camera) / camera.seen.d_2)
    lens = LENS_SHAPES[camera.lens_shape]
    parts = lens.factors(float(camera.d), distance, defocus, float(camera.wavelength), fx / pitch, fy / pitch)
    passed = math.prod(parts, start=np.sinc(fx * step * FINE) * np.sinc(fy * step * FINE))
    kinds = (opening, opening * x / (2 * radii[0]), opening * y / (2 * radii[0]))
    return [ndimage.spline_filter(np.fft.ifft2(np.fft.fft2(p) * passed).real, 3) for p in kinds], step, count // 2


def attainable(
    design: Design, at: tuple[float, float], disparity: float = 0.0, draws: int = DRAWS, seed: int = SEED
) -> Attainable:
    """Bounds for a wall at a disparity [pitches], of the proof's texture, at a place on the array [mm].

    Openings must be discs.
    """
    camera, rng = Camera.of(design.thin_twin), np.random.default_rng(seed)
    many = int(abs(float(microlens_image_pitch(camera) / camera.q)) / PIXELS)
    powers = {"sensor.pixel": 1, "sensor.read_noise": 1, "sensor.full_well": 2}
    coarse = {key: many**power * float(camera[key]) for key, power in powers.items()} if many > 1 else {}
    camera = camera.replace(coarse)
    packing, half = PACKINGS[camera.layout], WINDOW / 2 + AROUND
    splines, step, middle = _image(panchromatic(camera), at)
    q = step * FINE
    lenses = np.stack(np.meshgrid(np.arange(-12, 13), np.arange(-12, 13)), -1).reshape(-1, 2) @ packing.steps.T
    lenses = lenses[(np.abs(lenses) < half + REACH).all(1)]
    window = (np.abs(lenses) < WINDOW / 2 * np.array([1.0, packing.rise])).all(1)
    axis = np.arange(-int(half / q), int(half / q) + 1)
    row, column = (index.ravel() for index in np.meshgrid(axis, axis, indexing="ij"))
    pixels = np.stack([column, row], -1) * q + rng.uniform(-q / 2, q / 2, 2)
    charges = [float(electrons(through_filter(camera, one))) for one in filters(camera.colours)]
    full = np.array([charges[k] for k in (0, 1, 1, 2)] if charges else 4 * [float(electrons(camera))])
    full = full[row % 2 * 2 + column % 2]

    lens, pixel = np.nonzero((np.abs(lenses[:, None] - pixels) < REACH).all(-1))
    places = ((pixels[pixel] - lenses[lens]) / step + middle).T[::-1]
    light, *moments = (ndimage.map_coordinates(one, places, order=3, prefilter=False) for one in splines)
    some = np.abs(light) > FAINT
    lens, pixel, light = lens[some], pixel[some], light[some]
    pupil = np.stack([one[some] / light for one in moments], -1)

    def into_pixels(values: Array, size: int, part: NDArray[np.intp]) -> Array:
        return np.asarray(sparse.csr_matrix((values, (pixel, part)), shape=(len(pixels), size)).todense())

    total = np.bincount(pixel, light, len(pixels))
    mine = lens == np.asarray(cKDTree(lenses).query(pixels)[1])[pixel]
    share = np.bincount(pixel[mine], light[mine], len(pixels)) / np.maximum(total, FAINT)
    # Waves of a square that repeats itself beyond all microlenses; one of each with its mirror image.
    side = 2 * half + 3
    k = np.stack(np.meshgrid(*2 * [np.arange(-int(side), int(side) + 1) / side]), -1).reshape(-1, 2)
    fine = np.hypot(*k.T)
    k = k[((k[:, 1] > 0) | ((k[:, 1] == 0) & (k[:, 0] > 0))) & (fine < packing.fold)]
    fine = np.hypot(*k.T)
    each = design.depth.contrast / (side * fine) * math.sqrt(1 / (math.pi * math.log(2)))
    each = np.where(fine * DETAIL <= 1, each, 0.0) * LENS_SHAPES[camera.lens_shape].blur(*k.T)
    phase = 2 * math.pi * (lenses[lens] - disparity * pupil) @ k.T
    cosine, sine = np.cos(phase), np.sin(phase)
    waves = np.concatenate([cosine, sine, np.ones((len(phase), 1))], 1)
    gather = sparse.csr_matrix((light * full[pixel], (pixel, np.arange(pixel.size))), shape=(len(pixels), pixel.size))
    texture = gather @ waves
    number = np.where(window, 0, np.cumsum(~window))[lens]
    found: list[list[float]] = [[], []]
    kept = [total > 0.02, (total > 0.02) & (share > LEAST)]
    variance = full * total + float(dark_variance(camera))
    weights = [np.where(one, 1 / np.maximum(variance, TINY), 0.0)[:, None] for one in kept]
    inverses = []
    for weight in (one for one in weights if one.any()):
        normal = texture.T @ (weight * texture)
        inverses.append(np.linalg.inv(normal + TINY * np.trace(normal) / len(normal) * np.eye(len(normal))))
    for _ in range(draws):
        a, b = rng.standard_normal((2, len(k))) * each
        slope = 2 * math.pi * (cosine @ (b[:, None] * k) - sine @ (a[:, None] * k))
        moved = into_pixels(-(pupil * slope).sum(1) * light * full[pixel], int((~window).sum()) + 1, number)
        for one, weight, inverse in zip(found, weights, inverses, strict=False):
            mixed = texture.T @ (weight * moved)
            told = moved.T @ (weight * moved) - mixed.T @ inverse @ mixed
            rest = told[1:, 1:] + TINY * np.trace(told) * np.eye(len(told) - 1)
            one.append(float(told[0, 0] - told[0, 1:] @ np.linalg.solve(rest, told[1:, 0])))
    settings = {"depth.finest": DETAIL * float(camera.d), "depth.period": None, "depth.window": WINDOW}
    assumed = Camera.of(design.replace(settings).thin_twin).replace(coarse)
    predicted = float(disparity_sigma(MicrolensImages(assumed, [at]), Seen(np.asarray(disparity), np.ones(())))[0, 0])
    lacking = WINDOW**2 * packing.rise / window.sum()
    told = (math.sqrt(np.mean(1 / (lacking * np.array(one)))) / predicted if one else math.inf for one in found)
    return Attainable(*told)


def main() -> None:
    """Bounds of cameras by name, added to those written before."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="+", help="cameras of depth_proof.py")
    parser.add_argument("-o", "--output", type=Path, default=OUT, help="folder for the results")
    given = parser.parse_args()
    store = given.output / "attainable.json"
    results = json.loads(store.read_text()) if store.exists() else {}
    for name in given.names:
        camera = cameras()[name]
        at = place(camera, np.random.default_rng([SEED, zlib.crc32(f"{name}, slanted wall".encode())]))
        every = ((light, lit(camera.design, share)) for light, share in LIGHTS.items())
        light, design = next(one for one in every if share_full(Camera.of(one[1].thin_twin))[0] < FULL)
        bound = attainable(design, at)._asdict()
        name = name if light == "bright" else f"{name}, {light}"
        results[name] = {key: one if math.isfinite(one) else None for key, one in bound.items()}
        store.write_text(json.dumps(results, allow_nan=False, indent=1) + "\n")
        print(name, results[name], flush=True)


if __name__ == "__main__":
    main()
