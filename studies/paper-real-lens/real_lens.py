"""The paper's bench behind real lenses, and whether their aberrations explain distorted images at its field's edge.

Run from the project's root: python studies/paper-real-lens/real_lens.py [-o FOLDER]
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from roslf_design.design import Design, load
from roslf_design.drawing.axes import draw, drawing
from roslf_design.drawing.panel import Panel, Scale
from roslf_design.drawing.theme import THEMES
from roslf_design.evaluation import default_fields, evaluate
from roslf_design.evaluation.result import Evaluation
from roslf_design.lenses.manufacture import as_made, lens_values
from roslf_design.reporting.design.field import _lens_curves, _lens_image, _LensCurves
from roslf_design.traced.camera import camera_of, microlenses
from roslf_design.traced.images import real_images

Floats = NDArray[np.float64]

OUT = Path("reports/paper-real-lens")
SEEN_EDGE = 11.15
"""Microlens at the middle of the sensor's right edge [mm]."""
LENSES = {
    "LA1050-A, curved side to the scene": ("LA1050-A", False),
    "LA1050-A, plane side to the scene": ("LA1050-A", True),
    "LB1630-A, bi-convex": ("LB1630-A", False),
    "AC508-100-A, crown to the scene": ("AC508-100-A", False),
    "AC508-100-A, flint to the scene": ("AC508-100-A", True),
}
"""50.8 mm lenses of 100 mm; the bi-convex one is the same both ways round."""
COLOURS = ("#D55E00", "#E69F00", "#0072B2", "#CC79A7", "#009E73")
DASHES: tuple[Any, ...] = ("-", (0, (6, 2)), "-", (0, (6, 2)), (0, (2, 1)))


def designs() -> dict[str, Design]:
    """The bench with each lens: d_f and d_3 as the paper has them, the array where the lens then focuses."""
    paper = load("paper-singlet")
    return {
        label: paper.replace({"main_lens.prescription": name, "main_lens.reversed": turned})
        for label, (name, turned) in LENSES.items()
    }


def beyond_linear(curves: _LensCurves) -> float:
    """What is left of the shift when a linear fit of the centres over the sensor's half width is taken off [px].

    A decoder calibrates image centres with an affine lattice, so that is what it would not see coming.
    """
    inside = (curves.x <= SEEN_EDGE) & np.isfinite(curves.shift_px)
    x, shift = curves.x[inside], curves.shift_px[inside]
    scale = float(x @ shift / (x @ x))
    return float(np.max(np.abs(shift - scale * x)))


def facts(design: Design, curves: _LensCurves, result: Evaluation) -> dict[str, Any]:
    """One lens in numbers."""
    assert result.real_lens is not None
    edge = result.real_lens.fields[1]
    corner = result.real_lens.fields[2]
    pitch = result.microlens_image.pitch_mm / design.q
    diameter = None if edge.diameter_mm is None else edge.diameter_mm / design.q
    return {
        "focal_length_mm": design.f,
        "undistorted_to_mm": result.real_lens.x_ml_max_mm,
        "eq6_mm": result.real_lens.thin_x_ml_max_mm,
        "edge": {
            "status": edge.status,
            "kept_fraction": edge.kept_fraction,
            "shift_px": None if edge.shift_px is None else edge.shift_px[0],
            "shift_beyond_linear_px": beyond_linear(curves),
            "widening_percent": edge.widening_percent if edge.status != "folded" else None,
            "axis_ratio": edge.axis_ratio,
            "overlap_px": None if diameter is None or edge.status == "folded" else diameter - pitch,
            "tangential_focus_pitches": edge.tangential_focus_pitches,
            "sagittal_focus_pitches": edge.sagittal_focus_pitches,
            "distortion_percent": edge.distortion_percent,
            "lateral_colour_pitches": edge.lateral_colour_pitches,
        },
        "corner": {"status": corner.status, "kept_fraction": corner.kept_fraction},
    }


MADE = {
    "surfaces.1.radius": 1.0,
    "surfaces.1.thickness": 0.2,
    "surfaces.1.index": 1e-3,
    "elements.1.decentre.0": 0.5,
    "elements.1.tilt.1": 0.01,
}
"""Generous errors of a catalogue lens and a hand-adjusted mount: 1 % of a radius, 0.2 mm, 0.5 mm, 10 mrad."""


def made(design: Design) -> dict[str, dict[str, float]]:
    """What each of them does to images at the left and right edge [px], and how much it grows them [%]."""
    camera, c = camera_of(design), microlenses(design, [(-SEEN_EDGE, 0.0), (SEEN_EDGE, 0.0)])
    nominal, drawn = real_images(camera, c), lens_values(camera.lens, design.wavelength)
    facts = {}
    for place, miss in MADE.items():
        lens = as_made(camera.lens, {place: drawn[place] + miss}, design.wavelength)
        images = real_images(replace(camera, lens=lens), c)
        shift, growth = images.chief - nominal.chief, images.diameter / nominal.diameter - 1
        facts[place] = {
            "shift_left_px": float(shift[0, 0]) / design.q,
            "shift_right_px": float(shift[1, 0]) / design.q,
            "growth_left_percent": 100 * float(growth[0]),
            "growth_right_percent": 100 * float(growth[1]),
        }
    return facts


