"""The numbers of a build that can be held to limits, over fields and trials: `QUANTITIES`, and what a decoder gets."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from .._arrays import Array
from ..bore.chain import MEDIUM
from ..bore.conjugates import CONJUGATES
from ..bore.main_lens import IdealMainLens, RealMainLens, SheetMainLens
from ..bore.part import TEMPERATURE
from ..camera import TEMPERATURES, Camera, Number
from ..design import PATHS, Design
from ..evaluation.field_images import FieldImages, rays_tell
from ..theory.depth_budget import COVERAGE, depth_budget
from ..theory.depth_of_field import depth_of_field
from ..theory.field_of_view import focus_ahead
from ..theory.focused import is_focused
from ..theory.quantities import DECODED, QUANTITIES
from ..theory.quantity import Quantity
from ..theory.tube import WALL
from .ideal import IdealBuilds
from .places import CALIBRATION, FOCUSING, LEFT, LENSLETS, nominal_values, of_parts
from .traced import AS_IF_THIN, TracedBuilds, as_built, real_lens_builds

METRICS = {
    name: quantity
    for name, quantity in QUANTITIES.items()
    if name not in PATHS and (quantity.local is not None or quantity.at != "needed")
} | DECODED
"""Every metric by its name: what has a value at fields has one at each, the rest one for the whole camera. Names and
values follow `roslf evaluate --json` where it has them."""

DISTANT = {name: quantity for name, quantity in QUANTITIES.items() if name not in PATHS and quantity.of is not None}
"""Quantities of the whole camera, asked for ahead of the bore's tip where they may be: some are metrics there alone."""


SHAPES = frozenset({"kept_fraction", "image_area_mm2", "axis_ratio"})
"""Metrics of the shapes that rims leave of images."""
IN_USE = frozenset((TEMPERATURE, MEDIUM, PATHS["wavelength"]))
"""Places that tell where a camera is used, not how it is built."""
STEP = 1e-2
"""Share of d_1 by which a lens is moved to see how focus follows: exact, whatever it is."""
WORTH_ASKING = 0.9
"""Share of builds that are cameras below which these alone are measured: the others' numbers mean nothing."""


@dataclass(frozen=True)
class Column:
    """One metric at one field (None: the whole camera)."""

    metric: str
    field: int | None
    at: float | None = None
    """Distance ahead of the bore's tip that a whole camera's is asked for at [mm]; None: wherever it is without one."""

    @property
    def quantity(self) -> Quantity:
        """The metric itself."""
        first, second = (METRICS, DISTANT) if self.at is None else (DISTANT, METRICS)
        return first.get(self.metric) or second[self.metric]

    @property
    def label(self) -> str:
        """E.g. ``kept_fraction@2``, ``u_z_mm at 15 mm``."""
        where = "" if self.at is None else f" at {self.at:g} mm"
        return f"{self.metric}{where}" if self.field is None else f"{self.metric}@{self.field}"


@dataclass(frozen=True)
class Question:
    """Question put to every build: a nominal design, metrics, fields, and where the depth target stands."""

    design: Design
    metrics: tuple[str, ...]
    fields: tuple[tuple[float, float], ...]
    """Microlens positions on the array [mm]."""
    object_distance: float
    """Z of the decoder's target, in front of the main lens [mm]."""
    distant: tuple[Column, ...] = ()
    """Metrics asked for ahead of the bore's tip."""

    @property
    def columns(self) -> tuple[Column, ...]:
        """Every metric at every field it has, metric by metric; then those at distances."""
        count = len(self.fields)
        columns = (
            Column(name, field)
            for name in self.metrics
            for field in ((None,) if METRICS[name].local is None else range(count))
        )
        return (*columns, *self.distant)

    def limited_to(self, columns: Iterable[Column]) -> Question:
        """The question of these columns' metrics alone, in their order."""
        asked = tuple(columns)
        metrics = dict.fromkeys(column.metric for column in asked if column.at is None)
        return replace(self, metrics=tuple(metrics), distant=tuple(c for c in dict.fromkeys(asked) if c.at is not None))

    @property
    def infinite(self) -> NDArray[np.bool_]:
        """Which columns may be infinite, shape (columns,)."""
        return np.array([column.quantity.infinite for column in self.columns], bool)


