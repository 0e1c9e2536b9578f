"""The same work in other programs, each in an environment of its own; none is a dependency of the project."""

from __future__ import annotations

import json
import math
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from roslf_design.calibration.decoding import Decoder
from roslf_design.calibration.lattice import CentreLattice
from roslf_design.camera import Camera
from roslf_design.depth.geometry import disparity_of
from roslf_design.depth.measure import search_about, simulate
from roslf_design.depth.pictures import PictureOptions, lattice_of
from roslf_design.design import load
from roslf_design.effects.waves import add_noise
from roslf_design.lenses.glass import find_glass
from roslf_design.shapes.coverage import coverage_image
from roslf_design.theory.photometry import dark_variance
from roslf_design.theory.quantities import QUANTITIES

from .turns import Arrays, Row, RunError, Side, Spent, Worker, in_turn, last_line

PIP = ("-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--prefer-binary")
GREEN_UM = 0.55


@dataclass(frozen=True)
class Peer:
    """A program to compare with."""

    key: str
    title: str
    """With its version and licence."""
    packages: tuple[str, ...]
    loose: tuple[str, ...] = ()
    """Packages installed first, without what they say they need."""
    pythons: tuple[str, ...] = ()
    """Versions that it takes, best first, where not the one at hand."""


PEERS = (
    Peer("optiland", "Optiland 0.6.3 (MIT)", ("optiland==0.6.3",)),
    Peer("batoid", "batoid 0.9.0 (BSD-2)", ("batoid==0.9.0",)),
    Peer("plenoptisign", "PlenoptiSign 1.1.3 (GPL-3)", ("plenoptisign==1.1.3",)),
    Peer(  # its own list of needs asks for pyinstaller 4.10, which is no longer to be had
        "plenopticam",
        "PlenoptiCam 0.9.3 (GPL-3)",
        (
            *("numpy==1.23.5", "scipy==1.10.1", "scikit-image==0.19.3", "colour-science==0.4.4"),
            *("colour-demosaicing==0.2.2", "color-matcher==0.4.0", "color-space-converter==0.1.4", "depthy==0.3.0"),
            *("imageio==2.31.6", "Pillow==9.5.0", "tifffile==2022.4.8", "docutils<0.24", "requests"),
        ),
        ("plenopticam==0.9.3",),
        ("3.10", "3.9", "3.8"),
    ),
)
TITLES = {"here": "here", "scipy": "scipy", "numpy": "20 lines of numpy"} | {
    peer.key: peer.title.split()[0] for peer in PEERS
}


_PYTHON = "Scripts/python.exe" if os.name == "nt" else "bin/python"


def _home(peer: Peer, folder: Path | None) -> Path:
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "roslf-bench"
    return (folder or Path(os.environ.get("ROSLF_BENCH_CACHE") or base)) / peer.key


def _wanted(peer: Peer) -> str:
    return json.dumps([asdict(peer), sys.version])


def installed(peer: Peer, folder: Path | None = None) -> Path | None:
    """A peer's Python, where its environment is there already."""
    home = _home(peer, folder)
    stamp = home / "installed.json"
    return home / _PYTHON if stamp.exists() and stamp.read_text() == _wanted(peer) else None


def install(peer: Peer, folder: Path | None = None) -> Path:
    """A peer's Python, its environment made where there is none yet with these packages.

    They are kept in `ROSLF_BENCH_CACHE`, or roslf-bench in the user's cache folder.

    Raises
    ------
    RunError
        No such Python, or pip failed.
    """
    home = _home(peer, folder)
    python, stamp, wanted = home / _PYTHON, home / "installed.json", _wanted(peer)
    if installed(peer, folder):
        return python
    starter = interpreter(peer.pythons)
    if starter is None:
        raise RunError(f"no Python {' or '.join(peer.pythons)} on this machine")
    shutil.rmtree(home, ignore_errors=True)
    steps = [(starter, "-m", "venv", str(home)), (str(python), *PIP, "--no-deps", *peer.loose)]
    for words in [*(steps if peer.loose else steps[:1]), (str(python), *PIP, *peer.packages)]:
        try:
            subprocess.run(words, check=True, capture_output=True, text=True, timeout=900)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise RunError(str(error)[:300]) from error
        except subprocess.CalledProcessError as error:
            raise RunError(last_line(error.stderr).replace(str(Path.home()), "~") or "pip failed") from error
    stamp.write_text(wanted)
    return python


