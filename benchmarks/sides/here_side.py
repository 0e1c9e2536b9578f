"""The part of this project in the comparisons that have a peer."""

# mypy: allow-untyped-defs, allow-untyped-calls, disable-error-code="var-annotated"

import numpy as np


def _slanted(inputs):
    from roslf_design.lenses.tracer import Rays

    s, t = inputs["s"], inputs["t"]
    n = 1 / np.sqrt(1 + s * s + t * t)
    start = np.stack([inputs["x"], inputs["y"], np.full(s.size, -20.0)])
    return Rays(start, np.stack([s * n, t * n, n]))


def singlet(inputs, options):
    """Ready-made rays through the singlet to a plane behind it, every ray with its fate."""
    from roslf_design.lenses.glass import find_glass
    from roslf_design.lenses.prescription import Prescription, Surface

    semi, thickness = float(inputs["D"]) / 2, float(inputs["thickness"])
    glass, wavelength = find_glass("N-BK7"), float(inputs["wavelength_um"]) * 1e-3
    lens = Prescription((Surface(1 / float(inputs["radius"]), semi, thickness, glass), Surface(0.0, semi)))
    rays, plane, state = _slanted(inputs), thickness + float(inputs["behind"]), {}

    def run():
        state["found"] = lens.trace(rays, wavelength, plane=plane)

    def result():
        found = state["found"]
        x, y, _ = found.rays.position
        return {"kept": np.equal(found.state, 0), "x": x, "y": y}

    return run, result


def _pupil(inputs):
    """A hexapolar pupil in units of its radius."""
    rings = int(inputs["rings"])
    circles = [ring / rings * np.exp(2j * np.pi * np.arange(6 * ring) / (6 * ring)) for ring in range(1, rings + 1)]
    points = np.concatenate([[0.0], *circles])
    return np.stack([points.real, points.imag], axis=-1)


def spot_problem(inputs):
    """A biconvex lens missed at eight places: from deviations (8, trials) to spot sizes (trials, fields) [mm]."""
    from roslf_design.lenses.aim import spot_radii
    from roslf_design.lenses.glass import find_glass
    from roslf_design.lenses.manufacture import lens_builds
    from roslf_design.lenses.prescription import Prescription, Surface

    r, t, near, far = (float(inputs[name]) for name in ("radius", "thickness", "object", "image"))
    green = float(inputs["wavelength_um"]) * 1e-3
    glass = find_glass("N-BK7")
    lens = Prescription((Surface(1 / r, 15.0, t, glass), Surface(-1 / r, 15.0)), "spot", "", green)
    index, pupil = float(glass.index(green)), _pupil(inputs)
    points = np.array([(0.0, -float(y), -near) for y in inputs["heights"]])

    def sizes(off):
        r1, r2, k1, k2, t0, t1, t2, n1 = off
        made = {"surfaces.1.radius": r + r1, "surfaces.2.radius": -r + r2, "surfaces.1.conic": k1}
        made |= {"surfaces.2.conic": k2, "surfaces.1.thickness": t + t1, "surfaces.1.index": index + n1}
        trials = len(r1)
        builds = lens_builds(lens, green, made, trials)
        plane = np.tile([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], (trials, 1))
        rim = np.concatenate([plane, np.full((trials, 1), float(inputs["pupil"]) / 2)], axis=1)[:, None]
        plane[:, 2] = t + far + t1 + t2
        world = np.stack([0 * t0, 0 * t0, -t0], axis=-1)
        return spot_radii(builds, plane, rim, world, points, pupil, np.ones(len(pupil)), threads=True)

    return sizes