def evaluate_builds(question: Question, values: Mapping[str, Array], trials: int, *, calibrated: bool = False) -> Array:
    """Every column of a question for many builds.

    Parameters
    ----------
    question : Question
        What is asked.
    values : mapping
        Perturbable place to its numbers in each build, shape (trials,); places left out are nominal. Of f, d_f and d_1
        the same one follows as in `Design.replace`: f and d_1 are hardware and d_f follows; where d_f is given, d_1 is
        refocused to it.
    trials : int
        How many builds.
    calibrated : bool
        Whether the decoder was calibrated on each build, else it believes in the nominal design. Depth is then off by
        what the calibration leaves, if that is among the numbers.

    Returns
    -------
    ndarray, shape (columns, trials)
        NaN marks what is undefined: every column of a build that is no camera (d_3 >= d_f, a size below zero), the
        shape of a dark image, a depth decoded at infinity. What may be infinite (`Quantity.infinite`) stays so.
    """
    if all(place in values for place in CONJUGATES):  # where a part is adjusted to d_f: f follows
        values = {place: numbers for place, numbers in values.items() if place != CONJUGATES[0]}
    results = np.full((len(question.columns), trials), np.nan)
    row = 0
    # What a build leaves undefined divides by zero somewhere; it is told apart below, once.
    with np.errstate(all="ignore"):
        builds, valid = builds_of(question, values, trials, calibrated=calibrated)
        count = np.count_nonzero(valid)
        if count < WORTH_ASKING * trials:
            some = {place: numbers[valid] for place, numbers in values.items()}
            if count:
                results[:, valid] = evaluate_builds(question, some, int(count), calibrated=calibrated)
            return results
        for metric in (METRICS[name] for name in question.metrics):
            rows = 1 if metric.local is None else len(question.fields)
            results[row : row + rows] = (
                of_cameras(question.design, metric, builds.camera) if metric.local is None else metric.local(builds)
            )
            if metric.name == "depth_error_mm" and calibrated:
                results[row : row + rows] += values.get(LEFT + CALIBRATION, 0.0)
            row += rows
        for column in question.distant:
            results[row] = of_cameras(question.design, column.quantity, builds.camera, column.at)
            row += 1
    if not valid.all():
        results[:, ~valid] = np.nan
    told = np.isfinite(results)
    if not told.all():
        told |= question.infinite[:, None] & (results == np.inf)
        results[~told] = np.nan
    return results


def of_cameras(design: Design, quantity: Quantity, camera: Camera, at: float | None = None) -> Array:
    """A quantity of whole builds, behind a real lens as many times the thin-lens models' as rays tell at nominal."""
    share = share_by_rays(design, quantity.name, at)
    return quantity(camera, at) * (1.0 if share is None else share)


@lru_cache(maxsize=64)
def share_by_rays(design: Design, name: str, at: float | None) -> float | None:
    """Value that rays of a design tell of a quantity of the whole camera, over that of its thin-lens model.

    None of what rays do not tell, or cannot. Behind the paper's singlet builds' own rays differ from so many times
    their thin-lens models by .03 deg and .02 mm, without it by 3 deg and 2.7 mm; detail scatters by more than that. Of
    the undistorted field, there 18 % smaller than the model's, misses of FAP and array move it by .4 to .9 as much.
    """
    asked = DISTANT.get(name)  # of decoders it is no quantity of a design
    if asked is None or asked.of_rays is None or not design.main_lens.kind.mounted:
        return None
    ((share,), _) = rays_tell(lambda: design, [(asked, at)], FieldImages.share)
    return None if share is None or math.isnan(share) else share


def _lenslet_offsets(question: Question, values: Mapping[str, Array]) -> tuple[Number, Number] | None:
    """How far each field's microlens is from where the pitch has it, x and y [mm], (fields, trials); None: nowhere."""
    if not any(place.startswith(LENSLETS) for place in values):
        return None
    x, y = (
        np.stack(
            np.broadcast_arrays(
                *(values.get(f"{LENSLETS}{k}.decentre.{axis}", 0.0) for k in range(len(question.fields))),
            )
        )
        for axis in (0, 1)
    )
    return (x[:, None] if x.ndim == 1 else x), (y[:, None] if y.ndim == 1 else y)


_Asked = tuple[tuple[tuple[float, float], ...], float, bool, tuple[Number, Number] | None]
"""Fields, object distance, whether calibrated, and lenslets' offsets, as builds take them."""


