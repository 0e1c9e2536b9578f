"""Before anyone captures an image: how well a calibration will do, and which change would help most."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

import numpy as np

from ..camera import Camera
from ..design import Design
from ..theory.exit_pupil import microlens_image_diameter
from ..theory.length_covariance import CalibratedLengths
from ..theory.vignetting import lit_radius
from ..words import sentence, within
from .corner_statistics import StatisticsFit, corner_statistics, fit_at
from .corners import LEAST_CELL
from .epilines import fit_lines
from .fit import shared_names
from .frames import Array, CalibrationError
from .least_squares import undetermined
from .lengths import calibrated_lengths
from .model import QUANTITIES, Board, DataSheet, Intrinsics, Observations, Poses, derived, project_boards
from .posterior import laplace_draws, variance_shares
from .sidedata import SideDatum, image_pitch, white_pitch
from .space import ApparentCamera, shown_by

DRAWS = 20_000
"""Number of drawn cameras for the covariance of their lengths: standard deviations to 0.5 %."""
MOST_CORNERS = 10_000
"""Largest number of corners in a plan, over all its images: beyond it, time and memory grow and accuracy hardly does.
"""
LEAST_GAIN = 1.1
"""Standard deviation before over after from which a change is advised."""
NO_GAIN = "No single change helps by more than 10 %."
RESERVE = 0.1
"""Standard deviation over a quantity's size from which it is quoted with reserve alone; from 1 on it is not quoted."""
_NEAR = 0.1
"""d_3 over d_1 below which d_3, which may be 0, is held against d_1 in its place."""
_INFINITE = 1e-9
"""Magnification of the main lens below which its focus is at infinity: no board tells it from 0."""
_LEAST = 3
"""Number of boards that a plan is looked at with, at least."""
_STEEPEST = math.radians(40.0)
"""Beyond this tilt corners are no longer found well."""
USUAL = Board(4, 5, 6.0)
"""The board of plans for which it is small enough."""
_CELLS, _FEWER, _ROOM = (4, 5), (4, 4), 0.8
"""Any other board of our own choosing: its cells, and the share of the narrower field that it may fill at its nearest.
"""
_WIDEST = 1000.0
"""Longest side of a board that anybody makes [mm]."""
_ROUND, _FINE = (1, 2, 5), (1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8)
"""Sizes of its cells, in powers of ten."""


