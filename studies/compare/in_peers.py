"""Rays through an exported file in another program; run as a script by that program's own Python: PROGRAM JOB.json.

A program is a class: made of a file it reads it; `traced` carries rays through it and gives the points where they meet
each surface. Clear apertures are opened, as rays along a rim are compared; `with_indices` puts in other refractive
indices.
"""

# mypy: allow-untyped-defs, allow-untyped-calls, disable-error-code="import-not-found, import-untyped, var-annotated"

import contextlib
import json
import math
import os
import sys
from importlib.metadata import version
from pathlib import Path


class Optiland:
    """Optiland, which reads both kinds of file."""

    package = "optiland"

    def __init__(self, path, before):
        from optiland.fileio import load_optiland_file, load_zemax_file

        self.optic = (load_zemax_file if path.suffix == ".zmx" else load_optiland_file)(str(path))
        self.rows, self.before = self.optic.surfaces.surfaces, before
        for surface in self.rows:
            surface.aperture = None

    def told(self):
        """What it took the file for."""
        return {
            "surfaces": len(self.rows),
            "stop": next((k for k, one in enumerate(self.rows) if one.is_stop), None),
            "ideal": [k for k, one in enumerate(self.rows) if hasattr(one.interaction_model, "f")],
            "stop_size": float(self.optic.aperture.value),
            "places": [_number(one.geometry.cs.z) for one in self.rows],
        }

    def indices(self, wavelength):
        """Refractive indices behind all surfaces."""
        return [_number(one.material_post.n(wavelength)) for one in self.rows]

    def with_indices(self, indices):
        """Put these in."""
        from optiland.materials import IdealMaterial

        for surface, index in zip(self.rows, indices, strict=True):
            surface.material_post = IdealMaterial(index)

    def traced(self, rays, wavelength):
        """Points where rays meet all surfaces, as far as they come."""
        import numpy as np
        from optiland.rays import RealRays

        x, y, *way = (np.array(part, float) for part in zip(*rays, strict=True))
        first = _number(self.rows[0].geometry.cs.z)
        z = first if math.isfinite(first) else _number(self.rows[1].geometry.cs.z) - self.before
        one = np.ones(len(rays))
        self.optic.surfaces.trace(RealRays(x, y, z * one, *way, one, wavelength * one), skip=1)
        met = [[x, y], *([surface.x, surface.y] for surface in self.rows[1:])]
        return np.moveaxis(np.array(met, float), -1, 0).tolist()


class RayOptics:
    """ray-optics."""

    package = "rayoptics"

    def __init__(self, path, before):
        from rayoptics.zemax.zmxread import read_lens_file

        self.model, _ = read_lens_file(path)
        self.model.update_model()
        self.row = self.model.seq_model
        self.read = [gap.thi for gap in self.row.gaps]
        if before:
            self.row.gaps[0].thi = before
            self.row.update_model()

    def told(self):
        """What it took the file for."""
        kinds = [type(one).__name__ for one in self.row.ifcs]
        places = [0.0]
        for gap in self.read[1:]:
            places.append(places[-1] + gap)
        return {
            "surfaces": len(kinds),
            "stop": self.row.stop_surface,
            "ideal": [k for k, kind in enumerate(kinds) if kind == "ThinLens"],
            "stop_size": None,
            "places": [-self.read[0], *places],
        }

    def indices(self, wavelength):
        """Refractive indices behind all surfaces."""
        return [*(float(gap.medium.rindex(1e3 * wavelength)) for gap in self.row.gaps), 1.0]

    def with_indices(self, indices):
        """Put these in."""
        from opticalglass.opticalmedium import ConstantIndex

        for gap, index in zip(self.row.gaps, indices, strict=False):
            gap.medium = ConstantIndex(index, "ours")
        self.row.update_model()

    def traced(self, rays, wavelength):
        """Points where rays meet all surfaces, as far as they come."""
        import numpy as np
        from rayoptics.raytr.raytrace import trace
        from rayoptics.raytr.traceerror import TraceError

        own = min(self.model.optical_spec.spectral_region.wavelengths, key=lambda one: abs(one - 1e3 * wavelength))
        met = []
        for x, y, *way in rays:
            try:
                ray, *_ = trace(self.row, np.array([x, y, 0.0]), np.array(way), own)
            except TraceError as error:  # it says how far the ray came
                ray = error.ray_pkg[0]
            met.append([[float(part) for part in at[0][:2]] for at in ray])
        return met