class _IdealMount:
    """Builds of a design behind an ideal lens: cameras with other numbers."""

    left_out: ClassVar[Mapping[str, str]] = {}
    """Quantities whose formulas leave out what its lens does, and what they leave out."""

    def __init__(self, design: Design, values: Mapping[str, Array], trials: int) -> None:
        self.design, self.nominal, self.changes = design, Camera.of(design), values
        self.sound = np.ones(trials, np.bool_)

    @property
    def faults(self) -> dict[str, NDArray[np.bool_]]:
        """Why builds cannot be put together, beside what their cameras tell."""
        return {}

    @staticmethod
    def built(design: Design, changes: Mapping[str, float]) -> Design:
        """One build as a design."""
        return design.replace(changes)

    @staticmethod
    def method(shapes: bool, discs: bool) -> str:
        """How each build is computed: shapes asked for or not, their rims discs on the sensor or not."""
        rims = "discs (to 1e-15)" if discs else "ellipses (to 1e-13)"
        return f"each by closed forms{f', microlens images as intersections of {rims}' if shapes else ''}"

    @staticmethod
    def in_closed_form(design: Design) -> bool:
        """True where all fields of a build have the same value, a closed form of its lengths."""
        return design.sees_discs

    def builds(self, camera: Camera, rest: _Asked, afresh: bool) -> IdealBuilds:
        """Builds whose cameras, or their thin-lens models, are known; `rest` as `IdealBuilds` takes it."""
        return IdealBuilds(camera, self.nominal, *rest)


class _RealMount(_IdealMount):
    """Builds of a design behind a real lens, whose parts keep the places that the nominal lens gave them."""

    left_out = AS_IF_THIN

    def __init__(self, design: Design, values: Mapping[str, Array], trials: int) -> None:
        super().__init__(design, values, trials)
        self.made = real_lens_builds(design, values, trials)
        self.changes, self.sound = self.made.thin_equivalents, self.made.sound
        if TEMPERATURE in values:  # lengths are as they are then
            self.nominal = self.nominal.as_measured

    @property
    def faults(self) -> dict[str, NDArray[np.bool_]]:
        """Lenses that cannot be made, or that something touches."""
        return {"main lens impossible as made, or touched": ~self.sound}

    @staticmethod
    def built(design: Design, changes: Mapping[str, float]) -> Design:
        """One build, whose lens is as made."""
        return as_built(design, changes)

    @staticmethod
    def method(shapes: bool, discs: bool) -> str:
        """By rays, whatever is asked for."""
        return "each by exact rays through its own lens, shapes by series along the pupil's rim"

    @staticmethod
    def in_closed_form(design: Design) -> bool:
        """False: rays tell."""
        return False

    def builds(self, camera: Camera, rest: _Asked, afresh: bool) -> IdealBuilds:
        """Builds with everything of a field traced."""
        return TracedBuilds(self.design, self.made, camera, *rest, afresh=afresh)


_MOUNTS = {IdealMainLens: _IdealMount, SheetMainLens: _IdealMount, RealMainLens: _RealMount}


def _mount(design: Design, values: Mapping[str, Array], trials: int) -> _IdealMount:
    """Builds of a design at numbers of its places, behind its own kind of main lens."""
    return mount_of(design)(design, of_parts(design, values), trials)


def mount_of(design: Design) -> type[_IdealMount]:
    """Builds behind a design's own kind of main lens, before there are any."""
    return _MOUNTS[type(design.main_lens.kind)]


def design_built(design: Design, changes: Mapping[str, float]) -> Design:
    """Design of one build with these numbers at its places: of a rim that is the tube's own bore the wall moves."""
    return mount_of(design).built(design, {**changes, **_wall_bored(design, changes)})


def _wall_bored(design: Design, changes: Mapping[str, float]) -> dict[str, float]:
    """Wall of a build whose own bore came out wider than the nominal tube leaves, at its place; nothing of others."""
    tube, build = design.tube, design.unchecked(changes)
    if tube is None:
        return {}
    bores = (rim for rim in build.all_stops if rim.bore)
    wider = max((2 * float(rim.outline.reach) - tube.room(build.tip - rim.stands) for rim in bores), default=0.0)
    return {WALL: tube.wall - wider / 2} if wider > 0 else {}