@dataclass(frozen=True)
class Captures:
    """Planned captures of a board."""

    board: Board = USUAL
    boards: int = 12
    """Images of the board."""
    distance: float = 350.0
    """Mean distance of the boards from the main lens [mm]."""
    distance_range: float = 60.0
    """Farthest minus nearest [mm]."""
    tilt: float = math.radians(20.0)
    """Largest tilt [rad]."""
    offset: float = 8.0
    """Largest sideways displacement of a board's middle from the axis, per axis [mm]."""
    noise: float = 0.06
    """Standard deviation of one corner coordinate in one view [pitches of the view's samples]."""
    views: int = 5
    """Views across the pupil, per axis."""
    reach: float = 5.0
    """Outermost view from the centre [px]."""

    def __post_init__(self) -> None:
        if self.views < 1 or self.views == 2:
            raise CalibrationError(f"views across the pupil must be 1, or 3 or more, got {self.views}")
        if self.boards < 1:
            raise CalibrationError(f"at least one image of the board is needed, got {self.boards}")
        corners = self.boards * len(self.board.points)
        if corners > MOST_CORNERS:
            raise CalibrationError(
                f"{self.boards} images of a {self.board.columns} x {self.board.rows} board hold {corners} corners;"
                f" a plan takes at most {MOST_CORNERS}: fewer images or cells"
            )
        for name in ("distance", "noise"):
            if not getattr(self, name) > 0:
                raise CalibrationError(f"{name} must be positive, got {getattr(self, name)}")
        if not 0 <= self.tilt < math.pi / 2:
            raise CalibrationError(f"boards cannot be tilted by {math.degrees(self.tilt):g} degrees; stay below 90")

    @classmethod
    def for_design(
        cls,
        design: Design,
        *,
        board: Board | None = None,
        boards: int = 12,
        tilt: float = math.radians(20.0),
        distance: float | None = None,
        distance_range: float | None = None,
        noise: float = 0.06,
    ) -> Captures:
        """Captures planned for a design; lengths in mm, the tilt in radians.

        Not given, the board is one of 4 x 5 cells, of 6 mm where the sensor sees it whole at its nearest, and distances
        lie about the focal plane, over a quarter of the way from the FAP to it, or from the lens where the FAP lies
        behind; at the nearest, half way from what stands in the bore to the focal plane.

        Raises
        ------
        CalibrationError
            A number out of range.
        """
        if distance_range is not None and distance_range < 0:
            raise CalibrationError(f"a range of distances is not negative, got {distance_range:g} mm")
        middle = design.d_f if distance is None else distance
        pupil = pupil_of(design)
        camera = Camera.of(design)
        room = max(middle - max(pupil, float(camera.chain.end(camera.numbers))), 0.0)
        spread = min((design.d_f - max(pupil, 0.0)) / 4, room) if distance_range is None else distance_range
        image = abs(float(microlens_image_diameter(camera) * camera.fap.outline.slimness))
        nearest = middle - spread / 2
        board = fitting_board(design, nearest, middle + spread / 2) if board is None else board
        # Aside by no more than leaves its corners in the field where that is smallest.
        room = (min(field_at(design, nearest)) - board.cell * max(board.inner)) / 2
        return cls(
            board=board,
            boards=boards,
            distance=middle,
            distance_range=spread,
            tilt=tilt,
            offset=max(min(0.035 * (middle - pupil), room), 0.0),
            noise=noise,
            # As far out as corners are followed: views at the pupil's rim are left out.
            reach=0.385 * min(design.d, image) / design.q,
        )

    @property
    def ends(self) -> tuple[float, float]:
        """Middles of the nearest board and of the farthest one, from the main lens [mm]."""
        half = self.distance_range / 2 * (1 - 1 / self.boards)
        return self.distance - half, self.distance + half

    def view_grid(self) -> Array:
        """(s', t') of the views inside a disc in the pupil [px], shape (v, 2)."""
        if self.views == 1:
            return np.zeros((1, 2))
        s, t = np.meshgrid(*2 * [np.linspace(-self.reach, self.reach, self.views)])
        inside = np.hypot(s, t) <= (1.0 + 1e-9) * self.reach
        return np.stack([s[inside], t[inside]], axis=-1)


def camera_of(design: Design, f: float | None = None) -> Intrinsics:
    """The calibration's parameters of a design, the axis at the middle of its array.

    With `f` [mm], of a camera built to it whose main lens has that focal length: d_1, d_2 and the FAP stay.
    """
    shown = _shown(design, f)
    x_0, y_0 = (size / design.d / 2 for size in design.sensor_size)
    return Intrinsics(float(shown.A), float(shown.m), 1 / float(shown.d_2), x_0, y_0, q=design.q, d=design.d)


def pupil_of(design: Design) -> float:
    """Where the boards' medium has the FAP: before the main lens with a ruler [mm]."""
    return float(_shown(design).pupil)


def _shown(design: Design, f: float | None = None) -> ApparentCamera:
    return shown_by(design, None if f is None else {"f": np.asarray(f), "d_1": np.asarray(Camera.of(design).seen.d_1)})


def field_at(design: Design, distance: float) -> tuple[float, float]:
    """Width and height [mm] of the plane at `distance` from the main lens that the sensor sees, by chief rays.

    Where light ends before its corners, of the part of its shape whose corners are lit.
    """
    camera = camera_of(design)
    lit = float(lit_radius(Camera.of(design), (camera.x_0, camera.y_0)))
    scale = 2 * camera.d * abs(distance - pupil_of(design)) / camera.A
    scale *= min(1.0, max(lit, camera.d) / (camera.d * math.hypot(camera.x_0, camera.y_0)))
    return camera.x_0 * scale, camera.y_0 * scale


