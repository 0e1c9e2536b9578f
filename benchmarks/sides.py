"""What each program does in a comparison; run as a script by that program's own Python: WORK INPUTS.npz ANSWER.npz.

A work is a function of the inputs that gives `run`, which does the work once, and `answer`, which says what came out.
The script does it once, stores the answer, and then runs it once for every line on its input, printing seconds of wall
and processor.
"""

# mypy: allow-untyped-defs, allow-untyped-calls, disable-error-code="import-not-found, var-annotated"

import json
import os
import sys
import time
from typing import Any

import numpy as np

N_BK7 = [1.03961212, 0.231792344, 1.01046945, 0.00600069867, 0.0200179144, 103.560653]
"""Sellmeier coefficients of the glass as SCHOTT gives them."""
KINDS = ("radius", "radius", "conic", "conic", "thickness", "thickness", "thickness", "index")
"""What is missed in a trial of the spots: two radii, two conics, object distance, thickness, image distance, index."""


def slanted(inputs):
    """Ready-made rays: positions and unit directions, six arrays."""
    x, y, s, t = (np.array(inputs[name], np.float64) for name in ("x", "y", "s", "t"))
    n = 1 / np.sqrt(1 + s * s + t * t)
    return x, y, np.full(x.size, -20.0), s * n, t * n, n


def here_singlet(inputs):
    """Rays through the singlet to a plane behind it."""
    from roslf_design.lenses.glass import find_glass
    from roslf_design.lenses.prescription import Prescription, Surface

    semi, thickness = float(inputs["D"]) / 2, float(inputs["thickness"])
    front = Surface(1 / float(inputs["radius"]), semi, thickness, find_glass("N-BK7"))
    lens = Prescription((front, Surface(0.0, semi)))
    x, y, z, *way = slanted(inputs)
    height, slope = np.array([x, y]), np.array(way[:2]) / way[2]
    plane, wavelength, state = thickness + float(inputs["behind"]), float(inputs["wavelength_um"]) * 1e-3, {}

    def run():
        state["ended"] = lens.through(height, slope, wavelength, start=z, end=plane, backward=False, clip=True)

    def answer():
        x, y = state["ended"].height
        return {"kept": state["ended"].state == 0, "x": x, "y": y}

    return run, answer


def optiland_singlet(inputs):
    """The same."""
    from optiland.materials import Material
    from optiland.optic import Optic
    from optiland.rays import RealRays

    lens, glass, aperture = Optic(), Material("N-BK7", reference="schott"), float(inputs["D"])
    radius, thickness, behind = (float(inputs[name]) for name in ("radius", "thickness", "behind"))
    lens.surfaces.add(index=0, thickness=np.inf)
    lens.surfaces.add(index=1, radius=radius, thickness=thickness, material=glass, is_stop=True, aperture=aperture)
    lens.surfaces.add(index=2, radius=np.inf, thickness=behind, aperture=aperture)
    lens.surfaces.add(index=3)
    made, one, state = slanted(inputs), np.ones(inputs["x"].size), {}
    made = (*made, one, float(inputs["wavelength_um"]) * one)

    def run():
        state["rays"] = lens.surfaces.trace(RealRays(*made), skip=1, record=False)

    def answer():
        rays = state["rays"]
        return {"kept": (rays.i > 0) & np.isfinite(rays.x), "x": rays.x, "y": rays.y}

    return run, answer