def tolerance(inputs, options):
    """Monte Carlo over eight perturbations: every ray of every build traced exactly, spot sizes of three fields."""
    width = {name: float(inputs["width_" + name]) for name in ("radius", "thickness", "conic", "index")}
    kinds = ("radius", "radius", "conic", "conic", "thickness", "thickness", "thickness", "index")
    widths = np.array([width[kind] for kind in kinds])[:, None]
    random, found, trials = np.random.default_rng(1), [], int(options["trials"])
    sizes = spot_problem(inputs)
    nominal = sizes(np.zeros((8, 1)))[0]

    def run():
        pieces = [min(8192, trials - start) for start in range(0, trials, 8192)]
        found.extend(sizes(random.uniform(-1, 1, (8, count)) * widths) for count in pieces)

    def result():
        every = np.concatenate(found)
        return {"nominal": nominal, "mean": every.mean(axis=0), "sd": every.std(axis=0, ddof=1), "trials": len(every)}

    return run, result


def optimise(inputs, options):
    """Where object, stop and array go so that the image has the wanted size and is telecentric."""
    import roslf_design as roslf
    from roslf_design.optimize import Constraint, DesignProblem, Goal, Settings, Variable, quantity_named, solve

    design = roslf.load("paper").replace(f=float(inputs["f"]))
    wanted, state = float(inputs["magnification"]), {}
    problem = DesignProblem(
        "telecentric bench",
        design,
        (
            Variable("d_f", 150.0, 1000.0, float(inputs["start"][0])),
            Variable("d_3", 1.0, 140.0, float(inputs["start"][1])),
        ),
        (
            Constraint(quantity_named("magnification"), wanted, wanted),
            Constraint(quantity_named("telecentric_offset_mm"), 0.0, 0.0),
        ),
        (Goal(quantity_named("camera_length_mm"), "min"),),
    )
    settings = Settings() if options.get("thorough") else Settings(starts=1, check=False)

    def run():
        state["found"] = solve(problem, settings)

    def result():
        from roslf_design import theory

        found = problem.design_at(state["found"].unit)
        d_f, d_3 = found.parameters.d_f, found.parameters.d_3
        return {"d_f": d_f, "d_3": d_3, "d_1": theory.mla_distance(float(inputs["f"]), d_f)}

    return run, result


def geometry(inputs, options):
    """Refocusing distance, baseline and entrance pupil of each camera, one design after the other, closed forms."""
    from roslf_design import theory

    names = ("f", "d_f", "d_3", "d", "d_2", "q")
    cases = [tuple(float(value) for value in row) for row in zip(*(inputs[name] for name in names), strict=True)]
    state = {}

    def run():
        rows = []
        for f, d_f, d_3, d, d_2, q in cases:
            lens = (f, d_f, d_3)
            d_1 = theory.mla_distance(f, d_f)
            m, a = theory.magnification(f, d_f), theory.effective_image_distance(*lens)
            depth = 1 / theory.inverse_depth_from_epi_slope(-1.0, a, m, d, q, d_2)
            rows.append((depth + d_3 + d_1, theory.view_baseline(q, d_2, a), d_3))
        state["rows"] = rows

    def result():
        refocus, baseline, pupil = np.array(state["rows"]).T
        return {"refocus": refocus, "baseline": np.abs(baseline), "entrance_pupil": pupil}

    return run, result


def centres(inputs, options):
    """Centres of all microlens images in a white image."""
    from roslf_design.calibration.centres import find_centres

    image, state = inputs["image"], {}

    def run():
        state["found"] = find_centres(image)

    def result():
        return {"centres": state["found"].centres}

    return run, result


def white(inputs, options):
    """White image of the paper's camera, diffraction and all, into a new array."""
    import roslf_design as roslf
    from roslf_design.imaging.render import render

    design, state, overrides = roslf.load("paper"), {}, list(options.get("overrides", ()))

    def run():
        state["found"] = None
        state["found"] = render(design, overrides=overrides)

    def result():
        image = state["found"].pixels
        return {"shape": image.shape, "mean": image.mean(), "dtype_bytes": image.dtype.itemsize}

    return run, result


WORK = {
    "singlet": singlet,
    "tolerance": tolerance,
    "optimise": optimise,
    "geometry": geometry,
    "centres": centres,
    "white": white,
}
