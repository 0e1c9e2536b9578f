"""The paper's experiments as rendered pictures. Run from the project's root: python studies/paper-images/make.py."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from roslf_design.camera import Camera
from roslf_design.design import Design, load
from roslf_design.imaging.render import render
from roslf_design.imaging.trace import RaySampling
from roslf_design.reporting.design.microlens import rays_and_waves
from roslf_design.scenes import Plane, Scene
from roslf_design.theory.exit_pupil import centre_shift_per_microlens, microlens_image_pitch
from roslf_design.theory.light_field import epi_slope

Floats = NDArray[np.float64]

OUT = Path("reports/paper-images")
BLUE, VERMILLION, GREEN, BLACK = "#0072B2", "#D55E00", "#009E73", "#000000"
NO_WAVES = ["-microlens_diffraction", "-fap_diffraction", "-microlens_defocus"]


def microlens_images(paper: Design) -> Figure:
    """Matched, mismatched and beyond the non-distortion field, by rays and with diffraction."""
    cases = (
        ("matched, d$_3$ = 120 mm", paper),
        ("mismatched, d$_3$ = 20 mm", paper.replace(d_3=20.0)),
        ("beyond the field, D = 30 mm", paper.replace(D=30.0)),
    )
    figure = Figure(figsize=(9.5, 6.6), layout="constrained")
    panels = figure.subplots(2, 3, sharex=True, sharey=True)
    region = (4540, 1510, 60, 60)
    for column, (title, design) in enumerate(cases):
        for row, (name, overrides) in enumerate((("rays", NO_WAVES), ("diffraction", []))):
            image = render(design, overrides=overrides, region=region).pixels
            axes = panels[row, column]
            shown = axes.imshow(image, extent=(4540, 4600, 1510, 1570), origin="lower", cmap="gray", vmin=0, vmax=1.05)
            axes.set_title(f"{title}\n{name}", fontsize=10)
            axes.set_xticks([4540, 4560, 4580])  # a fourth would run into the next panel's first
            if row:
                axes.set_xlabel("column [px]")
            if not column:
                axes.set_ylabel("row [px]")
    figure.colorbar(shown, ax=panels, label="relative intensity", shrink=0.7)
    return figure


def pitch_px(design: Design) -> float:
    """Distance between neighbouring microlens images [px]."""
    return abs(float(microlens_image_pitch(Camera.of(design)))) / design.q


def centres(design: Design) -> tuple[NDArray[np.int64], Floats]:
    """Indices of microlenses along x and the centres of their images [px from the sensor's middle], from an image."""
    width, height = design.pixels
    pitch = pitch_px(design)
    rows = round(pitch)
    image = render(design, region=(0, height // 2 - rows // 2, width, rows)).pixels.sum(0).astype(float)
    place_of: dict[int, float] = {}
    for direction in (1, -1):
        index, at = 0, width / 2
        while pitch < at < width - pitch:
            for _ in range(3):
                at = _centroid(image, at, pitch / 2)
            place_of[index] = at - width / 2
            index, at = index + direction, at + direction * pitch
    indices = np.array(sorted(place_of))
    return indices, np.array([place_of[index] for index in indices])


def _centroid(profile: Floats, centre: float, half: float) -> float:
    """Centroid of what stands out of the gaps on either side, in a window whose ends may cut pixels."""
    cell = np.arange(profile.size)
    weight = np.clip(np.minimum(cell + 1, centre + half) - np.maximum(cell, centre - half), 0, 1)
    lit = weight > 0
    light = weight[lit] * (profile[lit] - profile[lit].min())
    return float((light * (cell[lit] + 0.5)).sum() / light.sum())


def centre_deviation(paper: Design) -> tuple[Figure, dict[str, float]]:
    """The paper's Fig. 5: centre deviation against the traditional light field is a line through zero, Eq. 4."""
    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    axes = figure.subplots()
    facts: dict[str, float] = {}
    index, plain = centres(paper.replace(d_3=0.0))
    for d_3, colour in ((120.0, BLUE), (20.0, VERMILLION)):
        design = paper.replace(d_3=d_3)
        other, at = centres(design)
        common = np.intersect1d(index, other)
        deviation = plain[np.isin(index, common)] - at[np.isin(other, common)]
        slope, offset = np.polyfit(common, deviation, 1)
        left = deviation - (slope * common + offset)
        squared = 1 - (left**2).sum() / ((deviation - deviation.mean()) ** 2).sum()
        theory = float(centre_shift_per_microlens(Camera.of(design)))
        axes.plot(common, deviation, ".", ms=3, color=colour, label=f"rendered, d$_3$ = {d_3:g} mm")
        label = f"Eq. 4: {theory:.5f} px each; fitted {slope:.5f}, R$^2$ = {squared:.6f}"
        axes.plot(common, theory * common, color=BLACK, lw=0.8, label=label)
        facts |= {f"slope_{d_3:g}": slope, f"theory_{d_3:g}": theory, f"offset_px_{d_3:g}": offset}
        facts |= {f"r_squared_{d_3:g}": squared, f"rms_px_{d_3:g}": math.sqrt(float((left**2).mean()))}
    axes.axhline(0, color="0.8", lw=0.8, zorder=0)
    axes.set(xlabel="microlens index along x", ylabel="centre deviation [px]")
    axes.legend(fontsize=8)
    return figure, facts


def epi_slopes(paper: Design) -> tuple[Figure, dict[str, float]]:
    """The paper's Fig. 1: lines of the same two bars in the epipolar image, with and without the restricted space."""
    figure = Figure(figsize=(9.5, 5.0), layout="constrained")
    panels = figure.subplots(1, 2)
    facts: dict[str, float] = {}
    bars = ((300.0, -3.0, BLUE), (450.0, 3.0, VERMILLION))
    for axes, (name, design) in zip(
        panels, (("through the FAP at 120 mm", paper), ("pupil at the lens", paper.replace(d_3=0.0))), strict=True
    ):
        views = np.arange(-4, 5) if design.d_3 else np.arange(-3, 4)
        lines = []
        for distance, x, colour in bars:
            bar = Plane(distance=distance, centre=(x, 0.0), size=(0.4, 200.0))
            scene = Scene(objects=(bar,))
            image = epi(design, scene, views, [])
            slope, middle = _line(image, views)
            sharp, exact = _line(epi(design, scene, views, NO_WAVES), views)
            theory = float(epi_slope(Camera.of(design), distance - design.d_3))
            place = f"{design.d_3:g}_{distance:g}"
            facts |= {f"waves_{place}": slope, f"rays_{place}": sharp, f"theory_{place}": theory}
            lines.append(image)
            label = f"Z = {distance:g} mm, Eq. 12: {theory:.3f}; rays {sharp:.3f}"
            axes.plot(exact, views, "o", ms=4, color=colour, label=label)
            axes.plot(middle, views, "--", lw=1.5, color=colour, label=f"with diffraction {slope:.3f}")
        top = sum(lines)
        half = image.shape[1] / 2
        extent = (-half, half, views[0] - 0.5, views[-1] + 0.5)
        axes.imshow(top, extent=extent, origin="lower", cmap="gray", aspect="auto")
        axes.set(title=name, xlabel="microlens index u", ylabel="view s' [px]", xlim=(-32, 32))
        axes.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.16))
    return figure, facts


def _line(image: Floats, views: NDArray[np.int64]) -> tuple[float, Floats]:
    """Slope of an epipolar image's one line, and its middle in each view [microlenses]."""
    lens = np.arange(image.shape[1]) - image.shape[1] // 2
    middle = (image * lens).sum(1) / image.sum(1)
    return float(np.polyfit(views, middle, 1)[0]), middle


def epi(design: Design, scene: Scene, views: NDArray[np.int64], overrides: list[str]) -> Floats:
    """Brightness against view (rows) and microlens index (columns), read off a rendered row of microlenses."""
    width, height = design.pixels
    pitch, count = pitch_px(design), 60
    side = round((2 * count + 3) * pitch)
    left = width // 2 - side // 2
    region = (left, height // 2 - 3, side, 6)
    image = render(design, scene, region=region, overrides=overrides, sampling=RaySampling(256, 256, 0.0)).pixels
    profile = image.mean(0)
    at = width / 2 - left + np.arange(-count, count + 1) * pitch - 0.5
    return np.array([np.interp(at + view, np.arange(side), profile) for view in views])


def main() -> int:
    """Write figures and facts."""
    paper = load("paper")
    OUT.mkdir(parents=True, exist_ok=True)
    figures: dict[str, Figure] = {"microlens-images": microlens_images(paper)}
    facts: dict[str, Any] = {}
    figures["centre-deviation"], facts["centre_deviation"] = centre_deviation(paper)
    figures["epi-slopes"], facts["epi_slopes"] = epi_slopes(paper)
    (OUT / "rays-and-waves.png").write_bytes(rays_and_waves(paper, 912).to_png(110))
    for name, figure in figures.items():
        figure.savefig(OUT / f"{name}.png", dpi=110, metadata={"Software": "roslf"})
    rounded = {
        topic: {name: float(f"{value:.6g}") for name, value in values.items()} for topic, values in facts.items()
    }
    (OUT / "facts.json").write_text(json.dumps(rounded, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
