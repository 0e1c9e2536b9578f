"""What is compared with peers, with which inputs, and what counts as the same result."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from .harness.comparison import Case, Check, Goal, Side
from .harness.process import Arrays

GREEN_UM = 0.55
WHITE = (3080, 4600)
"""Rows and columns of the paper's sensor."""


def peer_cases(quick: bool = False) -> list[Case]:
    """The comparisons with peers, in the order of the page."""
    rays = 200_000 if quick else 1_000_000
    found = [singlet(rays), tolerance(quick), optimise(), geometry()]
    shape = (600, 800) if quick else (1000, 1400)
    for layout, fill in (("hexagonal", 0.7), ("square", 0.7), ("hexagonal", 0.95), ("square", 0.95)):
        found.append(centres(layout, fill, shape, fast=layout == "hexagonal" and fill < 0.9))
    return [*found, white_floor(), first_answer(quick), imports()]


def rays_agree(allowed: float, ours: Arrays, theirs: Arrays) -> Sequence[Check]:
    """The same rays stopped, but for a few within rounding of a rim, and the others at the same place [mm]."""
    both = ours["kept"] & theirs["kept"]
    away = [np.abs(ours[name] - theirs[name])[both].max(initial=0.0) for name in ("x", "y")]
    return (
        Check("rays whose fate differs", float(np.sum(ours["kept"] != theirs["kept"])), 3 + 1e-6 * both.size),
        Check("end points [mm]", float(max(away)) if both.any() else math.nan, allowed),
    )


def relative(allowed: Mapping[str, float], ours: Arrays, theirs: Arrays) -> Sequence[Check]:
    """Largest differences over the largest value of each quantity."""
    found = []
    for name, limit in allowed.items():
        a, b = (np.atleast_1d(np.asarray(side[name], float)) for side in (ours, theirs))
        if a.shape != b.shape:
            raise ValueError(f"{name} has {b.size} values, not {a.size}")
        word = name if len(name) <= 3 else name.replace("_", " ")  # symbols keep their subscripts
        found.append(Check(f"{word}, relative", float(np.abs(a - b).max() / np.abs(a).max()), limit))
    return tuple(found)


def singlet(rays: int) -> Case:
    """N-BK7, f 100 mm, diameter 50.8 mm, 10 mm thick, plano-convex."""
    index = 1.0 + 0.5185  # only to choose the radius; each side looks the glass up

    def inputs() -> Mapping[str, Any]:
        from roslf_design.lenses.glass import find_glass

        rng = np.random.default_rng(0)
        x, y = rng.uniform(-10, 10, (2, rays))
        s, t = rng.uniform(-0.05, 0.05, (2, rays))
        n = float(find_glass("N-BK7").index(GREEN_UM * 1e-3))
        lens = {"radius": 100 * (index - 1), "thickness": 10.0, "behind": 93.4, "D": 50.8, "index": n}
        return {"x": x, "y": y, "s": s, "t": t, "wavelength_um": GREEN_UM, **lens}

    return Case(
        "singlet",
        "N-BK7 singlet, f 100 mm, diameter 50.8 mm, 10 mm thick",
        "rays",
        rays,
        (
            Side("here, 1 thread", "here", "singlet", 1),
            Side("Optiland", "optiland", "singlet", 1),
            Side("batoid", "batoid", "singlet", 1),
            Side("plain numpy", "numpy", "singlet", 1),
        ),
        inputs,
        partial(rays_agree, 2e-6),
        goals=(Goal("Optiland", 5.0, "5 times Optiland, one thread"),),
        note="Exact rays through both surfaces with their rims to a plane behind. Each program looks N-BK7 up for "
        "itself; 2e-6 mm at the end points is allowed for the digits that glasses are given with.",
    )


def tolerance(quick: bool) -> Case:
    """A biconvex lens, eight perturbations, RMS spot size of three fields."""
    here, there = (20_000, 15) if quick else (200_000, 40)

    def inputs() -> Mapping[str, Any]:
        from roslf_design.lenses.glass import find_glass

        lens = {"radius": 103.29, "thickness": 7.0, "object": 350.0, "image": 136.0, "pupil": 10.0, "rings": 6}
        widths = {"width_radius": 0.5, "width_thickness": 0.05, "width_conic": 0.01, "width_index": 0.001}
        index = float(find_glass("N-BK7").index(GREEN_UM * 1e-3))
        return {**lens, **widths, "heights": [0.0, 14.0, 28.0], "wavelength_um": GREEN_UM, "index": index}

    return Case(
        "tolerance",
        "Monte Carlo tolerancing of a singlet, 8 perturbations",
        "trials",
        here,
        (
            Side("here, 2 threads", "here", "tolerance", 2, {"trials": here}),
            Side("here, 1 thread", "here", "tolerance", 1, {"trials": here}),
            Side("Optiland", "optiland", "tolerance", 1, {"trials": there}, there),
        ),
        inputs,
        spots_agree,
        goals=(Goal("Optiland", 1000.0, "1000 times Optiland's Monte Carlo, two threads"),),
        note="Radii, conics, object and image distance, thickness and index, uniform; 127 rays from each of three "
        "object points. Nominal spots must agree to 1e-6; means over trials within four standard errors.",
    )


