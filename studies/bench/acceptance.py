"""Does `roslf bench report` tell the truth? Rendered captures of builds that are known, and of benches with faults.

    python -m studies.bench.acceptance --builds 10 -o reports/bench

Every figure is compared with that of the build it was measured on: within its expanded uncertainty (k = 2) it should
lie in 95 of 100. A wrong target, a camera refocused between white and board and an overexposed picture are to be
named.
"""

from __future__ import annotations

import argparse
import json
import math
import re
import resource
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy.stats import binom

from roslf_design.bench.captures import CALIBRATION, read_bench
from roslf_design.bench.check import checked
from roslf_design.bench.protocol import Protocol
from roslf_design.calibration.model import Board
from roslf_design.calibration.options import PlanOptions
from roslf_design.camera import Camera
from roslf_design.cli import main as roslf
from roslf_design.design import Design, load
from roslf_design.evaluation.resolved import resolved
from roslf_design.evaluation.stations import ASKED
from roslf_design.reporting.blocks import Paragraph, Report, Section
from roslf_design.reporting.printers import page_files
from roslf_design.tables import Table
from roslf_design.theory.quantities import QUANTITIES
from roslf_design.traced.fields import IdealImages
from studies.bench.made import (
    BLACK,
    BY_RAYS,
    FULL,
    GAIN,
    LEVEL,
    PRNU,
    READ,
    VEIL,
    Bench,
    Build,
    board_picture,
    edge_picture,
    rings_picture,
    wall_picture,
)


def presets() -> dict[str, Design]:
    """Designs with fewer and larger pixels: pictures take seconds."""
    paper, scope = load("paper"), load("rigid-scope")
    coarse = {"name": "Paper's camera at a third"} | _pixels(2 * paper.sensor.pixel, (640, 540), 0.5)
    lengths = {name: getattr(paper, name) / 3 for name in ("f", "d_1", "d_3", "D", "D_F")}
    wide = _pixels(1.5 * scope.sensor.pixel, (692, 520), 0.05)
    longer = {"name": "Rigid scope, longer focus"} | wide
    return {
        "scope": scope.replace({"name": "Rigid scope"} | wide),
        "paper-third": paper.replace(coarse, **lengths),
        "scope-long": scope.replace(longer, d_3=1.0, D_F=0.28),
    }


def _pixels(pixel: float, count: tuple[int, int], more: float) -> dict[str, Any]:
    """Changes to so many pixels, and an array that is larger by `more` [mm]."""
    size = count[0] * pixel, count[1] * pixel
    array = size[0] + more, size[1] + more
    return {"sensor.pixel": pixel, "sensor.size": size, "microlens_array.size": array}


@dataclass(frozen=True)
class Compared:
    """One figure beside the truth."""

    bench: str
    name: str
    value: float
    expanded: float
    truth: float

    @property
    def off(self) -> float:
        """Error over the expanded uncertainty: 1 at most in 95 of 100."""
        return (self.value - self.truth) / self.expanded


BOARDS = 8
"""Images of the board of each build."""
STOOD = "stood.json"
"""Where targets stood; written once all captures of a build are."""


def filled(folder: Path, nominal: Design, seed: int) -> Bench:
    """A bench folder with all captures of one build; of one preset all builds have the same targets and poses."""
    setup = Protocol.of(nominal, PlanOptions.of(board=None, boards=BOARDS)).setup
    bench = Bench(folder, setup, Build.drawn(nominal, seed))
    if (folder / STOOD).is_file():
        bench.stood = json.loads((folder / STOOD).read_text(encoding="utf-8"))
        return bench
    shutil.rmtree(folder, ignore_errors=True)
    bench.begun(nominal).even()
    for at in setup.edge.at:
        bench.taken(f"edge_{at:g}mm.tif", *edge_picture(setup))
    for at in setup.field.at:
        bench.taken(f"field_{at:g}mm.tif", *rings_picture(setup))
    for at in setup.wall.at[:2]:
        bench.taken(f"wall_{at:g}mm.tif", *wall_picture(setup))
    for at in setup.spheres.at:
        bench.spheres(f"spheres_{at:g}mm.tif", at)
    for _ in bench.boards():
        pass
    for printed in folder.glob("printed-*.png"):
        printed.unlink()
    (folder / STOOD).write_text(json.dumps(bench.stood), encoding="utf-8")
    return bench


