"""Exported cameras and lenses, read back by other programs, and their rays beside ours.

Run from the project's root: python studies/compare/compare_study.py [-o FOLDER] [--install]. Each program runs in an
environment of its own, kept where those of the benchmarks are; `--install` makes those that are missing, otherwise a
program that is not there is left out, and the page says so.
"""

from __future__ import annotations

import argparse
import contextlib
import datetime
import hashlib
import io
import json
import math
import platform
import subprocess
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers import Peer, install, installed
from benchmarks.turns import RunError, environment, last_line
from roslf_design import __version__
from roslf_design.cli import main as roslf
from roslf_design.design import Design, load
from roslf_design.lenses.lens_file import load_lens
from roslf_design.lenses.prescription import Prescription, first_order
from roslf_design.reporting.blocks import (
    Block,
    Bullets,
    Code,
    Paragraph,
    Report,
    Section,
    Statement,
    Statements,
    Table,
)
from roslf_design.reporting.printers import render_html
from roslf_design.traced.camera import camera_of, sensor_of_pupil
from studies.compare.zmx_rays import DIGITS, Face, faces, trace

Floats = NDArray[np.float64]

HERE = Path(__file__).parent
OUT = Path("reports/compare")
CAMERAS = ("paper", "paper-singlet", "rigid-scope", "video-otoscope", "arthroscope", "cystoscope")
LENSES = ("LA1050-A", "AC254-050-A", "AC050-008-A")
BAR = 1e-9
"""Difference that counts as agreement [mm]."""
FIELDS = (0.0, 0.5, 1.0)
"""Microlenses, in half heights of the sensor."""
ANGLES = (0.0, 1.0, 3.0)
"""Fields of a lens alone [degrees]."""
PUPIL = {"chief": (0, 0), "marginal, up": (0, 1), "marginal, down": (0, -1), "marginal, side": (1, 0)}
"""Points of the FAP, or of a lens's entrance pupil, in radii."""
BEFORE = 20.0
"""Distance of the plane before a lens at which rays begin [mm]."""


class Program(NamedTuple):
    """Program that reads an exported file."""

    peer: Peer
    suffix: str

    @property
    def label(self) -> str:
        """Name with the kind of file, as tables have it."""
        return f"{self.peer.title.rsplit(' ', 2)[0]}, {self.suffix}"


OPTILAND = Peer("optiland", "Optiland 0.6.3 (MIT)", ("optiland==0.6.3",))
RAYOPTICS = Peer("rayoptics", "ray-optics 0.9.8 (BSD-3)", ("rayoptics==0.9.8", "opticalglass==1.1.1"))
KRAKEN = Peer("KrakenOS", "KrakenOS 1.0.0.24 (GPL-3)", ("KrakenOS==1.0.0.24", "setuptools<81"))
PROGRAMS = (
    Program(OPTILAND, ".json"), Program(OPTILAND, ".zmx"), Program(RAYOPTICS, ".zmx"), Program(KRAKEN, ".zmx"),
)  # fmt: skip


@dataclass(frozen=True)
class Ray:
    """Ray as this program traces it."""

    name: str
    pupil: tuple[int, int]
    field: str
    """Where it comes from, in words."""
    start: tuple[float, float]
    """On the plane of the object, or `BEFORE` a lens [mm]."""
    way: tuple[float, float, float]
    met: Mapping[str, tuple[float, float]]
    """Points where it meets surfaces, by their names [mm]."""

    @property
    def is_chief(self) -> bool:
        """Whether it goes through the pupil's middle."""
        return self.pupil == (0, 0)


