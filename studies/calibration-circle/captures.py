"""Rendered captures of a checkerboard: the paper's camera at full size, without diffraction and with it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray
from PIL import Image

from roslf_design.camera import Camera
from roslf_design.design import Design
from roslf_design.effects import Budget, Plan, plan
from roslf_design.effects.waves import add_noise
from roslf_design.imaging.camera import Region
from roslf_design.imaging.render import render
from roslf_design.imaging.trace import RaySampling, Tracer
from roslf_design.imaging.transfer import bands, halo
from roslf_design.scenes import Scene, make_scene
from roslf_design.theory.transfer import MicrolensTransfer

RAYS = ("-microlens_diffraction", "-fap_diffraction", "-microlens_defocus", "+object_defocus")
WAVES = ("+microlens_diffraction", "-microlens_defocus", "+object_defocus")
KINDS = {"rays": RAYS, "waves": WAVES}
"""Folder of the captures: the effects switched for it. Parallax is in the effect object_defocus."""
CELLS, CELL = (4, 5), 6.0
EXPOSURE, READ_NOISE = 10_000.0, 3.0
"""Electrons in a fully lit pixel, and rms read noise."""
FULL_SCALE = 16_000
"""Counts of a fully lit pixel."""
_FINE = 2
"""Subpixels per pixel and axis in the trace that both kinds share."""
_PICTURE = 0.04
"""Pixel of the drawn board [mm]."""


@dataclass(frozen=True)
class Pose:
    """Of one board."""

    distance: float
    """Of its middle from the main lens [mm]."""
    tilt: tuple[float, float]
    """About x, then y [rad]."""
    turn: float
    """In its own plane [rad]."""
    centre: tuple[float, float]
    """[mm]"""


def poses(
    boards: int, seed: int = 0, distance: float = 350.0, reach: float = 40.0, tilt: float = 25.0, cell: float = CELL
) -> list[Pose]:
    """Poses as a person would choose them: distances spread evenly, tilts in every direction up to `tilt` degrees."""
    rng = np.random.default_rng(seed)
    spread = 2 * (np.arange(boards) + 0.5) / boards - 1
    stands = []
    for k, away in enumerate(rng.permutation(spread)):
        towards = 2 * math.pi * (k + rng.uniform()) / boards * 5
        size = math.radians(tilt) * math.sqrt(rng.uniform(0.2, 1))
        lean = (size * math.cos(towards), size * math.sin(towards))
        turn = math.radians(90 + rng.uniform(-12, 12))
        aside = (float(rng.uniform(-0.5, 0.5)) * cell, float(rng.uniform(-0.25, 0.25)) * cell)
        stands.append(Pose(distance + reach * float(away), lean, turn, aside))
    return stands


def drawn_board(turn: float, path: Path, cells: tuple[int, int] = CELLS, cell: float = CELL) -> float:
    """Draw the board turned in its plane, on white paper one cell wider all round; width of the picture [mm]."""
    half = 0.5 * math.hypot(cells[0] + 2, cells[1] + 2) * cell
    count = 2 * math.ceil(half / _PICTURE)
    shades = np.zeros((count, count))
    step = (np.arange(4) + 0.5) / 4
    for dy in step:
        for dx in step:
            x = (np.arange(count) + dx - count / 2)[None, :] * _PICTURE
            y = (np.arange(count) + dy - count / 2)[:, None] * _PICTURE
            a = (math.cos(turn) * x + math.sin(turn) * y) / cell + cells[0] / 2
            b = (math.cos(turn) * y - math.sin(turn) * x) / cell + cells[1] / 2
            on = (a > 0) & (a < cells[0]) & (b > 0) & (b < cells[1])
            paper = (a > -1) & (a < cells[0] + 1) & (b > -1) & (b < cells[1] + 1)
            dark = (np.floor(a) + np.floor(b)) % 2 == 0
            shades += np.where(on & dark, 0.08, np.where(paper, 0.9, 0.4)) / 16
    Image.fromarray(np.round(65535 * shades).astype(np.uint16)).save(path)
    return count * _PICTURE


def scene_of(pose: Pose, picture: Path, width: float) -> Scene:
    """The board in front of grey."""
    plane = {
        "kind": "plane",
        "distance": pose.distance,
        "tilt": pose.tilt,
        "centre": pose.centre,
        "size": (width, width),
        "texture": {"kind": "image", "file": str(picture), "width": width},
    }
    return make_scene({"name": picture.stem, "objects": [plane], "background": 0.4})


def capture(design: Design, scene: Scene, seed: int, rays: int = 64) -> Iterator[tuple[str, NDArray[Any]]]:
    """The scene by rays and by waves from one trace: what differs is the diffraction, not the sampling."""
    lines = {kind: plan(design, scene, None, overrides) for kind, overrides in KINDS.items()}
    width, height = design.pixels
    transfers = [MicrolensTransfer.of(Camera.of(design), line, scene.light.wavelengths) for line in lines.values()]
    edge = max(halo(transfer, design.q, Budget().of("intensity")) for transfer in transfers)
    wide = Region(-edge, -edge, width + 2 * edge, height + 2 * edge)
    tracer = Tracer.of(design, lines["rays"], scene)
    traced, _ = tracer.image(wide, RaySampling(least=rays, most=rays, seed=seed), _FINE)

    def geometry(region: Region, fine: int) -> NDArray[np.float32]:
        assert fine == _FINE
        row, column = (region.row + edge) * fine, (region.column + edge) * fine
        part = traced[row : row + region.rows * fine, column : column + region.columns * fine]
        beyond = region.rows * fine - part.shape[0]  # a last band asks for more rows than there are
        return np.pad(part, ((0, beyond), (0, 0)))

    for kind, effects in lines.items():
        yield kind, _binned(geometry, design) if kind == "rays" else _diffracted(geometry, design, effects, scene)


def _binned(geometry: Any, design: Design) -> NDArray[np.float32]:
    width, height = design.pixels
    fine = geometry(Region(0, 0, width, height), _FINE)
    return np.asarray(fine.reshape(height, _FINE, width, _FINE).mean((1, 3)), np.float32)


def _diffracted(geometry: Any, design: Design, effects: Plan, scene: Scene) -> NDArray[np.float32]:
    transfer = MicrolensTransfer.of(Camera.of(design), effects, scene.light.wavelengths)
    image = np.empty(design.pixels[::-1], np.float32)
    for row, band in bands(Region(0, 0, *design.pixels), geometry, transfer, design.q, 2):
        image[row : row + band.shape[0]] = band
    return image


def exposed(image: NDArray[Any], seed: int) -> NDArray[np.uint16]:
    """Counts of one exposure: shot and read noise."""
    noisy = add_noise(image.astype(np.float32), EXPOSURE, READ_NOISE, np.random.default_rng(seed))
    return np.asarray(np.clip(np.rint(noisy * FULL_SCALE), 0, 65535), np.uint16)


def make(
    design: Design, out: Path, boards: int, seed: int = 0, cell: float = CELL, tilt: float = 25.0
) -> Iterator[str]:
    """Write the captures of both kinds into folders of `out`; whatever is there already is kept."""
    for kind, overrides in KINDS.items():
        (out / kind).mkdir(parents=True, exist_ok=True)
        if not (out / kind / "white.tif").exists():
            white = render(design, overrides=[line for line in overrides if "object" not in line])
            tifffile.imwrite(out / kind / "white.tif", exposed(white.pixels, 1_000_000))
            yield f"{kind}/white.tif"
    for number, pose in enumerate(poses(boards, seed, tilt=tilt, cell=cell), 1):
        name = f"board{number:02d}.tif"
        if all((out / kind / name).exists() for kind in KINDS):
            continue
        picture = out / f"board{number:02d}.png"
        scene = scene_of(pose, picture, drawn_board(pose.turn, picture, cell=cell))
        for kind, image in capture(design, scene, seed=number):
            tifffile.imwrite(out / kind / name, exposed(image, number))
            yield f"{kind}/{name}"