def reported(folder: Path) -> dict[str, Any]:
    """The JSON object of `roslf bench report`."""
    roslf(["bench", "report", str(folder), "--placed", "0.1 %", "--no-stamp"])
    data: dict[str, Any] = json.loads((folder / "acceptance.json").read_text(encoding="utf-8"))
    return data


def compared(bench: Bench, data: dict[str, Any]) -> Iterator[Compared]:
    """Figures whose truth is known."""
    design = bench.build.design
    camera = Camera.of(design)
    sharp = Camera.of(design.replace({"light.wavelength": BY_RAYS}))
    truths = {
        "width": float(QUANTITIES["field_of_view_width_deg"](camera)),
        "height": float(QUANTITIES["field_of_view_height_deg"](camera)),
        "diagonal": float(QUANTITIES["field_of_view_deg"](camera)),
        "entrance pupil behind the tip": bench.tip - design.d_3,
        "H": float(QUANTITIES["aperture_constant"](camera)),
        "d_3": design.d_3, "D_F": design.D_F, "veil": 100 * VEIL * LEVEL * FULL / (FULL - BLACK),
        "gain": GAIN, "read noise": READ, "PRNU": 100 * PRNU,
    }  # fmt: skip
    for line in data["lines"]:
        name, value, expanded = line["name"], line["value"], line["expanded"]
        if line["claimed"] is not None:
            expanded = line["claimed"]
        if name in truths:
            yield Compared(bench.folder.name, name, value, expanded, truths[name])
        elif name.startswith("MTF"):
            kind: Literal["view", "refocused"] = "view" if "a view" in name else "refocused"
            at = bench.stood[f"edge_{name.split()[-2]}mm.tif"]
            row = resolved(IdealImages(sharp, [(0.0, 0.0)]), 0, (ASKED, at), kind)
            truth = row.mtf50_lp_per_mm if "50" in name else row.mtf10_lp_per_mm
            if truth is not None:
                yield Compared(bench.folder.name, name, value, expanded, truth)
        elif name.startswith("error of depth"):
            file = f"wall_{name.split()[-2]}mm.tif"
            stood = next(at for one, at in bench.stood.items() if one == file)
            asked = float(name.split()[-2])
            yield Compared(bench.folder.name, name, asked + value, expanded, stood)
        elif name.startswith(("sphere-spacing error", "probing error, size")):
            yield Compared(bench.folder.name, name, value, expanded, 0.0)


def faults(folder: Path, bench: Bench) -> dict[str, tuple[str, ...]]:
    """Faults that a check names in a bench with a wrong target, a refocused image, and one overexposed."""
    setup, build = bench.setup, bench.build
    told = {}

    def named(file: str) -> tuple[str, ...]:
        check = checked(read_bench(folder))
        return next(one.faults for one in check.images if one.name == file)

    def again(file: str, design: Design, picture: np.ndarray, width: float, times: float = 1.0) -> tuple[str, ...]:
        path = folder / CALIBRATION / file
        before = path.read_bytes()
        pose = next(pose for pose in setup.poses if pose.file == file)
        other = Bench(folder, setup, Build(design, build.seed + 1))
        scene = other.plane(picture, width, pose.ahead, (pose.rotation[0], pose.rotation[1]))
        other.gains = bench.gains
        other.save(f"{CALIBRATION}/{file}", other.exposed(other.rendered(scene), times))
        found = named(file)
        path.write_bytes(before)
        return found

    board = setup.board.board
    across = math.hypot(board.columns + 2, board.rows + 2) * board.cell
    wrong = Board(board.columns + 2, board.rows + 1, 0.8 * board.cell)
    first, second, third = (pose.file for pose in setup.poses[2:5])
    told["wrong target"] = again(first, build.design, board_picture(wrong, 0.1), 1.1 * across)
    moved = build.design.replace({}, d_1=build.design.d_1 * 1.03)
    told["refocused"] = again(second, moved, board_picture(board, 0.1), across)
    told["overexposed"] = again(third, build.design, board_picture(board, 0.1), across, 2.0)
    return told


def by_figure(rows: list[Compared]) -> Iterator[tuple[str, int, int, float, float]]:
    """Of each figure: how many, how many within U, rms of errors over U, and how often chance would miss as many.

    Chance is that of errors whose U holds 95 of 100.
    """
    names = dict.fromkeys(_figure(row.name) for row in rows)
    for name in names:
        off = np.array([row.off for row in rows if _figure(row.name) == name])
        out = int((np.abs(off) > 1).sum())
        yield name, off.size, off.size - out, float(np.sqrt(np.mean(off**2))), float(binom.sf(out - 1, off.size, 0.05))