@dataclass(frozen=True)
class Case:
    """Camera or lens, as exported, with our rays."""

    name: str
    wavelength: float
    """[mm]."""
    before: float
    """`BEFORE` for a lens, else 0."""
    files: Mapping[str, Path]
    rays: tuple[Ray, ...]

    @property
    def row(self) -> list[Face]:
        """Surfaces of the .zmx file."""
        return faces(self.files[".zmx"].read_text())

    @property
    def indices(self) -> list[float]:
        """Refractive indices behind all surfaces, out of the other file."""
        surfaces = json.loads(self.files[".json"].read_text())["surface_group"]["surfaces"]
        return [float(one["material_post"]["index"]) for one in surfaces]

    @property
    def target(self) -> str:
        """Plane that rays are compared on."""
        return "image" if self.before else "microlens"

    def job(self, suffix: str) -> dict[str, Any]:
        """What another program is to do with a file."""
        return {
            "file": str(self.files[suffix].resolve()), "before": self.before, "indices": self.indices,
            "wavelength_um": 1e3 * self.wavelength, "rays": [[*ray.start, *ray.way] for ray in self.rays],
        }  # fmt: skip

    @property
    def refereed(self) -> list[list[tuple[float, float]]]:
        """Points of all rays on all surfaces, by Snell's law with `DIGITS` digits."""
        row, indices = self.row, self.indices
        traced = (trace(row, indices, ray.start, ray.way, self.before) for ray in self.rays)
        return [[(float(x), float(y)) for x, y in points] for points in traced]


def _unit(slope: Sequence[float]) -> tuple[float, float, float]:
    shrink = 1 / math.sqrt(1 + slope[0] ** 2 + slope[1] ** 2)
    return slope[0] * shrink, slope[1] * shrink, shrink


def camera_rays(design: Design) -> Iterator[Ray]:
    """Rays from microlenses through the FAP's middle and rim, followed backwards to the plane in focus."""
    camera, radius = camera_of(design), float(design.D_F) / 2
    points = radius * np.array(list(PUPIL.values()), float)
    for part in FIELDS:
        c = np.array([0.0, part * design.sensor_size[1] / 2])
        found = sensor_of_pupil(camera, c, points)
        assert found.ok.all(), f"{design.name}: no ray from the microlens at {c}"
        seen = found.views
        starts = seen.place + seen.slope * (camera.focal_plane - camera.fap.z)
        for k, (name, pupil) in enumerate(PUPIL.items()):
            met = {"FAP": tuple(seen.pupil[k].tolist()), "microlens": tuple(c.tolist())}
            if part == 0 and not design.plates:  # the file has the one microlens, and ours has air about it
                met["sensor"] = tuple(found.sensor[k].tolist())
            where = f"microlens at y = {c[1]:.6g} mm"
            yield Ray(name, pupil, where, tuple(starts[k].tolist()), _unit(seen.slope[k].tolist()), met)


def lens_rays(lens: Prescription, wavelength: float) -> Iterator[Ray]:
    """Rays of three angles through the middle and the rim of the first vertex's plane, on to the focal plane."""
    radius = lens.surfaces[0].semi_diameter
    image = lens.length + first_order(lens, wavelength).back_focal_length
    for angle in ANGLES:
        slope = np.array([0.0, math.tan(math.radians(angle))])
        for name, pupil in PUPIL.items():
            start = radius * np.array(pupil, float) - BEFORE * slope
            out = lens.through(start, slope, wavelength, start=-BEFORE, end=image, backward=False)
            met = {"image": (float(out.height[0]), float(out.height[1]))}
            ends = (float(start[0]), float(start[1]))
            yield Ray(name, pupil, f"{angle:g} degrees", ends, _unit(slope.tolist()), met)


def cases(folder: Path) -> list[Case]:
    """Everything that is compared, exported into a folder."""
    found = []
    for name in (*CAMERAS, *LENSES):
        files = {suffix: folder / f"{name}{suffix}" for suffix in (".zmx", ".json")}
        for file in files.values():
            with contextlib.redirect_stdout(io.StringIO()):
                assert roslf(["export", name, "-o", str(file)]) == 0
        if name in CAMERAS:
            design = load(name)
            found.append(Case(name, design.wavelength, 0.0, files, tuple(camera_rays(design))))
        else:
            lens = load_lens(name)
            wave = next(float(line.split()[2]) for line in files[".zmx"].read_text().splitlines() if "WAVM" in line)
            found.append(Case(name, 1e-3 * wave, BEFORE, files, tuple(lens_rays(lens, 1e-3 * wave))))
    return found


