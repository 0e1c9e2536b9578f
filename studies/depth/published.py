"""Depth errors predicted beside those of real pictures, and of captures whose noise is not as believed.

Run from the project's root: python studies/depth/published.py [-o FOLDER] [--data FOLDER]. What is measured on real
pictures, a white frame among them, is left out, and said so, where these do not lie beside the project. What is
predicted for them stands in the table of their instrument (studies/instruments), which is told the numbers that are
measured here.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tifffile

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.depth.measure import simulate
from roslf_design.depth.pictures import PictureOptions
from roslf_design.design import load
from roslf_design.drawing.marks import Dots, Line, Mark, dot_key, line_key
from roslf_design.drawing.panel import Panel, Scale
from roslf_design.drawing.picture import Picture, one_panel
from roslf_design.effects.waves import add_noise
from roslf_design.imaging.files import write_image
from roslf_design.imaging.render import render
from roslf_design.json_data import plain
from roslf_design.reporting.blocks import (
    Block,
    Code,
    Figure,
    Paragraph,
    Report,
    Section,
    Statement,
    Statements,
    Table,
)
from roslf_design.reporting.printers import render_html
from roslf_design.scenes import Noise, Plane, Scene
from roslf_design.theory.photometry import dark_variance
from studies.depth.view_mismatch import (
    ALL,
    GAMMA,
    SETS,
    HeldOut,
    Level,
    LytroViews,
    Repeated,
    Scatter,
    WhiteFrame,
    flat_board,
    held_out,
    left_between,
    quantile,
    repeated,
    white_frame,
)
from studies.instruments.entries import HERE as INSTRUMENTS
from studies.instruments.entries import NAMED, PICTURES, SUFFIX, VESICLE, WITHOUT, Instrument, Pictures
from studies.instruments.expressions import disparity_error

DATA = Path("../shared/data")
LYTRO = Instrument.read(INSTRUMENTS / f"lytro-f01{SUFFIX}")
"""Camera that took the real light fields."""
TIMES = (0.7, 1.0, 1.3, 1.6, 2.0)
"""Noise of a capture against that believed."""
WALL, REGION, SEED, RAYS = 345.0, (2160, 1400, 280, 280), 1, 256
"""Distance of the wall [mm] that it is taken of, what part of the paper's sensor, its noise, rays a pixel."""
EDGE = 4
"""Microlenses at the sides of a capture that are not judged: they have no neighbours."""