def field_figure(curves: dict[str, _LensCurves]) -> Figure:
    """Shift, growth, foci and distortion along x, every lens beside the thin one."""
    with drawing():
        figure = Figure(figsize=(9.6, 6.4), layout="constrained")
        panels = figure.subplots(2, 2, sharex=True)
        what: tuple[tuple[Callable[[_LensCurves], Floats], str, str], ...] = (
            (lambda c: c.shift_px, "shift of image centres [px]", "microlens images move"),
            (lambda c: 100 * (c.diameter_px / c.thin_diameter_px - 1), "growth of diameters [%]", "and grow"),
            (lambda c: c.tangential, "tangential blur on the array [pitches]", "the focal surface bends"),
            (lambda c: c.distortion, "distortion of the object [%]", "the object is distorted"),
        )
        for ax, (pick, label, title) in zip(panels.flat, what, strict=True):
            ax.axhline(0, color="#6b6b6b", linewidth=1.0, linestyle=(0, (5, 3)), label="thin lens (paper)")
            ax.axvline(SEEN_EDGE, color="#6b6b6b", linewidth=0.8, label="sensor's edge")
            for (name, one), colour, dash in zip(curves.items(), COLOURS, DASHES, strict=True):
                ax.plot(one.x, pick(one), color=colour, linestyle=dash, label=name)
                if np.any(one.folded):
                    last = int(np.argmax(one.folded))
                    value = pick(one)
                    if np.isfinite(value[last - 1]):
                        ax.plot(one.x[last - 1], value[last - 1], "x", color=colour, markersize=7)
            ax.set(ylabel=label, title=title)
        for ax in panels[1]:
            ax.set_xlabel("microlens from the axis, out to the sensor's corner [mm]")
        panels[0, 0].plot([], [], "x", color="#1a1a1a", markersize=7, label="folded from there on")
        panels[0, 0].set_ylim(-16, 1.5)
        panels[0, 1].set_ylim(-5, 60)
        panels[1, 0].set_ylim(-25, 4)
        panels[1, 1].set_ylim(-23, 1)
        figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def image_figure(cases: dict[str, Design]) -> Figure:
    """Microlens images at centre, edge and corner, each beside its thin-lens model."""
    with drawing():
        figure = Figure(figsize=(9.6, 6.3), layout=ConstrainedLayoutEngine(rect=(0, 0, 1, 0.98)))
        panels = figure.subplots(3, len(cases), sharex=True, sharey=True)
        for column, (label, design) in enumerate(cases.items()):
            for row, place in enumerate(default_fields(design)):
                ax = panels[row, column]
                marks, words = _lens_image(design, place)
                draw(Panel((0, 0, 1, 1), Scale(-26, 12), Scale(-19, 19), marks, equal=True), ax, THEMES["light"])
                ax.set_title(words, fontsize=8, fontweight="normal")
                if row == 0:
                    ax.annotate(label.replace(", ", "\n"), (0, 1.16), xycoords="axes fraction", fontweight="bold")
                if column == 0:
                    where = ("centre", "edge, x = 11.17 mm", "corner, 13.4 mm out")[row]
                    ax.set_ylabel(f"{where}\ny [px]")
                if row == 2:
                    ax.set_xlabel("x [px]")
        colour = THEMES["light"].colour
        keys = [
            Line2D([], [], color=colour("grey"), linestyle="--", label="thin-lens model"),
            Line2D([], [], color=colour("blue"), label="real lens"),
        ]
        figure.legend(handles=keys, loc="outside lower center", ncols=2)
    return figure


def main() -> None:
    """Trace every lens, write the numbers and the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=OUT, help="folder for the results")
    out = parser.parse_args().output
    out.mkdir(parents=True, exist_ok=True)
    cases = designs()
    curves = {label: _lens_curves(design) for label, design in cases.items()}
    facts_of = {label: facts(design, curves[label], evaluate(design)) for label, design in cases.items()}
    bent = made(cases["LB1630-A, bi-convex"])
    (out / "as-made.json").write_text(json.dumps(bent, indent=1, allow_nan=False) + "\n")
    (out / "facts.json").write_text(json.dumps(facts_of, indent=1, allow_nan=False) + "\n")
    for name, figure in (("field", field_figure(curves)), ("images", image_figure(cases))):
        with drawing():
            figure.savefig(out / f"{name}.png", dpi=130, metadata={"Software": None})
    for label, one in facts_of.items():
        edge = one["edge"]
        moved = "-" if edge["shift_px"] is None else f"{edge['shift_px']:+.2f} px"
        wide = "-" if edge["widening_percent"] is None else f"{edge['widening_percent']:+.1f} %"
        print(f"{label:36s} undistorted to {one['undistorted_to_mm']:6.2f} mm; edge {edge['status']}, {moved}, {wide}")
    for place, one in bent.items():
        moved = f"{one['shift_left_px']:+.2f} and {one['shift_right_px']:+.2f} px"
        grown = f"{one['growth_left_percent']:+.2f} and {one['growth_right_percent']:+.2f} %"
        print(f"LB1630-A missed at {place:22s} by {MADE[place]:g}: images at the edges move {moved}, grow {grown}")
    print(f"Figures and facts.json in {out}")


if __name__ == "__main__":
    main()