# --- other programs ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Answers:
    """What a program says of all files of one kind."""

    program: Program
    cases: tuple[Mapping[str, Any], ...] = ()
    version: str = ""
    missing: str = ""
    """Why there are none."""


def asked(program: Program, all_cases: Sequence[Case], fetch: bool) -> Answers:
    """Answers of a program, which is installed first if wanted."""
    try:
        python = install(program.peer) if fetch else installed(program.peer)
        if python is None:
            return Answers(program, missing="not installed here (--install makes its environment)")
        with tempfile.TemporaryDirectory() as folder:
            job = Path(folder) / "job.json"
            job.write_text(json.dumps([case.job(program.suffix) for case in all_cases]))
            words = [str(python), str(HERE / "in_peers.py"), program.peer.packages[0].partition("==")[0], str(job)]
            done = subprocess.run(
                words, capture_output=True, text=True, check=False, timeout=900, cwd=folder,
                env=environment(1) | {"QT_QPA_PLATFORM": "offscreen"},
            )  # fmt: skip
    except (RunError, OSError, subprocess.TimeoutExpired) as error:
        return Answers(program, missing=str(error)[:200])
    if done.returncode:
        return Answers(program, missing=last_line(done.stderr) or f"exit code {done.returncode}")
    told = json.loads(done.stdout)
    return Answers(program, tuple(told["cases"]), told["version"])


class Differences(NamedTuple):
    """Largest differences from our rays [mm]; None is nothing to compare, nan a ray that did not arrive."""

    chief: float | None
    marginal: float | None
    sensor: float | None
    lens: float | None
    """On all surfaces up to the first ideal lens, from the referee."""

    @property
    def worst(self) -> float:
        """Of chief and marginal rays."""
        return max(_nan_first(part for part in (self.chief, self.marginal) if part is not None))


def _nan_first(values: Iterator[float]) -> list[float]:
    """Numbers for `max`, a ray that is lost above all."""
    return [math.inf if math.isnan(value) else value for value in values]


def differences(case: Case, points: Sequence[Sequence[Sequence[float]]], refereed: Any) -> Differences:
    """How far the points of a program's rays (rays, surfaces, 2) lie from ours."""
    names = [face.name for face in case.row]
    ideal = next((k for k, face in enumerate(case.row) if face.focal_length is not None), len(names) - 1)

    def off(ray: Ray, met: Sequence[Sequence[float]], name: str) -> float:
        at = names.index(name)
        return math.dist(met[at], ray.met[name]) if len(met) > at else math.nan

    def largest(values: Iterator[float]) -> float | None:
        return max(_nan_first(values), default=None)

    pairs = list(zip(case.rays, points, strict=True))
    before = (math.dist(a, b) for met, true in zip(points, refereed, strict=True)
              for a, b in zip(met[: ideal + 1], true, strict=False))  # fmt: skip
    return Differences(
        largest(off(ray, met, case.target) for ray, met in pairs if ray.is_chief),
        largest(off(ray, met, case.target) for ray, met in pairs if not ray.is_chief),
        largest(off(ray, met, "sensor") for ray, met in pairs if "sensor" in ray.met),
        largest(before),
    )


@dataclass(frozen=True)
class Compared:
    """One file in one program."""

    case: Case
    program: Program
    ours: Differences | None
    """With refractive indices as ours; None where the file was not read."""
    own: Differences | None
    """With the program's own glasses."""
    answer: Mapping[str, Any]

    @property
    def losses(self) -> list[str]:
        """What the program read otherwise than it stands in the file."""
        return list(self._losses())

    def _losses(self) -> Iterator[str]:
        if "error" in self.answer:
            yield f"not read: {self.answer['error']}"
            return
        told, row = self.answer["stated"], self.case.row
        if told["surfaces"] != len(row):
            yield f"{told['surfaces']} surfaces of {len(row)}"
            return
        stop = next((k for k, face in enumerate(row) if face.stop), None)
        if told["stop"] != stop:
            yield f"the stop on surface {stop} is lost"
        ideal = [k for k, face in enumerate(row) if face.focal_length is not None]
        if told["ideal"] != ideal:
            yield "paraxial surfaces become planes (focal lengths were put in by hand)"
        size = told["stop_size"]
        if size is not None and stop is not None and not math.isclose(size, 2 * row[stop].semi_diameter):
            yield "the stop's semi-diameter is taken for its diameter: rays that it aims itself fill half of the stop"
        gaps = np.cumsum([0.0, *(face.thickness for face in row[1:-1])])
        if not np.allclose(told["places"][1:], gaps, rtol=0, atol=1e-12):
            yield "surfaces stand elsewhere"
        if self.case.before and abs(told["places"][0]) < 1e9:
            yield "the object far away is read at the lens"