def interpreter(versions: Sequence[str]) -> str | None:
    """A Python of one of these versions that starts (none given: the one running); also those that pyenv keeps."""
    for version in versions:
        others = sorted((Path.home() / ".pyenv" / "versions").glob(f"{version}.*/bin/python"))
        for name in (shutil.which(f"python{version}"), *map(str, others)):
            if name and subprocess.run([name, "-c", "import venv"], capture_output=True, check=False).returncode == 0:
                return name
    return None if versions else sys.executable


@dataclass(frozen=True)
class Case:
    """A piece of work that other programs do as well."""

    name: str
    title: str
    unit: str
    counts: Mapping[str, float]
    """Who does it, here first, and how many units of it in one run."""
    inputs: Mapping[str, Any]
    judge: Callable[[Arrays, Arrays], str]
    """Says what is wrong between our answer and another's; empty where they agree."""
    describe: Callable[[Arrays], str] = lambda answer: ""
    """How good an answer is."""
    note: str = ""
    stands: bool = False
    """Whether the time of an answer that falls short stands all the same, with what it falls short in beside it."""
    bar: float | None = None
    """As of `Row`."""


def away(name: str, difference: float, allowed: float) -> str:
    """What is said of a difference: nothing if it is allowed; one that is no number is not."""
    return "" if difference <= allowed else f"{name} off by {difference:.3g}, allowed {allowed:.3g}"


def same_rays(ours: Arrays, theirs: Arrays) -> str:
    """The same rays stopped, but for a few within rounding of a rim, and the others at the same place."""
    both = ours["kept"] & theirs["kept"]
    ends = [np.abs(ours[name] - theirs[name])[both].max(initial=0.0) for name in ("x", "y")]
    differ = away("rays kept", float(np.sum(ours["kept"] != theirs["kept"])), 3 + 1e-6 * both.size)
    return differ or away("end points [mm]", float(max(ends)) if both.any() else math.nan, 2e-6)


def same_spots(ours: Arrays, theirs: Arrays) -> str:
    """Nominal spots, and means over trials within four standard errors."""
    error = np.hypot(*(side["sd"] / np.sqrt(side["trials"]) for side in (ours, theirs)))
    nominal = away("nominal spot", float(np.abs(ours["nominal"] / theirs["nominal"] - 1).max()), 1e-6)
    return nominal or away("mean [standard errors]", float((np.abs(ours["mean"] - theirs["mean"]) / error).max()), 4.0)


def as_sharp(ours: Arrays, theirs: Arrays) -> str:
    """Nothing sharper than ours, and theirs no more than a hundredth worse."""
    ratio = float(theirs["merit"] / ours["merit"])
    return "" if 0.999 <= ratio <= 1.01 else f"blur {ratio:.4g} times ours"


def same_lengths(ours: Arrays, theirs: Arrays) -> str:
    """Every length to rounding."""
    words = (away(name, float(np.abs(ours[name] / theirs[name] - 1).max()), 1e-11) for name in ours)
    return next(filter(None, words), "")


