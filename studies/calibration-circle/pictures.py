"""Pictures of the full circle."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from captures import FULL_SCALE
from matplotlib.figure import Figure

from roslf_design.calibration.decoding import decode
from roslf_design.calibration.frames import read_image
from roslf_design.calibration.model import QUANTITIES
from roslf_design.calibration.result import Outcome
from roslf_design.drawing.axes import BLUE, GREY, INK, ORANGE, VERMILLION

WAYS = ("by rays", "diffraction taken off", "diffraction left in")


def draw_intervals(facts: dict[str, Any]) -> Figure:
    """Errors of every length with their 95 % intervals, thick without the share of f."""
    figure = Figure(figsize=(9.2, 4.4), layout="constrained")
    panels = figure.subplots(2, 4, sharey=True).ravel()
    for ax, name in zip(panels, QUANTITIES, strict=False):
        true = facts["rays"]["quantities"][name]["truth"]
        for y, kind in enumerate(("rays", "waves")):
            row = facts[kind]["quantities"][name]
            error = 100 * (row["estimate"] / true - 1)
            low, high = (100 * (end / true - 1) for end in row["interval_95"])
            near = 196 * row["sigma_without_f"] / true
            colour = (BLUE, VERMILLION)[y]
            ax.plot([low, high], [y, y], color=colour, linewidth=1.2)
            ax.plot([error - near, error + near], [y, y], color=colour, linewidth=4, alpha=0.6, solid_capstyle="butt")
            ax.plot(error, y, "o", color=colour, markersize=5)
        left = 100 * (facts["waves"]["diffraction"]["without"][name] / true - 1)
        ax.plot(left, 2, "D", color=ORANGE, markersize=5)
        ax.axvline(0, color=INK, linewidth=0.8)
        reach = 1.15 * max(np.abs(ax.get_xlim()).max(), 0.05)
        ax.set(xlim=(-reach, reach), ylim=(2.6, -0.6))
        ax.set_yticks(range(3), WAYS)
        ax.set_title("$" + (name.replace("_", "_{") + "}" if "_" in name else name) + "$")
        ax.locator_params(axis="x", nbins=5)
    for ax in panels[3:7]:
        ax.set_xlabel("error [%]")
    panels[-1].set_axis_off()
    panels[-1].text(
        0.0, 0.95, "thin: 95 % interval\nthick: without the\nshare of f (known to 1 %)\nline at 0: the truth",
        va="top", fontsize=9, transform=panels[-1].transAxes,
    )  # fmt: skip
    return figure


def draw_shifts(views: Any, measured: Any, computed: Any, slopes: Any) -> Figure:
    """Displacement of corners by diffraction: along a row of views for three boards, and all against the computed."""
    figure = Figure(figsize=(9.2, 3.9), layout="constrained")
    rows, cloud = figure.subplots(1, 2, width_ratios=(1.35, 1))
    mean = np.nanmean(slopes, axis=1)
    chosen = [int(np.argmin(mean)), int(np.argmin(np.abs(mean))), int(np.argmax(mean))]
    middle = np.flatnonzero(views[:, 1] == 0)
    middle = middle[np.argsort(views[middle, 0])]
    marks = zip(
        chosen,
        (BLUE, GREY, VERMILLION),
        ("nearest board", "board at the focal plane", "farthest board"),
        "o^s",
        strict=True,
    )
    for board, colour, words, mark in marks:
        s = views[middle, 0]
        rows.plot(s, np.nanmean(measured[board, middle, :, 0], axis=-1), mark, color=colour, markersize=5)
        rows.plot(s, np.nanmean(computed[board, middle, :, 0], axis=-1), color=colour, linewidth=1, label=words)
    rows.plot([], [], "o", color=INK, markersize=5, label="measured: waves minus rays")
    rows.plot([], [], color=INK, linewidth=1, label="computed from the white image")
    rows.axhline(0, color=GREY, linewidth=0.6)
    rows.set(xlabel="view s' [px]", ylabel="displacement of corners in u [pitches]")
    rows.legend(fontsize=8, loc="best")
    flat_x, flat_y = computed.ravel(), measured.ravel()
    step = max(1, flat_x.size // 6000)
    cloud.plot(flat_x[::step], flat_y[::step], ".", color=BLUE, markersize=2, alpha=0.4)
    reach = 1.05 * float(np.nanmax(np.abs(flat_y)))
    cloud.plot([-reach, reach], [-reach, reach], color=VERMILLION, linewidth=1)
    cloud.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
    cloud.set(xlabel="computed [pitches]", ylabel="measured [pitches]")
    cloud.set_title("every corner in every view", fontsize=9)
    return figure


def draw_images(captures: Path, results: dict[str, Outcome]) -> Figure:
    """A few raw microlens images and two views of one board, by rays and by waves."""
    figure = Figure(figsize=(9.2, 5.0), layout="constrained")
    panels = figure.subplots(2, 3, width_ratios=(1, 1.25, 1.25))
    kinds = {"rays": "by rays", "waves": "with diffraction"}
    for row, (kind, words) in enumerate(kinds.items()):
        folder = captures / kind
        white, raw = (read_image(folder / f"{name}.tif") for name in ("white", "board01"))
        lattice = results[kind].centres.lattice
        i, j = np.round(lattice.indices([raw.shape[1] / 2, raw.shape[0] / 2])).astype(int)
        x, y = (int(value) for value in lattice.nodes(i, j))
        reach = int(3 * lattice.pitch)
        panels[row, 0].imshow(
            white[y - reach : y + reach, x - reach : x + reach], cmap="gray", vmin=0, origin="lower",
            extent=(-reach, reach, -reach, reach),
        )  # fmt: skip
        panels[row, 0].set(ylabel="[px]", xlabel="[px]" if row else "", title=f"white image, {words}")
        field = decode(raw, lattice, white=white)
        for column, s in ((1, 0.0), (2, 5.0)):
            panels[row, column].imshow(
                field.view(s, 0.0), cmap="gray", vmin=0, vmax=FULL_SCALE, origin="lower",
                extent=(field.u[0], field.u[-1], field.v[0], field.v[-1]), interpolation="nearest",
            )  # fmt: skip
            panels[row, column].set(title=f"view s' = {s:g} px, {words}", xlim=(-110, 110), ylim=(-90, 90))
            panels[row, column].set(xlabel="u [pitches]" if row else "")
        panels[row, 1].set_ylabel("v [pitches]")
    return figure