def compared(case: Case, answers: Answers, answer: Mapping[str, Any], refereed: Any) -> Compared:
    """A program's answer beside ours."""
    if "error" in answer:
        return Compared(case, answers.program, None, None, answer)
    ours, own = (differences(case, answer[key], refereed) for key in ("our_indices", "as_read"))
    return Compared(case, answers.program, ours, own, answer)


@dataclass(frozen=True)
class Comparison:
    """All of it."""

    cases: tuple[Case, ...]
    answers: tuple[Answers, ...]
    rows: tuple[Compared, ...]
    referee: Mapping[str, Differences]
    """Our rays beside Snell's law with `DIGITS` digits."""
    date: str = field(default_factory=lambda: datetime.date.today().isoformat())

    @classmethod
    def of(cls, all_cases: Sequence[Case], all_answers: Sequence[Answers]) -> Comparison:
        """Everything, from what programs answered."""
        true = {case.name: case.refereed for case in all_cases}
        rows = [
            compared(case, answers, answer, true[case.name])
            for answers in all_answers
            for case, answer in zip(all_cases, answers.cases, strict=not answers.missing)
        ]
        referee = {case.name: differences(case, true[case.name], true[case.name]) for case in all_cases}
        return cls(tuple(all_cases), tuple(all_answers), tuple(rows), referee)

    def of_program(self, program: Program) -> list[Compared]:
        """Rows of one program and kind of file."""
        return [row for row in self.rows if row.program == program]

    def find(self, case: Case, program: Program) -> Compared | None:
        """A file in a program, where it ran."""
        return next((row for row in self.of_program(program) if row.case is case), None)

    def to_dict(self) -> dict[str, Any]:
        """As JSON."""
        return {
            "date": self.date, "roslf_design": __version__,
            "programs": {one.program.label: one.version or one.missing for one in self.answers},
            "sha256": {path.name: _hash(path) for case in self.cases for path in case.files.values()},
            "referee_mm": {name: one._asdict() for name, one in self.referee.items()},
            "rows": [
                {
                    "design": row.case.name, "program": row.program.label, "losses": row.losses,
                    "our_indices_mm": row.ours and row.ours._asdict(), "own_glasses_mm": row.own and row.own._asdict(),
                }
                for row in self.rows
            ],
            "rays": {
                case.name: [
                    {"ray": ray.name, "field": ray.field, "start_mm": ray.start, "direction": ray.way,
                     "pupil": ray.pupil, "met_mm": dict(ray.met)}
                    for ray in case.rays
                ]
                for case in self.cases
            },
        }  # fmt: skip


