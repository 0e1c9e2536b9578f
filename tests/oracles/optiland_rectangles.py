"""Makes rectangle_rays.npz: rays through rectangular stops, a plate and a lens, by Optiland (0.6.3) in what we export.

Run with a Python that has Optiland and this package, from the project's root: python -m
tests.oracles.optiland_rectangles. Rays start on the focal plane; stored is how they meet the main lens, and whether
they got there past every opening.
"""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

import numpy as np

from roslf_design.cli import main as roslf
from roslf_design.design import load
from roslf_design.design.files import save

COUNT = 1000
PLATE = {"kind": "plate", "distance": 60.0, "thickness": 12.0, "material": {"index": 1.6}}
LENS = {"kind": "lens", "distance": 40.0, "focal_length": 300.0}


def box(sides, turn, distance):
    return {"shape": "rectangle", "sides": sides, "turn": turn, "distance": distance}


DESIGN = load("paper").replace({
    "aperture": box((2.9, 1.9), 0.35, 120.0), "elements": [PLATE, LENS],
    "stops": [box((5.0, 4.0), 0.0, 100.0), {"diameter": 30.0, "distance": 30.0}],
})  # fmt: skip


def exported(folder: Path, name: str) -> str:
    """Text of an export of the design."""
    save(DESIGN, folder / "boxes.toml")
    assert roslf(["export", str(folder / "boxes.toml"), "-o", str(folder / name)]) == 0
    return (folder / name).read_text()


def main() -> None:
    from optiland.fileio import load_optiland_file
    from optiland.rays import RealRays

    with tempfile.TemporaryDirectory() as folder:
        text = exported(Path(folder), "boxes.json")
        optic = load_optiland_file(str(Path(folder) / "boxes.json"))
    names = [surface["comment"] for surface in json.loads(text)["surface_group"]["surfaces"]]
    surfaces = optic.surfaces.surfaces[1 : names.index("main lens")]
    rng = np.random.default_rng(4)
    start, aim = rng.uniform(-9, 9, (2, COUNT)), rng.uniform(-2.2, 2.2, (2, COUNT))
    begin = float(np.ravel(optic.surfaces.surfaces[0].geometry.cs.z)[0])
    slope = (aim - start) / (0.0 - begin)
    along = 1 / np.sqrt(1 + np.square(slope).sum(axis=0))
    rays = RealRays(*start, np.full(COUNT, begin), *(slope * along), along, np.ones(COUNT), np.full(COUNT, 0.55))
    for surface in surfaces:
        surface.trace(rays)
    z = json.loads(text)["surface_group"]["surfaces"][names.index("main lens")]["geometry"]["cs"]["z"]
    slope = np.array([rays.L / rays.N, rays.M / rays.N])
    height = np.array([rays.x, rays.y]) + slope * (z - np.asarray(rays.z))
    target = Path(__file__).with_name("rectangle_rays.npz")
    np.savez_compressed(target, height=height, slope=slope, passed=np.asarray(rays.i) > 0)


if __name__ == "__main__":
    main()