@dataclass(frozen=True, eq=False)
class Real:
    """What was measured on real pictures."""

    white: WhiteFrame
    levels: list[Level]
    held: list[HeldOut]
    sets: list[Repeated]
    board: Scatter
    disparity: float
    """Of the scene before the Lytro, on average [pitches across the pupil]."""
    errors: dict[str, tuple[float, ...]] = field(default_factory=dict)
    """What the rows call `measured`."""

    @classmethod
    def of(cls, data: Path) -> Real:
        """Everything, from the folder that holds `lytro-views`, `lytro-checkerboard` and `guv`."""
        views, linear = (LytroViews.of(data / "lytro-views", gamma) for gamma in (1.0, GAMMA))
        board = flat_board(data / "lytro-checkerboard")
        right = slice(views.field.values.shape[-1] // 2, None)
        errors = {"lytro error" + words: _of_all(views, columns) for words, columns in (("", ALL), (", right", right))}
        errors["board"] = (float(np.sqrt(np.mean(board.error**2))),)
        errors |= {name: (value,) for name, value in zip(VESICLE, microlens_images(data / "guv"), strict=True)}
        seen = views.map_of(views.field)
        return cls(
            white_frame(data / "guv"), left_between(views), held_out(views, linear, board), list(repeated(views)),
            board, float(abs(np.median(seen.disparity[seen.measured]))), errors,
        )  # fmt: skip

    @property
    def bound(self) -> float:
        """Error of the Lytro's disparities [pitches] that noise alone would leave."""
        assert LYTRO.design is not None
        exact = LYTRO.design.replace({"depth.view_mismatch": 0.0})
        return disparity_error(Camera.of(exact), self.disparity)

    @property
    def pictures(self) -> Pictures:
        """What the table of the camera is told."""
        values = self.disparity, self.held[0].share, float(np.sqrt(np.mean(self.board.unit**2)))
        return Pictures(self.errors, dict(zip(NAMED, values, strict=True)))

    def to_dict(self) -> dict[str, Any]:
        """As JSON."""
        return {
            "white_frame": self.white._asdict(),
            "levels": [level._asdict() for level in self.levels],
            "bound": self.bound,
            "held_out": [each._asdict() for each in self.held],
            "repeated": [each.to_dict() for each in self.sets],
            "measured": self.errors,
            "named": self.pictures.named,
        }


def microlens_images(folder: Path) -> tuple[float, float, float]:
    """Width over pitch, blur [px] and veil [% of full scale] of the microscope's white frame, decoded by its design."""
    raw, white, dark = (folder / f"{name}_GUVExperim1.tif" for name in ("Lightfield", "Radiometry", "DarkFrame"))
    told = roslf.decode(raw, white, dark=str(dark), design=str(INSTRUMENTS / "lfm-guv.toml")).to_dict()
    found = told["white"]
    return found["image_width_px"] / told["lattice"]["pitch_px"], found["blur_px"], 100 * found["veil"]


def _of_all(views: LytroViews, columns: slice) -> tuple[float, ...]:
    """Error of all views together, by two halves and by quarters of them.

    Those of a half stand beside each other, and share what was interpolated; quarters stand further apart.
    """
    half, *quarters = (quantile(Scatter.of(views, SETS[each], columns).error) / 2 for each in (0, 2, 3))
    return half, float(np.sqrt(np.mean(np.square(quarters)) / 2))


# --- noise that is not as believed ------------------------------------------------------------------------------------


class Unlike(NamedTuple):
    """A capture read with other noise than it has."""

    times: float
    """Noise that it has, against that believed."""
    known: float
    found: float
    """Times as believed, as `roslf depth` says."""
    error: float
    """Within which 68 % of the depths lie of the wall's distance [mm]."""
    reported: float
    """Standard error reported with them, median [mm]."""
    inside: float
    """Share of depths within their own."""


def unlike_believed() -> Iterator[Unlike]:
    """One raw capture of a wall as a sensor of 12 bits stores it, with the sensor taken for better and worse ones."""
    paper = load("paper")
    finest = 2.5 * float(roslf.quantity("object_sample_mm")(Camera.of(paper)))
    texture = Noise(finest=finest, contrast=paper.depth.contrast, seed=1)
    wall = Scene(name="wall", objects=(Plane(distance=WALL, texture=texture),))
    trial = simulate(paper, wall, PictureOptions(region=REGION, seed=SEED, rays=RAYS))
    raw = trial.raw
    white = render(paper, None, effects=raw.plan, region=raw.region)
    sensor = paper.sensor
    charge = trial.electrons * float(white.pixels.sum() / raw.pixels.sum())
    dark = math.sqrt(float(dark_variance(Camera.of(paper))))
    taken = add_noise(raw.pixels, charge, dark, np.random.default_rng(SEED)) * charge / sensor.full_well
    with tempfile.TemporaryDirectory() as folder:
        counts, flat = Path(folder) / "counts.tif", Path(folder) / "white.tif"
        most = 2**sensor.bits - 1
        tifffile.imwrite(counts, np.clip(np.rint(taken * most), 0, most).astype(np.uint16))
        write_image(white, flat)
        for times in TIMES:
            better = {"sensor.full_well": sensor.full_well * times**2, "sensor.read_noise": sensor.read_noise * times}
            file = Path(folder) / "believed.toml"
            roslf.save(paper.replace(better), file, overwrite=True)
            found = roslf.capture_depth(counts, white=flat, design=str(file), region=tuple(raw.region))
            inner = slice(EDGE, -EDGE), slice(EDGE, -EDGE)
            known = found.first.measured[inner]
            off, told = found.first.depth[inner][known] - WALL, found.first.sigma[inner][known]
            yield Unlike(
                times, float(known.mean()), found.noise.times, quantile(off), float(np.median(told)),
                float(np.mean(np.abs(off) < told)),
            )  # fmt: skip


# --- the page ---------------------------------------------------------------------------------------------------------


def reported_and_found(sets: list[Repeated], bins: int = 12) -> Picture:
    """Draw by how much two sets of views differ, over the errors reported, in bins of equally many pixels."""
    looks = (("blue", "o"), ("sky", "s"), ("vermillion", "o"), ("orange", "s"), ("green", "o"), ("grey", "s"))
    marks: list[Mark] = []
    ends = []
    for one, (colour, shape) in zip(sets, looks, strict=True):
        order = np.array_split(np.argsort(one.reported), bins)
        reported = np.array([np.median(one.reported[part]) for part in order])
        found = np.array([quantile(one.difference[part]) for part in order])
        marks.append(Dots(reported, found, colour, shape, 4))
        ends += [reported, found]
    scale = Scale(float(np.min(ends)) / 1.3, float(np.max(ends)) * 1.3, log=True)
    line = Line([scale.low, scale.high], [scale.low, scale.high], "ink", 1.2)
    keys = [dot_key(one.words, *look) for one, look in zip(sets, looks, strict=True)]
    keys.append(line_key("as reported", "ink", 1.2))
    labels = "standard error reported [pitches over the pupil]", "error of one set [pitches]"
    panel = Panel((0, 0, 1, 1), scale, scale, (line, *marks), *labels)
    return one_panel(
        "repeats", "Repeatability of two sets of views over errors reported", (540.0, 470.0), panel, keys, left=70
    )


def _percent(share: float, digits: int = 2) -> str:
    return f"{100 * share:.{digits}g} %"


def mismatch_tables(real: Real) -> Iterator[Block]:
    """What views differ by, and what a mismatch fitted on one part says of another."""
    white = real.white
    yield Paragraph(
        "A raw white frame of a light-field microscope, dark frame taken off, nothing else done to it: what is seen at "
        f"the same place behind neighbouring microlenses differs by {_percent(white.lenses)} rms from microlens to "
        f"microlens ({_percent(white.typical)} without the few dirty ones) and by {_percent(white.pixels)} from pixel "
        "to pixel, shot noise included. Dividing by the white frame takes the first off."
    )
    levels = real.levels[:-1]
    first, last, whole = levels[0], levels[-1], real.levels[-1]
    grown = last.even / first.even
    yield Table(
        tuple((f"{one.brightness:.2f}", *(_percent(value) for value in one[1:])) for one in levels),
        "rrrr", ("brightness", "even parts", "steepest parts", "all"),
        "What is left between the inner 6 x 6 views of a Lytro, rms, against the median brightness",
        f"All together {_percent(whole.all)}. In even parts it grows {grown:.2f} times as brightness grows "
        f"{last.brightness / first.brightness:.1f} times: neither a share of the brightness nor shot noise of linear "
        f"pictures ({math.sqrt(last.brightness / first.brightness):.1f} times), but about as shot noise in pictures "
        "with a gamma. It grows with the picture's slope: mismatch lies there.",
    )  # fmt: skip
    yield Table(
        tuple((one[0], _percent(one.share), one[2], f"{one.ratio:.2f}", _percent(one.inside)) for one in real.held),
        "lrlrr", ("fitted on", "mismatch", "predicts", "predicted over measured", "within"),
        "Mismatch fitted on one part of the light field predicts another",
        "Fitted to the disparities of two sets of views, for each window's own texture; 68 % lie within errors that "
        "are right. The mismatch that explains disparities is larger than what is left between views, as interpolated "
        "views share it with their neighbours. Halves of every other column share what was interpolated between them: "
        "they differ by less than predicted. Of brightness made linear texture and mismatch both grow, and the halves "
        "predict each other worse.",
    )  # fmt: skip


def repeated_table(sets: list[Repeated]) -> Table:
    """Sets of views against each other."""
    cells = []
    for one in sets:
        data = one.to_dict()
        cells.append((
            one.words, f"{one.views}", _percent(one.known), *(f"{data[key]:.3f}" for key in ("reported", "error")),
            *(f"{data[key]:.2f}" for key in ("ratio", "rms_ratio")), _percent(float(data["inside"])),
            _percent(float(data["beyond_5"])),
        ))  # fmt: skip
    heads = (
        "sets",
        "views each",
        "known to both",
        "reported",
        "found",
        "found over reported",
        "rms",
        "within",
        "beyond 5",
    )
    note = (
        "Errors of one set, in pitches over the whole pupil: reported, median; found, 68 % of the differences over "
        "sqrt(2). Found over reported likewise, and by rms, where outliers count. 68 % are within where errors are "
        "right, none beyond five."
    )
    return Table(tuple(cells), "lrrrrrrrr", heads, "Disparities of disjoint sets of views of one light field", note)


def noise_table(all_noise: list[Unlike]) -> Table:
    """Captures read with other noise than they have."""
    cells = tuple(
        (
            f"{one.times:g}", _percent(one.known, 3), f"{one.found:.2f}", f"{one.error:.3f}", f"{one.reported:.3f}",
            _percent(one.inside),
        )
        for one in all_noise
    )  # fmt: skip
    heads = ("noise, times as believed", "known", "said to be", "error [mm]", "reported [mm]", "within")
    note = f"One exposure of a wall at {WALL:g} mm before the paper's bench, {EDGE} microlenses at each side left out."
    return Table(cells, "rrrrrr", heads, "A capture whose noise is not as believed", note)


def statements(real: Real | None, all_noise: list[Unlike]) -> Iterator[Statement]:
    """What it comes to."""
    if real is not None:
        rows = {row.measured: row for row in LYTRO.rows(real.pictures)}
        row, other = rows["lytro error"], rows["board"]
        bound = row._replace(predicted=real.bound)
        yield Statement(
            "caution",
            "Is the default of 2 % of mismatch right? For raw captures it is on the safe side of a white frame "
            f"({_percent(math.hypot(real.white.lenses, real.white.pixels))}, shot noise included). Views of 8 bits "
            f"that were interpolated err as if it were {_percent(real.held[0].share)}: the default predicts "
            f"{row.ratio:.2f} of their error, the bound alone {bound.ratio:.2f}. What is fitted on one half predicts "
            f"the other to {abs(1 - real.held[0].ratio):.0%}, and {other.ratio:.2f} of the errors in another light "
            "field.",
            "Measure the mismatch of the camera at hand (roslf depth says what is left between views), and set "
            "depth.view_mismatch.",
        )
        ratios_of = [float(one.to_dict()["rms_ratio"]) for one in real.sets]
        yield Statement(
            "good" if max(ratios_of) <= 1.3 else "caution",
            f"Do real depths repeat as reported? Disjoint sets of views differ by {min(ratios_of):.2f} to "
            f"{max(ratios_of):.2f} times the errors reported, rms.",
        )
    least = min(one.known for one in all_noise)
    inside = [one.inside for one in all_noise]
    yield Statement(
        "good" if least > 0.9 else "caution",
        f"Does wrong noise spoil a capture? Read with noise {TIMES[0]:g} to {TIMES[-1]:g} times as believed "
        f"{_percent(least, 3)} of the wall stay known at least, {_percent(min(inside))} to {_percent(max(inside))} "
        "within the errors reported.",
    )


def report(real: Real | None, all_noise: list[Unlike]) -> Report:
    """The page."""
    sections = [
        Section(
            "Answers",
            (
                Statements(tuple(statements(real, all_noise))),
                Paragraph(
                    "What is predicted for these pictures, and for instruments that others built, stands in the "
                    "gallery (reports/instruments), each row with its source and why it differs."
                ),
            ),
            "answers",
        ),
    ]
    if real is None:
        sections.append(Section("Real light fields", (Paragraph(f"Not measured: {WITHOUT}."),), "real"))
    else:
        repeats = Figure.of(
            "repeats", "Errors found over errors reported",
            "Each dot is a twelfth of the pixels. Below the line errors are reported too large. Sets of every other "
            "view share what was interpolated between them, and differ by less than they err.",
            reported_and_found(real.sets),
        )  # fmt: skip
        sections += [
            Section("What views of real cameras differ by", tuple(mismatch_tables(real)), "mismatch"),
            Section("Does it repeat?", (repeated_table(real.sets), repeats), "repeats"),
        ]
    sections += [
        Section("Noise that is not as believed", (noise_table(all_noise),), "noise"),
        Section("How it was done", (Code("python studies/depth/published.py", "Run again"),), "how"),
    ]
    return Report(
        "Depth errors in real pictures", "what views differ by, how far depths repeat, noise", tuple(sections)
    )


def main() -> None:
    """Measure, and write the numbers and the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=PICTURES.parent, help="folder for the results")
    parser.add_argument("--data", type=Path, default=DATA, help="folder of the real pictures")
    arguments = parser.parse_args()
    real = Real.of(arguments.data) if arguments.data.is_dir() else None
    all_noise = list(unlike_believed())
    out = arguments.output
    out.mkdir(parents=True, exist_ok=True)
    told = {
        "real": None if real is None else real.to_dict(),
        "noise": [one._asdict() for one in all_noise],
    }
    (out / PICTURES.name).write_text(json.dumps(plain(told), allow_nan=False, indent=1) + "\n")
    (out / "index.html").write_text(render_html(report(real, all_noise)))


if __name__ == "__main__":
    main()
