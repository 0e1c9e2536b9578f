"""Full circle: render the paper's camera, calibrate it blind, compare.

Run: python studies/calibration-circle/full_circle.py
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
from captures import CELL, CELLS, KINDS, make
from pictures import draw_images, draw_intervals, draw_shifts

import roslf_design as roslf
from roslf_design.calibration.frames import CalibrationError
from roslf_design.calibration.model import QUANTITIES, UNITS, Observations
from roslf_design.calibration.result import Outcome
from roslf_design.camera import Camera
from roslf_design.design import Design, load
from roslf_design.design.files import write_atomically
from roslf_design.drawing.axes import drawing, to_png

BOARD = f"{CELLS[0]}x{CELLS[1]} {CELL:g} mm"
PAPER_RMS = 0.06
"""Reprojection error that the paper reports [px of a view, so pitches]."""


def truth_of(design: Design) -> dict[str, float]:
    """The lengths that the images were rendered with."""
    A = float(Camera.of(design).seen.A)
    lengths = {"H": design.d_1 / A, "d_3": design.d_3, "d_1": design.d_1, "d_f": design.d_f, "d_2": design.d_2}
    return {**lengths, "A": A, "m": design.d_1 / design.d_f}


def facts_of(result: Outcome, truth: dict[str, float]) -> dict[str, Any]:
    """What came out of one kind of captures beside the truth."""
    data = result.to_dict()
    rows: dict[str, Any] = {}
    for name in QUANTITIES:
        e = result.estimates[name]
        shares = result.shares[name]
        rows[name] = {
            "truth": truth[name],
            "estimate": e.value,
            "unit": UNITS[name],
            "sigma": e.sigma,
            "sigma_without_f": e.sigma * math.sqrt(max(1 - shares["f"], 0.0)),
            "interval_95": list(e.interval_95),
            "holds": bool(e.interval_95[0] <= truth[name] <= e.interval_95[1]),
        }
    return {
        "quantities": rows,
        "reprojection_rms_pitches": result.calibration.joint.rms,
        "images_used": len(result.calibration.observations.names),
        "views": len(result.calibration.observations.views),
        "converged": result.converged,
        "diffraction": data["diffraction"],
        "white_image": data["white_image"],
    }


def measured_shifts(rays: Observations, waves: Observations, shifts: Any) -> tuple[Any, Any, Any]:
    """Views, displacement of corners by diffraction as measured (waves minus rays), and as computed."""
    known = {tuple(view): k for k, view in enumerate(rays.views)}
    both = [(k, known[tuple(view)]) for k, view in enumerate(waves.views) if tuple(view) in known]
    mine, theirs = (np.array(indices) for indices in zip(*both, strict=True))
    boards = [rays.names.index(name) for name in waves.names]
    measured = waves.uv[:, mine] + shifts[:, mine] - rays.uv[boards][:, theirs]
    return waves.views[mine], measured, shifts[:, mine]


def table(facts: dict[str, Any]) -> str:
    """The outcome as a table in Markdown."""
    lines = [
        "| | truth | by rays | with diffraction, taken off | diffraction left in |",
        "|---|---|---|---|---|",
    ]
    left = facts["waves"]["diffraction"]["without"]
    for name in QUANTITIES:
        cells = []
        for kind in KINDS:
            row = facts[kind]["quantities"][name]
            low, high = row["interval_95"]
            mark = "" if row["holds"] else " **outside**"
            cells.append(f"{row['estimate']:.5g} ({low:.5g} to {high:.5g}){mark}")
        true = facts["rays"]["quantities"][name]["truth"]
        unit = f" [{UNITS[name]}]" if UNITS[name] else ""
        uncorrected = f"{left[name]:.5g} ({100 * (left[name] / true - 1):+.2g} %)"
        lines.append(f"| {name}{unit} | {true:.5g} | {cells[0]} | {cells[1]} | {uncorrected} |")
    errors = [f"{facts[kind]['reprojection_rms_pitches']:.4f}" for kind in KINDS]
    lines.append(f"| reprojection RMS [pitches] | at most {PAPER_RMS} | {errors[0]} | {errors[1]} | |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Render what is missing, calibrate, draw, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("reports/calibration-circle"))
    parser.add_argument("--captures", type=Path, default=Path("out/calibration-circle"), help="folder of the images")
    parser.add_argument("--boards", type=int, default=12)
    options = parser.parse_args()
    paper = load("paper")
    truth = truth_of(paper)
    for written in make(paper, options.captures, options.boards):
        print(f"rendered {written}", flush=True)
    facts: dict[str, Any] = {"pixels": list(paper.pixels), "board": BOARD, "boards": options.boards}
    results: dict[str, Outcome] = {}
    for kind in KINDS:
        try:
            results[kind] = roslf.calibrate(options.captures / kind, "paper", BOARD, distortion=0)
        except CalibrationError as error:
            sys.exit(f"{kind}: {error}")
        facts[kind] = facts_of(results[kind], truth)
    waves = results["waves"].diffraction
    assert waves is not None
    assert waves.shifts is not None
    # The result's corners are those with the shifts taken off.
    views, measured, computed = measured_shifts(
        results["rays"].calibration.observations, results["waves"].calibration.observations, waves.shifts
    )
    off = measured - computed
    facts["shifts"] = {
        "rms_measured_pitches": float(np.sqrt(np.nanmean(measured**2))),
        "rms_left_pitches": float(np.sqrt(np.nanmean(off**2))),
        "largest_measured_pitches": float(np.nanmax(np.abs(measured))),
    }
    said = table(facts)
    print(said)
    with drawing():
        files = {
            "intervals.png": to_png(draw_intervals(facts)),
            "shifts.png": to_png(draw_shifts(views, measured, computed, results["waves"].calibration.lines.slope)),
            "images.png": to_png(draw_images(options.captures, results)),
        }
    files["facts.json"] = (json.dumps(facts, indent=1, allow_nan=False) + "\n").encode()
    files["table.md"] = said.encode()
    options.output.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        write_atomically(options.output / name, content)


if __name__ == "__main__":
    main()