def batoid_singlet(inputs):
    """The same; wavelengths in m."""
    import batoid

    thickness, behind, semi = float(inputs["thickness"]), float(inputs["behind"]), float(inputs["D"]) / 2
    glass, air = batoid.SellmeierMedium(N_BK7), batoid.ConstMedium(1.0)
    rim = batoid.ObscNegation(batoid.ObscCircle(semi))

    def at(z):
        return batoid.CoordSys(origin=[0, 0, z])

    inside, outside = {"inMedium": air, "outMedium": glass}, {"inMedium": glass, "outMedium": air}
    sphere, plane = batoid.Sphere(float(inputs["radius"])), batoid.Plane()
    front = batoid.RefractiveInterface(sphere, name="front", obscuration=rim, **inside)
    back = batoid.RefractiveInterface(plane, name="back", obscuration=rim, coordSys=at(thickness), **outside)
    screen = batoid.Detector(plane, name="screen", inMedium=air, outMedium=air, coordSys=at(thickness + behind))
    lens = batoid.CompoundOptic((front, back, screen), inMedium=air, outMedium=air)
    made, one, state = slanted(inputs), np.ones(inputs["x"].size), {}
    made = (*made, 0 * one, float(inputs["wavelength_um"]) * 1e-6 * one, one)

    def run():
        state["rays"] = lens.trace(batoid.RayVector(*made))

    def answer():
        rays = state["rays"]
        return {"kept": ~(rays.vignetted | rays.failed), "x": rays.x, "y": rays.y}

    return run, answer


def trials_said(nominal, tables):
    """What two Monte Carlo runs are compared by."""
    table = np.concatenate(tables)
    return {"nominal": nominal, "mean": table.mean(0), "sd": table.std(0), "trials": len(table)}


def numbers(inputs, *names):
    """Some of the inputs."""
    return (float(inputs[name]) for name in names)


def here_lens(inputs):
    """The biconvex lens of the spots, and what sizes them: object points' rays through it in rings, of many builds."""
    from roslf_design.lenses.glass import find_glass
    from roslf_design.lenses.manufacture import lens_builds
    from roslf_design.lenses.prescription import Prescription, Surface
    from roslf_design.traced.train import Train, spot_radii

    r, t, near, green = numbers(inputs, "radius", "thickness", "object", "wavelength_um")
    green, rings = green * 1e-3, int(inputs["rings"])
    lens = Prescription((Surface(1 / r, 15.0, t, find_glass("N-BK7")), Surface(-1 / r, 15.0)), "spot", "", green)
    circles = [ring / rings * np.exp(2j * np.pi * np.arange(6 * ring) / (6 * ring)) for ring in range(1, rings + 1)]
    spread = np.concatenate([[0.0], *circles])
    pupil = np.stack([spread.real, spread.imag], axis=-1)
    points = np.array([(0.0, -float(y), -near) for y in inputs["heights"]])

    def sizes(places, image, world):
        """Of builds whose numbers, planes of the image and object points' shifts those are."""
        builds = len(image)
        plane = np.tile([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], (builds, 1))
        half = float(inputs["pupil"]) / 2
        rim = np.concatenate([plane, np.tile([half, half, 1.0], (builds, 1))], axis=1)[:, None]
        plane[:, 2] = image
        train = Train.in_air(lens_builds(lens, green, places, builds).stack)
        return spot_radii(train, plane, rim, world, points, pupil, np.ones(len(pupil)))

    return lens, sizes


def optiland_lens(inputs):
    """The same lens as Optiland has it, and what it asks for: the size of each object point's spot."""
    from optiland.optic import Optic

    r, t, near, far, pupil, wave = numbers(inputs, "radius", "thickness", "object", "image", "pupil", "wavelength_um")
    heights, lens = [float(y) for y in inputs["heights"]], Optic()
    lens.surfaces.add(index=0, thickness=near)
    lens.surfaces.add(index=1, radius=r, thickness=t, material="N-BK7", is_stop=True)
    lens.surfaces.add(index=2, radius=-r, thickness=far)
    lens.surfaces.add(index=3)
    lens.set_aperture(aperture_type="EPD", value=pupil)
    lens.fields.set_type(field_type="object_height")
    for y in heights:
        lens.fields.add(y=y)
    lens.wavelengths.add(value=wave, is_primary=True)
    asked = {"optic": lens, "surface_number": -1, "Hx": 0, "distribution": "hexapolar"}
    asked |= {"num_rays": int(inputs["rings"]), "wavelength": wave}
    return lens, [{**asked, "Hy": y / max(heights)} for y in heights]