def _figure(name: str) -> str:
    """Figure's name without its distance."""
    return re.sub(r"( at|,) [\d.]+ mm$", "", name)


def main() -> None:
    """Render, report, compare, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--builds", type=int, default=1, help="builds of each preset")
    parser.add_argument("--presets", nargs="*", default=list(presets()), choices=list(presets()))
    parser.add_argument("-o", "--output", type=Path, default=Path("reports/bench"))
    parser.add_argument(
        "--work",
        type=Path,
        default=Path("out/bench-study"),
        help="folder for the captures; builds measured there are not again",
    )
    parser.add_argument("--there", action="store_true", help="tell of the builds that are measured, and measure none")
    asked = parser.parse_args()
    rows: list[Compared] = []
    spoilt = asked.work / "faults.json"
    named: dict[str, tuple[str, ...]] = json.loads(spoilt.read_text(encoding="utf-8")) if spoilt.is_file() else {}
    for seed in range(1, asked.builds + 1):
        for preset in asked.presets:
            folder = asked.work / f"{preset}-{seed}"
            measured = folder / "acceptance.json"
            if asked.there and not measured.is_file():
                continue
            bench = filled(folder, presets()[preset], seed)
            data = json.loads(measured.read_text(encoding="utf-8")) if measured.is_file() else reported(folder)
            mine = list(compared(bench, data))
            if not named:
                named = faults(folder, bench)
                spoilt.write_text(json.dumps(named, indent=1), encoding="utf-8")
            rows += mine
            held = sum(abs(row.off) <= 1 for row in mine)
            print(f"{folder.name}: {held} of {len(mine)} within U, {_used():.0f} s so far", flush=True)
    inside = sum(abs(row.off) <= 1 for row in rows)
    cells = [
        (row.bench, row.name, f"{row.value:.5g}", f"± {row.expanded:.2g}", f"{row.truth:.5g}", f"{row.off:+.2f}")
        for row in rows
    ]
    figures = [
        (name, str(of), str(within), f"{rms:.2f}", f"{chance:.2g}") for name, of, within, rms, chance in by_figure(rows)
    ]
    words = f"{inside} of {len(rows)} figures lie within their expanded uncertainty of what the build has."
    command = f"python -m studies.bench.acceptance --builds {asked.builds} --presets {' '.join(asked.presets)}"
    builds, keys = sorted({row.bench for row in rows}), ("figure", "of", "inside", "rms", "chance")
    sound = {
        build: json.loads((asked.work / build / "acceptance.json").read_text(encoding="utf-8"))["faults"]
        for build in builds
    }
    blamed = [f"{build}: {fault}" for build, faults in sound.items() for fault in faults]
    blocks = (
        Paragraph(f"{words} Builds {', '.join(builds)}, of those of {command}."),
        Table(
            (
                *((name, "; ".join(told) or "not named") for name, told in named.items()),
                (f"sound captures of {len(builds)} builds", "; ".join(blamed) or "none blamed"),
            ),
            "ll",
            title="Faults",
        ),
        Table(tuple(figures), "lrrrr", ("figure", "of", "within U", "rms of error over U", "by chance"), "By figure"),
        Table(tuple(cells), "lldlll", ("bench", "figure", "measured", "U", "truth", "error over U"), "Figures"),
    )
    page = Report("Acceptance on rendered captures", words, (Section("Figures", blocks),))
    asked.output.mkdir(parents=True, exist_ok=True)
    data = {
        "schema": "roslf.acceptance-study/1",
        "command": command,
        "builds": builds,
        "inside": inside,
        "figures": len(rows),
        "by_figure": [dict(zip(keys, one, strict=True)) for one in by_figure(rows)],
        "rows": [vars(row) | {"off": row.off} for row in rows],
        "faults": {name: list(told) for name, told in named.items()},
        "sound_blamed": blamed,
    }
    (asked.output / "acceptance.json").write_text(json.dumps(data, indent=1), encoding="utf-8")
    for name, content in page_files(page).items():
        (asked.output / name).parent.mkdir(exist_ok=True)
        (asked.output / name).write_bytes(content)
    print(f"{words} {_used():.0f} s of processor time")


def _used() -> float:
    """Processor time so far [s]."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    main()