def fitting_board(design: Design, nearest: float, farthest: float) -> Board:
    """Board that the sensor sees whole at its nearest and whose cells are told apart as far as any board's are [mm].

    The usual one where that will do to the farthest, else 4 x 5 cells of 1, 2 or 5 times a power of ten, else of less
    round sizes, else fewer cells.
    """
    width, height = sorted(field_at(design, nearest))
    boards = [USUAL] if USUAL.columns * USUAL.cell <= width and USUAL.rows * USUAL.cell <= height else []
    for (columns, rows), steps in ((_CELLS, _ROUND), (_CELLS, _FINE), (_FEWER, _FINE)):
        largest = min(_ROOM * min(width / columns, height / rows), _WIDEST / rows)
        decade = 10.0 ** math.floor(math.log10(largest))
        cell = max(step * decade for step in steps if step * decade <= largest * (1 + 1e-9))
        boards.append(Board(columns, rows, float(f"{cell:.3g}")))
    return max(boards, key=lambda board: min(told_apart_to(design, board), farthest))


def told_apart_to(design: Design, board: Board) -> float:
    """Farthest distance from the main lens at which a board's cells are large enough for their corners [mm]."""
    camera = camera_of(design)
    return pupil_of(design) + board.cell * abs(camera.A) / (LEAST_CELL * camera.d)


def too_large(design: Design, captures: Captures) -> str:
    """A clause where the sensor cannot see the whole board at its nearest, as plans count every corner; else ""."""
    board, nearest = captures.board, captures.distance - captures.distance_range / 2
    sides, field = sorted((board.columns * board.cell, board.rows * board.cell)), sorted(field_at(design, nearest))
    if all(side <= extent for side, extent in zip(sides, field, strict=True)):
        return ""
    return (
        f"the board measures {sides[0]:.4g} x {sides[1]:.4g} mm, but the sensor sees only {field[0]:.3g} x"
        f" {field[1]:.3g} mm at its nearest, and the plan counts every corner as seen"
    )


def smaller_board(design: Design, captures: Captures) -> str:
    """Remedy where a board is too large for its captures."""
    half = captures.distance_range / 2
    fitting = fitting_board(design, captures.distance - half, captures.distance + half)
    return f'choose a smaller `board`, such as "{fitting.text}"'


def random_poses(captures: Captures, pupil_distance: float, rng: np.random.Generator) -> Poses:
    """Poses as a person would choose them: distances spread evenly, tilts in every direction, boards turned in hand.

    `pupil_distance` is that from lens to FAP [mm], as the boards' medium has it: poses are in the FAP's frame.
    """
    n = captures.boards
    spread = (np.arange(n) + 0.5) / n - 0.5 if n > 1 else np.zeros(1)
    depth = captures.distance - pupil_distance + captures.distance_range * rng.permutation(spread)
    size, towards = captures.tilt * np.sqrt(rng.uniform(0, 1, n)), rng.uniform(0, 2 * math.pi, n)
    turn = rng.uniform(-math.pi / 8, math.pi / 8, n)
    rotation = np.column_stack([size * np.cos(towards), size * np.sin(towards), turn])
    aside = rng.uniform(-captures.offset, captures.offset, (n, 2))
    return Poses(rotation, np.column_stack([aside, depth]))


def synthetic_observations(
    camera: Intrinsics, poses: Poses, captures: Captures, rng: np.random.Generator | None = None
) -> Observations:
    """Corners where the model puts them; with `rng` each coordinate in each view off by independent normal errors."""
    views = captures.view_grid()
    uv = project_boards(camera.vector(), poses.vector, captures.board.points, views).values
    if rng is not None:
        uv = uv + captures.noise * rng.normal(size=uv.shape)
    return Observations(captures.board.points, views, uv)


Trust = Literal["good", "caution", "bad"]
"""Whether a signed calibration may quote a quantity: yes, with reserve, no."""


