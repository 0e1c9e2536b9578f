"""Makes plate_rays.npz: rays through plane-parallel plates by an independent tracer (Optiland 0.6.3), no code of ours.

Run with a Python that has Optiland, from the project's root: python tests/oracles/optiland_plates.py. Rays start at the
main lens and go outwards along +w = -z; stored is where they meet the plane at w = `END`, and with which slopes.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from optiland.materials import IdealMaterial
from optiland.optic import Optic
from optiland.rays import RealRays

PLATES = ((30.0, 4.0, 1.5168), (60.0, 9.0, 1.7705), (69.0, 0.5, 1.4585))
"""Distance from the main lens, thickness [mm], index; the last two touch."""
TILTS = {"upright": (0.0, 0.0), "tilted": (0.31, -0.22)}
"""Of the first plate about x, then y [rad], z towards the sensor."""
MEDIUM, END = 1.333, 100.0
COUNT = 300


def optic(tilt: tuple[float, float]) -> Optic:
    trace = Optic()
    trace.surfaces.add(index=0, thickness=np.inf)
    index = 1
    for k, (distance, thickness, n) in enumerate(PLATES):
        tx, ty = tilt if k == 0 else (0.0, 0.0)
        outwards = np.array([-np.sin(ty) * np.cos(tx), np.sin(tx), np.cos(ty) * np.cos(tx)])
        touching = k + 1 < len(PLATES) and PLATES[k + 1][0] == distance + thickness
        behind = MEDIUM if k + 1 == len(PLATES) else 1.0
        vertices = [(np.array([0.0, 0.0, distance]), n), (distance * np.eye(3)[2] + thickness * outwards, behind)]
        for vertex, beyond in vertices[: 1 if touching else 2]:
            x, y, w = vertex
            trace.surfaces.add(
                index=index, radius=np.inf, material=IdealMaterial(beyond), is_stop=index == 1, x=x, y=y, z=w, rx=-tx,
                ry=-ty,
            )  # fmt: skip
            index += 1
    trace.surfaces.add(index=index, material=IdealMaterial(MEDIUM), z=END)  # else rays leave into air there
    return trace


def main() -> None:
    rng = np.random.default_rng(20)
    height, slope = rng.uniform(-8, 8, (2, COUNT)), rng.uniform(-0.9, 0.9, (2, COUNT))
    stored = {"height": height, "slope": slope}
    along = 1 / np.sqrt(1 + np.square(slope).sum(axis=0))
    for name, tilt in TILTS.items():
        way = [*(slope * along), along]
        rays = RealRays(*height, np.zeros(COUNT), *way, np.ones(COUNT), np.full(COUNT, 0.55))
        optic(tilt).surfaces.trace(rays, skip=1, record=False)
        stored[f"{name}_end"] = np.array([rays.x, rays.y])
        stored[f"{name}_slope"] = np.array([rays.L / rays.N, rays.M / rays.N])
    np.savez_compressed(Path(__file__).with_name("plate_rays.npz"), **stored)


if __name__ == "__main__":
    main()