def here_spots(inputs):
    """Every ray of every build traced exactly; spot sizes of three object points."""
    r, t, far = numbers(inputs, "radius", "thickness", "image")
    lens, spots = here_lens(inputs)
    index = float(lens.surfaces[0].glass.index(lens.wavelength))

    def sizes(off):
        r1, r2, k1, k2, t0, t1, t2, n1 = off
        made = {"surfaces.1.radius": r + r1, "surfaces.2.radius": -r + r2, "surfaces.1.conic": k1}
        made |= {"surfaces.2.conic": k2, "surfaces.1.thickness": t + t1, "surfaces.1.index": index + n1}
        return spots(made, t + far + t1 + t2, np.stack([0 * t0, 0 * t0, -t0], axis=-1))

    widths = np.array([float(inputs["width_" + kind]) for kind in KINDS])[:, None]
    random, every, trials = np.random.default_rng(1), [], int(inputs["here_trials"])

    def run():
        pieces = [min(8192, trials - start) for start in range(0, trials, 8192)]
        every.extend(sizes(random.uniform(-1, 1, (8, count)) * widths) for count in pieces)

    return run, lambda: trials_said(sizes(np.zeros((8, 1)))[0], every)


def optiland_spots(inputs):
    """Its own Monte Carlo, with the same perturbations, object points and pupil."""
    from optiland.tolerancing import DistributionSampler, Tolerancing
    from optiland.tolerancing.monte_carlo import MonteCarlo

    r, t, near, far, wave = numbers(inputs, "radius", "thickness", "object", "image", "wavelength_um")
    lens, spots = optiland_lens(inputs)
    study = Tolerancing(lens)
    for spot in spots:
        study.add_operand("rms_spot_size", input_data=spot)
    nominal = [float(value) for value in study.evaluate()]
    middles = (r, -r, 0.0, 0.0, near, t, far, float(inputs["index"]))
    for kind, middle, surface in zip(KINDS, middles, (1, 2, 1, 2, 0, 1, 2, 1), strict=True):
        width = float(inputs["width_" + kind])
        sampler = DistributionSampler("uniform", low=middle - width, high=middle + width)
        wanted = {"wavelength": wave} if kind == "index" else {}
        study.add_perturbation(kind, sampler, surface_number=surface, **wanted)
    task, tables = MonteCarlo(study), []

    def run():
        task.run(int(inputs["optiland_trials"]))
        results = task.get_results()
        tables.append(results[[name for name in results.columns if "rms spot size" in name]].to_numpy(float))

    return run, lambda: trials_said(nominal, tables)


def here_bending(inputs):
    """The bending and the focus of least blur of three object points, f held: batched builds under SLSQP."""
    from roslf_design.optimization.lens_variables import BENDING, LensVariation
    from roslf_design.optimization.search import SearchBudget, search

    t, far, focal = numbers(inputs, "thickness", "image", "focal_length")
    lens, spots = here_lens(inputs)
    variation, state = LensVariation(lens, lens.wavelength, focal), {}

    def vector(units):
        bent = variation.at({BENDING: 4 * units[:, 0] - 2})
        image = t + far * (0.9 + 0.2 * units[:, 1])
        return np.log(np.sum(spots(bent.places, image, np.zeros((len(units), 3))) ** 2, axis=1))[None]

    def run():
        state["best"] = search(vector, np.full(2, 0.5), SearchBudget(), 300, 1e-10)

    return run, lambda: {"merit": np.sqrt(np.exp(state["best"].merit) / len(inputs["heights"]))}