def sizes_of(values: Mapping[str, float]) -> dict[str, float]:
    """Sizes that standard deviations are held against [mm or 1]: the quantities' own, of a d_3 near 0 that of d_1."""
    sizes = {name: abs(float(value)) for name, value in values.items()}
    return sizes | ({"d_3": max(sizes["d_3"], d_1)} if sizes["d_3"] < _NEAR * (d_1 := sizes.get("d_1", 0.0)) else {})


def trust_in(name: str, sigma: Mapping[str, float], sizes: Mapping[str, float]) -> Trust:
    """Trust in a quantity: none where sigma is its size or more; of d_f = f (1 + m)/m, where m's is.

    1/H = 1 - d_3/d_f is linear in m about m = 0, so that H is known where d_f, infinite, is not.
    """
    by = {name, "m"} & sigma.keys() if name == "d_f" else {name}
    if not all(sigma[one] < sizes[one] for one in by):
        return "bad"
    return "caution" if sigma[name] > RESERVE * sizes[name] else "good"


class _ExpectedErrors(NamedTuple):
    """Standard deviations that a plan promises."""

    sigma: dict[str, float]
    """Standard deviations of A, m, d_2, d_1, d_f, H, d_3 [mm or 1]: medians over random sets of poses."""
    shares: dict[str, dict[str, float]]
    """For each, what share of its variance comes from images, f, q, d and the board."""
    condition: float
    """Condition number of the fit."""
    correlation: float
    """Between A and 1/d_2, the ridge along which calibrations err."""
    typical: tuple[StatisticsFit, tuple[SideDatum, ...]]
    """Fit to the set of poses of which half know d_3 better, with its side data."""

    def lengths(self, design: Design, sheet: DataSheet) -> CalibratedLengths:
        """How sure the camera's lengths will be, together, of that set of poses."""
        fit, data = self.typical
        draws = laplace_draws(fit, sheet, DRAWS, np.random.default_rng(0), data)
        return calibrated_lengths(design, draws, fit, sheet, data, planned=True)


class _PlanChange(NamedTuple):
    """Change of the planned captures: one that would help, or fewer boards."""

    what: str
    expected: _ExpectedErrors
    sheet: DataSheet
    """Knowledge beforehand, once it is made."""

    def gain(self, before: _ExpectedErrors, name: str = "d_3") -> float:
        """Standard deviation before over after."""
        return before.sigma[name] / self.expected.sigma[name]


class CapturePlan(NamedTuple):
    """Plan of a set of captures: expected errors, and changes ranked."""

    captures: Captures
    expected: _ExpectedErrors
    changes: tuple[_PlanChange, ...]
    """Best first, by d_3."""
    sizes: Mapping[str, float]
    """Sizes that standard deviations are held against, as `sizes_of` has them."""
    distortion: int = 0
    """Radial coefficients that the calibration will fit."""

    @property
    def quantities(self) -> tuple[str, ...]:
        """Quantities that have a size to be known by: not d_f and m of a main lens that is focused at infinity."""
        far = self.sizes["m"] < _INFINITE
        return tuple(name for name in QUANTITIES if not (far and name in ("d_f", "m")))

    def determined(self, name: str, expected: _ExpectedErrors | None = None) -> bool:
        """True where a quantity is known to less than its size."""
        return self.trust(name, expected) != "bad"

    def trust(self, name: str, expected: _ExpectedErrors | None = None) -> Trust:
        """Trust in a quantity, by captures alone."""
        return trust_in(name, (expected or self.expected).sigma, self.sizes)

    @property
    def advice(self) -> str:
        """The change that helps most, in one sentence; where none helps, that."""
        if not self.changes or self.changes[0].gain(self.expected) < LEAST_GAIN:
            return NO_GAIN
        best = self.changes[0]
        before, after = self.expected.sigma, best.expected.sigma
        gains = [
            f"{name} to {within(after[name], '±')}{unit} instead of {within(before[name], '±')}{unit}"
            for name, unit in (("d_3", " mm"), ("H", ""))
            if self.determined(name) and best.gain(self.expected, name) >= LEAST_GAIN
        ]
        gains = gains or [f"d_3 to {within(after['d_3'], '±')} mm"]
        return sentence(f"{best.what}: {', '.join(gains)}")

    def to_dict(self, design: str, seed: int) -> dict[str, object]:
        """As JSON's types, with the design's name and what the plan was made with."""
        s, before = self.captures, self.expected
        return {
            "schema": "roslf.calibration-plan/1",
            "design": design,
            "captures": {
                "board": s.board.to_dict(),
                "boards": s.boards,
                "distance_mm": s.distance,
                "range_mm": s.distance_range,
                "tilt_deg": math.degrees(s.tilt),
                "offset_mm": s.offset,
                "noise_pitches": s.noise,
                "views_across": s.views,
                "reach_px": s.reach,
            },
            "expected_sigma": before.sigma,
            "variance_shares": before.shares,
            "condition_number": before.condition,
            "correlation_A_inverse_d_2": before.correlation,
            "changes": [
                {"change": c.what, "expected_sigma": c.expected.sigma, "gain_d_3": c.gain(before)} for c in self.changes
            ],
            "advice": self.advice,
            "distortion_coefficients": self.distortion,
            "seed": seed,
        }