def centre_errors(truth: CentreLattice, shape: tuple[int, int], answer: Arrays) -> tuple[float, float]:
    """RMS error per axis of the centres [px], and the share of lenses without one, a pitch off the border."""
    points, room = np.asarray(answer["centres"], float).reshape(-1, 2), 14.07
    points = points[np.all((points >= room) & (points <= np.array(shape[::-1]) - 1 - room), axis=1)]
    index = np.round(np.asarray(truth.indices(points))).astype(np.int64)
    off, lenses = points - truth.nodes(index[:, 0], index[:, 1]), len({(int(i), int(j)) for i, j in index})
    share = max(0.0, 1 - lenses / len(truth.inside(shape, margin=room)))
    return float(np.sqrt(np.mean(off**2))) if len(points) else math.inf, share


def centres(layout: Literal["square", "hexagonal"], fill: float, shape: tuple[int, int]) -> Case:
    """Microlens centres on a white image by exact coverage with 1 % noise, whose lattice is known."""
    pitch, rotation, (rows, columns) = 14.07, math.radians(0.31), shape
    turned = rotation + (math.pi / 2 if layout == "square" else math.pi / 3)
    first, second = ((pitch * math.cos(a), pitch * math.sin(a)) for a in (rotation, turned))
    truth = CentreLattice((columns / 2 + 0.83, rows / 2 - 0.41), first, second, layout)
    index = truth.inside(shape, margin=-pitch)
    axes = truth.nodes(index[:, 0], index[:, 1]) - np.array([(columns - 1) / 2, (rows - 1) / 2])
    discs, radii = np.zeros((len(axes), 1, 2)), np.full((len(axes), 1), fill * pitch / 2)
    image = coverage_image(axes, discs, radii, pixel=1.0, size=(columns, rows), dtype=np.float32)
    image = image + np.random.default_rng(0).normal(0, 0.01, shape).astype(np.float32)
    errors = partial(centre_errors, truth, shape)

    def judge(ours: Arrays, theirs: Arrays) -> str:
        rms, missing = errors(theirs)
        return away("centres [px]", rms, 0.5) or away("share of lenses without one", missing, 0.1)

    title = f"microlens centres, {layout}, images {fill:g} of the pitch, {columns} x {rows} px"
    return Case(
        f"centres-{layout}",
        title,
        "",
        {"here": 1, "plenopticam": 1, "scipy": 1},
        {"image": image},
        judge,
        lambda answer: "error {:.3f} px, {:.1%} of the lenses missing".format(*errors(answer)),
        "Pitch 14.07 px, turned by 0.31 degrees, 1 % noise.",
        True,
    )


def disparity_errors(true: NDArray[np.float64], answer: Arrays) -> tuple[float, float, float]:
    """Bias of disparities (slope on the true ones, less 1), scatter about that [pitches], share within their errors."""
    told, known = answer["disparity"], np.isfinite(answer["disparity"]) & np.isfinite(true)
    slope, shift = np.polyfit(true[known], told[known], 1)
    scatter = float(np.std(told[known] - slope * true[known] - shift))
    within = np.mean(np.abs(told - true)[known] < answer["sigma"][known]) if "sigma" in answer else math.nan
    return float(slope) - 1, scatter, float(within)


