"""Figures of the theory pages, drawn by the library when the pages are built; the same bytes every time."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.imaging.render import render
from roslf_design.pictures.axes import BLUE, GREY, ORANGE, VERMILLION, drawing, standalone, to_svg
from roslf_design.pictures.depth import depth_precision
from roslf_design.pictures.effects import effects_budget
from roslf_design.pictures.matching import matching_plane
from roslf_design.pictures.microlens import microlens_images
from roslf_design.pictures.picture import PAGE, Picture
from roslf_design.pictures.rays import ray_diagrams
from roslf_design.theory.f_number import approximate_fill_factor, fill_factor
from roslf_design.theory.light_field import epi_slope

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
    bench = Camera.of(roslf.load("paper"))
    many = bench.replace({"d_3": np.linspace(0.0, 345.0, 400)})
    left.plot(many.d_3, many.H, color=VERMILLION, label="H")
    left.plot(many.d_3, many.inverse_H, color=BLUE, label="1/H")
    left.axvline(float(bench.d_f), color=GREY, linestyle="--", linewidth=0.8)
    left.annotate("d_f", (float(bench.d_f), 9.2), xytext=(-14, 0), textcoords="offset points", color=GREY)
    left.set(xlabel="d_3 [mm]", ylabel="aperture constant", xlim=(0, 360), ylim=(0, 10), title="Eq. 3")
    many = bench.replace({"d_3": np.linspace(0.0, 240.0, 200)})
    right.plot(many.d_3, fill_factor(many), color=BLUE, label="Eq. 7, exact")
    right.plot(many.d_3, approximate_fill_factor(many), color=ORANGE, linestyle="--", label="Eq. 8")
    right.axhline(1.0, color=GREY, linewidth=0.8)
    right.plot(float(bench.d_3), float(fill_factor(bench)), "o", color=VERMILLION, label="the bench")
    right.set(xlabel="d_3 [mm]", ylabel="microlens-image diameter / pitch", xlim=(0, 240), title="Fill factor")
    for ax in (left, right):
        ax.grid(True)
        ax.legend(loc="upper left")
    return figure


def waves() -> Figure:
    """Microlens images along the diagonal of their cells, by rays and by waves."""
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
    bench = Camera.of(roslf.load("paper"))
    gap = float(bench.gap)
    depth = np.linspace(0.4 * gap, 2.5 * gap, 300)
    left.plot(depth, epi_slope(bench, depth), color=BLUE)
    left.axvline(gap, color=GREY, linestyle="--", linewidth=0.8)
    left.axhline(0, color=GREY, linewidth=0.8)
    left.set(xlabel="depth from the FAP Z_F [mm]", ylabel="slope [microlenses per pixel]", title="Eq. 12")
    near = gap * (1 + np.logspace(-15, -1, 57))
    stable = epi_slope(bench, near)
    before = bench.q * bench.A / (bench.d * bench.d_2)
    printed = before * (bench.m - bench.A / near)
    exact = before * bench.m * ((near - gap) / near)
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