def spots_agree(ours: Arrays, theirs: Arrays) -> Sequence[Check]:
    """Nominal spots, and the means over trials within what their number allows."""
    error = np.hypot(ours["sd"] / np.sqrt(ours["trials"]), theirs["sd"] / np.sqrt(theirs["trials"]))
    with np.errstate(divide="ignore", invalid="ignore"):
        away = np.abs(ours["mean"] - theirs["mean"]) / error
    return (
        *relative({"nominal": 1e-6}, ours, theirs),
        Check("mean over trials [standard errors]", float(np.nan_to_num(away, nan=0.0).max()), 4.0),
    )


def optimise() -> Case:
    """Object, stop and array distance for a magnification of 0.4, sharp and telecentric."""

    def inputs() -> Mapping[str, Any]:
        return {"f": 100.0, "height": 28.0, "magnification": 0.4, "start": [300.0, 80.0, 160.0], "D_F": 2.9}

    return Case(
        "optimise",
        "Small optimisation: sharp, telecentric, magnification 0.4",
        "solutions",
        1,
        (
            Side("here, one start", "here", "optimise", 1),
            Side("here, 16 starts and a second solver", "here", "optimise", 1, {"thorough": True}),
            Side("Optiland", "optiland", "optimise", 1),
        ),
        inputs,
        partial(relative, {"d_f": 1e-5, "d_3": 1e-5, "d_1": 1e-5}),
        note="f = 100 mm is given; d_f = 350, d_3 = 100 and d_1 = 140 mm is the solution. Optiland: least squares on "
        "three thicknesses, from the same start. Here focus is built in, so two lengths are sought under constraints, "
        "and the answer comes with multipliers and checks.",
    )


def geometry() -> Case:
    """Twelve cameras: d_f 250, 350, 600 and d_3 0, 20, 60, 120."""
    cameras = [(d_f, d_3) for d_f in (250.0, 350.0, 600.0) for d_3 in (0.0, 20.0, 60.0, 120.0)]

    def inputs() -> Mapping[str, Any]:
        d_f, d_3 = np.array(cameras).T
        fixed = {"f": 100.0, "d": 0.063, "d_2": 2.0, "q": 0.004847826}
        return {"d_f": d_f, "d_3": d_3, **{name: np.full(len(cameras), value) for name, value in fixed.items()}}

    return Case(
        "geometry",
        "Geometry of a plenoptic camera: refocus distance, baseline, entrance pupil",
        "cameras",
        len(cameras),
        (Side("here", "here", "geometry", 1), Side("PlenoptiSign", "plenoptisign", "geometry", 1)),
        inputs,
        partial(relative, {"refocus": 1e-11, "baseline": 1e-11, "entrance_pupil": 1e-11}),
        note="12 cameras, one after the other: d_f 250, 350, 600 mm, d_3 0, 20, 60, 120 mm. PlenoptiSign is told the "
        "exit pupil, d_1 - f d_3/(d_3 - f) from the array, and finds the entrance pupil from it.",
    )


def white_image(layout: str, fill: float, shape: tuple[int, int]) -> tuple[Arrays, Any]:
    """A white image by exact coverage with 1 % noise, and the lattice it was made from."""
    from roslf_design.calibration.lattice import CentreLattice
    from roslf_design.microlens.coverage import coverage_image

    pitch, rotation, (rows, columns) = 14.07, math.radians(0.31), shape
    turned = rotation + (math.pi / 2 if layout == "square" else math.pi / 3)
    first = (pitch * math.cos(rotation), pitch * math.sin(rotation))
    second = (pitch * math.cos(turned), pitch * math.sin(turned))
    truth = CentreLattice((columns / 2 + 0.83, rows / 2 - 0.41), first, second, layout)  # type: ignore[arg-type]
    index = truth.inside(shape, margin=-pitch)
    axes = truth.nodes(index[:, 0], index[:, 1]) - np.array([(columns - 1) / 2, (rows - 1) / 2])
    radii, discs = np.full((len(axes), 1), fill * pitch / 2), np.zeros((len(axes), 1, 2))
    image = coverage_image(axes, discs, radii, pixel=1.0, size=(columns, rows), dtype=np.float32)
    noise = np.random.default_rng(0).normal(0, 0.01, shape).astype(np.float32)
    return {"image": np.asarray(image + noise, np.float32)}, truth