def depth(region: tuple[int, int, int, int]) -> Case:
    """Disparities of a slanted wall with texture before the paper's bench: what `roslf depth paper` looks at."""
    paper = load("paper")
    trial = simulate(paper, None, PictureOptions(region=region))
    camera, raw, white = Camera.of(paper), trial.raw.pixels, trial.white.pixels
    decoder = Decoder.of(lattice_of(camera, trial.raw.region), raw.shape, white=white)
    full, dark = trial.electrons * white.sum() / raw.sum(), math.sqrt(float(dark_variance(camera)))
    even, taken = decoder(white), add_noise(raw, float(full), dark, np.random.default_rng(0))
    brightest = float(np.median(even.values[even.weight > 0]))
    field, near = decoder(taken / np.float32(brightest)), trial.first.field
    true, half = np.full(field.values.shape[2:], np.nan), trial.first.disparities.window // 2
    rows, columns = np.searchsorted(field.v, near.v - 1e-6), np.searchsorted(field.u, near.u - 1e-6)
    true[np.ix_(rows, columns)] = disparity_of(camera, trial.true)
    true[:half], true[-half:], true[:, :half], true[:, -half:] = (np.nan,) * 4
    errors, known = partial(disparity_errors, true), true[np.isfinite(true)]
    inputs = {name: getattr(field, name) for name in ("values", "weight", "s", "t", "u", "v", "pitch")}
    inputs |= {"electrons": full * brightest, "read_noise": dark, "search": search_about(known.min(), known.max())}

    def describe(answer: Arrays) -> str:
        bias, scatter, within = errors(answer)
        told = "no errors reported" if math.isnan(within) else f"{within:.0%} within the errors reported"
        return f"bias {bias:+.1%}, scatter {scatter:.3f} pitches, {told}"

    def judge(ours: Arrays, theirs: Arrays) -> str:
        (_, least, _), (bias, scatter, within) = errors(ours), errors(theirs)
        wrong = away("disparities, by their slope on the true ones,", abs(bias), 0.05)
        wide = f"scatter {scatter / least:.1f} times ours" if scatter > 2 * least else ""
        return "; ".join(filter(None, (wrong, wide, "no errors reported" if math.isnan(within) else "")))

    return Case(
        "depth-plain",
        f"disparity of {field.values.shape[3]} x {field.values.shape[2]} microlenses with texture on a slanted wall",
        "microlenses",
        dict.fromkeys(("here", "numpy"), float(true.size)),
        inputs | {"image": float(QUANTITIES["fill_factor"](camera)) * field.pitch},
        judge,
        describe,
        "Decoded light field of the paper's bench, shot and read noise; 5 x 5 microlenses matched.",
        True,
    )


def cases(quick: bool, chosen: Sequence[str] = ()) -> Iterator[Case]:
    """All, or those that are chosen, with their inputs."""
    random, count, trials = np.random.default_rng(0), 100_000 if quick else 1_000_000, 20_000 if quick else 100_000
    (x, y), (s, t) = random.uniform(-10, 10, (2, count)), random.uniform(-0.05, 0.05, (2, count))
    index = float(find_glass("N-BK7").index(GREEN_UM * 1e-3))
    lens = {"radius": 51.85, "thickness": 10.0, "behind": 93.4, "D": 50.8, "wavelength_um": GREEN_UM}
    spot = {"radius": 103.29, "thickness": 7.0, "object": 350.0, "image": 136.0, "pupil": 10.0, "rings": 6}
    widths = {"width_radius": 0.5, "width_thickness": 0.05, "width_conic": 0.01, "width_index": 0.001}
    runs = {"here_trials": trials, "optiland_trials": 10 if quick else 40}
    d_f, d_3 = random.uniform(250, 600, 1000), random.uniform(1, 90, 1000)
    fixed = {"f": 100.0, "d": 0.063, "d_2": 2.0, "q": 0.004847826}
    rays = Case(
        "singlet",
        "rays through an N-BK7 singlet, f 100 mm",
        "rays",
        dict.fromkeys(("here", "optiland", "batoid"), count),
        {"x": x, "y": y, "s": s, "t": t, **lens},
        same_rays,
        bar=90e6,
        note="Both surfaces with their rims, to a plane behind; plano-convex, 50.8 mm wide, 10 mm thick.",
    )
    spots = Case(
        "spots",
        "Monte Carlo tolerancing of a singlet, 8 perturbations",
        "trials",
        {"here": trials, "optiland": runs["optiland_trials"]},
        {**spot, **widths, **runs, "heights": [0.0, 14.0, 28.0], "wavelength_um": GREEN_UM, "index": index},
        same_spots,
        note="Radii, conics, distances, thickness, index; RMS spots of three object points, 127 rays each.",
    )
    bent = Case(
        "bending",
        "bending and focus of a singlet for least blur, f held",
        "",
        {"here": 1, "optiland": 1},
        {**spot, "heights": [0.0, 14.0, 28.0], "wavelength_um": GREEN_UM, "focal_length": 100.0},
        as_sharp,
        lambda answer: f"rms radius {float(answer['merit']) * 1e3:.1f} um",
        "Three object points, 127 rays each, from a biconvex start; there three variables, and f an operand.",
    )
    geometry = Case(
        "geometry",
        "refocus distance, baseline, entrance pupil of 1000 cameras",
        "cameras",
        {"here": 20_000, "plenoptisign": 1000},
        {"d_f": d_f, "d_3": d_3, **{name: np.full(1000, value) for name, value in fixed.items()}},
        same_lengths,
        note="Here as arrays, as optimiser and tolerances do it; PlenoptiSign takes one camera a call.",
    )
    shape = (600, 800) if quick else (1000, 1400)
    made = [rays, spots, bent, geometry, centres("hexagonal", 0.7, shape), centres("square", 0.95, shape)]
    yield from (case for case in made if not chosen or case.name in chosen)
    if not chosen or "depth-plain" in chosen:
        yield depth((1800, 1300, 500, 260) if quick else (1800, 1300, 1000, 520))