class KrakenOS:
    """KrakenOS, which wants files in UTF-16; what it drops of a file is put in by hand."""

    package = "KrakenOS"

    def __init__(self, path, before):
        import KrakenOS as Kraken

        self.kraken = Kraken
        wide = Path.cwd() / path.name  # the folder of the job
        wide.write_text(path.read_text(), encoding="utf-16")
        self.rows = Kraken.cat2surf(Kraken.zmx_read(str(wide)))
        self.parts = [part for part in Kraken.zmx_read(str(wide)).values() if isinstance(part, dict)]
        self.read = [float(row.Thickness) for row in self.rows]
        self.lenses = [k for k, row in enumerate(self.rows) if row.Thin_Lens]
        kinds = [line.split()[1] for line in path.read_text().splitlines() if line.startswith("  TYPE")]
        for row, kind, one in zip(self.rows, kinds, self.parts, strict=True):
            if kind == "PARAXIAL":
                row.Thin_Lens = one["aspherics"][0]
            row.Diameter = 1.99 * abs(row.Rc) if row.Rc else 1e3
        if before:
            self.rows[0].Thickness = before

    def told(self):
        """What it took the file for."""
        places = [0.0]
        for gap in self.read[1:-1]:
            places.append(places[-1] + gap)
        return {
            "surfaces": len(self.rows),
            "stop": next((k for k, part in enumerate(self.parts) if part.get("STOP")), None),
            "ideal": self.lenses,
            "stop_size": None,
            "places": [-self.read[0], *places],
        }

    def indices(self, wavelength):
        """Refractive indices behind all surfaces."""
        system = self.kraken.system(self.rows, self.kraken.Setup(), build=0)
        system.Trace([0.0, 0.0, 0.0], [0.0, 0.0, 1.0], wavelength)
        return [float(part) for part in (*system.N0, system.N1[-1])]

    def with_indices(self, indices):
        """Put these in."""
        for row, index in zip(self.rows, indices, strict=True):
            row.Glass = "AIR" if index == 1 else index

    def traced(self, rays, wavelength):
        """Points where rays meet all surfaces, as far as they come."""
        system = self.kraken.system(self.rows, self.kraken.Setup(), build=0)
        met = []
        for x, y, *way in rays:
            system.Trace([x, y, 0.0], list(way), wavelength)
            met.append([[float(part) for part in at[:2]] for at in system.XYZ])
        return met


PROGRAMS = {one.package: one for one in (Optiland, RayOptics, KrakenOS)}


def _number(value):
    import numpy as np

    return float(np.ravel(np.asarray(value, float))[0])


def worked(program, case):
    """What a program says of one file: what it read, and where rays go as read and with the indices handed in."""
    try:
        made = program(Path(case["file"]), case["before"])
        wave = case["wavelength_um"]
        answer = {"stated": made.told(), "indices": made.indices(wave), "as_read": made.traced(case["rays"], wave)}
        made.with_indices(case["indices"])
        return answer | {"our_indices": made.traced(case["rays"], wave)}
    except Exception as error:  # noqa: BLE001 - whatever it dies of is told on the page
        return {"error": f"{type(error).__name__}: {error}"[:200]}


def main():
    """Work on the job, and print the answers as JSON; what the program itself prints is dropped."""
    program = PROGRAMS[sys.argv[1]]
    job = json.loads(Path(sys.argv[2]).read_text())
    with open(os.devnull, "w") as nowhere, contextlib.redirect_stdout(nowhere):
        answers = [worked(program, case) for case in job]
    print(json.dumps({"version": version(program.package), "cases": answers}))


if __name__ == "__main__":
    main()