def _hash(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


# --- page -------------------------------------------------------------------------------------------------------------


def _size(value: float | None) -> str:
    if value is None:
        return "-"
    return "lost" if math.isinf(value) else f"{value:.1e}"


def _pair(one: Differences | None) -> str:
    return "not read" if one is None else f"{_size(one.chief)} / {_size(one.marginal)}"


def difference_table(all_of: Comparison, own: bool) -> Table:
    """Chief and marginal rays of all programs beside ours."""
    ran = [one.program for one in all_of.answers if not one.missing]
    cells = []
    for case in all_of.cases:
        rows = (all_of.find(case, program) for program in ran)
        beside = [_pair(None if row is None else row.own if own else row.ours) for row in rows]
        cells.append((case.name, *([] if own else [_pair(all_of.referee[case.name])]), *beside))
    heads = ("design", *([] if own else [f"Snell, {DIGITS} digits"]), *(program.label for program in ran))
    title = "with the glasses that each program has" if own else "with the same refractive indices"
    return Table(
        tuple(cells), "l" + "r" * (len(heads) - 1), heads, f"Chief / marginal rays, {title}: largest difference [mm]",
        "Glasses that go by a name in .zmx come from each program's catalogue, others from its rule for n_d and V."
        if own else "Cameras at the microlens array, lenses at the focal plane. The referee reads the .zmx text.",
    )  # fmt: skip


def further_tables(all_of: Comparison) -> Iterator[Table]:
    """Rays behind the microlens, and before the first ideal lens."""
    ran = [one.program for one in all_of.answers if not one.missing]
    sensor, before = [], []
    for case in all_of.cases:
        rows = [row.ours if (row := all_of.find(case, program)) else None for program in ran]
        true = all_of.referee[case.name].sensor
        if true is not None:
            sensor.append((case.name, _size(true), *(_size(one and one.sensor) for one in rows)))
        before.append((case.name, *(_size(one and one.lens) for one in rows)))
    labels = [program.label for program in ran]
    yield Table(
        tuple(sensor), "lr" + "r" * len(ran), ("design", f"Snell, {DIGITS} digits", *labels),
        "At the sensor, with the same refractive indices: largest difference [mm]",
        "Behind the microlens on the axis, the only one in the file. Of the arthroscope the sensor is not compared: "
        "this program reduces glass about the array to air, the file has it as it is.",
    )  # fmt: skip
    yield Table(
        tuple(before), "l" + "r" * len(ran), ("design", *labels),
        "Real surfaces, up to the first ideal lens, with the same indices: largest difference from Snell's law [mm]",
        "On every surface; of a lens alone up to its focal plane.",
    )  # fmt: skip


def losses_table(all_of: Comparison) -> Table:
    """What was read, and what was not."""
    cells = []
    for one in all_of.answers:
        rows = all_of.of_program(one.program)
        if one.missing:
            cells.append((one.program.label, "-", "-", f"left out: {one.missing}"))
            continue
        read = sum("error" not in row.answer for row in rows)
        found: dict[str, list[str]] = {}
        for row in rows:
            for loss in row.losses:
                found.setdefault(loss, []).append(row.case.name)
        words = "; ".join(f"{loss} ({_names(names, len(rows))})" for loss, names in found.items())
        cells.append((one.program.label, one.version, f"{read} of {len(rows)}", words or "nothing"))
    note = (
        "KrakenOS wants UTF-16 and got the same text in that. ray-optics 0.9.10 is newer, but needs glass data from "
        "the network before it starts. rayopt 0.2 does not install on Python 3.11; zospy and zosapi drive "
        "OpticStudio itself, zmxtools only unpacks its files. deeplens-core, optika and tracepy were not tried."
    )
    return Table(tuple(cells), "llll", ("program, file", "version", "files read", "what it reads otherwise"),
                 "What programs make of the files", note)  # fmt: skip


def _names(names: list[str], count: int) -> str:
    return "all" if len(names) == count else ", ".join(names)


def glass_table(all_of: Comparison) -> Table:
    """Refractive indices that programs give to the glasses of .zmx files, less ours."""
    found: dict[tuple[str, str, str], dict[str, float]] = {}
    ran = [one.program for one in all_of.answers if not one.missing and one.program.suffix == ".zmx"]
    for row in all_of.rows:
        if "error" in row.answer or row.program not in ran:
            continue
        for face, ours, theirs in zip(row.case.row, row.case.indices, row.answer["indices"], strict=True):
            if face.glass:
                name, *_, n_d, abbe, _ = face.glass.split()
                words = name if name != "___BLANK" else f"n_d {float(n_d):.6f}, V {float(abbe):.2f}"
                key = words, f"{1e6 * row.case.wavelength:.7g}", f"{ours:.12f}"
                found.setdefault(key, {})[row.program.label] = theirs - ours
    cells = tuple(
        (*key, *(f"{one[program.label]:+.1e}" if program.label in one else "-" for program in ran))
        for key, one in sorted(found.items())
    )
    return Table(cells, "lrr" + "r" * len(ran), ("glass", "wavelength [nm]", "our index", *(one.label for one in ran)),
                 "Refractive indices as programs read them from .zmx, less ours",
                 "SF10 is N-SF10 where it is 2.7e-5 off: looked up by a name that is part of another. A rule for "
                 "n_d and V knows nothing of a glass's "
                 "partial dispersion; OpticStudio's is good to some 1e-4.")  # fmt: skip


def statements(all_of: Comparison) -> Iterator[Statement]:
    """What it comes to."""
    worst = max(max(one.worst, one.sensor or 0.0) for one in all_of.referee.values())
    yield Statement(
        "good" if worst <= BAR else "bad",
        f"Do the files say what this program traces? Rays through the .zmx text by Snell's law with {DIGITS} digits "
        f"end within {worst:.1e} mm of ours, of {len(all_of.cases)} designs.",
    )
    for one in all_of.answers:
        if one.missing:
            yield Statement("caution", f"{one.program.label}: left out, {one.missing}.")
            continue
        rows = all_of.of_program(one.program)
        good = [row.case.name for row in rows if row.ours is not None and row.ours.worst <= BAR]
        bad = [row.case.name for row in rows if row.case.name not in good]
        text = f"{one.program.label}, {one.version}: {len(good)} of {len(rows)} within {BAR:g} mm with our indices"
        if bad:
            text += f"; not {', '.join(bad)}"
        text += "."
        real = max((row.ours.lens for row in rows if row.ours is not None and row.ours.lens is not None), default=0.0)
        if bad and real <= BAR:
            text += (
                f" On real surfaces it agrees with Snell's law to {real:.1e} mm; its ideal lens is another one than a "
                "paraxial surface, whose slopes change by height over focal length."
            )
        elif bad:
            text += f" On curved surfaces it is itself off Snell's law, by up to {real:.1e} mm; this program is not."
        own = max((row.own.worst for row in rows if row.own is not None and row.case.name in good), default=0.0)
        text += f" With the glasses that it reads these are off by up to {own:.1e} mm." if own > BAR else ""
        yield Statement("good" if not bad else "caution", text)
    yield Statement(
        "caution",
        "OpticStudio: not run. Nobody here owns it. What its owner would press, and the numbers to find, stands below.",
    )


STEPS = (
    "File > Open: one of the .zmx files of the folder files/ beside this page (its hash is in the table). Compare "
    "surface, thickness and radius in the Lens Data Editor with the text of the file; the surface named FAP must be "
    "the stop (of a lens the first). On the surface microlens set Aperture to None: rays off the axis pass beside "
    "the one microlens of the file, and would be reported as vignetted.",
    "System Explorer > Aperture: Float By Stop Size (a camera), Entrance Pupil Diameter (a lens). System Explorer > "
    "Ray Aiming: Real for cameras, Off for lenses. System Explorer > Wavelengths: one, as on the table's title.",
    "Glass: in the Lens Data Editor set the Material of every surface that is not air to a Model solve with the "
    "index from the table of indices and Abbe number 0. Check in Analyze > Reports > Prescription Data, Index of "
    "refraction, that it is this number to all digits; if not, differences of the size of the table with programs' "
    "own glasses are to be expected.",
    "System Explorer > Fields: Object Height (cameras) or Angle (lenses); type X and Y of the ray. Give each ray "
    "that has numbers of its own a field of its own.",
    "Analyze > Rays & Spots > Ray Trace: choose that field (Hx and Hy follow), Px and Py of the ray. Read the real "
    "ray's X and Y coordinates on the surface named microlens (cameras) or image (lenses), and on sensor where the "
    "table has a number.",
    "Subtract. Ray aiming stops before the last digits: where the stop is not hit to 1e-12 mm (read X and Y on the "
    "surface FAP) trace the ray directly instead. By ZOS-API: Tools > OpenBatchRayTrace, CreateDirectUnpol, start "
    "surface 0, with X, Y and the direction cosines of this ray out of compare.json (lenses: from a dummy plane 20 "
    "mm before surface 1).",
)


def ray_table(case: Case) -> Table:
    """Rays of a design, as an owner of another program types and finds them."""
    behind = any("sensor" in ray.met for ray in case.rays)
    cells = []
    for ray in case.rays:
        fields = f"0, {ray.field.removesuffix(' degrees')}" if case.before else _digits(ray.start)
        ends = [_digits(ray.met[place]) if place in ray.met else "-" for place in (case.target, "sensor")]
        cells.append((ray.name, fields, f"{ray.pupil[0]}, {ray.pupil[1]}", *ends[: 1 + behind]))
    unit = "degrees" if case.before else "mm"
    places = (f"{case.target} X, Y [mm]", "sensor X, Y [mm]")[: 1 + behind]
    heads = ("ray", f"field X, Y [{unit}]", "Px, Py", *places)
    return Table(tuple(cells), "l" * len(heads), heads, f"{case.name}.zmx, {1e6 * case.wavelength:.8g} nm", dense=True)


def _digits(point: Sequence[float]) -> str:
    return ", ".join("0" if abs(value) < 1e-13 else f"{value:.13g}" for value in point)


def report(all_of: Comparison) -> Report:
    """The page."""
    signed = tuple(
        (path.name, f"{path.stat().st_size}", _hash(path)) for case in all_of.cases for path in case.files.values()
    )
    versions = "; ".join(f"{one.program.peer.title.split()[0]} {one.version}" for one in all_of.answers if one.version)
    first: tuple[Block, ...] = (
        Statements(tuple(statements(all_of))), difference_table(all_of, own=False), difference_table(all_of, own=True),
        *further_tables(all_of),
    )  # fmt: skip
    how = (
        "Of each camera 12 rays: from the middle microlens, from half way up and from the edge of the sensor, "
        "through the middle of the FAP (chief) and three points of its rim (marginal). This program follows them "
        "backwards, from the sensor to the plane in focus; there the other programs take them up, with the same "
        "place and direction, and follow them forwards through what they read from the file. So neither sees the "
        "other's aim. Of each lens 12 rays: 0, 1 and 3 degrees, through the middle and the rim of the first "
        f"vertex's plane, from {BEFORE:g} mm before it.",
        "Clear apertures are opened in every program: rays along rims are compared, not clipped. Each program runs "
        "twice, with the glasses that it read and with our indices put in their place.",
        "Misalignments are left out of exported files, and there is one microlens, on the axis: other fields end on "
        "its plane.",
    )
    sections = (
        Section("Answers", first, "answers"),
        Section("What was read", (losses_table(all_of), glass_table(all_of)), "read"),
        Section("How it was compared", (*map(Paragraph, how), Code(
            "python studies/compare/compare_study.py --install", "Run again")), "how"),
        Section("In OpticStudio", (
            Paragraph(
                "Nobody ran OpticStudio for this page; menus are named after its manual, and may stand elsewhere in a "
                "version. Its owner presses:"
            ),
            Bullets(STEPS), *map(ray_table, all_of.cases)), "opticstudio"),
        Section("Signed", (
            Paragraph(f"{all_of.date}; roslf_design {__version__}, Python {platform.python_version()}; {versions}."),
            Table(signed, "lrl", ("file", "bytes", "SHA-256"), "Files that were exported and read"),
        ), "signed"),
    )  # fmt: skip
    return Report("Exported files in other programs", "chief and marginal rays beside ours", sections)


def main() -> None:
    """Export, ask all programs, and write the numbers and the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=OUT, help="folder for the results")
    parser.add_argument("--install", action="store_true", help="install programs that are missing, by pip")
    arguments = parser.parse_args()
    out = arguments.output
    (out / "files").mkdir(parents=True, exist_ok=True)
    all_cases = cases(out / "files")
    all_of = Comparison.of(all_cases, [asked(program, all_cases, arguments.install) for program in PROGRAMS])
    (out / "compare.json").write_text(json.dumps(all_of.to_dict(), indent=1) + "\n")
    (out / "index.html").write_text(render_html(report(all_of)))


if __name__ == "__main__":
    main()
