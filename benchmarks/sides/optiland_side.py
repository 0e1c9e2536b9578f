"""Optiland's part: rays through an ideal lens and a singlet, tolerancing, a small optimisation."""

# mypy: allow-untyped-defs, allow-untyped-calls

import numpy as np
import optiland.backend as be  # type: ignore[import-not-found]
from optiland.materials import Material  # type: ignore[import-not-found]
from optiland.optic import Optic  # type: ignore[import-not-found]
from optiland.optimization import LeastSquares, OptimizationProblem  # type: ignore[import-not-found]
from optiland.rays import RealRays  # type: ignore[import-not-found]

be.set_backend("numpy")


def _rays(inputs, start):
    """Ready-made rays from slopes, normalised; positions on the plane at `start`."""
    x, y, s, t = (np.array(inputs[name], np.float64) for name in ("x", "y", "s", "t"))
    n = 1 / np.sqrt(1 + s * s + t * t)
    wave, one = np.full(x.size, float(inputs["wavelength_um"])), np.ones(x.size)
    return RealRays(x, y, np.full(x.size, float(start)), s * n, t * n, n, one, wave)


def _singlet(inputs, plane):
    lens = Optic()
    glass = Material("N-BK7", reference="schott")
    aperture = float(inputs["D"])
    lens.surfaces.add(index=0, thickness=np.inf)
    radius, thickness = float(inputs["radius"]), float(inputs["thickness"])
    lens.surfaces.add(index=1, radius=radius, thickness=thickness, material=glass, is_stop=True, aperture=aperture)
    lens.surfaces.add(index=2, radius=np.inf, thickness=plane, aperture=aperture)
    lens.surfaces.add(index=3)
    return lens


def singlet(inputs, options):
    """Ready-made rays through the singlet to a plane behind it."""
    lens = _singlet(inputs, float(inputs["behind"]))
    made = _rays(inputs, -20.0)
    state = {}

    def run():
        rays = RealRays(made.x, made.y, made.z, made.L, made.M, made.N, made.i, made.w)
        state["rays"] = lens.surfaces.trace(rays, skip=1, record=False)

    def result():
        rays = state["rays"]
        return {"kept": (rays.i > 0) & np.isfinite(rays.x), "x": rays.x, "y": rays.y}

    return run, result


def _spot_lens(inputs):
    r, t = float(inputs["radius"]), float(inputs["thickness"])
    lens = Optic()
    lens.surfaces.add(index=0, thickness=float(inputs["object"]))
    lens.surfaces.add(index=1, radius=r, thickness=t, material="N-BK7", is_stop=True)
    lens.surfaces.add(index=2, radius=-r, thickness=float(inputs["image"]))
    lens.surfaces.add(index=3)
    lens.set_aperture(aperture_type="EPD", value=float(inputs["pupil"]))
    lens.fields.set_type(field_type="object_height")
    for y in inputs["heights"]:
        lens.fields.add(y=float(y))
    lens.wavelengths.add(value=float(inputs["wavelength_um"]), is_primary=True)
    return lens


def tolerance(inputs, options):
    """Monte Carlo over eight perturbations; spot sizes of three fields, a hexapolar pupil each."""
    from optiland.tolerancing import DistributionSampler, Tolerancing  # type: ignore[import-not-found]
    from optiland.tolerancing.monte_carlo import MonteCarlo  # type: ignore[import-not-found]

    lens = _spot_lens(inputs)
    study = Tolerancing(lens)
    heights = [float(y) for y in inputs["heights"]]
    for y in heights:
        wanted = {"optic": lens, "surface_number": -1, "Hx": 0, "Hy": y / max(heights), "distribution": "hexapolar"}
        wanted |= {"num_rays": int(inputs["rings"]), "wavelength": float(inputs["wavelength_um"])}
        study.add_operand("rms_spot_size", input_data=wanted)
    nominal = [float(value) for value in study.evaluate()]
    width = {name: float(inputs["width_" + name]) for name in ("radius", "thickness", "conic", "index")}

    def around(middle, kind):
        return DistributionSampler("uniform", low=middle - width[kind], high=middle + width[kind])

    r, t = float(inputs["radius"]), float(inputs["thickness"])
    for surface, value in ((1, r), (2, -r)):
        study.add_perturbation("radius", around(value, "radius"), surface_number=surface)
    for surface, value in ((0, float(inputs["object"])), (1, t), (2, float(inputs["image"]))):
        study.add_perturbation("thickness", around(value, "thickness"), surface_number=surface)
    for surface in (1, 2):
        study.add_perturbation("conic", around(0.0, "conic"), surface_number=surface)
    wave = float(inputs["wavelength_um"])
    study.add_perturbation("index", around(float(inputs["index"]), "index"), surface_number=1, wavelength=wave)
    trials, task, frames = int(options["trials"]), MonteCarlo(study), []

    def run():
        task.run(trials)
        frames.append(task.get_results())

    def result():
        import pandas  # type: ignore[import-untyped,import-not-found,unused-ignore]

        table = pandas.concat(frames)
        columns = [name for name in table.columns if "rms spot size" in name]
        sizes = table[columns].to_numpy(float)
        return {"nominal": nominal, "mean": sizes.mean(axis=0), "sd": sizes.std(axis=0, ddof=1), "trials": len(sizes)}

    return run, result


def optimise(inputs, options):
    """Where object, stop and image go so that the image is sharp, has the wanted size and is telecentric."""
    f, height, wanted = (float(inputs[name]) for name in ("f", "height", "magnification"))
    state = {}

    def run():
        lens = Optic()
        start = [float(value) for value in inputs["start"]]
        d_f, d_3, d_1 = start
        lens.surfaces.add(index=0, thickness=d_f - d_3)
        lens.surfaces.add(index=1, thickness=d_3, is_stop=True)
        lens.surfaces.add(index=2, surface_type="paraxial", f=f, thickness=d_1)
        lens.surfaces.add(index=3)
        lens.set_aperture(aperture_type="EPD", value=float(inputs["D_F"]))
        lens.fields.set_type(field_type="object_height")
        lens.fields.add(y=0.0)
        lens.fields.add(y=height)
        lens.wavelengths.add(value=0.55, is_primary=True)
        problem = OptimizationProblem()
        common = {"optic": lens, "surface_number": -1, "Hx": 0, "Px": 0, "wavelength": 0.55}
        on_axis, chief = {"Hy": 0, "Py": 1}, {"Hy": 1, "Py": 0}
        problem.add_operand("real_y_intercept", target=0.0, weight=1, input_data={**common, **on_axis})
        problem.add_operand("real_y_intercept", target=-wanted * height, weight=1, input_data={**common, **chief})
        problem.add_operand("real_M", target=0.0, weight=100, input_data={**common, **chief})
        for number in (0, 1, 2):
            problem.add_variable(lens, "thickness", surface_number=number)
        LeastSquares(problem).optimize(maxiter=200, disp=False, tol=1e-12)
        state["found"] = [float(lens.surfaces[k].thickness) for k in (0, 1, 2)]

    def result():
        gap, d_3, d_1 = state["found"]
        return {"d_f": gap + d_3, "d_3": d_3, "d_1": d_1}

    return run, result


WORK = {"singlet": singlet, "tolerance": tolerance, "optimise": optimise}
