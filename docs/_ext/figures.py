"""Figures of the theory pages, drawn by the library when the pages are built; the same bytes every time."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.drawing.marks import Dots, Line, Mark, Point, Text, dot_key, line_key, stairs
from roslf_design.drawing.panel import Panel, Scale
from roslf_design.drawing.picture import PAGE, Picture, beside, one_panel
from roslf_design.imaging.render import render
from roslf_design.reporting.design.curves import depth_precision, matching_plane
from roslf_design.reporting.design.effects import effects_budget
from roslf_design.reporting.design.microlens import microlens_images
from roslf_design.reporting.design.rays import ray_diagrams
from roslf_design.theory.f_number import fill_factor, microlens_f_number, pupil_f_number
from roslf_design.theory.light_field import epi_slope
from studies.instruments.gallery import ratios, written

HALF = PAGE / 2, 290.0
"""Size of one of two pictures beside each other [px]."""


def rays() -> Picture:
    """The paper's bench."""
    return ray_diagrams(roslf.load("paper"))


def matching() -> Picture:
    """D_F over d_3."""
    return matching_plane(roslf.load("paper"), (PAGE, 400))


def depth() -> Picture:
    """sigma_Z over Z."""
    return depth_precision(roslf.load("paper"), (PAGE, 330))


def budget() -> Picture:
    """Sizes of effects."""
    return effects_budget(roslf.evaluate(roslf.load("paper")).effects, (PAGE, 0))


def cats_eyes() -> Picture:
    """From a full disc to a cat's eye."""
    design = roslf.load("paper").replace(D=16.0)
    return microlens_images({name: (design, (x, 0.0)) for name, x in (("whole", 0.0), ("cut", 5.0), ("thin", 6.2))})[0]


def _curves(
    size: Point, across: Scale, up: Scale, curves: Iterable[tuple[str, str, str, ArrayLike, ArrayLike]],
    labels: tuple[str, str, str], *more: Mark,
) -> Picture:  # fmt: skip
    """Named curves, each with its colour and dashes; labels of the axes, and a title."""
    lines = list(curves)
    marks = (*more, *(Line(x, y, colour, 1.8, dash) for _, colour, dash, x, y in lines))
    keys = [line_key(name, colour, 1.8, dash) for name, colour, dash, *_ in lines if name]
    name = labels[2].lower().replace(" ", "-")
    return one_panel(name, labels[2], size, Panel((0, 0, 1, 1), across, up, marks, *labels), keys, top=28)


def aperture_constant() -> Picture:
    """H and 1/H over d_3, and the image fill by Eqs. 7 and 8."""
    bench = Camera.of(roslf.load("paper"))
    many, d_f = bench.replace({"d_3": np.linspace(0.0, 345.0, 400)}), float(bench.d_f)
    curves = [("H", "vermillion", "", many.d_3, many.H), ("1/H", "blue", "", many.d_3, many.inverse_H)]
    focus = Line([d_f, d_f], [0.0, 10.0], "grey", 1.0, "6 3"), Text(d_f, 9.2, "d_f", "grey", anchor="end", dx=-5)
    labels = "d_3 [mm]", "aperture constant", "Eq. 3"
    left = _curves(HALF, Scale(0, 360), Scale(0, 10), curves, labels, *focus)
    many = bench.replace({"d_3": np.linspace(0.0, 240.0, 200)})
    exact, approximate = fill_factor(many), microlens_f_number(many) / pupil_f_number(many)
    curves = [("Eq. 7, exact", "blue", "", many.d_3, exact), ("Eq. 8", "orange", "7 4", many.d_3, approximate)]
    here = Dots([float(bench.d_3)], [float(fill_factor(bench))], "vermillion")
    one = Line([0.0, 240.0], [1.0, 1.0], "grey", 1.0)
    labels = "d_3 [mm]", "microlens-image diameter / pitch", "Image fill"
    right = _curves(HALF, Scale(0, 240), Scale.around([exact, approximate], 0.05), curves, labels, one, here)
    right = replace(right, keys=(*right.keys, dot_key("the bench", "vermillion")))
    return beside("aperture-constant", "Aperture constant and image fill over d_3", [left, right])


def waves() -> Picture:
    """Microlens images along the diagonal of their cells, by rays and by waves."""
    design = roslf.load("paper")
    columns, rows = design.pixels
    region = (columns // 2 - 26, rows // 2 - 26, 52, 52)
    curves = []
    for off, colour, dash, name in ((["-microlens_diffraction"], "orange", "6 3", "rays"), ([], "blue", "", "waves")):
        along = np.diagonal(render(design, region=region, overrides=off).pixels)
        curves.append((name, colour, dash, *stairs((np.arange(53) - 26) * np.sqrt(2), along)))
    labels = "distance along the diagonal [pixels]", "intensity", "By rays and by waves"
    return _curves((PAGE, 290.0), Scale(-36, 36), Scale(0, 1.28), curves, labels)


def epi() -> Picture:
    """Eq. 12 over depth."""
    bench = Camera.of(roslf.load("paper"))
    gap = float(bench.gap)
    depth = np.linspace(0.4 * gap, 2.5 * gap, 300)
    slope = epi_slope(bench, depth)
    across, up = Scale(float(depth[0]), float(depth[-1])), Scale.around(slope, 0.05)
    axes = Line([gap, gap], up[:2], "grey", 1.0, "6 3"), Line(across[:2], [0.0, 0.0], "grey", 1.0)
    labels = "depth from the FAP Z_F [mm]", "slope [microlenses per pixel]", "Eq. 12"
    left = _curves(HALF, across, up, [("", "blue", "", depth, slope)], labels, *axes)
    near = gap * (1 + np.logspace(-15, -1, 57))
    before = bench.q * bench.A / (bench.d * bench.d_2)
    exact = before * bench.m * ((near - gap) / near)
    ways = (
        ("as printed", "orange", before * (bench.m - bench.A / near)),
        ("as computed here", "blue", epi_slope(bench, near)),
    )
    curves = [
        (name, hue, "", near / gap - 1, np.maximum(np.abs(value / exact - 1), 1e-17)) for name, hue, value in ways
    ]
    labels = "distance from the focal plane, Z_F/g - 1", "relative error", "The bracket near the focal plane"
    right = _curves(HALF, Scale(5e-16, 0.2, log=True), Scale(1e-17, 10, log=True), curves, labels)
    return beside("epi", "Slopes of epipolar lines over depth", [left, right])


def instruments() -> Picture:
    """The gallery's ratios, as its study wrote them."""
    return ratios(written())


FIGURES: dict[str, Callable[[], Picture]] = {
    "rays": rays,
    "matching": matching,
    "depth": depth,
    "budget": budget,
    "cats-eyes": cats_eyes,
    "aperture-constant": aperture_constant,
    "waves": waves,
    "epi": epi,
    "instruments": instruments,
}
"""Files of `_generated`, each by what draws it."""