def optiland_bending(inputs):
    """Both radii and the image's distance by its own least squares, the focal length an operand."""
    from optiland.optimization import LeastSquares, OptimizationProblem

    (focal,), heights, state = numbers(inputs, "focal_length"), inputs["heights"], {}

    def posed():
        lens, spots = optiland_lens(inputs)
        task = OptimizationProblem()
        for spot in spots:
            task.add_operand("rms_spot_size", target=0, weight=1, input_data=spot)
        task.add_operand("f2", target=focal, weight=10, input_data={"optic": lens})
        task.add_variable(lens, "radius", surface_number=1)
        task.add_variable(lens, "radius", surface_number=2)
        task.add_variable(lens, "thickness", surface_number=2)
        return task

    def run():
        state["task"] = posed()
        LeastSquares(state["task"]).optimize(tol=1e-9)

    def answer():
        spots = [float(operand.value) for operand in state["task"].operands.operands[: len(heights)]]
        return {"merit": np.sqrt(np.mean(np.square(spots)))}

    return run, answer


def here_geometry(inputs):
    """Distance in focus for the neighbouring slope, baseline and entrance pupil of many cameras at once."""
    from roslf_design.camera import Camera
    from roslf_design.design import load
    from roslf_design.theory import light

    places = {"main_lens.focal_plane": "d_f", "aperture.distance": "d_3", "microlens_array.pitch": "d"}
    places |= {"main_lens.focal_length": "f", "sensor.distance": "d_2", "sensor.pixel": "q"}
    changes, paper, state = {place: inputs[name] for place, name in places.items()}, load("paper"), {}

    def run():
        for _ in range(20):
            c = Camera.of(paper, changes)
            baseline = light.view_baseline(c)
        state.update(refocus=c.seen.A / (c.seen.m + c.d / baseline), baseline=baseline, entrance_pupil=c.seen.d_3)

    return run, lambda: state


def plenoptisign_geometry(inputs):
    """Camera by camera, as its documentation says; it counts from the array."""
    import plenoptisign

    cases, state = [], {}
    for f, d_f, d_3, d, d_2, q in zip(*(inputs[name] for name in ("f", "d_f", "d_3", "d", "d_2", "q")), strict=True):
        d_1 = f * d_f / (d_f - f)
        lens = {"fU": f, "HH": 0.0, "df": d_f + d_1, "dA": d_1 - f * d_3 / (d_3 - f), "D": 2.9, "f_num": f / 2.9}
        rest = {"pp": q, "fs": d_2, "hh": 0.0, "pm": d, "sd": (14.9, 22.3), "a": 1.0, "M": 13.0, "G": 1, "dx": 1}
        cases.append({k: v if isinstance(v, (int, tuple)) else float(v) for k, v in {**lens, **rest}.items()})

    def run():
        rows = []
        for case in cases:
            camera = plenoptisign.MainClass(dict(case))
            camera.refo()
            camera.tria()
            results = camera.get_results()
            rows.append((results[0], results[4], vars(camera)["_intersect"]))
        refocus, baseline, pupil = np.array(rows, float).T
        d_1 = inputs["f"] * inputs["d_f"] / (inputs["d_f"] - inputs["f"])
        state.update(refocus=refocus - inputs["d_3"] - d_1, baseline=np.abs(baseline), entrance_pupil=pupil)

    return run, lambda: state


def here_centres(inputs):
    """Centres of all microlens images in a white image."""
    from roslf_design.calibration.centres import find_centres

    state = {}

    def run():
        state["centres"] = find_centres(inputs["image"]).centres

    return run, lambda: state


def scipy_centres(inputs):
    """Threshold at half the light, label, centre of mass: what one would write by hand."""
    from scipy import ndimage

    image, state = inputs["image"], {}

    def run():
        labels, count = ndimage.label(image > image.max() / 2)
        middles = ndimage.center_of_mass(np.maximum(image, 0), labels, np.arange(1, count + 1))
        state["centres"] = np.array(middles)[:, ::-1]

    return run, lambda: state


