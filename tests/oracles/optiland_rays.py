"""Makes the stored rays of lens_rays/: an independent tracer (Optiland 0.6.3), its own glass data, no code of ours.

Run with a Python that has Optiland, from the project's root: python tests/oracles/optiland_rays.py. It reads the
numbers from the lens files by itself and stores, lens by lens, where each ray of `incoming` meets the plane
100 mm behind the last vertex (nan where it found none) and, for the first 1000 rays, in which direction.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import numpy as np
import optiland
from lenses import RAY_COUNT, WAVELENGTH, incoming
from optiland.materials import IdealMaterial
from optiland.materials.material_file import MaterialFile
from optiland.optic import Optic
from optiland.rays import RealRays

HERE = Path(__file__).parent
BEHIND = 100.0


def number(text: str) -> float:
    value, unit = re.fullmatch(r"\s*(\S+)\s*(\S*)\s*", text).groups()
    return float(value) * {"mrad": 1e-3}.get(unit, 1.0)


def glass(name: str) -> MaterialFile:
    # By file: looked up by name, SF5 and SF10 would be taken for N-SF5 and N-SF10.
    return MaterialFile(str(Path(optiland.__file__).parent / f"database/data-nk/glass/schott/{name}.yml"))


def optiland_tilt(alpha: float, beta: float) -> tuple[float, float]:
    # The file's axis is (sin b, -sin a cos b, cos a cos b); Optiland's (sin ry cos rx, -sin rx, cos ry cos rx).
    rx = np.arcsin(np.sin(alpha) * np.cos(beta))
    return rx, np.arctan2(np.sin(beta), np.cos(alpha) * np.cos(beta))


def optic(path: Path) -> tuple[Optic, float, float]:
    surfaces = tomllib.loads(path.read_text())["surfaces"]
    lens = Optic()
    lens.surfaces.add(index=0, thickness=np.inf)
    z = 0.0
    for index, row in enumerate(surfaces, start=1):
        terms = row.get("asphere", {})
        shift = [number(t) for t in row.get("shift", ["0", "0", "0"])]
        rx, ry = optiland_tilt(*(number(t) for t in row.get("tilt", ["0", "0"])))
        lens.surfaces.add(
            index=index,
            surface_type="even_asphere" if terms else "standard",
            radius=np.inf if row["radius"] == "inf" else number(row["radius"]),
            conic=row.get("conic", 0.0),
            material=glass(row["glass"]) if "glass" in row else IdealMaterial(1.0),
            is_stop=index == 1,
            x=shift[0],
            y=shift[1],
            z=z + shift[2],
            rx=rx,
            ry=ry,
            **(
                {"coefficients": [number(terms.get(f"r{2 * i}", "0")) for i in range(1, 9)], "tol": 1e-14}
                if terms
                else {}
            ),
        )
        z += number(row.get("thickness", "0"))
    lens.surfaces.add(index=len(surfaces) + 1, z=z + BEHIND)
    return lens, number(surfaces[0]["diameter"]) / 2, z


def main() -> None:
    shipped = sorted((HERE.parents[1] / "roslf_design/lenses/shipped").glob("*.toml"))
    for path in [*shipped, *sorted((HERE / "lens_rays").glob("*.toml"))]:
        lens, radius, _ = optic(path)
        position, direction = incoming(radius, RAY_COUNT)
        rays = RealRays(*position, *direction, np.ones(RAY_COUNT), np.full(RAY_COUNT, WAVELENGTH * 1e3))
        lens.surfaces.trace(rays, skip=1, record=False)
        place = np.stack([rays.x, rays.y])
        way = np.stack([rays.L, rays.M, rays.N])[:, :1000]
        np.savez(HERE / "lens_rays" / f"{path.stem}.npz", place=place, way=way)
        print(path.stem, np.isfinite(place[0]).sum(), "rays", np.abs(place).max())


if __name__ == "__main__":
    main()