def compare(case: Case, pythons: Mapping[str, Path | str], rounds: int, most_seconds: float) -> Row:
    """Everyone's answer against ours, then times in turn; who is missing, or differs, has a fault and no times.

    Where times stand all the same, what an answer falls short in is said beside them. `pythons` are by key: a Python,
    or why there is none.
    """
    workers: dict[str, Worker] = {}
    results: dict[str, list[Spent] | str] = {}
    notes: dict[str, str] = {}
    short: dict[str, str] = {}
    with tempfile.TemporaryDirectory(prefix="roslf-bench-") as name:
        folder = Path(name)
        arrays: dict[str, Any] = {key: np.asarray(value) for key, value in case.inputs.items()}
        np.savez(folder / "inputs.npz", **arrays)
        ours: Arrays = {}
        try:
            for key in case.counts:
                python = pythons.get(key, Path(sys.executable))
                try:
                    if isinstance(python, str):
                        raise RunError(python)
                    workers[key] = Worker(python, f"{key}_{case.name.split('-')[0]}", folder / "inputs.npz", folder)
                    workers[key].run()
                    answer = workers[key].answer()
                    ours = ours or answer
                    notes[key] = case.describe(answer)
                    wrong = case.judge(ours, answer)
                    if wrong and not case.stands:
                        raise RunError(wrong)
                    short[key] = wrong
                except RunError as error:
                    results[key] = str(error)
            results |= in_turn({k: w.run for k, w in workers.items() if k not in results}, rounds, most_seconds)
        finally:
            for worker in workers.values():
                worker.close()
    sides = (side(key, results[key], case, notes.get(key, ""), short.get(key, "")) for key in case.counts)
    return Row(case.name, case.title, case.unit, tuple(sides), case.note, case.bar)


def side(key: str, runs: list[Spent] | str, case: Case, note: str, short: str) -> Side:
    """One who did it, by processor time, which others on the machine change less; told over the wall's."""
    if not isinstance(runs, str):
        busy = statistics.median(run.processor / run.wall for run in runs)
        note = "; ".join(filter(None, (f"1 thread, processor over wall {busy:.2f}", note)))
        runs = [Spent(run.processor) for run in runs]
    return Side.of(TITLES[key], runs, case.counts[key], note, short)


def measure(quick: bool, chosen: Sequence[str]) -> Iterator[Row]:
    """All comparisons."""
    pythons: dict[str, Path | str] = {}
    for case in cases(quick, chosen):
        for peer in PEERS:
            if peer.key in case.counts and peer.key not in pythons:
                try:
                    pythons[peer.key] = install(peer)
                except RunError as error:
                    pythons[peer.key] = str(error)
        yield compare(case, pythons, 3 if quick else 9, 3.0 if quick else 8.0)