def plenopticam_centres(inputs):
    """Pitch, extraction, refinement by areas, sorting, grid fit; grey levels from 0 to 255 as of a picture."""
    from plenopticam.cfg import PlenopticamConfig
    from plenopticam.lfp_calibrator import (
        CentroidExtractor,
        CentroidRefiner,
        CentroidSorter,
        GridFitter,
        PitchEstimator,
    )
    from plenopticam.misc import PlenopticamStatus

    image = np.clip(np.asarray(inputs["image"], np.float64), 0, None)
    image, state = image / image.max() * 255, {}

    def run():
        config, status = PlenopticamConfig(), PlenopticamStatus()
        config.params.update(opt_prnt=False, cal_meth="area")
        pitch = PitchEstimator(image, config, status)
        pitch.main()
        peaks = CentroidExtractor(image, config, status, pitch.M)
        peaks.main()
        fine = CentroidRefiner(image, peaks.centroids, config, status, pitch.M, method="area")
        fine.main()
        lattice = CentroidSorter(fine.centroids_refined, config, status)
        lattice.main()
        grid = GridFitter(coords_list=lattice.mic_list, cfg=config, sta=status)
        grid.main()
        state["centres"] = np.asarray(grid.grid_fit, float)[:, 1::-1]

    return run, lambda: state


def here_depth(inputs):
    """Disparity of every microlens with its standard error; neighbours' light and diffraction taken out."""
    from roslf_design.calibration.decoding import LightField
    from roslf_design.depth.estimate import PixelNoise
    from roslf_design.depth.geometry import ArrayGeometry
    from roslf_design.depth.measure import measure
    from roslf_design.design import load

    values, weight, s, t, u, v = (inputs[name] for name in ("values", "weight", "s", "t", "u", "v"))
    field = LightField(values, weight, s, t, u, v, float(inputs["pitch"]))
    geometry, state = ArrayGeometry(load("paper")), {}
    noise, (low, high) = PixelNoise(*numbers(inputs, "electrons", "read_noise")), inputs["search"]

    def run():
        state["depths"] = measure(geometry, field, noise, search=(float(low), float(high)))

    def answer():
        result = state["depths"].disparities
        return {"disparity": np.where(result.measured, result.disparity, np.nan), "sigma": result.sigma}

    return run, answer


def numpy_depth(inputs):
    """What one would write by hand: how views change from view to view over the picture's gradient, by windows."""
    values, side, state = inputs["values"], 5, {}
    t, s = np.nonzero(inputs["weight"].min((2, 3)) > 0.3)
    ways = [way - way.mean() for way in (inputs["s"][s], inputs["t"][t])]

    def slope(picture, axis):
        turned = np.moveaxis(picture, axis, -1)
        waves = 2j * np.pi * np.fft.rfftfreq(turned.shape[-1])
        return np.moveaxis(np.fft.irfft(waves * np.fft.rfft(turned), turned.shape[-1]), -1, axis)

    def summed(picture):
        sums = np.pad(np.pad(picture, side // 2, mode="edge").cumsum(0).cumsum(1), ((1, 0), (1, 0)))
        return sums[side:, side:] - sums[side:, :-side] - sums[:-side, side:] + sums[:-side, :-side]

    def run():
        views = values[t, s].astype(float)
        picture = views.mean(0)
        along_s, along_t = (np.tensordot(way, views, 1) / (way @ way) for way in ways)
        across, down = slope(picture, 1), slope(picture, 0)
        moved = summed(along_s * across + along_t * down) / summed(across**2 + down**2)
        state["disparity"] = moved * float(inputs["image"])

    return run, lambda: state


def main(work, inputs, answer):
    """Do a work once, store its answer, and again for every line that comes in."""
    results = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what programs print is no result
    with np.load(inputs) as stored:
        run, said = globals()[work]({name: stored[name] for name in stored.files})
    for index, _ in enumerate(sys.stdin):
        start, busy = time.perf_counter(), time.process_time()
        run()
        seconds = time.perf_counter() - start, time.process_time() - busy
        if index == 0:
            arrays: dict[str, Any] = {name: np.asarray(value) for name, value in said().items()}
            np.savez(answer, **arrays)
        results.write(json.dumps(seconds) + "\n")
        results.flush()


if __name__ == "__main__":
    main(*sys.argv[1:])