def builds_of(
    question: Question, values: Mapping[str, Array], trials: int, *, calibrated: bool = False, afresh: bool = False
) -> tuple[IdealBuilds, NDArray[np.bool_]]:
    """Builds of a question, parameters as for `evaluate_builds`, and which of them are cameras.

    The others have nominal numbers, which mean nothing. `afresh` is for builds behind a real lens that are far from the
    nominal design: each one's rays are found from its own thin-lens model.
    """
    rest = question.fields, question.object_distance, calibrated, _lenslet_offsets(question, values)
    mount = _mount(question.design, values, trials)
    nominal, changes = mount.nominal, mount.changes
    if TEMPERATURE in values:  # builds that differ in it: `u_z_mm` is not to count it once more
        nominal = nominal.without(TEMPERATURES)
    camera = nominal.replace(changes)
    valid = np.broadcast_to(camera.valid, (trials,))
    if not valid.all():
        camera = nominal.replace({place: np.where(valid, value, nominal[place]) for place, value in changes.items()})
    return mount.builds(camera, rest, afresh), valid & mount.sound


def focus_moves(question: Question, values: Mapping[str, Array], trials: int, place: str = FOCUSING) -> Array:
    """Moves of a place that focus builds at assembly, shape (trials,) [mm]; NaN where none would.

    In focus is then what stands as far ahead of each one's tip as the design has it, in the design's own temperature,
    medium and light. Parameters as for `evaluate_builds`. The array follows from its conjugate; as a lens in the bore
    moves, B of the way from there to the array is of second degree, and its nearer root is taken.
    """
    built = {place: numbers for place, numbers in values.items() if place not in IN_USE}

    def out_of_focus(move: float) -> Number:
        mount = _mount(question.design, built | {place: built.get(place, own) + np.full(trials, move)}, trials)
        camera = mount.nominal.replace(mount.changes)
        asked = camera.tip + focus_ahead(mount.nominal)
        if place == FOCUSING:
            return camera.chain.followed({**camera.numbers, CONJUGATES[1]: asked}, place) - camera[place]
        seen = camera.plane(asked)
        return seen.b + camera.seen.d_1 * (seen.a - seen.b / camera.f)

    own = nominal_values(question.design)[place]
    with np.errstate(all="ignore"):
        here = np.broadcast_to(out_of_focus(0.0), (trials,))
        if place == FOCUSING:
            return here
        step = STEP * question.design.d_1
        behind, ahead = out_of_focus(-step), out_of_focus(step)
        slope, bend = (ahead - behind) / 2, (ahead + behind) / 2 - here
        return np.asarray(-2 * step * here / (slope + np.copysign(np.sqrt(slope**2 - 4 * bend * here), slope)))


def focus_shown(question: Question, place: str) -> tuple[float, float]:
    """Half-widths within which a design's own views show where its focus is: ahead of the tip, and of a place [mm].

    U, k = 2, of one measurement there without what all have alike, as lengths; no more than half a view's depth of
    field. Not finite where nothing shows it.
    """
    camera = Camera.of(question.design)
    noise = math.nan if is_focused(camera) else COVERAGE * float(depth_budget(camera, worst=False).of_kind("precision"))
    near, far = depth_of_field(camera, "view")
    shown = float(np.fmin(noise, (far - near) / 2))
    step = STEP**2 * question.design.d_1
    ends = {place: nominal_values(question.design)[place] + np.array([-step, step])}
    with np.errstate(all="ignore"):
        behind, ahead = focus_ahead(builds_of(question, ends, 2)[0].camera)
        return shown, float(shown * 2 * step / np.abs(ahead - behind))


def faults_of(question: Question, values: Mapping[str, Array], trials: int) -> dict[str, NDArray[np.bool_]]:
    """Why builds are no cameras: each reason in words to the builds that it holds for, (trials,).

    Parameters as for `evaluate_builds`; the reasons are the same ones, in the same order, for all builds of a design.
    """
    design = question.design
    if all(place in values for place in CONJUGATES):
        values = {place: numbers for place, numbers in values.items() if place != CONJUGATES[0]}
    with np.errstate(all="ignore"):
        mount = _mount(design, values, trials)
        faults = mount.nominal.replace(mount.changes).faults() | mount.faults
    return {words: np.broadcast_to(flags, (trials,)) for words, flags in faults.items()}
