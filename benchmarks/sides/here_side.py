"""The part of this project in the comparisons that have a peer."""

# mypy: allow-untyped-defs, allow-untyped-calls, disable-error-code="var-annotated"

import numpy as np


def ideal_lens(inputs, options):
    """Ready-made backward rays: status and end points on the plane at Z."""
    from roslf_design.rays import Array, Lens, Sensor, Stop, System
    from roslf_design.rays.backward import Ends, compiled_ends

    f, d_1, d_3, plane, lens, stop = (float(inputs[name]) for name in ("f", "d_1", "d_3", "plane", "D", "D_F"))
    d_2 = 2.0
    system = System(Lens(f, lens), (Stop(stop, d_3),), Array(d_1, d_2, 0.063), Sensor(d_2))
    c = np.ascontiguousarray(inputs["x"]), np.ascontiguousarray(inputs["y"])
    p = c[0] - d_2 * inputs["s"], c[1] - d_2 * inputs["t"]  # pinhole microlenses: any ray of the array
    n = p[0].size
    out = Ends(np.empty(n, np.uint8), np.empty(n), np.empty(n))

    def run():
        compiled_ends(system, p, c, distance=plane, out=out)

    def result():
        from roslf_design.rays import Status

        return {"kept": out.status == Status.KEPT, "x": out.x, "y": out.y}

    return run, result


def _slanted(inputs):
    from roslf_design.lenses.trace import Rays

    s, t = inputs["s"], inputs["t"]
    n = 1 / np.sqrt(1 + s * s + t * t)
    start = np.stack([inputs["x"], inputs["y"], np.full(s.size, -20.0)])
    return Rays(start, np.stack([s * n, t * n, n]))


def singlet(inputs, options):
    """Ready-made rays through the singlet to a plane behind it, every ray with its fate."""
    from roslf_design.lenses.glass import find_glass
    from roslf_design.lenses.prescription import Prescription, Surface
    from roslf_design.lenses.trace import trace

    semi, thickness = float(inputs["D"]) / 2, float(inputs["thickness"])
    glass, wavelength = find_glass("N-BK7"), float(inputs["wavelength_um"]) * 1e-3
    lens = Prescription((Surface(1 / float(inputs["radius"]), semi, thickness, glass), Surface(0.0, semi)))
    rays, plane, state = _slanted(inputs), thickness + float(inputs["behind"]), {}

    def run():
        state["found"] = trace(lens, rays, wavelength, plane=plane)

    def result():
        found = state["found"]
        x, y, _ = found.rays.position
        return {"kept": np.equal(found.state, 0), "x": x, "y": y}

    return run, result


def _fields(inputs, distance):
    """A hexapolar pupil at the first vertex, seen from each object height."""
    from roslf_design.lenses.trace import Rays

    rings, radius = int(inputs["rings"]), float(inputs["pupil"]) / 2
    circles = [ring / rings * np.exp(2j * np.pi * np.arange(6 * ring) / (6 * ring)) for ring in range(1, rings + 1)]
    points = radius * np.concatenate([[0.0], *circles])
    pupil = np.stack([points.real, points.imag, 0 * points.real])[:, None, :]
    heights = np.array([(0.0, -y, -distance) for y in inputs["heights"]]).T[:, :, None]
    return Rays.between(heights, pupil)


def _spots(lens, inputs, distance, plane):
    from roslf_design.lenses.trace import trace

    wavelength = float(inputs["wavelength_um"]) * 1e-3
    x, y, _ = trace(lens, _fields(inputs, distance), wavelength, plane=plane, clip=False).rays.position
    x, y = x - x.mean(axis=1, keepdims=True), y - y.mean(axis=1, keepdims=True)
    return np.sqrt((x * x + y * y).mean(axis=1))


def tolerance(inputs, options):
    """Monte Carlo over eight perturbations, build by build: exact traces, spot sizes of three fields."""
    from dataclasses import replace

    from roslf_design.lenses.glass import find_glass
    from roslf_design.lenses.perturb import with_index_error, with_radius_error, with_thickness_error
    from roslf_design.lenses.prescription import Prescription, Surface

    r, t, near, far = (float(inputs[name]) for name in ("radius", "thickness", "object", "image"))
    glass = find_glass("N-BK7")
    lens = Prescription((Surface(1 / r, 15.0, t, glass), Surface(-1 / r, 15.0)), "spot", "", 550e-6)
    nominal = _spots(lens, inputs, near, t + far)
    width = {name: float(inputs["width_" + name]) for name in ("radius", "thickness", "conic", "index")}
    kinds = ("radius", "radius", "conic", "conic", "thickness", "thickness", "thickness", "index")
    widths = np.array([width[kind] for kind in kinds])
    random, found, trials = np.random.default_rng(1), [], int(options["trials"])

    def run():
        for r1, r2, k1, k2, t0, t1, t2, n1 in random.uniform(-1, 1, (trials, 8)) * widths:
            one = with_thickness_error(with_radius_error(with_radius_error(lens, 1, r1), 2, r2), 1, t1)
            first, second = with_index_error(one, 1, n1).surfaces
            one = replace(one, surfaces=(replace(first, conic=float(k1)), replace(second, conic=float(k2))))
            found.append(_spots(one, inputs, near + t0, t + far + t1 + t2))

    def result():
        sizes = np.array(found)
        return {"nominal": nominal, "mean": sizes.mean(axis=0), "sd": sizes.std(axis=0, ddof=1), "trials": len(sizes)}

    return run, result


def optimise(inputs, options):
    """Where object, stop and array go so that the image has the wanted size and is telecentric."""
    import roslf_design as roslf
    from roslf_design.optimize import Constraint, Goal, Problem, Settings, Variable, quantity_named, solve

    design = roslf.load("paper").replace(f=float(inputs["f"]))
    wanted, state = float(inputs["magnification"]), {}
    problem = Problem(
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
    "ideal_lens": ideal_lens,
    "singlet": singlet,
    "tolerance": tolerance,
    "optimise": optimise,
    "geometry": geometry,
    "centres": centres,
    "white": white,
}
