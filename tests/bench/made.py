"""A small camera and captures rendered of it, as counts of 12 bits, that tests of the bench share."""

import functools
import tempfile
from pathlib import Path

import numpy as np
import tifffile
from PIL import Image

from roslf_design.design import load
from roslf_design.imaging.render import render
from roslf_design.imaging.trace import RaySampling
from roslf_design.scenes import make_scene

CELL = 1.7
BOARD = f"7x6 {CELL} mm"
POSES = [(-14, 28, 5), (25, -28, 8), (2, 3, -33), (-8, 20, 26)]
"""Distance from the focal plane [mm], tilts [deg]."""
RAYS = ["-microlens_diffraction", "-fap_diffraction", "-microlens_defocus"]
SAMPLING = RaySampling(least=12, most=40, tolerance=0.035)
"""Scatter of a few per cent along edges, as noise of an exposure makes it everywhere."""
BLACK, GAIN = 40, 2800


def small():
    """The paper's camera at a third of its size with pixels twice as large: 640 x 540 of them hold whole boards."""
    paper = load("paper")
    pixel = 2 * paper.sensor.pixel
    size = (640 * pixel, 540 * pixel)
    changes = {
        "name": "small camera",
        "sensor.pixel": pixel,
        "sensor.size": size,
        "microlens_array.size": (size[0] + 0.5, size[1] + 0.5),
    }
    return paper.replace(changes, f=paper.f / 3, d_1=paper.d_1 / 3, d_3=paper.d_3 / 3, D=paper.D / 3, D_F=paper.D_F / 3)


def board_scene(folder, camera, pose, *, cells=(7, 6), cell=CELL):
    """A board `pose[0]` from the focal plane [mm], tilted [deg]."""
    away, about_x, about_y = pose
    across, down = cells
    dark = np.add.outer(np.arange(down), np.arange(across)) % 2 == 0
    picture = np.pad(np.where(dark, 20, 230), 1, constant_values=230)
    file = folder / f"board-{across}-{down}.png"
    Image.fromarray(np.kron(picture, np.ones((24, 24))).astype(np.uint8)).save(file)
    width = (across + 2) * cell
    plane = {
        "kind": "plane",
        "distance": camera.d_f + away,
        "tilt": (np.radians(about_x), np.radians(about_y)),
        "size": (width, (down + 2) * cell),
        "texture": {"kind": "image", "file": str(file), "width": width},
    }
    return make_scene({"name": "board", "objects": [plane]})


def rendered(camera, scene=None):
    """Light of each pixel, 1 where fully lit by white."""
    return np.asarray(render(camera, scene, overrides=RAYS, sampling=SAMPLING).pixels, float)


@functools.cache
def picture(pose=None):
    """What `small` renders of a board, or of white; for all modules that look at it."""
    with tempfile.TemporaryDirectory() as folder:
        scene = None if pose is None else board_scene(Path(folder), small(), pose)
        return render(small(), scene, overrides=RAYS, sampling=SAMPLING)


def save(path, light, rng, gain=GAIN):
    """Counts of 12 bits with shot and read noise of about 0.4 counts an electron."""
    counts = gain * light
    noisy = counts + rng.normal(size=light.shape) * np.sqrt(0.4 * counts + 1.0)
    path.parent.mkdir(parents=True, exist_ok=True)
    tifffile.imwrite(path, np.clip(np.round(BLACK + noisy), 0, 4095).astype(np.uint16))
