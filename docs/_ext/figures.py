"""Figures of the theory pages, drawn by the library when the pages are built; the same bytes every time."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

import roslf_design as roslf
from roslf_design import theory
from roslf_design.pictures.axes import BLUE, GREY, ORANGE, VERMILLION, drawing, standalone, to_svg
from roslf_design.pictures.depth import depth_precision
from roslf_design.pictures.effects import effects_budget
from roslf_design.pictures.matching import matching_plane
from roslf_design.pictures.microlens import microlens_images
from roslf_design.pictures.picture import PAGE, Picture
from roslf_design.pictures.rays import ray_diagrams

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def _new(columns: int = 1, width: float = 8.0, height: float = 3.0) -> tuple[Figure, Any]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots(1, columns)


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


def aperture_constant() -> Figure:
    """H and 1/H over d_3, and the fill factor by Eqs. 7 and 8."""
    figure, (left, right) = _new(2)
    p = roslf.load("paper").parameters
    d_3 = np.linspace(0.0, 345.0, 400)
    left.plot(d_3, theory.aperture_constant(p.d_f, d_3), color=VERMILLION, label="H")
    left.plot(d_3, theory.inverse_aperture_constant(p.d_f, d_3), color=BLUE, label="1/H")
    left.axvline(float(p.d_f), color=GREY, linestyle="--", linewidth=0.8)
    left.annotate("d_f", (float(p.d_f), 9.2), xytext=(-14, 0), textcoords="offset points", color=GREY)
    left.set(xlabel="d_3 [mm]", ylabel="aperture constant", xlim=(0, 360), ylim=(0, 10), title="Eq. 3")
    d_3 = np.linspace(0.0, 240.0, 200)
    known = p.D_F, p.d, p.d_2, p.f, p.d_f
    right.plot(d_3, theory.fill_factor(*known, d_3), color=BLUE, label="Eq. 7, exact")
    right.plot(d_3, theory.approximate_fill_factor(*known, d_3), color=ORANGE, linestyle="--", label="Eq. 8")
    right.axhline(1.0, color=GREY, linewidth=0.8)
    right.plot(float(p.d_3), float(theory.fill_factor(*known, p.d_3)), "o", color=VERMILLION, label="the bench")
    right.set(xlabel="d_3 [mm]", ylabel="microlens-image diameter / pitch", xlim=(0, 240), title="Fill factor")
    for ax in (left, right):
        ax.grid(True)
        ax.legend(loc="upper left")
    return figure


def waves() -> Figure:
    """Microlens images along the diagonal of their cells, by rays and by waves."""
    from roslf_design.imaging.render import render

    design = roslf.load("paper")
    columns, rows = design.pixels
    region = (columns // 2 - 26, rows // 2 - 26, 52, 52)
    ways = ["-microlens_diffraction"], []
    figure, ax = _new()
    for off, colour, style, label in zip(ways, (ORANGE, BLUE), ("--", "-"), ("rays", "waves"), strict=True):
        along = np.diagonal(render(design, region=region, overrides=off).pixels)
        place = (np.arange(len(along)) - len(along) / 2) * np.sqrt(2)
        ax.step(place, along, color=colour, linestyle=style, where="post", label=label)
    ax.set(xlabel="distance along the diagonal [pixels]", ylabel="intensity", xlim=(-36, 36), ylim=(0, 1.28))
    ax.grid(True)
    ax.legend(loc="upper right", ncols=2)
    return figure


def epi() -> Figure:
    """Eq. 12 over depth."""
    figure, (left, right) = _new(2)
    p = roslf.load("paper").parameters
    gap = float(p.d_f) - float(p.d_3)
    depth = np.linspace(0.4 * gap, 2.5 * gap, 300)
    left.plot(depth, theory.epi_slope(depth, p.d, p.q, p.d_2, p.f, p.d_f, p.d_3), color=BLUE)
    left.axvline(gap, color=GREY, linestyle="--", linewidth=0.8)
    left.axhline(0, color=GREY, linewidth=0.8)
    left.set(xlabel="depth from the FAP Z_F [mm]", ylabel="slope [microlenses per pixel]", title="Eq. 12")
    near = gap * (1 + np.logspace(-15, -1, 57))
    stable = theory.epi_slope(near, p.d, p.q, p.d_2, p.f, p.d_f, p.d_3)
    a, m = theory.effective_image_distance(p.f, p.d_f, p.d_3), theory.magnification(p.f, p.d_f)
    printed = p.q * a / (p.d * p.d_2) * (m - a / near)
    exact = p.q * a / (p.d * p.d_2) * m * ((near - gap) / near)
    tiny = 1e-17
    for value, colour, label in ((printed, ORANGE, "as printed"), (stable, BLUE, "as computed here")):
        error = np.maximum(np.abs(value / exact - 1), tiny)
        right.loglog(near / gap - 1, error, ".-", color=colour, linewidth=0.8, markersize=4, label=label)
    right.set(xlabel="distance from the focal plane, Z_F/g - 1", ylabel="relative error", ylim=(1e-17, 10))
    right.set_title("The bracket near the focal plane")
    right.legend(loc="upper right")
    for ax in (left, right):
        ax.grid(True)
    return figure


def _svg(name: str, draw: Callable[[], Figure | Picture]) -> Callable[[], str]:
    def made() -> str:
        with drawing():
            figure = draw()
            if isinstance(figure, Picture):
                return figure.svg_file().decode()
            return standalone(to_svg(figure, name)).decode()

    return made


FIGURES: dict[str, Callable[[], str]] = {
    name: _svg(name, draw)
    for name, draw in (
        ("rays", rays),
        ("matching", matching),
        ("depth", depth),
        ("budget", budget),
        ("cats-eyes", cats_eyes),
        ("aperture-constant", aperture_constant),
        ("waves", waves),
        ("epi", epi),
    )
}
"""Files of `_generated`, each by what draws it."""