def centre_errors(truth: Any, shape: tuple[int, int], answer: Arrays) -> dict[str, float]:
    """RMS error per axis of the centres found, and the share of lenses that have none; a pitch off the border."""
    found = np.asarray(answer["centres"], float).reshape(-1, 2)
    room = 14.07
    far = np.array(shape[::-1]) - 1 - room
    found = found[np.all((found >= room) & (found <= far), axis=1)]
    expected = len(truth.inside(shape, margin=room))
    if not len(found):
        return {"RMS error [px]": math.inf, "lenses not found [%]": 100.0}
    at = np.asarray(truth.indices(found))
    index = np.round(at).astype(np.int64)
    away = found - truth.nodes(index[:, 0], index[:, 1])
    seen = len({(int(i), int(j)) for i, j in index})
    missing = 100 * max(0.0, 1 - seen / expected)
    return {"RMS error [px]": float(np.sqrt(np.mean(away**2))), "lenses not found [%]": missing}


def centres(layout: str, fill: float, shape: tuple[int, int], fast: bool) -> Case:
    """Microlens centres on a white image with known truth."""
    made: dict[str, Any] = {}

    def inputs() -> Mapping[str, Any]:
        arrays, made["truth"] = white_image(layout, fill, shape)
        return arrays

    def quality(answer: Arrays) -> Mapping[str, float]:
        return centre_errors(made["truth"], shape, answer)

    def judge(ours: Arrays, theirs: Arrays) -> Sequence[Check]:
        found = quality(theirs)
        return (
            Check("error [px]", found["RMS error [px]"], 0.5),
            Check("not found [%]", found["lenses not found [%]"], 10.0),
        )

    gap = "room between images" if fill < 0.9 else "images nearly touch"
    return Case(
        f"centres-{layout}-{fill:g}",
        f"Microlens centres, {layout}, images {fill:g} of the pitch ({gap}), {shape[1]} x {shape[0]} px",
        "images",
        1,
        (
            Side("here", "here", "centres", 1),
            Side("PlenoptiCam, peak", "plenopticam", "centres", 1, {"method": "peak"}),
            Side("PlenoptiCam, area", "plenopticam", "centres", 1, {"method": "area"}),
            Side("scipy, label and centre of mass", "numpy", "centres", 1),
        ),
        inputs,
        judge,
        quality,
        (
            Goal("PlenoptiCam, peak", 1.0, "faster, and more accurate, than PlenoptiCam by peaks"),
            Goal("PlenoptiCam, area", 1.0, "faster, and more accurate, than PlenoptiCam by areas"),
        ),
        note="Pitch 14.07 px, turned by 0.31 degrees, 1 % noise, exact coverage. PlenoptiCam: pitch, extraction, "
        "refinement, sorting and grid fit. One thread each.",
        fast=fast,
    )


def white_floor() -> Case:
    """A white image of the paper's camera against nothing but writing one."""
    return Case(
        "white-floor",
        "White image of 4600 x 3080 px with diffraction, against writing one",
        "images",
        1,
        (
            Side("here, 2 threads", "here", "white", 2),
            Side("writing alone, 2 threads", "numpy", "write", 2, {"shape": WHITE, "threads": 2}),
        ),
        None,
        lambda ours, theirs: (
            Check("pixels", float(np.abs(ours["shape"] - theirs["shape"]).sum()), 0.0),
            Check("bytes a pixel", float(abs(ours["dtype_bytes"] - theirs["dtype_bytes"])), 0.0),
        ),
        goals=(Goal("writing alone, 2 threads", 1 / 25, "within 25 times the pure write"),),
        note="Both make a new array of 32-bit numbers each time, as an image is made.",
    )


def first_answer(quick: bool) -> Case:
    """From the start of the process to the RMS spot of one field of a singlet."""
    words = ("{python}", "{sides}/first_answer.py")
    return Case(
        "first-answer",
        "From start of the process to the first answer: spot of a singlet",
        "runs",
        1,
        tuple(
            Side(label, program, threads=2, command=(*words, program))
            for label, program in (("here", "here"), ("Optiland", "optiland"), ("batoid", "batoid"))[
                : 2 if quick else 3
            ]
        ),
        None,
        partial(relative, {"rms": 1e-6}),
        goals=(Goal("Optiland", 8.0, "8 times as fast as Optiland from start to first answer"),),
        note="Whole processes; byte code and compiled kernels cached by a run that does not count.",
    )


def imports() -> Case:
    """Importing, as whole processes."""
    packages = (
        ("here", "here", "import roslf_design"),
        ("here, lens tracing", "here", "import roslf_design.lenses.trace"),
        ("Optiland", "optiland", "from optiland.optic import Optic"),
        ("batoid", "batoid", "import batoid"),
        ("PlenoptiSign", "plenoptisign", "import plenoptisign"),
        ("PlenoptiCam", "plenopticam", "import plenopticam.lfp_calibrator"),
        ("numpy alone", "here", "import numpy"),
        ("Python alone", "here", "pass"),
    )
    return Case(
        "import",
        "Start of Python and import",
        "runs",
        1,
        tuple(Side(label, program, command=("{python}", "-c", words)) for label, program, words in packages),
        fast=False,
        note="Here heavy imports happen where they are needed; the comparison that counts is the first answer above.",
    )