def expected_errors(
    camera: Intrinsics,
    sheet: DataSheet,
    captures: Captures,
    *,
    distortion: int = 0,
    seed: int = 0,
    samples: int = 8,
    white: float | None = None,
) -> _ExpectedErrors:
    """Standard deviations from the Fisher matrix, poses eliminated, data-sheet errors added.

    `white` is the relative standard deviation of the white image's pitch, where that is used; `distortion` counts the
    radial coefficients that the calibration will fit; medians are over so many `samples` of random poses.

    Raises
    ------
    CalibrationError
        The captures do not determine A, m or d_2, and says why.
    """
    names, pupil = shared_names(distortion), _pupil(camera, sheet)
    end, what = max((pupil, "FAP is"), (0.0 if sheet.space is None else sheet.space.end, "farthest element ends"))
    if captures.distance - captures.distance_range / 2 <= end:
        instead = f"a distance beyond {end + captures.distance_range / 2:.1f} mm fits"
        if captures.distance > end:
            instead = f"a range of {captures.distance - end:.3g} mm fits there, half way to it at the nearest"
        raise CalibrationError(
            f"boards at {captures.distance:g} mm over {captures.distance_range:g} mm reach into the bore: the {what} at"
            f" {end:.1f} mm from the lens; {instead}"
        )
    if captures.views == 1 or captures.boards == 1:
        raise CalibrationError(f"these captures do not determine A, m and d_2: {reason(captures)}")
    shares, fits = [], []
    for k in range(samples):
        rng = np.random.default_rng([seed, k])
        poses = random_poses(captures, pupil, rng)
        observations = synthetic_observations(camera, poses, captures)
        statistics = corner_statistics(observations, fit_lines(observations), captures.noise)
        fit = fit_at(statistics, camera, poses, names)
        lost = undetermined(fit.covariance, camera, captures.boards)
        if lost:
            raise CalibrationError(f"these captures do not determine {lost}: {reason(captures)}")
        pitch = float(image_pitch(camera.vector(), sheet))
        data = () if white is None else (white_pitch(fit, sheet, pitch, white),)
        fits.append((fit, data))
        shares.append(variance_shares(fit, sheet, data))
    sigma = {name: float(np.median([one[name]["sigma"] for one in shares])) for name in shares[0]}
    middle = int(np.argsort([one["d_3"]["sigma"] for one in shares])[samples // 2])
    typical = {name: {s: v for s, v in part.items() if s != "sigma"} for name, part in shares[middle].items()}
    covariance = fits[middle][0].covariance
    return _ExpectedErrors(sigma, typical, covariance.condition, float(covariance.correlation[0, 2]), fits[middle])


def _pupil(camera: Intrinsics, sheet: DataSheet) -> float:
    return float(sheet.apparent(derived(camera.vector(), sheet)).pupil)


def plan(
    camera: Intrinsics,
    sheet: DataSheet,
    captures: Captures,
    *,
    distortion: int = 0,
    seed: int = 0,
    samples: int = 8,
    white: float | None = None,
    accepts: Callable[[Captures], bool] = lambda _: True,
) -> CapturePlan:
    """Expected errors of a set of captures, and of those that differ from it by one change, best first.

    Parameters and errors as in `expected_errors`; a change that cannot be made (a tilt beyond 40 degrees, boards in
    the bore) or whose captures nobody `accepts` is left out.
    """
    expected = functools.partial(
        expected_errors, camera, distortion=distortion, seed=seed, samples=samples, white=white
    )
    before = expected(sheet, captures)
    changes = []
    for what, other, known in _alternatives(captures, sheet):
        if other is not captures and not accepts(other):
            continue
        try:
            after = expected(known, other)
        except CalibrationError:
            continue
        changes.append(_PlanChange(what, after, known))
    changes.sort(key=lambda change: change.expected.sigma["d_3"])
    sizes = sizes_of({name: float(value) for name, value in derived(camera.vector(), sheet).items()})
    return CapturePlan(captures, before, tuple(changes), sizes, distortion)


def reason(captures: Captures) -> str:
    """Reason why captures leave a parameter open."""
    if captures.tilt < math.radians(3.0):
        tilts = f"tilts up to {math.degrees(captures.tilt):.1f} degrees"
        return f"the boards are all parallel ({tilts}); tilt them by up to 20 degrees"
    if captures.boards == 1:
        return "one image of the board cannot separate its distance from A; show two or more, tilted differently"
    if captures.views == 1:
        return "there is one view only, and d_2 and m need a baseline"
    if captures.distance_range < 0.02 * captures.distance:
        return "the boards stand at one depth; spread their distances"
    return "too few boards, too small tilts or too much noise"


def fewer_boards(captures: Captures) -> str:
    """Name of the change that leaves every second board out."""
    return f"show {captures.boards // 2} boards instead of {captures.boards}"


def _alternatives(captures: Captures, sheet: DataSheet) -> Iterator[tuple[str, Captures, DataSheet]]:
    board = captures.board
    tilt = min(max(1.5 * captures.tilt, math.radians(10.0)), _STEEPEST)
    n, spread = captures.boards, captures.distance_range
    shown: dict[str, dict[str, Any]] = {
        f"show {2 * n} boards instead of {n}": {"boards": 2 * n},
        **({fewer_boards(captures): {"boards": n // 2}} if n // 2 >= _LEAST else {}),
        f"spread the distances over {2 * spread:.4g} mm": {"distance_range": 2 * spread},
        "halve the corner noise": {"noise": captures.noise / 2},
    }
    columns, rows, cell, marks = board.columns, board.rows, board.cell, board.markers
    with suppress(CalibrationError):
        larger = replace(board, columns=2 * columns - 1, rows=2 * rows - 1)
        shown[f"use a board of {larger.columns} x {larger.rows} cells of the same size"] = {"board": larger}
    with suppress(CalibrationError):
        smaller = marks and marks._replace(width=marks.width / 2)
        finer = Board(2 * columns, 2 * rows, cell / 2, smaller)
        shown[f"use {finer.columns} x {finer.rows} cells of {finer.cell:g} mm on the same board"] = {"board": finer}
    if tilt > 1.01 * captures.tilt:
        degrees = (math.degrees(angle) for angle in (tilt, captures.tilt))
        shown["tilt the boards by up to {:.0f} degrees instead of {:.0f}".format(*degrees)] = {"tilt": tilt}
    known = {"f": "f_sigma", "the microlens pitch": "d_sigma", "the board's scale": "cell_sigma"}
    for what, changes in shown.items():
        with suppress(CalibrationError):  # more corners than a plan takes
            yield what, replace(captures, **changes), sheet
    for what, name in known.items():
        halved: dict[str, Any] = {name: getattr(sheet, name) / 2}
        yield f"know {what} twice as well", captures, replace(sheet, **halved)
    if sheet.uncertain:
        finer_known = tuple(known._replace(sigma=known.sigma / 2) for known in sheet.uncertain)
        yield "know what stands before the lens twice as well", captures, replace(sheet, uncertain=finer_known)
